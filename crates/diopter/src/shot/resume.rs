//! What tells one exposure from another, so that it goes on from its own checkpoint only.

use super::scene_setup::{is_placed, view};
use super::{Shot, ShotError};
use crate::camera::{Camera, Film};
use crate::checkpoint::Fnv;
use crate::expose::{Integrator, ProgressReporter, Settings, expose};
use diopter_image::ExposureFacts;

/// Pixels across the small exposure that stands for what the scene looks like.
const COLUMNS: usize = 64;

/// Settings of `[render]` that decide the light, not how much of its noise is left.
const OF_LIGHT: [&str; 6] = ["max_depth", "sampler", "stray", "diffraction", "quick", "polarized"];

/// Settings that may be paths: their files count by name, for they may lie in another folder of another machine.
const PATHS: [&str; 7] = ["file", "light", "environment", "body", "lens", "calibration", "aperture_image"];

/// Settings that decide no light: warnings, labels, and the read-out.
const NOT_OF_LIGHT: [&str; 4] = ["strict", "classes", "serial", "color_sampling"];

impl Shot {
    /// Stands for what is set of scene, camera, shutter and flash, and how paths are followed ([`ExposureFacts::settings_hash`]): as it was said, and what
    /// [`Shot::write_resolved`] writes of what was not. Empty where it cannot be told.
    pub(super) fn settings_hash(&self) -> String {
        let mut file = self.file.clone();
        self.write_resolved(&mut file);
        // More than TOML's integers hold; it is a fact of its own.
        file.render.seed = None;
        // Of a camera by its number the name.
        if file.camera.viewpoint.is_some()
            && let Ok(Some(view)) = view(&file, self.scene.description())
        {
            file.camera.viewpoint = Some(view.name.clone());
        }
        if !is_placed(&file.camera) {
            file.camera.up = None;
        }
        let Ok(all) = toml::Table::try_from(&file) else { return String::new() };
        let mut hash = Fnv::new();
        for section in ["scene", "camera", "shutter", "flash", "render"] {
            let Some(toml::Value::Table(mut settings)) = all.get(section).cloned() else { continue };
            settings.retain(|name, _| !NOT_OF_LIGHT.contains(&name) && (section != "render" || OF_LIGHT.contains(&name)));
            for (name, value) in settings.iter_mut() {
                if let toml::Value::String(path) = value
                    && PATHS.contains(&name.as_ref())
                    && let Some(at) = path.rfind(['/', '\\'])
                {
                    *path = path.split_off(at + 1);
                }
            }
            let settings = toml::Value::Table(settings);
            format!("{section} {settings}").bytes().for_each(|byte| hash.add(u64::from(byte)));
        }
        hash.add(u64::from(self.lens_cap));
        format!("{:016x}", hash.finish())
    }

    /// What decides the light on the film, as text: shots that agree in it have the same focal plane, whatever their ISO speed, white balance, noise and
    /// development are. [`Shot::meter`] must have been called. The scene counts by its name.
    ///
    /// Re-weighted fireflies count as the same, though the white they are measured by is that of the ISO speed: a series then has one threshold.
    pub fn exposure_key(&self) -> String {
        let file = &self.file;
        // Of the body's parts the serial number only belongs to the read-out.
        let mut camera = file.camera.clone();
        camera.serial = None;
        let asked = (&file.scene, camera, &file.shutter, &file.flash, file.render.quick);
        let mut facts = self.facts().of_picture();
        facts.serial.clear();
        let found = (facts, self.lens_cap, self.rgb, &self.camera.film, self.denoise, self.fireflies, self.diffracts());
        format!("{asked:?} {found:?} {:?} {} {:?}", self.settings, self.summed_bands(), self.response().bands)
    }

    /// A number that stands for this exposure: what was asked, what was metered and found, and how the scene looks through the camera. [`Shot::meter`]
    /// must have been called.
    ///
    /// The look is an exposure of 64 pixels across with one sample each: files are known by what they show, not by their names and dates. Two
    /// scenes that differ in none of these paths are not told apart. Fails where it is cancelled.
    pub fn identity(&self, watch: &ProgressReporter) -> Result<u64, ShotError> {
        let response = self.response();
        let settings = Settings { time_limit_s: None, ..self.settings.clone() };
        let film = &self.camera.film;
        let file = &self.file;
        let mut hash = Fnv::new();
        let asked = (&file.scene, &file.camera, &file.shutter, &file.flash, file.render.quick);
        let found = (self.facts().of_picture(), self.lens_cap, self.rgb, film, self.diffracts());
        // Sums with a cascade are other sums than those without.
        let summed = self.summed_bands();
        for byte in format!("{asked:?} {found:?} {settings:?} {summed} {:?}", response.bands).bytes() {
            hash.add(u64::from(byte));
        }
        if !self.lens_cap {
            let rows = (COLUMNS * film.rows).div_ceil(film.columns).clamp(1, 4 * COLUMNS);
            let camera = Camera { film: Film { columns: COLUMNS, rows, ..*film }, ..self.camera.clone() };
            let look = Settings { spp: 1, samples: 0..1, truth: false, integrator: Integrator::Path, ..settings };
            let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
            let plane = expose(&self.scene, &camera, &self.shutter(), &response, &look, &ExposureFacts::default(), &quiet)?;
            plane.mean.data.iter().for_each(|v| hash.add(u64::from(v.to_bits())));
        }
        Ok(hash.finish())
    }
}

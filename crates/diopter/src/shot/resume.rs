//! What tells one exposure from another, so that it goes on from its own checkpoint only.

use super::{Shot, ShotError};
use crate::camera::{Camera, Film};
use crate::checkpoint::Fnv;
use crate::expose::{Integrator, ProgressReporter, Settings, expose};
use diopter_image::ExposureFacts;

/// Takes the folders away from whatever may be a path.
fn without_folders(value: &mut toml::Value) {
    match value {
        toml::Value::String(text) => {
            if let Some(at) = text.rfind(['/', '\\']) {
                *text = text.split_off(at + 1);
            }
        }
        toml::Value::Array(all) => all.iter_mut().for_each(without_folders),
        toml::Value::Table(all) => all.iter_mut().for_each(|(_, value)| without_folders(value)),
        _ => (),
    }
}

/// Pixels across the small exposure that stands for what the scene looks like.
const COLUMNS: usize = 64;

/// Settings of `[render]` that decide the light, not how much of its noise is left.
const OF_LIGHT: [&str; 5] = ["max_depth", "sampler", "stray", "diffraction", "quick"];

impl Shot {
    /// Stands for what is set of scene, camera, shutter and flash, and how paths are followed, whether it was said or is the default ([`ExposureFacts::settings_hash`]). Files
    /// count by their names, in whichever folder they lie.
    pub(super) fn settings_hash(&self) -> String {
        let mut file = self.file.clone();
        self.write_resolved(&mut file);
        // Of the read-out alone.
        (file.camera.serial, file.camera.color_sampling) = (None, None);
        let all = toml::Table::try_from(&file).unwrap_or_default();
        let mut hash = Fnv::new();
        for section in ["scene", "camera", "shutter", "flash", "render"] {
            let Some(toml::Value::Table(mut settings)) = all.get(section).cloned() else { continue };
            settings.retain(|name, _| section != "render" || OF_LIGHT.contains(&name));
            let mut value = toml::Value::Table(settings);
            without_folders(&mut value);
            format!("{section} {value}").bytes().for_each(|byte| hash.add(u64::from(byte)));
        }
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

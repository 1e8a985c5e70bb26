//! A shot file that says everything: also what was chosen, and what was default.

use super::file::ShotFile;
use super::scene_setup::is_placed;
use super::sections::FocusSection;
use super::{DEFAULT_BODY, DEFAULT_SCENE, DEFAULT_SEED, Shot, metres_of};
use crate::program::Mode;
use crate::quantity::{Distance, Ev, FNumber, FocusTo, LengthMm, Seconds, Size};
use diopter_lens::{Focus, Lens, Projection};
use diopter_scene::builtin;
use diopter_scene::studio::Studio;
use diopter_sensor::ColorSampling;

impl Shot {
    /// Writes what was settled into a shot file: it then takes this picture again, whatever the meter says.
    pub fn write_resolved(&self, file: &mut ShotFile) {
        if file.sequence.bracket.is_some() {
            file.sequence.vary = Some(self.varies().name().into());
        }
        if matches!(file.focus.distance, Some(FocusTo::Auto | FocusTo::At(_))) {
            // Where it was found; what follows a thing goes on following it.
            let found = FocusTo::Extension(LengthMm(self.facts.extension_mm));
            file.focus = FocusSection { distance: Some(found), ..Default::default() };
        }
        let e = &mut file.exposure;
        e.shutter = self.shutter.map(Seconds);
        if e.aperture.is_some() || matches!(self.exposing.mode, Mode::ShutterPriority | Mode::Program) {
            e.aperture = Some(FNumber(self.facts.f_number));
        }
        e.iso = Some(crate::quantity::IsoChoice::Fixed(crate::quantity::Iso(self.reading.iso)));
        // All is set now; engraved numbers have become what they stand for.
        (e.mode, e.true_stops, e.iso_min, e.iso_max) = (Some(Mode::Manual.name().into()), false, None, None);
        self.write_defaults(file);
    }

    /// Writes into a shot file what nobody had asked for and was used, so that it holds whatever the defaults become. What follows from the
    /// scene alone (a view around a model without cameras) stays out: it is found again.
    pub(super) fn write_defaults(&self, file: &mut ShotFile) {
        let scene_name =
            file.scene.file.get_or_insert_with(|| self.file.scene.file.clone().unwrap_or_else(|| DEFAULT_SCENE.into())).clone();
        file.scene.at.get_or_insert(Seconds(self.begun_s()));
        if self.scene.description().objects.iter().any(Studio::is_part) {
            file.scene.light.get_or_insert_with(|| "studio".into());
        }
        let c = &mut file.camera;
        c.body.get_or_insert_with(|| self.file.camera.body.clone().unwrap_or_else(|| DEFAULT_BODY.into()));
        c.serial.get_or_insert_with(|| self.reading.serial.clone());
        // Pictures taken after this one are compared with it; full color follows again from which files are asked for.
        if self.color_sampling == ColorSampling::Mosaic {
            c.color_sampling.get_or_insert(ColorSampling::Mosaic);
        }
        let placed = is_placed(c);
        let first = self.scene.description().cameras.first();
        if let Some(framing) = builtin::framing(&scene_name).filter(|_| !placed && first.is_none() && c.up.is_none()) {
            c.look_from = Some(framing.look_from.to_array());
            c.look_at = Some(framing.look_at.to_array());
            file.focus.distance.get_or_insert(FocusTo::Distance(Distance(framing.focus_m)));
        } else if let Some(view) = first.filter(|_| !placed) {
            c.viewpoint.get_or_insert_with(|| if view.name.is_empty() { "0".into() } else { view.name.clone() });
        }
        if c.look_at.is_some() {
            c.up.get_or_insert([0.0, 1.0, 0.0]);
        }
        // Ideal lenses; real ones are named by the shot or belong to the scene.
        let ideal = match &self.camera.lens {
            Lens::Thin(lens) => {
                let metres = match lens.focus {
                    Focus::Infinity => Some(f64::INFINITY),
                    Focus::Distance(mm) => metres_of(mm.0),
                    Focus::Extension(_) => None,
                };
                if let (None, Some(m)) = (&file.focus.distance, metres) {
                    file.focus.distance = Some(FocusTo::Distance(Distance(m)));
                }
                Some("thin")
            }
            Lens::Pinhole(hole) if hole.projection == Projection::Rectilinear => Some("pinhole"),
            _ => None,
        };
        if let Some(name) = ideal {
            c.lens.get_or_insert_with(|| name.into());
            c.focal_length.get_or_insert(LengthMm(self.facts.focal_length_mm));
            // The focal length now says it.
            c.fov_deg = None;
            file.exposure.aperture = Some(FNumber(self.facts.f_number));
        }
        if let Some(facts) = &self.facts.shutter {
            file.shutter.kind.get_or_insert_with(|| facts.kind.clone());
        }
        let e = &mut file.exposure;
        // What changes nothing would be told as such by whoever reads the file.
        let all_is_set =
            e.mode.as_deref() == Some(Mode::Manual.name()) && matches!(e.iso, Some(crate::quantity::IsoChoice::Fixed(_)));
        match all_is_set {
            true => e.compensation = None,
            false => _ = e.compensation.get_or_insert(Ev(self.exposing.compensation_ev)),
        }
        if self.baseline_ev != 0.0 {
            e.baseline.get_or_insert(Ev(self.baseline_ev));
        }
        e.metering.get_or_insert_with(|| self.exposing.pattern.name().into());
        e.white.get_or_insert_with(|| self.reading.white.clone());
        if self.sensor.ignored_temperature().is_none() {
            e.temperature_c.get_or_insert(self.sensor.temperature_c);
        }
        let r = &mut file.render;
        r.size.get_or_insert(Size { width: self.camera.film.columns, height: self.camera.film.rows });
        if r.time_limit.is_none() {
            r.spp.get_or_insert(self.settings.spp);
        }
        r.seed.get_or_insert(DEFAULT_SEED);
        r.sampler.get_or_insert_with(|| "sobol".into());
        r.max_depth.get_or_insert(self.settings.path.max_depth);
        r.integrator.get_or_insert_with(|| self.settings.integrator.name().into());
        r.stray.get_or_insert_with(|| self.settings.stray.name());
        r.diffraction.get_or_insert(self.diffraction);
        r.fireflies.get_or_insert(self.fireflies);
        r.denoise.get_or_insert(self.denoise);
    }
}

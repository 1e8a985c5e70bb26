//! From the scene to the picture: exposure, read-out, development.

use super::sections::{DiffractionChoice, FireflyChoice};
use super::{ExposedStrips, Shot, ShotError, sequence, white_point};
use crate::camera::{Camera, Film};
use crate::denoising::{BUILT_IN, Denoise, Filter};
use crate::expose::{
    Diffraction, Exposed, Exposure, Fireflies, Frames, ProgressReporter, Response, Settings, Sums, SumsCallback,
};
use crate::quick_look::Optics;
use crate::row_store::PagedRows;
use crate::stray::WithStray;
use crate::{expose, quick_look};
use diopter_develop::denoise::Denoised;
use diopter_develop::{DemosaicStep, develop};
use diopter_image::focal_plane::{FocalPlaneSource, Truth};
use diopter_image::{ExposureFacts, FocalPlane, Picture, Raster, RawImage};
use diopter_lens::Lens;
use diopter_sensor::{ColorSampling, Reading, read_out};
use std::path::Path;
use std::sync::Arc;

/// Samples a pixel where nothing but denoised pictures is made: what a denoiser makes good of.
const DENOISED_SPP: u32 = 16;
/// The same of one that is read in full color: as near to a picture of very many samples as a mosaic with [`DENOISED_SPP`] is.
const DENOISED_FULL_COLOR_SPP: u32 = 12;

impl Shot {
    /// Facts as known so far.
    pub fn facts(&self) -> ExposureFacts {
        ExposureFacts { exposure_s: self.shutter.unwrap_or(0.0), iso: self.reading.iso, ..self.facts.clone() }
    }

    /// What the film records.
    pub(super) fn response(&self) -> Response {
        match &self.spectral {
            Some(bands) => Response::spectral(bands),
            None if self.radiance => Response::linear_srgb(),
            None => Response::sensor(&self.sensor),
        }
    }

    /// Bands that the film records.
    pub fn bands(&self) -> usize {
        self.response().bands.len()
    }

    /// Whether fireflies are re-weighted: if that was asked for, the film counts electrons and all samples are taken at once (parts and what they merge
    /// to keep them).
    pub fn reweights(&self) -> bool {
        let electrons = !self.radiance && self.spectral.is_none();
        self.fireflies == FireflyChoice::Reweight && electrons && !self.lens_cap && self.settings.is_whole()
    }

    /// Whether light is diffracted at the aperture: if that was asked for, or where it shows. Not in a quick look, whose rays know no aperture.
    pub fn diffracts(&self) -> bool {
        self.diffracts_through(&self.camera.lens)
    }

    /// The same with another lens, or the same set otherwise.
    pub(crate) fn diffracts_through(&self, lens: &Lens) -> bool {
        let possible = !self.lens_cap && !self.file.render.quick && !matches!(lens, Lens::Pinhole(_));
        match self.diffraction {
            DiffractionChoice::Off => false,
            DiffractionChoice::On => possible,
            DiffractionChoice::Auto => possible && expose::diffraction_shows(lens, &self.camera.film),
        }
    }

    /// Whether starbursts are drawn separately: where there is diffraction and the film counts electrons, whose white says what a lamp is.
    pub fn separates_starbursts(&self) -> bool {
        self.starbursts && !self.radiance && self.spectral.is_none() && self.diffracts()
    }

    /// Bands that the sums of the exposure hold: those of the film, and more where fireflies are re-weighted, where lamps make stars and where direct
    /// light is recorded.
    pub fn summed_bands(&self) -> usize {
        expose::summed_bands(self.bands(), self.reweights(), self.separates_starbursts(), self.settings.records_direct())
    }

    /// Exposes the film. [`Shot::meter`] must have been called. Fails as [`Shot::expose_from`].
    pub fn expose(&self, watch: &ProgressReporter) -> Result<FocalPlane, ShotError> {
        Ok(self.expose_from(None, watch, None)?.plane)
    }

    /// Exposes the film, or goes on from where `start` stands. `keep` and being stopped: see [`Exposure::run`]. What was stopped is not denoised, nor what
    /// is denoised for pictures alone ([`Shot::for_pictures`]). Fails as [`Exposure::run`] and [`Filter::denoise`].
    pub fn expose_from(
        &self,
        start: Option<Sums>,
        watch: &ProgressReporter,
        keep: Option<SumsCallback>,
    ) -> Result<Exposed, ShotError> {
        if self.lens_cap {
            let plane = darkness(&self.camera.film, &self.response(), &self.settings, self.plane_facts());
            return Ok(Exposed { plane, stopped: false, stray: None });
        }
        self.with_exposure(|exposure, optics| {
            let Exposed { mut plane, stopped, .. } = exposure.run(watch, start, keep)?;
            // A quick look has no rays through the lens.
            if self.denoises_exposure()
                && !stopped
                && let Some(filter) = &self.filter
            {
                let features = self.features(exposure.camera);
                plane = filter.denoise(&plane, features.as_ref())?;
            }
            // After denoising, whose guides are sharp.
            if let Some(optics) = optics {
                plane = quick_look::of_plane(&plane, optics);
            }
            // It has no noise that a filter should see, and glare is of what was denoised.
            let stray = match self.file.render.quick {
                true => None,
                false => exposure.stray_light(|seen| seen.add_rows(&plane.mean, 0)),
            };
            if let Some(stray) = &stray {
                stray.change(&mut plane, 0);
            }
            plane.facts.light_scale = self.settings.light_scale;
            Ok(Exposed { plane, stopped, stray })
        })
    }

    /// The picture so far of an exposure under way, from the sums that [`Shot::expose_from`] hands to `keep`: not denoised, without truth and stray light. `None` before the first
    /// pass and in the midst of one ([`Exposure::so_far`]); passes end with 2, 4, 8 ... samples of each pixel, and later when some seconds have gone.
    pub fn so_far(&self, sums: &Sums) -> Option<FocalPlane> {
        self.with_exposure(|exposure, optics| {
            let mut plane = exposure.so_far(sums)?;
            if let Some(optics) = optics {
                plane = quick_look::of_plane(&plane, optics);
            }
            plane.facts.light_scale = self.settings.light_scale;
            Some(plane)
        })
    }

    /// The exposure as it is computed, and the blur of a quick look, which is added to it afterwards.
    fn with_exposure<R>(&self, run: impl FnOnce(&Exposure, Option<&Optics>) -> R) -> R {
        let response = self.response();
        // The shapes of the blur cost seconds through a real lens: only a quick look asks for them.
        let optics = if self.file.render.quick { Optics::of(&self.camera) } else { None };
        let sharp = optics.is_some().then(|| quick_look::sharp_camera(&self.camera));
        let exposure = Exposure {
            scene: &self.scene,
            camera: sharp.as_ref().unwrap_or(&self.camera),
            shutter: &self.shutter(),
            response: &response,
            settings: &self.light_settings(response.bands.len()),
            facts: &self.plane_facts(),
        };
        run(&exposure, optics.as_ref())
    }

    /// Whether [`Shot::expose_rows`] can take this exposure: a quick look and Open Image Denoise work on the whole plane, and a lens cap needs no light.
    pub fn can_expose_rows(&self) -> bool {
        !self.lens_cap && !self.file.render.quick && self.denoise != Denoise::Oidn
    }

    /// Says that pictures to look at are developed from this shot, beside raw files or planes if `raw_too`. Alone, small ones are read in full color
    /// ([`Shot::sample_pictures_in_full_color`]). Where nobody said otherwise ([`Denoise::Auto`]) they are denoised, by [`Shot::for_pictures`], and made of fewer samples. `warn` gets what is wrong with the filter.
    ///
    /// Light fields are left: behind microlenses neighbours see other parts of the scene. A quick look makes its blur from a sharp exposure, which is
    /// the one that is denoised, unless raw files are made of it. Fails where the file that `render.oidn` names cannot be used.
    pub fn prepare_pictures(&mut self, raw_too: bool, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if !raw_too {
            self.sample_pictures_in_full_color();
        }
        let quick = self.file.render.quick;
        if self.denoise == Denoise::Auto && self.camera.film.microlenses.is_none() && !self.lens_cap && !(quick && raw_too) {
            self.filter = Filter::open(Denoise::Auto, self.file.render.oidn.as_deref(), warn)?;
            let render = &self.file.render;
            if self.filter.is_some()
                && !raw_too
                && render.spp.is_none()
                && render.samples.is_none()
                && render.time_limit.is_none()
            {
                let spp = if self.color_sampling == ColorSampling::Full { DENOISED_FULL_COLOR_SPP } else { DENOISED_SPP };
                self.settings = Settings { spp, samples: 0..spp, ..self.settings.clone() };
            }
        }
        Ok(())
    }

    /// Says that nothing but pictures to look at is made of this shot: where nobody said otherwise, small ones are read in full color ([`ColorSampling::Full`]), as a
    /// camera makes them of many photosites; single ones of a mosaic, far apart, would show edges and glints in false colors. Small are those with two photosites or
    /// more to a pixel each way, so that all colors of a Bayer pattern lie in it. Light fields are left, and where a method of demosaicing is asked for.
    pub fn sample_pictures_in_full_color(&mut self) {
        let (film, pitch) = (&self.camera.film, self.sensor.pitch_mm());
        let sides = [(film.width_mm, film.columns), (film.height_mm, film.rows)];
        let is_small = sides.iter().zip(pitch).all(|((mm, pixels), pitch)| mm / *pixels as f64 >= 1.999 * pitch);
        let asked = self.file.camera.color_sampling.is_some() || self.recipe.demosaic.method != DemosaicStep::default().method;
        if is_small && !asked && self.sensor.has_color_filters() && film.microlenses.is_none() {
            self.color_sampling = ColorSampling::Full;
        }
    }

    /// Whether the exposure itself is denoised, and with it all that is made of it.
    pub(super) fn denoises_exposure(&self) -> bool {
        self.filter.is_some() && (self.denoise != Denoise::Auto || self.file.render.quick)
    }

    /// What the filter is guided by instead of the truth: what is behind smooth glass and in mirrors, which networks have learnt from.
    pub(super) fn features(&self, camera: &Camera) -> Option<Truth> {
        let network = matches!(&self.filter, Some(Filter::Oidn(_)));
        network.then(|| expose::features(&self.scene, camera, &self.shutter()))
    }

    /// The exposure that pictures to look at are developed from, if it is another than `exposed`: one without the renderer's noise. What was stopped is not denoised.
    /// Fails as [`Filter::denoise`].
    pub fn for_pictures(&self, exposed: &Exposed) -> Result<Option<FocalPlane>, ShotError> {
        match &self.filter {
            Some(filter) if !self.denoises_exposure() && !exposed.stopped => {
                let Some(stray) = &exposed.stray else {
                    return Ok(Some(filter.denoise(&exposed.plane, self.features(&self.camera).as_ref())?));
                };
                // Ghosts have no noise, and edges that the guides do not know.
                let mut plane = exposed.plane.clone();
                stray.subtract_from(&mut plane.mean);
                let mut plane = filter.denoise(&plane, self.features(&self.camera).as_ref())?;
                stray.add_to(&mut plane.mean, 0);
                Ok(Some(plane))
            }
            _ => Ok(None),
        }
    }

    /// The same for planes that memory cannot hold, in about `memory` bytes beside what [`Shot::bytes_needed`] says: the sums lie in a temporary file in
    /// `folder`. [`Shot::can_expose_rows`] must hold. Fails as [`Exposure::run_paged`].
    pub fn expose_rows(
        &self,
        start: Option<Sums<PagedRows>>,
        watch: &ProgressReporter,
        keep: Option<SumsCallback<PagedRows>>,
        memory: usize,
        folder: &Path,
    ) -> Result<ExposedStrips<'_>, ShotError> {
        self.with_exposure(|exposure, _| {
            let mut exposed = exposure.run_paged(watch, start, keep, memory, folder)?;
            exposed.facts.light_scale = self.settings.light_scale;
            let stopped = exposed.stopped;
            let stray = exposure.stray_light(|seen| exposed.gather(seen));
            let rows = exposed.rows(&self.scene);
            let plane: Box<dyn FocalPlaneSource + '_> = match self.denoises_exposure() && !stopped {
                true => {
                    let farthest = rows.farthest_log_depth();
                    Box::new(Denoised::new(rows, farthest).named(BUILT_IN))
                }
                false => Box::new(rows),
            };
            let plane: Box<dyn FocalPlaneSource + '_> = match stray {
                Some(stray) => Box::new(WithStray::new(plane, stray)),
                None => plane,
            };
            Ok(ExposedStrips { plane, stopped })
        })
    }

    /// Facts of a focal plane: the speed is the read-out's; what the camera was set to goes with the plane.
    pub fn plane_facts(&self) -> ExposureFacts {
        let usual = Reading::new(self.reading.iso, self.reading.seed);
        let other = |set: &str, usual: &str| if set == usual { String::new() } else { set.to_owned() };
        ExposureFacts {
            iso: 0.0,
            iso_set: self.reading.iso,
            serial: other(&self.reading.serial, &usual.serial),
            temperature_c: self.reading.temperature_c,
            white: other(&self.reading.white, &usual.white),
            settings_hash: self.settings_hash(),
            ..self.facts()
        }
    }

    /// The frames before and after this exposure, where truth asks for them: of a film at its own rate, of a single picture as of a film of 24 frames a second.
    pub(super) fn frames(&self) -> Option<Frames> {
        if !self.settings.truth_channels.iter().any(|c| c.needs_frames) {
            return None;
        }
        let (at_s, step_s) = (self.timing.at_s, 1.0 / self.file.sequence.fps.unwrap_or(sequence::FPS));
        let total = self.shutter().total_s();
        // A stabiliser that stood ready for this exposure does so for the others.
        let motion = |at_s: f64| self.camera_motion(&self.timing.moved_to(at_s), total).ok();
        Some(Frames { at_s, step_s, next: motion(at_s + step_s)?, previous: motion(at_s - step_s)? })
    }

    /// Settings of the exposure itself. What a filter takes is one factor on all light: the plane's facts keep it apart from the scene's own scale.
    pub(super) fn light_settings(&self, bands: usize) -> Settings {
        let mut settings = self.settings.clone();
        settings.rgb = self.rgb && self.radiance && self.spectral.is_none();
        settings.light_scale *= (-self.exposing.nd_stops).exp2();
        settings.time_limit_s = self.time_left_s(bands);
        settings.frames = self.frames().map(Arc::new);
        let white_e =
            self.sensor.at_iso(self.reading.iso).map_or(self.sensor.full_well_e, |step| self.sensor.saturation_e(&step));
        if self.reweights() {
            settings.fireflies = Fireflies::Reweight { white_e };
        }
        if self.diffracts() {
            settings.diffraction = Diffraction::On { white_e: self.separates_starbursts().then_some(white_e) };
        }
        settings
    }

    /// Reads the film out. Fails on a plane that does not hold the electrons of the body's channels, and on an ISO speed or temperature out of range.
    pub fn read_out(&self, plane: &FocalPlane) -> Result<RawImage, ShotError> {
        let reading = Reading { color_sampling: self.color_sampling, ..self.reading.clone() };
        let mut raw = read_out(plane, &self.sensor, &reading, &white_point(&reading.white)?)?;
        raw.header.facts.date.clone_from(&self.date);
        raw.header.baseline_ev += self.baseline_ev;
        if self.settings.half.is_some() {
            // Half of the light: developed as bright as whole pixels.
            raw.header.baseline_ev += self.half_ev;
            raw.header.facts.serial.clone_from(&self.facts.serial);
        }
        Ok(raw)
    }

    /// Develops a raw image by the shot's recipe. Fails where the recipe asks for what the file cannot give, such as the focus of a light field.
    pub fn develop(&self, raw: &RawImage) -> Result<Picture, ShotError> {
        Ok(develop(raw, &self.recipe, self.lut.clone())?)
    }
}

/// The exposure of a film that no light reaches.
fn darkness(film: &Film, response: &Response, settings: &Settings, facts: ExposureFacts) -> FocalPlane {
    let (width, height, bands) = (film.columns, film.rows, response.bands.len());
    FocalPlane {
        bands: response.bands.clone(),
        mean: Raster::new(width, height, bands),
        half_difference: Raster::new(width, height, bands),
        truth: Truth::empty(width, height),
        facts: ExposureFacts { seed: settings.seed, samples: 1, light_scale: 1.0, ..facts },
    }
}

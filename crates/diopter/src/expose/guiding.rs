//! Path guiding of an exposure: whether it is trained, by which paths, and what is said of it.
//!
//! The guide depends on seed, scene, camera, film and the number of samples of the whole exposure, never on which of them are rendered: parts of an
//! exposure, on whatever machine, learn the same guide and merge to the whole.

use super::{ExposeError, Exposure, Sums, Watch};
use diopter_image::GuideFacts;
use diopter_scene::guide::{Trained, Training};
use diopter_scene::{Guide, GuideMode};
use std::sync::atomic::Ordering;

/// Samples a pixel that training counts on where a time limit decides how many there will be.
const TIMED_SPP: u32 = 64;

/// A guide, if there is one, and its training.
#[derive(Default)]
pub(super) struct Guided {
    /// What paths are guided by.
    pub guide: Option<Guide>,
    /// What is said of it; `None` where nothing was trained.
    pub facts: Option<GuideFacts>,
    /// Fraction of all paths, those of the samples included, that training followed: what progress begins with.
    pub share: f64,
}

impl Exposure<'_> {
    /// Trains a guide where one is wanted and can help. Fails when cancelled.
    ///
    /// Under a time limit `auto` leaves it out: how many samples there will be, and so what training is worth, is not known.
    pub(super) fn train<S>(&self, watch: &Watch, sums: &Sums<S>) -> Result<Guided, ExposeError> {
        let (settings, film, wanted) = (self.settings, &self.camera.film, self.wanted());
        if sums.samples.end >= wanted.end {
            return Ok(Guided::default());
        }
        let (mode, spp) = match (settings.time_limit_s, settings.guide) {
            (None, mode) => (mode, settings.spp),
            (Some(_), GuideMode::Auto) => (GuideMode::Off, 0),
            (Some(_), mode) => (mode, settings.spp.min(TIMED_SPP)),
        };
        let pixels = film.columns as u64 * film.rows as u64;
        let Some(paths) = Training::paths(pixels * u64::from(spp), &settings.path, mode) else {
            return Ok(Guided::default());
        };
        let share = |trained: u64| trained as f64 / (trained as f64 + pixels as f64 * wanted.len() as f64);
        let (curves, wavelengths) = self.curves();
        let unit = self.unit(&curves, &wavelengths, None);
        let training =
            Training { paths, film: [film.columns as u32, film.rows as u32], seed: settings.seed, path: settings.path, mode };
        let trained = training.run(
            self.scene,
            &|[column, row], sampler| {
                let sample = unit.camera_ray(column as usize, row as usize, sampler)?;
                Some((sample.ray, sample.wavelengths))
            },
            &mut |done| {
                (watch.progress)(share(paths) * done);
                !watch.cancel.load(Ordering::Relaxed)
            },
        );
        let Some(Trained { guide, gain, paths }) = trained else { return Err(ExposeError::Cancelled) };
        // Three decimals survive every file.
        let gain = gain.map(|g| (g * 1e3).round() / 1e3);
        let facts = Some(GuideFacts { used: guide.is_some(), gain, paths });
        Ok(Guided { guide, facts, share: share(paths) })
    }
}

//! A time limit holds for the whole photograph: what preparing, focusing and metering took is gone, and what comes after the exposure is held back.
//!
//! What comes after is estimated so:
//! * Denoising: measured. A small plane of noise is denoised on this machine; the cost of a pixel depends on the number of bands and hardly on what is
//!   seen (every pixel regresses over its whole window).
//! * Read-out, development and files: [`FINISHING_S_PER_PIXEL`].
//!
//! Autofocus begins no other zone after a third of the limit ([`FOCUSING`]).
//!
//! Denoising that does not fit into what is left of the limit is left out, which a warning says with the estimate: a picture in time is wanted more than
//! a smooth one, and whoever wants both gives more time or fewer pixels. Of a sequence the first picture decides for all, so that they look alike.
//!
//! Planes of depth, normals and albedo are computed before the samples ([`crate::expose()`]): their time is measured like that of metering.

use super::Shot;
use crate::denoising::{Denoise, Filter};
use diopter_image::focal_plane::{Band, BandUnit};
use diopter_image::{ExposureFacts, FocalPlane};
use diopter_light::random::{mix, to_unit};
use std::time::Instant;

/// Read-out and development of a pixel, s: 24 megapixels take 0.95 and 1.94 s on two cores (docs/performance.md), with a quarter on top
/// for planes that are written.
const FINISHING_S_PER_PIXEL: f64 = 0.15e-6;
/// The plane that is denoised to see how long it takes: pixels across and down for each thread. Several tiles of the built-in filter; the measure takes
/// 0.1 s of a core that does 1e5 pixels a second.
const TRIAL: [usize; 2] = [128, 64];
/// The same for Open Image Denoise, whose setting up would count too much in less: 0.1 to 0.2 s of a core.
const LIBRARY_TRIAL: [usize; 2] = [256, 256];
/// Some reserve: for borders, where windows of so small a plane lose some of their pixels, and for a machine that has other work.
const TRIAL_RESERVE: f64 = 1.4;

/// What fraction of the limit autofocus may take before it begins no other zone.
const FOCUSING: f64 = 1.0 / 3.0;

impl Shot {
    /// When autofocus begins no other zone; `None` without a limit.
    pub(super) fn focus_deadline(&self) -> Option<Instant> {
        let limit = std::time::Duration::try_from_secs_f64(FOCUSING * self.settings.time_limit_s?).ok()?;
        self.begun.checked_add(limit)
    }

    /// What is left of the time limit for the exposure, s; `None` without a limit. May be 0: an exposure then takes its fewest samples.
    pub(super) fn time_left_s(&self, bands: usize) -> Option<f64> {
        let limit = self.settings.time_limit_s?;
        let size = [self.camera.film.columns, self.camera.film.rows];
        let denoising = self.denoising_s.unwrap_or_else(|| self.denoising_s(bands));
        Some(left_s(limit, self.begun.elapsed().as_secs_f64(), denoising, size))
    }

    /// How long denoising will take, s; 0 without.
    fn denoising_s(&self, bands: usize) -> f64 {
        let size = [self.camera.film.columns, self.camera.film.rows];
        self.filter.as_ref().map_or(0.0, |filter| denoising_s(filter, size, bands))
    }

    /// Estimates what comes after the exposure, leaves denoising out if there is no time for it, and warns of that, and of a picture that cannot be
    /// finished within the limit at all.
    pub(super) fn keep_to_time_limit(&mut self, warn: &mut dyn FnMut(&str)) {
        let Some(limit) = self.settings.time_limit_s else { return };
        let size = [self.camera.film.columns, self.camera.film.rows];
        let denoising = self.denoising_s(self.bands());
        self.denoising_s = Some(denoising);
        let (keep, said) = fitting(limit, self.begun.elapsed().as_secs_f64(), denoising, size);
        if !keep {
            (self.denoise, self.filter) = (Denoise::Off, None);
        }
        said.iter().for_each(|s| warn(s));
    }
}

/// Whether there is time for denoising, and what is to be said of the limit.
fn fitting(limit: f64, spent: f64, denoising: f64, size: [usize; 2]) -> (bool, Vec<String>) {
    let finishing = FINISHING_S_PER_PIXEL * size[0] as f64 * size[1] as f64;
    let mut said = Vec::new();
    let keep = denoising == 0.0 || spent + denoising + finishing < limit;
    if !keep {
        said.push(format!(
            "denoising takes about {denoising:.1} s, and {:.1} s of the time limit of {limit:.1} s are left for it: it is left out (give a longer \
             --time-limit, a smaller --size, or denoise the focal plane later)",
            (limit - spent - finishing).max(0.0)
        ));
    }
    if spent + finishing >= limit {
        said.push(format!(
            "the time limit of {limit:.1} s is shorter than all but the exposure: {spent:.1} s until now, and about {finishing:.1} s for read-out, \
             development and files; the exposure takes its fewest samples"
        ));
    }
    (keep, said)
}

fn left_s(limit: f64, spent: f64, denoising: f64, [width, height]: [usize; 2]) -> f64 {
    (limit - spent - denoising - FINISHING_S_PER_PIXEL * width as f64 * height as f64).max(0.0)
}

/// How long a plane will take to be denoised, s, by a trial with all threads.
fn denoising_s(filter: &Filter, [width, height]: [usize; 2], bands: usize) -> f64 {
    let trial = match filter {
        Filter::BuiltIn => [TRIAL[0], TRIAL[1] * rayon::current_num_threads()],
        Filter::Oidn(_) => LIBRARY_TRIAL,
    };
    let size = [trial[0].min(width), trial[1].min(height)];
    let band = |b: usize| Band { name: b.to_string(), unit: BandUnit::Electrons };
    let facts = ExposureFacts::default();
    let mut plane = FocalPlane::even((0..bands).map(band).collect(), &vec![0.0; bands], size, facts);
    for (i, (mean, half)) in plane.mean.data.iter_mut().zip(&mut plane.half_difference.data).enumerate() {
        *mean = 1.0 + to_unit(mix(2 * i as u32));
        *half = 0.1 * (to_unit(mix(2 * i as u32 + 1)) - 0.5);
    }
    if matches!(filter, Filter::Oidn(_)) {
        // Its first picture takes longer.
        let _ = filter.denoise(&plane.rows(0..size[1].min(16)), None);
    }
    let begun = Instant::now();
    // What fails here fails again behind the exposure, and is told there.
    let _ = filter.denoise(&plane, None);
    by_pixels(begun.elapsed().as_secs_f64(), size, [width, height])
}

/// Seconds for a picture, by those of a trial of a size.
fn by_pixels(seconds: f64, trial: [usize; 2], picture: [usize; 2]) -> f64 {
    let [trial, picture] = [trial, picture].map(|[width, height]| width as f64 * height as f64);
    TRIAL_RESERVE * seconds * (picture / trial).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_spent_and_what_comes_after_is_taken_off() {
        assert!((left_s(20.0, 3.0, 5.0, [1000, 1000]) - 11.85).abs() < 1e-9);
        assert_eq!(left_s(20.0, 3.0, 18.0, [1000, 1000]), 0.0);
    }

    #[test]
    fn denoising_that_does_not_fit_is_left_out_and_said() {
        // 1 megapixel takes 0.15 s to finish.
        let size = [1000, 1000];
        assert_eq!(fitting(20.0, 3.0, 16.0, size), (true, vec![]));
        assert_eq!(fitting(20.0, 3.0, 0.0, size), (true, vec![]));
        let (keep, said) = fitting(20.0, 3.0, 17.0, size);
        assert!(!keep && said.len() == 1 && said[0].contains("17.0 s") && said[0].contains("16.9 s"), "{said:?}");
        // Too late for anything.
        let (keep, said) = fitting(2.0, 3.0, 0.0, size);
        assert!(keep && said.len() == 1 && said[0].contains("fewest samples"), "{said:?}");
        assert_eq!(fitting(2.0, 3.0, 1.0, size).1.len(), 2);
    }

    #[test]
    fn denoising_is_estimated_by_pixels() {
        assert!((by_pixels(0.2, [32, 128], [320, 1280]) - 100.0 * 0.2 * TRIAL_RESERVE).abs() < 1e-12);
        // What is smaller than the trial takes as long.
        assert_eq!(by_pixels(0.2, [32, 128], [8, 8]), 0.2 * TRIAL_RESERVE);
        assert!(denoising_s(&Filter::BuiltIn, [16, 16], 1) > 0.0);
    }
}

//! How far paths through media are worth following, learnt from some thousand of them before an exposure ([`RouletteRates`]). In fog at night hardly any light is scattered
//! more than four times, and following it takes two thirds of the time; in milk nearly all is.
//!
//! As the trials of `auto`, it depends on seed, scene, camera, film and number of samples alone, not on which of them are asked for.

use super::trial::{BLOCKS, pixel_of_block, relative_mean};
use super::unit::Unit;
use super::{Exposure, Integrator};
use diopter_light::SampledSpectrum;
use diopter_light::random::{Sampler, SamplerKind};
use diopter_scene::RouletteRates;
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::RadianceByEvents;
use rayon::prelude::*;

/// Its numbers are neither those of the samples nor of the trials.
const SEED: u64 = 0x3c6e_f372_fe94_f82b;

/// Fewest and most pixels of a block a side, each of which has two samples, and paths of the exposure for each of them.
const SIDE: (usize, usize) = (4, 12);
const PATHS_A_PIXEL: f64 = 8192.0;

/// Camera paths of an exposure below which none is followed to learn: the trial takes as long as two thousand.
const LEAST_PATHS: f64 = 65_536.0;

/// Of the squared errors of light that is scattered once so many of the largest are left out: with them a single path makes all that comes later look faint. Of later light all
/// counts: what a trial sees rarely it must not take for nothing.
const WORST: f64 = 0.001;

const STAGES: usize = RouletteRates::EVENTS.len();

/// Light of a path by stages of scattering events ([`RadianceByEvents`]), and the events of the path itself.
type Seen = ([f64; STAGES + 1], u32);

impl Exposure<'_> {
    /// How many paths that go alone are worth following on; `None` where nearly all are, and where it is not worth asking: without media that scatter, and
    /// in small pictures of few samples.
    pub(super) fn roulette_rates(&self, unit: &Unit) -> Option<RouletteRates> {
        let film = [self.camera.film.columns, self.camera.film.rows];
        let paths = (film[0] * film[1]) as f64 * f64::from(self.settings.spp);
        let goes_alone = matches!(self.settings.integrator, Integrator::Auto | Integrator::Path | Integrator::Caustics);
        if !goes_alone || paths < LEAST_PATHS || self.scene.media_only_absorb() {
            return None;
        }
        let side = ((paths / PATHS_A_PIXEL).sqrt() as usize).clamp(SIDE.0, SIDE.1);
        // Two samples of each pixel of a block.
        let block = |block: usize| -> Vec<[Seen; 2]> {
            let begin = |k: usize| {
                let [column, row] = pixel_of_block(film, block, k, side);
                let seed = self.settings.seed ^ SEED;
                let [a, b] = [0, 1].map(|replicate| {
                    let sampler = Sampler::new(SamplerKind::Independent, seed, (block as u32, k as u32), replicate, 2);
                    let camera = unit.camera_ray(column, row, &sampler, &sampler)?;
                    Some(CameraPath { immersion: unit.immersion, ..CameraPath::new(camera.ray, camera.wavelengths, sampler) })
                });
                Some([a?, b?])
            };
            let paths: Vec<CameraPath> = (0..side * side).filter_map(begin).flatten().collect();
            let seen = self.scene.trace(&paths, RadianceByEvents, &self.settings.path);
            let in_numbers = |((light, events), path): (([SampledSpectrum; STAGES + 1], u32), &CameraPath)| -> Seen {
                let number = |light: SampledSpectrum| f64::from((light * path.wavelengths.weight).element_sum());
                (light.map(number).map(|light| if light.is_finite() { light } else { 0.0 }), events)
            };
            let seen: Vec<Seen> = seen.into_iter().zip(&paths).map(in_numbers).collect();
            seen.as_chunks::<2>().0.to_vec()
        };
        let blocks: Vec<Vec<[Seen; 2]>> = (0..BLOCKS * BLOCKS).into_par_iter().map(block).collect();
        rates(&blocks)
    }
}

/// The best rates for paths that were seen, in blocks of pixels with two samples each.
fn rates(blocks: &[Vec<[Seen; 2]>]) -> Option<RouletteRates> {
    let mean = |pixels: &Vec<[Seen; 2]>| {
        pixels.iter().flatten().flat_map(|(light, _)| light).sum::<f64>() / (2 * pixels.len()).max(1) as f64
    };
    let means: Vec<f64> = blocks.iter().map(mean).collect();
    // What `of` says of the light of a stage in the two samples of a pixel, over the square of all light around.
    let relative = |stage: usize, of: fn(f64, f64) -> f64, worst: f64| {
        relative_mean(blocks, &means, |[a, b]: &[Seen; 2]| of(a.0[stage], b.0[stage]), worst)
    };
    // Events of all paths from one number on up to another; one more for the way from the camera.
    let events = |from: u32, to: u32| {
        blocks.iter().flatten().flatten().map(|(_, events)| f64::from((*events).min(to).saturating_sub(from))).sum::<f64>()
    };
    let paths = blocks.iter().map(|pixels| 2 * pixels.len()).sum::<usize>();
    let first = [relative(0, |a, b| 0.5 * (a - b).powi(2), WORST), paths as f64 + events(0, RouletteRates::EVENTS[0])];
    let then = std::array::from_fn(|stage| {
        let end = RouletteRates::EVENTS.get(stage + 1).copied().unwrap_or(u32::MAX);
        [relative(stage + 1, |a, b| 0.5 * (a * a + b * b), 0.0), events(RouletteRates::EVENTS[stage], end)]
    });
    RouletteRates::best(first, then)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Paths of a block whose light of each stage is a fraction of that of the stage before, in two samples of each pixel that differ, and which all go on for long.
    fn fading(fraction: f64) -> Vec<[Seen; 2]> {
        let path = |seen: f64| (std::array::from_fn(|stage| seen * fraction.powi(stage as i32)), 17);
        vec![[path(0.8), path(1.2)]; SIDE.0 * SIDE.0]
    }

    #[test]
    fn faint_light_is_followed_by_few_paths_whatever_its_unit() {
        let rates = |fraction: f64, scale: f64| {
            let mut blocks = vec![fading(fraction); BLOCKS * BLOCKS];
            blocks.iter_mut().flatten().flatten().flat_map(|path| &mut path.0).for_each(|light| *light *= scale);
            super::rates(&blocks)
        };
        let faint = rates(0.05, 1.0).expect("few are worth it");
        assert!(faint.after(2) < 0.5 && faint.after(9) < 0.15, "{faint:?}");
        let other = rates(0.05, 1e6).unwrap();
        assert!((1..20).all(|n| (faint.after(n) - other.after(n)).abs() < 1e-5));
        assert_eq!(rates(2.0, 1.0), None);
    }

    #[test]
    fn blocks_where_light_is_scattered_often_keep_paths_alive() {
        let mut blocks = vec![fading(0.02); BLOCKS * BLOCKS];
        let before = rates(&blocks).unwrap().after(4);
        // A quarter of the picture, as bright as the rest.
        blocks[..16].iter_mut().for_each(|block| *block = fading(1.0));
        let after = rates(&blocks).map_or(1.0, |rates| rates.after(4));
        assert!(after > 1.5 * before, "{before} {after}");
    }
}

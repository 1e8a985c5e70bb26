//! Which integrator computes an exposure, and how often caustics get new photons.

use super::Exposure;
use super::tile::Unit;
use diopter_light::random::{Sampler, SamplerKind};
use diopter_scene::light_paths::{CausticSettings, Caustics, ConnectionSettings, Connections, Lamps};
use rayon::prelude::*;

/// How light transport is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// Paths from the camera only.
    Path,
    /// And photons for the caustics of all lamps that are not the environment, and light traced from small lamps out of focus.
    Caustics,
    /// And connections of camera paths with light paths from the lamps (bidirectional path tracing); photons where `auto` would make them.
    Bidirectional,
    /// Photons for the caustics of small lamps where smooth bodies of glass or metal throw them, light traced from small lamps out of focus; paths from
    /// the camera elsewhere.
    #[default]
    Auto,
}

impl Integrator {
    /// Their names.
    pub const NAMES: [(&'static str, Integrator); 4] = [
        ("path", Integrator::Path),
        ("caustics", Integrator::Caustics),
        ("bidirectional", Integrator::Bidirectional),
        ("auto", Integrator::Auto),
    ];

    /// By its name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }
}

/// Camera paths that share a pair of photon maps, if that makes a number of samples between 2 and 256: enough that tracing photons takes less time than
/// paths do, and few enough that a picture of some samples sees many maps.
const MAP_PATHS: usize = 1 << 19;

/// Photons for each camera path.
const PHOTONS_A_PATH: f64 = 0.1;

/// Least and most photons that are emitted for a map. Landed photons take 52 bytes each.
const PHOTONS: (u32, u32) = (1 << 15, 1 << 19);

/// Light paths of a pool for each camera path, and least and most of them. A scattering event takes 200 bytes, a vertex 112.
const LIGHT_PATHS_A_PATH: f64 = 0.05;
const LIGHT_PATHS: (u32, u32) = (1 << 14, 1 << 17);

/// Samples of a pixel for which a pair of photon maps serves: a power of two that depends on the number of pixels alone.
pub(super) fn map_samples(pixels: usize) -> u32 {
    1u32 << (MAP_PATHS.div_ceil(pixels.max(1))).max(1).next_power_of_two().ilog2().clamp(1, 8)
}

/// Photons, blocks of the film a side, samples of a block a side and in all, of the trial of `auto`: some tens of milliseconds.
const TRIAL_PHOTONS: u32 = 1 << 14;
const TRIAL_BLOCKS: usize = 8;
const TRIAL_SIDE: usize = 12;
const TRIAL_SAMPLES: usize = TRIAL_SIDE * TRIAL_SIDE;
/// Its numbers are not those of the samples.
const TRIAL_SEED: u64 = 0xbb67_ae85_84ca_a73b;
/// Caustics show where they are so much of all light, or of the light of some block that is not darker than a tenth of the mean.
const LEAST_SHARE: f64 = 0.05;
const LEAST_SHARE_OF_BLOCK: f64 = 0.3;

/// Whether caustics matter by all light and that of the photons, for each block.
fn shows(blocks: &[[f64; 2]]) -> bool {
    let [all, photons] = [0, 1].map(|k| blocks.iter().map(|b| b[k]).sum::<f64>());
    let dark = 0.1 * all / blocks.len() as f64;
    photons > LEAST_SHARE * all || blocks.iter().any(|b| b[0] > dark && b[1] > LEAST_SHARE_OF_BLOCK * b[0])
}

impl Exposure<'_> {
    /// What makes the photons, where the integrator and the scene ask for them.
    pub(super) fn caustics(&self) -> Option<Caustics<'_>> {
        let lamps = match self.settings.integrator {
            Integrator::Path => return None,
            Integrator::Caustics => Lamps::All,
            Integrator::Bidirectional | Integrator::Auto => Lamps::Small,
        };
        let pixels = self.camera.film.columns * self.camera.film.rows;
        let paths = pixels as f64 * f64::from(map_samples(pixels));
        let photons = ((paths * PHOTONS_A_PATH) as u32).clamp(PHOTONS.0, PHOTONS.1);
        let settings = CausticSettings {
            lamps,
            seed: self.settings.seed,
            max_depth: self.settings.path.max_depth,
            photons,
            rgb: self.settings.rgb,
            span_s: self.shutter.total_s(),
        };
        Caustics::new(self.scene, settings)
    }

    /// What connects camera paths with light paths, where the integrator and the scene ask for it.
    pub(super) fn connections(&self) -> Option<Connections<'_>> {
        if self.settings.integrator != Integrator::Bidirectional {
            return None;
        }
        let pixels = self.camera.film.columns * self.camera.film.rows;
        let camera_paths = pixels as f64 * f64::from(map_samples(pixels));
        let paths = ((camera_paths * LIGHT_PATHS_A_PATH) as u32).clamp(LIGHT_PATHS.0, LIGHT_PATHS.1);
        let (seed, max_depth, rgb) = (self.settings.seed, self.settings.path.max_depth, self.settings.rgb);
        Connections::new(self.scene, ConnectionSettings { seed, max_depth, paths, rgb })
    }

    /// Whether caustics show in the picture, by some paths of few photons: where they do not, photons cost and bring nothing. Depends on seed, scene,
    /// camera and film alone.
    pub(super) fn shows_caustics(&self, unit: &Unit, caustics: &Caustics) -> bool {
        if self.settings.integrator == Integrator::Caustics {
            return true;
        }
        let map = caustics.trial_map(TRIAL_PHOTONS);
        let [columns, rows] = [self.camera.film.columns, self.camera.film.rows];
        let block = |number: usize| {
            let mut sums = [0.0f64; 2];
            for k in 0..TRIAL_SAMPLES {
                let within = |cell: usize, step: usize, pixels: usize| {
                    ((cell * TRIAL_SIDE + step) * pixels / (TRIAL_BLOCKS * TRIAL_SIDE)).min(pixels - 1)
                };
                let column = within(number % TRIAL_BLOCKS, k % TRIAL_SIDE, columns);
                let row = within(number / TRIAL_BLOCKS, k / TRIAL_SIDE, rows);
                let (seed, pixel) = (self.settings.seed ^ TRIAL_SEED, (number as u32, k as u32));
                let sampler = Sampler::new(SamplerKind::Independent, seed, pixel, 0, 1);
                let Some(camera) = unit.camera_ray(column, row, &sampler) else { continue };
                let path = &self.settings.path;
                let both = self.scene.radiance_and_caustics(&map, camera.ray, &camera.wavelengths, &sampler, path);
                for (sum, light) in sums.iter_mut().zip(both) {
                    let light = f64::from((light * camera.wavelengths.weight).element_sum());
                    *sum += if light.is_finite() { light } else { 0.0 };
                }
            }
            sums
        };
        let blocks: Vec<[f64; 2]> = (0..TRIAL_BLOCKS * TRIAL_BLOCKS).into_par_iter().map(block).collect();
        // Without photons the light of lamps without extent would be missing, not noisy.
        let gathered = blocks.iter().any(|b| b[1] > 0.0);
        gathered && (caustics.has_delta_lamps() || shows(&blocks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_serve_a_power_of_two_of_samples() {
        assert_eq!([1, 64 * 64, 256 * 256, 960 * 640, 6000 * 4000].map(map_samples), [256, 128, 8, 2, 2]);
    }

    #[test]
    fn caustics_show_by_their_share_of_all_light_or_of_a_bright_block() {
        let mut blocks = [[1.0, 0.0]; 64];
        assert!(!shows(&blocks));
        blocks[3][1] = 0.29;
        assert!(!shows(&blocks));
        blocks[3][1] = 0.31;
        assert!(shows(&blocks));
        // A block in the dark does not count, an even veil does.
        blocks[3] = [0.05, 0.05];
        assert!(!shows(&blocks));
        assert!(shows(&[[1.0, 0.051]; 64]) && !shows(&[[0.0; 2]; 64]));
    }

    #[test]
    fn integrators_are_found_by_their_names() {
        assert!(Integrator::NAMES.iter().all(|(name, i)| Integrator::by_name(name) == Some(*i) && i.name() == *name));
        assert_eq!(Integrator::by_name("metropolis"), None);
    }
}

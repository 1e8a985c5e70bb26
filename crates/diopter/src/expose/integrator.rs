//! Which integrator computes an exposure, and how often caustics get new photons.

use super::pixel_groups::GROUP;
use super::settings::Integrator;
use super::unit::Unit;
use super::{Exposure, trial};
use diopter_scene::Scene;
use diopter_scene::light_paths::{CameraRays, CausticSettings, Caustics, ConnectionSettings, Connections, Lamps};

/// Camera paths that share a pair of photon maps, if that makes a number of samples between 2 and 256: enough that tracing photons takes less time than
/// paths do, and few enough that a picture of some samples sees many maps.
const MAP_PATHS: usize = 1 << 19;

/// Photons for each camera path.
const PHOTONS_A_PATH: f64 = 0.1;

/// Least and most photons that are emitted for a map. Landed photons take 52 bytes each.
const PHOTONS: (u32, u32) = (1 << 15, 1 << 19);

/// Light paths of a pool for each camera path, and least and most of them. A scattering event takes 200 bytes, a vertex 112.
const LIGHT_PATHS_A_PATH: f64 = 0.05;
const LIGHT_PATHS: (u32, u32) = (1 << 12, 1 << 17);

/// Camera paths that may be followed to learn where the sun matters, as a fraction of those of the exposure.
const LEARNT_FROM: f64 = 0.06;

/// Camera paths of an exposure below which `auto` does not ask whether connections pay: asking takes as long as some ten thousand paths.
const LEAST_FOR_TRIAL: f64 = 32_768.0;

/// Samples of a pixel for which a pair of photon maps serves: a power of two that depends on the number of pixels alone.
pub(super) fn map_samples(pixels: usize) -> u32 {
    1u32 << (MAP_PATHS.div_ceil(pixels.max(1))).max(1).next_power_of_two().ilog2().clamp(1, 8)
}

/// Of which lamps photons are made where the scene asks for them.
fn lamps_of_photons(integrator: Integrator) -> Option<Lamps> {
    match integrator {
        Integrator::Path | Integrator::PathReuse => None,
        Integrator::Caustics => Some(Lamps::All),
        Integrator::Bidirectional | Integrator::Auto => Some(Lamps::Small),
    }
}

/// Whether photons may be made for an exposure of a scene.
pub(crate) fn may_make_photons(scene: &Scene, integrator: Integrator) -> bool {
    lamps_of_photons(integrator)
        .is_some_and(|lamps| Caustics::may_exist(scene, &CausticSettings { lamps, ..CausticSettings::default() }))
}

impl Exposure<'_> {
    /// What makes the photons, where the integrator and the scene ask for them.
    pub(super) fn caustics(&self) -> Option<Caustics<'_>> {
        // Photons and light paths know nothing of polarisation.
        let lamps = lamps_of_photons(self.settings.integrator).filter(|_| !self.is_polarized())?;
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

    /// Whether it has so many paths that `auto` may follow some to learn what helps.
    pub(super) fn has_paths_for_trial(&self) -> bool {
        let pixels = self.camera.film.columns * self.camera.film.rows;
        pixels as f64 * f64::from(self.settings.spp) >= LEAST_FOR_TRIAL
    }

    /// Whether pixels may lend one another light.
    pub(super) fn may_reuse(&self) -> bool {
        let film = &self.camera.film;
        matches!(self.settings.integrator, Integrator::Auto | Integrator::PathReuse)
            && !self.settings.means_only
            && film.columns * film.rows >= GROUP
            && !self.is_polarized()
            && self.camera.motion.moving().is_none()
            && self.scene.lets_paths_be_reused()
    }

    /// What connects camera paths with light paths, where the integrator and the scene ask for it.
    pub(super) fn connections(&self, unit: &Unit) -> Option<Connections<'_>> {
        if self.is_polarized() || !matches!(self.settings.integrator, Integrator::Bidirectional | Integrator::Auto) {
            return None;
        }
        let pixels = self.camera.film.columns * self.camera.film.rows;
        if self.settings.integrator == Integrator::Auto && (self.settings.means_only || !self.has_paths_for_trial()) {
            return None;
        }
        let camera_paths = pixels as f64 * f64::from(map_samples(pixels).min(self.settings.spp));
        let paths = ((camera_paths * LIGHT_PATHS_A_PATH) as u32).clamp(LIGHT_PATHS.0, LIGHT_PATHS.1);
        let (seed, max_depth, rgb) = (self.settings.seed, self.settings.path.max_depth, self.settings.rgb);
        let settings = ConnectionSettings { seed, max_depth, paths, rgb };
        let most = (pixels as f64 * f64::from(self.settings.spp) * LEARNT_FROM) as u32;
        Connections::new(self.scene, settings, &CameraRays { ray: &|number| trial::spread_ray(self, unit, number), most })
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
    fn integrators_are_found_by_their_names() {
        assert!(Integrator::NAMES.iter().all(|(name, i)| Integrator::by_name(name) == Some(*i) && i.name() == *name));
        assert_eq!(Integrator::by_name("metropolis"), None);
    }
}

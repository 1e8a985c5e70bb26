//! The path tracer: camera rays in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. In media (`radiance/media.rs`) distances are drawn by extinction and as lamps see the ray, directions by the phase
//! function; media that differ from place to place are tracked (`medium/tracking.rs`). Light that is sampled comes through smooth thin dielectrics (panes, bubbles). Caustics
//! of small lights are left to chance without photons ([`crate::light_paths`]). Limits: a path begins outside all bodies.
//!
//! Entries are here, what they record in `radiance/record.rs`, the steps of a path in `radiance/path.rs`, what paths of several pixels lend one another in `radiance/reuse.rs`, what they
//! do at clear glass in `radiance/splitting.rs` and `radiance/through_glass.rs`.

mod cone;
mod donor;
mod first_surface;
mod incident;
mod joint;
mod light_connection;
mod media;
mod medium_between;
mod medium_segment;
mod medium_steps;
mod mirrored;
mod next_event;
mod path;
mod prev_scatter;
mod receiver;
pub mod record;
mod reuse;
mod reuse_extent;
mod reuse_lamps;
mod reuse_sky;
mod splitting;
pub(crate) mod tally;
mod through_glass;
mod to_light;
mod weights;
mod work;

pub use cone::RayCone;
pub use first_surface::FirstSurface;
pub use incident::Incident;

use crate::light::EmitterMis;
use crate::light_paths::LightPaths;
use crate::medium_stack::Immersion;
use crate::russian_roulette::RouletteRates;
use crate::scene::Scene;
use diopter_light::random::Sampler;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use path::Transport;
use record::Record;
pub(crate) use tally::DIRECT_EVENTS;
pub(crate) use to_light::{MAX_INTERFACES, origin_behind, stream_along};

/// How far paths are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSettings {
    /// Most scattering events of a path; 0 shows only what shines by itself.
    pub max_depth: u32,
    /// Scattering events before Russian roulette starts; where vertices are connected with light paths, two at most.
    pub roulette_depth: u32,
}

impl Default for PathSettings {
    /// 64 events (glass needs many, and roulette ends the rest), roulette from the fifth
    /// (on the Cornell box 5 has the least variance × time among 3, 5 and never).
    fn default() -> Self {
        PathSettings { max_depth: 64, roulette_depth: 5 }
    }
}

/// What a path begins with at the camera.
#[derive(Clone, Copy)]
pub struct CameraPath<'a> {
    /// Its ray, and how wide it is: pictures on surfaces are filtered over it, and the mean is the true value where that is smaller than a pixel of the picture.
    pub cone: RayCone,
    /// What it carries.
    pub wavelengths: SampledWavelengths,
    /// Its numbers.
    pub sampler: Sampler,
    /// Photon maps for caustics (in place of what paths would find by chance), and light vertices for connections.
    pub light_paths: LightPaths<'a>,
    /// Weight of this path for emitters that are seen directly, where light tracing finds them, too.
    pub emitter_mis: Option<EmitterMis<'a>>,
    /// What the camera stands in.
    pub immersion: Immersion,
    /// How many paths are worth following on where some are not; all without. Not of paths that reuse light.
    pub roulette: Option<&'a RouletteRates>,
}

impl CameraPath<'_> {
    /// A ray without width, and nothing that helps it.
    pub fn new(ray: Ray, wavelengths: SampledWavelengths, sampler: Sampler) -> Self {
        CameraPath {
            cone: RayCone::thin(ray),
            wavelengths,
            sampler,
            light_paths: LightPaths::default(),
            emitter_mis: None,
            immersion: Immersion::NONE,
            roulette: None,
        }
    }
}

impl Scene {
    /// Spectral radiance that arrives at the ray's origin from its direction, W·m⁻²·sr⁻¹·nm⁻¹ at the four wavelengths; one
    /// random estimate, whose mean is the true value.
    pub fn radiance(
        &self,
        ray: Ray,
        wavelengths: &SampledWavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> SampledSpectrum {
        self.radiance_along(&CameraPath::new(ray, *wavelengths, *sampler), settings)
    }

    /// The radiance along a camera path, with its width, its light paths and its weights of emitters: one random estimate as [`Scene::radiance`].
    pub fn radiance_along(&self, path: &CameraPath, settings: &PathSettings) -> SampledSpectrum {
        Transport { scene: self, settings }.follow(path, SampledSpectrum::ZERO)
    }

    /// What `record` records of the light of many camera paths, in their order: the one entry of whoever traces pictures. With [`Radiance`](record::Radiance) the numbers of
    /// [`Scene::radiance_along`].
    pub fn trace<R: Record>(&self, paths: &[CameraPath], record: R, settings: &PathSettings) -> Vec<R::Light> {
        record.trace(self, paths, settings)
    }

    /// The same of two groups of camera paths, each of the same wavelengths, that reuse the light that others of their group found: means are those of [`Scene::trace`], errors are
    /// smaller, and correlated within a group. The light of either group says how far that of the other is worth lending; where one is empty all is lent. Paths are traced alone where they may not share
    /// light: where [`CameraPath::light_paths`] are given or wavelengths differ; whether the scene allows it ([`Scene::lets_paths_be_reused`]) is for whoever asks.
    pub fn trace_groups<R: Record>(&self, groups: [&[CameraPath]; 2], record: R, settings: &PathSettings) -> Vec<R::Light> {
        record.trace_groups(self, groups, settings)
    }
}

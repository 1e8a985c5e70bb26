//! The path tracer: camera rays in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. In media (`radiance/media.rs`) distances are drawn by extinction and as lamps see the ray, directions by the phase
//! function; media that differ from place to place are tracked (`medium/tracking.rs`). Light that is sampled comes through smooth thin dielectrics (panes, bubbles). Caustics
//! of small lights are left to chance without photons ([`crate::light_paths`]). Limits: a path begins outside all bodies.
//!
//! Entries are here, the steps of a path in `radiance/path.rs`, what paths of several pixels lend one another in `radiance/reuse.rs`.

mod cone;
mod first_surface;
mod incident;
mod joint;
mod light_connection;
mod media;
mod medium_segment;
mod next_event;
mod path;
mod prev_scatter;
mod reuse;
pub(crate) mod tally;
mod to_light;
mod weights;

pub use cone::RayCone;
pub use first_surface::FirstSurface;
pub use incident::Incident;

use crate::light::EmitterMis;
use crate::light_paths::LightPaths;
use crate::scene::Scene;
use diopter_light::polarization::Stokes;
use diopter_light::random::Sampler;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use path::Transport;
pub(crate) use tally::DIRECT_EVENTS;
use tally::{CausticTally, DirectTally, Polarized, Tally};
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
}

impl CameraPath<'_> {
    /// A ray without width, and nothing that helps it.
    pub fn new(ray: Ray, wavelengths: SampledWavelengths, sampler: Sampler) -> Self {
        CameraPath { cone: RayCone::thin(ray), wavelengths, sampler, light_paths: LightPaths::default(), emitter_mis: None }
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

    /// The same along a camera path.
    pub fn radiance_along(&self, path: &CameraPath, settings: &PathSettings) -> SampledSpectrum {
        Transport { scene: self, settings }.follow(path, SampledSpectrum::ZERO)
    }

    /// The same of many camera paths, in their order.
    pub fn radiance_of(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<SampledSpectrum> {
        self.follow_all(paths, settings, |_| SampledSpectrum::ZERO)
    }

    /// The Stokes vectors of the same light at each of the four wavelengths ([`diopter_light::polarization`]), all of it by the paths: without light paths and
    /// [`CameraPath::emitter_mis`]. `axes`: the x axis of the frame of each path, perpendicular to its ray. Q, U and V are 0 on the mean where nothing polarises. I is, sample by
    /// sample, [`Scene::radiance_of`] where no two events of the path polarise; elsewhere it is what polarised light gives, and that is another number.
    ///
    /// Panics where there are fewer axes than paths.
    pub fn stokes_of(&self, paths: &[CameraPath], axes: &[Vec3], settings: &PathSettings) -> Vec<[Stokes; 4]> {
        let alone = |path: &CameraPath| CameraPath { light_paths: LightPaths::default(), emitter_mis: None, ..*path };
        let paths: Vec<CameraPath> = paths.iter().map(alone).collect();
        let tallies = self.follow_all(&paths, settings, |number| Polarized::seen_along(axes[number]));
        tallies.into_iter().map(|tally| tally.stokes).collect()
    }

    /// The numbers of [`Scene::radiance_of`], and what of them is direct light: emitted towards the camera, or scattered once on its way, by surface or medium. What goes
    /// through a thin dielectric or off a mirror is scattered there. Direct light is, bit by bit (within rounding where volumes shine), the radiance with a `max_depth` of 1.
    pub fn radiance_and_direct_of(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let tallies = self.follow_all(paths, settings, |_| DirectTally::default());
        tallies.into_iter().map(|DirectTally { all, direct }| [all, direct]).collect()
    }

    /// The same numbers, and what of them came from photons: by how much they matter in a picture.
    pub fn radiance_and_caustics_of(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let tallies = self.follow_all(paths, settings, |_| CausticTally::default());
        tallies.into_iter().map(|CausticTally { all, gathered }| [all, gathered]).collect()
    }

    /// The same numbers of a group of camera paths of the same wavelengths that lend one another what light they found, in their order: means are those of [`Scene::radiance_of`], errors are
    /// smaller, and correlated within the group. Paths are followed alone where they may not lend: where [`CameraPath::light_paths`] are given or wavelengths differ; whether the scene allows it
    /// ([`Scene::lets_paths_be_reused`]) is for whoever asks.
    pub fn radiance_of_group(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<SampledSpectrum> {
        Transport { scene: self, settings }.follow_group(paths, || SampledSpectrum::ZERO)
    }

    /// The numbers of [`Scene::radiance_and_direct_of`], of a group as [`Scene::radiance_of_group`] takes it: direct light is that of each path alone.
    pub fn radiance_and_direct_of_group(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let tallies = Transport { scene: self, settings }.follow_group(paths, DirectTally::default);
        tallies.into_iter().map(|DirectTally { all, direct }| [all, direct]).collect()
    }

    fn follow_all<'a, T: Tally>(
        &'a self,
        paths: &'a [CameraPath<'a>],
        settings: &'a PathSettings,
        tally: impl Fn(usize) -> T,
    ) -> Vec<T> {
        let transport = Transport { scene: self, settings };
        paths.iter().enumerate().map(|(number, path)| transport.follow(path, tally(number))).collect()
    }
}

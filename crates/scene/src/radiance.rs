//! The path tracer: camera rays in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. In media (`radiance/media.rs`) distances are drawn by extinction and as lamps see the ray, directions by the phase
//! function; media that differ from place to place are tracked (`medium/tracking.rs`). Light that is sampled comes through smooth thin dielectrics (panes, bubbles). Caustics
//! of small lights are left to chance without photons ([`crate::light_paths`]). Limits: a path begins outside all bodies.
//!
//! Entries are here, the steps of a path in `radiance/path.rs`.

mod cone;
mod first_surface;
mod incident;
mod joint;
mod media;
mod medium_segment;
mod path;
mod prev_scatter;
pub(crate) mod tally;
mod to_light;
mod weights;

pub use cone::RayCone;
pub use first_surface::FirstSurface;
pub use incident::Incident;

use crate::light::Shown;
use crate::light_paths::LightPaths;
use crate::scene::Scene;
use diopter_light::polarization::Stokes;
use diopter_light::random::Sampler;
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::Vec3;
use path::Transport;
pub(crate) use tally::DIRECT_EVENTS;
use tally::{Apart, Gathered, Polarized, Tally};
pub(crate) use to_light::{MOST_FACES, origin_behind, stream_along};

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
    pub wavelengths: Wavelengths,
    /// Its numbers.
    pub sampler: Sampler,
    /// Caustics by photons, which stand for what paths would find by chance there, and light vertices, which share what paths find with them.
    pub light_paths: LightPaths<'a>,
    /// Where another strategy brings a part of the light of surfaces that shine and are seen directly.
    pub shown: Option<Shown<'a>>,
}

impl CameraPath<'_> {
    /// A ray without width, and nothing that helps it.
    pub fn new(ray: Ray, wavelengths: Wavelengths, sampler: Sampler) -> Self {
        CameraPath { cone: RayCone::thin(ray), wavelengths, sampler, light_paths: LightPaths::default(), shown: None }
    }
}

impl Scene {
    /// Spectral radiance that arrives at the ray's origin from its direction, W·m⁻²·sr⁻¹·nm⁻¹ at the four wavelengths; one
    /// random estimate, whose mean is the true value.
    pub fn radiance(&self, ray: Ray, wavelengths: &Wavelengths, sampler: &Sampler, settings: &PathSettings) -> Sampled {
        self.radiance_along(&CameraPath::new(ray, *wavelengths, *sampler), settings)
    }

    /// The same along a camera path.
    pub fn radiance_along(&self, path: &CameraPath, settings: &PathSettings) -> Sampled {
        self.follow(path, settings, Sampled::ZERO)
    }

    /// The same of many camera paths, which are on their way together, in their order. Each is what it would be alone, bit by bit.
    pub fn radiance_of(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<Sampled> {
        self.follow_all(paths, settings, |light: Sampled| light)
    }

    /// The Stokes vector of the same light at each of the four wavelengths ([`diopter_light::polarization`]), all of it by the path: without light paths and [`CameraPath::shown`]. `axis` is the x axis of
    /// its frame, perpendicular to the ray. Q, U and V are 0 on the mean where nothing polarises. I is, sample by sample, [`Scene::radiance_along`] where
    /// no two events of the path polarise; elsewhere it is what polarised light gives, and that is another number.
    pub fn stokes(&self, path: &CameraPath, axis: Vec3, settings: &PathSettings) -> [Stokes; 4] {
        let alone = CameraPath { light_paths: LightPaths::default(), shown: None, ..*path };
        self.follow(&alone, settings, Polarized::seen_along(axis)).stokes
    }

    /// The same numbers, and what of them is direct light: emitted towards the camera, or scattered once on its way, by surface or medium. What goes through
    /// a thin dielectric or off a mirror is scattered there. Direct light is, bit by bit (within rounding where volumes shine),
    /// what [`Scene::radiance_along`] gives with a `max_depth` of 1.
    pub fn radiance_and_direct(&self, path: &CameraPath, settings: &PathSettings) -> [Sampled; 2] {
        let Apart { all, direct } = self.follow(path, settings, Apart::default());
        [all, direct]
    }

    /// The same numbers, and what of them came from photons: by how much they matter in a picture.
    pub fn radiance_and_caustics(&self, path: &CameraPath, settings: &PathSettings) -> [Sampled; 2] {
        let Gathered { all, gathered } = self.follow(path, settings, Gathered::default());
        [all, gathered]
    }

    /// [`Scene::radiance_and_direct`] of many camera paths.
    pub fn radiance_and_direct_of(&self, paths: &[CameraPath], settings: &PathSettings) -> Vec<[Sampled; 2]> {
        self.follow_all(paths, settings, |Apart { all, direct }| [all, direct])
    }

    /// Follows a path to its end.
    fn follow<T: Tally>(&self, path: &CameraPath, settings: &PathSettings, tally: T) -> T {
        Transport { scene: self, settings }.follow(path, tally)
    }

    /// Follows many paths, all of them a step at a time.
    fn follow_all<T: Tally + Default, R>(
        &self,
        paths: &[CameraPath],
        settings: &PathSettings,
        result: impl Fn(T) -> R,
    ) -> Vec<R> {
        Transport { scene: self, settings }.follow_all(paths).into_iter().map(result).collect()
    }
}

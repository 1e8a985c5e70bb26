//! What is recorded of the light of paths ([`Scene::trace`]).

use super::path::Transport;
use super::tally::{DirectTally, Polarized, TrialTally};
pub use super::work::Work;
use super::{CameraPath, PathSettings};
use crate::light_paths::LightPaths;
use crate::russian_roulette::RouletteRates;
use crate::scene::Scene;
use diopter_light::SampledSpectrum;
use diopter_light::polarization::Stokes;
use glam::Vec3;

/// What is recorded of the light along a camera path, at its four wavelengths, W·m⁻²·sr⁻¹·nm⁻¹.
pub trait Record: Copy {
    /// What is known of one path.
    type Light;

    /// Traces paths, each alone, in their order. Called by [`Scene::trace`].
    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<Self::Light>;

    /// Traces two groups of paths that may reuse the light of their own group. Called by [`Scene::trace_groups`]; what cannot be shared out is traced path by path.
    fn trace_groups(self, scene: &Scene, groups: [&[CameraPath]; 2], settings: &PathSettings) -> Vec<Self::Light> {
        groups.into_iter().flat_map(|paths| self.trace(scene, paths, settings)).collect()
    }
}

/// All light.
#[derive(Clone, Copy, Debug)]
pub struct Radiance;

/// All light, and what of it is direct light: emitted towards the camera, or scattered once on its way, by surface or medium. What goes through a thin dielectric or off a
/// mirror is scattered there. Direct light is, bit by bit (within rounding where volumes shine), the radiance with a `max_depth` of 1.
#[derive(Clone, Copy, Debug)]
pub struct RadianceAndDirect;

/// All light, and what of it came from photons: by how much they matter in a picture.
#[derive(Clone, Copy, Debug)]
pub struct RadianceAndCaustics;

/// All light, and how much work it was. The work of paths that reuse light is that of the first of them.
#[derive(Clone, Copy, Debug)]
pub struct RadianceAndWork;

/// Light by how often it was scattered, in the stages of [`RouletteRates::EVENTS`] (at most so many events, and more than those before; last, all that is left), and
/// the scattering events of the path itself.
#[derive(Clone, Copy, Debug)]
pub struct RadianceByEvents;

/// The Stokes vectors of all light at each of the four wavelengths ([`diopter_light::polarization`]), all of it by the paths: without light paths and
/// [`CameraPath::emitter_mis`]. Q, U and V are 0 on the mean where nothing polarises. I is, sample by sample, [`Radiance`] where no two events of the path polarise; elsewhere it
/// is what polarised light gives, and that is another number.
#[derive(Clone, Copy, Debug)]
pub struct StokesVectors<'a> {
    /// The x axis of the frame of each path, a unit vector perpendicular to its ray. Paths without one are not traced.
    pub axes: &'a [Vec3],
}

impl Record for Radiance {
    type Light = SampledSpectrum;

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<SampledSpectrum> {
        let transport = Transport { scene, settings };
        paths.iter().map(|path| transport.follow(path, SampledSpectrum::ZERO)).collect()
    }

    fn trace_groups(self, scene: &Scene, groups: [&[CameraPath]; 2], settings: &PathSettings) -> Vec<SampledSpectrum> {
        Transport { scene, settings }.follow_groups(groups, || SampledSpectrum::ZERO).0
    }
}

impl Record for RadianceAndDirect {
    type Light = [SampledSpectrum; 2];

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let transport = Transport { scene, settings };
        paths.iter().map(|path| transport.follow(path, DirectTally::default()).both()).collect()
    }

    fn trace_groups(self, scene: &Scene, groups: [&[CameraPath]; 2], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let (tallies, _) = Transport { scene, settings }.follow_groups(groups, DirectTally::default);
        tallies.into_iter().map(DirectTally::both).collect()
    }
}

impl Record for RadianceAndCaustics {
    type Light = [SampledSpectrum; 2];

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<[SampledSpectrum; 2]> {
        let transport = Transport { scene, settings };
        let both = |TrialTally { by_events, gathered }| [by_events.into_iter().sum(), gathered];
        paths.iter().map(|path| both(transport.follow(path, TrialTally::default()))).collect()
    }
}

impl Record for RadianceByEvents {
    type Light = ([SampledSpectrum; RouletteRates::EVENTS.len() + 1], u32);

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<Self::Light> {
        let transport = Transport { scene, settings };
        let of = |camera| {
            let mut path = transport.begin(camera, TrialTally::default());
            transport.follow_to_end(&mut path);
            let events = path.depth();
            (path.tally.by_events, events)
        };
        paths.iter().map(of).collect()
    }
}

impl Record for RadianceAndWork {
    type Light = (SampledSpectrum, Work);

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<(SampledSpectrum, Work)> {
        let transport = Transport { scene, settings };
        let both = |camera| {
            let mut path = transport.begin(camera, SampledSpectrum::ZERO);
            transport.follow_to_end(&mut path);
            (path.tally, Work { segments: path.segment_index, reuse_rays: 0 })
        };
        paths.iter().map(both).collect()
    }

    fn trace_groups(self, scene: &Scene, groups: [&[CameraPath]; 2], settings: &PathSettings) -> Vec<(SampledSpectrum, Work)> {
        let (lights, mut work) = Transport { scene, settings }.follow_groups(groups, || SampledSpectrum::ZERO);
        lights.into_iter().map(|light| (light, std::mem::take(&mut work))).collect()
    }
}

impl Record for StokesVectors<'_> {
    type Light = [Stokes; 4];

    fn trace(self, scene: &Scene, paths: &[CameraPath], settings: &PathSettings) -> Vec<[Stokes; 4]> {
        let transport = Transport { scene, settings };
        let stokes = |(path, axis): (&CameraPath, &Vec3)| {
            let alone = CameraPath { light_paths: LightPaths::default(), emitter_mis: None, ..*path };
            transport.follow(&alone, Polarized::seen_along(*axis)).stokes
        };
        paths.iter().zip(self.axes).map(stokes).collect()
    }
}

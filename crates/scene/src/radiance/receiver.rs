//! Where the paths of a group receive light that others found.

use crate::material::Bsdf;
use crate::scene::Scene;
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;

/// Where a path of the group receives light: its first surface that is no mirror. Small, for each is asked by each donor.
pub(super) struct Receiver {
    pub path: usize,
    pub point: Vec3,
    /// Where shadow rays start.
    pub origin: Vec3,
    /// Geometric and shading normal on the side that is seen.
    pub ng: Vec3,
    pub ns: Vec3,
    /// Of the path up to there.
    pub throughput: SampledSpectrum,
    /// Where all it does is to reflect diffusely.
    pub albedo: Option<SampledSpectrum>,
    pub depth: u32,
    pub time_s: f32,
    /// Whether a flash was burning.
    pub flash: bool,
    /// Probability with which a light sample goes to the environment.
    pub sky_probability: f32,
    /// Light that its path found up to here but for that of the environment, mean over the wavelengths.
    pub direct: f32,
    /// What light at the next surface is multiplied by on its way to the film, mean over the wavelengths.
    pub onward: f32,
}

impl Receiver {
    /// f cos θ of a direction on the side that is seen, and its density.
    #[inline]
    pub fn eval(&self, bsdf: &Bsdf, wi: Vec3) -> (SampledSpectrum, f32) {
        match self.albedo {
            Some(albedo) => {
                let density = self.ns.dot(wi).max(0.0) * std::f32::consts::FRAC_1_PI;
                (albedo * density, density)
            }
            None => bsdf.eval(wi),
        }
    }

    /// A shadow ray to a point, and how far that is, m.
    #[inline(always)]
    pub fn ray_to(&self, end: Vec3) -> (Ray, f32) {
        let to_end = end - self.origin;
        let distance = to_end.length();
        (Ray { origin: self.origin, direction: to_end / distance, time_s: self.time_s }, distance)
    }

    /// Whether something stands, or may stand, between it and a point.
    #[inline(always)]
    pub fn may_not_see(&self, scene: &Scene, end: Vec3) -> bool {
        let (ray, distance) = self.ray_to(end);
        scene.may_be_occluded(&ray, distance)
    }

    /// A shadow ray towards what is infinitely far.
    #[inline]
    pub fn ray_towards(&self, wi: Vec3) -> (Ray, f32) {
        (Ray { origin: self.origin, direction: wi, time_s: self.time_s }, f32::INFINITY)
    }
}

/// The receivers of a group, in the order of their paths, and their scattering functions.
pub(super) struct Receivers<'a> {
    pub all: Vec<Receiver>,
    pub bsdfs: Vec<Bsdf<'a>>,
}

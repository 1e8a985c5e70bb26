//! Where the paths of a group receive light that others found.

use crate::bvh::packet::Bundle;
use crate::material::Bsdf;
use crate::medium::phase;
use crate::medium_stack::MediumId;
use crate::scene::Scene;
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;
use std::ops::Range;

/// Where a path of the group receives light: its first surface that is no mirror. Small, for each is asked by each donor.
pub(super) struct Receiver {
    pub path: usize,
    pub point: Vec3,
    /// Where shadow rays start.
    pub origin: Vec3,
    /// Geometric and shading normal on the side that is seen; 0 in a medium.
    pub ng: Vec3,
    pub ns: Vec3,
    /// Of the path up to there.
    pub throughput: SampledSpectrum,
    pub lobe: Lobe,
    /// What it is in, or what is before it.
    pub medium: MediumId,
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

/// How a receiver scatters.
#[derive(Clone, Copy)]
pub(super) enum Lobe {
    /// All it does is to reflect diffusely, with an albedo.
    Diffuse(SampledSpectrum),
    /// By its own scattering function: its number among those of the group. Most receivers are diffuse, and need not look there.
    Bsdf(usize),
    /// A medium scatters light into the direction along which its path came.
    Phase { along: Vec3, asymmetry: f32 },
}

impl Receiver {
    /// Whether light from a direction comes to the side that is seen.
    #[inline]
    pub fn faces(&self, wi: Vec3) -> bool {
        self.ng == Vec3::ZERO || wi.dot(self.ng) > 0.0
    }

    /// The way to a point of a surface, by its unit normal, or of a medium, where that is 0; `None` where receiver and surface do not face one another.
    #[inline]
    pub fn way_to(&self, point: Vec3, normal: Vec3) -> Option<Way> {
        let to_point = point - self.point;
        let squared = to_point.length_squared();
        let distance = squared.sqrt();
        let wi = to_point / distance;
        let facing = if normal == Vec3::ZERO { 1.0 } else { -wi.dot(normal) };
        (facing > 0.0 && self.faces(wi)).then(|| Way { wi, distance, geometry: facing / squared })
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

/// From a receiver to a point of a surface.
pub(super) struct Way {
    /// Unit direction.
    pub wi: Vec3,
    /// How far it is, m.
    pub distance: f32,
    /// Solid angle of an area there, 1/m²; in a medium, of one that faces the receiver.
    pub geometry: f32,
}

/// Which receivers see what one path of the group found; its memory serves for all finds.
#[derive(Default)]
pub(super) struct Sight {
    seeing: Vec<usize>,
    shadow_rays: Vec<(Ray, f32)>,
    hidden: Vec<bool>,
    /// Shadow rays so far.
    pub cast: u32,
}

impl Sight {
    /// Numbers of those from `among` that `faces` holds of and whose shadow rays, all with the end or the direction of `bundle`, meet nothing that stands in them, or may. The receiver of the path that
    /// found it sees it.
    #[inline]
    pub fn of(
        &mut self,
        scene: &Scene,
        receivers: &[Receiver],
        among: Range<usize>,
        finder: usize,
        bundle: Bundle,
        faces: impl Fn(&Receiver) -> bool,
    ) -> &[usize] {
        self.seeing.clear();
        self.shadow_rays.clear();
        self.shadow_rays.reserve(among.len());
        for number in among {
            let receiver = &receivers[number];
            if !faces(receiver) {
                continue;
            }
            self.seeing.push(number);
            // A ray is made where it is to lie: one that waits on the stack for its place is read in other pieces than it was written in, which took a third of all this.
            if receiver.path != finder {
                self.shadow_rays.push(match bundle {
                    Bundle::Towards(end) => receiver.ray_to(end),
                    Bundle::Along(wi) => receiver.ray_towards(wi),
                });
            }
        }
        self.cast += self.shadow_rays.len() as u32;
        scene.may_be_occluded_many(&self.shadow_rays, bundle, &mut self.hidden);
        let mut hidden = self.hidden.iter();
        self.seeing.retain(|number| receivers[*number].path == finder || hidden.next() == Some(&false));
        &self.seeing
    }
}

/// The receivers of a group, in the order of their paths, and the scattering functions of those that do more than to reflect diffusely.
pub(super) struct Receivers<'a> {
    pub all: Vec<Receiver>,
    bsdfs: Vec<Bsdf<'a>>,
}

impl<'a> Receivers<'a> {
    /// None yet, of so many paths.
    pub fn of(paths: usize) -> Self {
        Receivers { all: Vec::with_capacity(paths), bsdfs: Vec::new() }
    }

    /// How a surface scatters that becomes a receiver.
    pub fn lobe(&mut self, bsdf: &Bsdf<'a>) -> Lobe {
        bsdf.diffuse_albedo().map_or_else(
            || {
                self.bsdfs.push(bsdf.clone());
                Lobe::Bsdf(self.bsdfs.len() - 1)
            },
            Lobe::Diffuse,
        )
    }

    /// f cos θ of a direction on the side of a receiver that is seen, and its density; in a medium the phase function.
    #[inline]
    pub fn eval(&self, receiver: &Receiver, wi: Vec3) -> (SampledSpectrum, f32) {
        match receiver.lobe {
            Lobe::Diffuse(albedo) => {
                let density = receiver.ns.dot(wi).max(0.0) * std::f32::consts::FRAC_1_PI;
                (albedo * density, density)
            }
            Lobe::Bsdf(number) => self.bsdfs[number].eval(wi),
            Lobe::Phase { along, asymmetry } => {
                let density = phase(along.dot(wi), asymmetry);
                (SampledSpectrum::splat(density), density)
            }
        }
    }
}

//! The last place from which lights could have been sampled: what a chance hit of a light is weighted by.

use crate::medium::Medium;
use crate::medium_stack::MediumId;
use crate::scene::Scene;
use diopter_light::Ray;
use glam::Vec3;

/// The last place from which lights could have been sampled.
#[derive(Clone, Copy)]
pub(super) struct PrevScatter {
    pub point: Vec3,
    /// Normal there; 0 in a medium and of fibres.
    pub normal: Vec3,
    /// Density of the direction that was taken instead, 1/sr.
    pub density: f32,
    /// Distance from there to the start of the ray, m.
    pub traveled: f32,
    /// The medium in which lights were sought by joint samples from there ([`super::joint`]).
    pub joint: Option<MediumId>,
}

impl PrevScatter {
    /// Where a segment in a medium begins, if it begins here and lights were sought.
    pub fn start(&self, scene: &Scene, medium: &Medium) -> Option<SegmentStart> {
        let sought = self.joint.and_then(|id| scene.medium(id)).is_some_and(|m| std::ptr::eq(m, medium));
        (self.traveled == 0.0 && sought).then_some(SegmentStart { point: self.point, density: self.density })
    }
}

/// A straight line along which lights were sampled that a path comes to by a bent one.
#[derive(Clone, Copy)]
pub(super) struct LineToLight {
    /// The last place from which lights were sampled, or its image in a mirror.
    pub from: PrevScatter,
    /// From there, or from behind the mirror.
    pub ray: Ray,
    /// Whether it is behind a mirror, over which lamps of a finite size alone are sampled ([`super::mirrored`]).
    pub over_mirror: bool,
}

/// A scattering event with which a segment begins, from which lights were sought.
#[derive(Clone, Copy)]
pub(super) struct SegmentStart {
    pub point: Vec3,
    /// Density of the segment's direction, 1/sr.
    pub density: f32,
}

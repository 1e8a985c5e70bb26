//! Rays against Gaussian splats.

use super::hits::{found_within, in_object};
use super::{Scene, Shape};
use crate::bvh::{Filter, Hit};
use crate::shape::{Detail, Splats, Surface};
use diopter_light::Ray;
use diopter_light::random::{mix, to_unit};
use glam::{Affine3A, Vec2, Vec3, Vec3A};

impl Scene {
    /// A point of a Gaussian splat: its normal faces the ray.
    #[inline(never)]
    pub(super) fn splat_surface(&self, ray: &Ray, hit: &Hit, object: u32, splats: u32) -> Surface {
        let placement = self.placement(object, ray.time_s);
        let set = &self.description.splats[splats as usize];
        let direction = placement.object_from_world.transform_vector3(ray.direction).normalize_or_zero();
        let backward = -ray.direction.normalize_or_zero();
        let normal = Vec3::from(placement.normals * Vec3A::from(set.normal(hit.id))).normalize_or(backward);
        let facing = normal.dot(backward);
        let ng = if facing == 0.0 { backward } else { normal * facing.signum() };
        Surface {
            point: ray.at(hit.t),
            t: hit.t,
            ng,
            ns: ng,
            tangent: Vec3::ZERO,
            handedness: 1.0,
            uv: [Vec2::ZERO; 2],
            color: set.color(hit.id, direction).extend(1.0),
            object,
            triangle: hit.id,
            reach: f32::INFINITY,
            detail: Detail::None,
        }
    }

    /// Follows a ray into an object of Gaussian splats. `t` of the hit means the same as in the world.
    #[inline(never)]
    pub(super) fn intersect_splats(
        &self,
        ray: &Ray,
        object: u32,
        object_from_world: &Affine3A,
        t_max: f32,
        any: bool,
        blends_block: bool,
    ) -> Option<Hit> {
        let Shape::Splats { splats, .. } = self.description.objects[object as usize].shape else { return None };
        let local = in_object(ray, object_from_world);
        let hash = |seed: u32, v: Vec3| v.to_array().iter().fold(seed, |h, x| mix(h ^ x.to_bits()));
        let seed = mix(hash(hash(mix(object), ray.origin), ray.direction) ^ ray.time_s.to_bits());
        let filter = SplatFilter { set: &self.description.splats[splats as usize], seed, local, blends_block };
        found_within(&self.built.clouds[splats as usize], object, local, t_max, any, &filter)
    }
}

/// Meets Gaussian splats, each there or not by a number of its own for each ray ([`crate::shape::splats`]).
struct SplatFilter<'a> {
    set: &'a Splats,
    /// Of ray and object: the same ray always gets the same answer.
    seed: u32,
    /// Origin and direction in the space of the set.
    local: (Vec3, Vec3),
    /// Whether all count that are not entirely clear.
    blends_block: bool,
}

impl Filter for SplatFilter<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        unreachable!("hierarchies of splats hold no triangles")
    }
    fn intersect_other(&self, id: u32, t_max: f32, _: bool) -> Option<Hit> {
        let hit = self.set.intersect(id, self.local.0, self.local.1, t_max)?;
        let draw = if self.blends_block { 0.0 } else { to_unit(mix(self.seed ^ mix(id))) };
        let there = draw < hit.alpha;
        there.then_some(Hit { t: hit.t, u: 0.0, v: 0.0, id, slot: u32::MAX, instance: 0 })
    }
}

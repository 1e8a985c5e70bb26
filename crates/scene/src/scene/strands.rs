//! Rays against curves.

use super::hits::{found_within, in_object};
use super::{Scene, Shape};
use crate::bvh::{Bvh, Filter, Hit};
use crate::shape::curves::CurveKind;
use crate::shape::{Curves, Detail, Strand, Surface};
use diopter_light::Ray;
use glam::{Affine3A, Vec2, Vec3, Vec3A, Vec4};

impl Scene {
    /// A point of a curve: of flat and round ones in the plane through the centre line that faces the ray.
    #[inline(never)]
    pub(super) fn curve_surface(&self, ray: &Ray, hit: &Hit, object: u32, curves: u32) -> Surface {
        let placement = self.placement(object, ray.time_s);
        let set = &self.description.curves[curves as usize];
        let segment = hit.id >> self.built.strands[curves as usize].levels;
        let at = set.at(segment, hit.u);
        let direction = placement.object_from_world.transform_vector3(ray.direction).normalize_or_zero();
        let across = set.across(segment, hit.u, at.tangent, direction);
        // From −1 to 1.
        let place = 2.0 * hit.v - 1.0;
        let front = at.tangent.cross(across);
        let normal = match set.kind {
            CurveKind::Cylinder => front * (1.0 - place * place).max(0.0).sqrt() + across * place,
            CurveKind::Flat | CurveKind::Ribbon => front,
        };
        let world = &placement.world_from_object;
        let ng = Vec3::from(placement.normals * Vec3A::from(normal)).normalize();
        let radius = match set.kind {
            CurveKind::Ribbon => 0.0,
            _ => world.transform_vector3(across * at.radius).length(),
        };
        Surface {
            point: world.transform_point3(at.center + across * (at.radius * place)),
            t: hit.t,
            ng,
            ns: ng,
            tangent: world.transform_vector3(at.tangent),
            // v grows along n × t, which is −1 in glTF, whose v runs down.
            handedness: if placement.mirrored { 1.0 } else { -1.0 },
            uv: [Vec2::new(hit.u, hit.v); 2],
            color: Vec4::ONE,
            object,
            triangle: segment,
            reach: f32::INFINITY,
            detail: Detail::Strand(Strand { center: world.transform_point3(at.center), radius }),
        }
    }

    /// Follows a ray into an object of curves. `t` of the hit means the same as in the world.
    #[inline(never)]
    pub(super) fn intersect_curves(
        &self,
        ray: &Ray,
        object: u32,
        object_from_world: &Affine3A,
        t_max: f32,
        any: bool,
        blends_block: bool,
    ) -> Option<Hit> {
        let Shape::Curves { curves, .. } = self.description.objects[object as usize].shape else { return None };
        let StrandTree { bvh, levels } = &self.built.strands[curves as usize];
        let local = in_object(ray, object_from_world);
        let set = &self.description.curves[curves as usize];
        let filter = CurveFilter { scene: self, ray, object, set, levels: *levels, local, blends_block };
        found_within(bvh, object, local, t_max, any, &filter)
    }
}

/// The hierarchy of a set of curves.
#[derive(Debug)]
pub(super) struct StrandTree {
    pub bvh: Bvh,
    /// How often segments are halved in it: numbers of its primitives are those of segments, then pieces.
    pub levels: u32,
}

/// Meets the pieces of a set of curves.
struct CurveFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    object: u32,
    set: &'a Curves,
    levels: u32,
    /// Origin and direction in the space of the set.
    local: (Vec3, Vec3),
    /// Whether blended strands count wherever they are not entirely clear.
    blends_block: bool,
}

impl Filter for CurveFilter<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        unreachable!("hierarchies of curves hold no triangles")
    }
    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let covers = |segment: u32, u: f32, v: f32| {
            self.scene.covers_part(self.ray, self.object, segment, || Vec2::new(u, v), self.blends_block)
        };
        let hit = self.set.intersect(id, self.levels, self.local, t_max, any, &covers)?;
        Some(Hit { t: hit.t, u: hit.u, v: hit.v, id, slot: u32::MAX, instance: 0 })
    }
}

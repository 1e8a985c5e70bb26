//! Where points of surfaces are at moments of another exposure: what motion vectors and optical flow compare with.
//!
//! A point is followed as a point of its object: with the node that carries it, or with the corners of its triangle where a mesh bends.

use crate::motion::{Motion, Pose, Timeline};
use crate::scene::{Scene, Shape};
use crate::shape::Surface;
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use std::collections::HashMap;

/// Moments at which meshes that bend are posed for an exposure of some length; between them corners go straight.
const POSES: usize = 9;

/// The scene of a [`Scene`] at moments of another exposure.
pub struct OtherExposure<'a> {
    scene: &'a Scene,
    timeline: Timeline<'a>,
    open_s: f64,
    span_s: f64,
    /// Poses of objects that bend, at equal steps.
    poses: HashMap<u32, Vec<Pose>>,
}

impl Scene {
    /// The scene during an exposure that begins at `open_s` and takes `span_s` (both s), whatever exposure it is posed for. What hangs on free nodes
    /// ([`crate::motion::Node::free`]) is where it was put last.
    pub fn other_exposure(&self, open_s: f64, span_s: f64) -> OtherExposure<'_> {
        let d = self.description();
        let timeline = d.timeline();
        let mut poses = HashMap::new();
        for (number, object) in d.objects.iter().enumerate() {
            let (Motion::Deformed { deformer }, Shape::Mesh { mesh, .. }) = (object.motion, object.shape) else { continue };
            let steps = if span_s > 0.0 { POSES - 1 } else { 0 };
            let at = |k: usize| open_s + span_s * k as f64 / steps.max(1) as f64;
            let (deformer, mesh) = (&d.deformers[deformer as usize], &d.meshes[mesh as usize]);
            poses.insert(number as u32, (0..=steps).map(|k| timeline.pose(deformer, mesh, at(k))).collect());
        }
        OtherExposure { scene: self, timeline, open_s, span_s, poses }
    }
}

impl OtherExposure<'_> {
    /// Where a point that a ray met at `time_s` of the exposure that the scene is posed for lies `at_s` after the beginning of this one (m); `None` where its
    /// object was scaled to nothing.
    pub fn point(&self, surface: &Surface, time_s: f32, at_s: f64) -> Option<DVec3> {
        let d = self.scene.description();
        let object = &d.objects[surface.object as usize];
        let point = surface.point.as_dvec3();
        let Some(instance) = self.scene.animated().instance(surface.object) else { return Some(point) };
        let fraction = self.scene.animated().fraction(time_s);
        match (object.motion, object.shape) {
            (Motion::Carried { node }, _) => {
                let here = double(&self.scene.animated().place(instance, fraction));
                let there = double(&self.timeline.world(node, self.open_s + at_s));
                let within = here.inverse().transform_point3(point);
                Some(there.transform_point3(within)).filter(|p| p.is_finite())
            }
            (Motion::Deformed { .. }, Shape::Mesh { mesh, .. }) => {
                let mesh = &d.meshes[mesh as usize];
                let here = self.scene.animated().corners(instance, mesh, surface.triangle as usize, fraction);
                let weights = barycentric(point, here)?;
                let there = self.corners(surface.object, mesh.triangles[surface.triangle as usize], at_s)?;
                Some(weights[0] * there[0] + weights[1] * there[1] + weights[2] * there[2])
            }
            _ => Some(point),
        }
    }

    /// Corners of a triangle of a mesh that bends.
    fn corners(&self, object: u32, corners: [u32; 3], at_s: f64) -> Option<[DVec3; 3]> {
        let poses = self.poses.get(&object)?;
        let last = poses.len() - 1;
        let x = if self.span_s > 0.0 { (at_s / self.span_s).clamp(0.0, 1.0) * last as f64 } else { 0.0 };
        let k = (x as usize).min(last.saturating_sub(1));
        let (a, b, f) = (&poses[k], &poses[(k + 1).min(last)], x - k as f64);
        Some(corners.map(|i| a.positions[i as usize].as_dvec3().lerp(b.positions[i as usize].as_dvec3(), f)))
    }
}

/// In double precision.
fn double(m: &Affine3A) -> DAffine3 {
    let axis = |v: glam::Vec3A| Vec3::from(v).as_dvec3();
    DAffine3 {
        matrix3: DMat3::from_cols(axis(m.matrix3.x_axis), axis(m.matrix3.y_axis), axis(m.matrix3.z_axis)),
        translation: axis(m.translation),
    }
}

/// Barycentric weights of a point in the plane of a triangle; `None` where it has no area.
fn barycentric(point: DVec3, corners: [Vec3; 3]) -> Option<[f64; 3]> {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    if area <= 0.0 {
        return None;
    }
    let v = (point - a).cross(c - a).dot(normal) / area;
    let w = (b - a).cross(point - a).dot(normal) / area;
    Some([1.0 - v - w, v, w])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::{Material, Scattering};
    use crate::motion::{AnimatedProperty, Animation, AnimationPlayback, Channel, Deformer, KeyInterpolation, Node, Target};
    use crate::scene::{Description, Object};
    use crate::shape::Mesh;
    use crate::texture::Color;
    use diopter_light::Ray;
    use glam::Vec2;

    /// A square of 2 m in the plane z = 0 that moves 3 m/s to the right and 1 m/s upwards: carried by a node, or bent by a morph target that reaches full
    /// weight after 1 s.
    fn scene(bent: bool) -> Scene {
        let mesh = Mesh {
            positions: vec![
                Vec3::new(-1.0, -1.0, 0.0),
                Vec3::new(1.0, -1.0, 0.0),
                Vec3::new(1.0, 1.0, 0.0),
                Vec3::new(-1.0, 1.0, 0.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], Vec::new()],
            ..Default::default()
        };
        let shape = Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY };
        let mut object = Object::new("square", shape, 0);
        let way = Vec3::new(3.0, 1.0, 0.0);
        let (property, values) = match bent {
            false => (AnimatedProperty::Translation, vec![0.0, 0.0, 0.0, way.x, way.y, way.z]),
            true => (AnimatedProperty::MorphWeights, vec![0.0, 1.0]),
        };
        object.motion = if bent { Motion::Deformed { deformer: 0 } } else { Motion::Carried { node: 0 } };
        let target = Target { positions: vec![way; 4], ..Default::default() };
        let channel = Channel { node: 0, property, interpolation: KeyInterpolation::Linear, times_s: vec![0.0, 1.0], values };
        Scene::build(Description {
            meshes: vec![mesh.into()],
            materials: vec![Material::new("white", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
            objects: vec![object],
            nodes: vec![Node::new("node")],
            animations: vec![Animation { name: "go".into(), channels: vec![channel] }],
            playing: AnimationPlayback { animations: vec![0], ..Default::default() },
            deformers: vec![Deformer { mesh: 0, node: 0, targets: vec![target], weights: vec![0.0], skin: None }],
            ..Default::default()
        })
        .unwrap()
    }

    #[test]
    fn points_of_what_is_carried_and_of_what_bends_are_found_again() {
        for bent in [false, true] {
            let mut scene = scene(bent);
            scene.pose(0.1, 0.2);
            let ray = Ray { origin: Vec3::new(0.7, 0.2, 3.0), direction: Vec3::NEG_Z, time_s: 0.15 };
            let met = scene.first_visible(&ray).unwrap();
            let other = scene.other_exposure(0.5, 0.2);
            for at in [0.0, 0.05, 0.2] {
                let moved = 0.5 + at - 0.25;
                let expected = DVec3::new(0.7 + 3.0 * moved, 0.2 + moved, 0.0);
                let found = other.point(&met, ray.time_s, at).unwrap();
                // Single precision of positions of a metre.
                assert!((found - expected).length() < 2e-6, "bent {bent}, {at}: {found} {expected}");
            }
        }
    }
}

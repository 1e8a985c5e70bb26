//! Rays against everything in a scene, and what is known of the place that they meet.

use super::{Object, Scene, Shape};
use crate::bvh::packet::{Bundle, PACKET};
use crate::bvh::{Bvh, Filter, Hit};
use crate::material::{Coverage, Material};
use crate::shape::{Detail, Mesh, Surface, reach_of};
use diopter_light::Ray;
use diopter_light::random::{mix, to_unit};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A, Vec4};
use std::cell::Cell;

impl Scene {
    /// Nearest surface along a ray, nearer than `t_max` (m), at the ray's own time of the exposure; `None` where it meets nothing.
    #[inline]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> Option<Surface> {
        let filter = TopFilter { scene: self, ray, blends_block: false };
        let mut hit = self.built.top.closest(ray.origin, ray.direction, t_max, &filter);
        if !self.posed.animated.is_empty() {
            let fraction = self.posed.animated.fraction(ray.time_s);
            let filter = AnimatedFilter { scene: self, ray, fraction };
            let limit = hit.map_or(t_max, |h| h.t);
            hit = self.posed.animated.closest(fraction, ray.origin, ray.direction, limit, &filter).or(hit);
        }
        Some(self.surface(ray, &hit?))
    }

    /// Distance along a ray of the nearest surface that it may meet, m: blended ones count wherever they are not entirely clear. `None` where there is none, and where
    /// things move.
    pub(crate) fn nearest_that_may_be_met(&self, ray: &Ray) -> Option<f32> {
        let filter = TopFilter { scene: self, ray, blends_block: true };
        let hit = self.built.top.closest(ray.origin, ray.direction, f32::INFINITY, &filter);
        hit.filter(|_| self.posed.animated.is_empty()).map(|hit| hit.t)
    }

    /// Whether any surface is met before `t_max` (m), glass included.
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        if self.built.top.any(ray.origin, ray.direction, t_max, &TopFilter { scene: self, ray, blends_block: false }) {
            return true;
        }
        if self.posed.animated.is_empty() {
            return false;
        }
        let fraction = self.posed.animated.fraction(ray.time_s);
        self.posed.animated.any(fraction, ray.origin, ray.direction, t_max, &AnimatedFilter { scene: self, ray, fraction })
    }

    /// Whether any surface may be met before `t_max` (m): blended ones ([`Coverage::Blend`]) that stand still count wherever they are not entirely clear.
    #[inline]
    pub(crate) fn may_be_occluded(&self, ray: &Ray, t_max: f32) -> bool {
        self.built.top.any(ray.origin, ray.direction, t_max, &TopFilter { scene: self, ray, blends_block: true })
            || !self.posed.animated.is_empty() && self.occluded(ray, t_max)
    }

    /// The same of rays that run close together, each up to an end (m): what `occluded` holds afterwards.
    pub(crate) fn may_be_occluded_many(&self, rays: &[(Ray, f32)], bundle: Bundle, occluded: &mut Vec<bool>) {
        occluded.clear();
        for rays in rays.chunks(PACKET) {
            let filter = |k: usize| TopFilter { scene: self, ray: &rays[k].0, blends_block: true };
            let met = self.built.top.any_of(rays, bundle, filter);
            let is_met = |k: usize| met >> k & 1 == 1 || !self.posed.animated.is_empty() && self.occluded(&rays[k].0, rays[k].1);
            occluded.extend((0..rays.len()).map(is_met));
        }
    }

    /// Visibility along a shadow ray up to `t_max` (m), as far as one any-hit query tells.
    #[inline]
    pub(crate) fn visibility(&self, ray: &Ray, t_max: f32) -> Visibility {
        if !self.posed.animated.is_empty() {
            return Visibility::Unknown;
        }
        let passes = Cell::new(false);
        let is_blocked =
            self.built.top.any(ray.origin, ray.direction, t_max, &VisibilityFilter { scene: self, ray, passes: &passes });
        match (is_blocked, passes.get()) {
            (true, _) => Visibility::Occluded,
            (false, true) => Visibility::Unknown,
            (false, false) => Visibility::Unoccluded,
        }
    }

    /// Object and triangle of a triangle number of the top hierarchy.
    #[inline]
    pub(super) fn flat_object(&self, id: u32) -> (u32, u32) {
        let i = self.built.flat.partition_point(|(first, _)| *first <= id) - 1;
        (self.built.flat[i].1, id - self.built.flat[i].0)
    }

    pub(super) fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let mut bent = None;
        let moved;
        let (object, triangle, corners, placement) = if hit.instance > 0 {
            let object = hit.instance - 1;
            let mesh = match self.description.objects[object as usize].shape {
                Shape::Mesh { mesh, .. } => mesh,
                Shape::Curves { curves, .. } => return self.curve_surface(ray, hit, object, curves),
                Shape::Splats { splats, .. } => return self.splat_surface(ray, hit, object, splats),
                Shape::Sphere(_) | Shape::Quad(_) => unreachable!("spheres and quads have no hierarchies of their own"),
            };
            match self.posed.animated.instance(object) {
                None => {
                    let placement = &self.built.placements[object as usize];
                    let bvh = self.built.shared[mesh as usize].as_ref().expect("an instance has a hierarchy");
                    let corners = bvh.corners(hit.slot).map(|c| placement.world_from_object.transform_point3(c));
                    (object, hit.id, corners, placement)
                }
                Some(instance) => {
                    let (shared, mesh) = (self.built.shared[mesh as usize].as_ref(), &self.description.meshes[mesh as usize]);
                    let met = self.posed.animated.met(
                        instance,
                        shared,
                        mesh,
                        hit.slot,
                        hit.id,
                        self.posed.animated.fraction(ray.time_s),
                    );
                    bent = met.bent;
                    moved = Placement::at(met.place);
                    (object, hit.id, met.corners, &moved)
                }
            }
        } else if hit.slot == u32::MAX {
            return self.simple_surface(ray, hit);
        } else {
            let (object, triangle) = self.flat_object(hit.id);
            (object, triangle, self.built.top.corners(hit.slot), &self.built.placements[object as usize])
        };
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else {
            unreachable!("triangles belong to meshes")
        };
        let mesh = &self.description.meshes[mesh as usize];
        let [a, b, c] = corners;
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut ng = (b - a).cross(c - a).normalize();
        if placement.mirrored {
            ng = -ng;
        }
        let i = triangle as usize;
        let to_world = |n: Vec3| Vec3::from(placement.normals * Vec3A::from(n));
        let normal = match &bent {
            None => mesh.mix(&mesh.normals, i, weights).map(to_world),
            Some(bent) => mixed(&bent.normals, weights),
        };
        let ns = normal.and_then(Vec3::try_normalize).unwrap_or(ng);
        // Files exist whose winding and normals disagree: the normals say which side is out.
        if ns.dot(ng) < 0.0 {
            ng = -ng;
        }
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], i, weights).unwrap_or(Vec2::ZERO));
        let given = match &bent {
            None => mesh.mix(&mesh.tangents, i, weights),
            Some(bent) => mixed(&bent.tangents, weights),
        };
        let material = self.material(object);
        let frame_set = material.normal_map.as_ref().map_or(0, |(map, _)| map.uv_set.min(1));
        let along = if given.is_none() { derivatives(mesh, i, frame_set, corners) } else { None };
        let (tangent, handedness) = tangent(given, along, placement, ng, material);
        let set = match (&material.bump, &self.built.filtering[object as usize]) {
            (None, None) => None,
            (Some(_), _) => Some(0),
            (None, Some(filtering)) => Some(filtering.uv_set.min(1)),
        };
        let detail = match set {
            None => None,
            // Computed already.
            Some(set) if set == frame_set && given.is_none() => along,
            Some(set) => derivatives(mesh, i, set, corners),
        };
        let detail = detail.map_or(Detail::None, Detail::Derivatives);
        Surface {
            point: a * weights[0] + b * weights[1] + c * weights[2],
            t: hit.t,
            ng,
            ns,
            tangent,
            handedness,
            uv,
            color: mesh.mix(&mesh.colors, i, weights).unwrap_or(Vec4::ONE),
            object,
            triangle,
            reach: reach_of(corners),
            detail,
        }
    }

    /// Where an object is at a time of the exposure.
    pub(super) fn placement(&self, object: u32, time_s: f32) -> Placement {
        match self.posed.animated.instance(object) {
            None => self.built.placements[object as usize],
            Some(instance) => Placement::at(self.posed.animated.place(instance, self.posed.animated.fraction(time_s))),
        }
    }

    pub(super) fn simple_surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let (point, ng, uv, derivatives, reach) = match self.description.objects[hit.id as usize].shape {
            Shape::Sphere(s) => {
                let n = (ray.at(hit.t) - s.center).normalize();
                let uv = sphere_uv(n);
                // n = (sin θ sin φ, cos θ, −sin θ cos φ) with φ = 2π (u − ½), θ = π v.
                let sin = n.x.hypot(n.z).max(1e-6);
                let down = Vec3::new(n.y * n.x / sin, -sin, n.y * n.z / sin);
                let r = s.radius * std::f32::consts::PI;
                let derivatives = [Vec3::new(-n.z, 0.0, n.x) * (2.0 * r), down * r];
                (s.center + n * s.radius, n, uv, derivatives, reach_of([s.center]) + s.radius)
            }
            Shape::Quad(q) => {
                (q.point(Vec2::new(hit.u, hit.v)), q.normal(), Vec2::new(hit.u, hit.v), q.edges, reach_of(q.corners()))
            }
            Shape::Mesh { .. } | Shape::Curves { .. } | Shape::Splats { .. } => {
                unreachable!("meshes, curves and splats have hierarchies")
            }
        };
        let (tangent, handedness) = image_frame(derivatives, ng, self.material(hit.id));
        Surface {
            point,
            t: hit.t,
            ng,
            ns: ng,
            tangent,
            handedness,
            uv: [uv; 2],
            color: Vec4::ONE,
            object: hit.id,
            triangle: 0,
            reach,
            detail: Detail::Derivatives(derivatives),
        }
    }

    /// Whether a hit on a surface with holes counts. The random number is a hash of ray and place: the same ray always gets
    /// the same answer, and no sampler dimension is spent. `blends_block`: whether blended surfaces count wherever they are not entirely clear.
    pub(super) fn covers(&self, ray: &Ray, object: u32, triangle: u32, [u, v]: [f32; 2], blends_block: bool) -> bool {
        if matches!(self.material(object).coverage, Coverage::Full) {
            return true;
        }
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else { return true };
        let mesh = &self.description.meshes[mesh as usize];
        let weights = [1.0 - u - v, u, v];
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], triangle as usize, weights).unwrap_or(Vec2::ZERO));
        let alpha = mesh.mix(&mesh.colors, triangle as usize, weights).map_or(1.0, |c| c.w);
        self.is_met(ray, object, triangle, (&uv, alpha), blends_block)
    }

    /// The same of what is no mesh, by the texture coordinates of the hit, which few materials ask for; `part` tells the places apart at which a ray may meet an object.
    pub(super) fn covers_part(&self, ray: &Ray, object: u32, part: u32, uv: impl FnOnce() -> Vec2, blends_block: bool) -> bool {
        matches!(self.material(object).coverage, Coverage::Full)
            || self.is_met(ray, object, part, (&[uv(); 2], 1.0), blends_block)
    }

    /// The draw of both.
    fn is_met(&self, ray: &Ray, object: u32, part: u32, (uv, alpha): (&[Vec2; 2], f32), blends_block: bool) -> bool {
        let bits = |v: Vec3| v.x.to_bits() ^ mix(v.y.to_bits() ^ mix(v.z.to_bits()));
        let draw = match blends_block {
            true => 0.0,
            false => to_unit(mix(bits(ray.origin) ^ mix(bits(ray.direction) ^ mix(part ^ object << 20)))),
        };
        self.material(object).coverage.accepts(uv, alpha, draw)
    }
}

/// What is looked up for an object at each hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub world_from_object: Affine3A,
    pub object_from_world: Affine3A,
    /// Inverse transpose: normals.
    pub normals: Mat3A,
    /// Start in `light_of`, or none.
    pub first_light: Option<u32>,
    pub mirrored: bool,
}

/// Origin and direction of a ray in the space of an object. The direction keeps its scale, so t means the same in both spaces.
#[inline]
pub(super) fn in_object(ray: &Ray, object_from_world: &Affine3A) -> (Vec3, Vec3) {
    (object_from_world.transform_point3(ray.origin), object_from_world.transform_vector3(ray.direction))
}

/// The nearest hit in the hierarchy of an object, of a ray in its space; with `any` that there is one.
#[inline]
pub(super) fn found_within(
    bvh: &Bvh,
    object: u32,
    (origin, direction): (Vec3, Vec3),
    t_max: f32,
    any: bool,
    filter: &impl Filter,
) -> Option<Hit> {
    let found = if any {
        let found = Hit { t: 0.0, u: 0.0, v: 0.0, id: 0, slot: 0, instance: 0 };
        bvh.any(origin, direction, t_max, filter).then_some(found)
    } else {
        bvh.closest(origin, direction, t_max, filter)
    };
    found.map(|h| Hit { instance: object + 1, ..h })
}

/// Values at the corners of a triangle mixed by barycentric weights.
fn mixed<T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>>(
    at: &[Option<T>; 3],
    weights: [f32; 3],
) -> Option<T> {
    Some(at[0]? * weights[0] + at[1]? * weights[1] + at[2]? * weights[2])
}

impl Placement {
    pub(super) fn new(object: &Object) -> Self {
        match object.shape {
            Shape::Mesh { world_from_mesh, .. } => Placement::at(world_from_mesh),
            Shape::Curves { world_from_curves, .. } => Placement::at(world_from_curves),
            Shape::Splats { world_from_splats, .. } => Placement::at(world_from_splats),
            _ => Placement::at(Affine3A::IDENTITY),
        }
    }

    pub(super) fn at(world_from_object: Affine3A) -> Self {
        let object_from_world = world_from_object.inverse();
        Placement {
            world_from_object,
            object_from_world,
            normals: object_from_world.matrix3.transpose(),
            first_light: None,
            mirrored: world_from_object.matrix3.determinant() < 0.0,
        }
    }
}

/// Tangent from the mesh or from how its texture coordinates run (0 without either), in world space, and the frame's handedness.
fn tangent(given: Option<Vec4>, along: Option<[Vec3; 2]>, placement: &Placement, ng: Vec3, material: &Material) -> (Vec3, f32) {
    if let Some(t) = given {
        return (
            placement.world_from_object.transform_vector3(t.truncate()),
            if (t.w < 0.0) != placement.mirrored { -1.0 } else { 1.0 },
        );
    }
    along.map_or((Vec3::ZERO, 1.0), |along| image_frame(along, ng, material))
}

/// Texture coordinates of a sphere by its normal: longitude and latitude, as the environment map's.
fn sphere_uv(n: Vec3) -> Vec2 {
    Vec2::new(n.x.atan2(-n.z) / std::f32::consts::TAU + 0.5, n.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI)
}

/// Tangent and handedness of the picture of normals on a surface, of how the place changes with the texture coordinates: the tangent points to the
/// right in the picture, the bitangent up in it, whichever way the mesh's own coordinates count. Without a picture the coordinates are a picture's.
///
/// Green is up in the picture: glTF 2.0 §3.9.3 and UsdPreviewSurface say so. pbrt-v4 and Mitsuba 3 take the cross product of normal and
/// tangent, which is the same direction unless the coordinates are mirrored on the surface: there they turn bumps into dents.
fn image_frame([du, dv]: [Vec3; 2], ng: Vec3, material: &Material) -> (Vec3, f32) {
    let (tangent, down) = match &material.normal_map {
        None => (du, dv),
        Some((map, _)) => {
            // ∂p/∂image = ∂p/∂uv · ∂uv/∂image.
            let uv_from_image = map.image_from_uv.matrix2.inverse();
            let along = |column: Vec2| du * column.x + dv * column.y;
            let both = (along(uv_from_image.x_axis), along(uv_from_image.y_axis));
            // A transform that shows one texel everywhere has no directions.
            if both.0.is_finite() && both.1.is_finite() { both } else { (du, dv) }
        }
    };
    (tangent, if ng.cross(tangent).dot(down) > 0.0 { -1.0 } else { 1.0 })
}

/// How the place on a triangle changes with a set of texture coordinates, m; `None` without, or where they do not span it.
#[inline(never)]
fn derivatives(mesh: &Mesh, triangle: usize, set: usize, corners: [Vec3; 3]) -> Option<[Vec3; 2]> {
    let uvs = &mesh.uvs[set];
    if uvs.is_empty() {
        return None;
    }
    let [ua, ub, uc] = mesh.triangles[triangle].map(|i| uvs[i as usize]);
    let ((e1, e2), (d1, d2)) = ((corners[1] - corners[0], corners[2] - corners[0]), (ub - ua, uc - ua));
    let det = d1.perp_dot(d2);
    let both = [(e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det];
    both.iter().all(|d| d.is_finite()).then_some(both)
}

struct TopFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    /// Whether blended surfaces count wherever they are not entirely clear.
    blends_block: bool,
}

impl Filter for TopFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        let (object, triangle) = self.scene.flat_object(id);
        self.scene.covers(self.ray, object, triangle, [u, v], self.blends_block)
    }

    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let hit = |t, u, v| Hit { t, u, v, id, slot: u32::MAX, instance: 0 };
        match self.scene.description.objects[id as usize].shape {
            Shape::Sphere(s) => {
                let covers = |part: usize, t: f32| {
                    let uv = || sphere_uv((self.ray.at(t) - s.center).normalize());
                    self.scene.covers_part(self.ray, id, part as u32, uv, self.blends_block)
                };
                let both = s.intersections(self.ray.origin, self.ray.direction)?;
                let mut met = both.into_iter().enumerate().filter(|(_, t)| *t > 0.0 && *t < t_max);
                met.find(|(part, t)| covers(*part, *t)).map(|(_, t)| hit(t, 0.0, 0.0))
            }
            Shape::Quad(q) => q
                .intersect(self.ray.origin, self.ray.direction, t_max)
                .filter(|(_, p)| self.scene.covers_part(self.ray, id, 0, || *p, self.blends_block))
                .map(|(t, p)| hit(t, p.x, p.y)),
            Shape::Mesh { mesh, .. } => {
                let bvh = self.scene.built.shared[mesh as usize].as_ref()?;
                let place = &self.scene.built.placements[id as usize].object_from_world;
                let filter = InstanceFilter { scene: self.scene, ray: self.ray, object: id, blends_block: self.blends_block };
                found_within(bvh, id, in_object(self.ray, place), t_max, any, &filter)
            }
            Shape::Curves { .. } => {
                let place = &self.scene.built.placements[id as usize].object_from_world;
                self.scene.intersect_curves(self.ray, id, place, t_max, any, self.blends_block)
            }
            Shape::Splats { .. } => {
                let place = &self.scene.built.placements[id as usize].object_from_world;
                self.scene.intersect_splats(self.ray, id, place, t_max, any, self.blends_block)
            }
        }
    }
}

/// What is known of the visibility along a shadow ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Visibility {
    /// An opaque surface is met.
    Occluded,
    /// Nothing is met.
    Unoccluded,
    /// Only surfaces that may let light through are met, or something moves: the nearest of them decides, one after the other.
    Unknown,
}

/// Meets opaque surfaces, and notes whether there was any other.
struct VisibilityFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    passes: &'a Cell<bool>,
}

impl VisibilityFilter<'_> {
    /// Whether an object occludes where it is hit; one that does not is noted.
    fn blocks(&self, object: u32) -> bool {
        let may_pass = self.scene.built.may_pass[object as usize];
        self.passes.set(self.passes.get() | may_pass);
        !may_pass
    }
}

impl Filter for VisibilityFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        let (object, triangle) = self.scene.flat_object(id);
        self.scene.covers(self.ray, object, triangle, [u, v], false) && self.blocks(object)
    }

    fn intersect_other(&self, id: u32, t_max: f32, _: bool) -> Option<Hit> {
        let top = TopFilter { scene: self.scene, ray: self.ray, blends_block: false };
        // Of an object that may let light through any hit is enough to note it.
        top.intersect_other(id, t_max, true).filter(|_| self.blocks(id))
    }
}

/// Meets what moves, at one moment.
struct AnimatedFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    fraction: f32,
}

impl Filter for AnimatedFilter<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        unreachable!("hierarchies of animated instances hold no triangles")
    }
    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let animated = &self.scene.posed.animated;
        let object = animated.object(id);
        let shape = self.scene.description.objects[object as usize].shape;
        if let Shape::Curves { .. } | Shape::Splats { .. } = shape {
            let place = animated.place(id, self.fraction);
            // Scaled to nothing: not there.
            if place.matrix3.determinant().abs() < 1e-30 {
                return None;
            }
            return match shape {
                Shape::Splats { .. } => self.scene.intersect_splats(self.ray, object, &place.inverse(), t_max, any, false),
                _ => self.scene.intersect_curves(self.ray, object, &place.inverse(), t_max, any, false),
            };
        }
        let filter = InstanceFilter { scene: self.scene, ray: self.ray, object, blends_block: false };
        animated.enter(id, &self.scene.built.shared, self.fraction, (self.ray.origin, self.ray.direction), t_max, any, &filter)
    }
}

struct InstanceFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    object: u32,
    blends_block: bool,
}

impl Filter for InstanceFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        self.scene.covers(self.ray, self.object, id, [u, v], self.blends_block)
    }
    fn intersect_other(&self, _: u32, _: f32, _: bool) -> Option<Hit> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneError;
    use crate::material::{Emission, Scattering};
    use crate::scene::{Description, Object};
    use crate::shape::{Quad, Sphere};
    use crate::texture::{Color, Scalar};
    use diopter_light::{SampledWavelengths, Spectrum};

    fn scene(shape: Shape, material: Material) -> Result<Scene, SceneError> {
        Scene::build(Description {
            objects: vec![Object::new("thing", shape, 0)],
            materials: vec![material],
            ..Default::default()
        })
    }

    fn down(x: f32, y: f32) -> Ray {
        Ray { origin: Vec3::new(x, y, 3.0), direction: Vec3::NEG_Z, time_s: 0.0 }
    }

    #[test]
    fn spheres_and_quads_are_met_as_often_as_they_cover() {
        let grey = Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5));
        let thin = Material { coverage: Coverage::Blend(Scalar::Constant(0.3)), ..Material::new("thin", grey) };
        let ball = scene(Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), thin.clone()).unwrap();
        let quad = Quad { corner: Vec3::new(-1.0, -1.0, 0.0), edges: [2.0 * Vec3::X, 2.0 * Vec3::Y] };
        let sheet = scene(Shape::Quad(quad), thin).unwrap();
        let (mut front, mut back, mut on_sheet, mut agree) = (0, 0, 0, true);
        let count = 20_000;
        for i in 0..count {
            let at = |k: u32| to_unit(mix(2 * i + k)) - 0.5;
            let ray = down(at(0), at(1));
            match ball.intersect(&ray, f32::INFINITY) {
                Some(s) if s.point.z > 0.0 => front += 1,
                Some(_) => back += 1,
                None => (),
            }
            agree &= ball.intersect(&ray, f32::INFINITY).is_some() == ball.occluded(&ray, f32::INFINITY);
            on_sheet += u32::from(sheet.intersect(&ray, f32::INFINITY).is_some());
        }
        // Of 20 000 within four standard deviations, √(p (1 − p) / 20 000).
        for (met, expected) in [(front, 0.3), (back, 0.7 * 0.3), (on_sheet, 0.3)] {
            let fraction = f64::from(met) / f64::from(count);
            assert!((fraction - expected).abs() < 0.013, "{fraction}, not {expected}");
        }
        assert!(agree, "a shadow ray meets something else");
    }

    #[test]
    fn colours_of_vertices_tint_what_is_to_be_looked_at_and_not_lamps() {
        let seen = |is_light: bool| {
            let mesh = Mesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                colors: vec![glam::Vec4::new(1.0, 0.2, 0.4, 1.0); 3],
                triangles: vec![[0, 1, 2]],
                ..Default::default()
            };
            let glow = Emission { is_light, two_sided: true, ..Emission::one_sided(Spectrum::light_from_rgb(Vec3::splat(0.5))) };
            let material = Material { emission: Some(glow.clone()), ..Material::new("glow", Scattering::Black) };
            let mut d = Description { materials: vec![material], meshes: vec![mesh.into()], ..Default::default() };
            d.objects.push(Object::new("thing", Shape::Mesh { mesh: 0, world_from_mesh: Default::default() }, 0));
            let surface = Scene::build(d).unwrap().intersect(&down(0.2, 0.2), 9.0).unwrap();
            let light = glow.at(&surface, &SampledWavelengths::rgb());
            [light[0], light[1], light[2]]
        };
        let (looked_at, lamp) = (seen(false), seen(true));
        for (k, tint) in [1.0, 0.2, 0.4].into_iter().enumerate() {
            assert!((looked_at[k] / lamp[k] - tint).abs() < 1e-5, "{looked_at:?} {lamp:?}");
        }
    }
}

//! A scene: described as plain data, then built once and only read.

use crate::SceneError;
use crate::bvh::{Bounds, Bvh, Filter, Hit, Primitive, Primitives};
use crate::light::area::AreaShape;
use crate::light::{AreaLight, Environment, Lights, Punctual};
use crate::material::{Coverage, Emission, EmissionColor, Material};
use crate::shape::{Mesh, Quad, Sphere, Surface};
use diopter_light::Ray;
use diopter_light::random::{mix, to_unit};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A, Vec4};

/// Everything a file or a program says about a scene.
#[derive(Clone, Debug, Default)]
pub struct Description {
    /// For messages and metadata.
    pub name: String,
    /// Meshes, each once.
    pub meshes: Vec<Mesh>,
    /// Materials, referred to by number.
    pub materials: Vec<Material>,
    /// Things in the world.
    pub objects: Vec<Object>,
    /// Lights without extent.
    pub punctual: Vec<Punctual>,
    /// Light from all around.
    pub environment: Option<Environment>,
    /// Points of view the file names.
    pub cameras: Vec<Viewpoint>,
    /// Animations, kept for the shutter to come.
    pub animations: Vec<Animation>,
    /// What was found odd on the way.
    pub warnings: Vec<String>,
}

/// A thing in the world.
#[derive(Clone, Debug)]
pub struct Object {
    /// Name in its file.
    pub name: String,
    /// Its form.
    pub shape: Shape,
    /// Number of its material.
    pub material: u32,
}

/// The form of a thing.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// A mesh by number, placed.
    Mesh {
        /// Number of the mesh.
        mesh: u32,
        /// Where it stands.
        world_from_mesh: Affine3A,
    },
    /// A sphere in world space.
    Sphere(Sphere),
    /// A parallelogram in world space.
    Quad(Quad),
}

/// A camera of a file: where it is and how wide it sees.
#[derive(Clone, Debug)]
pub struct Viewpoint {
    /// Name in its file.
    pub name: String,
    /// Looks along −Z, +Y up.
    pub world_from_camera: Affine3A,
    /// Vertical angle of view, rad; `None` for an orthographic camera.
    pub vertical_fov: Option<f32>,
}

/// Key frames of a node.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Node number in the file.
    pub node: usize,
    /// What is animated.
    pub property: AnimatedProperty,
    /// How values between keys are found.
    pub interpolation: KeyInterpolation,
    /// Times, s, rising.
    pub times_s: Vec<f32>,
    /// Values, flattened: 3 or 4 numbers a key (3 times as many for cubic).
    pub values: Vec<f32>,
}

/// What a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnimatedProperty {
    /// 3 numbers, m.
    Translation,
    /// A unit quaternion x, y, z, w.
    Rotation,
    /// 3 factors.
    Scale,
    /// One weight for each target.
    MorphWeights,
}

/// Interpolation of key frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyInterpolation {
    /// The value of the last key.
    Step,
    /// Straight (rotations: along the great circle).
    Linear,
    /// Hermite spline with given tangents.
    Cubic,
}

/// A named set of channels.
#[derive(Clone, Debug)]
pub struct Animation {
    /// Name in its file.
    pub name: String,
    /// What moves.
    pub channels: Vec<Channel>,
}

/// A scene ready to be photographed.
#[derive(Debug)]
pub struct Scene {
    description: Description,
    /// Everything: triangles of meshes used once (in world space), and others by object number.
    top: Bvh,
    /// Hierarchies of meshes used more than once, by mesh.
    shared: Vec<Option<Bvh>>,
    /// First triangle number in `top` of each object that is in it, rising, and the object.
    flat: Vec<(u32, u32)>,
    placements: Vec<Placement>,
    lights: Lights,
    /// Area light of each triangle of emissive objects; `first_light` of the object says where its own begin.
    light_of: Vec<u32>,
}

/// What is looked up for an object at each hit.
#[derive(Clone, Copy, Debug)]
struct Placement {
    world_from_object: Affine3A,
    object_from_world: Affine3A,
    /// Inverse transpose: normals.
    normals: Mat3A,
    /// Start in `light_of`, or none.
    first_light: Option<u32>,
    mirrored: bool,
}

const NO_LIGHT: u32 = u32::MAX;

impl Scene {
    /// Builds a scene. Fails when numbers do not fit: a material or mesh that is not there, nothing to see.
    pub fn build(mut description: Description) -> Result<Scene, SceneError> {
        check(&mut description)?;
        let d = &description;
        let mut uses = vec![0u32; d.meshes.len()];
        for object in &d.objects {
            if let Shape::Mesh { mesh, .. } = object.shape {
                uses[mesh as usize] += 1;
            }
        }

        // Meshes used once go into the top hierarchy as they stand; others get one of their own.
        let mut flat = Vec::new();
        let mut next = 0u32;
        for (i, object) in d.objects.iter().enumerate() {
            if let Shape::Mesh { mesh, .. } = object.shape
                && uses[mesh as usize] == 1
            {
                flat.push((next, i as u32));
                let count = d.meshes[mesh as usize].triangles.len();
                next = next.checked_add(count as u32).filter(|n| *n < 1 << 30).ok_or(SceneError::TooLarge(count))?;
            }
        }
        let shared: Vec<Option<Bvh>> = d
            .meshes
            .iter()
            .zip(&uses)
            .enumerate()
            .map(|(i, (mesh, uses))| {
                let filtered = d.objects.iter().any(|o| {
                    matches!(o.shape, Shape::Mesh { mesh, .. } if mesh as usize == i)
                        && !matches!(d.materials[o.material as usize].coverage, Coverage::Full)
                });
                (*uses > 1).then(|| Bvh::build(&MeshPrimitives { mesh, filtered }))
            })
            .collect();
        let placements: Vec<Placement> = d.objects.iter().map(Placement::new).collect();
        let others: Vec<(u32, Bounds)> = d
            .objects
            .iter()
            .enumerate()
            .filter_map(|(i, object)| {
                let bounds = match object.shape {
                    Shape::Sphere(s) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
                    Shape::Quad(q) => {
                        // A flat box would be missed by rounding: give it a little depth.
                        let b = Bounds::around([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| q.point(p)));
                        let pad = 1e-5 * b.size().max_element().max(b.max.abs().max(b.min.abs()).max_element());
                        Bounds { min: b.min - pad, max: b.max + pad }
                    }
                    Shape::Mesh { mesh, .. } => {
                        instance_bounds(shared[mesh as usize].as_ref()?, &placements[i].world_from_object)
                    }
                };
                Some((i as u32, bounds))
            })
            .collect();
        let top = Bvh::build(&TopPrimitives { description: d, flat: &flat, triangles: next as usize, others: &others });

        let (area, light_of, first) = area_lights(d);
        let placements = placements.into_iter().zip(first).map(|(p, first_light)| Placement { first_light, ..p }).collect();
        let lights = Lights::new(area, d.punctual.clone(), d.environment.clone());
        Ok(Scene { top, shared, flat, placements, lights, light_of, description })
    }

    /// What the scene was built from.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Its lights.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The box around everything.
    pub fn bounds(&self) -> Bounds {
        self.top.bounds()
    }

    /// Triangles in meshes, each mesh counted once.
    pub fn triangle_count(&self) -> usize {
        self.description.meshes.iter().map(|m| m.triangles.len()).sum()
    }

    /// Bytes held by (meshes, hierarchies).
    pub fn memory(&self) -> (usize, usize) {
        let meshes = self.description.meshes.iter().map(Mesh::memory).sum();
        (meshes, self.top.memory() + self.shared.iter().flatten().map(Bvh::memory).sum::<usize>())
    }

    /// Material of an object.
    #[inline]
    pub fn material(&self, object: u32) -> &Material {
        &self.description.materials[self.description.objects[object as usize].material as usize]
    }

    /// Nearest surface along a ray.
    #[inline]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> Option<Surface> {
        let filter = TopFilter { scene: self, ray };
        let hit = self.top.closest(ray.origin, ray.direction, t_max, &filter)?;
        Some(self.surface(ray, &hit))
    }

    /// Whether anything is met before `t_max`.
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        self.top.any(ray.origin, ray.direction, t_max, &TopFilter { scene: self, ray })
    }

    /// The area light that a surface point belongs to.
    #[inline]
    pub fn light_at(&self, surface: &Surface) -> Option<u32> {
        let first = self.placements[surface.object as usize].first_light?;
        let light = self.light_of[first as usize + surface.triangle as usize];
        (light != NO_LIGHT).then_some(light)
    }

    /// Object and triangle of a triangle number of the top hierarchy.
    #[inline]
    fn flat_object(&self, id: u32) -> (u32, u32) {
        let i = self.flat.partition_point(|(first, _)| *first <= id) - 1;
        (self.flat[i].1, id - self.flat[i].0)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let (object, triangle, corners) = if hit.instance > 0 {
            let object = hit.instance - 1;
            let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else {
                unreachable!("only meshes are instanced")
            };
            let bvh = self.shared[mesh as usize].as_ref().expect("an instance has a hierarchy");
            let place = &self.placements[object as usize].world_from_object;
            (object, hit.id, bvh.corners(hit.slot).map(|c| place.transform_point3(c)))
        } else if hit.slot == u32::MAX {
            return self.simple_surface(ray, hit);
        } else {
            let (object, triangle) = self.flat_object(hit.id);
            (object, triangle, self.top.corners(hit.slot))
        };
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else {
            unreachable!("triangles belong to meshes")
        };
        let mesh = &self.description.meshes[mesh as usize];
        let placement = &self.placements[object as usize];
        let [a, b, c] = corners;
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut ng = (b - a).cross(c - a).normalize();
        if placement.mirrored {
            ng = -ng;
        }
        let i = triangle as usize;
        let to_world = |n: Vec3| Vec3::from(placement.normals * Vec3A::from(n));
        let ns = mesh.mix(&mesh.normals, i, weights).and_then(|n| to_world(n).try_normalize()).unwrap_or(ng);
        // Files exist whose winding and normals disagree: the normals say which side is out.
        if ns.dot(ng) < 0.0 {
            ng = -ng;
        }
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], i, weights).unwrap_or(Vec2::ZERO));
        let (tangent, handedness) =
            if mesh.uvs[0].is_empty() { (Vec3::ZERO, 1.0) } else { tangent(mesh, i, weights, corners, placement, ng) };
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
        }
    }

    fn simple_surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let (point, ng, uv, tangent) = match self.description.objects[hit.id as usize].shape {
            Shape::Sphere(s) => {
                let n = (ray.at(hit.t) - s.center).normalize();
                // Longitude and latitude, as the environment map's.
                let uv =
                    Vec2::new(n.x.atan2(-n.z) / std::f32::consts::TAU + 0.5, n.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI);
                (s.center + n * s.radius, n, uv, Vec3::Y.cross(n))
            }
            Shape::Quad(q) => (q.point(Vec2::new(hit.u, hit.v)), q.normal(), Vec2::new(hit.u, hit.v), q.edges[0]),
            Shape::Mesh { .. } => unreachable!("meshes have triangles"),
        };
        Surface {
            point,
            t: hit.t,
            ng,
            ns: ng,
            tangent,
            handedness: 1.0,
            uv: [uv; 2],
            color: Vec4::ONE,
            object: hit.id,
            triangle: 0,
        }
    }
}

impl Placement {
    fn new(object: &Object) -> Self {
        let world_from_object = match object.shape {
            Shape::Mesh { world_from_mesh, .. } => world_from_mesh,
            _ => Affine3A::IDENTITY,
        };
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

/// Tangent from the mesh or from how its texture coordinates run, in world space, and the frame's handedness.
fn tangent(mesh: &Mesh, triangle: usize, weights: [f32; 3], corners: [Vec3; 3], placement: &Placement, ng: Vec3) -> (Vec3, f32) {
    if let Some(t) = mesh.mix(&mesh.tangents, triangle, weights) {
        return (
            placement.world_from_object.transform_vector3(t.truncate()),
            if (t.w < 0.0) != placement.mirrored { -1.0 } else { 1.0 },
        );
    }
    let [ua, ub, uc] = mesh.triangles[triangle].map(|i| mesh.uvs[0][i as usize]);
    let ((e1, e2), (d1, d2)) = ((corners[1] - corners[0], corners[2] - corners[0]), (ub - ua, uc - ua));
    let det = d1.perp_dot(d2);
    if det == 0.0 {
        return (Vec3::ZERO, 1.0);
    }
    let (tangent, bitangent) = ((e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det);
    // glTF's v runs down the image: its bitangent points up it.
    (tangent, if ng.cross(tangent).dot(-bitangent) < 0.0 { -1.0 } else { 1.0 })
}

fn check(d: &mut Description) -> Result<(), SceneError> {
    for object in &d.objects {
        if object.material as usize >= d.materials.len() {
            return Err(SceneError::Number {
                what: "material",
                of: object.name.clone(),
                found: object.material as usize,
                count: d.materials.len(),
            });
        }
        if let Shape::Mesh { mesh, .. } = object.shape
            && mesh as usize >= d.meshes.len()
        {
            return Err(SceneError::Number {
                what: "mesh",
                of: object.name.clone(),
                found: mesh as usize,
                count: d.meshes.len(),
            });
        }
    }
    for (i, mesh) in d.meshes.iter_mut().enumerate() {
        let n = mesh.positions.len();
        let whole = |len: usize| len == 0 || len == n;
        assert!(
            whole(mesh.normals.len())
                && whole(mesh.tangents.len())
                && whole(mesh.colors.len())
                && mesh.uvs.iter().all(|u| whole(u.len())),
            "mesh {i}: attribute lists differ in length from its {n} positions"
        );
        let dropped = mesh.drop_unusable_triangles();
        if dropped > 0 {
            d.warnings
                .push(format!("mesh {i}: {dropped} triangles without area or with corners that are not finite were left out"));
        }
    }
    // A placement that flattens (scale 0) or is not finite cannot be seen or inverted.
    let (warnings, before) = (&mut d.warnings, d.objects.len());
    d.objects.retain(|object| {
        let ok = match object.shape {
            Shape::Mesh { world_from_mesh: m, .. } => {
                m.is_finite() && m.matrix3.determinant().abs() > 1e-30 && m.inverse().is_finite()
            }
            Shape::Sphere(s) => s.center.is_finite() && s.radius.is_finite() && s.radius > 0.0,
            Shape::Quad(q) => q.corner.is_finite() && q.area().is_finite() && q.area() > 0.0,
        };
        if !ok {
            warnings.push(format!("object \"{}\" has scale 0 or a place that is not finite: it was left out", object.name));
        }
        ok
    });
    let left = before - d.objects.len();
    if d.objects.is_empty() && left > 0 {
        return Err(SceneError::Empty(format!("all {left} objects have scale 0 or are not finite")));
    }
    Ok(())
}

/// Box of a placed hierarchy: the placed corners of its box.
fn instance_bounds(bvh: &Bvh, place: &Affine3A) -> Bounds {
    let b = bvh.bounds();
    if b.is_empty() {
        return b;
    }
    let corner = |i: u32| {
        Vec3::new(
            if i & 1 == 0 { b.min.x } else { b.max.x },
            if i & 2 == 0 { b.min.y } else { b.max.y },
            if i & 4 == 0 { b.min.z } else { b.max.z },
        )
    };
    let around = Bounds::around((0..8).map(|i| place.transform_point3(corner(i))));
    // Rounding of the transform.
    let pad = 1e-6 * around.max.abs().max(around.min.abs()).max_element();
    Bounds { min: around.min - pad, max: around.max + pad }
}

struct MeshPrimitives<'a> {
    mesh: &'a Mesh,
    filtered: bool,
}

impl Primitives for MeshPrimitives<'_> {
    fn len(&self) -> usize {
        self.mesh.triangles.len()
    }
    fn get(&self, index: usize) -> Primitive {
        Primitive::Triangle { corners: self.mesh.corners(index), id: index as u32, filtered: self.filtered }
    }
}

struct TopPrimitives<'a> {
    description: &'a Description,
    flat: &'a [(u32, u32)],
    triangles: usize,
    others: &'a [(u32, Bounds)],
}

impl Primitives for TopPrimitives<'_> {
    fn len(&self) -> usize {
        self.triangles + self.others.len()
    }
    fn get(&self, index: usize) -> Primitive {
        if index >= self.triangles {
            let (id, bounds) = self.others[index - self.triangles];
            return Primitive::Other { bounds, id };
        }
        let (first, object) = self.flat[self.flat.partition_point(|(first, _)| *first <= index as u32) - 1];
        let object = &self.description.objects[object as usize];
        let Shape::Mesh { mesh, world_from_mesh } = object.shape else { unreachable!("flat objects are meshes") };
        let corners = self.description.meshes[mesh as usize].corners(index - first as usize);
        let filtered = !matches!(self.description.materials[object.material as usize].coverage, Coverage::Full);
        Primitive::Triangle { corners: corners.map(|c| world_from_mesh.transform_point3(c)), id: index as u32, filtered }
    }
}

struct TopFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
}

impl Scene {
    /// Whether a hit on a surface with holes counts. The random number is a hash of ray and place: the same ray always gets
    /// the same answer, and no sampler dimension is spent.
    fn covers(&self, ray: &Ray, object: u32, triangle: u32, u: f32, v: f32) -> bool {
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else { return true };
        let mesh = &self.description.meshes[mesh as usize];
        let weights = [1.0 - u - v, u, v];
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], triangle as usize, weights).unwrap_or(Vec2::ZERO));
        let alpha = mesh.mix(&mesh.colors, triangle as usize, weights).map_or(1.0, |c| c.w);
        let bits = |v: Vec3| v.x.to_bits() ^ mix(v.y.to_bits() ^ mix(v.z.to_bits()));
        let draw = to_unit(mix(bits(ray.origin) ^ mix(bits(ray.direction) ^ mix(triangle ^ object << 20))));
        self.material(object).coverage.accepts(&uv, alpha, draw)
    }
}

impl Filter for TopFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        let (object, triangle) = self.scene.flat_object(id);
        self.scene.covers(self.ray, object, triangle, u, v)
    }

    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let hit = |t, u, v| Hit { t, u, v, id, slot: u32::MAX, instance: 0 };
        match self.scene.description.objects[id as usize].shape {
            Shape::Sphere(s) => s.intersect(self.ray.origin, self.ray.direction, t_max).map(|t| hit(t, 0.0, 0.0)),
            Shape::Quad(q) => q.intersect(self.ray.origin, self.ray.direction, t_max).map(|(t, p)| hit(t, p.x, p.y)),
            Shape::Mesh { mesh, .. } => {
                let bvh = self.scene.shared[mesh as usize].as_ref()?;
                let place = &self.scene.placements[id as usize].object_from_world;
                // The direction keeps its scale, so t means the same in both spaces.
                let (o, d) = (place.transform_point3(self.ray.origin), place.transform_vector3(self.ray.direction));
                let filter = InstanceFilter { scene: self.scene, ray: self.ray, object: id };
                let found = if any {
                    bvh.any(o, d, t_max, &filter).then_some(Hit { t: 0.0, u: 0.0, v: 0.0, id, slot: 0, instance: id + 1 })
                } else {
                    bvh.closest(o, d, t_max, &filter)
                };
                found.map(|h| Hit { instance: id + 1, ..h })
            }
        }
    }
}

struct InstanceFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    object: u32,
}

impl Filter for InstanceFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        self.scene.covers(self.ray, self.object, id, u, v)
    }
    fn intersect_other(&self, _: u32, _: f32, _: bool) -> Option<Hit> {
        None
    }
}

/// Gathers emissive surfaces: the lights, the light of each triangle, and where each object's triangles begin in it.
fn area_lights(d: &Description) -> (Vec<AreaLight>, Vec<u32>, Vec<Option<u32>>) {
    let (mut lights, mut light_of) = (Vec::new(), Vec::new());
    // Constant emissions are integrated once a material.
    let constant: Vec<Option<f32>> = d
        .materials
        .iter()
        .map(|m| match &m.emission {
            Some(e @ Emission { radiance: EmissionColor::Constant(_), .. }) => Some(e.luminance(&[Vec2::ZERO; 2])),
            _ => None,
        })
        .collect();
    let first = d
        .objects
        .iter()
        .map(|object| {
            let material = &d.materials[object.material as usize];
            let emission = material.emission.as_ref().filter(|e| e.is_light)?;
            let luminance = |uv: &[[Vec2; 3]; 2]| {
                constant[object.material as usize].unwrap_or_else(|| {
                    // Corners, edge middles and centre of the triangle.
                    let places = [
                        (1., 0., 0.),
                        (0., 1., 0.),
                        (0., 0., 1.),
                        (0.5, 0.5, 0.),
                        (0., 0.5, 0.5),
                        (0.5, 0., 0.5),
                        (1. / 3., 1. / 3., 1. / 3.),
                    ];
                    let at = |(a, b, c): (f32, f32, f32)| emission.luminance(&uv.map(|u| u[0] * a + u[1] * b + u[2] * c));
                    places.map(at).iter().sum::<f32>() / places.len() as f32
                })
            };
            let start = light_of.len() as u32;
            let mut push = |shape, uv: [[Vec2; 3]; 2]| {
                let luminance = luminance(&uv);
                // A textured lamp may be dark at the seven places looked at: keep it, with little weight.
                if luminance == 0.0 && constant[object.material as usize].is_some() {
                    return NO_LIGHT;
                }
                lights.push(AreaLight::new(shape, object.material, uv, emission.two_sided, luminance.max(1e-6)));
                lights.len() as u32 - 1
            };
            match object.shape {
                Shape::Sphere(s) => light_of.push(push(AreaShape::Sphere(s), Default::default())),
                Shape::Quad(q) => {
                    let corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
                    light_of.push(push(AreaShape::Parallelogram(q), [corners; 2]));
                }
                Shape::Mesh { mesh, world_from_mesh } => {
                    let mesh = &d.meshes[mesh as usize];
                    let mirrored = world_from_mesh.matrix3.determinant() < 0.0;
                    let world = |t: usize| mesh.corners(t).map(|c| world_from_mesh.transform_point3(c));
                    let mut t = 0;
                    while t < mesh.triangles.len() {
                        let whole = constant[object.material as usize].is_some() && matches!(material.coverage, Coverage::Full);
                        let merged = whole && t + 1 < mesh.triangles.len();
                        if let Some(quad) = merged.then(|| parallelogram(world(t), world(t + 1))).flatten() {
                            let quad = if outside_differs(mesh, t, mirrored) { flipped(quad) } else { quad };
                            let light = push(AreaShape::Parallelogram(quad), Default::default());
                            light_of.extend([light, light]);
                            t += 2;
                            continue;
                        }
                        let [a, b, c] = world(t);
                        let uv = [0, 1].map(|s| match mesh.uvs[s].is_empty() {
                            true => [Vec2::ZERO; 3],
                            false => mesh.triangles[t].map(|i| mesh.uvs[s][i as usize]),
                        });
                        let (b, c, uv) = match outside_differs(mesh, t, mirrored) {
                            true => (c, b, uv.map(|[x, y, z]| [x, z, y])),
                            false => (b, c, uv),
                        };
                        light_of.push(push(AreaShape::Triangle(Quad { corner: a, edges: [b - a, c - a] }), uv));
                        t += 1;
                    }
                }
            }
            Some(start)
        })
        .collect();
    (lights, light_of, first)
}

/// Whether the side of a mesh triangle that counts as outside is not the one its corners, placed, run counter-clockwise on.
fn outside_differs(mesh: &Mesh, triangle: usize, mirrored: bool) -> bool {
    let [a, b, c] = mesh.corners(triangle);
    let n = mesh.mix(&mesh.normals, triangle, [1.0 / 3.0; 3]);
    let against = n.is_some_and(|n| n.dot((b - a).cross(c - a)) < 0.0);
    against != mirrored
}

fn flipped(q: Quad) -> Quad {
    Quad { corner: q.corner, edges: [q.edges[1], q.edges[0]] }
}

/// The parallelogram that two triangles make, if they do: they share an edge, and the fourth corner completes it.
fn parallelogram(t0: [Vec3; 3], t1: [Vec3; 3]) -> Option<Quad> {
    for i in 0..3 {
        // The corner of the first triangle that is not shared; the others are its neighbours.
        let (corner, p, q) = (t0[i], t0[(i + 1) % 3], t0[(i + 2) % 3]);
        let Some(opposite) = t1.iter().find(|c| **c != p && **c != q) else { continue };
        if !(t1.contains(&p) && t1.contains(&q)) {
            continue;
        }
        let expected = p + q - corner;
        let size = (p - q).length();
        if (*opposite - expected).length() > 1e-5 * size {
            continue;
        }
        // Both must wind the same way.
        let n1 = (t1[1] - t1[0]).cross(t1[2] - t1[0]);
        if (p - corner).cross(q - corner).dot(n1) > 0.0 {
            return Some(Quad { corner, edges: [p - corner, q - corner] });
        }
    }
    None
}

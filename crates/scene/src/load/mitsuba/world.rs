//! Objects of a scene in their order, and what they become.

use super::context::{Context, affine};
use super::materials::Surface;
use super::tree::Node;
use super::values::{self, boolean, number, transform};
use super::{camera, curves, lights, media, shapes, wrong};
use crate::SceneError;
use crate::load::Fetch;
use crate::load::pbrt::shapes as round;
use crate::material::{Interior, Material, Scattering};
use crate::medium::Medium;
use crate::scene::{Description, Object, Shape};
use crate::subdivision::vertex_normals;
use glam::{Affine3A, DMat4};
use std::collections::HashMap;
use std::sync::Arc;

/// Most things in a scene.
const MOST_OBJECTS: usize = 1 << 24;
/// Most control points of all curves.
const MOST_POINTS: usize = 1 << 28;

pub(super) struct World<'a> {
    context: Context<'a>,
    /// What surfaces became of, by the place of their element in memory, interior and light left out.
    surfaces: HashMap<*const Node, Surface>,
    plain: HashMap<*const Node, u32>,
    /// Shapes of a group, by its element: groups without a name are different ones.
    groups: HashMap<*const Node, Vec<(Shape, u32, String)>>,
    meshes: HashMap<(String, bool, bool), u32>,
    media: HashMap<*const Node, Arc<Medium>>,
    /// Whether anything of the file is a medium, and whether any face names what is around it.
    has_media: bool,
    has_exteriors: bool,
    /// Curves by kind, file and place: radii do not follow transforms.
    curves: HashMap<(String, [u64; 16]), u32>,
    curve_points: usize,
}

type Read<T> = Result<T, SceneError>;

impl<'a> World<'a> {
    /// Begins with an empty scene for the file `name`.
    pub fn new(name: &str, fetch: Fetch<'a>, root: &Node) -> Self {
        World {
            context: Context::new(name, fetch, root),
            surfaces: HashMap::new(),
            plain: HashMap::new(),
            groups: HashMap::new(),
            meshes: HashMap::new(),
            media: HashMap::new(),
            has_media: root.has_any(&|node| node.tag == "medium"),
            has_exteriors: root.has_any(&|node| node.get("name") == Some("exterior")),
            curves: HashMap::new(),
            curve_points: 0,
        }
    }

    /// Reads all of the file. Fails at the first entry that cannot be read.
    pub fn run(mut self, root: &Node) -> Read<Description> {
        if let Some(node) = self.context.twice.take() {
            let found = format!("another element with the id \"{}\"", node.get("id").unwrap_or_default());
            return Err(wrong(&node, found, "an id of its own for each"));
        }
        root.check_elements()?;
        for child in &root.children {
            match child.tag.as_str() {
                "shape" if child.kind() == "shapegroup" => (),
                "shape" => self.shape(child)?,
                "emitter" => lights::add(&mut self.context, child)?,
                "sensor" => camera::add(&mut self.context, child)?,
                "integrator" => {
                    if matches!(child.kind(), "direct" | "ao") {
                        self.context.skip_unsupported(format!("integrator \"{}\": all light is followed", child.kind()));
                    }
                    if boolean(child, "hide_emitters", false)? {
                        self.context.skip_unsupported("\"hide_emitters\": lamps are seen");
                    }
                    let depth = number(child, "max_depth", -1.0)?;
                    if depth >= 1.0 {
                        // Theirs counts what is seen directly as 1.
                        self.context.description.max_depth = Some((depth - 1.0).min(1e6) as u32);
                    }
                }
                _ => (),
            }
        }
        let is_body = |material: &Material| match &material.interior {
            Interior::Body { medium, .. } => medium.is_some(),
            Interior::Sides(sides) => sides.iter().any(Option::is_some),
            _ => false,
        };
        if self.context.has_sensor_in_medium && !self.context.description.materials.iter().any(is_body) {
            self.context.skip_unsupported("the medium around a sensor, which no shape bounds");
        }
        let mut unread = Vec::new();
        root.unread(&mut unread);
        unread.into_iter().for_each(|what| self.context.skip_unsupported(what));
        if !self.context.left_out.is_empty() {
            let list: Vec<String> = self.context.left_out.iter().map(|(what, n)| format!("{what} ({n})")).collect();
            self.context.description.warnings.push(format!("{}: left out: {}", self.context.name, list.join(", ")));
        }
        Ok(self.context.description)
    }

    fn push(&mut self, node: &Node, object: Object) -> Read<()> {
        if self.context.description.objects.len() >= MOST_OBJECTS {
            return Err(wrong(node, format!("more than {MOST_OBJECTS} shapes"), "fewer"));
        }
        self.context.description.objects.push(object);
        Ok(())
    }

    fn shape(&mut self, node: &Arc<Node>) -> Read<()> {
        if node.kind() != "instance" {
            let (shape, material, name) = self.form(node, true)?;
            return self.push(node, Object::new(name, shape, material));
        }
        let group = self.context.nested(node, "shape", None)?.filter(|g| g.kind() == "shapegroup");
        let group = group.ok_or_else(|| wrong(node, "an instance of nothing", "a reference to a shapegroup"))?;
        let id = Arc::as_ptr(&group);
        if !self.groups.contains_key(&id) {
            let mut all = Vec::new();
            for child in &group.children {
                if let Some(shape) = self.context.resolved_if(child, "shape")? {
                    if matches!(shape.kind(), "instance" | "shapegroup") {
                        return Err(wrong(&shape, format!("{} in a shapegroup", shape.kind()), "shapes alone"));
                    }
                    all.push(self.form(&shape, false)?);
                }
            }
            self.groups.insert(id, all);
        }
        let place = affine(transform(node, "to_world")?);
        for (shape, material, name) in self.groups[&id].clone() {
            let shape = match shape {
                Shape::Mesh { mesh, world_from_mesh } => Shape::Mesh { mesh, world_from_mesh: place * world_from_mesh },
                Shape::Curves { curves, world_from_curves } => {
                    Shape::Curves { curves, world_from_curves: place * world_from_curves }
                }
                _ => continue,
            };
            self.push(node, Object::new(name, shape, material))?;
        }
        Ok(())
    }

    /// A shape's form in the world, its material and its name. What is `alone` may be a sphere.
    fn form(&mut self, node: &Arc<Node>, alone: bool) -> Read<(Shape, u32, String)> {
        let place = transform(node, "to_world")?;
        // As Mitsuba has it: normals of spheres, and of meshes from files that have none, turn round where the shape is mirrored, all others do not.
        let is_mirrored = place.determinant() < 0.0;
        let flip = boolean(node, "flip_normals", false)? != (is_mirrored && node.kind() == "sphere");
        let name = node.get("id").map_or_else(|| format!("{} of line {}", node.kind(), node.line), str::to_owned);
        let material = self.material(node)?;
        let shape = match node.kind() {
            "sphere" => {
                let (center, radius) = (values::vector(node, "center", glam::DVec3::ZERO)?, number(node, "radius", 1.0)?);
                if !(radius > 0.0) {
                    return Err(wrong(node, format!("a radius of {radius}"), "a length above 0"));
                }
                let place = place * DMat4::from_translation(center);
                // What has pictures or is brushed needs Mitsuba's texture coordinates.
                let plain = alone && !flip && !self.context.description.materials[material as usize].needs_coordinates();
                match round::sphere_in_world(radius as f32, place) {
                    Some(sphere) if plain => Shape::Sphere(sphere),
                    _ => {
                        // Here v runs from the pole at +z down, in pbrt up.
                        let mut ball = round::ball(radius as f32);
                        ball.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
                        self.mesh(ball, flip, place)
                    }
                }
            }
            "obj" | "ply" | "serialized" => {
                let file = values::text(node, "filename")
                    .ok_or_else(|| wrong(node, "a mesh without filename", "<string name=\"filename\" .../>"))?;
                let flat = boolean(node, "face_normals", false)?;
                let flip_uv = boolean(node, "flip_tex_coords", node.kind() == "obj")?;
                let part = number(node, "shape_index", 0.0)?.clamp(0.0, 1e9) as usize;
                let key = (format!("{} {file} {part} {flip} {is_mirrored}", node.kind()), flat, flip_uv);
                let number = match self.meshes.get(&key) {
                    Some(number) => *number,
                    None => {
                        let bytes = (self.context.fetch)(file)
                            .map_err(|e| wrong(node, format!("{file}: {e}"), "a file that can be read"))?;
                        let mut mesh = shapes::read(node.kind(), bytes, part)
                            .map_err(|e| wrong(node, format!("{file}: {e}"), format!("a {} mesh", node.kind())))?;
                        if flip_uv {
                            mesh.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
                        }
                        let turns = is_mirrored && (flat || mesh.normals.is_empty());
                        // As Mitsuba has it: what has no normals is smoothed, unless told otherwise.
                        if flat {
                            mesh.normals.clear();
                        } else if mesh.normals.is_empty() && node.kind() != "serialized" {
                            mesh.normals = vertex_normals(&mesh);
                        }
                        if flip != turns {
                            round::reverse(&mut mesh);
                        }
                        self.context.description.meshes.push(mesh.into());
                        let number = self.context.description.meshes.len() as u32 - 1;
                        self.meshes.insert(key, number);
                        number
                    }
                };
                Shape::Mesh { mesh: number, world_from_mesh: affine(place) }
            }
            "linearcurve" | "bsplinecurve" => {
                Shape::Curves { curves: self.curves(node, place)?, world_from_curves: Affine3A::IDENTITY }
            }
            kind => {
                let (mesh, own) = shapes::make(node, kind)?;
                self.mesh(mesh, flip, place * own)
            }
        };
        Ok((shape, material, name))
    }

    /// The number of a set of curves.
    fn curves(&mut self, node: &Node, place: DMat4) -> Read<u32> {
        let file = values::text(node, "filename")
            .ok_or_else(|| wrong(node, "curves without filename", "<string name=\"filename\" .../>"))?;
        let key = (format!("{} {file}", node.kind()), place.to_cols_array().map(f64::to_bits));
        if let Some(number) = self.curves.get(&key) {
            return Ok(*number);
        }
        let read = (self.context.fetch)(file).and_then(|bytes| curves::read(&bytes, node.kind() == "bsplinecurve", place));
        let expected = "lines of x, y, z and a radius, an empty one between curves";
        let set = read.map_err(|e| wrong(node, format!("{file}: {e}"), expected))?;
        self.curve_points += set.points.len();
        if self.curve_points > MOST_POINTS {
            return Err(wrong(node, format!("more than {MOST_POINTS} points of curves"), "fewer, or instances of a shapegroup"));
        }
        self.context.description.curves.push(Arc::new(set));
        let number = self.context.description.curves.len() as u32 - 1;
        self.curves.insert(key, number);
        Ok(number)
    }

    fn mesh(&mut self, mut mesh: crate::shape::Mesh, flip: bool, place: DMat4) -> Shape {
        if flip {
            round::reverse(&mut mesh);
        }
        self.context.description.meshes.push(mesh.into());
        Shape::Mesh { mesh: self.context.description.meshes.len() as u32 - 1, world_from_mesh: affine(place) }
    }

    /// A medium; one element is one medium, whoever refers to it.
    fn medium(&mut self, node: &Arc<Node>) -> Read<Arc<Medium>> {
        let key = Arc::as_ptr(node);
        if let Some(known) = self.media.get(&key) {
            return Ok(known.clone());
        }
        let made = Arc::new(media::of(&mut self.context, node)?);
        self.media.insert(key, made.clone());
        Ok(made)
    }

    /// The number of the material of a shape: its BSDF, light and interior.
    fn material(&mut self, node: &Arc<Node>) -> Read<u32> {
        for tag in ["bsdf", "emitter"] {
            let mut count = 0;
            for child in &node.children {
                count += usize::from(self.context.resolved_if(child, tag)?.is_some());
            }
            if count > 1 {
                return Err(wrong(node, format!("{count} {tag}s in one shape"), "one"));
            }
        }
        let bsdf = self.context.nested(node, "bsdf", None)?;
        let emitter = self.context.nested(node, "emitter", None)?;
        let medium = |name: &str| -> Read<Option<Arc<Node>>> { self.context.nested(node, "medium", Some(name)) };
        let (inside, outside) = (medium("interior")?, medium("exterior")?);
        let key = bsdf.as_ref().map_or(std::ptr::null(), Arc::as_ptr);
        let is_plain = emitter.is_none() && inside.is_none() && outside.is_none();
        if let Some(number) = self.plain.get(&key).filter(|_| is_plain) {
            return Ok(*number);
        }
        let surface = match &bsdf {
            // As Mitsuba has it: lamps are black unless told otherwise.
            None if emitter.is_some() => Surface::black(),
            None => Surface::default(),
            Some(bsdf) => match self.surfaces.get(&Arc::as_ptr(bsdf)) {
                Some(known) => known.clone(),
                None => {
                    let made = self.context.bsdf(bsdf, 0)?;
                    self.surfaces.insert(Arc::as_ptr(bsdf), made.clone());
                    made
                }
            },
        };
        let name = bsdf.as_ref().and_then(|b| b.get("id")).unwrap_or("material");
        let mut material =
            Material { coverage: surface.coverage, normal_map: surface.normal_map, ..Material::new(name, surface.scattering) };
        let [inside, outside] = [inside, outside].map(|side| side.map(|n| self.medium(&n)).transpose());
        material.interior = match [inside?, outside?] {
            // As Mitsuba has it: what is around a shape that names no medium goes on within it.
            [None, None] if self.has_media || !surface.is_body => Interior::Same,
            [None, None] => Interior::Body { medium: None, priority: None },
            // Where no face names what is around it, that is what was there before.
            [inside, None] if surface.is_body && !self.has_exteriors => Interior::Body { medium: inside, priority: None },
            sides => Interior::Sides(sides),
        };
        if let Some(emitter) = emitter {
            material.emission = Some(lights::emission(&mut self.context, &emitter)?);
        }
        // Nothing that light would meet, and nothing behind it.
        if matches!(material.scattering, Scattering::Interface) && is_plain {
            self.context.skip_unsupported("surfaces of nothing (null) without media");
        }
        self.context.description.materials.push(material);
        let number = self.context.description.materials.len() as u32 - 1;
        if is_plain {
            self.plain.insert(key, number);
        }
        Ok(number)
    }
}

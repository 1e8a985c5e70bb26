//! glTF 2.0: `.gltf` and `.glb` into a [`Description`].
//!
//! Units are glTF's: metres, candela, lux, cd/m² for emission. Nodes, animations, skins and morph targets are read by `motion`. Extensions:
//! KHR_lights_punctual, KHR_materials_{emissive_strength, ior, transmission, unlit, volume, variants}, those of `material_extensions`,
//! KHR_texture_transform, EXT_mesh_gpu_instancing, EXT_lights_ies, KHR_gaussian_splatting and its SPZ compression (`splats`), and what `packed` unpacks; another one that a file requires is an error, one it only uses a warning. Files are opened by the
//! caller: `fetch` gets the URIs of buffers and images.

mod check;
mod kept;
mod materials;
mod motion;
mod packed;
mod pictures;
mod splats;

use crate::SceneError;
use crate::classes;
use crate::light::photometry::Web;
use crate::light::punctual::Pattern;
use crate::light::{Punctual, PunctualKind, SpotEdge};
use crate::load::{Fetch, finished, note_missing, size_of_aspect};
use crate::material::{Material, Principled, Scattering};
use crate::motion::{Local, Motion, Node};
use crate::scene::{CameraProjection, Description, FilmHints, Object, Shape, Variant, Viewpoint};
use crate::shape::Mesh;
use crate::texture::{Color, Image, Scalar};
use check::{check_accessors, check_attributes, check_container, check_extensions, check_sources, is_supported, label};
use diopter_light::Spectrum;
use glam::{Affine3A, Mat4, Quat, Vec2, Vec3, Vec4};
use pictures::{fetch_uri, read_image};
use rayon::prelude::*;
use serde_json::Value;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Extensions beside those of `material_extensions`, `packed` and `splats`.
const SUPPORTED: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_materials_variants",
    "KHR_texture_transform",
    "EXT_mesh_gpu_instancing",
    "EXT_lights_ies",
];

/// Reads a scene. `name` stands for the file in messages. Fails where the container, its JSON, a buffer or an accessor is damaged or cut short, an extension that is not
/// known is required, or nothing has a surface. Pictures that are missing are warnings.
pub fn load(bytes: &[u8], name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let description = Loader::new(bytes, name, fetch)?.run()?;
    finished(
        description,
        name,
        "a node of the scene with a mesh of triangles or Gaussian splats (points and lines are not drawn)",
    )
}

struct Loader<'a> {
    name: &'a str,
    document: gltf::Document,
    buffers: Vec<Vec<u8>>,
    /// Pictures; none where one is missing.
    images: Vec<Option<Arc<Image>>>,
    description: Description,
    /// What nodes or their ancestors say of their class.
    classes: Vec<Option<Arc<str>>>,
    /// Meshes of the description by (glTF mesh, primitive).
    meshes: HashMap<(usize, usize), u32>,
    default_material: Option<u32>,
    /// Lamps of EXT_lights_ies.
    webs: Vec<Web>,
    /// What primitives say of Gaussian splats, until it is read; the sets that were read; the material of all of them.
    asked_splats: splats::AllAsked,
    captures: HashMap<(usize, usize), u32>,
    captured: Option<u32>,
    /// What the file keeps for diopter alone.
    kept: kept::Kept,
}

/// A normal of length 1. One that has it but for rounding stays as it is: written and read again it is the same.
fn unit(v: Vec3) -> Vec3 {
    if (v.length_squared() - 1.0).abs() < 1e-6 { v } else { v.normalize_or_zero() }
}

/// Gives positions without bounds some. The specification asks for them, but many writers of splats leave them out, and nobody here reads them.
fn add_missing_bounds(json: &mut Value) {
    let list = |v: &Value, key: &str| v.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    let primitives = list(json, "meshes").into_iter().flat_map(|mesh| list(&mesh, "primitives"));
    let positions = primitives.filter_map(|p| p.get("attributes")?.get("POSITION")?.as_u64()).collect::<Vec<_>>();
    let Some(accessors) = json.get_mut("accessors").and_then(Value::as_array_mut) else { return };
    for number in positions {
        let accessor = usize::try_from(number).ok().and_then(|n| accessors.get_mut(n)).and_then(Value::as_object_mut);
        if let Some(accessor) = accessor {
            for key in ["min", "max"] {
                accessor.entry(key).or_insert_with(|| serde_json::json!([0.0, 0.0, 0.0]));
            }
        }
    }
}

/// Leaves out animations of what is no node (KHR_animation_pointer); how many.
fn drop_pointers(json: &mut Value) -> usize {
    let mut dropped = 0;
    let Some(animations) = json.get_mut("animations").and_then(Value::as_array_mut) else { return 0 };
    animations.retain_mut(|animation| {
        let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) else { return true };
        let before = channels.len();
        channels.retain(|c| c.get("target").is_none_or(|t| t.get("node").is_some()));
        dropped += before - channels.len();
        if before == channels.len() {
            return true;
        }
        // Their samplers may be of types that nodes do not have; numbers of the others stay.
        let used: Vec<u64> = channels.iter().filter_map(|c| c.get("sampler")?.as_u64()).collect();
        let samplers = animation.get_mut("samplers").and_then(Value::as_array_mut);
        if let (Some(samplers), Some(first)) = (samplers, used.first())
            && let Some(other) = samplers.get(*first as usize).cloned()
        {
            samplers.iter_mut().enumerate().filter(|(i, _)| !used.contains(&(*i as u64))).for_each(|(_, s)| *s = other.clone());
        }
        !used.is_empty()
    });
    dropped
}

/// Accessors of numbers and vectors without a view are all zeros (glTF 2.0, 3.6.2.3): gives them one.
fn add_missing_views(json: &mut Value, buffers: &mut Vec<Vec<u8>>) {
    /// Bytes of zeros, the most: of an accessor that wants more the reader says that it has none.
    const MOST: u64 = 1 << 20;
    let size = |a: &Value| -> Option<u64> {
        let (components, bytes) = packed::layout(a)?;
        a.get("count")?.as_u64()?.checked_mul((components * bytes) as u64).filter(|n| *n <= MOST)
    };
    let lacks = |a: &Value| a.get("bufferView").is_none() && a.get("sparse").is_none();
    let accessors = json.get("accessors").and_then(Value::as_array);
    let Some(length) = accessors.into_iter().flatten().filter(|a| lacks(a)).filter_map(size).max() else { return };
    let Some(root) = json.as_object_mut() else { return };
    let mut push = |key: &str, value: Value| -> Option<usize> {
        let list = root.entry(key).or_insert_with(|| serde_json::json!([])).as_array_mut()?;
        list.push(value);
        Some(list.len() - 1)
    };
    let Some(buffer) = push("buffers", serde_json::json!({ "byteLength": length })).filter(|i| *i == buffers.len()) else {
        return;
    };
    buffers.push(vec![0; length as usize]);
    let Some(view) = push("bufferViews", serde_json::json!({ "buffer": buffer, "byteLength": length })) else { return };
    let accessors = json.get_mut("accessors").and_then(Value::as_array_mut);
    for accessor in accessors.into_iter().flatten().filter(|a| lacks(a) && size(a).is_some()) {
        accessor["bufferView"] = view.into();
    }
}

/// The parts of all meshes.
fn primitives(json: &Value) -> impl Iterator<Item = &Value> {
    packed::array(json, "meshes").iter().flat_map(|mesh| packed::array(mesh, "primitives"))
}

/// Whether morph targets change colours or texture coordinates.
fn has_other_targets(json: &Value) -> bool {
    let targets = primitives(json).filter_map(|p| p.get("targets")?.as_array()).flatten().filter_map(Value::as_object);
    targets.flat_map(|target| target.keys()).any(|key| key.starts_with("COLOR_") || key.starts_with("TEXCOORD_"))
}

/// Parts of meshes whose materials have textures by a set of coordinates that they have not.
fn parts_without_coordinates(json: &Value) -> usize {
    /// The sets of all textures below a value: of what has an index, 0 where it says nothing.
    fn sets(value: &Value, to: &mut Vec<u64>) {
        match value {
            Value::Object(map) => {
                if map.get("index").is_some_and(Value::is_u64) {
                    let moved = value.pointer("/extensions/KHR_texture_transform/texCoord");
                    to.push(moved.or(map.get("texCoord")).and_then(Value::as_u64).unwrap_or(0));
                }
                map.iter().filter(|(key, _)| *key != "extras").for_each(|(_, v)| sets(v, to));
            }
            Value::Array(list) => list.iter().for_each(|v| sets(v, to)),
            _ => {}
        }
    }
    let of_material: Vec<Vec<u64>> = packed::array(json, "materials")
        .iter()
        .map(|material| {
            let mut all = Vec::new();
            sets(material, &mut all);
            all
        })
        .collect();
    let lacks = |primitive: &&Value| {
        let material = primitive.get("material").and_then(Value::as_u64).and_then(|i| of_material.get(usize::try_from(i).ok()?));
        let has = |set: &u64| primitive.get("attributes").is_some_and(|a| a.get(format!("TEXCOORD_{set}")).is_some());
        material.is_some_and(|sets| !sets.iter().all(has))
    };
    primitives(json).filter(lacks).count()
}

/// Sets of texture coordinates that materials ask for.
fn most_sets(json: &Value) -> u64 {
    match json {
        Value::Object(map) => {
            let own = map.get("texCoord").and_then(Value::as_u64).map_or(0, |set| set.saturating_add(1));
            map.values().map(most_sets).fold(own, u64::max)
        }
        Value::Array(list) => list.iter().map(most_sets).max().unwrap_or(0),
        _ => 0,
    }
}

fn error(name: &str, place: &str, found: impl Into<String>, expected: impl Into<String>) -> SceneError {
    SceneError::File { place: format!("{name}: {place}"), found: found.into(), expected: expected.into() }
}

/// Refuses what says that it is of another generation, or wants a later reader. Source: glTF 2.0, §3.2 (asset).
fn check_version(json: &Value, name: &str) -> Result<(), SceneError> {
    let said = |key: &str| json.get("asset").and_then(|a| a.get(key)).and_then(Value::as_str);
    let numbers = |text: &str| -> Option<[u32; 2]> {
        let (major, minor) = text.split_once('.')?;
        Some([major.parse().ok()?, minor.parse().ok()?])
    };
    let is_other = said("version").and_then(numbers).is_some_and(|[major, _]| major != 2);
    let is_later = said("minVersion").and_then(numbers).is_some_and(|version| version > [2, 0]);
    let (key, found) = match (is_other, is_later) {
        (true, _) => ("version", said("version")),
        (_, true) => ("minVersion", said("minVersion")),
        _ => return Ok(()),
    };
    Err(error(name, "asset", format!("{key} {}", found.unwrap_or_default()), "expected glTF 2.0"))
}

impl<'a> Loader<'a> {
    fn new(bytes: &[u8], name: &'a str, fetch: Fetch) -> Result<Self, SceneError> {
        check_container(bytes, name)?;
        let broken = |e: String| error(name, "JSON", e, "expected a glTF 2.0 file (.gltf or .glb)");
        let (text, mut blob) = match bytes.starts_with(b"glTF") {
            true => {
                let glb = gltf::binary::Glb::from_slice(bytes).map_err(|e| broken(e.to_string()))?;
                (glb.json.into_owned(), glb.bin.map(std::borrow::Cow::into_owned))
            }
            false => (bytes.to_vec(), None),
        };
        let mut json: Value = serde_json::from_slice(&text).map_err(|e| broken(e.to_string()))?;
        drop(text);
        check_version(&json, name)?;
        let names = |json: &Value, key: &str| -> Vec<String> {
            json.get(key).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
        };
        let used = names(&json, "extensionsUsed");
        check_extensions(&names(&json, "extensionsRequired"), name)?;
        if let Some(root) = json.as_object_mut() {
            root.remove("extensionsRequired");
        }
        let mut buffers = Vec::new();
        for (i, buffer) in json.get("buffers").and_then(Value::as_array).into_iter().flatten().enumerate() {
            let place = format!("buffer {i}");
            let data = match buffer.get("uri").map(|u| u.as_str().unwrap_or_default()) {
                Some(uri) => fetch_uri(uri, name, &place, fetch)?,
                None if packed::is_stand_in(buffer) => {
                    buffers.push(Vec::new());
                    continue;
                }
                None => blob
                    .take()
                    .ok_or_else(|| error(name, &place, "the binary chunk is missing", "expected a .glb with a BIN chunk"))?,
            };
            let length = buffer.get("byteLength").and_then(Value::as_u64).unwrap_or(0);
            if (data.len() as u64) < length {
                let found = format!("{} bytes are there", data.len());
                return Err(error(name, &place, found, format!("expected {length}: the file is cut short")));
            }
            buffers.push(data);
        }
        let taken = kept::taken(&json, &buffers);
        if used.iter().any(|e| packed::EXTENSIONS.contains(&e.as_str())) || packed::has_pictures(&json) {
            packed::unpack(&mut json, &mut buffers, name)?;
        }
        add_missing_bounds(&mut json);
        let pointers = drop_pointers(&mut json);
        add_missing_views(&mut json, &mut buffers);
        let most_sets = most_sets(json.get("materials").unwrap_or(&Value::Null));
        let (other_targets, without_coordinates) = (has_other_targets(&json), parts_without_coordinates(&json));
        let asked_splats = splats::taken(&mut json, name)?;
        // As text once more: that reader is compiled with its crate; one of values would be compiled here, and is as large as all of USD's.
        let text = serde_json::to_vec(&json).map_err(|e| broken(e.to_string()))?;
        drop(json);
        let root = gltf::json::Root::from_slice(&text).map_err(|e| {
            // Lines and columns of this text say nothing of the file's.
            broken(e.to_string().split(" at line ").next().unwrap_or_default().to_owned())
        })?;
        drop(text);
        check_sources(&root, name)?;
        check_attributes(&root, name)?;
        let document = gltf::Document::from_json(root).map_err(|e| {
            error(
                name,
                "contents",
                e.to_string(),
                "expected what the glTF 2.0 specification allows; an index may be out of range",
            )
        })?;
        check_accessors(&document, &buffers, name)?;
        let sources: Vec<_> = document.images().collect();
        let read =
            sources.into_par_iter().map(|image| read_image(&image, &buffers, name, fetch)).collect::<Result<Vec<_>, _>>()?;
        let mut description = Description { name: name.to_owned(), ..Default::default() };
        let missing = &mut description.missing_textures;
        let images: Vec<Option<Arc<Image>>> =
            read.into_iter().map(|r| r.map_err(|m| note_missing(missing, &m.name, m.reason)).ok()).collect();
        let kept = taken.and_then(|taken| taken.map_or(Ok(None), |taken| taken.read(&buffers, &images).map(Some)));
        let kept = kept.unwrap_or_else(|why| {
            description.warnings.push(format!("{name}: {why}"));
            None
        });
        if pointers > 0 && !used.iter().any(|e| e == "KHR_animation_pointer") {
            description.warnings.push(format!("{name}: left out: animations of what is no node ({pointers})"));
        }
        if most_sets > 2 {
            description.warnings.push(format!("{name}: of {most_sets} sets of texture coordinates the first two are read"));
        }
        if other_targets {
            description.warnings.push(format!("{name}: left out: colours and texture coordinates of morph targets"));
        }
        if without_coordinates > 0 {
            let parts = if without_coordinates == 1 { "1 mesh".into() } else { format!("{without_coordinates} meshes") };
            let text = "without the texture coordinates that their materials ask for: one texel is all over them";
            description.warnings.push(format!("{name}: {parts} {text}"));
        }
        for extension in used.iter().filter(|e| !is_supported(e)) {
            description.warnings.push(format!("{name}: extension {extension} is not supported; the scene is shown without it"));
        }
        let webs = webs(&document, &buffers, name, fetch)?;
        let (meshes, captures) = (HashMap::new(), HashMap::new());
        let loader = Loader {
            name,
            document,
            buffers,
            images,
            description,
            classes: Vec::new(),
            meshes,
            default_material: None,
            webs,
            asked_splats,
            captures,
            captured: None,
            kept: kept.unwrap_or_default(),
        };
        Ok(loader)
    }

    fn run(mut self) -> Result<Description, SceneError> {
        let document = self.document.clone();
        for material in document.materials() {
            let number = material.index().unwrap_or(usize::MAX);
            let kept = self.kept.materials.get_mut(number).and_then(Option::take);
            let material = kept.map_or_else(|| self.material(&material), Ok)?;
            self.description.materials.push(material);
        }
        let variants =
            document.extension_value("KHR_materials_variants").and_then(|e| e.get("variants")).and_then(Value::as_array);
        for variant in variants.into_iter().flatten() {
            let name = variant.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
            self.description.variants.push(Variant { name, materials: vec![] });
        }
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let Some(scene) = scene else {
            return Err(error(self.name, "scenes", "there is none", "expected a scene with nodes"));
        };
        // Walk the trees with an own stack; a node met twice makes a loop or a lattice, which glTF forbids.
        let mut world = vec![None; document.nodes().count()];
        self.classes = vec![None; world.len()];
        let mut stack: Vec<(gltf::Node, Mat4, Option<Arc<str>>)> = scene.nodes().map(|n| (n, Mat4::IDENTITY, None)).collect();
        let mut order = Vec::new();
        while let Some((node, parent, class)) = stack.pop() {
            let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
            if world[node.index()].replace(here).is_some() {
                let place = format!("node {}{}", node.index(), label(node.name()));
                return Err(error(
                    self.name,
                    &place,
                    "it is reached twice",
                    "expected a tree: a node has one parent and is not its own ancestor",
                ));
            }
            let class = classes::said(node.extras().as_ref().map(|e| e.get())).or(class);
            stack.extend(node.children().map(|c| (c, here, class.clone())));
            self.classes[node.index()] = class;
            order.push(node);
        }
        order.sort_by_key(|n| n.index());
        self.description.splats = std::mem::take(&mut self.kept.splats);
        self.nodes();
        for node in order {
            self.node(&node, &world)?;
        }
        self.animations()?;
        let d = &mut self.description;
        (d.environment, d.air, d.max_depth) = (self.kept.environment.take(), self.kept.air.take(), self.kept.max_depth);
        d.declares_lamps = self.kept.declares_lamps;
        d.curves = std::mem::take(&mut self.kept.curves);
        Ok(self.description)
    }

    fn node(&mut self, node: &gltf::Node, world: &[Option<Mat4>]) -> Result<(), SceneError> {
        let name = node.name().map_or_else(|| format!("node {}", node.index()), str::to_owned);
        let here = world[node.index()].unwrap_or(Mat4::IDENTITY);
        let placed = Affine3A::from_mat4(here);
        if let Some(camera) = node.camera() {
            // Scale of a camera's node has no meaning.
            let (_, rotation, translation) = placed.to_scale_rotation_translation();
            let sight = match camera.projection() {
                gltf::camera::Projection::Perspective(p) => match p.yfov() {
                    vertical_fov if vertical_fov > 1e-4 && vertical_fov < std::f32::consts::PI - 1e-4 => {
                        CameraProjection::Perspective { vertical_fov }
                    }
                    other => {
                        let place = format!("camera {}{}", camera.index(), check::label(camera.name()));
                        return Err(error(
                            self.name,
                            &place,
                            format!("a yfov of {other}"),
                            "expected an angle above 0 and below π",
                        ));
                    }
                },
                gltf::camera::Projection::Orthographic(o) => CameraProjection::Orthographic { height: 2.0 * o.ymag() },
            };
            let aspect = match camera.projection() {
                gltf::camera::Projection::Perspective(p) => p.aspect_ratio(),
                gltf::camera::Projection::Orthographic(o) => Some(o.xmag() / o.ymag()),
            };
            let film = FilmHints { size: aspect.and_then(|aspect| size_of_aspect(f64::from(aspect))), ..FilmHints::default() };
            let plain = Viewpoint {
                name: camera.name().unwrap_or(&name).to_owned(),
                world_from_camera: Affine3A::from_rotation_translation(rotation, translation),
                sight,
                lens: None,
                film,
                node: Some(node.index() as u32),
            };
            self.description.cameras.push(match self.kept.cameras.remove(&node.index()) {
                None => plain,
                Some(kept::KeptCamera { sight, lens, film, place: None }) => Viewpoint { sight, lens, film, ..plain },
                Some(kept::KeptCamera { sight, lens, film, place: Some(world_from_camera) }) => {
                    Viewpoint { world_from_camera, sight, lens, film, node: None, ..plain }
                }
            });
        }
        if let Some(light) = node.light() {
            let plain = punctual(&light, light.name().unwrap_or(&name), node.index() as u32);
            self.description.punctual.push(match self.kept.lights.get(light.index()).cloned().flatten() {
                None => plain,
                // Where it is carried, its node says where it is.
                Some(Punctual { carrier: Some(_), power, modulation, .. }) => Punctual { power, modulation, ..plain },
                Some(kept) => kept,
            });
        }
        if let Some(light) = node.extension_value("EXT_lights_ies") {
            self.measured(light, &name, node.index())?;
        }
        let class = self.classes[node.index()].clone();
        let class = class.or_else(|| classes::said(node.mesh()?.extras().as_ref().map(|e| e.get())));
        match (self.kept.forms.remove(&node.index()), node.mesh().and_then(|m| m.primitives().next())) {
            (Some(kept::Form::Curves(curves, material)), _) => {
                let shape = Shape::Curves { curves: curves as u32, world_from_curves: placed };
                let motion = Motion::Carried { node: node.index() as u32 };
                self.description.objects.push(Object { name, shape, material, motion, class });
                return Ok(());
            }
            (Some(kept::Form::Splats(splats, material)), _) => {
                let shape = Shape::Splats { splats: splats as u32, world_from_splats: placed };
                let motion = Motion::Carried { node: node.index() as u32 };
                self.description.objects.push(Object { name, shape, material, motion, class });
                return Ok(());
            }
            (Some(kept::Form::Sphere(sphere)), Some(primitive)) if let Some(material) = primitive.material().index() => {
                return self.alone(Object { class, ..Object::new(name, Shape::Sphere(sphere), material as u32) }, &primitive);
            }
            (Some(kept::Form::Quad(quad)), Some(primitive)) if let Some(material) = primitive.material().index() => {
                return self.alone(Object { class, ..Object::new(name, Shape::Quad(quad), material as u32) }, &primitive);
            }
            _ => {}
        }
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let instances = self.instances(node)?;
        for primitive in mesh.primitives() {
            let captured = self.splats(&mesh, &primitive)?;
            if captured.is_none()
                && !matches!(
                    primitive.mode(),
                    gltf::mesh::Mode::Triangles | gltf::mesh::Mode::TriangleStrip | gltf::mesh::Mode::TriangleFan
                )
            {
                self.description.warnings.push(format!("mesh \"{}\": points and lines are not drawn", mesh.name().unwrap_or("")));
                continue;
            }
            let material = match (captured, primitive.material().index()) {
                (Some(_), _) => self.captured_material(),
                (None, Some(index)) => index as u32,
                (None, None) => self.default_material(),
            };
            let carried = Motion::Carried { node: node.index() as u32 };
            let (number, motion) = match captured {
                Some(number) => (number, carried),
                None => {
                    let number = self.mesh(&mesh, &primitive)?;
                    let deformer = self.deformer(node, &mesh, &primitive, number, world)?;
                    (number, deformer.map_or(carried, |deformer| Motion::Deformed { deformer }))
                }
            };
            let shape = |place: Affine3A| match captured {
                Some(splats) => Shape::Splats { splats, world_from_splats: place },
                None => Shape::Mesh { mesh: number, world_from_mesh: place },
            };
            let first = self.description.objects.len() as u32;
            match (&instances, motion) {
                (Some(all), Motion::Carried { node: parent }) => {
                    for place in all {
                        let own = self.description.nodes.len() as u32;
                        let rest = Local::Matrix(*place);
                        self.description.nodes.push(Node { parent: Some(parent), rest, ..Node::new(&name) });
                        let motion = Motion::Carried { node: own };
                        let shape = shape(placed * *place);
                        let class = class.clone();
                        self.description.objects.push(Object { name: name.clone(), shape, material, motion, class });
                    }
                }
                (all, _) => {
                    if all.is_some() {
                        let text =
                            format!("node {}: one copy instead of its instances: they are of a mesh that bends", node.index());
                        self.description.warnings.push(text);
                    }
                    let (name, class, shape) = (name.clone(), class.clone(), shape(placed));
                    self.description.objects.push(Object { name, shape, material, motion, class });
                }
            }
            let objects = first..self.description.objects.len() as u32;
            self.other_materials(&primitive, objects)?;
        }
        Ok(())
    }

    /// A lamp of EXT_lights_ies: aimed along −z of its node, as measured.
    fn measured(&mut self, light: &Value, name: &str, node: usize) -> Result<(), SceneError> {
        let number = light.get("light").and_then(Value::as_u64);
        let Some(web) = number.and_then(|n| self.webs.get(usize::try_from(n).ok()?)) else {
            let found = format!("light profile {}", number.map_or("none".into(), |n| n.to_string()));
            let expected = format!("expected a number below {}, that of EXT_lights_ies.lights", self.webs.len());
            return Err(error(self.name, &format!("node {node}"), found, expected));
        };
        let multiplier = light.get("multiplier").and_then(Value::as_f64).unwrap_or(1.0).max(0.0) as f32;
        let channel = |i: usize| light.get("color").and_then(|c| c.get(i)).and_then(Value::as_f64).unwrap_or(1.0);
        let color = Vec3::new(channel(0) as f32, channel(1) as f32, channel(2) as f32).clamp(Vec3::ZERO, Vec3::ONE);
        let power = Spectrum::light_from_rgb(color * (multiplier * web.peak()));
        let pattern = Some(Arc::new(Pattern::measured(web.clone(), glam::Mat3::IDENTITY)));
        let kind = PunctualKind::Point { position: Vec3::ZERO };
        self.description.punctual.push(Punctual { carrier: Some(node as u32), pattern, ..Punctual::new(name, power, kind) });
        Ok(())
    }

    /// Places of the copies of a node's mesh (EXT_mesh_gpu_instancing).
    fn instances(&self, node: &gltf::Node) -> Result<Option<Vec<Affine3A>>, SceneError> {
        let Some(attributes) = node.extension_value("EXT_mesh_gpu_instancing").and_then(|e| e.get("attributes")) else {
            return Ok(None);
        };
        let place = format!("node {} (instances)", node.index());
        let numbers = |key: &str, width: usize| -> Result<Option<Vec<f32>>, SceneError> {
            let Some(number) = attributes.get(key).and_then(Value::as_u64) else { return Ok(None) };
            let accessor = self.document.accessors().nth(number as usize);
            let kind = if width == 3 { gltf::accessor::Dimensions::Vec3 } else { gltf::accessor::Dimensions::Vec4 };
            use gltf::accessor::DataType;
            let may_be =
                |data: DataType| data == DataType::F32 || (key == "ROTATION" && matches!(data, DataType::I8 | DataType::I16));
            let accessor = accessor.filter(|a| a.dimensions() == kind && may_be(a.data_type())).ok_or_else(|| {
                error(self.name, &place, format!("{key} {number}"), "expected an accessor of vectors of numbers")
            })?;
            let data = |b: gltf::Buffer| self.buffers.get(b.index()).map(Vec::as_slice);
            let read: Option<Vec<f32>> = match width {
                3 => gltf::accessor::Iter::<[f32; 3]>::new(accessor, data).map(|it| it.flatten().collect()),
                // Normalised, to unit length by who reads it.
                _ if accessor.data_type() == DataType::I8 => gltf::accessor::Iter::<[i8; 4]>::new(accessor, data)
                    .map(|it| it.flatten().map(|v| (f32::from(v) / 127.0).max(-1.0)).collect()),
                _ if accessor.data_type() == DataType::I16 => gltf::accessor::Iter::<[i16; 4]>::new(accessor, data)
                    .map(|it| it.flatten().map(|v| (f32::from(v) / 32767.0).max(-1.0)).collect()),
                _ => gltf::accessor::Iter::<[f32; 4]>::new(accessor, data).map(|it| it.flatten().collect()),
            };
            Ok(Some(read.unwrap_or_default()))
        };
        let (shifts, turns, scales) = (numbers("TRANSLATION", 3)?, numbers("ROTATION", 4)?, numbers("SCALE", 3)?);
        let counts =
            [shifts.as_ref().map(|v| v.len() / 3), turns.as_ref().map(|v| v.len() / 4), scales.as_ref().map(|v| v.len() / 3)];
        let count = counts.into_iter().flatten().next().unwrap_or(0);
        if counts.into_iter().flatten().any(|c| c != count) {
            return Err(error(self.name, &place, format!("{counts:?} places, turns and scales"), "expected as many of each"));
        }
        let one = |i: usize| {
            let shift = shifts.as_ref().map_or(Vec3::ZERO, |v| Vec3::from_slice(&v[3 * i..]));
            let turn = turns.as_ref().map_or(Quat::IDENTITY, |v| Quat::from_slice(&v[4 * i..]));
            let scale = scales.as_ref().map_or(Vec3::ONE, |v| Vec3::from_slice(&v[3 * i..]));
            let turn = if turn.length_squared() > 0.0 { turn.normalize() } else { Quat::IDENTITY };
            Affine3A::from_scale_rotation_translation(scale, turn, shift)
        };
        Ok(Some((0..count).map(one).collect()))
    }

    /// Adds an object that stands for a primitive.
    fn alone(&mut self, object: Object, primitive: &gltf::Primitive) -> Result<(), SceneError> {
        let first = self.description.objects.len() as u32;
        self.description.objects.push(object);
        self.other_materials(primitive, first..first + 1)
    }

    /// Notes which materials the variants of a file give to objects (KHR_materials_variants).
    fn other_materials(&mut self, primitive: &gltf::Primitive, objects: Range<u32>) -> Result<(), SceneError> {
        let mappings =
            primitive.extension_value("KHR_materials_variants").and_then(|e| e.get("mappings")).and_then(Value::as_array);
        for mapping in mappings.into_iter().flatten() {
            let material = mapping.get("material").and_then(Value::as_u64).unwrap_or(u64::MAX);
            if material >= self.document.materials().count() as u64 {
                let found = format!("material {material} of a variant");
                return Err(error(
                    self.name,
                    "variants",
                    found,
                    format!("expected less than {}", self.document.materials().count()),
                ));
            }
            for variant in mapping.get("variants").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_u64) {
                if let Some(variant) = self.description.variants.get_mut(variant as usize) {
                    variant.materials.extend(objects.clone().map(|o| (o, material as u32)));
                }
            }
        }
        Ok(())
    }

    fn default_material(&mut self) -> u32 {
        if let Some(number) = self.default_material {
            return number;
        }
        let principled = Principled { metallic: Scalar::Constant(1.0), ..Principled::new(Color::rgb(1.0, 1.0, 1.0), 1.5) };
        self.description.materials.push(Material::new("glTF default", Scattering::Principled(Box::new(principled))));
        let number = self.description.materials.len() as u32 - 1;
        self.default_material = Some(number);
        number
    }

    fn mesh(&mut self, mesh: &gltf::Mesh, primitive: &gltf::Primitive) -> Result<u32, SceneError> {
        let key = (mesh.index(), primitive.index());
        if let Some(number) = self.meshes.get(&key) {
            return Ok(*number);
        }
        let read = self.read_mesh(mesh, primitive)?;
        self.description.meshes.push(read.into());
        let number = self.description.meshes.len() as u32 - 1;
        self.meshes.insert(key, number);
        Ok(number)
    }

    fn read_mesh(&mut self, mesh: &gltf::Mesh, primitive: &gltf::Primitive) -> Result<Mesh, SceneError> {
        let place = format!("mesh {}{} primitive {}", mesh.index(), label(mesh.name()), primitive.index());
        let reader = primitive.reader(|b| self.buffers.get(b.index()).map(Vec::as_slice));
        let positions: Vec<Vec3> = match reader.read_positions() {
            Some(p) => p.map(Vec3::from_array).collect(),
            None => return Err(error(self.name, &place, "it has no positions", "expected a POSITION attribute")),
        };
        let n = positions.len();
        let fits = |what: &str, len: usize, warnings: &mut Vec<String>| {
            if len != n {
                warnings.push(format!("{place}: {len} {what} for {n} positions were left out"));
            }
            len == n
        };
        let mut warnings = Vec::new();
        let mut normals: Vec<Vec3> =
            reader.read_normals().map(|it| it.map(|v| unit(Vec3::from_array(v))).collect()).unwrap_or_default();
        if !normals.is_empty() && !fits("normals", normals.len(), &mut warnings) {
            normals.clear();
        }
        let mut tangents: Vec<Vec4> = reader.read_tangents().map(|it| it.map(Vec4::from_array).collect()).unwrap_or_default();
        if !tangents.is_empty() && !fits("tangents", tangents.len(), &mut warnings) {
            tangents.clear();
        }
        let mut colors: Vec<Vec4> =
            reader.read_colors(0).map(|it| it.into_rgba_f32().map(Vec4::from_array).collect()).unwrap_or_default();
        if !colors.is_empty() && !fits("colours", colors.len(), &mut warnings) {
            colors.clear();
        }
        let uvs = [0, 1].map(|set| {
            let uv: Vec<Vec2> =
                reader.read_tex_coords(set).map(|it| it.into_f32().map(Vec2::from_array).collect()).unwrap_or_default();
            if uv.is_empty() || fits("texture coordinates", uv.len(), &mut warnings) { uv } else { Vec::new() }
        });
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..n as u32).collect(),
        };
        if let Some(bad) = indices.iter().find(|i| **i as usize >= n) {
            return Err(error(
                self.name,
                &place,
                format!("index {bad}"),
                format!("expected less than {n}, the number of positions"),
            ));
        }
        let triangles = match primitive.mode() {
            gltf::mesh::Mode::TriangleStrip => indices
                .windows(3)
                .enumerate()
                .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] })
                .collect(),
            gltf::mesh::Mode::TriangleFan => indices.windows(2).skip(1).map(|t| [indices[0], t[0], t[1]]).collect(),
            _ => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        };
        self.description.warnings.extend(warnings);
        Ok(Mesh { positions, normals, tangents, uvs, colors, triangles })
    }
}

/// The IES files of EXT_lights_ies.
fn webs(document: &gltf::Document, buffers: &[Vec<u8>], name: &str, fetch: Fetch) -> Result<Vec<Web>, SceneError> {
    let listed = document.extension_value("EXT_lights_ies").and_then(|e| e.get("lights")).and_then(Value::as_array);
    let read = |(i, profile): (usize, &Value)| {
        let place = format!("light profile {i}");
        let bytes = match (profile.get("uri").and_then(Value::as_str), profile.get("bufferView").and_then(Value::as_u64)) {
            (Some(uri), _) => fetch_uri(uri, name, &place, fetch)?,
            (None, Some(view)) => {
                let view = document.views().nth(usize::try_from(view).unwrap_or(usize::MAX));
                let data =
                    view.and_then(|v| buffers.get(v.buffer().index())?.get(v.offset()..v.offset().checked_add(v.length())?));
                let expected = "expected bytes within the buffer";
                data.ok_or_else(|| error(name, &place, "its buffer view is out of range", expected))?.to_vec()
            }
            (None, None) => return Err(error(name, &place, "neither uri nor bufferView", "expected one of the two")),
        };
        Web::read(&bytes).map_err(|e| error(name, &place, e.found, format!("expected {}", e.expected)))
    };
    listed.into_iter().flatten().enumerate().map(read).collect()
}

fn punctual(light: &gltf::khr_lights_punctual::Light, name: &str, node: u32) -> Punctual {
    use gltf::khr_lights_punctual::Kind;
    let power = Spectrum::light_from_rgb(Vec3::from_array(light.color()) * light.intensity());
    // In the space of the node.
    let (position, direction) = (Vec3::ZERO, Vec3::NEG_Z);
    let kind = match light.kind() {
        Kind::Directional => PunctualKind::Directional { direction },
        Kind::Point => PunctualKind::Point { position },
        Kind::Spot { inner_cone_angle, outer_cone_angle } => PunctualKind::Spot {
            position,
            direction,
            cos_inner: inner_cone_angle.cos(),
            cos_outer: outer_cone_angle.cos(),
            edge: SpotEdge::Squared,
        },
    };
    Punctual { carrier: Some(node), ..Punctual::new(name, power, kind) }
}

#[cfg(test)]
mod tests;

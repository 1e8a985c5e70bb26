//! A [`Description`] as glTF 2.0, so that what came in another format can go on to other programs.
//!
//! Written: meshes (balls and parallelograms as triangles), materials as glTF can say them, pictures, lights, cameras, and what moves as a whole with its
//! key frames, and meshes that bend with their skins and morph targets. What glTF cannot say is simplified and told: media that scatter, spectra (as linear
//! sRGB). Beside it, in `extras`, stands all of it as diopter has it (`crate::exact`), also what glTF has no words for at all: surroundings, air, curves. Other programs
//! skip that; our own reader takes it.

mod materials;
mod motion;
mod pictures;
mod splats;

use crate::exact::{Exact, KEY, Sink, Store, Tables, VERSION, fingerprint};
use crate::light::environment::direction;
use crate::light::punctual::Spread;
use crate::light::{Punctual, PunctualKind};
use crate::motion::Motion;
use crate::scene::{CameraProjection, Description, Object, Shape};
use crate::shape::Mesh;
use crate::texture::{Image, Texel};
use diopter_light::Spectrum;
use diopter_light::color::srgb_of_light;
use glam::{Affine3A, Mat4, Vec2, Vec3};
use motion::MovingNodes;
use serde_json::{Value, json};
use std::collections::{BTreeSet, HashMap};
use std::f32::consts::PI;
use std::sync::Arc;

/// A scene in glTF's two parts.
#[derive(Debug)]
pub struct Gltf {
    /// The text; its one buffer has no name yet.
    pub json: Value,
    /// The buffer.
    pub binary: Vec<u8>,
    /// What could not be said.
    pub warnings: Vec<String>,
}

impl Gltf {
    /// Both in one `.glb`.
    pub fn container(&self) -> Vec<u8> {
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut binary = self.binary.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut out = Vec::with_capacity(28 + text.len() + binary.len());
        let total = 20 + text.len() + if binary.is_empty() { 0 } else { 8 + binary.len() };
        let word = |out: &mut Vec<u8>, v: usize| out.extend((v as u32).to_le_bytes());
        out.extend(b"glTF");
        word(&mut out, 2);
        word(&mut out, total);
        word(&mut out, text.len());
        out.extend(b"JSON");
        out.extend(text);
        if !binary.is_empty() {
            word(&mut out, binary.len());
            out.extend(b"BIN\0");
            out.extend(binary);
        }
        out
    }

    /// The text with the buffer under a name beside it.
    pub fn text(&self, buffer: &str) -> String {
        let mut json = self.json.clone();
        json["buffers"][0]["uri"] = json!(buffer);
        serde_json::to_string_pretty(&json).unwrap_or_default()
    }
}

#[derive(Default)]
struct Writer {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    textures: Vec<Value>,
    samplers: Vec<Value>,
    extensions: BTreeSet<&'static str>,
    /// Numbers of pictures that were written already.
    known: HashMap<usize, usize>,
    /// What other programs see simplified.
    warnings: BTreeSet<String>,
    /// What our own reader does not get back either.
    lost: BTreeSet<String>,
    /// What is kept in extras.
    tables: Tables,
    /// Pictures that PNG cannot hold, by their numbers.
    raw_pictures: serde_json::Map<String, Value>,
}

impl Store for Writer {
    fn bytes(&mut self, bytes: Vec<u8>) -> usize {
        self.view(bytes, None)
    }

    fn picture(&mut self, image: &Arc<Image>) -> usize {
        let number = self.image(image);
        let key = number.to_string();
        if !self.raw_pictures.contains_key(&key) {
            let all = || (0..image.height).flat_map(|row| (0..image.width).map(move |column| image.texel(column, row)));
            let (bytes, is_wide): (Vec<u8>, bool) = match image.texel(0, 0) {
                Texel::Codes(_) | Texel::Codes16(_) => return number,
                Texel::Wide(_) => {
                    let words = |t| if let Texel::Wide(words) = t { words } else { [0; 4] };
                    (all().flat_map(words).flat_map(u16::to_le_bytes).collect(), true)
                }
                Texel::Linear(_) => {
                    let numbers = |t| if let Texel::Linear(numbers) = t { numbers } else { [0.0; 4] };
                    (all().flat_map(numbers).flat_map(f32::to_le_bytes).collect(), false)
                }
            };
            let view = self.view(bytes, None);
            let picture = json!({ "size": [image.width, image.height], "wide": is_wide, "texels": { "view": view } });
            self.raw_pictures.insert(key, picture);
        }
        number
    }
}

/// Turns a scene into glTF.
pub fn gltf(d: &Description) -> Gltf {
    let mut w = Writer::default();
    let timeline = d.timeline();
    let mut moving = MovingNodes::new(d, &timeline);
    let mut materials: Vec<Value> = d.materials.iter().map(|m| w.material(m)).collect();
    for (m, json) in d.materials.iter().zip(&mut materials) {
        w.keep(m, json, None);
    }
    let (mut meshes, mut nodes): (Vec<Value>, Vec<Value>) = (Vec::new(), Vec::new());
    // A mesh of glTF for each of ours with each material, and with each choice of others.
    let mut numbers: HashMap<(u32, u32, &Choice), usize> = HashMap::new();
    let choices = choices(d);
    let mut attributes: HashMap<u32, Value> = HashMap::new();
    let (mut curves, mut numbers_of_curves) = (Vec::new(), HashMap::new());
    let (mut splats, mut numbers_of_splats) = (Vec::new(), HashMap::new());
    // Hangs a node on what carries it, or puts it where it stands.
    let stand = |moving: &mut MovingNodes, nodes: &mut Vec<Value>, mut node: Value, motion: Motion, own: Affine3A| match motion {
        Motion::Carried { node: carrier } if moving.holds(carrier) => moving.hang(carrier, nodes, node),
        motion => {
            let place = if let Motion::Carried { node } = motion { timeline.world(node, 0.0) } else { own };
            node["matrix"] = json!(Mat4::from(place).to_cols_array());
            nodes.push(node);
        }
    };
    for (object, chosen) in d.objects.iter().zip(&choices) {
        if let (Shape::Mesh { mesh, .. }, Motion::Deformed { deformer }) = (object.shape, object.motion)
            && !d.meshes[mesh as usize].triangles.is_empty()
            && moving.can_bend(&d.deformers[deformer as usize])
        {
            let (rest, deformer) = (&d.meshes[mesh as usize], &d.deformers[deformer as usize]);
            let bending = w.deformer(deformer, rest.positions.len());
            let mut written = attributes.entry(mesh).or_insert_with(|| w.mesh(rest)).clone();
            for (name, accessor) in &bending.attributes {
                written["attributes"][name] = accessor.clone();
            }
            if !bending.targets.is_empty() {
                written["targets"] = json!(bending.targets);
            }
            meshes.push(primitive(written, object.material, &object.name, chosen));
            moving.bend(deformer, &bending, &mut nodes, meshes.len() - 1, &object.name);
            if let Some(node) = nodes.last_mut() {
                classify(object, node);
            }
            continue;
        }
        let (mesh, place) = match object.shape {
            Shape::Mesh { mesh, .. } if d.meshes[mesh as usize].triangles.is_empty() => continue,
            Shape::Mesh { mesh, world_from_mesh } => {
                let place = match object.motion {
                    Motion::Still => world_from_mesh,
                    Motion::Carried { node } => timeline.world(node, 0.0),
                    Motion::Deformed { .. } => {
                        w.lost.insert("meshes that bend with nodes that somebody else moves are written at rest".into());
                        world_from_mesh
                    }
                };
                let number = *numbers.entry((mesh, object.material, chosen)).or_insert_with(|| {
                    let written = attributes.entry(mesh).or_insert_with(|| w.mesh(&d.meshes[mesh as usize])).clone();
                    meshes.push(primitive(written, object.material, &object.name, chosen));
                    meshes.len() - 1
                });
                (number, place)
            }
            Shape::Curves { curves: set, world_from_curves } => {
                w.warn("curves (hair, fur, grass): glTF has none");
                let number = *numbers_of_curves.entry(set).or_insert_with(|| {
                    curves.push(w.exact(&*d.curves[set as usize]));
                    curves.len() - 1
                });
                let mut node = json!({ "name": object.name,
                    "extras": { KEY: { "curves": number, "material": object.material } } });
                classify(object, &mut node);
                stand(&mut moving, &mut nodes, node, object.motion, world_from_curves);
                continue;
            }
            // A set without Gaussians is nothing to glTF.
            Shape::Splats { splats: set, .. } if d.splats[set as usize].is_empty() => continue,
            Shape::Splats { splats: set, world_from_splats } => {
                if !chosen.is_empty() {
                    w.lost.insert("variants of Gaussian splats are not written".into());
                }
                let (number, mesh) = *numbers_of_splats.entry(set).or_insert_with(|| {
                    let written = w.splats(&d.splats[set as usize]);
                    meshes.push(primitive(written, object.material, &object.name, &[]));
                    splats.push(w.exact(&*d.splats[set as usize]));
                    (splats.len() - 1, meshes.len() - 1)
                });
                let mut node = json!({ "name": object.name, "mesh": mesh,
                    "extras": { KEY: { "splats": number, "material": object.material } } });
                classify(object, &mut node);
                stand(&mut moving, &mut nodes, node, object.motion, world_from_splats);
                continue;
            }
            Shape::Sphere(s) => {
                // One ball for all.
                let number = *numbers.entry((BALL, object.material, chosen)).or_insert_with(|| {
                    let written = attributes.entry(BALL).or_insert_with(|| w.mesh(&ball())).clone();
                    meshes.push(primitive(written, object.material, &object.name, chosen));
                    meshes.len() - 1
                });
                (number, Affine3A::from_scale_rotation_translation(Vec3::splat(s.radius), glam::Quat::IDENTITY, s.center))
            }
            Shape::Quad(q) => {
                let at = |u: f32, v: f32| q.point(Vec2::new(u, v));
                let uv = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
                let mesh = Mesh {
                    positions: vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)],
                    uvs: [uv, vec![]],
                    triangles: vec![[0, 1, 2], [0, 2, 3]],
                    ..Default::default()
                };
                let written = w.mesh(&mesh);
                meshes.push(primitive(written, object.material, &object.name, chosen));
                (meshes.len() - 1, Affine3A::IDENTITY)
            }
        };
        match object.motion {
            Motion::Carried { node } if moving.holds(node) => {
                let mut hung = json!({ "name": object.name, "mesh": mesh });
                classify(object, &mut hung);
                moving.hang(node, &mut nodes, hung);
            }
            _ => {
                let mut node = json!({ "name": object.name, "mesh": mesh, "matrix": Mat4::from(place).to_cols_array() });
                match object.shape {
                    Shape::Sphere(s) => w.keep(&s, &mut node, Some("sphere")),
                    Shape::Quad(q) => w.keep(&q, &mut node, Some("quad")),
                    _ => {}
                }
                classify(object, &mut node);
                nodes.push(node);
            }
        }
    }
    let mut lights = Vec::new();
    for light in &d.punctual {
        // In the space of what it hangs on, if that moves.
        let carrier = light.carrier.filter(|node| moving.holds(*node));
        let still = light.carrier.filter(|_| carrier.is_none()).map(|node| light.placed(&timeline.world(node, 0.0)));
        let (mut light_json, place) = w.light(still.as_ref().unwrap_or(light));
        let kept = match &still {
            Some(placed) => Punctual { carrier: None, ..placed.clone() },
            None => light.clone(),
        };
        w.keep(&kept, &mut light_json, None);
        let node = json!({ "name": light.name, "matrix": Mat4::from(place).to_cols_array(),
            "extensions": { "KHR_lights_punctual": { "light": lights.len() } } });
        match carrier {
            Some(carrier) => moving.hang(carrier, &mut nodes, node),
            None => nodes.push(node),
        }
        lights.push(light_json);
    }
    let mut cameras = Vec::new();
    for view in &d.cameras {
        let camera = match &view.sight {
            CameraProjection::Perspective { vertical_fov } => {
                json!({ "type": "perspective", "perspective": { "yfov": vertical_fov, "znear": 0.01 } })
            }
            CameraProjection::Orthographic { height } => {
                let ymag = 0.5 * height;
                json!({ "type": "orthographic", "orthographic": { "xmag": ymag * 1.5, "ymag": ymag, "znear": 0.01, "zfar": 1e4 } })
            }
            CameraProjection::Panorama | CameraProjection::Table(_) => {
                w.warn("a camera that glTF has no words for is written with an angle of view of 40°");
                json!({ "type": "perspective", "perspective": { "yfov": 40f32.to_radians(), "znear": 0.01 } })
            }
        };
        if view.film.shift != [0.0; 2] {
            w.warn("other programs see the shift of a camera's lens as none: glTF has no words for it");
        }
        let place = view.node.map_or(view.world_from_camera, |node| timeline.world(node, 0.0));
        let carrier = view.node.filter(|node| moving.holds(*node));
        let kept = [
            ("sight", w.exact(&view.sight)),
            ("lens", w.exact(&view.lens)),
            ("film", w.exact(&view.film)),
            ("place", w.exact(&carrier.is_none().then_some(view.world_from_camera))),
        ];
        let kept: Value = kept.into_iter().map(|(key, v)| (key.to_owned(), v)).collect();
        let mut node = json!({ "name": view.name, "camera": cameras.len(), "extras": { KEY: { "camera": kept } } });
        match carrier {
            Some(carrier) => moving.hang(carrier, &mut nodes, node),
            None => {
                node["matrix"] = json!(Mat4::from(place).to_cols_array());
                nodes.push(node);
            }
        }
        cameras.push(camera);
    }
    if d.environment.is_some() {
        w.warn("surroundings: glTF has no agreed words for them");
    }
    if d.air.is_some() {
        w.warn("what fills the air: glTF has no words for it");
    }
    let environment = w.exact(&d.environment);
    let air = w.exact(&d.air);
    if !lights.is_empty() {
        w.extensions.insert("KHR_lights_punctual");
    }
    if !d.variants.is_empty() {
        w.extensions.insert(VARIANTS);
    }
    let (animations, playing) = moving.animations(&mut w);
    let roots: Vec<usize> = (0..nodes.len()).filter(|n| !moving.children.contains(n)).collect();
    let mut json = json!({
        "asset": { "version": "2.0", "generator": concat!("diopter ", env!("CARGO_PKG_VERSION")) },
        "scene": 0, "scenes": [{ "name": d.name, "nodes": roots }],
        "nodes": nodes,
    });
    if !animations.is_empty() {
        json["scenes"][0]["extras"] = json!({ "diopter_playing": playing });
    }
    let parts = [
        ("meshes", meshes),
        ("materials", materials),
        ("accessors", w.accessors),
        ("bufferViews", w.views),
        ("images", w.images),
        ("textures", w.textures),
        ("samplers", w.samplers),
        ("cameras", cameras),
        ("skins", std::mem::take(&mut moving.skins)),
        ("animations", animations),
    ];
    for (key, list) in parts {
        if !list.is_empty() {
            json[key] = Value::Array(list);
        }
    }
    if !w.binary.is_empty() {
        json["buffers"] = json!([{ "byteLength": w.binary.len() }]);
    }
    if !lights.is_empty() {
        json["extensions"]["KHR_lights_punctual"] = json!({ "lights": lights });
    }
    if !d.variants.is_empty() {
        let names: Vec<Value> = d.variants.iter().map(|v| json!({ "name": v.name })).collect();
        json["extensions"][VARIANTS] = json!({ "variants": names });
    }
    if !w.extensions.is_empty() {
        json["extensionsUsed"] = json!(w.extensions);
    }
    let Tables { media, graphs, measured, .. } = w.tables;
    json["extras"] = json!({ KEY: {
        "version": VERSION,
        "media": media,
        "graphs": graphs,
        "measured": measured,
        "pictures": w.raw_pictures,
        "curves": curves,
        "splats": splats,
        "environment": environment,
        "air": air,
        "declares_lamps": d.declares_lamps,
        "max_depth": d.max_depth.map_or(json!(null), |depth| json!([depth])),
    } });
    json["extras"][KEY]["fingerprint"] = json!(fingerprint(&json, &w.binary));
    let mut warnings: Vec<String> = w.lost.into_iter().collect();
    if !w.warnings.is_empty() {
        let all: Vec<String> = w.warnings.into_iter().collect();
        warnings.push(format!("for other programs than diopter, which reads it back from extras as it was: {}", all.join("; ")));
    }
    Gltf { json, binary: w.binary, warnings }
}

/// Number that stands for the ball among meshes.
const BALL: u32 = u32::MAX;

/// Says the class of an object in its node.
fn classify(object: &Object, node: &mut Value) {
    if let Some(class) = &object.class {
        node["extras"]["class"] = json!(**class);
    }
}

/// A mesh of one primitive; `chosen` are materials that variants give it, as [`choices`].
fn primitive(mut written: Value, material: u32, name: &str, chosen: &Choice) -> Value {
    written["material"] = json!(material);
    if !chosen.is_empty() {
        let mapping = |(variant, material): &(u32, u32)| json!({ "material": material, "variants": [variant] });
        let mappings: Vec<Value> = chosen.iter().map(mapping).collect();
        written["extensions"][VARIANTS] = json!({ "mappings": mappings });
    }
    json!({ "name": name, "primitives": [written] })
}

/// The extension that lets one choose among sets of materials.
const VARIANTS: &str = "KHR_materials_variants";

/// Variants and the materials that they give an object.
type Choice = [(u32, u32)];

/// The choice that each object has.
fn choices(d: &Description) -> Vec<Vec<(u32, u32)>> {
    let mut all = vec![vec![]; d.objects.len()];
    for (number, variant) in d.variants.iter().enumerate() {
        for (object, material) in &variant.materials {
            if let Some(own) = all.get_mut(*object as usize) {
                own.push((number as u32, *material));
            }
        }
    }
    all
}

/// A ball of radius 1, fine enough to be taken for round; texture coordinates are those of our spheres.
fn ball() -> Mesh {
    const AROUND: usize = 64;
    let mut mesh = Mesh::default();
    for j in 0..=AROUND / 2 {
        for i in 0..=AROUND {
            let (u, v) = (i as f32 / AROUND as f32, j as f32 / (AROUND / 2) as f32);
            let n = direction(Vec2::new(u, v));
            mesh.positions.push(n);
            mesh.normals.push(n);
            mesh.uvs[0].push(Vec2::new(u, v));
        }
    }
    let at = |i: usize, j: usize| (j * (AROUND + 1) + i) as u32;
    for j in 0..AROUND / 2 {
        for i in 0..AROUND {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh.drop_unusable_triangles();
    mesh
}

/// Linear sRGB of light, cd/m² (or cd, lx), as glTF has it: not negative.
fn light_rgb(spectrum: &Spectrum) -> Vec3 {
    srgb_of_light(|nm| spectrum.at(nm)).max(Vec3::ZERO)
}

fn clamped(rgb: Vec3) -> [f32; 3] {
    rgb.clamp(Vec3::ZERO, Vec3::ONE).to_array()
}

impl Writer {
    /// A value as it is.
    fn exact(&mut self, value: &impl Exact) -> Value {
        let mut tables = std::mem::take(&mut self.tables);
        let written = value.write(&mut Sink { store: self, tables: &mut tables });
        self.tables = tables;
        written
    }

    /// Keeps a value in the extras of what stands for it in glTF, under a name if there may be others.
    fn keep(&mut self, value: &impl Exact, json: &mut Value, name: Option<&str>) {
        let written = self.exact(value);
        match name {
            Some(name) => json["extras"][KEY][name] = written,
            None => json["extras"][KEY] = written,
        }
    }

    fn warn(&mut self, text: &str) {
        self.warnings.insert(text.to_owned());
    }

    fn view(&mut self, bytes: impl IntoIterator<Item = u8>, target: Option<u32>) -> usize {
        let offset = self.binary.len().next_multiple_of(4);
        self.binary.resize(offset, 0);
        self.binary.extend(bytes);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": self.binary.len() - offset });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn vectors<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let view = self.view(values.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(34_962));
        self.accessors
            .push(json!({ "bufferView": view, "componentType": 5126, "count": values.len(), "type": format!("VEC{N}") }));
        self.accessors.len() - 1
    }

    /// An accessor of numbers that are no corners, so many to an element.
    fn numbers(&mut self, values: &[f32], width: usize) -> usize {
        let view = self.view(values.iter().flat_map(|v| v.to_le_bytes()), None);
        let kind = if width == 1 { "SCALAR".to_owned() } else { format!("VEC{width}") };
        self.accessors.push(json!({ "bufferView": view, "componentType": 5126, "count": values.len() / width, "type": kind }));
        self.accessors.len() - 1
    }

    fn mesh(&mut self, mesh: &Mesh) -> Value {
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
        let position = self.vectors(&positions);
        let bounds = crate::bvh::Bounds::around(mesh.positions.iter().copied());
        self.accessors[position]["min"] = json!(bounds.min.to_array());
        self.accessors[position]["max"] = json!(bounds.max.to_array());
        let mut attributes = json!({ "POSITION": position });
        if !mesh.normals.is_empty() {
            attributes["NORMAL"] = json!(self.vectors(&mesh.normals.iter().map(|n| n.to_array()).collect::<Vec<_>>()));
        }
        if !mesh.tangents.is_empty() {
            attributes["TANGENT"] = json!(self.vectors(&mesh.tangents.iter().map(|n| n.to_array()).collect::<Vec<_>>()));
        }
        for (set, uvs) in mesh.uvs.iter().enumerate().filter(|(_, uvs)| !uvs.is_empty()) {
            attributes[format!("TEXCOORD_{set}")] = json!(self.vectors(&uvs.iter().map(|n| n.to_array()).collect::<Vec<_>>()));
        }
        if !mesh.colors.is_empty() {
            attributes["COLOR_0"] = json!(self.vectors(&mesh.colors.iter().map(|n| n.to_array()).collect::<Vec<_>>()));
        }
        let view = self.view(mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()), Some(34_963));
        let count = 3 * mesh.triangles.len();
        self.accessors.push(json!({ "bufferView": view, "componentType": 5125, "count": count, "type": "SCALAR" }));
        json!({ "attributes": attributes, "indices": self.accessors.len() - 1 })
    }

    fn light(&mut self, light: &Punctual) -> (Value, Affine3A) {
        let rgb = light_rgb(&light.power);
        let intensity = rgb.max_element();
        let mut json = json!({ "name": light.name, "color": clamped(rgb / intensity.max(1e-30)), "intensity": intensity });
        let spread = light.pattern.as_ref().map(|p| {
            self.warn("a light that shines by a picture or by measured intensities is written as one that shines evenly, as bright in the mean");
            json["intensity"] = json!(intensity * p.mean());
            (p.spread.clone(), p.light_from_world.inverse() * Vec3::Z)
        });
        let towards = |direction: Vec3, position: Vec3| {
            Affine3A::from_rotation_translation(glam::Quat::from_rotation_arc(Vec3::NEG_Z, direction), position)
        };
        let (kind, place) = match light.kind {
            PunctualKind::Point { position } => match spread {
                Some((Spread::Frame([x, y]), axis)) => {
                    let outer = x.max(y).atan().min(PI / 2.0);
                    json["spot"] = json!({ "innerConeAngle": 0.95 * outer, "outerConeAngle": outer });
                    ("spot", towards(axis.normalize_or(Vec3::NEG_Z), position))
                }
                _ => ("point", Affine3A::from_translation(position)),
            },
            PunctualKind::Spot { position, direction, cos_inner, cos_outer, .. } => {
                let outer = cos_outer.acos().min(PI / 2.0);
                json["spot"] = json!({ "innerConeAngle": cos_inner.acos().min(outer - 1e-4).max(0.0), "outerConeAngle": outer });
                ("spot", towards(direction, position))
            }
            PunctualKind::Directional { direction } => ("directional", towards(direction, Vec3::ZERO)),
            PunctualKind::Disc { direction, .. } => {
                self.warn("the sun is written without its size");
                ("directional", towards(direction, Vec3::ZERO))
            }
        };
        json["type"] = json!(kind);
        (json, place)
    }
}

#[cfg(test)]
mod tests;

//! The directives: a state that is pushed and popped, and what they add to the scene.

mod placing;
mod settle;

use super::context::Context;
use super::lex::{Lexer, Token};
use super::lights;
use super::materials::{Made, Materials};
use super::media;
use super::params::{self, Param, Params};
use super::textures::Textures;
use super::{Fault, Place};
use crate::load::{Fetch, displaced, unzipped};
use crate::medium::Medium;
use crate::scene::Shape;
use crate::shape::Mesh;
use crate::subdivision;
use crate::texture::Scalar;
use glam::{Affine3A, DMat4, DVec3};
use std::collections::HashMap;
use std::sync::Arc;

/// Most files that include each other.
const DEEPEST: usize = 64;

/// Most files of a scene.
const MOST_FILES: usize = 4096;

/// What `Attribute` directives, blocks and objects save.
#[derive(Clone, Debug)]
pub(super) struct State {
    active: [bool; 2],
    pub reversed: bool,
    material: MaterialName,
    area_light: Option<Params>,
    media: [String; 2],
    shape: Vec<Param>,
    light: Vec<Param>,
    of_material: Vec<Param>,
    medium: Vec<Param>,
    texture: Vec<Param>,
}

#[derive(Clone, Debug, PartialEq)]
enum MaterialName {
    Named(String),
    Number(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    Attribute,
    Object,
}

/// What the end of a block brings back.
struct Saved {
    state: State,
    /// World from what follows.
    place: [DMat4; 2],
    block: Block,
    begun: Place,
}

/// A shape as it was met: materials are settled when all names are known.
struct Met {
    name: String,
    shape: Shape,
    /// Where the unit ball is placed that it is, with its texture coordinates; of spheres.
    ball: Option<DMat4>,
    /// What it moves with.
    node: Option<u32>,
    material: MaterialName,
    area_light: Option<Params>,
    alpha: Option<Scalar>,
    /// Media inside and outside.
    media: [String; 2],
    place: Place,
}

/// A mesh in a file of its own that is to be read.
struct Awaited {
    /// Its number in the description.
    mesh: u32,
    name: String,
    reversed: bool,
    displacement: Option<Displacement>,
    place: Place,
}

/// Heights that move the points of a mesh. Source: pbrt-v4, `Shape::Create` ("displacement", "edgelength").
struct Displacement {
    /// Along the normal in the mesh's space.
    height: Arc<Scalar>,
    /// Edges are split until none is longer, m.
    edge_length: f32,
    world_from_mesh: Affine3A,
    /// The scene's world, in which textures are, from the mesh: mirrored if the camera is of the other hand.
    texture_world_from_mesh: Affine3A,
}

/// What came of a mesh that was read.
struct Displaced {
    /// What it was before.
    before: Arc<Mesh>,
    stopped: bool,
    without_height: usize,
}

impl Displacement {
    fn apply(&self, mesh: &mut Mesh, is_reversed: bool) -> Displaced {
        let before = Arc::new(mesh.clone());
        let split = subdivision::split_long_edges(mesh, &self.world_from_mesh, self.edge_length);
        let without_height = displaced::displace_alone(mesh, &self.height, &self.texture_world_from_mesh, is_reversed);
        Displaced { before, stopped: split == subdivision::Splitting::Stopped, without_height }
    }
}

/// The scene in the making.
pub(super) struct World<'a> {
    pub context: Context<'a>,
    depth: usize,
    state: State,
    stack: Vec<Saved>,
    in_world: bool,
    spaces: HashMap<String, [DMat4; 2]>,
    camera: Option<(Params, String, DMat4)>,
    film: Option<(Params, String)>,
    max_depth: Option<u32>,
    textures: Textures,
    materials: Materials,
    media: HashMap<String, Arc<Medium>>,
    /// What the camera is in, and where that was said.
    around_camera: (String, Place),
    met: Vec<Met>,
    objects: HashMap<String, Vec<Met>>,
    /// The object that is being defined.
    defining: Option<(String, Vec<Met>)>,
    /// Numbers of the meshes of files, by name and whether they were reversed.
    ply: HashMap<(String, bool), u32>,
    /// Those that are still to be read.
    awaited: Vec<Awaited>,
}

impl<'a> World<'a> {
    /// Begins with an empty scene for the file `name`.
    pub fn new(name: &str, fetch: Fetch<'a>) -> Self {
        let state = State {
            active: [true; 2],
            reversed: false,
            material: MaterialName::Number(0),
            area_light: None,
            media: Default::default(),
            shape: vec![],
            light: vec![],
            of_material: vec![],
            medium: vec![],
            texture: vec![],
        };
        World {
            context: Context::new(name, fetch),
            depth: 0,
            state,
            stack: vec![],
            in_world: false,
            spaces: HashMap::new(),
            camera: None,
            film: None,
            max_depth: None,
            textures: Textures::default(),
            materials: Materials::new(),
            media: HashMap::new(),
            around_camera: Default::default(),
            met: vec![],
            objects: HashMap::new(),
            defining: None,
            ply: HashMap::new(),
            awaited: Vec::new(),
        }
    }

    /// Reads the main file, gzip or not, and all that it includes. Fails where a directive is not known or wrong, a block is not ended, or there is no `WorldBegin`.
    pub fn read_main(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        let bytes = unzipped(bytes.to_vec()).map_err(|e| Place::default().fault(e, "pbrt's text or a .gz of it"))?;
        self.read(&bytes, 0)?;
        if let Some(Saved { block, begun: place, .. }) = self.stack.last() {
            let what = if *block == Block::Object { "ObjectBegin" } else { "AttributeBegin" };
            return Err(place.fault(format!("{what} that is never ended"), "its End before the end of the file"));
        }
        if !self.in_world {
            return Err(Place::default().fault("no WorldBegin", "a pbrt-v4 scene: options, WorldBegin, then the world"));
        }
        Ok(())
    }

    fn read(&mut self, bytes: &[u8], file: u32) -> Result<(), Fault> {
        let mut lexer = Lexer::new(bytes, file);
        while let Some((token, place)) = lexer.next()? {
            match token {
                Token::Word(word) => self.directive(&word, place, &mut lexer)?,
                other => return Err(place.fault(other.shown(), "a directive, such as Shape")),
            }
        }
        Ok(())
    }

    fn text(lexer: &mut Lexer, place: Place, what: &str) -> Result<String, Fault> {
        match lexer.next()? {
            Some((Token::Text(text), _)) => Ok(text),
            other => {
                Err(place
                    .fault(other.map_or("the end of the file".into(), |t| t.0.shown()), format!("{what} in quotation marks")))
            }
        }
    }

    fn numbers<const N: usize>(lexer: &mut Lexer, place: Place, directive: &str) -> Result<[f64; N], Fault> {
        let bracket = matches!(lexer.peek()?, Some((Token::Open, _)));
        if bracket {
            lexer.next()?;
        }
        let mut numbers = [0.0; N];
        for n in &mut numbers {
            *n = match lexer.next()? {
                Some((Token::Number(v), _)) if v.is_finite() => v,
                other => {
                    let found = other.map_or("the end of the file".into(), |t| t.0.shown());
                    return Err(place.fault(format!("{found} in {directive}"), format!("{N} finite numbers")));
                }
            };
        }
        if bracket {
            match lexer.next()? {
                Some((Token::Close, _)) => (),
                other => {
                    let found = other.map_or("the end of the file".into(), |t| t.0.shown());
                    return Err(place.fault(format!("{found} in {directive}"), format!("] after {N} numbers")));
                }
            }
        }
        Ok(numbers)
    }

    fn change(&mut self, f: impl Fn(DMat4) -> DMat4) {
        for k in 0..2 {
            if self.state.active[k] {
                self.context.place[k] = f(self.context.place[k]);
            }
        }
    }

    fn directive(&mut self, word: &str, place: Place, lexer: &mut Lexer) -> Result<(), Fault> {
        match word {
            "Include" | "Import" => {
                let name = Self::text(lexer, place, "a file name")?;
                if word == "Import" && !self.in_world {
                    return Err(place.fault("Import before WorldBegin", "Include there, or Import in the world"));
                }
                if self.context.files.len() >= MOST_FILES {
                    return Err(
                        place.fault(format!("\"{name}\": more than {MOST_FILES} files"), "fewer: do files include themselves?")
                    );
                }
                if self.depth >= DEEPEST {
                    return Err(place.fault(
                        format!("\"{name}\": {DEEPEST} files that include each other"),
                        "files that do not include themselves",
                    ));
                }
                let bytes = self.context.file(&name, place)?;
                self.context.files.push(name);
                self.depth += 1;
                let number = self.context.files.len() as u32 - 1;
                let (state, transforms, blocks) = (self.state.clone(), self.context.place, self.stack.len());
                self.read(&bytes, number)?;
                if word == "Import" {
                    if self.stack.len() != blocks {
                        return Err(place.fault("blocks that are not ended in the imported file", "an End for every Begin"));
                    }
                    (self.state, self.context.place) = (state, transforms);
                }
                self.depth -= 1;
            }
            "Option" => {
                let name = Self::text(lexer, place, "a name and a value")?;
                let value = lexer.next()?;
                if !matches!(value, Some((Token::Word(_) | Token::Text(_) | Token::Number(_), _))) {
                    return Err(place.fault(format!("no value of option \"{name}\""), "a value"));
                }
                self.context.warn(place, format!("option \"{name}\" says how pbrt renders: it is not used"));
            }
            "Identity" => self.change(|_| DMat4::IDENTITY),
            "Translate" => {
                let v = Self::numbers::<3>(lexer, place, word)?;
                self.change(|m| m * DMat4::from_translation(DVec3::from_array(v)));
            }
            "Scale" => {
                let v = Self::numbers::<3>(lexer, place, word)?;
                if v.contains(&0.0) {
                    return Err(place.fault("a scale of 0", "factors other than 0"));
                }
                self.change(|m| m * DMat4::from_scale(DVec3::from_array(v)));
            }
            "Rotate" => {
                let [degrees, x, y, z] = Self::numbers::<4>(lexer, place, word)?;
                let axis =
                    DVec3::new(x, y, z).try_normalize().ok_or_else(|| place.fault("an axis of no length", "a direction"))?;
                self.change(|m| m * DMat4::from_axis_angle(axis, degrees.to_radians()));
            }
            "LookAt" => {
                let v = Self::numbers::<9>(lexer, place, word)?;
                let view =
                    look_at(&v).ok_or_else(|| place.fault("a LookAt without direction", "eye, target and up that differ"))?;
                self.change(|m| m * view);
            }
            "Transform" | "ConcatTransform" => {
                let m = DMat4::from_cols_array(&Self::numbers::<16>(lexer, place, word)?);
                if m.determinant().abs() < 1e-30 || m.row(3) != glam::DVec4::W {
                    return Err(place.fault("a matrix that cannot be inverted, or with a perspective", "an affine transform"));
                }
                self.change(|before| if word == "Transform" { m } else { before * m });
            }
            "CoordinateSystem" => {
                let name = Self::text(lexer, place, "a name")?;
                self.spaces.insert(name, self.context.place);
            }
            "CoordSysTransform" => {
                let name = Self::text(lexer, place, "a name")?;
                match self.spaces.get(&name) {
                    Some(space) => self.context.place = *space,
                    None => return Err(place.fault(format!("coordinate system \"{name}\""), "one that was named before")),
                }
            }
            "ActiveTransform" => match lexer.next()? {
                Some((Token::Word(w), _)) if w == "StartTime" => self.state.active = [true, false],
                Some((Token::Word(w), _)) if w == "EndTime" => self.state.active = [false, true],
                Some((Token::Word(w), _)) if w == "All" => self.state.active = [true; 2],
                _ => return Err(place.fault("ActiveTransform of something else", "StartTime, EndTime or All")),
            },
            "TransformTimes" => {
                let times = Self::numbers::<2>(lexer, place, word)?;
                if times[0] >= times[1] {
                    return Err(place.fault(format!("TransformTimes {} {}", times[0], times[1]), "a start before the end"));
                }
                self.context.times_s = times;
            }
            "ColorSpace" => {
                let name = Self::text(lexer, place, "a colour space")?;
                if name.to_lowercase() != "srgb" {
                    return Err(place.fault(format!("colour space \"{name}\""), "srgb: others are not supported"));
                }
            }
            "ReverseOrientation" => self.state.reversed = !self.state.reversed,
            "AttributeBegin" | "TransformBegin" => self.push(Block::Attribute, place),
            "AttributeEnd" | "TransformEnd" => self.pop(Block::Attribute, place)?,
            "Attribute" => {
                let target = Self::text(lexer, place, "shape, light, material, medium or texture")?;
                let list = params::read(lexer, place)?.into_list();
                let state = &mut self.state;
                let all = match target.as_str() {
                    "shape" => &mut state.shape,
                    "light" => &mut state.light,
                    "material" => &mut state.of_material,
                    "medium" => &mut state.medium,
                    "texture" => &mut state.texture,
                    _ => return Err(place.fault(format!("Attribute \"{target}\""), "shape, light, material, medium or texture")),
                };
                for p in list {
                    all.retain(|q| q.name != p.name);
                    all.push(p);
                }
            }
            "Camera" => {
                let (kind, p) = self.typed(lexer, place)?;
                let from_world = self.context.place[0];
                self.spaces.insert("camera".into(), self.context.place.map(|m| m.inverse()));
                if self.context.moves() {
                    self.context.warn(place, "the camera moves: it is taken where it is when the shutter opens");
                }
                self.context.is_mirrored = from_world.determinant() > 0.0;
                self.camera = Some((p, kind, from_world));
                self.around_camera = (self.state.media[1].clone(), place);
            }
            "Film" => {
                let (kind, p) = self.typed(lexer, place)?;
                self.film = Some((p, kind));
            }
            "Integrator" => {
                let (kind, p) = self.typed(lexer, place)?;
                if matches!(kind.as_str(), "directlighting" | "whitted") {
                    self.context.warn(place, format!("integrator \"{kind}\" is of pbrt-v3: only its maxdepth is read"));
                }
                known(&INTEGRATORS, "integrator", &kind, place)?;
                self.max_depth = Some(p.integer("maxdepth", 5)?.clamp(0, 1 << 20) as u32);
                // How it works, not what it computes.
                for name in OF_INTEGRATORS {
                    p.get(name);
                }
                self.context.say_unused(&p);
            }
            "Sampler" | "PixelFilter" | "Accelerator" => {
                let (kind, _) = self.typed(lexer, place)?;
                match word {
                    "Sampler" => known(&SAMPLERS, "sampler", &kind, place)?,
                    "PixelFilter" => known(&FILTERS, "filter", &kind, place)?,
                    _ => known(&["bvh", "kdtree"], "accelerator", &kind, place)?,
                }
            }
            "WorldBegin" => {
                if self.in_world {
                    return Err(place.fault("a second WorldBegin", "one"));
                }
                self.in_world = true;
                (self.context.place, self.state.active) = ([DMat4::IDENTITY; 2], [true; 2]);
                self.spaces.insert("world".into(), self.context.place);
            }
            "WorldEnd" => self.context.warn(place, "WorldEnd is of older versions of pbrt: it has no meaning"),
            "Material" | "MakeNamedMaterial" => {
                let name = Self::text(lexer, place, "a name")?;
                let p = params::read(lexer, place)?.over(&self.state.of_material);
                let kind = match word {
                    "Material" => name.clone(),
                    _ => {
                        p.text("type")?.ok_or_else(|| place.fault("a named material without type", "\"string type\""))?.to_owned()
                    }
                };
                let made = self.material(&kind, &p)?;
                self.context.say_unused(&p);
                match word {
                    "Material" => self.state.material = MaterialName::Number(self.materials.add(made)),
                    _ => self
                        .materials
                        .name(name, made)
                        .map_err(|n| place.fault(format!("a second material \"{n}\""), "one of each name"))?,
                }
            }
            "NamedMaterial" => self.state.material = MaterialName::Named(Self::text(lexer, place, "a name")?),
            "Texture" => {
                let name = Self::text(lexer, place, "a name")?;
                let kind = Self::text(lexer, place, "float or spectrum")?;
                let class = Self::text(lexer, place, "a class")?;
                let p = params::read(lexer, place)?.over(&self.state.texture);
                self.textures.make(&mut self.context, &name, &kind, &class, &p)?;
                self.context.say_unused(&p);
            }
            "MakeNamedMedium" => {
                let name = Self::text(lexer, place, "a name")?;
                let p = params::read(lexer, place)?.over(&self.state.medium);
                let medium = media::make(&mut self.context, &name, &p)?;
                self.context.say_unused(&p);
                if self.media.insert(name.clone(), Arc::new(medium)).is_some() {
                    return Err(place.fault(format!("a second medium \"{name}\""), "one of each name"));
                }
            }
            "MediumInterface" => {
                let inside = Self::text(lexer, place, "the name of a medium")?;
                let outside = match lexer.peek()? {
                    Some((Token::Text(_), _)) => Self::text(lexer, place, "the name of a medium")?,
                    _ => inside.clone(),
                };
                self.state.media = [inside, outside];
            }
            "AreaLightSource" => {
                let (kind, p) = self.typed(lexer, place)?;
                if kind != "diffuse" {
                    return Err(place.fault(format!("area light \"{kind}\""), "diffuse"));
                }
                self.state.area_light = Some(p.over(&self.state.light));
            }
            "LightSource" => {
                let (kind, p) = self.typed(lexer, place)?;
                let p = p.over(&self.state.light);
                let world_from_light = self.context.place[0];
                if self.context.moves() {
                    self.context.warn(place, "a light that moves: it stands where it begins");
                }
                lights::make(&mut self.context, &kind, &p, world_from_light)?;
                self.context.say_unused(&p);
            }
            "Shape" => {
                let (kind, p) = self.typed(lexer, place)?;
                self.shape(&kind, &p.over(&self.state.shape), place)?;
            }
            "ObjectBegin" => {
                let name = Self::text(lexer, place, "a name")?;
                if self.defining.is_some() {
                    return Err(place.fault("ObjectBegin within an object", "ObjectEnd before it"));
                }
                if self.objects.contains_key(&name) {
                    return Err(place.fault(format!("a second object \"{name}\""), "one of each name"));
                }
                self.push(Block::Object, place);
                self.defining = Some((name, vec![]));
            }
            "ObjectEnd" => {
                self.pop(Block::Object, place)?;
                if let Some((name, met)) = self.defining.take() {
                    self.objects.insert(name, met);
                }
            }
            "ObjectInstance" => {
                let name = Self::text(lexer, place, "a name")?;
                if self.defining.is_some() {
                    return Err(place.fault("ObjectInstance within an object", "objects of shapes alone"));
                }
                self.instance(&name, place)?;
            }
            other => {
                let near = diopter_light::names::nearest(other, DIRECTIVES.iter().copied());
                let hint =
                    near.map_or("a directive of pbrt-v4".to_owned(), |n| format!("a directive of pbrt-v4 (did you mean {n}?)"));
                return Err(place.fault(format!("\"{other}\""), hint));
            }
        }
        Ok(())
    }

    /// A directive's type and its parameters.
    fn typed(&mut self, lexer: &mut Lexer, place: Place) -> Result<(String, Params), Fault> {
        let kind = Self::text(lexer, place, "a type")?;
        Ok((kind, params::read(lexer, place)?))
    }

    fn push(&mut self, block: Block, begun: Place) {
        self.stack.push(Saved { state: self.state.clone(), place: self.context.place, block, begun });
    }

    fn pop(&mut self, block: Block, place: Place) -> Result<(), Fault> {
        match self.stack.pop() {
            Some(saved) if saved.block == block => {
                (self.state, self.context.place) = (saved.state, saved.place);
                Ok(())
            }
            Some(Saved { begun, .. }) => {
                Err(place.fault("an End of another block", format!("the End of what begins in line {}", begun.line)))
            }
            None => Err(place.fault("an End without Begin", "AttributeBegin or ObjectBegin before it")),
        }
    }

    fn material(&mut self, kind: &str, p: &Params) -> Result<Made, Fault> {
        self.materials.make(&mut self.context, &self.textures, kind, p)
    }

    /// A medium by name; the empty name is a vacuum.
    fn medium(&self, name: &str, place: Place) -> Result<Option<Arc<Medium>>, Fault> {
        if name.is_empty() {
            return Ok(None);
        }
        self.media.get(name).cloned().map(Some).ok_or_else(|| {
            let near = diopter_light::names::nearest(name, self.media.keys().map(String::as_str));
            let hint = near.map_or("a medium that is defined somewhere".into(), |n| format!("a medium (did you mean \"{n}\"?)"));
            place.fault(format!("medium \"{name}\""), hint)
        })
    }
}

const DIRECTIVES: [&str; 40] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "WorldBegin",
];

/// Integrators of pbrt-v4, and of pbrt-v3 those that are still met.
const INTEGRATORS: [&str; 14] = [
    "ambientocclusion",
    "ao",
    "bdpt",
    "directlighting",
    "function",
    "lightpath",
    "mlt",
    "path",
    "randomwalk",
    "simplepath",
    "simplevolpath",
    "sppm",
    "volpath",
    "whitted",
];
/// Their parameters that no picture of very many samples depends on.
const OF_INTEGRATORS: [&str; 22] = [
    "regularize",
    "lightsampler",
    "lightsamplestrategy",
    "rrthreshold",
    "pixelbounds",
    "strategy",
    "samplelights",
    "samplebsdf",
    "cossample",
    "maxdistance",
    "mutationsperpixel",
    "bootstrapsamples",
    "chains",
    "largestepprobability",
    "sigma",
    "photonsperiteration",
    "iterations",
    "radius",
    "seed",
    "visualizestrategies",
    "visualizeweights",
    "numiterations",
];
const SAMPLERS: [&str; 11] = [
    "02sequence",
    "halton",
    "independent",
    "lowdiscrepancy",
    "maxmindist",
    "paddedsobol",
    "pmj02bn",
    "random",
    "sobol",
    "stratified",
    "zsobol",
];
const FILTERS: [&str; 5] = ["box", "gaussian", "mitchell", "sinc", "triangle"];

/// Fails where a name is none of those that are known.
fn known(names: &[&str], what: &str, name: &str, place: Place) -> Result<(), Fault> {
    if names.contains(&name) {
        return Ok(());
    }
    let hint =
        diopter_light::names::nearest(name, names.iter().copied()).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
    Err(place.fault(format!("{what} \"{name}\""), format!("one of {}{hint}", names.join(", "))))
}

/// Camera-from-world of eye, target and up.
fn look_at(v: &[f64; 9]) -> Option<DMat4> {
    let [eye, at, up] = [0, 3, 6].map(|i| DVec3::new(v[i], v[i + 1], v[i + 2]));
    let forward = (at - eye).try_normalize()?;
    let right = up.try_normalize()?.cross(forward).try_normalize()?;
    let up = forward.cross(right);
    let world_from_camera = DMat4::from_cols(right.extend(0.0), up.extend(0.0), forward.extend(0.0), eye.extend(1.0));
    Some(world_from_camera.inverse())
}

//! The [`Description`] in the making: what is drawn where, and what readers of prims ask of it.

use super::collections::Bindings;
use super::error;
use super::layer::{Key, Value};
use super::material_binding::Shaders;
use super::mesh_parts::Part;
use super::skeleton_binding::{Binding, Bones};
use super::stage::{Fingerprint, Prim, Stage};
use crate::SceneError;
use crate::load::Fetch;
use crate::motion::{Channel, Local, Node};
use crate::scene::Description;
use crate::shape::Mesh;
use glam::{Affine3A, DMat4, DVec3, Vec3};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// What a warning says of files that are missing, where something is shown.
pub(super) const SHOWN_WITHOUT: &str = ", without which the scene is shown";
/// Most things in a scene.
pub(super) const MOST_OBJECTS: usize = 1 << 24;

/// What prims hand down.
#[derive(Clone)]
pub(super) struct Place {
    /// What the prim hangs on, if anything above it moves.
    pub node: Option<u32>,
    /// The prim's space in the node's, or in the world.
    pub local: DMat4,
    /// The prim's space in the world at the scene's first time.
    pub world: DMat4,
    /// What it and what is around it bind materials to.
    pub bindings: Option<Arc<Bindings>>,
    /// Colour of what has no material, and of what reads it.
    pub color: Option<Vec3>,
    /// Opacity of what has no material.
    pub opacity: Option<f32>,
    /// The material that stands for the colours of an instancer's instances, where no colour is nearer.
    pub instance_color: Option<u32>,
    /// Whether it or what is around it is invisible: only cameras are looked for.
    pub invisible: bool,
    /// Whether its purpose, its own or that of what is around it, is not to be drawn.
    pub hidden: bool,
    /// How many instancers are around.
    pub instancers: usize,
    /// Whether a SkelRoot is around: only within one are meshes bent.
    pub in_skel_root: bool,
    /// Path of the skeleton that meshes hang on.
    pub skeleton: Option<Arc<str>>,
    /// Path of what moves the joints of skeletons.
    pub skeleton_animation: Option<Arc<str>>,
    /// What kind of thing it is.
    pub class: Option<Arc<str>>,
}

/// Something to be drawn.
pub(super) struct Drawn {
    pub name: String,
    pub form: usize,
    pub node: Option<u32>,
    pub local: DMat4,
    pub world: DMat4,
    /// The skeleton that bends it.
    pub binding: Option<Arc<Binding>>,
    pub class: Option<Arc<str>>,
    /// A material that another takes the place of.
    pub recolored: Option<[u32; 2]>,
}

impl Drawn {
    /// The material of a part of it.
    pub fn material(&self, of_form: u32) -> u32 {
        self.recolored.filter(|r| r[0] == of_form).map_or(of_form, |r| r[1])
    }
}

/// What a form is made of.
pub(super) enum Form {
    /// Read when all are known, several at a time.
    Mesh {
        prim: Arc<Prim>,
        parts: Vec<Part>,
        /// Blend shapes of what hangs on a skeleton.
        shapes: Option<Vec<Option<Arc<Prim>>>>,
    },
    /// Read as meshes are.
    Curves {
        prim: Arc<Prim>,
        material: u32,
    },
    Ready {
        mesh: Mesh,
        material: u32,
    },
    /// Smooth where it stands still and is not scaled non-uniformly.
    Ball {
        radius: f64,
        material: u32,
    },
}

/// What tells forms apart.
#[derive(PartialEq, Eq, Hash)]
pub(super) enum FormKey {
    /// Opinions, materials, and whether a skeleton may bend it.
    Mesh(Fingerprint, Vec<u32>, bool),
    Solid(String, Vec<u64>, u32),
}

/// What becomes of an aperture whose sides are not those of the picture. Source: OpenUSD, `UsdRenderSettingsBase`, `aspectRatioConformPolicy`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Conform {
    Expand,
    Crop,
    Width,
    Height,
    /// It stays, and pixels are no squares.
    Pixels,
}

pub(super) struct World<'a> {
    pub name: String,
    pub stage: Stage<'a>,
    pub description: Description,
    pub shaders: Shaders,
    /// Metres of a unit.
    pub unit_m: f64,
    pub is_z_up: bool,
    pub root: DMat4,
    pub per_second: f64,
    pub drawn: Vec<Drawn>,
    pub forms: Vec<Form>,
    pub known: HashMap<FormKey, usize>,
    pub left_out: BTreeMap<&'static str, usize>,
    pub channels: Vec<Channel>,
    /// Where skeletons stand, by path.
    pub skeletons: HashMap<Arc<str>, Place>,
    /// Skeletons that were asked for; `None` of those that hold nothing.
    pub bones: HashMap<Arc<str>, Option<Arc<Bones>>>,
    /// Columns and rows of the picture, and how apertures are made to fit them.
    pub size: Option<([usize; 2], Conform)>,
    /// Apertures of the cameras over their focal lengths, horizontal and vertical.
    pub apertures: Vec<[f64; 2]>,
}

pub(super) type Read<T> = Result<T, SceneError>;

impl<'a> World<'a> {
    /// Opens a stage by the bytes of its root layer. Fails where layers cannot be read.
    pub fn new(bytes: Vec<u8>, name: &str, fetch: Fetch<'a>) -> Read<Self> {
        let stage = Stage::new(bytes, name, fetch)?;
        let number =
            |key| -> Read<Option<f64>> { Ok(stage.root(key)?.and_then(|v| v.number()).filter(|v| *v > 0.0 && v.is_finite())) };
        // Without a word of it a unit is a centimetre (UsdGeom).
        let unit_m = stage.root(Key::MetersPerUnit)?.and_then(|v| v.number()).unwrap_or(0.01);
        if !(1e-9..=1e9).contains(&unit_m) {
            return Err(error(name, format!("metersPerUnit {unit_m}"), "1e-9 to 1e9"));
        }
        let per_second = number(Key::TimeCodesPerSecond)?.or(number(Key::FramesPerSecond)?).unwrap_or(24.0);
        let up = stage.root(Key::UpAxis)?;
        let is_z_up = up.as_ref().and_then(Value::text).is_some_and(|t| t.eq_ignore_ascii_case("z"));
        let turn = if is_z_up { DMat4::from_rotation_x(-std::f64::consts::FRAC_PI_2) } else { DMat4::IDENTITY };
        Ok(World {
            name: name.to_owned(),
            stage,
            description: Description { name: name.to_owned(), ..Default::default() },
            shaders: Shaders::default(),
            unit_m,
            is_z_up,
            root: DMat4::from_scale(DVec3::splat(unit_m)) * turn,
            per_second,
            drawn: vec![],
            forms: vec![],
            known: HashMap::new(),
            left_out: BTreeMap::new(),
            channels: vec![],
            skeletons: HashMap::new(),
            bones: HashMap::new(),
            size: None,
            apertures: vec![],
        })
    }

    /// Counts something that is left out.
    pub fn skip_unsupported(&mut self, what: &'static str) {
        *self.left_out.entry(what).or_default() += 1;
    }

    /// Seconds of the scene at a time code of the stage.
    pub fn seconds(&self, time_code: f64) -> f64 {
        (time_code - self.stage.start) / self.per_second
    }

    /// A node that stands where a prim does.
    pub fn node_at(&mut self, place: &Place, name: &str) -> u32 {
        if let Some(node) = place.node.filter(|_| place.local == DMat4::IDENTITY) {
            return node;
        }
        let rest = Local::Matrix(affine(place.local));
        self.description.nodes.push(Node { parent: place.node, rest, ..Node::new(name) });
        self.description.nodes.len() as u32 - 1
    }

    /// The number of a shape that is shared by its key, made where it is met first.
    pub fn form(&mut self, key: FormKey, make: impl FnOnce() -> Form) -> usize {
        let next = self.forms.len();
        let number = *self.known.entry(key).or_insert(next);
        if number == next {
            self.forms.push(make());
        }
        number
    }

    /// Adds an object of a shape at a place.
    pub fn draw(&mut self, name: &str, form: usize, place: &Place) -> Read<()> {
        if self.drawn.len() >= MOST_OBJECTS {
            return Err(error(&self.name, format!("more than {MOST_OBJECTS} things"), "fewer"));
        }
        let Place { node, local, world, .. } = *place;
        self.drawn.push(Drawn {
            name: name.to_owned(),
            form,
            node,
            local,
            world,
            binding: None,
            class: place.class.clone(),
            recolored: None,
        });
        Ok(())
    }

    /// A mesh that the reader makes itself, such as a lamp's.
    pub fn draw_mesh(&mut self, name: &str, mesh: Mesh, material: u32, place: &Place) -> Read<()> {
        self.forms.push(Form::Ready { mesh, material });
        self.draw(name, self.forms.len() - 1, place)
    }

    /// Adds a ball of a radius, in units of the stage, at a place.
    pub fn draw_ball(&mut self, name: &str, radius: f64, material: u32, place: &Place) -> Read<()> {
        self.forms.push(Form::Ball { radius, material });
        self.draw(name, self.forms.len() - 1, place)
    }
}

/// A matrix of single precision.
pub(super) fn affine(m: DMat4) -> Affine3A {
    Affine3A::from_mat4(m.as_mat4())
}

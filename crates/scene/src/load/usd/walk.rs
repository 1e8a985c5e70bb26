//! The walk over the stage: what each prim becomes.

use super::layer::{Key, Value};
use super::material_binding::{Bound, DisplayColor};
use super::mesh_parts::{MeshPart, Meshes, Part};
use super::stage::{Prim, Stage};
use super::world::{Form, FormKey, Place, Read, SHOWN_WITHOUT, World, affine};
use super::{camera, collections, curves, geometry, light, skeleton, subdivision, transform};
use crate::load::pbrt::shapes;
use crate::load::{DisplacedSurface, displaced};
use crate::motion::{
    AnimatedProperty, Animation, AnimationPlayback, Channel, Extrapolation, KeyInterpolation, Local, Motion, Node, Parts,
};
use crate::scene::{Description, Object, Shape};
use crate::shape::Curves;
use glam::{DMat4, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;

/// What a form is other than meshes.
enum Other {
    None,
    /// Radius and material.
    Ball(f64, u32),
    Curves(Box<Curves>, u32),
}

/// Attributes of solids that are read as they are at the scene's first time.
const SIZES: [&str; 8] = ["radius", "size", "height", "width", "length", "radiusTop", "radiusBottom", "axis"];
/// The same of lights.
const LIGHT_INPUTS: [&str; 14] = [
    "inputs:intensity",
    "inputs:exposure",
    "inputs:color",
    "inputs:colorTemperature",
    "inputs:radius",
    "inputs:width",
    "inputs:height",
    "inputs:length",
    "inputs:angle",
    "inputs:shaping:cone:angle",
    "inputs:texture:file",
    "intensity",
    "exposure",
    "color",
];

impl World<'_> {
    /// Reads the whole stage. Fails at the first prim that cannot be read.
    pub fn run(mut self) -> Read<Description> {
        let place = Place {
            node: None,
            local: self.root,
            world: self.root,
            bindings: None,
            color: None,
            opacity: None,
            instance_color: None,
            invisible: false,
            hidden: false,
            instancers: 0,
            in_skel_root: false,
            skeleton: None,
            skeleton_animation: None,
            class: None,
        };
        if let Some(root) = self.stage.prim("/")? {
            let children = self.stage.children(&root)?;
            self.walk(children, place)?;
        }
        self.build()?;
        camera::conform(&mut self);
        for (key, what) in [(Key::Relocates, "relocates"), (Key::Spline, "motion by splines")] {
            if self.stage.uses(key) {
                self.skip_unsupported(what);
            }
        }
        let missing = &self.stage.missing;
        if !missing.is_empty() {
            let text = format!("{}: files that could not be read{SHOWN_WITHOUT}: {}", self.name, missing.join(", "));
            self.description.warnings.push(text);
        }
        if !self.left_out.is_empty() {
            let list: Vec<String> = self.left_out.iter().map(|(what, n)| format!("{what} ({n})")).collect();
            self.description.warnings.push(format!("{}: left out: {}", self.name, list.join(", ")));
        }
        if !self.channels.is_empty() {
            let animation = Animation { name: "time samples".into(), channels: self.channels };
            self.description.animations.push(animation);
            self.description.playing = AnimationPlayback { animations: vec![0], ending: Extrapolation::Clamp, frozen_at_s: None };
        }
        Ok(self.description)
    }

    /// Draws prims and all below them.
    pub(super) fn walk(&mut self, prims: Vec<Arc<Prim>>, place: Place) -> Read<()> {
        let mut open: Vec<(Arc<Prim>, Place)> = prims.into_iter().rev().map(|p| (p, place.clone())).collect();
        while let Some((prim, place)) = open.pop() {
            if let Some(inner) = self.prim(&prim, place)? {
                let children = self.stage.children(&prim)?;
                open.extend(children.into_iter().rev().map(|child| (child, inner.clone())));
            }
        }
        Ok(())
    }

    /// Draws one prim; what it hands down, unless nothing below is drawn.
    fn prim(&mut self, prim: &Arc<Prim>, outer: Place) -> Read<Option<Place>> {
        if !self.stage.is_drawn(prim)? {
            return Ok(None);
        }
        let kind = self.stage.type_name(prim)?;
        match &*kind {
            "Material" | "Shader" | "NodeGraph" | "GeomSubset" | "RenderProduct" | "RenderVar" => return Ok(None),
            "RenderSettings" => {
                self.size = self.size.or(camera::resolution(&self.stage, prim)?);
                return Ok(None);
            }
            "SkelAnimation" | "BlendShape" => return Ok(None),
            _ => (),
        }
        let text = |stage: &Stage, name: &str| -> Read<Option<Arc<str>>> {
            Ok(stage.value(prim, name)?.as_ref().and_then(Value::text).cloned())
        };
        let mut outer = outer;
        outer.invisible |= text(&self.stage, "visibility")?.is_some_and(|v| &*v == "invisible");
        if self.stage.is_changing_text(prim, "visibility")? {
            self.skip_unsupported("visibility that changes");
        }
        if outer.invisible && !self.holds_camera(prim) {
            return Ok(None);
        }
        if let Some(purpose) = text(&self.stage, "purpose")? {
            outer.hidden = matches!(&*purpose, "proxy" | "guide");
        }
        if self.stage.field(prim, Key::Clips)?.is_some() {
            self.skip_unsupported("value clips");
        }
        // What is no Xformable has no place of its own: groups without a type, scopes.
        let is_placed = !matches!(&*kind, "" | "Scope");
        let mut place = if is_placed { self.moved(prim, outer)? } else { outer };
        self.bind_skeleton(&kind, prim, &mut place)?;
        let has_skin = place.in_skel_root && &*kind != "Mesh";
        if has_skin && self.stage.attribute(prim, "primvars:skel:jointIndices")?.is_some() {
            self.skip_unsupported("skins of what is no mesh");
        }
        self.hand_down(prim, &mut place)?;
        if matches!(&*kind, "Mesh" | "PointInstancer" | "BasisCurves") {
            self.holds_still(prim, &["primvars:displayColor", "primvars:displayOpacity"], "colours that change")?;
            let has_velocities =
                self.stage.value(prim, "velocities")?.and_then(|v| v.floats()).is_some_and(|v| v.iter().any(|v| *v != 0.0));
            if has_velocities {
                self.skip_unsupported("velocities of points");
            }
        }
        match &*kind {
            "Camera" => camera::add(self, prim, &place)?,
            _ if place.invisible => (),
            "PointInstancer" if place.hidden => return Ok(None),
            "Mesh" | "Sphere" | "Cube" | "Cylinder" | "Cone" | "Capsule" | "Plane" | "Cylinder_1" | "Capsule_1"
            | "BasisCurves"
                if place.hidden => {}
            "Mesh" => self.mesh(prim, &place)?,
            "BasisCurves" => self.curves(prim, &place)?,
            "Sphere" | "Cube" | "Cylinder" | "Cone" | "Capsule" | "Plane" | "Cylinder_1" | "Capsule_1" => {
                self.holds_still(prim, &SIZES, "sizes of solids that change")?;
                self.solid(&kind, prim, &place)?
            }
            "PointInstancer" => {
                self.holds_still(prim, &["invisibleIds"], "instances that appear and vanish")?;
                self.instances(prim, &place)?;
                return Ok(None);
            }
            "DistantLight" | "SphereLight" | "RectLight" | "DiskLight" | "CylinderLight" | "DomeLight" | "DomeLight_1" => {
                self.holds_still(prim, &LIGHT_INPUTS, "lights that change by themselves")?;
                light::add(self, &kind, prim, &place)?;
            }
            "GeometryLight" | "PortalLight" | "PluginLight" => self.skip_unsupported("lights of other kinds"),
            "NurbsCurves" | "HermiteCurves" => self.skip_unsupported("NURBS and Hermite curves"),
            "NurbsPatch" | "TetMesh" => self.skip_unsupported("patches and tetrahedra"),
            "Points" => self.skip_unsupported("points"),
            "Volume" | "OpenVDBAsset" | "Field3DAsset" => self.skip_unsupported("volumes"),
            k if k.starts_with("ParticleField") => self.skip_unsupported("Gaussian splats"),
            _ => (),
        }
        Ok(Some(place))
    }

    /// Says of attributes that change over time that they do not here.
    fn holds_still(&mut self, prim: &Prim, names: &[&str], what: &'static str) -> Read<()> {
        for name in names {
            if self.stage.is_animated(prim, name)? {
                self.skip_unsupported(what);
                break;
            }
        }
        Ok(())
    }

    /// Whether a prim is a camera, or one is below it. What cannot be read holds none.
    fn holds_camera(&mut self, prim: &Arc<Prim>) -> bool {
        let mut open = vec![prim.clone()];
        while let Some(prim) = open.pop() {
            if !self.stage.is_drawn(&prim).unwrap_or(false) {
                continue;
            }
            match self.stage.type_name(&prim).as_deref() {
                Ok("Camera") => return true,
                Ok("PointInstancer" | "Mesh" | "Material") | Err(_) => (),
                Ok(_) => open.extend(self.stage.children(&prim).unwrap_or_default()),
            }
        }
        false
    }

    /// Follows what a prim says of materials, colours and classes to what is below it.
    pub(super) fn hand_down(&mut self, prim: &Prim, place: &mut Place) -> Read<()> {
        let (bindings, has_expressions) = collections::bindings(&mut self.stage, prim, place.bindings.take())?;
        place.bindings = bindings;
        if has_expressions {
            self.skip_unsupported("materials of collections by path expressions");
        }
        if let Some(color) = self.constant_color(prim)? {
            (place.color, place.instance_color) = (Some(color), None);
        }
        let opacity = self.stage.value(prim, "primvars:displayOpacity")?.and_then(|v| v.floats());
        if let Some([opacity]) = opacity.as_deref() {
            place.opacity = Some(opacity.clamp(0.0, 1.0));
        }
        if let Some(class) = self.class(prim)? {
            place.class = Some(class);
        }
        Ok(())
    }

    /// The class that a prim gives itself and all below it: the first label of the taxonomies `class` and `category` (OpenUSD, UsdSemantics), or what Omniverse wrote before these.
    fn class(&self, prim: &Prim) -> Read<Option<Arc<str>>> {
        let said = |text: &Arc<str>| Some(text.trim()).filter(|t| !t.is_empty()).map(Arc::from);
        for name in ["semantics:labels:class", "semantics:labels:category"] {
            if let Some(Value::Texts(labels)) = self.stage.value(prim, name)?
                && let Some(class) = labels.iter().find_map(said)
            {
                return Ok(Some(class));
            }
        }
        let before =
            |what: &str| -> Read<Option<Value>> { self.stage.value(prim, &format!("semantic:Semantics:params:semantic{what}")) };
        match before("Type")?.as_ref().and_then(Value::text).is_some_and(|t| &**t == "class") {
            true => Ok(before("Data")?.as_ref().and_then(Value::text).and_then(said)),
            false => Ok(None),
        }
    }

    /// Follows what a prim says of skeletons to what is below it.
    fn bind_skeleton(&mut self, kind: &str, prim: &Arc<Prim>, place: &mut Place) -> Read<()> {
        place.in_skel_root |= kind == "SkelRoot";
        if !place.in_skel_root {
            return Ok(());
        }
        for (name, slot) in [("skel:skeleton", &mut place.skeleton), ("skel:animationSource", &mut place.skeleton_animation)] {
            if let Some(path) = self.stage.targets(prim, name, Key::TargetPaths)?.into_iter().next() {
                *slot = Some(path.into());
            }
        }
        if kind == "Skeleton" {
            self.skeletons.insert(prim.path.as_str().into(), place.clone());
        }
        Ok(())
    }

    /// The place of a prim: a node of its own where it moves.
    fn moved(&mut self, prim: &Prim, outer: Place) -> Read<Place> {
        let mut place = outer;
        let xform = transform::of(&self.stage, prim)?;
        if xform.resets {
            (place.node, place.local, place.world) = (None, self.root, self.root);
        }
        match xform.keys {
            Some(_) if place.instancers > 0 => {
                self.skip_unsupported("motion within prototypes of instancers");
                (place.local, place.world) = (place.local * xform.rest, place.world * xform.rest);
            }
            Some(keys) => {
                if xform.sheared {
                    self.skip_unsupported("shear of what moves");
                }
                if xform.vanishes {
                    self.skip_unsupported("moments at which what moves has no place");
                }
                let parent = self.node_at(&place, prim.name());
                let number = self.description.nodes.len();
                let (scale, rotation, translation) = xform.rest.to_scale_rotation_translation();
                let whole = scale.is_finite() && rotation.is_finite() && xform.rest.determinant() != 0.0;
                let rest = if whole {
                    Parts { translation: translation.as_vec3(), rotation: rotation.as_quat(), scale: scale.as_vec3() }
                } else {
                    keys[0].1
                };
                self.description.nodes.push(Node { parent: Some(parent), rest: Local::Parts(rest), ..Node::new(prim.name()) });
                let times_s: Vec<f32> = keys.iter().map(|k| self.seconds(k.0) as f32).collect();
                let mut channel = |property, values: Vec<f32>| {
                    self.channels.push(Channel {
                        node: number,
                        property,
                        interpolation: KeyInterpolation::Linear,
                        times_s: times_s.clone(),
                        values,
                    });
                };
                channel(AnimatedProperty::Translation, keys.iter().flat_map(|k| k.1.translation.to_array()).collect());
                channel(AnimatedProperty::Rotation, keys.iter().flat_map(|k| k.1.rotation.to_array()).collect());
                channel(AnimatedProperty::Scale, keys.iter().flat_map(|k| k.1.scale.to_array()).collect());
                (place.node, place.local, place.world) = (Some(number as u32), DMat4::IDENTITY, place.world * xform.rest);
            }
            None => (place.local, place.world) = (place.local * xform.rest, place.world * xform.rest),
        }
        Ok(place)
    }

    fn constant_color(&self, prim: &Prim) -> Read<Option<Vec3>> {
        let Some(colors) = self.stage.value(prim, "primvars:displayColor")?.and_then(|v| v.floats()) else { return Ok(None) };
        let indices = self.stage.value(prim, "primvars:displayColor:indices")?.and_then(|v| v.ints());
        let place = match indices.as_deref() {
            // One for all, however often it is named.
            _ if colors.len() == 3 => 0,
            Some([one]) => 3 * usize::try_from(*one).unwrap_or(usize::MAX / 3),
            _ => return Ok(None),
        };
        Ok(colors.get(place..place.saturating_add(3)).map(Vec3::from_slice))
    }

    /// The material of what is bound to one of a path; `own`: how many colours it has itself, where shaders can read them.
    fn bound(&mut self, material: Option<&str>, place: &Place, own: usize) -> Read<Bound> {
        if let Some(path) = material {
            let read = match (own > 0, place.color) {
                (true, _) => DisplayColor::OfPrim,
                (false, Some(color)) => DisplayColor::Inherited(color.to_array().map(f32::to_bits)),
                (false, None) => DisplayColor::Absent,
            };
            if let Some(bound) = self.material(path, read)? {
                if place.opacity.is_some_and(|o| o < 1.0) {
                    self.skip_unsupported("display opacities of what has a material");
                }
                if own == 0 && place.instance_color.is_some() && self.reads_display_color(path)? {
                    self.skip_unsupported("colours of instances that materials read");
                }
                return Ok(bound);
            }
        }
        match place.instance_color.filter(|_| own == 0) {
            Some(number) => Ok(Bound { number, uvs: vec![], colors: false, displacement: None }),
            None => Ok(self.plain(place.color, place.opacity, own > 1)),
        }
    }

    fn mesh(&mut self, prim: &Arc<Prim>, place: &Place) -> Read<()> {
        if self.stage.is_animated(prim, "points")? {
            self.skip_unsupported("points that move by themselves");
        }
        let (binding, shapes) = skeleton::binding(self, prim, place)?.unzip();
        let own = self.stage.value(prim, "primvars:displayColor")?.and_then(|v| v.floats()).map_or(0, |c| c.len() / 3);
        let mut key = self.stage.fingerprint(prim);
        let mut parts = Vec::new();
        let light = light::of_mesh(self, prim)?;
        let material = collections::material(place.bindings.as_ref(), &prim.path);
        if material.is_none() {
            let opacity = self.stage.value(prim, "primvars:displayOpacity")?.and_then(|v| v.floats());
            if opacity.is_some_and(|o| o.len() > 1 && o.iter().any(|o| *o < 1.0)) {
                self.skip_unsupported("opacities that differ within a mesh");
            }
        }
        let whole = self.bound(material, place, own)?;
        parts.push(Part::new(None, &self.shining(whole, light.as_ref())));
        for child in self.stage.children(prim)? {
            if &*self.stage.type_name(&child)? != "GeomSubset" || !self.stage.is_drawn(&child)? {
                continue;
            }
            // Sets of other families are for other ends. Source: OpenUSD, `UsdShadeMaterialBindingAPI::GetMaterialBindSubsets`.
            let family = self.stage.value(&child, "familyName")?;
            if family.as_ref().and_then(Value::text).is_none_or(|f| &**f != "materialBind") {
                continue;
            }
            let kind = self.stage.value(&child, "elementType")?;
            if kind.as_ref().and_then(Value::text).is_some_and(|k| &**k != "face") {
                continue;
            }
            let (bindings, _) = collections::bindings(&mut self.stage, &child, place.bindings.clone())?;
            let of_part = collections::material(bindings.as_ref(), &child.path);
            if of_part != material {
                let bound = self.bound(of_part, place, own)?;
                key.extend(self.stage.fingerprint(&child));
                parts.push(Part::new(Some(child), &self.shining(bound, light.as_ref())));
            }
        }
        let key = FormKey::Mesh(key, parts.iter().map(|p| p.material).collect(), binding.is_some());
        let form = self.form(key, || Form::Mesh { prim: prim.clone(), parts, shapes });
        self.draw(prim.name(), form, place)?;
        if let (Some(drawn), Some(binding)) = (self.drawn.last_mut(), binding) {
            drawn.binding = Some(binding.into());
        }
        Ok(())
    }

    fn curves(&mut self, prim: &Arc<Prim>, place: &Place) -> Read<()> {
        if self.stage.is_animated(prim, "points")? {
            self.skip_unsupported("points that move by themselves");
        }
        let colors = self.stage.value(prim, "primvars:displayColor")?.and_then(|v| v.floats());
        if colors.is_some_and(|c| c.len() > 3) {
            self.skip_unsupported("colours that differ from curve to curve");
        }
        let material = collections::material(place.bindings.as_ref(), &prim.path);
        let material = self.bound(material, place, 0)?.number;
        let key = FormKey::Mesh(self.stage.fingerprint(prim), vec![material], false);
        let form = self.form(key, || Form::Curves { prim: prim.clone(), material });
        self.draw(prim.name(), form, place)
    }

    /// Cubes, spheres and the like.
    fn solid(&mut self, kind: &str, prim: &Prim, place: &Place) -> Read<()> {
        let material = collections::material(place.bindings.as_ref(), &prim.path);
        let material = self.bound(material, place, 0)?.number;
        let number = |name: &str, default: f64| -> Read<f64> {
            Ok(self.stage.value(prim, name)?.and_then(|v| v.number()).filter(|v| v.is_finite() && *v >= 0.0).unwrap_or(default))
        };
        let axis = self.stage.value(prim, "axis")?.as_ref().and_then(Value::text).map_or("Z".to_owned(), |a| a.to_string());
        let sizes = match kind {
            "Sphere" => vec![number("radius", 1.0)?],
            "Cube" => vec![number("size", 2.0)?],
            "Plane" => vec![number("width", 2.0)?, number("length", 2.0)?],
            "Capsule" | "Capsule_1" => {
                let radius = number("radius", 0.5)?;
                vec![number("radiusBottom", radius)?, number("radiusTop", radius)?, number("height", 1.0)?]
            }
            _ => {
                let radius = number("radius", 1.0)?;
                vec![number("radiusBottom", radius)?, number("radiusTop", radius)?, number("height", 2.0)?]
            }
        };
        let is_empty = match (kind, &sizes[..]) {
            ("Plane", [width, length]) => width * length == 0.0,
            (_, [size]) => *size == 0.0,
            (_, [bottom, top, ..]) => bottom.max(*top) == 0.0,
            _ => false,
        };
        if is_empty {
            return Ok(());
        }
        let key = FormKey::Solid(format!("{kind} {axis}"), sizes.iter().map(|s| s.to_bits()).collect(), material);
        let form = self.form(key, || match kind {
            "Sphere" => Form::Ball { radius: sizes[0], material },
            _ => Form::Ready { mesh: geometry::solid(kind, &axis, &sizes), material },
        });
        self.draw(prim.name(), form, place)
    }

    /// Reads all meshes, and places everything.
    fn build(&mut self) -> Read<()> {
        let forms = std::mem::take(&mut self.forms);
        let stage = &self.stage;
        let prims = |form: &Form| if let Form::Mesh { prim, .. } = form { Some(prim.clone()) } else { None };
        let prims: Vec<Arc<Prim>> = forms.iter().filter_map(prims).collect();
        let level = subdivision::level(stage, &prims)?;
        let is_displaced =
            |form: &&Form| matches!(form, Form::Mesh { parts, .. } if parts.iter().any(|p| p.displacement.is_some()));
        let most_displaced = displaced::MOST_IN_ALL / forms.iter().filter(is_displaced).count().max(1);
        let read = |form: Form| -> Read<(Meshes, Other)> {
            Ok(match form {
                Form::Mesh { prim, parts, shapes } => {
                    (geometry::read(stage, &prim, &parts, shapes.as_deref(), level, most_displaced)?, Other::None)
                }
                Form::Ready { mesh, material } => {
                    let parts = vec![MeshPart { mesh, material, bending: None, displacement: None }];
                    (Meshes { parts, ..Default::default() }, Other::None)
                }
                Form::Ball { radius, material } => (Meshes::default(), Other::Ball(radius, material)),
                Form::Curves { prim, material } => {
                    let (curves, left_out) = curves::read(stage, &prim)?;
                    (Meshes { left_out, ..Default::default() }, Other::Curves(Box::new(curves), material))
                }
            })
        };
        let all: Vec<Read<(Meshes, Other)>> = forms.into_par_iter().map(read).collect();
        // Numbers of meshes and their materials, by form; of balls a mesh where one is needed.
        let mut numbers: Vec<Vec<(u32, u32)>> = Vec::with_capacity(all.len());
        // What bends meshes, by their numbers.
        let mut bent = HashMap::new();
        let mut balls = Vec::with_capacity(all.len());
        let mut strands: Vec<Option<(u32, u32)>> = Vec::with_capacity(all.len());
        for read in all {
            let (meshes, other) = read?;
            let (ball, curves) = match other {
                Other::None => (None, None),
                Other::Ball(radius, material) => (Some((radius, material)), None),
                Other::Curves(curves, material) => (None, Some((curves, material))),
            };
            strands.push(curves.filter(|(set, _)| !set.segments.is_empty()).map(|(set, material)| {
                self.description.curves.push(Arc::new(*set));
                (self.description.curves.len() as u32 - 1, material)
            }));
            meshes.left_out.into_iter().for_each(|what| self.skip_unsupported(what));
            let mut own = Vec::new();
            let mut before = meshes.before.into_iter();
            let mut displaced = Vec::new();
            for part in meshes.parts {
                self.description.meshes.push(part.mesh.into());
                let number = self.description.meshes.len() as u32 - 1;
                own.push((number, part.material));
                if let (Some(mesh), Some(height)) = (before.next().flatten(), part.displacement) {
                    displaced.push((number, mesh, height));
                }
                if let Some(bending) = part.bending {
                    bent.insert(number, bending);
                }
            }
            if !displaced.is_empty() {
                self.description.displaced.push(DisplacedSurface { parts: displaced, alone: None });
            }
            numbers.push(own);
            balls.push(ball);
        }
        for d in std::mem::take(&mut self.drawn) {
            if let Some((radius, material)) = balls[d.form] {
                if let (Some(sphere), None) = (shapes::sphere_in_world(radius as f32, d.local), d.node) {
                    let ball = Object::new(&d.name, Shape::Sphere(sphere), d.material(material));
                    self.description.objects.push(Object { class: d.class, ..ball });
                    continue;
                }
                if numbers[d.form].is_empty() {
                    self.description.meshes.push(shapes::ball(radius as f32).into());
                    numbers[d.form].push((self.description.meshes.len() as u32 - 1, material));
                }
            }
            if numbers[d.form].is_empty() && strands[d.form].is_none() {
                continue;
            }
            let motion = match d.node {
                None => Motion::Still,
                Some(parent) => {
                    let place = Local::Matrix(affine(d.local));
                    self.description.nodes.push(Node { parent: Some(parent), rest: place, ..Node::new(&d.name) });
                    Motion::Carried { node: self.description.nodes.len() as u32 - 1 }
                }
            };
            let world_from_mesh = affine(d.world);
            if let Some((curves, material)) = strands[d.form] {
                let shape = Shape::Curves { curves, world_from_curves: world_from_mesh };
                let (name, class, material) = (d.name.clone(), d.class.clone(), d.material(material));
                self.description.objects.push(Object { name, shape, material, motion, class });
            }
            for (mesh, material) in &numbers[d.form] {
                let mut motion = motion;
                if let (Some(binding), Some(bending)) = (&d.binding, bent.get(mesh)) {
                    let rest = Local::Matrix(affine(d.local));
                    self.description.nodes.push(Node { parent: d.node, rest, ..Node::new(&d.name) });
                    let node = self.description.nodes.len() as u32 - 1;
                    if let Some(deformer) = skeleton::deformer(self, binding, bending, *mesh, node)? {
                        self.description.deformers.push(deformer);
                        motion = Motion::Deformed { deformer: self.description.deformers.len() as u32 - 1 };
                    }
                }
                let shape = Shape::Mesh { mesh: *mesh, world_from_mesh };
                let (name, class, material) = (d.name.clone(), d.class.clone(), d.material(*material));
                self.description.objects.push(Object { name, shape, material, motion, class });
            }
        }
        Ok(())
    }
}

//! Shapes of a pbrt file in their places: meshes, curves, displaced and instanced ones, those that move.

use super::super::context::{affine, fetched, flip, parts_of};
use super::super::params::Params;
use super::super::shapes::Form;
use super::super::{Fault, Place, shapes};
use super::{Awaited, Displaced, Displacement, Met, World};
use crate::load::{DisplacedSurface, ply};
use crate::motion::{AnimatedProperty, Animation, AnimationPlayback, Channel, Extrapolation, KeyInterpolation, Local, Node};
use crate::scene::Shape;
use crate::shape::{Curves, Mesh};
use crate::subdivision;
use crate::texture::Scalar;
use glam::{DMat4, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

impl<'a> World<'a> {
    pub(super) fn shape(&mut self, kind: &str, p: &Params, place: Place) -> Result<(), Fault> {
        if !self.in_world {
            return Err(place.fault("a Shape before WorldBegin", "shapes in the world"));
        }
        if self.context.moves() && self.defining.is_some() {
            return Err(place.fault("a shape that moves within an object", "objects whose instances move"));
        }
        let alpha = match self.textures.scalar(&mut self.context, p, "alpha", 1.0)? {
            Scalar::Constant(a) if a >= 1.0 => None,
            Scalar::Constant(a) if a <= 0.0 => {
                self.context.warn(place, "a shape with alpha 0 is left out");
                self.context.say_unused(p);
                return Ok(());
            }
            Scalar::Graph(graph) if graph.is_in_space() => {
                return Err(place.fault(
                    "an alpha that depends on the place in space or on how the surface lies",
                    "a texture by texture coordinates",
                ));
            }
            other => Some(other),
        };
        let world_from_shape = self.context.place[0];
        let mut ball = None;
        let shape = match kind {
            "plymesh" => self.ply_mesh(p, place)?,
            "loopsubdiv" => {
                let (mesh, warning) = shapes::loop_subdivision(p, place)?;
                warning.into_iter().for_each(|text| self.context.warn(place, text));
                self.keep(mesh)
            }
            _ => match shapes::make(kind, p, place)? {
                Form::Sphere(radius) => match shapes::sphere_in_world(radius, world_from_shape) {
                    Some(sphere)
                        if !self.state.reversed
                            && world_from_shape.determinant() > 0.0
                            && self.defining.is_none()
                            && !self.context.moves() =>
                    {
                        ball = Some(world_from_shape * DMat4::from_scale(DVec3::splat(f64::from(radius))));
                        Shape::Sphere(sphere)
                    }
                    // Squeezed, turned inside out or instanced: many triangles.
                    _ => self.keep(shapes::ball(radius)),
                },
                Form::Mesh(mesh) => self.keep(mesh),
                Form::Curve(curve) => {
                    self.context.say_unused(p);
                    return self.curve(curve, alpha, place);
                }
            },
        };
        self.context.say_unused(p);
        let node = if self.context.moves() { Some(self.moving_node(place)?) } else { None };
        let met = Met {
            name: format!("{kind} {}", self.met.len()),
            shape,
            ball,
            node,
            material: self.state.material.clone(),
            area_light: self.state.area_light.clone(),
            alpha,
            media: self.state.media.clone(),
            place,
        };
        match &mut self.defining {
            Some((_, list)) => list.push(met),
            None => self.met.push(met),
        }
        Ok(())
    }

    /// A curve: hair comes in millions of them, so that those that follow each other and are alike but for their points become one set.
    pub(super) fn curve(&mut self, curve: Curves, alpha: Option<Scalar>, place: Place) -> Result<(), Fault> {
        /// Segments from which on a new set is begun.
        const FULL: usize = 1 << 26;
        if self.state.area_light.is_some() {
            self.context.warn(place, "curves are no area lights, as in pbrt: they are shown without their light");
        }
        if self.state.media[0] != self.state.media[1] {
            self.context.warn(place, "curves have no inside: the media of their faces are not used");
        }
        let world_from_curves = affine(self.context.place[0]);
        let node = if self.context.moves() { Some(self.moving_node(place)?) } else { None };
        let list = match &mut self.defining {
            Some((_, list)) => list,
            None => &mut self.met,
        };
        if let Some(last) = list.last()
            && let Shape::Curves { curves, world_from_curves: same } = last.shape
            && same == world_from_curves
            && (last.node, node) == (None, None)
            && last.material == self.state.material
            && last.alpha.is_none()
            && alpha.is_none()
            && let Some(set) = self.context.description.curves.get_mut(curves as usize)
            && (set.kind, set.basis) == (curve.kind, curve.basis)
            && set.segments.len() < FULL
        {
            let first = set.points.len() as u32;
            let set = Arc::make_mut(set);
            set.points.extend(curve.points);
            set.segments.extend(curve.segments.iter().map(|s| first + s));
            set.normals.extend(curve.normals);
            return Ok(());
        }
        self.context.description.curves.push(curve.into());
        let met = Met {
            name: format!("curve {}", list.len()),
            shape: Shape::Curves { curves: self.context.description.curves.len() as u32 - 1, world_from_curves },
            ball: None,
            node,
            material: self.state.material.clone(),
            area_light: None,
            alpha,
            media: Default::default(),
            place,
        };
        list.push(met);
        Ok(())
    }

    /// A node that goes from the first to the second of the transforms that hold now; straight, and turning evenly.
    pub(super) fn moving_node(&mut self, place: Place) -> Result<u32, Fault> {
        let [from, to] = self.context.place;
        let (from, to) = (parts_of(from, place)?, parts_of(to, place)?);
        let number = self.context.description.nodes.len();
        self.context.description.nodes.push(Node { rest: Local::Parts(from), ..Node::new(&format!("moving {number}")) });
        let channel = |property, values: Vec<f32>| Channel {
            node: number,
            property,
            interpolation: KeyInterpolation::Linear,
            times_s: self.context.times_s.map(|t| t as f32).to_vec(),
            values,
        };
        let channels = [
            channel(AnimatedProperty::Translation, [from.translation.to_array(), to.translation.to_array()].concat()),
            channel(AnimatedProperty::Rotation, [from.rotation.to_array(), to.rotation.to_array()].concat()),
            channel(AnimatedProperty::Scale, [from.scale.to_array(), to.scale.to_array()].concat()),
        ];
        if self.context.description.animations.is_empty() {
            self.context.description.animations.push(Animation { name: "transforms".into(), channels: vec![] });
            self.context.description.playing =
                AnimationPlayback { animations: vec![0], ending: Extrapolation::Clamp, frozen_at_s: None };
        }
        self.context.description.animations[0].channels.extend(channels);
        Ok(number as u32)
    }

    /// Adds a mesh, placed where things stand now.
    pub(super) fn keep(&mut self, mut mesh: Mesh) -> Shape {
        if self.state.reversed {
            shapes::reverse(&mut mesh);
        }
        self.context.description.meshes.push(mesh.into());
        self.placed(self.context.description.meshes.len() as u32 - 1)
    }

    pub(super) fn placed(&self, mesh: u32) -> Shape {
        Shape::Mesh { mesh, world_from_mesh: affine(self.context.place[0]) }
    }

    pub(super) fn ply_mesh(&mut self, p: &Params, place: Place) -> Result<Shape, Fault> {
        let name =
            p.text("filename")?.ok_or_else(|| place.fault("a plymesh without filename", "\"string filename\""))?.to_owned();
        let displacement = self.displacement(p, place)?;
        // The same file again is the same mesh, unless it is displaced: how it is split depends on where it stands.
        let key = (name, self.state.reversed);
        if let (Some(mesh), None) = (self.ply.get(&key), &displacement) {
            return Ok(self.placed(*mesh));
        }
        // Its triangles come with those of all others.
        let mesh = self.context.description.meshes.len() as u32;
        self.context.description.meshes.push(Arc::default());
        if displacement.is_none() {
            self.ply.insert(key.clone(), mesh);
        }
        let (name, reversed) = key;
        self.awaited.push(Awaited { mesh, name, reversed, displacement, place });
        Ok(self.placed(mesh))
    }

    pub(super) fn displacement(&mut self, p: &Params, place: Place) -> Result<Option<Displacement>, Fault> {
        if p.get("displacement").is_none() {
            return Ok(None);
        }
        let height = self.textures.scalar(&mut self.context, p, "displacement", 0.0)?;
        let edge_length = p.float("edgelength", 1.0)? as f32;
        if !(edge_length > 0.0) {
            return Err(place.fault(format!("edgelength {edge_length}"), "a length above 0"));
        }
        let world_from_mesh = affine(self.context.place[0]);
        let texture_world_from_mesh = if self.context.is_mirrored { flip() * world_from_mesh } else { world_from_mesh };
        Ok(Some(Displacement { height: Arc::new(height), edge_length, world_from_mesh, texture_world_from_mesh }))
    }

    /// Reads all meshes that are files of their own, several at a time.
    pub(super) fn read_meshes(&mut self) -> Result<(), Fault> {
        let awaited = std::mem::take(&mut self.awaited);
        let fetch = self.context.fetch;
        let read = |a: &Awaited| {
            let read = ply::read(&fetched(fetch, &a.name, a.place)?);
            let mut read = read.map_err(|e| a.place.fault(format!("{}: {}", a.name, e.found), e.expected))?;
            shapes::agree_with_normals(&mut read.mesh);
            let displaced = a.displacement.as_ref().map(|d| {
                read.mesh.drop_partial_lists();
                read.mesh.drop_broken_triangles();
                d.apply(&mut read.mesh, a.reversed)
            });
            if displaced.is_none() {
                shapes::default_uvs(&mut read.mesh);
                if a.reversed {
                    shapes::reverse(&mut read.mesh);
                }
            }
            Ok((read, displaced))
        };
        let all: Vec<Result<(ply::Read, Option<Displaced>), Fault>> = awaited.par_iter().map(read).collect();
        // Of several faults the first in the file is told.
        for (a, read) in awaited.iter().zip(all) {
            let (read, displaced) = read?;
            if let Some(warning) = read.warning {
                self.context.warn(a.place, format!("{}: {warning}", a.name));
            }
            if let (Some(done), Some(d)) = (&displaced, &a.displacement) {
                let parts = vec![(a.mesh, done.before.clone(), d.height.clone())];
                self.context
                    .description
                    .displaced
                    .push(DisplacedSurface { parts, alone: Some((d.texture_world_from_mesh, a.reversed)) });
            }
            if displaced.as_ref().is_some_and(|d| d.stopped) {
                let most = subdivision::MOST_TRIANGLES;
                let text = format!("{}: edges stay longer than edgelength: shorter ones need more than {most} triangles", a.name);
                self.context.warn(a.place, text);
            }
            if let Some(d) = displaced.filter(|d| d.without_height > 0) {
                self.context.warn(a.place, format!("{}: displacement that is no number at {} points", a.name, d.without_height));
            }
            self.context.description.meshes[a.mesh as usize] = read.mesh.into();
        }
        Ok(())
    }

    pub(super) fn instance(&mut self, name: &str, place: Place) -> Result<(), Fault> {
        let Some(met) = self.objects.remove(name) else {
            let near = diopter_light::names::nearest(name, self.objects.keys().map(String::as_str)).map(str::to_owned);
            let hint =
                near.map_or("an object that was defined before".to_owned(), |n| format!("an object (did you mean \"{n}\"?)"));
            return Err(place.fault(format!("object \"{name}\""), hint));
        };
        let at = affine(self.context.place[0]);
        let carrier = if self.context.moves() { Some(self.moving_node(place)?) } else { None };
        for m in &met {
            if m.area_light.is_some() {
                self.context.warn(place, "area lights in objects do not shine, as in pbrt");
            }
            let (shape, within) = match m.shape {
                Shape::Mesh { mesh, world_from_mesh: m } => (Shape::Mesh { mesh, world_from_mesh: at * m }, m),
                Shape::Curves { curves, world_from_curves: m } => (Shape::Curves { curves, world_from_curves: at * m }, m),
                Shape::Splats { .. } | Shape::Sphere(_) | Shape::Quad(_) => continue,
            };
            // Where the part is in the object, hung on what moves the object.
            let node = carrier.map(|parent| {
                let rest = Local::Matrix(within);
                self.context.description.nodes.push(Node { parent: Some(parent), rest, ..Node::new(&m.name) });
                self.context.description.nodes.len() as u32 - 1
            });
            let copy = Met {
                name: m.name.clone(),
                shape,
                ball: None,
                node,
                material: m.material.clone(),
                area_light: None,
                alpha: m.alpha.clone(),
                media: m.media.clone(),
                place,
            };
            self.met.push(copy);
        }
        self.objects.insert(name.to_owned(), met);
        Ok(())
    }
}

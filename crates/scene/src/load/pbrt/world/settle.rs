//! What is settled at the end of a pbrt scene: materials and media of shapes, lights, the camera, and the mirrored world.

use super::super::context::{affine, flip};
use super::super::params::Params;
use super::super::{Fault, camera, lights, shapes};
use super::{MaterialName, World};
use crate::SceneError;
use crate::material::{Coverage, Interior, Material, Scattering};
use crate::medium::Air;
use crate::motion::{Local, Motion, Node};
use crate::scene::{Description, Object, Shape, Viewpoint};
use crate::shape::Mesh;
use glam::DMat4;
use std::collections::HashMap;
use std::sync::Arc;

impl World<'_> {
    /// All names are known: materials are given to shapes, lights to materials, the camera to the world. Fails where a material or medium was never defined, a mesh
    /// cannot be read, or the film, the camera or an area light is wrong.
    pub fn finish(mut self) -> Result<Description, SceneError> {
        self.settle().map_err(|fault| self.context.error(fault))?;
        Ok(self.context.description)
    }

    fn settle(&mut self) -> Result<(), Fault> {
        self.read_meshes()?;
        if self.context.is_mirrored {
            for medium in self.media.values_mut().filter(|m| m.volume.is_some()) {
                if let Some(volume) = &mut Arc::make_mut(medium).volume {
                    **volume = volume.placed(flip());
                }
            }
        }
        let met = std::mem::take(&mut self.met);
        // Numbers in the description of materials that shapes share: those without a light or an alpha of their own.
        let mut plain: HashMap<(usize, [String; 2]), u32> = HashMap::new();
        let mut unit_ball = None;
        for mut m in met {
            let number = match &m.material {
                MaterialName::Number(n) => *n,
                MaterialName::Named(name) => self.materials.number(name).ok_or_else(|| {
                    let near = self.materials.nearest(name);
                    let hint = near
                        .map_or("a material that is defined somewhere".into(), |n| format!("a material (did you mean \"{n}\"?)"));
                    m.place.fault(format!("material \"{name}\""), hint)
                })?,
            };
            // What has pictures or is brushed needs pbrt's texture coordinates.
            let shines_by_picture = m.area_light.as_ref().is_some_and(|p| p.get("filename").is_some());
            let needs_coordinates = m.alpha.is_some()
                || shines_by_picture
                || self.materials.made(number).material.as_ref().is_some_and(Material::needs_coordinates);
            if let (Some(place), true) = (m.ball, needs_coordinates) {
                let mesh = *unit_ball.get_or_insert_with(|| {
                    self.context.description.meshes.push(shapes::ball(1.0).into());
                    self.context.description.meshes.len() as u32 - 1
                });
                m.shape = Shape::Mesh { mesh, world_from_mesh: affine(place) };
            }
            if let (Shape::Mesh { mesh, .. }, true) = (m.shape, needs_coordinates) {
                let mesh = &mut self.context.description.meshes[mesh as usize];
                // Only then a copy of its own, if others hold it.
                if mesh.uvs[0].is_empty() {
                    shapes::own_uvs(Arc::make_mut(mesh));
                }
            }
            let key = (number, m.media.clone());
            if let (Some(known), None, None) = (plain.get(&key), &m.area_light, &m.alpha) {
                self.context.description.objects.push(object(m.name, m.shape, *known, m.node));
                continue;
            }
            // The same on both sides: whatever light is in goes on.
            let interior = match m.media[0] == m.media[1] {
                true => Interior::Same,
                false => Interior::Sides([self.medium(&m.media[0], m.place)?, self.medium(&m.media[1], m.place)?]),
            };
            let mut material = match self.materials.made(number).material.clone() {
                // What is below a surface takes the place of what is around.
                Some(material) if !matches!(material.interior, Interior::Same) => material,
                Some(material) => Material { interior, ..material },
                None => {
                    if m.area_light.is_some() {
                        self.context.warn(m.place, "an area light without a surface is left out, as in pbrt");
                    }
                    // No surface, and nothing begins there either.
                    if matches!(interior, Interior::Same) {
                        continue;
                    }
                    if m.alpha.is_some() {
                        self.context.warn(m.place, "alpha of a shape without a surface is not used");
                    }
                    self.context
                        .description
                        .materials
                        .push(Material { interior, ..Material::new("interface", Scattering::Interface) });
                    let own = self.context.description.materials.len() as u32 - 1;
                    plain.insert(key, own);
                    self.context.description.objects.push(object(m.name, m.shape, own, m.node));
                    continue;
                }
            };
            let own = self.context.description.materials.len() as u32;
            if m.area_light.is_none() && m.alpha.is_none() {
                plain.insert(key, own);
            }
            if let Some(p) = &m.area_light {
                let area = area(&m.shape, &self.context.description.meshes);
                material.emission = Some(lights::emission(&mut self.context, p, area)?);
                self.context.say_unused(p);
            }
            if let Some(alpha) = m.alpha {
                material.coverage = Coverage::Blend(alpha);
            }
            self.context.description.materials.push(material);
            self.context.description.objects.push(object(m.name, m.shape, own, m.node));
        }
        self.context.description.max_depth = self.max_depth;
        let (name, place) = self.around_camera.clone();
        if let Some(medium) = self.medium(&name, place)? {
            self.context.description.air = Some(Air { medium: (*medium).clone(), bounds: None });
        }
        let mirrored = self.context.is_mirrored;
        let (film, kind) = self.film.take().unwrap_or_default();
        let film = camera::film(&mut self.context, &film, &kind)?;
        let (p, kind, camera_from_world) =
            self.camera.take().unwrap_or_else(|| (Params::default(), "perspective".into(), DMat4::IDENTITY));
        let view: Viewpoint = camera::viewpoint(&mut self.context, &p, &kind, camera_from_world, film)?;
        self.context.say_unused(&p);
        self.context.description.cameras.push(view);
        if mirrored {
            mirror(&mut self.context.description);
        }
        Ok(())
    }
}

/// A thing that stands still or hangs on a node.
fn object(name: String, shape: Shape, material: u32, node: Option<u32>) -> Object {
    let motion = node.map_or(Motion::Still, |node| Motion::Carried { node });
    Object { motion, ..Object::new(name, shape, material) }
}

/// Area of a shape, m².
fn area(shape: &Shape, meshes: &[Arc<Mesh>]) -> f32 {
    match shape {
        Shape::Sphere(s) => 4.0 * std::f32::consts::PI * s.radius.powi(2),
        Shape::Quad(q) => q.area(),
        // No lights.
        Shape::Curves { .. } | Shape::Splats { .. } => 0.0,
        Shape::Mesh { mesh, world_from_mesh } => {
            let mesh = &meshes[*mesh as usize];
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| world_from_mesh.transform_point3(mesh.positions[i as usize]).as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            };
            mesh.triangles.iter().map(area).sum::<f64>() as f32
        }
    }
}

/// Turns the world into its mirror image, z → −z.
fn mirror(d: &mut Description) {
    let flip = flip();
    for object in &mut d.objects {
        match &mut object.shape {
            Shape::Mesh { world_from_mesh: place, .. }
            | Shape::Curves { world_from_curves: place, .. }
            | Shape::Splats { world_from_splats: place, .. } => *place = flip * *place,
            Shape::Sphere(s) => s.center.z = -s.center.z,
            Shape::Quad(q) => {
                q.corner.z = -q.corner.z;
                q.edges = [q.edges[1], q.edges[0]].map(|e| e.with_z(-e.z));
            }
        }
    }
    for light in &mut d.punctual {
        *light = light.mirrored();
    }
    // What moves hangs on a mirror.
    if !d.nodes.is_empty() {
        let mirror = d.nodes.len() as u32;
        d.nodes.iter_mut().filter(|n| n.parent.is_none()).for_each(|n| n.parent = Some(mirror));
        d.nodes.push(Node { rest: Local::Matrix(flip), ..Node::new("mirror") });
    }
    if let Some(environment) = &mut d.environment {
        environment.mirror();
    }
    for camera in &mut d.cameras {
        // Its own axes are mirrored with the world: depth turns with them.
        camera.world_from_camera = flip * camera.world_from_camera;
    }
}

//! Building: what is the same at all moments of a scene.

use super::check::{check, clean, freeze_unanimated};
use super::description::{Description, Shape};
use super::hits::Placement;
use super::lights::{AreaLights, LightMotion, area_lights};
use super::mirrors::Mirrors;
use super::strands::StrandTree;
use super::{Built, Object, Posed, Scene};
use crate::SceneError;
use crate::bvh::{Bounds, Bvh, Primitive, Primitives};
use crate::light::Lights;
use crate::material::pictures::Filtering;
use crate::material::{Coverage, Material};
use crate::medium::Medium;
use crate::motion::Motion;
use crate::shape::Mesh;
use crate::shape::curves::CurvePieces;
use crate::shape::splats::SplatBoxes;
use std::sync::Arc;

impl Scene {
    /// Builds a scene. Fails when numbers do not fit: a material or mesh that is not there, nothing to see, or more than 2³⁰ − 1 triangles.
    pub fn build(mut description: Description) -> Result<Scene, SceneError> {
        check(&description)?;
        freeze_unanimated(&mut description);
        let had_surface = description.has_surface();
        clean(&mut description)?;
        if had_surface && !description.has_surface() {
            return Err(SceneError::File {
                place: description.name.clone(),
                found: "no surface: all its triangles are without area or not finite".into(),
                expected: "expected a triangle with an area".into(),
            });
        }
        crate::material::prepare(&mut description.materials);
        let d = &description;
        let mut uses = vec![0u32; d.meshes.len()];
        for object in &d.objects {
            if let Shape::Mesh { mesh, .. } = object.shape {
                // What is carried needs a hierarchy of its own, what bends makes one at each pose.
                uses[mesh as usize] += match object.motion {
                    Motion::Still => 1,
                    Motion::Carried { .. } => 2,
                    Motion::Deformed { .. } => 0,
                };
            }
        }

        // Meshes used once go into the top hierarchy as they stand; others get one of their own.
        let mut flat = Vec::new();
        let mut next = 0u32;
        for (i, object) in d.objects.iter().enumerate() {
            if let Shape::Mesh { mesh, .. } = object.shape
                && uses[mesh as usize] == 1
                && object.motion == Motion::Still
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
                        && lets_some_through(&d.materials[o.material as usize])
                });
                (*uses > 1).then(|| Bvh::build(&MeshPrimitives { mesh, filtered }))
            })
            .collect();
        let strands: Vec<StrandTree> = d
            .curves
            .iter()
            .map(|curves| {
                let levels = curves.levels();
                StrandTree { bvh: Bvh::build(&CurvePieces { curves, levels }), levels }
            })
            .collect();
        let clouds: Vec<Bvh> = d.splats.iter().map(|s| Bvh::build(&SplatBoxes(s))).collect();
        let placements: Vec<Placement> = d.objects.iter().map(Placement::new).collect();
        let others: Vec<(u32, Bounds)> = d
            .objects
            .iter()
            .enumerate()
            .filter(|(_, object)| object.motion == Motion::Still)
            .filter_map(|(i, object)| {
                let bounds = match object.shape {
                    Shape::Sphere(s) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
                    Shape::Quad(q) => {
                        // A flat box would be missed by rounding: give it a little depth.
                        let b = Bounds::around(q.corners());
                        let pad = 1e-5 * b.size().max_element().max(b.max.abs().max(b.min.abs()).max_element());
                        Bounds { min: b.min - pad, max: b.max + pad }
                    }
                    Shape::Mesh { mesh, .. } => shared[mesh as usize].as_ref()?.bounds().placed(&placements[i].world_from_object),
                    Shape::Curves { curves, .. } => {
                        let local = strands[curves as usize].bvh.bounds();
                        Some(local).filter(|b| !b.is_empty())?.placed(&placements[i].world_from_object)
                    }
                    Shape::Splats { splats, .. } => {
                        let local = clouds[splats as usize].bounds();
                        Some(local).filter(|b| !b.is_empty())?.placed(&placements[i].world_from_object)
                    }
                };
                Some((i as u32, bounds))
            })
            .collect();
        let top = Bvh::build(&TopPrimitives { description: d, flat: &flat, triangles: next as usize, others: &others });

        let AreaLights { lights, motions, light_of, first } = area_lights(d, |e| e.is_light);
        let light_motions = if motions.iter().all(|w| matches!(w, LightMotion::Still)) { Vec::new() } else { motions };
        let placements = placements.into_iter().zip(first).map(|(p, first_light)| Placement { first_light, ..p }).collect();
        let mut all = Lights::default();
        (all.area, all.punctual, all.environment) = (lights, d.punctual.clone(), d.environment.clone());
        let by_material: Vec<Option<Filtering>> = d.materials.iter().map(Material::filter_pictures).collect();
        let filtering = d.objects.iter().map(|o| by_material[o.material as usize]).collect();
        let has_straight_transmission = d.objects.iter().any(|o| d.materials[o.material as usize].may_transmit_straight());
        // What lets rays through by chance draws anew for each origin: it is asked once, along the segment that reaches it.
        let is_blended = |o: &Object| matches!(d.materials[o.material as usize].coverage, Coverage::Blend(_));
        let may_pass = |o: &Object| {
            let by_chance = is_blended(o) || matches!(o.shape, Shape::Splats { .. });
            let material = &d.materials[o.material as usize];
            by_chance || material.may_transmit_straight() || material.is_clear_body()
        };
        let may_pass = d.objects.iter().map(may_pass).collect();
        let is_clear_body: Vec<bool> = d.objects.iter().map(|o| d.materials[o.material as usize].is_clear_body()).collect();
        let has_clear_bodies = is_clear_body.contains(&true);
        let has_blends = d.objects.iter().any(is_blended);
        let media_only_absorb = d.materials.iter().flat_map(|m| m.interior.media()).all(Medium::only_absorbs);
        let may_disperse = d.objects.iter().any(|o| d.materials[o.material as usize].may_disperse());
        let built = Built {
            top,
            shared,
            strands,
            clouds,
            flat,
            placements,
            filtering,
            light_of,
            light_motions,
            may_pass,
            is_clear_body,
            has_clear_bodies,
            mirrors: Mirrors::of(d),
            has_straight_transmission,
            has_blends,
            media_only_absorb,
            may_disperse,
        };
        let mut scene = Scene {
            built: Arc::new(built),
            posed: Posed { lights: Arc::new(all), ..Posed::default() },
            air: description.air.clone(),
            flickers: false,
            flashes: Vec::new(),
            description: Arc::new(description),
        };
        scene.note_modulations();
        scene.arrange(0.0, 0.0);
        Ok(scene)
    }
}

/// Whether triangles of a material are asked about when they are hit: holes, and what shadow rays may go through.
fn lets_some_through(material: &Material) -> bool {
    !matches!(material.coverage, Coverage::Full) || material.may_transmit_straight() || material.is_clear_body()
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
        let filtered = lets_some_through(&self.description.materials[object.material as usize]);
        Primitive::Triangle { corners: corners.map(|c| world_from_mesh.transform_point3(c)), id: index as u32, filtered }
    }
}

//! A description is checked, what does not move is settled, and what no ray can meet is left out.

use super::{Description, Object, Shape};
use crate::SceneError;
use crate::light::Punctual;
use crate::motion::{Motion, Timeline};
use crate::shape::Mesh;
use crate::shape::curves::{self, CurveKind};
use crate::shape::splats;
use glam::Affine3A;
use std::sync::Arc;

fn wrong(place: String, found: impl Into<String>, expected: impl std::fmt::Display) -> SceneError {
    SceneError::File { place, found: found.into(), expected: format!("expected {expected}") }
}

/// Holds numbers against what they refer to.
pub(super) fn check(d: &Description) -> Result<(), SceneError> {
    let number = |what, of: &Object, found: u32, count: usize| match (found as usize) < count {
        true => Ok(()),
        false => Err(SceneError::Number { what, of: of.name.clone(), found: found as usize, count }),
    };
    for object in &d.objects {
        match object.motion {
            Motion::Still => {}
            Motion::Carried { node } => number("node", object, node, d.nodes.len())?,
            Motion::Deformed { deformer } => number("deformer", object, deformer, d.deformers.len())?,
        }
        let may_move = match object.motion {
            Motion::Still => true,
            Motion::Carried { .. } => {
                matches!(object.shape, Shape::Mesh { .. } | Shape::Curves { .. } | Shape::Splats { .. })
            }
            Motion::Deformed { .. } => matches!(object.shape, Shape::Mesh { .. }),
        };
        if !may_move {
            let expected = "a mesh, or curves and splats that move as a whole";
            return Err(wrong(format!("object \"{}\"", object.name), "something else that moves", expected));
        }
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
        if let Shape::Curves { curves, .. } = object.shape {
            number("set of curves", object, curves, d.curves.len())?;
        }
        if let Shape::Splats { splats, .. } = object.shape {
            number("set of splats", object, splats, d.splats.len())?;
        }
    }
    if let Some(set) = d.curves.iter().find(|c| c.segments.len() >= curves::MOST_SEGMENTS) {
        return Err(SceneError::TooLarge(set.segments.len()));
    }
    if let Some(set) = d.splats.iter().find(|s| s.len() >= splats::MOST_SPLATS) {
        return Err(SceneError::TooLarge(set.len()));
    }
    Ok(())
}

/// Turns what could move, but does not as the animations are played, into what stands still.
pub(super) fn freeze_unanimated(d: &mut Description) {
    let Description { nodes, animations, playing, deformers, objects, meshes, punctual, .. } = d;
    let timeline = Timeline::new(nodes, animations, playing);
    for object in objects {
        let (mesh, world_from_mesh) = match &mut object.shape {
            Shape::Mesh { mesh, world_from_mesh } => (mesh, world_from_mesh),
            Shape::Curves { world_from_curves: place, .. } | Shape::Splats { world_from_splats: place, .. } => {
                if let Motion::Carried { node } = object.motion
                    && !timeline.moves(node)
                {
                    *place = timeline.world(node, 0.0);
                    object.motion = Motion::Still;
                }
                continue;
            }
            Shape::Sphere(_) | Shape::Quad(_) => continue,
        };
        match object.motion {
            Motion::Carried { node } if !timeline.moves(node) => {
                *world_from_mesh = timeline.world(node, 0.0);
                object.motion = Motion::Still;
            }
            Motion::Deformed { deformer } if !timeline.bends(&deformers[deformer as usize]) => {
                let rest = &meshes[*mesh as usize];
                let pose = timeline.pose(&deformers[deformer as usize], rest, 0.0);
                let posed =
                    Mesh { positions: pose.positions, normals: pose.normals, tangents: pose.tangents, ..Mesh::clone(rest) };
                meshes.push(posed.into());
                (*mesh, *world_from_mesh) = (meshes.len() as u32 - 1, Affine3A::IDENTITY);
                object.motion = Motion::Still;
            }
            _ => {}
        }
    }
    for light in punctual {
        if let Some(node) = light.carrier.filter(|n| !timeline.moves(*n)) {
            *light = Punctual { carrier: None, ..light.placed(&timeline.world(node, 0.0)) };
        }
    }
}

/// Most meshes that a warning lists by name.
const MOST_NAMED: usize = 6;

/// One warning for all triangles that were dropped: `losses` are numbers of meshes and how many each lost. Meshes bear the name of the first object
/// made of them; those that lost most come first.
fn dropped_triangles(losses: &[(usize, usize)], objects: &[Object]) -> String {
    let mut names = std::collections::HashMap::new();
    for object in objects {
        if let Shape::Mesh { mesh, .. } = object.shape {
            names.entry(mesh as usize).or_insert(object.name.as_str());
        }
    }
    let mut sorted = losses.to_vec();
    sorted.sort_by_key(|(mesh, count)| (std::cmp::Reverse(*count), *mesh));
    let named = sorted.iter().take(MOST_NAMED).map(|(mesh, count)| match names.get(mesh) {
        Some(name) if !name.is_empty() => format!("\"{name}\": {count}"),
        _ => format!("mesh {mesh}: {count}"),
    });
    let mut list = named.collect::<Vec<_>>().join(", ");
    if sorted.len() > MOST_NAMED {
        list += &format!(", {} more", sorted.len() - MOST_NAMED);
    }
    let total: usize = losses.iter().map(|l| l.1).sum();
    let meshes = if losses.len() == 1 { "1 mesh".to_owned() } else { format!("{} meshes", losses.len()) };
    let triangles = if total == 1 { "triangle" } else { "triangles" };
    format!("{total} {triangles} of {meshes} without area or with corners that are not finite were left out ({list})")
}

/// Leaves out what no ray can meet.
pub(super) fn clean(d: &mut Description) -> Result<(), SceneError> {
    let mut bends = vec![false; d.meshes.len()];
    for object in d.objects.iter().filter(|o| matches!(o.motion, Motion::Deformed { .. })) {
        if let Shape::Mesh { mesh, .. } = object.shape {
            bends[mesh as usize] = true;
        }
    }
    let mut losses = Vec::new();
    for (i, mesh) in d.meshes.iter_mut().enumerate() {
        let n = mesh.positions.len();
        let whole = |len: usize| len == 0 || len == n;
        let lists = [mesh.normals.len(), mesh.tangents.len(), mesh.colors.len(), mesh.uvs[0].len(), mesh.uvs[1].len()];
        if let Some(other) = lists.into_iter().find(|len| !whole(*len)) {
            return Err(wrong(format!("mesh {i}"), format!("{other} attributes of its {n} vertices"), "as many, or none"));
        }
        // What is flat at rest may unfold.
        let dropped = match bends[i] {
            true if mesh.all_finite() => 0,
            false if mesh.all_usable() => 0,
            true => Arc::make_mut(mesh).drop_broken_triangles(),
            false => Arc::make_mut(mesh).drop_unusable_triangles(),
        };
        if dropped > 0 {
            losses.push((i, dropped));
        }
    }
    if !losses.is_empty() {
        let text = dropped_triangles(&losses, &d.objects);
        d.warnings.push(text);
    }
    let mut dropped = 0;
    for (i, set) in d.curves.iter_mut().enumerate() {
        let normals = if set.kind == CurveKind::Ribbon { set.segments.len() } else { 0 };
        if set.normals.len() != normals {
            let found = format!("{} pairs of normals", set.normals.len());
            return Err(wrong(format!("curves {i}"), found, format!("{normals}, one for each segment of a ribbon")));
        }
        if !set.all_usable() {
            dropped += Arc::make_mut(set).drop_unusable_segments();
        }
    }
    if dropped > 0 {
        let what = if dropped == 1 { "segment of curves was" } else { "segments of curves were" };
        d.warnings.push(format!("{dropped} {what} left out: without length, without width or not finite"));
    }
    // A placement that flattens (scale 0) or is not finite cannot be seen or inverted.
    let (warnings, before) = (&mut d.warnings, d.objects.len());
    d.objects.retain(|object| {
        let ok = match object.shape {
            Shape::Mesh { .. } | Shape::Curves { .. } | Shape::Splats { .. } if object.motion != Motion::Still => true,
            Shape::Mesh { world_from_mesh: m, .. }
            | Shape::Curves { world_from_curves: m, .. }
            | Shape::Splats { world_from_splats: m, .. } => {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::{Material, Scattering};
    use crate::scene::Scene;
    use crate::texture::Color;
    use glam::Vec3;

    #[test]
    fn triangles_without_area_make_one_warning_with_count_and_names() {
        // Mesh n has one triangle with area and n without.
        let mesh = |flat: usize| {
            let mut triangles = vec![[0, 1, 2]];
            triangles.resize(1 + flat, [0, 1, 1]);
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles, ..Default::default() }
        };
        let scene = |count: usize| {
            let object = |n: usize| {
                let shape = Shape::Mesh { mesh: n as u32, world_from_mesh: Affine3A::IDENTITY };
                Object::new(format!("part {n}"), shape, 0)
            };
            let description = Description {
                meshes: (0..count).map(|n| mesh(n).into()).collect(),
                materials: vec![Material::new("grey", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
                objects: (0..count).map(object).collect(),
                ..Default::default()
            };
            Scene::build(description).unwrap().description().warnings.clone()
        };
        assert!(scene(1).is_empty());
        let (two, many) = (scene(2), scene(10));
        assert_eq!([two.len(), many.len()], [1, 1]);
        let (two, many) = (&two[0], &many[0]);
        assert!(two.starts_with("1 triangle of 1 mesh ") && two.ends_with("(\"part 1\": 1)"), "{two}");
        assert!(many.starts_with("45 triangles of 9 meshes ") && many.contains("\"part 9\": 9, \"part 8\": 8"), "{many}");
        assert!(many.ends_with(", 3 more)") && !many.contains("part 3"), "{many}");
    }
}

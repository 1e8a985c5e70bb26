//! Meshes as subdivision surfaces.
//!
//! Source: OpenUSD, `UsdGeomMesh`. A scheme that is not said is Catmull–Clark's, as the schema has it; but where a file says normals and no scheme
//! it means polygons: many exporters write such meshes, and normals mean nothing on a subdivision surface, where they are ignored. No file says how
//! fine: [`LEVEL`]. Left out: `triangleSubdivisionRule` "smooth".

use super::layer::Value;
use super::mesh_parts::{Control, MeshPart, Meshes, Part, Per, Primvar, primvar};
use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::load::pbrt::shapes;
use crate::subdivision::{self, Boundary, Channel, Channels, ControlMesh, Scheme, Seams, SubdivisionError};
use glam::{Vec3, Vec4};
use std::sync::Arc;

/// Levels of subdivision: 16 quadrilaterals for each.
pub const LEVEL: u32 = 2;
/// Most triangles that all subdivided meshes of a scene become, each counted once: about a gigabyte with its hierarchy.
pub const MOST_IN_ALL: usize = 1 << 23;

/// How a mesh is subdivided; `None` of polygons. Fails where a value is damaged in its file.
pub fn scheme(stage: &Stage, prim: &Prim) -> Result<Option<Scheme>, SceneError> {
    let said = stage.value(prim, "subdivisionScheme")?;
    Ok(match said.as_ref().and_then(Value::text).map(|t| &**t) {
        Some("catmullClark") => Some(Scheme::CatmullClark),
        Some("loop") => Some(Scheme::Loop),
        Some("bilinear") => Some(Scheme::Bilinear),
        Some(_) => None,
        None => {
            let has_normals = stage.value(prim, "primvars:normals")?.is_some() || stage.value(prim, "normals")?.is_some();
            (!has_normals).then_some(Scheme::CatmullClark)
        }
    })
}

/// The level to which all meshes are subdivided: [`LEVEL`], or less where that would be more than [`MOST_IN_ALL`] triangles. Fails where a value is damaged in its file.
pub fn level(stage: &Stage, prims: &[Arc<Prim>]) -> Result<u32, SceneError> {
    use rayon::prelude::*;
    let faces = |prim: &Arc<Prim>| -> Result<Option<(Scheme, Vec<u32>)>, SceneError> {
        let Some(scheme) = scheme(stage, prim)? else { return Ok(None) };
        let counts = stage.value(prim, "faceVertexCounts")?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([]));
        Ok(Some((scheme, counts.iter().map(|n| (*n).max(0) as u32).collect())))
    };
    let triangles = |prim: &Arc<Prim>| -> Result<[usize; LEVEL as usize + 1], SceneError> {
        let found = faces(prim)?;
        let at = |level: usize| found.as_ref().map_or(0, |(s, counts)| subdivision::triangles_at(*s, counts, level as u32));
        Ok(std::array::from_fn(at))
    };
    let all: Vec<[usize; LEVEL as usize + 1]> = prims.par_iter().map(triangles).collect::<Result<_, _>>()?;
    let total = |level: u32| all.iter().fold(0usize, |sum, t| sum.saturating_add(t[level as usize]));
    Ok((0..=LEVEL).rev().find(|level| total(*level) <= MOST_IN_ALL).unwrap_or(0))
}

/// The meshes of a prim's parts, subdivided; `false` where that cannot be, and the control mesh is to be shown.
pub fn read(
    stage: &Stage,
    prim: &Prim,
    parts: &[Part],
    control: &Control,
    (scheme, level): (Scheme, u32),
    out: &mut Meshes,
) -> Result<bool, SceneError> {
    let text = |name: &str| -> Result<Option<Arc<str>>, SceneError> {
        Ok(stage.value(prim, name)?.as_ref().and_then(Value::text).cloned())
    };
    let boundary = match text("interpolateBoundary")?.as_deref() {
        Some("none") => Boundary::None,
        Some("edgeOnly") => Boundary::EdgeOnly,
        _ => Boundary::EdgeAndCorner,
    };
    let seams = match text("faceVaryingLinearInterpolation")?.as_deref() {
        Some("all") => Seams::AllLinear,
        Some("boundaries") => Seams::Linear,
        Some("none") => Seams::Smooth,
        _ => Seams::Corners,
    };
    let count = control.starts.last().copied().unwrap_or(0);
    let mut mesh = ControlMesh {
        positions: control.points.iter().map(|p| Vec3::from_array(*p)).collect(),
        face_sizes: control.starts.windows(2).map(|s| (s[1] - s[0]) as u32).collect(),
        corners: control.indices[..count].iter().map(|i| *i as u32).collect(),
        creases: creases(stage, prim, out)?,
        sharp_vertices: sharp_vertices(stage, prim)?,
        boundary,
        channels: vec![],
        vertex_values: vec![],
    };
    if let Some(bending) = &control.bending {
        if bending.is_too_large(subdivision::triangles_at(scheme, &mesh.face_sizes, level)) {
            out.left_out.push("subdivision of meshes with skins that are too large: control meshes are shown");
            return Ok(false);
        }
        mesh.vertex_values = bending.lanes(control.points.len());
    }
    // Each primvar once, whatever parts use it.
    let mut names: Vec<&str> = vec![];
    for name in parts.iter().flat_map(|p| &p.uvs) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let mut numbers: Vec<Option<usize>> = vec![];
    let mut add = |name: &str, width: usize, value: &dyn Fn(&[f32]) -> Vec4, mesh: &mut ControlMesh| {
        let read = primvar(stage, prim, &format!("primvars:{name}"), width, &control.size, "constant")?;
        if read.is_none() {
            out.left_out.push("primvars that do not fit their mesh");
        }
        let Some(primvar) = read.flatten() else { return Ok::<_, SceneError>(None) };
        mesh.channels.push(channel(&primvar, control, &mesh.corners, boundary, seams, value));
        Ok(Some(mesh.channels.len() - 1))
    };
    for name in &names {
        numbers.push(add(name, 2, &|v| Vec4::new(v[0], 1.0 - v[1], 0.0, 0.0), &mut mesh)?);
    }
    let colors = match parts.iter().any(|p| p.colors) {
        true => add("displayColor", 3, &|v| Vec3::from_slice(v).extend(1.0), &mut mesh)?,
        false => None,
    };
    let refined = match subdivision::subdivide(&mesh, scheme, level) {
        Ok(refined) => refined,
        Err(SubdivisionError::TooLarge) => {
            out.left_out.push("subdivision of meshes that are too large: control meshes are shown");
            return Ok(false);
        }
        Err(_) => {
            out.left_out.push("subdivision of meshes with numbers that are not finite: control meshes are shown");
            return Ok(false);
        }
    };
    if refined.level < LEVEL {
        out.left_out.push("levels of subdivision of meshes that would be too large");
    }
    for (number, part) in parts.iter().enumerate() {
        let uv = |k: usize| part.uvs.get(k).and_then(|name| numbers[names.iter().position(|n| *n == name.as_str())?]);
        let channels = Channels { uvs: [uv(0), uv(1)], colors: colors.filter(|_| part.colors) };
        let wanted = |face: u32| control.part_of[face as usize] == Some(number as u32) && !refined.hidden[face as usize];
        let (mut fine, positions) = refined.mesh_and_positions(wanted, channels);
        if fine.triangles.is_empty() {
            continue;
        }
        if control.left_handed {
            shapes::reverse(&mut fine);
        }
        let bending = control.bending.as_ref().map(|b| b.of_fine_vertices(&refined.vertex_values, &positions, &fine));
        out.parts.push(MeshPart { mesh: fine, material: part.material, bending, displacement: part.displacement.clone() });
    }
    Ok(true)
}

/// A primvar as values at corners.
fn channel(
    primvar: &Primvar,
    control: &Control,
    corners: &[u32],
    boundary: Boundary,
    seams: Seams,
    value: &dyn Fn(&[f32]) -> Vec4,
) -> Channel {
    let face_of = |corner: usize| control.starts.partition_point(|s| *s <= corner) - 1;
    let at = |corner: usize| value(primvar.at(face_of(corner), corners[corner] as usize, corner));
    match primvar.per {
        Per::Corner => {
            let (corners, values) = subdivision::indexed(corners, at);
            Channel { values, corners, seams }
        }
        // A value for a whole face: nothing is interpolated between faces.
        Per::Face => Channel {
            values: (0..corners.len()).map(at).collect(),
            corners: (0..corners.len() as u32).collect(),
            seams: Seams::AllLinear,
        },
        Per::Mesh | Per::Point => {
            let seams = match (primvar.is_varying, boundary) {
                (true, _) => Seams::AllLinear,
                (_, Boundary::EdgeAndCorner) => Seams::Corners,
                _ => Seams::Smooth,
            };
            let values = (0..control.points.len()).map(|p| value(primvar.at(0, p, 0))).collect();
            Channel { values, corners: corners.to_vec(), seams }
        }
    }
}

fn ints(stage: &Stage, prim: &Prim, name: &str) -> Result<Arc<[i32]>, SceneError> {
    Ok(stage.value(prim, name)?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([])))
}

fn floats(stage: &Stage, prim: &Prim, name: &str) -> Result<Arc<[f32]>, SceneError> {
    Ok(stage.value(prim, name)?.and_then(|v| v.floats()).unwrap_or_else(|| Arc::new([])))
}

/// Edges of creases, each a chain of vertices, with one sharpness a chain or one an edge.
fn creases(stage: &Stage, prim: &Prim, out: &mut Meshes) -> Result<Vec<([u32; 2], f32)>, SceneError> {
    let (indices, lengths) = (ints(stage, prim, "creaseIndices")?, ints(stage, prim, "creaseLengths")?);
    let sharpness = floats(stage, prim, "creaseSharpnesses")?;
    let lengths: Vec<usize> = lengths.iter().map(|n| usize::try_from(*n).unwrap_or(0)).collect();
    let vertices = lengths.iter().fold(0usize, |sum, n| sum.saturating_add(*n));
    let edges: usize = lengths.iter().map(|n| n.saturating_sub(1)).fold(0, usize::saturating_add);
    let per_chain = sharpness.len() == lengths.len();
    if vertices > indices.len() || !per_chain && sharpness.len() != edges {
        out.left_out.push("creases that do not fit their mesh");
        return Ok(vec![]);
    }
    let mut all = Vec::new();
    let (mut first, mut edge) = (0, 0);
    for (chain, length) in lengths.into_iter().enumerate() {
        for pair in indices[first..first + length].windows(2) {
            let s = sharpness[if per_chain { chain } else { edge }];
            edge += 1;
            if let (Ok(a), Ok(b)) = (u32::try_from(pair[0]), u32::try_from(pair[1])) {
                all.push(([a, b], s));
            }
        }
        first += length;
    }
    Ok(all)
}

fn sharp_vertices(stage: &Stage, prim: &Prim) -> Result<Vec<(u32, f32)>, SceneError> {
    let (indices, sharpness) = (ints(stage, prim, "cornerIndices")?, floats(stage, prim, "cornerSharpnesses")?);
    Ok(indices.iter().zip(sharpness.iter()).filter_map(|(v, s)| Some((u32::try_from(*v).ok()?, *s))).collect())
}

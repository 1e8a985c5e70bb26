//! Meshes and solids.
//!
//! Source: OpenUSD, `UsdGeomMesh` (faces of any number of corners, holes, orientation; `subdivision` has the surfaces), `UsdGeomPrimvar` (interpolation, indices),
//! `UsdGeomSubset`. Texture coordinates run up in USD; ours run down, so v becomes 1 − v here.

use super::bending;
use super::layer::Value;
use super::mesh_parts::{Control, MeshPart, Meshes, Part, Primvar, Size, primvar};
use super::stage::{Prim, Stage};
use super::subdivision;
use crate::SceneError;
use crate::load::displaced;
use crate::load::pbrt::shapes;
use crate::load::polygon::triangulate;
use crate::shape::Mesh;
use crate::texture::Scalar;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::collections::HashSet;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Steps around solids, as for those of pbrt.
const AROUND: usize = 256;

/// Reads a mesh, subdivided to a level if it is a subdivision surface: one for each part that has faces.
///
/// `shapes` are the blend shapes of a mesh that hangs on a skeleton; `None` of others. A displaced mesh has `most_displaced` triangles at most. Fails where a value of it
/// is damaged in its file; faces that do not fit their points are left out.
pub fn read(
    stage: &Stage,
    prim: &Prim,
    parts: &[Part],
    shapes: Option<&[Option<Arc<Prim>>]>,
    level: u32,
    most_displaced: usize,
) -> Result<Meshes, SceneError> {
    let mut out = Meshes::default();
    let Some(mut control) = control(stage, prim, parts)? else {
        out.left_out.push("meshes whose faces do not fit their points");
        return Ok(out);
    };
    if let Some(shapes) = shapes {
        control.bending = bending::read(stage, prim, shapes, control.points.len(), &mut out.left_out)?;
    }
    let is_subdivided = match subdivision::scheme(stage, prim)? {
        Some(scheme) => subdivision::read(stage, prim, parts, &control, (scheme, level), &mut out)?,
        None => false,
    };
    if !is_subdivided {
        polygons(stage, prim, parts, &control, &mut out)?;
    }
    displace(&mut out, most_displaced);
    Ok(out)
}

/// Moves points by the heights of their materials, all parts that have some together.
fn displace(out: &mut Meshes, most: usize) {
    if out.parts.iter().any(|p| p.displacement.is_some() && p.bending.is_some()) {
        out.left_out.push("displacement of what skeletons bend");
        return;
    }
    let heights: Vec<Option<Arc<Scalar>>> = out.parts.iter().map(|p| p.displacement.clone()).collect();
    out.before = out.parts.iter().map(|p| p.displacement.is_some().then(|| Arc::new(p.mesh.clone()))).collect();
    let all = out.parts.iter_mut().zip(&heights).filter_map(|(p, height)| Some((&mut p.mesh, height.as_deref()?)));
    let mut all: Vec<(&mut Mesh, &Scalar)> = all.collect();
    if all.is_empty() {
        return;
    }
    let done = displaced::displace(&mut all, most);
    if done.stopped {
        out.left_out.push("fineness of displaced meshes that would be too large");
    }
    if done.without_height > 0 {
        out.left_out.push("displacement by what is no number");
    }
}

/// The faces of a mesh; `None` where they do not fit its points.
fn control(stage: &Stage, prim: &Prim, parts: &[Part]) -> Result<Option<Control>, SceneError> {
    let ints = |name: &str| -> Result<Arc<[i32]>, SceneError> {
        Ok(stage.value(prim, name)?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([])))
    };
    let points = stage.value(prim, "points")?.and_then(|v| v.floats()).unwrap_or_else(|| Arc::new([]));
    let points: Vec<[f32; 3]> = points.as_chunks().0.to_vec();
    let (counts, indices, holes) = (ints("faceVertexCounts")?, ints("faceVertexIndices")?, ints("holeIndices")?);
    let mut starts = Vec::with_capacity(counts.len() + 1);
    let mut corners = 0usize;
    for n in counts.iter() {
        starts.push(corners);
        corners = corners.saturating_add(usize::try_from(*n).unwrap_or(usize::MAX));
    }
    starts.push(corners);
    if corners > indices.len() || indices.iter().any(|i| !usize::try_from(*i).is_ok_and(|i| i < points.len())) {
        return Ok(None);
    }
    let size = Size { faces: counts.len(), points: points.len(), corners: indices.len() };
    let left_handed = stage.value(prim, "orientation")?.as_ref().and_then(Value::text).is_some_and(|o| &**o == "leftHanded");
    let mut part_of = vec![Some(0u32); counts.len()];
    for (number, part) in parts.iter().enumerate() {
        let Some(subset) = &part.subset else { continue };
        let faces = stage.value(subset, "indices")?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([]));
        for face in faces.iter().filter_map(|f| usize::try_from(*f).ok()) {
            if let Some(of) = part_of.get_mut(face) {
                *of = Some(number as u32);
            }
        }
    }
    let holes: HashSet<i32> = holes.iter().copied().collect();
    for (face, part) in part_of.iter_mut().enumerate() {
        if counts[face] < 3 || holes.contains(&(face as i32)) {
            *part = None;
        }
    }
    Ok(Some(Control { points, indices, starts, size, left_handed, part_of, bending: None }))
}

/// The faces as they are.
fn polygons(stage: &Stage, prim: &Prim, parts: &[Part], control: &Control, out: &mut Meshes) -> Result<(), SceneError> {
    let Control { points, indices, starts, size, left_handed, part_of, bending } = control;
    let mut get = |name: &str, width: usize, default: &str| -> Result<Option<Primvar>, SceneError> {
        let read = primvar(stage, prim, name, width, size, default)?;
        if read.is_none() {
            out.left_out.push("primvars that do not fit their mesh");
        }
        Ok(read.flatten())
    };
    let mut normals = get("primvars:normals", 3, "vertex")?;
    if normals.is_none() {
        normals = get("normals", 3, "vertex")?;
    }
    let colors = if parts.iter().any(|p| p.colors) { get("primvars:displayColor", 3, "constant")? } else { None };
    let mut faces_of: Vec<Vec<u32>> = vec![vec![]; parts.len()];
    for (face, part) in part_of.iter().enumerate() {
        if let Some(part) = part {
            faces_of[*part as usize].push(face as u32);
        }
    }
    // The first vertex of each point, and the next one of the same point with other values.
    let mut first = vec![u32::MAX; points.len()];
    for (part, faces) in parts.iter().zip(faces_of) {
        if faces.is_empty() {
            continue;
        }
        let mut uvs: [Option<Primvar>; 2] = [None, None];
        for (slot, name) in uvs.iter_mut().zip(&part.uvs) {
            let read = primvar(stage, prim, &format!("primvars:{name}"), 2, size, "constant")?;
            if read.is_none() {
                out.left_out.push("primvars that do not fit their mesh");
            }
            *slot = read.flatten();
        }
        let colors = colors.as_ref().filter(|_| part.colors);
        let mut mesh = Mesh::default();
        let mut point_of: Vec<u32> = vec![];
        let (mut next, mut touched): (Vec<u32>, Vec<u32>) = (vec![], vec![]);
        let mut polygon: Vec<u32> = Vec::new();
        for face in faces {
            let face = face as usize;
            polygon.clear();
            for corner in starts[face]..starts[face + 1] {
                let point = indices[corner] as usize;
                let normal = normals.as_ref().map(|n| Vec3::from_slice(n.at(face, point, corner)).normalize_or_zero());
                let uv = [0, 1].map(|k: usize| {
                    uvs[k].as_ref().map(|u| {
                        let at = u.at(face, point, corner);
                        Vec2::new(at[0], 1.0 - at[1])
                    })
                });
                let color = colors.map(|c| Vec3::from_slice(c.at(face, point, corner)).extend(1.0));
                let mut vertex = first[point];
                while vertex != u32::MAX {
                    let v = vertex as usize;
                    let same = normal.is_none_or(|n| n == mesh.normals[v])
                        && uv[0].is_none_or(|u| u == mesh.uvs[0][v])
                        && uv[1].is_none_or(|u| u == mesh.uvs[1][v])
                        && color.is_none_or(|c| c == mesh.colors[v]);
                    if same {
                        break;
                    }
                    vertex = next[v];
                }
                if vertex == u32::MAX {
                    vertex = mesh.positions.len() as u32;
                    mesh.positions.push(Vec3::from_array(points[point]));
                    point_of.push(point as u32);
                    mesh.normals.extend(normal);
                    (0..2).for_each(|k| mesh.uvs[k].extend(uv[k]));
                    mesh.colors.extend(color);
                    if first[point] == u32::MAX {
                        touched.push(point as u32);
                        next.push(u32::MAX);
                        first[point] = vertex;
                    } else {
                        // Behind the first: chains stay in the order of use.
                        let head = first[point] as usize;
                        next.push(next[head]);
                        next[head] = vertex;
                    }
                }
                polygon.push(vertex);
            }
            let before = mesh.triangles.len();
            triangulate(&polygon, &mesh.positions, &mut mesh.triangles);
            if *left_handed {
                mesh.triangles[before..].iter_mut().for_each(|t| t.swap(1, 2));
            }
        }
        touched.iter().for_each(|p| first[*p as usize] = u32::MAX);
        let bending = bending.as_ref().map(|b| b.of_vertices(&point_of, &mesh));
        out.parts.push(MeshPart { mesh, material: part.material, bending, displacement: part.displacement.clone() });
    }
    Ok(())
}

/// Adds a mesh to another.
fn join(mesh: &mut Mesh, other: Mesh) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions);
    mesh.normals.extend(other.normals);
    mesh.uvs[0].extend(&other.uvs[0]);
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
}

/// A body of revolution about z from radius and height along it; outside is to the right of the way up.
fn turned(profile: &[(f64, f64)]) -> Mesh {
    let mut mesh = Mesh::default();
    for pair in profile.windows(2) {
        let ((r0, z0), (r1, z1)) = (pair[0], pair[1]);
        if pair[0] == pair[1] {
            continue;
        }
        let slope = DVec2::new(z1 - z0, r0 - r1).normalize_or_zero();
        let point = |u: f32, v: f32| {
            let (phi, v) = (TAU * f64::from(u), f64::from(v));
            let (r, z) = (r0 + (r1 - r0) * v, z0 + (z1 - z0) * v);
            let (s, c) = if u >= 1.0 { (0.0, 1.0) } else { phi.sin_cos() };
            let n = DVec3::new(c * slope.x, s * slope.x, slope.y);
            (DVec3::new(r * c, r * s, z).as_vec3(), n.as_vec3())
        };
        join(&mut mesh, shapes::grid([AROUND, 1], point));
    }
    mesh
}

/// Half a sphere about z, from the equator up (`sign` 1) or down, moved along z.
fn dome(radius: f64, sign: f64, z: f64) -> Mesh {
    let point = |u: f32, v: f32| {
        let (phi, theta) = (TAU * f64::from(u), 0.5 * PI * f64::from(v));
        let (s, c) = if u >= 1.0 { (0.0, 1.0) } else { phi.sin_cos() };
        let r = if v >= 1.0 { 0.0 } else { theta.cos() };
        let n = DVec3::new(r * c, r * s, sign * theta.sin());
        ((n * radius + DVec3::Z * z).as_vec3(), n.as_vec3())
    };
    shapes::grid([AROUND, AROUND / 4], point)
}

/// A flat piece that faces along a normal: its middle and half edges, right-handed with the normal.
pub fn rectangle(middle: Vec3, half: [Vec3; 2]) -> Mesh {
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    Mesh {
        positions: corners.iter().map(|c| middle + half[0] * (2.0 * c.x - 1.0) + half[1] * (2.0 * c.y - 1.0)).collect(),
        uvs: [corners.iter().map(|c| Vec2::new(c.x, 1.0 - c.y)).collect(), vec![]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// A disc in the plane z = 0; `facing` tells the side.
pub fn disc(radius: f64, facing: f32) -> Mesh {
    let mut mesh = if facing > 0.0 { turned(&[(radius, 0.0), (0.0, 0.0)]) } else { turned(&[(0.0, 0.0), (radius, 0.0)]) };
    mesh.normals.iter_mut().for_each(|n| *n = Vec3::Z * facing);
    mesh
}

/// An open tube along x.
pub fn tube(radius: f64, length: f64) -> Mesh {
    along(turned(&[(radius, -0.5 * length), (radius, 0.5 * length)]), "X")
}

/// What was made along z, along another axis.
fn along(mut mesh: Mesh, axis: &str) -> Mesh {
    let turn = |v: Vec3| match axis {
        "X" => Vec3::new(v.z, v.x, v.y),
        "Y" => Vec3::new(v.y, v.z, v.x),
        _ => v,
    };
    mesh.positions.iter_mut().for_each(|p| *p = turn(*p));
    mesh.normals.iter_mut().for_each(|n| *n = turn(*n));
    mesh
}

/// A solid by the name of its schema and its sizes. Source: OpenUSD, `UsdGeomCube`, `Cylinder`, `Cone`, `Capsule`, `Plane`.
pub fn solid(kind: &str, axis: &str, sizes: &[f64]) -> Mesh {
    let mut mesh = match (kind, sizes) {
        ("Cube", [size]) => return cube(0.5 * *size as f32),
        ("Plane", [width, length]) => {
            let (w, l) = (0.5 * *width as f32, 0.5 * *length as f32);
            return match axis {
                "X" => rectangle(Vec3::ZERO, [Vec3::NEG_Z * w, Vec3::Y * l]),
                "Y" => rectangle(Vec3::ZERO, [Vec3::X * w, Vec3::NEG_Z * l]),
                _ => rectangle(Vec3::ZERO, [Vec3::X * w, Vec3::Y * l]),
            };
        }
        ("Capsule" | "Capsule_1", [bottom, top, height]) => {
            let half = 0.5 * height;
            let mut mesh = turned(&[(*bottom, -half), (*top, half)]);
            join(&mut mesh, dome(*top, 1.0, half));
            join(&mut mesh, dome(*bottom, -1.0, -half));
            along(mesh, axis)
        }
        (_, [bottom, top, height]) => {
            let (half, top) = (0.5 * height, if kind == "Cone" { 0.0 } else { *top });
            along(turned(&[(0.0, -half), (*bottom, -half), (top, half), (0.0, half)]), axis)
        }
        _ => Mesh::default(),
    };
    mesh.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    mesh
}

/// A cube about the origin.
pub fn cube(half: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for (n, u) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for side in [1.0, -1.0] {
            let (normal, u) = (n * side, u * side);
            let mut face = rectangle(normal * half, [u * half, normal.cross(u) * half]);
            face.normals = vec![normal; 4];
            join(&mut mesh, face);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(mesh: &Mesh) -> f64 {
        let six: f64 = (0..mesh.triangles.len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t).map(|p| p.as_dvec3());
                a.dot(b.cross(c))
            })
            .sum();
        six / 6.0
    }

    #[test]
    fn solids_have_their_volumes_outside_out() {
        // 256 sides leave out 1e-4 of a circle's area; half spheres of 64 rings 3e-4.
        for (kind, sizes, expected) in [
            ("Cube", vec![3.0], 27.0),
            ("Cylinder", vec![2.0, 2.0, 5.0], PI * 20.0),
            ("Cone", vec![2.0, 2.0, 6.0], PI * 8.0),
            ("Capsule", vec![1.0, 1.0, 3.0], PI * (3.0 + 4.0 / 3.0)),
        ] {
            for axis in ["X", "Y", "Z"] {
                let mesh = solid(kind, axis, &sizes);
                assert!((volume(&mesh) / expected - 1.0).abs() < 1e-3, "{kind} {axis}: {} {expected}", volume(&mesh));
                for (t, corners) in mesh.triangles.iter().enumerate() {
                    let [a, b, c] = mesh.corners(t);
                    assert!((b - a).cross(c - a).dot(mesh.normals[corners[0] as usize]) > 0.0, "{kind} {axis} {t}");
                }
            }
        }
        for (axis, normal) in [("X", Vec3::X), ("Y", Vec3::Y), ("Z", Vec3::Z)] {
            let [a, b, c] = solid("Plane", axis, &[2.0, 4.0]).corners(0);
            assert!((b - a).cross(c - a).normalize().dot(normal) > 0.999, "{axis}");
        }
        for facing in [1.0, -1.0] {
            let d = disc(1.0, facing);
            let area: f32 = (0..d.triangles.len())
                .map(|t| {
                    let [a, b, c] = d.corners(t);
                    (b - a).cross(c - a).z * 0.5
                })
                .sum();
            assert!((area * facing / std::f32::consts::PI - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn faces_that_bend_inwards_are_cut_along_their_inside() {
        // An arrow head, an L and a square: areas add up without overlap.
        for (points, area) in [
            (vec![(0.0, 0.0), (2.0, -1.0), (0.5, 0.0), (2.0, 1.0)], 0.5),
            (vec![(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)], 3.0),
            (vec![(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], 1.0),
        ] {
            for flipped in [false, true] {
                let positions: Vec<Vec3> = points.iter().map(|(x, y)| Vec3::new(*x, *y, 3.0)).collect();
                let mut polygon: Vec<u32> = (0..points.len() as u32).collect();
                if flipped {
                    polygon.reverse();
                }
                let mut triangles = vec![];
                triangulate(&polygon, &positions, &mut triangles);
                assert_eq!(triangles.len(), points.len() - 2);
                let signed: Vec<f32> = triangles
                    .iter()
                    .map(|t| {
                        let [a, b, c] = t.map(|i| positions[i as usize]);
                        0.5 * (b - a).cross(c - a).z
                    })
                    .collect();
                let sign = if flipped { -1.0 } else { 1.0 };
                assert!(signed.iter().all(|a| a * sign > 0.0), "{signed:?}");
                assert!((signed.iter().sum::<f32>() * sign - area).abs() < 1e-5, "{signed:?}");
            }
        }
    }
}

//! Shapes as meshes. Texture coordinates of Mitsuba run down the image, as ours do; those of OBJ files are turned by the caller.

use super::tree::Node;
use super::values::{number, vector};
use super::wrong;
use crate::SceneError;
use crate::load::obj::plain_statements;
use crate::load::pbrt::shapes::grid;
use crate::load::{lossy, ply, unzipped};
use crate::shape::Mesh;
use crate::subdivision::vertex_normals;
use glam::{DMat4, DVec3, Vec2, Vec3};
use std::f32::consts::TAU;
use std::io::{Cursor, Read as _};

/// Steps around round shapes, as for those of pbrt.
const AROUND: usize = 256;
/// Most bytes that a packed mesh may become for each of its file (RFC 1951).
const MOST_EXPANDED: u64 = 1032;

/// Faces of a cube, each from where its texture coordinates are (0, 1), counterclockwise from outside. Source: what Mitsuba 3.9.1 gives as vertex_positions and vertex_texcoords of its cube.
const CUBE: [[[i8; 3]; 4]; 6] = [
    [[1, -1, -1], [1, -1, 1], [-1, -1, 1], [-1, -1, -1]],
    [[1, 1, -1], [-1, 1, -1], [-1, 1, 1], [1, 1, 1]],
    [[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]],
    [[1, -1, 1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1]],
    [[-1, -1, 1], [-1, 1, 1], [-1, 1, -1], [-1, -1, -1]],
    [[1, 1, -1], [1, -1, -1], [-1, -1, -1], [-1, 1, -1]],
];

/// A shape without a file, and its place in the shape's space. Fails where it is of another kind, and for a cylinder without length or radius.
pub fn make(node: &Node, kind: &str) -> Result<(Mesh, DMat4), SceneError> {
    let flat = |points: [Vec3; 4], normal: Vec3| Mesh {
        positions: points.to_vec(),
        normals: vec![normal; 4],
        uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], vec![]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let turn = |u: f32| if u >= 1.0 { (0.0, 1.0) } else { (TAU * u).sin_cos() };
    Ok(match kind {
        "rectangle" => (flat(square.map(|[x, y]| Vec3::new(x, y, 0.0)), Vec3::Z), DMat4::IDENTITY),
        "cube" => {
            let mut mesh = Mesh::default();
            for corners in CUBE {
                let corners = corners.map(|[x, y, z]| Vec3::new(f32::from(x), f32::from(y), f32::from(z)));
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
                let first = mesh.positions.len() as u32;
                mesh.positions.extend(corners);
                mesh.normals.extend([normal; 4]);
                mesh.uvs[0].extend([Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO]);
                mesh.triangles.extend([[0, 1, 2], [3, 0, 2]].map(|t: [u32; 3]| t.map(|i| i + first)));
            }
            (mesh, DMat4::IDENTITY)
        }
        "disk" => {
            let point = |u: f32, v: f32| {
                let (s, c) = turn(u);
                (Vec3::new(c, s, 0.0) * v, Vec3::Z)
            };
            let mut mesh = grid([AROUND, 1], point);
            // The radius comes first.
            mesh.uvs[0].iter_mut().for_each(|uv| *uv = Vec2::new(uv.y, uv.x));
            (mesh, DMat4::IDENTITY)
        }
        "cylinder" => {
            let (p0, p1, radius) =
                (vector(node, "p0", DVec3::ZERO)?, vector(node, "p1", DVec3::Z)?, number(node, "radius", 1.0)?);
            let axis = (p1 - p0).try_normalize().filter(|_| radius > 0.0);
            let axis = axis.ok_or_else(|| wrong(node, "a cylinder without length or radius", "p0, p1 and radius"))?;
            let (x, y) = axis.any_orthonormal_pair();
            let point = |u: f32, v: f32| {
                let (s, c) = turn(u);
                (Vec3::new(c, s, v), Vec3::new(c, s, 0.0))
            };
            let hand = x.cross(y).dot(axis).signum();
            let own = DMat4::from_cols(
                (x * radius).extend(0.0),
                (y * radius * hand).extend(0.0),
                (p1 - p0).extend(0.0),
                p0.extend(1.0),
            );
            (grid([AROUND, 1], point), own)
        }
        other => {
            let known = "obj, ply, serialized, sphere, cylinder, disk, rectangle, cube, linearcurve, bsplinecurve, shapegroup, instance: others are not supported";
            return Err(wrong(node, format!("shape \"{other}\""), known));
        }
    })
}

/// A mesh of a file: `kind` is "ply", "obj" or, of anything else, Mitsuba's serialized meshes, of which `part` counts from 0. Fails with the reason where it is damaged,
/// cut short or without faces, or has no such part.
pub fn read(kind: &str, bytes: Vec<u8>, part: usize) -> Result<Mesh, String> {
    match kind {
        "ply" => ply::read(&unzipped(bytes)?).map(|r| r.mesh).map_err(|e| format!("{}, expected {}", e.found, e.expected)),
        "obj" => obj(&bytes),
        _ => serialized(&bytes, part),
    }
}

/// All groups of an OBJ file as one mesh.
fn obj(bytes: &[u8]) -> Result<Mesh, String> {
    let bytes = &*plain_statements(bytes);
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let (models, _) =
        tobj::load_obj_buf(&mut Cursor::new(lossy(bytes)), &options, |_| Ok(Default::default())).map_err(|e| e.to_string())?;
    let mut mesh = Mesh::default();
    let has_normals = |m: &tobj::Mesh| m.normals.len() == m.positions.len();
    let has_uvs = |m: &tobj::Mesh| m.texcoords.len() / 2 == m.positions.len() / 3;
    let any_has = |has: &dyn Fn(&tobj::Mesh) -> bool| models.iter().any(|m| !m.mesh.indices.is_empty() && has(&m.mesh));
    let (normals, uvs) = (any_has(&has_normals), any_has(&has_uvs));
    for model in &models {
        let m = &model.mesh;
        if m.indices.is_empty() {
            continue;
        }
        let first = mesh.positions.len() as u32;
        let mut part = Mesh {
            positions: m.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            triangles: m.indices.as_chunks::<3>().0.to_vec(),
            ..Mesh::default()
        };
        // Groups that lack what others have do not take it from them.
        if normals {
            part.normals = match has_normals(m) {
                true => m.normals.chunks_exact(3).map(|n| Vec3::from_slice(n).normalize_or_zero()).collect(),
                false => vertex_normals(&part),
            };
        }
        if uvs {
            part.uvs[0] = match has_uvs(m) {
                true => m.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
                false => vec![Vec2::ZERO; part.positions.len()],
            };
        }
        mesh.positions.extend(part.positions);
        mesh.normals.extend(part.normals);
        mesh.uvs[0].extend(&part.uvs[0]);
        mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
    }
    if mesh.triangles.is_empty() {
        return Err("it has no faces".to_owned());
    }
    Ok(mesh)
}

/// A part of a serialized file. Source: Mitsuba 3, `serialized`: the number 0x041C, a version, packed meshes, and where each begins at the end.
fn serialized(bytes: &[u8], part: usize) -> Result<Mesh, String> {
    let short = || "it is cut short".to_owned();
    let u16_at = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
    if u16_at(0) != Some(0x041c) {
        return Err("it does not begin with 0x041C".to_owned());
    }
    let version = u16_at(2).ok_or_else(short)?;
    let count = bytes.last_chunk::<4>().map(|b| u32::from_le_bytes(*b) as usize).ok_or_else(short)?;
    let width = match version {
        3 => 4,
        4 => 8,
        other => return Err(format!("version {other} instead of 3 or 4")),
    };
    if part >= count {
        return Err(format!("shape_index {part} of {count}"));
    }
    let table = count.checked_mul(width).and_then(|n| (bytes.len() - 4).checked_sub(n)).ok_or_else(short)?;
    let entry = bytes.get(table + part * width..table + (part + 1) * width).ok_or_else(short)?;
    let mut wide = [0; 8];
    wide[..width].copy_from_slice(entry);
    let start = usize::try_from(u64::from_le_bytes(wide)).ok().and_then(|s| s.checked_add(4)).ok_or_else(short)?;
    let packed = bytes.get(start..table).ok_or_else(short)?;
    let mut data = Vec::new();
    // What lies behind the mesh is the next one.
    flate2::read::ZlibDecoder::new(packed)
        .take(packed.len() as u64 * MOST_EXPANDED)
        .read_to_end(&mut data)
        .map_err(|e| e.to_string())?;
    let mut rest = &data[..];
    let mut take = |n: usize| -> Result<&[u8], String> {
        let (head, tail) = rest.split_at_checked(n).ok_or_else(short)?;
        rest = tail;
        Ok(head)
    };
    let flags = u32::from_le_bytes(take(4)?.try_into().map_err(|_| short())?);
    if version == 4 {
        while take(1)?[0] != 0 {}
    }
    let mut long = || -> Result<usize, String> {
        let n = u64::from_le_bytes(take(8)?.try_into().map_err(|_| short())?);
        usize::try_from(n).ok().filter(|n| *n <= u32::MAX as usize).ok_or_else(|| format!("a mesh of {n} corners or triangles"))
    };
    let (corners, triangles) = (long()?, long()?);
    let double = flags & 0x2000 != 0;
    let mut list = |width: usize| -> Result<Vec<f32>, String> {
        let all = take(corners * width * if double { 8 } else { 4 })?;
        Ok(match double {
            true => all.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
            false => all.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        })
    };
    let triples = |v: Vec<f32>| v.as_chunks::<3>().0.iter().map(|p| Vec3::from_array(*p)).collect::<Vec<_>>();
    let mut mesh = Mesh { positions: triples(list(3)?), ..Mesh::default() };
    if flags & 1 != 0 {
        mesh.normals = triples(list(3)?).into_iter().map(|n| n.normalize_or_zero()).collect();
    }
    if flags & 2 != 0 {
        mesh.uvs[0] = list(2)?.as_chunks::<2>().0.iter().map(|p| Vec2::from_array(*p)).collect();
    }
    if flags & 8 != 0 {
        list(3)?;
    }
    if flags & 0x10 != 0 {
        mesh.normals.clear();
    }
    let indices = take(triangles * 12)?.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect::<Vec<_>>();
    if indices.iter().any(|i| *i as usize >= corners) {
        return Err(format!("a corner that is not one of {corners}"));
    }
    mesh.triangles = indices.as_chunks::<3>().0.to_vec();
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// A file of one triangle, with normals and texture coordinates.
    fn file(version: u16) -> Vec<u8> {
        let mut data = (0x1000u32 | 3).to_le_bytes().to_vec();
        if version == 4 {
            data.extend(b"name\0");
        }
        data.extend(3u64.to_le_bytes());
        data.extend(1u64.to_le_bytes());
        let numbers = [
            0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0,
            1.0,
        ];
        numbers.iter().for_each(|v| data.extend(v.to_le_bytes()));
        [0u32, 1, 2].iter().for_each(|v| data.extend(v.to_le_bytes()));
        let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        packed.write_all(&data).unwrap();
        let mut out = [0x041cu16.to_le_bytes(), version.to_le_bytes()].concat();
        out.extend(packed.finish().unwrap());
        out.extend(if version == 4 { 0u64.to_le_bytes().to_vec() } else { 0u32.to_le_bytes().to_vec() });
        out.extend(1u32.to_le_bytes());
        out
    }

    #[test]
    fn serialized_meshes_are_read_and_damaged_ones_refused() {
        for version in [3, 4] {
            let whole = file(version);
            let mesh = serialized(&whole, 0).unwrap();
            assert_eq!((mesh.triangles.len(), mesh.normals[1], mesh.uvs[0][1]), (1, Vec3::Z, Vec2::X));
            for cut in 0..whole.len() {
                assert!(serialized(&whole[..cut], 0).is_err(), "{cut}");
            }
            for i in 0..whole.len() {
                let mut changed = whole.clone();
                changed[i] = 0xff;
                let _ = serialized(&changed, 0);
            }
            assert!(serialized(&whole, 1).unwrap_err().contains("shape_index"));
        }
    }
}

//! Meshes without a scene around them: PLY and STL. They bring no light: the shot adds a studio, a sky or a map.

use super::{ply, splats, unzipped};
use crate::SceneError;
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Shape};
use crate::shape::Mesh;
use crate::texture::Color;
use glam::{Affine3A, Vec3};
use std::collections::HashMap;

/// Reflectance of what says nothing of itself.
pub(super) const GREY: f32 = 0.6;

pub(super) fn error(place: String, found: impl Into<String>, expected: impl Into<String>) -> SceneError {
    SceneError::File { place, found: found.into(), expected: format!("expected {}", expected.into()) }
}

/// What some programs write before a text in UTF-8.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

fn alone(name: &str, mesh: Mesh, warnings: Vec<String>) -> Description {
    let grey = if mesh.colors.is_empty() { Color::rgb(GREY, GREY, GREY) } else { Color::rgb(1.0, 1.0, 1.0) };
    Description {
        name: name.to_owned(),
        meshes: vec![mesh.into()],
        materials: vec![Material::new("grey", Scattering::Diffuse(grey))],
        objects: vec![Object::new(name, Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 0)],
        warnings,
        ..Default::default()
    }
}

/// Reads a PLY file, gzip or not: polygons, or Gaussian splats ([`splats`]). Fails where its header or data are damaged or cut short, it has no vertices or no faces, or,
/// of Gaussians, a property is missing or none is usable.
pub fn ply(bytes: Vec<u8>, name: &str) -> Result<Description, SceneError> {
    let bytes = unzipped(bytes).map_err(|e| error(name.into(), e, "a PLY file or a .gz of it"))?;
    if let Some(capture) = splats::ply(&bytes, name)? {
        return Ok(capture);
    }
    let read = ply::read(&bytes).map_err(|e| error(name.into(), e.found, e.expected))?;
    if read.mesh.triangles.is_empty() {
        let found = format!("no surface: {} vertices without a face", read.mesh.positions.len());
        return Err(error(name.into(), found, "an element \"face\" or \"tristrips\" (point clouds are not drawn)"));
    }
    Ok(alone(name, read.mesh, read.warning.map(|w| format!("{name}: {w}")).into_iter().collect()))
}

/// Reads an STL file, text or binary. Source: 3D Systems 1988, as M. Burns describes it in "Automated Fabrication", §6.5. Units of the file are taken for metres. Fails
/// where it is neither text nor as long as its count says, a vertex has not three numbers (with the line), or there is no whole facet.
pub fn stl(bytes: &[u8], name: &str) -> Result<Description, SceneError> {
    let count = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let mut corners: Vec<Vec3> = Vec::new();
    // A text may begin with "solid" and so may the 80 free bytes of a binary file: its length tells them apart.
    let end = count.and_then(|n| n.checked_mul(50)?.checked_add(84));
    let text = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes).trim_ascii_start();
    let is_text = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    // Some programs leave a few bytes behind the last facet.
    let binary = end.is_some_and(|end| end == bytes.len() || !is_text && end < bytes.len() && end > 84);
    if binary {
        for facet in bytes[84..end.unwrap_or(bytes.len())].chunks_exact(50) {
            let number = |i: usize| f32::from_le_bytes([facet[i], facet[i + 1], facet[i + 2], facet[i + 3]]);
            corners.extend((0..3).map(|k| Vec3::from_array([0, 1, 2].map(|j| number(12 + 12 * k + 4 * j)))));
        }
    } else if is_text {
        let newline = if text.contains(&b'\n') { b'\n' } else { b'\r' };
        for (i, line) in bytes.split(|c| *c == newline).enumerate() {
            let line = String::from_utf8_lossy(line);
            let mut words = line.split_ascii_whitespace();
            if words.next().is_some_and(|word| word.eq_ignore_ascii_case("vertex")) {
                let numbers: Vec<f32> = words.map_while(|w| w.parse().ok()).collect();
                let [x, y, z] = numbers[..] else {
                    return Err(error(
                        format!("{name}: line {}", i + 1),
                        format!("\"{}\"", line.trim()),
                        "vertex and three numbers",
                    ));
                };
                corners.push(Vec3::new(x, y, z));
            }
        }
        if !corners.len().is_multiple_of(3) {
            return Err(error(name.into(), format!("{} corners", corners.len()), "three for each facet: the file is cut short"));
        }
    } else {
        let found = format!("{} bytes{}", bytes.len(), count.map_or(String::new(), |n| format!(" that announce {n} facets")));
        return Err(error(name.into(), found, "an STL file: text, or 84 bytes and 50 for each facet"));
    }
    if corners.is_empty() {
        return Err(error(name.into(), "no facets", "at least one"));
    }
    // Equal corners are one.
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    let numbers: Vec<u32> = corners
        .iter()
        .map(|c| {
            *known.entry(c.to_array().map(f32::to_bits)).or_insert_with(|| {
                mesh.positions.push(*c);
                mesh.positions.len() as u32 - 1
            })
        })
        .collect();
    mesh.triangles = numbers.as_chunks::<3>().0.to_vec();
    Ok(alone(name, mesh, vec![]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::obj::obj;

    #[test]
    fn what_only_some_corners_have_is_left_out() {
        let gone = |_: &str| Err("not there".to_owned());
        if let Ok(d) = obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0 0.5 0.5 0.5\nf 1 2 3\nv 1 1 0 0 0\nf 1 2 1\nf -2 0 06 1\n", "a.obj", &gone)
        {
            crate::Scene::build(d).unwrap();
        }
        let twice = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
            property float ny\nproperty float nz\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
            property list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n5 5 5\n3 0 1 2\n";
        let d = ply(twice.as_bytes().to_vec(), "a.ply").unwrap();
        assert!(d.warnings[0].contains("only some"), "{:?}", d.warnings);
        crate::Scene::build(d).unwrap();
    }

    #[test]
    fn a_mesh_without_a_surface_is_an_error_that_names_the_file() {
        let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let corners = "0 0 0\n1 0 0\n0 1 0\n";
        let faces = "property list uchar int vertex_indices\nend_header\n";
        for text in [
            format!("{head}end_header\n{corners}"),
            format!("{head}element face 0\n{faces}{corners}"),
            format!("{head}element face 1\n{faces}{corners}2 0 1\n"),
            format!("{head}element tristrips 1\n{faces}{corners}2 0 1\n"),
        ] {
            let e = ply(text.clone().into_bytes(), "a.ply").unwrap_err().to_string();
            assert!(e.starts_with("a.ply: ") && e.contains("no surface") && e.contains("3 vertices"), "{text}: {e}");
        }
        let whole = ply(format!("{head}element face 1\n{faces}{corners}3 0 1 2\n").into_bytes(), "a.ply").unwrap();
        assert_eq!(whole.meshes[0].triangles, [[0, 1, 2]]);
        let none = |_: &str| Err("there is no such file".to_owned());
        let e = obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\n", "a.obj", &none).unwrap_err().to_string();
        assert!(e.starts_with("a.obj: ") && e.contains("no surface"), "{e}");
        for (bytes, found) in
            [(&b"# a note\ngarbage here\n"[..], "line 2: \"garbage here\";"), (b"\xff\0\n", "line 1: \"\\xff\\x00\";")]
        {
            let e = obj(bytes, "a.obj", &none).unwrap_err().to_string();
            assert!(e.starts_with(&format!("a.obj: {found}")) && e.contains("expected an OBJ file"), "{e}");
        }
        let e = ply(b"garbage\n".to_vec(), "a.ply").unwrap_err().to_string();
        assert!(e.starts_with("a.ply: it begins with \"garbage\"; expected a PLY file"), "{e}");
    }

    #[test]
    fn both_kinds_of_stl_are_the_same_mesh() {
        let text = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
            facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
        let from_text = stl(text.as_bytes(), "a.stl").unwrap();
        let mut bytes = b"solid, but binary".to_vec();
        bytes.resize(80, 0);
        bytes.extend(2u32.to_le_bytes());
        for t in [[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]] {
            bytes.extend([0u8; 12]);
            t.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
            bytes.extend([0u8; 2]);
        }
        let from_numbers = stl(&bytes, "b.stl").unwrap();
        assert_eq!(from_text.meshes[0].positions, from_numbers.meshes[0].positions);
        assert_eq!((from_text.meshes[0].positions.len(), &from_text.meshes[0].triangles), (4, &from_numbers.meshes[0].triangles));
        for (bad, word) in [
            (&bytes[..100], "no facets"),
            (&bytes[1..], "announce"),
            (b"solid x\nvertex 1 2\n", "three numbers"),
            (b"solid x\n", "no facets"),
        ] {
            let e = stl(bad, "c.stl").unwrap_err().to_string();
            assert!(e.contains(word), "{e}");
        }
    }
}

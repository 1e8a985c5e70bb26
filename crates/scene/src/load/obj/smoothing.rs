//! Smoothing groups: normals of meshes whose file has none. Source: Wavefront's OBJ specification (1995), "s".

use super::super::polygon::triangulate;
use crate::shape::Mesh;
use crate::subdivision::{normals_by, smooth_normals};
use std::collections::HashMap;

/// The smoothing group of each face in the order of the file, 0 where it is flat; none where all are.
pub(super) fn smoothing_groups(statements: &[u8]) -> Vec<u32> {
    let (mut group, mut groups) = (0, Vec::new());
    for line in statements.split(|c| *c == b'\n').map(<[u8]>::trim_ascii_start) {
        // Most lines are vertices.
        if !line.starts_with(b"s") && !line.starts_with(b"f") {
            continue;
        }
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"f") if words.clone().count() >= 3 => groups.push(group),
            Some(b"s") => {
                group = match words.next() {
                    Some(b"on") => 1,
                    word => word.and_then(|word| std::str::from_utf8(word).ok()?.parse().ok()).unwrap_or(0),
                }
            }
            _ => {}
        }
    }
    if groups.iter().all(|group| *group == 0) { Vec::new() } else { groups }
}

/// Gives a mesh normals by the smoothing groups of its faces, where any are smooth: the corners of `indices`, as many for each face as `corners` says. Vertices that several groups share become several.
pub(super) fn smooth(mesh: &mut Mesh, indices: &[u32], corners: &[u32], groups: &[u32]) {
    let Some(first) = groups.first().filter(|_| corners.len() == groups.len()) else { return };
    if groups.iter().all(|group| group == first) {
        if *first != 0 {
            mesh.normals = smooth_normals(mesh);
        }
        return;
    }
    let (mut known, mut of) = (HashMap::new(), Vec::new());
    let mut apart = Mesh::default();
    let mut left = indices;
    for (face, count) in corners.iter().enumerate() {
        let (own, rest) = left.split_at(*count as usize);
        left = rest;
        // Each flat face is a group of its own.
        let group = if groups[face] == 0 { u64::MAX - face as u64 } else { u64::from(groups[face]) };
        let renumbered = own.iter().map(|vertex| {
            *known.entry((*vertex, group)).or_insert_with(|| {
                let vertex = *vertex as usize;
                apart.positions.push(mesh.positions[vertex]);
                apart.uvs[0].extend(mesh.uvs[0].get(vertex));
                apart.colors.extend(mesh.colors.get(vertex));
                of.push(group);
                of.len() as u32 - 1
            })
        });
        let renumbered: Vec<u32> = renumbered.collect();
        triangulate(&renumbered, &apart.positions, &mut apart.triangles);
    }
    apart.normals = normals_by(&apart, |vertex| of[vertex]);
    *mesh = apart;
}

#[cfg(test)]
mod tests {
    use super::super::obj;
    use crate::scene::Shape;
    use glam::Vec3;

    #[test]
    fn faces_of_a_group_are_smooth_where_they_meet_and_others_flat() {
        // Two squares at a right angle that share an edge, and one beside, which is flat.
        let text = |first: &str, second: &str| {
            format!(
                "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 1 1 0\nv 1 1 1\nv 2 0 0\nv 2 0 1\n{first}\nf 4 3 2 1\n{second}\nf 2 3 6 5\ns off\nf 3 8 7 2\n"
            )
        };
        let normals_at = |text: String, position: Vec3| -> Vec<Vec3> {
            let d = obj(text.as_bytes(), "t.obj", &|_| Err("none".into())).unwrap();
            assert_eq!(d.objects.len(), 1);
            let Shape::Mesh { mesh, .. } = d.objects[0].shape else { panic!("a mesh") };
            let mesh = &d.meshes[mesh as usize];
            assert_eq!(mesh.triangles.len(), 6);
            let mut all: Vec<Vec3> =
                (0..mesh.normals.len()).filter(|v| mesh.positions[*v] == position).map(|v| mesh.normals[v]).collect();
            all.sort_by(|a, b| a.x.total_cmp(&b.x));
            all
        };
        let diagonal = Vec3::new(-1.0, 1.0, 0.0).normalize();
        let near = |a: &[Vec3], b: &[Vec3]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.distance(*b) < 1e-6);
        let smooth = normals_at(text("s 1", ""), Vec3::X);
        assert!(near(&smooth, &[diagonal, Vec3::Y]), "{smooth:?}");
        let apart = normals_at(text("s 1", "s 2"), Vec3::X);
        assert!(near(&apart, &[Vec3::NEG_X, Vec3::Y, Vec3::Y]), "{apart:?}");
        assert!(normals_at(text("s off", "s 0"), Vec3::X).is_empty());
    }
}

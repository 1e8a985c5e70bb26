//! Meshes of files that say heights but no edge length: USD, OBJ.
//!
//! Edges are split ([`subdivision::split_long_edges`]) until none is longer than [`EDGE_FRACTION`] of the meshes' size, then all vertices are moved along their
//! normals ([`subdivision::displace`]), as pbrt's displaced meshes are. Meshes of several materials are displaced together, so that what they share does
//! not crack.

use crate::shape::Mesh;
use crate::subdivision::{self, Splitting};
use crate::texture::{Lookup, Scalar};
use glam::{Affine3A, Vec2, Vec4};

/// Longest edge as a fraction of the diagonal of the box around all meshes that are displaced together: about a million triangles for a ball, a
/// pixel or two where that fills a picture of a thousand.
pub const EDGE_FRACTION: f32 = 1.0 / 512.0;
/// Most triangles of all meshes of a scene that are displaced by pictures.
pub const MOST_IN_ALL: usize = 1 << 23;

/// What came of meshes that were displaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Displaced {
    /// Whether edges are longer than they should be: there would be too many triangles.
    pub stopped: bool,
    /// Vertices whose height was no number; they stay.
    pub without_height: usize,
}

/// Displaces meshes that belong together by their heights (in their space, along their normals), with at most so many triangles.
pub fn displace(parts: &mut [(&mut Mesh, &Scalar)], most: usize) -> Displaced {
    let mut whole = Mesh::default();
    let has = |list: fn(&Mesh) -> bool| parts.iter().any(|(mesh, _)| list(mesh));
    let uv_lists = [has(|m| !m.uvs[0].is_empty()), has(|m| !m.uvs[1].is_empty())];
    let has_normals = parts.iter().all(|(mesh, _)| !mesh.normals.is_empty());
    // What each part has of its own.
    let own = parts.iter().map(|(mesh, _)| (mesh.uvs.each_ref().map(Vec::is_empty), mesh.colors.is_empty())).collect::<Vec<_>>();
    for (number, (mesh, _)) in parts.iter_mut().enumerate() {
        mesh.drop_partial_lists();
        mesh.drop_broken_triangles();
        let mesh = std::mem::take(*mesh);
        let (first, count) = (whole.positions.len() as u32, mesh.positions.len());
        whole.positions.extend(mesh.positions);
        if has_normals {
            whole.normals.extend(mesh.normals);
        }
        for (k, uvs) in mesh.uvs.into_iter().enumerate().filter(|(k, _)| uv_lists[*k]) {
            whole.uvs[k].extend(uvs.into_iter().chain(std::iter::repeat(Vec2::ZERO)).take(count));
        }
        // Alpha, which no file of these formats has, says which part a vertex belongs to: it stays so between two of the same part.
        let colors = mesh.colors.into_iter().chain(std::iter::repeat(Vec4::ZERO)).take(count);
        whole.colors.extend(colors.map(|c| c.truncate().extend(number as f32)));
        whole.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    let bounds = crate::bvh::Bounds::around(whole.positions.iter().copied());
    let longest = EDGE_FRACTION * (bounds.max - bounds.min).length();
    // Even heights need no shorter edges.
    let even = parts.iter().all(|(_, height)| matches!(height, Scalar::Constant(_)));
    let split = match even || !(longest > 0.0 && longest.is_finite()) {
        true => Splitting::Complete,
        false => subdivision::split_long_edges_up_to(&mut whole, &Affine3A::IDENTITY, longest, most),
    };
    let part_of: Vec<usize> = whole.colors.iter().map(|c| c.w as usize).collect();
    let heights: Vec<&Scalar> = parts.iter().map(|(_, height)| *height).collect();
    let without_height = subdivision::displace_vertices(&mut whole, |v, uv, point, normal| {
        heights[part_of[v]].lookup(&Lookup { uv: *uv, point, normal, footprint: None })
    });
    // Back into parts: the new number of each vertex.
    let mut number_of = vec![0u32; whole.positions.len()];
    for (v, part) in part_of.iter().enumerate() {
        let (mesh, _) = &mut parts[*part];
        let ([no_first, no_second], no_colors) = own[*part];
        number_of[v] = mesh.positions.len() as u32;
        mesh.positions.push(whole.positions[v]);
        mesh.normals.push(whole.normals[v]);
        for (k, none) in [no_first, no_second].into_iter().enumerate() {
            if !none {
                mesh.uvs[k].push(whole.uvs[k][v]);
            }
        }
        if !no_colors {
            mesh.colors.push(whole.colors[v].truncate().extend(1.0));
        }
    }
    for t in &whole.triangles {
        parts[part_of[t[0] as usize]].0.triangles.push(t.map(|v| number_of[v as usize]));
    }
    Displaced { stopped: split == Splitting::Stopped, without_height }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Image, Texture};
    use glam::Vec3;
    use std::collections::HashMap;
    use std::sync::Arc;

    /// A unit square in z = 0 from `x` on, its texture coordinates its places.
    fn square(x: f32) -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vec2::from_array);
        Mesh {
            positions: corners.iter().map(|c| Vec3::new(x + c.x, c.y, 0.0)).collect(),
            uvs: [corners.to_vec(), vec![]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    fn ramp(factor: f32) -> Scalar {
        // From black on the left to white on the right, linear codes.
        let image = Image::new(64, 1, (0..64).map(|x| [(x * 255 / 63) as u8; 4]).collect());
        let texture = Texture { codes: crate::texture::Codes::Linear, ..Texture::color(Arc::new(image)) };
        Scalar::Textured { factor, texture, channel: 0 }
    }

    #[test]
    fn heights_are_those_of_the_picture() {
        let (mut mesh, height) = (square(0.0), ramp(0.2));
        let done = displace(&mut [(&mut mesh, &height)], 1 << 20);
        assert_eq!(done, Displaced { stopped: false, without_height: 0 });
        assert!(mesh.triangles.len() > 200_000, "{}", mesh.triangles.len());
        assert_eq!((mesh.uvs[0].len(), mesh.colors.len()), (mesh.positions.len(), 0));
        for (p, n) in mesh.positions.iter().zip(&mesh.normals).filter(|(p, _)| (0.1..0.9).contains(&p.x)) {
            // A texel's middle is half a texel further.
            let expected = 0.2 * (p.x * 64.0 - 0.5) / 63.0;
            assert!((p.z - expected).abs() < 1.5e-3, "{p}: {expected}");
            assert!(n.z > 0.9 && n.x < 0.0, "{p}: {n}");
        }
    }

    #[test]
    fn parts_do_not_part() {
        let (mut left, mut right, high, low) = (square(0.0), square(1.0), ramp(0.2), Scalar::Constant(0.05));
        left.colors = vec![Vec4::new(0.5, 0.25, 1.0, 1.0); 4];
        displace(&mut [(&mut left, &high), (&mut right, &low)], 1 << 21);
        assert!(left.colors.iter().all(|c| *c == Vec4::new(0.5, 0.25, 1.0, 1.0)) && right.colors.is_empty());
        // Every edge but those of the outline lies between two triangles, also along the seam.
        let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        for mesh in [&left, &right] {
            for t in 0..mesh.triangles.len() {
                let p = mesh.corners(t).map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
                for k in 0..3 {
                    *edges.entry([p[k], p[(k + 1) % 3]]).or_default() += 1;
                    *edges.entry([p[(k + 1) % 3], p[k]]).or_default() -= 1;
                }
            }
        }
        let on_seam = |p: &[u32; 3]| (f32::from_bits(p[0]) - 1.0).abs() < 1e-6;
        let seam: Vec<_> = left.positions.iter().filter(|p| (p.x - 1.0).abs() < 1e-6).collect();
        assert!(seam.len() > 100 && edges.iter().filter(|(e, _)| e.iter().all(on_seam)).all(|(_, n)| *n == 0));
        // The mean of both heights where they meet: the picture repeats, and is half white at its edge.
        assert!(seam.iter().all(|p| (p.z - 0.075).abs() < 1e-3), "{:?}", seam[0]);
    }

    #[test]
    fn few_triangles_where_few_are_allowed_and_where_heights_are_even() {
        let (mut mesh, height) = (square(0.0), ramp(1.0));
        assert!(displace(&mut [(&mut mesh, &height)], 1000).stopped);
        assert!((100..=1000).contains(&mesh.triangles.len()));
        let (mut mesh, height) = (square(0.0), Scalar::Constant(-0.25));
        assert!(!displace(&mut [(&mut mesh, &height)], 1000).stopped);
        assert!(mesh.triangles.len() == 2 && mesh.positions.iter().all(|p| p.z == -0.25));
    }
}

//! Triangles are split until no edge is longer than a length.
//!
//! Every round halves all edges that are too long and cuts the triangles beside them into two, three or four. Whether an edge is halved depends on
//! its two ends alone, so that the triangles on both sides of it agree and no crack opens, also along seams, where the ends are other vertices at
//! the same places. pbrt-v4 (`TriQuadMesh::Refine`) splits the same edges, triangle by triangle. In a round the longest edge shrinks to √¾ at most
//! (a median that is new), so that it ends; rounds and triangles are bounded all the same.

use super::MOST_TRIANGLES;
use super::topology::{Faces, Topology};
use crate::shape::Mesh;
use glam::{Affine3A, Vec3};
use rayon::prelude::*;

/// Most rounds: an edge becomes 65 536.
const MOST_ROUNDS: usize = 16;

/// What came of splitting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Splitting {
    /// All edges are as short as was asked for.
    Complete,
    /// Edges are longer: more triangles, or more rounds, would have been too many.
    Stopped,
}

/// Splits triangles until no edge is longer than `longest` (> 0, m) where the mesh stands, as `world_from_mesh` says.
///
/// Normals, texture coordinates and colours of new vertices are the means of their edges' ends; tangents are dropped. Corners must be in range.
pub fn split_long_edges(mesh: &mut Mesh, world_from_mesh: &Affine3A, longest: f32) -> Splitting {
    split_long_edges_up_to(mesh, world_from_mesh, longest, MOST_TRIANGLES)
}

/// Splits long edges until there are at most `most` triangles.
pub fn split_long_edges_up_to(mesh: &mut Mesh, world_from_mesh: &Affine3A, longest: f32, most: usize) -> Splitting {
    let place = |p: Vec3| world_from_mesh.transform_point3(p);
    split_edges_by(mesh, |a, b| place(a).distance(place(b)), longest, most)
}

/// The same by any length that two ends in the mesh's space have, whichever comes first: such as that of the edge in a picture.
pub fn split_edges_by(mesh: &mut Mesh, length: impl Fn(Vec3, Vec3) -> f32 + Sync, longest: f32, most: usize) -> Splitting {
    mesh.tangents.clear();
    for _ in 0..MOST_ROUNDS {
        let faces = Faces::of_size(3, mesh.triangles.iter().flatten().copied().collect());
        let t = Topology::new(faces, mesh.positions.len());
        let at = |v: u32| mesh.positions[v as usize];
        let lengths: Vec<f32> = t.edges.par_iter().map(|[a, b]| length(at(*a), at(*b))).collect();
        let long: Vec<bool> = lengths.iter().map(|l| *l > longest).collect();
        let count = mesh.triangles.len() + t.edge_of.iter().filter(|e| long[**e as usize]).count();
        if count == mesh.triangles.len() {
            return Splitting::Complete;
        }
        if count > most {
            return Splitting::Stopped;
        }
        split_round(mesh, &t, &long, &lengths);
    }
    Splitting::Stopped
}

/// Halves the edges that are long.
fn split_round(mesh: &mut Mesh, t: &Topology, long: &[bool], lengths: &[f32]) {
    let mut middle = vec![u32::MAX; t.edges.len()];
    for (e, [a, b]) in t.edges.iter().enumerate().filter(|(e, _)| long[*e]) {
        middle[e] = mesh.positions.len() as u32;
        let (a, b) = (*a as usize, *b as usize);
        mesh.positions.push(0.5 * (mesh.positions[a] + mesh.positions[b]));
        if !mesh.normals.is_empty() {
            mesh.normals.push((mesh.normals[a] + mesh.normals[b]).try_normalize().unwrap_or(mesh.normals[a]));
        }
        for list in mesh.uvs.iter_mut().filter(|list| !list.is_empty()) {
            list.push(0.5 * (list[a] + list[b]));
        }
        if !mesh.colors.is_empty() {
            mesh.colors.push(0.5 * (mesh.colors[a] + mesh.colors[b]));
        }
    }
    let mut triangles = Vec::with_capacity(2 * mesh.triangles.len());
    for (f, triangle) in mesh.triangles.iter().enumerate() {
        let edges: [usize; 3] = std::array::from_fn(|k| t.edge_of[3 * f + k] as usize);
        let middles = edges.map(|e| middle[e]);
        // Turn it so that its longest edge of those that are halved is from its first to its second corner.
        let by_length = |i: &usize, j: &usize| lengths[edges[*i]].total_cmp(&lengths[edges[*j]]);
        let Some(k) = (0..3).filter(|k| middles[*k] != u32::MAX).max_by(by_length) else {
            triangles.push(*triangle);
            continue;
        };
        let [a, b, c] = [k, (k + 1) % 3, (k + 2) % 3].map(|i| triangle[i]);
        let [ab, bc, ca] = [k, (k + 1) % 3, (k + 2) % 3].map(|i| middles[i]);
        match (bc != u32::MAX, ca != u32::MAX) {
            (true, true) => triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]),
            (true, false) => triangles.extend([[a, ab, c], [ab, b, bc], [ab, bc, c]]),
            (false, true) => triangles.extend([[ab, b, c], [a, ab, ca], [ca, ab, c]]),
            (false, false) => triangles.extend([[a, ab, c], [ab, b, c]]),
        }
    }
    mesh.triangles = triangles;
}

#[cfg(test)]
mod tests {
    use super::super::tests::is_closed;
    use super::*;
    use glam::Vec2;

    /// A bar whose two halves have vertices of their own at the seam between them.
    pub fn bar() -> Mesh {
        let corner = |i: u32| Vec3::new(if i & 1 == 1 { 3.0 } else { 0.0 }, if i & 2 == 2 { 1.0 } else { 0.0 }, (i >> 2) as f32);
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut mesh = Mesh::default();
        for (f, face) in faces.iter().enumerate() {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(face.map(corner));
            mesh.uvs[0].extend((0..4).map(|k| Vec2::new(f as f32 + 0.3 * k as f32, k as f32)));
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh
    }

    fn longest(mesh: &Mesh) -> f32 {
        let edges = |t: usize| mesh.corners(t).map(|p| mesh.corners(t).map(|q| p.distance(q)).into_iter().fold(0.0, f32::max));
        (0..mesh.triangles.len()).flat_map(edges).fold(0.0, f32::max)
    }

    #[test]
    fn edges_become_short_and_nothing_opens() {
        for (length, turned_over) in [(0.7, false), (0.3, false), (0.11, false), (0.7, true), (0.3, true), (0.11, true)] {
            let mut mesh = bar();
            if turned_over {
                mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
            assert_eq!(split_long_edges(&mut mesh, &Affine3A::IDENTITY, length), Splitting::Complete);
            assert!(longest(&mesh) <= length && is_closed(&mesh) && mesh.uvs[0].len() == mesh.positions.len());
            // Not far more than needed: halves of what was too long.
            assert!(mesh.triangles.len() < (14.0 * 20.0 / (length * length)) as usize, "{}", mesh.triangles.len());
            let area: f32 =
                (0..mesh.triangles.len()).map(|t| mesh.corners(t)).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
            assert!((area - 14.0).abs() < 1e-3);
        }
        // Lengths are those where the mesh stands.
        let mut mesh = bar();
        assert_eq!(split_long_edges(&mut mesh, &Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.01)), 10.0), Splitting::Complete);
        assert_eq!(mesh.triangles.len(), 12);
    }

    #[test]
    fn splitting_ends() {
        let mut mesh = bar();
        assert_eq!(split_long_edges_up_to(&mut mesh, &Affine3A::IDENTITY, 1e-30, 5000), Splitting::Stopped);
        assert!(is_closed(&mesh) && (1000..=5000).contains(&mesh.triangles.len()));
        // Wherever it stops, both sides of every edge agree.
        for (most, longest) in [30, 60, 120, 150, 240, 480, 1000, 2000].into_iter().flat_map(|most| [(most, 0.11), (most, 0.7)]) {
            for turned_over in [false, true] {
                let mut mesh = bar();
                if turned_over {
                    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
                }
                let split = split_long_edges_up_to(&mut mesh, &Affine3A::IDENTITY, longest, most);
                assert!(
                    is_closed(&mesh) && mesh.triangles.len() <= most && (split == Splitting::Stopped || longest > 0.5),
                    "{most}"
                );
            }
        }
        // A sliver of no width, and numbers that are none.
        let mut sliver = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::NAN],
            triangles: vec![[0, 1, 2], [0, 1, 3], [1, 1, 1]],
            ..Mesh::default()
        };
        assert_eq!(split_long_edges_up_to(&mut sliver, &Affine3A::IDENTITY, 0.0, 5000), Splitting::Stopped);
        assert!(sliver.triangles.len() <= 5000);
    }
}

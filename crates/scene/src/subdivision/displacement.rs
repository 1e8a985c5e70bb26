//! Heights move the vertices of a mesh along their normals.
//!
//! Vertices at equal positions move together, by the mean of their displacements: seams of texture coordinates and of normals do not crack. Normals
//! afterwards are means of the triangles' by angle (G. Thürmer & C. Wüthrich 1998, "Computing vertex normals from polygonal facets"); vertices that
//! were one but for their texture coordinates share a normal, hard edges stay. Source of the operation: R. Cook 1984, "Shade trees".

use crate::shape::Mesh;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Moves each vertex by `height` (m, in the mesh's space) along its normal and computes normals anew; `height` gets texture coordinates, position and
/// normal.
/// Without normals a mesh gets smooth ones first. Returns how many heights were not finite numbers: such vertices stay.
pub fn displace(mesh: &mut Mesh, height: impl Fn(&[Vec2; 2], Vec3, Vec3) -> f32 + Sync) -> usize {
    displace_vertices(mesh, |_, uv, position, normal| height(uv, position, normal))
}

/// Displaces vertices by heights that also depend on which vertex it is.
pub fn displace_vertices(mesh: &mut Mesh, height: impl Fn(usize, &[Vec2; 2], Vec3, Vec3) -> f32 + Sync) -> usize {
    if mesh.normals.is_empty() {
        mesh.normals = smooth_normals(mesh);
    }
    let at_place = Groups::new(mesh.positions.len(), |v| key(mesh.positions[v]));
    let with_normal = Groups::new(mesh.positions.len(), |v| (key(mesh.positions[v]), key(mesh.normals[v])));
    let uv = |v: usize| [0, 1].map(|k: usize| mesh.uvs[k].get(v).copied().unwrap_or_default());
    let heights: Vec<f32> =
        (0..mesh.positions.len()).into_par_iter().map(|v| height(v, &uv(v), mesh.positions[v], mesh.normals[v])).collect();
    let moves = heights.iter().zip(&mesh.normals).map(|(h, n)| if h.is_finite() { (*n * *h).as_dvec3() } else { DVec3::ZERO });
    let means = at_place.means(moves);
    for (p, group) in mesh.positions.iter_mut().zip(&at_place.of) {
        *p += means[*group as usize].as_vec3();
    }
    mesh.normals = grouped_normals(mesh, &with_normal);
    mesh.tangents.clear();
    heights.iter().filter(|h| !h.is_finite()).count()
}

/// Unit normals of vertices, in their order: the means of the triangles' by angle, the same for all vertices at a position; +z where there is no triangle with an area.
pub fn smooth_normals(mesh: &Mesh) -> Vec<Vec3> {
    grouped_normals(mesh, &Groups::new(mesh.positions.len(), |v| key(mesh.positions[v])))
}

/// The same, but each vertex by itself: where texture coordinates jump, so do normals.
pub fn vertex_normals(mesh: &Mesh) -> Vec<Vec3> {
    let count = mesh.positions.len();
    grouped_normals(mesh, &Groups { of: (0..count as u32).collect(), count })
}

/// The same as of [`smooth_normals`], but where a vertex belongs to: vertices at a position share a normal only where that is the same, too.
pub fn normals_by<K: Ord + Send>(mesh: &Mesh, of: impl Fn(usize) -> K + Sync) -> Vec<Vec3> {
    grouped_normals(mesh, &Groups::new(mesh.positions.len(), |v| (key(mesh.positions[v]), of(v))))
}

fn grouped_normals(mesh: &Mesh, groups: &Groups) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; groups.count];
    for triangle in &mesh.triangles {
        let p = triangle.map(|v| mesh.positions[v as usize].as_dvec3());
        for k in 0..3 {
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let n = a.cross(b);
            let part = n.normalize_or_zero() * n.length().atan2(a.dot(b));
            if part.is_finite() {
                sums[groups.of[triangle[k] as usize] as usize] += part;
            }
        }
    }
    groups.of.iter().map(|g| sums[*g as usize].try_normalize().unwrap_or(DVec3::Z).as_vec3()).collect()
}

/// Bits of a vector; both zeros are one.
fn key(v: Vec3) -> [u32; 3] {
    (v + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// Vertices that belong together.
struct Groups {
    of: Vec<u32>,
    count: usize,
}

impl Groups {
    fn new<K: Ord + Send>(vertices: usize, key: impl Fn(usize) -> K + Sync) -> Self {
        let mut order: Vec<u32> = (0..vertices as u32).collect();
        order.par_sort_unstable_by_key(|v| (key(*v as usize), *v));
        let mut groups = Groups { of: vec![0; vertices], count: 0 };
        for (i, v) in order.iter().enumerate() {
            if i == 0 || key(order[i - 1] as usize) != key(*v as usize) {
                groups.count += 1;
            }
            groups.of[*v as usize] = groups.count as u32 - 1;
        }
        groups
    }

    fn means(&self, values: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
        let mut sums = vec![(DVec3::ZERO, 0.0); self.count];
        for (value, group) in values.zip(&self.of) {
            let sum = &mut sums[*group as usize];
            *sum = (sum.0 + value, sum.1 + 1.0);
        }
        sums.into_iter().map(|(sum, n)| sum / n).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::is_closed;
    use super::super::{Channels, ControlMesh, Scheme, split_long_edges, subdivide};
    use super::*;
    use glam::Affine3A;

    /// A unit ball of triangles, with texture coordinates that jump at a seam.
    fn ball(level: u32) -> Mesh {
        let octahedron = ControlMesh {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z],
            face_sizes: vec![3; 8],
            corners: vec![0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5],
            ..ControlMesh::default()
        };
        let mut mesh = subdivide(&octahedron, Scheme::Bilinear, level).unwrap().mesh(|_| true, Channels::default());
        mesh.normals.clear();
        mesh.positions.iter_mut().for_each(|p| *p = p.normalize());
        // Every triangle has vertices of its own, with texture coordinates of its own.
        mesh.positions = mesh.triangles.iter().flatten().map(|v| mesh.positions[*v as usize]).collect();
        mesh.triangles = (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        mesh.uvs[0] = mesh.positions.iter().enumerate().map(|(i, p)| Vec2::new(p.x, (i % 7) as f32)).collect();
        mesh
    }

    #[test]
    fn a_ball_displaced_evenly_is_a_larger_ball() {
        let mut mesh = ball(4);
        mesh.normals = mesh.positions.clone();
        split_long_edges(&mut mesh, &Affine3A::IDENTITY, 0.08);
        mesh.positions.iter_mut().for_each(|p| *p = p.normalize());
        mesh.normals = mesh.positions.clone();
        assert_eq!(displace(&mut mesh, |_, _, _| 0.25), 0);
        assert!(is_closed(&mesh));
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            assert!((p.length() - 1.25).abs() < 1e-5 && n.dot(p.normalize()) > 0.9999, "{p} {n}");
        }
        // Without normals it has smooth ones of its own.
        let mut mesh = ball(4);
        let far: Vec<bool> = mesh.positions.iter().map(|p| p.x <= 0.99).collect();
        let stay = displace(&mut mesh, |_, p, _| if p.x > 0.99 { f32::NAN } else { -0.5 });
        assert_eq!(stay, far.iter().filter(|far| !**far).count());
        let near = mesh.positions.iter().zip(far).all(|(p, far)| (p.length() - if far { 0.5 } else { 1.0 }).abs() < 2e-3);
        assert!(near && is_closed(&mesh));
    }

    #[test]
    fn seams_do_not_crack_and_hard_edges_stay_hard() {
        // Heights that differ between vertices at one place, normals too.
        let mut mesh = ball(3);
        mesh.normals =
            mesh.triangles.iter().enumerate().flat_map(|(t, _)| [mesh.corners(t).iter().sum::<Vec3>().normalize(); 3]).collect();
        displace(&mut mesh, |uv, _, _| 0.03 * uv[0].y);
        assert!(is_closed(&mesh));
        // A roof of two faces with a normal each: still two after an even displacement.
        let mut roof = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, -1.0), Vec3::X, Vec3::ZERO, Vec3::new(0.0, -1.0, -1.0)],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..Mesh::default()
        };
        let sides = [Vec3::new(0.0, 1.0, 1.0).normalize(), Vec3::new(0.0, -1.0, 1.0).normalize()];
        roof.normals = [0, 0, 0, 1, 1, 1].map(|k: usize| sides[k]).to_vec();
        displace(&mut roof, |_, _, _| 0.0);
        assert!((0..6).all(|v| roof.normals[v].distance(sides[v / 3]) < 1e-6), "{:?}", roof.normals);
        displace(&mut roof, |_, _, _| 1.0);
        assert_eq!((roof.positions[0], roof.positions[1]), (roof.positions[4], roof.positions[3]));
        assert!((roof.positions[0].z - 0.5f32.sqrt()).abs() < 1e-6 && roof.positions[0].y.abs() < 1e-6);
    }
}

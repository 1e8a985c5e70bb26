//! Triangle meshes, stored once in their own space.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Triangles and what is known at their corners. All lists but `triangles` are empty or as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Corners, m.
    pub positions: Vec<Vec3>,
    /// Unit normals; empty: flat faces. Where those of a triangle add up to 0, its own counts.
    pub normals: Vec<Vec3>,
    /// Tangents, w the handedness; empty: derived from texture coordinates.
    pub tangents: Vec<Vec4>,
    /// Two sets of texture coordinates.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear RGBA; empty: white.
    pub colors: Vec<Vec4>,
    /// Corner numbers, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Corners of a triangle, counter-clockwise from outside, m. Panics where the triangle or a corner of it is out of range.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }

    /// Values at the corners of a triangle mixed by barycentric weights, which sum to 1; `None` for an empty list. Panics where the list is shorter than the positions.
    #[inline]
    pub fn mix<T>(&self, list: &[T], triangle: usize, weights: [f32; 3]) -> Option<T>
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        if list.is_empty() {
            return None;
        }
        let [a, b, c] = self.triangles[triangle].map(|i| list[i as usize]);
        Some(a * weights[0] + b * weights[1] + c * weights[2])
    }

    /// Bytes of memory held.
    pub fn memory(&self) -> usize {
        self.positions.len() * 12
            + self.normals.len() * 12
            + self.tangents.len() * 16
            + (self.uvs[0].len() + self.uvs[1].len()) * 8
            + self.colors.len() * 16
            + self.triangles.len() * 12
    }

    /// Empties lists that are not as long as the positions; whether there were any.
    pub fn drop_partial_lists(&mut self) -> bool {
        let n = self.positions.len();
        let mut dropped = false;
        let mut whole = |len: usize| {
            let fits = len == 0 || len == n;
            dropped |= !fits;
            fits
        };
        let keep = [whole(self.normals.len()), whole(self.tangents.len()), whole(self.colors.len())];
        let uvs = [0, 1].map(|i: usize| whole(self.uvs[i].len()));
        if !keep[0] {
            self.normals.clear();
        }
        if !keep[1] {
            self.tangents.clear();
        }
        if !keep[2] {
            self.colors.clear();
        }
        self.uvs.iter_mut().zip(uvs).filter(|(_, keep)| !keep).for_each(|(uvs, _)| uvs.clear());
        dropped
    }

    /// Removes triangles whose corners are out of range or not finite. Returns how many.
    pub fn drop_broken_triangles(&mut self) -> usize {
        self.keep_triangles(is_finite)
    }

    /// Removes triangles that no ray can hit: broken ones, and those without area. Returns how many.
    pub fn drop_unusable_triangles(&mut self) -> usize {
        self.keep_triangles(has_area)
    }

    /// Whether all corners of its triangles are in range and finite.
    pub fn all_finite(&self) -> bool {
        self.triangles.par_iter().all(|t| is_finite(&self.positions, t))
    }

    /// Whether all its triangles are finite and have an area.
    pub fn all_usable(&self) -> bool {
        self.triangles.par_iter().all(|t| has_area(&self.positions, t))
    }

    fn keep_triangles(&mut self, keep: impl Fn(&[Vec3], &[u32; 3]) -> bool + Sync) -> usize {
        let before = self.triangles.len();
        let positions = &self.positions;
        if self.triangles.par_iter().all(|t| keep(positions, t)) {
            return 0;
        }
        self.triangles.retain(|t| keep(positions, t));
        before - self.triangles.len()
    }
}

fn is_finite(positions: &[Vec3], triangle: &[u32; 3]) -> bool {
    triangle.iter().all(|i| positions.get(*i as usize).is_some_and(|p| p.is_finite()))
}

fn has_area(positions: &[Vec3], triangle: &[u32; 3]) -> bool {
    if !is_finite(positions, triangle) {
        return false;
    }
    let [a, b, c] = triangle.map(|i| positions[i as usize].as_dvec3());
    (b - a).cross(c - a).length_squared() > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unusable_triangles_are_dropped_and_counted() {
        let mut mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN, Vec3::X * 2.0],
            triangles: vec![[0, 1, 2], [0, 1, 4], [0, 1, 3], [0, 1, 9], [1, 1, 2]],
            ..Default::default()
        };
        assert_eq!(mesh.drop_unusable_triangles(), 4);
        assert_eq!(mesh.triangles, vec![[0, 1, 2]]);
    }
}

//! Parallelograms: a corner and two edges.

use glam::{Vec2, Vec3};

/// The points corner + α edge₀ + β edge₁ with 0 ≤ α, β ≤ 1; outside is where edge₀ × edge₁ points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quad {
    /// First corner, m.
    pub corner: Vec3,
    /// Edges from it, m.
    pub edges: [Vec3; 2],
}

impl Quad {
    /// Unit normal on the outside.
    pub fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize()
    }

    /// Area, m².
    pub fn area(&self) -> f32 {
        self.edges[0].cross(self.edges[1]).length()
    }

    /// Point at (α, β), m.
    pub fn point(&self, p: Vec2) -> Vec3 {
        self.corner + self.edges[0] * p.x + self.edges[1] * p.y
    }

    /// Its corners, at (0, 0), (1, 0), (0, 1) and (1, 1).
    pub fn corners(&self) -> [Vec3; 4] {
        [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| self.point(p))
    }

    /// Distance and (α, β) of the hit with 0 < t < `t_max`, in lengths of the direction: ray and plane, then both coordinates in 0..1.
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<(f32, Vec2)> {
        let n = self.edges[0].cross(self.edges[1]);
        let denominator = n.dot(direction);
        if denominator == 0.0 {
            return None;
        }
        let t = n.dot(self.corner - origin) / denominator;
        if !(t > 0.0 && t < t_max) {
            return None;
        }
        let p = origin + direction * t - self.corner;
        let w = n / n.length_squared();
        let (alpha, beta) = (w.dot(p.cross(self.edges[1])), w.dot(self.edges[0].cross(p)));
        ((0.0..=1.0).contains(&alpha) && (0.0..=1.0).contains(&beta)).then_some((t, Vec2::new(alpha, beta)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hit_has_the_coordinates_of_the_parallelogram() {
        let quad = Quad { corner: Vec3::new(1.0, 0.0, -2.0), edges: [Vec3::new(2.0, 0.0, 0.0), Vec3::new(1.0, 3.0, 0.0)] };
        let target = quad.point(Vec2::new(0.25, 0.75));
        let (t, p) = quad.intersect(Vec3::ZERO, target, 2.0).unwrap();
        assert!((t - 1.0).abs() < 1e-6 && (p - Vec2::new(0.25, 0.75)).length() < 1e-6);
        assert!(quad.intersect(Vec3::ZERO, target, 0.999).is_none());
        assert!(quad.intersect(Vec3::ZERO, quad.point(Vec2::new(1.001, 0.5)), 2.0).is_none());
        assert_eq!(quad.area(), 6.0);
    }
}

//! Turned shapes: a profile spun about the vertical.

use crate::shape::Mesh;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Spins a profile of (radius, height) points, m, about +y. Going up along the outside puts the outside out. Normals are
/// smooth along the profile but for corners sharper than 40°. Texture coordinates: around, and along the profile. Panics on a profile without points.
pub fn turn(profile: &[Vec2], sectors: u32) -> Mesh {
    let direction = |i: usize| (profile[i + 1] - profile[i]).normalize_or_zero();
    let normal = |d: Vec2| Vec2::new(d.y, -d.x);
    let length: f32 = profile.windows(2).map(|w| w[0].distance(w[1])).sum();
    let mut mesh = Mesh::default();
    let mut along = 0.0;
    for i in 0..profile.len() - 1 {
        let here = direction(i);
        let smooth = |j: Option<usize>| match j.filter(|j| *j + 1 < profile.len()).map(direction) {
            Some(d) if d.dot(here) > 0.766 => normal(d + here).normalize_or_zero(),
            _ => normal(here),
        };
        let ends = [
            (profile[i], smooth(i.checked_sub(1)), along),
            (profile[i + 1], smooth(Some(i + 1)), along + profile[i].distance(profile[i + 1])),
        ];
        along = ends[1].2;
        let first = mesh.positions.len() as u32;
        for k in 0..=sectors {
            let phi = TAU * k as f32 / sectors as f32;
            let (s, c) = phi.sin_cos();
            for (p, n, v) in ends {
                mesh.positions.push(Vec3::new(p.x * s, p.y, p.x * c));
                mesh.normals.push(Vec3::new(n.x * s, n.y, n.x * c).normalize_or(Vec3::Y));
                mesh.uvs[0].push(Vec2::new(k as f32 / sectors as f32, 1.0 - v / length));
            }
        }
        for k in 0..sectors {
            let [a, b, c, d] = [0, 1, 2, 3].map(|j| first + 2 * k + j);
            // A point on the axis makes one triangle, not two.
            if profile[i].x > 0.0 {
                mesh.triangles.push([a, c, d]);
            }
            if profile[i + 1].x > 0.0 {
                mesh.triangles.push([a, d, b]);
            }
        }
    }
    mesh
}

/// Points of a Catmull–Rom curve (uniform; Catmull & Rom 1974) through given ones, `steps` for each pair and the last point; first numbers are at least 0. Panics without
/// points.
pub fn smooth(points: &[Vec2], steps: usize) -> Vec<Vec2> {
    let at = |i: i64| points[i.clamp(0, points.len() as i64 - 1) as usize];
    let mut curve = Vec::new();
    for i in 0..points.len() as i64 - 1 {
        let [p0, p1, p2, p3] = [i - 1, i, i + 1, i + 2].map(at);
        for k in 0..steps {
            let t = k as f32 / steps as f32;
            let p = (p1 * 2.0
                + (p2 - p0) * t
                + (p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3) * t * t
                + (p1 * 3.0 - p0 - p2 * 3.0 + p3) * t * t * t)
                * 0.5;
            curve.push(p.max(Vec2::new(0.0, f32::NEG_INFINITY)));
        }
    }
    curve.push(points[points.len() - 1]);
    curve
}

/// A torus lying on the ground: ring radius and tube radius, m.
pub fn ring(radius: f32, tube: f32, sectors: u32) -> Mesh {
    let profile: Vec<Vec2> = (0..=24)
        .map(|i| {
            let a = TAU * i as f32 / 24.0 - TAU / 4.0;
            Vec2::new(radius + tube * a.cos(), tube + tube * a.sin())
        })
        .collect();
    turn(&profile, sectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_is_out() {
        let mesh = turn(&[Vec2::new(0.0, 0.0), Vec2::new(1.0, 0.0), Vec2::new(1.0, 2.0), Vec2::new(0.0, 2.0)], 24);
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(t);
            let center = (a + b + c) / 3.0 - Vec3::Y;
            let n = (b - a).cross(c - a);
            assert!(n.dot(center) > 0.0, "triangle {t} {triangle:?} faces inwards");
            assert!(mesh.normals[triangle[0] as usize].dot(n) > 0.0);
        }
    }
}

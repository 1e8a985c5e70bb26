//! How wide a path is: the cone about its ray, by which pictures on surfaces are filtered.
//!
//! T. Akenine-Möller et al. 2021, "Improved Shader and Texture Level of Detail Using Ray Cones"; ellipses on surfaces as there. A camera ray begins as
//! what a sample stands for of its pixel. Rough surfaces widen it by the density of the direction drawn (as path differentials do: F. Suykens
//! & Y. Willems 2001). What comes over mirrors and through glass, whose curvature is not known, is not filtered, nor what comes out of media.

use crate::scene::Scene;
use crate::shape::{Detail, Surface};
use crate::texture::Footprint;
use diopter_light::Ray;
use glam::{Vec2, Vec3};

/// A ray and the cone that it stands for.
#[derive(Clone, Copy, Debug)]
pub struct RayCone {
    /// The axis.
    pub ray: Ray,
    /// Whole angle of the cone about a camera ray, rad: that of a pixel times `fraction`. 0: pictures are looked up at points.
    pub spread: f32,
    /// Size of what a sample stands for, as a fraction of all that is sampled in each direction: 1/√n of n samples.
    pub fraction: f32,
}

impl RayCone {
    /// A ray without width.
    pub fn thin(ray: Ray) -> Self {
        RayCone { ray, spread: 0.0, fraction: 0.0 }
    }
}

/// The cone along a path.
#[derive(Clone, Copy)]
pub(super) struct Cone {
    /// Diameter where the ray is, m.
    width: f32,
    /// By how much it grows with the distance.
    spread: f32,
    fraction: f32,
    /// Whether it has left a rough surface: what it meets is a part of many, and one look-up will do.
    is_coarse: bool,
}

/// Largest spread after a rough surface: its footprints stay smaller than what is around them.
const WIDEST: f32 = 0.2;

/// Spread after a rough surface, of the side of a square of the solid angle that a direction stands for: small, since edges of pictures next to a
/// surface are seen in the light that it reflects.
const OF_SOLID_ANGLE: f32 = 0.25;

/// Flattest that rays meet a surface, as cosine, for the length of a footprint.
const GRAZING: f32 = 1e-3;

impl Cone {
    pub(super) fn new(cone: &RayCone) -> Self {
        Cone { width: 0.0, spread: cone.spread, fraction: cone.fraction, is_coarse: false }
    }

    /// Goes on along a ray.
    #[inline]
    pub(super) fn advance(&mut self, distance: f32) {
        self.width += self.spread * distance;
    }

    /// What leaves a rough surface in a direction drawn with a density (1/sr).
    #[inline]
    pub(super) fn scatter(&mut self, density: f32) {
        self.is_coarse = true;
        self.spread = (self.fraction * OF_SOLID_ANGLE / density.sqrt()).min(WIDEST);
    }

    /// From here on nothing is known of its width.
    #[inline]
    pub(super) fn forget(&mut self) {
        (self.width, self.spread) = (0.0, 0.0);
    }

    /// Gives a surface point its footprint, where it has pictures that are filtered and the footprint is larger than their pixels.
    #[inline]
    pub(super) fn meet(&self, scene: &Scene, surface: &mut Surface, direction: Vec3) {
        if self.width > 0.0
            && let Some(filtering) = scene.filtering(surface.object)
            && let Detail::Derivatives(by_uv) = surface.detail
        {
            let axes = footprint(by_uv, surface.ng, direction, self.width);
            let largest = axes[0].length_squared().max(axes[1].length_squared());
            if largest * filtering.texels * filtering.texels > 1.0 {
                surface.detail =
                    Detail::Footprint(Footprint { axes, uv_set: filtering.uv_set as u32, is_coarse: self.is_coarse });
            }
        }
    }
}

/// The ellipse in which a cone meets a surface, in texture coordinates: its whole axes, along the slope and across it.
fn footprint([du, dv]: [Vec3; 2], normal: Vec3, direction: Vec3, width: f32) -> [Vec2; 2] {
    let cos = normal.dot(direction).abs().max(GRAZING);
    let across = normal.cross(direction).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
    let along = normal.cross(across);
    // Which coordinates a step on the surface changes: by the inverse of the metric.
    let (e, f, g) = (du.length_squared(), du.dot(dv), dv.length_squared());
    let determinant = e * g - f * f;
    let step = |v: Vec3| Vec2::new(g * v.dot(du) - f * v.dot(dv), e * v.dot(dv) - f * v.dot(du)) / determinant;
    [step(along * (width / cos)), step(across * width)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footprints_are_where_the_cone_meets_the_surface() {
        // Points around the cone, followed to the plane; the texture coordinates of a skewed mapping.
        let (du, dv) = (Vec3::new(2.0, 0.0, 0.5), Vec3::new(0.3, 0.0, -1.5));
        let (direction, width, distance) = (Vec3::new(0.6, -0.3, 0.2).normalize(), 1e-3, 5.0);
        let origin = -direction * distance;
        let axes = footprint([du, dv], Vec3::Y, direction, width);
        let (s, t) = direction.any_orthonormal_pair();
        for k in 0..32 {
            let (sin, cos) = (k as f32 / 32.0 * std::f32::consts::TAU).sin_cos();
            let d = direction + (s * cos + t * sin) * (0.5 * width / distance);
            let p = origin - d * (origin.y / d.y);
            // p = du u + dv v; the axes span an ellipse of diameter 1.
            let det = du.x * dv.z - dv.x * du.z;
            let uv = Vec2::new(p.x * dv.z - dv.x * p.z, du.x * p.z - p.x * du.z) / det;
            let [a, b] = axes;
            let det = a.perp_dot(b);
            let on = 2.0 * Vec2::new(uv.perp_dot(b), a.perp_dot(uv)) / det;
            // The first order of the width over the distance is left out.
            assert!((on.length() - 1.0).abs() < 1e-3, "{on}");
        }
        // Seen along the normal.
        let axes = footprint([Vec3::X, Vec3::Z * 2.0], Vec3::Y, Vec3::NEG_Y, 0.1);
        assert!((axes[0].perp_dot(axes[1]).abs() - 0.005).abs() < 1e-6);
    }
}

//! What a ray meets first.

use super::to_light::{MAX_INTERFACES, origin_behind};
use crate::scene::Scene;
use crate::shape::Surface;
use diopter_light::Ray;
use glam::Vec3;

/// What the first surface along a ray looks like to a computer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstSurface {
    /// Distance, m.
    pub distance: f32,
    /// Shading normal on the seen side.
    pub normal: Vec3,
    /// Linear sRGB.
    pub albedo: Vec3,
    /// Number of the object.
    pub object: u32,
}

impl Scene {
    /// The truth along a ray; `None` where it leaves the scene.
    pub fn first_surface(&self, ray: &Ray) -> Option<FirstSurface> {
        let s = self.first_visible(ray)?;
        let side = if s.ng.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let albedo = self.material(s.object).albedo(&s);
        Some(FirstSurface { distance: s.t, normal: s.ns * side, albedo, object: s.object })
    }

    /// The first surface along a ray that can be seen, faces of media left out; `t` counts from the ray's origin. `None` where it leaves the scene.
    pub fn first_visible(&self, ray: &Ray) -> Option<Surface> {
        let (mut s, mut start, mut traveled) = (self.intersect(ray, f32::INFINITY)?, ray.origin, 0.0);
        // Faces of media are not seen.
        for _ in 0..MAX_INTERFACES {
            if !self.is_interface(&s) {
                break;
            }
            traveled += s.t;
            start = origin_behind(&s, ray.direction);
            s = self.intersect(&Ray { origin: start, ..*ray }, f32::INFINITY)?;
        }
        s.t = if start == ray.origin { s.t } else { traveled + s.t };
        Some(s)
    }
}

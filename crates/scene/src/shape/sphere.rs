//! Spheres.

use glam::Vec3;

/// A sphere; outside is outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre, m.
    pub center: Vec3,
    /// Radius, m.
    pub radius: f32,
}

impl Sphere {
    /// Distance of the nearest hit with 0 < t < `t_max`, in lengths of the direction.
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<f32> {
        self.intersections(origin, direction)?.into_iter().find(|t| *t > 0.0 && *t < t_max)
    }

    /// Where the line along a ray enters and leaves, in lengths of the direction; before the origin below 0.
    ///
    /// The discriminant is formed from the part of the centre's offset that is perpendicular to the ray, which keeps digits for small far spheres. Source: Haines et al.,
    /// Ray Tracing Gems ch. 7 (2019).
    pub fn intersections(&self, origin: Vec3, direction: Vec3) -> Option<[f32; 2]> {
        let f = origin - self.center;
        let a = direction.length_squared();
        let b = -f.dot(direction);
        let perpendicular = f + direction * (b / a);
        let discriminant = self.radius * self.radius - perpendicular.length_squared();
        if discriminant < 0.0 {
            return None;
        }
        let q = b + (a * discriminant).sqrt().copysign(b);
        let c = f.length_squared() - self.radius * self.radius;
        let (t0, t1) = (c / q, q / a);
        Some(if t0 < t1 { [t0, t1] } else { [t1, t0] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_from_outside_and_inside() {
        let s = Sphere { center: Vec3::new(0.0, 0.0, 5.0), radius: 1.0 };
        assert_eq!(s.intersect(Vec3::ZERO, Vec3::Z, 100.0), Some(4.0));
        assert_eq!(s.intersect(s.center, Vec3::Z, 100.0), Some(1.0));
        assert_eq!(s.intersect(Vec3::ZERO, Vec3::NEG_Z, 100.0), None);
        assert_eq!(s.intersect(Vec3::ZERO, Vec3::Z, 3.9), None);
    }

    #[test]
    fn a_small_far_sphere_is_hit_at_its_rim() {
        let s = Sphere { center: Vec3::new(0.0, 0.0, 1000.0), radius: 0.01 };
        let hit = |x: f32| s.intersect(Vec3::new(x, 0.0, 0.0), Vec3::Z, 1e9).is_some();
        assert!(hit(0.0099) && !hit(0.0101));
    }
}

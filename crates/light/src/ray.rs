//! Rays of the scene: metres, seconds.

use glam::Vec3;

/// A half line in world space at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, metres.
    pub origin: Vec3,
    /// Unit direction the ray is followed in (against the light, when it comes from a camera).
    pub direction: Vec3,
    /// Moment within the exposure, seconds.
    pub time_s: f32,
}

impl Ray {
    /// Whether origin and direction are finite; its time is not looked at.
    pub fn is_finite(&self) -> bool {
        self.origin.is_finite() && self.direction.is_finite()
    }

    /// The point at a distance in metres.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

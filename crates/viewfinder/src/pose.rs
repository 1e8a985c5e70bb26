//! Where the camera stands, and how it is moved by hand.

use glam::{Mat3, Vec3};
use serde::Deserialize;

/// How a camera is moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// About what it is aimed at.
    Orbit,
    /// To the side and up, looking the same way.
    Pan,
    /// Towards what it is aimed at, or away from it.
    Dolly,
    /// About itself.
    Turn,
    /// To the horizontal, upright.
    Level,
}

/// A camera's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Where it stands, m.
    pub eye: Vec3,
    /// What it is aimed at, m.
    pub target: Vec3,
    /// Up vector of the picture.
    pub up: Vec3,
}

/// Nearest to straight up or down that the camera looks, radians: beyond, the picture would turn over.
const STEEPEST: f32 = 0.02;
/// Nearest that the camera comes to what it is aimed at, m.
const NEAREST: f32 = 1e-4;
/// Farthest, m.
const FARTHEST: f32 = 1e6;

impl Pose {
    /// Moved by so much: see [`crate::protocol::Command::Move`]. `tan_half_width`: tangent of half the angle of view across.
    pub fn moved(self, how: Motion, by: [f64; 2], tan_half_width: f32) -> Pose {
        let [x, y] = by.map(|v| v as f32);
        let to = self.target - self.eye;
        let distance = to.length().max(NEAREST);
        match how {
            Motion::Orbit => Pose { eye: self.target - self.turned(to, x, y), ..self },
            Motion::Turn => Pose { target: self.eye + self.turned(to, -x, -y), ..self },
            Motion::Pan => {
                let scale = 2.0 * tan_half_width * distance;
                let (right, above) = self.across();
                // The picture follows the hand: the camera goes the other way.
                let shift = (above * y - right * x) * scale;
                Pose { eye: self.eye + shift, target: self.target + shift, ..self }
            }
            Motion::Dolly => Pose { eye: self.target - to * ((distance * y.exp()).clamp(NEAREST, FARTHEST) / distance), ..self },
            Motion::Level => {
                let flat = Vec3::new(to.x, 0.0, to.z);
                match flat.length() > 1e-3 * distance {
                    true => Pose { target: self.eye + flat.normalize() * distance, up: Vec3::Y, ..self },
                    false => Pose { up: Vec3::Y, ..self },
                }
            }
        }
    }

    /// To the right and up in the picture.
    fn across(&self) -> (Vec3, Vec3) {
        let ahead = (self.target - self.eye).normalize_or(Vec3::NEG_Z);
        let right = ahead.cross(self.up).normalize_or(ahead.any_orthonormal_vector());
        (right, right.cross(ahead))
    }

    /// A direction turned about the vertical and then up, not over the top.
    fn turned(&self, to: Vec3, x: f32, y: f32) -> Vec3 {
        let up = self.up.normalize_or(Vec3::Y);
        let (right, _) = self.across();
        let about = Mat3::from_axis_angle(up, -x);
        let angle = to.normalize_or(Vec3::NEG_Z).angle_between(up);
        let lowered = (angle + y).clamp(STEEPEST, std::f32::consts::PI - STEEPEST) - angle;
        about * (Mat3::from_axis_angle(right, -lowered) * to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: Pose = Pose { eye: Vec3::new(0.0, 1.0, 4.0), target: Vec3::ZERO, up: Vec3::Y };

    #[test]
    fn an_orbit_keeps_distance_and_aim() {
        let moved = POSE.moved(Motion::Orbit, [0.7, 0.2], 0.36);
        assert_eq!(moved.target, POSE.target);
        assert!((moved.eye.length() - POSE.eye.length()).abs() < 1e-5);
        // There and back.
        let back = moved.moved(Motion::Orbit, [-0.7, -0.2], 0.36);
        assert!((back.eye - POSE.eye).length() < 1e-5, "{back:?}");
        // Dragging down lifts the camera, and never over the top.
        assert!(moved.eye.y > POSE.eye.y);
        let top = (0..50).fold(POSE, |p, _| p.moved(Motion::Orbit, [0.0, 0.3], 0.36));
        assert!(top.eye.y > 0.99 * top.eye.length() && top.eye.is_finite() && top.eye.z > 0.0, "{top:?}");
    }

    #[test]
    fn a_pan_moves_the_aim_by_shares_of_the_picture() {
        // A quarter of the width, that what was in the middle follows to the right.
        let moved = POSE.moved(Motion::Pan, [0.25, 0.0], 0.36);
        let shift = moved.eye - POSE.eye;
        assert!((shift.x + 0.25 * 2.0 * 0.36 * POSE.eye.length()).abs() < 1e-5 && shift.y.abs() < 1e-6, "{shift}");
        assert!((moved.target - POSE.target - shift).length() < 1e-6);
    }

    #[test]
    fn a_dolly_never_passes_its_aim() {
        let nearer = (0..1000).fold(POSE, |p, _| p.moved(Motion::Dolly, [0.0, -1.0], 0.36));
        assert!(nearer.eye.is_finite() && (nearer.eye - nearer.target).length() > 0.0);
        let half = POSE.moved(Motion::Dolly, [0.0, -(2f64.ln())], 0.36);
        assert!((half.eye - POSE.eye * 0.5).length() < 1e-5);
    }

    #[test]
    fn level_looks_to_the_horizon() {
        let level = POSE.moved(Motion::Level, [0.0; 2], 0.36);
        assert_eq!(level.eye, POSE.eye);
        assert!((level.target.y - level.eye.y).abs() < 1e-6 && level.target.z < level.eye.z);
        let turned = POSE.moved(Motion::Turn, [0.1, 0.0], 0.36);
        assert!(turned.eye == POSE.eye && turned.target != POSE.target);
    }
}

//! A surface point to ask materials at.

use diopter_scene::shape::{Detail, Surface};
use glam::{Vec2, Vec3, Vec4};

/// A point of the plane z = 0 whose tangent is x.
pub fn level() -> Surface {
    Surface {
        point: Vec3::ZERO,
        t: 1.0,
        ng: Vec3::Z,
        ns: Vec3::Z,
        tangent: Vec3::X,
        handedness: 1.0,
        uv: [Vec2::ZERO; 2],
        color: Vec4::ONE,
        object: 0,
        triangle: 0,
        reach: 1.0,
        detail: Detail::None,
    }
}

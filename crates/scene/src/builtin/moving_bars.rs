//! Two white bars that move at 1 m/s before a dark wall: one upright, to the right, one level, downwards. For measuring what time does to
//! edges. Even light of 2000 lx from the front, D65. The wall stands 2 cm behind the bars, which begin anew every second.

use super::Framing;
use super::builder::{Builder, block, slide};
use crate::light::{Punctual, PunctualKind};
use crate::motion::Parts;
use crate::scene::Description;
use diopter_light::Spectrum;
use glam::Vec3;

/// m/s, and how far they go, m.
pub const SPEED: f32 = 1.0;
const WAY: f32 = 1.0;
/// Distance of the bars from the camera, m.
pub const DISTANCE: f32 = 2.0;

/// The bars are 2 m away.
pub const FRAMING: Framing = Framing {
    look_from: Vec3::new(0.0, 0.0, DISTANCE),
    look_at: Vec3::ZERO,
    focal_length_mm: 50.0,
    f_number: 8.0,
    focus_m: DISTANCE as f64,
};

/// The bars; at half a second both cross the middle of the picture.
pub fn description() -> Description {
    let mut b = Builder(Description { name: "moving-bars".into(), ..Default::default() });
    let (dark, white) = (b.matte("wall", [0.03; 3]), b.matte("bar", [0.9; 3]));
    b.quad("wall", Vec3::new(-3.0, -3.0, -0.02), [Vec3::X * 6.0, Vec3::Y * 6.0], dark);
    let upright = b.node("upright bar", None, Parts::IDENTITY);
    b.hang("upright bar", block(Vec3::new(-0.1, -2.0, -0.01), Vec3::new(0.0, 2.0, 0.0)), white, upright);
    let level = b.node("level bar", None, Parts::IDENTITY);
    b.hang("level bar", block(Vec3::new(-2.0, -0.1, -0.011), Vec3::new(2.0, 0.0, -0.001)), white, level);
    b.animate(
        "move",
        vec![
            slide(upright, Vec3::X * -0.5 * WAY, Vec3::X * 0.5 * WAY, WAY / SPEED),
            slide(level, Vec3::Y * 0.5 * WAY, Vec3::Y * -0.5 * WAY, WAY / SPEED),
        ],
    );
    let direction = Vec3::new(0.0, -0.3, -1.0).normalize();
    let power = Spectrum::light_from_rgb(Vec3::splat(2000.0 / -direction.z));
    b.0.punctual.push(Punctual::new("lamp", power, PunctualKind::Directional { direction }));
    b.0
}

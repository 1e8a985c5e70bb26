//! Filmic curves of games.
//!
//! Sources: Hable 2010, "Filmic tonemapping operators" (constants A–F, white 11.2, exposure bias 2); Hejl & Burgess-Dawson, as given there.

use diopter_light::color::srgb_decode;
use glam::Vec3;

/// Light that Hable's curve shows as white, after its bias.
pub const HABLE_WHITE: f32 = 11.2;
const BIAS: f32 = 2.0;

fn shoulder(x: f32) -> f32 {
    const A: f32 = 0.15;
    const B: f32 = 0.50;
    const C: f32 = 0.10;
    const D: f32 = 0.20;
    const E: f32 = 0.02;
    const F: f32 = 0.30;
    (x * (A * x + C * B) + D * E) / (x * (A * x + B) + D * F) - E / F
}

/// Hable's curve on each channel.
pub fn hable(c: Vec3, white: f32) -> Vec3 {
    let scale = 1.0 / shoulder(white);
    c.max(Vec3::ZERO).map(|x| (shoulder(BIAS * x) * scale).clamp(0.0, 1.0))
}

/// Hejl & Burgess-Dawson's curve, which gives display codes.
pub fn hejl(c: Vec3) -> Vec3 {
    c.map(|v| {
        let x = (v - 0.004).max(0.0);
        srgb_decode(x * (6.2 * x + 0.5) / (x * (6.2 * x + 1.7) + 0.06))
    })
}

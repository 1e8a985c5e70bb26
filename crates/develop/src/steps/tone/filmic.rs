//! Filmic curves of games.
//!
//! Sources: Hable 2010, "Filmic tonemapping operators" (constants A–F, white 11.2, exposure bias 2); Hejl & Burgess-Dawson, as given there.

use super::{Asked, Rendering};
use diopter_light::color::srgb_decode;
use glam::Vec3;

/// Light that Hable's curve shows as white, after its bias.
const HABLE_WHITE: f32 = 11.2;
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

/// Hable's curve on each channel, and what brings its white to 1.
pub struct Hable(f32);

impl Rendering for Hable {
    fn new(asked: &Asked) -> Self {
        Hable(1.0 / shoulder(asked.white_or(HABLE_WHITE)))
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        scene.max(Vec3::ZERO).map(|x| (shoulder(BIAS * x) * self.0).clamp(0.0, 1.0))
    }
}

/// Hejl & Burgess-Dawson's curve, which gives display codes.
pub struct Hejl;

impl Rendering for Hejl {
    fn new(_: &Asked) -> Self {
        Hejl
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        scene.map(|v| {
            let x = (v - 0.004).max(0.0);
            srgb_decode(x * (6.2 * x + 0.5) / (x * (6.2 * x + 1.7) + 0.06))
        })
    }
}

//! Khronos PBR Neutral: colours below 0.8 as they are, highlights compressed and desaturated.
//!
//! Source: Khronos Group, ToneMapping, PBR_Neutral (2024), formula and constants.

use super::{Asked, Rendering};
use glam::Vec3;

const START: f32 = 0.8 - 0.04;
const DESATURATION: f32 = 0.15;

pub struct Neutral;

impl Rendering for Neutral {
    fn new(_: &Asked) -> Self {
        Neutral
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        let c = scene.max(Vec3::ZERO);
        let x = c.min_element();
        let offset = if x < 0.08 { x - 6.25 * x * x } else { 0.04 };
        let c = c - offset;
        let peak = c.max_element();
        if peak < START {
            return c;
        }
        let d = 1.0 - START;
        let compressed = 1.0 - d * d / (peak + d - START);
        let g = 1.0 / (DESATURATION * (peak - compressed) + 1.0);
        (c * (compressed / peak)).lerp(Vec3::splat(compressed), 1.0 - g)
    }
}

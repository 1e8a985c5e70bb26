//! Reinhard, Stark, Shirley & Ferwerda 2002, "Photographic tone reproduction for digital images" (SIGGRAPH).

use super::{Asked, LUMA, Rendering};
use glam::Vec3;

/// Luminance that the extended curve shows as white, in scene whites. Chosen: two stops above white.
const WHITE: f32 = 4.0;

/// x / (1 + x) on each channel (eq. 3).
pub struct Simple;

impl Rendering for Simple {
    fn new(_: &Asked) -> Self {
        Simple
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        let c = scene.max(Vec3::ZERO);
        c / (Vec3::ONE + c)
    }
}

/// Eq. 4, L (1 + L / Lw²) / (1 + L), on luminance, with its white.
pub struct Extended(f32);

impl Rendering for Extended {
    fn new(asked: &Asked) -> Self {
        Extended(asked.white_or(WHITE))
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        on_luminance(scene, |l| (1.0 + l / (self.0 * self.0)) / (1.0 + l))
    }
}

/// Eq. 3 on luminance.
pub struct Luminance;

impl Rendering for Luminance {
    fn new(_: &Asked) -> Self {
        Luminance
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        on_luminance(scene, |l| 1.0 / (1.0 + l))
    }
}

/// Scales a colour by a factor of its luminance; what does not fit is clipped.
fn on_luminance(c: Vec3, factor: impl Fn(f32) -> f32) -> Vec3 {
    let l = c.dot(LUMA);
    if l <= 0.0 {
        return Vec3::ZERO;
    }
    (c * factor(l)).clamp(Vec3::ZERO, Vec3::ONE)
}

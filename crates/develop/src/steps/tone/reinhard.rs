//! Reinhard, Stark, Shirley & Ferwerda 2002, "Photographic tone reproduction for digital images" (SIGGRAPH).

use super::LUMA;
use glam::Vec3;

/// Luminance that the extended curve shows as white, in scene whites. Chosen: two stops above white.
pub const WHITE: f32 = 4.0;

/// x / (1 + x) on each channel (eq. 3).
pub fn simple(c: Vec3) -> Vec3 {
    let c = c.max(Vec3::ZERO);
    c / (Vec3::ONE + c)
}

/// Eq. 4, L (1 + L / Lw²) / (1 + L), on luminance.
pub fn extended(c: Vec3, white: f32) -> Vec3 {
    on_luminance(c, |l| (1.0 + l / (white * white)) / (1.0 + l))
}

/// Eq. 3 on luminance.
pub fn luminance(c: Vec3) -> Vec3 {
    on_luminance(c, |l| 1.0 / (1.0 + l))
}

/// Scales a colour by a factor of its luminance; what does not fit is clipped.
fn on_luminance(c: Vec3, factor: impl Fn(f32) -> f32) -> Vec3 {
    let l = c.dot(LUMA);
    if l <= 0.0 {
        return Vec3::ZERO;
    }
    (c * factor(l)).clamp(Vec3::ZERO, Vec3::ONE)
}

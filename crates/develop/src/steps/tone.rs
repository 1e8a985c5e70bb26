//! Exposure and tone: scene-linear to display-linear.
//!
//! Sources: Reinhard, Stark, Shirley & Ferwerda 2002, eq. 4 (extended, white at 4 times what fills the sensor's display
//! range); Hill's fit of the ACES 1.x RRT and sRGB ODT (MJP, BakingLab, ACES.hlsl, MIT), scaled so that 18 % grey stays.

use crate::recipe::Tone;
use diopter_image::Raster;
use glam::{Mat3, Vec3};

/// A metered grey is 12.7 % of saturation (ISO 12232: 10/78); pictures show it as 18 %: the sensor's headroom.
const GREY_GAIN: f32 = 0.18 * 78.0 / 10.0;
/// Luminance that Reinhard's curve takes to white.
const REINHARD_WHITE: f32 = 4.0;

/// Brightens by stops and applies a curve, in place.
pub fn apply(rgb: &mut Raster<f32>, exposure_ev: f32, tone: Tone) {
    let gain = GREY_GAIN * exposure_ev.exp2();
    for pixel in rgb.data.chunks_exact_mut(3) {
        let c = Vec3::from_slice(pixel) * gain;
        let c = match tone {
            Tone::Linear => c,
            Tone::Reinhard => reinhard(c),
            Tone::Aces => aces(c),
        };
        pixel.copy_from_slice(&c.clamp(Vec3::ZERO, Vec3::ONE).to_array());
    }
}

/// Reinhard's extended curve on luminance.
pub fn reinhard(c: Vec3) -> Vec3 {
    let l = c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    if l <= 0.0 {
        return Vec3::ZERO;
    }
    c * ((1.0 + l / (REINHARD_WHITE * REINHARD_WHITE)) / (1.0 + l))
}

fn rrt_and_odt(v: Vec3) -> Vec3 {
    (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081)
}

/// The ACES fit; 18 % grey stays 18 %.
pub fn aces(c: Vec3) -> Vec3 {
    let rows = |a: [f32; 9]| Mat3::from_cols_array(&a).transpose();
    let into = rows([0.59719, 0.35458, 0.04823, 0.07600, 0.90834, 0.01566, 0.02840, 0.13383, 0.83777]);
    let out = rows([1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602]);
    /// Solves fit(0.18 · gain) = 0.18.
    const GAIN: f32 = 1.46193;
    out * rrt_and_odt(into * (c.max(Vec3::ZERO) * GAIN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_stays_grey_and_brighter_stays_brighter() {
        for curve in [reinhard, aces] {
            let mut before = -1.0;
            for i in 0..200 {
                let v = curve(Vec3::splat(0.001 * 1.06f32.powi(i)));
                assert!((v.x - v.y).abs() < 2e-3 && (v.y - v.z).abs() < 2e-3, "{v}");
                assert!(v.y > before);
                before = v.y;
            }
        }
    }

    #[test]
    fn curves_have_their_anchors() {
        assert!((aces(Vec3::splat(0.18)).y - 0.18).abs() < 1e-3, "{}", aces(Vec3::splat(0.18)));
        assert!((reinhard(Vec3::splat(REINHARD_WHITE)).x - 1.0).abs() < 1e-5);
        // Reinhard at L = 1: (1 + 1/16) / 2.
        assert!((reinhard(Vec3::ONE).x - 0.53125).abs() < 1e-5);
    }
}

//! The overcast sky of the CIE: even in azimuth, three times as bright at the zenith as at the horizon.
//!
//! L(γ) = L_z (1 + 2 sin γ) / 3, γ the elevation. Its illuminance of the level ground is E = 7π/9 L_z. Its colour is D65. Below the horizon is an
//! endless ground. Sources: P. Moon & D. E. Spencer 1942, "Illumination from a non-uniform sky", Illum. Eng. 37; CIE S 011:2003 (type 16).

use crate::light::Environment;
use crate::light::environment::direction;
use diopter_image::Raster;
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::PI;

/// Illuminance of the level ground under it, lx: chosen between a dull day (5 000 lx) and a bright grey one (20 000 lx).
pub const ILLUMINANCE_LX: f32 = 10_000.0;

/// Columns and rows of the map: it depends on the elevation alone.
const SIZE: [usize; 2] = [8, 256];

/// The sky that makes `illuminance_lx` on the level ground, over an endless ground of an albedo `ground` (0 to 1).
pub fn sky(illuminance_lx: f32, ground: f32) -> Environment {
    let below = ground * illuminance_lx / PI;
    let [columns, rows] = SIZE;
    let mut map = Raster::new(columns, rows, 3);
    for row in 0..rows {
        let towards = direction(Vec2::new(0.5, (row as f32 + 0.5) / rows as f32));
        let luminance = if towards.y > 0.0 { luminance(illuminance_lx, towards) } else { below };
        (0..columns).for_each(|column| map.pixel_mut(column, row).fill(luminance));
    }
    Environment::new(map, Mat3::IDENTITY, 1.0)
}

/// Luminance of that sky towards a direction above the horizon, cd/m².
fn luminance(illuminance_lx: f32, towards: Vec3) -> f32 {
    let sine = towards.normalize_or_zero().y.max(0.0);
    9.0 * illuminance_lx / (7.0 * PI) * (1.0 + 2.0 * sine) / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::color::SRGB_LUMINANCE;

    #[test]
    fn the_level_ground_gets_what_is_claimed() {
        for lux in [1.0, 10_000.0] {
            let sky = sky(lux, 0.2);
            // Even in cos² θ: each direction counts as the ground sees it.
            let n = 400;
            let mean: f64 = (0..n * n)
                .map(|i| {
                    let (a, b) = (i / n, i % n);
                    let cos = ((a as f32 + 0.5) / n as f32).sqrt();
                    let (sin, phi) = ((1.0 - cos * cos).sqrt(), 2.0 * PI * (b as f32 + 0.5) / n as f32);
                    f64::from(sky.rgb(Vec3::new(sin * phi.cos(), cos, sin * phi.sin())).dot(SRGB_LUMINANCE))
                })
                .sum::<f64>()
                / f64::from(n * n);
            assert!((mean * std::f64::consts::PI / f64::from(lux) - 1.0).abs() < 2e-3, "{lux}: {mean}");
        }
    }

    #[test]
    fn the_zenith_is_three_times_as_bright_as_the_horizon() {
        let sky = sky(10_000.0, 0.2);
        let at = |elevation_deg: f32| {
            let e = elevation_deg.to_radians();
            Vec3::new(0.6 * e.cos(), e.sin(), -0.8 * e.cos())
        };
        for elevation in [2.0f32, 10.0, 30.0, 60.0, 90.0] {
            // Illuminance of the level ground is 7π/9 of the zenith's luminance.
            let sine = elevation.to_radians().sin();
            let expected = 10_000.0 / (7.0 * PI / 9.0) * (1.0 + 2.0 * sine) / 3.0;
            let found = sky.rgb(at(elevation)).dot(SRGB_LUMINANCE);
            assert!((found / expected - 1.0).abs() < 5e-3, "{elevation}°: {found} {expected}");
        }
        assert!((luminance(1.0, Vec3::Y) / luminance(1.0, Vec3::X) - 3.0).abs() < 1e-5);
        // Below is the ground.
        assert!((sky.rgb(at(-30.0)).y - 0.2 * 10_000.0 / PI).abs() < 0.5);
    }
}

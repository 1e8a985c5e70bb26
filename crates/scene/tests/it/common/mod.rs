//! Light along single rays, by many paths.

pub mod level;
pub mod tables;

use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::{Ray, SampledWavelengths};
use diopter_scene::{PathSettings, Scene};
use glam::Vec3;

pub const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];
/// Deep enough that no light is left out.
pub const DEEP: PathSettings = PathSettings { max_depth: 4000, roulette_depth: 4000 };

/// Mean of light along a ray at a moment by `n` paths, and its standard error, relative to RGB light of 1.
pub fn mean_at(scene: &Scene, from: Vec3, towards: Vec3, time_s: f32, n: u32, settings: &PathSettings) -> ([f64; 4], [f64; 4]) {
    let wavelengths = SampledWavelengths::fixed(NM);
    let white = wavelengths.d65_one_nit();
    let ray = Ray { origin: from, direction: towards.normalize(), time_s };
    let (mut sum, mut squares) = ([0.0f64; 4], [0.0f64; 4]);
    for i in 0..n {
        let sampler = Sampler::new(SamplerKind::Independent, 5, (3, 4), i, n);
        let l = (scene.radiance(ray, &wavelengths, &sampler, settings) / white).to_array().map(f64::from);
        (0..4).for_each(|k| (sum[k], squares[k]) = (sum[k] + l[k], squares[k] + l[k] * l[k]));
    }
    let n = n as f64;
    let error = |k: usize| ((squares[k] / n - (sum[k] / n).powi(2)).max(0.0) / n).sqrt();
    (sum.map(|s| s / n), [error(0), error(1), error(2), error(3)])
}

/// The same at the beginning of the exposure.
pub fn mean(scene: &Scene, from: Vec3, towards: Vec3, n: u32, settings: &PathSettings) -> ([f64; 4], [f64; 4]) {
    mean_at(scene, from, towards, 0.0, n, settings)
}

/// As the noise allows, four standard errors (once in 16 000), and so much of what is expected.
pub fn assert_within((found, error): ([f64; 4], [f64; 4]), expected: [f64; 4], relative: f64, what: &str) {
    for k in 0..4 {
        let (off, allowed) = ((found[k] - expected[k]).abs(), 4.0 * error[k] + relative * expected[k].abs());
        assert!(off < allowed, "{what}, {} nm: {} ± {}, expected {}", NM[k], found[k], error[k], expected[k]);
    }
}

//! Developing: from a raw image to a picture. A pure function of the raw image and a [`Recipe`].
//!
//! The order of the steps is in [`develop`](mod@develop); each step is a file in [`steps`]. Working numbers are linear, 1.0 = sensor saturation, camera
//! channels until the matrix; then linear sRGB without limits, 0.18 = middle grey, until the encoding. [`lut`] reads, bakes and applies tables.
//!
//! Not here: retouching, layers, catalogues, files (`diopter-image` has them); the read-out of a sensor. Begin with [`Developer`].

pub mod denoise;
pub mod develop;
mod geometry;
pub mod light_field;
mod look;
pub mod lut;
mod overview;
mod recipe;
mod region;
mod setting;
pub mod stack;
pub mod steps;

pub use denoise::denoise;
pub use develop::{Developer, Step, develop, unknown_lens};
pub use geometry::Geometry;
pub use look::{Baked, bake};
pub use recipe::*;

#[cfg(test)]
mod tests {
    use diopter_image::raw::Cfa;
    use diopter_image::{ExposureFacts, Raster, RawHeader, RawImage};

    /// A raw image of 16-bit numbers, black 100, saturated at 1100, from DN above black.
    pub fn raw(width: usize, height: usize, pattern: &str, dn: impl Fn(usize, usize) -> f64) -> RawImage {
        let cfa = Cfa::parse(pattern).unwrap();
        let n = cfa.channel_count();
        let data = (0..width * height).map(|i| (100.5 + dn(i % width, i / width)).clamp(0.0, 1100.0) as u16).collect();
        RawImage {
            mosaic: Raster { width, height, channels: 1, data },
            header: RawHeader {
                cfa,
                bits: 12,
                black_level: 100.0,
                white_level: 1100.0,
                as_shot_neutral: vec![1.0; n],
                calibrations: vec![],
                baseline_ev: 0.0,
                framing: Default::default(),
                opcodes: vec![],
                warnings: vec![],
                noise: vec![],
                facts: ExposureFacts::default(),
            },
        }
    }

    /// A normal number that depends on an index alone.
    pub fn gaussian(i: usize) -> f64 {
        let hash = |k: u64| {
            let mut x = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ k;
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        (-2.0 * (1.0 - hash(1)).ln()).sqrt() * (std::f64::consts::TAU * hash(2)).cos()
    }
}

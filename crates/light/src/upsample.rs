//! Smooth spectra from RGB: what textures, glTF colours and RGB lights become.
//!
//! A colour is looked up in a table of sigmoid coefficients fitted at build time (see `upsample_fit.rs`; Jakob & Hanika
//! 2019). Colours are linear sRGB in 0..1; the spectrum has that colour under D65.

use crate::upsample_fit::{NODES, brightness_of_node};
use crate::wavelength::{SampledSpectrum, SampledWavelengths};
use glam::{Vec3, Vec4};
use std::sync::OnceLock;

static TABLE_BYTES: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/upsample.bin"));

struct Coefficients {
    /// `[largest][brightness][second][third]`
    nodes: Vec<Vec4>,
    brightness: [f32; NODES],
    grey: [f32; NODES],
}

/// The constant p with S(p) = `g`.
fn grey_coefficient(g: f32) -> f32 {
    let g = g.clamp(1e-5, 1.0 - 1e-6);
    (g - 0.5) / (g * (1.0 - g)).sqrt()
}

fn coefficients() -> &'static Coefficients {
    static TABLE: OnceLock<Coefficients> = OnceLock::new();
    TABLE.get_or_init(|| {
        let floats: Vec<f32> = TABLE_BYTES.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        Coefficients {
            nodes: floats.chunks_exact(3).map(|c| Vec4::new(c[0], c[1], c[2], 0.0)).collect(),
            brightness: std::array::from_fn(|k| brightness_of_node(k) as f32),
            grey: std::array::from_fn(|k| grey_coefficient(brightness_of_node(k) as f32)),
        }
    })
}

/// The cell of the chroma axis that holds a ratio to the largest component, and where in it (linear in the ratio).
#[inline]
fn chroma_cell(ratio: f32) -> (usize, f32) {
    let steps = (NODES - 1) as f32;
    let i = ((ratio.sqrt() * steps) as usize).min(NODES - 2);
    let x = ratio * steps * steps;
    (i, (x - (i * i) as f32) / (2 * i + 1) as f32)
}

/// A reflectance within 0..1: S(c₀x² + c₁x + c₂), x = (λ − 580 nm) / 200 nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigmoid {
    /// c₀, c₁, c₂
    pub c: Vec3,
    /// The colour it was made from, linear sRGB.
    pub rgb: Vec3,
}

impl Sigmoid {
    /// The spectrum of a linear sRGB colour; components are clamped to 0..1 (NaN to 0).
    pub fn from_rgb(rgb: Vec3) -> Self {
        let rgb = rgb.max(Vec3::ZERO).min(Vec3::ONE);
        let table = coefficients();
        // A grey needs no table: S is constant.
        if rgb.x == rgb.y && rgb.y == rgb.z {
            return Sigmoid { c: Vec3::new(0.0, 0.0, grey_coefficient(rgb.x)), rgb };
        }
        let largest = if rgb.x >= rgb.y && rgb.x >= rgb.z {
            0
        } else if rgb.y >= rgb.z {
            1
        } else {
            2
        };
        let z = rgb[largest];
        let (second, third) = (rgb[(largest + 1) % 3] / z, rgb[(largest + 2) % 3] / z);
        let (i, fi) = chroma_cell(second);
        let (j, fj) = chroma_cell(third);
        let k = table.brightness.partition_point(|b| *b <= z).clamp(1, NODES - 1) - 1;
        // Between two brightnesses, linear in the coefficient a grey would have: greys then interpolate exactly.
        let grey = grey_coefficient(z);
        let fk = ((grey - table.grey[k]) / (table.grey[k + 1] - table.grey[k])).clamp(0.0, 1.0);
        let node = |k: usize, i: usize, j: usize| table.nodes[((largest * NODES + k) * NODES + i) * NODES + j];
        let plane = |k: usize| {
            let low = node(k, i, j).lerp(node(k, i, j + 1), fj);
            let high = node(k, i + 1, j).lerp(node(k, i + 1, j + 1), fj);
            low.lerp(high, fi)
        };
        let mut c = plane(k).lerp(plane(k + 1), fk).truncate();
        if z < table.brightness[0] {
            // Darker than the table: keep the shape and lower it towards black, S(p) ≈ 1/(4p²) for p ≪ −1.
            let factor = (table.brightness[0] / z.max(1e-12)).sqrt();
            c *= factor;
        }
        Sigmoid { c, rgb }
    }

    /// Reflectance, 0 to 1, at a wavelength in nm.
    #[inline]
    pub fn at(&self, nm: f32) -> f32 {
        let x = (nm - 580.0) / 200.0;
        let p = (self.c.x * x + self.c.y) * x + self.c.z;
        0.5 + 0.5 * p / (1.0 + p * p).sqrt()
    }

    /// Reflectance, 0 to 1, at the wavelengths of a path; the colour itself in RGB lanes.
    #[inline]
    pub fn sample(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        if wavelengths.is_rgb() {
            return SampledWavelengths::lanes(self.rgb);
        }
        let x = (wavelengths.nm - 580.0) * (1.0 / 200.0);
        let p = (x * self.c.x + self.c.y) * x + self.c.z;
        let root = Vec4::ONE + p * p;
        let root = Vec4::new(root.x.sqrt(), root.y.sqrt(), root.z.sqrt(), root.w.sqrt());
        p / root * 0.5 + 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cie::illuminant;
    use crate::color::{RgbSpace, delta_e_2000, lab, xyz_from_xy, xyz_of};
    use crate::spectrum::Spectrum;
    use glam::DVec3;

    /// ΔE2000 between a colour and the colour of its spectrum under D65, at 5 nm.
    fn round_trip_error(rgb: Vec3) -> f64 {
        let d65 = illuminant("D65").unwrap();
        let light = |nm: f32| if (380.0..=780.0).contains(&nm) { d65.at(nm) } else { 0.0 };
        let white = xyz_of(light);
        let sigmoid = Sigmoid::from_rgb(rgb);
        let got = xyz_of(|nm| light(nm) * sigmoid.at(nm)) / white.y;
        let xyz = RgbSpace::Srgb.xyz_from_rgb() * rgb.as_dvec3();
        let nominal = xyz_from_xy(crate::color::D65_XY);
        // Each against its own white: tabulated D65 and the rounded chromaticity of the standard differ in the 5th digit.
        delta_e_2000(lab(got, white / white.y), lab(xyz, nominal))
    }

    #[test]
    fn round_trip_over_the_srgb_cube_stays_below_half_a_delta_e() {
        let mut worst = (0.0, Vec3::ZERO);
        let mut sum = 0.0;
        // Display codes, off the nodes of the table, with the faces and corners of the cube.
        let codes = [0.0, 0.031, 0.09, 0.17, 0.29, 0.41, 0.53, 0.66, 0.79, 0.9, 0.97, 1.0];
        for r in codes {
            for g in codes {
                for b in codes {
                    let rgb = Vec3::new(r, g, b).map(crate::color::srgb_decode);
                    let error = round_trip_error(rgb);
                    sum += error;
                    if error > worst.0 {
                        worst = (error, rgb);
                    }
                }
            }
        }
        let mean = sum / (codes.len() as f64).powi(3);
        assert!(worst.0 < 0.5, "worst ΔE2000 {:.3} at {}, mean {mean:.4}", worst.0, worst.1);
        assert!(mean < 0.05, "mean ΔE2000 {mean}");
    }

    #[test]
    fn spectra_are_energy_conserving_and_finite() {
        for rgb in [Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1e-6, 0.0, 3e-7), Vec3::splat(f32::NAN)] {
            let s = Sigmoid::from_rgb(rgb);
            assert!((380..=780).all(|nm| (0.0..=1.0).contains(&s.at(nm as f32))), "{rgb}");
        }
        assert!((Sigmoid::from_rgb(Vec3::ONE).at(555.0) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn rgb_light_of_one_has_a_luminance_of_one_nit() {
        let light = Spectrum::light_from_rgb(Vec3::ONE);
        assert!((crate::color::luminance(|nm| light.at(nm)) - 1.0).abs() < 1e-4);
        let green = crate::color::luminance(|nm| Spectrum::light_from_rgb(Vec3::new(0.0, 10.0, 0.0)).at(nm));
        assert!((green / 7.1517 - 1.0).abs() < 0.01, "{green}");
    }

    #[test]
    fn the_fit_reaches_the_colour_where_it_starts_cold() {
        let observer = crate::cie::tables::read_csv(crate::cie::tables::CIE_1931_CSV).1;
        let (_, rows) = crate::cie::tables::read_csv(crate::cie::tables::ILLUMINANTS_CSV);
        let d65: Vec<(f64, f64)> = rows.iter().map(|r| (r[0], r[4])).collect();
        let fit = crate::upsample_fit::Fit::new(&observer, &d65);
        let c = fit.solve(DVec3::new(0.2, 0.5, 0.1), DVec3::ZERO);
        let table = Sigmoid::from_rgb(Vec3::new(0.2, 0.5, 0.1)).c;
        assert!((c.as_vec3() - table).length() < 0.02 * table.length(), "{c} {table}");
    }
}

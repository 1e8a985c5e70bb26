//! Spectra as functions of wavelength, and the closed forms among them.

use crate::units::{BOLTZMANN, PLANCK, SPEED_OF_LIGHT};
use crate::upsample::Sigmoid;
use crate::wavelength::{Sampled, Wavelengths};
use glam::Vec3;
use std::sync::{Arc, OnceLock};

/// A spectrum sampled at equal steps of wavelength, linear between samples and constant beyond the ends.
#[derive(Clone, Debug)]
pub struct Table {
    first_nm: f32,
    per_nm: f32,
    values: Arc<[f32]>,
    /// [`Table::srgb_of_light`], once somebody asked: integrals take microseconds, and paths that carry colours ask at every lamp.
    srgb_of_light: Arc<OnceLock<Vec3>>,
}

impl PartialEq for Table {
    fn eq(&self, other: &Self) -> bool {
        self.first_nm == other.first_nm && self.per_nm == other.per_nm && self.values == other.values
    }
}

impl Table {
    /// `values[i]` holds at `first_nm + i * step_nm`. Panics when there are no values or the step is not positive.
    pub fn new(first_nm: f32, step_nm: f32, values: Vec<f32>) -> Self {
        assert!(!values.is_empty() && step_nm > 0.0, "{} values in steps of {step_nm} nm", values.len());
        Table { first_nm, per_nm: 1.0 / step_nm, values: values.into(), srgb_of_light: Arc::default() }
    }

    /// The same by values a nanometre, as [`Table::first_nm`], [`Table::per_nm`] and [`Table::values`] tell them of another: equal to it bit by bit. Panics as
    /// [`Table::new`] does.
    pub fn from_parts(first_nm: f32, per_nm: f32, values: Vec<f32>) -> Self {
        assert!(!values.is_empty() && per_nm > 0.0, "{} values, {per_nm} a nanometre", values.len());
        Table { first_nm, per_nm, values: values.into(), srgb_of_light: Arc::default() }
    }

    /// Wavelength of the first value, nm.
    pub fn first_nm(&self) -> f32 {
        self.first_nm
    }

    /// Values a nanometre.
    pub fn per_nm(&self) -> f32 {
        self.per_nm
    }

    /// The values, evenly spaced.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// A table at 5 nm, 380–780 nm, through unevenly spaced `(nm, value)` points in rising order.
    pub fn from_points(points: &[(f32, f32)]) -> Self {
        let at = |nm: f32| match points.iter().position(|p| p.0 >= nm) {
            Some(0) => points[0].1,
            None => points[points.len() - 1].1,
            Some(i) => {
                let ((x0, y0), (x1, y1)) = (points[i - 1], points[i]);
                y0 + (y1 - y0) * (nm - x0) / (x1 - x0)
            }
        };
        Table::new(380.0, 5.0, (0..=80).map(|i| at(380.0 + 5.0 * i as f32)).collect())
    }

    /// Value at a wavelength in nm.
    #[inline]
    pub fn at(&self, nm: f32) -> f32 {
        let x = ((nm - self.first_nm) * self.per_nm).max(0.0);
        // By 32 bits: conversions to 64 take twice the instructions, and this is asked at every surface.
        let i = x as u32 as usize;
        if i + 1 >= self.values.len() {
            return self.values[self.values.len() - 1];
        }
        let t = x - i as f32;
        self.values[i] + (self.values[i + 1] - self.values[i]) * t
    }

    /// The same spectrum times a factor.
    pub fn scaled(&self, factor: f32) -> Self {
        Table { values: self.values.iter().map(|v| v * factor).collect(), srgb_of_light: Arc::default(), ..self.clone() }
    }

    /// Linear sRGB of light of this spectrum, see [`crate::color::srgb_of_light`].
    pub fn srgb_of_light(&self) -> Vec3 {
        *self.srgb_of_light.get_or_init(|| crate::color::srgb_of_light(|nm| self.at(nm)))
    }

    /// The largest value.
    pub fn max(&self) -> f32 {
        self.values.iter().copied().fold(f32::NEG_INFINITY, f32::max)
    }
}

/// A quantity over wavelength: reflectance, radiance, index of refraction.
#[derive(Clone, Debug, PartialEq)]
pub enum Spectrum {
    /// The same at every wavelength.
    Constant(f32),
    /// Smooth and within 0..1: a reflectance fitted to a colour.
    Sigmoid(Sigmoid),
    /// `scale` (cd/m² for a radiance) × a fitted colour × D65 of 1 cd/m²: a light given as RGB.
    RgbLight {
        /// Twice the largest RGB component.
        scale: f32,
        /// Colour divided by `scale`.
        color: Sigmoid,
    },
    /// Measured values.
    Table(Table),
    /// Values derived from three numbers that are no light, such as an index of refraction given as RGB: a table over wavelength, and the
    /// numbers themselves, which RGB lanes use as they are.
    TableOfRgb {
        /// Values over wavelength.
        table: Table,
        /// Red, green, blue; of any size.
        rgb: Vec3,
    },
}

impl Spectrum {
    /// Value at one wavelength in nm.
    pub fn at(&self, nm: f32) -> f32 {
        match self {
            Spectrum::Constant(value) => *value,
            Spectrum::Sigmoid(sigmoid) => sigmoid.at(nm),
            Spectrum::RgbLight { scale, color } => scale * color.at(nm) * crate::cie::d65_one_nit().at(nm),
            Spectrum::Table(table) | Spectrum::TableOfRgb { table, .. } => table.at(nm),
        }
    }

    /// The same of light: where a path carries colours, its colour.
    #[inline]
    pub fn sample_light(&self, wavelengths: &Wavelengths) -> Sampled {
        match self {
            Spectrum::Table(table) if wavelengths.is_rgb() => Wavelengths::lanes(table.srgb_of_light()),
            Spectrum::Constant(value) if wavelengths.is_rgb() => {
                static OF_ONE: OnceLock<Vec3> = OnceLock::new();
                Wavelengths::lanes(*OF_ONE.get_or_init(|| crate::color::srgb_of_light(|_| 1.0)) * *value)
            }
            _ => self.sample(wavelengths),
        }
    }

    /// Values at the wavelengths of a path.
    #[inline]
    pub fn sample(&self, wavelengths: &Wavelengths) -> Sampled {
        match self {
            Spectrum::Constant(value) => Sampled::splat(*value),
            Spectrum::Sigmoid(sigmoid) => sigmoid.sample(wavelengths),
            Spectrum::RgbLight { scale, color } => color.sample(wavelengths) * (wavelengths.d65_one_nit() * *scale),
            Spectrum::TableOfRgb { rgb, .. } if wavelengths.is_rgb() => Wavelengths::lanes(*rgb),
            Spectrum::Table(table) | Spectrum::TableOfRgb { table, .. } => {
                let nm = wavelengths.nm;
                Sampled::new(table.at(nm.x), table.at(nm.y), table.at(nm.z), table.at(nm.w))
            }
        }
    }
}

/// Spectral radiance of a black body, W·m⁻²·sr⁻¹·nm⁻¹, at `nm` and `kelvin`.
///
/// L = 2hc²/λ⁵ · 1/(exp(hc/λkT) − 1). Source: Planck's law.
pub fn blackbody(nm: f32, kelvin: f32) -> f32 {
    let lambda = nm as f64 * 1e-9;
    let x = PLANCK * SPEED_OF_LIGHT / (lambda * BOLTZMANN * kelvin as f64);
    (2.0 * PLANCK * SPEED_OF_LIGHT * SPEED_OF_LIGHT / lambda.powi(5) / x.exp_m1() * 1e-9) as f32
}

/// A black body's spectrum scaled to a luminance of `nits` (cd/m²), 380–780 nm at 5 nm.
pub fn blackbody_with_luminance(kelvin: f32, nits: f32) -> Spectrum {
    let table = Table::new(380.0, 5.0, (0..=80).map(|i| blackbody(380.0 + 5.0 * i as f32, kelvin)).collect());
    let luminance = crate::color::luminance(|nm| table.at(nm)) as f32;
    Spectrum::Table(table.scaled(nits / luminance))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blackbody_agrees_with_published_values() {
        // colour-science 0.4.7, W·sr⁻¹·m⁻³; it uses the constants of ITS-90 (c₂ = 0.014388 m·K), hence 2e-4.
        assert!((blackbody(500.0, 5000.0) as f64 * 1e9 / 12_106_064_534_472.861 - 1.0).abs() < 2e-4);
        assert!((blackbody(560.0, 2856.0) as f64 * 1e9 / 267_969_332_951.806_9 - 1.0).abs() < 2e-4);
    }

    #[test]
    fn blackbody_obeys_wiens_displacement_law() {
        for kelvin in [4000.0_f32, 5000.0, 6500.0] {
            let peak_nm = 2.897_771_955e6 / kelvin;
            let at_peak = blackbody(peak_nm, kelvin);
            assert!(blackbody(peak_nm * 0.99, kelvin) < at_peak && blackbody(peak_nm * 1.01, kelvin) < at_peak);
        }
    }

    #[test]
    fn rgb_lanes_take_the_numbers_of_a_table_as_they_are() {
        let spectrum = Spectrum::TableOfRgb { table: Table::new(400.0, 100.0, vec![1.0, 3.0]), rgb: Vec3::new(0.2, 0.9, 4.5) };
        assert_eq!(spectrum.sample(&Wavelengths::rgb()), Sampled::new(0.2, 0.9, 4.5, 0.9));
        assert_eq!(spectrum.sample(&Wavelengths::fixed([400.0, 450.0, 500.0, 600.0])), Sampled::new(1.0, 2.0, 3.0, 3.0));
        assert_eq!(spectrum.at(450.0), 2.0);
    }

    #[test]
    fn table_is_linear_inside_and_constant_outside() {
        let table = Table::new(400.0, 100.0, vec![1.0, 3.0]);
        assert_eq!([300.0, 400.0, 450.0, 500.0, 900.0].map(|nm| table.at(nm)), [1.0, 1.0, 2.0, 3.0, 3.0]);
    }
}

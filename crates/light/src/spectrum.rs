//! Spectra as functions of wavelength, and the closed forms among them.

pub use crate::table::Table;

use crate::cie::{d65_one_nit, luminance};
use crate::color::srgb_of_light;
use crate::units::{BOLTZMANN, PLANCK, SPEED_OF_LIGHT};
use crate::upsample::Sigmoid;
use crate::wavelength::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use std::sync::OnceLock;

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
    /// A reflectance of a linear sRGB colour; components beyond 0..1 are clamped.
    pub fn from_rgb(rgb: Vec3) -> Spectrum {
        Spectrum::Sigmoid(Sigmoid::from_rgb(rgb))
    }

    /// A light of a linear sRGB colour whose luminance is `rgb`'s in cd/m² (1 = 1 cd/m² of D65); negative parts are 0.
    ///
    /// The largest component is fitted at one half, as pbrt-v4 and Mitsuba 3 do: lights are not bounded by 1, and spectra
    /// that need not press against that bound are smoother.
    pub fn light_from_rgb(rgb: Vec3) -> Spectrum {
        let scale = 2.0 * rgb.max_element().max(0.0);
        if scale == 0.0 || !scale.is_finite() {
            return Spectrum::Constant(0.0);
        }
        Spectrum::RgbLight { scale, color: Sigmoid::from_rgb(rgb / scale) }
    }

    /// Value at one wavelength in nm, in the unit of what it is a spectrum of; 380–780 nm is what is used.
    pub fn at(&self, nm: f32) -> f32 {
        match self {
            Spectrum::Constant(value) => *value,
            Spectrum::Sigmoid(sigmoid) => sigmoid.at(nm),
            Spectrum::RgbLight { scale, color } => scale * color.at(nm) * d65_one_nit().at(nm),
            Spectrum::Table(table) | Spectrum::TableOfRgb { table, .. } => table.at(nm),
        }
    }

    /// The same of light: where a path carries colours ([`SampledWavelengths::rgb`]), its linear sRGB in cd/m² of a radiance.
    #[inline]
    pub fn sample_light(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match self {
            Spectrum::Table(table) if wavelengths.is_rgb() => SampledWavelengths::lanes(table.srgb_of_light()),
            Spectrum::Constant(value) if wavelengths.is_rgb() => {
                static OF_ONE: OnceLock<Vec3> = OnceLock::new();
                SampledWavelengths::lanes(*OF_ONE.get_or_init(|| srgb_of_light(|_| 1.0)) * *value)
            }
            _ => self.sample(wavelengths),
        }
    }

    /// Values at the four wavelengths of a path.
    #[inline]
    pub fn sample(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match self {
            Spectrum::Constant(value) => SampledSpectrum::splat(*value),
            Spectrum::Sigmoid(sigmoid) => sigmoid.sample(wavelengths),
            Spectrum::RgbLight { scale, color } => color.sample(wavelengths) * (wavelengths.d65_one_nit() * *scale),
            Spectrum::TableOfRgb { rgb, .. } if wavelengths.is_rgb() => SampledWavelengths::lanes(*rgb),
            Spectrum::Table(table) | Spectrum::TableOfRgb { table, .. } => {
                let nm = wavelengths.nm;
                SampledSpectrum::new(table.at(nm.x), table.at(nm.y), table.at(nm.z), table.at(nm.w))
            }
        }
    }
}

/// Spectral radiance of a black body, W·m⁻²·sr⁻¹·nm⁻¹, at a wavelength `nm` and a temperature `kelvin`, both above 0.
///
/// L = 2hc²/λ⁵ · 1/(exp(hc/λkT) − 1). Source: Planck's law.
pub fn blackbody(nm: f32, kelvin: f32) -> f32 {
    let lambda = nm as f64 * 1e-9;
    let x = PLANCK * SPEED_OF_LIGHT / (lambda * BOLTZMANN * kelvin as f64);
    (2.0 * PLANCK * SPEED_OF_LIGHT * SPEED_OF_LIGHT / lambda.powi(5) / x.exp_m1() * 1e-9) as f32
}

/// Spectral radiance of a black body of `kelvin` (> 0), scaled to a luminance of `nits` (cd/m²), 380–780 nm at 5 nm.
pub fn blackbody_with_luminance(kelvin: f32, nits: f32) -> Spectrum {
    let table = Table::new(380.0, 5.0, (0..=80).map(|i| blackbody(380.0 + 5.0 * i as f32, kelvin)).collect());
    let own = luminance(|nm| table.at(nm)) as f32;
    Spectrum::Table(table.scaled(nits / own))
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
        assert_eq!(spectrum.sample(&SampledWavelengths::rgb()), SampledSpectrum::new(0.2, 0.9, 4.5, 0.9));
        assert_eq!(
            spectrum.sample(&SampledWavelengths::fixed([400.0, 450.0, 500.0, 600.0])),
            SampledSpectrum::new(1.0, 2.0, 3.0, 3.0)
        );
        assert_eq!(spectrum.at(450.0), 2.0);
    }

    #[test]
    fn tables_that_lack_values_or_a_step_are_defined_everywhere() {
        for empty in [Table::new(400.0, 5.0, vec![]), Table::from_points(&[])] {
            assert_eq!([300.0, 550.0, 900.0].map(|nm| empty.at(nm)), [0.0; 3]);
        }
        for step_nm in [0.0, -5.0, f32::NAN] {
            let table = Table::new(400.0, step_nm, vec![2.0, 3.0]);
            assert_eq!([300.0, 550.0, 900.0].map(|nm| table.at(nm)), [2.0; 3], "{step_nm}");
        }
    }

    #[test]
    fn table_is_linear_inside_and_constant_outside() {
        let table = Table::new(400.0, 100.0, vec![1.0, 3.0]);
        assert_eq!([300.0, 400.0, 450.0, 500.0, 900.0].map(|nm| table.at(nm)), [1.0, 1.0, 2.0, 3.0, 3.0]);
    }
}

//! Thin films: colours of soap bubbles, oil and oxide by interference.
//!
//! Airy's sum for one layer between air and a base, exact for both polarisations at each wavelength of a path, so that no colour matching is
//! built into it; bases are taken for real indices. Source: M. Born, E. Wolf, "Principles of Optics", §7.6; parameters from
//! KHR_materials_iridescence (whose own formula, of L. Belcour and P. Barla 2017, stands for the same sum in three colours).

use super::energy::{Interface, mirror_albedo_at};
use super::inputs::inputs_struct;
use super::microfacet::{Ggx, cosine_of};
use super::polarization::{self, InPlane};
use crate::exact::exact_struct;
use crate::shape::Surface;
use crate::texture::Scalar;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use std::f32::consts::PI;

/// A film over a surface.
#[derive(Clone, Debug)]
pub struct Film {
    /// Fraction of the surface that has it.
    pub fraction: Scalar,
    /// Its index of refraction.
    pub ior: f32,
    /// Thickness where `thickness` is 0 and 1, nm.
    pub between_nm: [f32; 2],
    /// Where between the two.
    pub thickness: Scalar,
}

exact_struct!(Film { fraction, ior, between_nm, thickness });
inputs_struct!(Film { fraction, thickness } without { ior, between_nm });

impl Film {
    pub(super) fn at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> Option<FilmLayer> {
        let fraction = self.fraction.at(surface).clamp(0.0, 1.0);
        let [thin, thick] = self.between_nm;
        let thickness = (thin + (thick - thin) * self.thickness.at(surface)).clamp(0.0, THICKEST_NM);
        let blur = if wavelengths.is_rgb() { BAND_NM } else { 0.0 };
        (fraction > 0.0).then(|| FilmLayer { fraction, ior: self.ior.clamp(1.0, 10.0), thickness, nm: wavelengths.nm, blur })
    }
}

/// A film of this thickness, nm, has no colours left.
pub(crate) const THICKEST_NM: f32 = 1e6;

/// Standard deviation of what a colour of an RGB path sees of the spectrum, nm.
const BAND_NM: f32 = 35.0;

/// A film at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct FilmLayer {
    pub(super) fraction: f32,
    ior: f32,
    thickness: f32,
    nm: SampledSpectrum,
    blur: f32,
}

impl FilmLayer {
    /// Reflectance at a cosine outside, over a base of indices.
    pub(super) fn reflectance(&self, cos: f32, base: SampledSpectrum) -> SampledSpectrum {
        let cos = cos.abs().min(1.0);
        let sin2 = 1.0 - cos * cos;
        let n = self.ior;
        let within = (1.0 - sin2 / (n * n)).max(0.0).sqrt();
        let one = |nm: f32, below: f32| {
            let beyond = (1.0 - sin2 / (below * below)).max(0.0).sqrt();
            let phase = 4.0 * PI * n * self.thickness * within / nm;
            // Over a band of wavelengths fringes fade.
            let fade = if self.blur > 0.0 { (-0.5 * (phase * self.blur / nm).powi(2)).exp() } else { 1.0 };
            let turn = fade * phase.cos();
            let airy = |upper: f32, lower: f32| {
                let (u2, l2, both) = (upper * upper, lower * lower, 2.0 * upper * lower * turn);
                (u2 + l2 + both) / (1.0 + u2 * l2 + both)
            };
            let ratio = |a: f32, b: f32| if a + b > 0.0 { (a - b) / (a + b) } else { -1.0 };
            let s = airy(ratio(cos, n * within), ratio(n * within, below * beyond));
            let p = airy(ratio(n * cos, within), ratio(below * within, n * beyond));
            (0.5 * (s + p)).clamp(0.0, 1.0)
        };
        SampledSpectrum::new(one(self.nm.x, base.x), one(self.nm.y, base.y), one(self.nm.z, base.z), one(self.nm.w, base.w))
    }

    /// What it reflects and transmits of each component, in one plane of incidence; fringes of RGB paths do not fade here.
    pub(super) fn in_plane(&self, cos: f32, base: SampledSpectrum) -> [InPlane; 2] {
        let within = (1.0 - (1.0 - cos * cos) / (self.ior * self.ior)).max(0.0).sqrt();
        let phase = SampledSpectrum::splat(4.0 * PI * self.ior * self.thickness * within) / self.nm;
        polarization::film(cos, self.ior, base, phase)
    }

    /// Mean under light from everywhere, of what a surface of facets sends on at once; `interface` is that of the bare base, of index `ior`.
    pub(super) fn average(&self, base: SampledSpectrum, interface: &Interface, ior: f32, facets: Ggx) -> SampledSpectrum {
        let at = |mu: f32| match facets.is_smooth() {
            true => self.reflectance(mu, base),
            false => {
                let (even, w) = (Ggx::even(facets.roughness().powi(2)), Vec3::new((1.0 - mu * mu).sqrt(), 0.0, mu));
                let mirror_albedo_at = mirror_albedo_at(even, w);
                let cos = cosine_of(interface.reflected(even, w) / mirror_albedo_at, ior);
                self.reflectance(cos, base) * mirror_albedo_at
            }
        };
        GAUSS.into_iter().map(|(mu, weight)| at(mu) * (2.0 * mu * weight)).sum()
    }
}

/// Index of a base by its reflectance at normal incidence.
pub(super) fn index_of(f0: SampledSpectrum) -> SampledSpectrum {
    let root = f0.clamp(SampledSpectrum::ZERO, SampledSpectrum::splat(0.9999)).to_array().map(f32::sqrt);
    SampledSpectrum::from_array(root.map(|r| (1.0 + r) / (1.0 - r)))
}

/// Points and weights of Gauss and Legendre over 0 to 1.
const GAUSS: [(f32, f32); 6] = [
    (0.033_765_243, 0.085_662_246),
    (0.169_395_31, 0.180_380_787),
    (0.380_690_407, 0.233_956_967),
    (0.619_309_593, 0.233_956_967),
    (0.830_604_69, 0.180_380_787),
    (0.966_234_757, 0.085_662_246),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::microfacet::fresnel_dielectric;

    fn film(ior: f32, thickness: f32, nm: f32) -> FilmLayer {
        FilmLayer { fraction: 1.0, ior, thickness, nm: SampledSpectrum::splat(nm), blur: 0.0 }
    }

    #[test]
    fn a_quarter_wave_is_the_textbook_coating() {
        // Magnesium fluoride on crown glass: ((n² − nₛ)/(n² + nₛ))² = 1.26 % (Hecht, "Optics", §9.7).
        let quarter = film(1.38, 550.0 / 4.0 / 1.38, 550.0);
        let r = quarter.reflectance(1.0, SampledSpectrum::splat(1.52)).x;
        let expected = ((1.38f32 * 1.38 - 1.52) / (1.38 * 1.38 + 1.52)).powi(2);
        assert!((r - expected).abs() < 1e-6 && (r - 0.0126).abs() < 1e-4, "{r}");
        // A half wave changes nothing, nor does a film that is not there; at any angle.
        for cos in [1.0, 0.6, 0.2, 0.01f32] {
            let bare = fresnel_dielectric(cos, 1.52);
            let within = (1.0 - (1.0 - cos * cos) / (1.38f32 * 1.38)).sqrt();
            for d in [0.0, 550.0 / 2.0 / 1.38 / within] {
                let r = film(1.38, d, 550.0).reflectance(cos, SampledSpectrum::splat(1.52)).x;
                assert!((r - bare).abs() < 2e-5, "{cos} {d}: {r} {bare}");
            }
        }
    }

    #[test]
    fn a_black_film_reflects_nothing_and_a_soap_film_four_times_one_face() {
        // Between air on both sides: no thickness, no light; a quarter wave gives 4 R / (1 + R)².
        let soap = |d: f32| film(1.33, d, 500.0).reflectance(1.0, SampledSpectrum::ONE).x;
        let r = ((1.33f32 - 1.0) / 2.33).powi(2);
        assert!(soap(0.0) < 1e-6);
        assert!((soap(500.0 / 4.0 / 1.33) - 4.0 * r / (1.0 + r).powi(2)).abs() < 1e-5);
    }

    #[test]
    fn indices_and_averages() {
        let n = index_of(SampledSpectrum::splat(0.04));
        assert!((n.x - 1.5).abs() < 1e-5);
        // No film: the mean Fresnel reflectance of n = 1.5 (Judd 1942).
        let mean = film(1.3, 0.0, 550.0).average(n, &Interface::of(1.5), 1.5, Ggx::even(0.0)).x;
        assert!((mean - 0.0918).abs() < 1e-3, "{mean}");
    }
}

//! What light goes through between surfaces: air, fog, coloured glass, milk, smoke. The same everywhere within its bounds, or different from place
//! to place where it has a [`Volume`].
//!
//! Source: M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering" 4th ed., §11.1–11.4 and 14.2.

mod albedo;
mod blend;
mod sparse;
pub(crate) mod tracking;
mod volume;

pub use albedo::Orders;
pub(crate) use blend::trilinear;
pub use sparse::{BLOCK, SparseGrid};
pub use volume::{Cloud, Field, Glow, Grid, Scalars, Tint, Volume, VolumePlace};

use crate::bvh::Bounds;
use diopter_light::random::Stream;
use diopter_light::upsample::Sigmoid;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths, Spectrum, sampling};
use glam::Vec3;
use std::f32::consts::{PI, TAU};
use tracking::Track;

/// A coefficient over wavelength, 1/m.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Coefficient {
    /// A number times a spectrum.
    Scaled(f32, Spectrum),
    /// −ln(colour) / distance: after the distance, white light has the colour (KHR_materials_volume).
    Tint {
        /// Colour at the distance.
        color: Sigmoid,
        /// Metres.
        distance_m: f32,
    },
}

impl Coefficient {
    /// Nothing at all.
    pub const NONE: Coefficient = Coefficient::Scaled(0.0, Spectrum::Constant(1.0));

    /// The same at all wavelengths, 1/m.
    pub fn grey(per_m: f32) -> Self {
        Coefficient::Scaled(per_m, Spectrum::Constant(1.0))
    }

    /// Linear sRGB without upper bound times a scale, 1/m: a scaled sigmoid (PBR 4ed §4.6.6).
    pub fn from_rgb(rgb: Vec3, scale: f32) -> Self {
        let most = 2.0 * rgb.max_element();
        match most > 0.0 {
            true => Coefficient::Scaled(scale * most, Spectrum::Sigmoid(Sigmoid::from_rgb(rgb / most))),
            false => Coefficient::NONE,
        }
    }

    /// 1/m at the wavelengths of a path.
    #[inline]
    pub fn sample(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match self {
            Coefficient::Scaled(scale, spectrum) => spectrum.sample(wavelengths) * *scale,
            Coefficient::Tint { color, distance_m } => {
                let c = color.sample(wavelengths).clamp(SampledSpectrum::splat(1e-6), SampledSpectrum::ONE);
                SampledSpectrum::from_array(c.to_array().map(f32::ln)) * (-1.0 / distance_m)
            }
        }
    }

    fn is_none(&self) -> bool {
        matches!(self, Coefficient::Scaled(0.0, _))
    }
}

/// A medium: homogeneous, or with a volume.
#[derive(Clone, Debug)]
pub struct Medium {
    /// For messages.
    pub name: String,
    /// σa: what is lost a metre.
    pub absorption: Coefficient,
    /// σs: what is thrown elsewhere a metre.
    pub scattering: Coefficient,
    /// Mean cosine of the angle of scattering: −1 backward, 0 even, 1 forward (Henyey & Greenstein 1941).
    pub asymmetry: f32,
    /// Radiance of an endless depth of it, W·m⁻²·sr⁻¹·nm⁻¹, where it shines by itself: σa times this is sent out a metre.
    pub emission: Option<Spectrum>,
    /// What differs from place to place: factors on the coefficients above. Without one it is the same everywhere.
    pub volume: Option<Box<Volume>>,
    /// Whether it is the inside of a body that looks as a surface does, such as wax or skin. Scattering events in it are not counted among those
    /// of a path, which would be cut off otherwise; and no lights are sampled from within, as its refracting surface hides them all.
    pub is_subsurface: bool,
}

impl Default for Medium {
    /// Nothing: without a name, without coefficients.
    fn default() -> Self {
        Medium {
            name: String::new(),
            absorption: Coefficient::NONE,
            scattering: Coefficient::NONE,
            asymmetry: 0.0,
            emission: None,
            volume: None,
            is_subsurface: false,
        }
    }
}

impl Medium {
    /// Whether it scatters, the same everywhere, and lights are sampled from within: photons are left in such media behind what throws caustics, and light is
    /// sought near lamps in them.
    pub(crate) fn scatters_homogeneously(&self) -> bool {
        self.volume.is_none() && !self.is_subsurface && !self.scattering.is_none()
    }

    /// Whether all it does is to absorb, the same everywhere.
    pub(crate) fn only_absorbs(&self) -> bool {
        self.volume.is_none() && self.emission.is_none() && self.scattering.is_none()
    }

    /// Whether it sends out light by itself.
    pub fn shines(&self) -> bool {
        self.emission.is_some() || self.volume.as_ref().is_some_and(|volume| volume.shines())
    }

    /// One that only absorbs: white light has the colour after the distance (m, > 0), by the law of Beer and Lambert.
    pub fn tint(color: Sigmoid, distance_m: f32) -> Self {
        Medium { absorption: Coefficient::Tint { color, distance_m }, ..Medium::default() }
    }

    /// Fog in which dark things are seen against the sky up to `visibility_m` (> 0) with a contrast of 2 %: σt = 3.912 / V (H. Koschmieder 1924).
    ///
    /// `albedo`: fraction (0 to 1) of what is met that is scattered. Droplets throw light forward: an `asymmetry` (mean cosine) of about 0.85 (D. Deirmendjian 1969).
    pub fn fog(visibility_m: f32, albedo: f32, asymmetry: f32) -> Self {
        let extinction = 3.912 / visibility_m;
        Medium {
            name: "fog".into(),
            absorption: Coefficient::grey(extinction * (1.0 - albedo)),
            scattering: Coefficient::grey(extinction * albedo),
            asymmetry,
            ..Medium::default()
        }
    }

    /// Fraction of light that is left along the part of a ray between two distances (m) at a moment of the scene, s; an estimate where the medium
    /// differs from place to place, which takes its numbers from a stream.
    #[inline]
    pub(crate) fn transmittance<'s>(
        &self,
        ray: &Ray,
        [near, far]: [f32; 2],
        wavelengths: &SampledWavelengths,
        time_s: f64,
        stream: impl FnOnce() -> &'s mut Stream,
    ) -> SampledSpectrum {
        match &self.volume {
            None => self.at(wavelengths).transmittance(far - near),
            Some(volume) => Track::new(self, volume, ray, [near, far], wavelengths, time_s).transmittance(stream(), None),
        }
    }

    /// Coefficients at the wavelengths of a path; of a volume, where its factors are 1.
    #[inline]
    pub(crate) fn at(&self, wavelengths: &SampledWavelengths) -> Sigma {
        let absorption = self.absorption.sample(wavelengths);
        let scattering = if self.scattering.is_none() { SampledSpectrum::ZERO } else { self.scattering.sample(wavelengths) };
        Sigma { absorption, scattering, extinction: absorption + scattering }
    }
}

/// Coefficients at the wavelengths of a path, 1/m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sigma {
    pub absorption: SampledSpectrum,
    pub scattering: SampledSpectrum,
    pub extinction: SampledSpectrum,
}

/// How a free flight through a medium ended; the weight is what it does to the light of the path.
pub(crate) enum DistanceSample {
    /// At the far end.
    Through(SampledSpectrum),
    /// In between, after so many metres.
    Scattered(f32, SampledSpectrum),
}

impl Sigma {
    /// Fraction of what is met that is scattered.
    #[inline]
    pub fn albedo(&self) -> SampledSpectrum {
        self.scattering / self.extinction.max(SampledSpectrum::splat(f32::MIN_POSITIVE))
    }

    /// Fraction of light that is left after a distance, m.
    #[inline]
    pub fn transmittance(&self, distance: f32) -> SampledSpectrum {
        if distance.is_infinite() {
            return SampledSpectrum::from_array(self.extinction.to_array().map(|s| if s > 0.0 { 0.0 } else { 1.0 }));
        }
        (self.extinction * -distance).exp()
    }

    /// ∫ e^(−σt s) ds over a distance, m.
    pub fn depth(&self, distance: f32) -> SampledSpectrum {
        let one = |s: f32| match s * distance {
            // What neither absorbs nor scatters does not shine either, however deep it is.
            _ if s <= 0.0 => 0.0,
            x if x < 1e-4 => distance,
            x => (1.0 - (-x).exp()) / s,
        };
        SampledSpectrum::from_array(self.extinction.to_array().map(one))
    }

    /// Density (1/m) with which [`Sigma::sample_distance`] draws a distance (m) for a path of a throughput.
    #[inline]
    pub fn density(&self, distance: f32, throughput: SampledSpectrum) -> f32 {
        (throughput / throughput.element_sum()).dot(self.extinction * self.transmittance(distance))
    }

    /// Samples a free-flight distance within a distance (m) by two numbers, for a path of a throughput.
    ///
    /// The distance is drawn for one of the wavelengths, each with a probability as its fraction of the throughput; the density is the mean over
    /// them (one-sample balance heuristic, Veach 1997; A. Wilkie et al. 2014).
    #[inline]
    pub fn sample_distance(&self, distance: f32, u: [f32; 2], throughput: SampledSpectrum) -> DistanceSample {
        let total = throughput.element_sum();
        if self.scattering == SampledSpectrum::ZERO || !(total > 0.0) {
            return DistanceSample::Through(self.transmittance(distance));
        }
        let fraction = (throughput / total).to_array();
        let mut lane = 0;
        let mut at = u[1];
        while lane < 3 && at >= fraction[lane] {
            at -= fraction[lane];
            lane += 1;
        }
        let fraction = SampledSpectrum::from_array(fraction);
        let drawn = -(1.0 - u[0]).ln() / self.extinction[lane];
        if drawn < distance {
            let left = self.transmittance(drawn);
            let density = fraction.dot(self.extinction * left);
            return DistanceSample::Scattered(drawn, self.scattering * left / density);
        }
        let left = self.transmittance(distance);
        DistanceSample::Through(left / fraction.dot(left))
    }
}

/// Henyey and Greenstein's phase function of the cosine between the directions before and after, 1/sr.
#[inline]
pub(crate) fn phase(cos: f32, g: f32) -> f32 {
    let d = (1.0 + g * g - 2.0 * g * cos).max(1e-12);
    (1.0 - g * g) / (4.0 * PI * d * d.sqrt())
}

/// A direction with the density of [`phase`] about another.
#[inline]
pub(crate) fn scattered(forward: Vec3, g: f32, u: [f32; 2]) -> (Vec3, f32) {
    let cos = if g.abs() < 1e-3 {
        1.0 - 2.0 * u[0]
    } else {
        let s = (1.0 - g * g) / (1.0 + g - 2.0 * g * u[0]);
        ((1.0 + g * g - s * s) / (2.0 * g)).clamp(-1.0, 1.0)
    };
    let (sin, phi) = ((1.0 - cos * cos).max(0.0).sqrt(), TAU * u[1]);
    let (x, y) = sampling::frame(forward);
    ((x * (sin * phi.cos()) + y * (sin * phi.sin()) + forward * cos).normalize(), phase(cos, g))
}

/// What fills the world where no body does.
#[derive(Clone, Debug)]
pub struct Air {
    /// The medium.
    pub medium: Medium,
    /// Where it is; everywhere without. Light from infinitely far away does not come through an endless medium.
    pub bounds: Option<Bounds>,
}

impl Air {
    /// The part of a ray, up to a distance, that lies in it.
    pub(crate) fn span(&self, ray: &Ray, reach: f32) -> Option<[f32; 2]> {
        let Some(b) = &self.bounds else { return Some([0.0, reach]) };
        let (mut near, mut far) = (0.0f32, reach);
        for k in 0..3 {
            let (o, d) = (ray.origin[k], ray.direction[k]);
            if d == 0.0 {
                if !(b.min[k]..=b.max[k]).contains(&o) {
                    return None;
                }
                continue;
            }
            let (a, z) = ((b.min[k] - o) / d, (b.max[k] - o) / d);
            (near, far) = (near.max(a.min(z)), far.min(a.max(z)));
        }
        (near < far).then_some([near, far])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];

    fn uniform(i: u32, k: u32) -> f32 {
        to_unit(mix(i * 7 + k))
    }

    #[test]
    fn phase_functions_are_densities_with_their_mean_cosine() {
        for g in [-0.6, 0.0, 0.3, 0.85] {
            let n = 200_000;
            let integral: f32 = (0..2000).map(|i| phase(-1.0 + (i as f32 + 0.5) / 1000.0, g) * TAU / 1000.0).sum();
            assert!((integral - 1.0).abs() < 2e-3, "{g}: {integral}");
            let forward = Vec3::new(1.0, 2.0, -0.5).normalize();
            let mut sum = 0.0;
            for i in 0..n {
                let (d, pdf) = scattered(forward, g, [uniform(i, 1), uniform(i, 2)]);
                let cos = d.dot(forward);
                assert!((pdf / phase(cos, g) - 1.0).abs() < 0.01);
                sum += cos as f64;
            }
            assert!((sum / n as f64 - g as f64).abs() < 4e-3, "{g}: {}", sum / n as f64);
        }
    }

    #[test]
    fn flights_lose_and_scatter_what_the_coefficients_say_at_every_wavelength() {
        let table = diopter_light::spectrum::Table::from_points(&[(400.0, 3.0), (700.0, 0.3)]);
        let medium = Medium {
            scattering: Coefficient::Scaled(1.0, Spectrum::Table(table)),
            absorption: Coefficient::grey(0.2),
            ..Medium::fog(1.0, 0.5, 0.0)
        };
        let wavelengths = SampledWavelengths::fixed(NM);
        let sigma = medium.at(&wavelengths);
        let (mut through, mut scattered) = ([0.0f64; 4], [0.0f64; 4]);
        let n = 200_000;
        for i in 0..n {
            let distance_sample =
                sigma.sample_distance(0.8, [uniform(i, 1), uniform(i, 2)], SampledSpectrum::new(1.0, 0.5, 2.0, 0.3));
            let (sum, weight) = match distance_sample {
                DistanceSample::Through(w) => (&mut through, w),
                DistanceSample::Scattered(t, w) => {
                    assert!((0.0..0.8).contains(&t));
                    (&mut scattered, w)
                }
            };
            (0..4).for_each(|k| sum[k] += weight[k] as f64 / n as f64);
        }
        for k in 0..4 {
            let s = medium.scattering.sample(&wavelengths)[k] as f64;
            let t = s + 0.2;
            let left = (-t * 0.8).exp();
            assert!((through[k] - left).abs() < 0.01, "{k}: {} {left}", through[k]);
            assert!((scattered[k] - s / t * (1.0 - left)).abs() < 0.01, "{k}: {}", scattered[k]);
        }
    }

    #[test]
    fn depths_are_integrals_even_where_nothing_is_met() {
        let sigma =
            |v: f32| Medium { absorption: Coefficient::grey(v), ..Medium::fog(1.0, 0.0, 0.0) }.at(&SampledWavelengths::fixed(NM));
        for (s, distance, expected) in
            [(0.5f32, 2.0f32, 2.0 * (1.0 - (-1.0f32).exp())), (0.5, f32::INFINITY, 2.0), (0.0, f32::INFINITY, 0.0)]
        {
            let depth = sigma(s).depth(distance);
            assert!((depth.x - expected).abs() < 1e-5, "{s} {distance}: {depth}");
        }
    }

    #[test]
    fn air_in_a_box_is_only_there() {
        let air = Air { medium: Medium::fog(10.0, 1.0, 0.0), bounds: Some(Bounds { min: Vec3::ZERO, max: Vec3::ONE }) };
        let ray = |origin: Vec3, direction: Vec3| Ray { origin, direction, time_s: 0.0 };
        assert_eq!(air.span(&ray(Vec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z), f32::INFINITY), Some([2.0, 3.0]));
        assert_eq!(air.span(&ray(Vec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z), 2.5), Some([2.0, 2.5]));
        assert_eq!(air.span(&ray(Vec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z), 1.5), None);
        assert_eq!(air.span(&ray(Vec3::new(0.5, 1.5, 3.0), Vec3::NEG_Z), 9.0), None);
        assert_eq!(air.span(&ray(Vec3::splat(0.5), Vec3::X), f32::INFINITY), Some([0.0, 0.5]));
    }
}

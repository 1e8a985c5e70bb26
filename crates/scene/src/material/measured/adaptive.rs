//! Tables in the adaptive parameterization.
//!
//! For each measured direction of view ω (θ, φ) a warp takes the unit square to half vectors in proportion to the normals that are visible from there
//! (`vndf`); on its square another (`luminance`) leads to where the reflected light is. A table over the same square holds what is left, so that
//! f cos θᵢ = S(s) D(h) / (4 σ(ω)), with D the density of normals (`ndf`), σ the projected area of the facets (`sigma`), and s the place that the
//! first warp takes to h. Its density in solid angle is vndf(h) luminance(s) / (2π² u sin θₕ · 4 ω·h). Angles go to the square by u = √(2θ/π), v = (φ + π) / 2π;
//! of isotropic surfaces φ counts from ω.
//!
//! Source: J. Dupuy & W. Jakob 2018, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering" (ACM TOG 37(6)); use of the fields as
//! by Mitsuba 3 (`measured`) and PBR 4ed §9.8. Spectra are linear between the measured wavelengths; RGB lanes get their integrals under D65, which are linear in
//! them, and so is their interpolation.

use super::warp::{Blend, Grid, Warp, cell, interval};
use super::{LocalScatter, brdf_of_rgb, direction, elevation, place_of, solid_angle, theta_at, turns_of};
use crate::exact::{exact_enum, exact_struct};
use crate::material::microfacet::reflect;
use diopter_light::color::srgb_of_light;
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// What the bands of a table are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Bands {
    /// Wavelengths in nm, rising.
    Nanometers(Vec<f32>),
    /// Linear sRGB.
    Rgb,
}

impl Bands {
    fn count(&self) -> usize {
        match self {
            Bands::Nanometers(nm) => nm.len(),
            Bands::Rgb => 3,
        }
    }
}

/// Under which turns about the normal, or mirrorings, a surface stays the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Symmetry {
    /// Any turn.
    Isotropic,
    /// None: φ is measured all the way round.
    None,
    /// Half a turn: φ is measured from −π to 0.
    HalfTurn,
    /// Mirrored in x and in y: φ is measured from −π to −π/2.
    Mirrored,
}

/// The fields of a file, held against each other by its reader.
pub(crate) struct Fields {
    /// Measured directions, rad, rising.
    pub phi_i: Vec<f32>,
    pub theta_i: Vec<f32>,
    pub symmetry: Symmetry,
    pub ndf: Grid,
    pub sigma: Grid,
    /// Grids `[phi][theta]`.
    pub vndf: Grid,
    pub luminance: Grid,
    pub bands: Bands,
    /// `[phi][theta][band]` grids of the size of `luminance`.
    pub samples: Vec<f32>,
    /// Whether D / 4σ was divided out of the samples.
    pub is_divided: bool,
}

/// A table ready for rays.
#[derive(Clone, Debug)]
pub(crate) struct Adaptive {
    phi_i: Vec<f32>,
    theta_i: Vec<f32>,
    symmetry: Symmetry,
    ndf: Grid,
    sigma: Grid,
    vndf: Warp,
    luminance: Warp,
    bands: Bands,
    size: [usize; 2],
    /// Numbers at each node: its bands, of spectra red, green and blue after them, and one that is never used.
    stride: usize,
    /// `[phi][theta][row][column][number]`: the bands that a path asks for lie side by side.
    samples: Vec<f32>,
    is_divided: bool,
}

/// Red, green and blue of a spectrum under D65 as a sum over its values at wavelengths: weights of each.
fn rgb_weights(nm: &[f32]) -> Vec<Vec3> {
    let d65 = diopter_light::cie::d65_one_nit();
    let hat = |k: usize, at: f32| {
        let (i, t) = interval(nm, at);
        if i == k {
            1.0 - t
        } else if i + 1 == k {
            t
        } else {
            0.0
        }
    };
    (0..nm.len()).map(|k| srgb_of_light(|at| hat(k, at) * d65.at(at))).collect()
}

exact_enum!(Bands { Nanometers(nm), Rgb });
exact_enum!(Symmetry { Isotropic, None, HalfTurn, Mirrored });
exact_struct!(Adaptive { phi_i, theta_i, symmetry, ndf, sigma, vndf, luminance, bands, size, stride, samples, is_divided });

impl Adaptive {
    pub(super) fn numbers(&self) -> usize {
        self.samples.len() + self.vndf.numbers() + self.luminance.numbers()
    }

    /// Whether its lists fit each other, so that rays find what they look for.
    pub(super) fn is_whole(&self) -> bool {
        let rises = |v: &[f32]| !v.is_empty() && v.iter().all(|x| x.is_finite()) && v.windows(2).all(|w| w[0] < w[1]);
        let slices = self.phi_i.len() * self.theta_i.len();
        let (extra, bands_rise) = match &self.bands {
            Bands::Nanometers(nm) => (4, rises(nm)),
            Bands::Rgb => (1, true),
        };
        let count =
            self.size[0].checked_mul(self.size[1]).and_then(|n| n.checked_mul(self.stride)).and_then(|n| n.checked_mul(slices));
        rises(&self.phi_i)
            && rises(&self.theta_i)
            && bands_rise
            && self.ndf.holds(1)
            && self.sigma.holds(1)
            && self.vndf.holds(slices)
            && self.luminance.holds(slices)
            && self.luminance.size() == self.size
            && self.stride == self.bands.count() + extra
            && count == Some(self.samples.len())
            && self.samples.iter().all(|v| v.is_finite())
    }

    /// Prepares the fields of a measured material for evaluation and sampling.
    pub fn new(fields: Fields) -> Self {
        let Fields { phi_i, theta_i, symmetry, ndf, sigma, vndf, luminance, bands, samples, is_divided } = fields;
        let size = luminance.size;
        let (nodes, all) = (size[0] * size[1], bands.count());
        // Wavelengths that no path carries are left out.
        let used = match &bands {
            Bands::Nanometers(nm) => interval(nm, FIRST_NM).0..(interval(nm, LAST_NM).0 + 2).min(nm.len()),
            Bands::Rgb => 0..3,
        };
        let (bands, weights) = match bands {
            Bands::Nanometers(nm) => {
                let nm = nm[used.clone()].to_vec();
                let weights = rgb_weights(&nm);
                (Bands::Nanometers(nm), weights)
            }
            Bands::Rgb => (Bands::Rgb, vec![]),
        };
        let stride = used.len() + if weights.is_empty() { 1 } else { 4 };
        let mut packed = vec![0.0f32; phi_i.len() * theta_i.len() * nodes * stride];
        for (slice, packed) in samples.chunks_exact(all * nodes).zip(packed.chunks_exact_mut(nodes * stride)) {
            for (node, numbers) in packed.chunks_exact_mut(stride).enumerate() {
                let mut rgb = Vec3::ZERO;
                for (k, band) in used.clone().enumerate() {
                    numbers[k] = slice[band * nodes + node];
                    rgb += weights.get(k).map_or(Vec3::ZERO, |w| *w * numbers[k]);
                }
                if !weights.is_empty() {
                    numbers[used.len()..][..3].copy_from_slice(&rgb.to_array());
                }
            }
        }
        let (vndf, luminance) = (Warp::new(vndf), Warp::new(luminance));
        Adaptive { phi_i, theta_i, symmetry, ndf, sigma, vndf, luminance, bands, size, stride, samples: packed, is_divided }
    }

    pub(super) fn is_isotropic(&self) -> bool {
        self.symmetry == Symmetry::Isotropic
    }

    /// Seen from a direction.
    pub(super) fn at(&self, wo: Vec3, wavelengths: &SampledWavelengths) -> AdaptiveLobe<'_> {
        // Turned or mirrored to where was measured.
        // A zero gets the sign that keeps atan2 at −π.
        let sign = |v: f32| if v.is_sign_positive() { -1.0 } else { 1.0 };
        let flip = match self.symmetry {
            Symmetry::Isotropic | Symmetry::None => Vec3::ONE,
            Symmetry::HalfTurn => {
                let both = sign(wo.y);
                Vec3::new(both, both, 1.0)
            }
            Symmetry::Mirrored => Vec3::new(sign(wo.x), sign(wo.y), 1.0),
        };
        let wo = wo * flip;
        let (theta, turns) = (elevation(wo), turns_of(wo));
        let sigma = self.sigma.at(place_of(theta, turns + 0.5), &Blend::ONE);
        let scale = if sigma > 0.0 { 0.25 / sigma } else { 0.0 };
        let blend = Blend::new(&self.phi_i, &self.theta_i, turns * TAU, theta);
        let zero = if self.is_isotropic() { turns } else { 0.0 };
        let (lanes, upsampled) = self.lanes(wavelengths);
        AdaptiveLobe { table: self, wo, flip, blend, zero, scale, lanes, upsampled }
    }

    /// Where the numbers at the wavelengths of a path are, and the wavelengths where RGB stands for them.
    fn lanes(&self, wavelengths: &SampledWavelengths) -> ([(u32, f32); 4], Option<SampledWavelengths>) {
        match &self.bands {
            Bands::Nanometers(nm) if !wavelengths.is_rgb() => {
                let lane = |at: f32| {
                    let (i, t) = interval(nm, at);
                    (i as u32, t)
                };
                (wavelengths.nm.to_array().map(lane), None)
            }
            bands => {
                let first = if let Bands::Nanometers(nm) = bands { nm.len() as u32 } else { 0 };
                let upsampled = (!wavelengths.is_rgb()).then_some(*wavelengths);
                ([0, 1, 2, 1].map(|c| (first + c, 0.0)), upsampled)
            }
        }
    }
}

/// A table seen from a direction.
#[derive(Clone)]
pub(super) struct AdaptiveLobe<'a> {
    table: &'a Adaptive,
    wo: Vec3,
    /// Takes directions to where was measured, and back.
    flip: Vec3,
    blend: Blend,
    /// Where half vectors' turns count from.
    zero: f32,
    /// 1 / 4σ.
    scale: f32,
    lanes: [(u32, f32); 4],
    upsampled: Option<SampledWavelengths>,
}

impl AdaptiveLobe<'_> {
    /// f cos θ of a direction at a place of the table's square and one of that of half vectors.
    fn value(&self, at: Vec2, half: Vec2, wi: Vec3) -> SampledSpectrum {
        let Adaptive { size, stride, samples, .. } = self.table;
        let ([column, row], p) = cell(*size, at);
        let mut sum = [0.0f32; 4];
        for (slice, weight) in self.blend.iter() {
            for (c, r, w) in
                [(0, 0, (1.0 - p.x) * (1.0 - p.y)), (1, 0, p.x * (1.0 - p.y)), (0, 1, (1.0 - p.x) * p.y), (1, 1, p.x * p.y)]
            {
                let node = &samples[((slice * size[1] + row + r) * size[0] + column + c) * stride..][..*stride];
                for (sum, (i, t)) in sum.iter_mut().zip(self.lanes) {
                    let i = i as usize;
                    *sum += weight * w * (node[i] + (node[i + 1] - node[i]) * t);
                }
            }
        }
        let scale = if self.table.is_divided { self.scale * self.table.ndf.at(half, &Blend::ONE).max(0.0) } else { 1.0 };
        let value = SampledSpectrum::from_array(sum).max(SampledSpectrum::ZERO) * scale;
        let value = match &self.upsampled {
            Some(wavelengths) => brdf_of_rgb(value.truncate() / wi.z, wavelengths) * wi.z,
            None => value,
        };
        if value.is_finite() { value } else { SampledSpectrum::ZERO }
    }

    pub(super) fn eval(&self, wi: Vec3) -> (SampledSpectrum, f32) {
        let wi = wi * self.flip;
        let Some(h) = (self.wo + wi).try_normalize() else { return (SampledSpectrum::ZERO, 0.0) };
        let half = place_of(elevation(h), turns_of(h) - self.zero + 0.5);
        let (at, visible) = self.table.vndf.invert(half, &self.blend);
        let pdf = visible * self.table.luminance.pdf(at, &self.blend) / self.spread(half, h);
        (self.value(at, half, wi), if pdf.is_finite() { pdf } else { 0.0 })
    }

    /// Solid angle of reflected directions over area of the square of half vectors.
    fn spread(&self, half: Vec2, h: Vec3) -> f32 {
        solid_angle(half.x, h.truncate().length()) * 4.0 * self.wo.dot(h)
    }

    pub(super) fn sample(&self, u: [f32; 4]) -> Option<LocalScatter> {
        // The order of the two numbers is that of Mitsuba and pbrt.
        let (at, bright) = self.table.luminance.sample(Vec2::new(u[1], u[0]), &self.blend);
        let (half, visible) = self.table.vndf.sample(at, &self.blend);
        let h = direction(theta_at(half.x), (half.y - 0.5 + self.zero) * TAU);
        let wi = reflect(self.wo, h);
        let pdf = visible * bright / self.spread(half, h);
        if wi.z <= 0.0 || !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let weight = self.value(at, half, wi) / pdf;
        weight.is_finite().then(|| LocalScatter { wi: wi * self.flip, weight, pdf, specular: false, disperses: false })
    }
}

//! MERL's tables: isotropic reflection in RGB by the half vector and the difference from it.
//!
//! Nodes are the middles of bins of θₕ (finer towards the normal: bin 90 √(2θₕ/π)), θ_d and φ_d from 0 to π, as reciprocity makes φ_d and φ_d + π the same;
//! between them values are linear, where MERL's own reader takes the nearest. Numbers times 1, 1.15 and 1.66 over 1500 are the BRDF in
//! red, green and blue. Bins below 0 were not measured and count nothing. Source: W. Matusik, H. Pfister, M. Brand, L. McMillan 2003, "A Data-Driven
//! Reflectance Model" (ACM TOG 22(3)); the layout is that of the database's BRDFRead.
//!
//! Directions are drawn by half vectors: for some angles of view the table itself, times cosine and solid angle, is tabulated over θₕ and φₕ; a tenth goes by the
//! cosine, for what lies between these angles.

use super::warp::{Blend, Grid, Warp};
use super::{LocalScatter, brdf_of_rgb, direction, elevation, place_of, solid_angle, theta_at, turns_of};
use crate::exact::exact_struct;
use crate::material::microfacet::reflect;
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::{SampledSpectrum, SampledWavelengths, sampling};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};

/// What the file's numbers are multiplied by: red, green, blue. Source: BRDFRead.
pub(crate) const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
/// Fraction of directions drawn by the cosine.
const COSINE: f32 = 0.1;
/// Angles of view for which densities are tabulated, and nodes of φₕ.
const VIEWS: usize = 24;
const TURNS: usize = 33;
/// Least place of θₕ at which densities are computed: 0.0014°.
const LEAST: f32 = 4e-3;
/// The last of these angles, rad: beyond it local frames do not look (a cosine of 0.01).
const LAST_VIEW: f32 = 1.56;

/// A table ready for rays.
#[derive(Clone, Debug)]
pub(crate) struct HalfDifference {
    /// Bins of θₕ, θ_d, φ_d.
    counts: [usize; 3],
    /// BRDF in linear RGB, 1/sr, `[θₕ][θ_d][φ_d]`; below 0 where nothing was measured.
    values: Vec<[f32; 3]>,
    views: Vec<f32>,
    halves: Warp,
}

exact_struct!(HalfDifference { counts, values, views, halves });

impl HalfDifference {
    pub(super) fn numbers(&self) -> usize {
        3 * self.values.len() + self.halves.numbers()
    }

    /// Whether its lists fit each other, so that rays find what they look for.
    pub(super) fn is_whole(&self) -> bool {
        let count = self.counts.iter().try_fold(1usize, |all, n| all.checked_mul(*n));
        let views = self.views.iter().all(|v| v.is_finite()) && self.views.windows(2).all(|w| w[0] < w[1]);
        !self.counts.contains(&0)
            && count == Some(self.values.len())
            && self.values.as_flattened().iter().all(|v| v.is_finite())
            && !self.views.is_empty()
            && views
            && self.halves.holds(self.views.len())
    }

    /// `values` are 1/sr, as many as the product of `counts` (each at least 1), below 0 where nothing was measured.
    pub fn new(counts: [usize; 3], values: Vec<[f32; 3]>) -> Self {
        let views: Vec<f32> = (0..VIEWS).map(|k| LAST_VIEW * k as f32 / (VIEWS - 1) as f32).collect();
        let size = [counts[0] + 1, TURNS];
        let halves = Warp::new(Grid { size: [2, 2], values: vec![1.0; 4] });
        let mut table = HalfDifference { counts, values, views, halves };
        let mut densities = Vec::with_capacity(VIEWS * size[0] * size[1]);
        for theta in &table.views {
            let wo = direction(*theta, 0.0);
            for row in 0..TURNS {
                for column in 0..size[0] {
                    let u = column as f32 / counts[0] as f32;
                    let h = direction(theta_at(u), row as f32 / (TURNS - 1) as f32 * TAU);
                    let (wi, cos) = (reflect(wo, h), wo.dot(h));
                    let light = if wi.z > 0.0 && cos > 0.0 { table.rgb(wo, wi).dot(SRGB_LUMINANCE) * wi.z * cos } else { 0.0 };
                    densities.push(light * u * h.truncate().length());
                }
            }
        }
        table.halves = Warp::new(Grid { size, values: densities });
        table
    }

    /// The BRDF, 1/sr, linear RGB; both directions above the surface.
    fn rgb(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        let Some(h) = (wo + wi).try_normalize() else { return Vec3::ZERO };
        // Axes at the half vector: along growing θ, along growing φ.
        let side = Vec3::new(-h.y, h.x, 0.0).try_normalize().unwrap_or(Vec3::Y);
        let along = side.cross(h);
        let theta_d = 2.0 * (0.5 * (wi - h).length()).clamp(0.0, 1.0).asin();
        let phi_d = wi.dot(side).atan2(wi.dot(along));
        let [nh, nd, np] = self.counts;
        let open = |x: f32, n: usize| {
            let x = (x * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            let i = (x as u32 as usize).min(n - 1);
            [(i, 1.0 - (x - i as f32)), ((i + 1).min(n - 1), x - i as f32)]
        };
        let round = (phi_d / PI).rem_euclid(1.0) * np as f32 - 0.5;
        let i = round.floor();
        let first = (i as i32).rem_euclid(np as i32) as usize;
        let phi = [(first, 1.0 - (round - i)), ((first + 1) % np, round - i)];
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for (a, wa) in open((elevation(h) / FRAC_PI_2).sqrt(), nh) {
            for (b, wb) in open(theta_d / FRAC_PI_2, nd) {
                for (c, wc) in phi {
                    let value = Vec3::from_array(self.values[(a * nd + b) * np + c]);
                    let weight = wa * wb * wc;
                    if weight > 0.0 && value.min_element() >= 0.0 {
                        sum += value * weight;
                        weights += weight;
                    }
                }
            }
        }
        if weights > 0.0 { sum / weights } else { Vec3::ZERO }
    }

    /// Seen from a direction.
    pub(super) fn at(&self, wo: Vec3, wavelengths: &SampledWavelengths) -> HalfDifferenceLobe<'_> {
        let blend = Blend::new(&[0.0], &self.views, 0.0, elevation(wo));
        HalfDifferenceLobe { table: self, wo, zero: turns_of(wo), blend, wavelengths: *wavelengths }
    }
}

/// A table seen from a direction.
#[derive(Clone)]
pub(super) struct HalfDifferenceLobe<'a> {
    table: &'a HalfDifference,
    wo: Vec3,
    zero: f32,
    blend: Blend,
    wavelengths: SampledWavelengths,
}

impl HalfDifferenceLobe<'_> {
    fn value(&self, wi: Vec3) -> SampledSpectrum {
        let value = brdf_of_rgb(self.table.rgb(self.wo, wi), &self.wavelengths) * wi.z;
        if value.is_finite() { value } else { SampledSpectrum::ZERO }
    }

    /// Density of directions; `h` is the half vector.
    fn pdf(&self, wi: Vec3, h: Vec3) -> f32 {
        let half = place_of(elevation(h), turns_of(h) - self.zero);
        // Next to the normal, where both go to 0, their ratio is that at a place near by.
        let half = Vec2::new(half.x.max(LEAST), half.y);
        let spread = solid_angle(half.x, h.truncate().length()) * 4.0 * self.wo.dot(h);
        let by_half = self.table.halves.pdf(half, &self.blend) / spread;
        let by_half = if by_half.is_finite() { by_half } else { 0.0 };
        COSINE * wi.z * FRAC_1_PI + (1.0 - COSINE) * by_half
    }

    pub(super) fn eval(&self, wi: Vec3) -> (SampledSpectrum, f32) {
        let Some(h) = (self.wo + wi).try_normalize() else { return (SampledSpectrum::ZERO, 0.0) };
        (self.value(wi), self.pdf(wi, h))
    }

    pub(super) fn sample(&self, u: [f32; 4]) -> Option<LocalScatter> {
        let wi = if u[2] < COSINE {
            sampling::cosine_hemisphere([u[0], u[1]])
        } else {
            let (half, _) = self.table.halves.sample(Vec2::new(u[0], u[1]), &self.blend);
            let h = direction(theta_at(half.x), (half.y + self.zero) * TAU);
            if self.wo.dot(h) <= 0.0 {
                return None;
            }
            reflect(self.wo, h)
        };
        if wi.z <= 0.0 {
            return None;
        }
        let pdf = self.pdf(wi, (self.wo + wi).try_normalize()?);
        (pdf > 0.0).then(|| LocalScatter { wi, weight: self.value(wi) / pdf, pdf, specular: false, disperses: false })
    }
}

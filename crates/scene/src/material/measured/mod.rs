//! Surfaces as they were measured: tables of reflection over directions.
//!
//! `adaptive`: the format of J. Dupuy & W. Jakob 2018 (`.bsdf`), spectra or RGB, isotropic or not. `half_difference`: MERL's tables of
//! W. Matusik et al. 2003 (`.binary`), RGB, isotropic. Both are read by [`crate::load::read_measured`]. What was measured above a surface is shown on
//! both of its sides. Limits: reflection alone; a table holds one kind of surface, the same everywhere; energy is as measured, which near
//! grazing angles may be above 1.

pub(crate) mod adaptive;
pub(crate) mod half_difference;
pub(crate) mod warp;

use super::inputs::{Input, Inputs};
use super::local_scatter::LocalScatter;
use crate::exact::{exact_enum, exact_struct};
use adaptive::{Adaptive, AdaptiveLobe};
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::{Vec2, Vec3};
use half_difference::{HalfDifference, HalfDifferenceLobe};
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// A measured surface.
#[derive(Clone, Debug)]
pub struct Measured {
    table: Table,
    normal_reflectance: Vec3,
    alpha: f32,
}

/// The kinds of tables.
#[derive(Clone, Debug)]
pub(crate) enum Table {
    Adaptive(Box<Adaptive>),
    HalfDifference(Box<HalfDifference>),
}

exact_enum!(Table { Adaptive(table), HalfDifference(table) });
exact_struct!(Measured { table, normal_reflectance, alpha });

/// One that is not the same all round lies along the texture coordinates.
impl Inputs for Arc<Measured> {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        if !self.is_isotropic() {
            tell(Input::Other);
        }
    }
}

impl Measured {
    /// Bytes of its numbers.
    pub(crate) fn memory(&self) -> usize {
        4 * match &self.table {
            Table::Adaptive(table) => table.numbers(),
            Table::HalfDifference(table) => table.numbers(),
        }
    }

    /// Whether its lists fit each other.
    pub(crate) fn is_whole(&self) -> bool {
        let is_whole = match &self.table {
            Table::Adaptive(table) => table.is_whole(),
            Table::HalfDifference(table) => table.is_whole(),
        };
        is_whole && self.normal_reflectance.is_finite() && self.alpha.is_finite()
    }

    pub(crate) fn new(table: Table) -> Self {
        let (normal_reflectance, alpha) = survey(&table);
        Measured { table, normal_reflectance, alpha }
    }

    /// Reflectance of light that comes along the normal, linear sRGB under D65.
    pub fn normal_reflectance(&self) -> Vec3 {
        self.normal_reflectance
    }

    /// Width α of the GGX distribution that mirrors half of the light that comes along the normal within the same angle.
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// Whether turning the surface about its normal changes nothing.
    pub fn is_isotropic(&self) -> bool {
        match &self.table {
            Table::Adaptive(table) => table.is_isotropic(),
            Table::HalfDifference(_) => true,
        }
    }

    /// Seen from a direction of the local frame.
    pub(super) fn at(&self, wo: Vec3, wavelengths: &SampledWavelengths) -> MeasuredLobe<'_> {
        MeasuredLobe { kind: self.table.at(wo, wavelengths), alpha: self.alpha }
    }
}

impl Table {
    fn at(&self, wo: Vec3, wavelengths: &SampledWavelengths) -> Kind<'_> {
        match self {
            Table::Adaptive(table) => Kind::Adaptive(table.at(wo, wavelengths)),
            Table::HalfDifference(table) => Kind::HalfDifference(table.at(wo, wavelengths)),
        }
    }
}

/// What a table says of one direction of view.
#[derive(Clone)]
pub(super) struct MeasuredLobe<'a> {
    kind: Kind<'a>,
    alpha: f32,
}

#[derive(Clone)]
enum Kind<'a> {
    Adaptive(AdaptiveLobe<'a>),
    HalfDifference(HalfDifferenceLobe<'a>),
}

impl Kind<'_> {
    fn sample(&self, u: [f32; 4]) -> Option<LocalScatter> {
        match self {
            Kind::Adaptive(lobe) => lobe.sample(u),
            Kind::HalfDifference(lobe) => lobe.sample(u),
        }
    }
}

impl MeasuredLobe<'_> {
    /// Whether most of its light is spread at least as widely as by a GGX width.
    pub(super) fn is_wide(&self, least_alpha: f32) -> bool {
        self.alpha >= least_alpha
    }

    /// f cos θ and the density of [`MeasuredLobe::sample`].
    pub(super) fn eval(&self, wi: Vec3) -> (SampledSpectrum, f32) {
        if wi.z <= 0.0 {
            return (SampledSpectrum::ZERO, 0.0);
        }
        match &self.kind {
            Kind::Adaptive(lobe) => lobe.eval(wi),
            Kind::HalfDifference(lobe) => lobe.eval(wi),
        }
    }

    pub(super) fn sample(&self, u: [f32; 4]) -> Option<LocalScatter> {
        self.kind.sample(u)
    }
}

/// Reflectance along the normal, and the width of what it mirrors.
fn survey(table: &Table) -> (Vec3, f32) {
    // Points a side of the lattice.
    const SIDE: usize = 32;
    let lobe = table.at(Vec3::Z, &SampledWavelengths::rgb());
    let place = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    let (mut reflectance, mut angles) = (Vec3::ZERO, Vec::new());
    for i in 0..SIDE * SIDE {
        // The third number of a generator of its own: it chooses among lobes.
        let choice = diopter_light::random::to_unit(diopter_light::random::mix(i as u32));
        if let Some(s) = lobe.sample([place(i % SIDE), place(i / SIDE), choice, 0.0]) {
            reflectance += s.weight.truncate();
            angles.push((0.5 * elevation(s.wi), s.weight.truncate().dot(SRGB_LUMINANCE)));
        }
    }
    angles.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * angles.iter().map(|a| a.1).sum::<f32>();
    let mut sum = 0.0;
    let median = angles.iter().find(|a| {
        sum += a.1;
        sum >= half
    });
    // Of GGX tan²θ / (α² + tan²θ) lies within θ.
    (reflectance / (SIDE * SIDE) as f32, median.map_or(1.0, |m| m.0.tan()).clamp(0.0, 1.0))
}

/// Angle to the normal, rad, without the loss of digits of an arc cosine.
fn elevation(w: Vec3) -> f32 {
    2.0 * (0.5 * (w - Vec3::Z).length()).clamp(0.0, 1.0).asin()
}

/// Place of a half vector on the unit square: θ = u² π/2, which is fine about the normal, and φ, here from 0.
/// Source: Dupuy & Jakob 2018, §4.2.
fn place_of(theta: f32, turns: f32) -> Vec2 {
    Vec2::new((theta / FRAC_PI_2).sqrt(), turns - turns.floor())
}

/// The angle θ at a place.
fn theta_at(u: f32) -> f32 {
    u * u * FRAC_PI_2
}

/// Solid angle of half vectors over area of the square: 2π² u sin θ; at least the bound that Mitsuba and pbrt have.
fn solid_angle(u: f32, sin_theta: f32) -> f32 {
    (2.0 * PI * PI * u * sin_theta).max(1e-6)
}

/// A direction by its angles.
fn direction(theta: f32, phi: f32) -> Vec3 {
    let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
    Vec3::new(sin * cos_phi, sin * sin_phi, cos)
}

/// Whole turns of a direction about the normal.
fn turns_of(w: Vec3) -> f32 {
    w.y.atan2(w.x) / TAU
}

/// A BRDF given as linear sRGB at the wavelengths of a path: π f as reflectances are upsampled, and above 1 its colour times its size, so that a table of
/// a Lambertian surface is that surface.
fn brdf_of_rgb(rgb: Vec3, wavelengths: &SampledWavelengths) -> SampledSpectrum {
    if wavelengths.is_rgb() {
        return SampledWavelengths::lanes(rgb);
    }
    let reflectance = rgb * PI;
    let scale = reflectance.max_element().max(1.0);
    Sigmoid::from_rgb(reflectance / scale).sample(wavelengths) * (scale / PI)
}

//! Sheen of cloth: fibres that stand up and catch light at grazing angles.
//!
//! Source: A. Estevez, C. Kulla, "Production Friendly Microfacet Sheen BRDF" (SIGGRAPH 2017 course): distribution and fitted shadowing, as
//! KHR_materials_sheen asks for. What the sheen reflects the layers below go without, by the albedo in the direction of view or of light, whichever is larger.

use super::energy::{Table, computed};
use super::inputs::inputs_struct;
use crate::exact::exact_struct;
use crate::shape::Surface;
use crate::texture::{Color, Scalar};
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use std::f32::consts::TAU;
use std::sync::OnceLock;

/// Sheen over a surface.
#[derive(Clone, Debug)]
pub struct Sheen {
    /// What they reflect.
    pub color: Color,
    /// √α: small is velvet, seen at the rim only.
    pub roughness: Scalar,
}

exact_struct!(Sheen { color, roughness });
inputs_struct!(Sheen { color, roughness });

impl Sheen {
    pub(super) fn at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> Option<SheenLobe> {
        let most = self.color.linear_srgb(surface).max_element().clamp(0.0, 1.0);
        let roughness = self.roughness.at(surface).clamp(LEAST_ROUGHNESS, 1.0);
        (most > 0.0).then(|| SheenLobe { color: self.color.sample(surface, wavelengths), most, roughness })
    }
}

/// Below this the distribution is too narrow for single precision.
const LEAST_ROUGHNESS: f32 = 0.07;

/// Sheen at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct SheenLobe {
    color: SampledSpectrum,
    /// Largest of red, green and blue.
    most: f32,
    roughness: f32,
}

impl SheenLobe {
    /// f cos θ.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> SampledSpectrum {
        self.color * scattered(wo, wi, self.roughness)
    }

    /// Fraction of light from a direction that does not get below.
    pub(super) fn directional_albedo(&self, cos: f32) -> f32 {
        self.most * albedo().at(cos.abs(), self.roughness)
    }

    /// Fraction that gets below and back.
    pub(super) fn through(&self, wo: Vec3, wi: Vec3) -> f32 {
        1.0 - self.directional_albedo(wo.z).max(self.directional_albedo(wi.z)).min(1.0)
    }
}

/// f cos θ of white sheen.
fn scattered(wo: Vec3, wi: Vec3, roughness: f32) -> f32 {
    let (no, ni) = (wo.z, wi.z);
    let Some(h) = (wo + wi).try_normalize() else { return 0.0 };
    if no <= 0.0 || ni <= 0.0 {
        return 0.0;
    }
    let alpha = roughness * roughness;
    let inverse = 1.0 / alpha;
    let sin2 = (1.0 - h.z * h.z).max(0.0);
    let d = (2.0 + inverse) * sin2.powf(0.5 * inverse) / TAU;
    d / ((1.0 + lambda(no, alpha) + lambda(ni, alpha)) * 4.0 * no)
}

/// The fit of the source's table 1.
fn lambda(cos: f32, alpha: f32) -> f32 {
    let k = (1.0 - alpha) * (1.0 - alpha);
    let mix = |rough: f32, smooth: f32| rough * (1.0 - k) + smooth * k;
    let (a, b, c) = (mix(21.5473, 25.3245), mix(3.82987, 3.32435), mix(0.19823, 0.16801));
    let (d, e) = (mix(-1.97760, -1.27393), mix(-4.32054, -4.85967));
    let l = |x: f32| a / (1.0 + b * x.powf(c)) + d * x + e;
    if cos < 0.5 { l(cos).exp() } else { (2.0 * l(0.5) - l(1.0 - cos)).exp() }
}

/// Directional albedo of white sheen.
pub(super) fn albedo() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    computed(&TABLE, || {
        Table::new(|mu, r| {
            let wo = Vec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
            // Over the half circle of azimuths, by a lattice of Fibonacci's numbers.
            let (n, generator) = (2584usize, 1597);
            let sum: f32 = (0..n)
                .map(|k| {
                    let (u, v) = ((k as f32 + 0.5) / n as f32, ((k * generator % n) as f32 + 0.5) / n as f32);
                    let (z, phi) = (u, 0.5 * TAU * v);
                    let s = (1.0 - z * z).sqrt();
                    scattered(wo, Vec3::new(s * phi.cos(), s * phi.sin(), z), r.max(LEAST_ROUGHNESS))
                })
                .sum();
            (sum * TAU / n as f32).min(1.0)
        })
    })
}

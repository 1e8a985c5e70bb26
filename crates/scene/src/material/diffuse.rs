//! Lambertian reflection: f = albedo / π.

use super::local_scatter::LocalScatter;
use diopter_light::{SampledSpectrum, sampling};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

pub(super) fn eval(albedo: SampledSpectrum, wi: Vec3) -> (SampledSpectrum, f32) {
    let cos = wi.z.max(0.0);
    (albedo * (cos * FRAC_1_PI), cos * FRAC_1_PI)
}

pub(super) fn sample(albedo: SampledSpectrum, u: [f32; 4]) -> LocalScatter {
    let wi = sampling::cosine_hemisphere([u[0], u[1]]);
    LocalScatter { wi, weight: albedo, pdf: wi.z * FRAC_1_PI, specular: false, disperses: false }
}

/// Reflection and transmission: f cos θ and its density.
pub(super) fn eval_both(reflectance: SampledSpectrum, transmittance: SampledSpectrum, wi: Vec3) -> (SampledSpectrum, f32) {
    let back = reflected_fraction(reflectance, transmittance);
    let (albedo, fraction) = if wi.z > 0.0 { (reflectance, back) } else { (transmittance, 1.0 - back) };
    let cos = wi.z.abs() * FRAC_1_PI;
    (albedo * cos, fraction * cos)
}

/// Draws one of both sides.
pub(super) fn sample_both(reflectance: SampledSpectrum, transmittance: SampledSpectrum, u: [f32; 4]) -> Option<LocalScatter> {
    let back = reflected_fraction(reflectance, transmittance);
    let wi = sampling::cosine_hemisphere([u[0], u[1]]);
    let (wi, albedo, fraction) =
        if u[2] < back { (wi, reflectance, back) } else { (Vec3::new(wi.x, wi.y, -wi.z), transmittance, 1.0 - back) };
    let pdf = fraction * wi.z.abs() * FRAC_1_PI;
    (pdf > 0.0).then(|| LocalScatter { wi, weight: albedo / fraction, pdf, specular: false, disperses: false })
}

fn reflected_fraction(reflectance: SampledSpectrum, transmittance: SampledSpectrum) -> f32 {
    let (r, t) = (reflectance.element_sum(), transmittance.element_sum());
    if r + t > 0.0 { r / (r + t) } else { 0.5 }
}

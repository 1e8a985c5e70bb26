//! Lambertian reflection: f = albedo / π.

use super::bsdf::LocalScatter;
use diopter_light::{Sampled, sampling};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

pub(super) fn eval(albedo: Sampled, wi: Vec3) -> (Sampled, f32) {
    let cos = wi.z.max(0.0);
    (albedo * (cos * FRAC_1_PI), cos * FRAC_1_PI)
}

pub(super) fn sample(albedo: Sampled, u: [f32; 4]) -> LocalScatter {
    let wi = sampling::cosine_hemisphere([u[0], u[1]]);
    LocalScatter { wi, weight: albedo, pdf: wi.z * FRAC_1_PI, specular: false, disperses: false }
}

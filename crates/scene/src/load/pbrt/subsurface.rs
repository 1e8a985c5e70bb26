//! What is below the surface of pbrt's `subsurface` material: a dense medium, in which light walks at random until it gets out again.
//!
//! pbrt-v4 computes where light leaves by photon beam diffusion, as if each body were an endless half space. Here light is followed through the body as
//! it is, and thin parts are seen to be thin. Light comes in and out by refraction: lamps without extent light a body only if its surface is rough.

use super::Fault;
use super::context::Context;
use super::media::preset_named;
use super::medium_fields::coefficient;
use super::params::{Params, Values};
use super::spectra::{self, Use};
use crate::medium::{Coefficient, Medium, Orders};
use diopter_light::spectrum::Table;
use diopter_light::{SampledWavelengths, Spectrum};
use glam::Vec3;

/// Absorption and scattering of what is described by nothing else: milk, 1/mm. Source: pbrt-v4's file format.
const DEFAULT: [[f32; 3]; 2] = [[0.0011, 0.0024, 0.014], [2.55, 3.21, 3.77]];

/// The medium below a surface of an index of refraction, coefficients in 1/m. Fails where `scale`, `g`, a mean free path or a reflectance is out of range, one is a
/// texture, a name is not known, or parameters contradict or lack each other.
pub fn medium(context: &mut Context, p: &Params, eta: f32) -> Result<Medium, Fault> {
    let scale = p.float("scale", 1.0)? as f32;
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(p.place.fault(format!("a scale of {scale}"), "a number above 0"));
    }
    let asymmetry = p.float("g", 0.0)? as f32;
    if !(-0.9999..=0.9999).contains(&asymmetry) {
        return Err(p.place.fault(format!("g {asymmetry}"), "above -1 and below 1"));
    }
    for name in ["reflectance", "mfp", "sigma_a", "sigma_s"] {
        if let Some(textured) = p.get(name).filter(|param| param.kind == "texture") {
            return Err(textured.place.fault(format!("\"{name}\" by a texture"), "one value for the whole body"));
        }
    }
    let bare = Medium { name: "subsurface".into(), is_subsurface: true, ..Medium::default() };
    let rgb = |[absorption, scattering]: [[f32; 3]; 2]| {
        [absorption, scattering].map(|c| Coefficient::from_rgb(Vec3::from_array(c), scale))
    };
    let given = |name: &str| p.get(name).is_some();
    if let Some(name) = p.text("name")?.filter(|name| !name.is_empty()) {
        if asymmetry != 0.0 {
            context.warn(p.place, "g is not used with the name of a medium: its scattering is reduced to an even one");
        }
        let (scattering, absorption) = preset_named(name, p.place)?;
        let [absorption, scattering] = rgb([absorption, scattering]);
        return Ok(Medium { absorption, scattering, ..bare });
    }
    let by_coefficients = given("sigma_a") || given("sigma_s");
    if by_coefficients && (given("reflectance") || given("mfp")) {
        return Err(p.place.fault("sigma_a or sigma_s beside reflectance or mfp", "one pair of them"));
    }
    if by_coefficients {
        if let Some(missing) = ["sigma_a", "sigma_s"].into_iter().find(|name| !given(name)) {
            return Err(p.place.fault(format!("a subsurface material without {missing}"), "both sigma_a and sigma_s"));
        }
        let of = |name: &str| coefficient(context, p, name, scale);
        return Ok(Medium { absorption: of("sigma_a")?, scattering: of("sigma_s")?, asymmetry, ..bare });
    }
    if !given("reflectance") {
        if given("mfp") {
            return Err(p.place.fault("mfp without reflectance", "both"));
        }
        let [absorption, scattering] = rgb(DEFAULT);
        return Ok(Medium { absorption, scattering, asymmetry, ..bare });
    }
    by_reflectance(context, p, eta, scale, asymmetry, bare)
}

/// From the fraction of light that comes back and the mean free path.
fn by_reflectance(context: &Context, p: &Params, eta: f32, scale: f32, asymmetry: f32, bare: Medium) -> Result<Medium, Fault> {
    let reflectance = spectra::get(context, p, "reflectance", Use::Albedo, Spectrum::Constant(0.5))?;
    let path = spectra::get(context, p, "mfp", Use::Unbounded, Spectrum::Constant(1.0))?;
    if let Some(mfp) = p.get("mfp") {
        let values = (0..=80).map(|i| path.at(380.0 + 5.0 * i as f32));
        let bad_number = match &mfp.values {
            Values::Numbers(n) if mfp.kind == "rgb" => n.iter().find(|v| !(**v > 0.0)).map(|v| *v as f32),
            _ => None,
        };
        if let Some(v) = bad_number.or_else(|| values.into_iter().find(|v| !(*v > 0.0 && v.is_finite()))) {
            return Err(mfp.place.fault(format!("a mean free path of {v}"), "numbers above 0"));
        }
    }
    let orders = Orders::of(asymmetry, eta);
    // Absorption and scattering of a reflectance and a mean free path.
    let of = |reflectance: f32, path: f32| {
        let albedo = orders.albedo(f64::from(reflectance.clamp(0.0, 1.0)));
        let extinction = 1.0 / f64::from(path * scale);
        [(1.0 - albedo) * extinction, albedo * extinction].map(|v| v as f32)
    };
    let points: Vec<[f32; 2]> = (0..=80).map(|i| 380.0 + 5.0 * i as f32).map(|nm| of(reflectance.at(nm), path.at(nm))).collect();
    let [r, l] = [&reflectance, &path].map(|s| s.sample(&SampledWavelengths::rgb()));
    let colors = [of(r.x, l.x), of(r.y, l.y), of(r.z, l.z)];
    let [absorption, scattering] = [0, 1].map(|k: usize| {
        let table = Table::new(380.0, 5.0, points.iter().map(|v| v[k]).collect());
        let rgb = Vec3::from_array(colors.map(|c| c[k]));
        Coefficient::Scaled(1.0, Spectrum::TableOfRgb { table, rgb })
    });
    Ok(Medium { absorption, scattering, asymmetry, ..bare })
}

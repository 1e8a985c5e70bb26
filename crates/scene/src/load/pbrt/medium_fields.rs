//! What fills a medium: coefficients, fields, and light of black bodies.

use super::Fault;
use super::context::Context;
use super::params::{Params, Values};
use super::spectra::{self, Use};
use crate::bvh::Bounds;
use crate::medium::{Coefficient, Field, Glow, Medium, Scalars, Volume, VolumePlace};
use diopter_light::units::LUMINOUS_EFFICACY;
use glam::Vec3;

/// Radiance (W·m⁻²·sr⁻¹·nm⁻¹) that stands for pbrt's 1: where it is even, of 1 cd/m² (its sensor divides by the integral of ȳ, 106.857 nm).
const ONE_OF_PBRT: f32 = 1.0 / (106.856_895 * LUMINOUS_EFFICACY as f32);

/// A coefficient by the name of its parameter; 1 without.
pub(super) fn coefficient(context: &Context, p: &Params, name: &str, scale: f32) -> Result<Coefficient, Fault> {
    let Some(param) = p.get(name) else { return Ok(Coefficient::grey(scale)) };
    match (&param.values, param.kind.as_str()) {
        (Values::Numbers(n), "rgb") if n.len() == 3 && n.iter().all(|v| *v >= 0.0) => {
            Ok(Coefficient::from_rgb(Vec3::new(n[0] as f32, n[1] as f32, n[2] as f32), scale))
        }
        _ => {
            let spectrum = spectra::of(context, param, Use::Unbounded)?;
            match (0..=80).map(|i| spectrum.at(380.0 + 5.0 * i as f32)).find(|v| !(*v >= 0.0 && v.is_finite())) {
                Some(v) => Err(param.place.fault(format!("\"{name}\" of {v}"), "numbers of at least 0")),
                None => Ok(Coefficient::Scaled(scale, spectrum)),
            }
        }
    }
}

/// Where the medium is: the transform that holds, or its way from one to another.
pub(super) fn place(context: &Context, p: &Params) -> Result<VolumePlace, Fault> {
    context.volume_place(p.place)?.ok_or_else(|| {
        p.place.fault("a medium in a transform that cannot be inverted, or that turns inside out", "scales other than 0")
    })
}

/// What a temperature is shifted and multiplied by, and what the light is.
pub(super) fn black_body(p: &Params, temperature: Scalars) -> Result<Glow, Fault> {
    let peak_radiance = p.float("Lescale", 1.0)? as f32 * ONE_OF_PBRT;
    if !(peak_radiance >= 0.0 && peak_radiance.is_finite()) {
        return Err(p.place.fault("a negative Lescale", "a number of at least 0"));
    }
    // The name of older files is the other one.
    let cutoff = p.float("temperaturecutoff", 0.0)?;
    let offset = p.float("temperatureoffset", cutoff)? as f32;
    let factor = p.float("temperaturescale", 1.0)? as f32;
    Ok(Glow::BlackBody { temperature, offset, factor, peak_radiance })
}

/// A medium whose coefficients are factors on those of a field.
pub(super) fn filled(
    context: &Context,
    p: &Params,
    bare: Medium,
    scale: f32,
    bounds: Bounds,
    field: Field,
    glow: Option<Glow>,
) -> Result<Medium, Fault> {
    let volume = Volume::new(place(context, p)?, bounds, field, glow);
    Ok(Medium {
        absorption: coefficient(context, p, "sigma_a", scale)?,
        scattering: coefficient(context, p, "sigma_s", scale)?,
        volume: Some(Box::new(volume)),
        ..bare
    })
}

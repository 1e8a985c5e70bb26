//! Media by name.
//!
//! Those that differ from place to place lie in the transform that holds where they are named, which may be two, at two moments. Grids fade to
//! nothing over the outer half of their outermost cells, as in pbrt-v4.

use super::context::Context;
use super::medium_fields::{black_body, coefficient, filled, place};
use super::params::{Param, Params, Values};
use super::spectra::{self, Use};
use super::{Fault, Place};
use crate::bvh::Bounds;
use crate::medium::{Cloud, Coefficient, Field, Glow, Grid, Medium, Scalars, Tint, Volume};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use glam::Vec3;

/// Name, reduced scattering and absorption in red, green and blue, 1/mm. Source: H. W. Jensen et al. 2001, "A Practical Model for Subsurface Light
/// Transport", fig. 5.
const PRESETS: [(&str, [f32; 3], [f32; 3]); 12] = [
    ("Apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046]),
    ("Chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19]),
    ("Chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20]),
    ("Cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163]),
    ("Ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45]),
    ("Marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071]),
    ("Potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12]),
    ("Skimmilk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142]),
    ("Skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48]),
    ("Skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145]),
    ("Spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0]),
    ("Wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014]),
];

/// Most values of a grid: what is numbered by 31 bits.
const MOST_VALUES: usize = 1 << 31;

/// A `MakeNamedMedium`, coefficients in 1/m. Fails where its type is missing or not known, `g`, `scale` or a value of a grid is out of range, grids do not fit their
/// size, or its file cannot be read.
pub fn make(context: &mut Context, name: &str, p: &Params) -> Result<Medium, Fault> {
    let kind = match p.text("type")? {
        Some(kind @ ("homogeneous" | "uniformgrid" | "rgbgrid" | "cloud" | "nanovdb")) => kind,
        Some(other) => {
            let found = format!("medium \"{name}\" of type {other}");
            return Err(p.place.fault(found, "homogeneous, uniformgrid, rgbgrid, cloud or nanovdb"));
        }
        None => return Err(p.place.fault(format!("medium \"{name}\" without type"), "\"string type\" \"homogeneous\"")),
    };
    let scale = p.float("scale", 1.0)?;
    if !(scale >= 0.0 && scale.is_finite()) {
        return Err(p.place.fault(format!("a scale of {scale}"), "a number of at least 0"));
    }
    let asymmetry = p.float("g", 0.0)? as f32;
    if !(-0.9999..=0.9999).contains(&asymmetry) {
        return Err(p.place.fault(format!("g {asymmetry}"), "above -1 and below 1"));
    }
    let bare = Medium { name: name.to_owned(), asymmetry, ..Medium::default() };
    match kind {
        "homogeneous" => homogeneous(context, p, bare, scale as f32),
        "uniformgrid" => uniform_grid(context, p, bare, scale as f32),
        "rgbgrid" => rgb_grid(context, p, bare, scale as f32),
        "cloud" => cloud(context, p, bare, scale as f32),
        _ => super::nanovdb::make(context, p, bare, scale as f32),
    }
}

fn homogeneous(context: &Context, p: &Params, bare: Medium, scale: f32) -> Result<Medium, Fault> {
    let preset = match p.text("preset")? {
        None | Some("") => None,
        Some(preset) => Some(preset_named(preset, p.place)?),
    };
    let coefficient = |name: &str, preset: Option<[f32; 3]>| match preset {
        Some(rgb) => Ok(Coefficient::from_rgb(Vec3::from_array(rgb), scale)),
        None => coefficient(context, p, name, scale),
    };
    let emission = match p.get("Le") {
        None => None,
        Some(param) => {
            let factor = p.float("Lescale", 1.0)? as f32;
            Some(emission(context, param, factor)?)
        }
    };
    Ok(Medium {
        absorption: coefficient("sigma_a", preset.map(|p| p.1))?,
        scattering: coefficient("sigma_s", preset.map(|p| p.0))?,
        emission,
        ..bare
    })
}

/// Reduced scattering and absorption of a measured medium, 1/mm.
pub(super) fn preset_named(name: &str, place: Place) -> Result<([f32; 3], [f32; 3]), Fault> {
    let found = PRESETS.iter().find(|known| known.0 == name).map(|known| (known.1, known.2));
    found.ok_or_else(|| {
        let near = diopter_light::names::nearest(name, PRESETS.iter().map(|p| p.0));
        let known = PRESETS.map(|p| p.0).join(", ");
        place.fault(
            format!("preset \"{name}\""),
            near.map_or(format!("one of {known}"), |n| format!("one of {known} (did you mean {n}?)")),
        )
    })
}

fn emission(context: &Context, param: &Param, factor: f32) -> Result<Spectrum, Fault> {
    let le = spectra::of(context, param, Use::Light)?;
    Ok(Spectrum::Table(Table::new(380.0, 5.0, (0..=80).map(|i| le.at(380.0 + 5.0 * i as f32) * factor).collect())))
}

/// The box of a medium in its own space.
fn bounds(p: &Params) -> Result<Bounds, Fault> {
    let (a, b) = (p.vector("p0", Vec3::ZERO)?, p.vector("p1", Vec3::ONE)?);
    let bounds = Bounds { min: a.min(b), max: a.max(b) };
    match bounds.size().min_element() > 0.0 && bounds.size().is_finite() {
        true => Ok(bounds),
        false => Err(p.place.fault(format!("a medium from {a} to {b}"), "p0 and p1 that differ along every axis")),
    }
}

/// How many values a grid has along each axis.
fn resolution(p: &Params) -> Result<[usize; 3], Fault> {
    let mut size = [1; 3];
    for (n, name) in size.iter_mut().zip(["nx", "ny", "nz"]) {
        let given = p.integer(name, 1)?;
        *n = usize::try_from(given).ok().filter(|n| (1..=MOST_VALUES).contains(n)).ok_or_else(|| {
            let place = p.get(name).map_or(p.place, |param| param.place);
            place.fault(format!("{name} {given}"), "a whole number of at least 1")
        })?;
    }
    match size.iter().try_fold(1usize, |all, n| all.checked_mul(*n)).filter(|n| *n <= MOST_VALUES) {
        Some(_) => Ok(size),
        None => Err(p.place.fault(format!("a grid of {} × {} × {} values", size[0], size[1], size[2]), "at most 2^31 values")),
    }
}

/// What is wrong with the values of a grid, if anything.
fn check_values(param: &Param, values: &[f64], size: [usize; 3], channels: usize) -> Result<(), Fault> {
    let expected = size.iter().product::<usize>() * channels;
    if values.len() != expected {
        let found = format!("{} values of \"{}\"", values.len() / channels, param.name);
        let expected = format!("nx × ny × nz = {} × {} × {} = {}", size[0], size[1], size[2], expected / channels);
        return Err(param.place.fault(found, expected));
    }
    match values.iter().find(|v| !(**v >= 0.0 && (**v as f32).is_finite())) {
        Some(v) => Err(param.place.fault(format!("{v} in \"{}\"", param.name), "numbers of at least 0")),
        None => Ok(()),
    }
}

/// The numbers of a grid by the name of their parameter, where it is there.
fn numbers(p: &Params, name: &str, size: [usize; 3], bounds: &Bounds) -> Result<Option<Grid<f32>>, Fault> {
    let (Some(values), Some(param)) = (p.floats(name)?, p.get(name)) else { return Ok(None) };
    check_values(param, values, size, 1)?;
    Ok(Grid::new(size, values.iter().map(|v| *v as f32).collect(), bounds))
}

/// The colours of a grid by the name of their parameter, where it is there.
fn colors(p: &Params, name: &str, size: [usize; 3], bounds: &Bounds) -> Result<Option<Grid<Tint>>, Fault> {
    let Some(param) = p.get(name) else { return Ok(None) };
    let Values::Numbers(values) = &param.values else {
        return Err(param.place.fault(format!("\"{} {name}\"", param.kind), format!("\"rgb {name}\"")));
    };
    if param.kind != "rgb" {
        return Err(param.place.fault(format!("\"{} {name}\"", param.kind), format!("\"rgb {name}\"")));
    }
    check_values(param, values, size, 3)?;
    let tints = values.chunks_exact(3).map(|c| Tint::from_rgb(Vec3::new(c[0] as f32, c[1] as f32, c[2] as f32)));
    Ok(Grid::new(size, tints.collect(), bounds))
}

fn uniform_grid(context: &Context, p: &Params, bare: Medium, scale: f32) -> Result<Medium, Fault> {
    let (size, bounds) = (resolution(p)?, bounds(p)?);
    let density = numbers(p, "density", size, &bounds)?
        .ok_or_else(|| p.place.fault("a uniformgrid without density", "\"float density\" [ nx × ny × nz values ]"))?;
    let temperature = numbers(p, "temperature", size, &bounds)?;
    let mut medium = bare;
    let glow = match (p.get("Le"), temperature) {
        (Some(le), Some(_)) => return Err(le.place.fault("both Le and temperature", "one of the two")),
        (None, Some(temperature)) => Some(black_body(p, Scalars::Grid(temperature))?),
        (None, None) => None,
        (Some(le), None) => {
            // One number for all, or one for each value.
            let factors = p.floats("Lescale")?.map_or(0, <[f64]>::len);
            let (factor, grid) = match factors {
                0 | 1 => (p.float("Lescale", 1.0)? as f32, None),
                _ => (1.0, numbers(p, "Lescale", size, &bounds)?),
            };
            medium.emission = Some(emission(context, le, factor)?);
            Some(Glow::Scaled(grid))
        }
    };
    let field = Field::Density(Scalars::Grid(density));
    filled(context, p, medium, scale, bounds, field, glow)
}

fn rgb_grid(context: &Context, p: &Params, bare: Medium, scale: f32) -> Result<Medium, Fault> {
    let (size, bounds) = (resolution(p)?, bounds(p)?);
    let (absorption, scattering) = (colors(p, "sigma_a", size, &bounds)?, colors(p, "sigma_s", size, &bounds)?);
    if absorption.is_none() && scattering.is_none() {
        return Err(p.place.fault("an rgbgrid without sigma_a and sigma_s", "\"rgb sigma_a\" or \"rgb sigma_s\" of all values"));
    }
    let glow = colors(p, "Le", size, &bounds)?;
    if glow.is_some() && absorption.is_none() {
        return Err(p.place.fault("an rgbgrid with Le and without sigma_a", "sigma_a: what does not absorb does not shine"));
    }
    let factor = p.float("Lescale", 1.0)? as f32;
    let glow = glow.map(|grid| Glow::Colors(grid, factor));
    let volume = Volume::new(place(context, p)?, bounds, Field::Colors { absorption, scattering }, glow);
    let grey = || Coefficient::grey(scale);
    Ok(Medium { absorption: grey(), scattering: grey(), volume: Some(Box::new(volume)), ..bare })
}

fn cloud(context: &Context, p: &Params, bare: Medium, scale: f32) -> Result<Medium, Fault> {
    let number = |name: &str, default: f64| {
        let v = p.float(name, default)?;
        match v >= 0.0 && v.is_finite() {
            true => Ok(v as f32),
            false => Err(p.place.fault(format!("{name} {v}"), "a number of at least 0")),
        }
    };
    let cloud =
        Cloud { density: number("density", 1.0)?, wispiness: number("wispiness", 1.0)?, frequency: number("frequency", 5.0)? };
    filled(context, p, bare, scale, bounds(p)?, Field::Cloud(cloud), None)
}

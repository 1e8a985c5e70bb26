//! Media by name. Those that differ from place to place are not supported.

use super::Fault;
use super::params::{Params, Values};
use super::spectra::{self, Use};
use super::world::World;
use crate::medium::{Coefficient, Medium};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use diopter_light::upsample::Sigmoid;
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

/// A `MakeNamedMedium`.
pub fn make(world: &World, name: &str, p: &Params) -> Result<Medium, Fault> {
    match p.text("type")? {
        Some("homogeneous") => (),
        Some(other) => {
            let found = format!("medium \"{name}\" of type {other}");
            return Err(p.place.fault(found, "homogeneous: media that differ from place to place are not supported"));
        }
        None => return Err(p.place.fault(format!("medium \"{name}\" without type"), "\"string type\" \"homogeneous\"")),
    }
    let scale = p.float("scale", 1.0)?;
    if !(scale >= 0.0 && scale.is_finite()) {
        return Err(p.place.fault(format!("a scale of {scale}"), "a number of at least 0"));
    }
    let preset = match p.text("preset")? {
        None | Some("") => None,
        Some(preset) => Some(PRESETS.iter().find(|known| known.0 == preset).ok_or_else(|| {
            let near = diopter_light::names::nearest(preset, PRESETS.iter().map(|p| p.0));
            let known = PRESETS.map(|p| p.0).join(", ");
            p.place.fault(
                format!("preset \"{preset}\""),
                near.map_or(format!("one of {known}"), |n| format!("one of {known} (did you mean {n}?)")),
            )
        })?),
    };
    let coefficient = |name: &str, preset: Option<[f32; 3]>| match (preset, p.get(name)) {
        (Some(rgb), _) => Ok(of_rgb(Vec3::from_array(rgb), scale as f32)),
        (None, None) => Ok(Coefficient::grey(scale as f32)),
        (None, Some(param)) => match (&param.values, param.kind.as_str()) {
            (Values::Numbers(n), "rgb") if n.len() == 3 && n.iter().all(|v| *v >= 0.0) => {
                Ok(of_rgb(Vec3::new(n[0] as f32, n[1] as f32, n[2] as f32), scale as f32))
            }
            _ => {
                let spectrum = spectra::of(world, param, Use::Unbounded)?;
                match (0..=80).map(|i| spectrum.at(380.0 + 5.0 * i as f32)).find(|v| !(*v >= 0.0 && v.is_finite())) {
                    Some(v) => Err(param.place.fault(format!("\"{name}\" of {v}"), "numbers of at least 0")),
                    None => Ok(Coefficient::Scaled(scale as f32, spectrum)),
                }
            }
        },
    };
    let asymmetry = p.float("g", 0.0)? as f32;
    if !(-0.9999..=0.9999).contains(&asymmetry) {
        return Err(p.place.fault(format!("g {asymmetry}"), "above -1 and below 1"));
    }
    let emission = match p.get("Le") {
        None => None,
        Some(param) => {
            let factor = p.float("Lescale", 1.0)? as f32;
            let le = spectra::of(world, param, Use::Light)?;
            Some(Spectrum::Table(Table::new(380.0, 5.0, (0..=80).map(|i| le.at(380.0 + 5.0 * i as f32) * factor).collect())))
        }
    };
    Ok(Medium {
        name: name.to_owned(),
        absorption: coefficient("sigma_a", preset.map(|p| p.2))?,
        scattering: coefficient("sigma_s", preset.map(|p| p.1))?,
        asymmetry,
        emission,
    })
}

fn of_rgb(rgb: Vec3, scale: f32) -> Coefficient {
    let most = 2.0 * rgb.max_element();
    if most <= 0.0 {
        return Coefficient::NONE;
    }
    Coefficient::Scaled(scale * most, Spectrum::Sigmoid(Sigmoid::from_rgb(rgb / most)))
}

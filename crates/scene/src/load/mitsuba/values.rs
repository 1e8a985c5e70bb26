//! Numbers, colours, spectra and transforms of elements.

use super::tree::Node;
use super::wrong;
use crate::SceneError;
use diopter_light::spectrum::{Table, blackbody as blackbody_radiance, blackbody_with_luminance};
use diopter_light::{Spectrum, color};
use glam::{DMat3, DMat4, DVec3, DVec4, Vec3};

type Read<T> = Result<T, SceneError>;

fn numbers_of(node: &Node, text: &str) -> Read<Vec<f64>> {
    let words = text.split([',', ' ', '\t', '\n', '\r']).filter(|w| !w.is_empty());
    let all: Option<Vec<f64>> = words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect();
    all.ok_or_else(|| wrong(node, format!("\"{text}\""), "finite numbers"))
}

fn number_of(node: &Node, name: &str, default: f64) -> Read<f64> {
    match node.get(name) {
        None => Ok(default),
        Some(text) => text
            .trim()
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| wrong(node, format!("{name}=\"{text}\""), "a finite number")),
    }
}

/// A float or an integer by name.
pub fn number(node: &Node, name: &str, default: f64) -> Read<f64> {
    match node.child(name) {
        Some(child) if matches!(child.tag.as_str(), "float" | "integer") => match child.get("value") {
            Some(_) => number_of(child, "value", default),
            None => Err(wrong(child, format!("\"{name}\" without a value"), "value=\"...\"")),
        },
        Some(child) if matches!(child.tag.as_str(), "string" | "boolean" | "point" | "vector" | "transform") => {
            Err(wrong(child, format!("a {} as \"{name}\"", child.tag), "a float"))
        }
        _ => Ok(default),
    }
}

/// A boolean by name.
pub fn boolean(node: &Node, name: &str, default: bool) -> Read<bool> {
    match node.child(name).map(|c| (c, c.get("value"))) {
        None => Ok(default),
        Some((_, Some("true"))) => Ok(true),
        Some((_, Some("false"))) => Ok(false),
        Some((c, other)) => Err(wrong(c, format!("\"{}\"", other.unwrap_or_default()), "true or false")),
    }
}

/// A string by name.
pub fn text<'a>(node: &'a Node, name: &str) -> Option<&'a str> {
    node.child(name).filter(|c| c.tag == "string").and_then(|c| c.get("value"))
}

/// A point or vector by name: x, y and z, or all in one.
pub fn vector(node: &Node, name: &str, default: DVec3) -> Read<DVec3> {
    let Some(child) = node.child(name) else { return Ok(default) };
    let all = match child.get("value") {
        Some(text) => numbers_of(child, text)?,
        None => vec![number_of(child, "x", 0.0)?, number_of(child, "y", 0.0)?, number_of(child, "z", 0.0)?],
    };
    match all[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(wrong(child, format!("{} numbers", all.len()), "3 numbers")),
    }
}

/// A colour or spectrum of an element.
#[derive(Clone, Debug)]
pub enum Shade {
    Rgb(Vec3),
    /// A number: white of it, as a light.
    Even(f32),
    /// The same at all wavelengths, as a light, too.
    EvenSpectrum(f32),
    /// Wavelengths, nm, and values.
    Points(Vec<(f32, f32)>),
    Blackbody(f32, f32),
}

impl Shade {
    /// What an element says; none of elements that are no colour.
    pub fn of(node: &Node) -> Read<Option<Shade>> {
        if node.tag == "spectrum"
            && let Some(kind) = node.get("type")
        {
            return Shade::of_kind(node, kind).map(Some);
        }
        let value = node.get("value").unwrap_or_default();
        Ok(Some(match node.tag.as_str() {
            "float" => Shade::Even(number_of(node, "value", 0.0)? as f32),
            "rgb" | "srgb" => {
                // Mitsuba 0.x has colours in the codes of sRGB, too.
                let decoded =
                    |rgb: Vec3| if node.tag == "srgb" { Vec3::from(rgb.to_array().map(color::srgb_decode)) } else { rgb };
                if let Some(hex) = value.strip_prefix('#').filter(|h| h.len() == 6 && h.is_ascii()) {
                    let code = |i: usize| u8::from_str_radix(&hex[i..i + 2], 16).map(|v| f32::from(v) / 255.0);
                    let [Ok(r), Ok(g), Ok(b)] = [code(0), code(2), code(4)] else {
                        return Err(wrong(node, format!("\"{value}\""), "#rrggbb"));
                    };
                    return Ok(Some(Shade::Rgb(decoded(Vec3::new(r, g, b)))));
                }
                match numbers_of(node, value)?[..] {
                    [v] => Shade::Rgb(decoded(Vec3::splat(v as f32))),
                    [r, g, b] => Shade::Rgb(decoded(Vec3::new(r as f32, g as f32, b as f32))),
                    _ => return Err(wrong(node, format!("\"{value}\""), "three numbers, or one")),
                }
            }
            "spectrum" if value.contains(':') => {
                let pairs = value.split([',', ' ']).filter(|w| !w.trim().is_empty());
                let pair = |w: &str| w.split_once(':').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
                let mut points: Vec<(f32, f32)> = pairs
                    .map(pair)
                    .collect::<Option<_>>()
                    .ok_or_else(|| wrong(node, format!("\"{value}\""), "wavelength:value, ..."))?;
                points.retain(|p| p.0.is_finite() && p.1.is_finite());
                sorted(node, points)?
            }
            "spectrum" => match numbers_of(node, value)?[..] {
                [v] => Shade::EvenSpectrum(v as f32),
                [r, g, b] => Shade::Rgb(Vec3::new(r as f32, g as f32, b as f32)),
                _ => return Err(wrong(node, format!("\"{value}\""), "a number, or wavelength:value, ...")),
            },
            "blackbody" => blackbody(node, number_of(node, "temperature", 5000.0)?, number_of(node, "scale", 1.0)?)?,
            _ => return Ok(None),
        }))
    }

    /// A spectrum by its plugin. Source: Mitsuba 3, plugin reference (spectra).
    fn of_kind(node: &Node, kind: &str) -> Read<Shade> {
        let list = |name: &str| -> Read<Vec<f32>> {
            let text = text(node, name).ok_or_else(|| {
                wrong(node, format!("a spectrum \"{kind}\" without {name}"), format!("<string name=\"{name}\" value=\"...\"/>"))
            })?;
            Ok(numbers_of(node, text)?.into_iter().map(|v| v as f32).collect())
        };
        let points = |wavelengths: Vec<f32>, values: Vec<f32>| match wavelengths.len() == values.len() {
            true => sorted(node, wavelengths.into_iter().zip(values).collect()),
            false => Err(wrong(node, format!("{} values of {} wavelengths", values.len(), wavelengths.len()), "one of each")),
        };
        match kind {
            "uniform" => Ok(Shade::EvenSpectrum(number(node, "value", 1.0)? as f32)),
            "d65" => Ok(Shade::Even(number(node, "scale", 1.0)? as f32)),
            "blackbody" => blackbody(node, number(node, "temperature", 5000.0)?, number(node, "scale", 1.0)?),
            "irregular" => points(list("wavelengths")?, list("values")?),
            "regular" => {
                let values = list("values")?;
                let range = [number(node, "wavelength_min", 360.0)?, number(node, "wavelength_max", 830.0)?];
                let step = (range[1] - range[0]) / (values.len().max(2) - 1) as f64;
                points((0..values.len()).map(|i| (range[0] + step * i as f64) as f32).collect(), values)
            }
            "srgb" | "rgb" => {
                let color = node.child("color").or_else(|| node.child("value"));
                let shade = color.map(|color| Shade::of(color)).transpose()?.flatten();
                shade.ok_or_else(|| {
                    wrong(node, format!("a spectrum \"{kind}\" without color"), "<rgb name=\"color\" value=\"...\"/>")
                })
            }
            other => Err(wrong(
                node,
                format!("spectrum \"{other}\""),
                "uniform, d65, blackbody, regular, irregular or srgb, or values of its own: others are not supported",
            )),
        }
    }

    /// Linear sRGB.
    pub fn rgb(&self) -> Vec3 {
        match self {
            Shade::Rgb(rgb) => *rgb,
            Shade::Even(v) | Shade::EvenSpectrum(v) => Vec3::splat(*v),
            Shade::Points(points) => crate::texture::spectrum_rgb(&Spectrum::Table(bounded(points))).max(Vec3::ZERO),
            Shade::Blackbody(kelvin, scale) => {
                let light = blackbody_light(*kelvin, *scale);
                color::srgb_of_light(|nm| light.at(nm)).max(Vec3::ZERO)
            }
        }
    }

    /// A light: 1 is 1 cd/m² of white; a black body of scale 1 shines with Planck's radiance, W·m⁻²·sr⁻¹·nm⁻¹, of which an even 1 is one, too.
    pub fn light(&self, factor: f32) -> Spectrum {
        match self {
            Shade::Blackbody(kelvin, scale) if scale * factor > 0.0 => blackbody_light(*kelvin, scale * factor),
            Shade::Points(points) => {
                // An even spectrum of 1 has 1 cd/m².
                let even = color::luminance(|_| 1.0) as f32;
                Spectrum::Table(bounded(points).scaled(factor / even))
            }
            Shade::EvenSpectrum(v) => Shade::Points(vec![(380.0, v.max(0.0)), (780.0, v.max(0.0))]).light(factor),
            other => Spectrum::light_from_rgb(other.rgb().max(Vec3::ZERO) * factor),
        }
    }

    /// A number without bound over wavelength, such as an index.
    pub fn unbounded(&self) -> Spectrum {
        match self {
            Shade::Even(v) | Shade::EvenSpectrum(v) => Spectrum::Constant(*v),
            Shade::Points(points) => Spectrum::Table(Table::from_points(points)),
            other => {
                let rgb = other.rgb();
                let points = [(460.0, rgb.z), (545.0, rgb.y), (610.0, rgb.x)];
                Spectrum::TableOfRgb { table: Table::from_points(&points), rgb }
            }
        }
    }
}

/// A light or a reflectance by its values: 0 beyond their ends, as Mitsuba has it (an index goes on).
pub fn bounded(points: &[(f32, f32)]) -> Table {
    let at = |nm: f32| match points.partition_point(|p| p.0 < nm) {
        i if points.get(i).is_some_and(|p| p.0 == nm) => points[i].1,
        0 => 0.0,
        i if i == points.len() => 0.0,
        i => {
            let ((x0, y0), (x1, y1)) = (points[i - 1], points[i]);
            y0 + (y1 - y0) * (nm - x0) / (x1 - x0)
        }
    };
    Table::new(380.0, 1.0, (380..=780).map(|nm| at(nm as f32)).collect())
}

/// Values by wavelength, nm. Fails without any.
fn sorted(node: &Node, mut points: Vec<(f32, f32)>) -> Read<Shade> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points.dedup_by_key(|p| p.0);
    match points.is_empty() {
        true => Err(wrong(node, "no values", "wavelength:value, ...")),
        false => Ok(Shade::Points(points)),
    }
}

fn blackbody(node: &Node, kelvin: f64, scale: f64) -> Read<Shade> {
    match (100.0..=1e6).contains(&kelvin) {
        true => Ok(Shade::Blackbody(kelvin as f32, scale as f32)),
        false => Err(wrong(node, format!("{kelvin} K"), "100 to 1 000 000 K")),
    }
}

/// The light of a black body of a temperature, K, for a scale on its radiance: 1 is that of an even spectrum of 1 W·m⁻²·sr⁻¹·nm⁻¹.
fn blackbody_light(kelvin: f32, scale: f32) -> Spectrum {
    let brightness = color::luminance(|nm| blackbody_radiance(nm, kelvin)) / color::luminance(|_| 1.0);
    blackbody_with_luminance(kelvin, scale * brightness as f32)
}

/// A colour by name, unless it is a texture.
pub fn shade(node: &Node, name: &str) -> Read<Option<Shade>> {
    node.child(name).map_or(Ok(None), |child| Shade::of(child))
}

/// A transform by name: its parts from the first to the last.
pub fn transform(node: &Node, name: &str) -> Read<DMat4> {
    let Some(child) = node.child(name).filter(|c| c.tag == "transform") else { return Ok(DMat4::IDENTITY) };
    let mut whole = DMat4::IDENTITY;
    for part in &child.children {
        let three = |default: f64| -> Read<DVec3> {
            match part.get("value").map(|t| numbers_of(part, t)).transpose()?.as_deref() {
                Some([v]) => Ok(DVec3::splat(*v)),
                Some([x, y, z]) => Ok(DVec3::new(*x, *y, *z)),
                Some(_) => Err(wrong(part, "another count of numbers", "1 or 3")),
                None => {
                    Ok(DVec3::new(number_of(part, "x", default)?, number_of(part, "y", default)?, number_of(part, "z", default)?))
                }
            }
        };
        let m = match part.tag.as_str() {
            "translate" => DMat4::from_translation(three(0.0)?),
            "scale" => DMat4::from_scale(three(1.0)?),
            "rotate" => {
                let axis = three(0.0)?.try_normalize().ok_or_else(|| wrong(part, "an axis of no length", "x, y or z"))?;
                DMat4::from_axis_angle(axis, number_of(part, "angle", 0.0)?.to_radians())
            }
            "lookat" | "lookAt" | "look_at" => {
                let point = |name: &str, default: DVec3| -> Read<DVec3> {
                    match part.get(name).map(|t| numbers_of(part, t)).transpose()?.as_deref() {
                        Some([x, y, z]) => Ok(DVec3::new(*x, *y, *z)),
                        Some(_) => Err(wrong(part, format!("{name} of another count of numbers"), "3")),
                        None => Ok(default),
                    }
                };
                let (origin, target, up) = (point("origin", DVec3::ZERO)?, point("target", DVec3::Z)?, point("up", DVec3::Y)?);
                let ahead = (target - origin).try_normalize();
                let axes = ahead.and_then(|d| Some((up.cross(d).try_normalize()?, d)));
                let (left, ahead) =
                    axes.ok_or_else(|| wrong(part, "a lookat without direction", "origin, target and up that differ"))?;
                let up = ahead.cross(left);
                DMat4::from_cols(left.extend(0.0), up.extend(0.0), ahead.extend(0.0), origin.extend(1.0))
            }
            "matrix" => {
                let all = numbers_of(part, part.get("value").unwrap_or_default())?;
                let m = match (all.first_chunk::<16>(), all.first_chunk::<9>()) {
                    (Some(m), _) if all.len() == 16 => DMat4::from_cols_array(m).transpose(),
                    (_, Some(m)) if all.len() == 9 => DMat4::from_mat3(DMat3::from_cols_array(m).transpose()),
                    _ => return Err(wrong(part, format!("{} numbers", all.len()), "16 or 9")),
                };
                if m.row(3) != DVec4::W {
                    return Err(wrong(part, "a matrix with a perspective", "an affine one: its last row is 0 0 0 1"));
                }
                m
            }
            other => return Err(wrong(part, format!("<{other}>"), "translate, rotate, scale, lookat or matrix")),
        };
        whole = m * whole;
    }
    match whole.is_finite() && whole.determinant().abs() > 1e-30 {
        true => Ok(whole),
        false => Err(wrong(child, "a transform that cannot be inverted", "one of factors other than 0")),
    }
}

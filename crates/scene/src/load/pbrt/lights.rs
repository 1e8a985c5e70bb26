//! Lights. Every one is divided by its own luminance: `scale` counts in cd/m², cd or lx.

use super::Fault;
use super::context::Context;
use super::params::Params;
use super::spectra::{self, Use};
use crate::light::environment::direction;
use crate::light::photometry::Web;
use crate::light::punctual::{Pattern, Spread, square_of};
use crate::light::{Environment, Modulation, Punctual, PunctualKind, SpotEdge};
use crate::material::{Emission, EmissionColor};
use crate::texture::{Interpolation, Texture};
use diopter_image::Raster;
use diopter_light::Spectrum;
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::spectrum::Table;
use glam::{Affine2, DMat4, DVec4, Mat3, Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Columns of the lat-long map that an equal-area picture becomes.
const MOST_COLUMNS: usize = 8192;

/// Adds a `LightSource`, its spectrum in cd (point, spot, picture), lx (distant) or cd/m² (infinite). Fails where its type is not known, a parameter is out of range, it
/// has no direction, or its file cannot be read or is not of the mapping that it must have.
pub fn make(context: &mut Context, kind: &str, p: &Params, world_from_light: DMat4) -> Result<(), Fault> {
    let place = p.place;
    if p.get("mapname").is_some() {
        return Err(place.version_3(format!("light \"{kind}\" with mapname")));
    }
    let point = |v: Vec3| world_from_light.transform_point3(v.as_dvec3()).as_vec3();
    let direction = |from: Vec3, to: Vec3| {
        let d = world_from_light.transform_vector3((to - from).as_dvec3());
        d.try_normalize().map(|d| d.as_vec3()).ok_or_else(|| place.fault("a light from and to the same point", "two points"))
    };
    let at_least_0 = |name: &str| {
        let v = p.float(name, if name == "scale" { 1.0 } else { -1.0 })?;
        let fine = v.is_finite() && (v >= 0.0 || name != "scale");
        if fine { Ok(v) } else { Err(place.fault(format!("{name} {v}"), "a number of at least 0")) }
    };
    let scale = at_least_0("scale")?;
    let white = Spectrum::light_from_rgb(Vec3::ONE);
    match kind {
        "point" | "spot" => {
            let spectrum = spectra::get(context, p, "I", Use::Light, white)?;
            let from = p.vector("from", Vec3::ZERO)?;
            let (power, solid_angle, kind) = match kind {
                "point" => (at_least_0("power")?, 4.0 * PI, PunctualKind::Point { position: point(from) }),
                _ => {
                    let to = p.vector("to", Vec3::Z)?;
                    let (cone, delta) = (p.float("coneangle", 30.0)?, p.float("conedeltaangle", 5.0)?);
                    if !(cone > 0.0 && cone <= 180.0 && (0.0..=180.0).contains(&delta)) {
                        return Err(
                            place.fault(format!("coneangle {cone}, conedeltaangle {delta}"), "angles from 0 to 180 degrees")
                        );
                    }
                    let (outer, inner) = (cone.to_radians().cos(), (cone - delta).max(0.0).to_radians().cos());
                    let solid = 2.0 * PI * ((1.0 - inner) + 0.5 * (inner - outer));
                    let kind = PunctualKind::Spot {
                        position: point(from),
                        direction: direction(from, to)?,
                        cos_inner: inner as f32,
                        cos_outer: outer as f32,
                        edge: SpotEdge::Smooth,
                    };
                    (at_least_0("power")?, solid, kind)
                }
            };
            let factor = scale * if power > 0.0 { power / solid_angle } else { 1.0 };
            let name = format!("light {}", context.description.punctual.len());
            context.description.punctual.push(Punctual::new(&name, times(&spectrum, factor), kind));
        }
        "distant" => {
            let spectrum = spectra::get(context, p, "L", Use::Light, white)?;
            let (from, to) = (p.vector("from", Vec3::ZERO)?, p.vector("to", Vec3::Z)?);
            let lux = at_least_0("illuminance")?;
            let factor = scale * if lux > 0.0 { lux } else { 1.0 };
            let kind = PunctualKind::Directional { direction: direction(from, to)? };
            let name = format!("light {}", context.description.punctual.len());
            context.description.punctual.push(Punctual::new(&name, times(&spectrum, factor), kind));
        }
        "goniometric" | "projection" => {
            let name = p
                .text("filename")?
                .ok_or_else(|| place.fault(format!("a {kind} light without filename"), "\"string filename\""))?;
            if kind == "goniometric" && name.to_lowercase().ends_with(".ies") {
                let name = name.to_owned();
                return ies(context, p, &name, world_from_light, scale, at_least_0("power")?);
            }
            let mut picture = crate::load::read_light_picture(&context.file(name, place)?)
                .map_err(|e| place.fault(format!("{name}: {e}"), "a picture (EXR, HDR, PNG)"))?;
            if kind == "goniometric" {
                // pbrt's has one channel: the mean of a colour.
                picture.data.as_chunks_mut::<3>().0.iter_mut().for_each(|p| *p = [p.iter().sum::<f32>() / 3.0; 3]);
            }
            let spectrum = match kind {
                "goniometric" => spectra::get(context, p, "I", Use::Light, white)?,
                _ => white,
            };
            let turned = match kind {
                // pbrt's measured lights have their axis along y.
                "goniometric" => world_from_light * DMat4::from_cols(DVec4::X, DVec4::Z, DVec4::Y, DVec4::W),
                _ => world_from_light,
            };
            let spread = match kind {
                "goniometric" => {
                    if picture.width != picture.height {
                        let found = format!("{name}: {} × {} pixels", picture.width, picture.height);
                        return Err(place.fault(found, "a square picture in the equal-area octahedral mapping"));
                    }
                    Spread::Sphere
                }
                _ => {
                    let fov = p.float("fov", 90.0)?;
                    if !(0.001..180.0).contains(&fov) {
                        return Err(place.fault(format!("fov {fov}"), "an angle from 0.001 to below 180 degrees"));
                    }
                    let (tan, aspect) = ((0.5 * fov).to_radians().tan() as f32, picture.width as f32 / picture.height as f32);
                    Spread::Frame(if aspect > 1.0 { [tan * aspect, tan] } else { [tan, tan / aspect] })
                }
            };
            let light_from_world = glam::DMat3::from_mat4(turned).inverse().as_mat3();
            let pattern = Pattern { picture, light_from_world, spread };
            let power = at_least_0("power")?;
            let lumens = match &pattern.spread {
                Spread::Frame(half) => frame_lumens(&pattern.picture, *half),
                Spread::Sphere | Spread::Web(_) => 4.0 * PI * f64::from(pattern.mean()),
            };
            let factor = scale * if power > 0.0 { power / lumens.max(1e-30) } else { 1.0 };
            let at = PunctualKind::Point { position: point(Vec3::ZERO) };
            let name = format!("light {}", context.description.punctual.len());
            let light = Punctual::new(&name, times(&spectrum, factor), at);
            context.description.punctual.push(Punctual { pattern: Some(Arc::new(pattern)), ..light });
        }
        "infinite" => {
            if p.get("portal").is_some() {
                context.warn(place, "light comes from all around, also from beside the portal, where pbrt's is dark");
            }
            let lux = at_least_0("illuminance")?;
            let turn = |m: DMat4| {
                let m = glam::DMat3::from_mat4(m);
                let unit = |v: glam::DVec3| v.normalize_or_zero().as_vec3();
                Mat3::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis))
            };
            let environment = match p.text("filename")? {
                None => {
                    let spectrum = spectra::get(context, p, "L", Use::Light, white)?;
                    let factor = scale * if lux > 0.0 { lux / PI } else { 1.0 };
                    Environment::even(times(&spectrum, factor))
                }
                Some(name) => {
                    let name = name.to_owned();
                    let picture = crate::load::read_light_picture(&context.file(&name, place)?)
                        .map_err(|e| place.fault(format!("{name}: {e}"), "a picture (EXR, HDR, PNG)"))?;
                    if picture.width != picture.height {
                        let found = format!("{name}: {} × {} pixels", picture.width, picture.height);
                        return Err(
                            place.fault(found, "a square picture in the equal-area octahedral mapping, as pbrt-v4 has them")
                        );
                    }
                    let factor = scale * if lux > 0.0 { lux / upward(&picture) } else { 1.0 };
                    Environment::new(lat_long(&picture), turn(world_from_light), factor as f32)
                }
            };
            context.description.environment = Some(match context.description.environment.take() {
                Some(first) => first.plus(&environment),
                None => environment,
            });
        }
        other => {
            return Err(place.fault(format!("light \"{other}\""), "point, spot, distant, infinite, goniometric or projection"));
        }
    }
    Ok(())
}

/// A `goniometric` light by an IES file, which pbrt does not have: a lamp that hangs, aimed along −y, its horizontal angles from +x. `I` gives its
/// colour, `power` (lm) counts instead of what was measured.
fn ies(context: &mut Context, p: &Params, file: &str, world_from_light: DMat4, scale: f64, power: f64) -> Result<(), Fault> {
    let web = Web::read(&context.file(file, p.place)?).map_err(|e| p.place.fault(format!("{file}: {}", e.found), e.expected))?;
    let spectrum = spectra::get(context, p, "I", Use::Light, Spectrum::light_from_rgb(Vec3::ONE))?;
    // The file's −z is the light's −y, its y the light's −z.
    let turned = world_from_light * DMat4::from_cols(DVec4::X, DVec4::NEG_Z, DVec4::Y, DVec4::W);
    let factor = scale * f64::from(web.peak()) * if power > 0.0 { power / web.lumens() } else { 1.0 };
    let pattern = Pattern::measured(web, glam::DMat3::from_mat4(turned).inverse().as_mat3());
    let kind = PunctualKind::Point { position: world_from_light.transform_point3(glam::DVec3::ZERO).as_vec3() };
    let name = format!("light {}", context.description.punctual.len());
    let light = Punctual::new(&name, times(&spectrum, factor), kind);
    context.description.punctual.push(Punctual { pattern: Some(Arc::new(pattern)), ..light });
    Ok(())
}

/// A light times a factor.
fn times(spectrum: &Spectrum, factor: f64) -> Spectrum {
    match spectrum {
        Spectrum::RgbLight { scale, color } => Spectrum::RgbLight { scale: scale * factor as f32, color: *color },
        other => Spectrum::Table(Table::new(380.0, 1.0, (0..=400).map(|i| other.at(380.0 + i as f32) * factor as f32).collect())),
    }
}

/// What an area light adds to the material of a shape of an area (m²): radiance by cd/m², or by `power` in lm. Fails where its factor is below 0 or not finite, or its
/// spectrum is wrong; a picture that is missing is noted.
pub fn emission(context: &mut Context, p: &Params, area: f32) -> Result<Emission, Fault> {
    let picture = match p.text("filename")? {
        None => None,
        Some(_) if p.get("L").is_some() => {
            return Err(p.place.fault("an area light with L and filename", "one of them: a colour or a picture"));
        }
        Some(name) => {
            context.description.declares_lamps = true;
            let image = context.picture(name).map_or_else(crate::load::stand_in, Arc::new);
            // Rows count from below.
            let image_from_uv = Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y);
            Some(Texture { image_from_uv, interpolation: Interpolation::Nearest, ..Texture::color(image) })
        }
    };
    let spectrum = spectra::get(context, p, "L", Use::Light, Spectrum::light_from_rgb(Vec3::ONE))?;
    let two_sided = p.bool("twosided", false)?;
    let (mut factor, power) = (p.float("scale", 1.0)?, p.float("power", -1.0)?);
    if let Some(mean) = picture.as_ref().map(mean_luminance).filter(|m| *m > 0.0 && power > 0.0) {
        factor /= mean;
    }
    if power > 0.0 {
        // pbrt gives the power to each triangle; a lamp of so many lumens is meant.
        let sides = if two_sided { 2.0 } else { 1.0 };
        factor *= power / (f64::from(area).max(1e-30) * PI * sides);
    }
    if !(factor >= 0.0 && factor.is_finite()) {
        return Err(p.place.fault(format!("a light of {factor}"), "a scale of at least 0"));
    }
    let radiance = match picture {
        Some(texture) => EmissionColor::Textured { factor: Vec3::splat(factor as f32), texture },
        None => EmissionColor::Constant(times(&spectrum, factor)),
    };
    Ok(Emission { radiance, two_sided, is_light: true, modulation: Modulation::Steady })
}

/// Mean luminance of a picture.
fn mean_luminance(texture: &Texture) -> f64 {
    let n = 256;
    let at = |i: usize| texture.at(&[Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32; 2]).truncate();
    (0..n * n).map(|i| f64::from(at(i).dot(SRGB_LUMINANCE))).sum::<f64>() / (n * n) as f64
}

/// Luminous flux of a projector of 1 cd for each 1 of its picture.
fn frame_lumens(picture: &Raster<f32>, [x, y]: [f32; 2]) -> f64 {
    let (w, h) = (picture.width, picture.height);
    let area = f64::from(4.0 * x * y) / (w * h) as f64;
    (0..w * h)
        .map(|i| {
            let (u, v) = (((i % w) as f32 + 0.5) / w as f32 * 2.0 - 1.0, ((i / w) as f32 + 0.5) / h as f32 * 2.0 - 1.0);
            let cos3 = f64::from(1.0 + (u * x).powi(2) + (v * y).powi(2)).powf(-1.5);
            f64::from(Vec3::from_slice(picture.pixel(i % w, i / w)).dot(SRGB_LUMINANCE)) * area * cos3
        })
        .sum()
}

/// Illuminance of the upper half (about +z) on a level plane.
fn upward(picture: &Raster<f32>) -> f64 {
    let n = picture.width;
    let (mut sum, mut count) = (0.0, 0.0);
    let steps = 512;
    for j in 0..steps {
        for i in 0..steps {
            // Even over the hemisphere.
            let z = (j as f32 + 0.5) / steps as f32;
            let phi = std::f32::consts::TAU * (i as f32 + 0.5) / steps as f32;
            let r = (1.0 - z * z).sqrt();
            let [x, y] = square_of(Vec3::new(r * phi.cos(), r * phi.sin(), z)).map(|v| ((v * n as f32) as usize).min(n - 1));
            sum += f64::from(Vec3::from_slice(picture.pixel(x, y)).dot(SRGB_LUMINANCE) * z);
            count += 1.0;
        }
    }
    (2.0 * PI * sum / count).max(1e-30)
}

/// An equal-area picture as a lat-long map whose +y is the light's +y.
fn lat_long(picture: &Raster<f32>) -> Raster<f32> {
    let n = picture.width;
    let columns = (4 * n).clamp(8, MOST_COLUMNS);
    let rows = columns / 2;
    let mut map = Raster::new(columns, rows, 3);
    for row in 0..rows {
        for column in 0..columns {
            let d = direction(Vec2::new((column as f32 + 0.5) / columns as f32, (row as f32 + 0.5) / rows as f32));
            let [x, y] = square_of(d).map(|v| ((v * n as f32) as usize).min(n - 1));
            map.pixel_mut(column, row).copy_from_slice(picture.pixel(x, y));
        }
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ies_file_is_a_lamp_that_hangs() {
        // 300 cd straight down, 100 cd to all sides, nothing above.
        let file = b"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0 1 1 1\n0 90\n0\n300 100\n";
        let fetch = |name: &str| if name == "a.ies" { Ok(file.to_vec()) } else { Err("there is no such file".to_owned()) };
        let light = |text: &str| {
            let text = format!(
                "Camera \"perspective\" WorldBegin Shape \"sphere\" Translate 1 2 3 {text} \"string filename\" \"a.ies\""
            );
            crate::load::pbrt::load(text.as_bytes(), "a.pbrt", &fetch).unwrap().punctual.remove(0)
        };
        let lamp = light("LightSource \"goniometric\" \"float scale\" 2");
        let wavelengths = diopter_light::SampledWavelengths::rgb();
        let candela = |lamp: &Punctual, direction: Vec3| {
            f64::from(lamp.illuminance() * lamp.relative_intensity(None, direction, &wavelengths).x)
        };
        for (direction, expected) in [(Vec3::NEG_Y, 600.0), (Vec3::X, 200.0), (Vec3::NEG_Z, 200.0), (Vec3::Y, 0.0)] {
            let found = candela(&lamp, direction);
            assert!((found - expected).abs() < 0.01 * f64::max(expected, 1.0), "{direction}: {found}");
        }
        // Of a stated flux: lumens over the hemisphere, by quadrature of 300 − 200 θ / 90°.
        let stated = light("Rotate 90 1 0 0 LightSource \"goniometric\" \"float power\" 1000");
        let step = PI / 2.0 / 1000.0;
        let ring = |i: i32| (f64::from(i) + 0.5) * step;
        let lumens: f64 = (0..1000).map(|i| (300.0 - 200.0 * ring(i) / (PI / 2.0)) * ring(i).sin() * step * 2.0 * PI).sum();
        // Turned by 90° about x, down is what was −y: −z, which the mirrored world has as +z.
        let most = [Vec3::Z, Vec3::NEG_Z].map(|d| candela(&stated, d)).into_iter().fold(0.0, f64::max);
        assert!((most / (300.0 * 1000.0 / lumens) - 1.0).abs() < 0.01, "{most} {lumens}");
        let bad = "Camera \"perspective\" WorldBegin Shape \"sphere\" LightSource \"goniometric\" \"string filename\" \"b.ies\"";
        assert!(crate::load::pbrt::load(bad.as_bytes(), "a.pbrt", &fetch).unwrap_err().to_string().contains("b.ies"));
    }

    #[test]
    fn the_square_is_turned_into_directions_as_clarberg_has_it() {
        // From the square to the sphere, by the forward formulas.
        let direction = |x: f32, y: f32| {
            let (u, v) = (2.0 * x - 1.0, 2.0 * y - 1.0);
            let s = 1.0 - u.abs() - v.abs();
            let r = 1.0 - s.abs();
            let phi = if r == 0.0 { 1.0 } else { (v.abs() - u.abs()) / r + 1.0 } * std::f32::consts::FRAC_PI_4;
            let f = r * (2.0 - r * r).sqrt();
            Vec3::new(phi.cos().copysign(u) * f, phi.sin().copysign(v) * f, (1.0 - r * r).copysign(s))
        };
        for i in 1..40 {
            for j in 1..40 {
                let (x, y) = (i as f32 / 40.0 + 0.003, j as f32 / 40.0 - 0.004);
                let d = direction(x, y);
                assert!((d.length() - 1.0).abs() < 1e-5);
                let back = square_of(d);
                assert!((back[0] - x).abs() < 1e-4 && (back[1] - y).abs() < 1e-4, "{x} {y} {back:?}");
            }
        }
        // An even picture of 1 lights a level plane with π.
        let even = Raster { width: 8, height: 8, channels: 3, data: vec![1.0; 192] };
        assert!((upward(&even) / PI - 1.0).abs() < 1e-3, "{}", upward(&even));
    }
}

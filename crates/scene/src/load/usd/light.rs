//! Lights. Source: OpenUSD 25, `UsdLux`: intensity 1 is 1 cd/m², times 2^exposure; lights shine along −z, cylinders lie along x.
//!
//! A light that is normalised has its luminance divided by its area in scene units (a distant one's by π sin² of its half angle), so that its power
//! does not change with its size. Shaped ones (ShapingAPI, a cone below 90° or a focus) become spots of the same intensity in their middle, which falls off
//! with the power `focus` of the cosine, and with the cosine of flat ones. A mesh that is a light (MeshLightAPI) shines on its front.

use super::geometry;
use super::layer::{Key, Value};
use super::stage::{Prim, Stage};
use super::world::{Place, World};
use crate::SceneError;
use crate::light::photometry::Web;
use crate::light::punctual::Pattern;
use crate::light::{Environment, Modulation, Punctual, PunctualKind, SpotEdge};
use crate::load::read_light_picture;
use crate::load::{note_missing, read_texture};
use crate::material::{Emission, EmissionColor, Material, Scattering};
use crate::texture::Texture;
use diopter_light::spectrum::blackbody_with_luminance;
use diopter_light::{Spectrum, color};
use glam::{DVec3, Mat3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Steps of the table of a spot's intensity, from its axis to its edge.
const STEPS: usize = 512;

/// A value of a light. Files before 2021 leave out "inputs:".
fn value(stage: &Stage, prim: &Prim, name: &str) -> Result<Option<Value>, SceneError> {
    match stage.value(prim, &format!("inputs:{name}"))? {
        Some(value) => Ok(Some(value)),
        None => stage.value(prim, name),
    }
}

fn number(stage: &Stage, prim: &Prim, name: &str, default: f64) -> Result<f64, SceneError> {
    Ok(value(stage, prim, name)?.and_then(|v| v.number()).filter(|v| v.is_finite()).unwrap_or(default))
}

/// Strength and colour of a light.
struct Power {
    /// cd/m², or lx of a distant light.
    intensity: f64,
    rgb: Vec3,
    /// Colour temperature, K.
    warm: Option<f32>,
    normalize: bool,
    /// Whether it lights matt or glossy surfaces by other factors than 1.
    is_selective: bool,
}

impl Power {
    fn read(stage: &Stage, prim: &Prim, usual: f64) -> Result<Power, SceneError> {
        let number = |name: &str, default: f64| number(stage, prim, name, default);
        let rgb = value(stage, prim, "color")?.and_then(|v| v.floats()).filter(|c| c.len() >= 3);
        Ok(Power {
            intensity: number("intensity", usual)?.max(0.0) * number("exposure", 0.0)?.clamp(-100.0, 100.0).exp2(),
            rgb: rgb.map_or(Vec3::ONE, |c| Vec3::from_slice(&c)),
            warm: match number("enableColorTemperature", 0.0)? != 0.0 {
                true => Some(number("colorTemperature", 6500.0)?.clamp(1000.0, 40_000.0) as f32),
                false => None,
            },
            normalize: number("normalize", 0.0)? != 0.0,
            is_selective: number("diffuse", 1.0)? != 1.0 || number("specular", 1.0)? != 1.0,
        })
    }

    /// Light of so many of its units.
    fn light(&self, luminance: f64) -> Spectrum {
        let (rgb, luminance) = (self.rgb, luminance as f32);
        match self.warm {
            Some(kelvin) if rgb == Vec3::ONE => blackbody_with_luminance(kelvin, luminance.max(1e-30)),
            Some(kelvin) => {
                let black = blackbody_with_luminance(kelvin, 1.0);
                Spectrum::light_from_rgb(rgb * color::srgb_of_light(|nm| black.at(nm)).max(Vec3::ZERO) * luminance)
            }
            None => Spectrum::light_from_rgb(rgb.max(Vec3::ZERO) * luminance),
        }
    }
}

/// What a mesh sends out that is a light.
pub(super) struct MeshLight {
    pub spectrum: Spectrum,
    pub sync: MaterialSync,
}

/// What the material of a mesh does to its light. Source: OpenUSD, `UsdLuxLightAPI`, `materialSyncMode`.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum MaterialSync {
    /// Its glow multiplies the light.
    GlowTintsLight,
    /// It scatters, and the light is what the light says.
    Independent,
    /// It does not count.
    NoMaterial,
}

/// The light that a mesh is, if it is one. Fails where a value of it is damaged in its file. Source: OpenUSD, `UsdLuxMeshLightAPI`.
pub(super) fn of_mesh(world: &mut World, prim: &Prim) -> Result<Option<MeshLight>, SceneError> {
    let stage = &world.stage;
    if !stage.has_schema(prim, "MeshLightAPI")? {
        return Ok(None);
    }
    let power = Power::read(stage, prim, 1.0)?;
    let mode = stage.value(prim, "light:materialSyncMode")?;
    let sync = match mode.as_ref().and_then(Value::text).map(|m| m.to_string()).as_deref() {
        Some("noMaterialResponse") => MaterialSync::NoMaterial,
        Some("independent") => MaterialSync::Independent,
        _ => MaterialSync::GlowTintsLight,
    };
    if power.normalize {
        world.skip_unsupported("normalization of mesh lights");
    }
    if power.is_selective {
        world.skip_unsupported("diffuse and specular factors of lights");
    }
    Ok((power.intensity > 0.0).then(|| MeshLight { spectrum: power.light(power.intensity), sync }))
}

/// Adds a light. Fails where a value of it is damaged in its file, or there are too many things in the scene.
pub fn add(world: &mut World, kind: &str, prim: &Arc<Prim>, place: &Place) -> Result<(), SceneError> {
    if place.instancers > 0 {
        world.skip_unsupported("lights within prototypes of instancers");
        return Ok(());
    }
    let stage = &world.stage;
    let number = |name: &str, default: f64| number(stage, prim, name, default);
    let power = Power::read(stage, prim, if kind == "DistantLight" { 50_000.0 } else { 1.0 })?;
    let Power { intensity, normalize, .. } = power;
    // Without an angle nothing is cut off; what is shaped at all is cut off at 90° by itself, which a ball is not otherwise.
    let widest: f64 = if kind == "SphereLight" { 180.0 } else { 90.0 };
    let usual = if stage.has_schema(prim, "ShapingAPI")? { 90.0 } else { widest };
    let cone = number("shaping:cone:angle", usual)?.clamp(0.01, widest);
    let focus = number("shaping:focus", 0.0)?.clamp(0.0, 1e4);
    let softness = number("shaping:cone:softness", 0.0)?.clamp(0.0, 1.0);
    let file = stage.attribute(prim, "inputs:texture:file")?.or(stage.attribute(prim, "texture:file")?);
    let file = file.and_then(|f| f.value.text().filter(|t| !t.is_empty()).map(|t| (t.to_string(), f.layer)));
    let ies = stage.attribute(prim, "inputs:shaping:ies:file")?.is_some();
    let (radius, angle) = (number("radius", 0.5)?.max(0.0), number("angle", 0.53)?.clamp(0.0, 359.0));
    let (width, height, length) =
        (number("width", 1.0)?.max(0.0), number("height", 1.0)?.max(0.0), number("length", 1.0)?.max(0.0));
    let as_point =
        kind == "SphereLight" && (stage.value(prim, "treatAsPoint")?.and_then(|v| v.number()) == Some(1.0) || radius == 0.0);
    let pole_is_z = kind == "DomeLight_1" && {
        let pole = stage.value(prim, "poleAxis")?;
        match pole.as_ref().and_then(Value::text).map(|t| t.to_string()).as_deref() {
            Some("Y") => false,
            Some("Z") => true,
            _ => world.is_z_up,
        }
    };
    let tint = stage.attribute(prim, "inputs:shaping:focusTint")?.or(stage.attribute(prim, "shaping:focusTint")?);
    let has_tint = tint.and_then(|t| t.value.floats()).is_some_and(|t| focus > 0.0 && t.iter().any(|v| *v != 0.0));
    let linked = |name: &str| -> Result<bool, SceneError> {
        let excludes = !stage.targets(prim, &format!("collection:{name}:excludes"), Key::TargetPaths)?.is_empty();
        Ok(excludes || stage.value(prim, &format!("collection:{name}:includeRoot"))?.and_then(|v| v.number()) == Some(0.0))
    };
    let is_linked = linked("lightLink")? || linked("shadowLink")?;
    let is_filtered = !stage.targets(prim, "light:filters", Key::TargetPaths)?.is_empty();
    let format = stage.attribute(prim, "inputs:texture:format")?.or(stage.attribute(prim, "texture:format")?);
    let format = format.and_then(|f| f.value.text().map(|t| t.to_string()));
    let is_other_format = file.is_some() && format.is_some_and(|f| !matches!(f.as_str(), "automatic" | "latlong"));
    let throws_none = number("shadow:enable", 1.0)? == 0.0;
    for (is_left_out, what) in [
        (throws_none, "lights that throw no shadows"),
        (has_tint, "tints of the focus of lights"),
        (is_linked, "links of lights with what they light"),
        (is_filtered, "filters of lights"),
        (is_other_format, "formats of dome pictures: all are read as latlong"),
    ] {
        if is_left_out {
            world.skip_unsupported(what);
        }
    }
    if ies {
        world.skip_unsupported("IES profiles of lights");
    }
    if power.is_selective {
        world.skip_unsupported("diffuse and specular factors of lights");
    }
    let light = |luminance: f64| power.light(luminance);
    // Area in scene units: the light's own size, as its place scales it.
    let axes = [place.world.x_axis, place.world.y_axis, place.world.z_axis].map(|a| a.truncate().length() / world.unit_m);
    let area = match kind {
        "SphereLight" => 4.0 * PI * radius * radius * (axes[0] * axes[1] * axes[2]).powf(2.0 / 3.0),
        "DiskLight" => PI * radius * radius * axes[0] * axes[1],
        "RectLight" => width * height * axes[0] * axes[1],
        "CylinderLight" => 2.0 * PI * radius * length * axes[0] * (axes[1] * axes[2]).sqrt(),
        _ => 1.0,
    };
    let luminance = if normalize && area > 0.0 { intensity / area } else { intensity };
    let name = prim.name().to_owned();
    let has_axis = matches!(kind, "SphereLight" | "DiskLight" | "RectLight");
    let shaped = has_axis && (cone < widest || focus > 0.0);
    if !has_axis && focus > 0.0 {
        world.skip_unsupported("focus of lights of other kinds than spheres, disks and rectangles");
    }
    if as_point || shaped {
        // As much as the whole light would send ahead, in m².
        let seen = if kind == "SphereLight" { 0.25 } else { 1.0 };
        let candela = if area > 0.0 { luminance * area * world.unit_m * world.unit_m * seen } else { intensity * 0.25 };
        if shaped && !as_point {
            world.skip_unsupported("sizes of lights with a cone or a focus");
        }
        let outer = cone.to_radians();
        let (position, direction) = (Vec3::ZERO, Vec3::NEG_Z);
        // Flat lights are seen the smaller the farther to the side.
        let exponent = if kind == "SphereLight" { focus } else { focus + 1.0 };
        if shaped && (exponent > 0.0 || softness > 0.0 || cone >= 90.0) {
            let softness = if cone < widest { softness } else { 0.0 };
            let web = spot_table(exponent, outer, softness);
            let carrier = Some(world.node_at(place, &name));
            let pattern = web.map(|w| Arc::new(Pattern::measured(w, Mat3::IDENTITY)));
            let lamp = Punctual::new(&name, light(candela), PunctualKind::Point { position });
            world.description.punctual.push(Punctual { carrier, pattern, ..lamp });
            return Ok(());
        }
        let kind = match shaped {
            true => PunctualKind::Spot {
                position,
                direction,
                cos_inner: outer.cos() as f32,
                cos_outer: outer.cos() as f32,
                edge: SpotEdge::Smooth,
            },
            false => PunctualKind::Point { position },
        };
        punctual(world, &name, light(candela), kind, place);
        return Ok(());
    }
    match kind {
        "DistantLight" => {
            let half = (0.5 * angle).to_radians();
            // What a level plane gets of its luminance.
            let projected = PI * half.min(0.5 * PI).sin().powi(2);
            let lux = if projected < 1e-9 || normalize { intensity } else { intensity * projected };
            let direction = Vec3::NEG_Z;
            let kind = match half < 1e-4 {
                true => PunctualKind::Directional { direction },
                false => PunctualKind::Disc { direction, half_angle: half.min(0.5 * PI) as f32 },
            };
            punctual(world, &name, light(lux), kind, place);
        }
        "DomeLight" | "DomeLight_1" => dome(world, file, light(luminance), place, pole_is_z)?,
        _ => {
            let own = match file {
                Some((file, layer)) if kind == "RectLight" => {
                    let read = world.stage.file(layer, &file).and_then(|bytes| read_texture(&bytes));
                    read.map_err(|reason| note_missing(&mut world.description.missing_textures, &file, reason)).ok()
                }
                _ => None,
            };
            let radiance = match own {
                Some(image) => {
                    world.description.declares_lamps = true;
                    let whole = light(luminance);
                    let factor = color::srgb_of_light(|nm| whole.at(nm)).max(Vec3::ZERO);
                    EmissionColor::Textured { factor, texture: Texture::color(Arc::new(image)) }
                }
                None => EmissionColor::Constant(light(luminance)),
            };
            let emission = Emission { radiance, two_sided: false, is_light: true, modulation: Modulation::Steady };
            let lamp = Material { emission: Some(emission), ..Material::new(&name, Scattering::Black) };
            let material = world.push_material(lamp);
            match kind {
                "SphereLight" => world.draw_ball(&name, radius, material, place)?,
                "DiskLight" => world.draw_mesh(&name, geometry::disc(radius, -1.0), material, place)?,
                "CylinderLight" => world.draw_mesh(&name, geometry::tube(radius, length), material, place)?,
                _ => {
                    // Seen from where it shines, −x is to the right.
                    let half = [Vec3::NEG_X * (0.5 * width) as f32, Vec3::Y * (0.5 * height) as f32];
                    world.draw_mesh(&name, geometry::rectangle(Vec3::ZERO, half), material, place)?;
                }
            }
        }
    }
    Ok(())
}

/// Intensity of a spot over that on its axis, by the angle to it: a power of the cosine up to an edge (rad), which begins to fade at `1 − softness` of its angle. Backwards it is as
/// strong. Source: OpenUSD, `UsdLuxShapingAPI`.
fn spot_table(exponent: f64, edge: f64, softness: f64) -> Option<Web> {
    let inner = edge * (1.0 - softness);
    let intensity = |angle: f64| {
        let cos = angle.cos().abs();
        let t = if softness > 0.0 { ((edge - angle) / (edge - inner)).clamp(0.0, 1.0) } else { 1.0 };
        (cos.powf(exponent) * t * t * (3.0 - 2.0 * t)) as f32
    };
    let angles = (0..=STEPS).map(|i| edge * i as f64 / STEPS as f64);
    let (degrees, candela) = angles.map(|angle| (angle.to_degrees() as f32, intensity(angle))).unzip();
    Web::round(degrees, candela).ok()
}

/// Adds a light without extent, carried by what its prim hangs on.
fn punctual(world: &mut World, name: &str, power: Spectrum, kind: PunctualKind, place: &Place) {
    let carrier = Some(world.node_at(place, name));
    world.description.punctual.push(Punctual { carrier, ..Punctual::new(name, power, kind) });
}

/// Light from all around. Of a picture the middle is +z and +x to the left of it (OpenEXR's latitude-longitude map); ours has −z and +x to the right.
fn dome(
    world: &mut World,
    file: Option<(String, usize)>,
    light: Spectrum,
    place: &Place,
    pole_is_z: bool,
) -> Result<(), SceneError> {
    let factor = color::srgb_of_light(|nm| light.at(nm)).max(Vec3::ZERO);
    let map = match file {
        None => None,
        Some((file, layer)) => match world.stage.file(layer, &file).and_then(|bytes| read_light_picture(&bytes)) {
            Ok(map) if map.width > 0 && map.height > 0 => Some(map),
            Ok(_) => None,
            Err(reason) => {
                note_missing(&mut world.description.missing_textures, &file, reason);
                world.skip_unsupported("pictures of domes, which shine evenly without");
                None
            }
        },
    };
    let own = match map {
        None => Environment::uniform(factor),
        Some(mut map) => {
            map.data.as_chunks_mut::<3>().0.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] *= factor[c]));
            let unit = |v: glam::DVec4| v.truncate().try_normalize().unwrap_or(DVec3::ZERO).as_vec3();
            let m = place.world;
            let mut turn = Mat3::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis));
            if pole_is_z {
                turn *= Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2);
            }
            Environment::new(map, turn * Mat3::from_rotation_y(std::f32::consts::PI), 1.0)
        }
    };
    if place.node.is_some() {
        world.skip_unsupported("motion of domes");
    }
    world.description.environment = Some(match world.description.environment.take() {
        Some(first) => first.plus(&own),
        None => own,
    });
    Ok(())
}

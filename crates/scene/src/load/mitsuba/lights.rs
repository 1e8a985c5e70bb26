//! Emitters. Source: Mitsuba 3, plugin reference (emitters); its environment maps have +z in the middle and −x to the right of it.

use super::context::Context;
use super::tree::Node;
use super::values::{Shade, number, text, transform, vector};
use super::wrong;
use crate::SceneError;
use crate::light::{Environment, Modulation, Punctual, PunctualKind, SpotEdge};
use crate::load::read_light_picture;
use crate::material::{Emission, EmissionColor};
use crate::texture::Color;
use glam::{DMat4, DVec3, Mat3};
use std::sync::Arc;

type Read<T> = Result<T, SceneError>;

/// The light of a surface.
pub fn emission(context: &mut Context, node: &Arc<Node>) -> Read<Emission> {
    if node.kind() != "area" {
        return Err(wrong(node, format!("emitter \"{}\" of a shape", node.kind()), "area"));
    }
    let is_texture = |child: &Arc<Node>| context.resolved(child).map(|c| c.tag == "texture");
    let radiance = match node.child("radiance").map(is_texture).transpose()? {
        Some(false) | None => EmissionColor::Constant(context.shade(node, "radiance")?.unwrap_or(Shade::Even(1.0)).light(1.0)),
        Some(true) => match context.color(node, "radiance", 1.0)? {
            Color::Textured { factor, texture } => {
                context.description.declares_lamps = true;
                EmissionColor::Textured { factor, texture }
            }
            _ => return Err(wrong(node, "a pattern as radiance", "a colour, a spectrum or a bitmap")),
        },
    };
    Ok(Emission { radiance, two_sided: false, is_light: true, modulation: Modulation::Steady })
}

/// A light of its own.
pub fn add(context: &mut Context, node: &Arc<Node>) -> Read<()> {
    let place = transform(node, "to_world")?;
    let light = |context: &Context, name: &str| Ok(context.shade(node, name)?.unwrap_or(Shade::Even(1.0)).light(1.0));
    let unit =
        |v: DVec3| v.try_normalize().map(|v| v.as_vec3()).ok_or_else(|| wrong(node, "a direction of no length", "x, y and z"));
    let name = node.get("id").map_or_else(|| format!("light {}", context.description.punctual.len()), str::to_owned);
    match node.kind() {
        "point" => {
            let position = place.transform_point3(vector(node, "position", DVec3::ZERO)?).as_vec3();
            let light = light(context, "intensity")?;
            context.description.punctual.push(Punctual::new(&name, light, PunctualKind::Point { position }));
        }
        "spot" => {
            let cutoff = number(node, "cutoff_angle", 20.0)?;
            let beam = number(node, "beam_width", 0.75 * cutoff)?;
            if !(cutoff > 0.0 && cutoff <= 180.0 && (0.0..=cutoff).contains(&beam)) {
                return Err(wrong(
                    node,
                    format!("cutoff_angle {cutoff}, beam_width {beam}"),
                    "angles from 0 to 180 degrees, the beam within",
                ));
            }
            if node.child("texture").is_some() {
                context.skip_unsupported("pictures of spots");
            }
            let kind = PunctualKind::Spot {
                position: place.w_axis.truncate().as_vec3(),
                direction: unit(place.transform_vector3(DVec3::Z))?,
                cos_inner: beam.to_radians().cos() as f32,
                cos_outer: cutoff.to_radians().cos() as f32,
                edge: SpotEdge::LinearInAngle,
            };
            let light = light(context, "intensity")?;
            context.description.punctual.push(Punctual::new(&name, light, kind));
        }
        "directional" => {
            let ahead = match node.child("direction") {
                Some(_) => vector(node, "direction", DVec3::Z)?,
                None => place.transform_vector3(DVec3::Z),
            };
            let kind = PunctualKind::Directional { direction: unit(ahead)? };
            let light = light(context, "irradiance")?;
            context.description.punctual.push(Punctual::new(&name, light, kind));
        }
        "constant" => {
            let light = light(context, "radiance")?;
            surround(context, Environment::even(light));
        }
        "envmap" => {
            let file = text(node, "filename")
                .ok_or_else(|| wrong(node, "an envmap without filename", "<string name=\"filename\" .../>"))?;
            let read = (context.fetch)(file)
                .and_then(|bytes| read_light_picture(&bytes))
                .map_err(|e| wrong(node, format!("{file}: {e}"), "a picture of light"))?;
            if read.width == 0 || read.height == 0 {
                return Err(wrong(node, format!("{file}: no pixels"), "a picture of light"));
            }
            let scale = number(node, "scale", 1.0)?.max(0.0) as f32;
            surround(context, Environment::new(read, turned(place) * Mat3::from_rotation_y(std::f32::consts::PI), scale));
        }
        // Defined here to be referred to by shapes.
        "area" => (),
        "sunsky" | "sun" | "sky" => {
            node.leave_out();
            context.skip_unsupported(format!("emitter \"{}\": --sun or --daylight give a sky", node.kind()));
        }
        other => {
            let known = "area (of a shape), point, spot, directional, constant or envmap: others are not supported";
            return Err(wrong(node, format!("emitter \"{other}\""), known));
        }
    }
    Ok(())
}

fn turned(place: DMat4) -> Mat3 {
    let unit = |v: glam::DVec4| v.truncate().try_normalize().unwrap_or(DVec3::ZERO).as_vec3();
    Mat3::from_cols(unit(place.x_axis), unit(place.y_axis), unit(place.z_axis))
}

fn surround(context: &mut Context, own: Environment) {
    context.description.environment = Some(match context.description.environment.take() {
        Some(first) => first.plus(&own),
        None => own,
    });
}

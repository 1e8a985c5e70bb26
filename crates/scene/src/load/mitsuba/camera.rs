//! Sensors. Source: Mitsuba 3, plugin reference (sensors): they look along +z with +x to the left.

use super::context::{Context, affine};
use super::tree::Node;
use super::values::{number, text, transform};
use super::wrong;
use crate::SceneError;
use crate::scene::{CameraProjection, FilmHints, Viewpoint};
use glam::{DMat4, DVec3};

/// Diagonal of the film that a focal length is of, mm.
const FULL_FRAME_MM: f64 = 43.266_615;

/// Adds a camera, in metres. Fails with the line where its film, `fov`, `focal_length`, `to_world` or lens is out of range or no number; of a kind that is not known it
/// is left out.
pub fn add(context: &mut Context, node: &Node) -> Result<(), SceneError> {
    let film = node.tagged("film").next();
    let side = |name: &str, default: f64| -> Result<usize, SceneError> {
        let n = film.map_or(Ok(default), |f| number(f, name, default))?;
        match (1.0..=65_535.0).contains(&n) {
            true => Ok(n as usize),
            false => Err(wrong(node, format!("{name} {n}"), "1 to 65535")),
        }
    };
    let size = [side("width", 768.0)?, side("height", 576.0)?];
    let aspect = size[0] as f64 / size[1] as f64;
    let place = transform(node, "to_world")?;
    let sight = match node.kind() {
        "perspective" | "thinlens" => {
            // Tangents of half angles: of the width 1 : height 1 / aspect.
            let given = text(node, "focal_length");
            let is_angle = given.is_none() && node.child("fov").is_some();
            let (axis, half) = match Some(given.unwrap_or("50mm")).filter(|_| !is_angle) {
                Some(focal) => {
                    let mm = focal.trim_end_matches("mm").trim().parse::<f64>().ok().filter(|f| *f > 0.0 && f.is_finite());
                    let mm = mm.ok_or_else(|| wrong(node, format!("focal_length \"{focal}\""), "millimetres, such as 50mm"))?;
                    ("diagonal", 0.5 * FULL_FRAME_MM / mm)
                }
                None => {
                    let fov = number(node, "fov", 0.0)?;
                    if !(0.001..180.0).contains(&fov) {
                        return Err(wrong(node, format!("fov {fov}"), "an angle from 0.001 to below 180 degrees"));
                    }
                    (text(node, "fov_axis").unwrap_or("x"), (0.5 * fov).to_radians().tan())
                }
            };
            let wide = aspect >= 1.0;
            let half_height = match axis {
                "x" => half / aspect,
                "y" => half,
                "diagonal" => half / (1.0 + aspect * aspect).sqrt(),
                "smaller" => {
                    if wide {
                        half
                    } else {
                        half / aspect
                    }
                }
                "larger" => {
                    if wide {
                        half / aspect
                    } else {
                        half
                    }
                }
                other => return Err(wrong(node, format!("fov_axis \"{other}\""), "x, y, diagonal, smaller or larger")),
            };
            CameraProjection::Perspective { vertical_fov: (2.0 * half_height.atan()) as f32 }
        }
        "orthographic" if (place.x_axis.truncate().length() / place.y_axis.truncate().length() - 1.0).abs() > 1e-3 => {
            let [x, y] = [place.x_axis, place.y_axis].map(|axis| axis.truncate().length());
            return Err(wrong(
                node,
                format!("an orthographic sensor scaled by {x:.4} across and {y:.4} upwards"),
                "one scale: pixels are square",
            ));
        }
        "orthographic" => CameraProjection::Orthographic { height: (2.0 * place.y_axis.truncate().length() / aspect) as f32 },
        other => {
            node.leave_out();
            context.skip_unsupported(format!("sensor \"{other}\""));
            return Ok(());
        }
    };
    for name in ["principal_point_offset_x", "principal_point_offset_y"] {
        if number(node, name, 0.0)? != 0.0 {
            context.skip_unsupported("shifts of the principal point");
        }
    }
    if let Some(medium) = context.nested(node, "medium", None)? {
        // Where the sensor stands is found from what is around it.
        medium.leave_out();
        context.has_sensor_in_medium = true;
    }
    if place.determinant() < 0.0 {
        context.skip_unsupported("the mirroring of a sensor");
    }
    if film.is_some_and(|f| f.children.iter().any(|c| c.get("name").is_some_and(|name| name.starts_with("crop_")))) {
        context.skip_unsupported("crops of the film");
    }
    let lens = match node.kind() {
        "thinlens" => {
            let (radius, focus) = (number(node, "aperture_radius", 0.0)?, number(node, "focus_distance", 1.0)?);
            if !((0.0..=1e3).contains(&radius) && focus > 0.0) {
                return Err(wrong(
                    node,
                    format!("aperture_radius {radius}, focus_distance {focus}"),
                    "lengths of at least and above 0",
                ));
            }
            Some([radius as f32, focus as f32])
        }
        // A pinhole: all is sharp.
        "perspective" => Some([0.0, number(node, "focus_distance", 1e6)?.max(1e-3) as f32]),
        _ => None,
    };
    // Ours looks along −z with +x to the right.
    let m = place * DMat4::from_scale(DVec3::new(-1.0, 1.0, -1.0));
    let unit = |v: glam::DVec4| v.truncate().normalize_or_zero().extend(0.0);
    context.description.cameras.push(Viewpoint {
        name: node.get("id").unwrap_or("camera").to_owned(),
        world_from_camera: affine(DMat4::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis), m.w_axis)),
        sight,
        lens,
        film: FilmHints { size: (size[0] * size[1] <= 100_000_000).then_some(size), ..FilmHints::default() },
        node: None,
    });
    Ok(())
}

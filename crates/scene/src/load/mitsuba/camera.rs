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
    let full = [side("width", 768.0)?, side("height", 576.0)?];
    let aspect = full[0] as f64 / full[1] as f64;
    // Columns and rows of the picture, and how many of the film are left of and above it. Source: Mitsuba 3, `Film::set_crop_window`.
    let crop = |name: &str, default: usize| film.map_or(Ok(default as f64), |f| number(f, name, default as f64));
    let [size, corner] = [[("crop_width", full[0]), ("crop_height", full[1])], [("crop_offset_x", 0), ("crop_offset_y", 0)]];
    let [columns, rows] = size.map(|(name, default)| crop(name, default));
    let [left, top] = corner.map(|(name, default)| crop(name, default));
    let [columns, rows, left, top] = [columns?, rows?, left?, top?];
    if !(columns >= 1.0
        && rows >= 1.0
        && left >= 0.0
        && top >= 0.0
        && left + columns <= full[0] as f64
        && top + rows <= full[1] as f64)
    {
        let found = format!("a crop of {columns} x {rows} pixels from {left}, {top} on");
        return Err(wrong(node, found, format!("pixels of the film, {} x {}", full[0], full[1])));
    }
    let size = [columns as usize, rows as usize];
    // Of the film that is in the picture.
    let part = rows / full[1] as f64;
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
            CameraProjection::Perspective { vertical_fov: (2.0 * (part * half_height).atan()) as f32 }
        }
        "orthographic" if (place.x_axis.truncate().length() / place.y_axis.truncate().length() - 1.0).abs() > 1e-3 => {
            let [x, y] = [place.x_axis, place.y_axis].map(|axis| axis.truncate().length());
            return Err(wrong(
                node,
                format!("an orthographic sensor scaled by {x:.4} across and {y:.4} upwards"),
                "one scale: pixels are square",
            ));
        }
        "orthographic" => {
            CameraProjection::Orthographic { height: (2.0 * part * place.y_axis.truncate().length() / aspect) as f32 }
        }
        other => {
            node.leave_out();
            context.skip_unsupported(format!("sensor \"{other}\""));
            return Ok(());
        }
    };
    // A pixel shows what one that lies so far to the right and below would show, in parts of the film.
    let offset = match node.kind() {
        "perspective" => [number(node, "principal_point_offset_x", 0.0)?, number(node, "principal_point_offset_y", 0.0)?],
        _ => [0.0; 2],
    };
    let [w, h] = full.map(|n| n as f64);
    let shift =
        [left + 0.5 * (columns - w) + offset[0] * w, -(top + 0.5 * (rows - h) + offset[1] * h)].map(|pixels| pixels / rows);
    if !shift.iter().all(|s| s.is_finite()) {
        return Err(wrong(node, format!("principal_point_offset {offset:?}"), "parts of the film"));
    }
    if let Some(medium) = context.nested(node, "medium", None)? {
        // Where the sensor stands is found from what is around it.
        medium.leave_out();
        context.has_sensor_in_medium = true;
    }
    if place.determinant() < 0.0 {
        context.skip_unsupported("the mirroring of a sensor");
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
        film: FilmHints { size: (size[0] * size[1] <= 100_000_000).then_some(size), shift, ..FilmHints::default() },
        node: None,
    });
    Ok(())
}

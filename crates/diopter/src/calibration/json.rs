//! Our own JSON: everything that is known of a camera.

use super::camera_file::CameraFile;
use super::{Calibration, CalibrationError, CameraModel, Fit, Frame, ModelKind, Pose, wrong};
use diopter_lens::CalibratedLens;
use glam::DVec2;
use serde_json::{Value, json};

/// What stands in `format`.
pub const FORMAT: &str = "diopter calibration";

/// The text of the file.
pub fn write(c: &Calibration) -> String {
    let value = json!({
        "format": FORMAT,
        "version": 1,
        "conventions": "pixels: centre of the upper left pixel at (0, 0); camera of model and directions: x right, y down, z forward; world: metres, right-handed, y up",
        "camera": {
            "body": c.body, "lens": c.lens, "focal_length_mm": c.focal_length_mm, "f_number": c.f_number,
            "focus_distance_m": c.focus_distance_m,
        },
        "image": { "width": c.size[0], "height": c.size[1], "film_mm": c.film_mm },
        "model": model(&c.model),
        "fit": c.fit.as_ref().map(fit),
        "relative_illumination": (!c.falloff.is_empty()).then(|| json!({
            "over": "distance from the middle of the picture, from 0 to half the diagonal, at equal steps",
            "values": c.falloff,
        })),
        "frames": c.frames.iter().map(frame).collect::<Vec<_>>(),
    });
    format!("{value:#}\n")
}

/// A model.
pub fn model(m: &CameraModel) -> Value {
    let named: serde_json::Map<String, Value> =
        m.kind().coefficients().iter().zip(m.coefficients()).map(|(n, v)| ((*n).to_owned(), json!(v))).collect();
    json!({
        "name": m.kind().name(), "fx": m.focal().x, "fy": m.focal().y, "cx": m.centre().x, "cy": m.centre().y,
        "coefficients": named, "largest_angle_deg": m.largest_angle().to_degrees(),
    })
}

/// How well it fits, with the map of differences, where there is one.
pub fn fit(f: &Fit) -> Value {
    let rows: Vec<Vec<Option<[f64; 2]>>> =
        f.map.chunks(f.grid[0]).map(|row| row.iter().map(|d| d.map(|d| d.to_array())).collect()).collect();
    json!({
        "rms_px": f.rms_px, "max_px": f.max_px, "fitted_angle_deg": f.fitted_angle.to_degrees(),
        "seen_angle_deg": f.seen_angle.to_degrees(), "points_fitted": f.fitted[0], "points_seen": f.fitted[1],
        "map": (!rows.is_empty()).then(|| json!({ "columns": f.grid[0], "rows": f.grid[1], "model_minus_lens_px": rows })),
    })
}

fn frame(f: &Frame) -> Value {
    let mut value = json!({ "file": f.picture, "at_s": f.at_s, "poses": f.poses.iter().map(pose).collect::<Vec<_>>() });
    if let Some((own, focus)) = &f.camera {
        (value["model"], value["focus_distance_m"]) = (model(own), json!(focus));
    }
    if !f.moving.is_empty() {
        let rows = f.moving.iter().map(|s| [s.time_s, s.at_mm.x, s.at_mm.y, s.picture_px.x, s.picture_px.y]);
        value["stabiliser"] = json!({
            "columns": ["time_s", "right_mm", "up_mm", "picture_right_px", "picture_down_px"],
            "path": rows.collect::<Vec<_>>(),
        });
    }
    value
}

fn pose(p: &Pose) -> Value {
    let (q, t) = p.opencv();
    json!({
        "line": p.row, "when": p.when, "time_s": p.time_s,
        "world_from_camera_opengl": p.opengl_rows(),
        "camera_from_world_opencv": { "quaternion_wxyz": [q.w, q.x, q.y, q.z], "translation_m": t.to_array() },
    })
}

/// Reads the camera of such a file; poses are left.
pub(super) fn read(v: &Value, name: &str) -> Result<CameraFile, CalibrationError> {
    let field = |of: &Value, path: &[&str]| path.iter().try_fold(of.clone(), |v, k| v.get(*k).cloned()).filter(|v| !v.is_null());
    let missing = |path: &[&str]| wrong(name, format!("no {}", path.join(".")), "a calibration that `lens calibrate` wrote");
    let float = |path: &[&str]| field(v, path).and_then(|v| v.as_f64()).ok_or_else(|| missing(path));
    let count = |path: &[&str]| field(v, path).and_then(|v| v.as_u64()).map(|n| n as usize).ok_or_else(|| missing(path));
    let kind = field(v, &["model", "name"])
        .and_then(|n| ModelKind::named(n.as_str()?))
        .ok_or_else(|| wrong(name, "a model.name that is not known", ModelKind::NAMES.map(|n| n.0).join(", ")))?;
    let k = kind.coefficients().iter().map(|n| float(&["model", "coefficients", n])).collect::<Result<Vec<_>, _>>()?;
    let focal = DVec2::new(float(&["model", "fx"])?, float(&["model", "fy"])?);
    let centre = DVec2::new(float(&["model", "cx"])?, float(&["model", "cy"])?);
    let numbers = |path: &[&str]| -> Option<Vec<f64>> { field(v, path)?.as_array()?.iter().map(Value::as_f64).collect() };
    Ok(CameraFile {
        size: Some([count(&["image", "width"])?, count(&["image", "height"])?]),
        model: CameraModel::new(kind, focal, centre, k).map_err(|e| wrong(name, e.to_string(), "a model that has a range"))?,
        falloff: numbers(&["relative_illumination", "values"]).unwrap_or_default(),
        film_mm: numbers(&["image", "film_mm"]).and_then(|v| v.try_into().ok()),
    })
}

/// The calibration that an ideal camera is; `None` of one that is a table of rays.
pub fn of_ideal(lens: &CalibratedLens) -> Option<CameraModel> {
    match lens.view() {
        diopter_lens::calibrated::View::Model(model) => Some(model.clone()),
        diopter_lens::calibrated::View::Rays(_) => None,
    }
}

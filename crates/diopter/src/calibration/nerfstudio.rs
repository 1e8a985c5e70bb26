//! `transforms.json` of nerfstudio and Instant-NGP.
//!
//! The centre of the upper left pixel is (0.5, 0.5); poses are world from camera with OpenGL's axes. nerfstudio's `OPENCV` has a polynomial with k1, k2, k3 and p1, p2;
//! Instant-NGP reads k1, k2, p1, p2 of it. Source: nerfstudio documentation, "Data conventions", and cameras/camera_utils.py; Instant-NGP docs/nerf_dataset_tips.md.

use super::camera_file::CameraFile;
use super::{Calibration, CalibrationError, CameraModel, ModelKind, wrong};
use glam::DVec2;
use serde_json::{Value, json};

const HALF: DVec2 = DVec2::splat(0.5);

/// The text of the file. Fails on a model that nerfstudio does not have, such as opencv8 or double-sphere.
pub fn write(c: &Calibration) -> Result<String, CalibrationError> {
    let has_own = c.frames.iter().any(|f| f.camera.is_some());
    let frames = c.frames.iter().filter_map(|f| {
        let pose = f.middle()?;
        let frame = json!({ "file_path": f.picture, "transform_matrix": pose.opengl_rows(), "time": f.at_s + pose.time_s });
        let own = f.camera.as_ref().map_or(&c.model, |(model, _)| model);
        // Readers take what stands for all before what stands with a picture: then each has its own.
        Some(if has_own { intrinsics(c, own).map(|i| joined(frame, i)) } else { Ok(frame) })
    });
    let frames = frames.collect::<Result<Vec<Value>, _>>()?;
    let mut v = match has_own {
        true => json!({ "camera_model": intrinsics(c, &c.model)?["camera_model"] }),
        false => intrinsics(c, &c.model)?,
    };
    v["frames"] = json!(frames);
    Ok(format!("{v:#}\n"))
}

/// The entries of one object and those of another.
fn joined(mut to: Value, from: Value) -> Value {
    if let (Value::Object(to), Value::Object(from)) = (&mut to, from) {
        to.extend(from);
    }
    to
}

/// What says a camera. Fails on a model that nerfstudio does not have.
fn intrinsics(c: &Calibration, model: &CameraModel) -> Result<Value, CalibrationError> {
    let k = |i: usize| model.coefficients().get(i).copied().unwrap_or(0.0);
    let (f, m) = (model.focal(), model.centre() + HALF);
    let [width, height] = c.size;
    let view = |pixels: usize, focal: f64| 2.0 * (0.5 * pixels as f64 / focal).atan();
    let size = json!({
        "fl_x": f.x, "fl_y": f.y, "cx": m.x, "cy": m.y, "w": width, "h": height,
        "camera_angle_x": view(width, f.x), "camera_angle_y": view(height, f.y),
    });
    let coefficients = match model.kind() {
        ModelKind::Fisheye | ModelKind::Equidistant => {
            json!({ "is_fisheye": true, "camera_model": "OPENCV_FISHEYE", "k1": k(0), "k2": k(1), "k3": k(2), "k4": k(3) })
        }
        ModelKind::Pinhole | ModelKind::SimpleRadial | ModelKind::Radial | ModelKind::OpenCv4 | ModelKind::OpenCv5 => {
            json!({ "camera_model": "OPENCV", "k1": k(0), "k2": k(1), "p1": k(2), "p2": k(3), "k3": k(4) })
        }
        _ => {
            let models = "pinhole, simple-radial, radial, opencv4 (for Instant-NGP), opencv5, opencv-fisheye, equidistant";
            return Err(c.cannot("transforms.json", models));
        }
    };
    Ok(joined(size, coefficients))
}

/// Reads the camera (of the file, or of its first frame).
pub(super) fn read(v: &Value, name: &str) -> Result<CameraFile, CalibrationError> {
    let first = v.get("frames").and_then(|f| f.get(0));
    let find = |key: &str| v.get(key).or_else(|| first.and_then(|f| f.get(key)));
    let float = |key: &str| find(key).and_then(Value::as_f64);
    let size = float("w")
        .zip(float("h"))
        .map(|(w, h)| [w as usize, h as usize])
        .ok_or_else(|| wrong(name, "no w and h", "the size of the pictures"))?;
    let angle = |key: &str, pixels: usize| float(key).map(|a| 0.5 * pixels as f64 / (0.5 * a).tan());
    let fx = float("fl_x").or_else(|| angle("camera_angle_x", size[0]));
    let fx = fx.ok_or_else(|| {
        let found = match ["fl_x", "camera_angle_x"].iter().find_map(|key| Some(format!("{key} = {}", find(key)?))) {
            Some(other) => other,
            None => "neither fl_x nor camera_angle_x".to_owned(),
        };
        wrong(name, &found, "a focal length in pixels (fl_x) or an angle in radians (camera_angle_x), a number")
    })?;
    let fy = float("fl_y").or_else(|| angle("camera_angle_y", size[1])).unwrap_or(fx);
    let centre = DVec2::new(float("cx").unwrap_or(0.5 * size[0] as f64), float("cy").unwrap_or(0.5 * size[1] as f64)) - HALF;
    let k = |key: &str| float(key).unwrap_or(0.0);
    let fisheye = find("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
    let (kind, coefficients) = match find("camera_model").and_then(Value::as_str) {
        Some("OPENCV_FISHEYE") => (ModelKind::Fisheye, vec![k("k1"), k("k2"), k("k3"), k("k4")]),
        None if fisheye => (ModelKind::Fisheye, vec![k("k1"), k("k2"), k("k3"), k("k4")]),
        None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE") => {
            if k("k4") != 0.0 {
                return Err(wrong(
                    name,
                    "a k4 of a perspective camera",
                    "k1, k2, k3, p1, p2: no other program agrees on its meaning",
                ));
            }
            let mut all = vec![k("k1"), k("k2"), k("p1"), k("p2")];
            let kind = if k("k3") != 0.0 { ModelKind::OpenCv5 } else { ModelKind::OpenCv4 };
            if kind == ModelKind::OpenCv5 {
                all.push(k("k3"));
            }
            (kind, all)
        }
        Some(other) => return Err(wrong(name, format!("camera_model \"{other}\""), "OPENCV, PINHOLE or OPENCV_FISHEYE")),
    };
    let model = CameraModel::new(kind, DVec2::new(fx, fy), centre, coefficients)
        .map_err(|e| wrong(name, e.to_string(), "numbers of a camera"))?;
    Ok(CameraFile { size: Some(size), model, falloff: Vec::new(), film_mm: None })
}

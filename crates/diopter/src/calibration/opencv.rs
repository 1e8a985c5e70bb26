//! OpenCV's FileStorage in YAML, with the names of its calibration samples and of ROS `camera_info`.
//!
//! Source: OpenCV 4 and 5, `FileStorage` and samples/cpp/calibration.cpp (`camera_matrix`, `distortion_coefficients`, `image_width`); ROS sensor_msgs/CameraInfo
//! (`distortion_model`).

use super::camera_file::CameraFile;
use super::{Calibration, CalibrationError, CameraModel, ModelKind, number, numbers, wrong};
use glam::DVec2;
use serde_json::Value;

/// The text of the file. Fails on a model that OpenCV does not have, such as division or double-sphere.
pub fn write(c: &Calibration) -> Result<String, CalibrationError> {
    let models = "pinhole, simple-radial, radial, opencv4, opencv5, opencv8, opencv12, opencv14, opencv-fisheye, equidistant";
    let (k, fisheye) = c.opencv_coefficients().ok_or_else(|| c.cannot("OpenCV", models))?;
    let (f, m) = (c.model.focal(), c.model.centre());
    let model = match (fisheye, k.len()) {
        (true, _) => "equidistant",
        (_, 4 | 5) => "plumb_bob",
        (_, 8) => "rational_polynomial",
        _ => "thin_prism",
    };
    let matrix = |rows: usize, cols: usize, data: &[f64]| {
        format!("!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]", numbers(data, ", "))
    };
    let error = c.fit.as_ref().map_or(String::new(), |fit| format!("avg_reprojection_error: {}\n", number(fit.rms_px)));
    Ok(format!(
        "%YAML 1.0\n---\nimage_width: {}\nimage_height: {}\ncamera_name: {}\ncamera_matrix: {}\ndistortion_model: {model}\n\
         distortion_coefficients: {}\nrectification_matrix: {}\nprojection_matrix: {}\nlargest_angle_deg: {}\n{error}",
        c.size[0],
        c.size[1],
        quoted(&format!("{}, {}", c.body, c.lens)),
        matrix(3, 3, &[f.x, 0.0, m.x, 0.0, f.y, m.y, 0.0, 0.0, 1.0]),
        matrix(1, k.len(), &k),
        matrix(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        matrix(3, 4, &[f.x, 0.0, m.x, 0.0, 0.0, f.y, m.y, 0.0, 0.0, 0.0, 1.0, 0.0]),
        number(c.model.largest_angle().to_degrees()),
    ))
}

/// A text in quotes.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Reads the camera: names as above, `K` and `D` as well; data as matrices or lists.
pub(super) fn read(v: &Value, name: &str) -> Result<CameraFile, CalibrationError> {
    let matrix = |keys: &[&str]| -> Option<Vec<f64>> {
        let found = keys.iter().find_map(|k| v.get(*k))?;
        flat(found.get("data").unwrap_or(found))
    };
    let k = matrix(&["camera_matrix", "K", "M1"]).filter(|k| k.len() == 9).ok_or_else(|| {
        wrong(name, "no camera_matrix of nine numbers", "an OpenCV calibration: camera_matrix, distortion_coefficients")
    })?;
    if k[1].abs() > 1e-9 * k[0].abs() {
        return Err(wrong(name, format!("a skew of {} in camera_matrix", k[1]), "0: pixels with axes at a right angle"));
    }
    let mut d = matrix(&["distortion_coefficients", "D", "dist_coeffs", "D1"]).unwrap_or_default();
    let says = v.get("distortion_model").and_then(Value::as_str).unwrap_or("");
    let fisheye = matches!(says, "equidistant" | "fisheye" | "kannala_brandt")
        || v.get("fisheye_model").is_some_and(|v| v.as_bool().unwrap_or_else(|| v.as_f64().is_some_and(|n| n != 0.0)));
    let kind = match (fisheye, d.len()) {
        (true, 4) => ModelKind::Fisheye,
        (false, 0) => ModelKind::Pinhole,
        (false, 4) => ModelKind::OpenCv4,
        (false, 5) => ModelKind::OpenCv5,
        (false, 8) => ModelKind::OpenCv8,
        (false, 12) => ModelKind::OpenCv12,
        (false, 14) => ModelKind::OpenCv14,
        (_, n) => {
            let expected = if fisheye { "4 of a fisheye" } else { "0, 4, 5, 8, 12 or 14" };
            return Err(wrong(name, format!("{n} distortion coefficients"), expected));
        }
    };
    d.truncate(kind.coefficients().len());
    let count = |keys: [&str; 2]| keys.iter().find_map(|k| v.get(*k)?.as_f64()).map(|n| n as usize);
    let size = count(["image_width", "width"]).zip(count(["image_height", "height"])).map(|(w, h)| [w, h]);
    let model = CameraModel::new(kind, DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5]), d)
        .map_err(|e| wrong(name, e.to_string(), "a camera_matrix and coefficients of a camera"))?;
    Ok(CameraFile { size, model, falloff: Vec::new(), film_mm: None })
}

/// Numbers of a list, or of a list of lists.
fn flat(v: &Value) -> Option<Vec<f64>> {
    let one = |v: &Value| v.as_f64().map(|n| vec![n]).or_else(|| v.as_array()?.iter().map(Value::as_f64).collect());
    Some(v.as_array()?.iter().map(one).collect::<Option<Vec<_>>>()?.concat())
}

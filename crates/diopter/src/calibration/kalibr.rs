//! Kalibr's camera chain (`camchain.yaml`).
//!
//! Pixels as OpenCV's. Source: Kalibr wiki, "Supported models" and "YAML formats": `pinhole` with `radtan`, `equidistant` or `none`, and `ds` with [xi, alpha, fu, fv, pu, pv].

use super::camera_file::CameraFile;
use super::{Calibration, CalibrationError, CameraModel, ModelKind, numbers, wrong};
use glam::DVec2;
use serde_json::Value;

/// The text of the file, of one camera. Fails on a model that Kalibr does not have, such as opencv5 or division.
pub fn write(c: &Calibration) -> Result<String, CalibrationError> {
    let (f, m) = (c.model.focal(), c.model.centre());
    let mut k = c.model.coefficients().to_vec();
    let mut intrinsics = vec![f.x, f.y, m.x, m.y];
    let (camera, distortion) = match c.model.kind() {
        ModelKind::Pinhole => ("pinhole", "none"),
        ModelKind::SimpleRadial | ModelKind::Radial | ModelKind::OpenCv4 => {
            k.resize(4, 0.0);
            ("pinhole", "radtan")
        }
        ModelKind::Fisheye | ModelKind::Equidistant => {
            k.resize(4, 0.0);
            ("pinhole", "equidistant")
        }
        ModelKind::DoubleSphere => {
            intrinsics = [k.split_off(0), intrinsics].concat();
            ("ds", "none")
        }
        _ => {
            return Err(c.cannot("Kalibr", "pinhole, simple-radial, radial, opencv4, opencv-fisheye, equidistant, double-sphere"));
        }
    };
    Ok(format!(
        "cam0:\n  cam_overlaps: []\n  camera_model: {camera}\n  distortion_coeffs: [{}]\n  distortion_model: {distortion}\n  intrinsics: [{}]\n  \
         resolution: [{}, {}]\n  rostopic: /cam0/image_raw\n",
        numbers(&k, ", "),
        numbers(&intrinsics, ", "),
        c.size[0],
        c.size[1],
    ))
}

/// Reads the first camera.
pub(super) fn read(v: &Value, name: &str) -> Result<CameraFile, CalibrationError> {
    let Some(cam) = v.get("cam0") else { return Err(wrong(name, "no cam0", "a camera chain of Kalibr")) };
    let list = |key: &str| -> Option<Vec<f64>> { cam.get(key)?.as_array()?.iter().map(Value::as_f64).collect() };
    let text = |key: &str| cam.get(key).and_then(Value::as_str).unwrap_or("");
    let size = list("resolution").filter(|r| r.len() == 2).map(|r| [r[0] as usize, r[1] as usize]);
    let mut p = list("intrinsics").unwrap_or_default();
    let mut k = list("distortion_coeffs").unwrap_or_default();
    let (camera, distortion) = (text("camera_model"), text("distortion_model"));
    let kind = match (camera, distortion) {
        ("pinhole", "none" | "") => ModelKind::Pinhole,
        ("pinhole", "radtan") => ModelKind::OpenCv4,
        ("pinhole", "equidistant") => ModelKind::Fisheye,
        ("ds", "none" | "") => ModelKind::DoubleSphere,
        _ => {
            let found = format!("camera_model \"{camera}\" with distortion_model \"{distortion}\"");
            return Err(wrong(name, found, "pinhole with radtan, equidistant or none, or ds with none"));
        }
    };
    if kind == ModelKind::DoubleSphere && p.len() == 6 {
        k = p.drain(..2).collect();
    } else if kind == ModelKind::Pinhole {
        k.clear();
    }
    if p.len() != 4 {
        return Err(wrong(name, format!("{} intrinsics", p.len()), "fu, fv, pu, pv (of ds xi and alpha before them)"));
    }
    let model = CameraModel::new(kind, DVec2::new(p[0], p[1]), DVec2::new(p[2], p[3]), k)
        .map_err(|e| wrong(name, e.to_string(), "numbers of a camera"))?;
    Ok(CameraFile { size, model, falloff: Vec::new(), film_mm: None })
}

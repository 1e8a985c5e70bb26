//! Cameras from files of any format: by what they hold.

use super::camera_file::{CameraFile, CameraSource};
use super::{CalibrationError, colmap, json, kalibr, nerfstudio, opencv, ray_table, st_map, wrong, yaml};
use crate::files;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

/// Largest text that is read as a calibration, bytes.
const LARGEST_TEXT: usize = 256 << 20;

/// Reads a camera from a file of any format. `focal_of_width`: focal length of the straight picture of an ST map over its
/// width, where the map does not say it.
pub fn read_camera(path: &Path, focal_of_width: Option<f64>) -> Result<CameraSource, CalibrationError> {
    let name = path.display().to_string();
    let bytes = files::read(path).map_err(|e| wrong(&*name, e.to_string(), "a calibration"))?;
    // The first bytes of every EXR.
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return match ray_table::is_one(&bytes) {
            true => ray_table::read(&bytes, &name),
            false => st_map::read(&bytes, &name, focal_of_width),
        }
        .map(|t| CameraSource::Rays(Arc::new(t)));
    }
    if bytes.len() > LARGEST_TEXT {
        return Err(wrong(name, format!("{} MiB", bytes.len() >> 20), "a text of a few kilobytes, or an EXR"));
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| wrong(&*name, "neither text nor EXR", "a calibration: YAML, JSON, cameras.txt or EXR"))?;
    parse_camera(&text, &name).map(CameraSource::Model)
}

/// Reads a camera from a text: JSON, YAML or COLMAP's, by what it holds. `name` is for messages. Fails on a text that is none of them, on a model that is not known, and
/// on entries that are missing or no numbers.
pub fn parse_camera(text: &str, name: &str) -> Result<CameraFile, CalibrationError> {
    let first = text.lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#')).unwrap_or("");
    if first.starts_with('{') {
        let v: Value = serde_json::from_str(text).map_err(|e| wrong(name, e.to_string(), "JSON"))?;
        return match v.get("format").and_then(Value::as_str) == Some(json::FORMAT) {
            true => json::read(&v, name),
            false => nerfstudio::read(&v, name),
        };
    }
    if first.starts_with('%') || first == "---" || first.contains(':') {
        let v = yaml::parse(text, name)?;
        return if v.get("cam0").is_some() { kalibr::read(&v, name) } else { opencv::read(&v, name) };
    }
    colmap::read(text, name)
}

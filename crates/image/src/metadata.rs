//! The facts of an exposure that travel with it and become EXIF and DNG tags.

use serde::{Deserialize, Serialize};

/// What was photographed with what, and how.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExposureFacts {
    /// Program name and version.
    pub software: String,
    /// Scene name or file name.
    pub scene: String,
    /// Camera body.
    pub body: String,
    /// Maker of the body, as EXIF Make.
    pub make: String,
    /// Model of the body, as EXIF Model.
    pub model: String,
    /// Serial number of the body: what its fixed pattern is drawn from.
    pub serial: String,
    /// Lens.
    pub lens: String,
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Focal length that gives the same diagonal field of view on 36 × 24 mm, mm.
    pub focal_length_35mm_mm: f64,
    /// f-number, true value.
    pub f_number: f64,
    /// f-number of a lossless lens as bright; 0 when not known.
    pub t_number: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Distance of the plane in focus from the lens, m; `None` for infinity or a pinhole.
    pub focus_distance_m: Option<f64>,
    /// ISO speed; 0 before read-out.
    pub iso: f64,
    /// Temperature of the sensor, °C; `None` before read-out.
    pub temperature_c: Option<f64>,
    /// Seed of the noise of the read-out; 0 before.
    pub noise_seed: u64,
    /// Illuminant taken for white; empty before read-out.
    pub white: String,
    /// When it was taken, `YYYY:MM:DD HH:MM:SS`, UTC; `None` when nobody looked at a clock.
    pub date: Option<String>,
    /// Metered exposure value at ISO 100 of the scene as framed; `None` when nothing was metered.
    pub metered_ev100: Option<f64>,
    /// Factor all light of the scene was multiplied by, because a setting (`ambient_ev`) asked for it; 1 if none did.
    pub light_scale: f64,
    /// Seed of the light transport.
    pub seed: u64,
    /// First sample of each pixel.
    pub first_sample: u32,
    /// Samples a pixel.
    pub samples: u32,
}

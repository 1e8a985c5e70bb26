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
    /// Whether the renderer's noise was reduced: the mean is then an estimate, no longer the truth within its variance.
    pub denoised: bool,
    /// What the lens does to a picture; `None` where it is not known or does nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens_profile: Option<LensProfile>,
}

/// What a lens does to a picture of its film, found by tracing rays: enough to undo distortion, lateral colour and vignetting.
///
/// Tables run over the height on the film from 0 to `reach` in equal steps; heights are shares of half the diagonal of the whole film.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LensProfile {
    /// Largest height that sees light from before the camera; 1 in the corner.
    pub reach: f32,
    /// Height over the tangent of the angle, in the middle, of green light.
    pub scale: f32,
    /// Tangent of the angle to the axis of the light that arrives, as red, green and blue pixels see it.
    pub tangents: [Vec<f32>; 3],
    /// Light that arrives, of that in the middle.
    pub brightness: Vec<f32>,
}

impl LensProfile {
    /// Whether its tables can be used: of one length, rising, finite.
    pub fn is_whole(&self) -> bool {
        let n = self.brightness.len();
        let rising = |t: &Vec<f32>| t.len() == n && t.iter().all(|v| v.is_finite()) && t.is_sorted_by(|a, b| a < b);
        n >= 2
            && self.reach > 0.0
            && self.reach <= 2.0
            && self.scale > 0.0
            && self.scale.is_finite()
            && self.tangents.iter().all(rising)
            && self.brightness.iter().all(|v| *v >= 0.0 && *v < 100.0)
    }
}

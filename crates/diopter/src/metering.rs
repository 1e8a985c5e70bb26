//! Metering: what a camera's meter reads, from a small exposure of the scene as framed.
//!
//! EV at ISO 100 = log2(L · 100 / K), L the mean luminance in cd/m², K = 12.5 (ISO 2720). Average over the frame; other
//! patterns come with the shutter's issue. Never looks at scene depth.

use crate::camera::{Camera, Film};
use crate::expose::{ExposeError, Response, Settings, Watch, expose};
use crate::shutter::Shutter;
use diopter_image::ExposureFacts;
use diopter_scene::Scene;

/// Reflected-light meter constant, cd·s/(m²·lx...) as commonly used. Source: ISO 2720.
pub const K: f64 = 12.5;

/// Pixels across a probe exposure, and its samples a pixel.
const PROBE_COLUMNS: usize = 48;
const PROBE_SAMPLES: u32 = 16;

/// EV at ISO 100 of a luminance in cd/m².
pub fn ev100_of_luminance(luminance: f64) -> f64 {
    (luminance * 100.0 / K).log2()
}

/// Exposure time (s) that exposes a metered EV100 at an f-number and ISO: t = N² / 2^EV · 100 / S.
pub fn shutter_for(ev100: f64, f_number: f64, iso: f64) -> f64 {
    f_number * f_number / ev100.exp2() * 100.0 / iso
}

/// EV at ISO 100 of a setting: log2(N²/t · 100/S).
pub fn ev100_of_setting(f_number: f64, exposure_s: f64, iso: f64) -> f64 {
    (f_number * f_number / exposure_s * 100.0 / iso).log2()
}

/// Mean luminance of the scene as framed, cd/m². Fails when cancelled.
pub fn mean_luminance(scene: &Scene, camera: &Camera, settings: &Settings, watch: &Watch) -> Result<f64, ExposeError> {
    let rows = (PROBE_COLUMNS * camera.film.rows).div_ceil(camera.film.columns).clamp(1, 4 * PROBE_COLUMNS);
    let film = Film { columns: PROBE_COLUMNS, rows, ..camera.film };
    let probe = Camera { film, ..camera.clone() };
    let settings =
        Settings { spp: PROBE_SAMPLES, samples: 0..PROBE_SAMPLES, time_limit_s: None, truth: false, ..settings.clone() };
    let shutter = Shutter { open_s: 0.0, exposure_s: 1.0 };
    let quiet = Watch { cancel: watch.cancel, progress: &|_| () };
    let plane = expose(scene, &probe, &shutter, &Response::luminance(), &settings, &ExposureFacts::default(), &quiet)?;
    Ok(plane.mean.data.iter().map(|v| *v as f64).sum::<f64>() / plane.mean.data.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sunny_sixteen_is_ev_15() {
        assert!((ev100_of_setting(16.0, 1.0 / 125.0, 100.0) - 14.966).abs() < 1e-3);
        assert!((shutter_for(14.966, 16.0, 100.0) * 125.0 - 1.0).abs() < 1e-3);
        assert!((ev100_of_luminance(4096.0) - 15.0).abs() < 1e-9);
    }
}

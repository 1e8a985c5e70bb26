//! Brightness: stops, and the headroom of the sensor.

use crate::setting::section;
use diopter_image::raw::GREY_GAIN;

section! {
    /// Brightness.
    Exposure "exposure" {
        ev: f64 = 0.0, "EV", Number(-10.0, 10.0),
            "brightening; at 0 what was metered as 18 % grey is shown so";
    }
}

/// Factor from fractions of saturation to light of the scene, where metered grey is 0.18. `ev` and `baseline_ev` are stops.
pub fn gain(ev: f64, baseline_ev: f64) -> f32 {
    (GREY_GAIN * (ev + baseline_ev).exp2()) as f32
}

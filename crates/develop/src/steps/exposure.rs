//! Brightness: stops, and the headroom of the sensor.

use super::tone::GREY_GAIN;

/// Factor from fractions of saturation to light of the scene, where metered grey is 0.18.
pub fn gain(ev: f64, baseline_ev: f64) -> f32 {
    GREY_GAIN * (ev + baseline_ev).exp2() as f32
}

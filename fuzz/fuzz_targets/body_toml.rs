//! Any text as a data sheet: an error or a sensor that can be read out, never a panic.
#![no_main]

use diopter_image::{ExposureFacts, FocalPlane};
use diopter_light::spectrum::Table;
use diopter_sensor::{Reading, Sensor, read_out};

libfuzzer_sys::fuzz_target!(|text: &str| {
    if let Ok(sensor) = Sensor::parse(text, "fuzz") {
        let bands = sensor.bands();
        let signal = vec![100.0; bands.len()];
        let plane = FocalPlane::even(bands, &signal, [8, 8], ExposureFacts { exposure_s: 1.0, ..Default::default() });
        let white = Table::new(380.0, 400.0, vec![1.0, 1.0]);
        read_out(&plane, &sensor, &Reading::new(sensor.iso[0].iso, 1), &white).expect("a checked sensor reads out");
    }
});

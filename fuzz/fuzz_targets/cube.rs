//! Any text as a .cube file: an error or a table that can be applied, written and read again, never a panic.
#![no_main]

use diopter_develop::Interpolation;
use diopter_develop::lut::Lut;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(lut) = Lut::parse(&String::from_utf8_lossy(data)) {
        for colour in [[0.0, 0.5, 1.0], [-1.0, 2.0, 0.3], [f32::NAN, f32::INFINITY, 1e30]] {
            for how in [Interpolation::Tetrahedral, Interpolation::Trilinear] {
                let _ = lut.at(glam::Vec3::from_array(colour), how);
            }
        }
        // Large ones are slow to write, not different.
        if lut.sizes().iter().flatten().all(|n| *n <= 64) {
            let again = Lut::parse(&lut.to_cube()).expect("what was written can be read");
            assert_eq!(again.sizes(), lut.sizes());
        }
    }
});

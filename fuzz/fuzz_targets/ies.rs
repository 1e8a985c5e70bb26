//! Any bytes as an IES file: an error or a lamp of finite light in every direction, never a panic.
#![no_main]

use diopter_scene::light::photometry::Web;
use glam::Vec3;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(web) = Web::read(data) {
        assert!(web.lumens().is_finite() && web.peak() > 0.0);
        for direction in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Z, Vec3::ONE, Vec3::new(-0.3, 0.2, -0.5), Vec3::ZERO] {
            let cd = web.candela(direction);
            assert!((0.0..=web.peak() * 1.001).contains(&cd), "{direction}: {cd}");
        }
    }
});

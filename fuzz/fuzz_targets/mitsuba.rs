//! Any bytes as a Mitsuba scene whose files hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::mitsuba;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(mitsuba::load(data, "fuzz.xml", &|_: &str| Ok(data.to_vec()))));

//! Any bytes as a scene sheet: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::sheet;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(sheet::load(data, "fuzz.toml")));

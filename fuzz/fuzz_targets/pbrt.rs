//! Any bytes as a pbrt scene whose files hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::pbrt;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(pbrt::load(data, "fuzz.pbrt", &|_: &str| Ok(data.to_vec()))));

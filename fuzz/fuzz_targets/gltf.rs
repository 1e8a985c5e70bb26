//! Any bytes as a glTF scene whose files hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::gltf;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(gltf::load(data, "fuzz.gltf", &|_: &str| Ok(data.to_vec()))));

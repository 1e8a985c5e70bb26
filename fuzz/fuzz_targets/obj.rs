//! Any bytes as a OBJ file whose materials hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::mesh;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(mesh::obj(data, "fuzz.obj", &|_: &str| Ok(data.to_vec()))));

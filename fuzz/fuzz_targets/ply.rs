//! Any bytes as a PLY file: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::mesh;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(mesh::ply(data.to_vec(), "fuzz.ply")));

//! Any bytes as an SPZ file, gzip or not: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::splats;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(splats::spz(data.to_vec(), "fuzz.spz")));

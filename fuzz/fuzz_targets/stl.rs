//! Any bytes as a mesh file: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::{Scene, load::mesh};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(description) = mesh::stl(data, "fuzz.stl") {
        let _ = Scene::build(description);
    }
});

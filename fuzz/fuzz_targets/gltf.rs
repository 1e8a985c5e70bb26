//! Any bytes as a glTF scene whose files hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::{Scene, load::gltf};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let fetch = |_: &str| Ok(data.to_vec());
    if let Ok(description) = gltf::load(data, "fuzz.gltf", &fetch) {
        let triangles: usize = description.meshes.iter().map(|m| m.triangles.len()).sum();
        // Large ones are slow to build, not different.
        if triangles < 1 << 16 && description.objects.len() < 256 {
            let _ = Scene::build(description);
        }
    }
});

//! Any bytes as a NanoVDB file: an error or numbers, never a panic, and no more memory than a few times the bytes.
#![no_main]

use diopter_scene::load::nanovdb::File;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(file) = File::open(data) {
        for name in file.names().map(str::to_owned).take(4).collect::<Vec<_>>() {
            let _ = file.read(&name);
        }
    }
});

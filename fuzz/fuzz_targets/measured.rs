//! Any bytes as a measured material: an error or a table, never a panic, and no more memory than a few times the bytes.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = diopter_scene::load::read_measured(data);
});

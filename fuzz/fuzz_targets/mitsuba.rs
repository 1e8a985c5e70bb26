//! Any bytes as a Mitsuba scene and, behind the first zero, as what is in all of its files: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::mitsuba;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let end = data.iter().position(|b| *b == 0).unwrap_or(data.len());
    let file = data.get(end + 1..).unwrap_or_default();
    diopter_fuzz::scene(mitsuba::load(&data[..end], "fuzz.xml", &|_: &str| Ok(file.to_vec())))
});

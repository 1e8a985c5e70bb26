//! Any bytes as a USD scene whose files hold the same bytes: an error or a scene that can be built, never a panic.
#![no_main]

use diopter_scene::load::usd;

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::scene(usd::load(
    data.to_vec(),
    "fuzz.usd",
    &|_: &str| Ok(data.to_vec())
)));

//! Any bytes as a lens file: an error or a lens that can be traced and written, never a panic.
#![no_main]

use diopter_lens::import::{Format, read};

libfuzzer_sys::fuzz_target!(|data: &[u8]| diopter_fuzz::lens(read(data, Format::Oslo, "fuzz")));

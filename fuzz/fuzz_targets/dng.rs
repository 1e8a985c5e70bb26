//! Any bytes as a DNG: an error or a raw image that can be written and read again, never a panic.
#![no_main]

use diopter_image::dng::{Storage, read, write_image};
use std::io::Cursor;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(raw) = read(Cursor::new(data)) {
        // Large ones are slow to write, not different.
        if raw.mosaic.data.len() < 1 << 16 {
            let mut file = Cursor::new(Vec::new());
            write_image(&raw, Storage::Lossless, None, &mut file).expect("what was read can be written");
            file.set_position(0);
            assert_eq!(read(file).expect("what was written can be read").mosaic.data, raw.mosaic.data);
        }
    }
});

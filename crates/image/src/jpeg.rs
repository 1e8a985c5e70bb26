//! JPEG, 8 bits, sRGB, full colour resolution, EXIF.

use crate::{ImageError, Picture, exif};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Write;

/// Writes a picture as JPEG of the given quality (1..=100). A side can have 65 535 pixels at most.
pub fn write(picture: &Picture, quality: u8, mut to: impl Write) -> Result<(), ImageError> {
    let (width, height) = (picture.pixels.width, picture.pixels.height);
    let limit = u16::MAX as usize;
    if width > limit || height > limit || width == 0 || height == 0 {
        return Err(ImageError::Size { format: "JPEG", width, height, limit });
    }
    let mut encoder = Encoder::new(&mut to, quality.clamp(1, 100));
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let io = |e| ImageError::Io(std::io::Error::other(e));
    if let Some(facts) = &picture.facts {
        encoder
            .add_exif_metadata(&exif::block(facts, exif::Holder::Jpeg { width: width as u32, height: height as u32 })?)
            .map_err(io)?;
    }
    encoder.set_optimized_huffman_tables(true);
    encoder.encode(&picture.to_8_bit(), width as u16, height as u16, ColorType::Rgb).map_err(io)
}

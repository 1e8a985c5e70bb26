//! PNG, 8 or 16 bits a channel, sRGB.

use crate::{ImageError, Picture};
use std::io::Write;

/// Bits a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

/// Writes a picture as PNG with an sRGB chunk.
pub fn write(picture: &Picture, depth: Depth, to: impl Write) -> Result<(), ImageError> {
    let (width, height) = (picture.pixels.width, picture.pixels.height);
    let mut encoder = png::Encoder::new(to, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let bytes = match depth {
        Depth::Eight => {
            encoder.set_depth(png::BitDepth::Eight);
            picture.to_8_bit()
        }
        Depth::Sixteen => {
            encoder.set_depth(png::BitDepth::Sixteen);
            picture.to_16_bit().into_iter().flat_map(u16::to_be_bytes).collect()
        }
    };
    let io = |e: png::EncodingError| ImageError::Io(std::io::Error::other(e));
    let mut writer = encoder.write_header().map_err(io)?;
    writer.write_image_data(&bytes).map_err(io)?;
    writer.finish().map_err(io)
}

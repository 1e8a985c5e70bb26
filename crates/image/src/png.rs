//! PNG, 8 or 16 bits a channel, sRGB, EXIF.

use crate::{ImageError, Picture, Raster, exif};
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
    let io = |e: png::EncodingError| ImageError::Io(std::io::Error::other(e));
    let mut info = png::Info::with_size(width as u32, height as u32);
    info.exif_metadata = picture.facts.as_ref().map(|f| exif::block(f, exif::Holder::Png)).transpose()?.map(Into::into);
    let mut encoder = png::Encoder::with_info(to, info).map_err(io)?;
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
    let mut writer = encoder.write_header().map_err(io)?;
    writer.write_image_data(&bytes).map_err(io)?;
    writer.finish().map_err(io)
}

/// Writes numbers of one channel as a grey picture of 16 bits, as they are.
pub fn write_numbers(numbers: &Raster<u16>, to: impl Write) -> Result<(), ImageError> {
    let io = |e: png::EncodingError| ImageError::Io(std::io::Error::other(e));
    let mut encoder = png::Encoder::new(to, numbers.width as u32, numbers.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(io)?;
    let bytes: Vec<u8> = numbers.data.iter().flat_map(|v| v.to_be_bytes()).collect();
    writer.write_image_data(&bytes).map_err(io)?;
    writer.finish().map_err(io)
}

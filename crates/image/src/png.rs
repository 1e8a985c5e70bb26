//! PNG, 8 or 16 bits a channel, with EXIF, code points (cICP) and an ICC profile where it is not plain sRGB.

use crate::picture::{in_bands, rows_8_bit, rows_16_bit};
use crate::{Encoding, ImageError, PictureSource, Raster, exif, icc};
use diopter_light::color::RgbSpace;
use std::io::Write;

/// Bits a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Depth {
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

fn io(e: png::EncodingError) -> ImageError {
    ImageError::Io(std::io::Error::other(e))
}

/// Writes a picture as PNG. Fails on a side of 0 or above 2³¹ − 1 pixels, and where writing does.
pub fn write(picture: &dyn PictureSource, depth: Depth, mut to: impl Write) -> Result<(), ImageError> {
    write_to(picture, depth, &mut to)
}

fn write_to(picture: &dyn PictureSource, depth: Depth, to: &mut dyn Write) -> Result<(), ImageError> {
    let [width, height] = picture.size();
    let limit = i32::MAX as usize;
    if width == 0 || height == 0 || width > limit || height > limit {
        return Err(ImageError::Size { format: "PNG", width, height, limit });
    }
    let mut info = png::Info::with_size(width as u32, height as u32);
    let colors = exif::color_space(picture.space(), picture.encoding());
    info.exif_metadata = picture.facts().map(|f| exif::block(f, exif::Holder::Png, colors)).transpose()?.map(Into::into);
    let (space, encoding) = (picture.space(), picture.encoding());
    let plain = space == RgbSpace::Srgb && encoding == Encoding::Srgb;
    if !plain {
        info.icc_profile = Some(icc::profile(space, encoding)?.into());
    }
    info.color_type = png::ColorType::Rgb;
    info.bit_depth = match depth {
        Depth::Eight => png::BitDepth::Eight,
        Depth::Sixteen => png::BitDepth::Sixteen,
    };
    let mut encoder = png::Encoder::with_info(to, info).map_err(io)?;
    if plain {
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    }
    let mut writer = encoder.write_header().map_err(io)?;
    if let (false, Some(points)) = (plain, icc::code_points(space, encoding)) {
        writer.write_chunk(png::chunk::ChunkType(*b"cICP"), &points).map_err(io)?;
    }
    let mut stream = writer.stream_writer().map_err(io)?;
    let rows = |first: usize, count: usize| {
        Ok(match depth {
            Depth::Eight => rows_8_bit(picture, first, count),
            Depth::Sixteen => rows_16_bit(picture, first, count).into_iter().flat_map(u16::to_be_bytes).collect(),
        })
    };
    in_bands(height, picture.rows_at_once(), rows, |bytes: Vec<u8>| Ok(stream.write_all(&bytes)?))?;
    stream.finish().map_err(io)?;
    writer.finish().map_err(io)
}

/// Writes numbers of one channel as a grey picture of 16 bits, as they are. Fails on a raster without pixels or of several
/// channels, and where writing does.
pub fn write_numbers(numbers: &Raster<u16>, mut to: impl Write) -> Result<(), ImageError> {
    let to: &mut dyn Write = &mut to;
    let mut encoder = png::Encoder::new(to, numbers.width as u32, numbers.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(io)?;
    let bytes: Vec<u8> = numbers.data.iter().flat_map(|v| v.to_be_bytes()).collect();
    writer.write_image_data(&bytes).map_err(io)?;
    writer.finish().map_err(io)
}

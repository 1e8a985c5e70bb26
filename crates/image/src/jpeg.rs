//! JPEG, 8 bits, full colour resolution, EXIF and ICC profile.
//!
//! Bands of rows are encoded apart, in parallel, and joined by restart markers (ITU-T T.81 §E.1.4): a JPEG whose restart interval is a band
//! has the very bytes of the bands' scans, so the picture is never held whole.

use crate::picture::{in_bands, rows_8_bit};
use crate::{Encoding, ImageError, PictureSource, exif, icc};
use diopter_light::color::RgbSpace;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Write;

/// Pixels a side of a block.
const BLOCK: usize = 8;

/// Most blocks between two restart markers (a 16-bit field).
const LONGEST_INTERVAL: usize = 65_535;

/// An application segment: number of the marker APPn, bytes.
pub(crate) type Segment = (u8, Vec<u8>);

/// Writes a picture as JPEG of the given quality (1..=100). A side can have 65 535 pixels at most. Fails on a larger side or one of 0, and
/// where writing does.
pub fn write(picture: &dyn PictureSource, quality: u8, mut to: impl Write) -> Result<(), ImageError> {
    write_with(picture, quality, Vec::new(), &mut to)
}

/// Writes a picture with segments after its EXIF.
pub(crate) fn write_with(
    picture: &dyn PictureSource,
    quality: u8,
    segments: Vec<Segment>,
    to: &mut dyn Write,
) -> Result<(), ImageError> {
    let [width, height] = picture.size();
    let limit = usize::from(u16::MAX);
    if width > limit || height > limit || width == 0 || height == 0 {
        return Err(ImageError::Size { format: "JPEG", width, height, limit });
    }
    let across = width.div_ceil(BLOCK);
    let down = (picture.rows_at_once() / BLOCK).clamp(1, (LONGEST_INTERVAL / across).max(1));
    let encode = |first: usize, rows: usize| {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, quality.clamp(1, 100));
        encoder.set_sampling_factor(SamplingFactor::F_1_1);
        let data = rows_8_bit(picture, first, rows);
        encoder.encode(&data, width as u16, rows as u16, ColorType::Rgb).map_err(other)?;
        Ok((first, file))
    };
    let mut number = 0u8;
    in_bands(height, down * BLOCK, encode, |(first, file)| {
        let scan = scan_start(&file).ok_or_else(|| other("the encoder wrote no scan"))?;
        if first == 0 {
            to.write_all(&header(picture, &file[..scan], segments.clone(), across * down)?)?;
        } else {
            to.write_all(&[0xff, 0xd0 + number])?;
            number = (number + 1) % 8;
        }
        // Without the end-of-image marker.
        Ok(to.write_all(&file[scan..file.len() - 2])?)
    })?;
    Ok(to.write_all(&[0xff, 0xd9])?)
}

fn other(e: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> ImageError {
    ImageError::Io(std::io::Error::other(e))
}

/// Where the entropy-coded data begin: after the segment SOS.
fn scan_start(file: &[u8]) -> Option<usize> {
    let mut at = 2;
    loop {
        let [0xff, marker, high, low] = *file.get(at..at + 4)? else { return None };
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == 0xda {
            return Some(at);
        }
    }
}

/// The header of the whole picture from that of its first band.
fn header(picture: &dyn PictureSource, of_band: &[u8], segments: Vec<Segment>, interval: usize) -> Result<Vec<u8>, ImageError> {
    let [width, height] = picture.size();
    let mut head = vec![0xff, 0xd8];
    let mut put = |marker: u8, body: &[u8]| {
        let length = u16::try_from(body.len() + 2).map_err(|_| other("a segment of a JPEG holds 65 533 bytes at most"))?;
        head.extend([0xff, marker]);
        head.extend(length.to_be_bytes());
        head.extend(body);
        Ok::<(), ImageError>(())
    };
    let facts = picture.facts();
    if let Some(facts) = facts {
        let block = exif::block(
            facts,
            exif::Holder::Jpeg { width: width as u32, height: height as u32 },
            exif::color_space(picture.space(), picture.encoding()),
        )?;
        put(0xe1, &[b"Exif\0\0".as_slice(), &block].concat())?;
    }
    for (app, bytes) in &segments {
        put(0xe0 + app, bytes)?;
    }
    // Plain sRGB is what everyone takes a JPEG for.
    if picture.space() != RgbSpace::Srgb || picture.encoding() != Encoding::Srgb {
        let profile = icc::profile(picture.space(), picture.encoding())?;
        put(0xe2, &[b"ICC_PROFILE\0\x01\x01".as_slice(), &profile].concat())?;
    }
    // The band's own segments, with the height of the whole and the interval.
    let mut at = 2;
    while at + 4 <= of_band.len() {
        let (marker, length) = (of_band[at + 1], usize::from(u16::from_be_bytes([of_band[at + 2], of_band[at + 3]])));
        let mut body = of_band[at + 4..at + 2 + length].to_vec();
        at += 2 + length;
        match marker {
            0xc0 => body[1..3].copy_from_slice(&(height as u16).to_be_bytes()),
            0xda => put(0xdd, &(interval.min(LONGEST_INTERVAL) as u16).to_be_bytes())?,
            // JFIF's segment goes first, and not beside EXIF.
            0xe0 if facts.is_some() || !segments.is_empty() => continue,
            _ => {}
        }
        put(marker, &body)?;
    }
    Ok(head)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Picture, Raster};

    fn picture(width: usize, height: usize) -> Picture {
        let mut pixels = Raster::new(width, height, 3);
        for (i, v) in pixels.data.iter_mut().enumerate() {
            let (x, y, c) = (i / 3 % width, i / 3 / width, i % 3);
            *v = 0.5 + 0.4 * ((0.05 * x as f32 + c as f32).sin() * (0.07 * y as f32).cos());
        }
        Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: None }
    }

    #[test]
    fn bands_joined_by_restart_markers_are_one_picture() {
        for (width, height) in [(1, 1), (8, 64), (100, 65), (333, 500), (70, 1300)] {
            let picture = picture(width, height);
            let mut file = Vec::new();
            write(&picture, 95, &mut file).unwrap();
            let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(&file));
            let decoded = decoder.decode().unwrap();
            let info = decoder.info().unwrap();
            assert_eq!([usize::from(info.width), usize::from(info.height)], [width, height]);
            let worst = decoded.iter().zip(picture.to_8_bit()).map(|(a, b)| a.abs_diff(b)).max().unwrap();
            assert!(worst <= 6, "{width} × {height}: {worst}");
        }
    }

    #[test]
    fn sides_that_do_not_fit_are_an_error() {
        let wide = Picture {
            pixels: Raster { width: 65_536, height: 0, channels: 3, data: vec![] },
            space: RgbSpace::Srgb,
            encoding: Encoding::Srgb,
            facts: None,
        };
        assert!(matches!(write(&wide, 90, Vec::new()), Err(ImageError::Size { .. })));
    }
}

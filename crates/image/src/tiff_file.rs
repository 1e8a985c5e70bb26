//! TIFF, 16 bits a channel, uncompressed, with an ICC profile and EXIF. Source: TIFF 6.0; ICC.1:2022 annex B.4; CIPA DC-008-2019.

use crate::picture::{in_bands, rows_16_bit};
use crate::streams::WriteSeek;
use crate::tags::{Field, write_fields};
use crate::{ImageError, PictureSource, exif, icc};
use std::io::{Cursor, Seek, Write};
use tiff::decoder::Decoder;
use tiff::encoder::{TiffEncoder, colortype::RGB16};
use tiff::tags::Tag;

/// Most bytes of pixels: places in a TIFF are 32-bit numbers.
const MOST_BYTES: u64 = u32::MAX as u64 - (1 << 20);

/// Writes a picture as 16-bit TIFF. Fails on a side of 0, on pixels that take more than 4 GB, and where writing does.
pub fn write(picture: &dyn PictureSource, mut to: impl Write + Seek) -> Result<(), ImageError> {
    write_to(picture, &mut to)
}

fn write_to(picture: &dyn PictureSource, to: &mut dyn WriteSeek) -> Result<(), ImageError> {
    let io = |e: tiff::TiffError| ImageError::Io(std::io::Error::other(e));
    let [width, height] = picture.size();
    if width == 0 || height == 0 || (width as u64).saturating_mul(height as u64) > MOST_BYTES / 6 {
        let limit = (MOST_BYTES / 6 / width.max(1) as u64) as usize;
        return Err(ImageError::Size { format: "TIFF", width, height, limit });
    }
    let mut file = TiffEncoder::new(to).map_err(io)?;
    // EXIF has a directory of its own, which that of the picture points to.
    let exif_place = match picture.facts() {
        Some(facts) => {
            let mut directory = file.extra_directory().map_err(io)?;
            let mut fields = exif::exif_fields(facts);
            fields.push((40960, Field::Undefined(b"0100".to_vec())));
            fields.push((40961, Field::short(exif::color_space(picture.space(), picture.encoding()))));
            write_fields(&mut directory, &fields)?;
            Some(directory.finish_with_offsets().map_err(io)?.pointer.0 as u32)
        }
        None => None,
    };
    let mut image = file.new_image::<RGB16>(width as u32, height as u32).map_err(io)?;
    let profile = icc::profile(picture.space(), picture.encoding())?;
    write_fields(image.encoder(), &[(Tag::IccProfile.to_u16(), Field::Undefined(profile))])?;
    if let Some(facts) = picture.facts() {
        for (tag, text) in exif::texts(facts) {
            image.encoder().write_tag(Tag::from_u16_exhaustive(tag), text.as_str()).map_err(io)?;
        }
    }
    if let Some(place) = exif_place {
        image.encoder().write_tag(Tag::from_u16_exhaustive(exif::EXIF_DIRECTORY), place).map_err(io)?;
    }
    image.rows_per_strip(picture.rows_at_once().min(height) as u32).map_err(io)?;
    let band = picture.rows_at_once().min(height);
    in_bands(height, band, |first, count| Ok(rows_16_bit(picture, first, count)), |rows| image.write_strip(&rows).map_err(io))?;
    image.finish().map_err(io)
}

/// The colour profile (ICC) that a TIFF carries; `None` without one, and of what cannot be read.
pub fn profile(bytes: &[u8]) -> Option<Vec<u8>> {
    Decoder::new(Cursor::new(bytes)).ok()?.get_tag_u8_vec(Tag::IccProfile).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Encoding, ExposureFacts, Picture, Raster};
    use diopter_light::color::RgbSpace;

    #[test]
    fn profiles_are_larger_than_small_pictures() {
        let picture = Picture { pixels: Raster::new(3, 2, 3), space: RgbSpace::Rec2020, encoding: Encoding::Pq, facts: None };
        let mut file = Cursor::new(Vec::new());
        write(&picture, &mut file).unwrap();
        let found = profile(file.get_ref()).unwrap();
        assert_eq!(found, icc::profile(RgbSpace::Rec2020, Encoding::Pq).unwrap());
        // ICC.1 annex B.4: type 7, little-endian here.
        let entry = [0x73, 0x87, 7, 0];
        assert!(file.get_ref().windows(4).any(|bytes| bytes == entry));
        assert_eq!(profile(&file.get_ref()[..100]), None);
    }

    #[test]
    fn a_file_says_how_it_was_taken() {
        let facts =
            ExposureFacts { f_number: 2.8, exposure_s: 1.0 / 60.0, iso: 400.0, scene: "still-life".into(), ..Default::default() };
        let mut picture =
            Picture { pixels: Raster::new(3, 2, 3), space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: Some(facts) };
        let file = |picture: &Picture| {
            let mut file = Cursor::new(Vec::new());
            write(picture, &mut file).unwrap();
            Decoder::new(Cursor::new(file.into_inner())).unwrap()
        };
        let mut decoder = file(&picture);
        assert_eq!(decoder.dimensions().unwrap(), (3, 2));
        let place = decoder.get_tag_u32(Tag::from_u16_exhaustive(exif::EXIF_DIRECTORY)).unwrap();
        let directory = decoder.read_directory(tiff::tags::IfdPointer(place.into())).unwrap();
        // Exposure time, f-number, ISO speed, colour space; no date.
        let held = [33434, 33437, 34855, 40961, 36867].map(|tag| directory.contains(Tag::from_u16_exhaustive(tag)));
        assert_eq!(held, [true, true, true, true, false]);
        // Without facts there is none.
        picture.facts = None;
        assert_eq!(file(&picture).find_tag(Tag::from_u16_exhaustive(exif::EXIF_DIRECTORY)).unwrap(), None);
    }
}

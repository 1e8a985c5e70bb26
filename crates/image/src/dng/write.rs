//! Writing: the mosaic by bands of rows, so that no more of it need be in memory.

use super::{FILTER_NUMBERS, XMP_NAMESPACE, compression, lossless, packing, photometric, tag};
use crate::exif::{EXIF_DIRECTORY, exif_fields, lens_info, main_fields};
use crate::raw::GREY_GAIN;
use crate::streams::WriteSeek;
use crate::tags::{Field, write_fields, written};
use crate::{ExposureFacts, ImageError, Picture, Raster, RawHeader, RawImage, jpeg};
use rayon::prelude::*;
use std::io::{Seek, Write};
use tiff::encoder::TiffEncoder;

/// How the numbers of the mosaic are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Storage {
    /// 16 bits each: every reader can.
    #[default]
    Sixteen,
    /// As many bits as the converter has.
    Packed,
    /// Lossless JPEG; images with all channels in every pixel are packed instead.
    Lossless,
}

/// Fills whole rows of the mosaic: told the first row, and where they go.
pub type Rows<'a> = dyn FnMut(usize, &mut [u16]) -> Result<(), ImageError> + 'a;

/// Rows that are asked for at a time, and the longest side of a compressed tile (a multiple of 16, as tiles must be).
const BAND: usize = 256;

/// Bytes of a strip, about.
const STRIP_BYTES: usize = 1 << 18;

/// Longest side of the small picture that stands first in the file.
const THUMBNAIL: usize = 256;

/// JPEG quality of the preview.
const PREVIEW_QUALITY: u8 = 85;

/// Writes a raw image. `preview` is a developed picture of it, of any size. Fails on a side of 0 or above 65 535 numbers, on more numbers
/// than 32-bit offsets reach, on a preview that no JPEG holds, and where writing does.
pub fn write_image(raw: &RawImage, storage: Storage, preview: Option<&Picture>, to: impl Write + Seek) -> Result<(), ImageError> {
    let size = [raw.mosaic.width, raw.mosaic.height];
    write(&raw.header, size, storage, &mut rows_of(&raw.mosaic), || preview.cloned(), to)
}

/// The rows of a mosaic that is in memory. They never fail; rows that the mosaic does not have panic.
pub fn rows_of(mosaic: &Raster<u16>) -> impl FnMut(usize, &mut [u16]) -> Result<(), ImageError> + '_ {
    move |first, to| {
        to.copy_from_slice(&mosaic.data[first * mosaic.width..][..to.len()]);
        Ok(())
    }
}

/// Writes a raw image whose rows are asked for in turn, from the top, and whose preview is asked for after them. `width`: numbers a row.
/// Fails as [`write_image`], and where `rows` does.
pub fn write(
    header: &RawHeader,
    [width, height]: [usize; 2],
    storage: Storage,
    rows: &mut Rows,
    preview: impl FnOnce() -> Option<Picture>,
    mut to: impl Write + Seek,
) -> Result<(), ImageError> {
    write_to(header, [width, height], storage, rows, Box::new(preview), &mut to)
}

fn write_to(
    header: &RawHeader,
    [width, height]: [usize; 2],
    storage: Storage,
    rows: &mut Rows,
    preview: Box<dyn FnOnce() -> Option<Picture> + '_>,
    to: &mut dyn WriteSeek,
) -> Result<(), ImageError> {
    let limit = u16::MAX as usize;
    if width == 0 || height == 0 || width > limit || height > limit {
        return Err(ImageError::Size { format: "DNG", width, height, limit });
    }
    // Offsets are 32 bits. Lossless JPEG of pure noise can be a little larger than its numbers.
    if width * height > (u32::MAX as usize / 20) * 9 {
        return Err(ImageError::Size { format: "DNG", width, height, limit: 43_000 });
    }
    // Tiles are whole pixels of a mosaic. A single one that is wider than the picture is read wrong by LibRaw and dcraw, which break its rows at the width of the picture.
    let has_padded_tile = width < BAND && !width.is_multiple_of(16);
    let storage = match storage {
        Storage::Lossless if header.cfa.has_all_channels() || has_padded_tile => Storage::Packed,
        storage => storage,
    };
    let mut tiff = TiffEncoder::new(to).map_err(written)?;

    // The mosaic.
    let mut raw = tiff.extra_directory().map_err(written)?;
    let mut offsets = Vec::new();
    let mut counts = Vec::new();
    let bits = if storage == Storage::Sixteen { 16 } else { header.bits };
    let strip = (STRIP_BYTES / packing::row_bytes(width, bits)).clamp(1, height);
    let side = [width, height].map(|n| BAND.min(n.next_multiple_of(16)));
    let mut band = vec![0u16; width * BAND.min(height)];
    let mut bytes = Vec::new();
    for first in (0..height).step_by(BAND) {
        let band = &mut band[..width * BAND.min(height - first)];
        rows(first, band)?;
        match storage {
            Storage::Lossless => {
                let encoded = |t: usize| lossless::encode(&tile(band, width, t * side[0], side), side[0], bits);
                let tiles: Vec<Vec<u8>> = (0..width.div_ceil(side[0])).into_par_iter().map(encoded).collect();
                for tile in tiles {
                    counts.push(tile.len() as u32);
                    offsets.push(raw.write_data(&tile[..]).map_err(written)? as u32);
                    if tile.len() % 2 == 1 {
                        raw.write_data(0u8).map_err(written)?;
                    }
                }
            }
            _ => {
                for (i, row) in band.chunks(width).enumerate() {
                    if bits == 16 {
                        bytes.extend(row.iter().flat_map(|v| v.to_ne_bytes()));
                    } else {
                        packing::pack(row, bits, &mut bytes);
                    }
                    let end = first + i + 1;
                    if end % strip == 0 || end == height {
                        counts.push(bytes.len() as u32);
                        offsets.push(raw.write_data(&bytes[..]).map_err(written)? as u32);
                        bytes.clear();
                    }
                }
            }
        }
    }
    let mut fields = mosaic_fields(header, [width, height], bits);
    match storage {
        Storage::Lossless => fields.extend([
            (tag::COMPRESSION, Field::short(compression::JPEG)),
            (tag::TILE_WIDTH, Field::long(side[0] as u32)),
            (tag::TILE_LENGTH, Field::long(side[1] as u32)),
            (tag::TILE_OFFSETS, Field::Longs(offsets)),
            (tag::TILE_BYTE_COUNTS, Field::Longs(counts)),
        ]),
        _ => fields.extend([
            (tag::COMPRESSION, Field::short(compression::NONE)),
            (tag::ROWS_PER_STRIP, Field::long(strip as u32)),
            (tag::STRIP_OFFSETS, Field::Longs(offsets)),
            (tag::STRIP_BYTE_COUNTS, Field::Longs(counts)),
        ]),
    }
    write_fields(&mut raw, &fields)?;
    let mut places = vec![raw.finish_with_offsets().map_err(written)?.pointer.0 as u32];

    // The preview, as JPEG.
    let preview = preview();
    if let Some(picture) = &preview {
        let mut file = Vec::new();
        jpeg::write(&Picture { facts: None, ..picture.clone() }, PREVIEW_QUALITY, &mut file)?;
        let mut directory = tiff.extra_directory().map_err(written)?;
        let place = directory.write_data(&file[..]).map_err(written)? as u32;
        if file.len() % 2 == 1 {
            directory.write_data(0u8).map_err(written)?;
        }
        write_fields(&mut directory, &preview_fields(picture, place, file.len() as u32, &header.facts))?;
        places.push(directory.finish_with_offsets().map_err(written)?.pointer.0 as u32);
    }

    let mut exif = tiff.extra_directory().map_err(written)?;
    write_fields(&mut exif, &exif_fields(&header.facts))?;
    let exif = exif.finish_with_offsets().map_err(written)?.pointer.0 as u32;

    // The small picture stands first.
    let small = preview.as_ref().map_or_else(|| (1, 1, vec![128; 3]), thumbnail);
    let mut main = tiff.image_directory().map_err(written)?;
    let place = main.write_data(&small.2[..]).map_err(written)? as u32;
    if small.2.len() % 2 == 1 {
        main.write_data(0u8).map_err(written)?;
    }
    let mut fields = main_fields(&header.facts);
    fields.extend(color_fields(header));
    fields.extend([
        (tag::NEW_SUBFILE_TYPE, Field::long(1)),
        (tag::WIDTH, Field::long(small.0 as u32)),
        (tag::HEIGHT, Field::long(small.1 as u32)),
        (tag::BITS_PER_SAMPLE, Field::Shorts(vec![8; 3])),
        (tag::COMPRESSION, Field::short(compression::NONE)),
        (tag::PHOTOMETRIC, Field::short(photometric::RGB)),
        (tag::STRIP_OFFSETS, Field::long(place)),
        (tag::SAMPLES_PER_PIXEL, Field::short(3)),
        (tag::ROWS_PER_STRIP, Field::long(small.1 as u32)),
        (tag::STRIP_BYTE_COUNTS, Field::long(small.2.len() as u32)),
        (tag::X_RESOLUTION, Field::rational(300.0)),
        (tag::Y_RESOLUTION, Field::rational(300.0)),
        (tag::PLANAR, Field::short(1)),
        (tag::RESOLUTION_UNIT, Field::short(2)),
        (tag::SUB_IFDS, Field::Longs(places)),
        (EXIF_DIRECTORY, Field::long(exif)),
        (tag::XMP, Field::Bytes(xmp(&header.facts))),
    ]);
    write_fields(&mut main, &fields)?;
    main.finish().map_err(written)
}

/// Columns from `left` on of a band, as a whole tile: what lies outside repeats the edge.
fn tile(band: &[u16], width: usize, left: usize, [across, down]: [usize; 2]) -> Vec<u16> {
    let rows = band.len() / width;
    let mut tile = Vec::with_capacity(across * down);
    for row in 0..down {
        let line = &band[row.min(rows - 1) * width..][..width];
        let inside = &line[left..(left + across).min(width)];
        tile.extend_from_slice(inside);
        // The last two pixels again and again: differences of none.
        let pair = [inside[inside.len().saturating_sub(2)], inside[inside.len() - 1]];
        (inside.len()..across).for_each(|i| tile.push(pair[(i - inside.len()) % 2]));
    }
    tile
}

fn mosaic_fields(header: &RawHeader, [width, height]: [usize; 2], bits: u32) -> Vec<(u16, Field)> {
    let cfa = &header.cfa;
    let samples = cfa.samples_per_pixel();
    let width = width / samples;
    let number = |f: &crate::raw::Filter| FILTER_NUMBERS.iter().find(|n| n.0 == *f).map_or(0, |n| n.1);
    // A pair for each plane of colour: one for a mosaic of polarisers, which DNG does not know.
    let planes = if cfa.is_colorless() { header.noise.len().min(1) } else { header.noise.len() };
    let mut fields = vec![
        (tag::NEW_SUBFILE_TYPE, Field::long(0)),
        (tag::WIDTH, Field::long(width as u32)),
        (tag::HEIGHT, Field::long(height as u32)),
        (tag::BITS_PER_SAMPLE, Field::Shorts(vec![bits as u16; samples])),
        (tag::SAMPLES_PER_PIXEL, Field::short(samples as u16)),
        (tag::PLANAR, Field::short(1)),
        (tag::BLACK_REPEAT, Field::Shorts(vec![1, 1])),
        (tag::BLACK_LEVEL, Field::Rationals(vec![header.black_level; samples])),
        (tag::WHITE_LEVEL, Field::Longs(vec![header.white_level.round() as u32; samples])),
        (tag::DEFAULT_SCALE, Field::Rationals(header.framing.scale.to_vec())),
        (tag::CROP_ORIGIN, Field::Longs(vec![0, 0])),
        (tag::CROP_SIZE, Field::Longs(vec![width as u32, height as u32])),
        (tag::ACTIVE_AREA, Field::Longs(vec![0, 0, height as u32, width as u32])),
        (tag::NOISE_PROFILE, Field::Doubles(header.noise[..planes].as_flattened().to_vec())),
    ];
    // DNG has no mosaic of polarisers: the facts tell what one is.
    if cfa.is_colorless() || cfa.has_all_channels() {
        fields.push((tag::PHOTOMETRIC, Field::short(photometric::LINEAR_RAW)));
    } else {
        let cells = (0..cfa.rows()).flat_map(|r| (0..cfa.columns()).map(move |c| cfa.filter_at(c, r)));
        fields.extend([
            (tag::PHOTOMETRIC, Field::short(photometric::CFA)),
            (tag::CFA_REPEAT, Field::Shorts(vec![cfa.rows() as u16, cfa.columns() as u16])),
            (tag::CFA_PATTERN, Field::Bytes(cells.map(|f| number(&f)).collect())),
            (tag::CFA_PLANE_COLOR, Field::Bytes(cfa.filters().iter().map(number).collect())),
            (tag::CFA_LAYOUT, Field::short(1)),
        ]);
    }
    fields
}

fn color_fields(header: &RawHeader) -> Vec<(u16, Field)> {
    let facts = &header.facts;
    let model = if facts.model.is_empty() { &facts.body } else { &facts.model };
    let mut fields = vec![
        (tag::DNG_VERSION, Field::Bytes(vec![1, 6, 0, 0])),
        (tag::DNG_BACKWARD_VERSION, Field::Bytes(vec![1, 4, 0, 0])),
        (tag::UNIQUE_CAMERA_MODEL, Field::text(model)),
        (tag::BASELINE_EXPOSURE, Field::srational(header.baseline_ev + GREY_GAIN.log2())),
        (tag::BASELINE_NOISE, Field::rational(1.0)),
        (tag::BASELINE_SHARPNESS, Field::rational(1.0)),
        (tag::LINEAR_RESPONSE_LIMIT, Field::rational(1.0)),
    ];
    if !facts.serial.is_empty() {
        fields.push((tag::CAMERA_SERIAL, Field::text(&facts.serial)));
    }
    if let Some(info) = lens_info(facts) {
        fields.push((tag::LENS_INFO, Field::Rationals(info.to_vec())));
    }
    if header.cfa.is_colorless() {
        return fields;
    }
    fields.push((tag::AS_SHOT_NEUTRAL, Field::Rationals(header.as_shot_neutral.clone())));
    fields.push((tag::PROFILE_NAME, Field::text("diopter")));
    for (k, c) in header.calibrations.iter().take(2).enumerate() {
        // ForwardMatrix: rows X, Y, Z; a column a channel.
        let forward = (0..3).flat_map(|row| c.xyz_d50_from_balanced.iter().map(move |column| column[row]));
        fields.push((tag::CALIBRATION_ILLUMINANT[k], Field::short(c.light.0)));
        fields.push((tag::COLOR_MATRIX[k], Field::SRationals(c.camera_from_xyz.as_flattened().to_vec())));
        fields.push((tag::FORWARD_MATRIX[k], Field::SRationals(forward.collect())));
    }
    fields
}

fn preview_fields(picture: &Picture, place: u32, length: u32, facts: &ExposureFacts) -> Vec<(u16, Field)> {
    let (width, height) = (picture.pixels.width as u32, picture.pixels.height as u32);
    vec![
        (tag::NEW_SUBFILE_TYPE, Field::long(1)),
        (tag::WIDTH, Field::long(width)),
        (tag::HEIGHT, Field::long(height)),
        (tag::BITS_PER_SAMPLE, Field::Shorts(vec![8; 3])),
        (tag::COMPRESSION, Field::short(compression::JPEG)),
        (tag::PHOTOMETRIC, Field::short(photometric::YCBCR)),
        (tag::STRIP_OFFSETS, Field::long(place)),
        (tag::SAMPLES_PER_PIXEL, Field::short(3)),
        (tag::ROWS_PER_STRIP, Field::long(height)),
        (tag::STRIP_BYTE_COUNTS, Field::long(length)),
        (tag::PLANAR, Field::short(1)),
        (tag::YCBCR_SUBSAMPLING, Field::Shorts(vec![1, 1])),
        (tag::YCBCR_POSITIONING, Field::short(1)),
        (tag::REFERENCE_BLACK_WHITE, Field::Rationals(vec![0.0, 255.0, 128.0, 255.0, 128.0, 255.0])),
        (tag::PREVIEW_SOFTWARE, Field::text(&facts.software)),
        // sRGB.
        (tag::PREVIEW_COLOR_SPACE, Field::long(2)),
    ]
}

/// A picture of at most [`THUMBNAIL`] pixels a side: width, height, 8-bit RGB. Means of boxes.
fn thumbnail(picture: &Picture) -> (usize, usize, Vec<u8>) {
    let (width, height) = (picture.pixels.width, picture.pixels.height);
    let step = width.max(height).div_ceil(THUMBNAIL);
    let (w, h) = (width.div_ceil(step), height.div_ceil(step));
    let codes = &picture.pixels.data;
    let mut small = Vec::with_capacity(w * h * 3);
    for y in 0..h {
        for x in 0..w {
            let (right, bottom) = (((x + 1) * step).min(width), ((y + 1) * step).min(height));
            for c in 0..3 {
                let (mut sum, mut n) = (0.0, 0.0);
                for row in y * step..bottom {
                    for column in x * step..right {
                        sum += codes[(row * width + column) * 3 + c];
                        n += 1.0;
                    }
                }
                small.push((sum / n * 255.0 + 0.5) as u8);
            }
        }
    }
    (w, h, small)
}

/// An XMP packet with the facts as JSON.
fn xmp(facts: &ExposureFacts) -> Vec<u8> {
    let json = serde_json::to_string(facts).expect("plain data becomes JSON");
    let escaped = json.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let mut packet = format!(
        "<?xpacket begin=\"\u{feff}\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?>\n\
         <x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
         <rdf:Description rdf:about=\"\" xmlns:diopter=\"{XMP_NAMESPACE}\" diopter:facts=\"{escaped}\"/>\
         </rdf:RDF></x:xmpmeta>\n<?xpacket end=\"w\"?>"
    )
    .into_bytes();
    if packet.len() % 2 == 1 {
        packet.push(b' ');
    }
    packet
}

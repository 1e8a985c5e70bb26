//! Reading: our own files and others': mosaics and linear files (three samples a pixel), uncompressed, deflated, in lossless or 8-bit lossy JPEG, in JPEG XL, in
//! strips or tiles, of 8 to 16 bits or floating point. Corrections of the opcode lists 1 and 2 are applied here, those of list 3 handed on. How numbers
//! become linear values: DNG 1.6, chapter 5.

use super::disguise::Disguised;
use super::opcode::{self, Action, Opcode, SHORT, Values};
use super::parts::{self, Storage};
use super::{FILTER_NUMBERS, XMP_NAMESPACE, photometric, tag};
use crate::exif::EXIF_DIRECTORY;
use crate::raw::{Cfa, ColorCalibration, Filter, Framing, LightSource, Orientation, RawHeader};
use crate::streams::ReadSeek;
use crate::{ExposureFacts, ImageError, Raster, RawImage};
use std::io::{Read, Seek, SeekFrom};
use tiff::Directory;
use tiff::decoder::{Decoder, ifd::Value};
use tiff::tags::{IfdPointer, Tag};

/// Most numbers that are read.
const MOST_NUMBERS: usize = 1 << 30;

/// Black and white of numbers that are made here, of floating-point samples and of what opcodes have changed: noise below black has room.
const MADE_LEVELS: [f64; 2] = [2048.0, 65_535.0];

/// Daylight for files that do not tell their white: chromaticity and temperature of D55. Source: CIE 15:2018, table T.3.
const DAYLIGHT_XY: [f64; 2] = [0.332_43, 0.347_44];
const DAYLIGHT_KELVIN: f64 = 5503.0;

/// Longest way of a warp that is believed, as a part of the diagonal: no lens that makes a picture moves light further.
const LONGEST_WARP: f64 = 0.5;

pub(super) fn malformed(reason: impl Into<String>) -> ImageError {
    let reason = reason.into();
    // What the reader says when the bytes run out.
    let reason = match reason.contains("failed to fill whole buffer") || reason.contains("end of file") {
        true => "it ends before what it announces: cut short".into(),
        false => reason,
    };
    ImageError::Malformed { format: "DNG", reason }
}

fn missing(what: &str) -> ImageError {
    malformed(format!("{what} is missing"))
}

/// A file and its directories.
struct File<R: Read + Seek> {
    decoder: Decoder<R>,
}

impl<R: Read + Seek> File<R> {
    fn directory(&mut self, place: u64) -> Result<Directory, ImageError> {
        self.decoder.read_directory(IfdPointer(place)).map_err(|e| malformed(e.to_string()))
    }

    fn find(&mut self, d: &Directory, number: u16) -> Result<Option<Value>, ImageError> {
        let found = self.decoder.read_directory_tags(d).find_tag(Tag::from_u16_exhaustive(number));
        found.map_err(|e| malformed(format!("tag {number}: {e}")))
    }

    /// Numbers of a tag; none where there is no tag.
    fn numbers(&mut self, d: &Directory, number: u16) -> Result<Vec<f64>, ImageError> {
        fn flat(value: Value, to: &mut Vec<f64>) -> bool {
            match value {
                Value::List(list) => return list.into_iter().all(|v| flat(v, to)),
                Value::Byte(v) => to.push(v.into()),
                Value::Short(v) => to.push(v.into()),
                Value::Unsigned(v) | Value::Ifd(v) => to.push(v.into()),
                Value::UnsignedBig(v) | Value::IfdBig(v) => to.push(v as f64),
                Value::SignedByte(v) => to.push(v.into()),
                Value::SignedShort(v) => to.push(v.into()),
                Value::Signed(v) => to.push(v.into()),
                Value::SignedBig(v) => to.push(v as f64),
                Value::Float(v) => to.push(v.into()),
                Value::Double(v) => to.push(v),
                Value::Rational(n, d) => to.push(f64::from(n) / f64::from(d)),
                Value::SRational(n, d) => to.push(f64::from(n) / f64::from(d)),
                _ => return false,
            }
            true
        }
        let mut all = Vec::new();
        if let Some(value) = self.find(d, number)?
            && !flat(value, &mut all)
        {
            return Err(malformed(format!("tag {number} holds no numbers")));
        }
        Ok(all)
    }

    fn number(&mut self, d: &Directory, number: u16) -> Result<Option<f64>, ImageError> {
        Ok(self.numbers(d, number)?.first().copied())
    }

    fn text(&mut self, d: &Directory, number: u16) -> Result<String, ImageError> {
        Ok(match self.find(d, number)? {
            Some(Value::Ascii(text)) => text.trim_end_matches('\0').trim().to_owned(),
            _ => String::new(),
        })
    }
}

/// Reads the mosaic of a DNG and what it says about it.
pub fn read(mut from: impl Read + Seek) -> Result<RawImage, ImageError> {
    read_from(&mut from)
}

fn read_from(from: &mut dyn ReadSeek) -> Result<RawImage, ImageError> {
    let (from, first) = Disguised::new(from)?;
    let mut decoder = Decoder::new(from).map_err(|e| malformed(e.to_string()))?;
    let first = first.or_else(|| decoder.ifd_pointer().map(|p| p.0)).ok_or_else(|| missing("the first directory"))?;
    decoder.inner().undress();
    let mut file = File { decoder };
    let main = file.directory(first)?;
    if !main.contains(Tag::from_u16_exhaustive(tag::DNG_VERSION)) {
        return Err(ImageError::Missing {
            what: "the tag DNGVersion".into(),
            hint: "this is a TIFF, as other makers' raw files are (CR2, NEF, ARW): convert it to DNG first".into(),
        });
    }
    let mut places = file.numbers(&main, tag::SUB_IFDS)?;
    places.truncate(32);
    let mut raw = None;
    for place in std::iter::once(first as f64).chain(places) {
        let d = file.directory(place as u64)?;
        let kind = file.number(&d, tag::PHOTOMETRIC)?.unwrap_or(0.0);
        let mosaic = [photometric::CFA, photometric::LINEAR_RAW].iter().any(|p| kind == f64::from(*p));
        if mosaic && file.number(&d, tag::NEW_SUBFILE_TYPE)?.unwrap_or(0.0) == 0.0 {
            raw = Some((d, kind));
            break;
        }
    }
    let (raw, kind) = raw.ok_or_else(|| missing("a picture of raw numbers (a mosaic, or LinearRaw)"))?;
    let storage = storage(&mut file, &raw)?;
    let cfa = match (kind == f64::from(photometric::CFA), storage.samples) {
        (true, 1) => pattern(&mut file, &raw)?,
        (false, 1) => Cfa::monochrome(),
        (false, 3) => Cfa::linear_rgb(),
        (mosaic, n) => {
            let kind = if mosaic { "a mosaic" } else { "a linear raw image" };
            return Err(malformed(format!("{n} samples a pixel in {kind}: expected 1, or 3 (red, green, blue) of a linear one")));
        }
    };
    let [black, white] = levels(&mut file, &raw, &storage)?;
    let mut warnings = Vec::new();
    let mut mosaic = pixels(&mut file, &raw, &storage, [black, white])?;
    let area = active_area(&mut file, &raw, [mosaic.width / storage.samples, mosaic.height])?;
    if storage.float {
        warnings.push("floating-point samples are read with 16 bits between black and white".into());
    }
    let first = opcodes(&mut file, &raw, 1, &storage, &mut warnings)?;
    raw_corrections(&mut mosaic, &first, &cfa, area, storage.float, &mut warnings);
    let table = file.numbers(&raw, tag::LINEARIZATION_TABLE)?;
    if let Some(last) = table.len().checked_sub(1)
        && !storage.float
    {
        mosaic.data.iter_mut().for_each(|v| *v = table[(*v as usize).min(last)] as u16);
    }
    let mut header = header(&mut file, &main, &raw, cfa, &storage, &mut warnings)?;
    if !table.is_empty() {
        // Its entries have 16 bits.
        header.bits = 16;
    }
    let mut mosaic = cropped(mosaic, area, storage.samples);
    even_black(&mut file, &raw, &mut mosaic, &storage, [black, white])?;
    let size = [mosaic.width / storage.samples, mosaic.height];
    let mut crop = crop(&mut file, &raw, size)?;
    let second = opcodes(&mut file, &raw, 2, &storage, &mut warnings)?;
    let third = opcodes(&mut file, &raw, 3, &storage, &mut warnings)?;
    // Where nothing is to be demosaiced, what follows a warp of list 2 can as well be done with list 3.
    let whole = header.cfa.has_all_channels() || header.cfa.is_monochrome();
    let warp = second.iter().position(|o| matches!(o.action, Action::Warp(_))).filter(|_| whole).unwrap_or(second.len());
    let (now, later) = second.split_at(warp);
    for opcode in now.iter().filter(|o| !o.optional && matches!(o.action, Action::Warp(_))) {
        warnings.push(format!("OpcodeList2: {opcode} of a mosaic was left out; distortion remains"));
    }
    linear_corrections(&mut mosaic, &mut header, now, &mut warnings);
    for opcode in second.iter().chain(&third) {
        if let Action::TrimBounds(bounds) = opcode.action {
            crop = trimmed(crop, bounds, size);
        }
    }
    header.opcodes = remaining(later.iter().chain(&third), size, &mut warnings);
    // Rows hold the samples of a pixel side by side.
    let in_numbers = |[x, y, w, h]: [usize; 4]| [x * storage.samples, y, w * storage.samples, h];
    let scale = file.numbers(&main, tag::DEFAULT_SCALE)?;
    let scale = if scale.is_empty() { file.numbers(&raw, tag::DEFAULT_SCALE)? } else { scale };
    header.framing = Framing {
        crop: crop.map(in_numbers),
        orientation: Orientation::from_exif(file.number(&main, tag::ORIENTATION)?.unwrap_or(1.0) as u16),
        scale: match scale[..] {
            [x, y] if [x, y].iter().all(|v| (0.1..=10.0).contains(v)) => [x, y],
            _ => [1.0; 2],
        },
    };
    header.warnings = warnings;
    Ok(RawImage { mosaic, header })
}

/// How the numbers are stored.
fn storage<R: Read + Seek>(file: &mut File<R>, raw: &Directory) -> Result<Storage, ImageError> {
    let samples = file.number(raw, tag::SAMPLES_PER_PIXEL)?.unwrap_or(1.0);
    if !(1.0..=4.0).contains(&samples) {
        return Err(malformed(format!("{samples} samples a pixel: expected 1 or 3")));
    }
    if samples > 1.0 && file.number(raw, tag::PLANAR)?.unwrap_or(1.0) != 1.0 {
        return Err(malformed("samples of a pixel in planes of their own (PlanarConfiguration 2): expected side by side (1)"));
    }
    let float = file.number(raw, tag::SAMPLE_FORMAT)?.unwrap_or(1.0) == 3.0;
    let all = file.numbers(raw, tag::BITS_PER_SAMPLE)?;
    let bits = all.first().copied().unwrap_or(16.0);
    let expected = if float { "16, 24 or 32 of floating point" } else { "8 to 16" };
    let fine = if float { [16.0, 24.0, 32.0].contains(&bits) } else { (8.0..=16.0).contains(&bits) };
    if !fine || all.iter().any(|b| *b != bits) {
        return Err(malformed(format!("{all:?} bits a number: expected {expected}, the same for all samples")));
    }
    Ok(Storage {
        samples: samples as usize,
        bits: bits as u32,
        float,
        compression: file.number(raw, tag::COMPRESSION)?.unwrap_or(1.0) as u16,
        predictor: file.number(raw, tag::PREDICTOR)?.unwrap_or(1.0) as u16,
        order: file.decoder.byte_order(),
    })
}

/// Black (the mean of all cells) and white of the numbers as the file has them.
fn levels<R: Read + Seek>(file: &mut File<R>, raw: &Directory, storage: &Storage) -> Result<[f64; 2], ImageError> {
    let cells = file.numbers(raw, tag::BLACK_LEVEL)?;
    let black = if cells.is_empty() { 0.0 } else { cells.iter().sum::<f64>() / cells.len() as f64 };
    let top = if storage.float { 1.0 } else { f64::from((1u32 << storage.bits) - 1) };
    let white = file.number(raw, tag::WHITE_LEVEL)?.unwrap_or(top);
    let fine = black < white && white.is_finite() && black.is_finite();
    match fine && (storage.float || black >= 0.0 && white <= 65_535.0) {
        true => Ok([black, white]),
        false => Err(malformed(format!("black level {black} and white level {white} contradict each other"))),
    }
}

/// An opcode list; empty where the file has none.
fn opcodes<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    number: usize,
    storage: &Storage,
    warnings: &mut Vec<String>,
) -> Result<Vec<Opcode>, ImageError> {
    let bytes: Vec<u8> = file.numbers(raw, tag::OPCODE_LIST[number - 1])?.into_iter().map(|v| v as u8).collect();
    if bytes.is_empty() { Ok(Vec::new()) } else { opcode::list(&bytes, number, storage.float, warnings) }
}

/// Opcode list 1, on the numbers as read; `float`: whether those are floating point. `area`: top, left, bottom, right of the active area, at whose corner the pattern begins.
fn raw_corrections(
    mosaic: &mut Raster<u16>,
    opcodes: &[Opcode],
    cfa: &Cfa,
    area: [usize; 4],
    float: bool,
    warnings: &mut Vec<String>,
) {
    for opcode in opcodes.iter().filter(|o| !o.optional && matches!(o.action, Action::Warp(_) | Action::TrimBounds(_))) {
        warnings.push(format!("OpcodeList1: {opcode} of raw numbers was left out"));
    }
    if opcodes.is_empty() {
        return;
    }
    // Floating-point numbers stand at levels of our own; opcodes mean the numbers of the file.
    let [black, white] = MADE_LEVELS;
    let read = |v: &u16| if float { ((f64::from(*v) - black) / (white - black)) as f32 } else { f32::from(*v) / SHORT };
    let mut values = Values {
        data: mosaic.data.iter().map(read).collect(),
        size: [mosaic.width / cfa.samples_per_pixel(), mosaic.height],
        cfa,
        phase: [area[1], area[0]],
    };
    values.apply(opcodes, warnings);
    let written = |v: f32| if float { made(f64::from(v)) } else { (v * SHORT).round().clamp(0.0, SHORT) as u16 };
    mosaic.data.iter_mut().zip(&values.data).for_each(|(to, v)| *to = written(*v));
}

/// Opcode list 2, on linear values. The numbers get other levels, in which they are finer.
fn linear_corrections(mosaic: &mut Raster<u16>, header: &mut RawHeader, opcodes: &[Opcode], warnings: &mut Vec<String>) {
    if opcodes.iter().all(|o| matches!(o.action, Action::Warp(_) | Action::TrimBounds(_))) {
        return;
    }
    let (black, range) = (header.black_level, header.white_level - header.black_level);
    let mut values = Values {
        data: mosaic.data.iter().map(|v| ((f64::from(*v) - black) / range) as f32).collect(),
        size: [mosaic.width / header.cfa.samples_per_pixel(), mosaic.height],
        cfa: &header.cfa,
        phase: [0, 0],
    };
    values.apply(opcodes, warnings);
    mosaic.data.iter_mut().zip(&values.data).for_each(|(to, v)| *to = made(f64::from(*v)));
    header.bits = 16;
    [header.black_level, header.white_level] = MADE_LEVELS;
}

/// The number of a linear value (0 black, 1 white) at [`MADE_LEVELS`].
fn made(value: f64) -> u16 {
    let [black, white] = MADE_LEVELS;
    (black + value * (white - black)).round().clamp(0.0, 65_535.0) as u16
}

/// What is left to be done behind the demosaic: corrections of pixels, and one warp.
fn remaining<'a>(opcodes: impl Iterator<Item = &'a Opcode>, size: [usize; 2], warnings: &mut Vec<String>) -> Vec<Opcode> {
    let mut kept: Vec<Opcode> = Vec::new();
    let mut warped = false;
    for opcode in opcodes {
        let why = match &opcode.action {
            Action::TrimBounds(_) => continue,
            Action::Warp(_) if warped => "was left out: one warp is applied",
            Action::Warp(warp) if !(warp.reach(size) <= LONGEST_WARP) => {
                "was left out: it moves pixels by more than half the diagonal, as no lens does"
            }
            Action::FixBadPixelsConstant(_) | Action::FixBadPixelsList { .. } => {
                "was left out: bad pixels are repaired in a mosaic"
            }
            action => {
                warped |= matches!(action, Action::Warp(_));
                kept.push(opcode.clone());
                continue;
            }
        };
        if !opcode.optional {
            warnings.push(format!("opcode list: {opcode} {why}"));
        }
    }
    kept
}

/// The part of a crop that lies inside bounds (top, left, bottom, right); as it was where none does.
fn trimmed(crop: Option<[usize; 4]>, [top, left, bottom, right]: [u32; 4], [width, height]: [usize; 2]) -> Option<[usize; 4]> {
    let [x, y, w, h] = crop.unwrap_or([0, 0, width, height]);
    let (x1, y1) = ((x + w).min(right as usize), (y + h).min(bottom as usize));
    let (x0, y0) = (x.max(left as usize), y.max(top as usize));
    if x0 < x1 && y0 < y1 { Some([x0, y0, x1 - x0, y1 - y0]) } else { crop }
}

fn pattern<R: Read + Seek>(file: &mut File<R>, raw: &Directory) -> Result<Cfa, ImageError> {
    let repeat = file.numbers(raw, tag::CFA_REPEAT)?;
    let cells = file.numbers(raw, tag::CFA_PATTERN)?;
    let filter = |n: &f64| FILTER_NUMBERS.iter().find(|f| f64::from(f.1) == *n).map(|f| f.0);
    let filters: Option<Vec<Filter>> = cells.iter().map(filter).collect();
    let (Some(filters), &[rows, columns]) = (filters, repeat.as_slice()) else {
        return Err(malformed(format!("the colour filter array {repeat:?} {cells:?} is not of red, green, blue and clear")));
    };
    let cfa = if rows as usize * columns as usize == filters.len() { Cfa::new(columns as usize, filters) } else { None };
    cfa.ok_or_else(|| malformed(format!("the colour filter array is no rectangle: {repeat:?} of {} cells", cells.len())))
}

/// All numbers of the picture, row by row. `levels`: black and white of floating-point ones.
fn pixels<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    storage: &Storage,
    levels: [f64; 2],
) -> Result<Raster<u16>, ImageError> {
    let mut side = |t: u16, what: &str| -> Result<usize, ImageError> {
        let told = file.number(raw, t)?.ok_or_else(|| missing(what))?;
        match (1.0..=1e6).contains(&told) {
            true => Ok(told as usize),
            false => Err(malformed(format!("{what} is {told}: expected 1 to 1000000"))),
        }
    };
    let (width, height) = (side(tag::WIDTH, "the width")?, side(tag::HEIGHT, "the height")?);
    let samples = storage.samples;
    if width * height * samples > MOST_NUMBERS {
        return Err(malformed(format!("{width} × {height} pixels are more than can be read")));
    }
    let tiled = raw.contains(Tag::from_u16_exhaustive(tag::TILE_OFFSETS));
    let (places, counts) = match tiled {
        true => (file.numbers(raw, tag::TILE_OFFSETS)?, file.numbers(raw, tag::TILE_BYTE_COUNTS)?),
        false => (file.numbers(raw, tag::STRIP_OFFSETS)?, file.numbers(raw, tag::STRIP_BYTE_COUNTS)?),
    };
    let part = |v: Option<f64>, whole: usize| v.map_or(whole, |v| (v as usize).clamp(1, 1 << 20));
    let (part_width, part_height) = match tiled {
        true => (part(file.number(raw, tag::TILE_WIDTH)?, width), part(file.number(raw, tag::TILE_LENGTH)?, height)),
        false => (width, part(file.number(raw, tag::ROWS_PER_STRIP)?, height).min(height)),
    };
    let across = width.div_ceil(part_width);
    let needed = across * height.div_ceil(part_height);
    if places.len() < needed || counts.len() < needed {
        return Err(malformed(format!("{} parts of the picture of {needed}", places.len().min(counts.len()))));
    }
    if part_width.checked_mul(part_height * samples).is_none_or(|n| n > MOST_NUMBERS) {
        return Err(malformed("a tile is too large"));
    }
    // Parts do not overlap, and their bytes become so many numbers at most: of no more pixels than that is memory asked for.
    let stored: f64 = counts[..needed].iter().sum();
    let length = file.decoder.inner().seek(SeekFrom::End(0))?;
    if stored > length as f64 {
        return Err(malformed(format!(
            "it ends early: the parts of the picture have {stored} bytes, and the file {length}: cut short"
        )));
    }
    let most = parts::most_numbers_a_byte(storage) * stored;
    if (width * height * samples) as f64 > most {
        return Err(malformed(format!(
            "{width} × {height} pixels are announced, and their {stored} bytes can become {most} numbers at most: damaged"
        )));
    }
    let linear = |v: f32| made((f64::from(v) - levels[0]) / (levels[1] - levels[0]));
    // Rows are added as their data are found: a file that lies about its size takes no memory for it.
    let mut data: Vec<u16> = Vec::new();
    let (row, part_row) = (width * samples, part_width * samples);
    for i in 0..needed {
        let (left, top) = (i % across * part_row, i / across * part_height);
        let rows = part_height.min(height - top);
        let source = file.decoder.inner();
        source.seek(SeekFrom::Start(places[i] as u64))?;
        let mut bytes = Vec::new();
        source.take(counts[i] as u64).read_to_end(&mut bytes)?;
        if (bytes.len() as f64) < counts[i] {
            return Err(malformed(format!("it ends early: part {} of {needed} of the picture is cut short", i + 1)));
        }
        let part = parts::numbers(&bytes, storage, [part_width, part_height, rows], linear)
            .map_err(|e| malformed(format!("part {} of {needed} of the picture: {e}", i + 1)))?;
        if left == 0 {
            data.resize((top + rows) * row, 0);
        }
        let w = part_row.min(row - left);
        for k in 0..rows {
            let to = (top + k) * row + left;
            data[to..to + w].copy_from_slice(&part[k * part_row..k * part_row + w]);
        }
    }
    let factor = |v: Option<f64>| v.map_or(1, |v| (v as usize).max(1));
    let across = factor(file.number(raw, tag::COLUMN_INTERLEAVE_FACTOR)?);
    let down = factor(file.number(raw, tag::ROW_INTERLEAVE_FACTOR)?);
    Ok(interleaved(Raster { width: row, height, channels: 1, data }, samples, [across, down]))
}

/// Fields put together: with factors 2 and 2, those of the four cells of a Bayer mosaic, which stand beside and below each other as four pictures.
/// Source: DNG 1.7.1, tags RowInterleaveFactor and ColumnInterleaveFactor.
fn interleaved(fields: Raster<u16>, samples: usize, [across, down]: [usize; 2]) -> Raster<u16> {
    if [across, down] == [1, 1] {
        return fields;
    }
    // Where the numbers of a row or column belong: all of the first field come first, then all of the second.
    let places =
        |n: usize, factor: usize| (0..factor.min(n)).flat_map(move |field| (field..n).step_by(factor)).collect::<Vec<usize>>();
    let (columns, rows) = (places(fields.width / samples, across), places(fields.height, down));
    let mut data = vec![0; fields.data.len()];
    for (from, row) in fields.data.chunks(fields.width).zip(rows) {
        let to = &mut data[row * fields.width..][..fields.width];
        for (pixel, column) in from.chunks(samples).zip(&columns) {
            to[column * samples..][..samples].copy_from_slice(pixel);
        }
    }
    Raster { data, ..fields }
}

/// Top, left, bottom, right of the active area in pixels; the pattern of a DNG begins at its corner.
fn active_area<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    [width, height]: [usize; 2],
) -> Result<[usize; 4], ImageError> {
    let area = file.numbers(raw, tag::ACTIVE_AREA)?;
    let [top, left, bottom, right] = area[..] else { return Ok([0, 0, height, width]) };
    let [top, left, bottom, right] = [top, left, bottom, right].map(|v| v.max(0.0) as usize);
    let (bottom, right) = (bottom.min(height), right.min(width));
    if top >= bottom || left >= right {
        return Err(malformed(format!("the active area {area:?} is empty")));
    }
    Ok([top, left, bottom, right])
}

/// The active area of the numbers.
fn cropped(mosaic: Raster<u16>, [top, left, bottom, right]: [usize; 4], samples: usize) -> Raster<u16> {
    let (left, right) = (left * samples, right * samples);
    if (top, left, bottom, right) == (0, 0, mosaic.height, mosaic.width) {
        return mosaic;
    }
    let data = (top..bottom).flat_map(|r| mosaic.data[r * mosaic.width + left..r * mosaic.width + right].to_vec()).collect();
    Raster { width: right - left, height: bottom - top, channels: 1, data }
}

/// Black levels that differ by place or sample are brought to their mean: what a cell or a row or column has more is taken off its numbers.
/// `levels`: black and white as the file has them.
fn even_black<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    mosaic: &mut Raster<u16>,
    storage: &Storage,
    levels: [f64; 2],
) -> Result<(), ImageError> {
    let samples = storage.samples;
    let cells = file.numbers(raw, tag::BLACK_LEVEL)?;
    let repeat = file.numbers(raw, tag::BLACK_REPEAT)?;
    let [rows, columns] = match repeat[..] {
        [r, c] if r >= 1.0 && c >= 1.0 && r * c * samples as f64 == cells.len() as f64 => [r as usize, c as usize],
        _ => [1, 1],
    };
    let [across, down] = [file.numbers(raw, tag::BLACK_DELTA[0])?, file.numbers(raw, tag::BLACK_DELTA[1])?];
    let differ = rows * columns * samples == cells.len() && cells.iter().any(|b| *b != levels[0]);
    if !differ && across.iter().chain(&down).all(|d| *d == 0.0) {
        return Ok(());
    }
    // Floating-point samples have other levels by now.
    let unit = if storage.float { (MADE_LEVELS[1] - MADE_LEVELS[0]) / (levels[1] - levels[0]) } else { 1.0 };
    let width = mosaic.width;
    for (y, line) in mosaic.data.chunks_exact_mut(width).enumerate() {
        let of_row = down.get(y).copied().unwrap_or(0.0);
        for (i, dn) in line.iter_mut().enumerate() {
            let (x, sample) = (i / samples, i % samples);
            let cell = match differ {
                true => cells[(y % rows * columns + x % columns) * samples + sample] - levels[0],
                false => 0.0,
            };
            let more = cell + of_row + across.get(x).copied().unwrap_or(0.0);
            *dn = (f64::from(*dn) - more * unit).round().clamp(0.0, 65_535.0) as u16;
        }
    }
    Ok(())
}

/// What is to be shown of the active area (`size` pixels): left, top, width, height; `None` where all is.
fn crop<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    [width, height]: [usize; 2],
) -> Result<Option<[usize; 4]>, ImageError> {
    let (origin, size) = (file.numbers(raw, tag::CROP_ORIGIN)?, file.numbers(raw, tag::CROP_SIZE)?);
    let ([x, y], [w, h]) = (
        match origin[..] {
            [x, y] => [x, y],
            _ => [0.0, 0.0],
        },
        match size[..] {
            [w, h] => [w, h],
            _ => return Ok(None),
        },
    );
    let [x, y, w, h] = [x, y, w, h].map(|v| v.round().max(0.0) as usize);
    let inside = w > 0 && h > 0 && x.saturating_add(w) <= width && y.saturating_add(h) <= height;
    Ok((inside && [x, y, w, h] != [0, 0, width, height]).then_some([x, y, w, h]))
}

/// Whether the rows of a matrix of three columns lie in a plane, or its numbers are no camera's: then colours cannot be made of it.
fn flat(rows: &[f64]) -> bool {
    let rows = rows.as_chunks::<3>().0;
    let mut square = [[0.0; 3]; 3];
    for r in rows {
        (0..9).for_each(|i| square[i / 3][i % 3] += r[i / 3] * r[i % 3]);
    }
    let [a, b, c] = square;
    let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let trace = a[0] + b[1] + c[2];
    // Those of cameras have numbers of about one.
    let largest = rows.as_flattened().iter().fold(0.0f64, |a, b| a.max(b.abs()));
    !(1e-2..=1e3).contains(&largest) || rows.len() >= 3 && !(det.abs() > 1e-9 * trace.powi(3))
}

fn header<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    raw: &Directory,
    cfa: Cfa,
    storage: &Storage,
    warnings: &mut Vec<String>,
) -> Result<RawHeader, ImageError> {
    let facts = facts(file, main)?;
    let polarizers = Cfa::parse(&facts.polarizers).filter(|p| cfa.is_monochrome() && p.tells_polarization());
    let cfa = polarizers.unwrap_or(cfa);
    let n = cfa.channel_count();
    let [black_level, white_level] = if storage.float { MADE_LEVELS } else { levels(file, raw, storage)? };
    let mut calibrations = Vec::new();
    if !cfa.is_colorless() {
        for k in 0..2 {
            let color = file.numbers(main, tag::COLOR_MATRIX[k])?;
            let forward = file.numbers(main, tag::FORWARD_MATRIX[k])?;
            if color.is_empty() {
                continue;
            }
            if color.len() != 3 * n || color.iter().chain(&forward).any(|v| !v.is_finite()) || flat(&color) {
                return Err(malformed(format!(
                    "ColorMatrix{} is no matrix of {n} × 3 numbers that tells colours apart: {color:?}",
                    k + 1
                )));
            }
            let light = file.number(main, tag::CALIBRATION_ILLUMINANT[k])?.unwrap_or(0.0);
            let own = calibrated(file, main, k, n)?;
            let rows = color.as_chunks::<3>().0;
            let row = |c: usize| std::array::from_fn(|j| (0..n).map(|i| own[c * n + i] * rows[i][j]).sum());
            let camera_from_xyz: Vec<[f64; 3]> = (0..n).map(row).collect();
            if flat(camera_from_xyz.as_flattened()) {
                return Err(malformed(format!(
                    "CameraCalibration{} and AnalogBalance make ColorMatrix{} one that tells no colours apart: {own:?}",
                    k + 1,
                    k + 1
                )));
            }
            calibrations.push(ColorCalibration {
                light: LightSource(light as u16),
                camera_from_xyz,
                xyz_d50_from_balanced: match forward.len() == 3 * n {
                    true => (0..n).map(|c| std::array::from_fn(|row| forward[row * n + c])).collect(),
                    false => Vec::new(),
                },
            });
        }
        if calibrations.is_empty() {
            return Err(ImageError::Missing {
                what: "the tag ColorMatrix1".into(),
                hint: "without it colours cannot be made".into(),
            });
        }
    }
    let neutral = neutral(file, main, n, &calibrations, warnings)?;
    let largest = neutral.iter().fold(0.0f64, |a, b| a.max(*b));
    let baseline = file.number(main, tag::BASELINE_EXPOSURE)?.filter(|v| v.abs() <= 10.0).unwrap_or(0.0);
    let noise = file.numbers(raw, tag::NOISE_PROFILE)?;
    // One pair stands for all planes.
    let noise = if noise.len() == 2 { noise.repeat(n) } else { noise };
    let fine = noise.len() == 2 * n && noise.iter().all(|v| v.is_finite() && *v >= 0.0);
    let noise = if fine { noise.as_chunks::<2>().0.to_vec() } else { Vec::new() };
    Ok(RawHeader {
        cfa,
        bits: if storage.float { 16 } else { storage.bits },
        black_level,
        white_level,
        as_shot_neutral: neutral.iter().map(|v| v / largest).collect(),
        calibrations,
        baseline_ev: baseline,
        framing: Framing::default(),
        opcodes: Vec::new(),
        warnings: Vec::new(),
        noise,
        facts,
    })
}

/// What the body differs from its model: AnalogBalance · CameraCalibration, row by row; ones where the file does not tell.
fn calibrated<R: Read + Seek>(file: &mut File<R>, main: &Directory, k: usize, n: usize) -> Result<Vec<f64>, ImageError> {
    let own = file.numbers(main, tag::CAMERA_CALIBRATION[k])?;
    let balance = file.numbers(main, tag::ANALOG_BALANCE)?;
    let fine = |v: &[f64], length: usize| v.len() == length && v.iter().all(|x| x.is_finite());
    let balance = if fine(&balance, n) && balance.iter().all(|v| *v > 0.0) { balance } else { vec![1.0; n] };
    let unit = |i: usize| f64::from(u8::from(i / n == i % n));
    let own = if fine(&own, n * n) { own } else { (0..n * n).map(unit).collect() };
    Ok((0..n * n).map(|i| balance[i / n] * own[i]).collect())
}

/// Camera signals of white: told, or from its chromaticity, or of daylight, with a warning; all the same where there is no matrix.
fn neutral<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    n: usize,
    calibrations: &[ColorCalibration],
    warnings: &mut Vec<String>,
) -> Result<Vec<f64>, ImageError> {
    // No channel of a camera sees a millionth of another's white.
    let least = |v: &[f64]| 1e-6 * v.iter().fold(0.0f64, |a, b| a.max(*b));
    let fine = |v: &[f64]| v.len() == n && v.iter().all(|x| *x > least(v) && x.is_finite());
    let told = file.numbers(main, tag::AS_SHOT_NEUTRAL)?;
    if fine(&told) {
        return Ok(told);
    }
    if !told.is_empty() {
        return Err(malformed(format!("AsShotNeutral is {told:?}: expected {n} numbers above 0, none a millionth of another")));
    }
    // The calibration whose light is nearest to daylight.
    let off = |c: &ColorCalibration| c.light.kelvin().map_or(f64::MAX, |k| (1.0 / k - 1.0 / DAYLIGHT_KELVIN).abs());
    let Some(nearest) = calibrations.iter().min_by(|a, b| off(a).total_cmp(&off(b))) else { return Ok(vec![1.0; n]) };
    let signal = |c: &ColorCalibration, [x, y]: [f64; 2]| -> Vec<f64> {
        let xyz = [x / y, 1.0, (1.0 - x - y) / y];
        c.camera_from_xyz.iter().map(|row| row.iter().zip(xyz).map(|(a, b)| a * b).sum()).collect()
    };
    if let ([x, y], Some(c)) = (&file.numbers(main, tag::AS_SHOT_WHITE_XY)?[..], calibrations.last())
        && *y > 0.0
    {
        let signal = signal(c, [*x, *y]);
        if fine(&signal) {
            return Ok(signal);
        }
    }
    let daylight = signal(nearest, DAYLIGHT_XY);
    let told = "the file does not say what was white (AsShotNeutral)";
    if fine(&daylight) {
        warnings.push(format!("{told}: daylight was taken (D55, by its colour matrix); the setting white.balance takes another"));
        return Ok(daylight);
    }
    warnings.push(format!("{told}, and its colour matrix gives no white: all channels were taken alike"));
    Ok(vec![1.0; n])
}

/// The facts: our own as they were, others' from EXIF.
fn facts<R: Read + Seek>(file: &mut File<R>, main: &Directory) -> Result<ExposureFacts, ImageError> {
    let packet: Vec<u8> = file.numbers(main, tag::XMP).unwrap_or_default().into_iter().map(|v| v as u8).collect();
    if let Some(facts) = our_facts(&String::from_utf8_lossy(&packet)) {
        return Ok(facts);
    }
    let place = file.number(main, EXIF_DIRECTORY)?;
    // EXIF that is damaged is no reason not to develop.
    let exif = place.and_then(|p| file.directory(p as u64).ok()).unwrap_or_else(Directory::empty);
    let mut number = |t: u16| file.number(&exif, t).ok().flatten().filter(|v| v.is_finite());
    let mut facts = ExposureFacts {
        exposure_s: number(33434).unwrap_or(0.0),
        f_number: number(33437).unwrap_or(0.0),
        iso: number(34867).or_else(|| number(34855)).unwrap_or(0.0),
        focal_length_mm: number(37386).unwrap_or(0.0),
        focal_length_35mm_mm: number(41989).unwrap_or(0.0),
        focus_distance_m: number(37382),
        light_scale: 1.0,
        ..Default::default()
    };
    facts.make = file.text(main, 271)?;
    facts.model = file.text(main, 272)?;
    facts.software = file.text(main, 305)?;
    facts.lens = file.text(&exif, 42036).unwrap_or_default();
    facts.date = Some(file.text(&exif, 36867).unwrap_or_default()).filter(|d| !d.is_empty());
    facts.body = facts.model.clone();
    Ok(facts)
}

fn our_facts(packet: &str) -> Option<ExposureFacts> {
    packet.contains(XMP_NAMESPACE).then_some(())?;
    let escaped = packet.split_once("diopter:facts=\"")?.1.split_once('"')?.0;
    let json = escaped.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    serde_json::from_str(&json).ok()
}

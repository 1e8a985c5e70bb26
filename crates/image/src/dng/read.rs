//! Reading: our own files and others': mosaics and linear files (three samples a pixel), uncompressed, deflated, in lossless or 8-bit lossy JPEG, in JPEG XL, in
//! strips or tiles, of 8 to 16 bits or floating point. Corrections of the opcode lists 1 and 2 are applied here, those of list 3 handed on. How numbers
//! become linear values: DNG 1.6, chapter 5.

mod header;
mod mosaic;

use super::disguise::Disguised;
use super::opcode::{self, Action, Opcode, SHORT, Values};
use super::parts::Storage;
use super::{FILTER_NUMBERS, photometric, tag};
use crate::raw::{Cfa, Filter, Framing, Orientation, RawHeader};
use crate::streams::{ReadSeek, beginning, foreign};
use crate::{ImageError, Raster, RawImage};
use header::header;
use mosaic::{active_area, crop, cropped, even_black, pixels, trimmed};
use std::io::{Read, Seek};
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

/// Reads the mosaic of a DNG and what it says about it. Fails on a TIFF that is no DNG or holds no raw numbers, on samples, bits, patterns or levels that are not read, and
/// on a file that is damaged or cut short.
pub fn read(mut from: impl Read + Seek) -> Result<RawImage, ImageError> {
    read_from(&mut from)
}

fn read_from(from: &mut dyn ReadSeek) -> Result<RawImage, ImageError> {
    let start = beginning(from, 16)?;
    // Classic and large TIFF, in both orders of bytes.
    if !matches!(start[..], [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..]) {
        return Err(foreign("DNG", &start, "a raw file (DNG): of a focal plane diopter read-out makes one"));
    }
    let (from, first) = Disguised::new(from)?;
    let mut decoder = Decoder::new(from).map_err(|e| malformed(e.to_string()))?;
    let first = first.or_else(|| decoder.ifd_pointer().map(|p| p.0)).ok_or_else(|| missing("the first directory"))?;
    decoder.inner().restore();
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
    let higher = even_black(&mut file, &raw, &mut mosaic, &storage, [black, white])?;
    // Not where that would leave nothing.
    if higher < 0.5 * (header.white_level - header.black_level) {
        header.white_level -= higher;
    }
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

fn pattern<R: Read + Seek>(file: &mut File<R>, raw: &Directory) -> Result<Cfa, ImageError> {
    let repeat = file.numbers(raw, tag::CFA_REPEAT)?;
    let cells = file.numbers(raw, tag::CFA_PATTERN)?;
    // Every other row or column moved by a half is another mosaic. Source: DNG 1.7, CFALayout: 1 is a rectangle.
    if let Some(layout) = file.number(raw, tag::CFA_LAYOUT)?.filter(|layout| *layout != 1.0) {
        return Err(malformed(format!(
            "a colour filter array whose rows or columns are staggered (CFALayout {layout}); expected a rectangular one"
        )));
    }
    let filter = |n: &f64| FILTER_NUMBERS.iter().find(|f| f64::from(f.1) == *n).map(|f| f.0);
    let filters: Option<Vec<Filter>> = cells.iter().map(filter).collect();
    let (Some(filters), &[rows, columns]) = (filters, repeat.as_slice()) else {
        // Source of the numbers: DNG, tag CFAPlaneColor.
        const NAMES: [&str; 7] = ["red", "green", "blue", "cyan", "magenta", "yellow", "clear"];
        let name = |n: &f64| NAMES.get(*n as usize).map_or_else(|| format!("number {n}"), |name| (*name).to_owned());
        let found = cells.iter().map(name).collect::<Vec<_>>().join(", ");
        return Err(malformed(format!("a colour filter array of {found}; expected red, green, blue and clear")));
    };
    let cfa = if rows as usize * columns as usize == filters.len() { Cfa::new(columns as usize, filters) } else { None };
    cfa.ok_or_else(|| malformed(format!("the colour filter array is no rectangle: {repeat:?} of {} cells", cells.len())))
}

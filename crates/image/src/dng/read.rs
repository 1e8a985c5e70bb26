//! Reading: our own files and others' with one sample a pixel, uncompressed (8 to 16 bits) or in lossless JPEG, in strips or tiles.

use super::disguise::Disguised;
use super::{FILTER_NUMBERS, XMP_NAMESPACE, compression, lossless, packing, photometric, tag};
use crate::exif::EXIF_DIRECTORY;
use crate::raw::{Cfa, ColorCalibration, Filter, Framing, LightSource, Orientation, RawHeader};
use crate::{ExposureFacts, ImageError, Raster, RawImage};
use std::io::{Read, Seek, SeekFrom};
use tiff::Directory;
use tiff::decoder::{Decoder, ifd::Value};
use tiff::tags::{ByteOrder, IfdPointer, Tag};

/// Most pixels that are read.
const MOST_PIXELS: usize = 1 << 30;

fn malformed(reason: impl Into<String>) -> ImageError {
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
pub fn read(from: impl Read + Seek) -> Result<RawImage, ImageError> {
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
    let (raw, kind) = raw.ok_or_else(|| missing("a picture behind a colour filter array"))?;
    let samples = file.number(&raw, tag::SAMPLES_PER_PIXEL)?.unwrap_or(1.0);
    if samples != 1.0 {
        return Err(malformed(format!("{samples} samples a pixel: only files with one, not yet demosaiced, can be developed")));
    }
    let cfa = if kind == f64::from(photometric::CFA) { pattern(&mut file, &raw)? } else { Cfa::monochrome() };
    let bits = file.number(&raw, tag::BITS_PER_SAMPLE)?.unwrap_or(16.0);
    if !(8.0..=16.0).contains(&bits) {
        return Err(malformed(format!("{bits} bits a number: expected 8 to 16")));
    }
    let mut mosaic = pixels(&mut file, &raw, bits as u32)?;
    let table = file.numbers(&raw, tag::LINEARIZATION_TABLE)?;
    if let Some(last) = table.len().checked_sub(1) {
        mosaic.data.iter_mut().for_each(|v| *v = table[(*v as usize).min(last)] as u16);
    }
    let mut header = header(&mut file, &main, &raw, cfa, bits as u32)?;
    let mut mosaic = cropped(&mut file, &raw, mosaic)?;
    even_black(&mut file, &raw, &mut mosaic, &header)?;
    header.framing = Framing {
        crop: crop(&mut file, &raw, &mosaic)?,
        orientation: Orientation::from_exif(file.number(&main, tag::ORIENTATION)?.unwrap_or(1.0) as u16),
    };
    Ok(RawImage { mosaic, header })
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

fn pixels<R: Read + Seek>(file: &mut File<R>, raw: &Directory, bits: u32) -> Result<Raster<u16>, ImageError> {
    let mut side = |t: u16, what: &str| -> Result<usize, ImageError> {
        let told = file.number(raw, t)?.ok_or_else(|| missing(what))?;
        match (1.0..=1e6).contains(&told) {
            true => Ok(told as usize),
            false => Err(malformed(format!("{what} is {told}: expected 1 to 1000000"))),
        }
    };
    let (width, height) = (side(tag::WIDTH, "the width")?, side(tag::HEIGHT, "the height")?);
    if width * height > MOST_PIXELS {
        return Err(malformed(format!("{width} × {height} pixels are more than can be read")));
    }
    let method = file.number(raw, tag::COMPRESSION)?.unwrap_or(1.0);
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
    // Parts do not overlap, and no number takes less than a bit: of no more pixels than that is memory asked for.
    let stored: f64 = counts[..needed].iter().sum();
    let length = file.decoder.inner().seek(SeekFrom::End(0))?;
    if stored > length as f64 {
        return Err(malformed(format!(
            "it ends early: the parts of the picture have {stored} bytes, and the file {length}: cut short"
        )));
    }
    if width as f64 * height as f64 > 8.0 * stored {
        return Err(malformed(format!(
            "{width} × {height} pixels are announced, and their {stored} bytes can become {} at most: damaged",
            8.0 * stored
        )));
    }
    let order = file.decoder.byte_order();
    // Rows are added as their data are found: a file that lies about its size takes no memory for it.
    let mut data: Vec<u16> = Vec::new();
    for i in 0..needed {
        let (left, top) = (i % across * part_width, i / across * part_height);
        let rows = part_height.min(height - top);
        let source = file.decoder.inner();
        source.seek(SeekFrom::Start(places[i] as u64))?;
        let mut bytes = Vec::new();
        source.take(counts[i] as u64).read_to_end(&mut bytes)?;
        let short = || malformed(format!("it ends early: part {} of {needed} of the picture is cut short", i + 1));
        if (bytes.len() as f64) < counts[i] {
            return Err(short());
        }
        let whole =
            part_width.checked_mul(part_height).filter(|n| *n <= MOST_PIXELS).ok_or_else(|| malformed("a tile is too large"))?;
        let part: Vec<u16> = match method as u16 {
            compression::NONE => {
                let stride = packing::row_bytes(part_width, bits);
                if bytes.len() < stride * rows {
                    return Err(short());
                }
                let mut part = vec![0u16; part_width * rows];
                for (row, from) in part.chunks_mut(part_width).zip(bytes.chunks(stride)) {
                    match (bits, order) {
                        (16, ByteOrder::LittleEndian) => {
                            row.iter_mut().zip(from.as_chunks().0).for_each(|(v, b)| *v = u16::from_le_bytes(*b))
                        }
                        (16, ByteOrder::BigEndian) => {
                            row.iter_mut().zip(from.as_chunks().0).for_each(|(v, b)| *v = u16::from_be_bytes(*b))
                        }
                        _ => packing::unpack(from, bits, row),
                    }
                }
                part
            }
            compression::JPEG => {
                let decoded = lossless::decode(&bytes, whole)?;
                // Some cameras put two rows side by side; numbers follow each other in either case.
                if decoded.data.len() < part_width * rows {
                    return Err(malformed(format!(
                        "a part of {} × {} where {part_width} × {rows} belong",
                        decoded.width, decoded.height
                    )));
                }
                decoded.data
            }
            other => return Err(malformed(format!("compression {other}: expected none (1) or lossless JPEG (7)"))),
        };
        if left == 0 {
            data.resize((top + rows) * width, 0);
        }
        let w = part_width.min(width - left);
        for row in 0..rows {
            let to = (top + row) * width + left;
            data[to..to + w].copy_from_slice(&part[row * part_width..row * part_width + w]);
        }
    }
    Ok(Raster { width, height, channels: 1, data })
}

/// The active area; the pattern of a DNG begins at its corner.
fn cropped<R: Read + Seek>(file: &mut File<R>, raw: &Directory, mosaic: Raster<u16>) -> Result<Raster<u16>, ImageError> {
    let area = file.numbers(raw, tag::ACTIVE_AREA)?;
    let [top, left, bottom, right] = area[..] else { return Ok(mosaic) };
    let [top, left, bottom, right] = [top, left, bottom, right].map(|v| v.max(0.0) as usize);
    let (bottom, right) = (bottom.min(mosaic.height), right.min(mosaic.width));
    if top >= bottom || left >= right {
        return Err(malformed(format!("the active area {area:?} is empty")));
    }
    if (top, left, bottom, right) == (0, 0, mosaic.height, mosaic.width) {
        return Ok(mosaic);
    }
    let data = (top..bottom).flat_map(|r| mosaic.data[r * mosaic.width + left..r * mosaic.width + right].to_vec()).collect();
    Ok(Raster { width: right - left, height: bottom - top, channels: 1, data })
}

/// Black levels that differ by place are brought to their mean: what a cell or a row or column has more is taken off its numbers.
fn even_black<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    mosaic: &mut Raster<u16>,
    header: &RawHeader,
) -> Result<(), ImageError> {
    let cells = file.numbers(raw, tag::BLACK_LEVEL)?;
    let repeat = file.numbers(raw, tag::BLACK_REPEAT)?;
    let [rows, columns] = match repeat[..] {
        [r, c] if r >= 1.0 && c >= 1.0 && r * c == cells.len() as f64 => [r as usize, c as usize],
        _ => [1, 1],
    };
    let [across, down] = [file.numbers(raw, tag::BLACK_DELTA[0])?, file.numbers(raw, tag::BLACK_DELTA[1])?];
    let mean = header.black_level;
    let differ = rows * columns > 1 && cells.iter().any(|b| *b != mean);
    if !differ && across.iter().chain(&down).all(|d| *d == 0.0) {
        return Ok(());
    }
    let width = mosaic.width;
    for (y, line) in mosaic.data.chunks_exact_mut(width).enumerate() {
        let of_row = down.get(y).copied().unwrap_or(0.0);
        for (x, dn) in line.iter_mut().enumerate() {
            let cell = if differ { cells[y % rows * columns + x % columns] - mean } else { 0.0 };
            let more = cell + of_row + across.get(x).copied().unwrap_or(0.0);
            *dn = (f64::from(*dn) - more).round().clamp(0.0, 65_535.0) as u16;
        }
    }
    Ok(())
}

/// What is to be shown of the active area.
fn crop<R: Read + Seek>(file: &mut File<R>, raw: &Directory, mosaic: &Raster<u16>) -> Result<Option<[usize; 4]>, ImageError> {
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
    let inside = w > 0 && h > 0 && x.saturating_add(w) <= mosaic.width && y.saturating_add(h) <= mosaic.height;
    Ok((inside && [x, y, w, h] != [0, 0, mosaic.width, mosaic.height]).then_some([x, y, w, h]))
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
    bits: u32,
) -> Result<RawHeader, ImageError> {
    let n = cfa.channel_count();
    let top = f64::from((1u32 << bits) - 1);
    let black = file.numbers(raw, tag::BLACK_LEVEL)?;
    let black_level = if black.is_empty() { 0.0 } else { black.iter().sum::<f64>() / black.len() as f64 };
    let white_level = file.number(raw, tag::WHITE_LEVEL)?.unwrap_or(top);
    if !(black_level >= 0.0 && black_level < white_level && white_level <= 65_535.0) {
        return Err(malformed(format!("black level {black_level} and white level {white_level} contradict each other")));
    }
    let mut calibrations = Vec::new();
    if !cfa.is_monochrome() {
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
            calibrations.push(ColorCalibration {
                light: LightSource(light as u16),
                camera_from_xyz: (0..n).map(row).collect(),
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
    let neutral = neutral(file, main, n, calibrations.last())?;
    let largest = neutral.iter().fold(0.0f64, |a, b| a.max(*b));
    let baseline = file.number(main, tag::BASELINE_EXPOSURE)?.filter(|v| v.abs() <= 10.0).unwrap_or(0.0);
    let noise = file.numbers(raw, tag::NOISE_PROFILE)?;
    // One pair stands for all planes.
    let noise = if noise.len() == 2 { noise.repeat(n) } else { noise };
    let fine = noise.len() == 2 * n && noise.iter().all(|v| v.is_finite() && *v >= 0.0);
    let noise = if fine { noise.as_chunks::<2>().0.to_vec() } else { Vec::new() };
    Ok(RawHeader {
        cfa,
        bits,
        black_level,
        white_level,
        as_shot_neutral: neutral.iter().map(|v| v / largest).collect(),
        calibrations,
        baseline_ev: baseline,
        framing: Framing::default(),
        noise,
        facts: facts(file, main)?,
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

/// Camera signals of white: told, or from its chromaticity, or all the same.
fn neutral<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    n: usize,
    calibration: Option<&ColorCalibration>,
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
    if let ([x, y], Some(c)) = (&file.numbers(main, tag::AS_SHOT_WHITE_XY)?[..], calibration)
        && *y > 0.0
    {
        let xyz = [x / y, 1.0, (1.0 - x - y) / y];
        let signal: Vec<f64> = c.camera_from_xyz.iter().map(|row| row.iter().zip(xyz).map(|(a, b)| a * b).sum()).collect();
        if fine(&signal) {
            return Ok(signal);
        }
    }
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

//! Strips and tiles: bytes to numbers.
//!
//! Sources: TIFF 6.0 (packing, horizontal differences); Adobe, "Adobe Photoshop TIFF Technical Note 3" (2005; floating point of 16, 24 and 32 bits, and
//! their predictor); DNG 1.6, chapter 3 (predictors over two and four pixels, lossy JPEG); DNG 1.7.1 (2023), chapter 3 (JPEG XL).

use super::{compression, lossless, packing};
use crate::ImageError;
use flate2::read::ZlibDecoder;
use jxl_oxide::{AllocTracker, JxlImage};
use std::io::{Cursor, Read};
use tiff::tags::ByteOrder;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// How the numbers of a picture are stored.
pub struct Storage {
    /// Numbers a pixel.
    pub samples: usize,
    /// Bits of a number: 8 to 16, or 16, 24 and 32 of floating point.
    pub bits: u32,
    /// Whether they are floating point.
    pub float: bool,
    /// The tag Compression.
    pub compression: u16,
    /// The tag Predictor.
    pub predictor: u16,
    /// Byte order of the file.
    pub order: ByteOrder,
}

/// What a predictor takes off each number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Predictor {
    /// Nothing.
    None,
    /// The number so many pixels before.
    Horizontal(usize),
    /// The same of the bytes of floating-point numbers, sorted by weight.
    Float(usize),
}

impl Predictor {
    fn of(number: u16) -> Option<Predictor> {
        Some(match number {
            1 => Predictor::None,
            2 => Predictor::Horizontal(1),
            3 => Predictor::Float(1),
            34892 => Predictor::Horizontal(2),
            34893 => Predictor::Horizontal(4),
            34894 => Predictor::Float(2),
            34895 => Predictor::Float(4),
            _ => return None,
        })
    }
}

/// The numbers of a strip or tile of `width` × `height` pixels, of which `rows` are wanted: rows of `width` × samples numbers, at least `rows` of
/// them. `linear`: the number that a floating-point sample becomes. Fails on a compression or predictor that is not read, and on bytes that are damaged
/// or too few.
pub fn numbers(
    bytes: &[u8],
    storage: &Storage,
    [width, height, rows]: [usize; 3],
    linear: impl Fn(f32) -> u16,
) -> Result<Vec<u16>, String> {
    let across = width * storage.samples;
    match storage.compression {
        compression::NONE => plain(bytes, storage, across, rows, linear),
        compression::DEFLATE | compression::OLD_DEFLATE => {
            let most = (packing::row_bytes(across, storage.bits) * height) as u64;
            let mut whole = Vec::new();
            ZlibDecoder::new(bytes).take(most).read_to_end(&mut whole).map_err(|e| format!("deflate: {e}"))?;
            plain(&whole, storage, across, rows, linear)
        }
        compression::JPEG | compression::LOSSY_JPEG if storage.float => {
            Err(format!("compression {} of floating-point samples: expected none (1) or deflate (8)", storage.compression))
        }
        compression::JPEG => {
            let decoded = lossless::decode(bytes, across * height).map_err(reason)?;
            // Some cameras put two rows side by side; numbers follow each other in either case.
            if decoded.data.len() < across * rows {
                return Err(format!("{} × {} numbers where {across} × {rows} belong", decoded.width, decoded.height));
            }
            Ok(decoded.data)
        }
        compression::LOSSY_JPEG => lossy(bytes, storage, [width, height, rows]),
        compression::JPEG_XL => jpeg_xl(bytes, storage, [width, height, rows], linear),
        other => Err(format!(
            "compression {other}: expected none (1), lossless JPEG (7), deflate (8), lossy JPEG (34892) or JPEG XL (52546)"
        )),
    }
}

/// Most numbers that a byte of a part can become. Deflate makes at most 258 bytes of 2 bits (RFC 1951); in JPEG a number takes a bit if lossless, and
/// a block of 8 × 8 at least a bit if lossy, of which four stand for one where colours have half the resolution. In JPEG XL a group of 256 × 256 pixels
/// has at least a byte, its entry in the table of contents (ISO/IEC 18181-1, F.3).
pub fn most_numbers_a_byte(storage: &Storage) -> f64 {
    match storage.compression {
        compression::NONE => 8.0 / f64::from(storage.bits.max(1)),
        compression::DEFLATE | compression::OLD_DEFLATE => 1032.0 * 8.0 / f64::from(storage.bits.max(1)),
        compression::LOSSY_JPEG => 1024.0,
        compression::JPEG_XL => 65_536.0 * storage.samples as f64,
        _ => 8.0,
    }
}

/// The reason of an error about the file, which says itself what file it is.
fn reason(e: ImageError) -> String {
    match e {
        ImageError::Malformed { reason, .. } => reason,
        other => other.to_string(),
    }
}

/// Numbers one after the other, each row from a whole byte on.
fn plain(bytes: &[u8], storage: &Storage, across: usize, rows: usize, linear: impl Fn(f32) -> u16) -> Result<Vec<u16>, String> {
    let compressed = storage.compression != compression::NONE;
    // Without compression the tag means nothing.
    let predictor = if compressed { Predictor::of(storage.predictor) } else { Some(Predictor::None) };
    let predictor = match predictor {
        Some(p @ (Predictor::None | Predictor::Horizontal(_))) => p,
        Some(p @ Predictor::Float(_)) if storage.float => p,
        _ => {
            return Err(format!(
                "predictor {}: expected 1, 2, 34892 or 34893, or 3, 34894, 34895 of floating point",
                storage.predictor
            ));
        }
    };
    if storage.float && matches!(predictor, Predictor::Horizontal(_)) {
        return Err(format!("predictor {} of floating-point samples: expected 1, 3, 34894 or 34895", storage.predictor));
    }
    let stride = packing::row_bytes(across, storage.bits);
    if bytes.len() < stride * rows {
        return Err(format!("{} bytes of {}: it is cut short", bytes.len(), stride * rows));
    }
    let mut to = vec![0u16; across * rows];
    for (row, from) in to.chunks_mut(across.max(1)).zip(bytes.chunks(stride.max(1))) {
        if storage.float {
            let values = floats(from, storage, predictor);
            row.iter_mut().zip(values).for_each(|(to, v)| *to = linear(v));
            continue;
        }
        match (storage.bits, storage.order) {
            (16, ByteOrder::LittleEndian) => {
                row.iter_mut().zip(from.as_chunks().0).for_each(|(v, b)| *v = u16::from_le_bytes(*b));
            }
            (16, ByteOrder::BigEndian) => {
                row.iter_mut().zip(from.as_chunks().0).for_each(|(v, b)| *v = u16::from_be_bytes(*b));
            }
            (bits, _) => packing::unpack(from, bits, row),
        }
        if let Predictor::Horizontal(pixels) = predictor {
            let before = pixels * storage.samples;
            let mask = ((1u32 << storage.bits) - 1) as u16;
            for i in before..row.len() {
                row[i] = row[i].wrapping_add(row[i - before]) & mask;
            }
        }
    }
    Ok(to)
}

/// The floating-point numbers of a row.
fn floats(from: &[u8], storage: &Storage, predictor: Predictor) -> Vec<f32> {
    let size = storage.bits as usize / 8;
    let n = from.len() / size;
    let mut bytes = from.to_vec();
    // Bytes of number `i`, the heaviest first.
    let place: Box<dyn Fn(usize, usize) -> usize> = match (predictor, storage.order) {
        (Predictor::Float(pixels), _) => {
            for i in pixels * storage.samples..bytes.len() {
                bytes[i] = bytes[i].wrapping_add(bytes[i - pixels * storage.samples]);
            }
            Box::new(move |i, k| k * n + i)
        }
        (_, ByteOrder::BigEndian) => Box::new(move |i, k| i * size + k),
        (_, ByteOrder::LittleEndian) => Box::new(move |i, k| i * size + size - 1 - k),
    };
    (0..n)
        .map(|i| {
            let code = (0..size).fold(0u32, |code, k| code << 8 | u32::from(bytes[place(i, k)]));
            match storage.bits {
                16 => float(code, 5, 10),
                24 => float(code, 7, 16),
                _ => f32::from_bits(code),
            }
        })
        .collect()
}

/// A floating-point number of a sign, an exponent and a fraction, as IEEE 754 lays them out.
fn float(code: u32, exponent_bits: u32, fraction_bits: u32) -> f32 {
    let fraction = f64::from(code & ((1 << fraction_bits) - 1)) / f64::from(1u32 << fraction_bits);
    let exponent = (code >> fraction_bits & ((1 << exponent_bits) - 1)) as i32;
    let bias = (1 << (exponent_bits - 1)) - 1;
    let size = match exponent {
        0 => fraction * f64::powi(2.0, 1 - bias),
        e if e == (1 << exponent_bits) - 1 => return if fraction == 0.0 { f32::INFINITY } else { f32::NAN },
        e => (1.0 + fraction) * f64::powi(2.0, e - bias),
    };
    (if code >> (exponent_bits + fraction_bits) & 1 == 1 { -size } else { size }) as f32
}

/// A picture in 8-bit JPEG (baseline or progressive).
fn lossy(bytes: &[u8], storage: &Storage, [width, height, rows]: [usize; 3]) -> Result<Vec<u16>, String> {
    let told = |e: zune_jpeg::errors::DecodeErrors| format!("lossy JPEG: {e}");
    let space = if storage.samples == 3 { ColorSpace::RGB } else { ColorSpace::Luma };
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), DecoderOptions::default().jpeg_set_out_colorspace(space));
    decoder.decode_headers().map_err(told)?;
    let info = decoder.info().ok_or("lossy JPEG: it has no header")?;
    let (w, h, n) = (usize::from(info.width), usize::from(info.height), usize::from(info.components));
    if w != width || !(rows..=height).contains(&h) || n != storage.samples || storage.bits != 8 {
        return Err(format!(
            "lossy JPEG: {w} × {h} pixels of {n} samples where {width} × {rows} of {} with 8 bits belong",
            storage.samples
        ));
    }
    let data = decoder.decode().map_err(told)?;
    if data.len() < w * h * n {
        return Err(format!("lossy JPEG: {} of {} numbers", data.len(), w * h * n));
    }
    Ok(data.into_iter().map(u16::from).collect())
}

/// Memory of the decoder at most, in bytes a number: its planes are of 32 bits, and transforms hold several of them at a time.
const JPEG_XL_BYTES_A_NUMBER: usize = 64;
/// And what its tables may take beside.
const JPEG_XL_TABLES: usize = 1 << 26;

/// A picture in JPEG XL, a bare codestream or a container. Its numbers from 0 to 1 are those from 0 to the largest of the file's bits.
fn jpeg_xl(
    bytes: &[u8],
    storage: &Storage,
    [width, height, rows]: [usize; 3],
    linear: impl Fn(f32) -> u16,
) -> Result<Vec<u16>, String> {
    let told = |e: Box<dyn std::error::Error + Send + Sync>| format!("JPEG XL: {e}");
    let most = (width * height * storage.samples).saturating_mul(JPEG_XL_BYTES_A_NUMBER).saturating_add(JPEG_XL_TABLES);
    let picture = JxlImage::builder().alloc_tracker(AllocTracker::with_limit(most)).read(Cursor::new(bytes)).map_err(told)?;
    let (w, h) = (picture.width() as usize, picture.height() as usize);
    let n = if picture.pixel_format().is_grayscale() { 1 } else { 3 };
    if w != width || !(rows..=height).contains(&h) || n != storage.samples {
        return Err(format!("JPEG XL: {w} × {h} pixels of {n} samples where {width} × {rows} of {} belong", storage.samples));
    }
    let frame = picture.render_frame(0).map_err(told)?;
    let mut stream = frame.stream_no_alpha();
    let mut values = vec![0f32; w * h * n];
    if stream.write_to_buffer(&mut values) < values.len() {
        return Err("JPEG XL: it is cut short".into());
    }
    let top = ((1u64 << storage.bits) - 1) as f32;
    let number = |v: f32| if storage.float { linear(v) } else { (v * top).round().clamp(0.0, top) as u16 };
    Ok(values.into_iter().map(number).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn storage(samples: usize, bits: u32, compression: u16, predictor: u16) -> Storage {
        Storage { samples, bits, float: false, compression, predictor, order: ByteOrder::LittleEndian }
    }

    fn deflated(bytes: &[u8]) -> Vec<u8> {
        let mut to = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        to.write_all(bytes).unwrap();
        to.finish().unwrap()
    }

    fn never(_: f32) -> u16 {
        unreachable!("whole numbers")
    }

    #[test]
    fn deflated_rows_come_back_with_every_predictor() {
        let numbers_of = |i: usize| (i * 2503 % 65_521) as u16;
        for (samples, predictor, before) in [(1, 1, 0), (1, 2, 1), (3, 2, 3), (3, 34892, 6), (1, 34893, 4)] {
            let rows: Vec<u16> = (0..5 * 6 * samples).map(numbers_of).collect();
            let mut bytes = Vec::new();
            for row in rows.chunks(6 * samples) {
                for (i, v) in row.iter().enumerate() {
                    let last = if before > 0 && i >= before { row[i - before] } else { 0 };
                    bytes.extend(v.wrapping_sub(last).to_le_bytes());
                }
            }
            let packed = deflated(&bytes);
            let s = storage(samples, 16, compression::DEFLATE, predictor);
            assert_eq!(numbers(&packed, &s, [6, 5, 5], never).unwrap(), rows, "{samples} {predictor}");
            // A last tile of which less is wanted, and one that is cut short.
            assert_eq!(numbers(&packed, &s, [6, 5, 2], never).unwrap(), rows[..12 * samples]);
            assert!(numbers(&packed[..packed.len() / 2], &s, [6, 5, 5], never).is_err());
        }
        // More than its place holds is not unpacked.
        let bomb = deflated(&vec![0; 1 << 20]);
        let s = storage(1, 16, compression::DEFLATE, 1);
        assert_eq!(numbers(&bomb, &s, [4, 4, 4], never).unwrap(), vec![0; 16]);
    }

    #[test]
    fn floats_of_every_size_and_order_are_read() {
        // As codes of 16, 24 (DNG 1.6, seven bits of exponent) and 32 bits.
        let values = [1.5f32, -0.25, 0.125, 1.0];
        let codes = |bits: u32| -> Vec<u32> {
            match bits {
                16 => vec![0x3e00, 0xb400, 0x3000, 0x3c00],
                24 => vec![0x3f_8000, 0xbd_0000, 0x3c_0000, 0x3f_0000],
                _ => values.iter().map(|v| v.to_bits()).collect(),
            }
        };
        let seen = |v: f32| (v * 1000.0 + 500.0).round() as u16;
        let expected: Vec<u16> = values.iter().map(|v| seen(*v)).collect();
        for bits in [16u32, 24, 32] {
            let size = bits as usize / 8;
            for order in [ByteOrder::LittleEndian, ByteOrder::BigEndian] {
                let bytes: Vec<u8> = codes(bits)
                    .iter()
                    .flat_map(|c| {
                        let all = c.to_be_bytes();
                        let mut own = all[4 - size..].to_vec();
                        if order == ByteOrder::LittleEndian {
                            own.reverse();
                        }
                        own
                    })
                    .collect();
                let s = Storage { float: true, order, ..storage(1, bits, compression::NONE, 1) };
                assert_eq!(numbers(&bytes, &s, [4, 1, 1], seen).unwrap(), expected, "{bits}");
            }
            // Sorted by weight, then differences of bytes.
            let mut sorted: Vec<u8> =
                (0..size).flat_map(|k| codes(bits).into_iter().map(move |c| (c >> (8 * (size - 1 - k))) as u8)).collect();
            for i in (1..sorted.len()).rev() {
                sorted[i] = sorted[i].wrapping_sub(sorted[i - 1]);
            }
            let s = Storage { float: true, ..storage(1, bits, compression::DEFLATE, 3) };
            assert_eq!(numbers(&deflated(&sorted), &s, [4, 1, 1], seen).unwrap(), expected, "{bits} predicted");
        }
        assert!(float(0x7c00, 5, 10).is_infinite() && float(0x7c01, 5, 10).is_nan());
        assert_eq!(float(1, 5, 10), 2f32.powi(-24));
    }

    #[test]
    fn lossy_tiles_are_read() {
        let pixels: Vec<u8> = (0..32 * 16).flat_map(|i| [(i % 32 * 8) as u8, 100, (i / 32 * 10) as u8]).collect();
        let mut file = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut file, 98);
        encoder.encode(&pixels, 32, 16, jpeg_encoder::ColorType::Rgb).unwrap();
        let s = storage(3, 8, compression::LOSSY_JPEG, 1);
        let back = numbers(&file, &s, [32, 16, 16], never).unwrap();
        let worst = back.iter().zip(&pixels).map(|(a, b)| a.abs_diff(u16::from(*b))).max().unwrap();
        assert!(back.len() == pixels.len() && worst <= 8, "{worst}");
        for wrong in [[16, 16, 16], [32, 8, 8], [32, 32, 32]] {
            assert!(numbers(&file, &s, wrong, never).unwrap_err().contains("belong"), "{wrong:?}");
        }
        assert!(numbers(&file[..20], &s, [32, 16, 16], never).is_err());
        let unknown = storage(3, 8, 34_712, 1);
        assert!(numbers(&file, &unknown, [32, 16, 16], never).unwrap_err().contains("compression 34712"));
    }

    #[test]
    fn tiles_of_jpeg_xl_are_read() {
        // Made with libjxl 0.11: a bare codestream without loss, a container with loss (distance 0.5), and floating-point numbers.
        let bare = include_bytes!("../../tests/data/mosaic-lossless.jxl");
        let s = storage(1, 16, compression::JPEG_XL, 1);
        let expected: Vec<u16> = (0..24 * 16).map(|i| (i * 2503 % 65_521) as u16).collect();
        assert_eq!(numbers(bare, &s, [24, 16, 16], never).unwrap(), expected);
        let container = include_bytes!("../../tests/data/linear-lossy.jxl");
        let back = numbers(container, &storage(3, 16, compression::JPEG_XL, 1), [32, 16, 16], never).unwrap();
        let expected = (0..32 * 16).flat_map(|i| [i % 32 * 2000 + 1000, 30_000, i / 32 * 3000 + 2000]);
        let worst = back.iter().zip(expected).map(|(a, b)| i32::from(*a).abs_diff(b)).max().unwrap();
        // libjxl itself: 1100.
        assert!(back.len() == 32 * 16 * 3 && worst <= 1300, "{worst}");
        let float = include_bytes!("../../tests/data/float-lossless.jxl");
        let s32 = Storage { float: true, ..storage(1, 32, compression::JPEG_XL, 1) };
        let back = numbers(float, &s32, [8, 8, 8], |v| (v * 64.0) as u16).unwrap();
        assert_eq!(back, (0..64).collect::<Vec<u16>>());
        for wrong in [[16, 24, 16], [24, 12, 8], [24, 32, 32]] {
            assert!(numbers(bare, &s, wrong, never).unwrap_err().contains("belong"), "{wrong:?}");
        }
        assert!(numbers(container, &s, [32, 16, 16], never).unwrap_err().contains("3 samples"));
        for end in 0..bare.len() {
            let cut = numbers(&bare[..end], &s, [24, 16, 16], never);
            assert!(cut.is_err_and(|e| e.starts_with("JPEG XL")), "{end}");
        }
        // What is damaged is an error, or other numbers.
        for i in 0..bare.len() * 8 {
            let mut damaged = bare.to_vec();
            damaged[i / 8] ^= 1 << (i % 8);
            if let Ok(back) = numbers(&damaged, &s, [24, 16, 16], never) {
                assert_eq!(back.len(), 24 * 16);
            }
        }
    }
}

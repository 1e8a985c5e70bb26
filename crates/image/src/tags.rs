//! Fields of TIFF directories, which EXIF and DNG are made of, over the `tiff` crate.

use crate::ImageError;
use std::io::{Seek, Write};
use tiff::Directory;
use tiff::encoder::{DirectoryEncoder, TiffKindStandard};
use tiff::tags::{Tag, Type};

/// The value of a field.
#[derive(Clone, Debug, PartialEq)]
pub enum Field {
    /// Text; what is not ASCII is written in letters near to it.
    Ascii(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// Bytes of a meaning that only the tag knows.
    Undefined(Vec<u8>),
    /// 16-bit numbers.
    Shorts(Vec<u16>),
    /// 32-bit numbers.
    Longs(Vec<u32>),
    /// Fractions of numbers that are not negative.
    Rationals(Vec<f64>),
    /// Fractions.
    SRationals(Vec<f64>),
    /// 64-bit floating point.
    Doubles(Vec<f64>),
}

impl Field {
    /// One text.
    pub fn text(text: &str) -> Field {
        Field::Ascii(text.to_owned())
    }

    /// One 16-bit number.
    pub fn short(value: u16) -> Field {
        Field::Shorts(vec![value])
    }

    /// One 32-bit number.
    pub fn long(value: u32) -> Field {
        Field::Longs(vec![value])
    }

    /// One fraction; below 0 it is written as 0.
    pub fn rational(value: f64) -> Field {
        Field::Rationals(vec![value])
    }

    /// One fraction that may be negative.
    pub fn srational(value: f64) -> Field {
        Field::SRationals(vec![value])
    }

    fn bytes(&self) -> (Type, Vec<u8>) {
        match self {
            Field::Ascii(text) => {
                let mut bytes = ascii(text).into_bytes();
                bytes.push(0);
                (Type::ASCII, bytes)
            }
            Field::Bytes(b) => (Type::BYTE, b.clone()),
            Field::Undefined(b) => (Type::UNDEFINED, b.clone()),
            Field::Shorts(v) => (Type::SHORT, v.iter().flat_map(|x| x.to_ne_bytes()).collect()),
            Field::Longs(v) => (Type::LONG, v.iter().flat_map(|x| x.to_ne_bytes()).collect()),
            Field::Rationals(v) => {
                let pair = |x: &f64| {
                    let (n, d) = fraction(x.max(0.0), u32::MAX);
                    [n.to_ne_bytes(), d.to_ne_bytes()].concat()
                };
                (Type::RATIONAL, v.iter().flat_map(pair).collect())
            }
            Field::SRationals(v) => {
                let pair = |x: &f64| {
                    let (n, d) = fraction(x.abs(), i32::MAX as u32);
                    let n = if *x < 0.0 { -(n as i32) } else { n as i32 };
                    [n.to_ne_bytes(), (d as i32).to_ne_bytes()].concat()
                };
                (Type::SRATIONAL, v.iter().flat_map(pair).collect())
            }
            Field::Doubles(v) => (Type::DOUBLE, v.iter().flat_map(|x| x.to_ne_bytes()).collect()),
        }
    }
}

/// The shortest fraction that is just a number that is not negative, or the nearest with both parts up to `largest`: by
/// continued fractions. Infinity is 1/0, as EXIF has it.
fn fraction(value: f64, largest: u32) -> (u32, u32) {
    if value.is_nan() {
        return (0, 0);
    }
    if value > largest as f64 {
        return if value.is_infinite() { (1, 0) } else { (largest, 1) };
    }
    let (mut before, mut now) = ((0.0f64, 1.0f64), (1.0f64, 0.0f64));
    let mut rest = value;
    for _ in 0..40 {
        let whole = rest.floor();
        let next = (whole * now.0 + before.0, whole * now.1 + before.1);
        if next.0 > largest as f64 || next.1 > largest as f64 {
            break;
        }
        (before, now) = (now, next);
        if now.0 / now.1 == value || rest == whole {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    (now.0 as u32, now.1 as u32)
}

/// Text in the letters that old tags can hold.
pub(crate) fn ascii(text: &str) -> String {
    let near = |c: char| match c {
        '\0' => ' ',
        '–' | '—' | '−' => '-',
        '×' => 'x',
        '°' => 'd',
        'µ' | 'μ' => 'u',
        '“' | '”' => '"',
        '‘' | '’' => '\'',
        c if c.is_ascii() => c,
        _ => '?',
    };
    text.chars().map(near).collect()
}

/// Writes fields into a directory.
pub(crate) fn write_fields<W: Write + Seek>(
    directory: &mut DirectoryEncoder<'_, W, TiffKindStandard>,
    fields: &[(u16, Field)],
) -> Result<(), ImageError> {
    let mut entries = Vec::new();
    for (tag, field) in fields {
        let (kind, bytes) = field.bytes();
        entries.push((Tag::from_u16_exhaustive(*tag), directory.write_entry_bytes(kind, &bytes).map_err(written)?));
        // Values begin at even places.
        if bytes.len() > 4 && bytes.len() % 2 == 1 {
            directory.write_data(0u8).map_err(written)?;
        }
    }
    let mut all = Directory::empty();
    all.extend(entries);
    directory.extend_from(&all);
    Ok(())
}

/// An error of the encoder: only the file can fail.
pub(crate) fn written(e: tiff::TiffError) -> ImageError {
    match e {
        tiff::TiffError::IoError(e) => ImageError::Io(e),
        other => ImageError::Io(std::io::Error::other(other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_the_short_ones() {
        for (value, expected) in [
            (1.0 / 125.0, (1, 125)),
            (5.6, (28, 5)),
            (0.0, (0, 1)),
            (30.0, (30, 1)),
            (1.0 / 8000.0, (1, 8000)),
            (2.5, (5, 2)),
            (0.6448231, (6_448_231, 10_000_000)),
        ] {
            assert_eq!(fraction(value, u32::MAX), expected, "{value}");
        }
        assert_eq!(fraction(f64::INFINITY, u32::MAX), (1, 0));
        assert_eq!(fraction(1e12, u32::MAX), (u32::MAX, 1));
        for value in [std::f64::consts::PI, 0.001234567, 12345.678] {
            let (n, d) = fraction(value, i32::MAX as u32);
            assert!((n as f64 / d as f64 / value - 1.0).abs() < 1e-8, "{value}: {n}/{d}");
        }
    }
}

//! Files of measured surfaces: tensor files (`.bsdf`) and MERL's tables (`.binary`), told apart by their first bytes.
//!
//! A tensor file holds named arrays: "tensor_file\0", two bytes of version (1, 0), the number of fields (u32), then for each field the length of its name
//! (u16), the name, the number of dimensions (u16), the type of its numbers (u8), where its data begins (u64) and its size in each dimension
//! (u64, the fastest last); little-endian. Sizes are held against the bytes that are there before memory is asked for.
//! Source: Mitsuba 3, `tensor_io`; which fields a table has: J. Dupuy & W. Jakob, RGL material database, and Mitsuba 3's `measured`.
//! MERL: three counts (i32), then red, green and blue one after the other as f64. Source: BRDFRead of the MERL BRDF database.

use crate::material::Measured;
use crate::material::measured::Table;
use crate::material::measured::adaptive::{Adaptive, Bands, Fields, Symmetry};
use crate::material::measured::half_difference::{HalfDifference, SCALE};
use crate::material::measured::warp::Grid;
use std::collections::HashMap;
use std::f32::consts::TAU;

const TENSOR: &[u8; 12] = b"tensor_file\0";
/// The types of numbers that tables have.
const U8: u8 = 1;
const F32: u8 = 10;
/// Bytes of a number of each type: none, 8 integers of 8 to 64 bits, floats of 16, 32, 64.
const SIZES: [u64; 12] = [0, 1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8];
/// Most bins of a MERL table in each of its angles; those of the database have 90, 90, 180.
const MOST_BINS: i32 = 4096;

/// Reads a measured surface: a tensor file or a MERL table. The error says what is wrong with the file.
pub fn read_measured(bytes: &[u8]) -> Result<Measured, String> {
    match bytes.starts_with(TENSOR) {
        true => read_tensors(bytes).and_then(|fields| adaptive(&fields)).map(|t| Measured::new(Table::Adaptive(Box::new(t)))),
        false => half_difference(bytes).map(|t| Measured::new(Table::HalfDifference(Box::new(t)))),
    }
}

/// An array of a tensor file.
struct Field<'a> {
    kind: u8,
    shape: Vec<u64>,
    data: &'a [u8],
}

/// What is left of a file.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or("it ends within the list of its fields: it is cut short")?;
        self.0 = rest;
        Ok(taken)
    }

    fn number(&mut self, bytes: usize) -> Result<u64, String> {
        Ok(self.take(bytes)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }
}

fn shown(shape: &[u64]) -> String {
    shape.iter().map(u64::to_string).collect::<Vec<_>>().join(" × ")
}

fn read_tensors(bytes: &[u8]) -> Result<HashMap<String, Field<'_>>, String> {
    let mut rest = Rest(&bytes[TENSOR.len()..]);
    let version = rest.take(2)?;
    if version != [1, 0] {
        return Err(format!("it is a tensor file of version {}.{}, and 1.0 is read", version[0], version[1]));
    }
    let count = rest.number(4)?;
    let mut fields = HashMap::new();
    for _ in 0..count {
        let length = rest.number(2)? as usize;
        let name = String::from_utf8_lossy(rest.take(length)?).into_owned();
        let dimensions = rest.number(2)?;
        let kind = rest.number(1)? as u8;
        let start = rest.number(8)?;
        let shape = (0..dimensions).map(|_| rest.number(8)).collect::<Result<Vec<u64>, String>>()?;
        let size = SIZES.get(usize::from(kind)).copied().filter(|s| *s > 0);
        let size = size.ok_or_else(|| format!("field \"{name}\" has numbers of type {kind}: expected 1 to 11"))?;
        let length = shape.iter().try_fold(size, |all, n| all.checked_mul(*n));
        let end = length.and_then(|length| start.checked_add(length));
        let data = end.and_then(|end| bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let data = data.ok_or_else(|| {
            format!(
                "field \"{name}\" announces {} numbers of {size} bytes from byte {start} on, and the file has {} bytes: it is cut short or damaged",
                shown(&shape),
                bytes.len()
            )
        })?;
        fields.insert(name, Field { kind, shape, data });
    }
    Ok(fields)
}

/// A field with a type and a number of dimensions, none of them empty; the shape in its order.
fn field<'a, const N: usize>(
    fields: &'a HashMap<String, Field<'a>>,
    name: &str,
    kind: u8,
) -> Result<(&'a [u8], [usize; N]), String> {
    let field =
        fields.get(name).ok_or_else(|| format!("it has no field \"{name}\": expected the table of a measured material"))?;
    let shape = <[u64; N]>::try_from(field.shape.as_slice()).ok().filter(|s| !s.contains(&0) && field.kind == kind);
    let shape = shape.ok_or_else(|| {
        let wanted = if kind == F32 { "32-bit floats" } else { "bytes" };
        format!("field \"{name}\" is {} numbers of type {}: expected {N} dimensions of {wanted}", shown(&field.shape), field.kind)
    })?;
    // They fit, as their product is the length of what is in memory.
    Ok((field.data, shape.map(|n| n as usize)))
}

/// The same of floats, all of them finite.
fn floats<const N: usize>(fields: &HashMap<String, Field>, name: &str) -> Result<(Vec<f32>, [usize; N]), String> {
    let (data, shape) = field(fields, name, F32)?;
    let values: Vec<f32> = data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(format!("field \"{name}\" holds {v}: expected finite numbers")),
        None => Ok((values, shape)),
    }
}

/// Rising numbers.
fn nodes(fields: &HashMap<String, Field>, name: &str) -> Result<Vec<f32>, String> {
    let (values, [_]) = floats(fields, name)?;
    match values.windows(2).all(|w| w[0] < w[1]) {
        true => Ok(values),
        false => Err(format!("field \"{name}\" does not rise from each number to the next")),
    }
}

/// A grid of rows of columns, at least 2 × 2.
fn grid(name: &str, values: Vec<f32>, [rows, columns]: [usize; 2]) -> Result<Grid, String> {
    match rows.min(columns) >= 2 {
        true => Ok(Grid { size: [columns, rows], values }),
        false => Err(format!("field \"{name}\" has {rows} rows of {columns}: expected 2 or more of both")),
    }
}

fn adaptive(fields: &HashMap<String, Field>) -> Result<Adaptive, String> {
    let (phi_i, theta_i) = (nodes(fields, "phi_i")?, nodes(fields, "theta_i")?);
    let symmetry = match phi_i.as_slice() {
        [] | [_] | [_, _] => Symmetry::Isotropic,
        [first, .., last] => match (TAU / (last - first)).round() as i32 {
            1 => Symmetry::None,
            2 => Symmetry::HalfTurn,
            4 => Symmetry::Mirrored,
            _ => {
                let span = (last - first).to_degrees();
                return Err(format!("field \"phi_i\" runs over {span:.1}°: expected 360°, 180° or 90°, or 1 or 2 numbers"));
            }
        },
    };
    let views = [phi_i.len(), theta_i.len()];
    let same = |name: &str, found: &[usize], expected: &[usize]| match found == expected {
        true => Ok(()),
        false => Err(format!("field \"{name}\" has {found:?} where the other fields have {expected:?}")),
    };
    let (ndf, shape) = floats(fields, "ndf")?;
    let ndf = grid("ndf", ndf, shape)?;
    let (sigma, shape) = floats(fields, "sigma")?;
    let sigma = grid("sigma", sigma, shape)?;
    let (vndf, [p, t, rows, columns]) = floats(fields, "vndf")?;
    same("vndf", &[p, t], &views)?;
    let vndf = grid("vndf", vndf, [rows, columns])?;
    let (luminance, [p, t, rows, columns]) = floats(fields, "luminance")?;
    same("luminance", &[p, t], &views)?;
    let luminance = grid("luminance", luminance, [rows, columns])?;
    // The database offers each surface as spectra and as RGB.
    let (name, bands, count) = match fields.contains_key("rgb") && !fields.contains_key("spectra") {
        true => ("rgb", Bands::Rgb, 3),
        false => {
            let nm = nodes(fields, "wavelengths")?;
            let count = nm.len();
            ("spectra", Bands::Nanometers(nm), count)
        }
    };
    let (samples, shape) = floats::<5>(fields, name)?;
    same(name, &shape, &[views[0], views[1], count, rows, columns])?;
    let (jacobian, [_]) = field(fields, "jacobian", U8)?;
    let is_divided = jacobian[0] != 0;
    Ok(Adaptive::new(Fields { phi_i, theta_i, symmetry, ndf, sigma, vndf, luminance, bands, samples, is_divided }))
}

fn half_difference(bytes: &[u8]) -> Result<HalfDifference, String> {
    let unknown = || "it is neither a tensor file (.bsdf) nor a MERL table (.binary)".to_owned();
    let (head, data) = bytes.split_at_checked(12).ok_or_else(unknown)?;
    let counts: Vec<i32> = head.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).collect();
    if counts.iter().any(|n| !(1..=MOST_BINS).contains(n)) {
        return Err(unknown());
    }
    let counts = [counts[0] as usize, counts[1] as usize, counts[2] as usize];
    let [h, d, p] = counts;
    // Below 2³⁶.
    let bins = h as u64 * d as u64 * p as u64;
    let data = data.as_chunks::<8>().0;
    if data.len() as u64 != 3 * bins || bytes.len() as u64 != 12 + 24 * bins {
        return Err(format!(
            "{} bytes, where a MERL table of {h} × {d} × {p} bins has {}: it is cut short or another file",
            bytes.len(),
            12 + 24 * bins
        ));
    }
    let bins = bins as usize;
    let mut values = Vec::with_capacity(bins);
    for i in 0..bins {
        let rgb = [0, 1, 2].map(|c: usize| (f64::from_le_bytes(data[c * bins + i]) * SCALE[c]) as f32);
        if rgb.iter().any(|v| !v.is_finite()) {
            return Err(format!("bin {i} holds {rgb:?}: expected finite numbers"));
        }
        values.push(rgb);
    }
    Ok(HalfDifference::new(counts, values))
}

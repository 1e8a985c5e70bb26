//! Binary layers: crate files (`.usdc`), versions 0.4 to 0.13. Values are read when they are asked for.
//!
//! Source: the format as `pxr/usd/sdf/crateFile.h`, `integerCoding.h` and `fastCompression.h` of OpenUSD describe it, and Y. Collet, "LZ4
//! block format description". Sizes are held against the length of the file before memory is asked for.

mod compression;

use self::compression::{MOST_EXPANDED, integers, unpacked};
use super::error;
use super::layer::{Field, Folder, Key, Layer, ListOp, PackedValues, Reference, Spec, TimeShift, Value, child_path};
use crate::SceneError;
use std::collections::HashMap;
use std::sync::Arc;

/// How a crate file begins.
pub const MAGIC: &[u8] = b"PXR-USDC";
/// Arrays shorter than this are never compressed.
const LEAST_COMPRESSED: usize = 16;
/// Deepest that values lie within values.
const DEEPEST_VALUE: u32 = 8;
/// Deepest that prims lie within prims.
const DEEPEST_PATH: u32 = 256;
/// Most bytes of all paths of a file.
const MOST_PATH_BYTES: usize = 1 << 30;

/// The parts of a file that values refer to.
#[derive(Debug)]
pub struct Crate {
    bytes: Arc<[u8]>,
    version: [u8; 3],
    tokens: Vec<Arc<str>>,
    /// Numbers of tokens.
    strings: Vec<u32>,
    paths: Vec<Arc<str>>,
}

/// What is wrong, before the name of the file is known.
type Wrong = String;

struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn new(bytes: &'a [u8], at: u64) -> Result<Self, Wrong> {
        match usize::try_from(at).ok().filter(|at| *at <= bytes.len()) {
            Some(at) => Ok(Cursor { bytes, at }),
            None => Err(format!("a place {at} behind its end")),
        }
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Wrong> {
        let all = self.bytes;
        let part = self.at.checked_add(n).and_then(|end| all.get(self.at..end));
        let part = part.ok_or_else(|| format!("{n} bytes at {} behind its end", self.at))?;
        self.at += n;
        Ok(part)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Wrong> {
        let part = self.take(N)?;
        Ok(std::array::from_fn(|i| part[i]))
    }

    fn u32(&mut self) -> Result<u32, Wrong> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, Wrong> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, Wrong> {
        self.array().map(f64::from_le_bytes)
    }

    /// A count of things of at least `size` bytes each that follow.
    fn count(&mut self, size: usize) -> Result<usize, Wrong> {
        let n = self.u64()?;
        let most = (self.bytes.len() - self.at) / size.max(1);
        usize::try_from(n).ok().filter(|n| *n <= most).ok_or_else(|| format!("a list of {n} where {most} fit at most"))
    }

    /// Bytes of a length that stands before them.
    fn block(&mut self) -> Result<&'a [u8], Wrong> {
        let n = self.count(1)?;
        self.take(n)
    }

    /// Goes to where a relative offset leads.
    fn follow(&mut self) -> Result<(), Wrong> {
        let (start, offset) = (self.at as i64, self.u64()? as i64);
        let to = start.checked_add(offset).filter(|to| *to >= 0);
        *self = Cursor::new(self.bytes, to.ok_or("an offset before its beginning")? as u64)?;
        Ok(())
    }
}

/// IEEE 754 half precision.
fn half(bits: u16) -> f32 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        e => (1024.0 + fraction) * 2f32.powi(e - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// Kinds of numbers, and how many make a value; matrices and quaternions, too.
#[derive(Clone, Copy, PartialEq)]
enum Number {
    Byte,
    Int,
    Long,
    Half,
    Float,
    Double,
}

impl Number {
    fn size(self) -> usize {
        match self {
            Number::Byte => 1,
            Number::Half => 2,
            Number::Int | Number::Float => 4,
            Number::Long | Number::Double => 8,
        }
    }

    fn of(self, b: &[u8]) -> f64 {
        match (self, b) {
            (Number::Byte, [a, ..]) => f64::from(*a),
            (Number::Int, [a, b, c, d, ..]) => f64::from(i32::from_le_bytes([*a, *b, *c, *d])),
            (Number::Half, [a, b, ..]) => f64::from(half(u16::from_le_bytes([*a, *b]))),
            (Number::Float, [a, b, c, d, ..]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            (Number::Long, _) => b.first_chunk().map_or(0.0, |b| i64::from_le_bytes(*b) as f64),
            (Number::Double, _) => b.first_chunk().map_or(0.0, |b| f64::from_le_bytes(*b)),
            _ => 0.0,
        }
    }
}

/// What a type's number stands for: its numbers and how many there are. Source: OpenUSD, `crateDataTypes.h`.
fn numeric(kind: u8) -> Option<(Number, usize)> {
    use Number::{Byte, Double, Float, Half, Int, Long};
    Some(match kind {
        1 | 2 => (Byte, 1),
        3 | 4 => (Int, 1),
        5 | 6 => (Long, 1),
        7 => (Half, 1),
        8 => (Float, 1),
        9 | 56 => (Double, 1),
        13 => (Double, 4),
        14 => (Double, 9),
        15 => (Double, 16),
        16 => (Double, 4),
        17 => (Float, 4),
        18 => (Half, 4),
        19 => (Double, 2),
        20 => (Float, 2),
        21 => (Half, 2),
        22 => (Int, 2),
        23 => (Double, 3),
        24 => (Float, 3),
        25 => (Half, 3),
        26 => (Int, 3),
        27 => (Double, 4),
        28 => (Float, 4),
        29 => (Half, 4),
        30 => (Int, 4),
        _ => return None,
    })
}

impl PackedValues for Crate {
    fn value(&self, word: u64, name: &str) -> Result<Value, SceneError> {
        self.read(word, 0).map_err(|found| damaged(name, found))
    }
}

impl Crate {
    fn token(&self, number: u64) -> Result<Arc<str>, Wrong> {
        let token = usize::try_from(number).ok().and_then(|n| self.tokens.get(n));
        token.cloned().ok_or_else(|| format!("token {number} of {}", self.tokens.len()))
    }

    fn string(&self, number: u64) -> Result<Arc<str>, Wrong> {
        let token = usize::try_from(number).ok().and_then(|n| self.strings.get(n));
        self.token(u64::from(*token.ok_or_else(|| format!("string {number} of {}", self.strings.len()))?))
    }

    fn path(&self, number: u32) -> Result<Arc<str>, Wrong> {
        self.paths.get(number as usize).cloned().ok_or_else(|| format!("path {number} of {}", self.paths.len()))
    }

    fn read(&self, word: u64, depth: u32) -> Result<Value, Wrong> {
        if depth > DEEPEST_VALUE {
            return Err(format!("values within values, more than {DEEPEST_VALUE} deep"));
        }
        let (is_array, is_inlined, is_compressed) = (word >> 63 & 1 == 1, word >> 62 & 1 == 1, word >> 61 & 1 == 1);
        let (kind, payload) = ((word >> 48) as u8, word & 0xffff_ffff_ffff);
        if is_array {
            return self.array(kind, payload, is_compressed);
        }
        if is_inlined {
            return self.inlined(kind, payload);
        }
        let mut at = Cursor::new(&self.bytes, payload)?;
        if let Some((number, n)) = numeric(kind) {
            let bytes = at.take(number.size() * n)?;
            let mut values: Vec<f64> = bytes.chunks_exact(number.size()).map(|b| number.of(b)).collect();
            if let (16..=18, [x, y, z, w]) = (kind, &values[..]) {
                values = vec![*w, *x, *y, *z];
            }
            return Ok(if n == 1 { Value::Number(values[0]) } else { Value::Doubles(values.into()) });
        }
        Ok(match kind {
            32 | 33 => {
                let token = |c: &mut Cursor| {
                    let number = u64::from(c.u32()?);
                    if kind == 32 { self.token(number) } else { self.string(number) }
                };
                Value::List(Arc::new(list_op(&mut at, 4, token)?))
            }
            34 => Value::List(Arc::new(list_op(&mut at, 4, |c| self.path(c.u32()?))?)),
            37 => {
                let number = |c: &mut Cursor| Ok((c.u64()? as i64).to_string().into());
                Value::List(Arc::new(list_op(&mut at, 8, number)?))
            }
            35 => Value::References(Arc::new(list_op(&mut at, 24, |c| self.reference(c))?)),
            55 => Value::References(Arc::new(list_op(&mut at, 8, |c| self.payload(c))?)),
            47 => {
                let one = self.payload(&mut at)?;
                let explicit = Some(if one.asset.is_empty() && one.prim.is_empty() { vec![] } else { vec![one] });
                Value::References(Arc::new(ListOp { explicit, ..ListOp::default() }))
            }
            40 => {
                let n = at.count(4)?;
                Value::Texts((0..n).map(|_| self.path(at.u32()?)).collect::<Result<_, _>>()?)
            }
            41 => {
                let n = at.count(4)?;
                Value::Texts((0..n).map(|_| self.token(at.u32()?.into())).collect::<Result<_, _>>()?)
            }
            50 => {
                let n = at.count(4)?;
                Value::Texts((0..n).map(|_| self.string(at.u32()?.into())).collect::<Result<_, _>>()?)
            }
            45 => {
                let n = at.count(8)?;
                let pair = |at: &mut Cursor| Ok((self.string(at.u32()?.into())?, self.string(at.u32()?.into())?));
                Value::Selections((0..n).map(|_| pair(&mut at)).collect::<Result<_, Wrong>>()?)
            }
            46 => self.samples(&mut at, depth)?,
            48 => {
                let n = at.count(8)?;
                Value::Doubles((0..n).map(|_| at.f64()).collect::<Result<_, _>>()?)
            }
            49 => {
                let n = at.count(16)?;
                Value::Doubles((0..2 * n).map(|_| at.f64()).collect::<Result<_, _>>()?)
            }
            52 => self.read(at.u64()?, depth + 1)?,
            _ => Value::Other,
        })
    }

    fn inlined(&self, kind: u8, payload: u64) -> Result<Value, Wrong> {
        let bytes = payload.to_le_bytes();
        let low = payload as u32;
        Ok(match kind {
            1 | 2 | 4 | 6 => Value::Number(f64::from(low)),
            3 | 5 => Value::Number(f64::from(low as i32)),
            7 => Value::Number(f64::from(half(low as u16))),
            8 | 9 | 56 => Value::Number(f64::from(f32::from_bits(low))),
            10 => Value::Text(self.string(payload)?),
            11 | 12 => Value::Text(self.token(payload)?),
            // Matrices that differ from 0 on the diagonal alone.
            13..=15 => {
                let n = usize::from(kind - 11);
                let mut values = vec![0.0; n * n];
                (0..n).for_each(|i| values[i * (n + 1)] = f64::from(bytes[i] as i8));
                Value::Doubles(values.into())
            }
            19..=30 => {
                let n = usize::from((kind - 19) / 4 + 2);
                Value::Doubles(bytes[..n].iter().map(|b| f64::from(*b as i8)).collect())
            }
            42 => Value::Text(["def", "over", "class"].get(low as usize).copied().unwrap_or("over").into()),
            51 | 60 => Value::Blocked,
            _ => Value::Other,
        })
    }

    fn array(&self, kind: u8, place: u64, is_compressed: bool) -> Result<Value, Wrong> {
        let mut at = Cursor::new(&self.bytes, place)?;
        let count = match place {
            0 => 0,
            _ => {
                if self.version < [0, 5, 0] {
                    at.u32()?;
                }
                let n = if self.version < [0, 7, 0] { u64::from(at.u32()?) } else { at.u64()? };
                usize::try_from(n).map_err(|_| format!("an array of {n}"))?
            }
        };
        // Of packed numbers the fewest bytes are two bits, packed again.
        let room = (self.bytes.len() - at.at.min(self.bytes.len())).saturating_mul(4 * MOST_EXPANDED);
        if count > room {
            return Err(format!("an array of {count} where {room} fit at most"));
        }
        if let 10..=12 = kind {
            let bytes = at.take(count.checked_mul(4).ok_or("too long an array")?)?;
            let each = bytes.as_chunks::<4>().0.iter().map(|b| u64::from(u32::from_le_bytes(*b)));
            let text = |n| if kind == 10 { self.string(n) } else { self.token(n) };
            return Ok(Value::Texts(each.map(text).collect::<Result<_, _>>()?));
        }
        let Some((number, n)) = numeric(kind) else { return Ok(Value::Other) };
        let is_whole = matches!(number, Number::Byte | Number::Int | Number::Long);
        if is_compressed && count >= LEAST_COMPRESSED && n == 1 {
            if is_whole {
                let packed = at.block()?;
                return Ok(match number {
                    Number::Long => Value::Doubles(integers::<true>(packed, count)?.into_iter().map(|v| v as f64).collect()),
                    _ => Value::Ints(integers::<false>(packed, count)?.into_iter().map(clamped).collect()),
                });
            }
            let code = at.take(1)?[0];
            if code == b'i' {
                let all = integers::<false>(at.block()?, count)?;
                return Ok(Value::Floats(all.into_iter().map(|v| v as f32).collect()));
            }
            if code != b't' {
                return Err(format!("real numbers packed in a way \"{}\"", char::from(code).escape_default()));
            }
            let entries = at.u32()? as usize;
            let table = at.take(entries.checked_mul(number.size()).ok_or("too long a table")?)?;
            let table: Vec<f64> = table.chunks_exact(number.size()).map(|b| number.of(b)).collect();
            let places = integers::<false>(at.block()?, count)?;
            let look = |i: i64| usize::try_from(i).ok().and_then(|i| table.get(i)).copied();
            let values = places.into_iter().map(|i| look(i).ok_or_else(|| format!("entry {i} of {entries}")));
            let values = values.collect::<Result<Vec<f64>, _>>()?;
            return Ok(match number {
                Number::Double => Value::Doubles(values.into()),
                _ => Value::Floats(values.into_iter().map(|v| v as f32).collect()),
            });
        }
        let size = number.size();
        let bytes = at.take(count.checked_mul(size * n).ok_or("too long an array")?)?;
        if is_whole && number != Number::Long {
            return Ok(Value::Ints(bytes.chunks_exact(size).map(|b| number.of(b) as i32).collect()));
        }
        if matches!(number, Number::Double | Number::Long) && !(16..=18).contains(&kind) {
            return Ok(Value::Doubles(bytes.chunks_exact(size).map(|b| number.of(b)).collect()));
        }
        let mut values: Vec<f32> = match number {
            Number::Float => bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            _ => bytes.chunks_exact(size).map(|b| number.of(b) as f32).collect(),
        };
        if let 16..=18 = kind {
            values.as_chunks_mut::<4>().0.iter_mut().for_each(|q| q.rotate_right(1));
        }
        Ok(Value::Floats(values.into()))
    }

    fn reference(&self, at: &mut Cursor) -> Result<Reference, Wrong> {
        let (asset, prim) = (self.string(at.u32()?.into())?, self.path(at.u32()?)?);
        let shift = TimeShift { offset: at.f64()?, scale: at.f64()? };
        // Data of others: names, and values that are skipped.
        for _ in 0..at.count(12)? {
            at.u32()?;
            at.follow()?;
            at.u64()?;
        }
        Ok(Reference { asset, prim, shift })
    }

    fn payload(&self, at: &mut Cursor) -> Result<Reference, Wrong> {
        let (asset, prim) = (self.string(at.u32()?.into())?, self.path(at.u32()?)?);
        let shift = match self.version < [0, 8, 0] {
            true => TimeShift::NONE,
            false => TimeShift { offset: at.f64()?, scale: at.f64()? },
        };
        Ok(Reference { asset, prim, shift })
    }

    fn samples(&self, at: &mut Cursor, depth: u32) -> Result<Value, Wrong> {
        at.follow()?;
        let times = self.read(at.u64()?, depth + 1)?.doubles().ok_or("time samples without times")?;
        at.follow()?;
        let n = at.count(8)?;
        if n != times.len() {
            return Err(format!("{n} time samples at {} times", times.len()));
        }
        let mut all = times.iter().map(|t| Ok((*t, Field::Packed(at.u64()?)))).collect::<Result<Vec<_>, Wrong>>()?;
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Value::Samples(all.into()))
    }
}

fn clamped(v: i64) -> i32 {
    v.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

fn list_op<T>(at: &mut Cursor, size: usize, item: impl Fn(&mut Cursor) -> Result<T, Wrong>) -> Result<ListOp<T>, Wrong> {
    let header = at.take(1)?[0];
    let mut list = |bit: u8| -> Result<Vec<T>, Wrong> {
        if header >> bit & 1 == 0 {
            return Ok(vec![]);
        }
        let n = at.count(size)?;
        (0..n).map(|_| item(at)).collect()
    };
    let (explicit, added, prepended, mut appended, deleted) = (list(1)?, list(2)?, list(5)?, list(6)?, list(3)?);
    appended.extend(added);
    Ok(ListOp { explicit: (header & 1 == 1).then_some(explicit), prepended, appended, deleted })
}

fn damaged(name: &str, found: Wrong) -> SceneError {
    error(name, found, "a whole .usdc file (crate 0.4 to 0.13): it is cut short or damaged")
}

/// Reads a crate file: its specs; values stay packed. Fails where it is not of crate 0.4 to 0.13, cut short, or one of its sections is missing or damaged.
pub fn read(bytes: Arc<[u8]>, name: &str, folder: Folder) -> Result<Layer, SceneError> {
    let header = bytes.get(8..11).map(|v| [v[0], v[1], v[2]]);
    let version = header.ok_or_else(|| damaged(name, format!("{} bytes", bytes.len())))?;
    if !([0, 4, 0]..[0, 14, 0]).contains(&version) {
        let [a, b, c] = version;
        let expected = "crate 0.4 to 0.13; usdcat -o scene.usda writes it as text";
        return Err(error(name, format!("crate version {a}.{b}.{c}"), expected));
    }
    let (data, specs) = structure(bytes, version).map_err(|found| damaged(name, found))?;
    Ok(Layer::new(name, folder, specs, Some(Box::new(data))))
}

type Specs = HashMap<Box<str>, Spec>;

fn structure(bytes: Arc<[u8]>, version: [u8; 3]) -> Result<(Crate, Specs), Wrong> {
    let place = Cursor::new(&bytes, 16)?.u64()?;
    let mut toc = Cursor::new(&bytes, place)?;
    let n = toc.count(32)?;
    let mut sections: HashMap<&[u8], (u64, u64)> = HashMap::new();
    for _ in 0..n {
        let name = toc.take(16)?;
        let name = name.split(|b| *b == 0).next().unwrap_or_default();
        sections.insert(name, (toc.u64()?, toc.u64()?));
    }
    let section = |name: &str| -> Result<Cursor, Wrong> {
        let (start, size) = *sections.get(name.as_bytes()).ok_or_else(|| format!("no section {name}"))?;
        let end = start.checked_add(size).filter(|end| *end <= bytes.len() as u64);
        let end = end.ok_or_else(|| format!("a section {name} behind its end"))? as usize;
        Cursor::new(&bytes[..end], start)
    };

    let mut at = section("TOKENS")?;
    let (count, size) = (at.u64()?, at.u64()?);
    let text = unpacked(at.block()?, usize::try_from(size).map_err(|e| e.to_string())?)?;
    let tokens: Vec<Arc<str>> = text.split(|b| *b == 0).map(|t| String::from_utf8_lossy(t).into()).collect();
    if count > tokens.len() as u64 {
        return Err(format!("{count} tokens announced and {} there", tokens.len()));
    }
    let mut at = section("STRINGS")?;
    let n = at.count(4)?;
    let strings = (0..n).map(|_| at.u32()).collect::<Result<Vec<_>, _>>()?;

    let room = bytes.len().saturating_mul(4 * MOST_EXPANDED).min(1 << 28);
    let fits = |n: u64| usize::try_from(n).ok().filter(|n| *n <= room).ok_or_else(|| format!("a list of {n}"));
    let mut at = section("FIELDS")?;
    let n = fits(at.u64()?)?;
    let names = integers::<false>(at.block()?, n)?;
    let words = unpacked(at.block()?, n.checked_mul(8).ok_or("too many fields")?)?;
    let words = words.as_chunks::<8>().0;
    if words.len() < n {
        return Err(format!("{n} fields of which {} are there", words.len()));
    }
    let key = |i: i64| usize::try_from(i).ok().and_then(|i| tokens.get(i)).and_then(|t| Key::named(t));
    let fields: Vec<(Option<Key>, u64)> = names.iter().zip(words).map(|(i, w)| (key(*i), u64::from_le_bytes(*w))).collect();
    let mut at = section("FIELDSETS")?;
    let n = fits(at.u64()?)?;
    let sets = integers::<false>(at.block()?, n)?;

    let mut at = section("PATHS")?;
    let total = fits(at.u64()?)?;
    let n = fits(at.u64()?)?;
    if total > n + 1 {
        return Err(format!("{total} paths of which {n} are there"));
    }
    let lists = [integers::<false>(at.block()?, n)?, integers::<false>(at.block()?, n)?, integers::<false>(at.block()?, n)?];
    let paths = paths(&lists, total, &tokens)?;

    let mut at = section("SPECS")?;
    let n = fits(at.u64()?)?;
    let [of, set, kinds] =
        [integers::<false>(at.block()?, n)?, integers::<false>(at.block()?, n)?, integers::<false>(at.block()?, n)?];
    let mut specs = HashMap::with_capacity(n.min(paths.len()));
    for i in 0..n {
        // Attributes, prims, the root, relationships, variants; not the set of variants.
        if !matches!(kinds[i], 1 | 6 | 7 | 8 | 10) {
            continue;
        }
        let path = usize::try_from(of[i]).ok().and_then(|p| paths.get(p)).ok_or_else(|| format!("a spec of path {}", of[i]))?;
        let start = usize::try_from(set[i]).ok().and_then(|s| sets.get(s..)).ok_or_else(|| format!("field set {}", set[i]))?;
        let mut spec = Spec::default();
        // A set of fields ends with −1.
        for f in start.iter().take_while(|f| **f >= 0).take(MOST_FIELDS) {
            if let Some((Some(key), word)) = fields.get(*f as usize) {
                spec.fields.push((*key, Field::Packed(*word)));
            }
        }
        specs.insert(Box::from(&**path), spec);
    }
    Ok((Crate { bytes, version, tokens, strings, paths }, specs))
}

/// Most fields of one spec.
const MOST_FIELDS: usize = 4096;

/// Paths as a tree in depth-first order: each entry has a name and says whether a child or a sibling follows. Source: OpenUSD, `crateFile.cpp`.
fn paths([numbers, names, jumps]: &[Vec<i64>; 3], total: usize, tokens: &[Arc<str>]) -> Result<Vec<Arc<str>>, Wrong> {
    let empty: Arc<str> = "".into();
    let mut out = vec![empty.clone(); total];
    let mut seen = vec![false; numbers.len()];
    let mut bytes = 0;
    // Where to go on, below which path, how deep.
    let mut open: Vec<(usize, Arc<str>, u32)> = if numbers.is_empty() { vec![] } else { vec![(0, empty, 0)] };
    while let Some((mut at, mut parent, mut depth)) = open.pop() {
        loop {
            if at >= numbers.len() || std::mem::replace(&mut seen[at], true) {
                return Err("a tree of paths that leads back into itself".into());
            }
            let path: Arc<str> = if parent.is_empty() {
                "/".into()
            } else {
                let token = usize::try_from(names[at].unsigned_abs()).ok().and_then(|t| tokens.get(t));
                let token = token.ok_or_else(|| format!("a path of token {}", names[at]))?;
                if names[at] < 0 {
                    format!("{parent}.{token}").into()
                } else if token.starts_with('{') {
                    format!("{parent}{token}").into()
                } else {
                    child_path(&parent, token).into()
                }
            };
            bytes += path.len();
            if depth > DEEPEST_PATH || bytes > MOST_PATH_BYTES {
                return Err(format!("paths more than {DEEPEST_PATH} deep, or of more than {MOST_PATH_BYTES} bytes"));
            }
            let slot = usize::try_from(numbers[at]).ok().and_then(|n| out.get_mut(n));
            *slot.ok_or_else(|| format!("path number {} of {total}", numbers[at]))? = path.clone();
            let jump = jumps[at];
            let (has_child, has_sibling) = (jump > 0 || jump == -1, jump >= 0);
            match (has_child, has_sibling) {
                (true, _) => {
                    if has_sibling {
                        open.push((at.saturating_add(jump as usize), parent, depth));
                    }
                    (parent, depth) = (path, depth + 1);
                }
                (false, true) => (),
                (false, false) => break,
            }
            at += 1;
        }
    }
    Ok(out)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Bytes as one block of literals.
    pub fn packed(data: &[u8]) -> Vec<u8> {
        let mut out = vec![0];
        if data.len() < 15 {
            out.push((data.len() as u8) << 4);
        } else {
            out.push(0xf0);
            let mut rest = data.len() - 15;
            while rest >= 255 {
                out.push(255);
                rest -= 255;
            }
            out.push(rest as u8);
        }
        out.extend_from_slice(data);
        out
    }

    /// Whole numbers as differences of four bytes each.
    pub fn packed_integers(list: &[i32]) -> Vec<u8> {
        let mut data = vec![0; 4];
        data.extend(vec![0xff; list.len().div_ceil(4)]);
        let mut last = 0i32;
        for v in list {
            data.extend(v.wrapping_sub(last).to_le_bytes());
            last = *v;
        }
        packed(&data)
    }

    #[test]
    fn half_precision_is_ieee_754() {
        for (bits, value) in [(0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65504.0), (0x0001, 2f32.powi(-24)), (0x3555, 0.333_251_95)]
        {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7c00).is_infinite() && half(0x7e00).is_nan());
    }

    #[test]
    fn trees_of_paths_do_not_go_round() {
        let tokens: Vec<Arc<str>> = ["", "A", "B", "p", "{v=x}"].map(Arc::from).to_vec();
        // /, A, its property p, its variant, B within that, B beside A.
        let lists = [vec![0, 1, 2, 3, 4, 5], vec![0, 1, -3, 4, 2, 2], vec![-1, 4, 0, -1, -2, -2]];
        let all = paths(&lists, 6, &tokens).unwrap();
        assert_eq!(all.iter().map(|p| &**p).collect::<Vec<_>>(), ["/", "/A", "/A.p", "/A{v=x}", "/A{v=x}B", "/B"]);
        let round = [vec![0, 1], vec![0, 1], vec![-1, 0]];
        assert!(paths(&round, 2, &tokens).is_err());
        let chain = 1000;
        let deep = [(0..chain).collect::<Vec<i64>>(), vec![1; chain as usize], vec![-1; chain as usize]];
        assert!(paths(&deep, chain as usize, &tokens).unwrap_err().contains("deep"));
    }
}

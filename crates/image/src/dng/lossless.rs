//! Lossless JPEG, as raw files use it: process 14 (Huffman, sequential), 2 to 16 bits.
//!
//! Source: ITU-T T.81 (1992) annex H (lossless mode), annex C and K.2 (Huffman codes). Pixels of a row are taken as two components
//! side by side, so that in a Bayer row each is predicted from the last of its own colour.

use crate::ImageError;

fn malformed(reason: impl Into<String>) -> ImageError {
    ImageError::Malformed { format: "DNG", reason: format!("lossless JPEG: {}", reason.into()) }
}

/// Bits that hold a difference (T.81 table H.2), and what is written for it.
fn category(difference: i32) -> u32 {
    32 - difference.unsigned_abs().leading_zeros()
}

/// Lengths of Huffman codes, none longer than 16 and none of ones only, for symbols 0 to 16 by how often they come.
/// Source: T.81, K.2.
fn code_lengths(counts: &[u32; 17]) -> [u8; 17] {
    // One symbol more, which takes the code of ones only.
    let mut frequency = [0u64; 18];
    frequency[..17].iter_mut().zip(counts).for_each(|(f, c)| *f = u64::from(*c));
    frequency[17] = 1;
    let mut size = [0u32; 18];
    let mut others = [None; 18];
    loop {
        let least =
            |skip: Option<usize>| (0..18).rev().filter(|i| frequency[*i] > 0 && Some(*i) != skip).min_by_key(|i| frequency[*i]);
        let Some(mut a) = least(None) else { break };
        let Some(mut b) = least(Some(a)) else { break };
        frequency[a] += frequency[b];
        frequency[b] = 0;
        loop {
            size[a] += 1;
            match others[a] {
                Some(next) => a = next,
                None => break,
            }
        }
        others[a] = Some(b);
        loop {
            size[b] += 1;
            match others[b] {
                Some(next) => b = next,
                None => break,
            }
        }
    }
    // Numbers of codes by length; too long ones are shortened in pairs.
    let mut bits = [0u32; 33];
    size.iter().filter(|s| **s > 0).for_each(|s| bits[*s as usize] += 1);
    for i in (17..33).rev() {
        while bits[i] > 0 {
            let j = (1..i - 1).rev().find(|j| bits[*j] > 0).unwrap_or(1);
            bits[i] -= 2;
            bits[i - 1] += 1;
            bits[j + 1] += 2;
            bits[j] -= 1;
        }
    }
    // The extra symbol gives its code back: the last of the longest.
    if let Some(longest) = (1..=16).rev().find(|i| bits[*i] > 0) {
        bits[longest] -= 1;
    }
    let mut order: Vec<usize> = (0..17).filter(|i| counts[*i] > 0).collect();
    order.sort_by_key(|i| (size[*i], *i));
    let mut lengths = [0u8; 17];
    let mut all = (1..=16usize).flat_map(|l| std::iter::repeat_n(l as u8, bits[l] as usize));
    for symbol in order {
        lengths[symbol] = all.next().unwrap_or(16);
    }
    lengths
}

/// Codes of symbols from their lengths (T.81, C.2), and the symbols in the order of the table.
fn codes(lengths: &[u8; 17]) -> ([u16; 17], Vec<u8>) {
    let mut order: Vec<u8> = (0..17).filter(|i| lengths[*i as usize] > 0).collect();
    order.sort_by_key(|i| (lengths[*i as usize], *i));
    let mut codes = [0u16; 17];
    let (mut code, mut last) = (0u32, 0u8);
    for symbol in &order {
        let length = lengths[*symbol as usize];
        code <<= length - last;
        last = length;
        codes[*symbol as usize] = code as u16;
        code += 1;
    }
    (codes, order)
}

/// Encodes a rectangle of numbers of `bits` bits; `width` is even and `pixels` whole rows. `bits`: 2 to 16.
pub fn encode(pixels: &[u16], width: usize, bits: u32) -> Vec<u8> {
    debug_assert!(width.is_multiple_of(2) && pixels.len().is_multiple_of(width));
    let height = pixels.len() / width;
    let middle = 1i32 << (bits - 1);
    let predicted = |row: usize, column: usize| match (row, column) {
        (0, 0 | 1) => middle,
        (_, 0 | 1) => i32::from(pixels[(row - 1) * width + column]),
        _ => i32::from(pixels[row * width + column - 2]),
    };
    // Differences are modulo 2^16; the one of 32768 has a symbol without further bits.
    let difference = |row: usize, column: usize| {
        let d = i32::from(pixels[row * width + column]) - predicted(row, column);
        match i32::from(d as i16) {
            -32768 => 32768,
            d => d,
        }
    };
    let mut counts = [0u32; 17];
    for row in 0..height {
        for column in 0..width {
            counts[category(difference(row, column)) as usize] += 1;
        }
    }
    let lengths = code_lengths(&counts);
    let (codes, order) = codes(&lengths);

    let mut to = vec![0xff, 0xd8];
    // SOF3: two components, half as wide.
    to.extend([0xff, 0xc3, 0, 14, bits as u8]);
    to.extend((height as u16).to_be_bytes());
    to.extend((width as u16 / 2).to_be_bytes());
    to.extend([2, 0, 0x11, 0, 1, 0x11, 0]);
    to.extend([0xff, 0xc4]);
    to.extend((19 + order.len() as u16).to_be_bytes());
    to.push(0);
    to.extend((1..=16u8).map(|l| lengths.iter().filter(|x| **x == l).count() as u8));
    to.extend(&order);
    // SOS: predictor 1, the pixel before.
    to.extend([0xff, 0xda, 0, 10, 2, 0, 0, 1, 0, 1, 0, 0]);
    let (mut held, mut count) = (0u64, 0u32);
    for row in 0..height {
        for column in 0..width {
            let d = difference(row, column);
            let c = category(d);
            held = held << lengths[c as usize] | u64::from(codes[c as usize]);
            count += u32::from(lengths[c as usize]);
            if c > 0 && c < 16 {
                let value = if d < 0 { d - 1 } else { d } as u32 & ((1 << c) - 1);
                held = held << c | u64::from(value);
                count += c;
            }
            while count >= 8 {
                count -= 8;
                let byte = (held >> count) as u8;
                to.push(byte);
                if byte == 0xff {
                    to.push(0);
                }
            }
        }
    }
    if count > 0 {
        let byte = (held << (8 - count)) as u8 | ((1u16 << (8 - count)) - 1) as u8;
        to.push(byte);
        if byte == 0xff {
            to.push(0);
        }
    }
    to.extend([0xff, 0xd9]);
    to
}

/// A Huffman table to decode with: (length, symbol) for each 16 bits to come.
struct Decoding(Vec<(u8, u8)>);

impl Decoding {
    fn new(counts: &[u8], symbols: &[u8]) -> Result<Self, ImageError> {
        let mut table = vec![(0u8, 0u8); 1 << 16];
        let mut symbols = symbols.iter();
        let (mut code, mut length) = (0u32, 0);
        for count in counts {
            length += 1;
            code <<= 1;
            for _ in 0..*count {
                let symbol = *symbols.next().ok_or_else(|| malformed("a Huffman table ends early"))?;
                let first = (code as usize) << (16 - length);
                let places = table.get_mut(first..first + (1 << (16 - length)));
                places.ok_or_else(|| malformed("a Huffman table with too many codes"))?.fill((length as u8, symbol));
                code += 1;
            }
        }
        Ok(Decoding(table))
    }
}

/// Bits of entropy-coded data.
struct Bits<'a> {
    bytes: &'a [u8],
    held: u64,
    count: u32,
    /// Bits that were made up after the end.
    missing: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 48 {
            let byte = match self.bytes {
                [0xff, 0, rest @ ..] => {
                    self.bytes = rest;
                    0xff
                }
                // A marker: no more data.
                [0xff, ..] | [] => {
                    self.missing += 8;
                    0
                }
                [byte, rest @ ..] => {
                    self.bytes = rest;
                    *byte
                }
            };
            self.held = self.held << 8 | u64::from(byte);
            self.count += 8;
        }
    }

    fn peek16(&mut self) -> usize {
        (self.held >> (self.count - 16)) as usize & 0xffff
    }

    fn take(&mut self, bits: u32) -> u32 {
        self.count -= bits;
        (self.held >> self.count) as u32 & ((1u64 << bits) - 1) as u32
    }

    fn difference(&mut self, table: &Decoding) -> Result<i32, ImageError> {
        self.fill();
        let (length, symbol) = table.0[self.peek16()];
        if length == 0 || symbol > 16 {
            return Err(malformed("a code that is not in its table"));
        }
        self.count -= u32::from(length);
        let bits = u32::from(symbol);
        Ok(match bits {
            0 => 0,
            16 => 32768,
            _ => {
                let value = self.take(bits) as i32;
                if value >> (bits - 1) == 0 { value - (1 << bits) + 1 } else { value }
            }
        })
    }
}

/// A decoded picture: components of a pixel side by side.
pub struct Decoded {
    /// Numbers a row: pixels × components.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` numbers.
    pub data: Vec<u16>,
}

/// Decodes a picture of at most `most` numbers. Fails on bytes that end early or contradict themselves, on larger pictures, and
/// on what is not read: components of different sizes or in several scans, restart intervals.
pub fn decode(bytes: &[u8], most: usize) -> Result<Decoded, ImageError> {
    let short = || malformed("it ends early");
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return Err(malformed("no start of a picture"));
    }
    let mut tables: [Option<Decoding>; 4] = Default::default();
    let mut frame: Option<(u32, usize, usize, Vec<u8>)> = None;
    let mut restart = 0usize;
    let mut at = 2;
    loop {
        let marker = bytes.get(at..at + 2).ok_or_else(short)?;
        if marker[0] != 0xff {
            return Err(malformed("a marker is missing"));
        }
        let length = bytes.get(at + 2..at + 4).map(|l| u16::from_be_bytes([l[0], l[1]]) as usize).ok_or_else(short)?;
        let body = bytes.get(at + 4..at + 2 + length.max(2)).ok_or_else(short)?;
        match marker[1] {
            0xc3 => {
                let &[bits, h0, h1, w0, w1, count, ref rest @ ..] = body else { return Err(short()) };
                let (height, width) = (u16::from_be_bytes([h0, h1]) as usize, u16::from_be_bytes([w0, w1]) as usize);
                let sampling = rest.chunks_exact(3).take(count as usize);
                if !(2..=16).contains(&bits) || !(1..=4).contains(&count) || rest.len() < 3 * count as usize {
                    return Err(malformed(format!("{bits} bits, {count} components")));
                }
                if sampling.clone().any(|s| s[1] != 0x11) {
                    return Err(malformed("components of different sizes"));
                }
                if width == 0 || height == 0 || width * height * count as usize > most {
                    return Err(malformed(format!("{width} × {height} pixels, more than its place holds")));
                }
                frame = Some((bits as u32, width, height, sampling.map(|s| s[0]).collect()));
            }
            0xc4 => {
                let mut rest = body;
                while !rest.is_empty() {
                    let number = rest[0] as usize;
                    let counts = rest.get(1..17).ok_or_else(short)?;
                    let total: usize = counts.iter().map(|c| *c as usize).sum();
                    let symbols = rest.get(17..17 + total).ok_or_else(short)?;
                    *tables.get_mut(number).ok_or_else(|| malformed("a table with an unknown number"))? =
                        Some(Decoding::new(counts, symbols)?);
                    rest = &rest[17 + total..];
                }
            }
            0xdd => restart = body.get(..2).map(|r| u16::from_be_bytes([r[0], r[1]]) as usize).ok_or_else(short)?,
            0xda => {
                let (bits, width, height, ids) = frame.ok_or_else(|| malformed("data before its description"))?;
                let count = *body.first().ok_or_else(short)? as usize;
                let selectors = body.get(1..1 + 2 * count).ok_or_else(short)?;
                let [predictor, _, shift] = *body.get(1 + 2 * count..4 + 2 * count).ok_or_else(short)? else {
                    return Err(short());
                };
                if count != ids.len() || restart != 0 {
                    return Err(malformed("components in several scans, or restart intervals, are not read"));
                }
                let shift = u32::from(shift & 15);
                if !(1..=7).contains(&predictor) || shift >= bits {
                    return Err(malformed(format!("predictor {predictor}, shift {shift}")));
                }
                let table_of = |id: &u8| {
                    let number = selectors.chunks_exact(2).find(|s| s[0] == *id)?[1] >> 4;
                    tables.get(number as usize)?.as_ref()
                };
                let of: Option<Vec<&Decoding>> = ids.iter().map(table_of).collect();
                let of = of.ok_or_else(|| malformed("a component without its table"))?;
                let rest = bytes.get(at + 2 + length..).ok_or_else(short)?;
                let data = scan(rest, &of, [width, height], bits - shift, predictor)?;
                let data = data.into_iter().map(|v| v << shift).collect();
                return Ok(Decoded { width: width * count, height, data });
            }
            0xd9 => return Err(malformed("it holds no data")),
            _ => {}
        }
        at += 2 + length.max(2);
    }
}

fn scan(
    bytes: &[u8],
    tables: &[&Decoding],
    [width, height]: [usize; 2],
    bits: u32,
    predictor: u8,
) -> Result<Vec<u16>, ImageError> {
    let n = tables.len();
    let stride = width * n;
    // No code is shorter than a bit.
    let most = bytes.len().saturating_mul(8);
    if stride * height > most {
        return Err(malformed(format!(
            "{width} × {height} pixels of {n} numbers are announced, and its {} bytes can become {most} numbers at most",
            bytes.len()
        )));
    }
    let mut source = Bits { bytes, held: 0, count: 0, missing: 0 };
    let mut data = vec![0u16; stride * height];
    for row in 0..height {
        for column in 0..width {
            for (c, table) in tables.iter().enumerate() {
                let i = row * stride + column * n + c;
                let value = |i: usize| i32::from(data[i]);
                let predicted = match (row, column) {
                    (0, 0) => 1 << (bits - 1),
                    (0, _) => value(i - n),
                    (_, 0) => value(i - stride),
                    _ => {
                        let (a, b, c) = (value(i - n), value(i - stride), value(i - stride - n));
                        match predictor {
                            1 => a,
                            2 => b,
                            3 => c,
                            4 => a + b - c,
                            5 => a + ((b - c) >> 1),
                            6 => b + ((a - c) >> 1),
                            _ => (a + b) >> 1,
                        }
                    }
                };
                data[i] = (predicted + source.difference(table)?) as u16;
            }
        }
        if source.missing > source.count {
            return Err(malformed("its data end early"));
        }
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_kind_come_back() {
        let random = |i: usize| ((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as u32;
        for bits in [8, 10, 12, 14, 16] {
            let mask = ((1u32 << bits) - 1) as u16;
            let noise: Vec<u16> = (0..64 * 20).map(|i| random(i) as u16 & mask).collect();
            let smooth: Vec<u16> = (0..64 * 20).map(|i| (500 + i as u16 / 3 + (random(i) % 9) as u16) & mask).collect();
            let extremes: Vec<u16> = (0..64 * 20).map(|i| if i % 3 == 0 { mask } else { 0 }).collect();
            let flat = vec![7u16; 64 * 20];
            for pixels in [&noise, &smooth, &extremes, &flat] {
                let bytes = encode(pixels, 64, bits);
                let back = decode(&bytes, 64 * 20).unwrap();
                assert!((back.width, back.height) == (64, 20) && back.data == *pixels, "{bits} bits");
                assert!(decode(&bytes[..bytes.len() / 2], 64 * 20).is_err());
                assert!(decode(&bytes, 64 * 19).is_err(), "larger than its place");
            }
            assert!(encode(&smooth, 64, bits).len() < 64 * 20);
        }
    }

    #[test]
    fn more_numbers_than_bits_are_refused() {
        let mut bytes = encode(&[7u16; 64 * 20], 64, 14);
        let frame = bytes.windows(2).position(|w| w == [0xff, 0xc3]).unwrap();
        // After the marker: length, bits, height, width.
        for side in [5, 7] {
            bytes[frame + side..frame + side + 2].copy_from_slice(&30_000u16.to_be_bytes());
        }
        let e = decode(&bytes, 1 << 40).err().unwrap().to_string();
        assert!(e.contains("announced"), "{e}");
    }

    #[test]
    fn codes_are_as_long_as_their_symbols_are_rare() {
        let mut counts = [0u32; 17];
        (0..17).for_each(|i| counts[i] = 1 << i);
        let lengths = code_lengths(&counts);
        assert!(lengths.iter().all(|l| (1..=16).contains(l)) && lengths[16] == 1, "{lengths:?}");
        // Kraft: room is left for the code of ones only.
        let sum: f64 = lengths.iter().map(|l| 0.5f64.powi(i32::from(*l))).sum();
        assert!(sum < 1.0, "{sum}");
    }
}

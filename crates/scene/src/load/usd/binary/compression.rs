//! Packed bytes and whole numbers of crate files: LZ4 blocks, and integers as coded differences.

use super::{Cursor, Wrong};

/// Most bytes of LZ4 output for each byte of input.
pub(super) const MOST_EXPANDED: usize = 255;

/// Unpacks one block of LZ4 onto the end of a list, which may become `most` bytes long.
fn lz4(input: &[u8], out: &mut Vec<u8>, most: usize) -> Result<(), Wrong> {
    let short = || "an LZ4 block that is cut short".to_owned();
    let mut at = 0;
    let length = |at: &mut usize, nibble: u8| -> Result<usize, Wrong> {
        let mut n = usize::from(nibble);
        if nibble == 15 {
            loop {
                let more = *input.get(*at).ok_or_else(short)?;
                *at += 1;
                n += usize::from(more);
                if more != 255 {
                    break;
                }
            }
        }
        Ok(n)
    };
    while at < input.len() {
        let token = input[at];
        at += 1;
        let n = length(&mut at, token >> 4)?;
        let literals = at.checked_add(n).and_then(|end| input.get(at..end)).ok_or_else(short)?;
        at += n;
        if out.len() + n > most {
            return Err(format!("an LZ4 block of more than {most} bytes"));
        }
        out.extend_from_slice(literals);
        if at == input.len() {
            return Ok(());
        }
        let offset = input.get(at..at + 2).ok_or_else(short)?;
        let offset = usize::from(u16::from_le_bytes([offset[0], offset[1]]));
        at += 2;
        let n = length(&mut at, token & 15)? + 4;
        let start =
            out.len().checked_sub(offset).filter(|_| offset > 0).ok_or("an LZ4 block that copies from before its start")?;
        if out.len() + n > most {
            return Err(format!("an LZ4 block of more than {most} bytes"));
        }
        match offset >= n {
            true => out.extend_from_within(start..start + n),
            // Source and copy overlap: what was just written is copied again.
            false => (0..n).for_each(|i| out.push(out[start + i])),
        }
    }
    Ok(())
}

/// Unpacks blocks of LZ4: a byte that counts them (0: a single one without a length), each with its length.
pub(super) fn unpacked(input: &[u8], expected: usize) -> Result<Vec<u8>, Wrong> {
    if expected > input.len().saturating_mul(MOST_EXPANDED) {
        return Err(format!("{} packed bytes that announce {expected}", input.len()));
    }
    let (chunks, mut rest) = input.split_first().ok_or("nothing where packed bytes belong")?;
    let mut out = Vec::with_capacity(expected);
    if *chunks == 0 {
        lz4(rest, &mut out, expected)?;
    }
    for _ in 0..*chunks {
        let n = rest.first_chunk::<4>().map(|b| i32::from_le_bytes(*b)).and_then(|n| usize::try_from(n).ok());
        let (head, after) = n.and_then(|n| rest.get(4..)?.split_at_checked(n)).ok_or("a packed chunk that is cut short")?;
        lz4(head, &mut out, expected)?;
        rest = after;
    }
    Ok(out)
}

/// Unpacks whole numbers: the commonest difference, two bits for each number (0: that one; 1, 2, 3: one that follows in so many bytes), sums.
pub(super) fn integers<const WIDE: bool>(input: &[u8], count: usize) -> Result<Vec<i64>, Wrong> {
    if count == 0 {
        return Ok(vec![]);
    }
    let (word, sizes) = if WIDE { (8, [2, 4, 8]) } else { (4, [1, 2, 4]) };
    let most = word + count.div_ceil(4) + count.checked_mul(word).ok_or("too many numbers")?;
    if count.div_ceil(4) > input.len().saturating_mul(MOST_EXPANDED) {
        return Err(format!("{} packed bytes that announce {count} numbers", input.len()));
    }
    let data = unpacked(input, most.min(input.len().saturating_mul(MOST_EXPANDED)))?;
    let mut head = Cursor::new(&data, 0)?;
    let signed = |b: &[u8]| -> i64 {
        let mut wide = [if b.last().is_some_and(|l| *l >= 128) { 255 } else { 0 }; 8];
        wide[..b.len()].copy_from_slice(b);
        i64::from_le_bytes(wide)
    };
    let common = signed(head.take(word)?);
    let codes = head.take(count.div_ceil(4))?;
    let (mut sum, mut out) = (0i64, Vec::with_capacity(count));
    for i in 0..count {
        let step = match codes[i / 4] >> (2 * (i % 4)) & 3 {
            0 => common,
            n => signed(head.take(sizes[usize::from(n) - 1])?),
        };
        sum = sum.wrapping_add(step);
        if !WIDE {
            sum = i64::from(sum as i32);
        }
        out.push(sum);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{packed, packed_integers};
    use super::*;

    #[test]
    fn blocks_of_lz4_are_unpacked_and_bounded() {
        // "abcd" and a copy of 8 bytes from 4 before, which overlaps itself; then a last literal.
        let block = [0x44, b'a', b'b', b'c', b'd', 4, 0, 0x10, b'!'];
        let mut out = vec![];
        lz4(&block, &mut out, 100).unwrap();
        assert_eq!(out, b"abcdabcdabcd!");
        assert!(lz4(&block, &mut vec![], 12).is_err());
        for cut in [2, 6] {
            assert!(lz4(&block[..cut], &mut vec![], 100).is_err(), "{cut}");
        }
        assert!(lz4(&[0x14, b'a', 9, 0, 0x00], &mut vec![], 100).unwrap_err().contains("before its start"));
        assert!(unpacked(&[0, 0], 1 << 30).unwrap_err().contains("announce"));
    }

    #[test]
    fn whole_numbers_are_sums_of_steps_of_several_widths() {
        // Steps: common (7), one byte (−3), two bytes (1000), four bytes (−70 000).
        let mut data = 7i32.to_le_bytes().to_vec();
        data.push(0b11_10_01_00);
        data.push(-3i8 as u8);
        data.extend(1000i16.to_le_bytes());
        data.extend((-70_000i32).to_le_bytes());
        assert_eq!(integers::<false>(&packed(&data), 4).unwrap(), [7, 4, 1004, -68_996]);
        assert!(integers::<false>(&packed(&data), 9).is_err());
        assert_eq!(integers::<false>(&packed_integers(&[5, -2, i32::MAX]), 3).unwrap(), [5, -2, i64::from(i32::MAX)]);
    }
}

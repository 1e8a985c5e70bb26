//! Numbers of 8 to 16 bits, one after the other, highest bit first, each row from a whole byte on (TIFF 6.0, FillOrder 1).

/// Bytes a row takes.
pub fn row_bytes(width: usize, bits: u32) -> usize {
    (width * bits as usize).div_ceil(8)
}

/// Packs a row, adding to `to`.
pub fn pack(row: &[u16], bits: u32, to: &mut Vec<u8>) {
    let (mut held, mut count) = (0u64, 0u32);
    for v in row {
        held = held << bits | u64::from(*v);
        count += bits;
        while count >= 8 {
            count -= 8;
            to.push((held >> count) as u8);
        }
    }
    if count > 0 {
        to.push((held << (8 - count)) as u8);
    }
}

/// Unpacks a row; `from` holds [`row_bytes`].
pub fn unpack(from: &[u8], bits: u32, row: &mut [u16]) {
    let (mut held, mut count) = (0u64, 0u32);
    let mut bytes = from.iter();
    let mask = (1u64 << bits) - 1;
    for v in row {
        while count < bits {
            held = held << 8 | u64::from(bytes.next().copied().unwrap_or(0));
            count += 8;
        }
        count -= bits;
        *v = (held >> count & mask) as u16;
    }
}

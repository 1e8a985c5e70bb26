//! Chunks of Blosc 1, as NanoVDB files have them: blocks, split into one part a byte of an element, shuffled, packed by LZ4 or zlib.
//!
//! Sources: `README_CHUNK_FORMAT.rst` of c-blosc (BSD) and the LZ4 block format (`lz4_Block_format.md` of lz4). Other inner codecs (BloscLZ,
//! Snappy, Zstandard) and the shuffle of bits are refused: OpenVDB's tools write neither.

/// Bytes of the header of a chunk.
const HEAD: usize = 16;
/// Elements of more bytes are not split into parts, nor are blocks with fewer elements.
const MOST_PARTS: usize = 16;
const LEAST_ELEMENTS: usize = 128;
/// Bytes that one byte of LZ4 or zlib becomes at most: lengths of LZ4 grow by 255 a byte, deflate makes 258 bytes of 2 bits.
const MOST_EXPANSION: usize = 1032;

/// Appends what a chunk holds; at most `most` bytes. Fails, saying what is wrong, where it is damaged or of a kind that is not read.
pub(super) fn unpack(chunk: &[u8], most: usize, out: &mut Vec<u8>) -> Result<(), String> {
    let word = |at: usize| -> Result<usize, String> {
        let bytes = chunk.get(at..at + 4).ok_or("a Blosc chunk that is cut short")?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
    };
    let head = chunk.get(..HEAD).ok_or("a Blosc chunk without a whole header")?;
    let (version, flags, size) = (head[0], head[2], usize::from(head[3]));
    let (total, block, packed) = (word(4)?, word(8)?, word(12)?);
    if version != 2 || size == 0 || flags & 0x08 != 0 {
        return Err(format!("Blosc chunk of version {version}, {size} bytes an element, flags {flags:#04x}"));
    }
    if flags & 0x04 != 0 {
        return Err("bits shuffled by Blosc".into());
    }
    if packed != chunk.len() || total > most {
        return Err(format!("a Blosc chunk of {} bytes that names {packed}, and {total} of {most} unpacked", chunk.len()));
    }
    if flags & 0x02 != 0 {
        let stored = chunk.get(HEAD..HEAD + total).ok_or("a stored Blosc chunk that is cut short")?;
        out.extend_from_slice(stored);
        return Ok(());
    }
    if total == 0 {
        return Ok(());
    }
    if block == 0 || total / MOST_EXPANSION > chunk.len() {
        return Err(format!("Blosc blocks of {block} bytes, {total} of {} in all", chunk.len()));
    }
    let (shuffled, split, codec) = (flags & 0x01 != 0, flags & 0x10 == 0, flags >> 5);
    let (mut plain, mut parts) = (vec![0u8; block.min(total)], Vec::new());
    for k in 0..total.div_ceil(block) {
        let length = block.min(total - k * block);
        let whole = length == block;
        let count = if split && whole && size <= MOST_PARTS && block / size >= LEAST_ELEMENTS { size } else { 1 };
        let part = length / count;
        let mut at = word(HEAD + 4 * k)?;
        let block = &mut plain[..length];
        for to in block.chunks_mut(part) {
            let bytes = word(at)?;
            let from = chunk.get(at + 4..).and_then(|rest| rest.get(..bytes)).ok_or("a Blosc block that is cut short")?;
            at += 4 + bytes;
            match codec {
                _ if bytes == to.len() => to.copy_from_slice(from),
                1 => lz4(from, to)?,
                3 => zlib(from, to)?,
                other => {
                    let name =
                        ["BloscLZ", "LZ4", "Snappy", "zlib", "Zstandard"].get(usize::from(other)).unwrap_or(&"another codec");
                    return Err(format!("Blosc with {name}: only LZ4 and zlib are read"));
                }
            }
        }
        match shuffled && size > 1 {
            true => unshuffle(block, size, &mut parts),
            false => {
                parts.clear();
                parts.extend_from_slice(block);
            }
        }
        out.extend_from_slice(&parts);
    }
    Ok(())
}

/// First bytes of all elements come first, then all second ones; what is left over at the end stays.
fn unshuffle(from: &[u8], size: usize, to: &mut Vec<u8>) {
    let elements = from.len() / size;
    to.clear();
    to.resize(from.len(), 0);
    for byte in 0..size {
        for (i, v) in from[byte * elements..(byte + 1) * elements].iter().enumerate() {
            to[i * size + byte] = *v;
        }
    }
    to[elements * size..].copy_from_slice(&from[elements * size..]);
}

fn zlib(from: &[u8], to: &mut [u8]) -> Result<(), String> {
    use std::io::Read;
    let mut reader = flate2::read::ZlibDecoder::new(from);
    reader.read_exact(to).map_err(|e| format!("a Blosc block: zlib: {e}"))
}

fn broken() -> String {
    "a Blosc block that is no LZ4".to_owned()
}

/// A length of four bits, and the bytes that continue it.
fn length(from: &[u8], read: &mut usize, first: u8) -> Result<usize, String> {
    let mut sum = usize::from(first);
    let mut goes_on = first == 15;
    while goes_on {
        let more = *from.get(*read).ok_or_else(broken)?;
        *read += 1;
        sum += usize::from(more);
        goes_on = more == 255;
    }
    Ok(sum)
}

/// Unpacks a block of LZ4 that fills `to`.
///
/// Sequences of literals and of copies from before, a token of four bits for the length of each; 15 is continued in bytes, up to one below 255.
fn lz4(from: &[u8], to: &mut [u8]) -> Result<(), String> {
    let (mut read, mut written) = (0, 0);
    loop {
        let token = *from.get(read).ok_or_else(broken)?;
        read += 1;
        let literals = length(from, &mut read, token >> 4)?;
        let source = from.get(read..).and_then(|rest| rest.get(..literals)).ok_or_else(broken)?;
        to.get_mut(written..).and_then(|rest| rest.get_mut(..literals)).ok_or_else(broken)?.copy_from_slice(source);
        (read, written) = (read + literals, written + literals);
        if read == from.len() {
            return if written == to.len() { Ok(()) } else { Err(broken()) };
        }
        let offset = from.get(read..read + 2).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]]))).ok_or_else(broken)?;
        read += 2;
        let copied = length(from, &mut read, token & 15)? + 4;
        if offset == 0 || offset > written || copied > to.len() - written {
            return Err(broken());
        }
        // What is copied may overlap what it is copied from: it repeats.
        for i in written..written + copied {
            to[i] = to[i - offset];
        }
        written += copied;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chunks of c-blosc 1.21 (by python-blosc 1.11), each after its length in four bytes; what is in them is [`plain`].
    const CHUNKS: &[u8] = include_bytes!("../../tests/packed/blosc.bin");

    /// Whole numbers in 32 bits that rise and repeat.
    fn plain(length: usize) -> Vec<u8> {
        let number = |k: usize| (k / 48 * 37 % 1009 + k % 48 / 40) as u32;
        (0..length).map(|i| number(i / 4).to_le_bytes()[i % 4]).collect()
    }

    fn chunks() -> Vec<&'static [u8]> {
        let (mut all, mut left) = (Vec::new(), CHUNKS);
        while let Some((size, rest)) = left.split_first_chunk::<4>() {
            let (chunk, after) = rest.split_at(u32::from_le_bytes(*size) as usize);
            all.push(chunk);
            left = after;
        }
        all
    }

    #[test]
    fn chunks_of_the_reference_library_are_unpacked() {
        let all = chunks();
        assert_eq!(all.len(), 7);
        for chunk in all {
            let length = u32::from_le_bytes([chunk[4], chunk[5], chunk[6], chunk[7]]) as usize;
            let mut out = vec![9];
            match unpack(chunk, length, &mut out) {
                Ok(()) => assert!(out[1..] == plain(length), "{:02x?}", &chunk[..HEAD]),
                // The last is packed by BloscLZ.
                Err(e) => assert!(e.contains("BloscLZ") && chunk[2] >> 5 == 0, "{e}"),
            }
            assert!(unpack(chunk, length - 1, &mut Vec::new()).is_err());
        }
    }

    #[test]
    fn damaged_chunks_are_refused_without_panic() {
        for chunk in chunks() {
            let length = 1 << 18;
            for end in (0..chunk.len()).step_by(7) {
                assert!(unpack(&chunk[..end], length, &mut Vec::new()).is_err());
            }
            for at in 0..chunk.len().min(900) {
                for flip in [1, 0x10, 0x80, 0xff] {
                    let mut bytes = chunk.to_vec();
                    bytes[at] ^= flip;
                    let mut out = Vec::new();
                    let _ = unpack(&bytes, length, &mut out);
                    assert!(out.len() <= length);
                }
            }
        }
    }
}

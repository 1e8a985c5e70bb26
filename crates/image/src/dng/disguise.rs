//! A TIFF whose first directory the `tiff` crate need not understand.
//!
//! That crate decodes what the first directory describes as soon as it opens a file, and fails where it is a mosaic, as in the DNGs of several
//! makers. It is therefore shown a file whose header points to a small grey picture behind the end; directories are then asked for by their place.

use std::io::{Read, Result, Seek, SeekFrom};

/// Bytes of the header: byte order, version, place of the first directory.
const HEADER: u64 = 8;

/// A file with another header and a directory behind its end.
pub struct Disguised<R> {
    inner: R,
    place: u64,
    length: u64,
    header: [u8; HEADER as usize],
    behind: Vec<u8>,
}

impl<R: Read + Seek> Disguised<R> {
    /// Dresses a classic TIFF up; returns it with the place of its real first directory. `None` of anything else. Fails where reading does.
    pub fn new(mut inner: R) -> Result<(Self, Option<u64>)> {
        let length = inner.seek(SeekFrom::End(0))?;
        inner.seek(SeekFrom::Start(0))?;
        let mut header = [0; HEADER as usize];
        let mut told = Vec::new();
        inner.by_ref().take(HEADER).read_to_end(&mut told)?;
        header[..told.len()].copy_from_slice(&told);
        inner.seek(SeekFrom::Start(0))?;
        let mut file = Disguised { inner, place: 0, length, header, behind: Vec::new() };
        let big_endian = match &header[..4] {
            b"II*\0" => false,
            b"MM\0*" => true,
            _ => return Ok((file, None)),
        };
        // Directories lie at even places that four bytes can tell.
        let fake = length.next_multiple_of(2);
        let Ok(at) = u32::try_from(fake) else { return Ok((file, None)) };
        let offset = [header[4], header[5], header[6], header[7]];
        let first = if big_endian { u32::from_be_bytes(offset) } else { u32::from_le_bytes(offset) };
        file.header[4..].copy_from_slice(&if big_endian { at.to_be_bytes() } else { at.to_le_bytes() });
        file.behind = vec![0; (fake - length) as usize];
        file.behind.extend(grey(big_endian));
        Ok((file, Some(u64::from(first))))
    }
}

impl<R> Disguised<R> {
    /// Takes the directory behind the end away again, once it has been seen.
    pub fn restore(&mut self) {
        self.behind.clear();
    }
}

/// A directory of one grey pixel.
fn grey(big_endian: bool) -> Vec<u8> {
    const SHORT: u16 = 3;
    // Width, height, bits, compression, photometric interpretation, strip's place, rows a strip, bytes of the strip.
    let fields = [(256u16, 1u16), (257, 1), (258, 8), (259, 1), (262, 1), (273, 0), (278, 1), (279, 1)];
    let mut bytes = Vec::new();
    let mut put16 = |v: u16| bytes.extend(if big_endian { v.to_be_bytes() } else { v.to_le_bytes() });
    put16(fields.len() as u16);
    for (tag, value) in fields {
        // Count 1 as four bytes, the value in the first two of four.
        let count = if big_endian { [0, 1] } else { [1, 0] };
        [tag, SHORT, count[0], count[1], value, 0].into_iter().for_each(&mut put16);
    }
    [0, 0].into_iter().for_each(&mut put16);
    bytes
}

impl<R: Read + Seek> Read for Disguised<R> {
    fn read(&mut self, to: &mut [u8]) -> Result<usize> {
        if to.is_empty() {
            return Ok(0);
        }
        if self.place >= self.length {
            let from = self.behind.get((self.place - self.length) as usize..).unwrap_or(&[]);
            let n = from.len().min(to.len());
            to[..n].copy_from_slice(&from[..n]);
            self.place += n as u64;
            return Ok(n);
        }
        self.inner.seek(SeekFrom::Start(self.place))?;
        let n = self.inner.read(to)?;
        // The header's bytes among them.
        for (i, byte) in to[..n].iter_mut().enumerate() {
            if let Some(own) = self.header.get((self.place as usize).saturating_add(i)) {
                *byte = *own;
            } else {
                break;
            }
        }
        self.place += n as u64;
        Ok(n)
    }
}

impl<R: Read + Seek> Seek for Disguised<R> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let end = self.length + self.behind.len() as u64;
        let place = match to {
            SeekFrom::Start(n) => Some(n),
            SeekFrom::End(n) => end.checked_add_signed(n),
            SeekFrom::Current(n) => self.place.checked_add_signed(n),
        };
        self.place = place.ok_or(std::io::ErrorKind::InvalidInput)?;
        Ok(self.place)
    }
}

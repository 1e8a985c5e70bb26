//! A TIFF whose first directory the `tiff` crate need not understand.
//!
//! That crate decodes what the first directory describes as soon as it opens a file, and fails where it is a mosaic, as in the DNGs of several
//! makers. It is therefore shown a file whose header points to a small grey picture behind the end; directories are then asked for by their place.

use std::io::{Read, Result, Seek, SeekFrom};

/// Bytes of a header: byte order, version, place of the first directory; of BigTIFF with the size of places before it.
const CLASSIC: usize = 8;
const BIG: usize = 16;

/// A file with another header and a directory behind its end.
pub struct Disguised<R> {
    inner: R,
    place: u64,
    length: u64,
    header: Vec<u8>,
    behind: Vec<u8>,
}

impl<R: Read + Seek> Disguised<R> {
    /// Dresses a TIFF up, a classic or a large one; returns it with the place of its real first directory. `None` of anything else. Fails where reading does.
    pub fn new(mut inner: R) -> Result<(Self, Option<u64>)> {
        let length = inner.seek(SeekFrom::End(0))?;
        inner.seek(SeekFrom::Start(0))?;
        let mut header = Vec::new();
        inner.by_ref().take(BIG as u64).read_to_end(&mut header)?;
        inner.seek(SeekFrom::Start(0))?;
        let layout = match header.get(..4) {
            Some(b"II*\0") => Some((false, CLASSIC)),
            Some(b"MM\0*") => Some((true, CLASSIC)),
            Some(b"II+\0") => Some((false, BIG)),
            Some(b"MM\0+") => Some((true, BIG)),
            _ => None,
        };
        let layout = layout.filter(|(_, bytes)| header.len() >= *bytes);
        let mut file = Disguised { inner, place: 0, length, header, behind: Vec::new() };
        let Some((big_endian, bytes)) = layout else {
            file.header.clear();
            return Ok((file, None));
        };
        file.header.truncate(bytes);
        // Directories lie at even places that the header can tell: in its second half.
        let fake = length.next_multiple_of(2);
        if bytes == CLASSIC && u32::try_from(fake).is_err() {
            return Ok((file, None));
        }
        let told = &mut file.header[bytes / 2..];
        let first = told.iter().enumerate().fold(0, |sum, (k, byte)| {
            let k = if big_endian { told.len() - 1 - k } else { k };
            sum | u64::from(*byte) << (8 * k)
        });
        match big_endian {
            true => told.copy_from_slice(&fake.to_be_bytes()[8 - bytes / 2..]),
            false => told.copy_from_slice(&fake.to_le_bytes()[..bytes / 2]),
        }
        file.behind = vec![0; (fake - length) as usize];
        file.behind.extend(grey(big_endian, bytes == BIG));
        Ok((file, Some(first)))
    }
}

impl<R> Disguised<R> {
    /// Takes the directory behind the end away again, once it has been seen.
    pub fn restore(&mut self) {
        self.behind.clear();
    }
}

/// A directory of one grey pixel.
fn grey(big_endian: bool, large: bool) -> Vec<u8> {
    const SHORT: u64 = 3;
    // Width, height, bits, compression, photometric interpretation, strip's place, rows a strip, bytes of the strip.
    let fields = [(256u64, 1u64), (257, 1), (258, 8), (259, 1), (262, 1), (273, 0), (278, 1), (279, 1)];
    // Of a number of entries, and of a count, a value or a place.
    let (entries, word) = if large { (8, 8) } else { (2, 4) };
    let mut bytes = Vec::new();
    let mut put = |value: u64, size: usize| match big_endian {
        true => bytes.extend(&value.to_be_bytes()[8 - size..]),
        false => bytes.extend(&value.to_le_bytes()[..size]),
    };
    put(fields.len() as u64, entries);
    for (tag, value) in fields {
        put(tag, 2);
        put(SHORT, 2);
        put(1, word);
        // A short value stands in the first two bytes.
        put(value, 2);
        put(0, word - 2);
    }
    put(0, word);
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

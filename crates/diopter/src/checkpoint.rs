//! Exposures under way as files: an exposure that was stopped, or killed, goes on from its last checkpoint, bit for bit as if it never had been.
//!
//! A file is the line `diopter checkpoint 1`, eight little-endian numbers of 64 bits (identity of the exposure, pixels a row, rows, sums a pixel, first
//! sample, end of the finished passes, end of the pass under way, tiles of it), the sums as 64-bit floats `[row][column][band][replicate]`, and a
//! checksum of all numbers. Hashes are FNV-1a (Fowler, Noll & Vo 1991), over 64-bit words with their halves folded.

use crate::expose::Sums;
use crate::row_store::RowStore;
use diopter_image::Raster;
use std::io::{Read, Write};

const TITLE: &[u8] = b"diopter checkpoint 1\n";
/// Numbers that are read or written at once.
const BLOCK: usize = 8192;

/// Why an exposure cannot go on from a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// Another program's file.
    #[error("not a checkpoint of this version of diopter")]
    Unknown,
    /// Of another scene, camera, size or range of samples.
    #[error("it belongs to another exposure: another scene, camera, setting, size or range of samples")]
    Foreign,
    /// Cut short or changed.
    #[error("it is damaged")]
    Damaged,
    /// The system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// A hash of 64 bits that is the same on every machine: FNV-1a over words.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fnv(u64);

impl Fnv {
    /// A hash of nothing yet.
    pub fn new() -> Self {
        Fnv(0xcbf2_9ce4_8422_2325)
    }

    /// Adds a word to the hash.
    pub fn add(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        // Multiplication carries upwards alone: without this the upper bits of a word would never reach the lower ones of the hash.
        self.0 ^= self.0 >> 32;
    }

    /// The hash of all words so far.
    pub fn finish(self) -> u64 {
        self.0
    }
}

/// Writes the sums of the exposure that `identity` stands for. Fails where `to` cannot be written, or rows on disk cannot be read.
pub fn write<S: RowStore>(sums: &Sums<S>, identity: u64, to: &mut impl Write) -> Result<(), CheckpointError> {
    to.write_all(TITLE)?;
    let mut hash = Fnv::new();
    for number in head(sums, identity) {
        hash.add(number);
        to.write_all(&number.to_le_bytes())?;
    }
    let mut bytes = Vec::with_capacity(8 * BLOCK);
    let [width, height, channels] = sums.sums.size();
    let mut numbers = vec![0.0; width * channels];
    for row in 0..height {
        sums.sums.copy_row(row, &mut numbers)?;
        for block in numbers.chunks(BLOCK) {
            bytes.clear();
            for value in block {
                hash.add(value.to_bits());
                bytes.extend(value.to_le_bytes());
            }
            to.write_all(&bytes)?;
        }
    }
    to.write_all(&hash.finish().to_le_bytes())?;
    Ok(())
}

/// Reads the sums of the exposure that `identity` stands for, of a size: pixels a row, rows, bands. No more memory is asked for than that size
/// needs, whatever the file says. Fails as [`read_into`].
pub fn read(from: &mut impl Read, identity: u64, [width, height, bands]: [usize; 3]) -> Result<Sums, CheckpointError> {
    read_into(from, identity, [width, height, bands], |[width, height, numbers]| Ok(Raster::new(width, height, numbers)))
}

/// [`read`], with the sums in rows of zeros that `zeros` makes, of a size: pixels a row, rows, numbers a pixel. Fails on what is no checkpoint
/// ([`CheckpointError::Unknown`]), on one of another exposure or size, on damaged ones, and where reading or `zeros` fails.
pub fn read_into<S: RowStore>(
    from: &mut impl Read,
    identity: u64,
    [width, height, bands]: [usize; 3],
    zeros: impl FnOnce([usize; 3]) -> std::io::Result<S>,
) -> Result<Sums<S>, CheckpointError> {
    let mut title = [0; TITLE.len()];
    // What is too short for a title is none of ours.
    if from.read_exact(&mut title).is_err() || title != TITLE {
        return Err(CheckpointError::Unknown);
    }
    let mut hash = Fnv::new();
    let mut head = [0u64; 8];
    for number in &mut head {
        *number = word(from)?;
        hash.add(*number);
    }
    let [whose, columns, rows, channels, first, end, pass_end, tiles] = head;
    if whose != identity || [columns, rows, channels] != [width, height, 2 * bands].map(|v| v as u64) {
        return Err(CheckpointError::Foreign);
    }
    let sample = |number: u64| u32::try_from(number).map_err(|_| CheckpointError::Damaged);
    let (first, end, pass_end) = (sample(first)?, sample(end)?, sample(pass_end)?);
    let tiles = usize::try_from(tiles).map_err(|_| CheckpointError::Damaged)?;
    let mut sums = zeros([width, height, 2 * bands])?;
    let mut bytes = vec![0; 8 * BLOCK];
    for row in 0..height {
        for block in sums.row_mut(row)?.chunks_mut(BLOCK) {
            let bytes = &mut bytes[..8 * block.len()];
            whole(from.read_exact(bytes))?;
            for (value, bytes) in block.iter_mut().zip(bytes.as_chunks::<8>().0) {
                *value = f64::from_le_bytes(*bytes);
                hash.add(value.to_bits());
            }
        }
    }
    if word(from)? != hash.finish() {
        return Err(CheckpointError::Damaged);
    }
    Ok(Sums { sums, samples: first..end, pass_end, tiles, groups: None })
}

fn head<S: RowStore>(sums: &Sums<S>, identity: u64) -> [u64; 8] {
    let size = sums.sums.size().map(|v| v as u64);
    let samples = [sums.samples.start, sums.samples.end, sums.pass_end].map(u64::from);
    [identity, size[0], size[1], size[2], samples[0], samples[1], samples[2], sums.tiles as u64]
}

fn word(from: &mut impl Read) -> Result<u64, CheckpointError> {
    let mut bytes = [0; 8];
    whole(from.read_exact(&mut bytes))?;
    Ok(u64::from_le_bytes(bytes))
}

/// A file that ends early is damaged, no failure of the system.
fn whole(read: std::io::Result<()>) -> Result<(), CheckpointError> {
    read.map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => CheckpointError::Damaged,
        _ => CheckpointError::Io(e),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums() -> Sums {
        let mut raster = Raster::new(70, 41, 6);
        raster.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i as f64 * 0.37).sin() * 1e9);
        Sums { sums: raster, samples: 16..32, pass_end: 48, tiles: 3, groups: None }
    }

    #[test]
    fn sums_survive_their_file() {
        let mut file = Vec::new();
        write(&sums(), 0x1234_5678_9abc_def0, &mut file).unwrap();
        assert_eq!(read(&mut file.as_slice(), 0x1234_5678_9abc_def0, [70, 41, 3]).unwrap(), sums());
        assert!(matches!(read(&mut file.as_slice(), 7, [70, 41, 3]), Err(CheckpointError::Foreign)));
        assert!(matches!(read(&mut file.as_slice(), 0x1234_5678_9abc_def0, [41, 70, 3]), Err(CheckpointError::Foreign)));
    }

    #[test]
    fn sums_on_the_disk_make_the_same_file() {
        let paged = |size: [usize; 3]| crate::row_store::PagedRows::new(size, 0, &std::env::temp_dir());
        let mut file = Vec::new();
        write(&sums(), 5, &mut file).unwrap();
        let read = read_into(&mut file.as_slice(), 5, [70, 41, 3], paged).unwrap();
        assert_eq!((read.samples.clone(), read.pass_end, read.tiles), (16..32, 48, 3));
        let mut again = Vec::new();
        write(&read, 5, &mut again).unwrap();
        assert_eq!(again, file);
    }

    #[test]
    fn damage_is_seen() {
        let mut file = Vec::new();
        write(&sums(), 1, &mut file).unwrap();
        for length in [0, 5] {
            assert!(matches!(read(&mut &file[..length], 1, [70, 41, 3]), Err(CheckpointError::Unknown)), "{length}");
        }
        for length in [TITLE.len(), TITLE.len() + 60, file.len() / 2, file.len() - 1] {
            assert!(matches!(read(&mut &file[..length], 1, [70, 41, 3]), Err(CheckpointError::Damaged)), "{length}");
        }
        for place in [TITLE.len() + 40, TITLE.len() + 64, file.len() / 2, file.len() - 3] {
            let mut changed = file.clone();
            changed[place] ^= 0x10;
            assert!(matches!(read(&mut changed.as_slice(), 1, [70, 41, 3]), Err(CheckpointError::Damaged)), "{place}");
        }
        assert!(matches!(read(&mut &[0u8; 200][..], 1, [70, 41, 3]), Err(CheckpointError::Unknown)));
    }
}

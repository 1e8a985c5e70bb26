//! Pictures that are kept on the disk: tiles of a temporary file, of which those asked for last stay in memory.
//!
//! A picture is paged when it and those before it would take more than [`RESIDENT`]; what is looked up is the same either way.

use super::{Texel, Texels};
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, TryLockError};

/// Bytes of pictures that are kept in memory whole.
pub const RESIDENT: u64 = 4 << 30;
/// Bytes of tiles that are kept of all others.
const CACHE: usize = 512 << 20;
/// Bytes of a tile: 64 x 64 pixels of codes, 45 x 45 of 16 bits a channel, 32 x 32 of numbers.
const TILE: usize = 64 * 64 * 4;

/// Bytes of pictures in memory.
static HELD: AtomicU64 = AtomicU64::new(0);

/// What a picture in memory counts for; given back when it is dropped.
#[derive(Debug)]
pub(super) struct Held(u64);

impl Held {
    /// `None` when there is no more room below `most`.
    pub(super) fn claim(bytes: u64, most: u64) -> Option<Held> {
        let claimed =
            HELD.try_update(Ordering::Relaxed, Ordering::Relaxed, |held| held.checked_add(bytes).filter(|sum| *sum <= most));
        claimed.is_ok().then(|| Held(bytes))
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        HELD.fetch_sub(self.0, Ordering::Relaxed);
    }
}

/// Tiles that were asked for last: one place for each by its number, so that a new one drives an older one out.
pub(super) struct Cache {
    slots: Vec<Mutex<Option<(u64, Tile)>>>,
}

type Tile = Arc<Vec<u8>>;

impl Cache {
    pub(super) fn new(slots: usize) -> Self {
        Cache { slots: (0..slots.max(1)).map(|_| Mutex::new(None)).collect() }
    }

    /// The one of the program.
    fn shared() -> Arc<Cache> {
        static SHARED: OnceLock<Arc<Cache>> = OnceLock::new();
        SHARED.get_or_init(|| Arc::new(Cache::new(CACHE / TILE))).clone()
    }

    fn get(&self, key: u64, read: impl FnOnce() -> Tile) -> Tile {
        let place =
            diopter_light::random::mix(key as u32 ^ diopter_light::random::mix((key >> 32) as u32)) as usize % self.slots.len();
        // Never waits: whoever finds a place taken reads the tile for itself.
        let claim = || match self.slots[place].try_lock() {
            Ok(slot) => Some(slot),
            Err(TryLockError::Poisoned(e)) => Some(e.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        };
        if let Some((known, tile)) = claim().as_deref().and_then(Option::as_ref)
            && *known == key
        {
            return tile.clone();
        }
        let tile = read();
        if let Some(mut slot) = claim() {
            *slot = Some((key, tile.clone()));
        }
        tile
    }
}

/// A picture on the disk.
pub struct Paged {
    file: Mutex<File>,
    cache: Arc<Cache>,
    /// Tells its tiles from those of others.
    number: u64,
    across: usize,
    /// Bytes of a pixel.
    size: usize,
    /// Whether those of 16 bits a channel are codes.
    are_codes: bool,
    /// Pixels a side of a tile.
    side: usize,
    opaque: bool,
}

impl std::fmt::Debug for Paged {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "Paged({})", self.number)
    }
}

impl Paged {
    /// Puts a picture away. Fails when the disk is full or there is none for temporary files.
    pub(super) fn new(texels: &Texels, width: usize, height: usize, cache: Option<Arc<Cache>>) -> std::io::Result<Self> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let size = match texels {
            Texels::Codes(_) => 4,
            Texels::Codes16(_) | Texels::Wide(_) => 8,
            Texels::Linear(_) => 16,
            Texels::Paged(p) => p.size,
        };
        let side = (TILE / size).isqrt();
        let mut paged = Paged {
            file: Mutex::new(tempfile::tempfile()?),
            cache: cache.unwrap_or_else(Cache::shared),
            number: NEXT.fetch_add(1, Ordering::Relaxed),
            across: width.div_ceil(side),
            size,
            are_codes: matches!(texels, Texels::Codes16(_)),
            side,
            opaque: texels.is_opaque(),
        };
        let mut out = BufWriter::with_capacity(1 << 20, paged.file.get_mut().unwrap_or_else(|e| e.into_inner()));
        for row in (0..height).step_by(side) {
            for column in (0..width).step_by(side) {
                for y in row..row + side {
                    // Tiles at the edge are filled up: all are of one size.
                    let start = y.min(height - 1) * width;
                    for x in column..column + side {
                        let at = start + x.min(width - 1);
                        match texels {
                            Texels::Codes(all) => out.write_all(&all[at])?,
                            Texels::Codes16(all) | Texels::Wide(all) => {
                                all[at].iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?
                            }
                            Texels::Linear(all) => all[at].iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?,
                            Texels::Paged(_) => unreachable!("what is paged stays where it is"),
                        }
                    }
                }
            }
        }
        out.flush()?;
        drop(out);
        Ok(paged)
    }

    pub(super) fn is_opaque(&self) -> bool {
        self.opaque
    }

    /// Whether its pixels are numbers of any size.
    pub(super) fn holds_numbers(&self) -> bool {
        self.size == 16
    }

    /// Bytes of a tile in the file.
    fn tile_bytes(&self) -> usize {
        self.side * self.side * self.size
    }

    fn tile(&self, number: usize) -> Tile {
        self.cache.get(self.number << 32 | number as u64, || {
            let mut bytes = vec![0; self.tile_bytes()];
            let mut file = self.file.lock().unwrap_or_else(|e| e.into_inner());
            let start = (number * bytes.len()) as u64;
            // A disk that fails leaves black: there is no one to tell.
            if file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes)).is_err() {
                bytes.fill(0);
            }
            Arc::new(bytes)
        })
    }

    /// The pixel.
    pub(super) fn texel(&self, column: usize, row: usize) -> Texel {
        let side = self.side;
        let tile = self.tile(row / side * self.across + column / side);
        self.unpacked(&tile, row % side * side + column % side)
    }

    /// The pixels of a row in order, tile by tile; `width`: how many.
    pub(super) fn row(&self, row: usize, width: usize, mut tell: impl FnMut(Texel)) {
        let side = self.side;
        for across in 0..self.across {
            let tile = self.tile(row / side * self.across + across);
            (0..side.min(width - across * side)).for_each(|x| tell(self.unpacked(&tile, row % side * side + x)));
        }
    }

    fn unpacked(&self, tile: &[u8], pixel: usize) -> Texel {
        let bytes = &tile[pixel * self.size..(pixel + 1) * self.size];
        match self.size {
            4 => Texel::Codes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            8 => {
                let words = std::array::from_fn(|c| u16::from_le_bytes([bytes[2 * c], bytes[2 * c + 1]]));
                if self.are_codes { Texel::Codes16(words) } else { Texel::Wide(words) }
            }
            _ => {
                let words = bytes.as_chunks::<4>().0;
                Texel::Linear(std::array::from_fn(|c| words.get(c).map_or(0.0, |w| f32::from_le_bytes(*w))))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Image, Texel};
    use super::*;
    use diopter_light::random::mix;
    use rayon::prelude::*;

    #[test]
    fn what_is_paged_is_what_was_there() {
        // Sizes that are no multiple of a tile, more tiles than the cache holds, asked for in any order by several threads.
        let cache = Arc::new(Cache::new(3));
        let pictures: Vec<(Texels, usize, usize)> = vec![
            (Texels::Codes((0..300 * 130u32).map(|i| mix(i).to_le_bytes()).collect()), 300, 130),
            (Texels::Codes((0..70u32).map(|i| (mix(i) | 0xff00_0000).to_le_bytes()).collect()), 1, 70),
            (Texels::Wide((0..91 * 50u32).map(|i| [mix(i) as u16, 1, 2, i as u16]).collect()), 91, 50),
            (Texels::Codes16((0..91 * 50u32).map(|i| [mix(i) as u16, 1, 2, i as u16]).collect()), 91, 50),
            (Texels::Linear((0..129 * 65u32).map(|i| [i as f32, -1.5, 1e9, 1.0]).collect()), 129, 65),
        ];
        for (texels, width, height) in pictures {
            let paged = Paged::new(&texels, width, height, Some(cache.clone())).unwrap();
            let image = |texels: Texels| Image { width, height, texels, held: None, levels: Default::default() };
            let (there, here) = (image(Texels::Paged(Arc::new(paged))), image(texels));
            assert_eq!(there.has_alpha(), here.has_alpha());
            (0..20_000u32).into_par_iter().for_each(|i| {
                let (x, y) = (mix(i) as usize % width, mix(i ^ 0x5555) as usize % height);
                let same = match (there.texel(x, y), here.texel(x, y)) {
                    (Texel::Codes(a), Texel::Codes(b)) => a == b,
                    (Texel::Wide(a), Texel::Wide(b)) | (Texel::Codes16(a), Texel::Codes16(b)) => a == b,
                    (Texel::Linear(a), Texel::Linear(b)) => a == b,
                    _ => false,
                };
                assert!(same, "{x} {y}");
            });
        }
    }

    #[test]
    fn what_does_not_fit_is_put_away() {
        let picture = |most: u64| Image::new(64, 64, vec![[9, 8, 7, 255]; 64 * 64]).kept_below(most);
        // Other tests hold pictures too: none leaves room, all of it does.
        assert!(matches!(picture(u64::MAX).texels, Texels::Codes(_)));
        let away = picture(0);
        assert!(matches!(away.texels, Texels::Paged(_)) && !away.has_alpha());
        assert!(matches!(away.texel(63, 0), Texel::Codes([9, 8, 7, 255])));
        let held = HELD.load(Ordering::Relaxed);
        drop(Held::claim(1 << 40, u64::MAX));
        assert!(HELD.load(Ordering::Relaxed) < held.max(1) + (1 << 40));
    }
}

//! How much memory a photograph takes, beside the scene: known before anything is metered.

use super::{Shot, ShotError, error};
use crate::expose::bytes_needed;
use crate::memory::{self, Bytes};
use diopter_develop::denoise;
use diopter_image::focal_plane::{STRIP_BYTES, bytes_a_pixel};
use diopter_image::truth::Recorded;

/// What is done with an exposure when it is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExposureUse {
    /// It is read out and developed, by bands of rows.
    ReadOut,
    /// It is written as a focal plane too.
    Plane,
    /// Its truth is written too, all channels at once.
    Truth,
    /// It is written as a focal plane strip by strip, and never in memory as a whole ([`Shot::expose_rows`]).
    Strips,
}

/// Most bytes of the sums of an exposure by strips that are in memory: with these, denoising and writing, 4 GB are enough beside the scene.
const LARGEST_CACHE: u64 = 1 << 30;
/// Fewest of them.
const SMALLEST_CACHE: u64 = 1 << 26;

impl Shot {
    /// Bytes that exposing, denoising and writing take at most.
    pub fn bytes_needed(&self, kept: ExposureUse) -> u64 {
        let of = |(a_pixel, fixed): (u64, u64)| self.pixels() * a_pixel + fixed;
        let counts = self.counts();
        self.ways().into_iter().map(|denoising| of(bytes(&counts, denoising, kept))).min().unwrap_or(0)
    }

    /// The largest picture of this shape that so many bytes are enough for; `None` if they are not enough for any.
    pub fn largest_size(&self, available: u64, kept: ExposureUse) -> Option<[usize; 2]> {
        let size = [self.camera.film.columns, self.camera.film.rows];
        let counts = self.counts();
        let fits = |denoising| largest(size, bytes(&counts, denoising, kept), available);
        self.ways().into_iter().filter_map(fits).max()
    }

    /// Ways to denoise the exposure, of which the one with less memory is taken: at once, or (by the built-in filter) by strips.
    fn ways(&self) -> Vec<Option<Denoising>> {
        match &self.filter {
            None => vec![None],
            Some(filter) => {
                filter.bytes(self.bands()).into_iter().map(|(a_pixel, fixed)| Some(Denoising { a_pixel, fixed })).collect()
            }
        }
    }

    /// Refuses a shot that takes more memory than `allowed`, or, without it, than is free.
    pub fn check_memory(&self, kept: ExposureUse, allowed: Option<Bytes>) -> Result<(), ShotError> {
        let Some(available) = memory::available(allowed) else { return Ok(()) };
        let needed = self.bytes_needed(kept);
        if needed <= available {
            return Ok(());
        }
        let limit = match allowed {
            Some(bytes) => format!("--max-memory allows {bytes}"),
            None => format!("{} are free", Bytes(available)),
        };
        let film = &self.camera.film;
        let fits = match self.largest_size(available, kept) {
            Some([width, height]) => format!("at most {width}x{height}"),
            None => "more memory".into(),
        };
        let found =
            format!("{}x{} in {} bands, whose exposure takes {}; {limit}", film.columns, film.rows, self.bands(), Bytes(needed));
        Err(error::value("size", found, fits))
    }

    /// Bytes of the sums that an exposure by strips may have in memory, when so many are available in all.
    pub fn cache_within(&self, available: u64) -> usize {
        let left = available.saturating_sub(self.bytes_needed(ExposureUse::Strips)) + SMALLEST_CACHE;
        usize::try_from(left.min(LARGEST_CACHE)).unwrap_or(usize::MAX)
    }

    /// What the memory of a pixel depends on.
    fn counts(&self) -> Counts {
        let truth = Recorded::new(&self.settings.truth_channels).more_bytes();
        Counts { bands: self.bands(), summed: self.summed_bands(), truth }
    }

    fn pixels(&self) -> u64 {
        self.camera.film.columns as u64 * self.camera.film.rows as u64
    }
}

/// What a pixel holds.
struct Counts {
    /// Bands of the film.
    bands: usize,
    /// Bands that are summed.
    summed: usize,
    /// Bytes of truth beyond what is always recorded.
    truth: usize,
}

/// What denoising takes: bytes a pixel, the exposure included, and all others.
#[derive(Clone, Copy, Debug)]
struct Denoising {
    a_pixel: usize,
    fixed: usize,
}

/// Bytes a pixel, and all others.
fn bytes(&Counts { bands, summed, truth }: &Counts, denoising: Option<Denoising>, kept: ExposureUse) -> (u64, u64) {
    let (exposing, tiles) = bytes_needed(bands, if kept == ExposureUse::Strips { bands } else { summed });
    let (exposing, plane) = (exposing + truth, bytes_a_pixel(bands) + truth);
    if kept == ExposureUse::Strips {
        // The strip that is written, the one before the filter, and blocks of the file as they are and packed.
        let writing = 4 * STRIP_BYTES as u64;
        let denoising = if denoising.is_some() { denoise::STRIP_MEMORY as u64 } else { 0 };
        return (0, SMALLEST_CACHE + tiles as u64 + writing + denoising);
    }
    // Mosaic, and what the writers keep of a picture.
    let read_out = plane + 2 + 6;
    let written = match kept {
        ExposureUse::ReadOut | ExposureUse::Strips => 0,
        // Written by blocks of rows, without a copy.
        ExposureUse::Plane => plane,
        // The variance, then a copy of it, the mean, the half difference and the truth as channels.
        ExposureUse::Truth => plane + 4 * bands + 3 * 4 * bands + Recorded::default().bytes() + truth,
    };
    // The exposure, what guides the filter and what it makes hold the truth each.
    let (a_pixel, fixed) = denoising.map_or((0, 0), |d| (d.a_pixel + 3 * truth, d.fixed));
    (exposing.max(read_out).max(written).max(a_pixel) as u64, tiles.max(fixed) as u64)
}

fn largest(size: [usize; 2], (a_pixel, fixed): (u64, u64), available: u64) -> Option<[usize; 2]> {
    let fit = available.saturating_sub(fixed) as f64 / a_pixel as f64;
    let scale = (fit / (size[0] as f64 * size[1] as f64)).sqrt();
    let size = size.map(|side| (side as f64 * scale).floor() as usize);
    (size[0] > 0 && size[1] > 0).then_some(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expose::SUMS_WITH_CASCADE;

    #[test]
    fn strips_of_any_picture_fit_into_four_gigabytes() {
        for (bands, denoise) in [(3, false), (3, true), (4, true)] {
            let denoising = denoise.then_some(Denoising { a_pixel: 0, fixed: denoise::STRIP_MEMORY });
            let (a_pixel, fixed) = bytes(&Counts { bands, summed: bands, truth: 100 }, denoising, ExposureUse::Strips);
            // But for the tiles that all threads of a machine work on.
            let most = fixed - bytes_needed(bands, bands).1 as u64 - SMALLEST_CACHE + LARGEST_CACHE;
            assert!(a_pixel == 0 && most < 3_900_000_000, "{bands} {denoise} {most}");
        }
    }

    #[test]
    fn what_is_said_to_fit_does_and_is_hardly_smaller_than_could_be() {
        for (bands, denoise, kept) in
            [(3, false, ExposureUse::ReadOut), (3, true, ExposureUse::Plane), (31, false, ExposureUse::Truth)]
        {
            let denoising = denoise.then(|| Denoising { a_pixel: denoise::bytes_a_pixel(bands), fixed: 0 });
            let counts = Counts { bands, summed: SUMS_WITH_CASCADE * bands, truth: 0 };
            let (a_pixel, fixed) = bytes(&counts, denoising, kept);
            assert!(bytes(&Counts { truth: 40, ..counts }, denoising, kept).0 >= a_pixel + 40);
            assert!(a_pixel >= (8 + 16 * SUMS_WITH_CASCADE) as u64 * bands as u64 + 32);
            assert!(bytes(&Counts { bands, summed: bands, truth: 0 }, denoising, kept).0 < a_pixel);
            let available = fixed + 3_000_000_000;
            let [w, h] = largest([20_000, 15_000], (a_pixel, fixed), available).unwrap();
            let needed = |w: usize, h: usize| (w * h) as u64 * a_pixel + fixed;
            assert!(needed(w, h) <= available && needed(w + 2, h + 2) > available, "{w} {h}");
            assert!((w as f64 / h as f64 - 4.0 / 3.0).abs() < 1e-3);
            assert_eq!(largest([20_000, 15_000], (a_pixel, fixed), fixed), None);
        }
    }
}

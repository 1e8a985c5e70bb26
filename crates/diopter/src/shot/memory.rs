//! How much memory a photograph takes, beside the scene: known before anything is metered.

use super::Shot;
use crate::expose::{TRUTH_BYTES, bytes_needed};

/// What is done with an exposure when it is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// It is read out and developed, by bands of rows.
    ReadOut,
    /// It is written as a focal plane too, all channels at once.
    Plane,
}

impl Shot {
    /// Bytes that exposing, denoising and writing take at most.
    pub fn bytes_needed(&self, kept: Kept) -> u64 {
        let (a_pixel, fixed) = bytes(self.bands(), self.denoise, kept);
        self.pixels() * a_pixel + fixed
    }

    /// The largest picture of this shape that so many bytes are enough for; `None` if they are not enough for any.
    pub fn largest_size(&self, available: u64, kept: Kept) -> Option<[usize; 2]> {
        let size = [self.camera.film.columns, self.camera.film.rows];
        largest(size, bytes(self.bands(), self.denoise, kept), available)
    }

    fn pixels(&self) -> u64 {
        self.camera.film.columns as u64 * self.camera.film.rows as u64
    }
}

/// Bytes a pixel, and all others.
fn bytes(bands: usize, denoise: bool, kept: Kept) -> (u64, u64) {
    let (exposing, tiles) = bytes_needed(bands);
    let plane = 2 * 4 * bands + TRUTH_BYTES;
    // Mosaic, and what the writers keep of a picture.
    let read_out = plane + 2 + 6;
    let written = match kept {
        Kept::ReadOut => 0,
        // The variance, then a copy of it, the mean, the half difference and the truth as channels.
        Kept::Plane => plane + 4 * bands + 3 * 4 * bands + TRUTH_BYTES,
    };
    // The replicates, calm ones, variance and two filtered pairs, a plane at work; seven features, three shares; the new plane.
    let denoising = if denoise { plane + 4 * bands * (2 + 2 + 1 + 4 + 2) + 4 * (7 + 3) + plane } else { 0 };
    (exposing.max(read_out).max(written).max(denoising) as u64, tiles as u64)
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

    #[test]
    fn what_is_said_to_fit_does_and_is_hardly_smaller_than_could_be() {
        for (bands, denoise, kept) in [(3, false, Kept::ReadOut), (3, true, Kept::Plane), (31, false, Kept::Plane)] {
            let (a_pixel, fixed) = bytes(bands, denoise, kept);
            assert!(a_pixel >= 24 * bands as u64 + 32);
            let available = fixed + 3_000_000_000;
            let [w, h] = largest([20_000, 15_000], (a_pixel, fixed), available).unwrap();
            let needed = |w: usize, h: usize| (w * h) as u64 * a_pixel + fixed;
            assert!(needed(w, h) <= available && needed(w + 2, h + 2) > available, "{w} {h}");
            assert!((w as f64 / h as f64 - 4.0 / 3.0).abs() < 1e-3);
            assert_eq!(largest([20_000, 15_000], (a_pixel, fixed), fixed), None);
        }
    }
}

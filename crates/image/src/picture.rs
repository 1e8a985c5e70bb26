//! A developed picture, whole or made row by row when asked.

use crate::{Encoding, ExposureFacts, ImageError, Raster};
use diopter_light::color::RgbSpace;
use rayon::prelude::*;

/// RGB in a named space.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Three channels of codes in `encoding`; 1.0 = white but where light above white can be told.
    pub pixels: Raster<f32>,
    /// Primaries and white.
    pub space: RgbSpace,
    /// Transfer function.
    pub encoding: Encoding,
    /// How it was taken, for EXIF; `None` writes none.
    pub facts: Option<ExposureFacts>,
}

/// A picture that hands out rows, so that none needs to be held whole.
pub trait PictureSource: Sync {
    /// Pixels a row, rows.
    fn size(&self) -> [usize; 2];
    /// Primaries and white.
    fn space(&self) -> RgbSpace;
    /// Transfer function.
    fn encoding(&self) -> Encoding;
    /// How it was taken, for EXIF.
    fn facts(&self) -> Option<&ExposureFacts>;
    /// Encoded values of `count` rows from `first` on, `[row][column][3]`.
    fn rows(&self, first: usize, count: usize) -> Vec<f32>;

    /// Rows that are best asked for at once.
    fn rows_at_once(&self) -> usize {
        64
    }

    /// The whole picture.
    fn whole(&self) -> Picture
    where
        Self: Sized,
    {
        let [width, height] = self.size();
        let band = self.rows_at_once();
        let mut data = vec![0.0; width * height * 3];
        data.par_chunks_mut((width * 3 * band).max(1))
            .enumerate()
            .for_each(|(i, to)| to.copy_from_slice(&self.rows(i * band, to.len() / (3 * width))));
        let pixels = Raster { width, height, channels: 3, data };
        Picture { pixels, space: self.space(), encoding: self.encoding(), facts: self.facts().cloned() }
    }
}

impl PictureSource for Picture {
    fn size(&self) -> [usize; 2] {
        [self.pixels.width, self.pixels.height]
    }
    fn space(&self) -> RgbSpace {
        self.space
    }
    fn encoding(&self) -> Encoding {
        self.encoding
    }
    fn facts(&self) -> Option<&ExposureFacts> {
        self.facts.as_ref()
    }
    fn rows(&self, first: usize, count: usize) -> Vec<f32> {
        let n = self.pixels.width * 3;
        self.pixels.data[first * n..(first + count) * n].to_vec()
    }
}

/// Codes to write.
fn codes(source: &dyn PictureSource, first: usize, count: usize) -> Vec<f32> {
    let mut rows = source.rows(first, count);
    rows.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
    rows
}

/// 8-bit codes of some rows.
pub(crate) fn rows_8_bit(source: &dyn PictureSource, first: usize, count: usize) -> Vec<u8> {
    codes(source, first, count).into_iter().map(|c| (c * 255.0 + 0.5) as u8).collect()
}

/// 16-bit codes of some rows.
pub(crate) fn rows_16_bit(source: &dyn PictureSource, first: usize, count: usize) -> Vec<u16> {
    codes(source, first, count).into_iter().map(|c| (c * 65_535.0 + 0.5) as u16).collect()
}

/// Makes bands of rows in parallel, a few at a time, and hands them over in order.
pub(crate) fn in_bands<T: Send>(
    height: usize,
    band: usize,
    make: impl Fn(usize, usize) -> Result<T, ImageError> + Sync,
    mut take: impl FnMut(T) -> Result<(), ImageError>,
) -> Result<(), ImageError> {
    let starts: Vec<usize> = (0..height).step_by(band.max(1)).collect();
    // Enough in flight that threads seldom wait for the slowest; few enough that memory stays small.
    for group in starts.chunks(4 * rayon::current_num_threads()) {
        let made: Vec<Result<T, ImageError>> =
            group.par_iter().with_max_len(1).map(|first| make(*first, band.min(height - first))).collect();
        made.into_iter().try_for_each(|part| take(part?))?;
    }
    Ok(())
}

impl Picture {
    /// 8-bit codes, `[row][column][3]`.
    pub fn to_8_bit(&self) -> Vec<u8> {
        rows_8_bit(self, 0, self.pixels.height)
    }

    /// 16-bit codes, `[row][column][3]`.
    pub fn to_16_bit(&self) -> Vec<u16> {
        rows_16_bit(self, 0, self.pixels.height)
    }
}

//! A rectangle of pixels with equal numbers of channels.

use crate::ImageError;

/// Values `[row][column][channel]`, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<T> {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values a pixel.
    pub channels: usize,
    /// `width * height * channels` values.
    pub data: Vec<T>,
}

impl<T: Copy + Default> Raster<T> {
    /// A raster of default values.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Raster { width, height, channels, data: vec![T::default(); width * height * channels] }
    }

    /// The values of a pixel. Both numbers must lie inside: a place behind the last pixel panics, a column beyond its row does not.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> &[T] {
        let start = (row * self.width + column) * self.channels;
        &self.data[start..start + self.channels]
    }

    /// The values of a pixel, to change. As [`Raster::pixel`].
    #[inline]
    pub fn pixel_mut(&mut self, column: usize, row: usize) -> &mut [T] {
        let start = (row * self.width + column) * self.channels;
        &mut self.data[start..start + self.channels]
    }

    /// One channel of every pixel, row by row.
    pub fn channel(&self, channel: usize) -> Vec<T> {
        self.data.iter().skip(channel).step_by(self.channels).copied().collect()
    }

    /// Some of its rows. Panics on rows that it does not have.
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Self {
        let stride = self.width * self.channels;
        let data = self.data[rows.start * stride..rows.end * stride].to_vec();
        Raster { width: self.width, height: rows.len(), channels: self.channels, data }
    }

    /// A smaller raster, of the pixel in the middle of each block of `factor` × `factor` (0: as 1); blocks at the right and lower edge may be cut off.
    pub fn thinned(&self, factor: usize) -> Self {
        let factor = factor.max(1);
        let [width, height] = [self.width, self.height].map(|n| n.div_ceil(factor));
        let mut data = Vec::with_capacity(width * height * self.channels);
        for row in 0..height {
            for column in 0..width {
                let [x, y] = [(column, self.width), (row, self.height)].map(|(i, n)| (i * factor + factor / 2).min(n - 1));
                data.extend_from_slice(self.pixel(x, y));
            }
        }
        Raster { width, height, channels: self.channels, data }
    }

    /// Adds the rows of a raster below its own. Fails, and adds nothing, on another width or number of channels.
    pub fn append(&mut self, below: &Self) -> Result<(), ImageError> {
        self.check_below(below)?;
        self.data.extend_from_slice(&below.data);
        self.height += below.height;
        Ok(())
    }

    /// Fails where the rows of another raster do not fit below its own.
    pub(crate) fn check_below(&self, below: &Self) -> Result<(), ImageError> {
        if (self.width, self.channels) != (below.width, below.channels) {
            let rows = |r: &Self| format!("rows of {} pixels with {} channels", r.width, r.channels);
            return Err(ImageError::Mismatch(format!("{} below {}", rows(below), rows(self))));
        }
        Ok(())
    }
}

impl Raster<f32> {
    /// A smaller raster, of the means over blocks of `factor` × `factor` pixels (0: as 1); blocks at the right and lower edge may be cut off.
    pub fn reduced(&self, factor: usize) -> Self {
        let (n, channels) = (factor.max(1), self.channels);
        let mut to = Raster::new(self.width.div_ceil(n), self.height.div_ceil(n), channels);
        let mut sums = vec![0f32; to.width * channels];
        let blocks = self.data.chunks(n * self.width * channels).zip(to.data.chunks_mut(sums.len().max(1)));
        for (rows, means) in blocks {
            sums.fill(0.0);
            for row in rows.chunks(self.width * channels) {
                for (block, sum) in row.chunks(n * channels).zip(sums.chunks_mut(channels)) {
                    block.chunks(channels).for_each(|pixel| sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += v));
                }
            }
            let down = rows.len() / (self.width * channels);
            for (column, (mean, sum)) in means.chunks_mut(channels).zip(sums.chunks(channels)).enumerate() {
                let across = n.min(self.width - column * n);
                mean.iter_mut().zip(sum).for_each(|(m, s)| *m = s / (across * down) as f32);
            }
        }
        to
    }

    /// Fewer pixels: means of those whose middles lie in each of so many equal parts of it. Whole pixels alone: edges stay as sharp as they are. Parts without any are 0.
    pub fn gathered(&self, [columns, rows]: [usize; 2]) -> Self {
        let mut to = Raster::new(columns, rows, self.channels);
        let mut counts = vec![0.0f32; columns * rows];
        let part = |k: usize, from: usize, parts: usize| (2 * k + 1) * parts / (2 * from);
        for row in 0..self.height {
            for column in 0..self.width {
                let (x, y) = (part(column, self.width, columns), part(row, self.height, rows));
                to.pixel_mut(x, y).iter_mut().zip(self.pixel(column, row)).for_each(|(sum, v)| *sum += v);
                counts[y * columns + x] += 1.0;
            }
        }
        for (pixel, count) in to.data.chunks_mut(self.channels.max(1)).zip(counts) {
            pixel.iter_mut().for_each(|sum| *sum /= count.max(1.0));
        }
        to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_rasters_hold_means_or_middle_pixels_of_their_blocks() {
        let whole = Raster { width: 5, height: 3, channels: 2, data: (0..30).map(|i| i as f32).collect() };
        let means = whole.reduced(2);
        assert_eq!((means.width, means.height), (3, 2));
        // First channel of the first block: 0, 2, 10, 12; the last is one pixel.
        assert_eq!(means.data, [6.0, 7.0, 10.0, 11.0, 13.0, 14.0, 21.0, 22.0, 25.0, 26.0, 28.0, 29.0]);
        assert_eq!(whole.reduced(1), whole);
        assert_eq!(whole.thinned(2).data, [12.0, 13.0, 16.0, 17.0, 18.0, 19.0, 22.0, 23.0, 26.0, 27.0, 28.0, 29.0]);
        assert_eq!(whole.thinned(1), whole);
    }

    #[test]
    fn gathered_pixels_are_whole_ones_of_the_part_they_lie_in() {
        let whole = Raster { width: 3, height: 2, channels: 1, data: vec![1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0] };
        assert_eq!(whole.gathered([3, 2]), whole);
        // The middle column lies in the right half.
        assert_eq!(whole.gathered([2, 1]).data, [2.5, 4.0]);
        assert_eq!(whole.gathered([1, 1]).data, [3.5]);
    }
}

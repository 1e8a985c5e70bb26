//! A rectangle of pixels with equal numbers of channels.

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

    /// The values of a pixel.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> &[T] {
        let start = (row * self.width + column) * self.channels;
        &self.data[start..start + self.channels]
    }

    /// The values of a pixel, to change.
    #[inline]
    pub fn pixel_mut(&mut self, column: usize, row: usize) -> &mut [T] {
        let start = (row * self.width + column) * self.channels;
        &mut self.data[start..start + self.channels]
    }

    /// One channel of every pixel, row by row.
    pub fn channel(&self, channel: usize) -> Vec<T> {
        self.data.iter().skip(channel).step_by(self.channels).copied().collect()
    }
}

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

    /// Some of its rows.
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Self {
        let stride = self.width * self.channels;
        let data = self.data[rows.start * stride..rows.end * stride].to_vec();
        Raster { width: self.width, height: rows.len(), channels: self.channels, data }
    }

    /// Puts the rows of a raster of the same width and channels below its own.
    pub fn append(&mut self, below: &Self) {
        assert_eq!((self.width, self.channels), (below.width, below.channels), "rows of another raster");
        self.data.extend_from_slice(&below.data);
        self.height += below.height;
    }
}

//! The picture in small, straight from the mosaic: what steps look at that need all of it.

use diopter_image::RawImage;
use rayon::prelude::*;

/// Cells along the longer side.
const CELLS: usize = 480;

/// Fraction of saturation above which a pixel says little.
pub const SATURATED: f32 = 0.98;

/// One cell: the mean of each channel, of saturation, unbalanced.
pub struct Cell<'a> {
    /// Mean of each channel.
    pub signal: &'a [f32],
    /// Whether any pixel in it is saturated.
    pub saturated: bool,
}

/// Means of the channels over cells.
#[derive(Clone, Debug)]
pub struct Overview {
    /// Cells a row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// Numbers of the mosaic a cell is wide, and rows it is high.
    pub side: [usize; 2],
    pixels: [usize; 2],
    channels: usize,
    /// `[row][column][channel]`.
    signal: Vec<f32>,
    saturated: Vec<bool>,
}

impl Overview {
    /// Averages a mosaic.
    pub fn new(raw: &RawImage) -> Overview {
        let cfa = &raw.header.cfa;
        let (w, h, n) = (raw.mosaic.width, raw.mosaic.height, cfa.channel_count());
        // Whole patterns, so that every cell sees all channels; square in pixels.
        let samples = cfa.samples_per_pixel();
        let pattern = (cfa.columns() / samples).max(cfa.rows());
        let pixels = (w / samples).max(h).div_ceil(CELLS).next_multiple_of(pattern);
        let (side, rows_of_cell) = (pixels * samples, pixels);
        let (width, height) = (w.div_ceil(side), h.div_ceil(rows_of_cell));
        let scale = 1.0 / (raw.header.white_level - raw.header.black_level);
        let full = raw.header.black_level + f64::from(SATURATED) * (raw.header.white_level - raw.header.black_level);
        let rows: Vec<(Vec<f32>, Vec<bool>)> = (0..height)
            .into_par_iter()
            .map(|row| {
                let mut sums = vec![(0u64, 0u64); width * n];
                let mut saturated = vec![false; width];
                for y in row * rows_of_cell..((row + 1) * rows_of_cell).min(h) {
                    let line = &raw.mosaic.data[y * w..(y + 1) * w];
                    let channels: Vec<usize> = (0..cfa.columns()).map(|x| cfa.channel_at(x, y)).collect();
                    for (cell, part) in line.chunks(side).enumerate() {
                        for (k, dn) in part.iter().enumerate() {
                            let (sum, count) = &mut sums[cell * n + channels[k % channels.len()]];
                            *sum += u64::from(*dn);
                            *count += 1;
                        }
                        saturated[cell] |= part.iter().any(|dn| f64::from(*dn) >= full);
                    }
                }
                let mean = |(sum, count): &(u64, u64)| match count {
                    0 => 0.0,
                    _ => ((*sum as f64 / *count as f64 - raw.header.black_level) * scale) as f32,
                };
                (sums.iter().map(mean).collect(), saturated)
            })
            .collect();
        let (signal, saturated): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        Overview {
            width,
            height,
            side: [side, rows_of_cell],
            pixels: [w, h],
            channels: n,
            signal: signal.concat(),
            saturated: saturated.concat(),
        }
    }

    /// Numbers a row of the mosaic (pixels × samples), and rows.
    pub fn size(&self) -> [usize; 2] {
        self.pixels
    }

    /// All cells, row by row.
    pub fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        self.signal.chunks(self.channels).zip(&self.saturated).map(|(signal, s)| Cell { signal, saturated: *s })
    }

    /// Mean of the cells in a part of the picture: left, top, width, height as fractions. At least one cell. Of each channel, as
    /// fractions of saturation; saturated cells are left out, and all is 0 where no other is there.
    pub fn mean(&self, [left, top, width, height]: [f64; 4]) -> Vec<f64> {
        // The cells that lie inside; at least the one in the middle.
        let range = |from: f64, length: f64, n: usize, axis: usize| {
            let cell = |fraction: f64| fraction * self.pixels[axis] as f64 / self.side[axis] as f64;
            let (first, end) = ((cell(from) - 1e-6).ceil() as usize, (cell(from + length) + 1e-6) as usize);
            let middle = (cell(from + 0.5 * length) as usize).min(n - 1);
            if first < end.min(n) { first..end.min(n) } else { middle..middle + 1 }
        };
        let mut sums = vec![0.0; self.channels];
        let mut count = 0.0;
        for y in range(top, height, self.height, 1) {
            for x in range(left, width, self.width, 0) {
                let i = y * self.width + x;
                if !self.saturated[i] {
                    let cell = &self.signal[i * self.channels..][..self.channels];
                    sums.iter_mut().zip(cell).for_each(|(s, v)| *s += f64::from(*v));
                    count += 1.0;
                }
            }
        }
        sums.iter().map(|s| s / f64::max(count, 1.0)).collect()
    }
}

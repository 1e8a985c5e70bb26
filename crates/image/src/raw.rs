//! What the sensor hands out: one number a pixel, and what it takes to make colours of them.

use crate::{ExposureFacts, Raster};

/// A colour filter array: a rectangle of channel numbers (0 R, 1 G, 2 B) repeated over the sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cfa {
    /// Columns of the repeated pattern.
    pub columns: usize,
    /// Channel of each cell, row by row.
    pub channels: Vec<u8>,
}

impl Cfa {
    /// One channel everywhere.
    pub fn monochrome() -> Self {
        Cfa { columns: 1, channels: vec![0] }
    }

    /// A pattern from letters, rows parted by `/`: `RG/GB`. `None` when rows are uneven or a letter is not R, G or B.
    pub fn from_letters(pattern: &str) -> Option<Self> {
        let rows: Vec<&str> = pattern.split('/').collect();
        let columns = rows[0].len();
        let channels: Option<Vec<u8>> = pattern.chars().filter(|c| *c != '/').map(|c| "RGB".find(c).map(|i| i as u8)).collect();
        (columns > 0 && rows.iter().all(|r| r.len() == columns)).then_some(())?;
        Some(Cfa { columns, channels: channels? })
    }

    /// Channel of a pixel.
    #[inline]
    pub fn channel_at(&self, column: usize, row: usize) -> usize {
        let rows = self.channels.len() / self.columns;
        self.channels[(row % rows) * self.columns + column % self.columns] as usize
    }

    /// Channels the pattern uses: 1 for monochrome, else 3.
    pub fn channel_count(&self) -> usize {
        if self.channels.iter().all(|c| *c == 0) { 1 } else { 3 }
    }
}

/// A raw photograph, in digital numbers (DN).
#[derive(Clone, Debug, PartialEq)]
pub struct RawImage {
    /// DN of each pixel.
    pub mosaic: Raster<u16>,
    /// Which channel each pixel saw.
    pub cfa: Cfa,
    /// DN of no light.
    pub black_level: f64,
    /// DN at which pixels are saturated.
    pub white_level: f64,
    /// Camera RGB of a neutral surface in the light of the shot, largest component 1.
    pub as_shot_neutral: [f64; 3],
    /// Camera RGB from XYZ (rows), as DNG's ColorMatrix.
    pub camera_from_xyz: [[f64; 3]; 3],
    /// XYZ under D50 from white-balanced camera RGB (rows), as DNG's ForwardMatrix.
    pub xyz_d50_from_balanced: [[f64; 3]; 3],
    /// How it was made.
    pub facts: ExposureFacts,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bayer_letters_name_the_four_pixels() {
        let cfa = Cfa::from_letters("GB/RG").unwrap();
        assert_eq!([(0, 0), (1, 0), (0, 1), (3, 3)].map(|(c, r)| cfa.channel_at(c, r)), [1, 2, 0, 1]);
        assert_eq!(Cfa::from_letters("RG/G"), None);
        assert_eq!(Cfa::from_letters("RX/GB"), None);
    }
}

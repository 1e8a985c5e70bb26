//! Sums of the samples of a tile.

use super::MARGIN;
use super::sums::Tile;
use crate::camera::Film;
use std::collections::BTreeMap;

/// Sums of a tile, with a margin where wavelengths land in other pixels, and of single pixels farther away that they reach.
pub(super) struct TileSums {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
    /// Pixels a row of the whole film.
    columns: usize,
    bands: usize,
    /// `[row][column][band][half]`
    sums: Vec<[f64; 2]>,
    /// Whether they are on top of those of all samples before.
    whole: bool,
    /// Pixel number → `[band][half]`.
    outside: BTreeMap<usize, Vec<[f64; 2]>>,
}

impl TileSums {
    /// Sums of a tile (column, row, width, height) of a film; `bands` are summed. `before`: sums that its samples are added to one by one; none where they are
    /// summed apart.
    pub fn new(film: &Film, [column, row, width, height]: [usize; 4], bands: usize, before: Vec<f64>) -> TileSums {
        let whole = !before.is_empty();
        let margin = if whole { 0 } else { MARGIN };
        let (left, top) = (column.saturating_sub(margin), row.saturating_sub(margin));
        let (right, bottom) = ((column + width + margin).min(film.columns), (row + height + margin).min(film.rows));
        let sums = match whole {
            true => before.chunks_exact(2).map(|halves| [halves[0], halves[1]]).collect(),
            false => vec![[0.0; 2]; (right - left) * (bottom - top) * bands],
        };
        TileSums { left, top, right, bottom, columns: film.columns, bands, sums, whole, outside: BTreeMap::new() }
    }

    /// All of them.
    pub fn done(self) -> Tile {
        let sums = self.sums.into_flattened();
        let (column, row, width) = (self.left, self.top, self.right - self.left);
        Tile { column, row, width, sums, whole: self.whole, outside: self.outside }
    }

    /// The sums of a pixel of the film.
    #[inline]
    pub fn pixel(&mut self, x: usize, y: usize) -> &mut [[f64; 2]] {
        let bands = self.bands;
        if (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y) {
            let start = ((y - self.top) * (self.right - self.left) + x - self.left) * bands;
            &mut self.sums[start..start + bands]
        } else {
            self.outside.entry(y * self.columns + x).or_insert_with(|| vec![[0.0; 2]; bands])
        }
    }
}

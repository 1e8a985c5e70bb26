//! A read-out on its way into a DNG: rows go through, and a few of them stay for the preview.

use diopter_develop::{Recipe, develop};
use diopter_image::dng::{self, Rows, Storage};
use diopter_image::{ImageError, Picture, Raster, RawHeader, RawImage};
use std::io::{Seek, Write};

/// Longest side of a preview, pixels, about.
const PREVIEW: usize = 1024;

/// Cells of the filter pattern, every so many, of a mosaic whose rows go by: a small raw image of the same kind.
struct Thinned {
    size: [usize; 2],
    /// Cells of the pattern of which one is kept, across and down.
    every: usize,
    kept: RawImage,
}

impl Thinned {
    fn new(header: &RawHeader, size: [usize; 2]) -> Self {
        let (columns, rows) = (header.cfa.columns(), header.cfa.rows());
        let every = (size[0].max(size[1])).div_ceil(PREVIEW).max(1);
        // Whole cells; a picture smaller than that is kept as it is.
        let side = |n: usize, cell: usize| (n / (cell * every) * cell).max(n.min(cell));
        let mosaic = Raster::new(side(size[0], columns), side(size[1], rows), 1);
        Thinned { size, every, kept: RawImage { mosaic, header: header.clone() } }
    }

    fn add(&mut self, first: usize, band: &[u16]) {
        let width = self.size[0];
        let (columns, rows) = (self.kept.header.cfa.columns(), self.kept.header.cfa.rows());
        for (i, line) in band.chunks(width).enumerate() {
            let (cell, inside) = ((first + i) / rows, (first + i) % rows);
            let row = cell / self.every * rows + inside;
            if cell % self.every != 0 || row >= self.kept.mosaic.height {
                continue;
            }
            for column in 0..self.kept.mosaic.width {
                let from = column / columns * columns * self.every + column % columns;
                self.kept.mosaic.pixel_mut(column, row)[0] = line[from.min(width - 1)];
            }
        }
    }
}

/// Writes a DNG of rows that are asked for in turn. The preview is developed by the recipe, from a part of the pixels. Fails on a size that DNG cannot hold, and where
/// `rows` or writing fails.
pub fn write(
    header: &RawHeader,
    size: [usize; 2],
    storage: Storage,
    rows: &mut Rows,
    recipe: &Recipe,
    to: impl Write + Seek,
) -> Result<(), ImageError> {
    let thinned = std::cell::RefCell::new(Thinned::new(header, size));
    let mut through = |first: usize, band: &mut [u16]| {
        rows(first, band)?;
        thinned.borrow_mut().add(first, band);
        Ok(())
    };
    let preview = || -> Option<Picture> { develop(&thinned.borrow().kept, recipe, None).ok() };
    dng::write(header, size, storage, &mut through, preview, to)
}

/// Writes a raw image as DNG, with a preview. Fails as [`write()`].
pub fn write_image(raw: &RawImage, storage: Storage, recipe: &Recipe, to: impl Write + Seek) -> Result<(), ImageError> {
    let size = [raw.mosaic.width, raw.mosaic.height];
    write(&raw.header, size, storage, &mut dng::rows_of(&raw.mosaic), recipe, to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::{Cfa, ExposureFacts};

    #[test]
    fn a_thinned_mosaic_keeps_its_pattern() {
        let header = RawHeader {
            cfa: Cfa::parse("x-trans").unwrap(),
            bits: 12,
            black_level: 0.0,
            white_level: 4095.0,
            baseline_ev: 0.0,
            framing: Default::default(),
            opcodes: vec![],
            warnings: vec![],
            as_shot_neutral: vec![1.0; 3],
            calibrations: vec![],
            noise: vec![],
            facts: ExposureFacts::default(),
        };
        for size in [[3000, 2000], [7, 5], [1, 1], [1030, 40]] {
            let mut thinned = Thinned::new(&header, size);
            // Each pixel says which channel it is.
            let rows: Vec<u16> = (0..size[0] * size[1]).map(|i| header.cfa.channel_at(i % size[0], i / size[0]) as u16).collect();
            for (k, band) in rows.chunks(size[0] * 16).enumerate() {
                thinned.add(16 * k, band);
            }
            let small = &thinned.kept.mosaic;
            assert!(small.width <= 1024 && small.height <= 1024 && small.width * small.height > 0, "{size:?}");
            for row in 0..small.height {
                for column in 0..small.width {
                    assert_eq!(small.pixel(column, row)[0] as usize, header.cfa.channel_at(column, row), "{size:?}");
                }
            }
        }
    }
}

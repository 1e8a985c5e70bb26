//! Offsets of single rows, as slow amplifiers leave them: what a row lies above its neighbours, in the dark pixels where it can be told.
//!
//! A row's offset is the median, over its pixels, of the difference to the mean of the same colour above and below; a picture's own edges touch
//! few columns alike and fall out of the median.

use crate::setting::section;
use diopter_image::RawImage;
use rayon::prelude::*;

section! {
    /// Offsets of rows.
    RowNoise "row_noise" {
        amount: f64 = 0.0, "", Number(0.0, 1.0),
            "fraction of a row's offset from its neighbours that is taken away; off: it can take fine level lines for noise";
    }
}

/// Rounds in which the offsets of neighbours are parted.
const ROUNDS: usize = 8;
/// How much of the neighbours' offsets is believed in a round.
const DAMPING: f32 = 0.9;

/// Offset of each row, DN, to be taken away. `amount`: the fraction of it, 0 to 1. Empty where the amount is 0 or the picture has too few rows.
pub fn offsets(raw: &RawImage, amount: f64) -> Vec<f32> {
    let (w, h) = (raw.mosaic.width, raw.mosaic.height);
    let period = raw.header.cfa.rows().max(if raw.header.cfa.is_monochrome() { 1 } else { 2 });
    if amount == 0.0 || h < 4 * period {
        return Vec::new();
    }
    // Every row against several others of the same phase: one neighbour's own offset counts little.
    let reach: Vec<i64> = [-2i64, -1, 1, 2].iter().map(|k| k * period as i64).collect();
    let of_row = |y: usize| {
        let line = &raw.mosaic.data[y * w..(y + 1) * w];
        let others: Vec<&[u16]> = reach
            .iter()
            .map(|d| y as i64 + d)
            .filter(|r| (0..h as i64).contains(r))
            .map(|r| &raw.mosaic.data[r as usize * w..(r as usize + 1) * w])
            .collect();
        let mut differences: Vec<f32> = (0..w)
            .map(|x| f32::from(line[x]) - others.iter().map(|o| f32::from(o[x])).sum::<f32>() / others.len() as f32)
            .collect();
        // The mean of the middle tenth: a median finer than whole numbers.
        differences.sort_unstable_by(f32::total_cmp);
        let middle = &differences[w * 9 / 20..(w * 11 / 20).max(w * 9 / 20 + 1)];
        middle.iter().sum::<f32>() / middle.len() as f32
    };
    let told: Vec<f32> = (0..h).into_par_iter().map(of_row).collect();
    // The neighbours have offsets of their own: a few rounds part them. What is slower than some rows stays: it may be the picture.
    let mut offsets = told.clone();
    for _ in 0..ROUNDS {
        let of_neighbours = |y: usize| {
            let (sum, n) = reach
                .iter()
                .map(|d| y as i64 + d)
                .filter(|r| (0..h as i64).contains(r))
                .fold((0.0, 0.0), |(s, n), r| (s + offsets[r as usize], n + 1.0));
            sum / n
        };
        offsets = (0..h).map(|y| told[y] + DAMPING * of_neighbours(y)).collect();
    }
    offsets.iter().map(|o| amount as f32 * o).collect()
}

#[cfg(test)]
mod tests {
    use crate::tests::raw;

    #[test]
    fn offsets_of_rows_are_found_and_pictures_are_left() {
        let offset = |y: usize| ((y * 37 % 11) as f64 - 5.0) * 2.0;
        let scene = |x: usize, y: usize| 300.0 + 100.0 * ((x as f64) / 9.0).sin() + if y > 60 && x < 150 { 800.0 } else { 0.0 };
        let image = raw(400, 120, "RG/GB", |x, y| scene(x, y) + offset(y) + ((x * 7919 + y * 104_729) % 13) as f64);
        let found = super::offsets(&image, 1.0);
        let (mut before, mut after) = (0.0, 0.0);
        for y in 10..110 {
            before += offset(y).powi(2);
            after += (offset(y) - f64::from(found[y])).powi(2);
        }
        assert!(after < 0.35 * before, "{after} of {before}");
        assert!(super::offsets(&image, 0.0).is_empty());
    }
}

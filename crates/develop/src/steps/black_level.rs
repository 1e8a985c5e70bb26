//! Digital numbers to the fraction of saturation, (DN − black) / (white − black), times the gain of each channel. Negative noise stays.

use crate::region::{Region, inside};
use diopter_image::RawImage;

/// A part of the mosaic. `gains`: factor of each channel; `rows`: DN to be taken off each row besides, may be empty. Beyond the edges the mosaic is continued in phase.
/// The result is `[row][column]` of `region`.
pub fn take(raw: &RawImage, region: Region, gains: &[f32], rows: &[f32]) -> Vec<f32> {
    let cfa = &raw.header.cfa;
    let (width, height) = (raw.mosaic.width, raw.mosaic.height);
    let scale = 1.0 / (raw.header.white_level - raw.header.black_level);
    let black = raw.header.black_level as f32;
    let columns: Vec<usize> = (region.left..region.right()).map(|x| inside(x, width, cfa.columns())).collect();
    // A row of gains for each row of the pattern.
    let factors: Vec<Vec<f32>> = (0..cfa.rows())
        .map(|y| columns.iter().map(|x| (f64::from(gains[cfa.channel_at(*x, y)]) * scale) as f32).collect())
        .collect();
    let whole = region.left >= 0 && region.right() <= width as i64;
    let mut to = vec![0.0; region.area()];
    for (k, line) in to.chunks_exact_mut(region.width).enumerate() {
        let y = inside(region.top + k as i64, height, cfa.rows());
        let from = &raw.mosaic.data[y * width..(y + 1) * width];
        let factors = &factors[y % cfa.rows()];
        let black = black + rows.get(y).copied().unwrap_or(0.0);
        if whole {
            let from = &from[region.left as usize..][..region.width];
            line.iter_mut().zip(from).zip(factors).for_each(|((v, dn), f)| *v = (f32::from(*dn) - black) * f);
        } else {
            line.iter_mut().zip(&columns).zip(factors).for_each(|((v, x), f)| *v = (f32::from(from[*x]) - black) * f);
        }
    }
    to
}

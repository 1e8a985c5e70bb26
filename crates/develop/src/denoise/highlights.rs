//! Small things of extreme brightness: lamps of a few pixels, their mirror images, glints.
//!
//! A patch of 49 pixels hardly differs from another by one of them whose own noise is large, so that neighbours a window away would take part of its light:
//! of a lamp 10⁵ times as bright as the wall a square of light. Such pixels are taken out before the filter and put back after it as they are.

use super::Planes;
use rayon::prelude::*;

/// How far highlights are looked for around, px: more than the half of what lies so far around one is not of it.
const AROUND: usize = 6;
/// Rows around a row that its highlights depend on.
pub const REACH: usize = AROUND;
/// Both halves stand out of what lies around by this factor at least. What is fainter leaks by less than noise: neighbours that differ so much count by 10⁻³ and less.
const STANDS_OUT: f32 = 50.0;

/// Removes highlights from both halves, `[half][band][pixel]`, of `w` pixels a row: each gets the median of what lies around. Returns where they were, by rising index.
pub fn remove(halves: &mut [Planes; 2], w: usize) -> Vec<usize> {
    let size = halves[0][0].len();
    let h = size / w;
    // Of all bands, in both halves: rare paths of one half alone are none.
    let sum = |half: &Planes, i: usize| half.iter().map(|band| band[i]).sum::<f32>();
    let [a, b]: [Vec<f32>; 2] = [0, 1].map(|k| (0..size).map(|i| sum(&halves[k], i)).collect());
    let around = |i: usize| {
        let (x, y) = (i % w, i / w);
        let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(w);
        (y.saturating_sub(AROUND)..(y + AROUND + 1).min(h)).flat_map(move |y| columns.clone().map(move |x| y * w + x))
    };
    // Of a few neighbours one is below the median, as a rule: most pixels are done with after them.
    let may_stand_out = |i: usize, least: f32| {
        let (x, y) = (i % w, i / w);
        let near = |at: usize, n: usize| [at.saturating_sub(AROUND), at, (at + AROUND).min(n - 1)];
        near(y, h).into_iter().flat_map(|y| near(x, w).map(|x| y * w + x)).any(|j| a[j].max(b[j]) * STANDS_OUT < least)
    };
    let found: Vec<(usize, Vec<[f32; 2]>)> = (0..size)
        .into_par_iter()
        .filter_map(|i| {
            let least = a[i].min(b[i]);
            if !(least > 0.0 && may_stand_out(i, least)) {
                return None;
            }
            let levels = around(i).map(|j| a[j].max(b[j]));
            if median(levels.collect()) * STANDS_OUT >= least {
                return None;
            }
            let band = |n: usize| [0, 1].map(|k: usize| median(around(i).map(|j| halves[k][n][j]).collect()));
            Some((i, (0..halves[0].len()).map(band).collect()))
        })
        .collect();
    for (i, medians) in &found {
        for (n, both) in medians.iter().enumerate() {
            (0..2).for_each(|k| halves[k][n][*i] = both[k]);
        }
    }
    found.into_iter().map(|(i, _)| i).collect()
}

/// The upper one of the two in the middle of an even number.
fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

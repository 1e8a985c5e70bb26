//! Light that a filter took away, given back nearby.
//!
//! What is filtered is biased where weights meet edges, where single bright pixels are held down and where fits below zero are cut. What is missing in
//! the neighbourhood of a pixel p, e(p) = before(p) - after(p), goes to the pixels q around it by the kernel K and in proportion to what they have:
//!
//! after'(q) = after(q) (1 + Σ_p K(p, q) e(p) / m(p)),   m(p) = Σ_q K(p, q) after(q).
//!
//! Summed over q the second term is Σ_p e(p) m(p) / m(p): the whole picture has just the light it had before, whatever K ≥ 0 is, as long as no m(p) is
//! 0 and no factor is limited. A kernel as wide as this one averages the noise of e away: of n pixels that K covers, 1/n of its variance comes back.

use rayon::prelude::*;

/// Pixels that the forward and the backward sum cover each, a power of two: their product is a triangle of half this width.
const STEPS: u32 = 5;
const SIDE: usize = 1 << STEPS;
/// Rows around a row that its result depends on: the kernel is applied twice.
pub const REACH: usize = 2 * (SIDE - 1);
/// How much a place may be brightened: what a rare path of great weight carries is spread over so many pixels that hardly any place needs more.
const MOST: f32 = 2.0;

/// Factors that give `after` the light of `before`, near the places where it was. All are `[row][column]`, `width` pixels a row; factors are 0 to 2.
pub fn factors(before: &[f32], after: &[f32], width: usize) -> Vec<f32> {
    let around = smoothed(after, width);
    let missing: Vec<f32> = before
        .iter()
        .zip(after)
        .zip(&around)
        // Where all is dark nothing can be scaled.
        .map(|((b, a), m)| if *m > f32::MIN_POSITIVE { (b - a) / m } else { 0.0 })
        .collect();
    let mut factors = smoothed(&missing, width);
    factors.iter_mut().for_each(|f| *f = (1.0 + *f).clamp(0.0, MOST));
    factors
}

/// Sums over triangles; beyond the edges there is nothing. The kernel is symmetric there too: first Bᵀ, then B.
fn smoothed(plane: &[f32], width: usize) -> Vec<f32> {
    let height = plane.len() / width;
    let mut out = plane.to_vec();
    out.par_chunks_mut(width).for_each(|line| {
        let mut padded = vec![0.0; width + SIDE];
        padded[..width].copy_from_slice(line);
        doubled(&mut padded, 1);
        line.copy_from_slice(&padded[..width]);
        padded[..SIDE].fill(0.0);
        padded[SIDE..].copy_from_slice(line);
        // The same sum from the other side.
        padded.reverse();
        doubled(&mut padded, 1);
        (0..width).for_each(|x| line[x] = padded[width - 1 - x]);
    });
    // Down the columns, a band of them at a time.
    const COLUMNS: usize = 64;
    let bands: Vec<(usize, Vec<f32>)> = (0..width.div_ceil(COLUMNS))
        .into_par_iter()
        .map(|band| {
            let (x, columns) = (band * COLUMNS, COLUMNS.min(width - band * COLUMNS));
            let mut padded = vec![0.0; (height + SIDE) * columns];
            for (to, from) in padded.chunks_exact_mut(columns).zip(out.chunks_exact(width)) {
                to.copy_from_slice(&from[x..x + columns]);
            }
            doubled(&mut padded, columns);
            // Rows in reverse order for the other side.
            let mut back = vec![0.0; padded.len()];
            for y in 0..height {
                back[(height - 1 - y) * columns..][..columns].copy_from_slice(&padded[y * columns..][..columns]);
            }
            doubled(&mut back, columns);
            back.truncate(height * columns);
            (columns, back)
        })
        .collect();
    let mut x = 0;
    for (columns, band) in bands {
        for (y, from) in band.chunks_exact(columns).enumerate() {
            out[(height - 1 - y) * width + x..][..columns].copy_from_slice(from);
        }
        x += columns;
    }
    out
}

/// Sums of [`SIDE`] numbers, `stride` apart, from each on; the last of them are cut off. Every sum adds in the same order wherever it lies.
fn doubled(values: &mut [f32], stride: usize) {
    for step in 0..STEPS {
        let far = stride << step;
        for i in 0..values.len().saturating_sub(far) {
            values[i] += values[i + far];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_of_the_whole_is_kept() {
        // Bright lamps, a dark part, and a filter that took a tenth here and everything above 5 there.
        let (w, h) = (90, 70);
        let before: Vec<f32> = (0..w * h)
            .map(|i| if i % 997 == 0 { 40.0 } else { 1.0 + (i % w) as f32 / 30.0 } * f32::from(u8::from(i % w < 80)))
            .collect();
        let after: Vec<f32> = before.iter().enumerate().map(|(i, b)| b.min(5.0) * if i / w < 30 { 0.9 } else { 1.0 }).collect();
        let kept: Vec<f32> = factors(&before, &after, w).iter().zip(&after).map(|(f, a)| f * a).collect();
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        assert!(sum(&after) / sum(&before) < 0.97);
        // Only rounding: sums of a thousand numbers in single precision.
        assert!((sum(&kept) / sum(&before) - 1.0).abs() < 1e-5, "{}", sum(&kept) / sum(&before));
        assert!(kept.iter().zip(&after).all(|(k, a)| (*a > 0.0) == (*k > 0.0)));
    }

    #[test]
    fn a_point_becomes_a_pyramid() {
        let (w, h) = (101, 97);
        let mut point = vec![0.0; w * h];
        point[48 * w + 50] = 1.0;
        let out = smoothed(&point, w);
        for (dx, dy) in [(0i64, 0i64), (3, 0), (0, -7), (-20, 11), (31, 31), (32, 0)] {
            let triangle = |d: i64| (SIDE as i64 - d.abs()).max(0) as f32;
            assert_eq!(out[((48 + dy) * w as i64 + 50 + dx) as usize], triangle(dx) * triangle(dy), "{dx} {dy}");
        }
        // Symmetric also where the border cuts it: what a corner gives to a pixel is what that pixel gives to the corner.
        let from = |i: usize| {
            let mut point = vec![0.0; w * h];
            point[i] = 1.0;
            smoothed(&point, w)
        };
        assert_eq!(from(0)[5 * w + 9], from(5 * w + 9)[0]);
    }
}

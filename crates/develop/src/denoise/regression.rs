//! Nonlinearly weighted first-order regression: around each pixel the other pixels of a window are fitted by a plane over the features, weighted by
//! how much patches of the *guide* resemble each other. Source: Bitterli et al. 2016, "Nonlinearly weighted first-order regression for denoising
//! Monte Carlo renderings" (CGF 35), §3; distance of patches: Rousselle et al. 2012, "Adaptive rendering with non-local means filtering" (TOG 31), eq. 3.
//!
//! The normal equations of a line of [`LINE`] pixels stay in the first cache while all offsets of the window are added, sixteen pixels a step, in
//! copies for the instruction sets of processors; sums and products are rounded each by itself, so the bits are the same. Two places where this
//! differs from the sources: the window is dense near its centre and a checkerboard farther out, and exp(-d) is (1 - d/16)¹⁶, which ends at d = 16
//! and needs no exponential. Every pixel is computed by itself from its window, in one order: results depend neither on threads nor on where tiles
//! begin.

use super::{FEATURES, Planes};
use diopter_light::instruction_set;
use fearless_simd::{Simd, dispatch, f32x16, prelude::*};
use rayon::prelude::*;
use std::array::from_fn;
use std::sync::atomic::{AtomicBool, Ordering};

/// Neighbours up to this far away count at most, px.
pub const WINDOW: i64 = 8;
/// Up to here all of them do, farther out every other one, px.
const DENSE: i64 = 3;
/// Half the side of the patches that are compared, px.
const PATCH: usize = 3;
/// Rows or columns around a pixel that its result depends on.
pub const REACH: usize = WINDOW as usize + PATCH;
/// Square of the wider width of the weights, in deviations that patches differ. Of 0.5, 0.7, 1 and 1.5 the one with the least error on the still life and
/// the Cornell box at 32 samples.
const WIDTH_SQUARED: f32 = 0.7;
/// Ridge of the regression, of the sum of weights: features that hardly change say nothing.
const RIDGE: f64 = 1e-5;
/// Unknowns: the value itself and a slope a feature.
const TERMS: usize = FEATURES + 1;
/// Entries of the upper triangle of the normal equations.
const PAIRS: usize = TERMS * (TERMS + 1) / 2;
/// Pixels that are computed together: all sums of a line of three bands take 15 KB.
const LINE: usize = 32;
/// Pixels of one step.
const LANES: usize = 16;
/// Pixels whose equations are solved together.
const SOLVED: usize = 8;
/// Rows of a tile, whose weights are computed together.
const ROWS: usize = 16;
/// Columns and rows of a tile with what it depends on.
const PADDED: [usize; 2] = [LINE + 2 * REACH, ROWS + 2 * REACH];
/// Columns and rows for which differences of pixels are needed: the tile and the patches at its edge.
const INNER: [usize; 2] = [LINE + 2 * PATCH, ROWS + 2 * PATCH];

type Line = [f32; LINE];
type Solved = [f64; SOLVED];

/// Widths of the weights: the second is half as wide, its weights are the fourth power of those of the first.
pub const WIDTHS: usize = 2;

/// One exposure filtered by each width, `[width][band][pixel]`: weights come from `guide` alone, another exposure of the same noise. `variance` is
/// that of either, positive; all of them `[band][pixel]` and finite. Neighbours up to `window` px away count, [`WINDOW`] at most. `None` once `cancel` is set, which is looked at before each tile.
pub fn filter(
    half: &Planes,
    guide: &Planes,
    variance: &Planes,
    features: &Planes,
    size: [usize; 2],
    window: i64,
    cancel: &AtomicBool,
) -> Option<[Planes; WIDTHS]> {
    let [w, h] = size;
    let n = half.len();
    let offsets = offsets(window.min(WINDOW));
    let corners: Vec<[usize; 2]> =
        (0..h.div_ceil(ROWS)).flat_map(|y| (0..w.div_ceil(LINE)).map(move |x| [x * LINE, y * ROWS])).collect();
    let of_tile = |corner: &[usize; 2]| {
        if cancel.load(Ordering::Relaxed) {
            return None;
        }
        let pad = |planes: &Planes| planes.iter().map(|p| padded(p, size, *corner)).collect::<Vec<_>>();
        let tile = Tile { half: pad(half), guide: pad(guide), variance: pad(variance), features: pad(features) };
        Some(dispatch!(instruction_set::widest(), simd => tile.filtered(simd, &offsets, size, *corner)))
    };
    let tiles: Option<Vec<Vec<Line>>> = corners.par_iter().map(of_tile).collect();
    let tiles = tiles?;
    let mut out: [Planes; WIDTHS] = from_fn(|_| vec![vec![0.0; w * h]; n]);
    for ([x, y], lines) in corners.into_iter().zip(tiles) {
        let (columns, rows) = (LINE.min(w - x), ROWS.min(h - y));
        for row in 0..rows {
            for (k, planes) in out.iter_mut().enumerate() {
                for (b, plane) in planes.iter_mut().enumerate() {
                    plane[(y + row) * w + x..][..columns].copy_from_slice(&lines[(row * WIDTHS + k) * n + b][..columns]);
                }
            }
        }
    }
    Some(out)
}

/// Neighbours of the window, the pixel itself among them.
fn offsets(window: i64) -> Vec<[i64; 2]> {
    let all = (-window..=window).flat_map(|dy| (-window..=window).map(move |dx| [dx, dy]));
    all.filter(|[dx, dy]| (dx.abs() <= DENSE && dy.abs() <= DENSE) || (dx + dy) % 2 == 0).collect()
}

/// A plane around a tile, its edges repeated.
fn padded(plane: &[f32], [w, h]: [usize; 2], [x, y]: [usize; 2]) -> Vec<f32> {
    let mut to = Vec::with_capacity(PADDED[0] * PADDED[1]);
    let inside = |i: usize, n: usize| i.saturating_sub(REACH).min(n - 1);
    for row in y..y + PADDED[1] {
        let line = &plane[inside(row, h) * w..][..w];
        match x.checked_sub(REACH).and_then(|left| line.get(left..left + PADDED[0])) {
            Some(whole) => to.extend_from_slice(whole),
            None => to.extend((x..x + PADDED[0]).map(|column| line[inside(column, w)])),
        }
    }
    to
}

/// Padded planes of a tile.
struct Tile {
    half: Vec<Vec<f32>>,
    guide: Vec<Vec<f32>>,
    variance: Vec<Vec<f32>>,
    features: Vec<Vec<f32>>,
}

/// Normal equations of a line of pixels: upper triangle, then the right side of each band.
struct Sums {
    pairs: [Line; PAIRS],
    right: Vec<[Line; TERMS]>,
}

// Functions, not closures: what is not inlined would be compiled without the instructions of the lanes.
#[inline(always)]
fn lanes<S: Simd>(simd: S, from: &[f32]) -> f32x16<S> {
    f32x16::from_slice(simd, &from[..LANES])
}

#[inline(always)]
fn add_lanes<S: Simd>(simd: S, sum: &mut [f32], product: f32x16<S>) {
    (f32x16::from_slice(simd, sum) + product).store_slice(sum);
}

impl Sums {
    #[inline(always)]
    fn new(bands: usize) -> Self {
        Sums { pairs: [[0.0; LINE]; PAIRS], right: vec![[[0.0; LINE]; TERMS]; bands] }
    }

    /// Adds a neighbour of [`LANES`] pixels from `start` on: its weight, how its features differ, and its values.
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, start: usize, weight: f32x16<S>, steps: &[f32x16<S>; FEATURES], values: &[f32x16<S>]) {
        let mut weighted = [weight; TERMS];
        for (weighted, step) in weighted[1..].iter_mut().zip(steps) {
            *weighted = weight * *step;
        }
        let mut entry = 0;
        for i in 0..TERMS {
            // The first term is the constant.
            for j in i..TERMS {
                let product = if j == 0 { weight } else { weighted[i] * steps[j - 1] };
                add_lanes(simd, &mut self.pairs[entry][start..start + LANES], product);
                entry += 1;
            }
        }
        for (right, values) in self.right.iter_mut().zip(values) {
            for (sum, weighted) in right.iter_mut().zip(&weighted) {
                add_lanes(simd, &mut sum[start..start + LANES], *weighted * *values);
            }
        }
    }

    /// Adds the values of each band at the pixels themselves.
    #[inline(always)]
    fn solve(&self, out: &mut Vec<Line>) {
        let first_band = out.len();
        out.extend((0..self.right.len()).map(|_| [0.0; LINE]));
        for start in (0..LINE).step_by(SOLVED) {
            let at = |line: &Line| -> Solved { from_fn(|x| f64::from(line[start + x])) };
            let mut matrix = [[[0.0; SOLVED]; TERMS]; TERMS];
            let mut entry = 0;
            for r in 0..TERMS {
                for c in r..TERMS {
                    // The lower triangle is enough.
                    matrix[c][r] = at(&self.pairs[entry]);
                    entry += 1;
                }
            }
            let total = matrix[0][0];
            (1..TERMS).for_each(|k| matrix[k][k] = from_fn(|x| matrix[k][k][x] + RIDGE * total[x]));
            let first = first_row_of_inverse(&matrix);
            for (to, right) in out[first_band..].iter_mut().zip(&self.right) {
                let mut value = [0.0; SOLVED];
                for (first, right) in first.iter().zip(right) {
                    let right = at(right);
                    (0..SOLVED).for_each(|x| value[x] += first[x] * right[x]);
                }
                (0..SOLVED).for_each(|x| to[start + x] = value[x] as f32);
            }
        }
    }
}

impl Tile {
    /// Lines of the tile, `[row][width][band]`.
    #[inline(always)]
    fn filtered<S: Simd>(&self, simd: S, offsets: &[[i64; 2]], size: [usize; 2], corner: [usize; 2]) -> Vec<Line> {
        let weights = self.weights(offsets, size, corner);
        let n = self.half.len();
        let mut out = Vec::with_capacity(ROWS * WIDTHS * n);
        let mut values = vec![f32x16::splat(simd, 0.0); n];
        for row in 0..ROWS {
            let mut sums: [Sums; WIDTHS] = from_fn(|_| Sums::new(n));
            let here = (row + REACH) * PADDED[0] + REACH;
            for ([dx, dy], weights) in offsets.iter().zip(weights.chunks_exact(ROWS)) {
                let wide = &weights[row];
                if wide.iter().all(|w| *w == 0.0) {
                    continue;
                }
                let there = (here as i64 + dy * PADDED[0] as i64 + dx) as usize;
                for start in (0..LINE).step_by(LANES) {
                    let (here, there) = (here + start, there + start);
                    let mut steps = [f32x16::splat(simd, 0.0); FEATURES];
                    for (step, plane) in steps.iter_mut().zip(&self.features) {
                        *step = lanes(simd, &plane[there..]) - lanes(simd, &plane[here..]);
                    }
                    for (value, plane) in values.iter_mut().zip(&self.half) {
                        *value = lanes(simd, &plane[there..]);
                    }
                    let wide = lanes(simd, &wide[start..]);
                    let narrow = wide * wide * (wide * wide);
                    sums[0].add(simd, start, wide, &steps, &values);
                    sums[1].add(simd, start, narrow, &steps, &values);
                }
            }
            sums.iter().for_each(|sums| sums.solve(&mut out));
        }
        out
    }

    /// Weights of the wider kind, `[offset][row]`; 0 for neighbours outside the picture.
    #[inline(always)]
    fn weights(&self, offsets: &[[i64; 2]], [w, h]: [usize; 2], [left, top]: [usize; 2]) -> Vec<Line> {
        let side = 2 * PATCH + 1;
        let scale = 1.0 / (16.0 * WIDTH_SQUARED * (side * side * self.guide.len()) as f32);
        let mut out = Vec::with_capacity(offsets.len() * ROWS);
        let mut distance = vec![[0.0f32; INNER[0]]; INNER[1]];
        for [dx, dy] in offsets {
            let shift = dy * PADDED[0] as i64 + dx;
            distance.fill([0.0; INNER[0]]);
            for (u, v) in self.guide.iter().zip(&self.variance) {
                for (row, to) in distance.iter_mut().enumerate() {
                    let here = (row + REACH - PATCH) * PADDED[0] + REACH - PATCH;
                    let there = (here as i64 + shift) as usize;
                    let (u0, u1) = (&u[here..][..INNER[0]], &u[there..][..INNER[0]]);
                    let (v0, v1) = (&v[here..][..INNER[0]], &v[there..][..INNER[0]]);
                    for x in 0..INNER[0] {
                        let d = u0[x] - u1[x];
                        to[x] += (d * d - (v0[x] + v0[x].min(v1[x]))) / (v0[x] + v1[x]);
                    }
                }
            }
            for row in 0..ROWS {
                let y = (top + row) as i64 + dy;
                if y < 0 || y >= h as i64 {
                    out.push([0.0; LINE]);
                    continue;
                }
                // Sums over patches.
                let mut columns = [0.0f32; INNER[0]];
                for patch_row in &distance[row..row + side] {
                    (0..INNER[0]).for_each(|x| columns[x] += patch_row[x]);
                }
                let mut weight: Line = [0.0; LINE];
                for k in 0..side {
                    (0..LINE).for_each(|x| weight[x] += columns[x + k]);
                }
                for (x, weight) in weight.iter_mut().enumerate() {
                    let t = 1.0 - (*weight * scale).clamp(0.0, 1.0);
                    let (t2, outside) = (t * t, left as i64 + x as i64 + dx);
                    let t8 = t2 * t2 * (t2 * t2);
                    *weight = if outside >= 0 && outside < w as i64 { t8 * t8 } else { 0.0 };
                }
                out.push(weight);
            }
        }
        out
    }
}

/// First row of the inverse of symmetric positive matrices, of which the lower triangles are given: what makes the value at the pixel of the sums (Cholesky).
#[inline(always)]
fn first_row_of_inverse(m: &[[Solved; TERMS]; TERMS]) -> [Solved; TERMS] {
    let mut l = [[[0.0; SOLVED]; TERMS]; TERMS];
    // Of the diagonal the inverse is kept.
    for i in 0..TERMS {
        for j in 0..=i {
            let mut s = [0.0; SOLVED];
            for k in 0..j {
                (0..SOLVED).for_each(|x| s[x] += l[i][k][x] * l[j][k][x]);
            }
            let left: Solved = from_fn(|x| m[i][j][x] - s[x]);
            l[i][j] = if i == j { left.map(|d| 1.0 / d.max(1e-30).sqrt()) } else { from_fn(|x| left[x] * l[j][j][x]) };
        }
    }
    // L y = e₀, then Lᵀ x = y.
    let mut y = [[0.0; SOLVED]; TERMS];
    for i in 0..TERMS {
        let mut s = [0.0; SOLVED];
        for k in 0..i {
            (0..SOLVED).for_each(|x| s[x] += l[i][k][x] * y[k][x]);
        }
        y[i] = from_fn(|x| (f64::from(u8::from(i == 0)) - s[x]) * l[i][i][x]);
    }
    for i in (0..TERMS).rev() {
        let mut s = [0.0; SOLVED];
        for k in i + 1..TERMS {
            (0..SOLVED).for_each(|x| s[x] += l[k][i][x] * y[k][x]);
        }
        y[i] = from_fn(|x| (y[i][x] - s[x]) * l[i][i][x]);
    }
    y
}

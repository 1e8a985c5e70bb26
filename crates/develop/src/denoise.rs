//! The renderer's own noise, taken out of an exposure: weighted first-order regression on normals, albedo and depth.
//!
//! Each half of the samples is regressed with weights that come from the other half alone, so that noise cannot choose its own neighbours; of two
//! widths of the weights each place takes the one whose error, seen by the other half, is smaller. The sensor's noise is not touched: it is made
//! later. Sources: Bitterli et al. 2016, "Nonlinearly weighted first-order regression for denoising Monte Carlo renderings" (CGF 35); Rousselle,
//! Knaus & Zwicker 2012, "Adaptive rendering with non-local means filtering" (TOG 31), for the distance of patches.

use crate::region::Region;
use diopter_image::focal_plane::{Band, FocalPlaneSource, STRIP_STEP, rows_within};
use diopter_image::{ExposureFacts, FocalPlane, ImageError};
use rayon::prelude::*;

/// Neighbours up to this far away count, px.
const WINDOW: i64 = 8;
/// Half the side of the patches that are compared, px.
const PATCH: usize = 3;
/// Widths of the weights: how many deviations patches may differ.
const WIDTHS: [f32; 2] = [0.5, 1.0];
/// Keeps the distance of noise-free patches finite, of the square of the mean.
const LEAST_VARIANCE: f32 = 1e-6;
/// Ridge of the regression, of the sum of weights: features that hardly change say nothing.
const RIDGE: f32 = 1e-5;
/// Features: normal, albedo, log of depth.
const FEATURES: usize = 7;
/// Unknowns: the value itself and a slope a feature.
const TERMS: usize = FEATURES + 1;
/// How far a single pixel may stand out of its neighbours and the other half. Smaller values darken what is really fine and bright.
const SPARK: f32 = 2.0;
/// Pixels a side of a tile.
const TILE: usize = 64;

/// Rows around a row that its result depends on: fractions of the candidates are means over neighbours 1 px away, of choices by errors that are means
/// over 2 px; the filter reaches by its window and half a patch; the variance that it takes is a mean over 2 px of what was divided by a mean over 1 px
/// of calm halves, for which single pixels were compared with their neighbours.
const REACH: usize = 1 + 2 + (WINDOW as usize + PATCH) + 2 + 1 + 1;
/// Bytes that denoising a strip takes at most: a few hundred rows of the widest pictures, so that little is computed twice.
pub const STRIP_MEMORY: usize = 3 << 29;

/// An exposure without most of its Monte Carlo noise. Its mean is biased a little, and its half difference says less than the
/// truth about the error that is left; `facts.denoised` tells.
pub fn denoise(plane: &FocalPlane) -> FocalPlane {
    denoise_rows(plane, farthest_log_depth_of(&plane.truth.depth.data))
}

/// Bytes of a pixel that denoising takes: the replicates, calm ones, variance and two filtered pairs, a plane at work; seven features, three fractions
/// and errors; the old plane and the new one.
pub fn bytes_a_pixel(bands: usize) -> usize {
    let plane = diopter_image::focal_plane::bytes_a_pixel(bands);
    4 * bands * (2 + 2 + 1 + 4 + 2) + 4 * (FEATURES + 3 + 3) + 2 * plane
}

/// Rows that [`Denoised`] computes at once, for pictures of so many pixels a row and bands.
pub fn rows_at_once(width: usize, bands: usize) -> usize {
    let around = 2 * REACH * width.saturating_mul(bytes_a_pixel(bands));
    rows_within(STRIP_MEMORY.saturating_sub(around), width, bytes_a_pixel(bands))
}

/// Log of the largest finite depth (m) of an exposure that is read strip by strip; `None` if nothing is hit.
pub fn farthest_log_depth(source: &mut impl FocalPlaneSource) -> Result<Option<f32>, ImageError> {
    let ([_, height], rows) = (source.size(), source.rows_at_once());
    let mut farthest: Option<f32> = None;
    for first in (0..height).step_by(rows) {
        let strip = source.next_rows(rows.min(height - first))?;
        farthest = farthest.into_iter().chain(farthest_log_depth_of(&strip.truth.depth.data)).reduce(f32::max);
    }
    Ok(farthest)
}

/// An exposure without most of its Monte Carlo noise, strip by strip: what [`denoise`] makes of the whole, in bounded memory.
pub struct Denoised<S> {
    source: S,
    farthest: Option<f32>,
    facts: ExposureFacts,
    /// Rows that were read and are still needed.
    rows: Option<FocalPlane>,
    /// The first of them.
    first: usize,
    /// Rows that were taken.
    next: usize,
    /// Rows that are computed at once.
    at_once: usize,
}

impl<S: FocalPlaneSource> Denoised<S> {
    /// `farthest`: [`farthest_log_depth`] of the same exposure. It is not asked for when all rows are computed at once ([`rows_at_once`]).
    pub fn new(source: S, farthest: Option<f32>) -> Self {
        let at_once = rows_at_once(source.size()[0], source.bands().len());
        Self::by_rows(source, farthest, at_once)
    }

    fn by_rows(source: S, farthest: Option<f32>, at_once: usize) -> Self {
        let facts = ExposureFacts { denoised: true, ..source.facts().clone() };
        Denoised { source, farthest, facts, rows: None, first: 0, next: 0, at_once }
    }
}

impl<S: FocalPlaneSource> FocalPlaneSource for Denoised<S> {
    fn bands(&self) -> &[Band] {
        self.source.bands()
    }

    fn facts(&self) -> &ExposureFacts {
        &self.facts
    }

    fn size(&self) -> [usize; 2] {
        self.source.size()
    }

    fn rows_at_once(&self) -> usize {
        self.at_once.max(STRIP_STEP)
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let [_, height] = self.size();
        let (from, to) = (self.next, self.next + rows);
        // Read what the strip depends on.
        let read = self.first + self.rows.as_ref().map_or(0, FocalPlane::height);
        let below = self.source.next_rows((to + REACH).min(height).max(to) - read)?;
        let kept = match self.rows.take() {
            Some(mut kept) => {
                kept.append(&below);
                kept
            }
            None => below,
        };
        // A picture that is computed at once knows its farthest depth.
        let farthest = if kept.height() == height { farthest_log_depth_of(&kept.truth.depth.data) } else { self.farthest };
        let mut strip = denoise_rows(&kept, farthest).rows(from - self.first..to - self.first);
        strip.facts = self.facts.clone();
        // Keep what the next one depends on.
        let first = to.saturating_sub(REACH).max(self.first);
        let next = kept.rows(first - self.first..kept.height());
        (self.rows, self.first, self.next) = (Some(next), first, to);
        Ok(strip)
    }
}

/// All or some rows of an exposure; `farthest` is the log of the largest depth of all of it.
fn denoise_rows(plane: &FocalPlane, farthest: Option<f32>) -> FocalPlane {
    let (w, h, n) = (plane.width(), plane.height(), plane.bands.len());
    if w * h == 0 || n == 0 {
        return plane.clone();
    }
    let half = |sign: f32| -> Vec<Vec<f32>> {
        let band = |b: usize| {
            let (mean, difference) = (plane.mean.channel(b), plane.half_difference.channel(b));
            mean.iter().zip(&difference).map(|(m, d)| m + sign * d).collect()
        };
        (0..n).map(band).collect()
    };
    let halves = [half(1.0), half(-1.0)];
    let calm = without_sparks(&halves, w);
    let features = features(plane, farthest);
    // Variance of one half: twice that of the mean, over some neighbours, since a pixel's own has one degree of freedom.
    let variance: Vec<Vec<f32>> = (0..n)
        .map(|b| {
            // Relative to the square of the mean, so that a lamp's variance does not spread over the wall beside it.
            let both: Vec<f32> = calm[0][b].iter().zip(&calm[1][b]).map(|(a, b)| 0.5 * (a + b)).collect();
            let level: Vec<f32> = blurred(&both, w, 1).iter().map(|m| m * m).collect();
            let own: Vec<f32> =
                (0..w * h).map(|i| 0.5 * (calm[0][b][i] - calm[1][b][i]).powi(2) / (level[i] + f32::MIN_POSITIVE)).collect();
            let around: Vec<f32> = blurred(&own, w, 2).iter().zip(&level).map(|(v, l)| v * l).collect();
            let floor: Vec<f32> = (0..w * h).map(|i| LEAST_VARIANCE * (calm[0][b][i] + calm[1][b][i]).powi(2)).collect();
            around.iter().zip(floor).map(|(v, f)| v + f + f32::MIN_POSITIVE).collect()
        })
        .collect();
    // [width][half][band]
    let filtered: Vec<[Vec<Vec<f32>>; 2]> =
        WIDTHS.iter().map(|width| [0, 1].map(|k| filter(&calm[k], &calm[1 - k], &variance, &features, [w, h], *width))).collect();
    let choice = choose(&filtered, &calm, &variance, w);
    let mut out = plane.clone();
    out.facts.denoised = true;
    for b in 0..n {
        for i in 0..w * h {
            let [a, c] = [0, 1].map(|k| {
                let shares = choice[i];
                shares[0] * calm[k][b][i] + shares[1] * filtered[0][k][b][i] + shares[2] * filtered[1][k][b][i]
            });
            // Light is never negative; a fit may be.
            let mean = (0.5 * (a + c)).max(0.0);
            out.mean.data[i * n + b] = if mean.is_finite() { mean } else { plane.mean.data[i * n + b] };
            let difference = 0.5 * (a - c);
            out.half_difference.data[i * n + b] = if difference.is_finite() { difference } else { 0.0 };
        }
    }
    out
}

/// Single pixels that stand far out of their neighbours in one half and not in the other are brought down towards the brightest neighbour:
/// rare paths of great weight, which no number of neighbours averages out.
fn without_sparks(halves: &[Vec<Vec<f32>>; 2], w: usize) -> [Vec<Vec<f32>>; 2] {
    let h = halves[0][0].len() / w;
    [0, 1].map(|k| {
        let bands = halves[k].iter().zip(&halves[1 - k]);
        bands
            .map(|(own, other)| {
                let mut calm = own.clone();
                calm.par_chunks_mut(w).enumerate().for_each(|(y, line)| {
                    for (x, v) in line.iter_mut().enumerate() {
                        let (mut high, mut second) = (0.0f32, 0.0f32);
                        for ny in y.saturating_sub(1)..(y + 2).min(h) {
                            for nx in x.saturating_sub(1)..(x + 2).min(w) {
                                let i = ny * w + nx;
                                // Of the other half the pixel itself may be asked too.
                                let near = if (nx, ny) == (x, y) { other[i] } else { own[i].max(other[i]) };
                                if near > high {
                                    second = high;
                                    high = near;
                                } else if near > second {
                                    second = near;
                                }
                            }
                        }
                        *v = v.min(SPARK * second.max(other[y * w + x]));
                    }
                });
                calm
            })
            .collect()
    })
}

/// Log of a depth; not a number where nothing is hit.
fn log_depth(depth: f32) -> f32 {
    if depth.is_finite() { depth.max(1e-6).ln() } else { f32::NAN }
}

/// Log of the largest finite depth, m; `None` if there is none.
pub fn farthest_log_depth_of(depth: &[f32]) -> Option<f32> {
    depth.iter().map(|d| log_depth(*d)).filter(|d| d.is_finite()).reduce(f32::max)
}

/// What the scene is like at each pixel, in units of about one.
fn features(plane: &FocalPlane, farthest: Option<f32>) -> Vec<Vec<f32>> {
    let t = &plane.truth;
    // What is hit nowhere lies a little behind the farthest thing.
    let nowhere = farthest.unwrap_or(0.0) + 0.5;
    let depth: Vec<f32> = t.depth.data.iter().map(|d| if d.is_finite() { log_depth(*d) } else { nowhere }).collect();
    let all = (0..3).map(|c| t.normal.channel(c)).chain((0..3).map(|c| t.albedo.channel(c))).chain([depth]);
    all.collect()
}

/// Means over squares of 2r + 1 pixels, smaller at the edges.
fn blurred(plane: &[f32], w: usize, r: usize) -> Vec<f32> {
    let h = plane.len() / w;
    let mut across = vec![0.0f32; plane.len()];
    for (from, to) in plane.chunks_exact(w).zip(across.chunks_exact_mut(w)) {
        for x in 0..w {
            let part = &from[x.saturating_sub(r)..(x + r + 1).min(w)];
            to[x] = part.iter().sum::<f32>() / part.len() as f32;
        }
    }
    let mut out = vec![0.0f32; plane.len()];
    out.par_chunks_mut(w).enumerate().for_each(|(y, to)| {
        let rows = y.saturating_sub(r)..(y + r + 1).min(h);
        let scale = 1.0 / rows.len() as f32;
        for row in rows {
            to.iter_mut().zip(&across[row * w..]).for_each(|(t, v)| *t += scale * v);
        }
    });
    out
}

/// One half, filtered with weights from the other (`guide`).
fn filter(
    half: &[Vec<f32>],
    guide: &[Vec<f32>],
    variance: &[Vec<f32>],
    features: &[Vec<f32>],
    [w, h]: [usize; 2],
    width: f32,
) -> Vec<Vec<f32>> {
    let n = half.len();
    let tiles: Vec<Region> = (0..h.div_ceil(TILE))
        .flat_map(|ty| (0..w.div_ceil(TILE)).map(move |tx| (tx * TILE, ty * TILE)))
        .map(|(x, y)| Region { left: x as i64, top: y as i64, width: TILE.min(w - x), height: TILE.min(h - y) })
        .collect();
    let parts: Vec<Vec<Vec<f32>>> =
        tiles.par_iter().map(|tile| filter_tile(half, guide, variance, features, [w, h], *tile, width)).collect();
    let mut out = vec![vec![0.0; w * h]; n];
    for (tile, part) in tiles.iter().zip(parts) {
        for (to, from) in out.iter_mut().zip(part) {
            for (row, line) in from.chunks_exact(tile.width).enumerate() {
                let at = (tile.top as usize + row) * w + tile.left as usize;
                to[at..at + tile.width].copy_from_slice(line);
            }
        }
    }
    out
}

/// A plane around a tile, its edges repeated.
fn padded(plane: &[f32], [w, h]: [usize; 2], region: Region) -> Vec<f32> {
    let mut to = Vec::with_capacity(region.area());
    for y in region.top..region.bottom() {
        let line = &plane[y.clamp(0, h as i64 - 1) as usize * w..][..w];
        to.extend((region.left..region.right()).map(|x| line[x.clamp(0, w as i64 - 1) as usize]));
    }
    to
}

fn filter_tile(
    half: &[Vec<f32>],
    guide: &[Vec<f32>],
    variance: &[Vec<f32>],
    features: &[Vec<f32>],
    size: [usize; 2],
    tile: Region,
    width: f32,
) -> Vec<Vec<f32>> {
    let n = half.len();
    let reach = WINDOW as usize + PATCH;
    let around = tile.grown(reach);
    let pad = |planes: &[Vec<f32>]| planes.iter().map(|p| padded(p, size, around)).collect::<Vec<_>>();
    let (half, guide, variance, features) = (pad(half), pad(guide), pad(variance), pad(features));
    let stride = around.width;
    // Distances are needed over the tile and the patches of its edge.
    let inner = tile.grown(PATCH);
    let area = tile.area();
    // Sums of the normal equations, a plane an entry: upper triangle, then the right side of each band.
    let pairs = TERMS * (TERMS + 1) / 2;
    let mut sums = vec![vec![0.0f32; area]; pairs + TERMS * n];
    let mut distance = vec![0.0f32; inner.area()];
    let mut rows = vec![0.0f32; inner.width * tile.height];
    let mut weight = vec![0.0f32; tile.width];
    let mut steps = vec![vec![0.0f32; tile.width]; FEATURES];
    let k2 = width * width;
    let patch = (2 * PATCH + 1) as f32;
    let scale = 1.0 / (patch * patch * n as f32);
    for dy in -WINDOW..=WINDOW {
        for dx in -WINDOW..=WINDOW {
            let shift = dy * stride as i64 + dx;
            distance.fill(0.0);
            for (u, v) in guide.iter().zip(&variance) {
                for row in 0..inner.height {
                    let here = (row + reach - PATCH) * stride + reach - PATCH;
                    let there = (here as i64 + shift) as usize;
                    let line = &mut distance[row * inner.width..][..inner.width];
                    let (u0, u1) = (&u[here..][..inner.width], &u[there..][..inner.width]);
                    let (v0, v1) = (&v[here..][..inner.width], &v[there..][..inner.width]);
                    for x in 0..inner.width {
                        let d = u0[x] - u1[x];
                        line[x] += (d * d - (v0[x] + v0[x].min(v1[x]))) / (k2 * (v0[x] + v1[x]));
                    }
                }
            }
            // Sums over patches.
            for row in 0..tile.height {
                let to = &mut rows[row * inner.width..][..inner.width];
                to.fill(0.0);
                for k in 0..=2 * PATCH {
                    to.iter_mut().zip(&distance[(row + k) * inner.width..]).for_each(|(t, d)| *t += d);
                }
            }
            for row in 0..tile.height {
                let line = &rows[row * inner.width..][..inner.width];
                // What lies outside the picture is no neighbour.
                let y = tile.top + row as i64 + dy;
                if y < 0 || y >= size[1] as i64 {
                    continue;
                }
                for (x, to) in weight.iter_mut().enumerate() {
                    let d: f32 = line[x..x + 2 * PATCH + 1].iter().sum::<f32>() * scale;
                    let outside = tile.left + x as i64 + dx;
                    let inside = outside >= 0 && outside < size[0] as i64;
                    *to = if inside { (-d.clamp(0.0, 60.0)).exp() } else { 0.0 };
                }
                let here = (row + reach) * stride + reach;
                let there = (here as i64 + shift) as usize;
                for (step, f) in steps.iter_mut().zip(&features) {
                    let (a, b) = (&f[here..][..tile.width], &f[there..][..tile.width]);
                    step.iter_mut().zip(a.iter().zip(b)).for_each(|(s, (a, b))| *s = b - a);
                }
                let to = row * tile.width;
                let mut entry = 0;
                for i in 0..TERMS {
                    // The first term is the constant.
                    for j in i..TERMS {
                        let sum = &mut sums[entry][to..to + tile.width];
                        entry += 1;
                        match (i, j) {
                            (0, 0) => sum.iter_mut().zip(&weight).for_each(|(s, w)| *s += w),
                            (0, j) => sum.iter_mut().zip(weight.iter().zip(&steps[j - 1])).for_each(|(s, (w, a))| *s += w * a),
                            (i, j) => {
                                let (a, b) = (&steps[i - 1], &steps[j - 1]);
                                for x in 0..tile.width {
                                    sum[x] += weight[x] * a[x] * b[x];
                                }
                            }
                        }
                    }
                }
                for (b, u) in half.iter().enumerate() {
                    let u = &u[there..][..tile.width];
                    for i in 0..TERMS {
                        let sum = &mut sums[pairs + b * TERMS + i][to..to + tile.width];
                        match i {
                            0 => sum.iter_mut().zip(weight.iter().zip(u)).for_each(|(s, (w, v))| *s += w * v),
                            i => {
                                let a = &steps[i - 1];
                                for x in 0..tile.width {
                                    sum[x] += weight[x] * a[x] * u[x];
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    let mut out = vec![vec![0.0; area]; n];
    let mut matrix = [[0.0f64; TERMS]; TERMS];
    for i in 0..area {
        let mut entry = 0;
        for r in 0..TERMS {
            for c in r..TERMS {
                matrix[r][c] = f64::from(sums[entry][i]);
                matrix[c][r] = matrix[r][c];
                entry += 1;
            }
        }
        let total = matrix[0][0];
        (1..TERMS).for_each(|k| matrix[k][k] += f64::from(RIDGE) * total);
        let first = first_row_of_inverse(&matrix);
        for (b, plane) in out.iter_mut().enumerate() {
            plane[i] = (0..TERMS).map(|k| first[k] * f64::from(sums[pairs + b * TERMS + k][i])).sum::<f64>() as f32;
        }
    }
    out
}

/// First row of the inverse of a symmetric positive matrix: what makes the value at the pixel of the sums (Cholesky).
fn first_row_of_inverse(m: &[[f64; TERMS]; TERMS]) -> [f64; TERMS] {
    let mut l = [[0.0; TERMS]; TERMS];
    for i in 0..TERMS {
        for j in 0..=i {
            let s: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = if i == j { (m[i][i] - s).max(1e-30).sqrt() } else { (m[i][j] - s) / l[j][j] };
        }
    }
    // L y = e₀, then Lᵀ x = y.
    let mut x = [0.0; TERMS];
    for i in 0..TERMS {
        let s: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
        x[i] = (f64::from(u8::from(i == 0)) - s) / l[i][i];
    }
    for i in (0..TERMS).rev() {
        let s: f64 = (i + 1..TERMS).map(|k| l[k][i] * x[k]).sum();
        x[i] = (x[i] - s) / l[i][i];
    }
    x
}

/// Shares of the unfiltered value, the narrow and the wide weights in each pixel: by the error of each, which the other half shows without bias.
fn choose(filtered: &[[Vec<Vec<f32>>; 2]], halves: &[Vec<Vec<f32>>; 2], variance: &[Vec<f32>], w: usize) -> Vec<[f32; 3]> {
    let size = variance[0].len();
    let error = |candidate: &[Vec<Vec<f32>>; 2]| -> Vec<f32> {
        let mut sum = vec![0.0f32; size];
        for k in 0..2 {
            for (b, v) in variance.iter().enumerate() {
                for i in 0..size {
                    let d = candidate[k][b][i] - halves[1 - k][b][i];
                    // Bands count by their own noise, of which the other half has one part.
                    sum[i] += (d * d - v[i]) / v[i];
                }
            }
        }
        blurred(&blurred(&sum, w, 1), w, 1)
    };
    let errors = [error(halves), error(&filtered[0]), error(&filtered[1])];
    let best = |i: usize| (0..3).min_by(|a, b| errors[*a][i].total_cmp(&errors[*b][i])).unwrap_or(1);
    let chosen: Vec<usize> = (0..size).map(best).collect();
    let shares: Vec<Vec<f32>> =
        (0..3).map(|k| blurred(&chosen.iter().map(|c| f32::from(u8::from(*c == k))).collect::<Vec<_>>(), w, 1)).collect();
    (0..size).map(|i| [shares[0][i], shares[1][i], shares[2][i]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::gaussian;
    use diopter_image::focal_plane::{Band, BandUnit};
    use diopter_image::{ExposureFacts, Raster, focal_plane::Truth};

    const SIZE: [usize; 2] = [120, 80];

    /// Two surfaces with a texture, light falling off across them; noise of a tenth.
    fn scene(noise: f32) -> (FocalPlane, Vec<f32>) {
        let [w, h] = SIZE;
        let mut truth = Truth::empty(w, h);
        let mut clean = Vec::new();
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            let albedo = if (x / 6 + y / 6) % 2 == 0 { 0.7 } else { 0.3 };
            let left = x < 60;
            truth.albedo.data[i * 3..i * 3 + 3].fill(albedo);
            truth.normal.data[i * 3 + usize::from(left)] = 1.0;
            truth.depth.data[i] = if left { 2.0 } else { 3.0 + y as f32 / 40.0 };
            clean.push(100.0 * albedo * (1.0 + 0.5 * (y as f32 / 30.0).sin()) * if left { 1.0 } else { 0.4 });
        }
        let bands = vec![Band { name: "Y".into(), unit: BandUnit::Electrons }];
        let mut mean = Raster::new(w, h, 1);
        let mut half_difference = Raster::new(w, h, 1);
        for i in 0..w * h {
            let [a, b] = [0, 1].map(|k| clean[i] * (1.0 + noise * gaussian(2 * i + k) as f32));
            mean.data[i] = 0.5 * (a + b);
            half_difference.data[i] = 0.5 * (a - b);
        }
        (FocalPlane { bands, mean, half_difference, truth, facts: ExposureFacts::default() }, clean)
    }

    fn error(got: &[f32], clean: &[f32]) -> f32 {
        got.iter().zip(clean).map(|(a, b)| ((a - b) / b).powi(2)).sum::<f32>() / clean.len() as f32
    }

    #[test]
    fn noise_goes_and_texture_stays() {
        let (plane, clean) = scene(0.2);
        let out = denoise(&plane);
        let (before, after) = (error(&plane.mean.data, &clean), error(&out.mean.data, &clean));
        // As much as eight times the samples would give.
        assert!(after < before / 8.0, "{after} of {before}");
        assert!(out.facts.denoised && !plane.facts.denoised);
        // The mean of the picture stays.
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        assert!((sum(&out.mean.data) / sum(&clean) - 1.0).abs() < 0.01);
    }

    #[test]
    fn what_has_no_noise_is_left() {
        let (plane, clean) = scene(0.0);
        let out = denoise(&plane);
        assert!(error(&out.mean.data, &clean) < 1e-5, "{}", error(&out.mean.data, &clean));
    }

    #[test]
    fn strips_are_the_rows_of_the_whole() {
        let (mut plane, _) = scene(0.3);
        // Sparks at any height, and a sky that is behind the farthest thing of the whole.
        for i in (7..plane.mean.data.len()).step_by(131) {
            plane.mean.data[i] *= 40.0;
            plane.half_difference.data[i] *= 40.0;
        }
        for i in (0..plane.truth.depth.data.len()).filter(|i| i % SIZE[0] < 20) {
            plane.truth.depth.data[i] = f32::INFINITY;
        }
        let whole = denoise(&plane);
        let farthest = farthest_log_depth(&mut plane.strips()).unwrap();
        assert!(farthest.is_some_and(|f| (f - (3.0f32 + 79.0 / 40.0).ln()).abs() < 1e-6));
        for rows in [7, 16, 30] {
            let mut strips = Denoised::by_rows(plane.strips(), farthest, rows);
            for first in (0..SIZE[1]).step_by(rows) {
                let count = rows.min(SIZE[1] - first);
                assert_eq!(strips.next_rows(count).unwrap(), whole.rows(first..first + count), "{rows} {first}");
            }
            assert!(strips.next_rows(1).is_err());
        }
    }

    #[test]
    fn strips_fit_into_the_memory() {
        for (width, bands) in [(20_000, 3), (20_000, 31), (100, 3)] {
            let rows = rows_at_once(width, bands);
            assert!(rows >= STRIP_STEP && rows.is_multiple_of(STRIP_STEP));
            assert!(rows == STRIP_STEP || (rows + 2 * REACH) * width * bytes_a_pixel(bands) <= STRIP_MEMORY);
        }
        assert!(rows_at_once(20_000, 3) >= 192);
    }

    #[test]
    fn small_and_empty_exposures_do_no_harm() {
        let bands = vec![Band { name: "Y".into(), unit: BandUnit::Electrons }];
        for size in [[1, 1], [3, 70], [65, 2]] {
            let plane = FocalPlane::even(bands.clone(), &[5.0], size, ExposureFacts::default());
            assert!(denoise(&plane).mean.data.iter().all(|v| (v - 5.0).abs() < 1e-3));
            let dark = FocalPlane::even(bands.clone(), &[0.0], size, ExposureFacts::default());
            assert!(denoise(&dark).mean.data.iter().all(|v| *v == 0.0));
        }
    }
}

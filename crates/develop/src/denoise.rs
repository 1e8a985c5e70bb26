//! The renderer's own noise, taken out of an exposure by weighted first-order regression on normals, albedo and depth.
//!
//! Each half of the samples is regressed with weights that come from the other half alone, so that noise cannot choose its own neighbours; of two
//! widths of the weights each place takes the one whose error, seen by the other half, is smaller; then light that is missing is given back around
//! ([`keep_light`]). The sensor's noise is not touched: it is made later. Sources: Bitterli et al. 2016, "Nonlinearly weighted first-order regression for denoising Monte Carlo renderings" (CGF 35); Rousselle,
//! Knaus & Zwicker 2012, "Adaptive rendering with non-local means filtering" (TOG 31), for the distance of patches.

mod energy;
mod highlights;
mod regression;
mod specks;

pub use energy::factors as keep_light;
pub use specks::factors as without_specks;

use diopter_image::focal_plane::{Band, FocalPlaneSource, STRIP_STEP, rows_within};
use diopter_image::truth::Recorded;
use diopter_image::{ExposureFacts, FocalPlane, ImageError, Raster};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Keeps the distance of noise-free patches finite, of the square of the mean.
const LEAST_VARIANCE: f32 = 1e-6;
/// Features: normal, albedo, log of depth.
const FEATURES: usize = 7;
/// How far a single pixel may stand out of its neighbours and the other half: little more than they differ among themselves, since what is cut is given
/// back around it, and what both halves show is kept.
const SPARK: f32 = 1.1;

/// By so much of the variance of a half in each band must the unfiltered value be the better one.
const KEEPS: f32 = 1.0;

/// Pictures of one number a pixel: of each band or feature.
type Planes = Vec<Vec<f32>>;

/// Rows around a row that its filtered value depends on: specks are compared with their neighbours; fractions of the candidates are means over neighbours 1 px away, of choices by errors that
/// are means over 2 px; the filter reaches by its window and half a patch; the variance that it takes is a mean over 2 px of what was divided by a mean
/// over 1 px of calm halves, for which single pixels were compared with their neighbours, after highlights were looked for.
const REACH: usize = specks::REACH + 1 + 2 + regression::REACH + 2 + 1 + 1 + highlights::REACH;
/// Bytes that denoising a strip takes at most: a few hundred rows of the widest pictures, so that little is computed twice.
pub const STRIP_MEMORY: usize = 3 << 29;

/// An exposure without most of its Monte Carlo noise and with all of its light ([`keep_light`]). What is left of the noise is correlated between
/// neighbours, and its half difference says less than the truth about the error: both halves share features and what they are made of.
/// `facts.denoised` tells.
pub fn denoise(plane: &FocalPlane) -> FocalPlane {
    denoise_unless(plane, &NEVER).unwrap_or_else(|| plane.clone())
}

/// [`denoise`], given up within milliseconds once `cancel` is set: `None` then.
pub fn denoise_unless(plane: &FocalPlane, cancel: &AtomicBool) -> Option<FocalPlane> {
    within(plane, regression::WINDOW, cancel)
}

/// [`denoise`] in a third of the time, by fewer neighbours: for small pictures that are looked at for a moment.
pub fn denoise_coarsely(plane: &FocalPlane) -> FocalPlane {
    within(plane, COARSE_WINDOW, &NEVER).unwrap_or_else(|| plane.clone())
}

/// How far away the neighbours of [`denoise_coarsely`] are at most, px.
const COARSE_WINDOW: i64 = 3;

/// [`denoise_unless`] by neighbours up to `window` px away.
fn within(plane: &FocalPlane, window: i64, cancel: &AtomicBool) -> Option<FocalPlane> {
    let mut out = filter_rows(plane, farthest_log_depth_of(&plane.truth.depth().data), window, cancel)?;
    if plane.width() > 0 {
        give_back(&plane.mean.data, &mut out);
    }
    out.facts.denoised = true;
    (!cancel.load(Ordering::Relaxed)).then_some(out)
}

/// What is not given up.
static NEVER: AtomicBool = AtomicBool::new(false);

/// Bytes of a pixel that denoising takes: calm replicates, variance, two filtered pairs and those of a filter at work; seven features, three fractions
/// and errors; the old plane and the new one.
pub fn bytes_a_pixel(bands: usize) -> usize {
    let plane = diopter_image::focal_plane::bytes_a_pixel(bands);
    4 * bands * (2 + 1 + 4 + 2) + 4 * (FEATURES + 3 + 3) + 2 * plane
}

/// Rows that [`Denoised`] computes at once, for pictures of so many pixels a row and bands, with so many bytes of a pixel of truth beyond what is always
/// recorded ([`Recorded::more_bytes`]).
pub fn rows_at_once(width: usize, bands: usize, more: usize) -> usize {
    let a_pixel = bytes_a_pixel(bands) + 3 * more;
    let around = (2 * REACH + energy::REACH) * width.saturating_mul(a_pixel);
    rows_within(STRIP_MEMORY.saturating_sub(around), width, a_pixel)
}

/// Log of the largest finite depth (m) of an exposure that is read strip by strip; `None` if nothing is hit. The logarithm is natural. Fails where the source does.
pub fn farthest_log_depth(source: &mut impl FocalPlaneSource) -> Result<Option<f32>, ImageError> {
    let ([_, height], rows) = (source.size(), source.rows_at_once());
    let mut farthest: Option<f32> = None;
    for first in (0..height).step_by(rows) {
        let strip = source.next_rows(rows.min(height - first))?;
        farthest = farthest.into_iter().chain(farthest_log_depth_of(&strip.truth.depth().data)).reduce(f32::max);
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
    /// Rows that are filtered and still needed, their light not given back.
    filtered: Option<FocalPlane>,
    /// The first of them.
    first_filtered: usize,
    /// Rows that were taken.
    next: usize,
    /// Rows that are computed at once.
    at_once: usize,
}

impl<S: FocalPlaneSource> Denoised<S> {
    /// `farthest`: [`farthest_log_depth`] of the same exposure. It is not asked for when all rows are computed at once ([`rows_at_once`]).
    pub fn new(source: S, farthest: Option<f32>) -> Self {
        let at_once = rows_at_once(source.size()[0], source.bands().len(), source.recorded().more_bytes());
        Self::by_rows(source, farthest, at_once)
    }

    /// Sets the name of the filter that the facts give ([`ExposureFacts::denoiser`]).
    pub fn named(mut self, name: &str) -> Self {
        self.facts.denoiser = name.into();
        self
    }

    fn by_rows(source: S, farthest: Option<f32>, at_once: usize) -> Self {
        let facts = ExposureFacts { denoised: true, ..source.facts().clone() };
        Denoised { source, farthest, facts, rows: None, first: 0, filtered: None, first_filtered: 0, next: 0, at_once }
    }
}

/// Rows behind those that are there, if any.
fn below(above: Option<FocalPlane>, rows: FocalPlane) -> Result<FocalPlane, ImageError> {
    match above {
        Some(mut above) => {
            above.append(&rows)?;
            Ok(above)
        }
        None => Ok(rows),
    }
}

impl<S: FocalPlaneSource> FocalPlaneSource for Denoised<S> {
    fn bands(&self) -> &[Band] {
        self.source.bands()
    }

    fn facts(&self) -> &ExposureFacts {
        &self.facts
    }

    fn recorded(&self) -> &Recorded {
        self.source.recorded()
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
        // Read what the strip depends on. More rows than there are is an error of the source.
        let filter_to = (to + energy::REACH).min(height).max(to);
        let read = self.first + self.rows.as_ref().map_or(0, FocalPlane::height);
        let read_to = (filter_to + REACH).min(height).max(to);
        let read = self.source.next_rows(read_to - read)?;
        let source = below(self.rows.take(), read)?;
        // A picture that is computed at once knows its farthest depth.
        let farthest = if source.height() == height { farthest_log_depth_of(&source.truth.depth().data) } else { self.farthest };
        // Filter the rows that are not yet, by those around them.
        let filtered_to = self.first_filtered + self.filtered.as_ref().map_or(0, FocalPlane::height);
        let filtered = match self.filtered.take() {
            Some(filtered) if filtered_to == filter_to => filtered,
            above => {
                let around = filtered_to.saturating_sub(REACH).max(self.first);
                let rows = source.rows(around - self.first..read_to - self.first);
                let strip = filter_rows(&rows, farthest, regression::WINDOW, &NEVER).unwrap_or(rows);
                below(above, strip.rows(filtered_to - around..filter_to - around))?
            }
        };
        // Give the light back.
        let mut bright = filtered.clone();
        let before = source.mean.rows(self.first_filtered - self.first..filter_to - self.first);
        give_back(&before.data, &mut bright);
        let mut strip = bright.rows(from - self.first_filtered..to - self.first_filtered);
        strip.facts = self.facts.clone();
        // Keep what the next one depends on.
        let first_filtered = to.saturating_sub(energy::REACH).max(self.first_filtered);
        let first = first_filtered.min(filter_to.saturating_sub(REACH)).max(self.first);
        self.filtered = Some(filtered.rows(first_filtered - self.first_filtered..filtered.height()));
        self.rows = Some(source.rows(first - self.first..source.height()));
        (self.first_filtered, self.first, self.next) = (first_filtered, first, to);
        Ok(strip)
    }
}

/// What is no number is taken for dark.
fn finite(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// Gives filtered rows the light that the same rows had before, `[row][column][band]`.
fn give_back(before: &[f32], plane: &mut FocalPlane) {
    let (w, n) = (plane.width(), plane.bands.len());
    for b in 0..n {
        let before: Vec<f32> = before.iter().skip(b).step_by(n).map(|v| finite(*v)).collect();
        let factors = energy::factors(&before, &plane.mean.channel(b), w);
        for (i, factor) in factors.into_iter().enumerate() {
            plane.mean.data[i * n + b] *= factor;
            plane.half_difference.data[i * n + b] *= factor;
        }
    }
}

/// All or some rows of an exposure, filtered; `farthest` is the log of the largest depth of all of it. `None` once `cancel` is set.
fn filter_rows(plane: &FocalPlane, farthest: Option<f32>, window: i64, cancel: &AtomicBool) -> Option<FocalPlane> {
    let (w, h, n) = (plane.width(), plane.height(), plane.bands.len());
    let mut out = plane.clone();
    if w * h == 0 || n == 0 {
        return Some(out);
    }
    let half = |sign: f32| -> Planes {
        let band = |b: usize| {
            let (mean, difference) = (plane.mean.channel(b), plane.half_difference.channel(b));
            mean.iter().zip(&difference).map(|(m, d)| finite(*m) + sign * finite(*d)).collect()
        };
        (0..n).map(band).collect()
    };
    let mut halves = [half(1.0), half(-1.0)];
    let highlights = highlights::remove(&mut halves, w);
    let calm = without_sparks(&halves, w);
    let features = features(plane, farthest);
    // Variance of one half: twice that of the mean, over some neighbours, since a pixel's own has one degree of freedom.
    let variance: Planes = (0..n)
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
    // [half][width], then [width][half].
    let [first, second] =
        [0, 1].map(|k| regression::filter(&calm[k], &calm[1 - k], &variance, &features, [w, h], window, cancel));
    let filtered: Vec<[Planes; 2]> = first?.into_iter().zip(second?).map(|(a, b)| [a, b]).collect();
    let choice = choose(&filtered, &calm, &variance, w);
    for b in 0..n {
        for i in 0..w * h {
            let [none, wide, narrow] = choice[i];
            let [a, c] = [0, 1].map(|k| none * calm[k][b][i] + wide * filtered[0][k][b][i] + narrow * filtered[1][k][b][i]);
            // Light is never negative; a fit may be.
            out.mean.data[i * n + b] = finite(0.5 * (a + c)).max(0.0);
            out.half_difference.data[i * n + b] = finite(0.5 * (a - c));
        }
    }
    let steadied = specks::factors(&out.mean, out.truth.albedo());
    for (i, factor) in steadied.into_iter().enumerate() {
        out.mean.data[i] *= factor;
        out.half_difference.data[i] *= factor;
    }
    // As they were.
    for i in highlights {
        for at in i * n..(i + 1) * n {
            (out.mean.data[at], out.half_difference.data[at]) =
                (finite(plane.mean.data[at]), finite(plane.half_difference.data[at]));
        }
    }
    Some(out)
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

/// Log of the largest finite depth, m; `None` if there is none. The logarithm is natural.
pub fn farthest_log_depth_of(depth: &[f32]) -> Option<f32> {
    depth.iter().map(|d| log_depth(*d)).filter(|d| d.is_finite()).reduce(f32::max)
}

/// What the scene is like at each pixel, in units of about one.
fn features(plane: &FocalPlane, farthest: Option<f32>) -> Vec<Vec<f32>> {
    let t = &plane.truth;
    // What is hit nowhere lies a little behind the farthest thing.
    let nowhere = farthest.unwrap_or(0.0) + 0.5;
    let depth: Vec<f32> = t.depth().data.iter().map(|d| if d.is_finite() { log_depth(*d) } else { nowhere }).collect();
    let channel = |raster: &Raster<f32>, c: usize| raster.channel(c).into_iter().map(finite).collect();
    let all = (0..3).map(|c| channel(t.normal(), c)).chain((0..3).map(|c| channel(t.albedo(), c))).chain([depth]);
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

/// Fractions of the unfiltered value, the narrow and the wide weights in each pixel: by the error of each, which the other half shows without bias.
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
    let mut errors = [error(halves), error(&filtered[0]), error(&filtered[1])];
    // Noise with rare samples of great weight leaves places where both halves are as dark as most samples are: they would be kept as they are, as dark dots.
    errors[0].iter_mut().for_each(|e| *e += KEEPS * variance.len() as f32);
    let best = |i: usize| (0..3).min_by(|a, b| errors[*a][i].total_cmp(&errors[*b][i])).unwrap_or(1);
    let chosen: Vec<u8> = (0..size).map(|i| best(i) as u8).collect();
    let fractions: Vec<Vec<f32>> = (0..3)
        .map(|k| blurred(&chosen.iter().map(|c| f32::from(u8::from(usize::from(*c) == k))).collect::<Vec<_>>(), w, 1))
        .collect();
    (0..size).map(|i| [fractions[0][i], fractions[1][i], fractions[2][i]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::gaussian;
    use diopter_image::focal_plane::Truth;
    use diopter_image::focal_plane::{Band, BandUnit};

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
            truth.albedo_mut().data[i * 3..i * 3 + 3].fill(albedo);
            truth.normal_mut().data[i * 3 + usize::from(left)] = 1.0;
            truth.depth_mut().data[i] = if left { 2.0 } else { 3.0 + y as f32 / 40.0 };
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
        // As much as four times the samples would give (4.7 here; scenes with less regular noise gain more).
        assert!(after < before / 4.0, "{after} of {before}");
        assert!(out.facts.denoised && !plane.facts.denoised);
        // The half difference tells the noise that is left; of the bias, most of the error at the edges of the texture, it knows nothing.
        let claimed = out.half_difference.data.iter().zip(&clean).map(|(d, c)| (d / c).powi(2)).sum::<f32>() / clean.len() as f32;
        assert!(claimed > 0.03 * after && claimed < 1.5 * after, "{claimed} {after}");
    }

    #[test]
    fn light_is_kept_at_edges_gradients_texture_and_lamps() {
        let (mut plane, mut clean) = scene(0.3);
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        let kept = |plane: &FocalPlane| sum(&denoise(plane).mean.data) / sum(&plane.mean.data);
        // Asked: 0.3 %.
        assert!((kept(&plane) - 1.0).abs() < 3e-3, "{}", kept(&plane));
        // A lamp of 3 × 3 pixels, ten thousand times as bright; then rare paths of great weight in one half elsewhere, a tenth of all light.
        for y in 20..23 {
            for x in 80..83 {
                let i = y * SIZE[0] + x;
                plane.mean.data[i] *= 1e4;
                plane.half_difference.data[i] *= 1e4;
                clean[i] *= 1e4;
            }
        }
        assert!((kept(&plane) - 1.0).abs() < 3e-3, "{}", kept(&plane));
        let (mut plane, clean) = scene(0.3);
        for i in (40..clean.len()).step_by(409) {
            plane.mean.data[i] += 1500.0;
            plane.half_difference.data[i] += 1500.0;
        }
        assert!((kept(&plane) - 1.0).abs() < 3e-3, "{}", kept(&plane));
        // Without sparks to look at all the same: none stands out of its neighbours by as much as it did.
        let out = denoise(&plane);
        let most = out.mean.data.iter().zip(&clean).map(|(a, b)| a / b).fold(0.0, f32::max);
        assert!(most < 10.0, "{most}");
    }

    #[test]
    fn noisy_lamps_of_few_pixels_leave_the_wall_around_alone() {
        let (plane, clean) = scene(0.2);
        let mut lit = plane.clone();
        // 10⁵ times as bright; the halves differ by a factor of three, as after few samples.
        let lamp: Vec<usize> = (30..32).flat_map(|y| (80..82).map(move |x| y * SIZE[0] + x)).collect();
        for i in &lamp {
            (lit.mean.data[*i], lit.half_difference.data[*i]) = (1e5 * clean[*i], 0.5e5 * clean[*i]);
        }
        let (with, without) = (denoise(&lit), denoise(&plane));
        let wall: Vec<usize> = (0..clean.len()).filter(|i| !lamp.contains(i)).collect();
        let most = wall.iter().map(|i| (with.mean.data[*i] - without.mean.data[*i]).abs() / clean[*i]).fold(0.0, f32::max);
        // The wall is what it is without the lamp, but for four pixels of it that are hidden.
        assert!(most < 0.15, "{most}");
        assert!(lamp.iter().all(|i| (with.mean.data[*i] / lit.mean.data[*i] - 1.0).abs() < 1e-3));
    }

    #[test]
    fn the_same_numbers_for_any_number_of_threads() {
        let (plane, _) = scene(0.2);
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| denoise(&plane))
        };
        assert_eq!(by(1), by(4));
    }

    #[test]
    fn what_is_no_number_harms_nothing_around() {
        let (mut plane, clean) = scene(0.2);
        plane.truth.normal_mut().data[3 * 4000] = f32::NAN;
        plane.truth.albedo_mut().data[3 * 4100] = f32::INFINITY;
        plane.truth.depth_mut().data[4200] = f32::NAN;
        plane.mean.data[4300] = f32::NAN;
        plane.half_difference.data[4400] = f32::INFINITY;
        let out = denoise(&plane);
        assert!(out.mean.data.iter().chain(&out.half_difference.data).all(|v| v.is_finite()));
        let (before, after) = (error(&scene(0.2).0.mean.data, &clean), error(&out.mean.data, &clean));
        assert!(after < before / 4.0, "{after} of {before}");
    }

    #[test]
    fn rare_bright_samples_leave_few_dark_dots() {
        // An even wall: of twelve samples of each half one in ten is bright.
        let (mut plane, _) = scene(0.0);
        plane.truth.albedo_mut().data.fill(0.5);
        plane.truth.depth_mut().data.fill(2.0);
        plane.truth.normal_mut().data.chunks_exact_mut(3).for_each(|n| n.copy_from_slice(&[0.0, 0.0, 1.0]));
        let half = |i: usize, k: u32| {
            let bright = |s: &u32| diopter_light::random::mix(i as u32 * 24 + 12 * k + s + 1) < u32::MAX / 10;
            (0..12).map(|s| if bright(&s) { 8.2 } else { 0.2 }).sum::<f32>() / 12.0
        };
        for i in 0..plane.mean.data.len() {
            let [a, b] = [0, 1].map(|k| half(i, k));
            (plane.mean.data[i], plane.half_difference.data[i]) = (0.5 * (a + b), 0.5 * (a - b));
        }
        let filtered = denoise(&plane).mean.data;
        let dark = filtered.iter().filter(|v| **v < 0.5).count();
        // Three; ten where the better one of the two is taken without a margin.
        assert!(dark < 6, "{dark}");
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
        // Lamps as well.
        for i in (60..plane.mean.data.len()).step_by(1117) {
            plane.mean.data[i] *= 4000.0;
        }
        for i in (0..plane.truth.depth().data.len()).filter(|i| i % SIZE[0] < 20) {
            plane.truth.depth_mut().data[i] = f32::INFINITY;
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
            let rows = rows_at_once(width, bands, 0);
            assert!(rows >= STRIP_STEP && rows.is_multiple_of(STRIP_STEP));
            assert!(rows == STRIP_STEP || (rows + 2 * REACH + energy::REACH) * width * bytes_a_pixel(bands) <= STRIP_MEMORY);
        }
        assert!(rows_at_once(20_000, 3, 0) >= 176 && rows_at_once(20_000, 3, 80) < rows_at_once(20_000, 3, 0));
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

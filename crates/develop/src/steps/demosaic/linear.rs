//! Any pattern: the linear filters with the least expected error for pictures as they usually are, one for each place of the pattern.
//!
//! A picture is taken for brightness, rough and common to all channels, plus each channel's own colour, weaker and smooth. Weights minimise
//! the variance of the error under that model and leave flat colours exact (kriging with unknown means). Source of the approach: Trussell &
//! Hartwig 2002, "Mathematics for demosaicking" (IEEE TIP 11); Matheron 1969, "Le krigeage universel".

use super::Mosaic;
use crate::region::Region;
use diopter_image::Cfa;

/// Half the side of the window.
const RADIUS: i64 = 4;

/// The model: variance 1 of brightness, correlated over this length (px) as exp(−d/ℓ). Tuned on the charts of the benchmark.
const BRIGHTNESS_LENGTH: f64 = 10.0;
/// Variance of a channel's own colour, and the length (px) over which it changes, as exp(−d²/2ℓ²).
const COLOUR: (f64, f64) = (0.06, 2.0);
/// Variance of noise: keeps the filters from sharpening it.
const NOISE: f64 = 1e-3;
/// Weights smaller than this change nothing that can be seen.
const LEAST_WEIGHT: f64 = 5e-4;

/// Weights of pixels around, by offset.
type Taps = Vec<([i64; 2], f32)>;

/// Filters of each place of the pattern, `[row][column][channel]`.
pub struct Filters {
    taps: Vec<Taps>,
    channels: usize,
}

impl Filters {
    /// Solves for the filters of a pattern.
    pub fn new(cfa: &Cfa) -> Self {
        let n = cfa.channel_count();
        let places = (0..cfa.rows() as i64).flat_map(|y| (0..cfa.columns() as i64).map(move |x| (x, y)));
        let taps = places.flat_map(|(x, y)| (0..n).map(move |c| filter(cfa, x, y, c))).collect();
        Filters { taps, channels: n }
    }

    /// How far around a pixel the mosaic is looked at, px.
    pub fn reach(&self) -> usize {
        RADIUS as usize
    }

    /// All channels of the pixels of `region`, `[channel][row × column]`, from a mosaic that reaches [`Filters::reach`] further on each side.
    pub fn run(&self, mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
        let (w, cfa) = (mosaic.region.width as isize, mosaic.cfa);
        let offsets: Vec<Vec<(isize, f32)>> =
            self.taps.iter().map(|t| t.iter().map(|(d, v)| (d[1] as isize * w + d[0] as isize, *v)).collect()).collect();
        let (ox, oy) = ((region.left - mosaic.region.left) as isize, (region.top - mosaic.region.top) as isize);
        let mut planes = vec![vec![0.0; region.area()]; self.channels];
        for row in 0..region.height {
            let y = (region.top + row as i64).rem_euclid(cfa.rows() as i64) as usize;
            for column in 0..region.width {
                let x = (region.left + column as i64).rem_euclid(cfa.columns() as i64) as usize;
                let here = (oy + row as isize) * w + ox + column as isize;
                for (c, plane) in planes.iter_mut().enumerate() {
                    let taps = &offsets[(y * cfa.columns() + x) * self.channels + c];
                    plane[row * region.width + column] = taps.iter().map(|(o, v)| mosaic.data[(here + o) as usize] * v).sum();
                }
            }
        }
        planes
    }
}

/// The filter that makes channel `c` at a place of the pattern.
fn filter(cfa: &Cfa, x: i64, y: i64, c: usize) -> Taps {
    if cfa.channel_beyond(x, y) == c {
        return vec![([0, 0], 1.0)];
    }
    let window = (-RADIUS..=RADIUS).flat_map(|dy| (-RADIUS..=RADIUS).map(move |dx| [dx, dy]));
    let samples: Vec<([i64; 2], usize)> = window.map(|d| (d, cfa.channel_beyond(x + d[0], y + d[1]))).collect();
    let present: Vec<usize> = (0..cfa.channel_count()).filter(|k| samples.iter().any(|s| s.1 == *k)).collect();
    let covariance = |a: ([i64; 2], usize), b: ([i64; 2], usize)| {
        let d2 = ((a.0[0] - b.0[0]).pow(2) + (a.0[1] - b.0[1]).pow(2)) as f64;
        let own = if a.1 == b.1 { COLOUR.0 * (-d2 / (2.0 * COLOUR.1 * COLOUR.1)).exp() } else { 0.0 };
        (-d2.sqrt() / BRIGHTNESS_LENGTH).exp() + own
    };
    // Samples among themselves, with the sums of the weights of each channel as conditions.
    let (n, m) = (samples.len(), samples.len() + present.len());
    let mut rows = vec![vec![0.0; m + 1]; m];
    for i in 0..n {
        for j in 0..n {
            rows[i][j] = covariance(samples[i], samples[j]) + if i == j { NOISE } else { 0.0 };
        }
        for (k, p) in present.iter().enumerate() {
            let belongs = f64::from(u8::from(samples[i].1 == *p));
            rows[i][n + k] = belongs;
            rows[n + k][i] = belongs;
        }
        rows[i][m] = covariance(samples[i], ([0, 0], c));
    }
    for (k, p) in present.iter().enumerate() {
        rows[n + k][m] = f64::from(u8::from(*p == c));
    }
    let mut weights = solve(rows);
    weights.truncate(n);
    // Small weights are dropped; the sums of each channel stay.
    weights.iter_mut().for_each(|v| *v = if v.abs() < LEAST_WEIGHT { 0.0 } else { *v });
    for p in &present {
        let of = |k: &usize| samples[*k].1 == *p && weights[*k] != 0.0;
        let kept: Vec<usize> = (0..n).filter(of).collect();
        let missing = f64::from(u8::from(*p == c)) - kept.iter().map(|k| weights[*k]).sum::<f64>();
        kept.iter().for_each(|k| weights[*k] += missing / kept.len() as f64);
    }
    let used = samples.iter().zip(weights).filter(|(_, v)| *v != 0.0);
    used.map(|((d, _), v)| (*d, v as f32)).collect()
}

/// Solves linear equations, each a row with its right side last, by elimination with row pivots.
fn solve(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let n = rows.len();
    for k in 0..n {
        let largest = (k..n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs())).unwrap_or(k);
        rows.swap(k, largest);
        let (above, below) = rows.split_at_mut(k + 1);
        let pivot = &above[k];
        for row in below {
            let factor = row[k] / pivot[k];
            if factor != 0.0 {
                row[k..].iter_mut().zip(&pivot[k..]).for_each(|(v, p)| *v -= factor * p);
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
        x[k] = (rows[k][n] - known) / rows[k][k];
    }
    x
}

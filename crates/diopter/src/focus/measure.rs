//! How sharp a picture is: focus measures over the cells of a zone.
//!
//! Sources: S. K. Nayar & Y. Nakagawa 1994, "Shape from Focus", IEEE PAMI 16(8), 824 (sum-modified Laplacian with a step, Gaussian
//! interpolation of the peak); E. Krotkov 1987, "Focusing", IJCV 1, 223 (Tenengrad: Sobel gradients, squared); grey-level variance as
//! in the same.

/// A focus measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Measure {
    /// Sum of the modified Laplacian, |∂²/∂x²| + |∂²/∂y²|, where it is above a threshold.
    #[default]
    Sml,
    /// Sum of squared Sobel gradients.
    Tenengrad,
    /// Variance of the values.
    Variance,
}

impl Measure {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Measure); 3] =
        [("sml", Measure::Sml), ("tenengrad", Measure::Tenengrad), ("variance", Measure::Variance)];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }
}

/// What a sensor saw of a zone twice, one reading right after the other: `[row][column][channel]` each.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Cells a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Values a cell.
    pub channels: usize,
    /// Electrons a pixel, the mean over the pixels of a cell.
    pub readings: [Vec<f32>; 2],
}

/// What a measure finds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sharpness {
    /// Contrast of the picture, relative to its brightness, without what noise alone would show.
    pub value: f64,
    /// The measure as it is, noise and all.
    pub raw: f64,
    /// What noise alone shows: the same measure of the difference of the two readings.
    pub floor: f64,
    /// Standard deviation of `raw`, estimated from the floor.
    pub deviation: f64,
}

impl Sharpness {
    /// How many deviations the picture's detail stands above its noise.
    pub fn significance(&self) -> f64 {
        if self.deviation > 0.0 {
            (self.raw - self.floor) / self.deviation
        } else if self.raw > 0.0 {
            f64::INFINITY
        } else {
            0.0
        }
    }
}

/// A threshold of the modified Laplacian, in units of what noise shows on average: what is below is not counted.
const THRESHOLD: f32 = 2.0;

impl Frame {
    /// The same with `by` × `by` cells taken together.
    pub fn binned(&self, by: usize) -> Frame {
        if by == 1 {
            return self.clone();
        }
        let (columns, rows) = (self.columns / by, self.rows / by);
        let bin = |from: &Vec<f32>| {
            let mut to = vec![0.0; columns * rows * self.channels];
            for y in 0..rows * by {
                for x in 0..columns * by {
                    for c in 0..self.channels {
                        to[(y / by * columns + x / by) * self.channels + c] += from[(y * self.columns + x) * self.channels + c];
                    }
                }
            }
            let fraction = 1.0 / (by * by) as f32;
            to.iter_mut().for_each(|v| *v *= fraction);
            to
        };
        Frame { columns, rows, readings: [bin(&self.readings[0]), bin(&self.readings[1])], ..*self }
    }

    /// The same cells as two looks show them together, of which `other` counts for a fraction.
    pub fn joined(mut self, other: &Frame, fraction: f32) -> Frame {
        for (own, other) in self.readings.iter_mut().flatten().zip(other.readings.iter().flatten()) {
            *own += fraction * (other - *own);
        }
        self
    }

    /// Mean electrons of a pixel.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.readings.iter().flatten().map(|v| f64::from(*v)).sum();
        sum / (2 * self.columns * self.rows * self.channels).max(1) as f64
    }

    /// Mean of the readings and half their difference, of a channel.
    fn parts(&self, channel: usize) -> [Vec<f32>; 2] {
        let cells = self.columns * self.rows;
        let at = |i: usize| (self.readings[0][i * self.channels + channel], self.readings[1][i * self.channels + channel]);
        let with = |f: fn((f32, f32)) -> f32| (0..cells).map(|i| f(at(i))).collect();
        [with(|(a, b)| 0.5 * (a + b)), with(|(a, b)| 0.5 * (a - b))]
    }

    /// How sharp it is, all channels together; neighbours are `step` cells apart.
    pub fn sharpness(&self, measure: Measure, step: usize) -> Sharpness {
        let mean = self.mean();
        if mean <= 0.0 || self.columns <= 2 * step || self.rows <= 2 * step {
            return Sharpness::default();
        }
        let inner = ((self.columns - 2 * step) * (self.rows - 2 * step)) as f64;
        let (mut raw, mut floor, mut variance) = (0.0, 0.0, 0.0);
        for channel in 0..self.channels {
            let [picture, noise] = self.parts(channel);
            let local = |data: &[f32]| -> Vec<f32> {
                match measure {
                    Measure::Sml => map(data, self.columns, self.rows, step, modified_laplacian),
                    Measure::Tenengrad => map(data, self.columns, self.rows, step, sobel),
                    Measure::Variance => {
                        let mean = data.iter().sum::<f32>() / data.len() as f32;
                        data.iter().map(|v| (v - mean) * (v - mean)).collect()
                    }
                }
            };
            let (of_picture, of_noise) = (local(&picture), local(&noise));
            let noise_mean = of_noise.iter().sum::<f32>() / of_noise.len() as f32;
            let threshold = if measure == Measure::Sml { THRESHOLD * noise_mean } else { f32::NEG_INFINITY };
            let sum = |v: &[f32]| v.iter().filter(|v| **v >= threshold).map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
            raw += sum(&of_picture);
            floor += sum(&of_noise);
            // By the spread of what noise shows; neighbours share cells, about as if four were one.
            let counted = |v: f32| if v >= threshold { f64::from(v) } else { 0.0 };
            let squares = of_noise.iter().map(|v| counted(*v).powi(2)).sum::<f64>() / of_noise.len() as f64;
            variance += (squares - sum(&of_noise).powi(2)).max(0.0) * 4.0 / inner;
        }
        // In electrons a channel, relative to the mean of a channel.
        let scale = 1.0 / (mean * self.channels as f64);
        let deviation = variance.sqrt();
        match measure {
            Measure::Sml => {
                let value = (raw * raw - floor * floor).max(0.0).sqrt() * scale;
                Sharpness { value, raw: raw * scale, floor: floor * scale, deviation: deviation * scale }
            }
            _ => {
                let scale = scale / mean;
                let value = ((raw - floor).max(0.0) * scale).sqrt();
                Sharpness { value, raw: raw * scale, floor: floor * scale, deviation: deviation * scale }
            }
        }
    }

    /// The block of `width` × `height` cells with the most detail: its left upper cell.
    pub fn busiest_block(&self, width: usize, height: usize) -> [usize; 2] {
        let mut detail = vec![0.0f64; self.columns * self.rows];
        for channel in 0..self.channels {
            let [picture, noise] = self.parts(channel);
            let both = [picture, noise].map(|d| map(&d, self.columns, self.rows, 1, modified_laplacian));
            let inner = self.columns - 2;
            for (i, (a, b)) in both[0].iter().zip(&both[1]).enumerate() {
                detail[(i / inner + 1) * self.columns + i % inner + 1] += f64::from(*a - *b);
            }
        }
        let (width, height) = (width.min(self.columns), height.min(self.rows));
        // The middle of equals.
        let off = |x: usize, y: usize| (2 * x + width).abs_diff(self.columns) + (2 * y + height).abs_diff(self.rows);
        let mut best = (f64::NEG_INFINITY, usize::MAX, [0, 0]);
        for y in 0..=self.rows - height {
            for x in 0..=self.columns - width {
                let sum: f64 =
                    (y..y + height).map(|r| detail[r * self.columns + x..r * self.columns + x + width].iter().sum::<f64>()).sum();
                if sum > best.0 || (sum == best.0 && off(x, y) < best.1) {
                    best = (sum, off(x, y), [x, y]);
                }
            }
        }
        best.2
    }
}

/// A local measure of every cell that has neighbours.
fn map(data: &[f32], columns: usize, rows: usize, step: usize, f: fn(&[f32], usize, usize, usize) -> f32) -> Vec<f32> {
    let mut out = Vec::with_capacity(columns * rows);
    for y in step..rows.saturating_sub(step) {
        out.extend((step..columns - step).map(|x| f(data, y * columns + x, step, step * columns)));
    }
    out
}

fn modified_laplacian(d: &[f32], i: usize, dx: usize, dy: usize) -> f32 {
    (2.0 * d[i] - d[i - dx] - d[i + dx]).abs() + (2.0 * d[i] - d[i - dy] - d[i + dy]).abs()
}

fn sobel(d: &[f32], i: usize, dx: usize, dy: usize) -> f32 {
    let column = |i: usize| d[i - dy] + 2.0 * d[i] + d[i + dy];
    let row = |i: usize| d[i - dx] + 2.0 * d[i] + d[i + dx];
    let (gx, gy) = (column(i + dx) - column(i - dx), row(i + dy) - row(i - dy));
    gx * gx + gy * gy
}

/// Place of the maximum of a bell through points (place, value): least squares of a parabola through the logarithms, the largest
/// counting most. `None` when they do not bend downwards or the maximum lies outside.
pub fn peak(points: &[(f64, f64)]) -> Option<f64> {
    let most = points.iter().map(|p| p.1).fold(0.0, f64::max);
    let used: Vec<(f64, f64)> = points.iter().copied().filter(|p| p.1 > 0.02 * most).collect();
    let (low, high) = used.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |a, p| (a.0.min(p.0), a.1.max(p.0)));
    if used.len() < 3 || high <= low {
        return None;
    }
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    // Moments of the weighted fit a + b x + c x².
    let (mut s, mut t) = ([0.0; 5], [0.0; 3]);
    for (place, value) in used {
        let (x, y, w) = ((place - middle) / half, (value / most).ln(), (value / most).powi(2));
        (0..5).for_each(|k| s[k] += w * x.powi(k as i32));
        (0..3).for_each(|k| t[k] += w * y * x.powi(k as i32));
    }
    let m = glam::DMat3::from_cols_array_2d(&[[s[0], s[1], s[2]], [s[1], s[2], s[3]], [s[2], s[3], s[4]]]);
    let fit = m.inverse() * glam::DVec3::from_array(t);
    let x = -0.5 * fit.y / fit.z;
    (fit.z < 0.0 && x.abs() <= 1.0).then_some(middle + x * half)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look normal, by their index.
    fn gaussian(i: usize) -> f32 {
        let mut z = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut unit = || {
            z ^= z >> 29;
            z = z.wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x1234_5678_9abc_def1);
            ((z >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        ((-2.0 * unit().ln()).sqrt() * (std::f64::consts::TAU * unit()).cos()) as f32
    }

    fn frame(f: impl Fn(usize, usize) -> f32, noise: f32) -> Frame {
        let n = 64;
        let reading =
            |k: usize| (0..n * n).map(|i| 1000.0 + f(i % n, i / n) + noise * gaussian(i + k * n * n + 7)).collect::<Vec<f32>>();
        Frame { columns: n, rows: n, channels: 1, readings: [reading(0), reading(1)] }
    }

    #[test]
    fn noise_is_not_taken_for_detail() {
        for measure in Measure::NAMES.map(|n| n.1) {
            let wall = frame(|_, _| 0.0, 50.0).sharpness(measure, 1);
            assert!(wall.significance().abs() < 3.0, "{measure:?} {wall:?}");
            let checker = frame(|x, y| if (x / 4 + y / 4) % 2 == 0 { 200.0 } else { -200.0 }, 50.0).sharpness(measure, 1);
            let clean = frame(|x, y| if (x / 4 + y / 4) % 2 == 0 { 200.0 } else { -200.0 }, 0.0).sharpness(measure, 1);
            assert!(checker.significance() > 20.0, "{measure:?} {checker:?}");
            // Without its noise the value is that of the clean picture.
            assert!((checker.value / clean.value - 1.0).abs() < 0.2, "{measure:?} {checker:?} {clean:?}");
        }
    }

    #[test]
    fn blur_makes_it_less_and_brightness_does_not_matter() {
        for measure in Measure::NAMES.map(|n| n.1) {
            let waves = |k: f32| {
                frame(move |x, y| k * 100.0 * ((x as f32 * 0.9).sin() + (y as f32 * 0.7).cos()), 1.0).sharpness(measure, 1)
            };
            assert!(waves(1.0).value > 1.5 * waves(0.5).value, "{measure:?}");
        }
        let bright = frame(|x, _| 100.0 * (x as f32).sin(), 0.0);
        let mut dark = bright.clone();
        dark.readings.iter_mut().flatten().for_each(|v| *v *= 0.1);
        let (a, b) = (bright.sharpness(Measure::Sml, 1).value, dark.sharpness(Measure::Sml, 1).value);
        assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    }

    #[test]
    fn joined_looks_have_the_noise_of_all_their_samples() {
        // Three times the samples: a third of the variance.
        let noise = |f: &Frame| f.readings.iter().flatten().map(|v| f64::from(v - 1000.0).powi(2)).sum::<f64>();
        let (few, mut more) = (frame(|_, _| 0.0, 30.0), frame(|_, _| 0.0, 30.0 / 3f32.sqrt()));
        more.readings.iter_mut().for_each(|r| r.reverse());
        let (before, after) = (noise(&few), noise(&more.clone().joined(&few, 0.25)));
        // 8192 numbers know a variance to 1.6 %.
        assert!((after / before * 4.0 - 1.0).abs() < 0.06, "{}", after / before);
        // Of one look alone nothing changes.
        assert_eq!(more.clone().joined(&few, 0.0).readings, more.readings);
    }

    #[test]
    fn the_peak_of_a_bell_is_found_between_points() {
        let bell = |x: f64| 3.0 * (-0.5 * ((x - 1.37) / 0.6f64).powi(2)).exp();
        for places in [&[0.9, 1.5, 2.1][..], &[0.5, 1.0, 1.5, 2.0, 2.5], &[0.8, 1.3, 2.2]] {
            let points: Vec<(f64, f64)> = places.iter().map(|x| (*x, bell(*x))).collect();
            assert!((peak(&points).unwrap() - 1.37).abs() < 1e-6);
        }
        assert_eq!(peak(&[(0.0, 1.0), (1.0, 0.5), (2.0, 1.0)]), None);
        assert_eq!(peak(&[(0.0, 1.0), (1.0, 2.0)]), None);
    }
}

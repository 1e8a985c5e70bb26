//! Outliers that remain when the samples end: re-weighted by how well the samples around them support them, and counted.
//!
//! Source: T. Zirr, J. Hanika, C. Dachsbacher 2018, "Re-weighting Firefly Samples for Improved Finite-Sample Monte Carlo Estimates", Computer Graphics
//! Forum 37(6). Samples are summed in a cascade of buffers by their brightness, whose thresholds grow by a factor of 8; a sample between two is
//! shared between both so that it counts as one sample in all (the paper's §4). At the end the buffers of a pixel and its eight neighbours tell
//! how many samples reached a brightness. Few of them are no reliable estimate of the light they stand for.
//!
//! Where it differs from the paper: the darkest samples need no buffer of their own (they are what the sum of all samples is above the others); what
//! lies above the brightest threshold has one, so that nothing is clamped; support counts samples of the own brightness and above, and those one
//! buffer below by an eighth, so that the excess of one very bright sample does not support itself; and the weight is a ramp from 0 for one sample to 1
//! at [`RELIABLE`]. With more samples every light that is really there is supported in the end: the bias vanishes. What is taken away is reported.

use super::pixel_groups::PixelGroups;
use super::response::GROUP;
use diopter_image::Raster;
use glam::Vec4;

/// What becomes of outliers when the samples end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Fireflies {
    /// Every sample counts as it is: the mean is unbiased.
    #[default]
    Keep,
    /// Samples that those around do not support count less.
    Reweight {
        /// Electrons that saturate the film: brightness is measured by them.
        white_e: f64,
    },
}

/// Buffers of the cascade.
const LEVELS: usize = 4;
/// Ratio of the brightness of one buffer to that of the one below (the paper's b).
const BASE: f64 = 8.0;
/// Largest brightness of a sample that is never in doubt, of white: one of 64 samples then adds a thousandth of white.
const TRUSTED: f64 = 1.0 / 16.0;
/// Samples of a brightness in a pixel and its neighbours that make a reliable estimate. On synthetic pictures of exponential noise with rare bright samples
/// (16 to 512 samples a pixel) 3 leaves up to 2.5 times the squared error of 5; 8 takes 1.6 % of the light from the noise alone at 16 samples, 5 0.2 %.
const RELIABLE: f64 = 5.0;
/// Samples a pixel below which nothing is re-weighted: what nearly every pixel shows is no outlier, and a quick preview must not be darker.
const FEWEST_SAMPLES: usize = 8;

/// Sums of all bands that a pixel has: of all samples, and for re-weighting of each buffer and of what lies above all of them.
pub const SUMS_WITH_CASCADE: usize = 2 + LEVELS;

/// The cascade of an exposure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cascade {
    /// Brightness of the buffers, and before them the largest that is never in doubt.
    thresholds: [f64; LEVELS + 1],
}

impl Cascade {
    /// `white_e`: electrons at which a pixel is white.
    pub fn new(white_e: f64) -> Self {
        Cascade { thresholds: std::array::from_fn(|k| TRUSTED * white_e * BASE.powi(k as i32)) }
    }

    /// The buffers to which a sample of a brightness belongs, and the fraction of it in each; `None` if it is not in doubt. The last number stands for what
    /// lies above all buffers.
    #[inline]
    fn split(&self, brightness: f64) -> Option<[(usize, f64); 2]> {
        let [lowest, .., highest] = self.thresholds;
        if !(brightness > lowest) {
            return None;
        }
        if brightness >= highest {
            let within = highest / brightness;
            return Some([(LEVELS - 1, within), (LEVELS, 1.0 - within)]);
        }
        let above = (1..LEVELS).find(|k| brightness < self.thresholds[*k]).unwrap_or(LEVELS);
        // Linear in the reciprocal: divided by its buffer's brightness, what is in each adds up to one sample.
        let lower = (self.thresholds[above - 1] / brightness - 1.0 / BASE) / (1.0 - 1.0 / BASE);
        // Below the first buffer it is not in doubt.
        let below = above.checked_sub(2).map_or((0, 0.0), |k| (k, lower));
        Some([below, (above - 1, 1.0 - lower)])
    }

    /// Adds a sample to the buffers of a pixel, `[buffer][band][replicate]`. `value`: what it adds to a group of bands; `brightness`: its brightest
    /// band, as if all of the sample were so.
    #[inline]
    pub fn add(&self, buffers: &mut [[f64; 2]], bands: usize, half: usize, brightness: f32, value: impl Fn(usize) -> Vec4) {
        let Some(parts) = self.split(f64::from(brightness)) else { return };
        for (buffer, fraction) in parts.into_iter().filter(|p| p.1 > 0.0) {
            for (group, sums) in buffers[buffer * bands..][..bands].chunks_mut(GROUP).enumerate() {
                let value = value(group);
                if value.is_finite() {
                    sums.iter_mut().zip(value.to_array()).for_each(|(sum, v)| sum[half] += f64::from(v) * fraction);
                }
            }
        }
    }

    /// Samples in the buffers of a pixel, before them those that are never in doubt (in units of the first threshold).
    fn counts(&self, pixel: &[[f64; 2]], bands: usize) -> [f64; LEVELS + 1] {
        let brightest = |of: &dyn Fn(usize) -> f64| (0..bands).map(of).fold(0.0, f64::max);
        let sum = |place: usize| pixel[place][0] + pixel[place][1];
        std::array::from_fn(|level| {
            let sum_of = match level {
                0 => brightest(&|b| sum(b) - (1..SUMS_WITH_CASCADE).map(|k| sum(k * bands + b)).sum::<f64>()),
                k => brightest(&|b| sum(k * bands + b)),
            };
            sum_of / self.thresholds[level]
        })
    }

    /// Sums of a row of so many samples a pixel after re-weighting, `[column][band][replicate]`, and the light of the row before and after. Where `groups` of pixels lent one another light, a bright sample of one is in others of
    /// its group as well: these say nothing for one another, and neighbours of other groups count for them.
    pub fn row(
        &self,
        sums: &Raster<f64>,
        bands: usize,
        row: usize,
        samples: usize,
        groups: Option<&PixelGroups>,
    ) -> (Vec<f64>, [f64; 2]) {
        let (width, stride) = (sums.width, sums.width * sums.channels);
        // After those of the cascade a pixel may have sums for other things.
        let pixels = |y: usize| sums.data[y * stride..(y + 1) * stride].as_chunks::<2>().0.chunks_exact(sums.channels / 2);
        // Of this row and those above and below.
        let rows = row.saturating_sub(1)..(row + 2).min(sums.height);
        let counts_of = |y: usize| pixels(y).map(|pixel| self.counts(pixel, bands)).collect::<Vec<_>>();
        let counted: Vec<Vec<[f64; LEVELS + 1]>> = rows.clone().map(counts_of).collect();
        let around = |x: usize| {
            rows.clone()
                .zip(&counted)
                .flat_map(move |(y, counts)| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| ([x, y], &counts[x])))
        };
        let mut kept = Vec::with_capacity(width * bands * 2);
        let mut light = [0.0; 2];
        for (x, pixel) in pixels(row).enumerate() {
            let mut counts = [0.0; LEVELS + 1];
            let mut add = |from: &[f64; LEVELS + 1], factor: f64| {
                counts.iter_mut().zip(from).for_each(|(sum, n)| *sum += factor * n);
            };
            let own_group = groups.map(|groups| (groups, groups.of([x, row])));
            let is_other = |at: [usize; 2]| own_group.is_none_or(|(groups, own)| groups.of(at) != own);
            let neighbours = around(x).filter(|(at, _)| *at != [x, row]);
            let (all, others) =
                neighbours.clone().fold((0, 0), |(all, others), (at, _)| (all + 1, others + usize::from(is_other(at))));
            // A group without others around it speaks for itself.
            let factor = if others == 0 { 1.0 } else { f64::from(all) / others as f64 };
            add(&counted[row - rows.start][x], 1.0);
            neighbours.filter(|(at, _)| others == 0 || is_other(*at)).for_each(|(_, from)| add(from, factor));
            let lost = if samples < FEWEST_SAMPLES { [0.0; LEVELS + 1] } else { lost_fractions(&counts) };
            for band in 0..bands {
                let all = pixel[band];
                let mut taken = [0.0; 2];
                for (buffer, lost) in lost.iter().enumerate().filter(|(_, lost)| **lost > 0.0) {
                    let sum = pixel[(1 + buffer) * bands + band];
                    (taken[0], taken[1]) = (taken[0] + lost * sum[0], taken[1] + lost * sum[1]);
                }
                // Rounding must not leave less than nothing.
                let left: [f64; 2] = std::array::from_fn(|h| if taken[h] > 0.0 { (all[h] - taken[h]).max(0.0) } else { all[h] });
                light[0] += all[0] + all[1];
                light[1] += left[0] + left[1];
                kept.extend(left);
            }
        }
        (kept, light)
    }
}

/// The fraction of each buffer, and of what lies above, that does not count, by the samples around: those never in doubt, then those in each buffer.
fn lost_fractions(counts: &[f64; LEVELS + 1]) -> [f64; LEVELS + 1] {
    let lost = |level: usize| {
        let support = counts[level..].iter().sum::<f64>() + counts[level - 1] / BASE;
        1.0 - ((support - 1.0) / (RELIABLE - 1.0)).clamp(0.0, 1.0)
    };
    std::array::from_fn(|buffer| lost((buffer + 1).min(LEVELS)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    const WHITE: f64 = 1000.0;
    const SIDE: usize = 9;

    /// Sums of a picture of one band whose samples a function of pixel and sample gives.
    fn picture(spp: u32, sample: impl Fn(usize, u32) -> f32) -> Raster<f64> {
        let cascade = Cascade::new(WHITE);
        let mut sums = Raster::new(SIDE, SIDE, 2 * SUMS_WITH_CASCADE);
        for (i, pixel) in sums.data.as_chunks_mut::<2>().0.chunks_exact_mut(SUMS_WITH_CASCADE).enumerate() {
            for k in 0..spp {
                let (v, half) = (sample(i, k), (k & 1) as usize);
                pixel[0][half] += f64::from(v);
                cascade.add(&mut pixel[1..], 1, half, v, |_| Vec4::new(v, 0.0, 0.0, 0.0));
            }
        }
        sums
    }

    /// Means of the pixels after re-weighting, and the fraction of the light that was taken away.
    fn reweighted(sums: &Raster<f64>, spp: u32) -> (Vec<[f64; 2]>, f64) {
        reweighted_by(sums, spp, None)
    }

    /// The same where groups of pixels lent one another light.
    fn reweighted_by(sums: &Raster<f64>, spp: u32, groups: Option<&PixelGroups>) -> (Vec<[f64; 2]>, f64) {
        let (mut all, mut light) = (Vec::new(), [0.0; 2]);
        for y in 0..SIDE {
            let (kept, l) = Cascade::new(WHITE).row(sums, 1, y, spp as usize, groups);
            all.extend(kept.as_chunks::<2>().0.iter().map(|h| h.map(|v| v / f64::from(spp))));
            light = [light[0] + l[0], light[1] + l[1]];
        }
        (all, 1.0 - light[1] / light[0])
    }

    #[test]
    fn a_sample_counts_once_whatever_its_brightness() {
        let cascade = Cascade::new(WHITE);
        for k in 0..400 {
            let v = (10.0 * 1.05f64.powi(k)) as f32;
            let mut pixel = vec![[0.0; 2]; SUMS_WITH_CASCADE];
            pixel[0][1] = f64::from(v);
            cascade.add(&mut pixel[1..], 1, 1, v, |_| Vec4::splat(v));
            let stored: f64 = pixel[1..].iter().map(|p| p[0] + p[1]).sum();
            assert!((0.0..=f64::from(v) * (1.0 + 1e-12)).contains(&stored), "{v}: {stored}");
            let counts: f64 = cascade.counts(&pixel, 1).iter().sum();
            let expected = (f64::from(v) / (TRUSTED * WHITE)).min(1.0);
            assert!((counts - expected).abs() < 1e-6, "{v}: {counts} {expected}");
        }
    }

    #[test]
    fn an_outlier_loses_its_weight_and_nothing_else_changes() {
        for (spp, bright) in [(64, 3e3f32), (64, 1e5), (64, 1e9), (16, 1e6)] {
            let even = |i: usize, k: u32| 4.0 + to_unit(mix(i as u32 * 977 + k));
            let outlier = (4 * SIDE + 4, 7);
            let sums = picture(spp, |i, k| if (i, k) == outlier { bright } else { even(i, k) });
            let (found, taken) = reweighted(&sums, spp);
            let clean = picture(spp, even);
            for (i, pixel) in found.iter().enumerate() {
                let expected: [f64; 2] = std::array::from_fn(|h| clean.data[i * 2 * SUMS_WITH_CASCADE + h] / f64::from(spp));
                if i != outlier.0 {
                    assert_eq!(*pixel, expected, "{spp} {bright}: a pixel without outliers");
                    continue;
                }
                // Of all its light less than a quarter of white in one sample is left, in its own replicate.
                let [off, own] = [0, 1].map(|h| pixel[h] - expected[h]);
                assert!(off.abs() < 1e-9 && own.abs() < 0.25 * WHITE / f64::from(spp), "{spp} {bright}: {off} {own}");
            }
            // What is reported is what is missing.
            let total = |of: &dyn Fn(usize) -> f64| (0..SIDE * SIDE).map(of).sum::<f64>();
            let before =
                total(&|i| (sums.data[i * 2 * SUMS_WITH_CASCADE] + sums.data[i * 2 * SUMS_WITH_CASCADE + 1]) / f64::from(spp));
            let after = total(&|i| found[i][0] + found[i][1]);
            assert!((taken - (before - after) / before).abs() < 1e-9, "{taken} {before} {after}");
            assert!(taken > 0.0);
        }
    }

    #[test]
    fn light_that_is_really_there_comes_back_with_the_samples() {
        // Of 200 samples one finds a light 100 times as bright as white.
        let (chance, bright) = (1.0 / 200.0, (100.0 * WHITE) as f32);
        let dim = (0.01 * WHITE) as f32;
        let truth = chance * f64::from(bright) + (1.0 - chance) * f64::from(dim);
        let mut bias = Vec::new();
        for spp in [8u32, 64, 512, 4096] {
            let random = |i: usize, k: u32| to_unit(mix(mix(i as u32 + 1) ^ k.wrapping_mul(0x9e37_79b9)));
            let sums = picture(spp, |i, k| if f64::from(random(i, k)) < chance { bright } else { dim });
            let (found, taken) = reweighted(&sums, spp);
            let mean = found.iter().map(|p| p[0] + p[1]).sum::<f64>() / found.len() as f64;
            bias.push((taken, (mean / truth - 1.0).abs()));
        }
        assert!(bias.is_sorted_by(|a, b| a.0 >= b.0), "{bias:?}");
        // 8 samples in nine pixels find 0.4 of them, 4096 find 184. Noise of the last mean: 1 / √(81 · 4096 / 200) = 2.5 %.
        assert!(bias[0].0 > 0.5 && bias[3].0 == 0.0 && bias[3].1 < 0.1, "{bias:?}");
    }

    #[test]
    fn what_has_few_samples_is_left_as_it_is() {
        let sample = |i: usize, k: u32| if (i, k) == (40, 1) { 1e6 } else { 30.0 };
        assert!(reweighted(&picture(8, sample), 8).1 > 0.5);
        assert_eq!(reweighted(&picture(4, sample), 4).1, 0.0);
    }

    #[test]
    fn an_edge_of_a_bright_light_keeps_its_pixels() {
        // A light of 300 times white covers the right half of the picture, and a tenth of the column before it.
        let random = |i: usize, k: u32| to_unit(mix(mix(i as u32 + 5) ^ k.wrapping_mul(0x9e37_79b9)));
        let covered = |x: usize| {
            if x > 4 {
                1.0
            } else if x == 4 {
                0.1
            } else {
                0.0
            }
        };
        let sums = picture(64, |i, k| if random(i, k) < covered(i % SIDE) { 3e5 } else { 1.0 });
        assert_eq!(reweighted(&sums, 64).1, 0.0);
    }

    #[test]
    fn what_one_group_of_pixels_found_together_is_one_sample() {
        // A bright sample that all pixels of a group have; the same brightness in all pixels, which is really there.
        let groups = PixelGroups::new(&crate::camera::Film::new(36.0, 36.0, SIDE, SIDE), false);
        let at = |i: usize| [i % SIDE, i / SIDE];
        let own = groups.of(at(40));
        for (bright, everywhere) in [(3e3f32, false), (1e6, false), (3e3, true)] {
            let has = |i: usize| everywhere || groups.of(at(i)) == own;
            // Light that is there is met more than once by each pixel.
            let meets = |k: u32| k == 7 || everywhere && k % 16 == 7;
            let sums = picture(64, |i, k| if meets(k) && has(i) { bright } else { 5.0 });
            let removed = reweighted_by(&sums, 64, Some(&groups)).1;
            let all = f64::from(bright) * (0..SIDE * SIDE).filter(|i| has(*i)).count() as f64;
            let fraction = if everywhere { removed } else { removed * (all + 5.0 * 64.0 * (SIDE * SIDE) as f64) / all };
            assert!(if everywhere { fraction == 0.0 } else { fraction > 0.9 }, "{bright} {everywhere}: {fraction}");
            if !everywhere {
                // By all neighbours alike much of it is taken for light that is there.
                assert!(reweighted(&sums, 64).1 < 0.9 * removed, "{bright}");
            }
        }
    }
}

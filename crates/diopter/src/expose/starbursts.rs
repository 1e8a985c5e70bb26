//! Starbursts: light that the aperture diffracts far from the image of a lamp, drawn separately.
//!
//! A lamp is 10⁶ times as bright as what it lights. Of its light a thousandth of a thousandth falls into each of many pixels, and a path that is displaced so
//! far finds it in one of a million samples: noise. So the light of samples that are at least as bright as what saturates the film is split exactly. What
//! stays within a few pixels is gathered as everything else. What goes farther (the fraction is known from the pattern) is only noted while samples are
//! taken, in the pixel where it would have arrived by geometry, with the mean and the scatter of its wavelengths in each band. At the end it is spread from
//! there by points of a low-discrepancy sequence over the pattern, more of them for brighter lamps. Each replicate has points of its own: the half
//! difference shows what noise they leave. Light is moved, never made: what a band of a pixel sends out is what its points bring, but for those beyond the
//! film.
//!
//! Whether a sample is a lamp's depends on nothing but the sample, so parts of the samples add up to the whole. Where fireflies are re-weighted, lone bright
//! samples make no starburst.

use super::diffraction::Optics;
use super::response::GROUP;
use crate::camera::Camera;
use diopter_image::Raster;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::wavelength::{FIRST_NM, LAST_NM};
use glam::{DVec2, Vec4};
use rayon::prelude::*;
use std::ops::Range;

/// Points for each pixel of the film, all starbursts together, and the fewest and most.
const POINTS_A_PIXEL: f64 = 24.0;
const POINTS: [f64; 2] = [1_048_576.0, 134_217_728.0];
/// Fewest and most points of a pixel that sends light out.
const POINTS_OF_SOURCE: [f64; 2] = [32.0, 1_048_576.0];
/// Points that are in memory at once, about.
const AT_ONCE: usize = 1 << 20;
/// Lamp samples in a pixel and its neighbours that make a starburst where fireflies are re-weighted: as many as make a reliable estimate there.
const RELIABLE: f64 = 5.0;

/// Bands that a pixel has for what it sends out: its light (by replicate), the sums of light × wavelength and light × wavelength², and a number of samples.
pub(super) const fn star_sums(bands: usize) -> usize {
    2 * bands + 1
}

/// Notes light that a pixel sends out, in its sums `[light of each band, moments of each band, number][replicate]`. `value`: what it is in a group of bands;
/// `part`: what part of a sample it is.
#[inline]
pub(super) fn note(sums: &mut [[f64; 2]], bands: usize, half: usize, nm: f32, part: f64, value: impl Fn(usize) -> Vec4) {
    let nm = f64::from(nm);
    for group in 0..bands.div_ceil(GROUP) {
        let value = value(group);
        if !value.is_finite() {
            continue;
        }
        for (k, v) in value.to_array().into_iter().enumerate().take(bands - group * GROUP) {
            let (band, v) = (group * GROUP + k, f64::from(v).max(0.0));
            sums[band][half] += v;
            sums[bands + band][0] += v * nm;
            sums[bands + band][1] += v * nm * nm;
        }
    }
    sums[2 * bands][half] += part;
}

/// Notes what of the light that a pixel sends out is direct, in its sums `[band][replicate]`: a fraction of `value`, see [`note`].
#[inline]
pub(super) fn note_direct(sums: &mut [[f64; 2]], half: usize, fraction: f32, value: impl Fn(usize) -> Vec4) {
    for (group, bands) in sums.chunks_mut(GROUP).enumerate() {
        let value = value(group);
        if value.is_finite() {
            bands.iter_mut().zip(value.to_array()).for_each(|(sum, v)| sum[half] += f64::from(v.max(0.0) * fraction));
        }
    }
}

/// The starbursts of an exposure whose samples are all taken.
pub(super) struct Starbursts<'a> {
    pub optics: &'a Optics,
    pub camera: &'a Camera,
    pub seed: u64,
    pub bands: usize,
    /// Bands that a pixel has before those of the starbursts.
    pub before: usize,
    /// Where the sums begin of what of their light is direct, where that is recorded.
    pub direct: Option<usize>,
    /// Whether lone samples are left out.
    pub reweight: bool,
}

/// A pixel that sends light out.
struct Source {
    column: usize,
    row: usize,
    /// What of its light counts, 0 to 1.
    weight: f64,
    /// Points in all; even.
    points: u32,
}

/// Light that arrives: number of pixel and band, what it adds to mean and half difference, and to the mean of direct light.
type Splat = (usize, f32, f32, f32);

impl Starbursts<'_> {
    fn of_pixel<'b>(&self, sums: &'b Raster<f64>, column: usize, row: usize) -> &'b [[f64; 2]] {
        let start = (row * sums.width + column) * sums.channels + 2 * self.before;
        sums.data[start..start + 2 * star_sums(self.bands)].as_chunks::<2>().0
    }

    /// Spreads what was noted over mean and half difference, and what of it is direct over the mean of direct light.
    pub fn spread(
        &self,
        sums: &Raster<f64>,
        samples: &Range<u32>,
        [mean, half]: [&mut Raster<f32>; 2],
        mut direct: Option<&mut Raster<f32>>,
    ) {
        let sources = self.sources(sums);
        let mut first = 0;
        while first < sources.len() {
            // Blocks of sources by their numbers of points: the same for any number of threads.
            let mut points = 0;
            let last = first
                + sources[first..]
                    .iter()
                    .take_while(|s| {
                        let room = points < AT_ONCE;
                        points += s.points as usize;
                        room
                    })
                    .count();
            let splats: Vec<Vec<Splat>> =
                sources[first..last].par_iter().map(|source| self.of_source(source, sums, samples)).collect();
            for (place, to_mean, to_half, to_direct) in splats.into_iter().flatten() {
                mean.data[place] += to_mean;
                half.data[place] += to_half;
                if let Some(direct) = &mut direct {
                    direct.data[place] += to_direct;
                }
            }
            first = last;
        }
    }

    /// Pixels that send light out, in order.
    fn sources(&self, sums: &Raster<f64>) -> Vec<Source> {
        let (width, height) = (sums.width, sums.height);
        let number = |column: usize, row: usize| self.of_pixel(sums, column, row)[2 * self.bands].iter().sum::<f64>();
        let support = |column: usize, row: usize| {
            let rows = row.saturating_sub(1)..(row + 2).min(height);
            let around = rows.map(|y| (column.saturating_sub(1)..(column + 2).min(width)).map(|x| number(x, y)).sum::<f64>());
            ((around.sum::<f64>() - 1.0) / (RELIABLE - 1.0)).clamp(0.0, 1.0)
        };
        let of_row = |row: usize| {
            (0..width)
                .filter_map(|column| {
                    let light: f64 = self.of_pixel(sums, column, row)[..self.bands].iter().flatten().sum();
                    let weight = if !(light > 0.0) {
                        0.0
                    } else if self.reweight {
                        support(column, row)
                    } else {
                        1.0
                    };
                    (weight > 0.0).then_some((Source { column, row, weight, points: 0 }, light * weight))
                })
                .collect::<Vec<_>>()
        };
        let found: Vec<Vec<(Source, f64)>> = (0..height).into_par_iter().map(of_row).collect();
        let total: f64 = found.iter().flatten().map(|s| s.1).sum();
        let all = (POINTS_A_PIXEL * (width * height) as f64).clamp(POINTS[0], POINTS[1]);
        let points = |light: f64| {
            let [fewest, most] = POINTS_OF_SOURCE;
            ((all * light / total).clamp(fewest, most) as u32).next_power_of_two()
        };
        found.into_iter().flatten().map(|(source, light)| Source { points: points(light), ..source }).collect()
    }

    /// What a pixel sends out to the film.
    fn of_source(&self, source: &Source, sums: &Raster<f64>, samples: &Range<u32>) -> Vec<Splat> {
        let noted = self.of_pixel(sums, source.column, source.row);
        let camera = self.camera;
        let (columns, bands) = (camera.film.columns, self.bands);
        let kernel = self.optics.lens.at(camera.film_point(source.column as f64 + 0.5, source.row as f64 + 0.5));
        let odd = f64::from(samples.end / 2 - samples.start / 2);
        let counts = [samples.len() as f64 - odd, odd];
        let mut splats = vec![];
        let mut reached: Vec<Option<usize>> = vec![];
        for half in 0..2usize {
            if !noted[..bands].iter().any(|l| l[half] > 0.0) {
                continue;
            }
            // Where from, what way for a unit of wavelength, and which part of the band's wavelengths: the same for all bands.
            let point = |i: u32| {
                let sampler =
                    Sampler::new(SamplerKind::Sobol, self.seed, (source.column as u32, source.row as u32), i, source.points);
                let [u, v, band, s] = sampler.get(Dimensions::Diffraction(1));
                let [x, y, t, _] = sampler.get(Dimensions::Diffraction(2));
                let from = camera.film_point(source.column as f64 + f64::from(x), source.row as f64 + f64::from(y));
                kernel.wing([u, v], [s, t]).map(|way| (from, way, f64::from(band) - 0.5))
            };
            let points: Vec<(DVec2, DVec2, f64)> = (half as u32..source.points).step_by(2).filter_map(point).collect();
            for band in 0..bands {
                let sent = source.weight * noted[band][half];
                if !(sent > 0.0) {
                    continue;
                }
                let all = noted[band][0] + noted[band][1];
                let [first, second] = noted[bands + band].map(|m| m / all);
                // An even distribution of that mean and variance.
                let width = (12.0 * (second - first * first).max(0.0)).sqrt();
                reached.clear();
                for (from, way, place) in &points {
                    let nm = (first + width * place).clamp(f64::from(FIRST_NM), f64::from(LAST_NM));
                    let by = *way * (nm * 1e-6);
                    if by.length() > self.optics.lens.core_mm() {
                        let pixel = camera.pixel_of((*from + by).as_vec2().to_array());
                        reached.push(pixel.map(|(x, y)| (y * columns + x) * bands + band));
                    }
                }
                if reached.is_empty() {
                    reached.push(Some((source.row * columns + source.column) * bands + band));
                }
                let each = sent / reached.len() as f64;
                let to_mean = (each / samples.len() as f64) as f32;
                let to_direct = self.direct.map_or(0.0, |from| {
                    let at = (source.row * sums.width + source.column) * sums.channels + 2 * (from + band) + half;
                    to_mean * (sums.data[at] / noted[band][half]) as f32
                });
                // As of [`super::sums::means`]: a part of one replicate only knows nothing of its error.
                let to_half = match (counts, half) {
                    ([even, odd], _) if odd == 0.0 || even == 0.0 => to_mean * if odd == 0.0 { 1.0 } else { -1.0 },
                    (counts, 0) => (0.5 * each / counts[0]) as f32,
                    (counts, _) => (-0.5 * each / counts[1]) as f32,
                };
                splats.extend(reached.iter().flatten().map(|place| (*place, to_mean, to_half, to_direct)));
            }
        }
        splats
    }
}

//! The sums of an exposure under way, and what comes of them.

use super::TILE;
use super::fireflies::Cascade;
use super::pixel_groups::PixelGroups;
use super::starbursts::Starbursts;
use crate::row_store::RowStore;
use crate::stray::colors_of;
use diopter_image::Raster;
use diopter_image::channels::{DIRECT, INDIRECT};
use diopter_image::focal_plane::{Band, BandUnit, Truth};
use diopter_image::truth::Values;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};

/// An exposure under way: the sums of its samples. Going on from them gives, bit for bit, what the exposure would have given without a pause.
///
/// Samples are taken in passes over the whole film, tile by tile: every pixel has the samples of the finished passes, and the first tiles those of
/// the pass under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S = Raster<f64>> {
    /// `[row][column][band][replicate]`; where fireflies are re-weighted, after the bands those of the buffers of the cascade; where lamps make starbursts, after
    /// these what they send out; where direct light is recorded, after these what of the bands is direct, and of what lamps send out.
    pub(crate) sums: S,
    /// Samples of the finished passes.
    pub(crate) samples: Range<u32>,
    /// Where the pass under way ends; where the last one ended if none is.
    pub(crate) pass_end: u32,
    /// Tiles that have the samples of the pass under way.
    pub(crate) tiles: usize,
    /// Groups of pixels that lent one another light, known while the exposure is under way.
    pub(crate) groups: Option<PixelGroups>,
}

/// Told the sums so far, to keep them. [`ControlFlow::Break`]: they are kept elsewhere, and the exposure ends at once with
/// [`super::ExposeError::Cancelled`], within a pass or not.
pub type SumsCallback<'a, S = Raster<f64>> = &'a mut dyn FnMut(&Sums<S>) -> ControlFlow<()>;

/// A rectangle of the film and its sums.
pub(super) struct Tile {
    pub column: usize,
    pub row: usize,
    pub width: usize,
    /// `[row][column][band][replicate]`
    pub sums: Vec<f64>,
    /// Whether these are the sums of all samples so far, or only of this pass.
    pub whole: bool,
    /// Pixels that wavelengths reach elsewhere: pixel number → sums `[band][replicate]`.
    pub outside: BTreeMap<usize, Vec<[f64; 2]>>,
}

/// Light that lands on pixels all over the film, of samples of one replicate.
pub(super) struct Splats {
    replicate: usize,
    bands: usize,
    /// Whether direct light is told apart.
    apart: bool,
    pixels: Vec<u32>,
    /// `[splat][band]`, twice as many where direct light is told apart: all light, then what of it is direct.
    values: Vec<f64>,
}

impl Splats {
    /// No light yet: of samples of a replicate (0 or 1) in so many bands; `apart`: whether direct light is summed beside it.
    pub fn new(replicate: usize, bands: usize, apart: bool) -> Self {
        Splats { replicate, bands, apart, pixels: Vec::new(), values: Vec::new() }
    }

    /// Numbers of a splat.
    fn numbers(&self) -> usize {
        if self.apart { 2 * self.bands } else { self.bands }
    }

    /// Adds light to a pixel, by groups of bands; all of it is direct or none.
    pub fn add(&mut self, pixel: usize, is_direct: bool, groups: impl Iterator<Item = glam::Vec4>) {
        let start = self.values.len();
        self.values.extend(groups.flat_map(|g| g.to_array()).map(f64::from));
        self.values.truncate(start + self.bands);
        if self.apart {
            let factor = f64::from(u8::from(is_direct));
            self.values.extend_from_within(start..);
            self.values[start + self.bands..].iter_mut().for_each(|v| *v *= factor);
        }
        // One bad number must not poison a pixel.
        match self.values[start..].iter().all(|v| v.is_finite()) {
            true => self.pixels.push(pixel as u32),
            false => self.values.truncate(start),
        }
    }

    /// Each pixel once, rising; its parts are added in the order in which they came.
    pub fn sorted(self) -> Splats {
        let mut order: Vec<u32> = (0..self.pixels.len() as u32).collect();
        order.sort_unstable_by_key(|k| (self.pixels[*k as usize], *k));
        let mut sorted = Splats::new(self.replicate, self.bands, self.apart);
        let numbers = self.numbers();
        for k in order {
            let k = k as usize;
            let value = &self.values[k * numbers..(k + 1) * numbers];
            if sorted.pixels.last() == Some(&self.pixels[k]) {
                let last = sorted.values.len() - numbers;
                sorted.values[last..].iter_mut().zip(value).for_each(|(a, b)| *a += b);
            } else {
                sorted.pixels.push(self.pixels[k]);
                sorted.values.extend_from_slice(value);
            }
        }
        sorted
    }
}

impl<S> Sums<S> {
    /// The samples that every pixel has.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }
}

impl<S: RowStore> Sums<S> {
    /// Mean number of samples of a pixel, those of the pass under way included.
    pub fn mean_samples(&self) -> f64 {
        let [width, height, _] = self.sums.size();
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        let under_way = f64::from(self.pass_end.saturating_sub(self.samples.end)) * self.tiles as f64 / tiles.max(1) as f64;
        self.samples.len() as f64 + under_way
    }
}

impl<S: RowStore> Sums<S> {
    /// Whether an exposure of a size (pixels a row, rows, bands) and samples can go on from here.
    pub(super) fn belong_to(&self, [width, height, bands]: [usize; 3], wanted: &Range<u32>) -> bool {
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        self.sums.size() == [width, height, 2 * bands]
            && self.samples.start == wanted.start
            && (self.samples.start..=self.pass_end).contains(&self.samples.end)
            && self.pass_end <= wanted.end
            && self.tiles < tiles
            && (self.tiles == 0 || self.pass_end > self.samples.end)
    }

    pub(super) fn add(&mut self, tile: Tile) -> std::io::Result<()> {
        let [width, _, channels] = self.sums.size();
        let stride = tile.width * channels;
        for (i, line) in tile.sums.chunks_exact(stride).enumerate() {
            let start = tile.column * channels;
            let to = &mut self.sums.row_mut(tile.row + i)?[start..start + stride];
            match tile.whole {
                true => to.copy_from_slice(line),
                false => to.iter_mut().zip(line).for_each(|(a, b)| *a += b),
            }
        }
        for (pixel, sums) in tile.outside {
            let start = pixel % width * channels;
            let to = &mut self.sums.row_mut(pixel / width)?[start..start + channels];
            to.iter_mut().zip(sums.iter().flatten()).for_each(|(a, b)| *a += b);
        }
        Ok(())
    }
}

impl<S: RowStore> Sums<S> {
    /// Adds light to the sums of the film's own bands: it is many small parts, and never an outlier. `direct`: where those of direct light begin, if there
    /// are any.
    pub(super) fn add_splats(&mut self, splats: &Splats, direct: Option<usize>) -> std::io::Result<()> {
        let [width, _, channels] = self.sums.size();
        let bands = splats.bands;
        let values = splats.pixels.iter().zip(splats.values.chunks_exact(splats.numbers())).collect::<Vec<_>>();
        for row in values.chunk_by(|a, b| *a.0 as usize / width == *b.0 as usize / width) {
            let to = self.sums.row_mut(*row[0].0 as usize / width)?;
            for (pixel, values) in row {
                let start = **pixel as usize % width * channels;
                let pairs = to[start..start + channels].as_chunks_mut::<2>().0;
                let (all, of_it) = values.split_at(bands);
                pairs[..bands].iter_mut().zip(all).for_each(|(sum, v)| sum[splats.replicate] += v);
                if let Some(direct) = direct {
                    pairs[direct..direct + bands].iter_mut().zip(of_it).for_each(|(sum, v)| sum[splats.replicate] += v);
                }
            }
        }
        Ok(())
    }
}

/// What the sums of an exposure come to.
pub(super) struct Finished {
    pub mean: Raster<f32>,
    pub half_difference: Raster<f32>,
    /// Where fireflies are re-weighted, the fraction of all light that this took away.
    pub removed: Option<f64>,
    /// What of the mean is direct light, where that is recorded.
    pub direct: Option<Raster<f32>>,
}

impl Sums {
    /// Mean and half difference of the replicates, with the starbursts of lamps. `direct`: where the sums of direct light begin, if there are any.
    pub(super) fn finish(
        &self,
        bands: usize,
        cascade: Option<Cascade>,
        starbursts: Option<Starbursts>,
        direct: Option<usize>,
    ) -> Finished {
        let (mut mean, mut half_difference, removed) = self.without_stars(bands, cascade);
        let mut direct = direct.map(|from| self.direct(from, &mean));
        if let Some(starbursts) = starbursts {
            starbursts.spread(&self.sums, &self.samples, [&mut mean, &mut half_difference], direct.as_mut());
        }
        Finished { mean, half_difference, removed, direct }
    }

    /// What of the mean of each band is direct light. What re-weighting takes from a pixel it takes from all its light alike.
    fn direct(&self, from: usize, mean: &Raster<f32>) -> Raster<f32> {
        let bands = mean.channels;
        let mut direct = Raster::new(mean.width, mean.height, bands);
        let pixels = self.sums.data.par_chunks_exact(self.sums.channels);
        pixels.zip(direct.data.par_chunks_mut(bands)).zip(mean.data.par_chunks(bands)).for_each(|((sums, direct), mean)| {
            let (mut all, mut half) = (vec![0.0; bands], vec![0.0; bands]);
            means(&self.samples, &sums[..2 * bands], &mut all, &mut half);
            means(&self.samples, &sums[2 * from..2 * (from + bands)], direct, &mut half);
            for ((direct, all), mean) in direct.iter_mut().zip(&all).zip(mean) {
                *direct *= if mean == all { 1.0 } else { mean / all };
            }
        });
        direct
    }

    fn without_stars(&self, bands: usize, cascade: Option<Cascade>) -> (Raster<f32>, Raster<f32>, Option<f64>) {
        let (width, height) = (self.sums.width, self.sums.height);
        let (mut mean, mut half) = (Raster::new(width, height, bands), Raster::new(width, height, bands));
        let Some(cascade) = cascade else {
            match self.sums.channels == 2 * bands {
                true => means(&self.samples, &self.sums.data, &mut mean.data, &mut half.data),
                false => {
                    let pixels = self.sums.data.par_chunks_exact(self.sums.channels);
                    let planes = mean.data.par_chunks_mut(bands).zip(half.data.par_chunks_mut(bands));
                    let of_pixel = |(sums, (mean, half)): (&[f64], (&mut [f32], &mut [f32]))| {
                        means(&self.samples, &sums[..2 * bands], mean, half);
                    };
                    pixels.zip(planes).for_each(of_pixel);
                }
            }
            return (mean, half, None);
        };
        let stride = width * bands;
        let rows = mean.data.par_chunks_mut(stride).zip(half.data.par_chunks_mut(stride));
        let light: Vec<[f64; 2]> = rows
            .enumerate()
            .map(|(row, (mean, half))| {
                let (sums, light) = cascade.row(&self.sums, bands, row, self.samples.len(), self.groups.as_ref());
                means(&self.samples, &sums, mean, half);
                light
            })
            .collect();
        // Row by row: the same for any number of threads.
        let [before, after] = light.iter().fold([0.0; 2], |sum, l| [sum[0] + l[0], sum[1] + l[1]]);
        let removed = if before > 0.0 { (before - after) / before } else { 0.0 };
        (mean, half, Some(removed))
    }
}

/// Tells the truth of some rows, where it is recorded, what of their mean is direct light and what is not.
pub(super) fn write_direct_truth(truth: &mut Truth, film: &[Band], mean: &Raster<f32>, direct: &Raster<f32>) {
    let (colors, bands) = (colors_of(film), mean.channels);
    for (channel, values) in truth.iter_mut() {
        let Values::Float(to) = values else { continue };
        if channel != DIRECT && channel != INDIRECT {
            continue;
        }
        for (i, pixel) in to.data.chunks_exact_mut(colors.len()).enumerate() {
            for (to, band) in pixel.iter_mut().zip(colors) {
                let [all, direct] = [mean, direct].map(|raster| raster.data[i * bands + band]);
                // Rounding and, where wavelengths arrive apart, noise must not leave less than nothing; both are all light.
                let direct = if film[band].unit == BandUnit::Electrons { direct.clamp(0.0, all.max(0.0)) } else { direct };
                *to = if channel == DIRECT { direct } else { all - direct };
            }
        }
    }
}

/// Mean and half difference of the replicates of some pixels after some samples.
pub(super) fn means(samples: &Range<u32>, sums: &[f64], mean: &mut [f32], half_difference: &mut [f32]) {
    // Even samples are of the first replicate, odd ones of the second.
    let odd = (samples.end / 2 - samples.start / 2) as f64;
    let even = samples.len() as f64 - odd;
    for ((pair, mean), half) in sums.as_chunks::<2>().0.iter().zip(mean).zip(half_difference) {
        // Rounded as sums of single precision are: a plane has no more.
        let (sa, sb) = (f64::from(pair[0] as f32), f64::from(pair[1] as f32));
        *mean = ((sa + sb) / (even + odd)) as f32;
        // A part of one half only says nothing about its own error: call it 100 %, with the sign that makes parts of
        // both halves merge to their difference.
        *half = match (even == 0.0, odd == 0.0) {
            (_, true) => *mean,
            (true, _) => -*mean,
            _ => (0.5 * (sa / even - sb / odd)) as f32,
        };
    }
}

//! What light made on the film: the mean signal of each pixel and band, how sure it is, and the truth beside it.

pub use crate::truth::Truth;

use crate::channels::{ALWAYS, CHANNELS, Channel};
use crate::truth::Recorded;
use crate::{ExposureFacts, ImageError, Raster};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// What the numbers of a focal plane count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BandUnit {
    /// Mean electrons a pixel, quantum efficiency included.
    Electrons,
    /// Spectral radiance weighted by a response, W·m⁻²·sr⁻¹ (or cd/m² where the response is ȳ · 683 lm/W).
    Radiance,
}

/// A response curve over wavelength: a sensor channel or a spectral box.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Band {
    /// Channel name in files.
    pub name: String,
    /// What its numbers count.
    pub unit: BandUnit,
}

/// The exposure before any sensor noise.
///
/// The samples of a pixel are drawn as two independent halves. `mean` is the mean of both, `half_difference` half their
/// difference, with its sign. The square of it is an unbiased estimate of the variance of `mean` for *any* sampler (one
/// degree of freedom a pixel: average over neighbours before use), and because it is linear in the samples, parts rendered
/// apart merge to just what the whole would have given.
#[derive(Clone, Debug, PartialEq)]
pub struct FocalPlane {
    /// What each channel of `mean` is.
    pub bands: Vec<Band>,
    /// Mean signal `[row][column][band]`.
    pub mean: Raster<f32>,
    /// Half the difference of the two half exposures `[row][column][band]`.
    pub half_difference: Raster<f32>,
    /// What is true of each pixel ([`crate::channels`]).
    pub truth: Truth,
    /// How it was made.
    pub facts: ExposureFacts,
}

impl FocalPlane {
    /// An even field: the same signal of each band everywhere, known exactly. `signal`: a value a band, in its unit; panics on another number.
    pub fn even(bands: Vec<Band>, signal: &[f32], [width, height]: [usize; 2], facts: ExposureFacts) -> FocalPlane {
        let mut mean = Raster::new(width, height, bands.len());
        mean.data.chunks_mut(bands.len().max(1)).for_each(|p| p.copy_from_slice(signal));
        FocalPlane {
            half_difference: Raster::new(width, height, bands.len()),
            bands,
            mean,
            truth: Truth::empty(width, height),
            facts,
        }
    }

    /// Pixels a row.
    pub fn width(&self) -> usize {
        self.mean.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.mean.height
    }

    /// Monte Carlo variance of `mean`, `[row][column][band]`, in its unit squared.
    pub fn variance(&self) -> Raster<f32> {
        let mut variance = self.half_difference.clone();
        variance.data.iter_mut().for_each(|d| *d *= *d);
        variance
    }

    /// Some of its rows. Panics on rows that it does not have.
    pub fn rows(&self, rows: Range<usize>) -> FocalPlane {
        FocalPlane {
            bands: self.bands.clone(),
            mean: self.mean.rows(rows.clone()),
            half_difference: self.half_difference.rows(rows.clone()),
            truth: self.truth.rows(rows),
            facts: self.facts.clone(),
        }
    }

    /// A smaller plane to look at: means over blocks of `factor` × `factor` pixels, with the truth of the pixel in the middle of each. Its numbers are those
    /// of one of the pixels before, not of a larger one: it is as bright. A `factor` of 0 counts as 1.
    pub fn reduced(&self, factor: usize) -> FocalPlane {
        FocalPlane {
            bands: self.bands.clone(),
            mean: self.mean.reduced(factor),
            half_difference: self.half_difference.reduced(factor),
            truth: self.truth.thinned(factor),
            facts: self.facts.clone(),
        }
    }

    /// Adds the rows of a plane of the same width and bands below its own. Fails, and adds nothing, on another width, another number of bands or other truth channels.
    pub fn append(&mut self, below: &FocalPlane) -> Result<(), ImageError> {
        self.mean.check_below(&below.mean)?;
        self.half_difference.check_below(&below.half_difference)?;
        self.truth.append(&below.truth)?;
        self.mean.append(&below.mean)?;
        self.half_difference.append(&below.half_difference)
    }

    /// The plane strip by strip.
    pub fn strips(&self) -> Strips<'_> {
        Strips { plane: self, next: 0 }
    }

    /// Joins exposures of different samples of the same picture, weighted by their numbers of samples.
    ///
    /// Fails when sizes, bands, seeds, or facts of the picture ([`ExposureFacts::differences`]) differ, or when two parts hold the same samples.
    pub fn merge(parts: &[FocalPlane]) -> Result<FocalPlane, ImageError> {
        let mut merged = Merged::new(parts.iter().map(FocalPlane::strips).collect())?;
        let [_, height] = merged.size();
        let truth = Truth::missing(merged.recorded().clone(), parts[0].width(), 0);
        let mut whole = FocalPlane { facts: merged.facts().clone(), truth, ..parts[0].clone() };
        for first in (0..height).step_by(STRIP_STEP) {
            let strip = merged.next_rows(STRIP_STEP.min(height - first))?;
            let start = first * whole.mean.width * whole.mean.channels;
            let place = start..start + strip.mean.data.len();
            whole.mean.data[place.clone()].copy_from_slice(&strip.mean.data);
            whole.half_difference.data[place].copy_from_slice(&strip.half_difference.data);
            whole.truth.append(&strip.truth)?;
        }
        Ok(whole)
    }
}

/// Rows of a strip are a multiple of this, but for the last: the rows that our files compress together.
pub const STRIP_STEP: usize = 16;

/// Bytes that a strip takes at most by default: small beside a picture, large enough for all threads to have work.
pub const STRIP_BYTES: usize = 256 << 20;

/// Rows of a strip for which so many bytes are enough: a multiple of [`STRIP_STEP`], one step at least.
pub fn rows_within(bytes: usize, width: usize, bytes_a_pixel: usize) -> usize {
    let rows = bytes / width.saturating_mul(bytes_a_pixel).max(1);
    (rows / STRIP_STEP).max(1) * STRIP_STEP
}

/// Bytes of a pixel of a focal plane in memory: mean and half difference of each band, and the truth that is always recorded. What is asked for beyond it
/// takes [`Recorded::more_bytes`] more.
pub fn bytes_a_pixel(bands: usize) -> usize {
    let truth: usize = CHANNELS[..ALWAYS].iter().map(Channel::bytes).sum();
    2 * 4 * bands + truth
}

/// Even and odd samples that a plane holds: those of the first half exposure, and of the second.
fn halves_of(facts: &ExposureFacts) -> [f64; 2] {
    let odd = facts.ranges().iter().map(|[first, end]| u64::from(end / 2 - first / 2)).sum::<u64>() as f64;
    [f64::from(facts.samples) - odd, odd]
}

/// What the mean and the half difference of a part count for in the half difference of the whole, by their numbers of even and odd samples: that is half of what the means of all even and of all odd samples differ by. Of
/// samples of one half only it is their mean, with the sign of the half.
fn half_weights([even, odd]: [f64; 2], [all_even, all_odd]: [f64; 2]) -> [f64; 2] {
    let part = |samples: f64, all: f64| if all > 0.0 { samples / all } else { 0.0 };
    let sides = [part(even, all_even), part(odd, all_odd)];
    match all_even > 0.0 && all_odd > 0.0 {
        false => [sides[0] - sides[1], 0.0],
        true => [0.5 * (sides[0] - sides[1]), even * odd / (even + odd).max(1.0) * (1.0 / all_even + 1.0 / all_odd)],
    }
}

/// A focal plane that is read or made from the top, strip by strip: no more of it is in memory than is asked for.
pub trait FocalPlaneSource {
    /// Its bands.
    fn bands(&self) -> &[Band];

    /// Its facts.
    fn facts(&self) -> &ExposureFacts;

    /// Which truth channels it holds.
    fn recorded(&self) -> &Recorded;

    /// Pixels a row, rows.
    fn size(&self) -> [usize; 2];

    /// Rows that are best asked for at once: a multiple of [`STRIP_STEP`].
    fn rows_at_once(&self) -> usize {
        rows_within(STRIP_BYTES, self.size()[0], bytes_a_pixel(self.bands().len()) + self.recorded().more_bytes())
    }

    /// The next rows. Fails when there are fewer.
    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError>;
}

/// The error of a [`FocalPlaneSource`] of which more rows are asked for than there are.
pub fn ends_early() -> ImageError {
    ImageError::Malformed { format: "focal plane", reason: "it ends early".into() }
}

/// A focal plane in memory as a [`FocalPlaneSource`].
#[derive(Clone, Debug)]
pub struct Strips<'a> {
    plane: &'a FocalPlane,
    /// Rows that were taken.
    next: usize,
}

impl FocalPlaneSource for Strips<'_> {
    fn bands(&self) -> &[Band] {
        &self.plane.bands
    }

    fn facts(&self) -> &ExposureFacts {
        &self.plane.facts
    }

    fn recorded(&self) -> &Recorded {
        self.plane.truth.recorded()
    }

    fn size(&self) -> [usize; 2] {
        [self.plane.width(), self.plane.height()]
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        if rows > self.plane.height() - self.next {
            return Err(ends_early());
        }
        let strip = self.plane.rows(self.next..self.next + rows);
        self.next += rows;
        Ok(strip)
    }
}

/// Exposures of different samples of the same picture, joined strip by strip: weighted by their numbers of samples, in the order of these. Truth
/// along one ray is that of the part that was given first, truth by coverage is weighted as the light is; channels that a part lacks are left out.
#[derive(Debug)]
pub struct Merged<S> {
    /// In the order of their samples.
    parts: Vec<S>,
    /// Which of them was given first.
    first: usize,
    facts: ExposureFacts,
    /// Truth channels that all parts hold.
    recorded: Recorded,
    /// Samples of all parts.
    total: f64,
}

impl<S: FocalPlaneSource> Merged<S> {
    /// Merges at least one part. Fails when sizes, bands, seeds, or facts of the picture ([`ExposureFacts::differences`]) differ, or when two parts hold the same samples.
    pub fn new(parts: Vec<S>) -> Result<Self, ImageError> {
        let mismatch = |what: String| Err(ImageError::Mismatch(what));
        let mut parts: Vec<(usize, S)> = parts.into_iter().enumerate().collect();
        parts.sort_by_key(|(_, p)| p.facts().first_sample);
        let Some(first) = parts.iter().position(|(given, _)| *given == 0) else {
            return mismatch("no files were given".into());
        };
        let parts: Vec<S> = parts.into_iter().map(|(_, part)| part).collect();
        for pair in parts.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            if (a.size(), a.bands()) != (b.size(), b.bands()) {
                return mismatch(format!(
                    "one has {} × {} pixels in {} bands, another {} × {} in {}",
                    a.size()[0],
                    a.size()[1],
                    a.bands().len(),
                    b.size()[0],
                    b.size()[1],
                    b.bands().len()
                ));
            }
            if a.facts().seed != b.facts().seed {
                return mismatch(format!("seeds {} and {} differ", a.facts().seed, b.facts().seed));
            }
            let differences = a.facts().differences(b.facts());
            if !differences.is_empty() {
                return mismatch(format!("they are not of one picture: they differ in {}", differences.join(", ")));
            }
        }
        // Neighbours agree, but for those that do not know.
        let mut settings: Vec<&str> = parts.iter().map(|p| p.facts().settings_hash.as_str()).filter(|s| !s.is_empty()).collect();
        settings.dedup();
        if settings.len() > 1 {
            return mismatch("they are not of one picture: settings of scene, camera or paths differ".into());
        }
        let mut ranges: Vec<[u32; 2]> =
            parts.iter().flat_map(|p| p.facts().ranges()).filter(|[first, end]| first < end).collect();
        ranges.sort_unstable();
        let mut joined: Vec<[u32; 2]> = Vec::new();
        for [first, end] in ranges {
            match joined.last_mut() {
                Some(last) if first < last[1] => {
                    return mismatch(format!("samples {first}..{} are in two of them", end.min(last[1])));
                }
                Some(last) if first == last[1] => last[1] = end,
                _ => joined.push([first, end]),
            }
        }
        let total: f64 = parts.iter().map(|p| f64::from(p.facts().samples)).sum();
        if total == 0.0 {
            return mismatch("they hold no samples".into());
        }
        let first_sample = joined.first().map_or(0, |range| range[0]);
        let sample_ranges = if joined.len() > 1 { joined } else { Vec::new() };
        let facts = ExposureFacts { first_sample, samples: total as u32, sample_ranges, ..parts[first].facts().clone() };
        let mut recorded = parts.iter().fold(parts[first].recorded().clone(), |common, part| common.common(part.recorded()));
        recorded.samples = parts.iter().map(|p| p.recorded().samples).sum();
        Ok(Merged { parts, first, facts, recorded, total })
    }

    /// Parts that are merged.
    pub fn parts(&self) -> usize {
        self.parts.len()
    }
}

impl<S: FocalPlaneSource> FocalPlaneSource for Merged<S> {
    fn bands(&self) -> &[Band] {
        self.parts[self.first].bands()
    }

    fn facts(&self) -> &ExposureFacts {
        &self.facts
    }

    fn recorded(&self) -> &Recorded {
        &self.recorded
    }

    fn size(&self) -> [usize; 2] {
        self.parts[self.first].size()
    }

    fn rows_at_once(&self) -> usize {
        // The sums, the part that was given first and the one that is read.
        let bands = self.bands().len();
        let more = self.parts.iter().map(|p| p.recorded().more_bytes()).max().unwrap_or(0);
        rows_within(STRIP_BYTES, self.size()[0], 2 * 8 * bands + 2 * (bytes_a_pixel(bands) + more))
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let numbers = self.size()[0] * rows * self.bands().len();
        let mut sums = [vec![-0.0f64; numbers], vec![-0.0f64; numbers]];
        let (mut whole, mut truth): (_, Option<Truth>) = (None, None);
        let mut so_far = 0.0;
        let halves = self.parts.iter().map(|part| halves_of(part.facts()));
        let halves = halves.fold([0.0; 2], |[even, odd], part| [even + part[0], odd + part[1]]);
        for (k, part) in self.parts.iter_mut().enumerate() {
            let mut strip = part.next_rows(rows)?;
            let samples = f64::from(part.facts().samples);
            let [of_mean, of_half] = half_weights(halves_of(part.facts()), halves);
            let [means, differences] = &mut sums;
            for ((mean, half), (m, h)) in
                means.iter_mut().zip(differences).zip(strip.mean.data.iter().zip(&strip.half_difference.data))
            {
                *mean += f64::from(*m) * samples;
                *half += f64::from(*m) * of_mean + f64::from(*h) * of_half;
            }
            let own = std::mem::replace(&mut strip.truth, Truth::empty(0, 0)).only(&self.recorded);
            match &mut truth {
                None => truth = Some(own),
                Some(truth) => {
                    truth.merge(&own, [so_far, samples]);
                    if k == self.first {
                        truth.copy_nearest(&own);
                    }
                }
            }
            so_far += samples;
            if k == self.first {
                whole = Some(strip);
            }
        }
        let mut whole = whole.expect("the part that was given first is one of the parts");
        whole.truth = truth.expect("there is a part");
        let [means, differences] = &sums;
        whole.mean.data.iter_mut().zip(means).for_each(|(v, sum)| *v = (sum / self.total) as f32);
        whole.half_difference.data.iter_mut().zip(differences).for_each(|(v, sum)| *v = *sum as f32);
        whole.facts = self.facts.clone();
        Ok(whole)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(first_sample: u32, samples: u32, value: f32) -> FocalPlane {
        let mut mean = Raster::new(2, 1, 1);
        mean.data.fill(value);
        FocalPlane {
            bands: vec![Band { name: "Y".into(), unit: BandUnit::Electrons }],
            half_difference: Raster::new(2, 1, 1),
            mean,
            truth: Truth::empty(2, 1),
            facts: ExposureFacts { first_sample, samples, ..Default::default() },
        }
    }

    #[test]
    fn parts_merge_by_their_numbers_of_samples() {
        let whole = FocalPlane::merge(&[part(10, 30, 2.0), part(0, 10, 1.0)]).unwrap();
        assert_eq!(whole.mean.data, [1.75, 1.75]);
        assert_eq!((whole.facts.first_sample, whole.facts.samples), (0, 40));
    }

    #[test]
    fn how_an_exposure_was_chosen_does_not_keep_parts_apart() {
        let mut a = part(0, 10, 1.0);
        (a.facts.exposure_s, a.facts.scene) = (0.01, "room".into());
        let mut b = FocalPlane { facts: ExposureFacts { first_sample: 10, ..a.facts.clone() }, ..a.clone() };
        (b.facts.metered_ev100, b.facts.metering, b.facts.mode) = (Some(9.1), "spot".into(), "A".into());
        (b.facts.compensation_ev, b.facts.iso_set, b.facts.focus_mode) = (1.0, 800.0, "auto (phase)".into());
        assert!(FocalPlane::merge(&[a.clone(), b.clone()]).is_ok());
        b.facts.exposure_s = 0.02;
        assert!(FocalPlane::merge(&[a.clone(), b.clone()]).is_err());
        (b.facts.exposure_s, b.facts.scene) = (0.01, "garden".into());
        let told = FocalPlane::merge(&[a.clone(), b.clone()]).unwrap_err().to_string();
        assert!(told.contains("scene (\"room\" and \"garden\")"), "{told}");
        // Where the camera stood, where both know it.
        b.facts.scene = "room".into();
        b.facts.settings_hash = "1".into();
        assert!(FocalPlane::merge(&[a.clone(), b.clone()]).is_ok());
        a.facts.settings_hash = "2".into();
        let told = FocalPlane::merge(&[a, b]).unwrap_err().to_string();
        assert!(told.contains("where it stands"), "{told}");
    }

    #[test]
    fn strips_merge_to_what_the_wholes_merge_to() {
        let part = |first_sample: u32, samples: u32| {
            let raster = |phase: f64| {
                let mut raster = Raster::<f32>::new(3, 37, 2);
                let wave = |i: usize| (i as f64 * 0.7 + phase + f64::from(first_sample)).sin() as f32;
                raster.data.iter_mut().enumerate().for_each(|(i, v)| *v = wave(i));
                raster
            };
            let mut truth = Truth::empty(3, 37);
            truth.id_mut().data.fill(first_sample + 1);
            FocalPlane {
                bands: ["A", "B"].map(|n| Band { name: n.into(), unit: BandUnit::Electrons }).to_vec(),
                mean: raster(0.0),
                half_difference: raster(2.0),
                truth,
                facts: ExposureFacts { first_sample, samples, ..Default::default() },
            }
        };
        let parts = [part(7, 3), part(0, 5), part(5, 2)];
        let whole = FocalPlane::merge(&parts).unwrap();
        let mut merged = Merged::new(parts.iter().map(FocalPlane::strips).collect()).unwrap();
        let mut strips = merged.next_rows(1).unwrap();
        for rows in [16, 20] {
            strips.append(&merged.next_rows(rows).unwrap()).unwrap();
        }
        assert!(merged.next_rows(1).is_err());
        assert_eq!(strips, whole);
        // Rows of fewer bands do not fit, and leave all of it as it is.
        let narrow = FocalPlane { mean: Raster::new(3, 37, 1), ..part(0, 5) };
        assert!(strips.append(&narrow).is_err());
        assert_eq!(strips, whole);
        // Truth of the part that was given first, and by hand the number of a pixel.
        assert_eq!((whole.truth.id().data[0], whole.facts.first_sample, whole.facts.samples), (8, 0, 10));
        let by_hand = (f64::from(parts[1].mean.data[50]) * 5.0
            + f64::from(parts[2].mean.data[50]) * 2.0
            + f64::from(parts[0].mean.data[50]) * 3.0)
            / 10.0;
        assert_eq!(whole.mean.data[50], by_hand as f32);
    }

    #[test]
    fn parts_of_odd_samples_merge_to_the_whole() {
        // Samples of a pixel as they are summed: mean, and half of what the means of even and odd ones differ by.
        let value = |sample: u32| 3.0 + (f64::from(sample) * 1.7).sin();
        let plane = |first: u32, end: u32| {
            let mean_of = |odd: u32| {
                let half: Vec<f64> = (first..end).filter(|k| k % 2 == odd).map(value).collect();
                (!half.is_empty()).then(|| half.iter().sum::<f64>() / half.len() as f64)
            };
            let mean = (first..end).map(value).sum::<f64>() / f64::from(end - first);
            let half = match [mean_of(0), mean_of(1)] {
                [Some(even), Some(odd)] => 0.5 * (even - odd),
                [None, _] => -mean,
                [_, None] => mean,
            };
            let raster = |v: f64| Raster { data: vec![v as f32], ..Raster::new(1, 1, 1) };
            FocalPlane {
                bands: vec![Band { name: "A".into(), unit: BandUnit::Electrons }],
                mean: raster(mean),
                half_difference: raster(half),
                truth: Truth::empty(1, 1),
                facts: ExposureFacts { first_sample: first, samples: end - first, ..Default::default() },
            }
        };
        let whole = plane(0, 16);
        for cuts in [&[0, 8, 16][..], &[0, 5, 16], &[0, 3, 6, 9, 12, 16], &[0, 1, 2, 3, 16], &[0, 15, 16]] {
            let parts: Vec<FocalPlane> = cuts.windows(2).map(|c| plane(c[0], c[1])).collect();
            let merged = FocalPlane::merge(&parts).unwrap();
            for (found, expected) in [(&merged.mean, &whole.mean), (&merged.half_difference, &whole.half_difference)] {
                assert!((found.data[0] - expected.data[0]).abs() < 1e-5, "{cuts:?}: {} {}", found.data[0], expected.data[0]);
            }
        }
        // In two steps, with samples that are missing in between; none of them counts twice.
        for [a, b] in [[5, 12], [4, 9], [3, 10]] {
            let gap = FocalPlane::merge(&[plane(b, 16), plane(0, a)]).unwrap();
            assert_eq!(gap.facts.ranges(), [[0, a], [b, 16]]);
            let merged = FocalPlane::merge(&[gap.clone(), plane(a, b)]).unwrap();
            assert_eq!((merged.facts.ranges(), merged.facts.samples), (vec![[0, 16]], 16));
            for (found, expected) in [(&merged.mean, &whole.mean), (&merged.half_difference, &whole.half_difference)] {
                assert!((found.data[0] - expected.data[0]).abs() < 1e-5, "{a} {b}: {} {}", found.data[0], expected.data[0]);
            }
            let twice = FocalPlane::merge(&[gap, plane(a, b + 1)]).unwrap_err().to_string();
            assert!(twice.contains(&format!("samples {b}..{} are in two", b + 1)), "{twice}");
        }
        // One half alone.
        let odd = FocalPlane::merge(&[plane(1, 2), plane(3, 4)]).unwrap();
        assert_eq!(odd.half_difference.data[0], -odd.mean.data[0]);
    }

    #[test]
    fn the_same_samples_twice_are_refused() {
        let error = FocalPlane::merge(&[part(0, 10, 1.0), part(5, 10, 1.0)]).unwrap_err();
        assert!(error.to_string().contains("samples 5..10"), "{error}");
    }
}

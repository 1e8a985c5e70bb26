//! What light made on the film: the mean signal of each pixel and band, how sure it is, and the truth beside it.

use crate::{ExposureFacts, ImageError, Raster};
use serde::{Deserialize, Serialize};

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

/// Ground truth along the chief ray of each pixel's centre (unblurred).
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Distance along the camera's axis, m; infinite where nothing is hit.
    pub depth: Raster<f32>,
    /// World-space shading normal towards the camera; 0 where nothing is hit.
    pub normal: Raster<f32>,
    /// Albedo, linear sRGB.
    pub albedo: Raster<f32>,
    /// Object number + 1; 0 where nothing is hit.
    pub id: Raster<u32>,
}

impl Truth {
    /// Nothing hit anywhere.
    pub fn empty(width: usize, height: usize) -> Self {
        let mut depth = Raster::new(width, height, 1);
        depth.data.fill(f32::INFINITY);
        Truth {
            depth,
            normal: Raster::new(width, height, 3),
            albedo: Raster::new(width, height, 3),
            id: Raster::new(width, height, 1),
        }
    }
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
    /// Depth, normals, albedo, ids.
    pub truth: Truth,
    /// How it was made.
    pub facts: ExposureFacts,
}

impl FocalPlane {
    /// An even field: the same signal of each band everywhere, known exactly.
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

    /// Joins exposures of different samples of the same picture, weighted by their numbers of samples.
    ///
    /// Fails when sizes, bands, seeds or cameras differ, or when two parts hold the same samples.
    pub fn merge(parts: &[FocalPlane]) -> Result<FocalPlane, ImageError> {
        let mismatch = |what: String| Err(ImageError::Mismatch(what));
        let Some(first) = parts.first() else {
            return mismatch("no files were given".into());
        };
        let mut parts: Vec<&FocalPlane> = parts.iter().collect();
        parts.sort_by_key(|p| p.facts.first_sample);
        for pair in parts.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let same = |x: &FocalPlane| (x.width(), x.height(), x.bands.clone());
            if same(a) != same(b) {
                return mismatch(format!(
                    "one has {} × {} pixels in {} bands, another {} × {} in {}",
                    a.width(),
                    a.height(),
                    a.bands.len(),
                    b.width(),
                    b.height(),
                    b.bands.len()
                ));
            }
            if a.facts.seed != b.facts.seed {
                return mismatch(format!("seeds {} and {} differ", a.facts.seed, b.facts.seed));
            }
            if a.facts.of_picture() != b.facts.of_picture() {
                return mismatch("they were not taken with the same scene, camera and exposure".into());
            }
            let end = a.facts.first_sample + a.facts.samples;
            if b.facts.first_sample < end {
                return mismatch(format!("samples {}..{end} are in two of them", b.facts.first_sample));
            }
        }
        let total: f64 = parts.iter().map(|p| p.facts.samples as f64).sum();
        if total == 0.0 {
            return mismatch("they hold no samples".into());
        }
        let mut whole = first.clone();
        let sum = |field: &dyn Fn(&FocalPlane) -> &Vec<f32>, i: usize| {
            (parts.iter().map(|p| field(p)[i] as f64 * p.facts.samples as f64).sum::<f64>() / total) as f32
        };
        for i in 0..whole.mean.data.len() {
            whole.mean.data[i] = sum(&|p| &p.mean.data, i);
            whole.half_difference.data[i] = sum(&|p| &p.half_difference.data, i);
        }
        whole.facts.first_sample = parts[0].facts.first_sample;
        whole.facts.samples = total as u32;
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
        assert!(FocalPlane::merge(&[a, b]).is_err());
    }

    #[test]
    fn the_same_samples_twice_are_refused() {
        let error = FocalPlane::merge(&[part(0, 10, 1.0), part(5, 10, 1.0)]).unwrap_err();
        assert!(error.to_string().contains("samples 5..10"), "{error}");
    }
}

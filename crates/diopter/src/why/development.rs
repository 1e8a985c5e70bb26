//! What demosaicing and noise reduction do to an edge as soft as the image is: developed with and without them.
//!
//! A raw image of two slanted edges' worth of light (2 : 1, about as bright as the place is, neutral, without noise of its own but with the noise profile of
//! the read-out, which is what noise reduction goes by) is developed up to the noise reduction; e-SFR measures it ([`crate::measure::mtf`]). The variance of
//! the Gaussian with its frequency of half response, less that of the same edge developed without the step, is what the step adds. Methods adapt to what they see: the
//! numbers are those of clean edges; texture that is hardly above the noise loses more.

use crate::measure::Plane;
use crate::measure::mtf::{Options, measure};
use crate::shot::ShotError;
use diopter_develop::{Developer, Noise, Recipe, Step};
use diopter_image::{Cfa, PictureSource, Raster, RawHeader, RawImage};
use diopter_light::color::srgb_decode;
use std::f64::consts::{LN_2, PI};

/// Pixels a side of the raw image; filter patterns of 2 and 6 fit.
const SIDE: usize = 96;
/// Slant of the edge: the tangent of 5.7°.
const SLANT: f64 = 0.1;
/// Fractions of the level of the place that both sides of the edge have.
const SIDES: [f64; 2] = [2.0 / 3.0, 4.0 / 3.0];
/// Levels, as fractions of saturation, between which an edge is neither lost in rounding nor clipped.
const LEVELS: [f64; 2] = [0.01, 0.6];
/// Softness of the edge, pixels: sharper ones alias, and wider ones do not fit.
const SIGMAS_PX: [f64; 2] = [0.4, 4.0];
/// Full scale of the raw image: all 16 bits, so that rounding is small.
const FULL: f64 = 65_535.0;

/// Distribution function of a normal variable: Abramowitz & Stegun 7.1.26 for the error function, 1.5e-7 exact.
fn normal_below(x: f64) -> f64 {
    let z = x.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let p = t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let tail = 0.5 * p * (-z * z).exp();
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// A raw image of an edge: `header` says pattern and neutral, `turned` whether it lies along the rows.
fn edge(header: &RawHeader, level: f64, sigma_px: f64, turned: bool) -> RawImage {
    let mut mosaic = Raster::<u16>::new(SIDE, SIDE, 1);
    let middle = 0.5 * SIDE as f64;
    for row in 0..SIDE {
        for column in 0..SIDE {
            let (x, y) = (column as f64 + 0.5 - middle, row as f64 + 0.5 - middle);
            let (across, along) = if turned { (y, x) } else { (x, y) };
            let distance = (across - SLANT * along) / (1.0 + SLANT * SLANT).sqrt();
            let light = SIDES[0] + (SIDES[1] - SIDES[0]) * normal_below(distance / sigma_px);
            let neutral = header.as_shot_neutral.get(header.cfa.channel_at(column, row)).copied().unwrap_or(1.0);
            mosaic.pixel_mut(column, row)[0] = (level * light * neutral * FULL).round().clamp(0.0, FULL) as u16;
        }
    }
    RawImage { mosaic, header: header.clone() }
}

/// Variance (px²) of the Gaussian as soft as both edges are on average after development up to a step.
fn variance(header: &RawHeader, recipe: &Recipe, until: Step, level: f64, sigma_px: f64) -> Result<Option<f64>, ShotError> {
    let mut sum = 0.0;
    for turned in [false, true] {
        let raw = edge(header, level, sigma_px, turned);
        let picture = Developer::new(&raw, recipe, None)?.until(until).whole();
        // Green, or the only channel; steps before the encoding are shown by the sRGB function.
        let values = picture.pixels.data.as_chunks::<3>().0.iter().map(|p| srgb_decode(p[1])).collect();
        let (width, height) = (picture.pixels.width, picture.pixels.height);
        let plane = Plane { width, height, values, limits: [f32::NEG_INFINITY, f32::INFINITY], clipped: None };
        let options = Options { order: 1, ..Options::default() };
        let Some(half) = measure(&plane, plane.whole(), &options).ok().and_then(|e| e.mtf50) else { return Ok(None) };
        // A picture of halved pixels has fewer of them.
        let scale = SIDE as f64 / width as f64;
        sum += 0.5 * 0.5 * LN_2 * (scale / (PI * half)).powi(2);
    }
    Ok(Some(sum))
}

/// Variances along an axis (px²) that demosaicing and noise reduction add to an edge that has the blur `sigma_px` (standard deviation along an axis) before
/// them, at a place with a level (fraction of saturation). `header`: of the read-out. What cannot be measured adds nothing.
pub(super) fn added(header: &RawHeader, recipe: &Recipe, level: f64, sigma_px: f64) -> Result<[f64; 2], ShotError> {
    let level = level.clamp(LEVELS[0], LEVELS[1]);
    let sigma_px = sigma_px.clamp(SIGMAS_PX[0], SIGMAS_PX[1]);
    let header = RawHeader {
        bits: 16,
        black_level: 0.0,
        white_level: FULL,
        baseline_ev: 0.0,
        opcodes: vec![],
        framing: Default::default(),
        ..header.clone()
    };
    // As the camera balances: the edge is neutral.
    let reduced = Recipe { demosaic: recipe.demosaic.clone(), noise: recipe.noise.clone(), ..Recipe::default() };
    let plain = Recipe { noise: Noise { luminance: 0.0, color: 0.0 }, ..reduced.clone() };
    let sampled = RawHeader {
        cfa: Cfa::monochrome(),
        as_shot_neutral: vec![1.0],
        calibrations: vec![],
        noise: header.noise.iter().take(1).copied().collect(),
        ..header.clone()
    };
    let of = |header: &RawHeader, recipe: &Recipe, until: Step| variance(header, recipe, until, level, sigma_px);
    let (Some(before), Some(demosaiced), Some(denoised)) = (
        of(&sampled, &plain, Step::Demosaic)?,
        of(&header, &plain, Step::Demosaic)?,
        of(&header, &reduced, Step::NoiseReduction)?,
    ) else {
        return Ok([0.0; 2]);
    };
    // A method that sharpens adds no blur.
    Ok([(demosaiced - before).max(0.0), (denoised - demosaiced).max(0.0)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_develop::{Demosaic, DemosaicStep};
    use diopter_image::{ExposureFacts, FocalPlane};
    use diopter_light::cie::illuminant;
    use diopter_sensor::{Reading, Sensor, read_out};

    fn header(name: &str) -> RawHeader {
        let sensor = Sensor::named(name).unwrap();
        let facts = ExposureFacts { exposure_s: 0.01, ..Default::default() };
        let signal = vec![1000.0; sensor.cfa.channel_count()];
        let plane = FocalPlane::even(sensor.bands(), &signal, [12, 12], facts);
        read_out(&plane, &sensor, &Reading::new(sensor.iso[0].iso, 1), &illuminant("D65").unwrap()).unwrap().header
    }

    #[test]
    fn an_edge_is_as_soft_as_it_is_made() {
        // Half response of a Gaussian; e-SFR of clean edges is within 1 % there.
        let sampled = RawHeader { bits: 16, black_level: 0.0, white_level: FULL, ..header("imx249") };
        for sigma in [0.6, 1.5] {
            let found = variance(&sampled, &Recipe::default(), Step::Demosaic, 0.3, sigma).unwrap().unwrap();
            assert!((found / (sigma * sigma) - 1.0).abs() < 0.03, "{sigma}: {found}");
        }
    }

    #[test]
    fn a_monochrome_sensor_has_nothing_to_demosaic_and_bilinear_softens() {
        assert_eq!(added(&header("imx249"), &Recipe::default(), 0.2, 0.6).unwrap(), [0.0; 2]);
        let with = |method| Recipe { demosaic: DemosaicStep { method, ..DemosaicStep::default() }, ..Recipe::default() };
        let of = |method| added(&header("canon-t2i"), &with(method), 0.2, 0.6).unwrap()[0];
        let (bilinear, gbtf) = (of(Demosaic::Bilinear), of(Demosaic::Gbtf));
        // Green of the mean of four neighbours in half of the pixels: a variance of a quarter of a pixel² along an axis there; adaptive methods add less.
        assert!(bilinear > 0.08 && bilinear < 0.5 && gbtf < bilinear, "{bilinear} {gbtf}");
        let mut noisy = with(Demosaic::Bilinear);
        noisy.noise = Noise { luminance: 1.0, color: 1.0 };
        let [demosaiced, denoised] = added(&header("canon-t2i"), &noisy, 0.2, 0.6).unwrap();
        assert!((demosaiced - bilinear).abs() < 1e-12 && denoised >= 0.0, "{demosaiced} {denoised}");
    }
}

//! Why a pixel is as bright as it is, and what its noise consists of.
//!
//! Brightness is a chain of factors from the luminance of the scene to the light of the display, each found by leaving that part out: E = π L / (4 T²), the camera
//! equation by T-number, changed by what focusing and the place in the picture do to the solid angle of the pupil, × time × area of the pixel =
//! lumen seconds; electrons for each of them by the colour of the light and the sensor; ISO speed; development.
//!
//! Noise follows EMVA 1288: variances of independent causes add. Each is the variance that a read-out is expected to add ([`ReadOut::expected`]) less that
//! of a sensor without the cause.

use super::spot::{Moving, Spot, Subject, spot};
use crate::camera::Camera;
use crate::expose::{Diffraction, Exposure, PixelBlock, Response, Settings};
use crate::mount::M2_PER_MM2;
use crate::shot::{Shot, ShotError, white_point};
use crate::shutter::{Place, Shutter};
use diopter_develop::{Developer, Recipe, Step};
use diopter_image::focal_plane::BandUnit;
use diopter_image::{ExposureFacts, PictureSource, Raster, RawHeader, RawImage};
use diopter_light::color::srgb_decode;
use diopter_sensor::{DarkCurrent, HotPixels, ReadOut, Reading, Sensor, SensorError, Window};
use serde::Serialize;
use std::f64::consts::PI;

/// A factor of the chain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Factor {
    /// What it is.
    pub name: &'static str,
    /// What it multiplies by.
    pub factor: f64,
    /// Unit of the product up to here; empty for a number.
    pub unit: &'static str,
    /// The product up to here, this factor included.
    pub product: f64,
    /// How it comes about.
    pub because: String,
}

/// What made a place as bright as it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Brightness {
    /// Luminance of what is seen there, mean over the pixel, the pupil and the time, cd/m².
    pub luminance: f64,
    /// From the luminance to the value.
    pub factors: Vec<Factor>,
    /// Luminance of the developed picture there, 1 = white of the display.
    pub value: f64,
    /// Codes of the developed picture there, red, green and blue, 1 = white.
    pub codes: [f64; 3],
    /// Mean electrons of light in the pixel.
    pub electrons: f64,
    /// The same over those that saturate it.
    pub of_saturation: f64,
    /// Filter of the pixel.
    pub channel: String,
}

/// A part of the noise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NoiseTerm {
    /// What it is.
    pub name: &'static str,
    /// Standard deviation, electrons.
    pub electrons: f64,
    /// Fraction of the variance of all terms.
    pub fraction: f64,
    /// Whether it is the same in every picture (`fixed`), new in each (`temporal`), or of the computation (`renderer`).
    pub kind: &'static str,
}

/// What the noise of a pixel consists of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// Its parts.
    pub terms: Vec<NoiseTerm>,
    /// Standard deviation of what is new in each picture, electrons.
    pub temporal_e: f64,
    /// Standard deviation of all parts, electrons.
    pub total_e: f64,
    /// Standard deviation of all parts but the renderer's, electrons: what a real camera's would be.
    pub camera_e: f64,
    /// Electrons of light over `camera_e`.
    pub camera_signal_to_noise: f64,
    /// Electrons of light over `total_e`.
    pub signal_to_noise: f64,
    /// Whether the pixel is full: its noise is then cut off.
    pub clipped: bool,
}

/// A pixel of a sensor that is read, with even light around it.
pub(super) struct Pixel<'a> {
    pub sensor: &'a Sensor,
    pub reading: &'a Reading,
    /// Column and row.
    pub at: [usize; 2],
    /// Mean electrons of each channel.
    pub bands: Vec<f64>,
    /// Time for which it gathers dark current, s.
    pub dark_s: f64,
}

/// A sensor without a fixed pattern.
fn even(sensor: &Sensor) -> Sensor {
    let (prnu, dsnu_e, dsnu_row_e, dsnu_column_e, hot_pixels) = (0.0, 0.0, 0.0, 0.0, HotPixels::default());
    Sensor { prnu, dsnu_e, dsnu_row_e, dsnu_column_e, hot_pixels, ..sensor.clone() }
}

impl Pixel<'_> {
    /// What is expected of the pixel when an (even) sensor reads it, light times a factor.
    fn expected(&self, sensor: &Sensor, light: f64) -> Result<(diopter_sensor::read_out::Expected, RawHeader), SensorError> {
        let cfa = &sensor.cfa;
        // Whole patterns around it, so that its neighbours are its own.
        let size = [3 * cfa.columns(), 3 * cfa.rows()];
        let place = [self.at[0] % cfa.columns() + cfa.columns(), self.at[1] % cfa.rows() + cfa.rows()];
        let bands: Vec<f32> = self.bands.iter().map(|e| (e * light) as f32).collect();
        let plane: Vec<f32> = bands.iter().copied().cycle().take(bands.len() * size[0] * size[1]).collect();
        let reader = ReadOut::new(sensor, self.reading, size, &sensor.bands(), self.dark_s)?;
        let expected = reader.expected(&Window { first: 0, data: &plane }, place[1])[place[0]];
        let white = diopter_light::cie::illuminant(&self.reading.white)
            .or_else(|| diopter_light::cie::illuminant("D65"))
            .ok_or_else(|| SensorError::Unknown { what: "illuminant", found: self.reading.white.clone(), hint: String::new() })?;
        Ok((expected, reader.header(&ExposureFacts::default(), &white)))
    }

    /// Mean electrons of light of the pixel, crosstalk included. Fails on a reading out of the body's ranges.
    pub fn electrons(&self) -> Result<f64, SensorError> {
        Ok(f64::from(self.expected(&even(self.sensor), 1.0)?.0.electrons))
    }

    /// The parts of its noise; `renderer_variance`: of its electrons by the samples of the exposure, e⁻². Fails as [`Pixel::electrons`].
    pub fn noise(&self, renderer_variance: f64) -> Result<Noise, SensorError> {
        let sensor = even(self.sensor);
        let variance =
            |sensor: &Sensor, light: f64| -> Result<f64, SensorError> { Ok(f64::from(self.expected(sensor, light)?.0.variance)) };
        let (all, _) = self.expected(&sensor, 1.0)?;
        let whole = f64::from(all.variance);
        let without = |change: &dyn Fn(&mut Sensor)| -> Result<f64, SensorError> {
            let mut changed = sensor.clone();
            change(&mut changed);
            Ok((whole - variance(&changed, 1.0)?).max(0.0))
        };
        let dark = without(&|s| s.dark_current = DarkCurrent::default())?;
        let read = without(&|s| {
            s.iso.iter_mut().for_each(|i| i.read_noise_e = 0.0);
            s.second_reading.iter_mut().for_each(|r| r.read_noise_e = 0.0);
        })?;
        let rows = without(&|s| s.iso.iter_mut().for_each(|i| i.row_noise_e = 0.0))?;
        // What is left of a sensor that does nothing else is rounding.
        let rounding = {
            let mut quiet = sensor.clone();
            quiet.dark_current = DarkCurrent::default();
            quiet.iso.iter_mut().for_each(|i| (i.read_noise_e, i.row_noise_e) = (0.0, 0.0));
            quiet.second_reading = None;
            if whole > 0.0 { variance(&quiet, 0.0)? } else { 0.0 }
        };
        let photons = (whole - dark - read - rows - rounding).max(0.0);
        let (s, light, leak) = (self.sensor, f64::from(all.electrons), f64::from(all.dark));
        // Of a full pixel nothing differs but where it is full.
        let open = if all.clipped { 0.0 } else { 1.0 };
        let offsets = s.dsnu_e.powi(2) + s.dsnu_row_e.powi(2) + s.dsnu_column_e.powi(2);
        // Leaks are 1, of hot pixels 1 + an exponential of mean f: variance p 2f² − (p f)².
        let hot =
            s.hot_pixels.fraction * 2.0 * s.hot_pixels.factor.powi(2) - (s.hot_pixels.fraction * s.hot_pixels.factor).powi(2);
        let terms = [
            ("photon shot noise", photons, "temporal"),
            ("dark current shot noise", dark, "temporal"),
            ("read noise", read, "temporal"),
            ("row noise", rows, "temporal"),
            ("quantisation", rounding, "temporal"),
            ("photo response non-uniformity (PRNU)", open * (s.prnu * light).powi(2), "fixed"),
            ("dark signal non-uniformity (DSNU, hot pixels)", open * (offsets + hot * leak * leak), "fixed"),
            ("renderer (Monte Carlo)", open * renderer_variance, "renderer"),
        ];
        let sum: f64 = terms.iter().map(|t| t.1).sum();
        let term = |(name, variance, kind): (&'static str, f64, &'static str)| NoiseTerm {
            name,
            electrons: variance.sqrt(),
            fraction: if sum > 0.0 { variance / sum } else { 0.0 },
            kind,
        };
        let camera: f64 = terms.iter().filter(|t| t.2 != "renderer").map(|t| t.1).sum();
        let over = |variance: f64| if variance > 0.0 { light / variance.sqrt() } else { 0.0 };
        Ok(Noise {
            camera_e: camera.sqrt(),
            camera_signal_to_noise: over(camera),
            terms: terms.map(term).to_vec(),
            temporal_e: whole.sqrt(),
            total_e: sum.sqrt(),
            signal_to_noise: over(sum),
            clipped: all.clipped,
        })
    }

    /// What a raw file of it says, and the fraction of saturation that an electron is there. Fails as [`Pixel::electrons`].
    pub fn header(&self) -> Result<(RawHeader, f64), SensorError> {
        let (_, header) = self.expected(&even(self.sensor), 1.0)?;
        let step = self.sensor.at_iso(self.reading.iso)?;
        let per_electron = 1.0 / (step.gain_e_per_dn * (header.white_level - header.black_level));
        Ok((header, per_electron))
    }
}

/// Time for which a pixel gathers dark current, s.
pub(super) fn dark_s(shutter: &Shutter, pixel: [usize; 2], size: [usize; 2]) -> f64 {
    match shutter.mechanism {
        crate::shutter::Mechanism::Rolling { .. } => {
            let (open, close) = shutter.window(&Place { pixel, size, pupil: 0.0 });
            (close - open).max(0.0)
        }
        _ => shutter.exposure_s,
    }
}

/// Solid angle and time that the lens gives a unit of radiance in the middle of the picture's axis, sr s.
fn axial(camera: &Camera, shutter: &Shutter, subject: &Subject) -> Option<f64> {
    let lens = &camera.lens;
    const SIDE: usize = 32;
    let middle = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    let film = &camera.film;
    let mut sum = 0.0;
    for i in 0..SIDE * SIDE {
        let Ok(ray) = lens.ray(glam::DVec2::ZERO, [middle(i % SIDE), middle(i / SIDE)]) else { continue };
        let pupil = camera.pupil_radius(ray.origin_mm, ray.direction);
        let (open, close) = shutter.window(&Place { pixel: subject.pixel, size: [film.columns, film.rows], pupil });
        sum += ray.weight_sr * (close - open).max(0.0);
    }
    (sum > 0.0).then(|| sum / (SIDE * SIDE) as f64)
}

/// Pixels a side of the even field that is developed, a multiple of 2 and 6.
const FIELD: usize = 48;
/// Brightest value of the field at which steps before the tone curve are looked at.
const UNCLIPPED: f64 = 0.9;

/// Mean codes in the middle of an even field of signals (fractions of saturation by channel), developed; and as light: luminance.
fn developed(
    header: &RawHeader,
    fractions: &[f64],
    stops: f64,
    recipe: &Recipe,
    shot: &Shot,
    until: Option<Step>,
) -> Result<([f64; 3], f64), ShotError> {
    const FULL: f64 = 65_535.0;
    // As bright as fits, so that rounding is small, and as much darker when it is developed.
    let most = fractions.iter().copied().fold(0.0, f64::max);
    let raised = if most > 0.0 { (0.5 / most).log2().clamp(0.0, 12.0) } else { 0.0 };
    let header = RawHeader {
        bits: 16,
        black_level: 0.0,
        white_level: FULL,
        baseline_ev: header.baseline_ev + stops - raised,
        opcodes: vec![],
        framing: Default::default(),
        ..header.clone()
    };
    let mut mosaic = Raster::<u16>::new(FIELD, FIELD, 1);
    for row in 0..FIELD {
        for column in 0..FIELD {
            let fraction = fractions[header.cfa.channel_at(column, row)] * raised.exp2();
            mosaic.pixel_mut(column, row)[0] = (fraction * FULL).round().clamp(0.0, FULL) as u16;
        }
    }
    let raw = RawImage { mosaic, header };
    let developer = Developer::new(&raw, recipe, shot.lut.clone())?;
    let picture = match until {
        Some(step) => developer.until(step).whole(),
        None => developer.whole(),
    };
    let (width, height) = (picture.pixels.width, picture.pixels.height);
    let luminance = picture.space.xyz_from_rgb().row(1);
    let weights = luminance.to_array().map(|v| v as f32);
    let (mut codes, mut light, mut count) = ([0.0; 3], 0.0, 0.0);
    for y in height / 4..(height - height / 4).max(height / 4 + 1) {
        for x in width / 4..(width - width / 4).max(width / 4 + 1) {
            let p = picture.pixels.pixel(x, y);
            let p = [p[0], p[1], p[2]];
            let linear = match until {
                Some(_) => p.map(srgb_decode),
                None => picture.encoding.decode_pixel(p, weights),
            };
            light += (0..3).map(|k| f64::from(linear[k]) * luminance[k]).sum::<f64>();
            (0..3).for_each(|k| codes[k] += f64::from(p[k]));
            count += 1.0;
        }
    }
    Ok((codes.map(|c| c / count), light / count))
}

/// What the chain needs beside the shot.
pub(super) struct Seen<'a> {
    pub subject: &'a Subject<'a>,
    /// The image of the point through the lens as it is.
    pub spot: &'a Spot,
    /// cd/m².
    pub luminance: f64,
    /// Electrons of each channel.
    pub bands: &'a [f64],
}

/// The chain of factors.
pub(super) fn brightness(shot: &Shot, pixel: &Pixel, seen: &Seen) -> Result<Brightness, ShotError> {
    let (camera, shutter) = (&shot.camera, shot.shutter());
    let (film, lens) = (&camera.film, &camera.lens);
    let facts = shot.facts();
    let electrons = pixel.electrons()?;
    let (header, per_electron) = pixel.header()?;
    let mut factors: Vec<Factor> = Vec::new();
    let mut product = seen.luminance;
    let mut times = |name, factor: f64, unit, because: String| {
        product *= factor;
        factors.push(Factor { name, factor, unit, product, because });
        product
    };
    // Time of the pixel: solid angle × time over solid angle alone.
    let place = Place { pixel: pixel.at, size: [film.columns, film.rows], pupil: 0.0 };
    let (open, close) = shutter.window(&place);
    let pupil = (lens.widest_f_number() / lens.f_number()).min(1.0);
    let time_s = match shutter.mechanism {
        crate::shutter::Mechanism::Leaf { .. } => shutter.effective_s(pupil),
        _ => (close - open).max(0.0),
    };
    let t_number = lens.t_number();
    let at_infinity = PI / (4.0 * t_number * t_number);
    times("lens", at_infinity, "lx", format!("T/{t_number:.2}: π / (4 T²)"));
    let on_axis = axial(camera, &shutter, seen.subject).map_or(at_infinity, |v| v / time_s.max(f64::MIN_POSITIVE));
    let extension = lens.extension().0;
    times("focus", on_axis / at_infinity, "lx", format!("the film stands {extension:.2} mm behind its place for infinity"));
    let here = seen.spot.exposure / time_s.max(f64::MIN_POSITIVE);
    times("vignetting", here / on_axis, "lx", "pupil and its angle at this place over those on the axis".into());
    times("neutral density filter", (-facts.nd_stops).exp2(), "lx", format!("{:.1} stops", facts.nd_stops));
    times("time", time_s, "lx s", "for which this pixel is open".into());
    let area_m2 = film.pixel_area_mm2 * M2_PER_MM2;
    let collected = times("area of the pixel", area_m2, "lm s", format!("{:.2} µm²", film.pixel_area_mm2 * 1e6));
    let response = if collected > 0.0 { electrons / collected } else { 0.0 };
    let channel = pixel.sensor.cfa.channel_names()[pixel.sensor.cfa.channel_at(pixel.at[0], pixel.at[1])].to_owned();
    times("response", response, "e⁻", format!("of the {channel} pixel to this light, electrons for a lumen second"));
    let iso = pixel.reading.iso;
    let of_saturation = times("ISO speed", per_electron, "", format!("ISO {iso:.0}: fraction of saturation for an electron"));

    // Development of an even field with these signals, without what looks at the whole picture.
    let mut recipe = shot.recipe.clone();
    (recipe.local, recipe.lens, recipe.resize) = Default::default();
    if recipe.white.patch.is_some() || recipe.white.balance.trim().eq_ignore_ascii_case("auto") {
        recipe.white = Default::default();
    }
    let mixed = pixel.sensor.mixed_by_crosstalk(seen.bands);
    let fractions: Vec<f64> = mixed.iter().map(|e| e * per_electron).collect();
    let mut darker = 0.0;
    let linear = loop {
        let (_, light) = developed(&header, &fractions, -darker, &recipe, shot, Some(Step::Exposure))?;
        if light < UNCLIPPED || darker > 16.0 {
            break light * f64::exp2(darker);
        }
        darker += 1.0;
    };
    let (codes, value) = developed(&header, &fractions, 0.0, &recipe, shot, None)?;
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    let gain = format!("white balance, colour matrix, grey at 18 %, {:+.1} EV", recipe.exposure.ev + header.baseline_ev);
    times("development to light of the scene", ratio(linear, of_saturation), "", gain);
    let curve = shot.recipe.value("tone.curve");
    times("tone curve", ratio(value, linear), "", format!("{curve}, grading and clipping"));
    Ok(Brightness { luminance: seen.luminance, factors, value, codes, electrons, of_saturation, channel })
}

/// The tile around a pixel as the shot exposes it, with so many samples a pixel; `repeat`: which of several such exposures.
fn tile(shot: &Shot, pixel: [usize; 2], diffracts: bool, response: &Response, spp: u32, repeat: u64) -> PixelBlock {
    let (shutter, facts) = (shot.shutter(), ExposureFacts::default());
    let spp = spp.clamp(2, MOST_SPP);
    let mut settings = Settings {
        spp,
        samples: 0..spp,
        time_limit_s: None,
        truth: false,
        rgb: false,
        seed: shot.settings.seed.wrapping_add(repeat.wrapping_mul(0x9e37_79b9_7f4a_7c15)),
        diffraction: if diffracts { Diffraction::On { white_e: None } } else { Diffraction::Off },
        ..shot.settings.clone()
    };
    if response.bands.iter().all(|b| b.unit == BandUnit::Electrons) {
        settings.light_scale *= (-shot.facts().nd_stops).exp2();
    }
    let (scene, camera) = (&shot.scene, &shot.camera);
    Exposure { scene, camera, shutter: &shutter, response, settings: &settings, facts: &facts }.tile_around(pixel)
}

/// Variance of the electrons of a pixel by so many samples: from how they differ between some exposures of it, with as many or fewer samples.
pub(super) fn variance(shot: &Shot, pixel: [usize; 2], diffracts: bool, spp: u32) -> f64 {
    /// Exposures: the variance is found within a quarter (a root of 2 / 31).
    const REPEATS: u64 = 16;
    /// Most samples of each.
    const MOST: u32 = 32;
    let (channel, response) = (shot.sensor.cfa.channel_at(pixel[0], pixel[1]), Response::sensor(&shot.sensor));
    let taken = spp.clamp(2, MOST);
    let of = |repeat: u64| {
        let tile = tile(shot, pixel, diffracts, &response, taken, repeat);
        (f64::from(tile.mean(pixel)[channel]), f64::from(tile.half_difference(pixel)[channel]))
    };
    let found: Vec<(f64, f64)> = (0..REPEATS).map(of).collect();
    let n = REPEATS as f64;
    let mean = found.iter().map(|(mean, _)| mean).sum::<f64>() / n;
    // Between exposures, and between the halves of each: both say the same.
    let between = found.iter().map(|(m, _)| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let within = found.iter().map(|(_, half)| half.powi(2)).sum::<f64>() / n;
    0.5 * (between + within) * f64::from(taken) / f64::from(spp.max(1))
}

/// Electrons of each channel and luminance at a pixel, and the variance of the electrons of its channel by the shot's own samples.
pub(super) fn exposed(shot: &Shot, pixel: [usize; 2], diffracts: bool) -> (Vec<f64>, f64, f64) {
    let many = shot.settings.spp.max(LEAST_SPP);
    let counted = tile(shot, pixel, diffracts, &Response::sensor(&shot.sensor), many, 0);
    let variance = variance(shot, pixel, diffracts, shot.settings.spp);
    let luminance = f64::from(tile(shot, pixel, diffracts, &Response::luminance(), many, 0).mean(pixel)[0]);
    (counted.mean(pixel).iter().map(|e| f64::from(*e)).collect(), luminance.max(0.0), variance)
}

/// Samples that mean values are found with at least, and any are taken at most.
const LEAST_SPP: u32 = 256;
const MOST_SPP: u32 = 4096;

/// Solid angle × time of a lens at the place of a subject: what the exposure is by.
pub(super) fn gathered(subject: &Subject, camera: &Camera, shutter: &Shutter, colors: &super::spot::Colors) -> Option<f64> {
    spot(subject, camera, shutter, Moving { subject: false, camera: false }, None, colors).map(|s| s.exposure)
}

/// The white of a shot as a spectrum.
pub(super) fn white(shot: &Shot) -> Result<diopter_light::spectrum::Table, ShotError> {
    white_point(&shot.reading.white)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terms(sensor: &Sensor, iso: f64, electrons: f64, dark_s: f64) -> (Noise, f64) {
        let reading = Reading { temperature_c: Some(40.0), ..Reading::new(iso, 1) };
        let bands = vec![electrons; sensor.cfa.channel_count()];
        let pixel = Pixel { sensor, reading: &reading, at: [7, 4], bands, dark_s };
        let expected = f64::from(pixel.expected(&even(sensor), 1.0).unwrap().0.variance);
        (pixel.noise(0.0).unwrap(), expected)
    }

    #[test]
    fn temporal_noise_adds_up_to_what_a_read_out_adds() {
        for name in ["canon-t2i", "canon-5d-mark-iv", "imx249"] {
            let sensor = Sensor::named(name).unwrap();
            for (electrons, dark_s) in [(0.0, 0.01), (20.0, 1.0), (3000.0, 30.0)] {
                let iso = sensor.iso[sensor.iso.len() / 2].iso;
                let (noise, expected) = terms(&sensor, iso, electrons, dark_s);
                let sum: f64 = noise.terms.iter().filter(|t| t.kind == "temporal").map(|t| t.electrons.powi(2)).sum();
                // Variances are single precision.
                assert!((sum / expected - 1.0).abs() < 1e-5, "{name} {electrons}: {sum} {expected}");
                assert!((noise.temporal_e.powi(2) / expected - 1.0).abs() < 1e-9);
                let step = sensor.at_iso(iso).unwrap();
                let of = |name: &str| noise.terms.iter().find(|t| t.name.starts_with(name)).unwrap().electrons;
                // Closed forms: Poisson, the sheet's read noise, a step of the converter.
                assert!((of("photon").powi(2) - electrons).abs() < 1e-3 * electrons.max(1.0), "{name}: {}", of("photon"));
                assert!((of("read") - step.read_noise_e).abs() < 1e-3 * step.read_noise_e, "{name}");
                let rounding = step.gain_e_per_dn * step.digital_gain / 12f64.sqrt();
                assert!((of("quantisation") / rounding - 1.0).abs() < 1e-3, "{name}");
                assert!((of("dark current").powi(2) - sensor.dark_current.at(40.0) * dark_s).abs() < 1e-2, "{name}");
                assert!((of("photo response") - sensor.prnu * electrons).abs() < 1e-3 * electrons.max(1.0), "{name}");
                let fractions: f64 = noise.terms.iter().map(|t| t.fraction).sum();
                assert!((fractions - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_full_pixel_has_no_noise_to_speak_of() {
        let sensor = Sensor::named("canon-t2i").unwrap();
        let (noise, _) = terms(&sensor, 100.0, 1e7, 0.01);
        let photons = noise.terms.iter().find(|t| t.name.starts_with("photon")).unwrap().electrons;
        assert!(noise.clipped && photons < 0.1, "{noise:?}");
    }
}

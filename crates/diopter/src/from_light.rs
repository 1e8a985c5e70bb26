//! Pictures of light from elsewhere (another renderer, a hyperspectral camera) onto a sensor: radiance or irradiance → mean electrons.
//!
//! A pixel of area A that is exposed for t to the spectral irradiance E(λ) counts t · A · ∫ E(λ) · QE(λ) · λ/(hc) dλ electrons (EMVA 1288, release 4.0,
//! eq. 2 and 3, over a spectrum). Radiance becomes irradiance by the camera equation of a distant scene on the axis, E = π L / (4 T²), T being the T-stop;
//! vignetting and the cosine's fourth power are taken to be in the picture already. What is a pixel there is a pixel here: the sensor's pitch counts,
//! not its number of pixels.

use crate::shot::{ShotError, value};
use diopter_image::focal_plane::{Band, BandUnit, Truth};
use diopter_image::{ExposureFacts, FocalPlane, Raster};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use diopter_sensor::Sensor;
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// What the channels of a picture of light are.
#[derive(Clone, Debug, PartialEq)]
pub enum Channels {
    /// Linear sRGB (Rec. 709 primaries): cd/m² of radiance, lx of irradiance, of each colour as luminance counts D65. Upsampled to smooth spectra
    /// ([`Spectrum::light_from_rgb`]).
    LinearSrgb,
    /// Spectral values at these wavelengths, nm, rising: W·m⁻²·sr⁻¹·nm⁻¹ of radiance, W·m⁻²·nm⁻¹ of irradiance. Linear between them; beyond the
    /// first and the last nothing.
    Spectral(Vec<f64>),
    /// Means of the same over bands around these wavelengths, each as wide as from its middle to the next one's. Linear between the middles, level to the outer edges.
    Bands(Vec<f64>),
}

/// Where the light is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// In the scene, before a lens of this T-stop.
    Scene {
        /// f-number of a lossless lens as bright.
        t_number: f64,
    },
    /// On the sensor.
    Sensor,
}

/// Step of the sums over wavelength, nm; responses and upsampled spectra are smooth on it.
const STEP_NM: f64 = 5.0;
/// Wavelengths that sensors are known for, nm.
const RANGE_NM: [f64; 2] = [380.0, 780.0];

/// Mean electrons of a sensor under a picture of light, `[row][column][channel]`, exposed for `exposure_s`. Known exactly: the half difference is 0.
/// `depth` (m along the axis, a value a pixel) goes into the truth. Negative light counts as none.
///
/// Fails on numbers of channels, wavelengths, times and T-stops that make no sense, and on light that is not finite.
pub fn focal_plane(
    light: &Raster<f32>,
    channels: &Channels,
    place: Place,
    depth: Option<&[f32]>,
    sensor: &Sensor,
    exposure_s: f64,
) -> Result<FocalPlane, ShotError> {
    if !(exposure_s > 0.0 && exposure_s <= 4e7) {
        return Err(value("exposure", format!("{exposure_s} s"), "a time above 0 (and of at most a year)"));
    }
    if light.width == 0 || light.height == 0 {
        return Err(value("light", format!("{} × {} pixels", light.width, light.height), "at least one pixel"));
    }
    if let Some(bad) = light.data.iter().position(|v| !v.is_finite()) {
        let pixel = bad / light.channels;
        let found = format!("{} at column {}, row {}", light.data[bad], pixel % light.width, pixel / light.width);
        return Err(value("light", found, "finite numbers"));
    }
    if let Some(depth) = depth.filter(|d| d.len() != light.width * light.height) {
        return Err(value("depth", format!("{} values", depth.len()), format!("one a pixel: {}", light.width * light.height)));
    }
    let of_place = match place {
        Place::Sensor => 1.0,
        Place::Scene { t_number } if (0.1..=1e5).contains(&t_number) => PI / (4.0 * t_number * t_number),
        Place::Scene { t_number } => return Err(value("T-stop", t_number, "a number from 0.1 to 100000, such as 2.8")),
    };
    let [px, py] = sensor.pitch_mm();
    let scale = of_place * px * py * 1e-6 * exposure_s;
    let responses = sensor.band_responses();
    let bands = responses.len();
    let mut mean = Raster::new(light.width, light.height, bands);
    let pixels = mean.data.par_chunks_mut(bands).zip(light.data.par_chunks(light.channels.max(1)));
    match channels {
        Channels::LinearSrgb if light.channels == 3 => {
            let (nm, weights) = nodes(&responses, scale);
            pixels.for_each(|(to, rgb)| {
                let spectrum = Spectrum::light_from_rgb(Vec3::from_slice(rgb).max(Vec3::ZERO));
                let mut sums = vec![0.0f64; bands];
                for (nm, weights) in nm.iter().zip(weights.chunks(bands)) {
                    let here = f64::from(spectrum.at(*nm));
                    sums.iter_mut().zip(weights).for_each(|(sum, w)| *sum += here * w);
                }
                to.iter_mut().zip(sums).for_each(|(to, sum)| *to = sum as f32);
            });
        }
        Channels::LinearSrgb => {
            return Err(value(
                "light",
                format!("{} channels", light.channels),
                "red, green and blue, or the wavelengths of its bands",
            ));
        }
        Channels::Spectral(nm) | Channels::Bands(nm) => {
            let rising = nm.is_sorted_by(|a, b| a < b) && nm.iter().all(|v| (100.0..=20_000.0).contains(v));
            if nm.len() < 2 || nm.len() != light.channels || !rising {
                let told: Vec<String> = nm.iter().take(4).map(f64::to_string).collect();
                let more = if nm.len() > told.len() { ", …" } else { "" };
                let found = format!("{} for {} channels: {}{more}", nm.len(), light.channels, told.join(", "));
                return Err(value("wavelengths", found, "one a channel, two at least, rising, nm from 100 to 20000"));
            }
            let [low, high] = RANGE_NM;
            if nm[0] >= high || nm[nm.len() - 1] <= low {
                let found = format!("{} to {} nm", nm[0], nm[nm.len() - 1]);
                return Err(value("wavelengths", found, format!("some from {low} to {high} nm: sensors are known there")));
            }
            let beyond = match channels {
                Channels::Bands(_) => [nm[1] - nm[0], nm[nm.len() - 1] - nm[nm.len() - 2]].map(|width| 0.5 * width),
                _ => [0.0; 2],
            };
            let weights = hat_weights(nm, beyond, &responses, scale);
            pixels.for_each(|(to, values)| {
                for (band, to) in to.iter_mut().enumerate() {
                    let all = values.iter().zip(&weights).map(|(v, w)| f64::from(v.max(0.0)) * w[band]);
                    *to = all.sum::<f64>() as f32;
                }
            });
        }
    }
    let mut truth = Truth::empty(light.width, light.height);
    if let Some(depth) = depth {
        truth.depth_mut().data.copy_from_slice(depth);
    }
    let (f_number, t_number) = match place {
        Place::Scene { t_number } => (t_number, t_number),
        Place::Sensor => (0.0, 0.0),
    };
    let facts = ExposureFacts {
        software: concat!("diopter ", env!("CARGO_PKG_VERSION")).into(),
        body: sensor.name.clone(),
        make: sensor.make.clone(),
        model: sensor.model.clone(),
        exposure_s,
        f_number,
        t_number,
        light_scale: 1.0,
        samples: 1,
        ..Default::default()
    };
    Ok(FocalPlane { bands: sensor.bands(), half_difference: Raster::new(light.width, light.height, bands), mean, truth, facts })
}

/// Mean electrons of a sensor under the light of a plane in radiance (`expose --radiance` or `--bands`), behind the lens and for the time of its facts
/// unless others are given. Truth, facts and the error estimate go along. What is between the middles of spectral
/// bands is taken to be linear.
///
/// Fails on planes of other bands, and where neither the facts nor the arguments tell time and T-stop.
pub fn of_plane(
    plane: &FocalPlane,
    sensor: &Sensor,
    exposure_s: Option<f64>,
    t_number: Option<f64>,
) -> Result<FocalPlane, ShotError> {
    let channels = channels_of(&plane.bands).ok_or_else(|| {
        let names: Vec<&str> = plane.bands.iter().map(|b| b.name.as_str()).collect();
        value("bands", names.join(", "), "radiance: R, G and B (--radiance), or two spectral bands or more (--bands)")
    })?;
    let facts = &plane.facts;
    let place = Place::Scene { t_number: t_number.unwrap_or(facts.t_number) };
    let exposure_s = exposure_s.unwrap_or(facts.exposure_s);
    let count = |light: &Raster<f32>| focal_plane(light, &channels, place, None, sensor, exposure_s);
    let whole = count(&plane.mean)?;
    let mut one_half = plane.mean.clone();
    one_half.data.iter_mut().zip(&plane.half_difference.data).for_each(|(v, d)| *v += d);
    let mut half_difference = count(&one_half)?.mean;
    half_difference.data.iter_mut().zip(&whole.mean.data).for_each(|(v, mean)| *v -= mean);
    let facts = ExposureFacts {
        body: sensor.name.clone(),
        make: sensor.make.clone(),
        model: sensor.model.clone(),
        exposure_s,
        t_number: t_number.unwrap_or(facts.t_number),
        ..facts.clone()
    };
    Ok(FocalPlane { half_difference, truth: plane.truth.clone(), facts, ..whole })
}

/// What the bands of a plane are, if they are radiance.
fn channels_of(bands: &[Band]) -> Option<Channels> {
    if bands.iter().any(|b| b.unit != BandUnit::Radiance) {
        return None;
    }
    if bands.iter().map(|b| b.name.as_str()).eq(["R", "G", "B"]) {
        return Some(Channels::LinearSrgb);
    }
    // "S0.405,0nm": see `Response::spectral`.
    let middle = |b: &Band| b.name.strip_prefix("S0.")?.strip_suffix("nm")?.replace(',', ".").parse().ok();
    bands.iter().map(middle).collect::<Option<Vec<f64>>>().filter(|nm| nm.len() > 1).map(Channels::Bands)
}

/// Wavelengths and, for each, what one unit of spectral light there counts in every band: the trapezoidal rule.
fn nodes(responses: &[Table], scale: f64) -> (Vec<f32>, Vec<f64>) {
    let [first, last] = RANGE_NM;
    let count = ((last - first) / STEP_NM) as usize;
    let nm: Vec<f32> = (0..=count).map(|i| (first + STEP_NM * i as f64) as f32).collect();
    let end = |i: usize| if i == 0 || i == count { 0.5 } else { 1.0 };
    let weights = nm
        .iter()
        .enumerate()
        .flat_map(|(i, nm)| responses.iter().map(move |r| f64::from(r.at(*nm)) * end(i) * STEP_NM * scale))
        .collect();
    (nm, weights)
}

/// `[wavelength][band]`: what a unit at each given wavelength counts, the light being linear from one to the next (hat functions) and level for `beyond` nm before the first and
/// after the last. By Simpson's rule over 1 nm or less: exact where a response is linear.
fn hat_weights(nm: &[f64], beyond: [f64; 2], responses: &[Table], scale: f64) -> Vec<Vec<f64>> {
    let mut weights = vec![vec![0.0; responses.len()]; nm.len()];
    // Light of one wavelength rises or falls from one end to the other, or stays.
    let mut add = |wavelength: usize, [from, to]: [f64; 2], [first, last]: [f64; 2]| {
        let [low, high] = [from.max(RANGE_NM[0]), to.min(RANGE_NM[1])];
        if high <= low {
            return;
        }
        let steps = (high - low).ceil().max(1.0);
        let step = (high - low) / steps;
        for half in 0..=2 * steps as usize {
            let at = low + 0.5 * step * half as f64;
            let share = [2.0, 4.0][half % 2] - f64::from(half == 0 || half == 2 * steps as usize);
            let light = first + (last - first) * (at - from) / (to - from);
            for (band, response) in responses.iter().enumerate() {
                weights[wavelength][band] += share / 6.0 * step * light * f64::from(response.at(at as f32)) * scale;
            }
        }
    };
    let last = nm.len() - 1;
    for (i, pair) in nm.windows(2).enumerate() {
        add(i, [pair[0], pair[1]], [1.0, 0.0]);
        add(i + 1, [pair[0], pair[1]], [0.0, 1.0]);
    }
    add(0, [nm[0] - beyond[0], nm[0]], [1.0; 2]);
    add(last, [nm[last], nm[last] + beyond[1]], [1.0; 2]);
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::cie::d65_one_nit;

    fn even(channels: usize, value: &[f32]) -> Raster<f32> {
        Raster { width: 2, height: 1, channels, data: value.repeat(2) }
    }

    #[test]
    fn one_wavelength_counts_the_photons_it_carries() {
        // A narrow band of E W/m² at 550 nm: electrons = E t A λ/(hc) QE.
        let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
        let (per_nm, width) = (1e-4f32, 2.0);
        let nm = vec![549.0, 550.0, 551.0];
        // The hat has an area of its height × half its foot: 1 nm.
        let light = even(3, &[0.0, per_nm, 0.0]);
        let plane = focal_plane(&light, &Channels::Spectral(nm), Place::Sensor, None, &sensor, 0.01).unwrap();
        let [px, py] = sensor.pitch_mm();
        let joules = f64::from(per_nm) * 0.5 * width * px * py * 1e-6 * 0.01;
        let photons = joules * 550e-9 / (6.626_070_15e-34 * 299_792_458.0);
        let expected = photons * f64::from(sensor.quantum_efficiency[1].at(550.0));
        let found = f64::from(plane.mean.pixel(0, 0)[1]);
        // The response is linear over 2 nm but for a node of its table.
        assert!((found / expected - 1.0).abs() < 0.002, "{found} {expected}");
        // Of any width: half a foot is the area of a hat.
        for (foot, table) in [(0.2, vec![400.0, 549.9, 550.0, 550.1, 700.0]), (0.1, vec![400.0, 549.95, 550.0, 550.05, 700.0])] {
            let light = even(5, &[0.0, 0.0, per_nm, 0.0, 0.0]);
            let plane = focal_plane(&light, &Channels::Spectral(table), Place::Sensor, None, &sensor, 0.01).unwrap();
            let found = f64::from(plane.mean.pixel(0, 0)[1]);
            assert!((found / (expected * 0.5 * foot) - 1.0).abs() < 0.002, "{foot}: {found} {expected}");
        }
        assert_eq!(plane.mean.pixel(0, 0), plane.mean.pixel(1, 0));
    }

    #[test]
    fn colours_and_their_spectrum_count_the_same() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        let place = Place::Scene { t_number: 2.8 };
        let rgb = focal_plane(&even(3, &[100.0; 3]), &Channels::LinearSrgb, place, None, &sensor, 0.01).unwrap();
        let nm: Vec<f64> = (0..=80).map(|i| 380.0 + 5.0 * f64::from(i)).collect();
        let d65: Vec<f32> = nm.iter().map(|nm| 100.0 * d65_one_nit().at(*nm as f32)).collect();
        let spectral = focal_plane(&even(81, &d65), &Channels::Spectral(nm), place, None, &sensor, 0.01).unwrap();
        for (a, b) in rgb.mean.data.iter().zip(&spectral.mean.data) {
            // Upsampled white is flat within a part in a thousand; D65 is given at 5 nm.
            assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
        }
        let twice = focal_plane(&even(3, &[100.0; 3]), &Channels::LinearSrgb, place, None, &sensor, 0.02).unwrap();
        assert!((twice.mean.data[0] / rgb.mean.data[0] - 2.0).abs() < 1e-5);
    }

    #[test]
    fn a_plane_in_radiance_is_read_with_its_own_lens_and_time() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        let bands = |names: &[&str]| names.iter().map(|n| Band { name: (*n).into(), unit: BandUnit::Radiance }).collect();
        let facts = ExposureFacts { exposure_s: 0.01, t_number: 4.0, f_number: 3.9, scene: "s".into(), ..Default::default() };
        let mut plane = FocalPlane::even(bands(&["R", "G", "B"]), &[50.0; 3], [2, 1], facts.clone());
        plane.half_difference.data.fill(5.0);
        let read = of_plane(&plane, &sensor, None, None).unwrap();
        let same = focal_plane(&plane.mean, &Channels::LinearSrgb, Place::Scene { t_number: 4.0 }, None, &sensor, 0.01).unwrap();
        assert_eq!(read.mean, same.mean);
        assert_eq!((read.facts.scene.as_str(), read.facts.f_number, read.facts.body.as_str()), ("s", 3.9, sensor.name.as_str()));
        // A tenth more of all colours is a tenth more electrons.
        assert!((read.half_difference.data[1] / read.mean.data[1] - 0.1).abs() < 1e-3);
        let spectral = FocalPlane::even(bands(&["S0.450,0nm", "S0.550,5nm"]), &[1e-3; 2], [2, 1], facts.clone());
        assert!(of_plane(&spectral, &sensor, Some(0.02), Some(2.8)).unwrap().mean.data[1] > 0.0);
        let electrons = FocalPlane::even(sensor.bands(), &[1.0; 3], [2, 1], facts);
        assert!(of_plane(&electrons, &sensor, None, None).unwrap_err().to_string().starts_with("bands"));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        let tell = |light: &Raster<f32>, channels: Channels, place, s| {
            focal_plane(light, &channels, place, None, &sensor, s).unwrap_err().to_string()
        };
        let light = even(3, &[1.0; 3]);
        assert!(tell(&light, Channels::LinearSrgb, Place::Sensor, 0.0).starts_with("exposure 0 s"));
        assert!(tell(&light, Channels::Spectral(vec![400.0, 500.0]), Place::Sensor, 1.0).contains("2 for 3 channels"));
        assert!(tell(&even(4, &[1.0; 4]), Channels::LinearSrgb, Place::Sensor, 1.0).contains("4 channels"));
        assert!(tell(&light, Channels::LinearSrgb, Place::Scene { t_number: 0.0 }, 1.0).contains("T-stop"));
        assert!(tell(&even(3, &[1.0, f32::NAN, 1.0]), Channels::LinearSrgb, Place::Sensor, 1.0).contains("column 0, row 0"));
    }
}

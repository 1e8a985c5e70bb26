//! Measures the ISO speed of a body from its own pictures, by ISO 12232:2019: even fields of D55 light, read out and developed.
//!
//! - Saturation: 78 / H_sat, H_sat the exposure (lx·s) at which the most sensitive channel reaches the white level.
//! - Standard output sensitivity: 10 / H_sos, H_sos what gives the output code 118 of 255.
//! - Noise, S/N 40 and 10: 10 / H, H what gives that ratio, by the incremental gain, of the luminance to the visual noise of the linear picture (demosaiced
//!   by bilinear interpolation): H · dY/dH / σ, σ² = σ²(Y) + 0.279 σ²(R−Y) + 0.088 σ²(B−Y), where no pixels clip, whose noise falls.

use crate::shot::error::ShotError;
use diopter_develop::{Demosaic, Recipe, develop};
use diopter_image::{ExposureFacts, FocalPlane, Picture, RawImage};
use diopter_light::cie;
use diopter_light::color::{luminance, srgb_decode};
use diopter_sensor::{Reading, Sensor, read_out};

/// Pixels a side of the pictures.
const SIDE: usize = 192;

/// Exposure time of them, s: short enough that nothing leaks.
const EXPOSURE_S: f64 = 0.01;

/// Fraction of full pixels that leaves noise what it is.
const MOST_CLIPPED: f64 = 0.001;

/// The speeds of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    /// What the setting is called.
    pub nominal: f64,
    /// 78 / H_sat.
    pub saturation: f64,
    /// 10 / H_sos, with the default development; `None` where the code is not reached before saturation.
    pub standard_output: Option<f64>,
    /// 10 / H at S/N 40; `None` where it is not reached before saturation.
    pub noise_40: Option<f64>,
    /// 10 / H at S/N 10.
    pub noise_10: Option<f64>,
}

/// A body before an even field.
struct Field<'a> {
    sensor: &'a Sensor,
    reading: Reading,
    /// Electrons a lx·s of D55 gives in each channel.
    per_lux_second: Vec<f64>,
}

impl Field<'_> {
    fn picture(&self, lux_seconds: f64) -> Result<RawImage, ShotError> {
        let signal: Vec<f32> = self.per_lux_second.iter().map(|e| (e * lux_seconds) as f32).collect();
        let facts = ExposureFacts { exposure_s: EXPOSURE_S, ..Default::default() };
        let plane = FocalPlane::even(self.sensor.bands(), &signal, [SIDE, SIDE], facts);
        let white = cie::illuminant("D55").unwrap_or_else(|| unreachable!("D55 is embedded"));
        Ok(read_out(&plane, self.sensor, &self.reading, &white)?)
    }

    /// Largest mean of a channel, as a fraction of the way from black to white.
    fn level(&self, lux_seconds: f64) -> Result<f64, ShotError> {
        let raw = self.picture(lux_seconds)?;
        let h = &raw.header;
        let n = h.cfa.channel_count();
        let (mut sums, mut counts) = (vec![0.0; n], vec![0.0; n]);
        for (i, dn) in raw.mosaic.data.iter().enumerate() {
            let c = h.cfa.channel_at(i % SIDE, i / SIDE);
            sums[c] += f64::from(*dn) - h.black_level;
            counts[c] += 1.0;
        }
        let mean = sums.iter().zip(&counts).map(|(s, n)| s / n).fold(0.0, f64::max);
        Ok(mean / (h.white_level - h.black_level))
    }

    /// Fraction of the pixels that are full.
    fn clipped(&self, lux_seconds: f64) -> Result<f64, ShotError> {
        let raw = self.picture(lux_seconds)?;
        let full = raw.mosaic.data.iter().filter(|dn| f64::from(**dn) >= raw.header.white_level).count();
        Ok(full as f64 / raw.mosaic.data.len() as f64)
    }

    /// Luminance and visual noise of the linear picture.
    fn luminance_and_noise(&self, lux_seconds: f64) -> Result<[f64; 2], ShotError> {
        let mut recipe = Recipe::preset("plain")?;
        recipe.demosaic.method = Demosaic::Bilinear;
        // So dark that white of the picture clips nothing: pixels do.
        recipe.exposure.ev = -3.0;
        let picture = develop(&self.picture(lux_seconds)?, &recipe, None)?;
        let (mut n, mut sums, mut squares) = (0.0, [0.0; 3], [0.0; 3]);
        for codes in picture.pixels.data.as_chunks::<3>().0 {
            let [r, g, b] = codes.map(|v| f64::from(srgb_decode(v)));
            let y = 0.2125 * r + 0.7154 * g + 0.0721 * b;
            n += 1.0;
            for (k, v) in [y, r - y, b - y].into_iter().enumerate() {
                sums[k] += v;
                squares[k] += v * v;
            }
        }
        let variance = |k: usize| squares[k] / n - (sums[k] / n).powi(2);
        let noise = (variance(0) + 0.279 * variance(1) + 0.088 * variance(2)).max(1e-30).sqrt();
        Ok([sums[0] / n, noise])
    }

    /// Luminance by the incremental gain, over visual noise.
    fn signal_to_noise(&self, lux_seconds: f64) -> Result<f64, ShotError> {
        let luminance = |h: f64| Ok::<f64, ShotError>(self.luminance_and_noise(h)?[0]);
        let by_gain = (luminance(lux_seconds * 1.02)? - luminance(lux_seconds * 0.98)?) / 0.04;
        Ok(by_gain / self.luminance_and_noise(lux_seconds)?[1])
    }

    /// Mean code (0 to 255) of green, developed by default.
    fn code(&self, lux_seconds: f64) -> Result<f64, ShotError> {
        let picture: Picture = develop(&self.picture(lux_seconds)?, &Recipe::default(), None)?;
        let codes = &picture.pixels.data;
        Ok(codes.iter().skip(1).step_by(3).map(|v| f64::from(*v) * 255.0).sum::<f64>() / (codes.len() / 3) as f64)
    }
}

/// The exposure at which something that rises reaches a value, between two; `None` outside.
fn reaches(
    target: f64,
    [mut low, mut high]: [f64; 2],
    value: impl Fn(f64) -> Result<f64, ShotError>,
) -> Result<Option<f64>, ShotError> {
    if value(low)? > target || value(high)? < target {
        return Ok(None);
    }
    for _ in 0..18 {
        let middle = (low * high).sqrt();
        match value(middle)? < target {
            true => low = middle,
            false => high = middle,
        }
    }
    Ok(Some((low * high).sqrt()))
}

/// Electrons that a lux second of D55 makes in a pixel of each channel, none leaking.
fn electrons_per_lux_second(sensor: &Sensor) -> Vec<f64> {
    let d55 = cie::illuminant("D55").unwrap_or_else(|| unreachable!("D55 is embedded"));
    let light = |nm: f32| if (380.0..=780.0).contains(&nm) { d55.at(nm) } else { 0.0 };
    let lux = luminance(light);
    let [w, h] = sensor.pitch_mm().map(|p| p * 1e-3);
    let of =
        |r: &diopter_light::spectrum::Table| (380..=780).map(|nm| f64::from(r.at(nm as f32) * light(nm as f32))).sum::<f64>();
    sensor.band_responses().iter().map(|r| of(r) / lux * w * h).collect()
}

/// The saturation-based speed that a setting has by quantum efficiency, pixel size and what saturates it (78 / H, ISO 12232:2019), without noise. Fails on a speed that the body
/// does not have.
pub fn saturation_speed(sensor: &Sensor, iso: f64) -> Result<f64, ShotError> {
    let strongest = electrons_per_lux_second(sensor).into_iter().fold(0.0f64, f64::max);
    Ok(78.0 * strongest / sensor.saturation_e(&sensor.at_iso(iso)?))
}

/// Measures a setting of a body. Fails on a speed that the body does not have.
pub fn measure(sensor: &Sensor, iso: f64) -> Result<Speeds, ShotError> {
    let per_lux_second = electrons_per_lux_second(sensor);
    let field = Field { sensor, reading: Reading { white: "D55".into(), ..Reading::new(iso, 1) }, per_lux_second };
    // The slope well below saturation says where saturation is.
    let step = sensor.at_iso(iso)?;
    let strongest = field.per_lux_second.iter().fold(0.0f64, |a, b| a.max(*b));
    let guess = sensor.saturation_e(&step) / strongest;
    let tenth = field.level(0.1 * guess)? - field.level(0.0)?;
    let saturation = guess * 0.1 / tenth;
    let range = [saturation * 1e-6, saturation * 0.99];
    let speed = |h: Option<f64>| h.map(|h| 10.0 / h);
    // Below where pixels clip, whose noise falls.
    let (stuck, mut unclipped) = (field.clipped(0.1 * saturation)?, saturation);
    while field.clipped(unclipped)? > stuck + MOST_CLIPPED && unclipped > 0.2 * saturation {
        unclipped *= 0.95;
    }
    let noise = |ratio: f64| reaches(ratio, [range[0], unclipped], |h| field.signal_to_noise(h));
    Ok(Speeds {
        nominal: iso,
        saturation: 78.0 / saturation,
        standard_output: speed(reaches(118.0, range, |h| field.code(h))?),
        noise_40: speed(noise(40.0)?),
        noise_10: speed(noise(10.0)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_saturation_speed_is_the_nominal_one() {
        // Efficiencies are derived from the speed of the lowest setting, or the other way round (rounded to two digits): the loop
        // from light through numbers back to the speed must close. Two readings together hold more than the one it is for.
        for name in Sensor::names() {
            let sensor = Sensor { second_reading: None, ..Sensor::named(name).unwrap() };
            let iso = sensor.iso[0].iso;
            let s = measure(&sensor, iso).unwrap();
            assert!((s.saturation / iso - 1.0).abs() < 0.04, "{name}: {s:?}");
            assert!(s.noise_10.is_some_and(|ten| ten > s.noise_40.unwrap_or(0.0)), "{name}: {s:?}");
        }
    }

    #[test]
    fn no_noise_speed_asks_for_more_than_a_full_well_gives() {
        // Shot noise of a full well alone: no ratio is larger than the root of its electrons, by which a channel counts at most, and two greens and neighbours make it somewhat better.
        for name in ["canon-t2i", "pixel-4a", "imx249"] {
            let sensor = Sensor::named(name).unwrap();
            for step in &sensor.iso {
                let (speeds, full) = (measure(&sensor, step.iso).unwrap(), sensor.saturation_e(step).sqrt());
                assert!(speeds.noise_40.is_none() || full > 25.0, "{name} {} {full}: {speeds:?}", step.iso);
                assert!(speeds.noise_10.is_none() || full > 6.0, "{name} {} {full}: {speeds:?}", step.iso);
                assert!(speeds.noise_40.is_none_or(|s| s > 0.98 * speeds.saturation / 78.0 * 10.0), "{name} {}", step.iso);
            }
        }
    }

    #[test]
    fn iso_200_needs_half_the_light_of_iso_100() {
        let sensor = Sensor::named("canon-5d-mark-ii").unwrap();
        let (a, b) = (measure(&sensor, 100.0).unwrap(), measure(&sensor, 200.0).unwrap());
        assert!((b.saturation / a.saturation - 2.0).abs() < 0.01, "{a:?} {b:?}");
        assert!((b.standard_output.unwrap() / a.standard_output.unwrap() - 2.0).abs() < 0.02, "{a:?} {b:?}");
    }
}

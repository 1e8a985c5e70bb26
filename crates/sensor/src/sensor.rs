//! The data sheet of a body as a type.

use crate::data::BODIES;
use crate::{SensorError, nearest};
use diopter_image::Cfa;
use diopter_image::focal_plane::{Band, BandUnit};
use diopter_light::spectrum::Table;
use diopter_light::units::{PLANCK, SPEED_OF_LIGHT, shown};
use std::collections::BTreeMap;

/// What an ISO setting does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoStep {
    /// ISO speed.
    pub iso: f64,
    /// Conversion gain 1/K of the numbers that are written, e⁻/DN.
    pub gain_e_per_dn: f64,
    /// Temporal dark noise σ_d of a pixel without quantisation, all stages referred to the pixel, e⁻.
    pub read_noise_e: f64,
    /// Deviation of the offset that all pixels of a row share, new at each read-out, e⁻.
    pub row_noise_e: f64,
    /// DN of no light.
    pub black_level_dn: f64,
    /// DN at which the amplifier or the converter saturates.
    pub white_level_dn: f64,
    /// Factor by which converted numbers are multiplied; 1 where the gain is analog.
    pub digital_gain: f64,
}

/// A two-stage model of read noise: σ² = before² + (after · gain)². Source: the ladder of any amplified sensor, for instance
/// C. Buil, astrosurf.com/buil/50d/test.htm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoStage {
    /// Noise before the gain, e⁻.
    pub before_e: f64,
    /// Noise after the gain, DN.
    pub after_dn: f64,
}

/// Electrons that gather in the dark.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct DarkCurrent {
    /// Temperature (°C, rising) and current (e⁻/s).
    pub points: Vec<[f64; 2]>,
    /// Degrees that double it, beyond the points.
    pub doubling_c: f64,
}

impl DarkCurrent {
    /// Current at a temperature, e⁻/s: between the points on a straight line of its logarithm.
    pub fn at(&self, celsius: f64) -> f64 {
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else { return 0.0 };
        if celsius <= first[0] || celsius >= last[0] {
            let nearest = if celsius <= first[0] { first } else { last };
            return nearest[1] * ((celsius - nearest[0]) / self.doubling_c).exp2();
        }
        let i = self.points.partition_point(|p| p[0] <= celsius);
        let ([c0, e0], [c1, e1]) = (self.points[i - 1], self.points[i]);
        (e0.ln() + (e1.ln() - e0.ln()) * (celsius - c0) / (c1 - c0)).exp()
    }
}

/// Up to this factor ISO speeds are the same.
pub(crate) const SAME_ISO: f64 = 1.001;

/// By what numbers are multiplied at an ISO speed, of a body whose gain is digital above a limit.
pub(crate) fn digital_gain(iso: f64, limit: f64) -> f64 {
    if iso > limit * SAME_ISO { iso / limit } else { 1.0 }
}

/// Pixels that leak more than others.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct HotPixels {
    /// Fraction of all pixels.
    pub fraction: f64,
    /// Mean of how many times the dark current they leak; exponentially distributed.
    pub factor: f64,
}

/// A second reading of the same picture with less light, for scenes that are brighter than one reading holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondReading {
    /// Light it gets, as a fraction of the first: of a small pixel beside the large one, or a short exposure after the long one.
    pub relative_exposure: f64,
    /// Electrons it holds.
    pub full_well_e: f64,
    /// Its read noise, e⁻.
    pub read_noise_e: f64,
    /// Fraction of the first's full well from which the second counts.
    pub switch_at: f64,
}

/// A microlens array before the sensor that makes a plenoptic camera of it.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Plenoptic {
    /// Distance of its lenses, mm.
    pub pitch_mm: Option<f64>,
    /// Their focal length, mm; without, they match the lens's aperture.
    pub focal_length_mm: Option<f64>,
    /// From the array to the sensor, mm; the focal length without.
    pub gap_mm: Option<f64>,
    /// `square` or `hexagonal`; square where empty.
    pub arrangement: String,
}

/// The lens that a body has of its own or is commonly used with, as an ideal lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyLens {
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// f-number.
    pub f_number: f64,
}

/// A body's sensor. Symbols and order follow EMVA 1288.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Name of the body.
    pub name: String,
    /// Maker, as EXIF writes it.
    pub make: String,
    /// Model, as EXIF writes it.
    pub model: String,
    /// Width and height of the picture area, mm.
    pub format_mm: [f64; 2],
    /// Columns and rows.
    pub pixels: [usize; 2],
    /// Colour filters.
    pub cfa: Cfa,
    /// Quantum efficiency η of each channel, filters included, over nm.
    pub quantum_efficiency: Vec<Table>,
    /// Transmittance along the axes of the polarisers before its pixels over that across them; 1 where there are none.
    pub extinction_ratio: f64,
    /// Electrons a pixel holds: no more is ever counted.
    pub full_well_e: f64,
    /// What overflows runs along the column.
    pub blooming: bool,
    /// Bits of the converter.
    pub adc_bits: u32,
    /// Settings, rising.
    pub iso: Vec<IsoStep>,
    /// ISO from which on the pixel converts at its high gain, of a sensor with two.
    pub dual_gain_iso: Option<f64>,
    /// ISO above which numbers are multiplied; `None` where all gain is analog.
    pub digital_above_iso: Option<f64>,
    /// ISO from which on other levels hold, black and white level there, DN; rising.
    pub levels: Vec<[f64; 3]>,
    /// Photo response non-uniformity, as a fraction.
    pub prnu: f64,
    /// Dark signal non-uniformity of single pixels, e⁻.
    pub dsnu_e: f64,
    /// The same of whole rows, e⁻.
    pub dsnu_row_e: f64,
    /// The same of whole columns, e⁻.
    pub dsnu_column_e: f64,
    /// Dark current.
    pub dark_current: DarkCurrent,
    /// Hot pixels.
    pub hot_pixels: HotPixels,
    /// Temperature it has when nothing else is said, °C.
    pub temperature_c: f64,
    /// Distance between the two images an optical low-pass filter makes along each axis, pixels; 0 without one.
    pub low_pass_px: f64,
    /// Fraction of the pixel's area that collects light.
    pub fill_factor: f64,
    /// Fraction of a pixel's charge that each of its four neighbours gets.
    pub crosstalk: f64,
    /// A second reading, if it makes one.
    pub second_reading: Option<SecondReading>,
    /// A microlens array, if it has one.
    pub plenoptic: Option<Plenoptic>,
    /// The body's own lens, where no other is put on it.
    pub lens: Option<BodyLens>,
    /// Where the numbers come from.
    pub sources: BTreeMap<String, String>,
}

impl Sensor {
    /// What to say to somebody who sets a temperature, if the sheet says nothing of dark current.
    pub fn ignored_temperature(&self) -> Option<String> {
        let is_silent = self.dark_current.points.is_empty();
        is_silent.then(|| format!("the sheet of {} has no dark current: its temperature changes nothing", self.name))
    }

    /// Names of the embedded bodies.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BODIES.iter().map(|b| b.0)
    }

    /// An embedded body. Fails on an unknown name, with the nearest or all of them.
    pub fn named(name: &str) -> Result<Sensor, SensorError> {
        match BODIES.iter().find(|b| b.0.eq_ignore_ascii_case(name)) {
            Some((key, text)) => Sensor::parse(text, key),
            None => {
                let hint = match nearest(name, Sensor::names()) {
                    Some(near) => format!(" (did you mean \"{near}\"?)"),
                    None => format!("; known are {}", Sensor::names().collect::<Vec<_>>().join(", ")),
                };
                Err(SensorError::Unknown { what: "body", found: name.into(), hint })
            }
        }
    }

    /// Distance between pixels, mm, across and down.
    pub fn pitch_mm(&self) -> [f64; 2] {
        [self.format_mm[0] / self.pixels[0] as f64, self.format_mm[1] / self.pixels[1] as f64]
    }

    /// Dark current of a pixel on average, hot ones among them, e⁻/s; at the sheet's temperature without one (°C).
    pub fn mean_dark_current(&self, celsius: Option<f64>) -> f64 {
        self.dark_current.at(celsius.unwrap_or(self.temperature_c)) * (1.0 + self.hot_pixels.fraction * self.hot_pixels.factor)
    }

    /// Whether its filters are red, green and blue and no others.
    pub fn has_color_filters(&self) -> bool {
        self.cfa.filters() == Cfa::linear_rgb().filters()
    }

    /// The bands of a focal plane that this sensor reads: its channels, in electrons.
    pub fn bands(&self) -> Vec<Band> {
        let band = |name: &str| Band { name: name.into(), unit: BandUnit::Electrons };
        self.cfa.channel_names().into_iter().map(band).collect()
    }

    /// Transmission axis (degrees, counter-clockwise from the horizontal in the picture) of the polariser before the pixels of each channel, and what polarised light
    /// counts there: (E − 1) / (E + 1) of an extinction ratio E; 0 where there is none.
    pub fn analyzers(&self) -> Vec<(f64, f64)> {
        let contrast = (self.extinction_ratio - 1.0) / (self.extinction_ratio + 1.0);
        self.cfa.filters().iter().map(|f| f.polarizer_deg().map_or((0.0, 0.0), |angle| (angle, contrast))).collect()
    }

    /// Electrons per joule of light of each channel over wavelength: QE(λ) λ / hc.
    pub fn band_responses(&self) -> Vec<Table> {
        self.quantum_efficiency
            .iter()
            .map(|qe| {
                let per_joule = |nm: f32| (qe.at(nm) as f64 * nm as f64 * 1e-9 / (PLANCK * SPEED_OF_LIGHT)) as f32;
                Table::new(380.0, 1.0, (0..=400).map(|i| per_joule(380.0 + i as f32)).collect())
            })
            .collect()
    }

    /// Signal of each channel on an even field, from the signals its pixels would have alone: neighbours of other colours
    /// add to it by crosstalk.
    pub fn mixed_by_crosstalk(&self, alone: &[f64]) -> Vec<f64> {
        let neighbours = self.cfa.neighbours();
        let gained = |own: usize| -> f64 { neighbours[own].iter().zip(alone).map(|(count, v)| count * v).sum() };
        alone.iter().enumerate().map(|(own, v)| (1.0 - 4.0 * self.crosstalk) * v + self.crosstalk * gained(own)).collect()
    }

    /// Contrast that pixel aperture, low-pass filter and crosstalk leave of a pattern along a row, at a frequency in cycles a
    /// pixel; crosstalk that of pixels of one colour.
    pub fn mtf(&self, cycles_per_pixel: f64) -> f64 {
        use std::f64::consts::PI;
        let f = cycles_per_pixel;
        let x = PI * f * self.fill_factor.sqrt();
        let aperture = if x == 0.0 { 1.0 } else { x.sin() / x };
        let low_pass = (PI * f * self.low_pass_px).cos();
        let crosstalk = 1.0 - 2.0 * self.crosstalk * (1.0 - (2.0 * PI * f).cos());
        (aperture * low_pass * crosstalk).abs()
    }

    /// Gain and noise at an ISO speed, between the measured settings on straight lines of their logarithms; the noise of a pixel
    /// with two conversion gains not across its switch. Fails more than 2 % outside the range of the sheet.
    pub fn at_iso(&self, iso: f64) -> Result<IsoStep, SensorError> {
        let (first, last) = (self.iso[0], self.iso[self.iso.len() - 1]);
        // Settings are nominal: 100 is taken for 99.6.
        if !(iso >= first.iso * 0.98 && iso <= last.iso * 1.02) {
            let expected = match first.iso == last.iso {
                true => format!("{}, the only speed of {}", first.iso, self.name),
                false => format!("{} to {} on {}", first.iso, last.iso, self.name),
            };
            return Err(SensorError::Range { what: "ISO".into(), found: shown(iso), expected });
        }
        let iso = iso.clamp(first.iso, last.iso);
        let i = self.iso.partition_point(|s| s.iso <= iso).clamp(1, self.iso.len().max(2) - 1) - 1;
        let (a, b) = (self.iso[i], self.iso[(i + 1).min(self.iso.len() - 1)]);
        if iso >= b.iso {
            return Ok(b);
        }
        let t = if a.iso == b.iso { 0.0 } else { (iso / a.iso).ln() / (b.iso / a.iso).ln() };
        let mix = |x: f64, y: f64| if x > 0.0 && y > 0.0 { (x.ln() + (y.ln() - x.ln()) * t).exp() } else { x + (y - x) * t };
        let read_noise_e = match self.dual_gain_iso.filter(|switch| a.iso < *switch && *switch <= b.iso) {
            Some(switch) if iso < switch => a.read_noise_e,
            Some(_) => b.read_noise_e,
            None => mix(a.read_noise_e, b.read_noise_e),
        };
        // Levels change at a speed of their own, which need not be that of a setting.
        let changed = self.levels.iter().rev().find(|l| l[0] <= iso * SAME_ISO && l[0] > a.iso * SAME_ISO);
        let [black_level_dn, white_level_dn] = changed.map_or([a.black_level_dn, a.white_level_dn], |l| [l[1], l[2]]);
        Ok(IsoStep {
            iso,
            gain_e_per_dn: mix(a.gain_e_per_dn, b.gain_e_per_dn),
            read_noise_e,
            row_noise_e: mix(a.row_noise_e, b.row_noise_e),
            black_level_dn,
            white_level_dn,
            digital_gain: match self.digital_above_iso {
                Some(limit) => self::digital_gain(iso, limit),
                None => mix(a.digital_gain, b.digital_gain),
            },
        })
    }

    /// The ISO speed of a read-out: the one asked for; without, the one the camera was set to (as facts have it: 0 where that is not known); without either, 100, or what the sheet has that is nearest to it.
    /// Speeds that are given are not checked ([`Sensor::at_iso`] does).
    pub fn resolve_iso(&self, asked: Option<f64>, set: f64) -> f64 {
        asked.or((set > 0.0).then_some(set)).unwrap_or_else(|| self.nearest_iso(100.0))
    }

    /// The ISO speed of the sheet's range that is nearest to one.
    pub fn nearest_iso(&self, iso: f64) -> f64 {
        let [lowest, highest] = self.iso_range();
        iso.clamp(lowest, highest)
    }

    /// Lowest and highest ISO speed of the sheet.
    pub fn iso_range(&self) -> [f64; 2] {
        [self.iso[0].iso, self.iso[self.iso.len() - 1].iso]
    }

    /// The two-stage model nearest to the read noise of the settings, and how far the worst of them is from it (a fraction);
    /// `None` with fewer than three settings. Least squares of relative variances.
    pub fn two_stage(&self) -> Option<(TwoStage, f64)> {
        let analog: Vec<&IsoStep> = self.iso.iter().filter(|s| s.digital_gain == 1.0 && s.read_noise_e > 0.0).collect();
        (analog.len() >= 3).then_some(())?;
        let (mut aa, mut ab, mut bb, mut ay, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for s in &analog {
            // Each equation divided by its variance: before² · u + after² · v = 1.
            let (u, v) = (s.read_noise_e.powi(-2), (s.gain_e_per_dn / s.read_noise_e).powi(2));
            (aa, ab, bb, ay, by) = (aa + u * u, ab + u * v, bb + v * v, ay + u, by + v);
        }
        let size = aa * bb - ab * ab;
        (size > 1e-9 * aa * bb).then_some(())?;
        let (before, after) = match [(ay * bb - by * ab) / size, (by * aa - ay * ab) / size] {
            // A stage that would be negative is not there: the other alone.
            [before, _] if before < 0.0 => (0.0, by / bb),
            [_, after] if after < 0.0 => (ay / aa, 0.0),
            [before, after] => (before, after),
        };
        let model = TwoStage { before_e: before.sqrt(), after_dn: after.sqrt() };
        let off = |s: &&IsoStep| (model.before_e.hypot(model.after_dn * s.gain_e_per_dn) / s.read_noise_e - 1.0).abs();
        Some((model, analog.iter().map(off).fold(0.0, f64::max)))
    }

    /// Whether a well is full before the converter's range ends. One as large as that never limits.
    pub(crate) fn is_well_first(&self, step: &IsoStep) -> bool {
        let converter_e = (step.white_level_dn - step.black_level_dn) * step.gain_e_per_dn;
        self.saturation_e(step) < 0.999 * converter_e || self.second_reading.is_some()
    }

    /// The number from which pixels count as full at a setting, a whole one, as files hold it. What is read of full wells still has its noise: three deviations below, nearly all full pixels are counted as such.
    pub fn white_level_dn(&self, step: &IsoStep) -> f64 {
        if !self.is_well_first(step) {
            return step.white_level_dn;
        }
        let mut spread = [step.read_noise_e, step.row_noise_e, self.dsnu_e, self.dsnu_row_e, self.dsnu_column_e]
            .iter()
            .fold(0.0, |a: f64, b| a.hypot(*b));
        if let Some(second) = &self.second_reading {
            spread = spread.hypot(second.read_noise_e) / second.relative_exposure;
        }
        let white = step.black_level_dn + (self.saturation_e(step) - 3.0 * spread) / step.gain_e_per_dn;
        white.floor().max(step.black_level_dn + 1.0)
    }

    /// Electrons of that number.
    fn white_e(&self, step: &IsoStep) -> f64 {
        (self.white_level_dn(step) - step.black_level_dn) * step.gain_e_per_dn
    }

    /// Stops by which a picture at a setting is brightened for what was metered alike to be shown as at the lowest speed: between speeds cameras change the range of their numbers and
    /// round their amplification, and what is metered is a little more or less of it. Makers of raw converters measure the same for `BaselineExposure`, by camera and speed.
    pub fn brightening_ev(&self, step: &IsoStep) -> f64 {
        let lowest = &self.iso[0];
        (self.white_e(step) * step.iso / (self.white_e(lowest) * lowest.iso)).log2()
    }

    /// Stops by which half of the light of each pixel, in half of a well, is brightened more than all of it: 0 where the wells limit, 1 where the converter does.
    pub fn brightening_of_half_ev(&self) -> f64 {
        let half = Sensor { full_well_e: 0.5 * self.full_well_e, ..self.clone() };
        1.0 + (half.white_e(&self.iso[0]) / self.white_e(&self.iso[0])).log2()
    }

    /// Electrons at which a setting saturates: the well's or the converter's, whichever comes first.
    pub fn saturation_e(&self, step: &IsoStep) -> f64 {
        let converter = (step.white_level_dn - step.black_level_dn) * step.gain_e_per_dn;
        let well = self.second_reading.map_or(self.full_well_e, |s| s.full_well_e / s.relative_exposure);
        well.min(converter)
    }
}

/// The saturation capacity that EMVA 1288 finds (the mean at which the temporal variance is largest) where counting stops
/// at `limit_e`, with a dark noise of `dark_noise_e`: a few deviations below the limit. All in e⁻.
pub fn saturation_capacity(limit_e: f64, dark_noise_e: f64) -> f64 {
    let variance = |mean: f64| {
        let s2 = mean + dark_noise_e * dark_noise_e;
        let x = (limit_e - mean) / s2.sqrt();
        let density = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let above = upper_tail(x);
        let first = x * above - density;
        let second = 1.0 - above - x * density + x * x * above;
        s2 * (second - first * first)
    };
    let s = limit_e.sqrt() + dark_noise_e;
    // The largest over a fine grid: the curve is smooth and has one maximum there.
    let grid = |i: usize| limit_e - 6.0 * s * i as f64 / 2400.0;
    (0..=2400).map(grid).max_by(|a, b| variance(*a).total_cmp(&variance(*b))).unwrap_or(limit_e).max(0.0)
}

/// Fraction of a normal distribution above x. Source: Abramowitz & Stegun 26.2.17, 7.5e-8 exact.
fn upper_tail(x: f64) -> f64 {
    if x < 0.0 {
        return 1.0 - upper_tail(-x);
    }
    let t = 1.0 / (1.0 + 0.231_641_9 * x);
    let p = t * (0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    p * (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_embedded_body_parses_and_cites_its_numbers() {
        for name in Sensor::names() {
            let s = Sensor::named(name).unwrap();
            for what in ["geometry", "response", "peak_quantum_efficiency", "full_well", "readout", "levels"] {
                assert!(s.sources.contains_key(what), "{name}: no source for {what}");
            }
            for (given, what) in [
                (s.prnu > 0.0 || s.dsnu_e > 0.0, "nonuniformity"),
                (!s.dark_current.points.is_empty(), "dark_current"),
                (s.hot_pixels.fraction > 0.0, "hot_pixels"),
                (s.low_pass_px > 0.0 || s.crosstalk > 0.0 || s.fill_factor < 1.0, "blur"),
                (s.second_reading.is_some(), "second_reading"),
            ] {
                assert!(!given || s.sources.contains_key(what), "{name}: no source for {what}");
            }
            assert!(s.quantum_efficiency.iter().all(|q| q.max() <= 1.0));
        }
    }

    #[test]
    fn green_saturates_where_iso_100_says() {
        // H_sat = 78/S lx·s of D55 (ISO 12232): electrons = ∫ response × D55 (1 lx) × pixel area × H_sat, for the channel
        // that saturates first, of bodies whose efficiency is derived from it.
        let d55 = diopter_light::cie::illuminant("D55").unwrap();
        let lux = diopter_light::color::luminance(|nm| if (380.0..=780.0).contains(&nm) { d55.at(nm) } else { 0.0 });
        let mut checked = 0;
        for name in Sensor::names() {
            let s = Sensor::named(name).unwrap();
            if !s.sources["peak_quantum_efficiency"].starts_with("derived") && name != "ideal" {
                continue;
            }
            let per_joule = |r: &Table| (380..=780).map(|nm| (r.at(nm as f32) * d55.at(nm as f32)) as f64).sum::<f64>() / lux;
            let most = s.band_responses().iter().map(per_joule).fold(0.0, f64::max);
            let [w, h] = s.pitch_mm().map(|p| p * 1e-3);
            let step = s.at_iso(s.iso[0].iso).unwrap();
            let electrons = most * w * h * 78.0 / step.iso;
            assert!((electrons / s.saturation_e(&step) - 1.0).abs() < 0.03, "{name}: {electrons} of {}", s.saturation_e(&step));
            checked += 1;
        }
        assert!(checked >= 9, "{checked}");
    }

    #[test]
    fn iso_between_settings_is_interpolated_and_outside_is_refused() {
        let s = Sensor::named("canon-5d-mark-ii").unwrap();
        assert!((s.at_iso(400.0).unwrap().gain_e_per_dn - 1.01).abs() < 1e-9);
        assert!((s.at_iso(283.0).unwrap().gain_e_per_dn - 1.4276).abs() < 1e-3);
        assert!(s.at_iso(50.0).unwrap_err().to_string().contains("100 to 1600"));
        assert!(s.at_iso(-5.0).is_err() && s.at_iso(f64::NAN).is_err());
    }

    #[test]
    fn two_stages_explain_the_ladders_of_amplified_sensors() {
        // Stages fitted to C. Buil's tables; some amplifiers have more than two.
        for (name, before, after, worst) in [("canon-5d", 3.43, 1.87, 0.03), ("canon-5d-mark-ii", 2.43, 6.63, 0.03)] {
            let (model, off) = Sensor::named(name).unwrap().two_stage().unwrap();
            assert!(
                (model.before_e / before - 1.0).abs() < 0.06 && (model.after_dn / after - 1.0).abs() < 0.04,
                "{name}: {model:?}"
            );
            assert!(off < worst, "{name}: {off}");
        }
        assert_eq!(Sensor::named("imx249").unwrap().two_stage(), None);
    }

    #[test]
    fn a_misspelt_body_gets_a_hint() {
        let e = Sensor::named("nikon-d580").unwrap_err().to_string();
        assert!(e.contains("did you mean \"nikon-d850\""), "{e}");
        let e = Sensor::parse("name = 3", "x.toml").unwrap_err().to_string();
        assert!(e.starts_with("x.toml:"), "{e}");
    }

    #[test]
    fn dark_current_follows_its_points_and_doubles_beyond() {
        let d = DarkCurrent { points: vec![[0.0, 0.01], [10.0, 0.04]], doubling_c: 6.0 };
        for (c, e) in [(0.0, 0.01), (5.0, 0.02), (10.0, 0.04), (16.0, 0.08), (-6.0, 0.005)] {
            assert!((d.at(c) / e - 1.0).abs() < 1e-9, "{c}: {}", d.at(c));
        }
        assert_eq!(DarkCurrent::default().at(30.0), 0.0);
    }

    #[test]
    fn the_variance_is_largest_three_deviations_below_the_limit() {
        for (limit, least, most) in [(1e4, 2.4, 3.2), (1e5, 2.9, 3.6)] {
            let below = (limit - saturation_capacity(limit, 5.0)) / f64::sqrt(limit);
            assert!((least..most).contains(&below), "{limit}: {below}");
        }
    }

    #[test]
    fn crosstalk_mixes_neighbours_and_keeps_the_sum() {
        let mut s = Sensor::named("canon-5d-mark-iv").unwrap();
        s.crosstalk = 0.02;
        let mixed = s.mixed_by_crosstalk(&[1.0, 2.0, 4.0]);
        // Red has four green neighbours, green two of red and of blue.
        assert!((mixed[0] - (0.92 + 0.16)).abs() < 1e-12 && (mixed[1] - (1.84 + 0.04 + 0.16)).abs() < 1e-12);
        assert!((mixed[0] + 2.0 * mixed[1] + mixed[2] - 9.0).abs() < 1e-12);
    }
}

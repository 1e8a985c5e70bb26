//! The read-out, in the order of the physics: crosstalk, photo response, dark current, shot noise, full well, fixed offsets,
//! row and read noise, gain, black level, conversion.
//!
//! With µ the mean electrons of a pixel (light through its filter times its own response, plus what leaks), K = 1/gain:
//! y = clip(round(black + K (min(Poisson(µ), full well) + offset + N(0, σ_row) + N(0, σ_d)))). Wells may flow over into their
//! neighbours, a second reading with less light may take the place of the first, a digital gain multiplies what was converted.
//! The Monte Carlo error of µ is *not* added: it travels in the focal plane. Symbols: EMVA 1288, release 4.0.

use crate::calibration::{calibrations, neutral};
use crate::noise::{mix, normal_quantile, poisson_quantile, unit};
use crate::pattern::Pattern;
use crate::sensor::{IsoStep, SecondReading};
use crate::{Sensor, SensorError};
use diopter_image::focal_plane::{Band, BandUnit};
use diopter_image::{Cfa, ExposureFacts, FocalPlane, Raster, RawHeader, RawImage, RowTimes};
use diopter_light::spectrum::Table;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Which colours each pixel of a picture is read in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorSampling {
    /// That of its filter, as the colour filter array says.
    #[default]
    Mosaic,
    /// Red, green and blue, as three chips, stacked photodiodes or pixel shift read them: a photosite of each colour, with noise and a fixed
    /// pattern of its own, in the same place and at the same time. Nothing is demosaiced.
    Full,
}

impl std::str::FromStr for ColorSampling {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "mosaic" => Ok(ColorSampling::Mosaic),
            "full" => Ok(ColorSampling::Full),
            _ => Err(format!("\"{text}\" is neither mosaic nor full")),
        }
    }
}

/// How a sensor is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// ISO speed.
    pub iso: f64,
    /// Draws the noise that is new each time.
    pub seed: u64,
    /// Draws the pattern that stays.
    pub serial: String,
    /// Temperature, °C; the sheet's own without.
    pub temperature_c: Option<f64>,
    /// Name of the illuminant taken for white.
    pub white: String,
    /// Which colours each pixel is read in.
    pub color_sampling: ColorSampling,
}

impl Reading {
    /// The serial number of a body that has no other.
    pub const FIRST_SERIAL: &str = "000001";

    /// Reads at an ISO speed with a seed; D65, the sheet's temperature, the first serial number.
    pub fn new(iso: f64, seed: u64) -> Self {
        Reading {
            iso,
            seed,
            serial: Self::FIRST_SERIAL.into(),
            temperature_c: None,
            white: "D65".into(),
            color_sampling: ColorSampling::Mosaic,
        }
    }
}

/// What is asked of a reading; the rest is what the plane's camera was set to, or the usual.
#[derive(Clone, Debug, Default)]
pub struct AskedReading {
    /// ISO speed.
    pub iso: Option<f64>,
    /// Serial number of the body.
    pub serial: Option<String>,
    /// Temperature, °C.
    pub temperature_c: Option<f64>,
    /// Illuminant that is taken for white.
    pub white: Option<String>,
    /// Which colours each pixel is read in.
    pub color_sampling: Option<ColorSampling>,
}

impl AskedReading {
    /// The reading of a sensor by a seed; `set`: of a plane that this body exposed.
    pub fn reading(&self, sensor: &Sensor, set: Option<&ExposureFacts>, seed: u64) -> Reading {
        let usual = Reading::new(sensor.resolve_iso(self.iso, set.map_or(0.0, |facts| facts.iso_set)), seed);
        let or_set = |asked: &Option<String>, set: Option<&String>, usual: String| {
            asked.as_ref().or(set.filter(|set| !set.is_empty())).cloned().unwrap_or(usual)
        };
        Reading {
            serial: or_set(&self.serial, set.map(|facts| &facts.serial), usual.serial),
            temperature_c: self.temperature_c.or(set.and_then(|facts| facts.temperature_c)),
            color_sampling: self.color_sampling.unwrap_or_default(),
            white: or_set(&self.white, set.map(|facts| &facts.white), usual.white),
            ..usual
        }
    }
}

/// Rows of a focal plane: mean electrons `[row][column][band]`, from row `first` on.
#[derive(Clone, Copy)]
pub struct Window<'a> {
    /// First row it holds.
    pub first: usize,
    /// Its numbers.
    pub data: &'a [f32],
}

/// A read-out that has been checked and can be done row by row, in any order.
pub struct ReadOut<'a> {
    sensor: &'a Sensor,
    step: IsoStep,
    /// Numbers a pixel: 1 of a mosaic, as many as channels where each pixel is read in all.
    samples: usize,
    /// How many neighbours of each channel see each one, as [`Cfa::neighbours`] has it: crosstalk between photosites that no mosaic is read of.
    neighbours: Vec<Vec<f64>>,
    /// Numbers a row.
    width: usize,
    height: usize,
    /// How, with the temperature settled.
    reading: Reading,
    pattern: Pattern,
    /// Dark current of the mean pixel, e⁻/s.
    dark_e_per_s: f64,
    /// How long pixels gather charge, s.
    exposure_s: f64,
    /// The same by row or column, where these differ.
    lines: Option<RowTimes>,
    /// Electrons a well holds; infinite where the converter is full first.
    well_e: f64,
    /// The same of all readings together.
    full_e: f64,
    /// DN from which a pixel is taken for full.
    white_level: f64,
}

/// What is known of a pixel beside its number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expected {
    /// Mean electrons of light, through the pixel's filter and by its own response.
    pub electrons: f32,
    /// Mean electrons of dark current.
    pub dark: f32,
    /// The number that would be read without noise of time, fixed offsets and clipping included; not rounded.
    pub dn: f32,
    /// Variance that a read-out adds, e⁻²: shot noise, row and read noise, rounding. Where the well is full there is no shot
    /// noise, where the converter is, none at all; at the edge of either it is between.
    pub variance: f32,
    /// Whether the well or the converter is full on average.
    pub clipped: bool,
}

impl<'a> ReadOut<'a> {
    /// Prepares to read a plane of a size that was exposed for a time. Fails when the ISO is outside the body's, the temperature outside
    /// −273.15 to 200 °C, the bands are not this sensor's channels in electrons, or all colours are asked of a sensor whose filters aren't red, green and blue.
    pub fn new(
        sensor: &'a Sensor,
        reading: &Reading,
        [width, height]: [usize; 2],
        bands: &[Band],
        exposure_s: f64,
    ) -> Result<Self, SensorError> {
        let step = sensor.at_iso(reading.iso)?;
        let names: Vec<&str> = bands.iter().map(|b| b.name.as_str()).collect();
        if names != sensor.cfa.channel_names() || bands.iter().any(|b| b.unit != BandUnit::Electrons) {
            let unit = if bands.iter().any(|b| b.unit != BandUnit::Electrons) { " (not electrons)" } else { "" };
            return Err(SensorError::Bands {
                found: format!("{}{unit}", names.join(", ")),
                expected: format!("{} reads out electrons in {}", sensor.name, sensor.cfa.channel_names().join(", ")),
            });
        }
        let celsius = reading.temperature_c.unwrap_or(sensor.temperature_c);
        if !(-273.15..=200.0).contains(&celsius) {
            return Err(SensorError::Range {
                what: "temperature".into(),
                found: format!("{celsius} °C"),
                expected: "-273 to 200 °C".into(),
            });
        }
        let samples = match reading.color_sampling {
            ColorSampling::Mosaic => 1,
            ColorSampling::Full if sensor.has_color_filters() => sensor.cfa.channel_count(),
            ColorSampling::Full => {
                return Err(SensorError::Range {
                    what: "color sampling".into(),
                    found: format!("full, of {} with {}", sensor.name, sensor.cfa.channel_names().join(", ")),
                    expected: "mosaic, or a sensor with red, green and blue filters".into(),
                });
            }
        };
        let (full_e, well_first) = (sensor.saturation_e(&step), sensor.is_well_first(&step));
        Ok(ReadOut {
            dark_e_per_s: sensor.dark_current.at(celsius),
            exposure_s: exposure_s.max(0.0),
            lines: None,
            pattern: Pattern::new(sensor, &reading.serial, width * samples),
            well_e: if well_first { sensor.full_well_e } else { f64::INFINITY },
            full_e: if well_first { full_e } else { f64::INFINITY },
            reading: Reading { temperature_c: Some(celsius), ..reading.clone() },
            white_level: sensor.white_level_dn(&step),
            step,
            sensor,
            samples,
            neighbours: sensor.cfa.neighbours(),
            width: width * samples,
            height,
        })
    }

    /// Numbers a row of what is read: pixels, times channels where each pixel is read in all.
    pub fn numbers_per_row(&self) -> usize {
        self.width
    }

    /// Lets each row (or column) gather dark current for as long as it is open by the facts of the plane. Of a sensor whose rows are reset all
    /// at once and read one after the other the last gather longest; mechanical shutters leave all rows their exposure time.
    #[must_use]
    pub fn with_rows_of(mut self, facts: &ExposureFacts) -> Self {
        let rolling = facts.shutter.as_ref().filter(|s| s.kind == "rolling");
        self.lines = rolling.map(|s| s.rows).filter(|rows| rows.open_s[1] != rows.close_s[1]);
        self
    }

    /// Mean electrons of dark current in a pixel that leaks as the mean does; `column` counts the numbers of a row.
    fn dark_e(&self, column: usize, row: usize) -> f64 {
        let seconds = match &self.lines {
            None => self.exposure_s,
            Some(lines) => {
                let (open, close) = lines.of(if lines.columns { column / self.samples } else { row });
                (close - open).max(0.0)
            }
        };
        self.dark_e_per_s * seconds
    }

    /// What the raw file says. `facts` are the plane's; `white` is the spectrum of [`Reading::white`].
    pub fn header(&self, facts: &ExposureFacts, white: &Table) -> RawHeader {
        let (sensor, step, reading) = (self.sensor, &self.step, &self.reading);
        let range = self.white_level - step.black_level_dn;
        let rounding = step.digital_gain.powi(2) / 12.0;
        let floor = (step.read_noise_e.powi(2) + step.row_noise_e.powi(2)) / step.gain_e_per_dn.powi(2) + rounding;
        RawHeader {
            cfa: if self.samples == 1 { sensor.cfa.clone() } else { Cfa::linear_rgb() },
            bits: sensor.adc_bits,
            black_level: step.black_level_dn,
            white_level: self.white_level,
            baseline_ev: sensor.brightening_ev(step),
            framing: Default::default(),
            opcodes: vec![],
            warnings: vec![],
            as_shot_neutral: neutral(sensor, white),
            calibrations: calibrations(sensor),
            noise: vec![[1.0 / (step.gain_e_per_dn * range), floor / (range * range)]; sensor.cfa.channel_count()],
            facts: ExposureFacts {
                iso: reading.iso,
                body: sensor.name.clone(),
                make: sensor.make.clone(),
                model: format!("{} (simulated)", sensor.model),
                serial: reading.serial.clone(),
                temperature_c: reading.temperature_c,
                noise_seed: reading.seed,
                white: reading.white.clone(),
                polarizers: if sensor.cfa.tells_polarization() { sensor.cfa.letters() } else { String::new() },
                ..facts.clone()
            },
        }
    }

    /// Mean electrons of light in the photosites of a row, crosstalk included. The window must hold the row and its neighbours.
    fn light(&self, window: &Window, row: usize, to: &mut [f64]) {
        if self.samples == 1 { self.light_of_mosaic(window, row, to) } else { self.light_in_all_channels(window, row, to) }
    }

    fn light_of_mosaic(&self, window: &Window, row: usize, to: &mut [f64]) {
        let bands = self.sensor.cfa.channel_count();
        let line = |r: usize| &window.data[(r - window.first) * self.width * bands..][..self.width * bands];
        let alone = |r: usize, c: usize| f64::from(line(r)[c * bands + self.sensor.cfa.channel_at(c, r)]);
        // The pattern of this row, so that no pixel looks for its place in it.
        let channels: Vec<usize> = (0..self.sensor.cfa.columns()).map(|c| self.sensor.cfa.channel_at(c, row)).collect();
        let here = line(row);
        for (start, block) in to.chunks_mut(channels.len()).enumerate() {
            let offset = start * channels.len();
            for (i, v) in block.iter_mut().enumerate() {
                *v = f64::from(here[(offset + i) * bands + channels[i]]);
            }
        }
        let fraction = self.sensor.crosstalk;
        if fraction > 0.0 {
            let (above, below) = (row.saturating_sub(1), (row + 1).min(self.height - 1));
            for c in 0..self.width {
                let (left, right) = (c.saturating_sub(1), (c + 1).min(self.width - 1));
                let gained = alone(row, left) + alone(row, right) + alone(above, c) + alone(below, c);
                to[c] = (1.0 - 4.0 * fraction) * alone(row, c) + fraction * gained;
            }
        }
    }

    /// The neighbours of a photosite have the colours that they have in the mosaic.
    fn light_in_all_channels(&self, window: &Window, row: usize, to: &mut [f64]) {
        let line = |r: usize| &window.data[(r - window.first) * self.width..][..self.width];
        to.iter_mut().zip(line(row)).for_each(|(to, v)| *to = f64::from(*v));
        let fraction = self.sensor.crosstalk;
        if fraction > 0.0 {
            let n = self.samples;
            let (above, below) = (row.saturating_sub(1), (row + 1).min(self.height - 1));
            for (x, to) in to.chunks_mut(n).enumerate() {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(self.width / n - 1));
                let around = [&line(row)[left * n..], &line(row)[right * n..], &line(above)[x * n..], &line(below)[x * n..]];
                let mean = |channel: usize| around.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / 4.0;
                for (to, neighbours) in to.iter_mut().zip(&self.neighbours) {
                    let gained: f64 = neighbours.iter().enumerate().map(|(channel, count)| count * mean(channel)).sum();
                    *to = (1.0 - 4.0 * fraction) * *to + fraction * gained;
                }
            }
        }
    }

    /// Mean electrons of light in a row of the mosaic of any quantity that is linear in light: such as the error of the mean. The window as
    /// for [`ReadOut::rows`].
    pub fn through_filters(&self, window: &Window, row: usize) -> Vec<f64> {
        let mut light = vec![0.0; self.width];
        self.light(window, row, &mut light);
        light
    }

    /// Electrons counted in a row before any well is full; of the second reading too, if there is one.
    fn count(&self, window: &Window, row: usize, to: &mut Row) {
        self.light(window, row, &mut to.first);
        for (c, v) in to.first.iter_mut().enumerate() {
            let p = self.pattern.pixel(c, row);
            // Light and dark current are one shot noise.
            let mean = *v * p.response + self.dark_e(c, row) * p.leak;
            *v = poisson_quantile(mean, self.uniform(SHOT, row, c));
            if let Some(second) = &self.sensor.second_reading {
                // Photons of its own.
                to.second[c] = poisson_quantile(mean * second.relative_exposure, self.uniform(SECOND, row, c));
            }
        }
    }

    fn uniform(&self, purpose: u64, row: usize, column: usize) -> f64 {
        unit(mix(self.reading.seed ^ purpose, (row as u64) << 32 | column as u64))
    }

    /// From counted electrons to numbers.
    fn convert(&self, row: usize, counted: &Row, to: &mut [u16]) {
        let (s, step) = (self.sensor, &self.step);
        let top = self.step.white_level_dn.min(f64::from((1u32 << s.adc_bits) - 1));
        let mut shared = self.pattern.row_e(row);
        if step.row_noise_e > 0.0 {
            shared += step.row_noise_e * normal_quantile(self.uniform(ROW, row, 0));
        }
        let per_e = 1.0 / step.gain_e_per_dn;
        for (c, (n, dn)) in counted.first.iter().zip(to).enumerate() {
            let offset = shared + self.pattern.offset_e(c, row);
            let noise = if step.read_noise_e > 0.0 { normal_quantile(self.uniform(READ, row, c)) } else { 0.0 };
            let signal = match &s.second_reading {
                None => n.min(self.well_e) + offset + noise * step.read_noise_e,
                Some(second) => self.combined(second, [*n, counted.second[c]], offset, noise, self.uniform(SECOND_READ, row, c)),
            };
            let y = match step.digital_gain == 1.0 {
                true => (step.black_level_dn + signal * per_e).round(),
                // The converter's number is multiplied: levels between are never seen.
                false => step.black_level_dn + ((signal * per_e / step.digital_gain).round() * step.digital_gain).round(),
            };
            *dn = y.clamp(0.0, top) as u16;
        }
    }

    /// The first reading as long as it is not full, else the second, in electrons of the first.
    fn combined(&self, second: &SecondReading, counted: [f64; 2], offset: f64, noise: f64, u: f64) -> f64 {
        let first = counted[0].min(self.well_e) + offset + noise * self.step.read_noise_e;
        if first < second.switch_at * self.well_e {
            return first;
        }
        let read = second.read_noise_e * normal_quantile(u);
        (counted[1].min(second.full_well_e) + offset + read) / second.relative_exposure
    }

    /// Reads rows `first..` into `to` (whole rows). The window must hold them and, with crosstalk, one row on either side. The
    /// wells of a sensor that blooms flow over from row to row: see [`ReadOut::electrons`].
    pub fn rows(&self, window: &Window, first: usize, to: &mut [u16]) {
        to.par_chunks_mut(self.width).enumerate().for_each_init(
            || Row::new(self.width),
            |counted, (i, line)| {
                self.count(window, first + i, counted);
                self.convert(first + i, counted, line);
            },
        );
    }

    /// The first half of [`ReadOut::rows`]: electrons counted in rows `first..`, before any well is full. Those of the whole
    /// picture can then [`ReadOut::bloom`]. `to`: e⁻, whole rows.
    pub fn electrons(&self, window: &Window, first: usize, to: &mut [f32]) {
        to.par_chunks_mut(self.width).enumerate().for_each_init(
            || Row::new(self.width),
            |counted, (i, line)| {
                self.count(window, first + i, counted);
                line.iter_mut().zip(&counted.first).for_each(|(a, b)| *a = *b as f32);
            },
        );
    }

    /// Lets the wells of a whole picture (e⁻, `[row][column]`) flow over, if this sensor's do.
    pub fn bloom(&self, electrons: &mut [f32]) {
        if self.sensor.blooming {
            bloom(electrons, self.width, self.sensor.full_well_e as f32);
        }
    }

    /// The second half of [`ReadOut::rows`]: numbers of rows `first..` from their electrons. Not for sensors with a second reading, whose
    /// electrons are not among them.
    pub fn numbers(&self, first: usize, electrons: &[f32], to: &mut [u16]) {
        to.par_chunks_mut(self.width).zip(electrons.par_chunks(self.width)).enumerate().for_each(|(i, (to, line))| {
            let line = line.iter().map(|v| f64::from(*v)).collect();
            self.convert(first + i, &Row { first: line, second: vec![0.0; self.width] }, to);
        });
    }

    /// What is expected of the pixels of a row. What blooms from elsewhere is not in it. The window as for [`ReadOut::rows`].
    pub fn expected(&self, window: &Window, row: usize) -> Vec<Expected> {
        let (s, step) = (self.sensor, &self.step);
        let rounding = (step.gain_e_per_dn * step.digital_gain).powi(2) / 12.0;
        let limit = self.full_e;
        let read = step.read_noise_e.powi(2) + step.row_noise_e.powi(2);
        let row_e = self.pattern.row_e(row);
        let of = |(c, v): (usize, &f64)| {
            let p = self.pattern.pixel(c, row);
            // The rendered mean may be negative by less than its error where the lens disperses (control variate); electrons are then 0.
            let (electrons, dark) = ((v * p.response).max(0.0), self.dark_e(c, row) * p.leak);
            let (total, clipped) = (electrons + dark, electrons + dark >= limit);
            let shot = |mean: f64| if clipped { 0.0 } else { mean };
            let mut offset = row_e + self.pattern.offset_e(c, row);
            let variance = match &s.second_reading {
                Some(r) if total >= r.switch_at * self.well_e => {
                    offset /= r.relative_exposure;
                    let read = (r.read_noise_e.powi(2) + step.row_noise_e.powi(2)) / r.relative_exposure.powi(2);
                    shot(total / r.relative_exposure) + read
                }
                _ => shot(total) + read,
            };
            let dn = step.black_level_dn + (total.min(limit) + offset) / step.gain_e_per_dn;
            let converter_full = dn >= step.white_level_dn;
            Expected {
                electrons: electrons as f32,
                dark: dark as f32,
                dn: dn.clamp(0.0, step.white_level_dn) as f32,
                variance: if converter_full { 0.0 } else { (variance + rounding) as f32 },
                clipped: clipped || converter_full,
            }
        };
        self.through_filters(window, row).iter().enumerate().map(of).collect()
    }
}

/// Electrons of a row, before any well is full.
struct Row {
    first: Vec<f64>,
    /// Of the second reading; 0 where there is none.
    second: Vec<f64>,
}

impl Row {
    fn new(width: usize) -> Self {
        Row { first: vec![0.0; width], second: vec![0.0; width] }
    }
}

/// Purposes of random numbers.
const SHOT: u64 = 0x5407;
const READ: u64 = 0x4ead << 20;
const ROW: u64 = 0x4011 << 36;
const SECOND: u64 = 0x5ec0 << 44;
const SECOND_READ: u64 = 0x5ec1 << 28;

/// What a well cannot hold runs to its neighbours above and below in equal parts, on and on until it is taken up or lost at
/// the ends of the column.
fn bloom(electrons: &mut [f32], width: usize, full_well: f32) {
    let height = electrons.len() / width;
    for column in 0..width {
        // Down and up: each way carries half of what overflows, and all that is handed on.
        for rows in [&mut (0..height) as &mut dyn Iterator<Item = usize>, &mut (0..height).rev()] {
            let mut carried = 0.0f64;
            for row in rows {
                let cell = &mut electrons[row * width + column];
                // A pixel over its limit keeps half of the surplus for the other way.
                let over = f64::from((*cell - full_well).max(0.0));
                let room = f64::from((full_well - *cell).max(0.0));
                let taken = carried.min(room);
                *cell += taken as f32;
                carried = carried - taken + over * 0.5;
            }
        }
    }
    electrons.iter_mut().for_each(|e| *e = e.min(full_well));
}

/// Reads a whole exposure out. `white` is the spectrum of [`Reading::white`]. Fails as [`ReadOut::new`].
pub fn read_out(plane: &FocalPlane, sensor: &Sensor, reading: &Reading, white: &Table) -> Result<RawImage, SensorError> {
    let (width, height) = (plane.width(), plane.height());
    let reader = ReadOut::new(sensor, reading, [width, height], &plane.bands, plane.facts.exposure_s)?.with_rows_of(&plane.facts);
    let mut mosaic = Raster::<u16>::new(reader.width, height, 1);
    let window = Window { first: 0, data: &plane.mean.data };
    match sensor.blooming {
        false => reader.rows(&window, 0, &mut mosaic.data),
        true => {
            let mut electrons = vec![0.0; reader.width * height];
            reader.electrons(&window, 0, &mut electrons);
            reader.bloom(&mut electrons);
            reader.numbers(0, &electrons, &mut mosaic.data);
        }
    }
    Ok(RawImage { mosaic, header: reader.header(&plane.facts, white) })
}

#[cfg(test)]
mod tests;

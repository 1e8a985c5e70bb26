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
use diopter_image::{ExposureFacts, FocalPlane, Raster, RawHeader, RawImage, RowTimes};
use diopter_light::spectrum::Table;
use rayon::prelude::*;

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
}

impl Reading {
    /// The serial number of a body that has no other.
    pub const FIRST_SERIAL: &str = "000001";

    /// Reads at an ISO speed with a seed; D65, the sheet's temperature, the first serial number.
    pub fn new(iso: f64, seed: u64) -> Self {
        Reading { iso, seed, serial: Self::FIRST_SERIAL.into(), temperature_c: None, white: "D65".into() }
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
    width: usize,
    height: usize,
    /// How, with the temperature settled.
    reading: Reading,
    pattern: Pattern,
    /// Mean electrons that leak in a second.
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
    /// Mean electrons that leak.
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
    /// Prepares to read a plane of a size that was exposed for a time. Fails when the ISO is outside the body's or the bands are
    /// not this sensor's channels in electrons.
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
        // A well as large as the converter's range never limits. Where a well is full first, what is read of it still has
        // its noise: three deviations below, nearly all full pixels are counted as such. Whole numbers, as files hold them.
        let converter_e = (step.white_level_dn - step.black_level_dn) * step.gain_e_per_dn;
        let full_e = sensor.saturation_e(&step);
        let well_first = full_e < 0.999 * converter_e || sensor.second_reading.is_some();
        let mut spread = [step.read_noise_e, step.row_noise_e, sensor.dsnu_e, sensor.dsnu_row_e, sensor.dsnu_column_e]
            .iter()
            .fold(0.0, |a: f64, b| a.hypot(*b));
        if let Some(second) = &sensor.second_reading {
            spread = spread.hypot(second.read_noise_e) / second.relative_exposure;
        }
        let white_level = match well_first {
            true => (step.black_level_dn + (full_e - 3.0 * spread) / step.gain_e_per_dn).floor().max(step.black_level_dn + 1.0),
            false => step.white_level_dn,
        };
        Ok(ReadOut {
            dark_e_per_s: sensor.dark_current.at(celsius),
            exposure_s: exposure_s.max(0.0),
            lines: None,
            pattern: Pattern::new(sensor, &reading.serial, width),
            well_e: if well_first { sensor.full_well_e } else { f64::INFINITY },
            full_e: if well_first { full_e } else { f64::INFINITY },
            reading: Reading { temperature_c: Some(celsius), ..reading.clone() },
            white_level,
            step,
            sensor,
            width,
            height,
        })
    }

    /// Lets each row (or column) gather dark current for as long as it is open by the facts of the plane. Of a sensor whose rows are reset all
    /// at once and read one after the other the last gather longest; mechanical shutters leave all rows their exposure time.
    #[must_use]
    pub fn with_rows_of(mut self, facts: &ExposureFacts) -> Self {
        let rolling = facts.shutter.as_ref().filter(|s| s.kind == "rolling");
        self.lines = rolling.map(|s| s.rows).filter(|rows| rows.open_s[1] != rows.close_s[1]);
        self
    }

    /// Mean electrons that leak into a pixel that leaks as the mean does.
    fn dark_e(&self, column: usize, row: usize) -> f64 {
        let seconds = match &self.lines {
            None => self.exposure_s,
            Some(lines) => {
                let (open, close) = lines.of(if lines.columns { column } else { row });
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
            cfa: sensor.cfa.clone(),
            bits: sensor.adc_bits,
            black_level: step.black_level_dn,
            white_level: self.white_level,
            baseline_ev: 0.0,
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

    /// Mean electrons of light in a row of the mosaic, crosstalk included. The window must hold the row and its neighbours.
    fn light(&self, window: &Window, row: usize, to: &mut [f64]) {
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

    /// Mean electrons of light in a row of the mosaic of any quantity that is linear in light: such as the error of the mean.
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
    /// picture can then [`ReadOut::bloom`].
    pub fn electrons(&self, window: &Window, first: usize, to: &mut [f32]) {
        to.par_chunks_mut(self.width).enumerate().for_each_init(
            || Row::new(self.width),
            |counted, (i, line)| {
                self.count(window, first + i, counted);
                line.iter_mut().zip(&counted.first).for_each(|(a, b)| *a = *b as f32);
            },
        );
    }

    /// Lets the wells of a whole picture flow over, if this sensor's do.
    pub fn bloom(&self, electrons: &mut [f32]) {
        if self.sensor.blooming {
            bloom(electrons, self.width, self.sensor.full_well_e as f32);
        }
    }

    /// The second half of [`ReadOut::rows`]: numbers of rows `first..` from their electrons.
    pub fn numbers(&self, first: usize, electrons: &[f32], to: &mut [u16]) {
        to.par_chunks_mut(self.width).zip(electrons.par_chunks(self.width)).enumerate().for_each(|(i, (to, line))| {
            let line = line.iter().map(|v| f64::from(*v)).collect();
            self.convert(first + i, &Row { first: line, second: vec![0.0; self.width] }, to);
        });
    }

    /// What is expected of the pixels of a row. What blooms from elsewhere is not in it.
    pub fn expected(&self, window: &Window, row: usize) -> Vec<Expected> {
        let (s, step) = (self.sensor, &self.step);
        let rounding = (step.gain_e_per_dn * step.digital_gain).powi(2) / 12.0;
        let limit = self.full_e;
        let read = step.read_noise_e.powi(2) + step.row_noise_e.powi(2);
        let row_e = self.pattern.row_e(row);
        let of = |(c, v): (usize, &f64)| {
            let p = self.pattern.pixel(c, row);
            // The renderer's mean may be below nothing by less than its error, where colours part; of electrons there are none then.
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

/// Reads a whole exposure out. `white` is the spectrum of [`Reading::white`].
pub fn read_out(plane: &FocalPlane, sensor: &Sensor, reading: &Reading, white: &Table) -> Result<RawImage, SensorError> {
    let (width, height) = (plane.width(), plane.height());
    let reader = ReadOut::new(sensor, reading, [width, height], &plane.bands, plane.facts.exposure_s)?.with_rows_of(&plane.facts);
    let mut mosaic = Raster::<u16>::new(width, height, 1);
    let window = Window { first: 0, data: &plane.mean.data };
    match sensor.blooming {
        false => reader.rows(&window, 0, &mut mosaic.data),
        true => {
            let mut electrons = vec![0.0; width * height];
            reader.electrons(&window, 0, &mut electrons);
            reader.bloom(&mut electrons);
            reader.numbers(0, &electrons, &mut mosaic.data);
        }
    }
    Ok(RawImage { mosaic, header: reader.header(&plane.facts, white) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::cie::illuminant;

    fn flat(sensor: &Sensor, electrons: f32, exposure_s: f64, size: [usize; 2]) -> FocalPlane {
        let facts = ExposureFacts { exposure_s, ..Default::default() };
        FocalPlane::even(sensor.bands(), &vec![electrons; sensor.cfa.channel_count()], size, facts)
    }

    fn read(sensor: &Sensor, plane: &FocalPlane, reading: &Reading) -> RawImage {
        read_out(plane, sensor, reading, &illuminant("D65").unwrap()).unwrap()
    }

    fn moments(values: &[u16]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().map(|d| *d as f64).sum::<f64>() / n;
        (mean, values.iter().map(|d| (*d as f64 - mean).powi(2)).sum::<f64>() / (n - 1.0))
    }

    fn statistics(sensor: &Sensor, electrons: f32, iso: f64, seed: u64) -> (f64, f64) {
        moments(&read(sensor, &flat(sensor, electrons, 0.0, [200, 200]), &Reading::new(iso, seed)).mosaic.data)
    }

    fn plain(name: &str) -> Sensor {
        let mut s = Sensor::named(name).unwrap();
        (s.prnu, s.dsnu_e, s.dsnu_row_e, s.dsnu_column_e, s.hot_pixels.fraction) = (0.0, 0.0, 0.0, 0.0, 0.0);
        s.iso.iter_mut().for_each(|i| i.row_noise_e = 0.0);
        s
    }

    #[test]
    fn photon_transfer_has_the_slope_of_the_gain() {
        // σ² = K²σ_d² + 1/12 + K (μ − μ_dark), EMVA 1288 eq. 12; 40 000 pixels give σ² within 0.7 %, tested at 4 σ.
        let sensor = plain("canon-5d-mark-iv");
        let step = sensor.at_iso(400.0).unwrap();
        let k = 1.0 / step.gain_e_per_dn;
        for electrons in [0.0f32, 3.0, 20.0, 900.0, 9000.0] {
            let (mean, variance) = statistics(&sensor, electrons, 400.0, 3);
            let expected = step.black_level_dn + k * electrons as f64;
            let sigma = (k * k * (step.read_noise_e.powi(2) + electrons as f64) + 1.0 / 12.0).sqrt();
            assert!((mean - expected).abs() < 4.5 * sigma / 200.0, "{electrons}: mean {mean} {expected}");
            assert!((variance / (sigma * sigma) - 1.0).abs() < 0.03, "{electrons}: variance {variance} {}", sigma * sigma);
        }
    }

    #[test]
    fn the_full_well_clips_and_seeds_differ() {
        let sensor = plain("canon-5d-mark-iv");
        let (mean, variance) = statistics(&sensor, 1e9, 100.0, 1);
        assert!(variance < 60.0 && mean > 15_900.0, "{mean} {variance}");
        assert_ne!(statistics(&sensor, 100.0, 100.0, 1), statistics(&sensor, 100.0, 100.0, 2));
        assert_eq!(statistics(&sensor, 100.0, 100.0, 1), statistics(&sensor, 100.0, 100.0, 1));
    }

    #[test]
    fn other_bands_are_refused() {
        let sensor = Sensor::named("ideal").unwrap();
        let mut plane = flat(&sensor, 1.0, 0.0, [2, 2]);
        plane.bands[0].name = "Y".into();
        let e = read_out(&plane, &sensor, &Reading::new(100.0, 1), &illuminant("D65").unwrap()).unwrap_err();
        assert!(e.to_string().contains("Y, G, B"), "{e}");
        plane.bands[0] = Band { name: "R".into(), unit: BandUnit::Radiance };
        let e = read_out(&plane, &sensor, &Reading::new(100.0, 1), &illuminant("D65").unwrap()).unwrap_err();
        assert!(e.to_string().contains("not electrons"), "{e}");
    }

    #[test]
    fn fixed_patterns_belong_to_the_serial_number() {
        let mut sensor = plain("ideal");
        (sensor.prnu, sensor.dsnu_e) = (0.01, 5.0);
        sensor.iso.iter_mut().for_each(|i| i.black_level_dn = 1000.0);
        let with = |serial: &str, seed: u64, electrons: f32| {
            let reading = Reading { serial: serial.into(), ..Reading::new(100.0, seed) };
            read(&sensor, &flat(&sensor, electrons, 0.0, [100, 100]), &reading).mosaic.data
        };
        let correlation = |a: &[u16], b: &[u16]| {
            let ((ma, va), (mb, vb)) = (moments(a), moments(b));
            let sum: f64 = a.iter().zip(b).map(|(x, y)| (*x as f64 - ma) * (*y as f64 - mb)).sum();
            sum / (a.len() as f64 - 1.0) / (va * vb).sqrt()
        };
        // 40 000 e⁻: shot noise 200, PRNU 400; shared variance 400² of 400² + 200² is 0.8; 10 000 pixels give 0.01.
        let (a, b, c) = (with("A", 1, 4e4), with("A", 2, 4e4), with("B", 2, 4e4));
        assert!((correlation(&a, &b) - 0.8).abs() < 0.02, "{}", correlation(&a, &b));
        assert!(correlation(&a, &c).abs() < 0.05);
        // In the dark the offsets are all there is.
        let (a, b) = (with("A", 1, 0.0), with("A", 2, 0.0));
        assert_eq!(a, b);
        let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
        assert!((moments(&a).1.sqrt() * gain / 5.0 - 1.0).abs() < 0.04);
    }

    #[test]
    fn darkness_leaks_with_time_and_temperature() {
        let mut sensor = plain("ideal");
        sensor.dark_current = crate::sensor::DarkCurrent { points: vec![[20.0, 100.0]], doubling_c: 6.0 };
        let mean = |seconds: f64, celsius: f64| {
            let reading = Reading { temperature_c: Some(celsius), ..Reading::new(100.0, 1) };
            let (mean, variance) = moments(&read(&sensor, &flat(&sensor, 0.0, seconds, [100, 100]), &reading).mosaic.data);
            let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
            (mean * gain, variance * gain * gain)
        };
        for (seconds, celsius, expected) in [(10.0, 20.0, 1000.0), (10.0, 26.0, 2000.0), (40.0, 14.0, 2000.0)] {
            let (e, v) = mean(seconds, celsius);
            assert!((e / expected - 1.0).abs() < 3e-3 && (v / expected - 1.0).abs() < 0.06, "{seconds} {celsius}: {e} {v}");
        }
        sensor.hot_pixels = crate::sensor::HotPixels { fraction: 0.01, factor: 50.0 };
        let raw = read(&sensor, &flat(&sensor, 0.0, 10.0, [200, 200]), &Reading::new(100.0, 1));
        let hot = raw.mosaic.data.iter().filter(|d| **d as f64 * 1.83111 > 1500.0).count() as f64 / 40_000.0;
        // Of an exponential of mean 50 · 1000 e⁻, 99 % are above 500.
        assert!((hot / 0.0099 - 1.0).abs() < 0.15, "{hot}");
    }

    #[test]
    fn rows_that_are_open_longer_leak_longer() {
        let mut sensor = plain("ideal");
        sensor.dark_current = crate::sensor::DarkCurrent { points: vec![[20.0, 100.0]], doubling_c: 6.0 };
        let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
        let (n, exposure_s, read_s) = (100usize, 10.0, 40.0);
        // Reset all at once, read one after the other, from the bottom; and as columns.
        for (kind, reset_s, columns) in
            [("rolling", 0.0, false), ("rolling", 0.0, true), ("rolling", read_s, false), ("leaf", 0.0, false)]
        {
            let step = |s: f64| s / n as f64;
            let rows = RowTimes::running(true, n as f64, [0.0, step(reset_s)], [exposure_s, step(read_s)]).of_columns(columns);
            let mut plane = flat(&sensor, 0.0, exposure_s, [n, n]);
            plane.facts.shutter = Some(diopter_image::ShutterFacts { kind: kind.into(), rows, ..Default::default() });
            let reading = Reading { temperature_c: Some(20.0), ..Reading::new(100.0, 1) };
            let raw = read(&sensor, &plane, &reading);
            let electrons = |line: usize| {
                let at = |i: usize| if columns { i * n + line } else { line * n + i };
                (0..n).map(|i| f64::from(raw.mosaic.data[at(i)])).sum::<f64>() / n as f64 * gain
            };
            let longer = if kind == "rolling" && reset_s == 0.0 { read_s } else { 0.0 };
            for line in [0, 50, 99] {
                // 100 e⁻/s; the last line is read first. 100 pixels of 1000 to 5000 e⁻ give 0.3 % and less.
                let expected = 100.0 * (exposure_s + longer * (n - 1 - line) as f64 / n as f64);
                assert!((electrons(line) / expected - 1.0).abs() < 0.02, "{kind} {line}: {} {expected}", electrons(line));
            }
            let reader = ReadOut::new(&sensor, &reading, [n, n], &plane.bands, exposure_s).unwrap().with_rows_of(&plane.facts);
            let told = f64::from(reader.expected(&Window { first: 0, data: &plane.mean.data }, 0)[0].dark);
            assert!((told / (100.0 * (exposure_s + longer * 0.99)) - 1.0).abs() < 1e-5, "{told}");
        }
    }

    #[test]
    fn crosstalk_reaches_the_neighbours_and_keeps_the_sum() {
        let mut sensor = plain("ideal");
        sensor.crosstalk = 0.05;
        let mut plane = flat(&sensor, 0.0, 0.0, [9, 9]);
        plane.mean.pixel_mut(4, 4).fill(1e5);
        let reader = ReadOut::new(&sensor, &Reading::new(100.0, 1), [9, 9], &plane.bands, plane.facts.exposure_s).unwrap();
        let row = |r: usize| reader.expected(&Window { first: 0, data: &plane.mean.data }, r);
        assert_eq!([row(4)[4], row(4)[5], row(3)[4], row(3)[3]].map(|e| e.electrons.round()), [80_000.0, 5000.0, 5000.0, 0.0]);
    }

    #[test]
    fn wells_bloom_along_the_column_only_when_asked() {
        let mut sensor = plain("ideal");
        sensor.full_well_e = 1000.0;
        let mut plane = flat(&sensor, 0.0, 0.0, [5, 21]);
        plane.mean.pixel_mut(2, 10).fill(5000.0);
        let lit = |s: &Sensor| {
            let raw = read(s, &plane, &Reading::new(100.0, 1)).mosaic;
            (0..21).filter(|r| raw.pixel(2, *r)[0] > 0).count()
        };
        assert_eq!(lit(&sensor), 1);
        sensor.blooming = true;
        assert_eq!(lit(&sensor), 5, "5000 e- fill five wells of 1000");
    }

    #[test]
    fn two_readings_see_what_one_cannot() {
        let mut sensor = plain("ideal");
        sensor.full_well_e = 10_000.0;
        sensor.iso.iter_mut().for_each(|i| i.black_level_dn = 100.0);
        sensor.second_reading =
            Some(SecondReading { relative_exposure: 0.1, full_well_e: 9000.0, read_noise_e: 3.0, switch_at: 0.9 });
        let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
        // Of the second: a tenth of the photons, ten times the electrons: variance 10 µ + (3 · 10)². 40 000 pixels: 0.7 %.
        for (electrons, expected) in [(1000.0f32, 1000.0), (60_000.0, 60_000.0 * 10.0 + 900.0)] {
            let (mean, variance) = statistics(&sensor, electrons, 100.0, 1);
            let (mean, variance) = ((mean - 100.0) * gain, variance * gain * gain);
            assert!((mean / electrons as f64 - 1.0).abs() < 0.01, "{electrons}: {mean}");
            assert!((variance / expected - 1.0).abs() < 0.03, "{electrons}: {variance} {expected}");
        }
        assert!(sensor.saturation_e(&sensor.at_iso(100.0).unwrap()) > 85_000.0);
    }

    #[test]
    fn full_pixels_are_white_in_every_body() {
        for name in Sensor::names() {
            let sensor = Sensor::named(name).unwrap();
            for step in &sensor.iso {
                let full = sensor.saturation_e(step);
                let white = |electrons: f64| {
                    let raw = read(&sensor, &flat(&sensor, electrons as f32, 0.001, [60, 60]), &Reading::new(step.iso, 1));
                    let n = raw.mosaic.data.iter().filter(|d| f64::from(**d) >= raw.header.white_level).count();
                    n as f64 / raw.mosaic.data.len() as f64
                };
                assert!(white(2.0 * full) > 0.99, "{name} ISO {}: {}", step.iso, white(2.0 * full));
                assert!(white(0.8 * full) < 0.1, "{name} ISO {}: {}", step.iso, white(0.8 * full));
            }
        }
    }

    #[test]
    fn what_is_expected_is_what_is_seen() {
        // Mean and variance of 200 read-outs of each pixel over what was expected of it, over a ramp up to twice the well.
        let mut sensor = Sensor::named("canon-t2i").unwrap();
        (sensor.crosstalk, sensor.dsnu_e) = (0.02, 20.0);
        let size = [64, 16];
        let mut plane = flat(&sensor, 0.0, 10.0, size);
        plane.mean.data.iter_mut().enumerate().for_each(|(i, v)| *v = 60_000.0 * ((i / 3 % 64) as f32 / 63.0).powi(3));
        let reading = |seed| Reading { temperature_c: Some(30.0), ..Reading::new(100.0, seed) };
        let reader = ReadOut::new(&sensor, &reading(1), size, &plane.bands, plane.facts.exposure_s).unwrap();
        let expected: Vec<Expected> =
            (0..16).flat_map(|r| reader.expected(&Window { first: 0, data: &plane.mean.data }, r)).collect();
        let (mut sums, mut squares) = (vec![0.0; 1024], vec![0.0; 1024]);
        const SHOTS: u64 = 200;
        for seed in 0..SHOTS {
            for ((s, q), dn) in sums.iter_mut().zip(&mut squares).zip(&read(&sensor, &plane, &reading(seed)).mosaic.data) {
                *s += f64::from(*dn);
                *q += f64::from(*dn).powi(2);
            }
        }
        let n = SHOTS as f64;
        let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
        let (mut chi2, mut ratio, mut used) = (0.0, 0.0, 0.0);
        for (i, e) in expected.iter().enumerate() {
            let (mean, variance) = (sums[i] / n, (squares[i] - sums[i] * sums[i] / n) / (n - 1.0));
            let claimed = f64::from(e.variance) / (gain * gain);
            let edge = (f64::from(e.electrons + e.dark) / 25_539.0 - 1.0).abs() < 0.05;
            if e.clipped && !edge {
                assert!(variance == 0.0 && (mean - f64::from(e.dn)).abs() < 1e-9, "{i}: {mean} {variance} {e:?}");
            } else if !edge {
                chi2 += (mean - f64::from(e.dn)).powi(2) / (claimed / n);
                ratio += variance / claimed;
                used += 1.0;
            }
        }
        // Row noise is shared by 64 pixels, and is a tenth of the variance at most in the dark.
        assert!((chi2 / used - 1.0).abs() < 0.25 && (ratio / used - 1.0).abs() < 0.02, "{} {}", chi2 / used, ratio / used);
    }

    #[test]
    fn endless_light_fills_and_nonsense_is_dark() {
        let sensor = Sensor::named("canon-t2i").unwrap();
        let mut plane = flat(&sensor, f32::INFINITY, 0.001, [8, 8]);
        let top = read(&sensor, &plane, &Reading::new(100.0, 1));
        assert!(top.mosaic.data.iter().all(|d| f64::from(*d) >= top.header.white_level));
        plane.mean.data.fill(f32::NAN);
        let nothing = read(&sensor, &plane, &Reading::new(100.0, 1));
        assert!(nothing.mosaic.data.iter().all(|d| d.abs_diff(2048) < 60));
    }

    #[test]
    fn rows_read_apart_are_the_whole() {
        let mut sensor = Sensor::named("canon-t2i").unwrap();
        sensor.crosstalk = 0.02;
        let mut plane = flat(&sensor, 500.0, 1.0, [64, 48]);
        plane.mean.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 977) as f32);
        let whole = read(&sensor, &plane, &Reading::new(200.0, 7)).mosaic.data;
        let reader = ReadOut::new(&sensor, &Reading::new(200.0, 7), [64, 48], &plane.bands, plane.facts.exposure_s).unwrap();
        let mut part = vec![0u16; 64 * 10];
        let window = Window { first: 19, data: &plane.mean.data[19 * 64 * 3..31 * 64 * 3] };
        reader.rows(&window, 20, &mut part);
        assert_eq!(part, whole[20 * 64..30 * 64]);
    }

    #[test]
    fn digital_gain_leaves_gaps_between_the_numbers() {
        let mut sensor = plain("canon-5d-mark-iv");
        let last = sensor.iso.last_mut().unwrap();
        last.digital_gain = 4.0;
        let iso = last.iso;
        let raw = read(&sensor, &flat(&sensor, 100.0, 0.0, [50, 50]), &Reading::new(iso, 1));
        let black = sensor.iso.last().unwrap().black_level_dn as u16;
        assert!(raw.mosaic.data.iter().all(|d| d.abs_diff(black) % 4 == 0));
    }
}

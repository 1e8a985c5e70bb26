//! The data sheet of a body as a type, read from TOML.

use crate::data::{BODIES, RESPONSES};
use crate::{SensorError, nearest};
use diopter_image::Cfa;
use diopter_light::spectrum::Table;
use diopter_light::units::{PLANCK, SPEED_OF_LIGHT};
use serde::Deserialize;
use std::collections::BTreeMap;

/// What an ISO setting does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoStep {
    /// ISO speed.
    pub iso: f64,
    /// Conversion gain 1/K, e⁻/DN.
    pub gain_e_per_dn: f64,
    /// Standard deviation of the read noise of all stages, referred to the pixel, e⁻.
    pub read_noise_e: f64,
}

/// A body's sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Name of the body.
    pub name: String,
    /// Width and height of the picture area, mm.
    pub format_mm: [f64; 2],
    /// Columns and rows.
    pub pixels: [usize; 2],
    /// Colour filters.
    pub cfa: Cfa,
    /// Quantum efficiency of each channel, filters included, over nm.
    pub quantum_efficiency: Vec<Table>,
    /// Electrons a pixel holds.
    pub full_well_e: f64,
    /// Bits of the converter.
    pub adc_bits: u32,
    /// DN of no light.
    pub black_level_dn: f64,
    /// DN at which raw files are taken to be saturated.
    pub white_level_dn: f64,
    /// Settings, rising.
    pub iso: Vec<IsoStep>,
    /// Where the numbers come from.
    pub sources: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sheet {
    name: String,
    format_mm: [f64; 2],
    pixels: [usize; 2],
    cfa: String,
    response: Response,
    peak_quantum_efficiency: f64,
    full_well_e: f64,
    adc_bits: u32,
    black_level_dn: f64,
    white_level_dn: f64,
    iso: Vec<[f64; 3]>,
    sources: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Response {
    Named(String),
    Inline(InlineResponse),
}

/// Relative sensitivities at equal steps; a monochrome sensor gives `Y` alone.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)]
struct InlineResponse {
    first_nm: f32,
    step_nm: f32,
    R: Option<Vec<f32>>,
    G: Option<Vec<f32>>,
    B: Option<Vec<f32>>,
    Y: Option<Vec<f32>>,
}

impl Sensor {
    /// Names of the embedded bodies.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BODIES.iter().map(|b| b.0)
    }

    /// An embedded body.
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

    /// Reads a data sheet; `place` names it in errors.
    pub fn parse(text: &str, place: &str) -> Result<Sensor, SensorError> {
        let sheet: Sheet = toml::from_str(text)
            .map_err(|e| SensorError::Parse { place: place.into(), reason: e.to_string().trim_end().to_owned() })?;
        let range = |ok: bool, what: &str, found: String, expected: &str| match ok {
            true => Ok(()),
            false => Err(SensorError::Range { what: format!("{place}: {what}"), found, expected: expected.into() }),
        };
        let positive = |v: f64| v > 0.0 && v.is_finite();
        range(
            sheet.format_mm.iter().all(|v| positive(*v)),
            "format_mm",
            format!("{:?}", sheet.format_mm),
            "two positive lengths",
        )?;
        range(
            sheet.pixels.iter().all(|v| (1..=65_535).contains(v)),
            "pixels",
            format!("{:?}", sheet.pixels),
            "1 to 65535 a side",
        )?;
        let q = sheet.peak_quantum_efficiency;
        range(positive(q) && q <= 1.0, "peak_quantum_efficiency", q.to_string(), "a number above 0, at most 1")?;
        range(positive(sheet.full_well_e), "full_well_e", sheet.full_well_e.to_string(), "a positive number of electrons")?;
        range((1..=16).contains(&sheet.adc_bits), "adc_bits", sheet.adc_bits.to_string(), "1 to 16")?;
        let top = (1u32 << sheet.adc_bits) as f64 - 1.0;
        let levels = sheet.black_level_dn >= 0.0 && sheet.black_level_dn < sheet.white_level_dn && sheet.white_level_dn <= top;
        range(
            levels,
            "black_level_dn and white_level_dn",
            format!("{} and {}", sheet.black_level_dn, sheet.white_level_dn),
            "0 <= black < white <= the converter's largest number",
        )?;
        let iso: Vec<IsoStep> = sheet
            .iso
            .iter()
            .map(|[iso, gain_e_per_dn, read_noise_e]| IsoStep {
                iso: *iso,
                gain_e_per_dn: *gain_e_per_dn,
                read_noise_e: *read_noise_e,
            })
            .collect();
        let steps = !iso.is_empty()
            && iso
                .iter()
                .all(|s| positive(s.iso) && positive(s.gain_e_per_dn) && s.read_noise_e >= 0.0 && s.read_noise_e.is_finite())
            && iso.windows(2).all(|w| w[0].iso < w[1].iso);
        range(steps, "iso", format!("{:?}", sheet.iso), "rows of rising ISO, positive gain (e-/DN) and read noise (e-)")?;
        let cfa = if sheet.cfa == "mono" { Some(Cfa::monochrome()) } else { Cfa::from_letters(&sheet.cfa) };
        let cfa = cfa.ok_or_else(|| SensorError::Range {
            what: format!("{place}: cfa"),
            found: format!("\"{}\"", sheet.cfa),
            expected: "letters R, G, B in rows parted by / (such as RG/GB), or mono".into(),
        })?;
        let relative = relative_responses(sheet.response, cfa.channel_count(), place)?;
        let peak = relative.iter().map(Table::max).fold(0.0, f32::max);
        range(peak > 0.0, "response", peak.to_string(), "a response somewhere")?;
        let quantum_efficiency = relative.iter().map(|t| t.scaled(q as f32 / peak)).collect();
        Ok(Sensor {
            name: sheet.name,
            format_mm: sheet.format_mm,
            pixels: sheet.pixels,
            cfa,
            quantum_efficiency,
            full_well_e: sheet.full_well_e,
            adc_bits: sheet.adc_bits,
            black_level_dn: sheet.black_level_dn,
            white_level_dn: sheet.white_level_dn,
            iso,
            sources: sheet.sources,
        })
    }

    /// Distance between pixels, mm, across and down.
    pub fn pitch_mm(&self) -> [f64; 2] {
        [self.format_mm[0] / self.pixels[0] as f64, self.format_mm[1] / self.pixels[1] as f64]
    }

    /// Names of the channels, as bands of a focal plane are called.
    pub fn channel_names(&self) -> &'static [&'static str] {
        if self.quantum_efficiency.len() == 1 { &["Y"] } else { &["R", "G", "B"] }
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

    /// Gain and read noise at an ISO speed, between the measured settings on straight lines of their logarithms.
    pub fn at_iso(&self, iso: f64) -> Result<IsoStep, SensorError> {
        let (first, last) = (self.iso[0], self.iso[self.iso.len() - 1]);
        if !(iso >= first.iso && iso <= last.iso) {
            return Err(SensorError::Range {
                what: "ISO".into(),
                found: iso.to_string(),
                expected: format!("{} to {} on {}", first.iso, last.iso, self.name),
            });
        }
        let i = self.iso.partition_point(|s| s.iso <= iso).clamp(1, self.iso.len().max(2) - 1) - 1;
        let (a, b) = (self.iso[i], self.iso[(i + 1).min(self.iso.len() - 1)]);
        let t = if a.iso == b.iso { 0.0 } else { (iso / a.iso).ln() / (b.iso / a.iso).ln() };
        let mix = |x: f64, y: f64| if x > 0.0 && y > 0.0 { (x.ln() + (y.ln() - x.ln()) * t).exp() } else { x + (y - x) * t };
        Ok(IsoStep {
            iso,
            gain_e_per_dn: mix(a.gain_e_per_dn, b.gain_e_per_dn),
            read_noise_e: mix(a.read_noise_e, b.read_noise_e),
        })
    }
}

fn relative_responses(response: Response, channels: usize, place: &str) -> Result<Vec<Table>, SensorError> {
    let missing = |what: &str| SensorError::Range {
        what: format!("{place}: response"),
        found: "incomplete".into(),
        expected: format!("{what}, each with one or more numbers, and a positive step_nm"),
    };
    match response {
        Response::Named(name) => {
            let Some((_, csv)) = RESPONSES.iter().find(|r| r.0 == name) else {
                let known: Vec<&str> = RESPONSES.iter().map(|r| r.0).collect();
                return Err(SensorError::Unknown {
                    what: "response",
                    found: name,
                    hint: format!("; known are {}", known.join(", ")),
                });
            };
            let (_, rows) = diopter_light::cie::tables::read_csv(csv);
            let column = |c: usize| Table::new(380.0, 5.0, rows.iter().map(|r| (r[c] as f32).max(0.0)).collect());
            // A monochrome sensor on a colour response stands behind no filter but the widest.
            Ok(if channels == 1 { vec![column(2)] } else { vec![column(1), column(2), column(3)] })
        }
        Response::Inline(r) => {
            let lists = if channels == 1 { vec![r.Y] } else { vec![r.R, r.G, r.B] };
            if !(r.step_nm > 0.0) {
                return Err(missing("a step"));
            }
            lists
                .into_iter()
                .map(|l| l.filter(|l| !l.is_empty() && l.iter().all(|v| v.is_finite() && *v >= 0.0)))
                .map(|l| l.map(|l| Table::new(r.first_nm, r.step_nm, l)))
                .collect::<Option<Vec<_>>>()
                .ok_or_else(|| missing(if channels == 1 { "Y" } else { "R, G and B" }))
        }
    }
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
            assert!(s.quantum_efficiency.iter().all(|q| q.max() <= 1.0));
            // The gain uses the converter: full scale is within the well, or the well within full scale, by 30 %.
            let step = s.at_iso(100.0).unwrap();
            let full_scale = (s.white_level_dn - s.black_level_dn) * step.gain_e_per_dn;
            assert!((0.7..1.4).contains(&(full_scale / s.full_well_e)), "{name}: {full_scale}");
        }
    }

    #[test]
    fn green_saturates_where_iso_100_says() {
        // H_sat = 78/100 lx·s of D55: electrons = ∫ response × D55 (1 lx) × pixel area × 0.78 s.
        let d55 = diopter_light::cie::illuminant("D55").unwrap();
        let lux = diopter_light::color::luminance(|nm| if (380.0..=780.0).contains(&nm) { d55.at(nm) } else { 0.0 });
        for name in ["canon-5d-mark-iv", "canon-5d-mark-ii", "canon-t2i", "nikon-d850", "sony-a7s-ii", "ideal"] {
            let s = Sensor::named(name).unwrap();
            let green = &s.band_responses()[1];
            let per_joule: f64 = (380..=780).map(|nm| (green.at(nm as f32) * d55.at(nm as f32)) as f64).sum::<f64>() / lux;
            let [w, h] = s.pitch_mm().map(|p| p * 1e-3);
            let electrons = per_joule * w * h * 0.78;
            assert!((electrons / s.full_well_e - 1.0).abs() < 0.03, "{name}: {electrons} of {}", s.full_well_e);
        }
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
    fn a_misspelt_body_gets_a_hint() {
        let e = Sensor::named("nikon-d580").unwrap_err().to_string();
        assert!(e.contains("did you mean \"nikon-d850\""), "{e}");
        let e = Sensor::parse("name = 3", "x.toml").unwrap_err().to_string();
        assert!(e.starts_with("x.toml:"), "{e}");
    }
}

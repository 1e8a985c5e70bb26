//! Data sheets of event sensors as TOML: read, checked, turned into an [`EventSensor`].

use crate::sheet::read_table;
use crate::{Sensor, SensorError, nearest};
use serde::Deserialize;
use std::collections::BTreeMap;

/// The data sheets that are embedded: name on the command line, and TOML.
const SHEETS: [(&str, &str); 3] = [
    ("dvs128", include_str!("sheets/dvs128.toml")),
    ("davis346", include_str!("sheets/davis346.toml")),
    ("ideal-events", include_str!("sheets/ideal-events.toml")),
];

/// How fast the photoreceptor is: one pole, whose frequency is proportional to the photocurrent up to a limit.
///
/// The first-order behaviour of the photoreceptor in little light: Lichtsteiner et al. 2008, §III-A; v2e §4.2 (Hu et al. 2021).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bandwidth {
    /// Frequency of the pole (−3 dB), Hz ...
    pub hz: f64,
    /// ... at this photocurrent, e⁻/s, dark current included.
    pub at_e_s: f64,
    /// More than this it never is, Hz (set by bias currents).
    pub most_hz: f64,
}

impl Bandwidth {
    /// Frequency of the pole at a photocurrent, e⁻/s.
    pub fn at(&self, current_e_s: f64) -> f64 {
        (self.hz * current_e_s / self.at_e_s).min(self.most_hz)
    }
}

/// Events that the noise of light and transistors makes, ON as many as OFF.
///
/// The rate falls with the light, straight, from its highest in the dark: v2e's model (v2ecore/emulator_utils.py, `generate_shot_noise`: from 1 to 0.25 of the rate from black to white),
/// with the photocurrent of white said by the sheet.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotNoise {
    /// Both polarities together, of a pixel in the dark, Hz.
    pub hz: f64,
    /// Photocurrent from which on the rate is the least, e⁻/s.
    pub bright_e_s: f64,
    /// The least rate as a fraction of `hz`.
    pub bright_fraction: f64,
}

impl ShotNoise {
    /// Rate at a photocurrent (e⁻/s, dark current included), Hz.
    pub fn at(&self, current_e_s: f64) -> f64 {
        self.hz * (1.0 - (1.0 - self.bright_fraction) * (current_e_s / self.bright_e_s).min(1.0))
    }
}

/// The data sheet of an event sensor.
#[derive(Clone, Debug)]
pub struct EventSensor {
    /// Name.
    pub name: String,
    /// What gathers its light, as a monochrome sensor: size, pixels, fill factor, quantum efficiency. (As a camera that counts electrons it is ideal and has no use.)
    pub light: Sensor,
    /// Rise of ln(current) that makes an ON event.
    pub threshold_on: f64,
    /// Fall of ln(current) that makes an OFF event.
    pub threshold_off: f64,
    /// Standard deviation of both from pixel to pixel, in the same unit.
    pub threshold_mismatch: f64,
    /// How long a pixel is in reset after an event, s; it then remembers the level of that moment.
    pub refractory_s: f64,
    /// How fast its photoreceptor is; `None`: at once.
    pub bandwidth: Option<Bandwidth>,
    /// Rate of the ON events that leaking of the reset switch makes in steady light, Hz (Nozaki & Delbruck 2017, IEEE TED 64(8), 3239).
    pub leak_hz: f64,
    /// Noise.
    pub shot_noise: Option<ShotNoise>,
    /// Dark current of the photodiode, e⁻/s: what is added to all light.
    pub dark_e_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sheet {
    name: String,
    #[serde(default)]
    make: String,
    #[serde(default)]
    model: String,
    format_mm: [f64; 2],
    pixels: [usize; 2],
    response: toml::Value,
    peak_quantum_efficiency: f64,
    #[serde(default = "one")]
    fill_factor: f64,
    threshold_on: f64,
    threshold_off: f64,
    #[serde(default)]
    threshold_mismatch: f64,
    #[serde(default)]
    refractory_us: f64,
    bandwidth: Option<Bandwidth>,
    #[serde(default)]
    leak_hz: f64,
    shot_noise: Option<ShotNoise>,
    dark_current_e_s: f64,
    sources: BTreeMap<String, String>,
}

fn one() -> f64 {
    1.0
}

impl EventSensor {
    /// Names of the embedded ones.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SHEETS.iter().map(|s| s.0)
    }

    /// An embedded event sensor. Fails with the names there are.
    pub fn named(name: &str) -> Result<EventSensor, SensorError> {
        match SHEETS.iter().find(|s| s.0.eq_ignore_ascii_case(name)) {
            Some((key, text)) => EventSensor::parse(text, key),
            None => {
                let hint = match nearest(name, EventSensor::names()) {
                    Some(near) => format!(" (did you mean \"{near}\"?)"),
                    None => format!("; known are {}, or a TOML file", EventSensor::names().collect::<Vec<_>>().join(", ")),
                };
                Err(SensorError::Unknown { what: "event sensor", found: name.into(), hint })
            }
        }
    }

    /// Reads a data sheet; `place` names it in errors. Fails on what is no such sheet and on numbers out of their ranges.
    pub fn parse(text: &str, place: &str) -> Result<EventSensor, SensorError> {
        let s: Sheet = read_table(text, place)?;
        let range = |what: &str, found: f64, expected: &str| {
            Err(SensorError::Range { what: format!("{place}: {what}"), found: found.to_string(), expected: expected.into() })
        };
        for (what, v) in [("threshold_on", s.threshold_on), ("threshold_off", s.threshold_off)] {
            if !(0.001..=10.0).contains(&v) {
                return range(what, v, "0.001 to 10, a change of the natural logarithm of the light");
            }
        }
        if !(0.0..=1.0).contains(&s.threshold_mismatch) {
            return range(
                "threshold_mismatch",
                s.threshold_mismatch,
                "0 to 1, a standard deviation in the unit of the thresholds",
            );
        }
        if !(0.0..=1e9).contains(&s.refractory_us) {
            return range("refractory_us", s.refractory_us, "0 to 1e9 us");
        }
        if !(0.0..=1e6).contains(&s.leak_hz) {
            return range("leak_hz", s.leak_hz, "0 to 1e6 Hz");
        }
        // The logarithm of no light at all has no value.
        if !(s.dark_current_e_s > 0.0 && s.dark_current_e_s.is_finite()) {
            return range("dark_current_e_s", s.dark_current_e_s, "above 0 e-/s");
        }
        if let Some(b) = s.bandwidth
            && let Some(v) = [b.hz, b.at_e_s, b.most_hz].into_iter().find(|v| !(*v > 0.0 && v.is_finite()))
        {
            return range("bandwidth", v, "hz, at_e_s and most_hz above 0");
        }
        if let Some(n) = s.shot_noise
            && let Some((name, found, expected)) = [
                ("shot_noise.hz", n.hz, "above 0, at most 1e6", n.hz > 0.0 && n.hz <= 1e6),
                ("shot_noise.bright_e_s", n.bright_e_s, "above 0 e-/s", n.bright_e_s > 0.0 && n.bright_e_s.is_finite()),
                ("shot_noise.bright_fraction", n.bright_fraction, "0 to 1", (0.0..=1.0).contains(&n.bright_fraction)),
            ]
            .into_iter()
            .find(|(.., fine)| !fine)
            .map(|(name, found, expected, _)| (name, found, expected))
        {
            return range(name, found, expected);
        }
        if s.sources.is_empty() {
            return range("sources", 0.0, "where its numbers are from, such as geometry = \"...\"");
        }
        if !(s.fill_factor > 0.0 && s.fill_factor <= 1.0) {
            return range("fill_factor", s.fill_factor, "a fraction above 0, at most 1");
        }
        let light = light_sheet(&s);
        Ok(EventSensor {
            name: s.name,
            light: Sensor::parse(&light, place)?,
            threshold_on: s.threshold_on,
            threshold_off: s.threshold_off,
            threshold_mismatch: s.threshold_mismatch,
            refractory_s: s.refractory_us * 1e-6,
            bandwidth: s.bandwidth,
            leak_hz: s.leak_hz,
            shot_noise: s.shot_noise,
            dark_e_s: s.dark_current_e_s,
        })
    }
}

/// The sheet of a monochrome sensor with the same pixels, that counts electrons without a fault.
fn light_sheet(s: &Sheet) -> String {
    let mut t = toml::Table::new();
    let mut put = |key: &str, v: toml::Value| t.insert(key.to_owned(), v);
    let text = |v: &str| toml::Value::String(v.to_owned());
    put("name", text(&s.name));
    put("make", text(&s.make));
    put("model", text(&s.model));
    put("format_mm", toml::Value::Array(s.format_mm.map(toml::Value::Float).to_vec()));
    put("pixels", toml::Value::Array(s.pixels.map(|n| toml::Value::Integer(n as i64)).to_vec()));
    put("cfa", text("mono"));
    put("response", s.response.clone());
    // Efficiencies of sheets are those of the whole pixel.
    put("peak_quantum_efficiency", toml::Value::Float(s.peak_quantum_efficiency * s.fill_factor));
    put("fill_factor", toml::Value::Float(s.fill_factor));
    put("full_well_e", toml::Value::Float(65535.0));
    put("adc_bits", toml::Value::Integer(16));
    put("black_level_dn", toml::Value::Float(0.0));
    put("white_level_dn", toml::Value::Float(65535.0));
    put("iso", toml::Value::Array(vec![toml::Value::Array([100.0, 1.0, 0.0].map(toml::Value::Float).to_vec())]));
    let sources = s.sources.iter().map(|(k, v)| (k.clone(), text(v))).collect();
    put("sources", toml::Value::Table(sources));
    t.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn embedded_sheets_are_read() {
        for name in EventSensor::names() {
            let s = EventSensor::named(name).unwrap();
            assert!(s.light.bands().len() == 1 && s.threshold_on > 0.0, "{name}");
        }
        let s = EventSensor::named("DVS128").unwrap();
        // 40 um pixels, 9.4 % of them sensitive.
        assert!((s.light.pitch_mm()[0] - 0.04).abs() < 1e-12 && s.light.fill_factor == 0.094);
    }

    #[test]
    fn wrong_sheets_are_refused_with_place_and_hint() {
        let good = SHEETS[0].1;
        for (from, to, told) in [
            ("threshold_on = 0.15", "threshold_on = 0", "threshold_on"),
            ("threshold_on = 0.15", "treshold_on = 0.15", "treshold_on"),
            ("leak_hz = 0.1", "leak_hz = -1", "leak_hz"),
            ("dark_current_e_s = 25000", "dark_current_e_s = 0", "dark_current_e_s"),
            ("fill_factor = 0.094", "fill_factor = 2", "fill_factor"),
        ] {
            assert!(good.contains(from), "{from}");
            let e = EventSensor::parse(&good.replace(from, to), "my.toml").unwrap_err().to_string();
            assert!(e.contains("my.toml") && e.contains(told), "{e}");
        }
        assert!(EventSensor::named("dvs12").unwrap_err().to_string().contains("did you mean \"dvs128\""));
    }
}

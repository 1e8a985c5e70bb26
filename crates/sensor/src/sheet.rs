//! Data sheets as TOML: read, checked, turned into a [`Sensor`].

mod responses;

use self::responses::{Curve, Response, relative_responses, through};
use crate::sensor::{
    BodyLens, DarkCurrent, HotPixels, IsoStep, Plenoptic, SAME_ISO, SecondReading, digital_gain, saturation_capacity,
};
use crate::{Sensor, SensorError};
use diopter_image::Cfa;
use diopter_light::lattice::Arrangement;
use diopter_light::names::in_words;
use diopter_light::spectrum::Table;
use serde::Deserialize;
use std::collections::BTreeMap;

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
    cfa: String,
    response: Response,
    peak_quantum_efficiency: f64,
    filter: Option<Curve>,
    /// Of the polarisers before the pixels.
    extinction_ratio: Option<f64>,
    /// The hard limit ...
    full_well_e: Option<f64>,
    /// ... or what EMVA 1288 measures.
    saturation_capacity_e: Option<f64>,
    #[serde(default)]
    blooming: bool,
    adc_bits: u32,
    black_level_dn: f64,
    white_level_dn: f64,
    /// ISO, gain e⁻/DN, read noise e⁻ and, if known, row noise e⁻.
    iso: Option<Vec<Vec<f64>>>,
    amplifier: Option<Amplifier>,
    /// The read noise was measured in numbers: it contains that of their rounding.
    #[serde(default)]
    read_noise_includes_rounding: bool,
    /// ISO from which on another black and white level hold.
    #[serde(default)]
    levels: Vec<[f64; 3]>,
    /// From this ISO on the pixel converts at its high gain: nothing is interpolated across.
    dual_gain_iso: Option<f64>,
    /// Gain is digital above this ISO.
    digital_above_iso: Option<f64>,
    #[serde(default)]
    prnu_percent: f64,
    #[serde(default)]
    dsnu_e: f64,
    #[serde(default)]
    dsnu_row_e: f64,
    #[serde(default)]
    dsnu_column_e: f64,
    #[serde(default)]
    dark_current: Vec<[f64; 2]>,
    #[serde(default = "six_and_a_half")]
    dark_current_doubling_c: f64,
    #[serde(default, alias = "hot_pixel_share")]
    hot_pixel_fraction: f64,
    #[serde(default)]
    hot_pixel_factor: f64,
    #[serde(default = "twenty")]
    temperature_c: f64,
    #[serde(default)]
    low_pass_px: f64,
    #[serde(default = "one")]
    fill_factor: f64,
    #[serde(default)]
    crosstalk_percent: f64,
    second_reading: Option<Second>,
    plenoptic: Option<Microlenses>,
    lens: Option<OwnLens>,
    sources: BTreeMap<String, String>,
}

fn one() -> f64 {
    1.0
}

fn twenty() -> f64 {
    20.0
}

fn six_and_a_half() -> f64 {
    6.5
}

/// Settings by the two-stage model: the gain is inverse to the ISO.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Amplifier {
    iso: Vec<f64>,
    /// ISO and the gain there, e⁻/DN.
    gain: [f64; 2],
    before_e: f64,
    after_dn: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Microlenses {
    pitch_um: f64,
    focal_length_um: Option<f64>,
    gap_um: Option<f64>,
    #[serde(default)]
    arrangement: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OwnLens {
    focal_length_mm: f64,
    f_number: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Second {
    relative_exposure: f64,
    full_well_e: f64,
    read_noise_e: f64,
    #[serde(default = "nine_tenths")]
    switch_at: f64,
}

fn nine_tenths() -> f64 {
    0.9
}

/// A data sheet as its keys. Fails on what they are not, with line and hint; a key that is missing is named alone, since no line lacks it.
pub(crate) fn read_table<T: serde::de::DeserializeOwned>(text: &str, place: &str) -> Result<T, SensorError> {
    toml::from_str(text).map_err(|e| {
        let missing = e.message().strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`'));
        // Of a table within, its own line is told.
        let whole = e.span().is_none_or(|span| span.start == 0 || span == (0..text.len()));
        match missing.filter(|_| whole) {
            Some("sources") => SensorError::Range {
                what: format!("{place}: [sources]"),
                found: "missing".into(),
                expected:
                    "a table at the end that says where the numbers are from, such as readout = \"own measurement, EMVA 1288\""
                        .into(),
            },
            Some(key) => SensorError::Range {
                what: format!("{place}: {key}"),
                found: "missing".into(),
                expected: format!("a line {key} = ..."),
            },
            None => SensorError::Parse { place: place.into(), reason: in_words(&e.to_string()) },
        }
    })
}

/// Collects what is asked of a number: place, name, value, what is allowed.
struct Checks<'a> {
    place: &'a str,
}

impl Checks<'_> {
    fn that(&self, ok: bool, what: &str, found: impl std::fmt::Display, expected: &str) -> Result<(), SensorError> {
        match ok {
            true => Ok(()),
            false => Err(SensorError::Range {
                what: format!("{}: {what}", self.place),
                found: found.to_string(),
                expected: expected.into(),
            }),
        }
    }

    fn positive(&self, value: f64, what: &str) -> Result<(), SensorError> {
        self.that(value > 0.0 && value.is_finite(), what, value, "a number above 0")
    }

    fn not_negative(&self, value: f64, what: &str) -> Result<(), SensorError> {
        self.that(value >= 0.0 && value.is_finite(), what, value, "0 or more")
    }
}

impl Sensor {
    /// Reads a data sheet; `place` names it in errors. Fails on what is no such sheet and on numbers out of their ranges.
    pub fn parse(text: &str, place: &str) -> Result<Sensor, SensorError> {
        let s: Sheet = read_table(text, place)?;
        let check = Checks { place };
        for v in s.format_mm {
            check.that(
                v > 0.0 && v <= 1000.0,
                "format_mm",
                format!("{:?}", s.format_mm),
                "two lengths above 0, up to 1000 mm",
            )?;
        }
        check.that(
            s.pixels.iter().all(|v| (1..=65_535).contains(v)),
            "pixels",
            format!("{:?}", s.pixels),
            "1 to 65535 a side",
        )?;
        let q = s.peak_quantum_efficiency;
        check.that(q > 0.0 && q <= 1.0, "peak_quantum_efficiency", q, "a number above 0, at most 1")?;
        check.that((8..=16).contains(&s.adc_bits), "adc_bits", s.adc_bits, "8 to 16")?;
        let top = f64::from((1u32 << s.adc_bits) - 1);
        for [black, white] in s.levels.iter().map(|l| [l[1], l[2]]).chain([[s.black_level_dn, s.white_level_dn]]) {
            check.that(
                black >= 0.0 && black < white && white <= top,
                "black_level_dn and white_level_dn",
                format!("{black} and {white}"),
                &format!("0 <= black < white <= {top}, the largest number of {} bits", s.adc_bits),
            )?;
        }
        check.that(
            s.levels.iter().all(|l| l[0] > 0.0 && l[0].is_finite()) && s.levels.windows(2).all(|w| w[0][0] < w[1][0]),
            "levels",
            format!("{:?}", s.levels),
            "rows of rising ISO, black and white level (DN)",
        )?;
        for (value, what) in [
            (s.dsnu_e, "dsnu_e"),
            (s.dsnu_row_e, "dsnu_row_e"),
            (s.dsnu_column_e, "dsnu_column_e"),
            (s.hot_pixel_factor, "hot_pixel_factor"),
            (s.low_pass_px, "low_pass_px"),
        ] {
            check.not_negative(value, what)?;
        }
        check.that((0.0..=20.0).contains(&s.prnu_percent), "prnu_percent", s.prnu_percent, "0 to 20")?;
        check.that(
            (0.0..=1.0).contains(&s.hot_pixel_fraction),
            "hot_pixel_fraction",
            s.hot_pixel_fraction,
            "a fraction, 0 to 1",
        )?;
        check.that(s.low_pass_px <= 8.0, "low_pass_px", s.low_pass_px, "up to 8 pixels")?;
        check.that(s.fill_factor > 0.0 && s.fill_factor <= 1.0, "fill_factor", s.fill_factor, "a fraction above 0, at most 1")?;
        check.that(
            (0.0..=20.0).contains(&s.crosstalk_percent),
            "crosstalk_percent",
            s.crosstalk_percent,
            "0 to 20 to each neighbour",
        )?;
        check.that(
            s.dark_current.iter().all(|[c, e]| *c >= -273.15 && c.is_finite() && *e > 0.0 && e.is_finite())
                && s.dark_current.windows(2).all(|w| w[0][0] < w[1][0]),
            "dark_current",
            format!("{:?}", s.dark_current),
            "rows of rising temperature (°C) and a current above 0 (e-/s)",
        )?;
        check.that(
            s.hot_pixel_fraction == 0.0 || !s.dark_current.is_empty(),
            "hot_pixel_fraction",
            s.hot_pixel_fraction,
            "dark_current beside it: hot pixels are those with more of it",
        )?;
        check.positive(s.dark_current_doubling_c, "dark_current_doubling_c")?;
        check.that((-273.15..=200.0).contains(&s.temperature_c), "temperature_c", s.temperature_c, "-273 to 200 °C")?;

        let cfa = Cfa::parse(&s.cfa).ok_or_else(|| SensorError::Range {
            what: format!("{place}: cfa"),
            found: format!("\"{}\"", s.cfa),
            expected: "letters R, G, B, W or, of polarisers, H, D, V, A in rows separated by / (such as RG/GB), at most four different ones, or mono, quad, x-trans, \
                       rgbw, rccc, polarized"
                .into(),
        })?;
        let relative = relative_responses(s.response, &cfa, place)?;
        let relative = through(relative, s.filter, &check)?;
        for (curve, channel) in relative.iter().zip(cfa.channel_names()) {
            check.that(
                curve.max() > 0.0,
                &format!("response {channel}"),
                "0 everywhere",
                "a response somewhere from 380 to 780 nm",
            )?;
        }
        let peak = relative.iter().map(Table::max).fold(0.0, f32::max);
        let quantum_efficiency = relative.iter().map(|t| t.scaled(q as f32 / peak)).collect();

        let mut iso = iso_steps(s.iso, s.amplifier.as_ref(), &check)?;
        for step in &mut iso {
            let here = s.levels.iter().rev().find(|l| l[0] <= step.iso * SAME_ISO);
            [step.black_level_dn, step.white_level_dn] = here.map_or([s.black_level_dn, s.white_level_dn], |l| [l[1], l[2]]);
            if let Some(limit) = s.digital_above_iso {
                step.digital_gain = digital_gain(step.iso, limit);
            }
            if s.read_noise_includes_rounding {
                // Rounding after a digital gain is that of the numbers before it.
                let rounding = (step.gain_e_per_dn * step.digital_gain).powi(2) / 12.0;
                step.read_noise_e = (step.read_noise_e.powi(2) - rounding).max(0.0).sqrt();
            }
        }
        if let Some(limit) = s.digital_above_iso {
            check.positive(limit, "digital_above_iso")?;
            check.that(
                limit >= iso[0].iso,
                "digital_above_iso",
                limit,
                &format!("{} or more, the lowest setting", iso[0].iso),
            )?;
        }
        if let Some(switch) = s.dual_gain_iso {
            let [lowest, highest] = [iso[0].iso, iso[iso.len() - 1].iso];
            check.that(
                switch > lowest && switch <= highest,
                "dual_gain_iso",
                switch,
                &format!("above {lowest} and up to {highest}, as the settings go"),
            )?;
        }
        let dark_noise = iso[0].read_noise_e.hypot(iso[0].row_noise_e);
        let full_well_e = match (s.full_well_e, s.saturation_capacity_e) {
            (Some(well), None) => {
                check.positive(well, "full_well_e")?;
                well
            }
            (None, Some(capacity)) => {
                check.positive(capacity, "saturation_capacity_e")?;
                // The limit whose measured capacity it is.
                let mut well = capacity;
                for _ in 0..20 {
                    well += capacity - saturation_capacity(well, dark_noise);
                }
                well
            }
            (found, _) => {
                let found = if found.is_some() { "both" } else { "neither" };
                return check
                    .that(false, "full_well_e and saturation_capacity_e", found, "one of the two")
                    .map(|()| unreachable!());
            }
        };
        for step in &iso {
            // Fewer numbers than that between black and white are a slip of units, not a camera.
            let numbers = full_well_e.min((step.white_level_dn - step.black_level_dn) * step.gain_e_per_dn) / step.gain_e_per_dn;
            check.that(
                numbers >= 16.0,
                "full_well_e",
                format!("{full_well_e} e- at ISO {}, which is {numbers:.1} numbers above black", step.iso),
                "at least 16 numbers from black to white",
            )?;
        }
        let second_reading = match s.second_reading {
            None => None,
            Some(r) => {
                check.that(
                    r.relative_exposure > 0.0 && r.relative_exposure < 1.0,
                    "second_reading.relative_exposure",
                    r.relative_exposure,
                    "a fraction of the light above 0, below 1",
                )?;
                check.positive(r.full_well_e, "second_reading.full_well_e")?;
                check.not_negative(r.read_noise_e, "second_reading.read_noise_e")?;
                check.that(
                    r.full_well_e / r.relative_exposure > full_well_e,
                    "second_reading.full_well_e",
                    r.full_well_e,
                    "more light than the first reading holds",
                )?;
                check.that(!s.blooming, "blooming", true, "false for a sensor with a second reading")?;
                check.that(
                    r.switch_at > 0.0 && r.switch_at <= 1.0,
                    "second_reading.switch_at",
                    r.switch_at,
                    "a fraction above 0, at most 1",
                )?;
                Some(SecondReading {
                    relative_exposure: r.relative_exposure,
                    full_well_e: r.full_well_e,
                    read_noise_e: r.read_noise_e,
                    switch_at: r.switch_at,
                })
            }
        };
        if let Some(m) = &s.plenoptic {
            check.positive(m.pitch_um, "plenoptic.pitch_um")?;
            for (value, what) in [(m.focal_length_um, "plenoptic.focal_length_um"), (m.gap_um, "plenoptic.gap_um")] {
                check.positive(value.unwrap_or(1.0), what)?;
            }
            let known = m.arrangement.is_empty() || Arrangement::named(&m.arrangement).is_some();
            check.that(known, "plenoptic.arrangement", format!("\"{}\"", m.arrangement), "square or hexagonal")?;
        }
        if let Some(l) = &s.lens {
            check.positive(l.focal_length_mm, "lens.focal_length_mm")?;
            check.that((0.5..=64.0).contains(&l.f_number), "lens.f_number", l.f_number, "0.5 to 64")?;
            check.that(
                s.sources.contains_key("lens"),
                "sources.lens",
                "is missing",
                "where the numbers of the lens come from",
            )?;
        }
        let told = s.extinction_ratio.map_or("nothing".to_owned(), |ratio| ratio.to_string());
        let (fits, expected) = match (cfa.tells_polarization(), s.extinction_ratio) {
            (true, ratio) => {
                (ratio.is_some_and(|r| r > 1.0 && r.is_finite()), "that of the polarisers before the pixels, above 1")
            }
            (false, ratio) => (ratio.is_none(), "none: no pixel of this cfa sees through a polariser"),
        };
        check.that(fits, "extinction_ratio", told, expected)?;
        Ok(Sensor {
            extinction_ratio: s.extinction_ratio.unwrap_or(1.0),
            model: if s.model.is_empty() { s.name.clone() } else { s.model },
            make: s.make,
            name: s.name,
            format_mm: s.format_mm,
            pixels: s.pixels,
            cfa,
            quantum_efficiency,
            full_well_e,
            blooming: s.blooming,
            adc_bits: s.adc_bits,
            iso,
            dual_gain_iso: s.dual_gain_iso,
            digital_above_iso: s.digital_above_iso,
            levels: s.levels,
            prnu: s.prnu_percent / 100.0,
            dsnu_e: s.dsnu_e,
            dsnu_row_e: s.dsnu_row_e,
            dsnu_column_e: s.dsnu_column_e,
            dark_current: DarkCurrent { points: s.dark_current, doubling_c: s.dark_current_doubling_c },
            hot_pixels: HotPixels { fraction: s.hot_pixel_fraction, factor: s.hot_pixel_factor },
            temperature_c: s.temperature_c,
            low_pass_px: s.low_pass_px,
            fill_factor: s.fill_factor,
            crosstalk: s.crosstalk_percent / 100.0,
            second_reading,
            plenoptic: s.plenoptic.map(|m| Plenoptic {
                pitch_mm: Some(m.pitch_um * 1e-3),
                focal_length_mm: m.focal_length_um.map(|v| v * 1e-3),
                gap_mm: m.gap_um.map(|v| v * 1e-3),
                arrangement: m.arrangement,
            }),
            lens: s.lens.map(|l| BodyLens { focal_length_mm: l.focal_length_mm, f_number: l.f_number }),
            sources: s.sources,
        })
    }
}

fn iso_steps(table: Option<Vec<Vec<f64>>>, amplifier: Option<&Amplifier>, check: &Checks) -> Result<Vec<IsoStep>, SensorError> {
    let step = |iso: f64, gain_e_per_dn: f64, read_noise_e: f64, row_noise_e: f64| IsoStep {
        iso,
        gain_e_per_dn,
        read_noise_e,
        row_noise_e,
        black_level_dn: 0.0,
        white_level_dn: 0.0,
        digital_gain: 1.0,
    };
    let (steps, found) = match (table, amplifier) {
        (Some(rows), None) => {
            let complete = rows.iter().all(|r| r.len() == 3 || r.len() == 4);
            check.that(
                complete,
                "iso",
                format!("{rows:?}"),
                "rows of ISO, gain (e-/DN), read noise (e-) and, if known, row noise (e-)",
            )?;
            let found = format!("{rows:?}");
            (rows.iter().map(|r| step(r[0], r[1], r[2], r.get(3).copied().unwrap_or(0.0))).collect::<Vec<_>>(), found)
        }
        (None, Some(a)) => {
            for (value, what) in [(a.gain[0], "amplifier.gain"), (a.gain[1], "amplifier.gain")] {
                check.positive(value, what)?;
            }
            check.not_negative(a.before_e, "amplifier.before_e")?;
            check.not_negative(a.after_dn, "amplifier.after_dn")?;
            let steps = a.iso.iter().map(|iso| {
                let gain = a.gain[1] * a.gain[0] / iso;
                step(*iso, gain, a.before_e.hypot(a.after_dn * gain), 0.0)
            });
            (steps.collect(), format!("{:?}", a.iso))
        }
        (both, _) => {
            let found = if both.is_some() { "both" } else { "neither" };
            return check.that(false, "iso and [amplifier]", found, "one of the two").map(|()| unreachable!());
        }
    };
    let positive = |v: f64| v > 0.0 && v.is_finite();
    let fine = |s: &IsoStep| positive(s.iso) && positive(s.gain_e_per_dn) && s.read_noise_e >= 0.0 && s.read_noise_e.is_finite();
    let rising = steps.windows(2).all(|w| w[0].iso < w[1].iso && w[0].gain_e_per_dn >= w[1].gain_e_per_dn);
    let rows = steps.iter().all(|s| s.row_noise_e >= 0.0 && s.row_noise_e.is_finite());
    check.that(
        !steps.is_empty() && rising && rows && steps.iter().all(fine),
        "iso",
        found,
        "at least one row; rising ISO, gain above 0 that falls or stays (e-/DN), noise of 0 or more (e-)",
    )?;
    Ok(steps)
}

#[cfg(test)]
mod tests;

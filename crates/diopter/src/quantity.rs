//! Quantities as people write them: "50 mm", "f/2.8", "1/125 s", "ISO 400", "1920x1280", "2.5m", "inf".
//!
//! Each type reads from text or, in TOML, from a bare number in its base unit, and is written back as text.

use serde::de::{self, Deserialize, Deserializer, Visitor};
use serde::{Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Text that is not the quantity it should be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("\"{found}\" is not {expected}")]
pub struct QuantityError {
    /// What was written.
    pub found: String,
    /// What should have been, with an example.
    pub expected: &'static str,
}

fn wrong(found: &str, expected: &'static str) -> QuantityError {
    QuantityError { found: found.trim().to_owned(), expected }
}

/// A number with an optional fraction (`1/125`), finite; `None` of other text.
pub fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    let value = match text.split_once('/') {
        Some((a, b)) => a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?,
        None => text.parse().ok()?,
    };
    value.is_finite().then_some(value)
}

/// Splits off the first unit that the text ends with, longest first in `units`, and gives number × factor.
fn with_unit(text: &str, units: &[(&str, f64)], bare: f64) -> Option<f64> {
    let text = text.trim();
    for (unit, factor) in units {
        if let Some(rest) = text.strip_suffix(unit)
            && let Some(value) = number(rest)
        {
            return Some(value * factor);
        }
    }
    number(text).map(|v| v * bare)
}

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $expected:literal, |$text:ident| $parse:expr, |$value:ident| $show:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
        pub struct $name(
            /// The value in its base unit.
            pub f64,
        );

        impl FromStr for $name {
            type Err = QuantityError;
            fn from_str(text: &str) -> Result<Self, QuantityError> {
                let $text = text;
                let parsed: Option<f64> = $parse;
                parsed.map($name).ok_or_else(|| wrong(text, $expected))
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                let $value = self.0;
                f.write_str(&$show)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                d.deserialize_any(TextOrNumber::<$name> { bare: $name, expected: $expected })
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
                s.collect_str(self)
            }
        }
    };
}

struct TextOrNumber<T> {
    bare: fn(f64) -> T,
    expected: &'static str,
}

impl<T: FromStr<Err = QuantityError>> Visitor<'_> for TextOrNumber<T> {
    type Value = T;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.expected)
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<T, E> {
        Ok((self.bare)(v))
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<T, E> {
        Ok((self.bare)(v as f64))
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<T, E> {
        Ok((self.bare)(v as f64))
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<T, E> {
        v.parse().map_err(E::custom)
    }
}

/// Reads a quantity that is only ever written as text.
struct Text<T> {
    expected: &'static str,
    of: PhantomData<T>,
}

impl<T: FromStr<Err = QuantityError>> Visitor<'_> for Text<T> {
    type Value = T;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.expected)
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<T, E> {
        v.parse().map_err(E::custom)
    }
}

quantity!(
    /// A length on the camera, mm.
    LengthMm, "a length such as \"50 mm\"",
    |text| with_unit(text, &[("mm", 1.0), ("cm", 10.0), ("um", 1e-3), ("µm", 1e-3), ("m", 1000.0)], 1.0),
    |v| format!("{v} mm")
);
quantity!(
    /// A distance in the scene, m; infinite for "inf".
    Distance, "a distance such as \"2.5 m\" or \"inf\"",
    |text| match text.trim().to_lowercase().as_str() {
        "inf" | "infinity" => Some(f64::INFINITY),
        lower => with_unit(lower, &[("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)], 1.0),
    },
    |v| if v.is_infinite() { "inf".to_owned() } else { format!("{v} m") }
);
quantity!(
    /// An f-number.
    FNumber, "an f-number such as \"f/2.8\"",
    |text| {
        let t = text.trim();
        let t = ["f/", "F/", "f", "F"].iter().find_map(|p| t.strip_prefix(p)).unwrap_or(t);
        number(t)
    },
    |v| format!("f/{v}")
);
impl FNumber {
    /// What an aperture can be. A lens in air that keeps the sine condition is no brighter than f/0.5 (N = 1 / (2 sin θ'), ISO 517); ideal lenses
    /// and the smallest holes get some room.
    pub const RANGE: RangeInclusive<f64> = 0.1..=1e5;

    /// [`FNumber::RANGE`], for messages.
    pub const EXPECTED: &str = "a number above 0, from f/0.1 to f/100000, such as f/2.8";
}

quantity!(
    /// A time, s.
    Seconds, "a time such as \"1/125 s\" or \"8 ms\"",
    |text| with_unit(text, &[("ms", 1e-3), ("µs", 1e-6), ("us", 1e-6), ("min", 60.0), ("s", 1.0)], 1.0),
    |v| {
        let is_reciprocal = v > 0.0 && (1.0 / v - (1.0 / v).round()).abs() < 1e-12 / v;
        let decimal = format!("{v} s");
        // Half a second stays 0.5 s; a third would have sixteen digits.
        if is_reciprocal && (v < 0.3 || decimal.len() > 8) { format!("1/{} s", (1.0 / v).round()) } else { decimal }
    }
);
quantity!(
    /// An ISO speed.
    Iso, "an ISO speed such as \"ISO 400\"",
    |text| {
        let t = text.trim();
        number(["ISO", "iso", "Iso"].iter().find_map(|p| t.strip_prefix(p)).unwrap_or(t))
    },
    |v| format!("ISO {v}")
);

quantity!(
    /// Stops of light, EV.
    Ev, "stops such as \"+1 EV\" or \"-1/3\"",
    |text| with_unit(&text.trim().to_lowercase(), &[("ev", 1.0), ("stops", 1.0), ("stop", 1.0)], 1.0),
    |v| format!("{v} EV")
);
quantity!(
    /// A neutral density filter, stops.
    Filter, "a filter such as \"ND8\" (factor), \"ND 0.9\" (density) or \"3 stops\"",
    |text| {
        let t = text.trim().to_lowercase();
        match t.strip_prefix("nd").or_else(|| t.strip_prefix("density")) {
            // With a decimal point it is a density, without one the factor.
            Some(rest) if rest.contains('.') || t.starts_with("density") => number(rest).map(|d| d * std::f64::consts::LOG2_10),
            Some(rest) => number(rest).filter(|f| *f > 0.0).map(f64::log2),
            None => with_unit(&t, &[("stops", 1.0), ("stop", 1.0), ("ev", 1.0)], 1.0),
        }
    },
    |v| format!("{v} stops")
);
quantity!(
    /// A frequency, Hz.
    Hertz, "a frequency such as \"50 Hz\" or \"1.2 kHz\"",
    |text| with_unit(&text.trim().to_lowercase(), &[("khz", 1e3), ("hz", 1.0)], 1.0),
    |v| format!("{v} Hz")
);

quantity!(
    /// A moment: days of universal time since noon of 2000-01-01.
    Moment, "a date and time with its zone, such as \"2026-06-21T12:00+02:00\" or \"2026-06-21 10:00Z\"",
    |text| moment(text),
    |v| show_moment(v)
);

/// RFC 3339, seconds optional; the zone is needed. Years 1900 to 2100, for which the sun's place is known.
fn moment(text: &str) -> Option<f64> {
    let text = text.trim();
    // Seconds may be left out: they follow the second colon of the time.
    let clock = text.find(['T', 't', ' '])? + 1;
    let (date, rest) = text.split_at(clock);
    let zone = rest.find(['Z', 'z', '+', '-', ' ']).unwrap_or(rest.len());
    let (time, zone) = rest.split_at(zone);
    let seconds = if time.matches(':').count() == 1 { ":00" } else { "" };
    let whole: toml::value::Datetime = format!("{date}{time}{seconds}{}", zone.trim()).parse().ok()?;
    let (date, time) = (whole.date?, whole.time?);
    let offset = match whole.offset? {
        toml::value::Offset::Z => 0.0,
        toml::value::Offset::Custom { minutes } => f64::from(minutes) * 60.0,
    };
    let seconds = f64::from(time.hour) * 3600.0
        + f64::from(time.minute) * 60.0
        + f64::from(time.second.unwrap_or(0))
        + f64::from(time.nanosecond.unwrap_or(0)) * 1e-9;
    let in_reach = (1900..=2100).contains(&date.year);
    let days = diopter_scene::daylight::sun::days_since_2000;
    in_reach.then(|| days(date.year.into(), date.month.into(), date.day.into(), seconds - offset))
}

/// The moment in universal time.
fn show_moment(days: f64) -> String {
    let seconds = ((days + 0.5) * 86_400.0).round();
    let (day, second) = ((seconds / 86_400.0).floor() as i64, seconds.rem_euclid(86_400.0) as i64);
    // Civil date of a day number. Source: H. Hinnant, "chrono-Compatible Low-Level Date Algorithms" (2013).
    let z = day + 730_425;
    let era = z.div_euclid(146_097);
    let of_era = z.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let m = (5 * of_year + 2) / 153;
    let (d, m) = (of_year - (153 * m + 2) / 5 + 1, if m < 10 { m + 3 } else { m - 9 });
    let y = year_of_era + era * 400 + i64::from(m <= 2);
    format!("{y:04}-{m:02}-{d:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// An ISO speed, or the camera's choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum IsoChoice {
    /// The camera chooses.
    Auto,
    /// As set.
    Fixed(Iso),
}

impl IsoChoice {
    /// The speed, where it is set.
    pub fn fixed(self) -> Option<f64> {
        match self {
            IsoChoice::Auto => None,
            IsoChoice::Fixed(iso) => Some(iso.0),
        }
    }
}

impl FromStr for IsoChoice {
    type Err = QuantityError;
    fn from_str(text: &str) -> Result<Self, QuantityError> {
        let bare = text.trim().to_lowercase();
        match bare.strip_prefix("iso").unwrap_or(&bare).trim() {
            "auto" => Ok(IsoChoice::Auto),
            _ => text
                .parse()
                .map(IsoChoice::Fixed)
                .map_err(|e: QuantityError| wrong(&e.found, "an ISO speed such as \"ISO 400\", or auto")),
        }
    }
}

impl fmt::Display for IsoChoice {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            IsoChoice::Auto => f.write_str("auto"),
            IsoChoice::Fixed(iso) => iso.fmt(f),
        }
    }
}

impl<'de> Deserialize<'de> for IsoChoice {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let expected = "an ISO speed such as \"ISO 400\", or \"auto\"";
        d.deserialize_any(TextOrNumber::<IsoChoice> { bare: |v| IsoChoice::Fixed(Iso(v)), expected })
    }
}

impl Serialize for IsoChoice {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

/// What is to be sharp.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FocusTo {
    /// A distance.
    Distance(Distance),
    /// The film so far behind its place for infinity.
    Extension(LengthMm),
    /// What autofocus finds.
    Auto,
    /// What autofocus finds at a place of the picture, 0 to 1 across and down.
    At([f64; 2]),
    /// A thing of the scene, by name.
    On(String),
    /// As near as can be with infinity still sharp.
    Hyperfocal,
}

const FOCUS: &str =
    "a distance such as \"2.5m\" or \"inf\", \"auto\", \"at 0.4,0.6\", \"on NAME\", \"hyperfocal\" or \"extension 1.2mm\"";

impl FromStr for FocusTo {
    type Err = QuantityError;
    fn from_str(text: &str) -> Result<Self, QuantityError> {
        let trimmed = text.trim();
        match trimmed {
            "auto" | "af" => return Ok(FocusTo::Auto),
            "hyperfocal" => return Ok(FocusTo::Hyperfocal),
            _ => (),
        }
        let parsed = match trimmed.split_once(char::is_whitespace) {
            Some(("at", place)) => place
                .split_once(',')
                .and_then(|(x, y)| Some(FocusTo::At([x.trim().parse().ok()?, y.trim().parse().ok()?])))
                .filter(|f| matches!(f, FocusTo::At(p) if p.iter().all(|v| v.is_finite()))),
            Some(("on", name)) if !name.trim().is_empty() => Some(FocusTo::On(name.trim().to_owned())),
            Some(("extension", length)) => length.parse().ok().map(FocusTo::Extension),
            _ => trimmed.parse().ok().map(FocusTo::Distance),
        };
        parsed.ok_or_else(|| wrong(text, FOCUS))
    }
}

impl fmt::Display for FocusTo {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            FocusTo::Distance(d) => d.fmt(f),
            FocusTo::Extension(e) => write!(f, "extension {e}"),
            FocusTo::Auto => f.write_str("auto"),
            FocusTo::At([x, y]) => write!(f, "at {x},{y}"),
            FocusTo::On(name) => write!(f, "on {name}"),
            FocusTo::Hyperfocal => f.write_str("hyperfocal"),
        }
    }
}

impl<'de> Deserialize<'de> for FocusTo {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(TextOrNumber::<FocusTo> { bare: |v| FocusTo::Distance(Distance(v)), expected: FOCUS })
    }
}

impl Serialize for FocusTo {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

/// Pixels across and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl FromStr for Size {
    type Err = QuantityError;
    fn from_str(text: &str) -> Result<Self, QuantityError> {
        let parts = text.trim().split_once(['x', 'X', '×']);
        let side = |s: &str| s.trim().parse::<usize>().ok();
        match parts.and_then(|(w, h)| Some((side(w)?, side(h)?))) {
            Some((width, height)) => Ok(Size { width, height }),
            None => Err(wrong(text, "a size such as \"1920x1280\"")),
        }
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl<'de> Deserialize<'de> for Size {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        // Two numbers in a list are a mistake that deserves an example.
        d.deserialize_any(Text::<Size> { expected: "a size such as \"1920x1280\"", of: PhantomData })
    }
}

impl Serialize for Size {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

/// Equal bands of wavelengths side by side: "400..700/10nm" is 30 bands, the first from 400 to 410 nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpectralBands {
    first_nm: u32,
    last_nm: u32,
    step_nm: u32,
}

impl SpectralBands {
    /// Wavelengths that light has, nm.
    const CARRIED_NM: std::ops::RangeInclusive<u32> = 380..=780;

    /// Bands of `step_nm` from `first_nm` to `last_nm`; `None` unless they are one or more whole bands within 380 to 780 nm.
    pub fn new(first_nm: u32, last_nm: u32, step_nm: u32) -> Option<Self> {
        let carried = Self::CARRIED_NM.contains(&first_nm) && Self::CARRIED_NM.contains(&last_nm);
        let whole = first_nm < last_nm && step_nm > 0 && (last_nm - first_nm).is_multiple_of(step_nm);
        (carried && whole).then_some(SpectralBands { first_nm, last_nm, step_nm })
    }

    /// Both limits of each band, nm, from the shortest wavelengths on.
    pub fn limits(self) -> impl Iterator<Item = [u32; 2]> {
        (self.first_nm..self.last_nm).step_by(self.step_nm as usize).map(move |nm| [nm, nm + self.step_nm])
    }
}

impl FromStr for SpectralBands {
    type Err = QuantityError;
    fn from_str(text: &str) -> Result<Self, QuantityError> {
        let whole = |s: &str| s.trim().parse::<u32>().ok();
        let parts = || {
            let (range, step) = text.trim().trim_end_matches("nm").split_once('/')?;
            let (first, last) = range.split_once("..")?;
            SpectralBands::new(whole(first)?, whole(last.trim().trim_end_matches("nm"))?, whole(step)?)
        };
        parts().ok_or_else(|| wrong(text, "whole bands of wavelengths within 380 to 780 nm, such as 400..700/10nm"))
    }
}

impl fmt::Display for SpectralBands {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}..{}/{}nm", self.first_nm, self.last_nm, self.step_nm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_whole_and_within_the_light() {
        let bands: SpectralBands = "395..705/10nm".parse().unwrap();
        assert_eq!(
            (bands.limits().count(), bands.limits().next(), bands.limits().last()),
            (31, Some([395, 405]), Some([695, 705]))
        );
        assert_eq!(bands.to_string().parse::<SpectralBands>(), Ok(bands));
        assert_eq!("400..700nm / 5 nm".parse::<SpectralBands>(), Ok(SpectralBands::new(400, 700, 5).unwrap()));
        for bad in
            ["", "400..700", "400..700/0", "400..700/7", "700..400/10", "300..700/10", "400..790/10", "400..700/2.5", "4..4/1"]
        {
            assert!(bad.parse::<SpectralBands>().is_err(), "{bad}");
        }
    }

    #[test]
    fn quantities_read_as_people_write_them() {
        assert_eq!("50 mm".parse::<LengthMm>().unwrap().0, 50.0);
        assert_eq!("5cm".parse::<LengthMm>().unwrap().0, 50.0);
        assert_eq!("f/2.8".parse::<FNumber>().unwrap().0, 2.8);
        assert_eq!("2.8".parse::<FNumber>().unwrap().0, 2.8);
        assert_eq!("1/125 s".parse::<Seconds>().unwrap().0, 0.008);
        for text in ["1/125 s", "1/3 s", "0.5 s", "1.5 s", "30 s"] {
            assert_eq!(text.parse::<Seconds>().unwrap().to_string(), text);
        }
        assert_eq!("8ms".parse::<Seconds>().unwrap().0, 0.008);
        assert_eq!("ISO 400".parse::<Iso>().unwrap().0, 400.0);
        assert_eq!("2.5m".parse::<Distance>().unwrap().0, 2.5);
        assert_eq!("inf".parse::<Distance>().unwrap().0, f64::INFINITY);
        assert_eq!("1920x1280".parse::<Size>().unwrap(), Size { width: 1920, height: 1280 });
    }

    #[test]
    fn nonsense_says_what_was_expected() {
        assert_eq!("fast".parse::<Seconds>().unwrap_err().to_string(), "\"fast\" is not a time such as \"1/125 s\" or \"8 ms\"");
        for bad in ["", "f/", "nan", "1/0", "f/inf"] {
            assert!(bad.parse::<FNumber>().is_err(), "{bad}");
        }
        for bad in ["10", "10x", "-1x5", "1.5x2"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
    }

    #[test]
    fn filters_are_written_in_three_ways() {
        for (text, stops) in [("ND8", 3.0), ("nd 1000", 9.9658), ("ND 0.9", 2.9897), ("3 stops", 3.0), ("2", 2.0)] {
            assert!((text.parse::<Filter>().unwrap().0 - stops).abs() < 1e-3, "{text}");
        }
        assert_eq!("+1/3 EV".parse::<Ev>().unwrap().0, 1.0 / 3.0);
        assert_eq!("1ev".parse::<Ev>().unwrap().0, 1.0);
        assert_eq!("auto".parse::<IsoChoice>().unwrap(), IsoChoice::Auto);
        assert_eq!("ISO 800".parse::<IsoChoice>().unwrap().fixed(), Some(800.0));
        assert!("ND0".parse::<Filter>().is_err() && "fast".parse::<IsoChoice>().is_err());
    }

    #[test]
    fn quantities_survive_being_written() {
        for t in [1.0 / 125.0, 0.5, 30.0, 1.0 / 8000.0, 0.0123] {
            let back: Seconds = Seconds(t).to_string().parse().unwrap();
            assert!((back.0 / t - 1.0).abs() < 1e-9, "{t} {}", Seconds(t));
        }
    }

    #[test]
    fn moments_need_a_zone_and_come_back_in_universal_time() {
        let parse = |t: &str| t.parse::<Moment>();
        assert!((parse("2000-01-01T12:00:00Z").unwrap().0).abs() < 1e-9);
        assert!((parse("2000-01-02 13:00+01:00").unwrap().0 - 1.0).abs() < 1e-9);
        for (text, shown) in [
            ("2026-06-21T12:00+02:00", "2026-06-21T10:00:00Z"),
            ("2024-02-29 23:59:59 -01:00", "2024-03-01T00:59:59Z"),
            ("1999-12-31T00:00Z", "1999-12-31T00:00:00Z"),
        ] {
            assert_eq!(parse(text).unwrap().to_string(), shown);
            assert_eq!(parse(shown).unwrap(), parse(text).unwrap());
        }
        for bad in ["2026-06-21T12:00", "2026-06-21", "noon", "2026-13-01T00:00Z", "1500-01-01T00:00Z", "", "2026-02-30T00:00Z"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}

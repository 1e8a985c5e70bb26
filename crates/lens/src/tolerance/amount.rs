//! Amounts of a sheet with their units.

use serde::Deserialize;

/// A number in the usual unit, or a text with its unit.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number, or a text with a unit such as \"0.02 mm\"")]
pub(super) enum Amount {
    Number(f64),
    Text(String),
}

/// Units of tolerances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unit {
    Bare,
    Millimeters,
    Percent,
    Fringes,
    Degrees,
}

/// Words for units, the unit, and how many of it they are.
const UNITS: [(&str, Unit, f64); 15] = [
    ("mm", Unit::Millimeters, 1.0),
    ("µm", Unit::Millimeters, 1e-3),
    ("um", Unit::Millimeters, 1e-3),
    ("%", Unit::Percent, 1.0),
    ("fringes", Unit::Fringes, 1.0),
    ("fringe", Unit::Fringes, 1.0),
    ("deg", Unit::Degrees, 1.0),
    ("°", Unit::Degrees, 1.0),
    ("arcmin", Unit::Degrees, 1.0 / 60.0),
    ("'", Unit::Degrees, 1.0 / 60.0),
    ("′", Unit::Degrees, 1.0 / 60.0),
    ("arcsec", Unit::Degrees, 1.0 / 3600.0),
    ("\"", Unit::Degrees, 1.0 / 3600.0),
    ("″", Unit::Degrees, 1.0 / 3600.0),
    ("mrad", Unit::Degrees, 0.18 / std::f64::consts::PI),
];

/// Reads an amount that may be in some units; `usual` is that of a bare number.
pub(super) fn amount(key: &str, a: &Amount, usual: Unit, allowed: &[Unit], example: &str) -> Result<(f64, Unit), String> {
    let wrong = |found: &str| format!("{key} {found}: expected {example}");
    let (value, unit, found) = match a {
        Amount::Number(v) => (*v, usual, v.to_string()),
        Amount::Text(t) => {
            let text = t.trim();
            let found = format!("\"{text}\"");
            let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c))).unwrap_or(text.len());
            let value: f64 = text[..end].parse().map_err(|_| wrong(&found))?;
            let word = text[end..].trim();
            let (unit, factor) = match word {
                "" => (usual, 1.0),
                _ => UNITS.iter().find(|u| u.0 == word).map(|u| (u.1, u.2)).ok_or_else(|| wrong(&found))?,
            };
            (value * factor, unit, found)
        }
    };
    if !((0.0..1e6).contains(&value) && allowed.contains(&unit)) {
        return Err(wrong(&found));
    }
    Ok((value, unit))
}

//! Physical constants and the units that cross crate borders.
//!
//! Source of the constants: SI (2019), exact values.

/// Speed of light in vacuum, m/s.
pub const SPEED_OF_LIGHT: f64 = 299_792_458.0;
/// Planck constant, J·s.
pub const PLANCK: f64 = 6.626_070_15e-34;
/// Boltzmann constant, J/K.
pub const BOLTZMANN: f64 = 1.380_649e-23;
/// Luminous efficacy of monochromatic radiation at 540 THz, lm/W: candela and lux become watts through it.
pub const LUMINOUS_EFFICACY: f64 = 683.0;

/// Millimetres, the lens's unit. Only the mount converts between it and [`Meters`].
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Millimeters(pub f64);

/// Metres, the scene's unit.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Meters(pub f64);

impl From<Meters> for Millimeters {
    fn from(m: Meters) -> Self {
        Millimeters(m.0 * 1000.0)
    }
}

impl From<Millimeters> for Meters {
    fn from(mm: Millimeters) -> Self {
        Meters(mm.0 / 1000.0)
    }
}

/// A number as messages show it: eight digits, with an exponent where zeros would fill a line.
pub fn shown(v: f64) -> String {
    let rounded: f64 = format!("{v:.7e}").parse().unwrap_or(v);
    match rounded == 0.0 || !rounded.is_finite() || (1e-6..1e12).contains(&rounded.abs()) {
        true => rounded.to_string(),
        false => format!("{rounded:e}"),
    }
}

/// Energy of one photon of the given wavelength (nm), in joule: E = h c / λ.
pub fn photon_energy_j(nm: f64) -> f64 {
    PLANCK * SPEED_OF_LIGHT / (nm * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_size_are_shown_with_few_digits() {
        for (value, text) in [
            (50.0, "50"),
            (0.1 + 0.2, "0.3"),
            (-123_456.789_012, "-123456.79"),
            (4e7, "40000000"),
            (1e300, "1e300"),
            (-1.234_567_891e-300, "-1.2345679e-300"),
            (0.0, "0"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(shown(value), text);
        }
    }

    #[test]
    fn green_photon_carries_two_and_a_quarter_electronvolts() {
        let ev = photon_energy_j(550.0) / 1.602_176_634e-19;
        assert!((ev - 2.2543).abs() < 1e-3, "{ev}");
    }
}

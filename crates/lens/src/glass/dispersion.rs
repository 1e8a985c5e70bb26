//! Dispersion formulas: wavelength in µm → index relative to air.
//!
//! Numbering and meaning of the coefficients: refractiveindex.info, "Dispersion formulas" (2016), formulas 1 to 9.

/// Index by formula `number` (1 to 9) at a wavelength in µm; NaN where the formula has no real value.
pub(super) fn index(number: u8, c: &[f64], um: f64) -> f64 {
    let at = |i: usize| c.get(i).copied().unwrap_or(0.0);
    let l2 = um * um;
    let pairs = |from: usize| c.get(from..).unwrap_or(&[]).chunks_exact(2).map(|p| (p[0], p[1]));
    match number {
        // Sellmeier, resonances in µm and in µm².
        1 => (1.0 + at(0) + pairs(1).map(|(b, r)| b * l2 / (l2 - r * r)).sum::<f64>()).sqrt(),
        2 => (1.0 + at(0) + pairs(1).map(|(b, r)| b * l2 / (l2 - r)).sum::<f64>()).sqrt(),
        // Polynomial (Schott's old formula among others).
        3 => (at(0) + pairs(1).map(|(b, e)| b * um.powf(e)).sum::<f64>()).sqrt(),
        4 => {
            let term = |i: usize| if at(i) == 0.0 { 0.0 } else { at(i) * um.powf(at(i + 1)) / (l2 - at(i + 2).powf(at(i + 3))) };
            (at(0) + term(1) + term(5) + pairs(9).map(|(b, e)| b * um.powf(e)).sum::<f64>()).sqrt()
        }
        // Cauchy.
        5 => at(0) + pairs(1).map(|(b, e)| b * um.powf(e)).sum::<f64>(),
        // Gases.
        6 => 1.0 + at(0) + pairs(1).map(|(b, r)| b / (r - 1.0 / l2)).sum::<f64>(),
        // Herzberger.
        7 => {
            let d = 1.0 / (l2 - 0.028);
            at(0) + at(1) * d + at(2) * d * d + at(3) * l2 + at(4) * l2 * l2 + at(5) * l2 * l2 * l2
        }
        // Retro.
        8 => {
            let q = at(0) + at(1) * l2 / (l2 - at(2)) + at(3) * l2;
            ((1.0 + 2.0 * q) / (1.0 - q)).sqrt()
        }
        // Exotic.
        9 => {
            let d = um - at(4);
            (at(0) + at(1) / (l2 - at(2)) + at(3) * d / (d * d + at(5))).sqrt()
        }
        _ => f64::NAN,
    }
}

/// Strength of a resonance (its term of n² far from it) below which an index on its other side is still believed: that of silicon at 1.13 µm is 0.003.
const WEAK: f64 = 0.01;

/// Whether a resonance of a Sellmeier formula (1, 2) lies between a wavelength and the longer ones, in µm, from which the formula holds: what it gives there is of no
/// glass.
pub(super) fn is_beyond_resonance(number: u8, c: &[f64], um: f64, holds_from_um: f64) -> bool {
    if um >= holds_from_um || !matches!(number, 1 | 2) {
        return false;
    }
    c.get(1..).unwrap_or(&[]).chunks_exact(2).any(|p| {
        let at = if number == 1 { p[1].abs() } else { p[1].max(0.0).sqrt() };
        p[0].abs() > WEAK && (um..holds_from_um).contains(&at)
    })
}

#[cfg(test)]
mod tests {
    use super::{index, is_beyond_resonance};

    #[test]
    fn resonances_are_told_by_their_place_and_strength() {
        // Resonances at 0.4 µm, and a weak one at 0.9 µm.
        for (number, c) in [(1, [0.0, 1.0, 0.4, 0.001, 0.9]), (2, [0.0, 1.0, 0.16, 0.001, 0.81])] {
            assert!(is_beyond_resonance(number, &c, 0.39, 1.0) && !is_beyond_resonance(number, &c, 0.41, 1.0), "{number}");
            assert!(!is_beyond_resonance(number, &c, 0.3, 0.3), "{number}");
        }
    }

    #[test]
    fn every_formula_has_the_value_worked_out_by_hand() {
        let near = |n: u8, c: &[f64], um: f64, expected: f64| {
            let found = index(n, c, um);
            assert!((found - expected).abs() < 1e-12, "formula {n}: {found} {expected}");
        };
        // At 0.5 µm λ² = 1/4, so every term is a short fraction.
        near(1, &[0.0, 1.0, 0.1], 0.5, (1.0f64 + 0.25 / 0.24).sqrt());
        near(2, &[0.5, 1.0, 0.1], 0.5, (1.5f64 + 0.25 / 0.15).sqrt());
        near(3, &[2.0, 0.5, 2.0, 0.01, -2.0], 0.5, (2.0f64 + 0.125 + 0.04).sqrt());
        near(4, &[2.0, 0.1, 2.0, 0.3, 2.0, 0.0, 0.0, 0.0, 0.0, 0.02, -2.0], 0.5, (2.0f64 + 0.025 / 0.16 + 0.08).sqrt());
        near(5, &[1.5, 0.01, -2.0], 0.5, 1.54);
        near(6, &[0.0, 0.05, 104.0], 0.5, 1.0005);
        near(7, &[1.5, 0.0111, 0.0, 0.04], 0.5, 1.5 + 0.05 + 0.01);
        near(8, &[0.2, 0.03, 0.05], 0.5, (1.475f64 / 0.7625).sqrt());
        near(9, &[2.0, 0.05, 0.05, 0.1, 0.4, 0.09], 0.5, (2.0f64 + 0.25 + 0.1).sqrt());
        assert!(index(2, &[0.0, -3.0, 0.1], 0.5).is_nan());
    }
}

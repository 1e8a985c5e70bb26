//! Indices of glasses as Chebyshev fits in 1/λ², so that every lane may have its own wavelength.
//!
//! A glass that has no index at some visible wavelengths, or a resonance close to them (ZnSe below 400 nm), has no such fit: its formula is asked lane by lane.

use crate::glass::{Glass, VISIBLE_NM};
use std::sync::LazyLock;

/// Coefficients of the fit of an index: degree 7 leaves less than 1e-7.
pub(super) const TERMS: usize = 8;

/// cos(π k (j + ½) / TERMS)
static COSINES: LazyLock<[[f64; TERMS]; TERMS]> = LazyLock::new(|| {
    let at = |k: usize, j: usize| (std::f64::consts::PI * k as f64 * (j as f64 + 0.5) / TERMS as f64).cos();
    std::array::from_fn(|k| std::array::from_fn(|j| at(k, j)))
});

/// Largest error of a fit that is used.
const TOLERANCE: f64 = 2e-6;

/// Chebyshev coefficients of n over x = (1/λ² scaled to −1..1); `None` where the glass has no index somewhere in [`VISIBLE_NM`], or the fit misses it by more
/// than [`TOLERANCE`] between its nodes or at the ends.
pub(super) fn fit(glass: &Glass) -> Option<[f64; TERMS]> {
    let [short, long] = VISIBLE_NM;
    let (low, high) = (long.powi(-2), short.powi(-2));
    let value = |x: f64| glass.index((0.5 * (low + high) + 0.5 * (high - low) * x).powf(-0.5));
    let values: [f64; TERMS] = COSINES[1].map(value);
    let coefficients: [f64; TERMS] = std::array::from_fn(|k| {
        let sum: f64 = values.iter().zip(&COSINES[k]).map(|(v, c)| v * c).sum();
        sum * if k == 0 { 1.0 } else { 2.0 } / TERMS as f64
    });
    // The error is largest at the extrema of the polynomial of the next degree, which lie between the nodes and at the ends.
    let misses = |i: usize| {
        let angle = std::f64::consts::PI * i as f64 / TERMS as f64;
        let sum: f64 = coefficients.iter().enumerate().map(|(k, c)| c * (k as f64 * angle).cos()).sum();
        !((sum - value(angle.cos())).abs() <= TOLERANCE)
    };
    (!(0..=TERMS).any(misses)).then_some(coefficients)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glass::entry_names;

    #[test]
    fn fits_hold_for_glasses_and_not_beside_a_resonance() {
        let mut fitted = 0;
        for glass in entry_names().into_iter().filter_map(|name| Glass::parse(&name).ok()) {
            fitted += usize::from(fit(&glass).is_some_and(|c| c.iter().all(|c| c.is_finite())));
        }
        // All but a few materials: optical glasses are smooth over what is seen.
        assert!(fitted > 1600, "{fitted}");
        for name in ["N-BK7", "SF6", "PMMA", "SILICA"] {
            assert!(fit(&Glass::parse(name).unwrap()).is_some(), "{name}");
        }
        assert_eq!(fit(&Glass::parse("ZnSe").unwrap()), None);
    }
}

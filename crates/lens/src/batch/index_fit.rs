//! Indices of glasses as Chebyshev fits in 1/λ², so that every lane may have its own wavelength.

use crate::glass::{Glass, VISIBLE_NM};
use std::sync::LazyLock;

/// Coefficients of the fit of an index: degree 7 leaves less than 1e-7.
pub(super) const TERMS: usize = 8;

/// cos(π k (j + ½) / TERMS)
static COSINES: LazyLock<[[f64; TERMS]; TERMS]> = LazyLock::new(|| {
    let at = |k: usize, j: usize| (std::f64::consts::PI * k as f64 * (j as f64 + 0.5) / TERMS as f64).cos();
    std::array::from_fn(|k| std::array::from_fn(|j| at(k, j)))
});

/// Chebyshev coefficients of n over x = (1/λ² scaled to −1..1).
pub(super) fn fit(glass: &Glass) -> [f64; TERMS] {
    let [short, long] = VISIBLE_NM;
    let (low, high) = (long.powi(-2), short.powi(-2));
    let value = |x: f64| glass.index((0.5 * (low + high) + 0.5 * (high - low) * x).powf(-0.5));
    let values: [f64; TERMS] = COSINES[1].map(value);
    std::array::from_fn(|k| {
        let sum: f64 = values.iter().zip(&COSINES[k]).map(|(v, c)| v * c).sum();
        sum * if k == 0 { 1.0 } else { 2.0 } / TERMS as f64
    })
}

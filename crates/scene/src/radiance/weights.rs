//! Weights of strategies beside each other: multiple importance sampling.

/// Weight of the strategy with density `a` beside one with density `b` (power heuristic, Veach 1997 eq. 9.13).
#[inline]
pub(super) fn mis(a: f32, b: f32) -> f32 {
    1.0 / (1.0 + squared_ratio(b, a))
}

/// (b / a)²; 0 where `b` is 0.
#[inline]
pub(super) fn squared_ratio(b: f32, a: f32) -> f32 {
    if b == 0.0 {
        return 0.0;
    }
    // A quotient first: squares of large densities overflow.
    let r = b / a;
    r * r
}

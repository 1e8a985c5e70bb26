//! Weights of strategies beside each other, and Russian roulette.

use diopter_light::Sampled;

/// Largest probability with which a path goes on where Russian roulette decides, so that every path ends.
pub(super) const MOST_SURVIVAL: f32 = 0.95;

/// Russian roulette on what a path can still bring: whether it goes on, for which its throughput is divided by the probability of that. `most`: the largest probability.
#[inline]
pub(super) fn russian_roulette(
    throughput: &mut Sampled,
    eta_scale: f32,
    vertex: u32,
    u: f32,
    roulette_depth: u32,
    most: f32,
) -> bool {
    if vertex < roulette_depth {
        return true;
    }
    let survival = (throughput.max_element() * eta_scale).clamp(0.0, most);
    *throughput /= survival;
    u < survival
}

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

//! Values between those of a grid, and their limits.

use glam::{IVec3, Vec3};
use std::ops::{Add, Mul};

/// Room for the rounding of places, in values of a grid.
pub(super) const ROUNDING: f32 = 2e-3;

/// Limits of no values.
pub(super) const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// Limits of what is within either.
pub(super) fn joined(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Trilinear interpolation between the eight values from `base` on; what is not there is 0.
#[inline]
pub(crate) fn trilinear<V: Add<Output = V> + Mul<f32, Output = V>>(
    base: IVec3,
    f: Vec3,
    zero: V,
    value: impl Fn(IVec3) -> Option<V>,
) -> V {
    let mut sum = zero;
    for corner in 0..8 {
        let off = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
        if let Some(v) = value(base + off) {
            let side = |k: usize| if off[k] == 1 { f[k] } else { 1.0 - f[k] };
            sum = sum + v * (side(0) * side(1) * side(2));
        }
    }
    sum
}

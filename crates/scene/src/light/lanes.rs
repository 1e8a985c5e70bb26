//! Functions of four numbers at a time, with the same bits everywhere.

use glam::Vec4;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Square roots of numbers from 0 on.
#[inline]
pub(super) fn square_roots(x: Vec4) -> Vec4 {
    let mut roots = x.to_array();
    roots.iter_mut().for_each(|x| *x = x.sqrt());
    Vec4::from(roots)
}

/// acos of numbers from −1 to 1 (clamped), rad, to 3e-7. Source: S. Moshier, Cephes library, `asinf.c` (minimax polynomial).
#[inline]
pub(super) fn arccosines(x: Vec4) -> Vec4 {
    let (half, size) = (Vec4::splat(0.5), x.abs().min(Vec4::ONE));
    let is_large = size.cmpgt(half);
    let z = Vec4::select(is_large, half * (Vec4::ONE - size), size * size);
    let s = Vec4::select(is_large, square_roots(z), size);
    let series = z * 4.216_32e-2 + 2.418_131_1e-2;
    let series = (series * z + 4.547_002_6e-2) * z + 7.495_300_3e-2;
    let arcsine = s + s * z * (series * z + 1.666_675_2e-1);
    let upright = Vec4::splat(FRAC_PI_2);
    // Of the size; beyond a right angle what is left to half a turn.
    let angle = Vec4::select(is_large, arcsine + arcsine, upright - arcsine);
    Vec4::select(x.cmplt(Vec4::ZERO), Vec4::splat(PI) - angle, angle)
}

/// atan2 of `y` > 0 and `x`, rad, from 0 to π, to 4e-7. Source: S. Moshier, Cephes library, `atanf.c` (minimax polynomial).
#[inline]
pub(super) fn angles(y: Vec4, x: Vec4) -> Vec4 {
    const TAN_EIGHTH_TURN_HALVED: f32 = 0.414_213_57;
    let across = x.abs();
    let (less, more) = (y.min(across), y.max(across));
    // Of at most an eighth of a turn; its upper half by what it has beyond, or lacks to, the eighth.
    let is_large = less.cmpgt(more * TAN_EIGHTH_TURN_HALVED);
    let tangent = Vec4::select(is_large, less - more, less) / Vec4::select(is_large, less + more, more);
    let z = tangent * tangent;
    let series = (z * 8.053_745e-2 - 1.387_768_6e-1) * z + 1.997_771_1e-1;
    let angle = (series * z - 3.333_295e-1) * z * tangent + tangent;
    let angle = Vec4::select(is_large, angle + FRAC_PI_4, angle);
    let angle = Vec4::select(y.cmpgt(across), FRAC_PI_2 - angle, angle);
    Vec4::select(x.cmplt(Vec4::ZERO), PI - angle, angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arccosines_are_those_of_the_library() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0;
            let found = arccosines(Vec4::new(x, -x, 0.5 * x, 1.001 * x)).to_array();
            for (found, x) in found.into_iter().zip([x, -x, 0.5 * x, 1.001 * x]) {
                let exact = f64::from(x).clamp(-1.0, 1.0).acos();
                assert!((f64::from(found) - exact).abs() < 3e-7, "{x}: {found} {exact}");
            }
        }
    }

    #[test]
    fn angles_are_those_of_the_library() {
        for i in 0..=1000 {
            let angle = f64::from(i) / 1000.0 * std::f64::consts::PI;
            for size in [1e-6, 1.0, 3e5] {
                let (y, x) = ((size * angle.sin()).max(1e-20) as f32, (size * angle.cos()) as f32);
                let found = angles(Vec4::new(y, 1.0, 1e-3, y), Vec4::new(x, x, 1.0, -x)).to_array();
                for (found, [y, x]) in found.into_iter().zip([[y, x], [1.0, x], [1e-3, 1.0], [y, -x]]) {
                    let exact = f64::from(y).atan2(f64::from(x));
                    assert!((f64::from(found) - exact).abs() < 4e-7, "{y} {x}: {found} {exact}");
                }
            }
        }
    }
}

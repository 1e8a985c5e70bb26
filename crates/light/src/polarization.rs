//! Polarised light: Stokes vectors, Mueller matrices, and the frames they are in.
//!
//! Conventions, those of M. Born and E. Wolf, "Principles of Optics" (7th ed.), §1.4 and §10.9.3. Light goes along a unit vector k; its frame is an axis x
//! perpendicular to k and y = k × x, so that x, y, k are right-handed. With fields E exp(−iωt),
//!
//! * I = |Ex|² + |Ey|², Q = |Ex|² − |Ey|², U = 2 Re(Ex Ey*), V = 2 Im(Ex Ey*):
//! * Q > 0 is linear along x, U > 0 linear at 45° from x towards y (counter-clockwise for someone who looks into the light);
//! * V > 0 is right-handed circular as in optics: who looks into the light sees the field turn clockwise.
//!
//! A Mueller matrix takes a Stokes vector in the frame of the light that arrives to one in the frame of the light that leaves. A frame turned by half a
//! turn is the same. Everything here is pure algebra; what surfaces do is in `diopter-scene`.

use glam::{Mat4, Vec3, Vec4};

/// A Stokes vector of one wavelength: I, Q, U, V in the unit of I.
pub type Stokes = Vec4;

/// A Mueller matrix of one wavelength.
pub type Mueller = Mat4;

/// What remains after an event that keeps nothing of the polarisation: I alone.
pub const DEPOLARIZER: Mueller = Mat4::from_cols(Vec4::X, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);

/// A Stokes vector in the frame of x axis `a` from one in the frame of x axis `b`, both of light along the unit vector `k`; the axes are perpendicular to it and need not
/// be of unit length. The identity where one of them is 0.
pub fn a_from_b(a: Vec3, b: Vec3, k: Vec3) -> Mueller {
    // b = c a + s (k × a), up to lengths: the angle of b in the frame of a.
    let (c, s) = (a.dot(b), k.cross(a).dot(b));
    let length2 = c * c + s * s;
    if length2 <= 0.0 {
        return Mat4::IDENTITY;
    }
    rotation((c * c - s * s) / length2, 2.0 * c * s / length2)
}

/// Turns Stokes vectors out of a frame that is turned by an angle φ from x towards y; given by cos 2φ and sin 2φ.
pub fn rotation(cos2: f32, sin2: f32) -> Mueller {
    Mat4::from_cols(Vec4::X, Vec4::new(0.0, cos2, sin2, 0.0), Vec4::new(0.0, -sin2, cos2, 0.0), Vec4::W)
}

/// A linear polariser (diattenuator) whose axis is x, by the transmittances (0 to 1) of light along x and along y.
pub fn linear_polarizer(along: f32, across: f32) -> Mueller {
    let (a, b, c) = (0.5 * (along + across), 0.5 * (along - across), (along * across).max(0.0).sqrt());
    Mat4::from_cols(Vec4::new(a, b, 0.0, 0.0), Vec4::new(b, a, 0.0, 0.0), Vec4::Z * c, Vec4::W * c)
}

/// A retarder: the field along y lags behind that along x by `retardance`, rad.
pub fn retarder(retardance: f32) -> Mueller {
    // Ey exp(iδ) with exp(−iωt): Ex Ey* is multiplied by exp(−iδ).
    let (s, c) = retardance.sin_cos();
    Mat4::from_cols(Vec4::X, Vec4::Y, Vec4::new(0.0, 0.0, c, -s), Vec4::new(0.0, 0.0, s, c))
}

/// An element turned by an angle (rad) from x towards y.
pub fn turned(element: Mueller, angle: f32) -> Mueller {
    let (s, c) = (2.0 * angle).sin_cos();
    rotation(c, s) * element * rotation(c, -s)
}

/// Degree of linear polarisation, √(Q² + U²) / I; 0 of no light.
pub fn degree_of_linear_polarization(s: Stokes) -> f32 {
    if s.x > 0.0 { s.y.hypot(s.z) / s.x } else { 0.0 }
}

/// Angle of linear polarisation from x towards y, rad, in (−π/2, π/2].
pub fn angle_of_linear_polarization(s: Stokes) -> f32 {
    0.5 * s.z.atan2(s.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

    const UNPOLARIZED: Stokes = Vec4::X;

    /// The Stokes vector of a field, (re, im) of Ex and Ey.
    fn stokes([xr, xi]: [f32; 2], [yr, yi]: [f32; 2]) -> Stokes {
        let (x2, y2) = (xr * xr + xi * xi, yr * yr + yi * yi);
        Vec4::new(x2 + y2, x2 - y2, 2.0 * (xr * yr + xi * yi), 2.0 * (xi * yr - xr * yi))
    }

    #[test]
    fn malus_and_crossed_polarizers() {
        let first = linear_polarizer(1.0, 0.0) * UNPOLARIZED;
        assert_eq!(first, Vec4::new(0.5, 0.5, 0.0, 0.0));
        for degrees in [0.0f32, 10.0, 45.0, 60.0, 90.0, 135.0] {
            let angle = degrees.to_radians();
            let second = turned(linear_polarizer(1.0, 0.0), angle) * first;
            assert!((second.x - 0.5 * angle.cos().powi(2)).abs() < 1e-6, "{degrees}: {second}");
            // It leaves along the axis of the last one.
            if second.x > 0.01 {
                assert!((degree_of_linear_polarization(second) - 1.0).abs() < 1e-5);
                let turn = (angle_of_linear_polarization(second) - angle).rem_euclid(std::f32::consts::PI);
                assert!(turn.min(std::f32::consts::PI - turn) < 1e-5, "{degrees}: {turn}");
            }
        }
        // One between two crossed ones lets light through again: ½ · ½ · ½ (Hecht, "Optics", §8.2).
        let between = turned(linear_polarizer(1.0, 0.0), FRAC_PI_2) * turned(linear_polarizer(1.0, 0.0), FRAC_PI_4) * first;
        assert!((between.x - 0.125).abs() < 1e-6);
    }

    #[test]
    fn frames_turn_the_field_and_not_the_light() {
        let (a, k) = (Vec3::X, Vec3::Z);
        let angle = 0.4f32;
        let b = Vec3::new(angle.cos(), angle.sin(), 0.0);
        // A field along b, elliptical: given in b's frame and, turned, in a's.
        let (x, y) = ([0.8f32, 0.1], [-0.2f32, 0.5]);
        let turn = |i: usize| (x[i] * angle.cos() - y[i] * angle.sin(), x[i] * angle.sin() + y[i] * angle.cos());
        let ((xr, yr), (xi, yi)) = (turn(0), turn(1));
        let expected = stokes([xr, xi], [yr, yi]);
        assert!((a_from_b(a, b, k) * stokes(x, y) - expected).abs().max_element() < 1e-6);
        assert!((a_from_b(b, a, k) * expected - stokes(x, y)).abs().max_element() < 1e-6);
        // Half a turn is none, nor is the length of an axis anything.
        assert!((a_from_b(-2.0 * a, b * 3.0, k) * stokes(x, y) - expected).abs().max_element() < 1e-6);
    }

    #[test]
    fn a_quarter_wave_makes_right_handed_light_that_turns_clockwise() {
        // Light at 45°, y a quarter of a wave behind: Ex = cos ωt, Ey = cos(ωt − π/2) = sin ωt turns counter-clockwise seen against the light: left-handed.
        let diagonal = stokes([1.0, 0.0], [1.0, 0.0]);
        let circular = retarder(FRAC_PI_2) * diagonal;
        // The field as it is: Ey = exp(iπ/2), real part with exp(−iωt): cos(π/2 − ωt) = sin ωt.
        assert!((circular - stokes([1.0, 0.0], [0.0, 1.0])).abs().max_element() < 1e-6, "{circular}");
        assert!(circular.w < 0.0 && degree_of_linear_polarization(circular) < 1e-6);
        assert!((retarder(-FRAC_PI_2) * diagonal).w > 0.0);
        // Two quarter waves make a half wave: the diagonal flips.
        assert!((retarder(FRAC_PI_2) * circular - Vec4::new(2.0, 0.0, -2.0, 0.0)).abs().max_element() < 1e-6);
    }
}

//! Hands that are not steady.

use glam::{Affine3A, DVec2, DVec3, Quat};

/// Hands that are not steady: turns about the camera's axes, as a sum of sines of random phase.
///
/// The spectrum of the angular speed is flat from 0.5 Hz to 4 Hz and falls with the square of the frequency up to 20 Hz; a fifth of
/// its variance is a tremor around 9 Hz (± 2 Hz). Roll is half as strong as pitch and yaw. Frequencies: hand and forearm about 4 Hz
/// (Japanese Journal of Ergonomics 31(6), 399), tremor 6 to 12 Hz (Lakie et al. 2015, J Physiol 593, 4411), nothing of note above
/// 20 Hz. No source that we could read gives the strength: 0.6 °/s is a steady hand between two thresholds of sharpness that people
/// report (0.26 °/s: first visible loss at 85 mm and 1/60 s; 3.6 °/s: the 63 µm of ISO 20954-1 at one over the focal length).
#[derive(Clone, Debug, PartialEq)]
pub struct Shake {
    /// For pitch, yaw, roll: angular speed (rad/s), frequency (Hz), phase (rad).
    waves: [Vec<[f64; 3]>; 3],
}

/// Sines an axis.
const WAVES: usize = 48;

impl Shake {
    /// A shake of a root mean square angular speed (deg/s) of pitch and of yaw. Roll is half as strong.
    pub fn new(rms_deg_s: f64, seed: u64) -> Self {
        let spectrum = |f: f64| {
            let hand = if f < 4.0 { 1.0 } else { (4.0 / f).powi(2) };
            hand * 0.8 / HAND + 0.2 * (-0.5 * ((f - 9.0) / 2.0).powi(2)).exp() / TREMOR
        };
        // Areas under the two parts, so that 0.8 and 0.2 are their variances.
        const HAND: f64 = 3.5 + 4.0 * 4.0 * (1.0 / 4.0 - 1.0 / 20.0);
        const TREMOR: f64 = 2.0 * 2.506_628_274_631;
        let mut state = seed ^ 0x5eed_0f5a_4ae5_1234;
        let mut draw = || {
            // SplitMix64 (Steele, Lea & Flood 2014).
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let axis = |strength: f64, draw: &mut dyn FnMut() -> f64| {
            let band = |k: usize| 0.5 * 40f64.powf(k as f64 / WAVES as f64);
            (0..WAVES)
                .map(|k| {
                    let (from, to) = (band(k), band(k + 1));
                    let f = from + (to - from) * draw();
                    let rms = strength * (spectrum(f) * (to - from)).sqrt();
                    [rms * std::f64::consts::SQRT_2, f, std::f64::consts::TAU * draw()]
                })
                .collect::<Vec<_>>()
        };
        let rms = rms_deg_s.to_radians();
        Shake { waves: [axis(rms, &mut draw), axis(rms, &mut draw), axis(0.5 * rms, &mut draw)] }
    }

    /// Turns about the camera's x (pitch), y (yaw) and z (roll), rad, at a time, s.
    pub fn angles(&self, time_s: f64) -> [f64; 3] {
        let sum = |waves: &Vec<[f64; 3]>| {
            let angle = |[speed, f, phase]: &[f64; 3]| {
                let w = std::f64::consts::TAU * f;
                speed / w * (w * time_s + phase).sin()
            };
            waves.iter().map(angle).sum()
        };
        [0, 1, 2].map(|k| sum(&self.waves[k]))
    }

    /// The same angles behind a filter that has run for ever: `response` is its gain and phase at a frequency (Hz) as a complex number.
    pub fn filtered(&self, time_s: f64, response: impl Fn(f64) -> DVec2) -> [f64; 3] {
        let angle = |[speed, f, phase]: &[f64; 3]| {
            let w = std::f64::consts::TAU * f;
            let (sin, cos) = (w * time_s + phase).sin_cos();
            speed / w * response(*f).dot(DVec2::new(sin, cos))
        };
        [0, 1, 2].map(|k| self.waves[k].iter().map(angle).sum())
    }

    /// Turn, angular rate (rad/s) and angular acceleration (rad/s²) in the turned axes, in closed form.
    pub fn state(&self, time_s: f64) -> (glam::DQuat, DVec3, DVec3) {
        let of = |power: i32| {
            // The derivative of a sine is one a quarter of a period on, times its angular frequency.
            let sum = |waves: &Vec<[f64; 3]>| -> f64 {
                let wave = |[speed, f, phase]: &[f64; 3]| {
                    let w = std::f64::consts::TAU * f;
                    speed * w.powi(power - 1) * (w * time_s + phase + f64::from(power) * std::f64::consts::FRAC_PI_2).sin()
                };
                waves.iter().map(wave).sum()
            };
            [0, 1, 2].map(|k| sum(&self.waves[k]))
        };
        let ([x, y, z], [dx, dy, dz], [ddx, ddy, ddz]) = (of(0), of(1), of(2));
        let turn = glam::DQuat::from_euler(glam::EulerRot::YXZ, y, x, z);
        // ω = Rzᵀ (Rxᵀ ẏ + ẋ) + ż, each about its axis; its derivative in the turned axes.
        let (back_x, back_z) = (glam::DQuat::from_rotation_x(-x), glam::DQuat::from_rotation_z(-z));
        let yaw = back_x * (DVec3::Y * dy);
        let inner = yaw + DVec3::X * dx;
        let inner_change = back_x * (DVec3::Y * ddy) - (DVec3::X * dx).cross(yaw) + DVec3::X * ddx;
        let carried = back_z * inner;
        let rate = carried + DVec3::Z * dz;
        (turn, rate, back_z * inner_change - (DVec3::Z * dz).cross(carried) + DVec3::Z * ddz)
    }

    /// What it does to a camera at a time, s: camera from steady camera.
    pub fn turn(&self, time_s: f64) -> Affine3A {
        let [x, y, z] = self.angles(time_s).map(|a| a as f32);
        Affine3A::from_quat(Quat::from_euler(glam::EulerRot::YXZ, y, x, z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shake_has_the_speed_it_is_asked_for() {
        for seed in 1..6 {
            let shake = Shake::new(0.6, seed);
            let (n, dt) = (200_000, 1e-3);
            let mut squares = [0.0; 3];
            for i in 0..n {
                let (a, b) = (shake.angles(i as f64 * dt), shake.angles((i as f64 + 1.0) * dt));
                (0..3).for_each(|k| squares[k] += ((b[k] - a[k]) / dt).to_degrees().powi(2) / n as f64);
            }
            let rms = squares.map(f64::sqrt);
            assert!(
                (rms[0] / 0.6 - 1.0).abs() < 0.1 && (rms[1] / 0.6 - 1.0).abs() < 0.1 && (rms[2] / 0.3 - 1.0).abs() < 0.1,
                "{rms:?}"
            );
        }
        assert_ne!(Shake::new(0.6, 1), Shake::new(0.6, 2));
    }

    #[test]
    fn rates_are_those_of_the_turn() {
        let shake = Shake::new(2000.0, 4);
        let h = 1e-6;
        for k in 0..50 {
            let t = f64::from(k) * 0.137;
            let [(before, w0, _), (turn, w, a), (after, w1, _)] = [t - h, t, t + h].map(|t| shake.state(t));
            let steps = (before.conjugate() * after).to_scaled_axis() / (2.0 * h);
            assert!((steps - w).length() < 1e-5 * w.length().max(1.0), "{steps} {w}");
            let change = (w1 - w0) / (2.0 * h);
            assert!((change - a).length() < 1e-5 * a.length().max(1.0), "{change} {a}");
            let single = Quat::from_mat3a(&shake.turn(t).matrix3).as_dquat();
            assert!(single.dot(turn).abs() > 1.0 - 1e-6);
        }
    }
}

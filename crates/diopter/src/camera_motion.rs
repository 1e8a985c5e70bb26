//! Where the camera is while it gathers light: on a path, carried by the scene, in unsteady hands.

use crate::stabiliser::MovingPart;
use glam::{Affine3A, DVec2, DVec3, Quat, Vec3};
use std::sync::Arc;

/// Steps of a way are as many as keep it within these of the true one: 1e-5 rad is a tenth of a pixel of a 50 mm lens on 5 µm
/// pixels; 20 µm of place.
const ANGLE: f32 = 1e-5;
const PLACE_M: f32 = 2e-5;
const MOST_STEPS: usize = 1 << 16;

/// Places of a camera over an exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMotion {
    /// At equal steps; one where the camera stands still.
    keys: Vec<(Quat, Vec3)>,
    span_s: f64,
    /// What moves within the camera meanwhile.
    moving: Option<Arc<MovingPart>>,
}

impl CameraMotion {
    /// A camera that stands still.
    pub fn still(place: Affine3A) -> Self {
        CameraMotion { keys: vec![parts(&place)], span_s: 0.0, moving: None }
    }

    /// The way given by a function of the time (s) since the exposure began.
    pub fn sampled(span_s: f64, at: impl Fn(f64) -> Affine3A) -> Self {
        let mut steps = 4;
        loop {
            let key = |x: f64| parts(&at(x * span_s));
            let keys = (0..=steps).map(|i| key(f64::from(i) / f64::from(steps))).collect();
            let way = CameraMotion { keys, span_s, moving: None };
            let off = |i: u32| {
                // Not the middles: a shake may have its period there.
                let x = (f64::from(i) + 0.42) / f64::from(steps);
                let ((q, p), (q1, p1)) = (key(x), way.parts_at(x * span_s));
                let angle = 2.0 * (q.conjugate() * q1).xyz().length();
                (angle / ANGLE).max((p - p1).length() / PLACE_M)
            };
            let worst = (0..steps).map(off).fold(0.0, f32::max);
            // A few steps see nothing of a quick motion: at least 64 are looked at.
            if (worst <= 1.0 && steps >= 64) || steps as usize >= MOST_STEPS || span_s <= 0.0 {
                let first = way.keys[0];
                let still = way.keys.iter().all(|k| *k == first);
                return if still { CameraMotion { keys: vec![first], span_s: 0.0, moving: None } } else { way };
            }
            steps *= 2;
        }
    }

    fn parts_at(&self, time_s: f64) -> (Quat, Vec3) {
        let last = self.keys.len() - 1;
        if last == 0 {
            return self.keys[0];
        }
        let x = (time_s / self.span_s).clamp(0.0, 1.0) * last as f64;
        let k = (x as usize).min(last - 1);
        let f = (x - k as f64) as f32;
        let ((qa, pa), (qb, pb)) = (self.keys[k], self.keys[k + 1]);
        (qa.lerp(qb, f), pa.lerp(pb, f))
    }

    /// World from camera at a time since the exposure began.
    #[inline]
    pub fn at(&self, time_s: f64) -> Affine3A {
        let (q, p) = self.parts_at(time_s);
        Affine3A::from_rotation_translation(q, p)
    }

    /// Whether it stands still.
    pub fn is_still(&self) -> bool {
        self.keys.len() == 1 && self.moving.is_none()
    }

    /// The same with something that moves within the camera.
    pub fn with_moving(self, moving: Arc<MovingPart>) -> CameraMotion {
        CameraMotion { moving: Some(moving), ..self }
    }

    /// What moves within the camera, if anything does.
    pub fn moving(&self) -> Option<&MovingPart> {
        self.moving.as_deref()
    }
}

/// Rotation and place of a camera; scale has no meaning.
fn parts(place: &Affine3A) -> (Quat, Vec3) {
    let (_, rotation, translation) = place.to_scale_rotation_translation();
    // Scaled to nothing it has no direction: it looks the way the world does.
    (if rotation.is_finite() { rotation } else { Quat::IDENTITY }, translation)
}

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
    /// Of a root mean square angular speed (deg/s) of pitch and of yaw.
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

/// A stop on a camera's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Scene time, s.
    pub time_s: f64,
    /// World from camera.
    pub place: Affine3A,
}

/// Where a camera on a path (at least one stop, times rising) is: straight between stops, turning evenly; before the first and
/// after the last it stands.
pub fn on_path(stops: &[Stop], time_s: f64) -> Affine3A {
    let next = stops.partition_point(|s| s.time_s <= time_s);
    if next == 0 || next == stops.len() {
        return stops[next.saturating_sub(1)].place;
    }
    let (a, b) = (&stops[next - 1], &stops[next]);
    let f = ((time_s - a.time_s) / (b.time_s - a.time_s)) as f32;
    let ((qa, pa), (qb, pb)) = (parts(&a.place), parts(&b.place));
    Affine3A::from_rotation_translation(qa.slerp(qb, f), pa.lerp(pb, f))
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
    fn a_sampled_way_stays_close_to_the_true_one() {
        let shake = Shake::new(1.0, 3);
        for span in [1e-3, 0.1, 5.0] {
            let way = CameraMotion::sampled(span, |t| shake.turn(t));
            for i in 0..1000 {
                let t = span * (f64::from(i) + 0.7) / 1000.0;
                let angle = |m: Affine3A| m.transform_vector3(Vec3::NEG_Z);
                assert!((angle(way.at(t)) - angle(shake.turn(t))).length() < 3e-5);
            }
        }
        assert!(CameraMotion::sampled(1.0, |_| Affine3A::IDENTITY).is_still());
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

    #[test]
    fn a_path_is_straight_between_its_stops() {
        let stop = |time_s, x| Stop { time_s, place: Affine3A::from_translation(Vec3::X * x) };
        let stops = [stop(1.0, 0.0), stop(3.0, 4.0)];
        for (t, x) in [(0.0, 0.0), (1.5, 1.0), (3.0, 4.0), (9.0, 4.0)] {
            assert_eq!(on_path(&stops, t).translation.x, x);
        }
    }
}

//! The path of a rig: a smooth curve through key places, with its derivatives in closed form.
//!
//! Positions are cubic splines with continuous second derivatives. Orientations are the same of the four numbers of the quaternion, made a unit again: with p the splined one, the
//! rotation is p / |p|, the angular rate in the axes of the rig is ω = 2 Im(p̄ ṗ) / |p|² (the change of |p| is real and falls out), and the angular acceleration
//! ω̇ = 2 Im(p̄ p̈) / |p|² − 2 ω (p · ṗ) / |p|². So an inertial sensor on the rig has truth without any differencing. Splines: de Boor 1978, ch. IV; quaternion kinematics: Solà 2017
//! (arXiv:1711.02508), eq. 200.

use crate::shake::Shake;
use glam::{Affine3A, DAffine3, DQuat, DVec3, DVec4};

/// What is true of a rig, or of something fixed to it, at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// World from rig, m.
    pub place: DAffine3,
    /// In the world, m/s.
    pub velocity: DVec3,
    /// In the world, m/s².
    pub acceleration: DVec3,
    /// In the axes of the rig, rad/s.
    pub angular_rate: DVec3,
    /// In the axes of the rig, rad/s².
    pub angular_acceleration: DVec3,
}

impl MotionState {
    /// The same for something fixed to the rig (rig from it): its own place, velocity and axes.
    pub fn carried(&self, rig_from_part: &DAffine3) -> MotionState {
        let (r, turn) = (rig_from_part.translation, rig_from_part.matrix3);
        let (w, a) = (self.angular_rate, self.angular_acceleration);
        let world = self.place.matrix3;
        let back = turn.transpose();
        MotionState {
            place: self.place * *rig_from_part,
            velocity: self.velocity + world * w.cross(r),
            acceleration: self.acceleration + world * (a.cross(r) + w.cross(w.cross(r))),
            angular_rate: back * w,
            angular_acceleration: back * a,
        }
    }
}

/// What a rig does before its first key and after its last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ends {
    /// It stands: it starts and stops with no speed.
    #[default]
    Rest,
    /// The curve begins and ends with whatever speed suits it (no acceleration); outside there is no way.
    Free,
}

/// A cubic spline through points of several numbers.
#[derive(Clone, Debug, PartialEq)]
struct Spline {
    times: Vec<f64>,
    values: Vec<DVec4>,
    /// Second derivatives at the keys.
    bends: Vec<DVec4>,
}

impl Spline {
    fn new(times: &[f64], values: &[DVec4], ends: Ends) -> Self {
        let n = times.len();
        let (mut diagonal, mut right) = (vec![1.0; n], vec![DVec4::ZERO; n]);
        let (mut below, mut above) = (vec![0.0; n], vec![0.0; n]);
        let h = |i: usize| times[i + 1] - times[i];
        let slope = |i: usize| (values[i + 1] - values[i]) / h(i);
        for i in 1..n.saturating_sub(1) {
            (below[i], diagonal[i], above[i]) = (h(i - 1) / 6.0, (h(i - 1) + h(i)) / 3.0, h(i) / 6.0);
            right[i] = slope(i) - slope(i - 1);
        }
        if n > 1 && ends == Ends::Rest {
            (diagonal[0], above[0], right[0]) = (h(0) / 3.0, h(0) / 6.0, slope(0));
            (diagonal[n - 1], below[n - 1], right[n - 1]) = (h(n - 2) / 3.0, h(n - 2) / 6.0, -slope(n - 2));
        }
        // Thomas's elimination.
        for i in 1..n {
            let f = below[i] / diagonal[i - 1];
            diagonal[i] -= f * above[i - 1];
            let carried = right[i - 1] * f;
            right[i] -= carried;
        }
        let mut bends = vec![DVec4::ZERO; n];
        for i in (0..n).rev() {
            let next = if i + 1 < n { bends[i + 1] * above[i] } else { DVec4::ZERO };
            bends[i] = (right[i] - next) / diagonal[i];
        }
        Spline { times: times.to_vec(), values: values.to_vec(), bends }
    }

    /// Value, first and second derivative, within the keys.
    fn at(&self, t: f64) -> [DVec4; 3] {
        let last = self.times.len() - 1;
        if last == 0 {
            return [self.values[0], DVec4::ZERO, DVec4::ZERO];
        }
        let i = self.times.partition_point(|k| *k <= t).clamp(1, last) - 1;
        let h = self.times[i + 1] - self.times[i];
        let (a, b) = ((self.times[i + 1] - t) / h, (t - self.times[i]) / h);
        let ([va, vb], [ma, mb]) = ([self.values[i], self.values[i + 1]], [self.bends[i], self.bends[i + 1]]);
        let value = va * a + vb * b + (ma * (a * a * a - a) + mb * (b * b * b - b)) * (h * h / 6.0);
        let first = (vb - va) / h + (mb * (3.0 * b * b - 1.0) - ma * (3.0 * a * a - 1.0)) * (h / 6.0);
        [value, first, ma * a + mb * b]
    }
}

/// The path of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigPath {
    place: Spline,
    turn: Spline,
    ends: Ends,
    shake: Option<Shake>,
}

impl RigPath {
    /// Through places (world from rig) at times, s, that rise; one place alone: it stands there. Turns between neighbours are the shorter way round, less than 180°. `None`
    /// without keys, and where times do not rise.
    pub fn new(keys: &[(f64, DAffine3)], ends: Ends) -> Option<RigPath> {
        if keys.is_empty() || !keys.windows(2).all(|w| w[0].0 < w[1].0) {
            return None;
        }
        let times: Vec<f64> = keys.iter().map(|k| k.0).collect();
        let places: Vec<DVec4> = keys.iter().map(|k| k.1.translation.extend(0.0)).collect();
        let mut turns: Vec<DVec4> = Vec::new();
        for (_, place) in keys {
            let q = DVec4::from(DQuat::from_mat3(&place.matrix3).normalize());
            // Both signs are the same rotation: the one nearer to the last.
            let q = if turns.last().is_some_and(|l| l.dot(q) < 0.0) { -q } else { q };
            turns.push(q);
        }
        Some(RigPath { place: Spline::new(&times, &places, ends), turn: Spline::new(&times, &turns, ends), ends, shake: None })
    }

    /// The same in unsteady hands, which turn it about its own place at all times.
    pub fn shaken(self, shake: Shake) -> RigPath {
        RigPath { shake: Some(shake), ..self }
    }

    /// How it shakes.
    pub fn shake(&self) -> Option<&Shake> {
        self.shake.as_ref()
    }

    /// First and last time of its keys, s.
    pub fn span_s(&self) -> [f64; 2] {
        let t = &self.place.times;
        [t[0], t[t.len() - 1]]
    }

    /// Whether the pose is constant: one key and no shake.
    pub fn is_still(&self) -> bool {
        self.place.times.len() == 1 && self.shake.is_none()
    }

    /// Whether it is known at all times: it stands, or rests at its ends.
    pub fn is_endless(&self) -> bool {
        self.place.times.len() == 1 || self.ends == Ends::Rest
    }

    /// What is true at a moment, s. Outside its keys it stands, but for its shake.
    pub fn at(&self, time_s: f64) -> MotionState {
        let steady = self.steady(time_s);
        let Some(shake) = &self.shake else { return steady };
        // In the axes after the shake: ω = Rᵀω₀ + ω₁, and its derivative.
        let (turn, rate, acceleration) = shake.state(time_s);
        let carried = turn.conjugate() * steady.angular_rate;
        MotionState {
            place: steady.place * DAffine3::from_quat(turn),
            angular_rate: carried + rate,
            angular_acceleration: turn.conjugate() * steady.angular_acceleration + acceleration + carried.cross(rate),
            ..steady
        }
    }

    /// The same without its shake.
    fn steady(&self, time_s: f64) -> MotionState {
        let [first, last] = self.span_s();
        let outside = time_s < first || time_s > last;
        let t = time_s.clamp(first, last);
        let ([x, v, a], [p, dp, ddp]) = (self.place.at(t), self.turn.at(t));
        let q = DQuat::from_vec4(p).normalize();
        let imaginary =
            |derivative: DVec4| (DQuat::from_vec4(p).conjugate() * DQuat::from_vec4(derivative)).xyz() * 2.0 / p.dot(p);
        let rate = imaginary(dp);
        let angular_acceleration = imaginary(ddp) - rate * (2.0 * p.dot(dp) / p.dot(p));
        let moving = |v: DVec3| if outside { DVec3::ZERO } else { v };
        MotionState {
            place: DAffine3::from_rotation_translation(q, x.truncate()),
            velocity: moving(v.truncate()),
            acceleration: moving(a.truncate()),
            angular_rate: moving(rate),
            angular_acceleration: moving(angular_acceleration),
        }
    }
}

/// A camera on a rig that moves.
#[derive(Clone, Debug)]
pub struct Mounted {
    /// The path of the rig.
    pub path: std::sync::Arc<RigPath>,
    /// Rig from camera, m; axes of both: x right, y up, z backward.
    pub rig_from_camera: DAffine3,
}

impl Mounted {
    /// World from camera at a moment, s.
    pub fn place(&self, time_s: f64) -> DAffine3 {
        self.path.at(time_s).place * self.rig_from_camera
    }

    /// World from rig at a moment, s, in single precision as scenes have it.
    pub fn at(&self, time_s: f64) -> Affine3A {
        let place = self.place(time_s);
        let (_, rotation, translation) = place.to_scale_rotation_translation();
        Affine3A::from_rotation_translation(rotation.as_quat().normalize(), translation.as_vec3())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A path with turns about all axes.
    pub(in crate::rig) fn winding() -> RigPath {
        let key = |t: f64, x: [f64; 3], turn: [f64; 3]| {
            let q = DQuat::from_euler(glam::EulerRot::YXZ, turn[0], turn[1], turn[2]);
            (t, DAffine3::from_rotation_translation(q, DVec3::from(x)))
        };
        RigPath::new(
            &[
                key(0.0, [0.0, 1.0, 2.0], [0.0, 0.0, 0.0]),
                key(0.7, [0.5, 1.2, 1.5], [0.9, 0.2, -0.1]),
                key(1.5, [1.5, 0.9, 1.0], [2.0, -0.3, 0.2]),
                key(2.0, [1.6, 1.0, 0.0], [2.9, 0.1, 0.0]),
            ],
            Ends::Rest,
        )
        .unwrap()
    }

    #[test]
    fn derivatives_are_those_of_the_path() {
        for path in [winding(), winding().shaken(Shake::new(20.0, 2))] {
            derivatives_of(&path);
        }
    }

    fn derivatives_of(path: &RigPath) {
        let part = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.4), DVec3::new(0.1, -0.2, 0.3));
        let h = 1e-5;
        for k in 1..40 {
            let t = 0.05 * f64::from(k) + 0.003;
            let at = |t: f64| path.at(t).carried(&part);
            let (here, before, after) = (at(t), at(t - h), at(t + h));
            let v = (after.place.translation - before.place.translation) / (2.0 * h);
            let a = (after.velocity - before.velocity) / (2.0 * h);
            // Central differences: h² times the third derivative (some 100 m/s³), and rounding of 1e-16 / h.
            assert!((v - here.velocity).length() < 1e-7 && (a - here.acceleration).length() < 1e-5, "{t}");
            let step = before.place.matrix3.transpose() * after.place.matrix3;
            let w = DQuat::from_mat3(&step).to_scaled_axis() / (2.0 * h);
            let alpha = (after.angular_rate - before.angular_rate) / (2.0 * h);
            assert!((w - here.angular_rate).length() < 1e-6 && (alpha - here.angular_acceleration).length() < 1e-4, "{t}");
        }
    }

    #[test]
    fn it_goes_through_its_keys_smoothly_and_rests_at_its_ends() {
        let path = winding();
        for (t, x) in [(0.0, [0.0, 1.0, 2.0]), (0.7, [0.5, 1.2, 1.5]), (2.0, [1.6, 1.0, 0.0]), (9.0, [1.6, 1.0, 0.0])] {
            assert!((path.at(t).place.translation - DVec3::from(x)).length() < 1e-12);
        }
        for t in [0.0, 2.0, -1.0, 3.0] {
            assert!(path.at(t).velocity.length() < 1e-12 && path.at(t).angular_rate.length() < 1e-12, "{t}");
        }
        let (a, b) = (path.at(0.7 - 1e-9), path.at(0.7 + 1e-9));
        assert!(
            (a.acceleration - b.acceleration).length() < 1e-6
                && (a.angular_acceleration - b.angular_acceleration).length() < 1e-5
        );
        // Free ends of two keys: a straight line at an even speed.
        let key = |t, x| (t, DAffine3::from_translation(DVec3::X * x));
        let line = RigPath::new(&[key(0.0, 0.0), key(2.0, 3.0)], Ends::Free).unwrap();
        assert!(RigPath::new(&[], Ends::Free).is_none() && RigPath::new(&[key(1.0, 0.0), key(1.0, 3.0)], Ends::Free).is_none());
        assert!((line.at(0.5).velocity - DVec3::X * 1.5).length() < 1e-12 && line.at(0.5).acceleration.length() < 1e-12);
        assert!(!line.is_endless() && path.is_endless());
    }
}

//! Where the camera is while it gathers light: on a path, carried by the scene, in unsteady hands ([`crate::shake`]).

use crate::moving_part::MovingPart;
use glam::{Affine3A, Quat, Vec3};
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
            let motion = CameraMotion { keys, span_s, moving: None };
            let off = |i: u32| {
                // Not the middles: a shake may have its period there.
                let x = (f64::from(i) + 0.42) / f64::from(steps);
                let ((q, p), (q1, p1)) = (key(x), motion.parts_at(x * span_s));
                let angle = 2.0 * (q.conjugate() * q1).xyz().length();
                (angle / ANGLE).max((p - p1).length() / PLACE_M)
            };
            let worst = (0..steps).map(off).fold(0.0, f32::max);
            // A few steps see nothing of a quick motion: at least 64 are looked at.
            if (worst <= 1.0 && steps >= 64) || steps as usize >= MOST_STEPS || span_s <= 0.0 {
                let first = motion.keys[0];
                let still = motion.keys.iter().all(|k| *k == first);
                return if still { CameraMotion { keys: vec![first], span_s: 0.0, moving: None } } else { motion };
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
    use crate::shake::Shake;

    #[test]
    fn a_sampled_way_stays_close_to_the_true_one() {
        let shake = Shake::new(1.0, 3);
        for span in [1e-3, 0.1, 5.0] {
            let motion = CameraMotion::sampled(span, |t| shake.turn(t));
            for i in 0..1000 {
                let t = span * (f64::from(i) + 0.7) / 1000.0;
                let angle = |m: Affine3A| m.transform_vector3(Vec3::NEG_Z);
                assert!((angle(motion.at(t)) - angle(shake.turn(t))).length() < 3e-5);
            }
        }
        assert!(CameraMotion::sampled(1.0, |_| Affine3A::IDENTITY).is_still());
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

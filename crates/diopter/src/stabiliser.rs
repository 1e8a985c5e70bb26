//! Image stabilisers: a group of the lens, or the sensor, that moves across the axis against the shake of the camera while it is open.
//!
//! A gyroscope tells the angles of the camera's pitch and yaw; what slow drift would bring is taken out by a high-pass filter of one pole, and the servo of the moving part follows with a low-pass
//! filter of one pole: its position is that of the ideal one filtered by H(f) = (i f / drift) / (1 + i f / drift) · 1 / (1 + i f / servo). A shake is a sum of sines, so the answer is in closed
//! form. What is left is the shake filtered by 1 − H, and what the moved group does to the picture beside shifting it (it is traced where it stands). Roll and shifts of the camera are not answered, nor
//! is a path that the camera is moved on. One pole each is the simplest servo there is; real ones are faster near their corner and differ by make (La Rosa et al., "Optical Image Stabilization (OIS)",
//! STMicroelectronics, describe the loop).
//!
//! Surfaces of a group are traced where the group stands in the middle of each of up to [`MOST_LENSES`](crate::moving_part::MOST_LENSES) equal parts of the exposure; how much farther it moves within a part shifts the picture as a
//! whole (first order of a small step: less than a pixel).

use crate::camera::Camera;
use crate::moving_part::{MovingPart, StabiliserPart};
use crate::shake::Shake;
use diopter_lens::compound::tangents_by;
use diopter_lens::{Lens, LensError};
use glam::{DMat2, DVec2, DVec3};

/// Corner of the servo by default, Hz: chosen, so that a steady hand is held to about a tenth.
pub const SERVO_HZ: f64 = 100.0;
/// Corner frequency below which angles count as drift by default, Hz: chosen, below what hands do.
pub const DRIFT_HZ: f64 = 0.05;
/// Steps of the way of what moves in a second, and at least.
const STEPS_A_SECOND: f64 = 2000.0;
const LEAST_STEPS: usize = 64;
const MOST_STEPS: usize = 1 << 14;

/// A stabiliser as it is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stabiliser {
    /// What moves.
    pub part: StabiliserPart,
    /// Corner of the servo, Hz; infinite for one that follows at once.
    pub servo_hz: f64,
    /// Corner frequency, Hz: below it angles count as drift and are not answered; 0 where all are answered.
    pub drift_hz: f64,
    /// How far it moves from the axis at most, mm.
    pub travel_mm: f64,
}

/// Gain and phase of filters at a frequency, as a complex number.
fn response(stabiliser: &Stabiliser, f: f64) -> DVec2 {
    let divided = |a: DVec2, b: DVec2| DVec2::new(a.dot(b), b.perp_dot(a)) / b.length_squared();
    let drift = match stabiliser.drift_hz {
        d if d > 0.0 => divided(DVec2::new(0.0, f / d), DVec2::new(1.0, f / d)),
        _ => DVec2::X,
    };
    divided(drift, DVec2::new(1.0, f / stabiliser.servo_hz))
}

impl Stabiliser {
    /// The angles about x, y and z (pitch, yaw, roll; rad) of a shake at a time, s, as its gyroscope and servo pass them on; it moves against the first two.
    pub fn answered(&self, shake: &Shake, time_s: f64) -> DVec3 {
        DVec3::from_array(shake.filtered(time_s, |f| response(self, f)))
    }

    /// Motion of the stabilised part (a group of the lens, or the sensor) during an exposure of `span_s` seconds. `answered`: pitch and yaw (rad, about the camera's x and y) that it
    /// compensates, at a time (s) since the exposure began. Fails on groups that the lens does not have.
    pub fn during(&self, camera: &Camera, span_s: f64, answered: impl Fn(f64) -> DVec2) -> Result<MovingPart, LensError> {
        let (image, direction) = self.effect(&camera.lens)?;
        let back = direction.inverse();
        let steps = ((span_s * STEPS_A_SECOND) as usize).clamp(LEAST_STEPS, MOST_STEPS);
        let mut stopped = false;
        let path: Vec<DVec2> = (0..=steps)
            .map(|i| {
                let DVec2 { x: pitch, y: yaw } = answered(span_s * i as f64 / steps as f64);
                // The middle of the film must look where it did: to the right of a camera that has turned left, below one that has turned up.
                let at = back * DVec2::new(yaw.tan(), -pitch.tan());
                stopped |= at.length() > self.travel_mm;
                at.clamp_length_max(self.travel_mm)
            })
            .collect();
        let moving = MovingPart::new(self.part, span_s, path, image, stopped);
        if let (StabiliserPart::Group(group), Lens::Compound(lens)) = (self.part, &camera.lens) {
            let film = &camera.film;
            let pixel_mm = (film.width_mm / film.columns as f64).min(film.height_mm / film.rows as f64);
            return moving.traced(lens, group, pixel_mm);
        }
        Ok(moving)
    }

    /// How far the picture moves on the film, and how far the direction that the middle of the film sees moves (tangents), for a mm of what moves.
    fn effect(&self, lens: &Lens) -> Result<(DMat2, DMat2), LensError> {
        let (image, direction) = match (self.part, lens) {
            (StabiliserPart::Sensor, _) => (-DMat2::IDENTITY, tangents_by(lens.focus_distance(), |d| Ok(lens.chief_ray(d)))?),
            (StabiliserPart::Group(group), Lens::Compound(lens)) => lens.group_effect(group)?.into(),
            (StabiliserPart::Group(_), _) => {
                return Err(LensError::Setting {
                    what: "stabiliser",
                    found: "a group of a lens without surfaces".into(),
                    expected: "\"sensor\", or a real lens (--lens NAME)".into(),
                });
            }
        };
        match direction.determinant().abs() > 1e-12 {
            true => Ok((image, direction)),
            false => Err(LensError::Setting {
                what: "stabiliser",
                found: "a part that does not move the picture".into(),
                expected: "a sensor behind a lens, or a group with power".into(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Film;
    use crate::camera_motion::CameraMotion;
    use diopter_lens::compound::{CompoundLens, Setting};
    use diopter_lens::{Focus, Iris, ThinLens, embedded};
    use diopter_light::units::Millimeters;
    use glam::{Affine3A, Vec3};
    use std::f64::consts::TAU;
    use std::sync::Arc;

    fn stabiliser(part: StabiliserPart) -> Stabiliser {
        Stabiliser { part, servo_hz: f64::INFINITY, drift_hz: 0.0, travel_mm: f64::INFINITY }
    }

    /// Root mean square way of a far point over the picture, in pixels, at places of the picture (fractions from its middle).
    fn blur_px(camera: &Camera, place: DVec2, span_s: f64) -> f64 {
        let film = &camera.film;
        let at = DVec2::new((0.5 + place.x) * film.columns as f64, (0.5 + place.y) * film.rows as f64);
        let focal_px = camera.lens.focal_length().0 / film.width_mm * film.columns as f64;
        let n = 400;
        let times = (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n) * span_s);
        let seen: Vec<Vec3> =
            times.map(|t| camera.chief_ray(camera.film_point(at.x, at.y), t).unwrap().direction.normalize()).collect();
        let mean = seen.iter().sum::<Vec3>() / n as f32;
        let variance: f32 = seen.iter().map(|d| (*d - mean).length_squared()).sum::<f32>() / n as f32;
        f64::from(variance).sqrt() * focal_px
    }

    fn compound(name: &str, focal_length: Option<f64>) -> Lens {
        let setting = Setting { focal_length, f_number: Some(8.0), focus: Focus::Infinity, iris: None, film_mm: [22.3, 14.9] };
        Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()))
    }

    /// A camera that shakes for a quarter of a second, with a stabiliser or without.
    fn shaken(lens: Lens, stabiliser: Option<Stabiliser>) -> Camera {
        let span = 0.25;
        let shake = Shake::new(0.6, 5);
        // Roll is not answered: without it.
        let turn = |t: f64| {
            let [pitch, yaw, _] = shake.angles(t);
            Affine3A::from_quat(glam::Quat::from_euler(glam::EulerRot::YXZ, yaw as f32, pitch as f32, 0.0))
        };
        let mut camera = Camera { lens, film: Film::new(22.3, 14.9, 5184, 3456), motion: CameraMotion::sampled(span, turn) };
        if let Some(stabiliser) = stabiliser {
            let moving = stabiliser.during(&camera, span, |t| stabiliser.answered(&shake, t).truncate()).unwrap();
            camera.motion = camera.motion.with_moving(Arc::new(moving));
        }
        camera
    }

    #[test]
    fn a_moving_group_and_a_moving_sensor_hold_the_picture_still() {
        for (lens, part) in [
            (compound("kit-zoom-18-55mm", Some(53.0)), StabiliserPart::Group([14, 16])),
            (compound("kit-zoom-18-55mm", Some(53.0)), StabiliserPart::Sensor),
            (Lens::Thin(ThinLens::new(Millimeters(50.0), 8.0, Iris::Round, Focus::Infinity).unwrap()), StabiliserPart::Sensor),
        ] {
            let free = blur_px(&shaken(lens.clone(), None), DVec2::ZERO, 0.25);
            let camera = shaken(lens.clone(), Some(stabiliser(part)));
            let held = blur_px(&camera, DVec2::ZERO, 0.25);
            let corner = blur_px(&camera, DVec2::new(0.4, 0.4), 0.25);
            println!("{part:?}: {free:.2} px free, {held:.3} held, {corner:.3} near the corner");
            // Farther out a turn is not a shift: by the square of the field, and by what the group does to the picture.
            assert!(free > 8.0 && held < 0.01 * free && corner < 0.2 * free, "{part:?} {free} {held} {corner}");
        }
    }

    #[test]
    fn what_is_left_is_what_the_filters_leave() {
        let shake = Shake::new(0.6, 5);
        let slow = Stabiliser { servo_hz: 20.0, drift_hz: 0.1, ..stabiliser(StabiliserPart::Sensor) };
        // Against filters that step through time: a high pass of one pole, then a low pass.
        let dt = 1e-4;
        let mut time_s = -20.0;
        let ([mut low, mut servo], mut error, mut size) = ([0.0f64; 2], 0.0f64, 0.0f64);
        while time_s < 5.0 {
            let angle = shake.angles(time_s)[1];
            low += (angle - low) * (1.0 - (-dt * TAU * slow.drift_hz).exp());
            servo += (angle - low - servo) * (1.0 - (-dt * TAU * slow.servo_hz).exp());
            if time_s > 0.0 {
                error = error.max((slow.answered(&shake, time_s).y - servo).abs());
                size = size.max(servo.abs());
            }
            time_s += dt;
        }
        // Half a step of the discrete filter, and what is left of its start.
        assert!(error < 5e-3 * size, "{error} of {size}");
    }

    #[test]
    fn it_goes_no_farther_than_its_travel() {
        let short = Stabiliser { travel_mm: 0.05, ..stabiliser(StabiliserPart::Sensor) };
        let camera = shaken(compound("kit-zoom-18-55mm", Some(53.0)), Some(short));
        let moving = camera.motion.moving().unwrap();
        assert!(moving.stopped() && moving.farthest_mm() < 0.0501);
        let states = moving.states(moving.moments(10), [22.3, 14.9], [5184, 3456]);
        assert_eq!(states.len(), 11);
        // The sensor moves to the right: what it shows moves to the right, too, for the picture on it is mirrored.
        let s = states[5];
        assert!(
            (s.picture_px.x - s.at_mm.x / 22.3 * 5184.0).abs() < 1e-6
                && (s.picture_px.y + s.at_mm.y / 14.9 * 3456.0).abs() < 1e-6
        );
    }

    #[test]
    fn lenses_without_groups_are_refused() {
        let thin = Lens::Thin(ThinLens::new(Millimeters(50.0), 8.0, Iris::Round, Focus::Infinity).unwrap());
        let camera = shaken(thin, None);
        let e = stabiliser(StabiliserPart::Group([0, 1])).during(&camera, 0.1, |_| DVec2::ZERO).unwrap_err();
        assert!(e.to_string().contains("sensor"), "{e}");
    }
}

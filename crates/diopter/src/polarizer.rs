//! Polarisation as the camera sees it: a filter before the lens, and the frames in which light is told.
//!
//! Angles are those of the photographer behind the camera: 0 is horizontal in the picture, positive is counter-clockwise. The filter is a sheet perpendicular to the camera's
//! axis in front of the lens, so that oblique rays see its axis foreshortened: it absorbs the field along the projection of its absorbing axis, and passes
//! what is perpendicular to that and to the ray (J. Korger, T. Kolb, P. Banzer et al. 2013, "The polarization properties of a tilted polarizer", Optics Express
//! 21(22)). What it reflects, and how its transmittance changes with the angle and the wavelength, is not followed. The lens behind it keeps the
//! polarisation: the field turns with the ray, by the smallest turn that brings it onto the axis.

use crate::camera::Camera;
use diopter_light::Ray;
use diopter_light::polarization::{Mueller, Stokes, a_from_b, linear_polarizer, retarder, turned};
use glam::{Mat3A, Vec3};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use std::fmt;
use std::str::FromStr;

/// Kinds of polarising filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PolarizerKind {
    /// A sheet polariser.
    Linear,
    /// A sheet polariser and a quarter-wave plate behind it, as photographers use it: it selects as the linear one does, and what it passes is circular, so that
    /// nothing within the camera depends on its angle.
    Circular,
}

/// A polarising filter before the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polarizer {
    /// Which kind.
    pub kind: PolarizerKind,
    /// Angle of its transmission axis, degrees; 0 horizontal, counter-clockwise seen from behind the camera.
    pub angle_deg: f64,
    /// Fraction of unpolarised light that it passes: 0.5 of an ideal one.
    pub transmittance: f64,
    /// Transmittance along its axis over that across it; infinite of an ideal one.
    pub extinction: f64,
}

impl Polarizer {
    /// An ideal linear one at an angle.
    pub fn linear(angle_deg: f64) -> Self {
        Polarizer { kind: PolarizerKind::Linear, angle_deg, transmittance: 0.5, extinction: f64::INFINITY }
    }

    /// Transmittance of light that is polarised along its axis, and across it.
    pub fn principal_transmittances(&self) -> [f64; 2] {
        // Half of their sum is what unpolarised light keeps.
        match self.extinction.is_finite() {
            true => [self.extinction, 1.0].map(|part| 2.0 * self.transmittance * part / (1.0 + self.extinction)),
            false => [2.0 * self.transmittance, 0.0],
        }
    }

    /// Its Mueller matrix in the frame of its transmission axis.
    fn matrix(&self) -> Mueller {
        let [along, across] = self.principal_transmittances();
        let linear = linear_polarizer(along as f32, across as f32);
        match self.kind {
            PolarizerKind::Linear => linear,
            PolarizerKind::Circular => turned(retarder(FRAC_PI_2), FRAC_PI_4) * linear,
        }
    }
}

/// Text that is no polariser.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{0}\" is not a polariser: expected KIND:ANGLE such as linear:30deg or circular:90deg; after it, if not ideal, the fraction of unpolarised light that it passes \
     (up to 0.5) and its extinction ratio (above 1), as in linear:0deg,0.42,1000"
)]
pub struct PolarizerError(String);

impl FromStr for Polarizer {
    type Err = PolarizerError;

    fn from_str(text: &str) -> Result<Self, PolarizerError> {
        let wrong = || PolarizerError(text.trim().to_owned());
        let mut parts = text.split(',').map(|p| p.trim().to_lowercase());
        let head = parts.next().unwrap_or_default();
        let (kind, angle) = head.split_once(':').unwrap_or((&head, "0"));
        let kind = match kind.trim() {
            "linear" => PolarizerKind::Linear,
            "circular" => PolarizerKind::Circular,
            _ => return Err(wrong()),
        };
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
        let angle = angle.trim();
        let angle_deg = number(angle.strip_suffix("deg").or_else(|| angle.strip_suffix('°')).unwrap_or(angle))?;
        let transmittance = parts.next().map_or(Ok(0.5), |p| number(&p))?;
        let extinction = match parts.next() {
            None => f64::INFINITY,
            Some(p) => number(p.strip_suffix(":1").unwrap_or(&p))?,
        };
        let polarizer = Polarizer { kind, angle_deg, transmittance, extinction };
        let fine = transmittance > 0.0 && transmittance <= 0.5 && extinction > 1.0 && parts.next().is_none();
        fine.then_some(polarizer).ok_or_else(wrong)
    }
}

impl fmt::Display for Polarizer {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let kind = match self.kind {
            PolarizerKind::Linear => "linear",
            PolarizerKind::Circular => "circular",
        };
        write!(f, "{kind}:{}deg", self.angle_deg)?;
        if self.transmittance != 0.5 || self.extinction.is_finite() {
            write!(f, ",{}", self.transmittance)?;
        }
        if self.extinction.is_finite() { write!(f, ",{}", self.extinction) } else { Ok(()) }
    }
}

impl<'de> Deserialize<'de> for Polarizer {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        String::deserialize(d)?.parse().map_err(serde::de::Error::custom)
    }
}

impl Serialize for Polarizer {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

/// What a camera's polariser does to the light of a ray: from the frame in which the light is asked for to that of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Analysis {
    /// x axis of the frame in which the light is asked for, world space.
    pub axis: Vec3,
    /// Behind the filter, in the frame of the picture (x to the right, U > 0 towards the upper right).
    matrix: Mueller,
}

impl Analysis {
    /// The analysis of a camera's ray into the scene.
    pub fn of(camera: &Camera, polarizer: Option<&Polarizer>, ray: &Ray) -> Self {
        let matrix = camera.motion.at(f64::from(ray.time_s)).matrix3;
        Analysis::along(ray.direction, matrix, polarizer)
    }

    fn along(direction: Vec3, camera: Mat3A, polarizer: Option<&Polarizer>) -> Self {
        let [right, up, back] = [camera.x_axis, camera.y_axis, camera.z_axis].map(Vec3::from);
        let k = -direction;
        let picture = turned_with(right, -back, direction);
        let Some(polarizer) = polarizer else { return Analysis { axis: picture, matrix: Mueller::IDENTITY } };
        let (sin, cos) = (polarizer.angle_deg.to_radians() as f32).sin_cos();
        let absorbing = up * cos - right * sin;
        // A ray in the plane of the sheet along its absorbing axis has no other.
        let axis = absorbing.cross(k).try_normalize().unwrap_or(picture);
        Analysis { axis, matrix: a_from_b(picture, axis, k) * polarizer.matrix() }
    }

    /// A Stokes vector as it goes on to the film.
    pub fn apply(&self, stokes: Stokes) -> Stokes {
        self.matrix * stokes
    }
}

/// A vector turned by the smallest turn that takes `from` to `to` (unit).
fn turned_with(v: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let (axis, cos) = (from.cross(to), from.dot(to));
    if cos < -0.999 {
        // Straight behind: any half turn.
        return v;
    }
    v + axis.cross(v) + axis.cross(axis.cross(v)) / (1.0 + cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec4;

    #[test]
    fn polarizers_are_read_and_written_alike() {
        for text in ["linear:30deg", "circular:-45deg", "linear:0deg,0.42", "linear:12.5deg,0.42,1000"] {
            assert_eq!(text.parse::<Polarizer>().unwrap().to_string(), text);
        }
        assert_eq!("linear".parse(), Ok(Polarizer::linear(0.0)));
        assert_eq!("Linear: 30".parse(), Ok(Polarizer::linear(30.0)));
        for text in ["", "polar:3", "linear:x", "linear:0,0.6", "linear:0,0.4,0.5", "linear:0,0.4,10,1", "linear:nan"] {
            let error = text.parse::<Polarizer>().unwrap_err().to_string();
            assert!(error.contains("linear:30deg"), "{error}");
        }
    }

    #[test]
    fn principal_transmittances_mean_what_unpolarised_light_keeps() {
        let p: Polarizer = "linear:0deg,0.4,1000".parse().unwrap();
        let [along, across] = p.principal_transmittances();
        assert!((along / across - 1000.0).abs() < 1e-6 && (0.5 * (along + across) - 0.4).abs() < 1e-12);
        assert_eq!(Polarizer::linear(0.0).principal_transmittances(), [1.0, 0.0]);
    }

    /// Behind the filter of a camera that looks along −z with +y up.
    fn seen(polarizer: &str, direction: Vec3, field: Vec3) -> Stokes {
        let polarizer: Polarizer = polarizer.parse().unwrap();
        let analysis = Analysis::along(direction, Mat3A::IDENTITY, Some(&polarizer));
        analysis.apply(a_from_b(analysis.axis, field, -direction) * Vec4::new(1.0, 1.0, 0.0, 0.0))
    }

    #[test]
    fn angles_are_counter_clockwise_from_the_horizontal() {
        let ahead = Vec3::NEG_Z;
        for (angle, field) in [(0, Vec3::X), (90, Vec3::Y), (45, Vec3::new(1.0, 1.0, 0.0)), (135, Vec3::new(-1.0, 1.0, 0.0))] {
            let stokes = seen(&format!("linear:{angle}deg"), ahead, field);
            assert!((stokes.x - 1.0).abs() < 1e-6, "{angle}: {stokes}");
            let expected = f64::from(2 * angle).to_radians();
            assert!(
                (stokes.y - expected.cos() as f32).abs() < 1e-6 && (stokes.z - expected.sin() as f32).abs() < 1e-6,
                "{angle}: {stokes}"
            );
            assert!(seen(&format!("linear:{}deg", angle + 90), ahead, field).x < 1e-6);
        }
        // A circular one selects alike; what it passes has no linear part.
        let stokes = seen("circular:45deg", ahead, Vec3::new(1.0, 1.0, 0.0));
        assert!((stokes.x - 1.0).abs() < 1e-6 && stokes.y.hypot(stokes.z) < 1e-6 && (stokes.w.abs() - 1.0).abs() < 1e-6);
        assert!(seen("circular:45deg", ahead, Vec3::new(1.0, -1.0, 0.0)).x < 1e-6);
    }

    #[test]
    fn oblique_rays_are_absorbed_along_the_projected_axis() {
        // To the upper right, the axis upright: what it absorbs is along the projection of the horizontal.
        let direction = Vec3::new(0.5, 0.4, -0.8).normalize();
        let absorbed = Vec3::X - direction * direction.x;
        assert!(seen("linear:90deg", direction, absorbed).x < 1e-6);
        assert!((seen("linear:90deg", direction, absorbed.cross(direction)).x - 1.0).abs() < 1e-5);
        // In the plane of axis and ray the field keeps its direction in the picture.
        let up = Vec3::new(0.0, 0.5, -1.0).normalize();
        let stokes = seen("linear:0deg", up, Vec3::X);
        assert!((stokes - Vec4::new(1.0, 1.0, 0.0, 0.0)).abs().max_element() < 1e-5, "{stokes}");
    }
}

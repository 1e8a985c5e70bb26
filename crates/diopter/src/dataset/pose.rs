//! Where the camera stands: on a sphere around a subject, or on a path.

use super::Setting;
use super::draw::{Draw, rounded};
use super::spec::PoseSection;
use crate::shot::ShotError;
use glam::DVec3;
use toml::Value;

/// A checked pose.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    look_at: DVec3,
    places: Option<u64>,
    aim_within: f64,
    on: On,
}

#[derive(Clone, Debug)]
enum On {
    /// Around `look_at`; the sine of the elevation, so that equal parts of it are equal areas (Archimedes).
    Sphere {
        distance: [f64; 2],
        sin_elevation: [f64; 2],
        azimuth_deg: [f64; 2],
    },
    Path(Vec<DVec3>),
}

/// Fractional part of the golden ratio: turns between neighbours of a spherical Fibonacci lattice (González 2010, "Measurement of Areas on a Sphere
/// Using Fibonacci and Latitude–Longitude Lattices").
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Key of the numbers of a pose.
const KEY: &str = "pose";

impl Pose {
    /// Settings that a pose gives.
    pub const SETTINGS: [&str; 2] = ["camera.look_from", "camera.look_at"];

    /// Checks a section; `place`: what it is called in errors. Fails without `path` or `distance` and with both, on angles beside a path, on ranges out of their limits
    /// or with the larger end first, and on lengths that are not finite.
    pub fn new(s: &PoseSection, place: &str) -> Result<Pose, ShotError> {
        let entry =
            |found: String, expected: &str| ShotError::Entry { place: place.to_owned(), found, expected: expected.to_owned() };
        let within = |what: &str, range: [f64; 2], limits: [f64; 2], expected: &str| {
            let good = range[0] <= range[1] && range[0] >= limits[0] && range[1] <= limits[1];
            if good { Ok(range) } else { Err(entry(format!("{what} = {range:?}"), expected)) }
        };
        let on = match (&s.path, s.distance) {
            (Some(_), Some(_)) => {
                return Err(entry("path and distance".into(), "one of them: a path, or a sphere of this radius"));
            }
            (None, None) => return Err(entry("neither path nor distance".into(), "such as distance = [1, 2] (m)")),
            (Some(corners), None) => {
                if s.elevation_deg.is_some() || s.azimuth_deg.is_some() {
                    return Err(entry(
                        "angles beside a path".into(),
                        "no elevation_deg and no azimuth_deg: the path says where the camera is",
                    ));
                }
                let corners: Vec<DVec3> = corners.iter().map(|c| DVec3::from(*c)).collect();
                if corners.is_empty() || !corners.iter().all(|c| c.is_finite()) {
                    return Err(entry(format!("a path of {} places", corners.len()), "one or more places, m"));
                }
                On::Path(corners)
            }
            (None, Some(distance)) => {
                let distance =
                    within("distance", distance, [f64::MIN_POSITIVE, 1e9], "two distances above 0, m, the smaller first")?;
                let elevation = s.elevation_deg.unwrap_or([0.0, 90.0]);
                let elevation =
                    within("elevation_deg", elevation, [-90.0, 90.0], "two angles from -90 to 90, the smaller first")?;
                let azimuth_deg = s.azimuth_deg.unwrap_or([0.0, 360.0]);
                let azimuth_deg =
                    within("azimuth_deg", azimuth_deg, [-360.0, 360.0], "two angles from -360 to 360, the smaller first")?;
                On::Sphere { distance, sin_elevation: elevation.map(|e| e.to_radians().sin()), azimuth_deg }
            }
        };
        if s.places == Some(0) {
            return Err(entry("places = 0".into(), "1 or more"));
        }
        let aim_within = s.aim_within.unwrap_or(0.0);
        if !(aim_within >= 0.0 && aim_within.is_finite() && s.look_at.iter().all(|v| v.is_finite())) {
            return Err(entry(format!("aim_within = {aim_within}, look_at = {:?}", s.look_at), "finite lengths, m"));
        }
        Ok(Pose { look_at: s.look_at.into(), places: s.places, aim_within, on })
    }

    /// Place and aim of an item.
    pub fn draw(&self, draw: &Draw) -> Vec<Setting> {
        let u = |index: u64| draw.uniform(KEY, index);
        let between = |[a, b]: [f64; 2], t: f64| a + t * (b - a);
        let number = |n: u64| draw.item % n;
        let from = match &self.on {
            On::Sphere { distance, sin_elevation, azimuth_deg } => {
                let ring = sin_elevation[0] == sin_elevation[1];
                let (height, turn) = match self.places {
                    Some(n) if ring => (0.0, number(n) as f64 / n as f64),
                    Some(n) => ((number(n) as f64 + 0.5) / n as f64, (number(n) as f64 * GOLDEN).fract()),
                    None => (u(0), u(1)),
                };
                let sin = between(*sin_elevation, height);
                let cos = (1.0 - sin * sin).max(0.0).sqrt();
                let azimuth = between(*azimuth_deg, turn).to_radians();
                self.look_at + between(*distance, u(2)) * DVec3::new(cos * azimuth.sin(), sin, cos * azimuth.cos())
            }
            On::Path(corners) => {
                let t = match self.places {
                    Some(1) => 0.0,
                    Some(n) => number(n) as f64 / (n - 1) as f64,
                    None => u(0),
                };
                along(corners, t)
            }
        };
        // Evenly over a ball: directions by height and turn, the distance by the cube root.
        let aim = match self.aim_within > 0.0 {
            true => {
                let (z, turn) = (2.0 * u(3) - 1.0, std::f64::consts::TAU * u(4));
                let across = (1.0 - z * z).max(0.0).sqrt();
                self.aim_within * u(5).cbrt() * DVec3::new(across * turn.cos(), across * turn.sin(), z)
            }
            false => DVec3::ZERO,
        };
        let list = |v: DVec3| Value::Array(v.to_array().iter().map(|v| Value::Float(rounded(*v))).collect());
        Self::SETTINGS.iter().zip([from, self.look_at + aim]).map(|(name, v)| ((*name).to_owned(), list(v))).collect()
    }
}

/// The place at a fraction of the length of a path.
fn along(corners: &[DVec3], t: f64) -> DVec3 {
    let lengths = || corners.windows(2).map(|w| w[0].distance(w[1]));
    let mut left = t * lengths().sum::<f64>();
    for (w, length) in corners.windows(2).zip(lengths()) {
        if left <= length && length > 0.0 {
            return w[0].lerp(w[1], left / length);
        }
        left -= length;
    }
    corners[corners.len() - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(text: &str) -> Result<Pose, ShotError> {
        Pose::new(&toml::from_str(text).unwrap(), "here")
    }

    fn places(text: &str, items: u64) -> Vec<[DVec3; 2]> {
        let pose = pose(text).unwrap();
        let vector = |v: &Value| {
            let v: Vec<f64> = v.as_array().unwrap().iter().map(|v| v.as_float().unwrap()).collect();
            DVec3::new(v[0], v[1], v[2])
        };
        let of = |item| pose.draw(&Draw { seed: 1, item });
        (0..items).map(of).map(|s| [vector(&s[0].1), vector(&s[1].1)]).collect()
    }

    #[test]
    fn cameras_are_spread_over_a_sphere() {
        let all = places("look_at = [1, 0, 0]\ndistance = [2, 2]\nelevation_deg = [-90, 90]", 4000);
        let away: Vec<DVec3> = all.iter().map(|p| p[0] - p[1]).collect();
        // Nine digits are kept.
        assert!(away.iter().all(|d| (d.length() - 2.0).abs() < 1e-7));
        // Each coordinate of points on a sphere is evenly distributed: the mean of its square is a third of r². Standard deviation 4 · 0.3 / √4000.
        for axis in 0..3 {
            let (mean, square) = away.iter().fold((0.0, 0.0), |s, d| (s.0 + d[axis] / 4000.0, s.1 + d[axis].powi(2) / 4000.0));
            assert!(mean.abs() < 0.1 && (square - 4.0 / 3.0).abs() < 0.1, "{axis}: {mean} {square}");
        }
    }

    #[test]
    fn a_ring_begins_in_front_and_goes_to_the_right() {
        let ring = places("distance = [1, 1]\nelevation_deg = [0, 0]\nplaces = 4", 5);
        for (place, expected) in ring.iter().zip([DVec3::Z, DVec3::X, DVec3::NEG_Z, DVec3::NEG_X, DVec3::Z]) {
            assert!(place[0].distance(expected) < 1e-8 && place[1] == DVec3::ZERO, "{place:?}");
        }
    }

    #[test]
    fn a_path_is_followed_by_its_length() {
        let text = "path = [[0, 0, 0], [1, 0, 0], [1, 3, 0]]\nplaces = 5\nlook_at = [0, 0, 9]\naim_within = 0.1";
        let all = places(text, 5);
        for (place, expected) in all.iter().zip([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0]]) {
            assert!(place[0].distance(DVec3::new(expected[0], expected[1], 0.0)) < 1e-8, "{place:?}");
            assert!(place[1].distance(DVec3::new(0.0, 0.0, 9.0)) <= 0.1 + 1e-7);
        }
        assert!(all[0][1] != all[1][1]);
    }

    #[test]
    fn what_makes_no_pose_is_told() {
        for (text, said) in [
            ("", "neither path nor distance"),
            ("distance = [2, 1]", "the smaller first"),
            ("distance = [1, 1]\nelevation_deg = [0, 100]", "-90 to 90"),
            ("path = []", "one or more places"),
            ("path = [[0, 0, 0]]\nazimuth_deg = [0, 1]", "beside a path"),
            ("distance = [1, 1]\nplaces = 0", "1 or more"),
        ] {
            let told = pose(text).unwrap_err().to_string();
            assert!(told.starts_with("here: ") && told.contains(said), "{text}: {told}");
        }
    }
}

//! Camera models: closed formulas from a direction to a place in the picture and back, as calibration programs write them.
//!
//! Directions are in the camera axes of OpenCV: x to the right, y down, z forward. Pictures are in pixels with the centre of the upper left pixel at
//! (0, 0), as OpenCV has it (COLMAP and nerfstudio put it at (0.5, 0.5); `docs/calibration.md` has the table). A model has focal lengths fx, fy, a principal point cx, cy and
//! coefficients; it maps a direction to a normalized point (x', y') and this to (fx x' + cx, fy y' + cy).
//!
//! | model | normalized point | source |
//! |---|---|---|
//! | pinhole, OpenCV 4 to 14 | rational radial, tangential, thin prism, tilted sensor | OpenCV 4, `calib3d` module text; Brown 1966; tilt: Louhichi et al. 2007 |
//! | simple radial, radial | 1 + k1 r² + k2 r⁴ | COLMAP `SIMPLE_RADIAL`, `RADIAL` |
//! | fisheye | θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) | Kannala & Brandt 2006; OpenCV `fisheye` |
//! | thin prism fisheye | of the equidistant point: radial, tangential, thin prism | COLMAP `THIN_PRISM_FISHEYE`; Weng et al. 1992 |
//! | f-theta | θ (1 + k1 θ + k2 θ² + k3 θ³ + k4 θ⁴) | polynomial of the angle, as NVIDIA's f-theta cameras |
//! | double sphere | (x, y) / (α d₂ + (1 − α)(ξ d₁ + z)) | Usenko, Demmel & Cremers 2018, eq. 40–43 |
//! | division | undistorted radius r = r_d / (1 + λ r_d²) | Fitzgibbon 2001 |
//! | equidistant, equisolid, stereographic, orthographic | θ, 2 sin(θ/2), 2 tan(θ/2), sin θ | Miyamoto 1964; ISO 8600-3 names |

use crate::LensError;
use crate::dual::{Dual, Number};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

/// Which formula.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModelKind {
    /// Straight lines stay straight.
    Pinhole,
    /// One radial coefficient, equal focal lengths (COLMAP).
    SimpleRadial,
    /// Two radial coefficients, equal focal lengths (COLMAP).
    Radial,
    /// k1, k2, p1, p2.
    OpenCv4,
    /// k1, k2, p1, p2, k3.
    OpenCv5,
    /// The same and k4, k5, k6 in the denominator.
    OpenCv8,
    /// The same and the thin prism s1 to s4.
    OpenCv12,
    /// The same and the tilt of the sensor τx, τy.
    OpenCv14,
    /// Kannala and Brandt, four coefficients.
    Fisheye,
    /// COLMAP's fisheye with tangential and thin prism terms.
    ThinPrismFisheye,
    /// Polynomial of the angle.
    FTheta,
    /// Double sphere.
    DoubleSphere,
    /// Division.
    Division,
    /// Radius as the angle.
    Equidistant,
    /// Area as the solid angle.
    Equisolid,
    /// Circles stay circles.
    Stereographic,
    /// Radius as the sine of the angle.
    Orthographic,
}

/// Names of coefficients in the order of OpenCV.
const OPENCV: [&str; 14] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy"];
/// Most coefficients of a model.
const MOST: usize = OPENCV.len();
const K: [&str; 4] = ["k1", "k2", "k3", "k4"];

impl ModelKind {
    /// All of them with their names.
    pub const NAMES: [(&'static str, ModelKind); 17] = [
        ("pinhole", ModelKind::Pinhole),
        ("simple-radial", ModelKind::SimpleRadial),
        ("radial", ModelKind::Radial),
        ("opencv4", ModelKind::OpenCv4),
        ("opencv5", ModelKind::OpenCv5),
        ("opencv8", ModelKind::OpenCv8),
        ("opencv12", ModelKind::OpenCv12),
        ("opencv14", ModelKind::OpenCv14),
        ("opencv-fisheye", ModelKind::Fisheye),
        ("thin-prism-fisheye", ModelKind::ThinPrismFisheye),
        ("f-theta", ModelKind::FTheta),
        ("double-sphere", ModelKind::DoubleSphere),
        ("division", ModelKind::Division),
        ("equidistant", ModelKind::Equidistant),
        ("equisolid", ModelKind::Equisolid),
        ("stereographic", ModelKind::Stereographic),
        ("orthographic", ModelKind::Orthographic),
    ];

    /// The model of a name; `opencv` is that of five coefficients.
    pub fn named(name: &str) -> Option<ModelKind> {
        let name = if name == "opencv" { "opencv5" } else { name };
        Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// Names of its coefficients, in order.
    pub fn coefficients(self) -> &'static [&'static str] {
        match self {
            ModelKind::SimpleRadial => &OPENCV[..1],
            ModelKind::Radial => &OPENCV[..2],
            ModelKind::OpenCv4 => &OPENCV[..4],
            ModelKind::OpenCv5 => &OPENCV[..5],
            ModelKind::OpenCv8 => &OPENCV[..8],
            ModelKind::OpenCv12 => &OPENCV[..12],
            ModelKind::OpenCv14 => &OPENCV,
            ModelKind::Fisheye | ModelKind::FTheta => &K,
            ModelKind::ThinPrismFisheye => &["k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
            ModelKind::DoubleSphere => &["xi", "alpha"],
            ModelKind::Division => &["lambda"],
            _ => &[],
        }
    }

    /// Whether it divides by z, so that it ends before 90°.
    pub fn is_perspective(self) -> bool {
        matches!(
            self,
            ModelKind::Pinhole
                | ModelKind::SimpleRadial
                | ModelKind::Radial
                | ModelKind::OpenCv4
                | ModelKind::OpenCv5
                | ModelKind::OpenCv8
                | ModelKind::OpenCv12
                | ModelKind::OpenCv14
                | ModelKind::Division
        )
    }

    /// Numbers of the coefficients that break the symmetry about the axis.
    fn asymmetric(self) -> &'static [usize] {
        match self {
            ModelKind::OpenCv4 | ModelKind::OpenCv5 | ModelKind::OpenCv8 => &[2, 3],
            ModelKind::OpenCv12 => &[2, 3, 8, 9, 10, 11],
            ModelKind::OpenCv14 => &[2, 3, 8, 9, 10, 11, 12, 13],
            ModelKind::ThinPrismFisheye => &[2, 3, 6, 7],
            _ => &[],
        }
    }

    /// The normalized point of a direction (any length), wherever the formula has a value: what fits work with. Outside the range of the
    /// model it is a number without meaning, or none.
    pub fn normalized<T: Number>(self, k: &[T], [x, y, z]: [T; 3]) -> [T; 2] {
        let one = T::constant(1.0);
        let length = || (x * x + y * y + z * z).sqrt();
        match self {
            ModelKind::Pinhole => [x / z, y / z],
            ModelKind::SimpleRadial => brown(&[k[0]], x / z, y / z),
            ModelKind::Radial => brown(&[k[0], k[1]], x / z, y / z),
            ModelKind::OpenCv4 | ModelKind::OpenCv5 | ModelKind::OpenCv8 | ModelKind::OpenCv12 | ModelKind::OpenCv14 => {
                brown(k, x / z, y / z)
            }
            ModelKind::Division => {
                let (x, y) = (x / z, y / z);
                // r_d of λ r r_d² − r_d + r = 0, the root that is r for λ = 0.
                let factor = T::constant(2.0) / (one + (one - T::constant(4.0) * k[0] * (x * x + y * y)).sqrt());
                [x * factor, y * factor]
            }
            ModelKind::Fisheye => {
                let (per_radius, angle2) = angle([x, y, z]);
                let factor = per_radius * (one + angle2 * (k[0] + angle2 * (k[1] + angle2 * (k[2] + angle2 * k[3]))));
                [x * factor, y * factor]
            }
            ModelKind::FTheta => {
                let (per_radius, angle2) = angle([x, y, z]);
                let t = angle2.sqrt();
                let factor = per_radius * (one + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
                [x * factor, y * factor]
            }
            ModelKind::ThinPrismFisheye => {
                let (per_radius, _) = angle([x, y, z]);
                let (u, v) = (x * per_radius, y * per_radius);
                let (uu, uv, vv) = (u * u, u * v, v * v);
                let r2 = uu + vv;
                let radial = one + r2 * (k[0] + r2 * (k[1] + r2 * (k[4] + r2 * k[5])));
                let two = T::constant(2.0);
                [
                    u * radial + two * k[2] * uv + k[3] * (r2 + two * uu) + k[6] * r2,
                    v * radial + two * k[3] * uv + k[2] * (r2 + two * vv) + k[7] * r2,
                ]
            }
            ModelKind::DoubleSphere => {
                let (xi, alpha) = (k[0], k[1]);
                let d1 = length();
                let shifted = xi * d1 + z;
                let d2 = (x * x + y * y + shifted * shifted).sqrt();
                let divisor = alpha * d2 + (one - alpha) * shifted;
                [x / divisor, y / divisor]
            }
            ModelKind::Equidistant => {
                let (per_radius, _) = angle([x, y, z]);
                [x * per_radius, y * per_radius]
            }
            ModelKind::Equisolid => {
                let d = length();
                let factor = T::constant(SQRT_2) / (d * (d + z)).sqrt();
                [x * factor, y * factor]
            }
            ModelKind::Stereographic => {
                let factor = T::constant(2.0) / (length() + z);
                [x * factor, y * factor]
            }
            ModelKind::Orthographic => {
                let d = length();
                [x / d, y / d]
            }
        }
    }
}

/// Angle to the axis over the radius √(x² + y²), and the angle squared.
fn angle<T: Number>([x, y, z]: [T; 3]) -> (T, T) {
    let r2 = x * x + y * y;
    if z.value() > 0.0 && r2.value() < 1e-6 * z.value() * z.value() {
        // atan(q) / q = 1 − q²/3 + q⁴/5 − q⁶/7, below 1e-24 here; its derivatives exist on the axis.
        let q2 = r2 / (z * z);
        let c = |v: f64| T::constant(v);
        let per_radius = (c(1.0) - q2 * (c(1.0 / 3.0) - q2 * (c(0.2) - q2 * c(1.0 / 7.0)))) / z;
        return (per_radius, per_radius * per_radius * r2);
    }
    let r = r2.sqrt();
    let angle = r.atan2(z);
    (angle / r, angle * angle)
}

/// OpenCV's distortion with as many coefficients as there are.
fn brown<T: Number>(k: &[T], x: T, y: T) -> [T; 2] {
    let zero = T::constant(0.0);
    let one = T::constant(1.0);
    let two = T::constant(2.0);
    let at = |i: usize| k.get(i).copied().unwrap_or(zero);
    let r2 = x * x + y * y;
    let radial = one + r2 * (at(0) + r2 * (at(1) + r2 * at(4)));
    let radial = if k.len() > 5 { radial / (one + r2 * (at(5) + r2 * (at(6) + r2 * at(7)))) } else { radial };
    let (mut u, mut v) = (x * radial, y * radial);
    if k.len() > 2 {
        u = u + two * at(2) * x * y + at(3) * (r2 + two * x * x);
        v = v + at(2) * (r2 + two * y * y) + two * at(3) * x * y;
    }
    if k.len() > 8 {
        u = u + r2 * (at(8) + r2 * at(9));
        v = v + r2 * (at(10) + r2 * at(11));
    }
    if k.len() > 12 {
        let ([row0, row1, row2], [r13, r23, r33]) = tilt(at(12), at(13));
        let dot = |row: [T; 3]| row[0] * u + row[1] * v + row[2];
        let (a, b, c) = (dot(row0), dot(row1), dot(row2));
        return [(r33 * a - r13 * c) / c, (r33 * b - r23 * c) / c];
    }
    [u, v]
}

/// Coefficients that depend on nothing.
fn constants<const N: usize>(coefficients: &[f64]) -> [Dual<N>; MOST] {
    std::array::from_fn(|i| Dual::constant(coefficients.get(i).copied().unwrap_or(0.0)))
}

/// Rows of R(τx, τy), and its third column: the tilt projects along the axis onto a plane turned by R.
fn tilt<T: Number>(tau_x: T, tau_y: T) -> ([[T; 3]; 3], [T; 3]) {
    let (cx, sx, cy, sy) = (tau_x.cos(), tau_x.sin(), tau_y.cos(), tau_y.sin());
    let zero = T::constant(0.0);
    let rows = [[cy, sy * sx, -(sy * cx)], [zero, cx, sx], [sy, -(cy * sx), cy * cx]];
    (rows, [rows[0][2], rows[1][2], rows[2][2]])
}

/// A model with its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraModel {
    kind: ModelKind,
    focal: DVec2,
    centre: DVec2,
    coefficients: Vec<f64>,
    /// The same without what breaks the symmetry.
    radial: Vec<f64>,
    largest_angle: f64,
    largest_radius: f64,
}

/// Angles at which a model is looked at for its range.
const STEPS: usize = 4096;
/// Perspective models end here, rad: tangents beyond have no use.
const PERSPECTIVE_END: f64 = FRAC_PI_2 * (1.0 - 1e-3);
/// All others here.
const END: f64 = PI * (1.0 - 1e-3);

impl CameraModel {
    /// Focal lengths and principal point in pixels. Fails on another number of coefficients than the kind has, numbers that are not finite, focal lengths that are not
    /// positive, and formulas that have no range.
    pub fn new(kind: ModelKind, focal: DVec2, centre: DVec2, coefficients: Vec<f64>) -> Result<CameraModel, LensError> {
        let wrong = |found: String, expected: String| Err(LensError::Setting { what: "camera model", found, expected });
        let names = kind.coefficients();
        if coefficients.len() != names.len() {
            return wrong(
                format!("{} with {} coefficients", kind.name(), coefficients.len()),
                format!(
                    "{} of them{}",
                    names.len(),
                    if names.is_empty() { String::new() } else { format!(": {}", names.join(", ")) }
                ),
            );
        }
        if !(focal.is_finite() && focal.min_element() > 0.0) {
            return wrong(format!("focal lengths {}, {}", focal.x, focal.y), "two positive numbers of pixels".into());
        }
        if !centre.is_finite() || coefficients.iter().any(|c| !c.is_finite()) {
            return wrong(format!("{} {centre} {coefficients:?}", kind.name()), "finite numbers".into());
        }
        let mut radial = coefficients.clone();
        kind.asymmetric().iter().for_each(|i| radial[*i] = 0.0);
        let mut model = CameraModel { kind, focal, centre, coefficients, radial, largest_angle: 0.0, largest_radius: 0.0 };
        model.largest_angle = model.range();
        if !(model.largest_angle > 1e-3) {
            return wrong(
                format!("{} {:?}", kind.name(), model.coefficients),
                "coefficients with which the radius grows with the angle".into(),
            );
        }
        model.largest_radius = model.radius(model.largest_angle).0;
        Ok(model)
    }

    /// Which formula.
    pub fn kind(&self) -> ModelKind {
        self.kind
    }

    /// fx and fy, pixels.
    pub fn focal(&self) -> DVec2 {
        self.focal
    }

    /// cx and cy, pixels; the centre of the upper left pixel is (0, 0).
    pub fn centre(&self) -> DVec2 {
        self.centre
    }

    /// In the order of [`ModelKind::coefficients`].
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Largest angle to the axis up to which the radius grows with the angle, rad: beyond, the model has no meaning.
    pub fn largest_angle(&self) -> f64 {
        self.largest_angle
    }

    /// The same camera with a picture of other pixels: `scale` new ones in an old one, along each axis.
    pub fn scaled(&self, scale: DVec2) -> CameraModel {
        let half = DVec2::splat(0.5);
        CameraModel { focal: self.focal * scale, centre: (self.centre + half) * scale - half, ..self.clone() }
    }

    /// Place in the picture of a direction of any length; `None` beyond the range.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let off_axis = direction.truncate().length().atan2(direction.z);
        if !(off_axis <= self.largest_angle) || direction == DVec3::ZERO {
            return None;
        }
        let [x, y] = self.kind.normalized(&self.coefficients, direction.to_array());
        let at = DVec2::new(x, y) * self.focal + self.centre;
        at.is_finite().then_some(at)
    }

    /// Unit direction that is seen at a place in the picture; `None` where none within the range is.
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let seen = (pixel - self.centre) / self.focal;
        let mut wanted = seen;
        if self.kind == ModelKind::OpenCv14 {
            wanted = self.without_tilt(seen)?;
        }
        let radius = wanted.length();
        let symmetric = self.coefficients == self.radial;
        if !(radius <= self.largest_radius) && symmetric {
            return None;
        }
        let angle = self.angle(radius.min(self.largest_radius));
        if symmetric {
            let across = wanted.normalize_or_zero() * angle.sin();
            return Some(across.extend(angle.cos()));
        }
        self.newton(seen, wanted.normalize_or_zero() * angle)
    }

    /// The direction by Newton's method from angles (x, y) to the axis near it.
    fn newton(&self, seen: DVec2, mut angles: DVec2) -> Option<DVec3> {
        let k = constants::<2>(&self.coefficients);
        let k = &k[..self.coefficients.len()];
        let mut off = f64::INFINITY;
        for _ in 0..30 {
            let (a, b) = (Dual::<2>::variable(angles.x, 0), Dual::variable(angles.y, 1));
            let theta2 = a * a + b * b;
            let theta = theta2.sqrt();
            // sin θ / θ, by its series near 0.
            let (sinc, cos) = match theta2.value() < 1e-6 {
                true => {
                    let c = |v: f64| Dual::constant(v);
                    let sinc = c(1.0) - theta2 * (c(1.0 / 6.0) - theta2 * c(1.0 / 120.0));
                    (sinc, c(1.0) - theta2 * (c(0.5) - theta2 * (c(1.0 / 24.0) - theta2 * c(1.0 / 720.0))))
                }
                false => (theta.sin() / theta, theta.cos()),
            };
            let [u, v] = self.kind.normalized(k, [a * sinc, b * sinc, cos]);
            let error = DVec2::new(u.value - seen.x, v.value - seen.y);
            off = error.length();
            if !(off > 1e-15 * (1.0 + seen.length())) {
                break;
            }
            let [[a11, a12], [a21, a22]] = [u.derivatives, v.derivatives];
            let determinant = a11 * a22 - a12 * a21;
            let step = DVec2::new(a22 * error.x - a12 * error.y, a11 * error.y - a21 * error.x) / determinant;
            if !step.is_finite() {
                return None;
            }
            // Stay within the range: beyond it the formulas turn back.
            let most = 0.25 * self.largest_angle;
            angles -= step * (most / step.length()).min(1.0);
            let length = angles.length();
            if length > self.largest_angle {
                angles *= self.largest_angle / length;
            }
            if step.length() < 1e-15 {
                break;
            }
        }
        let theta = angles.length();
        let found = off < 1e-9 * (1.0 + seen.length());
        found.then(|| (angles.normalize_or_zero() * theta.sin()).extend(theta.cos()))
    }

    /// The normalized point before the tilt of the sensor.
    fn without_tilt(&self, seen: DVec2) -> Option<DVec2> {
        let (rows, [r13, r23, r33]) = tilt(self.coefficients[12], self.coefficients[13]);
        let turned = DMat3::from_cols_array_2d(&rows).transpose();
        let onto = DMat3::from_cols_array_2d(&[[r33, 0.0, 0.0], [0.0, r33, 0.0], [-r13, -r23, 1.0]]);
        let back = (onto * turned).inverse() * seen.extend(1.0);
        let at = back.truncate() / back.z;
        at.is_finite().then_some(at)
    }

    /// Radius of the normalized point at an angle, and its slope.
    fn radius(&self, angle: f64) -> (f64, f64) {
        let k = constants::<1>(&self.radial);
        let t = Dual::<1>::variable(angle, 0);
        let [x, _] = self.kind.normalized(&k[..self.radial.len()], [t.sin(), Dual::constant(0.0), t.cos()]);
        (x.value, x.derivatives[0])
    }

    /// The angle of a radius within the range.
    fn angle(&self, radius: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.largest_angle);
        // The radius is about the angle near the axis.
        let mut angle = if self.kind.is_perspective() { radius.atan() } else { radius }.clamp(low, high);
        for _ in 0..80 {
            let (value, slope) = self.radius(angle);
            let off = value - radius;
            if off == 0.0 || high - low < 1e-16 {
                break;
            }
            if off > 0.0 {
                high = angle
            } else {
                low = angle
            }
            let next = angle - off / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            // Rounding alone goes to and fro for ever.
            if (next - angle).abs() <= 1e-15 {
                break;
            }
            angle = next;
        }
        angle
    }

    /// The largest angle up to which the radius is finite and grows.
    fn range(&self) -> f64 {
        let end = if self.kind.is_perspective() { PERSPECTIVE_END } else { END };
        let end = if self.kind == ModelKind::Orthographic { FRAC_PI_2 } else { end };
        let mut before = 0.0;
        let grows = |angle: f64, before: f64| {
            let (value, slope) = self.radius(angle);
            (value.is_finite() && value > before && slope > 0.0).then_some(value)
        };
        for i in 1..=STEPS {
            let angle = end * i as f64 / STEPS as f64;
            if let Some(value) = grows(angle, before) {
                before = value;
                continue;
            }
            // The turn lies between.
            let (mut low, mut high) = (end * (i - 1) as f64 / STEPS as f64, angle);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                match grows(middle, before) {
                    Some(value) => (low, before) = (middle, value),
                    None => high = middle,
                }
            }
            return low;
        }
        end
    }
}

#[cfg(test)]
mod tests;

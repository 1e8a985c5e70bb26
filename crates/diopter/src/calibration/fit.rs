//! The camera model that says where a lens looks: least squares over the places of known directions.
//!
//! Minimised is the distance in the picture between the place that the model gives for a direction and the pixel that sees it, by Levenberg and Marquardt's method (Marquardt 1963; columns scaled as by Moré
//! 1978) with exact derivatives from dual numbers. The linear problems are solved by Householder's QR, which keeps the digits that normal equations lose. Models with many
//! coefficients start from the fit of those with fewer.

use super::observe::Observed;
use super::{CalibrationError, CameraModel, ModelKind, wrong};
use diopter_lens::dual::{Dual, Number};
use glam::{DVec2, DVec3};

/// A fitted model and how well it does.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The model.
    pub model: CameraModel,
    /// Root mean square of the distances in the picture, pixels.
    pub rms_px: f64,
    /// The largest of them, pixels.
    pub max_px: f64,
    /// Largest angle to the axis of what was fitted, rad.
    pub fitted_angle: f64,
    /// Largest angle to the axis that the picture sees, rad: more than fitted where a perspective model ends.
    pub seen_angle: f64,
    /// Points fitted, of those that see anything.
    pub fitted: [usize; 2],
    /// Columns and rows of the map.
    pub grid: [usize; 2],
    /// Model minus lens over the grid of the observations, pixels to the right and down; `None` where nothing was fitted.
    pub map: Vec<Option<DVec2>>,
}

/// Models that divide by z are fitted up to here, rad: beyond 80° the tangent grows by 6 % a degree, and they say nothing well.
const PERSPECTIVE_END: f64 = 80.0 * std::f64::consts::PI / 180.0;
/// Largest angle for which [`suitable`] takes OpenCV's pinhole model, rad.
const PINHOLE_END: f64 = 60.0 * std::f64::consts::PI / 180.0;
/// fx, fy, cx, cy and OpenCV's 14 coefficients.
const MOST: usize = 18;
/// Steps after which the best so far is taken.
const STEPS: usize = 400;

/// The model that most programs read and that holds up to the corners: OpenCV's with five coefficients, or its fisheye for wide pictures.
pub fn suitable(observed: &Observed) -> ModelKind {
    let seen = observed.points.iter().flatten().map(|p| off_axis(p.direction)).fold(0.0, f64::max);
    if seen < PINHOLE_END { ModelKind::OpenCv5 } else { ModelKind::Fisheye }
}

fn off_axis(direction: DVec3) -> f64 {
    direction.truncate().length().atan2(direction.z)
}

/// Fits a model. Fails where too few pixels see anything, and where no numbers of this model come near.
pub fn fit(kind: ModelKind, observed: &Observed) -> Result<Fit, CalibrationError> {
    let usable = |d: DVec3| !kind.is_perspective() || off_axis(d) < PERSPECTIVE_END;
    let seen: Vec<_> = observed.points.iter().flatten().collect();
    let points: Vec<(DVec2, DVec3)> = seen.iter().filter(|p| usable(p.direction)).map(|p| (p.pixel, p.direction)).collect();
    let parameters = 4 + kind.coefficients().len();
    if points.len() < 2 * parameters {
        let found =
            format!("{} of {} places that see anything the model {} can say", points.len(), observed.points.len(), kind.name());
        return Err(wrong("fit", found, format!("{} or more", 2 * parameters)));
    }
    let centre = DVec2::new(observed.size[0] as f64, observed.size[1] as f64) * 0.5 - 0.5;
    let problem = Problem { kind, points: &points };
    let mut best: Option<(Vec<f64>, f64)> = None;
    for start in starts(kind, &points, centre, observed)? {
        let (found, cost) = problem.solve(start);
        if cost.is_finite() && best.as_ref().is_none_or(|b| cost < b.1) {
            best = Some((found, cost));
        }
    }
    let none =
        || wrong("fit", format!("no numbers of the model {}", kind.name()), "another model: this one cannot come near the lens");
    let (p, _) = best.ok_or_else(none)?;
    let model = CameraModel::new(kind, DVec2::new(p[0], p[1]), DVec2::new(p[2], p[3]), p[4..].to_vec()).map_err(|_| none())?;
    let off = |pixel: DVec2, d: DVec3| {
        let [x, y] = kind.normalized(model.coefficients(), d.to_array());
        DVec2::new(x, y) * model.focal() + model.centre() - pixel
    };
    let map: Vec<Option<DVec2>> =
        observed.points.iter().map(|o| o.filter(|o| usable(o.direction)).map(|o| off(o.pixel, o.direction))).collect();
    let squares = map.iter().flatten().map(|d| d.length_squared());
    let largest = |all: &mut dyn Iterator<Item = f64>| all.fold(0.0, f64::max);
    Ok(Fit {
        rms_px: (squares.clone().sum::<f64>() / points.len() as f64).sqrt(),
        max_px: largest(&mut squares.map(f64::sqrt)),
        fitted_angle: largest(&mut points.iter().map(|p| off_axis(p.1))),
        seen_angle: largest(&mut seen.iter().map(|p| off_axis(p.direction))),
        fitted: [points.len(), seen.len()],
        grid: observed.grid,
        map,
        model,
    })
}

/// Where searches begin: fx, fy, cx, cy and coefficients.
fn starts(
    kind: ModelKind,
    points: &[(DVec2, DVec3)],
    centre: DVec2,
    observed: &Observed,
) -> Result<Vec<Vec<f64>>, CalibrationError> {
    let zeros = kind.coefficients().len();
    let before = match kind {
        ModelKind::OpenCv5 => Some(ModelKind::OpenCv4),
        ModelKind::OpenCv8 => Some(ModelKind::OpenCv5),
        ModelKind::OpenCv12 => Some(ModelKind::OpenCv8),
        ModelKind::OpenCv14 => Some(ModelKind::OpenCv12),
        ModelKind::ThinPrismFisheye => Some(ModelKind::Equidistant),
        _ => None,
    };
    if let Some(before) = before {
        let model = fit(before, observed)?.model;
        let mut start = vec![model.focal().x, model.focal().y, model.centre().x, model.centre().y];
        start.extend_from_slice(model.coefficients());
        start.resize(4 + zeros, 0.0);
        return Ok(vec![start]);
    }
    // Focal length of the quarter of the points that are nearest to the axis: pixels over angle.
    let mut by_angle: Vec<(f64, f64)> = points.iter().map(|(p, d)| (off_axis(*d), (*p - centre).length())).collect();
    by_angle.sort_by(|a, b| a.0.total_cmp(&b.0));
    by_angle.truncate((points.len() / 4).max(8));
    let (above, below) = by_angle.iter().fold((0.0, 0.0), |(a, b), (t, r)| (a + t * r, b + t * t));
    let focal = above / below;
    if !(focal > 0.0 && focal.is_finite()) {
        return Err(wrong("fit", "directions that do not differ", "a lens whose points look different ways"));
    }
    let with = |focal: f64, k: &[f64]| [&[focal, focal, centre.x, centre.y][..], k].concat();
    Ok(match kind {
        // The scale in the middle is f / (1 + ξ).
        ModelKind::DoubleSphere => [(-0.3, 0.5), (0.0, 0.5), (0.0, 0.7), (0.3, 0.3)]
            .iter()
            .map(|(xi, alpha)| with(focal * (1.0 + xi), &[*xi, *alpha]))
            .collect(),
        _ => vec![with(focal, &vec![0.0; zeros])],
    })
}

/// Places and directions, and the model that is to say the same.
struct Problem<'a> {
    kind: ModelKind,
    points: &'a [(DVec2, DVec3)],
}

impl Problem<'_> {
    /// Parameters that are one number.
    fn variables(&self) -> Vec<Vec<usize>> {
        let coefficients = (4..4 + self.kind.coefficients().len()).map(|i| vec![i]);
        let focal = match self.kind {
            ModelKind::SimpleRadial | ModelKind::Radial => vec![vec![0, 1]],
            _ => vec![vec![0], vec![1]],
        };
        focal.into_iter().chain([vec![2], vec![3]]).chain(coefficients).collect()
    }

    /// Half the sum of squares.
    fn cost(&self, p: &[f64]) -> f64 {
        let each = |(pixel, d): &(DVec2, DVec3)| {
            let [x, y] = self.kind.normalized(&p[4..], d.to_array());
            (DVec2::new(p[0] * x + p[2], p[1] * y + p[3]) - *pixel).length_squared()
        };
        let sum = 0.5 * self.points.iter().map(each).sum::<f64>();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    /// Columns of derivatives by each variable, and the differences.
    fn jacobian(&self, p: &[f64], variables: &[Vec<usize>]) -> (Vec<Vec<f64>>, Vec<f64>) {
        let mut duals: Vec<Dual<MOST>> = p.iter().map(|v| Dual::constant(*v)).collect();
        for (number, members) in variables.iter().enumerate() {
            members.iter().for_each(|i| duals[*i] = Dual::variable(p[*i], number));
        }
        let mut columns = vec![Vec::with_capacity(2 * self.points.len()); variables.len()];
        let mut differences = Vec::with_capacity(2 * self.points.len());
        for (pixel, d) in self.points {
            let [x, y] = self.kind.normalized(&duals[4..], d.to_array().map(Dual::constant));
            let at = [duals[0] * x + duals[2], duals[1] * y + duals[3]];
            for (value, seen) in at.into_iter().zip(pixel.to_array()) {
                differences.push(value.value - seen);
                columns.iter_mut().zip(value.derivatives).for_each(|(column, d)| column.push(d));
            }
        }
        (columns, differences)
    }

    /// Levenberg and Marquardt.
    fn solve(&self, mut p: Vec<f64>) -> (Vec<f64>, f64) {
        let variables = self.variables();
        let mut cost = self.cost(&p);
        let (mut damping, mut idle) = (1e-3f64, 0);
        for _ in 0..STEPS {
            if !cost.is_finite() || idle >= 3 {
                break;
            }
            let (columns, differences) = self.jacobian(&p, &variables);
            let mut accepted = false;
            while damping < 1e12 {
                if let Some(step) = least_squares(&columns, &differences, damping) {
                    let mut next = p.clone();
                    for (members, by) in variables.iter().zip(&step) {
                        members.iter().for_each(|i| next[*i] -= by);
                    }
                    let new = self.cost(&next);
                    if new < cost && next[0] > 0.0 && next[1] > 0.0 {
                        // Rounding alone goes on to be a little less for long.
                        idle = if cost - new < 1e-9 * cost { idle + 1 } else { 0 };
                        (p, cost, accepted) = (next, new, true);
                        damping = if damping < 1e-14 { 0.0 } else { 0.1 * damping };
                        break;
                    }
                }
                damping = if damping == 0.0 { 1e-14 } else { 10.0 * damping };
            }
            if !accepted {
                break;
            }
        }
        (p, cost)
    }
}

/// The x of least |A x − b|² + damping |D x|² with D the lengths of A's columns; `None` where A has no full rank.
fn least_squares(columns: &[Vec<f64>], b: &[f64], damping: f64) -> Option<Vec<f64>> {
    let (n, m) = (columns.len(), b.len());
    let lengths: Vec<f64> = columns.iter().map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
    if lengths.iter().any(|l| !(*l > 0.0 && l.is_finite())) {
        return None;
    }
    let mut a: Vec<Vec<f64>> = columns
        .iter()
        .enumerate()
        .map(|(j, c)| {
            let mut column: Vec<f64> = c.iter().map(|v| v / lengths[j]).collect();
            column.resize(m + n, 0.0);
            column[m + j] = damping.sqrt();
            column
        })
        .collect();
    let mut rhs = b.to_vec();
    rhs.resize(m + n, 0.0);
    // Reflections that leave a triangle.
    for j in 0..n {
        let norm = a[j][j..].iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(norm > 1e-14) {
            return None;
        }
        let alpha = if a[j][j] > 0.0 { -norm } else { norm };
        let mut v = a[j][j..].to_vec();
        v[0] -= alpha;
        let v2: f64 = v.iter().map(|x| x * x).sum();
        let reflect = |x: &mut [f64]| {
            let by = 2.0 * v.iter().zip(x.iter()).map(|(a, b)| a * b).sum::<f64>() / v2;
            x.iter_mut().zip(&v).for_each(|(x, v)| *x -= by * v);
        };
        a[j..].iter_mut().for_each(|column| reflect(&mut column[j..]));
        reflect(&mut rhs[j..]);
    }
    let mut x = vec![0.0; n];
    for j in (0..n).rev() {
        let known: f64 = (j + 1..n).map(|k| a[k][j] * x[k]).sum();
        x[j] = (rhs[j] - known) / a[j][j];
    }
    x.iter_mut().zip(&lengths).for_each(|(x, l)| *x /= l);
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::super::observe::{Observation, PrincipalRay, observe, ray, seen_from_camera};
    use super::*;
    use crate::camera::Film;
    use diopter_lens::compound::Setting;
    use diopter_lens::{CompoundLens, Focus, Lens, embedded};
    use diopter_light::units::Millimeters;

    /// Directions that a model sees.
    fn of_model(model: &CameraModel, size: [usize; 2]) -> Observed {
        let grid = [25, 17];
        let points = (0..25 * 17)
            .map(|i| {
                let at = |k: usize, n: usize, size: usize| k as f64 / (n - 1) as f64 * (size - 1) as f64;
                let pixel = DVec2::new(at(i % 25, 25, size[0]), at(i / 25, 17, size[1]));
                model.unproject(pixel).map(|direction| Observation { pixel, direction })
            })
            .collect();
        Observed { size, grid, points }
    }

    #[test]
    fn known_coefficients_are_found_again() {
        for (kind, k) in [
            (ModelKind::Pinhole, &[][..]),
            (ModelKind::SimpleRadial, &[-0.08]),
            (ModelKind::Radial, &[-0.2, 0.06]),
            (ModelKind::OpenCv4, &[-0.2, 0.06, 0.001, -0.0007]),
            (ModelKind::OpenCv5, &[-0.2, 0.06, 0.001, -0.0007, -0.01]),
            (ModelKind::Fisheye, &[-0.02, 0.006, -0.003, 0.0004]),
            (ModelKind::FTheta, &[0.01, -0.03, 0.004, -0.001]),
            (ModelKind::DoubleSphere, &[-0.2, 0.58]),
            (ModelKind::Division, &[-0.12]),
            (ModelKind::Equidistant, &[]),
        ] {
            let size = [1200, 800];
            let focal = if matches!(kind, ModelKind::SimpleRadial | ModelKind::Radial) {
                DVec2::splat(900.0)
            } else {
                DVec2::new(900.0, 895.0)
            };
            let model = CameraModel::new(kind, focal, DVec2::new(605.5, 393.25), k.to_vec()).unwrap();
            let found = fit(kind, &of_model(&model, size)).unwrap();
            assert!(found.max_px < 1e-8, "{kind:?} {}", found.max_px);
            for (a, b) in found.model.coefficients().iter().zip(k) {
                assert!((a - b).abs() < 1e-8, "{kind:?}: {a} {b}");
            }
            assert!(
                (found.model.focal() - focal).length() < 1e-5 && (found.model.centre() - model.centre()).length() < 1e-5,
                "{kind:?}"
            );
        }
    }

    #[test]
    fn models_of_many_coefficients_say_the_same_directions() {
        // Their coefficients stand for each other in part, so places are compared.
        let k = [-0.2, 0.06, 0.001, -0.0007, -0.01, 0.05, -0.01, 0.002, 0.0004, -0.0002, 0.0003, 0.0001];
        for (kind, k) in [(ModelKind::OpenCv8, &k[..8]), (ModelKind::OpenCv12, &k)] {
            let model = CameraModel::new(kind, DVec2::splat(900.0), DVec2::new(605.5, 393.25), k.to_vec()).unwrap();
            let found = fit(kind, &of_model(&model, [1200, 800])).unwrap();
            assert!(found.max_px < 1e-8, "{kind:?} {}", found.max_px);
        }
    }

    fn traced(name: &str, focus: Focus, film: &Film) -> Lens {
        let setting =
            Setting { focal_length: None, f_number: Some(8.0), focus, iris: None, film_mm: [film.width_mm, film.height_mm] };
        Lens::Compound(Box::new(CompoundLens::new(std::sync::Arc::new(embedded(name).unwrap()), &setting).unwrap()))
    }

    #[test]
    fn a_traced_lens_is_said_within_its_residual() {
        let film = Film::new(36.0, 24.0, 6000, 4000);
        for (name, focus, rms) in [
            ("double-gauss-50mm", Focus::Infinity, 0.2),
            ("double-gauss-50mm", Focus::Distance(Millimeters(1000.0)), 0.2),
            ("fisheye-15mm-f2.8", Focus::Infinity, 3.0),
        ] {
            let lens = traced(name, focus, &film);
            let observed = observe(&lens, &film, PrincipalRay::CHIEF);
            let found = fit(suitable(&observed), &observed).unwrap();
            assert!(found.rms_px < rms && found.max_px >= found.rms_px, "{name}: {} {}", found.rms_px, found.max_px);
            // The lens is round, and its axis is the middle of the picture.
            assert!((found.model.centre() - DVec2::new(2999.5, 1999.5)).length() < 0.05, "{name}: {}", found.model.centre());
            // At places in between, model and lens agree as the residual says.
            // The fisheye is dark from 14 mm on.
            for pixel in [DVec2::new(1300.3, 1011.0), DVec2::new(3333.0, 2500.7), DVec2::new(4700.1, 3100.2)] {
                let seen = ray(&lens, &film, pixel, PrincipalRay::CHIEF).unwrap();
                let at = found.model.project(seen_from_camera(&lens, seen)).unwrap();
                assert!((at - pixel).length() < 1.5 * found.max_px + 0.01, "{name} {pixel}: {at} {}", found.max_px);
            }
        }
    }

    #[test]
    fn the_centroid_lies_near_the_chief_ray() {
        let film = Film::new(36.0, 24.0, 6000, 4000);
        let lens = traced("double-gauss-50mm", Focus::Infinity, &film);
        let pixel = DVec2::new(1000.0, 800.0);
        let [a, b] = [PrincipalRay::CHIEF, PrincipalRay::CENTROID].map(|w| ray(&lens, &film, pixel, w).unwrap()[1]);
        // Coma at f/8: less than ten pixels of 1.2e-4 rad, and not nothing.
        assert!((1e-9..1.2e-3).contains(&(a - b).length()), "{}", (a - b).length());
    }
}

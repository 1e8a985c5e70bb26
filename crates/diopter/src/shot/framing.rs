//! Where the camera stands by default: a three-quarter view from a little above that fills the frame with what is photographed.
//!
//! A point at (x, y, z) in the camera's axes (right, up, back) from what it is aimed at is inside a part t of the frame, seen from a distance D,
//! where |x − c| ≤ t (D − z). That is linear in c and D, so the nearest place follows from the farthest points along (±1, 0, t) and (0, ±1, t): the
//! silhouette itself fills the frame, not a ball around it.

use crate::camera::{look_at, three_quarter_direction};
use crate::shot::ShotError;
use glam::{Affine3A, DVec3, Vec3};

/// Part of the frame that the subject fills along the side where it is the tighter fit.
pub(super) const FILL: f64 = 0.7;
/// Tangents between 0 and that of the frame for which support points are asked.
const STEPS: usize = 8;
/// Nearest that a lens stands, focal lengths: a little more than natural size. Ideal lenses come nearer.
const NEAREST_REAL: f64 = 2.2;

/// The angle of view of a lens.
#[derive(Clone, Copy, Debug)]
pub(super) struct Angle {
    /// Tangents of half of it focused at infinity, across and up.
    pub tan_half: [f64; 2],
    /// Focal length, m, of a lens that focuses; its image grows as it is drawn out.
    pub focal_m: Option<f64>,
    /// Whether it has surfaces.
    pub real: bool,
}

impl Angle {
    /// The tangents when it is focused at a distance, m.
    fn at(&self, distance_m: f64) -> [f64; 2] {
        let narrower = self.focal_m.map_or(1.0, |f| (distance_m - f) / distance_m);
        self.tan_half.map(|t| t * narrower)
    }
}

/// A place for a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Framed {
    pub place: Affine3A,
    /// Along the axis to the middle of the subject, m.
    pub middle_m: f64,
    /// Along the axis to its nearest and its farthest point, m.
    pub depths_m: [f64; 2],
}

/// Frames what lies around `center`. `support` answers with the farthest points of it along directions; `aim`: what the middle of the picture
/// shows, where that is asked for and the subject is not simply centred.
pub(super) fn framed(
    center: Vec3,
    aim: Option<Vec3>,
    up: Vec3,
    angle: &Angle,
    support: impl Fn(&[Vec3]) -> Vec<Vec3>,
) -> Result<Framed, ShotError> {
    let at = aim.unwrap_or(center);
    let axes = look_at(at + three_quarter_direction(), at, up)?;
    let [right, above, back] = [Vec3::X, Vec3::Y, Vec3::Z].map(|v| axes.transform_vector3(v));
    let mut directions = vec![back, -back];
    for k in 0..=STEPS {
        let [x, y] = angle.tan_half.map(|t| (FILL * t * k as f64 / STEPS as f64) as f32);
        directions.extend([right + back * x, back * x - right, above + back * y, back * y - above]);
    }
    let mut points: Vec<DVec3> = support(&directions)
        .into_iter()
        .map(|p| p - at)
        .map(|p| DVec3::new(p.dot(right).into(), p.dot(above).into(), p.dot(back).into()))
        .collect();
    if points.is_empty() {
        points = [-0.5, 0.5].map(DVec3::splat).to_vec();
    }
    let place = solve(&points, angle, aim.is_none());
    let eye = at + right * place.x as f32 + above * place.y as f32 + back * place.z as f32;
    let (nearest, farthest) =
        points.iter().fold((f64::NEG_INFINITY, f64::INFINITY), |(near, far), p| (near.max(p.z), far.min(p.z)));
    let least = 1e-3 * place.z;
    Ok(Framed {
        place: Affine3A { matrix3: axes.matrix3, translation: eye.into() },
        middle_m: (place.z - f64::from((center - at).dot(back))).max(least),
        depths_m: [(place.z - nearest).max(least), (place.z - farthest).max(least)],
    })
}

/// The camera's place in its own axes, by the support points; `centred`: whether it may move sideways to centre them.
fn solve(points: &[DVec3], angle: &Angle, centred: bool) -> DVec3 {
    let most = |along: &dyn Fn(&DVec3) -> f64| points.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
    let front = most(&|p| p.z);
    let extent = points.iter().flat_map(|p| points.iter().map(move |q| (*p - *q).length())).fold(0.0, f64::max).max(1e-3);
    // Nearest distance for a part of the frame that the points fit in.
    let nearest = |tan: [f64; 2]| {
        let [tx, ty] = tan.map(|t| (FILL * t).max(1e-6));
        let sides = [
            [most(&|p| p.x + tx * p.z) / tx, most(&|p| tx * p.z - p.x) / tx],
            [most(&|p| p.y + ty * p.z) / ty, most(&|p| ty * p.z - p.y) / ty],
        ];
        let fit = sides.map(|[a, b]| if centred { 0.5 * (a + b) } else { a.max(b) });
        fit[0].max(fit[1]).max(front + 0.02 * extent)
    };
    // A lens that is focused on them sees less the nearer they are: the distance at which the two agree, by halving.
    let mut distance = nearest(angle.tan_half);
    if let Some(focal) = angle.focal_m {
        let too_near = |d: f64| nearest(angle.at(d)) > d;
        let (mut low, mut high) = (focal * (1.0 + 1e-6), distance.max(2.0 * focal));
        for _ in 0..60 {
            if !too_near(high) {
                break;
            }
            high *= 2.0;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if too_near(middle) { low = middle } else { high = middle }
        }
        distance = if angle.real { high.max(NEAREST_REAL * focal) } else { high };
    }
    if !centred {
        return DVec3::new(0.0, 0.0, distance);
    }
    // As much room on both sides, as the picture shows it.
    let middle = |of: &dyn Fn(&DVec3) -> f64| {
        let (mut low, mut high) = (-most(&|p| -of(p)), most(of));
        for _ in 0..60 {
            let c = 0.5 * (low + high);
            let seen = |sign: f64| most(&|p| sign * (of(p) - c) / (distance - p.z));
            if seen(1.0) > seen(-1.0) { low = c } else { high = c }
        }
        0.5 * (low + high)
    };
    DVec3::new(middle(&|p| p.x), middle(&|p| p.y), distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Farthest corners of a box along directions.
    fn corners(size: Vec3) -> impl Fn(&[Vec3]) -> Vec<Vec3> {
        let all: Vec<Vec3> =
            (0..8).map(|i| Vec3::new((i & 1) as f32 - 0.5, (i >> 1 & 1) as f32 - 0.5, (i >> 2) as f32 - 0.5) * size).collect();
        move |directions| {
            let farthest = |d: &Vec3| *all.iter().max_by(|a, b| a.dot(*d).total_cmp(&b.dot(*d))).unwrap();
            directions.iter().map(farthest).collect()
        }
    }

    #[test]
    fn tall_flat_and_cubic_boxes_fill_seven_tenths_of_the_frame() {
        for size in [Vec3::new(0.3, 2.0, 0.3), Vec3::new(3.0, 0.05, 2.0), Vec3::ONE, Vec3::splat(0.02)] {
            for (tan_half, focal_m) in [([0.36, 0.24], Some(0.05)), ([1.1, 0.73], Some(0.0164)), ([0.24, 0.36], None)] {
                let angle = Angle { tan_half, focal_m, real: false };
                let framed = framed(Vec3::ZERO, None, Vec3::Y, &angle, corners(size)).unwrap();
                let camera_from_world = framed.place.inverse();
                let tan = angle.at(framed.middle_m);
                let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
                for i in 0..8 {
                    let corner = Vec3::new((i & 1) as f32 - 0.5, (i >> 1 & 1) as f32 - 0.5, (i >> 2) as f32 - 0.5) * size;
                    let p = camera_from_world.transform_point3(corner).as_dvec3();
                    assert!(p.z < 0.0, "{size} is behind the camera");
                    for (k, v) in [p.x, p.y].into_iter().enumerate() {
                        let seen = v / -p.z / tan[k];
                        (least[k], most[k]) = (least[k].min(seen), most[k].max(seen));
                    }
                    let depth = -p.z;
                    assert!(
                        depth > 0.99 * framed.depths_m[0] && depth < 1.01 * framed.depths_m[1],
                        "{depth} {:?}",
                        framed.depths_m
                    );
                }
                let filled = [0, 1].map(|k: usize| 0.5 * (most[k] - least[k]));
                let larger = filled[0].max(filled[1]);
                assert!((0.69..0.71).contains(&larger), "{size} with {tan_half:?}: {filled:?}");
                // In the middle.
                assert!((0..2).all(|k| (least[k] + most[k]).abs() < 0.01), "{size} with {tan_half:?}: {least:?} {most:?}");
            }
        }
    }

    #[test]
    fn it_looks_from_the_right_and_a_little_above() {
        let angle = Angle { tan_half: [0.36, 0.24], focal_m: None, real: false };
        let eye = framed(Vec3::ZERO, None, Vec3::Y, &angle, corners(Vec3::ONE)).unwrap().place.translation;
        let azimuth = eye.x.atan2(eye.z).to_degrees();
        let elevation = eye.y.atan2(eye.x.hypot(eye.z)).to_degrees();
        assert!((25.0..35.0).contains(&azimuth) && (14.0..21.0).contains(&elevation), "{azimuth} {elevation}");
        // Aimed at a corner it stays aimed there and keeps all in the frame.
        let aim = Vec3::splat(0.5);
        let aimed = framed(Vec3::ZERO, Some(aim), Vec3::Y, &angle, corners(Vec3::ONE)).unwrap();
        let seen = aimed.place.inverse().transform_point3(aim);
        assert!(seen.x.abs() < 1e-4 && seen.y.abs() < 1e-4 && seen.z < 0.0, "{seen}");
        // A point is no reason to fail.
        let point = framed(Vec3::ONE, None, Vec3::Y, &angle, |d| vec![Vec3::ONE; d.len()]).unwrap();
        assert!(point.place.is_finite() && point.middle_m > 0.0);
    }
}

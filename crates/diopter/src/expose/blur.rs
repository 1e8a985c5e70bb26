//! How large the lens draws a point at any distance, and how much of its pupil is open: circles of confusion and vignetting over the picture.
//!
//! Rays from one film point through the whole pupil cross the plane through a point (square to the chief ray, at distance ℓ along it) at offsets o + ℓ s from
//! the chief ray. A film point beside it has a chief ray at J_o + ℓ J_s (by pixels). By the reversibility of light, the point is drawn on the film where the
//! chief rays that meet those offsets begin: at −(J_o/ℓ + J_s)⁻¹ (o/ℓ + s), in pixels. Second moments of o and s over the pupil give the root mean square radius at
//! every distance at once; they change slowly over the picture and are kept on a grid. The circle of confusion is the disc of that root mean square
//! radius: its diameter is 2 √2 times it (a uniform disc of radius r has r²/2), which is the geometric circle of a lens without aberrations.

use crate::camera::Camera;
use diopter_lens::Lens;
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

/// Nodes across and down.
const NODES: [usize; 2] = [33, 25];
/// Rings in the pupil, of one area each, and places on each.
const RINGS: usize = 12;
const ON_RING: usize = 12;
/// By how much a ring is turned against the one within it, of the distance of its places.
const TURN: f32 = 0.618_034;
/// Smallest cosine to the axis that an opening is divided by: towards the sides of a fisheye a flat pupil would have no area.
const LEAST_COSINE: f64 = 0.02;

/// What is known at a place of the picture, in pixels of it: sums of products of o and s (see above) over the pupil, about their means.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// J_s⁻¹ J_o, mm.
    shift: DMat2,
    /// Moments of J_s⁻¹ o, px² mm².
    oo: DMat2,
    /// Symmetrised products of J_s⁻¹ o and J_s⁻¹ s, px² mm.
    os: DMat2,
    /// Moments of J_s⁻¹ s, px².
    ss: DMat2,
    /// Cross-section of the beam over that of a nominal pupil, any unit.
    open: f64,
}

impl Node {
    const ZERO: Node = Node { shift: DMat2::ZERO, oo: DMat2::ZERO, os: DMat2::ZERO, ss: DMat2::ZERO, open: 0.0 };

    fn add(&mut self, other: &Node, weight: f64) {
        self.shift += other.shift * weight;
        self.oo += other.oo * weight;
        self.os += other.os * weight;
        self.ss += other.ss * weight;
        self.open += other.open * weight;
    }
}

/// The blur of a camera over its picture.
#[derive(Debug)]
pub(super) struct Blur {
    nodes: Vec<Option<Node>>,
    size: DVec2,
}

fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}

/// Offset from a chief ray of another ray, in the plane square to it: at distance 0, and by distance.
fn offset(chief: (DVec3, DVec3), ray: (DVec3, DVec3), axes: (DVec3, DVec3)) -> Option<[DVec2; 2]> {
    let along = ray.1.dot(chief.1);
    let apart = ray.0 - chief.0;
    let o = apart - ray.1 * (apart.dot(chief.1) / along);
    let s = ray.1 / along - chief.1;
    (along > 1e-3).then(|| [o, s].map(|v| DVec2::new(v.dot(axes.0), v.dot(axes.1))))
}

impl Blur {
    /// Circles of confusion of a camera as it is focused.
    pub fn new(camera: &Camera) -> Blur {
        let film = &camera.film;
        let size = DVec2::new(film.columns as f64, film.rows as f64);
        let place = |i: usize| {
            let at = [i % NODES[0], i / NODES[0]];
            size * DVec2::new(at[0] as f64 / (NODES[0] - 1) as f64, at[1] as f64 / (NODES[1] - 1) as f64)
        };
        let mut nodes: Vec<Option<Node>> = (0..NODES[0] * NODES[1]).into_par_iter().map(|i| node(camera, place(i))).collect();
        // The pupil is open where the axis meets the film.
        let axis = DVec2::new(0.5 - film.center_mm[0] / film.width_mm, 0.5 + film.center_mm[1] / film.height_mm) * size;
        let widest = || nodes.iter().flatten().map(|n| n.open).fold(0.0, f64::max);
        let whole = node(camera, axis).map_or_else(widest, |n| n.open);
        if whole > 0.0 {
            nodes.iter_mut().flatten().for_each(|n| n.open /= whole);
        }
        Blur { nodes, size }
    }

    /// Between the nodes around a place (pixels); `None` where none of them lets light pass.
    fn at(&self, at: DVec2) -> Option<Node> {
        let cell = |x: f64, k: usize| {
            let x = (x / self.size[k] * (NODES[k] - 1) as f64).clamp(0.0, (NODES[k] - 1) as f64);
            let i = (x as usize).min(NODES[k] - 2);
            (i, x - i as f64)
        };
        let ((i, fx), (j, fy)) = (cell(at.x, 0), cell(at.y, 1));
        let (mut sum, mut weights) = (Node::ZERO, 0.0);
        for (di, dj) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let part = |step: usize, f: f64| if step == 1 { f } else { 1.0 - f };
            let weight = part(di, fx) * part(dj, fy);
            if let Some(node) = &self.nodes[(j + dj) * NODES[0] + i + di]
                && weight > 0.0
            {
                sum.add(node, weight);
                weights += weight;
            }
        }
        let mut mean = Node::ZERO;
        mean.add(&sum, 1.0 / weights);
        // Of the opening, what is dark counts as closed.
        mean.open = sum.open;
        (weights > 0.0).then_some(mean)
    }

    /// Diameter of the circle of confusion at a place of the picture (pixels) of what lies so far along the chief ray, m; negative before the sharp
    /// plane. `None` where no light passes.
    pub fn circle_px(&self, at: DVec2, distance_m: f64) -> Option<f64> {
        let node = self.at(at)?;
        let w = 1e-3 / distance_m;
        let inverse = (DMat2::IDENTITY + node.shift * w).inverse();
        let second_moments = node.oo * (w * w) + node.os * w + node.ss;
        let drawn = inverse * second_moments * inverse.transpose();
        let square = (drawn.x_axis.x + drawn.y_axis.y).max(0.0);
        // Rays that have not crossed yet lie on the side of the pupil that they come from.
        let uncrossed = node.oo.x_axis.x + node.oo.y_axis.y;
        let crossed = uncrossed * w + 0.5 * (node.os.x_axis.x + node.os.y_axis.y);
        let diameter = 2.0 * (2.0 * square).sqrt();
        let signed = if crossed > 0.0 { -diameter } else { diameter };
        signed.is_finite().then_some(signed)
    }

    /// Fraction of the pupil that is open at a place of the picture (pixels), of that on the axis.
    pub fn open(&self, at: DVec2) -> f64 {
        self.at(at).map_or(0.0, |node| node.open)
    }
}

/// The two numbers by which lenses draw a place of the pupil ([`diopter_light::sampling::disk`]), for the places of rings: with those the second moments of a round pupil are exact.
fn place(i: usize) -> [f32; 2] {
    let (ring, k) = (i / ON_RING, i % ON_RING);
    let radius = ((ring as f32 + 0.5) / RINGS as f32).sqrt();
    let (y, x) = (std::f32::consts::TAU * (k as f32 + 0.5 + TURN * ring as f32) / ON_RING as f32).sin_cos();
    // The map of Shirley and Chiu the other way: the longer coordinate is the radius.
    let shorter = |long: f32, short: f32| (short / long).atan() / std::f32::consts::FRAC_PI_4;
    let (a, b) = match x.abs() >= y.abs() {
        true => (radius.copysign(x), radius.copysign(x) * shorter(x, y)),
        false => (radius.copysign(y) * shorter(y, x), radius.copysign(y)),
    };
    [0.5 * (a + 1.0), 0.5 * (b + 1.0)]
}

fn node(camera: &Camera, at: DVec2) -> Option<Node> {
    let chief_at = |at: DVec2| {
        let ray = camera.lens.chief_ray(camera.film_point(at.x, at.y)).ok()?;
        Some((ray.origin_mm, ray.direction))
    };
    let chief = chief_at(at)?;
    if matches!(camera.lens, Lens::Pinhole(_)) {
        // Holes and projections: all is sharp, and nothing is in the way.
        return Some(Node { open: 1.0, ..Node::ZERO });
    }
    let axes = chief.1.any_orthonormal_pair();
    // What a pixel more means; at an edge of what passes, to one side.
    let h = (camera.film.columns as f64 / 1000.0).max(0.25);
    let slope = |step: DVec2| {
        let side = |step: DVec2| offset(chief, chief_at(at + step)?, axes);
        let zero = [DVec2::ZERO; 2];
        let (after, before) = (side(step * h), side(-step * h));
        let length = h * f64::from(u8::from(after.is_some()) + u8::from(before.is_some()));
        let (a, b) = (after.unwrap_or(zero), before.unwrap_or(zero));
        (length > 0.0).then(|| [0, 1].map(|k| (a[k] - b[k]) / length))
    };
    let (x, y) = (slope(DVec2::X)?, slope(DVec2::Y)?);
    let by_distance = DMat2::from_cols(x[1], y[1]);
    let solid_angle = by_distance.determinant().abs();
    if !(solid_angle > 0.0) {
        return None;
    }
    let pixels = by_distance.inverse();
    let shift = pixels * DMat2::from_cols(x[0], y[0]);

    // The whole pupil.
    let film = camera.film_point(at.x, at.y);
    let (mut weights, mut passed, mut means, mut second_moments) = (0.0, 0.0, [DVec2::ZERO; 2], [DMat2::ZERO; 3]);
    for i in 0..RINGS * ON_RING {
        let u = place(i);
        let Ok(ray) = camera.lens.ray(film, u) else { continue };
        let Some([o, s]) = offset(chief, (ray.origin_mm, ray.direction), axes) else { continue };
        let (o, s) = (pixels * o, pixels * s);
        weights += ray.weight_sr;
        passed += 1.0;
        means = [means[0] + o, means[1] + s];
        second_moments[0] += outer(o, o);
        second_moments[1] += outer(o, s) + outer(s, o);
        second_moments[2] += outer(s, s);
    }
    if !(weights > 0.0) {
        return None;
    }
    let [o, s] = means.map(|m| m / passed);
    let second_moments = second_moments.map(|m| m * (1.0 / passed));
    let passing = weights / (RINGS * ON_RING) as f64;
    let open = match camera.lens {
        // What is stated of its light, whatever the law of its picture.
        Lens::Calibrated(_) => passing,
        // Étendue: solid angle times area is the same before and behind the lens.
        _ => passing / solid_angle / (-chief.1.z).max(LEAST_COSINE),
    };
    Some(Node {
        shift,
        oo: second_moments[0] - outer(o, o),
        os: second_moments[1] - outer(o, s) - outer(s, o),
        ss: second_moments[2] - outer(s, s),
        open,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Film;
    use crate::camera_motion::CameraMotion;
    use diopter_lens::calibrated::{PixelGrid, View};
    use diopter_lens::camera_model::{CameraModel, ModelKind};
    use diopter_lens::{CalibratedLens, Focus, Iris, Lens, Pinhole, Projection, ThinLens};
    use diopter_light::units::Millimeters;
    use glam::Affine3A;

    fn camera(lens: Lens) -> Camera {
        Camera { lens, film: Film::new(36.0, 24.0, 360, 240), motion: CameraMotion::still(Affine3A::IDENTITY) }
    }

    #[test]
    fn circles_of_a_thin_lens_are_those_of_the_textbook() {
        let (f, n, focus) = (50.0, 2.0, 2000.0);
        let thin = ThinLens::new(Millimeters(f), n, Iris::Round, Focus::Distance(Millimeters(focus))).unwrap();
        let blur = Blur::new(&camera(Lens::Thin(thin)));
        for at in [DVec2::new(180.0, 120.0), DVec2::new(33.3, 201.7)] {
            let film = (at - DVec2::new(180.0, 120.0)) * 0.1;
            let oblique = (film / (f * focus / (focus - f))).extend(1.0).length();
            for depth in [800.0, 1500.0, 3000.0, 12_000.0, 1e9] {
                // c = A f |s − s0| / (s (s0 − f)), with the pupil's diameter A = f / N, depths s along the axis; 10 pixels a mm.
                let expected = 10.0 * f / n * f * (depth - focus) / (depth * (focus - f));
                let found = blur.circle_px(at, depth * 1e-3 * oblique).unwrap();
                // Off the axis, planes square to the chief ray differ from those square to the axis to second order in the angle of the blur.
                let tolerance = if film == DVec2::ZERO { 1e-3 } else { 0.02 };
                assert!((found / expected - 1.0).abs() < tolerance, "{at} {depth}: {found} {expected}");
            }
            assert!(blur.circle_px(at, focus * 1e-3 * oblique).unwrap().abs() < 0.05);
            // A thin lens does not keep étendue to second order in its aperture (1 / 4f², 1.6 %) and field.
            assert!((blur.open(at) - 1.0).abs() < 0.03, "{}", blur.open(at));
        }
    }

    #[test]
    fn a_pinhole_draws_points() {
        let hole = Pinhole::new(Millimeters(35.0), 8.0).unwrap();
        let all_around = Projection::Panorama { film_mm: [36.0, 24.0] };
        for projection in [Projection::Rectilinear, Projection::Orthographic { reduction: 20.0 }, all_around] {
            let blur = Blur::new(&camera(Lens::Pinhole(Pinhole { projection, ..hole })));
            for at in [DVec2::new(20.0, 30.0), DVec2::new(180.0, 0.5), DVec2::new(359.5, 239.5)] {
                assert_eq!((blur.circle_px(at, 3.0), blur.open(at)), (Some(0.0), 1.0), "{projection:?}");
            }
        }
    }

    #[test]
    fn a_fisheye_with_even_light_is_open_all_over() {
        for kind in [ModelKind::Equidistant, ModelKind::Stereographic, ModelKind::Orthographic] {
            let grid = PixelGrid { size: [360, 240], film_mm: [36.0, 24.0] };
            let model = CameraModel::new(kind, DVec2::splat(160.0), DVec2::new(179.5, 119.5), Vec::new()).unwrap();
            let view = View::Model(model);
            let lens = CalibratedLens::new("fisheye".into(), view, grid, Millimeters(16.0), 2.8, None, None).unwrap();
            let blur = Blur::new(&camera(Lens::Calibrated(Box::new(lens))));
            for at in [DVec2::new(180.0, 120.0), DVec2::new(60.0, 150.0), DVec2::new(260.0, 40.0)] {
                assert!((blur.open(at) - 1.0).abs() < 1e-6, "{kind:?} {at}: {}", blur.open(at));
            }
        }
    }
}

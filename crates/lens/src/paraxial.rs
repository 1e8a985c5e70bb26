//! First order: what the lens does to rays near the axis.
//!
//! y–nu trace (Welford, "Aberrations of Optical Systems", ch. 3); in the y–z plane. After a mirror the index counts negative,
//! so that one formula serves refraction and reflection.

use crate::dual::Number;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use glam::{DMat2, DVec2, DVec3};

/// A paraxial ray at every surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Height at each surface, mm.
    pub heights: Vec<f64>,
    /// Angle (slope) in each gap: before the first surface, after it, ...
    pub angles: Vec<f64>,
}

impl Trace {
    /// From height `y` (mm) at the first surface with slope `u` before it; `n` as [`System::indices`].
    pub fn new(system: &System, n: &[f64], y: f64, u: f64) -> Trace {
        let mut heights = Vec::with_capacity(system.surfaces.len());
        let mut angles = vec![u];
        let (mut y, mut u) = (y, u);
        for (i, s) in system.surfaces.iter().enumerate() {
            if i > 0 {
                (y, u) = transfer(system, i, n[i], [y, u]);
            }
            let (before, after) = (index_before(system, i, n) * system.runs[i], n[i + 1] * system.runs[i + 1]);
            let diffractive =
                s.diffractive.as_ref().map_or(0.0, |d| -d.path_per_phase(system.wavelength_mm(n)) * d.phase().curvatures()[1]);
            let power = s.section_curvature() * (after - before) + s.ideal_focal_length.map_or(0.0, |f| 1.0 / f) + diffractive;
            u = (before * u - y * power) / after;
            heights.push(y);
            angles.push(u);
        }
        Trace { heights, angles }
    }

    /// Parallel to the axis at a height of 1 mm.
    pub fn axial(system: &System, n: &[f64]) -> Trace {
        Trace::new(system, n, 1.0, 0.0)
    }

    /// Height at the last surface, and slope behind it.
    pub(crate) fn last(&self) -> (f64, f64) {
        (self.heights.last().copied().unwrap_or(0.0), self.angles.last().copied().unwrap_or(0.0))
    }
}

/// Index on the axis just before a surface.
fn index_before(system: &System, i: usize, n: &[f64]) -> f64 {
    match &system.gradients[i] {
        None => n[i],
        Some(g) => g.index(n[i], DVec3::new(0.0, 0.0, system.surfaces[i].z - system.surfaces[i - 1].z)),
    }
}

/// Steps over a graded gap.
const STEPS: usize = 400;

/// Height and slope at surface `i` of a ray that left the one before it so. In a gradient: d/dz (N dy/dz) = 2 N₂ y for n = N(z) + N₂(z) r²
/// (Sands 1970, J. Opt. Soc. Am. 60, 1436), by the classical Runge–Kutta scheme.
fn transfer(system: &System, i: usize, n: f64, [y, u]: [f64; 2]) -> (f64, f64) {
    let length = system.surfaces[i].z - system.surfaces[i - 1].z;
    let Some(g) = &system.gradients[i] else { return (y + u * length, u) };
    let index = |z: f64| g.index(n, DVec3::new(0.0, 0.0, z));
    let slope = |z: f64, [y, w]: [f64; 2]| [w / index(z), 2.0 * g.axial_curvature(n, z) * y];
    let h = length / STEPS as f64;
    let along = |a: [f64; 2], b: [f64; 2], f: f64| [a[0] + b[0] * f, a[1] + b[1] * f];
    let mut state = [y, u * index(0.0)];
    for k in 0..STEPS {
        let z = h * k as f64;
        let a = slope(z, state);
        let b = slope(z + 0.5 * h, along(state, a, 0.5 * h));
        let c = slope(z + 0.5 * h, along(state, b, 0.5 * h));
        let d = slope(z + h, along(state, c, h));
        for (s, k) in state.iter_mut().zip([0, 1]) {
            *s += h * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]) / 6.0;
        }
    }
    (state[0], state[1] / index(length))
}

/// What the gradient in the gap before a surface adds to the Petzval sum: ∫ 2 N₂ / N² dz (Sands 1970).
fn graded_petzval(system: &System, i: usize, n: &[f64]) -> f64 {
    let Some(g) = &system.gradients[i] else { return 0.0 };
    let length = system.surfaces[i].z - system.surfaces[i - 1].z;
    let f = |k: f64| {
        let z = length * k / STEPS as f64;
        2.0 * g.axial_curvature(n[i], z) / g.index(n[i], DVec3::new(0.0, 0.0, z)).powi(2)
    };
    let sum: f64 = (0..STEPS).map(|k| k as f64).map(|k| (f(k) + 4.0 * f(k + 0.5) + f(k + 1.0)) / 6.0).sum();
    sum * length / STEPS as f64
}

/// First-order data. Places in mm along the axis from the first vertex; distances as CODE V prints them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrder {
    /// Effective focal length: from the rear principal plane to the rear focal point, so that of a lens with glass or water before its image is [`FirstOrder::image_index`] over its power.
    pub efl: f64,
    /// Index of what is between the last surface and the image.
    pub image_index: f64,
    /// From the last vertex to the rear focal point.
    pub bfl: f64,
    /// From the first vertex to the front focal point (negative: in front of it).
    pub ffl: f64,
    /// Place of the front principal plane.
    pub front_principal_z: f64,
    /// Place of the rear principal plane.
    pub rear_principal_z: f64,
    /// Place of the entrance pupil.
    pub entrance_pupil_z: f64,
    /// Entrance pupil radius over stop radius.
    pub entrance_pupil_magnification: f64,
    /// Place of the exit pupil; infinite for a telecentric lens.
    pub exit_pupil_z: f64,
    /// Exit pupil radius over stop radius.
    pub exit_pupil_magnification: f64,
    /// Radius of the stop as it stands, mm.
    pub stop_radius: f64,
    /// Σ −(n' − n) c / (n n'), 1/mm: minus the curvature of the Petzval surface.
    pub petzval_sum: f64,
}

impl FirstOrder {
    /// First-order data of a system at the indices of one wavelength. Of a lens whose object has an axis of its own about the base ray (parabasal).
    pub fn of(system: &System, n: &[f64]) -> FirstOrder {
        if system.object_axis.is_some() {
            return parabasal(system, n).unwrap_or(FirstOrder::UNKNOWN);
        }
        let last_z = system.last_z();
        let axial = Trace::axial(system, n);
        let (y, u) = axial.last();
        let efl = -1.0 / u;
        let bfl = -y / u;
        // The other way round: a ray that leaves parallel to the axis, by linearity from the two basis rays.
        let slanted = Trace::new(system, n, 0.0, 1.0);
        let (_, us) = slanted.last();
        // y0 u + s us = 0 with slope 1 in front: height at the first vertex of the ray through the front focal point.
        let y0 = -us / u;
        let ffl = -y0;
        // Pupils: the ray through the middle of the stop.
        let (a, b) = (axial.heights[system.stop], slanted.heights[system.stop]);
        // y0' a + b = 0 for slope 1: crosses the axis at z = −y0'.
        let entrance_pupil_z = b / a;
        let chief_y = -b / a;
        let (cy, cu) = (chief_y * y + slanted.last().0, chief_y * u + us);
        let exit_pupil_z = last_z - cy / cu;
        // Invariant: n u_chief × pupil radius is the same in all spaces. With slope 1 in front at n = 1, and the slope at the
        // stop known, radius ratios follow.
        // In a graded gap the slope is known at its start: behind the stop it is the stop's.
        let gap = if system.gradients[system.stop].is_some() { system.stop + 1 } else { system.stop };
        let stop_slope = chief_y * axial.angles[gap] + slanted.angles[gap];
        let n_stop = n[gap] * system.runs[gap];
        let n_last = n[system.surfaces.len()] * system.runs[system.surfaces.len()];
        let entrance_pupil_magnification = n_stop * stop_slope;
        let exit_pupil_magnification = n_stop * stop_slope / (n_last * cu);
        let image_index = n[system.surfaces.len()].abs();
        FirstOrder {
            efl: efl * system.runs[system.surfaces.len()],
            image_index,
            bfl,
            ffl,
            front_principal_z: ffl + efl * system.runs[system.surfaces.len()] / image_index,
            rear_principal_z: last_z + bfl - efl,
            entrance_pupil_z,
            entrance_pupil_magnification,
            exit_pupil_z,
            exit_pupil_magnification,
            stop_radius: system.iris.radius,
            petzval_sum: petzval_sum(system, n),
        }
    }

    /// Of a lens without a base ray.
    const UNKNOWN: FirstOrder = FirstOrder {
        efl: f64::NAN,
        image_index: f64::NAN,
        bfl: f64::NAN,
        ffl: f64::NAN,
        front_principal_z: f64::NAN,
        rear_principal_z: f64::NAN,
        entrance_pupil_z: f64::NAN,
        entrance_pupil_magnification: f64::NAN,
        exit_pupil_z: f64::NAN,
        exit_pupil_magnification: f64::NAN,
        stop_radius: f64::NAN,
        petzval_sum: f64::NAN,
    };

    /// From the front focal point to the front principal plane: one over the power. Image heights of distant objects are this times the tangent of their angle.
    pub fn front_focal_length(&self) -> f64 {
        self.efl / self.image_index
    }

    /// Radius of the entrance pupil, mm.
    pub fn entrance_pupil_radius(&self) -> f64 {
        (self.entrance_pupil_magnification * self.stop_radius).abs()
    }

    /// Radius of the exit pupil, mm.
    pub fn exit_pupil_radius(&self) -> f64 {
        (self.exit_pupil_magnification * self.stop_radius).abs()
    }

    /// Effective focal length over entrance pupil diameter.
    pub fn f_number(&self) -> f64 {
        self.efl.abs() / (2.0 * self.entrance_pupil_radius())
    }
}

fn petzval_sum(system: &System, n: &[f64]) -> f64 {
    let of = |i: usize| {
        let (n0, n1) = (index_before(system, i, n) * system.runs[i], n[i + 1] * system.runs[i + 1]);
        graded_petzval(system, i, n) - (n1 - n0) * system.surfaces[i].section_curvature() / (n0 * n1)
    };
    (0..system.surfaces.len()).map(of).sum()
}

/// How rays near the base ray run: changes of a place (mm) and a slope by the place where a ray crosses z = 0 before the lens, and by its slope there.
struct Neighbours {
    by_place: DMat2,
    by_slope: DMat2,
}

impl Neighbours {
    /// By central differences about the base ray of `f`, a ray's place or slope at its end.
    fn of(step: f64, f: impl Fn(TracedRay) -> Option<DVec2>) -> Option<Neighbours> {
        let column = |place: DVec2, slope: DVec2| {
            let ray =
                |sign: f64| TracedRay { position: (sign * place).extend(0.0), direction: (sign * slope).extend(1.0).normalize() };
            Some((f(ray(1.0))? - f(ray(-1.0))?) / (2.0 * place.length().max(slope.length())))
        };
        let matrix = |place: f64, slope: f64| {
            Some(DMat2::from_cols(column(DVec2::X * place, DVec2::X * slope)?, column(DVec2::Y * place, DVec2::Y * slope)?))
        };
        Some(Neighbours { by_place: matrix(step, 0.0)?, by_slope: matrix(0.0, SLOPE_STEP)? })
    }
}

/// Steps of slopes of rays near the base ray.
const SLOPE_STEP: f64 = 1e-5;

/// First-order data about the base ray, from real rays near it: of the mean of both sections, which differ where surfaces stand aslant (the base ray is then astigmatic). Places behind
/// the lens lie on the base ray, which may meet the film askew: their z is theirs along the film's normal. `None` where the base ray does not come through.
fn parabasal(system: &System, n: &[f64]) -> Option<FirstOrder> {
    let through = |ray: TracedRay| system.trace(ray, n, TraceDirection::ToFilm, Apertures::Ignore).ok();
    let base = system.base_ray(n).ok()?;
    let run = system.runs[system.surfaces.len()];
    // Across the base ray, as x and y of the film; slopes count along the light.
    let along = base.direction;
    let x = (DVec3::X - along * along.x).normalize();
    let y = along.cross(x) * run;
    let across = |v: DVec3| DVec2::new(v.dot(x), v.dot(y));
    let place = |ray: TracedRay| {
        let end = through(ray)?;
        let t = (base.position - end.position).dot(along) / end.direction.dot(along);
        Some(across(end.position + end.direction * t - base.position))
    };
    let slope = |ray: TracedRay| through(ray).map(|end| across(end.direction) / end.direction.dot(along));
    let step = 1e-3 * if system.iris.radius < 1e6 { system.iris.radius } else { 1.0 };
    let (places, slopes) = (Neighbours::of(step, place)?, Neighbours::of(step, slope)?);
    let stop = Neighbours::of(step, |ray| crate::at_stop::place_at_stop(system, n, ray))?;
    let mean = |m: DMat2| 0.5 * (m.x_axis.x + m.y_axis.y);
    let size = |m: DMat2| m.determinant().abs().sqrt();
    // Rays through the middle of the stop: by how much their place before the lens goes with their slope.
    let chief = -stop.by_place.inverse() * stop.by_slope;
    let (efl, last_z) = (-1.0 / mean(slopes.by_place), system.last_z());
    let back = -mean(places.by_place) / mean(slopes.by_place);
    let front = mean(slopes.by_slope) / mean(slopes.by_place);
    let pupil = -mean(places.by_place * chief + places.by_slope) / mean(slopes.by_place * chief + slopes.by_slope);
    // What lies so far along the base ray behind the lens, and how far that is along z.
    let behind = |distance: f64| distance * along.z;
    let exit = (places.by_place + slopes.by_place * pupil) * stop.by_place.inverse();
    let image_index = n[system.surfaces.len()].abs();
    Some(FirstOrder {
        efl,
        image_index,
        bfl: base.position.z - last_z + behind(back),
        ffl: front,
        front_principal_z: front + efl / image_index,
        rear_principal_z: base.position.z + behind(back - efl),
        entrance_pupil_z: -mean(chief),
        entrance_pupil_magnification: 1.0 / size(stop.by_place),
        exit_pupil_z: base.position.z + behind(pupil),
        exit_pupil_magnification: size(exit),
        stop_radius: system.iris.radius,
        petzval_sum: petzval_sum(system, n),
    })
}

/// What first order knows of a surface, in plain numbers or with derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Element<N> {
    /// From the vertex before, mm.
    pub distance: N,
    /// Curvature at the vertex, 1/mm.
    pub curvature: N,
    /// Index times the way of the light, before and behind.
    pub indices: [N; 2],
}

/// Where the cardinal points lie: the numbers of [`FirstOrder`] with these names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cardinal<N> {
    pub efl: N,
    pub bfl: N,
    pub ffl: N,
    pub entrance_pupil_z: N,
}

impl<N: Number> Cardinal<N> {
    /// Cardinal points of surfaces that only refract and reflect, `stop` the number of the stop, `run` the way of the light behind the last.
    pub fn of(elements: &[Element<N>], stop: usize, run: f64) -> Cardinal<N> {
        // The rays parallel to the axis at height 1, and of slope 1 through the first vertex.
        let mut rays = [[N::constant(1.0), N::constant(0.0)], [N::constant(0.0), N::constant(1.0)]];
        let mut at_stop = [N::constant(0.0); 2];
        for (i, e) in elements.iter().enumerate() {
            let [before, after] = e.indices;
            let power = e.curvature * (after - before);
            for [y, u] in &mut rays {
                if i > 0 {
                    *y = *y + *u * e.distance;
                }
                *u = (before * *u - *y * power) / after;
            }
            if i == stop {
                at_stop = rays.map(|[y, _]| y);
            }
        }
        let [[y, u], [_, slanted]] = rays;
        Cardinal { efl: N::constant(-run) / u, bfl: -y / u, ffl: slanted / u, entrance_pupil_z: at_stop[1] / at_stop[0] }
    }
}

impl From<&FirstOrder> for Cardinal<f64> {
    fn from(f: &FirstOrder) -> Self {
        Cardinal { efl: f.efl, bfl: f.bfl, ffl: f.ffl, entrance_pupil_z: f.entrance_pupil_z }
    }
}

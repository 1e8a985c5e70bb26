//! Derivatives of rays by what a lens is made of: a reverse pass through the packet trace, in the same lanes.
//!
//! A packet is traced surface by surface and what each surface did to it is kept; then the derivatives of what is wanted at the end (a place on the
//! film, a direction cosine, the optical path) run back through the surfaces and meet every parameter on the way, so that the cost does not depend on how many
//! parameters there are. Reverse accumulation: Griewank & Walther, *Evaluating Derivatives*, 2nd ed., §3.2; of lenses, forwards:
//! Feder 1968, J. Opt. Soc. Am. 58, 1494. Derivatives of conics and even or odd polynomials are closed formulas; of other shapes second
//! derivatives are differences of the exact slopes, and those by curvature differences of the shape (to about 1e-8).

use crate::batch::double::{Batch, Indices, LANES, Lanes, Packet};
use crate::ray::TraceDirection;
use crate::surface::Profile;
use crate::system::System;
use diopter_light::instruction_set;
use fearless_simd::{Simd, dispatch, f64x8, prelude::*};
use glam::{DMat3, DVec3};

/// Lanes of one vector.
const HALF: usize = 8;
/// Over these differences second derivatives of shapes are taken that have no formula of their own, mm.
const SLOPE_STEP: f64 = 1e-4;
/// And derivatives of their sag by curvature, 1/mm.
const CURVATURE_STEP: f64 = 1e-7;

/// A number that a lens depends on; surfaces by number, 0 the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Parameter {
    /// Curvature at the vertex without the polynomial, 1/mm; those of a toroid or biconic grow in proportion.
    Curvature(usize),
    /// Conic constant.
    Conic(usize),
    /// Coefficient of a power of the height, mm^(1 − power).
    Coefficient(usize, usize),
    /// Gap after a surface, mm: all that comes later moves, the film too.
    Gap(usize),
    /// Index of the gap after a surface, at the wavelength of the rays.
    Index(usize),
}

/// What of a ray is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quantity {
    /// x or y where it crosses a plane across the axis behind the lens, mm; the plane moves with the last gap.
    Place(usize),
    /// Direction cosine in x, y or z behind the lens.
    Cosine(usize),
    /// Optical path to that plane, mm.
    Path,
    /// x or y in the frame of the last surface that was traced, where it is met, mm.
    Intersection(usize),
}

/// Derivatives of one quantity of all rays of a packet.
#[derive(Clone, Debug)]
pub(crate) struct Gradient {
    /// By each parameter that was asked for.
    pub by: Vec<Lanes>,
    /// By the place (mm) and the direction (as if it were free) in which the rays started.
    pub by_start: [Lanes; 6],
}

/// How a surface is placed and what it is, ready to be run back through.
#[derive(Clone, Debug)]
struct Step {
    profile: Profile,
    /// Rotation into the local frame, and the place of the vertex.
    frame: Option<(DMat3, DVec3)>,
    mirror: bool,
}

/// What one surface did to a packet.
#[derive(Clone, Debug, Default)]
struct Crossing {
    place: [Lanes; 2],
    /// Before the surface, in its frame.
    direction: [Lanes; 3],
    normal: [Lanes; 3],
    /// From where the rays came to where they met it, mm.
    distance: Lanes,
    /// Direction behind it = index before over index behind × direction + bend × normal.
    bend: Lanes,
    /// Derivative of the bend by the signed cosine of incidence, and by the ratio of the indices.
    bend_by: [Lanes; 2],
    /// 1 over the signed cosine of incidence.
    over_cosine: Lanes,
    /// d²z/dx², d²z/dxdy, d²z/dy².
    second: [Lanes; 3],
    /// Before and behind it; the same of a mirror.
    indices: [f64; 2],
}

/// Parameters in the order in which a reverse pass meets them.
#[derive(Clone, Debug)]
struct Plan {
    count: usize,
    /// Of the shape of each surface.
    shapes: Vec<Vec<(usize, Parameter)>>,
    /// Of the gap after each surface.
    gaps: Vec<Option<usize>>,
    /// Of the index of each gap, by the number of the gap (0 before the first surface).
    indices: Vec<Option<usize>>,
}

/// A lens whose rays can be differentiated.
#[derive(Clone, Debug)]
pub(crate) struct Differentiated {
    steps: Vec<Step>,
    plan: Plan,
    film_z: f64,
}

/// Packets that were traced, with what every surface did.
#[derive(Clone, Debug)]
pub(crate) struct Traced {
    crossings: Vec<Crossing>,
    /// Behind the last surface.
    end: Packet,
    image_index: f64,
}

impl Differentiated {
    /// Prepares a lens as it stands. `None` where derivatives have no formula here: gradients of the index, phases, ideal and Fresnel surfaces, an axis of the object beside the lens's.
    pub fn new(system: &System, parameters: &[Parameter]) -> Option<Differentiated> {
        let plain = |(i, s): (usize, &crate::system::PlacedSurface)| {
            let formula = s.ideal_focal_length.is_none()
                && s.diffractive.is_none()
                && !matches!(s.profile, Profile::Fresnel(_))
                && system.gradients[i].is_none()
                && system.gradients[i + 1].is_none();
            formula.then(|| Step {
                profile: s.profile.clone(),
                frame: s.frame.as_ref().map(|f| (f.1.matrix3, f.0.translation)),
                mirror: s.mirror,
            })
        };
        if system.object_axis.is_some() {
            return None;
        }
        let steps = system.surfaces.iter().enumerate().map(plain).collect::<Option<Vec<_>>>()?;
        let count = steps.len();
        let mut plan = Plan {
            count: parameters.len(),
            shapes: vec![vec![]; count],
            gaps: vec![None; count],
            indices: vec![None; count + 1],
        };
        for (number, p) in parameters.iter().enumerate() {
            match *p {
                Parameter::Curvature(s) | Parameter::Conic(s) | Parameter::Coefficient(s, _) => plan.shapes[s].push((number, *p)),
                Parameter::Gap(s) => plan.gaps[s] = Some(number),
                Parameter::Index(s) => plan.indices[s + 1] = Some(number),
            }
        }
        Some(Differentiated { steps, plan, film_z: system.film_z })
    }

    /// Follows a packet from the object through the first `surfaces` surfaces; `n` holds the indices of all gaps, `lanes` the same for packets.
    /// `None` where a ray does not come through.
    pub fn trace(&self, batch: &Batch, start: &Packet, n: &[f64], lanes: &Indices, surfaces: usize) -> Option<Traced> {
        let mut packet = start.clone();
        let mut crossings = Vec::with_capacity(surfaces);
        for (i, step) in self.steps[..surfaces].iter().enumerate() {
            let before = [packet.dx, packet.dy, packet.dz];
            if batch.trace_part(&mut packet, lanes, TraceDirection::ToFilm, i..i + 1) != u32::MAX >> (32 - LANES) {
                return None;
            }
            let indices = [n[i], if step.mirror { n[i] } else { n[i + 1] }];
            crossings.push(Crossing::default());
            let crossing = &mut crossings[i];
            dispatch!(instruction_set::widest(), simd => cross(simd, step, before, &packet, indices, crossing));
        }
        Some(Traced { crossings, end: packet, image_index: n[surfaces] })
    }

    /// Derivatives of a quantity of rays that were traced, by all parameters.
    pub fn gradient(&self, traced: &Traced, quantity: Quantity) -> Gradient {
        let mut gradient = Gradient { by: vec![[0.0; LANES]; self.plan.count], by_start: [[0.0; LANES]; 6] };
        for half in 0..LANES / HALF {
            dispatch!(instruction_set::widest(), simd => reverse(simd, self, traced, quantity, half * HALF, &mut gradient));
        }
        gradient
    }
}

/// A vector from some of the lanes.
#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &Lanes, from: usize) -> f64x8<S> {
    f64x8::from_slice(simd, &lanes[from..from + HALF])
}

// What is called more than once is no closure: that would not be inlined, and so be compiled without the instructions of the lanes.
#[inline(always)]
fn dot<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> f64x8<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn row<S: Simd>(simd: S, m: &DMat3, r: usize) -> [f64x8<S>; 3] {
    [f64x8::splat(simd, m.col(0)[r]), f64x8::splat(simd, m.col(1)[r]), f64x8::splat(simd, m.col(2)[r])]
}

#[inline(always)]
fn rotated<S: Simd>(simd: S, m: &DMat3, v: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    [dot(row(simd, m, 0), v), dot(row(simd, m, 1), v), dot(row(simd, m, 2), v)]
}

/// Slope over r of a rotational shape, and d²z/dx² = slope/r + x² × second (its derivative by r, over r).
#[inline(always)]
fn round_slopes<S: Simd>(simd: S, c: f64, k: f64, a: &[f64], r2: f64x8<S>) -> [f64x8<S>; 2] {
    let (one, k1c2) = (f64x8::splat(simd, 1.0), f64x8::splat(simd, (1.0 + k) * c * c));
    let root2 = (one - k1c2 * r2).max(f64x8::splat(simd, 1e-12));
    let mut over_r = f64x8::splat(simd, c) / root2.sqrt();
    let mut second = over_r * k1c2 / root2;
    if a.len() > 1 {
        // Σ i aᵢ rⁱ⁻² and Σ i (i − 2) aᵢ rⁱ⁻⁴: lower powers than 0 only of cones, whose tips have no derivatives.
        let r = r2.max(f64x8::splat(simd, 1e-18)).sqrt();
        let inverse = one / r;
        let inverse2 = inverse * inverse;
        let mut power = inverse;
        for (i, a) in a.iter().enumerate().skip(1) {
            let (i, term) = (i as f64, f64x8::splat(simd, *a) * power);
            if *a != 0.0 {
                over_r += term * f64x8::splat(simd, i);
                second += term * inverse2 * f64x8::splat(simd, i * (i - 2.0));
            }
            power *= r;
        }
    }
    [over_r, second]
}

/// What a surface did to a packet that came to it in the directions `before` and stands behind it as `after`.
#[inline(always)]
fn cross<S: Simd>(simd: S, step: &Step, before: [Lanes; 3], after: &Packet, [n0, n1]: [f64; 2], c: &mut Crossing) {
    let o = [0.0; LANES];
    c.indices = [n0, n1];
    c.direction = before;
    c.place = [after.x, after.y];
    let mut away = [after.dx, after.dy, after.dz];
    if let Some((rotation, vertex)) = &step.frame {
        for lane in 0..LANES {
            let turned = |v: [f64; 3]| (*rotation * DVec3::from(v)).to_array();
            let local = turned((DVec3::new(after.x[lane], after.y[lane], after.z[lane]) - *vertex).to_array());
            let (d, e) = (turned(c.direction.map(|d| d[lane])), turned(away.map(|d| d[lane])));
            (0..2).for_each(|i| c.place[i][lane] = local[i]);
            (0..3).for_each(|i| (c.direction[i][lane], away[i][lane]) = (d[i], e[i]));
        }
    }
    let slopes = match step.profile.conic_and_powers() {
        Some(_) => [o; 2],
        None => {
            let mut slopes = [o; 2];
            for lane in 0..LANES {
                let at =
                    |dx: f64, dy: f64| step.profile.slopes(c.place[0][lane] + dx, c.place[1][lane] + dy).unwrap_or([f64::NAN; 2]);
                let half = |dx: f64, dy: f64| {
                    let ([a, b], [e, f]) = (at(dx, dy), at(-dx, -dy));
                    [(a - e) / (2.0 * SLOPE_STEP), (b - f) / (2.0 * SLOPE_STEP)]
                };
                let ([xx, _], [xy, yy], [sx, sy]) = (half(SLOPE_STEP, 0.0), half(0.0, SLOPE_STEP), at(0.0, 0.0));
                (slopes[0][lane], slopes[1][lane]) = (sx, sy);
                (c.second[0][lane], c.second[1][lane], c.second[2][lane]) = (xx, xy, yy);
            }
            slopes
        }
    };
    let one = f64x8::splat(simd, 1.0);
    for from in (0..LANES).step_by(HALF) {
        let to = from + HALF;
        let [x, y] = [0, 1].map(|i| load(simd, &c.place[i], from));
        let [dx, dy, dz] = [0, 1, 2].map(|i| load(simd, &c.direction[i], from));
        let [ex, ey, ez] = [0, 1, 2].map(|i| load(simd, &away[i], from));
        let (incoming, outgoing) = ([dx, dy, dz], [ex, ey, ez]);
        // Slope over r and second, where the shape is rotational.
        let (normal, over_cos0, over_cos1, round);
        match step.profile.conic_and_powers() {
            Some((curvature, 0.0, [])) => {
                // A sphere's root is the normal's z. One division for all that is divided by.
                let curvature = f64x8::splat(simd, curvature);
                let c2 = curvature * curvature;
                let root = (one - c2 * (x * x + y * y)).max(f64x8::splat(simd, 1e-12)).sqrt();
                normal = [-(curvature * x), -(curvature * y), root];
                let (cos0, cos1) = (dot(incoming, normal), dot(outgoing, normal));
                let inverse = one / (root * cos0 * cos1);
                (over_cos0, over_cos1) = (inverse * root * cos1, inverse * root * cos0);
                let over_root = inverse * cos0 * cos1;
                let over_r = curvature * over_root;
                round = Some([over_r, over_r * c2 * over_root * over_root]);
            }
            shape => {
                let (sx, sy);
                round = shape.map(|(curvature, k, a)| round_slopes(simd, curvature, k, a, x * x + y * y));
                (sx, sy) = match round {
                    Some([over_r, _]) => (over_r * x, over_r * y),
                    None => (load(simd, &slopes[0], from), load(simd, &slopes[1], from)),
                };
                let nz = one / (one + sx * sx + sy * sy).sqrt();
                normal = [-(sx * nz), -(sy * nz), nz];
                let (cos0, cos1) = (dot(incoming, normal), dot(outgoing, normal));
                (over_cos0, over_cos1) = (one / cos0, one / cos1);
            }
        }
        if let Some([over_r, second]) = round {
            (over_r + second * x * x).store_slice(&mut c.second[0][from..to]);
            (second * x * y).store_slice(&mut c.second[1][from..to]);
            (over_r + second * y * y).store_slice(&mut c.second[2][from..to]);
        }
        let (cos0, cos1) = (dot(incoming, normal), dot(outgoing, normal));
        let (bend, by_cosine, by_ratio);
        if step.mirror {
            bend = -(cos0 + cos0);
            by_cosine = f64x8::splat(simd, -2.0);
            by_ratio = f64x8::splat(simd, 0.0);
        } else {
            let ratio = f64x8::splat(simd, n0 / n1);
            bend = cos1 - ratio * cos0;
            by_cosine = -(ratio * bend * over_cos1);
            by_ratio = -(ratio * (one - cos0 * cos0) * over_cos1) - cos0;
        }
        (0..3).for_each(|i| normal[i].store_slice(&mut c.normal[i][from..to]));
        (load(simd, &after.path, from) * f64x8::splat(simd, 1.0 / n0)).store_slice(&mut c.distance[from..to]);
        bend.store_slice(&mut c.bend[from..to]);
        by_cosine.store_slice(&mut c.bend_by[0][from..to]);
        by_ratio.store_slice(&mut c.bend_by[1][from..to]);
        over_cos0.store_slice(&mut c.over_cosine[from..to]);
    }
}

/// Derivatives of the sag and of the slopes in x and y by a parameter of the shape, at a place.
fn shape_by(profile: &Profile, parameter: Parameter, x: f64, y: f64) -> [f64; 3] {
    if let Some((c, k, _)) = profile.conic_and_powers() {
        let r2 = x * x + y * y;
        let root2 = (1.0 - (1.0 + k) * c * c * r2).max(1e-12);
        let root = root2.sqrt();
        let (sag, over_r) = match parameter {
            Parameter::Curvature(_) => (r2 / (root * (1.0 + root)), 1.0 / (root * root2)),
            Parameter::Conic(_) => {
                let c3 = c * c * c;
                (c3 * r2 * r2 / (2.0 * root * (1.0 + root) * (1.0 + root)), c3 * r2 / (2.0 * root * root2))
            }
            Parameter::Coefficient(_, power) => {
                let r = r2.sqrt();
                (r.powi(power as i32), if r > 0.0 || power >= 2 { power as f64 * r.powi(power as i32 - 2) } else { 0.0 })
            }
            Parameter::Gap(_) | Parameter::Index(_) => (0.0, 0.0),
        };
        return [sag, over_r * x, over_r * y];
    }
    let at = |step: f64| {
        let bent = crate::tolerance::bent_to(profile, profile.base_curvature() + step);
        let [sx, sy] = bent.slopes(x, y).unwrap_or([f64::NAN; 2]);
        [bent.sag(x, y).unwrap_or(f64::NAN), sx, sy]
    };
    match parameter {
        Parameter::Curvature(_) => {
            let (more, less) = (at(CURVATURE_STEP), at(-CURVATURE_STEP));
            std::array::from_fn(|i| (more[i] - less[i]) / (2.0 * CURVATURE_STEP))
        }
        _ => [0.0; 3],
    }
}

/// Derivative of the sag by a parameter of the shape, mm a unit of it.
pub(crate) fn sag_by(profile: &Profile, parameter: Parameter, x: f64, y: f64) -> f64 {
    shape_by(profile, parameter, x, y)[0]
}

/// Runs the derivatives of a quantity back through all surfaces that eight of the rays crossed.
#[inline(always)]
fn reverse<S: Simd>(simd: S, lens: &Differentiated, traced: &Traced, quantity: Quantity, from: usize, out: &mut Gradient) {
    let to = from + HALF;
    let zero = f64x8::splat(simd, 0.0);
    let one = f64x8::splat(simd, 1.0);
    // Derivatives by place and direction behind the surface at hand, by the optical path so far, and by a shift of all that comes later.
    let (mut p, mut d) = ([zero; 3], [zero; 3]);
    let mut path = zero;
    let mut shift = zero;
    let mut met = [zero; 2];
    let mut index_after = zero;
    let end = &traced.end;
    let [ex, ey, ez] = [&end.dx, &end.dy, &end.dz].map(|v| load(simd, v, from));
    match quantity {
        Quantity::Place(axis) => {
            let t = (f64x8::splat(simd, lens.film_z) - load(simd, &end.z, from)) / ez;
            let slope = if axis == 0 { ex } else { ey } / ez;
            p[axis] = one;
            p[2] = -slope;
            d[axis] = t;
            d[2] = -(slope * t);
            shift = slope;
        }
        Quantity::Cosine(axis) => d[axis] = one,
        Quantity::Path => {
            let t = (f64x8::splat(simd, lens.film_z) - load(simd, &end.z, from)) / ez;
            let n = f64x8::splat(simd, traced.image_index) / ez;
            (p[2], d[2], shift) = (-n, -(n * t), n);
            path = one;
            index_after = t;
        }
        Quantity::Intersection(axis) => met[axis] = one,
    }
    for (i, c) in traced.crossings.iter().enumerate().rev() {
        let step = &lens.steps[i];
        if let Some(number) = lens.plan.gaps[i] {
            shift.store_slice(&mut out.by[number][from..to]);
        }
        if let Some((rotation, _)) = &step.frame {
            (p, d) = (rotated(simd, rotation, p), rotated(simd, rotation, d));
        }
        let normal = [0, 1, 2].map(|k| load(simd, &c.normal[k], from));
        let before = [0, 1, 2].map(|k| load(simd, &c.direction[k], from));
        let [x, y] = [0, 1].map(|k| load(simd, &c.place[k], from));
        let [bend, t, over_cosine] = [&c.bend, &c.distance, &c.over_cosine].map(|v| load(simd, v, from));
        let ratio = f64x8::splat(simd, c.indices[0] / c.indices[1]);
        let [by_cosine, by_ratio] = [0, 1].map(|k| load(simd, &c.bend_by[k], from));
        let [xx, xy, yy] = [0, 1, 2].map(|k| load(simd, &c.second[k], from));
        let bent = dot(d, normal);
        let turned = by_cosine * bent;
        // By the normal, less what lies along it; then by the slopes.
        let by_normal = [0, 1, 2].map(|k| bend * d[k] + turned * before[k]);
        let along = dot(by_normal, normal);
        let by_slope = [0, 1].map(|k| (along * normal[k] - by_normal[k]) * normal[2]);
        let behind = p;
        p[0] = p[0] + by_slope[0] * xx + by_slope[1] * xy + met[0];
        p[1] = p[1] + by_slope[0] * xy + by_slope[1] * yy + met[1];
        met = [zero; 2];
        let n0 = f64x8::splat(simd, c.indices[0]);
        let by_distance = (dot(p, before) + n0 * path) * over_cosine;
        let by_sag = by_distance * normal[2];
        let by_index = dot(d, before) + bent * by_ratio;
        p = [0, 1, 2].map(|k| p[k] - normal[k] * by_distance);
        d = [0, 1, 2].map(|k| ratio * d[k] + turned * normal[k] + t * p[k]);
        let moved = [0, 1, 2].map(|k| behind[k] - p[k]);
        shift += match &step.frame {
            None => moved[2],
            Some((rotation, _)) => rotated(simd, &rotation.transpose(), moved)[2],
        };
        // Mirrors do not know an index: only paths on either side do.
        let by_ratio_of_indices = if step.mirror { zero } else { by_index * f64x8::splat(simd, 1.0 / c.indices[1]) };
        if let Some(number) = lens.plan.indices[i + 1] {
            (index_after - by_ratio_of_indices * ratio).store_slice(&mut out.by[number][from..to]);
        }
        index_after = t * path + by_ratio_of_indices;
        for (number, parameter) in &lens.plan.shapes[i] {
            let [sag, sx, sy] = match (step.profile.conic_and_powers(), parameter) {
                (Some((c, k, _)), Parameter::Curvature(_)) => {
                    let r2 = x * x + y * y;
                    let root2 = (one - f64x8::splat(simd, (1.0 + k) * c * c) * r2).max(f64x8::splat(simd, 1e-12));
                    let root = root2.sqrt();
                    let over = one / (root * root2 * (one + root));
                    let steep = over * (one + root);
                    [r2 * root2 * over, steep * x, steep * y]
                }
                _ => {
                    let mut by = [[0.0; HALF]; 3];
                    for lane in 0..HALF {
                        let at = shape_by(&step.profile, *parameter, c.place[0][from + lane], c.place[1][from + lane]);
                        (0..3).for_each(|k| by[k][lane] = at[k]);
                    }
                    by.map(|b| f64x8::from_slice(simd, &b))
                }
            };
            (by_sag * sag + by_slope[0] * sx + by_slope[1] * sy).store_slice(&mut out.by[*number][from..to]);
        }
        if let Some((rotation, _)) = &step.frame {
            (p, d) = (rotated(simd, &rotation.transpose(), p), rotated(simd, &rotation.transpose(), d));
        }
    }
    for k in 0..3 {
        p[k].store_slice(&mut out.by_start[k][from..to]);
        d[k].store_slice(&mut out.by_start[3 + k][from..to]);
    }
}

#[cfg(test)]
mod tests;

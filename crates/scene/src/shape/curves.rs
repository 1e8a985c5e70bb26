//! Curves with a width: hair, fur, grass, threads. Many strands in one set, intersected as the cubic segments they are.
//!
//! Control points carry place and radius as one spline in four dimensions, so that neighbouring segments share them: 16 bytes a segment of a
//! B-spline, 48 of a Bézier curve, whose widths may change from point to point. A segment (or, in small sets, a piece of one) is a primitive of the
//! set's hierarchy. A ray meets a segment by recursive subdivision in a frame that looks along the ray, as K. Nakamaru and Y. Ohno 2002, "Ray
//! Tracing for Curves Primitive" (WSCG), and PBR 4ed §6.7 describe; ribbons are solved for as the surfaces they are, with Newton's method.
//!
//! Limits: a flat or round curve is met in the plane through its centre line that faces the ray, and its ends are cut off flat; seen exactly along
//! its own direction it is not met.

use crate::bvh::{Bounds, Primitive, Primitives};
use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};

/// What the section of a curve is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum CurveKind {
    /// A band that faces every ray: thin hair.
    Flat,
    /// The same with the normals of a round tube.
    Cylinder,
    /// A band that faces where its normals point: blades of grass.
    Ribbon,
}

/// How control points make a cubic segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum CurveBasis {
    /// Bernstein polynomials: a segment begins and ends at control points, every third is shared.
    Bezier,
    /// Uniform B-splines: a segment begins at each control point but the last three.
    BSpline,
}

/// A set of curves of one kind.
#[derive(Clone, Debug)]
pub struct Curves {
    /// Section.
    pub kind: CurveKind,
    /// Meaning of the control points.
    pub basis: CurveBasis,
    /// Control points: x, y, z and radius, m.
    pub points: Vec<Vec4>,
    /// First of the four control points of each segment.
    pub segments: Vec<u32>,
    /// Unit normals at the beginning and the end of each segment of ribbons; empty for other kinds.
    pub normals: Vec<[Vec3; 2]>,
}

/// A place of a segment's centre line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Where, m.
    pub center: Vec3,
    /// Unit direction in which the curve runs.
    pub tangent: Vec3,
    /// Half of the width, m.
    pub radius: f32,
}

/// Where a ray meets a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveHit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Along the segment, 0 to 1.
    pub u: f32,
    /// Across it, 0 to 1; see [`Curves::across`] for the sense.
    pub v: f32,
}

/// Most segments of a set: numbers of primitives have 30 bits.
pub const MOST_SEGMENTS: usize = 1 << 30;
/// Sets whose segments are cut into no more pieces than these are cut, up to eight pieces a segment: their boxes fit more closely. A piece takes
/// some 60 bytes of the hierarchy.
const MOST_PIECES: usize = 1 << 21;
/// From this coordinate on (m) a segment is left out: squares of such lengths are hardly numbers of single precision.
const FARTHEST: f32 = 1e18;
/// Most halvings of a segment for the hierarchy.
const MOST_LEVELS: u32 = 3;
/// Most halvings on the way to a piece that is taken for straight.
const DEEPEST: f32 = 10.0;
/// Distance between a curve and the straight piece that stands for it, in radii: a twentieth of the width (PBR 4ed §6.7.1).
const FLATNESS: f32 = 0.1;
/// Steps of Newton's method on a ribbon.
const NEWTON_STEPS: usize = 4;

/// Four control points of a Bézier segment.
type Cubic = [Vec4; 4];

impl Curves {
    /// A set without curves.
    pub fn new(kind: CurveKind, basis: CurveBasis) -> Self {
        Curves { kind, basis, points: Vec::new(), segments: Vec::new(), normals: Vec::new() }
    }

    /// Adds a curve (m) whose width changes evenly over its parameter from one end to the other; `radii` (m) are those of both ends, `normals`, for ribbons, those at the
    /// ends of its segments. A number of control points that does not fit the basis is cut down to one that does; with less than four nothing is added.
    pub fn push(&mut self, points: &[Vec3], radii: [f32; 2], normals: &[Vec3]) {
        let (step, least) = match self.basis {
            CurveBasis::Bezier => (3, 4),
            CurveBasis::BSpline => (1, 4),
        };
        if points.len() < least {
            return;
        }
        let count = (points.len() - least) / step + 1;
        let first = self.points.len();
        // A straight line through the places at which the basis puts a control point (Greville abscissae) makes a spline that is straight.
        let radius = |j: usize| {
            let x = match self.basis {
                CurveBasis::Bezier => j as f32 / (3 * count) as f32,
                CurveBasis::BSpline => (j as f32 - 1.0) / count as f32,
            };
            radii[0] + (radii[1] - radii[0]) * x
        };
        let used = &points[..least + (count - 1) * step];
        self.points.extend(used.iter().enumerate().map(|(j, p)| p.extend(radius(j))));
        self.segments.extend((0..count).map(|i| (first + i * step) as u32));
        if self.kind == CurveKind::Ribbon {
            let at = |i: usize| normals.get(i).or(normals.last()).copied().unwrap_or(Vec3::Z);
            self.normals.extend((0..count).map(|i| [at(i), at(i + 1)]));
        }
    }

    /// Bytes of memory held.
    pub fn memory(&self) -> usize {
        self.points.len() * 16 + self.segments.len() * 4 + self.normals.len() * 24
    }

    /// The box around all of it, widths included, m.
    pub fn bounds(&self) -> Bounds {
        let one = |segment: u32| hull(&self.cubic(segment as usize));
        (0..self.segments.len() as u32).map(one).fold(Bounds::EMPTY, Bounds::union)
    }

    /// The box around one segment, its width included, m. Panics on a number that is no segment's.
    pub fn segment_bounds(&self, segment: usize) -> Bounds {
        hull(&self.cubic(segment))
    }

    /// Whether all its segments are finite (below 1e18 m) and have a length and a width.
    pub fn all_usable(&self) -> bool {
        self.segments.iter().all(|first| self.is_usable(*first))
    }

    fn is_usable(&self, first: u32) -> bool {
        let first = first as usize;
        let Some(controls) = self.points.get(first..first.saturating_add(4)) else { return false };
        let widest = controls.iter().map(|p| p.w).fold(0.0, f32::max);
        let is_near = |p: &Vec4| p.is_finite() && p.abs().max_element() < FARTHEST;
        controls.iter().all(is_near) && widest > 0.0 && controls.iter().any(|p| p.xyz() != controls[0].xyz())
    }

    /// Removes segments that no ray can meet: with numbers that are not finite, without width, or of no length. Returns how many.
    pub fn drop_unusable_segments(&mut self) -> usize {
        let keep: Vec<bool> = self.segments.iter().map(|first| self.is_usable(*first)).collect();
        let before = self.segments.len();
        if keep.iter().all(|k| *k) {
            return 0;
        }
        let mut kept = keep.iter();
        self.segments.retain(|_| *kept.next().unwrap_or(&false));
        if !self.normals.is_empty() {
            let mut kept = keep.iter();
            self.normals.retain(|_| *kept.next().unwrap_or(&false));
        }
        before - self.segments.len()
    }

    /// Bézier control points of a segment.
    #[inline]
    fn cubic(&self, segment: usize) -> Cubic {
        let first = self.segments[segment] as usize;
        let p: [Vec4; 4] = std::array::from_fn(|i| self.points[first + i]);
        match self.basis {
            CurveBasis::Bezier => p,
            // Knots doubled and tripled until the ends are met.
            CurveBasis::BSpline => [
                (p[0] + p[1] * 4.0 + p[2]) * (1.0 / 6.0),
                (p[1] * 2.0 + p[2]) * (1.0 / 3.0),
                (p[1] + p[2] * 2.0) * (1.0 / 3.0),
                (p[1] + p[2] * 4.0 + p[3]) * (1.0 / 6.0),
            ],
        }
    }

    /// A place of a segment's centre line (m), by its parameter from 0 to 1. Panics on a number that is no segment's.
    pub fn at(&self, segment: u32, u: f32) -> CurvePoint {
        let p = self.cubic(segment as usize);
        let (center, derivative) = evaluate(&p, u);
        let chord = (p[3] - p[0]).xyz();
        let tangent = derivative.xyz().try_normalize().or_else(|| chord.try_normalize()).unwrap_or(Vec3::X);
        CurvePoint { center: center.xyz(), tangent, radius: center.w.max(0.0) }
    }

    /// Unit vector across a curve at one of its places, in the direction in which v of hits grows: n × t, where n is a ribbon's normal, or, for
    /// other kinds, points against the ray's direction.
    pub fn across(&self, segment: u32, u: f32, tangent: Vec3, direction: Vec3) -> Vec3 {
        let n = match self.kind {
            CurveKind::Ribbon => slerp(self.normals[segment as usize], u),
            _ => -direction,
        };
        n.cross(tangent).try_normalize().unwrap_or_else(|| tangent.any_orthonormal_vector())
    }

    /// Binary subdivisions of a segment in the hierarchy, which holds 2^levels pieces of each.
    pub fn levels(&self) -> u32 {
        (0..MOST_LEVELS).take_while(|k| self.segments.len() << (k + 1) <= MOST_PIECES).count() as u32
    }

    /// The nearest place with 0 < t < `t_max` where a ray meets a piece of a segment (the first that is found, for `any`); `accept` is asked with
    /// the coordinates along and across whether it counts. `piece` is segment · 2^`levels` + the piece in it; t counts in lengths of the direction.
    pub fn intersect(
        &self,
        piece: u32,
        levels: u32,
        (origin, direction): (Vec3, Vec3),
        t_max: f32,
        any: bool,
        accept: &impl Fn(u32, f32, f32) -> bool,
    ) -> Option<CurveHit> {
        let segment = (piece >> levels) as usize;
        let whole = self.cubic(segment);
        let length = direction.length();
        let z = direction / length;
        // Along the chord the box around the projected curve is long, across it narrow.
        let chord = (whole[3] - whole[0]).xyz();
        let y = z.cross(chord).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
        let x = y.cross(z);
        let turned = |v: Vec3| Vec3::new(v.dot(x), v.dot(y), v.dot(z));
        let whole = whole.map(|p| turned(p.xyz() - origin).extend(p.w));
        let u = piece_range(piece, levels);
        let controls = if levels == 0 { whole } else { part(&whole, u) };

        // So many halvings make it straight (PBR 4ed §6.7.1, after Wang's bound on the second differences).
        let bend = |i: usize| (controls[i] - controls[i + 1] * 2.0 + controls[i + 2]).xyz().abs().max_element();
        let widest = widest(&controls);
        if !(widest > 0.0) {
            return None;
        }
        let halvings = 0.5 * (std::f32::consts::SQRT_2 * 6.0 * bend(0).max(bend(1)) / (8.0 * FLATNESS * widest)).log2();
        let depth = halvings.ceil().clamp(0.0, DEEPEST) as u32;
        let normals = (self.kind == CurveKind::Ribbon).then(|| self.normals[segment].map(turned));
        let segment = segment as u32;
        let mut search = Search { whole, normals, segment, limit: t_max * length, length, any, accept, best: None };
        search.descend(&controls, u, depth);
        search.best
    }
}

/// The range of a segment's parameter that a piece has.
fn piece_range(piece: u32, levels: u32) -> [f32; 2] {
    let pieces = 1u32 << levels;
    let i = piece & (pieces - 1);
    [i, i + 1].map(|k| k as f32 / pieces as f32)
}

fn widest(p: &Cubic) -> f32 {
    p[0].w.max(p[1].w).max(p[2].w.max(p[3].w))
}

/// The box around a segment: control points hold the curve between them.
fn hull(p: &Cubic) -> Bounds {
    let (low, high) = (p[0].min(p[1]).min(p[2].min(p[3])), p[0].max(p[1]).max(p[2].max(p[3])));
    let pad = widest(p).max(0.0) + 4.0 * f32::EPSILON * low.xyz().abs().max(high.xyz().abs()).max_element();
    Bounds { min: low.xyz() - pad, max: high.xyz() + pad }
}

/// Point and derivative. Source: P. de Casteljau's algorithm.
#[inline]
fn evaluate(p: &Cubic, u: f32) -> (Vec4, Vec4) {
    let [a, b, c] = [0, 1, 2].map(|i: usize| p[i] + (p[i + 1] - p[i]) * u);
    let (d, e) = (a + (b - a) * u, b + (c - b) * u);
    (d + (e - d) * u, (e - d) * 3.0)
}

/// Control points of the part of a curve between two parameters, by its blossom (Ramshaw 1987).
fn part(p: &Cubic, [from, to]: [f32; 2]) -> Cubic {
    let blossom = |u: [f32; 3]| {
        let [a, b, c] = [0, 1, 2].map(|i: usize| p[i] * (1.0 - u[0]) + p[i + 1] * u[0]);
        let (d, e) = (a * (1.0 - u[1]) + b * u[1], b * (1.0 - u[1]) + c * u[1]);
        d * (1.0 - u[2]) + e * u[2]
    };
    [[from; 3], [from, from, to], [from, to, to], [to; 3]].map(blossom)
}

/// Between two unit vectors, turning evenly.
fn slerp([a, b]: [Vec3; 2], u: f32) -> Vec3 {
    let angle = a.angle_between(b);
    let sin = angle.sin();
    if sin < 1e-4 {
        return a.lerp(b, u);
    }
    (a * ((1.0 - u) * angle).sin() + b * (u * angle).sin()) / sin
}

/// A ray on its way through one segment, in a frame whose z is the ray.
struct Search<'a, A> {
    whole: Cubic,
    normals: Option<[Vec3; 2]>,
    segment: u32,
    /// Distance along the ray up to which there is something to be found, m.
    limit: f32,
    /// Of the ray's direction.
    length: f32,
    any: bool,
    accept: &'a A,
    best: Option<CurveHit>,
}

impl<A: Fn(u32, f32, f32) -> bool> Search<'_, A> {
    /// Looks for hits in a piece; whether enough is found.
    fn descend(&mut self, p: &Cubic, u: [f32; 2], depth: u32) -> bool {
        let (low, high) = (p[0].min(p[1]).min(p[2].min(p[3])), p[0].max(p[1]).max(p[2].max(p[3])));
        let r = high.w;
        if low.x > r || high.x < -r || low.y > r || high.y < -r || high.z < -r || low.z - r > self.limit {
            return false;
        }
        if depth == 0 {
            return match self.normals {
                None => self.facing(p, u),
                Some(normals) => self.ribbon(p, u, normals),
            };
        }
        let [a, b, c] = [0, 1, 2].map(|i: usize| (p[i] + p[i + 1]) * 0.5);
        let (d, e) = ((a + b) * 0.5, (b + c) * 0.5);
        let (middle, half) = ((d + e) * 0.5, 0.5 * (u[0] + u[1]));
        self.descend(&[p[0], a, d, middle], [u[0], half], depth - 1)
            || self.descend(&[middle, e, c, p[3]], [half, u[1]], depth - 1)
    }

    /// A piece that is nearly straight and turns towards the ray (PBR 4ed §6.7.1).
    fn facing(&mut self, p: &Cubic, u: [f32; 2]) -> bool {
        // The ray must pass between the lines across both ends.
        let flat = [0, 1, 2, 3].map(|i: usize| p[i].xy());
        if (flat[1] - flat[0]).dot(-flat[0]) < 0.0 || (flat[2] - flat[3]).dot(-flat[3]) < 0.0 {
            return false;
        }
        let chord = flat[3] - flat[0];
        let length2 = chord.length_squared();
        if !(length2 > 0.0) {
            return false;
        }
        let w = (chord.dot(-flat[0]) / length2).clamp(0.0, 1.0);
        let (center, derivative) = evaluate(p, w);
        let (away2, radius) = (center.xy().length_squared(), center.w);
        if !(radius > 0.0 && away2 <= radius * radius && center.z > 0.0 && center.z < self.limit) {
            return false;
        }
        // The ray lies at −center; across points along (−z) × tangent.
        let side = center.y * derivative.x - center.x * derivative.y;
        let v = (0.5 + (0.5 * away2.sqrt() / radius).copysign(side)).clamp(0.0, 1.0);
        self.found(u[0] + (u[1] - u[0]) * w, v, center.z)
    }

    /// A piece of a ribbon: where c(u) + w r(u) a(u) crosses the ray, with a across the band and −1 ≤ w ≤ 1.
    fn ribbon(&mut self, p: &Cubic, range: [f32; 2], normals: [Vec3; 2]) -> bool {
        let chord = (p[3] - p[0]).xy();
        let along = chord.dot(-p[0].xy()) / chord.length_squared().max(f32::MIN_POSITIVE);
        let span = range[1] - range[0];
        let (mut u, mut w) = (range[0] + span * along.clamp(0.0, 1.0), 0.0f32);
        for step in 0..=NEWTON_STEPS {
            let (center, derivative) = evaluate(&self.whole, u);
            let tangent = derivative.xyz();
            let Some(across) = slerp(normals, u).cross(tangent).try_normalize() else { return false };
            let across = across * center.w;
            let off: Vec2 = center.xy() + across.truncate() * w;
            if step == NEWTON_STEPS {
                let (margin, z) = (1e-4 * span, center.z + across.z * w);
                let inside = (range[0] - margin..=range[1] + margin).contains(&u) && (0.0..=1.0).contains(&u) && w.abs() <= 1.0;
                let met = off.length_squared() <= (0.01 * center.w).powi(2) && z > 0.0 && z < self.limit;
                return inside && met && self.found(u, 0.5 + 0.5 * w, z);
            }
            let determinant = tangent.x * across.y - tangent.y * across.x;
            if determinant == 0.0 {
                return false;
            }
            u = (u - (off.x * across.y - off.y * across.x) / determinant).clamp(range[0] - span, range[1] + span);
            w = (w - (tangent.x * off.y - tangent.y * off.x) / determinant).clamp(-2.0, 2.0);
        }
        false
    }

    fn found(&mut self, u: f32, v: f32, z: f32) -> bool {
        if !(self.accept)(self.segment, u, v) {
            return false;
        }
        self.limit = z;
        self.best = Some(CurveHit { t: z / self.length, u, v });
        self.any
    }
}

/// The pieces of a set as primitives of its hierarchy.
pub(crate) struct CurvePieces<'a> {
    pub curves: &'a Curves,
    pub levels: u32,
}

impl Primitives for CurvePieces<'_> {
    fn len(&self) -> usize {
        self.curves.segments.len() << self.levels
    }
    fn get(&self, index: usize) -> Primitive {
        let whole = self.curves.cubic(index >> self.levels);
        let id = index as u32;
        let bounds = if self.levels == 0 { hull(&whole) } else { hull(&part(&whole, piece_range(id, self.levels))) };
        Primitive::Other { bounds, id }
    }
}

/// The strand that a surface point belongs to: a tube about its centre line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strand {
    /// The nearest point of the centre line, m.
    pub center: Vec3,
    /// Radius of the tube, m; 0 of a ribbon, which is a surface as others are.
    pub radius: f32,
}

impl Strand {
    /// A start for rays that leave a point in the tube along a unit direction: where they come out of it, past what rounding can have moved the
    /// point. From there on the centre line lies behind them, so that they do not meet the same strand again.
    pub fn exit(&self, point: Vec3, axis: Vec3, direction: Vec3) -> Vec3 {
        /// Longest way through the tube of light that runs nearly along it, in radii.
        const LONGEST: f32 = 32.0;
        let a = axis.normalize_or_zero();
        let perpendicular = |v: Vec3| v - a * a.dot(v);
        let (b, d) = (perpendicular(point - self.center), perpendicular(direction));
        let (along, d2) = (b.dot(d), d.length_squared().max(1e-12));
        let root = (along * along - d2 * (b.length_squared() - self.radius * self.radius)).max(0.0).sqrt();
        let way = ((root - along) / d2).clamp(0.0, LONGEST * self.radius);
        let rounding = 8.0 * f32::EPSILON * point.abs().max_element() + 1e-3 * self.radius;
        point + direction * (way + rounding)
    }
}

#[cfg(test)]
mod tests;

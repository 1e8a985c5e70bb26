//! A tree over lights: each step goes to a part by what it can contribute to the point in question.
//!
//! Source: Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting" (without the
//! splitting), in the form of PBR 12.6.3, four children a node. For a segment of a ray in a scattering medium: by what reaches all of it.

use super::lanes::{angles, square_roots};
use super::segment::Segment;
use crate::bvh::Bounds;
use glam::{BVec4A, Vec3, Vec4};
use std::array::from_fn;
use std::f32::consts::PI;

/// Square of the angle (rad²) below which directions to a segment are those to its ends.
const LEAST_ARC2: f32 = 1e-8;

/// Squarings in (1 + x/64)⁻⁶⁴, which stands for e⁻ˣ.
const SQUARINGS: u32 = 6;

/// What is known of a light or of many: where, which way, how strong.
#[derive(Clone, Copy, Debug)]
pub struct LightBounds {
    bounds: Bounds,
    /// Cone that holds all normals: axis and cosine of its half angle.
    axis: Vec3,
    cos_spread: f32,
    /// Cosine of the angle to a normal beyond which nothing is emitted.
    cos_emission: f32,
    two_sided: bool,
    power: f32,
}

impl LightBounds {
    /// `axis`: unit axis of the cone of normals; `spread` and `emission`: half angles (rad) of the cone of normals and of emission about a normal; `power` in lm, or all
    /// in one other unit.
    pub fn new(bounds: Bounds, axis: Vec3, spread: f32, emission: f32, two_sided: bool, power: f32) -> Self {
        LightBounds { bounds, axis, cos_spread: spread.cos(), cos_emission: emission.cos(), two_sided, power }
    }

    /// The same light if it may be anywhere in a box and face any way.
    pub fn anywhere_in(self, bounds: Bounds) -> Self {
        LightBounds { bounds, cos_spread: -1.0, ..self }
    }

    fn union(self, other: LightBounds) -> LightBounds {
        if self.power == 0.0 {
            return other;
        }
        if other.power == 0.0 {
            return self;
        }
        let (axis, cos_spread) = union_of_cones((self.axis, self.cos_spread), (other.axis, other.cos_spread));
        LightBounds {
            bounds: self.bounds.union(other.bounds),
            axis,
            cos_spread,
            cos_emission: self.cos_emission.min(other.cos_emission),
            two_sided: self.two_sided || other.two_sided,
            power: self.power + other.power,
        }
    }

    /// Cost of lights in one node: power × solid angle × area. Source: Conty Estevez & Kulla 2018, eq. 1.
    fn cost(&self) -> f32 {
        let (to, te) = (self.cos_spread.clamp(-1.0, 1.0).acos(), self.cos_emission.acos());
        let tw = (to + te).min(PI);
        let sin_o = to.sin();
        let omega = 2.0 * PI * (1.0 - self.cos_spread)
            + PI / 2.0 * (2.0 * tw * sin_o - (to - 2.0 * tw).cos() - 2.0 * to * sin_o + self.cos_spread);
        self.power * omega * self.bounds.half_area().max(1e-12)
    }

    /// Upper estimate of what these lights can contribute at `p` with normal `n`, up to a constant factor: of all, and the plain twin of [`Node::importances`].
    fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        let center = self.bounds.center();
        let to_point = p - center;
        let radius2 = self.bounds.size().length_squared() * 0.25;
        let d2_true = to_point.length_squared();
        let d2 = d2_true.max(radius2).max(1e-12);
        let w = if d2_true > 0.0 { to_point / d2_true.sqrt() } else { Vec3::Z };
        // Angle under which the box is seen.
        let (sin_b, cos_b) =
            if d2_true <= radius2 { (0.0, -1.0) } else { ((radius2 / d2_true).sqrt(), (1.0 - radius2 / d2_true).sqrt()) };
        let sin_of = |c: f32| (1.0 - c * c).max(0.0).sqrt();
        // cos(max(0, a − b)) and sin of it.
        let cos_less = |sa: f32, ca: f32, sb: f32, cb: f32| if ca > cb { 1.0 } else { ca * cb + sa * sb };
        let sin_less = |sa: f32, ca: f32, sb: f32, cb: f32| if ca > cb { 0.0 } else { sa * cb - ca * sb };
        let cos_w = {
            let c = self.axis.dot(w);
            if self.two_sided { c.abs() } else { c }
        };
        let sin_w = sin_of(cos_w);
        let sin_o = sin_of(self.cos_spread);
        let cos_x = cos_less(sin_w, cos_w, sin_o, self.cos_spread);
        let sin_x = sin_less(sin_w, cos_w, sin_o, self.cos_spread);
        let cos_out = cos_less(sin_x, cos_x, sin_b, cos_b);
        if cos_out <= self.cos_emission {
            return 0.0;
        }
        let mut importance = self.power * cos_out.max(0.0) / d2;
        if n != Vec3::ZERO {
            let cos_i = n.dot(-w).abs();
            importance *= cos_less(sin_of(cos_i), cos_i, sin_b, cos_b).max(0.0);
        }
        importance
    }
}

fn sin_of(cos: f32) -> f32 {
    (1.0 - cos * cos).max(0.0).sqrt()
}

/// The smallest cone around two, as axis and cosine of the half angle.
fn union_of_cones(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (ta, tb) = (a.1.clamp(-1.0, 1.0).acos(), b.1.clamp(-1.0, 1.0).acos());
    let between = a.0.dot(b.0).clamp(-1.0, 1.0).acos();
    if (between + tb).min(PI) <= ta {
        return a;
    }
    if (between + ta).min(PI) <= tb {
        return b;
    }
    let spread = (ta + between + tb) / 2.0;
    let turn = a.0.cross(b.0);
    if spread >= PI || turn.length_squared() < 1e-12 {
        return (a.0, -1.0);
    }
    let axis = glam::Quat::from_axis_angle(turn.normalize(), spread - ta) * a.0;
    (axis.normalize(), spread.cos())
}

/// Children of a node.
const WIDTH: usize = 4;
/// The node above the root.
const NOTHING: u32 = u32::MAX;

/// Up to four children: lights, or nodes of some. What is known of them for points in the open stands side by side.
#[derive(Clone, Debug)]
struct Node {
    count: usize,
    child: [Child; WIDTH],
    /// Where the parent has this node: [`WIDTH`] times its number, and which child.
    place: u32,
    /// Middles of the boxes (x, y, z) and squares of half their diagonals.
    center: [Vec4; 3],
    radius2: Vec4,
    axis: [Vec4; 3],
    cos_spread: Vec4,
    sin_spread: Vec4,
    cos_emission: Vec4,
    two_sided: BVec4A,
    power: Vec4,
}

#[derive(Clone, Copy, Debug)]
enum Child {
    Light(u32),
    Node(u32),
}

impl Node {
    fn new(children: &[LightBounds], place: u32) -> Node {
        // Children that are not there have no power.
        let none = LightBounds::new(Bounds { min: Vec3::ZERO, max: Vec3::ZERO }, Vec3::Z, PI, PI / 2.0, false, 0.0);
        let lights: [LightBounds; WIDTH] = from_fn(|k| children.get(k).copied().unwrap_or(none));
        let lanes = |f: &dyn Fn(&LightBounds) -> f32| Vec4::from_array(lights.each_ref().map(f));
        let [two_sided_0, two_sided_1, two_sided_2, two_sided_3] = lights.map(|l| l.two_sided);
        Node {
            count: children.len(),
            child: [Child::Light(0); WIDTH],
            place,
            center: from_fn(|axis| lanes(&|l| l.bounds.center()[axis])),
            radius2: lanes(&|l| l.bounds.size().length_squared() * 0.25),
            axis: from_fn(|axis| lanes(&|l| l.axis[axis])),
            cos_spread: lanes(&|l| l.cos_spread),
            sin_spread: lanes(&|l| sin_of(l.cos_spread)),
            cos_emission: lanes(&|l| l.cos_emission),
            two_sided: BVec4A::new(two_sided_0, two_sided_1, two_sided_2, two_sided_3),
            power: lanes(&|l| l.power),
        }
    }

    /// [`LightBounds::importance`] of each child.
    #[inline]
    fn importances(&self, p: Vec3, n: Vec3) -> Vec4 {
        let to_point: [Vec4; 3] = from_fn(|k| Vec4::splat(p[k]) - self.center[k]);
        let d2_true = length_squared(&to_point);
        let d2 = d2_true.max(self.radius2).max(Vec4::splat(1e-12));
        let inverse = Vec4::select(d2_true.cmpgt(Vec4::ZERO), square_roots(d2_true).recip(), Vec4::ZERO);
        let toward = to_point.map(|v| v * inverse);
        // Angle under which the box is seen.
        let inside = d2_true.cmple(self.radius2);
        let seen = self.radius2 * (inverse * inverse);
        let sin_b = Vec4::select(inside, Vec4::ZERO, square_roots(seen));
        let cos_b = Vec4::select(inside, Vec4::NEG_ONE, square_roots((Vec4::ONE - seen).max(Vec4::ZERO)));
        let cos_w = dot(&self.axis, &toward);
        let cos_w = Vec4::select(self.two_sided, cos_w.abs(), cos_w);
        let (cos_x, sin_x) = self.beyond_spread(cos_w);
        let cos_less = |cos: Vec4, sin: Vec4| Vec4::select(cos.cmpgt(cos_b), Vec4::ONE, cos * cos_b + sin * sin_b);
        let cos_out = cos_less(cos_x, sin_x);
        let mut importance = self.power * cos_out.max(Vec4::ZERO) / d2;
        if n != Vec3::ZERO {
            let cos_i = (toward[0] * n.x + toward[1] * n.y + toward[2] * n.z).abs();
            importance *= cos_less(cos_i, sines(cos_i)).max(Vec4::ZERO);
        }
        Vec4::select(cos_out.cmpgt(self.cos_emission), importance, Vec4::ZERO)
    }

    /// Estimate of what each child scatters into a segment of a ray, up to a constant factor: ∫ Φ/r² dt is Φ times the angle of the segment over the
    /// distance from its line (C. Kulla, M. Fajardo 2012), times what extinction leaves on the shortest way.
    fn importances_along(&self, s: &Segment) -> Vec4 {
        let from: [Vec4; 3] = from_fn(|k| Vec4::splat(s.origin[k]) - self.center[k]);
        let along = |v: &[Vec4; 3]| v[0] * s.direction.x + v[1] * s.direction.y + v[2] * s.direction.z;
        let at = |t: Vec4| from_fn(|k| from[k] + t * s.direction[k]);
        let nearest = -along(&from);
        let d2 = length_squared(&at(nearest));
        let offset = square_roots((d2 + self.radius2).max(Vec4::splat(1e-12)));
        let first = s.near - nearest;
        let angle = match s.far.is_finite() {
            true => angles((s.far - s.near) * offset, offset * offset + first * (s.far - nearest)),
            false => angles(offset, first),
        };
        let closest = nearest.clamp(Vec4::splat(s.near), Vec4::splat(s.far));
        let d2_near = d2 + (nearest - closest) * (nearest - closest);
        // Angle under which the box is seen from the nearest place.
        let seen = (self.radius2 / d2_near.max(Vec4::splat(f32::MIN_POSITIVE))).min(Vec4::ONE);
        let (cos_b, sin_b) = (square_roots(Vec4::ONE - seen), square_roots(seen));
        let end = match s.far.is_finite() {
            true => unit(&at(Vec4::splat(s.far))),
            false => s.direction.to_array().map(Vec4::splat),
        };
        let (cos_x, sin_x) = self.beyond_spread(self.most_toward(&unit(&at(Vec4::splat(s.near))), &end));
        let all_round = d2_near.cmple(self.radius2) | self.cos_spread.cmple(Vec4::NEG_ONE) | cos_x.cmpgt(cos_b);
        let cos_out = Vec4::select(all_round, Vec4::ONE, cos_x * cos_b + sin_x * sin_b);
        let way = closest - s.near + (square_roots(d2_near) - square_roots(self.radius2)).max(Vec4::ZERO);
        let mut lost = Vec4::ONE + way * (s.extinction / (1 << SQUARINGS) as f32);
        (0..SQUARINGS).for_each(|_| lost *= lost);
        let importance = self.power * cos_out.max(Vec4::ZERO) * angle / (offset * lost);
        Vec4::select(cos_out.cmpgt(self.cos_emission), importance, Vec4::ZERO)
    }

    /// Greatest cosine between the axis of the normals of each child and the directions on the arc between two unit directions from it.
    #[inline]
    fn most_toward(&self, a: &[Vec4; 3], b: &[Vec4; 3]) -> Vec4 {
        let (to_a, to_b, between) = (dot(&self.axis, a), dot(&self.axis, b), dot(a, b));
        let turn = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let arc2 = length_squared(&turn);
        // The axis in the plane of the arc: whether it is on the inner side of both ends, or opposite to that.
        let (of_a, of_b) = (to_b - between * to_a, to_a - between * to_b);
        let has_arc = arc2.cmpge(Vec4::splat(LEAST_ARC2));
        let within = has_arc & of_a.cmpge(Vec4::ZERO) & of_b.cmpge(Vec4::ZERO);
        let opposite = self.two_sided & has_arc & of_a.cmple(Vec4::ZERO) & of_b.cmple(Vec4::ZERO);
        let ends = Vec4::select(self.two_sided, to_a.abs().max(to_b.abs()), to_a.max(to_b));
        let flat = square_roots(to_b * to_b + of_b * of_b / arc2.max(Vec4::splat(LEAST_ARC2)));
        Vec4::select(within | opposite, flat.min(Vec4::ONE), ends)
    }

    /// Cosine and sine of the angle by which that of a cosine is beyond the cone of normals; 1 and 0 within.
    #[inline]
    fn beyond_spread(&self, cos: Vec4) -> (Vec4, Vec4) {
        let sin = sines(cos);
        let within = cos.cmpgt(self.cos_spread);
        (
            Vec4::select(within, Vec4::ONE, cos * self.cos_spread + sin * self.sin_spread),
            Vec4::select(within, Vec4::ZERO, sin * self.cos_spread - cos * self.sin_spread),
        )
    }
}

/// Sines of angles up to half a turn by their cosines.
#[inline]
fn sines(cos: Vec4) -> Vec4 {
    square_roots((Vec4::ONE - cos * cos).max(Vec4::ZERO))
}

#[inline]
fn dot(a: &[Vec4; 3], b: &[Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn length_squared(v: &[Vec4; 3]) -> Vec4 {
    dot(v, v)
}

/// Vectors of length 1; 0 stays 0.
#[inline]
fn unit(v: &[Vec4; 3]) -> [Vec4; 3] {
    let d2 = length_squared(v);
    let inverse = Vec4::select(d2.cmpgt(Vec4::ZERO), square_roots(d2).recip(), Vec4::ZERO);
    v.map(|v| v * inverse)
}

/// The tree.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    nodes: Vec<Node>,
    /// All lights.
    whole: Option<LightBounds>,
}

impl Tree {
    /// Builds the tree; also gives the leaf of each light, in their order (to ask for its probability later).
    pub fn new(lights: &[LightBounds]) -> (Tree, Vec<u32>) {
        let mut tree = Tree { nodes: Vec::new(), whole: lights.iter().copied().reduce(LightBounds::union) };
        let mut leaves = vec![0; lights.len()];
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        if !order.is_empty() {
            tree.build(lights, &mut order, NOTHING, &mut leaves);
        }
        (tree, leaves)
    }

    fn build(&mut self, lights: &[LightBounds], order: &mut [u32], place: u32, leaves: &mut [u32]) -> u32 {
        let of = |part: &[u32]| part.iter().map(|i| lights[*i as usize]).reduce(LightBounds::union).expect("not empty");
        // The most costly of the parts is split in two until there are four.
        let mut parts = vec![(of(order), order)];
        while parts.len() < WIDTH {
            let divisible = parts.iter().enumerate().filter(|(_, (_, order))| order.len() > 1);
            let Some((k, _)) = divisible.max_by(|(_, (a, _)), (_, (b, _))| a.cost().total_cmp(&b.cost())) else { break };
            let (all, order) = parts.remove(k);
            let middle = split(lights, order, &all);
            let (a, b) = order.split_at_mut(middle);
            parts.extend([(of(a), a), (of(b), b)]);
        }
        let at = self.nodes.len() as u32;
        let children: Vec<LightBounds> = parts.iter().map(|(all, _)| *all).collect();
        self.nodes.push(Node::new(&children, place));
        for (k, (_, order)) in parts.into_iter().enumerate() {
            let place = at * WIDTH as u32 + k as u32;
            let child = match *order {
                [light] => {
                    leaves[light as usize] = place;
                    Child::Light(light)
                }
                _ => Child::Node(self.build(lights, order, place, leaves)),
            };
            self.nodes[at as usize].child[k] = child;
        }
        at
    }

    /// Estimate of what all lights together bring to a point (m) with a unit normal, 0 where there is none; in the unit of their power over m².
    #[inline]
    pub fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        self.whole.map_or(0.0, |whole| whole.importance(p, n))
    }

    /// The number of a light for the point (m) and its probability, by `u` in [0, 1). `None` where no light can contribute. Panics without lights.
    pub fn choose(&self, p: Vec3, n: Vec3, u: f32) -> Option<(usize, f32)> {
        self.choose_by(u, |node| node.importances(p, n))
    }

    /// The number of a light for a segment of a ray and its probability, by `u` in [0, 1). `None` where no light can contribute. Panics without lights.
    pub fn choose_along(&self, segment: &Segment, u: f32) -> Option<(usize, f32)> {
        self.choose_by(u, |node| node.importances_along(segment))
    }

    #[inline]
    fn choose_by(&self, mut u: f32, importances: impl Fn(&Node) -> Vec4) -> Option<(usize, f32)> {
        let (mut node, mut probability) = (&self.nodes[0], 1.0);
        loop {
            let mut chosen = 0;
            if node.count > 1 {
                let importances = importances(node);
                let total = importances.element_sum();
                if !(total > 0.0) {
                    return None;
                }
                let (mut before, mut threshold) = (0.0, u * total);
                for (k, importance) in importances.to_array().into_iter().enumerate() {
                    // Rounding may leave the last one with something.
                    if importance > 0.0 {
                        (chosen, before) = (k, importance);
                        if threshold < importance {
                            break;
                        }
                        threshold -= importance;
                    }
                }
                u = (threshold / before).clamp(0.0, 1.0 - f32::EPSILON);
                probability *= before / total;
            }
            match node.child[chosen] {
                Child::Light(light) => return Some((light as usize, probability)),
                Child::Node(next) => node = &self.nodes[next as usize],
            }
        }
    }

    /// Probability with which [`Tree::choose`] ends at a leaf.
    pub fn probability(&self, p: Vec3, n: Vec3, leaf: u32) -> f32 {
        self.probability_by(leaf, |node| node.importances(p, n))
    }

    /// Probability with which [`Tree::choose_along`] ends at a leaf.
    pub fn probability_along(&self, segment: &Segment, leaf: u32) -> f32 {
        self.probability_by(leaf, |node| node.importances_along(segment))
    }

    #[inline]
    fn probability_by(&self, leaf: u32, importances: impl Fn(&Node) -> Vec4) -> f32 {
        let (mut place, mut probability) = (leaf, 1.0);
        while place != NOTHING {
            let node = &self.nodes[place as usize / WIDTH];
            if node.count > 1 {
                let importances = importances(node);
                let total = importances.element_sum();
                if !(total > 0.0) {
                    return 0.0;
                }
                probability *= importances[place as usize % WIDTH] / total;
            }
            place = node.place;
        }
        probability
    }
}

/// Orders lights for the split of least cost (area × solid angle × power of both sides) over 12 bins of each axis.
fn split(lights: &[LightBounds], order: &mut [u32], all: &LightBounds) -> usize {
    const BINS: usize = 12;
    let centers = Bounds::around(order.iter().map(|i| lights[*i as usize].bounds.center()));
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        let extent = centers.size()[axis];
        if !(extent > 0.0) {
            continue;
        }
        let bin = |i: u32| {
            (((lights[i as usize].bounds.center()[axis] - centers.min[axis]) / extent * BINS as f32) as usize).min(BINS - 1)
        };
        let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
        for i in order.iter() {
            let slot = &mut bins[bin(*i)];
            *slot = Some(slot.map_or(lights[*i as usize], |b| b.union(lights[*i as usize])));
        }
        let side = |range: std::ops::Range<usize>| bins[range].iter().flatten().copied().reduce(LightBounds::union);
        // Long thin boxes are better cut across.
        let regularity = all.bounds.size().max_element() / extent.max(1e-12);
        for k in 1..BINS {
            if let (Some(a), Some(b)) = (side(0..k), side(k..BINS)) {
                let c = (a.cost() + b.cost()) * regularity;
                if best.is_none_or(|(least, ..)| c < least) {
                    best = Some((c, axis, k));
                }
            }
        }
    }
    let Some((_, axis, k)) = best else { return order.len() / 2 };
    let extent = centers.size()[axis];
    let bin =
        |i: u32| (((lights[i as usize].bounds.center()[axis] - centers.min[axis]) / extent * BINS as f32) as usize).min(BINS - 1);
    order.sort_by_key(|i| (bin(*i) >= k, *i));
    order.partition_point(|i| bin(*i) < k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    impl LightBounds {
        /// Estimate of what these lights scatter into a segment of a ray, up to a constant factor: ∫ Φ/r² dt is Φ times the angle of the segment over the
        /// distance from its line (C. Kulla, M. Fajardo 2012), times what extinction leaves on the shortest way. Plain twin of [`Node::importances_along`].
        fn importance_along(&self, s: &Segment) -> f32 {
            let center = self.bounds.center();
            let radius2 = self.bounds.size().length_squared() * 0.25;
            let (t, d2) = s.nearest(center);
            let offset = (d2 + radius2).max(1e-12).sqrt();
            let angle = s.angle(s.far, t, offset);
            let at = t.clamp(s.near, s.far);
            let d2_near = d2 + (t - at) * (t - at);
            let cos_out = if d2_near <= radius2 || self.cos_spread <= -1.0 {
                1.0
            } else {
                let sin_b = (radius2 / d2_near).sqrt();
                let cos_b = (1.0 - radius2 / d2_near).sqrt();
                let cos_w = self.most_toward(s, center);
                let (cos_x, sin_x) = cos_sin_less((cos_w, sin_of(cos_w)), (self.cos_spread, sin_of(self.cos_spread)));
                cos_sin_less((cos_x, sin_x), (cos_b, sin_b)).0
            };
            if cos_out <= self.cos_emission {
                return 0.0;
            }
            let way = at - s.near + (d2_near.sqrt() - radius2.sqrt()).max(0.0);
            self.power * cos_out.max(0.0) * angle / offset * (1.0 + s.extinction * way / 64.0).powi(-64)
        }

        /// Greatest cosine between the axis of the normals and the directions from a point to a segment.
        fn most_toward(&self, s: &Segment, center: Vec3) -> f32 {
            let direction_to = |t: f32| match t.is_finite() {
                true => (s.origin + s.direction * t - center).normalize_or_zero(),
                false => s.direction,
            };
            let (a, b) = (direction_to(s.near), direction_to(s.far));
            let most = |axis: Vec3| {
                let ends = axis.dot(a).max(axis.dot(b));
                // The directions are an arc: the axis may be nearest to a place within it.
                let turn = a.cross(b);
                let length2 = turn.length_squared();
                if length2 < LEAST_ARC2 {
                    return ends;
                }
                let flat = axis - turn * (axis.dot(turn) / length2);
                match a.cross(flat).dot(turn) >= 0.0 && flat.cross(b).dot(turn) >= 0.0 {
                    true => flat.length(),
                    false => ends,
                }
            };
            if self.two_sided { most(self.axis).max(most(-self.axis)) } else { most(self.axis) }
        }
    }

    impl Node {
        /// What a child is: its box with the same middle and diagonal.
        fn alone(&self, k: usize) -> LightBounds {
            let of = |v: &[Vec4; 3]| Vec3::from_array(v.map(|v| v[k]));
            let (center, half) = (of(&self.center), Vec3::splat((self.radius2[k] / 3.0).sqrt()));
            LightBounds {
                bounds: Bounds { min: center - half, max: center + half },
                axis: of(&self.axis),
                cos_spread: self.cos_spread[k],
                cos_emission: self.cos_emission[k],
                two_sided: self.two_sided.test(k),
                power: self.power[k],
            }
        }
    }

    /// Cosine and sine of max(0, a − b), of angles given so.
    fn cos_sin_less((cos_a, sin_a): (f32, f32), (cos_b, sin_b): (f32, f32)) -> (f32, f32) {
        if cos_a > cos_b { (1.0, 0.0) } else { (cos_a * cos_b + sin_a * sin_b, sin_a * cos_b - cos_a * sin_b) }
    }

    fn lamps(n: u32) -> Vec<LightBounds> {
        (0..n)
            .map(|i| {
                let p = Vec3::from_array(std::array::from_fn(|k| to_unit(mix(i * 3 + k as u32)) * 10.0));
                LightBounds::new(Bounds { min: p, max: p + 0.1 }, Vec3::NEG_Y, 0.0, PI / 2.0, i % 3 == 0, 1.0 + (i % 7) as f32)
            })
            .collect()
    }

    #[test]
    fn probabilities_of_all_lights_add_up_and_match_the_choice() {
        let (tree, leaves) = Tree::new(&lamps(100));
        for (p, n) in [(Vec3::new(5.0, -1.0, 5.0), Vec3::Y), (Vec3::new(20.0, 5.0, 0.0), Vec3::ZERO)] {
            let sum: f32 = leaves.iter().map(|l| tree.probability(p, n, *l)).sum();
            assert!((sum - 1.0).abs() < 1e-3, "{sum}");
            for i in 0..200 {
                let (light, probability) = tree.choose(p, n, (i as f32 + 0.5) / 200.0).unwrap();
                assert!((tree.probability(p, n, leaves[light]) / probability - 1.0).abs() < 1e-3);
            }
        }
    }

    /// Lamps, and points, spots, a light with a wide cone of normals, one that is large.
    fn all_kinds() -> Vec<LightBounds> {
        let mut lights = lamps(100);
        let at = Bounds { min: Vec3::splat(4.0), max: Vec3::splat(4.0) };
        lights.push(LightBounds::new(at, Vec3::Z, PI, PI / 2.0, false, 3.0));
        lights.push(LightBounds::new(at, Vec3::X, 0.0, 0.4, false, 3.0));
        lights.push(LightBounds::new(Bounds { min: Vec3::ZERO, max: Vec3::ONE }, Vec3::X, 1.0, PI / 2.0, true, 3.0));
        lights
    }

    fn in_box(i: u32) -> Vec3 {
        Vec3::from_array(from_fn(|k| to_unit(mix(i * 3 + k as u32)) * 12.0 - 1.0))
    }

    /// Compares children side by side with each alone; the number of those that contribute.
    fn compare(node: &Node, lanes: Vec4, alone: impl Fn(&LightBounds) -> f32) -> usize {
        let lanes = lanes.to_array();
        assert!(lanes[node.count..].iter().all(|v| *v == 0.0));
        let mut seen = 0;
        for (k, found) in lanes.into_iter().take(node.count).enumerate() {
            let light = node.alone(k);
            let alone = alone(&light);
            assert!((found - alone).abs() <= 2e-3 * alone.max(1e-3), "{light:?}: {found} {alone}");
            seen += usize::from(alone > 0.0);
        }
        seen
    }

    #[test]
    fn four_children_side_by_side_are_as_each_alone() {
        let (tree, _) = Tree::new(&all_kinds());
        let mut seen = [0; 2];
        for i in 0..200u32 {
            let p = in_box(i);
            let n = if i % 4 == 0 { Vec3::ZERO } else { Vec3::new(1.0, i as f32 / 100.0 - 1.0, 0.5).normalize() };
            let direction = (in_box(1000 + i) - p).normalize();
            let far = [0.05, 4.0, f32::INFINITY][i as usize % 3];
            let segment =
                Segment { origin: p, direction, near: 0.02 * (i % 5) as f32, far: far + 0.1, extinction: 0.01 * (i % 7) as f32 };
            for node in &tree.nodes {
                seen[0] += compare(node, node.importances(p, n), |light| light.importance(p, n));
                seen[1] += compare(node, node.importances_along(&segment), |light| light.importance_along(&segment));
            }
        }
        assert!(seen.iter().all(|n| *n > 1000), "{seen:?}");
    }

    #[test]
    fn probabilities_along_segments_add_up_and_match_the_choice() {
        let (tree, leaves) = Tree::new(&lamps(100));
        for (far, extinction) in [(12.0, 0.0), (12.0, 0.5), (f32::INFINITY, 0.1)] {
            let (origin, direction) = (Vec3::new(-1.0, 1.0, 2.0), Vec3::new(0.8, 0.0, 0.6));
            let segment = Segment { origin, direction, near: 0.5, far, extinction };
            let sum: f32 = leaves.iter().map(|l| tree.probability_along(&segment, *l)).sum();
            assert!((sum - 1.0).abs() < 1e-3, "{sum}");
            for i in 0..200 {
                let (light, probability) = tree.choose_along(&segment, (i as f32 + 0.5) / 200.0).unwrap();
                assert!((tree.probability_along(&segment, leaves[light]) / probability - 1.0).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn lights_are_chosen_by_the_integral_of_the_inverse_square_along_a_segment() {
        let at = |p: Vec3| LightBounds::new(Bounds { min: p, max: p }, Vec3::Z, PI, PI / 2.0, false, 1.0);
        let places = [Vec3::new(3.0, 0.5, 0.0), Vec3::new(-2.0, 1.0, 0.0)];
        let (tree, leaves) = Tree::new(&places.map(at));
        let segment = Segment { origin: Vec3::ZERO, direction: Vec3::X, near: 0.0, far: 5.0, extinction: 0.0 };
        let integral = |p: Vec3| {
            let n = 20_000;
            (0..n).map(|i| 1.0 / p.distance_squared(Vec3::X * ((i as f32 + 0.5) / n as f32 * 5.0))).sum::<f32>() / n as f32
        };
        let [a, b] = places.map(integral);
        let found = tree.probability_along(&segment, leaves[0]);
        assert!((found - a / (a + b)).abs() < 1e-3, "{found} {a} {b}");
    }

    #[test]
    fn lights_that_face_away_from_a_whole_segment_are_not_chosen_for_it() {
        let segment = Segment { origin: Vec3::ZERO, direction: Vec3::X, near: 0.0, far: 4.0, extinction: 0.0 };
        let p = Vec3::new(2.0, 1.0, 0.0);
        let facing = |axis: Vec3, angle: f32| LightBounds::new(Bounds { min: p, max: p }, axis, 0.0, angle, false, 1.0);
        // The second: a narrow cone that meets the middle of the segment, but neither of its ends.
        let lights = [facing(Vec3::Y, PI / 2.0), facing(Vec3::NEG_Y, 0.2), facing(Vec3::Z, 0.2)];
        let found = Node::new(&lights, NOTHING).importances_along(&segment);
        assert_eq!([found.x, found.z], [0.0; 2]);
        assert!(found.y > 0.0);
    }

    #[test]
    fn near_lights_are_preferred() {
        let at = |x: f32| LightBounds::new(Bounds { min: Vec3::X * x, max: Vec3::X * x }, Vec3::Z, PI, PI / 2.0, false, 1.0);
        let (tree, leaves) = Tree::new(&[at(1.0), at(10.0)]);
        let near = tree.probability(Vec3::ZERO, Vec3::ZERO, leaves[0]);
        assert!((near - 100.0 / 101.0).abs() < 1e-3, "{near}");
    }
}

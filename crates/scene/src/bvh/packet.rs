//! Shadow rays in packets: rays that run close together meet the same boxes, which are then looked at once for all of them.
//!
//! Boxes are tested for 16 rays at a time; where few rays of a packet go on, they go on alone. Source: Wald, Slusallek, Benthin & Wagner 2001, "Interactive
//! Rendering with Coherent Ray Tracing"; of packets in hierarchies of many children Tsakok 2009, "Faster Incoherent Rays: Multi-BVH Ray Stream Tracing".
//!
//! All rays of a packet have one end or one direction. What a triangle is to them is then three linear functions of where a ray starts, one for each edge (the volume that the edge spans with the line of the
//! ray), which are worked out once for the packet. They are formed from differences and sums of corners as in the test by Plücker coordinates (Shoemake 1998, "Plücker Coordinate Tutorial", Ray Tracing News 11(1);
//! Kensler & Shirley 2006, "Optimizing Ray-Triangle Intersection via Automated Search"): the two triangles at an edge find the same number of opposite signs, so that no ray passes between them, and it is off by rounding of the size of
//! the edge times the distance, not of the square of that.

use super::traverse::{LEAST_COMPONENT, Prepared, WIDEN, traverse_from};
use super::{Block, Bvh, Child, ChildKind, Filter, Node};
use diopter_light::{Ray, instruction_set};
use fearless_simd::{Simd, dispatch, f32x8, f32x16, prelude::*};
use glam::Vec3;

/// Most rays of a packet.
pub const PACKET: usize = 32;
/// Rays whose boxes are tested at once.
const LANES: usize = 16;
/// So many rays are faster alone: a node is looked at for a packet in about the time of four single rays.
const FEW: u32 = 4;
/// So many rays are faster alone in a block of triangles.
const FEW_IN_BLOCK: u32 = 2;

/// What the rays of a packet have in common.
#[derive(Clone, Copy, Debug)]
pub enum Bundle {
    /// Where all of them end, m.
    Towards(Vec3),
    /// The direction of all of them.
    Along(Vec3),
}

impl Bvh {
    /// Which of up to [`PACKET`] rays meet anything before their ends, a bit each: for each of them what [`Bvh::any`] says, but for what rounding decides, the faster the closer they run together. `filter`: that of a ray.
    /// Panics on more rays.
    #[inline]
    pub fn any_of<F: Filter>(&self, rays: &[(Ray, f32)], bundle: Bundle, filter: impl Fn(usize) -> F) -> u32 {
        dispatch!(instruction_set::widest(), simd => any_of(simd, self, rays, bundle, &filter))
    }
}

/// Rays for the tests of boxes and triangles; lanes without a ray meet nothing.
struct Packet {
    origin: [[f32; PACKET]; 3],
    inverse: [[f32; PACKET]; 3],
    t_max: [f32; PACKET],
    bundle: Bundle,
    /// Triangles and starts are reckoned from here, m: the common end, or the start of a ray.
    reference: Vec3,
    start: [[f32; PACKET]; 3],
}

impl Packet {
    #[inline(always)]
    fn new<S: Simd>(simd: S, rays: &[(Ray, f32)], bundle: Bundle) -> Packet {
        let reference = match bundle {
            Bundle::Towards(end) => end,
            Bundle::Along(_) => rays[0].0.origin,
        };
        let [origin, start] = [[[0.0; PACKET]; 3]; 2];
        // Directions first.
        let mut packet = Packet { origin, inverse: [[1.0; PACKET]; 3], t_max: [-1.0; PACKET], bundle, reference, start };
        for (k, (ray, t_max)) in rays.iter().enumerate() {
            packet.origin[0][k] = ray.origin.x;
            packet.origin[1][k] = ray.origin.y;
            packet.origin[2][k] = ray.origin.z;
            packet.inverse[0][k] = ray.direction.x;
            packet.inverse[1][k] = ray.direction.y;
            packet.inverse[2][k] = ray.direction.z;
            packet.t_max[k] = *t_max;
        }
        let (one, tiny) = (f32x16::splat(simd, 1.0), f32x16::splat(simd, LEAST_COMPONENT));
        for first in (0..rays.len()).step_by(LANES) {
            let lanes = first..first + LANES;
            // What is not a number meets nothing.
            let mut size = f32x16::splat(simd, 0.0);
            for axis in 0..3 {
                let origin = f32x16::from_slice(simd, &packet.origin[axis][lanes.clone()]);
                let direction = f32x16::from_slice(simd, &packet.inverse[axis][lanes.clone()]);
                size = size + origin.abs() + direction.abs();
                let not_zero = direction.abs().simd_lt(tiny).select(tiny.copysign(direction), direction);
                (one / not_zero).store_slice(&mut packet.inverse[axis][lanes.clone()]);
                (origin - f32x16::splat(simd, reference[axis])).store_slice(&mut packet.start[axis][lanes.clone()]);
            }
            let t_max = f32x16::from_slice(simd, &packet.t_max[lanes.clone()]);
            size.simd_lt(f32x16::splat(simd, f32::INFINITY)).select(t_max, -one).store_slice(&mut packet.t_max[lanes]);
        }
        packet
    }

    /// Rays of a group of lanes that meet the box of a child, a bit each.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, node: &Node, child: usize, group: usize) -> u32 {
        let lanes = group * LANES..(group + 1) * LANES;
        let mut near = f32x16::splat(simd, 0.0);
        let mut far = f32x16::splat(simd, f32::INFINITY);
        for axis in 0..3 {
            let origin = f32x16::from_slice(simd, &self.origin[axis][lanes.clone()]);
            let inverse = f32x16::from_slice(simd, &self.inverse[axis][lanes.clone()]);
            let low = (f32x16::splat(simd, node.bounds[axis][child]) - origin) * inverse;
            let high = (f32x16::splat(simd, node.bounds[axis + 3][child]) - origin) * inverse;
            near = near.max(low.min(high));
            far = far.min(low.max(high));
        }
        let far = far * f32x16::splat(simd, WIDEN);
        near.simd_le(far.min(f32x16::from_slice(simd, &self.t_max[lanes]))).to_bitmask() as u32
    }

    /// Corners of triangles, from the reference.
    #[inline(always)]
    fn corner<S: Simd>(&self, simd: S, corner: &[[f32; 8]; 3]) -> [f32x8<S>; 3] {
        let [x, y, z] = [self.reference.x, self.reference.y, self.reference.z];
        [
            f32x8::from_slice(simd, &corner[0]) - f32x8::splat(simd, x),
            f32x8::from_slice(simd, &corner[1]) - f32x8::splat(simd, y),
            f32x8::from_slice(simd, &corner[2]) - f32x8::splat(simd, z),
        ]
    }

    /// On which side of an edge of eight triangles lines pass.
    #[inline(always)]
    fn edge<S: Simd>(&self, simd: S, p: [f32x8<S>; 3], q: [f32x8<S>; 3]) -> Linear {
        let along = difference(p, q);
        let twice_volume = cross(along, [p[0] + q[0], p[1] + q[1], p[2] + q[2]]);
        match self.bundle {
            Bundle::Towards(_) => Linear::new(twice_volume, f32x8::splat(simd, 0.0)),
            Bundle::Along(direction) => {
                let direction = splat(simd, direction);
                Linear::new(cross(along, direction), dot(twice_volume, direction) * f32x8::splat(simd, 0.5))
            }
        }
    }

    /// Which of some rays meet a triangle of a block, a bit each.
    #[inline(always)]
    fn meets_block<S: Simd, F: Filter>(&self, simd: S, block: &Block, mut left: u32, filter: &impl Fn(usize) -> F) -> u32 {
        let [a, b, c] =
            [self.corner(simd, &block.corners[0]), self.corner(simd, &block.corners[1]), self.corner(simd, &block.corners[2])];
        let edges = [self.edge(simd, b, c), self.edge(simd, c, a), self.edge(simd, a, b)];
        let normal = cross(difference(b, a), difference(c, a));
        let (zero, height) = (f32x8::splat(simd, 0.0), dot(a, normal));
        // The fraction of the way from the end, or the way along the direction, is one over the other.
        let (above, below) = match self.bundle {
            Bundle::Towards(_) => (Linear::new([zero, zero, zero], height), Linear::new(normal, zero)),
            Bundle::Along(direction) => {
                let [x, y, z] = normal;
                let constant = dot(normal, splat(simd, direction));
                (Linear::new([-x, -y, -z], height), Linear::new([zero, zero, zero], constant))
            }
        };
        let mut met = 0u32;
        for i in 0..8 {
            // All corners of an absent triangle are the same.
            if below.is_nought(i) && above.is_nought(i) {
                continue;
            }
            for group in 0..PACKET / LANES {
                let first = group * LANES;
                let own = left >> first as u32 & 0xffff;
                if own == 0 {
                    continue;
                }
                let lanes = first..first + LANES;
                let start = [
                    f32x16::from_slice(simd, &self.start[0][lanes.clone()]),
                    f32x16::from_slice(simd, &self.start[1][lanes.clone()]),
                    f32x16::from_slice(simd, &self.start[2][lanes.clone()]),
                ];
                let zero = f32x16::splat(simd, 0.0);
                let u = edges[0].at(simd, i, start);
                let v = edges[1].at(simd, i, start);
                let w = edges[2].at(simd, i, start);
                let inside = u.min(v).min(w).simd_ge(zero) | u.max(v).max(w).simd_le(zero);
                if inside.to_bitmask() as u32 & own == 0 {
                    continue;
                }
                let limit = match self.bundle {
                    Bundle::Towards(_) => f32x16::splat(simd, 1.0),
                    Bundle::Along(_) => f32x16::from_slice(simd, &self.t_max[lanes]),
                };
                // A flat triangle is met nowhere: what is not a number fails both comparisons.
                let t = above.at(simd, i, start) / below.at(simd, i, start);
                let hit = t.simd_gt(zero) & t.simd_lt(limit) & inside;
                let mut hit = hit.to_bitmask() as u32 & own;
                if hit != 0 && block.triangle[i].is_filtered() {
                    let sum = u + v + w;
                    let (v, w): ([f32; LANES], [f32; LANES]) = ((v / sum).into(), (w / sum).into());
                    let mut asked = hit;
                    while asked != 0 {
                        let lane = asked.trailing_zeros() as usize;
                        asked &= asked - 1;
                        if !filter(first + lane).accept(block.triangle[i].id(), v[lane], w[lane]) {
                            hit &= !(1 << lane);
                        }
                    }
                }
                met |= hit << first as u32;
            }
            left &= !met;
            if left == 0 {
                break;
            }
        }
        met
    }
}

/// A linear function of a place for each of eight triangles.
struct Linear {
    slope: [[f32; 8]; 3],
    constant: [f32; 8],
}

// Closures would be compiled without the instruction set that `dispatch` has chosen.
impl Linear {
    #[inline(always)]
    fn new<S: Simd>([x, y, z]: [f32x8<S>; 3], constant: f32x8<S>) -> Linear {
        Linear { slope: [x.into(), y.into(), z.into()], constant: constant.into() }
    }

    /// That of a triangle, at 16 places.
    #[inline(always)]
    fn at<S: Simd>(&self, simd: S, triangle: usize, [x, y, z]: [f32x16<S>; 3]) -> f32x16<S> {
        f32x16::splat(simd, self.constant[triangle])
            + x * f32x16::splat(simd, self.slope[0][triangle])
            + y * f32x16::splat(simd, self.slope[1][triangle])
            + z * f32x16::splat(simd, self.slope[2][triangle])
    }

    #[inline(always)]
    fn is_nought(&self, triangle: usize) -> bool {
        self.constant[triangle] == 0.0
            && self.slope[0][triangle] == 0.0
            && self.slope[1][triangle] == 0.0
            && self.slope[2][triangle] == 0.0
    }
}

#[inline(always)]
fn splat<S: Simd>(simd: S, v: Vec3) -> [f32x8<S>; 3] {
    [f32x8::splat(simd, v.x), f32x8::splat(simd, v.y), f32x8::splat(simd, v.z)]
}

#[inline(always)]
fn difference<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> [f32x8<S>; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> [f32x8<S>; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> f32x8<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

// As in `traverse`: closures would be compiled without the instruction set that `dispatch` has chosen.
#[inline(always)]
fn any_of<S: Simd, F: Filter>(simd: S, bvh: &Bvh, rays: &[(Ray, f32)], bundle: Bundle, filter: &impl Fn(usize) -> F) -> u32 {
    assert!(rays.len() <= PACKET, "{} rays", rays.len());
    if bvh.nodes.is_empty() || rays.is_empty() {
        return 0;
    }
    let packet = Packet::new(simd, rays, bundle);
    let mut met = 0u32;
    let mut waiting: Vec<(Child, u32)> = Vec::with_capacity(64);
    waiting.push((Child::node(0), u32::MAX >> (PACKET - rays.len())));
    while let Some((child, reached)) = waiting.pop() {
        let mut left = reached & !met;
        match child.kind() {
            ChildKind::Node(index) if left.count_ones() > FEW => {
                let node = &bvh.nodes[index];
                for i in 0..8 {
                    if node.child[i] == Child::ABSENT {
                        continue;
                    }
                    let mut reached = 0;
                    for group in 0..PACKET / LANES {
                        if left >> (group * LANES) as u32 & 0xffff != 0 {
                            reached |= packet.meets(simd, node, i, group) << (group * LANES) as u32;
                        }
                    }
                    if reached & left != 0 {
                        waiting.push((node.child[i], reached & left));
                    }
                }
            }
            ChildKind::Block(index) if left.count_ones() > FEW_IN_BLOCK => {
                met |= packet.meets_block(simd, &bvh.blocks[index], left, filter);
            }
            kind => {
                while left != 0 {
                    let k = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let (ray, t_max) = rays[k];
                    let filter = filter(k);
                    let is_met = match kind {
                        ChildKind::Other(id) => filter.intersect_other(id, t_max, true).is_some(),
                        _ => {
                            let ray = Prepared::new(simd, ray.origin, ray.direction, 0.0);
                            traverse_from::<_, _, true, false>(simd, bvh, child, &ray, t_max, &filter).is_some()
                        }
                    };
                    met |= u32::from(is_met) << k;
                }
            }
        }
    }
    met
}

#[cfg(test)]
mod tests {
    use super::super::{Bounds, Hit, Primitive, Primitives};
    use super::*;
    use diopter_light::random::{mix, to_unit};
    use glam::Vec3;

    /// Triangles, every third of which asks the filter, and some spheres.
    struct Things {
        triangles: Vec<[Vec3; 3]>,
        spheres: Vec<(Vec3, f32)>,
    }

    impl Primitives for Things {
        fn len(&self) -> usize {
            self.triangles.len() + self.spheres.len()
        }
        fn get(&self, index: usize) -> Primitive {
            match index.checked_sub(self.triangles.len()) {
                None => {
                    Primitive::Triangle { corners: self.triangles[index], id: index as u32, filtered: index.is_multiple_of(3) }
                }
                Some(other) => {
                    let (center, radius) = self.spheres[other];
                    Primitive::Other { bounds: Bounds { min: center - radius, max: center + radius }, id: other as u32 }
                }
            }
        }
    }

    struct OfRay<'a>(&'a Things, Ray);

    impl Filter for OfRay<'_> {
        fn accept(&self, id: u32, u: f32, _: f32) -> bool {
            id.is_multiple_of(2) || u < 0.3
        }
        fn intersect_other(&self, id: u32, t_max: f32, _: bool) -> Option<Hit> {
            let (center, radius) = self.0.spheres[id as usize];
            let (o, d) = (self.1.origin - center, self.1.direction);
            let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - radius * radius);
            let t = (-b - (b * b - a * c).sqrt()) / a;
            (t > 0.0 && t < t_max).then_some(Hit { t, u: 0.0, v: 0.0, id, slot: u32::MAX, instance: 0 })
        }
    }

    fn random(seed: u32) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed.wrapping_mul(3).wrapping_add(k as u32)))))
    }

    #[test]
    fn rays_of_a_packet_meet_what_each_meets_alone() {
        for n in [0, 1, 9, 300, 5000] {
            let triangle = |i: u32| [0, 1, 2].map(|k| random(i) + (random(n + i * 3 + k) - 0.5) * 0.05);
            let sphere = |i: u32| (random(i ^ 0x77_0000), 0.03);
            let things = Things { triangles: (0..n).map(triangle).collect(), spheres: (0..n / 30).map(sphere).collect() };
            let bvh = Bvh::build(&things);
            let (mut met, mut rays_in_all) = (0, 0);
            for packet in 0..400u32 {
                // From about one place to one place, from places all over, and what meets nothing; towards one place, and along one direction.
                let (from, spread) = (random(packet ^ 0xabcd), [0.01, 0.2, 3.0][packet as usize % 3]);
                let to = random(packet ^ 0x1234) * 2.0 - 0.5;
                let count = packet % (PACKET as u32 + 1);
                let is_parallel = packet % 2 == 1;
                let ray = |k: u32| {
                    let origin = from + (random(packet * 64 + k) - 0.5) * spread;
                    let direction = if is_parallel { to - from } else { to - origin };
                    let direction = if k == 5 { Vec3::new(f32::NAN, 0.0, 1.0) } else { direction };
                    (Ray { origin, direction, time_s: 0.0 }, if k == 7 && is_parallel { 0.0 } else { 1.0 })
                };
                let rays: Vec<(Ray, f32)> = (0..count).map(ray).collect();
                let bundle = if is_parallel { Bundle::Along(to - from) } else { Bundle::Towards(to) };
                let found = bvh.any_of(&rays, bundle, |k| OfRay(&things, rays[k].0));
                for (k, (ray, t_max)) in rays.iter().enumerate() {
                    let alone = bvh.any(ray.origin, ray.direction, *t_max, &OfRay(&things, *ray));
                    assert_eq!(found >> k & 1 == 1, alone, "{n} triangles, packet {packet}, ray {k}");
                    met += u32::from(alone);
                    rays_in_all += 1;
                }
                assert_eq!(u64::from(found) >> count, 0);
            }
            assert!(n < 300 || (met > rays_in_all / 50 && met < rays_in_all), "{met} of {rays_in_all}");
        }
    }
}

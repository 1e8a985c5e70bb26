//! Shadow rays in packets: rays that run close together meet the same boxes, which are then looked at once for all of them.
//!
//! Boxes are tested for 16 rays at a time, triangles as for single rays; where few rays of a packet go on, they go on alone. Source: Wald, Slusallek, Benthin & Wagner 2001, "Interactive
//! Rendering with Coherent Ray Tracing"; of packets in hierarchies of many children Tsakok 2009, "Faster Incoherent Rays: Multi-BVH Ray Stream Tracing".

use super::traverse::{Prepared, WIDEN, level, not_zero, traverse_from};
use super::{Bvh, Child, ChildKind, Filter, Node};
use diopter_light::Ray;
use fearless_simd::{Simd, dispatch, f32x16, prelude::*};

/// Most rays of a packet.
pub const PACKET: usize = 32;
/// Rays whose boxes are tested at once.
const LANES: usize = 16;
/// So many rays are faster alone: a node is looked at for a packet in about the time of four single rays.
const FEW: u32 = 4;

impl Bvh {
    /// Which of up to [`PACKET`] rays meet anything before their ends, a bit each: for each of them what [`Bvh::any`] says, the faster the closer they run together. `filter`: that of a ray.
    /// Panics on more rays.
    #[inline]
    pub fn any_of<F: Filter>(&self, rays: &[(Ray, f32)], filter: impl Fn(usize) -> F) -> u32 {
        dispatch!(level(), simd => any_of(simd, self, rays, &filter))
    }
}

/// Rays for the test of boxes; lanes without a ray meet nothing.
struct Packet {
    origin: [[f32; PACKET]; 3],
    inverse: [[f32; PACKET]; 3],
    t_max: [f32; PACKET],
}

impl Packet {
    fn new(rays: &[(Ray, f32)]) -> Packet {
        let mut packet = Packet { origin: [[0.0; PACKET]; 3], inverse: [[1.0; PACKET]; 3], t_max: [-1.0; PACKET] };
        for (k, (ray, t_max)) in rays.iter().enumerate() {
            // What is not a number meets nothing.
            if !(ray.origin.is_finite() && ray.direction.is_finite()) {
                continue;
            }
            for axis in 0..3 {
                packet.origin[axis][k] = ray.origin[axis];
                packet.inverse[axis][k] = 1.0 / not_zero(ray.direction[axis]);
            }
            packet.t_max[k] = *t_max;
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
}

// As in `traverse`: closures would be compiled without the instruction set that `dispatch` has chosen.
#[inline(always)]
fn any_of<S: Simd, F: Filter>(simd: S, bvh: &Bvh, rays: &[(Ray, f32)], filter: &impl Fn(usize) -> F) -> u32 {
    assert!(rays.len() <= PACKET, "{} rays", rays.len());
    if bvh.nodes.is_empty() || rays.is_empty() {
        return 0;
    }
    let packet = Packet::new(rays);
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
            for packet in 0..200u32 {
                // From about one place to one place, to places all over, and what meets nothing.
                let (from, spread) = (random(packet ^ 0xabcd), [0.01, 0.2, 3.0][packet as usize % 3]);
                let to = random(packet ^ 0x1234) * 2.0 - 0.5;
                let count = packet % (PACKET as u32 + 1);
                let ray = |k: u32| {
                    let origin = from + (random(packet * 64 + k) - 0.5) * spread;
                    let direction = if k == 5 { Vec3::new(f32::NAN, 0.0, 1.0) } else { to - origin };
                    (Ray { origin, direction, time_s: 0.0 }, if k == 7 { 0.0 } else { 1.0 })
                };
                let rays: Vec<(Ray, f32)> = (0..count).map(ray).collect();
                let found = bvh.any_of(&rays, |k| OfRay(&things, rays[k].0));
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

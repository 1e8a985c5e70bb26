//! Photons within media, and the light that a ray gathers from those along it.
//!
//! Each photon leaves one point on each segment through a homogeneous medium behind a caster; a ray gathers all within a radius of it. Source: Jensen &
//! Christensen 1998, "Efficient Simulation of Light Transport in Scenes with Participating Media using Photon Maps" (volume photon map); Jarosz, Zwicker &
//! Jensen 2008, "The Beam Radiance Estimate for Volumetric Photon Mapping".

use super::photon::VolumePhoton;
use crate::bvh::Bounds;
use diopter_light::Ray;
use glam::Vec3;

/// Photons of a leaf, and children of a node: what is tested at once.
const WIDE: usize = 8;

/// Bits of each coordinate in the order along which photons are sorted.
const ORDER_BITS: u32 = 10;

/// Coordinates of several things, each axis by itself.
type Coordinates = [[f32; WIDE]; 3];

/// Boxes of the children of a node; as far beyond the photons as these are gathered from.
#[derive(Clone, Copy)]
struct Node {
    min: Coordinates,
    max: Coordinates,
}

/// Photons in the order of Morton's curve, in a complete tree: eight to a leaf, eight children to a node.
pub(super) struct VolumeMap<'a> {
    photons: Vec<VolumePhoton<'a>>,
    /// Where the photons of each leaf are; beyond the last at infinity.
    leaves: Vec<Coordinates>,
    /// The children of the first level are leaves, those of the others the nodes of the level before; the last has one node.
    levels: Vec<Vec<Node>>,
    radius: f32,
}

impl<'a> VolumeMap<'a> {
    /// A map of photons that are gathered by rays within a radius, m.
    pub fn new(unsorted: Vec<VolumePhoton<'a>>, radius: f32) -> Self {
        let whole = Bounds::around(unsorted.iter().map(|p| p.photon.point));
        let scale = ((1 << ORDER_BITS) - 1) as f32 / whole.size().max(Vec3::splat(f32::MIN_POSITIVE));
        let mut order: Vec<(u32, u32)> =
            unsorted.iter().enumerate().map(|(i, p)| (morton((p.photon.point - whole.min) * scale), i as u32)).collect();
        order.sort_unstable();
        let photons: Vec<VolumePhoton> = order.into_iter().map(|(_, i)| unsorted[i as usize]).collect();
        let mut leaves = Vec::with_capacity(photons.len().div_ceil(WIDE));
        let mut boxes = Vec::with_capacity(leaves.capacity());
        for some in photons.chunks(WIDE) {
            let mut leaf = [[f32::INFINITY; WIDE]; 3];
            for (lane, p) in some.iter().enumerate() {
                (0..3).for_each(|k| leaf[k][lane] = p.photon.point[k]);
            }
            leaves.push(leaf);
            let b = Bounds::around(some.iter().map(|p| p.photon.point));
            boxes.push(Bounds { min: b.min - radius, max: b.max + radius });
        }
        let mut levels = Vec::new();
        while !boxes.is_empty() {
            levels.push(boxes.chunks(WIDE).map(Node::of).collect());
            if boxes.len() <= WIDE {
                break;
            }
            boxes = boxes.chunks(WIDE).map(|some| some.iter().fold(Bounds::EMPTY, |all, b| all.union(*b))).collect();
        }
        VolumeMap { photons, leaves, levels, radius }
    }

    /// Radius within which photons are gathered, m.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// All of them.
    pub fn photons(&self) -> &[VolumePhoton<'a>] {
        &self.photons
    }

    /// Visits the photons within the radius of a part of a ray (m), with the distance along the ray and the square of that from it.
    #[inline]
    pub fn along(&self, ray: &Ray, [near, far]: [f32; 2], mut visit: impl FnMut(&VolumePhoton<'a>, f32, f32)) {
        if self.levels.is_empty() {
            return;
        }
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        // Finite, so that there are no products of 0 and infinity.
        let inverse = direction.map(|d| if d.abs() > 1e-18 { 1.0 / d } else { 1e18f32.copysign(d) });
        let r2 = self.radius * self.radius;
        // Nodes that wait, by level and number: at most seven of each level, and there are eleven levels of 2³² photons.
        let mut waiting = [(0u32, 0u32); 80];
        waiting[0] = (self.levels.len() as u32 - 1, 0);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (level, number) = waiting[count];
            let mut met = self.levels[level as usize][number as usize].met(origin, inverse, near, far);
            while met != 0 {
                let child = number as usize * WIDE + met.trailing_zeros() as usize;
                met &= met - 1;
                if level > 0 {
                    if child < self.levels[level as usize - 1].len() {
                        waiting[count] = (level - 1, child as u32);
                        count += 1;
                    }
                    continue;
                }
                let Some(leaf) = self.leaves.get(child) else { continue };
                let (mut t, mut d2) = ([0.0; WIDE], [0.0; WIDE]);
                let mut within = 0u32;
                for lane in 0..WIDE {
                    let offset = [0, 1, 2].map(|k| leaf[k][lane] - origin[k]);
                    t[lane] = offset[0] * direction[0] + offset[1] * direction[1] + offset[2] * direction[2];
                    let [x, y, z] = [0, 1, 2].map(|k| offset[k] - direction[k] * t[lane]);
                    d2[lane] = x * x + y * y + z * z;
                    within |= u32::from((d2[lane] < r2) & (t[lane] >= near) & (t[lane] < far)) << lane;
                }
                while within != 0 {
                    let lane = within.trailing_zeros() as usize;
                    within &= within - 1;
                    visit(&self.photons[child * WIDE + lane], t[lane], d2[lane]);
                }
            }
        }
    }
}

impl Node {
    fn of(boxes: &[Bounds]) -> Node {
        // Without a child: a point beyond everything.
        let mut node = Node { min: [[f32::MAX; WIDE]; 3], max: [[f32::MAX; WIDE]; 3] };
        for (lane, b) in boxes.iter().enumerate() {
            for k in 0..3 {
                (node.min[k][lane], node.max[k][lane]) = (b.min[k], b.max[k]);
            }
        }
        node
    }

    /// Which boxes a part of a ray comes through, a bit each.
    #[inline]
    fn met(&self, origin: [f32; 3], inverse: [f32; 3], near: f32, far: f32) -> u32 {
        let (mut first, mut last) = ([near; WIDE], [far; WIDE]);
        for k in 0..3 {
            for lane in 0..WIDE {
                let a = (self.min[k][lane] - origin[k]) * inverse[k];
                let b = (self.max[k][lane] - origin[k]) * inverse[k];
                let (low, high) = if a < b { (a, b) } else { (b, a) };
                first[lane] = if low > first[lane] { low } else { first[lane] };
                last[lane] = if high < last[lane] { high } else { last[lane] };
            }
        }
        (0..WIDE).fold(0, |met, lane| met | u32::from(first[lane] <= last[lane]) << lane)
    }
}

/// Place on Morton's curve of a point between 0 and 2^[`ORDER_BITS`] − 1.
fn morton(p: Vec3) -> u32 {
    let spread = |x: f32| {
        let x = (x as u32).min((1 << ORDER_BITS) - 1);
        (0..ORDER_BITS).fold(0, |code, bit| code | ((x >> bit) & 1) << (3 * bit))
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

#[cfg(test)]
mod tests {
    use super::super::photon::Photon;
    use super::*;
    use crate::medium::Medium;
    use diopter_light::random::{mix, to_unit};

    #[test]
    fn a_ray_meets_each_photon_in_reach_once() {
        let place = |i: u32| Vec3::from_array([0, 1, 2].map(|k| 4.0 * to_unit(mix(3 * i + k)) - 2.0));
        let medium = Medium::default();
        for n in [0, 1, 7, 8, 9, 3000] {
            let photons: Vec<VolumePhoton> =
                (0..n).map(|i| VolumePhoton { photon: Photon::for_tests(place(i)), medium: &medium }).collect();
            let map = VolumeMap::new(photons.clone(), 0.2);
            for i in 0..200 {
                let axis = [Vec3::X, Vec3::NEG_Y, Vec3::Z];
                let direction = if i < 3 { axis[i as usize] } else { place(50_000 + i).normalize() };
                let ray = Ray { origin: place(100_000 + i), direction, time_s: 0.0 };
                let span = [0.3, if i % 2 == 0 { 2.5 } else { f32::INFINITY }];
                let key = |p: &Photon| p.point.to_array().map(f32::to_bits);
                let mut found = Vec::new();
                map.along(&ray, span, |p, t, d2| {
                    assert!(((ray.at(t) - p.photon.point).length_squared() - d2).abs() < 1e-5);
                    found.push(key(&p.photon));
                });
                let near = |p: &Photon| {
                    let t = (p.point - ray.origin).dot(direction);
                    (p.point - ray.at(t)).length() < 0.2 && (span[0]..span[1]).contains(&t)
                };
                let mut expected: Vec<_> = photons.iter().map(|p| &p.photon).filter(|p| near(p)).map(key).collect();
                found.sort_unstable();
                expected.sort_unstable();
                // Rounding decides at the very edge.
                assert!(found.len().abs_diff(expected.len()) <= 1 && (n < 3000 || i > 10 || !found.is_empty()), "{n} {i}");
                assert!(found.windows(2).all(|w| w[0] != w[1]));
            }
        }
    }
}

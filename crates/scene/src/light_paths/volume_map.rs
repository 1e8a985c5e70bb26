//! Photons within media, and the light that a ray gathers from those along it.
//!
//! Each photon leaves one point on each segment through a homogeneous medium behind a caster; a ray gathers all within a radius of it. Source: Jensen &
//! Christensen 1998, "Efficient Simulation of Light Transport in Scenes with Participating Media using Photon Maps" (volume photon map); Jarosz, Zwicker &
//! Jensen 2008, "The Beam Radiance Estimate for Volumetric Photon Mapping".

use super::trace::Photon;
use crate::bvh::Bounds;
use crate::medium::Medium;
use diopter_light::Ray;
use glam::Vec3;

/// A photon in a medium.
#[derive(Clone, Copy, Debug)]
pub(super) struct VolumePhoton<'a> {
    /// Power as of photons that land, times m: over the density of its place along the segment. The normal means nothing.
    pub photon: Photon,
    pub medium: &'a Medium,
}

/// Photons that share a box.
const LEAF: usize = 8;

/// Bits of each coordinate in the order along which photons are sorted.
const ORDER_BITS: u32 = 10;

/// Photons in the order of Morton's curve, in a complete binary tree of boxes around [`LEAF`] each.
pub(super) struct VolumeMap<'a> {
    photons: Vec<VolumePhoton<'a>>,
    /// Node `k` holds nodes `2k` and `2k + 1`; the last half are leaves. Boxes reach as far beyond the photons as these are gathered from.
    boxes: Vec<Bounds>,
    radius: f32,
}

impl<'a> VolumeMap<'a> {
    /// Of photons that are gathered by rays within a radius, m.
    pub fn new(unsorted: Vec<VolumePhoton<'a>>, radius: f32) -> Self {
        let whole = Bounds::around(unsorted.iter().map(|p| p.photon.point));
        let scale = ((1 << ORDER_BITS) - 1) as f32 / whole.size().max(Vec3::splat(f32::MIN_POSITIVE));
        let mut order: Vec<(u32, u32)> =
            unsorted.iter().enumerate().map(|(i, p)| (morton((p.photon.point - whole.min) * scale), i as u32)).collect();
        order.sort_unstable();
        let photons: Vec<VolumePhoton> = order.into_iter().map(|(_, i)| unsorted[i as usize]).collect();
        let leaves = photons.len().div_ceil(LEAF).next_power_of_two();
        let mut boxes = vec![Bounds::EMPTY; 2 * leaves];
        for (leaf, same) in photons.chunks(LEAF).enumerate() {
            let b = Bounds::around(same.iter().map(|p| p.photon.point));
            boxes[leaves + leaf] = Bounds { min: b.min - radius, max: b.max + radius };
        }
        for k in (1..leaves).rev() {
            boxes[k] = boxes[2 * k].union(boxes[2 * k + 1]);
        }
        VolumeMap { photons, boxes, radius }
    }

    /// Radius within which photons are gathered, m.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Where the photons are.
    pub fn photons(&self) -> &[VolumePhoton<'a>] {
        &self.photons
    }

    /// Visits the photons within the radius of a part of a ray (m), with the distance along the ray and the square of that from it.
    #[inline]
    pub fn along(&self, ray: &Ray, [near, far]: [f32; 2], mut visit: impl FnMut(&VolumePhoton<'a>, f32, f32)) {
        if self.photons.is_empty() {
            return;
        }
        let leaves = self.boxes.len() / 2;
        let inverse = ray.direction.recip();
        let r2 = self.radius * self.radius;
        // Nodes that wait: one of each level.
        let mut waiting = [0u32; 32];
        let (mut count, mut node) = (0, 1);
        loop {
            if meets(&self.boxes[node], ray.origin, inverse, near, far) {
                if node < leaves {
                    waiting[count] = 2 * node as u32 + 1;
                    count += 1;
                    node *= 2;
                    continue;
                }
                let from = (node - leaves) * LEAF;
                for p in &self.photons[from.min(self.photons.len())..(from + LEAF).min(self.photons.len())] {
                    let offset = p.photon.point - ray.origin;
                    let t = offset.dot(ray.direction);
                    let d2 = (offset - ray.direction * t).length_squared();
                    if d2 < r2 && t >= near && t < far {
                        visit(p, t, d2);
                    }
                }
            }
            if count == 0 {
                return;
            }
            count -= 1;
            node = waiting[count] as usize;
        }
    }
}

/// Whether a part of a ray comes through a box. Along an axis that the ray does not go along, infinities and what is no number leave the others to decide.
#[inline]
fn meets(b: &Bounds, origin: Vec3, inverse: Vec3, near: f32, far: f32) -> bool {
    let (a, c) = ((b.min - origin) * inverse, (b.max - origin) * inverse);
    let (first, last) = (a.min(c), a.max(c));
    first.max_element().max(near) <= last.min_element().min(far)
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
    use super::*;
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

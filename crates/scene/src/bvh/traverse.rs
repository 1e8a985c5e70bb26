//! Traversal: eight boxes or eight triangles at a step, the nearest child first.

use super::{Block, Bvh, Child, ChildKind, Filter, Hit, Node};
use diopter_light::instruction_set;
use fearless_simd::{Simd, dispatch, f32x8, prelude::*};
use glam::Vec3;

/// Children waiting on the way down that fit the array; a power of two. More go to the heap.
const STACK: usize = 64;
/// 1 + 2γ₃: what the box test may be off by (Ize 2013).
pub(super) const WIDEN: f32 = 1.000_000_8;

impl Bvh {
    /// Nearest hit with 0 < t < `t_max` along `origin + t direction`; distances count in lengths of `direction`, which need not be 1.
    #[inline]
    pub fn closest(&self, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> Option<Hit> {
        dispatch!(instruction_set::widest(), simd => traverse::<_, _, false, false>(simd, self, origin, direction, 0.0, t_max, filter))
    }

    /// Nearest hit, as [`Bvh::closest`], in a hierarchy that moves, at a fraction (0 to 1) of its motion.
    #[inline]
    pub fn closest_at(&self, fraction: f32, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> Option<Hit> {
        match self.end {
            None => self.closest(origin, direction, t_max, filter),
            Some(_) => {
                dispatch!(instruction_set::widest(), simd => traverse::<_, _, false, true>(simd, self, origin, direction, fraction, t_max, filter))
            }
        }
    }

    /// Any hit, as [`Bvh::any`], in a hierarchy that moves, at a fraction (0 to 1) of its motion.
    #[inline]
    pub fn any_at(&self, fraction: f32, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> bool {
        match self.end {
            None => self.any(origin, direction, t_max, filter),
            Some(_) => {
                dispatch!(instruction_set::widest(), simd => traverse::<_, _, true, true>(simd, self, origin, direction, fraction, t_max, filter))
                    .is_some()
            }
        }
    }

    /// Whether there is any hit with 0 < t < `t_max`, as [`Bvh::closest`] counts them.
    #[inline]
    pub fn any(&self, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> bool {
        dispatch!(instruction_set::widest(), simd => traverse::<_, _, true, false>(simd, self, origin, direction, 0.0, t_max, filter)).is_some()
    }

    /// The same as [`Bvh::closest`] by plain loops over every triangle of every block that a plain box test reaches: the
    /// reference the fast code is tested against.
    pub fn closest_plain(&self, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut stack = if self.nodes.is_empty() { vec![] } else { vec![0usize] };
        let shear = Shear::new(direction);
        while let Some(node) = stack.pop() {
            for i in 0..8 {
                let limit = best.map_or(t_max, |h| h.t);
                if self.nodes[node].child[i] == Child::ABSENT {
                    continue;
                }
                match self.nodes[node].child[i].kind() {
                    ChildKind::Node(n) => stack.push(n),
                    ChildKind::Block(b) => {
                        for lane in 0..8 {
                            let limit = best.map_or(t_max, |h| h.t);
                            if let Some((t, u, v)) = self.blocks[b].intersect_plain(lane, origin, &shear, limit) {
                                let triangle = self.blocks[b].triangle[lane];
                                let id = triangle.id();
                                if !triangle.is_filtered() || filter.accept(id, u, v) {
                                    best = Some(Hit { t, u, v, id, slot: (b * 8 + lane) as u32, instance: 0 });
                                }
                            }
                        }
                    }
                    ChildKind::Other(id) => best = filter.intersect_other(id, limit, false).or(best),
                }
            }
        }
        best
    }
}

/// The shear that takes a ray to the +z axis: which axes, and by how much (Woop et al. 2013, §3).
struct Shear {
    axes: [usize; 3],
    s: [f32; 3],
}

impl Shear {
    #[inline(always)]
    fn new(d: Vec3) -> Self {
        let z = d.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        Shear { axes: [x, y, z], s: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]] }
    }
}

impl Block {
    fn intersect_plain(&self, lane: usize, origin: Vec3, shear: &Shear, t_max: f32) -> Option<(f32, f32, f32)> {
        let [x, y, z] = shear.axes;
        let [sx, sy, sz] = shear.s;
        let corner = |c: usize| {
            let at = |a: usize| self.corners[c][a][lane] - origin[a];
            (at(x) - sx * at(z), at(y) - sy * at(z), sz * at(z))
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let (u, v, w) = (c.0 * b.1 - c.1 * b.0, a.0 * c.1 - a.1 * c.0, b.0 * a.1 - b.1 * a.0);
        let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let det = u + v + w;
        if !inside || det == 0.0 {
            return None;
        }
        let inverse = 1.0 / det;
        let t = (u * a.2 + v * b.2 + w * c.2) * inverse;
        (t > 0.0 && t < t_max).then_some((t, v * inverse, w * inverse))
    }
}

/// The boxes of a node at the two ends of a motion; the same twice where nothing moves.
#[derive(Clone, Copy)]
struct Boxes<'a> {
    open: &'a [[f32; 8]; 6],
    close: &'a [[f32; 8]; 6],
}

/// A ray prepared for both tests.
pub(super) struct Prepared<S: Simd> {
    origin: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    /// Row of `Node::bounds` with the near and the far plane of each axis.
    near: [usize; 3],
    far: [usize; 3],
    axes: [usize; 3],
    shear: [f32x8<S>; 3],
    fraction: f32x8<S>,
}

// Closures (and `map` over arrays) would be compiled without the instruction set that `dispatch` has chosen and be called
// for every operation: within these functions everything is spelt out.
impl<S: Simd> Prepared<S> {
    #[inline(always)]
    pub fn new(simd: S, origin: Vec3, direction: Vec3, fraction: f32) -> Self {
        let shear = Shear::new(direction);
        let (x, y, z) = (direction.x, direction.y, direction.z);
        let (nx, ny, nz) = (x.is_sign_negative() as usize, y.is_sign_negative() as usize, z.is_sign_negative() as usize);
        Prepared {
            origin: [f32x8::splat(simd, origin.x), f32x8::splat(simd, origin.y), f32x8::splat(simd, origin.z)],
            inverse: [
                f32x8::splat(simd, 1.0 / not_zero(x)),
                f32x8::splat(simd, 1.0 / not_zero(y)),
                f32x8::splat(simd, 1.0 / not_zero(z)),
            ],
            near: [3 * nx, 1 + 3 * ny, 2 + 3 * nz],
            far: [3 - 3 * nx, 4 - 3 * ny, 5 - 3 * nz],
            axes: shear.axes,
            shear: [f32x8::splat(simd, shear.s[0]), f32x8::splat(simd, shear.s[1]), f32x8::splat(simd, shear.s[2])],
            fraction: f32x8::splat(simd, fraction),
        }
    }

    /// Ray parameter at which the eight planes of a row are met.
    #[inline(always)]
    fn plane<const MOVES: bool>(&self, simd: S, boxes: Boxes, row: usize, axis: usize) -> f32x8<S> {
        let mut plane = f32x8::from_slice(simd, &boxes.open[row]);
        if MOVES {
            plane = plane + (f32x8::from_slice(simd, &boxes.close[row]) - plane) * self.fraction;
        }
        (plane - self.origin[axis]) * self.inverse[axis]
    }

    /// Children whose boxes the ray meets before `t_max`: a bit each, and the distance of entry.
    #[inline(always)]
    fn boxes<const MOVES: bool>(&self, simd: S, boxes: Boxes, t_max: f32) -> (u32, [f32; 8]) {
        let near = self.plane::<MOVES>(simd, boxes, self.near[0], 0).max(self.plane::<MOVES>(simd, boxes, self.near[1], 1));
        let near = near.max(self.plane::<MOVES>(simd, boxes, self.near[2], 2)).max(f32x8::splat(simd, 0.0));
        let far = self.plane::<MOVES>(simd, boxes, self.far[0], 0).min(self.plane::<MOVES>(simd, boxes, self.far[1], 1));
        let far = far.min(self.plane::<MOVES>(simd, boxes, self.far[2], 2)) * f32x8::splat(simd, WIDEN);
        let hit = near.simd_le(far.min(f32x8::splat(simd, t_max)));
        (hit.to_bitmask() as u32, near.into())
    }

    /// Eight corners in the sheared frame of the ray.
    #[inline(always)]
    fn corner<const MOVES: bool>(&self, simd: S, open: &[[f32; 8]; 3], close: &[[f32; 8]; 3]) -> [f32x8<S>; 3] {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let z = self.place::<MOVES>(simd, &open[kz], &close[kz]) - self.origin[kz];
        let x = self.place::<MOVES>(simd, &open[kx], &close[kx]) - self.origin[kx];
        let y = self.place::<MOVES>(simd, &open[ky], &close[ky]) - self.origin[ky];
        [x - sx * z, y - sy * z, sz * z]
    }

    /// Coordinates at the ray's fraction of the way.
    #[inline(always)]
    fn place<const MOVES: bool>(&self, simd: S, open: &[f32; 8], close: &[f32; 8]) -> f32x8<S> {
        let at = f32x8::from_slice(simd, open);
        if MOVES { at + (f32x8::from_slice(simd, close) - at) * self.fraction } else { at }
    }

    /// Triangles of a block hit within `t_max`: a bit each, distances and barycentrics.
    #[inline(always)]
    fn triangles<const MOVES: bool>(
        &self,
        simd: S,
        open: &[[[f32; 8]; 3]; 3],
        close: &[[[f32; 8]; 3]; 3],
        t_max: f32,
    ) -> (u32, [f32; 8], [f32; 8], [f32; 8]) {
        let [ax, ay, az] = self.corner::<MOVES>(simd, &open[0], &close[0]);
        let [bx, by, bz] = self.corner::<MOVES>(simd, &open[1], &close[1]);
        let [cx, cy, cz] = self.corner::<MOVES>(simd, &open[2], &close[2]);
        // Plain products and differences: fused ones would round shared edges differently on their two sides.
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let zero = f32x8::splat(simd, 0.0);
        let inside = u.min(v).min(w).simd_ge(zero) | u.max(v).max(w).simd_le(zero);
        if inside.to_bitmask() == 0 {
            return (0, [0.0; 8], [0.0; 8], [0.0; 8]);
        }
        let inverse = f32x8::splat(simd, 1.0) / (u + v + w);
        let t = (u * az + v * bz + w * cz) * inverse;
        // A flat triangle has determinant 0 and t NaN: both comparisons fail.
        let hit = t.simd_gt(zero) & t.simd_lt(f32x8::splat(simd, t_max)) & inside;
        (hit.to_bitmask() as u32, t.into(), (v * inverse).into(), (w * inverse).into())
    }
}

/// A direction along a plane must not make 0 · ∞: its components are taken to be at least this.
pub(super) const LEAST_COMPONENT: f32 = 1e-20;

#[inline(always)]
fn not_zero(d: f32) -> f32 {
    if d.abs() < LEAST_COMPONENT { LEAST_COMPONENT.copysign(d) } else { d }
}

#[inline(always)]
fn traverse<S: Simd, F: Filter, const ANY: bool, const MOVES: bool>(
    simd: S,
    bvh: &Bvh,
    origin: Vec3,
    direction: Vec3,
    fraction: f32,
    t_max: f32,
    filter: &F,
) -> Option<Hit> {
    // What is not a number meets nothing (and would pass every comparison that asks whether it misses).
    if bvh.nodes.is_empty() || !(origin.is_finite() && direction.is_finite()) {
        return None;
    }
    let ray = Prepared::new(simd, origin, direction, fraction);
    traverse_from::<_, _, ANY, MOVES>(simd, bvh, Child::node(0), &ray, t_max, filter)
}

/// What waits on the way down: the distance at which a box is entered above, the child below. Distances are not negative, so their bits are ordered as they are.
#[inline(always)]
fn met(near: &[f32; 8], node: &Node, i: usize) -> u64 {
    (near[i].to_bits() as u64) << 32 | node.child[i].0 as u64
}

/// The same of what lies below a child.
#[inline(always)]
pub(super) fn traverse_from<S: Simd, F: Filter, const ANY: bool, const MOVES: bool>(
    simd: S,
    bvh: &Bvh,
    child: Child,
    ray: &Prepared<S>,
    t_max: f32,
    filter: &F,
) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    let mut limit = t_max;
    // Few rays need more than the array; it is small because each ray has to clear it.
    let mut stack = [0u64; STACK];
    let mut spilled: Vec<u64> = Vec::new();
    let mut top = 0;
    // What comes next without a detour over the stack.
    let mut next = Some(child.0 as u64);
    loop {
        let entry = match next.take() {
            Some(entry) => entry,
            None => {
                let waiting = if let Some(entry) = spilled.pop() {
                    entry
                } else if top > 0 {
                    top -= 1;
                    stack[top & (STACK - 1)]
                } else {
                    break;
                };
                if f32::from_bits((waiting >> 32) as u32) > limit {
                    continue;
                }
                waiting
            }
        };
        match Child(entry as u32).kind() {
            ChildKind::Node(index) => {
                let node = &bvh.nodes[index];
                let close = match (&bvh.end, MOVES) {
                    (Some(end), true) => &end.bounds[index],
                    _ => &node.bounds,
                };
                let (mut hits, near) = ray.boxes::<MOVES>(simd, Boxes { open: &node.bounds, close }, limit);
                if hits == 0 {
                    continue;
                }
                // Mostly one child is met, or two.
                let first = hits.trailing_zeros() as usize & 7;
                hits &= hits - 1;
                if hits == 0 {
                    next = Some(node.child[first].0 as u64);
                    continue;
                }
                let second = hits.trailing_zeros() as usize & 7;
                hits &= hits - 1;
                let (one, other) = (met(&near, node, first), met(&near, node, second));
                let (nearer, farther) = (one.min(other), one.max(other));
                if hits == 0 && top < STACK && spilled.is_empty() {
                    next = Some(nearer);
                    stack[top & (STACK - 1)] = farther;
                    top += 1;
                    continue;
                }
                // The nearest child is to be on top: sort what is pushed, the farthest first.
                let mut found = [0u64; 8];
                (found[0], found[1]) = (farther, nearer);
                let mut count = 2;
                while hits != 0 {
                    let i = hits.trailing_zeros() as usize & 7;
                    hits &= hits - 1;
                    let new = met(&near, node, i);
                    let mut at = count;
                    if !ANY {
                        while at > 0 && found[at - 1] < new {
                            found[at & 7] = found[at - 1];
                            at -= 1;
                        }
                    }
                    found[at & 7] = new;
                    count += 1;
                }
                count -= 1;
                next = Some(found[count & 7]);
                if top + count <= STACK && spilled.is_empty() {
                    for entry in &found[..count.min(8)] {
                        stack[top & (STACK - 1)] = *entry;
                        top += 1;
                    }
                } else {
                    spilled.extend_from_slice(&found[..count]);
                }
            }
            ChildKind::Block(index) => {
                let block = &bvh.blocks[index];
                let close = match (&bvh.end, MOVES) {
                    (Some(end), true) => &end.corners[index],
                    _ => &block.corners,
                };
                let (mut hits, t, u, v) = ray.triangles::<MOVES>(simd, &block.corners, close, limit);
                while hits != 0 {
                    let i = hits.trailing_zeros() as usize & 7;
                    hits &= hits - 1;
                    let triangle = block.triangle[i];
                    if t[i] < limit && (!triangle.is_filtered() || filter.accept(triangle.id(), u[i], v[i])) {
                        limit = t[i];
                        best =
                            Some(Hit { t: t[i], u: u[i], v: v[i], id: triangle.id(), slot: (index * 8 + i) as u32, instance: 0 });
                        if ANY {
                            return best;
                        }
                    }
                }
            }
            ChildKind::Other(id) => {
                if let Some(hit) = filter.intersect_other(id, limit, ANY) {
                    limit = hit.t;
                    best = Some(hit);
                    if ANY {
                        return best;
                    }
                }
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::{Bounds, Opaque, Primitive, Primitives};
    use super::*;
    use diopter_light::random::{mix, to_unit};

    struct Triangles(Vec<[Vec3; 3]>);

    impl Primitives for Triangles {
        fn len(&self) -> usize {
            self.0.len()
        }
        fn get(&self, index: usize) -> Primitive {
            Primitive::Triangle { corners: self.0[index], id: index as u32, filtered: false }
        }
    }

    fn random(seed: u32) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed.wrapping_mul(3).wrapping_add(k as u32)))))
    }

    fn soup(n: u32, size: f32) -> Triangles {
        Triangles(
            (0..n)
                .map(|i| {
                    let c = random(i);
                    [0, 1, 2].map(|k| c + (random(n + i * 3 + k) - 0.5) * size)
                })
                .collect(),
        )
    }

    fn rays(n: u32) -> impl Iterator<Item = (Vec3, Vec3)> {
        (0..n).map(|i| (random(i ^ 0x5555) * 3.0 - 1.0, (random(i ^ 0xaaaa_0000) - 0.5).normalize()))
    }

    #[test]
    fn fast_traversal_finds_what_the_plain_one_finds() {
        for n in [1, 7, 8, 9, 100, 5000] {
            let triangles = soup(n, 0.1);
            let bvh = Bvh::build(&triangles);
            let mut found = 0;
            for (o, d) in rays(400) {
                let plain = bvh.closest_plain(o, d, f32::INFINITY, &Opaque);
                let fast = bvh.closest(o, d, f32::INFINITY, &Opaque);
                assert_eq!(plain.map(|h| h.id), fast.map(|h| h.id), "{n} triangles, ray {o} {d}");
                assert_eq!(fast.is_some(), bvh.any(o, d, f32::INFINITY, &Opaque));
                if let (Some(p), Some(f)) = (plain, fast) {
                    found += 1;
                    assert!((p.t - f.t).abs() <= 1e-6 * p.t.max(1.0) && (p.u - f.u).abs() < 1e-4);
                    assert_eq!(bvh.corners(f.slot), triangles.0[f.id as usize]);
                }
            }
            assert!(n < 1000 || found > 30, "{found} hits of 400 rays on {n} triangles");
        }
    }

    /// Others that nothing may be asked about but themselves.
    struct Asked(std::cell::RefCell<Vec<u32>>);

    impl Filter for Asked {
        fn accept(&self, _: u32, _: f32, _: f32) -> bool {
            true
        }
        fn intersect_other(&self, id: u32, _: f32, _: bool) -> Option<Hit> {
            self.0.borrow_mut().push(id);
            None
        }
    }

    struct MovingBoxes;

    impl Primitives for MovingBoxes {
        fn len(&self) -> usize {
            3
        }
        fn get(&self, index: usize) -> Primitive {
            let min = Vec3::new(index as f32 * 2.0, 0.0, 0.0);
            Primitive::Other { bounds: Bounds { min, max: min + 1.0 }, id: index as u32 }
        }
        fn moves(&self) -> bool {
            true
        }
        fn get_at_end(&self, index: usize) -> Primitive {
            let min = Vec3::new(index as f32 * 2.0, 10.0, 0.0);
            Primitive::Other { bounds: Bounds { min, max: min + 1.0 }, id: index as u32 }
        }
    }

    #[test]
    fn only_boxes_that_are_there_are_asked() {
        let bvh = Bvh::build(&MovingBoxes);
        for (fraction, y, expected) in [(0.0, 0.5, vec![1]), (0.5, 5.5, vec![1]), (0.5, 0.5, vec![]), (1.0, 10.5, vec![1])] {
            let asked = Asked(Default::default());
            bvh.closest_at(fraction, Vec3::new(2.5, y, -5.0), Vec3::Z, f32::INFINITY, &asked);
            assert_eq!(*asked.0.borrow(), expected, "{fraction} {y}");
        }
    }

    struct Moving([Triangles; 2]);

    impl Primitives for Moving {
        fn len(&self) -> usize {
            self.0[0].len()
        }
        fn get(&self, index: usize) -> Primitive {
            self.0[0].get(index)
        }
        fn moves(&self) -> bool {
            true
        }
        fn get_at_end(&self, index: usize) -> Primitive {
            self.0[1].get(index)
        }
    }

    #[test]
    fn a_moving_hierarchy_finds_what_a_still_one_finds_at_each_moment() {
        // More than one chunk too.
        for n in [9, 3000, 40_000] {
            let size = if n > 10_000 { 0.01 } else { 0.1 };
            let (a, b) = (soup(n, size), soup(2 * n, size));
            let b = Triangles(b.0[n as usize..].to_vec());
            let moving = Bvh::build(&Moving([Triangles(a.0.clone()), Triangles(b.0.clone())]));
            for fraction in [0.0, 0.3, 1.0] {
                let between = a.0.iter().zip(&b.0).map(|(a, b)| [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * fraction)).collect();
                let still = Bvh::build(&Triangles(between));
                for (o, d) in rays(if n > 10_000 { 40 } else { 300 }) {
                    let (m, s) =
                        (moving.closest_at(fraction, o, d, f32::INFINITY, &Opaque), still.closest(o, d, f32::INFINITY, &Opaque));
                    assert_eq!(m.map(|h| h.id), s.map(|h| h.id), "{n} at {fraction}: ray {o} {d}");
                    assert_eq!(m.is_some(), moving.any_at(fraction, o, d, f32::INFINITY, &Opaque));
                    if let (Some(m), Some(s)) = (m, s) {
                        assert!((m.t - s.t).abs() <= 1e-5 * s.t.max(1.0), "{} {}", m.t, s.t);
                        assert_eq!(moving.corners_at(m.slot, fraction), still.corners(s.slot));
                    }
                }
            }
        }
    }

    #[test]
    fn chunks_are_joined_into_one_tree() {
        // More than two chunks; compare with a small sample of plain intersections.
        let n = (super::super::build::CHUNK * 5 / 2) as u32;
        let triangles = soup(n, 0.01);
        let bvh = Bvh::build(&triangles);
        let all = Bounds::around(triangles.0.iter().flatten().copied());
        assert_eq!(bvh.bounds(), all);
        for (o, d) in rays(60) {
            let plain = bvh.closest_plain(o, d, f32::INFINITY, &Opaque);
            assert_eq!(plain.map(|h| h.id), bvh.closest(o, d, f32::INFINITY, &Opaque).map(|h| h.id));
        }
    }

    #[test]
    fn no_ray_slips_between_triangles_that_share_edges() {
        // A closed, finely cut sphere far from the origin, seen from inside, with rays aimed at vertices and edges too.
        let center = Vec3::new(731.3, -212.7, 1043.1);
        let (rings, sectors) = (40, 60);
        let point = |i: u32, j: u32| {
            let (theta, phi) =
                (std::f32::consts::PI * i as f32 / rings as f32, std::f32::consts::TAU * (j % sectors) as f32 / sectors as f32);
            center + Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * 0.37
        };
        let mut triangles = Vec::new();
        let mut targets = Vec::new();
        for i in 0..rings {
            for j in 0..sectors {
                let (a, b, c, d) = (point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
                triangles.extend([[a, b, c], [a, c, d]]);
                targets.extend([b, (a + b) * 0.5, (a + c) * 0.5, a * 0.3 + c * 0.7]);
            }
        }
        let bvh = Bvh::build(&Triangles(triangles));
        for k in 0..4 {
            let origin = center + (random(k) - 0.5) * 0.2;
            for target in &targets {
                let d = (target - origin).normalize();
                assert!(bvh.any(origin, d, f32::INFINITY, &Opaque), "a ray towards {target} escaped");
            }
        }
    }

    #[test]
    fn flat_triangles_and_axis_parallel_rays_do_no_harm() {
        let bvh = Bvh::build(&Triangles(vec![
            [Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
            [Vec3::Y, Vec3::Y, Vec3::Y],
            [Vec3::new(-1.0, -1.0, 2.0), Vec3::new(1.0, -1.0, 2.0), Vec3::new(0.0, 1.0, 2.0)],
        ]));
        let hit = bvh.closest(Vec3::ZERO, Vec3::Z, 10.0, &Opaque).unwrap();
        assert_eq!((hit.id, hit.t), (2, 2.0));
        assert!(!bvh.any(Vec3::ZERO, Vec3::Z, 1.9, &Opaque));
        assert!(!bvh.any(Vec3::ZERO, Vec3::NEG_Z, 1e30, &Opaque));
    }
}

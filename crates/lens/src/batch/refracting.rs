//! Planes and spheres on the axis that refract: the kernel of most surfaces.

use fearless_simd::{Simd, prelude::*};

/// Rays between surfaces.
#[derive(Clone, Copy)]
pub(super) struct Rays<V, M> {
    pub position: [V; 3],
    pub direction: [V; 3],
    pub path: V,
    pub alive: M,
}

/// A plane or a sphere that refracts, in its place on the axis.
#[derive(Clone, Copy)]
pub(super) struct Refracting<F> {
    pub c: F,
    /// Light runs along z times this.
    pub run: F,
    /// From the last vertex to this one, mm.
    pub ahead: F,
    pub outer2: F,
}

/// One vector of rays through a [`Refracting`] surface between media of the indices `n` (before, after, inverse of after): the rays behind it, and the
/// cosines of incidence and refraction.
///
/// The discriminant of the intersection with a sphere is the square of the cosine of incidence (with unit directions, dF/dt = 2 d·n at the root), so that
/// Snell's square root does not wait for the place. One vector at a time keeps all of it in registers; the processor overlaps the two of a packet.
macro_rules! refract {
    ($name:ident, $float:ident, $vector:ident, $mask:ident) => {
        #[inline(always)]
        pub(super) fn $name<S: Simd>(
            simd: S,
            s: Refracting<$float>,
            n: [fearless_simd::$vector<S>; 3],
            r: Rays<fearless_simd::$vector<S>, fearless_simd::$mask<S>>,
        ) -> (Rays<fearless_simd::$vector<S>, fearless_simd::$mask<S>>, [fearless_simd::$vector<S>; 2]) {
            use fearless_simd::$vector as V;
            let (zero, one) = (V::splat(simd, 0.0), V::splat(simd, 1.0));
            let [px, py, z] = r.position;
            let [dx, dy, dz] = r.direction;
            let (c, run) = (V::splat(simd, s.c), V::splat(simd, s.run));
            let pz = z - V::splat(simd, s.ahead);
            let b = c * (px * dx + py * dy + pz * dz) - dz;
            let q = c * (px * px + py * py + pz * pz) - (pz + pz);
            let root2 = b * b - c * q;
            let mu = n[0] * n[2];
            let cos2 = one - mu * mu * (one - root2);
            let (cos0, cos1) = (root2.max(zero).sqrt(), cos2.max(zero).sqrt());
            let root = run * cos0;
            let mut t = q / (root - b);
            // Only rays beyond 90° come here.
            let far = (b * run).simd_gt(zero);
            if far.to_bitmask() != 0 {
                t = far.select((-b - root) / c, t);
            }
            let (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
            let facing = one - c * hz;
            let r2 = hx * hx + hy * hy;
            let alive =
                r.alive & root2.simd_ge(zero) & cos2.simd_ge(zero) & facing.simd_gt(zero) & r2.simd_le(V::splat(simd, s.outer2));
            let along = run * (cos1 - mu * cos0);
            let bend = along * c;
            let direction = [dx * mu - bend * hx, dy * mu - bend * hy, dz * mu + (along - bend * hz)];
            (Rays { position: [hx, hy, hz], direction, path: r.path + n[0] * t, alive }, [cos0, cos1])
        }
    };
}

refract!(refract_single, f32, f32x16, mask32x16);
refract!(refract_double, f64, f64x8, mask64x8);

//! The fast trace: packets of rays, structure of arrays, the same steps as [`crate::trace`] for all lanes at once.
//!
//! [`single`] traces 32 rays in f32 (pictures), [`double`] 16 rays in f64 (analysis): two vectors of 16 (8) side by side, because
//! square roots and divisions of one hide the waiting of the other. A lane that is lost goes on with whatever numbers it has and
//! is cleared in the mask that comes back. Indices come from a Chebyshev fit of each glass in 1/λ², so that every lane may have
//! its own wavelength.

use crate::glass::{Glass, GlassKind, VISIBLE_NM};
use crate::iris::Iris;
use crate::prescription::Coating;
use crate::surface::{Asphere, Profile};
use crate::system::{FILM_NM, MGF2, MULTILAYER_REFLECTANCE, System};
use crate::trace::Way;
use fearless_simd::{Level, Simd, dispatch, prelude::*};
use std::sync::OnceLock;

/// Coefficients of the fit of an index: degree 7 leaves less than 1e-7.
const TERMS: usize = 8;
/// Newton steps of an aspheric intersection after the conic's; the last ones change nothing a float holds.
const NEWTON_STEPS: usize = 7;

fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}

/// Chebyshev coefficients of n over x = (1/λ² scaled to −1..1).
fn fit(glass: &Glass) -> [f64; TERMS] {
    let [short, long] = VISIBLE_NM;
    let (low, high) = (long.powi(-2), short.powi(-2));
    let node = |j: usize| (std::f64::consts::PI * (j as f64 + 0.5) / TERMS as f64).cos();
    let value = |x: f64| glass.index((0.5 * (low + high) + 0.5 * (high - low) * x).powf(-0.5));
    std::array::from_fn(|k| {
        let sum: f64 =
            (0..TERMS).map(|j| value(node(j)) * (std::f64::consts::PI * k as f64 * (j as f64 + 0.5) / TERMS as f64).cos()).sum();
        sum * if k == 0 { 1.0 } else { 2.0 } / TERMS as f64
    })
}

/// Two vectors side by side, with the operations that the kernel needs.
macro_rules! pair {
    ($pair:ident, $mask_pair:ident, $float:ident, $half:literal, $vector:ident, $mask:ident) => {
        #[derive(Clone, Copy)]
        struct $pair<S: Simd>(fearless_simd::$vector<S>, fearless_simd::$vector<S>);

        #[derive(Clone, Copy)]
        struct $mask_pair<S: Simd>(fearless_simd::$mask<S>, fearless_simd::$mask<S>);

        impl<S: Simd> $pair<S> {
            #[inline(always)]
            fn splat(simd: S, v: $float) -> Self {
                let v = fearless_simd::$vector::splat(simd, v);
                $pair(v, v)
            }
            #[inline(always)]
            fn from_slice(simd: S, v: &[$float; 2 * $half]) -> Self {
                $pair(
                    fearless_simd::$vector::from_slice(simd, &v[..$half]),
                    fearless_simd::$vector::from_slice(simd, &v[$half..]),
                )
            }
            #[inline(always)]
            fn store_slice(self, out: &mut [$float; 2 * $half]) {
                self.0.store_slice(&mut out[..$half]);
                self.1.store_slice(&mut out[$half..]);
            }
            #[inline(always)]
            fn to_array(self) -> [$float; 2 * $half] {
                let mut out = [0.0; 2 * $half];
                self.store_slice(&mut out);
                out
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $pair(self.0.sqrt(), self.1.sqrt())
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $pair(self.0.abs(), self.1.abs())
            }
            #[inline(always)]
            fn max(self, o: Self) -> Self {
                $pair(self.0.max(o.0), self.1.max(o.1))
            }
            #[inline(always)]
            fn simd_gt(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_gt(o.0), self.1.simd_gt(o.1))
            }
            #[inline(always)]
            fn simd_ge(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_ge(o.0), self.1.simd_ge(o.1))
            }
            #[inline(always)]
            fn simd_le(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_le(o.0), self.1.simd_le(o.1))
            }
            #[inline(always)]
            fn simd_lt(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_lt(o.0), self.1.simd_lt(o.1))
            }
            #[inline(always)]
            fn simd_eq(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_eq(o.0), self.1.simd_eq(o.1))
            }
        }

        impl<S: Simd> $mask_pair<S> {
            #[inline(always)]
            fn to_bitmask(self) -> u64 {
                self.0.to_bitmask() | self.1.to_bitmask() << $half
            }
            #[inline(always)]
            fn select(self, a: $pair<S>, b: $pair<S>) -> $pair<S> {
                $pair(self.0.select(a.0, b.0), self.1.select(a.1, b.1))
            }
        }

        impl<S: Simd> std::ops::BitAnd for $mask_pair<S> {
            type Output = Self;
            #[inline(always)]
            fn bitand(self, o: Self) -> Self {
                $mask_pair(self.0 & o.0, self.1 & o.1)
            }
        }

        impl<S: Simd> std::ops::Neg for $pair<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                $pair(-self.0, -self.1)
            }
        }

        pair!(@operator $pair, Add, add, +);
        pair!(@operator $pair, Sub, sub, -);
        pair!(@operator $pair, Mul, mul, *);
        pair!(@operator $pair, Div, div, /);
    };
    (@operator $pair:ident, $trait:ident, $method:ident, $operator:tt) => {
        impl<S: Simd> std::ops::$trait for $pair<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, o: Self) -> Self {
                $pair(self.0 $operator o.0, self.1 $operator o.1)
            }
        }
    };
}

pair!(Single, SingleMask, f32, 16, f32x16, mask32x16);
pair!(Double, DoubleMask, f64, 8, f64x8, mask64x8);

macro_rules! batch {
    ($module:ident, $float:ident, $lanes:literal, $vector:ident, $mask:ident, $doc:literal) => {
        #[doc = $doc]
        pub mod $module {
            use super::*;
            /// Rays of a packet.
            pub const LANES: usize = $lanes;
            /// One number a ray.
            pub type Lanes = [$float; LANES];

            /// Rays, lens space: mm and unit directions.
            #[derive(Clone, Debug, PartialEq)]
            pub struct Packet {
                /// Position.
                pub x: Lanes,
                /// Position.
                pub y: Lanes,
                /// Position.
                pub z: Lanes,
                /// Direction.
                pub dx: Lanes,
                /// Direction.
                pub dy: Lanes,
                /// Direction.
                pub dz: Lanes,
                /// Optical path so far, mm.
                pub path: Lanes,
                /// Share of the light that is left; only [`Batch::trace_light`] changes it.
                pub share: Lanes,
            }

            impl Default for Packet {
                fn default() -> Self {
                    let o = [0.0; LANES];
                    Packet { x: o, y: o, z: o, dx: o, dy: o, dz: [1.0; LANES], path: o, share: [1.0; LANES] }
                }
            }

            impl Packet {
                /// Puts a ray into a lane.
                #[inline]
                pub fn set(&mut self, i: usize, position: [$float; 3], direction: [$float; 3]) {
                    [self.x[i], self.y[i], self.z[i]] = position;
                    [self.dx[i], self.dy[i], self.dz[i]] = direction;
                    self.path[i] = 0.0;
                    self.share[i] = 1.0;
                }
            }

            /// Index of every gap and its inverse, lane by lane.
            #[derive(Clone, Debug, Default, PartialEq)]
            pub struct Indices {
                /// `[gap][lane]`
                pub n: Vec<Lanes>,
                /// 1 / n
                inverse: Vec<Lanes>,
            }

            impl Indices {
                /// The same in all lanes: `n` as [`System::indices`], at any wavelength and not only where the fits hold.
                pub fn uniform(n: &[f64]) -> Indices {
                    let all = |f: fn(f64) -> f64| n.iter().map(|v| [f(*v) as $float; LANES]).collect();
                    Indices { n: all(|v| v), inverse: all(|v| 1.0 / v) }
                }
            }

            #[derive(Clone, Debug)]
            enum Shape {
                Plane,
                Sphere,
                Conic,
                Asphere(Vec<$float>),
                Toroid(Vec<$float>),
                /// Conic constant in x.
                Biconic($float),
            }

            #[derive(Clone, Debug)]
            struct Step {
                shape: Shape,
                c: $float,
                k: $float,
                c_x: $float,
                /// Sphere that stands in where the conic is missed.
                c_start: $float,
                z: $float,
                outer2: $float,
                inner2: $float,
                mirror: bool,
                stop: bool,
                /// Rows of the rotation into the local frame, and the place of the vertex.
                frame: Option<([[$float; 3]; 3], [$float; 3])>,
                /// Number of the surface.
                surface: usize,
            }

            /// A system prepared for packets.
            #[derive(Clone, Debug)]
            pub struct Batch {
                steps: Vec<Step>,
                /// `runs` of the system.
                runs: Vec<$float>,
                /// Fit of the glass in each gap; `None` for air.
                glasses: Vec<Option<[$float; TERMS]>>,
                /// Absorption of each gap at 380, 390, ... nm, 1/mm; empty where none is known.
                absorption: Vec<Vec<$float>>,
                stop_radius: $float,
                /// Half planes of a bladed iris: normal and distance, in mm.
                blades: Vec<[$float; 3]>,
                image: Option<Iris>,
                coating: Coating,
            }

            impl Batch {
                /// Prepares a system.
                pub fn new(system: &System) -> Batch {
                    let steps = system
                        .surfaces
                        .iter()
                        .enumerate()
                        .map(|(i, s)| {
                            let poly = |a: &Asphere| a.a.iter().map(|v| *v as $float).collect::<Vec<_>>();
                            let (shape, c, k) = match &s.profile {
                                Profile::Plane => (Shape::Plane, 0.0, 0.0),
                                Profile::Sphere(c) => (Shape::Sphere, *c, 0.0),
                                Profile::Conic { c, k } => (Shape::Conic, *c, *k),
                                Profile::Asphere(a) => (Shape::Asphere(poly(a)), a.c, a.k),
                                Profile::Toroid { y, .. } => (Shape::Toroid(poly(y)), y.c, y.k),
                                Profile::Biconic { k_x, c_y, k_y, .. } => (Shape::Biconic(*k_x as $float), *c_y, *k_y),
                            };
                            let frame = s.frame.as_ref().map(|f| {
                                let m = f.1.matrix3;
                                let row = |r: usize| [0, 1, 2].map(|c| m.col(c)[r] as $float);
                                let t = f.0.translation;
                                ([row(0), row(1), row(2)], [t.x as $float, t.y as $float, t.z as $float])
                            });
                            Step {
                                shape,
                                c: c as $float,
                                k: k as $float,
                                c_x: s.profile.curvature_x() as $float,
                                c_start: s.profile.curvature() as $float,
                                z: s.z as $float,
                                outer2: (s.semi_diameter * s.semi_diameter) as $float,
                                inner2: (s.obstruction * s.obstruction) as $float,
                                mirror: s.mirror,
                                stop: i == system.stop,
                                frame,
                                surface: i,
                            }
                        })
                        .collect();
                    let blades = match &system.iris.shape {
                        Iris::Blades(b) => {
                            let edge = |e: &[f64; 3]| [e[0] as $float, e[1] as $float, (e[2] * system.iris.radius) as $float];
                            b.edges().iter().map(edge).collect()
                        }
                        _ => vec![],
                    };
                    let absorption = |g: &Glass| match g.knows_absorption() {
                        true => (0..=40).map(|i| g.absorption(380.0 + 10.0 * i as f64) as $float).collect(),
                        false => vec![],
                    };
                    Batch {
                        steps,
                        runs: system.runs.iter().map(|r| *r as $float).collect(),
                        glasses: system
                            .glasses
                            .iter()
                            .map(|g| (g.kind != GlassKind::Air).then(|| fit(g).map(|c| c as $float)))
                            .collect(),
                        absorption: system.glasses.iter().map(absorption).collect(),
                        stop_radius: system.iris.radius as $float,
                        blades,
                        image: matches!(system.iris.shape, Iris::Image(_)).then(|| system.iris.shape.clone()),
                        coating: system.coating,
                    }
                }

                /// Index of every gap at each lane's wavelength (nm), into `out`.
                pub fn indices(&self, nm: &Lanes, out: &mut Indices) {
                    dispatch!(level(), simd => indices(simd, self, nm, out));
                }

                /// Follows a packet through all surfaces; the mask has a bit for each ray that came through.
                pub fn trace(&self, packet: &mut Packet, n: &Indices, way: Way) -> u32 {
                    dispatch!(level(), simd => trace::<_, false>(simd, self, packet, n, &[0.0; LANES], way))
                }

                /// The same, and what glass, surfaces and an aperture picture leave of the light: [`Packet::share`].
                pub fn trace_light(&self, packet: &mut Packet, n: &Indices, nm: &Lanes, way: Way) -> u32 {
                    dispatch!(level(), simd => trace::<_, true>(simd, self, packet, n, nm, way))
                }

                /// Follows many packets of one wavelength (indices as for [`Batch::trace`]) in one go; returns the masks.
                pub fn trace_many(&self, packets: &mut [Packet], n: &Indices, way: Way) -> Vec<u32> {
                    dispatch!(level(), simd => trace_many(simd, self, packets, n, way))
                }
            }

            #[inline(always)]
            fn trace_many<S: Simd>(simd: S, batch: &Batch, packets: &mut [Packet], n: &Indices, way: Way) -> Vec<u32> {
                let mut masks = Vec::with_capacity(packets.len());
                for p in packets {
                    masks.push(trace::<S, false>(simd, batch, p, n, &[0.0; LANES], way));
                }
                masks
            }

            #[inline(always)]
            fn indices<S: Simd>(simd: S, batch: &Batch, nm: &Lanes, out: &mut Indices) {
                let [short, long] = VISIBLE_NM;
                let (low, high) = (long.powi(-2), short.powi(-2));
                let scale = $vector::splat(simd, (2.0 / (high - low)) as $float);
                let offset = $vector::splat(simd, ((high + low) / (high - low)) as $float);
                let one = $vector::splat(simd, 1.0);
                let nm = $vector::from_slice(simd, nm);
                let x = scale / (nm * nm) - offset;
                let twice = x + x;
                out.n.resize(batch.glasses.len(), [1.0; LANES]);
                out.inverse.resize(batch.glasses.len(), [1.0; LANES]);
                for (fit, (n, inverse)) in batch.glasses.iter().zip(out.n.iter_mut().zip(out.inverse.iter_mut())) {
                    let mut value = one;
                    if let Some(fit) = fit {
                        // Clenshaw's recurrence.
                        let (mut b1, mut b2) = ($vector::splat(simd, 0.0), $vector::splat(simd, 0.0));
                        let mut k = TERMS - 1;
                        while k > 0 {
                            let b0 = twice * b1 - b2 + $vector::splat(simd, fit[k]);
                            b2 = b1;
                            b1 = b0;
                            k -= 1;
                        }
                        value = x * b1 - b2 + $vector::splat(simd, fit[0]);
                    }
                    value.store_slice(n);
                    (one / value).store_slice(inverse);
                }
            }

            /// z and z'/r of a rotational asphere or of the profile of a toroid.
            #[inline(always)]
            fn sag<S: Simd>(
                simd: S,
                c: $vector<S>,
                k1: $vector<S>,
                a: &[$float],
                r2: $vector<S>,
            ) -> ($vector<S>, $vector<S>, $mask<S>) {
                let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
                let root2 = one - k1 * c * c * r2;
                let real = root2.simd_gt(zero);
                let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                let r = r2.sqrt();
                let (mut z, mut slope) = (zero, zero);
                let mut i = a.len();
                while i > 1 {
                    i -= 1;
                    slope = slope * r + z;
                    z = z * r + $vector::splat(simd, a[i]);
                }
                // Now Σ aᵢ rⁱ⁻¹ and its derivative: the slope over r needs a₁ = 0 at the axis, which r's floor keeps finite.
                let over_r = slope + z / r.max($vector::splat(simd, 1e-9));
                (c * r2 / (one + root) + z * r, c / root + over_r, real)
            }

            #[inline(always)]
            fn trace<S: Simd, const LIGHT: bool>(
                simd: S,
                batch: &Batch,
                packet: &mut Packet,
                n: &Indices,
                nm: &Lanes,
                way: Way,
            ) -> u32 {
                let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
                let two = $vector::splat(simd, 2.0);
                let (mut ox, mut oy, mut oz) = (
                    $vector::from_slice(simd, &packet.x),
                    $vector::from_slice(simd, &packet.y),
                    $vector::from_slice(simd, &packet.z),
                );
                let (mut dx, mut dy, mut dz) = (
                    $vector::from_slice(simd, &packet.dx),
                    $vector::from_slice(simd, &packet.dy),
                    $vector::from_slice(simd, &packet.dz),
                );
                let mut path = zero;
                let mut share = one;
                let mut depth = zero;
                let mut alive = one.simd_gt(zero);
                // Positions are kept relative to the vertex of the surface last met: f32 has its digits where they count.
                let mut z_origin: $float = 0.0;
                let count = batch.steps.len();
                for number in 0..count {
                    let (i, before, after) = match way {
                        Way::ToFilm => (number, number, number + 1),
                        Way::ToObject => (count - 1 - number, count - number, count - 1 - number),
                    };
                    let step = &batch.steps[i];
                    let run = match way {
                        Way::ToFilm => batch.runs[before],
                        Way::ToObject => -batch.runs[before],
                    };
                    let sense = $vector::splat(simd, run);
                    let (mut px, mut py, mut pz) = (ox, oy, oz - $vector::splat(simd, step.z - z_origin));
                    z_origin = step.z;
                    if let Some((m, t)) = &step.frame {
                        let (x, y) = (px - $vector::splat(simd, t[0]), py - $vector::splat(simd, t[1]));
                        let z = pz - $vector::splat(simd, t[2] - step.z);
                        (px, py, pz) = rotate(simd, m, x, y, z);
                        (dx, dy, dz) = rotate(simd, m, dx, dy, dz);
                    }
                    let c = $vector::splat(simd, step.c);
                    let (t, nx, ny, nz, hit);
                    let (hx, hy, hz);
                    match &step.shape {
                        Shape::Plane => {
                            t = -pz / dz;
                            hit = t.simd_eq(t);
                            (hx, hy, hz) = (px + dx * t, py + dy * t, zero);
                            (nx, ny, nz) = (zero, zero, one);
                        }
                        Shape::Sphere => {
                            let b = c * (px * dx + py * dy + pz * dz) - dz;
                            let q = c * (px * px + py * py + pz * pz) - two * pz;
                            let (t0, real) = root(simd, c, b, q, sense);
                            t = t0;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                            (nx, ny, nz) = (-(c * hx), -(c * hy), one - c * hz);
                            hit = real & nz.simd_gt(zero);
                        }
                        Shape::Conic => {
                            let k = $vector::splat(simd, step.k);
                            let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                            t = t0;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                            let along = one - c * (one + k) * hz;
                            let (gx, gy) = (-(c * hx), -(c * hy));
                            let length = (gx * gx + gy * gy + along * along).sqrt();
                            (nx, ny, nz) = (gx / length, gy / length, along / length);
                            hit = real & along.simd_gt(zero);
                        }
                        Shape::Asphere(a) => {
                            let k = $vector::splat(simd, step.k);
                            let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                            let c1 = $vector::splat(simd, step.c_start);
                            let (t1, real1) = conic(simd, c1, zero, px, py, pz, dx, dy, dz, sense);
                            let plane = -pz / dz;
                            let mut s = real.select(t0, real1.select(t1, plane));
                            let k1 = one + k;
                            let mut residual = one;
                            let mut slope = zero;
                            let mut on = real;
                            let mut pass = 0;
                            while pass <= NEWTON_STEPS {
                                let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                                let (height, over_r, real) = sag::<S>(simd, c, k1, a, x * x + y * y);
                                residual = z - height;
                                slope = over_r;
                                on = real;
                                if pass < NEWTON_STEPS {
                                    let step = residual / (dz - over_r * (x * dx + y * dy));
                                    s = s - step;
                                }
                                pass += 1;
                            }
                            t = s;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                            let (gx, gy) = (-(slope * hx), -(slope * hy));
                            let length = (gx * gx + gy * gy + one).sqrt();
                            (nx, ny, nz) = (gx / length, gy / length, one / length);
                            let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                            hit = on & residual.abs().simd_lt(scale);
                        }
                        Shape::Toroid(a) => {
                            let k1 = one + $vector::splat(simd, step.k);
                            let cx = $vector::splat(simd, step.c_x);
                            let mut s = -pz / dz;
                            let mut residual = one;
                            let (mut gx, mut gy) = (zero, zero);
                            let mut on = alive;
                            let mut pass = 0;
                            while pass <= NEWTON_STEPS {
                                let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                                let (f, over_y, real) = sag::<S>(simd, c, k1, a, y * y);
                                let b = one - cx * f;
                                let root2 = b * b - cx * cx * x * x;
                                let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                                let height = f + cx * x * x / (b + root);
                                gx = cx * x / root;
                                gy = over_y * y * b / root;
                                residual = z - height;
                                on = real & root2.simd_gt(zero);
                                if pass < NEWTON_STEPS {
                                    s = s - residual / (dz - gx * dx - gy * dy);
                                }
                                pass += 1;
                            }
                            t = s;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                            let length = (gx * gx + gy * gy + one).sqrt();
                            (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                            let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                            hit = on & residual.abs().simd_lt(scale);
                        }
                        Shape::Biconic(k_x) => {
                            let (kx1, ky1) = (one + $vector::splat(simd, *k_x), one + $vector::splat(simd, step.k));
                            let cx = $vector::splat(simd, step.c_x);
                            let mut s = -pz / dz;
                            let mut residual = one;
                            let (mut gx, mut gy) = (zero, zero);
                            let mut on = alive;
                            let mut pass = 0;
                            while pass <= NEWTON_STEPS {
                                let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                                let (ax, ay) = (cx * x, c * y);
                                let root2 = one - kx1 * ax * ax - ky1 * ay * ay;
                                let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                                let inverse = one / (one + root);
                                let height = (ax * x + ay * y) * inverse;
                                let bend = height / root;
                                gx = (two * ax + bend * kx1 * cx * ax) * inverse;
                                gy = (two * ay + bend * ky1 * c * ay) * inverse;
                                residual = z - height;
                                on = root2.simd_gt(zero);
                                if pass < NEWTON_STEPS {
                                    s = s - residual / (dz - gx * dx - gy * dy);
                                }
                                pass += 1;
                            }
                            t = s;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                            let length = (gx * gx + gy * gy + one).sqrt();
                            (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                            let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                            hit = on & residual.abs().simd_lt(scale);
                        }
                    }
                    let r2 = hx * hx + hy * hy;
                    alive = alive & hit & r2.simd_le($vector::splat(simd, step.outer2));
                    if step.inner2 > 0.0 {
                        alive = alive & r2.simd_ge($vector::splat(simd, step.inner2));
                    }
                    if step.stop {
                        if batch.blades.is_empty() && batch.image.is_none() {
                            alive = alive & r2.simd_le($vector::splat(simd, batch.stop_radius * batch.stop_radius));
                        }
                        for [ex, ey, distance] in &batch.blades {
                            let along = hx * $vector::splat(simd, *ex) + hy * $vector::splat(simd, *ey);
                            alive = alive & along.simd_le($vector::splat(simd, *distance));
                        }
                        if let Some(image) = &batch.image {
                            let (x, y) = (hx.to_array(), hy.to_array());
                            let mut passes = [0.0; LANES];
                            for lane in 0..LANES {
                                let (u, v) = (x[lane] / batch.stop_radius, y[lane] / batch.stop_radius);
                                passes[lane] = image.transmittance(u as f64, v as f64) as $float;
                            }
                            let passes = $vector::from_slice(simd, &passes);
                            alive = alive & passes.simd_gt(zero);
                            share = share * passes;
                        }
                    }
                    let n0 = $vector::from_slice(simd, &n.n[before]);
                    path = path + n0 * t;
                    let facing = dx * nx + dy * ny + dz * nz;
                    if step.mirror {
                        let along = two * facing;
                        (dx, dy, dz) = (dx - nx * along, dy - ny * along, dz - nz * along);
                    } else {
                        let mu = n0 * $vector::from_slice(simd, &n.inverse[after]);
                        let cos2 = one - mu * mu * (one - facing * facing);
                        alive = alive & cos2.simd_ge(zero);
                        let cos1 = cos2.max(zero).sqrt();
                        let along = sense * cos1 - mu * facing;
                        (dx, dy, dz) = (dx * mu + nx * along, dy * mu + ny * along, dz * mu + nz * along);
                        if LIGHT {
                            let n1 = $vector::from_slice(simd, &n.n[after]);
                            let cos0 = facing.abs();
                            match batch.coating {
                                Coating::Perfect => {}
                                Coating::Multilayer => {
                                    let coated = batch.glasses[before].is_none() != batch.glasses[after].is_none();
                                    if coated {
                                        share = share * $vector::splat(simd, (1.0 - MULTILAYER_REFLECTANCE) as $float);
                                    } else if batch.glasses[before].is_some() {
                                        share = share * fresnel(simd, n0, n1, cos0, cos1);
                                    }
                                }
                                Coating::MagnesiumFluoride
                                    if batch.glasses[before].is_none() != batch.glasses[after].is_none() =>
                                {
                                    share = share * quarter_wave(simd, n0, n1, cos0, cos1, $vector::from_slice(simd, nm));
                                }
                                _ => share = share * fresnel(simd, n0, n1, cos0, cos1),
                            }
                        }
                    }
                    if LIGHT {
                        if step.mirror {
                            let mut reflected = [0.0; LANES];
                            for lane in 0..LANES {
                                reflected[lane] = crate::system::aluminium(nm[lane] as f64) as $float;
                            }
                            share = share * $vector::from_slice(simd, &reflected);
                        }
                        let table = &batch.absorption[before];
                        if !table.is_empty() {
                            let mut alpha = [0.0; LANES];
                            for lane in 0..LANES {
                                let at = ((nm[lane] - 380.0) * 0.1).clamp(0.0, 39.999);
                                let i = at as usize;
                                alpha[lane] = table[i] + (table[i + 1] - table[i]) * (at - i as $float);
                            }
                            depth = depth + $vector::from_slice(simd, &alpha) * t.abs();
                        }
                    }
                    (ox, oy, oz) = (hx, hy, hz);
                    if let Some((m, t)) = &step.frame {
                        let (x, y, z) = rotate_back(simd, m, hx, hy, hz);
                        ox = x + $vector::splat(simd, t[0]);
                        oy = y + $vector::splat(simd, t[1]);
                        oz = z + $vector::splat(simd, t[2] - step.z);
                        (dx, dy, dz) = rotate_back(simd, m, dx, dy, dz);
                    }
                    debug_assert_eq!(step.surface, i);
                }
                ox.store_slice(&mut packet.x);
                oy.store_slice(&mut packet.y);
                (oz + $vector::splat(simd, z_origin)).store_slice(&mut packet.z);
                dx.store_slice(&mut packet.dx);
                dy.store_slice(&mut packet.dy);
                dz.store_slice(&mut packet.dz);
                path.store_slice(&mut packet.path);
                if LIGHT {
                    share.store_slice(&mut packet.share);
                    let depth = depth.to_array();
                    if batch.absorption.iter().any(|a| !a.is_empty()) {
                        for lane in 0..LANES {
                            packet.share[lane] *= (-depth[lane]).exp();
                        }
                    }
                }
                alive.to_bitmask() as u32
            }

            /// Root of a t² + 2 b t + q nearest the vertex, as in the plain trace.
            #[inline(always)]
            fn root<S: Simd>(
                simd: S,
                a: $vector<S>,
                b: $vector<S>,
                q: $vector<S>,
                sense: $vector<S>,
            ) -> ($vector<S>, $mask<S>) {
                let zero = $vector::splat(simd, 0.0);
                let root2 = b * b - a * q;
                let real = root2.simd_ge(zero);
                let root = sense * root2.max(zero).sqrt();
                let far = (b * sense).simd_gt(zero);
                let mut t = q / (root - b);
                // Only rays beyond 90° come here.
                if far.to_bitmask() != 0 {
                    t = far.select((-b - root) / a, t);
                }
                (t, real)
            }

            #[inline(always)]
            fn conic<S: Simd>(
                simd: S,
                c: $vector<S>,
                k: $vector<S>,
                px: $vector<S>,
                py: $vector<S>,
                pz: $vector<S>,
                dx: $vector<S>,
                dy: $vector<S>,
                dz: $vector<S>,
                sense: $vector<S>,
            ) -> ($vector<S>, $mask<S>) {
                let one = $vector::splat(simd, 1.0);
                let a = c * (one + k * dz * dz);
                let b = c * (px * dx + py * dy + pz * dz + k * pz * dz) - dz;
                let q = c * (px * px + py * py + pz * pz + k * pz * pz) - (pz + pz);
                root(simd, a, b, q, sense)
            }

            #[inline(always)]
            fn rotate<S: Simd>(
                simd: S,
                m: &[[$float; 3]; 3],
                x: $vector<S>,
                y: $vector<S>,
                z: $vector<S>,
            ) -> ($vector<S>, $vector<S>, $vector<S>) {
                let s = [
                    [$vector::splat(simd, m[0][0]), $vector::splat(simd, m[0][1]), $vector::splat(simd, m[0][2])],
                    [$vector::splat(simd, m[1][0]), $vector::splat(simd, m[1][1]), $vector::splat(simd, m[1][2])],
                    [$vector::splat(simd, m[2][0]), $vector::splat(simd, m[2][1]), $vector::splat(simd, m[2][2])],
                ];
                (
                    s[0][0] * x + s[0][1] * y + s[0][2] * z,
                    s[1][0] * x + s[1][1] * y + s[1][2] * z,
                    s[2][0] * x + s[2][1] * y + s[2][2] * z,
                )
            }

            #[inline(always)]
            fn rotate_back<S: Simd>(
                simd: S,
                m: &[[$float; 3]; 3],
                x: $vector<S>,
                y: $vector<S>,
                z: $vector<S>,
            ) -> ($vector<S>, $vector<S>, $vector<S>) {
                let t = [
                    [m[0][0], m[1][0], m[2][0]],
                    [m[0][1], m[1][1], m[2][1]],
                    [m[0][2], m[1][2], m[2][2]],
                ];
                rotate(simd, &t, x, y, z)
            }

            #[inline(always)]
            fn fresnel<S: Simd>(
                simd: S,
                n0: $vector<S>,
                n1: $vector<S>,
                c0: $vector<S>,
                c1: $vector<S>,
            ) -> $vector<S> {
                let s = (n0 * c0 - n1 * c1) / (n0 * c0 + n1 * c1);
                let p = (n1 * c0 - n0 * c1) / (n1 * c0 + n0 * c1);
                $vector::splat(simd, 1.0) - $vector::splat(simd, 0.5) * (s * s + p * p)
            }

            #[inline(always)]
            fn quarter_wave<S: Simd>(
                simd: S,
                n0: $vector<S>,
                n1: $vector<S>,
                c0: $vector<S>,
                c1: $vector<S>,
                nm: $vector<S>,
            ) -> $vector<S> {
                let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
                let film = $vector::splat(simd, MGF2 as $float);
                let ratio = n0 / film;
                let cf = (one - ratio * ratio * (one - c0 * c0)).max(zero).sqrt();
                // The phase lies around π: −cos(phase − π) by its series.
                let pi = $vector::splat(simd, std::$float::consts::PI);
                let u = $vector::splat(simd, (std::f64::consts::PI * FILM_NM) as $float) / nm * cf - pi;
                let v = u * u;
                let series = |c: f64| $vector::splat(simd, c as $float);
                let cosine = series(1.0)
                    + v * (series(-0.5)
                        + v * (series(1.0 / 24.0) + v * (series(-1.0 / 720.0) + v * (series(1.0 / 40320.0) - v * series(1.0 / 3628800.0)))));
                let cosine = -cosine;
                let rs0 = (n0 * c0 - film * cf) / (n0 * c0 + film * cf);
                let rs1 = (film * cf - n1 * c1) / (film * cf + n1 * c1);
                let rp0 = (film * c0 - n0 * cf) / (film * c0 + n0 * cf);
                let rp1 = (n1 * cf - film * c1) / (n1 * cf + film * c1);
                let xs = (rs0 * rs1 + rs0 * rs1) * cosine;
                let xp = (rp0 * rp1 + rp0 * rp1) * cosine;
                let s = (rs0 * rs0 + rs1 * rs1 + xs) / (one + rs0 * rs0 * rs1 * rs1 + xs);
                let p = (rp0 * rp0 + rp1 * rp1 + xp) / (one + rp0 * rp0 * rp1 * rp1 + xp);
                one - $vector::splat(simd, 0.5) * (s + p)
            }

            /// What may be left of an aspheric intersection, relative to the distance gone.
            const RESIDUAL: $float = if $float::EPSILON > 1e-10 { 2e-5 } else { 1e-11 };
        }
    };
}

batch!(single, f32, 32, Single, SingleMask, "32 rays at once in f32.");
batch!(double, f64, 16, Double, DoubleMask, "16 rays at once in f64.");

//! The fast trace: packets of rays, structure of arrays, the same steps as [`crate::trace`] for all lanes at once.
//!
//! [`single`] traces 32 rays in f32 (pictures), [`double`] 16 rays in f64 (analysis): two vectors of 16 (8) side by side, because
//! square roots and divisions of one hide the waiting of the other. Spheres and planes on the axis that refract, which most surfaces are, have a kernel of
//! their own (`Refracting`). Products and sums are not fused, so that machines with and without such instructions give the same bits. A lane that is lost goes on with whatever numbers it has and
//! is cleared in the mask that comes back. Indices come from a Chebyshev fit of each glass in 1/λ², so that every lane may have
//! its own wavelength.

use crate::aperture::Aperture;
use crate::coating::film::{FILM_NM, MGF2};
use crate::coating::{LightTable, SurfaceCoating};
use crate::diffractive::Diffractive;
use crate::forbes::{Forbes, ForbesKind};
use crate::glass::{Glass, GlassKind, VISIBLE_NM};
use crate::iris::Iris;
use crate::polynomial::Polynomial;
use crate::ray::{TracedRay, Way};
use crate::surface::{Asphere, Profile};
use crate::system::System;
use fearless_simd::{Level, Simd, dispatch, prelude::*};
use glam::DVec3;
use std::ops::Range;
use std::sync::{Arc, LazyLock, OnceLock};

/// Coefficients of the fit of an index: degree 7 leaves less than 1e-7.
const TERMS: usize = 8;
/// Newton steps of an aspheric intersection after the conic's; the last ones change nothing a float holds.
const NEWTON_STEPS: usize = 7;

pub(crate) fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}

/// cos(π k (j + ½) / TERMS)
static COSINES: LazyLock<[[f64; TERMS]; TERMS]> = LazyLock::new(|| {
    let at = |k: usize, j: usize| (std::f64::consts::PI * k as f64 * (j as f64 + 0.5) / TERMS as f64).cos();
    std::array::from_fn(|k| std::array::from_fn(|j| at(k, j)))
});

/// Chebyshev coefficients of n over x = (1/λ² scaled to −1..1).
fn fit(glass: &Glass) -> [f64; TERMS] {
    let [short, long] = VISIBLE_NM;
    let (low, high) = (long.powi(-2), short.powi(-2));
    let value = |x: f64| glass.index((0.5 * (low + high) + 0.5 * (high - low) * x).powf(-0.5));
    let values: [f64; TERMS] = COSINES[1].map(value);
    std::array::from_fn(|k| {
        let sum: f64 = values.iter().zip(&COSINES[k]).map(|(v, c)| v * c).sum();
        sum * if k == 0 { 1.0 } else { 2.0 } / TERMS as f64
    })
}

/// What is on a surface, as packets need it.
#[derive(Clone, Debug)]
enum Coated {
    Bare,
    Perfect,
    /// Lets this fraction through.
    Flat(f64),
    QuarterWave,
    Table(Arc<LightTable>),
}

/// What is on each surface; surfaces with the same films between the same media share a table.
fn coatings(system: &System) -> Vec<Coated> {
    let mut tables: Vec<Arc<LightTable>> = vec![];
    let coated = |(i, s): (usize, &crate::system::PlacedSurface)| match &s.coating {
        SurfaceCoating::Bare => Coated::Bare,
        SurfaceCoating::Perfect => Coated::Perfect,
        SurfaceCoating::Flat(reflectance) => Coated::Flat(1.0 - reflectance),
        SurfaceCoating::QuarterWave => Coated::QuarterWave,
        SurfaceCoating::Layers(stack) => {
            let media = [&system.glasses[i], &system.glasses[i + 1]];
            let known = tables.iter().find(|t| t.serves(stack, media, s.mirror)).cloned();
            Coated::Table(known.unwrap_or_else(|| {
                let table = Arc::new(LightTable::new(stack, media, s.mirror));
                tables.push(table.clone());
                table
            }))
        }
    };
    system.surfaces.iter().enumerate().map(coated).collect()
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

/// Rays between surfaces.
#[derive(Clone, Copy)]
struct Rays<V, M> {
    position: [V; 3],
    direction: [V; 3],
    path: V,
    alive: M,
}

/// A plane or a sphere that refracts, in its place on the axis.
#[derive(Clone, Copy)]
struct Refracting<F> {
    c: F,
    /// Light runs along z times this.
    run: F,
    /// From the last vertex to this one, mm.
    ahead: F,
    outer2: F,
}

/// One vector of rays through a [`Refracting`] surface between media of the indices `n` (before, after, inverse of after): the rays behind it, and the
/// cosines of incidence and refraction.
///
/// The discriminant of the intersection with a sphere is the square of the cosine of incidence (with unit directions, dF/dt = 2 d·n at the root), so that
/// Snell's square root does not wait for the place. One vector at a time keeps all of it in registers; the processor overlaps the two of a packet.
macro_rules! refract {
    ($name:ident, $float:ident, $vector:ident, $mask:ident) => {
        #[inline(always)]
        fn $name<S: Simd>(
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

macro_rules! batch {
    ($module:ident, $float:ident, $lanes:literal, $vector:ident, $mask:ident, $refract:ident, $doc:literal) => {
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
                /// Fraction of the light that is left; only [`Batch::trace_light`] changes it.
                pub fraction: Lanes,
            }

            impl Default for Packet {
                fn default() -> Self {
                    let o = [0.0; LANES];
                    Packet { x: o, y: o, z: o, dx: o, dy: o, dz: [1.0; LANES], path: o, fraction: [1.0; LANES] }
                }
            }

            impl Packet {
                /// Puts a ray into a lane.
                #[inline]
                pub fn set(&mut self, i: usize, position: [$float; 3], direction: [$float; 3]) {
                    [self.x[i], self.y[i], self.z[i]] = position;
                    [self.dx[i], self.dy[i], self.dz[i]] = direction;
                    self.path[i] = 0.0;
                    self.fraction[i] = 1.0;
                }
            }

            /// Index of every gap and its inverse, lane by lane.
            #[derive(Clone, Debug, Default, PartialEq)]
            pub struct Indices {
                /// `[gap][lane]`; of a lens with diffractive surfaces the wavelengths behind them, mm.
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
                Forbes(QSeries),
                Toroid(Vec<$float>),
                /// Conic constant in x.
                Biconic($float),
                Freeform(Vec<$float>, PlaneSeries),
                Fresnel(Vec<$float>),
            }

            /// A polynomial over the plane: [`Polynomial`].
            #[derive(Clone, Debug)]
            struct PlaneSeries {
                /// 1 over the normalisation radius.
                scale: $float,
                /// Coefficients of ρ, ρ², ...
                radial: Vec<$float>,
                /// Rows of powers of v, each over powers of u.
                rows: Vec<Vec<$float>>,
                /// Azimuthal frequency, and weights and recurrence of each term.
                rings: Vec<(usize, Vec<[$float; 5]>)>,
            }

            impl PlaneSeries {
                fn new(p: &Polynomial) -> PlaneSeries {
                    let all = |v: &Vec<f64>| v.iter().map(|v| *v as $float).collect::<Vec<_>>();
                    PlaneSeries {
                        scale: (1.0 / p.norm_mm()) as $float,
                        radial: all(&p.terms().radial),
                        rows: p.rows().iter().map(all).collect(),
                        rings: p.rings().iter().map(|r| (r.m, r.terms.iter().map(|t| t.map(|v| v as $float)).collect())).collect(),
                    }
                }
            }

            /// A phase on a surface.
            #[derive(Clone, Debug)]
            struct Phase {
                /// Order over 2π.
                order: $float,
                series: PlaneSeries,
                /// What tells the efficiency, where it is not 1, with the step of the relief at the blaze.
                blazed: Option<(Arc<Diffractive>, f64)>,
            }

            /// Polynomials of a Q-type asphere.
            #[derive(Clone, Debug)]
            struct QSeries {
                kind: ForbesKind,
                /// 1 over the square of the normalisation radius.
                scale: $float,
                first: $float,
                /// Weight, then α, β, γ of the recurrence, of each term.
                terms: Vec<[$float; 4]>,
            }

            impl QSeries {
                fn new(f: &Forbes) -> QSeries {
                    let (weights, first, recurrence) = f.series();
                    let term = |(w, [a, b, g]): (&f64, &[f64; 3])| [*w, *a, *b, *g].map(|v| v as $float);
                    let scale = (1.0 / (f.norm_mm() * f.norm_mm())) as $float;
                    let terms = weights.iter().zip(recurrence).map(term).collect();
                    QSeries { kind: f.kind(), scale, first: first as $float, terms }
                }
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
                apertures: Vec<Aperture>,
                mirror: bool,
                ideal_focal_length: Option<$float>,
                phase: Option<Phase>,
                coating: Coated,
                stop: bool,
                /// Whether it is a plane or a sphere on the axis that refracts, and clips by nothing but a circle.
                refracting: bool,
                /// Square of the radius of that circle.
                open2: $float,
                /// Rows of the rotation into the local frame, and the place of the vertex.
                frame: Option<([[$float; 3]; 3], [$float; 3])>,
                /// Number of the surface.
                surface: usize,
            }

            fn rows(m: &glam::DMat3) -> [[$float; 3]; 3] {
                [0, 1, 2].map(|r| [0, 1, 2].map(|c| m.col(c)[r] as $float))
            }

            /// A system prepared for packets.
            #[derive(Clone, Debug)]
            pub struct Batch {
                steps: Vec<Step>,
                /// `runs` of the system.
                runs: Vec<$float>,
                /// Fit of the glass in each gap; `None` for air.
                glasses: Vec<Option<[$float; TERMS]>>,
                /// What the fits are of: beyond their range it is asked itself.
                media: Vec<Glass>,
                /// Absorption of each gap at 380, 390, ... nm, 1/mm; empty where none is known.
                absorption: Vec<Vec<$float>>,
                stop_radius: $float,
                /// Half planes of a bladed iris: normal and distance, in mm.
                blades: Vec<[$float; 3]>,
                image: Option<Iris>,
                /// Whether any surface carries a phase.
                diffractive: bool,
                /// Rows of the rotation into lens space from the object's, and its origin there, where the object has an axis of its own.
                object_axis: Option<([[$float; 3]; 3], [$float; 3])>,
                /// The system itself, where gaps have gradients: rays cross those one by one, as in the plain trace.
                graded: Option<Arc<System>>,
            }

            impl Batch {
                /// Prepares a system.
                pub fn new(system: &System) -> Batch {
                    let mut coatings = coatings(system).into_iter();
                    let round_iris = !matches!(system.iris.shape, Iris::Blades(_) | Iris::Image(_));
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
                                Profile::Forbes(f) => (Shape::Forbes(QSeries::new(f)), f.c(), f.k()),
                                Profile::Toroid { y, .. } => (Shape::Toroid(poly(y)), y.c, y.k),
                                Profile::Biconic { k_x, c_y, k_y, .. } => (Shape::Biconic(*k_x as $float), *c_y, *k_y),
                                Profile::Freeform(f) => {
                                    let b = &f.base;
                                    (Shape::Freeform(poly(b), PlaneSeries::new(&f.departure)), b.c, b.k)
                                }
                                Profile::Fresnel(a) => (Shape::Fresnel(poly(a)), a.c, a.k),
                            };
                            let frame = s.frame.as_ref().map(|f| (rows(&f.1.matrix3), f.0.translation.to_array().map(|v| v as $float)));
                            Step {
                                shape,
                                c: c as $float,
                                k: k as $float,
                                c_x: s.profile.curvature_x() as $float,
                                c_start: s.profile.curvature() as $float,
                                z: s.z as $float,
                                outer2: (s.semi_diameter * s.semi_diameter) as $float,
                                inner2: (s.obstruction * s.obstruction) as $float,
                                apertures: s.apertures.clone(),
                                mirror: s.mirror,
                                ideal_focal_length: s.ideal_focal_length.map(|f| f as $float),
                                phase: s.diffractive.as_ref().map(|d| Phase {
                                    order: d.path_per_phase(1.0) as $float,
                                    series: PlaneSeries::new(d.phase()),
                                    blazed: d.blaze().map(|_| (Arc::new(d.clone()), system.blaze_step(i))),
                                }),
                                coating: coatings.next().unwrap_or(Coated::Bare),
                                stop: i == system.stop,
                                refracting: matches!(s.profile, Profile::Plane | Profile::Sphere(_))
                                    && s.frame.is_none()
                                    && !s.mirror
                                    && s.apertures.is_empty()
                                    && s.obstruction == 0.0
                                    && s.ideal_focal_length.is_none()
                                    && s.diffractive.is_none()
                                    && system.gradients[i].is_none()
                                    && system.gradients[i + 1].is_none()
                                    && (i != system.stop || round_iris),
                                open2: (if i == system.stop { s.semi_diameter.min(system.iris.radius) } else { s.semi_diameter }).powi(2) as $float,
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
                        media: system.glasses.clone(),
                        absorption: system.glasses.iter().map(absorption).collect(),
                        stop_radius: system.iris.radius as $float,
                        blades,
                        image: matches!(system.iris.shape, Iris::Image(_)).then(|| system.iris.shape.clone()),
                        diffractive: system.has_diffractive(),
                        object_axis: system.object_axis.as_ref().map(|a| (rows(&a.0.matrix3), a.0.translation.to_array().map(|v| v as $float))),
                        graded: system.has_gradients().then(|| Arc::new(system.clone())),
                    }
                }

                /// Index of every gap at each lane's wavelength (nm), into `out`.
                pub fn indices(&self, nm: &Lanes, out: &mut Indices) {
                    dispatch!(level(), simd => indices(simd, self, nm, out));
                    let [short, long] = VISIBLE_NM.map(|nm| nm as $float);
                    if nm.iter().fold(true, |within, nm| within & (*nm >= short) & (*nm <= long)) {
                        return;
                    }
                    for (lane, nm) in nm.iter().enumerate().filter(|(_, nm)| !(short..=long).contains(*nm)) {
                        for (gap, glass) in self.media.iter().enumerate() {
                            let index = glass.index(*nm as f64);
                            (out.n[gap][lane], out.inverse[gap][lane]) = (index as $float, (1.0 / index) as $float);
                        }
                    }
                }

                /// Follows a packet through all surfaces; the mask has a bit for each ray that came through.
                pub fn trace(&self, packet: &mut Packet, n: &Indices, way: Way) -> u32 {
                    self.trace_part(packet, n, way, 0..self.steps.len())
                }

                /// [`Batch::trace`] through some neighbouring surfaces only; `n` stays that of all gaps, and paths begin anew.
                pub fn trace_part(&self, packet: &mut Packet, n: &Indices, way: Way, surfaces: Range<usize>) -> u32 {
                    dispatch!(level(), simd => trace::<_, false>(simd, self, packet, n, &[0.0; LANES], way, surfaces))
                }

                /// The same, and what glass, surfaces and an aperture picture leave of the light: [`Packet::fraction`].
                pub fn trace_light(&self, packet: &mut Packet, n: &Indices, nm: &Lanes, way: Way) -> u32 {
                    dispatch!(level(), simd => trace::<_, true>(simd, self, packet, n, nm, way, 0..self.steps.len()))
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
                    masks.push(trace::<S, false>(simd, batch, p, n, &[0.0; LANES], way, 0..batch.steps.len()));
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
                let rows = batch.glasses.len() + usize::from(batch.diffractive);
                out.n.resize(rows, [1.0; LANES]);
                out.inverse.resize(rows, [1.0; LANES]);
                if batch.diffractive {
                    (nm * $vector::splat(simd, 1e-6)).store_slice(&mut out.n[rows - 1]);
                }
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

            /// The same of a Q-type asphere: [`crate::forbes::Forbes::sag`].
            #[inline(always)]
            fn forbes_sag<S: Simd>(
                simd: S,
                c: $vector<S>,
                k1: $vector<S>,
                q: &QSeries,
                r2: $vector<S>,
            ) -> ($vector<S>, $vector<S>, $mask<S>) {
                let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
                let root2 = one - k1 * c * c * r2;
                let real = root2.simd_gt(zero);
                let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                let scale = $vector::splat(simd, q.scale);
                let x = r2 * scale;
                let (mut t, mut before) = ($vector::splat(simd, q.first), zero);
                let (mut dt, mut d_before) = (zero, zero);
                let (mut sum, mut by_x) = (zero, zero);
                for [w, a, b, g] in &q.terms {
                    let (w, b, g) = ($vector::splat(simd, *w), $vector::splat(simd, *b), $vector::splat(simd, *g));
                    sum = sum + w * t;
                    by_x = by_x + w * dt;
                    let factor = $vector::splat(simd, *a) + b * x;
                    let (next, d_next) = (factor * t - g * before, b * t + factor * dt - g * d_before);
                    (t, before, dt, d_before) = (next, t, d_next, dt);
                }
                let twice = scale + scale;
                let (z, over_r) = match q.kind {
                    ForbesKind::Conic => (x * x * sum, twice * ((x + x) * sum + x * x * by_x)),
                    ForbesKind::BestFitSphere => {
                        let bump = x * (one - x);
                        let slope = (one - x - x) * sum + bump * by_x;
                        let (k, c2) = (k1 - one, c * c);
                        let across2 = (one - k * c2 * r2).max($vector::splat(simd, 1e-12));
                        let steep = across2.sqrt() / root;
                        let steepens = c2 * (k1 / (root * root) - k / across2);
                        (bump * sum * steep, steep * (twice * slope + bump * sum * steepens))
                    }
                };
                (c * r2 / (one + root) + z, c / root + over_r, real)
            }

            /// Value and slopes in x and y of a polynomial over the plane: `Polynomial::at`.
            #[inline(always)]
            fn plane_series<S: Simd>(
                simd: S,
                p: &PlaneSeries,
                x: $vector<S>,
                y: $vector<S>,
            ) -> ($vector<S>, $vector<S>, $vector<S>) {
                let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
                let scale = $vector::splat(simd, p.scale);
                let (u, v) = (x * scale, y * scale);
                let rho = u * u + v * v;
                let (mut sum, mut by_rho) = (zero, zero);
                for a in p.radial.iter().rev() {
                    let inner = sum + $vector::splat(simd, *a);
                    by_rho = by_rho * rho + inner;
                    sum = inner * rho;
                }
                let (mut by_u, mut by_v) = ((u + u) * by_rho, (v + v) * by_rho);
                let (mut rows, mut rows_u, mut rows_v) = (zero, zero, zero);
                for row in p.rows.iter().rev() {
                    let (mut value, mut slope) = (zero, zero);
                    for b in row.iter().rev() {
                        slope = slope * u + value;
                        value = value * u + $vector::splat(simd, *b);
                    }
                    rows_v = rows_v * v + rows;
                    rows = rows * v + value;
                    rows_u = rows_u * v + slope;
                }
                sum = sum + rows;
                by_u = by_u + rows_u;
                by_v = by_v + rows_v;
                let (mut power_re, mut power_im, mut before_re, mut before_im, mut m) = (one, zero, zero, zero, 0);
                for (frequency, terms) in &p.rings {
                    while m < *frequency {
                        (before_re, before_im) = (power_re, power_im);
                        (power_re, power_im) = (u * before_re - v * before_im, u * before_im + v * before_re);
                        m += 1;
                    }
                    let (mut q, mut before, mut dq, mut d_before) = (one, zero, zero, zero);
                    let (mut c, mut s, mut dc, mut ds) = (zero, zero, zero, zero);
                    for [wc, ws, a, b, g] in terms {
                        let (wc, ws) = ($vector::splat(simd, *wc), $vector::splat(simd, *ws));
                        c = c + wc * q;
                        s = s + ws * q;
                        dc = dc + wc * dq;
                        ds = ds + ws * dq;
                        let (b, g) = ($vector::splat(simd, *b), $vector::splat(simd, *g));
                        let factor = $vector::splat(simd, *a) + b * rho;
                        let (next, d_next) = (factor * q - g * before, b * q + factor * dq - g * d_before);
                        (q, before, dq, d_before) = (next, q, d_next, dq);
                    }
                    let along = dc * power_re + ds * power_im;
                    let along = along + along;
                    let turn = $vector::splat(simd, m as $float);
                    sum = sum + c * power_re + s * power_im;
                    by_u = by_u + along * u + turn * (c * before_re + s * before_im);
                    by_v = by_v + along * v + turn * (s * before_re - c * before_im);
                }
                (sum, by_u * scale, by_v * scale)
            }

            #[inline(always)]
            fn trace<S: Simd, const LIGHT: bool>(
                simd: S,
                batch: &Batch,
                packet: &mut Packet,
                n: &Indices,
                nm: &Lanes,
                way: Way,
                surfaces: Range<usize>,
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
                let mut fraction = one;
                let mut depth = zero;
                let mut alive = one.simd_gt(zero);
                // Positions are kept relative to the vertex of the surface last met: f32 has its digits where they count.
                let mut z_origin: $float = 0.0;
                if let (Way::ToFilm, 0, Some((m, t))) = (way, surfaces.start, &batch.object_axis) {
                    (ox, oy, oz) = rotate(simd, m, ox, oy, oz);
                    (ox, oy, oz) = (ox + $vector::splat(simd, t[0]), oy + $vector::splat(simd, t[1]), oz + $vector::splat(simd, t[2]));
                    (dx, dy, dz) = rotate(simd, m, dx, dy, dz);
                }
                let count = batch.steps.len();
                for number in 0..surfaces.len() {
                    let (i, before, after) = match way {
                        Way::ToFilm => (surfaces.start + number, surfaces.start + number, surfaces.start + number + 1),
                        Way::ToObject => (surfaces.end - 1 - number, surfaces.end - number, surfaces.end - 1 - number),
                    };
                    let step = &batch.steps[i];
                    let run = match way {
                        Way::ToFilm => batch.runs[before],
                        Way::ToObject => -batch.runs[before],
                    };
                    if step.refracting {
                        let s = Refracting { c: step.c, run, ahead: step.z - z_origin, outer2: step.open2 };
                        let (n0, n1) = ($vector::from_slice(simd, &n.n[before]), $vector::from_slice(simd, &n.n[after]));
                        let inverse1 = $vector::from_slice(simd, &n.inverse[after]);
                        let a = Rays { position: [ox.0, oy.0, oz.0], direction: [dx.0, dy.0, dz.0], path: path.0, alive: alive.0 };
                        let b = Rays { position: [ox.1, oy.1, oz.1], direction: [dx.1, dy.1, dz.1], path: path.1, alive: alive.1 };
                        let (a, cos_a) = $refract(simd, s, [n0.0, n1.0, inverse1.0], a);
                        let (b, cos_b) = $refract(simd, s, [n0.1, n1.1, inverse1.1], b);
                        if LIGHT {
                            let [cos0, cos1] = [0, 1].map(|k| $vector(cos_a[k], cos_b[k]));
                            fraction = fraction * passed(simd, &step.coating, n0, n1, cos0, cos1, nm, way);
                            let table = &batch.absorption[before];
                            if !table.is_empty() {
                                let t = ($vector(a.path, b.path) - path) * $vector::from_slice(simd, &n.inverse[before]);
                                depth = depth + $vector::from_slice(simd, &absorbed(table, nm)) * t.abs();
                            }
                        }
                        let join = |k: usize| $vector(a.position[k], b.position[k]);
                        (ox, oy, oz) = (join(0), join(1), join(2));
                        let join = |k: usize| $vector(a.direction[k], b.direction[k]);
                        (dx, dy, dz) = (join(0), join(1), join(2));
                        path = $vector(a.path, b.path);
                        alive = $mask(a.alive, b.alive);
                        z_origin = step.z;
                        continue;
                    }
                    let sense = $vector::splat(simd, run);
                    if let Some(system) = batch.graded.as_ref().filter(|s| s.gradients[before].is_some()) {
                        let (mut x, mut y, mut z) = (ox.to_array(), oy.to_array(), oz.to_array());
                        let (mut u, mut v, mut w) = (dx.to_array(), dy.to_array(), dz.to_array());
                        let (mut added, mut there) = ([0.0; LANES], [0.0; LANES]);
                        let (lanes, origin) = (alive.to_bitmask(), z_origin as f64);
                        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
                            let position = DVec3::new(x[lane] as f64, y[lane] as f64, z[lane] as f64 + origin);
                            let direction = DVec3::new(u[lane] as f64, v[lane] as f64, w[lane] as f64).normalize();
                            let index = n.n[before][lane] as f64;
                            let ray = TracedRay { position, direction };
                            let Some((end, path)) = system.cross_gradient(before, index, i, ray, run as f64) else { continue };
                            let (p, d) = (end.position, end.direction);
                            (x[lane], y[lane], z[lane]) = (p.x as $float, p.y as $float, (p.z - origin) as $float);
                            (u[lane], v[lane], w[lane]) = (d.x as $float, d.y as $float, d.z as $float);
                            (added[lane], there[lane]) = (path as $float, 1.0);
                        }
                        let lanes = |v: &Lanes| $vector::from_slice(simd, v);
                        (ox, oy, oz) = (lanes(&x), lanes(&y), lanes(&z));
                        (dx, dy, dz) = (lanes(&u), lanes(&v), lanes(&w));
                        alive = alive & lanes(&there).simd_gt(zero);
                        path = path + lanes(&added);
                        if LIGHT && !batch.absorption[before].is_empty() {
                            depth = depth + lanes(&absorbed(&batch.absorption[before], nm)) * lanes(&added)
                                / $vector::from_slice(simd, &n.n[before]);
                        }
                    }
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
                        Shape::Asphere(_) | Shape::Forbes(_) => {
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
                                let r2 = x * x + y * y;
                                let (height, over_r, real) = match &step.shape {
                                    Shape::Asphere(a) => sag::<S>(simd, c, k1, a, r2),
                                    Shape::Forbes(q) => forbes_sag::<S>(simd, c, k1, q, r2),
                                    _ => (zero, zero, real),
                                };
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
                        Shape::Freeform(a, series) => {
                            let k = $vector::splat(simd, step.k);
                            let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                            let c1 = $vector::splat(simd, step.c_start);
                            let (t1, real1) = conic(simd, c1, zero, px, py, pz, dx, dy, dz, sense);
                            let mut s = real.select(t0, real1.select(t1, -pz / dz));
                            let k1 = one + k;
                            let mut residual = one;
                            let (mut gx, mut gy) = (zero, zero);
                            let mut on = real;
                            let mut pass = 0;
                            while pass <= NEWTON_STEPS {
                                let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                                let (height, over_r, real) = sag::<S>(simd, c, k1, a, x * x + y * y);
                                let (more, by_x, by_y) = plane_series::<S>(simd, series, x, y);
                                gx = x * over_r + by_x;
                                gy = y * over_r + by_y;
                                residual = z - height - more;
                                on = real;
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
                        Shape::Fresnel(a) => {
                            t = -pz / dz;
                            (hx, hy, hz) = (px + dx * t, py + dy * t, zero);
                            let k1 = one + $vector::splat(simd, step.k);
                            let (_, over_r, real) = sag::<S>(simd, c, k1, a, hx * hx + hy * hy);
                            let (gx, gy) = (hx * over_r, hy * over_r);
                            let length = (gx * gx + gy * gy + one).sqrt();
                            (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                            hit = real & t.simd_eq(t);
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
                    // Apertures that are no disks are asked lane by lane, by the same code as in the plain trace.
                    if !step.apertures.is_empty() && alive.to_bitmask() != 0 {
                        let (x, y) = (hx.to_array(), hy.to_array());
                        let mut passes = [0.0; LANES];
                        for lane in 0..LANES {
                            let (x, y) = (x[lane] as f64, y[lane] as f64);
                            passes[lane] = if step.apertures.iter().all(|a| a.lets_through(x, y)) { 1.0 } else { 0.0 };
                        }
                        alive = alive & $vector::from_slice(simd, &passes).simd_gt(zero);
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
                            fraction = fraction * passes;
                        }
                    }
                    let mut n0 = $vector::from_slice(simd, &n.n[before]);
                    let mut n1 = $vector::from_slice(simd, &n.n[after]);
                    let mut inverse1 = $vector::from_slice(simd, &n.inverse[after]);
                    let is_graded = |s: &&Arc<System>| s.gradients[before].is_some() || s.gradients[after].is_some();
                    if let Some(system) = batch.graded.as_ref().filter(is_graded) {
                        let (x, y, z) = (hx.to_array(), hy.to_array(), hz.to_array());
                        let mut indices = [[0.0; LANES]; 2];
                        for lane in 0..LANES {
                            let place = DVec3::new(x[lane] as f64, y[lane] as f64, z[lane] as f64);
                            let point = system.surfaces[i].to_lens(place, DVec3::Z).0;
                            for (side, gap) in [before, after].into_iter().enumerate() {
                                indices[side][lane] = system.index_at(gap, n.n[gap][lane] as f64, point) as $float;
                            }
                        }
                        n0 = $vector::from_slice(simd, &indices[0]);
                        n1 = $vector::from_slice(simd, &indices[1]);
                        inverse1 = one / n1;
                    }
                    path = path + n0 * t;
                    let facing = dx * nx + dy * ny + dz * nz;
                    if let Some(focal) = step.ideal_focal_length {
                        // As `ideal::bend`, with the way of the light in `sense`.
                        let f = $vector::splat(simd, focal);
                        let (sx, sy) = (dx / dz, dy / dz);
                        let (ax, ay) = (sx - hx * sense / f, sy - hy * sense / f);
                        alive = alive & (dz * sense).simd_gt(zero);
                        let length = (ax * ax + ay * ay + one).sqrt();
                        let (bx, by, bz) = (sense * ax / length, sense * ay / length, sense / length);
                        // Slopes and direction on the object's side, as light runs there.
                        let (ux, uy, gx, gy) = match way {
                            Way::ToFilm => (sx * sense, sy * sense, dx, dy),
                            Way::ToObject => (-(ax * sense), -(ay * sense), -bx, -by),
                        };
                        let (qx, qy) = (f * ux, f * uy);
                        let whole = (qx * qx + qy * qy + f * f).sqrt();
                        let (wx, wy) = (qx - hx, qy - hy);
                        let sign = $vector::splat(simd, focal.signum());
                        path = path + sign * (whole - (wx * wx + wy * wy + f * f).sqrt()) - (gx * hx + gy * hy);
                        (dx, dy, dz) = (bx, by, bz);
                    } else if let Some(phase) = &step.phase {
                        // As `Diffractive::bend`.
                        let wavelength = $vector::from_slice(simd, &n.n[count + 1]);
                        let factor = $vector::splat(simd, phase.order) * wavelength;
                        let (value, by_x, by_y) = plane_series::<S>(simd, &phase.series, hx, hy);
                        let (qx, qy, qz) = (n0 * dx + factor * by_x, n0 * dy + factor * by_y, n0 * dz);
                        let out = if step.mirror { n0 } else { n1 };
                        let across = qx * nx + qy * ny + qz * nz;
                        let (qx, qy, qz) = (qx - nx * across, qy - ny * across, qz - nz * across);
                        let rest = out * out - (qx * qx + qy * qy + qz * qz);
                        alive = alive & rest.simd_gt(zero);
                        let onwards = facing.simd_ge(zero).select(one, -one);
                        let onwards = if step.mirror { -onwards } else { onwards };
                        let along = onwards * rest.max(zero).sqrt();
                        let inverse = one / out;
                        (dx, dy, dz) = ((qx + nx * along) * inverse, (qy + ny * along) * inverse, (qz + nz * along) * inverse);
                        path = path + factor * value;
                        if LIGHT {
                            let (cos0, cos1) = (facing.abs(), along.abs() * inverse);
                            if !step.mirror {
                                fraction = fraction * passed(simd, &step.coating, n0, n1, cos0, cos1, nm, way);
                            }
                            if let Some((diffractive, at_blaze)) = &phase.blazed {
                                let (before, after) = (n0.to_array(), n1.to_array());
                                let mut efficiency = [0.0; LANES];
                                for lane in 0..LANES {
                                    let [n0, n1] = match way {
                                        Way::ToFilm => [before[lane] as f64, after[lane] as f64],
                                        Way::ToObject => [after[lane] as f64, before[lane] as f64],
                                    };
                                    let height = if step.mirror { 2.0 * n0 } else { n1 - n0 };
                                    let nm = nm[lane] as f64;
                                    efficiency[lane] = diffractive.efficiency(diffractive.order(), nm, [height, *at_blaze]) as $float;
                                }
                                fraction = fraction * $vector::from_slice(simd, &efficiency);
                            }
                        }
                    } else if step.mirror {
                        let along = two * facing;
                        (dx, dy, dz) = (dx - nx * along, dy - ny * along, dz - nz * along);
                    } else {
                        let mu = n0 * inverse1;
                        let cos2 = one - mu * mu * (one - facing * facing);
                        alive = alive & cos2.simd_ge(zero);
                        let cos1 = cos2.max(zero).sqrt();
                        let along = sense * cos1 - mu * facing;
                        (dx, dy, dz) = (dx * mu + nx * along, dy * mu + ny * along, dz * mu + nz * along);
                        if LIGHT {
                            fraction = fraction * passed(simd, &step.coating, n0, n1, facing.abs(), cos1, nm, way);
                        }
                    }
                    if LIGHT {
                        if step.mirror {
                            let mut reflected = [0.0; LANES];
                            let cosines = facing.to_array();
                            for lane in 0..LANES {
                                reflected[lane] = match &step.coating {
                                    Coated::Table(table) => {
                                        LightTable::at(table.values(), nm[lane] as f32, cosines[lane].abs() as f32) as $float
                                    }
                                    _ => crate::coating::film::aluminium(nm[lane] as f64) as $float,
                                };
                            }
                            fraction = fraction * $vector::from_slice(simd, &reflected);
                        }
                        let table = &batch.absorption[before];
                        if !table.is_empty() {
                            depth = depth + $vector::from_slice(simd, &absorbed(table, nm)) * t.abs();
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
                oz = oz + $vector::splat(simd, z_origin);
                if let (Way::ToObject, 0, Some((m, t))) = (way, surfaces.start, &batch.object_axis) {
                    (ox, oy, oz) = (ox - $vector::splat(simd, t[0]), oy - $vector::splat(simd, t[1]), oz - $vector::splat(simd, t[2]));
                    (ox, oy, oz) = rotate_back(simd, m, ox, oy, oz);
                    (dx, dy, dz) = rotate_back(simd, m, dx, dy, dz);
                }
                ox.store_slice(&mut packet.x);
                oy.store_slice(&mut packet.y);
                oz.store_slice(&mut packet.z);
                dx.store_slice(&mut packet.dx);
                dy.store_slice(&mut packet.dy);
                dz.store_slice(&mut packet.dz);
                path.store_slice(&mut packet.path);
                if LIGHT {
                    fraction.store_slice(&mut packet.fraction);
                    let depth = depth.to_array();
                    if batch.absorption.iter().any(|a| !a.is_empty()) {
                        for lane in 0..LANES {
                            packet.fraction[lane] *= (-depth[lane]).exp();
                        }
                    }
                }
                alive.to_bitmask() as u32
            }

            /// Fraction of the light that what is on a surface lets through.
            #[inline(always)]
            fn passed<S: Simd>(
                simd: S,
                coating: &Coated,
                n0: $vector<S>,
                n1: $vector<S>,
                cos0: $vector<S>,
                cos1: $vector<S>,
                nm: &Lanes,
                way: Way,
            ) -> $vector<S> {
                match coating {
                    Coated::Perfect => $vector::splat(simd, 1.0),
                    Coated::Flat(through) => $vector::splat(simd, *through as $float),
                    Coated::QuarterWave => quarter_wave(simd, n0, n1, cos0, cos1, $vector::from_slice(simd, nm)),
                    Coated::Bare => fresnel(simd, n0, n1, cos0, cos1),
                    Coated::Table(table) => {
                        let from_object = matches!(way, Way::ToFilm);
                        let cosines = if table.is_by_object_side() == from_object { cos0 } else { cos1 }.to_array();
                        let (values, mut through) = (table.values(), [0.0; LANES]);
                        for lane in 0..LANES {
                            through[lane] = LightTable::at(values, nm[lane] as f32, cosines[lane] as f32) as $float;
                        }
                        $vector::from_slice(simd, &through)
                    }
                }
            }

            /// Absorption (1/mm) at the wavelengths of the lanes, of a table at 380, 390, ... nm.
            #[inline(always)]
            fn absorbed(table: &[$float], nm: &Lanes) -> Lanes {
                nm.map(|nm| {
                    let at = ((nm - 380.0) * 0.1).clamp(0.0, 39.999);
                    let i = at as usize;
                    table[i] + (table[i + 1] - table[i]) * (at - i as $float)
                })
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

batch!(single, f32, 32, Single, SingleMask, refract_single, "32 rays at once in f32.");
batch!(double, f64, 16, Double, DoubleMask, refract_double, "16 rays at once in f64.");

/// Traces a packet of rays and each of them by the plain trace, which must agree: places and paths to `tolerance` mm, directions to a hundredth of it. Answers
/// with the rays that come through, by their number, where they end, and their optical path.
#[cfg(test)]
pub(crate) fn agreement(
    system: &crate::System,
    n: &[f64],
    ray: impl Fn(usize) -> crate::ray::TracedRay,
    tolerance: f64,
) -> Vec<(usize, crate::ray::TracedRay, f64)> {
    use double::{Batch, Indices, LANES, Packet};
    let mut packet = Packet::default();
    for i in 0..LANES {
        packet.set(i, ray(i).position.to_array(), ray(i).direction.to_array());
    }
    let mask = Batch::new(system).trace(&mut packet, &Indices::uniform(n), crate::ray::Way::ToFilm);
    let mut through = Vec::new();
    for i in 0..LANES {
        let mut path = 0.0;
        let (way, apertures) = (crate::ray::Way::ToFilm, crate::ray::Apertures::Clip);
        let plain = system.trace_with(ray(i), n, way, apertures, |e| path += e.path);
        assert_eq!(plain.is_ok(), mask >> i & 1 == 1, "{i}");
        let Ok(plain) = plain else { continue };
        assert!((glam::DVec3::new(packet.x[i], packet.y[i], packet.z[i]) - plain.position).length() < tolerance, "{i}");
        let direction = glam::DVec3::new(packet.dx[i], packet.dy[i], packet.dz[i]);
        assert!((direction - plain.direction).length() < 0.01 * tolerance, "{i}");
        assert!((packet.path[i] - path).abs() < tolerance, "{i}: {} {path}", packet.path[i]);
        through.push((i, plain, path));
    }
    through
}

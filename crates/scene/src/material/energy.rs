//! How much light a rough interface hands on when each ray meets it only once, tabulated.
//!
//! Single-scattering microfacet models lose what would bounce between facets. We divide that loss out (Turquin 2019) and
//! let what a layer does not reflect reach the layer below (Kulla & Conty 2017). Both need the directional albedo E(μ, r),
//! μ the cosine of the angle of incidence, r = √α. Tables are integrated once with visible-normal sampling.

use super::microfacet::{Ggx, cosine_of, fresnel_dielectric, reflect, refract};
use super::polarization::{InPlane, dielectric};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, OnceLock};

/// Nodes of each axis of a table.
const NODES: usize = 32;
/// Integration points a node and generator of their lattice (neighbouring Fibonacci numbers): where the integrand is
/// smooth, and where total reflection cuts it.
const SMOOTH_LATTICE: (usize, usize) = (377, 233);
const CUT_LATTICE: (usize, usize) = (1597, 987);
/// Roughness below which a table is not integrated but a mirror.
const FIRST_ROUGHNESS: f32 = 1e-2;

/// A function of (√μ, roughness) on a regular grid, bilinear.
#[derive(Clone, Debug)]
pub struct Table(Box<[f32; NODES * NODES]>);

impl Table {
    /// Of a function of a cosine and a roughness.
    pub(super) fn new(f: impl Fn(f32, f32) -> f32 + Sync) -> Self {
        let mut values = Box::new([0.0; NODES * NODES]);
        values.par_iter_mut().enumerate().for_each(|(n, value)| *value = f(Self::node(n)[0], Self::node(n)[1]));
        Table(values)
    }

    /// The same on this thread alone: where rays ask for it, and the pool must not be waited for.
    fn alone(f: impl Fn(f32, f32) -> f32) -> Self {
        Table(Box::new(std::array::from_fn(|n| f(Self::node(n)[0], Self::node(n)[1]))))
    }

    /// Cosine and roughness of a node.
    fn node(n: usize) -> [f32; 2] {
        let place = |i: usize| i as f32 / (NODES - 1) as f32;
        [place(n % NODES).powi(2).max(1e-4), place(n / NODES)]
    }

    /// Bilinear value at cos θ and √α, both within 0 to 1 (clamped).
    #[inline]
    pub fn at(&self, mu: f32, roughness: f32) -> f32 {
        let place = |x: f32| {
            let x = x.clamp(0.0, 1.0) * (NODES - 1) as f32;
            let i = (x as usize).min(NODES - 2);
            (i, x - i as f32)
        };
        let ((i, fx), (j, fy)) = (place(mu.max(0.0).sqrt()), place(roughness));
        let (t, n) = (&self.0, j * NODES + i);
        let (low, high) = (t[n] + (t[n + 1] - t[n]) * fx, t[n + NODES] + (t[n + NODES + 1] - t[n + NODES]) * fx);
        low + (high - low) * fy
    }

    /// ∫ 2μ E dμ at a roughness: the albedo under light from everywhere.
    fn average(&self) -> Vec<f32> {
        let n = 64;
        (0..NODES)
            .map(|j| {
                let r = j as f32 / (NODES - 1) as f32;
                (0..n)
                    .map(|i| {
                        let mu = (i as f32 + 0.5) / n as f32;
                        2.0 * mu * self.at(mu, r) / n as f32
                    })
                    .sum()
            })
            .collect()
    }
}

/// Mean of `weight(wo, h)` over visible normals h.
fn integrate(facets: Ggx, wo: Vec3, (n, generator): (usize, usize), weight: impl Fn(Vec3, Vec3) -> f32) -> f32 {
    let point = |k: usize| [(k as f32 + 0.5) / n as f32, ((k * generator % n) as f32 + 0.5) / n as f32];
    (0..n).map(|k| weight(wo, facets.sample_visible(wo, point(k)))).sum::<f32>() / n as f32
}

/// A direction of a cosine, in the plane of x.
fn towards(mu: f32) -> Vec3 {
    Vec3::new((1.0 - mu * mu).max(0.0).sqrt(), 0.0, mu)
}

/// Even facets of a roughness, none of them too narrow to be integrated.
fn even(roughness: f32) -> Ggx {
    Ggx::even(roughness.max(FIRST_ROUGHNESS).powi(2))
}

/// Fraction of what a facet mirrors that is not blocked by others.
fn reflected(facets: Ggx, wo: Vec3, h: Vec3) -> f32 {
    let wi = reflect(wo, h);
    if wi.z > 0.0 { facets.g2(wo, wi) / facets.g1(wo) } else { 0.0 }
}

/// The same of what it refracts.
fn transmitted(facets: Ggx, wo: Vec3, h: Vec3, eta: f32) -> f32 {
    match refract(wo, h, eta) {
        Some(wi) if wi.z < 0.0 => facets.g2(wo, Vec3::new(wi.x, wi.y, -wi.z)) / facets.g1(wo),
        _ => 0.0,
    }
}

/// Both, of a dielectric.
fn reflected_or_transmitted(facets: Ggx, wo: Vec3, h: Vec3, eta: f32) -> f32 {
    let f = fresnel_dielectric(wo.dot(h), eta);
    f * reflected(facets, wo, h) + (1.0 - f) * transmitted(facets, wo, h, eta)
}

/// The value of a cell, computed at first need and never while its lock is held: `compute` may use the thread pool, and a worker that waits
/// for the pool may run a job that asks for the same cell. Where two threads meet, both compute the same value and the first one stays.
pub(super) fn computed<T>(cell: &OnceLock<T>, compute: impl FnOnce() -> T) -> &T {
    match cell.get() {
        Some(value) => value,
        None => {
            let value = compute();
            cell.get_or_init(|| value)
        }
    }
}

/// Tables by the bits of an index of refraction: each computed once in the program. Like [`computed`], never computes under the lock.
struct Shared<T>(Mutex<Vec<(u32, Arc<T>)>>);

impl<T> Shared<T> {
    const fn new() -> Self {
        Shared(Mutex::new(Vec::new()))
    }

    fn of(&self, ior: f32, compute: impl FnOnce(f32) -> T) -> Arc<T> {
        let find = |known: &[(u32, Arc<T>)]| known.iter().find(|(bits, _)| *bits == ior.to_bits()).map(|(_, t)| t.clone());
        if let Some(tables) = find(&self.0.lock().unwrap_or_else(|e| e.into_inner())) {
            return tables;
        }
        let tables = Arc::new(compute(ior));
        let mut known = self.0.lock().unwrap_or_else(|e| e.into_inner());
        if let Some(earlier) = find(&known) {
            return earlier;
        }
        known.push((ior.to_bits(), tables.clone()));
        tables
    }
}

/// E(μ, r) of a perfectly reflecting rough surface: fraction reflected at once, 0 to 1.
pub fn mirror_albedo() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    computed(&TABLE, || {
        Table::new(|mu, r| {
            let facets = even(r);
            integrate(facets, towards(mu), SMOOTH_LATTICE, |wo, h| reflected(facets, wo, h))
        })
    })
}

/// Fraction that a perfect mirror of facets reflects at once of light from a unit direction (local, z > 0).
#[inline]
pub fn mirror_albedo_at(facets: Ggx, w: Vec3) -> f32 {
    match (facets.is_smooth(), facets.x == facets.y) {
        (true, _) => 1.0,
        (_, true) => mirror_albedo().at(w.z, facets.roughness()),
        _ => anisotropic_mirror().at(facets, w),
    }
}

/// What facets that are wider one way than the other do with light at once: by √μ, azimuth from x (a quarter turn) and √α along x and y.
#[derive(Debug)]
struct AnisotropicTable(Vec<f32>);

/// Nodes of its axes.
const ANISOTROPIC: [usize; 4] = [10, 5, 10, 10];

/// Of perfect mirrors.
fn anisotropic_mirror() -> &'static AnisotropicTable {
    static TABLE: OnceLock<AnisotropicTable> = OnceLock::new();
    computed(&TABLE, || AnisotropicTable::new(SMOOTH_LATTICE, reflected))
}

/// Computes the tables behind [`mirror_albedo_at`], so that no ray has to.
pub(super) fn prepare_mirrors(anisotropic: bool) {
    mirror_albedo();
    if anisotropic {
        anisotropic_mirror();
    }
}

impl AnisotropicTable {
    /// Mean of `weight(facets, wo, h)` over visible normals h.
    fn new(lattice: (usize, usize), weight: impl Fn(Ggx, Vec3, Vec3) -> f32 + Sync) -> Self {
        let node = |i: usize, axis: usize| i as f32 / (ANISOTROPIC[axis] - 1) as f32;
        let at = |n: usize| {
            let [a, b, c, _] = ANISOTROPIC;
            let mu = node(n % a, 0).powi(2).max(1e-4);
            let (sin, phi) = ((1.0 - mu * mu).sqrt(), node(n / a % b, 1) * std::f32::consts::FRAC_PI_2);
            let width = |i: usize, axis: usize| node(i, axis).max(FIRST_ROUGHNESS).powi(2);
            let facets = Ggx::new(width(n / (a * b) % c, 2), width(n / (a * b * c), 3));
            let wo = Vec3::new(sin * phi.cos(), sin * phi.sin(), mu);
            integrate(facets, wo, lattice, |wo, h| weight(facets, wo, h))
        };
        AnisotropicTable((0..ANISOTROPIC.iter().product()).into_par_iter().map(at).collect())
    }

    /// Linear along each axis.
    fn at(&self, facets: Ggx, w: Vec3) -> f32 {
        let phi = w.y.abs().atan2(w.x.abs()) / std::f32::consts::FRAC_PI_2;
        let places = [w.z.clamp(0.0, 1.0).sqrt(), phi, facets.x.sqrt(), facets.y.sqrt()];
        let (mut index, mut fraction, mut step, mut steps) = (0, [0.0f32; 4], 1, [0; 4]);
        for axis in 0..4 {
            let x = places[axis].clamp(0.0, 1.0) * (ANISOTROPIC[axis] - 1) as f32;
            let i = (x as usize).min(ANISOTROPIC[axis] - 2);
            fraction[axis] = x - i as f32;
            index += i * step;
            steps[axis] = step;
            step *= ANISOTROPIC[axis];
        }
        let mut sum = 0.0;
        for corner in 0..16usize {
            let (mut at, mut weight) = (index, 1.0);
            for axis in 0..4 {
                let beyond = corner >> axis & 1 == 1;
                at += if beyond { steps[axis] } else { 0 };
                weight *= if beyond { fraction[axis] } else { 1.0 - fraction[axis] };
            }
            sum += self.0[at] * weight;
        }
        sum
    }
}

/// What a rough interface of relative index `eta` does with light.
#[derive(Debug)]
pub struct Interface {
    eta: f32,
    /// Reflected fraction, seen from outside, of even facets.
    reflected: Table,
    /// Mean of `reflected` under light from everywhere, by roughness.
    average: Vec<f32>,
    /// Reflected and transmitted fraction, from outside and from inside; only bodies of rough glass ask for them.
    directional_albedo: [OnceLock<Table>; 2],
    /// Both of facets that are wider one way than the other.
    albedo_anisotropic: [OnceLock<AnisotropicTable>; 2],
    reflected_anisotropic: OnceLock<AnisotropicTable>,
    /// How much more of s than of p is reflected; only polarised light asks for it.
    s_over_p: OnceLock<Table>,
}

/// How polarised light is that came through a rough interface: as if it had come through a smooth one at a cosine, but for a fraction of the difference of s and p.
#[derive(Clone, Copy, Debug)]
pub struct PolarizedAs {
    /// The cosine.
    pub cos: f32,
    /// The fraction, 0 to 1.
    pub fraction: f32,
}

/// Side of an interface that light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The thinner medium.
    Outside,
    /// The denser one, where light can be totally reflected.
    Inside,
}

impl Interface {
    fn new(eta: f32) -> Self {
        let reflected = Table::new(|mu, r| {
            if r < FIRST_ROUGHNESS {
                return fresnel_dielectric(mu, eta);
            }
            let facets = even(r);
            let fraction = |wo: Vec3, h: Vec3| fresnel_dielectric(wo.dot(h), eta) * reflected(facets, wo, h);
            integrate(facets, towards(mu), SMOOTH_LATTICE, fraction)
        });
        let average = reflected.average();
        Interface {
            eta,
            average,
            reflected,
            directional_albedo: Default::default(),
            albedo_anisotropic: Default::default(),
            reflected_anisotropic: OnceLock::new(),
            s_over_p: OnceLock::new(),
        }
    }

    /// Half the difference of what facets reflect of s and of p, the plane of incidence being that of the mean surface: under unpolarised light from everywhere, the Q of
    /// what leaves in a direction. Of facets that are wider one way than the other it is that of even ones as wide on the whole.
    fn s_over_p(&self, facets: Ggx, w: Vec3) -> f32 {
        let table = computed(&self.s_over_p, || {
            Table::alone(|mu, r| {
                let difference = |cos: f32| {
                    let reflection = dielectric(cos, self.eta)[0];
                    0.5 * (reflection.s.x - reflection.p.x)
                };
                if r < FIRST_ROUGHNESS {
                    return difference(mu);
                }
                let facets = even(r);
                integrate(facets, towards(mu), SMOOTH_LATTICE, |wo, h| {
                    // s of the mean surface is y; Q turns by twice the angle to that of the facet.
                    let s = h.cross(wo).normalize_or_zero();
                    (2.0 * s.y * s.y - 1.0) * difference(wo.dot(h)) * reflected(facets, wo, h)
                })
            })
        });
        table.at(w.z, (facets.x * facets.y).sqrt().sqrt())
    }

    /// How polarised what comes through is, or goes in: in even unpolarised light as much as what is reflected there, the other way, so that a body that absorbs nothing
    /// cannot be told from what is around it.
    pub fn polarized_as(&self, facets: Ggx, w: Vec3) -> PolarizedAs {
        if facets.is_smooth() {
            return PolarizedAs { cos: w.z, fraction: 1.0 };
        }
        let reflected = self.reflected(facets, w);
        let cos = cosine_of(reflected / mirror_albedo_at(facets, w), self.eta);
        let [_, smooth] = dielectric(cos, self.eta);
        let own = 0.5 * (smooth.p.x - smooth.s.x) / smooth.mean().x.max(1e-6);
        let wanted = self.s_over_p(facets, w) / (1.0 - reflected).max(1e-6);
        PolarizedAs { cos, fraction: if own > 1e-6 { (wanted / own).clamp(0.0, 1.0) } else { 1.0 } }
    }

    /// What comes through of s and of p, over their mean.
    pub(super) fn through(&self, facets: Ggx, w: Vec3) -> InPlane {
        let PolarizedAs { cos, fraction } = self.polarized_as(facets, w);
        dielectric(cos, self.eta)[1].normalized().fraction_of_difference(fraction)
    }

    /// Reflected fraction of light from a unit direction outside (local, z > 0).
    #[inline]
    pub fn reflected(&self, facets: Ggx, w: Vec3) -> f32 {
        if facets.x == facets.y {
            return self.reflected.at(w.z, facets.roughness());
        }
        self.reflected_anisotropic().at(facets, w)
    }

    fn reflected_anisotropic(&self) -> &AnisotropicTable {
        computed(&self.reflected_anisotropic, || {
            AnisotropicTable::new(SMOOTH_LATTICE, |facets, wo, h| {
                fresnel_dielectric(wo.dot(h), self.eta) * reflected(facets, wo, h)
            })
        })
    }

    /// Computes the tables that rays will ask for, so that no ray has to: of anisotropic facets, of bodies of rough glass.
    pub(super) fn prepare(&self, anisotropic: bool, rough_body: bool) {
        if anisotropic {
            self.reflected_anisotropic();
        }
        for side in [Side::Outside, Side::Inside].into_iter().filter(|_| rough_body) {
            self.even(side);
            if anisotropic {
                self.anisotropic_mirror(side);
            }
        }
    }

    fn seen_from(&self, side: Side) -> f32 {
        if side == Side::Outside { self.eta } else { 1.0 / self.eta }
    }

    /// Fraction of light from a unit direction (local, z > 0 on the side it comes from) that is reflected or transmitted after one encounter, the rest being lost between
    /// facets.
    #[inline]
    pub fn directional_albedo(&self, side: Side, facets: Ggx, w: Vec3) -> f32 {
        if facets.x == facets.y {
            self.even(side).at(w.z, facets.roughness())
        } else {
            self.anisotropic_mirror(side).at(facets, w)
        }
    }

    fn even(&self, side: Side) -> &Table {
        computed(&self.directional_albedo[side as usize], || {
            let eta = self.seen_from(side);
            Table::new(move |mu, r| {
                let facets = even(r);
                integrate(facets, towards(mu), CUT_LATTICE, |wo, h| reflected_or_transmitted(facets, wo, h, eta))
            })
        })
    }

    fn anisotropic_mirror(&self, side: Side) -> &AnisotropicTable {
        computed(&self.albedo_anisotropic[side as usize], || {
            let eta = self.seen_from(side);
            AnisotropicTable::new(CUT_LATTICE, move |facets, wo, h| reflected_or_transmitted(facets, wo, h, eta))
        })
    }

    /// The tables of a relative index (n inside / n outside); computed once for each index in the program.
    pub fn of(eta: f32) -> Arc<Interface> {
        static KNOWN: Shared<Interface> = Shared::new();
        KNOWN.of(eta, Interface::new)
    }

    /// Mean reflected fraction under light from everywhere outside; `roughness` is √α, 0 to 1.
    #[inline]
    pub fn average_reflected(&self, roughness: f32) -> f32 {
        let x = roughness.clamp(0.0, 1.0) * (NODES - 1) as f32;
        let i = (x as usize).min(NODES - 2);
        self.average[i] + (self.average[i + 1] - self.average[i]) * (x - i as f32)
    }
}

/// How much of what a perfect rough mirror below a smooth coat of an index scatters leaves the coat at once.
#[derive(Debug)]
pub struct Escape {
    fraction: Table,
    /// Mean of it under light from everywhere outside, by roughness.
    average: Vec<f32>,
}

impl Escape {
    /// The tables of a coat of an index (above 1); computed once for each index in the program.
    pub fn of(ior: f32) -> Arc<Escape> {
        static KNOWN: Shared<Escape> = Shared::new();
        KNOWN.of(ior, Escape::new)
    }

    fn new(ior: f32) -> Self {
        let fraction = Table::new(|mu, r| {
            let facets = even(r);
            // Over the direction outside: within the coat the fraction falls steeply near the critical angle.
            let wo = towards((1.0 - (1.0 - mu * mu) / (ior * ior)).sqrt());
            let leaves = |wo: Vec3, h: Vec3| reflected(facets, wo, h) * (1.0 - fresnel_dielectric(reflect(wo, h).z, 1.0 / ior));
            integrate(facets, wo, CUT_LATTICE, leaves)
                / integrate(facets, wo, CUT_LATTICE, |wo, h| reflected(facets, wo, h)).max(1e-6)
        });
        Escape { average: fraction.average(), fraction }
    }

    /// The fraction of light that came from a direction (its cosine outside), and the fraction of what was held back once already: the same where the metal is
    /// smooth, that of light from everywhere where it is rough.
    pub fn at(&self, mu: f32, roughness: f32) -> [f32; 2] {
        let own = self.fraction.at(mu, roughness);
        let x = roughness.clamp(0.0, 1.0) * (NODES - 1) as f32;
        let i = (x as usize).min(NODES - 2);
        let all = self.average[i] + (self.average[i + 1] - self.average[i]) * (x - i as f32);
        [own, own + (all - own) * (4.0 * roughness * roughness).min(1.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_surfaces_lose_nothing_and_rough_ones_much() {
        assert!((mirror_albedo().at(0.7, 0.1) - 1.0).abs() < 0.01);
        // α = 1 at normal incidence: D = 1/π and G2 = 2 − 1/cos²h give E = 1 − ln 2 in closed form.
        let rough = mirror_albedo().at(1.0, 1.0);
        assert!((rough - (1.0 - 2f32.ln())).abs() < 4e-3, "{rough}");
        let glass = Interface::of(1.5);
        assert!((glass.directional_albedo(Side::Outside, Ggx::even(0.0025), Vec3::new(0.6, 0.0, 0.8)) - 1.0).abs() < 0.01);
        assert!((glass.reflected(Ggx::even(0.0), Vec3::Z) - 0.04).abs() < 1e-3);
        // Mean Fresnel reflectance of n = 1.5 under diffuse light: 0.0918 (Judd 1942).
        assert!((glass.average_reflected(0.0) - 0.0918).abs() < 2e-3, "{}", glass.average_reflected(0.0));
    }
}

//! Light through a lens wherever it goes.

use super::finish::Lobe;
use super::random::Random;
use crate::ghosts::{SurfaceLight, reflects};
use crate::ray::TracedRay;
use crate::system::System;
use glam::{DVec2, DVec3};

/// Shortest way between two events, mm: a ray does not meet the place that it leaves.
const STEP: f64 = 1e-7;
/// Most events of a walk; what goes on is counted as lost.
const MOST_EVENTS: usize = 400;
/// How often light that was thrown back once is made to turn again, at least: what turns twice reaches the film.
const TURN: f64 = 0.15;
/// How often light goes on from a wall; what goes on counts for what does not.
const FROM_WALL: f64 = 0.25;

/// Why glare of a lens cannot be traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unfit {
    /// Tilted, decentred or of other shape.
    #[error("the lens is not rotationally symmetric")]
    NotRound,
    /// Mirrors.
    #[error("the lens has mirrors")]
    Mirrors,
    /// Graded glass.
    #[error("the lens has glass of graded index")]
    Gradients,
    /// Ideal surfaces.
    #[error("the lens has ideal surfaces, which do not scatter")]
    Ideal,
}

/// How light came to the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Straight through.
    Image,
    /// By reflections alone.
    Ghost,
    /// Scattered by a surface, or by way of a wall.
    Scatter,
}

/// Where light ends, in the unit of what went in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balance {
    /// In the sensor.
    pub film: f64,
    /// In glass and films.
    pub glass: f64,
    /// In barrel, edges, blades, chamber and what is beside the film.
    pub walls: f64,
    /// Out of the front.
    pub front: f64,
    /// Walks that were given up.
    pub lost: f64,
}

impl Balance {
    /// All of it.
    pub fn sum(&self) -> f64 {
        self.film + self.glass + self.walls + self.front + self.lost
    }

    pub(super) fn add(&mut self, other: &Balance) {
        self.film += other.film;
        self.glass += other.glass;
        self.walls += other.walls;
        self.front += other.front;
        self.lost += other.lost;
    }
}

/// A tube between two rims: radius `r` at `z`, growing by `slope`.
#[derive(Clone, Copy, Debug)]
struct Wall {
    z: [f64; 2],
    r: f64,
    slope: f64,
}

impl Wall {
    fn between([za, ra]: [f64; 2], [zb, rb]: [f64; 2]) -> Option<Wall> {
        // Rims that touch or cross need no tube.
        (zb > za + 1e-9).then(|| Wall { z: [za, zb], r: ra, slope: (rb - ra) / (zb - za) })
    }

    /// Way to it, and the normal inwards.
    fn intersect(&self, o: DVec3, d: DVec3) -> Option<(f64, DVec3)> {
        let k = self.slope;
        let r0 = self.r + k * (o.z - self.z[0]);
        let a = d.x * d.x + d.y * d.y - (k * d.z).powi(2);
        let b = o.x * d.x + o.y * d.y - k * r0 * d.z;
        let c = o.x * o.x + o.y * o.y - r0 * r0;
        let root = b * b - a * c;
        if root < 0.0 {
            return None;
        }
        let root = root.sqrt();
        let roots = if a.abs() < 1e-14 { [-0.5 * c / b; 2] } else { [(-b - root) / a, (-b + root) / a] };
        let fits = |t: &f64| {
            let z = o.z + t * d.z;
            *t > STEP && z >= self.z[0] && z <= self.z[1] && self.r + k * (z - self.z[0]) >= 0.0
        };
        let t = roots.into_iter().filter(fits).min_by(f64::total_cmp)?;
        let at = o + d * t;
        let side = at.truncate().normalize_or_zero();
        Some((t, DVec3::new(-side.x, -side.y, k).normalize()))
    }
}

/// Light on its way.
#[derive(Clone, Copy, Debug)]
struct Walk {
    o: DVec3,
    d: DVec3,
    gap: usize,
    weight: f64,
    /// 0: straight from the source, splits off what turns or scatters; 1: has turned once; 2: goes one way at each surface, by chance.
    level: u8,
    turned: bool,
    stray: bool,
}

/// What a walk meets.
enum Hit {
    Surface(usize, crate::surface::SurfaceHit, DVec3),
    Wall(DVec3),
    Film,
}

/// A lens at one wavelength, ready to follow light wherever it goes.
#[derive(Clone, Debug)]
pub struct GlareTracer<'a> {
    system: &'a System,
    nm: f64,
    n: Vec<f64>,
    absorption: Vec<f64>,
    light: Vec<SurfaceLight>,
    active: Vec<bool>,
    dust: Vec<f64>,
    walls: Vec<Option<Wall>>,
    /// Half the film; beyond it is wall.
    film: DVec2,
    sensor_reflectance: f64,
    /// Whether walks go on from every wall until next to nothing is left, and not by chance: no light is unaccounted for.
    exhaustive: bool,
}

impl<'a> GlareTracer<'a> {
    /// The same, accounting for all light.
    pub(super) fn exhaustive(&self) -> GlareTracer<'a> {
        GlareTracer { exhaustive: true, ..self.clone() }
    }

    /// For a wavelength in nm and a film of half width and half height `film`, mm; `sensor_reflectance`: 0 to 1,
    /// [`crate::ghosts::SENSOR_REFLECTANCE`] where nothing is known. Fails on lenses that do not look the same from all sides, and on mirrors, graded
    /// glass and ideal surfaces.
    pub fn new(system: &'a System, nm: f64, film: DVec2, sensor_reflectance: f64) -> Result<GlareTracer<'a>, Unfit> {
        if !system.is_rotational() {
            return Err(Unfit::NotRound);
        }
        if system.surfaces.iter().any(|s| s.mirror) {
            return Err(Unfit::Mirrors);
        }
        if system.has_gradients() {
            return Err(Unfit::Gradients);
        }
        if system.surfaces.iter().any(|s| s.ideal_focal_length.is_some()) {
            return Err(Unfit::Ideal);
        }
        let n = system.indices(nm);
        let count = system.surfaces.len();
        let is_air = |gap: usize| system.glasses[gap].kind == crate::glass::GlassKind::Air;
        let mut dust = vec![];
        let mut active = vec![];
        for (i, surface) in system.surfaces.iter().enumerate() {
            // Planes in the air are a stop or a hood; a surface that reflects nothing may still be rough.
            let matter = system.glasses[i] != system.glasses[i + 1] || reflects(system, i);
            active.push(matter);
            // Cement keeps dust out.
            dust.push(if matter && is_air(i) != is_air(i + 1) { (2.0 * surface.finish.dust_fraction()).min(1.0) } else { 0.0 });
        }
        let rim = |i: usize| {
            let s = &system.surfaces[i];
            let r = s.semi_diameter;
            [s.z + s.profile.sag(0.0, r * (1.0 - 1e-9)).unwrap_or(0.0), r]
        };
        let mut walls = vec![None];
        walls.extend((1..count).map(|gap| Wall::between(rim(gap - 1), rim(gap))));
        if let Some(last) = count.checked_sub(1) {
            let [z, r] = rim(last);
            walls.push(Wall::between([z, r], [system.film_z, r.max(1.1 * film.length())]));
        }
        let light = (0..count).map(|i| SurfaceLight::of(system, i, &n, nm)).collect();
        Ok(GlareTracer {
            absorption: system.absorption(nm),
            system,
            nm,
            n,
            light,
            active,
            dust,
            walls,
            film,
            sensor_reflectance,
            exhaustive: false,
        })
    }

    /// The lens.
    pub fn system(&self) -> &System {
        self.system
    }

    /// Follows a ray of power 1 from the object's side, and all that becomes of it. `record` is told of light on the film: how it came, where (mm), how
    /// much, and for [`Kind::Image`] how much it would be if no surface scattered.
    pub(super) fn follow_from_object(
        &self,
        ray: TracedRay,
        random: &mut Random,
        balance: &mut Balance,
        mut record: impl FnMut(Kind, DVec2, f64, f64),
    ) {
        let start = Walk { o: ray.position, d: ray.direction, gap: 0, weight: 1.0, level: 0, turned: false, stray: false };
        self.run(start, random, balance, &mut record, &mut |_, _, _| {});
    }

    /// Follows a ray of power 1 from the film; `leave` is told of light that comes out of the front: how, in which direction, how much.
    pub(super) fn follow_from_film(
        &self,
        ray: TracedRay,
        random: &mut Random,
        balance: &mut Balance,
        mut leave: impl FnMut(Kind, DVec3, f64),
    ) {
        let gap = self.system.surfaces.len();
        let start = Walk { o: ray.position, d: ray.direction, gap, weight: 1.0, level: 0, turned: false, stray: false };
        self.run(start, random, balance, &mut |_, _, _, _| {}, &mut leave);
    }

    fn next_hit(&self, walk: &Walk) -> Option<(f64, Hit)> {
        let (system, count) = (self.system, self.system.surfaces.len());
        let mut nearest: Option<(f64, Hit)> = None;
        let take = |t: f64, nearest: &Option<(f64, Hit)>| nearest.as_ref().is_none_or(|b| t < b.0);
        for i in [walk.gap.checked_sub(1), (walk.gap < count).then_some(walk.gap)].into_iter().flatten() {
            let surface = &system.surfaces[i];
            let (lo, ld) = surface.to_local(walk.o, walk.d);
            for sense in [1.0, -1.0] {
                let Some(m) = surface.profile.intersect(lo, ld, sense) else { continue };
                if m.t > STEP && take(m.t, &nearest) && surface.lets_through(m.point.x, m.point.y) {
                    nearest = Some((m.t, Hit::Surface(i, m, ld)));
                }
            }
        }
        if let Some((t, normal)) = self.walls[walk.gap].and_then(|w| w.intersect(walk.o, walk.d))
            && take(t, &nearest)
        {
            nearest = Some((t, Hit::Wall(normal)));
        }
        if walk.gap == count {
            let t = (system.film_z - walk.o.z) / walk.d.z;
            if t > STEP && take(t, &nearest) {
                nearest = Some((t, Hit::Film));
            }
        }
        nearest
    }

    fn run(
        &self,
        start: Walk,
        random: &mut Random,
        balance: &mut Balance,
        record: &mut dyn FnMut(Kind, DVec2, f64, f64),
        leave: &mut dyn FnMut(Kind, DVec3, f64),
    ) {
        let mut others = vec![start];
        while let Some(mut walk) = others.pop() {
            // What the light would be had no surface scattered any.
            let mut unscattered = walk.weight;
            let mut events = 0;
            loop {
                events += 1;
                if events > MOST_EVENTS {
                    balance.lost += walk.weight;
                    break;
                }
                let kind = match (walk.stray, walk.turned) {
                    (true, _) => Kind::Scatter,
                    (_, true) => Kind::Ghost,
                    _ => Kind::Image,
                };
                let Some((t, hit)) = self.next_hit(&walk) else {
                    if walk.gap == 0 {
                        balance.front += walk.weight;
                        leave(kind, walk.d, walk.weight);
                    } else {
                        // Between rims that cross there is no wall to meet: the mount takes it.
                        balance.walls += walk.weight;
                    }
                    break;
                };
                let absorption = self.absorption[walk.gap];
                if absorption > 0.0 {
                    let kept = (-absorption * t).exp();
                    balance.glass += walk.weight * (1.0 - kept);
                    walk.weight *= kept;
                    unscattered *= kept;
                }
                let at = walk.o + walk.d * t;
                match hit {
                    Hit::Wall(normal) => {
                        if !self.off_wall(&mut walk, at, normal, random, balance) {
                            break;
                        }
                    }
                    Hit::Film if at.x.abs() > self.film.x || at.y.abs() > self.film.y => {
                        if !self.off_wall(&mut walk, at, DVec3::NEG_Z, random, balance) {
                            break;
                        }
                    }
                    Hit::Film => {
                        record(kind, at.truncate(), walk.weight, unscattered);
                        let back = Walk { o: at, d: DVec3::new(walk.d.x, walk.d.y, -walk.d.z), turned: true, ..walk };
                        if walk.level == 0 {
                            balance.film += walk.weight * (1.0 - self.sensor_reflectance);
                            if self.sensor_reflectance > 0.0 {
                                others.push(Walk { level: 1, weight: walk.weight * self.sensor_reflectance, ..back });
                            }
                            break;
                        }
                        if random.draw() >= self.sensor_reflectance {
                            balance.film += walk.weight;
                            break;
                        }
                        walk = back;
                    }
                    Hit::Surface(i, m, ld) => {
                        if i == self.system.stop {
                            let passes = self.system.iris.transmittance(m.point.x, m.point.y);
                            if passes < 1.0 && random.draw() >= passes {
                                let normal = self.system.surfaces[i].to_lens(m.point, m.normal.normalize()).1;
                                let normal = if normal.dot(walk.d) > 0.0 { -normal } else { normal };
                                if !self.off_wall(&mut walk, at, normal, random, balance) {
                                    break;
                                }
                                continue;
                            }
                        }
                        unscattered *= self.at_surface(i, &m, ld, &mut walk, random, balance, &mut others);
                    }
                }
            }
        }
    }

    /// Light that a wall throws back, as a perfectly rough grey one does; `false` where it ends.
    fn off_wall(&self, walk: &mut Walk, at: DVec3, normal: DVec3, random: &mut Random, balance: &mut Balance) -> bool {
        let grey = self.system.wall_reflectance;
        balance.walls += walk.weight * (1.0 - grey);
        if grey <= 0.0 {
            return false;
        }
        walk.weight *= grey;
        if self.exhaustive {
            if walk.weight < 1e-9 {
                balance.walls += walk.weight;
                return false;
            }
        } else if random.draw() >= FROM_WALL {
            return false;
        } else {
            walk.weight /= FROM_WALL;
        }
        let (a, b) = normal.any_orthonormal_pair();
        let p = super::random::disk([random.draw(), random.draw()]);
        walk.d = (a * p.x + b * p.y + normal * (1.0 - p.length_squared()).max(0.0).sqrt()).normalize();
        walk.o = at + normal * (10.0 * STEP);
        (walk.level, walk.stray) = (2, true);
        true
    }

    /// Takes a walk over a surface; returns what of it would go on had nothing scattered.
    #[expect(clippy::too_many_arguments, reason = "the state of one random walk")]
    fn at_surface(
        &self,
        i: usize,
        m: &crate::surface::SurfaceHit,
        ld: DVec3,
        walk: &mut Walk,
        random: &mut Random,
        balance: &mut Balance,
        others: &mut Vec<Walk>,
    ) -> f64 {
        let surface = &self.system.surfaces[i];
        let towards_film = walk.gap == i;
        let after = if towards_film { i + 1 } else { i };
        walk.o = surface.to_lens(m.point, ld).0;
        if !self.active[i] {
            walk.gap = after;
            return 1.0;
        }
        let (n0, n1) = (self.n[walk.gap], self.n[after]);
        let unit = m.normal.normalize();
        let normal = if ld.dot(unit) < 0.0 { -unit } else { unit };
        let cos0 = ld.dot(normal);
        let mu = n0 / n1;
        let cos2 = 1.0 - mu * mu * (1.0 - cos0 * cos0);
        let cos1 = (cos2 > 0.0).then(|| cos2.sqrt());
        let mirrored = ld - normal * (2.0 * cos0);
        let (r, t) = self.light[i].fractions(towards_film, cos0, cos1);
        balance.glass += walk.weight * (1.0 - r - t);
        // What of the light that goes each way is scattered.
        let rough = |step: f64| surface.finish.rough_fraction(step, self.nm);
        let scattered = |rough: f64| (rough + self.dust[i]).min(1.0);
        let rough_back = rough(2.0 * n0 * cos0);
        let rough_through = cos1.map_or(0.0, |cos1| rough((n1 * cos1 - n0 * cos0).abs()));
        let (share_back, share_through) = (scattered(rough_back), scattered(rough_through));
        let lobe = |rough: f64, random: &mut Random| match random.draw() * (rough + self.dust[i]) < rough {
            true => Lobe::polish(self.nm),
            false => Lobe::dust(random.draw(), self.nm),
        };
        // The direction that a lobe makes of a straight one.
        let scatter = |straight: DVec3, index: f64, lobe: Lobe, random: &mut Random| {
            let (a, b) = normal.any_orthonormal_pair();
            let to = lobe.scatter(DVec2::new(straight.dot(a), straight.dot(b)), index, random);
            let along = (1.0 - to.length_squared()).max(0.0).sqrt() * straight.dot(normal).signum();
            a * to.x + b * to.y + normal * along
        };
        let turn = |local: DVec3| surface.to_lens(m.point, local).1;
        let back = |walk: &Walk, weight: f64, random: &mut Random| {
            let stray = random.draw() < share_back;
            let local = if stray { scatter(mirrored, n0, lobe(rough_back, random), random) } else { mirrored };
            Walk { d: turn(local), weight, level: walk.level + 1, turned: true, stray: walk.stray || stray, ..*walk }
        };
        let Some(cos1) = cos1 else {
            *walk = Walk { level: 2, ..back(walk, walk.weight * r, random) };
            return r;
        };
        let refracted = ld * mu + normal * (cos1 - mu * cos0);
        match walk.level {
            0 => {
                if r > 0.0 {
                    others.push(back(walk, walk.weight * r, random));
                }
                if t * share_through > 0.0 {
                    let local = scatter(refracted, n1, lobe(rough_through, random), random);
                    let weight = walk.weight * t * share_through;
                    others.push(Walk { d: turn(local), weight, gap: after, level: 2, stray: true, ..*walk });
                }
                *walk = Walk { d: turn(refracted), weight: walk.weight * t * (1.0 - share_through), gap: after, ..*walk };
                return t;
            }
            level => {
                let fair = r / (r + t).max(1e-300);
                let chance = if level == 1 && r > 0.0 { fair.max(TURN) } else { fair };
                if random.draw() < chance {
                    let next = back(walk, walk.weight * r / chance, random);
                    *walk = Walk { level: 2, ..next };
                } else {
                    let stray = random.draw() < share_through;
                    let local = if stray { scatter(refracted, n1, lobe(rough_through, random), random) } else { refracted };
                    let weight = walk.weight * t / (1.0 - chance);
                    let level = if stray { 2 } else { level };
                    *walk = Walk { d: turn(local), weight, gap: after, level, stray: walk.stray || stray, ..*walk };
                }
            }
        }
        1.0
    }
}

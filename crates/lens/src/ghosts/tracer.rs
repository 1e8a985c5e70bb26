//! Real rays along a list of reflections.

use super::Grating;
use crate::ray::{TraceDirection, TracedRay};
use crate::system::System;
use crate::{Blocked, BlockedBy};
use glam::{DVec2, DVec3};

/// Steps of the tables of reflectance over the cosine; cubics between the nodes are right to 1e-7 or so.
const STEPS: usize = 96;

/// Light at the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmHit {
    /// Where, mm.
    pub film: DVec2,
    /// Unit direction.
    pub direction: DVec3,
    /// Fraction of the light of the ray that comes so far.
    pub fraction: f64,
}

/// Reflectance and transmittance of a surface at one wavelength, over the cosine in the thinner medium.
#[derive(Clone, Debug)]
pub(crate) struct SurfaceLight {
    /// Whether the thinner medium is on the object's side.
    thin_before: bool,
    transmitted: [f64; STEPS + 1],
    /// Light that goes towards the film, and towards the object.
    reflected: [[f64; STEPS + 1]; 2],
}

impl SurfaceLight {
    pub(crate) fn of(system: &System, i: usize, n: &[f64], nm: f64) -> SurfaceLight {
        let (before, after) = (n[i], n[i + 1]);
        let (mirror, coating) = (system.surfaces[i].mirror, &system.surfaces[i].coating);
        let thin_before = mirror || before <= after;
        let [thin, dense] = if thin_before { [before, after] } else { [after, before] };
        let (ahead, back) = if thin_before {
            (TraceDirection::ToFilm, TraceDirection::ToObject)
        } else {
            (TraceDirection::ToObject, TraceDirection::ToFilm)
        };
        let mut out = SurfaceLight { thin_before, transmitted: [0.0; STEPS + 1], reflected: [[0.0; STEPS + 1]; 2] };
        for k in 0..=STEPS {
            let cos = k as f64 / STEPS as f64;
            let dense_cos = (1.0 - (thin / dense).powi(2) * (1.0 - cos * cos)).max(0.0).sqrt();
            if mirror {
                // Both ways alike: the gap before and the gap after are the same side.
                out.transmitted[k] = system.surface_transmittance(i, TraceDirection::ToFilm, [before, before], [cos; 2], nm);
                continue;
            }
            let there = coating.response(false, ahead, [thin, dense], cos, nm);
            let from_dense = coating.response(false, back, [dense, thin], dense_cos, nm);
            out.transmitted[k] = there.unpolarised_transmittance();
            let index = usize::from(!thin_before);
            out.reflected[index][k] = there.unpolarised_reflectance();
            out.reflected[1 - index][k] = from_dense.unpolarised_reflectance();
        }
        out
    }

    /// Reflectance and transmittance for light towards the film or the object, by the cosines of incidence and refraction (`None`: total reflection, whose
    /// losses in films are left out).
    pub(crate) fn fractions(&self, towards_film: bool, cos0: f64, cos1: Option<f64>) -> (f64, f64) {
        let Some(cos1) = cos1 else { return (1.0, 0.0) };
        let cos = if self.thin_before == towards_film { cos0 } else { cos1 };
        let transmitted = look_up(&self.transmitted, cos);
        let reflected = look_up(&self.reflected[usize::from(!towards_film)], cos);
        // Rounding of the tables makes no light.
        let over = (transmitted + reflected).max(1.0);
        (reflected / over, transmitted / over)
    }
}

/// The cubic through the four nodes around a cosine.
fn look_up(table: &[f64; STEPS + 1], cos: f64) -> f64 {
    let at = cos.clamp(0.0, 1.0) * STEPS as f64;
    let i = (at as usize).clamp(1, STEPS - 2);
    let t = at - i as f64;
    let value = -table[i - 1] * t * (t - 1.0) * (t - 2.0) / 6.0 + table[i] * (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
        - table[i + 1] * (t + 1.0) * t * (t - 2.0) / 2.0
        + table[i + 2] * (t + 1.0) * t * (t - 1.0) / 6.0;
    value.max(0.0)
}

/// Light on its way.
struct Walk {
    o: DVec3,
    d: DVec3,
    fraction: f64,
    gap: usize,
    way: TraceDirection,
}

/// A lens at one wavelength, ready to follow light that surfaces throw back.
#[derive(Clone, Debug)]
pub struct GhostTracer<'a> {
    system: &'a System,
    n: Vec<f64>,
    absorption: Vec<f64>,
    light: Vec<SurfaceLight>,
    pub(super) nm: f64,
    pub(super) sensor_reflectance: f64,
    pub(super) grating: Option<Grating>,
}

impl<'a> GhostTracer<'a> {
    /// For a wavelength in nm; `sensor_reflectance`: 0 to 1, [`super::SENSOR_REFLECTANCE`] where nothing is known.
    pub fn new(system: &'a System, nm: f64, sensor_reflectance: f64) -> GhostTracer<'a> {
        let n = system.indices(nm);
        let light = (0..system.surfaces.len()).map(|i| SurfaceLight::of(system, i, &n, nm)).collect();
        GhostTracer { system, absorption: system.absorption(nm), n, light, nm, sensor_reflectance, grating: None }
    }

    /// Index of every gap.
    pub(super) fn indices(&self) -> &[f64] {
        &self.n
    }

    /// Reflectance of a surface for light along its axis; the number of all surfaces: that of the sensor, as a mirror.
    pub(super) fn axial_reflectance(&self, surface: usize) -> f64 {
        match self.light.get(surface) {
            Some(light) => light.reflected[0][STEPS],
            None => self.sensor_reflectance([0; 2]),
        }
    }

    /// The lens.
    pub fn system(&self) -> &System {
        self.system
    }

    /// Follows a ray that comes from the object through the lens, thrown back at the surfaces `turns` one after the other (the number of all
    /// surfaces: the sensor), to the film. No turn: the direct light; a [`super::Pair`]: `[back, forth]`. `Err` where it misses a surface, is clipped or totally reflected, or
    /// the turns do not lead to the film.
    pub fn follow(&self, ray: TracedRay, turns: &[usize]) -> Result<FilmHit, Blocked> {
        let ray = self.system.ray_from_object(ray);
        self.go_on(Walk { o: ray.position, d: ray.direction, fraction: 1.0, gap: 0, way: TraceDirection::ToFilm }, turns)
    }

    /// Follows light that has arrived at the sensor back from it, in an order of its grating (0, 0: as from a mirror), thrown back at the surfaces `turns`, to the film again.
    /// `Err` as [`GhostTracer::follow`], and where the order has no light or does not exist.
    pub fn follow_back(&self, arrival: &FilmHit, order: [i32; 2], turns: &[usize]) -> Result<FilmHit, Blocked> {
        let count = self.system.surfaces.len();
        let d = arrival.direction;
        let [x, y] = self.grating().map_or([0.0; 2], |g| g.turn(order));
        let (x, y) = (d.x + x, d.y + y);
        let z2 = 1.0 - x * x - y * y;
        let fraction = arrival.fraction * self.sensor_reflectance(order);
        if z2 <= 0.0 || fraction <= 0.0 {
            return Err(Blocked { surface: count, why: BlockedBy::Missed });
        }
        let o = arrival.film.extend(self.system.film_z);
        let d = DVec3::new(x, y, -d.z.signum() * z2.sqrt());
        self.go_on(Walk { o, d, fraction, gap: count, way: TraceDirection::ToObject }, turns)
    }

    fn go_on(&self, start: Walk, turns: &[usize]) -> Result<FilmHit, Blocked> {
        let system = self.system;
        let count = system.surfaces.len();
        let Walk { mut o, mut d, mut fraction, mut gap, mut way } = start;
        let mut turns = turns.iter().copied();
        let mut turn = turns.next();
        loop {
            let run = match way {
                TraceDirection::ToFilm => system.runs[gap],
                TraceDirection::ToObject => -system.runs[gap],
            };
            if way == TraceDirection::ToFilm && gap == count {
                let missed = Err(Blocked { surface: count, why: BlockedBy::Missed });
                let t = (system.film_z - o.z) / d.z;
                if d.z * run <= 0.0 || !t.is_finite() {
                    return missed;
                }
                let at = o + d * t;
                match turn {
                    None => return Ok(FilmHit { film: at.truncate(), direction: d, fraction }),
                    Some(surface) if surface == count => {
                        (o, d, way) = (at, DVec3::new(d.x, d.y, -d.z), TraceDirection::ToObject);
                        fraction *= self.sensor_reflectance([0; 2]);
                        turn = turns.next();
                        continue;
                    }
                    Some(_) => return missed,
                }
            }
            let (i, after) = match way {
                TraceDirection::ToFilm => (gap, gap + 1),
                // Out of the front: the list of turns does not lead to the film.
                TraceDirection::ToObject if gap == 0 => return Err(Blocked { surface: 0, why: BlockedBy::Missed }),
                TraceDirection::ToObject => (gap - 1, gap - 1),
            };
            let surface = &system.surfaces[i];
            let blocked = |why| Err(Blocked { surface: i, why });
            let mut length = 0.0;
            if system.gradients[gap].is_some() {
                let ray = TracedRay { position: o, direction: d };
                let crossed = system.cross_gradient(gap, self.n[gap], i, ray, run);
                let Some((there, path)) = crossed else { return blocked(BlockedBy::Missed) };
                (o, d, length) = (there.position, there.direction, path / self.n[gap]);
            }
            let (local_o, local_d) = surface.to_local(o, d);
            let Some(m) = surface.profile.intersect(local_o, local_d, run) else { return blocked(BlockedBy::Missed) };
            if !surface.lets_through(m.point.x, m.point.y) {
                return blocked(BlockedBy::Clipped);
            }
            if i == system.stop {
                let passes = system.iris.transmittance(m.point.x, m.point.y);
                if passes <= 0.0 {
                    return blocked(BlockedBy::Clipped);
                }
                fraction *= passes;
            }
            if self.absorption[gap] > 0.0 {
                fraction *= (-self.absorption[gap] * (length + m.t.abs())).exp();
            }
            let point = surface.to_lens(m.point, local_d).0;
            let [n0, n1] = [gap, after].map(|gap| system.index_at(gap, self.n[gap], point));
            if !(n0.is_finite() && n1.is_finite()) {
                return blocked(BlockedBy::Opaque);
            }
            let facing = local_d.dot(m.normal);
            let normal = if facing < 0.0 { -m.normal } else { m.normal };
            let cos0 = facing.abs();
            let mirrored = local_d - normal * (2.0 * cos0);
            let light = &self.light[i];
            let towards_film = way == TraceDirection::ToFilm;
            let direction = if turn == Some(i) && !surface.mirror {
                let cos = if light.thin_before == towards_film {
                    Some(cos0)
                } else {
                    let mu = n0 / n1;
                    let cos2 = 1.0 - mu * mu * (1.0 - cos0 * cos0);
                    (cos2 >= 0.0).then(|| cos2.sqrt())
                };
                // Total reflection: all of it, but for what films absorb of it, which is left out.
                fraction *= cos.map_or(1.0, |cos| look_up(&light.reflected[usize::from(!towards_film)], cos));
                way = if towards_film { TraceDirection::ToObject } else { TraceDirection::ToFilm };
                turn = turns.next();
                mirrored
            } else if let Some(focal) = surface.ideal_focal_length {
                let bent = crate::ideal::bend(focal, m.point.truncate(), local_d, run, towards_film);
                let Some(bent) = bent else { return blocked(BlockedBy::Missed) };
                gap = after;
                bent.direction
            } else if let Some(phase) = &surface.diffractive {
                let (media, place) = ([n0, if surface.mirror { n0 } else { n1 }], m.point.truncate());
                let wavelength = system.wavelength_mm(&self.n);
                let Some(bent) = phase.bend(place, local_d, m.normal, media, surface.mirror, wavelength) else {
                    return blocked(BlockedBy::TotalReflection);
                };
                let cos1 = bent.direction.dot(m.normal).abs();
                fraction *= look_up(&light.transmitted, if light.thin_before == towards_film { cos0 } else { cos1 });
                fraction *= system.diffraction_efficiency(i, phase.order(), wavelength * 1e6);
                gap = after;
                bent.direction
            } else if surface.mirror {
                fraction *= look_up(&light.transmitted, cos0);
                gap = after;
                mirrored
            } else {
                let mu = n0 / n1;
                let cos2 = 1.0 - mu * mu * (1.0 - cos0 * cos0);
                if cos2 < 0.0 {
                    return blocked(BlockedBy::TotalReflection);
                }
                let cos1 = cos2.sqrt();
                fraction *= look_up(&light.transmitted, if light.thin_before == towards_film { cos0 } else { cos1 });
                gap = after;
                local_d * mu + normal * (cos1 - mu * cos0)
            };
            (o, d) = surface.to_lens(m.point, direction);
        }
    }
}

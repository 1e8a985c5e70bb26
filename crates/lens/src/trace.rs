//! The plain trace: one ray through one surface after the other, f64. The oracle for everything faster.
//!
//! Snell in vector form; a ray ends as a ray or as [`Blocked`]. Directions are unit vectors; the path is optical (index ×
//! length) and is what wavefronts are made of.

use crate::ideal;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use crate::{Blocked, BlockedBy};
use glam::DVec3;

/// What happened at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Event {
    /// Number of the surface, 0 the first.
    pub surface: usize,
    /// Where, lens space.
    pub point: DVec3,
    /// Unit direction after it.
    pub direction: DVec3,
    /// Optical path from the last surface (or the start), mm.
    pub path: f64,
    /// Cosines of incidence and refraction.
    pub cosines: [f64; 2],
    /// Indices before and after it, where it is met.
    pub indices: [f64; 2],
}

impl System {
    /// Follows a ray through all surfaces. `n` holds the index of each gap at the ray's wavelength
    /// ([`System::indices`]). `visit` is told every surface passed, in the order in which the light (or its reverse) meets
    /// them. `Err` where the ray misses a surface, meets a rim, obstruction or iris that `apertures` counts, is totally
    /// reflected, or comes to a glass that has no index at its wavelength.
    pub fn trace_with(
        &self,
        ray: TracedRay,
        n: &[f64],
        way: TraceDirection,
        apertures: Apertures,
        visit: impl FnMut(Event),
    ) -> Result<TracedRay, Blocked> {
        self.trace_part(ray, n, way, apertures, 0..self.surfaces.len(), visit)
    }

    /// [`System::trace_with`] through some neighbouring surfaces only. Fails as that.
    pub fn trace_part(
        &self,
        ray: TracedRay,
        n: &[f64],
        way: TraceDirection,
        apertures: Apertures,
        surfaces: std::ops::Range<usize>,
        mut visit: impl FnMut(Event),
    ) -> Result<TracedRay, Blocked> {
        let from_object = way == TraceDirection::ToFilm && surfaces.start == 0;
        let start = if from_object { self.ray_from_object(ray) } else { ray };
        let (mut o, mut d) = (start.position, start.direction);
        for step in 0..surfaces.len() {
            let (i, before, after) = match way {
                TraceDirection::ToFilm => (surfaces.start + step, surfaces.start + step, surfaces.start + step + 1),
                TraceDirection::ToObject => (surfaces.end - 1 - step, surfaces.end - step, surfaces.end - 1 - step),
            };
            let surface = &self.surfaces[i];
            let blocked = |why| Blocked { surface: i, why };
            // Light of this gap runs along `run` · z.
            let run = match way {
                TraceDirection::ToFilm => self.runs[before],
                TraceDirection::ToObject => -self.runs[before],
            };
            let mut path = 0.0;
            if self.gradients[before].is_some() {
                let ray = TracedRay { position: o, direction: d };
                let crossed = self.cross_gradient(before, n[before], i, ray, run).ok_or(blocked(BlockedBy::Missed))?;
                (o, d, path) = (crossed.0.position, crossed.0.direction, crossed.1);
            }
            let (local_o, local_d) = surface.to_local(o, d);
            let m = surface.profile.intersect(local_o, local_d, run).ok_or(blocked(BlockedBy::Missed))?;
            if apertures != Apertures::Ignore && !surface.lets_through(m.point.x, m.point.y) {
                return Err(blocked(BlockedBy::Clipped));
            }
            if i == self.stop && apertures == Apertures::Clip && self.iris.transmittance(m.point.x, m.point.y) <= 0.0 {
                return Err(blocked(BlockedBy::Clipped));
            }
            let at = |gap: usize| match self.gradients[gap] {
                None => n[gap],
                Some(_) => self.index_at(gap, n[gap], surface.to_lens(m.point, local_d).0),
            };
            let (n0, n1) = (at(before), at(after));
            if !(n0.is_finite() && n1.is_finite()) {
                return Err(blocked(BlockedBy::Opaque));
            }
            let facing = local_d.dot(m.normal);
            let normal = if facing < 0.0 { -m.normal } else { m.normal };
            let cos0 = facing.abs();
            path += n0 * m.t;
            let (direction, cos1) = if let Some(focal) = surface.ideal_focal_length {
                let place = m.point.truncate();
                let bent =
                    ideal::bend(focal, place, local_d, run, way == TraceDirection::ToFilm).ok_or(blocked(BlockedBy::Missed))?;
                path += bent.path;
                (bent.direction, bent.direction.z.abs())
            } else if let Some(phase) = &surface.diffractive {
                let (media, place) = ([n0, if surface.mirror { n0 } else { n1 }], m.point.truncate());
                let bent = phase.bend(place, local_d, m.normal, media, surface.mirror, self.wavelength_mm(n));
                let bent = bent.ok_or(blocked(BlockedBy::TotalReflection))?;
                path += bent.path;
                (bent.direction, bent.direction.dot(m.normal).abs())
            } else if surface.mirror {
                (local_d - normal * (2.0 * cos0), cos0)
            } else {
                let mu = n0 / n1;
                let cos1_sq = 1.0 - mu * mu * (1.0 - cos0 * cos0);
                if cos1_sq < 0.0 {
                    return Err(blocked(BlockedBy::TotalReflection));
                }
                let cos1 = cos1_sq.sqrt();
                (local_d * mu + normal * (cos1 - mu * cos0), cos1)
            };
            (o, d) = surface.to_lens(m.point, direction);
            visit(Event { surface: i, point: o, direction: d, path, cosines: [cos0, cos1], indices: [n0, n1] });
        }
        let end = TracedRay { position: o, direction: d };
        Ok(if way == TraceDirection::ToObject && surfaces.start == 0 { self.ray_to_object(end) } else { end })
    }

    /// [`System::trace_with`] without a visitor. Fails as that.
    pub fn trace(&self, ray: TracedRay, n: &[f64], way: TraceDirection, apertures: Apertures) -> Result<TracedRay, Blocked> {
        self.trace_with(ray, n, way, apertures, |_| {})
    }

    /// Fraction of the light that comes through: glass absorption, and reflection at every surface (Fresnel, unpolarised; a
    /// coating as [`crate::coating`] says). `Err` where the ray is blocked, rims and iris included.
    pub fn transmittance(&self, ray: TracedRay, n: &[f64], nm: f64, way: TraceDirection) -> Result<f64, Blocked> {
        Ok(self.trace_light(ray, n, nm, way)?.1)
    }

    /// A ray behind the lens, and the [`System::transmittance`] along it. `Err` where it is blocked.
    pub fn trace_light(&self, ray: TracedRay, n: &[f64], nm: f64, way: TraceDirection) -> Result<(TracedRay, f64), Blocked> {
        let mut fraction = 1.0;
        let absorption = self.absorption(nm);
        let out = self.trace_with(ray, n, way, Apertures::Clip, |e| {
            let before = match way {
                TraceDirection::ToFilm => e.surface,
                TraceDirection::ToObject => e.surface + 1,
            };
            fraction *= self.surface_transmittance(e.surface, way, e.indices, e.cosines, nm);
            if let Some(phase) = &self.surfaces[e.surface].diffractive {
                fraction *= self.diffraction_efficiency(e.surface, phase.order(), nm);
            }
            fraction *= (-absorption[before] * (e.path / n[before]).abs()).exp();
        })?;
        // The first and the last gap are the world and the way to the film: air.
        Ok((out, fraction))
    }
}

/// Point (mm) in which the line of a ray meets the plane z = `z` (mm); not finite where they are parallel.
pub fn at_plane(ray: &TracedRay, z: f64) -> DVec3 {
    ray.position + ray.direction * ((z - ray.position.z) / ray.direction.z)
}

//! The plain trace: one ray through one surface after the other, f64. The oracle for everything faster.
//!
//! Snell in vector form; a ray ends as a ray or as [`Blocked`]. Directions are unit vectors; the path is optical (index ×
//! length) and is what wavefronts are made of.

use crate::system::System;
use crate::{Blocked, BlockedBy};
use glam::DVec3;

/// A ray in lens space, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TracedRay {
    /// A point on it.
    pub position: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Which way light is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the object to the film.
    ToFilm,
    /// From the film to the object.
    ToObject,
}

/// Whether apertures count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apertures {
    /// Rims and iris stop light.
    Clip,
    /// Rays pass beyond rims and iris: for analysis and for finding pupils.
    Ignore,
    /// Rims stop light, the iris is fully open (its own rim counts).
    IgnoreIris,
}

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
}

impl System {
    /// Follows a ray through all surfaces. `n` holds the index of each gap at the ray's wavelength
    /// ([`System::indices`]). `visit` is told every surface passed, in the order in which the light (or its reverse) meets
    /// them.
    pub fn trace_with(
        &self,
        ray: TracedRay,
        n: &[f64],
        way: Way,
        apertures: Apertures,
        visit: impl FnMut(Event),
    ) -> Result<TracedRay, Blocked> {
        self.trace_part(ray, n, way, apertures, 0..self.surfaces.len(), visit)
    }

    /// [`System::trace_with`] through some neighbouring surfaces only.
    pub fn trace_part(
        &self,
        ray: TracedRay,
        n: &[f64],
        way: Way,
        apertures: Apertures,
        surfaces: std::ops::Range<usize>,
        mut visit: impl FnMut(Event),
    ) -> Result<TracedRay, Blocked> {
        let (mut o, mut d) = (ray.position, ray.direction);
        for step in 0..surfaces.len() {
            let (i, before, after) = match way {
                Way::ToFilm => (surfaces.start + step, surfaces.start + step, surfaces.start + step + 1),
                Way::ToObject => (surfaces.end - 1 - step, surfaces.end - step, surfaces.end - 1 - step),
            };
            let surface = &self.surfaces[i];
            let blocked = |why| Blocked { surface: i, why };
            // Light of this gap runs along `run` · z.
            let run = match way {
                Way::ToFilm => self.runs[before],
                Way::ToObject => -self.runs[before],
            };
            let (local_o, local_d) = surface.to_local(o, d);
            let m = surface.profile.meet(local_o, local_d, run).ok_or(blocked(BlockedBy::Missed))?;
            if apertures != Apertures::Ignore && !surface.lets_through(m.point.x, m.point.y) {
                return Err(blocked(BlockedBy::Clipped));
            }
            if i == self.stop && apertures == Apertures::Clip && self.iris.transmittance(m.point.x, m.point.y) <= 0.0 {
                return Err(blocked(BlockedBy::Clipped));
            }
            let (n0, n1) = (n[before], n[after]);
            let facing = local_d.dot(m.normal);
            let normal = if facing < 0.0 { -m.normal } else { m.normal };
            let cos0 = facing.abs();
            let (direction, cos1) = if surface.mirror {
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
            visit(Event { surface: i, point: o, direction: d, path: n0 * m.t, cosines: [cos0, cos1] });
        }
        Ok(TracedRay { position: o, direction: d })
    }

    /// [`System::trace_with`] without a visitor.
    pub fn trace(&self, ray: TracedRay, n: &[f64], way: Way, apertures: Apertures) -> Result<TracedRay, Blocked> {
        self.trace_with(ray, n, way, apertures, |_| {})
    }

    /// Share of the light that comes through: glass absorption, and reflection at every surface (Fresnel, unpolarised; a
    /// coating as [`crate::Coating`] says).
    pub fn transmittance(&self, ray: TracedRay, n: &[f64], nm: f64, way: Way) -> Result<f64, Blocked> {
        let mut share = 1.0;
        let absorption = self.absorption(nm);
        self.trace_with(ray, n, way, Apertures::Clip, |e| {
            let (before, after) = match way {
                Way::ToFilm => (e.surface, e.surface + 1),
                Way::ToObject => (e.surface + 1, e.surface),
            };
            share *= self.surface_transmittance(e.surface, n[before], n[after], e.cosines, nm);
            share *= (-absorption[before] * (e.path / n[before]).abs()).exp();
        })?;
        // The first and the last gap are the world and the way to the film: air.
        Ok(share)
    }
}

/// Moves a ray along itself to a plane z = `z`.
pub fn at_plane(ray: &TracedRay, z: f64) -> DVec3 {
    ray.position + ray.direction * ((z - ray.position.z) / ray.direction.z)
}

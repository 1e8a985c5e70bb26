//! What a distant source makes of a ghost: real rays over the front of the lens, summed up on the film.

use super::{FilmHit, GhostTracer};
use crate::ray::TracedRay;
use crate::system::System;
use glam::{DVec2, DVec3};

/// Rays across the front of the first look for the part that a ghost's light takes, by default.
pub const COARSE: usize = 40;

/// Light of irradiance 1 (across the beam, at the middle of the front's rim) from a direction or from a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceBeam {
    /// Unit direction of the light at the middle of the rim, z > 0.
    direction: DVec3,
    /// Distance of the source from there, mm; infinite of parallel light.
    distance: f64,
    /// Middle of the rim of the first surface.
    middle: DVec3,
    /// Its radius, mm.
    radius: f64,
}

impl SourceBeam {
    /// Light along a direction with z > 0 (in the space of the object) on the front of a lens; `None` for light from beside or behind.
    pub fn new(system: &System, direction: DVec3) -> Option<SourceBeam> {
        let direction = direction.normalize();
        let first = system.surfaces.first()?;
        // A part off the vertex has its own middle.
        let (at, radius) = first.clear_circle();
        // The plane of the rim; of a part that through its middle.
        let depth_at = if at == DVec2::ZERO { DVec2::Y * radius * (1.0 - 1e-9) } else { at };
        let sag = first.profile.sag(depth_at.x, depth_at.y).unwrap_or(0.0);
        let (middle, along) = first.to_lens(at.extend(sag), DVec3::Z);
        let middle = system.ray_to_object(TracedRay { position: middle, direction: along }).position;
        let beam = SourceBeam { direction, distance: f64::INFINITY, middle, radius };
        (direction.is_finite() && direction.z > 1e-3).then_some(beam)
    }

    /// Light of a point (mm, in the space of the object) before the lens; `None` from beside or behind.
    pub fn from_point(system: &System, point: DVec3) -> Option<SourceBeam> {
        let middle = SourceBeam::new(system, DVec3::Z)?.middle;
        let way = middle - point;
        Some(SourceBeam { distance: way.length(), ..SourceBeam::new(system, way)? })
    }

    /// Middle of the rim that the beam is aimed at, mm.
    pub fn middle(&self) -> DVec3 {
        self.middle
    }

    /// Light of a source at a field angle in degrees, up in y: it runs downwards.
    pub fn at_field(system: &System, degrees: f64) -> Option<SourceBeam> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        SourceBeam::new(system, DVec3::new(0.0, -sin, cos))
    }

    /// Radius of the rim that the beam is aimed at, mm.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The ray to a place of the rim's plane, mm from its middle.
    pub fn ray(&self, place: DVec2) -> TracedRay {
        let end = self.middle + place.extend(0.0);
        let back = 2.0 * self.radius + 1.0;
        if self.distance.is_infinite() {
            return TracedRay { position: end - self.direction * back, direction: self.direction };
        }
        let point = self.middle - self.direction * self.distance;
        let direction = (end - point).normalize();
        TracedRay { position: if self.distance > 2.0 * back { end - direction * back } else { point }, direction }
    }

    /// Power that a unit of area of the rim's plane takes at a place, mm from its middle.
    pub fn power_density(&self, place: DVec2) -> f64 {
        if self.distance.is_infinite() {
            return self.direction.z;
        }
        let way = place.extend(0.0) + self.direction * self.distance;
        let length = way.length();
        (self.distance / length).powi(2) * way.z / length
    }

    /// Part of the rim's plane in which light takes a way, as corners of a rectangle that is a cell larger than what was found; `None` where no ray of a first look does.
    /// `across`: rays across the front (`COARSE`).
    pub fn extent(&self, tracer: &GhostTracer, turns: &[usize], across: usize) -> Option<[DVec2; 2]> {
        let cell = 2.0 * self.radius / across as f64;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for i in 0..across * across {
            let place = DVec2::new((i % across) as f64 + 0.5, (i / across) as f64 + 0.5) * cell - self.radius;
            if place.length() < self.radius + cell && tracer.follow(self.ray(place), turns).is_ok() {
                (low, high) = (low.min(place), high.max(place));
            }
        }
        let bound = DVec2::splat(self.radius);
        (low.x <= high.x).then(|| [(low - cell).max(-bound), (high + cell).min(bound)])
    }
}

/// The direct light of a beam at the sensor.
#[derive(Clone, Debug)]
pub struct AtSensor {
    /// Rays of a square grid over the part of the front whose light comes through, row by row, each with the power that a unit of area of the front takes there; `None` where a ray is lost.
    pub rays: Vec<Option<(FilmHit, f64)>>,
    /// Area of the front that a ray stands for, mm².
    pub cell_mm2: f64,
}

impl AtSensor {
    /// With `across` × `across` rays. `None` where none comes through.
    pub fn of(tracer: &GhostTracer, beam: &SourceBeam, across: usize) -> Option<AtSensor> {
        Some(AtSensor::within(tracer, beam, beam.extent(tracer, &[], COARSE)?, across))
    }

    /// The same over a part of the rim's plane that is known ([`SourceBeam::extent`]).
    pub fn within(tracer: &GhostTracer, beam: &SourceBeam, [low, high]: [DVec2; 2], across: usize) -> AtSensor {
        let across = across.max(2);
        let cell = (high - low) / across as f64;
        let ray = |k: usize| {
            let place = low + cell * DVec2::new((k % across) as f64 + 0.5, (k / across) as f64 + 0.5);
            let arrival = tracer.follow(beam.ray(place), &[]).ok()?;
            Some((arrival, beam.power_density(place)))
        };
        AtSensor { rays: (0..across * across).map(ray).collect(), cell_mm2: cell.x * cell.y }
    }
}

/// A ghost of a distant source on the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamGhost {
    /// Light that takes this way, mm²: over the irradiance of the source, the area of front glass whose light it is.
    pub flux_mm2: f64,
    /// Centroid, mm.
    pub center: DVec2,
    /// Second moments about it: xx, xy, yy, mm².
    pub moments: [f64; 3],
    /// Corners of the rectangle around it, mm.
    pub bounds: [DVec2; 2],
}

impl BeamGhost {
    /// Traces a way (no turn: the direct image) with `across` × `across` rays over the part of the front that its light takes. `None` where
    /// none comes to the film.
    pub fn of(tracer: &GhostTracer, beam: &SourceBeam, turns: &[usize], across: usize) -> Option<BeamGhost> {
        BeamGhost::within(tracer, beam, turns, beam.extent(tracer, turns, COARSE)?, across)
    }

    /// The same over a part of the rim's plane that is known ([`SourceBeam::extent`]).
    pub fn within(
        tracer: &GhostTracer,
        beam: &SourceBeam,
        turns: &[usize],
        [low, high]: [DVec2; 2],
        across: usize,
    ) -> Option<BeamGhost> {
        let cell = (high - low) / across.max(2) as f64;
        let mut sums = Sums::default();
        for i in 0..across.max(2) {
            for j in 0..across.max(2) {
                let place = low + cell * DVec2::new(j as f64 + 0.5, i as f64 + 0.5);
                if let Ok(arrival) = tracer.follow(beam.ray(place), turns) {
                    sums.add(arrival.film, arrival.fraction * beam.power_density(place));
                }
            }
        }
        sums.ghost(cell.x * cell.y)
    }

    /// The beam of light at the sensor that its microlenses throw back in an order of their grating, and a surface to the film again. `None` where none comes to the film.
    pub fn of_order(tracer: &GhostTracer, light: &AtSensor, order: [i32; 2], forth: usize) -> Option<BeamGhost> {
        let mut sums = Sums::default();
        for (arrival, power) in light.rays.iter().flatten() {
            if let Ok(back) = tracer.follow_back(arrival, order, &[forth]) {
                sums.add(back.film, back.fraction * power);
            }
        }
        sums.ghost(light.cell_mm2)
    }

    /// Root mean square distance from the centroid, mm.
    pub fn rms_radius_mm(&self) -> f64 {
        (self.moments[0] + self.moments[2]).sqrt()
    }

    /// Area of the evenly lit ellipse with the same second moments, mm².
    pub fn area_mm2(&self) -> f64 {
        let [xx, xy, yy] = self.moments;
        4.0 * std::f64::consts::PI * (xx * yy - xy * xy).max(0.0).sqrt()
    }

    /// Irradiance on the film over that of the source at the front of the lens, as if [`BeamGhost::area_mm2`] were lit evenly.
    pub fn irradiance(&self) -> f64 {
        self.flux_mm2 / self.area_mm2().max(1e-12)
    }
}

/// Sums over rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    flux: f64,
    first: DVec2,
    second: [f64; 3],
    bounds: [DVec2; 2],
}

impl Default for Sums {
    fn default() -> Self {
        Sums { flux: 0.0, first: DVec2::ZERO, second: [0.0; 3], bounds: [DVec2::INFINITY, DVec2::NEG_INFINITY] }
    }
}

impl Sums {
    pub(crate) fn add(&mut self, at: DVec2, fraction: f64) {
        self.flux += fraction;
        self.first += at * fraction;
        for (sum, value) in self.second.iter_mut().zip([at.x * at.x, at.x * at.y, at.y * at.y]) {
            *sum += fraction * value;
        }
        self.bounds = [self.bounds[0].min(at), self.bounds[1].max(at)];
    }

    /// `area`: what a ray of fraction 1 stands for, mm².
    pub(crate) fn ghost(&self, area: f64) -> Option<BeamGhost> {
        if self.flux <= 0.0 {
            return None;
        }
        let center = self.first / self.flux;
        let [xx, xy, yy] = self.second.map(|v| v / self.flux);
        let moments = [xx - center.x * center.x, xy - center.x * center.y, yy - center.y * center.y];
        Some(BeamGhost { flux_mm2: self.flux * area, center, moments, bounds: self.bounds })
    }
}

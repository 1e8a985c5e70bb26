//! Bundles of few rays that stand for whole beams: a Gaussian quadrature of each field's lit pupil, traced in packets.
//!
//! The pupil is cut into arms around the middle of its lit part; along each arm the rays stand on Gauss–Legendre nodes in the square
//! of the distance, between where the light begins (an obstruction) and where it ends (Forbes 1988, J. Opt. Soc. Am. A 5, 1943,
//! doi 10.1364/JOSAA.5.001943, for any outline that is seen whole from its middle). The outline is that of the lens as it was given;
//! afterwards no rim clips, so that everything computed from a bundle is a smooth function of the lens. A lens that was changed is
//! aimed at again: see [`RayAiming`].

use crate::analysis::{Beam, Bench};
use crate::batch::double::{Batch, Indices, LANES, Packet};
use crate::derivatives::{Differentiated, Gradient, Quantity};
use crate::iris::Iris;
use crate::linear::gauss_legendre;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::TAU;

/// Semi-diameter of surfaces that do not clip, mm.
const UNLIMITED: f64 = 1e9;
/// Outline points to an arm: polygons need more of them than the quadrature.
pub(crate) const OUTLINE_TO_ARM: usize = 3;
/// Cells a side of the grid that finds the middle of the lit pupil.
const MIDDLE_GRID: usize = 41;

/// How many rays stand for a beam.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampling {
    /// Directions around the middle of the pupil.
    pub arms: usize,
    /// Rays along each.
    pub rings: usize,
}

/// What stays when a lens has been changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RayAiming {
    /// Places in the stop: the diaphragm limits the light of a lens that is built with errors. Linear in the place.
    Stop,
    /// Places in the entrance pupil around the ray through the middle of the stop: a design keeps its beam while its shape changes.
    Entrance,
}

/// The rays of a field point.
#[derive(Clone, Debug)]
pub(crate) struct Bundle {
    /// Field angle, degrees.
    pub field_deg: f64,
    beam: Beam,
    /// Place across the chief ray (mm) and weight of each ray; the first is the chief ray, of weight 0. Weights sum to 1.
    pub rays: Vec<(DVec2, f64)>,
    /// Inner and outer end of the light along [`OUTLINE_TO_ARM`] times as many directions as arms, mm from the chief ray.
    pub outline: Vec<[DVec2; 2]>,
    /// Where the chief ray of the lens as given crosses the stop, and the change of that by the place across the chief ray.
    stop_place: DVec2,
    stop_change: DMat2,
    step: f64,
}

/// A ray on the plane of the film.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TracedFilmPoint {
    /// mm.
    pub place: DVec2,
    /// Change of x and y with z.
    pub slope: DVec2,
    /// Unit direction.
    pub direction: DVec3,
    /// Optical path to the plane, mm.
    pub path: f64,
    /// Part of the beam that it stands for.
    pub weight: f64,
}

/// A lens without rims, ready for bundles of some wavelengths.
pub(crate) struct Tracer {
    /// The lens; its surfaces do not clip.
    pub system: System,
    batch: Batch,
    n: Vec<Vec<f64>>,
    lanes: Vec<Indices>,
}

/// Change of a [`TracedFilmPoint`] by a parameter of the lens.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FilmPointChange {
    /// mm
    pub place: [f64; 2],
    /// Of the direction.
    pub cosines: [f64; 3],
    /// mm
    pub path: f64,
}

/// What of film points is differentiated, beside places.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Needed {
    /// Directions.
    pub cosines: bool,
    /// Optical paths.
    pub path: bool,
}

/// A lens that is differentiated, with the change of the index by each parameter at each wavelength (1 of what is no index).
pub(crate) struct ByParameters<'a> {
    pub lens: &'a Differentiated,
    /// `[wavelength][parameter]`
    pub index_changes: Vec<Vec<f64>>,
}

/// Change of a quantity by the place across the chief ray, of one ray whose start changes with that place as `start_by`.
fn by_place(g: &Gradient, lane: usize, start_by: &[[DVec3; 2]; 2]) -> DVec2 {
    let by = |from: usize| DVec3::new(g.by_start[from][lane], g.by_start[from + 1][lane], g.by_start[from + 2][lane]);
    DVec2::from(start_by.map(|[position, direction]| by(0).dot(position) + by(3).dot(direction)))
}

/// Where bundles start in a changed lens: new place across the chief ray = matrix × old place + offset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AimedBundle {
    matrix: DMat2,
    offset: DVec2,
}

impl Tracer {
    /// A tracer of a lens as it stands, at wavelengths in nm.
    pub fn new(system: &System, wavelengths_nm: &[f64]) -> Tracer {
        let mut system = system.clone();
        for s in &mut system.surfaces {
            s.semi_diameter = UNLIMITED;
            s.obstruction = 0.0;
            s.apertures.clear();
        }
        system.iris.shape = Iris::Round;
        system.iris.radius = UNLIMITED;
        let n: Vec<Vec<f64>> = wavelengths_nm.iter().map(|nm| system.indices(*nm)).collect();
        let lanes = n.iter().map(|n| Indices::uniform(n)).collect();
        Tracer { batch: Batch::new(&system), system, n, lanes }
    }

    /// Index of every gap at a wavelength, by its number, as [`System::indices`].
    pub fn indices(&self, color: usize) -> &[f64] {
        &self.n[color]
    }

    /// Index behind the last surface at a wavelength, by its number.
    pub fn image_index(&self, color: usize) -> f64 {
        self.n[color][self.system.surfaces.len()]
    }

    /// Place on the stop of a ray before the lens, from its vertex; x and y as the lens has them, however the stop is turned about its axis (a surface that is one, with an error of form).
    fn at_stop(&self, ray: TracedRay, color: usize) -> Option<DVec2> {
        let stop = self.system.stop;
        let mut place = None;
        let traced = self.system.trace_part(ray, &self.n[color], TraceDirection::ToFilm, Apertures::Ignore, 0..stop + 1, |e| {
            if e.surface == stop {
                let surface = &self.system.surfaces[stop];
                let (at, up) = (surface.to_local(e.point, e.direction).0.truncate(), surface.upwards());
                place = Some(DVec2::new(at.perp_dot(up), at.dot(up)));
            }
        });
        // What happens at the stop's own surface after the ray has met it does not matter.
        traced.ok().and(place)
    }
}

impl Bundle {
    /// The light of a field angle (degrees) that the lens lets through. `None` where none does.
    pub fn lit(bench: &Bench, field_deg: f64, nm: f64, sampling: Sampling) -> Option<Bundle> {
        let beam = bench.beam(field_deg, nm)?;
        let n = bench.system.indices(nm);
        let passes = |at: DVec2| bench.system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip).is_ok();
        let [low, high] = beam.extent;
        let cell = (high - low) / MIDDLE_GRID as f64;
        let lit: Vec<DVec2> = (0..MIDDLE_GRID * MIDDLE_GRID)
            .map(|i| low + cell * DVec2::new((i % MIDDLE_GRID) as f64 + 0.5, (i / MIDDLE_GRID) as f64 + 0.5))
            .filter(|at| passes(*at))
            .collect();
        if lit.is_empty() {
            return None;
        }
        let middle = lit.iter().sum::<DVec2>() / lit.len() as f64;
        let reach = (high - low).length();
        // Along a direction: where the light begins and ends.
        let ends = |direction: DVec2| {
            const STEPS: usize = 120;
            let at = |k: usize| reach * k as f64 / STEPS as f64;
            let lit = |r: f64| passes(middle + direction * r);
            let first = (0..=STEPS).find(|k| lit(at(*k)))?;
            let last = (0..=STEPS).rev().find(|k| lit(at(*k)))?;
            let edge = |mut dark: f64, mut light: f64| {
                for _ in 0..45 {
                    let mid = 0.5 * (dark + light);
                    if lit(mid) { light = mid } else { dark = mid }
                }
                light
            };
            let inner = if first == 0 { 0.0 } else { edge(at(first - 1), at(first)) };
            Some([inner, edge(at(last + 1), at(last))])
        };
        Bundle::new(bench, beam.clone(), field_deg, nm, middle, sampling, ends)
    }

    /// A round beam of a radius (mm) around the chief ray of a field angle (degrees), in the field's direction narrower by the fraction
    /// `vignetting` (0 none). `None` where no chief ray comes through.
    pub fn round(bench: &Bench, field_deg: f64, nm: f64, radius: f64, vignetting: f64, sampling: Sampling) -> Option<Bundle> {
        let beam = bench.chief_beam(field_deg, nm)?;
        let ends = |d: DVec2| Some([0.0, 1.0 / f64::hypot(d.x / radius, d.y / (radius * (1.0 - vignetting)))]);
        Bundle::new(bench, beam, field_deg, nm, DVec2::ZERO, sampling, ends)
    }

    fn new(
        bench: &Bench,
        beam: Beam,
        field_deg: f64,
        nm: f64,
        middle: DVec2,
        sampling: Sampling,
        ends: impl Fn(DVec2) -> Option<[f64; 2]>,
    ) -> Option<Bundle> {
        let count = sampling.arms * OUTLINE_TO_ARM;
        let mut outline = vec![];
        let mut rays = vec![(DVec2::ZERO, 0.0)];
        let nodes = gauss_legendre(sampling.rings);
        for i in 0..count {
            // Half a step off the axes: no arm lies in the plane of symmetry.
            let direction = DVec2::from_angle(TAU * (i as f64 + 0.5) / count as f64);
            let [inner, outer] = ends(direction)?;
            outline.push([middle + direction * inner, middle + direction * outer]);
            if i % OUTLINE_TO_ARM == OUTLINE_TO_ARM / 2 {
                let (low, high) = (inner * inner, outer * outer);
                rays.extend(nodes.iter().map(|[x, w]| (middle + direction * (low + (high - low) * x).sqrt(), w * (high - low))));
            }
        }
        let total: f64 = rays.iter().map(|r| r.1).sum();
        if !(total > 0.0) {
            return None;
        }
        rays.iter_mut().for_each(|r| r.1 /= total);
        let reach = outline.iter().map(|o| o[1].length()).fold(0.0, f64::max);
        let mut bundle =
            Bundle { field_deg, beam, rays, outline, stop_place: DVec2::ZERO, stop_change: DMat2::IDENTITY, step: 1e-3 * reach };
        let tracer = Tracer::new(bench.system, &[nm]);
        (bundle.stop_place, bundle.stop_change) = bundle.to_stop(&tracer, 0, DVec2::ZERO)?;
        Some(bundle)
    }

    /// Place in the stop of the ray at a place across the chief ray, and its change by that place.
    fn to_stop(&self, tracer: &Tracer, reference: usize, at: DVec2) -> Option<(DVec2, DMat2)> {
        let place = |at: DVec2| tracer.at_stop(self.beam.ray(at), reference);
        let along = |d: DVec2| Some((place(at + d * self.step)? - place(at - d * self.step)?) / (2.0 * self.step));
        Some((place(at)?, DMat2::from_cols(along(DVec2::X)?, along(DVec2::Y)?)))
    }

    /// Aims the bundle at a changed lens, at the wavelength of a number. `None` where the stop cannot be reached.
    pub fn aim(&self, tracer: &Tracer, reference: usize, aim: RayAiming) -> Option<AimedBundle> {
        let target = match aim {
            RayAiming::Stop => self.stop_place,
            RayAiming::Entrance => DVec2::ZERO,
        };
        // The chief ray by Newton's method; the change of the stop by the place is that at the chief ray.
        let mut offset = DVec2::ZERO;
        let (mut place, mut change) = self.to_stop(tracer, reference, offset)?;
        for _ in 0..20 {
            let error = target - place;
            if !(change.determinant().abs() > 1e-9) {
                return None;
            }
            let step = change.inverse() * error;
            offset += step;
            // Rounding is all that is left.
            if step.length() < 1e-11 * (1.0 + offset.length()) {
                break;
            }
            (place, change) = self.to_stop(tracer, reference, offset)?;
        }
        let matrix = match aim {
            RayAiming::Stop => change.inverse() * self.stop_change,
            RayAiming::Entrance => DMat2::IDENTITY,
        };
        (offset.is_finite() && matrix.is_finite()).then_some(AimedBundle { matrix, offset })
    }

    /// Fills a packet with the rays through some places, the last one again where there are fewer than lanes.
    fn start(&self, packet: &mut Packet, aimed: AimedBundle, places: &[(DVec2, f64)]) {
        for lane in 0..LANES {
            let (place, _) = places[lane.min(places.len() - 1)];
            let ray = self.beam.ray(aimed.matrix * place + aimed.offset);
            packet.set(lane, ray.position.to_array(), ray.direction.to_array());
        }
    }

    /// Where all rays land on the plane of the film at a wavelength, by its number, in the order of [`Bundle::rays`]. `None` where one of
    /// them does not arrive.
    pub fn trace(&self, tracer: &Tracer, aimed: AimedBundle, color: usize) -> Option<Vec<TracedFilmPoint>> {
        self.trace_places(tracer, aimed, color, &self.rays)
    }

    /// The same for other places across the chief ray, with weights.
    pub fn trace_places(
        &self,
        tracer: &Tracer,
        aimed: AimedBundle,
        color: usize,
        places: &[(DVec2, f64)],
    ) -> Option<Vec<TracedFilmPoint>> {
        let film_z = tracer.system.film_z;
        let n_image = tracer.image_index(color);
        let mut film_points = Vec::with_capacity(places.len());
        let mut packet = Packet::default();
        for chunk in places.chunks(LANES) {
            self.start(&mut packet, aimed, chunk);
            let mask = tracer.batch.trace(&mut packet, &tracer.lanes[color], TraceDirection::ToFilm);
            for (lane, (_, weight)) in chunk.iter().enumerate() {
                if mask >> lane & 1 == 0 {
                    return None;
                }
                let position = DVec3::new(packet.x[lane], packet.y[lane], packet.z[lane]);
                let direction = DVec3::new(packet.dx[lane], packet.dy[lane], packet.dz[lane]);
                let t = (film_z - position.z) / direction.z;
                let film_point = TracedFilmPoint {
                    place: (position + direction * t).truncate(),
                    slope: direction.truncate() / direction.z,
                    direction,
                    path: packet.path[lane] + n_image * t,
                    weight: *weight,
                };
                if !(film_point.place.is_finite() && film_point.path.is_finite()) {
                    return None;
                }
                film_points.push(film_point);
            }
        }
        Some(film_points)
    }

    /// By how much the offset of [`RayAiming::Entrance`] changes with each parameter. `None` where the stop cannot be reached.
    pub fn aim_changes(&self, tracer: &Tracer, by: &ByParameters, aimed: AimedBundle, reference: usize) -> Option<Vec<DVec2>> {
        let mut packet = Packet::default();
        self.start(&mut packet, aimed, &[(DVec2::ZERO, 0.0)]);
        let (n, lanes) = (&tracer.n[reference], &tracer.lanes[reference]);
        let traced = by.lens.trace(&tracer.batch, &packet, n, lanes, tracer.system.stop + 1)?;
        let [x, y] = [0, 1].map(|axis| by.lens.gradient(&traced, Quantity::Intersection(axis)));
        let start_by = self.beam.ray_by(aimed.offset);
        let back = DMat2::from_cols(by_place(&x, 0, &start_by), by_place(&y, 0, &start_by)).transpose().inverse();
        let change = |parameter: usize| {
            let factor = by.index_changes[reference][parameter];
            -(back * DVec2::new(x.by[parameter][0], y.by[parameter][0]) * factor)
        };
        back.is_finite().then(|| (0..x.by.len()).map(change).collect())
    }

    /// Derivatives of [`Bundle::trace`] by each parameter of a lens, `[parameter][ray]`; `moved` as [`Bundle::aim_changes`] gives it.
    pub fn trace_changes(
        &self,
        tracer: &Tracer,
        by: &ByParameters,
        (aimed, moved): (AimedBundle, &[DVec2]),
        color: usize,
        needed: Needed,
    ) -> Option<Vec<Vec<FilmPointChange>>> {
        let mut changes = vec![vec![FilmPointChange::default(); self.rays.len()]; moved.len()];
        let mut packet = Packet::default();
        for (number, chunk) in self.rays.chunks(LANES).enumerate() {
            self.start(&mut packet, aimed, chunk);
            let (n, lanes) = (&tracer.n[color], &tracer.lanes[color]);
            let traced = by.lens.trace(&tracer.batch, &packet, n, lanes, tracer.system.surfaces.len())?;
            let start_by: Vec<_> =
                chunk.iter().map(|(place, _)| self.beam.ray_by(aimed.matrix * *place + aimed.offset)).collect();
            // What the lens does to the rays, and what their start does.
            let mut each = |quantity: Quantity, write: &dyn Fn(&mut FilmPointChange, f64)| {
                let g = by.lens.gradient(&traced, quantity);
                for (lane, start_by) in start_by.iter().enumerate() {
                    let along = by_place(&g, lane, start_by);
                    for (parameter, change) in changes.iter_mut().enumerate() {
                        let own = g.by[parameter][lane] * by.index_changes[color][parameter];
                        write(&mut change[number * LANES + lane], own + along.dot(moved[parameter]));
                    }
                }
            };
            (0..2).for_each(|axis| each(Quantity::Place(axis), &|c, v| c.place[axis] = v));
            if needed.cosines {
                (0..3).for_each(|axis| each(Quantity::Cosine(axis), &|c, v| c.cosines[axis] = v));
            }
            if needed.path {
                each(Quantity::Path, &|c, v| c.path = v);
            }
        }
        Some(changes)
    }

    /// Height of all rays at every surface (from its own vertex), the largest of each, mm; `None` where a ray does not pass.
    pub fn heights(&self, tracer: &Tracer, aimed: AimedBundle, color: usize) -> Option<Vec<f64>> {
        let mut heights = vec![0.0f64; tracer.system.surfaces.len()];
        let edge = self.outline.iter().map(|o| o[1]);
        for place in edge {
            let ray = self.beam.ray(aimed.matrix * place + aimed.offset);
            let visit = |e: crate::trace::Event| {
                let local = tracer.system.surfaces[e.surface].to_local(e.point, e.direction).0;
                heights[e.surface] = heights[e.surface].max(local.x.hypot(local.y));
            };
            tracer.system.trace_with(ray, &tracer.n[color], TraceDirection::ToFilm, Apertures::Ignore, visit).ok()?;
        }
        Some(heights)
    }
}

/// Optical path from the object to the foot of the perpendicular from an image point (mm, on the plane of the film) to the ray, mm.
///
/// The phase of the plane wave that runs in the ray's direction, at the image point: with direction cosines as pupil coordinates it
/// is the pupil function's phase (Hopkins 1955; Born & Wolf §4.1.2, the mixed characteristic).
pub(crate) fn path_to_foot(film_point: &TracedFilmPoint, image: DVec2, n_image: f64) -> f64 {
    film_point.path + n_image * (image - film_point.place).dot(film_point.direction.truncate())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compound::{FilmPlace, configure};
    use crate::embedded;
    use crate::glass::D_NM;

    #[test]
    fn few_rays_have_the_spot_of_many() {
        let p = embedded("double-gauss-50mm").unwrap();
        let set = configure(&p, None, Some(2.8), None, FilmPlace::AsPublished).unwrap();
        let bench = Bench::at_infinity(&set.system);
        let tracer = Tracer::new(&set.system, &[D_NM]);
        for field in [0.0, 10.0] {
            let bundle = Bundle::lit(&bench, field, D_NM, Sampling { arms: 24, rings: 7 }).unwrap();
            let aimed = bundle.aim(&tracer, 0, RayAiming::Stop).unwrap();
            assert!(aimed.offset.length() < 1e-8, "the lens as given is aimed at already: {aimed:?}");
            let film_points = bundle.trace(&tracer, aimed, 0).unwrap();
            let mean: DVec2 = film_points.iter().map(|l| l.place * l.weight).sum();
            let rms = film_points.iter().map(|l| l.place.distance_squared(mean) * l.weight).sum::<f64>().sqrt();
            let many = bench.spot(field, D_NM, D_NM, 200, 0.0).unwrap();
            // 200 cells across leave 1 % of the edge of the pupil undecided.
            assert!((rms / many.rms - 1.0).abs() < 0.02, "{field}: {rms} {}", many.rms);
        }
    }
}

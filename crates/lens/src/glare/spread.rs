//! What becomes of the light of a point of the image: the glare spread function by field.

use super::random::{Random, disk, even};
use super::{Balance, GlareTracer, Kind, Unfit};
use crate::ghosts::{BeamGhost, GhostTracer, SourceBeam};
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Wavelengths at which glare is traced, nm.
pub const BINS_NM: [f64; 3] = [450.0, 550.0, 650.0];
/// Rays across the front for the light of the image itself: a first look, and the sum.
const ACROSS: [usize; 2] = [20, 28];

/// Light that arrives beside its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scattered {
    /// Where, mm: the image lies on +y.
    pub at: DVec2,
    /// Number of the wavelength.
    pub bin: usize,
    /// Over the light of the image of this wavelength, had no surface scattered any.
    pub fraction: f64,
    /// [`Kind::Ghost`] or [`Kind::Scatter`].
    pub kind: Kind,
}

/// Glare of a point at one field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldGlare {
    /// Angle of the light to the axis, degrees.
    pub angle_deg: f64,
    /// Distance of the image from the axis, mm.
    pub height_mm: f64,
    /// Of the light of the image the fraction that no surface scattered, by wavelength.
    pub kept: [f64; 3],
    /// The rest, and what came by other ways.
    pub arrivals: Vec<Scattered>,
}

impl FieldGlare {
    /// Glare that comes to the film within `reach` (mm) of the axis over the light of the image, by ghosts and by scatter.
    pub fn fractions(&self, reach: f64) -> [f64; 2] {
        let sum = |kind: Kind| {
            let of_kind = self.arrivals.iter().filter(|a| a.kind == kind && a.at.length() <= reach);
            of_kind.map(|a| a.fraction).sum::<f64>() / 3.0
        };
        [sum(Kind::Ghost), sum(Kind::Scatter)]
    }
}

/// The glare spread function of a lens, of distant points.
#[derive(Clone, Debug, PartialEq)]
pub struct GlareSpread {
    /// From the axis outwards.
    pub fields: Vec<FieldGlare>,
    /// Farthest place of the film from the axis, mm.
    pub reach_mm: f64,
}

impl GlareSpread {
    /// Traces it for `fields` points of the image from the axis to `reach_mm`, each with `rays` rays over the front in each of [`BINS_NM`] (what they
    /// split into not counted). Fields that no light reaches are left out. The same numbers for any number of threads. Fails on lenses that
    /// [`GlareTracer::new`] refuses.
    pub fn of(system: &System, reach_mm: f64, sensor_reflectance: f64, fields: usize, rays: usize) -> Result<GlareSpread, Unfit> {
        let film = DVec2::splat(reach_mm);
        let tracers = BINS_NM.map(|nm| GlareTracer::new(system, nm, film, sensor_reflectance));
        let [a, b, c] = tracers;
        let tracers = [a?, b?, c?];
        let straight = BINS_NM.map(|nm| GhostTracer::new(system, nm, 0.0));
        let found: Vec<Option<FieldGlare>> = (0..fields.max(2))
            .into_par_iter()
            .map(|k| {
                let height = reach_mm * k as f64 / (fields.max(2) - 1) as f64;
                let beam = SourceBeam::new(system, light_of(system, height)?)?;
                field(&beam, &tracers, &straight, k as u64, rays)
            })
            .collect();
        // The first dark one ends the image circle.
        Ok(GlareSpread { fields: found.into_iter().map_while(|f| f).collect(), reach_mm })
    }
}

/// Direction of the light whose image is at a height above the axis; `None` where no light comes.
pub(super) fn light_of(system: &System, height: f64) -> Option<DVec3> {
    let n = system.indices(BINS_NM[1]);
    let rear = system.surfaces.last()?;
    let origin = DVec3::new(0.0, height, system.film_z);
    let mut sum = DVec3::ZERO;
    for i in 0..256 {
        let p = disk(even(i)) * rear.semi_diameter;
        let ray = TracedRay { position: origin, direction: (DVec3::new(p.x, p.y, rear.z) - origin).normalize() };
        if let Ok(out) = system.trace(ray, &n, TraceDirection::ToObject, Apertures::Clip) {
            sum += out.direction;
        }
    }
    (sum.length() > 0.5).then(|| -sum.normalize())
}

fn field(
    beam: &SourceBeam,
    tracers: &[GlareTracer; 3],
    straight: &[GhostTracer; 3],
    set: u64,
    rays: usize,
) -> Option<FieldGlare> {
    let corners = beam.extent(&straight[1], &[], ACROSS[0])?;
    let images: Vec<BeamGhost> =
        straight.iter().map(|s| BeamGhost::within(s, beam, &[], corners, ACROSS[1])).collect::<Option<_>>()?;
    let center = images[1].center;
    let along = if center.length() > 1e-6 { center.normalize() } else { DVec2::Y };
    let area = std::f64::consts::PI * beam.radius().powi(2) / rays.max(1) as f64;
    let mut arrivals = vec![];
    let mut kept = [1.0; 3];
    for (bin, tracer) in tracers.iter().enumerate() {
        let (mut went, mut unscattered) = (0.0, 0.0);
        for i in 0..rays.max(1) {
            let mut random = Random::new(8 * set + bin as u64, i as u64);
            // Another part of the sequence at each wavelength.
            let place = disk(even(i + bin * rays)) * beam.radius();
            let power = beam.power_density(place);
            let scale = power * area / images[bin].flux_mm2;
            // On the axis all directions are alike.
            let turn = if center.length() > 1e-6 { along } else { DVec2::from_angle(std::f64::consts::TAU * random.draw()) };
            let record = |kind: Kind, at: DVec2, weight: f64, whole: f64| {
                if kind == Kind::Image {
                    went += power * weight;
                    unscattered += power * whole;
                } else {
                    let at = DVec2::new(at.perp_dot(turn), at.dot(turn));
                    arrivals.push(Scattered { at, bin, fraction: scale * weight, kind });
                }
            };
            tracer.follow_from_object(beam.ray(place), &mut random, &mut Balance::default(), record);
        }
        kept[bin] = if unscattered > 0.0 { went / unscattered } else { 1.0 };
    }
    let direction = beam.ray(DVec2::ZERO).direction;
    Some(FieldGlare { angle_deg: direction.z.min(1.0).acos().to_degrees(), height_mm: center.length(), kept, arrivals })
}

impl GlareTracer<'_> {
    /// Light of a beam of irradiance 1 that comes to the film by walls and scatter (`Kind::Scatter`) and by reflections (`Kind::Ghost`), from `rays` rays over
    /// the front: how, where (mm), and how much, mm².
    pub fn stray_rays(&self, beam: &SourceBeam, set: u64, rays: usize) -> Vec<(Kind, DVec2, f64)> {
        let area = std::f64::consts::PI * beam.radius().powi(2) / rays.max(1) as f64;
        let mut found = vec![];
        for i in 0..rays {
            let place = disk(even(i)) * beam.radius();
            let scale = beam.power_density(place) * area;
            let record = |kind: Kind, at: DVec2, weight: f64, _: f64| {
                if kind != Kind::Image {
                    found.push((kind, at, scale * weight));
                }
            };
            self.follow_from_object(beam.ray(place), &mut Random::new(set, i as u64), &mut Balance::default(), record);
        }
        found
    }

    /// What becomes of the light of a beam that meets the front: fractions of it.
    pub fn balance(&self, beam: &SourceBeam, rays: usize) -> Balance {
        let (mut sums, tracer) = (Balance::default(), self.exhaustive());
        for i in 0..rays {
            let ray = beam.ray(disk(even(i)) * beam.radius());
            let mut of_ray = Balance::default();
            tracer.follow_from_object(ray, &mut Random::new(1 << 40, i as u64), &mut of_ray, |_, _, _, _| {});
            sums.add(&of_ray);
        }
        let each = 1.0 / rays.max(1) as f64;
        let Balance { film, glass, walls, front, lost } = sums;
        Balance { film: film * each, glass: glass * each, walls: walls * each, front: front * each, lost: lost * each }
    }
}

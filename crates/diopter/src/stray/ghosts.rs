//! Ghosts of lamps: which of them matter on the film, and how they are drawn there.

use super::beams::Beam;
use super::raster::{Mesh, Patch, Region, on_raster};
use super::tracing::{AT_ONCE, LOOK, assemble, tracer};
use super::{BINS, Part, bin_nm, orders, part_of, veil};
use crate::camera::Film;
use diopter_image::Raster;
use diopter_lens::System;
use diopter_lens::ghosts::{BeamGhost, GhostTracer, pairs, strong_fours};
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// Rays across the front of the estimate, and of strong and weak ghosts.
pub(super) const ESTIMATE: usize = 12;
pub(super) const STRONG: usize = 48;
pub(super) const WEAK: usize = 20;

/// Ghosts this strong (of the strongest one's irradiance) are strong.
pub(super) const STRONG_FRACTION: f64 = 0.02;

/// Part of the ghost light on the film that may be left out with the weakest ghosts.
pub(super) const LEFT_OUT: f64 = 0.01;

/// Ghosts of four reflections: those at least this bright beside the brightest of two, at most so many.
pub(super) const FOUR_FRACTION: f64 = 0.005;
pub(super) const MOST_FOURS: usize = 16;

/// Ghosts smeared over so many cells of the raster are drawn on one twice as coarse; most such steps.
pub(super) const SMEAR: f64 = 6.0;
pub(super) const MOST_STEPS: usize = 4;

/// What is drawn: a beam, the surfaces that throw it back one after the other, the part of the front and the rays across it.
pub(super) struct Job<'a> {
    pub(super) beam: &'a Beam,
    pub(super) turns: Vec<usize>,
    pub(super) corners: [DVec2; 2],
    pub(super) across: usize,
    /// How far on the film the ghost moves as the source crosses its cell in two directions, mm.
    pub(super) moves: [DVec2; 2],
}

impl Job<'_> {
    /// How often the raster is halved before the ghost is drawn: it has no detail finer than its moves.
    pub(super) fn coarser(&self, cell_mm: f64) -> usize {
        let [a, b] = self.moves.map(|m| m.length());
        let steps = (a.min(b) / (SMEAR * cell_mm)).max(1.0).log2();
        (steps as usize).min(MOST_STEPS)
    }
}

/// The ghosts of beams, lamps that change alike together.
pub(super) fn ghosts_of(system: &System, beams: &[Beam], film: &Film, [columns, rows]: [usize; 2], bands: usize) -> Vec<Part> {
    if beams.is_empty() {
        return vec![];
    }
    let tracers: Vec<GhostTracer> = (0..BINS).into_par_iter().map(|k| tracer(system, film, bin_nm(k))).collect();
    let middle = &tracers[BINS / 2];
    let fours = strong_fours(middle, FOUR_FRACTION, MOST_FOURS).into_iter().map(|four| four.to_vec());
    let ways: Vec<Vec<usize>> = pairs(system).into_iter().map(|p| vec![p.back, p.forth]).chain(fours).collect();
    let jobs: Vec<Job> = beams.iter().flat_map(|beam| jobs(beam, &ways, middle, film)).collect();
    let cell_mm = film.width_mm / columns as f64;
    // By modulation, and by how coarse a raster is.
    let mut drawn: Vec<(usize, Part)> = vec![];
    for chunk in jobs.chunks(AT_ONCE) {
        let patches: Vec<Option<Patch>> = chunk
            .par_iter()
            .map(|job| {
                let coarser = 1 << job.coarser(cell_mm);
                draw(job, &tracers, film, [columns.div_ceil(coarser), rows.div_ceil(coarser)], bands)
            })
            .collect();
        // In the order of the jobs, whatever thread drew them.
        for (job, patch) in chunk.iter().zip(patches) {
            let Some(patch) = patch else { continue };
            let steps = job.coarser(cell_mm);
            let known = drawn.iter().position(|(s, p)| *s == steps && p.modulation == job.beam.modulation);
            let number = known.unwrap_or_else(|| {
                let light = Raster::new(columns.div_ceil(1 << steps), rows.div_ceil(1 << steps), bands);
                drawn.push((steps, Part { modulation: job.beam.modulation, light }));
                drawn.len() - 1
            });
            patch.add_to(&mut drawn[number].1.light);
        }
    }
    let mut parts: Vec<Part> = vec![];
    for (steps, part) in drawn {
        let to = part_of(&mut parts, part.modulation, [columns, rows], bands);
        match steps {
            0 => to.light.data.iter_mut().zip(&part.light.data).for_each(|(sum, v)| *sum += v),
            _ => veil::add_stretched(&part.light, &mut to.light),
        }
    }
    let size = [columns, rows];
    orders::draw_all(system, beams, film, size, bands, |beam, patch| {
        patch.add_to(&mut part_of(&mut parts, beams[beam].modulation, size, bands).light);
    });
    parts
}

/// The ghosts of a beam that matter on the film.
pub(super) fn jobs<'a>(beam: &'a Beam, ways: &[Vec<usize>], tracer: &GhostTracer, film: &Film) -> Vec<Job<'a>> {
    let film_area = film.width_mm * film.height_mm;
    type OfWay<'w> = (&'w Vec<usize>, [DVec2; 2], BeamGhost);
    let found: Vec<Option<OfWay>> = ways
        .par_iter()
        .map(|turns| {
            let corners = beam.source.extent(tracer, turns, LOOK)?;
            let ghost = BeamGhost::within(tracer, &beam.source, turns, corners, ESTIMATE)?;
            let reach = film.reach();
            let [low, high] = ghost.bounds;
            // A margin: the estimate has few rays.
            let margin = 0.2 * (high - low) + 0.1;
            let meets = (low - margin).cmple(reach).all() && (high + margin).cmpge(-reach).all();
            meets.then_some((turns, corners, ghost))
        })
        .collect();
    let mut found: Vec<_> = found.into_iter().flatten().collect();
    let on_film = |g: &BeamGhost| g.irradiance() * g.area_mm2().min(film_area);
    found.sort_by(|a, b| on_film(&b.2).total_cmp(&on_film(&a.2)));
    let all: f64 = found.iter().map(|f| on_film(&f.2)).sum();
    let strongest = found.iter().map(|f| f.2.irradiance()).fold(0.0, f64::max);
    let mut before = 0.0;
    let mut jobs = vec![];
    for (turns, corners, ghost) in found {
        // A small ghost may be bright and bring little light.
        let strong = ghost.irradiance() > STRONG_FRACTION * strongest;
        if strong || before < (1.0 - LEFT_OUT) * all {
            // As the source crosses its cell the ghost moves about twice as far as from the middle to an edge.
            let moves = beam.edges.map(|edge| {
                let moved = edge.and_then(|edge| {
                    let corners = edge.extent(tracer, turns, LOOK)?;
                    BeamGhost::within(tracer, &edge, turns, corners, ESTIMATE)
                });
                moved.map_or(DVec2::ZERO, |moved| 2.0 * (moved.center - ghost.center))
            });
            jobs.push(Job { beam, turns: turns.clone(), corners, across: if strong { STRONG } else { WEAK }, moves });
        }
        before += on_film(&ghost);
    }
    jobs
}

/// Draws a ghost; `None` where none of it is on the film.
pub(super) fn draw(job: &Job, tracers: &[GhostTracer], film: &Film, [columns, rows]: [usize; 2], bands: usize) -> Option<Patch> {
    let cells = DVec2::new(columns as f64, rows as f64);
    let size = DVec2::new(film.width_mm, film.height_mm);
    let cell_mm2 = (size.x * size.y) / (cells.x * cells.y);
    let place = on_raster(film, [columns, rows]);
    let ways = job.moves.map(|m| (DVec2::new(-m.x, m.y) / size * cells).as_vec2());
    let margin = (0.5 * (ways[0].abs() + ways[1].abs()).max_element()).ceil() + if ways == [Vec2::ZERO; 2] { 0.0 } else { 2.0 };
    let mut patches: Vec<(usize, Region)> = vec![];
    for (bin, tracer) in tracers.iter().enumerate() {
        if job.beam.counts.iter().all(|band| band[bin] == 0.0) {
            continue;
        }
        let node = |at: DVec2| {
            let arrival = tracer.follow(job.beam.source.ray(at), &job.turns).ok()?;
            let light = arrival.fraction * job.beam.source.power_density(at);
            Some((place(arrival.film), light)).filter(|n| n.0.is_finite())
        };
        let mesh = Mesh::of(&node, job.corners, job.across);
        let Some(mut region) = mesh.bounds().and_then(|[a, b]| Region::around(a, b, [columns, rows], margin)) else { continue };
        mesh.rasterise(1.0 / cell_mm2, &mut region);
        patches.push((bin, region));
    }
    let out = assemble(patches, job.beam, bands)?;
    Some(ways.into_iter().fold(out, |patch, way| patch.smeared(way, bands)))
}

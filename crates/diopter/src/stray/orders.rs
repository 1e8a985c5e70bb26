//! Light of lamps that the microlenses of the sensor throw back in the orders of their grating, and a surface of the lens to the film again: dots in rows and columns about a lamp.
//!
//! The grating and what is assumed of it: [`diopter_lens::ghosts::Grating`]. Every order of every surface is a ghost of its own; most of them never come back to the film. Those that bring most of the light are
//! drawn, each from the short to the long end of a bin of wavelengths, along which an order moves.

use super::beams::Beam;
use super::ghosts::{AT_ONCE, LOOK, assemble, tracer};
use super::raster::{Patch, Region, lay, on_raster};
use super::{BIN_NM, BINS};
use crate::camera::Film;
use diopter_lens::System;
use diopter_lens::ghosts::{Arrival, GhostTracer, reflects};
use diopter_light::wavelength::FIRST_NM;
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// Most lamps (or cells of one) whose orders are followed: the strongest.
const MOST_BEAMS: usize = 8;
/// Weaker ones than this part of the strongest are left out.
const WEAKEST: f64 = 0.02;
/// Rays across the beam.
const ACROSS: usize = 8;
/// Part of the light of all orders that may be left out with the weakest, and most that are drawn for a lamp.
const LEFT_OUT: f64 = 0.02;
const MOST_ORDERS: usize = 256;
/// Steps along the way of an order within a bin of wavelengths, at most.
const MOST_STEPS: f32 = 48.0;

/// An order of a lamp's light by way of one surface.
struct Order<'a> {
    beam: &'a Beam,
    forth: usize,
    order: [i32; 2],
    /// Light at the sensor by end of a bin of wavelengths and ray.
    arrivals: &'a [Vec<Option<(Arrival, f64)>>],
    /// What a ray stands for on the front, mm².
    cell: DVec2,
}

/// Draws the orders of all lamps on a raster over the film; `add` takes each, with the number of its lamp, always in the same order.
pub(super) fn draw_all(
    system: &System,
    beams: &[Beam],
    film: &Film,
    size: [usize; 2],
    bands: usize,
    mut add: impl FnMut(usize, Patch),
) {
    // Ends of the bins of wavelengths.
    let end = |k: usize| FIRST_NM + BIN_NM * k as f32;
    let tracers: Vec<GhostTracer> = (0..=BINS).into_par_iter().map(|k| tracer(system, film, end(k))).collect();
    if tracers[BINS / 2].grating().is_none() {
        return;
    }
    let strongest = beams.iter().map(Beam::strength).fold(0.0, f64::max);
    let strong = beams.iter().enumerate().filter(|(_, b)| b.visible && b.strength() >= WEAKEST * strongest).take(MOST_BEAMS);
    let half = 0.5 * DVec2::new(film.width_mm, film.height_mm);
    let on_sensor = |at: DVec2| (at + DVec2::from_array(film.middle_mm)).abs().cmple(half).all();
    for (number, beam) in strong {
        let Some([low, high]) = beam.source.extent(&tracers[BINS / 2], &[], LOOK) else { continue };
        let cell = (high - low) / ACROSS as f64;
        let arrivals: Vec<Vec<Option<(Arrival, f64)>>> = tracers
            .iter()
            .map(|tracer| {
                let ray = |k: usize| {
                    let at = low + cell * DVec2::new((k % ACROSS) as f64 + 0.5, (k / ACROSS) as f64 + 0.5);
                    let arrival = tracer.follow(beam.source.ray(at), &[]).ok().filter(|a| on_sensor(a.film))?;
                    Some((arrival, beam.source.power_density(at)))
                };
                (0..ACROSS * ACROSS).map(ray).collect()
            })
            .collect();
        let orders = chosen(system, &tracers, beam, &arrivals, cell, &on_sensor);
        for some in orders.chunks(AT_ONCE) {
            let patches: Vec<Option<Patch>> = some.par_iter().map(|o| draw(o, &tracers, film, size, bands)).collect();
            patches.into_iter().flatten().for_each(|patch| add(number, patch));
        }
    }
}

/// The orders that bring light to the film, the strongest first.
fn chosen<'a>(
    system: &System,
    tracers: &[GhostTracer],
    beam: &'a Beam,
    arrivals: &'a [Vec<Option<(Arrival, f64)>>],
    cell: DVec2,
    on_sensor: &(impl Fn(DVec2) -> bool + Sync),
) -> Vec<Order<'a>> {
    // Rays that stand for the beam: a quarter in from its corners, and its middle.
    let (near, far, middle) = (ACROSS / 4, ACROSS - 1 - ACROSS / 4, ACROSS / 2);
    let some = [[near, near], [far, near], [near, far], [far, far], [middle, middle]].map(|[x, y]| y * ACROSS + x);
    let ends = [0, BINS / 2, BINS];
    let light = |forth: usize, order: [i32; 2]| -> f64 {
        let each = ends.iter().flat_map(|end| some.iter().map(move |ray| (*end, *ray)));
        let one = |(end, ray): (usize, usize)| {
            let (arrival, power) = arrivals[end][ray].as_ref()?;
            let back = tracers[end].follow_back(arrival, order, &[forth]).ok().filter(|b| on_sensor(b.film))?;
            Some(back.fraction * power)
        };
        each.filter_map(one).sum()
    };
    let highest = tracers.iter().filter_map(GhostTracer::grating).fold([0; 2], |most, grating| {
        let here = grating.highest();
        [most[0].max(here[0]), most[1].max(here[1])]
    });
    let forths: Vec<usize> = (0..system.surfaces.len()).filter(|i| reflects(system, *i)).collect();
    let orders: Vec<[i32; 2]> = (-highest[1]..=highest[1])
        .flat_map(|j| (-highest[0]..=highest[0]).map(move |i| [i, j]))
        .filter(|order| *order != [0; 2])
        .collect();
    let mut found: Vec<(f64, Order)> = orders
        .par_iter()
        .flat_map_iter(|order| {
            let of = |forth: &usize| (light(*forth, *order), Order { beam, forth: *forth, order: *order, arrivals, cell });
            forths.iter().map(of).filter(|o| o.0 > 0.0).collect::<Vec<_>>()
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let all: f64 = found.iter().map(|f| f.0).sum();
    let mut before = 0.0;
    let needed = found.iter().take_while(|f| {
        before += f.0;
        before - f.0 < (1.0 - LEFT_OUT) * all
    });
    let count = needed.count().min(MOST_ORDERS);
    found.truncate(count);
    found.into_iter().map(|f| f.1).collect()
}

/// Draws an order; `None` where none of it is on the film.
fn draw(o: &Order, tracers: &[GhostTracer], film: &Film, size: [usize; 2], bands: usize) -> Option<Patch> {
    let place = on_raster(film, size);
    let nodes: Vec<Vec<Option<(Vec2, f64)>>> = tracers
        .iter()
        .zip(o.arrivals)
        .map(|(tracer, arrivals)| {
            let back = |a: &Option<(Arrival, f64)>| {
                let (arrival, power) = a.as_ref()?;
                let back = tracer.follow_back(arrival, o.order, &[o.forth]).ok()?;
                Some((place(back.film), back.fraction * power)).filter(|n| n.0.is_finite())
            };
            arrivals.iter().map(back).collect()
        })
        .collect();
    let cell_mm2 = film.width_mm * film.height_mm / (size[0] * size[1]) as f64;
    let front = o.cell.x * o.cell.y / cell_mm2;
    let mut patches: Vec<(usize, Region)> = vec![];
    for (bin, ends) in nodes.windows(2).enumerate() {
        if o.beam.counts.iter().all(|band| band[bin] == 0.0) {
            continue;
        }
        let both: Vec<Option<[(Vec2, f64); 2]>> = ends[0].iter().zip(&ends[1]).map(|(a, b)| Some([(*a)?, (*b)?])).collect();
        let places = both.iter().flatten().flatten().map(|n| n.0);
        let (least, most) = places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let Some(mut region) = Region::around(least, most, size, 0.0) else { continue };
        let first = both.iter().flatten().map(|n| n[0].0);
        let (a, b) = first.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let way = both.iter().flatten().map(|n| n[0].0.distance(n[1].0)).fold(0.0, f32::max);
        let dot = (0.5 * (b - a).max_element()).max(1.0);
        let steps = (way / dot).ceil().clamp(1.0, MOST_STEPS);
        for k in 0..steps as usize {
            let t = (k as f32 + 0.5) / steps;
            let here: Vec<Option<(Vec2, f64)>> = both
                .iter()
                .map(|n| n.map(|[a, b]| (a.0.lerp(b.0, t), (a.1 + (b.1 - a.1) * f64::from(t)) / f64::from(steps))))
                .collect();
            lay(&here, ACROSS, front, &mut region);
        }
        patches.push((bin, region));
    }
    assemble(patches, o.beam, bands)
}

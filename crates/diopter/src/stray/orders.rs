//! Light of lamps that the microlenses of the sensor throw back in the orders of their grating, and a surface of the lens to the film again: dots in rows and columns about a lamp.
//!
//! The grating and what is assumed of it: [`diopter_lens::ghosts::Grating`]. Every order of every surface is a ghost of its own; most of them never come back to the film. Those that bring most of the light are
//! drawn, with the light of those that are left out, each from the short to the long end of a bin of wavelengths, along which an order moves, and smeared as far as its lamp is wide.

use super::beams::Beam;
use super::raster::{Patch, Region, on_raster, rasterise};
use super::tracing::{AT_ONCE, LOOK, assemble, tracer};
use super::{BIN_NM, BINS};
use crate::camera::Film;
use diopter_lens::System;
use diopter_lens::ghosts::{AtSensor, FilmHit, GhostTracer, reflects};
use diopter_light::wavelength::FIRST_NM;
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// Most lamps (beams whose images do not lie together) whose orders are followed: the strongest, and none weaker than this part of the strongest.
const MOST_LAMPS: usize = 12;
const WEAKEST: f64 = 0.02;
/// Images of beams nearer to one another are those of one lamp, mm.
const TOGETHER_MM: f64 = 0.25;
/// Rays across the beam.
const ACROSS: usize = 8;
/// Part of the light of all orders that the weakest may have that are not drawn, and most that are drawn for a lamp.
const LEFT_OUT: f64 = 0.02;
const MOST_ORDERS: usize = 256;
/// Steps along the way of an order within a bin of wavelengths, at most.
const MOST_STEPS: f32 = 48.0;

/// Light of a lamp at the sensor.
struct Lamp<'a> {
    /// The strongest of its beams.
    beam: &'a Beam,
    /// Number of that.
    number: usize,
    /// Of all its beams together over those of the strongest.
    strength: f64,
    /// By end of a bin of wavelengths.
    light: Vec<AtSensor>,
    /// From the edges of its cell, at the middle wavelength.
    edges: [Option<AtSensor>; 2],
}

/// An order of a lamp's light by way of one surface.
struct Order<'a> {
    lamp: &'a Lamp<'a>,
    forth: usize,
    order: [i32; 2],
    /// What its light is multiplied by.
    scale: f64,
}

/// Rays that stand for a beam: a quarter in from its corners, and its middle.
fn some_rays() -> [usize; 5] {
    let (near, far, middle) = (ACROSS / 4, ACROSS - 1 - ACROSS / 4, ACROSS / 2);
    [[near, near], [far, near], [near, far], [far, far], [middle, middle]].map(|[x, y]| y * ACROSS + x)
}

/// Draws the orders of all lamps on a raster over the film; `add` takes each, with the number of the beam that it is of, always in the same order.
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
    if beams.is_empty() || tracer(system, film, end(0)).grating().is_none() {
        return;
    }
    let tracers: Vec<GhostTracer> = (0..=BINS).into_par_iter().map(|k| tracer(system, film, end(k))).collect();
    for lamp in &lamps(beams, &tracers, film) {
        for some in chosen(system, &tracers, lamp, film).chunks(AT_ONCE) {
            let patches: Vec<Option<Patch>> = some.par_iter().map(|o| draw(o, &tracers, film, size, bands)).collect();
            patches.into_iter().flatten().for_each(|patch| add(lamp.number, patch));
        }
    }
}

/// Whether a film point lies on the sensor.
fn on_sensor(film: &Film, at: DVec2) -> bool {
    let half = 0.5 * DVec2::new(film.width_mm, film.height_mm);
    (at + DVec2::from_array(film.center_mm)).abs().cmple(half).all()
}

/// The lamps whose image lies on the sensor, the strongest first.
fn lamps<'a>(beams: &'a [Beam], tracers: &[GhostTracer], film: &Film) -> Vec<Lamp<'a>> {
    let middle = &tracers[BINS / 2];
    let images: Vec<Option<([DVec2; 2], DVec2)>> = beams
        .par_iter()
        .map(|beam| {
            let corners = beam.source.extent(middle, &[], LOOK)?;
            let light = AtSensor::within(middle, &beam.source, corners, ACROSS);
            let places: Vec<DVec2> = light.rays.iter().flatten().map(|r| r.0.film).collect();
            let center = places.iter().sum::<DVec2>() / places.len().max(1) as f64;
            (!places.is_empty() && on_sensor(film, center)).then_some((corners, center))
        })
        .collect();
    // Beams come strongest first.
    let mut found: Vec<(usize, [DVec2; 2], DVec2, f64)> = vec![];
    for (number, (beam, image)) in beams.iter().zip(&images).enumerate() {
        let Some((corners, center)) = image else { continue };
        let near = found
            .iter_mut()
            .find(|(first, _, of, _)| of.distance(*center) < TOGETHER_MM && beams[*first].modulation == beam.modulation);
        match near {
            Some(lamp) => lamp.3 += beam.strength(),
            None => found.push((number, *corners, *center, beam.strength())),
        }
    }
    found.sort_by(|a, b| b.3.total_cmp(&a.3));
    let strongest = found.first().map_or(0.0, |f| f.3);
    found.retain(|f| f.3 >= WEAKEST * strongest);
    found.truncate(MOST_LAMPS);
    let lamp = |(number, corners, _, strength): (usize, [DVec2; 2], DVec2, f64)| {
        let beam = &beams[number];
        let light = tracers.iter().map(|t| on_film(AtSensor::within(t, &beam.source, corners, ACROSS), film)).collect();
        let edge = |k: usize| {
            let edge = beam.edges[k].as_ref()?;
            Some(AtSensor::within(middle, edge, edge.extent(middle, &[], LOOK)?, ACROSS))
        };
        Lamp { beam, number, strength: strength / beam.strength(), light, edges: [edge(0), edge(1)] }
    };
    found.into_par_iter().map(lamp).collect()
}

/// Only what falls on the sensor.
fn on_film(mut light: AtSensor, film: &Film) -> AtSensor {
    light.rays.iter_mut().for_each(|r| *r = r.filter(|r| on_sensor(film, r.0.film)));
    light
}

/// The orders that bring light to the film, the strongest first, with what is left out shared among them.
fn chosen<'a>(system: &System, tracers: &[GhostTracer], lamp: &'a Lamp<'a>, film: &Film) -> Vec<Order<'a>> {
    let some = some_rays();
    // How much of the lamp's light lies about an end of a bin: up to three ends stand for all.
    let of_bin = |bin: usize| lamp.beam.counts.iter().map(|band| band[bin].abs()).sum::<f64>();
    let weight = |end: usize| if end > 0 { of_bin(end - 1) } else { 0.0 } + if end < BINS { of_bin(end) } else { 0.0 };
    let lit: Vec<usize> = (0..=BINS).filter(|end| weight(*end) > 0.0).collect();
    let Some((&first, &last)) = lit.first().zip(lit.last()) else { return vec![] };
    let mut ends = vec![first, lit[lit.len() / 2], last];
    ends.dedup();
    let light = |forth: usize, order: [i32; 2]| -> f64 {
        let each = ends.iter().flat_map(|end| some.iter().map(move |ray| (*end, *ray)));
        let one = |(end, ray): (usize, usize)| {
            let (arrival, power) = lamp.light[end].rays[ray].as_ref()?;
            let back = tracers[end].follow_back(arrival, order, &[forth]).ok().filter(|b| on_sensor(film, b.film))?;
            Some(back.fraction * power * weight(end))
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
            let of = |forth: &usize| (light(*forth, *order), Order { lamp, forth: *forth, order: *order, scale: lamp.strength });
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
    let kept: f64 = found.iter().map(|f| f.0).sum();
    found.into_iter().map(|(_, order)| Order { scale: order.scale * all / kept, ..order }).collect()
}

/// Draws an order; `None` where none of it is on the film.
fn draw(o: &Order, tracers: &[GhostTracer], film: &Film, size: [usize; 2], bands: usize) -> Option<Patch> {
    let place = on_raster(film, size);
    let back = |tracer: &GhostTracer, ray: &Option<(FilmHit, f64)>| {
        let (arrival, power) = ray.as_ref()?;
        let back = tracer.follow_back(arrival, o.order, &[o.forth]).ok()?;
        Some((place(back.film), back.fraction * power * o.scale)).filter(|n| n.0.is_finite())
    };
    let nodes: Vec<Vec<Option<(Vec2, f64)>>> = tracers
        .iter()
        .zip(&o.lamp.light)
        .map(|(tracer, light)| light.rays.iter().map(|ray| back(tracer, ray)).collect())
        .collect();
    // As the source crosses its cell the order moves twice as far as from the middle to an edge.
    let middle = &tracers[BINS / 2];
    let center = |light: &AtSensor| {
        let places: Vec<Vec2> = some_rays().iter().filter_map(|ray| back(middle, &light.rays[*ray])).map(|n| n.0).collect();
        (places.len() == some_rays().len()).then(|| places.iter().sum::<Vec2>() / places.len() as f32)
    };
    let moved = |edge: &Option<AtSensor>| Some(2.0 * (center(edge.as_ref()?)? - center(&o.lamp.light[BINS / 2])?));
    let ways = [0, 1].map(|k| moved(&o.lamp.edges[k]).unwrap_or(Vec2::ZERO));
    let cell_mm2 = film.width_mm * film.height_mm / (size[0] * size[1]) as f64;
    let margin = (0.5 * (ways[0].abs() + ways[1].abs()).max_element()).ceil() + if ways == [Vec2::ZERO; 2] { 0.0 } else { 2.0 };
    let mut patches: Vec<(usize, Region)> = vec![];
    for (bin, ends) in nodes.windows(2).enumerate() {
        if o.lamp.beam.counts.iter().all(|band| band[bin] == 0.0) {
            continue;
        }
        let both: Vec<Option<[(Vec2, f64); 2]>> = ends[0].iter().zip(&ends[1]).map(|(a, b)| Some([(*a)?, (*b)?])).collect();
        let places = both.iter().flatten().flatten().map(|n| n.0);
        let (least, most) = places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let Some(mut region) = Region::around(least, most, size, margin) else { continue };
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
            rasterise(&here, ACROSS, o.lamp.light[bin].cell_mm2 / cell_mm2, &mut region);
        }
        patches.push((bin, region));
    }
    let out = assemble(patches, o.lamp.beam, bands)?;
    Some(ways.into_iter().fold(out, |patch, way| patch.smeared(way, bands)))
}

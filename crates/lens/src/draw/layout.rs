//! The lens in section, with bundles of rays from several fields.

use super::figure::{Anchor, FIELD_COLORS, Figure, INK, Item};
use crate::analysis::Bench;
use crate::glass::Glass;
use crate::ray::{Apertures, TraceDirection};
use crate::system::System;
use crate::trace::at_plane;
use glam::{DVec2, DVec3};

/// Height of the drawing itself, at most, points.
const MOST_HEIGHT: f64 = 1200.0;

/// What is drawn.
#[derive(Clone, Debug)]
pub struct LayoutOptions {
    /// Above the drawing.
    pub title: String,
    /// Field angles, degrees.
    pub fields_deg: Vec<f64>,
    /// Wavelength of the rays, nm.
    pub nm: f64,
    /// Rays a field.
    pub rays: usize,
    /// Width of the sheet, points.
    pub width: f64,
}

/// Draws the lens in the y–z plane, light from the left. Clipped rays are not drawn.
pub fn layout(bench: &Bench, options: &LayoutOptions) -> Figure {
    let system = bench.system;
    let n = system.indices(options.nm);
    let flat = |p: DVec3| DVec2::new(p.z, p.y);
    // Rays first: they decide how much room there must be.
    let mut bundles: Vec<(usize, Vec<DVec2>)> = vec![];
    let length = (system.film_z - 0.0).abs().max(1.0);
    for (k, field) in options.fields_deg.iter().enumerate() {
        let Some(beam) = bench.beam(*field, options.nm) else { continue };
        let [low, high] = beam.extent;
        for i in 0..options.rays {
            let s = if options.rays > 1 { i as f64 / (options.rays - 1) as f64 } else { 0.5 };
            let at = DVec2::new(0.0, low.y + (high.y - low.y) * (0.03 + 0.94 * s));
            let start = beam.ray(at);
            let mut points = vec![];
            let out = system.trace_with(start, &n, TraceDirection::ToFilm, Apertures::Clip, |e| points.push(flat(e.point)));
            let Ok(out) = out else { continue };
            // A little of the way before the lens.
            if let Some(first) = points.first().copied() {
                let d = flat(system.ray_from_object(start).direction);
                points.insert(0, first - d * (0.22 * length).min(1e4));
            }
            points.push(flat(at_plane(&out, system.film_z)));
            bundles.push((k, points));
        }
    }
    let mut outlines = vec![];
    let (mut low, mut high) = (DVec2::new(0.0, 0.0), DVec2::new(system.film_z, 0.0));
    let mut include = |p: DVec2| {
        low = low.min(p);
        high = high.max(p);
    };
    for (i, s) in system.surfaces.iter().enumerate() {
        let curve = section(system, i);
        curve.iter().for_each(|p| include(*p));
        outlines.push((s.obstruction, curve));
    }
    for (_, b) in &bundles {
        b.iter().for_each(|p| include(*p));
    }
    let pad = 0.03 * (high.x - low.x);
    (low, high) = (low - pad, high + pad);
    let scale = (options.width / (high.x - low.x)).min(MOST_HEIGHT / (high.y - low.y));
    let height = ((high.y - low.y) * scale).max(60.0);
    let left = 0.5 * (options.width - (high.x - low.x) * scale);
    let mut figure = Figure::new(options.width, height + 60.0);
    let map = |p: DVec2| DVec2::new(left + (p.x - low.x) * scale, 28.0 + (high.y - p.y) * scale);

    // Glass between two surfaces.
    for i in 0..system.surfaces.len() - 1 {
        if system.glasses[i + 1] == Glass::air() {
            continue;
        }
        let (front, back) = (&outlines[i].1, &outlines[i + 1].1);
        let mut outline: Vec<DVec2> = front.iter().map(|p| map(*p)).collect();
        // Rims of different height are joined by a step, as such elements are edged.
        outline.extend(back.iter().rev().map(|p| map(*p)));
        outline.push(outline[0]);
        let fill = Some(([205, 224, 240], 0.75));
        figure.items.push(Item::Path { points: outline, color: INK, width: 0.6, dash: 0.0, fill });
    }
    for (i, s) in system.surfaces.iter().enumerate() {
        let curve = outlines[i].1.iter().map(|p| map(*p));
        if s.obstruction > 0.0 && system.glasses[i] == system.glasses[i + 1] && !s.mirror {
            // A disk in the way.
            let bar = [DVec2::new(s.z, -s.obstruction), DVec2::new(s.z, s.obstruction)];
            figure.line(bar.map(map), INK, 2.6, 0.0);
        } else if s.mirror {
            figure.line(curve, [110, 110, 110], 2.4, 0.0);
        } else if i != system.stop || system.glasses[i] != system.glasses[i + 1] {
            figure.line(curve, INK, 0.8, 0.0);
        }
        if i == system.stop {
            // Two bars beside the opening.
            let radius = system.iris.radius;
            let reach = if s.mirror { radius } else { s.semi_diameter.max(radius) } + 0.04 * (high.y - low.y);
            for sign in [1.0, -1.0] {
                let end = |y: f64| flat(s.to_lens(DVec3::new(0.0, sign * y, 0.0), DVec3::Z).0);
                figure.line([end(radius), end(reach)].map(map), INK, 2.6, 0.0);
            }
        }
    }
    figure.line([DVec2::new(low.x, 0.0), DVec2::new(high.x, 0.0)].map(map), [150, 150, 150], 0.5, 6.0);
    let lands = bundles.iter().filter_map(|b| b.1.last()).map(|p| p.y);
    let least = 0.02 * (high.y - low.y);
    let film = lands.fold([-least, least], |[a, b], y| [a.min(1.05 * y), b.max(1.05 * y)]);
    figure.line(film.map(|y| map(DVec2::new(system.film_z, y))), INK, 1.6, 0.0);
    for (k, points) in &bundles {
        figure.line(points.iter().map(|p| map(*p)), FIELD_COLORS[k % FIELD_COLORS.len()], 0.6, 0.0);
    }
    figure.text(DVec2::new(options.width / 2.0, 17.0), options.title.clone(), 11.0, Anchor::Middle);
    // Scale and legend.
    let bar = super::chart::tick_step((high.x - low.x) * 1.2);
    let y = height + 44.0;
    figure.line([DVec2::new(20.0, y), DVec2::new(20.0 + bar * scale, y)], INK, 1.5, 0.0);
    figure.text(DVec2::new(20.0, y - 5.0), format!("{bar} mm"), 9.0, Anchor::Start);
    let mut x = options.width - 20.0;
    for (k, field) in options.fields_deg.iter().enumerate().rev() {
        let text = format!("{field:.1}°");
        figure.text(DVec2::new(x, y), text.clone(), 9.0, Anchor::End);
        x -= 6.0 * text.chars().count() as f64 + 4.0;
        figure.line([DVec2::new(x - 14.0, y - 3.0), DVec2::new(x, y - 3.0)], FIELD_COLORS[k % FIELD_COLORS.len()], 1.5, 0.0);
        x -= 22.0;
    }
    figure
}

/// A surface in the y–z plane, from its lower rim to its upper (z, y).
fn section(system: &System, i: usize) -> Vec<DVec2> {
    let s = &system.surfaces[i];
    let rim = DVec2::splat(system.iris.radius);
    let [low, high] = if s.semi_diameter < 1e6 { s.bounds() } else { [-rim, rim] };
    let x = 0f64.clamp(low.x.min(high.x), high.x);
    (-32..=32)
        .filter_map(|k| {
            let y = 0.5 * (low.y + high.y) + 0.5 * (high.y - low.y) * k as f64 / 32.0 * (1.0 - 1e-9);
            let z = s.profile.sag(x, y)?;
            let p = s.to_lens(DVec3::new(x, y, z), DVec3::Z).0;
            Some(DVec2::new(p.z, p.y))
        })
        .collect()
}

//! Ghosts of a source on the film, and how strong they are.

use super::chart::{Axis, Chart, Line, Style};
use super::figure::{Anchor, Color, Figure};
use glam::DVec2;

/// Ghosts that have a name in the chart.
const NAMED: usize = 8;
const COLORS: [Color; NAMED] = [
    [214, 39, 40],
    [31, 119, 180],
    [44, 160, 44],
    [148, 103, 189],
    [255, 127, 14],
    [140, 86, 75],
    [23, 150, 170],
    [200, 60, 160],
];
const OTHERS: Color = [170, 170, 170];

/// A ghost as the chart shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnGhost {
    /// "9-4".
    pub name: String,
    /// Centroid on the film, mm.
    pub center: DVec2,
    /// Second moments about it: xx, xy, yy, mm².
    pub moments: [f64; 3],
    /// Irradiance on the film over that of the source at the front.
    pub irradiance: f64,
}

/// Outlines on the film (the evenly lit ellipses of the same moments), and irradiance over size; the strongest first. `source`: where the direct
/// image lies; `film_radius_mm`: half the picture's diagonal.
pub fn ghost_plot(title: &str, ghosts: &[DrawnGhost], source: Option<DVec2>, film_radius_mm: f64) -> Figure {
    let cell = DVec2::new(400.0, 400.0);
    let mut figure = Figure::new(2.0 * cell.x, 24.0 + cell.y);
    figure.text(DVec2::new(8.0, 16.0), title, 11.0, Anchor::Start);
    let circle = |center: DVec2, x: DVec2, y: DVec2| -> Vec<DVec2> {
        (0..=64).map(|i| DVec2::from_angle(i as f64 * std::f64::consts::TAU / 64.0)).map(|a| center + x * a.x + y * a.y).collect()
    };
    let name = |i: usize, g: &DrawnGhost| if i < NAMED { g.name.clone() } else { String::new() };
    let color = |i: usize| COLORS.get(i).copied().unwrap_or(OTHERS);
    let mut outlines = vec![Line {
        name: String::new(),
        color: [0, 0, 0],
        style: Style::Broken,
        points: circle(DVec2::ZERO, DVec2::X * film_radius_mm, DVec2::Y * film_radius_mm),
    }];
    // The strongest on top.
    for (i, g) in ghosts.iter().enumerate().rev() {
        // Half axes of the ellipse: twice the Cholesky factor of the moments.
        let [xx, xy, yy] = g.moments;
        let a = xx.max(1e-12).sqrt();
        let (x, y) = (DVec2::new(2.0 * a, 2.0 * xy / a), DVec2::new(0.0, 2.0 * (yy - xy * xy / (a * a)).max(0.0).sqrt()));
        outlines.push(Line { name: name(i, g), color: color(i), style: Style::Full, points: circle(g.center, x, y) });
    }
    if let Some(at) = source {
        let r = 0.012 * film_radius_mm;
        let points = circle(at, DVec2::X * r, DVec2::Y * r);
        outlines.push(Line { name: "source".into(), color: [0, 0, 0], style: Style::Full, points });
    }
    let reach = 1.3 * film_radius_mm;
    let axis = |label: &str| Axis { label: label.into(), range: [-reach, reach] };
    Chart { title: "on the film".into(), x: axis("x, mm"), y: axis("y, mm"), lines: outlines }.draw(
        &mut figure,
        DVec2::new(0.0, 24.0),
        cell,
    );
    let place = |g: &DrawnGhost| {
        let rms = (g.moments[0] + g.moments[2]).sqrt();
        DVec2::new(rms.max(1e-4).log10(), g.irradiance.max(1e-30).log10())
    };
    let x = Axis::around("log10 of the rms radius, mm", ghosts.iter().map(|g| place(g).x), false);
    let y = Axis::around("log10 of the irradiance over the source's", ghosts.iter().map(|g| place(g).y), false);
    let mark = DVec2::new(0.006 * (x.range[1] - x.range[0]), 0.006 * (y.range[1] - y.range[0]));
    let marks = ghosts
        .iter()
        .enumerate()
        .rev()
        .map(|(i, g)| {
            let points = circle(place(g), DVec2::X * mark.x, DVec2::Y * mark.y);
            Line { name: name(i, g), color: color(i), style: Style::Full, points }
        })
        .collect();
    Chart { title: "strength".into(), x, y, lines: marks }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
    figure
}

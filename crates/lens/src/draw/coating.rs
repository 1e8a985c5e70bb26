//! Reflectance of coatings over wavelength.

use super::chart::{Axis, Chart, Line, Style};
use super::figure::{Anchor, Color, Figure};
use glam::DVec2;

const COLORS: [Color; 6] = [[31, 119, 180], [214, 39, 40], [44, 160, 44], [148, 103, 189], [255, 127, 14], [90, 90, 90]];

/// Reflectance at one angle of incidence.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectanceCurve {
    /// Surface, numbered from 1.
    pub surface: usize,
    /// Angle in air (between two glasses: in the thinner), degrees.
    pub angle_deg: f64,
    /// Wavelength (nm) and reflectance, s.
    pub s: Vec<DVec2>,
    /// The same of p.
    pub p: Vec<DVec2>,
}

/// One chart for each surface: s full, p broken.
pub fn coating_plot(title: &str, curves: &[ReflectanceCurve]) -> Figure {
    let mut surfaces: Vec<usize> = curves.iter().map(|c| c.surface).collect();
    surfaces.dedup();
    let columns = surfaces.len().clamp(1, 3);
    let cell = DVec2::new(330.0, 260.0);
    let rows = surfaces.len().div_ceil(columns);
    let mut figure = Figure::new(cell.x * columns as f64, 24.0 + cell.y * rows as f64);
    figure.text(DVec2::new(8.0, 16.0), title, 11.0, Anchor::Start);
    for (i, surface) in surfaces.iter().enumerate() {
        let of: Vec<&ReflectanceCurve> = curves.iter().filter(|c| c.surface == *surface).collect();
        let percent = |points: &[DVec2]| points.iter().map(|p| DVec2::new(p.x, 100.0 * p.y)).collect::<Vec<_>>();
        let lines: Vec<Line> = of
            .iter()
            .enumerate()
            .flat_map(|(k, c)| {
                let color = COLORS[k % COLORS.len()];
                let name = format!("{}°", c.angle_deg);
                // At normal incidence s and p are the same.
                let p = (c.angle_deg != 0.0).then(|| Line {
                    name: String::new(),
                    color,
                    style: Style::Broken,
                    points: percent(&c.p),
                });
                [Some(Line { name, color, style: Style::Full, points: percent(&c.s) }), p].into_iter().flatten()
            })
            .collect();
        let reach = of.iter().flat_map(|c| &c.s).fold([f64::MAX, f64::MIN], |[a, b], p| [a.min(p.x), b.max(p.x)]);
        let y = Axis::around("reflectance, % (s full, p broken)", lines.iter().flat_map(|l| l.points.iter().map(|p| p.y)), true);
        let x = Axis { label: "wavelength, nm".into(), range: reach };
        let at = DVec2::new((i % columns) as f64 * cell.x, 24.0 + (i / columns) as f64 * cell.y);
        Chart { title: format!("surface {surface}"), x, y, lines }.draw(&mut figure, at, cell);
    }
    figure
}

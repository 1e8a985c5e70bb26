//! Curves of the image of a point, and their plot.

use crate::draw::{Axis, Chart, FIELD_COLORS, Figure, Line, Style};
use glam::DVec2;

/// What is plotted of the image of a point, in µm from the chief ray (of the energy: from the centroid).
#[derive(Clone, Debug, PartialEq)]
pub struct PointImageCurves {
    /// For the legend.
    pub name: String,
    /// Radius, fraction of the light within.
    pub energy: Vec<DVec2>,
    /// Place, line spread of its largest; tangential, sagittal.
    pub line: [Vec<DVec2>; 2],
    /// Place, light of an edge; tangential, sagittal.
    pub edge: [Vec<DVec2>; 2],
}

impl PointImageCurves {
    /// Encircled energy, line and edge spread: a colour an image, tangential full, sagittal broken.
    pub fn plot(title: &str, images: &[PointImageCurves]) -> Figure {
        let cell = DVec2::new(330.0, 280.0);
        let mut figure = Figure::sheet(title, 3, 1, cell);
        let color = |i: usize| FIELD_COLORS[i % FIELD_COLORS.len()];
        let one = |label: &str| Axis { label: label.into(), range: [0.0, 1.05] };
        let energy: Vec<Line> =
            images.iter().enumerate().map(|(i, c)| Line::new(c.name.clone(), color(i), Style::Full, c.energy.clone())).collect();
        let x = Axis::around("radius, µm", energy.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
        Chart { title: "encircled energy".into(), x, y: one("fraction of the light"), lines: energy }.draw(
            &mut figure,
            DVec2::new(0.0, 24.0),
            cell,
        );
        let spread = |curves: &dyn Fn(&PointImageCurves) -> &[Vec<DVec2>; 2]| {
            let both = |(i, c): (usize, &PointImageCurves)| {
                let [tangential, sagittal] = curves(c).clone();
                [
                    Line::new(c.name.clone(), color(i), Style::Full, tangential),
                    Line::new(String::new(), color(i), Style::Broken, sagittal),
                ]
            };
            images.iter().enumerate().flat_map(both).collect::<Vec<_>>()
        };
        let charts = [
            ("line spread (full: tangential)", "of its largest", spread(&|c| &c.line)),
            ("edge spread (full: tangential)", "fraction of the light", spread(&|c| &c.edge)),
        ];
        for (i, (title, label, lines)) in charts.into_iter().enumerate() {
            let x = Axis::around("from the chief ray, µm", lines.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
            let at = DVec2::new(cell.x * (i + 1) as f64, 24.0);
            Chart { title: title.into(), x, y: one(label), lines }.draw(&mut figure, at, cell);
        }
        figure
    }
}

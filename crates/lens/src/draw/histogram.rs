//! Distributions of quantities over many lenses.

use super::chart::{Axis, Chart, Line, Style};
use super::figure::{Anchor, Color, Figure};
use glam::DVec2;

/// Colour of the bars.
const BARS: Color = [40, 80, 200];
/// Colour of the design's value.
const DESIGN: Color = [40, 150, 40];
/// Colour of limits.
const LIMIT: Color = [200, 40, 40];
/// Charts side by side.
const COLUMNS: usize = 3;

/// Values of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Distributed {
    /// Quantity and unit.
    pub label: String,
    /// One a lens; what is not a number is left out.
    pub values: Vec<f64>,
    /// That of the design.
    pub nominal: f64,
    /// What is asked.
    pub limits: Vec<f64>,
}

/// Histograms, three in a row: bars, the design's value and (broken) the limits.
pub fn distribution_plot(title: &str, quantities: &[Distributed]) -> Figure {
    let cell = DVec2::new(270.0, 190.0);
    let (columns, rows) = (quantities.len().clamp(1, COLUMNS), quantities.len().div_ceil(COLUMNS).max(1));
    let mut figure = Figure::new(cell.x * columns as f64, cell.y * rows as f64 + 24.0);
    figure.text(DVec2::new(figure.width / 2.0, 16.0), title, 11.0, Anchor::Middle);
    for (i, q) in quantities.iter().enumerate() {
        let place = DVec2::new(cell.x * (i % COLUMNS) as f64, 24.0 + cell.y * (i / COLUMNS) as f64);
        histogram(q).draw(&mut figure, place, cell);
    }
    figure
}

fn histogram(q: &Distributed) -> Chart {
    let mut values: Vec<f64> = q.values.iter().copied().filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let count = values.len();
    let at = |fraction: f64| values.get((fraction * count.saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0);
    // Freedman & Diaconis 1981: bins of 2 IQR / ∛n.
    let (low, high) = (at(0.0), at(1.0));
    let width = 2.0 * (at(0.75) - at(0.25)) / (count.max(1) as f64).cbrt();
    let bins = if width > 0.0 { (((high - low) / width).ceil() as usize).clamp(1, 60) } else { 1 };
    let width = if high > low { (high - low) / bins as f64 } else { 1.0 };
    let mut heights = vec![0.0f64; bins];
    for v in &values {
        heights[(((v - low) / width) as usize).min(bins - 1)] += 1.0;
    }
    let mut bars = vec![DVec2::new(low, 0.0)];
    for (i, h) in heights.iter().enumerate() {
        let left = low + width * i as f64;
        bars.extend([DVec2::new(left, *h), DVec2::new(left + width, *h)]);
    }
    bars.push(DVec2::new(low + width * bins as f64, 0.0));
    let top = heights.iter().copied().fold(1.0, f64::max);
    let upright = |name: &str, color: Color, style: Style, x: f64| Line {
        name: name.into(),
        color,
        style,
        points: vec![DVec2::new(x, 0.0), DVec2::new(x, top)],
    };
    let mut lines = vec![Line { name: String::new(), color: BARS, style: Style::Full, points: bars }];
    lines.push(upright("design", DESIGN, Style::Full, q.nominal));
    lines.extend(q.limits.iter().map(|l| upright("limit", LIMIT, Style::Broken, *l)));
    let ends = [low, low + width * bins as f64, q.nominal].into_iter().chain(q.limits.iter().copied());
    Chart { title: q.label.clone(), x: Axis::around("", ends, false), y: Axis::around("builds", [top], true), lines }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_count_every_value_once() {
        let values: Vec<f64> = (0..100).map(|i| (i * i) as f64).chain([f64::NAN]).collect();
        let chart = histogram(&Distributed { label: "x".into(), values, nominal: 0.0, limits: vec![4000.0] });
        // Two points a bar, between the two ends.
        let bars = &chart.lines[0].points;
        let counted: f64 = bars[1..bars.len() - 1].chunks(2).map(|p| p[0].y).sum();
        assert_eq!(counted, 100.0);
        assert_eq!(chart.lines.len(), 3);
        // One value, or none, is drawn as well.
        for values in [vec![], vec![1.0; 5]] {
            let figure = distribution_plot("t", &[Distributed { label: "x".into(), values, nominal: 1.0, limits: vec![] }]);
            assert!(figure.to_svg().contains("design"));
        }
    }
}

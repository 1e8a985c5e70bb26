//! Line charts with axes that name their quantity and unit.

use super::figure::{Anchor, Color, Figure, GRID, INK, Item};
use glam::DVec2;

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity and unit: "image height, mm".
    pub label: String,
    /// Ends.
    pub range: [f64; 2],
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Unbroken.
    Full,
    /// Dashes.
    Broken,
    /// A dot at every point.
    Dots,
}

/// A line of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// For the legend; empty for none.
    pub name: String,
    /// Colour.
    pub color: Color,
    /// Style.
    pub style: Style,
    /// In axis units.
    pub points: Vec<DVec2>,
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Horizontal.
    pub x: Axis,
    /// Vertical.
    pub y: Axis,
    /// What is drawn.
    pub lines: Vec<Line>,
}

impl Line {
    pub(crate) fn new(name: String, color: Color, style: Style, points: Vec<DVec2>) -> Self {
        Line { name, color, style, points }
    }
}

impl Axis {
    /// With ends that hold all values, zero included if `zero`, rounded outwards.
    pub fn around(label: impl Into<String>, values: impl IntoIterator<Item = f64>, zero: bool) -> Self {
        let (mut low, mut high) = if zero { (0.0, 0.0) } else { (f64::INFINITY, f64::NEG_INFINITY) };
        for v in values.into_iter().filter(|v| v.is_finite()) {
            (low, high) = (f64::min(low, v), f64::max(high, v));
        }
        if !(high > low) {
            let middle = if low.is_finite() { low } else { 0.0 };
            (low, high) = (middle - 1.0, middle + 1.0);
        }
        let step = tick_step(high - low);
        Axis { label: label.into(), range: [(low / step - 1e-6).floor() * step, (high / step + 1e-6).ceil() * step] }
    }
}

/// 1, 2 or 5 times a power of ten that gives four to nine steps.
pub(super) fn tick_step(span: f64) -> f64 {
    let rough = span / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let m = rough / power;
    power
        * if m < 1.5 {
            1.0
        } else if m < 3.5 {
            2.0
        } else if m < 7.5 {
            5.0
        } else {
            10.0
        }
}

fn number(v: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let v = if v.abs() < 1e-9 * step { 0.0 } else { v };
    if !(1e-5..1e5).contains(&step) { format!("{v:.1e}") } else { format!("{v:.decimals$}") }
}

impl Chart {
    /// Draws into a rectangle of a figure: upper left corner and size, points.
    pub fn draw(&self, figure: &mut Figure, at: DVec2, size: DVec2) {
        let (left, top) = (at.x + 52.0, at.y + 24.0);
        let (right, bottom) = (at.x + size.x - 12.0, at.y + size.y - 36.0);
        let map = |p: DVec2| {
            let u = (p.x - self.x.range[0]) / (self.x.range[1] - self.x.range[0]);
            let v = (p.y - self.y.range[0]) / (self.y.range[1] - self.y.range[0]);
            DVec2::new(left + u * (right - left), bottom - v * (bottom - top))
        };
        let ticks = |axis: &Axis| {
            let step = tick_step(axis.range[1] - axis.range[0]);
            let first = (axis.range[0] / step - 1e-6).ceil() as i64;
            let last = (axis.range[1] / step + 1e-6).floor() as i64;
            (first..=last).map(move |i| (i as f64 * step, step)).collect::<Vec<_>>()
        };
        for (v, step) in ticks(&self.x) {
            let x = map(DVec2::new(v, self.y.range[0])).x;
            figure.line([DVec2::new(x, top), DVec2::new(x, bottom)], GRID, if v.abs() < 1e-9 * step { 1.0 } else { 0.5 }, 0.0);
            figure.text(DVec2::new(x, bottom + 12.0), number(v, step), 8.5, Anchor::Middle);
        }
        for (v, step) in ticks(&self.y) {
            let y = map(DVec2::new(self.x.range[0], v)).y;
            figure.line([DVec2::new(left, y), DVec2::new(right, y)], GRID, if v.abs() < 1e-9 * step { 1.0 } else { 0.5 }, 0.0);
            figure.text(DVec2::new(left - 4.0, y + 3.0), number(v, step), 8.5, Anchor::End);
        }
        let frame = [
            DVec2::new(left, top),
            DVec2::new(right, top),
            DVec2::new(right, bottom),
            DVec2::new(left, bottom),
            DVec2::new(left, top),
        ];
        figure.line(frame, INK, 0.8, 0.0);
        figure.text(DVec2::new(0.5 * (left + right), at.y + 15.0), self.title.clone(), 10.0, Anchor::Middle);
        figure.text(DVec2::new(0.5 * (left + right), bottom + 26.0), self.x.label.clone(), 9.0, Anchor::Middle);
        figure.items.push(Item::Text {
            at: DVec2::new(at.x + 11.0, 0.5 * (top + bottom)),
            text: self.y.label.clone(),
            size: 9.0,
            anchor: Anchor::Middle,
            upwards: true,
            color: INK,
        });
        let inside = |p: &DVec2| {
            let (x, y) = (&self.x.range, &self.y.range);
            let ok = |v: f64, r: &[f64; 2]| {
                v >= r.iter().copied().fold(f64::MAX, f64::min) && v <= r.iter().copied().fold(f64::MIN, f64::max)
            };
            ok(p.x, x) && ok(p.y, y)
        };
        for line in &self.lines {
            match line.style {
                Style::Dots => {
                    for p in line.points.iter().filter(|p| inside(p)) {
                        figure.items.push(Item::Dot { at: map(*p), radius: 0.55, color: line.color });
                    }
                }
                style => {
                    // What lies outside is left out, as a break.
                    let points = line.points.iter().map(|p| if inside(p) { map(*p) } else { DVec2::NAN });
                    figure.line(points, line.color, 1.2, if style == Style::Broken { 3.0 } else { 0.0 });
                }
            }
        }
        let named: Vec<&Line> = self.lines.iter().filter(|l| !l.name.is_empty()).collect();
        for (i, line) in named.iter().enumerate() {
            let y = top + 11.0 + 11.0 * i as f64;
            let x = right - 6.0;
            figure.text(DVec2::new(x, y), line.name.clone(), 8.0, Anchor::End);
            let start = x - 5.2 * line.name.chars().count() as f64 - 22.0;
            let dash = if line.style == Style::Broken { 3.0 } else { 0.0 };
            figure.line([DVec2::new(start, y - 3.0), DVec2::new(start + 16.0, y - 3.0)], line.color, 1.4, dash);
        }
    }
}

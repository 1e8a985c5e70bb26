//! Lines and texts on a sheet.

use glam::DVec2;
use std::fmt::Write;

/// sRGB, 0 to 255.
pub type Color = [u8; 3];

/// Black.
pub const INK: Color = [30, 30, 30];
/// Light grey, for grids.
pub const GRID: Color = [215, 215, 215];
/// Colours of fields, from the axis outwards.
pub(crate) const FIELD_COLORS: [Color; 6] =
    [[31, 90, 170], [40, 140, 70], [200, 60, 40], [150, 80, 170], [200, 140, 20], [20, 150, 160]];

/// A colour that stands for a wavelength (nm): hue only, dark enough for paper.
pub fn wavelength_color(nm: f64) -> Color {
    match nm {
        ..430.0 => [110, 50, 160],
        ..500.0 => [40, 80, 200],
        ..530.0 => [0, 140, 120],
        ..590.0 => [40, 150, 40],
        ..620.0 => [210, 140, 0],
        _ => [200, 40, 40],
    }
}

/// Which part of a text stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// Something drawn. Places in points from the upper left corner.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A line through points.
    Path {
        /// Corners.
        points: Vec<DVec2>,
        /// Stroke.
        color: Color,
        /// Stroke width, points; 0 for none.
        width: f64,
        /// Gap and dash of a broken line, points; 0 for a full one.
        dash: f64,
        /// Fill, with opacity 0 to 1.
        fill: Option<(Color, f64)>,
    },
    /// A dot.
    Dot {
        /// Middle.
        at: DVec2,
        /// Radius.
        radius: f64,
        /// Fill.
        color: Color,
    },
    /// A text.
    Text {
        /// Where its baseline is anchored.
        at: DVec2,
        /// What it says.
        text: String,
        /// Height of the letters, points.
        size: f64,
        /// How it is anchored.
        anchor: Anchor,
        /// Turned by 90°, reading upwards.
        upwards: bool,
        /// Fill.
        color: Color,
    },
}

/// A sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Points.
    pub width: f64,
    /// Points.
    pub height: f64,
    /// In the order of drawing.
    pub items: Vec<Item>,
}

impl Figure {
    /// An empty sheet; its size in points.
    pub fn new(width: f64, height: f64) -> Self {
        Figure { width, height, items: vec![] }
    }

    /// A sheet for a grid of charts of one size (points) below a title, which takes the uppermost 24 points.
    pub(crate) fn sheet(title: &str, columns: usize, rows: usize, cell: DVec2) -> Self {
        let mut figure = Figure::new(cell.x * columns as f64, cell.y * rows as f64 + 24.0);
        figure.text(DVec2::new(figure.width / 2.0, 16.0), title, 11.0, Anchor::Middle);
        figure
    }

    /// A line; points that are not numbers break it. `width` and `dash` (0: unbroken) in points.
    pub fn line(&mut self, points: impl IntoIterator<Item = DVec2>, color: Color, width: f64, dash: f64) {
        let mut part = vec![];
        for p in points {
            if p.is_finite() {
                part.push(p);
            } else if part.len() > 1 {
                self.items.push(Item::Path { points: std::mem::take(&mut part), color, width, dash, fill: None });
            } else {
                part.clear();
            }
        }
        if part.len() > 1 {
            self.items.push(Item::Path { points: part, color, width, dash, fill: None });
        }
    }

    /// A text. Place and size in points.
    pub fn text(&mut self, at: DVec2, text: impl Into<String>, size: f64, anchor: Anchor) {
        self.items.push(Item::Text { at, text: text.into(), size, anchor, upwards: false, color: INK });
    }

    /// As SVG.
    pub fn to_svg(&self) -> String {
        let mut s = String::new();
        let (w, h) = (self.width, self.height);
        let _ = writeln!(
            s,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}pt\" height=\"{h}pt\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"DejaVu Sans, Verdana, sans-serif\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"white\"/>"
        );
        let hex = |c: &Color| format!("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
        for item in &self.items {
            match item {
                Item::Path { points, color, width, dash, fill } => {
                    let mut d = String::new();
                    for (i, p) in points.iter().enumerate() {
                        let _ = write!(d, "{}{:.2} {:.2}", if i == 0 { "M" } else { "L" }, p.x, p.y);
                    }
                    let fill = match fill {
                        Some((c, opacity)) => format!("{}\" fill-opacity=\"{opacity}", hex(c)),
                        None => "none".into(),
                    };
                    let dash = if *dash > 0.0 { format!(" stroke-dasharray=\"{dash} {dash}\"") } else { String::new() };
                    let stroke = if *width > 0.0 { hex(color) } else { "none".into() };
                    let _ = writeln!(
                        s,
                        "<path d=\"{d}\" stroke=\"{stroke}\" stroke-width=\"{width}\" fill=\"{fill}\" stroke-linejoin=\"round\"{dash}/>"
                    );
                }
                Item::Dot { at, radius, color } => {
                    let _ = writeln!(s, "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{radius}\" fill=\"{}\"/>", at.x, at.y, hex(color));
                }
                Item::Text { at, text, size, anchor, upwards, color } => {
                    let anchor = match anchor {
                        Anchor::Start => "start",
                        Anchor::Middle => "middle",
                        Anchor::End => "end",
                    };
                    let turn =
                        if *upwards { format!(" transform=\"rotate(-90 {:.2} {:.2})\"", at.x, at.y) } else { String::new() };
                    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
                    let _ = writeln!(
                        s,
                        "<text x=\"{:.2}\" y=\"{:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{}\"{turn}>{escaped}</text>",
                        at.x,
                        at.y,
                        hex(color)
                    );
                }
            }
        }
        s.push_str("</svg>\n");
        s
    }
}

//! Scenes made by code: always at hand, nothing to download.

pub(crate) mod builder;
pub mod charts;
pub mod color_chart;
pub mod cornell;
mod lathe;
pub mod moving_bars;
pub mod night;
mod pattern;
pub mod propeller;
pub mod resolution_chart;
pub mod rolling_ball;
pub mod still_life;

use crate::scene::Description;
use glam::Vec3;

/// Names of the embedded scenes and what they show.
pub const NAMES: &[(&str, &str)] = &[
    ("still-life", "glass, metal, fruit and china on a table before small lights: depth, reflections, bokeh"),
    ("resolution-chart", "a zone plate, a star, sweeps of lines, slanted edges: what optics and demosaicing find hard"),
    ("slanted-edges", "dark squares turned by 5°, all over: measures resolution (ISO 12233)"),
    ("dot-grid", "dots in rows and columns: measures distortion"),
    ("flat-field", "an even white board: measures vignetting and noise"),
    ("glare-spot", "a black square on an even white board: measures veiling glare (ISO 9358)"),
    (
        "step-wedge",
        "twenty fields of a light box, 15.8 stops: measures tone response, noise and dynamic range (ISO 14524, 15739)",
    ),
    ("moving-bars", "two bars that move at 1 m/s, upright and level: what shutters do to edges"),
    ("propeller", "a propeller at 25 turns a second before the sky: rolling shutters, short times"),
    ("rolling-ball", "a striped ball with a small lamp rolls through a dim room: long times, flashes, curtains"),
    ("night", "a road at night under turning stars, a car drives past every 12 s: long exposures"),
    ("cornell", "the Cornell box with its measured spectra"),
    (
        "color-chart",
        "the 24 ColorChecker patches in 1000 lx of D65; other light: color-chart-a, color-chart-d50, color-chart-fl2 ...",
    ),
];

/// How an embedded scene likes to be photographed (on 36 × 24 mm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// Place of the camera, m.
    pub look_from: Vec3,
    /// Aim, m.
    pub look_at: Vec3,
    /// mm.
    pub focal_length_mm: f64,
    /// f-number.
    pub f_number: f64,
    /// Distance of the sharp plane, m.
    pub focus_m: f64,
}

/// An embedded scene by name; `None` for a name that [`is_embedded`] does not know.
pub fn named(name: &str) -> Option<Description> {
    match name {
        "still-life" => Some(still_life::description()),
        "cornell" => Some(cornell::description()),
        "resolution-chart" => Some(resolution_chart::description()),
        "slanted-edges" => Some(charts::slanted_edges()),
        "dot-grid" => Some(charts::dot_grid()),
        "flat-field" => Some(charts::flat_field()),
        "glare-spot" => Some(charts::glare_spot()),
        "step-wedge" => Some(charts::step_wedge()),
        "moving-bars" => Some(moving_bars::description()),
        "propeller" => Some(propeller::description()),
        "rolling-ball" => Some(rolling_ball::description()),
        "night" => Some(night::description()),
        _ => color_chart::description(name, chart_light(name)?),
    }
}

/// The illuminant of a colour chart's name.
fn chart_light(name: &str) -> Option<&str> {
    match name.strip_prefix("color-chart")? {
        "" => Some("D65"),
        rest => rest.strip_prefix('-').filter(|light| diopter_light::cie::illuminant(light).is_some()),
    }
}

/// Whether a name is that of an embedded scene.
pub fn is_embedded(name: &str) -> bool {
    NAMES.iter().any(|(n, _)| *n == name) || chart_light(name).is_some()
}

/// The framing of an embedded scene; `None` where it is in the scene's own camera, or the name is unknown.
pub fn framing(name: &str) -> Option<Framing> {
    match name {
        "still-life" => Some(still_life::FRAMING),
        "resolution-chart" => Some(resolution_chart::FRAMING),
        "slanted-edges" | "dot-grid" | "flat-field" | "glare-spot" | "step-wedge" => Some(charts::FRAMING),
        "moving-bars" => Some(moving_bars::FRAMING),
        "propeller" => Some(propeller::FRAMING),
        "rolling-ball" => Some(rolling_ball::FRAMING),
        "night" => Some(night::FRAMING),
        _ => chart_light(name).map(|_| color_chart::FRAMING),
    }
}

//! Scenes made by code: always at hand, nothing to download.

pub mod cornell;
mod lathe;
mod pattern;
pub mod still_life;

use crate::scene::Description;
use glam::Vec3;

/// Names of the embedded scenes and what they show.
pub const NAMES: &[(&str, &str)] = &[
    ("still-life", "glass, metal, fruit and china on a table before small lights: depth, reflections, bokeh"),
    ("cornell", "the Cornell box with its measured spectra"),
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

/// An embedded scene by name.
pub fn named(name: &str) -> Option<Description> {
    match name {
        "still-life" => Some(still_life::description()),
        "cornell" => Some(cornell::description()),
        _ => None,
    }
}

/// The framing of an embedded scene, where it is not in the scene's own camera.
pub fn framing(name: &str) -> Option<Framing> {
    (name == "still-life").then_some(still_life::FRAMING)
}

//! Scenes made by code: always at hand, nothing to download.

pub mod cornell;

use crate::scene::Description;

/// Names of the embedded scenes and what they show.
pub const NAMES: &[(&str, &str)] = &[("cornell", "the Cornell box with its measured spectra")];

/// An embedded scene by name.
pub fn named(name: &str) -> Option<Description> {
    match name {
        "cornell" => Some(cornell::description()),
        _ => None,
    }
}

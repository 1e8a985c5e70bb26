//! Developing: from a raw image to a picture. A pure function of the raw image and a [`Recipe`].
//!
//! The order of the steps is [`develop`]; each step is a file in [`steps`]. Working numbers are linear, 1.0 = sensor
//! saturation, camera RGB until the matrix and linear sRGB after it.

mod develop;
mod recipe;
pub mod steps;

pub use develop::develop;
pub use recipe::{Demosaic, Recipe, Tone};

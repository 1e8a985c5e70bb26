//! The order of the steps.

use crate::recipe::Recipe;
use crate::steps::{black_level, camera_matrix, demosaic, encode, tone, white_balance};
use diopter_image::{Picture, RawImage};

/// Develops a raw image into an sRGB picture.
pub fn develop(raw: &RawImage, recipe: &Recipe) -> Picture {
    // Mosaic, 0 = black, 1 = saturation.
    let mosaic = black_level::subtract(raw);
    // Balanced before the demosaic, whose filters expect greys to be even.
    let mosaic = white_balance::balance(mosaic, &raw.header);
    let mut channels = demosaic::demosaic(&mosaic, &raw.header.cfa, recipe.demosaic);
    white_balance::clip_highlights(&mut channels);
    let mut rgb = camera_matrix::to_linear_srgb(&channels, &camera_matrix::forward(&raw.header));
    tone::apply(&mut rgb, recipe.exposure_ev, recipe.tone);
    encode::srgb(rgb, &raw.header.facts)
}

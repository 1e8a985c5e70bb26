//! Display light to codes.

use diopter_image::{Encoding, ExposureFacts, Picture, Raster};
use diopter_light::color::{RgbSpace, srgb_encode};

/// Applies the sRGB transfer function.
pub fn srgb(mut rgb: Raster<f32>, facts: &ExposureFacts) -> Picture {
    rgb.data.iter_mut().for_each(|v| *v = srgb_encode(*v));
    Picture { pixels: rgb, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: Some(facts.clone()) }
}

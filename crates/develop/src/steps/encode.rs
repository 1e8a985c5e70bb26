//! Display light to codes.

use diopter_image::{Encoding, Picture, Raster};
use diopter_light::color::{RgbSpace, srgb_encode};

/// Applies the sRGB transfer function.
pub fn srgb(mut rgb: Raster<f32>) -> Picture {
    rgb.data.iter_mut().for_each(|v| *v = srgb_encode(*v));
    Picture { pixels: rgb, space: RgbSpace::Srgb, encoding: Encoding::Srgb }
}

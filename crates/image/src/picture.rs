//! A developed picture.

use crate::{ExposureFacts, Raster};
use diopter_light::color::{RgbSpace, srgb_encode};

/// How the numbers of a picture relate to light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Proportional to light.
    Linear,
    /// The sRGB transfer function.
    Srgb,
}

/// RGB in a named space, 1.0 = white.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Three channels.
    pub pixels: Raster<f32>,
    /// Primaries and white.
    pub space: RgbSpace,
    /// Transfer function.
    pub encoding: Encoding,
    /// How it was taken, for EXIF; `None` writes none.
    pub facts: Option<ExposureFacts>,
}

impl Picture {
    /// Display codes 0..1 with the sRGB transfer function, whatever the picture is encoded in.
    pub fn codes(&self) -> impl Iterator<Item = f32> + '_ {
        self.pixels.data.iter().map(|v| match self.encoding {
            Encoding::Srgb => v.clamp(0.0, 1.0),
            Encoding::Linear => srgb_encode(v.clamp(0.0, 1.0)),
        })
    }

    /// 8-bit codes.
    pub fn to_8_bit(&self) -> Vec<u8> {
        self.codes().map(|c| (c * 255.0 + 0.5) as u8).collect()
    }

    /// 16-bit codes.
    pub fn to_16_bit(&self) -> Vec<u16> {
        self.codes().map(|c| (c * 65535.0 + 0.5) as u16).collect()
    }
}

//! Pictures, as surfaces have them.

use super::levels::Levels;
use super::paged::Held;
use super::paged::{Paged, RESIDENT};
use glam::Vec3;
use std::sync::Arc;

/// How the codes of an image relate to numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Codes {
    /// Colour: the sRGB transfer function (alpha is linear).
    Srgb,
    /// Data: code / 255, or 65535 of those of 16 bits.
    Linear,
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Image {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// RGBA, row by row from the top.
    pub texels: Texels,
    /// What it counts for in memory.
    pub(super) held: Option<Arc<Held>>,
    /// Smaller copies.
    pub(super) levels: Levels,
}

/// Pixels as they are stored.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Texels {
    /// 8 bits a channel.
    Codes(Vec<[u8; 4]>),
    /// 16 bits a channel.
    Codes16(Vec<[u16; 4]>),
    /// Linear light in 16 bits a channel, 65535 for 1: what smaller copies of pictures of codes are kept in.
    Wide(Vec<[u16; 4]>),
    /// Linear numbers of any size.
    Linear(Vec<[f32; 4]>),
    /// Either, on the disk.
    Paged(Arc<Paged>),
}

/// A pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Texel {
    /// 8 bits a channel.
    Codes([u8; 4]),
    /// 16 bits a channel.
    Codes16([u16; 4]),
    /// Linear light, 65535 for 1.
    Wide([u16; 4]),
    /// Linear numbers.
    Linear([f32; 4]),
}

impl Texels {
    pub(super) fn is_opaque(&self) -> bool {
        match self {
            Texels::Codes(all) => all.iter().all(|p| p[3] == 255),
            Texels::Codes16(all) | Texels::Wide(all) => all.iter().all(|p| p[3] == u16::MAX),
            Texels::Linear(all) => all.iter().all(|p| p[3] == 1.0),
            Texels::Paged(paged) => paged.is_opaque(),
        }
    }
}

impl Texel {
    /// Its codes from 0 to 1, or its numbers.
    pub fn rgb(self) -> Vec3 {
        match self {
            Texel::Codes([r, g, b, _]) => Vec3::new(r as f32, g as f32, b as f32) / 255.0,
            Texel::Codes16([r, g, b, _]) | Texel::Wide([r, g, b, _]) => Vec3::new(r as f32, g as f32, b as f32) / 65535.0,
            Texel::Linear([r, g, b, _]) => Vec3::new(r, g, b),
        }
    }
}

impl Image {
    /// From codes of 8 bits, RGBA, row by row from the top; `pixels` are `width` × `height`.
    pub fn new(width: usize, height: usize, pixels: Vec<[u8; 4]>) -> Self {
        Image { width, height, texels: Texels::Codes(pixels), held: None, levels: Levels::default() }
    }

    /// From codes of 16 bits.
    pub(crate) fn of_codes16(width: usize, height: usize, pixels: Vec<[u16; 4]>) -> Self {
        Image { width, height, texels: Texels::Codes16(pixels), held: None, levels: Levels::default() }
    }

    /// From linear numbers, RGBA, row by row from the top; `pixels` are `width` × `height`.
    pub fn linear(width: usize, height: usize, pixels: Vec<[f32; 4]>) -> Self {
        Image { width, height, texels: Texels::Linear(pixels), held: None, levels: Levels::default() }
    }

    /// From linear light in 16 bits a channel.
    pub(super) fn wide(width: usize, height: usize, pixels: Vec<[u16; 4]>) -> Self {
        Image { width, height, texels: Texels::Wide(pixels), held: None, levels: Levels::default() }
    }

    /// From pixels as they are stored; kept as [`Image::kept`] says.
    pub(crate) fn of_texels(width: usize, height: usize, texels: Texels) -> Self {
        Image { width, height, texels, held: None, levels: Levels::default() }.kept()
    }

    /// Whether its pixels are numbers of any size.
    pub(super) fn holds_numbers(&self) -> bool {
        match &self.texels {
            Texels::Codes(_) | Texels::Codes16(_) | Texels::Wide(_) => false,
            Texels::Linear(_) => true,
            Texels::Paged(paged) => paged.holds_numbers(),
        }
    }

    /// Whether any pixel is not opaque.
    pub fn has_alpha(&self) -> bool {
        !self.texels.is_opaque()
    }

    /// Whether it is without colours; a sample of its pixels is looked at.
    pub fn is_grey(&self) -> bool {
        /// Between channels, in codes: what compression of JPEG leaves.
        const TOLERANCE: f32 = 8.0 / 255.0;
        self.some_pixels().all(|rgb| rgb.max_element() - rgb.min_element() <= TOLERANCE)
    }

    /// Whether its colours are unit vectors that point outwards, as those of a map of normals are: most of a sample of its pixels.
    pub fn is_of_normals(&self) -> bool {
        /// Of lengths: compression and filters shorten some.
        const TOLERANCE: f32 = 0.2;
        /// Of the sample.
        const MOST: f32 = 0.9;
        let is_normal = |rgb: Vec3| {
            let normal = 2.0 * rgb - 1.0;
            (normal.length() - 1.0).abs() <= TOLERANCE && normal.z > 0.0
        };
        let (mut normals, mut all) = (0, 0);
        for rgb in self.some_pixels() {
            (normals, all) = (normals + u32::from(is_normal(rgb)), all + 1);
        }
        normals as f32 >= MOST * all as f32
    }

    /// Colours of pixels spread over it, 64 × 64 at most.
    fn some_pixels(&self) -> impl Iterator<Item = Vec3> {
        let (columns, rows) = (self.width.clamp(1, 64), self.height.clamp(1, 64));
        (0..columns * rows)
            .map(move |i| self.texel((i % columns) * self.width / columns, (i / columns) * self.height / rows).rgb())
    }

    /// The pixel of a column and a row, from the upper left. Panics beyond the picture.
    #[inline]
    pub fn texel(&self, column: usize, row: usize) -> Texel {
        match &self.texels {
            Texels::Codes(codes) => Texel::Codes(codes[row * self.width + column]),
            Texels::Codes16(all) => Texel::Codes16(all[row * self.width + column]),
            Texels::Wide(all) => Texel::Wide(all[row * self.width + column]),
            Texels::Linear(all) => Texel::Linear(all[row * self.width + column]),
            Texels::Paged(paged) => paged.texel(column, row),
        }
    }

    /// The picture as it is kept: in memory while there is room ([`RESIDENT`]), on the disk beyond.
    pub(crate) fn kept(self) -> Self {
        self.kept_below(RESIDENT)
    }

    pub(super) fn kept_below(mut self, most: u64) -> Self {
        let bytes = match &self.texels {
            Texels::Codes(all) => all.len() * 4,
            Texels::Codes16(all) | Texels::Wide(all) => all.len() * 8,
            Texels::Linear(all) => all.len() * 16,
            Texels::Paged(_) => return self,
        };
        self.held = Held::claim(bytes as u64, most).map(Arc::new);
        // Without a place for temporary files it stays in memory.
        if self.held.is_none()
            && let Ok(paged) = Paged::new(&self.texels, self.width, self.height, None)
        {
            self.texels = Texels::Paged(Arc::new(paged));
        }
        self
    }
}

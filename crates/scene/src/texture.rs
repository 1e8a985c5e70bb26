//! Images on surfaces, and the inputs of materials that may be an image or a constant.
//!
//! Texture coordinates follow glTF: (0, 0) is the upper left corner of the image, v runs down.

pub(crate) mod levels;
pub(crate) mod lookup;
mod paged;

pub use levels::Footprint;
pub use lookup::Lookup;
pub use paged::{Paged, RESIDENT};

use crate::noise;
use crate::shape::Surface;
use diopter_light::color::srgb_decode;
use diopter_light::upsample::Sigmoid;
use diopter_light::{Sampled, Wavelengths};
use glam::{Affine2, Affine3A, Vec2, Vec3, Vec4};
use levels::Levels;
use paged::Held;
use std::f32::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

/// How the 8-bit codes of an image relate to numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Codes {
    /// Colour: the sRGB transfer function (alpha is linear).
    Srgb,
    /// Data: code / 255.
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
    held: Option<Arc<Held>>,
    /// Smaller copies.
    levels: Levels,
}

/// Pixels as they are stored.
#[derive(Clone, Debug)]
pub enum Texels {
    /// 8 bits a channel.
    Codes(Vec<[u8; 4]>),
    /// Linear light in 16 bits a channel, 65535 for 1: what smaller copies of pictures of codes are kept in.
    Wide(Vec<[u16; 4]>),
    /// Linear numbers of any size.
    Linear(Vec<[f32; 4]>),
    /// Either, on the disk.
    Paged(Arc<Paged>),
}

/// A pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texel {
    /// 8 bits a channel.
    Codes([u8; 4]),
    /// Linear light, 65535 for 1.
    Wide([u16; 4]),
    /// Linear numbers.
    Linear([f32; 4]),
}

impl Texels {
    fn is_opaque(&self) -> bool {
        match self {
            Texels::Codes(all) => all.iter().all(|p| p[3] == 255),
            Texels::Wide(all) => all.iter().all(|p| p[3] == u16::MAX),
            Texels::Linear(all) => all.iter().all(|p| p[3] == 1.0),
            Texels::Paged(paged) => paged.is_opaque(),
        }
    }
}

impl Image {
    /// From codes of 8 bits.
    pub fn new(width: usize, height: usize, pixels: Vec<[u8; 4]>) -> Self {
        Image { width, height, texels: Texels::Codes(pixels), held: None, levels: Levels::default() }
    }

    /// From linear numbers.
    pub fn linear(width: usize, height: usize, pixels: Vec<[f32; 4]>) -> Self {
        Image { width, height, texels: Texels::Linear(pixels), held: None, levels: Levels::default() }
    }

    /// From linear light in 16 bits a channel.
    fn wide(width: usize, height: usize, pixels: Vec<[u16; 4]>) -> Self {
        Image { width, height, texels: Texels::Wide(pixels), held: None, levels: Levels::default() }
    }

    /// From pixels as they are stored; kept as [`Image::kept`] says.
    pub(crate) fn of_texels(width: usize, height: usize, texels: Texels) -> Self {
        Image { width, height, texels, held: None, levels: Levels::default() }.kept()
    }

    /// Whether its pixels are numbers of any size.
    fn holds_numbers(&self) -> bool {
        match &self.texels {
            Texels::Codes(_) | Texels::Wide(_) => false,
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
        let (columns, rows) = (self.width.clamp(1, 64), self.height.clamp(1, 64));
        let grey = |i: usize| {
            let (column, row) = ((i % columns) * self.width / columns, (i / columns) * self.height / rows);
            let rgb = match self.texel(column, row) {
                Texel::Codes([r, g, b, _]) => Vec3::new(r as f32, g as f32, b as f32) / 255.0,
                Texel::Wide([r, g, b, _]) => Vec3::new(r as f32, g as f32, b as f32) / 65535.0,
                Texel::Linear([r, g, b, _]) => Vec3::new(r, g, b),
            };
            rgb.max_element() - rgb.min_element() <= TOLERANCE
        };
        (0..columns * rows).all(grey)
    }

    /// A pixel.
    #[inline]
    pub fn texel(&self, column: usize, row: usize) -> Texel {
        match &self.texels {
            Texels::Codes(codes) => Texel::Codes(codes[row * self.width + column]),
            Texels::Wide(all) => Texel::Wide(all[row * self.width + column]),
            Texels::Linear(all) => Texel::Linear(all[row * self.width + column]),
            Texels::Paged(paged) => paged.texel(column, row),
        }
    }

    /// The picture as it is kept: in memory while there is room ([`RESIDENT`]), on the disk beyond.
    pub(crate) fn kept(self) -> Self {
        self.kept_below(RESIDENT)
    }

    fn kept_below(mut self, most: u64) -> Self {
        let bytes = match &self.texels {
            Texels::Codes(all) => all.len() * 4,
            Texels::Wide(all) => all.len() * 8,
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

/// What happens beyond the edge of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The image repeats.
    Repeat,
    /// Every second copy is mirrored.
    Mirror,
    /// The edge goes on.
    Clamp,
    /// There is nothing.
    Black,
}

impl Wrap {
    #[inline]
    fn index(self, i: i64, n: i64) -> usize {
        // Most lie within: no division.
        if (0..n).contains(&i) {
            return i as usize;
        }
        (match self {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp | Wrap::Black => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let j = i.rem_euclid(2 * n);
                if j < n { j } else { 2 * n - 1 - j }
            }
        }) as usize
    }
}

/// How values between pixels are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The pixel that holds the point.
    Nearest,
    /// Bilinear, in linear light.
    Bilinear,
}

/// An image as a function of a surface's texture coordinates.
#[derive(Clone, Debug)]
pub struct Texture {
    /// The pixels.
    pub image: Arc<Image>,
    /// Meaning of the codes.
    pub codes: Codes,
    /// Horizontal and vertical behaviour beyond the edges.
    pub wrap: [Wrap; 2],
    /// Between pixels.
    pub interpolation: Interpolation,
    /// Which set of coordinates of the mesh.
    pub uv_set: usize,
    /// Image coordinates from mesh coordinates (KHR_texture_transform).
    pub image_from_uv: Affine2,
}

fn srgb_table() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| srgb_decode(i as f32 / 255.0)))
}

impl Texture {
    /// A colour image, repeated, bilinear, on the first set of coordinates.
    pub fn color(image: Arc<Image>) -> Self {
        Texture {
            image,
            codes: Codes::Srgb,
            wrap: [Wrap::Repeat; 2],
            interpolation: Interpolation::Bilinear,
            uv_set: 0,
            image_from_uv: Affine2::IDENTITY,
        }
    }

    /// Which pixel is at a column or row that may lie beyond the edge; `None` where there is nothing.
    #[inline]
    fn inside(wrap: Wrap, i: i64, n: usize) -> Option<usize> {
        let nothing = wrap == Wrap::Black && !(0..n as i64).contains(&i);
        (!nothing).then(|| wrap.index(i, n as i64))
    }

    #[inline]
    fn texel(&self, image: &Image, column: Option<usize>, row: Option<usize>) -> Vec4 {
        match (column, row) {
            (Some(column), Some(row)) => levels::linear(image.texel(column, row), self.codes),
            _ => Vec4::ZERO,
        }
    }

    /// Size of a texel along the narrower of its sides, in texture coordinates.
    pub fn texel_size(&self) -> f32 {
        let m = self.image_from_uv.matrix2;
        let side = |scale: f32, n: usize| 1.0 / (scale * n as f32).max(1e-6);
        side(m.row(0).length(), self.image.width).min(side(m.row(1).length(), self.image.height))
    }

    /// RGBA at texture coordinates; linear.
    pub fn at(&self, uv: &[Vec2; 2]) -> Vec4 {
        let p = self.image_from_uv.transform_point2(uv[self.uv_set.min(1)]);
        if !p.is_finite() {
            return Vec4::ZERO;
        }
        self.sample(&self.image, p)
    }
}

/// A picture made of others: linear sRGB, or the same number three times.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Graph {
    /// The same everywhere.
    Constant(Vec3),
    /// An image times a factor.
    Image {
        /// The image.
        texture: Texture,
        /// Multiplies it.
        scale: f32,
        /// Whether what is bright becomes dark.
        invert: bool,
        /// Weights of colours and of alpha where it stands for a number.
        as_number: Option<[Vec3; 2]>,
        /// Coordinates (v up) made of the place in space instead of the mesh's.
        mapping: Option<Mapping>,
    },
    /// One times the other.
    Scale(Arc<Graph>, Arc<Graph>),
    /// From the first to the second by an amount.
    Mix(Arc<Graph>, Arc<Graph>, Arc<Graph>),
    /// By how a surface faces: the one where its normal lies along a direction, the other where it is perpendicular to it, by the cosine between.
    DirectionMix {
        /// Where the normal lies along the direction, either way.
        along: Arc<Graph>,
        /// Where it is perpendicular to it.
        across: Arc<Graph>,
        /// In the world, of length 1.
        direction: Vec3,
    },
    /// To a power.
    Power(Arc<Graph>, f32),
    /// Squares of the texture coordinates.
    Checkerboard {
        /// Coordinates.
        place: Mapping,
        /// Where the sum of whole coordinates is even.
        even: Arc<Graph>,
        /// Elsewhere.
        odd: Arc<Graph>,
    },
    /// Between four corners: (0, 0), (0, 1), (1, 0), (1, 1).
    Bilinear {
        /// Coordinates.
        place: Mapping,
        /// Values there.
        corners: [Vec3; 4],
    },
    /// Dots strewn over the texture coordinates.
    Dots {
        /// Coordinates.
        place: Mapping,
        /// In the dots.
        inside: Arc<Graph>,
        /// Around them.
        outside: Arc<Graph>,
    },
    /// Cubes in space.
    Cubes {
        /// The texture's space from the world's.
        texture_from_world: Affine3A,
        /// Where the sum of whole coordinates is even.
        even: Arc<Graph>,
        /// Elsewhere.
        odd: Arc<Graph>,
    },
    /// A pattern of noise in space.
    Noise {
        /// The texture's space from the world's.
        texture_from_world: Affine3A,
        /// Which.
        pattern: NoisePattern,
    },
}

/// Patterns of [`crate::noise`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum NoisePattern {
    /// Octaves, and how much weaker each is than the one before.
    Fbm(u32, f32),
    /// The same of its magnitude.
    Wrinkled(u32, f32),
    /// Waves raised by gusts.
    Windy,
    /// Octaves, roughness, and how much they bend the veins.
    Marble(u32, f32, f32),
}

/// Two coordinates of a picture.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Mapping {
    /// Factor and offset of the mesh's own.
    Uv([[f32; 2]; 2]),
    /// Angle from z and around it, as fractions of a half and a whole turn.
    Spherical(Affine3A),
    /// Around z as a fraction of a turn, and along it.
    Cylindrical(Affine3A),
    /// Lengths along two vectors of the texture's space, and offsets.
    Planar(Affine3A, [Vec3; 2], Vec2),
}

impl Mapping {
    fn at(&self, &Lookup { uv, point, .. }: &Lookup) -> Vec2 {
        match self {
            Mapping::Uv([u, v]) => Vec2::new(u[0] * uv[0].x + u[1], v[0] * uv[0].y + v[1]),
            Mapping::Spherical(place) => {
                let p = place.transform_point3(point);
                Vec2::new(p.x.hypot(p.y).atan2(p.z) / PI, p.y.atan2(p.x).rem_euclid(TAU) / TAU)
            }
            Mapping::Cylindrical(place) => {
                let p = place.transform_point3(point);
                Vec2::new((PI + p.y.atan2(p.x)) / TAU, p.z)
            }
            Mapping::Planar(place, [s, t], offset) => {
                let p = place.transform_point3(point);
                Vec2::new(p.dot(*s), p.dot(*t)) + *offset
            }
        }
    }

    /// The footprint in its coordinates; none where they are made of the place in space.
    fn footprint(&self, there: &Lookup) -> Option<Footprint> {
        match (self, &there.footprint) {
            (Mapping::Uv([u, v]), Some(footprint)) => Some(footprint.scaled(Vec2::new(u[0], v[0]))),
            _ => None,
        }
    }

    fn is_in_space(&self) -> bool {
        !matches!(self, Mapping::Uv(_))
    }
}

impl Graph {
    /// The value, where it is the same everywhere.
    pub fn constant(&self) -> Option<Vec3> {
        match self {
            Graph::Constant(c) => Some(*c),
            _ => None,
        }
    }

    /// How many pictures are looked up for one value.
    pub fn lookups(&self) -> usize {
        1 + match self {
            Graph::Constant(_) | Graph::Image { .. } | Graph::Bilinear { .. } | Graph::Noise { .. } => 0,
            Graph::Power(a, _) => a.lookups(),
            Graph::Scale(a, b) | Graph::DirectionMix { along: a, across: b, .. } => a.lookups() + b.lookups(),
            Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => a.lookups() + b.lookups(),
            Graph::Mix(a, b, amount) => a.lookups() + b.lookups() + amount.lookups(),
        }
    }

    /// Whether it asks where in space a point is or how the surface lies.
    pub fn is_in_space(&self) -> bool {
        match self {
            Graph::Constant(_) => false,
            Graph::Noise { .. } | Graph::Cubes { .. } | Graph::DirectionMix { .. } => true,
            Graph::Image { mapping, .. } => mapping.is_some_and(|m| m.is_in_space()),
            Graph::Bilinear { place, .. } => place.is_in_space(),
            Graph::Power(a, _) => a.is_in_space(),
            Graph::Scale(a, b) => a.is_in_space() || b.is_in_space(),
            Graph::Checkerboard { place, even: a, odd: b } | Graph::Dots { place, inside: a, outside: b } => {
                place.is_in_space() || a.is_in_space() || b.is_in_space()
            }
            Graph::Mix(a, b, amount) => a.is_in_space() || b.is_in_space() || amount.is_in_space(),
        }
    }

    /// Tells the pictures in it that are looked up by the mesh's coordinates, and the larger factor on these.
    pub(crate) fn each_texture(&self, tell: &mut dyn FnMut(&Texture, f32)) {
        match self {
            Graph::Constant(_) | Graph::Bilinear { .. } | Graph::Noise { .. } => {}
            Graph::Image { texture, mapping: None, .. } => tell(texture, 1.0),
            Graph::Image { texture, mapping: Some(Mapping::Uv([u, v])), .. } => tell(texture, u[0].abs().max(v[0].abs())),
            Graph::Image { .. } | Graph::Power(..) => {}
            Graph::Scale(a, b)
            | Graph::DirectionMix { along: a, across: b, .. }
            | Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => [a, b].into_iter().for_each(|g| g.each_texture(tell)),
            Graph::Mix(a, b, amount) => [a, b, amount].into_iter().for_each(|g| g.each_texture(tell)),
        }
    }

    /// Size of a texel of its finest picture, in texture coordinates; 0 without one.
    pub fn texel(&self) -> f32 {
        let finest = |a: f32, b: f32| if a == 0.0 || (b > 0.0 && b < a) { b } else { a };
        match self {
            Graph::Constant(_) | Graph::Bilinear { .. } | Graph::Noise { .. } => 0.0,
            Graph::Image { texture, mapping: None, .. } => texture.texel_size(),
            // Coordinates of its own, of another size.
            Graph::Image { .. } => 0.0,
            Graph::Power(a, _) => a.texel(),
            Graph::Scale(a, b) | Graph::DirectionMix { along: a, across: b, .. } => finest(a.texel(), b.texel()),
            Graph::Checkerboard { even: a, odd: b, .. }
            | Graph::Cubes { even: a, odd: b, .. }
            | Graph::Dots { inside: a, outside: b, .. } => finest(a.texel(), b.texel()),
            Graph::Mix(a, b, amount) => finest(finest(a.texel(), b.texel()), amount.texel()),
        }
    }

    /// The value there.
    pub fn at(&self, there: &Lookup) -> Vec3 {
        match self {
            Graph::Constant(c) => *c,
            Graph::Image { texture, scale, invert, as_number, mapping } => {
                let texel = match mapping {
                    None => texture.filtered(&there.uv, there.footprint.as_ref()),
                    Some(m) => texture.filtered(&[m.at(there); 2], m.footprint(there).as_ref()),
                };
                let value = match as_number {
                    None => texel.truncate(),
                    Some([colors, alpha]) => Vec3::splat(texel.truncate().dot(*colors)) + *alpha * texel.w,
                } * *scale;
                if *invert { (1.0 - value).max(Vec3::ZERO) } else { value }
            }
            Graph::Scale(a, b) => a.at(there) * b.at(there),
            Graph::Mix(a, b, amount) => {
                let t = amount.at(there);
                a.at(there) * (1.0 - t) + b.at(there) * t
            }
            Graph::DirectionMix { along, across, direction } => {
                let t = there.normal.dot(*direction).abs().min(1.0);
                along.at(there) * t + across.at(there) * (1.0 - t)
            }
            // The mean of a power is not the power of a mean.
            Graph::Power(a, exponent) => a.at(&there.point_alone()).max(Vec3::ZERO).powf(*exponent),
            Graph::Checkerboard { place, even, odd } => {
                let p = place.at(there).floor();
                if (p.x + p.y).rem_euclid(2.0) < 0.5 { even.at(there) } else { odd.at(there) }
            }
            Graph::Cubes { texture_from_world, even, odd } => {
                let p = texture_from_world.transform_point3(there.point).floor();
                if (p.x + p.y + p.z).rem_euclid(2.0) < 0.5 { even.at(there) } else { odd.at(there) }
            }
            Graph::Dots { place, inside, outside } => {
                let p = place.at(there);
                if noise::dotted(p.x, p.y) { inside.at(there) } else { outside.at(there) }
            }
            Graph::Bilinear { place, corners: [a, b, c, d] } => {
                let p = place.at(there);
                a.lerp(*b, p.y).lerp(c.lerp(*d, p.y), p.x)
            }
            Graph::Noise { texture_from_world, pattern } => {
                let p = texture_from_world.transform_point3(there.point);
                match *pattern {
                    NoisePattern::Fbm(octaves, roughness) => Vec3::splat(noise::fbm(p, roughness, octaves)),
                    NoisePattern::Wrinkled(octaves, roughness) => Vec3::splat(noise::wrinkled(p, roughness, octaves)),
                    NoisePattern::Windy => Vec3::splat(noise::windy(p)),
                    NoisePattern::Marble(octaves, roughness, variation) => noise::marble(p, roughness, octaves, variation),
                }
            }
        }
    }
}

/// A colour of a material: linear sRGB, possibly from an image, as a spectrum.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Color {
    /// The same everywhere.
    Constant {
        /// Linear sRGB.
        rgb: Vec3,
        /// Its spectrum.
        sigmoid: Sigmoid,
    },
    /// A measured reflectance; made by [`Color::spectrum`].
    Spectrum(Arc<MeasuredColor>),
    /// An image times a factor (linear sRGB).
    Textured {
        /// Multiplies the image.
        factor: Vec3,
        /// The image.
        texture: Texture,
    },
    /// A picture made of others.
    Graph(Arc<Graph>),
}

/// A measured reflectance.
#[derive(Clone, Debug)]
pub struct MeasuredColor {
    /// Over wavelength, 0 to 1.
    pub spectrum: diopter_light::Spectrum,
    /// Linear sRGB under D65: integrals take hundreds of times as long as a look-up.
    pub rgb: Vec3,
}

impl Color {
    /// A constant colour.
    pub fn rgb(r: f32, g: f32, b: f32) -> Self {
        let rgb = Vec3::new(r, g, b);
        Color::Constant { rgb, sigmoid: Sigmoid::from_rgb(rgb) }
    }

    /// A measured reflectance, 0 to 1, and its linear sRGB under D65.
    pub fn spectrum(spectrum: diopter_light::Spectrum) -> Self {
        let rgb = spectrum_rgb(&spectrum);
        Color::Spectrum(Arc::new(MeasuredColor { spectrum, rgb }))
    }

    /// Reflectance at the wavelengths of a path; the colours of the mesh's vertices multiply it.
    #[inline]
    pub fn sample(&self, surface: &Surface, wavelengths: &Wavelengths) -> Sampled {
        match self {
            Color::Constant { sigmoid, .. } if surface.color == Vec4::ONE => sigmoid.sample(wavelengths),
            Color::Spectrum(measured) if !wavelengths.is_rgb() => measured.spectrum.sample(wavelengths),
            _ if wavelengths.is_rgb() => Wavelengths::lanes(self.linear_srgb(surface).clamp(Vec3::ZERO, Vec3::ONE)),
            _ => Sigmoid::from_rgb(self.linear_srgb(surface)).sample(wavelengths),
        }
    }

    /// Linear sRGB at a surface point (for the albedo plane; measured reflectances through D65).
    pub fn linear_srgb(&self, surface: &Surface) -> Vec3 {
        match self {
            Color::Constant { rgb, .. } => *rgb * surface.color.truncate(),
            Color::Spectrum(measured) => measured.rgb,
            Color::Textured { factor, texture } => {
                *factor * texture.filtered(&surface.uv, surface.footprint()).truncate() * surface.color.truncate()
            }
            Color::Graph(graph) => graph.at(&surface.lookup()) * surface.color.truncate(),
        }
    }
}

pub(crate) fn spectrum_rgb(spectrum: &diopter_light::Spectrum) -> Vec3 {
    use diopter_light::{cie::d65_one_nit, color};
    let d65 = d65_one_nit();
    color::srgb_of_light(|nm| spectrum.at(nm) * d65.at(nm))
}

/// A number of a material, possibly from a channel of an image.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Scalar {
    /// The same everywhere.
    Constant(f32),
    /// A channel of an image times a factor.
    Textured {
        /// Multiplies the image.
        factor: f32,
        /// The image.
        texture: Texture,
        /// 0 R, 1 G, 2 B, 3 A.
        channel: usize,
    },
    /// A picture made of others: its first number.
    Graph(Arc<Graph>),
}

impl Scalar {
    /// Size of a texel of its finest picture, in texture coordinates; 0 without one.
    pub fn texel(&self) -> f32 {
        match self {
            Scalar::Constant(_) => 0.0,
            Scalar::Textured { texture, .. } => texture.texel_size(),
            Scalar::Graph(graph) => graph.texel(),
        }
    }

    /// The number at a surface point.
    #[inline]
    pub fn at(&self, surface: &Surface) -> f32 {
        self.lookup(&surface.lookup())
    }

    /// The number there.
    #[inline]
    pub fn lookup(&self, there: &Lookup) -> f32 {
        match self {
            Scalar::Constant(value) => *value,
            Scalar::Textured { factor, texture, channel } => factor * texture.at(&there.uv)[*channel],
            // What depends on a number is seldom a multiple of it: its mean would show something else.
            Scalar::Graph(graph) => graph.at(&there.point_alone()).x,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(wrap: Wrap, interpolation: Interpolation) -> Texture {
        let pixels = vec![[0, 0, 0, 255], [255, 255, 255, 255]];
        let image = Arc::new(Image::new(2, 1, pixels));
        Texture { wrap: [wrap; 2], interpolation, codes: Codes::Linear, ..Texture::color(image) }
    }

    #[test]
    fn wraps_as_gltf_says() {
        let at = |wrap, u| texture(wrap, Interpolation::Nearest).at(&[Vec2::new(u, 0.5); 2]).x;
        assert_eq!([-0.25, 0.25, 0.75, 1.25].map(|u| at(Wrap::Repeat, u)), [1.0, 0.0, 1.0, 0.0]);
        assert_eq!([-0.25, 0.25, 0.75, 1.25].map(|u| at(Wrap::Mirror, u)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!([-5.0, 0.25, 0.75, 9.0].map(|u| at(Wrap::Clamp, u)), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn interpolates_between_pixel_centres() {
        let t = texture(Wrap::Clamp, Interpolation::Bilinear);
        assert_eq!([0.25, 0.5, 0.75].map(|u| t.at(&[Vec2::new(u, 0.3); 2]).x), [0.0, 0.5, 1.0]);
        assert_eq!(t.at(&[Vec2::NAN; 2]), Vec4::ZERO);
    }
}

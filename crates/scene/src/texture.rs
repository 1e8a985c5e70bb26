//! Images on surfaces, and the inputs of materials that may be an image or a constant.
//!
//! Texture coordinates follow glTF: (0, 0) is the upper left corner of the image, v runs down.

mod graph;
mod image;
pub(crate) mod levels;
pub(crate) mod lookup;
mod paged;

pub use graph::{Graph, Mapping, NoisePattern};
pub use image::{Codes, Image, Texel, Texels};
pub use levels::Footprint;
pub use lookup::Lookup;
pub use paged::{Paged, RESIDENT};

use crate::shape::Surface;
use diopter_light::color::srgb_decode;
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::{Affine2, Vec2, Vec3, Vec4};
use std::sync::{Arc, OnceLock};

/// What happens beyond the edge of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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
#[non_exhaustive]
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

    /// RGBA at texture coordinates; linear. All 0 where they are not finite, and beyond the edge of [`Wrap::Black`].
    pub fn at(&self, uv: &[Vec2; 2]) -> Vec4 {
        let p = self.image_from_uv.transform_point2(uv[self.uv_set.min(1)]);
        if !p.is_finite() {
            return Vec4::ZERO;
        }
        self.sample(&self.image, p)
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
    /// A constant colour, linear sRGB, 0 to 1.
    pub fn rgb(r: f32, g: f32, b: f32) -> Self {
        let rgb = Vec3::new(r, g, b);
        Color::Constant { rgb, sigmoid: Sigmoid::from_rgb(rgb) }
    }

    /// A measured reflectance, 0 to 1, and its linear sRGB under D65.
    pub fn spectrum(spectrum: diopter_light::Spectrum) -> Self {
        let rgb = spectrum_rgb(&spectrum);
        Color::Spectrum(Arc::new(MeasuredColor { spectrum, rgb }))
    }

    /// Linear sRGB where it is a constant.
    pub(crate) fn constant_rgb(&self) -> Option<Vec3> {
        match self {
            Color::Constant { rgb, .. } => Some(*rgb),
            Color::Spectrum(measured) => Some(measured.rgb),
            _ => None,
        }
    }

    /// Whether it is a constant of this linear sRGB.
    pub(crate) fn is_everywhere(&self, rgb: Vec3) -> bool {
        self.constant_rgb() == Some(rgb)
    }

    /// It times a factor (linear sRGB), at least 0; a measured reflectance becomes a colour.
    pub(crate) fn times(self, factor: Vec3) -> Self {
        match self {
            Color::Textured { factor: own, texture } => Color::Textured { factor: own * factor, texture },
            Color::Graph(graph) => Color::Graph(Arc::new(Graph::Scale(graph, Arc::new(Graph::Constant(factor))))),
            Color::Constant { .. } | Color::Spectrum(_) => {
                let rgb = self.constant_rgb().map_or(Vec3::ZERO, |rgb| rgb * factor);
                let rgb = if rgb.is_finite() { rgb.max(Vec3::ZERO) } else { Vec3::ZERO };
                Color::rgb(rgb.x, rgb.y, rgb.z)
            }
        }
    }

    /// A factor (linear sRGB) times an image, if there is one.
    pub(crate) fn with_picture(factor: Vec3, picture: Option<Texture>) -> Self {
        match picture {
            Some(texture) => Color::Textured { factor, texture },
            None => Color::rgb(factor.x, factor.y, factor.z),
        }
    }

    /// Reflectance at the wavelengths of a path, 0 to 1; the colours of the mesh's vertices multiply it, but for measured reflectances.
    #[inline]
    pub fn sample(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match self {
            Color::Constant { sigmoid, .. } if surface.color == Vec4::ONE => sigmoid.sample(wavelengths),
            Color::Spectrum(measured) if !wavelengths.is_rgb() => measured.spectrum.sample(wavelengths),
            _ if wavelengths.is_rgb() => SampledWavelengths::lanes(self.linear_srgb(surface).clamp(Vec3::ZERO, Vec3::ONE)),
            _ => Sigmoid::from_rgb(self.linear_srgb(surface)).sample(wavelengths),
        }
    }

    /// Linear sRGB at a surface point, times the colour of the mesh's vertices (for the albedo plane; measured reflectances through D65, alone).
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
    /// A factor times a channel (0 R, 1 G, 2 B, 3 A) of an image, if there is one.
    pub(crate) fn with_picture(factor: f32, picture: Option<Texture>, channel: usize) -> Self {
        match picture {
            Some(texture) => Scalar::Textured { factor, texture, channel },
            None => Scalar::Constant(factor),
        }
    }

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

//! Images on surfaces, and the inputs of materials that may be an image or a constant.
//!
//! Texture coordinates follow glTF: (0, 0) is the upper left corner of the image, v runs down.

use crate::shape::Surface;
use diopter_light::color::srgb_decode;
use diopter_light::upsample::Sigmoid;
use diopter_light::{Sampled, Wavelengths};
use glam::{Affine2, Vec2, Vec3, Vec4};
use std::sync::{Arc, OnceLock};

/// How the 8-bit codes of an image relate to numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Codes {
    /// Colour: the sRGB transfer function (alpha is linear).
    Srgb,
    /// Data: code / 255.
    Linear,
}

/// Pixels, 8 bits a channel.
#[derive(Clone, Debug)]
pub struct Image {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// RGBA, row by row from the top.
    pub pixels: Vec<[u8; 4]>,
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
}

impl Wrap {
    #[inline]
    fn index(self, i: i64, n: i64) -> usize {
        (match self {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
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

    fn texel(&self, x: i64, y: i64) -> Vec4 {
        let column = self.wrap[0].index(x, self.image.width as i64);
        let row = self.wrap[1].index(y, self.image.height as i64);
        let [r, g, b, a] = self.image.pixels[row * self.image.width + column];
        match self.codes {
            Codes::Srgb => {
                let t = srgb_table();
                Vec4::new(t[r as usize], t[g as usize], t[b as usize], a as f32 / 255.0)
            }
            Codes::Linear => Vec4::new(r as f32, g as f32, b as f32, a as f32) / 255.0,
        }
    }

    /// RGBA at texture coordinates; linear.
    pub fn at(&self, uv: &[Vec2; 2]) -> Vec4 {
        let p = self.image_from_uv.transform_point2(uv[self.uv_set.min(1)]);
        if !p.is_finite() {
            return Vec4::ZERO;
        }
        let p = p * Vec2::new(self.image.width as f32, self.image.height as f32);
        if self.interpolation == Interpolation::Nearest {
            return self.texel(p.x.floor() as i64, p.y.floor() as i64);
        }
        let p = p - 0.5;
        let (x, y) = (p.x.floor(), p.y.floor());
        let (fx, fy) = (p.x - x, p.y - y);
        let (x, y) = (x as i64, y as i64);
        let top = self.texel(x, y).lerp(self.texel(x + 1, y), fx);
        let bottom = self.texel(x, y + 1).lerp(self.texel(x + 1, y + 1), fx);
        top.lerp(bottom, fy)
    }
}

/// A colour of a material: linear sRGB, possibly from an image, as a spectrum.
#[derive(Clone, Debug)]
pub enum Color {
    /// The same everywhere.
    Constant {
        /// Linear sRGB.
        rgb: Vec3,
        /// Its spectrum.
        sigmoid: Sigmoid,
    },
    /// A measured reflectance.
    Spectrum(diopter_light::Spectrum),
    /// An image times a factor (linear sRGB).
    Textured {
        /// Multiplies the image.
        factor: Vec3,
        /// The image.
        texture: Texture,
    },
}

impl Color {
    /// A constant colour.
    pub fn rgb(r: f32, g: f32, b: f32) -> Self {
        let rgb = Vec3::new(r, g, b);
        Color::Constant { rgb, sigmoid: Sigmoid::from_rgb(rgb) }
    }

    /// Reflectance at the wavelengths of a path; the colours of the mesh's vertices multiply it.
    #[inline]
    pub fn sample(&self, surface: &Surface, wavelengths: &Wavelengths) -> Sampled {
        match self {
            Color::Constant { sigmoid, .. } if surface.color == Vec4::ONE => sigmoid.sample(wavelengths),
            Color::Spectrum(spectrum) => spectrum.sample(wavelengths),
            _ => Sigmoid::from_rgb(self.linear_srgb(surface)).sample(wavelengths),
        }
    }

    /// Linear sRGB at a surface point (for the albedo plane; measured reflectances through D65).
    pub fn linear_srgb(&self, surface: &Surface) -> Vec3 {
        match self {
            Color::Constant { rgb, .. } => *rgb * surface.color.truncate(),
            Color::Spectrum(spectrum) => spectrum_rgb(spectrum),
            Color::Textured { factor, texture } => *factor * texture.at(&surface.uv).truncate() * surface.color.truncate(),
        }
    }
}

fn spectrum_rgb(spectrum: &diopter_light::Spectrum) -> Vec3 {
    use diopter_light::{cie::d65_one_nit, color};
    let d65 = d65_one_nit();
    let xyz = color::xyz_of(|nm| spectrum.at(nm) * d65.at(nm)) * diopter_light::units::LUMINOUS_EFFICACY;
    (color::RgbSpace::Srgb.xyz_from_rgb().inverse() * xyz).as_vec3()
}

/// A number of a material, possibly from a channel of an image.
#[derive(Clone, Debug)]
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
}

impl Scalar {
    /// The number at a surface point.
    #[inline]
    pub fn at(&self, surface: &Surface) -> f32 {
        self.at_uv(&surface.uv)
    }

    /// The number at texture coordinates.
    #[inline]
    pub fn at_uv(&self, uv: &[Vec2; 2]) -> f32 {
        match self {
            Scalar::Constant(value) => *value,
            Scalar::Textured { factor, texture, channel } => factor * texture.at(uv)[*channel],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(wrap: Wrap, interpolation: Interpolation) -> Texture {
        let pixels = vec![[0, 0, 0, 255], [255, 255, 255, 255]];
        let image = Arc::new(Image { width: 2, height: 1, pixels });
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

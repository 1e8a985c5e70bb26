//! Pictures and patterns as glTF writes them.

use super::Writer;
use crate::material_extensions::Sink;
use crate::texture::{Codes, Color, Image, Interpolation, Lookup, Scalar, Texel, Texture, Wrap};
use diopter_light::color::srgb_encode;
use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

impl Writer {
    /// The number of a picture as PNG.
    pub(super) fn image(&mut self, image: &Arc<Image>) -> usize {
        let key = Arc::as_ptr(image) as usize;
        if let Some(number) = self.known.get(&key) {
            return *number;
        }
        if let Texel::Codes16(_) = image.texel(0, 0) {
            let pixels = (0..image.height).flat_map(|row| (0..image.width).map(move |column| image.texel(column, row)));
            let words = |texel| if let Texel::Codes16(words) = texel { words } else { [0; 4] };
            let picture = image::ImageBuffer::from_raw(image.width as u32, image.height as u32, pixels.flat_map(words).collect());
            let number = self.png(picture.map(image::DynamicImage::ImageRgba16));
            self.known.insert(key, number);
            return number;
        }
        let code = |v: f32| (srgb_encode(v.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
        let mut pixels = Vec::with_capacity(image.width * image.height * 4);
        for row in 0..image.height {
            for column in 0..image.width {
                pixels.extend(match image.texel(column, row) {
                    Texel::Codes(codes) => codes,
                    Texel::Codes16(words) | Texel::Wide(words) => {
                        let [r, g, b, a] = words.map(|w| f32::from(w) / 65535.0);
                        [code(r), code(g), code(b), (a * 255.0 + 0.5) as u8]
                    }
                    Texel::Linear([r, g, b, a]) => {
                        if r.max(g).max(b) > 1.0 {
                            self.warn("pictures brighter than white are cut off at white");
                        }
                        [code(r), code(g), code(b), (a * 255.0) as u8]
                    }
                });
            }
        }
        let number = self.png(rgba(image.width, image.height, pixels));
        self.known.insert(key, number);
        number
    }

    pub(super) fn png(&mut self, picture: Option<image::DynamicImage>) -> usize {
        let mut bytes = Vec::new();
        if let Some(picture) = picture
            && let Err(e) = picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
        {
            self.warn(&format!("a picture could not be written: {e}"));
        }
        let view = self.view(bytes, None);
        self.images.push(json!({ "bufferView": view, "mimeType": "image/png" }));
        self.images.len() - 1
    }

    /// A picture of what a function has over the unit square of texture coordinates; codes by the sRGB function, or as they are.
    pub(super) fn baked(&mut self, codes: Codes, f: impl Fn(&[Vec2; 2]) -> Vec4) -> Value {
        const SIDE: usize = 512;
        let encode = |v: f32| match codes {
            Codes::Srgb => srgb_encode(v.clamp(0.0, 1.0)),
            Codes::Linear => v.clamp(0.0, 1.0),
        };
        let mut pixels = Vec::with_capacity(SIDE * SIDE * 4);
        for y in 0..SIDE {
            for x in 0..SIDE {
                let uv = Vec2::new((x as f32 + 0.5) / SIDE as f32, (y as f32 + 0.5) / SIDE as f32);
                let c = f(&[uv; 2]);
                pixels.extend([encode(c.x), encode(c.y), encode(c.z), c.w.clamp(0.0, 1.0)].map(|v| (v * 255.0 + 0.5) as u8));
            }
        }
        let source = self.png(rgba(SIDE, SIDE, pixels));
        self.textures.push(json!({ "source": source }));
        json!({ "index": self.textures.len() - 1 })
    }
}

impl Sink for Writer {
    /// With its wrapping and its transform.
    fn texture(&mut self, texture: &Texture) -> Value {
        let source = self.image(&texture.image);
        let mut wrap = |w: Wrap| match w {
            Wrap::Repeat => 10_497,
            Wrap::Mirror => 33_648,
            Wrap::Clamp => 33_071,
            Wrap::Black => {
                self.warnings.insert("black around a picture is written as its edge going on".into());
                33_071
            }
        };
        let (s, t) = (wrap(texture.wrap[0]), wrap(texture.wrap[1]));
        let filter = if texture.interpolation == Interpolation::Nearest { 9728 } else { 9729 };
        self.samplers.push(json!({ "wrapS": s, "wrapT": t, "magFilter": filter, "minFilter": filter }));
        self.textures.push(json!({ "source": source, "sampler": self.samplers.len() - 1 }));
        let mut info = json!({ "index": self.textures.len() - 1, "texCoord": texture.uv_set.min(1) });
        let m = texture.image_from_uv;
        if m != glam::Affine2::IDENTITY {
            let (x, y) = (m.matrix2.x_axis, m.matrix2.y_axis);
            let rotation = (-x.y).atan2(x.x);
            let (sin, cos) = rotation.sin_cos();
            let scale = [x.length(), y.dot(Vec2::new(sin, cos))];
            self.extensions.insert("KHR_texture_transform");
            info["extensions"] =
                json!({ "KHR_texture_transform": { "offset": m.translation.to_array(), "rotation": rotation, "scale": scale } });
        }
        info
    }

    fn color(&mut self, color: &Color) -> (Vec3, Option<Value>) {
        match color {
            Color::Constant { rgb, .. } => (*rgb, None),
            Color::Spectrum(measured) => (measured.rgb, None),
            Color::Textured { factor, texture } => (*factor, Some(self.texture(texture))),
            Color::Graph(graph) if graph.is_in_space() => {
                self.warn("patterns in space are written as their colour in one place");
                (graph.at(&Lookup { normal: Vec3::Y, ..Lookup::uv(&[Vec2::splat(0.5); 2]) }), None)
            }
            Color::Graph(graph) => {
                self.warn("patterns are written as pictures of one repetition");
                (Vec3::ONE, Some(self.baked(Codes::Srgb, |uv| graph.at(&Lookup::uv(uv)).extend(1.0))))
            }
        }
    }

    fn number(&mut self, scalar: &Scalar) -> f32 {
        match scalar {
            Scalar::Constant(v) => *v,
            other => {
                self.warn("a number of a material that differs from place to place is written as its mean");
                let all: Vec<f32> = (0..256)
                    .map(|i| other.lookup(&Lookup::uv(&[Vec2::new((i % 16) as f32 / 16.0, (i / 16) as f32 / 16.0); 2])))
                    .collect();
                all.iter().sum::<f32>() / 256.0
            }
        }
    }
}

/// A picture of 8-bit codes.
fn rgba(width: usize, height: usize, pixels: Vec<u8>) -> Option<image::DynamicImage> {
    image::RgbaImage::from_raw(width as u32, height as u32, pixels).map(image::DynamicImage::ImageRgba8)
}

//! Pictures of materials: texture nodes, their coordinates and colour spaces, and maps of normals.

use super::{Input, LONGEST_CHAIN, Read, Uses};
use crate::load::usd::layer::Value;
use crate::load::usd::stage::Prim;
use crate::load::usd::world::World;
use crate::load::{note_missing, stand_in, udim};
use crate::texture::levels::linear;
use crate::texture::{Codes, Color, Graph, Image, Interpolation, Scalar, Texel, Texels, Texture, Wrap};
use glam::{Affine2, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// A picture as shaders use it.
pub(super) struct Picture {
    /// None where it is missing.
    texture: Option<Texture>,
    /// What is shown in its place, where its file is not named.
    fallback: Option<Vec4>,
    scale: Vec4,
    bias: Vec4,
    /// 0 to 3: red to alpha; none: the colour.
    channel: Option<usize>,
}

impl World<'_> {
    /// A picture that an input names itself.
    pub(super) fn asset(&mut self, shader: &Arc<Prim>, name: &str, codes: Codes, uses: &mut Uses) -> Read<Option<Texture>> {
        let Input::Value(Value::Text(file), layer) = self.input(shader, name)? else { return Ok(None) };
        if file.is_empty() {
            return Ok(None);
        }
        let uv_set = set_of(uses, "st");
        let picture = match self.picture_file(layer, &file) {
            Some(picture) => picture,
            None if codes == Codes::Srgb => stand_in().into(),
            None => return Ok(None),
        };
        let (wrap, image_from_uv) = (picture.wrap([Wrap::Repeat; 2]), picture.image_from_unit);
        Ok(Some(Texture { codes, uv_set, wrap, image_from_uv, ..Texture::color(picture.image) }))
    }

    /// A map of normals: a picture of which 2c − 1 is taken, times a strength.
    pub(super) fn normal_map(&mut self, shader: &Arc<Prim>, name: &str, uses: &mut Uses) -> Read<Option<(Texture, f32)>> {
        let Input::Shader(mut node, mut output) = self.input(shader, name)? else { return Ok(None) };
        let mut strength = 1.0;
        if self.shader_kind(&node)?.starts_with("ND_normalmap") {
            strength = self.number(&node, "scale", 1.0)?;
            match self.input(&node, "in")? {
                Input::Shader(inner, o) => (node, output) = (inner, o),
                _ => return Ok(None),
            }
        }
        let Some(picture) = self.picture(&node, &output, Codes::Linear, uses)? else {
            self.skip_unsupported("shaders of other kinds");
            return Ok(None);
        };
        // (2, 2, 2) and −1 are the usual scale and bias; without them the picture is meant all the same.
        let scale = if picture.bias.x == 0.0 { 1.0 } else { 0.5 * picture.scale.x.abs() };
        // Scales below 0 invert channels: green runs down in maps made for DirectX.
        let flips = picture.scale.truncate().to_array().map(|s| s < 0.0);
        Ok(picture.texture.map(|t| (Texture { image: self.flipped(&t.image, flips), ..t }, strength * scale)))
    }

    /// A picture with some channels inverted (1 − value).
    fn flipped(&mut self, image: &Arc<Image>, flips: [bool; 3]) -> Arc<Image> {
        if flips == [false; 3] {
            return image.clone();
        }
        let known = self.shaders.flipped.iter().find(|(of, f, _)| Arc::ptr_eq(of, image) && *f == flips);
        if let Some((_, _, made)) = known {
            return made.clone();
        }
        let pixels = (0..image.height).flat_map(|row| (0..image.width).map(move |column| (column, row)));
        let mut codes = Vec::new();
        let mut numbers = Vec::new();
        for (column, row) in pixels {
            match image.texel(column, row) {
                Texel::Codes(mut c) => {
                    (0..3).filter(|i| flips[*i]).for_each(|i| c[i] = 255 - c[i]);
                    codes.push(c);
                }
                other => {
                    let mut c = linear(other, Codes::Linear).to_array();
                    (0..3).filter(|i| flips[*i]).for_each(|i| c[i] = 1.0 - c[i]);
                    numbers.push(c);
                }
            }
        }
        let texels = if numbers.is_empty() { Texels::Codes(codes) } else { Texels::Linear(numbers) };
        let made = Arc::new(Image::of_texels(image.width, image.height, texels));
        self.shaders.flipped.push((image.clone(), flips, made.clone()));
        made
    }

    /// The picture that a shader reads; none of other shaders.
    pub(super) fn picture(&mut self, node: &Arc<Prim>, output: &str, usual: Codes, uses: &mut Uses) -> Read<Option<Picture>> {
        let kind = self.shader_kind(node)?;
        if !(kind.contains("UsdUVTexture") || kind.starts_with("ND_image") || kind.starts_with("ND_tiledimage")) {
            return Ok(None);
        }
        let four = |value: Value| value.floats().and_then(|v| v.first_chunk::<4>().map(|c| Vec4::from_array(*c)));
        let mut factor = [Vec4::ONE, Vec4::ZERO];
        for (slot, name) in factor.iter_mut().zip(["scale", "bias"]) {
            if let Input::Value(value, _) = self.input(node, name)? {
                *slot = four(value).filter(|v| v.is_finite()).unwrap_or(*slot);
            }
        }
        let codes = match self.text(node, "sourceColorSpace")?.as_deref() {
            Some("sRGB") => Codes::Srgb,
            Some("raw") => Codes::Linear,
            // "auto" looks into the file; what the picture is used for tells the same of usual files.
            _ => usual,
        };
        // Where nothing is said the specification has black; files that say nothing mean repeats, and are read so elsewhere (Blender).
        let mut wrap = [Wrap::Repeat; 2];
        for (slot, names) in wrap.iter_mut().zip([["wrapS", "uaddressmode"], ["wrapT", "vaddressmode"]]) {
            for name in names {
                *slot = match self.text(node, name)?.as_deref() {
                    Some("clamp") => Wrap::Clamp,
                    Some("mirror") => Wrap::Mirror,
                    Some("black" | "constant") => Wrap::Black,
                    _ => *slot,
                };
            }
        }
        let st = if kind.contains("UsdUVTexture") { "st" } else { "texcoord" };
        let (varname, transform) = self.coordinates(node, st)?;
        let tiling = match (kind.starts_with("ND_tiledimage"), self.input(node, "uvtiling")?) {
            (true, Input::Value(value, _)) => value.floats().filter(|v| v.len() == 2).map_or(Vec2::ONE, |v| Vec2::from_slice(&v)),
            _ => Vec2::ONE,
        };
        let flip = Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y);
        // What the shader itself names for a picture that cannot be read. Source: OpenUSD, `UsdUVTexture`.
        let said = match self.input(node, "fallback")? {
            Input::Value(value, _) => four(value).filter(|v| v.is_finite()),
            _ => None,
        };
        let (picture, fallback) = match self.input(node, "file")? {
            Input::Value(Value::Text(file), layer) if !file.is_empty() => match self.picture_file(layer, &file) {
                Some(picture) => (Some(picture), None),
                None => (None, said),
            },
            _ => {
                self.skip_unsupported("pictures without a file");
                (None, Some(said.unwrap_or(Vec4::W)))
            }
        };
        let texture = picture.map(|picture| Texture {
            codes,
            wrap: picture.wrap(wrap),
            interpolation: Interpolation::Bilinear,
            uv_set: set_of(uses, &varname),
            image_from_uv: picture.image_from_unit * flip * Affine2::from_scale(tiling) * transform * flip,
            image: picture.image,
        });
        let channel = match output {
            "r" | "outr" => Some(0),
            "g" | "outg" => Some(1),
            "b" | "outb" => Some(2),
            "a" | "outa" => Some(3),
            _ => None,
        };
        Ok(Some(Picture { texture, fallback, scale: factor[0], bias: factor[1], channel }))
    }

    /// The primvar that texture coordinates are read from, and how they are changed on the way (v up).
    fn coordinates(&mut self, node: &Arc<Prim>, name: &str) -> Read<(String, Affine2)> {
        let mut transform = Affine2::IDENTITY;
        let (mut node, mut name) = (node.clone(), name.to_owned());
        for _ in 0..LONGEST_CHAIN {
            let Input::Shader(next, _) = self.input(&node, &name)? else { break };
            let kind = self.shader_kind(&next)?;
            if kind.contains("UsdTransform2d") {
                let two = |world: &mut Self, name: &str, default: Vec2| -> Read<Vec2> {
                    Ok(match world.input(&next, name)? {
                        Input::Value(value, _) => {
                            value.floats().filter(|v| v.len() == 2).map_or(default, |v| Vec2::from_slice(&v))
                        }
                        _ => default,
                    })
                };
                let (scale, shift) = (two(self, "scale", Vec2::ONE)?, two(self, "translation", Vec2::ZERO)?);
                let turn = self.number(&next, "rotation", 0.0)?.to_radians();
                transform *= Affine2::from_scale_angle_translation(scale, turn, shift);
                (node, name) = (next, "in".to_owned());
                continue;
            }
            for varname in ["varname", "geomprop"] {
                if let Some(varname) = self.text(&next, varname)? {
                    return Ok((varname.to_string(), transform));
                }
            }
            break;
        }
        Ok(("st".to_owned(), transform))
    }

    fn picture_file(&mut self, layer: usize, file: &str) -> Option<udim::Picture> {
        let key = self.stage.file_key(layer, file);
        if let Some(known) = self.shaders.pictures.get(&key) {
            return known.clone();
        }
        let read = udim::read(file, &mut |name| self.stage.file(layer, name));
        let picture = read.map_err(|reason| note_missing(&mut self.description.missing_textures, file, reason)).ok();
        self.shaders.pictures.insert(key, picture.clone());
        picture
    }
}

/// Number of a set of texture coordinates by the name of its primvar.
fn set_of(uses: &mut Uses, varname: &str) -> usize {
    let known = uses.uvs.iter().position(|n| n == varname);
    known.unwrap_or_else(|| {
        uses.uvs.push(varname.to_owned());
        uses.uvs.len() - 1
    })
}

impl Picture {
    /// A picture that shines: one image, since lamps have no graphs. Bias and channel are put into its pixels.
    pub fn light(self) -> Color {
        let Picture { texture: Some(texture), fallback: None, scale, bias, channel } = &self else { return self.color() };
        if channel.is_none() && bias.truncate() == Vec3::ZERO {
            return self.color();
        }
        let image = &texture.image;
        let pixels = (0..image.height).flat_map(|row| (0..image.width).map(move |column| image.texel(column, row)));
        let pixels = pixels.map(|texel| {
            let value = *scale * linear(texel, texture.codes) + *bias;
            let rgb = channel.map_or(value.truncate(), |c| Vec3::splat(value[c]));
            rgb.max(Vec3::ZERO).extend(1.0).to_array()
        });
        let made = Image::of_texels(image.width, image.height, Texels::Linear(pixels.collect()));
        Color::Textured { factor: Vec3::ONE, texture: Texture { image: Arc::new(made), ..texture.clone() } }
    }

    /// A channel of it as a graph.
    fn graph(texture: Texture, channel: usize) -> Arc<Graph> {
        let unit = |i: usize| if channel == i { 1.0 } else { 0.0 };
        let as_number = Some([Vec3::new(unit(0), unit(1), unit(2)), Vec3::splat(unit(3))]);
        Arc::new(Graph::Image { texture, scale: 1.0, invert: false, as_number, mapping: None })
    }

    /// bias + scale · picture.
    fn shifted(graph: Arc<Graph>, scale: Vec3, bias: Vec3) -> Arc<Graph> {
        let ends = [bias, bias + scale].map(|v| Arc::new(Graph::Constant(v)));
        let [from, to] = ends;
        Arc::new(Graph::Mix(from, to, graph))
    }

    /// The picture as a colour.
    pub fn color(self) -> Color {
        let (scale, bias) = (self.scale.truncate(), self.bias.truncate());
        if let Some(fallback) = self.fallback {
            // It is not scaled.
            let value = self.channel.map_or(fallback.truncate(), |c| Vec3::splat(fallback[c]));
            return Color::rgb(value.x, value.y, value.z);
        }
        let texture = self.texture.unwrap_or_else(|| Texture::color(stand_in()));
        match self.channel {
            None if bias == Vec3::ZERO => Color::Textured { factor: scale, texture },
            None => {
                let graph = Graph::Image { texture, scale: 1.0, invert: false, as_number: None, mapping: None };
                Color::Graph(Self::shifted(Arc::new(graph), scale, bias))
            }
            Some(c) => {
                Color::Graph(Self::shifted(Self::graph(texture, c), Vec3::splat(self.scale[c]), Vec3::splat(self.bias[c])))
            }
        }
    }

    /// A map of numbers; what the input is without it where it is missing.
    pub fn scalar(self, default: f32) -> Scalar {
        if let Some(fallback) = self.fallback {
            return Scalar::Constant(fallback[self.channel.unwrap_or(0)]);
        }
        let Some(texture) = self.texture else { return Scalar::Constant(default) };
        let channel = self.channel.unwrap_or(0);
        let (scale, bias) = (self.scale[channel], self.bias[channel]);
        match bias == 0.0 {
            true => Scalar::Textured { factor: scale, texture, channel },
            false => Scalar::Graph(Self::shifted(Self::graph(texture, channel), Vec3::splat(scale), Vec3::splat(bias))),
        }
    }
}

//! Textures by name, and parameters that may be a number, a colour or a texture.

use super::context::Context;
use super::params::{Params, Values};
use super::spectra::{self, Use};
use super::{Fault, Place};
use crate::load::STAND_IN;
use crate::texture::{Codes, Color, Graph, Image, Interpolation, Mapping, NoisePattern, Scalar, Texture, Wrap};
use diopter_light::Spectrum;
use glam::{Affine2, Affine3A, Vec2, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// All textures that were named so far.
#[derive(Default)]
pub struct Textures {
    floats: HashMap<String, Arc<Graph>>,
    spectra: HashMap<String, Arc<Graph>>,
    images: HashMap<(String, bool), Arc<Image>>,
}

/// Most textures that one is made of, counted as often as they are looked up.
const MOST_LOOKUPS: usize = 512;

/// Mean of three numbers of a colour: what a picture is worth as a number.
const MEAN: Vec3 = Vec3::splat(1.0 / 3.0);

impl Textures {
    /// A `Texture` directive. Fails where its type or class is not known, a parameter is out of range, a texture that it names is not there, its own name is taken, or it
    /// has too many parts.
    pub fn make(&mut self, context: &mut Context, name: &str, kind: &str, class: &str, p: &Params) -> Result<(), Fault> {
        let float = match kind {
            "float" => true,
            "spectrum" | "color" => false,
            _ => return Err(p.place.fault(format!("a texture of type \"{kind}\""), "float or spectrum")),
        };
        let graph = self.graph(context, float, class, p)?;
        if graph.lookups() > MOST_LOOKUPS {
            return Err(p
                .place
                .fault(format!("texture \"{name}\" of more than {MOST_LOOKUPS} others"), "fewer within each other"));
        }
        let all = if float { &mut self.floats } else { &mut self.spectra };
        match all.insert(name.to_owned(), Arc::new(graph)) {
            None => Ok(()),
            Some(_) => Err(p.place.fault(format!("a second texture \"{name}\""), "one of each name and type")),
        }
    }

    fn graph(&mut self, context: &mut Context, float: bool, class: &str, p: &Params) -> Result<Graph, Fault> {
        let of = |this: &Self, context: &mut Context, name: &str, default: f32| this.part(context, float, p, name, default);
        Ok(match class {
            "constant" => (*of(self, context, "value", 1.0)?).clone(),
            "scale" => {
                // Older files call the two tex1 and tex2.
                let old = p.get("tex1").is_some();
                let a = of(self, context, if old { "tex1" } else { "tex" }, 1.0)?;
                let b = match old {
                    true => of(self, context, "tex2", 1.0)?,
                    false => self.part(context, true, p, "scale", 1.0)?,
                };
                Graph::Scale(a, b)
            }
            "mix" => Graph::Mix(
                of(self, context, "tex1", 0.0)?,
                of(self, context, "tex2", 1.0)?,
                self.part(context, true, p, "amount", 0.5)?,
            ),
            "checkerboard" => {
                let texture_from_world = context.texture_from_world();
                match p.integer("dimension", 2)? {
                    2 => (),
                    3 => {
                        let (even, odd) = (of(self, context, "tex1", 1.0)?, of(self, context, "tex2", 0.0)?);
                        return Ok(Graph::Cubes { texture_from_world, even, odd });
                    }
                    n => return Err(p.place.fault(format!("a checkerboard of {n} dimensions"), "2 or 3")),
                }
                let place = mapping(context, p)?;
                Graph::Checkerboard { place, even: of(self, context, "tex1", 1.0)?, odd: of(self, context, "tex2", 0.0)? }
            }
            "bilerp" => {
                let corners = [("v00", 0.0), ("v01", 1.0), ("v10", 0.0), ("v11", 1.0)];
                let place = mapping(context, p)?;
                let mut found = Vec::new();
                for (name, default) in corners {
                    let part = of(self, context, name, default)?;
                    found.push(part.constant().ok_or_else(|| p.place.fault(format!("a texture as \"{name}\""), "a value"))?);
                }
                Graph::Bilinear { place, corners: [found[0], found[1], found[2], found[3]] }
            }
            "imagemap" => self.image_map(context, float, p)?,
            "dots" => {
                let place = mapping(context, p)?;
                Graph::Dots { place, inside: of(self, context, "inside", 1.0)?, outside: of(self, context, "outside", 0.0)? }
            }
            "fbm" | "wrinkled" | "windy" | "marble" => {
                let octaves = || {
                    let n = p.integer("octaves", 8)?;
                    let n = u32::try_from(n).ok().filter(|n| *n <= 32);
                    let roughness = p.float("roughness", 0.5)? as f32;
                    n.map(|n| (n, roughness)).ok_or_else(|| p.place.fault("octaves out of range", "0 to 32"))
                };
                let mut texture_from_world = context.texture_from_world();
                let pattern = match class {
                    "windy" => NoisePattern::Windy,
                    "fbm" => octaves().map(|(n, r)| NoisePattern::Fbm(n, r))?,
                    "wrinkled" => octaves().map(|(n, r)| NoisePattern::Wrinkled(n, r))?,
                    _ if float => return Err(p.place.fault("marble as a number", "a spectrum texture: marble has colours")),
                    _ => {
                        texture_from_world =
                            Affine3A::from_scale(Vec3::splat(p.float("scale", 1.0)? as f32)) * texture_from_world;
                        let variation = p.float("variation", 0.2)? as f32;
                        octaves().map(|(n, r)| NoisePattern::Marble(n, r, variation))?
                    }
                };
                Graph::Noise { texture_from_world, pattern }
            }
            "directionmix" => {
                let dir = p.vector("dir", Vec3::Y)?;
                let direction = context.texture_from_world().inverse().transform_vector3(dir).try_normalize();
                let direction =
                    direction.ok_or_else(|| p.place.fault("a \"dir\" without a length", "a direction, such as [0 1 0]"))?;
                Graph::DirectionMix { along: of(self, context, "tex1", 0.0)?, across: of(self, context, "tex2", 1.0)?, direction }
            }
            other => {
                let known =
                    "constant, scale, mix, directionmix, checkerboard, bilerp, imagemap, dots, fbm, wrinkled, windy or marble";
                return Err(p.place.fault(format!("texture \"{other}\""), known));
            }
        })
    }

    /// A parameter of a texture: a texture or a value.
    fn part(&self, context: &mut Context, float: bool, p: &Params, name: &str, default: f32) -> Result<Arc<Graph>, Fault> {
        let Some(param) = p.get(name) else { return Ok(Arc::new(Graph::Constant(Vec3::splat(default)))) };
        match &param.values {
            Values::Texts(t) if param.kind == "texture" => self.named(float, t.first().map_or("", String::as_str), param.place),
            _ => {
                let rgb = match spectra::of(context, param, Use::Unbounded)? {
                    Spectrum::Constant(v) => Vec3::splat(v),
                    spectrum => match (&param.values, param.kind.as_str()) {
                        (Values::Numbers(n), "rgb") => Vec3::new(n[0] as f32, n[1] as f32, n[2] as f32),
                        _ => crate::texture::spectrum_rgb(&spectrum),
                    },
                };
                Ok(Arc::new(Graph::Constant(rgb)))
            }
        }
    }

    fn named(&self, float: bool, name: &str, place: Place) -> Result<Arc<Graph>, Fault> {
        let all = if float { &self.floats } else { &self.spectra };
        all.get(name).cloned().ok_or_else(|| {
            let near = diopter_light::names::nearest(name, all.keys().map(String::as_str));
            let hint = near.map_or("one that was defined before".to_owned(), |n| {
                format!("one that was defined before (did you mean \"{n}\"?)")
            });
            place.fault(format!("{} texture \"{name}\"", if float { "float" } else { "spectrum" }), hint)
        })
    }

    fn image_map(&mut self, context: &mut Context, float: bool, p: &Params) -> Result<Graph, Fault> {
        let name =
            p.text("filename")?.ok_or_else(|| p.place.fault("an imagemap without filename", "\"string filename\""))?.to_owned();
        let png = name.to_lowercase().ends_with(".png");
        let exponent = |text: &str| text.strip_prefix("gamma ")?.trim().parse().ok().filter(|g: &f32| *g > 0.0 && g.is_finite());
        let (codes, gamma) = match p.text("encoding")? {
            None => (Codes::Srgb, None),
            // Only of PNG files is it asked, as in pbrt.
            Some("linear") if png => (Codes::Linear, None),
            Some("sRGB" | "srgb" | "linear") => (Codes::Srgb, None),
            Some(text) if let Some(gamma) = exponent(text) => match png {
                true => (Codes::Linear, Some(gamma)),
                false => (Codes::Srgb, None),
            },
            Some(other) => return Err(p.place.fault(format!("encoding \"{other}\""), "sRGB, linear or gamma and a number")),
        };
        let wrap = match p.text("wrap")? {
            None | Some("repeat") => Wrap::Repeat,
            Some("clamp") => Wrap::Clamp,
            Some("black") => Wrap::Black,
            Some(other) => return Err(p.place.fault(format!("wrap \"{other}\""), "repeat, clamp or black")),
        };
        let interpolation = match p.text("filter")? {
            Some("point") => Interpolation::Nearest,
            None | Some("bilinear" | "trilinear" | "ewa" | "EWA") => Interpolation::Bilinear,
            Some(other) => return Err(p.place.fault(format!("filter \"{other}\""), "bilinear, point, trilinear or ewa")),
        };
        p.get("maxanisotropy");
        let (scale, invert) = (p.float("scale", 1.0)? as f32, p.bool("invert", false)?);
        let place = mapping(context, p)?;
        let image = match self.images.get(&(name.clone(), float)) {
            Some(image) => image.clone(),
            None => {
                let Some(image) = context.picture(&name).map(Arc::new) else {
                    // A number without its picture is 1: fully opaque, fully rough.
                    return Ok(Graph::Constant(if float { Vec3::ONE } else { STAND_IN }));
                };
                self.images.insert((name.clone(), float), image.clone());
                image
            }
        };
        // Rows count from below.
        let (mapping, [s, t]) = match place {
            Mapping::Uv(factors) => (None, factors),
            other => (Some(other), [[1.0, 0.0]; 2]),
        };
        let image_from_uv = Affine2::from_scale_angle_translation(Vec2::new(s[0], -t[0]), 0.0, Vec2::new(s[1], 1.0 - t[1]));
        // As a number a picture is its alpha where it has any, else the mean of its colours.
        let alpha = float && image.has_alpha();
        let weights = match (float, alpha) {
            (false, _) => None,
            (true, true) => Some([Vec3::ZERO, Vec3::ONE]),
            (true, false) => Some([MEAN, Vec3::ZERO]),
        };
        let texture = Texture { image, codes, wrap: [wrap; 2], interpolation, uv_set: 0, image_from_uv };
        let Some(gamma) = gamma else { return Ok(Graph::Image { texture, scale, invert, as_number: weights, mapping }) };
        // Codes to light, and then what is made of that.
        let picture = Graph::Image { texture, scale: 1.0, invert: false, as_number: weights, mapping };
        let mut light = Graph::Power(Arc::new(picture), gamma);
        let constant = |v: f32| Arc::new(Graph::Constant(Vec3::splat(v)));
        if scale != 1.0 {
            light = Graph::Scale(Arc::new(light), constant(scale));
        }
        if invert {
            light = Graph::Mix(constant(1.0), constant(0.0), Arc::new(light));
        }
        Ok(light)
    }

    /// A number of a material or shape that may be a texture. Fails where it is neither one number nor a texture that is there.
    pub fn scalar(&self, context: &mut Context, p: &Params, name: &str, default: f32) -> Result<Scalar, Fault> {
        let Some(param) = p.get(name) else { return Ok(Scalar::Constant(default)) };
        match (&param.values, param.kind.as_str()) {
            (Values::Numbers(n), "float") if n.len() == 1 => Ok(Scalar::Constant(n[0] as f32)),
            (Values::Texts(_), "texture") => Ok(match self.part(context, true, p, name, default)? {
                graph if graph.constant().is_some() => Scalar::Constant(graph.constant().unwrap_or_default().x),
                graph => Scalar::Graph(graph),
            }),
            _ => Err(param.place.fault(format!("\"{} {name}\"", param.kind), format!("\"float {name}\" or \"texture {name}\""))),
        }
    }

    /// The texture of a parameter of any size; `None` where it is a value.
    pub fn unbounded(&self, context: &mut Context, p: &Params, name: &str) -> Result<Option<Arc<Graph>>, Fault> {
        match p.get(name) {
            Some(param) if param.kind == "texture" => self.part(context, false, p, name, 0.0).map(Some),
            _ => Ok(None),
        }
    }

    /// A reflectance that may be a texture. Fails where a value is not within 0 to 1, it is of no type that is a colour, or the texture is not there.
    pub fn color(&self, context: &mut Context, p: &Params, name: &str, default: f32) -> Result<Color, Fault> {
        let Some(param) = p.get(name) else { return Ok(Color::rgb(default, default, default)) };
        if param.kind == "texture" {
            let graph = self.part(context, false, p, name, default)?;
            return Ok(match graph.constant() {
                Some(c) => Color::rgb(c.x, c.y, c.z),
                None => Color::Graph(graph),
            });
        }
        Ok(match spectra::of(context, param, Use::Albedo)? {
            Spectrum::Sigmoid(_) => match &param.values {
                Values::Numbers(n) => Color::rgb(n[0] as f32, n[1] as f32, n[2] as f32),
                _ => Color::rgb(default, default, default),
            },
            Spectrum::Constant(v) => Color::rgb(v, v, v),
            spectrum => Color::spectrum(spectrum),
        })
    }
}

/// How a texture's coordinates are found.
fn mapping(context: &Context, p: &Params) -> Result<Mapping, Fault> {
    let number = |name: &str, default: f64| p.float(name, default).map(|v| v as f32);
    let place = context.texture_from_world();
    Ok(match p.text("mapping")? {
        None | Some("uv") => {
            Mapping::Uv([[number("uscale", 1.0)?, number("udelta", 0.0)?], [number("vscale", 1.0)?, number("vdelta", 0.0)?]])
        }
        Some("spherical") => Mapping::Spherical(place),
        Some("cylindrical") => Mapping::Cylindrical(place),
        Some("planar") => {
            let axes = [p.vector("v1", Vec3::X)?, p.vector("v2", Vec3::Y)?];
            Mapping::Planar(place, axes, Vec2::new(number("udelta", 0.0)?, number("vdelta", 0.0)?))
        }
        Some(other) => return Err(p.place.fault(format!("mapping \"{other}\""), "uv, spherical, cylindrical or planar")),
    })
}

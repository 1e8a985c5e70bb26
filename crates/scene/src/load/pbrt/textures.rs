//! Textures by name, and parameters that may be a number, a colour or a texture.

use super::params::{Params, Values};
use super::spectra::{self, Use};
use super::world::World;
use super::{Fault, Place};
use crate::texture::{Codes, Color, Graph, Image, Interpolation, Scalar, Texture, Wrap};
use diopter_light::Spectrum;
use glam::{Affine2, Vec2, Vec3};
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
    /// A `Texture` directive.
    pub fn make(&mut self, world: &mut World, name: &str, kind: &str, class: &str, p: &Params) -> Result<(), Fault> {
        let float = match kind {
            "float" => true,
            "spectrum" | "color" => false,
            _ => return Err(p.place.fault(format!("a texture of type \"{kind}\""), "float or spectrum")),
        };
        let graph = self.graph(world, float, class, p)?;
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

    fn graph(&mut self, world: &mut World, float: bool, class: &str, p: &Params) -> Result<Graph, Fault> {
        let of = |this: &Self, world: &mut World, name: &str, default: f32| this.part(world, float, p, name, default);
        Ok(match class {
            "constant" => (*of(self, world, "value", 1.0)?).clone(),
            "scale" => {
                // Older files call the two tex1 and tex2.
                let old = p.get("tex1").is_some();
                let a = of(self, world, if old { "tex1" } else { "tex" }, 1.0)?;
                let b = match old {
                    true => of(self, world, "tex2", 1.0)?,
                    false => self.part(world, true, p, "scale", 1.0)?,
                };
                Graph::Scale(a, b)
            }
            "mix" => Graph::Mix(
                of(self, world, "tex1", 0.0)?,
                of(self, world, "tex2", 1.0)?,
                self.part(world, true, p, "amount", 0.5)?,
            ),
            "checkerboard" => {
                if p.integer("dimension", 2)? != 2 {
                    return Err(p.place.fault("a checkerboard of three dimensions", "dimension 2: others are not supported"));
                }
                let place = uv_mapping(p)?;
                Graph::Checkerboard { place, even: of(self, world, "tex1", 1.0)?, odd: of(self, world, "tex2", 0.0)? }
            }
            "bilerp" => {
                let corners = [("v00", 0.0), ("v01", 1.0), ("v10", 0.0), ("v11", 1.0)];
                let place = uv_mapping(p)?;
                let mut found = Vec::new();
                for (name, default) in corners {
                    let part = of(self, world, name, default)?;
                    found.push(part.constant().ok_or_else(|| p.place.fault(format!("a texture as \"{name}\""), "a value"))?);
                }
                Graph::Bilinear { place, corners: [found[0], found[1], found[2], found[3]] }
            }
            "imagemap" => self.image_map(world, float, p)?,
            other => {
                let known = "constant, scale, mix, checkerboard, bilerp or imagemap: others are not supported yet";
                return Err(p.place.fault(format!("texture \"{other}\""), known));
            }
        })
    }

    /// A parameter of a texture: a texture or a value.
    fn part(&self, world: &mut World, float: bool, p: &Params, name: &str, default: f32) -> Result<Arc<Graph>, Fault> {
        let Some(param) = p.get(name) else { return Ok(Arc::new(Graph::Constant(Vec3::splat(default)))) };
        match &param.values {
            Values::Texts(t) if param.kind == "texture" => self.named(float, t.first().map_or("", String::as_str), param.place),
            _ => {
                let rgb = match spectra::of(world, param, Use::Unbounded)? {
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

    fn image_map(&mut self, world: &mut World, float: bool, p: &Params) -> Result<Graph, Fault> {
        let name =
            p.text("filename")?.ok_or_else(|| p.place.fault("an imagemap without filename", "\"string filename\""))?.to_owned();
        let png = name.to_lowercase().ends_with(".png");
        let codes = match p.text("encoding")? {
            None => Codes::Srgb,
            // Only of PNG files is it asked, as in pbrt.
            Some("linear") if png => Codes::Linear,
            Some("sRGB" | "srgb" | "linear") => Codes::Srgb,
            Some(other) => {
                return Err(p.place.fault(format!("encoding \"{other}\""), "sRGB or linear: others are not supported"));
            }
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
        let image = match self.images.get(&(name.clone(), float)) {
            Some(image) => image.clone(),
            None => {
                let bytes = world.file(&name, p.place)?;
                let image = crate::load::read_picture(&bytes)
                    .map_err(|e| p.place.fault(format!("{name}: {e}"), "a picture (PNG, JPEG)"))?;
                let image = Arc::new(image);
                self.images.insert((name.clone(), float), image.clone());
                image
            }
        };
        // Rows count from below.
        let [s, t] = uv_mapping(p)?;
        let image_from_uv = Affine2::from_scale_angle_translation(Vec2::new(s[0], -t[0]), 0.0, Vec2::new(s[1], 1.0 - t[1]));
        // As a number a picture is its alpha where it has any, else the mean of its colours.
        let alpha = float && image.pixels.iter().any(|p| p[3] != 255);
        let weights = match (float, alpha) {
            (false, _) => None,
            (true, true) => Some([Vec3::ZERO, Vec3::ONE]),
            (true, false) => Some([MEAN, Vec3::ZERO]),
        };
        let texture = Texture { image, codes, wrap: [wrap; 2], interpolation, uv_set: 0, image_from_uv };
        Ok(Graph::Image { texture, scale, invert, as_number: weights })
    }

    /// A number of a material or shape that may be a texture.
    pub fn scalar(&self, world: &mut World, p: &Params, name: &str, default: f32) -> Result<Scalar, Fault> {
        let Some(param) = p.get(name) else { return Ok(Scalar::Constant(default)) };
        match (&param.values, param.kind.as_str()) {
            (Values::Numbers(n), "float") if n.len() == 1 => Ok(Scalar::Constant(n[0] as f32)),
            (Values::Texts(_), "texture") => Ok(match self.part(world, true, p, name, default)? {
                graph if graph.constant().is_some() => Scalar::Constant(graph.constant().unwrap_or_default().x),
                graph => Scalar::Graph(graph),
            }),
            _ => Err(param.place.fault(format!("\"{} {name}\"", param.kind), format!("\"float {name}\" or \"texture {name}\""))),
        }
    }

    /// A reflectance that may be a texture.
    pub fn color(&self, world: &mut World, p: &Params, name: &str, default: f32) -> Result<Color, Fault> {
        let Some(param) = p.get(name) else { return Ok(Color::rgb(default, default, default)) };
        if param.kind == "texture" {
            let graph = self.part(world, false, p, name, default)?;
            return Ok(match graph.constant() {
                Some(c) => Color::rgb(c.x, c.y, c.z),
                None => Color::Graph(graph),
            });
        }
        Ok(match spectra::of(world, param, Use::Albedo)? {
            Spectrum::Sigmoid(_) => match &param.values {
                Values::Numbers(n) => Color::rgb(n[0] as f32, n[1] as f32, n[2] as f32),
                _ => Color::rgb(default, default, default),
            },
            Spectrum::Constant(v) => Color::rgb(v, v, v),
            spectrum => Color::Spectrum(spectrum),
        })
    }
}

/// Factor and offset of u and of v.
fn uv_mapping(p: &Params) -> Result<[[f32; 2]; 2], Fault> {
    match p.text("mapping")? {
        None | Some("uv") => (),
        Some(other) => return Err(p.place.fault(format!("mapping \"{other}\""), "uv: others are not supported yet")),
    }
    let number = |name: &str, default: f64| p.float(name, default).map(|v| v as f32);
    Ok([[number("uscale", 1.0)?, number("udelta", 0.0)?], [number("vscale", 1.0)?, number("vdelta", 0.0)?]])
}

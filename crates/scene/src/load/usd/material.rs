//! Materials: networks of shaders that end in a UsdPreviewSurface, MaterialX's standard surface or Omniverse's OmniPBR.
//!
//! Sources: OpenUSD, "UsdPreviewSurface Specification" 2.6, `UsdShade`; MaterialX 1.38 specification (standard_surface, image); NVIDIA,
//! OmniPBR.mdl. A transparent surface (`opacityMode` "transparent" and one `opacity` for all of it) is a thin dielectric: it keeps its reflections, and
//! what it lets through is not bent.

mod pictures;

use super::layer::Value;
use super::light::{MaterialSync, MeshLight};
use super::material_binding::{Bound, DisplayColor};
use super::stage::Prim;
use super::world::World;
use crate::SceneError;
use crate::light::Modulation;
use crate::material::{Coverage, Emission, EmissionColor, Material, Principled, Scattering};
use crate::texture::levels::linear;
use crate::texture::{Codes, Color, Scalar};
use diopter_light::{Spectrum, color};
use glam::Vec3;
use std::sync::Arc;

/// Most shaders between a material and a value.
const LONGEST_CHAIN: usize = 32;
/// Largest reflectance at normal incidence that a specular colour makes: an index of 198.
const MOST_SPECULAR: f32 = 0.98;
/// Reflectance of what says nothing of itself.
const GREY: f32 = 0.6;

type Read<T> = Result<T, SceneError>;

/// Where the value of an input comes from.
enum Input {
    Absent,
    Value(Value, usize),
    Shader(Arc<Prim>, String),
}

/// What is gathered about a material on the way.
struct Uses {
    uvs: Vec<String>,
    /// What readers of display colours get.
    display_color: DisplayColor,
    colors: bool,
    displacement: Option<Arc<Scalar>>,
}

impl World<'_> {
    /// What has no material: grey, its display colour, or the colours of its vertices; opaque unless it says otherwise.
    pub fn plain(&mut self, color: Option<Vec3>, opacity: Option<f32>, has_colors: bool) -> Bound {
        let color = if has_colors { Some(Vec3::ONE) } else { color };
        let opacity = opacity.unwrap_or(1.0);
        let key = (color.map(|c| c.to_array().map(f32::to_bits)), opacity.to_bits());
        if let Some(number) = self.shaders.plain.get(&key) {
            return Bound { number: *number, uvs: vec![], colors: has_colors, displacement: None };
        }
        let number = self.push_material(Self::display_color(color.unwrap_or(Vec3::splat(GREY)), opacity));
        self.shaders.plain.insert(key, number);
        Bound { number, uvs: vec![], colors: has_colors, displacement: None }
    }

    /// The material of a display colour and opacity.
    pub fn display_color(color: Vec3, opacity: f32) -> Material {
        let rgb = color.clamp(Vec3::ZERO, Vec3::ONE);
        let coverage = if opacity < 1.0 { Coverage::Blend(Scalar::Constant(opacity)) } else { Coverage::Full };
        Material { coverage, ..Material::new("display colour", Scattering::Diffuse(Color::rgb(rgb.x, rgb.y, rgb.z))) }
    }

    /// The material of a mesh that is a light: it emits on its front. Emission of its own tints the light, as `materialGlowTintsLight` has it.
    pub fn shining(&mut self, bound: Bound, light: Option<&MeshLight>) -> Bound {
        let Some(MeshLight { spectrum, sync }) = light else { return bound };
        let rgb = color::srgb_of_light(|nm| spectrum.at(nm)).max(Vec3::ZERO);
        let key = (bound.number, rgb.to_array().map(f32::to_bits));
        if let Some(number) = self.shaders.shining.get(&key) {
            return Bound { number: *number, ..bound };
        }
        let own = self.description.materials[bound.number as usize].clone();
        let radiance = match own.emission.as_ref().map(|e| &e.radiance).filter(|_| *sync == MaterialSync::GlowTintsLight) {
            Some(EmissionColor::Textured { factor, texture }) => {
                EmissionColor::Textured { factor: *factor * rgb, texture: texture.clone() }
            }
            Some(EmissionColor::Constant(glow)) => {
                EmissionColor::Constant(Spectrum::light_from_rgb(color::srgb_of_light(|nm| glow.at(nm)).max(Vec3::ZERO) * rgb))
            }
            _ => EmissionColor::Constant(spectrum.clone()),
        };
        let emission = Some(Emission { radiance, two_sided: false, is_light: true, modulation: Modulation::Steady });
        let scattering = if *sync == MaterialSync::NoMaterial { Scattering::Black } else { own.scattering.clone() };
        let number = self.push_material(Material { emission, scattering, ..own });
        self.shaders.shining.insert(key, number);
        Bound { number, ..bound }
    }

    /// Adds a material; gives its number.
    pub fn push_material(&mut self, material: Material) -> u32 {
        self.description.materials.push(material);
        self.description.materials.len() as u32 - 1
    }

    /// The material of a path for what has such display colours; `None` of one that cannot be read.
    pub fn material(&mut self, path: &str, color: DisplayColor) -> Read<Option<Bound>> {
        // Those that do not read display colours are the same for all.
        let color = if self.reads_display_color(path)? { color } else { DisplayColor::OfPrim };
        let key = (path.to_owned(), color);
        if let Some(known) = self.shaders.by_path.get(&key) {
            return Ok(known.clone());
        }
        let made = self.read_material(path, color)?;
        self.shaders.by_path.insert(key, made.clone());
        Ok(made)
    }

    /// Whether a shader of a material reads `primvars:displayColor`.
    pub fn reads_display_color(&mut self, path: &str) -> Read<bool> {
        if let Some(known) = self.shaders.display_readers.get(path) {
            return Ok(*known);
        }
        let mut open: Vec<Arc<Prim>> = self.stage.prim(path)?.into_iter().collect();
        let mut reads = false;
        while let (Some(prim), false) = (open.pop(), reads) {
            reads =
                &*self.stage.type_name(&prim)? == "Shader" && self.primvar_read(&prim)?.is_some_and(|v| &*v == "displayColor");
            open.extend(self.stage.children(&prim)?);
        }
        self.shaders.display_readers.insert(path.to_owned(), reads);
        Ok(reads)
    }

    /// The primvar that a shader reads, without a name an empty one; `None` of other shaders.
    fn primvar_read(&mut self, shader: &Arc<Prim>) -> Read<Option<Arc<str>>> {
        let kind = self.shader_kind(shader)?;
        if !kind.contains("PrimvarReader") && !kind.starts_with("ND_geompropvalue") {
            return Ok(None);
        }
        let varname = match self.text(shader, "varname")? {
            Some(varname) => Some(varname),
            None => self.text(shader, "geomprop")?,
        };
        Ok(Some(varname.unwrap_or_else(|| "".into())))
    }

    fn read_material(&mut self, path: &str, display_color: DisplayColor) -> Read<Option<Bound>> {
        let Some(prim) = self.stage.prim(path)? else {
            self.skip_unsupported("bindings to materials that are not there");
            return Ok(None);
        };
        // Copies of one asset share their materials.
        let mut opinions = self.stage.fingerprint(&prim);
        let mut open = self.stage.children(&prim)?;
        while let Some(child) = open.pop() {
            opinions.extend(self.stage.fingerprint(&child));
            open.extend(self.stage.children(&child)?);
        }
        let opinions = (opinions, display_color);
        if let Some(known) = self.shaders.by_opinions.get(&opinions) {
            return Ok(Some(known.clone()));
        }
        let mut surface = None;
        for output in ["outputs:surface", "outputs:mtlx:surface", "outputs:mdl:surface"] {
            if surface.is_none() {
                surface = self.shader(&prim, output)?;
            }
        }
        let mut uses = Uses { uvs: vec![], display_color, colors: false, displacement: None };
        let made = match surface {
            Some((shader, _)) => self.surface(&prim, &shader, &mut uses)?,
            None => None,
        };
        let Some(made) = made else {
            self.skip_unsupported("materials without UsdPreviewSurface, standard_surface or OmniPBR: display colours are shown");
            return Ok(None);
        };
        if uses.uvs.len() > 2 {
            self.skip_unsupported("texture coordinates beyond two sets of a material");
            uses.uvs.truncate(2);
        }
        let Uses { uvs, colors, displacement, .. } = uses;
        let bound = Bound { number: self.push_material(made), uvs, colors, displacement };
        self.shaders.by_opinions.insert(opinions, bound.clone());
        Ok(Some(bound))
    }

    /// The shader that an attribute is connected to, through groups and their interfaces, and its output.
    fn shader(&mut self, prim: &Arc<Prim>, attribute: &str) -> Read<Option<(Arc<Prim>, String)>> {
        Ok(match self.followed(prim, attribute)? {
            Input::Shader(shader, output) => Some((shader, output)),
            _ => None,
        })
    }

    fn followed(&mut self, prim: &Arc<Prim>, attribute: &str) -> Read<Input> {
        let (mut prim, mut attribute) = (prim.clone(), attribute.to_owned());
        for _ in 0..LONGEST_CHAIN {
            let Some((path, property)) = self.stage.source(&prim, &attribute)? else {
                return Ok(match self.stage.attribute(&prim, &attribute)? {
                    Some(found) => {
                        if matches!(&found.value, Value::Samples(list) if list.len() > 1) {
                            self.skip_unsupported("materials that change");
                        }
                        match self.stage.at_start(&found)? {
                            Some(value) => Input::Value(value, found.layer),
                            None => Input::Absent,
                        }
                    }
                    None => Input::Absent,
                });
            };
            let Some(next) = self.stage.prim(&path)? else { return Ok(Input::Absent) };
            if &*self.stage.type_name(&next)? == "Shader" {
                let output = property.strip_prefix("outputs:").unwrap_or(&property).to_owned();
                return Ok(Input::Shader(next, output));
            }
            (prim, attribute) = (next, property);
        }
        Ok(Input::Absent)
    }

    fn input(&mut self, shader: &Arc<Prim>, name: &str) -> Read<Input> {
        self.followed(shader, &format!("inputs:{name}"))
    }

    /// A plain number of an input; none where a shader makes it.
    fn number(&mut self, shader: &Arc<Prim>, name: &str, default: f32) -> Read<f32> {
        Ok(match self.input(shader, name)? {
            Input::Value(value, _) => value.number().map(|v| v as f32).filter(|v| v.is_finite()).unwrap_or(default),
            _ => default,
        })
    }

    fn text(&mut self, shader: &Arc<Prim>, name: &str) -> Read<Option<Arc<str>>> {
        Ok(match self.input(shader, name)? {
            Input::Value(value, _) => value.text().cloned(),
            _ => None,
        })
    }

    /// What kind of shader a prim is: the identifier of its node, or of its MDL material.
    fn shader_kind(&mut self, shader: &Prim) -> Read<String> {
        for name in ["info:id", "info:mdl:sourceAsset:subIdentifier"] {
            if let Some(id) = self.stage.value(shader, name)?.as_ref().and_then(Value::text) {
                return Ok(id.to_string());
            }
        }
        Ok(String::new())
    }

    fn surface(&mut self, material: &Prim, shader: &Arc<Prim>, uses: &mut Uses) -> Read<Option<Material>> {
        let made = match self.shader_kind(shader)?.as_str() {
            "UsdPreviewSurface" | "ND_UsdPreviewSurface_surfaceshader" => self.preview_surface(shader, uses)?,
            "ND_standard_surface_surfaceshader" => self.standard_surface(shader, uses)?,
            "OmniPBR" | "OmniPBR_Opacity" => self.omni_pbr(shader, uses)?,
            _ => return Ok(None),
        };
        Ok(Some(Material { name: material.name().to_owned(), ..made }))
    }

    fn preview_surface(&mut self, shader: &Arc<Prim>, uses: &mut Uses) -> Read<Material> {
        let base = self.color(shader, "diffuseColor", Vec3::splat(0.18), uses)?;
        let mut ior = self.number(shader, "ior", 1.5)?.clamp(1.0, 10.0);
        // Reflectance at normal incidence over that of an index, which is raised where that of the file reflects less than the colour: metals are told so.
        let specular = match self.number(shader, "useSpecularWorkflow", 0.0)? != 0.0 {
            false => None,
            true => {
                let (color, own) = (self.color(shader, "specularColor", Vec3::ZERO, uses)?, ((ior - 1.0) / (ior + 1.0)).powi(2));
                let f0 = own.max(1e-4).max(brightest(&color).min(MOST_SPECULAR));
                if f0 > own {
                    ior = index_of(f0);
                }
                Some(color.times(Vec3::splat(1.0 / f0)))
            }
        };
        let mut p = Principled {
            roughness: self.scalar(shader, "roughness", 0.5, uses)?,
            clearcoat: self.scalar(shader, "clearcoat", 0.0, uses)?,
            clearcoat_roughness: self.scalar(shader, "clearcoatRoughness", 0.01, uses)?,
            ..Principled::new(base, ior)
        };
        match specular {
            Some(color) => (p.specular_color, p.tinted) = (color, true),
            None => p.metallic = self.scalar(shader, "metallic", 0.0, uses)?,
        }
        let opacity = self.scalar(shader, "opacity", 1.0, uses)?;
        let threshold = self.number(shader, "opacityThreshold", 0.0)?;
        let presence = self.text(shader, "opacityMode")?.is_some_and(|m| &*m == "presence");
        let (scattering, coverage) = covered(p, opacity, threshold, presence);
        let mut made = Material { coverage, ..Material::new("", scattering) };
        made.emission = self.glow(shader, "emissiveColor", (Vec3::ZERO, 1.0), uses)?;
        made.normal_map = self.normal_map(shader, "normal", uses)?;
        let height = self.scalar(shader, "displacement", 0.0, uses)?;
        uses.displacement = (!matches!(height, Scalar::Constant(h) if h == 0.0)).then(|| Arc::new(height));
        Ok(made)
    }

    fn standard_surface(&mut self, shader: &Arc<Prim>, uses: &mut Uses) -> Read<Material> {
        let weight = self.number(shader, "base", 0.8)?;
        let base = self.color(shader, "base_color", Vec3::ONE, uses)?.times(Vec3::splat(weight));
        let mut p = Principled {
            metallic: self.scalar(shader, "metalness", 0.0, uses)?,
            roughness: self.scalar(shader, "specular_roughness", 0.2, uses)?,
            specular: self.scalar(shader, "specular", 1.0, uses)?,
            clearcoat: self.scalar(shader, "coat", 0.0, uses)?,
            clearcoat_roughness: self.scalar(shader, "coat_roughness", 0.1, uses)?,
            transmission: self.scalar(shader, "transmission", 0.0, uses)?,
            ..Principled::new(base, self.number(shader, "specular_IOR", 1.5)?.clamp(1.0, 10.0))
        };
        p.tinted = !matches!(p.specular, Scalar::Constant(s) if s == 1.0);
        let mut interior = crate::material::Interior::Same;
        if !matches!(p.transmission, Scalar::Constant(t) if t <= 0.0) {
            p.base_color = self.color(shader, "transmission_color", Vec3::ONE, uses)?;
            if self.number(shader, "thin_walled", 0.0)? == 0.0 {
                p.kind = crate::material::Transmission::Solid;
                interior = crate::material::Interior::Body { medium: None, priority: None };
            }
        }
        let coverage = match self.scalar(shader, "opacity", 1.0, uses)? {
            Scalar::Constant(o) if o >= 1.0 => Coverage::Full,
            opacity => Coverage::Blend(opacity),
        };
        let mut made = Material { coverage, interior, ..Material::new("", Scattering::Principled(Box::new(p))) };
        let weight = self.number(shader, "emission", 0.0)?;
        made.emission = self.glow(shader, "emission_color", (Vec3::ONE, weight), uses)?;
        made.normal_map = self.normal_map(shader, "normal", uses)?;
        Ok(made)
    }

    fn omni_pbr(&mut self, shader: &Arc<Prim>, uses: &mut Uses) -> Read<Material> {
        let tint = self.rgb(shader, "diffuse_tint", Vec3::ONE)?;
        let base = match self.asset(shader, "diffuse_texture", Codes::Srgb, uses)? {
            Some(texture) => Color::Textured { factor: tint, texture },
            None => constant(self.rgb(shader, "diffuse_color_constant", Vec3::splat(0.2))? * tint),
        };
        let mut p = Principled::new(base, 1.5);
        for (name, default) in [("reflection_roughness", 0.5), ("metallic", 0.0)] {
            let own = self.number(shader, &format!("{name}_constant"), default)?;
            let influence = self.number(shader, &format!("{name}_texture_influence"), 0.0)?;
            let picture = match influence > 0.0 {
                true => self.asset(
                    shader,
                    &format!("{}_texture", name.trim_start_matches("reflection_").replace("roughness", "reflectionroughness")),
                    Codes::Linear,
                    uses,
                )?,
                false => None,
            };
            let value = picture.map_or(Scalar::Constant(own), |texture| Scalar::Textured { factor: 1.0, texture, channel: 0 });
            if name == "metallic" {
                p.metallic = value;
            } else {
                p.roughness = value;
            }
        }
        let mut opacity = Scalar::Constant(1.0);
        let mut threshold = 0.0;
        if self.number(shader, "enable_opacity", 0.0)? != 0.0 {
            threshold = self.number(shader, "opacity_threshold", 0.0)?;
            opacity = match self.asset(shader, "opacity_texture", Codes::Linear, uses)? {
                Some(texture) => Scalar::Textured { factor: 1.0, texture, channel: 0 },
                None => Scalar::Constant(self.number(shader, "opacity_constant", 1.0)?),
            };
        }
        let (scattering, coverage) = covered(p, opacity, threshold, true);
        let mut made = Material { coverage, ..Material::new("", scattering) };
        if self.number(shader, "enable_emission", 0.0)? != 0.0 {
            let glow = self.rgb(shader, "emissive_color", Vec3::new(1.0, 0.1, 0.1))?;
            made.emission = glowing(constant(glow), self.number(shader, "emissive_intensity", 40.0)?);
        }
        if let Some(map) = self.asset(shader, "normalmap_texture", Codes::Linear, uses)? {
            made.normal_map = Some((map, self.number(shader, "bump_factor", 1.0)?));
        }
        Ok(made)
    }

    fn rgb(&mut self, shader: &Arc<Prim>, name: &str, default: Vec3) -> Read<Vec3> {
        Ok(match self.input(shader, name)? {
            Input::Value(value, _) => value.floats().filter(|v| v.len() >= 3).map_or(default, |v| Vec3::from_slice(&v)),
            _ => default,
        })
    }

    fn color(&mut self, shader: &Arc<Prim>, name: &str, default: Vec3, uses: &mut Uses) -> Read<Color> {
        Ok(match self.input(shader, name)? {
            Input::Absent => constant(default),
            Input::Value(value, _) => constant(value.floats().map_or(default, |v| match v[..] {
                [r, g, b, ..] => Vec3::new(r, g, b),
                [v] => Vec3::splat(v),
                _ => default,
            })),
            Input::Shader(node, output) => {
                if let Some(primvar) = self.primvar_read(&node)? {
                    if &*primvar != "displayColor" {
                        self.skip_unsupported("primvars that materials ask for");
                        return Ok(constant(self.rgb(&node, "fallback", default)?));
                    }
                    return Ok(constant(match uses.display_color {
                        DisplayColor::OfPrim => {
                            uses.colors = true;
                            Vec3::ONE
                        }
                        DisplayColor::Inherited(color) => Vec3::from_array(color.map(f32::from_bits)),
                        DisplayColor::Absent => self.primvar_fallback(&node)?,
                    }));
                }
                match self.picture(&node, &output, Codes::Srgb, uses)? {
                    Some(picture) => picture.color(),
                    None => {
                        self.skip_unsupported("shaders of other kinds");
                        constant(default)
                    }
                }
            }
        })
    }

    /// What a reader gives where there is no such primvar: 0 where nothing is said.
    fn primvar_fallback(&mut self, reader: &Arc<Prim>) -> Read<Vec3> {
        for name in ["fallback", "default"] {
            if let Input::Value(value, _) = self.input(reader, name)?
                && let Some(v) = value.floats()
            {
                return Ok(if v.len() >= 3 { Vec3::from_slice(&v) } else { Vec3::splat(v.first().copied().unwrap_or(0.0)) });
            }
        }
        Ok(Vec3::ZERO)
    }

    /// Light that an input makes a surface send out; `usual`: its colour without a word of it, and cd/m² for each 1 of the colour.
    fn glow(&mut self, shader: &Arc<Prim>, name: &str, usual: (Vec3, f32), uses: &mut Uses) -> Read<Option<Emission>> {
        let (default, strength) = usual;
        if let Input::Shader(node, output) = self.input(shader, name)?
            && let Some(picture) = self.picture(&node, &output, Codes::Srgb, uses)?
        {
            return Ok(glowing(picture.light(), strength));
        }
        Ok(glowing(self.color(shader, name, default, uses)?, strength))
    }

    fn scalar(&mut self, shader: &Arc<Prim>, name: &str, default: f32, uses: &mut Uses) -> Read<Scalar> {
        Ok(match self.input(shader, name)? {
            Input::Absent => Scalar::Constant(default),
            Input::Value(value, _) => {
                let number = value.floats().and_then(|v| v.first().copied()).filter(|v| v.is_finite());
                Scalar::Constant(number.unwrap_or(default))
            }
            Input::Shader(node, _) if self.primvar_read(&node)?.is_some() => {
                self.skip_unsupported("primvars that materials ask for");
                Scalar::Constant(self.number(&node, "fallback", 0.0)?)
            }
            Input::Shader(node, output) => match self.picture(&node, &output, Codes::Linear, uses)? {
                Some(picture) => picture.scalar(default),
                None => {
                    self.skip_unsupported("shaders of other kinds");
                    Scalar::Constant(default)
                }
            },
        })
    }
}

/// The brightest component that a colour has anywhere.
fn brightest(color: &Color) -> f32 {
    match color {
        Color::Textured { factor, texture } => {
            let image = &texture.image;
            let pixels = (0..image.height).flat_map(|row| (0..image.width).map(move |column| image.texel(column, row)));
            let largest = pixels.map(|texel| linear(texel, texture.codes).truncate() * *factor);
            largest.map(Vec3::max_element).fold(0.0, f32::max)
        }
        other => other.constant_rgb().map_or(1.0, Vec3::max_element),
    }
}

/// The index whose reflectance at normal incidence this is.
fn index_of(f0: f32) -> f32 {
    (1.0 + f0.sqrt()) / (1.0 - f0.sqrt())
}

fn constant(rgb: Vec3) -> Color {
    let rgb = if rgb.is_finite() { rgb.max(Vec3::ZERO) } else { Vec3::ZERO };
    Color::rgb(rgb.x, rgb.y, rgb.z)
}

/// Light that a surface sends out: cd/m² for each 1 of its colour.
fn glowing(color: Color, strength: f32) -> Option<Emission> {
    let radiance = match color {
        Color::Constant { rgb, .. } if (rgb * strength).max_element() > 0.0 => {
            EmissionColor::Constant(Spectrum::light_from_rgb(rgb * strength))
        }
        Color::Textured { factor, texture } if (factor * strength).max_element() > 0.0 => {
            EmissionColor::Textured { factor: factor * strength, texture }
        }
        _ => return None,
    };
    Some(Emission { radiance, two_sided: true, is_light: true, modulation: Modulation::Steady })
}

/// What opacity makes of a surface: holes, or a thin dielectric that keeps its reflections.
fn covered(p: Principled, opacity: Scalar, threshold: f32, presence: bool) -> (Scattering, Coverage) {
    let ior = p.ior;
    let coverage = match opacity {
        Scalar::Constant(o) if o >= 1.0 => Coverage::Full,
        alpha if threshold > 0.0 => Coverage::Mask { alpha, cutoff: threshold },
        Scalar::Constant(o) if !presence => {
            let sheet = Principled {
                roughness: p.roughness.clone(),
                transmission: Scalar::Constant(1.0),
                ..Principled::new(Color::rgb(1.0, 1.0, 1.0), ior)
            };
            let parts = [Scattering::Principled(Box::new(sheet)), Scattering::Principled(Box::new(p))];
            return (Scattering::Mix(Box::new((parts, Scalar::Constant(o.max(0.0))))), Coverage::Full);
        }
        alpha => Coverage::Blend(alpha),
    };
    (Scattering::Principled(Box::new(p)), coverage)
}

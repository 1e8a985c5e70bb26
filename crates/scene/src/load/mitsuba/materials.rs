//! BSDFs and textures.
//!
//! Departures: microfacets are GGX whatever `distribution` says; plain `diffuse` reflects on both sides; metals with a `specular_reflectance` follow
//! Schlick's curve from their color times that scale to 1 at grazing incidence, with what multiple scattering between facets adds;
//! `specular_reflectance` of dielectrics that transmit is left out; `phong` and `ward` are coats of GGX facets, `roughdiffuse` is diffuse.
//! Source: Mitsuba 3, plugin reference (BSDFs, textures).

use super::context::{Context, DEEPEST};
use super::metals;
use super::tree::Node;
use super::values::{self, Shade, boolean, number, transform};
use super::wrong;
use crate::SceneError;
use crate::load::stand_in;
use crate::material::conductor::{FacetBounces, with_color};
use crate::material::{Anisotropy, Conductor, Coverage, DEEPEST_MIX, Hair, Pigment, Principled, Scattering, Transmission};
use crate::texture::{Codes, Color, Graph, Interpolation, Mapping, Scalar, Texture, Wrap};
use diopter_light::Spectrum;
use diopter_light::color::RgbSpace;
use diopter_light::spectrum::Table;
use glam::{Affine2, DMat4, DVec3, Vec2, Vec3};
use std::sync::Arc;

type Read<T> = Result<T, SceneError>;

/// What a BSDF becomes, before a shape adds light and media.
#[derive(Clone)]
pub struct Surface {
    pub scattering: Scattering,
    pub coverage: Coverage,
    pub normal_map: Option<(Texture, f32)>,
    /// Whether something begins behind it: glass.
    pub is_body: bool,
}

impl Default for Surface {
    fn default() -> Self {
        Surface::of(Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))
    }
}

impl Surface {
    /// What reflects nothing.
    pub fn black() -> Self {
        Surface::of(Scattering::Black)
    }

    fn is_null(&self) -> bool {
        matches!(self.scattering, Scattering::Interface)
    }

    /// Fraction of rays that meet it.
    fn opacity(&self) -> Scalar {
        match &self.coverage {
            _ if self.is_null() => Scalar::Constant(0.0),
            Coverage::Blend(opacity) => opacity.clone(),
            _ => Scalar::Constant(1.0),
        }
    }

    /// The same that a fraction of the rays meet.
    fn with_opacity(self, opacity: Scalar) -> Self {
        match opacity {
            Scalar::Constant(1.0) => Surface { coverage: Coverage::Full, ..self },
            opacity => Surface { coverage: Coverage::Blend(opacity), ..self },
        }
    }

    fn of(scattering: Scattering) -> Self {
        Surface { scattering, coverage: Coverage::Full, normal_map: None, is_body: false }
    }
}

/// Indices of refraction by name. Source: Mitsuba 3, `ior.h`.
const INDICES: [(&str, f64); 24] = [
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.52045),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
    ("none", 1.0),
];

fn index(node: &Node, name: &str, default: f64) -> Read<f64> {
    let Some(word) = values::text(node, name) else { return number(node, name, default) };
    let known = INDICES.iter().find(|k| k.0 == word).map(|k| k.1);
    known.ok_or_else(|| {
        let near = diopter_light::names::nearest(word, INDICES.iter().map(|k| k.0));
        wrong(
            node,
            format!("{name} \"{word}\""),
            near.map_or("a number, or a name such as bk7".to_owned(), |n| format!("did you mean \"{n}\"?")),
        )
    })
}

/// The index inside over that outside.
fn relative_index(node: &Node, inside: f64) -> Read<f32> {
    if node.child("eta").is_some() {
        return Ok(number(node, "eta", inside)?.clamp(0.1, 10.0) as f32);
    }
    let ratio = index(node, "int_ior", inside)? / index(node, "ext_ior", 1.000277)?;
    match (0.1..=10.0).contains(&ratio) {
        true => Ok(ratio as f32),
        false => Err(wrong(node, format!("indices whose ratio is {ratio}"), "0.1 to 10")),
    }
}

/// An index of refraction or an extinction coefficient against a medium of an index.
fn within(constants: Spectrum, index: f32) -> Spectrum {
    match constants {
        Spectrum::Constant(value) => Spectrum::Constant(value / index),
        Spectrum::Table(table) => Spectrum::Table(table.scaled(1.0 / index)),
        Spectrum::TableOfRgb { table, rgb } => Spectrum::TableOfRgb { table: table.scaled(1.0 / index), rgb: rgb / index },
        other => other,
    }
}

/// Reflectances at normal incidence of the coats that stand for gloss without Fresnel reflection: of indices of 5 and 10.
const NEARLY_EVEN: [f32; 2] = [0.4444, 0.6694];

impl Context<'_> {
    /// A BSDF.
    pub fn bsdf(&mut self, node: &Arc<Node>, depth: usize) -> Read<Surface> {
        if depth > DEEPEST {
            return Err(wrong(
                node,
                format!("BSDFs within BSDFs, more than {DEEPEST} deep"),
                "BSDFs that do not refer to themselves",
            ));
        }
        let inner = |context: &mut Self| -> Read<Surface> {
            match context.nested(node, "bsdf", None)? {
                Some(inner) => context.bsdf(&inner, depth + 1),
                None => Err(wrong(node, format!("a {} without a BSDF", node.kind()), "one nested BSDF")),
            }
        };
        Ok(match node.kind() {
            "diffuse" => self.diffuse(node)?,
            "dielectric" | "roughdielectric" => {
                let (roughness, anisotropy) =
                    if node.kind() == "dielectric" { (Scalar::Constant(0.0), None) } else { self.roughness(node)? };
                self.say_distribution(node);
                let (ior, tint) = (relative_index(node, 1.5046)?, self.color(node, "specular_transmittance", 1.0)?);
                let is_body = !tint.is_everywhere(Vec3::ZERO);
                // Where nothing goes through, what enters is lost.
                let interface = match is_body {
                    true => Principled { base_color: tint, ..Principled::glass(ior) },
                    false => Principled::new(tint, ior.max(1.0)),
                };
                let reflected = self.reflection_scale(node, !is_body)?;
                let surface = Principled { roughness, anisotropy, ..interface }.with_specular(reflected);
                Surface { is_body, ..Surface::of(Scattering::Principled(Box::new(surface))) }
            }
            "thindielectric" => {
                self.reflection_scale(node, false)?;
                let sheet = Principled {
                    kind: Transmission::Thin,
                    thin_dielectric: true,
                    base_color: self.color(node, "specular_transmittance", 1.0)?,
                    ..Principled::glass(relative_index(node, 1.5046)?)
                };
                Surface::of(Scattering::Principled(Box::new(sheet)))
            }
            "conductor" | "roughconductor" => {
                let (alpha, across) = match node.kind() {
                    "conductor" => (Scalar::Constant(0.0), None),
                    _ => self.alpha(node)?,
                };
                self.say_distribution(node);
                let metal = Conductor { alpha, across, ..self.metal(node)? };
                let scale = self.color(node, "specular_reflectance", 1.0)?;
                let tint = (!scale.is_everywhere(Vec3::ONE)).then(|| Box::new(scale));
                Surface::of(Scattering::Conductor(Conductor { tint, ..metal }))
            }
            // The one that keeps track of polarisation is rough, too.
            "plastic" | "roughplastic" | "pplastic" => {
                let base = self.color(node, "diffuse_reflectance", 0.5)?;
                let (roughness, anisotropy) =
                    if node.kind() == "plastic" { (Scalar::Constant(0.0), None) } else { self.roughness(node)? };
                self.say_distribution(node);
                if node.kind() == "pplastic" {
                    self.skip_unsupported("pplastic's loss of light between base and coat: it is taken for roughplastic");
                }
                let layered = boolean(node, "nonlinear", false)?;
                let coat = Principled::new(base, relative_index(node, 1.49)?.max(1.0));
                let reflected = self.reflection_scale(node, true)?;
                let coat = Principled { roughness, anisotropy, layered, ..coat }.with_specular(reflected);
                Surface::of(Scattering::Principled(Box::new(coat)))
            }
            // Of Mitsuba 0.x.
            "phong" | "ward" => self.gloss(node)?,
            "roughdiffuse" => {
                let roughness = self.scalar(node, "alpha", 0.2)?;
                boolean(node, "use_fast_approx", false)?;
                if !matches!(roughness, Scalar::Constant(alpha) if alpha <= 0.0) {
                    self.skip_unsupported("the roughness of roughdiffuse: it is taken for diffuse");
                }
                self.diffuse(node)?
            }
            "hair" => Surface::of(Scattering::Hair(Box::new(self.hair(node)?))),
            "principled" | "principledthin" => self.principled(node)?,
            "measured" => {
                let file = values::text(node, "filename")
                    .ok_or_else(|| wrong(node, "a measured BSDF without filename", "<string name=\"filename\" .../>"))?;
                Surface::of(self.measured(file))
            }
            "twosided" => {
                if node.children.iter().filter(|c| c.tag == "bsdf").count() > 1 {
                    self.skip_unsupported("the BSDF of the back of twosided: it is that of the front");
                }
                inner(self)?
            }
            "mask" => {
                let own = inner(self)?;
                let opacity = product(self.scalar(node, "opacity", 0.5)?, own.opacity());
                if own.is_null() { own } else { own.with_opacity(opacity) }
            }
            "bumpmap" => {
                node.leave_out();
                self.skip_unsupported("bump maps");
                inner(self)?
            }
            "normalmap" => {
                let own = inner(self)?;
                let map = self.nested(node, "texture", None)?;
                let texture = map.map(|map| self.bitmap(&map, Codes::Linear)).transpose()?.flatten();
                Surface { normal_map: texture.map(|t| (t, 1.0)).or(own.normal_map.clone()), ..own }
            }
            "blendbsdf" => {
                let mut parts = Vec::new();
                for child in &node.children {
                    if let Some(part) = self.resolved_if(child, "bsdf")? {
                        parts.push(self.bsdf(&part, depth + 1)?);
                    }
                }
                let count = parts.len();
                let Ok([a, b]) = <[Surface; 2]>::try_from(parts) else {
                    return Err(wrong(node, format!("a blendbsdf of {count} BSDFs"), "two"));
                };
                if [&a, &b].iter().any(|s| s.scattering.parts().1 + 1 >= DEEPEST_MIX)
                    || a.scattering.parts().0 + b.scattering.parts().0 > 64
                {
                    return Err(wrong(node, "mixtures of mixtures of mixtures", "at most 64 BSDFs in one"));
                }
                let weight = self.scalar(node, "weight", 0.5)?;
                self.blend(a, b, weight)
            }
            "null" => Surface::of(Scattering::Interface),
            other => {
                let known = "diffuse, dielectric, thindielectric, roughdielectric, conductor, roughconductor, plastic, roughplastic, pplastic, phong, ward, roughdiffuse, principled, \
                    measured, hair, twosided, mask, bumpmap, normalmap, blendbsdf or null: others are not supported";
                return Err(wrong(node, format!("bsdf \"{other}\""), known));
            }
        })
    }

    /// The first, and the second by a weight. Rays meet each as often as its opacity says: the opacities are put together, and the weight is that among rays that meet anything.
    fn blend(&mut self, a: Surface, b: Surface, weight: Scalar) -> Surface {
        let [of_a, of_b] = [product(complement(weight.clone()), a.opacity()), product(weight.clone(), b.opacity())];
        match (a.is_null(), b.is_null()) {
            (true, true) => return a,
            (false, true) => return a.with_opacity(of_a),
            (true, false) => return b.with_opacity(of_b),
            (false, false) => (),
        }
        let (opacity, weight) = match (a.opacity(), b.opacity(), of_a, of_b) {
            (Scalar::Constant(whole), Scalar::Constant(other), ..) if whole == other => (Scalar::Constant(whole), weight),
            (_, _, Scalar::Constant(of_a), Scalar::Constant(of_b)) => {
                (Scalar::Constant(of_a + of_b), Scalar::Constant(of_b / (of_a + of_b).max(1e-20)))
            }
            (opacity_a, opacity_b, ..) => {
                self.skip_unsupported("the share of parts of a blendbsdf that differ in opacity, by a texture");
                let both = Graph::Mix(graph_of(opacity_a), graph_of(opacity_b), graph_of(weight.clone()));
                (Scalar::Graph(Arc::new(both)), weight)
            }
        };
        if a.normal_map.is_some() || b.normal_map.is_some() {
            self.skip_unsupported("normal maps of one part of a blendbsdf: both have them");
        }
        let is_body = a.is_body && b.is_body;
        let normal_map = a.normal_map.or(b.normal_map);
        let scattering = Scattering::Mix(Box::new(([a.scattering, b.scattering], weight)));
        Surface { is_body, normal_map, ..Surface::of(scattering) }.with_opacity(opacity)
    }

    fn diffuse(&mut self, node: &Arc<Node>) -> Read<Surface> {
        // Mitsuba 0.x takes either name.
        let names = ["reflectance", "diffuse_reflectance"];
        let name = names.into_iter().find(|name| node.child(name).is_some()).unwrap_or(names[0]);
        Ok(Surface::of(Scattering::Diffuse(self.color(node, name, 0.5)?)))
    }

    /// Mitsuba 0.x's gloss without Fresnel reflection over a diffuse base: a GGX coat that reflects nearly as much at all angles. Sources: E. Lafortune & Y. Willems 1994, "Using the Modified Phong
    /// Reflectance Model for Physically Based Rendering"; G. Ward 1992, "Measuring and Modeling Anisotropic Reflection". A lobe cosⁿ about the mirror direction is one cos⁴ⁿ about the normal of
    /// facets, and that α² = 2 / (4n + 2) (Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces", §5.2).
    fn gloss(&mut self, node: &Arc<Node>) -> Read<Surface> {
        let base = self.color(node, "diffuse_reflectance", 0.5)?;
        let reflected = self.color(node, "specular_reflectance", 0.2)?.constant_rgb().unwrap_or_else(|| {
            self.skip_unsupported(format!("a texture as \"specular_reflectance\" of {}", node.kind()));
            Vec3::splat(0.2)
        });
        let (roughness, anisotropy) = match node.kind() {
            "ward" => {
                values::text(node, "variant");
                self.roughness(node)?
            }
            _ => {
                let exponent = match self.scalar(node, "exponent", 30.0)? {
                    Scalar::Constant(n) => n.max(0.0),
                    _ => {
                        self.skip_unsupported("a texture as \"exponent\" of phong");
                        30.0
                    }
                };
                (Scalar::Constant((2.0 * exponent + 1.0).powf(-0.25)), None)
            }
        };
        let largest = reflected.max_element();
        if largest > 0.0 {
            self.skip_unsupported(format!("{}'s lobe: it is taken for a GGX coat of its reflectance and width", node.kind()));
        }
        if largest > NEARLY_EVEN[1] {
            self.skip_unsupported(format!("reflectances above {} of {}", NEARLY_EVEN[1], node.kind()));
        }
        let shown = largest.min(NEARLY_EVEN[1]);
        // The higher the index, the less reflection grows towards grazing incidence.
        let normal = shown.max(NEARLY_EVEN[0]);
        let ior = (1.0 + normal.sqrt()) / (1.0 - normal.sqrt());
        // The base has what the coat leaves it, where these models add the two.
        let base = base.times(Vec3::splat(1.0 / (1.0 - shown)));
        let reflected = if largest > shown { reflected * (shown / largest) } else { reflected };
        let coat = Principled::new(base, ior).with_specular(reflected / normal);
        Ok(Surface::of(Scattering::Principled(Box::new(Principled { roughness, anisotropy, ..coat }))))
    }

    /// A fibre, by the parameters of Chiang et al. 2016 under Mitsuba's names.
    fn hair(&mut self, node: &Arc<Node>) -> Read<Hair> {
        let named = |name: &str| node.child(name).is_some();
        let pigment = match values::shade(node, "sigma_a")? {
            Some(shade) => {
                let (scale, spectrum) = (number(node, "scale", 1.0)?.max(0.0) as f32, shade.unbounded());
                let scaled = (0..=80).map(|i| scale * spectrum.at(380.0 + 5.0 * i as f32)).collect();
                Pigment::Absorption(if scale == 1.0 { spectrum } else { Spectrum::Table(Table::new(380.0, 5.0, scaled)) })
            }
            None if named("sigma_a") => {
                return Err(wrong(node, "a texture as sigma_a of hair", "a number, a colour or a spectrum"));
            }
            None => Pigment::melanin(self.scalar(node, "eumelanin", 1.3)?, self.scalar(node, "pheomelanin", 0.2)?),
        };
        let eta = (index(node, "int_ior", 1.55)? / index(node, "ext_ior", 1.000277)?).clamp(1.0, 10.0) as f32;
        Ok(Hair {
            pigment,
            eta,
            beta_m: self.scalar(node, "longitudinal_roughness", 0.3)?,
            beta_n: self.scalar(node, "azimuthal_roughness", 0.3)?,
            alpha: self.scalar(node, "scale_tilt", 2.0)?,
        })
    }

    /// Burley's model in its closest form here.
    fn principled(&mut self, node: &Arc<Node>) -> Read<Surface> {
        let base = self.color(node, "base_color", 0.5)?;
        let ior = match node.child("eta").is_some() || node.child("specular").is_none() && node.kind() == "principledthin" {
            true => number(node, "eta", 1.5)?,
            false => {
                // Of the reflectance 0.08 · specular at normal incidence.
                let root = (0.08 * number(node, "specular", 0.5)?.clamp(0.0, 1.0)).sqrt();
                2.0 / (1.0 - root) - 1.0
            }
        };
        let mut p = Principled {
            metallic: self.scalar(node, "metallic", 0.0)?,
            roughness: self.scalar(node, "roughness", 0.5)?,
            transmission: self.scalar(node, "spec_trans", 0.0)?,
            ..Principled::new(base, ior.clamp(1.0, 10.0) as f32)
        };
        // A quarter of the coat's strength, and gloss from α 0.1 to 0.001 (B. Burley 2012).
        p.clearcoat = product(self.scalar(node, "clearcoat", 0.0)?, Scalar::Constant(0.25));
        if node.child("clearcoat_gloss").is_some_and(|c| !matches!(c.tag.as_str(), "float" | "integer")) {
            self.skip_unsupported("a texture as \"clearcoat_gloss\" of principled BSDFs");
        }
        let gloss = number(node, "clearcoat_gloss", 0.0)?.clamp(0.0, 1.0) as f32;
        p.clearcoat_roughness = Scalar::Constant((0.1 + (0.001 - 0.1) * gloss).sqrt());
        for name in ["anisotropic", "sheen", "sheen_tint", "spec_tint", "flatness", "diff_trans"] {
            if node.child(name).is_some_and(|c| c.get("value").is_none_or(|v| v.trim().parse::<f64>() != Ok(0.0))) {
                self.skip_unsupported(format!("\"{name}\" of principled BSDFs"));
            }
        }
        if node.kind() == "principledthin" {
            // Theirs reflects like glass only as far as it lets light through.
            (p.specular, p.tinted) = (p.transmission.clone(), true);
        }
        let transmits = !matches!(p.transmission, Scalar::Constant(t) if t <= 0.0);
        let is_body = transmits && node.kind() == "principled";
        if is_body {
            p.kind = Transmission::Solid;
            // Each of the two faces of a body lets the root of its colour through.
            match (&p.transmission, p.base_color.is_everywhere(Vec3::ONE)) {
                (_, true) => (),
                (Scalar::Constant(1.0), _) => p.base_color = root_of_color(p.base_color),
                _ => self
                    .skip_unsupported("the root of the colour of what principled BSDFs transmit in part: it is that of the base"),
            }
        }
        Ok(Surface { is_body, ..Surface::of(Scattering::Principled(Box::new(p))) })
    }

    /// What scales the reflection of a dielectric, linear sRGB; what is no constant, or is of one that cannot be scaled, is left out.
    fn reflection_scale(&mut self, node: &Arc<Node>, can_be_scaled: bool) -> Read<Vec3> {
        let scale = self.color(node, "specular_reflectance", 1.0)?;
        match scale.constant_rgb() {
            Some(rgb) if can_be_scaled || rgb == Vec3::ONE => Ok(rgb),
            _ => {
                self.skip_unsupported(format!("\"specular_reflectance\" of {}", node.kind()));
                Ok(Vec3::ONE)
            }
        }
    }

    fn say_distribution(&mut self, node: &Node) {
        if (node.kind().starts_with("rough") || node.kind() == "pplastic")
            && values::text(node, "distribution").unwrap_or("beckmann") == "beckmann"
        {
            self.skip_unsupported("Beckmann's distribution: facets are GGX");
        }
    }

    /// α along u, and across where it differs.
    fn alpha(&mut self, node: &Arc<Node>) -> Read<(Scalar, Option<Scalar>)> {
        if node.child("alpha_u").is_none() && node.child("alpha_v").is_none() {
            return Ok((self.scalar(node, "alpha", 0.1)?, None));
        }
        Ok((self.scalar(node, "alpha_u", 0.1)?, Some(self.scalar(node, "alpha_v", 0.1)?)))
    }

    /// The root of α.
    fn roughness(&mut self, node: &Arc<Node>) -> Read<(Scalar, Option<Box<Anisotropy>>)> {
        let (along, across) = self.alpha(node)?;
        Ok((root(along), across.map(|a| Box::new(Anisotropy::Across(root(a))))))
    }

    fn metal(&mut self, node: &Arc<Node>) -> Read<Conductor> {
        // Of what is around: air, as a rule.
        let around = index(node, "ext_eta", 1.0)? as f32;
        if !(0.1..=10.0).contains(&around) {
            return Err(wrong(node, format!("ext_eta {around}"), "0.1 to 10"));
        }
        let of = |n: Spectrum, k: Spectrum| Conductor {
            n: within(n, around),
            k: within(k, around),
            alpha: Scalar::Constant(0.0),
            across: None,
            bounces: FacetBounces::Lost,
            tint: None,
        };
        if node.child("eta").is_some() || node.child("k").is_some() {
            // Theirs without the other one.
            let part = |name: &str, default: f32| self.shade(node, name).map(|s| s.unwrap_or(Shade::Even(default)).unbounded());
            return Ok(of(part("eta", 0.0)?, part("k", 1.0)?));
        }
        let name = values::text(node, "material").unwrap_or("none");
        if name == "none" {
            // All is reflected: k² / (4 + k²) of 0.9999 at an index of 1.
            return Ok(of(Spectrum::Constant(1.0), Spectrum::Constant(200.0)));
        }
        match metals::of(name) {
            Some([n, k]) => {
                let [n, k] = with_color(Spectrum::Table(n), Spectrum::Table(k));
                Ok(of(n, k))
            }
            None => {
                let known = metals::names().collect::<Vec<_>>().join(", ");
                Err(wrong(node, format!("material \"{name}\""), format!("eta and k, none, or one of {known}")))
            }
        }
    }

    /// A colour by name: constant or a texture.
    pub fn color(&mut self, node: &Arc<Node>, name: &str, default: f32) -> Read<Color> {
        let Some(child) = node.child(name).cloned() else { return Ok(Color::rgb(default, default, default)) };
        if let Some(shade) = Shade::of(&child)? {
            return Ok(match shade {
                Shade::Points(points) => {
                    let table = values::bounded(&points);
                    let values: Vec<f32> = (0..=400).map(|i| table.at(380.0 + i as f32)).collect();
                    if values.iter().any(|v| !(0.0..=1.0).contains(v)) {
                        self.skip_unsupported(format!("what \"{name}\" has below 0 or above 1"));
                    }
                    let values = values.into_iter().map(|v| v.clamp(0.0, 1.0)).collect();
                    Color::spectrum(Spectrum::Table(Table::new(380.0, 1.0, values)))
                }
                other => {
                    let rgb = other.rgb().clamp(Vec3::ZERO, Vec3::ONE);
                    if rgb != other.rgb() {
                        self.skip_unsupported(format!("what \"{name}\" has below 0 or above 1"));
                    }
                    Color::rgb(rgb.x, rgb.y, rgb.z)
                }
            });
        }
        let texture = self.resolved(&child)?;
        Ok(match self.graph(&texture, 0)? {
            Ok(texture) => Color::Textured { factor: Vec3::ONE, texture },
            Err(graph) => Color::Graph(graph),
        })
    }

    /// A number by name: constant or a texture.
    pub fn scalar(&mut self, node: &Arc<Node>, name: &str, default: f32) -> Read<Scalar> {
        let Some(child) = node.child(name).cloned() else { return Ok(Scalar::Constant(default)) };
        if let Some(shade) = Shade::of(&child)? {
            let given = match shade {
                Shade::Even(v) | Shade::EvenSpectrum(v) => v,
                other => other.rgb().element_sum() / 3.0,
            };
            // Scales of hair may be tilted either way.
            let least = if name == "scale_tilt" { f32::MIN } else { 0.0 };
            let most =
                if matches!(name, "weight" | "opacity" | "metallic" | "spec_trans" | "clearcoat") { 1.0 } else { f32::MAX };
            let value = given.clamp(least, most);
            if value != given {
                self.skip_unsupported(format!("what \"{name}\" has below 0{}", if given > most { " or above 1" } else { "" }));
            }
            return Ok(Scalar::Constant(value));
        }
        let texture = self.resolved(&child)?;
        if texture.kind() == "bitmap" {
            return Ok(match self.bitmap(&texture, Codes::Srgb)? {
                // Of colours their luminance counts.
                Some(texture) if !texture.image.is_grey() => {
                    let as_number = Some([RgbSpace::Srgb.luminance_weights().into(), Vec3::ZERO]);
                    Scalar::Graph(Arc::new(Graph::Image { texture, scale: 1.0, invert: false, as_number, mapping: None }))
                }
                Some(texture) => Scalar::Textured { factor: 1.0, texture, channel: 0 },
                None => Scalar::Constant(default),
            });
        }
        Ok(match self.graph(&texture, 0)? {
            Ok(texture) => Scalar::Textured { factor: 1.0, texture, channel: 0 },
            // As Mitsuba 3.9 has it: of numbers the first one is that of the other squares.
            Err(graph) => Scalar::Graph(match Arc::unwrap_or_clone(graph) {
                Graph::Checkerboard { place, even, odd } => Arc::new(Graph::Checkerboard { place, even: odd, odd: even }),
                other => Arc::new(other),
            }),
        })
    }

    /// A texture: a picture, or a graph of others.
    fn graph(&mut self, node: &Arc<Node>, depth: usize) -> Read<Result<Texture, Arc<Graph>>> {
        if depth > DEEPEST || node.tag != "texture" {
            return Err(wrong(
                node,
                format!("<{}> for a texture", node.tag),
                "a texture, an rgb or a spectrum, not nested in itself",
            ));
        }
        match node.kind() {
            "bitmap" => Ok(Ok(self.bitmap(node, Codes::Srgb)?.unwrap_or_else(|| Texture::color(stand_in())))),
            "checkerboard" => {
                let mut sides = Vec::new();
                for (name, default) in [("color0", 0.4), ("color1", 0.2)] {
                    let side = match node.child(name).cloned() {
                        None => Graph::Constant(Vec3::splat(default)),
                        Some(child) => match Shade::of(&child)? {
                            Some(shade) => Graph::Constant(shade.rgb()),
                            None => {
                                let texture = self.resolved(&child)?;
                                match self.graph(&texture, depth + 1)? {
                                    Ok(texture) => {
                                        Graph::Image { texture, scale: 1.0, invert: false, as_number: None, mapping: None }
                                    }
                                    Err(graph) => (*graph).clone(),
                                }
                            }
                        },
                    };
                    sides.push(Arc::new(side));
                }
                let m = uv_transform(node)?;
                if m.x_axis.y != 0.0 || m.y_axis.x != 0.0 {
                    self.skip_unsupported("turns of checkerboards");
                }
                // Two squares in each direction.
                let place = Mapping::Uv([
                    [2.0 * m.x_axis.x as f32, 2.0 * m.w_axis.x as f32],
                    [2.0 * m.y_axis.y as f32, 2.0 * m.w_axis.y as f32],
                ]);
                Ok(Err(Arc::new(Graph::Checkerboard { place, even: sides[0].clone(), odd: sides[1].clone() })))
            }
            other => Err(wrong(node, format!("texture \"{other}\""), "bitmap or checkerboard: others are not supported")),
        }
    }

    /// A picture; none where it is missing.
    fn bitmap(&mut self, node: &Arc<Node>, codes: Codes) -> Read<Option<Texture>> {
        if node.kind() != "bitmap" {
            return Err(wrong(node, format!("texture \"{}\"", node.kind()), "bitmap"));
        }
        let file = values::text(node, "filename")
            .ok_or_else(|| wrong(node, "a bitmap without filename", "<string name=\"filename\" .../>"))?;
        let Some(image) = self.picture(file) else {
            node.leave_out();
            return Ok(None);
        };
        // Mitsuba 0.x writes a gamma of 1 for what is raw.
        let gamma = number(node, "gamma", 0.0)?;
        let raw = codes == Codes::Linear || gamma == 1.0;
        let codes = if boolean(node, "raw", raw)? { Codes::Linear } else { Codes::Srgb };
        let wrap = match values::text(node, "wrap_mode") {
            Some("clamp") => Wrap::Clamp,
            Some("mirror") => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        let interpolation = match values::text(node, "filter_type") {
            Some("nearest") => Interpolation::Nearest,
            _ => Interpolation::Bilinear,
        };
        let m = uv_transform(node)?.as_mat4();
        let two = |v: glam::Vec4| Vec2::new(v.x, v.y);
        let image_from_uv = Affine2::from_cols(two(m.x_axis), two(m.y_axis), two(m.w_axis));
        Ok(Some(Texture { image, codes, wrap: [wrap; 2], interpolation, uv_set: 0, image_from_uv }))
    }
}

/// Where a texture lies: `to_uv`, or what Mitsuba 0.x has: texture coordinates times a scale plus an offset. (Mitsuba 3 adds the offset of such files first.)
fn uv_transform(node: &Node) -> Read<DMat4> {
    let two = |u: &str, v: &str, default: f64| -> Read<DVec3> {
        Ok(DVec3::new(number(node, u, default)?, number(node, v, default)?, default))
    };
    let (scale, offset) = (two("uscale", "vscale", 1.0)?, two("uoffset", "voffset", 0.0)?);
    Ok(transform(node, "to_uv")? * DMat4::from_translation(offset) * DMat4::from_scale(scale))
}

fn root(alpha: Scalar) -> Scalar {
    match alpha {
        Scalar::Constant(a) => Scalar::Constant(a.clamp(0.0, 1.0).sqrt()),
        other => Scalar::Graph(Arc::new(Graph::Power(graph_of(other), 0.5))),
    }
}

/// The root of each of a colour's components.
fn root_of_color(color: Color) -> Color {
    let graph = match color {
        Color::Constant { rgb, .. } => {
            let root = rgb.max(Vec3::ZERO).powf(0.5);
            return Color::rgb(root.x, root.y, root.z);
        }
        Color::Spectrum(_) => Graph::Constant(color.constant_rgb().unwrap_or(Vec3::ONE)),
        Color::Textured { texture, .. } => Graph::Image { texture, scale: 1.0, invert: false, as_number: None, mapping: None },
        Color::Graph(graph) => return Color::Graph(Arc::new(Graph::Power(graph, 0.5))),
    };
    Color::Graph(Arc::new(Graph::Power(Arc::new(graph), 0.5)))
}

/// A number as a graph.
fn graph_of(scalar: Scalar) -> Arc<Graph> {
    match scalar {
        Scalar::Constant(v) => Arc::new(Graph::Constant(Vec3::splat(v))),
        Scalar::Graph(graph) => graph,
        Scalar::Textured { factor, texture, channel } => {
            let unit = |i: usize| if channel == i { factor } else { 0.0 };
            let as_number = Some([Vec3::new(unit(0), unit(1), unit(2)), Vec3::splat(unit(3))]);
            Arc::new(Graph::Image { texture, scale: 1.0, invert: false, as_number, mapping: None })
        }
    }
}

/// One number times another.
fn product(a: Scalar, b: Scalar) -> Scalar {
    match (a, b) {
        (Scalar::Constant(a), Scalar::Constant(b)) => Scalar::Constant(a * b),
        (Scalar::Constant(1.0), other) | (other, Scalar::Constant(1.0)) => other,
        (Scalar::Constant(0.0), _) | (_, Scalar::Constant(0.0)) => Scalar::Constant(0.0),
        (a, b) => Scalar::Graph(Arc::new(Graph::Scale(graph_of(a), graph_of(b)))),
    }
}

/// What is left of 1.
fn complement(a: Scalar) -> Scalar {
    match a {
        Scalar::Constant(a) => Scalar::Constant(1.0 - a),
        other => {
            let [one, none] = [1.0, 0.0].map(|v| Arc::new(Graph::Constant(Vec3::splat(v))));
            Scalar::Graph(Arc::new(Graph::Mix(one, none, graph_of(other))))
        }
    }
}

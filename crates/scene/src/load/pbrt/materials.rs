//! Materials by number and name.

use super::Fault;
use super::context::Context;
use super::params::{Param, Params, Values};
use super::spectra::{self, Use};
use super::subsurface;
use super::textures::Textures;
use crate::material::conductor::{FacetBounces, with_color};
use crate::material::{
    Anisotropy, Bump, BumpUnit, CoatedConductor, Conductor, DEEPEST_MIX, Hair, Interior, Material, Pigment, Principled,
    Scattering, Transmission,
};
use crate::texture::{Codes, Color, Graph, Interpolation, Scalar, Texture, Wrap};
use diopter_light::Spectrum;
use glam::{Affine2, Vec2};
use std::collections::HashMap;
use std::sync::Arc;

/// A material, or none where there is no surface.
#[derive(Clone, Debug)]
pub struct Made {
    /// What light meets.
    pub material: Option<Material>,
}

/// All materials so far. Number 0 is pbrt's default, a grey of one half.
#[derive(Default)]
pub struct Materials {
    all: Vec<Made>,
    names: HashMap<String, usize>,
}

/// Materials of pbrt-v3 that pbrt-v4 has not, beside those that are read.
const V3_ONLY: [&str; 9] =
    ["plastic", "metal", "uber", "substrate", "mirror", "translucent", "disney", "fourier", "kdsubsurface"];

/// Whether all numbers of a parameter are one.
fn is_even(p: &Param, number: f64) -> bool {
    matches!(&p.values, Values::Numbers(all) if all.iter().all(|n| *n == number))
}

/// Most materials in a mixture.
const MOST_PARTS: usize = 64;
/// α below which pbrt takes a surface for perfectly smooth.
const SMOOTH: f32 = 1e-3;

impl Materials {
    /// The materials that pbrt begins with.
    pub fn new() -> Self {
        let grey = Material::new("default", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)));
        Materials { all: vec![Made { material: Some(grey) }], names: HashMap::new() }
    }

    /// Adds a material; gives its number.
    pub fn add(&mut self, made: Made) -> usize {
        self.all.push(made);
        self.all.len() - 1
    }

    /// Fails with the name when there is one already.
    pub fn name(&mut self, name: String, mut made: Made) -> Result<(), String> {
        if self.names.contains_key(&name) {
            return Err(name);
        }
        if let Some(material) = &mut made.material {
            material.name.clone_from(&name);
        }
        let number = self.add(made);
        self.names.insert(name, number);
        Ok(())
    }

    /// Number of a named material.
    pub fn number(&self, name: &str) -> Option<usize> {
        self.names.get(name).copied()
    }

    /// The known name nearest to one that is not known.
    pub fn nearest(&self, name: &str) -> Option<String> {
        diopter_light::names::nearest(name, self.names.keys().map(String::as_str)).map(str::to_owned)
    }

    /// A material by its number.
    pub fn made(&self, number: usize) -> &Made {
        &self.all[number]
    }

    /// A material of a type; none for an interface. Fails where the type is not known or is pbrt-v3's, a number or spectrum is out of range, or a texture, file or part
    /// of a mixture is not there.
    pub fn make(&mut self, context: &mut Context, textures: &Textures, kind: &str, p: &Params) -> Result<Made, Fault> {
        p.get("type");
        let (mut inside, mut own_name) = (None, None);
        let scattering = match kind {
            "" | "none" | "interface" => return Ok(Made { material: None }),
            "diffuse" => Scattering::Diffuse(textures.color(context, p, "reflectance", 0.5)?),
            "coateddiffuse" => {
                clear_between_layers(context, p);
                let base = textures.color(context, p, "reflectance", 0.5)?;
                let eta = index(context, p, "eta", 1.5, COAT)?;
                let (roughness, across) = root_of_alpha(context, textures, p, "")?;
                let coat = Principled::new(base, eta.at(550.0));
                Scattering::Principled(Box::new(Principled { roughness, anisotropy: anisotropy(across), layered: true, ..coat }))
            }
            "conductor" => {
                let (alpha, across) = alpha(context, textures, p, "")?;
                let (n, k) = metal(context, p, "")?;
                Scattering::Conductor(Conductor { n, k, alpha, across, bounces: FacetBounces::Lost, tint: None })
            }
            "coatedconductor" => {
                clear_between_layers(context, p);
                let (alpha, across) = alpha(context, textures, p, "conductor.")?;
                let (n, k) = metal(context, p, "conductor.")?;
                let metal = Conductor { n, k, alpha, across, bounces: FacetBounces::Lost, tint: None };
                let eta = index(context, p, "interface.eta", 1.5, COAT)?;
                let (roughness, across) = root_of_alpha(context, textures, p, "interface.")?;
                let mut coated = CoatedConductor::new(metal, eta.at(550.0), roughness);
                coated.across = across;
                Scattering::Coated(Box::new(coated))
            }
            "dielectric" | "thindielectric" => {
                let eta = index(context, p, "eta", 1.5, BODY)?;
                let glass = Principled::glass(eta.at(550.0));
                let own = match kind {
                    "thindielectric" => Principled { kind: Transmission::Thin, thin_dielectric: true, ..glass },
                    _ => {
                        let disperses = !matches!(eta, Spectrum::Constant(_));
                        let (roughness, across) = root_of_alpha(context, textures, p, "")?;
                        Principled { roughness, anisotropy: anisotropy(across), dispersion: disperses.then_some(eta), ..glass }
                    }
                };
                Scattering::Principled(Box::new(own))
            }
            "diffusetransmission" => {
                let scale = p.float("scale", 1.0)? as f32;
                let reflectance = scaled(textures.color(context, p, "reflectance", 0.25)?, scale);
                let transmittance = scaled(textures.color(context, p, "transmittance", 0.25)?, scale);
                let most = |c: &Color| if let Color::Constant { rgb, .. } = c { rgb.max_element() } else { 0.0 };
                if most(&reflectance) + most(&transmittance) > 1.001 {
                    context.warn(p.place, "reflectance and transmittance add up to more than 1: this material makes light");
                }
                Scattering::DiffuseTransmission(Box::new([reflectance, transmittance]))
            }
            "hair" => Scattering::Hair(Box::new(hair(context, textures, p)?)),
            "measured" => match p.text("filename")? {
                Some(name) => {
                    own_name = Some(name.to_owned());
                    context.measured(name)
                }
                None => {
                    return Err(p.place.fault("a measured material without filename", "\"string filename\" \"a .bsdf file\""));
                }
            },
            "mix" => {
                if p.get("namedmaterial1").is_some() {
                    return Err(p.place.version_3("a mix of namedmaterial1 and namedmaterial2"));
                }
                let names = match p.get("materials").map(|m| (&m.values, m.place)) {
                    Some((super::params::Values::Texts(t), _)) if t.len() == 2 => t.clone(),
                    Some((_, place)) => return Err(place.fault("the materials of a mix", "two names")),
                    None => return Err(p.place.fault("a mix without materials", "\"string materials\" [ two names ]")),
                };
                let amount = textures.scalar(context, p, "amount", 0.5)?;
                let mut part = |name: &String| {
                    let known = self.number(name).map(|n| &self.all[n]);
                    let known = known
                        .ok_or_else(|| p.place.fault(format!("material \"{name}\" of a mix"), "one that was defined before"))?;
                    let material = known.material.as_ref();
                    let material =
                        material.ok_or_else(|| p.place.fault(format!("the interface \"{name}\" in a mix"), "a surface"))?;
                    if material.normal_map.is_some()
                        || material.bump.is_some()
                        || matches!(material.interior, Interior::Body { medium: Some(_), .. })
                    {
                        let what = format!("the normal map, displacement or inside of \"{name}\" in a mix is not taken");
                        context.warn(p.place, what);
                    }
                    Ok(material.scattering.clone())
                };
                let parts = [part(&names[0])?, part(&names[1])?];
                if parts.iter().any(|p| p.parts().1 + 1 >= DEEPEST_MIX)
                    || parts.iter().map(|p| p.parts().0).sum::<usize>() > MOST_PARTS
                {
                    return Err(p
                        .place
                        .fault("mixtures of mixtures of mixtures", format!("at most {MOST_PARTS} materials in one")));
                }
                Scattering::Mix(Box::new((parts, amount)))
            }
            // pbrt-v3's Lambertian surface, by the names of its parameters.
            "matte" => {
                let lambertian = matches!(textures.scalar(context, p, "sigma", 0.0)?, Scalar::Constant(s) if s == 0.0);
                if !lambertian {
                    return Err(p.place.version_3("a matte material with sigma (Oren and Nayar's model)"));
                }
                Scattering::Diffuse(textures.color(context, p, "Kd", 0.5)?)
            }
            // pbrt-v3's smooth clear glass; what is coloured or rough is not the same in pbrt-v4.
            "glass" => {
                for name in ["Kr", "Kt", "uroughness", "vroughness"] {
                    let plain = if name.starts_with('K') { 1.0 } else { 0.0 };
                    if p.get(name).is_some_and(|v| !is_even(v, plain)) {
                        return Err(p.place.version_3(format!("a glass material with {name}")));
                    }
                }
                p.get("remaproughness");
                let name = if p.get("index").is_some() { "index" } else { "eta" };
                let glass = Principled::glass(index(context, p, name, 1.5, BODY)?.at(550.0));
                Scattering::Principled(Box::new(glass))
            }
            "subsurface" => {
                let eta = index(context, p, "eta", 1.33, COAT)?;
                let glass = Principled::glass(eta.at(550.0));
                let (roughness, across) = root_of_alpha(context, textures, p, "")?;
                inside = Some(subsurface::medium(context, p, eta.at(550.0))?);
                Scattering::Principled(Box::new(Principled { roughness, anisotropy: anisotropy(across), ..glass }))
            }
            other if V3_ONLY.contains(&other) => return Err(p.place.version_3(format!("material \"{other}\""))),
            other => {
                let known = "diffuse, coateddiffuse, conductor, coatedconductor, dielectric, thindielectric, diffusetransmission, hair, measured, subsurface, mix or interface: others are not supported yet";
                return Err(p.place.fault(format!("material \"{other}\""), known));
            }
        };
        let mut material = Material::new(own_name.as_deref().unwrap_or(kind), scattering);
        if let Some(medium) = inside {
            material.interior = Interior::Body { medium: Some(Arc::new(medium)), priority: None };
        }
        if let Some(name) = p.text("normalmap")? {
            material.normal_map = normal_map(context, name).map(|map| (map, 1.0));
        }
        // An even height changes nothing.
        if !matches!(textures.scalar(context, p, "displacement", 0.0)?, Scalar::Constant(_)) {
            let height = textures.scalar(context, p, "displacement", 0.0)?;
            material.bump = Some(Box::new(Bump { height, unit: BumpUnit::Length(1.0) }));
            if let Some(both) = p.get("normalmap") {
                context.warn(both.place, "a material with displacement and normalmap: its normalmap is not used");
            }
        }
        Ok(Made { material: Some(material) })
    }
}

/// A fibre: of several ways to say what absorbs light in it the first counts, as in pbrt (`HairMaterial::Create`).
fn hair(context: &mut Context, textures: &Textures, p: &Params) -> Result<Hair, Fault> {
    const WAYS: [&str; 5] = ["sigma_a", "reflectance", "color", "eumelanin", "pheomelanin"];
    let given: Vec<&str> = WAYS.into_iter().filter(|name| p.get(name).is_some()).collect();
    if let [first, second, ..] = given[..]
        && [first, second] != ["eumelanin", "pheomelanin"]
    {
        context.warn(p.place, format!("hair with {first} and {second}: only {first} is used"));
    }
    let number = |context: &mut Context, name: &str, default: f32| {
        let at_least_0 = |v: f32| v >= 0.0;
        match textures.scalar(context, p, name, default)? {
            Scalar::Constant(v) if !at_least_0(v) => {
                Err(p.get(name).map_or(p.place, |p| p.place).fault(format!("{name} of {v}"), "a number of at least 0"))
            }
            other => Ok(other),
        }
    };
    let pigment = match given.first() {
        Some(&"sigma_a") => match textures.unbounded(context, p, "sigma_a")? {
            Some(graph) => Pigment::AbsorptionMap(graph),
            None => Pigment::Absorption(spectra::get(context, p, "sigma_a", Use::Unbounded, Spectrum::Constant(0.0))?),
        },
        Some(name @ (&"reflectance" | &"color")) => Pigment::Reflectance(textures.color(context, p, name, 0.5)?),
        _ => {
            let eumelanin = number(context, "eumelanin", if given.is_empty() { 1.3 } else { 0.0 })?;
            Pigment::melanin(eumelanin, number(context, "pheomelanin", 0.0)?)
        }
    };
    let eta = p.float("eta", 1.55)? as f32;
    if !(1.0..=10.0).contains(&eta) {
        return Err(p.get("eta").map_or(p.place, |p| p.place).fault(format!("an index of refraction of {eta}"), "1 to 10"));
    }
    let (beta_m, beta_n) = (number(context, "beta_m", 0.3)?, number(context, "beta_n", 0.3)?);
    Ok(Hair { pigment, eta, beta_m, beta_n, alpha: textures.scalar(context, p, "alpha", 2.0)? })
}

/// Says what is left out of a medium between two layers.
fn clear_between_layers(context: &mut Context, p: &Params) {
    for (name, default) in [("albedo", 0.0), ("g", 0.0)] {
        if let Some(param) = p.get(name)
            && param.values != super::params::Values::Numbers(vec![default])
        {
            let place = param.place;
            context.warn(
                place,
                format!("\"{name}\" of a layered material (a medium between its layers) is not supported: it is taken for clear"),
            );
        }
    }
    for name in ["thickness", "maxdepth", "nsamples", "interface.thickness"] {
        p.get(name);
    }
}

/// A picture of normals; none where it is missing.
fn normal_map(context: &mut Context, name: &str) -> Option<Texture> {
    let image = context.picture(name)?;
    // Rows count from below.
    let image_from_uv = Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y);
    Some(Texture {
        image: Arc::new(image),
        codes: Codes::Linear,
        wrap: [Wrap::Repeat; 2],
        interpolation: Interpolation::Bilinear,
        uv_set: 0,
        image_from_uv,
    })
}

/// Least index of a coat.
const COAT: f32 = 1.0;
/// Least index of a body: one below 1 is thinner than what is around it, such as air in ice.
const BODY: f32 = 0.1;

/// An index of refraction: a number or a spectrum.
fn index(context: &Context, p: &Params, name: &str, default: f32, least: f32) -> Result<Spectrum, Fault> {
    let index = spectra::get(context, p, name, Use::Unbounded, Spectrum::Constant(default))?;
    match (0..=80).map(|i| index.at(380.0 + 5.0 * i as f32)).find(|n| !(least..=10.0).contains(n)) {
        None => Ok(index),
        Some(n) => {
            let place = p.get(name).map_or(p.place, |p| p.place);
            Err(place.fault(format!("an index of refraction of {n}"), format!("{least} to 10")))
        }
    }
}

/// n and k of a metal; the names of its parameters may have a prefix, but `reflectance` has none.
fn metal(context: &Context, p: &Params, prefix: &str) -> Result<(Spectrum, Spectrum), Fault> {
    let [eta, k] = ["eta", "k"].map(|name| format!("{prefix}{name}"));
    if let Some(reflectance) = p.get("reflectance") {
        if p.get(&eta).is_some() || p.get(&k).is_some() {
            return Err(p.place.fault("a conductor with reflectance and eta or k", "one of the two"));
        }
        let r = spectra::of(context, reflectance, Use::Albedo)?;
        // Of an index of 1 the reflectance k² / (4 + k²), solved for k.
        let k = |r: f32| {
            let r = r.clamp(0.0, 0.9999);
            2.0 * r.sqrt() / (1.0 - r).sqrt()
        };
        let values = (0..=80).map(|i| k(r.at(380.0 + 5.0 * i as f32))).collect();
        let table = diopter_light::spectrum::Table::new(380.0, 5.0, values);
        let k = match &r {
            Spectrum::Sigmoid(sigmoid) => Spectrum::TableOfRgb { table, rgb: sigmoid.rgb.map(k) },
            _ => Spectrum::Table(table),
        };
        return Ok((Spectrum::Constant(1.0), k));
    }
    let copper = |which: &str| spectra::named_or_nothing(&format!("metal-Cu-{which}"));
    let n = spectra::get(context, p, &eta, Use::Unbounded, copper("eta"))?;
    let k = spectra::get(context, p, &k, Use::Unbounded, copper("k"))?;
    let [n, k] = with_color(n, k);
    Ok((n, k))
}

/// Roughness along u, and across it where that differs.
type Widths = (Scalar, Option<Scalar>);

/// α of GGX to a power: the root of what files say, or just that.
fn widths(context: &mut Context, textures: &Textures, p: &Params, prefix: &str, exponent: f32) -> Result<Widths, Fault> {
    let exponent = if p.bool("remaproughness", true)? { 0.5 * exponent } else { exponent };
    let (along, across) = roughness(context, textures, p, prefix)?;
    Ok((power(along, exponent), across.map(|r| power(r, exponent))))
}

fn alpha(context: &mut Context, textures: &Textures, p: &Params, prefix: &str) -> Result<Widths, Fault> {
    widths(context, textures, p, prefix, 1.0)
}

/// √α, which glTF's model calls roughness; 0 where pbrt takes the surface for smooth.
fn root_of_alpha(context: &mut Context, textures: &Textures, p: &Params, prefix: &str) -> Result<Widths, Fault> {
    Ok(match widths(context, textures, p, prefix, 0.5)? {
        (Scalar::Constant(r), None) if r * r < SMOOTH => (Scalar::Constant(0.0), None),
        other => other,
    })
}

fn anisotropy(across: Option<Scalar>) -> Option<Box<Anisotropy>> {
    across.map(|r| Box::new(Anisotropy::Across(r)))
}

/// Roughness as files say it: along u, and across it where that differs.
fn roughness(context: &mut Context, textures: &Textures, p: &Params, prefix: &str) -> Result<Widths, Fault> {
    let [both, u, v] = ["roughness", "uroughness", "vroughness"].map(|n| format!("{prefix}{n}"));
    // What is not said of one direction is what is said of both; of both directions, it says nothing.
    p.get(&both);
    let mut checked = |name: &str| {
        let name = if p.get(name).is_some() { name } else { both.as_str() };
        match textures.scalar(context, p, name, 0.0)? {
            Scalar::Constant(r) if !(0.0..=1e3).contains(&r) => {
                Err(p.get(name).map_or(p.place, |p| p.place).fault(format!("a roughness of {r}"), "0 (smooth) to 1"))
            }
            other => Ok(other),
        }
    };
    let along = checked(&u)?;
    if p.get(&u).is_none() && p.get(&v).is_none() {
        return Ok((along, None));
    }
    Ok(match (along, checked(&v)?) {
        (Scalar::Constant(u), Scalar::Constant(v)) if u == v => (Scalar::Constant(u), None),
        (u, v) => (u, Some(v)),
    })
}

fn power(value: Scalar, exponent: f32) -> Scalar {
    match value {
        Scalar::Constant(v) => Scalar::Constant(v.max(0.0).powf(exponent)),
        Scalar::Graph(graph) => Scalar::Graph(Arc::new(Graph::Power(graph, exponent))),
        other => other,
    }
}

fn scaled(color: Color, factor: f32) -> Color {
    if factor == 1.0 {
        return color;
    }
    match color {
        Color::Constant { rgb, .. } => {
            let c = (rgb * factor).clamp(glam::Vec3::ZERO, glam::Vec3::ONE);
            Color::rgb(c.x, c.y, c.z)
        }
        Color::Graph(graph) => Color::Graph(Arc::new(Graph::Scale(graph, Arc::new(Graph::Constant(glam::Vec3::splat(factor)))))),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Description;

    const HEAD: &str = "Camera \"perspective\"\n";

    fn try_load(text: &str) -> Result<Description, String> {
        let gone = |_: &str| Err("there is no such file".to_owned());
        super::super::load(text.as_bytes(), "test.pbrt", &gone).map_err(|e| e.to_string())
    }

    fn load(text: &str) -> Description {
        try_load(text).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn hair_has_all_its_parametrisations() {
        let hair = |text: &str| {
            let d = load(&format!(
                "{HEAD}WorldBegin Texture \"t\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [3 2 1] \"rgb tex2\" [0 0 0]\n\
                 Material \"hair\" {text} Shape \"sphere\""
            ));
            let Scattering::Hair(hair) = &d.materials[d.objects[0].material as usize].scattering else { panic!("hair") };
            (hair.as_ref().clone(), d.warnings)
        };
        let (brown, warnings) = hair("");
        assert!(warnings.is_empty() && brown.eta == 1.55, "{warnings:?}");
        let constant = |s: &Scalar| if let Scalar::Constant(v) = s { *v } else { f32::NAN };
        assert_eq!([&brown.beta_m, &brown.beta_n, &brown.alpha].map(constant), [0.3, 0.3, 2.0]);
        assert!(matches!(&brown.pigment, Pigment::Melanin { eumelanin, pheomelanin, .. }
            if constant(eumelanin) == 1.3 && constant(pheomelanin) == 0.0));
        let (red, _) = hair("\"float pheomelanin\" 0.8 \"float beta_m\" 0.25 \"float alpha\" 0 \"float eta\" 1.4");
        assert!(matches!(&red.pigment, Pigment::Melanin { eumelanin, pheomelanin, .. }
            if constant(eumelanin) == 0.0 && constant(pheomelanin) == 0.8));
        assert!(red.eta == 1.4 && constant(&red.beta_m) == 0.25 && constant(&red.alpha) == 0.0);
        assert!(matches!(hair("\"rgb sigma_a\" [0.8 1.2 3]").0.pigment, Pigment::Absorption(_)));
        assert!(matches!(hair("\"texture sigma_a\" \"t\"").0.pigment, Pigment::AbsorptionMap(_)));
        for name in ["reflectance", "color"] {
            assert!(matches!(hair(&format!("\"rgb {name}\" [0.8 0.5 0.3]")).0.pigment, Pigment::Reflectance(_)));
        }
        let (first, warnings) = hair("\"rgb sigma_a\" [1 1 1] \"float eumelanin\" 1");
        assert!(matches!(first.pigment, Pigment::Absorption(_)) && warnings[0].contains("only sigma_a is used"), "{warnings:?}");
        for (bad, found) in [("\"float eumelanin\" -1", "eumelanin of -1"), ("\"float eta\" 0", "an index of refraction of 0")] {
            let error = try_load(&format!("{HEAD}WorldBegin Material \"hair\" {bad}")).unwrap_err();
            assert!(error.contains(found), "{error}");
        }
    }

    #[test]
    fn displacement_turns_the_shading_normal() {
        // A square of 2 m, its height from 0 to 0.5 m along u: a slope of a quarter.
        let text = "Texture \"ramp\" \"float\" \"bilerp\" \"float v00\" 0 \"float v01\" 0 \"float v10\" 0.5 \"float v11\" 0.5\n\
            Material \"diffuse\" \"texture displacement\" \"ramp\"\n\
            Shape \"bilinearmesh\" \"point3 P\" [-1 -1 4  1 -1 4  -1 1 4  1 1 4]";
        for head in ["LookAt 0 0 0  0 0 1  0 1 0\n", "Scale -1 1 1 LookAt 0 0 0  0 0 1  0 1 0\n"] {
            let d = load(&format!("{head}{HEAD}WorldBegin {text}"));
            assert!(d.warnings.is_empty(), "{:?}", d.warnings);
            let scene = crate::Scene::build(d).unwrap();
            let view = &scene.description().cameras[0];
            let direction = view.world_from_camera.transform_vector3(glam::Vec3::NEG_Z).normalize();
            let ray = diopter_light::Ray { origin: view.world_from_camera.translation.into(), direction, time_s: 0.0 };
            let surface = scene.intersect(&ray, f32::INFINITY).expect("the square");
            let bump = scene.material(surface.object).bump.as_ref().expect("bumps");
            let normal = bump.normal(&surface);
            // Along ±x, whichever way the world was mirrored; u grows along the x of the file.
            let along = normal - surface.ns * surface.ns.dot(normal);
            let slope = along.length() / normal.dot(surface.ns);
            assert!((slope - 0.25).abs() < 1e-3 && along.y.abs() < 1e-4, "{normal}");
            let crate::shape::Detail::Derivatives([across, _]) = surface.detail else { panic!("no coordinates") };
            assert!(along.dot(across) < 0.0, "{along}");
        }
        let even = load(&format!("{HEAD}WorldBegin Material \"diffuse\" \"float displacement\" 0.1 Shape \"sphere\""));
        assert!(even.materials[0].bump.is_none() && even.warnings.is_empty(), "{:?}", even.warnings);
    }
}

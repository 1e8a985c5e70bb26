//! Materials of OBJ files. Source: Wavefront's MTL specification (1995) and its physically based extension (Pr, Pm, Ke, norm; Clara.io 2015).

use super::super::mesh::{BYTE_ORDER_MARK, GREY};
use super::super::{Fetch, note_missing, stand_in, udim};
use super::joined_lines;
use crate::material::{Bump, BumpUnit, Conductor, Coverage, Emission, EmissionColor, Material, Principled, Scattering};
use crate::scene::MissingTexture;
use crate::texture::{Codes, Color, Graph, Scalar, Texture, Wrap};
use diopter_light::Spectrum;
use diopter_light::color::SRGB_LUMINANCE;
use glam::{Affine2, Vec2, Vec3};
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// The channel of all colours together.
const LUMINANCE: usize = 4;

/// Height from black to white of a picture of bumps of strength 1, as a fraction of the picture's side: the specification says no unit. Tuned by
/// eye so that features of ten texels of a picture of a thousand rise by 45°.
const BUMP_EXTENT: f32 = 0.01;

/// Statements of numbers, and how many they take.
const NUMBERS: [(&str, usize); 10] =
    [("Kd", 3), ("Ks", 3), ("Ke", 3), ("Ns", 1), ("Ni", 1), ("d", 1), ("Tr", 1), ("illum", 1), ("Pr", 1), ("Pm", 1)];

/// Statements of pictures.
const PICTURES: [&str; 10] = ["map_Kd", "map_Ke", "map_d", "map_Bump", "bump", "norm", "disp", "map_disp", "map_Pr", "map_Pm"];

/// Pictures that are told of: what they say has no place here.
const UNREAD: [&str; 8] = ["map_Ks", "map_Ns", "map_Ps", "map_Tr", "map_opacity", "decal", "refl", "map_refl"];

/// Statements of numbers that are told of where they are not what they are without: a tint of what comes through, and the coat, sheen and anisotropy of the physically based extension.
const UNREAD_NUMBERS: [(&str, f32); 6] = [("Tf", 1.0), ("Pc", 0.0), ("Pcr", 0.0), ("Ps", 0.0), ("aniso", 0.0), ("anisor", 0.0)];

/// Statements without an effect on a picture of a camera: light from nowhere, how textures are smoothed, reflection maps sharpened.
const WITHOUT_EFFECT: [&str; 5] = ["Ka", "map_Ka", "map_aat", "sharpness", "Km"];

/// Options before the name of a picture, and the most values that follow them.
const OPTIONS: [(&str, usize); 13] = [
    ("-blendu", 1),
    ("-blendv", 1),
    ("-bm", 1),
    ("-boost", 1),
    ("-cc", 1),
    ("-clamp", 1),
    ("-imfchan", 1),
    ("-mm", 2),
    ("-o", 3),
    ("-s", 3),
    ("-t", 3),
    ("-texres", 1),
    ("-type", 1),
];

/// All materials of an OBJ file, in the order in which its reader counts them.
#[derive(Default)]
pub(super) struct Library {
    pub materials: Vec<MtlMaterial>,
    /// Whether a file of them is missing.
    incomplete: bool,
}

/// A material as it is written.
pub(super) struct MtlMaterial {
    name: String,
    /// By their keys as the tables above spell them; of several the last counts.
    numbers: HashMap<&'static str, Vec<f32>>,
    pictures: HashMap<&'static str, Picture>,
}

/// A picture with its options.
#[derive(Debug, PartialEq)]
struct Picture {
    /// Its file.
    name: String,
    /// Its file as seen from the folder of the materials, where that is another one.
    beside: Option<String>,
    options: HashMap<&'static str, Vec<String>>,
}

impl Picture {
    /// Splits what stands behind the key; `None` where there is no name. The name is all behind the options, with the spaces in it.
    fn new(text: &str, folder: &str) -> Option<Picture> {
        let (mut left, mut options) = (text.trim(), HashMap::new());
        while let Some((key, most)) = OPTIONS.iter().find(|(key, _)| left.split_whitespace().next() == Some(key)) {
            left = left[key.len()..].trim_start();
            let mut values = Vec::new();
            // Up to three numbers follow some options: the name begins with the first word that is none.
            while values.len() < *most {
                let word = left.split_whitespace().next()?;
                if *most > 1 && word.parse::<f32>().is_err() {
                    break;
                }
                values.push(word.to_owned());
                left = left[word.len()..].trim_start();
            }
            options.insert(*key, values);
        }
        let name = left.replace('\\', "/");
        let beside = (!folder.is_empty()).then(|| format!("{folder}/{name}"));
        (!name.is_empty()).then_some(Picture { name, beside, options })
    }

    /// The numbers of an option; none where it is not there.
    fn numbers(&self, option: &str) -> Vec<f32> {
        let values = self.options.get(option).into_iter().flatten();
        values.filter_map(|v| v.parse().ok()).filter(|v: &f32| v.is_finite()).collect()
    }

    /// How image coordinates follow from the mesh's, of rows that count from below.
    fn image_from_uv(&self) -> Affine2 {
        let [scale, shift] = [("-s", 1.0), ("-o", 0.0)].map(|(option, usual)| {
            let numbers = self.numbers(option);
            Vec2::from_array([0, 1].map(|k| numbers.get(k).copied().unwrap_or(usual)))
        });
        Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y)
            * Affine2::from_scale_angle_translation(scale, 0.0, shift)
    }

    fn texture(&self, picture: udim::Picture, codes: Codes) -> Texture {
        let clamps = self.options.get("-clamp").is_some_and(|v| v.iter().any(|v| v == "on"));
        let wrap = [if clamps { Wrap::Clamp } else { Wrap::Repeat }; 2];
        let (wrap, image_from_uv) = (picture.wrap(wrap), picture.image_from_unit * self.image_from_uv());
        Texture { codes, wrap, image_from_uv, ..Texture::color(picture.image) }
    }

    /// A number for each place: `factor` times the channel that it names, by "-mm base gain" base + gain of that.
    fn scalar(&self, picture: udim::Picture, factor: f32) -> Scalar {
        self.scalar_of(picture, factor, None)
    }

    /// The same of a channel, where no option says another: 0 to 3 for red, green, blue and opacity, [`LUMINANCE`] for all colours.
    fn scalar_of(&self, picture: udim::Picture, factor: f32, channel: Option<usize>) -> Scalar {
        let said =
            self.options.get("-imfchan").and_then(|v| ["r", "g", "b", "m", "l"].iter().position(|c| v.iter().any(|v| v == c)));
        let is_grey = picture.image.is_grey();
        let channel = said.or(channel).unwrap_or(0);
        // All channels of what is grey are alike.
        let channel = if channel == LUMINANCE && is_grey { 0 } else { channel };
        let texture = self.texture(picture, Codes::Linear);
        let range = self.numbers("-mm");
        let (base, gain) = (range.first().copied().unwrap_or(0.0), range.get(1).copied().unwrap_or(1.0));
        if base == 0.0 && channel != LUMINANCE {
            return Scalar::Textured { factor: factor * gain, texture, channel };
        }
        let weights = match channel {
            0..=2 => [Vec3::AXES[channel], Vec3::ZERO],
            LUMINANCE => [SRGB_LUMINANCE, Vec3::ZERO],
            _ => [Vec3::ZERO, Vec3::ONE],
        };
        let picture = Graph::Image { texture, scale: 1.0, invert: false, as_number: Some(weights), mapping: None };
        let [from, to] = [base, base + gain].map(|v| Arc::new(Graph::Constant(Vec3::splat(factor * v))));
        Scalar::Graph(Arc::new(Graph::Mix(from, to, Arc::new(picture))))
    }
}

impl Library {
    /// Adds the materials of a file, or of several that one statement names; what an OBJ reader wants to know of them. What is missing or cannot be read is a warning.
    pub fn add(
        &mut self,
        file: &str,
        obj: &str,
        fetch: Fetch,
        warnings: &mut Vec<String>,
    ) -> (Vec<tobj::Material>, HashMap<String, usize>) {
        let before = self.materials.len();
        let whole = fetch(file);
        // Names may hold spaces, and several may stand behind one another.
        let files: Vec<(&str, Result<Vec<u8>, String>)> = match whole {
            Err(_) if file.contains(char::is_whitespace) => file.split_whitespace().map(|file| (file, fetch(file))).collect(),
            whole => vec![(file, whole)],
        };
        for (file, bytes) in files {
            match bytes {
                Ok(bytes) => self.read(&bytes, file, warnings),
                Err(e) => {
                    self.incomplete = true;
                    warnings.push(format!("{obj}: material file {file}: {e}: its materials are grey"));
                }
            }
        }
        let added = &self.materials[before..];
        let named = |m: &MtlMaterial| tobj::Material { name: m.name.clone(), ..Default::default() };
        (added.iter().map(named).collect(), added.iter().enumerate().map(|(i, m)| (m.name.clone(), i)).collect())
    }

    fn read(&mut self, bytes: &[u8], file: &str, warnings: &mut Vec<String>) {
        let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
        let text = String::from_utf8_lossy(&joined_lines(bytes)).into_owned();
        let folder = file.replace('\\', "/").rsplit_once('/').map_or(String::new(), |(folder, _)| folder.to_owned());
        let mut material: Option<MtlMaterial> = None;
        let (mut unread, mut unknown) = (BTreeSet::new(), BTreeSet::new());
        for (i, line) in text.lines().enumerate() {
            let line = line.trim();
            let key = line.split_whitespace().next().unwrap_or_default();
            let rest = line[key.len()..].trim();
            let mut bad = |expected: &str| {
                let shown: String = line.chars().take(80).collect();
                warnings.push(format!("{file}: line {}: \"{shown}\" is left out; expected {expected}", i + 1));
            };
            if key.eq_ignore_ascii_case("newmtl") {
                self.materials.extend(material.take());
                match rest.is_empty() {
                    true => bad("newmtl and a name"),
                    false => {
                        material = Some(MtlMaterial { name: rest.to_owned(), numbers: HashMap::new(), pictures: HashMap::new() })
                    }
                }
                continue;
            }
            let Some(material) = &mut material else { continue };
            if let Some((key, count)) = NUMBERS.iter().find(|(k, _)| k.eq_ignore_ascii_case(key)) {
                // Some exporters write "d -halo 0.5".
                let numbers = rest.trim_start_matches("-halo").split_whitespace();
                let numbers: Vec<f32> = numbers.map_while(|w| w.parse().ok()).filter(|v: &f32| v.is_finite()).collect();
                match numbers.len() {
                    n if n >= *count => drop(material.numbers.insert(key, numbers)),
                    1 => drop(material.numbers.insert(key, vec![numbers[0]; *count])),
                    _ if rest.is_empty() => (),
                    _ => bad(if *count == 1 { "a number" } else { "one number or three" }),
                }
            } else if let Some(key) = PICTURES.iter().find(|k| k.eq_ignore_ascii_case(key)) {
                if let Some(picture) = Picture::new(rest, &folder) {
                    material.pictures.insert(key, picture);
                }
            } else if let Some(key) = UNREAD.iter().find(|k| k.eq_ignore_ascii_case(key))
                && !rest.is_empty()
            {
                unread.insert(*key);
            } else if let Some((key, usual)) = UNREAD_NUMBERS.iter().find(|(k, _)| k.eq_ignore_ascii_case(key)) {
                let mut numbers = rest.split_whitespace().filter_map(|w| w.parse::<f32>().ok());
                if numbers.any(|v| v != *usual) {
                    unknown.insert(*key);
                }
            } else if !key.is_empty() && !key.starts_with('#') && !WITHOUT_EFFECT.iter().any(|k| k.eq_ignore_ascii_case(key)) {
                unknown.insert(key);
            }
        }
        self.materials.extend(material);
        for (names, what) in [(unread, "pictures that are not read"), (unknown, "statements that are not read")] {
            if !names.is_empty() {
                let list: Vec<&str> = names.iter().take(8).copied().collect();
                let more = if names.len() > 8 { format!(" and {} more", names.len() - 8) } else { String::new() };
                warnings.push(format!("{file}: {}{more}: {what}", list.join(", ")));
            }
        }
    }

    /// Warns of names that no file knows; where a file is missing that was told.
    pub fn warn_of_unknown(&self, asked: &BTreeSet<String>, obj: &str, warnings: &mut Vec<String>) {
        let is_known = |name: &&String| self.materials.iter().any(|m| m.name == **name);
        let unknown: Vec<&str> = asked.iter().filter(|name| !is_known(name)).map(String::as_str).collect();
        if !self.incomplete && !unknown.is_empty() {
            let list = unknown.iter().take(8).copied().collect::<Vec<_>>().join(", ");
            let more = if unknown.len() > 8 { format!(" and {} more", unknown.len() - 8) } else { String::new() };
            warnings.push(format!("{obj}: no material file has {list}{more}: what is made of them is grey"));
        }
    }
}

/// Pictures that were read, by their names.
pub(super) struct Pictures<'a> {
    fetch: Fetch<'a>,
    read: HashMap<String, Option<udim::Picture>>,
    pub missing: Vec<MissingTexture>,
}

impl<'a> Pictures<'a> {
    pub fn new(fetch: Fetch<'a>) -> Self {
        Pictures { fetch, read: HashMap::new(), missing: Vec::new() }
    }

    fn get(&mut self, picture: &Picture) -> Option<udim::Picture> {
        if let Some(known) = self.read.get(&picture.name) {
            return known.clone();
        }
        // Beside the OBJ file, or beside its materials.
        let read = |name: &str| udim::read(name, &mut |name| (self.fetch)(name));
        let found = match (read(&picture.name), &picture.beside) {
            (Err(e), Some(beside)) => read(beside).map_err(|_| e),
            (found, _) => found,
        };
        let image = found.map_err(|e| note_missing(&mut self.missing, &picture.name, e)).ok();
        self.read.insert(picture.name.clone(), image.clone());
        image
    }
}

impl MtlMaterial {
    fn number(&self, key: &str) -> Option<f32> {
        self.numbers.get(key).and_then(|v| v.first().copied())
    }

    fn rgb(&self, key: &str) -> Option<Vec3> {
        self.numbers.get(key).map(|v| Vec3::new(v[0], v[1], v[2]))
    }

    /// The first of some pictures that is there and can be read.
    fn picture<'m>(&'m self, keys: &[&'static str], pictures: &mut Pictures) -> Option<(&'m Picture, udim::Picture)> {
        keys.iter().find_map(|key| {
            let picture = self.pictures.get(key)?;
            Some((picture, pictures.get(picture)?))
        })
    }

    /// What its picture multiplies; many files leave it at 0 and mean the picture.
    fn picture_factor(factor: Option<Vec3>) -> Vec3 {
        factor.filter(|f| *f != Vec3::ZERO).unwrap_or(Vec3::ONE)
    }

    /// Fraction of its opacity that a picture is not asked for. 1 of `Tr`, what is not there at all, is meant for the opposite by the programs that write it.
    fn opacity(&self) -> f32 {
        let through = self.number("Tr").filter(|t| *t < 1.0).map(|t| 1.0 - t);
        self.number("d").or(through).unwrap_or(1.0).clamp(0.0, 1.0)
    }

    /// The material, and the heights that displace what is made of it (in the file's unit).
    pub fn make(&self, pictures: &mut Pictures) -> (Material, Option<Scalar>) {
        let diffuse = self.rgb("Kd").map(|k| k.clamp(Vec3::ZERO, Vec3::ONE));
        let color = match self.pictures.get("map_Kd").map(|p| (p, pictures.get(p))) {
            Some((p, Some(i))) => {
                let gain = p.numbers("-mm").get(1).copied().unwrap_or(1.0);
                Color::Textured { factor: Self::picture_factor(diffuse) * gain, texture: p.texture(i, Codes::Srgb) }
            }
            // Whatever Kd is, what stands in for the picture is seen.
            Some((p, None)) => Color::Textured { factor: Vec3::ONE, texture: p.texture(stand_in().into(), Codes::Srgb) },
            None => {
                let rgb = diffuse.unwrap_or(Vec3::splat(GREY));
                Color::rgb(rgb.x, rgb.y, rgb.z)
            }
        };
        let specular = self.rgb("Ks").unwrap_or(Vec3::ZERO).clamp(Vec3::ZERO, Vec3::ONE);
        // Blinn's exponent as a GGX width. Source: Walter et al. 2007: α² = 2 / (n + 2).
        let by_exponent = || self.number("Ns").map_or(1.0, |n| (2.0 / (n.max(0.0) + 2.0)).powf(0.25));
        let roughness = self.number("Pr").unwrap_or_else(by_exponent).clamp(0.0, 1.0);
        let of_picture = |key: &'static str, without: f32, pictures: &mut Pictures| match self.picture(&[key], pictures) {
            Some((p, i)) => p.scalar(i, 1.0),
            None => Scalar::Constant(without),
        };
        let rough = of_picture("map_Pr", roughness, pictures);
        let metallic = of_picture("map_Pm", self.number("Pm").unwrap_or(0.0).clamp(0.0, 1.0), pictures);
        let ior = self.number("Ni").filter(|n| (1.0..=4.0).contains(n)).unwrap_or(1.5);
        let opacity = self.opacity();
        let illumination = self.number("illum").map_or(0, |n| n as u32);
        let glass = matches!(illumination, 4 | 6 | 7 | 9) && opacity < 1.0;
        let mirror = illumination == 3 && diffuse == Some(Vec3::ZERO) && specular != Vec3::ZERO;
        let is_physical = ["Pr", "Pm"].iter().any(|k| self.numbers.contains_key(k))
            || ["map_Pr", "map_Pm"].iter().any(|k| self.pictures.contains_key(k));
        let scattering = if glass {
            Scattering::Principled(Box::new(Principled::glass(ior.max(1.01))))
        } else if mirror {
            let k = |i: usize| 2.0 * specular[i].min(0.9999).sqrt() / (1.0 - specular[i].min(0.9999)).sqrt();
            let rgb = Vec3::new(k(0), k(1), k(2));
            let points = [(460.0, rgb.z), (545.0, rgb.y), (610.0, rgb.x)];
            Scattering::Conductor(Conductor {
                across: None,
                n: Spectrum::Constant(1.0),
                k: Spectrum::TableOfRgb { table: diopter_light::spectrum::Table::from_points(&points), rgb },
                alpha: Scalar::Constant(roughness * roughness),
                bounces: crate::material::conductor::FacetBounces::Compensated,
                tint: None,
            })
        } else if specular != Vec3::ZERO || is_physical {
            // A half stands for the reflectance of glass, as Blender writes it; more and less of it is an index.
            let strength = if is_physical || specular == Vec3::ZERO { 0.5 } else { specular.max_element() };
            let root = ((2.0 * strength).sqrt() * (ior - 1.0) / (ior + 1.0)).clamp(0.0, 0.9);
            let gloss = Principled::new(color, ((1.0 + root) / (1.0 - root)).max(1.01));
            let tint = if is_physical || specular == Vec3::ZERO { Vec3::ONE } else { specular / strength };
            Scattering::Principled(Box::new(Principled { roughness: rough, metallic, ..gloss.with_specular(tint) }))
        } else {
            Scattering::Diffuse(color)
        };
        let mut made = Material::new(&self.name, scattering);
        made.emission = self.emission(pictures);
        if !glass {
            made.coverage = match self.picture(&["map_d"], pictures) {
                Some((p, i)) => {
                    // Its opacity, where it has one, also of the very picture of the colour; else its brightness.
                    let of_color = self.pictures.get("map_Kd").is_some_and(|color| color.name == p.name);
                    let channel = if i.image.has_alpha() || of_color { 3 } else { LUMINANCE };
                    Coverage::Blend(p.scalar_of(i, opacity, Some(channel)))
                }
                None if opacity < 1.0 => Coverage::Blend(Scalar::Constant(opacity)),
                None => Coverage::Full,
            };
        }
        self.add_bumps(&mut made, pictures);
        let height = self.picture(&["disp", "map_disp"], pictures).map(|(p, i)| p.scalar(i, 1.0));
        (made, height)
    }

    /// In cd/m², as an emissive factor of glTF.
    fn emission(&self, pictures: &mut Pictures) -> Option<Emission> {
        let glow = self.rgb("Ke").map(|k| k.max(Vec3::ZERO));
        let dark = Emission { two_sided: false, ..Emission::one_sided(Spectrum::light_from_rgb(Vec3::ZERO)) };
        if let Some((p, i)) = self.picture(&["map_Ke"], pictures) {
            let (factor, texture) = (Self::picture_factor(glow), p.texture(i, Codes::Srgb));
            return Some(Emission { radiance: EmissionColor::Textured { factor, texture }, ..dark });
        }
        let glow = glow.filter(|k| *k != Vec3::ZERO)?;
        Some(Emission { radiance: EmissionColor::Constant(Spectrum::light_from_rgb(glow)), ..dark })
    }

    /// "norm" is a map of normals; "map_Bump" and "bump" are heights by the specification, but many programs write normals there, too, which shows by their
    /// lengths.
    fn add_bumps(&self, made: &mut Material, pictures: &mut Pictures) {
        if let Some((p, i)) = self.picture(&["norm"], pictures) {
            made.normal_map = Some((p.texture(i, Codes::Linear), 1.0));
        } else if let Some((p, i)) = self.picture(&["map_Bump", "bump"], pictures) {
            let strength = p.numbers("-bm").first().copied().unwrap_or(1.0);
            match !i.image.is_grey() && i.image.is_of_normals() {
                true => made.normal_map = Some((p.texture(i, Codes::Linear), strength)),
                false => {
                    let height = p.scalar_of(i, strength, Some(LUMINANCE));
                    made.bump = Some(Box::new(Bump { height, unit: BumpUnit::Extent(BUMP_EXTENT) }));
                }
            }
        }
    }
}

//! Extensions of glTF's materials, each read beside written: what they say of a [`Principled`] material.
//!
//! Another one is a line of [`EXTENSIONS`] with its two functions. Elsewhere (`load/gltf/materials.rs`, `save/materials.rs`) is what the `gltf` crate reads by itself:
//! KHR_materials_emissive_strength, _ior, _transmission, _unlit, _volume.

use crate::material::film::THICKEST_NM;
use crate::material::{Anisotropy, CoatNormal, Film, Principled, Sheen, Transmission};
use crate::texture::{Codes, Color, Scalar, Texture};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use glam::Vec3;
use serde_json::{Value, json};

/// An extension that says something of a material.
pub(crate) struct Extension {
    pub name: &'static str,
    /// Gives a material what a file says. What is no such extension has been read: index, transmission, whether it is a body.
    pub read: fn(&mut Principled, &Source),
    /// What is to be written of a material; `None` where it has nothing of the kind.
    pub write: fn(&Principled, &mut dyn Sink) -> Option<Value>,
}

/// All of them, in the order in which they are written.
pub(crate) const EXTENSIONS: &[Extension] = &[
    Extension { name: "KHR_materials_dispersion", read: read_dispersion, write: write_dispersion },
    Extension { name: "KHR_materials_specular", read: read_specular, write: write_specular },
    Extension { name: "KHR_materials_anisotropy", read: read_anisotropy, write: write_anisotropy },
    Extension { name: "KHR_materials_sheen", read: read_sheen, write: write_sheen },
    Extension { name: "KHR_materials_iridescence", read: read_iridescence, write: write_iridescence },
    Extension { name: "KHR_materials_clearcoat", read: read_clearcoat, write: write_clearcoat },
];

/// What is read from.
pub(crate) struct Source<'a> {
    /// What the file says under the extension's name.
    pub json: &'a Value,
    /// The picture that a reference in the file means, if it is there.
    pub texture: &'a dyn Fn(&Value, Codes) -> Option<Texture>,
}

impl Source<'_> {
    fn texture(&self, key: &str, codes: Codes) -> Option<Texture> {
        (self.texture)(self.json.get(key)?, codes)
    }

    fn number(&self, key: &str, default: f32) -> f32 {
        self.json.get(key).and_then(Value::as_f64).map(|v| v as f32).filter(|v| v.is_finite()).unwrap_or(default)
    }

    /// A number times a channel of a picture, by their keys.
    fn scalar(&self, factor: &str, default: f32, texture: &str, channel: usize) -> Scalar {
        Scalar::with_picture(self.number(factor, default), self.texture(texture, Codes::Linear), channel)
    }

    /// A colour times a picture, by their keys.
    fn color(&self, factor: &str, default: f32, texture: &str) -> Color {
        let listed = self.json.get(factor);
        let at = |i: usize| listed.and_then(|v| v.get(i)).and_then(Value::as_f64).map_or(default, |v| v as f32);
        Color::with_picture(Vec3::new(at(0), at(1), at(2)), self.texture(texture, Codes::Srgb))
    }
}

/// What is written into.
pub(crate) trait Sink {
    /// Keeps a picture; the reference to it.
    fn texture(&mut self, texture: &Texture) -> Value;
    /// Factor and picture of a colour.
    fn color(&mut self, color: &Color) -> (Vec3, Option<Value>);
    /// A number, or the mean of one that differs from place to place.
    fn number(&mut self, scalar: &Scalar) -> f32;
}

/// Factor and picture of a number that the extension looks for in a channel; of other pictures only a factor of 1.
fn factor_and_picture(scalar: &Scalar, channel: usize, sink: &mut dyn Sink) -> (f32, Option<Value>) {
    match scalar {
        Scalar::Constant(number) => (*number, None),
        Scalar::Textured { factor, texture, channel: own } if *own == channel => (*factor, Some(sink.texture(texture))),
        _ => (1.0, None),
    }
}

fn read_dispersion(p: &mut Principled, source: &Source) {
    let spread = source.json.get("dispersion").and_then(Value::as_f64).filter(|d| *d > 0.0);
    if let (Some(spread), Transmission::Solid) = (spread, &p.kind) {
        // 20 over Abbe's number.
        let (nd, abbe) = (f64::from(p.ior), 20.0 / spread);
        let index = |nm: f64| (nd + (nd - 1.0) / abbe * (523_655.0 / (nm * nm) - 1.5168)).max(1.0) as f32;
        let table = Table::new(380.0, 5.0, (0..=80).map(|i| index(380.0 + 5.0 * f64::from(i))).collect());
        p.dispersion = Some(Spectrum::Table(table));
    }
}

fn write_dispersion(p: &Principled, _: &mut dyn Sink) -> Option<Value> {
    let n = p.dispersion.as_ref().filter(|_| matches!(p.kind, Transmission::Solid))?;
    let abbe = (n.at(587.56) - 1.0) / (n.at(486.13) - n.at(656.27)).max(1e-6);
    Some(json!({ "dispersion": (20.0 / abbe).max(0.0) }))
}

fn read_specular(p: &mut Principled, source: &Source) {
    p.specular = source.scalar("specularFactor", 1.0, "specularTexture", 3);
    // Beyond 1 it may be more than an albedo.
    p.specular_color = source.color("specularColorFactor", 1.0, "specularColorTexture");
    p.tinted = true;
}

fn write_specular(p: &Principled, sink: &mut dyn Sink) -> Option<Value> {
    if !p.tinted {
        return None;
    }
    let (weight, (tint, _)) = (sink.number(&p.specular), sink.color(&p.specular_color));
    Some(json!({ "specularFactor": weight, "specularColorFactor": tint.to_array() }))
}

fn read_anisotropy(p: &mut Principled, source: &Source) {
    p.anisotropy = Some(Box::new(Anisotropy::Brushed {
        strength: source.number("anisotropyStrength", 0.0),
        rotation: source.number("anisotropyRotation", 0.0),
        texture: source.texture("anisotropyTexture", Codes::Linear),
    }));
}

/// Of glTF's own kind; a roughness of two directions changes that of the base, too, and is written with it.
fn write_anisotropy(p: &Principled, sink: &mut dyn Sink) -> Option<Value> {
    let Some(Anisotropy::Brushed { strength, rotation, texture }) = p.anisotropy.as_deref() else { return None };
    let mut json = json!({ "anisotropyStrength": strength, "anisotropyRotation": rotation });
    if let Some(texture) = texture {
        json["anisotropyTexture"] = sink.texture(texture);
    }
    Some(json)
}

fn read_sheen(p: &mut Principled, source: &Source) {
    p.sheen = Some(Box::new(Sheen {
        color: source.color("sheenColorFactor", 0.0, "sheenColorTexture"),
        roughness: source.scalar("sheenRoughnessFactor", 0.0, "sheenRoughnessTexture", 3),
    }));
}

fn write_sheen(p: &Principled, sink: &mut dyn Sink) -> Option<Value> {
    let sheen = p.sheen.as_ref()?;
    let (rgb, color_picture) = sink.color(&sheen.color);
    let (roughness, roughness_picture) = factor_and_picture(&sheen.roughness, 3, sink);
    let rgb = rgb.clamp(Vec3::ZERO, Vec3::ONE).to_array();
    let mut json = json!({ "sheenColorFactor": rgb, "sheenRoughnessFactor": roughness });
    set(&mut json, "sheenColorTexture", color_picture);
    set(&mut json, "sheenRoughnessTexture", roughness_picture);
    Some(json)
}

fn read_iridescence(p: &mut Principled, source: &Source) {
    p.film = Some(Box::new(Film {
        fraction: source.scalar("iridescenceFactor", 0.0, "iridescenceTexture", 0),
        ior: source.number("iridescenceIor", 1.3),
        between_nm: [("Minimum", 100.0), ("Maximum", 400.0)]
            .map(|(end, default)| source.number(&format!("iridescenceThickness{end}"), default).clamp(0.0, THICKEST_NM)),
        thickness: Scalar::with_picture(1.0, source.texture("iridescenceThicknessTexture", Codes::Linear), 1),
    }));
}

fn write_iridescence(p: &Principled, sink: &mut dyn Sink) -> Option<Value> {
    let film = p.film.as_ref()?;
    let [thin, thick] = film.between_nm;
    let (fraction, fraction_picture) = factor_and_picture(&film.fraction, 0, sink);
    let (_, thickness_picture) = factor_and_picture(&film.thickness, 1, sink);
    let mut json = json!({
        "iridescenceFactor": fraction,
        "iridescenceIor": film.ior,
        "iridescenceThicknessMinimum": thin,
        "iridescenceThicknessMaximum": thick,
    });
    set(&mut json, "iridescenceTexture", fraction_picture);
    set(&mut json, "iridescenceThicknessTexture", thickness_picture);
    Some(json)
}

fn read_clearcoat(p: &mut Principled, source: &Source) {
    p.clearcoat = source.scalar("clearcoatFactor", 0.0, "clearcoatTexture", 0);
    p.clearcoat_roughness = source.scalar("clearcoatRoughnessFactor", 0.0, "clearcoatRoughnessTexture", 1);
    let scale = source.json.get("clearcoatNormalTexture").and_then(|t| t.get("scale")).and_then(Value::as_f64);
    p.coat_normal = Some(Box::new(match source.texture("clearcoatNormalTexture", Codes::Linear) {
        Some(texture) => CoatNormal::Picture { texture, scale: scale.map_or(1.0, |s| s as f32) },
        None => CoatNormal::Surface,
    }));
}

fn write_clearcoat(p: &Principled, sink: &mut dyn Sink) -> Option<Value> {
    let coat = sink.number(&p.clearcoat);
    if !(coat > 0.0) {
        return None;
    }
    let roughness = sink.number(&p.clearcoat_roughness);
    let mut json = json!({ "clearcoatFactor": coat, "clearcoatRoughnessFactor": roughness });
    if let Some(CoatNormal::Picture { texture, scale }) = p.coat_normal.as_deref() {
        json["clearcoatNormalTexture"] = sink.texture(texture);
        json["clearcoatNormalTexture"]["scale"] = json!(scale);
    }
    Some(json)
}

fn set(json: &mut Value, key: &str, picture: Option<Value>) {
    if let Some(picture) = picture {
        json[key] = picture;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file without pictures.
    struct NoPictures;

    impl Sink for NoPictures {
        fn texture(&mut self, _: &Texture) -> Value {
            panic!("a picture")
        }

        fn color(&mut self, color: &Color) -> (Vec3, Option<Value>) {
            let Color::Constant { rgb, .. } = color else { panic!("a picture") };
            (*rgb, None)
        }

        fn number(&mut self, scalar: &Scalar) -> f32 {
            let Scalar::Constant(number) = scalar else { panic!("a picture") };
            *number
        }
    }

    #[test]
    fn what_is_read_is_written_and_nothing_else() {
        let said = [
            ("dispersion", json!({ "dispersion": 0.5 })),
            ("specular", json!({ "specularFactor": 0.5, "specularColorFactor": [1.0, 0.5, 0.25] })),
            ("anisotropy", json!({ "anisotropyStrength": 0.5, "anisotropyRotation": 1.25 })),
            ("sheen", json!({ "sheenColorFactor": [0.5, 0.25, 1.0], "sheenRoughnessFactor": 0.75 })),
            (
                "iridescence",
                json!({ "iridescenceFactor": 0.5, "iridescenceIor": 1.25,
                    "iridescenceThicknessMinimum": 150.0, "iridescenceThicknessMaximum": 250.0 }),
            ),
            ("clearcoat", json!({ "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25 })),
        ];
        assert_eq!(said.len(), EXTENSIONS.len());
        for extension in EXTENSIONS {
            let (_, json) = said.iter().find(|(name, _)| extension.name.ends_with(name)).expect(extension.name);
            let mut p = Principled { kind: Transmission::Solid, ..Principled::new(Color::rgb(0.5, 0.5, 0.5), 1.5) };
            (extension.read)(&mut p, &Source { json, texture: &|_, _| None });
            for other in EXTENSIONS {
                let written = (other.write)(&p, &mut NoPictures);
                if other.name != extension.name {
                    assert_eq!(written, None, "{} of {}", other.name, extension.name);
                    continue;
                }
                let written = written.expect(extension.name);
                // Indices of dispersion lie in a table of 5 nm.
                match json["dispersion"].as_f64() {
                    Some(spread) => assert!((written["dispersion"].as_f64().unwrap() - spread).abs() < 0.01, "{written}"),
                    None => assert_eq!(written, *json),
                }
            }
        }
    }
}

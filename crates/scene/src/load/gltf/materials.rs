//! Materials: what glTF and its extensions say of a surface.

use super::Loader;
use super::pictures::json_transform;
use crate::SceneError;
use crate::light::Modulation;
use crate::material::film::THICKEST_NM;
use crate::material::{
    Anisotropy, Coverage, Emission, EmissionColor, Film, Interior, Material, Principled, Scattering, Sheen, Transmission,
};
use crate::medium::Medium;
use crate::texture::{Codes, Color, Scalar, Texture};
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use diopter_light::upsample::Sigmoid;
use glam::{Affine2, Vec3};
use serde_json::Value;
use std::sync::Arc;

fn color(factor: Vec3, texture: Option<Texture>) -> Color {
    match texture {
        Some(texture) => Color::Textured { factor, texture },
        None => Color::rgb(factor.x, factor.y, factor.z),
    }
}

fn scalar(factor: f32, texture: Option<Texture>, channel: usize) -> Scalar {
    match texture {
        Some(texture) => Scalar::Textured { factor, texture, channel },
        None => Scalar::Constant(factor),
    }
}

/// A number of an extension.
fn number(extension: &Value, key: &str, default: f32) -> f32 {
    extension.get(key).and_then(Value::as_f64).map(|v| v as f32).filter(|v| v.is_finite()).unwrap_or(default)
}

/// Three numbers of an extension.
fn triple(extension: &Value, key: &str, default: f32) -> Vec3 {
    let at = |i: usize| extension.get(key).and_then(|v| v.get(i)).and_then(Value::as_f64).map_or(default, |v| v as f32);
    Vec3::new(at(0), at(1), at(2))
}

impl Loader<'_> {
    pub(super) fn material(&self, m: &gltf::Material) -> Result<Material, SceneError> {
        let name = m.name().map_or_else(|| format!("material {}", m.index().unwrap_or(0)), str::to_owned);
        let pbr = m.pbr_metallic_roughness();
        let [r, g, b, alpha] = pbr.base_color_factor();
        let factor = Vec3::new(r, g, b);
        let base_texture = self.info(pbr.base_color_texture(), Codes::Srgb);
        let alpha = scalar(alpha, base_texture.clone(), 3);
        let coverage = match m.alpha_mode() {
            gltf::material::AlphaMode::Opaque => Coverage::Full,
            gltf::material::AlphaMode::Mask => Coverage::Mask { alpha, cutoff: m.alpha_cutoff().unwrap_or(0.5) },
            gltf::material::AlphaMode::Blend => Coverage::Blend(alpha),
        };
        if m.unlit() {
            // The colour is what is seen: radiance in cd/m², not a lamp to light others by.
            let radiance = match base_texture {
                Some(texture) => EmissionColor::Textured { factor, texture },
                None => EmissionColor::Constant(Spectrum::light_from_rgb(factor)),
            };
            let emission = Some(Emission { radiance, two_sided: true, is_light: false, modulation: Modulation::Steady });
            return Ok(Material { emission, coverage, ..Material::new(&name, Scattering::Black) });
        }

        let metal_rough = self.info(pbr.metallic_roughness_texture(), Codes::Linear);
        let mut principled = Principled {
            metallic: scalar(pbr.metallic_factor(), metal_rough.clone(), 2),
            roughness: scalar(pbr.roughness_factor(), metal_rough, 1),
            ..Principled::new(color(factor, base_texture), m.ior().unwrap_or(1.5).max(1.0))
        };
        if let Some(t) = m.transmission() {
            principled.transmission = scalar(t.transmission_factor(), self.info(t.transmission_texture(), Codes::Linear), 0);
        }
        let mut interior = Interior::Same;
        if let Some(v) = m.volume().filter(|v| v.thickness_factor() > 0.0) {
            let distance = v.attenuation_distance();
            let absorbs = distance.is_finite() && distance > 0.0;
            let color = Sigmoid::from_rgb(Vec3::from_array(v.attenuation_color()));
            principled.kind = Transmission::Solid;
            let medium = absorbs.then(|| Arc::new(Medium::tint(color, distance)));
            let priority = m.extras().as_ref().and_then(|e| serde_json::from_str::<Value>(e.get()).ok());
            let priority = priority.and_then(|e| e.get("priority").and_then(Value::as_i64)).map(|p| p as i32);
            interior = Interior::Body { medium, priority };
            let spread = m.extension_value("KHR_materials_dispersion").and_then(|d| d.get("dispersion")).and_then(Value::as_f64);
            if let Some(spread) = spread.filter(|d| *d > 0.0) {
                // 20 over Abbe's number.
                let (nd, abbe) = (f64::from(principled.ior), 20.0 / spread);
                let index = |nm: f64| (nd + (nd - 1.0) / abbe * (523_655.0 / (nm * nm) - 1.5168)).max(1.0) as f32;
                let table = Table::new(380.0, 5.0, (0..=80).map(|i| index(380.0 + 5.0 * f64::from(i))).collect());
                principled.dispersion = Some(Spectrum::Table(table));
            }
        }
        if let Some(specular) = m.extension_value("KHR_materials_specular") {
            let factor = number(specular, "specularFactor", 1.0);
            principled.specular = scalar(factor, self.json_texture(specular.get("specularTexture"), Codes::Linear), 3);
            // Beyond 1 it may be more than an albedo.
            let tint = self.json_texture(specular.get("specularColorTexture"), Codes::Srgb);
            principled.specular_color = color(triple(specular, "specularColorFactor", 1.0), tint);
            principled.tinted = true;
        }
        if let Some(coat) = m.extension_value("KHR_materials_clearcoat") {
            let texture = |key: &str| self.json_texture(coat.get(key), Codes::Linear);
            principled.clearcoat = scalar(number(coat, "clearcoatFactor", 0.0), texture("clearcoatTexture"), 0);
            let roughness = number(coat, "clearcoatRoughnessFactor", 0.0);
            principled.clearcoat_roughness = scalar(roughness, texture("clearcoatRoughnessTexture"), 1);
        }
        principled.sheen = m.extension_value("KHR_materials_sheen").map(|sheen| {
            let texture = |key: &str, codes| self.json_texture(sheen.get(key), codes);
            Box::new(Sheen {
                color: color(triple(sheen, "sheenColorFactor", 0.0), texture("sheenColorTexture", Codes::Srgb)),
                roughness: scalar(number(sheen, "sheenRoughnessFactor", 0.0), texture("sheenRoughnessTexture", Codes::Linear), 3),
            })
        });
        principled.anisotropy = m.extension_value("KHR_materials_anisotropy").map(|anisotropy| {
            Box::new(Anisotropy::Brushed {
                strength: number(anisotropy, "anisotropyStrength", 0.0),
                rotation: number(anisotropy, "anisotropyRotation", 0.0),
                texture: self.json_texture(anisotropy.get("anisotropyTexture"), Codes::Linear),
            })
        });
        principled.film = m.extension_value("KHR_materials_iridescence").map(|film| {
            let texture = |key: &str| self.json_texture(film.get(key), Codes::Linear);
            Box::new(Film {
                fraction: scalar(number(film, "iridescenceFactor", 0.0), texture("iridescenceTexture"), 0),
                ior: number(film, "iridescenceIor", 1.3),
                between_nm: [("Minimum", 100.0), ("Maximum", 400.0)]
                    .map(|(end, default)| number(film, &format!("iridescenceThickness{end}"), default).clamp(0.0, THICKEST_NM)),
                thickness: scalar(1.0, texture("iridescenceThicknessTexture"), 1),
            })
        });

        let strength = m.emissive_strength().unwrap_or(1.0);
        let glow = Vec3::from_array(m.emissive_factor()) * strength;
        let emission = (glow.max_element() > 0.0).then(|| Emission {
            radiance: match self.info(m.emissive_texture(), Codes::Srgb) {
                Some(texture) => EmissionColor::Textured { factor: glow, texture },
                None => EmissionColor::Constant(Spectrum::light_from_rgb(glow)),
            },
            two_sided: m.double_sided(),
            is_light: true,
            modulation: Modulation::Steady,
        });
        let normal_map = m.normal_texture().and_then(|n| {
            let (set, matrix) = match n.extension_value("KHR_texture_transform") {
                Some(t) => json_transform(Some(&serde_json::json!({ "KHR_texture_transform": t })), n.tex_coord()),
                None => (n.tex_coord(), Affine2::IDENTITY),
            };
            Some((self.texture(&n.texture(), Codes::Linear, set, matrix)?, n.scale()))
        });
        let scattering = Scattering::Principled(Box::new(principled));
        Ok(Material { name, scattering, emission, normal_map, bump: None, coverage, interior })
    }
}

//! Materials: what glTF says of a surface, and those of its extensions that the `gltf` crate reads; the others are in [`crate::material_extensions`].

use super::Loader;
use super::pictures::json_transform;
use crate::SceneError;
use crate::light::Modulation;
use crate::material::{CoatNormal, Coverage, Emission, EmissionColor, Interior, Material, Principled, Scattering, Transmission};
use crate::material_extensions::{EXTENSIONS, Source};
use crate::medium::Medium;
use crate::texture::{Codes, Color, Scalar};
use diopter_light::Spectrum;
use diopter_light::upsample::Sigmoid;
use glam::{Affine2, Vec3};
use serde_json::Value;
use std::sync::Arc;

impl Loader<'_> {
    pub(super) fn material(&self, m: &gltf::Material) -> Result<Material, SceneError> {
        let name = m.name().map_or_else(|| format!("material {}", m.index().unwrap_or(0)), str::to_owned);
        let pbr = m.pbr_metallic_roughness();
        let [r, g, b, alpha] = pbr.base_color_factor();
        let factor = Vec3::new(r, g, b);
        let base_texture = self.info(pbr.base_color_texture(), Codes::Srgb);
        let alpha = Scalar::with_picture(alpha, base_texture.clone(), 3);
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

        let brighter = brighter_specular(m);
        let ior = brighter.map_or(m.ior().unwrap_or(1.5).max(1.0), |(ior, _)| ior);
        let metal_rough = self.info(pbr.metallic_roughness_texture(), Codes::Linear);
        let mut principled = Principled {
            metallic: Scalar::with_picture(pbr.metallic_factor(), metal_rough.clone(), 2),
            roughness: Scalar::with_picture(pbr.roughness_factor(), metal_rough, 1),
            ..Principled::new(Color::with_picture(factor, base_texture), ior)
        };
        if let Some(t) = m.transmission() {
            principled.transmission =
                Scalar::with_picture(t.transmission_factor(), self.info(t.transmission_texture(), Codes::Linear), 0);
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
        }
        for extension in EXTENSIONS {
            if let Some(json) = m.extension_value(extension.name) {
                let texture = |reference: &Value, codes| self.json_texture(reference, codes);
                (extension.read)(&mut principled, &Source { json, texture: &texture });
            }
        }

        if let Some((_, tint)) = brighter {
            let picture = match principled.specular_color {
                Color::Textured { texture, .. } => Some(texture),
                _ => None,
            };
            (principled.specular_color, principled.tinted) = (Color::with_picture(tint, picture), true);
        }

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
        // Nothing that it could differ from.
        if normal_map.is_none() && matches!(principled.coat_normal.as_deref(), Some(CoatNormal::Surface)) {
            principled.coat_normal = None;
        }
        let scattering = Scattering::Principled(Box::new(principled));
        Ok(Material { name, scattering, emission, normal_map, bump: None, coverage, interior })
    }
}

/// Index and tint, 0 to 1, of a dielectric whose `specularColorFactor` is above 1 or whose `ior` is 0, which stands for an index that reflects all at all angles (KHR_materials_ior):
/// the reflectance at normal incidence is that of the index times the factor, at most 1. None of what transmits: there the index bends light, too.
fn brighter_specular(m: &gltf::Material) -> Option<(f32, Vec3)> {
    /// Indices beyond 10 reflect much more than this only at first.
    const MOST: f32 = 0.66;
    let factor = m.extension_value("KHR_materials_specular").and_then(|e| e.get("specularColorFactor"));
    let at = |i: usize| factor.and_then(|v| v.get(i)).and_then(Value::as_f64).map_or(1.0, |v| v as f32).max(0.0);
    let (ior, factor) = (m.ior().unwrap_or(1.5), Vec3::new(at(0), at(1), at(2)));
    if m.transmission().is_some_and(|t| t.transmission_factor() > 0.0) || (factor.max_element() <= 1.0 && ior != 0.0) {
        return None;
    }
    let normal = if ior == 0.0 { 1.0 } else { ((ior.max(1.0) - 1.0) / (ior.max(1.0) + 1.0)).powi(2) };
    let reflected = (factor * normal).min(Vec3::ONE);
    let most = reflected.max_element();
    if most <= 0.0 {
        return None;
    }
    let root = most.min(MOST).sqrt();
    Some(((1.0 + root) / (1.0 - root), reflected / most))
}

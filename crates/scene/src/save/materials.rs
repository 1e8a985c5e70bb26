//! Materials as glTF writes them; extensions that say something of a principled material alone are in [`crate::material_extensions`].

use super::Writer;
use super::{clamped, light_rgb};
use crate::material::{Anisotropy, Coverage, EmissionColor, Interior, Material, Principled, Scattering, Transmission};
use crate::material_extensions::{EXTENSIONS, Sink};
use crate::medium::Coefficient;
use crate::texture::{Codes, Lookup, Scalar, spectrum_rgb};
use diopter_light::Spectrum;
use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

impl Writer {
    pub(super) fn material(&mut self, m: &Material) -> Value {
        let mut json = json!({ "name": m.name });
        let mut extensions = json!({});
        self.scattering(m, &m.scattering, &mut json, &mut extensions);
        if m.bump.is_some() {
            self.warn("there are no bumps that heights give");
        }
        if let Some((texture, scale)) = &m.normal_map {
            json["normalTexture"] = self.texture(texture);
            json["normalTexture"]["scale"] = json!(scale);
        }
        if let Some(emission) = &m.emission {
            let (rgb, picture) = match &emission.radiance {
                EmissionColor::Constant(spectrum) => (light_rgb(spectrum), None),
                EmissionColor::Textured { factor, texture } => (*factor, Some(self.texture(texture))),
                EmissionColor::Captured { factor } => (Vec3::splat(*factor), None),
            };
            // Splats carry their own colours.
            if !emission.is_light && !matches!(emission.radiance, EmissionColor::Captured { .. }) {
                self.warn("what is only bright to look at, but lights nothing, is written as a lamp");
            }
            let strength = rgb.max_element().max(1e-30);
            json["emissiveFactor"] = json!(clamped(rgb / strength));
            if let Some(picture) = picture {
                json["emissiveTexture"] = picture;
            }
            self.extensions.insert("KHR_materials_emissive_strength");
            extensions["KHR_materials_emissive_strength"] = json!({ "emissiveStrength": strength });
            json["doubleSided"] = json!(emission.two_sided);
        }
        match &m.coverage {
            Coverage::Full => {}
            Coverage::Mask { alpha, cutoff } => {
                json["alphaMode"] = json!("MASK");
                json["alphaCutoff"] = json!(cutoff);
                self.alpha(alpha, &mut json);
            }
            Coverage::Blend(alpha) => {
                json["alphaMode"] = json!("BLEND");
                self.alpha(alpha, &mut json);
            }
        }
        if extensions.as_object().is_some_and(|e| !e.is_empty()) {
            json["extensions"] = extensions;
        }
        json
    }

    pub(super) fn alpha(&mut self, alpha: &Scalar, json: &mut Value) {
        let pbr = &mut json["pbrMetallicRoughness"];
        let (factor, in_picture) = match alpha {
            Scalar::Constant(a) => (*a, true),
            Scalar::Textured { factor, channel: 3, .. } => (*factor, !pbr["baseColorTexture"].is_null()),
            _ => (1.0, false),
        };
        if !in_picture {
            self.warnings.insert("holes by a picture of their own are not written".into());
        }
        if pbr["baseColorFactor"].is_array() {
            pbr["baseColorFactor"][3] = json!(factor);
        }
    }

    pub(super) fn scattering(&mut self, m: &Material, scattering: &Scattering, json: &mut Value, extensions: &mut Value) {
        let mut plain = |rgb: Vec3, picture: Option<Value>, metallic: f32, roughness: f32| {
            let [r, g, b] = clamped(rgb);
            json["pbrMetallicRoughness"] = json!({ "baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic.clamp(0.0, 1.0), "roughnessFactor": roughness.clamp(0.0, 1.0) });
            if let Some(picture) = picture {
                json["pbrMetallicRoughness"]["baseColorTexture"] = picture;
            }
        };
        match scattering {
            Scattering::Black => {
                plain(Vec3::ZERO, None, 0.0, 1.0);
                self.matte(extensions);
            }
            Scattering::Interface => {
                plain(Vec3::ONE, None, 0.0, 0.0);
                self.extensions.extend(["KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior"]);
                extensions["KHR_materials_transmission"] = json!({ "transmissionFactor": 1.0 });
                extensions["KHR_materials_ior"] = json!({ "ior": 1.0 });
                self.volume(m, extensions);
            }
            Scattering::Diffuse(color) => {
                let (rgb, picture) = self.color(color);
                plain(rgb, picture, 0.0, 1.0);
                self.matte(extensions);
            }
            Scattering::DiffuseTransmission(colors) => {
                self.warn("no light comes through paper and leaves");
                let (rgb, picture) = self.color(&colors[0]);
                plain(rgb, picture, 0.0, 1.0);
            }
            Scattering::Hair(_) => {
                self.warn("hair is grey");
                plain(Vec3::splat(0.5), None, 0.0, 1.0);
            }
            Scattering::Measured(measured) => {
                self.warn("measured materials are written as metals of their colour and roughness");
                plain(measured.normal_reflectance(), None, 1.0, measured.alpha().sqrt());
            }
            Scattering::Conductor(c) => {
                let [along, across] = [Some(&c.alpha), c.across.as_ref()].map(|a| a.map(|a| self.number(a).max(0.0).sqrt()));
                let along = along.unwrap_or(0.0);
                plain(c.normal_reflectance(), None, 1.0, across.map_or(along, |r| r.min(along)));
                self.anisotropy(along, across, extensions);
            }
            Scattering::Coated(c) => {
                let metal = [Some(&c.metal.alpha), c.metal.across.as_ref()];
                let [along, across] = metal.map(|a| a.map(|a| self.number(a).max(0.0).sqrt()));
                let along = along.unwrap_or(0.0);
                plain(c.metal.normal_reflectance(), None, 1.0, across.map_or(along, |r| r.min(along)));
                self.anisotropy(along, across, extensions);
                if c.across.is_some() {
                    self.warn("of coats that are rougher one way than the other the roughness along the tangent is written");
                }
                let coat = self.number(&c.roughness);
                self.extensions.insert("KHR_materials_clearcoat");
                extensions["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 1.0, "clearcoatRoughnessFactor": coat });
            }
            Scattering::Mix(mix) => {
                let ([a, b], amount) = &**mix;
                self.warn("of a mixture of materials the larger part is written");
                let larger = if self.number(amount) < 0.5 { a } else { b };
                self.scattering(m, larger, json, extensions);
            }
            Scattering::Principled(p) => {
                let (rgb, picture) = self.color(&p.base_color);
                let (metallic, roughness) = (self.factor(&p.metallic), self.factor(&p.roughness));
                plain(rgb, picture, metallic, roughness);
                self.surfaces(p, json);
                if let Some(Anisotropy::Across(across)) = p.anisotropy.as_deref() {
                    let (along, across) = (self.number(&p.roughness), self.number(across));
                    json["pbrMetallicRoughness"]["roughnessFactor"] = json!(along.min(across).clamp(0.0, 1.0));
                    self.anisotropy(along, Some(across), extensions);
                }
                self.principled(m, p, extensions);
            }
        }
    }

    /// Without any gloss.
    pub(super) fn matte(&mut self, extensions: &mut Value) {
        self.extensions.insert("KHR_materials_specular");
        extensions["KHR_materials_specular"] = json!({ "specularFactor": 0.0 });
    }

    /// Roughness (√α) along the tangent and across it as glTF says it: the wider of the two, and how much wider.
    pub(super) fn anisotropy(&mut self, along: f32, across: Option<f32>, extensions: &mut Value) {
        let Some(across) = across.filter(|a| (a - along).abs() > 1e-4) else { return };
        let [narrow, wide] = [along.min(across), along.max(across)].map(|r| r.clamp(0.0, 1.0).powi(2));
        let strength = ((wide - narrow) / (1.0 - narrow).max(1e-6)).clamp(0.0, 1.0).sqrt();
        let rotation = if along > across { 0.0 } else { std::f32::consts::FRAC_PI_2 };
        self.extensions.insert("KHR_materials_anisotropy");
        extensions["KHR_materials_anisotropy"] = json!({ "anisotropyStrength": strength, "anisotropyRotation": rotation });
    }

    /// The constant part of a number that may be a picture.
    pub(super) fn factor(&self, scalar: &Scalar) -> f32 {
        if let Scalar::Constant(v) = scalar { *v } else { 1.0 }
    }

    /// Metal and roughness of pictures.
    pub(super) fn surfaces(&mut self, p: &Principled, json: &mut Value) {
        if let (Scalar::Constant(_), Scalar::Constant(_)) = (&p.metallic, &p.roughness) {
            return;
        }
        let shared = match (&p.metallic, &p.roughness) {
            (Scalar::Textured { factor: m, texture: a, channel: 2 }, Scalar::Textured { factor: r, texture: b, channel: 1 }) => {
                Arc::ptr_eq(&a.image, &b.image).then(|| (a.clone(), *m, *r))
            }
            _ => None,
        };
        let (info, metallic, roughness) = match shared {
            Some((texture, m, r)) => (self.texture(&texture), m, r),
            None => {
                let at = |s: &Scalar, uv: &[Vec2; 2]| s.lookup(&Lookup::uv(uv));
                (self.baked(Codes::Linear, |uv| Vec4::new(0.0, at(&p.roughness, uv), at(&p.metallic, uv), 1.0)), 1.0, 1.0)
            }
        };
        let pbr = &mut json["pbrMetallicRoughness"];
        pbr["metallicRoughnessTexture"] = info;
        (pbr["metallicFactor"], pbr["roughnessFactor"]) = (json!(metallic), json!(roughness));
    }

    pub(super) fn principled(&mut self, m: &Material, p: &Principled, extensions: &mut Value) {
        if (p.ior - 1.5).abs() > 1e-4 {
            if p.ior < 1.0 {
                self.warn("glTF has no index of refraction below 1: bodies thinner than what is around them are written with 1");
            }
            self.extensions.insert("KHR_materials_ior");
            extensions["KHR_materials_ior"] = json!({ "ior": p.ior.max(1.0) });
        }
        if p.layered {
            self.warn("light that goes to and fro below a coat of plastic is not written: bright plastics become paler");
        }
        let transmission = self.number(&p.transmission);
        if transmission > 0.0 {
            self.extensions.insert("KHR_materials_transmission");
            extensions["KHR_materials_transmission"] = json!({ "transmissionFactor": transmission });
        }
        if matches!(p.kind, Transmission::Solid) {
            self.volume(m, extensions);
        }
        for extension in EXTENSIONS {
            if let Some(json) = (extension.write)(p, self) {
                self.extensions.insert(extension.name);
                extensions[extension.name] = json;
            }
        }
    }

    pub(super) fn volume(&mut self, m: &Material, extensions: &mut Value) {
        self.extensions.insert("KHR_materials_volume");
        // A thickness says that there is a body; path tracers take its true shape.
        let mut volume = json!({ "thicknessFactor": 1.0 });
        let medium = match &m.interior {
            Interior::Body { medium, .. } => medium.clone(),
            Interior::Sides([inside, _]) => inside.clone(),
            Interior::Same => None,
        };
        if let Some(medium) = medium {
            match (&medium.absorption, &medium.scattering) {
                _ if medium.volume.is_some() => {}
                (Coefficient::Tint { color, distance_m }, _) => {
                    volume["attenuationColor"] = json!(clamped(spectrum_rgb(&Spectrum::Sigmoid(*color))));
                    volume["attenuationDistance"] = json!(distance_m);
                }
                (Coefficient::Scaled(scale, spectrum), _) if *scale > 0.0 => {
                    // The colour after a metre.
                    let left = |nm: f32| (-scale * spectrum.at(nm)).exp();
                    let table =
                        diopter_light::spectrum::Table::new(380.0, 5.0, (0..=80).map(|i| left(380.0 + 5.0 * i as f32)).collect());
                    volume["attenuationColor"] = json!(clamped(spectrum_rgb(&Spectrum::Table(table))));
                    volume["attenuationDistance"] = json!(1.0);
                }
                _ => {}
            }
            if medium.volume.is_some() {
                self.warn("media that differ from place to place are not there");
            } else if !matches!(medium.scattering, Coefficient::Scaled(0.0, _)) || medium.emission.is_some() {
                self.warn("media that scatter or shine only absorb");
            }
        }
        extensions["KHR_materials_volume"] = volume;
    }
}

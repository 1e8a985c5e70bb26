//! Gaussian splats in glTF: KHR_gaussian_splatting (as ratified in 2026) on primitives of points, and its compression by SPZ
//! (KHR_gaussian_splatting_compression_spz_2). Kernel "ellipse", projection "perspective"; the sorting method says how others approximate
//! what is exact here ([`crate::shape::splats`]). Positions, axes and colours are those of the file; opacity and scale are stored as they are, a quaternion has its
//! real part last. Drafts had logarithms of scales: a set with a negative one is taken for such.

use super::{Loader, error, label, packed};
use crate::SceneError;
use crate::load::splats::{Capture, WHITE, unpacked_spz};
use crate::material::Material;
use crate::shape::splats::{ColorCurve, MOST_DEGREE, Splat, Splats};
use glam::{Quat, Vec3};
use gltf::accessor::{DataType, Dimensions, Item, Iter};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::Arc;

const EXTENSION: &str = "KHR_gaussian_splatting";
const SPZ: &str = "KHR_gaussian_splatting_compression_spz_2";
/// What this file takes care of.
pub(super) const EXTENSIONS: [&str; 2] = [EXTENSION, SPZ];

/// What a primitive says of its splats.
#[derive(Debug)]
pub(super) struct Asked {
    properties: Value,
    /// Accessors by what follows the extension's name.
    attributes: HashMap<String, usize>,
}

/// By mesh and primitive.
pub(super) type AllAsked = HashMap<(usize, usize), Asked>;

/// Takes what primitives say of splats out of a file: their attributes have names that plain glTF does not know. Accessors of what SPZ holds have no data of
/// their own, which plain glTF does not allow: they get some bytes of it.
pub(super) fn taken(json: &mut Value, name: &str) -> Result<AllAsked, SceneError> {
    let mut all = AllAsked::new();
    let views = json.get("bufferViews").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    let mut packed: Vec<(u64, u64)> = Vec::new();
    for (m, mesh) in json.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
        for (p, primitive) in mesh.get_mut("primitives").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
            let Some(properties) = primitive.get("extensions").and_then(|e| e.get(EXTENSION)).cloned() else { continue };
            let view = properties.pointer(&format!("/extensions/{SPZ}")).map(|spz| spz.get("bufferView").and_then(Value::as_u64));
            if let Some(view) = view
                && view.is_none_or(|v| v >= views)
            {
                let place = format!("mesh {m} primitive {p} (Gaussian splats)");
                let found = view.map_or("no bufferView".into(), |n| format!("bufferView {n}"));
                return Err(error(name, &place, found, format!("expected a number below {views}")));
            }
            let mut own = HashMap::new();
            if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
                packed.extend(attributes.values().filter_map(Value::as_u64).filter_map(|a| Some((a, view??))));
                attributes.retain(|name, accessor| match name.strip_prefix(EXTENSION).and_then(|n| n.strip_prefix(':')) {
                    Some(rest) => {
                        // One that is no number is missed where it is needed.
                        own.extend(accessor.as_u64().map(|a| (rest.to_owned(), usize::try_from(a).unwrap_or(usize::MAX))));
                        false
                    }
                    None => true,
                });
            }
            all.insert((m, p), Asked { properties, attributes: own });
        }
    }
    let accessors = json.get_mut("accessors").and_then(Value::as_array_mut);
    if let Some(accessors) = accessors {
        for (accessor, view) in packed {
            let own = usize::try_from(accessor).ok().and_then(|a| accessors.get_mut(a));
            if let Some(own) = own.filter(|a| a.get("bufferView").is_none() && a.get("sparse").is_none()) {
                let zeros = [0.0; 3];
                *own = json!({"bufferView": view, "componentType": 5126, "count": 1, "type": "VEC3", "min": zeros, "max": zeros});
            }
        }
    }
    Ok(all)
}

impl Loader<'_> {
    /// The splats of a primitive; `None` if it has none.
    pub(super) fn splats(&mut self, mesh: &gltf::Mesh, primitive: &gltf::Primitive) -> Result<Option<u32>, SceneError> {
        let key = (mesh.index(), primitive.index());
        if let Some(number) = self.captures.get(&key) {
            return Ok(Some(*number));
        }
        let Some(asked) = self.asked_splats.remove(&key) else { return Ok(None) };
        let place = format!("mesh {}{} primitive {} (Gaussian splats)", mesh.index(), label(mesh.name()), primitive.index());
        let wrong = |found: String, expected: &str| Err(error(self.name, &place, found, expected));
        let said = |key: &str, default: &'static str| match asked.properties.get(key) {
            None => default.to_owned(),
            Some(value) => value.as_str().map_or_else(|| value.to_string(), str::to_owned),
        };
        if primitive.mode() != gltf::mesh::Mode::Points {
            return wrong(format!("mode {:?}", primitive.mode()), "expected points (mode 0)");
        }
        let (kernel, projection) = (said("kernel", "ellipse"), said("projection", "perspective"));
        if kernel != "ellipse" {
            return wrong(format!("kernel \"{kernel}\""), "expected \"ellipse\": other kernels are of other extensions");
        }
        if projection != "perspective" {
            return wrong(format!("projection \"{projection}\""), "expected \"perspective\"");
        }
        let curve = match said("colorSpace", "srgb_rec709_display").as_str() {
            // The first drafts called it so.
            "srgb_rec709_display" | "BT.709" => ColorCurve::Srgb,
            "lin_rec709_display" | "linear" => ColorCurve::Linear,
            other => {
                return wrong(format!("colorSpace \"{other}\""), "expected \"srgb_rec709_display\" or \"lin_rec709_display\"");
            }
        };
        let extensions = asked.properties.get("extensions").and_then(Value::as_object);
        if let Some(other) = extensions.into_iter().flatten().map(|(name, _)| name).find(|n| *n != SPZ) {
            return wrong(format!("extension {other} of its splats"), "expected plain attributes or SPZ: convert them");
        }
        let Capture { splats, dropped } = match extensions.and_then(|e| e.get(SPZ)) {
            Some(packed) => self.capture_of_spz(packed, &place)?,
            None => self.capture_of_attributes(primitive, &asked.attributes, &place)?,
        };
        let all = splats.len() + dropped;
        if dropped > 0 {
            let text = format!(
                "{}: {place}: {dropped} of {all} are left out: not finite, without extent, or never denser than 1/255",
                self.name
            );
            self.description.warnings.push(text);
        }
        let mut splats = splats.with_curve(curve);
        splats.order_in_space();
        self.description.splats.push(Arc::new(splats));
        let number = self.description.splats.len() as u32 - 1;
        self.captures.insert(key, number);
        Ok(Some(number))
    }

    /// The material of all splats.
    pub(super) fn captured_material(&mut self) -> u32 {
        let number = self.captured.unwrap_or(self.description.materials.len() as u32);
        if self.captured.replace(number).is_none() {
            self.description.materials.push(Material::captured("captured", WHITE));
        }
        number
    }

    fn capture_of_spz(&self, packed: &Value, place: &str) -> Result<Capture, SceneError> {
        let number = packed.get("bufferView").and_then(Value::as_u64);
        let view = number.and_then(|n| self.document.views().nth(usize::try_from(n).ok()?));
        let bytes = view.and_then(|v| self.buffers.get(v.buffer().index())?.get(v.offset()..)?.get(..v.length()));
        let Some(bytes) = bytes else {
            return Err(error(self.name, place, "its bufferView is not there", "expected bytes within a buffer"));
        };
        unpacked_spz(bytes).map_err(|e| error(self.name, place, e.found, format!("expected {}", e.expected)))
    }

    fn capture_of_attributes(
        &mut self,
        primitive: &gltf::Primitive,
        attributes: &HashMap<String, usize>,
        place: &str,
    ) -> Result<Capture, SceneError> {
        let Some((_, positions)) = primitive.attributes().find(|(semantic, _)| *semantic == gltf::Semantic::Positions) else {
            return Err(error(self.name, place, "it has no positions", "expected a POSITION attribute"));
        };
        let count = positions.count();
        // A place without data stands for zeros; splats all in one place are a mistake.
        let most = packed::most_zeros(&self.buffers);
        let read = |semantic: &str, index: usize, width: usize| -> Result<Vec<f32>, SceneError> {
            let wrong = |found: String, expected: String| Err(error(self.name, &format!("{place} {semantic}"), found, expected));
            let Some(accessor) = self.document.accessors().nth(index) else {
                return wrong(format!("accessor {index}"), format!("expected less than {}", self.document.accessors().count()));
            };
            let dimensions = [Dimensions::Scalar, Dimensions::Vec2, Dimensions::Vec3, Dimensions::Vec4][width - 1];
            if accessor.dimensions() != dimensions {
                return wrong(format!("accessor {index} of {:?}", accessor.dimensions()), format!("expected {dimensions:?}"));
            }
            if accessor.count() != count || count > most {
                return wrong(format!("{} of {count} positions", accessor.count()), "expected one for each position".into());
            }
            match self.numbers(&accessor, width) {
                Some(numbers) if numbers.len() == count * width => Ok(numbers),
                _ => wrong(format!("accessor {index} of {:?}", accessor.data_type()), "expected numbers, or 8 or 16 bits".into()),
            }
        };
        let needed = |semantic: &str, width: usize| match attributes.get(semantic) {
            Some(index) => read(semantic, *index, width),
            None => Err(error(self.name, place, format!("no {EXTENSION}:{semantic}"), "expected one for each position")),
        };
        let centers = read("POSITION", positions.index(), 3)?;
        let (rotations, mut scales, opacities) = (needed("ROTATION", 4)?, needed("SCALE", 3)?, needed("OPACITY", 1)?);
        let in_degree = |l: u32| (0..2 * l + 1).map(move |n| format!("SH_DEGREE_{l}_COEF_{n}"));
        let degree = (1..=MOST_DEGREE).rev().find(|l| in_degree(*l).any(|name| attributes.contains_key(&name))).unwrap_or(0);
        let harmonics =
            (0..=degree).flat_map(in_degree).map(|name| needed(&name, 3)).collect::<Result<Vec<Vec<f32>>, SceneError>>()?;
        if scales.iter().any(|s| *s < 0.0) {
            scales.iter_mut().for_each(|s| *s = s.exp());
            let text = "scales below 0: they are taken for logarithms, as drafts of the extension had them";
            self.description.warnings.push(format!("{}: {place}: {text}", self.name));
        }
        let triple = |list: &[f32], i: usize| Vec3::from_slice(&list[3 * i..]);
        let (mut splats, mut dropped) = (Splats::new(degree), 0);
        for i in 0..count {
            let splat = Splat {
                center: triple(&centers, i),
                rotation: Quat::from_slice(&rotations[4 * i..]),
                scale: triple(&scales, i),
                opacity: opacities[i],
            };
            let own: [Vec3; 16] = std::array::from_fn(|k| harmonics.get(k).map_or(Vec3::ZERO, |list| triple(list, i)));
            dropped += usize::from(!splats.push(&splat, &own[..harmonics.len()]));
        }
        Ok(Capture { splats, dropped })
    }

    /// All numbers of an accessor; integers that are normalised as fractions (glTF 2.0 §3.6.2.2). `None` of 32-bit integers, or where data are missing.
    fn numbers(&self, accessor: &gltf::Accessor, width: usize) -> Option<Vec<f32>> {
        let normalized = accessor.normalized();
        let scaled = |most: f32| move |v: f32| if normalized { (v / most).max(-1.0) } else { v };
        match accessor.data_type() {
            DataType::F32 => self.flat::<f32>(accessor, width, |v| v),
            DataType::I8 => self.flat::<i8>(accessor, width, |v| scaled(127.0)(v.into())),
            DataType::U8 => self.flat::<u8>(accessor, width, |v| scaled(255.0)(v.into())),
            DataType::I16 => self.flat::<i16>(accessor, width, |v| scaled(32767.0)(v.into())),
            DataType::U16 => self.flat::<u16>(accessor, width, |v| scaled(65535.0)(v.into())),
            DataType::U32 => None,
        }
    }

    fn flat<T: Item + Copy>(&self, accessor: &gltf::Accessor, width: usize, number: impl Fn(T) -> f32) -> Option<Vec<f32>> {
        let data = |b: gltf::Buffer| self.buffers.get(b.index()).map(Vec::as_slice);
        let accessor = accessor.clone();
        Some(match width {
            1 => Iter::<T>::new(accessor, data)?.map(number).collect(),
            3 => Iter::<[T; 3]>::new(accessor, data)?.flatten().map(number).collect(),
            _ => Iter::<[T; 4]>::new(accessor, data)?.flatten().map(number).collect(),
        })
    }
}

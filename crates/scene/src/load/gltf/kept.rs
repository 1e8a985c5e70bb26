//! What `save.rs` keeps in `extras` because glTF has no words for it: whole materials with their media and spectra, lamps, surroundings, balls, parallelograms, curves and
//! cameras, read back to the last bit ([`crate::exact`]).
//!
//! A fingerprint tells whether another program has changed the file since: then what glTF says counts, and a warning tells.

use crate::exact::{Exact, KEY, Source, VERSION, checked, field, fingerprint};
use crate::light::{Environment, Punctual};
use crate::material::{Material, Measured};
use crate::medium::{Air, Medium};
use crate::scene::{CameraProjection, FilmHints};
use crate::shape::{Curves, Quad, Sphere, Splats};
use crate::texture::{Graph, Image, Texels};
use glam::Affine3A;
use serde_json::Value;
use std::collections::HashMap;
use std::sync::Arc;

/// The extras of a file, unread.
#[derive(Default)]
pub(super) struct Taken {
    root: Value,
    materials: Vec<Value>,
    lights: Vec<Value>,
    nodes: HashMap<usize, Value>,
    /// Buffer, offset and length of each buffer view.
    views: Vec<[usize; 3]>,
}

/// What a node stands for.
pub(super) enum Form {
    Sphere(Sphere),
    Quad(Quad),
    /// A set of curves and their material.
    Curves(usize, u32),
    /// Gaussian splats and their material.
    Splats(usize, u32),
}

/// A camera beside what glTF says of it.
pub(super) struct KeptCamera {
    pub sight: CameraProjection,
    pub lens: Option<[f32; 2]>,
    pub film: FilmHints,
    /// Where it is, if nothing carries it.
    pub place: Option<Affine3A>,
}

/// All that was kept.
#[derive(Default)]
pub(super) struct Kept {
    pub materials: Vec<Option<Material>>,
    pub lights: Vec<Option<Punctual>>,
    pub forms: HashMap<usize, Form>,
    pub cameras: HashMap<usize, KeptCamera>,
    pub curves: Vec<Arc<Curves>>,
    pub splats: Vec<Arc<Splats>>,
    pub environment: Option<Environment>,
    pub air: Option<Air>,
    pub max_depth: Option<u32>,
    pub declares_lamps: bool,
}

fn of(value: &Value) -> Option<&Value> {
    value.get("extras")?.get(KEY)
}

fn list<'v>(json: &'v Value, path: &[&str]) -> impl Iterator<Item = &'v Value> {
    let found = path.iter().try_fold(json, |v, key| v.get(key));
    found.and_then(Value::as_array).into_iter().flatten()
}

/// Takes what was kept from a file as it is, before anything is unpacked; `Err` with why it does not count.
pub(super) fn taken(json: &Value, buffers: &[Vec<u8>]) -> Result<Option<Taken>, String> {
    let Some(root) = of(json) else { return Ok(None) };
    let version = root.get("version").and_then(Value::as_u64);
    if version != Some(VERSION) {
        return Err("what it holds for diopter alone is of another version".into());
    }
    let length = json["buffers"][0]["byteLength"].as_u64().map_or(0, |n| n as usize);
    let binary = buffers.first().map_or(&[][..], |b| &b[..length.min(b.len())]);
    // Fuzzers cannot find fingerprints.
    if !cfg!(fuzzing) && root.get("fingerprint").and_then(Value::as_str) != Some(&fingerprint(json, binary)) {
        return Err(
            "another program has changed it: what it held for diopter alone (media, spectra, surroundings) does not count".into(),
        );
    }
    let number = |v: &Value, key: &str| v.get(key).and_then(Value::as_u64).map_or(0, |n| n as usize);
    let own = |v: &Value| of(v).cloned().unwrap_or_default();
    Ok(Some(Taken {
        root: root.clone(),
        materials: list(json, &["materials"]).map(own).collect(),
        lights: list(json, &["extensions", "KHR_lights_punctual", "lights"]).map(own).collect(),
        nodes: list(json, &["nodes"]).enumerate().filter_map(|(i, n)| Some((i, of(n)?.clone()))).collect(),
        views: list(json, &["bufferViews"]).map(|v| ["buffer", "byteOffset", "byteLength"].map(|key| number(v, key))).collect(),
    }))
}

impl Taken {
    /// Reads it; fails with what is wrong.
    pub(super) fn read(&self, buffers: &[Vec<u8>], images: &[Option<Arc<Image>>]) -> Result<Kept, String> {
        let view = |&[buffer, offset, length]: &[usize; 3]| {
            buffers.get(buffer).and_then(|b| b.get(offset..offset.checked_add(length)?)).unwrap_or_default()
        };
        let views = self.views.iter().map(view).collect();
        let mut source = Source { views, images: images.to_vec(), media: vec![], graphs: vec![], measured: vec![] };
        for (number, picture) in self.root.get("pictures").and_then(Value::as_object).into_iter().flatten() {
            let read = raw_picture(picture, &source)?;
            let slot = number.parse().ok().and_then(|n: usize| source.images.get_mut(n));
            *slot.ok_or_else(|| format!("no picture {number}"))? = Some(Arc::new(read));
        }
        // In the order in which they were written: what one is made of comes before it.
        for graph in list(&self.root, &["graphs"]) {
            let read = checked(Graph::read(graph, &source)?)?;
            source.graphs.push(Arc::new(read));
        }
        // What lists claim, all together, is no more than what the file holds: several that name one view are damage.
        let held: usize = buffers.iter().map(Vec::len).sum();
        let mut claimed = 0usize;
        for table in list(&self.root, &["measured"]) {
            let read = Measured::read(table, &source)?;
            claimed += read.memory();
            if !read.is_whole() || claimed > 2 * held {
                return Err("measured materials whose lists do not fit each other".into());
            }
            source.measured.push(Arc::new(read));
        }
        for medium in list(&self.root, &["media"]) {
            let read = Medium::read(medium, &source)?;
            source.media.push(Arc::new(read));
        }
        fn each<T: Exact>(all: &[Value], source: &Source) -> Result<Vec<Option<T>>, String> {
            all.iter().map(|v| if v.is_null() { Ok(None) } else { T::read(v, source).map(Some) }).collect()
        }
        let mut kept = Kept {
            materials: each(&self.materials, &source)?,
            lights: each(&self.lights, &source)?,
            environment: field(&self.root, "environment", &source)?,
            air: field(&self.root, "air", &source)?,
            declares_lamps: self.root.get("declares_lamps").and_then(Value::as_bool).unwrap_or_default(),
            max_depth: field(&self.root, "max_depth", &source)?,
            ..Kept::default()
        };
        for curves in list(&self.root, &["curves"]) {
            kept.curves.push(Arc::new(Curves::read(curves, &source)?));
        }
        for splats in list(&self.root, &["splats"]) {
            kept.splats.push(Arc::new(Splats::read(splats, &source)?));
            claimed += kept.splats.last().map_or(0, |s| s.memory());
            if claimed > 4 * held {
                return Err("Gaussian splats that share their lists".into());
            }
        }
        for (node, own) in &self.nodes {
            let form = if own.get("sphere").is_some() {
                Some(Form::Sphere(field(own, "sphere", &source)?))
            } else if own.get("quad").is_some() {
                Some(Form::Quad(field(own, "quad", &source)?))
            } else if own.get("curves").is_some() {
                let (curves, material): (usize, u32) = (field(own, "curves", &source)?, field(own, "material", &source)?);
                if curves >= kept.curves.len() || material as usize >= self.materials.len() {
                    return Err(format!("curves {curves} of material {material}"));
                }
                Some(Form::Curves(curves, material))
            } else if own.get("splats").is_some() {
                let (splats, material): (usize, u32) = (field(own, "splats", &source)?, field(own, "material", &source)?);
                if splats >= kept.splats.len() || material as usize >= self.materials.len() {
                    return Err(format!("Gaussian splats {splats} of material {material}"));
                }
                Some(Form::Splats(splats, material))
            } else {
                None
            };
            form.into_iter().for_each(|form| _ = kept.forms.insert(*node, form));
            if let Some(camera) = own.get("camera") {
                let read = KeptCamera {
                    sight: field(camera, "sight", &source)?,
                    lens: field(camera, "lens", &source)?,
                    film: field(camera, "film", &source)?,
                    place: field(camera, "place", &source)?,
                };
                kept.cameras.insert(*node, read);
            }
        }
        Ok(kept)
    }
}

/// A picture of numbers, or of 16 bits a channel.
fn raw_picture(value: &Value, source: &Source) -> Result<Image, String> {
    let [width, height] = field::<[usize; 2]>(value, "size", source)?;
    let is_wide: bool = field(value, "wide", source)?;
    let texels = match is_wide {
        true => Texels::Wide(field(value, "texels", source)?),
        false => Texels::Linear(field(value, "texels", source)?),
    };
    let count = match &texels {
        Texels::Wide(all) => all.len(),
        Texels::Linear(all) => all.len(),
        _ => 0,
    };
    if count == 0 || width.checked_mul(height) != Some(count) {
        return Err(format!("{count} pixels for a picture of {width} × {height}"));
    }
    Ok(Image::of_texels(width, height, texels))
}

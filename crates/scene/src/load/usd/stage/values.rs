//! Values of prims: metadata, attributes and relationships, as the strongest opinions say.

use super::composition::{Prim, Site};
use super::{Read, Stage};
use crate::load::usd::layer::{Field, Key, ListOp, TimeShift, Value, split_property};
use glam::DQuat;
use std::sync::Arc;

/// A time code and the numbers then.
pub type TimeSample = (f64, Arc<[f64]>);

/// Stack, path and time shift of each opinion.
pub type Fingerprint = Vec<(usize, String, [u64; 2])>;

/// A value that is held ends this part of the time before the next one: keys have no steps.
const HELD_UNTIL: f64 = 1e-4;

/// A value and the layer that says it.
pub struct Found {
    pub value: Value,
    pub layer: usize,
    shift: TimeShift,
    /// Of samples: what lies between them.
    between: Between,
}

/// What a value is between two time samples. Source: OpenUSD, `UsdStage::GetInterpolationType` (linear).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Between {
    /// The first: whole numbers, truth values, words.
    Held,
    Linear,
    /// Turned from one to the other.
    Quaternions,
}

impl Between {
    /// Of a type: "float3", "quath".
    fn of_type(name: &str) -> Between {
        const REAL: [&str; 11] =
            ["float", "double", "half", "vector", "point", "normal", "color", "texCoord", "matrix", "frame", "timecode"];
        match name {
            q if q.starts_with("quat") => Between::Quaternions,
            other if REAL.iter().any(|real| other.starts_with(real)) => Between::Linear,
            _ => Between::Held,
        }
    }

    /// Numbers at a fraction of the way from one sample to the next; `None` where they are held, or do not fit each other.
    fn numbers(self, first: &[f64], next: &[f64], fraction: f64) -> Option<Vec<f64>> {
        let quaternion = |q: &[f64]| DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
        match self {
            _ if first.len() != next.len() || self == Between::Held => None,
            Between::Quaternions if first.len().is_multiple_of(4) => {
                let pairs = first.chunks_exact(4).zip(next.chunks_exact(4));
                let turned = pairs.map(|(a, b)| quaternion(a).slerp(quaternion(b), fraction));
                Some(turned.flat_map(|q| [q.w, q.x, q.y, q.z]).collect())
            }
            _ => Some(first.iter().zip(next).map(|(a, b)| a + (b - a) * fraction).collect()),
        }
    }
}

/// Values of prims.
impl Stage<'_> {
    /// The layers that speak of a prim, strongest first: layer, path there, and times.
    fn opinions<'b>(&'b self, prim: &'b Prim) -> impl Iterator<Item = (usize, &'b Site, TimeShift)> {
        prim.sites().flat_map(|site| {
            let layers = &self.stacks[site.stack].layers;
            layers.iter().map(move |(layer, shift)| (*layer, site, shift.within(site.link.shift)))
        })
    }

    /// Metadata of a prim.
    pub fn field(&self, prim: &Prim, key: Key) -> Read<Option<Value>> {
        for (layer, site, _) in self.opinions(prim) {
            if let Some(value) = self.layers[layer].get(&site.path, key)? {
                return Ok(Some(value));
            }
        }
        Ok(None)
    }

    /// Type of a prim: "Mesh"; empty of what is only a group.
    pub fn type_name(&self, prim: &Prim) -> Read<Arc<str>> {
        Ok(self.field(prim, Key::TypeName)?.as_ref().and_then(Value::text).cloned().unwrap_or_else(|| "".into()))
    }

    /// Whether a prim is defined, not a class, and not switched off.
    pub fn is_drawn(&self, prim: &Prim) -> Read<bool> {
        if self.field(prim, Key::Active)?.and_then(|a| a.number()) == Some(0.0) {
            return Ok(false);
        }
        let mut is_defined = false;
        for (layer, site, _) in self.opinions(prim) {
            if let Some(specifier) = self.layers[layer].get(&site.path, Key::Specifier)?.as_ref().and_then(Value::text) {
                match &**specifier {
                    // A class that is inherited is defined by what inherits it, or by what it is itself made of.
                    "class" if !site.is_of_class => return Ok(is_defined),
                    "def" => is_defined = true,
                    _ => (),
                }
            }
        }
        Ok(is_defined)
    }

    /// The strongest value of an attribute that is not blocked: samples over time, or one for all times.
    pub fn attribute(&self, prim: &Prim, name: &str) -> Read<Option<Found>> {
        for (layer, site, shift) in self.opinions(prim) {
            let at = &self.layers[layer];
            let path = format!("{}.{name}", site.path);
            if !at.specs.contains_key(path.as_str()) {
                continue;
            }
            for key in [Key::TimeSamples, Key::Default] {
                match at.get(&path, key)? {
                    Some(Value::Blocked) => return Ok(None),
                    Some(Value::Samples(list)) if list.is_empty() => (),
                    Some(value) => {
                        let between = match &value {
                            Value::Samples(_) => {
                                at.get(&path, Key::TypeName)?.as_ref().and_then(Value::text).map(|t| Between::of_type(t))
                            }
                            _ => None,
                        };
                        return Ok(Some(Found { value, layer, shift, between: between.unwrap_or(Between::Held) }));
                    }
                    None => (),
                }
            }
        }
        Ok(None)
    }

    /// An attribute's value at the scene's first time.
    pub fn value(&self, prim: &Prim, name: &str) -> Read<Option<Value>> {
        match self.attribute(prim, name)? {
            Some(found) => self.at_start(&found),
            None => Ok(None),
        }
    }

    /// The value of samples at the scene's first time: between two of them what lies between, before the first that one, after the last the last.
    pub fn at_start(&self, found: &Found) -> Read<Option<Value>> {
        let Value::Samples(list) = &found.value else { return Ok(Some(found.value.clone())) };
        let time = |t: f64| found.shift.offset + found.shift.scale * t;
        let until = list.iter().take_while(|(t, _)| time(*t) <= self.start).count();
        let read = |field: &Field| self.layers[found.layer].read(field);
        let Some((t, field)) = list.get(until.saturating_sub(1)) else { return Ok(None) };
        let (value, begun) = (read(field)?, time(*t));
        if let (1.., Some((next_t, next)), false) = (until, list.get(until), found.between == Between::Held)
            && begun < self.start
        {
            let next = read(next)?;
            let fraction = (self.start - begun) / (time(*next_t) - begun);
            if let (Some(a), Some(b)) = (value.doubles(), next.doubles())
                && let Some(between) = found.between.numbers(&a, &b, fraction)
            {
                return Ok(Some(match value {
                    Value::Number(_) => Value::Number(between[0]),
                    Value::Floats(_) => Value::Floats(between.into_iter().map(|v| v as f32).collect()),
                    _ => Value::Doubles(between.into()),
                }));
            }
        }
        Ok(Some(value).filter(|v| !matches!(v, Value::Blocked)))
    }

    /// Times in the scene's time codes, rising, and the numbers then; `None` of what does not change.
    pub fn samples(&self, found: &Found) -> Read<Option<Vec<TimeSample>>> {
        let Value::Samples(list) = &found.value else { return Ok(None) };
        let mut all: Vec<TimeSample> = Vec::with_capacity(list.len());
        // From a block on there is no value until the next sample: the one before it stays.
        let mut blocked_at = None;
        for (time, field) in list.iter() {
            let time = found.shift.offset + found.shift.scale * time;
            let value = self.layers[found.layer].read(field)?;
            if let (Value::Blocked, Some((_, last))) = (&value, all.last().cloned()) {
                blocked_at = blocked_at.or(Some(time));
                all.push((time, last));
            } else if let Some(numbers) = value.doubles() {
                if let (Some(begun), Some((_, last))) = (blocked_at.take(), all.last().cloned()) {
                    all.push((time - HELD_UNTIL * (time - begun), last));
                }
                all.push((time, numbers));
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok((all.len() > 1).then_some(all))
    }

    /// Whether an attribute has samples at several times.
    pub fn is_animated(&self, prim: &Prim, name: &str) -> Read<bool> {
        Ok(matches!(self.attribute(prim, name)?, Some(Found { value: Value::Samples(list), .. }) if list.len() > 1))
    }

    /// Metadata of a property, such as the interpolation of a primvar.
    pub fn property_field(&self, prim: &Prim, name: &str, key: Key) -> Read<Option<Value>> {
        for (layer, site, _) in self.opinions(prim) {
            if let Some(value) = self.layers[layer].get(&format!("{}.{name}", site.path), key)? {
                return Ok(Some(value));
            }
        }
        Ok(None)
    }

    /// Whether an attribute of words has samples that differ.
    pub fn is_changing_text(&self, prim: &Prim, name: &str) -> Read<bool> {
        let Some(Found { value: Value::Samples(list), layer, .. }) = self.attribute(prim, name)? else { return Ok(false) };
        let mut first: Option<Option<Arc<str>>> = None;
        for (_, field) in list.iter() {
            let text = self.layers[layer].read(field)?.text().cloned();
            if *first.get_or_insert_with(|| text.clone()) != text {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Whether an API schema is applied to a prim: "MeshLightAPI".
    pub fn has_schema(&self, prim: &Prim, schema: &str) -> Read<bool> {
        Ok(self.listed(prim, Key::ApiSchemas)?.iter().any(|s| &**s == schema))
    }

    /// What remains of a list of names or numbers in the metadata of a prim after all edits of it.
    pub fn listed(&self, prim: &Prim, key: Key) -> Read<Vec<Arc<str>>> {
        let mut edits = Vec::new();
        for (layer, site, _) in self.opinions(prim) {
            if let Some(Value::List(list)) = self.layers[layer].get(&site.path, key)? {
                edits.push(list);
            }
        }
        let mut all = Vec::new();
        edits.iter().rev().for_each(|e| e.apply(&mut all));
        Ok(all)
    }

    /// Names of the relationships by which a prim binds materials to collections, in order: "material:binding:collection:red".
    pub fn collection_bindings(&self, prim: &Prim) -> Vec<String> {
        let own = self.opinions(prim).flat_map(|(layer, site, _)| self.layers[layer].collection_bindings(&site.path));
        let mut names: Vec<String> = own.map(str::to_owned).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Names of the in-between shapes of a blend shape, in order: "inbetweens:half".
    pub fn inbetweens(&self, prim: &Prim) -> Vec<String> {
        let mut names: Vec<String> = self
            .opinions(prim)
            .flat_map(|(layer, site, _)| self.layers[layer].inbetweens(&site.path).map(str::to_owned).collect::<Vec<_>>())
            .collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Paths of the scene that a relationship names (`key` TargetPaths), or that an attribute is connected to (ConnectionPaths).
    pub fn targets(&self, prim: &Prim, name: &str, key: Key) -> Read<Vec<String>> {
        let mut edits: Vec<ListOp<String>> = Vec::new();
        for (layer, site, _) in self.opinions(prim) {
            match self.layers[layer].get(&format!("{}.{name}", site.path), key)? {
                Some(Value::List(list)) => {
                    let is_whole = list.explicit.is_some();
                    edits.push(list.map(|path| site.link.scene_path(path)));
                    if is_whole {
                        break;
                    }
                }
                Some(Value::Texts(list)) => {
                    let explicit = list.iter().filter_map(|p| site.link.scene_path(p)).collect();
                    edits.push(ListOp { explicit: Some(explicit), ..ListOp::default() });
                    break;
                }
                _ => (),
            }
        }
        let mut all = Vec::new();
        edits.iter().rev().for_each(|e| e.apply(&mut all));
        Ok(all)
    }

    /// What an attribute is connected to: the prim's path and the property.
    pub fn source(&self, prim: &Prim, name: &str) -> Read<Option<(String, String)>> {
        let targets = self.targets(prim, name, Key::ConnectionPaths)?;
        Ok(targets.first().and_then(|path| match split_property(path) {
            (prim, Some(property)) => Some((prim.to_owned(), property.to_owned())),
            _ => None,
        }))
    }

    /// What tells prims apart: two of the same have the same opinions, at the same times, wherever they stand in the scene.
    pub fn fingerprint(&self, prim: &Prim) -> Fingerprint {
        let of = |s: &Site| {
            let is_sampled = self.stacks[s.stack].layers.iter().any(|(l, _)| self.layers[*l].has_samples(&s.path));
            let shift = if is_sampled { s.link.shift } else { TimeShift::NONE };
            (s.stack, s.path.clone(), [shift.offset, shift.scale].map(f64::to_bits))
        };
        prim.sites().map(of).collect()
    }
}

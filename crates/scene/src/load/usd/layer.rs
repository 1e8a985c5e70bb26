//! A layer: specs by path, each with its fields, whichever file they came from.

use crate::SceneError;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Fields that the reader asks for; others are dropped when a layer is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    Active,
    ApiSchemas,
    BindMaterialAs,
    Clips,
    ConnectionPaths,
    Default,
    DefaultPrim,
    FramesPerSecond,
    InactiveIds,
    InheritPaths,
    Instanceable,
    Interpolation,
    MetersPerUnit,
    Payload,
    PrimChildren,
    References,
    Relocates,
    Specializes,
    Specifier,
    Spline,
    StartTimeCode,
    SubLayerOffsets,
    SubLayers,
    TargetPaths,
    TimeCodesPerSecond,
    TimeSamples,
    TypeName,
    UpAxis,
    VariantSelection,
    VariantSetNames,
    Weight,
}

impl Key {
    /// By the name in files.
    pub fn named(name: &str) -> Option<Key> {
        Some(match name {
            "active" => Key::Active,
            "apiSchemas" => Key::ApiSchemas,
            "bindMaterialAs" => Key::BindMaterialAs,
            "clips" => Key::Clips,
            "connectionPaths" => Key::ConnectionPaths,
            "default" => Key::Default,
            "defaultPrim" => Key::DefaultPrim,
            "framesPerSecond" => Key::FramesPerSecond,
            "inactiveIds" => Key::InactiveIds,
            "inheritPaths" | "inherits" => Key::InheritPaths,
            "instanceable" => Key::Instanceable,
            "interpolation" => Key::Interpolation,
            "metersPerUnit" => Key::MetersPerUnit,
            "payload" => Key::Payload,
            "primChildren" => Key::PrimChildren,
            "references" => Key::References,
            "layerRelocates" | "relocates" => Key::Relocates,
            "specializes" => Key::Specializes,
            "specifier" => Key::Specifier,
            "spline" => Key::Spline,
            "startTimeCode" => Key::StartTimeCode,
            "subLayerOffsets" => Key::SubLayerOffsets,
            "subLayers" => Key::SubLayers,
            "targetPaths" => Key::TargetPaths,
            "timeCodesPerSecond" => Key::TimeCodesPerSecond,
            "timeSamples" => Key::TimeSamples,
            "typeName" => Key::TypeName,
            "upAxis" => Key::UpAxis,
            "variantSelection" | "variants" => Key::VariantSelection,
            "variantSetNames" | "variantSets" => Key::VariantSetNames,
            "weight" => Key::Weight,
            _ => return None,
        })
    }
}

/// A value of a field. Vectors, matrices and arrays of them are flat lists of numbers; quaternions are w, x, y, z.
#[derive(Clone, Debug)]
pub enum Value {
    /// `None` in the file: there is no value, whatever weaker layers say.
    Blocked,
    /// Truth values, whole and real numbers.
    Number(f64),
    /// Tokens and strings; asset paths, too.
    Text(Arc<str>),
    /// Arrays of single and half precision.
    Floats(Arc<[f32]>),
    /// Arrays of double precision and of whole numbers of 64 bits, and single vectors and matrices of any.
    Doubles(Arc<[f64]>),
    /// Arrays of whole numbers and truth values.
    Ints(Arc<[i32]>),
    /// Arrays of tokens, strings and asset paths.
    Texts(Arc<[Arc<str>]>),
    /// Edits of a list of paths or names, or of whole numbers in digits.
    List(Arc<ListOp<Arc<str>>>),
    /// Edits of a list of references or payloads.
    References(Arc<ListOp<Reference>>),
    /// Variant sets and what was chosen of each.
    Selections(Arc<[(Arc<str>, Arc<str>)]>),
    /// Times, rising, and the values then.
    Samples(Arc<[(f64, Field)]>),
    /// What nobody asks for.
    Other,
}

impl Value {
    /// A single number.
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Number(v) => Some(*v),
            _ => None,
        }
    }

    /// A token, string or asset path.
    pub fn text(&self) -> Option<&Arc<str>> {
        match self {
            Value::Text(t) => Some(t),
            _ => None,
        }
    }

    /// Numbers of single precision.
    pub fn floats(&self) -> Option<Arc<[f32]>> {
        Some(match self {
            Value::Floats(list) => list.clone(),
            Value::Doubles(list) => list.iter().map(|v| *v as f32).collect(),
            Value::Ints(list) => list.iter().map(|v| *v as f32).collect(),
            Value::Number(v) => Arc::new([*v as f32]),
            _ => return None,
        })
    }

    /// Numbers of double precision.
    pub fn doubles(&self) -> Option<Arc<[f64]>> {
        Some(match self {
            Value::Doubles(list) => list.clone(),
            Value::Floats(list) => list.iter().map(|v| f64::from(*v)).collect(),
            Value::Ints(list) => list.iter().map(|v| f64::from(*v)).collect(),
            Value::Number(v) => Arc::new([*v]),
            _ => return None,
        })
    }

    /// Whole numbers.
    pub fn ints(&self) -> Option<Arc<[i32]>> {
        Some(match self {
            Value::Ints(list) => list.clone(),
            Value::Doubles(list) => list.iter().map(|v| *v as i32).collect(),
            Value::Floats(list) => list.iter().map(|v| *v as i32).collect(),
            Value::Number(v) => Arc::new([*v as i32]),
            _ => return None,
        })
    }
}

/// A value, or where it lies in a binary file.
#[derive(Clone, Debug)]
pub enum Field {
    /// Read.
    Ready(Value),
    /// The word that tells type and place.
    Packed(u64),
}

/// Edits of a list: it is replaced, or items are removed, put before and behind. Source: OpenUSD, `SdfListOp`.
#[derive(Clone, Debug)]
pub struct ListOp<T> {
    pub explicit: Option<Vec<T>>,
    pub prepended: Vec<T>,
    pub appended: Vec<T>,
    pub deleted: Vec<T>,
}

impl<T> Default for ListOp<T> {
    fn default() -> Self {
        ListOp { explicit: None, prepended: vec![], appended: vec![], deleted: vec![] }
    }
}

impl<T: Clone + PartialEq> ListOp<T> {
    /// What remains of a list after this edit of it.
    pub fn apply(&self, list: &mut Vec<T>) {
        if let Some(explicit) = &self.explicit {
            list.clone_from(explicit);
            return;
        }
        list.retain(|item| ![&self.deleted, &self.prepended, &self.appended].iter().any(|l| l.contains(item)));
        list.splice(0..0, self.prepended.iter().cloned());
        list.extend(self.appended.iter().cloned());
    }

    /// The same edits of other items; those without one are dropped.
    pub fn map<U>(&self, mut f: impl FnMut(&T) -> Option<U>) -> ListOp<U> {
        let mut each = |list: &[T]| list.iter().filter_map(&mut f).collect();
        ListOp {
            explicit: self.explicit.as_deref().map(&mut each),
            prepended: each(&self.prepended),
            appended: each(&self.appended),
            deleted: each(&self.deleted),
        }
    }
}

/// A prim of a file, or of the same one where `asset` is empty, whose opinions are added. Source: OpenUSD, `SdfReference`.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    pub asset: Arc<str>,
    /// Empty: the file's default prim.
    pub prim: Arc<str>,
    pub shift: TimeShift,
}

/// Time codes of the outer layer from those of the inner one: offset + scale · t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeShift {
    pub offset: f64,
    pub scale: f64,
}

impl TimeShift {
    pub const NONE: TimeShift = TimeShift { offset: 0.0, scale: 1.0 };

    /// This one within another.
    pub fn within(self, outer: TimeShift) -> TimeShift {
        TimeShift { offset: outer.offset + outer.scale * self.offset, scale: outer.scale * self.scale }
    }

    /// This one of an inner layer whose time codes are so many times as long as those that the shift was said for.
    pub fn of_longer_codes(self, times: f64) -> TimeShift {
        TimeShift { scale: self.scale * times, ..self }
    }
}

/// What a layer says of one path.
#[derive(Clone, Debug, Default)]
pub struct Spec {
    pub fields: Vec<(Key, Field)>,
}

/// Where the files that a layer names are looked for.
#[derive(Clone, Debug, Default)]
pub struct Folder {
    /// Number of the package that holds it.
    pub package: Option<usize>,
    /// Path of the folder, ending in "/", or empty.
    pub path: String,
}

/// Values that stay packed until they are asked for.
pub trait PackedValues: std::fmt::Debug + Send + Sync {
    /// The value that a word stands for; `name` is the file's, for messages.
    fn value(&self, word: u64, name: &str) -> Result<Value, SceneError>;
}

/// A file of specs.
#[derive(Debug)]
pub struct Layer {
    /// Its name for messages.
    pub name: String,
    pub folder: Folder,
    pub specs: HashMap<Box<str>, Spec>,
    /// What packed fields lie in.
    pub data: Option<Box<dyn PackedValues>>,
    /// Paths of in-between shapes and of their normals, in order: properties whose names no schema knows.
    inbetweens: Vec<Box<str>>,
    /// Paths of relationships that bind materials to collections, in order.
    collection_bindings: Vec<Box<str>>,
    /// Paths of prims of which an attribute has time samples.
    sampled: HashSet<Box<str>>,
}

/// What names of in-between shapes begin with. Source: OpenUSD, `UsdSkelInbetweenShape`.
const INBETWEENS: &str = ".inbetweens:";
/// What names of relationships begin with that bind materials to collections. Source: OpenUSD, `UsdShadeMaterialBindingAPI`.
const COLLECTION_BINDINGS: &str = ".material:binding:collection:";

impl Layer {
    /// A layer of these specs.
    pub fn new(name: &str, folder: Folder, specs: HashMap<Box<str>, Spec>, data: Option<Box<dyn PackedValues>>) -> Self {
        let in_order = |part: &str| {
            let mut paths: Vec<Box<str>> = specs.keys().filter(|path| path.contains(part)).cloned().collect();
            paths.sort_unstable();
            paths
        };
        let (inbetweens, collection_bindings) = (in_order(INBETWEENS), in_order(COLLECTION_BINDINGS));
        let has_samples = |spec: &Spec| spec.fields.iter().any(|(key, _)| *key == Key::TimeSamples);
        let sampled = specs.iter().filter(|(_, spec)| has_samples(spec)).filter_map(|(path, _)| path.rsplit_once('.'));
        let sampled = sampled.map(|(prim, _)| prim.into()).collect();
        Layer { name: name.to_owned(), folder, specs, data, inbetweens, collection_bindings, sampled }
    }

    /// Whether an attribute of the prim at a path has time samples.
    pub fn has_samples(&self, path: &str) -> bool {
        self.sampled.contains(path)
    }

    /// Whether anything has a field.
    pub fn uses(&self, key: Key) -> bool {
        self.specs.values().any(|spec| spec.fields.iter().any(|(k, _)| *k == key))
    }

    /// Names of the relationships by which the prim at a path binds materials to collections: "material:binding:collection:red".
    pub fn collection_bindings(&self, path: &str) -> impl Iterator<Item = &str> {
        beginning_with(&self.collection_bindings, format!("{path}{COLLECTION_BINDINGS}"), path.len() + 1)
    }

    /// Names of the in-between shapes of the prim at a path: "inbetweens:half".
    pub fn inbetweens(&self, path: &str) -> impl Iterator<Item = &str> {
        let own = beginning_with(&self.inbetweens, format!("{path}{INBETWEENS}"), path.len() + 1);
        // Behind another colon are their normals.
        own.filter(|name| name.matches(':').count() == 1)
    }

    /// A field of the spec of a path. `None` without either. Fails where the value is damaged in its file.
    pub fn get(&self, path: &str, key: Key) -> Result<Option<Value>, SceneError> {
        let Some(spec) = self.specs.get(path) else { return Ok(None) };
        let Some((_, field)) = spec.fields.iter().find(|(k, _)| *k == key) else { return Ok(None) };
        self.read(field).map(Some)
    }

    /// The value of a field. Fails where a packed one is damaged or points beyond the end of its file.
    pub fn read(&self, field: &Field) -> Result<Value, SceneError> {
        match (field, &self.data) {
            (Field::Ready(value), _) => Ok(value.clone()),
            (Field::Packed(word), Some(data)) => data.value(*word, &self.name),
            (Field::Packed(_), None) => Ok(Value::Other),
        }
    }
}

/// Those of sorted paths that begin with a prefix, without their first bytes.
fn beginning_with(sorted: &[Box<str>], prefix: String, without: usize) -> impl Iterator<Item = &str> {
    let first = sorted.partition_point(|p| **p < *prefix);
    sorted[first..].iter().take_while(move |p| p.starts_with(&prefix)).map(move |p| &p[without..])
}

/// The path of a child prim. Source: OpenUSD, `SdfPath`: "/A/B", "/A{set=variant}B".
pub fn child_path(parent: &str, name: &str) -> String {
    match parent {
        "/" => format!("/{name}"),
        p if p.ends_with('}') => format!("{p}{name}"),
        p => format!("{p}/{name}"),
    }
}

/// A path without the variants that it leads through.
pub fn without_variants(path: &str) -> String {
    if !path.contains('{') {
        return path.to_owned();
    }
    let mut out = String::with_capacity(path.len());
    let mut rest = path;
    while let Some((before, after)) = rest.split_once('{') {
        out.push_str(before);
        let behind = after.split_once('}').map_or("", |(_, b)| b);
        if !behind.is_empty() && !behind.starts_with(['{', '.', '/']) {
            out.push('/');
        }
        rest = behind;
    }
    out.push_str(rest);
    out
}

/// The path of the prim of a property, and the property's name.
pub fn split_property(path: &str) -> (&str, Option<&str>) {
    match path.split_once('.') {
        Some((prim, property)) => (prim, Some(property)),
        None => (path, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_of_lists_are_applied_in_order() {
        let mut list = vec![1, 2, 3];
        ListOp { prepended: vec![9, 3], appended: vec![1], deleted: vec![2], explicit: None }.apply(&mut list);
        assert_eq!(list, [9, 3, 1]);
        ListOp { explicit: Some(vec![7]), ..ListOp::default() }.apply(&mut list);
        assert_eq!(list, [7]);
    }

    #[test]
    fn variants_are_taken_out_of_paths() {
        for (path, plain) in [
            ("/A/B", "/A/B"),
            ("/A{v=x}", "/A"),
            ("/A{v=x}B/C", "/A/B/C"),
            ("/A{v=x}{w=y}B.p", "/A/B.p"),
            ("/A{v=x}.p", "/A.p"),
            ("/A{v", "/A"),
        ] {
            assert_eq!(without_variants(path), plain, "{path}");
        }
        assert_eq!(child_path("/A{v=x}", "B"), "/A{v=x}B");
    }
}

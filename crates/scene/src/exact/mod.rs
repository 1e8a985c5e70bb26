//! Materials, media, lights and shapes as JSON that loses nothing: what glTF has no words for travels in the `extras` of the files that `scene convert` writes, and is read
//! back to the last bit.
//!
//! An object has the names of the fields that it stands for; an enumeration says which of its variants it is by `is`. Numbers of single precision are written as the
//! numbers of double precision that they are. Long lists lie in buffer views; media and graphs of pictures, which are shared, in tables of the file.
//! `save.rs` writes it, `load/gltf/kept.rs` reads it; other programs skip it.

mod types;

use crate::bvh::Bounds;
use crate::material::Measured;
use crate::medium::Medium;
use crate::texture::{Graph, Image};
use glam::{Affine2, Affine3A, Mat2, Mat3, Mat3A, Quat, Vec2, Vec3, Vec3A, Vec4};
use serde_json::{Map, Value};
use std::collections::HashMap;
use std::sync::Arc;
pub(crate) use types::checked;

/// Key of `extras` under which all of it lies.
pub(crate) const KEY: &str = "diopter";
/// What readers must know to read it.
pub(crate) const VERSION: u64 = 1;
/// Longest list of numbers that is written in JSON itself.
const LONGEST_LIST: usize = 16;

/// What can be written and read again without loss.
pub(crate) trait Exact: Sized {
    fn write(&self, sink: &mut Sink) -> Value;
    /// Fails with what is wrong.
    fn read(value: &Value, source: &Source) -> Result<Self, String>;
}

/// Where bytes and pictures go.
pub(crate) trait Store {
    /// Keeps bytes; the number of their buffer view.
    fn bytes(&mut self, bytes: Vec<u8>) -> usize;
    /// Keeps a picture; its number in the file.
    fn picture(&mut self, image: &Arc<Image>) -> usize;
}

/// What is written once and named by number.
#[derive(Debug, Default)]
pub(crate) struct Tables {
    pub media: Vec<Value>,
    pub graphs: Vec<Value>,
    known_media: HashMap<*const Medium, usize>,
    known_graphs: HashMap<*const Graph, usize>,
    pub measured: Vec<Value>,
    known_measured: HashMap<*const Measured, usize>,
}

/// What is written into.
pub(crate) struct Sink<'a> {
    pub store: &'a mut dyn Store,
    pub tables: &'a mut Tables,
}

/// What is read from.
pub(crate) struct Source<'a> {
    /// Bytes of each buffer view.
    pub views: Vec<&'a [u8]>,
    pub images: Vec<Option<Arc<Image>>>,
    pub media: Vec<Arc<Medium>>,
    pub graphs: Vec<Arc<Graph>>,
    pub measured: Vec<Arc<Measured>>,
}

/// A field of an object.
pub(crate) fn field<T: Exact>(value: &Value, name: &str, source: &Source) -> Result<T, String> {
    let found = value.get(name).ok_or_else(|| format!("no {name}"))?;
    T::read(found, source).map_err(|e| format!("{name}: {e}"))
}

/// The same, or what it is where the object does not know the field.
pub(crate) fn field_or<T: Exact>(value: &Value, name: &str, source: &Source, or: T) -> Result<T, String> {
    if value.get(name).is_some() { field(value, name, source) } else { Ok(or) }
}

/// Writes and reads structures by their fields; those of `or` are what stands there where a file, written before they were known, has none.
macro_rules! exact_struct {
    ($type:ty { $($field:ident),+ $(,)? } $( or { $($later:ident: $value:expr),+ } )?) => {
        impl crate::exact::Exact for $type {
            fn write(&self, sink: &mut crate::exact::Sink) -> serde_json::Value {
                let mut object = serde_json::Map::new();
                $( object.insert(stringify!($field).to_owned(), crate::exact::Exact::write(&self.$field, sink)); )+
                $( $( object.insert(stringify!($later).to_owned(), crate::exact::Exact::write(&self.$later, sink)); )+ )?
                serde_json::Value::Object(object)
            }

            fn read(value: &serde_json::Value, source: &crate::exact::Source) -> Result<Self, String> {
                Ok(Self {
                    $( $field: crate::exact::field(value, stringify!($field), source)?, )+
                    $( $( $later: crate::exact::field_or(value, stringify!($later), source, $value)?, )+ )?
                })
            }
        }
    };
}

/// Writes and reads enumerations: `Variant`, `Variant(a, b)` or `Variant { field }`.
macro_rules! exact_enum {
    ($type:ty { $( $variant:ident $( ( $($part:ident),+ ) )? $( { $($field:ident),+ } )? ),+ $(,)? }) => {
        impl crate::exact::Exact for $type {
            fn write(&self, sink: &mut crate::exact::Sink) -> serde_json::Value {
                let _ = &sink;
                let mut object = serde_json::Map::new();
                match self {
                    $( Self::$variant $( ( $($part),+ ) )? $( { $($field),+ } )? => {
                        object.insert("is".to_owned(), stringify!($variant).into());
                        $( $( object.insert(stringify!($part).to_owned(), crate::exact::Exact::write($part, sink)); )+ )?
                        $( $( object.insert(stringify!($field).to_owned(), crate::exact::Exact::write($field, sink)); )+ )?
                    } )+
                }
                serde_json::Value::Object(object)
            }

            fn read(value: &serde_json::Value, source: &crate::exact::Source) -> Result<Self, String> {
                let _ = source;
                let name = value.get("is").and_then(serde_json::Value::as_str).unwrap_or_default();
                $( if name == stringify!($variant) {
                    return Ok(Self::$variant
                        $( ( $( crate::exact::field(value, stringify!($part), source)? ),+ ) )?
                        $( { $( $field: crate::exact::field(value, stringify!($field), source)? ),+ } )?
                    );
                } )+
                Err(format!("\"{name}\" is none of the variants"))
            }
        }
    };
}

pub(crate) use {exact_enum, exact_struct};

impl Exact for f64 {
    fn write(&self, _: &mut Sink) -> Value {
        // JSON has no numbers that are not finite.
        if self.is_finite() { Value::from(*self) } else { Value::from(self.to_string()) }
    }

    fn read(value: &Value, _: &Source) -> Result<Self, String> {
        let number = value.as_f64().or_else(|| value.as_str()?.parse().ok());
        number.ok_or_else(|| format!("{value} instead of a number"))
    }
}

impl Exact for f32 {
    fn write(&self, sink: &mut Sink) -> Value {
        f64::from(*self).write(sink)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        f64::read(value, source).map(|v| v as f32)
    }
}

impl Exact for bool {
    fn write(&self, _: &mut Sink) -> Value {
        Value::from(*self)
    }

    fn read(value: &Value, _: &Source) -> Result<Self, String> {
        value.as_bool().ok_or_else(|| format!("{value} instead of true or false"))
    }
}

macro_rules! exact_whole {
    ($($type:ty),+) => { $(
        impl Exact for $type {
            fn write(&self, _: &mut Sink) -> Value {
                Value::from(*self)
            }

            fn read(value: &Value, _: &Source) -> Result<Self, String> {
                value.as_i64().and_then(|v| v.try_into().ok()).ok_or_else(|| format!("{value} instead of a whole number"))
            }
        }
    )+ };
}
exact_whole!(i32, u32, usize);

impl Exact for String {
    fn write(&self, _: &mut Sink) -> Value {
        Value::from(self.as_str())
    }

    fn read(value: &Value, _: &Source) -> Result<Self, String> {
        value.as_str().map(str::to_owned).ok_or_else(|| format!("{value} instead of a text"))
    }
}

impl<T: Exact> Exact for Option<T> {
    fn write(&self, sink: &mut Sink) -> Value {
        self.as_ref().map_or(Value::Null, |v| Value::Array(vec![v.write(sink)]))
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        match value {
            Value::Null => Ok(None),
            Value::Array(list) if list.len() == 1 => T::read(&list[0], source).map(Some),
            other => Err(format!("{other} instead of null or a list of one")),
        }
    }
}

impl<T: Exact> Exact for Box<T> {
    fn write(&self, sink: &mut Sink) -> Value {
        (**self).write(sink)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        T::read(value, source).map(Box::new)
    }
}

impl<T: Exact, const N: usize> Exact for [T; N] {
    fn write(&self, sink: &mut Sink) -> Value {
        Value::Array(self.iter().map(|v| v.write(sink)).collect())
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let list = value.as_array().filter(|list| list.len() == N).ok_or_else(|| format!("not a list of {N}"))?;
        let all: Vec<T> = list.iter().map(|v| T::read(v, source)).collect::<Result<_, _>>()?;
        all.try_into().map_err(|_| format!("not a list of {N}"))
    }
}

impl<A: Exact, B: Exact> Exact for (A, B) {
    fn write(&self, sink: &mut Sink) -> Value {
        Value::Array(vec![self.0.write(sink), self.1.write(sink)])
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        match value.as_array().map(Vec::as_slice) {
            Some([a, b]) => Ok((A::read(a, source)?, B::read(b, source)?)),
            _ => Err("not a list of two".into()),
        }
    }
}

/// Vectors and matrices by their numbers, column by column.
macro_rules! exact_numbers {
    ($($type:ty, $count:literal, $to:expr, $from:expr);+ $(;)?) => { $(
        impl Exact for $type {
            fn write(&self, sink: &mut Sink) -> Value {
                let to: fn(&$type) -> [f32; $count] = $to;
                to(self).write(sink)
            }

            fn read(value: &Value, source: &Source) -> Result<Self, String> {
                let from: fn(&[f32; $count]) -> $type = $from;
                <[f32; $count]>::read(value, source).map(|v| from(&v))
            }
        }
    )+ };
}
exact_numbers! {
    Vec2, 2, |v| v.to_array(), |v| Vec2::from_array(*v);
    Vec3, 3, |v| v.to_array(), |v| Vec3::from_array(*v);
    Vec4, 4, |v| v.to_array(), |v| Vec4::from_array(*v);
    Quat, 4, |v| v.to_array(), |v| Quat::from_array(*v);
    Mat3, 9, |m| m.to_cols_array(), |v| Mat3::from_cols_array(v);
    Affine2, 6, |m| m.to_cols_array(), |v| Affine2 {
        matrix2: Mat2::from_cols_array(&[v[0], v[1], v[2], v[3]]),
        translation: Vec2::new(v[4], v[5]),
    };
    Affine3A, 12, |m| m.to_cols_array(), |v| Affine3A {
        matrix3: Mat3A::from_cols_array(&[v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8]]),
        translation: Vec3A::new(v[9], v[10], v[11]),
    };
}
exact_struct!(Bounds { min, max });

/// What long lists are made of.
pub(crate) trait Plain: Copy {
    const BYTES: usize;
    fn push(self, out: &mut Vec<u8>);
    fn pull(bytes: &[u8]) -> Self;
}

macro_rules! plain {
    ($($type:ty, $bytes:literal);+) => { $(
        impl Plain for $type {
            const BYTES: usize = $bytes;

            fn push(self, out: &mut Vec<u8>) {
                out.extend(self.to_le_bytes());
            }

            fn pull(bytes: &[u8]) -> Self {
                <$type>::from_le_bytes(std::array::from_fn(|i| bytes[i]))
            }
        }
    )+ };
}
plain!(u8, 1; u16, 2; u32, 4; f32, 4);

impl<T: Plain, const N: usize> Plain for [T; N] {
    const BYTES: usize = N * T::BYTES;

    fn push(self, out: &mut Vec<u8>) {
        self.into_iter().for_each(|v| v.push(out));
    }

    fn pull(bytes: &[u8]) -> Self {
        std::array::from_fn(|i| T::pull(&bytes[i * T::BYTES..]))
    }
}

impl<T: Plain> Exact for Vec<T> {
    fn write(&self, sink: &mut Sink) -> Value {
        let mut bytes = Vec::with_capacity(self.len() * T::BYTES);
        self.iter().for_each(|v| v.push(&mut bytes));
        if bytes.len() <= LONGEST_LIST {
            return Value::Array(bytes.into_iter().map(Value::from).collect());
        }
        let mut object = Map::new();
        object.insert("view".to_owned(), sink.store.bytes(bytes).into());
        Value::Object(object)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let short: Vec<u8>;
        let bytes = match value {
            Value::Array(list) => {
                let byte = |v: &Value| v.as_u64().and_then(|v| u8::try_from(v).ok());
                short = list.iter().map(byte).collect::<Option<_>>().ok_or("a list of something else than bytes")?;
                &short
            }
            _ => {
                let view: usize = field(value, "view", source)?;
                *source.views.get(view).ok_or_else(|| format!("no buffer view {view}"))?
            }
        };
        if !bytes.len().is_multiple_of(T::BYTES) {
            return Err(format!("{} bytes for numbers of {}", bytes.len(), T::BYTES));
        }
        Ok(bytes.chunks_exact(T::BYTES).map(T::pull).collect())
    }
}

/// What a file says besides, so that it is seen whether another program has changed it: FNV-1a of the JSON without `extras.diopter.fingerprint` and names of buffers,
/// and of the buffer.
pub(crate) fn fingerprint(json: &Value, binary: &[u8]) -> String {
    let mut json = json.clone();
    if let Some(own) = json.get_mut("extras").and_then(|e| e.get_mut(KEY)).and_then(Value::as_object_mut) {
        own.remove("fingerprint");
    }
    for buffer in json.get_mut("buffers").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(buffer) = buffer.as_object_mut() {
            buffer.remove("uri");
        }
    }
    let text = json.to_string();
    // Words of eight bytes: buffers are large.
    let words = |bytes: &[u8], hash: u64| {
        bytes.chunks(8).fold(hash, |hash, chunk| {
            let word = chunk.iter().rev().fold(0u64, |w, b| w << 8 | u64::from(*b));
            (hash ^ word).wrapping_mul(0x100_0000_01b3).rotate_left(5)
        })
    };
    format!("{:016x}", words(binary, words(text.as_bytes(), 0xcbf2_9ce4_8422_2325)))
}

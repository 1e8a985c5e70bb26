//! Layers as text: `.usda`. Source: OpenUSD, "USDA file format specification" (Alliance for OpenUSD core specification, §text).

mod lex;

use super::error;
use super::layer::{Field, Folder, Key, Layer, ListOp, Reference, Spec, TimeShift, Value, child_path};
use crate::SceneError;
use std::collections::HashMap;
use std::sync::Arc;

/// How a text layer begins.
pub const MAGIC: &[u8] = b"#usda";
/// Deepest that prims lie within prims, and brackets within brackets.
const DEEPEST: usize = 256;

struct Parser<'a> {
    name: &'a str,
    text: &'a str,
    at: usize,
    specs: HashMap<Box<str>, Spec>,
}

/// What stands in brackets, flat.
#[derive(Default)]
struct Flat {
    numbers: Vec<f64>,
    texts: Vec<Arc<str>>,
}

/// How an edit of a list begins.
#[derive(Clone, Copy, PartialEq)]
enum Edit {
    Explicit,
    Prepend,
    Append,
    Delete,
    Reorder,
}

impl Edit {
    fn named(word: &str) -> Option<Edit> {
        Some(match word {
            "prepend" => Edit::Prepend,
            "append" | "add" => Edit::Append,
            "delete" => Edit::Delete,
            "reorder" => Edit::Reorder,
            _ => return None,
        })
    }

    fn into_list<T>(self, list: &mut ListOp<T>, items: Vec<T>) {
        match self {
            Edit::Explicit => list.explicit = Some(items),
            Edit::Prepend => list.prepended.extend(items),
            Edit::Append => list.appended.extend(items),
            Edit::Delete => list.deleted.extend(items),
            Edit::Reorder => (),
        }
    }
}

type Read<T> = Result<T, SceneError>;

/// Reads a text layer.
pub fn read(bytes: &[u8], name: &str, folder: Folder) -> Read<Layer> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        error(&format!("{name}: line {line}"), "bytes that are not UTF-8", "the text of a .usda file")
    })?;
    let mut parser = Parser { name, text, at: 0, specs: HashMap::new() };
    parser.layer()?;
    Ok(Layer::new(name, folder, parser.specs, None))
}

impl Parser<'_> {
    fn set(&mut self, path: &str, key: Key, value: Value) {
        let spec = self.specs.entry(path.into()).or_default();
        // Edits of one list stand in several statements.
        for (k, field) in &mut spec.fields {
            if *k != key {
                continue;
            }
            match (field, &value) {
                (Field::Ready(Value::List(old)), Value::List(new)) => merge(Arc::make_mut(old), new),
                (Field::Ready(Value::References(old)), Value::References(new)) => merge(Arc::make_mut(old), new),
                (field, _) => *field = Field::Ready(value),
            }
            return;
        }
        spec.fields.push((key, Field::Ready(value)));
    }

    fn layer(&mut self) -> Read<()> {
        if !self.text.starts_with("#usda") {
            return Err(self.unexpected("#usda 1.0"));
        }
        self.specs.insert("/".into(), Spec::default());
        if self.eat(b'(') {
            self.metadata("/")?;
        }
        let mut children = Vec::new();
        while self.peek().is_some() {
            if self.eat_word("reorder") {
                self.statement()?;
                continue;
            }
            children.push(self.prim("/", 0)?);
        }
        self.set("/", Key::PrimChildren, Value::Texts(children.into()));
        Ok(())
    }

    /// A prim from its specifier on; its name.
    fn prim(&mut self, parent: &str, depth: usize) -> Read<Arc<str>> {
        if depth > DEEPEST {
            return Err(self.wrong(format!("prims within prims, more than {DEEPEST} deep"), "fewer levels"));
        }
        let before = self.at;
        let specifier = self.word();
        if !matches!(specifier, "def" | "over" | "class") {
            self.at = before;
            return Err(self.unexpected("def, over or class"));
        }
        let kind = if self.peek() == Some(b'"') { "" } else { self.word() };
        let name = self.quoted()?;
        if name.is_empty() || name.contains(['/', '{', '}', '.']) {
            return Err(self.wrong(format!("a prim of the name \"{name}\""), "a name of letters, digits and _"));
        }
        let path = child_path(parent, &name);
        self.set(&path, Key::Specifier, Value::Text(specifier.into()));
        if !kind.is_empty() {
            self.set(&path, Key::TypeName, Value::Text(kind.into()));
        }
        if self.eat(b'(') {
            self.metadata(&path)?;
        }
        self.need(b'{')?;
        self.contents(&path, depth)?;
        Ok(name)
    }

    /// What stands in a prim or a variant, up to its closing brace.
    fn contents(&mut self, path: &str, depth: usize) -> Read<()> {
        let mut children = Vec::new();
        while !self.eat(b'}') {
            let before = self.at;
            let word = self.word();
            match word {
                "def" | "over" | "class" => {
                    self.at = before;
                    children.push(self.prim(path, depth + 1)?);
                }
                "variantSet" => self.variant_set(path, depth)?,
                "reorder" if self.eat_word("nameChildren") || self.eat_word("properties") => self.statement()?,
                "" => return Err(self.unexpected("a property, a prim or }")),
                _ => {
                    self.at = before;
                    self.property(path)?;
                }
            }
            self.eat(b';');
        }
        if !children.is_empty() {
            self.set(path, Key::PrimChildren, Value::Texts(children.into()));
        }
        Ok(())
    }

    fn variant_set(&mut self, path: &str, depth: usize) -> Read<()> {
        if depth > DEEPEST {
            return Err(self.wrong(format!("variants within variants, more than {DEEPEST} deep"), "fewer levels"));
        }
        let set = self.quoted()?;
        self.need(b'=')?;
        self.need(b'{')?;
        while !self.eat(b'}') {
            let variant = self.quoted()?;
            let inner = format!("{path}{{{set}={variant}}}");
            self.specs.entry(inner.as_str().into()).or_default();
            if self.eat(b'(') {
                self.metadata(&inner)?;
            }
            self.need(b'{')?;
            self.contents(&inner, depth + 1)?;
        }
        Ok(())
    }

    fn property(&mut self, prim: &str) -> Read<()> {
        let mut edit = Edit::Explicit;
        let mut word = self.word();
        loop {
            match word {
                "custom" | "uniform" | "varying" | "config" => (),
                other => match Edit::named(other) {
                    Some(e) => edit = e,
                    None => break,
                },
            }
            word = self.word();
        }
        if word.is_empty() {
            return Err(self.unexpected("the type of a property"));
        }
        let is_relationship = word == "rel";
        let kind = word;
        let is_array = self.eat(b'[');
        if is_array {
            self.need(b']')?;
        }
        let full = self.word();
        if full.is_empty() {
            return Err(self.unexpected("the name of a property"));
        }
        let (name, part) = match full.rsplit_once('.') {
            Some((name, part @ ("timeSamples" | "connect" | "spline" | "default"))) => (name, part),
            _ => (full, ""),
        };
        let path = format!("{prim}.{name}");
        self.specs.entry(path.as_str().into()).or_default();
        if self.eat(b'=') {
            match part {
                _ if is_relationship => {
                    let items = self.paths(prim)?;
                    self.edit_paths(&path, Key::TargetPaths, edit, items);
                }
                "connect" => {
                    let items = self.paths(prim)?;
                    self.edit_paths(&path, Key::ConnectionPaths, edit, items);
                }
                "timeSamples" => {
                    let samples = self.samples(kind, is_array)?;
                    self.set(&path, Key::TypeName, Value::Text(kind.into()));
                    self.set(&path, Key::TimeSamples, samples);
                }
                "spline" => {
                    self.balanced()?;
                    self.set(&path, Key::Spline, Value::Other);
                }
                _ => {
                    // What tells coordinates of three numbers from those of two.
                    if kind.starts_with("texCoord3") {
                        self.set(&path, Key::TypeName, Value::Text(kind.into()));
                    }
                    let value = self.value(kind, is_array)?;
                    self.set(&path, Key::Default, value);
                }
            }
        }
        if self.eat(b'(') {
            self.metadata(&path)?;
        }
        Ok(())
    }

    fn edit_paths(&mut self, path: &str, key: Key, edit: Edit, items: Vec<Arc<str>>) {
        let mut list = ListOp::default();
        edit.into_list(&mut list, items);
        self.set(path, key, Value::List(Arc::new(list)));
    }

    /// One path, several in brackets, or None.
    fn paths(&mut self, prim: &str) -> Read<Vec<Arc<str>>> {
        if self.eat_word("None") {
            return Ok(vec![]);
        }
        if !self.eat(b'[') {
            return Ok(vec![self.path(prim)?]);
        }
        let mut all = Vec::new();
        while !self.eat(b']') {
            all.push(self.path(prim)?);
            self.eat(b',');
        }
        Ok(all)
    }

    /// Time samples in braces.
    fn samples(&mut self, kind: &str, is_array: bool) -> Read<Value> {
        self.need(b'{')?;
        let mut all = Vec::new();
        while !self.eat(b'}') {
            let time = self.number()?;
            self.need(b':')?;
            all.push((time, Field::Ready(self.value(kind, is_array)?)));
            self.eat(b',');
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Value::Samples(all.into()))
    }

    /// A value of a type.
    fn value(&mut self, kind: &str, is_array: bool) -> Read<Value> {
        if self.eat_word("None") || self.eat_word("AnimationBlock") {
            return Ok(Value::Blocked);
        }
        if self.peek() == Some(b'{') {
            self.balanced()?;
            return Ok(Value::Other);
        }
        let is_bracketed = matches!(self.peek(), Some(b'[' | b'('));
        let Flat { numbers, texts } = self.items()?;
        if !texts.is_empty() && !numbers.is_empty() {
            return Err(self.wrong("texts and numbers in one value", "one of the two"));
        }
        if !texts.is_empty() || matches!(kind, "token" | "string" | "asset") {
            return Ok(match texts.first() {
                Some(text) if !is_bracketed => Value::Text(text.clone()),
                None if !is_bracketed => {
                    return Err(self.wrong(format!("a {kind} that is a number"), "text in quotation marks or @ @"));
                }
                _ => Value::Texts(texts.into()),
            });
        }
        Ok(match (is_array, kind) {
            (false, _) if !is_bracketed => Value::Number(numbers.first().copied().unwrap_or(0.0)),
            (false, _) => Value::Doubles(numbers.into()),
            (true, "bool" | "uchar" | "int" | "uint") => Value::Ints(numbers.into_iter().map(|v| v as i32).collect()),
            (true, "int64" | "uint64") => Value::Doubles(numbers.into()),
            (true, k) if k.starts_with("double") || k.ends_with('d') => Value::Doubles(numbers.into()),
            (true, _) => Value::Floats(numbers.into_iter().map(|v| v as f32).collect()),
        })
    }

    /// One item, or all in brackets, however deep.
    fn items(&mut self) -> Read<Flat> {
        let mut flat = Flat::default();
        let mut open = Vec::new();
        loop {
            match self.peek() {
                Some(b @ (b'[' | b'(')) => {
                    self.at += 1;
                    open.push(if b == b'[' { b']' } else { b')' });
                    if open.len() > DEEPEST {
                        return Err(self.wrong(format!("brackets more than {DEEPEST} deep"), "fewer levels"));
                    }
                    continue;
                }
                Some(b @ (b']' | b')')) if open.last() == Some(&b) => {
                    open.pop();
                    self.at += 1;
                }
                Some(b'"' | b'\'') => flat.texts.push(self.quoted()?),
                Some(b'@') => flat.texts.push(self.asset()?),
                Some(b'<') => flat.texts.push(self.path("/")?),
                Some(b'0'..=b'9' | b'-' | b'+' | b'.') => flat.numbers.push(self.number()?),
                Some(b) if b.is_ascii_alphabetic() => flat.numbers.push(match self.word() {
                    "true" | "True" => 1.0,
                    "false" | "False" | "None" => 0.0,
                    "inf" => f64::INFINITY,
                    "nan" => f64::NAN,
                    word => return Err(self.wrong(format!("\"{word}\""), "a number, text in quotation marks, true or false")),
                }),
                _ => return Err(self.unexpected("a value")),
            }
            if open.is_empty() {
                return Ok(flat);
            }
            self.eat(b',');
        }
    }

    /// What stands in round brackets behind a prim, a property or the head of the file.
    fn metadata(&mut self, path: &str) -> Read<()> {
        while !self.eat(b')') {
            if matches!(self.peek(), Some(b'"' | b'\'')) {
                self.quoted()?;
                continue;
            }
            let mut word = self.word();
            let edit = Edit::named(word).unwrap_or(Edit::Explicit);
            if edit != Edit::Explicit {
                word = self.word();
            }
            if word.is_empty() {
                return Err(self.unexpected("the name of a piece of metadata, or )"));
            }
            self.need(b'=')?;
            match word {
                "references" | "payload" => {
                    let mut list = ListOp::default();
                    edit.into_list(&mut list, self.references(path)?);
                    let key = if word == "payload" { Key::Payload } else { Key::References };
                    self.set(path, key, Value::References(Arc::new(list)));
                }
                "inherits" | "specializes" => {
                    let items = self.paths(path)?;
                    let key = if word == "inherits" { Key::InheritPaths } else { Key::Specializes };
                    self.edit_paths(path, key, edit, items);
                }
                "variantSets" | "apiSchemas" => {
                    let items = if self.eat_word("None") { vec![] } else { self.items()?.texts };
                    let key = if word == "apiSchemas" { Key::ApiSchemas } else { Key::VariantSetNames };
                    self.edit_paths(path, key, edit, items);
                }
                "inactiveIds" => {
                    let numbers = if self.eat_word("None") { vec![] } else { self.items()?.numbers };
                    let items = numbers.into_iter().map(|v| (v as i64).to_string().into()).collect();
                    self.edit_paths(path, Key::InactiveIds, edit, items);
                }
                "variants" => {
                    let chosen = self.selections()?;
                    self.set(path, Key::VariantSelection, Value::Selections(chosen.into()));
                }
                "subLayers" => self.sub_layers()?,
                "relocates" => {
                    self.balanced()?;
                    self.set(path, Key::Relocates, Value::Other);
                }
                _ => match Key::named(word) {
                    Some(
                        key @ (Key::Active
                        | Key::BindMaterialAs
                        | Key::Clips
                        | Key::DefaultPrim
                        | Key::FramesPerSecond
                        | Key::Instanceable
                        | Key::Interpolation
                        | Key::MetersPerUnit
                        | Key::StartTimeCode
                        | Key::TimeCodesPerSecond
                        | Key::UpAxis
                        | Key::Weight),
                    ) => {
                        let value = self.value("", false)?;
                        self.set(path, key, value);
                    }
                    _ => self.balanced()?,
                },
            }
            self.eat(b';');
        }
        Ok(())
    }

    /// One reference, several in brackets, or None.
    fn references(&mut self, prim: &str) -> Read<Vec<Reference>> {
        if self.eat_word("None") {
            return Ok(vec![]);
        }
        if !self.eat(b'[') {
            return Ok(vec![self.reference(prim)?]);
        }
        let mut all = Vec::new();
        while !self.eat(b']') {
            all.push(self.reference(prim)?);
            self.eat(b',');
        }
        Ok(all)
    }

    fn reference(&mut self, prim: &str) -> Read<Reference> {
        let asset = if self.peek() == Some(b'@') { self.asset()? } else { "".into() };
        let path = match self.peek() {
            Some(b'<') => self.path(prim)?,
            _ if asset.is_empty() => return Err(self.unexpected("@file@, </Prim> or both")),
            _ => "".into(),
        };
        Ok(Reference { asset, prim: path, shift: self.shift()? })
    }

    /// "(offset = 1; scale = 2)", if it is there.
    fn shift(&mut self) -> Read<TimeShift> {
        let mut shift = TimeShift::NONE;
        if !self.eat(b'(') {
            return Ok(shift);
        }
        while !self.eat(b')') {
            let word = self.word();
            self.need(b'=')?;
            match word {
                "offset" => shift.offset = self.number()?,
                "scale" => shift.scale = self.number()?,
                _ => self.balanced()?,
            }
            self.eat(b';');
            self.eat(b',');
        }
        Ok(shift)
    }

    fn sub_layers(&mut self) -> Read<()> {
        let (mut names, mut shifts) = (Vec::new(), Vec::new());
        self.need(b'[')?;
        while !self.eat(b']') {
            names.push(self.asset()?);
            let shift = self.shift()?;
            shifts.extend([shift.offset, shift.scale]);
            self.eat(b',');
        }
        self.set("/", Key::SubLayers, Value::Texts(names.into()));
        self.set("/", Key::SubLayerOffsets, Value::Doubles(shifts.into()));
        Ok(())
    }

    fn selections(&mut self) -> Read<Vec<(Arc<str>, Arc<str>)>> {
        self.need(b'{')?;
        let mut all = Vec::new();
        while !self.eat(b'}') {
            if !self.eat_word("string") {
                return Err(self.unexpected("string set = \"variant\""));
            }
            let set = if matches!(self.peek(), Some(b'"' | b'\'')) { self.quoted()? } else { self.word().into() };
            self.need(b'=')?;
            all.push((set, self.quoted()?));
            self.eat(b';');
            self.eat(b',');
        }
        Ok(all)
    }
}

/// Two edits of one list that a file states one after the other.
fn merge<T: Clone>(old: &mut ListOp<T>, new: &ListOp<T>) {
    if new.explicit.is_some() {
        old.explicit.clone_from(&new.explicit);
    }
    old.prepended.extend_from_slice(&new.prepended);
    old.appended.extend_from_slice(&new.appended);
    old.deleted.extend_from_slice(&new.deleted);
}

#[cfg(test)]
mod tests;

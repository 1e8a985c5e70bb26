//! Parameter lists: `"type name" [ values ]`.

use super::lex::{Lexer, Token};
use super::{Fault, Place};
use glam::{Vec2, Vec3};
use std::cell::Cell;

/// What a parameter holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// `float`, `integer`, points, vectors, colours ...
    Numbers(Vec<f64>),
    /// `string`, `texture`, named or filed spectra.
    Texts(Vec<String>),
    /// `bool`.
    Bools(Vec<bool>),
}

/// One parameter.
#[derive(Clone, Debug)]
pub struct Param {
    /// Type as written: `float`, `rgb`, `spectrum` ...
    pub kind: String,
    /// Name.
    pub name: String,
    /// Values.
    pub values: Values,
    /// Where it stands.
    pub place: Place,
    used: Cell<bool>,
}

/// All parameters of a directive.
#[derive(Clone, Debug, Default)]
pub struct Params {
    list: Vec<Param>,
    /// Where the directive stands.
    pub place: Place,
}

const KINDS: [&str; 17] = [
    "float",
    "integer",
    "bool",
    "string",
    "texture",
    "spectrum",
    "rgb",
    "blackbody",
    "point",
    "point2",
    "point3",
    "vector",
    "vector2",
    "vector3",
    "normal",
    "normal3",
    "xyz",
];

/// Reads a list up to the next directive. Fails where a declaration is no type and name, its type is not known or is pbrt-v3's, or its values are missing, of another
/// kind, too few or not finite.
pub fn read(lexer: &mut Lexer, place: Place) -> Result<Params, Fault> {
    let mut list: Vec<Param> = Vec::new();
    while let Some((Token::Text(_), _)) = lexer.peek()? {
        let Some((Token::Text(declared), place)) = lexer.next()? else { break };
        let mut words = declared.split_ascii_whitespace();
        let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
            return Err(place.fault(format!("\"{declared}\""), "a type and a name, such as \"float radius\""));
        };
        if kind == "color" {
            return Err(place.version_3(format!("\"{declared}\"")));
        }
        if !KINDS.contains(&kind) {
            return Err(place.fault(format!("a parameter of type {kind}"), format!("one of {}", KINDS.join(", "))));
        }
        let values = values(lexer, kind, name, place)?;
        // The last of several counts.
        list.retain(|p| p.name != name);
        list.push(Param { kind: kind.to_owned(), name: name.to_owned(), values, place, used: Cell::new(false) });
    }
    Ok(Params { list, place })
}

fn values(lexer: &mut Lexer, kind: &str, name: &str, place: Place) -> Result<Values, Fault> {
    let missing = || place.fault(format!("no value of \"{kind} {name}\""), "a value, or a list of them in brackets");
    let mut tokens = Vec::new();
    let mut numbers = Vec::new();
    match lexer.next()?.ok_or_else(missing)? {
        (Token::Open, _) => loop {
            match lexer.next()? {
                Some((Token::Close, _)) => break,
                Some((Token::Number(n), _)) => numbers.push(n),
                Some((Token::Open, at)) => return Err(at.fault("[", "values and a closing ]")),
                Some(token) => tokens.push(token),
                None => return Err(place.fault(format!("the end of the file within the values of \"{name}\""), "a closing ]")),
            }
        },
        (Token::Number(n), _) => numbers.push(n),
        token @ (Token::Word(_) | Token::Text(_), _) => tokens.push(token),
        (Token::Close, _) => return Err(missing()),
    }
    if let Some((_, at)) = tokens.first().filter(|_| !numbers.is_empty()) {
        return Err(at.fault(format!("numbers and text in the values of \"{name}\""), "one kind"));
    }
    let numeric = !matches!(kind, "string" | "texture" | "bool") && (kind != "spectrum" || tokens.is_empty());
    if numeric {
        if let Some((token, at)) = tokens.first() {
            return Err(at.fault(token.shown(), format!("a number, as \"{kind} {name}\" has")));
        }
        let group = match kind {
            "point2" | "vector2" => 2,
            "rgb" | "xyz" | "point" | "point3" | "vector" | "vector3" | "normal" | "normal3" => 3,
            _ => 1,
        };
        if numbers.is_empty() && group == 1 && kind != "integer" && kind != "float" || numbers.len() % group != 0 {
            return Err(place.fault(
                format!("{} values of \"{kind} {name}\"", numbers.len()),
                if group == 1 { "at least one".to_owned() } else { format!("a multiple of {group}") },
            ));
        }
        if let Some(bad) = numbers.iter().find(|n| !n.is_finite()) {
            return Err(place.fault(format!("{bad} in \"{kind} {name}\""), "finite numbers"));
        }
        return Ok(Values::Numbers(numbers));
    }
    if !numbers.is_empty() {
        return Err(place.fault(format!("a number as \"{kind} {name}\""), "text in quotation marks"));
    }
    if kind == "bool" {
        let bool = |(token, at): &(Token, Place)| match token {
            Token::Word(w) | Token::Text(w) if w == "true" => Ok(true),
            Token::Word(w) | Token::Text(w) if w == "false" => Ok(false),
            other => Err(at.fault(other.shown(), "true or false")),
        };
        return Ok(Values::Bools(tokens.iter().map(bool).collect::<Result<_, _>>()?));
    }
    let text = |(token, at): &(Token, Place)| match token {
        Token::Text(t) => Ok(t.clone()),
        other => Err(at.fault(other.shown(), "text in quotation marks")),
    };
    Ok(Values::Texts(tokens.iter().map(text).collect::<Result<_, _>>()?))
}

impl Params {
    /// The same with those of an enclosing `Attribute` directive, which count where the list itself says nothing.
    pub fn over(mut self, defaults: &[Param]) -> Params {
        for d in defaults {
            if !self.list.iter().any(|p| p.name == d.name) {
                let copy = d.clone();
                // They are meant for whoever has such a parameter.
                copy.used.set(true);
                self.list.push(copy);
            }
        }
        self
    }

    /// All of them.
    pub fn into_list(self) -> Vec<Param> {
        self.list
    }

    /// A parameter by name, whatever its type.
    pub fn get(&self, name: &str) -> Option<&Param> {
        let found = self.list.iter().find(|p| p.name == name)?;
        found.used.set(true);
        Some(found)
    }

    /// Parameters that nobody asked for.
    pub fn unused(&self) -> impl Iterator<Item = &Param> {
        self.list.iter().filter(|p| !p.used.get())
    }

    fn numbers(&self, name: &str, kinds: &[&str]) -> Result<Option<&[f64]>, Fault> {
        let Some(p) = self.get(name) else { return Ok(None) };
        match &p.values {
            Values::Numbers(n) if kinds.contains(&p.kind.as_str()) => Ok(Some(n)),
            _ => Err(p.place.fault(format!("\"{} {name}\"", p.kind), format!("\"{} {name}\"", kinds[0]))),
        }
    }

    /// A list of numbers; `None` where the parameter is not there. Fails where it is of another type.
    pub fn floats(&self, name: &str) -> Result<Option<&[f64]>, Fault> {
        self.numbers(name, &["float"])
    }

    /// Whole numbers. Fails where they are of another type.
    pub fn integers(&self, name: &str) -> Result<Option<&[f64]>, Fault> {
        self.numbers(name, &["integer"])
    }

    /// One number, the first of a list. Fails where it is of another type.
    pub fn float(&self, name: &str, default: f64) -> Result<f64, Fault> {
        Ok(self.floats(name)?.and_then(|n| n.first().copied()).unwrap_or(default))
    }

    /// One whole number, the first of a list, its fraction cut off. Fails where it is of another type.
    pub fn integer(&self, name: &str, default: i64) -> Result<i64, Fault> {
        Ok(self.integers(name)?.and_then(|n| n.first().copied()).map_or(default, |n| n as i64))
    }

    /// Whole numbers that count from 0 up, below 2^31; `None` where the parameter is not there. Fails where one is not such a number, or of another type.
    pub fn indices(&self, name: &str) -> Result<Option<Vec<u32>>, Fault> {
        let Some(n) = self.numbers(name, &["integer"])? else { return Ok(None) };
        let index = |v: &f64| ((0.0..2_147_483_648.0).contains(v) && v.fract() == 0.0).then_some(*v as u32);
        let all: Option<Vec<u32>> = n.iter().map(index).collect();
        all.map(Some).ok_or_else(|| self.place.fault(format!("\"integer {name}\" with numbers out of range"), "0 to 2147483647"))
    }

    /// Yes or no. Fails where it is of another type.
    pub fn bool(&self, name: &str, default: bool) -> Result<bool, Fault> {
        let Some(p) = self.get(name) else { return Ok(default) };
        match &p.values {
            Values::Bools(b) => Ok(b.first().copied().unwrap_or(default)),
            _ => Err(p.place.fault(format!("\"{} {name}\"", p.kind), format!("\"bool {name}\""))),
        }
    }

    /// Text, the first of a list; `None` where it is not there. Fails where it is of another type.
    pub fn text(&self, name: &str) -> Result<Option<&str>, Fault> {
        let Some(p) = self.get(name) else { return Ok(None) };
        match &p.values {
            Values::Texts(t) if p.kind == "string" => Ok(t.first().map(String::as_str)),
            _ => Err(p.place.fault(format!("\"{} {name}\"", p.kind), format!("\"string {name}\""))),
        }
    }

    /// Places or directions in space; `None` where the parameter is not there. Fails where it is of another type.
    pub fn vectors(&self, name: &str) -> Result<Option<Vec<Vec3>>, Fault> {
        let kinds = ["point3", "point", "vector3", "vector", "normal", "normal3"];
        let n = self.numbers(name, &kinds)?;
        Ok(n.map(|n| n.chunks_exact(3).map(|v| Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32)).collect()))
    }

    /// One place or direction. Fails where it is of another type.
    pub fn vector(&self, name: &str, default: Vec3) -> Result<Vec3, Fault> {
        Ok(self.vectors(name)?.and_then(|v| v.first().copied()).unwrap_or(default))
    }

    /// Places in the plane; `None` where the parameter is not there. Fails where it is of another type.
    pub fn points2(&self, name: &str) -> Result<Option<Vec<Vec2>>, Fault> {
        let n = self.numbers(name, &["point2", "vector2"])?;
        Ok(n.map(|n| n.chunks_exact(2).map(|v| Vec2::new(v[0] as f32, v[1] as f32)).collect()))
    }
}

//! pbrt's text: words, quoted strings, numbers and brackets, each with its place.

use super::{Fault, Place};

/// A piece of text.
#[derive(Clone, Debug, PartialEq)]
pub enum Token {
    /// A directive, or `true` and `false`.
    Word(String),
    /// Text between quotes, escapes resolved.
    Text(String),
    /// A number.
    Number(f64),
    /// `[`
    Open,
    /// `]`
    Close,
}

impl Token {
    /// As messages show it.
    pub fn shown(&self) -> String {
        match self {
            Token::Word(w) => w.clone(),
            Token::Text(t) => format!("\"{t}\""),
            Token::Number(n) => n.to_string(),
            Token::Open => "[".into(),
            Token::Close => "]".into(),
        }
    }
}

/// Reads tokens from one file.
pub struct Lexer<'a> {
    text: &'a [u8],
    at: usize,
    line: u32,
    file: u32,
    ahead: Option<(Token, Place)>,
}

impl<'a> Lexer<'a> {
    /// Reads a file's bytes; `file`: its number in messages.
    pub fn new(text: &'a [u8], file: u32) -> Self {
        Lexer { text, at: 0, line: 1, file, ahead: None }
    }

    /// Where it stands.
    pub fn place(&self) -> Place {
        Place { file: self.file, line: self.line }
    }

    /// The next token without taking it; `None` at the end. Fails as [`Lexer::next`] does.
    pub fn peek(&mut self) -> Result<Option<&(Token, Place)>, Fault> {
        if self.ahead.is_none() {
            self.ahead = self.read()?;
        }
        Ok(self.ahead.as_ref())
    }

    /// The next token; `None` at the end. Fails with the line of a quotation mark that is not closed, an escape that is not known, a word that begins as a number and is
    /// none, or bytes that are not UTF-8.
    pub fn next(&mut self) -> Result<Option<(Token, Place)>, Fault> {
        match self.ahead.take() {
            Some(token) => Ok(Some(token)),
            None => self.read(),
        }
    }

    fn skip_blank(&mut self) {
        while let Some(c) = self.text.get(self.at) {
            match c {
                b'\n' => self.line += 1,
                b'#' => {
                    while self.text.get(self.at + 1).is_some_and(|c| *c != b'\n') {
                        self.at += 1;
                    }
                }
                c if c.is_ascii_whitespace() => (),
                _ => break,
            }
            self.at += 1;
        }
    }

    fn read(&mut self) -> Result<Option<(Token, Place)>, Fault> {
        self.skip_blank();
        let place = self.place();
        let Some(first) = self.text.get(self.at) else { return Ok(None) };
        let token = match first {
            b'[' | b']' => {
                self.at += 1;
                if *first == b'[' { Token::Open } else { Token::Close }
            }
            b'"' => self.quoted(place)?,
            _ => {
                let from = self.at;
                while self.text.get(self.at).is_some_and(|c| !c.is_ascii_whitespace() && !b"[]\"#".contains(c)) {
                    self.at += 1;
                }
                let word = std::str::from_utf8(&self.text[from..self.at])
                    .map_err(|_| place.fault("bytes that are not text", "pbrt's text format"))?;
                match first {
                    b'0'..=b'9' | b'+' | b'-' | b'.' => {
                        Token::Number(number(word).ok_or_else(|| place.fault(format!("\"{word}\""), "a number"))?)
                    }
                    _ => Token::Word(word.to_owned()),
                }
            }
        };
        Ok(Some((token, place)))
    }

    fn quoted(&mut self, place: Place) -> Result<Token, Fault> {
        let mut bytes = Vec::new();
        self.at += 1;
        loop {
            let Some(c) = self.text.get(self.at).copied() else {
                return Err(place.fault("a quotation mark that is never closed", "a closing \""));
            };
            self.at += 1;
            match c {
                b'"' => break,
                b'\n' => return Err(place.fault("a line that ends within quotation marks", "a closing \" on the same line")),
                b'\\' => {
                    let escaped = self.text.get(self.at).copied();
                    self.at += 1;
                    bytes.push(match escaped {
                        Some(b'n') => b'\n',
                        Some(b't') => b'\t',
                        Some(b'r') => b'\r',
                        Some(b'b') => 8,
                        Some(b'f') => 12,
                        Some(c @ (b'\\' | b'"' | b'\'')) => c,
                        other => {
                            let found = other.map_or("the end".to_owned(), |c| format!("\\{}", c as char));
                            return Err(place.fault(found, "one of \\n \\t \\r \\b \\f \\\\ \\\" \\'"));
                        }
                    });
                }
                c => bytes.push(c),
            }
        }
        String::from_utf8(bytes)
            .map(Token::Text)
            .map_err(|_| place.fault("bytes that are not text", "UTF-8 within quotation marks"))
    }
}

/// A number as C writes it: an integer, a decimal, with an exponent.
fn number(word: &str) -> Option<f64> {
    let word = word.strip_prefix('+').unwrap_or(word);
    let digits = word.bytes().all(|c| matches!(c, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
    if digits { word.parse().ok() } else { None }
}

//! The characters of a text layer: words, numbers, quoted texts, asset paths and paths, and what is skipped.

use super::{Parser, Read};
use crate::SceneError;
use crate::load::usd::error;
use crate::load::usd::layer::{child_path, without_variants};
use std::sync::Arc;

impl<'a> Parser<'a> {
    pub(super) fn wrong(&self, found: impl Into<String>, expected: &str) -> SceneError {
        let line = self.text.as_bytes()[..self.at.min(self.text.len())].iter().filter(|b| **b == b'\n').count() + 1;
        error(&format!("{}: line {line}", self.name), found, expected)
    }

    /// What stands here, for messages.
    fn here(&self) -> String {
        let rest: String = self.text[self.at..].chars().take_while(|c| !c.is_whitespace()).take(40).collect();
        if rest.is_empty() { "the end of the file".to_owned() } else { format!("\"{rest}\"") }
    }

    pub(super) fn unexpected(&self, expected: &str) -> SceneError {
        self.wrong(self.here(), expected)
    }

    /// Skips white space and comments.
    fn space(&mut self) {
        let bytes = self.text.as_bytes();
        while let Some(b) = bytes.get(self.at) {
            match b {
                b' ' | b'\t' | b'\r' | b'\n' => self.at += 1,
                b'#' => self.comment(b"\n"),
                b'/' if bytes.get(self.at + 1) == Some(&b'/') => self.comment(b"\n"),
                b'/' if bytes.get(self.at + 1) == Some(&b'*') => self.comment(b"*/"),
                _ => break,
            }
        }
    }

    fn comment(&mut self, end: &[u8]) {
        let rest = &self.text.as_bytes()[self.at..];
        let n = rest.windows(end.len()).position(|w| w == end).map_or(rest.len(), |n| n + end.len());
        self.at += n;
    }

    pub(super) fn peek(&mut self) -> Option<u8> {
        self.space();
        self.text.as_bytes().get(self.at).copied()
    }

    pub(super) fn eat(&mut self, byte: u8) -> bool {
        let there = self.peek() == Some(byte);
        self.at += usize::from(there);
        there
    }

    pub(super) fn need(&mut self, byte: u8) -> Read<()> {
        if self.eat(byte) { Ok(()) } else { Err(self.unexpected(&format!("\"{}\"", char::from(byte)))) }
    }

    /// A name: letters, digits, and what joins names of namespaces and types.
    pub(super) fn word(&mut self) -> &'a str {
        self.space();
        let text = self.text;
        let rest = &text[self.at..];
        let end = rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | ':' | '.' | '-' | '+'))).unwrap_or(rest.len());
        self.at += end;
        &rest[..end]
    }

    /// Takes a word if it is this one.
    pub(super) fn eat_word(&mut self, word: &str) -> bool {
        let before = self.at;
        let there = self.word() == word;
        if !there {
            self.at = before;
        }
        there
    }

    /// What stands between two marks, of which the second one may not be escaped.
    pub(super) fn quoted(&mut self) -> Read<Arc<str>> {
        self.space();
        let text = self.text;
        let rest = &text[self.at..];
        let mark = ["\"\"\"", "'''", "\"", "'"].into_iter().find(|m| rest.starts_with(m));
        let Some(mark) = mark else { return Err(self.unexpected("text in quotation marks")) };
        let inner = &rest[mark.len()..];
        let mut end = None;
        let bytes = inner.as_bytes();
        let mut i = 0;
        while i < bytes.len() {
            match bytes[i] {
                b'\\' => i += 1,
                b'\n' if mark.len() == 1 => break,
                _ if bytes[i..].starts_with(mark.as_bytes()) => {
                    end = Some(i);
                    break;
                }
                _ => (),
            }
            i += 1;
        }
        let Some(end) = end else { return Err(self.wrong("text without end", &format!("{mark} behind it"))) };
        self.at += 2 * mark.len() + end;
        let inner = &inner[..end];
        if !inner.contains('\\') {
            return Ok(inner.into());
        }
        let mut out = String::with_capacity(inner.len());
        let mut chars = inner.chars();
        while let Some(c) = chars.next() {
            match (c, if c == '\\' { chars.next() } else { None }) {
                ('\\', Some('n')) => out.push('\n'),
                ('\\', Some('t')) => out.push('\t'),
                ('\\', Some('r')) => out.push('\r'),
                ('\\', Some(other)) => out.push(other),
                (c, _) => out.push(c),
            }
        }
        Ok(out.into())
    }

    /// An asset path between @ or @@@.
    pub(super) fn asset(&mut self) -> Read<Arc<str>> {
        self.space();
        let text = self.text;
        let rest = &text[self.at..];
        let mark = if rest.starts_with("@@@") { "@@@" } else { "@" };
        let inner = rest.strip_prefix(mark).ok_or_else(|| self.unexpected("@file@"))?;
        let end = inner.find(mark).ok_or_else(|| self.wrong("an asset path without end", "@file@"))?;
        self.at += 2 * mark.len() + end;
        Ok(inner[..end].into())
    }

    /// A path between < and >, absolute: relative ones count from a prim.
    pub(super) fn path(&mut self, prim: &str) -> Read<Arc<str>> {
        self.space();
        let text = self.text;
        let rest = &text[self.at..];
        let inner = rest.strip_prefix('<').and_then(|r| Some(&r[..r.find('>')?]));
        let inner = inner.ok_or_else(|| self.unexpected("a path in < >"))?;
        self.at += inner.len() + 2;
        if inner.is_empty() || inner.starts_with('/') {
            return Ok(inner.into());
        }
        let mut from = without_variants(prim);
        let mut rest = inner;
        loop {
            if let Some(r) = rest.strip_prefix("..") {
                from.truncate(from.rfind('/').unwrap_or(0));
                rest = r.strip_prefix('/').unwrap_or(r);
            } else if let Some(r) = rest.strip_prefix("./") {
                rest = r;
            } else {
                break;
            }
        }
        Ok(match rest {
            "" | "." => from.into(),
            r if r.starts_with('.') => format!("{from}{r}").into(),
            r => child_path(if from.is_empty() { "/" } else { &from }, r).into(),
        })
    }

    pub(super) fn number(&mut self) -> Read<f64> {
        self.space();
        let bytes = self.text.as_bytes();
        let start = self.at;
        let mut end = start;
        while bytes.get(end).is_some_and(|b| b.is_ascii_alphanumeric() || matches!(b, b'+' | b'-' | b'.')) {
            end += 1;
        }
        match self.text[start..end].parse() {
            Ok(number) => {
                self.at = end;
                Ok(number)
            }
            Err(_) => Err(self.unexpected("a number")),
        }
    }

    /// Skips one item, or all in brackets and braces.
    pub(super) fn balanced(&mut self) -> Read<()> {
        let mut open = Vec::new();
        loop {
            match self.peek() {
                Some(b @ (b'{' | b'[' | b'(')) => {
                    self.at += 1;
                    open.push(match b {
                        b'{' => b'}',
                        b'[' => b']',
                        _ => b')',
                    });
                }
                Some(b @ (b'}' | b']' | b')')) if open.last() == Some(&b) => {
                    open.pop();
                    self.at += 1;
                }
                Some(b'"' | b'\'') => drop(self.quoted()?),
                Some(b'@') => drop(self.asset()?),
                Some(b'<') => drop(self.path("/")?),
                Some(b'=' | b',' | b';' | b':') if !open.is_empty() => self.at += 1,
                _ if !self.word().is_empty() => (),
                _ => return Err(self.unexpected("a value")),
            }
            if open.is_empty() {
                return Ok(());
            }
        }
    }

    /// Skips "= value", or what else stands behind a word that is not asked for.
    pub(super) fn statement(&mut self) -> Read<()> {
        if !self.eat(b'=') {
            self.word();
            self.need(b'=')?;
        }
        self.balanced()
    }
}

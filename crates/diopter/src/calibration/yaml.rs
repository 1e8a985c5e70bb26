//! As much of YAML as calibration files use: maps by indentation, lists in brackets or with dashes, matrices with a tag. Values become JSON's.

use super::{CalibrationError, wrong};
use serde_json::{Map, Value};

/// Brackets and indentations within each other.
const DEEPEST: usize = 16;

/// A line: number, indentation, text.
type Line<'a> = (usize, usize, std::borrow::Cow<'a, str>);

/// Reads a file of one document.
pub(super) fn parse(text: &str, name: &str) -> Result<Value, CalibrationError> {
    let mut lines: Vec<Line> = Vec::new();
    let mut open = 0i64;
    for (number, raw) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = without_comment(raw);
        let bare = line.trim();
        if bare.is_empty() || (open == 0 && (bare.starts_with('%') || bare == "---" || bare == "...")) {
            continue;
        }
        let change = brackets(bare);
        match lines.last_mut() {
            // A list goes on over several lines.
            Some(last) if open > 0 => {
                let joined = last.2.to_mut();
                joined.push(' ');
                joined.push_str(bare);
            }
            _ => lines.push((number + 1, line.len() - line.trim_start().len(), bare.into())),
        }
        open += change;
    }
    let mut reader = Reader { name, lines: &lines, at: 0 };
    let value = reader.block(0, 0)?;
    match reader.lines.get(reader.at) {
        None => Ok(value),
        Some((number, ..)) => Err(reader.wrong(*number, "a line that is indented otherwise")),
    }
}

/// A line up to a comment, which begins with # at its start or after a space, outside quotes.
fn without_comment(line: &str) -> &str {
    let (mut quote, mut before) = (None, ' ');
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (Some(q), c) if c == q => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '#') if before.is_whitespace() => return &line[..i],
            _ => {}
        }
        before = c;
    }
    line.trim_end()
}

/// Brackets that open, less those that close, outside quotes.
fn brackets(line: &str) -> i64 {
    let (mut quote, mut open) = (None, 0);
    for c in line.chars() {
        match (quote, c) {
            (Some(q), c) if c == q => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => open += 1,
            (None, ']' | '}') => open -= 1,
            _ => {}
        }
    }
    open
}

struct Reader<'a> {
    name: &'a str,
    lines: &'a [Line<'a>],
    at: usize,
}

impl Reader<'_> {
    fn wrong(&self, line: usize, found: &str) -> CalibrationError {
        wrong(format!("{}:{line}", self.name), found, "YAML as OpenCV and Kalibr write it")
    }

    /// All lines with at least an indentation.
    fn block(&mut self, least: usize, depth: usize) -> Result<Value, CalibrationError> {
        let Some((number, indent, first)) = self.lines.get(self.at).filter(|l| l.1 >= least) else { return Ok(Value::Null) };
        if depth > DEEPEST {
            return Err(self.wrong(*number, "too many indentations"));
        }
        if first.starts_with("- ") || first.as_ref() == "-" {
            let mut items = Vec::new();
            while let Some((_, i, text)) = self.lines.get(self.at).filter(|l| l.1 == *indent && l.2.starts_with('-')) {
                debug_assert_eq!(i, indent);
                self.at += 1;
                items.push(
                    value(text[1..].trim(), 0)
                        .ok_or_else(|| self.wrong(self.lines[self.at - 1].0, "an item that cannot be read"))?,
                );
            }
            return Ok(Value::Array(items));
        }
        let mut map = Map::new();
        while let Some((number, _, text)) = self.lines.get(self.at).filter(|l| l.1 == *indent) {
            let Some((key, rest)) = split_key(text) else { return Err(self.wrong(*number, "a line without \"key:\"")) };
            self.at += 1;
            let rest = if rest.starts_with("!!") { rest.split_once(' ').map_or("", |r| r.1.trim()) } else { rest };
            let item = match rest {
                "" => {
                    // Lists may stand as far left as their key.
                    let dashes = self.lines.get(self.at).is_some_and(|l| l.1 == *indent && l.2.starts_with("- "));
                    self.block(if dashes { *indent } else { indent + 1 }, depth + 1)?
                }
                rest => value(rest, 0).ok_or_else(|| self.wrong(*number, "a value that cannot be read"))?,
            };
            map.insert(key.to_owned(), item);
        }
        Ok(Value::Object(map))
    }
}

/// "key: rest".
fn split_key(text: &str) -> Option<(&str, &str)> {
    let (key, rest) = match text.strip_suffix(':') {
        Some(key) if !key.contains(": ") => (key, ""),
        _ => text.split_once(": ")?,
    };
    Some((key.trim().trim_matches(['"', '\'']), rest.trim()))
}

/// A list in brackets, a number, a word; `None` for brackets that do not close.
fn value(text: &str, depth: usize) -> Option<Value> {
    if depth > DEEPEST {
        return None;
    }
    let text = text.trim();
    if let Some(inside) = text.strip_prefix('[') {
        let inside = inside.strip_suffix(']')?;
        return pieces(inside)?.into_iter().map(|p| value(p, depth + 1)).collect::<Option<Vec<_>>>().map(Value::Array);
    }
    if let Some(inside) = text.strip_prefix('{') {
        let inside = inside.strip_suffix('}')?;
        let pair = |p: &str| {
            let (key, rest) = split_key(p.trim())?;
            Some((key.to_owned(), value(rest, depth + 1)?))
        };
        return pieces(inside)?.into_iter().map(pair).collect::<Option<Map<_, _>>>().map(Value::Object);
    }
    // "1." and ".5" are numbers for OpenCV.
    let number = text.parse::<f64>().ok().filter(|v| v.is_finite()).and_then(serde_json::Number::from_f64);
    Some(match (number, text) {
        (Some(n), _) => Value::Number(n),
        (None, "true") => Value::Bool(true),
        (None, "false") => Value::Bool(false),
        (None, "null" | "~" | "") => Value::Null,
        (None, _) => Value::String(text.trim_matches(['"', '\'']).to_owned()),
    })
}

/// What commas separate, outside brackets and quotes; `None` where brackets do not match.
fn pieces(text: &str) -> Option<Vec<&str>> {
    let (mut all, mut begin, mut open, mut quote) = (Vec::new(), 0, 0i32, None);
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (Some(q), c) if c == q => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => open += 1,
            (None, ']' | '}') => open -= 1,
            (None, ',') if open == 0 => {
                all.push(&text[begin..i]);
                begin = i + 1;
            }
            _ => {}
        }
        if open < 0 {
            return None;
        }
    }
    let last = &text[begin..];
    if !last.trim().is_empty() {
        all.push(last);
    }
    (open == 0).then_some(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn files_of_opencv_and_kalibr_are_read() {
        let text = "%YAML:1.0\n---\n# a comment\nimage_width: 640\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   dt: d\n   data: [ 5.0e+02, 0., 3.2e+02,\n       \
                    0., 1 ] # more\nname: \"a: b # c\"\nlist:\n- [1, 2]\n- x\n";
        let v = parse(text, "f").unwrap();
        assert_eq!(
            v,
            json!({ "image_width": 640.0, "camera_matrix": { "rows": 3.0, "dt": "d", "data": [500.0, 0.0, 320.0, 0.0, 1.0] },
                "name": "a: b # c", "list": [[1.0, 2.0], "x"] })
        );
        let v = parse("cam0:\n  T_cn_cnm1:\n  - [1.0, 0.0]\n  - [0.0, 1.0]\n  resolution: [752, 480]\n", "f").unwrap();
        assert_eq!(v["cam0"]["T_cn_cnm1"], json!([[1.0, 0.0], [0.0, 1.0]]));
        assert_eq!(v["cam0"]["resolution"], json!([752.0, 480.0]));
    }

    #[test]
    fn what_is_no_yaml_is_an_error_with_its_line() {
        for (text, line) in [("a: 1\nhello\n", ":2"), ("a: [1, 2\n", ":1"), ("a: 1\n   b: 2\n", ":2")] {
            assert!(parse(text, "f").unwrap_err().to_string().contains(line), "{text}");
        }
        assert!(parse(&format!("a: {}", "[".repeat(100_000)), "f").is_err());
        assert!(parse(&format!("a: {}{}", "[".repeat(10_000), "]".repeat(10_000)), "f").is_err());
    }
}

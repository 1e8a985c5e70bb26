//! What kind of thing objects are: labels for segmentation, from the `extras` of glTF nodes or from a table.
//!
//! glTF keeps what applications add to a node in `extras` (glTF 2.0, §3.2); Blender exports custom properties there. Of a node, or else its nearest ancestor that says one, or else
//! its mesh, the first of the keys `class`, `category` and `category_id` (BlenderProc's) counts, a text or a number.
//!
//! In USD it is what `load::usd` finds in `semantics:labels`.
//!
//! A table is text, a line each: `pattern, class`. The first line whose pattern is the name of the object counts; `*` stands for any text, and `material:` before a pattern means
//! the name of the material. Empty lines and lines that begin with `#` say nothing. What a table says goes before what the file of the scene says.

use crate::scene::Description;
use serde_json::Value;
use std::sync::Arc;

/// The class of what nobody gave one.
pub const UNCLASSIFIED: &str = "unclassified";

/// Keys of `extras` that name a class, the first first.
const KEYS: [&str; 3] = ["class", "category", "category_id"];

/// The class that the `extras` of a node or mesh name; `None` where they name none.
pub(crate) fn said(extras: Option<&str>) -> Option<Arc<str>> {
    let extras: Value = serde_json::from_str(extras?).ok()?;
    KEYS.iter().find_map(|key| match extras.get(key)? {
        Value::String(text) if !text.trim().is_empty() => Some(text.trim().into()),
        Value::Number(number) => Some(number.to_string().into()),
        _ => None,
    })
}

/// A line of a table.
#[derive(Clone, Debug, PartialEq)]
struct Rule {
    line: usize,
    of_material: bool,
    pattern: String,
    class: Arc<str>,
}

/// Classes by names of objects and materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClassTable {
    rules: Vec<Rule>,
}

/// A line of a table that says nothing sensible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {found}; expected \"pattern, class\", such as \"chair*, chair\" or \"material:glass, window\"")]
pub struct ClassTableError {
    /// Number of the line from 1.
    pub line: usize,
    /// What is there.
    pub found: String,
}

impl ClassTable {
    /// Reads a table. Fails on lines without a comma, with nothing before or behind it, and on a table of no lines.
    pub fn parse(text: &str) -> Result<ClassTable, ClassTableError> {
        let mut rules = Vec::new();
        for (k, line) in text.lines().enumerate() {
            let line_number = k + 1;
            let line = line.trim_start_matches('\u{feff}').trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            // Names may have commas, classes have none.
            let (pattern, class) = line.rsplit_once(',').map_or((line, ""), |(pattern, class)| (pattern.trim(), class.trim()));
            if pattern.is_empty() || class.is_empty() {
                return Err(ClassTableError { line: line_number, found: format!("\"{line}\"") });
            }
            let (of_material, pattern) = match pattern.strip_prefix("material:") {
                Some(rest) => (true, rest.trim()),
                None => (false, pattern),
            };
            rules.push(Rule { line: line_number, of_material, pattern: pattern.into(), class: class.into() });
        }
        match rules.is_empty() {
            true => Err(ClassTableError { line: 1, found: "no line that says anything".into() }),
            false => Ok(ClassTable { rules }),
        }
    }

    /// Gives the objects of a scene their classes. Lines that no object matches (number and pattern) are returned.
    pub fn apply(&self, d: &mut Description) -> Vec<(usize, String)> {
        d.listed_classes.clear();
        for rule in &self.rules {
            if !d.listed_classes.contains(&rule.class) {
                d.listed_classes.push(rule.class.clone());
            }
        }
        let mut used = vec![false; self.rules.len()];
        for object in &mut d.objects {
            let material = d.materials.get(object.material as usize).map_or("", |m| m.name.as_str());
            let meant = |rule: &Rule| matches(&rule.pattern, if rule.of_material { material } else { &object.name });
            let mut class = None;
            for (rule, used) in self.rules.iter().zip(&mut used).filter(|(rule, _)| meant(rule)) {
                *used = true;
                class = class.or_else(|| Some(rule.class.clone()));
            }
            object.class = class.or(object.class.take());
        }
        let unused = self.rules.iter().zip(used).filter(|(_, used)| !used);
        unused.map(|(rule, _)| (rule.line, rule.pattern.clone())).collect()
    }
}

/// Whether a text is what a pattern says; `*` stands for any text, also none.
fn matches(pattern: &str, text: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or("");
    let Some(mut rest) = text.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = parts.collect();
    // Without an asterisk nothing may follow.
    let Some(last) = parts.pop() else { return rest.is_empty() };
    for part in parts {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;

    #[test]
    fn asterisks_stand_for_any_text() {
        for (pattern, text, meant) in [
            ("chair", "chair", true),
            ("chair", "chair.001", false),
            ("chair*", "chair", true),
            ("chair*", "chair.001", true),
            ("*chair", "armchair", true),
            ("*a*a", "banana", true),
            ("a*a", "a", false),
            ("*", "", true),
            ("b*n*x", "banana", false),
            ("Stühle*", "Stühle 2", true),
        ] {
            assert_eq!(matches(pattern, text), meant, "{pattern} {text}");
        }
    }

    #[test]
    fn the_first_line_that_fits_counts() {
        let mut d = builtin::named("still-life").unwrap();
        let (name, material) = (d.objects[0].name.clone(), d.materials[d.objects[1].material as usize].name.clone());
        let text = format!("# classes\n\n{name}, first\nmaterial:{material}, by material\n*, thing\nnobody, x\n");
        let unused = ClassTable::parse(&text).unwrap().apply(&mut d);
        assert_eq!(unused, [(6, "nobody".into())]);
        assert_eq!(d.listed_classes, ["first", "by material", "thing", "x"].map(std::sync::Arc::from));
        assert_eq!(d.objects[0].class.as_deref(), Some("first"));
        assert_eq!(d.objects[1].class.as_deref(), Some("by material"));
        assert!(d.objects.iter().all(|o| o.class.is_some()));
    }

    #[test]
    fn lines_without_a_class_are_refused() {
        for (text, line) in [("a, b\nchair\n", 2), ("chair,\n", 1), (", x\n", 1), ("# nothing\n", 1)] {
            assert_eq!(ClassTable::parse(text).unwrap_err().line, line, "{text}");
        }
    }
}

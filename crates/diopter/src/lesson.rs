//! Lessons: two lines of text and the commands that make the figures and tables of a subject.

use crate::shot::error::ShotError;
use diopter_light::names::in_words;
use serde::Deserialize;

/// A lesson as it is written (TOML).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lesson {
    /// What it is about.
    pub title: String,
    /// What is to be seen, in two lines.
    pub text: [String; 2],
    /// Files that the commands read: lenses, look-up tables. Written first, to be opened and changed.
    #[serde(default)]
    pub input: Vec<Input>,
    /// Figures, in order.
    #[serde(default)]
    pub figure: Vec<Figure>,
    /// Tables, in order.
    #[serde(default)]
    pub table: Vec<Table>,
}

/// A small text file that commands read.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Its name.
    pub file: String,
    /// What it is.
    pub caption: String,
    /// What is in it.
    pub text: String,
}

/// A picture or plot that a command writes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// Name of the file that the command writes.
    pub file: String,
    /// Below it.
    pub caption: String,
    /// The command line, without the name of the program; double quotes hold words together.
    pub command: String,
}

/// What a command prints.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Below it.
    pub caption: String,
    /// The command line, without the name of the program.
    pub command: String,
}

impl Lesson {
    /// Reads a lesson; `name` is for messages. Fails on what is no TOML, and on keys that are missing or not known.
    pub fn parse(text: &str, name: &str) -> Result<Lesson, ShotError> {
        toml::from_str(text).map_err(|e| ShotError::Syntax { path: name.into(), reason: in_words(&e.to_string()) })
    }
}

/// Words of a command line: what stands between double quotes is one.
pub fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '"' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            c if c.is_whitespace() && !quoted => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_hold_words_together() {
        assert_eq!(
            words("calc fov 50mm --format \"full frame\"  -o a.png "),
            ["calc", "fov", "50mm", "--format", "full frame", "-o", "a.png"]
        );
        assert_eq!(words("a \"\" b"), ["a", "", "b"]);
        assert!(words("  ").is_empty());
    }

    #[test]
    fn a_lesson_is_read() {
        let text = "title = \"Stops\"\ntext = [\"one\", \"two\"]\n[[table]]\ncaption = \"c\"\ncommand = \"calc formats\"\n";
        let lesson = Lesson::parse(text, "stops").unwrap();
        assert_eq!((lesson.title.as_str(), lesson.table.len(), lesson.figure.len()), ("Stops", 1, 0));
        assert!(Lesson::parse("title = \"x\"", "x").unwrap_err().to_string().contains("text"));
    }
}

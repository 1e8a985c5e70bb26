//! Names and values people type: what was probably meant, and what a parser expected in its place.

/// The known name nearest to a misspelt one, if one is near, for hints: at most one edit (Levenshtein's distance, in either case), and one more for each three letters of
/// the known name.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let distance = |a: &str, b: &str| {
        let (a, b): (Vec<char>, Vec<char>) = (a.to_lowercase().chars().collect(), b.to_lowercase().chars().collect());
        let mut row: Vec<usize> = (0..=b.len()).collect();
        for (i, ca) in a.iter().enumerate() {
            let mut diagonal = row[0];
            row[0] = i + 1;
            for (j, cb) in b.iter().enumerate() {
                let substituted = diagonal + usize::from(ca != cb);
                diagonal = row[j + 1];
                row[j + 1] = substituted.min(row[j] + 1).min(row[j + 1] + 1);
            }
        }
        row[b.len()]
    };
    known.into_iter().map(|k| (distance(name, k), k)).filter(|(d, k)| *d <= 1 + k.len() / 3).min().map(|(_, k)| k)
}

/// Types of a TOML parser, and what people write for them.
const TYPES: [(&str, &str); 15] = [
    ("f64", "a number"),
    ("f32", "a number"),
    ("u8", "a whole number, 0 or more"),
    ("u16", "a whole number, 0 or more"),
    ("u32", "a whole number, 0 or more"),
    ("u64", "a whole number, 0 or more"),
    ("usize", "a whole number, 0 or more"),
    ("i8", "a whole number"),
    ("i32", "a whole number"),
    ("i64", "a whole number"),
    ("a boolean", "true or false"),
    ("a string", "text in quotes"),
    ("a sequence", "a list in brackets"),
    ("a map", "a table"),
    ("a borrowed string", "text in quotes"),
];

/// What a TOML parser says of a value of another kind or of an unknown key, in words for who wrote the file: types ("u32") become what is to be written in their
/// place, and an unknown key or name is told the nearest one. Whatever else it says stays, trimmed at its end.
pub fn in_words(message: &str) -> String {
    let message = message.trim_end();
    let Some((before, expected)) = message.rsplit_once(", expected ") else { return message.to_owned() };
    let unknown = before.rsplit_once("unknown field `").or_else(|| before.rsplit_once("unknown variant `"));
    if let Some((_, key)) = unknown {
        // "one of `a`, `b`": what stands between every other pair of ticks.
        let known = expected.split('`').skip(1).step_by(2);
        let hint = nearest(key.trim_end_matches('`'), known).map_or(String::new(), |k| format!(" (did you mean `{k}`?)"));
        return format!("{message}{hint}");
    }
    if let Some(words) = TYPES.iter().find(|t| t.0 == expected).map(|t| t.1) {
        return format!("{before}, expected {words}");
    }
    if expected.starts_with("struct ") {
        return format!("{before}, expected a table of settings");
    }
    match expected.strip_prefix("an array of length ") {
        Some(count) => format!("{before}, expected {count} values in brackets"),
        None => message.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parsers_speak_of_numbers_and_not_of_types() {
        for (said, told) in [
            (
                "invalid type: floating point `2.5`, expected u32",
                "invalid type: floating point `2.5`, expected a whole number, 0 or more",
            ),
            ("invalid type: string \"abc\", expected f64\n", "invalid type: string \"abc\", expected a number"),
            ("invalid length 2, expected an array of length 3", "invalid length 2, expected 3 values in brackets"),
            (
                "unknown field `apperture`, expected one of `aperture`, `shutter`",
                "unknown field `apperture`, expected one of `aperture`, `shutter` (did you mean `aperture`?)",
            ),
            (
                "unknown variant `agz`, expected `agx` or `hejl`",
                "unknown variant `agz`, expected `agx` or `hejl` (did you mean `agx`?)",
            ),
            ("unknown field `zzz`, expected `aperture`", "unknown field `zzz`, expected `aperture`"),
            (
                "invalid type: string \"x.dng\", expected struct OutputSection",
                "invalid type: string \"x.dng\", expected a table of settings",
            ),
            ("duplicate key", "duplicate key"),
        ] {
            assert_eq!(in_words(said), told);
        }
    }
}

//! The parts of an error, for programs that show or sort them: where, what was found, what was expected.

use super::ShotError;
use diopter_lens::LensError;
use diopter_scene::SceneError;
use diopter_sensor::SensorError;

/// What an error says apart from its sentence; `None` where that is not known by itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ErrorParts {
    /// File (with line), setting or quantity.
    pub place: Option<String>,
    /// What is there.
    pub found: Option<String>,
    /// What belongs there.
    pub expected: Option<String>,
    /// A way out, such as the nearest name that is known.
    pub hint: Option<String>,
}

impl ErrorParts {
    /// Parts of a value that is not what was expected; a hint is taken from what was expected.
    pub fn of_value(place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        let expected = expected.into();
        let hint = hint_in(&expected);
        ErrorParts { place: Some(place.into()), found: Some(found.into()), expected: Some(expected), hint }
    }

    /// Only where.
    fn at(place: &str) -> Self {
        ErrorParts { place: Some(place.to_owned()), ..Default::default() }
    }
}

/// "did you mean ...?" of a text.
fn hint_in(text: &str) -> Option<String> {
    let from = text.find("did you mean")?;
    let to = text[from..].find('?')?;
    Some(text[from..=from + to].to_owned())
}

/// Parts of what a parser of TOML says: the line behind the file's name, and the last line of its message, which is behind a copy of the place.
fn of_syntax(path: &str, reason: &str) -> ErrorParts {
    let line = reason.split_once("at line ").and_then(|(_, rest)| rest.split(|c: char| !c.is_ascii_digit()).next());
    let place = line.map_or(path.to_owned(), |line| format!("{path}:{line}"));
    let said = reason.trim_end().lines().last().unwrap_or(reason);
    let hint = hint_in(said);
    match said.split_once(", expected ") {
        Some((found, expected)) => ErrorParts {
            found: Some(found.to_owned()),
            expected: Some(expected.split(" (did you mean").next().unwrap_or(expected).to_owned()),
            hint,
            ..ErrorParts::at(&place)
        },
        None => ErrorParts { found: Some(said.to_owned()), hint, ..ErrorParts::at(&place) },
    }
}

impl ShotError {
    /// Its parts.
    pub fn parts(&self) -> ErrorParts {
        match self {
            ShotError::Read { path, reason } => {
                ErrorParts { found: Some(reason.clone()), hint: hint_in(reason), ..ErrorParts::at(path) }
            }
            ShotError::Syntax { path, reason } => of_syntax(path, reason),
            ShotError::Value { what, found, expected } => ErrorParts::of_value(what.as_ref(), found, expected),
            ShotError::Entry { place, found, expected } => ErrorParts::of_value(place, found, expected),
            ShotError::Item { place, why } => {
                let parts = why.parts();
                let place = parts.place.map_or_else(|| place.clone(), |inner| format!("{place}: {inner}"));
                ErrorParts { place: Some(place), ..parts }
            }
            ShotError::Recipe(e) => ErrorParts::of_value(&e.place, &e.found, &e.expected),
            ShotError::Scene(SceneError::File { place, found, expected }) => {
                ErrorParts::of_value(place, found, expected.strip_prefix("expected ").unwrap_or(expected))
            }
            ShotError::Scene(SceneError::Number { what, of, found, count }) => {
                ErrorParts::of_value(of, format!("{what} {found}"), format!("a number below {count}"))
            }
            ShotError::Sensor(SensorError::Range { what, found, expected }) => ErrorParts::of_value(what, found, expected),
            ShotError::Sensor(SensorError::Unknown { what, found, hint }) => ErrorParts {
                found: Some(found.clone()),
                hint: hint_in(hint).or_else(|| Some(hint.trim_start_matches("; ").to_owned()).filter(|h| !h.is_empty())),
                ..ErrorParts::at(what)
            },
            ShotError::Sensor(SensorError::Parse { place, reason }) => {
                ErrorParts { found: Some(reason.clone()), hint: hint_in(reason), ..ErrorParts::at(place) }
            }
            ShotError::Sensor(SensorError::Bands { found, expected }) => ErrorParts::of_value("bands", found, expected),
            ShotError::Lens(LensError::Range { what, found, expected }) => ErrorParts::of_value(*what, found, *expected),
            ShotError::Lens(LensError::Setting { what, found, expected }) => ErrorParts::of_value(*what, found, expected),
            ShotError::Lens(LensError::Prescription(e)) => {
                let place = e.surface.map_or_else(|| e.place.clone(), |k| format!("{}: surface {k}", e.place));
                ErrorParts { found: Some(e.what.clone()), hint: hint_in(&e.what), ..ErrorParts::at(&place) }
            }
            _ => ErrorParts::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::shot::{ShotFile, read_body, read_lens};

    #[test]
    fn errors_tell_their_parts() {
        let parts = read_lens("tessar-50mm-f2.7").unwrap_err().parts();
        assert_eq!((parts.place.as_deref(), parts.found.as_deref()), (Some("lens"), Some("\"tessar-50mm-f2.7\"")));
        assert!(parts.hint.is_some_and(|h| h.contains("tessar-50mm-f2.8")));
        let parts = read_body("canon-5d-mark-v").err().unwrap().parts();
        assert_eq!(parts.found.as_deref(), Some("canon-5d-mark-v"));
        assert_eq!((parts.place.as_deref(), parts.hint.as_deref()), (Some("body"), Some("did you mean \"canon-5d-mark-iv\"?")));
        let parts = read_lens("nowhere.toml").unwrap_err().parts();
        assert_eq!(parts.place.as_deref(), Some("nowhere.toml"));
        // A shot file says the line, and of a misspelt key the nearest one.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("shot.toml");
        let parts = |text: &str| {
            std::fs::write(&file, text).unwrap();
            let parts = ShotFile::read(&file).unwrap_err().parts();
            (parts.place.unwrap().ends_with("shot.toml:2"), parts.found.unwrap(), parts.expected.unwrap(), parts.hint)
        };
        let (line, found, expected, hint) = parts("[exposure]\napperture = 2");
        assert!(line && expected.starts_with("one of `aperture`"), "{expected}");
        assert_eq!((found.as_str(), hint.as_deref()), ("unknown field `apperture`", Some("did you mean `aperture`?")));
        let (line, found, expected, hint) = parts("[render]\nspp = 2.5");
        assert_eq!((line, found.as_str()), (true, "invalid type: floating point `2.5`"));
        assert_eq!((expected.as_str(), hint), ("a whole number, 0 or more", None));
        assert_eq!(parts("[render]\nsize = [24, 16]").2, "a size such as \"1920x1280\"");
    }
}

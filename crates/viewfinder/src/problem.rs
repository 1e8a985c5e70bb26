//! What is wrong, as the page shows it.

use diopter::light::names::in_words;
use diopter::shot::ShotError;
use serde::Serialize;

/// What is wrong, in the words of the command line.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// The sentence.
    pub message: String,
    /// File (with line), setting or quantity.
    pub place: Option<String>,
    /// What is there.
    pub found: Option<String>,
    /// What belongs there.
    pub expected: Option<String>,
    /// A way out.
    pub hint: Option<String>,
}

impl Problem {
    /// From its parts.
    pub fn new(place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Problem {
        let (place, found, expected) = (place.into(), found.into(), expected.into());
        let message = format!("{place} {found}: expected {expected}");
        Problem { message, place: Some(place), found: Some(found), expected: Some(expected), hint: None }
    }

    /// What a parser says of what is `found`: in its own words where it tells what it met ("unknown field ..., expected ..."), else as what it expected.
    pub fn of_parser(place: impl Into<String>, found: impl Into<String>, said: &str) -> Problem {
        let (place, said) = (place.into(), in_words(said));
        let Some((met, expected)) = said.split_once(", expected ") else { return Problem::new(place, found, said) };
        let (expected, hint) = match expected.split_once(" (did you mean") {
            Some((expected, rest)) => (expected, Some(format!("did you mean{}", rest.trim_end_matches(')')))),
            None => (expected, None),
        };
        Problem {
            message: format!("{place}: {said}"),
            place: Some(place),
            found: Some(met.to_owned()),
            expected: Some(expected.to_owned()),
            hint,
        }
    }
}

impl From<ShotError> for Problem {
    fn from(e: ShotError) -> Self {
        let parts = e.parts();
        Problem { message: e.to_string(), place: parts.place, found: parts.found, expected: parts.expected, hint: parts.hint }
    }
}

//! Why a shot cannot be taken.

use crate::calibration::CalibrationError;
use crate::camera::PlacementError;
use crate::expose::error::ExposeError;
use diopter_develop::RecipeError;
use diopter_lens::LensError;
use diopter_light::units::shown;
use diopter_scene::SceneError;
use diopter_sensor::SensorError;
use std::borrow::Cow;

/// Why a photograph cannot be taken.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShotError {
    /// A file that cannot be read.
    #[error("{path}: {reason}")]
    Read {
        /// The file.
        path: String,
        /// What the system or the parser says.
        reason: String,
    },
    /// A shot file that is no shot file: its grammar, a misspelt key, a value of another kind.
    #[error("{path}: {reason}")]
    Syntax {
        /// The file.
        path: String,
        /// What the parser says, with line and hint.
        reason: String,
    },
    /// A value outside its range or a name nobody knows.
    #[error("{what} {found}: expected {expected}")]
    Value {
        /// Setting.
        what: Cow<'static, str>,
        /// Its value.
        found: String,
        /// What is allowed, or a hint.
        expected: String,
    },
    /// An entry of a file that is made of shots, such as the specification of a data set.
    #[error("{place}: {found}; expected {expected}")]
    Entry {
        /// File and entry.
        place: String,
        /// What is there.
        found: String,
        /// What belongs there, and a hint.
        expected: String,
    },
    /// One of many shots, such as an item of a data set or a camera of a rig.
    #[error("{place}: {why}")]
    Item {
        /// Which: file, number, what differs in it.
        place: String,
        /// Why it cannot be taken.
        why: Box<ShotError>,
    },
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The body.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The lens.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// The camera's place.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The development.
    #[error(transparent)]
    Recipe(RecipeError),
    /// A calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// The exposure was stopped.
    #[error(transparent)]
    Expose(#[from] ExposeError),
    /// Autofocus found nothing, and a picture out of focus is not wanted.
    #[error("autofocus failed: {0} (without --require-focus the picture is taken all the same)")]
    Focus(crate::focus::Failure),
    /// The renderer's noise cannot be reduced as asked.
    #[error("{0}")]
    Denoise(String),
}

impl ShotError {
    /// Whether the user asked for something impossible (rather than something failing on the way).
    pub fn is_request(&self) -> bool {
        if let ShotError::Item { why, .. } = self {
            return why.is_request();
        }
        let failed = matches!(self, ShotError::Read { .. } | ShotError::Expose(_) | ShotError::Scene(_) | ShotError::Focus(_));
        !failed && !matches!(self, ShotError::Denoise(_))
    }

    /// The same as an error of one of many shots. A stop stays what it is.
    pub(crate) fn of_shot(self, place: String) -> ShotError {
        match self {
            ShotError::Expose(ExposeError::Cancelled) => self,
            why => ShotError::Item { place, why: Box::new(why) },
        }
    }
}

pub(crate) fn value(what: impl Into<Cow<'static, str>>, found: impl ToString, expected: impl Into<String>) -> ShotError {
    ShotError::Value { what: what.into(), found: short_numbers(found.to_string()), expected: expected.into() }
}

/// What was asked for, without numbers of hundreds of digits: each word that is a long number, behind "f/" or "1/" too, has eight of them.
fn short_numbers(found: String) -> String {
    /// Longest number that stays: those that count have 20 digits at most, others no more than tell them apart.
    const LONGEST: [usize; 2] = [20, 12];
    // Names are in quotes.
    if found.len() <= LONGEST[1] || found.contains('"') {
        return found;
    }
    let short = |word: &str| {
        let from = ["f/", "1/"].into_iter().find(|p| word.starts_with(p)).map_or(0, str::len);
        let number = word[from..].trim_end_matches(['°', '%', ',']);
        let long = number.len() > LONGEST[usize::from(number.contains('.'))];
        match number.parse::<f64>() {
            Ok(v) if long => format!("{}{}{}", &word[..from], shown(v), &word[from + number.len()..]),
            _ => word.to_owned(),
        }
    };
    found.split(' ').map(short).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::{FNumber, Seconds};

    #[test]
    fn numbers_of_any_size_are_told_in_few_digits() {
        for (e, words) in [
            (value("shutter", Seconds(1e300), "a time"), "shutter 1e300 s: expected a time"),
            (value("shutter", Seconds(1e-300), "a time"), "shutter 1/1e300 s: expected a time"),
            (value("aperture", FNumber(1e300), "a number"), "aperture f/1e300: expected a number"),
            (value("fov", format!("{}°", -1e300), "an angle"), "fov -1e300°: expected an angle"),
            (value("scale", 0.1 + 0.2, "a factor"), "scale 0.3: expected a factor"),
            (value("seed", u64::MAX, "less"), "seed 18446744073709551615: expected less"),
            (value("scene", "\"a 0.30000000000000004\"", "a name"), "scene \"a 0.30000000000000004\": expected a name"),
        ] {
            assert_eq!(e.to_string(), words);
        }
    }
}

//! Errors as Python exceptions: `DiopterError` with place, found, expected and hint.

use diopter::develop::RecipeError;
use diopter::hdr::HdrError;
use diopter::image::ImageError;
use diopter::lens::LensError;
use diopter::scene::SceneError;
use diopter::sensor::SensorError;
use diopter::shot::{ErrorParts, ShotError};
use pyo3::prelude::*;

/// An error on its way to Python.
#[derive(Debug)]
pub struct PythonError {
    message: String,
    parts: ErrorParts,
}

impl PythonError {
    /// A value that is not what was expected.
    pub fn value(place: &str, found: impl Into<String>, expected: impl Into<String>) -> PythonError {
        let parts = ErrorParts::of_value(place, found, expected);
        let text = |part: &Option<String>| part.clone().unwrap_or_default();
        PythonError { message: format!("{place} {}: expected {}", text(&parts.found), text(&parts.expected)), parts }
    }

    /// Something that failed in a file.
    pub fn file(path: &std::path::Path, reason: impl std::fmt::Display) -> PythonError {
        let place = path.display().to_string();
        PythonError { message: format!("{place}: {reason}"), parts: ErrorParts { place: Some(place), ..Default::default() } }
    }

    /// The same error, said of a file.
    pub fn in_file(mut self, path: &std::path::Path) -> PythonError {
        self.message = format!("{}: {}", path.display(), self.message);
        self.parts.place = Some(path.display().to_string());
        self
    }
}

impl From<ShotError> for PythonError {
    fn from(e: ShotError) -> PythonError {
        PythonError { message: e.to_string(), parts: e.parts() }
    }
}

impl From<SceneError> for PythonError {
    fn from(e: SceneError) -> PythonError {
        ShotError::from(e).into()
    }
}

impl From<SensorError> for PythonError {
    fn from(e: SensorError) -> PythonError {
        ShotError::from(e).into()
    }
}

impl From<LensError> for PythonError {
    fn from(e: LensError) -> PythonError {
        ShotError::from(e).into()
    }
}

impl From<RecipeError> for PythonError {
    fn from(e: RecipeError) -> PythonError {
        ShotError::Recipe(e).into()
    }
}

impl From<HdrError> for PythonError {
    fn from(e: HdrError) -> PythonError {
        let parts = ErrorParts::of_value(format!("raw image {}", e.number), &e.found, &e.expected);
        PythonError { message: e.to_string(), parts }
    }
}

impl From<ImageError> for PythonError {
    fn from(e: ImageError) -> PythonError {
        PythonError { message: e.to_string(), parts: ErrorParts::default() }
    }
}

impl From<PythonError> for PyErr {
    fn from(told: PythonError) -> PyErr {
        Python::attach(|py| {
            let made = || {
                let class = py.import("diopter._errors")?.getattr("DiopterError")?;
                let ErrorParts { place, found, expected, hint } = told.parts;
                class.call1((told.message, place, found, expected, hint))
            };
            made().map_or_else(|e| e, PyErr::from_value)
        })
    }
}

//! Development: raw images into pictures.

use crate::arrays::{raster, to_raster};
use crate::background;
use crate::errors::PythonError;
use crate::files;
use crate::raw::RawImage;
use diopter::develop::{Developer, Recipe, SETTINGS};
use diopter::image::{self, Encoding, PictureSource, exr, jpeg, png, tiff_file};
use diopter::light::color::RgbSpace;
use diopter::memory::{self, Bytes};
use diopter::recipe_file;
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A developed picture.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Picture {
    pub picture: Arc<image::Picture>,
}

const SPACES: [(&str, RgbSpace); 4] =
    [("srgb", RgbSpace::Srgb), ("display-p3", RgbSpace::DisplayP3), ("rec2020", RgbSpace::Rec2020), ("acescg", RgbSpace::AcesCg)];
const ENCODINGS: [(&str, Encoding); 7] = [
    ("linear", Encoding::Linear),
    ("srgb", Encoding::Srgb),
    ("gamma-1.8", Encoding::Gamma18),
    ("gamma-2.2", Encoding::Gamma22),
    ("gamma-2.4", Encoding::Gamma24),
    ("pq", Encoding::Pq),
    ("hlg", Encoding::Hlg),
];

fn named<T: Copy>(what: &str, name: &str, all: &[(&str, T)]) -> Result<T, PythonError> {
    all.iter().find(|n| n.0 == name).map(|n| n.1).ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|n| n.0).collect();
        PythonError::value(what, format!("\"{name}\""), format!("one of {}", names.join(", ")))
    })
}

fn name_of<T: PartialEq>(value: &T, all: &[(&'static str, T)]) -> &'static str {
    all.iter().find(|n| n.1 == *value).map_or("", |n| n.0)
}

#[pymethods]
impl Picture {
    /// From codes `[row][column][3]`, and how it was taken, as [`Picture::facts`] gives it.
    #[new]
    #[pyo3(signature = (array, space, encoding, facts=None))]
    fn new(array: PyReadonlyArrayDyn<'_, f32>, space: &str, encoding: &str, facts: Option<&str>) -> PyResult<Picture> {
        let facts = facts.map(serde_json::from_str).transpose();
        let facts = facts.map_err(|e| PythonError::value("facts", e.to_string(), "those of a picture"))?;
        let picture = image::Picture {
            pixels: to_raster(&array, "array", 3)?,
            space: named("space", space, &SPACES)?,
            encoding: named("encoding", encoding, &ENCODINGS)?,
            facts,
        };
        Ok(Picture { picture: Arc::new(picture) })
    }

    #[getter]
    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.picture.clone(), &self.picture.pixels, false)
    }

    #[getter]
    fn space(&self) -> &'static str {
        name_of(&self.picture.space, &SPACES)
    }

    #[getter]
    fn encoding(&self) -> &'static str {
        name_of(&self.picture.encoding, &ENCODINGS)
    }

    #[getter]
    fn facts(&self) -> Option<String> {
        let facts = self.picture.facts.as_ref()?;
        Some(serde_json::to_string(facts).unwrap_or_else(|e| unreachable!("plain data becomes JSON: {e}")))
    }

    /// The bytes of a PNG of 8 or 16 bits.
    fn to_png<'py>(&self, py: Python<'py>, bits: u32) -> PyResult<Bound<'py, PyBytes>> {
        let depth = depth(bits)?;
        let bytes = background::run(py, None, None, |_| -> Result<_, PythonError> {
            let mut bytes = Vec::new();
            png::write(&*self.picture, depth, &mut bytes)?;
            Ok(bytes)
        })?;
        Ok(PyBytes::new(py, &bytes?))
    }

    fn save(&self, py: Python<'_>, path: PathBuf, quality: u8, bits: u32) -> PyResult<()> {
        if !(1..=100).contains(&quality) {
            return Err(PythonError::value("quality", quality.to_string(), "1 to 100").into());
        }
        let depth = depth(bits)?;
        let picture = &*self.picture;
        let ending = files::ending(&path);
        if !["jpg", "jpeg", "png", "tif", "tiff", "exr"].contains(&ending.as_str()) {
            let expected = "a name that ends in .jpg, .png, .tif or .exr";
            return Err(PythonError::value("path", path.display().to_string(), expected).into());
        }
        let written = background::run(py, None, None, |_| {
            files::write(&path, |to| {
                match ending.as_str() {
                    "png" => png::write(picture, depth, to)?,
                    "tif" | "tiff" => tiff_file::write(picture, to)?,
                    "exr" => exr::write_picture(picture, exr::Precision::Half, to)?,
                    _ => jpeg::write(picture, quality, to)?,
                }
                Ok(())
            })
        })?;
        Ok(written?)
    }
}

fn depth(bits: u32) -> Result<png::Depth, PythonError> {
    match bits {
        8 => Ok(png::Depth::Eight),
        16 => Ok(png::Depth::Sixteen),
        other => Err(PythonError::value("bits", other.to_string(), "8 or 16")),
    }
}

/// A recipe from its preset or file and settings by name.
pub fn recipe(preset: Option<&str>, file: Option<PathBuf>, settings: &[(String, String)]) -> Result<Recipe, PythonError> {
    let start = match (preset, file) {
        (Some(_), Some(_)) => return Err(PythonError::value("preset", "a preset and a recipe file", "one of the two")),
        (Some(name), None) => Recipe::preset(name)?,
        (None, Some(path)) => recipe_file::read(&path)?,
        (None, None) => Recipe::default(),
    };
    settings.iter().try_fold(start, |recipe, (name, value)| Ok(recipe.with(name, value)?))
}

/// Develops a raw image. `settings`: names such as `tone.curve` and their values as text.
#[pyfunction]
#[pyo3(signature = (raw, preset=None, recipe_file=None, settings=Vec::new(), threads=None))]
pub fn develop(
    py: Python<'_>,
    raw: &Bound<'_, RawImage>,
    preset: Option<&str>,
    recipe_file: Option<PathBuf>,
    settings: Vec<(String, String)>,
    threads: Option<usize>,
) -> PyResult<Picture> {
    let recipe = recipe(preset, recipe_file, &settings)?;
    let lut = diopter::recipe_file::lut(&recipe).map_err(PythonError::from)?;
    let raw = raw.get().raw.clone();
    let picture = background::run(py, threads, None, |_| -> Result<_, PythonError> {
        let developer = Developer::new(&raw, &recipe, lut)?;
        let [width, height] = developer.size();
        let needed = width as u64 * height as u64 * 3 * size_of::<f32>() as u64;
        if let Some(free) = memory::available(None).filter(|free| needed > *free) {
            let found = format!("a picture of {width}x{height} takes {}; {} are free", Bytes(needed), Bytes(free));
            return Err(PythonError::value("resize", found, "a smaller picture"));
        }
        Ok(developer.whole())
    })?;
    Ok(Picture { picture: Arc::new(picture?) })
}

/// (name, unit, what is allowed, default, why) of every setting of the development.
#[pyfunction]
pub fn recipe_settings() -> Vec<(&'static str, &'static str, String, String, &'static str)> {
    let default = Recipe::default();
    SETTINGS.iter().map(|s| (s.name, s.unit, s.allowed.to_string(), default.value(s.name), s.why)).collect()
}

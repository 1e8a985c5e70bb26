//! The native part of the Python package `diopter`: what holds values (scene, lens, body, focal plane, raw image, picture) and the functions from one to
//! the next.
//!
//! Thin: arrays and settings come in, the crate `diopter` works, arrays go out. Settings are those of a shot file, as JSON; units, defaults, names and
//! documentation of the arguments are in `python/diopter`, which is what users import. Long work runs beside the interpreter ([`background`]).
//!
//! Begin with `shot.rs` (a shot, its exposure, its raw image) and `lens.rs`. Not here: anything that `diopter` could do for the command line, too.

mod arrays;
mod background;
mod body;
mod dataset;
mod errors;
mod files;
mod lens;
mod picture;
mod plane;
mod raw;
mod scene;
mod shot;

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the program `diopter`; `arguments` come without the name of the program. Returns the exit code.
#[pyfunction]
fn run(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| diopter_cli::run(std::iter::once(OsString::from("diopter")).chain(arguments)))
}

#[pymodule]
fn _diopter(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_function(wrap_pyfunction!(run, m)?)?;
    m.add_function(wrap_pyfunction!(background::set_threads, m)?)?;
    m.add_class::<arrays::Memory>()?;
    m.add_class::<scene::Scene>()?;
    m.add_class::<lens::Lens>()?;
    m.add_class::<lens::Bench>()?;
    m.add_class::<body::Body>()?;
    m.add_class::<plane::FocalPlane>()?;
    m.add_class::<raw::RawImage>()?;
    m.add_class::<picture::Picture>()?;
    m.add_class::<dataset::Dataset>()?;
    m.add_class::<dataset::DatasetFolder>()?;
    m.add_function(wrap_pyfunction!(dataset::specification, m)?)?;
    m.add_function(wrap_pyfunction!(scene::scene_names, m)?)?;
    m.add_function(wrap_pyfunction!(lens::lens_names, m)?)?;
    m.add_function(wrap_pyfunction!(lens::zernike_fit, m)?)?;
    m.add_function(wrap_pyfunction!(body::body_names, m)?)?;
    m.add_function(wrap_pyfunction!(shot::expose, m)?)?;
    m.add_function(wrap_pyfunction!(shot::shoot, m)?)?;
    m.add_function(wrap_pyfunction!(shot::meter, m)?)?;
    m.add_function(wrap_pyfunction!(plane::merge, m)?)?;
    m.add_function(wrap_pyfunction!(plane::from_light, m)?)?;
    m.add_function(wrap_pyfunction!(raw::read_out, m)?)?;
    m.add_function(wrap_pyfunction!(raw::expected, m)?)?;
    m.add_function(wrap_pyfunction!(raw::merge_raws, m)?)?;
    m.add_function(wrap_pyfunction!(picture::develop, m)?)?;
    m.add_function(wrap_pyfunction!(picture::recipe_settings, m)?)?;
    Ok(())
}

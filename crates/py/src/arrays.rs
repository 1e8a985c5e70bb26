//! Arrays: ours as numpy arrays without a copy, theirs as slices.

use crate::errors::PythonError;
use diopter::image::Raster;
use numpy::{Element, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::any::Any;
use std::sync::Arc;

/// Memory of ours as numpy's array interface describes it (version 3), read-only: `numpy.asarray` makes an array of it without a copy, which keeps it
/// alive.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Memory {
    /// Owner of the memory, which neither moves nor changes it.
    #[expect(dead_code, reason = "it is held, not read")]
    owner: Arc<dyn Any + Send + Sync>,
    address: usize,
    shape: Vec<usize>,
    kind: &'static str,
}

#[pymethods]
impl Memory {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("version", 3)?;
        dict.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        dict.set_item("typestr", self.kind)?;
        dict.set_item("data", (self.address, true))?;
        Ok(dict)
    }
}

/// Numbers as numpy knows them.
pub trait Number {
    /// Their code in the array interface.
    const KIND: &'static str;
}

impl Number for f32 {
    const KIND: &'static str = if cfg!(target_endian = "little") { "<f4" } else { ">f4" };
}

impl Number for u32 {
    const KIND: &'static str = if cfg!(target_endian = "little") { "<u4" } else { ">u4" };
}

impl Number for u16 {
    const KIND: &'static str = if cfg!(target_endian = "little") { "<u2" } else { ">u2" };
}

/// A numpy array over numbers that `owner` holds; `shape` must be theirs.
pub fn view<'py, T: Number>(
    py: Python<'py>,
    owner: Arc<dyn Any + Send + Sync>,
    data: &[T],
    shape: Vec<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    assert_eq!(data.len(), shape.iter().product::<usize>(), "shape {shape:?}");
    let memory = Memory { owner, address: data.as_ptr() as usize, shape, kind: T::KIND };
    py.import("numpy")?.call_method1("asarray", (memory,))
}

/// The same of a raster: `[row][column]` or `[row][column][channel]`.
pub fn raster<'py, T: Number>(
    py: Python<'py>,
    owner: Arc<dyn Any + Send + Sync>,
    raster: &Raster<T>,
    flat: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let mut shape = vec![raster.height, raster.width];
    if !flat {
        shape.push(raster.channels);
    }
    view(py, owner, &raster.data, shape)
}

/// Numbers of an array whose shape must be `wanted`; 0 stands for any length. Returns the shape, too.
pub fn slice<'a, T: Element>(
    array: &'a PyReadonlyArrayDyn<'_, T>,
    name: &str,
    wanted: &[usize],
) -> Result<(&'a [T], Vec<usize>), PythonError> {
    let shape = array.shape().to_vec();
    let fits = shape.len() == wanted.len() && shape.iter().zip(wanted).all(|(s, w)| *w == 0 || s == w);
    if !fits {
        let text: Vec<String> = wanted.iter().map(|n| if *n == 0 { "any".into() } else { n.to_string() }).collect();
        return Err(PythonError::value(name, format!("of shape {shape:?}"), format!("shape [{}]", text.join(", "))));
    }
    let data = array
        .as_slice()
        .map_err(|_| PythonError::value(name, "not contiguous", "a C-contiguous array (numpy.ascontiguousarray)"))?;
    Ok((data, shape))
}

/// A raster with the numbers of an array `[row][column][channel]`.
pub fn to_raster(array: &PyReadonlyArrayDyn<'_, f32>, name: &str, channels: usize) -> Result<Raster<f32>, PythonError> {
    let (data, shape) = slice(array, name, &[0, 0, channels])?;
    if data.is_empty() {
        return Err(PythonError::value(name, format!("of shape {shape:?}"), "at least one pixel"));
    }
    Ok(Raster { width: shape[1], height: shape[0], channels: shape[2], data: data.to_vec() })
}

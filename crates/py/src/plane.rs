//! Focal planes.

use crate::arrays::{raster, slice, to_raster, view};
use crate::background;
use crate::body::Body;
use crate::errors::PythonError;
use crate::files;
use diopter::develop::denoise;
use diopter::files::open;
use diopter::from_light::{Channels, Place, focal_plane, of_plane};
use diopter::image::focal_plane::BandUnit;
use diopter::image::truth::Values;
use diopter::image::{self, exr};
use diopter::sensor::Sensor;
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::io::{Cursor, Write};
use std::path::PathBuf;
use std::sync::Arc;

/// An exposure before any sensor noise.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct FocalPlane {
    pub plane: Arc<image::FocalPlane>,
    /// The body it was exposed with, where that is in memory.
    pub sensor: Option<Arc<Sensor>>,
}

impl FocalPlane {
    /// The bytes of its file: the same plane is the same bytes.
    fn file(&self) -> Result<Vec<u8>, PythonError> {
        let mut to = Cursor::new(Vec::new());
        exr::write_focal_plane(&self.plane, &mut to)?;
        let mut bytes = to.into_inner();
        exr::sort_attributes(&mut bytes)?;
        Ok(bytes)
    }
}

#[pymethods]
impl FocalPlane {
    #[getter]
    fn size(&self) -> [usize; 2] {
        [self.plane.width(), self.plane.height()]
    }

    #[getter]
    fn bands(&self) -> Vec<(String, &'static str)> {
        let unit = |unit: BandUnit| match unit {
            BandUnit::Electrons => "electrons",
            BandUnit::Radiance => "radiance",
        };
        self.plane.bands.iter().map(|b| (b.name.clone(), unit(b.unit))).collect()
    }

    #[getter]
    fn facts(&self) -> String {
        serde_json::to_string(&self.plane.facts).unwrap_or_else(|e| unreachable!("plain data becomes JSON: {e}"))
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), &self.plane.mean, false)
    }

    #[getter]
    fn half_difference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), &self.plane.half_difference, false)
    }

    fn variance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let variance = Arc::new(self.plane.variance());
        raster(py, variance.clone(), &variance, false)
    }

    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), self.plane.truth.depth(), true)
    }

    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), self.plane.truth.normal(), false)
    }

    #[getter]
    fn albedo<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), self.plane.truth.albedo(), false)
    }

    #[getter]
    fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        raster(py, self.plane.clone(), self.plane.truth.id(), true)
    }

    /// Name, unit, how samples merge and meaning of each truth channel.
    #[getter]
    fn truth_channels(&self) -> Vec<(&'static str, &'static str, &'static str, &'static str)> {
        let channels = self.plane.truth.recorded().channels();
        channels.iter().map(|c| (c.name, c.unit, c.merge.name(), c.about)).collect()
    }

    /// The values of a truth channel; None where it was not recorded.
    fn truth<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let values = self.plane.truth.values(name);
        let array = |values: &Values| match values {
            Values::Float(values) => raster(py, self.plane.clone(), values, values.channels == 1),
            Values::Whole(values) => raster(py, self.plane.clone(), values, values.channels == 1),
        };
        values.map(array).transpose()
    }

    /// Names of the scene's objects by number, where truth beyond what is always recorded was asked for.
    #[getter]
    fn object_names(&self) -> Vec<String> {
        self.plane.truth.recorded().objects.to_vec()
    }

    /// Names of the classes of its objects by number, where the truth channel "class" or "crypto-class" was asked for.
    #[getter]
    fn class_names(&self) -> Vec<String> {
        self.plane.truth.recorded().classes.to_vec()
    }

    /// With the renderer's noise reduced.
    #[pyo3(signature = (threads=None))]
    fn denoised(&self, py: Python<'_>, threads: Option<usize>) -> PyResult<FocalPlane> {
        let plane = background::run(py, threads, None, |_| denoise(&self.plane))?;
        Ok(FocalPlane { plane: Arc::new(plane), sensor: self.sensor.clone() })
    }

    /// A plane in radiance on a sensor, with its own lens and time unless others are given.
    #[pyo3(signature = (body, exposure_s=None, t_number=None, threads=None))]
    fn on_sensor(
        &self,
        py: Python<'_>,
        body: &Bound<'_, Body>,
        exposure_s: Option<f64>,
        t_number: Option<f64>,
        threads: Option<usize>,
    ) -> PyResult<FocalPlane> {
        let sensor = body.get().sensor.clone();
        let plane = background::run(py, threads, None, |_| of_plane(&self.plane, &sensor, exposure_s, t_number))?;
        Ok(FocalPlane { plane: Arc::new(plane.map_err(PythonError::from)?), sensor: Some(sensor) })
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        if files::ending(&path) != "exr" {
            return Err(PythonError::value("path", path.display().to_string(), "a name that ends in .exr").into());
        }
        let written = background::run(py, None, None, |_| -> Result<_, PythonError> {
            let bytes = self.file()?;
            files::write(&path, |to| to.write_all(&bytes).map_err(|e| PythonError::file(&path, e)))
        })?;
        Ok(written?)
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<FocalPlane> {
        let read = background::run(py, None, None, |_| -> Result<_, PythonError> {
            let file = open(&path).map_err(|e| PythonError::file(&path, e))?;
            exr::read_focal_plane(file).map_err(|e| PythonError::from(e).in_file(&path))
        })?;
        Ok(FocalPlane { plane: Arc::new(read?), sensor: None })
    }

    /// The bytes of its file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = background::run(py, None, None, |_| self.file())?;
        Ok(PyBytes::new(py, &bytes?))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<FocalPlane> {
        let read = background::run(py, None, None, |_| exr::read_focal_plane(Cursor::new(bytes)))?;
        Ok(FocalPlane { plane: Arc::new(read.map_err(PythonError::from)?), sensor: None })
    }

    /// The mean scaled to 0..1 by its 99th percentile and encoded as sRGB, `[row][column][3]`: to look at.
    fn preview<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mean = &self.plane.mean;
        let bands = mean.channels;
        // Red, green and blue where there are three, one for all else.
        let pick = |c: usize| if bands >= 3 { c } else { 0 };
        let mut sorted: Vec<f32> = mean.data.iter().copied().filter(|v| v.is_finite()).collect();
        let place = sorted.len() * 99 / 100;
        let white = match place < sorted.len() {
            true => *sorted.select_nth_unstable_by(place, f32::total_cmp).1,
            false => 1.0,
        };
        let code = |v: f32| diopter::light::color::srgb_encode((v / white.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0));
        let picture: Vec<f32> = mean.data.chunks_exact(bands).flat_map(|p| [0, 1, 2].map(|c| code(p[pick(c)]))).collect();
        let picture = Arc::new(picture);
        view(py, picture.clone(), &picture[..], vec![mean.height, mean.width, 3])
    }
}

/// Joins parts of an exposure that hold different samples.
#[pyfunction]
pub fn merge(py: Python<'_>, parts: Vec<Py<FocalPlane>>) -> PyResult<FocalPlane> {
    let sensor = parts.first().and_then(|p| p.get().sensor.clone());
    let planes: Vec<image::FocalPlane> = parts.iter().map(|p| (*p.get().plane).clone()).collect();
    let whole = py.detach(|| image::FocalPlane::merge(&planes)).map_err(PythonError::from)?;
    Ok(FocalPlane { plane: Arc::new(whole), sensor })
}

/// A picture of light from elsewhere on a sensor. `t_number`: of the lens before it; None where the light is that on the sensor. `wavelengths`: of the
/// channels, nm; None of linear sRGB.
#[pyfunction]
#[pyo3(signature = (light, body, exposure_s, t_number=None, wavelengths=None, depth=None, threads=None))]
pub fn from_light(
    py: Python<'_>,
    light: PyReadonlyArrayDyn<'_, f32>,
    body: &Bound<'_, Body>,
    exposure_s: f64,
    t_number: Option<f64>,
    wavelengths: Option<Vec<f64>>,
    depth: Option<PyReadonlyArrayDyn<'_, f32>>,
    threads: Option<usize>,
) -> PyResult<FocalPlane> {
    let light = to_raster(&light, "light", 0)?;
    let depth = depth.as_ref().map(|d| slice(d, "depth", &[light.height, light.width])).transpose()?;
    let depth = depth.map(|d| d.0);
    let channels = wavelengths.map_or(Channels::LinearSrgb, Channels::Spectral);
    let place = t_number.map_or(Place::Sensor, |t_number| Place::Scene { t_number });
    let sensor = body.get().sensor.clone();
    let plane = background::run(py, threads, None, |_| focal_plane(&light, &channels, place, depth, &sensor, exposure_s))?;
    Ok(FocalPlane { plane: Arc::new(plane.map_err(PythonError::from)?), sensor: Some(sensor) })
}

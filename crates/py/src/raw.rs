//! Read-outs: focal planes into raw images.

use crate::arrays::view;
use crate::background;
use crate::body::Body;
use crate::errors::PythonError;
use crate::files;
use crate::plane::FocalPlane;
use diopter::develop::Recipe;
use diopter::files::open;
use diopter::image;
use diopter::image::dng::{self, Storage};
use diopter::sensor::{AskedReading, ReadOut, Sensor, SensorError, Window};
use diopter::shot::white_point;
use diopter::{hdr, raw_file};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::prelude::*;
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;

/// Digital numbers behind a colour filter array.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct RawImage {
    pub raw: Arc<image::RawImage>,
}

fn storage(name: &str) -> Result<Storage, PythonError> {
    match name {
        "16" => Ok(Storage::Sixteen),
        "packed" => Ok(Storage::Packed),
        "lossless" => Ok(Storage::Lossless),
        other => Err(PythonError::value("storage", format!("\"{other}\""), "16, packed or lossless")),
    }
}

#[pymethods]
impl RawImage {
    /// Columns, rows.
    #[getter]
    fn size(&self) -> [usize; 2] {
        self.raw.size()
    }

    #[getter]
    fn mosaic<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mosaic = &self.raw.mosaic;
        let a_pixel = self.raw.header.cfa.samples_per_pixel();
        let shape = match a_pixel {
            1 => vec![mosaic.height, mosaic.width],
            n => vec![mosaic.height, mosaic.width / n, n],
        };
        view(py, self.raw.clone(), &mosaic.data, shape)
    }

    #[getter]
    fn facts(&self) -> String {
        serde_json::to_string(&self.raw.header.facts).unwrap_or_else(|e| unreachable!("plain data becomes JSON: {e}"))
    }

    #[getter]
    fn black_level(&self) -> f64 {
        self.raw.header.black_level
    }

    #[getter]
    fn white_level(&self) -> f64 {
        self.raw.header.white_level
    }

    #[getter]
    fn bits(&self) -> u32 {
        self.raw.header.bits
    }

    #[getter]
    fn cfa(&self) -> String {
        self.raw.header.cfa.letters()
    }

    /// Numbers of the channel of each pixel of the filter pattern, `[row][column]`.
    #[getter]
    fn pattern(&self) -> Vec<Vec<usize>> {
        let cfa = &self.raw.header.cfa;
        (0..cfa.rows()).map(|row| (0..cfa.columns()).map(|column| cfa.channel_at(column, row)).collect()).collect()
    }

    #[getter]
    fn channels(&self) -> Vec<&'static str> {
        self.raw.header.cfa.channel_names()
    }

    #[getter]
    fn as_shot_neutral(&self) -> Vec<f64> {
        self.raw.header.as_shot_neutral.clone()
    }

    /// (S, O) of each channel: the noise profile of DNG.
    #[getter]
    fn noise_profile(&self) -> Vec<[f64; 2]> {
        self.raw.header.noise.clone()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.raw.header.warnings.clone()
    }

    fn save(&self, py: Python<'_>, path: PathBuf, storage: &str) -> PyResult<()> {
        if files::ending(&path) != "dng" {
            return Err(PythonError::value("path", path.display().to_string(), "a name that ends in .dng").into());
        }
        let storage = self::storage(storage)?;
        let written = background::run(py, None, None, |_| {
            files::write(&path, |to| Ok(raw_file::write_image(&self.raw, storage, &Recipe::default(), to)?))
        })?;
        Ok(written?)
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<RawImage> {
        let read = background::run(py, None, None, |_| -> Result<_, PythonError> {
            let file = open(&path).map_err(|e| PythonError::file(&path, e))?;
            dng::read(file).map_err(|e| PythonError::from(e).in_file(&path))
        })?;
        Ok(RawImage { raw: Arc::new(read?) })
    }

    /// The bytes of its file, without a preview.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = background::run(py, None, None, |_| -> Result<_, PythonError> {
            let mut to = Cursor::new(Vec::new());
            dng::write_image(&self.raw, Storage::Lossless, None, &mut to)?;
            Ok(to.into_inner())
        })?;
        Ok(PyBytes::new(py, &bytes?))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<RawImage> {
        let read = background::run(py, None, None, |_| dng::read(Cursor::new(bytes)))?;
        Ok(RawImage { raw: Arc::new(read.map_err(PythonError::from)?) })
    }
}

/// The body that reads a plane: the one given, or the one it was exposed with; and whether it is the latter.
fn body_of(plane: &FocalPlane, body: Option<&Bound<'_, Body>>) -> Result<(Arc<Sensor>, bool), PythonError> {
    if let Some(body) = body {
        return Ok((body.get().sensor.clone(), false));
    }
    if let Some(sensor) = &plane.sensor {
        return Ok((sensor.clone(), true));
    }
    let name = &plane.plane.facts.body;
    let named = Sensor::names().filter_map(|n| Sensor::named(n).ok()).find(|s| s.name == *name);
    let named = named.ok_or_else(|| {
        PythonError::value(
            "body",
            format!("\"{name}\", with which the plane was exposed and which is not embedded"),
            "a body to read it with",
        )
    })?;
    Ok((Arc::new(named), true))
}

/// Reads a plane out.
#[pyfunction]
#[pyo3(signature = (plane, body=None, iso=None, seed=1, serial=None, temperature_c=None, white=None, color_sampling=None, threads=None))]
pub fn read_out(
    py: Python<'_>,
    plane: &Bound<'_, FocalPlane>,
    body: Option<&Bound<'_, Body>>,
    iso: Option<f64>,
    seed: u64,
    serial: Option<String>,
    temperature_c: Option<f64>,
    white: Option<String>,
    color_sampling: Option<&str>,
    threads: Option<usize>,
) -> PyResult<RawImage> {
    let plane = plane.get();
    let color_sampling = color_sampling
        .map(|text| {
            text.parse().map_err(|_| PythonError::value("color_sampling", format!("\"{text}\""), "\"mosaic\" or \"full\""))
        })
        .transpose()?;
    let (sensor, own) = body_of(plane, body)?;
    // What the camera was set to, if it is this body that reads.
    let set = Some(&plane.plane.facts).filter(|_| own);
    let reading = AskedReading { iso, serial, temperature_c, white, color_sampling }.reading(&sensor, set, seed);
    let white = white_point(&reading.white).map_err(PythonError::from)?;
    let raw = background::run(py, threads, None, |_| diopter::sensor::read_out(&plane.plane, &sensor, &reading, &white))?;
    Ok(RawImage { raw: Arc::new(raw.map_err(PythonError::from)?) })
}

/// What a read-out is expected to give: DN without noise of time, variance (e⁻²), whether a pixel is full.
type Expected<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>);

/// The truth beside a read-out.
#[pyfunction]
#[pyo3(signature = (plane, body=None, iso=None, serial=None, temperature_c=None, threads=None))]
pub fn expected<'py>(
    py: Python<'py>,
    plane: &Bound<'py, FocalPlane>,
    body: Option<&Bound<'py, Body>>,
    iso: Option<f64>,
    serial: Option<String>,
    temperature_c: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Expected<'py>> {
    let plane = plane.get();
    let (sensor, own) = body_of(plane, body)?;
    let set = Some(&plane.plane.facts).filter(|_| own);
    let reading = AskedReading { iso, serial, temperature_c, ..Default::default() }.reading(&sensor, set, 1);
    let (exposed, size) = (&plane.plane, [plane.plane.width(), plane.plane.height()]);
    let rows = background::run(py, threads, None, |_| -> Result<_, SensorError> {
        let reader =
            ReadOut::new(&sensor, &reading, size, &exposed.bands, exposed.facts.exposure_s)?.with_rows_of(&exposed.facts);
        let window = Window { first: 0, data: &exposed.mean.data };
        Ok((0..size[1]).into_par_iter().map(|row| reader.expected(&window, row)).collect::<Vec<_>>())
    })?;
    let rows = rows.map_err(PythonError::from)?;
    let all = || rows.iter().flatten();
    let width = all().count().checked_div(size[1]).unwrap_or(0);
    let shape = [size[1], width];
    Ok((
        PyArray1::from_vec(py, all().map(|e| e.dn).collect()).reshape(shape)?,
        PyArray1::from_vec(py, all().map(|e| e.variance).collect()).reshape(shape)?,
        PyArray1::from_vec(py, all().map(|e| e.clipped).collect()).reshape(shape)?,
    ))
}

/// An exposure series into one raw image of more range.
#[pyfunction]
pub fn merge_raws(py: Python<'_>, raws: Vec<Py<RawImage>>) -> PyResult<RawImage> {
    let raws: Vec<image::RawImage> = raws.iter().map(|r| (*r.get().raw).clone()).collect();
    let merged = background::run(py, None, None, |_| hdr::merge(&raws))?;
    Ok(RawImage { raw: Arc::new(merged.map_err(PythonError::from)?) })
}

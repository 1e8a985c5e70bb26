//! Lenses, and the bench: rays in, rays out, as arrays.

use crate::arrays::slice;
use crate::background;
use crate::errors::PythonError;
use diopter::lens::analysis::zernike::{self, Numbering};
use diopter::lens::analysis::{Bench as Analysis, Mtf};
use diopter::lens::batch::{double, single};
use diopter::lens::compound::{Configured, FilmPlace, configure};
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::prescription::WAVELENGTHS_NM;
use diopter::lens::ray::TraceDirection;
use diopter::lens::{Focus, LensError, Prescription, embedded_names, import};
use diopter::shot::read_lens;
use glam::DVec2;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::sync::atomic::Ordering;

/// Frequencies of a modulation transfer function that are computed before it is asked whether to go on.
const FREQUENCIES_AT_ONCE: usize = 64;

/// Points, their centroid, and three sizes, as the stub names them.
type Spot<'py> = (Bound<'py, PyArray2<f64>>, [f64; 2], f64, f64, f64);
/// Sagittal and tangential contrast, and whether geometry stood in for diffraction.
type Contrasts<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, bool);

/// The image of a point, rows from the top; its pixel, the chief ray's place and the centroid from there (mm); Strehl ratio, whether geometry stood in for
/// diffraction, and the light within circles.
type PointImage<'py> = (Bound<'py, PyArray2<f64>>, f64, [f64; 2], [f64; 2], Option<f64>, bool, Bound<'py, PyArray1<f64>>);
/// Map (waves, rows from the top), places in the pupil `[ray][2]`, path differences (waves); peak to valley, root mean square, the same without tilt.
type PathDifferences<'py> =
    (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, f64, f64, Option<f64>);
/// Coefficients, root mean square of what they leave, and degree, frequency and name of each term.
type Zernikes<'py> = (Bound<'py, PyArray1<f64>>, f64, Vec<(u32, i32, &'static str)>);

/// A lens with surfaces, as published.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Lens {
    pub prescription: Prescription,
}

/// Names of the embedded lenses.
#[pyfunction]
pub fn lens_names() -> Vec<&'static str> {
    embedded_names().collect()
}

#[pymethods]
impl Lens {
    /// By name or from a file.
    #[staticmethod]
    fn read(name: PathBuf) -> PyResult<Lens> {
        Ok(Lens { prescription: read_lens(&name.to_string_lossy()).map_err(PythonError::from)? })
    }

    /// From the text of a lens file; its name says the format by its ending.
    #[staticmethod]
    fn parse(text: &str, file: &str) -> PyResult<Lens> {
        let format = import::Format::of(file).ok_or_else(|| {
            PythonError::value("lens", format!("\"{file}\""), format!("a name that ends in {}", import::Format::ENDINGS))
        })?;
        let read = import::read(text.as_bytes(), format, file).map_err(LensError::from);
        Ok(Lens { prescription: read.map_err(PythonError::from)? })
    }

    fn to_toml(&self) -> String {
        self.prescription.to_toml()
    }

    #[getter]
    fn name(&self) -> String {
        self.prescription.name.clone()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.prescription.notes.clone()
    }

    #[getter]
    fn source(&self) -> String {
        self.prescription.source.clone()
    }

    #[getter]
    fn f_number(&self) -> Option<f64> {
        self.prescription.f_number
    }

    #[getter]
    fn image_circle_mm(&self) -> Option<f64> {
        self.prescription.image_circle
    }

    #[getter]
    fn surfaces(&self) -> usize {
        self.prescription.surfaces.len()
    }

    /// Sets the lens for the bench. `focus_m`: None as published, infinity or a distance from the entrance pupil.
    #[pyo3(signature = (focal_length_mm=None, f_number=None, focus_m=None))]
    fn bench(&self, focal_length_mm: Option<f64>, f_number: Option<f64>, focus_m: Option<f64>) -> PyResult<Bench> {
        if let Some(m) = focus_m.filter(|m| !(*m > 0.0)) {
            return Err(PythonError::value("focus", format!("{m} m"), "a distance above 0, or infinity").into());
        }
        let focus = focus_m.map(|m| Focus::at_mm(1000.0 * m));
        let film = focus.map_or(FilmPlace::AsPublished, FilmPlace::Focused);
        let set = configure(&self.prescription, focal_length_mm, f_number, None, film).map_err(PythonError::from)?;
        let object_distance = match focus {
            Some(Focus::Distance(mm)) => {
                Some(mm.0 - FirstOrder::of(&set.system, &set.system.reference_indices()).entrance_pupil_z)
            }
            Some(_) => None,
            None => self.prescription.usage.object_distance,
        };
        Ok(Bench { set, object_distance, single: OnceLock::new(), double: OnceLock::new() })
    }
}

/// A lens with zoom, aperture and focus set.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Bench {
    set: Configured,
    /// From the object to the first vertex, mm; infinite without.
    object_distance: Option<f64>,
    /// Made at the first trace.
    single: OnceLock<single::Batch>,
    double: OnceLock<double::Batch>,
}

impl Bench {
    fn analysis(&self) -> Analysis<'_> {
        Analysis { system: &self.set.system, object_distance: self.object_distance }
    }

    /// Fails unless every glass of the lens has an index at the wavelength.
    fn check_nm(&self, nm: f64) -> Result<(), PythonError> {
        let (least, most) = WAVELENGTHS_NM.into_inner();
        if !WAVELENGTHS_NM.contains(&nm) {
            return Err(PythonError::value("wavelength", format!("{nm} nm"), format!("{least} to {most} nm")));
        }
        match self.set.system.indices(nm).iter().all(|n| n.is_finite() && *n > 0.0) {
            true => Ok(()),
            false => {
                Err(PythonError::value("wavelength", format!("{nm} nm"), "one at which all glasses of this lens have an index"))
            }
        }
    }
}

fn check_field(field_deg: f64) -> Result<(), PythonError> {
    match field_deg.abs() <= 120.0 {
        true => Ok(()),
        false => Err(PythonError::value("field", format!("{field_deg}°"), "an angle within 120 degrees")),
    }
}

fn no_light(field_deg: f64) -> PythonError {
    PythonError::value("field", format!("{field_deg}°"), "a field from which light reaches the film")
}

/// Rays that were traced: positions and directions `[ray][3]`, which came through, optical paths (mm) and fractions of the light.
type Rays<'py, T> = (
    Bound<'py, PyArray2<T>>,
    Bound<'py, PyArray2<T>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<T>>,
    Bound<'py, PyArray1<T>>,
);

macro_rules! tracer {
    ($name:ident, $module:ident, $float:ident) => {
        /// Follows rays through a lens; those that are lost are NaN. `film_z`: to follow them to this plane, mm.
        fn $name<'py>(
            py: Python<'py>,
            bench: &Bench,
            batch: &$module::Batch,
            positions: &PyReadonlyArrayDyn<'py, $float>,
            directions: &PyReadonlyArrayDyn<'py, $float>,
            wavelengths: &PyReadonlyArrayDyn<'py, $float>,
            way: TraceDirection,
            film_z: Option<$float>,
            light: bool,
            threads: Option<usize>,
        ) -> PyResult<Rays<'py, $float>> {
            let (from, shape) = slice(positions, "positions", &[0, 3])?;
            let count = shape[0];
            let (to, _) = slice(directions, "directions", &[count, 3])?;
            let (nm, shape) = slice(wavelengths, "wavelengths", &[0])?;
            if shape[0] != 1 && shape[0] != count {
                let found = format!("{} values for {count} rays", shape[0]);
                return Err(PythonError::value("wavelengths", found, "one for all, or one a ray").into());
            }
            // Every glass has an index there.
            const SURE_NM: std::ops::RangeInclusive<$float> = 300.0..=2500.0;
            nm.iter().filter(|nm| !SURE_NM.contains(*nm)).try_for_each(|nm| bench.check_nm(f64::from(*nm)))?;
            const LANES: usize = $module::LANES;
            /// Rays of a task: some hundred microseconds of work.
            const TASK: usize = 256 * LANES;
            let traced = background::run(py, threads, None, |_| {
                let (mut out_from, mut out_to) = (vec![0.0; 3 * count], vec![0.0; 3 * count]);
                let (mut passed, mut path, mut fraction) = (vec![false; count], vec![0.0; count], vec![0.0; count]);
                let of_one = |nm: $float| {
                    let mut indices = $module::Indices::default();
                    batch.indices(&[nm; LANES], &mut indices);
                    indices
                };
                let common = (nm.len() == 1).then(|| of_one(nm[0]));
                let inputs = from.par_chunks(3 * TASK).zip(to.par_chunks(3 * TASK));
                let vectors = out_from.par_chunks_mut(3 * TASK).zip(out_to.par_chunks_mut(3 * TASK));
                let numbers = passed.par_chunks_mut(TASK).zip(path.par_chunks_mut(TASK)).zip(fraction.par_chunks_mut(TASK));
                inputs.zip(vectors).zip(numbers).enumerate().for_each(|(task, ((ins, outs), ((passed, path), fraction)))| {
                    let ((from, to), (out_from, out_to)) = (ins, outs);
                    let mut own = $module::Indices::default();
                    let mut packet = $module::Packet::default();
                    let rays = passed.len();
                    for first in (0..rays).step_by(LANES) {
                        let lanes = LANES.min(rays - first);
                        for i in 0..lanes {
                            let at = 3 * (first + i);
                            let d = [to[at], to[at + 1], to[at + 2]];
                            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
                            packet.set(i, [from[at], from[at + 1], from[at + 2]], d.map(|v| v / length));
                        }
                        // Lanes without a ray repeat the first: numbers that the trace can work with.
                        let (position, towards) =
                            ([packet.x[0], packet.y[0], packet.z[0]], [packet.dx[0], packet.dy[0], packet.dz[0]]);
                        (lanes..LANES).for_each(|i| packet.set(i, position, towards));
                        let begin = task * TASK + first;
                        let wavelength = |i: usize| if nm.len() == 1 { nm[0] } else { nm[begin + i.min(lanes - 1)] };
                        let each: $module::Lanes = std::array::from_fn(wavelength);
                        let indices = match &common {
                            Some(common) => common,
                            None => {
                                batch.indices(&each, &mut own);
                                &own
                            }
                        };
                        let mask = match light {
                            true => batch.trace_light(&mut packet, indices, &each, way),
                            false => batch.trace(&mut packet, indices, way),
                        };
                        for i in 0..lanes {
                            let through = mask & (1 << i) != 0;
                            let at = 3 * (first + i);
                            let p = &packet;
                            let (mut point, mut d) = ([p.x[i], p.y[i], p.z[i]], [p.dx[i], p.dy[i], p.dz[i]]);
                            let mut length = p.path[i];
                            if let Some(z) = film_z {
                                let step = (z - point[2]) / d[2];
                                point = [point[0] + step * d[0], point[1] + step * d[1], z];
                                length += step;
                            }
                            if !through {
                                (point, d, length) = ([$float::NAN; 3], [$float::NAN; 3], $float::NAN);
                            }
                            out_from[at..at + 3].copy_from_slice(&point);
                            out_to[at..at + 3].copy_from_slice(&d);
                            passed[first + i] = through;
                            path[first + i] = length;
                            fraction[first + i] = if through { p.fraction[i] } else { 0.0 };
                        }
                    }
                });
                (out_from, out_to, passed, path, fraction)
            })?;
            let (from, to, passed, path, fraction) = traced;
            let vectors = |v: Vec<$float>| PyArray1::from_vec(py, v).reshape([count, 3]);
            let numbers = |v: Vec<$float>| PyArray1::from_vec(py, v);
            Ok((vectors(from)?, vectors(to)?, PyArray1::from_vec(py, passed), numbers(path), numbers(fraction)))
        }
    };
}

tracer!(trace_single, single, f32);
tracer!(trace_double, double, f64);

#[pymethods]
impl Bench {
    /// What is known of the lens as set, at a wavelength.
    fn info<'py>(&self, py: Python<'py>, nm: f64) -> PyResult<Bound<'py, PyDict>> {
        self.check_nm(nm)?;
        let system = &self.set.system;
        let n = system.indices(nm);
        let first = FirstOrder::of(system, &n);
        let axis = self.analysis().illumination(0.0, nm);
        let numbers = [
            ("wavelength_nm", nm),
            ("effective_focal_length_mm", first.efl),
            ("back_focal_length_mm", first.bfl),
            ("front_focal_length_mm", first.ffl),
            ("front_principal_z_mm", first.front_principal_z),
            ("rear_principal_z_mm", first.rear_principal_z),
            ("entrance_pupil_z_mm", first.entrance_pupil_z),
            ("exit_pupil_z_mm", first.exit_pupil_z),
            // The pupil of the real axial beam.
            ("entrance_pupil_diameter_mm", self.set.efl / self.set.f_number),
            ("f_number", self.set.f_number),
            ("widest_f_number", self.set.widest),
            ("t_number", (std::f64::consts::PI / (4.0 * axis.with_losses)).sqrt()),
            ("transmittance", axis.with_losses / axis.geometric),
            ("petzval_sum_per_mm", first.petzval_sum),
            ("last_z_mm", system.last_z()),
            ("film_z_mm", system.film_z),
        ];
        let dict = PyDict::new(py);
        numbers.iter().try_for_each(|(name, v)| dict.set_item(name, v))?;
        Ok(dict)
    }

    #[pyo3(signature = (positions, directions, wavelengths, to_film, until_film, light, threads=None))]
    fn trace_single<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArrayDyn<'py, f32>,
        directions: PyReadonlyArrayDyn<'py, f32>,
        wavelengths: PyReadonlyArrayDyn<'py, f32>,
        to_film: bool,
        until_film: bool,
        light: bool,
        threads: Option<usize>,
    ) -> PyResult<Rays<'py, f32>> {
        let batch = self.single.get_or_init(|| single::Batch::new(&self.set.system));
        let way = if to_film { TraceDirection::ToFilm } else { TraceDirection::ToObject };
        let film_z = (to_film && until_film).then_some(self.set.system.film_z as f32);
        trace_single(py, self, batch, &positions, &directions, &wavelengths, way, film_z, light, threads)
    }

    #[pyo3(signature = (positions, directions, wavelengths, to_film, until_film, light, threads=None))]
    fn trace_double<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArrayDyn<'py, f64>,
        directions: PyReadonlyArrayDyn<'py, f64>,
        wavelengths: PyReadonlyArrayDyn<'py, f64>,
        to_film: bool,
        until_film: bool,
        light: bool,
        threads: Option<usize>,
    ) -> PyResult<Rays<'py, f64>> {
        let batch = self.double.get_or_init(|| double::Batch::new(&self.set.system));
        let way = if to_film { TraceDirection::ToFilm } else { TraceDirection::ToObject };
        let film_z = (to_film && until_film).then_some(self.set.system.film_z);
        trace_double(py, self, batch, &positions, &directions, &wavelengths, way, film_z, light, threads)
    }

    /// Points `[ray][x, y]` (mm, from the chief ray's frame as the analysis has it), centroid, RMS and largest radius, fraction that passed.
    fn spot<'py>(&self, py: Python<'py>, field_deg: f64, nm: f64, across: usize, defocus_mm: f64) -> PyResult<Spot<'py>> {
        self.check_nm(nm)?;
        check_field(field_deg)?;
        if !(2..=1000).contains(&across) {
            return Err(PythonError::value("rays", across.to_string(), "2 to 1000 across the pupil").into());
        }
        let found = background::run(py, None, None, |_| self.analysis().spot(field_deg, nm, nm, across, defocus_mm))?;
        let spot = found.ok_or_else(|| no_light(field_deg))?;
        let points: Vec<f64> = spot.points.iter().flat_map(|p| p.to_array()).collect();
        let points = PyArray1::from_vec(py, points).reshape([spot.points.len(), 2])?;
        Ok((points, spot.centroid.to_array(), spot.rms, spot.geometric, spot.passed))
    }

    /// Tangential and sagittal contrast at the frequencies, and whether diffraction was left out.
    fn mtf<'py>(
        &self,
        py: Python<'py>,
        frequencies: Vec<f64>,
        field_deg: f64,
        wavelengths: Vec<f64>,
        geometric: bool,
        defocus_mm: f64,
    ) -> PyResult<Contrasts<'py>> {
        check_field(field_deg)?;
        wavelengths.iter().try_for_each(|nm| self.check_nm(*nm))?;
        if wavelengths.is_empty() || frequencies.is_empty() {
            return Err(PythonError::value("frequencies and wavelengths", "none", "one of each at least").into());
        }
        if let Some(bad) = frequencies.iter().find(|f| !(0.0..=10_000.0).contains(*f)) {
            return Err(PythonError::value("frequency", bad.to_string(), "0 to 10000 cycles/mm").into());
        }
        let colors: Vec<(f64, f64)> = wavelengths.iter().map(|nm| (*nm, 1.0)).collect();
        // As many frequencies at a time as take a moment: what Ctrl-C waits for.
        let found = background::run(py, None, None, |watch| {
            let mut whole: Option<Mtf> = None;
            for frequencies in frequencies.chunks(FREQUENCIES_AT_ONCE) {
                let part = match geometric {
                    true => self.analysis().geometric_mtf(field_deg, &colors, frequencies, defocus_mm),
                    false => self.analysis().diffraction_mtf(field_deg, &colors, frequencies, defocus_mm),
                }?;
                match &mut whole {
                    None => whole = Some(part),
                    Some(whole) => {
                        whole.tangential.extend(part.tangential);
                        whole.sagittal.extend(part.sagittal);
                    }
                }
                if watch.cancel.load(Ordering::Relaxed) {
                    break;
                }
            }
            whole
        })?;
        let mtf = found.ok_or_else(|| no_light(field_deg))?;
        Ok((PyArray1::from_vec(py, mtf.tangential), PyArray1::from_vec(py, mtf.sagittal), mtf.geometric))
    }

    /// A row a field: angle (°), height, height without distortion (f tan θ, carried along the chief ray from the paraxial focus to the film), distortion (%), tangential and sagittal focus (mm); NaN where no light
    /// reaches the film.
    fn distortion<'py>(&self, py: Python<'py>, fields_deg: Vec<f64>, nm: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.check_nm(nm)?;
        fields_deg.iter().try_for_each(|f| check_field(*f))?;
        let rows = background::run(py, None, None, |watch| {
            let row = |field: &f64| match self.analysis().field_point(*field, nm) {
                Some(p) => [*field, p.height, p.ideal_height, p.distortion_percent(), p.focus[0], p.focus[1]],
                None => [*field, f64::NAN, f64::NAN, f64::NAN, f64::NAN, f64::NAN],
            };
            let goes_on = |_: &&f64| !watch.cancel.load(Ordering::Relaxed);
            fields_deg.iter().take_while(goes_on).flat_map(row).collect::<Vec<f64>>()
        })?;
        PyArray1::from_vec(py, rows).reshape([fields_deg.len(), 6])
    }

    /// The image of a point `defocus_mm` behind the film in pixels of `pixel_mm` (half of what diffraction needs, without), the middle `pixels` of it (all,
    /// without; 512 of a geometric one). Fractions of the light within circles about the centroid, `radii_mm`.
    #[pyo3(signature = (field_deg, nm, defocus_mm, pixel_mm, pixels, geometric, radii_mm, threads=None))]
    fn psf<'py>(
        &self,
        py: Python<'py>,
        field_deg: f64,
        nm: f64,
        defocus_mm: f64,
        pixel_mm: Option<f64>,
        pixels: Option<usize>,
        geometric: bool,
        radii_mm: Vec<f64>,
        threads: Option<usize>,
    ) -> PyResult<PointImage<'py>> {
        self.check_nm(nm)?;
        check_field(field_deg)?;
        if !(defocus_mm.abs() < 1e4) {
            return Err(PythonError::value("defocus", format!("{defocus_mm} mm"), "a distance within 10 m").into());
        }
        if let Some(bad) = pixel_mm.filter(|p| !(1e-6..=1.0).contains(p)) {
            return Err(PythonError::value("pixel", format!("{} µm", 1e3 * bad), "0.001 to 1000 µm").into());
        }
        if let Some(bad) = pixels.filter(|n| !(8..=2048).contains(n)) {
            return Err(PythonError::value("pixels", bad.to_string(), "8 to 2048 across").into());
        }
        if let Some(bad) = radii_mm.iter().find(|r| !(**r >= 0.0 && r.is_finite())) {
            return Err(PythonError::value("radius", format!("{bad} mm"), "numbers from 0").into());
        }
        let found = background::run(py, threads, None, |_| {
            let analysis = self.analysis();
            let pixel = pixel_mm.or_else(|| Some(0.5 * analysis.largest_psf_pixel(field_deg, nm, nm)?))?;
            let psf = match geometric {
                true => analysis.geometric_psf(field_deg, [nm; 2], defocus_mm, pixel, pixels.unwrap_or(512)),
                false => analysis.diffraction_psf(field_deg, [nm; 2], defocus_mm, pixel),
            }?;
            let energy = psf.encircled_energy(&radii_mm);
            let side = pixels.unwrap_or(psf.side).min(psf.side);
            let first = psf.side / 2 - side / 2;
            let row = |r: usize| {
                let start = (first + side - 1 - r) * psf.side + first;
                psf.values[start..start + side].iter().copied()
            };
            let values: Vec<f64> = (0..side).flat_map(row).collect();
            Some((psf, values, side, energy))
        })?;
        let (psf, values, side, energy) = found.ok_or_else(|| no_light(field_deg))?;
        let values = PyArray1::from_vec(py, values).reshape([side, side])?;
        let energy = PyArray1::from_vec(py, energy);
        Ok((values, psf.pixel, psf.origin.to_array(), psf.centroid.to_array(), psf.strehl, psf.geometric, energy))
    }

    /// The wavefront of a field on a grid of `across` rays a side.
    #[pyo3(signature = (field_deg, nm, across, threads=None))]
    fn wavefront<'py>(
        &self,
        py: Python<'py>,
        field_deg: f64,
        nm: f64,
        across: usize,
        threads: Option<usize>,
    ) -> PyResult<PathDifferences<'py>> {
        self.check_nm(nm)?;
        check_field(field_deg)?;
        if !(2..=1024).contains(&across) {
            return Err(PythonError::value("rays_across", across.to_string(), "2 to 1024").into());
        }
        let found = background::run(py, threads, None, |_| self.analysis().wavefront(field_deg, nm, across))?;
        let w = found.ok_or_else(|| no_light(field_deg))?;
        let map = PyArray1::from_vec(py, w.map()).reshape([across, across])?;
        let pupil: Vec<f64> = w.samples.iter().flat_map(|s| s.pupil.to_array()).collect();
        let pupil = PyArray1::from_vec(py, pupil).reshape([w.samples.len(), 2])?;
        let opd = PyArray1::from_vec(py, w.samples.iter().map(|s| s.opd).collect());
        Ok((map, pupil, opd, w.peak_to_valley(), w.rms(), w.rms_without_tilt()))
    }

    /// A row a height on the film: height (mm), irradiance over radiance (sr) of the apertures alone, and with losses in glass and at surfaces.
    fn vignetting<'py>(&self, py: Python<'py>, heights_mm: Vec<f64>, nm: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.check_nm(nm)?;
        if let Some(bad) = heights_mm.iter().find(|h| !h.is_finite()) {
            return Err(PythonError::value("height", bad.to_string(), "finite numbers, mm").into());
        }
        let rows = background::run(py, None, None, |watch| {
            let row = |height: &f64| {
                let light = self.analysis().illumination(*height, nm);
                [*height, light.geometric, light.with_losses]
            };
            let goes_on = |_: &&f64| !watch.cancel.load(Ordering::Relaxed);
            heights_mm.iter().take_while(goes_on).flat_map(row).collect::<Vec<f64>>()
        })?;
        PyArray1::from_vec(py, rows).reshape([heights_mm.len(), 3])
    }
}

/// Fits Zernike terms to values at places of the unit disk `[ray][2]`; places beyond it are left out. `fringe`: their order instead of Noll's.
#[pyfunction]
#[pyo3(signature = (pupil, values, terms, fringe))]
pub fn zernike_fit<'py>(
    py: Python<'py>,
    pupil: PyReadonlyArrayDyn<'py, f64>,
    values: PyReadonlyArrayDyn<'py, f64>,
    terms: usize,
    fringe: bool,
) -> PyResult<Zernikes<'py>> {
    let (places, shape) = slice(&pupil, "pupil", &[0, 2])?;
    let (values, _) = slice(&values, "values", &[shape[0]])?;
    let numbering = if fringe { Numbering::Fringe } else { Numbering::Noll };
    let largest = numbering.largest();
    if !(1..=largest).contains(&terms) {
        return Err(PythonError::value("terms", terms.to_string(), format!("1 to {largest}")).into());
    }
    let pairs = places.chunks_exact(2).map(|p| DVec2::new(p[0], p[1])).zip(values.iter().copied());
    // The edge itself counts, however it was rounded.
    let inside: Vec<(DVec2, f64)> = pairs.filter(|(p, v)| p.length() <= 1.0 + 1e-9 && v.is_finite()).collect();
    let found = background::run(py, None, None, |_| zernike::fit(&inside, numbering, terms))?;
    let fit = found.ok_or_else(|| {
        let expected = format!("more places of the unit disk than {terms} terms, all over it");
        PythonError::value("pupil", format!("{} places", inside.len()), expected)
    })?;
    let names = (1..=terms).filter_map(|number| numbering.term(number)).map(|t| (t.n, t.m, t.name())).collect();
    Ok((PyArray1::from_vec(py, fit.coefficients), fit.residual_rms, names))
}

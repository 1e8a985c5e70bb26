//! Bodies: sensors by their data sheets.

use crate::background;
use crate::errors::PythonError;
use diopter::sensor::emva::{Conditions, measure};
use diopter::sensor::{Reading, Sensor};
use diopter::shot::read_body;
use numpy::PyArray1;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A body.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Body {
    pub sensor: Arc<Sensor>,
}

/// Names of the embedded bodies.
#[pyfunction]
pub fn body_names() -> Vec<&'static str> {
    Sensor::names().collect()
}

#[pymethods]
impl Body {
    /// By name or from a data sheet (TOML).
    #[staticmethod]
    fn read(name: PathBuf) -> PyResult<Body> {
        let sensor = read_body(&name.to_string_lossy()).map_err(PythonError::from)?;
        Ok(Body { sensor: Arc::new(sensor) })
    }

    /// From the text of a data sheet.
    #[staticmethod]
    fn parse(text: &str, place: &str) -> PyResult<Body> {
        Ok(Body { sensor: Arc::new(Sensor::parse(text, place).map_err(PythonError::from)?) })
    }

    #[getter]
    fn name(&self) -> String {
        self.sensor.name.clone()
    }

    #[getter]
    fn format_mm(&self) -> [f64; 2] {
        self.sensor.format_mm
    }

    #[getter]
    fn pixels(&self) -> [usize; 2] {
        self.sensor.pixels
    }

    #[getter]
    fn pitch_mm(&self) -> [f64; 2] {
        self.sensor.pitch_mm()
    }

    #[getter]
    fn full_well_e(&self) -> f64 {
        self.sensor.full_well_e
    }

    #[getter]
    fn adc_bits(&self) -> u32 {
        self.sensor.adc_bits
    }

    #[getter]
    fn cfa(&self) -> String {
        self.sensor.cfa.letters()
    }

    #[getter]
    fn channels(&self) -> Vec<&'static str> {
        self.sensor.cfa.channel_names()
    }

    /// (ISO speed, gain e⁻/DN, read noise e⁻, black level DN, white level DN) of each speed of the sheet.
    #[getter]
    fn iso(&self) -> Vec<(f64, f64, f64, f64, f64)> {
        let of = |s: &diopter::sensor::IsoStep| (s.iso, s.gain_e_per_dn, s.read_noise_e, s.black_level_dn, s.white_level_dn);
        self.sensor.iso.iter().map(of).collect()
    }

    /// Quantum efficiency of each channel at the wavelengths, nm.
    fn quantum_efficiency<'py>(&self, py: Python<'py>, nm: Vec<f32>) -> PyResult<Vec<Bound<'py, PyArray1<f32>>>> {
        if let Some(bad) = nm.iter().find(|nm| !(100.0..=3000.0).contains(*nm)) {
            return Err(PythonError::value("nm", bad.to_string(), "wavelengths from 100 to 3000 nm").into());
        }
        let of = |qe: &diopter::light::spectrum::Table| PyArray1::from_vec(py, nm.iter().map(|nm| qe.at(*nm)).collect());
        Ok(self.sensor.quantum_efficiency.iter().map(of).collect())
    }

    /// EMVA 1288 on read-outs of this body, as JSON.
    #[pyo3(signature = (iso, channel, nm, exposure_s, temperature_c, seed, size, stack, threads=None))]
    fn emva(
        &self,
        py: Python<'_>,
        iso: f64,
        channel: usize,
        nm: Option<f64>,
        exposure_s: f64,
        temperature_c: Option<f64>,
        seed: u64,
        size: [usize; 2],
        stack: usize,
        threads: Option<usize>,
    ) -> PyResult<String> {
        let serial = Reading::FIRST_SERIAL.to_owned();
        let conditions = Conditions { iso, channel, nm, exposure_s, temperature_c, serial, seed, size, stack };
        let sensor = self.sensor.clone();
        let report = background::run(py, threads, None, |watch| {
            let cancelled = || watch.cancel.load(std::sync::atomic::Ordering::Relaxed);
            measure(&sensor, &conditions, &mut |_| if cancelled() { Err("the measurement was stopped".into()) } else { Ok(()) })
        })?;
        let report = report.map_err(PythonError::from)?;
        Ok(serde_json::to_string(&report).unwrap_or_else(|e| unreachable!("plain data becomes JSON: {e}")))
    }
}

//! Exposures: scene, lens and body from memory, everything else as a shot file says it.

use crate::background;
use crate::body::Body;
use crate::errors::PythonError;
use crate::lens::Lens;
use crate::picture::Picture;
use crate::plane::FocalPlane;
use crate::raw::RawImage;
use crate::scene::Scene;
use diopter::expose::ProgressReporter;
use diopter::focus::Report;
use diopter::lens::Prescription;
use diopter::quantity::SpectralBands;
use diopter::scene::Description;
use diopter::sensor::Sensor;
use diopter::shot::{ExposureUse, Inputs, SceneCache, Shot, ShotError, ShotFile};
use pyo3::prelude::*;
use serde_json::Value;
use std::sync::{Arc, Mutex};

/// What is asked of an exposure.
struct Request {
    file: ShotFile,
    scene: Option<(Arc<Description>, Arc<Mutex<SceneCache>>)>,
    lens: Option<Prescription>,
    sensor: Option<Arc<Sensor>>,
    records: Records,
}

/// What the film records.
#[derive(Clone)]
enum Records {
    Electrons,
    /// Linear sRGB in cd/m².
    Luminance,
    /// Mean spectral radiance of bands.
    Spectral(SpectralBands),
}

impl Request {
    fn new(
        settings: &str,
        scene: Option<&Bound<'_, Scene>>,
        lens: Option<&Bound<'_, Lens>>,
        body: Option<&Bound<'_, Body>>,
        records: &str,
    ) -> PyResult<Request> {
        let records = match records {
            "electrons" => Records::Electrons,
            "radiance" => Records::Luminance,
            bands => {
                let expected = "electrons, radiance, or whole spectral bands within 380 to 780 nm such as 400..700/10nm";
                Records::Spectral(bands.parse().map_err(|_| PythonError::value("record", format!("\"{bands}\""), expected))?)
            }
        };
        Ok(Request {
            file: shot_file(settings)?,
            scene: scene.map(|s| (s.borrow().description.clone(), s.borrow().cache.clone())),
            lens: lens.map(|l| l.get().prescription.clone()),
            sensor: body.map(|b| b.get().sensor.clone()),
            records,
        })
    }

    /// The shot, focused and metered; refused where it is exposed and there is not enough memory for that.
    fn prepared(
        &self,
        kept: Option<ExposureUse>,
        watch: &ProgressReporter,
        warnings: &mut Vec<String>,
    ) -> Result<(Shot, Option<Report>), ShotError> {
        let mut warn = |text: &str| warnings.push(text.to_owned());
        if self.file.camera.dual_pixel {
            let expected = "whole pixels here: `shoot --dual-pixel` of the command line takes both photodiodes".into();
            return Err(ShotError::Value { what: "dual_pixel".into(), found: "true".into(), expected });
        }
        for (section, is_asked) in
            [("sequence", self.file.sequence != Default::default()), ("output", self.file.output != Default::default())]
        {
            if is_asked {
                let expected = "one exposure here: series and files are the command line's (`diopter.command`)".into();
                return Err(ShotError::Value { what: section.into(), found: format!("a section [{section}]"), expected });
            }
        }
        let inputs = Inputs {
            scene: self.scene.as_ref().map(|s| s.0.clone()),
            lens: self.lens.clone(),
            sensor: self.sensor.as_deref().cloned(),
            ..Default::default()
        };
        // A scene that was exposed before is built already; a panic elsewhere leaves it whole.
        let mut shot = match &self.scene {
            Some((_, cache)) => {
                let mut cache = cache.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                Shot::prepare_cached(&self.file, inputs, &mut cache, &mut warn)?
            }
            None => Shot::prepare_with(&self.file, inputs, &mut warn)?,
        };
        match &self.records {
            Records::Electrons => {}
            Records::Luminance => shot.radiance = true,
            Records::Spectral(bands) => shot.spectral = Some(*bands),
        }
        if let Some(kept) = kept {
            shot.check_memory(kept, None)?;
        }
        // The bar is the exposure's; these take moments.
        let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
        let report = shot.focus(&quiet, &mut warn)?;
        shot.meter(&quiet, &mut warn)?;
        Ok((shot, report))
    }
}

/// The settings of a shot file, from JSON. Fails with the name of the setting that is wrong.
fn shot_file(settings: &str) -> Result<ShotFile, PythonError> {
    let wrong = |e: &serde_json::Error| {
        PythonError::value("settings", format!("not the settings of a shot: {e}"), "sections of a shot file")
    };
    let whole: Value = serde_json::from_str(settings).map_err(|e| wrong(&e))?;
    let e = match serde_json::from_value::<ShotFile>(whole.clone()) {
        Ok(file) => return Ok(file),
        Err(e) => e,
    };
    // Which one it is: each by itself.
    let sections = whole.as_object().into_iter().flatten();
    for (section, keys) in sections {
        for (key, found) in keys.as_object().into_iter().flatten() {
            let alone = serde_json::json!({ section: { key: found } });
            if let Err(e) = serde_json::from_value::<ShotFile>(alone) {
                // Of "invalid type: ..., expected ..." what is expected, and of "... is not a time such as 1/125 s" that.
                let told = e.to_string();
                let expected = told
                    .rsplit_once("expected ")
                    .or_else(|| told.split_once(" is not "))
                    .map_or(&*told, |(_, expected)| expected);
                return Err(PythonError::value(&format!("{section}.{key}"), found.to_string(), expected));
            }
        }
    }
    Err(wrong(&e))
}

/// Exposes. Answers with the plane and what was found odd.
#[pyfunction]
#[pyo3(signature = (settings, scene=None, lens=None, body=None, records="electrons", threads=None, progress=None))]
pub fn expose(
    py: Python<'_>,
    settings: &str,
    scene: Option<&Bound<'_, Scene>>,
    lens: Option<&Bound<'_, Lens>>,
    body: Option<&Bound<'_, Body>>,
    records: &str,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(FocalPlane, Vec<String>)> {
    let request = Request::new(settings, scene, lens, body, records)?;
    let taken = background::run(py, threads, progress, |watch| -> Result<_, ShotError> {
        let mut warnings = Vec::new();
        let (shot, _) = request.prepared(Some(ExposureUse::Plane), watch, &mut warnings)?;
        let plane = shot.expose(watch)?;
        Ok((plane, Arc::new(shot.sensor), warnings))
    })?;
    let (plane, sensor, warnings) = taken.map_err(PythonError::from)?;
    Ok((FocalPlane { plane: Arc::new(plane), sensor: Some(sensor) }, warnings))
}

/// The whole photograph.
#[pyfunction]
#[pyo3(signature = (settings, scene=None, lens=None, body=None, threads=None, progress=None))]
pub fn shoot(
    py: Python<'_>,
    settings: &str,
    scene: Option<&Bound<'_, Scene>>,
    lens: Option<&Bound<'_, Lens>>,
    body: Option<&Bound<'_, Body>>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(FocalPlane, RawImage, Picture, Vec<String>)> {
    let request = Request::new(settings, scene, lens, body, "electrons")?;
    let taken = background::run(py, threads, progress, |watch| -> Result<_, ShotError> {
        let mut warnings = Vec::new();
        let (shot, _) = request.prepared(Some(ExposureUse::Plane), watch, &mut warnings)?;
        let plane = shot.expose(watch)?;
        let raw = shot.read_out(&plane)?;
        let picture = shot.develop(&raw)?;
        Ok((plane, raw, picture, Arc::new(shot.sensor), warnings))
    })?;
    let (plane, raw, picture, sensor, warnings) = taken.map_err(PythonError::from)?;
    Ok((
        FocalPlane { plane: Arc::new(plane), sensor: Some(sensor) },
        RawImage { raw: Arc::new(raw) },
        Picture { picture: Arc::new(picture) },
        warnings,
    ))
}

/// Focuses and meters without exposing: the facts of the exposure that would be taken and the report of autofocus (or null), as JSON, and what was
/// found odd.
#[pyfunction]
#[pyo3(signature = (settings, scene=None, lens=None, body=None, threads=None))]
pub fn meter(
    py: Python<'_>,
    settings: &str,
    scene: Option<&Bound<'_, Scene>>,
    lens: Option<&Bound<'_, Lens>>,
    body: Option<&Bound<'_, Body>>,
    threads: Option<usize>,
) -> PyResult<(String, String, Vec<String>)> {
    let request = Request::new(settings, scene, lens, body, "electrons")?;
    let taken = background::run(py, threads, None, |watch| -> Result<_, ShotError> {
        let mut warnings = Vec::new();
        let (shot, report) = request.prepared(None, watch, &mut warnings)?;
        Ok((shot.facts(), report, warnings))
    })?;
    let (facts, report, warnings) = taken.map_err(PythonError::from)?;
    let json = |v: serde_json::Result<String>| v.unwrap_or_else(|e| unreachable!("plain data becomes JSON: {e}"));
    Ok((json(serde_json::to_string(&facts)), json(serde_json::to_string(&report)), warnings))
}

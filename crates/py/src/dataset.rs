//! Data sets: items as archives, and the folder they are gathered in. Who schedules is Python's matter.

use crate::background;
use crate::errors::PythonError;
use diopter::dataset;
use diopter::shot::{SceneCache, ShotError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A checked specification, and the scene of the item that was made last.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct Dataset {
    dataset: Arc<dataset::Dataset>,
    scenes: Mutex<SceneCache>,
}

/// A specification in JSON as TOML.
#[pyfunction]
pub fn specification(json: &str) -> PyResult<String> {
    Ok(dataset::specification(json).map_err(PythonError::from)?)
}

#[pymethods]
impl Dataset {
    #[new]
    fn new(text: &str, place: &str, folder: PathBuf) -> PyResult<Dataset> {
        let dataset = Arc::new(dataset::Dataset::new(text, place, &folder).map_err(PythonError::from)?);
        Ok(Dataset { dataset, scenes: Mutex::new(SceneCache::new()) })
    }

    #[getter]
    fn name(&self) -> &str {
        self.dataset.name()
    }

    #[getter]
    fn items(&self) -> u64 {
        self.dataset.items()
    }

    #[getter]
    fn endings(&self) -> Vec<String> {
        self.dataset.endings()
    }

    /// What differs in an item, as JSON.
    fn parameters(&self, item: u64) -> PyResult<String> {
        Ok(self.dataset.parameters_json(item).map_err(PythonError::from)?.to_string())
    }

    /// Name and items of each shard.
    fn shards(&self) -> Vec<(String, Vec<u64>)> {
        self.dataset.shards().into_iter().map(|s| (s.name, s.items)).collect()
    }

    /// An item as a tar archive, and what was found odd.
    #[pyo3(signature = (item, threads=None))]
    fn archive<'py>(&self, py: Python<'py>, item: u64, threads: Option<usize>) -> PyResult<(Bound<'py, PyBytes>, Vec<String>)> {
        let made = background::run(py, threads, None, |watch| -> Result<_, ShotError> {
            let mut warnings = Vec::new();
            // The scene is kept for the next item; where another thread makes one meanwhile, this one has its own.
            let mut own = SceneCache::new();
            let mut shared = match self.scenes.try_lock() {
                Err(std::sync::TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
                other => other.ok(),
            };
            let scenes = shared.as_deref_mut().unwrap_or(&mut own);
            let archive = self.dataset.make_item(item, scenes, watch, &mut |text| warnings.push(text.to_owned()))?;
            Ok((archive, warnings))
        })?;
        let (archive, warnings) = made.map_err(PythonError::from)?;
        Ok((PyBytes::new(py, &archive), warnings))
    }
}

/// A folder that a data set is gathered in.
#[pyclass(frozen, module = "diopter._diopter")]
pub struct DatasetFolder {
    folder: Mutex<dataset::Folder>,
}

#[pymethods]
impl DatasetFolder {
    #[new]
    fn new(dataset: &Bound<'_, Dataset>, path: PathBuf) -> PyResult<DatasetFolder> {
        let folder = dataset::Folder::open(dataset.get().dataset.clone(), Path::new(&path)).map_err(PythonError::from)?;
        Ok(DatasetFolder { folder: Mutex::new(folder) })
    }

    /// Items that are to be made.
    fn missing(&self, py: Python<'_>) -> Vec<u64> {
        py.detach(|| self.folder.lock().unwrap_or_else(PoisonError::into_inner).missing())
    }

    /// Keeps an item that was made.
    fn keep(&self, py: Python<'_>, item: u64, archive: &[u8]) -> PyResult<()> {
        let kept = py.detach(|| self.folder.lock().unwrap_or_else(PoisonError::into_inner).keep(item, archive));
        Ok(kept.map_err(PythonError::from)?)
    }

    /// Packs all, and writes table and card. Answers with the names of the files.
    fn finish(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let made = py.detach(|| self.folder.lock().unwrap_or_else(PoisonError::into_inner).finish());
        Ok(made.map_err(PythonError::from)?.files)
    }
}

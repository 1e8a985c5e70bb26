//! Files are written beside and renamed: what has a name is whole.

use crate::errors::PythonError;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes a file.
pub fn write(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), PythonError>) -> Result<(), PythonError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // The mode is that of any new file; temporary files are for their owner alone otherwise.
    let mut part = tempfile::Builder::new();
    part.prefix(".diopter-").suffix(".part");
    #[cfg(unix)]
    part.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let part = part.tempfile_in(folder).map_err(|e| PythonError::file(path, e))?;
    let mut to = BufWriter::new(part.as_file());
    write(&mut to).map_err(|e| e.in_file(path))?;
    to.flush().map_err(|e| PythonError::file(path, e))?;
    drop(to);
    part.persist(path).map_err(|e| PythonError::file(path, e.error))?;
    Ok(())
}

/// The ending of a name in small letters.
pub fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase())
}

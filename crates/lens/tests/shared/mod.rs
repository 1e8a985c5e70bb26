//! What several tests need.

use std::path::PathBuf;

/// The folder of reference data beside the project, if it is there.
pub fn data() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    if !folder.is_dir() {
        eprintln!("skipped: the reference data (shared/data) is not there");
        return None;
    }
    Some(folder)
}

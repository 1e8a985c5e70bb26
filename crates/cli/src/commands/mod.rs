//! One file a verb.

pub mod body;
pub mod calc;
pub mod denoise;
pub mod develop;
pub mod expose;
pub mod lens;
pub mod lut;
pub mod manual;
pub mod merge;
pub mod quick_look;
pub mod read_out;
pub mod scene;
pub mod shoot;
pub mod stack;

use anyhow::Context;
use diopter::image::{FocalPlane, exr};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Opens a file for reading, naming it in errors.
fn open(path: &Path) -> anyhow::Result<BufReader<File>> {
    Ok(BufReader::new(File::open(path).with_context(|| path.display().to_string())?))
}

fn read_plane(path: &Path) -> anyhow::Result<FocalPlane> {
    exr::read_focal_plane(open(path)?).with_context(|| path.display().to_string())
}

/// Prints JSON for machines.
fn print_json(value: &serde_json::Value) -> anyhow::Result<()> {
    use std::io::Write;
    writeln!(std::io::stdout(), "{value:#}")?;
    Ok(())
}

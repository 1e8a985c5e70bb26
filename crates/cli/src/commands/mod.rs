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

use crate::watch::warn;
use anyhow::Context;
use diopter::files::{self, Source};
use diopter::image::{FocalPlane, RawImage, dng, exr};
use std::path::Path;

/// Opens a file or stream for reading, naming it in errors.
fn open(path: &Path) -> anyhow::Result<Source> {
    files::open(path).with_context(|| path.display().to_string())
}

/// Reads a raw file and says what its reader had to leave out or assume.
fn read_raw(path: &Path) -> anyhow::Result<RawImage> {
    let place = || path.display().to_string();
    let raw = dng::read(open(path)?).with_context(place)?;
    raw.header.warnings.iter().for_each(|w| warn(&format!("{}: {w}", path.display())));
    Ok(raw)
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

/// A number with four digits: "4000", "12.34", "1.250e-3".
fn shown(v: f64) -> String {
    if v == 0.0 || (1e-2..1e6).contains(&v.abs()) {
        let decimals = (3 - v.abs().max(1e-9).log10().floor() as i32).clamp(0, 4) as usize;
        let text = format!("{v:.decimals$}");
        return if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text };
    }
    format!("{v:.3e}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_shown_with_four_digits() {
        for (value, text) in [
            (4000.0, "4000"),
            (39.9999, "40"),
            (12.3456, "12.35"),
            (0.1, "0.1"),
            (0.0, "0"),
            (123_456.7, "123457"),
            (-2.5, "-2.5"),
            (1.25e-3, "1.250e-3"),
            (4e9, "4.000e9"),
        ] {
            assert_eq!(shown(value), text);
        }
    }
}

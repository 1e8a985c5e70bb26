//! One file a verb.

pub mod body;
pub mod calc;
pub mod dataset;
pub mod denoise;
pub mod develop;
pub mod events;
pub mod expose;
mod exposure_summary;
pub mod lens;
pub mod lesson;
mod light;
pub mod lut;
pub mod manual;
pub mod measure;
pub mod merge;
pub mod quick_look;
pub mod read_out;
pub mod rig;
pub mod scene;
mod series_calibration;
pub mod sheet;
pub mod shoot;
pub mod stack;
pub mod viewfinder;
pub mod why;

use crate::UsageError;
use crate::watch::warn;
use anyhow::{Context, anyhow};
use diopter::files::{self, Source};
use diopter::image::exr::FocalPlaneStrips;
use diopter::image::focal_plane::{Band, FocalPlaneSource};
use diopter::image::truth::Recorded;
use diopter::image::{ExposureFacts, FocalPlane, ImageError, RawImage, dng, exr};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

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

/// Fails where a picture is named twice.
fn named_once(paths: &[PathBuf]) -> anyhow::Result<()> {
    let mut seen = HashSet::new();
    for path in paths.iter().filter(|path| path.as_os_str() != "-") {
        if !seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
            return Err(
                UsageError(anyhow!("{}: it is named twice; expected each picture of the series once", path.display())).into()
            );
        }
    }
    Ok(())
}

/// As in "1 picture", "3 pictures".
fn count_of_pictures(count: usize) -> String {
    format!("{count} picture{}", if count == 1 { "" } else { "s" })
}

fn read_plane(path: &Path) -> anyhow::Result<FocalPlane> {
    exr::read_focal_plane(open(path)?).with_context(|| path.display().to_string())
}

/// A focal plane that is read strip by strip, naming its file in errors.
struct PlaneFile {
    name: String,
    strips: FocalPlaneStrips,
    /// Rows that were read.
    read: usize,
}

impl PlaneFile {
    fn open(path: &Path) -> anyhow::Result<Self> {
        let name = path.display().to_string();
        let strips = FocalPlaneStrips::open(open(path)?).with_context(|| name.clone())?;
        Ok(PlaneFile { name, strips, read: 0 })
    }
}

impl FocalPlaneSource for PlaneFile {
    fn bands(&self) -> &[Band] {
        self.strips.bands()
    }

    fn facts(&self) -> &ExposureFacts {
        self.strips.facts()
    }

    fn recorded(&self) -> &Recorded {
        self.strips.recorded()
    }

    fn size(&self) -> [usize; 2] {
        self.strips.size()
    }

    fn rows_at_once(&self) -> usize {
        self.strips.rows_at_once()
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let name = &self.name;
        let strip = self.strips.next_rows(rows).map_err(|e| match e {
            ImageError::Malformed { format, reason } => ImageError::Malformed { format, reason: format!("{name}: {reason}") },
            ImageError::Io(e) => ImageError::Io(std::io::Error::new(e.kind(), format!("{name}: {e}"))),
            other => other,
        })?;
        let (width, bands) = (strip.mean.width, strip.mean.channels);
        if let Some(at) = strip.mean.data.iter().position(|v| !v.is_finite()) {
            let (column, row) = (at / bands % width, self.read + at / bands / width);
            let reason = format!("{name}: light {} at column {column}, row {row}; expected finite numbers", strip.mean.data[at]);
            return Err(ImageError::Malformed { format: "EXR", reason });
        }
        self.read += strip.mean.height;
        Ok(strip)
    }
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
        let decimals = (3 - v.abs().max(1e-9).log10().floor() as i32).clamp(0, 5) as usize;
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
            // The magnification of 50 mm at 3 m.
            (-0.016_949, "-0.01695"),
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

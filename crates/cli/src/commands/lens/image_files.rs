//! Where `lens psf` and `lens wavefront` write: drawings, and rasters as EXR.

use super::bench::Bench;
use super::print_json;
use crate::output::Output;
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::image::{ExposureFacts, exr};
use diopter::lens::draw::Figure;
use serde_json::Value;
use std::io::Write;
use std::path::PathBuf;

/// A plane of an EXR file.
pub(super) type Plane = (String, Vec<f32>);

/// Files that were asked for: drawings, and rasters with a channel each.
pub(super) struct Files {
    drawings: Vec<(bool, Output)>,
    rasters: Vec<Output>,
}

impl Files {
    pub(super) fn prepare(asked: &Bench) -> anyhow::Result<Files> {
        let is_exr = |p: &&PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let (rasters, drawings): (Vec<&PathBuf>, Vec<&PathBuf>) = asked.output.iter().partition(is_exr);
        let unknown =
            |p: &&&PathBuf| !p.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg") || e.eq_ignore_ascii_case("png"));
        if let Some(bad) = drawings.iter().find(unknown) {
            return Err(UsageError(anyhow!("{}: expected a name that ends in .svg, .png or .exr", bad.display())).into());
        }
        let rasters = rasters.into_iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<_>>()?;
        let drawings: Vec<PathBuf> = drawings.into_iter().cloned().collect();
        Ok(Files { drawings: paint::prepare(&drawings)?, rasters })
    }

    pub(super) fn write(self, side: usize, planes: &[Plane], figure: impl FnOnce() -> Figure) -> anyhow::Result<()> {
        if !self.drawings.is_empty() {
            paint::write(self.drawings, &figure())?.iter().for_each(|p| say(&format!("wrote {}", p.display())));
        }
        let facts = ExposureFacts { software: concat!("diopter ", env!("CARGO_PKG_VERSION")).into(), ..ExposureFacts::default() };
        for output in self.rasters {
            let floats = planes.iter().map(|(name, values)| (name.as_str(), values.clone())).collect();
            let path = output.commit(|w| Ok(exr::write_planes([side; 2], floats, vec![], &facts, w)?))?;
            say(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// Name of a channel: a dot in it would start a layer.
pub(super) fn channel(kind: &str, field: f64, nm: f64, defocus: f64) -> String {
    let plane = if defocus == 0.0 { String::new() } else { format!(" {defocus:+}mm") };
    format!("{kind} {field:.3}deg {nm:.1}nm{plane}").replace('.', "_")
}

/// Prints the result.
pub(super) fn finished(text: &str, value: &Value, json: bool) -> anyhow::Result<()> {
    if json {
        return print_json(value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

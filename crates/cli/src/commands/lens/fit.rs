//! `lens fit`: a prescription's free numbers by what was measured of a lens.

use super::tolerance::{lens_of, read_sheet};
use super::{GlobalFlags, print_json};
use crate::UsageError;
use crate::output::{Output, distinct};
use crate::watch::{say, warn};
use anyhow::anyhow;
use diopter::calibration::read_camera;
use diopter::calibration::seen_fields::seen_fields;
use diopter::lens::optimise::fit::{FitReport, FitSheet, FocusSetting, LensFit};
use diopter::shot::{ShotError, lens_beside};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Most steps.
const MOST: usize = 10_000;

/// Match a real lens: scale, f-number, decentre ... fitted to distortion, vignetting, MTF or a calibration.
#[derive(clap::Args, Debug)]
pub struct Fit {
    /// File of measurements (.toml): [distortion], [vignetting], [mtf], [calibration]; [[variable]]: what is free.
    measured: PathBuf,
    /// The prescription to start from, instead of the one the file names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    lens: Option<String>,
    /// Most steps of the damped least squares from each start.
    #[arg(long, value_name = "N", default_value_t = 100)]
    iterations: usize,
    /// Lens file to write (.toml); what is no part of it (f-number, film) is printed as flags of `shoot`.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Fit {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        if !(1..=MOST).contains(&self.iterations) {
            return Err(UsageError(anyhow!("iterations {}: expected 1 to {MOST}", self.iterations)).into());
        }
        let text = read_sheet(&self.measured)?;
        let wrong = |e: diopter::lens::LensError| anyhow::Error::from(ShotError::from(e));
        let mut sheet = FitSheet::parse(&text, &self.measured.display().to_string()).map_err(|e| wrong(e.into()))?;
        // No file that is read here is written: neither the measurements, nor the lens, nor the calibration.
        let beside = |name: &str| self.measured.parent().unwrap_or(Path::new("")).join(name);
        let calibration = sheet.calibration.clone().map(|entry| (beside(&entry.file), entry));
        let lens_name = self.lens.clone().or_else(|| sheet.lens.as_deref().map(|named| lens_beside(named, &self.measured)));
        // "sheet.toml#17" is read from sheet.toml.
        let lens_file = lens_name.map(|name| PathBuf::from(name.split('#').next().unwrap_or(&name)));
        let inputs = [Some(self.measured.clone()), lens_file, calibration.as_ref().map(|c| c.0.clone())];
        distinct(inputs.iter().flatten().map(PathBuf::as_path), self.output.as_deref())?;
        let output = match &self.output {
            Some(path) if path.extension().is_none_or(|e| e != "toml") => {
                return Err(UsageError(anyhow!("{}: expected a name that ends in .toml", path.display())).into());
            }
            Some(path) => Some(Output::prepare(path)?),
            None => None,
        };
        let lens = lens_of(self.lens.as_deref(), sheet.lens.as_deref(), &self.measured)?;
        if let Some((path, entry)) = calibration {
            let name = path.display().to_string();
            let source = read_camera(&path, None).map_err(|e| UsageError(e.into()))?;
            let (fields, pixel_mm) =
                seen_fields(&source, &name, entry.film_mm, entry.origin).map_err(|e| UsageError(e.into()))?;
            sheet.add(&fields, entry.sigma_px * pixel_mm);
        }
        let report = LensFit::new(&lens, &sheet).and_then(|fit| fit.run(self.iterations)).map_err(wrong)?;
        let toml = report.lens.to_toml();
        if let Some(output) = output {
            let path = output.commit(|w| Ok(w.write_all(toml.as_bytes())?))?;
            say(&format!("wrote {}", path.display()));
        }
        report.warnings.iter().for_each(|w| warn(w));
        if global.json {
            return print_json(&as_json(&report, &toml));
        }
        write!(std::io::stdout(), "{}", table(&report, self.output.as_deref())?)?;
        Ok(())
    }
}

/// The flags of `shoot` and `expose` that set what is no part of a prescription.
fn flags(r: &FitReport) -> String {
    // Rounded down, the widest f-number asks for all that there is.
    let f_number = if r.open { (r.f_number * 1e4).floor() / 1e4 } else { r.f_number };
    let aperture = format!("--aperture f/{f_number:.4} ");
    let focus = match r.focus {
        // Below a nanometre it is what the lens does by itself.
        FocusSetting::Extension(e) if e.abs() < 1e-6 => "--focus inf".to_owned(),
        FocusSetting::Extension(e) => format!("--focus \"extension {e:.6}mm\""),
        FocusSetting::Groups { distance: None, .. } => "--focus inf".to_owned(),
        FocusSetting::Groups { distance: Some(d), .. } => format!("--focus {}m", d / 1000.0),
    };
    aperture + &focus
}

/// The fitted film where no flag says it.
fn film_note(r: &FitReport) -> Option<String> {
    match r.focus {
        FocusSetting::Groups { film, .. } if film.abs() > 1e-6 => Some(format!(
            "the film stands {film:+.4} mm behind where the lens is focused: this lens focuses by its groups, and no flag moves its film alone"
        )),
        _ => None,
    }
}

fn table(r: &FitReport, output: Option<&Path>) -> anyhow::Result<String> {
    let reduced = r.reduced().map_or("-".to_owned(), |v| format!("{v:.4}"));
    let mut t = format!(
        "{}: chi-squared {:.4} to {:.4}, {} degrees of freedom, {reduced} each; {} steps; {}\n",
        r.lens.name, r.chi_squared[0], r.chi_squared[1], r.degrees_of_freedom, r.iterations, r.stop
    );
    writeln!(t, "  {:<32} {:>14} {:>14} {:>14}", "number", "start", "fitted", "standard error")?;
    for n in &r.numbers {
        let name = format!("{} {}", n.name, n.unit);
        let error = match n.standard_error {
            Some(e) => format!("{e:.3e}"),
            None if n.on_bound => "on its bound".to_owned(),
            None => "not known".to_owned(),
        };
        writeln!(t, "  {:<32} {:>14.8} {:>14.8} {error:>14}", name.trim_end(), n.start, n.value)?;
    }
    if r.numbers.len() > 1 {
        writeln!(t, "  correlations (condition number {:.3}):", r.condition)?;
        for (n, row) in r.numbers.iter().zip(&r.correlations) {
            let cells: Vec<String> = row.iter().map(|c| format!("{c:>8.4}")).collect();
            writeln!(t, "  {:<32} {}", n.name, cells.join(" "))?;
        }
    }
    writeln!(t, "  {:<44} {:>12} {:>12} {:>10} {:>10}", "measured", "value", "predicted", "sigma", "residual")?;
    for row in &r.rows {
        let m = &row.measured;
        let name = format!("{} {}", m.name(), m.table.unit());
        writeln!(
            t,
            "  {:<44} {:>12.6} {:>12.6} {:>10.4} {:>+10.3}",
            name.trim_end(),
            m.value,
            row.predicted,
            m.sigma,
            row.residual
        )?;
    }
    let (hint, lens) = match output {
        Some(lens) => ("photograph with it", lens.display().to_string()),
        None => ("written with -o fitted.toml, photograph with it", "fitted.toml".to_owned()),
    };
    writeln!(t, "  {hint}: diopter shoot SCENE --lens {lens} {}", flags(r))?;
    if let Some(note) = film_note(r) {
        writeln!(t, "  {note}")?;
    }
    Ok(t)
}

fn as_json(r: &FitReport, toml: &str) -> Value {
    let numbers: Vec<Value> = r
        .numbers
        .iter()
        .map(|n| {
            json!({ "name": n.name, "unit": n.unit, "start": n.start, "value": n.value, "standard_error": n.standard_error,
                "on_bound": n.on_bound })
        })
        .collect();
    let rows: Vec<Value> = r
        .rows
        .iter()
        .map(|row| {
            let m = &row.measured;
            json!({ "line": row.line, "name": m.name(), "unit": m.table.unit(), "measured": m.value, "predicted": row.predicted,
                "sigma": m.sigma, "residual": row.residual })
        })
        .collect();
    let (extension, distance, film) = match r.focus {
        FocusSetting::Extension(e) => (Some(e), None, None),
        FocusSetting::Groups { distance, film } => (None, distance, Some(film)),
    };
    json!({
        "chi_squared": r.chi_squared[1], "chi_squared_of_start": r.chi_squared[0], "degrees_of_freedom": r.degrees_of_freedom,
        "reduced_chi_squared": r.reduced(), "numbers": numbers, "correlations": r.correlations,
        // JSON has no infinity: null where numbers cannot be told apart.
        "condition_number": r.condition, "rows": rows, "warnings": r.warnings, "iterations": r.iterations, "stop": r.stop.to_string(),
        "f_number": r.f_number, "fully_open": r.open, "extension_mm": extension, "focus_distance_mm": distance,
        "film_behind_focus_mm": film, "flags": flags(r), "note": film_note(r), "toml": toml,
    })
}

//! What a fit came to: the fitted lens, its numbers with standard errors, the rows, χ², and what to doubt.

use super::statistics::{deviations, spread};
use super::{FreeNumber, LensFit, Measured, Opening};
use crate::compound::{FilmPlace, configure};
use crate::optimise::Stop;
use crate::optimise::levenberg::Found;
use crate::prescription::{Prescription, PrescriptionError};
use crate::{Focus, LensError};

/// Two numbers with a correlation beyond this cannot be told apart.
const MOST_CORRELATION: f64 = 0.99;
/// So may derivatives with a condition number beyond this, however they are combined.
const MOST_CONDITION: f64 = 1e4;
/// χ² so many standard deviations above what is expected is not chance (1 of 10 000), and so far below it, the uncertainties are too large.
const MOST_DEVIATIONS: f64 = 3.7;
/// A residual beyond so many uncertainties is named.
const OUTLIER: f64 = 4.0;
/// Rows that a warning names.
const NAMED: usize = 5;

/// A free number before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberReport {
    /// What it is called.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Where it started.
    pub start: f64,
    /// What it came to.
    pub value: f64,
    /// Its standard error, by the uncertainties of the rows; `None` on a bound, and where the rows do not say.
    pub standard_error: Option<f64>,
    /// Whether it ends on a bound.
    pub on_bound: bool,
}

/// A row and what the fitted lens says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct RowReport {
    /// Line of the file.
    pub line: usize,
    /// What was measured.
    pub measured: Measured,
    /// What the fitted lens would read.
    pub predicted: f64,
    /// Predicted less measured, in uncertainties.
    pub residual: f64,
}

/// How the film stands, as it is set on a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FocusSetting {
    /// mm behind where the lens is focused at infinity.
    Extension(f64),
    /// A lens that focuses by its groups: focused at a distance (mm from the entrance pupil; `None` infinity), and the film so far behind that (mm), which no
    /// setting of a camera says.
    Groups {
        /// Distance in focus, mm.
        distance: Option<f64>,
        /// How far the film stands behind it, mm.
        film: f64,
    },
}

/// What a fit came to.
#[derive(Clone, Debug, PartialEq)]
pub struct FitReport {
    /// The fitted lens: scale, decentres, tilts and surfaces are in it.
    pub lens: Prescription,
    /// f-number; of a lens that is fully open, its widest.
    pub f_number: f64,
    /// Whether it is fully open.
    pub open: bool,
    /// How the film stands.
    pub focus: FocusSetting,
    /// Sum of the squares of the residuals, at the start (infinite where rows are not seen) and at the end.
    pub chi_squared: [f64; 2],
    /// Rows less numbers that are not held by a bound.
    pub degrees_of_freedom: usize,
    /// Free numbers in the order of the file.
    pub numbers: Vec<NumberReport>,
    /// Rows in the order of the file.
    pub rows: Vec<RowReport>,
    /// Correlation of each pair of numbers, `[number][number]`.
    pub correlations: Vec<Vec<f64>>,
    /// Condition number of the derivatives, their columns of length 1; infinite where numbers cannot be told apart.
    pub condition: f64,
    /// What to doubt, in sentences.
    pub warnings: Vec<String>,
    /// Steps that were taken.
    pub iterations: usize,
    /// Why it ended.
    pub stop: Stop,
}

impl FitReport {
    /// χ² for each degree of freedom; `None` without any.
    pub fn reduced(&self) -> Option<f64> {
        (self.degrees_of_freedom > 0).then(|| self.chi_squared[1] / self.degrees_of_freedom as f64)
    }
}

pub(super) fn report(fit: &LensFit, found: &Found, columns: &[Vec<f64>], open: Opening) -> Result<FitReport, LensError> {
    let x = &found.x;
    let on_bound: Vec<bool> = fit
        .free
        .iter()
        .zip(x)
        .map(|(f, v)| f.bounds.contains(v) || open == Opening::Full && f.number == FreeNumber::Aperture)
        .collect();
    let spread = spread(columns, &on_bound);
    let rows: Vec<RowReport> = fit
        .rows
        .iter()
        .zip(fit.predicted_at(x, open))
        .map(|(row, predicted)| {
            let predicted = predicted.unwrap_or(f64::NAN);
            let residual = (predicted - row.measured.value) / row.measured.sigma;
            RowReport { line: row.line, measured: row.measured, predicted, residual }
        })
        .collect();
    let numbers: Vec<NumberReport> = fit
        .free
        .iter()
        .enumerate()
        .map(|(i, f)| NumberReport {
            name: f.name(),
            unit: f.unit(),
            start: f.start,
            value: x[i],
            standard_error: spread.errors[i],
            on_bound: on_bound[i],
        })
        .collect();
    let held = on_bound.iter().filter(|b| **b).count() + spread.unseen.len();
    let degrees_of_freedom = rows.len().saturating_sub(numbers.len() - held);
    let start = super::merit(&fit.problem(Opening::FNumber), &fit.start_values());
    let mut r = FitReport {
        lens: finished(fit, found, degrees_of_freedom)?,
        f_number: f_number(fit, x, open),
        open: open == Opening::Full || fit.number(FreeNumber::Aperture).is_none() && fit.f_number.is_none(),
        focus: FocusSetting::Extension(0.0),
        chi_squared: [start, found.merit],
        degrees_of_freedom,
        numbers,
        rows,
        correlations: spread.correlations,
        condition: spread.condition,
        warnings: vec![],
        iterations: found.iterations,
        stop: found.stop,
    };
    r.focus = focus(fit, x, &r)?;
    r.warnings = warnings(&r, &spread.unseen);
    Ok(r)
}

fn f_number(fit: &LensFit, x: &[f64], open: Opening) -> f64 {
    match fit.number(FreeNumber::Aperture).filter(|_| open == Opening::FNumber) {
        Some(i) => x[i],
        None => fit.f_number.filter(|_| open == Opening::FNumber).unwrap_or(fit.widest),
    }
}

/// The fitted lens with its name and where it is from, checked.
fn finished(fit: &LensFit, found: &Found, degrees: usize) -> Result<Prescription, LensError> {
    let mut lens = super::free::lens_at(&fit.start, &fit.free, &found.x)?;
    lens.name = format!("{}, fitted", fit.start.name);
    let numbers: Vec<String> =
        fit.free.iter().zip(&found.x).map(|(f, v)| format!("{} {v:.6} {}", f.name(), f.unit()).trim_end().to_owned()).collect();
    lens.notes.push(format!(
        "fitted to {}: \"{}\" with {}; chi-squared {:.4} of {} rows, {degrees} degrees of freedom",
        fit.file,
        fit.start.name,
        numbers.join(", "),
        found.merit,
        fit.rows.len()
    ));
    lens.checked(&fit.file).map_err(|e| {
        let what = format!("the fitted lens cannot be built ({e}); expected narrower bounds of its free numbers");
        PrescriptionError::at(&fit.file, 0, what).into()
    })
}

/// How a camera is set to the fitted film.
fn focus(fit: &LensFit, x: &[f64], r: &FitReport) -> Result<FocusSetting, LensError> {
    let moved = fit.number(FreeNumber::Focus).map_or(0.0, |i| x[i]);
    let scale = fit.number(FreeNumber::Scale).map_or(1.0, |i| x[i]);
    let Some((lens, system)) = fit.system_at(x, if r.open { Opening::Full } else { Opening::FNumber }) else {
        return Ok(FocusSetting::Extension(moved));
    };
    let zoom = fit.zoom_mm.map(|f| f * scale);
    let aperture = (!r.open).then_some(r.f_number);
    let far = configure(&lens, zoom, aperture, None, FilmPlace::Focused(Focus::Infinity))?;
    let extension = (system.film_z - far.system.film_z) * system.film_run();
    match lens.has_focus_data() && (fit.state.focus != 0.0 || extension > 0.0) {
        true => Ok(FocusSetting::Groups { distance: fit.conditions.distance, film: moved }),
        false => Ok(FocusSetting::Extension(extension)),
    }
}

fn warnings(r: &FitReport, unseen: &[usize]) -> Vec<String> {
    let mut all = vec![];
    for i in unseen {
        all.push(format!("no row depends on {}: its value is that of the start", r.numbers[*i].name));
    }
    for (i, a) in r.numbers.iter().enumerate() {
        for (j, b) in r.numbers.iter().enumerate().skip(i + 1) {
            let c = r.correlations[i][j];
            if c.abs() > MOST_CORRELATION {
                let what = "the rows cannot tell them apart; hold one of them, or measure what only one of them changes";
                all.push(format!("{} and {} are correlated by {c:.4}: {what}", a.name, b.name));
            }
        }
    }
    if r.condition > MOST_CONDITION && !all.iter().any(|w| w.contains("correlated")) {
        let what = "some combination of the free numbers changes no row; hold one of them";
        all.push(format!("condition number {:.1e}: {what}", r.condition));
    }
    for n in r.numbers.iter().filter(|n| n.on_bound && !(r.open && n.name.starts_with("aperture"))) {
        all.push(format!("{} ends on its bound, {}: the rows may want it beyond", n.name, n.value));
    }
    if let Some(reduced) = r.reduced() {
        let off = deviations(r.chi_squared[1], r.degrees_of_freedom);
        let expected = (2.0 / r.degrees_of_freedom as f64).sqrt();
        if off > MOST_DEVIATIONS {
            all.push(format!(
                "chi-squared is {reduced:.3} for each degree of freedom, expected 1 ± {expected:.2}: within the stated uncertainties this lens, with these free \
                 numbers, is not the one that was measured (another design, something that is not free, or uncertainties that are too small; standard errors \
                 hold only where it is)"
            ));
        } else if off < -MOST_DEVIATIONS {
            all.push(format!(
                "chi-squared is {reduced:.3} for each degree of freedom, expected 1 ± {expected:.2}: the stated uncertainties are larger than what the rows \
                 scatter by"
            ));
        }
    }
    let mut far: Vec<&RowReport> = r.rows.iter().filter(|row| row.residual.abs() > OUTLIER).collect();
    far.sort_by(|a, b| b.residual.abs().total_cmp(&a.residual.abs()));
    if !far.is_empty() {
        let names: Vec<String> = far
            .iter()
            .take(NAMED)
            .map(|row| format!("{} (line {}, {:+.1})", row.measured.name(), row.line, row.residual))
            .collect();
        let what = format!("{} rows are off by more than {OUTLIER} uncertainties", far.len());
        all.push(format!("{what}: {}", names.join(", ")));
    }
    all
}

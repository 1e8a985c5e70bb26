//! A prescription fitted to measurements: which scale, f-number, film place, decentre and other free numbers make it do what was measured.
//!
//! A [`FitSheet`] holds tables of distortion, relative illumination and contrast, and heights of a calibrated camera; [`LensFit`] is a prescription
//! with it. What each row would read comes from the bench; residuals in units of their uncertainties go into the damped least squares of the
//! optimiser. Standard errors and χ²: `statistics.rs`.
//!
//! Limits: the film stays where the start is focused (scaled with the lens), moved by the free `focus` alone; field angles are those of chief rays;
//! distortion and illumination are those of one wavelength; a fully open lens is limited by its rims, so that light falls off alike for
//! many f-numbers near it: a free aperture is started from several.

mod free;
mod illumination;
mod predict;
mod report;
mod sheet;
mod statistics;
#[cfg(test)]
mod tests;

pub use free::{Free, FreeNumber};
pub use report::{FitReport, FocusSetting, NumberReport, RowReport};
pub use sheet::{
    AZIMUTH_DEG, CALIBRATION_SIGMA_PX, CONTRAST_SIGMA, CalibrationEntry, DISTORTION_SIGMA_PERCENT, EV_SIGMA, FitSheet,
    HEIGHT_SIGMA_MM, Origin, RELATIVE_SIGMA, SeenField,
};

use super::levenberg::{Found, Residuals, jacobian, levenberg_marquardt, merit};
use crate::compound::{Configured, FilmPlace, configure, opening, stop_radius, widest_f_number};
use crate::paraxial::FirstOrder;
use crate::prescription::{Prescription, PrescriptionError};
use crate::system::{State, System};
use crate::tolerance::colors_of;
use crate::{Focus, LensError};
use predict::{Conditions, Group, groups, predict};

/// f-numbers over the widest that a free aperture is started from, and how many of the best are followed to their end.
const STARTS: [f64; 8] = [1.0, 1.15, 1.4, 1.8, 2.4, 3.4, 4.8, 8.0];
const FOLLOWED: usize = 2;
/// Steps that the other numbers get before.
const BEFORE: usize = 8;
/// Rows that an error names.
const NAMED: usize = 8;
/// A number that moves no residual by this over all of its range is held at its start.
const LEAST_EFFECT: f64 = 1e-3;

/// Where something was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Field angle, degrees.
    Field(f64),
    /// Height on the film, mm.
    Height(f64),
}

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Table {
    /// Distortion, per cent.
    Percent,
    /// Height of an image, mm.
    Height,
    /// The same by a calibration, from the middle of the film.
    Calibrated,
    /// The same from the image of the axis.
    CalibratedFromAxis,
    /// Light over that in the middle.
    Relative,
    /// The same as a logarithm, EV.
    Ev,
    /// Contrast.
    Contrast {
        /// Cycles/mm.
        frequency: f64,
        /// Of detail along the direction of the field; else across it.
        tangential: bool,
    },
}

impl Table {
    fn is_illumination(self) -> bool {
        matches!(self, Table::Relative | Table::Ev)
    }

    /// Unit of the value; empty where it has none.
    pub fn unit(self) -> &'static str {
        match self {
            Table::Percent => "%",
            Table::Height | Table::Calibrated | Table::CalibratedFromAxis => "mm",
            Table::Ev => "EV",
            Table::Relative | Table::Contrast { .. } => "",
        }
    }
}

/// One measured value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// What.
    pub table: Table,
    /// Where.
    pub place: Place,
    /// Direction on the film, degrees from +x towards +y.
    pub azimuth_deg: f64,
    /// The value, in the unit of its table.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
}

impl Measured {
    /// What it is called: "distortion at 10°".
    pub fn name(&self) -> String {
        let what = match self.table {
            Table::Percent => "distortion".to_owned(),
            Table::Height => "image height".to_owned(),
            Table::Calibrated | Table::CalibratedFromAxis => "calibrated height".to_owned(),
            Table::Relative | Table::Ev => "illumination".to_owned(),
            Table::Contrast { frequency, tangential } => {
                format!("{} MTF {frequency} /mm", if tangential { "tangential" } else { "sagittal" })
            }
        };
        let place = match self.place {
            Place::Field(f) => format!("{}°", (f * 1e4).round() / 1e4),
            Place::Height(h) => format!("{h} mm"),
        };
        match self.azimuth_deg == AZIMUTH_DEG {
            true => format!("{what} at {place}"),
            false => format!("{what} at {place} along {}°", (self.azimuth_deg * 1e2).round() / 1e2),
        }
    }
}

/// A measured value and its line in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Line, counted from 1.
    pub line: usize,
    /// The value.
    pub measured: Measured,
}

/// A prescription with what was measured of a lens.
pub struct LensFit {
    start: Prescription,
    file: String,
    conditions: Conditions,
    rows: Vec<Row>,
    groups: Vec<Group>,
    free: Vec<Free>,
    state: State,
    zoom_mm: Option<f64>,
    /// Where the film stands behind its published place, along the light, when the start is focused, mm.
    film_offset: f64,
    /// f-number where it is not free; `None` fully open.
    f_number: Option<f64>,
    /// Whether fully open it is rims that limit the axial beam: beams beside the axis then fill the stop further.
    by_rims: bool,
    widest: f64,
}

/// How far the iris is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Opening {
    /// As the f-number says, free or set.
    FNumber,
    /// Fully, whatever the f-number.
    Full,
}

/// The fit as the least squares see it.
struct Problem<'a> {
    fit: &'a LensFit,
    bounds: Vec<[f64; 2]>,
    steps: Vec<f64>,
    open: Opening,
}

impl LensFit {
    /// Checks measurements against a lens. Fails on free numbers that the lens does not have, on settings that it cannot have, and names the rows that it does
    /// not see.
    pub fn new(lens: &Prescription, sheet: &FitSheet) -> Result<LensFit, LensError> {
        let wrong = |line: usize, what: String| LensError::from(PrescriptionError::at(&sheet.file, line, what));
        if lens.is_openings_alone() {
            return Err(wrong(0, format!("lens \"{}\": expected a lens with a focal length", lens.name)));
        }
        let focus = sheet.focus_m.map_or(Focus::Infinity, |d| Focus::at_mm(1000.0 * d));
        let aperture = sheet.aperture.or_else(|| lens.used_f_number());
        let place = FilmPlace::Focused(focus);
        let set = match configure(lens, sheet.focal_length, aperture, None, place) {
            // The lens's own aperture may be more than its rims let through.
            Err(_) if sheet.aperture.is_none() && aperture.is_some() => configure(lens, sheet.focal_length, None, None, place),
            other => other,
        }?;
        let Configured { system, state, efl, f_number, widest, .. } = set;
        let published = System::at(lens, state);
        let far = System::at(lens, State { focus: 0.0, ..state });
        let by_rims = widest_f_number(lens, &far, efl).is_some_and(|w| w.1);
        let (colors, reference) = colors_of(lens, sheet.wavelengths_nm.as_ref(), sheet.weights.as_ref());
        let nm = colors[reference].0;
        if system.indices(nm).iter().any(|n| !n.is_finite()) {
            return Err(wrong(0, format!("wavelength {nm} nm: expected one at which all glasses of the lens have an index")));
        }
        let usual = free::Usual { f_numbers: [f_number, widest], efl };
        let free = free::free_numbers(&sheet.variables, lens, &usual, &sheet.file)?;
        let rows = sheet.rows.clone();
        if rows.len() < free.len() {
            let what = format!("{} measurements for {} free numbers: expected at least as many", rows.len(), free.len());
            return Err(wrong(0, what));
        }
        let fit = LensFit {
            start: lens.clone(),
            file: sheet.file.clone(),
            conditions: Conditions {
                distance: match focus {
                    Focus::Distance(d) => Some(d.0),
                    _ => None,
                },
                colors,
                reference,
                origin: sheet.origin,
                focal_mm: sheet.distortion_focal_mm,
                geometric: sheet.geometric,
            },
            groups: groups(&rows),
            rows,
            free,
            state,
            zoom_mm: sheet.focal_length,
            film_offset: (system.film_z - published.film_z) * system.film_run(),
            f_number: (f_number > widest).then_some(f_number),
            by_rims,
            widest,
        };
        fit.check_field()?;
        Ok(fit)
    }

    /// Fails on rows that the start does not see.
    fn check_field(&self) -> Result<(), LensError> {
        let start = self.start_values();
        let Some((_, system)) = self.system_at(&start, Opening::FNumber) else {
            let what = "the lens at the start of its free numbers forms no image: expected other starts".to_owned();
            return Err(PrescriptionError::at(&self.file, 0, what).into());
        };
        let found = predict(&system, &self.conditions, &self.rows, &self.groups);
        let dark = |(row, value): &(&Row, Option<f64>)| match row.measured.table {
            Table::Relative => !value.is_some_and(|v| v > 0.0),
            Table::Ev => !value.is_some_and(|v| v > -15.5),
            _ => value.is_none(),
        };
        let unseen: Vec<&Row> = self.rows.iter().zip(found).filter(dark).map(|(row, _)| row).collect();
        let Some(first) = unseen.first() else { return Ok(()) };
        let mut names: Vec<String> =
            unseen.iter().take(NAMED).map(|r| format!("{} (line {})", r.measured.name(), r.line)).collect();
        if unseen.len() > NAMED {
            names.push(format!("and {} more", unseen.len() - NAMED));
        }
        let radius = self.start.image_circle.map_or(1.5 * FirstOrder::of(&system, &system.reference_indices()).efl, |c| c);
        let bench = crate::analysis::Bench::at_infinity(&system);
        let reach = bench.field_of_height(radius);
        let what = format!(
            "the lens does not see {} of {} rows: {}; expected places within its field (chief rays come through to {reach:.1}°, rims may stop \
             them before), or a larger start of the scale",
            unseen.len(),
            self.rows.len(),
            names.join(", ")
        );
        Err(PrescriptionError::at(&self.file, first.line, what).into())
    }

    /// What is free.
    pub fn free(&self) -> &[Free] {
        &self.free
    }

    /// What was measured.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    fn start_values(&self) -> Vec<f64> {
        self.free.iter().map(|f| f.start).collect()
    }

    fn number(&self, number: FreeNumber) -> Option<usize> {
        self.free.iter().position(|f| f.number == number)
    }

    /// The lens at given values, and as it stands. `None` where it forms no image.
    fn system_at(&self, x: &[f64], open: Opening) -> Option<(Prescription, System)> {
        let lens = free::lens_at(&self.start, &self.free, x).ok()?;
        let far = System::at(&lens, State { focus: 0.0, ..self.state });
        let efl = FirstOrder::of(&far, &far.reference_indices()).efl;
        if !(efl > 1e-3 && efl < 1e6) {
            return None;
        }
        let rim = far.iris.radius;
        let f_number = match self.number(FreeNumber::Aperture) {
            Some(i) => Some(x[i]),
            None => self.f_number,
        };
        let radius = match f_number.filter(|_| open == Opening::FNumber) {
            Some(n) => stop_radius(&far, efl, n)?.min(rim),
            None if self.by_rims => rim,
            None => stop_radius(&far, efl, self.widest)?.min(rim),
        };
        let mut system = System::at(&lens, self.state);
        system.iris = opening(system.iris.shape.clone(), radius, rim);
        let value = |number: FreeNumber, otherwise: f64| self.number(number).map_or(otherwise, |i| x[i]);
        let moved = self.film_offset * value(FreeNumber::Scale, 1.0) + value(FreeNumber::Focus, 0.0);
        system.film_z += moved * system.film_run();
        ((system.film_z - system.last_z()) * system.film_run() > 0.0).then_some((lens, system))
    }

    /// What each row would read of the lens with given free numbers, in their order; `None` where it does not see the place.
    pub fn predicted(&self, x: &[f64]) -> Vec<Option<f64>> {
        self.predicted_at(x, Opening::FNumber)
    }

    fn predicted_at(&self, x: &[f64], open: Opening) -> Vec<Option<f64>> {
        match self.system_at(x, open) {
            Some((_, system)) => predict(&system, &self.conditions, &self.rows, &self.groups),
            None => vec![None; self.rows.len()],
        }
    }

    fn problem(&self, open: Opening) -> Problem<'_> {
        let (bounds, steps) = (self.free.iter().map(|f| f.bounds).collect(), self.free.iter().map(|f| f.step).collect());
        Problem { fit: self, bounds, steps, open }
    }

    /// Numbers that no row depends on: rounding alone would move them. The f-number of a fully open lens is not among them, since farther stopped down rows
    /// may depend on it.
    fn without_effect(&self) -> Vec<usize> {
        let (problem, start) = (self.problem(Opening::FNumber), self.start_values());
        let Some(here) = problem.at(&start) else { return vec![] };
        let columns = jacobian(&problem, &start, &here);
        let effect = |i: usize| {
            let [low, high] = self.free[i].bounds;
            columns[i].iter().map(|v| v * v).sum::<f64>().sqrt() * (high - low)
        };
        (0..self.free.len()).filter(|i| self.free[*i].number != FreeNumber::Aperture && effect(*i) < LEAST_EFFECT).collect()
    }

    /// Fits, in at most `iterations` steps from each start. Fails where no lens was found that sees all rows, or the result cannot be built.
    pub fn run(&self, iterations: usize) -> Result<FitReport, LensError> {
        let start = self.start_values();
        let unseen = self.without_effect();
        let prepared = |open: Opening| {
            let mut problem = self.problem(open);
            unseen.iter().for_each(|i| problem.bounds[*i] = [start[*i]; 2]);
            if open == Opening::Full
                && let Some(a) = self.number(FreeNumber::Aperture)
            {
                problem.bounds[a] = [self.widest; 2];
            }
            problem
        };
        let mut best: Option<(Found, Opening)> = None;
        let mut keep = |found: Option<Found>, open: Opening| {
            if let Some(found) = found
                && best.as_ref().is_none_or(|b| found.merit < b.0.merit)
            {
                best = Some((found, open));
            }
        };
        let problem = prepared(Opening::FNumber);
        match self.number(FreeNumber::Aperture) {
            None => keep(levenberg_marquardt(&problem, &start, iterations), Opening::FNumber),
            Some(a) => {
                // The others first, as well as they can be known at the f-number of the start.
                let mut held = prepared(Opening::FNumber);
                held.bounds[a] = [start[a]; 2];
                let others = match self.free.len() {
                    1 => start.clone(),
                    _ => levenberg_marquardt(&held, &start, BEFORE.min(iterations)).map_or(start.clone(), |f| f.x),
                };
                let [low, high] = self.free[a].bounds;
                let at = |f_number: f64| {
                    let mut x = others.clone();
                    x[a] = f_number.clamp(low, high);
                    x
                };
                let mut starts: Vec<(f64, Vec<f64>)> =
                    STARTS.iter().map(|k| at(k * self.widest)).chain([at(start[a])]).map(|x| (merit(&problem, &x), x)).collect();
                starts.sort_by(|p, q| p.0.total_cmp(&q.0));
                starts.dedup_by(|p, q| p.1 == q.1);
                for (_, x) in starts.iter().take(FOLLOWED) {
                    keep(levenberg_marquardt(&problem, x, iterations), Opening::FNumber);
                }
                if self.by_rims && low <= self.widest {
                    keep(levenberg_marquardt(&prepared(Opening::Full), &at(self.widest), iterations), Opening::Full);
                }
            }
        }
        let Some((found, open)) = best else {
            let what = "no lens was found that sees all rows: expected fewer rows near the edge of the field, or other starts";
            return Err(PrescriptionError::at(&self.file, 0, what).into());
        };
        let problem = prepared(open);
        let here = problem.at(&found.x).unwrap_or_default();
        let columns = jacobian(&problem, &found.x, &here);
        report::report(self, &found, &columns, open)
    }
}

impl Residuals for Problem<'_> {
    fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
        let predicted = self.fit.predicted_at(x, self.open);
        self.fit.rows.iter().zip(predicted).map(|(row, value)| Some((value? - row.measured.value) / row.measured.sigma)).collect()
    }

    fn bounds(&self) -> &[[f64; 2]] {
        &self.bounds
    }

    fn steps(&self) -> &[f64] {
        &self.steps
    }
}

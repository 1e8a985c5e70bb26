//! The free numbers of a fit: what of a lens may differ from its prescription, within which bounds.

use super::sheet::FreeEntry;
use crate::optimise::sheet::{self, Surfaces, surfaces_of};
use crate::optimise::{Freedom, Variable, set_value, step_of, value_of};
use crate::prescription::{Misalignment, Prescription, PrescriptionError};
use crate::tolerance::Axis;
use diopter_light::names::nearest;

/// Names of free numbers; aspheric powers have any number.
const NAMES: [&str; 12] = [
    "scale",
    "aperture",
    "focus",
    "decenter x",
    "decenter y",
    "tilt x",
    "tilt y",
    "curvature",
    "gap",
    "conic",
    "index",
    "asphere 4",
];
/// Usual bounds: of the scale, of decentres (mm) and tilts (degrees), of the film (fraction of the focal length); largest f-number.
const SCALE: [f64; 2] = [0.5, 2.0];
const DECENTER: f64 = 2.0;
const TILT: f64 = 3.0;
const FOCUS: f64 = 0.05;
const LARGEST_F_NUMBER: f64 = 64.0;
/// Steps of the central differences: what predictions change by there is well above what their quadratures are off by (1e-5), and their third
/// derivatives are well below.
const SCALE_STEP: f64 = 1e-4;
const F_NUMBER_STEP: f64 = 2e-3;
const FOCUS_STEP: f64 = 2e-3;
const DECENTER_STEP: f64 = 5e-3;
const TILT_STEP: f64 = 5e-3;
const SAG_STEP: f64 = 5e-4;
/// Most free numbers.
const MOST: usize = 64;

/// Which number. Surfaces are counted from 0 here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FreeNumber {
    /// Factor of all lengths.
    Scale,
    /// f-number.
    Aperture,
    /// How far the film stands behind where the lens is focused, mm.
    Focus,
    /// Shift of surfaces together, mm.
    Decenter {
        /// First surface.
        first: usize,
        /// Last surface.
        last: usize,
        /// Along which axis.
        axis: Axis,
    },
    /// Turn of surfaces together about the vertex of the first, degrees.
    Tilt {
        /// First surface.
        first: usize,
        /// Last surface.
        last: usize,
        /// About which axis.
        axis: Axis,
    },
    /// A variable of the optimiser.
    Surface(Freedom),
}

/// A free number with its range.
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Which.
    pub number: FreeNumber,
    /// Where it starts.
    pub start: f64,
    /// Smallest and largest value.
    pub bounds: [f64; 2],
    /// Step of the derivatives.
    pub(super) step: f64,
}

impl Free {
    /// What it is called.
    pub fn name(&self) -> String {
        let axis = |a: Axis| if a == Axis::X { "x" } else { "y" };
        match self.number {
            FreeNumber::Scale => "scale".into(),
            FreeNumber::Aperture => "aperture (f-number)".into(),
            FreeNumber::Focus => "focus (film)".into(),
            FreeNumber::Decenter { first, last, axis: a } => format!("decenter {} of {}-{}", axis(a), first + 1, last + 1),
            FreeNumber::Tilt { first, last, axis: a } => format!("tilt {} of {}-{}", axis(a), first + 1, last + 1),
            FreeNumber::Surface(freedom) => Variable { freedom, bounds: self.bounds }.name(),
        }
    }

    /// Its unit; empty where it has none.
    pub fn unit(&self) -> &'static str {
        match self.number {
            FreeNumber::Scale | FreeNumber::Aperture => "",
            FreeNumber::Focus | FreeNumber::Decenter { .. } | FreeNumber::Surface(Freedom::Gap { .. }) => "mm",
            FreeNumber::Tilt { .. } => "°",
            FreeNumber::Surface(Freedom::Curvature { .. }) => "1/mm",
            FreeNumber::Surface(_) => "",
        }
    }
}

/// What usual values depend on.
pub(super) struct Usual {
    /// f-number as set, and the widest.
    pub f_numbers: [f64; 2],
    /// Focal length, mm.
    pub efl: f64,
}

/// The free numbers of a file in a lens, checked.
pub(super) fn free_numbers(
    entries: &[(usize, FreeEntry)],
    p: &Prescription,
    usual: &Usual,
    file: &str,
) -> Result<Vec<Free>, PrescriptionError> {
    let mut all: Vec<Free> = vec![];
    for (line, entry) in entries {
        let wrong = |what: String| PrescriptionError::at(file, *line, what);
        for free in one(entry, p, usual).map_err(wrong)? {
            let name = free.name();
            if all.iter().any(|f| f.number == free.number) {
                return Err(wrong(format!("{name}: it is free already; expected each once")));
            }
            let [low, high] = free.bounds;
            if !(low < high && low.is_finite() && high.is_finite()) {
                return Err(wrong(format!("{name}: bounds {low} to {high}: expected min below max")));
            }
            if !(free.start >= low && free.start <= high) {
                return Err(wrong(format!(
                    "{name} starts at {}: expected a start within its bounds, {low} to {high}",
                    free.start
                )));
            }
            if free.number == FreeNumber::Scale && !(low > 0.0) {
                return Err(wrong(format!("scale from {low}: expected bounds above 0")));
            }
            all.push(free);
        }
    }
    match all.len() {
        1..=MOST => Ok(all),
        count => Err(PrescriptionError::at(file, 0, format!("{count} free numbers apply to the lens: expected 1 to {MOST}"))),
    }
}

/// The numbers of one entry.
fn one(entry: &FreeEntry, p: &Prescription, usual: &Usual) -> Result<Vec<Free>, String> {
    let what = entry.what.as_str();
    let [f_number, widest] = usual.f_numbers;
    let with = |number: FreeNumber, start: f64, [low, high]: [f64; 2], step: f64| {
        let bounds = [entry.min.unwrap_or(low), entry.max.unwrap_or(high)];
        vec![Free { number, start: entry.start.unwrap_or(start), bounds, step }]
    };
    let whole = |free: Vec<Free>| match &entry.surfaces {
        None => Ok(free),
        Some(_) => Err(format!("{what}: expected no surfaces: it is of the whole lens")),
    };
    let axis = || if what.ends_with('x') { Axis::X } else { Axis::Y };
    match what {
        "scale" => whole(with(FreeNumber::Scale, 1.0, SCALE, SCALE_STEP)),
        "aperture" => {
            if let Some(low) = entry.min.filter(|low| *low < widest) {
                return Err(format!("aperture from f/{low}: expected f/{widest:.4} or more: the lens opens no wider"));
            }
            let mut free = with(FreeNumber::Aperture, f_number, [widest, LARGEST_F_NUMBER], F_NUMBER_STEP * f_number);
            // A lens is called a little faster than it is.
            free[0].start = free[0].start.max(free[0].bounds[0]);
            whole(free)
        }
        "focus" => {
            let reach = FOCUS * usual.efl.abs();
            whole(with(FreeNumber::Focus, 0.0, [-reach, reach], FOCUS_STEP))
        }
        "decenter x" | "decenter y" => {
            let [first, last] = group(entry, p)?;
            let number = FreeNumber::Decenter { first, last, axis: axis() };
            Ok(with(number, 0.0, [-DECENTER, DECENTER], DECENTER_STEP))
        }
        "tilt x" | "tilt y" => {
            let [first, last] = group(entry, p)?;
            Ok(with(FreeNumber::Tilt { first, last, axis: axis() }, 0.0, [-TILT, TILT], TILT_STEP))
        }
        _ => surface_numbers(entry, p),
    }
}

/// Variables as a merit file has them.
fn surface_numbers(entry: &FreeEntry, p: &Prescription) -> Result<Vec<Free>, String> {
    let what = entry.what.as_str();
    let known = NAMES[7..].contains(&what) || what.starts_with("asphere ");
    if !known {
        let near = nearest(what, NAMES).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
        return Err(format!("what = \"{what}\": expected {}{near}", NAMES.join(", ")));
    }
    if entry.start.is_some() {
        return Err(format!("{what}: expected no start: it starts where the prescription has it"));
    }
    let Some(variable) = entry.of_surfaces() else {
        return Err(format!("{what}: expected surfaces: a number, a list of numbers or \"all\""));
    };
    let (surfaces, named) = surfaces_of(&variable.surfaces, p)?;
    let mut all = vec![];
    for i in surfaces {
        let Some(Variable { freedom, bounds }) = sheet::variable(&variable, i, named, p)? else { continue };
        let (start, step) = (value_of(p, freedom), step_of(p, freedom, SAG_STEP));
        all.push(Free { number: FreeNumber::Surface(freedom), start, bounds, step });
    }
    Ok(all)
}

/// First and last surface of what moves together.
fn group(entry: &FreeEntry, p: &Prescription) -> Result<[usize; 2], String> {
    let count = p.surfaces.len();
    let expected = format!("expected the first and the last surface of a group, such as [1, {count}], or no surfaces");
    let checked = |first: usize, last: usize| match first >= 1 && first <= last && last <= count {
        true => Ok([first - 1, last - 1]),
        false => Err(format!("{}: surfaces {first} to {last}: {expected}", entry.what)),
    };
    match &entry.surfaces {
        None => Ok([0, count - 1]),
        Some(Surfaces::Word(w)) if w == "all" => Ok([0, count - 1]),
        Some(Surfaces::One(n)) => checked(*n, *n),
        Some(Surfaces::List(list)) if list.len() == 2 => checked(list[0], list[1]),
        Some(_) => Err(format!("{}: {expected}", entry.what)),
    }
}

/// The lens with free numbers at given values. Fails where a length leaves the range it may have.
pub(super) fn lens_at(start: &Prescription, free: &[Free], x: &[f64]) -> Result<Prescription, PrescriptionError> {
    let value = |number: FreeNumber| free.iter().position(|f| f.number == number).map(|i| x[i]);
    let mut lens = match value(FreeNumber::Scale) {
        Some(scale) if scale != 1.0 => start.scaled(scale)?,
        _ => start.clone(),
    };
    let mut moved: Vec<Misalignment> = vec![];
    for (f, value) in free.iter().zip(x) {
        match f.number {
            FreeNumber::Surface(freedom) => set_value(&mut lens, freedom, *value),
            FreeNumber::Decenter { first, last, axis } | FreeNumber::Tilt { first, last, axis } if *value != 0.0 => {
                let found = moved.iter().position(|m| (m.first, m.last) == (first, last));
                let at = found.unwrap_or_else(|| {
                    moved.push(Misalignment { first, last, decenter: [0.0; 3], tilt: [0.0; 3] });
                    moved.len() - 1
                });
                match f.number {
                    FreeNumber::Decenter { .. } => moved[at].decenter[(axis == Axis::Y) as usize] = *value,
                    _ => moved[at].tilt[(axis == Axis::Y) as usize] = *value,
                }
            }
            _ => {}
        }
    }
    lens.misalignments.append(&mut moved);
    Ok(lens)
}

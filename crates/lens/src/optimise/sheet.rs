//! The merit file: TOML into what may change, and what is wanted.
//!
//! ```toml
//! lens = "double-gauss-50mm"
//! aperture = 2.8                  # or entrance_pupil = 18 (mm): round beams, vignetting = [0, 0.1, 0.3] for the fields
//! fields_deg = [0, 10, 14]
//! wavelengths_nm = [486.1, 587.6, 656.3]
//!
//! [[variable]]
//! surfaces = [1, 2, 3]            # or "all", or one number
//! what = "curvature"              # 1/mm; or gap (mm), conic, index, "asphere 4"
//! min = -0.05
//! max = 0.05
//!
//! [[variable]]
//! surfaces = [1, 3]               # before glass
//! what = "glass"
//! from = "schott"                 # a vendor, or names of glasses and vendors: ["N-BK7", "ohara"]; schott without
//!
//! [[operand]]
//! kind = "spot"                   # µm, RMS, of each field; or wavefront (waves), distortion (%), chief_angle (degrees on the film),
//!                                 # efl, bfl, length, thickness, edge (mm)
//! weight = 1
//!
//! [[operand]]
//! kind = "efl"
//! target = 50                     # or at_least, at_most
//! weight = 100
//!
//! [[operand]]
//! kind = "edge"                   # at the smaller of the two rims
//! surfaces = "all"
//! at_least = 0.8
//! weight = 100
//!
//! [[operand]]
//! kind = "mtf"                    # target 1 without
//! frequency = 30                  # cycles/mm
//! direction = "sagittal"          # or tangential; both without
//! weight = 1000
//! ```
//!
//! The merit is the sum of weight × (value − target)² over all operands; one within its bounds counts nothing.

use super::glass::GlassChoice;
use super::problem::{Freedom, Operand, OperandKind, Variable, Wanted};
use crate::prescription::{Prescription, PrescriptionError};
use crate::surface::Profile;
use crate::tolerance::{Direction, check_list, check_weights};
use crate::toml_place::line_of;
use diopter_light::names::{in_words, nearest};
use serde::Deserialize;
use toml::Spanned;

/// Highest power of an aspheric term, as prescriptions have it.
const HIGHEST_POWER: usize = 40;
/// Most variables, and most operands.
const MOST: usize = 1000;
/// What is written of a variable that is a choice.
const GLASS: &str = "glass";
/// Whose glasses are taken by default.
const USUAL_VENDOR: &str = "schott";

/// A merit file as it was read; surfaces are checked with the lens ([`super::Optimisation::new`]).
#[derive(Clone, Debug)]
pub struct MeritSheet {
    /// Name in errors.
    pub(super) file: String,
    /// The lens to start from: a name or a file.
    pub lens: Option<String>,
    /// Seed of the global search.
    pub seed: u64,
    /// f-number of the start, whose beams are kept; as the lens says, or fully open, without.
    pub aperture: Option<f64>,
    /// Where a zoom is set, mm.
    pub focal_length: Option<f64>,
    /// Diameter of round beams instead, mm.
    pub entrance_pupil: Option<f64>,
    /// By which fraction the beam of each field is narrower in the field's direction.
    pub vignetting: Option<Vec<f64>>,
    /// Field angles, degrees.
    pub fields_deg: Option<Vec<f64>>,
    /// Wavelengths, nm.
    pub wavelengths_nm: Option<Vec<f64>>,
    /// Their weights.
    pub weights: Option<Vec<f64>>,
    variables: Vec<(usize, VariableEntry)>,
    operands: Vec<(usize, OperandEntry)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    lens: Option<String>,
    seed: Option<u64>,
    aperture: Option<f64>,
    focal_length: Option<f64>,
    entrance_pupil: Option<f64>,
    vignetting: Option<Vec<f64>>,
    fields_deg: Option<Vec<f64>>,
    wavelengths_nm: Option<Vec<f64>>,
    weights: Option<Vec<f64>>,
    #[serde(default)]
    variable: Vec<Spanned<VariableEntry>>,
    #[serde(default)]
    operand: Vec<Spanned<OperandEntry>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VariableEntry {
    pub surfaces: Surfaces,
    pub what: String,
    pub min: Option<f64>,
    pub max: Option<f64>,
    pub from: Option<Names>,
}

/// One name or several.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "from: expected a vendor, or a list of vendors and glasses")]
pub(super) enum Names {
    One(String),
    List(Vec<String>),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct OperandEntry {
    kind: String,
    #[serde(default = "one")]
    weight: f64,
    field_deg: Option<f64>,
    surfaces: Option<Surfaces>,
    target: Option<f64>,
    at_least: Option<f64>,
    at_most: Option<f64>,
    frequency: Option<f64>,
    direction: Option<Direction>,
}

fn one() -> f64 {
    1.0
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "surfaces: expected \"all\", a number or a list of numbers")]
pub(super) enum Surfaces {
    Word(String),
    One(usize),
    List(Vec<usize>),
}

impl MeritSheet {
    /// Reads a merit file; `file` is its name in errors. Fails, with the line where there is one, on other keys than these and on
    /// numbers out of their ranges.
    pub fn parse(text: &str, file: &str) -> Result<MeritSheet, PrescriptionError> {
        let sheet: File = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(0, |s| line_of(text, s.start));
            PrescriptionError::at(file, line, in_words(e.message()).trim().replace('\n', " "))
        })?;
        let wrong = |what: String| PrescriptionError::at(file, 0, what);
        check_list(file, "fields_deg", sheet.fields_deg.as_ref(), [-120.0, 120.0])?;
        check_list(file, "wavelengths_nm", sheet.wavelengths_nm.as_ref(), [100.0, 20_000.0])?;
        check_list(file, "vignetting", sheet.vignetting.as_ref(), [0.0, 0.99])?;
        if sheet.weights.is_some() && sheet.wavelengths_nm.is_none() {
            return Err(wrong("weights without wavelengths_nm: expected both, or neither".into()));
        }
        check_weights(file, sheet.weights.as_ref(), sheet.wavelengths_nm.as_ref().map_or(0, Vec::len))?;
        match (sheet.entrance_pupil, &sheet.vignetting, sheet.aperture) {
            (Some(d), ..) if !(d > 0.0 && d < 1e5) => {
                return Err(wrong(format!("entrance_pupil {d}: expected a diameter in mm")));
            }
            (Some(_), _, Some(_)) => return Err(wrong("entrance_pupil and aperture: expected one of them".into())),
            (None, Some(_), _) => return Err(wrong("vignetting without entrance_pupil: expected both, or neither".into())),
            (Some(_), Some(v), _) if Some(v.len()) != sheet.fields_deg.as_ref().map(Vec::len) => {
                return Err(wrong(format!("vignetting of {} numbers: expected one for each of fields_deg", v.len())));
            }
            _ => {}
        }
        if sheet.variable.is_empty() || sheet.operand.is_empty() {
            let what =
                "expected at least one [[variable]], such as { surfaces = \"all\", what = \"curvature\" }, and one [[operand]]";
            return Err(wrong(format!("{} variables, {} operands: {what}", sheet.variable.len(), sheet.operand.len())));
        }
        Ok(MeritSheet {
            file: file.into(),
            lens: sheet.lens,
            seed: sheet.seed.unwrap_or(1),
            aperture: sheet.aperture,
            focal_length: sheet.focal_length,
            entrance_pupil: sheet.entrance_pupil,
            vignetting: sheet.vignetting,
            fields_deg: sheet.fields_deg,
            wavelengths_nm: sheet.wavelengths_nm,
            weights: sheet.weights,
            variables: sheet.variable.into_iter().map(|v| (line_of(text, v.span().start), v.into_inner())).collect(),
            operands: sheet.operand.into_iter().map(|o| (line_of(text, o.span().start), o.into_inner())).collect(),
        })
    }

    /// The variables in a lens, with their bounds.
    pub(super) fn variables(&self, p: &Prescription) -> Result<Vec<Variable>, PrescriptionError> {
        let mut all: Vec<Variable> = vec![];
        for (line, entry) in &self.variables {
            let wrong = |what: String| PrescriptionError::at(&self.file, *line, what);
            if entry.what == GLASS {
                continue;
            }
            let (surfaces, named) = surfaces_of(&entry.surfaces, p).map_err(wrong)?;
            for i in surfaces {
                let Some(variable) = variable(entry, i, named, p).map_err(wrong)? else { continue };
                if all.iter().any(|v| v.freedom == variable.freedom) {
                    return Err(wrong(format!("{}: it is a variable already; expected each once", variable.name())));
                }
                let start = super::value_of(p, variable.freedom);
                let [low, high] = variable.bounds;
                if !(low < high && low.is_finite() && high.is_finite()) {
                    return Err(wrong(format!("{}: bounds {low} to {high}: expected min below max", variable.name())));
                }
                if !(start >= low && start <= high) {
                    let what = format!("{} is {start}: expected a start within its bounds, {low} to {high}", variable.name());
                    return Err(wrong(what));
                }
                all.push(variable);
            }
        }
        if all.is_empty() || all.len() > MOST {
            let what = format!("{} variables apply to the lens: expected 1 to {MOST}", all.len());
            return Err(PrescriptionError::at(&self.file, 0, what));
        }
        Ok(all)
    }

    /// Which glasses may be chosen, and from what.
    pub(super) fn glasses(&self, p: &Prescription, wavelengths_nm: &[f64]) -> Result<Vec<GlassChoice>, PrescriptionError> {
        let mut all: Vec<GlassChoice> = vec![];
        for (line, entry) in self.variables.iter().filter(|v| v.1.what == GLASS) {
            let wrong = |what: String| PrescriptionError::at(&self.file, *line, what);
            if entry.min.is_some() || entry.max.is_some() {
                return Err(wrong("min and max of a glass: expected \"from\" instead, a vendor or a list".into()));
            }
            let (surfaces, named) = surfaces_of(&entry.surfaces, p).map_err(wrong)?;
            let names = match &entry.from {
                None => vec![USUAL_VENDOR.to_owned()],
                Some(Names::One(name)) => vec![name.clone()],
                Some(Names::List(names)) => names.clone(),
            };
            for i in surfaces {
                let s = &p.surfaces[i];
                let is_glass = s.glass != crate::glass::Glass::air() && !s.mirror && s.gradient.is_none();
                match (is_glass, named) {
                    (true, _) => {}
                    (false, true) => {
                        return Err(wrong(format!("glass after surface {}: expected a surface before glass", i + 1)));
                    }
                    (false, false) => continue,
                }
                let index = Freedom::Index { surface: i };
                let taken = |(_, v): &(usize, VariableEntry)| {
                    v.what == "index" && surfaces_of(&v.surfaces, p).is_ok_and(|(list, _)| list.contains(&i))
                };
                if all.iter().any(|g| g.surface == i) || self.variables.iter().any(taken) {
                    let name = Variable { freedom: index, bounds: [0.0; 2] }.name();
                    return Err(wrong(format!(
                        "glass after surface {}: its {name} is a variable already; expected one of them",
                        i + 1
                    )));
                }
                all.push(GlassChoice::new(i, &names, wavelengths_nm).map_err(wrong)?);
            }
        }
        Ok(all)
    }

    /// The operands, one a field or surface.
    pub(super) fn operands(&self, p: &Prescription, fields_deg: &[f64]) -> Result<Vec<Operand>, PrescriptionError> {
        let mut all = vec![];
        for (line, entry) in &self.operands {
            let wrong = |what: String| PrescriptionError::at(&self.file, *line, what);
            let position = OperandKind::NAMES.iter().position(|n| *n == entry.kind).ok_or_else(|| {
                let near = nearest(&entry.kind, OperandKind::NAMES).map(|n| format!(" (did you mean \"{n}\"?)"));
                wrong(format!("kind \"{}\": expected {}{}", entry.kind, OperandKind::NAMES.join(", "), near.unwrap_or_default()))
            })?;
            let kind = OperandKind::ALL[position];
            if !(entry.weight > 0.0 && entry.weight < 1e15) {
                return Err(wrong(format!("weight {}: expected a number above 0", entry.weight)));
            }
            if [entry.target, entry.at_least, entry.at_most].iter().flatten().any(|v| !v.is_finite()) {
                return Err(wrong(format!("{}: expected finite numbers", entry.kind)));
            }
            let wanted = match (entry.target, entry.at_least, entry.at_most) {
                (Some(t), None, None) => Wanted::Target(t),
                (Some(_), ..) => return Err(wrong(format!("{}: expected target, or at_least and at_most", entry.kind))),
                (None, None, None) if kind == OperandKind::Mtf => Wanted::Target(1.0),
                (None, None, None) if kind.of_field() => Wanted::Target(0.0),
                (None, None, None) => return Err(wrong(format!("{}: expected target, at_least or at_most", entry.kind))),
                (None, low, high) => {
                    let bounds = [low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY)];
                    if bounds[0] > bounds[1] {
                        return Err(wrong(format!("at_least {}: expected no more than at_most {}", bounds[0], bounds[1])));
                    }
                    Wanted::Within(bounds)
                }
            };
            if kind == OperandKind::Efl && wanted == Wanted::Target(0.0) {
                return Err(wrong("efl target 0: expected a focal length in mm".into()));
            }
            if entry.field_deg.is_some() && !kind.of_field() || entry.surfaces.is_some() && !kind.of_surface() {
                let what =
                    "field_deg goes with spot, wavefront, distortion, chief_angle and mtf, surfaces with thickness and edge";
                return Err(wrong(format!("{}: expected no such key: {what}", entry.kind)));
            }
            let details = match (kind, entry.frequency, entry.direction) {
                (OperandKind::Mtf, Some(f), direction) if f > 0.0 && f < 1e5 => {
                    let both = [Direction::Tangential, Direction::Sagittal];
                    both.into_iter().filter(|d| direction.is_none_or(|asked| asked == *d)).map(|d| Some((f, d))).collect()
                }
                (OperandKind::Mtf, Some(f), _) => return Err(wrong(format!("frequency {f}: expected cycles/mm above 0"))),
                (OperandKind::Mtf, None, _) => return Err(wrong("mtf: expected a frequency, in cycles/mm".into())),
                (_, None, None) => vec![None],
                _ => return Err(wrong(format!("{}: frequency and direction go with mtf", entry.kind))),
            };
            let fields: Vec<Option<usize>> = match (kind.of_field(), entry.field_deg) {
                (false, _) => vec![None],
                (true, None) => (0..fields_deg.len())
                    // On the axis there is nothing to distort.
                    .filter(|f| kind != OperandKind::Distortion || super::has_distortion(fields_deg[*f]))
                    .map(Some)
                    .collect(),
                (true, Some(asked)) => match fields_deg.iter().position(|f| (f - asked).abs() < 1e-9) {
                    Some(f) if kind == OperandKind::Distortion && !super::has_distortion(fields_deg[f]) => {
                        return Err(wrong(format!("distortion at {asked}°: expected an angle beside the axis, below 89°")));
                    }
                    Some(f) => vec![Some(f)],
                    None => return Err(wrong(format!("field_deg {asked}: expected one of the fields {fields_deg:?}"))),
                },
            };
            let surfaces: Vec<Option<usize>> = match kind.of_surface() {
                false => vec![None],
                true => {
                    let all = Surfaces::Word("all".into());
                    let (list, named) = surfaces_of(entry.surfaces.as_ref().unwrap_or(&all), p).map_err(wrong)?;
                    let last = p.surfaces.len() - 1;
                    let edge = kind == OperandKind::Edge;
                    if named && edge && list.contains(&last) {
                        let what = "expected a surface before it: the film has no rim";
                        return Err(wrong(format!("edge after surface {}, the last: {what}", last + 1)));
                    }
                    // The plane of a stop in air may lie within the sag of its neighbours.
                    let stop = |i: usize| p.surfaces[i].stop && p.surfaces[i].profile == Profile::Plane;
                    let counts = |i: &usize| named || *i < last && !(edge && (stop(*i) || stop(*i + 1)));
                    list.into_iter().filter(counts).map(Some).collect()
                }
            };
            for field in &fields {
                for surface in &surfaces {
                    for detail in &details {
                        let (field, surface, detail) = (*field, *surface, *detail);
                        all.push(Operand { kind, field, surface, detail, wanted, weight: entry.weight });
                    }
                }
            }
        }
        if all.is_empty() || all.len() > MOST {
            let what = format!("{} operands apply to the lens: expected 1 to {MOST}", all.len());
            return Err(PrescriptionError::at(&self.file, 0, what));
        }
        Ok(all)
    }
}

/// Surfaces (0 the first), and whether they were named by their numbers.
pub(super) fn surfaces_of(which: &Surfaces, p: &Prescription) -> Result<(Vec<usize>, bool), String> {
    let count = p.surfaces.len();
    let number = |n: &usize| match (1..=count).contains(n) {
        true => Ok(n - 1),
        false => Err(format!("surface {n}: expected 1 to {count}")),
    };
    match which {
        Surfaces::Word(w) if w == "all" => Ok(((0..count).collect(), false)),
        Surfaces::Word(w) => Err(format!("surfaces \"{w}\": expected \"all\", a number or a list of numbers")),
        Surfaces::One(n) => Ok((vec![number(n)?], true)),
        Surfaces::List(list) => Ok((list.iter().map(number).collect::<Result<_, _>>()?, true)),
    }
}

/// A variable of a surface; `None` where "all" means surfaces that do not have it.
pub(super) fn variable(entry: &VariableEntry, i: usize, named: bool, p: &Prescription) -> Result<Option<Variable>, String> {
    if entry.from.is_some() {
        return Err(format!("from with what = \"{}\": it goes with what = \"glass\"", entry.what));
    }
    let s = &p.surfaces[i];
    let air = |gap: usize| gap == 0 || p.surfaces[gap - 1].glass == crate::glass::Glass::air();
    let acts = s.mirror || !(air(i) && air(i + 1));
    let reach = s.semi_diameter.unwrap_or(1.0);
    let simple = matches!(s.profile, Profile::Plane | Profile::Sphere(_) | Profile::Conic { .. } | Profile::Asphere(_));
    let start = |freedom: Freedom| super::value_of(p, freedom);
    let (freedom, usual, applies, expected) = match entry.what.as_str() {
        // Short of a hemisphere.
        "curvature" => (Freedom::Curvature { surface: i }, [-0.9 / reach, 0.9 / reach], acts, "a surface between two media"),
        "gap" => {
            let freedom = Freedom::Gap { surface: i };
            let start = start(freedom);
            let far = 3.0 * start.abs() + 10.0;
            let usual = if start >= 0.0 { [start.min(0.05), far] } else { [-far, -0.05f64.min(-start)] };
            // A cemented or a dummy surface keeps its contact.
            (freedom, usual, named || start != 0.0, "a gap")
        }
        "conic" => {
            let curved = s.profile.curvature() != 0.0 && simple;
            (Freedom::Conic { surface: i }, [-20.0, 20.0], acts && curved, "a curved surface that is the same from all sides")
        }
        "index" => (Freedom::Index { surface: i }, [1.43, 2.0], !air(i + 1) && !s.mirror, "a surface before glass"),
        other => {
            let power = other.strip_prefix("asphere ").and_then(|t| t.trim().parse::<usize>().ok());
            let Some(power) = power.filter(|p| (2..=HIGHEST_POWER).contains(p)) else {
                return Err(format!(
                    "what = \"{other}\": expected curvature, gap, conic, index or \"asphere 4\" (2 to {HIGHEST_POWER}); in merit files glass, too"
                ));
            };
            // As much as a fifth of the radius at the rim.
            let most = 0.2 * reach.powi(1 - power as i32);
            let freedom = Freedom::Asphere { surface: i, power };
            (freedom, [-most, most], acts && simple, "a surface that is the same from all sides")
        }
    };
    if !applies {
        return if named { Err(format!("{} of surface {}: expected {expected}", entry.what, i + 1)) } else { Ok(None) };
    }
    // What is not said holds the start in any case.
    let value = start(freedom);
    let bounds = [entry.min.unwrap_or(usual[0].min(value)), entry.max.unwrap_or(usual[1].max(value))];
    Ok(Some(Variable { freedom, bounds }))
}

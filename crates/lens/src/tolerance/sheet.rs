//! The tolerance sheet: TOML into what may differ from the design, by how much, and what is asked of the result.
//!
//! ```toml
//! lens = "double-gauss-50mm"
//! seed = 1
//! aperture = 2.8
//! fields_deg = [-14, -10, 0, 10, 14]
//! wavelengths_nm = [486.1, 587.6, 656.3]
//! frequencies = [30]                 # cycles/mm
//!
//! [compensator]
//! refocus = 0.3                      # the film moves by up to 0.3 mm to the smallest spots
//! gap = [{ surface = 5, by = 0.2 }]  # so do gaps, and elements across the axis or about it
//! decenter = [{ element = [7, 9], by = "0.1 mm" }]
//!
//! [[tolerance]]
//! surfaces = "all"                   # or 3, or [1, 2]
//! radius = "0.1%"                    # or "0.02 mm", "3 fringes"
//! form = "3/3(1)"                    # ISO 10110-5: power and irregularity in fringes; or "3/820(270) nm"
//! thickness = "0.03 mm"
//! index = "NP050"                    # ISO 12123: 50e-5; or 0.0005
//! abbe = "AN5"                       # ISO 12123: 0.5 %; or "0.5%"
//! centring = "4/1'"                  # ISO 10110-6: tilt of the surface; or wedge = "1 arcmin"
//!
//! [[tolerance]]
//! elements = "all"                   # what is cemented is one; or [[1, 2], [3, 5]]
//! decenter = "0.02 mm"
//! tilt = "1.5 arcmin"
//! distribution = "normal"            # or "uniform", "ends"
//!
//! [[limit]]
//! quantity = "mtf"
//! field_deg = 10                     # all fields without; so frequency, and direction (tangential, sagittal)
//! at_least = 0.4
//! ```

use super::amount::{Amount, Unit, amount};
use super::compensator::Compensators;
use super::parameter::{Axis, Change, Distribution, FRINGE_NM, Parameter, elements_of};
use super::passes::Passes;
use super::quantity::{Direction, Limit, QuantityKind};
use crate::glass::GlassKind;
use crate::prescription::{Prescription, PrescriptionError};
use crate::surface::Profile;
use crate::toml_place::line_of;
use diopter_light::names::{in_words, nearest};
use serde::Deserialize;
use toml::Spanned;

/// Most perturbations of a sheet.
const MOST_PARAMETERS: usize = 10_000;
/// Most fields, wavelengths or frequencies.
const MOST_POINTS: usize = 50;

/// A tolerance sheet as it was read; which surfaces it names is checked with the lens ([`super::Toleranced::new`]).
#[derive(Clone, Debug)]
pub struct ToleranceSheet {
    /// Name in errors.
    pub(super) file: String,
    /// The lens it is for: a name or a file.
    pub lens: Option<String>,
    /// Which builds are drawn.
    pub seed: u64,
    /// f-number; as the lens says, or fully open, without.
    pub aperture: Option<f64>,
    /// Where a zoom is set, mm.
    pub focal_length: Option<f64>,
    /// Field angles, degrees; those of the lens without.
    pub fields_deg: Option<Vec<f64>>,
    /// Wavelengths, nm; those of the lens, or F, d and C, without.
    pub wavelengths_nm: Option<Vec<f64>>,
    /// Weights of the wavelengths; all the same without.
    pub weights: Option<Vec<f64>>,
    /// Spatial frequencies of the MTF, cycles/mm.
    pub frequencies: Vec<f64>,
    /// How far the film may move to the smallest spots, mm, either way; `None`: it stands.
    pub refocus: Option<f64>,
    compensators: Compensators,
    /// The sheet as it was written, for the lines of errors.
    text: String,
    pub(super) limits: Vec<Limit>,
    entries: Vec<(usize, Entry)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    lens: Option<String>,
    #[serde(default = "first_seed")]
    seed: u64,
    aperture: Option<f64>,
    focal_length: Option<f64>,
    fields_deg: Option<Vec<f64>>,
    wavelengths_nm: Option<Vec<f64>>,
    weights: Option<Vec<f64>>,
    #[serde(default = "usual_frequencies")]
    frequencies: Vec<f64>,
    #[serde(default)]
    compensator: Compensators,
    #[serde(default)]
    tolerance: Vec<Spanned<Entry>>,
    #[serde(default)]
    limit: Vec<Spanned<LimitEntry>>,
}

fn first_seed() -> u64 {
    1
}

fn usual_frequencies() -> Vec<f64> {
    vec![30.0]
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    surfaces: Option<Surfaces>,
    elements: Option<Elements>,
    radius: Option<Amount>,
    form: Option<String>,
    irregularity: Option<Amount>,
    thickness: Option<Amount>,
    index: Option<Amount>,
    abbe: Option<Amount>,
    wedge: Option<Amount>,
    centring: Option<String>,
    decenter: Option<Amount>,
    tilt: Option<Amount>,
    #[serde(default)]
    distribution: Distribution,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "surfaces: expected \"all\", a number or a list of numbers")]
enum Surfaces {
    Word(String),
    One(usize),
    List(Vec<usize>),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "elements: expected \"all\" or a list of first and last surfaces, such as [[1, 2], [3, 5]]")]
enum Elements {
    Word(String),
    List(Vec<[usize; 2]>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitEntry {
    quantity: String,
    field_deg: Option<f64>,
    frequency: Option<f64>,
    direction: Option<Direction>,
    at_least: Option<f64>,
    at_most: Option<f64>,
}

/// The grade behind letters: "NP050" → 50.
fn grade(text: &Amount, letters: &str) -> Option<f64> {
    let Amount::Text(t) = text else { return None };
    let digits = t.trim().strip_prefix(letters)?;
    (!digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())).then(|| digits.parse().ok())?
}

/// Fails unless all numbers of a list are within a range.
pub(crate) fn check_list(file: &str, key: &str, list: Option<&Vec<f64>>, [low, high]: [f64; 2]) -> Result<(), PrescriptionError> {
    let Some(list) = list else { return Ok(()) };
    if list.is_empty() || list.len() > MOST_POINTS {
        return Err(PrescriptionError::at(file, 0, format!("{key} of {} numbers: expected 1 to {MOST_POINTS}", list.len())));
    }
    match list.iter().find(|v| !(**v >= low && **v <= high)) {
        Some(bad) => Err(PrescriptionError::at(file, 0, format!("{key} {bad}: expected {low} to {high}"))),
        None => Ok(()),
    }
}

/// Fails unless there are as many weights, 0 or more and not all 0, as wavelengths.
pub(crate) fn check_weights(file: &str, weights: Option<&Vec<f64>>, wavelengths: usize) -> Result<(), PrescriptionError> {
    let Some(w) = weights else { return Ok(()) };
    if w.len() != wavelengths || w.iter().any(|w| !(*w >= 0.0 && w.is_finite())) || !(w.iter().sum::<f64>() > 0.0) {
        let what = format!("weights {w:?}: expected {wavelengths} numbers from 0, one for each of wavelengths_nm");
        return Err(PrescriptionError::at(file, 0, what));
    }
    Ok(())
}

impl ToleranceSheet {
    /// Reads a sheet; `file` is its name in errors. Fails, with the line where there is one, on other keys than these and on
    /// numbers out of their ranges.
    pub fn parse(text: &str, file: &str) -> Result<ToleranceSheet, PrescriptionError> {
        let sheet: File = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(0, |s| line_of(text, s.start));
            PrescriptionError::at(file, line, in_words(e.message()).trim().replace('\n', " "))
        })?;
        let wrong = |what: String| PrescriptionError::at(file, 0, what);
        check_list(file, "fields_deg", sheet.fields_deg.as_ref(), [-120.0, 120.0])?;
        check_list(file, "wavelengths_nm", sheet.wavelengths_nm.as_ref(), [100.0, 20_000.0])?;
        check_list(file, "frequencies", Some(&sheet.frequencies), [1e-6, 10_000.0])?;
        if sheet.weights.is_some() && sheet.wavelengths_nm.is_none() {
            return Err(wrong("weights without wavelengths_nm: expected both, or neither".into()));
        }
        check_weights(file, sheet.weights.as_ref(), sheet.wavelengths_nm.as_ref().map_or(0, Vec::len))?;
        if let Some(r) = sheet.compensator.refocus.filter(|r| !(*r > 0.0 && *r < 1000.0)) {
            return Err(wrong(format!("[compensator] refocus {r}: expected how far the film may move, above 0 to 1000 mm")));
        }
        if sheet.tolerance.is_empty() {
            let what = "no [[tolerance]]: expected at least one, such as { surfaces = \"all\", radius = \"0.1%\" }";
            return Err(wrong(what.into()));
        }
        let limits = sheet
            .limit
            .into_iter()
            .map(|l| {
                let line = line_of(text, l.span().start);
                limit(l.into_inner(), line).map_err(|what| PrescriptionError::at(file, line, what))
            })
            .collect::<Result<_, _>>()?;
        Ok(ToleranceSheet {
            file: file.into(),
            lens: sheet.lens,
            seed: sheet.seed,
            aperture: sheet.aperture,
            focal_length: sheet.focal_length,
            fields_deg: sheet.fields_deg,
            wavelengths_nm: sheet.wavelengths_nm,
            weights: sheet.weights,
            frequencies: sheet.frequencies,
            refocus: sheet.compensator.refocus,
            compensators: sheet.compensator,
            text: text.into(),
            limits,
            entries: sheet.tolerance.into_iter().map(|e| (line_of(text, e.span().start), e.into_inner())).collect(),
        })
    }

    /// What is adjusted in every build of a lens beside its film.
    pub(super) fn compensators(&self, p: &Prescription) -> Result<Vec<Parameter>, PrescriptionError> {
        self.compensators.parameters(p, &self.file, &self.text)
    }

    /// What the sheet allows to differ in a lens: each perturbation by itself, in the order of the sheet.
    pub(super) fn parameters(&self, p: &Prescription) -> Result<Vec<Parameter>, PrescriptionError> {
        let mut all = vec![];
        for (line, entry) in &self.entries {
            let mut found = vec![];
            expand(entry, p, &mut found).map_err(|what| PrescriptionError::at(&self.file, *line, what))?;
            if found.is_empty() {
                let what = "nothing in this [[tolerance]] applies to the lens: expected an amount for radius, form, irregularity, \
                            thickness, index, abbe, wedge, centring, decenter or tilt";
                return Err(PrescriptionError::at(&self.file, *line, what));
            }
            all.append(&mut found);
            if all.len() > MOST_PARAMETERS {
                let what = format!("more than {MOST_PARAMETERS} perturbations: expected fewer surfaces or kinds");
                return Err(PrescriptionError::at(&self.file, *line, what));
            }
        }
        Ok(all)
    }
}

fn limit(l: LimitEntry, line: usize) -> Result<Limit, String> {
    let kind = QuantityKind::parse(&l.quantity).ok_or_else(|| {
        let hint = nearest(&l.quantity, QuantityKind::NAMES.iter().copied()).map(|n| format!(" (did you mean \"{n}\"?)"));
        format!("quantity \"{}\": expected {}{}", l.quantity, QuantityKind::NAMES.join(", "), hint.unwrap_or_default())
    })?;
    if l.at_least.is_none() && l.at_most.is_none() {
        return Err(format!("limit of {}: expected at_least, at_most or both", l.quantity));
    }
    if [l.at_least, l.at_most].iter().flatten().any(|v| !v.is_finite()) {
        return Err(format!("limit of {}: expected finite numbers", l.quantity));
    }
    Ok(Limit {
        line,
        kind,
        field_deg: l.field_deg,
        frequency: l.frequency,
        direction: l.direction,
        at_least: l.at_least,
        at_most: l.at_most,
    })
}

/// The surfaces an entry names (0 the first), and whether each was named by its number.
fn surfaces_of(which: Option<&Surfaces>, p: &Prescription) -> Result<(Vec<usize>, bool), String> {
    let count = p.surfaces.len();
    let number = |n: &usize| match (1..=count).contains(n) {
        true => Ok(n - 1),
        false => Err(format!("surface {n}: expected 1 to {count}")),
    };
    match which {
        None => Ok(((0..count).collect(), false)),
        Some(Surfaces::Word(w)) if w == "all" => Ok(((0..count).collect(), false)),
        Some(Surfaces::Word(w)) => Err(format!("surfaces \"{w}\": expected \"all\", a number or a list of numbers")),
        Some(Surfaces::One(n)) => Ok((vec![number(n)?], true)),
        Some(Surfaces::List(list)) => Ok((list.iter().map(number).collect::<Result<_, _>>()?, true)),
    }
}

/// Expands an entry into perturbations of the lens.
fn expand(entry: &Entry, p: &Prescription, out: &mut Vec<Parameter>) -> Result<(), String> {
    let (surfaces, named) = surfaces_of(entry.surfaces.as_ref(), p)?;
    let distribution = entry.distribution;
    let mut push = |change: Change, half_range: f64, part: Option<Axis>| {
        // A tolerance of 0 is a surface that is taken as perfect.
        if half_range > 0.0 {
            out.push(Parameter { change, half_range, distribution, part });
        }
    };
    let is_air = |gap: usize| gap == 0 || p.surfaces[gap - 1].glass.kind == GlassKind::Air;
    // A surface that neither refracts nor reflects cannot be made wrongly.
    let acts = |i: usize| p.surfaces[i].mirror || !(is_air(i) && is_air(i + 1));
    let radius_of = |i: usize| p.surfaces[i].semi_diameter.unwrap_or(0.0);
    // Curvature change of so many fringes over the clear aperture: Δc = N λ / h² (sag of half a wave a fringe; Smith, "Modern Optical
    // Engineering", ch. 15).
    let curvature_of_fringes = |i: usize, fringes: f64| fringes * FRINGE_NM * 1e-6 / radius_of(i).powi(2);
    let (mut power, mut irregular) = (None, None);
    if let Some(text) = &entry.form {
        let wrong = || {
            let example =
                "power and irregularity as ISO 10110-5 writes them, in fringes \"3/3(1)\" (up to 50) or \"3/820(270) nm\"";
            format!("form \"{text}\": expected {example}")
        };
        let body = text.trim().strip_prefix("3/").ok_or_else(wrong)?;
        // A fringe is half a wave of the surface; drawings since 2015 are in nm.
        let (body, fringe) = match body.strip_suffix("nm") {
            Some(body) => (body.trim_end(), 0.5 * FRINGE_NM),
            None => (body, 1.0),
        };
        let (a, b) = match body.split_once('(') {
            Some((a, b)) => (a, Some(b.strip_suffix(')').ok_or_else(wrong)?)),
            None => (body, None),
        };
        let number = |t: &str| match t.trim() {
            // Nothing is said.
            "-" | "–" | "" => Ok(None),
            t => t.parse::<f64>().ok().map(|v| v / fringe).filter(|v| *v >= 0.0 && *v <= 50.0).map(Some).ok_or_else(wrong),
        };
        power = number(a)?;
        irregular = b.map_or(Ok(None), number)?;
    }
    if let Some(a) = &entry.irregularity {
        let (v, _) = amount("irregularity", a, Unit::Fringes, &[Unit::Fringes], "fringes, such as \"1 fringe\"")?;
        irregular = Some(v);
    }
    // The second pass of light through a face or a thickness has the error of the first.
    let passes = Passes::of(p);
    let of_faces: Vec<usize> = surfaces.iter().copied().filter(|i| acts(*i) && (named || passes.is_first_of_face(*i))).collect();
    let again = |what: &str, i: usize, first: usize| {
        format!("{what} {}: light passes it again, expected its first pass, {}", i + 1, first + 1)
    };
    let is_of_faces =
        entry.radius.is_some() || power.is_some() || irregular.is_some() || entry.wedge.is_some() || entry.centring.is_some();
    if let Some(&i) = of_faces.iter().find(|i| is_of_faces && !passes.is_first_of_face(**i)) {
        return Err(again("surface", i, passes.face(i)));
    }
    for &i in &of_faces {
        let c = p.surfaces[i].profile.curvature();
        if let Some(a) = &entry.radius {
            let units = [Unit::Millimeters, Unit::Percent, Unit::Fringes];
            let (v, unit) =
                amount("radius", a, Unit::Millimeters, &units, "an amount such as \"0.1%\", \"0.02 mm\" or \"3 fringes\"")?;
            match unit {
                Unit::Fringes => push(Change::Curvature { surface: i }, curvature_of_fringes(i, v), None),
                _ if c == 0.0 && named => {
                    return Err(format!("radius of surface {}, a plane: expected fringes, such as \"3 fringes\"", i + 1));
                }
                _ if c == 0.0 => {}
                unit => {
                    let half = if unit == Unit::Percent { 0.01 * v / c.abs() } else { v };
                    if half >= 0.5 / c.abs() {
                        let what = "expected less than half of the radius";
                        return Err(format!(
                            "radius tolerance {half} mm of surface {} (radius {:.4} mm): {what}",
                            i + 1,
                            1.0 / c
                        ));
                    }
                    push(Change::Radius { surface: i }, half, None);
                }
            }
        }
        if let Some(fringes) = power {
            push(Change::Curvature { surface: i }, curvature_of_fringes(i, fringes), None);
        }
        if let Some(fringes) = irregular {
            let simple = matches!(p.surfaces[i].profile, Profile::Plane | Profile::Sphere(_) | Profile::Conic { .. });
            if !simple && named {
                return Err(format!("irregularity of surface {}: expected a plane, sphere or conic", i + 1));
            }
            if simple {
                for axis in [Axis::X, Axis::Y] {
                    push(Change::Irregularity { surface: i, axis }, fringes, Some(axis));
                }
            }
        }
        let mut tilt = None;
        if let Some(a) = &entry.wedge {
            tilt = Some(amount("wedge", a, Unit::Degrees, &[Unit::Degrees], "an angle, such as \"1 arcmin\"")?.0);
        }
        if let Some(text) = &entry.centring {
            let angle = text.trim().strip_prefix("4/").map(|t| Amount::Text(t.into()));
            let example = "the tilt of the surface as ISO 10110-6 writes it: \"4/1'\"";
            let angle = angle.ok_or_else(|| format!("centring \"{text}\": expected {example}"))?;
            // A bare number is in minutes, as the standard has it.
            tilt = Some(match &angle {
                Amount::Text(t) if t.trim().parse::<f64>().is_ok_and(|v| (0.0..60.0).contains(&v)) => {
                    t.trim().parse::<f64>().unwrap_or(0.0) / 60.0
                }
                other => amount("centring 4/", other, Unit::Degrees, &[Unit::Degrees], example)?.0,
            });
        }
        if let Some(degrees) = tilt {
            for axis in [Axis::X, Axis::Y] {
                push(Change::SurfaceTilt { surface: i, axis }, degrees, Some(axis));
            }
        }
    }
    for &i in &surfaces {
        let s = &p.surfaces[i];
        if let Some(a) = &entry.thickness {
            let (v, _) = amount("thickness", a, Unit::Millimeters, &[Unit::Millimeters], "a length, such as \"0.03 mm\"")?;
            // The film is set by focusing; a lens of one surface has no thickness.
            let film = i + 1 == p.surfaces.len();
            if film && named {
                let what = "expected a surface before it (the film's place is a matter of focus: [compensator] refocus)";
                return Err(format!("thickness after surface {}, the last: {what}", i + 1));
            }
            let least = s.gap.values.iter().flatten().map(|g| g.abs()).fold(f64::INFINITY, f64::min);
            let stop = |i: usize| p.surfaces.get(i).is_some_and(|s| s.stop && s.profile == Profile::Plane);
            // A gap of 0 is contact or a dummy plane: there is nothing to get wrong.
            if !film && least > 0.0 && (named || passes.is_first_of_gap(i)) {
                if !passes.is_first_of_gap(i) {
                    return Err(again("gap after surface", i, passes.gap(i)));
                }
                if v >= least && !stop(i) && !stop(i + 1) {
                    let what = "expected less than the gap: the surfaces would meet";
                    return Err(format!("thickness tolerance {v} mm of the gap of {least} mm after surface {}: {what}", i + 1));
                }
                push(Change::Gap { surface: i }, v, None);
            }
        }
        let glass = &s.glass;
        if entry.index.is_none() && entry.abbe.is_none() {
            continue;
        }
        if glass.kind == GlassKind::Air || s.mirror {
            if named {
                return Err(format!("index or abbe of the gap after surface {}: expected glass, found air", i + 1));
            }
            continue;
        }
        if let Some(a) = &entry.index {
            let v = match grade(a, "NP") {
                Some(g) => g * 1e-5,
                None => amount("index", a, Unit::Bare, &[Unit::Bare], "a number such as 0.0005, or a grade such as \"NP050\"")?.0,
            };
            if v >= 0.1 {
                return Err(format!("index tolerance {v}: expected less than 0.1"));
            }
            push(Change::Index { surface: i }, v, None);
        }
        if let Some(a) = &entry.abbe {
            let percent = match grade(a, "AN") {
                Some(g) => 0.1 * g,
                None => amount("abbe", a, Unit::Percent, &[Unit::Percent], "\"0.5%\" or a grade such as \"AN5\"")?.0,
            };
            if percent >= 50.0 {
                return Err(format!("abbe tolerance {percent}%: expected less than 50%"));
            }
            match glass.abbe().is_finite() {
                true => push(Change::Abbe { surface: i }, 0.01 * percent, None),
                false if named => {
                    return Err(format!(
                        "abbe of surface {}: its glass {} has no dispersion; expected one with an Abbe number",
                        i + 1,
                        glass.written()
                    ));
                }
                false => {}
            }
        }
    }
    if entry.decenter.is_none() && entry.tilt.is_none() {
        if entry.elements.is_some() {
            return Err("elements without decenter or tilt: expected one of them, or surfaces".into());
        }
        return Ok(());
    }
    let elements: Vec<[usize; 2]> = match &entry.elements {
        Some(Elements::Word(w)) if w != "all" => {
            return Err(format!("elements \"{w}\": expected \"all\" or a list such as [[1, 2], [3, 5]]"));
        }
        Some(Elements::List(list)) => list
            .iter()
            .map(|[first, last]| match 1 <= *first && first <= last && *last <= p.surfaces.len() {
                true => Ok([first - 1, last - 1]),
                false => Err(format!("element [{first}, {last}]: expected first and last of 1 to {}", p.surfaces.len())),
            })
            .collect::<Result<_, _>>()?,
        _ => elements_of(p),
    };
    let decenter = entry
        .decenter
        .as_ref()
        .map(|a| amount("decenter", a, Unit::Millimeters, &[Unit::Millimeters], "a length, such as \"0.02 mm\""))
        .transpose()?;
    let tilt = entry
        .tilt
        .as_ref()
        .map(|a| amount("tilt", a, Unit::Degrees, &[Unit::Degrees], "an angle, such as \"1 arcmin\""))
        .transpose()?;
    for [first, last] in elements {
        let [from, to] = passes.whole([first, last]);
        if [from, to] != [first, last] {
            let whole = format!("expected [{}, {}], with all passes of light through its faces", from + 1, to + 1);
            return Err(format!("element [{}, {}]: a part of a glass, {whole}", first + 1, last + 1));
        }
        for axis in [Axis::X, Axis::Y] {
            if let Some((v, _)) = decenter {
                push(Change::Decenter { first, last, axis }, v, Some(axis));
            }
        }
        for axis in [Axis::X, Axis::Y] {
            if let Some((v, _)) = tilt {
                push(Change::Tilt { first, last, axis }, v, Some(axis));
            }
        }
    }
    Ok(())
}

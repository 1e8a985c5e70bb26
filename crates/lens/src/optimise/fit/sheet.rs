//! The file of measurements: TOML into what was measured, and what of the lens is free.
//!
//! ```toml
//! lens = "double-gauss-50mm"      # the prescription that the fit starts from
//! aperture = 2.8                  # f-number as measured, or where a free one starts; fully open without
//! focus_m = 3                     # distance that was in focus, from the entrance pupil; infinity without
//! focal_length = 35               # where a zoom stood, mm
//! wavelengths_nm = [486.1, 587.6, 656.3]
//!
//! [[variable]]
//! what = "scale"                  # of all lengths; aperture (f-number), focus (mm of film behind where the lens is focused), "decenter x",
//! start = 1.02                    # "decenter y" (mm), "tilt x", "tilt y" (degrees); or curvature, gap, conic ... as in a merit file
//! min = 0.9
//! max = 1.1
//!
//! [[variable]]
//! what = "decenter y"
//! surfaces = [6, 11]              # from the first to the last; the whole lens without
//!
//! [distortion]
//! focal_length_mm = 50            # that per cents are held against; the fitted lens's own without
//! origin = "principal point"      # where heights count from: the image of the axis, or "film middle"
//! rows = [
//!   { field_deg = 10, percent = -0.6 },
//!   { height_mm = 8.9, percent = -0.6, sigma = 0.05 },
//!   { field_deg = 10, height_mm = 8.9, azimuth_deg = 90 },
//! ]
//!
//! [vignetting]
//! rows = [ { height_mm = 10, relative = 0.8 }, { height_mm = 20, ev = -1.2, sigma = 0.1 } ]
//!
//! [mtf]
//! geometric = false               # without diffraction
//! rows = [ { height_mm = 10, frequency = 30, sagittal = 0.6, tangential = 0.5 } ]
//!
//! [calibration]
//! file = "camera.yaml"            # whoever reads this file makes rows of it
//! film_mm = [36, 24]              # what its pixels cover, where it does not say it
//! ```
//!
//! `sigma` of a row, or of its table, is the standard uncertainty of what was measured, in its unit. `azimuth_deg`: direction on the film, from +x
//! towards +y of the lens axes (the picture on the film is upside down); +y without.

use super::{Measured, Place, Row, Table};
use crate::optimise::sheet::{Surfaces, VariableEntry};
use crate::prescription::PrescriptionError;
use crate::tolerance::{check_list, check_weights};
use crate::toml_place::line_of;
use diopter_light::names::in_words;
use serde::Deserialize;
use toml::Spanned;

/// Uncertainties by default: of distortion in per cent and in mm, of relative illumination, in EV, and of contrast.
pub const DISTORTION_SIGMA_PERCENT: f64 = 0.1;
/// See [`DISTORTION_SIGMA_PERCENT`].
pub const HEIGHT_SIGMA_MM: f64 = 0.02;
/// See [`DISTORTION_SIGMA_PERCENT`].
pub const RELATIVE_SIGMA: f64 = 0.02;
/// See [`DISTORTION_SIGMA_PERCENT`].
pub const EV_SIGMA: f64 = 0.05;
/// See [`DISTORTION_SIGMA_PERCENT`].
pub const CONTRAST_SIGMA: f64 = 0.03;
/// Uncertainty of a calibration by default, pixels.
pub const CALIBRATION_SIGMA_PX: f64 = 0.5;
/// Direction on the film by default, degrees: +y.
pub const AZIMUTH_DEG: f64 = 90.0;

/// Most rows of all tables.
const MOST_ROWS: usize = 5000;
/// Farthest from the axis that something is measured, mm, and highest frequency, cycles/mm.
const LARGEST_HEIGHT: f64 = 1e4;
const HIGHEST_FREQUENCY: f64 = 1e4;

/// What heights count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum Origin {
    /// The image of the axis.
    #[default]
    #[serde(rename = "principal point")]
    PrincipalPoint,
    /// The middle of the film, which a decentred lens does not aim at.
    #[serde(rename = "film middle")]
    FilmMiddle,
}

/// A calibration that the file names.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationEntry {
    /// Line of the file.
    pub line: usize,
    /// The file, beside this one.
    pub file: String,
    /// Width and height of the film that its pixels cover, mm.
    pub film_mm: Option<[f64; 2]>,
    /// What its heights count from.
    pub origin: Origin,
    /// Uncertainty of a place in the picture, pixels.
    pub sigma_px: f64,
}

/// A file of measurements as it was read; variables are checked with the lens ([`super::LensFit::new`]).
#[derive(Clone, Debug)]
pub struct FitSheet {
    /// Name in errors.
    pub(super) file: String,
    /// The lens to start from: a name or a file.
    pub lens: Option<String>,
    /// f-number as set, or where a free one starts; fully open without.
    pub aperture: Option<f64>,
    /// Distance in focus, m; `None` for infinity.
    pub focus_m: Option<f64>,
    /// Where a zoom stood, mm.
    pub focal_length: Option<f64>,
    /// Wavelengths, nm.
    pub wavelengths_nm: Option<Vec<f64>>,
    /// Their weights.
    pub weights: Option<Vec<f64>>,
    /// Focal length that per cents are held against, mm.
    pub(super) distortion_focal_mm: Option<f64>,
    /// What the heights of the distortion table count from.
    pub(super) origin: Origin,
    /// Whether contrasts are those of spots alone.
    pub(super) geometric: bool,
    /// A calibration, whose rows come by [`FitSheet::add`].
    pub calibration: Option<CalibrationEntry>,
    pub(super) variables: Vec<(usize, FreeEntry)>,
    pub(super) rows: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    lens: Option<String>,
    aperture: Option<f64>,
    focus_m: Option<f64>,
    focal_length: Option<f64>,
    wavelengths_nm: Option<Vec<f64>>,
    weights: Option<Vec<f64>>,
    #[serde(default)]
    variable: Vec<Spanned<FreeEntry>>,
    distortion: Option<DistortionTable>,
    vignetting: Option<VignettingTable>,
    mtf: Option<MtfTable>,
    calibration: Option<Spanned<CalibrationTable>>,
}

/// A free number as the file says it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FreeEntry {
    pub what: String,
    pub surfaces: Option<Surfaces>,
    pub start: Option<f64>,
    pub min: Option<f64>,
    pub max: Option<f64>,
}

impl FreeEntry {
    /// The same as a merit file has it.
    pub fn of_surfaces(&self) -> Option<VariableEntry> {
        Some(VariableEntry {
            surfaces: self.surfaces.clone()?,
            what: self.what.clone(),
            min: self.min,
            max: self.max,
            from: None,
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DistortionTable {
    focal_length_mm: Option<f64>,
    #[serde(default)]
    origin: Origin,
    sigma_percent: Option<f64>,
    sigma_mm: Option<f64>,
    rows: Vec<Spanned<DistortionRow>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DistortionRow {
    field_deg: Option<f64>,
    height_mm: Option<f64>,
    percent: Option<f64>,
    azimuth_deg: Option<f64>,
    sigma: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VignettingTable {
    sigma: Option<f64>,
    sigma_ev: Option<f64>,
    rows: Vec<Spanned<VignettingRow>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VignettingRow {
    height_mm: f64,
    relative: Option<f64>,
    ev: Option<f64>,
    azimuth_deg: Option<f64>,
    sigma: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MtfTable {
    #[serde(default)]
    geometric: bool,
    sigma: Option<f64>,
    rows: Vec<Spanned<MtfRow>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MtfRow {
    height_mm: f64,
    frequency: f64,
    sagittal: Option<f64>,
    tangential: Option<f64>,
    azimuth_deg: Option<f64>,
    sigma: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationTable {
    file: String,
    film_mm: Option<[f64; 2]>,
    #[serde(default)]
    origin: Origin,
    sigma_px: Option<f64>,
}

/// A number in its range.
fn within(what: &str, value: f64, [low, high]: [f64; 2]) -> Result<f64, String> {
    match value >= low && value <= high {
        true => Ok(value),
        false => Err(format!("{what} {value}: expected {low} to {high}")),
    }
}

/// An uncertainty.
fn sigma_of(value: f64) -> Result<f64, String> {
    match value > 0.0 && value < 1e6 {
        true => Ok(value),
        false => Err(format!("sigma {value}: expected a number above 0, the standard uncertainty of the row")),
    }
}

fn height_of(value: f64) -> Result<f64, String> {
    within("height_mm", value, [0.0, LARGEST_HEIGHT])
}

fn azimuth_of(value: Option<f64>) -> Result<f64, String> {
    within("azimuth_deg", value.unwrap_or(AZIMUTH_DEG), [-360.0, 360.0])
}

impl DistortionTable {
    fn row(&self, r: &DistortionRow) -> Result<Vec<Measured>, String> {
        let azimuth_deg = azimuth_of(r.azimuth_deg)?;
        let field = |v: f64| within("field_deg", v, [-120.0, 120.0]).map(Place::Field);
        let height = |v: f64| height_of(v).map(Place::Height);
        let beside = |place: Place| match place {
            Place::Field(0.0) | Place::Height(0.0) => Err("percent on the axis: expected a field or height beside it".to_owned()),
            Place::Field(f) if f.abs() >= 89.0 => Err(format!("percent at {f}°: expected an angle below 89°, or its height_mm")),
            place => Ok(place),
        };
        let (place, table, value, sigma) = match (r.field_deg, r.height_mm, r.percent) {
            (Some(f), None, Some(p)) => (beside(field(f)?)?, Table::Percent, p, self.sigma_percent),
            (None, Some(h), Some(p)) => (beside(height(h)?)?, Table::Percent, p, self.sigma_percent),
            (Some(f), Some(h), None) => {
                (field(f)?, Table::Height, within("height_mm", h, [-LARGEST_HEIGHT, LARGEST_HEIGHT])?, self.sigma_mm)
            }
            _ => {
                let what = "expected two of field_deg, height_mm and percent: what was looked at, and what was found there";
                return Err(format!("distortion row: {what}"));
            }
        };
        let (usual, range) = match table {
            Table::Percent => (DISTORTION_SIGMA_PERCENT, [-100.0, 1000.0]),
            _ => (HEIGHT_SIGMA_MM, [-LARGEST_HEIGHT, LARGEST_HEIGHT]),
        };
        let value = within(if table == Table::Percent { "percent" } else { "height_mm" }, value, range)?;
        let sigma = sigma_of(r.sigma.or(sigma).unwrap_or(usual))?;
        Ok(vec![Measured { table, place, azimuth_deg, value, sigma }])
    }
}

impl VignettingTable {
    fn row(&self, r: &VignettingRow) -> Result<Vec<Measured>, String> {
        let place = Place::Height(height_of(r.height_mm)?);
        let azimuth_deg = azimuth_of(r.azimuth_deg)?;
        let (table, value, sigma) = match (r.relative, r.ev) {
            (Some(v), None) => (Table::Relative, within("relative", v, [0.0, 10.0])?, self.sigma.unwrap_or(RELATIVE_SIGMA)),
            (None, Some(v)) => (Table::Ev, within("ev", v, [-15.0, 5.0])?, self.sigma_ev.unwrap_or(EV_SIGMA)),
            _ => {
                return Err(
                    "vignetting row: expected relative (1 in the middle) or ev (0 in the middle, -1 half the light)".into()
                );
            }
        };
        Ok(vec![Measured { table, place, azimuth_deg, value, sigma: sigma_of(r.sigma.unwrap_or(sigma))? }])
    }
}

impl MtfTable {
    fn row(&self, r: &MtfRow) -> Result<Vec<Measured>, String> {
        let place = Place::Height(height_of(r.height_mm)?);
        let azimuth_deg = azimuth_of(r.azimuth_deg)?;
        if !(r.frequency > 0.0 && r.frequency <= HIGHEST_FREQUENCY) {
            return Err(format!("frequency {}: expected above 0 to {HIGHEST_FREQUENCY} cycles/mm", r.frequency));
        }
        let sigma = sigma_of(r.sigma.or(self.sigma).unwrap_or(CONTRAST_SIGMA))?;
        let one = |name: &str, value: Option<f64>, table: Table| {
            value.map(|v| Ok(Measured { table, place, azimuth_deg, value: within(name, v, [0.0, 1.5])?, sigma }))
        };
        let frequency = r.frequency;
        let both = [
            one("sagittal", r.sagittal, Table::Contrast { frequency, tangential: false }),
            one("tangential", r.tangential, Table::Contrast { frequency, tangential: true }),
        ];
        let found: Vec<Measured> = both.into_iter().flatten().collect::<Result<_, String>>()?;
        match found.is_empty() {
            true => Err("mtf row: expected sagittal, tangential or both: contrasts from 0 to 1".into()),
            false => Ok(found),
        }
    }
}

impl FitSheet {
    /// Reads a file of measurements; `file` is its name in errors. Fails, with the line where there is one, on other keys than these and on numbers
    /// out of their ranges.
    pub fn parse(text: &str, file: &str) -> Result<FitSheet, PrescriptionError> {
        let sheet: File = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(0, |s| line_of(text, s.start));
            PrescriptionError::at(file, line, in_words(e.message()).trim().replace('\n', " "))
        })?;
        let wrong = |what: String| PrescriptionError::at(file, 0, what);
        check_list(file, "wavelengths_nm", sheet.wavelengths_nm.as_ref(), [300.0, 2500.0])?;
        if sheet.weights.is_some() && sheet.wavelengths_nm.is_none() {
            return Err(wrong("weights without wavelengths_nm: expected both, or neither".into()));
        }
        check_weights(file, sheet.weights.as_ref(), sheet.wavelengths_nm.as_ref().map_or(0, Vec::len))?;
        let focals = [
            ("focal_length", sheet.focal_length),
            ("[distortion] focal_length_mm", sheet.distortion.as_ref().and_then(|d| d.focal_length_mm)),
        ];
        for (key, value) in focals {
            if value.is_some_and(|v| !(v > 0.0 && v < 1e6)) {
                return Err(wrong(format!("{key} {}: expected a length in mm", value.unwrap_or(0.0))));
            }
        }
        let mut rows: Vec<Row> = vec![];
        let mut add = |span: std::ops::Range<usize>, found: Result<Vec<Measured>, String>| {
            let line = line_of(text, span.start);
            let found = found.map_err(|what| PrescriptionError::at(file, line, what))?;
            rows.extend(found.into_iter().map(|measured| Row { line, measured }));
            Ok::<(), PrescriptionError>(())
        };
        let empty = |table: &str| wrong(format!("[{table}] rows = []: expected at least one row, or no [{table}]"));
        if let Some(t) = &sheet.distortion {
            if t.rows.is_empty() {
                return Err(empty("distortion"));
            }
            t.rows.iter().try_for_each(|r| add(r.span(), t.row(r.get_ref())))?;
        }
        if let Some(t) = &sheet.vignetting {
            if t.rows.is_empty() {
                return Err(empty("vignetting"));
            }
            t.rows.iter().try_for_each(|r| add(r.span(), t.row(r.get_ref())))?;
        }
        if let Some(t) = &sheet.mtf {
            if t.rows.is_empty() {
                return Err(empty("mtf"));
            }
            t.rows.iter().try_for_each(|r| add(r.span(), t.row(r.get_ref())))?;
        }
        let calibration = match &sheet.calibration {
            None => None,
            Some(entry) => {
                let line = line_of(text, entry.span().start);
                let c = entry.get_ref();
                let wrong = |what: String| PrescriptionError::at(file, line, what);
                if let Some(bad) = c.film_mm.iter().flatten().find(|v| !(**v > 0.0 && **v < 1e4)) {
                    return Err(wrong(format!("film_mm {bad}: expected width and height in mm, such as [36, 24]")));
                }
                let sigma_px = sigma_of(c.sigma_px.unwrap_or(CALIBRATION_SIGMA_PX)).map_err(&wrong)?;
                Some(CalibrationEntry { line, file: c.file.clone(), film_mm: c.film_mm, origin: c.origin, sigma_px })
            }
        };
        if sheet.variable.is_empty() {
            let what = "0 variables: expected at least one [[variable]], such as what = \"scale\"";
            return Err(wrong(what.into()));
        }
        if rows.is_empty() && calibration.is_none() {
            return Err(wrong("0 measurements: expected [distortion], [vignetting], [mtf] or [calibration]".into()));
        }
        if rows.len() > MOST_ROWS {
            return Err(wrong(format!("{} measurements: expected at most {MOST_ROWS}", rows.len())));
        }
        Ok(FitSheet {
            file: file.into(),
            lens: sheet.lens,
            aperture: sheet.aperture,
            focus_m: sheet.focus_m.filter(|d| *d != f64::INFINITY),
            focal_length: sheet.focal_length,
            wavelengths_nm: sheet.wavelengths_nm,
            weights: sheet.weights,
            distortion_focal_mm: sheet.distortion.as_ref().and_then(|d| d.focal_length_mm),
            origin: sheet.distortion.as_ref().map_or(Origin::default(), |d| d.origin),
            geometric: sheet.mtf.as_ref().is_some_and(|m| m.geometric),
            calibration,
            variables: sheet.variable.into_iter().map(|v| (line_of(text, v.span().start), v.into_inner())).collect(),
            rows,
        })
    }

    /// Adds what a calibration says: fields (degrees) and directions on the film (degrees from +x towards +y) with the heights of their images, mm.
    /// `sigma_mm`: uncertainty of a height.
    pub fn add(&mut self, seen: &[SeenField], sigma_mm: f64) {
        let Some(entry) = &self.calibration else { return };
        let table = match entry.origin {
            Origin::PrincipalPoint => Table::CalibratedFromAxis,
            Origin::FilmMiddle => Table::Calibrated,
        };
        let row = |s: &SeenField| {
            let measured = Measured {
                table,
                place: Place::Field(s.field_deg),
                azimuth_deg: s.azimuth_deg,
                value: s.height_mm,
                sigma: sigma_mm,
            };
            Row { line: entry.line, measured }
        };
        self.rows.extend(seen.iter().map(row));
    }
}

/// A field of a calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenField {
    /// Angle from the axis, degrees.
    pub field_deg: f64,
    /// Direction on the film in which its image is displaced, degrees from +x towards +y of the lens axes.
    pub azimuth_deg: f64,
    /// Height of its image in that direction, mm.
    pub height_mm: f64,
}

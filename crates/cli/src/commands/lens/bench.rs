//! A lens on the bench, as the verbs of `lens` that trace it share it: its flags, how it stands, where results go.

use super::print_json;
use crate::args::values::{List, list};
use crate::watch::{say, warn};
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::lens::analysis::{self, VISUAL_NM};
use diopter::lens::compound::{Configured, FilmPlace, configure, printed_focal_length};
use diopter::lens::draw::Figure;
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::prescription::WAVELENGTHS_NM;
use diopter::lens::{Focus, Prescription, State, System};
use diopter::quantity::{Distance, FNumber, LengthMm};
use diopter::shot::{ShotError, read_lens};
use serde_json::Value;
use std::io::Write;
use std::path::PathBuf;

/// A lens and how it is set on the bench.
#[derive(clap::Args, Debug)]
pub struct Bench {
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    pub lens: String,
    /// Where a zoom is set: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// A zoom position that the prescription prints, 1 the first.
    #[arg(long, value_name = "N", conflicts_with = "focal_length")]
    pub zoom_position: Option<usize>,
    /// f-number; as the file says, or fully open, without.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Focused at this distance from the entrance pupil ("2.5m", "inf"), the film in the plane of the smallest spot; without, the
    /// film stands where the prescription puts it, and between the printed positions of a zoom in that plane.
    #[arg(long, value_name = "DISTANCE")]
    pub focus: Option<Distance>,
    /// Field angles, degrees: "0,10,14".
    #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
    pub field: Option<List>,
    /// Wavelengths, nm: "486,588,656".
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub wavelength: Option<List>,
    /// Drawing or plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

/// Fields from here on, degrees, have no third-order sums: the tangent of the angle grows without bound.
const STEEPEST_FIELD: f64 = 89.0;

/// A lens as the command asks for it.
pub(super) struct Table {
    pub(super) prescription: Prescription,
    pub(super) set: Configured,
    pub(super) object_distance: Option<f64>,
    pub(super) fields: Vec<f64>,
    /// Largest angle that something is shown up to, degrees: of the fields, or of the film where the lens file says the axis alone.
    extent: f64,
    pub(super) wavelengths: Vec<f64>,
    pub(super) reference: f64,
}

impl Table {
    pub(super) fn new(asked: &Bench) -> anyhow::Result<Table> {
        let prescription = read_lens(&asked.lens)?;
        for note in &prescription.notes {
            say(&format!("note: {note}"));
        }
        let stated = prescription.used_f_number();
        let focus = asked.focus.map(|f| Focus::at_mm(f.0 * 1000.0));
        let film = focus.map_or(FilmPlace::AsPublished, FilmPlace::Focused);
        let aperture = asked.aperture.map(|a| a.0);
        let focal_length = match asked.zoom_position {
            Some(position) => Some(printed_focal_length(&prescription, position).map_err(ShotError::from)?),
            None => asked.focal_length.map(|f| f.0),
        };
        let mut set = match configure(&prescription, focal_length, aperture.or(stated), None, film) {
            // The file's own aperture may be more than its rims let through.
            Err(_) if aperture.is_none() && stated.is_some() => configure(&prescription, focal_length, None, None, film),
            other => other,
        }
        .map_err(ShotError::from)?;
        if let Some(asked) = aperture.filter(|a| set.f_number > a * 1.005) {
            say(&format!("note: fully open it is f/{:.2}, which is what f/{asked} stands for", set.f_number));
        }
        // What a sheet says of itself, held against its surfaces.
        if prescription.zoom.len() < 2 {
            let differs = |stated: f64, found: f64| !(0.9..=1.1).contains(&(found / stated));
            if let Some(stated) = prescription.f_number.filter(|stated| set.widest > 1.1 * stated) {
                say(&format!("note: stated is f/{stated}; its rims let f/{:.2} through", set.widest));
            }
            if let Some(stated) = prescription.focal_length.filter(|stated| differs(*stated, set.efl)) {
                say(&format!("note: stated are {stated} mm; the focal length of its surfaces is {:.2} mm", set.efl));
            }
        }
        let wavelengths = match &asked.wavelength {
            Some(list) => list.0.clone(),
            None if !prescription.usage.wavelengths_nm.is_empty() => prescription.usage.wavelengths_nm.clone(),
            None => VISUAL_NM.to_vec(),
        };
        if let Some(bad) = wavelengths.iter().find(|w| !WAVELENGTHS_NM.contains(*w)) {
            let (least, most) = WAVELENGTHS_NM.into_inner();
            return Err(UsageError(anyhow!("wavelength {bad} nm: expected {least} to {most}")).into());
        }
        // The file's own wavelengths have their notes already.
        if asked.wavelength.is_some() {
            prescription.extrapolated(&wavelengths).iter().for_each(|sentence| say(&format!("note: {sentence}")));
        }
        let reference = match asked.wavelength {
            None if !prescription.usage.wavelengths_nm.is_empty() => wavelengths[prescription.usage.reference],
            _ => wavelengths[wavelengths.len() / 2],
        };
        let asked_for: &[f64] = if asked.wavelength.is_some() { &wavelengths } else { &[reference] };
        if let Some(nm) = asked_for.iter().find(|nm| set.system.indices(**nm).iter().any(|n| !n.is_finite())) {
            return Err(UsageError(anyhow!("wavelength {nm} nm: a glass of this lens has no index there")).into());
        }
        let n = set.system.indices(reference);
        let object_distance = match focus {
            Some(Focus::Distance(d)) => Some(d.0 - FirstOrder::of(&set.system, &n).entrance_pupil_z),
            Some(Focus::Infinity | Focus::Extension(_)) => None,
            None => prescription.usage.object_distance,
        };
        if focus.is_none()
            && let Some(moved) = set.refocus_between_positions(object_distance)
        {
            let [before, after] = [set.state.zoom.floor(), set.state.zoom.ceil()].map(|position| position + 1.0);
            say(&format!(
                "note: between the printed zoom positions {before} and {after} gaps are interpolated: the film is moved by {moved:+.4} mm to the plane of the smallest axial spot"
            ));
        }
        let bench = analysis::Bench { system: &set.system, object_distance };
        let of_film = || bench.field_of_height(prescription.image_circle.map_or(0.36 * set.efl, |c| 0.5 * c));
        let fields = match &asked.field {
            Some(list) => list.0.clone(),
            None if !prescription.usage.field_angles_deg.is_empty() => prescription.usage.field_angles_deg.clone(),
            None => fields_to(of_film()),
        };
        let largest = fields.iter().fold(0.0, |a, b| f64::max(a, b.abs()));
        let extent = if largest == 0.0 && asked.field.is_none() { 0.98 * of_film() } else { largest };
        if let Some(bad) = fields.iter().find(|f| f.abs() > 120.0) {
            return Err(UsageError(anyhow!("field {bad}: expected an angle within 120 degrees")).into());
        }
        let table = Table { prescription, set, object_distance, fields, extent, wavelengths, reference };
        table.warn_of_dark_fields();
        Ok(table)
    }

    pub(super) fn bench(&self) -> analysis::Bench<'_> {
        analysis::Bench { system: &self.set.system, object_distance: self.object_distance }
    }

    /// Names the fields that no light comes from, if there are others: most verbs leave them out.
    fn warn_of_dark_fields(&self) {
        let bench = self.bench();
        let (lit, dark): (Vec<f64>, Vec<f64>) = self.fields.iter().partition(|f| bench.is_lit(**f, self.reference));
        if !lit.is_empty() {
            dark.iter().for_each(|f| warn(&no_light(*f).to_string()));
        }
    }

    /// Warns where path differences are not those of the lens: through ideal lenses they are exact for parallel light alone.
    pub(super) fn warn_of_ideal_paths(&self) {
        let surfaces = &self.set.system.surfaces;
        let Some(ideal) = surfaces.iter().position(|s| s.ideal_focal_length.is_some()) else { return };
        if self.object_distance.is_some() || surfaces[..ideal].iter().any(|s| s.profile.curvature() != 0.0) {
            warn(&format!(
                "surface {}: light comes to this ideal lens that is not parallel: its rays are exact, path differences are not, nor what follows from them (wavefront, Strehl ratio, diffraction)",
                ideal + 1
            ));
        }
    }

    /// Name, focal length and f-number at the reference wavelength, the object's distance, and what is shown.
    pub(super) fn title(&self, what: &str) -> String {
        let object = match self.object_distance {
            None => String::new(),
            Some(d) => format!(", object at {:.2} m", d / 1000.0),
        };
        let efl = self.set.efl * self.dispersion_of_focal_length();
        format!("{}   {efl:.4} mm f/{:.2}{object}   {what}", self.prescription.name, self.f_number())
            .replacen(".0000 mm", " mm", 1)
    }

    /// Focal length at the reference wavelength over that at the d line, focused at infinity: f-numbers go with it. 1 of openings alone.
    pub(super) fn dispersion_of_focal_length(&self) -> f64 {
        if self.prescription.is_openings_alone() {
            return 1.0;
        }
        let far = System::at(&self.prescription, State { focus: 0.0, ..self.set.state });
        FirstOrder::of(&far, &far.indices(self.reference)).efl / self.set.efl
    }

    /// f-number as set at the reference wavelength: its focal length over the diameter of the axial beam.
    pub(super) fn f_number(&self) -> f64 {
        self.set.f_number * self.dispersion_of_focal_length()
    }

    /// Field angle that third-order sums are taken for: the largest one that has a tangent (below 90°) of those asked, degrees.
    pub(super) fn third_order_field(&self) -> f64 {
        let fields = self.fields.iter().map(|f| f.abs()).chain([self.extent]);
        let below = fields.filter(|f| *f < STEEPEST_FIELD).fold(f64::NAN, f64::max);
        if below.is_nan() { STEEPEST_FIELD } else { below }
    }

    pub(super) fn largest_field(&self) -> f64 {
        self.extent
    }
}

/// Writes the plot, and says so.
pub(super) fn finish(
    asked: &Bench,
    figure: impl FnOnce() -> Figure,
    text: &str,
    value: &Value,
    json: bool,
) -> anyhow::Result<()> {
    if !asked.output.is_empty() {
        let outputs = paint::prepare(&asked.output)?;
        for path in paint::write(outputs, &figure())? {
            say(&format!("wrote {}", path.display()));
        }
    }
    if json {
        return print_json(value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Field angles that are shown by default: the axis, 0.7 of the field and nearly all of it.
pub(super) fn fields_to(most: f64) -> Vec<f64> {
    vec![0.0, 0.7 * most, 0.98 * most]
}

/// Whether several fields were asked for: then it is these that are shown, and not all up to the largest.
pub(super) fn is_list(asked: &Bench) -> bool {
    asked.field.as_ref().is_some_and(|list| list.0.len() > 1)
}

/// Fields that something is shown over: those asked for where there are several, else so many equal steps from the axis to the largest.
pub(super) fn over_fields(asked: &Bench, most: f64, steps: usize) -> anyhow::Result<Vec<f64>> {
    match &asked.field {
        Some(list) if list.0.len() > 1 => Ok(list.0.clone()),
        Some(_) if most == 0.0 => {
            Err(UsageError(anyhow!("field 0: expected an angle above 0 to go up to, or several: 0,10,14")).into())
        }
        _ => Ok((0..=steps).map(|i| most * i as f64 / steps as f64).collect()),
    }
}

pub(super) fn no_light(field: f64) -> anyhow::Error {
    anyhow!("field {field}°: no light comes through the lens at this angle")
}

/// Planes behind the film that were asked for, mm; the film itself without.
pub(super) fn planes(defocus: Option<&List>) -> anyhow::Result<Vec<f64>> {
    let planes = defocus.map_or(vec![0.0], |list| list.0.clone());
    match planes.iter().find(|d| d.abs() > 1000.0) {
        Some(bad) => Err(UsageError(anyhow!("defocus {bad} mm: expected a place within 1000 mm of the film")).into()),
        None => Ok(planes),
    }
}

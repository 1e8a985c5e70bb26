//! `lens`: what a lens is and what it does.

mod coating;
mod convert;
mod drawing;
mod field;
mod ghosts;
mod mtf;
mod overview;
mod point_image;
mod rays;
mod report;

use super::print_json;
use crate::args::{Bench as Asked, LensVerb, List};
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::lens::analysis::{Bench, VISUAL_NM};
use diopter::lens::compound::{Configured, FilmPlace, configure, printed_focal_length};
use diopter::lens::draw::Figure;
use diopter::lens::glass::D_NM;
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::prescription::{ApertureKind, WAVELENGTHS_NM};
use diopter::lens::{Focus, Prescription, State, System};
use diopter::shot::{ShotError, read_lens};
use serde_json::Value;
use std::io::Write;
use std::num::NonZeroUsize;

pub fn run(verb: &LensVerb, threads: Option<NonZeroUsize>, json: bool) -> anyhow::Result<()> {
    match verb {
        LensVerb::List => overview::list(json),
        LensVerb::Info(asked) => overview::info(asked, json),
        LensVerb::Draw(asked) => drawing::drawing(asked, json),
        LensVerb::Trace { bench, pupil } => rays::trace(bench, *pupil, json),
        LensVerb::Spot { bench, rays, defocus } => rays::spot(bench, *rays, defocus.as_ref(), json),
        LensVerb::Psf { bench, defocus, pixel, pixels, geometric } => {
            let asked = point_image::Psfs {
                defocus: planes(defocus.as_ref())?,
                pixel_um: *pixel,
                pixels: *pixels,
                geometric: *geometric,
            };
            point_image::psf(bench, &asked, json)
        }
        LensVerb::Wavefront { bench, zernikes, terms, rays } => point_image::wavefront(bench, *zernikes, *terms, *rays, json),
        LensVerb::Fan(asked) => rays::fan(asked, json),
        LensVerb::Mtf { bench, over, frequency, geometric } => {
            mtf::mtf(bench, *over, frequency.as_ref().map(|f| &f.0[..]), *geometric, json)
        }
        LensVerb::Distortion(asked) => field::distortion(asked, json),
        LensVerb::Vignetting(asked) => field::vignetting(asked, json),
        LensVerb::Color(asked) => field::color(asked, json),
        LensVerb::Report(asked) => report::run(asked, threads, json),
        LensVerb::Coating { lens, surface, coating, angle, output } => {
            let asked = coating::Asked { lens, surface: *surface, coating: coating.as_deref(), angles: &angle.0, output };
            coating::run(&asked, json)
        }
        LensVerb::Ghosts { bench, source, coating, sensor_reflectance, fours, pixel_pitch, rays, top } => {
            let asked = ghosts::Asked {
                bench,
                source_deg: *source,
                coating: coating.as_deref(),
                sensor_reflectance: *sensor_reflectance,
                fours: *fours,
                pixel_pitch_mm: pixel_pitch.map(|p| p.0),
                rays: *rays,
                top: *top,
            };
            ghosts::run(&asked, json)
        }
        LensVerb::Calibrate(asked) => super::calibrate::run(asked, json),
        LensVerb::Tolerance(asked) => super::tolerance::run(asked, json),
        LensVerb::Optimise(asked) => super::optimise::run(asked, json),
        LensVerb::Fit(asked) => super::fit::run(asked, json),
        LensVerb::Build(asked) => super::tolerance::build(asked, json),
        LensVerb::Convert { lens, output } => convert::run(lens, output.as_deref(), json),
    }
}

/// Fields from here on, degrees, have no third-order sums: the tangent of the angle grows without bound.
const STEEPEST_FIELD: f64 = 89.0;

/// A lens as the command asks for it.
struct Table {
    prescription: Prescription,
    set: Configured,
    object_distance: Option<f64>,
    fields: Vec<f64>,
    wavelengths: Vec<f64>,
    reference: f64,
}

impl Table {
    fn new(asked: &Asked) -> anyhow::Result<Table> {
        let prescription = read_lens(&asked.lens)?;
        for note in &prescription.notes {
            say(&format!("note: {note}"));
        }
        let stated = match prescription.usage.aperture {
            Some(ApertureKind::FNumber(n)) => Some(n),
            Some(ApertureKind::EntrancePupil(d)) => {
                let s = System::at(&prescription, State::default());
                let efl = FirstOrder::of(&s, &s.indices(D_NM)).efl;
                (efl / d > 0.1).then_some(efl / d)
            }
            _ => None,
        };
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
        let n = set.system.indices(reference);
        if n.iter().any(|n| !n.is_finite()) {
            return Err(UsageError(anyhow!("wavelength {reference} nm: a glass of this lens has no index there")).into());
        }
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
        let bench = Bench { system: &set.system, object_distance };
        let fields = match &asked.field {
            Some(list) => list.0.clone(),
            None if prescription.usage.field_angles_deg.len() > 1 => prescription.usage.field_angles_deg.clone(),
            None => {
                let height = prescription.image_circle.map_or(0.36 * set.efl, |c| 0.5 * c);
                fields_to(bench.field_of_height(height))
            }
        };
        if let Some(bad) = fields.iter().find(|f| f.abs() > 120.0) {
            return Err(UsageError(anyhow!("field {bad}: expected an angle within 120 degrees")).into());
        }
        Ok(Table { prescription, set, object_distance, fields, wavelengths, reference })
    }

    fn bench(&self) -> Bench<'_> {
        Bench { system: &self.set.system, object_distance: self.object_distance }
    }

    fn title(&self, what: &str) -> String {
        let object = match self.object_distance {
            None => String::new(),
            Some(d) => format!(", object at {:.2} m", d / 1000.0),
        };
        format!("{}   {:.4} mm f/{:.2}{object}   {what}", self.prescription.name, self.set.efl, self.set.f_number)
            .replacen(".0000 mm", " mm", 1)
    }

    /// Focal length at the reference wavelength over that at the d line, focused at infinity: f-numbers go with it.
    fn dispersion_of_focal_length(&self) -> f64 {
        let far = System::at(&self.prescription, State { focus: 0.0, ..self.set.state });
        FirstOrder::of(&far, &far.indices(self.reference)).efl / self.set.efl
    }

    /// f-number as set at the reference wavelength: its focal length over the diameter of the axial beam.
    fn f_number(&self) -> f64 {
        self.set.f_number * self.dispersion_of_focal_length()
    }

    /// Field angle that third-order sums are taken for: the largest one that has a tangent (below 90°) of those asked, degrees.
    fn third_order_field(&self) -> f64 {
        let below = self.fields.iter().map(|f| f.abs()).filter(|f| *f < STEEPEST_FIELD).fold(f64::NAN, f64::max);
        if below.is_nan() { STEEPEST_FIELD } else { below }
    }

    fn largest_field(&self) -> f64 {
        self.fields.iter().copied().fold(0.0, |a, b| f64::max(a, b.abs()))
    }
}

/// Writes the plot, and says so.
fn finish(asked: &Asked, figure: impl FnOnce() -> Figure, text: &str, value: &Value, json: bool) -> anyhow::Result<()> {
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
fn fields_to(most: f64) -> Vec<f64> {
    vec![0.0, 0.7 * most, 0.98 * most]
}

/// Whether several fields were asked for: then it is these that are shown, and not all up to the largest.
fn is_list(asked: &Asked) -> bool {
    asked.field.as_ref().is_some_and(|list| list.0.len() > 1)
}

/// Fields that something is shown over: those asked for where there are several, else so many equal steps from the axis to the largest.
fn over_fields(asked: &Asked, most: f64, steps: usize) -> anyhow::Result<Vec<f64>> {
    match &asked.field {
        Some(list) if list.0.len() > 1 => Ok(list.0.clone()),
        Some(_) if most == 0.0 => {
            Err(UsageError(anyhow!("field 0: expected an angle above 0 to go up to, or several: 0,10,14")).into())
        }
        _ => Ok((0..=steps).map(|i| most * i as f64 / steps as f64).collect()),
    }
}

fn no_light(field: f64) -> anyhow::Error {
    anyhow!("field {field}°: no light comes through the lens at this angle")
}

/// Planes behind the film that were asked for, mm; the film itself without.
fn planes(defocus: Option<&List>) -> anyhow::Result<Vec<f64>> {
    let planes = defocus.map_or(vec![0.0], |list| list.0.clone());
    match planes.iter().find(|d| d.abs() > 1000.0) {
        Some(bad) => Err(UsageError(anyhow!("defocus {bad} mm: expected a place within 1000 mm of the film")).into()),
        None => Ok(planes),
    }
}

//! `lens`: what a lens is and what it does.

mod coating;
mod ghosts;
mod point_image;
mod report;

use super::print_json;
use crate::args::{Bench as Asked, LensVerb, List, MtfOver};
use crate::output::{Output, distinct};
use crate::watch::say;
use crate::{AskedWrongly, paint};
use anyhow::anyhow;
use diopter::lens::analysis::{Bench, Illumination, Mtf, ThirdOrder, VISUAL_NM, airy_mtf};
use diopter::lens::compound::{Configured, FilmPlace, configure, nearest_focus, printed_focal_length, printed_focal_lengths};
use diopter::lens::draw::{self, Figure, LayoutOptions};
use diopter::lens::export::{self, ExportFormat};
use diopter::lens::glass::{D_NM, GlassKind};
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::prescription::{ApertureKind, Coating, WAVELENGTHS_NM};
use diopter::lens::surface::Profile;
use diopter::lens::trace::{Apertures, Way, at_plane};
use diopter::lens::{Focus, Iris, Prescription, State, System, ThinLens, embedded, embedded_names};
use diopter::light::units::Millimeters;
use diopter::shot::{ShotError, read_lens};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::Path;

pub fn run(verb: &LensVerb, threads: Option<NonZeroUsize>, json: bool) -> anyhow::Result<()> {
    match verb {
        LensVerb::List => list(json),
        LensVerb::Info(asked) => info(asked, json),
        LensVerb::Draw(asked) => drawing(asked, json),
        LensVerb::Trace { bench, pupil } => trace(bench, *pupil, json),
        LensVerb::Spot { bench, rays, defocus } => spot(bench, *rays, defocus.as_ref(), json),
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
        LensVerb::Fan(asked) => fan(asked, json),
        LensVerb::Mtf { bench, over, frequency, geometric } => {
            mtf(bench, *over, frequency.as_ref().map(|f| &f.0[..]), *geometric, json)
        }
        LensVerb::Distortion(asked) => distortion(asked, json),
        LensVerb::Vignetting(asked) => vignetting(asked, json),
        LensVerb::Color(asked) => color(asked, json),
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
        LensVerb::Convert { lens, output } => {
            // A name of an embedded lens is no file here.
            distinct([Path::new(lens)], output.as_deref())?;
            let prescription = read_lens(lens)?;
            for note in &prescription.notes {
                say(&format!("note: {note}"));
            }
            let format = output.as_deref().and_then(|path| ExportFormat::of(&path.to_string_lossy()));
            let text = match format {
                None => prescription.to_toml(),
                Some(format) => {
                    let exported = export::write(&prescription, State::default(), format)?;
                    exported.notes.iter().for_each(|note| say(&format!("note: {note}")));
                    exported.text
                }
            };
            if json && output.is_none() {
                return print_json(&json!({ "name": prescription.name, "notes": prescription.notes, "toml": text }));
            }
            match output {
                None => write!(std::io::stdout(), "{text}")?,
                Some(path) => {
                    if format.is_none() && path.extension().is_none_or(|e| e != "toml") {
                        let what = anyhow!("{}: expected a name that ends in .toml, .zmx or .seq", path.display());
                        return Err(AskedWrongly(what).into());
                    }
                    Output::prepare(path)?.commit(|w| Ok(w.write_all(text.as_bytes())?))?;
                    say(&format!("wrote {}", path.display()));
                }
            }
            Ok(())
        }
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
            return Err(AskedWrongly(anyhow!("wavelength {bad} nm: expected {least} to {most}")).into());
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
            return Err(AskedWrongly(anyhow!("wavelength {reference} nm: a glass of this lens has no index there")).into());
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
            return Err(AskedWrongly(anyhow!("field {bad}: expected an angle within 120 degrees")).into());
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

fn list(json: bool) -> anyhow::Result<()> {
    let mut rows = vec![];
    for name in embedded_names() {
        let Some(p) = embedded(name) else { continue };
        let ends = if p.zoom.is_empty() { vec![0.0] } else { vec![0.0, p.last_zoom()] };
        let focal: Vec<f64> = ends
            .iter()
            .map(|z| {
                let s = System::at(&p, State { zoom: *z, focus: 0.0 });
                FirstOrder::of(&s, &s.indices(D_NM)).efl
            })
            .collect();
        rows.push((name, p, focal));
    }
    if json {
        let all: Vec<_> = rows
            .iter()
            .map(|(key, p, focal)| {
                json!({ "name": key, "lens": p.name, "focal_length_mm": focal, "f_number": p.f_number,
                    "image_circle_mm": p.image_circle, "patent": p.patent, "source": p.source })
            })
            .collect();
        return print_json(&json!(all));
    }
    let mut t = String::new();
    for (key, p, focal) in rows {
        let focal: Vec<String> = focal.iter().map(|f| format!("{f:.1}")).collect();
        let aperture = p.f_number.map_or(String::new(), |n| format!("f/{n}"));
        let origin = p.patent.as_deref().unwrap_or(&p.source);
        writeln!(t, "{key:<24} {:>11} mm {aperture:<8} {origin}", focal.join("-"))?;
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

fn info(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let (p, system) = (&table.prescription, &table.set.system);
    let n = system.indices(table.reference);
    let mut f = FirstOrder::of(system, &n);
    // The pupils of the real axial beam: aberrations of the pupil make the stop's paraxial image a little larger or smaller.
    f.stop_radius = 0.5 * table.set.efl / table.set.f_number / f.entrance_pupil_magnification.abs();
    let f = f;
    let bench = table.bench();
    let last = system.last_z();
    let ends = system.surfaces.iter().fold((0.0f64, 0.0f64), |(a, b), s| (a.min(s.z), b.max(s.z)));
    let length = ends.1 - ends.0;
    let (short, long) = match &table.wavelengths[..] {
        [only] => (*only, *only),
        all => (all.iter().copied().fold(f64::MAX, f64::min), all.iter().copied().fold(0.0, f64::max)),
    };
    let dispersion: Vec<f64> = system.indices(short).iter().zip(system.indices(long)).map(|(a, b)| a - b).collect();
    let height = 0.5 * table.set.efl / table.set.f_number;
    let third_field = table.third_order_field();
    let slope = third_field.to_radians().tan();
    let (f_number, widest) = (table.f_number(), table.set.widest * table.dispersion_of_focal_length());
    let third = ThirdOrder::of(system, &n, &dispersion, height, slope);
    let axis = bench.illumination(0.0, table.reference);
    let transmittance = axis.with_losses / axis.geometric;
    if axis.geometric <= 0.0 {
        return Err(anyhow!("{}: no light reaches the middle of the film", p.name));
    }
    // As bright on the axis as a lossless, unobstructed lens of this f-number: everything that takes light counts.
    let t_number = (std::f64::consts::PI / (4.0 * axis.with_losses)).sqrt();
    let magnification = table.object_distance.map_or(0.0, |d| -f.efl / (d + f.ffl));
    let working = (std::f64::consts::PI / (4.0 * axis.geometric)).sqrt();
    let measured = bench.measured_focal_length(table.reference);
    let glasses: Vec<String> = p.surfaces.iter().filter(|s| s.glass.kind != GlassKind::Air).map(|s| s.glass.describe()).collect();
    let sum = third.sum();
    // The image circle that is stated, held against the trace.
    let circle = p.image_circle.and_then(|circle| Some((circle, table.set.lit_radius(0.5 * circle)?)));
    if json {
        let by_surface: Vec<Value> = third
            .surfaces
            .iter()
            .map(|s| json!({ "seidel_mm": s.seidel, "chromatic_mm": s.chromatic, "petzval_per_mm": s.petzval, "transverse_mm": third.transverse(s) }))
            .collect();
        return print_json(&json!({
            "name": p.name, "patent": p.patent, "source": p.source, "notes": p.notes, "wavelength_nm": table.reference,
            "surfaces": p.surfaces.len(), "stop": p.stop() + 1, "zoom": p.zoom, "zoom_position": (!p.zoom.is_empty()).then_some(table.set.state.zoom + 1.0), "close_focus_mm": p.close_focus,
            "effective_focal_length_mm": f.efl, "measured_focal_length_mm": measured,
            "back_focal_length_mm": f.bfl, "front_focal_length_mm": f.ffl,
            "front_principal_z_mm": f.front_principal_z, "rear_principal_z_mm": f.rear_principal_z,
            "entrance_pupil_z_mm": f.entrance_pupil_z, "entrance_pupil_diameter_mm": 2.0 * f.entrance_pupil_radius(),
            "exit_pupil_z_mm": f.exit_pupil_z, "exit_pupil_from_last_mm": f.exit_pupil_z - last, "exit_pupil_diameter_mm": 2.0 * f.exit_pupil_radius(),
            "f_number": f_number, "widest_f_number": widest, "paraxial_f_number": f.f_number(),
            "working_f_number": working, "t_number": t_number, "transmittance": transmittance,
            "magnification": magnification, "petzval_sum_per_mm": f.petzval_sum, "length_mm": length, "film_z_mm": system.film_z,
            "image_circle_mm": p.image_circle, "lit_radius_mm": circle.map(|c| c.1),
            "third_order": { "field_deg": third_field, "by_surface": by_surface, "seidel_mm": sum.seidel, "chromatic_mm": sum.chromatic, "transverse_mm": third.transverse(&sum) },
            "glasses": glasses,
        }));
    }
    let mut t = String::new();
    writeln!(t, "{}", p.name)?;
    if let Some(patent) = &p.patent {
        writeln!(t, "  patent            {patent}")?;
    }
    if !p.source.is_empty() {
        writeln!(t, "  source            {}", p.source)?;
    }
    writeln!(t, "  at                {:.1} nm, z from the first vertex", table.reference)?;
    writeln!(
        t,
        "  focal length      {:.4} mm{}",
        f.efl,
        measured.map_or(String::new(), |m| format!(", {m:.4} mm by parallel rays at 0.2°"))
    )?;
    writeln!(t, "  back, front       {:.4} mm, {:.4} mm", f.bfl, f.ffl)?;
    writeln!(t, "  principal planes  z {:.4} and {:.4} mm", f.front_principal_z, f.rear_principal_z)?;
    writeln!(t, "  entrance pupil    z {:.4} mm, diameter {:.4} mm", f.entrance_pupil_z, 2.0 * f.entrance_pupil_radius())?;
    writeln!(
        t,
        "  exit pupil        z {:.4} mm ({:.4} from the last vertex), diameter {:.4} mm",
        f.exit_pupil_z,
        f.exit_pupil_z - last,
        2.0 * f.exit_pupil_radius()
    )?;
    writeln!(
        t,
        "  f-number          {:.4} (opens to {:.4}), working {working:.4}, T-stop {t_number:.4} (transmittance {transmittance:.4})",
        f_number, widest
    )?;
    if magnification != 0.0 {
        writeln!(t, "  magnification     {magnification:.6}")?;
    }
    writeln!(t, "  length            {length:.4} mm, film at {:.4} mm", system.film_z)?;
    if let Some((circle, lit)) = circle {
        let radius = 0.5 * circle;
        let dark = if lit < radius { ": the rims of the prescription stop all light beyond" } else { "" };
        writeln!(t, "  image circle      {circle} mm stated; lit to {lit:.2} mm of {radius:.2} mm from its middle{dark}")?;
    }
    writeln!(t, "  Petzval sum       {:.6} /mm (radius {:.2} mm)", f.petzval_sum, 1.0 / f.petzval_sum)?;
    if p.coating != Coating::None {
        writeln!(t, "  coating           {}", p.coating.describe())?;
    }
    if let Some(nearest) = nearest_focus(p, table.set.state.zoom) {
        writeln!(t, "  nearest focus     {nearest:.0} mm from the entrance pupil")?;
    }
    if !p.zoom.is_empty() {
        let position = |(i, f): (usize, f64)| format!("{} ({f:.2} mm)", i + 1);
        let printed: Vec<String> = printed_focal_lengths(p).into_iter().enumerate().map(position).collect();
        writeln!(t, "  zoom positions    {}; here {:.3}", printed.join(", "), table.set.state.zoom + 1.0)?;
    }
    writeln!(t, "\n  {:>3} {:>12} {:>10} {:>9}  glass", "", "radius", "gap", "semi-dia")?;
    for (i, s) in p.surfaces.iter().enumerate() {
        let radius = match &s.profile {
            Profile::Plane => "plane".into(),
            other if other.curvature() == 0.0 && other.is_rotational() => "asphere".into(),
            Profile::Toroid { .. } | Profile::Biconic { .. } | Profile::Freeform(_) => {
                let r = |c: f64| if c == 0.0 { "inf".to_owned() } else { format!("{:.2}", 1.0 / c) };
                format!("{}/{}", r(s.profile.curvature_x()), r(s.profile.curvature()))
            }
            other => format!("{:.4}", 1.0 / other.curvature()),
        };
        let kind = match (&s.profile, s.stop, s.mirror) {
            (_, true, true) => " stop, mirror",
            (_, true, _) => " stop",
            (_, _, true) => " mirror",
            _ if s.diffractive.is_some() => " diffractive",
            (Profile::Freeform(_), ..) => " freeform",
            (Profile::Fresnel(_), ..) => " Fresnel",
            (Profile::Asphere(_) | Profile::Forbes(_) | Profile::Conic { .. }, ..) => " asphere",
            _ => "",
        };
        let gap = s.gap.at(table.set.state.zoom, table.set.state.focus);
        let glass = if s.glass.kind == GlassKind::Air { String::new() } else { s.glass.describe() };
        writeln!(t, "  {:>3} {radius:>12} {gap:>10.4} {:>9.3}  {glass}{kind}", i + 1, s.semi_diameter.unwrap_or(0.0))?;
    }
    if system.has_gradients() {
        writeln!(t, "\n  the lens has gradient-index media: third-order sums are not computed")?;
    }
    if system.has_diffractive() {
        writeln!(t, "\n  the lens has diffractive surfaces: third-order sums are not computed; one order of each is followed")?;
    }
    if system.object_axis.is_some() {
        writeln!(
            t,
            "\n  the lens has no axis: first order is that about its base ray, the mean of both sections; third-order sums are not computed"
        )?;
        return finish(asked, || layout(&table), &t, &Value::Null, false);
    }
    if !system.is_rotational() {
        writeln!(t, "\n  the lens is not round: first and third order are of its y-z section, tilts left out")?;
    }
    let note = if third_field < table.largest_field() { " (larger fields have no third-order sums)" } else { "" };
    writeln!(t, "\n  third order at f/{f_number:.2} and {third_field:.2}°, transverse, mm{note}")?;
    writeln!(
        t,
        "  {:>3} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "", "SA", "TCO", "TAS", "SAS", "PTB", "DST", "AX", "LAT"
    )?;
    let row = |t: &mut String, name: String, v: [f64; 8]| {
        let cells: Vec<String> = v.iter().map(|v| format!("{v:>10.6}")).collect();
        writeln!(t, "  {name:>3} {}", cells.join(" "))
    };
    for (i, s) in third.surfaces.iter().enumerate() {
        row(&mut t, format!("{}", i + 1), third.transverse(s))?;
    }
    row(&mut t, "sum".into(), third.transverse(&sum))?;
    writeln!(t, "  Seidel sums S_I..S_V {:?} mm", sum.seidel.map(|v| (v * 1e6).round() / 1e6))?;
    if p.surfaces.iter().any(|s| matches!(s.glass.kind, GlassKind::Constant(_))) {
        writeln!(t, "  constant indices: this source gives no dispersion, colour figures are 0")?;
    }
    finish(asked, || layout(&table), &t, &Value::Null, false)
}

fn layout(table: &Table) -> Figure {
    let options =
        LayoutOptions { title: table.title(""), fields_deg: table.fields.clone(), nm: table.reference, rays: 7, width: 800.0 };
    draw::layout(&table.bench(), &options)
}

fn drawing(asked: &Asked, json: bool) -> anyhow::Result<()> {
    if asked.output.is_empty() {
        return Err(AskedWrongly(anyhow!("lens draw: expected -o FILE.svg or FILE.png")).into());
    }
    if asked.lens == "thin" {
        return thin_drawing(asked, json);
    }
    let outputs = paint::prepare(&asked.output)?;
    let table = Table::new(asked)?;
    let written = paint::write(outputs, &layout(&table))?;
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&json!({ "files": written, "fields_deg": table.fields, "wavelength_nm": table.reference }))?;
    }
    Ok(())
}

/// The thin lens has no surfaces: of all verbs only this one shows it.
fn thin_drawing(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let focal = asked.focal_length.map_or(50.0, |f| f.0);
    let f_number = asked.aperture.map_or(5.6, |a| a.0);
    let focus = asked.focus.map_or(Focus::Infinity, |f| Focus::at_mm(f.0 * 1000.0));
    let lens = ThinLens::new(Millimeters(focal), f_number, Iris::default(), focus).map_err(ShotError::from)?;
    let fields = asked.field.as_ref().map_or_else(|| fields_to(0.36f64.atan().to_degrees()), |list| list.0.clone());
    if let Some(bad) = fields.iter().find(|f| f.abs() >= 89.0) {
        return Err(AskedWrongly(anyhow!("field {bad}: expected an angle within 89 degrees")).into());
    }
    let at = lens.focus_distance().map_or(String::new(), |d| format!(", object at {:.2} m", d.0 / 1000.0));
    let title = format!("thin lens   {focal} mm f/{f_number}{at}");
    let outputs = paint::prepare(&asked.output)?;
    let written = paint::write(outputs, &draw::thin_layout(&lens, &title, &fields, 800.0))?;
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&json!({ "files": written, "fields_deg": fields }))?;
    }
    Ok(())
}

/// Field angles that are shown when nobody says: the axis, 0.7 of the field and nearly all of it.
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
            Err(AskedWrongly(anyhow!("field 0: expected an angle above 0 to go up to, or several: 0,10,14")).into())
        }
        _ => Ok((0..=steps).map(|i| most * i as f64 / steps as f64).collect()),
    }
}

fn no_light(field: f64) -> anyhow::Error {
    anyhow!("field {field}°: no light comes through the lens at this angle")
}

fn trace(asked: &Asked, pupil: [f64; 2], json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let field = asked.field.as_ref().map_or(0.0, |f| f.0[0]);
    let nm = table.reference;
    let beam = bench.beam(field, nm).ok_or_else(|| no_light(field))?;
    let reach = bench.axial_reach(nm).ok_or_else(|| no_light(0.0))?;
    let at = glam_of(pupil, reach);
    let n = table.set.system.indices(nm);
    let mut rows = vec![];
    let traced = table.set.system.trace_with(beam.ray(at), &n, Way::ToFilm, Apertures::Clip, |e| rows.push(e));
    let opd = bench.opd_of(&beam, at, nm);
    let mut t = String::new();
    writeln!(t, "{}", table.title(&format!("field {field}°, pupil {}, {}, {nm:.1} nm", pupil[0], pupil[1])))?;
    writeln!(
        t,
        "  {:>4} {:>14} {:>14} {:>14} {:>12} {:>12} {:>12} {:>9} {:>9}",
        "", "x mm", "y mm", "z mm", "L", "M", "N", "in °", "out °"
    )?;
    for e in &rows {
        let angle = |c: f64| c.clamp(-1.0, 1.0).acos().to_degrees();
        writeln!(
            t,
            "  {:>4} {:>14.9} {:>14.9} {:>14.9} {:>12.9} {:>12.9} {:>12.9} {:>9.4} {:>9.4}",
            e.surface + 1,
            e.point.x,
            e.point.y,
            e.point.z,
            e.direction.x,
            e.direction.y,
            e.direction.z,
            angle(e.cosines[0]),
            angle(e.cosines[1])
        )?;
    }
    let end = match &traced {
        Ok(out) => {
            let film = at_plane(out, table.set.system.film_z);
            writeln!(
                t,
                "  film {:>14.9} {:>14.9} {:>14.9}   path difference {:.4} waves",
                film.x,
                film.y,
                film.z,
                opd.unwrap_or(f64::NAN)
            )?;
            json!({ "film_mm": film.to_array(), "direction": out.direction.to_array(), "opd_waves": opd })
        }
        Err(b) => {
            writeln!(t, "  blocked at surface {}: {:?}", b.surface + 1, b.why)?;
            json!({ "blocked_at": b.surface + 1, "why": format!("{:?}", b.why) })
        }
    };
    if json {
        let rows: Vec<Value> = rows
            .iter()
            .map(|e| json!({ "surface": e.surface + 1, "point_mm": e.point.to_array(), "direction": e.direction.to_array(), "path_mm": e.path }))
            .collect();
        return print_json(&json!({ "field_deg": field, "pupil": pupil, "wavelength_nm": nm, "surfaces": rows, "end": end }));
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

fn glam_of(pupil: [f64; 2], reach: f64) -> diopter::lens::analysis::PupilPoint {
    diopter::lens::analysis::PupilPoint::new(pupil[0] * reach, pupil[1] * reach)
}

/// Planes behind the film that were asked for, mm; the film itself without.
fn planes(defocus: Option<&List>) -> anyhow::Result<Vec<f64>> {
    let planes = defocus.map_or(vec![0.0], |list| list.0.clone());
    match planes.iter().find(|d| d.abs() > 1000.0) {
        Some(bad) => Err(AskedWrongly(anyhow!("defocus {bad} mm: expected a place within 1000 mm of the film")).into()),
        None => Ok(planes),
    }
}

fn spot(asked: &Asked, rays: usize, defocus: Option<&List>, json: bool) -> anyhow::Result<()> {
    if !(2..=1000).contains(&rays) {
        return Err(AskedWrongly(anyhow!("rays {rays}: expected 2 to 1000 across the pupil")).into());
    }
    let planes = planes(defocus)?;
    let table = Table::new(asked)?;
    let bench = table.bench();
    let colors = |field: f64, plane: f64| {
        let spots = table.wavelengths.iter().filter_map(|nm| bench.spot(field, *nm, table.reference, rays, plane));
        (plane, spots.collect::<Vec<_>>())
    };
    let fields: Vec<Vec<(f64, Vec<_>)>> =
        table.fields.iter().map(|f| planes.iter().map(|plane| colors(*f, *plane)).collect()).collect();
    let mut t = format!("{}\n", table.title("spots"));
    let mut values = vec![];
    let through = if defocus.is_some() { format!(" {:>10}", "defocus mm") } else { String::new() };
    writeln!(
        t,
        "  {:>7} {:>8}{through} {:>12} {:>12} {:>14} {:>7}",
        "field °", "nm", "RMS µm", "largest µm", "centroid y mm", "rays"
    )?;
    for (plane, s) in fields.iter().flatten().flat_map(|(plane, spots)| spots.iter().map(move |s| (plane, s))) {
        let through = if defocus.is_some() { format!(" {plane:>10.4}") } else { String::new() };
        writeln!(
            t,
            "  {:>7.2} {:>8.1}{through} {:>12.4} {:>12.4} {:>14.6} {:>7}",
            s.field_deg,
            s.nm,
            s.rms * 1e3,
            s.geometric * 1e3,
            s.centroid.y,
            s.points.len()
        )?;
        values.push(json!({ "field_deg": s.field_deg, "wavelength_nm": s.nm, "defocus_mm": plane, "rms_mm": s.rms, "geometric_mm": s.geometric,
            "centroid_mm": s.centroid.to_array(), "points_mm": s.points.iter().map(|p| p.to_array()).collect::<Vec<_>>() }));
    }
    if values.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    let plot = || match defocus {
        Some(_) => draw::through_focus_plot(&table.title("spots through focus"), &fields),
        None => {
            let spots: Vec<Vec<_>> = fields.iter().flatten().map(|(_, spots)| spots.clone()).collect();
            draw::spot_plot(&table.title("spot diagrams"), &spots)
        }
    };
    finish(asked, plot, &t, &json!(values), json)
}

fn fan(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let fields: Vec<Vec<_>> = table
        .fields
        .iter()
        .map(|f| table.wavelengths.iter().filter_map(|nm| bench.fan(*f, *nm, table.reference, 32)).collect::<Vec<_>>())
        .collect();
    let mut t = format!("{}\n", table.title("ray fans"));
    writeln!(
        t,
        "  {:>7} {:>8} {:>7} {:>12} {:>12} {:>12} {:>12}",
        "field °", "nm", "pupil", "tang. µm", "waves", "sagit. µm", "waves"
    )?;
    let mut values = vec![];
    for f in fields.iter().flatten() {
        for i in (0..=64).step_by(8) {
            let s = i as f64 / 32.0 - 1.0;
            let find = |v: &[diopter::lens::analysis::FanPoint]| v.iter().find(|p| (p.pupil - s).abs() < 1e-9).copied();
            let (a, b) = (find(&f.tangential), find(&f.sagittal));
            let cell = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.4}"));
            writeln!(
                t,
                "  {:>7.2} {:>8.1} {s:>7.2} {:>12} {:>12} {:>12} {:>12}",
                f.field_deg,
                f.nm,
                cell(a.map(|p| p.error.y * 1e3)),
                cell(a.map(|p| p.opd)),
                cell(b.map(|p| p.error.x * 1e3)),
                cell(b.map(|p| p.opd))
            )?;
        }
        let line = |v: &[diopter::lens::analysis::FanPoint]| {
            v.iter().map(|p| json!({ "pupil": p.pupil, "error_mm": p.error.to_array(), "opd_waves": p.opd })).collect::<Vec<_>>()
        };
        values.push(json!({ "field_deg": f.field_deg, "wavelength_nm": f.nm, "tangential": line(&f.tangential), "sagittal": line(&f.sagittal) }));
    }
    if values.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    finish(asked, || draw::fan_plot(&table.title("ray fans"), &fields), &t, &json!(values), json)
}

fn mtf(asked: &Asked, over: MtfOver, frequencies: Option<&[f64]>, geometric: bool, json: bool) -> anyhow::Result<()> {
    if let Some(bad) = frequencies.and_then(|f| f.iter().find(|f| !(**f > 0.0 && **f <= 10_000.0))) {
        return Err(AskedWrongly(anyhow!("frequency {bad}: expected above 0, and at most 10000 cycles/mm")).into());
    }
    let table = Table::new(asked)?;
    let bench = table.bench();
    let colors: Vec<(f64, f64)> = table.wavelengths.iter().map(|nm| (*nm, 1.0)).collect();
    let at = |field: f64, frequencies: &[f64], defocus: f64| match geometric {
        true => bench.geometric_mtf(field, &colors, frequencies, defocus),
        false => bench.diffraction_mtf(field, &colors, frequencies, defocus),
    };
    // What stands in where the wavefront is too steep is not called diffraction.
    let title = |curves: &[Mtf]| {
        let geometric = curves.iter().filter(|m| m.geometric).count();
        table.title(match geometric {
            0 => "diffraction MTF",
            all if all == curves.len() => "geometric MTF",
            _ => "MTF with diffraction, geometric where the wavefront is too steep for it to matter",
        })
    };
    let mut t = String::new();
    let mut values = vec![];
    let highest = frequencies.and_then(|f| f.last().copied()).unwrap_or(100.0);
    let curves: Vec<Mtf>;
    let figure = match over {
        MtfOver::Frequency => {
            let steps: Vec<f64> = (0..=80).map(|i| highest * i as f64 / 80.0).collect();
            curves = table.fields.iter().filter_map(|f| at(*f, &steps, 0.0)).collect();
            writeln!(t, "{}", title(&curves))?;
            for m in &curves {
                let kind = if m.geometric { ", geometric" } else { "" };
                writeln!(t, "  field {:.2}°{kind}\n  {:>10} {:>11} {:>9}", m.field_deg, "cycles/mm", "tangential", "sagittal")?;
                for i in (0..steps.len()).step_by(8) {
                    writeln!(t, "  {:>10.2} {:>11.4} {:>9.4}", steps[i], m.tangential[i], m.sagittal[i])?;
                }
            }
            let limit: Vec<f64> = steps.iter().map(|f| airy_mtf(*f, table.reference, table.f_number())).collect();
            draw::mtf_plot(&title(&curves), &curves, Some(&limit))
        }
        MtfOver::Field | MtfOver::Focus => {
            let wanted = frequencies.unwrap_or(&[10.0, 30.0]).to_vec();
            let most = table.largest_field();
            // Through focus: as far as the geometric blur at f/N covers a period of the lowest frequency.
            let depth = 0.5 * table.set.f_number / wanted[0];
            let steps: Vec<(f64, f64, f64)> = match over {
                MtfOver::Field => over_fields(asked, most, 14)?.into_iter().map(|f| (f, f, 0.0)).collect(),
                _ => (-12..=12).map(|i| (depth * i as f64 / 12.0, table.fields[0], depth * i as f64 / 12.0)).collect(),
            };
            let label = if over == MtfOver::Field { "field angle, degrees" } else { "defocus, mm" };
            let each: Vec<(f64, Mtf)> = steps.iter().filter_map(|(x, f, d)| Some((*x, at(*f, &wanted, *d)?))).collect();
            curves = each.iter().map(|e| e.1.clone()).collect();
            writeln!(t, "{}", title(&curves))?;
            writeln!(
                t,
                "  {label:>20} {}",
                wanted.iter().map(|f| format!("{:>9} {:>9}", format!("T {f:.0}"), format!("S {f:.0}"))).collect::<String>()
            )?;
            for (x, m) in &each {
                let cells: String =
                    (0..wanted.len()).map(|i| format!("{:>9.4} {:>9.4}", m.tangential[i], m.sagittal[i])).collect();
                writeln!(t, "  {x:>20.4} {cells}{}", if m.geometric { "  geometric" } else { "" })?;
            }
            draw::mtf_over_plot(&title(&curves), label, &wanted, &each)
        }
    };
    for m in &curves {
        let kind = if m.geometric { "geometric" } else { "diffraction" };
        values.push(json!({ "field_deg": m.field_deg, "kind": kind, "frequency_per_mm": m.frequencies, "tangential": m.tangential, "sagittal": m.sagittal }));
    }
    if values.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    finish(asked, || figure, &t, &json!(values), json)
}

fn distortion(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let fields: Vec<f64> = match &asked.field {
        Some(list) if list.0.len() > 1 => list.0.clone(),
        _ => (0..=20).map(|i| table.largest_field() * i as f64 / 20.0).collect(),
    };
    let points: Vec<_> = fields.iter().filter_map(|f| bench.field_point(*f, table.reference)).collect();
    if points.is_empty() {
        return Err(no_light(fields[0]));
    }
    let mut t = format!("{}\n", table.title("distortion and field curvature"));
    writeln!(
        t,
        "  {:>8} {:>12} {:>12} {:>12} {:>12} {:>12} {:>14} {:>14}",
        "field °", "height mm", "f tan θ mm", "distortion %", "f θ mm", "from f θ %", "tang. focus mm", "sag. focus mm"
    )?;
    // From 90° on there is no rectilinear image, on the axis no distortion.
    let cell = |v: f64, digits: usize| if v.is_finite() { format!("{v:.digits$}") } else { "-".into() };
    for p in &points {
        writeln!(
            t,
            "  {:>8.3} {:>12.5} {:>12} {:>12} {:>12.5} {:>12} {:>14.5} {:>14.5}",
            p.field_deg,
            p.height,
            cell(p.ideal_height, 5),
            cell(p.distortion_percent(), 4),
            p.equidistant_height,
            cell(p.equidistant_percent(), 4),
            p.focus[0],
            p.focus[1]
        )?;
    }
    if points[0].axial_height.abs() > 1e-6 {
        let origin = points[0].axial_height;
        writeln!(t, "  the axis is imaged at y {origin:.5} mm: ideal heights and distortion count from there")?;
    }
    let values: Vec<Value> = points
        .iter()
        .map(|p| json!({ "field_deg": p.field_deg, "height_mm": p.height, "axial_height_mm": p.axial_height, "ideal_height_mm": p.ideal_height, "distortion_percent": p.distortion_percent(),
            "equidistant_height_mm": p.equidistant_height, "equidistant_percent": p.equidistant_percent(), "focus_mm": p.focus }))
        .collect();
    finish(asked, || draw::distortion_plot(&table.title(""), &points), &t, &json!(values), json)
}

fn vignetting(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let most = table.largest_field();
    let fields = over_fields(asked, most, 14)?;
    let height_of = |field: f64| bench.field_point(field, table.reference).map(|p| p.height.abs());
    let heights: Vec<f64> = match is_list(asked) {
        // The places on the film where the fields that were asked for are seen.
        true => fields.iter().filter_map(|f| height_of(*f)).collect(),
        false => {
            let height = height_of(most).unwrap_or(0.36 * table.set.efl);
            (0..=20).map(|i| height * i as f64 / 20.0).collect()
        }
    };
    let light: Vec<Illumination> = heights.iter().map(|h| bench.illumination(*h, table.reference)).collect();
    let beams: Vec<(f64, f64)> = fields.into_iter().filter_map(|f| Some((f, bench.vignetting(f, table.reference)?))).collect();
    let axis = bench.illumination(0.0, table.reference);
    if axis.geometric <= 0.0 {
        return Err(no_light(0.0));
    }
    let mut t = format!("{}\n", table.title("vignetting"));
    writeln!(t, "  {:>10} {:>14} {:>10} {:>14} {:>12}", "height mm", "E/L sr", "relative", "with losses", "relative")?;
    for l in &light {
        writeln!(
            t,
            "  {:>10.3} {:>14.6e} {:>10.4} {:>14.6e} {:>12.4}",
            l.height,
            l.geometric,
            l.geometric / axis.geometric,
            l.with_losses,
            l.with_losses / axis.with_losses
        )?;
    }
    writeln!(t, "  {:>10} {:>22}", "field °", "beam area, of the axis")?;
    for (f, v) in &beams {
        writeln!(t, "  {f:>10.3} {v:>22.4}")?;
    }
    let pupils: Vec<_> = table.fields.iter().filter_map(|f| bench.pupil_shape(*f, table.reference)).collect();
    writeln!(t, "  {:>10} {:>18} {:>18}", "field °", "pupil width mm", "height mm")?;
    for p in &pupils {
        let size = |axis: usize| {
            let values = p.entrance.iter().map(|p| p[axis]);
            values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
        };
        writeln!(t, "  {:>10.3} {:>18.4} {:>18.4}", p.field_deg, size(0), size(1))?;
    }
    let outline = |v: &[diopter::lens::analysis::PupilPoint]| v.iter().map(|p| p.to_array()).collect::<Vec<_>>();
    let value = json!({
        "pupils": pupils.iter().map(|p| json!({ "field_deg": p.field_deg, "entrance_mm": outline(&p.entrance), "exit_mm": outline(&p.exit) })).collect::<Vec<_>>(),
        "illumination": light.iter().map(|l| json!({ "height_mm": l.height, "geometric_sr": l.geometric, "with_losses_sr": l.with_losses })).collect::<Vec<_>>(),
        "beam_area": beams.iter().map(|(f, v)| json!({ "field_deg": f, "relative": v })).collect::<Vec<_>>(),
    });
    finish(asked, || draw::vignetting_plot(&table.title(""), &light, &beams, &pupils), &t, &value, json)
}

fn color(asked: &Asked, json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let wavelengths: Vec<f64> = match &asked.wavelength {
        Some(list) if list.0.len() > 1 => list.0.clone(),
        _ => (0..=30).map(|i| 400.0 + 10.0 * i as f64).collect(),
    };
    let curves = table.bench().color(&wavelengths, table.reference, &table.fields);
    let mut t = format!("{}\n", table.title(&format!("colour, against {:.1} nm", table.reference)));
    let heads: String = table.fields.iter().map(|f| format!(" {:>12}", format!("{f:.2}° µm"))).collect();
    writeln!(t, "  {:>8} {:>12}{heads}", "nm", "axial mm")?;
    for (i, nm) in wavelengths.iter().enumerate() {
        let cells: String = curves.lateral.iter().map(|(_, v)| format!(" {:>12.4}", v[i] * 1e3)).collect();
        writeln!(t, "  {nm:>8.1} {:>12.6}{cells}", curves.axial[i])?;
    }
    let lateral: Vec<Value> = curves.lateral.iter().map(|(f, v)| json!({ "field_deg": f, "height_mm": v })).collect();
    let value =
        json!({ "wavelength_nm": wavelengths, "reference_nm": table.reference, "axial_mm": curves.axial, "lateral": lateral });
    finish(asked, || draw::color_plot(&table.title(""), &curves), &t, &value, json)
}

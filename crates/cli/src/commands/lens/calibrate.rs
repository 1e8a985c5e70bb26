//! `lens calibrate`: what a traced lens does, as models and tables for other programs.

use super::{GlobalFlags, print_json};
use crate::UsageError;
use crate::output::{Output, distinct};
use crate::watch::say;
use anyhow::anyhow;
use diopter::Film;
use diopter::calibration::observe::{falloff, observe, seen_from_camera};
use diopter::calibration::st_map::{self, MapDirection, Straight};
use diopter::calibration::{Calibration, Fit, Format, ModelKind, PrincipalRay, fit, json, ray_table};
use diopter::lens::calibrated::RayTable;
use diopter::lens::compound::{Setting, printed_focal_length};
use diopter::lens::{CompoundLens, Focus, Lens};
use diopter::quantity::{Distance, FNumber, LengthMm, Size};
use diopter::sensor::format;
use diopter::shot::flag_values::{shift, tilt, wavelength};
use diopter::shot::{LARGEST_SIDE, ShotError, read_body, read_lens};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Models that `--model all` fits.
const ALL: [ModelKind; 13] = [
    ModelKind::Pinhole,
    ModelKind::SimpleRadial,
    ModelKind::Radial,
    ModelKind::OpenCv4,
    ModelKind::OpenCv5,
    ModelKind::OpenCv8,
    ModelKind::OpenCv12,
    ModelKind::OpenCv14,
    ModelKind::Fisheye,
    ModelKind::ThinPrismFisheye,
    ModelKind::FTheta,
    ModelKind::DoubleSphere,
    ModelKind::Division,
];

/// Camera models that say what the lens does, fitted to traced rays, for OpenCV, COLMAP, nerfstudio, Kalibr, lensfun; ST maps, ray tables.
#[derive(clap::Args, Debug)]
pub struct Calibrate {
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    lens: String,
    /// Pixels of the picture.
    #[arg(long, value_name = "WxH", default_value = "6000x4000")]
    size: Size,
    /// Camera body: its film; a name from `body list` or a TOML file. The usual one without.
    #[arg(long, value_name = "NAME|FILE")]
    body: Option<String>,
    /// Film instead of the body's: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM")]
    film: Option<String>,
    /// Where a zoom is set: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    focal_length: Option<LengthMm>,
    /// A zoom position that the prescription prints, 1 the first.
    #[arg(long, value_name = "N", conflicts_with = "focal_length")]
    zoom_position: Option<usize>,
    /// f-number; fully open without.
    #[arg(long, value_name = "F")]
    aperture: Option<FNumber>,
    /// Distance from the entrance pupil that is in focus: "2.5m"; infinity without.
    #[arg(long, value_name = "DISTANCE")]
    focus: Option<Distance>,
    /// Move the lens against the film, to the right and up: "5mm", "0,8mm".
    #[arg(long, value_name = "X[,Y]", value_parser = shift, allow_hyphen_values = true)]
    shift: Option<[f64; 2]>,
    /// Turn the lens against the film about its rear principal point, forward and to the right: "8deg", "0,5deg".
    #[arg(long, value_name = "X[,Y]", value_parser = tilt, allow_hyphen_values = true)]
    tilt: Option<[f64; 2]>,
    /// Camera model, or several ("opencv5,opencv-fisheye"; the first is written), or all.
    ///
    /// pinhole, simple-radial, radial, opencv4, opencv5, opencv8, opencv12, opencv14, opencv-fisheye, thin-prism-fisheye, f-theta, double-sphere,
    /// division. Without, opencv5 for pictures within 60° of the axis and opencv-fisheye for wider ones.
    #[arg(long, value_name = "NAMES")]
    model: Option<String>,
    /// Fit the mean direction of all light through the pupil instead of the chief ray.
    #[arg(long)]
    centroid: bool,
    /// Wavelength of the ray, nm; 587.6 without. A lens with lateral colour has another calibration for each colour.
    #[arg(long, value_name = "NM", value_parser = wavelength)]
    wavelength: Option<f64>,
    /// Format of the files, where their names do not say it, or another one of their ending: json, opencv, colmap, nerfstudio, kalibr, lensfun, st-map, st-map-undistort, ray-table.
    #[arg(long, value_name = "NAME")]
    format: Option<String>,
    /// File to write; may be given several times.
    ///
    /// .json (everything), .yaml (OpenCV, ROS), cameras.txt (COLMAP), transforms.json (nerfstudio), camchain.yaml (Kalibr), .xml (lensfun), distort.exr and undistort.exr
    /// (ST maps), rays.exr (a ray for each pixel).
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
}

impl Calibrate {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        if let (Some(format), true) = (&self.format, self.output.is_empty()) {
            let wrong = anyhow!("--format {format}: expected a file to write by it: -o NAME (a film is --film)");
            return Err(UsageError(wrong).into());
        }
        let formats = self.output.iter().map(|path| format_of(path, self)).collect::<anyhow::Result<Vec<_>>>()?;
        distinct([Path::new(&self.lens)], self.output.iter().map(|p| p.as_path()))?;
        let outputs = self.output.iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<Vec<_>>>()?;
        let film = film(self)?;
        let lens = lens(self, &film)?;
        let which = principal_ray(self)?;
        let observed = observe(&lens, &film, which);
        let kinds = match self.model.as_deref() {
            None => vec![fit::suitable(&observed)],
            Some("all") => ALL.to_vec(),
            Some(list) => list.split(',').map(|name| named(name.trim())).collect::<anyhow::Result<_>>()?,
        };
        let fits: Vec<(ModelKind, Result<Fit, _>)> = kinds.iter().map(|kind| (*kind, fit::fit(*kind, &observed))).collect();
        // Of all models the one that follows the lens most closely is written, of those that were asked for by name the first that fits.
        let mut good = fits.iter().filter_map(|(_, fit)| fit.as_ref().ok());
        let best = match self.model.as_deref() {
            Some("all") => good.min_by(|a, b| a.rms_px.total_cmp(&b.rms_px)),
            _ => good.next(),
        };
        let Some(best) = best else {
            let (_, failed) = fits.into_iter().next().ok_or_else(|| anyhow!("no model"))?;
            return Err(failed.err().map_or_else(|| anyhow!("no model fits"), anyhow::Error::from));
        };
        let body = read_body(self.body.as_deref().unwrap_or(DEFAULT_BODY))?.name;
        let name = match &lens {
            Lens::Compound(l) => l.prescription().name.clone(),
            _ => self.lens.clone(),
        };
        let calibration = Calibration {
            body,
            lens: name,
            size: [film.columns, film.rows],
            film_mm: [film.width_mm, film.height_mm],
            focal_length_mm: lens.focal_length().0,
            f_number: lens.f_number(),
            focus_distance_m: lens.focus_distance().map(|d| d.0 / 1000.0),
            model: best.model.clone(),
            fit: Some(best.clone()),
            falloff: falloff(&lens, &film),
            frames: Vec::new(),
        };
        let table = match formats.iter().any(|f| !f.is_text()) {
            true => Some(ray_table::trace(&lens, &film, which)?),
            false => None,
        };
        // All that a format may refuse is known before the first file is written.
        let text = |format: &Format| calibration.text(*format).map_err(|e| UsageError(e.into()));
        let texts = formats.iter().map(|f| f.is_text().then(|| text(f)).transpose()).collect::<Result<Vec<_>, _>>()?;
        for ((format, text), output) in formats.into_iter().zip(texts).zip(outputs) {
            let path = write(format, text, output, &calibration, &lens, table.as_ref())?;
            say(&format!("wrote {}", path.display()));
        }
        if global.json {
            let models: Vec<Value> = fits
                .iter()
                .map(|(kind, fit)| match fit {
                    Ok(fit) => json!({ "model": json::model(&fit.model), "fit": json::fit(fit) }),
                    Err(e) => json!({ "model": { "name": kind.name() }, "error": e.to_string() }),
                })
                .collect();
            return print_json(&json!({
                "lens": calibration.lens, "body": calibration.body, "size": calibration.size, "film_mm": calibration.film_mm,
                "focal_length_mm": calibration.focal_length_mm, "f_number": calibration.f_number,
                "focus_distance_m": calibration.focus_distance_m, "ray": if self.centroid { "centroid" } else { "chief" },
                "wavelength_nm": which.wavelength_nm, "models": models, "files": self.output,
            }));
        }
        write!(std::io::stdout(), "{}", told(&calibration, &fits)?)?;
        Ok(())
    }
}

/// Which ray is calibrated. Fails outside the wavelengths that glasses are told for.
fn principal_ray(args: &Calibrate) -> anyhow::Result<PrincipalRay> {
    let wavelength_nm = args.wavelength.unwrap_or(PrincipalRay::CHIEF.wavelength_nm);
    match (300.0..=2500.0).contains(&wavelength_nm) {
        true => Ok(PrincipalRay { centroid: args.centroid, wavelength_nm }),
        false => Err(UsageError(anyhow!("--wavelength: found {wavelength_nm} nm, expected 300 to 2500 nm")).into()),
    }
}

/// Body whose film is used by default.
const DEFAULT_BODY: &str = "canon-5d-mark-iv";

/// A table of how well models fit.
fn told<E: std::fmt::Display>(c: &Calibration, fits: &[(ModelKind, Result<Fit, E>)]) -> anyhow::Result<String> {
    let mut t = String::new();
    let focus = c.focus_distance_m.map_or("∞".to_owned(), |d| format!("{d:.3} m"));
    writeln!(
        t,
        "{}   {:.2} mm f/{:.2}   focus {focus}   {} × {} pixels on {:.2} × {:.2} mm",
        c.lens, c.focal_length_mm, c.f_number, c.size[0], c.size[1], c.film_mm[0], c.film_mm[1]
    )?;
    writeln!(t, "{:<20} {:>10} {:>10} {:>9} {:>9} {:>9}", "model", "rms px", "max px", "fitted °", "seen °", "valid °")?;
    for (kind, fit) in fits {
        match fit {
            Ok(f) => writeln!(
                t,
                "{:<20} {:>10.4} {:>10.4} {:>9.2} {:>9.2} {:>9.2}",
                kind.name(),
                f.rms_px,
                f.max_px,
                f.fitted_angle.to_degrees(),
                f.seen_angle.to_degrees(),
                f.model.largest_angle().to_degrees()
            )?,
            Err(e) => writeln!(t, "{:<20} {e}", kind.name())?,
        }
    }
    let m = &c.model;
    writeln!(
        t,
        "{}: fx {:.4}  fy {:.4}  cx {:.4}  cy {:.4}",
        m.kind().name(),
        m.focal().x,
        m.focal().y,
        m.centre().x,
        m.centre().y
    )?;
    for (name, value) in m.kind().coefficients().iter().zip(m.coefficients()) {
        writeln!(t, "  {name:<8} {value:.9}")?;
    }
    Ok(t)
}

fn named(name: &str) -> anyhow::Result<ModelKind> {
    ModelKind::named(name).ok_or_else(|| {
        let all = ModelKind::NAMES.map(|n| n.0).join(", ");
        UsageError(anyhow!("model \"{name}\": expected all, or one or several of {all}")).into()
    })
}

/// What is written into a file.
fn format_of(path: &Path, args: &Calibrate) -> anyhow::Result<Format> {
    let format = match &args.format {
        Some(name) => {
            let format = Format::named(name).map_err(|e| UsageError(e.into()))?;
            if !format.suits(path) {
                let what = format!("--format {name}; expected a name that ends in .{}, or another --format", format.ending());
                return Err(UsageError(anyhow!("{}: {what}", path.display())).into());
            }
            format
        }
        None => Format::of(path).ok_or_else(|| {
            UsageError(anyhow!(
                "{}: expected a name that says the format (.json, .yaml, cameras.txt, transforms.json, camchain.yaml, .xml, distort.exr, \
                 undistort.exr, rays.exr) or --format",
                path.display()
            ))
        })?,
    };
    if format == Format::ColmapImages {
        let what = "images.txt holds pictures: expected `shoot ... -o images.txt`, or cameras.txt here";
        return Err(UsageError(anyhow!("{}: {what}", path.display())).into());
    }
    Ok(format)
}

/// The film of the body or format, cut to the shape of the picture.
fn film(args: &Calibrate) -> anyhow::Result<Film> {
    let size = args.size;
    if !(2..=LARGEST_SIDE).contains(&size.width) || !(2..=LARGEST_SIDE).contains(&size.height) {
        return Err(UsageError(anyhow!("size {size}: expected 2 to {LARGEST_SIDE} pixels a side")).into());
    }
    let [width, height] = match &args.film {
        None => read_body(args.body.as_deref().unwrap_or(DEFAULT_BODY))?.format_mm,
        Some(name) => {
            let found = format::Format::parse(name);
            let f = found
                .ok_or_else(|| UsageError(anyhow!("film \"{name}\": expected a format such as APS-C, or mm such as 36x24")))?;
            [f.width_mm, f.height_mm]
        }
    };
    let shape = size.width as f64 / size.height as f64;
    let (w, h) = if shape > width / height { (width, width / shape) } else { (height * shape, height) };
    let center_mm = args.shift.unwrap_or([0.0; 2]);
    if center_mm.iter().any(|s| s.abs() > w.hypot(h)) {
        let found = format!("shift {},{} mm", center_mm[0], center_mm[1]);
        return Err(UsageError(anyhow!("{found}: expected at most the film's {:.1} mm each way", w.hypot(h))).into());
    }
    Ok(Film { center_mm, ..Film::new(w, h, size.width, size.height) })
}

/// The lens as it is set.
fn lens(args: &Calibrate, film: &Film) -> anyhow::Result<Lens> {
    let prescription = read_lens(&args.lens)?;
    prescription.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let focal_length = match args.zoom_position {
        Some(position) => Some(printed_focal_length(&prescription, position).map_err(ShotError::from)?),
        None => args.focal_length.map(|f| f.0),
    };
    let setting = Setting {
        focal_length,
        f_number: args.aperture.map(|a| a.0),
        focus: args.focus.map_or(Focus::Infinity, |f| Focus::at_mm(f.0 * 1000.0)),
        iris: None,
        film_mm: (2.0 * film.reach()).to_array(),
    };
    let mut lens = CompoundLens::new(std::sync::Arc::new(prescription), &setting).map_err(ShotError::from)?;
    if let Some(tilt) = args.tilt.filter(|t| *t != [0.0; 2]) {
        lens = lens.tilted(tilt.map(f64::to_radians)).map_err(ShotError::from)?;
    }
    Ok(Lens::Compound(Box::new(lens)))
}

/// Writes one file: its text, or of a table of pixels the table.
fn write(
    format: Format,
    text: Option<String>,
    output: Output,
    calibration: &Calibration,
    lens: &Lens,
    table: Option<&RayTable>,
) -> anyhow::Result<std::path::PathBuf> {
    if let Some(text) = text {
        return output.commit(|to| Ok(to.write_all(text.as_bytes())?));
    }
    let table = table.ok_or_else(|| anyhow!("{format:?}: no table was traced for it"))?;
    let straight = Straight::of(&calibration.model);
    let seen = |ray| seen_from_camera(lens, ray);
    output.commit(|to| {
        match format {
            Format::RayTable => ray_table::write(table, to)?,
            Format::StDistort => {
                st_map::write(&st_map::distort(table, &straight, seen), calibration.size, &straight, MapDirection::Distort, to)?;
            }
            _ => {
                let places = st_map::undistort(table, &straight, &calibration.model, seen);
                st_map::write(&places, calibration.size, &straight, MapDirection::Undistort, to)?;
            }
        }
        Ok(())
    })
}

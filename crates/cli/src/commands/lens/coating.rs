//! `lens coating`: what the films on the surfaces of a lens do.

use super::{GlobalFlags, print_json};
use crate::args::values::{List, list};
use crate::output::Output;
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::lens::draw::{self, ReflectanceCurve};
use diopter::lens::prescription::coating_named;
use diopter::lens::ray::{TraceDirection, TracedRay};
use diopter::lens::{State, System};
use diopter::shot::read_lens;
use glam::{DVec2, DVec3};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;

/// Reflectance of the surfaces over wavelength and angle, layers, and what the lens lets through; -o also writes .csv and .json.
#[derive(clap::Args, Debug)]
pub struct Coating {
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    lens: String,
    /// Only this surface, 1 the first; without, all that are between different media.
    #[arg(long, value_name = "N")]
    surface: Option<usize>,
    /// Instead of the lens's own coating: none, MgF2, multi, perfect, single, V, broadband, modern, year.
    #[arg(long, value_name = "NAME")]
    coating: Option<String>,
    /// Angles of incidence in the thinner medium, degrees: "0,30,45".
    #[arg(long, value_name = "LIST", value_parser = list, default_value = "0,30,45,60")]
    angle: List,
    /// Chart (.svg, .png) or figures (.csv, .json) to write; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
}

impl Coating {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let wrong = |what: String| anyhow::Error::from(UsageError(anyhow!(what)));
        let mut prescription = read_lens(&self.lens)?;
        prescription.notes.iter().for_each(|note| say(&format!("note: {note}")));
        if let Some(name) = &self.coating {
            prescription.coating = coating_named(name, prescription.known_year()).map_err(wrong)?;
            prescription.surfaces.iter_mut().for_each(|s| s.coating = None);
        }
        if let Some(bad) = self.angle.0.iter().find(|a| !(0.0..90.0).contains(*a)) {
            return Err(wrong(format!("angle {bad}: expected 0 or more and less than 90 degrees")));
        }
        let system = System::at(&prescription, State::default());
        let count = system.surfaces.len();
        if let Some(n) = self.surface.filter(|n| !(1..=count).contains(n)) {
            return Err(wrong(format!("surface {n}: expected 1 to {count}")));
        }
        let is_boundary = |i: usize| system.surfaces[i].mirror || system.glasses[i] != system.glasses[i + 1];
        let chosen: Vec<usize> = match self.surface {
            Some(n) => vec![n - 1],
            None => (0..count).filter(|i| is_boundary(*i)).collect(),
        };
        let extension = |p: &PathBuf| p.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let (figures, drawings): (Vec<PathBuf>, Vec<PathBuf>) =
            self.output.iter().cloned().partition(|p| matches!(extension(p).as_str(), "csv" | "json"));
        if let Some(bad) = drawings.iter().find(|p| !matches!(extension(p).as_str(), "svg" | "png")) {
            return Err(wrong(format!("{}: expected a name that ends in .svg, .png, .csv or .json", bad.display())));
        }
        let drawings = paint::prepare(&drawings)?;
        let figures: Vec<(bool, Output)> =
            figures.iter().map(|p| Ok((extension(p) == "csv", Output::prepare(p)?))).collect::<anyhow::Result<_>>()?;

        // Light comes from the thinner medium, where every angle below 90° exists.
        let response = |i: usize, degrees: f64, nm: f64| {
            let n = [system.glasses[i].index(nm), system.glasses[i + 1].index(nm)];
            let surface = &system.surfaces[i];
            let (way, n) = if surface.mirror || n[0] <= n[1] {
                (TraceDirection::ToFilm, n)
            } else {
                (TraceDirection::ToObject, [n[1], n[0]])
            };
            surface.coating.response(surface.mirror, way, n, degrees.to_radians().cos(), nm)
        };
        let curves: Vec<ReflectanceCurve> = chosen
            .iter()
            .flat_map(|i| self.angle.0.iter().map(move |a| (*i, *a)))
            .map(|(i, angle_deg)| {
                let over = |k: usize| wavelengths().map(|nm| DVec2::new(nm, response(i, angle_deg, nm).reflectance[k])).collect();
                ReflectanceCurve { surface: i + 1, angle_deg, s: over(0), p: over(1) }
            })
            .collect();
        let through: Vec<(f64, f64)> = wavelengths().map(|nm| (nm, on_axis(&system, nm))).collect();

        let mut t = format!("{}\n  coating  {}\n\n", prescription.name, prescription.coating.describe());
        let heads: String = self.angle.0.iter().map(|a| format!(" {:>9}", format!("{a}°"))).collect();
        writeln!(t, "  mean reflectance of s and p over 425-675 nm, %\n  {:>3}{heads}  layers from the object's side", "")?;
        for i in &chosen {
            let mean = |angle: &f64| {
                let all = (0..=50).map(|k| response(*i, *angle, 425.0 + 5.0 * k as f64).unpolarised_reflectance());
                100.0 * all.sum::<f64>() / 51.0
            };
            let cells: String = self.angle.0.iter().map(|a| format!(" {:>9.3}", mean(a))).collect();
            writeln!(t, "  {:>3}{cells}  {}", i + 1, system.surfaces[*i].coating.describe())?;
        }
        writeln!(t, "\n  on the axis the lens lets through (all surfaces, absorption of glasses and films)")?;
        for (nm, fraction) in through.iter().step_by(8) {
            writeln!(t, "  {nm:>6.0} nm {:>8.2} %", 100.0 * fraction)?;
        }
        let rows = |points: &[DVec2]| points.iter().map(|p| p.y).collect::<Vec<_>>();
        let surfaces: Vec<Value> = curves
        .iter()
        .map(|c| {
            let coating = system.surfaces[c.surface - 1].coating.describe();
            json!({ "surface": c.surface, "coating": coating, "angle_deg": c.angle_deg, "reflectance_s": rows(&c.s), "reflectance_p": rows(&c.p) })
        })
        .collect();
        let transmittance: Vec<f64> = through.iter().map(|v| v.1).collect();
        let value = json!({ "name": prescription.name, "coating": prescription.coating.describe(),
        "wavelength_nm": wavelengths().collect::<Vec<_>>(), "curves": surfaces, "axial_transmittance": transmittance });

        let mut written = paint::write(drawings, &draw::coating_plot(&prescription.name, &curves))?;
        for (csv, output) in figures {
            let text = if csv { table(&curves) } else { format!("{}\n", serde_json::to_string_pretty(&value)?) };
            written.push(output.commit(|w| Ok(w.write_all(text.as_bytes())?))?);
        }
        written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
        if global.json {
            return print_json(&value);
        }
        write!(std::io::stdout(), "{t}")?;
        Ok(())
    }
}

/// Wavelengths of curves, nm.
fn wavelengths() -> impl Iterator<Item = f64> {
    (0..=80).map(|i| 380.0 + 5.0 * i as f64)
}

/// A row for each wavelength, columns for surface, angle and polarisation.
fn table(curves: &[ReflectanceCurve]) -> String {
    let mut t = String::from("nm");
    for c in curves {
        t.push_str(&format!(",surface {0} {1} deg s,surface {0} {1} deg p", c.surface, c.angle_deg));
    }
    t.push('\n');
    for (i, nm) in wavelengths().enumerate() {
        t.push_str(&format!("{nm}"));
        for c in curves {
            t.push_str(&format!(",{:.8},{:.8}", c.s[i].y, c.p[i].y));
        }
        t.push('\n');
    }
    t
}

/// Fraction of the light along the axis that reaches the film; obstructions in the middle do not count.
fn on_axis(system: &System, nm: f64) -> f64 {
    let mut open = system.clone();
    open.surfaces.iter_mut().for_each(|s| s.obstruction = 0.0);
    let ray = TracedRay { position: DVec3::new(0.0, 0.0, -1.0), direction: DVec3::Z };
    open.transmittance(ray, &open.indices(nm), nm, TraceDirection::ToFilm).unwrap_or(0.0)
}

//! `lens ghosts`: light that is reflected between surfaces.

use super::bench::{Bench, Table, no_light};
use super::{GlobalFlags, print_json};
use crate::output::Output;
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::lens::draw::{self, DrawnGhost};
use diopter::lens::ghosts::{AtSensor, BeamGhost, GhostTracer, ParaxialGhost, SourceBeam, pairs, reflects, strong_fours};
use diopter::lens::prescription::coating_named;
use diopter::quantity::LengthMm;
use diopter::shot::flag_values::degrees;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;

/// Wavelengths at which the colour of a ghost is told, nm: blue, green, red.
const COLORS_NM: [f64; 3] = [450.0, 550.0, 620.0];
/// Solid angle of the sun as the earth sees it (half angle 0.2666°), sr.
const SUN_SR: f64 = 6.80e-5;

/// Rays across the front with which orders of the grating are looked for.
const LOOK: usize = 6;
/// Orders of the grating that are traced, the strongest.
const MOST_ORDERS: usize = 200;
/// Most ghosts of four reflections that are looked for.
const MOST_FOURS: usize = 1000;

/// Ghosts: every pair of surfaces, and of a surface and the sensor, whose reflections bring light of a distant source onto the film; focus, size,
/// place, irradiance; -o also writes .json.
#[derive(clap::Args, Debug)]
pub struct Ghosts {
    #[command(flatten)]
    bench: Bench,
    /// Angle of the source to the axis, upwards in the scene: "10deg".
    #[arg(long, value_name = "ANGLE", value_parser = degrees, default_value = "10deg", allow_hyphen_values = true)]
    source: f64,
    /// Instead of the lens's own coating: none, MgF2, multi, perfect, single, V, broadband, modern, year.
    #[arg(long, value_name = "NAME")]
    coating: Option<String>,
    /// Fraction of the light that the sensor reflects.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.04)]
    sensor_reflectance: f64,
    /// So many ghosts of four reflections beside, those that are strongest to first order.
    #[arg(long, value_name = "N", default_value_t = 0)]
    fours: usize,
    /// Distance between the pixels of a sensor whose microlenses are a grating ("5.4um"): its orders are listed, too, as "sensor(1,0)".
    #[arg(long, value_name = "LENGTH")]
    pixel_pitch: Option<LengthMm>,
    /// Rays across the part of the front whose light makes a ghost.
    #[arg(long, value_name = "N", default_value_t = 48)]
    rays: usize,
    /// Ghosts to list, the strongest first; 0 for all.
    #[arg(long, value_name = "N", default_value_t = 25)]
    top: usize,
}

impl Ghosts {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let pixel_pitch_mm = self.pixel_pitch.map(|p| p.0);
        let wrong = |what: String| anyhow::Error::from(UsageError(anyhow!(what)));
        if !(0.0..=1.0).contains(&self.sensor_reflectance) {
            return Err(wrong(format!("sensor reflectance {}: expected 0 to 1", self.sensor_reflectance)));
        }
        if self.fours > MOST_FOURS {
            return Err(wrong(format!("fours {}: expected 0 to {MOST_FOURS}", self.fours)));
        }
        if let Some(pitch) = pixel_pitch_mm.filter(|p| !(0.0005..=0.02).contains(p)) {
            return Err(wrong(format!(
                "pixel pitch {} um: expected 0.5 to 20 um: larger pixels are no grating that shows",
                pitch * 1e3
            )));
        }
        if !(4..=1000).contains(&self.rays) {
            return Err(wrong(format!("rays {}: expected 4 to 1000", self.rays)));
        }
        let is_json = |p: &PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        let (texts, drawings): (Vec<PathBuf>, Vec<PathBuf>) = self.bench.output.iter().cloned().partition(is_json);
        let drawings = paint::prepare(&drawings)?;
        let texts: Vec<Output> = texts.iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<_>>()?;

        let mut table = Table::new(&self.bench)?;
        if let Some(name) = &self.coating {
            let coating = coating_named(name, table.prescription.known_year()).map_err(wrong)?;
            table.set.system.recoat(&coating);
            table.prescription.coating = coating;
        }
        let system = &table.set.system;
        let count = system.surfaces.len();
        let beam = SourceBeam::at_field(system, self.source)
            .ok_or_else(|| wrong(format!("source at {}°: expected an angle below 90 degrees", self.source)))?;
        let tracer_at = |nm: f64| {
            let plain = GhostTracer::new(system, nm, self.sensor_reflectance);
            pixel_pitch_mm.map_or(plain.clone(), |pitch| plain.with_microlenses([pitch; 2]))
        };
        let tracer = tracer_at(table.reference);
        let colored = COLORS_NM.map(tracer_at);
        let direct = BeamGhost::of(&tracer, &beam, &[], self.rays);
        if direct.is_none() {
            say(&format!("note: {}", no_light(self.source)));
        }
        let all = pairs(system);
        let of = |turns: Vec<usize>| GhostPath { turns, order: None };
        let mut ways: Vec<GhostPath> = all.iter().map(|pair| of(vec![pair.back, pair.forth])).collect();
        ways.extend(strong_fours(&tracer, 0.0, self.fours).into_iter().map(|four| of(four.to_vec())));
        ways.extend(orders(&tracer, &beam));
        let across = (self.rays / 3).max(4);
        let at_sensor = |tracer: &GhostTracer, across: usize| tracer.grating().and_then(|_| AtSensor::of(tracer, &beam, across));
        let direct_light = at_sensor(&tracer, self.rays);
        let direct_colors = [0, 1, 2].map(|k| at_sensor(&colored[k], across));
        let mut found: Vec<Found> = ways
            .par_iter()
            .filter_map(|way| {
                let ghost = way.ghost(&tracer, &beam, direct_light.as_ref(), self.rays)?;
                let color =
                    |k: usize| way.ghost(&colored[k], &beam, direct_colors[k].as_ref(), across).map_or(0.0, |g| g.flux_mm2);
                let colors = [0, 1, 2].map(color);
                let paraxial = way.order.map_or_else(|| ParaxialGhost::of(&tracer, &way.turns), |_| None);
                Some(Found { way: way.clone(), paraxial, beam: ghost, colors })
            })
            .collect();
        found.sort_by(|a, b| b.beam.irradiance().total_cmp(&a.beam.irradiance()));

        let title = table.title(&format!("ghosts of a source at {}°, {:.0} nm", self.source, table.reference));
        let direct_flux = direct.map(|d| d.flux_mm2);
        // The image of the sun: its flux over the area of its disc on the film.
        let sun = direct_flux.map(|flux| flux / (table.set.efl * table.set.efl * SUN_SR));
        let mut t = format!(
            "{title}\n  coating {}, sensor reflects {:.1} %\n",
            table.prescription.coating.describe(),
            100.0 * self.sensor_reflectance
        );
        let more = match ways.len() - all.len() {
            0 => String::new(),
            more => format!(" and {more} more ways"),
        };
        writeln!(t, "  {} pairs of surfaces{more}, {} of them reach the film\n", all.len(), found.len())?;
        writeln!(
            t,
            "  {:>14} {:>11} {:>11} {:>9} {:>9} {:>9} {:>10}  {:>5} {:>5}",
            "surfaces", "irradiance", "/ sun image", "x mm", "y mm", "rms mm", "focus mm", "B/G", "R/G"
        )?;
        let listed = if self.top == 0 { found.len() } else { self.top.min(found.len()) };
        for g in &found[..listed] {
            let [blue, green, red] = g.colors;
            let over = |v: f64| if green > 0.0 { format!("{:.2}", v / green) } else { "-".into() };
            let relative = sun.map_or("-".into(), |s| format!("{:.3e}", g.beam.irradiance() / s));
            writeln!(
                t,
                "  {:>14} {:>11.3e} {relative:>11} {:>9.3} {:>9.3} {:>9.3} {:>10}  {:>5} {:>5}",
                g.way.describe(count),
                g.beam.irradiance(),
                g.beam.center.x,
                g.beam.center.y,
                g.beam.rms_radius_mm(),
                g.paraxial.map_or("-".into(), |p| format!("{:.2}", p.focus_mm)),
                over(blue),
                over(red)
            )?;
        }
        // An empty sum is -0.
        let flux = found.iter().map(|g| g.beam.flux_mm2).sum::<f64>() + 0.0;
        writeln!(
            t,
            "\n  irradiance: on the film over that of the source at the front; focus: of parallel light, behind the film"
        )?;
        if let Some(direct) = direct_flux {
            writeln!(t, "  light of all ghosts over that of the image: {:.3e}", flux / direct)?;
        }
        let rows: Vec<Value> = found.iter().map(|g| row(g, count, direct_flux, sun)).collect();
        let value = json!({ "lens": table.prescription.name, "source_deg": self.source, "wavelength_nm": table.reference,
        "coating": table.prescription.coating.describe(), "sensor_reflectance": self.sensor_reflectance, "pairs": all.len(),
        "direct": direct.map(|d| json!({ "flux_mm2": d.flux_mm2, "center_mm": d.center.to_array(), "rms_radius_mm": d.rms_radius_mm() })),
        "colors_nm": COLORS_NM, "ghosts": rows });

        let drawn: Vec<DrawnGhost> = found[..listed]
            .iter()
            .map(|g| DrawnGhost {
                name: g.way.describe(count),
                center: g.beam.center,
                moments: g.beam.moments,
                irradiance: g.beam.irradiance(),
            })
            .collect();
        let radius = table.prescription.image_circle.map_or(0.43 * table.set.efl, |c| 0.5 * c);
        let mut written = paint::write(drawings, &draw::ghost_plot(&title, &drawn, direct.map(|d| d.center), radius))?;
        for output in texts {
            let text = format!("{}\n", serde_json::to_string_pretty(&value)?);
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

/// How light of a ghost goes: where it is reflected, and in which order of the grating by the sensor.
#[derive(Clone)]
struct GhostPath {
    turns: Vec<usize>,
    order: Option<[i32; 2]>,
}

impl GhostPath {
    /// As reports print it, surfaces counted from 1.
    fn describe(&self, count: usize) -> String {
        let one = |turn: &usize| match self.order {
            _ if *turn < count => (turn + 1).to_string(),
            None => "sensor".into(),
            Some([x, y]) => format!("sensor({x},{y})"),
        };
        self.turns.iter().map(one).collect::<Vec<_>>().join("-")
    }

    fn ghost(&self, tracer: &GhostTracer, beam: &SourceBeam, direct: Option<&AtSensor>, across: usize) -> Option<BeamGhost> {
        match self.order {
            None => BeamGhost::of(tracer, beam, &self.turns, across),
            Some(order) => BeamGhost::of_order(tracer, direct?, order, self.turns[1]),
        }
    }
}

/// Orders of the sensor's grating that come back to the film, those with the most light.
fn orders(tracer: &GhostTracer, beam: &SourceBeam) -> Vec<GhostPath> {
    let system = tracer.system();
    let count = system.surfaces.len();
    let Some([across, down]) = tracer.grating().map(|g| g.highest()) else { return vec![] };
    let Some(direct) = AtSensor::of(tracer, beam, LOOK) else { return vec![] };
    let all: Vec<[i32; 2]> =
        (-down..=down).flat_map(|y| (-across..=across).map(move |x| [x, y])).filter(|o| *o != [0; 2]).collect();
    let forths: Vec<usize> = (0..count).filter(|i| reflects(system, *i)).collect();
    let mut found: Vec<(f64, GhostPath)> = all
        .par_iter()
        .flat_map_iter(|order| {
            let of = |forth: &usize| {
                let ghost = BeamGhost::of_order(tracer, &direct, *order, *forth)?;
                Some((ghost.flux_mm2, GhostPath { turns: vec![count, *forth], order: Some(*order) }))
            };
            forths.iter().filter_map(of).collect::<Vec<_>>()
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MOST_ORDERS);
    found.into_iter().map(|f| f.1).collect()
}

/// A ghost and what is known of it.
struct Found {
    way: GhostPath,
    paraxial: Option<ParaxialGhost>,
    beam: BeamGhost,
    /// Flux at [`COLORS_NM`], mm².
    colors: [f64; 3],
}

/// A ghost in JSON; surfaces counted from 1, the sensor as null: the first two that throw it back, and all of them.
fn row(g: &Found, count: usize, direct_flux: Option<f64>, sun: Option<f64>) -> Value {
    let paraxial = g.paraxial.map(|p| {
        json!({ "focus_mm": p.focus_mm.is_finite().then_some(p.focus_mm), "spread": p.spread, "shift_mm": p.shift_mm,
            "pupil_radius_mm": p.pupil_radius_mm, "pupil_surface": p.pupil_surface + 1, "axial_radius_mm": p.radius_mm(),
            "fraction": p.fraction.is_finite().then_some(p.fraction) })
    });
    let turns: Vec<Option<usize>> = g.way.turns.iter().map(|turn| (*turn < count).then_some(turn + 1)).collect();
    json!({ "back": turns[0], "forth": turns[1], "turns": turns, "order": g.way.order, "flux_mm2": g.beam.flux_mm2,
        "irradiance": g.beam.irradiance(), "irradiance_over_sun_image": sun.map(|s| g.beam.irradiance() / s),
        "flux_over_image": direct_flux.map(|f| g.beam.flux_mm2 / f), "center_mm": g.beam.center.to_array(), "moments_mm2": g.beam.moments,
        "rms_radius_mm": g.beam.rms_radius_mm(), "bounds_mm": g.beam.bounds.map(|b| b.to_array()), "flux_by_color_mm2": g.colors,
        "paraxial": paraxial })
}

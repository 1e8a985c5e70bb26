//! `calc stop`: f-number, focal length and diameter of the aperture, N = f / D; the full stops with what they let through.

use super::exposure::{f_number, positive};
use crate::UsageError;
use crate::args::StopArgs;
use crate::commands::{print_json, shown};
use crate::paint;
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::draw::{Anchor, Color, Figure, Item};
use diopter::stops::{self, Step};
use glam::DVec2;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::Write as _;

/// Stops of the table and the drawing.
const SERIES: std::ops::RangeInclusive<f64> = 1.0..=32.0;

/// An opening.
struct Stop {
    /// As engraved.
    nominal: f64,
    f_number: f64,
    diameter_mm: f64,
}

impl Stop {
    fn area_mm2(&self) -> f64 {
        0.25 * PI * self.diameter_mm.powi(2)
    }

    /// Of f/1, whatever the focal length: the illuminance of the film goes as 1 / N² (ISO 2720).
    fn light(&self) -> f64 {
        self.f_number.powi(-2)
    }

    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "nominal": self.nominal, "f_number": self.f_number, "diameter_mm": self.diameter_mm, "radius_mm": 0.5 * self.diameter_mm,
            "area_mm2": self.area_mm2(), "light_of_f1": self.light(), "stops_from_f1": 2.0 * self.f_number.log2(),
        })
    }
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &StopArgs, json: bool) -> anyhow::Result<()> {
    let n = args.aperture.map(f_number).transpose()?;
    let f = args.focal_length.map(|v| positive("focal-length", v.0)).transpose()?;
    let d = args.diameter.map(|v| positive("diameter", v.0)).transpose()?;
    let outputs = paint::prepare(&args.output)?;
    let (focal, found) = match (n, f, d) {
        (Some(n), Some(f), None) => (f, Some((n, f / n))),
        (Some(n), None, Some(d)) => (n * d, Some((n, d))),
        (None, Some(f), Some(d)) => (f, Some((f_number(diopter::quantity::FNumber(f / d))?, d))),
        (None, Some(f), None) => (f, None),
        _ => {
            let given = [("--aperture", n.is_some()), ("--focal-length", f.is_some()), ("--diameter", d.is_some())];
            let given: Vec<&str> = given.iter().filter(|g| g.1).map(|g| g.0).collect();
            let found = if given.is_empty() { "none".to_owned() } else { given.join(", ") };
            let expected = "two of --aperture, --focal-length and --diameter, or --focal-length alone for the full stops";
            return Err(UsageError(anyhow!("calc stop: {found} given; expected {expected}")).into());
        }
    };
    let stop = found.map(|(f_number, diameter_mm)| {
        let nominal = stops::nearest(&stops::apertures(Step::Third), f_number).nominal;
        Stop { nominal, f_number, diameter_mm }
    });
    let full = stops::apertures(Step::Full);
    let series: Vec<Stop> = full
        .iter()
        .filter(|m| SERIES.contains(&m.nominal))
        .map(|m| Stop { nominal: m.nominal, f_number: m.value, diameter_mm: focal / m.value })
        .collect();
    if !outputs.is_empty() {
        for path in paint::write(outputs, &openings(focal, &series, stop.as_ref()))? {
            say(&format!("wrote {}", path.display()));
        }
    }
    if json {
        let series: Vec<_> = series.iter().map(Stop::json).collect();
        let stop = stop.as_ref().map(Stop::json);
        return print_json(&serde_json::json!({ "focal_length_mm": focal, "stop": stop, "full_stops": series }));
    }
    let mut text = String::new();
    if let Some(s) = &stop {
        let (d, area) = (shown(s.diameter_mm), shown(s.area_mm2()));
        writeln!(text, "f/{}   focal length {} mm   aperture {d} mm across, {area} mm²", shown(s.f_number), shown(focal))?;
        writeln!(
            text,
            "{:.2} stops from f/1: {} of its light   nearest engraved f/{}",
            2.0 * s.f_number.log2(),
            shown(s.light()),
            s.nominal
        )?;
    } else {
        writeln!(text, "focal length {} mm: each stop has half the area and half the light of the one before", shown(focal))?;
        writeln!(text, "{:>8} {:>8} {:>12} {:>12} {:>12}", "aperture", "true", "radius", "area", "light")?;
        for s in &series {
            writeln!(
                text,
                "{:>8} {:>8.4} {:>9.3} mm {:>8.2} mm² {:>12}",
                format!("f/{}", s.nominal),
                s.f_number,
                0.5 * s.diameter_mm,
                s.area_mm2(),
                format!("1/{:.0}", 1.0 / s.light())
            )?;
        }
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// The openings of the full stops side by side, in one scale; the one that was asked for is dashed around that of f/1.
fn openings(focal: f64, series: &[Stop], stop: Option<&Stop>) -> Figure {
    const ROW: usize = 6;
    const CELL: DVec2 = DVec2::new(120.0, 150.0);
    const FILL: Color = [31, 90, 170];
    const EDGE: Color = [30, 30, 30];
    let rows = series.len().div_ceil(ROW);
    let mut figure = Figure::new(ROW as f64 * CELL.x + 20.0, rows as f64 * CELL.y + 40.0);
    // The widest opening takes 100 points.
    let widest = series.iter().chain(stop).map(|s| s.diameter_mm).fold(0.0, f64::max);
    let circle = |middle: DVec2, d: f64| {
        (0..=96).map(move |k| middle + DVec2::from_angle(TAU * f64::from(k) / 96.0) * (50.0 * d / widest))
    };
    for (i, s) in series.iter().enumerate() {
        let corner = DVec2::new(10.0 + (i % ROW) as f64 * CELL.x, 30.0 + (i / ROW) as f64 * CELL.y);
        let middle = corner + DVec2::new(0.5 * CELL.x, 54.0);
        figure.line(circle(middle, widest), [200, 200, 200], 0.6, 0.0);
        figure.items.push(Item::Path {
            points: circle(middle, s.diameter_mm).collect(),
            color: EDGE,
            width: 0.8,
            dash: 0.0,
            fill: Some((FILL, 0.35)),
        });
        if let Some(asked) = stop {
            figure.line(circle(middle, asked.diameter_mm), [200, 60, 40], 1.0, 3.0);
        }
        let below = middle + DVec2::new(0.0, 66.0);
        figure.text(below, format!("f/{}", s.nominal), 12.0, Anchor::Middle);
        let light = format!("r = {:.2} mm, light 1/{:.0}", 0.5 * s.diameter_mm, 1.0 / s.light());
        figure.text(below + DVec2::new(0.0, 13.0), light, 8.5, Anchor::Middle);
    }
    let asked = stop.map_or(String::new(), |s| format!(", red: {} mm across, f/{}", shown(s.diameter_mm), shown(s.f_number)));
    figure.text(DVec2::new(0.5 * figure.width, 19.0), format!("full stops of {} mm{asked}", shown(focal)), 11.0, Anchor::Middle);
    figure
}

//! `lens distortion`: distortion and field curvature.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, no_light};
use diopter::lens::analysis::FieldPoint;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Distortion and field curvature.
#[derive(clap::Args, Debug)]
pub struct Distortion {
    #[command(flatten)]
    bench: Bench,
}

impl Distortion {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
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
        finish(asked, || FieldPoint::plot(&table.title(""), &points), &t, &json!(values), global.json)
    }
}

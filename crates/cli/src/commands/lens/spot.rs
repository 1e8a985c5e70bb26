//! `lens spot`: spot diagrams.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, no_light, planes};
use crate::UsageError;
use crate::args::values::{List, list};
use anyhow::anyhow;
use diopter::lens::analysis;
use serde_json::json;
use std::fmt::Write as _;

/// Spot diagrams.
#[derive(clap::Args, Debug)]
pub struct Spot {
    #[command(flatten)]
    bench: Bench,
    /// Rays across the pupil.
    #[arg(long, value_name = "N", default_value_t = 40)]
    rays: usize,
    /// Through focus: planes behind the film, mm: "-0.1,0,0.1".
    #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
    defocus: Option<List>,
}

impl Spot {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let (asked, rays, defocus) = (&self.bench, self.rays, self.defocus.as_ref());
        if !(2..=1000).contains(&rays) {
            return Err(UsageError(anyhow!("rays {rays}: expected 2 to 1000 across the pupil")).into());
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
            Some(_) => analysis::Spot::plot_through_focus(&table.title("spots through focus"), &fields),
            None => {
                let spots: Vec<Vec<_>> = fields.iter().flatten().map(|(_, spots)| spots.clone()).collect();
                analysis::Spot::plot(&table.title("spot diagrams"), &spots)
            }
        };
        finish(asked, plot, &t, &json!(values), global.json)
    }
}

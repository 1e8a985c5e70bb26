//! `lens mtf`: modulation transfer.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, no_light, over_fields};
use crate::UsageError;
use crate::args::values::{List, list};
use anyhow::anyhow;
use diopter::lens::analysis::{self, airy_mtf};
use serde_json::json;
use std::fmt::Write as _;

/// Contrast: over frequency, field or focus.
#[derive(clap::Args, Debug)]
pub struct Mtf {
    #[command(flatten)]
    bench: Bench,
    /// frequency, field or focus.
    #[arg(long, value_name = "WHAT", default_value = "frequency")]
    over: MtfOver,
    /// Spatial frequencies, cycles/mm: "10,30"; for --over frequency the last is the highest.
    #[arg(long, value_name = "LIST", value_parser = list)]
    frequency: Option<List>,
    /// From the spot alone, without diffraction.
    #[arg(long)]
    geometric: bool,
}

/// What MTF is plotted over.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum MtfOver {
    /// Spatial frequency.
    Frequency,
    /// Field angle.
    Field,
    /// Defocus.
    Focus,
}

impl Mtf {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let (asked, over, geometric) = (&self.bench, self.over, self.geometric);
        let frequencies = self.frequency.as_ref().map(|f| &f.0[..]);
        if let Some(bad) = frequencies.and_then(|f| f.iter().find(|f| !(**f > 0.0 && **f <= 10_000.0))) {
            return Err(UsageError(anyhow!("frequency {bad}: expected above 0, and at most 10000 cycles/mm")).into());
        }
        let table = Table::new(asked)?;
        if !geometric {
            table.warn_of_ideal_paths();
        }
        let bench = table.bench();
        let colors: Vec<(f64, f64)> = table.wavelengths.iter().map(|nm| (*nm, 1.0)).collect();
        let at = |field: f64, frequencies: &[f64], defocus: f64| match geometric {
            true => bench.geometric_mtf(field, &colors, frequencies, defocus),
            false => bench.diffraction_mtf(field, &colors, frequencies, defocus),
        };
        // What stands in where the wavefront is too steep is not called diffraction.
        let title = |curves: &[analysis::Mtf]| {
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
        let curves: Vec<analysis::Mtf>;
        let figure = match over {
            MtfOver::Frequency => {
                let steps: Vec<f64> = (0..=80).map(|i| highest * i as f64 / 80.0).collect();
                curves = table.fields.iter().filter_map(|f| at(*f, &steps, 0.0)).collect();
                writeln!(t, "{}", title(&curves))?;
                for m in &curves {
                    let kind = if m.geometric { ", geometric" } else { "" };
                    writeln!(
                        t,
                        "  field {:.2}°{kind}\n  {:>10} {:>11} {:>9}",
                        m.field_deg, "cycles/mm", "tangential", "sagittal"
                    )?;
                    for i in (0..steps.len()).step_by(8) {
                        writeln!(t, "  {:>10.2} {:>11.4} {:>9.4}", steps[i], m.tangential[i], m.sagittal[i])?;
                    }
                }
                let limit: Vec<f64> = steps.iter().map(|f| airy_mtf(*f, table.reference, table.f_number())).collect();
                analysis::Mtf::plot(&title(&curves), &curves, Some(&limit))
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
                let each: Vec<(f64, analysis::Mtf)> =
                    steps.iter().filter_map(|(x, f, d)| Some((*x, at(*f, &wanted, *d)?))).collect();
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
                analysis::Mtf::plot_over(&title(&curves), label, &wanted, &each)
            }
        };
        for m in &curves {
            let kind = if m.geometric { "geometric" } else { "diffraction" };
            values.push(json!({ "field_deg": m.field_deg, "kind": kind, "frequency_per_mm": m.frequencies, "tangential": m.tangential, "sagittal": m.sagittal }));
        }
        if values.is_empty() {
            return Err(no_light(table.fields[0]));
        }
        finish(asked, || figure, &t, &json!(values), global.json)
    }
}

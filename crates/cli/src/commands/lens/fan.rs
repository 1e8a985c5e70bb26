//! `lens fan`: ray fans.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, no_light};
use diopter::lens::analysis::{self, FanPoint};
use serde_json::json;
use std::fmt::Write as _;

/// Ray fans and wavefront.
#[derive(clap::Args, Debug)]
pub struct Fan {
    #[command(flatten)]
    bench: Bench,
}

impl Fan {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
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
                let find = |v: &[FanPoint]| v.iter().find(|p| (p.pupil - s).abs() < 1e-9).copied();
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
            let line = |v: &[FanPoint]| {
                v.iter()
                    .map(|p| json!({ "pupil": p.pupil, "error_mm": p.error.to_array(), "opd_waves": p.opd }))
                    .collect::<Vec<_>>()
            };
            values.push(json!({ "field_deg": f.field_deg, "wavelength_nm": f.nm, "tangential": line(&f.tangential), "sagittal": line(&f.sagittal) }));
        }
        if values.is_empty() {
            return Err(no_light(table.fields[0]));
        }
        finish(asked, || analysis::Fan::plot(&table.title("ray fans"), &fields), &t, &json!(values), global.json)
    }
}

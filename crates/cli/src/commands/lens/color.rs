//! `lens color`: axial and lateral colour.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Axial and lateral colour.
#[derive(clap::Args, Debug)]
pub struct Color {
    #[command(flatten)]
    bench: Bench,
}

impl Color {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
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
        let value = json!({ "wavelength_nm": wavelengths, "reference_nm": table.reference, "axial_mm": curves.axial, "lateral": lateral });
        finish(asked, || curves.plot(&table.title("")), &t, &value, global.json)
    }
}

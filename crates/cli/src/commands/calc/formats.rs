//! `calc formats`: the film formats that have names, largest first.

use super::focus::format_named;
use crate::commands::print_json;
use diopter::sensor::format::{self, FORMATS, Format};
use std::fmt::Write as _;
use std::io::Write as _;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(names: &[String], json: bool) -> anyhow::Result<()> {
    let mut rows: Vec<(String, Format)> = Vec::new();
    for name in names {
        let found = format_named(name)?;
        rows.push((found.names.first().map_or_else(|| name.clone(), |n| (*n).to_owned()), found));
    }
    if names.is_empty() {
        rows = FORMATS.iter().map(|f| (f.names[0].to_owned(), *f)).collect();
        rows.sort_by(|a, b| b.1.diagonal_mm().total_cmp(&a.1.diagonal_mm()));
    }
    let area = |f: &Format| f.width_mm * f.height_mm;
    let crop = |f: &Format| format::equivalent_35mm(1.0, f.diagonal_mm());
    let full = 36.0 * 24.0;
    if json {
        let row = |(name, f): &(String, Format)| {
            serde_json::json!({
                "name": name, "names": f.names, "width_mm": f.width_mm, "height_mm": f.height_mm, "area_mm2": area(f),
                "diagonal_mm": f.diagonal_mm(), "crop_factor": crop(f), "area_of_full_frame": area(f) / full,
                "light_ev": (area(f) / full).log2(),
            })
        };
        return print_json(&serde_json::json!(rows.iter().map(row).collect::<Vec<_>>()));
    }
    let mut text = String::new();
    writeln!(
        text,
        "{:<16} {:>8} {:>8} {:>10} {:>9} {:>6} {:>10}   also called",
        "format", "width", "height", "area", "diagonal", "crop", "light"
    )?;
    for (name, f) in &rows {
        let also = f.names.iter().skip(1).copied().collect::<Vec<_>>().join(", ");
        let line = format!(
            "{name:<16} {:>5.2} mm {:>5.2} mm {:>6.1} mm² {:>6.2} mm {:>6.3} {:>+7.2} EV   {also}",
            f.width_mm,
            f.height_mm,
            area(f),
            f.diagonal_mm(),
            crop(f),
            (area(f) / full).log2()
        );
        writeln!(text, "{}", line.trim_end())?;
    }
    writeln!(text, "crop: 43.27 mm / diagonal; light: on the whole film beside 36 × 24 mm, at the same f-number and time")?;
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

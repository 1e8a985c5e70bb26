//! `lens draw`: a lens in section.

use super::bench::{Bench, Table, fields_to};
use super::{GlobalFlags, print_json};
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::lens::draw::{Figure, LayoutOptions};
use diopter::lens::{Focus, Iris, ThinLens, draw};
use diopter::light::units::Millimeters;
use diopter::shot::ShotError;
use serde_json::json;

/// The lens in section, with rays; of "thin" the ideal lens.
#[derive(clap::Args, Debug)]
pub struct Draw {
    #[command(flatten)]
    bench: Bench,
}

impl Draw {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
        if asked.output.is_empty() {
            return Err(UsageError(anyhow!("lens draw: expected -o FILE.svg or FILE.png")).into());
        }
        if asked.lens == "thin" {
            return thin(asked, global.json);
        }
        let outputs = paint::prepare(&asked.output)?;
        let table = Table::new(asked)?;
        let written = paint::write(outputs, &layout(&table))?;
        written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
        if global.json {
            print_json(&json!({ "files": written, "fields_deg": table.fields, "wavelength_nm": table.reference }))?;
        }
        Ok(())
    }
}

/// The lens with its rays.
pub(super) fn layout(table: &Table) -> Figure {
    let options =
        LayoutOptions { title: table.title(""), fields_deg: table.fields.clone(), nm: table.reference, rays: 7, width: 800.0 };
    draw::layout(&table.bench(), &options)
}

/// The thin lens has no surfaces: of all verbs only this one shows it.
fn thin(asked: &Bench, json: bool) -> anyhow::Result<()> {
    let focal = asked.focal_length.map_or(50.0, |f| f.0);
    let f_number = asked.aperture.map_or(5.6, |a| a.0);
    let focus = asked.focus.map_or(Focus::Infinity, |f| Focus::at_mm(f.0 * 1000.0));
    let lens = ThinLens::new(Millimeters(focal), f_number, Iris::default(), focus).map_err(ShotError::from)?;
    let fields = asked.field.as_ref().map_or_else(|| fields_to(0.36f64.atan().to_degrees()), |list| list.0.clone());
    if let Some(bad) = fields.iter().find(|f| f.abs() >= 89.0) {
        return Err(UsageError(anyhow!("field {bad}: expected an angle within 89 degrees")).into());
    }
    let at = lens.focus_distance().map_or(String::new(), |d| format!(", object at {:.2} m", d.0 / 1000.0));
    let title = format!("thin lens   {focal} mm f/{f_number}{at}");
    let outputs = paint::prepare(&asked.output)?;
    let written = paint::write(outputs, &draw::thin_layout(&lens, &title, &fields, 800.0))?;
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&json!({ "files": written, "fields_deg": fields }))?;
    }
    Ok(())
}

//! `lens list`: what lenses there are.

use super::{GlobalFlags, print_json};
use diopter::lens::glass::D_NM;
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::{State, System, embedded, embedded_names};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write;

/// Names of the embedded lenses.
#[derive(clap::Args, Debug)]
pub struct List;

impl List {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let mut rows = vec![];
        for name in embedded_names() {
            let Some(p) = embedded(name) else { continue };
            let ends = if p.zoom.is_empty() { vec![0.0] } else { vec![0.0, p.last_zoom()] };
            let focal: Vec<f64> = ends
                .iter()
                .map(|z| {
                    let s = System::at(&p, State { zoom: *z, focus: 0.0 });
                    FirstOrder::of(&s, &s.indices(D_NM)).efl
                })
                .collect();
            rows.push((name, p, focal));
        }
        if global.json {
            let all: Vec<_> = rows
                .iter()
                .map(|(key, p, focal)| {
                    json!({ "name": key, "lens": p.name, "focal_length_mm": focal, "f_number": p.f_number,
                    "image_circle_mm": p.image_circle, "patent": p.patent, "source": p.source })
                })
                .collect();
            return print_json(&json!(all));
        }
        let mut t = String::new();
        for (key, p, focal) in rows {
            let focal: Vec<String> = focal.iter().map(|f| format!("{f:.1}")).collect();
            let aperture = p.f_number.map_or(String::new(), |n| format!("f/{n}"));
            let origin = p.patent.as_deref().unwrap_or(&p.source);
            writeln!(t, "{key:<24} {:>11} mm {aperture:<8} {origin}", focal.join("-"))?;
        }
        write!(std::io::stdout(), "{t}")?;
        Ok(())
    }
}

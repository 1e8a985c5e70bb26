//! `lens trace`: one ray through a lens.

use super::bench::{Bench, Table, no_light};
use super::{GlobalFlags, print_json};
use crate::watch::warn;
use diopter::lens::analysis::PupilPoint;
use diopter::lens::ray::{Apertures, TraceDirection};
use diopter::lens::trace::at_plane;
use diopter::shot::flag_values::pair;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;

/// One ray, surface by surface.
#[derive(clap::Args, Debug)]
pub struct Trace {
    #[command(flatten)]
    bench: Bench,
    /// Place in the pupil, -1 to 1 across it: "x,y".
    #[arg(long, value_name = "X,Y", value_parser = pair, default_value = "0,0", allow_hyphen_values = true)]
    pupil: [f64; 2],
}

impl Trace {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let (asked, pupil) = (&self.bench, self.pupil);
        let table = Table::new(asked)?;
        let bench = table.bench();
        let field = asked.field.as_ref().map_or(0.0, |f| f.0[0]);
        let nm = table.reference;
        let several =
            asked.field.as_ref().is_some_and(|f| f.0.len() > 1) || asked.wavelength.as_ref().is_some_and(|w| w.0.len() > 1);
        if several {
            warn(&format!("one ray is traced: that of field {field}° and {nm} nm, of those that are asked for"));
        }
        let beam = bench.beam(field, nm).ok_or_else(|| no_light(field))?;
        let reach = bench.axial_reach(nm).ok_or_else(|| no_light(0.0))?;
        let at = PupilPoint::from(pupil) * reach;
        let n = table.set.system.indices(nm);
        let mut rows = vec![];
        let traced = table.set.system.trace_with(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip, |e| rows.push(e));
        let opd = bench.opd_of(&beam, at, nm);
        let mut t = String::new();
        writeln!(t, "{}", table.title(&format!("field {field}°, pupil {}, {}, {nm:.1} nm", pupil[0], pupil[1])))?;
        writeln!(
            t,
            "  {:>4} {:>14} {:>14} {:>14} {:>12} {:>12} {:>12} {:>9} {:>9}",
            "", "x mm", "y mm", "z mm", "L", "M", "N", "in °", "out °"
        )?;
        for e in &rows {
            let angle = |c: f64| c.clamp(-1.0, 1.0).acos().to_degrees();
            writeln!(
                t,
                "  {:>4} {:>14.9} {:>14.9} {:>14.9} {:>12.9} {:>12.9} {:>12.9} {:>9.4} {:>9.4}",
                e.surface + 1,
                e.point.x,
                e.point.y,
                e.point.z,
                e.direction.x,
                e.direction.y,
                e.direction.z,
                angle(e.cosines[0]),
                angle(e.cosines[1])
            )?;
        }
        let end = match &traced {
            Ok(out) => {
                let film = at_plane(out, table.set.system.film_z);
                writeln!(
                    t,
                    "  film {:>14.9} {:>14.9} {:>14.9}   path difference {:.4} waves",
                    film.x,
                    film.y,
                    film.z,
                    opd.unwrap_or(f64::NAN)
                )?;
                json!({ "film_mm": film.to_array(), "direction": out.direction.to_array(), "opd_waves": opd })
            }
            Err(b) => {
                writeln!(t, "  blocked at surface {}: {}", b.surface + 1, b.why)?;
                json!({ "blocked_at": b.surface + 1, "why": format!("{:?}", b.why) })
            }
        };
        if global.json {
            let rows: Vec<Value> = rows
            .iter()
            .map(|e| json!({ "surface": e.surface + 1, "point_mm": e.point.to_array(), "direction": e.direction.to_array(), "path_mm": e.path }))
            .collect();
            return print_json(&json!({ "field_deg": field, "pupil": pupil, "wavelength_nm": nm, "surfaces": rows, "end": end }));
        }
        write!(std::io::stdout(), "{t}")?;
        Ok(())
    }
}

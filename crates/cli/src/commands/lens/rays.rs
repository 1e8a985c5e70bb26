//! `lens`: rays through a lens: one by one, as spots, as fans.

use super::print_json;
use super::{Table, finish, no_light, planes};
use crate::UsageError;
use crate::args::{Bench as Asked, List};
use anyhow::anyhow;
use diopter::lens::analysis::{Fan, Spot};
use diopter::lens::ray::{Apertures, TraceDirection};
use diopter::lens::trace::at_plane;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;

pub(super) fn trace(asked: &Asked, pupil: [f64; 2], json: bool) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let field = asked.field.as_ref().map_or(0.0, |f| f.0[0]);
    let nm = table.reference;
    let beam = bench.beam(field, nm).ok_or_else(|| no_light(field))?;
    let reach = bench.axial_reach(nm).ok_or_else(|| no_light(0.0))?;
    let at = glam_of(pupil, reach);
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
            writeln!(t, "  blocked at surface {}: {:?}", b.surface + 1, b.why)?;
            json!({ "blocked_at": b.surface + 1, "why": format!("{:?}", b.why) })
        }
    };
    if json {
        let rows: Vec<Value> = rows
            .iter()
            .map(|e| json!({ "surface": e.surface + 1, "point_mm": e.point.to_array(), "direction": e.direction.to_array(), "path_mm": e.path }))
            .collect();
        return print_json(&json!({ "field_deg": field, "pupil": pupil, "wavelength_nm": nm, "surfaces": rows, "end": end }));
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

pub(super) fn glam_of(pupil: [f64; 2], reach: f64) -> diopter::lens::analysis::PupilPoint {
    diopter::lens::analysis::PupilPoint::new(pupil[0] * reach, pupil[1] * reach)
}

pub(super) fn spot(asked: &Asked, rays: usize, defocus: Option<&List>, json: bool) -> anyhow::Result<()> {
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
        Some(_) => Spot::plot_through_focus(&table.title("spots through focus"), &fields),
        None => {
            let spots: Vec<Vec<_>> = fields.iter().flatten().map(|(_, spots)| spots.clone()).collect();
            Spot::plot(&table.title("spot diagrams"), &spots)
        }
    };
    finish(asked, plot, &t, &json!(values), json)
}

pub(super) fn fan(asked: &Asked, json: bool) -> anyhow::Result<()> {
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
            let find = |v: &[diopter::lens::analysis::FanPoint]| v.iter().find(|p| (p.pupil - s).abs() < 1e-9).copied();
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
        let line = |v: &[diopter::lens::analysis::FanPoint]| {
            v.iter().map(|p| json!({ "pupil": p.pupil, "error_mm": p.error.to_array(), "opd_waves": p.opd })).collect::<Vec<_>>()
        };
        values.push(json!({ "field_deg": f.field_deg, "wavelength_nm": f.nm, "tangential": line(&f.tangential), "sagittal": line(&f.sagittal) }));
    }
    if values.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    finish(asked, || Fan::plot(&table.title("ray fans"), &fields), &t, &json!(values), json)
}

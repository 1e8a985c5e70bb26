//! Analyses that ask for nothing but a lens on the bench: each is a line in `analyses!`, and the function that prints it.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, is_list, no_light, over_fields};
use diopter::lens::analysis::{self, FanPoint, FieldPoint, Illumination, PupilPoint};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The verbs as clap reads them, and the dispatch to their functions: help, name that is typed, function.
macro_rules! analyses {
    ($($about:literal $verb:ident => $print:ident,)*) => {
        #[derive(clap::Subcommand, Debug)]
        pub enum Analysis {
            $(#[doc = $about] $verb(Bench),)*
        }

        impl Analysis {
            pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
                match self {
                    $(Analysis::$verb(asked) => $print(asked, global),)*
                }
            }
        }
    };
}

analyses! {
    "Ray fans and wavefront."
    Fan => fan,
    "Distortion and field curvature."
    Distortion => distortion,
    "Relative illumination, vignetting, and the pupils as the field sees them."
    Vignetting => vignetting,
    "Axial and lateral colour."
    Color => color,
}

fn fan(asked: &Bench, global: &GlobalFlags) -> anyhow::Result<()> {
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
            v.iter().map(|p| json!({ "pupil": p.pupil, "error_mm": p.error.to_array(), "opd_waves": p.opd })).collect::<Vec<_>>()
        };
        values.push(json!({ "field_deg": f.field_deg, "wavelength_nm": f.nm, "tangential": line(&f.tangential), "sagittal": line(&f.sagittal) }));
    }
    if values.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    finish(asked, || analysis::Fan::plot(&table.title("ray fans"), &fields), &t, &json!(values), global.json)
}

fn distortion(asked: &Bench, global: &GlobalFlags) -> anyhow::Result<()> {
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
        "field °", "height mm", "ideal mm", "distortion %", "equidist. mm", "departure %", "tang. focus mm", "sag. focus mm"
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
    let [ideal, equidistant] = match table.object_distance {
        None => ["f tan θ", "f θ"],
        Some(_) => ["the paraxial magnification of the object's height", "the same with θ for tan θ"],
    };
    writeln!(
        t,
        "  distortion is from the ideal height, {ideal}; departure from the equidistant one, {equidistant}: both carried along the chief ray from the paraxial focus to the film"
    )?;
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

fn vignetting(asked: &Bench, global: &GlobalFlags) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let bench = table.bench();
    let most = table.largest_field();
    let fields = over_fields(asked, most, 14)?;
    let height_of = |field: f64| bench.field_point(field, table.reference).map(|p| p.height.abs());
    let heights: Vec<f64> = match is_list(asked) {
        // The places on the film where the fields that were asked for are seen.
        true => fields.iter().filter_map(|f| height_of(*f)).collect(),
        false => {
            let height = height_of(most).unwrap_or(0.36 * table.set.efl);
            (0..=20).map(|i| height * i as f64 / 20.0).collect()
        }
    };
    let light: Vec<Illumination> = heights.iter().map(|h| bench.illumination(*h, table.reference)).collect();
    let beams: Vec<(f64, f64)> = fields.into_iter().filter_map(|f| Some((f, bench.vignetting(f, table.reference)?))).collect();
    let axis = bench.illumination(0.0, table.reference);
    if axis.geometric <= 0.0 {
        return Err(no_light(0.0));
    }
    let mut t = format!("{}\n", table.title("vignetting"));
    writeln!(t, "  {:>10} {:>14} {:>10} {:>14} {:>12}", "height mm", "E/L sr", "relative", "with losses", "relative")?;
    for l in &light {
        writeln!(
            t,
            "  {:>10.3} {:>14.6e} {:>10.4} {:>14.6e} {:>12.4}",
            l.height,
            l.geometric,
            l.geometric / axis.geometric,
            l.with_losses,
            l.with_losses / axis.with_losses
        )?;
    }
    writeln!(t, "  {:>10} {:>22}", "field °", "beam area, of the axis")?;
    for (f, v) in &beams {
        writeln!(t, "  {f:>10.3} {v:>22.4}")?;
    }
    let pupils: Vec<_> = table.fields.iter().filter_map(|f| bench.pupil_shape(*f, table.reference)).collect();
    writeln!(t, "  {:>10} {:>18} {:>18}", "field °", "pupil width mm", "height mm")?;
    for p in &pupils {
        let size = |axis: usize| {
            let values = p.entrance.iter().map(|p| p[axis]);
            values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
        };
        writeln!(t, "  {:>10.3} {:>18.4} {:>18.4}", p.field_deg, size(0), size(1))?;
    }
    let outline = |v: &[PupilPoint]| v.iter().map(|p| p.to_array()).collect::<Vec<_>>();
    let value = json!({
        "pupils": pupils.iter().map(|p| json!({ "field_deg": p.field_deg, "entrance_mm": outline(&p.entrance), "exit_mm": outline(&p.exit) })).collect::<Vec<_>>(),
        "illumination": light.iter().map(|l| json!({ "height_mm": l.height, "geometric_sr": l.geometric, "with_losses_sr": l.with_losses })).collect::<Vec<_>>(),
        "beam_area": beams.iter().map(|(f, v)| json!({ "field_deg": f, "relative": v })).collect::<Vec<_>>(),
    });
    finish(asked, || Illumination::plot(&table.title(""), &light, &beams, &pupils), &t, &value, global.json)
}

fn color(asked: &Bench, global: &GlobalFlags) -> anyhow::Result<()> {
    let table = Table::new(asked)?;
    let wavelengths: Vec<f64> = match &asked.wavelength {
        Some(list) if list.0.len() > 1 => list.0.clone(),
        _ => (0..=30).map(|i| 400.0 + 10.0 * i as f64).collect(),
    };
    let curves = table.bench().color(&wavelengths, table.reference, &table.fields);
    let mut t = format!("{}\n", table.title(&format!("colour, against {:.1} nm", table.reference)));
    let cell = |v: f64| if v.is_finite() { format!("{v:.4}") } else { "-".into() };
    let heads: String = table.fields.iter().map(|f| format!(" {:>12}", format!("{f:.2}° µm"))).collect();
    writeln!(t, "  {:>8} {:>12}{heads}", "nm", "axial mm")?;
    for (i, nm) in wavelengths.iter().enumerate() {
        let cells: String = curves.lateral.iter().map(|(_, v)| format!(" {:>12}", cell(v[i] * 1e3))).collect();
        writeln!(t, "  {nm:>8.1} {:>12.6}{cells}", curves.axial[i])?;
    }
    let lateral: Vec<Value> = curves.lateral.iter().map(|(f, v)| json!({ "field_deg": f, "height_mm": v })).collect();
    let value =
        json!({ "wavelength_nm": wavelengths, "reference_nm": table.reference, "axial_mm": curves.axial, "lateral": lateral });
    finish(asked, || curves.plot(&table.title("")), &t, &value, global.json)
}

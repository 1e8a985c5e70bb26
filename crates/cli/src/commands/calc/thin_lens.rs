//! `calc thin-lens`: conjugate planes of a thin lens, and the blur of another distance.

use super::exposure::f_number;
use super::focus::finite;
use crate::UsageError;
use crate::args::ThinLensArgs;
use crate::commands::{print_json, shown};
use crate::paint;
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::conjugates::{Conjugates, Known};
use diopter::lens::draw::{Axis, Chart, Figure, Line, Style, conjugates_figure};
use diopter::quantity::Distance;
use glam::DVec2;
use std::fmt::Write as _;
use std::io::Write as _;

/// Object distances of the table, in focal lengths.
const TABLE: [f64; 12] = [0.5, 1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, f64::INFINITY];

/// A distance in mm: "52.63 mm", "inf".
fn mm(v: f64) -> String {
    if v.is_infinite() { "inf".into() } else { format!("{} mm", shown(v)) }
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &ThinLensArgs, json: bool) -> anyhow::Result<()> {
    let wrong = |text: String| anyhow::Error::from(UsageError(anyhow!(text)));
    let f = args.focal_length.map(|v| v.0);
    let [object, image] = [args.object, args.image].map(|d| d.map(|d| 1000.0 * d.0));
    let m = args.magnification;
    let known = match (f, object, image, m) {
        (Some(f), Some(o), None, None) => Known::FocalObject(f, o),
        (Some(f), None, Some(i), None) => Known::FocalImage(f, i),
        (Some(f), None, None, Some(m)) => Known::FocalMagnification(f, m),
        (None, Some(o), Some(i), None) => Known::ObjectImage(o, i),
        (None, Some(o), None, Some(m)) => Known::ObjectMagnification(o, m),
        (None, None, Some(i), Some(m)) => Known::ImageMagnification(i, m),
        (Some(f), None, None, None) if args.aperture.is_none() => return table(args, f, json),
        _ => {
            let given = [
                ("--focal-length", f.is_some()),
                ("--object", object.is_some()),
                ("--image", image.is_some()),
                ("--magnification", m.is_some()),
            ];
            let given: Vec<&str> = given.iter().filter(|g| g.1).map(|g| g.0).collect();
            let found = if given.is_empty() { "none".to_owned() } else { given.join(", ") };
            return Err(wrong(format!(
                "calc thin-lens: {found} given; expected two of --focal-length, --object, --image and --magnification, or --focal-length alone for a table"
            )));
        }
    };
    let Some(c) = Conjugates::of(known) else {
        let given = [
            f.map(|v| format!("focal length {}", mm(v))),
            object.map(|v| format!("object {}", mm(v))),
            image.map(|v| format!("image {}", mm(v))),
            m.map(|v| format!("magnification {v}")),
        ];
        let given: Vec<String> = given.into_iter().flatten().collect();
        return Err(wrong(format!(
            "calc thin-lens: {}: no thin lens does that; expected numbers other than 0, a finite focal length and magnification, and not magnification 1 (image = -object)",
            given.join(", ")
        )));
    };
    let n = args.aperture.map(f_number).transpose()?;
    let distance = args.distance.0;
    if distance == 0.0 {
        return Err(wrong(format!("distance {}: expected a distance other than 0", args.distance)));
    }
    let circle = match n {
        None => None,
        Some(n) => Some(c.circle_mm(n, 1000.0 * distance).ok_or_else(|| {
            wrong(format!(
                "aperture f/{n}: a circle of confusion needs a film, and the image at {} is not real; expected an image distance above 0",
                mm(c.image_mm)
            ))
        })?),
    };
    let outputs = paint::prepare(&args.output)?;
    if !outputs.is_empty() {
        let title = format!(
            "f = {}, object {}, image {}, m = {}",
            mm(c.focal_mm),
            mm(c.object_mm),
            mm(c.image_mm),
            shown(c.magnification)
        );
        let figure = conjugates_figure(&c, &title, 720.0).ok_or_else(|| {
            wrong(format!(
                "output: the object is at {} and its image at {}; expected a real object and finite distances for a drawing",
                mm(c.object_mm),
                mm(c.image_mm)
            ))
        })?;
        for path in paint::write(outputs, &figure)? {
            say(&format!("wrote {}", path.display()));
        }
    }
    let real = c.image_mm > 0.0;
    let working = n.map(|n| n * (1.0 - c.magnification).abs());
    if json {
        return print_json(&serde_json::json!({
            "focal_length_mm": c.focal_mm, "power_diopters": 1000.0 / c.focal_mm, "object_mm": finite(c.object_mm),
            "image_mm": finite(c.image_mm), "magnification": finite(c.magnification), "object_to_image_mm": finite(c.object_mm + c.image_mm),
            "real_image": real, "f_number": n, "aperture_mm": n.map(|n| c.focal_mm.abs() / n), "working_f_number": working.and_then(finite),
            "distance_m": n.and(finite(distance)), "circle_mm": circle,
        }));
    }
    let mut text = String::new();
    writeln!(text, "focal length f   {:>14}   ({} dioptres)", mm(c.focal_mm), shown(1000.0 / c.focal_mm))?;
    writeln!(text, "object z_o       {:>14}{}", mm(c.object_mm), if c.object_mm < 0.0 { "   virtual" } else { "" })?;
    let upright = match c.magnification {
        v if v.is_infinite() || v == 0.0 => "",
        v if v > 0.0 => ", upright",
        _ => ", upside down",
    };
    writeln!(text, "image z_i        {:>14}   {}{upright}", mm(c.image_mm), if real { "real" } else { "virtual" })?;
    let scale = if c.magnification.is_infinite() { "inf".into() } else { shown(c.magnification) };
    writeln!(text, "magnification m  {scale:>14}")?;
    if let (Some(n), Some(circle)) = (n, circle) {
        let diameter = c.focal_mm.abs() / n;
        let working = working.unwrap_or(n);
        writeln!(text, "aperture f/{n}: {} mm across; seen from the film f/{}", shown(diameter), shown(working))?;
        writeln!(text, "a point at {} makes a circle of confusion of {} mm", Distance(distance), shown(circle))?;
    }
    writeln!(text, "1/f = 1/z_o + 1/z_i, m = -z_i/z_o")?;
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Image distance and magnification over object distances.
fn table(args: &ThinLensArgs, f: f64, json: bool) -> anyhow::Result<()> {
    let rows: Vec<Conjugates> = TABLE.iter().filter_map(|k| Conjugates::of(Known::FocalObject(f, k * f.abs()))).collect();
    if rows.is_empty() {
        return Err(UsageError(anyhow!("focal-length {f} mm: expected a length other than 0")).into());
    }
    let outputs = paint::prepare(&args.output)?;
    if !outputs.is_empty() {
        for path in paint::write(outputs, &plot(f))? {
            say(&format!("wrote {}", path.display()));
        }
    }
    if json {
        let row = |c: &Conjugates| {
            serde_json::json!({
                "object_mm": finite(c.object_mm), "image_mm": finite(c.image_mm), "magnification": finite(c.magnification),
            })
        };
        return print_json(&serde_json::json!({ "focal_length_mm": f, "rows": rows.iter().map(row).collect::<Vec<_>>() }));
    }
    let mut text = String::new();
    writeln!(text, "focal length {} mm", shown(f))?;
    writeln!(text, "{:>14} {:>14} {:>14} {:>16}", "object z_o", "image z_i", "magnification", "object to image")?;
    for c in &rows {
        let scale = if c.magnification.is_infinite() { "inf".into() } else { shown(c.magnification) };
        writeln!(text, "{:>14} {:>14} {scale:>14} {:>16}", mm(c.object_mm), mm(c.image_mm), mm(c.object_mm + c.image_mm))?;
    }
    writeln!(text, "1/f = 1/z_o + 1/z_i, m = -z_i/z_o; a negative image distance: virtual, before the lens")?;
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Image distance over object distance.
fn plot(f: f64) -> Figure {
    let span = f.abs();
    // Away from the pole at the focal length; what is above or below the chart is a break there.
    let points = |from: f64, to: f64| {
        let at = move |k: u32| span * (from + (to - from) * f64::from(k) / 200.0);
        (0..=200).filter_map(move |k| {
            let c = Conjugates::of(Known::FocalObject(f, at(k)))?;
            Some(DVec2::new(c.object_mm, c.image_mm))
        })
    };
    let blue = [34, 85, 170];
    let grey = [120, 120, 120];
    let line = |name: &str, color, style, points| Line { name: name.into(), color, style, points };
    let level = |y: f64| vec![DVec2::new(0.0, y), DVec2::new(6.0 * span, y)];
    let mut lines = vec![line("image distance", blue, Style::Full, points(1.001, 6.0).collect())];
    lines.push(line("", blue, Style::Full, points(0.005, 0.999).collect()));
    lines.push(line("focal length", grey, Style::Broken, level(f)));
    lines.push(line("", grey, Style::Broken, vec![DVec2::new(span, -4.0 * span), DVec2::new(span, 6.0 * span)]));
    let mut figure = Figure::new(520.0, 380.0);
    Chart {
        title: format!("thin lens of {} mm: 1/f = 1/z_o + 1/z_i", shown(f)),
        x: Axis { label: "object distance z_o, mm".into(), range: [0.0, 6.0 * span] },
        y: Axis { label: "image distance z_i, mm".into(), range: [-4.0 * span, 6.0 * span] },
        lines,
    }
    .draw(&mut figure, DVec2::ZERO, DVec2::new(520.0, 380.0));
    figure
}

//! `calc dof`, `calc hyperfocal`, `calc fov`, `calc equivalent-format`: what is sharp and what is seen, by closed forms, and by traced rays
//! beside them for a real lens.

use super::exposure::{f_number, positive};
use crate::UsageError;
use crate::args::{DepthOfField, Field, FormatArgs};
use crate::commands::print_json;
use crate::paint;
use crate::watch::say;
use anyhow::anyhow;
use diopter::depth_of_field::{CIRCLE_OF_DIAGONAL, circle_mm, hyperfocal_m, limits_m};
use diopter::lens::compound::Setting;
use diopter::lens::draw::{Axis, Chart, Figure, Line, Style};
use diopter::lens::focusing::AxialSpot;
use diopter::lens::{CompoundLens, Focus, Lens};
use diopter::quantity::{Distance, FNumber, LengthMm};
use diopter::sensor::format::{self, Format};
use diopter::shot::{ShotError, read_lens};
use glam::DVec2;
use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Arc;

/// What a lens is set to where no flag says it and no real lens is named.
const DEFAULT_F_NUMBER: f64 = 2.8;

pub(super) fn format_named(name: &str) -> anyhow::Result<Format> {
    Format::parse(name).ok_or_else(|| {
        let names: Vec<&str> = format::FORMATS.iter().map(|f| f.names[0]).collect();
        UsageError(anyhow!("format \"{name}\": expected one of {}, or width x height in mm such as 36x24", names.join(", ")))
            .into()
    })
}

/// The circle that is taken for sharp, mm.
fn circle(given: Option<LengthMm>, format: &Format) -> anyhow::Result<f64> {
    match given {
        Some(c) => positive("circle", c.0),
        None => Ok(format.diagonal_mm() * CIRCLE_OF_DIAGONAL),
    }
}

/// A real lens set on the bench of a calculator.
fn real(name: &str, focal: Option<f64>, aperture: Option<f64>, focus: Focus, format: &Format) -> anyhow::Result<CompoundLens> {
    let setting =
        Setting { focal_length: focal, f_number: aperture, focus, iris: None, film_mm: [format.width_mm, format.height_mm] };
    Ok(CompoundLens::new(Arc::new(read_lens(name)?), &setting).map_err(ShotError::from)?)
}

/// Diameter (mm) of the traced blur of a point on the axis: of the even disk with the same root mean square radius.
fn traced_circle(lens: &CompoundLens, distance_m: f64) -> Option<f64> {
    let object = distance_m.is_finite().then(|| lens.first_order().entrance_pupil_z - 1000.0 * distance_m);
    AxialSpot::of(lens.system(), object).map(|s| 2.0 * 2f64.sqrt() * s.rms_at(lens.system().film_z))
}

/// What rays say of a distance: limits (m), diameter of the sharpest blur (mm).
type Traced = (Option<(f64, f64)>, Option<f64>);
/// Focus, near, far (m), blur of infinity (mm), what rays say.
type DepthRow = (f64, f64, f64, f64, Option<Traced>);

/// Nearest and farthest distance (m) whose traced blur is no larger than a circle; `None` where even the sharpest is.
fn traced_limits(lens: &CompoundLens, focus_m: f64, circle: f64) -> Option<(f64, f64)> {
    let sharp = |d: f64| traced_circle(lens, d).is_some_and(|c| c <= circle);
    let start = if focus_m.is_finite() { focus_m } else { 1e6 };
    if !sharp(start) {
        return None;
    }
    let edge = |mut inside: f64, mut outside: f64| {
        for _ in 0..60 {
            // In reciprocal distance both ends are well behaved.
            let middle = 2.0 / (1.0 / inside + 1.0 / outside);
            if sharp(middle) { inside = middle } else { outside = middle }
        }
        inside
    };
    let near = edge(start, 1e-3 * lens.focal_length().0);
    let far = if sharp(f64::INFINITY) { f64::INFINITY } else { edge(start, 1e9) };
    Some((near, far))
}

pub(super) fn metres(m: f64) -> String {
    match m {
        m if m.is_infinite() => "inf".into(),
        m if m < 0.01 => format!("{:.2} mm", 1000.0 * m),
        m if m < 1.0 => format!("{m:.4} m"),
        m if m < 10.0 => format!("{m:.3} m"),
        m => format!("{m:.2} m"),
    }
}

pub(super) fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

/// Depth of field at a distance, or a table over distances; a plot of the blur with -o.
pub fn depth(args: &DepthOfField, json: bool) -> anyhow::Result<()> {
    let format = format_named(&args.format)?;
    let c = circle(args.circle, &format)?;
    let given = args.aperture.map(f_number).transpose()?;
    let lens = |focus_m: f64| match args.lens.as_deref() {
        None => Ok(None),
        Some(name) => real(name, args.focal_length.map(|f| f.0), given, Focus::at_mm(1000.0 * focus_m), &format).map(Some),
    };
    let (focal, aperture) = match lens(f64::INFINITY)? {
        // As it is set: a lens fully open may be wider than asked for, or than nothing was.
        Some(lens) => (lens.focal_length().0, given.unwrap_or(lens.f_number())),
        None => {
            let focal = positive("focal length", args.focal_length.map_or(50.0, |f| f.0))?;
            (focal, given.unwrap_or(DEFAULT_F_NUMBER))
        }
    };
    // Said with the result, since a lens was asked for and no aperture.
    let fully_open = args.lens.is_some() && given.is_none();
    let outputs = paint::prepare(&args.output)?;
    let distances: Vec<f64> = match args.focus {
        Some(d) => vec![d.0],
        None => [0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 50.0, f64::INFINITY]
            .into_iter()
            .filter(|d| 1000.0 * d > 2.0 * focal)
            .collect(),
    };
    if let Some(bad) = distances.iter().find(|d| !(1000.0 * **d > focal)) {
        return Err(UsageError(anyhow!(
            "focus {}: expected more than the focal length, {focal:.1} mm: nearer planes have no image",
            Distance(*bad)
        ))
        .into());
    }
    if c >= focal / aperture {
        return Err(UsageError(anyhow!(
            "circle {c} mm: expected less than the opening of the lens, {:.2} mm: else all is sharp",
            focal / aperture
        ))
        .into());
    }
    let hyperfocal = hyperfocal_m(focal, aperture, c);
    let mut rows: Vec<DepthRow> = Vec::new();
    for s in &distances {
        let (near, far) = limits_m(focal, aperture, c, *s);
        let traced = match lens(*s) {
            Ok(lens) => lens.as_ref().map(|l| (traced_limits(l, *s, c), traced_circle(l, *s))),
            // In a table a distance that the lens does not focus to is left out.
            Err(_) if distances.len() > 1 => None,
            Err(e) => return Err(e),
        };
        rows.push((*s, near, far, circle_mm(focal, aperture, *s, f64::INFINITY), traced));
    }
    if !outputs.is_empty() {
        let figure = plot(focal, aperture, c, distances[distances.len() / 2], lens(distances[distances.len() / 2])?.as_ref());
        for path in paint::write(outputs, &figure)? {
            say(&format!("wrote {}", path.display()));
        }
    }
    if json {
        let row = |(s, near, far, at_infinity, traced): &DepthRow| {
            let limits = traced.and_then(|t| t.0);
            serde_json::json!({
                "focus_m": finite(*s), "near_m": near, "far_m": finite(*far), "depth_m": finite(far - near),
                "circle_at_infinity_mm": at_infinity,
                "traced_near_m": limits.map(|l| l.0), "traced_far_m": limits.and_then(|l| finite(l.1)),
                "traced_sharpest_circle_mm": traced.and_then(|t| t.1),
            })
        };
        return print_json(&serde_json::json!({
            "focal_length_mm": focal, "f_number": aperture, "fully_open": fully_open, "circle_mm": c, "hyperfocal_m": hyperfocal,
            "rows": rows.iter().map(row).collect::<Vec<_>>(),
        }));
    }
    let mut text = String::new();
    let shown = FNumber((aperture * 100.0).round() / 100.0);
    let open = if fully_open { " (fully open)" } else { "" };
    writeln!(text, "{focal:.2} mm   {shown}{open}   circle of confusion {c:.4} mm   hyperfocal {}", metres(hyperfocal))?;
    write!(text, "{:>10}  {:>10}  {:>10}  {:>10}  {:>14}", "focus", "near", "far", "depth", "blur at inf")?;
    writeln!(text, "{}", if args.lens.is_some() { "    traced near         far    sharpest blur" } else { "" })?;
    for (s, near, far, at_infinity, traced) in &rows {
        let depth = metres(far - near);
        write!(text, "{:>10}  {:>10}  {:>10}  {depth:>10}  {:>11.4} mm", metres(*s), metres(*near), metres(*far), at_infinity)?;
        if args.lens.is_some() {
            let (near, far) = match traced.and_then(|t| t.0) {
                Some((near, far)) => (metres(near), metres(far)),
                None => ("-".into(), "-".into()),
            };
            let blur = traced.and_then(|t| t.1).map_or("-".to_owned(), |b| format!("{b:.4} mm"));
            write!(text, "  {near:>12}  {far:>10}  {blur:>15}")?;
        }
        writeln!(text)?;
    }
    if rows.iter().any(|r| matches!(r.4, Some((None, _)))) {
        writeln!(text, "-: even the sharpest blur is larger than the circle")?;
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Blur over distance: closed form, and traced beside it.
fn plot(focal: f64, aperture: f64, c: f64, focus: f64, lens: Option<&CompoundLens>) -> Figure {
    let span = if focus.is_finite() { focus } else { hyperfocal_m(focal, aperture, c) };
    let places: Vec<f64> = (0..=160).map(|k| (span * 4f64.powf(k as f64 / 80.0 - 1.0)).max(2.1e-3 * focal)).collect();
    let line = |name: &str, color, style, of: &dyn Fn(f64) -> Option<f64>| Line {
        name: name.into(),
        color,
        style,
        points: places.iter().filter_map(|d| Some(DVec2::new(*d, of(*d)?))).collect(),
    };
    let mut lines = vec![
        line("thin lens", [34, 85, 170], Style::Full, &|d| Some(circle_mm(focal, aperture, focus, d))),
        line("taken for sharp", [120, 120, 120], Style::Broken, &|_| Some(c)),
    ];
    if let Some(lens) = lens {
        lines.push(line("traced", [204, 51, 51], Style::Full, &|d| traced_circle(lens, d)));
    }
    let top = lines[0].points.iter().map(|p| p.y).fold(2.0 * c, f64::max).min(12.0 * c);
    lines.iter_mut().for_each(|l| l.points.retain(|p| p.y <= top));
    let mut figure = Figure::new(520.0, 360.0);
    Chart {
        title: format!("{focal:.0} mm {} focused at {}", FNumber((aperture * 100.0).round() / 100.0), metres(focus)),
        x: Axis { label: "distance, m".into(), range: [places[0], places[places.len() - 1]] },
        y: Axis { label: "diameter of the blur, mm".into(), range: [0.0, top] },
        lines,
    }
    .draw(&mut figure, DVec2::ZERO, DVec2::new(520.0, 360.0));
    figure
}

/// Hyperfocal distance over the full stops, or of one.
pub fn hyperfocal(
    focal: LengthMm,
    aperture: Option<FNumber>,
    format: &str,
    given: Option<LengthMm>,
    json: bool,
) -> anyhow::Result<()> {
    let format = format_named(format)?;
    let (f, c) = (positive("focal length", focal.0)?, circle(given, &format)?);
    let stops = match aperture {
        Some(n) => vec![f_number(n)?],
        None => vec![1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0],
    };
    let rows: Vec<(f64, f64)> = stops.iter().map(|n| (*n, hyperfocal_m(f, *n, c))).collect();
    if json {
        let row =
            |(n, h): &(f64, f64)| serde_json::json!({ "f_number": n, "hyperfocal_m": h, "near_m": limits_m(f, *n, c, *h).0 });
        return print_json(
            &serde_json::json!({ "focal_length_mm": f, "circle_mm": c, "rows": rows.iter().map(row).collect::<Vec<_>>() }),
        );
    }
    let mut out = std::io::stdout();
    writeln!(out, "{f} mm   circle of confusion {c:.4} mm: focused there, all from half of it to infinity is sharp")?;
    for (n, h) in rows {
        writeln!(out, "{:>8}  {:>10}   sharp from {}", FNumber(n).to_string(), metres(h), metres(limits_m(f, n, c, h).0))?;
    }
    Ok(())
}

/// What is seen: angles, crop factor, equivalent focal length, size of the field at a distance.
pub fn field(args: &Field, json: bool) -> anyhow::Result<()> {
    let format = format_named(&args.format)?;
    let (w, h, d) = (format.width_mm, format.height_mm, format.diagonal_mm());
    let lens = match args.lens.as_deref() {
        None => None,
        Some(name) => {
            let setting = Setting {
                focal_length: args.focal_length.map(|f| f.0),
                f_number: None,
                focus: Focus::Infinity,
                iris: None,
                film_mm: [w, h],
            };
            Some(CompoundLens::new(Arc::new(read_lens(name)?), &setting).map_err(ShotError::from)?)
        }
    };
    let f = match (&lens, args.focal_length) {
        (Some(lens), _) => lens.focal_length().0,
        (None, Some(f)) => positive("focal length", f.0)?,
        (None, None) => return Err(UsageError(anyhow!("calc fov: expected a focal length, such as 50mm, or --lens")).into()),
    };
    let angles = [w, h, d].map(|side| format::field_of_view(side, f).to_degrees());
    // Chief rays to the middle of the sides and to the corner.
    let traced = lens.as_ref().map(|lens| {
        let lens = Lens::Compound(Box::new(lens.clone()));
        [DVec2::new(0.5 * w, 0.0), DVec2::new(0.0, 0.5 * h), DVec2::new(0.5 * w, 0.5 * h)]
            .map(|film| lens.chief_ray(film).ok().map(|r| 2.0 * (-r.direction.z).acos().to_degrees()))
    });
    let crop = format::equivalent_35mm(1.0, d);
    if args.distance.is_some_and(|d| !(d.0 > 0.0 && d.0.is_finite())) {
        return Err(UsageError(anyhow!("distance: expected metres above 0, such as 3m")).into());
    }
    if let Some(s) = args.distance.filter(|s| 1000.0 * s.0 <= f) {
        return Err(UsageError(anyhow!(
            "distance {s}: expected more than the focal length, {f:.1} mm: nearer planes have no image"
        ))
        .into());
    }
    // Focused there.
    let seen = args.distance.map(|s| [w, h].map(|side| side * (s.0 / f - 1e-3)));
    if json {
        return print_json(&serde_json::json!({
            "width_mm": w, "height_mm": h, "focal_length_mm": f, "horizontal_deg": angles[0], "vertical_deg": angles[1],
            "diagonal_deg": angles[2], "crop_factor": crop, "equivalent_mm": f * crop, "traced_deg": traced, "field_m": seen,
        }));
    }
    let mut out = std::io::stdout();
    writeln!(out, "{w} × {h} mm, {f:.2} mm: {:.2}° × {:.2}°, diagonal {:.2}°", angles[0], angles[1], angles[2])?;
    if let Some(t) = traced {
        let show = |v: Option<f64>| v.map_or("dark".to_owned(), |v| format!("{v:.2}°"));
        writeln!(out, "traced through the lens: {} × {}, diagonal {}", show(t[0]), show(t[1]), show(t[2]))?;
    }
    writeln!(out, "crop factor {crop:.3}, as {:.1} mm on 36 × 24 mm", f * crop)?;
    if let (Some([a, b]), Some(s)) = (seen, args.distance) {
        writeln!(out, "at {s}: {a:.3} × {b:.3} m")?;
    }
    Ok(())
}

/// The lens, aperture and speed that give the same picture on another format.
pub fn equivalent(args: &FormatArgs, json: bool) -> anyhow::Result<()> {
    let (from, to) = (format_named(&args.from)?, format_named(&args.to)?);
    let ratio = to.diagonal_mm() / from.diagonal_mm();
    let (own, s) = (positive("focal length", args.focal_length.0)?, 1000.0 * args.focus.0);
    // The distance of the image grows with the format, so that angles stay; the opening stays as wide as it is.
    let f = match s.is_finite() && s > own {
        true => {
            let image = ratio * own * s / (s - own);
            image * s / (image + s)
        }
        false => own * ratio,
    };
    let n = f_number(args.aperture)? * f / own;
    let iso = positive("iso", args.iso.0)? * ratio * ratio;
    if !(1000.0 * args.focus.0 > args.focal_length.0.max(f)) {
        return Err(UsageError(anyhow!(
            "focus {}: expected more than the focal lengths: nearer planes have no image",
            args.focus
        ))
        .into());
    }
    let c = [&from, &to].map(|x| x.diagonal_mm() * CIRCLE_OF_DIAGONAL);
    let s = args.focus.0;
    let limits = [limits_m(args.focal_length.0, args.aperture.0, c[0], s), limits_m(f, n, c[1], s)];
    if json {
        let limit = |l: (f64, f64)| serde_json::json!({ "near_m": l.0, "far_m": finite(l.1) });
        return print_json(&serde_json::json!({
            "ratio": ratio, "focal_length_mm": f, "f_number": n, "iso": iso, "from": limit(limits[0]), "to": limit(limits[1]),
        }));
    }
    let mut out = std::io::stdout();
    let row = |out: &mut std::io::Stdout, name: &str, f: f64, n: f64, iso: f64, (near, far): (f64, f64)| {
        let iso = if iso < 10.0 { format!("{iso:.2}") } else { format!("{iso:.0}") };
        writeln!(out, "{name:<16} {f:>8.2} mm   f/{n:<6.2} ISO {iso:<8} sharp from {} to {}", metres(near), metres(far))
    };
    row(&mut out, &args.from, args.focal_length.0, args.aperture.0, args.iso.0, limits[0])?;
    row(&mut out, &args.to, f, n, iso, limits[1])?;
    writeln!(
        out,
        "the same angle of view, blur, diffraction and light in all (aperture diameter {:.2} mm); focused at {}",
        f / n,
        args.focus
    )?;
    Ok(())
}

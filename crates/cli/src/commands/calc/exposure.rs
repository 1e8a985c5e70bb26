//! `calc exposure`, `calc equivalent`, `calc program`, `calc stops`: aperture, time and speed.

use crate::UsageError;
use crate::args::Equivalent;
use crate::commands::{print_json, shown};
use crate::paint;
use crate::watch::say;
use anyhow::anyhow;
use diopter::depth_of_field::{CIRCLE_OF_DIAGONAL, limits_m};
use diopter::lens::draw::{Axis, Chart, Color, Figure, Line, Style};
use diopter::metering::{K, ev100_of_setting};
use diopter::program::{Chosen, Limits, Mode, choose};
use diopter::quantity::{FNumber, Iso, IsoChoice, LengthMm, Seconds};
use diopter::sensor::calibration;
use diopter::shot::{read_body, white_point};
use diopter::stops::{self, Step};
use glam::DVec2;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

/// Green light, nm: what diffraction is told for.
const GREEN_NM: f64 = 550.0;

pub(super) fn positive(what: &str, v: f64) -> anyhow::Result<f64> {
    match (1e-9..=1e9).contains(&v) {
        true => Ok(v),
        false => Err(UsageError(anyhow!("{what} {v}: expected a number above 0, from a billionth to a billion")).into()),
    }
}

/// An aperture that can be.
pub(super) fn f_number(asked: FNumber) -> anyhow::Result<f64> {
    match FNumber::RANGE.contains(&asked.0) {
        true => Ok(asked.0),
        false => Err(UsageError(anyhow!("aperture {asked}: expected {}", FNumber::EXPECTED)).into()),
    }
}

/// EV of a setting and the luminance and illuminance it is right for.
pub fn value(aperture: FNumber, time: Seconds, iso: Iso, true_stops: bool, json: bool) -> anyhow::Result<()> {
    let mean = |v: f64, of: fn(f64, Option<Step>) -> f64| if true_stops { of(v, None) } else { v };
    let n = mean(f_number(aperture)?, stops::true_aperture);
    let t = mean(positive("time", time.0)?, stops::true_time);
    let s = mean(positive("iso", iso.0)?, stops::true_speed);
    let ev = (n * n / t).log2();
    let ev100 = ev100_of_setting(n, t, s);
    // ISO 2720: L = K · 2^EV100 / 100, E = C · 2^EV100 / 100.
    let luminance = K * ev100.exp2() / 100.0;
    let illuminance = diopter::flash::C * ev100.exp2() / 100.0;
    // Light on the film: H = 0.65 L t / N² (ISO 12232).
    let lux_seconds = 0.65 * luminance * t / (n * n);
    if json {
        return print_json(&serde_json::json!({
            "f_number": n, "time_s": t, "iso": s, "ev": ev, "ev100": ev100, "luminance_cd_m2": luminance,
            "illuminance_lx": illuminance, "film_lx_s": lux_seconds,
        }));
    }
    let mut out = std::io::stdout();
    let [n, t, s] = [n, t, s].map(|v| format!("{v:.4e}").parse().unwrap_or(v));
    writeln!(out, "{}   {}   {}", FNumber(n), Seconds(t), Iso(s))?;
    writeln!(out, "EV {ev:.2}   at ISO 100: EV {ev100:.2}")?;
    let (luminance, illuminance) = (shown(luminance), shown(illuminance));
    writeln!(out, "right for {luminance} cd/m² (K = {K}), or {illuminance} lx on the subject (C = {})", diopter::flash::C)?;
    writeln!(out, "light on the film {} lx·s", shown(lux_seconds))?;
    Ok(())
}

/// A row of the table of equal exposures.
struct Row {
    nominal: [f64; 2],
    aperture: f64,
    time: f64,
    near: f64,
    far: f64,
    airy_um: f64,
    blur_px: f64,
    snr_db: f64,
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn equivalent(args: &Equivalent, json: bool) -> anyhow::Result<()> {
    let n0 = stops::true_aperture(f_number(args.aperture)?, None);
    let t0 = stops::true_time(positive("time", args.time.0)?, None);
    let focal = positive("focal length", args.focal_length.0)?;
    let distance = positive("focus", args.focus.0.min(1e9))?;
    if 1000.0 * distance <= focal {
        let what = format!("expected more than the focal length, {focal:.1} mm: nearer planes have no image");
        return Err(UsageError(anyhow!("focus {}: {what}", args.focus)).into());
    }
    if !(args.speed >= 0.0 && args.speed.is_finite()) {
        return Err(UsageError(anyhow!("speed {}: expected m/s, 0 or more", args.speed)).into());
    }
    let sensor = read_body(&args.body)?;
    let step = sensor.at_iso(args.iso.0).map_err(diopter::shot::ShotError::from)?;
    let diagonal = sensor.format_mm[0].hypot(sensor.format_mm[1]);
    let circle = diagonal * CIRCLE_OF_DIAGONAL;
    let magnification = focal / (1000.0 * distance - focal).max(1e-9);
    // Electrons of a middle grey of D55, in the channel that sees most; H = 0.65 K / S.
    let light = white_point("D55")?;
    let per_lux_second = {
        let scale = 1.0 / diopter::light::color::luminance(|nm| light.at(nm));
        let [px, py] = sensor.pitch_mm();
        let signals = calibration::signals(&sensor, &sensor.band_responses(), &|nm| light.at(nm) * scale as f32);
        signals.max_element() * px * py * 1e-6
    };
    let ev100 = ev100_of_setting(n0, t0, args.iso.0);
    let electrons = per_lux_second * 0.65 * K / args.iso.0;
    let dark = sensor.dark_current.at(sensor.temperature_c);
    let rows: Vec<Row> = stops::apertures(Step::Full)
        .into_iter()
        .filter(|m| (1.4..=32.0).contains(&m.nominal))
        .map(|m| {
            let time = t0 * (m.value / n0).powi(2);
            let (near, far) = limits_m(focal, m.value, circle, if args.focus.0.is_infinite() { f64::INFINITY } else { distance });
            let variance = electrons + step.read_noise_e.powi(2) + step.row_noise_e.powi(2) + dark * time;
            Row {
                nominal: [m.nominal, stops::nearest(&stops::times(Step::Third), time).nominal],
                aperture: m.value,
                time,
                near,
                far,
                airy_um: 2.44 * GREEN_NM * 1e-3 * m.value,
                blur_px: args.speed * 1000.0 * time * magnification / sensor.pitch_mm()[0],
                snr_db: 20.0 * (electrons / variance.sqrt()).log10(),
            }
        })
        .collect();
    if json {
        let row = |r: &Row| {
            serde_json::json!({
                "aperture": r.nominal[0], "true_aperture": r.aperture, "time_s": r.nominal[1], "true_time_s": r.time, "near_m": r.near,
                "far_m": r.far.is_finite().then_some(r.far), "airy_um": r.airy_um, "motion_px": r.blur_px, "grey_snr_db": r.snr_db,
            })
        };
        return print_json(&serde_json::json!({ "ev100": ev100, "rows": rows.iter().map(row).collect::<Vec<_>>() }));
    }
    let mut text = String::new();
    writeln!(
        text,
        "EV {:.2}, ISO {}: as much light   ({:.0} mm focused at {}, {}, subject at {} m/s)",
        (n0 * n0 / t0).log2(),
        args.iso.0,
        focal,
        args.focus,
        sensor.name,
        args.speed
    )?;
    writeln!(text, "  aperture   (true)    time      (true, s)   sharp from   to        diffraction   motion      grey S/N")?;
    let mut is_beyond = false;
    for r in rows {
        let far = if r.far.is_finite() { format!("{:.2} m", r.far) } else { "inf".into() };
        let mark = if (r.aperture / n0 - 1.0).abs() < 1e-3 { '>' } else { ' ' };
        let beyond = if !(1.0 / 8200.0..=33.0).contains(&r.time) { "*" } else { "" };
        is_beyond |= !beyond.is_empty();
        writeln!(
            text,
            "{mark} f/{:<8} {:<9.4} {:<9} {:<11.6} {:<12} {:<9} {:<13} {:<11} {:.1} dB{beyond}",
            r.nominal[0],
            r.aperture,
            if beyond.is_empty() { stops::time_name(r.nominal[1]) } else { "–".into() },
            r.time,
            format!("{:.2} m", r.near),
            far,
            format!("{:.1} µm", r.airy_um),
            format!("{:.1} px", r.blur_px),
            r.snr_db
        )?;
    }
    if is_beyond {
        writeln!(text, "* beyond what the dial of times has")?;
    }
    writeln!(
        text,
        "sharp: a circle of {circle:.4} mm (diagonal / 1442); diffraction: Airy disk of green light; motion: pixels of {}; S/N: of a middle grey",
        sensor.name
    )?;
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Highest speed of a program line: what no body has.
const MOST_ISO: f64 = 1e8;

/// The program line over EV at ISO 100.
pub fn program(widest: FNumber, focal: LengthMm, iso: IsoChoice, output: &[PathBuf], json: bool) -> anyhow::Result<()> {
    let (widest, focal) = (f_number(widest)?, positive("focal length", focal.0)?);
    let iso = iso.fixed().map(|iso| positive("iso", iso)).transpose()?;
    if let Some(iso) = iso.filter(|iso| *iso > MOST_ISO) {
        return Err(UsageError(anyhow!("iso {iso}: expected a speed up to {MOST_ISO}, or auto")).into());
    }
    let outputs = paint::prepare(output)?;
    let limits = Limits {
        aperture: [widest, widest.max(22.0)],
        time_s: [1.0 / 8192.0, 32.0],
        iso: iso.map_or([100.0, 6400.0], |i| [i; 2]),
        handheld_s: 1.0 / focal,
        step: None,
        beyond_mark_s: 0.0,
        t_per_f: 1.0,
    };
    let set = Chosen { aperture: widest, time_s: 1.0 / focal, iso: limits.iso[0] };
    let line: Vec<(f64, Chosen)> =
        (-12..=44).map(|k| f64::from(k) / 2.0).map(|ev| (ev, choose(Mode::Program, ev, set, &limits))).collect();
    if json {
        let row = |(ev, c): &(f64, Chosen)| serde_json::json!({ "ev100": ev, "aperture": c.aperture, "time_s": c.time_s, "iso": c.iso });
        return print_json(&serde_json::json!(line.iter().map(row).collect::<Vec<_>>()));
    }
    if outputs.is_empty() {
        let mut out = std::io::stdout();
        writeln!(out, "{:>6}  {:>8}  {:>12}  {:>6}  {:>6}", "EV100", "aperture", "time", "ISO", "off")?;
        for (ev, c) in line.iter().step_by(2) {
            let off = ev - ev100_of_setting(c.aperture, c.time_s, c.iso);
            let off = if off.abs() < 0.005 { String::new() } else { format!("{off:+.1}") };
            let time = if c.time_s < 0.3 { format!("1/{:.0} s", 1.0 / c.time_s) } else { format!("{:.1} s", c.time_s) };
            writeln!(out, "{ev:>6.1}  {:>8}  {time:>12}  {:>6.0}  {off:>6}", format!("f/{:.1}", c.aperture), c.iso)?;
        }
        return Ok(());
    }
    let mut figure = Figure::new(460.0, 340.0);
    let curve = |name: &str, color: Color, style: Style, of: &dyn Fn(&Chosen) -> f64| Line {
        name: name.into(),
        color,
        style,
        points: line.iter().map(|(ev, c)| DVec2::new(*ev, of(c))).collect(),
    };
    Chart {
        title: format!("program line: {focal:.0} mm f/{widest}"),
        x: Axis { label: "EV at ISO 100".into(), range: [-6.0, 22.0] },
        y: Axis { label: "EV of aperture, time, speed".into(), range: [-6.0, 18.0] },
        lines: vec![
            curve("aperture: Av = 2 log2 N", [204, 51, 51], Style::Full, &|c| 2.0 * c.aperture.log2()),
            curve("time: Tv = -log2 t", [34, 85, 170], Style::Full, &|c| -c.time_s.log2()),
            curve("speed: log2 (ISO / 100)", [102, 102, 102], Style::Broken, &|c| (c.iso / 100.0).log2()),
        ],
    }
    .draw(&mut figure, DVec2::ZERO, DVec2::new(460.0, 340.0));
    for path in paint::write(outputs, &figure)? {
        say(&format!("wrote {}", path.display()));
    }
    Ok(())
}

/// Engraved numbers and what they stand for.
pub fn stops(step: &str, json: bool) -> anyhow::Result<()> {
    let Some((name, step)) = Step::NAMES.into_iter().find(|n| n.0 == step) else {
        return Err(UsageError(anyhow!("step \"{step}\": expected full, half or third")).into());
    };
    let (apertures, times, speeds) = (stops::apertures(step), stops::times(step), stops::speeds(step));
    if json {
        let list = |l: &[stops::Mark]| {
            l.iter().map(|m| serde_json::json!({ "nominal": m.nominal, "true": m.value })).collect::<Vec<_>>()
        };
        return print_json(&serde_json::json!({
            "step": name, "apertures": list(&apertures), "times_s": list(&times), "iso": list(&speeds),
        }));
    }
    let mut out = std::io::stdout();
    writeln!(out, "{:<10} {:<10} {:<10} {:<12} {:<10} {:<10}", "aperture", "true", "time", "true, s", "ISO", "true")?;
    for k in 0..apertures.len().max(times.len()).max(speeds.len()) {
        let a = apertures.get(k).map_or(Default::default(), |m| (format!("f/{}", m.nominal), format!("{:.4}", m.value)));
        let t = times.get(k).map_or(Default::default(), |m| (stops::time_name(m.nominal), format!("{:.6}", m.value)));
        let s = speeds.get(k).map_or(Default::default(), |m| (format!("{:.0}", m.nominal), format!("{:.1}", m.value)));
        writeln!(out, "{:<10} {:<10} {:<10} {:<12} {:<10} {:<10}", a.0, a.1, t.0, t.1, s.0, s.1)?;
    }
    Ok(())
}

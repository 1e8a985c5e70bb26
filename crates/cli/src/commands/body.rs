//! `body list`, `body info`, `body emva` and `body iso`.

use super::print_json;
use crate::args::{BodyVerb, Emva, List, ReadOut};
use crate::output::Output;
use crate::watch::{say, warn};
use crate::{UsageError, paint};
use anyhow::{Context, anyhow};
use diopter::image::png;
use diopter::lens::draw::{Axis, Chart, Figure, Line, Style};
use diopter::sensor::emva::{self, Conditions, Figures, Frame, Point, Report};
use diopter::sensor::{Sensor, format, saturation_capacity};
use diopter::shot::read_body;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &BodyVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        BodyVerb::List => list(json),
        BodyVerb::Info { body } => info(body, json),
        BodyVerb::Emva(args) => measure(args, json),
        BodyVerb::Iso { body, iso } => speeds(body, iso.as_ref(), json),
    }
}

/// The body that is asked for, or the one the plane was exposed with; warns of a temperature that changes nothing of it. Fails on a body that is not known or cannot be read, and where the plane's is not embedded.
pub fn body_of(args: &ReadOut, exposed_with: &str) -> anyhow::Result<Sensor> {
    let sensor = match &args.body {
        Some(name) => read_body(name)?,
        None => {
            let named = Sensor::names().filter_map(|n| Sensor::named(n).ok()).find(|s| s.name == exposed_with);
            named.with_context(|| {
                let plane = args.plane.display();
                format!("{plane}: it was exposed with \"{exposed_with}\", which is not embedded; give its file with --body")
            })?
        }
    };
    if let Some(ignored) = sensor.ignored_temperature().filter(|_| args.raw.temperature.is_some()) {
        warn(&ignored);
    }
    Ok(sensor)
}

fn list(json: bool) -> anyhow::Result<()> {
    let bodies = Sensor::names().map(|n| Ok((n, Sensor::named(n)?))).collect::<anyhow::Result<Vec<_>>>()?;
    if json {
        let all: Vec<_> = bodies
            .iter()
            .map(|(key, s)| serde_json::json!({ "name": key, "body": s.name, "format_mm": s.format_mm, "pixels": s.pixels }))
            .collect();
        return print_json(&serde_json::json!(all));
    }
    for (key, s) in bodies {
        let [w, h] = s.format_mm;
        writeln!(std::io::stdout(), "{key:<18} {:<34} {w:.4} × {h:.4} mm, {} × {} pixels", s.name, s.pixels[0], s.pixels[1])?;
    }
    Ok(())
}

fn info(name: &str, json: bool) -> anyhow::Result<()> {
    let s = read_body(name)?;
    let [pitch_x, pitch_y] = s.pitch_mm().map(|p| p * 1000.0);
    let crop = format::FULL_FRAME_DIAGONAL_MM / s.format_mm[0].hypot(s.format_mm[1]);
    let rows: Vec<_> = s
        .iso
        .iter()
        .map(|i| {
            let top = s.saturation_e(i);
            // Quantisation is part of the floor.
            let rounding = i.gain_e_per_dn * i.digital_gain;
            let floor = (i.read_noise_e.powi(2) + i.row_noise_e.powi(2) + rounding.powi(2) / 12.0).sqrt();
            // Of two readings each has shot noise of its own electrons.
            let counted =
                s.second_reading.as_ref().map_or(top, |r| top.min(r.switch_at * s.full_well_e).max(top * r.relative_exposure));
            (i, top, floor, (top / floor).log2(), 10.0 * counted.log10())
        })
        .collect();
    let names = s.cfa.channel_names();
    let capacity = saturation_capacity(s.full_well_e, s.iso[0].read_noise_e.hypot(s.iso[0].row_noise_e));
    let dark = s.dark_current.at(s.temperature_c);
    if json {
        let iso: Vec<_> = rows
            .iter()
            .map(|(i, top, floor, dr, snr)| {
                serde_json::json!({
                    "iso": i.iso, "gain_e_per_dn": i.gain_e_per_dn, "read_noise_e": i.read_noise_e, "row_noise_e": i.row_noise_e,
                    "dark_noise_with_rounding_e": floor, "saturation_e": top, "dynamic_range_stops": dr, "snr_max_db": snr,
                    "black_level_dn": i.black_level_dn, "white_level_dn": i.white_level_dn, "digital_gain": i.digital_gain,
                })
            })
            .collect();
        let qe: Vec<_> = s.quantum_efficiency.iter().map(|q| q.max()).collect();
        return print_json(&serde_json::json!({
            "name": s.name, "make": s.make, "model": s.model, "format_mm": s.format_mm, "pixels": s.pixels,
            "pitch_um": [pitch_x, pitch_y], "crop_factor": crop, "cfa": s.cfa.letters(), "channels": names,
            "peak_quantum_efficiency": qe, "full_well_e": s.full_well_e, "saturation_capacity_e": capacity,
            "adc_bits": s.adc_bits, "prnu_percent": s.prnu * 100.0, "dsnu_e": s.dsnu_e, "dark_current_e_per_s": dark,
            "temperature_c": s.temperature_c, "hot_pixel_fraction": s.hot_pixels.fraction, "low_pass_px": s.low_pass_px,
            "two_stage": s.two_stage().map(|(m, off)| serde_json::json!({
                "before_e": m.before_e, "after_dn": m.after_dn, "worst": off,
            })),
            "plenoptic": s.plenoptic.as_ref().map(|m| serde_json::json!({
                "pitch_mm": m.pitch_mm, "focal_length_mm": m.focal_length_mm, "gap_mm": m.gap_mm, "arrangement": m.arrangement,
            })),
            "lens": s.lens.map(|l| serde_json::json!({ "focal_length_mm": l.focal_length_mm, "f_number": l.f_number })),
            "fill_factor": s.fill_factor, "crosstalk": s.crosstalk, "mtf_nyquist": s.mtf(0.5), "mtf_half_nyquist": s.mtf(0.25),
            "iso": iso, "sources": s.sources,
        }));
    }
    let mut t = String::new();
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    writeln!(t, "{}", s.name)?;
    writeln!(t, "  format        {:.4} × {:.4} mm, crop {crop:.3}", s.format_mm[0], s.format_mm[1])?;
    writeln!(t, "  pixels        {} × {}, pitch {pitch_x:.3} × {pitch_y:.3} µm", s.pixels[0], s.pixels[1])?;
    writeln!(t, "  filters       {}", if s.cfa.is_monochrome() { "none".to_owned() } else { s.cfa.letters() })?;
    let qe: Vec<String> = names.iter().zip(&s.quantum_efficiency).map(|(n, q)| format!("{n} {:.2}", q.max())).collect();
    writeln!(t, "  peak QE       {}", qe.join("  "))?;
    writeln!(t, "  full well     {:.0} e- (EMVA 1288 saturation capacity {capacity:.0} e-)", s.full_well_e)?;
    if let Some(r) = &s.second_reading {
        let light = percent(r.relative_exposure);
        writeln!(t, "  2nd reading   {light} of the light, {:.0} e-, read noise {} e-", r.full_well_e, r.read_noise_e)?;
    }
    if let Some(m) = &s.plenoptic {
        let um = |mm: Option<f64>| mm.map_or("matched to the lens".to_owned(), |v| format!("{:.3} µm", 1e3 * v));
        let kind = if m.arrangement.is_empty() { "square" } else { &m.arrangement };
        writeln!(t, "  microlenses   {kind}, pitch {}, focal length {}", um(m.pitch_mm), um(m.focal_length_mm))?;
    }
    if let Some(l) = &s.lens {
        writeln!(
            t,
            "  lens          {} mm f/{} ({:.0} mm equiv.), ideal",
            l.focal_length_mm,
            l.f_number,
            l.focal_length_mm * crop
        )?;
    }
    writeln!(t, "  converter     {} bit", s.adc_bits)?;
    if s.prnu > 0.0 || s.dsnu_e > 0.0 || s.dsnu_row_e > 0.0 || s.dsnu_column_e > 0.0 {
        // As the sheet says it; the division by 100 leaves a rounding error.
        let prnu = (s.prnu * 1e8).round() / 1e6;
        let lines = match s.dsnu_row_e > 0.0 || s.dsnu_column_e > 0.0 {
            true => format!(", of rows {} e-, of columns {} e-", s.dsnu_row_e, s.dsnu_column_e),
            false => String::new(),
        };
        writeln!(t, "  non-uniform   PRNU {prnu} %, DSNU {} e-{lines}", s.dsnu_e)?;
    }
    if dark > 0.0 {
        writeln!(t, "  dark current  {dark:.4} e-/s at {:.0} °C, {:.4} at 35 °C", s.temperature_c, s.dark_current.at(35.0))?;
    }
    if s.hot_pixels.fraction > 0.0 {
        writeln!(
            t,
            "  hot pixels    {:.3} %, {} times the dark current on average",
            s.hot_pixels.fraction * 100.0,
            s.hot_pixels.factor
        )?;
    }
    writeln!(t, "  pixel MTF     {:.2} at half of Nyquist, {:.2} at Nyquist (lens apart)", s.mtf(0.25), s.mtf(0.5))?;
    if let Some((m, off)) = s.two_stage() {
        let worst = percent(off);
        writeln!(
            t,
            "  read noise    {:.2} e- before the gain, {:.2} DN after it (nearest; {worst} off at worst)",
            m.before_e, m.after_dn
        )?;
    }
    writeln!(
        t,
        "  {:>7} {:>11} {:>11} {:>13} {:>13} {:>9} {:>7} {:>7}",
        "ISO", "gain e-/DN", "dark e-", "saturation e-", "range stops", "SNR dB", "black", "white"
    )?;
    for (i, top, floor, dr, snr) in rows {
        writeln!(
            t,
            "  {:>7.0} {:>11.4} {:>11.2} {:>13.0} {:>13.2} {:>9.1} {:>7.0} {:>7.0}{}",
            i.iso,
            i.gain_e_per_dn,
            floor,
            top,
            dr,
            snr,
            i.black_level_dn,
            i.white_level_dn,
            if i.digital_gain > 1.0 { "  digital" } else { "" }
        )?;
    }
    writeln!(t, "  sources")?;
    for (what, source) in &s.sources {
        writeln!(t, "    {what}: {source}")?;
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

fn measure(args: &Emva, json: bool) -> anyhow::Result<()> {
    let s = read_body(&args.body)?;
    let names = s.cfa.channel_names();
    let most = |a: &usize, b: &usize| s.quantum_efficiency[*a].max().total_cmp(&s.quantum_efficiency[*b].max());
    let channel = match &args.channel {
        None => (0..names.len()).max_by(most).unwrap_or(0),
        Some(c) => names
            .iter()
            .position(|n| n.eq_ignore_ascii_case(c))
            .ok_or_else(|| UsageError(anyhow!("channel \"{c}\": expected one of {} on {}", names.join(", "), s.name)))?,
    };
    let conditions = Conditions {
        iso: args.iso.map_or(s.iso[0].iso, |i| i.0),
        channel,
        nm: args.wavelength,
        exposure_s: args.shutter.0,
        temperature_c: args.temperature,
        serial: args.serial.clone().unwrap_or_else(|| Conditions::default().serial),
        seed: args.seed,
        size: [args.size.width, args.size.height],
        stack: args.stack,
    };
    let plots = paint::prepare(&args.output)?;
    let mut export = args.export.as_deref().map(|folder| Export::new(folder, &s, &conditions)).transpose()?;
    let report = emva::measure(&s, &conditions, &mut |frame| match &mut export {
        Some(export) => export.keep(frame).map_err(|e| format!("{e:#}")),
        None => Ok(()),
    })
    .map_err(|e| match e {
        diopter::sensor::SensorError::Kept(reason) => anyhow!(reason),
        other => UsageError(other.into()).into(),
    })?;
    if let Some(export) = export {
        say(&format!("wrote {}", export.finish()?.display()));
    }
    let title = format!("{}, ISO {:.0}, {} at {:.0} nm", s.name, conditions.iso, names[channel], report.nm);
    for path in paint::write(plots, &plot(&title, &report))? {
        say(&format!("wrote {}", path.display()));
    }
    if json {
        return print_json(&serde_json::json!({
            "body": s.name, "iso": conditions.iso, "channel": names[channel], "nm": report.nm,
            "measured": report.measured, "sheet": report.sheet, "photon_transfer": report.points,
        }));
    }
    let mut t = String::new();
    writeln!(t, "{title}   (EMVA 1288, release 4.0 linear)")?;
    writeln!(t, "  {:<34} {:>12} {:>12} {:>9}", "", "measured", "data sheet", "")?;
    if s.second_reading.is_some() {
        writeln!(t, "  the first reading alone: both together are not what the linear model describes")?;
    }
    let (m, p) = (&report.measured, &report.sheet);
    let row = |t: &mut String, name: &str, unit: &str, of: &dyn Fn(&Figures) -> f64| {
        let (a, b) = (of(m), of(p));
        let off = if b.abs() > 0.005 { format!("{:+.2} %", 100.0 * (a / b - 1.0)) } else { String::new() };
        let digits = if b.abs().max(a.abs()) >= 1000.0 { 0 } else { 4 };
        writeln!(t, "  {:<34} {a:>12.digits$} {b:>12.digits$} {off:>9}", format!("{name}, {unit}"))
    };
    row(&mut t, "system gain K", "DN/e-", &|f| f.gain_dn_per_e)?;
    row(&mut t, "quantum efficiency", "%", &|f| 100.0 * f.quantum_efficiency)?;
    row(&mut t, "temporal dark noise", "e-", &|f| f.dark_noise_e)?;
    row(&mut t, "saturation capacity", "e-", &|f| f.saturation_capacity_e)?;
    row(&mut t, "sensitivity threshold", "photons", &|f| f.threshold_photons)?;
    row(&mut t, "largest SNR", "dB", &|f| f.snr_max_db())?;
    row(&mut t, "dynamic range", "dB", &|f| f.dynamic_range_db())?;
    row(&mut t, "DSNU1288", "e-", &|f| f.dsnu_e)?;
    row(&mut t, "  of rows", "e-", &|f| f.dsnu_row_e)?;
    row(&mut t, "  of columns", "e-", &|f| f.dsnu_column_e)?;
    row(&mut t, "  of pixels", "e-", &|f| f.dsnu_pixel_e)?;
    row(&mut t, "PRNU1288", "%", &|f| f.prnu_percent)?;
    row(&mut t, "linearity error LE", "%", &|f| f.linearity_error_percent)?;
    row(&mut t, "  largest", "%", &|f| f.linearity_error_max_percent)?;
    row(&mut t, "dark current", "e-/s", &|f| f.dark_current_e_per_s)?;
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

/// Pictures of a measurement in a folder, and their description in the words of the EMVA 1288 reference implementation.
struct Export {
    folder: PathBuf,
    description: String,
    written: usize,
}

impl Export {
    fn new(folder: &Path, sensor: &Sensor, c: &Conditions) -> anyhow::Result<Self> {
        let wrong = |reason: &str| UsageError(anyhow!("{}: {reason}", folder.display()));
        // An empty folder may stay; nothing is made before there is something to put into it.
        if folder.exists() {
            let Ok(mut files) = std::fs::read_dir(folder) else { return Err(wrong("this is not a folder").into()) };
            if files.next().is_some() {
                return Err(wrong("expected a folder that is new or empty").into());
            }
        }
        let description =
            format!("# {}, ISO {:.0}\nv 4.0\nn {} {} {}\n", sensor.name, c.iso, sensor.adc_bits, c.size[0], c.size[1]);
        Ok(Export { folder: folder.to_owned(), description, written: 0 })
    }

    fn keep(&mut self, frame: &Frame) -> anyhow::Result<()> {
        if !self.folder.exists() {
            std::fs::create_dir(&self.folder).with_context(|| format!("{}: cannot be made", self.folder.display()))?;
        }
        self.written += 1;
        let name = format!("{:04}.png", self.written);
        let output = Output::prepare(&self.folder.join(&name))?;
        output.commit(|to| Ok(png::write_numbers(frame.picture, to)?))?;
        if frame.number == 0 {
            let nanoseconds = frame.exposure_s * 1e9;
            match frame.photons > 0.0 {
                true => writeln!(self.description, "b {nanoseconds} {}", frame.photons)?,
                false => writeln!(self.description, "d {nanoseconds}")?,
            }
        }
        writeln!(self.description, "i {name}")?;
        Ok(())
    }

    /// The description comes last: where it is, all pictures are.
    fn finish(self) -> anyhow::Result<PathBuf> {
        let output = Output::prepare(&self.folder.join("description.txt"))?;
        output.commit(|to| Ok(to.write_all(self.description.as_bytes())?))
    }
}

/// Photon transfer, and signal over noise.
pub fn plot(title: &str, report: &Report) -> Figure {
    let cell = glam::DVec2::new(460.0, 320.0);
    let mut figure = Figure::new(2.0 * cell.x, cell.y + 24.0);
    let point = |x: f64, y: f64| glam::DVec2::new(x, y);
    let line = |name: &str, color, style, points| Line { name: name.into(), color, style, points };
    let (red, grey, blue) = ([200, 40, 40], [130, 130, 130], [40, 80, 200]);
    let m = &report.measured;
    // Room above for the legend, nothing below zero.
    let axis = |label: &str, values: &mut dyn Iterator<Item = f64>| {
        let highest = values.fold(0.0, f64::max);
        Axis { range: [0.0, Axis::around("", [1.12 * highest], true).range[1]], label: label.into() }
    };
    let transfer: Vec<_> = report.points.iter().map(|p| point(p.signal_dn.max(0.0), p.variance_dn2.max(0.0))).collect();
    let saturated = m.gain_dn_per_e * m.saturation_capacity_e;
    let fit = vec![point(0.0, 0.0), point(saturated, saturated * m.gain_dn_per_e)];
    Chart {
        title: format!("Photon transfer: K = {:.4} DN/e-", m.gain_dn_per_e),
        x: axis("signal less dark, DN", &mut transfer.iter().map(|p| p.x)),
        y: axis("variance less dark, DN²", &mut transfer.iter().map(|p| p.y)),
        lines: vec![line("measured", red, Style::Full, transfer), line("fit to 70 %", grey, Style::Broken, fit)],
    }
    .draw(&mut figure, glam::DVec2::new(0.0, 24.0), cell);
    let log = |v: f64| v.max(1e-12).log10();
    // Up to saturation: full pixels have no noise, and tell nothing.
    let last = 1.001 * m.saturation_capacity_e / m.quantum_efficiency;
    let used = || report.points.iter().filter(|p| p.snr > 0.0 && p.photons <= last);
    let at = |p: &Point, snr: f64| point(log(p.photons), 20.0 * log(snr));
    let snr: Vec<_> = used().map(|p| at(p, p.snr)).collect();
    let ideal: Vec<_> = used().map(|p| at(p, p.photons.sqrt())).collect();
    // The linear model of the figures that were measured.
    let model = |p: &Point| {
        let electrons = m.quantum_efficiency * p.photons;
        electrons / (m.dark_noise_e.powi(2) + 1.0 / (12.0 * m.gain_dn_per_e.powi(2)) + electrons).sqrt()
    };
    let modelled: Vec<_> = used().map(|p| at(p, model(p))).collect();
    let lowest = snr.iter().map(|p| p.y).fold(0.0, f64::min);
    let heights = snr.iter().chain(&ideal).map(|p| p.y).chain([lowest]);
    Chart {
        title: format!("SNR: largest {:.1} dB, dynamic range {:.1} dB", m.snr_max_db(), m.dynamic_range_db()),
        x: Axis::around("photons a pixel, log10", snr.iter().map(|p| p.x), false),
        y: Axis::around("SNR, dB", heights.collect::<Vec<_>>(), true),
        lines: vec![
            line("every photon counted", blue, Style::Broken, ideal),
            line("linear model", grey, Style::Broken, modelled),
            line("measured", red, Style::Full, snr),
        ],
    }
    .draw(&mut figure, glam::DVec2::new(cell.x, 24.0), cell);
    figure.text(glam::DVec2::new(figure.width / 2.0, 16.0), title, 11.0, diopter::lens::draw::Anchor::Middle);
    figure
}

fn speeds(body: &str, asked: Option<&List>, json: bool) -> anyhow::Result<()> {
    let s = read_body(body)?;
    let settings = asked.map_or_else(|| s.iso.iter().map(|i| i.iso).collect(), |l| l.0.clone());
    let all = settings.iter().map(|iso| diopter::iso::measure(&s, *iso)).collect::<Result<Vec<_>, _>>()?;
    if json {
        let rows: Vec<_> = all
            .iter()
            .map(|v| {
                serde_json::json!({
                    "nominal": v.nominal, "saturation": v.saturation, "standard_output": v.standard_output,
                    "noise_40": v.noise_40, "noise_10": v.noise_10,
                })
            })
            .collect();
        return print_json(&serde_json::json!({ "body": s.name, "speeds": rows }));
    }
    let mut t = String::new();
    writeln!(t, "{}   (ISO 12232:2019, D55; output: the default development; S/N: linear, bilinear demosaicing)", s.name)?;
    writeln!(t, "  {:>8} {:>11} {:>11} {:>11} {:>11}", "setting", "saturation", "output SOS", "S/N 40", "S/N 10")?;
    let number = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.0}"));
    for v in all {
        writeln!(
            t,
            "  {:>8.0} {:>11.0} {:>11} {:>11} {:>11}",
            v.nominal,
            v.saturation,
            number(v.standard_output),
            number(v.noise_40),
            number(v.noise_10)
        )?;
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}

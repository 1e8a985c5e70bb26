//! `measure`: what pictures say of the camera that took them.

mod glare;
mod oecf;
mod photograph;
mod predictor;
mod report;
mod resolution;
mod rolling;

use super::{named_once, print_json, read_raw};
use crate::args::{List, MeasureThroughLens, MeasureVerb, MeasuredChannel, PictureEncoding};
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::image::{Encoding, ExposureFacts};
use diopter::lens::analysis::Bench;
use diopter::lens::compound::Setting;
use diopter::lens::draw::{Axis, Chart, Color, Figure, Line, Style};
use diopter::lens::glass::D_NM;
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::{CompoundLens, Focus};
use diopter::measure::corners::Corners;
use diopter::measure::{Channel, Measured, Plane, Region, color, distortion, noise, vignetting};
use diopter::measure::{color::ColorDifferences, distortion::Distortion, vignetting::Vignetting};
use diopter::sensor::Sensor;
use diopter::sensor::emva::{self, Conditions};
use diopter::sensor::format::FULL_FRAME_DIAGONAL_MM;
use diopter::shot::{ShotError, read_body, read_lens};
use glam::DVec2;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const COLORS: [Color; 6] = [[204, 51, 51], [34, 85, 170], [40, 140, 70], [150, 90, 160], [200, 130, 30], [90, 90, 90]];

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &MeasureVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        MeasureVerb::Mtf(asked) => resolution::run(asked, json),
        MeasureVerb::Noise { files, region, body, output } => photon_transfer(files, *region, body.as_deref(), output, json),
        MeasureVerb::DynamicRange { body, iso, output } => dynamic_range(body, iso.as_ref(), output, json),
        MeasureVerb::Glare(asked) => glare::run(asked, json),
        MeasureVerb::Oecf(asked) => oecf::run(asked, json),
        MeasureVerb::Report(asked) => report::run(asked, json),
        MeasureVerb::Rolling(asked) => rolling::run(asked, json),
        MeasureVerb::Vignetting(asked) => fall_off(asked, json),
        MeasureVerb::Distortion(asked) => bent_lines(asked, json),
        MeasureVerb::Color { file, corners, light, encoding, output } => {
            differences(file, *corners, light, encoding.decoded(), output, json)
        }
    }
}

impl PictureEncoding {
    /// `None` of what the file says.
    fn decoded(self) -> Option<Encoding> {
        Some(match self {
            PictureEncoding::Auto => return None,
            PictureEncoding::Srgb => Encoding::Srgb,
            PictureEncoding::Gamma18 => Encoding::Gamma18,
            PictureEncoding::Gamma22 => Encoding::Gamma22,
            PictureEncoding::Gamma24 => Encoding::Gamma24,
            PictureEncoding::Linear => Encoding::Linear,
            PictureEncoding::Pq => Encoding::Pq,
            PictureEncoding::Hlg => Encoding::Hlg,
        })
    }
}

impl MeasuredChannel {
    fn measured(self) -> Channel {
        match self {
            MeasuredChannel::Red => Channel::Red,
            MeasuredChannel::Green => Channel::Green,
            MeasuredChannel::Blue => Channel::Blue,
            MeasuredChannel::Clear => Channel::Clear,
            MeasuredChannel::Luminance => Channel::Luminance,
        }
    }
}

fn region([x, y, width, height]: [usize; 4]) -> Region {
    Region { x, y, width, height }
}

/// A picture file, a channel of it, and that one's name.
fn plane(file: &Path, channel: Option<MeasuredChannel>, encoding: PictureEncoding) -> anyhow::Result<(Measured, Plane, Channel)> {
    let picture = Measured::read(file, encoding.decoded())?;
    let channel = channel.map_or_else(|| picture.usual_channel(), MeasuredChannel::measured);
    let plane = picture.plane(channel)?;
    Ok((picture, plane, channel))
}

/// What the bench says of the lens that a picture is compared with; nothing without.
fn bench_beside(
    file: &Path,
    lens: Option<&str>,
    picture: &Measured,
    plane: &Plane,
    says: impl Fn(&CompoundLens, [f64; 2]) -> Vec<(f64, f64)>,
) -> anyhow::Result<Vec<(f64, f64)>> {
    let Some(lens) = lens else { return Ok(vec![]) };
    let (lens, film_mm) = as_taken(file, lens, picture.facts(), [plane.width, plane.height])?;
    Ok(says(&lens, film_mm))
}

/// Pairs of heights and numbers, for machines.
fn points(pairs: &[(f64, f64)], name: &str) -> Vec<Value> {
    pairs.iter().map(|(h, v)| json!({ "height": h, name: v })).collect()
}

/// Writes the plot and prints the result.
fn finish(
    output: Vec<(bool, crate::output::Output)>,
    figure: impl FnOnce() -> Figure,
    text: &str,
    value: &Value,
    json: bool,
) -> anyhow::Result<()> {
    if !output.is_empty() {
        paint::write(output, &figure())?.iter().for_each(|path| say(&format!("wrote {}", path.display())));
    }
    if json {
        return print_json(value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// One chart on a sheet of its own.
fn sheet(chart: &Chart) -> Figure {
    let size = DVec2::new(560.0, 360.0);
    let mut figure = Figure::new(size.x, size.y);
    chart.draw(&mut figure, DVec2::ZERO, size);
    figure
}

fn line(name: impl Into<String>, color: usize, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Line {
    let points = points.into_iter().map(|(x, y)| DVec2::new(x, y)).collect();
    Line { name: name.into(), color: COLORS[color % COLORS.len()], style, points }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A lens as a picture of a size (pixels) was taken through it, by what the picture says of itself, and the film, mm.
fn as_taken(
    file: &Path,
    lens: &str,
    facts: Option<&ExposureFacts>,
    size: [usize; 2],
) -> anyhow::Result<(CompoundLens, [f64; 2])> {
    let file = file.display();
    let complete = |f: &&ExposureFacts| f.f_number > 0.0 && f.focal_length_mm > 0.0 && f.focal_length_35mm_mm > 0.0;
    let facts = facts.filter(complete).ok_or_else(|| {
        let what = "it does not say how it was taken; expected a raw file or a focal plane of `diopter` beside --lens";
        UsageError(anyhow!("{file}: {what}"))
    })?;
    let prescription = read_lens(lens)?;
    if !facts.lens.is_empty() && !facts.lens.starts_with(&prescription.name) {
        say(&format!("note: {file} was taken with the lens \"{}\", and is compared with \"{}\"", facts.lens, prescription.name));
    }
    // The film that was used, of square pixels.
    let diagonal = FULL_FRAME_DIAGONAL_MM * facts.focal_length_mm / facts.focal_length_35mm_mm;
    let [columns, rows] = size.map(|s| s as f64);
    let pitch = diagonal / columns.hypot(rows);
    let film_mm = [columns * pitch, rows * pitch];
    let focal_length = (!prescription.zoom.is_empty()).then_some(facts.focal_length_mm);
    let focus = facts.focus_distance_m.map_or(Focus::Infinity, |m| Focus::at_mm(1000.0 * m));
    let prescription = Arc::new(prescription);
    let set = |f_number: Option<f64>| {
        let setting = Setting { focal_length, f_number, focus, iris: None, film_mm };
        CompoundLens::new(prescription.clone(), &setting).map_err(ShotError::from)
    };
    let open = set(None)?;
    // Fully open is what the file says to all its digits.
    let lens = if facts.f_number > 1.001 * open.widest_f_number() { set(Some(facts.f_number))? } else { open };
    Ok((lens, film_mm))
}

/// The optical bench for a lens; the chart lies where the lens is focused, counted from the entrance pupil.
fn bench_of(lens: &CompoundLens) -> Bench<'_> {
    let system = lens.system();
    let pupil_mm = FirstOrder::of(system, &system.indices(D_NM)).entrance_pupil_z;
    Bench { system, object_distance: lens.focus_distance().map(|d| d.0 - pupil_mm) }
}

/// A number at tenths of the half diagonal of a film: image height over that half diagonal, and what is said of it in mm.
fn at_heights(film_mm: [f64; 2], says: impl Fn(f64) -> Option<f64>) -> Vec<(f64, f64)> {
    let half = 0.5 * film_mm[0].hypot(film_mm[1]);
    (1..=10).map(|k| f64::from(k) / 10.0).filter_map(|h| Some((h, says(h * half)?))).collect()
}

/// Distortion, %.
fn distortion_by_bench(lens: &CompoundLens, film_mm: [f64; 2]) -> Vec<(f64, f64)> {
    let bench = bench_of(lens);
    at_heights(film_mm, |mm| Some(bench.field_point(bench.field_of_height(mm), D_NM)?.distortion_percent()))
}

/// Illumination relative to the middle, without the pixels' own response to slanted light.
fn illumination_by_bench(lens: &CompoundLens, film_mm: [f64; 2]) -> Vec<(f64, f64)> {
    let bench = bench_of(lens);
    let middle = bench.illumination(0.0, D_NM).with_losses;
    at_heights(film_mm, |mm| (middle > 0.0).then(|| bench.illumination(mm, D_NM).with_losses / middle))
}

/// A table of what was measured at heights beside what the bench says there; `decimals` of the numbers.
fn beside_bench(bench: &[(f64, f64)], unit: &str, decimals: usize, measured: impl Fn(f64) -> f64) -> anyhow::Result<String> {
    let mut t = String::new();
    if !bench.is_empty() {
        writeln!(t, "  {:>7} {:>13} {:>13} {:>13}", "height", format!("measured{unit}"), format!("bench{unit}"), "difference")?;
    }
    for (h, expected) in bench {
        let found = measured(*h);
        writeln!(t, "  {h:>7.1} {found:>13.decimals$} {expected:>13.decimals$} {:>+13.decimals$}", found - expected)?;
    }
    Ok(t)
}

/// What the data sheet of a body says of a photon transfer at an ISO speed.
struct TransferSheet {
    body: String,
    iso: f64,
    /// System gain K, DN/e⁻.
    gain_dn_per_e: f64,
    /// Read noise and noise of rows together, e⁻.
    dark_noise_e: f64,
    /// White less black, e⁻.
    white_e: f64,
    /// White over the absolute sensitivity threshold, stops.
    dynamic_range_stops: f64,
}

/// The sheet of a body, or of the embedded one that raw files name, at the ISO speed of the files; none where nobody knows it.
fn transfer_sheet(raw: &diopter::image::RawImage, body: Option<&str>) -> anyhow::Result<Option<TransferSheet>> {
    let facts = &raw.header.facts;
    let sensor = match body {
        Some(body) => read_body(body)?,
        None => {
            let known = Sensor::names().filter_map(|name| Sensor::named(name).ok()).find(|s| s.name == facts.body);
            let Some(known) = known else { return Ok(None) };
            known
        }
    };
    let Some(iso) = facts.speed() else {
        return match body {
            Some(body) => Err(UsageError(anyhow!("--body {body}: the raw files do not say their ISO speed")).into()),
            None => Ok(None),
        };
    };
    let step = match (sensor.at_iso(iso), body) {
        (Ok(step), _) => step,
        (Err(_), None) => return Ok(None),
        (Err(e), Some(_)) => return Err(UsageError(e.into()).into()),
    };
    let dark_noise_e = step.read_noise_e.hypot(step.row_noise_e);
    let (white_e, gain_dn_per_e) = (sensor.saturation_e(&step), 1.0 / step.gain_e_per_dn);
    let dark_dn2 = (dark_noise_e * gain_dn_per_e).powi(2) + step.digital_gain.powi(2) / 12.0;
    Ok(Some(TransferSheet {
        body: sensor.name.clone(),
        iso,
        gain_dn_per_e,
        dark_noise_e,
        white_e,
        dynamic_range_stops: (white_e / emva::threshold_e(dark_dn2, gain_dn_per_e)).log2(),
    }))
}

fn photon_transfer(
    files: &[PathBuf],
    part: Option<[usize; 4]>,
    body: Option<&str>,
    output: &[PathBuf],
    json: bool,
) -> anyhow::Result<()> {
    if !files.len().is_multiple_of(2) {
        let found = format!("{} files", files.len());
        return Err(
            UsageError(anyhow!("{found}: expected pairs, two raw files of each exposure: A1.dng B1.dng A2.dng B2.dng")).into()
        );
    }
    // A picture that counts twice has no noise of its own.
    named_once(files)?;
    let outputs = paint::prepare(output)?;
    let pairs =
        files.chunks_exact(2).map(|two| Ok((read_raw(&two[0])?, read_raw(&two[1])?))).collect::<anyhow::Result<Vec<_>>>()?;
    let data_sheet = transfer_sheet(&pairs[0].0, body)?;
    let found = noise::measure(&pairs, part.map(region))?;
    let mut t = String::new();
    let ending = if pairs.len() == 1 { "" } else { "s" };
    writeln!(
        t,
        "photon transfer of {} pair{ending}   (EMVA 1288; stops: white over the absolute sensitivity threshold)",
        pairs.len()
    )?;
    writeln!(
        t,
        "  {:<8} {:>11} {:>11} {:>11} {:>11} {:>8}",
        "channel", "gain DN/e-", "gain e-/DN", "dark e-", "white e-", "stops"
    )?;
    let number = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2}"));
    for c in &found {
        writeln!(
            t,
            "  {:<8} {:>11.4} {:>11.4} {:>11} {:>11.0} {:>8}",
            c.channel,
            c.gain_dn_per_e,
            1.0 / c.gain_dn_per_e,
            number(c.dark_noise_e),
            c.white_e,
            number(c.dynamic_range_stops)
        )?;
    }
    if let Some(s) = &data_sheet {
        writeln!(
            t,
            "  {:<8} {:>11.4} {:>11.4} {:>11.2} {:>11.0} {:>8.2}   ({}, ISO {:.0})",
            "sheet",
            s.gain_dn_per_e,
            1.0 / s.gain_dn_per_e,
            s.dark_noise_e,
            s.white_e,
            s.dynamic_range_stops,
            s.body,
            s.iso
        )?;
    }
    if pairs.len() == 1 {
        writeln!(t, "  one pair: noise of the read-out counts as that of photons; a dark pair beside it tells them apart")?;
    }
    for c in &found {
        if let Some(offset) = c.dark_offset_dn {
            writeln!(
                t,
                "  {}: the dark pair lies {offset:+.1} DN from the black level of the files; it counts as dark",
                c.channel
            )?;
        }
    }
    writeln!(t, "  {:<8} {:>11} {:>13} {:>9}", "", "signal DN", "variance DN²", "SNR dB")?;
    for c in &found {
        for p in &c.pairs {
            // Of a dark pair there is no signal.
            let snr = if p.snr > 1e-6 { format!("{:.2}", 20.0 * p.snr.log10()) } else { "-".to_owned() };
            writeln!(t, "  {:<8} {:>11.2} {:>13.3} {snr:>9}", c.channel, p.signal_dn, p.variance_dn2)?;
        }
    }
    let figure = || {
        let points = |c: &noise::Transfer| c.pairs.iter().map(|p| (p.signal_dn, p.variance_dn2)).collect::<Vec<_>>();
        let all: Vec<(f64, f64)> = found.iter().flat_map(points).collect();
        let lines = found.iter().enumerate().flat_map(|(k, c)| {
            let last = c.pairs.last().map_or(0.0, |p| p.signal_dn);
            let dark = c.dark_noise_e.map_or(0.0, |d| (d * c.gain_dn_per_e).powi(2));
            let fit = [(0.0, dark), (last, dark + c.gain_dn_per_e * last)];
            let name = format!("{}: K = {:.4} DN/e-", c.channel, c.gain_dn_per_e);
            [line(name, k, Style::Full, points(c)), line("", k, Style::Broken, fit)]
        });
        sheet(&Chart {
            title: "photon transfer".into(),
            x: Axis::around("signal less black, DN", all.iter().map(|p| p.0), true),
            y: Axis::around("temporal variance, DN²", all.iter().map(|p| p.1), true),
            lines: lines.collect(),
        })
    };
    let data_sheet = data_sheet.map(|s| {
        json!({ "body": s.body, "iso": s.iso, "gain_dn_per_e": s.gain_dn_per_e, "dark_noise_e": s.dark_noise_e,
            "white_e": s.white_e, "dynamic_range_stops": s.dynamic_range_stops })
    });
    finish(outputs, figure, &t, &json!({ "files": files, "channels": found, "data_sheet": data_sheet }), json)
}

/// Pixels a side of the pictures that a dynamic range is measured from, and pictures of its stacks: temporal figures need no more.
const RANGE_SIDE: usize = 192;
const RANGE_STACK: usize = 4;

fn dynamic_range(body: &str, asked: Option<&List>, output: &[PathBuf], json: bool) -> anyhow::Result<()> {
    let sensor = read_body(body)?;
    let outputs = paint::prepare(output)?;
    let settings: Vec<f64> = asked.map_or_else(|| sensor.iso.iter().map(|i| i.iso).collect(), |l| l.0.clone());
    let rows = ranges(&sensor, &settings)?;
    let value: Vec<Value> = rows
        .iter()
        .map(|(iso, r)| json!({ "iso": iso, "stops": r.measured.dynamic_range.log2(), "measured": r.measured, "sheet": r.sheet }))
        .collect();
    let text = range_text(&sensor, &rows)?;
    finish(outputs, || range_figure(&sensor, &rows), &text, &json!({ "body": sensor.name, "speeds": value }), json)
}

/// The channel that sees most.
fn strongest_channel(sensor: &Sensor) -> usize {
    let most = |a: &usize, b: &usize| sensor.quantum_efficiency[*a].max().total_cmp(&sensor.quantum_efficiency[*b].max());
    (0..sensor.quantum_efficiency.len()).max_by(most).unwrap_or(0)
}

/// EMVA 1288 at several ISO speeds.
fn ranges(sensor: &Sensor, settings: &[f64]) -> anyhow::Result<Vec<(f64, emva::Report)>> {
    let channel = strongest_channel(sensor);
    let measured = |iso: &f64| {
        let conditions = Conditions { iso: *iso, channel, size: [RANGE_SIDE; 2], stack: RANGE_STACK, ..Conditions::default() };
        emva::measure(sensor, &conditions, &mut |_| Ok(())).map(|r| (*iso, r)).map_err(|e| UsageError(e.into()).into())
    };
    settings.iter().map(measured).collect()
}

fn range_text(sensor: &Sensor, rows: &[(f64, emva::Report)]) -> anyhow::Result<String> {
    let mut t = String::new();
    let channel = sensor.cfa.channel_names()[strongest_channel(sensor)];
    writeln!(t, "{}, {channel}   (EMVA 1288: saturation over the absolute sensitivity threshold)", sensor.name)?;
    writeln!(
        t,
        "  {:>8} {:>8} {:>10} {:>9} {:>13} {:>12} {:>11}",
        "ISO", "stops", "data sheet", "dB", "saturation e-", "dark e-", "SNR max dB"
    )?;
    for (iso, r) in rows {
        let m = &r.measured;
        writeln!(
            t,
            "  {iso:>8.0} {:>8.2} {:>10.2} {:>9.1} {:>13.0} {:>12.2} {:>11.1}",
            m.dynamic_range.log2(),
            r.sheet.dynamic_range.log2(),
            m.dynamic_range_db(),
            m.saturation_capacity_e,
            m.dark_noise_e,
            m.snr_max_db()
        )?;
    }
    if sensor.second_reading.is_some() {
        writeln!(t, "  the first reading alone: the second one, of less light, holds more")?;
    }
    Ok(t)
}

fn range_figure(sensor: &Sensor, rows: &[(f64, emva::Report)]) -> Figure {
    let over = |of: &dyn Fn(&emva::Report) -> f64| rows.iter().map(|(iso, r)| (iso.log2(), of(r))).collect::<Vec<_>>();
    let lines = vec![
        line("measured", 0, Style::Full, over(&|r| r.measured.dynamic_range.log2())),
        line("data sheet", 5, Style::Broken, over(&|r| r.sheet.dynamic_range.log2())),
    ];
    let all: Vec<DVec2> = lines.iter().flat_map(|l| l.points.clone()).collect();
    sheet(&Chart {
        title: format!("{}: dynamic range", sensor.name),
        x: Axis::around("ISO speed, log2", all.iter().map(|p| p.x), false),
        y: Axis::around("stops", all.iter().map(|p| p.y), true),
        lines,
    })
}

fn fall_off(asked: &MeasureThroughLens, json: bool) -> anyhow::Result<()> {
    let (lens, asked) = (asked.lens.as_deref(), &asked.chart);
    let outputs = paint::prepare(&asked.output)?;
    let (picture, plane, channel) = plane(&asked.file, asked.channel, asked.encoding)?;
    let bench = bench_beside(&asked.file, lens, &picture, &plane, illumination_by_bench)?;
    let found = vignetting::measure(&plane)?;
    let name = name_of(&asked.file);
    let text = vignetting_text(&name, channel, &found)? + &beside_bench(&bench, "", 4, |h| found.at(h))?;
    let value = json!({ "file": asked.file, "channel": channel.name(), "corner_ev": found.corner_ev(), "vignetting": found,
        "bench": points(&bench, "illumination") });
    finish(outputs, || vignetting_figure(&name, &found, &bench), &text, &value, json)
}

fn vignetting_text(name: &str, channel: Channel, found: &Vignetting) -> anyhow::Result<String> {
    let mut t = String::new();
    writeln!(t, "{name}, {}   (heights over half of the diagonal)", channel.name())?;
    writeln!(t, "  {:>7} {:>13} {:>8}", "height", "illumination", "EV")?;
    for k in 0..=10 {
        let height = f64::from(k) / 10.0;
        let light = found.at(height);
        writeln!(t, "  {height:>7.1} {light:>13.4} {:>8.3}", light.log2())?;
    }
    let [a, b, c, d] = found.corners;
    writeln!(t, "  corners: {a:.3} {b:.3} / {c:.3} {d:.3}, on average {:.2} EV darker than the middle", found.corner_ev())?;
    writeln!(t, "  the polynomial deviates from the rings by {:.2} %", 100.0 * found.residual)?;
    Ok(t)
}

fn vignetting_figure(name: &str, found: &Vignetting, bench: &[(f64, f64)]) -> Figure {
    let mut lines = vec![
        line("rings", 0, Style::Full, found.rings.iter().map(|r| (r.height, r.illumination))),
        line("polynomial", 5, Style::Broken, (0..=50).map(|k| f64::from(k) / 50.0).map(|h| (h, found.fitted(h)))),
    ];
    if !bench.is_empty() {
        lines.push(line("bench", 1, Style::Broken, bench.iter().copied()));
    }
    sheet(&Chart {
        title: format!("relative illumination, {name}"),
        x: Axis { label: "image height over half of the diagonal".into(), range: [0.0, 1.0] },
        y: Axis { label: "of the middle".into(), range: [0.0, 1.2] },
        lines,
    })
}

fn bent_lines(asked: &MeasureThroughLens, json: bool) -> anyhow::Result<()> {
    let (lens, asked) = (asked.lens.as_deref(), &asked.chart);
    let outputs = paint::prepare(&asked.output)?;
    let (picture, plane, channel) = plane(&asked.file, asked.channel, asked.encoding)?;
    let mut bench = bench_beside(&asked.file, lens, &picture, &plane, distortion_by_bench)?;
    let found = distortion::measure(&plane)?;
    bench.retain(|(h, _)| *h <= found.largest_height);
    let name = name_of(&asked.file);
    let text = distortion_text(&name, channel, &found)? + &beside_bench(&bench, " %", 3, |h| found.percent(h))?;
    let curve = points(&curve(&found), "percent");
    let beside = points(&bench, "percent");
    let value = json!({ "file": asked.file, "channel": channel.name(), "distortion": found, "curve": curve, "bench": beside });
    finish(outputs, || distortion_figure(&name, &found, &bench), &text, &value, json)
}

fn distortion_text(name: &str, channel: Channel, found: &Distortion) -> anyhow::Result<String> {
    let mut t = String::new();
    writeln!(t, "{name}, {}: {} dots   (heights over half of the diagonal)", channel.name(), found.dots.len())?;
    writeln!(t, "  {:>7} {:>13}", "height", "distortion %")?;
    let last = (10.0 * found.largest_height).floor() as u32;
    for k in 1..=last {
        let height = f64::from(k) / 10.0;
        writeln!(t, "  {height:>7.1} {:>+13.3}", found.percent(height))?;
    }
    writeln!(t, "  TV distortion {:+.3} %; dots deviate from the fit by {:.3} pixels", found.tv_percent, found.residual_px)?;
    Ok(t)
}

/// Distortion over the image height, as far as there are dots.
fn curve(found: &Distortion) -> Vec<(f64, f64)> {
    (0..=50).map(|k| found.largest_height * f64::from(k) / 50.0).map(|h| (h, found.percent(h))).collect()
}

fn distortion_figure(name: &str, found: &Distortion, bench: &[(f64, f64)]) -> Figure {
    let points = curve(found);
    let mut lines = vec![line("measured", 0, Style::Full, points.iter().copied())];
    if !bench.is_empty() {
        lines.push(line("bench", 1, Style::Broken, bench.iter().copied()));
    }
    sheet(&Chart {
        title: format!("distortion, {name}"),
        x: Axis { label: "image height over half of the diagonal".into(), range: [0.0, 1.0] },
        y: Axis::around("distortion, %", points.iter().chain(bench).map(|p| p.1), true),
        lines,
    })
}

fn differences(
    file: &Path,
    corners: Option<Corners>,
    light: &str,
    encoding: Option<Encoding>,
    output: &[PathBuf],
    json: bool,
) -> anyhow::Result<()> {
    let outputs = paint::prepare(output)?;
    let found = color::measure(&Measured::read(file, encoding)?, corners, light)?;
    let name = name_of(file);
    let text = color_text(&name, &found)?;
    let value = json!({ "file": file, "light": light, "color": found });
    finish(outputs, || color_figure(&name, &found), &text, &value, json)
}

fn color_text(name: &str, found: &ColorDifferences) -> anyhow::Result<String> {
    let mut t = String::new();
    writeln!(t, "{name}   (CIEDE2000; CIELAB of D65, brightness by the grey patches: × {:.4})", found.scale)?;
    writeln!(
        t,
        "  {:<21} {:>7} {:>7} {:>7}   {:>7} {:>7} {:>7} {:>7}",
        "patch", "L*", "a*", "b*", "L* ref", "a* ref", "b* ref", "dE00"
    )?;
    for p in &found.patches {
        let [l, a, b] = p.lab;
        let [l0, a0, b0] = p.reference;
        let difference = if p.clipped { "clipped".to_owned() } else { format!("{:.2}", p.delta_e) };
        writeln!(t, "  {:<21} {l:>7.2} {a:>7.2} {b:>7.2}   {l0:>7.2} {a0:>7.2} {b0:>7.2} {difference:>7}", p.name)?;
    }
    writeln!(t, "  mean {:.2}, largest {:.2}", found.mean, found.largest)?;
    Ok(t)
}

fn color_figure(name: &str, found: &ColorDifferences) -> Figure {
    // From the reference to what was measured, seen along L*.
    let lines = found.patches.iter().filter(|p| !p.clipped).flat_map(|p| {
        let [from, to] = [p.reference, p.lab].map(|lab| (lab[1], lab[2]));
        [line("", 5, Style::Full, [from, to]), line("", 0, Style::Dots, [to]), line("", 1, Style::Dots, [from])]
    });
    sheet(&Chart {
        title: format!("colour, {name}: CIEDE2000 {:.2} on average, {:.2} at most", found.mean, found.largest),
        x: Axis { label: "a* (blue: reference, red: measured)".into(), range: [-70.0, 70.0] },
        y: Axis { label: "b*".into(), range: [-70.0, 100.0] },
        lines: lines.collect(),
    })
}

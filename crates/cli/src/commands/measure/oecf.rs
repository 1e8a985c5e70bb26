//! `measure oecf`: the response of a camera to light, its noise and its dynamic range, from a step wedge.

use super::super::named_once;
use super::{finish, line, name_of, sheet};
use crate::args::MeasureOecf;
use crate::paint;
use diopter::lens::draw::{Axis, Chart, Figure, Style};
use diopter::measure::oecf::{Response, measure};
use diopter::measure::{Channel, MeasureError, Measured};
use serde_json::json;
use std::fmt::Write as _;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(asked: &MeasureOecf, json: bool) -> anyhow::Result<()> {
    named_once(&asked.files)?;
    let outputs = paint::prepare(&asked.output)?;
    let encoding = asked.encoding.decoded();
    let pictures = asked.files.iter().map(|f| Measured::read(f, encoding)).collect::<Result<Vec<_>, MeasureError>>()?;
    let channels: Vec<Channel> = match (asked.channel, &pictures[0]) {
        (Some(one), _) => vec![one.measured()],
        (None, Measured::Raw(raw)) if !raw.header.cfa.is_monochrome() => vec![Channel::Red, Channel::Green, Channel::Blue],
        (None, picture) => vec![picture.usual_channel()],
    };
    let flat = asked.flat.as_deref().map(|f| Measured::read(f, encoding)).transpose()?;
    let densities = asked.densities.as_ref().map(|l| &l.0[..]);
    let found = channels
        .into_iter()
        .map(|channel| {
            measure(&pictures, channel, asked.corners, [asked.grid.width, asked.grid.height], densities, flat.as_ref())
        })
        .collect::<Result<Vec<Response>, _>>()?;
    let name = name_of(&asked.files[0]);
    let text = text(&name, pictures.len(), &found)?;
    let value = json!({ "files": asked.files, "channels": found });
    finish(outputs, || figure(&name, &found), &text, &value, json)
}

pub(super) fn text(name: &str, pictures: usize, found: &[Response]) -> anyhow::Result<String> {
    let mut t = String::new();
    let noise = if pictures > 1 { "temporal noise" } else { "total noise: two pictures would tell temporal noise apart" };
    writeln!(t, "{name}, {pictures} picture{}   (OECF, ISO 14524 and 15739; {noise})", if pictures == 1 { "" } else { "s" })?;
    let number = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    writeln!(t, "  {:<10} {:>7} {:>18} {:>16} {:>8}", "channel", "gamma", "white at density", "noise at density", "stops")?;
    for r in found {
        let (white, dark) = (number(r.saturation_density, 3), number(r.noise_density, 3));
        let (gamma, stops) = (number(r.gamma, 3), number(r.dynamic_range_stops, 2));
        writeln!(t, "  {:<10} {gamma:>7} {white:>18} {dark:>16} {stops:>8}", r.channel)?;
    }
    for r in found {
        writeln!(
            t,
            "  {:<10} {:>8} {:>11} {:>12} {:>12} {:>8}",
            r.channel, "density", "signal", "total noise", "temporal", "SNR dB"
        )?;
        for f in &r.fields {
            let snr = match (f.saturated, f.snr > 1e-3) {
                (true, _) => "clipped".to_owned(),
                (false, true) => format!("{:.2}", 20.0 * f.snr.log10()),
                (false, false) => if f.clipped_to_black { "black" } else { "-" }.to_owned(),
            };
            let temporal = f.temporal_noise.map_or("-".to_owned(), |v| format!("{v:.6}"));
            writeln!(t, "  {:<10} {:>8.3} {:>11.6} {:>12.6} {temporal:>12} {snr:>8}", "", f.density, f.signal, f.total_noise)?;
        }
    }
    if found.iter().all(|r| r.dynamic_range_stops.is_none()) {
        writeln!(t, "  no dynamic range: it wants a field near white that is not clipped, and one below its noise")?;
    }
    Ok(t)
}

pub(super) fn figure(name: &str, found: &[Response]) -> Figure {
    // Below a thousandth of a percent there is nothing to be seen.
    let log = |v: f64| v.max(1e-5).log10();
    let lines = found.iter().flat_map(|r| {
        let k = ["red", "blue", "green"].iter().position(|c| *c == r.channel).unwrap_or(super::COLORS.len() - 1);
        let points = |value: fn(&diopter::measure::oecf::Field) -> f64| {
            r.fields.iter().map(move |f| (-f.density, value(f).max(1e-5).log10()))
        };
        let noise = line("", k, Style::Broken, points(|f| f.temporal_noise.unwrap_or(f.total_noise)));
        [line(format!("{} (broken: noise)", r.channel), k, Style::Full, points(|f| f.signal)), noise]
    });
    let densities = || found.iter().flat_map(|r| &r.fields).map(|f| -f.density);
    // Room for the names above white.
    let values = found.iter().flat_map(|r| &r.fields).flat_map(|f| [log(f.signal), log(f.total_noise)]).chain([0.9]);
    let stops: Vec<String> = found.iter().filter_map(|r| Some(format!("{:.1}", r.dynamic_range_stops?))).collect();
    let range = if stops.is_empty() { String::new() } else { format!(", {} stops", stops.join(", ")) };
    sheet(&Chart {
        title: format!("tone response, {name}{range}"),
        x: Axis::around("log light relative to the clear field", densities(), false),
        y: Axis::around("log output relative to white", values, false),
        lines: lines.collect(),
    })
}

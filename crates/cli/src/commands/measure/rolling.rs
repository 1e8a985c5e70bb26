//! `measure rolling`: how fast a shutter reads, and which way.

use super::{finish, line, name_of, sheet};
use crate::UsageError;
use crate::args::MeasureRolling;
use crate::paint;
use anyhow::anyhow;
use diopter::image::ShutterFacts;
use diopter::lens::draw::{Axis, Chart, Figure, Style};
use diopter::measure::rolling::{Rolling, Sign, measure};
use diopter::measure::{Channel, Measured};
use serde_json::json;
use std::fmt::Write as _;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(asked: &MeasureRolling, json: bool) -> anyhow::Result<()> {
    let sign = match (asked.flicker, asked.speed) {
        (Some(hz), _) if hz > 0.0 && hz < 1e9 => Sign::Flicker(hz),
        (Some(hz), _) => {
            return Err(UsageError(anyhow!("--flicker {hz}: expected the frequency of the light in Hz, such as 100")).into());
        }
        (None, Some(speed)) if speed != [0.0; 2] && speed.iter().all(|v| v.abs() < 1e9) => Sign::Motion(speed),
        (None, Some([x, y])) => {
            let wrong = anyhow!("--speed {x},{y}: expected pixels a second to the right and downwards, not both 0");
            return Err(UsageError(wrong).into());
        }
        (None, None) => return Err(UsageError(anyhow!("measure rolling: expected --flicker HZ or --speed X,Y")).into()),
    };
    let chart = &asked.chart;
    let outputs = paint::prepare(&chart.output)?;
    let picture = Measured::read(&chart.file, chart.encoding.decoded())?;
    let channel = chart.channel.map_or_else(|| picture.usual_channel(), super::MeasuredChannel::measured);
    if let Some(shutter) = picture.facts().and_then(|f| f.shutter.as_ref()) {
        check_shutter(shutter, sign).map_err(|told| anyhow!("{}: {told}", chart.file.display()))?;
    }
    let found = measure(&picture.plane(channel)?, sign)?;
    let told = picture.facts().and_then(|f| f.shutter.as_ref()).map(|s| told_readout(s, &found));
    let name = name_of(&chart.file);
    let text = text(&name, channel, &found, told)?;
    let value = json!({ "file": chart.file, "channel": channel.name(), "rolling": found, "readout_of_file_s": told });
    finish(outputs, || figure(&name, &found), &text, &value, json)
}

/// How near to whole periods an exposure may be before its bands are too faint, of a period.
const NEAR_WHOLE: f64 = 0.02;

/// Whether a picture by a shutter can show what is looked for; what the user is told where it cannot.
fn check_shutter(shutter: &ShutterFacts, sign: Sign) -> Result<(), String> {
    if shutter.rows.open_s[1] == 0.0 && shutter.rows.close_s[1] == 0.0 {
        let kind = &shutter.kind;
        return Err(format!(
            "its shutter ({kind}) opens and closes everywhere at once; expected a picture whose rows or columns are read one after the other"
        ));
    }
    if let Sign::Flicker(hz) = sign {
        let periods = shutter.effective_s * hz;
        if periods > 0.5 && (periods - periods.round()).abs() < NEAR_WHOLE {
            return Err(format!(
                "it was exposed for {:.3} ms, {periods:.2} periods of light of {hz} Hz, over which bands cancel out; expected another time, best less than half a period",
                1e3 * shutter.effective_s
            ));
        }
    }
    Ok(())
}

/// What was found, and what the file says.
pub(super) fn text(name: &str, channel: Channel, found: &Rolling, told: Option<f64>) -> anyhow::Result<String> {
    let mut t = String::new();
    writeln!(t, "{name}, {}   (read line by line)", channel.name())?;
    let kind = if found.columns { "column" } else { "row" };
    writeln!(
        t,
        "  line time   {:>10.3} µs ± {:.3} µs from {kind} to {kind}",
        1e6 * found.line_time_s,
        1e6 * found.line_time_error_s
    )?;
    writeln!(t, "  read-out    {:>10.3} ms for {} {kind}s", 1e3 * found.readout_s, found.lines)?;
    match (found.direction, found.columns) {
        (Some(direction), _) => writeln!(t, "  direction   {direction:>10}")?,
        (None, false) => writeln!(t, "  direction   down or up: a lamp does not tell which")?,
        (None, true) => writeln!(t, "  direction   right or left: a lamp does not tell which")?,
    }
    if let (Some(period), Some(amplitude)) = (found.period_lines, found.amplitude) {
        writeln!(t, "  bands       {period:>10.2} {kind}s apart, ± {:.1} % of their mean", 100.0 * amplitude)?;
    }
    if let Some(lean) = found.lean_px {
        writeln!(t, "  lean        {lean:>+10.2} pixels from the first {kind} to the last")?;
    }
    if let Some(told) = told {
        writeln!(t, "  the file says {:.3} ms: {:+.2} %", 1e3 * told, 100.0 * (found.readout_s / told - 1.0))?;
    }
    Ok(t)
}

/// Read-out of all lines that a file says, s; 0 of a shutter that closes everywhere at once.
pub(super) fn told_readout(shutter: &ShutterFacts, found: &Rolling) -> f64 {
    shutter.rows.close_s[1].abs() * found.lines as f64
}

pub(super) fn figure(name: &str, found: &Rolling) -> Figure {
    let fitted = found.points.iter().zip(&found.fitted).map(|(p, v)| (p.0, *v));
    let values = || found.points.iter().map(|p| p.1);
    let what = if found.lean_px.is_some() { "place of the bar, pixels" } else { "mean of the line, over the fall-off" };
    let kind = if found.columns { "column" } else { "row" };
    sheet(&Chart {
        title: format!("rolling shutter, {name}: {:.2} ms for {} {kind}s", 1e3 * found.readout_s, found.lines),
        x: Axis { label: kind.into(), range: [0.0, found.lines as f64] },
        y: Axis::around(what, values(), false),
        lines: vec![line("measured", 0, Style::Dots, found.points.iter().copied()), line("fit", 1, Style::Full, fitted)],
    })
}

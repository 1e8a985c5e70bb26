//! `calc shutter`: when which part of the picture is open, as a table and as the shutter itself in slow motion.
//!
//! Everything is asked of the shutter that exposures use ([`Shutter::window`]), strip by strip of the picture, or ring by ring of the pupil.

use super::exposure::positive;
use crate::UsageError;
use crate::args::ShutterArgs;
use crate::commands::print_json;
use crate::paint;
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::draw::{Anchor, Color, Figure, INK, Item};
use diopter::shutter::{Direction, Mechanism, Place, RAMP_S, READOUT_S, Shutter, TRAVEL_S};
use glam::DVec2;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::io::Write as _;

/// Strips of the picture (or rings of the pupil) that are asked.
const STRIPS: usize = 120;
/// Lines of the table.
const ROWS: usize = 5;
/// Moments that are drawn, and how many beside each other.
const MOMENTS: usize = 12;
const BESIDE: usize = 6;

/// Not yet open, open, closed again.
const COLORS: [Color; 3] = [[70, 74, 82], [255, 226, 150], [120, 80, 70]];

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &ShutterArgs, json: bool) -> anyhow::Result<()> {
    let exposure_s = positive("time", args.time.0)?;
    let outputs = paint::prepare(&args.output)?;
    let wrong =
        |what: &str, found: &str, expected: String| Err(UsageError(anyhow!("{what} \"{found}\": expected {expected}")).into());
    let Some((_, direction)) = Direction::NAMES.into_iter().find(|d| d.0 == args.shutter_direction) else {
        let all = Direction::NAMES.map(|d| d.0).join(", ");
        return wrong("--shutter-direction", &args.shutter_direction, format!("one of {all}"));
    };
    let travel = |usual: f64| args.travel.map_or(Ok(usual), |t| positive("travel", t.0));
    let mechanism = match args.shutter_type.as_str() {
        "global" if args.travel.is_some() => {
            return wrong(
                "--travel",
                "global",
                "focal-plane, rolling or leaf beside it: a global shutter has no time of its own".into(),
            );
        }
        "global" => Mechanism::Global,
        "leaf" => Mechanism::Leaf { ramp_s: travel(RAMP_S)? },
        "focal-plane" => Mechanism::FocalPlane { travel_s: travel(TRAVEL_S)?, direction },
        "rolling" => {
            let readout_s = travel(READOUT_S)?;
            Mechanism::Rolling { reset_s: readout_s, readout_s, direction }
        }
        other => return wrong("--shutter-type", other, "one of global, leaf, focal-plane, rolling".into()),
    };
    let shutter = Shutter { mechanism, exposure_s };
    if !outputs.is_empty() {
        for path in paint::write(outputs, &figure(&shutter, direction))? {
            say(&format!("wrote {}", path.display()));
        }
    }
    let kind = shutter.facts([STRIPS; 2], 1.0).kind;
    let fraction = |k: usize| k as f64 / (ROWS - 1) as f64;
    let rows: Vec<(f64, (f64, f64))> =
        (0..ROWS).map(|k| (fraction(k), shutter.window(&place(&shutter, direction, fraction(k))))).collect();
    if json {
        let rows: Vec<_> = rows
            .iter()
            .map(|(at, (open, close))| match close > open {
                true => serde_json::json!({ "at": at, "open_s": open, "close_s": close, "s": close - open }),
                false => serde_json::json!({ "at": at, "open_s": null, "close_s": null, "s": 0.0 }),
            })
            .collect();
        return print_json(&serde_json::json!({
            "kind": kind, "exposure_s": exposure_s, "total_s": shutter.total_s(), "fully_open_s": shutter.fully_open().map(|(a, b)| [a, b]),
            "slit": slit(&shutter), "rows": rows,
        }));
    }
    let mut text = String::new();
    writeln!(text, "{kind}, {}: from the first light to the last {}", args.time, time(shutter.total_s()))?;
    match (shutter.fully_open(), slit(&shutter)) {
        (Some((from, to)), _) => {
            writeln!(text, "the whole picture is open for {}: a flash of that time lights all of it", time(to - from))?
        }
        (None, Some(slit)) => {
            writeln!(text, "never open as a whole: a slit of {:.1} % of the picture runs over it", 100.0 * slit)?
        }
        (None, None) => writeln!(text, "never open as a whole")?,
    }
    let what = if matches!(mechanism, Mechanism::Leaf { .. }) { "pupil" } else { "way" };
    writeln!(text, "{what:>8} {:>12} {:>12} {:>12}", "opens", "closes", "open for")?;
    for (at, (open, close)) in rows {
        // A leaf that turns back before it is there.
        let [opens, closes, long] = match close > open {
            true => [time(open), time(close), time(close - open)],
            false => ["never".into(), "-".into(), time(0.0)],
        };
        writeln!(text, "{:>6.0} % {opens:>12} {closes:>12} {long:>12}", 100.0 * at)?;
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

fn time(s: f64) -> String {
    if s >= 0.1 { format!("{s:.4} s") } else { format!("{:.4} ms", 1e3 * s) }
}

/// Width of the slit between the curtains (or between reset and read-out), of the picture, where it does not open as a whole.
fn slit(shutter: &Shutter) -> Option<f64> {
    let travel = match shutter.mechanism {
        Mechanism::FocalPlane { travel_s, .. } => travel_s,
        Mechanism::Rolling { reset_s, .. } => reset_s,
        _ => return None,
    };
    (travel > shutter.exposure_s).then(|| shutter.exposure_s / travel)
}

/// The place a fraction along the way that the shutter runs; of a leaf shutter from the middle of the pupil to its rim.
fn place(shutter: &Shutter, direction: Direction, along: f64) -> Place {
    // Strips are many: their middles are as good as their places.
    const LINES: usize = 100_000;
    let line = ((along * LINES as f64) as usize).min(LINES - 1);
    let turned = if matches!(direction, Direction::Up | Direction::Left) { LINES - 1 - line } else { line };
    let pixel = if direction.is_vertical() { [0, turned] } else { [turned, 0] };
    let pupil = if matches!(shutter.mechanism, Mechanism::Leaf { .. }) { along } else { 0.0 };
    Place { pixel, size: [LINES; 2], pupil }
}

/// 0 before a place opens, 1 while it is open, 2 after.
fn state(shutter: &Shutter, direction: Direction, along: f64, now: f64) -> usize {
    let (open, close) = shutter.window(&place(shutter, direction, along));
    // A leaf that never clears a ring covers it all the time.
    if now < open || close <= open { 0 } else { usize::from(now >= close) + 1 }
}

/// The shutter at moments from before the first light to after the last, and below, place over time.
fn figure(shutter: &Shutter, direction: Direction) -> Figure {
    const CELL: DVec2 = DVec2::new(104.0, 92.0);
    const FRAME: DVec2 = DVec2::new(90.0, 60.0);
    const PLOT: DVec2 = DVec2::new(540.0, 150.0);
    let rows = MOMENTS.div_ceil(BESIDE);
    let mut f = Figure::new(BESIDE as f64 * CELL.x + 24.0, rows as f64 * CELL.y + PLOT.y + 96.0);
    let kind = shutter.facts([STRIPS; 2], 1.0).kind;
    let total = shutter.total_s();
    let title = format!("{kind} shutter, {}: {} from the first light to the last", time(shutter.exposure_s), time(total));
    f.text(DVec2::new(0.5 * f.width, 18.0), title, 11.0, Anchor::Middle);
    let leaf = matches!(shutter.mechanism, Mechanism::Leaf { .. });
    let rectangle = |f: &mut Figure, corner: DVec2, size: DVec2, color: Color| {
        let points = vec![corner, corner + DVec2::X * size.x, corner + size, corner + DVec2::Y * size.y, corner];
        f.items.push(Item::Path { points, color, width: 0.0, dash: 0.0, fill: Some((color, 1.0)) });
    };
    for k in 0..MOMENTS {
        // The first and the last just outside: all closed.
        let now = total * (k as f64 / (MOMENTS - 1) as f64 * 1.04 - 0.02);
        let corner = DVec2::new(12.0 + (k % BESIDE) as f64 * CELL.x + 7.0, 30.0 + (k / BESIDE) as f64 * CELL.y);
        if leaf {
            let (middle, rim) = (corner + 0.5 * FRAME, 0.48 * FRAME.y);
            let disk = |radius: f64| {
                (0..=72).map(move |i| middle + DVec2::from_angle(TAU * f64::from(i) / 72.0) * radius).collect::<Vec<_>>()
            };
            for ring in (0..STRIPS).rev() {
                let state = state(shutter, direction, (ring as f64 + 0.5) / STRIPS as f64, now);
                let color = COLORS[if state == 1 { 1 } else { 0 }];
                let radius = rim * (ring + 1) as f64 / STRIPS as f64;
                f.items.push(Item::Path { points: disk(radius), color, width: 0.0, dash: 0.0, fill: Some((color, 1.0)) });
            }
            f.line(disk(rim), INK, 0.8, 0.0);
        } else {
            // Neighbours of one state are one rectangle.
            let mut from = 0;
            let at = |i: usize| state(shutter, direction, (i as f64 + 0.5) / STRIPS as f64, now);
            for i in 1..=STRIPS {
                if i < STRIPS && at(i) == at(from) {
                    continue;
                }
                let [a, b] = [from, i].map(|i| i as f64 / STRIPS as f64);
                let (start, size) = match direction {
                    Direction::Down => (DVec2::new(0.0, a), DVec2::new(1.0, b - a)),
                    Direction::Up => (DVec2::new(0.0, 1.0 - b), DVec2::new(1.0, b - a)),
                    Direction::Right => (DVec2::new(a, 0.0), DVec2::new(b - a, 1.0)),
                    Direction::Left => (DVec2::new(1.0 - b, 0.0), DVec2::new(b - a, 1.0)),
                };
                rectangle(&mut f, corner + start * FRAME, size * FRAME, COLORS[at(from)]);
                from = i;
            }
            let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y, DVec2::ZERO].map(|c| corner + c * FRAME);
            f.line(corners, INK, 0.8, 0.0);
        }
        let label = corner + DVec2::new(0.5 * FRAME.x, FRAME.y + 14.0);
        f.text(label, time(now), 8.5, Anchor::Middle);
    }
    // Place over time: where it is open.
    let corner = DVec2::new(58.0, 44.0 + rows as f64 * CELL.y);
    let at = |t: f64, along: f64| corner + DVec2::new((t / total * 0.96 + 0.02) * PLOT.x, along * PLOT.y);
    rectangle(&mut f, corner, PLOT, [238, 238, 238]);
    let windows: Vec<(f64, (f64, f64))> = (0..=STRIPS)
        .map(|i| (i as f64 / STRIPS as f64, shutter.window(&place(shutter, direction, i as f64 / STRIPS as f64))))
        .filter(|(_, (open, close))| close > open)
        .collect();
    let open = windows.iter().map(|(along, w)| at(w.0, *along));
    let close = windows.iter().rev().map(|(along, w)| at(w.1, *along));
    let points: Vec<DVec2> = open.chain(close).collect();
    f.items.push(Item::Path { points, color: INK, width: 0.6, dash: 0.0, fill: Some((COLORS[1], 1.0)) });
    for k in 0..=4 {
        let t = total * f64::from(k) / 4.0;
        let foot = at(t, 1.0);
        f.line([foot, foot + DVec2::new(0.0, 4.0)], INK, 0.8, 0.0);
        f.text(foot + DVec2::new(0.0, 15.0), time(t), 8.5, Anchor::Middle);
    }
    let ends = if leaf { ["middle", "rim"] } else { ["first", "last"] };
    f.text(corner + DVec2::new(-6.0, 8.0), ends[0], 8.5, Anchor::End);
    f.text(corner + DVec2::new(-6.0, PLOT.y), ends[1], 8.5, Anchor::End);
    let what = if leaf {
        "place in the pupil (down) over time: bright where light passes"
    } else {
        "lines of the picture (down) over time: bright where they are exposed"
    };
    f.text(corner + DVec2::new(0.5 * PLOT.x, PLOT.y + 32.0), what, 9.0, Anchor::Middle);
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slit_runs_over_the_picture_where_curtains_are_slower_than_the_time() {
        let mechanism = Mechanism::FocalPlane { travel_s: 4e-3, direction: Direction::Up };
        let shutter = Shutter { mechanism, exposure_s: 1e-3 };
        assert_eq!(slit(&shutter), Some(0.25));
        // Halfway: the second curtain is a quarter of the picture behind the first.
        let states: Vec<usize> = [0.1, 0.3, 0.45, 0.6].iter().map(|a| state(&shutter, Direction::Up, *a, 2e-3)).collect();
        assert_eq!(states, [2, 1, 1, 0]);
        assert_eq!(slit(&Shutter { exposure_s: 5e-3, ..shutter }), None);
        // Blades clear the middle first and the rim last.
        let leaf = Shutter { mechanism: Mechanism::Leaf { ramp_s: 1e-3 }, exposure_s: 2e-3 };
        assert_eq!([0.2, 0.9].map(|a| state(&leaf, Direction::Down, a, 0.5e-3)), [1, 0]);
    }

    #[test]
    fn every_moment_is_drawn() {
        let shutter =
            Shutter { mechanism: Mechanism::FocalPlane { travel_s: 4e-3, direction: Direction::Down }, exposure_s: 1e-3 };
        let f = figure(&shutter, Direction::Down);
        let bright = f.items.iter().filter(|i| matches!(i, Item::Path { fill: Some((c, _)), .. } if *c == COLORS[1])).count();
        // All but the first and the last, and the plot.
        assert_eq!(bright, MOMENTS - 2 + 1);
        assert!(f.items.iter().all(|i| !matches!(i, Item::Path { points, .. } if points.iter().any(|p| !p.is_finite()))));
    }
}

//! `calc daylight`: where the sun is and how bright it makes a level ground.

use crate::UsageError;
use crate::args::DaylightArgs;
use crate::commands::print_json;
use anyhow::anyhow;
use diopter::metering::ev100_of_luminance;
use diopter::quantity::Moment;
use diopter::shot::daylight;
use diopter::shot::sections::DaylightSection;
use std::io::Write;

/// Reflectance of a grey card.
const GREY: f64 = 0.18;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &DaylightArgs, json: bool) -> anyhow::Result<()> {
    if args.hours && args.sun.is_some() {
        let expected = "expected the moment from which on they are shown: --time 2026-06-21T00:00+02:00 --place 48,11";
        return Err(UsageError(anyhow!("hours of a sun that stands still (--sun): {expected}")).into());
    }
    let section = |time: Option<Moment>| DaylightSection {
        sun: args.sun,
        time,
        place: args.place,
        turbidity: args.turbidity,
        ..Default::default()
    };
    let rows = |times: Vec<Option<Moment>>| -> anyhow::Result<Vec<_>> {
        let row = |t: Option<Moment>| {
            let day = daylight(&section(t))?;
            Ok((t, day.sun, day.illuminance()))
        };
        times.into_iter().map(row).collect()
    };
    let rows = match (args.time, args.hours) {
        // A day, hour by hour.
        (Some(Moment(days)), true) => rows((0..24).map(|h| Some(Moment(days + f64::from(h) / 24.0))).collect())?,
        (time, _) => rows(vec![time])?,
    };
    // A grey card lying on the ground.
    let ev = |lux: f64| ev100_of_luminance(lux * GREY / std::f64::consts::PI);
    if json {
        let all: Vec<_> = rows
            .iter()
            .map(|(time, sun, [direct, sky])| {
                serde_json::json!({
                    "time": time.map(|t| t.to_string()),
                    "elevation_deg": sun.elevation.to_degrees(), "azimuth_deg": sun.azimuth.to_degrees(), "distance_au": sun.distance_au,
                    "sun_lx": direct, "sky_lx": sky, "global_lx": direct + sky, "ev100_of_grey_card": ev(direct + sky),
                })
            })
            .collect();
        return print_json(&serde_json::json!(all));
    }
    let mut out = std::io::stdout();
    writeln!(
        out,
        "{:<21} {:>9} {:>8} {:>9} {:>8} {:>9} {:>6}",
        "universal time", "elevation", "azimuth", "sun lx", "sky lx", "both lx", "EV"
    )?;
    for (time, sun, [direct, sky]) in rows {
        let time = time.map_or("-".into(), |t| t.to_string());
        writeln!(
            out,
            "{time:<21} {:>8.2}° {:>7.2}° {direct:>9.0} {sky:>8.4$} {:>9.4$} {:>6.1}",
            sun.elevation.to_degrees(),
            sun.azimuth.to_degrees(),
            direct + sky,
            ev(direct + sky),
            if direct + sky < 10.0 { 3 } else { 0 },
        )?;
    }
    writeln!(out, "on level ground under a clear sky; EV: of a grey card (18 %) lying there, ISO 100")?;
    Ok(())
}

//! `events`: what an event sensor sees of a scene.

use super::print_json;
use crate::UsageError;
use crate::args::EventsArgs;
use crate::output::{Output, distinct};
use crate::watch::{self, say, warn, watched};
use anyhow::anyhow;
use diopter::event_file::EventFormat;
use diopter::events::{EventFilm, read_event_sensor, take};
use std::io::Write;
use std::path::Path;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &EventsArgs, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let file = args.taking.shot_file()?;
    let sensor = read_event_sensor(&args.sensor)?;
    let size = file.render.size.map_or(sensor.light.pixels, |s| [s.width, s.height]);
    let formats = args
        .output
        .iter()
        .map(|path| {
            let format = EventFormat::of(path).ok_or_else(|| {
                UsageError(anyhow!("{}: expected a name that ends in .npy, .csv or .raw (EVT 2.0)", path.display()))
            })?;
            format.holds(size, args.duration.0).map_err(|e| UsageError(anyhow!("{}: {e}", path.display())))?;
            Ok(format)
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    distinct(args.taking.subject.as_deref().map(Path::new), args.output.iter().chain(&args.keep_light).map(|p| p.as_path()))?;
    let outputs = args.output.iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<Vec<_>>>()?;
    if let Some(path) = args.keep_light.as_deref().filter(|p| !p.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy"))) {
        return Err(UsageError(anyhow!("--keep-light {}: expected a name that ends in .npy", path.display())).into());
    }
    let light_file = args.keep_light.as_deref().map(Output::prepare).transpose()?;
    let film = EventFilm {
        sensor,
        duration_s: args.duration.0,
        step_s: args.step.0,
        most_change: args.most_change,
        seed: file.render.seed.unwrap_or(1),
        keep_light: light_file.is_some(),
    };
    let taken = watched("events", |w| take(&file, &film, w, &mut warn))?;
    let on = taken.events.iter().filter(|e| e.on).count();
    let off = taken.events.len() - on;
    let mut written = Vec::new();
    for (format, output) in formats.into_iter().zip(outputs) {
        let bytes = format.bytes(&taken.events, taken.size, taken.begun_s);
        let path = output.commit(|to| Ok(to.write_all(&bytes)?))?;
        say(&format!("wrote {}", path.display()));
        written.push(path);
    }
    if let (Some(output), Some(light)) = (light_file, &taken.light) {
        let path = output.commit(|to| Ok(to.write_all(&light.npy(taken.size))?))?;
        say(&format!("wrote {}", path.display()));
        written.push(path);
    }
    let rate = taken.events.len() as f64 / film.duration_s / (taken.size[0] * taken.size[1]) as f64;
    say(&format!(
        "{}   {} x {} pixels   {on} ON, {off} OFF   {rate:.2} events a second and pixel   {} moments",
        film.sensor.name, taken.size[0], taken.size[1], taken.moments
    ));
    if json {
        print_json(&serde_json::json!({
            "files": written, "sensor": film.sensor.name, "size": taken.size, "on": on, "off": off, "moments": taken.moments,
            "times_s": taken.light.as_ref().map(|l| &l.times_s),
            "begun_s": taken.begun_s, "duration_s": film.duration_s, "mean_current_e_s": taken.mean_current_e_s,
        }))?;
    }
    Ok(())
}

//! `shoot`: the whole photograph.

use super::print_json;
use crate::args::Shoot;
use crate::output::{self, Format, Output};
use crate::watch::{say, warn, watched};
use diopter::image::ExposureFacts;
use diopter::metering::ev100_of_setting;
use diopter::quantity::{FNumber, Seconds};
use diopter::sensor::ReadOut;
use diopter::shot::Shot;
use diopter::truth;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub fn run(args: &Shoot, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut file = args.taking.shot_file()?;
    args.developing.apply(&mut file.develop)?;
    if args.raw.serial.is_some() {
        file.camera.serial.clone_from(&args.raw.serial);
    }
    if args.raw.temperature.is_some() {
        file.exposure.temperature_c = args.raw.temperature;
    }
    if !args.output.is_empty() {
        file.output.files.clone_from(&args.output);
    }
    if file.output.files.is_empty() {
        file.output.files.push(PathBuf::from("photo.jpg"));
    }
    // Whether the results can be written is known before the work, not after.
    let beside = [&args.truth, &args.keep_plane, &args.save_shot].into_iter().flatten();
    let subject = args.taking.subject.as_deref().map(Path::new);
    output::distinct(subject, file.output.files.iter().chain(beside).map(|p| p.as_path()))?;
    let pictures = output::prepare_pictures(&file.output.files)?;
    let plane_file = args.keep_plane.as_deref().map(output::prepare_exr).transpose()?;
    let truth_file = args.truth.as_deref().map(output::prepare_exr).transpose()?;
    let shot_file = args.save_shot.as_deref().map(Output::prepare).transpose()?;

    let mut shot = Shot::prepare(&file, &mut warn)?;
    shot.date = Some(output::now());
    watched("metering", |w| shot.meter(w))?;
    let prepared = started.elapsed().as_secs_f64();
    let plane = watched("exposing", |w| shot.expose(w))?;
    let exposed = started.elapsed().as_secs_f64();
    let raw = shot.read_out(&plane)?;

    if let Some(output) = shot_file {
        use std::io::Write;
        // What was run: also what had been left open, and by paths that hold wherever the shot file lies.
        file.make_paths_absolute();
        file.exposure.shutter = shot.shutter.map(Seconds);
        output.commit(|to| Ok(to.write_all(file.to_toml().as_bytes())?))?;
    }
    let mut written = Vec::new();
    if let Some(output) = plane_file {
        written.push(output::write_plane(output, &plane)?);
    }
    if let Some(output) = truth_file {
        let size = [plane.width(), plane.height()];
        let reader = ReadOut::new(&shot.sensor, &shot.reading, size, &plane.bands, plane.facts.exposure_s)?;
        written.push(output.commit(|to| Ok(truth::write(&plane, &reader, &raw, to)?))?);
    }
    written.extend(output::write_pictures(
        pictures,
        &raw,
        &shot.recipe,
        shot.lut.as_ref(),
        Format { storage: args.raw.storage(), ..Format::default() },
    )?);

    let facts = raw.header.facts.clone();
    say(&display(&facts, plane.width(), plane.height(), exposed - prepared));
    for path in &written {
        say(&format!("wrote {}", path.display()));
    }
    if json {
        print_json(&serde_json::json!({
            "files": written,
            "facts": facts,
            "size": [plane.width(), plane.height()],
            "prepare_s": prepared,
            "expose_s": exposed - prepared,
            "total_s": started.elapsed().as_secs_f64(),
        }))?;
    }
    Ok(())
}

/// What a camera shows after the shot.
pub fn display(f: &ExposureFacts, width: usize, height: usize, seconds: f64) -> String {
    let time = if f.exposure_s < 0.3 { format!("1/{:.0} s", 1.0 / f.exposure_s) } else { format!("{:.1} s", f.exposure_s) };
    let focus = f.focus_distance_m.map_or("∞".to_owned(), |d| format!("{d:.2} m"));
    let meter = match f.metered_ev100 {
        None => "no light metered".to_owned(),
        Some(ev) => {
            let off = ev - ev100_of_setting(f.f_number, f.exposure_s, if f.iso > 0.0 { f.iso } else { 100.0 });
            format!("scene EV {ev:.1}, exposure {off:+.1} EV")
        }
    };
    let scaled = if f.light_scale == 1.0 { String::new() } else { format!("   light × {:.3e}", f.light_scale) };
    format!(
        "{}   {}   {}\n{time}   {}   ISO {:.0}   {:.0} mm ({:.0} mm equiv.)   focus {focus}\n{meter}{scaled}   {width}×{height}, {} samples a pixel, {seconds:.1} s",
        f.body,
        f.lens,
        f.scene,
        FNumber((f.f_number * 100.0).round() / 100.0),
        f.iso,
        f.focal_length_mm,
        f.focal_length_35mm_mm,
        f.samples
    )
}

//! `shoot`: the whole photograph, or a sequence of them.

use super::exposure_summary::{display, say_ambient, setting};
use super::series_calibration::SeriesCalibration;
use super::{PlaneFile, print_json, read_raw, stack};
use crate::args::Shoot;
use crate::checkpoint;
use crate::effect;
use crate::memory;
use crate::output::{self, Format, Kind, Output};
use crate::paint;
use crate::watch::{self, say, warn, watched};
use crate::{Stopped, UsageError};
use anyhow::anyhow;
use diopter::calibration::Format as CalibrationFormat;
use diopter::focus::Report;
use diopter::hdr;
use diopter::image::focal_plane::FocalPlaneSource;
use diopter::image::{ExposureFacts, RawImage};
use diopter::lens::draw::{Axis, Chart, Color, Figure, Line, Style};
use diopter::sensor::{ColorSampling, ReadOut};
use diopter::shot::setting::Setting;
use diopter::shot::{ExposureUse, FireflyChoice, Sequence, Shot};
use diopter::truth;
use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Refuses options that nothing of what is written shows.
fn check_effects(args: &Shoot, written: &[&PathBuf]) -> anyhow::Result<()> {
    // Calibrations are no pictures.
    let kinds: Vec<Kind> = written.iter().filter_map(|p| output::kind(p).ok()).collect();
    effect::check(args.raw.typed_of_files(), &kinds)?;
    // A saved shot keeps what was typed.
    if args.save_shot.is_some() {
        return Ok(());
    }
    effect::check(args.developing.typed(), &kinds)?;
    match &args.taking.said.render.truth_channels {
        Some(names) if args.truth.is_none() && args.keep_plane.is_none() => Err(UsageError(anyhow!(
            "--truth-channels {names}: expected --truth or --keep-plane beside it, such as --truth truth.exr: pictures and raw files have no such channels"
        ))
        .into()),
        _ => Ok(()),
    }
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Shoot, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let started = Instant::now();
    let mut file = args.taking.shot_file()?;
    args.developing.apply(&mut file.develop)?;
    if args.developing.asks_for_demosaicing() {
        file.camera.color_sampling.get_or_insert(ColorSampling::Mosaic);
    }
    file.camera.serial.override_with(args.raw.serial.clone());
    file.exposure.temperature_c.override_with(args.raw.temperature);
    if !args.sheet.is_empty() {
        return super::sheet::of_shot(args, file, json);
    }
    // The parser does not ask for a sheet where an output excludes it.
    if !args.vary.is_empty() {
        let wrong = anyhow!("--vary without --sheet: expected a contact sheet beside it, such as --sheet sheet.png, and no -o");
        return Err(UsageError(wrong).into());
    }
    file.output.files.override_with(args.output.clone());
    // A series that is only wanted joined leaves no single pictures.
    if file.output.files.is_empty() && args.merge.is_empty() && args.stack.is_empty() {
        file.output.files.push(PathBuf::from("photo.jpg"));
    }
    file.sequence.override_with(args.sequence.clone());
    file.camera.dual_pixel.override_with(args.dual_pixel);
    let sequence = Sequence::new(&mut file)?;
    if !args.merge.is_empty() && !sequence.is_mergeable() {
        return Err(UsageError(anyhow!(
            "--merge joins an exposure series: expected --bracket or --staggered beside it, such as --bracket 5 --step 1ev"
        ))
        .into());
    }
    if !args.stack.is_empty() && !matches!(sequence, Sequence::Focus { count: 2.., .. }) {
        return Err(UsageError(anyhow!(
            "--stack joins a focus series: expected --focus-bracket of two or more beside it, such as --focus-bracket 7"
        ))
        .into());
    }
    let written: Vec<&PathBuf> = file.output.files.iter().chain(&args.merge).chain(&args.stack).collect();
    check_effects(args, &written)?;
    if args.truth.is_some() && file.camera.color_sampling == Some(ColorSampling::Full) {
        let wrong = anyhow!(
            "--color-sampling full with --truth: expected mosaic, with which the truth goes pixel for pixel, or --keep-plane"
        );
        return Err(UsageError(wrong).into());
    }
    let count = sequence.count();
    // Whether the results can be written is known before the work, not after.
    let named = |path: &PathBuf| match sequence.names() {
        Some(names) => output::with_suffixes(path, &names),
        None => output::numbered(path, count),
    };
    // Calibrations are one file for all pictures.
    let (calibrations, pictures): (Vec<PathBuf>, Vec<PathBuf>) =
        file.output.files.iter().cloned().partition(|p| calibration_format(p).is_some());
    let names: Vec<Vec<PathBuf>> = pictures.iter().map(named).collect();
    let planes = args.keep_plane.iter().flat_map(named).collect::<Vec<_>>();
    let truths = args.truth.iter().flat_map(named).collect::<Vec<_>>();
    let subject = args.taking.subject.as_deref().map(Path::new);
    let beside = planes
        .iter()
        .chain(&truths)
        .chain(&calibrations)
        .chain(&args.save_shot)
        .chain(&args.merge)
        .chain(&args.stack)
        .chain(&args.plot_focus);
    output::distinct(subject, names.iter().flatten().chain(beside).map(|p| p.as_path()))?;
    let of_frame = |k: usize| -> Vec<PathBuf> { names.iter().map(|n| n[k].clone()).collect() };
    let prepare = |k: usize| -> anyhow::Result<_> {
        let plane = planes.get(k).map(|p| output::prepare_exr(p)).transpose()?;
        let truth = truths.get(k).map(|p| output::prepare_exr(p)).transpose()?;
        Ok((output::prepare_pictures(&of_frame(k))?, plane, truth))
    };
    // A picture that is only joined or looked at has no file of its own: its checkpoint takes the name of what it goes into.
    let main = pictures.first().or(args.keep_plane.as_ref()).or(args.merge.first()).or(args.stack.first());
    let kept_beside: Vec<PathBuf> = main.map(named).unwrap_or_default();
    // A series goes on with the pictures that are not there, or have a checkpoint. Pictures that are joined must be there as they were read out.
    let resumes = args.taking.resume && count > 1;
    let has_checkpoint = |k: usize| kept_beside.get(k).is_some_and(|file| checkpoint::beside(file).exists());
    let files_of = |k: usize| of_frame(k).into_iter().chain(planes.get(k).cloned()).chain(truths.get(k).cloned());
    let is_there = |k: usize| files_of(k).count() > 0 && files_of(k).all(|file| file.is_file());
    let raw_of = |k: usize| of_frame(k).into_iter().find(|file| matches!(output::kind(file), Ok(Kind::Dng)));
    let is_joined = !args.merge.is_empty() || !args.stack.is_empty();
    let only_raws_are_joined = !args.merge.iter().chain(&args.stack).any(|p| output::kind(p).is_ok_and(Kind::is_looked_at));
    let can_be_kept = |k: usize| files_of(k).count() > 0 && (!is_joined || only_raws_are_joined && raw_of(k).is_some());
    let was_taken = |k: usize| resumes && can_be_kept(k) && is_there(k) && !has_checkpoint(k);
    let has_begun = (0..count).any(|k| was_taken(k) || resumes && has_checkpoint(k));
    // The first proves that the others can be written; thousands are not opened at once.
    let mut ready = (!was_taken(0)).then(|| prepare(0)).transpose()?;
    let merged_file = (!args.merge.is_empty()).then(|| output::prepare_pictures(&args.merge)).transpose()?;
    let stacked_file = (!args.stack.is_empty()).then(|| stack::prepare(&args.stack)).transpose()?;
    let plot_file = args.plot_focus.as_ref().map(|p| paint::prepare(std::slice::from_ref(p))).transpose()?;
    let shot_file = args.save_shot.as_deref().map(Output::prepare).transpose()?;
    let calibration_files = calibrations.iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<Vec<_>>>()?;

    let mut shot = Shot::prepare(&file, &mut warn)?;
    sequence.check(&shot)?;
    let is_developed = |path: &PathBuf| output::kind(path).is_ok_and(|kind| kind != Kind::Dng);
    if pictures.iter().chain(&args.merge).chain(&args.stack).any(is_developed) {
        shot.check_development()?;
    }
    // Pictures to look at are without the renderer's noise; raw files and planes are as computed, unless it is asked for.
    let looked_at = |path: &&PathBuf| output::kind(path).is_ok_and(Kind::is_looked_at);
    let kept_files = || file.output.files.iter().chain(&args.merge).chain(&args.stack);
    if kept_files().any(|p| looked_at(&p)) {
        let raw_too = kept_files().any(|p| !looked_at(&p)) || !planes.is_empty() || !truths.is_empty();
        shot.prepare_pictures(raw_too, &mut warn)?;
    }
    let joined_is_looked_at: Vec<bool> = args.merge.iter().chain(&args.stack).map(|p| looked_at(&p)).collect();
    let kept = match (truths.is_empty(), planes.is_empty()) {
        (false, _) => ExposureUse::Truth,
        (true, false) => ExposureUse::Plane,
        (true, true) => ExposureUse::ReadOut,
    };
    let all = file.output.files.iter().chain(&args.merge).chain(&args.stack);
    let exposures = kept != ExposureUse::ReadOut || all.map(|p| output::kind(p)).any(|k| matches!(k, Ok(Kind::Exr | Kind::Dng)));
    choose_fireflies(&mut shot, file.render.fireflies, exposures);
    memory::settle_fireflies(&mut shot, kept, args.taking.max_memory);
    memory::check(&shot, kept, args.taking.max_memory)?;
    shot.date = Some(output::now());
    let begun = Instant::now();
    let report = watched("focusing", |w| shot.focus(w, &mut warn))?;
    let focused = begun.elapsed().as_secs_f64();
    if let Some(outputs) = plot_file {
        let Some(report) = &report else {
            return Err(UsageError(anyhow!("--plot-focus shows what autofocus saw: expected --focus auto beside it")).into());
        };
        paint::write(outputs, &focus_plot(report))?.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    }
    if let Some(report) = &report {
        say(&told(report));
    }
    watched("metering", |w| shot.meter(w, &mut warn))?;
    say_ambient(file.scene.ambient_ev, &shot.facts());
    let prepared = started.elapsed().as_secs_f64();
    if let Some(output) = shot_file {
        // What was run: also what had been left open, and by paths that hold wherever the shot file lies.
        file.make_paths_absolute();
        shot.write_resolved(&mut file);
        output.commit(|to| Ok(to.write_all(file.to_toml().as_bytes())?))?;
    }

    // Those that are joined: as they were read out, and without the renderer's noise.
    let (mut raws, mut clean) = (Vec::<RawImage>::new(), Vec::<RawImage>::new());
    let (mut written, mut all_facts) = (Vec::new(), Vec::new());
    let (mut size, mut expose_s) = ([0, 0], 0.0);
    let mut stopped = None;
    let mut told = HashSet::new();
    let mut calibration: Option<SeriesCalibration> = None;
    // Without a picture nothing is exposed.
    let only_calibrations =
        pictures.is_empty() && planes.is_empty() && truths.is_empty() && merged_file.is_none() && stacked_file.is_none();
    for k in 0..count {
        if count > 1 {
            // Of a bracket each picture that does not come out as asked; of thousands of frames the first speaks for all.
            let is_bracket = matches!(sequence, Sequence::Bracket { .. } | Sequence::Focus { .. });
            sequence.turn(&mut shot, k, &mut |text| {
                if (k == 0 || is_bracket) && told.insert(text.to_owned()) {
                    warn(text);
                }
            })?;
        }
        if !calibrations.is_empty() {
            let unnamed = || named(&PathBuf::from("photo.jpg")).swap_remove(k);
            let picture = names.first().map_or_else(unnamed, |n| n[k].clone()).display().to_string();
            match &mut calibration {
                None => {
                    let files: Vec<_> = calibrations.iter().filter_map(|p| Some((p.clone(), calibration_format(p)?))).collect();
                    let is_developed = names.first().is_some_and(|n| is_developed(&n[k]));
                    calibration = Some(SeriesCalibration::of(&shot, &files, &picture, is_developed, &sequence)?);
                }
                Some(whole) => whole.add(&shot, &picture)?,
            }
        }
        if only_calibrations {
            size = [shot.camera.film.columns, shot.camera.film.rows];
            all_facts.push(shot.facts());
            continue;
        }
        if was_taken(k)
            && let Some((facts, raw)) = there_from_before(&shot, raw_of(k).as_deref(), planes.get(k).map(PathBuf::as_path))?
        {
            raws.extend(raw.filter(|_| is_joined));
            let files: Vec<String> = files_of(k).map(|file| file.display().to_string()).collect();
            say(&format!("{}: there from before", files.join(", ")));
            size = [shot.camera.film.columns, shot.camera.film.rows];
            written.extend(files_of(k));
            all_facts.push(facts);
            continue;
        }
        let (pictures, plane_file, truth_file) = match ready.take() {
            Some(files) => files,
            None => prepare(k)?,
        };
        let begun = Instant::now();
        let what = if count > 1 { "exposing (each)" } else { "exposing" };
        let must = args.taking.resume && (count == 1 || !has_begun && k == 0);
        let taken = checkpoint::expose(&shot, &args.taking, kept_beside.get(k).map(PathBuf::as_path), what, must)?;
        let plane = &taken.exposed.plane;
        let seconds = begun.elapsed().as_secs_f64();
        expose_s += seconds;
        size = [plane.width(), plane.height()];
        let raw = shot.read_out(plane)?;
        // The same read-out of the same electrons without the renderer's noise.
        let denoised = shot.for_pictures(&taken.exposed)?.map(|plane| shot.read_out(&plane)).transpose()?;
        let mut of_this = Vec::new();
        if let Some(output) = plane_file {
            of_this.push(output::write_plane(output, plane)?);
        }
        if let Some(output) = truth_file {
            let reader = ReadOut::new(&shot.sensor, &shot.reading, size, &plane.bands, plane.facts.exposure_s)?;
            let reader = reader.with_rows_of(&plane.facts);
            let layout = args.truth_layout.layout();
            of_this.extend(output::write_truth(output, plane.truth.recorded(), args.truth_sidecar, |recorded, to| {
                truth::write(plane, &reader, &raw, layout, recorded, to)
            })?);
        }
        let format = Format { storage: args.raw.storage(), ..Format::default() };
        let only_looked_at = pictures.iter().all(|(kind, _)| kind.is_looked_at());
        of_this.extend(output::write_pictures(pictures, &raw, denoised.as_ref(), &shot.recipe, shot.lut.as_ref(), format)?);
        let facts = denoised.as_ref().filter(|_| only_looked_at).unwrap_or(&raw).header.facts.clone();
        match k {
            0 => say(&display(&facts, size[0], size[1], seconds)),
            _ => {
                let focus = facts.focus_distance_m.map_or("∞".to_owned(), |m| format!("{m:.3} m"));
                let focus = if matches!(sequence, Sequence::Focus { .. }) { format!("   focus {focus}") } else { String::new() };
                say(&format!("{}{focus}", setting(&facts)));
            }
        }
        if let Some(denoised) = denoised.as_ref().filter(|_| k == 0 && !only_looked_at) {
            say(&format!("pictures to look at are denoised ({}), the other files are not", denoised.header.facts.denoiser));
        }
        of_this.iter().for_each(|path| say(&format!("wrote {}", path.display())));
        written.extend(of_this);
        all_facts.push(facts);
        if denoised.is_none() && !joined_is_looked_at.is_empty() || joined_is_looked_at.contains(&false) {
            raws.push(raw);
        }
        if joined_is_looked_at.contains(&true) {
            clean.extend(denoised);
        }
        stopped = taken.finish();
        if stopped.is_none() && k + 1 < count && watch::stopping() {
            stopped = Some(format!("stopped after {} of {count} pictures", k + 1));
        }
        if let Some(how) = &mut stopped {
            if count > 1 && can_be_kept(k) {
                how.push_str("; --resume keeps the pictures that are whole and takes the others");
            }
            break;
        }
    }
    if let Some(calibration) = calibration {
        for ((path, output), text) in calibrations.iter().zip(calibration_files).zip(calibration.texts()?) {
            written.push(output.commit(|to| Ok(to.write_all(text.as_bytes())?))?);
            say(&format!("wrote {}", path.display()));
        }
    }
    // A series that is not whole is not joined.
    let (stacked_file, merged_file) = if stopped.is_some() { (None, None) } else { (stacked_file, merged_file) };
    if let Some(outputs) = stacked_file {
        for path in stack::write(outputs, &raws, &clean, &shot.recipe, shot.lut.as_ref())? {
            say(&format!("wrote {}", path.display()));
            written.push(path);
        }
    }
    if let Some(outputs) = merged_file {
        let merged = |raws: &[RawImage]| (!raws.is_empty()).then(|| hdr::merge(raws)).transpose().map_err(anyhow::Error::from);
        let (merged, clean) = (merged(&raws)?, merged(&clean)?);
        let any = merged.as_ref().or(clean.as_ref()).expect("a series that was taken");
        let format = Format { storage: args.raw.storage(), ..Format::default() };
        for path in output::write_pictures(outputs, any, clean.as_ref(), &shot.recipe, shot.lut.as_ref(), format)? {
            say(&format!("wrote {}", path.display()));
            written.push(path);
        }
    }
    if json {
        let mut result = serde_json::json!({
            "files": written,
            "facts": all_facts[0],
            "size": size,
            "prepare_s": prepared,
            "focus_s": focused,
            "focus": report,
            "expose_s": expose_s,
            "total_s": started.elapsed().as_secs_f64(),
            "stopped": stopped.is_some(),
        });
        if count > 1 {
            result["frames"] = serde_json::json!(all_facts);
        }
        print_json(&result)?;
    }
    stopped.map_or(Ok(()), |how| Err(Stopped(how).into()))
}

/// The facts of a picture that is there from before, and the raw image where its file is one; `None` where it has fewer samples than are asked for. Fails where it is of
/// another picture than the shot takes now. Files that keep no facts are believed.
fn there_from_before(
    shot: &Shot,
    raw_file: Option<&Path>,
    plane_file: Option<&Path>,
) -> anyhow::Result<Option<(ExposureFacts, Option<RawImage>)>> {
    let raw = raw_file.map(read_raw).transpose()?;
    let facts = match (&raw, plane_file) {
        (Some(raw), _) => Some(raw.header.facts.clone()),
        (None, Some(path)) => Some(PlaneFile::open(path)?.facts().clone()),
        (None, None) => None,
    };
    let now = ExposureFacts { seed: shot.settings.seed, ..shot.plane_facts() };
    if let (Some(facts), Some(file)) = (&facts, raw_file.or(plane_file)) {
        let picture = |f: &ExposureFacts| ExposureFacts {
            scene: f.scene.clone(),
            body: f.body.clone(),
            lens: f.lens.clone(),
            settings_hash: f.settings_hash.clone(),
            focal_length_mm: f.focal_length_mm,
            f_number: f.f_number,
            exposure_s: f.exposure_s,
            focus_distance_m: f.focus_distance_m,
            at_s: f.at_s,
            seed: f.seed,
            ..ExposureFacts::default()
        };
        let differences = picture(facts).differences(&picture(&now));
        if !differences.is_empty() {
            let (file, differences) = (file.display(), differences.join(", "));
            let wrong = anyhow!("--resume: {file} is another picture, by {differences}; without --resume all are taken again");
            return Err(UsageError(wrong).into());
        }
        if shot.settings.time_limit_s.is_none() && (facts.samples as usize) < shot.settings.samples.len() {
            return Ok(None);
        }
    }
    Ok(Some((facts.unwrap_or(now), raw)))
}

/// Whether fireflies are re-weighted: as asked; else in pictures, but not where the same light is also written as an exposure (DNG, EXR, focal plane,
/// truth), which is to be what was computed. All files of a shot show the same light.
fn choose_fireflies(shot: &mut Shot, asked: Option<FireflyChoice>, exposures: bool) {
    shot.fireflies = asked.unwrap_or(if exposures { FireflyChoice::Keep } else { FireflyChoice::Reweight });
    if asked == Some(FireflyChoice::Reweight) && !shot.reweights() && !shot.lens_cap {
        warn("fireflies are kept: only all samples at once of an exposure in electrons can be re-weighted");
    }
}

/// The kind of calibration that a name asks for; pictures and tables of pixels are none.
fn calibration_format(path: &Path) -> Option<CalibrationFormat> {
    CalibrationFormat::of(path).filter(|f| f.is_text())
}

/// What autofocus did, in a line or two.
fn told(r: &Report) -> String {
    let place = r.distance_m.map_or("infinity".to_owned(), |d| format!("{d:.3} m"));
    let what = match r.chosen {
        Some(k) => format!("autofocus ({}): {place}, confidence {:.2}", r.zones[k].method, r.confidence),
        None => format!("autofocus failed, set to {place}"),
    };
    let zones = if r.zones.len() > 1 {
        let sure = r.zones.iter().filter(|z| z.failure.is_none()).count();
        format!("   {sure} of {} zones, {}", r.zones.len(), r.priority)
    } else {
        String::new()
    };
    let time = if r.seconds > 0.0 { format!(", {:.2} s of the camera's time", r.seconds) } else { String::new() };
    format!("{what}{zones}   {} probes, {} rays{time}", r.probes, r.rays)
}

/// Contrast over the position of the film, zone by zone; values of each view relative to its highest.
fn focus_plot(r: &Report) -> Figure {
    const COLORS: [Color; 6] = [[204, 51, 51], [34, 85, 170], [40, 140, 70], [150, 90, 160], [200, 130, 30], [90, 90, 90]];
    let mut lines = Vec::new();
    for (k, zone) in r.zones.iter().enumerate() {
        let levels = zone.curve.iter().map(|p| p.level).max().map_or(0, |l| l + 1);
        for level in 0..levels {
            let mut points: Vec<_> = zone.curve.iter().filter(|p| p.level == level).collect();
            points.sort_by(|a, b| a.extension_mm.total_cmp(&b.extension_mm));
            let most = points.iter().map(|p| p.value.abs()).fold(1e-12, f64::max);
            let name = match (r.zones.len(), level) {
                (1, 0) if levels > 1 => "widest view".to_owned(),
                (1, l) if l + 1 == levels => "closest view".to_owned(),
                (_, 0) => format!("zone {}", k + 1),
                _ => String::new(),
            };
            lines.push(Line {
                name,
                color: COLORS[(if r.zones.len() == 1 { level as usize } else { k }) % COLORS.len()],
                style: if level + 1 == levels { Style::Full } else { Style::Broken },
                points: points.iter().map(|p| glam::DVec2::new(p.extension_mm, p.value / most)).collect(),
            });
        }
    }
    lines.push(Line {
        name: "settled on".into(),
        color: [0, 0, 0],
        style: Style::Broken,
        points: vec![glam::DVec2::new(r.extension_mm, 0.0), glam::DVec2::new(r.extension_mm, 1.05)],
    });
    let phase = r.zones.iter().all(|z| z.method == "phase");
    let all = r.zones.iter().flat_map(|z| z.curve.iter().map(|p| p.extension_mm)).chain([r.extension_mm]);
    let mut figure = Figure::new(520.0, 360.0);
    Chart {
        title: format!("autofocus: {}", r.distance_m.map_or("infinity".to_owned(), |d| format!("{d:.3} m"))),
        x: Axis::around("film behind its place for infinity, mm", all, false),
        y: match phase {
            true => Axis { label: "defocus found, relative".into(), range: [-1.1, 1.1] },
            false => Axis { label: "contrast, relative to its highest".into(), range: [0.0, 1.1] },
        },
        lines,
    }
    .draw(&mut figure, glam::DVec2::ZERO, glam::DVec2::new(520.0, 360.0));
    figure
}

//! `develop`: raw images into pictures.

use super::{print_json, read_raw};
use crate::args::Develop;
use crate::output::{self, Format, Output};
use crate::watch::{say, stop, watched};
use crate::{Stopped, UsageError, effect, step_pictures, views};
use anyhow::{Context, anyhow};
use diopter::develop::lut::Lut;
use diopter::develop::{Recipe, SETTINGS};
use diopter::expose::ProgressReporter;
use diopter::image::{Encoding, RawImage, png};
use diopter::recipe_file;
use diopter::shot::ShotError;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// What stands for the name of the raw file.
const NAME: &str = "{}";

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Develop, json: bool) -> anyhow::Result<()> {
    let mut recipe = Recipe::default();
    args.developing.apply(&mut recipe)?;
    if let Some(focus) = &args.refocus {
        recipe = recipe.with("light_field.focus", focus).map_err(ShotError::from)?;
    }
    if args.settings {
        return settings(&recipe, json);
    }
    let format = Format {
        quality: args.quality.unwrap_or(output::JPEG_QUALITY),
        gain_map: args.gain_map,
        depth: match args.bits {
            None if matches!(recipe.output.encoding, Encoding::Pq | Encoding::Hlg) => png::Depth::Sixteen,
            None | Some(8) => png::Depth::Eight,
            Some(16) => png::Depth::Sixteen,
            Some(other) => return Err(UsageError(anyhow!("bits {other}: expected 8 or 16")).into()),
        },
        ..Format::default()
    };
    let jobs = jobs(args)?;
    let kinds = args.output.iter().map(|p| output::kind(p)).collect::<anyhow::Result<Vec<_>>>()?;
    effect::check(args.typed_of_files(), &kinds)?;
    // A recipe that is saved, and pictures of steps and views, show all of the development.
    if args.save_recipe.is_none() && args.steps.is_none() && args.views.is_none() {
        effect::check(args.developing.typed(), &kinds)?;
    }
    let saved = args.save_recipe.as_deref().map(Output::prepare).transpose()?;
    // What is wrong with the recipe is wrong with all files: said before any is touched.
    let lut = recipe_file::lut(&recipe)?;
    if args.gain_map && recipe.output.encoding != Encoding::Srgb {
        return Err(UsageError(anyhow!("--gain-map: expected output.encoding = \"srgb\" for its base")).into());
    }
    let mut reports = Vec::new();
    let mut failed = 0;
    let several = jobs.len() > 1;
    let mut all = |watch: &ProgressReporter| {
        for (i, job) in jobs.iter().enumerate() {
            if watch.cancel.load(Ordering::Relaxed) {
                break;
            }
            (watch.progress)(i as f64 / jobs.len() as f64);
            match one(args, job, &recipe, lut.as_ref(), format) {
                Ok((written, raw)) => {
                    written.iter().for_each(|path| say(&format!("wrote {}", path.display())));
                    reports.push(serde_json::json!({
                        "files": written, "facts": raw.header.facts, "size": raw.size()
                    }));
                }
                // One file that cannot be developed is no reason to leave the others.
                Err(e) if several => {
                    say(&format!("diopter: {}", crate::told(&e)));
                    reports.push(serde_json::json!({ "files": [], "error": crate::error_json(&e, 1)["error"] }));
                    failed += 1;
                }
                Err(e) => return Err(e),
            }
        }
        Ok(())
    };
    // A single file has nothing to end cleanly: a signal stops it at once.
    match several {
        true => watched("developing", all)?,
        false => all(&ProgressReporter { cancel: stop(), progress: &|_| () })?,
    }
    if let Some(output) = saved {
        // Its table is found from wherever the recipe lies.
        let mut whole = recipe.clone();
        if !whole.lut.file.is_empty() {
            whole.lut.file = std::path::absolute(&whole.lut.file)?.display().to_string();
        }
        let path = output.commit(|to| Ok(to.write_all(whole.to_toml().as_bytes())?))?;
        say(&format!("wrote {}", path.display()));
    }
    if json {
        match (several, reports.pop()) {
            (false, Some(report)) => print_json(&report)?,
            (_, last) => {
                reports.extend(last);
                print_json(&serde_json::Value::Array(reports))?;
            }
        }
    }
    match failed {
        0 => Ok(()),
        n => {
            let how = format!("{n} of {} files could not be developed", jobs.len());
            // In JSON all has been said.
            Err(if json { Stopped(how).into() } else { anyhow!(how) })
        }
    }
}

/// A raw file and the pictures to make of it.
struct Job {
    raw: PathBuf,
    outputs: Vec<PathBuf>,
}

/// Checks the names before the work.
fn jobs(args: &Develop) -> anyhow::Result<Vec<Job>> {
    let wrong = |text: String| anyhow::Error::from(UsageError(anyhow!(text)));
    let beside = args.steps.iter().chain(&args.views).chain(&args.depth).next().is_some();
    if args.output.is_empty() && !beside && !args.raw.is_empty() {
        return Err(wrong("no picture to write: expected -o FILE, or --steps FOLDER".into()));
    }
    for path in &args.output {
        output::kind_of_developed(path)?;
        if args.raw.len() > 1 && !path.to_string_lossy().contains(NAME) {
            return Err(wrong(format!(
                "{}: {} raw files would be written to one name; expected {NAME} in it, such as \"out/{NAME}.jpg\"",
                path.display(),
                args.raw.len()
            )));
        }
    }
    if args.raw.len() > 1 && beside {
        return Err(wrong("--steps, --views and --depth show one raw file: expected a single one".into()));
    }
    args.depth.as_deref().map_or(Ok(()), views::check_depth)?;
    let named = |raw: &Path, path: &Path| {
        let stem = raw.file_stem().unwrap_or_default().to_string_lossy();
        PathBuf::from(path.to_string_lossy().replace(NAME, &stem))
    };
    let jobs: Vec<Job> = args
        .raw
        .iter()
        .map(|raw| Job { raw: raw.clone(), outputs: args.output.iter().map(|p| named(raw, p)).collect() })
        .collect();
    let steps: Vec<PathBuf> =
        args.steps.iter().flat_map(|folder| step_pictures::names().into_iter().map(|n| folder.join(n))).collect();
    if let Some(folder) = args.steps.iter().chain(&args.views).find(|f| f.exists() && !f.is_dir()) {
        return Err(wrong(format!("{}: expected a folder", folder.display())));
    }
    let beside = args.save_recipe.iter().chain(&steps).chain(&args.depth);
    output::distinct(
        jobs.iter().map(|j| j.raw.as_path()),
        jobs.iter().flat_map(|j| &j.outputs).chain(beside).map(|p| p.as_path()),
    )?;
    Ok(jobs)
}

fn one(
    args: &Develop,
    job: &Job,
    recipe: &Recipe,
    lut: Option<&Lut>,
    format: Format,
) -> anyhow::Result<(Vec<PathBuf>, RawImage)> {
    let outputs = output::prepare_pictures(&job.outputs)?;
    let place = || job.raw.display().to_string();
    let raw = read_raw(&job.raw)?;
    let mut written = output::write_pictures(outputs, &raw, None, recipe, lut, format).with_context(place)?;
    if let Some(folder) = &args.steps {
        written.extend(step_pictures::write_steps(&raw, recipe, lut, folder)?);
    }
    if let Some(folder) = &args.views {
        written.extend(views::write_views(&raw, recipe, lut, folder).with_context(place)?);
    }
    if let Some(path) = &args.depth {
        written.push(views::write_depth(&raw, recipe, path).with_context(place)?);
    }
    Ok((written, raw))
}

/// Lists what can be set.
fn settings(recipe: &Recipe, json: bool) -> anyhow::Result<()> {
    let default = Recipe::default();
    recipe.check().map_err(ShotError::from)?;
    if json {
        let rows: Vec<_> = SETTINGS
            .iter()
            .map(|s| {
                serde_json::json!({
                    "name": s.name, "unit": s.unit, "allowed": s.allowed.to_string(), "value": recipe.value(s.name),
                    "default": default.value(s.name), "why": s.why
                })
            })
            .collect();
        return print_json(&serde_json::Value::Array(rows));
    }
    let mut out = std::io::stdout();
    let longest = SETTINGS.iter().map(|s| s.name.len()).max().unwrap_or(0);
    for s in SETTINGS.iter() {
        let unit = if s.unit.is_empty() { String::new() } else { format!(" {}", s.unit) };
        let value = recipe.value(s.name);
        let value = if value.is_empty() { "not set".to_owned() } else { value };
        writeln!(out, "{:<longest$} {value}{unit}   ({})\n    {}", s.name, s.allowed, s.why)?;
    }
    writeln!(out, "\npresets: {}", Recipe::PRESETS.join(", "))?;
    Ok(())
}

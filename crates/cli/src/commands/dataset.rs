//! `dataset`: items, the folder they are gathered in, and the job that makes them elsewhere.

use super::print_json;
use crate::UsageError;
use crate::args::{DatasetVerb, WhichItems};
use crate::output::{self, Output};
use crate::watch::{say, warn, watched};
use anyhow::anyhow;
use diopter::dataset::{Dataset, Folder, job};
use diopter::memory::Bytes;
use diopter::quantity::Seconds;
use diopter::shot::ShotError;
use std::collections::HashSet;
use std::io::Write;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Items that are listed by default.
const LISTED: u64 = 10;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &DatasetVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        DatasetVerb::Make { spec, output } => make(spec, output, json),
        DatasetVerb::Item { spec, which, output } => item(spec, which, output, json),
        DatasetVerb::Info { spec, items } => info(spec, *items, json),
        DatasetVerb::Job { spec, output, folder, items_per_task, cores, memory, timeout } => {
            let hints = job::Hints {
                items: *items_per_task,
                cores: *cores,
                memory_mib: memory.map(|Bytes(bytes)| bytes.div_ceil(1 << 20)),
                timeout_s: timeout.map(whole_seconds).transpose()?,
            };
            write_job(spec, output, folder.as_deref(), &hints, json)
        }
    }
}

fn whole_seconds(time: Seconds) -> anyhow::Result<u64> {
    match (1.0..=1e9).contains(&time.0) {
        true => Ok(time.0.ceil() as u64),
        false => Err(UsageError(anyhow!("timeout {time}: expected 1 s or more, such as \"30 min\"")).into()),
    }
}

/// Warnings, each once: many items have the same.
fn once() -> impl FnMut(&str) {
    let mut told = HashSet::new();
    move |text: &str| {
        if told.insert(text.to_owned()) {
            warn(text);
        }
    }
}

fn make(spec: &Path, folder: &Path, json: bool) -> anyhow::Result<()> {
    let dataset = Arc::new(Dataset::read(spec)?);
    let mut warn = once();
    if Folder::is_new(folder) {
        // A folder that is begun takes no other specification: what is wrong with this one is said before.
        checked(&dataset, &mut warn)?;
    }
    let gathered = Folder::open(dataset.clone(), folder)?;
    let missing = gathered.missing().len() as u64;
    let was_whole = gathered.is_whole();
    if missing < dataset.items() {
        say(&format!("{} of {} items are there", dataset.items() - missing, dataset.items()));
    }
    let made = watched("items", |w| gathered.make(w, &mut warn)).map_err(|e| stopped(e, folder))?;
    match was_whole {
        true => say(&format!("{} is whole already", folder.display())),
        false => made.files.iter().for_each(|name| say(&format!("wrote {}", folder.join(name).display()))),
    }
    if json {
        let files: Vec<PathBuf> = made.files.iter().map(|name| folder.join(name)).collect();
        print_json(&serde_json::json!({ "files": files, "items": made.items, "made": missing }))?;
    }
    Ok(())
}

/// Tries items without exposing them; answers with how many.
fn checked(dataset: &Dataset, warn: &mut dyn FnMut(&str)) -> anyhow::Result<usize> {
    watched("trying items", |w| dataset.check_items(w, warn)).map_err(|e| match e {
        ShotError::Expose(diopter::ExposeError::Cancelled) => anyhow!("stopped: the specification is not checked"),
        other => other.into(),
    })
}

/// A stop is no failure of an exposure: what is done stays.
fn stopped(e: ShotError, folder: &Path) -> anyhow::Error {
    match e {
        ShotError::Expose(diopter::ExposeError::Cancelled) => {
            anyhow!("stopped: what is done lies in {}, and the same command goes on from there", folder.display())
        }
        other => other.into(),
    }
}

fn item(spec: &Path, which: &WhichItems, folder: &Path, json: bool) -> anyhow::Result<()> {
    let dataset = Arc::new(Dataset::read(spec)?);
    let all = dataset.items();
    let range: Range<u64> = match (which.items, which.item) {
        (Some([first, end]), _) => first..end,
        (None, first) => {
            let first = first.unwrap_or_default();
            first..first.saturating_add(which.count).min(all.max(first.saturating_add(1)))
        }
    };
    if range.end > all {
        let expected = format!("expected numbers from 0 to {}: the data set has {all} items", all - 1);
        return Err(UsageError(anyhow!("items {}..{}: {expected}", range.start, range.end)).into());
    }
    let gathered = Folder::open(dataset.clone(), folder)?;
    let mut warn = once();
    watched("items", |w| gathered.make_items(range.clone(), w, &mut warn)).map_err(|e| stopped(e, folder))?;
    let told = range.clone().map(|item| dataset.parameters_json(item)).collect::<Result<Vec<_>, _>>()?;
    say(&format!("items {}..{} are in {}", range.start, range.end, folder.display()));
    if json {
        print_json(&serde_json::json!({ "items": told }))?;
    }
    Ok(())
}

fn info(spec: &Path, items: Option<[u64; 2]>, json: bool) -> anyhow::Result<()> {
    let dataset = Dataset::read(spec)?;
    let [first, end] = items.unwrap_or([0, LISTED]);
    let listed = first..end.min(dataset.items());
    let rows = listed.map(|item| dataset.parameters_json(item)).collect::<Result<Vec<_>, _>>()?;
    let shards = dataset.shards();
    let tried = checked(&dataset, &mut once())?;
    if json {
        let shards: Vec<_> = shards.iter().map(|s| serde_json::json!({ "name": s.name, "items": s.items.len() })).collect();
        return print_json(&serde_json::json!({
            "name": dataset.name(), "items": dataset.items(), "files": dataset.endings(), "shards": shards, "listed": rows,
            "tried": tried,
        }));
    }
    let mut out = std::io::stdout();
    let files = dataset.endings().join(", ");
    writeln!(out, "{}: {} items of {files} in {} shards", dataset.name(), dataset.items(), shards.len())?;
    for row in rows {
        let split = row["split"].as_str().map_or(String::new(), |s| format!("   {s}"));
        let parameters = row["parameters"].as_object().into_iter().flatten().filter(|p| !p.1.is_null());
        let told: Vec<String> = parameters
            .map(|(name, value)| format!("{name} {}", value.as_str().map_or_else(|| value.to_string(), str::to_owned)))
            .collect();
        writeln!(out, "{}{split}   {}", row["key"].as_str().unwrap_or_default(), told.join(", "))?;
    }
    writeln!(out, "tried {tried} of them without exposing: each can be prepared")?;
    Ok(())
}

fn write_job(spec: &Path, path: &Path, folder: Option<&Path>, hints: &job::Hints, json: bool) -> anyhow::Result<()> {
    let dataset = Dataset::read(spec)?;
    output::distinct([spec], [path])?;
    // Defaults of a template lie beside it or below.
    let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let here = whole(path).parent().map(Path::to_owned).unwrap_or_default();
    let below = |path: &Path| {
        let path = whole(path);
        let name = |part: Component| match part {
            Component::Normal(name) => name.to_str().map(str::to_owned),
            _ => None,
        };
        let parts = path.strip_prefix(&here).ok()?.components().map(name).collect::<Option<Vec<_>>>()?;
        (!parts.is_empty()).then(|| parts.join("/"))
    };
    let stem = spec.file_stem().map_or("dataset".into(), |s| s.to_string_lossy().into_owned());
    let (spec_default, folder_default) = (below(spec), folder.map_or(Some(stem), &below));
    for (name, default, given) in [("Specification", &spec_default, Some(spec)), ("Folder", &folder_default, folder)] {
        if let (None, Some(given)) = (default, given) {
            let given = whole(given);
            say(&format!(
                "note: {} does not lie below the template: the job is given it by -p {name}={}",
                given.display(),
                given.display()
            ));
        }
    }
    let text = job::template(&dataset, spec_default.as_deref(), folder_default.as_deref(), hints);
    let written = Output::prepare(path)?.commit(|to| Ok(to.write_all(text.as_bytes())?))?;
    say(&format!("wrote {}", written.display()));
    if json {
        print_json(&serde_json::json!({ "files": [written], "items": dataset.items() }))?;
    }
    Ok(())
}

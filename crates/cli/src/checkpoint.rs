//! Exposures that can be stopped, killed and gone on with: checkpoints beside the output.

use crate::AskedWrongly;
use crate::args::{Checkpoint, Taking};
use crate::output::Output;
use crate::watch::{self, say, warn, watched};
use anyhow::{Context, anyhow};
use diopter::checkpoint;
use diopter::expose::{Exposed, Sums};
use diopter::shot::Shot;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Seconds from one checkpoint to the next when nobody says, and before the first: what is shorter is soon done again.
const EVERY_S: f64 = 30.0;
const FIRST_S: f64 = 60.0;
/// Writing checkpoints takes at most this fraction of the time.
const SHARE: f64 = 0.05;

/// An exposure that was taken, with its checkpoint.
pub struct Taken {
    /// What came of it.
    pub exposed: Exposed,
    file: Option<PathBuf>,
    /// Samples that were asked for.
    wanted: u32,
}

/// Exposes a shot that is metered; `output` is the file that the exposure is for. Goes on from its checkpoint if there is one.
pub fn expose(shot: &Shot, taking: &Taking, output: Option<&Path>, what: &'static str) -> anyhow::Result<Taken> {
    let wanted = shot.settings.samples.len() as u32;
    let file = output.filter(|_| taking.checkpoint != Some(Checkpoint::Off) && !shot.lens_cap).map(beside);
    let identity = if file.is_some() { watched(what, |w| shot.identity(w))? } else { 0 };
    let start = match &file {
        Some(file) if !taking.no_resume => resumed(shot, file, identity, taking.resume)?,
        _ => None,
    };
    let (mut next, every) = match taking.checkpoint {
        Some(Checkpoint::Every(s)) => (s, s),
        _ => (FIRST_S, EVERY_S),
    };
    let begun = Instant::now();
    let mut told = false;
    let mut saved_on_stop = None;
    let mut keep_from = file.as_deref();
    let mut keep = |sums: &Sums| {
        let stopping = watch::stopping();
        if stopping && !told {
            told = true;
            say("stopping: the samples under way are finished, which takes seconds; once more ends at once");
        }
        let Some(file) = keep_from else { return };
        // When stopped at once, for who is killed soon after, and when the pass is finished.
        let on_stop = stopping && saved_on_stop != Some(sums.samples().end);
        if !on_stop && begun.elapsed().as_secs_f64() < next {
            return;
        }
        if stopping {
            saved_on_stop = Some(sums.samples().end);
        }
        let writing = Instant::now();
        if let Err(e) = save(file, sums, identity) {
            warn(&format!("{e:#}: this exposure has no more checkpoints"));
            keep_from = None;
        }
        next = begun.elapsed().as_secs_f64() + every.max(writing.elapsed().as_secs_f64() / SHARE);
    };
    let exposed = watched(what, |w| shot.expose_from(start, w, Some(&mut keep)))?;
    Ok(Taken { exposed, file, wanted })
}

impl Taken {
    /// Removes the checkpoint of a whole exposure, now that its files are written. Of one that was stopped, says how far it came.
    pub fn finish(&self) -> Option<String> {
        let file = self.file.as_deref().filter(|f| f.exists());
        if !self.exposed.stopped {
            if let Some(file) = file {
                // Nothing can be done about one that cannot be removed.
                let _ = std::fs::remove_file(file);
            }
            return None;
        }
        let taken = self.exposed.plane.facts.samples;
        let further = file.map_or(String::new(), |f| format!("; the same command goes on from {}", f.display()));
        Some(format!("stopped after {taken} of {} samples a pixel: what was written holds these{further}", self.wanted))
    }
}

/// The name of a checkpoint.
fn beside(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".checkpoint");
    name.into()
}

/// The sums that a checkpoint holds, if it is of this exposure. `must`: else it is an error.
fn resumed(shot: &Shot, path: &Path, identity: u64, must: bool) -> anyhow::Result<Option<Sums>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == ErrorKind::NotFound && !must => return Ok(None),
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let missing =
                anyhow!("--resume: expected the checkpoint {}; without --resume the exposure begins anew", path.display());
            return Err(AskedWrongly(missing).into());
        }
        Err(e) => return Err(e).with_context(|| path.display().to_string()),
    };
    let film = &shot.camera.film;
    match checkpoint::read(&mut BufReader::new(file), identity, [film.columns, film.rows, shot.bands()]) {
        Ok(sums) => {
            let all = &shot.settings.samples;
            let done = sums.samples().len();
            say(&format!("going on from {}: {done} of {} samples a pixel are done", path.display(), all.len()));
            Ok(Some(sums))
        }
        Err(e) if must => Err(AskedWrongly(anyhow!("{}: {e}; without --resume the exposure begins anew", path.display())).into()),
        Err(e) => {
            warn(&format!("{}: {e}; the exposure begins anew", path.display()));
            Ok(None)
        }
    }
}

fn save(path: &Path, sums: &Sums, identity: u64) -> anyhow::Result<()> {
    Output::prepare(path)?.commit(|to| {
        checkpoint::write(sums, identity, to)?;
        to.flush()?;
        // Before it takes the place of the one before: after a power cut one of the two is whole.
        Ok(to.get_ref().sync_all()?)
    })?;
    Ok(())
}

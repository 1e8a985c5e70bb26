//! Exposures that can be stopped, killed and gone on with: checkpoints beside the output.

use crate::UsageError;
use crate::args::{Checkpoint, Taking};
use crate::output::{self, Output};
use crate::parts;
use crate::watch::{self, say, warn, watched};
use anyhow::{Context, anyhow};
use diopter::checkpoint::{self, CheckpointError};
use diopter::expose::{Exposed, Sums};
use diopter::image::Raster;
use diopter::row_store::{PagedRows, RowStore};
use diopter::shot::{ExposedStrips, Shot};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Seconds from one checkpoint to the next by default, and before the first: what is shorter is soon done again.
const EVERY_S: f64 = 30.0;
const FIRST_S: f64 = 60.0;
/// Writing checkpoints takes at most this fraction of the time.
const TIME_FRACTION: f64 = 0.05;

/// An exposure that was taken, with its checkpoint.
pub struct Taken {
    /// What came of it.
    pub exposed: Exposed,
    kept: Kept,
}

/// Where the checkpoints of an exposure are.
pub struct Kept {
    file: Option<PathBuf>,
    identity: u64,
    /// Samples that were asked for.
    wanted: u32,
    /// Whether the file is of this exposure: read or written by it. Others are never removed.
    ours: AtomicBool,
}

/// Exposes a shot that is metered; `output` is the file that the exposure is for. Goes on from its checkpoint if there is one; `must`: fails where there is none.
pub fn expose(shot: &Shot, taking: &Taking, output: Option<&Path>, what: &'static str, must: bool) -> anyhow::Result<Taken> {
    let kept = Kept::of(shot, taking, output, what)?;
    let start = kept.start(shot, taking, must, |[width, height, numbers]| Ok(Raster::<f64>::new(width, height, numbers)))?;
    let mut writer = kept.writer(taking);
    let exposed = watched(what, |w| {
        let mut keep = |sums: &Sums| {
            writer.keep(sums);
            // A pass of what fits into memory takes seconds: it is finished, and the picture written.
            ControlFlow::Continue(())
        };
        shot.expose_from(start, w, Some(&mut keep))
    })?;
    Ok(Taken { exposed, kept })
}

/// The same for a focal plane that memory cannot hold: its sums lie beside the output, `cache` bytes of them in memory.
pub fn expose_rows<'a>(
    shot: &'a Shot,
    taking: &Taking,
    output: &Path,
    what: &'static str,
    cache: usize,
) -> anyhow::Result<(ExposedStrips<'a>, Kept)> {
    let temporary = std::env::temp_dir();
    let folder = match output::is_stream(output) {
        true => temporary.as_path(),
        false => output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")),
    };
    let kept = Kept::of(shot, taking, Some(output), what)?;
    let start = kept.start(shot, taking, taking.resume, |size| PagedRows::new(size, cache, folder))?;
    let mut writer = kept.writer(taking);
    // Samples of all pixels, those of a pass under way included, when it ended within one.
    let mut ended = None;
    let exposed = watched(what, |w| {
        let mut keep = |sums: &Sums<PagedRows>| match writer.keep(sums) {
            // A pass may take hours, and what would be written is worth little without it.
            Saved::OnStop => {
                ended = Some(sums.mean_samples());
                ControlFlow::Break(())
            }
            Saved::No => ControlFlow::Continue(()),
        };
        shot.expose_rows(start, w, Some(&mut keep), cache, folder)
    });
    if let (Err(_), Some(done), Some(file)) = (&exposed, ended, &kept.file) {
        return Err(anyhow!(
            "stopped: {} holds {done:.2} of {} samples a pixel, and the same command goes on from it; {} was not written",
            file.display(),
            kept.wanted,
            output.display()
        ));
    }
    Ok((exposed?, kept))
}

/// Saves an exposure under way.
struct CheckpointWriter<'a> {
    file: Option<&'a Path>,
    ours: &'a AtomicBool,
    identity: u64,
    begun: Instant,
    /// Seconds after which it is saved next, and from then to the next.
    next: f64,
    every: f64,
    /// Whether it was said that the exposure is stopping.
    told: bool,
    saved_on_stop: Option<u32>,
}

/// Whether the sums were saved because the exposure is to stop: they may then be given up in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Saved {
    OnStop,
    No,
}

impl CheckpointWriter<'_> {
    fn keep<S: RowStore>(&mut self, sums: &Sums<S>) -> Saved {
        let stopping = watch::stopping();
        if stopping && !self.told {
            self.told = true;
            say(
                "stopping: the work under way is finished and saved, which may take minutes in large pictures; once more ends at once",
            );
        }
        let Some(file) = self.file else { return Saved::No };
        // When stopped at once, for who is killed soon after, and when the pass is finished.
        let on_stop = stopping && self.saved_on_stop != Some(sums.samples().end);
        if !on_stop && self.begun.elapsed().as_secs_f64() < self.next {
            return Saved::No;
        }
        if stopping {
            self.saved_on_stop = Some(sums.samples().end);
        }
        let writing = Instant::now();
        let saved = save(file, sums, self.identity);
        self.next = self.begun.elapsed().as_secs_f64() + self.every.max(writing.elapsed().as_secs_f64() / TIME_FRACTION);
        match saved {
            Ok(()) => self.ours.store(true, Ordering::Relaxed),
            Err(e) => {
                warn(&format!("{e:#}: this exposure has no more checkpoints"));
                self.file = None;
            }
        }
        if stopping && self.file.is_some() { Saved::OnStop } else { Saved::No }
    }
}

impl Kept {
    fn of(shot: &Shot, taking: &Taking, output: Option<&Path>, what: &'static str) -> anyhow::Result<Self> {
        if taking.resume && taking.checkpoint == Some(Checkpoint::Off) {
            let wrong = anyhow!(
                "--resume beside --checkpoint off: expected one of the two, as without checkpoints there is nothing to go on from"
            );
            return Err(UsageError(wrong).into());
        }
        // Beside a pipe or a device there is nowhere to keep anything.
        let wanted = taking.checkpoint != Some(Checkpoint::Off) && !shot.lens_cap;
        let file = output.filter(|o| wanted && !output::is_stream(o)).map(beside);
        let identity = if file.is_some() { watched(what, |w| shot.identity(w))? } else { 0 };
        Ok(Kept { file, identity, wanted: shot.settings.samples.len() as u32, ours: AtomicBool::new(false) })
    }

    /// The sums to go on from, in rows that `rows` makes.
    fn start<S: RowStore>(
        &self,
        shot: &Shot,
        taking: &Taking,
        must: bool,
        rows: impl FnOnce([usize; 3]) -> std::io::Result<S>,
    ) -> anyhow::Result<Option<Sums<S>>> {
        match &self.file {
            Some(file) if !taking.no_resume => {
                let sums = resumed(shot, file, self.identity, must, rows)?;
                self.ours.store(sums.is_some(), Ordering::Relaxed);
                Ok(sums)
            }
            _ => Ok(None),
        }
    }

    fn writer(&self, taking: &Taking) -> CheckpointWriter<'_> {
        let (next, every) = match taking.checkpoint {
            Some(Checkpoint::Every(s)) => (s, s),
            _ => (FIRST_S, EVERY_S),
        };
        let (file, identity) = (self.file.as_deref(), self.identity);
        CheckpointWriter {
            file,
            ours: &self.ours,
            identity,
            begun: Instant::now(),
            next,
            every,
            told: false,
            saved_on_stop: None,
        }
    }

    /// Removes the checkpoint of a whole exposure, now that its files are written. Of one that was stopped after `taken` samples, says how far it came.
    pub fn finish(&self, stopped: bool, taken: u32) -> Option<String> {
        let file = self.file.as_deref().filter(|f| self.ours.load(Ordering::Relaxed) && f.exists());
        if !stopped {
            if let Some(file) = file {
                // Nothing can be done about one that cannot be removed.
                let _ = std::fs::remove_file(file);
            }
            return None;
        }
        let further = file.map_or(String::new(), |f| format!("; the same command goes on from {}", f.display()));
        Some(format!("stopped after {taken} of {} samples a pixel: what was written holds these{further}", self.wanted))
    }
}

impl Taken {
    /// [`Kept::finish`] of what was taken.
    pub fn finish(&self) -> Option<String> {
        self.kept.finish(self.exposed.stopped, self.exposed.plane.facts.samples)
    }
}

/// The name of a checkpoint: that of the output with an ending, cut where file systems do not take so many bytes.
pub fn beside(output: &Path) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    output.with_file_name(parts::cut(&name) + ".checkpoint")
}

/// The sums that a checkpoint holds, if it is of this exposure. `must`: else it is an error.
fn resumed<S: RowStore>(
    shot: &Shot,
    path: &Path,
    identity: u64,
    must: bool,
    rows: impl FnOnce([usize; 3]) -> std::io::Result<S>,
) -> anyhow::Result<Option<Sums<S>>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == ErrorKind::NotFound && !must => return Ok(None),
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let missing =
                anyhow!("--resume: expected the checkpoint {}; without --resume the exposure begins anew", path.display());
            return Err(UsageError(missing).into());
        }
        Err(e) => return Err(e).with_context(|| path.display().to_string()),
    };
    let film = &shot.camera.film;
    match checkpoint::read_into(&mut BufReader::new(file), identity, [film.columns, film.rows, shot.summed_bands()], rows) {
        Ok(sums) => {
            let all = &shot.settings.samples;
            // Of a pass under way the first tiles are done: "0.35 of 16".
            let text = format!("{:.2}", sums.mean_samples());
            let done = text.trim_end_matches('0').trim_end_matches('.');
            say(&format!("going on from {}: {done} of {} samples a pixel are done", path.display(), all.len()));
            Ok(Some(sums))
        }
        // Hours of another exposure may lie in it, or what is not ours at all.
        Err(e @ (CheckpointError::Foreign | CheckpointError::Unknown)) if !must => {
            let hint = "give another -o, move it away, or --no-resume to start again and overwrite it";
            Err(UsageError(anyhow!("{}: {e}; {hint}", path.display())).into())
        }
        Err(e) if must => Err(UsageError(anyhow!("{}: {e}; without --resume the exposure begins anew", path.display())).into()),
        Err(e) => {
            warn(&format!("{}: {e}; the exposure begins anew", path.display()));
            Ok(None)
        }
    }
}

fn save<S: RowStore>(path: &Path, sums: &Sums<S>, identity: u64) -> anyhow::Result<()> {
    Output::prepare(path)?.commit(|to| {
        checkpoint::write(sums, identity, to)?;
        to.flush()?;
        // Before it takes the place of the one before: after a power cut one of the two is whole.
        Ok(to.get_ref().sync_all()?)
    })?;
    Ok(())
}

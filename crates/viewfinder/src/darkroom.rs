//! Pictures that are taken in full: a queue, a thread that works through it, and the film strip with the files of what was taken.
//!
//! A picture is what `diopter shoot` makes of the same shot file, all three files of it (JPEG, DNG, EXR): its own shot file lies beside them. The files lie in a
//! temporary folder that goes away with the program. The pictures of a series are queued one by one; the first of them that is taken settles what all of them are,
//! and the scene stays built from one to the next.

use crate::lock::lock;
use crate::problem::Problem;
use crate::series::{Frame, Series};
use diopter::develop::{Developer, Recipe};
use diopter::expose::{ExposeError, ProgressReporter};
use diopter::image::dng::Storage;
use diopter::image::{ExposureFacts, ImageError, PictureSource, RawImage, exr, jpeg};
use diopter::raw_file;
use diopter::shot::{ExposureUse, FireflyChoice, Shot, ShotError, ShotFile};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::Instant;
use tempfile::TempDir;

/// Most pictures that wait.
const MOST_WAITING: usize = 36;
/// Most pictures on the strip.
const MOST_TAKEN: usize = 360;
/// Most bytes that a picture may need beside the scene: larger ones are taken from the command line, which works by strips.
const MOST_BYTES: u64 = 6 << 30;
/// Quality of the JPEG of pictures: that of `diopter shoot`.
const QUALITY: u8 = 92;
/// Longer side of the small pictures on the strip, pixels.
const THUMBNAIL: u32 = 240;

/// What makes pictures.
pub struct Darkroom {
    inside: Mutex<Inside>,
    queued: Condvar,
    folder: TempDir,
    /// The date and time as EXIF writes it.
    now: fn() -> String,
    /// How much of the picture under way is done, in millionths.
    progress: AtomicU64,
    stop: AtomicBool,
}

#[derive(Default)]
struct Inside {
    waiting: VecDeque<Waiting>,
    working: Option<Working>,
    taken: Vec<Taken>,
    failed: Option<(u64, Problem)>,
    last: u64,
}

struct Waiting {
    id: u64,
    shot: ShotFile,
    part: Option<Part>,
}

/// A picture's place in its series.
#[derive(Clone)]
struct Part {
    of: Arc<Queued>,
    /// Counts from 0.
    number: usize,
}

/// A series that was asked for.
struct Queued {
    /// The number of its first picture.
    id: u64,
    series: Series,
    /// Its shots, once the first has been metered.
    frames: OnceLock<Vec<Frame>>,
}

impl Part {
    /// The picture's own shot, once it is known.
    fn frame(&self) -> Option<&Frame> {
        self.of.frames.get()?.get(self.number)
    }

    /// For pages.
    fn told(&self) -> Value {
        let differs = self.frame().map(|f| f.differs);
        json!({ "id": self.of.id, "number": self.number + 1, "of": self.of.series.count(), "differs": differs })
    }
}

struct Working {
    id: u64,
    part: Option<Part>,
    what: &'static str,
    /// Of the exposure.
    begun: Option<Instant>,
    cancel: Arc<AtomicBool>,
}

/// A picture that was taken.
struct Taken {
    id: u64,
    part: Option<Part>,
    size: [usize; 2],
    facts: ExposureFacts,
    seconds: f64,
}

impl Darkroom {
    /// An empty one. Fails where no temporary folder can be made.
    pub fn new(now: fn() -> String) -> std::io::Result<Darkroom> {
        Ok(Darkroom {
            inside: Mutex::new(Inside::default()),
            queued: Condvar::new(),
            folder: tempfile::Builder::new().prefix("diopter-viewfinder-").tempdir()?,
            now,
            progress: AtomicU64::new(0),
            stop: AtomicBool::new(false),
        })
    }

    /// Queues a picture, or all of a series; answers with the number of the first. Fails where there is no room for all of them: a series is not begun then.
    pub fn queue(&self, shot: ShotFile, series: Option<Series>) -> Result<u64, Problem> {
        let count = series.as_ref().map_or(1, Series::count);
        let mut inside = lock(&self.inside);
        inside.check_room(count)?;
        let first = inside.last + 1;
        let of = series.map(|series| Arc::new(Queued { id: first, series, frames: OnceLock::new() }));
        for number in 0..count {
            inside.last += 1;
            let part = of.as_ref().map(|of| Part { of: of.clone(), number });
            let id = inside.last;
            inside.waiting.push_back(Waiting { id, shot: shot.clone(), part });
        }
        self.queued.notify_all();
        Ok(first)
    }

    /// Fails where so many pictures more would be too many.
    pub fn check_room(&self, count: usize) -> Result<(), Problem> {
        lock(&self.inside).check_room(count)
    }

    /// Stops a picture that waits or is being taken.
    pub fn cancel(&self, id: u64) {
        let mut inside = lock(&self.inside);
        inside.waiting.retain(|w| w.id != id);
        if let Some(working) = inside.working.as_ref().filter(|w| w.id == id) {
            working.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Stops all pictures of a series that wait or are being taken.
    pub fn cancel_series(&self, id: u64) {
        let mut inside = lock(&self.inside);
        let belongs = |part: &Option<Part>| part.as_ref().is_some_and(|p| p.of.id == id);
        inside.waiting.retain(|w| !belongs(&w.part));
        if let Some(working) = inside.working.as_ref().filter(|w| belongs(&w.part)) {
            working.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Throws a picture away.
    pub fn discard(&self, id: u64) {
        let mut inside = lock(&self.inside);
        let before = inside.taken.len();
        inside.taken.retain(|t| t.id != id);
        let gone = inside.taken.len() < before;
        drop(inside);
        if gone {
            // What cannot be removed goes away with the folder.
            let _ = std::fs::remove_dir_all(self.room(id));
        }
    }

    /// Ends the work under way and lets nothing new begin.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        let inside = lock(&self.inside);
        if let Some(working) = &inside.working {
            working.cancel.store(true, Ordering::Relaxed);
        }
        self.queued.notify_all();
    }

    /// Whether a picture is under way.
    pub fn is_busy(&self) -> bool {
        lock(&self.inside).working.is_some()
    }

    /// Queue and film strip, for pages.
    pub fn told(&self) -> (Value, Value) {
        let inside = lock(&self.inside);
        let mut queue = Vec::new();
        if let Some(w) = &inside.working {
            let done = self.progress.load(Ordering::Relaxed) as f64 / 1e6;
            let spent = w.begun.map(|b| b.elapsed().as_secs_f64());
            let left = spent.filter(|_| done > 0.01).map(|s| s * (1.0 - done) / done);
            queue.push(
                json!({ "id": w.id, "what": w.what, "done": done, "left_s": left, "series": w.part.as_ref().map(Part::told) }),
            );
        }
        let waiting =
            |w: &Waiting| json!({ "id": w.id, "what": "waiting", "done": 0, "series": w.part.as_ref().map(Part::told) });
        queue.extend(inside.waiting.iter().map(waiting));
        let film: Vec<Value> = inside
            .taken
            .iter()
            .map(|t| {
                let command = format!("diopter shoot {}", name(t.id, "toml"));
                json!({ "id": t.id, "size": t.size, "facts": t.facts, "seconds": t.seconds, "name": name(t.id, ""), "command": command,
                    "series": t.part.as_ref().map(Part::told) })
            })
            .collect();
        let failed = inside.failed.as_ref().map(|(id, problem)| json!({ "id": id, "problem": problem }));
        (json!({ "jobs": queue, "failed": failed }), Value::Array(film))
    }

    /// The file of a picture that was taken, by its ending.
    pub fn file(&self, id: u64, ending: &str) -> Option<PathBuf> {
        let taken = lock(&self.inside).taken.iter().any(|t| t.id == id);
        let known = ["jpg", "dng", "exr", "toml", "thumbnail.jpg"].contains(&ending);
        (taken && known).then(|| self.room(id).join(name(id, ending)))
    }

    fn room(&self, id: u64) -> PathBuf {
        self.folder.path().join(id.to_string())
    }

    /// Works through the queue until everything ends; `changed` is called whenever something has.
    pub fn run(&self, changed: &(dyn Fn() + Sync)) {
        // The shot of the series under way with its number.
        let mut kept: Option<(u64, Shot)> = None;
        loop {
            let mut inside = lock(&self.inside);
            let next = loop {
                if self.stop.load(Ordering::Relaxed) {
                    return;
                }
                if let Some(next) = inside.waiting.pop_front() {
                    break next;
                }
                kept = None;
                inside = self.queued.wait(inside).unwrap_or_else(PoisonError::into_inner);
            };
            let cancel = Arc::new(AtomicBool::new(false));
            self.progress.store(0, Ordering::Relaxed);
            let part = next.part.clone();
            inside.working =
                Some(Working { id: next.id, part: part.clone(), what: "preparing", begun: None, cancel: cancel.clone() });
            drop(inside);
            changed();
            let begun = Instant::now();
            let before = kept.take().filter(|(of, _)| part.as_ref().is_some_and(|p| p.of.id == *of)).map(|k| k.1);
            let result = catch_unwind(AssertUnwindSafe(|| self.take(&next, before, &cancel, changed)));
            let mut inside = lock(&self.inside);
            inside.working = None;
            match result {
                Ok(Ok((size, facts, shot))) => {
                    let facts = ExposureFacts { lens_profile: None, light_field: None, ..facts };
                    kept = part.as_ref().map(|p| (p.of.id, shot));
                    inside.taken.push(Taken { id: next.id, part, size, facts, seconds: begun.elapsed().as_secs_f64() });
                }
                Ok(Err(None)) => {}
                Ok(Err(Some(problem))) => {
                    // A series of which nothing could be settled fails as a whole.
                    if let Some(part) = part.filter(|p| p.of.frames.get().is_none()) {
                        inside.waiting.retain(|w| w.part.as_ref().is_none_or(|p| p.of.id != part.of.id));
                    }
                    inside.failed = Some((next.id, problem));
                }
                Err(_) => {
                    let problem =
                        Problem { message: "this picture made the program fail: please report it".into(), ..Default::default() };
                    inside.failed = Some((next.id, problem));
                }
            }
            let kept = inside.taken.iter().any(|t| t.id == next.id);
            drop(inside);
            if !kept {
                let _ = std::fs::remove_dir_all(self.room(next.id));
            }
            changed();
        }
    }

    fn now_doing(&self, what: &'static str, exposing: bool) {
        if let Some(working) = &mut lock(&self.inside).working {
            working.what = what;
            if exposing {
                working.begun = Some(Instant::now());
            }
        }
    }

    /// Takes a picture as `diopter shoot` does, with all its files; no problem is named where it was cancelled. `before`: the shot of the picture before in
    /// the same series. The picture's own is handed back.
    fn take(
        &self,
        next: &Waiting,
        before: Option<Shot>,
        cancel: &AtomicBool,
        changed: &(dyn Fn() + Sync),
    ) -> Result<([usize; 2], ExposureFacts, Shot), Option<Problem>> {
        let unwritten = |e: ImageError| Some(Problem { message: e.to_string(), ..Default::default() });
        let room = self.room(next.id);
        std::fs::create_dir_all(&room).map_err(|e| unwritten(e.into()))?;
        let mut quiet = |_: &str| ();
        let mut file = next.shot.clone();
        file.sequence = Default::default();
        // What the command line does where raw files are written beside pictures.
        file.render.fireflies.get_or_insert(FireflyChoice::Keep);
        let mut shot = before;
        if let Some(part) = &next.part {
            if part.of.frames.get().is_none() {
                let (settled, frames) = settle(&file, &part.of.series, cancel)?;
                shot = Some(settled);
                // Only this thread settles a series.
                let _ = part.of.frames.set(frames);
                changed();
            }
            if let Some(frame) = part.frame() {
                file = frame.file.clone();
            }
        }
        file.output.files = ["jpg", "dng", "exr"].map(|ending| PathBuf::from(name(next.id, ending))).to_vec();
        let mut shot = match shot {
            Some(mut shot) => {
                shot.change_to(&file, &mut quiet).map_err(failed)?;
                shot
            }
            None => Shot::prepare(&file, &mut quiet).map_err(failed)?,
        };
        shot.prepare_pictures(true, &mut quiet).map_err(failed)?;
        let needed = shot.bytes_needed(ExposureUse::ReadOut);
        if needed > MOST_BYTES {
            let found = format!("that takes {:.1} GB", needed as f64 / 1e9);
            let expected =
                format!("at most {:.1} GB here; the command line takes larger pictures by strips", MOST_BYTES as f64 / 1e9);
            return Err(Some(Problem::new("size", found, expected)));
        }
        shot.date = Some((self.now)());
        let watch = ProgressReporter { cancel, progress: &|done| self.progress.store((done * 1e6) as u64, Ordering::Relaxed) };
        let quiet_watch = ProgressReporter { cancel, progress: &|_| () };
        shot.focus(&quiet_watch, &mut quiet).map_err(failed)?;
        shot.meter(&quiet_watch, &mut quiet).map_err(failed)?;
        file.make_paths_absolute();
        file.output.files = ["jpg", "dng", "exr"].map(|ending| PathBuf::from(name(next.id, ending))).to_vec();
        shot.write_resolved(&mut file);
        self.now_doing("exposing", true);
        changed();
        let exposed = shot.expose_from(None, &watch, None).map_err(failed)?;
        self.now_doing("developing", false);
        changed();
        let raw = shot.read_out(&exposed.plane).map_err(failed)?;
        let denoised = shot.for_pictures(&exposed).map_err(failed)?.map(|p| shot.read_out(&p)).transpose().map_err(failed)?;
        let size = [exposed.plane.width(), exposed.plane.height()];
        drop(exposed);
        let at = |ending: &str| room.join(name(next.id, ending));
        let seen = denoised.as_ref().unwrap_or(&raw);
        let developed = |raw: &RawImage, recipe: &Recipe, to: &Path, write: &WriteInto| -> Result<(), Option<Problem>> {
            let table = if to.extension().is_some_and(|e| e == "exr") { None } else { shot.lut.clone() };
            let developer = Developer::new(raw, recipe, table).map_err(|e| failed(e.into()))?;
            written(to, |f| write(&developer, f)).map_err(unwritten)
        };
        developed(seen, &shot.recipe, &at("jpg"), &|p, f| jpeg::write(p, QUALITY, f))?;
        developed(&raw, &shot.recipe.linear_light(), &at("exr"), &|p, f| exr::write_picture(p, exr::Precision::Half, f))?;
        let mut small = shot.recipe.clone();
        small.resize = Default::default();
        small.resize.long_edge = Some(THUMBNAIL);
        small.output = Default::default();
        developed(seen, &small, &at("thumbnail.jpg"), &|p, f| jpeg::write(p, QUALITY, f))?;
        written(&at("dng"), |f| raw_file::write_image(&raw, Storage::Sixteen, &Recipe::default(), f)).map_err(unwritten)?;
        written(&at("toml"), |f| Ok(f.write_all(file.to_toml().as_bytes())?)).map_err(unwritten)?;
        if cancel.load(Ordering::Relaxed) {
            return Err(None);
        }
        Ok((size, raw.header.facts.clone(), shot))
    }
}

impl Inside {
    fn check_room(&self, count: usize) -> Result<(), Problem> {
        if self.waiting.len() + count > MOST_WAITING {
            let found = format!("{} pictures that would wait", self.waiting.len() + count);
            return Err(Problem::new("shoot", found, format!("{MOST_WAITING} at most: some time, or some cancelled")));
        }
        if self.taken.len() + count > MOST_TAKEN {
            let found = format!("{} pictures on the film", self.taken.len() + count);
            return Err(Problem::new("shoot", found, format!("{MOST_TAKEN} at most: some thrown away")));
        }
        Ok(())
    }
}

/// What is told of a picture that was not taken; nothing where it was cancelled.
fn failed(e: ShotError) -> Option<Problem> {
    match e {
        ShotError::Expose(ExposeError::Cancelled) => None,
        other => Some(Problem::from(other)),
    }
}

/// Focuses and meters for a series: the shot, and those of all its pictures.
fn settle(file: &ShotFile, series: &Series, cancel: &AtomicBool) -> Result<(Shot, Vec<Frame>), Option<Problem>> {
    let mut quiet = |_: &str| ();
    let watch = ProgressReporter { cancel, progress: &|_| () };
    let mut shot = Shot::prepare(file, &mut quiet).map_err(failed)?;
    shot.focus(&watch, &mut quiet).map_err(failed)?;
    shot.meter(&watch, &mut quiet).map_err(failed)?;
    let mut settled = file.clone();
    shot.write_resolved(&mut settled);
    let frames = series.frames(&mut shot, &settled)?;
    Ok((shot, frames))
}

/// Writes a picture into a file.
type WriteInto = dyn Fn(&dyn PictureSource, &mut BufWriter<File>) -> Result<(), ImageError>;

fn written(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), ImageError>) -> Result<(), ImageError> {
    let mut file = BufWriter::new(File::create(path)?);
    write(&mut file)?;
    Ok(file.flush()?)
}

/// The name of a picture's file, or without an ending that of the picture.
fn name(id: u64, ending: &str) -> String {
    match ending {
        "" => format!("photo-{id:04}"),
        ending => format!("photo-{id:04}.{ending}"),
    }
}

#[cfg(test)]
mod tests;

//! The thread that owns the camera: it turns a changed shot into frames, the first at once, then finer and finer ones.
//!
//! What a change does not touch is not done again. A change of the development develops the read-out at hand anew; one of the read-out (ISO, white) reads the
//! plane at hand; another time in front of a scene that stands still scales that plane, since electrons are proportional to time; everything else
//! is a new exposure of the scene as it is built ([`prepare`]). Exposures are joined from ranges of samples (0..4, 4..8, 8..16 ...) that merge to the
//! whole: first of a small picture, then of one of half the size, then of the whole one. Outliers and the renderer's own noise are taken out of each, as of
//! pictures that are taken (`denoising`), if the shot does not say otherwise.
//!
//! The first frame of a change is never cancelled: else no frame would come while a hand turns a dial faster than the first frame is made. It is as large
//! as can be made in [`FIRST_S`]: of an exposure at hand a smaller copy is developed where the whole takes longer, and the whole follows once the hand rests.

mod facts;

use self::facts::{ExposureKey, MeterKey, exposure_key, setting_ev100, stands_still};
use crate::frame;
use crate::lock::lock;
use crate::problem::Problem;
use crate::session::{Asked, Live, Session};
use diopter::denoising::{Denoise, Filter};
use diopter::expose::{ExposeError, ProgressReporter};
use diopter::image::{ExposureFacts, FocalPlane, Raster, jpeg};
use diopter::quantity::{FocusTo, LengthMm};
use diopter::shot::sections::{CameraSection, FocusSection};
use diopter::shot::{FireflyChoice, Inputs, Shot, ShotError, ShotFile};
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Most pixels of a frame: 960 × 640.
const MOST_PIXELS: usize = 960 * 640;
/// Sides of the first, small picture as parts of the whole one; the finest that is expected within [`FIRST_S`] is taken.
const PARTS: [usize; 5] = [2, 3, 4, 6, 8];
/// Time to expose and denoise a first frame, s: with read-out, development and the way to the page it makes 100 ms.
const FIRST_S: f64 = 0.07;
/// Time to develop the first frame of an exposure at hand, s.
const FIRST_DEVELOPED_S: f64 = 0.035;
/// Most by which an exposure at hand is made smaller for it.
const MOST_REDUCED: usize = 4;
/// How long no other change must come before the whole of it is developed, s: steps of a dial under a hand come faster.
const REST: Duration = Duration::from_millis(90);
/// How long a page is given to show a frame before the next is worked on, s: a browser on the same cores draws it meanwhile.
const SHOWING: Duration = Duration::from_millis(60);
/// Shortest side of a small picture.
const LEAST_SIDE: usize = 24;
/// Samples that are joined to a picture at once, at most: some seconds of a picture of [`MOST_PIXELS`], which shows little change by then.
const LONGEST_RANGE: u32 = 8;
/// Samples by default, and at most.
const SAMPLES: u32 = 64;
const MOST_SAMPLES: u32 = 4096;
/// Samples of the first ranges of the half and of the whole picture: enough for the filter to make a picture of, and where the half is left for the whole.
const FIRST_OF_HALF: u32 = 2;
const LAST_OF_HALF: u32 = 6;
const FIRST_OF_WHOLE: u32 = 4;
/// Quality of the JPEG of frames.
const QUALITY: u8 = 88;
/// Readings of the meter that differ by less are the same, EV.
const SAME_EV: f64 = 0.005;

/// Why there is no frame.
enum Stopped {
    /// Something else is asked for.
    Cancelled,
    /// It cannot be.
    Refused(Problem),
}

impl From<ShotError> for Stopped {
    fn from(e: ShotError) -> Self {
        match e {
            ShotError::Expose(ExposeError::Cancelled) => Stopped::Cancelled,
            other => Stopped::Refused(other.into()),
        }
    }
}

/// An exposure at hand.
struct Exposed {
    key: ExposureKey,
    /// Time it was exposed for, s.
    time_s: f64,
    plane: Arc<FocalPlane>,
    /// The same without the renderer's noise, once a frame has asked for it.
    denoised: Option<Arc<FocalPlane>>,
    /// Whether that is of fewer samples or pixels, or was filtered coarsely: it serves for the first frame of a change alone.
    is_former: bool,
    /// The next sample.
    next: u32,
    /// Columns of the picture as a part of the whole one's: 1 is the whole.
    part: usize,
}

/// The engine's own state.
struct Engine<'a> {
    session: &'a Session,
    shot: Option<Shot>,
    exposed: Option<Exposed>,
    read: Option<(MeterKey, Option<f64>)>,
    filter: Filter,
    /// Seconds that a sample of a pixel takes, about, and those that denoising a pixel of a first frame takes.
    pace_s: f64,
    denoising_s: f64,
    /// And reading out and developing one.
    development_s: f64,
    frames: u64,
    focus: Option<Value>,
    /// The camera and its focus that the report is of.
    focused: Option<(CameraSection, FocusSection)>,
}

/// How a frame is made.
#[derive(Clone, Copy, PartialEq)]
enum FrameKind {
    /// The first of a change: in time, of all pixels or of fewer.
    First,
    /// Of all pixels; given up once something else is asked for.
    Whole,
}

/// Runs until the session ends. `first`: a shot that is prepared already.
pub fn run(session: &Session, first: Option<Shot>) {
    let mut engine = Engine {
        session,
        shot: first,
        exposed: None,
        read: None,
        filter: Filter::BuiltIn,
        pace_s: 2e-6,
        denoising_s: 1e-6,
        development_s: 2e-7,
        frames: 0,
        focus: None,
        focused: None,
    };
    // The network where it is installed; the built-in filter where it is not or does not work.
    if let Ok(Some(filter)) = Filter::open(Denoise::Auto, None, &mut |_| ()) {
        engine.filter = filter;
    }
    let mut known = 0;
    while let Some(mut asked) = session.next(known) {
        known = asked.version;
        let answer = catch_unwind(AssertUnwindSafe(|| engine.answer(&mut asked)));
        match answer {
            Ok(Ok(()) | Err(Stopped::Cancelled)) => {}
            Ok(Err(Stopped::Refused(problem))) => session.refused(&asked, problem),
            Err(_) => {
                // A fault of ours: the page goes on, with everything made anew.
                (engine.shot, engine.exposed, engine.read) = (None, None, None);
                let problem =
                    Problem { message: "this shot made the program fail: please report it".into(), ..Default::default() };
                session.refused(&asked, problem);
            }
        }
    }
}

/// The one place where a shot is prepared: from the one before, whose built scene is kept where it serves, or from nothing.
fn prepare(before: &mut Option<Shot>, file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
    match before {
        Some(shot) => shot.change_to(file, warn),
        None => {
            *before = Some(prepared(file, warn)?);
            Ok(())
        }
    }
}

/// A shot whose lens is set many times a second. Fails as [`Shot::prepare`].
pub fn prepared(file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
    Shot::prepare_with(file, Inputs { draft: true, ..Default::default() }, warn)
}

/// The shot as the finder shows it: without what only the picture is to have.
pub fn for_finder(shot: &ShotFile) -> ShotFile {
    let mut file = shot.clone();
    let r = &mut file.render;
    (r.denoise, r.oidn, r.time_limit, r.samples, r.quick) = (Some(Denoise::Off), None, None, None, false);
    // What no picture can have is refused as it is.
    r.spp = match r.spp {
        Some(spp) if !(1..=diopter::shot::MOST_SAMPLES).contains(&spp) => Some(spp),
        spp => Some(spp.unwrap_or(SAMPLES).min(MOST_SAMPLES)),
    };
    r.fireflies = Some(FireflyChoice::Keep);
    // Photon maps take longer than a frame.
    r.integrator.get_or_insert_with(|| "path".into());
    file.sequence = Default::default();
    // A page shows sRGB, in the size of the finder.
    (file.develop.output, file.develop.resize) = Default::default();
    file
}

/// Size of the whole picture in the finder.
fn finder_size([width, height]: [usize; 2]) -> [usize; 2] {
    let scale = (MOST_PIXELS as f64 / (width * height) as f64).sqrt().min(1.0);
    [width, height].map(|n| ((n as f64 * scale).round() as usize).max(1))
}

/// Size of a part of it.
fn part_size(whole: [usize; 2], part: usize) -> [usize; 2] {
    whole.map(|n| n.div_ceil(part).max(LEAST_SIDE.min(n)))
}

impl Engine<'_> {
    fn answer(&mut self, asked: &mut Asked) -> Result<(), Stopped> {
        let begun = Instant::now();
        let session = self.session;
        let mut warnings: Vec<String> = Vec::new();
        let mut warn = |w: &str| {
            if warnings.len() < 50 && !warnings.iter().any(|known| known == w) {
                warnings.push(w.to_owned());
            }
        };
        let mut file = for_finder(&asked.shot);
        if !self.shot.as_ref().is_some_and(|shot| shot.keeps_scene(&file)) {
            session.busy(Some("preparing"));
        }
        prepare(&mut self.shot, &file, &mut warn)?;
        let Some(shot) = &mut self.shot else { return Ok(()) };
        let full = [shot.camera.film.columns, shot.camera.film.rows];
        let whole = finder_size(full);
        (shot.settings.truth, shot.settings.time_limit_s) = (true, None);

        // Autofocus looks once; then the lens stays where it was set.
        let go_on = AtomicBool::new(false);
        let first_watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        let watch = ProgressReporter { cancel: &session.cancel, progress: &|_| () };
        let looks = matches!(file.focus.distance, Some(FocusTo::Auto | FocusTo::At(_)));
        if looks {
            session.busy(Some("focusing"));
        }
        match shot.focus(if looks { &watch } else { &first_watch }, &mut warn) {
            // The report is that of another focus, or of another view.
            Ok(None) if self.focused.as_ref().is_some_and(|of| *of != (asked.shot.camera.clone(), asked.shot.focus.clone())) => {
                (self.focus, self.focused) = (None, None);
            }
            Ok(None) => {}
            Ok(Some(report)) => {
                self.focus = serde_json::to_value(&report).ok();
                let mut settled = asked.shot.clone();
                settled.focus.distance = Some(FocusTo::Extension(LengthMm(report.extension_mm)));
                session.focused(asked, &settled);
                self.focused = Some((asked.shot.camera.clone(), asked.shot.focus.clone()));
                file = for_finder(&asked.shot);
                shot.change_to(&file, &mut warn)?;
                (shot.settings.truth, shot.settings.time_limit_s) = (true, None);
            }
            Err(e) => return Err(e.into()),
        }

        // The reading at hand for the first frame, and a new one behind it where it may be another.
        let meter_key = |shot: &Shot, file: &ShotFile| MeterKey {
            exposure: exposure_key(shot, file, true),
            metering: file.exposure.metering.clone(),
            at: file.exposure.metering_at,
        };
        let wanted = meter_key(shot, &file);
        let at_hand = self.read.as_ref().filter(|(key, _)| key.exposure.scene == wanted.exposure.scene).map(|r| r.1);
        let mut stale = !self.read.as_ref().is_some_and(|(key, _)| *key == wanted);
        match at_hand {
            Some(reading) => shot.apply_meter_reading(reading, &mut warn)?,
            None => {
                shot.meter(&first_watch, &mut warn)?;
                self.read = Some((wanted.clone(), shot.facts().metered_ev100));
                stale = false;
            }
        }
        let prepared_s = begun.elapsed().as_secs_f64();
        let found = self.found(asked, full, warnings.clone());
        session.prepared(found);

        // What is at hand, if it serves.
        self.keep_or_drop_exposure(&file);
        let Some(shot) = &self.shot else { return Ok(()) };
        let spp = shot.settings.spp;
        if self.exposed.is_none() {
            let part = self.first_part(whole);
            self.expose(&file, whole, part, 0..1, &first_watch)?;
        }
        let complete = self.send(asked, begun, prepared_s, whole, spp, FrameKind::First)?;
        session.shown(asked);
        self.wait_until_shown()?;
        if !complete {
            self.rest()?;
            self.send(asked, begun, prepared_s, whole, spp, FrameKind::Whole)?;
        }

        // The meter looks again.
        if stale {
            let Some(shot) = &mut self.shot else { return Ok(()) };
            let before = self.read.as_ref().and_then(|r| r.1);
            // As the file says, without what the camera has chosen by the reading before.
            let renew = |shot: &mut Shot| {
                shot.change_to(&file, &mut |_| ())?;
                (shot.settings.truth, shot.settings.time_limit_s) = (true, None);
                shot.focus(&first_watch, &mut |_| ()).map(drop)
            };
            renew(shot)?;
            let mut warned = Vec::new();
            shot.meter(&watch, &mut |w| warned.push(w.to_owned()))?;
            let after = shot.facts().metered_ev100;
            let same = match (before, after) {
                (Some(a), Some(b)) => (a - b).abs() < SAME_EV,
                (a, b) => a == b,
            };
            if same {
                // What was exposed by the reading before goes on: samples of another time could not be joined to it.
                renew(shot)?;
                shot.apply_meter_reading(before, &mut |_| ())?;
            }
            self.read = Some((wanted, if same { before } else { after }));
            warnings.extend(warned.into_iter().filter(|w| !warnings.contains(w)).collect::<Vec<_>>());
            let found = self.found(asked, full, warnings);
            session.prepared(found);
            if !same {
                self.keep_or_drop_exposure(&file);
                if self.exposed.is_some() {
                    self.send(asked, begun, prepared_s, whole, spp, FrameKind::Whole)?;
                }
            }
        }

        // Finer and finer.
        loop {
            self.go_on()?;
            let (part, next) = self.exposed.as_ref().map_or((0, 0), |e| (e.part, e.next));
            let (part, samples) = match part {
                // Nothing is at hand: what was exposed does not serve the new reading.
                0 => (self.first_part(whole), 0..1),
                1 if next >= spp => return Ok(()),
                1 => (1, next..next + next.clamp(1, LONGEST_RANGE)),
                2 if next < LAST_OF_HALF && next < spp => (2, next..LAST_OF_HALF),
                2 => (1, 0..FIRST_OF_WHOLE),
                _ => (2, 0..FIRST_OF_HALF),
            };
            self.expose(&file, whole, part, samples.start..samples.end.min(spp), &watch)?;
            self.go_on()?;
            self.send(asked, begun, prepared_s, whole, spp, FrameKind::Whole)?;
            self.wait_until_shown()?;
        }
    }

    /// Waits until no change has come for a while.
    fn rest(&self) -> Result<(), Stopped> {
        let until = Instant::now() + REST;
        while Instant::now() < until {
            self.go_on()?;
            std::thread::sleep(Duration::from_millis(2));
        }
        self.go_on()
    }

    /// Waits until a page has shown the latest frame, or for as long as that may take.
    fn wait_until_shown(&self) -> Result<(), Stopped> {
        let until = Instant::now() + SHOWING;
        let shown = || self.session.shown_frame.load(Ordering::Relaxed) >= self.frames;
        while self.session.frames.receiver_count() > 0 && !shown() && Instant::now() < until {
            self.go_on()?;
            std::thread::sleep(Duration::from_millis(1));
        }
        self.go_on()
    }

    /// Whether nothing else is asked for.
    fn go_on(&self) -> Result<(), Stopped> {
        if self.session.cancel.load(Ordering::Relaxed) { Err(Stopped::Cancelled) } else { Ok(()) }
    }

    /// How small the first picture is.
    fn first_part(&self, whole: [usize; 2]) -> usize {
        let fits = |part: &&usize| {
            let [w, h] = part_size(whole, **part);
            (w * h) as f64 * (self.pace_s + self.denoising_s) <= FIRST_S
        };
        *PARTS.iter().find(fits).unwrap_or(&PARTS[PARTS.len() - 1])
    }

    /// Keeps the exposure at hand if it is one of this shot, scaled where only its time differs and nothing moves; else drops it.
    fn keep_or_drop_exposure(&mut self, file: &ShotFile) {
        let (Some(shot), Some(exposed)) = (&self.shot, &mut self.exposed) else { return };
        let (still, time_s) = (stands_still(shot), shot.shutter.unwrap_or(1.0));
        let key = exposure_key(shot, file, still);
        let factor = time_s / exposed.time_s;
        if exposed.key != key || !still && factor != 1.0 || !(factor > 0.0 && factor.is_finite()) {
            self.exposed = None;
            return;
        }
        let facts = shot.facts();
        for plane in [Some(&mut exposed.plane), exposed.denoised.as_mut()].into_iter().flatten() {
            let plane = Arc::make_mut(plane);
            if factor != 1.0 {
                let factor = factor as f32;
                plane.mean.data.iter_mut().chain(&mut plane.half_difference.data).for_each(|v| *v *= factor);
            }
            let before = std::mem::replace(&mut plane.facts, ExposureFacts { iso: 0.0, iso_set: facts.iso, ..facts.clone() });
            let now = &mut plane.facts;
            (now.first_sample, now.samples, now.seed, now.light_scale) =
                (before.first_sample, before.samples, before.seed, before.light_scale);
            (now.denoised, now.denoiser) = (before.denoised, before.denoiser);
        }
        exposed.time_s = time_s;
    }

    /// Exposes a range of samples of the whole picture or a smaller one, and joins it to what is at hand.
    fn expose(
        &mut self,
        file: &ShotFile,
        whole: [usize; 2],
        part: usize,
        samples: std::ops::Range<u32>,
        watch: &ProgressReporter,
    ) -> Result<(), Stopped> {
        let Some(shot) = &mut self.shot else { return Ok(()) };
        let [columns, rows] = part_size(whole, part);
        (shot.camera.film.columns, shot.camera.film.rows) = (columns, rows);
        shot.settings.samples = samples.clone();
        // Depth and what the filter is guided by are the same for all samples.
        shot.settings.truth = samples.start == 0;
        let begun = Instant::now();
        let plane = shot.expose_from(None, watch, None)?.plane;
        let paths = (columns * rows) as f64 * f64::from(samples.end - samples.start);
        // Averaged over a few frames: what a pixel takes differs from place to place.
        self.pace_s = 0.5 * self.pace_s + 0.5 * begun.elapsed().as_secs_f64() / paths;
        let still = stands_still(shot);
        let (key, time_s) = (exposure_key(shot, file, still), shot.shutter.unwrap_or(1.0));
        let before = self.exposed.take();
        let denoised = before.as_ref().filter(|e| e.key == key && e.time_s == time_s).and_then(|e| e.denoised.clone());
        let plane = match before.filter(|e| e.part == part && e.next == samples.start && samples.start > 0) {
            None => plane,
            Some(before) => FocalPlane::merge(&[Arc::unwrap_or_clone(before.plane), plane])
                .map_err(|e| Stopped::Refused(Problem { message: e.to_string(), ..Default::default() }))?,
        };
        let plane = Arc::new(plane);
        self.exposed = Some(Exposed { key, time_s, plane, denoised, is_former: true, next: samples.end, part });
        Ok(())
    }

    /// Denoises, reads out and develops what is at hand, and sends it to all pages. Whether all its pixels were shown.
    fn send(
        &mut self,
        asked: &Asked,
        begun: Instant,
        prepared_s: f64,
        whole: [usize; 2],
        spp: u32,
        frame_kind: FrameKind,
    ) -> Result<bool, Stopped> {
        let cancel = &self.session.cancel;
        let go_on = || match frame_kind == FrameKind::Whole && cancel.load(Ordering::Relaxed) {
            true => Err(Stopped::Cancelled),
            false => Ok(()),
        };
        let (Some(shot), Some(exposed)) = (&self.shot, &mut self.exposed) else { return Ok(true) };
        let exposed_s = begun.elapsed().as_secs_f64();
        let part = exposed.part;
        // Behind microlenses neighbours see other parts of the scene; without light there is nothing to denoise.
        let wanted = asked.shot.render.denoise != Some(Denoise::Off);
        let denoises = wanted && shot.camera.film.microlenses.is_none() && !shot.lens_cap;
        let denoised = exposed.denoised.as_ref().filter(|_| denoises && (frame_kind == FrameKind::First || !exposed.is_former));
        let is_former = denoised.is_some() && exposed.is_former;
        let filters = denoises && denoised.is_none();
        let at_hand = denoised.unwrap_or(&exposed.plane);
        let pixels = at_hand.width() * at_hand.height();
        // What is exposed for this frame has the size that its time allows.
        let takes_s = |n: usize| (pixels / (n * n)) as f64 * (self.development_s + if filters { self.denoising_s } else { 0.0 });
        let fits = |n: &usize| takes_s(*n) <= FIRST_DEVELOPED_S;
        let reduces = frame_kind == FrameKind::First && exposed.part <= 2 && shot.camera.film.microlenses.is_none();
        let factor = if reduces { (1..MOST_REDUCED).find(fits).unwrap_or(MOST_REDUCED) } else { 1 };
        let filtering = Instant::now();
        let shown = if factor > 1 { Arc::new(at_hand.reduced(factor)) } else { at_hand.clone() };
        let plane = if filters {
            let calm = frame::without_outliers(&shown);
            Arc::new(match frame_kind {
                FrameKind::First => self.filter.denoise_coarsely(&calm)?,
                FrameKind::Whole => self.filter.denoise_unless(&calm, cancel)?.ok_or(Stopped::Cancelled)?,
            })
        } else {
            shown
        };
        // A smaller picture, a former one, or one that is filtered coarsely, is followed by the whole one.
        let complete = factor == 1 && !is_former && !(filters && frame_kind == FrameKind::First);
        let size = [plane.width(), plane.height()];
        if filters {
            if frame_kind == FrameKind::First {
                let pixel_s = filtering.elapsed().as_secs_f64() / (size[0] * size[1]) as f64;
                self.denoising_s = 0.5 * self.denoising_s + 0.5 * pixel_s;
            }
            (exposed.denoised, exposed.is_former) = (Some(plane.clone()), frame_kind == FrameKind::First);
        }
        let denoised_s = begun.elapsed().as_secs_f64();
        let developing = Instant::now();
        go_on()?;
        let raw = shot.read_out(&plane)?;
        go_on()?;
        let mut picture = shot.develop(&raw)?;
        go_on()?;
        // A frame is looked at and thrown away: no EXIF.
        picture.facts = None;
        let mut bytes = Vec::new();
        jpeg::write(&picture, QUALITY, &mut bytes)
            .map_err(|e| Stopped::Refused(Problem { message: e.to_string(), ..Default::default() }))?;
        let blur = frame::blur_map(&plane.truth, &shot.camera, &shot.facts());
        self.frames += 1;
        let s = |seconds: f64| (seconds * 1e4).round() / 1e4;
        let header = json!({
            "frame": self.frames, "version": asked.version, "size": size, "whole": whole, "samples": exposed.next, "of_samples": spp,
            "done": exposed.part == 1 && exposed.next >= spp && complete, "denoised": denoises,
            "histogram": frame::histograms(&raw), "histogram_stops": frame::STOPS,
            "blur": blur.as_ref().map(|b| json!({ "size": b.size, "steps": frame::BLUR_STEPS, "bytes": b.cells.len() })),
            "seconds": { "waited": s((begun - asked.since).as_secs_f64()), "prepared": s(prepared_s), "exposed": s(exposed_s), "denoised": s(denoised_s), "sent": s(begun.elapsed().as_secs_f64()) },
        });
        let frame = frame::encode(self.frames, &header, &bytes, blur.as_ref().map_or(&[], |b| &b.cells));
        let live = Live {
            plane,
            lens: shot.camera.lens.clone(),
            film_mm: [shot.camera.film.width_mm, shot.camera.film.height_mm],
            recipe: shot.recipe.clone(),
            setting_ev100: setting_ev100(shot),
            raw,
        };
        *lock(&self.session.live) = Some(Arc::new(live));
        self.session.frames.send_replace(Some(Arc::new(frame)));
        let pixel_s = developing.elapsed().as_secs_f64() / (size[0] * size[1]) as f64;
        self.development_s = 0.5 * self.development_s + 0.5 * pixel_s;
        Ok(complete || part > 2)
    }
}

/// One channel of a raster, for those who look at single pixels.
pub(crate) fn at(raster: &Raster<f32>, [x, y]: [f64; 2]) -> (usize, usize) {
    let place = |v: f64, n: usize| ((v * n as f64) as usize).min(n.saturating_sub(1));
    (place(x, raster.width), place(y, raster.height))
}

#[cfg(test)]
mod tests;

//! Films for event sensors: the light of a scene at many moments, through the lens, onto the pixels of an [`EventCamera`].
//!
//! The scene is exposed at moments so short that nothing moves in them (1 µs), by equal steps or finer where the light changes fast; between them the logarithm of each pixel's photocurrent is
//! straight. All moments have the same random numbers: in pixels where nothing changes the light is the same to the last bit, and the renderer's noise makes no events; where something moves it
//! may make some, fewer with more samples a pixel.

use crate::expose::{ExposeError, ProgressReporter};
use crate::npy;
use crate::program::Mode;
use crate::quantity::{Iso, IsoChoice, Seconds, Size};
use crate::shot::{ExposureUse, FireflyChoice, Inputs, Shot, ShotError, ShotFile};
use crate::{denoising::Denoise, files};
use diopter_sensor::events::{Event, EventCamera, EventSensor};
use std::path::Path;

/// How long a moment is exposed, s.
const MOMENT_S: f64 = 1e-6;
/// Most moments of a film that steps evenly.
const MOST_STEPS: f64 = 1e7;
/// How often a step is halved at most where the light changes fast.
const MOST_HALVINGS: u32 = 4;

/// An event sensor by name or from a TOML file. Fails on a name that is not known, and on a file that cannot be read or has a wrong entry.
pub fn read_event_sensor(name: &str) -> Result<EventSensor, ShotError> {
    if !name.ends_with(".toml") {
        return Ok(EventSensor::named(name)?);
    }
    let text = files::read_text(Path::new(name)).map_err(|e| ShotError::Read { path: name.into(), reason: e.to_string() })?;
    Ok(EventSensor::parse(&text, name)?)
}

/// How a film for an event sensor is taken.
#[derive(Clone, Debug)]
pub struct EventFilm {
    /// The sensor.
    pub sensor: EventSensor,
    /// How long, s.
    pub duration_s: f64,
    /// From one moment to the next, s.
    pub step_s: f64,
    /// A step in which the logarithm of a pixel's photocurrent changes by more than this is halved, up to four times; `None`: all steps are alike.
    pub most_change: Option<f64>,
    /// Seed of mismatch and noise.
    pub seed: u64,
    /// Keep the light of all moments.
    pub keep_light: bool,
}

/// The light that pixels were fed with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Light {
    /// Moments, s since the beginning.
    pub times_s: Vec<f64>,
    /// Photocurrent, e⁻/s, `[moment][row][column]`.
    pub current_e_s: Vec<f32>,
}

impl Light {
    /// Photocurrents, e⁻/s, as a file of numpy: float32, `[moment][row][column]`. `size`: columns, rows.
    pub fn npy(&self, [width, height]: [usize; 2]) -> Vec<u8> {
        npy::with_shape(&self.current_e_s, &[self.times_s.len(), height, width])
    }

    fn keep(&mut self, at_s: f64, light: &[f32]) {
        self.times_s.push(at_s);
        self.current_e_s.extend_from_slice(light);
    }
}

/// What was taken.
#[derive(Clone, Debug)]
pub struct TakenEvents {
    /// In the order of their times.
    pub events: Vec<Event>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Scene time at which it begins, s: stamps count from here.
    pub begun_s: f64,
    /// Moments that were exposed.
    pub moments: usize,
    /// Photocurrent of the pixels, mean over all at the first moment, e⁻/s.
    pub mean_current_e_s: f64,
    /// The light, where it was to be kept.
    pub light: Option<Light>,
}

fn wrong(what: &'static str, found: impl ToString, expected: &str) -> ShotError {
    ShotError::Value { what: what.into(), found: found.to_string(), expected: expected.into() }
}

/// The shot that is exposed at each moment.
fn momentary(file: &ShotFile, film: &EventFilm) -> Result<ShotFile, ShotError> {
    let mut file = file.clone();
    let e = &file.exposure;
    let of_frames = [
        ("--shutter", e.shutter.is_some()),
        ("--mode", e.mode.is_some()),
        ("--iso, --iso-min or --iso-max", e.iso.is_some() || e.iso_min.is_some() || e.iso_max.is_some()),
        ("--slowest", e.slowest.is_some()),
        ("--metering", e.metering.is_some() || e.metering_at.is_some()),
        ("--compensation", e.compensation.is_some()),
        ("a shutter of its own", file.shutter != Default::default()),
        ("--baseline", e.baseline.is_some()),
    ];
    if let Some((what, _)) = of_frames.iter().find(|(_, is_set)| *is_set) {
        let expected = "none of the settings of cameras that take frames: an event sensor has no exposure time, meter or ISO speed; its aperture, ND filter and lens say how much light there is";
        return Err(wrong("exposure", what, expected));
    }
    let not_taken =
        [("a flash", file.flash.is_some()), ("a sequence", file.sequence != Default::default()), ("a lens cap", e.lens_cap)];
    if let Some((what, _)) = not_taken.iter().find(|(_, is_set)| *is_set) {
        return Err(wrong("events", what, "none: --duration says how long events are taken"));
    }
    let r = &file.render;
    let of_pictures = [
        ("--denoise", r.denoise.is_some()),
        ("--fireflies", r.fireflies.is_some()),
        ("--truth-channels", r.truth_channels.is_some()),
    ];
    if let Some((what, _)) = of_pictures.iter().find(|(_, is_set)| *is_set) {
        return Err(wrong(
            "events",
            what,
            "none: events come from light as it is, every sample counted, and have no truth beside them but --keep-light",
        ));
    }
    if let Some(body) = &file.camera.body {
        return Err(wrong("body", body, "none: --sensor says whose pixels they are"));
    }
    if let Some(camera) = &file.camera.calibration {
        return Err(wrong("camera", camera.display(), "a lens (--lens): a calibration is one of another sensor's pixels"));
    }
    if !(film.duration_s > 0.0 && film.duration_s <= 4e7) {
        return Err(wrong("duration", Seconds(film.duration_s), "a time above 0"));
    }
    if !(film.step_s >= 2.0 * MOMENT_S && film.duration_s / film.step_s <= MOST_STEPS) {
        return Err(wrong("step", Seconds(film.step_s), "2 us or more, and at most ten million steps"));
    }
    if film.most_change.is_some_and(|c| !(c > 0.0)) {
        return Err(wrong("most-change", film.most_change.unwrap_or(0.0), "above 0, a change of the logarithm of the light"));
    }
    file.exposure.mode = Some(Mode::Manual.name().into());
    file.exposure.shutter = Some(Seconds(MOMENT_S));
    file.exposure.iso = Some(IsoChoice::Fixed(Iso(100.0)));
    let [width, height] = film.sensor.light.pixels;
    file.render.size.get_or_insert(Size { width, height });
    file.render.denoise = Some(Denoise::Off);
    file.render.truth_channels = None;
    Ok(file)
}

/// Takes a film. `warn` gets what was found odd, each once. Fails on settings that only cameras with frames have (exposure time, mode, ISO speed, shutter, body, flash,
/// sequence, lens cap), on times out of range, as [`Shot::prepare`] and [`Shot::meter`], and with [`ExposeError::Cancelled`].
pub fn take(
    file: &ShotFile,
    film: &EventFilm,
    watch: &ProgressReporter,
    warn: &mut dyn FnMut(&str),
) -> Result<TakenEvents, ShotError> {
    let file = momentary(file, film)?;
    let mut told = Vec::new();
    let mut once = |text: &str| {
        if !told.iter().any(|t| t == text) {
            told.push(text.to_owned());
            warn(text);
        }
    };
    let inputs = Inputs { sensor: Some(film.sensor.light.clone()), ..Default::default() };
    let mut shot = Shot::prepare_with(&file, inputs, &mut once)?;
    shot.settings.truth = false;
    shot.fireflies = FireflyChoice::Keep;
    shot.check_memory(ExposureUse::Plane, None)?;
    let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
    shot.focus(&quiet, &mut once)?;
    shot.meter(&quiet, &mut once)?;
    let begun_s = shot.at_s();
    let size = [shot.camera.film.columns, shot.camera.film.rows];
    let mut camera = EventCamera::new(film.sensor.clone(), size, film.seed)?;
    let mut light = |at_s: f64| -> Result<Vec<f32>, ShotError> {
        shot.advance_to(begun_s + at_s, 0, &mut once)?;
        let plane = shot.expose(&quiet)?;
        // Rays through a lens may put a little less than no light into a pixel next to an edge.
        Ok(plane.mean.data.iter().map(|e| (e / MOMENT_S as f32).max(0.0)).collect())
    };
    let mut events = Vec::new();
    let mut last = light(0.0)?;
    let mean_current_e_s = last.iter().map(|c| f64::from(*c)).sum::<f64>() / last.len() as f64;
    camera.feed(0.0, &last)?;
    let mut kept = film.keep_light.then(Light::default);
    kept.iter_mut().for_each(|k| k.keep(0.0, &last));
    let mut moments = 1;
    let steps = (film.duration_s / film.step_s).ceil().max(1.0) as u64;
    let dark = film.sensor.dark_e_s as f32;
    let (mut at, mut taken) = (0.0, 0);
    while taken < steps {
        // Moments that are still to be fed, the next one last, with how often their step was halved.
        let end = film.duration_s.min(film.step_s * (taken + 1) as f64);
        let mut waiting = vec![(end, light(end)?, 0)];
        moments += 1;
        while let Some((to, next, halved)) = waiting.pop() {
            let change = last.iter().zip(&next).map(|(a, b)| ((b + dark) / (a + dark)).ln().abs()).fold(0.0f32, f32::max);
            let middle = 0.5 * (at + to);
            if film.most_change.is_some_and(|most| f64::from(change) > most)
                && halved < MOST_HALVINGS
                && middle - at >= 2.0 * MOMENT_S
            {
                waiting.push((to, next, halved + 1));
                waiting.push((middle, light(middle)?, halved + 1));
                moments += 1;
                continue;
            }
            events.extend(camera.feed(to, &next)?);
            kept.iter_mut().for_each(|k| k.keep(to, &next));
            (last, at) = (next, to);
        }
        taken += 1;
        (watch.progress)(taken as f64 / steps as f64);
        if watch.cancel.load(std::sync::atomic::Ordering::Relaxed) {
            return Err(ExposeError::Cancelled.into());
        }
    }
    // The camera's clock is the film's.
    events.iter_mut().for_each(|e| e.time_s += begun_s);
    Ok(TakenEvents { events, size, begun_s, moments, mean_current_e_s, light: kept })
}

//! Metering: what a camera's meter reads, on small exposures of the scene as framed, seen by its own sensor.
//!
//! EV at ISO 100 = log2(L · 100 / K), L the luminance that the pattern finds, K = 12.5 cd·s/(m²·lx·s): ISO 2720 allows 10.6 to
//! 13.4; Canon, Nikon and Sekonic use 12.5. The meter looks through the lens: a lens that loses light, or stands far out for a near
//! subject, or a filter, makes the scene darker for it. Light of a scene is gathered once, on few pixels; then the sensor reads it out
//! again and again, with its noise and its limits, at the exposure that the last reading asked for, until two agree. Pixels that are
//! full count as what they can hold: a lamp in the frame does not darken the picture without bound. Never looks at scene depth. Where a
//! scene is a void (no surface, no surroundings, no air) there is nothing to expose for: patterns are means over the rest, as if the photographer
//! metered the subject. No real frame has such a place.
//!
//! Sources: ISO 2720;
//! Nikon, D810 manual (12 mm circle, 75 %; spot 4 mm). The matrix pattern is our own, makers keep theirs to themselves.

use crate::camera::{Camera, Film};
use crate::expose::{ExposeError, ProgressReporter, Response, Settings, expose, may_make_photons};
use crate::from_light::{Channels, Place, focal_plane};
use crate::shot::ShotError;
use crate::shutter::Shutter;
use diopter_image::{ExposureFacts, FocalPlane, Raster, RawImage};
use diopter_light::cie;
use diopter_light::color::luminance;
use diopter_light::spectrum::{Table, blackbody};
use diopter_scene::light::Environment;
use diopter_scene::{Description, Scene};
use diopter_sensor::{Reading, Sensor, calibration, read_out};
use glam::{DMat4, DVec4, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Reflected-light meter constant, cd·s/(m²·lx·s), as most makers use it. Source: ISO 2720.
pub const K: f64 = 12.5;

/// Pixels across a probe exposure, and its samples a pixel. Both are the meter's own: what is metered depends neither on the number nor on
/// the range of the picture's samples, so parts of an exposure are exposed alike. 16 samples of 96 × 64 pixels are 1e5 paths (0.1 s of
/// a simple scene).
const PROBE_COLUMNS: usize = 96;
/// Fewest pixels down: a cell of every colour pattern.
const LEAST_ROWS: usize = 6;
const PROBE_SAMPLES: u32 = 16;
/// The same of the spot, of which alone pixels are exposed, and its paths: those within its circle read a light whose paths scatter by 100 % within 0.006 EV (one deviation).
const SPOT_COLUMNS: usize = 16;
const SPOT_PATHS: usize = 1 << 16;
/// This part of the samples is enough where it tells what the pattern reads within that, as a fraction (one deviation): 0.015 EV.
const FIRST_OF: u32 = 4;
const ENOUGH: f64 = 0.0105;
/// Readings until two agree; within so much, EV.
const MOST_READINGS: u64 = 16;
const AGREE_EV: f64 = 0.02;
/// Fraction of saturation that dark current may fill in a reading.
const MOST_DARK: f64 = 0.25;
/// Most that the exposure changes between two readings, and the longest it becomes, s.
const MOST_CHANGE: f64 = 64.0;
const LONGEST_S: f64 = 4096.0;
/// Circles of the patterns, as fractions of the width of the picture: 12 mm and 4 mm of 36 mm.
const CENTRE_CIRCLE: f64 = 12.0 / 36.0;
const CENTRE_WEIGHT: f64 = 0.75;
const SPOT_CIRCLE: f64 = 4.0 / 36.0;
/// The matrix pattern: deviation of its weight about the middle in widths of the picture, the weight far from it, and how much
/// brighter than the median a cell may count (EV): a sky or a window stays what it is.
const MATRIX_SPREAD: f64 = 0.3;
const MATRIX_FLOOR: f64 = 0.25;
const MATRIX_LIMIT_EV: f64 = 2.5;
/// The highlight pattern: this fraction of the cells is brighter than what it puts (EV) below saturation.
const HIGHLIGHT_FRACTION: f64 = 0.005;
const HIGHLIGHT_BELOW_EV: f64 = 1.0 / 3.0;

/// Illuminants a meter is made for.
const LIGHTS: [&str; 8] = ["A", "D50", "D65", "D75", "FL2", "FL11", "LED-B1", "LED-B3"];
/// Temperatures of lamps warmer than the standard illuminants: embers, candles, old bulbs.
const WARM_K: [f32; 2] = [1800.0, 2300.0];
/// Keeps channels that see nearly the same from large weights of opposite sign, as a fraction of the largest square.
const RIDGE: f64 = 1e-4;

/// What a meter looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Pattern {
    /// The whole frame alike.
    #[default]
    Average,
    /// Three quarters from a circle in the middle.
    CentreWeighted,
    /// A small circle.
    Spot,
    /// The whole frame, more of the middle, without what is far brighter than the rest.
    Matrix,
    /// The brightest parts, which are to stay within range.
    Highlight,
}

impl Pattern {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Pattern); 5] = [
        ("average", Pattern::Average),
        ("centre-weighted", Pattern::CentreWeighted),
        ("spot", Pattern::Spot),
        ("matrix", Pattern::Matrix),
        ("highlight", Pattern::Highlight),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// The pattern of a name; "center" is "centre", "evaluative" is "matrix".
    pub fn named(name: &str) -> Option<Pattern> {
        let name = name.trim().to_lowercase().replace("center", "centre").replace([' ', '_'], "-");
        match name.as_str() {
            "evaluative" | "multi" => Some(Pattern::Matrix),
            "centre" => Some(Pattern::CentreWeighted),
            name => Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1),
        }
    }
}

/// EV at ISO 100 of a luminance in cd/m²: log2(L · 100 / K), K = 12.5 (ISO 2720).
pub fn ev100_of_luminance(luminance: f64) -> f64 {
    (luminance * 100.0 / K).log2()
}

/// Exposure time (s) that exposes a metered EV100 at an f-number and ISO: t = N² / 2^EV · 100 / S.
pub fn shutter_for(ev100: f64, f_number: f64, iso: f64) -> f64 {
    f_number * f_number / ev100.exp2() * 100.0 / iso
}

/// EV at ISO 100 of a setting: log2(N²/t · 100/S).
pub fn ev100_of_setting(f_number: f64, exposure_s: f64, iso: f64) -> f64 {
    (f_number * f_number / exposure_s * 100.0 / iso).log2()
}

/// The same of a picture, by the T-stop where it is known, the effective time and the speed (100 without one).
pub fn ev100_of_facts(facts: &ExposureFacts) -> f64 {
    let stop = if facts.t_number > 0.0 { facts.t_number } else { facts.f_number };
    let time_s = facts.shutter.as_ref().map_or(facts.exposure_s, |s| s.effective_s);
    ev100_of_setting(stop, time_s, facts.speed().unwrap_or(100.0))
}

/// The camera with the few large pixels by which it is metered.
fn probing(camera: &Camera) -> Camera {
    let rows = (PROBE_COLUMNS * camera.film.rows).div_ceil(camera.film.columns).clamp(LEAST_ROWS, 4 * PROBE_COLUMNS);
    let film = Film { columns: PROBE_COLUMNS, rows, microlenses: None, ..camera.film };
    Camera { film, ..camera.clone() }
}

/// Whether an exposure of a camera's picture with so many samples a pixel holds what a meter wants to know: at least its pixels and its paths.
pub(crate) fn is_enough(camera: &Camera, spp: u32) -> bool {
    let [film, probe] = [&camera.film, &probing(camera).film];
    let paths = |film: &Film, spp: u32| film.columns as f64 * film.rows as f64 * f64::from(spp);
    film.columns >= PROBE_COLUMNS && film.rows >= LEAST_ROWS && paths(film, spp) >= paths(probe, PROBE_SAMPLES)
}

/// A part of the picture as it is metered.
struct Probe {
    camera: Camera,
    /// `[left, top, width, height]`, fractions of the picture.
    piece: [f64; 4],
    /// Samples a pixel.
    samples: u32,
    /// Fraction of each pixel that is no void ([`seen`]).
    seen: Vec<f64>,
}

impl Probe {
    /// The whole picture.
    fn whole(scene: &Scene, camera: &Camera) -> Probe {
        let camera = probing(camera);
        Probe { piece: [0.0, 0.0, 1.0, 1.0], samples: PROBE_SAMPLES, seen: seen(scene, &camera), camera }
    }

    /// The square about the spot, as far as it lies in the picture; `None` where the whole picture shows nothing there.
    fn spot(&self, scene: &Scene, at: [f64; 2]) -> Option<Probe> {
        let film = &self.camera.film;
        let size = [SPOT_CIRCLE, SPOT_CIRCLE * film.width_mm / film.height_mm];
        let from = [0, 1].map(|k| (at[k] - 0.5 * size[k]).clamp(0.0, 1.0));
        let extent = [0, 1].map(|k| (at[k] + 0.5 * size[k]).clamp(0.0, 1.0) - from[k]);
        let [columns, rows] = [0, 1].map(|k| (SPOT_COLUMNS as f64 * extent[k] / size[k] / 2.0).round() as usize * 2);
        let cells = Cells::of(self);
        let is_there = |i: usize| self.seen[i] > 0.0 && cells.distance(i, at) <= 0.5 * SPOT_CIRCLE;
        if columns == 0 || rows == 0 || !(0..self.seen.len()).any(is_there) {
            return None;
        }
        let piece = [from[0], from[1], extent[0], extent[1]];
        let Film { center_mm, width_mm, height_mm, .. } = film.piece(piece, columns, rows);
        let film = Film { center_mm, width_mm, height_mm, columns, rows, ..*film };
        let camera = Camera { film, ..self.camera.clone() };
        // At the margin of the picture the same paths go through fewer pixels.
        let samples = (SPOT_PATHS / (columns * rows)).next_power_of_two() as u32;
        Some(Probe { seen: seen(scene, &camera), camera, piece, samples })
    }
}

/// What a camera sees that meters: few samples, a second of light at once. `samples`: which of how many a pixel.
fn probe(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    response: &Response,
    (samples, spp): (Range<u32>, u32),
    watch: &ProgressReporter,
) -> Result<FocalPlane, ExposeError> {
    let settings = Settings {
        spp,
        samples,
        time_limit_s: None,
        truth: false,
        means_only: true,
        shutter_times: Default::default(),
        ..settings.clone()
    };
    let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
    // As if the scene stood still for a second: what it shows at this moment.
    expose(scene, camera, &Shutter::global(1.0), response, &settings, &ExposureFacts::default(), &quiet)
}

/// Nothing but a white sky of 1 cd/m².
fn even_sky() -> Scene {
    let environment = Some(Environment::uniform(Vec3::ONE));
    Scene::build(Description { environment, ..Description::default() }).expect("a sky and nothing else")
}

/// Fraction of each of a camera's pixels (`[row][column]`) where there is something to see, by the chief ray of its middle: 0 in a void, 1
/// elsewhere, also where the lens shows nothing. 1 everywhere where no pixel sees anything, and in scenes with surroundings or air.
pub(crate) fn seen(scene: &Scene, camera: &Camera) -> Vec<f64> {
    let (columns, rows) = (camera.film.columns, camera.film.rows);
    let full = vec![1.0; columns * rows];
    if scene.lights().environment.is_some() || scene.air().is_some() {
        return full;
    }
    let sees = |i: usize| {
        let at = camera.film_point((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
        // Beyond the image circle the picture is dark whatever the scene is.
        let Ok(ray) = camera.lens.chief_ray(at) else { return 1.0 };
        f64::from(u8::from(scene.intersect(&camera.to_world(&ray, 0.0), f32::INFINITY).is_some()))
    };
    let seen: Vec<f64> = (0..columns * rows).into_par_iter().map(sees).collect();
    if seen.contains(&1.0) { seen } else { full }
}

/// Fraction of the rays of a cell that the lens must let pass for it to count; below, radiance is uncertain ([`expose`]).
const LIT: f64 = 0.1;

/// Mean luminance of the scene as framed, cd/m²: what a scene without a scale is scaled by, not what a camera meters. Only what the lens shows
/// counts, not the dark beyond its image circle and not a void. 0 where it shows nothing. Fails when cancelled.
pub fn mean_luminance(scene: &Scene, camera: &Camera, settings: &Settings, watch: &ProgressReporter) -> Result<f64, ExposeError> {
    let camera = probing(camera);
    // Of the scene, not of what a polariser leaves of it.
    let settings = Settings { polarizer: None, ..settings.clone() };
    let plane = probe(scene, &camera, &settings, &Response::luminance(), (0..PROBE_SAMPLES, PROBE_SAMPLES), watch)?.mean;
    let (mut sum, mut lit) = (0.0, 0.0);
    // A cell without light may be a dark part of the scene: only the lens tells.
    let place = |i: usize| [(i % plane.width) as f64, (i / plane.width) as f64];
    let shown: Vec<bool> = (0..plane.data.len()).into_par_iter().map(|i| camera.passing(place(i), LIT)).collect();
    for ((luminance, shown), seen) in plane.data.iter().zip(shown).zip(seen(scene, &camera)) {
        if shown {
            sum += f64::from(*luminance);
            lit += seen;
        }
    }
    Ok(if lit == 0.0 { 0.0 } else { sum / lit })
}

/// A camera's meter.
pub struct Meter<'a> {
    /// What sees.
    pub sensor: &'a Sensor,
    /// How it is read.
    pub reading: &'a Reading,
    /// Where it looks.
    pub pattern: Pattern,
    /// Middle of the spot, 0 to 1 across and down the picture.
    pub at: [f64; 2],
    /// Fraction of the light that a filter before the lens lets through.
    pub filter: f64,
}

/// Fraction of the white level from which a cell counts as saturated.
const SATURATED: f64 = 0.99;

/// Cells of a picture as a meter sees them.
struct Cells {
    columns: usize,
    rows: usize,
    /// Which part of the picture they cover: `[left, top, width, height]`, fractions.
    piece: [f64; 4],
    /// Height over width of the picture.
    shape: f64,
    /// cd/m²; may be negative by noise.
    luminance: Vec<f64>,
    /// Largest fraction of saturation that a channel has, dark current included.
    level: Vec<f64>,
    /// Fraction of the cell that is no void.
    seen: Vec<f64>,
}

impl Meter<'_> {
    /// EV at ISO 100 of the scene as framed, by the light that comes through the lens; `None` in darkness. Fails when cancelled.
    pub fn read(
        &self,
        scene: &Scene,
        camera: &Camera,
        settings: &Settings,
        white: &Table,
        watch: &ProgressReporter,
    ) -> Result<Option<f64>, ExposeError> {
        let mut probe = Probe::whole(scene, camera);
        if self.pattern == Pattern::Spot
            && let Some(spot) = probe.spot(scene, self.at)
        {
            probe = spot;
        }
        let t_number = camera.lens.t_number();
        let scale = self.luminance_of_channels(camera, t_number, white);
        let mut plane = self.probe(scene, &probe, settings, &scale, watch)?;
        plane.mean.data.iter_mut().for_each(|v| *v *= self.filter as f32);
        Ok(self.settle(plane, &probe, &scale, t_number, white))
    }

    /// The same by an exposure of the whole picture at hand, which records the radiance behind this lens and the filter in red, green and blue (`expose --radiance`): for scenes
    /// that stand still and sensors that do not tell polarisation. The pattern is not [`Pattern::Spot`]. Fails as [`Meter::read`], and on a plane that does not hold radiance.
    pub fn read_radiance(
        &self,
        plane: &FocalPlane,
        scene: &Scene,
        camera: &Camera,
        settings: &Settings,
        white: &Table,
        watch: &ProgressReporter,
    ) -> Result<Option<f64>, ShotError> {
        let whole = Probe::whole(scene, camera);
        let t_number = camera.lens.t_number();
        let cells = [whole.camera.film.columns, whole.camera.film.rows];
        let electrons =
            |light: &Raster<f32>| focal_plane(light, &Channels::LinearSrgb, Place::Scene { t_number }, None, self.sensor, 1.0);
        let mut seen = electrons(&plane.mean.gathered(cells))?;
        // What lens and film leave of it at each cell: electrons of an even white sky, over those of a lossless lens on its axis.
        let settings = Settings { light_scale: 1.0, polarizer: None, ..settings.clone() };
        let samples = PROBE_SAMPLES / FIRST_OF;
        let of_sky = probe(&even_sky(), &whole.camera, &settings, &Response::sensor(self.sensor), (0..samples, samples), watch)?;
        let on_axis = electrons(&Raster { width: 1, height: 1, channels: 3, data: vec![1.0; 3] })?;
        let channels = seen.mean.channels;
        for (seen, sky) in seen.mean.data.chunks_exact_mut(channels).zip(of_sky.mean.data.chunks_exact(channels)) {
            let arriving = sky.iter().zip(&on_axis.mean.data);
            seen.iter_mut().zip(arriving).for_each(|(seen, (sky, on_axis))| *seen *= sky / on_axis);
        }
        Ok(self.settle(seen, &whole, &self.luminance_of_channels(camera, t_number, white), t_number, white))
    }

    /// Readings of what is seen in a second, each at the exposure that the last one asked for, until two agree. `None` in darkness.
    fn settle(&self, mut plane: FocalPlane, probe: &Probe, scale: &[f64], t_number: f64, white: &Table) -> Option<f64> {
        let per_second = plane.mean.data.clone();
        let iso = self.reading.iso;
        let step = self.sensor.at_iso(iso).ok()?;
        let mut time = shutter_for(10.0, t_number, iso);
        let mut last = None;
        let mut brightest = Vec::new();
        let dark_e_per_s = self.sensor.mean_dark_current(self.reading.temperature_c);
        // Beyond, dark current alone fills wells, and nothing is seen; of two readings the first, where numbers change over from one to the other.
        let longest = if dark_e_per_s > 0.0 {
            LONGEST_S.min(MOST_DARK * self.sensor.saturation_e(&step).min(self.sensor.full_well_e) / dark_e_per_s)
        } else {
            LONGEST_S
        };
        for k in 0..MOST_READINGS {
            plane.mean.data.iter_mut().zip(&per_second).for_each(|(v, e)| *v = (f64::from(*e) * time) as f32);
            plane.facts.exposure_s = time;
            let reading = Reading { seed: self.reading.seed.wrapping_add(k << 32 | 0x3e7e5), ..self.reading.clone() };
            let raw = read_out(&plane, self.sensor, &reading, white).ok()?;
            let mut cells = Cells::new(&raw, probe, scale, step.gain_e_per_dn / time, dark_e_per_s * time / step.gain_e_per_dn);
            if cells.is_blind(self.pattern, self.at) && brightest.is_empty() {
                time /= MOST_CHANGE;
                continue;
            }
            cells.remember(&mut brightest);
            let wanted = self.wanted_time(&cells, time, t_number);
            let Some(wanted) = wanted else {
                // Nothing but noise: look longer.
                if time >= longest {
                    return None;
                }
                time = (time * MOST_CHANGE).min(longest.max(time));
                continue;
            };
            let agrees = (wanted / time).log2().abs() < AGREE_EV;
            last = Some(wanted);
            if agrees || time >= longest && wanted > time {
                break;
            }
            time = wanted.clamp(time / MOST_CHANGE, time * MOST_CHANGE).min(longest);
        }
        last.map(|t| ev100_of_setting(t_number, t, iso))
    }

    /// What is seen of as many samples as the pattern needs.
    fn probe(
        &self,
        scene: &Scene,
        of: &Probe,
        settings: &Settings,
        scale: &[f64],
        watch: &ProgressReporter,
    ) -> Result<FocalPlane, ExposeError> {
        let (response, all) = (Response::sensor(self.sensor), of.samples);
        // Noise of single cells shifts what is no mean; photons take as long for few samples as for all.
        let at_once =
            matches!(self.pattern, Pattern::Matrix | Pattern::Highlight) || may_make_photons(scene, settings.integrator);
        let first = if at_once { all } else { all / FIRST_OF };
        let begun = probe(scene, &of.camera, settings, &response, (0..first, all), watch)?;
        if first == all || self.deviation(&begun, of, scale).is_some_and(|deviation| deviation < ENOUGH) {
            return Ok(begun);
        }
        let rest = probe(scene, &of.camera, settings, &response, (first..all, all), watch)?;
        Ok(FocalPlane::merge(&[begun, rest]).expect("two parts of one exposure"))
    }

    /// Standard deviation of what the pattern reads of a plane, as a fraction; `None` of patterns that are no means, and in the dark.
    fn deviation(&self, plane: &FocalPlane, of: &Probe, scale: &[f64]) -> Option<f64> {
        let luminance = |data: &[f32]| -> Vec<f64> {
            data.chunks_exact(scale.len()).map(|p| p.iter().zip(scale).map(|(e, s)| f64::from(*e) * s).sum()).collect()
        };
        let cells = Cells { luminance: luminance(&plane.mean.data), ..Cells::of(of) };
        let weights = cells.weights(self.pattern, self.at)?;
        let mean: f64 = weights.iter().zip(&cells.luminance).map(|(w, l)| w * l).sum();
        let half_differences = luminance(&plane.half_difference.data);
        let variance: f64 = weights.iter().zip(&half_differences).map(|(w, d)| (w * d).powi(2)).sum();
        (mean > 0.0).then(|| variance.sqrt() / mean)
    }

    /// cd/m² that an electron a second stands for, a channel each, so that their sum is the luminance: fitted over the patches of a colour
    /// chart under many lights (least squares of relative errors), because a meter does not know the light it is in. Channels that see no colours cannot tell lights apart,
    /// and near infrared is light to them: they read grey in what is `white` as it is, and all else by the electrons that it makes.
    fn luminance_of_channels(&self, camera: &Camera, t_number: f64, white: &Table) -> Vec<f64> {
        let responses = self.sensor.band_responses();
        let pixel = std::f64::consts::PI / (4.0 * t_number * t_number) * camera.film.pixel_area_mm2 * crate::mount::M2_PER_MM2;
        let n = self.sensor.cfa.channel_count();
        if self.sensor.cfa.is_colorless() {
            let shines = |nm: f32| if (380.0..=780.0).contains(&nm) { white.at(nm) } else { 0.0 };
            let signal = calibration::signals(self.sensor, &responses, &shines) * (pixel / luminance(shines));
            return (0..n).map(|c| 1.0 / (n as f64 * signal[c])).collect();
        }
        let (mut squares, mut sums) = (DMat4::ZERO, DVec4::ZERO);
        let lights = LIGHTS.into_iter().filter_map(cie::illuminant).chain(
            WARM_K.map(|kelvin| Table::new(380.0, 5.0, (0..=80).map(|i| blackbody(380.0 + 5.0 * i as f32, kelvin)).collect())),
        );
        for light in lights {
            for patch in cie::colorchecker() {
                let shines = |nm: f32| if (380.0..=780.0).contains(&nm) { light.at(nm) * patch.reflectance.at(nm) } else { 0.0 };
                // Signals for 1 cd/m².
                let signal = calibration::signals(self.sensor, &responses, &shines) * (pixel / luminance(shines));
                squares += DMat4::from_cols(signal * signal.x, signal * signal.y, signal * signal.z, signal * signal.w);
                sums += signal;
            }
        }
        // Channels that are not there have weight 0.
        for c in n..4 {
            squares.col_mut(c)[c] = 1.0;
        }
        let scale = (0..n).map(|c| squares.col(c)[c]).fold(0.0, f64::max);
        (0..n).for_each(|c| squares.col_mut(c)[c] += RIDGE * scale);
        let weights = squares.inverse() * sums;
        (0..n).map(|c| weights[c]).collect()
    }

    /// The exposure time that a reading taken at `time` asks for; `None` when it has seen nothing.
    fn wanted_time(&self, cells: &Cells, time: f64, t_number: f64) -> Option<f64> {
        if self.pattern == Pattern::Highlight {
            let mut levels: Vec<f64> =
                cells.level.iter().zip(&cells.seen).filter(|(_, seen)| **seen > 0.0).map(|(l, _)| *l).collect();
            if levels.is_empty() {
                return None;
            }
            levels.sort_by(f64::total_cmp);
            let level = levels[((1.0 - HIGHLIGHT_FRACTION) * (levels.len() - 1) as f64) as usize];
            let full = level >= 0.999;
            return (level > 0.0).then(|| if full { time / 4.0 } else { time * (-HIGHLIGHT_BELOW_EV).exp2() / level });
        }
        let found = cells.luminance_by(self.pattern, self.at);
        (found > 0.0 && found.is_finite()).then(|| shutter_for(ev100_of_luminance(found), t_number, self.reading.iso))
    }
}

impl Cells {
    /// The pixels themselves, without what is seen there.
    fn of(probe: &Probe) -> Cells {
        let film = &probe.camera.film;
        let (seen, [.., width, height]) = (probe.seen.clone(), probe.piece);
        let shape = film.height_mm / height / (film.width_mm / width);
        Cells { columns: film.columns, rows: film.rows, piece: probe.piece, shape, luminance: vec![], level: vec![], seen }
    }

    /// Cells as large as the colour pattern, at least 2 × 2 pixels. `scale`: cd/m² an electron a second stands for, a channel each;
    /// `per_dn`: electrons a second that a DN stands for; `dark_dn`: what dark current adds to a pixel on average, which covered pixels tell a camera (optical black).
    fn new(raw: &RawImage, probe: &Probe, scale: &[f64], per_dn: f64, dark_dn: f64) -> Cells {
        let h = &raw.header;
        let side = h.cfa.columns().max(h.cfa.rows()).max(2);
        let (columns, rows) = ((raw.mosaic.width / side).max(1), (raw.mosaic.height / side).max(1));
        let n = h.cfa.channel_count();
        let (mut luminance, mut level, mut fractions) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..rows {
            for column in 0..columns {
                let (mut sums, mut counts) = ([0.0; 4], [0.0; 4]);
                let mut there = 0.0;
                for y in (row * side..(row + 1) * side).filter(|y| *y < raw.mosaic.height) {
                    for x in (column * side..(column + 1) * side).filter(|x| *x < raw.mosaic.width) {
                        let c = h.cfa.channel_at(x, y);
                        sums[c] += f64::from(raw.mosaic.data[y * raw.mosaic.width + x]) - h.black_level;
                        counts[c] += 1.0;
                        there += probe.seen.get(y * raw.mosaic.width + x).copied().unwrap_or(1.0);
                    }
                }
                let mean: Vec<f64> = (0..n).map(|c| if counts[c] > 0.0 { sums[c] / counts[c] } else { 0.0 }).collect();
                luminance.push(mean.iter().zip(scale).map(|(dn, s)| (dn - dark_dn) * per_dn * s).sum());
                level.push(mean.iter().fold(0.0, |a: f64, m| a.max(m / (h.white_level - h.black_level))));
                fractions.push(there / counts.iter().sum::<f64>().max(1.0));
            }
        }
        Cells { columns, rows, luminance, level, seen: fractions, ..Cells::of(probe) }
    }

    /// Whether most of what the pattern looks at is saturated: then it is not known how bright it is.
    fn is_blind(&self, pattern: Pattern, at: [f64; 2]) -> bool {
        let even = || self.seen.iter().map(|seen| f64::from(u8::from(*seen > 0.0))).collect();
        let weights: Vec<f64> = self.weights(pattern, at).unwrap_or_else(even);
        let saturated: f64 = weights.iter().zip(&self.level).filter(|(_, level)| **level >= SATURATED).map(|(w, _)| w).sum();
        saturated > 0.5 * weights.iter().sum::<f64>()
    }

    /// What is saturated is at least as bright as a shorter reading found: without that, a small lamp in the dark would count for less and less as
    /// readings grow longer, without end.
    fn remember(&mut self, brightest: &mut Vec<f64>) {
        if brightest.is_empty() {
            brightest.clone_from(&self.luminance);
            return;
        }
        for ((now, level), before) in self.luminance.iter_mut().zip(&self.level).zip(brightest) {
            if *level >= SATURATED {
                *now = now.max(*before);
            }
            *before = *now;
        }
    }

    /// Distance of a cell from a place of the picture in widths of the picture.
    fn distance(&self, i: usize, from: [f64; 2]) -> f64 {
        let [left, top, width, height] = self.piece;
        let x = left + width * ((i % self.columns) as f64 + 0.5) / self.columns as f64;
        let y = top + height * ((i / self.columns) as f64 + 0.5) / self.rows as f64;
        (x - from[0]).hypot((y - from[1]) * self.shape)
    }

    /// Weights of the luminances by `weight`, so that they give the mean over what is no void: a cell that is partly void is as dark as its luminance says but counts by its fraction
    /// alone. `None` where nothing counts.
    fn weighted(&self, weight: impl Fn(usize) -> f64) -> Option<Vec<f64>> {
        let is_there = |i: usize| self.seen[i] > 0.0;
        let all = 0..self.luminance.len();
        let total: f64 = all.clone().filter(|i| is_there(*i)).map(|i| weight(i) * self.seen[i]).sum();
        (total > 0.0).then(|| all.map(|i| if is_there(i) { weight(i) / total } else { 0.0 }).collect())
    }

    /// What each luminance counts in a pattern that is a mean; the plain one where it looks at nothing else. `None` of other patterns.
    fn weights(&self, pattern: Pattern, at: [f64; 2]) -> Option<Vec<f64>> {
        let middle = if pattern == Pattern::Spot { at } else { [0.5; 2] };
        let average = || self.weighted(|_| 1.0).unwrap_or_else(|| vec![0.0; self.luminance.len()]);
        let nearest = || {
            let all = 0..self.luminance.len();
            let nearest = all.min_by(|a, b| self.distance(*a, middle).total_cmp(&self.distance(*b, middle)));
            nearest.and_then(|nearest| self.weighted(|i| f64::from(u8::from(i == nearest)))).unwrap_or_else(average)
        };
        let within = |circle: f64| move |i: usize| f64::from(u8::from(self.distance(i, middle) <= 0.5 * circle));
        match pattern {
            Pattern::Average => Some(average()),
            Pattern::Spot => Some(self.weighted(within(SPOT_CIRCLE)).unwrap_or_else(nearest)),
            Pattern::CentreWeighted => {
                let inside = self.weighted(within(CENTRE_CIRCLE)).unwrap_or_else(nearest);
                let outside = self.weighted(|i| 1.0 - within(CENTRE_CIRCLE)(i)).unwrap_or_else(|| inside.clone());
                let both = inside.iter().zip(&outside);
                Some(both.map(|(inside, outside)| CENTRE_WEIGHT * inside + (1.0 - CENTRE_WEIGHT) * outside).collect())
            }
            Pattern::Matrix | Pattern::Highlight => None,
        }
    }

    /// What a pattern reads, cd/m², over what is no void.
    fn luminance_by(&self, pattern: Pattern, at: [f64; 2]) -> f64 {
        let sum = |weights: &[f64]| weights.iter().zip(&self.luminance).map(|(w, l)| w * l).sum::<f64>();
        let average = || self.weights(Pattern::Average, at).map_or(0.0, |weights| sum(&weights));
        match (self.weights(pattern, at), pattern) {
            (Some(weights), _) => sum(&weights),
            (None, Pattern::Matrix) => {
                // Luminance of the part of a cell that is there.
                let plain = |i: usize| self.luminance[i] / self.seen[i];
                let there: Vec<usize> = (0..self.luminance.len()).filter(|i| self.seen[*i] > 0.0).collect();
                let mut sorted: Vec<f64> = there.iter().map(|i| plain(*i)).collect();
                sorted.sort_by(f64::total_cmp);
                let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
                // In a frame that is mostly black (a stage, the night) the median says nothing: twice the mean always counts.
                let limit = (median * MATRIX_LIMIT_EV.exp2()).max(2.0 * average());
                let weight = |i: usize| MATRIX_FLOOR + (-0.5 * (self.distance(i, [0.5; 2]) / MATRIX_SPREAD).powi(2)).exp();
                let weights = self.weighted(weight).unwrap_or_default();
                // Weights count by the part that is there.
                there.iter().map(|i| weights[*i] * self.seen[*i] * plain(*i).min(limit)).sum()
            }
            (None, _) => average(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sunny_sixteen_is_ev_15() {
        assert!((ev100_of_setting(16.0, 1.0 / 125.0, 100.0) - 14.966).abs() < 1e-3);
        assert!((shutter_for(14.966, 16.0, 100.0) * 125.0 - 1.0).abs() < 1e-3);
        assert!((ev100_of_luminance(4096.0) - 15.0).abs() < 1e-9);
    }

    #[test]
    fn patterns_look_where_they_say() {
        // A bright left half, and one very bright cell in a corner.
        let (columns, rows) = (48, 32);
        let luminance: Vec<f64> = (0..columns * rows)
            .map(|i| {
                if i == 0 {
                    1e6
                } else if i % columns < columns / 2 {
                    400.0
                } else {
                    100.0
                }
            })
            .collect();
        let n = luminance.len();
        let cells = Cells {
            columns,
            rows,
            piece: [0.0, 0.0, 1.0, 1.0],
            shape: 32.0 / 48.0,
            level: vec![0.0; n],
            luminance,
            seen: vec![1.0; n],
        };
        assert!((cells.luminance_by(Pattern::Spot, [0.8, 0.5]) - 100.0).abs() < 1e-9);
        assert!((cells.luminance_by(Pattern::Spot, [0.2, 0.5]) - 400.0).abs() < 1e-9);
        assert!((cells.luminance_by(Pattern::Matrix, [0.5; 2]) - 250.0).abs() < 2.0);
        let centre = cells.luminance_by(Pattern::CentreWeighted, [0.5; 2]);
        let average = cells.luminance_by(Pattern::Average, [0.5; 2]);
        assert!(average > 890.0 && centre > 400.0 && centre < 450.0, "{average} {centre}");
        assert_eq!(Pattern::named("Center weighted"), Some(Pattern::CentreWeighted));
    }

    #[test]
    fn cells_in_a_void_do_not_count() {
        // A square of 200 cd/m² in black nothing; cells at its rim are half void.
        let (columns, rows) = (48, 32);
        let seen = |i: usize| match ((i % columns).abs_diff(14), (i / columns).abs_diff(12)) {
            (..4, ..4) => 1.0,
            (..5, ..5) => 0.5,
            _ => 0.0,
        };
        let seen: Vec<f64> = (0..columns * rows).map(seen).collect();
        let luminance = seen.iter().map(|s| 200.0 * s).collect();
        let (piece, shape) = ([0.0, 0.0, 1.0, 1.0], 32.0 / 48.0);
        let cells = Cells { columns, rows, piece, shape, luminance, level: vec![0.0; columns * rows], seen };
        for (pattern, at) in [
            (Pattern::Average, [0.5; 2]),
            (Pattern::CentreWeighted, [0.5; 2]),
            (Pattern::Matrix, [0.5; 2]),
            (Pattern::Spot, [0.3, 0.4]),
            // Where there is nothing, the whole of what is there counts.
            (Pattern::Spot, [0.9, 0.9]),
        ] {
            let found = cells.luminance_by(pattern, at);
            assert!((found - 200.0).abs() < 1e-6, "{} at {at:?}: {found}", pattern.name());
        }
    }
}

//! The exposure: pixels × samples of light through lens and shutter onto the film.
//!
//! Tiles are shared out over the threads of the current rayon pool. A pixel's numbers depend on nothing but seed, pixel and
//! sample, and are summed in double precision in an order that is always the same, so the result is the same for any number of threads and
//! however often it was interrupted ([`Sums`]).

use crate::camera::{Camera, Film};
use crate::mount::M2_PER_MM2;
use crate::quantity::SpectralBands;
use crate::row_store::{PagedRows, RowStore};
use crate::shutter::{Moments, Place, Shutter};
use diopter_develop::denoise::farthest_log_depth_of;
use diopter_image::focal_plane::{Band, BandUnit, FocalPlaneSource, STRIP_STEP, Truth};
use diopter_image::{ExposureFacts, FocalPlane, ImageError, Raster};
use diopter_lens::batch::single::LANES;
use diopter_lens::compound::{Aim, CompoundLens, Exits, Samples, Scratch};
use diopter_lens::microlens::{Aimed, Behind};
use diopter_lens::pupil::PupilTable;
use diopter_lens::{Lens, LensRay, Projection};
use diopter_light::random::{Sampler, SamplerKind, Set};
use diopter_light::spectrum::Table;
use diopter_light::wavelength::{FIRST_NM, LAST_NM, RGB_NM, WavelengthSampler, Wavelengths};
use diopter_scene::{PathSettings, Scene};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// Pixels a side of the squares that threads take.
const TILE: usize = 16;

/// Pixels around a tile that its samples may land in: through a real lens each wavelength has its own film point. What lands
/// farther away is kept pixel by pixel.
const MARGIN: usize = 4;

/// What the film records.
#[derive(Clone, Debug)]
pub struct Response {
    /// Names and unit of the bands.
    pub bands: Vec<Band>,
    /// For electrons: electrons per joule over nm. For radiance: dimensionless weight (or ȳ · 683 lm/W).
    pub curves: Vec<Table>,
}

impl Response {
    /// A sensor's channels, in electrons.
    pub fn sensor(sensor: &diopter_sensor::Sensor) -> Self {
        Response { bands: sensor.bands(), curves: sensor.band_responses() }
    }

    /// Linear sRGB of the radiance, in cd/m² of D65: ∫ L (R, G, B matching functions) dλ × 683 lm/W. May be negative.
    pub fn linear_srgb() -> Self {
        let o = diopter_light::cie::observer();
        let m = diopter_light::color::RgbSpace::Srgb.xyz_from_rgb().inverse() * diopter_light::units::LUMINOUS_EFFICACY;
        let curve = |row: usize| {
            let at = |nm: f32| {
                let xyz = glam::DVec3::new(o.x.at(nm) as f64, o.y.at(nm) as f64, o.z.at(nm) as f64);
                m.row(row).dot(xyz) as f32
            };
            Table::new(380.0, 1.0, (0..=400).map(|i| at(380.0 + i as f32)).collect())
        };
        let band = |name: &str| Band { name: name.into(), unit: BandUnit::Radiance };
        Response { bands: ["R", "G", "B"].map(band).to_vec(), curves: (0..3).map(curve).collect() }
    }

    /// Mean spectral radiance in equal narrow bands, W·m⁻²·sr⁻¹·nm⁻¹: what a hyperspectral camera measures.
    ///
    /// A band counts fully between its limits, by half at them, and nothing from 1 nm beyond: bands side by side add up to one everywhere.
    /// Names are those of Fichet, Pacanowski & Wilkie 2021, "An OpenEXR layout for spectral images" (JCGT 10(3)): `S0.405,0nm`, by the middle.
    pub fn spectral(bands: &SpectralBands) -> Self {
        let [first, last] = [FIRST_NM as u32, LAST_NM as u32];
        let curve = |[from, to]: [u32; 2]| {
            let mean = 1.0 / (to - from) as f32;
            let at = |nm: u32| {
                // Light beyond the ends is not carried: there is no other half.
                let at_limit = (nm == from && nm > first) || (nm == to && nm < last);
                let within = (from..=to).contains(&nm);
                if at_limit {
                    0.5 * mean
                } else if within {
                    mean
                } else {
                    0.0
                }
            };
            Table::new(first as f32, 1.0, (first..=last + 1).map(at).collect())
        };
        let name =
            |[from, to]: [u32; 2]| format!("S0.{},{}nm", (from + to) / 2, if (from + to).is_multiple_of(2) { 0 } else { 5 });
        Response {
            bands: bands.limits().map(|b| Band { name: name(b), unit: BandUnit::Radiance }).collect(),
            curves: bands.limits().map(curve).collect(),
        }
    }

    /// Luminance in cd/m².
    pub fn luminance() -> Self {
        let y = diopter_light::cie::observer().y.scaled(diopter_light::units::LUMINOUS_EFFICACY as f32);
        Response { bands: vec![Band { name: "Y".into(), unit: BandUnit::Radiance }], curves: vec![y] }
    }
}

/// How an exposure is computed.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Samples a pixel when all are rendered.
    pub spp: u32,
    /// Which of them to render; beyond `spp` nothing is.
    pub samples: Range<u32>,
    /// How they are spread.
    pub sampler: SamplerKind,
    /// Seed.
    pub seed: u64,
    /// How far paths go.
    pub path: PathSettings,
    /// Factor on all light of the scene.
    pub light_scale: f64,
    /// Stop after about so much time, s, the truth included; the samples that are done then (two at least) make the picture.
    pub time_limit_s: Option<f64>,
    /// Record depth, normals, albedo and ids.
    pub truth: bool,
    /// When samples are taken.
    pub moments: Moments,
    /// Only light through one half of the pupil counts, as in one half of a split pixel.
    pub half: Option<Half>,
    /// Paths carry red, green and blue instead of wavelengths, as those of RGB renderers: to compare with them. Only for
    /// [`Response::linear_srgb`].
    pub rgb: bool,
    /// Samples that the lens blocks (or that go through the other half) are drawn again: vignetting is not shown, nor is its noise. For
    /// probes that look for detail.
    pub redraw: bool,
}

/// A half of the pupil, as seen from behind the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Left of the middle.
    Left,
    /// Right of it.
    Right,
}

impl Half {
    /// Whether a place of the pupil (right is positive) lies in it.
    #[inline]
    fn holds(self, x: f64) -> bool {
        (x >= 0.0) == (self == Half::Right)
    }
}

impl Settings {
    /// `spp` Sobol samples, seed 1, no limits.
    pub fn new(spp: u32) -> Self {
        Settings {
            spp,
            samples: 0..spp,
            sampler: SamplerKind::Sobol,
            seed: 1,
            path: PathSettings::default(),
            light_scale: 1.0,
            time_limit_s: None,
            truth: true,
            moments: Moments::default(),
            half: None,
            rgb: false,
            redraw: false,
        }
    }
}

/// Told what goes on during an exposure; may be asked from any thread.
pub struct Watch<'a> {
    /// Set to stop.
    pub cancel: &'a AtomicBool,
    /// Called with the share that is done, 0 to 1.
    pub progress: &'a (dyn Fn(f64) + Sync),
}

/// Why there is no focal plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExposeError {
    /// [`Watch::cancel`] was set.
    #[error("the exposure was stopped")]
    Cancelled,
    /// No pixel or no sample.
    #[error("an exposure needs at least one pixel and one sample")]
    Nothing,
    /// The sums to go on from are of another size, of other bands or samples.
    #[error("the samples to go on from belong to another exposure")]
    Foreign,
    /// The temporary file of an exposure larger than memory.
    #[error(
        "the temporary file for the sums of this exposure cannot be written or read ({0}): expected room for 16 bytes a pixel and band"
    )]
    Disk(std::io::ErrorKind),
}

impl From<std::io::Error> for ExposeError {
    fn from(e: std::io::Error) -> Self {
        ExposeError::Disk(e.kind())
    }
}

/// What is exposed with what: the arguments of [`expose()`].
#[derive(Clone, Copy)]
pub struct Exposure<'a> {
    /// Posed for the whole time the shutter takes.
    pub scene: &'a Scene,
    /// Lens, film and place.
    pub camera: &'a Camera,
    /// When which part of the film is open.
    pub shutter: &'a Shutter,
    /// What the film records.
    pub response: &'a Response,
    /// How it is computed.
    pub settings: &'a Settings,
    /// What is known of the exposure.
    pub facts: &'a ExposureFacts,
}

/// What became of an exposure.
#[derive(Clone, Debug)]
pub struct Exposed {
    /// All samples that were taken.
    pub plane: FocalPlane,
    /// Whether it was stopped before the last sample that was asked for.
    pub stopped: bool,
}

/// An exposure under way: the sums of its samples. Going on from them gives, bit for bit, what the exposure would have given without a pause.
///
/// Samples are taken in passes over the whole film, tile by tile: every pixel has the samples of the finished passes, and the first tiles those of
/// the pass under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S = Raster<f64>> {
    /// `[row][column][band][replicate]`
    pub(crate) sums: S,
    /// Samples of the finished passes.
    pub(crate) samples: Range<u32>,
    /// Where the pass under way ends; where the last one ended if none is.
    pub(crate) pass_end: u32,
    /// Tiles that have the samples of the pass under way.
    pub(crate) tiles: usize,
}

/// Bands of one vector.
const GROUP: usize = 4;

/// Response curves at 1 nm, four bands side by side: one look-up a wavelength and group of bands.
struct Curves {
    /// `[group][nm][band]`, the last group padded to four bands.
    groups: Vec<Vec<[f32; GROUP]>>,
}

impl Curves {
    fn new(curves: &[Table]) -> Self {
        assert!(!curves.is_empty(), "a film without bands");
        let group = |four: &[Table]| {
            let row = |nm: f32| -> [f32; GROUP] { std::array::from_fn(|b| four.get(b).map_or(0.0, |c| c.at(nm))) };
            (0..=401).map(|i| row(FIRST_NM + i as f32)).collect::<Vec<_>>()
        };
        Curves { groups: curves.chunks(GROUP).map(group).collect() }
    }

    /// Red, green and blue of paths that carry colours: each where it stands.
    fn rgb() -> Self {
        let mut rows = vec![[0.0; GROUP]; 402];
        for (c, nm) in RGB_NM.into_iter().enumerate() {
            rows[(nm - FIRST_NM) as usize][c] = 1.0;
        }
        Curves { groups: vec![rows] }
    }

    /// Four bands at a wavelength.
    #[inline]
    fn at(&self, group: usize, nm: f32) -> glam::Vec4 {
        let rows = &self.groups[group];
        let x = nm - FIRST_NM;
        let i = (x as usize).min(400);
        let (a, b) = (glam::Vec4::from_array(rows[i]), glam::Vec4::from_array(rows[i + 1]));
        a + (b - a) * (x - i as f32)
    }

    /// What the four wavelengths of a path are worth in four bands.
    #[inline]
    fn value(&self, group: usize, nm: [f32; 4], weighted: [f32; 4]) -> glam::Vec4 {
        let mut value = glam::Vec4::ZERO;
        for c in 0..4 {
            value += self.at(group, nm[c]) * weighted[c];
        }
        value
    }
}

/// Adds the values of a group of bands to the sums of a pixel, `[band][half]`; the last group may have fewer than four.
#[inline]
fn add_to(bands: &mut [[f64; 2]], half: usize, value: glam::Vec4) {
    for (sum, v) in bands.iter_mut().zip(value.to_array()) {
        sum[half] += v as f64;
    }
}

/// What a sample of a pixel brings.
struct Arrival {
    /// nm.
    nm: [f32; 4],
    /// Radiance over the density of each wavelength.
    weighted: [f32; 4],
    /// Exposure that it stands for, in the unit of the bands.
    exposure: f32,
}

/// The light that landed on a part of the film, and on single pixels elsewhere.
struct Landed {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
    /// Pixels a row of the whole film.
    columns: usize,
    bands: usize,
    /// `[row][column][band][half]`
    sums: Vec<[f64; 2]>,
    /// Pixel number → `[band][half]`.
    strays: BTreeMap<usize, Vec<[f64; 2]>>,
}

impl Landed {
    /// The sums of a pixel of the film.
    #[inline]
    fn pixel(&mut self, x: usize, y: usize) -> &mut [[f64; 2]] {
        let bands = self.bands;
        if (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y) {
            let start = ((y - self.top) * (self.right - self.left) + x - self.left) * bands;
            &mut self.sums[start..start + bands]
        } else {
            self.strays.entry(y * self.columns + x).or_insert_with(|| vec![[0.0; 2]; bands])
        }
    }
}

/// Exposes a film to a scene, which must have been posed ([`Scene::pose`]) for the whole time the shutter takes.
///
/// `facts` is passed on, with samples and seed filled in. The mean of a band in electrons is what one pixel of area
/// [`crate::Film::pixel_area_mm2`] collects; of a band in radiance, the
/// mean over all rays from the pixel's area and the pupil that the lens lets pass, drawn evenly: a lossless view of the scene through this lens, in
/// which neither vignetting nor transmittance shows; 0 where nothing passes. A pixel at the edge of the image circle reads the mean of its lit
/// part; what passes less than a tenth of the pupil reads up to 0.1 % low, and darker places lower still.
pub fn expose(
    scene: &Scene,
    camera: &Camera,
    shutter: &Shutter,
    response: &Response,
    settings: &Settings,
    facts: &ExposureFacts,
    watch: &Watch,
) -> Result<FocalPlane, ExposeError> {
    let exposed = Exposure { scene, camera, shutter, response, settings, facts }.run(watch, None, None)?;
    Ok(exposed.plane)
}

/// Paths of a pass over the film, if that makes a number of samples between 2 and 256: some seconds of two cores.
const PASS_PATHS: usize = 1 << 22;
/// Tiles for each thread that are computed before their sums are added: enough that threads hardly wait for each other.
const TILES_AT_ONCE: usize = 64;

/// Bytes that exposing takes at most beside the scene: for each pixel, and for the tiles that all threads work on.
///
/// A pixel has two sums in double precision a band, its mean and half difference when they are done, and depth, normal, albedo and id.
pub fn bytes_needed(bands: usize) -> (usize, usize) {
    let (sums, plane) = (2 * 8 * bands, 2 * 4 * bands + TRUTH_BYTES);
    let tile = (TILE + 2 * MARGIN).pow(2) * sums;
    (sums + plane, TILES_AT_ONCE * rayon::current_num_threads().max(1) * tile)
}

/// Bytes of a pixel of the truth: depth, three of the normal, three of the albedo, id.
pub(crate) const TRUTH_BYTES: usize = 4 * 8;

/// Where the pass ends that begins with a sample. Passes end at multiples of a power of two that depends on the number of pixels alone, so that sums
/// are added in the same order however an exposure is interrupted.
fn pass_end(first: u32, pixels: usize) -> u32 {
    let length = 1u32 << (PASS_PATHS / pixels.max(1)).max(1).ilog2().clamp(1, 8);
    (first / length + 1).saturating_mul(length)
}

impl Exposure<'_> {
    /// Exposes from the beginning, or goes on from where `start` stands.
    ///
    /// `keep` gets the sums again and again, tens to hundreds of milliseconds apart, to save them if it likes. Without it [`Watch::cancel`] gives
    /// [`ExposeError::Cancelled`]; with it the pass under way is finished, and its samples and those before are the result.
    pub fn run(&self, watch: &Watch, start: Option<Sums>, keep: Option<Keep>) -> Result<Exposed, ExposeError> {
        let mut sums = self.begin(start, |[width, height, numbers]| Ok(Raster::new(width, height, numbers)))?;
        let started = Instant::now();
        let film = &self.camera.film;
        // Before the samples: a time limit then knows how long it takes.
        let truth = match self.settings.truth {
            true => truth(self.scene, self.camera, self.shutter, 0..film.rows),
            false => Truth::empty(film.columns, film.rows),
        };
        let stopped = self.take_samples(watch, &mut sums, keep, started, self.settings.time_limit_s)?;
        let facts = self.facts_of(&sums);
        let (mean, half_difference) = sums.finish(self.response.curves.len());
        let plane = FocalPlane { bands: self.response.bands.clone(), mean, half_difference, truth, facts };
        Ok(Exposed { plane, stopped })
    }

    /// The same for planes that memory cannot hold: about `memory` bytes of the sums are in memory, the others in a temporary file in `folder`. The
    /// truth is computed when the rows are asked for; a time limit leaves time for it.
    pub fn run_paged(
        &self,
        watch: &Watch,
        start: Option<Sums<PagedRows>>,
        keep: Option<Keep<PagedRows>>,
        memory: usize,
        folder: &Path,
    ) -> Result<ExposedPaged, ExposeError> {
        let mut sums = self.begin(start, |size| PagedRows::new(size, memory, folder))?;
        let started = Instant::now();
        let film = &self.camera.film;
        let limit = self.settings.time_limit_s.map(|limit| {
            if !self.settings.truth {
                return limit;
            }
            // Some rows in the middle stand for all.
            let trial = film.rows / 2..(film.rows / 2 + STRIP_STEP).min(film.rows);
            let share = film.rows as f64 / trial.len() as f64;
            truth(self.scene, self.camera, self.shutter, trial);
            (limit - started.elapsed().as_secs_f64() * share).max(0.0)
        });
        let stopped = self.take_samples(watch, &mut sums, keep, started, limit)?;
        Ok(ExposedPaged {
            camera: self.camera.clone(),
            shutter: *self.shutter,
            truth: self.settings.truth,
            bands: self.response.bands.clone(),
            facts: self.facts_of(&sums),
            sums,
            stopped,
        })
    }

    /// The samples that are asked for.
    fn wanted(&self) -> Range<u32> {
        self.settings.samples.start..self.settings.samples.end.min(self.settings.spp)
    }

    /// The sums to go on from, or new ones.
    fn begin<S: RowStore>(
        &self,
        start: Option<Sums<S>>,
        rows: impl FnOnce([usize; 3]) -> std::io::Result<S>,
    ) -> Result<Sums<S>, ExposeError> {
        let film = &self.camera.film;
        let (width, height, bands) = (film.columns, film.rows, self.response.curves.len());
        let wanted = self.wanted();
        if width == 0 || height == 0 || wanted.is_empty() {
            return Err(ExposeError::Nothing);
        }
        match start {
            Some(sums) if !sums.belong_to([width, height, bands], &wanted) => Err(ExposeError::Foreign),
            Some(sums) => Ok(sums),
            None => Ok(Sums {
                sums: rows([width, height, 2 * bands])?,
                samples: wanted.start..wanted.start,
                pass_end: wanted.start,
                tiles: 0,
            }),
        }
    }

    fn facts_of<S>(&self, sums: &Sums<S>) -> ExposureFacts {
        ExposureFacts {
            seed: self.settings.seed,
            first_sample: sums.samples.start,
            samples: sums.samples.len() as u32,
            light_scale: self.settings.light_scale,
            ..self.facts.clone()
        }
    }

    /// Takes the samples that are still wanted; whether it was stopped before the last of them.
    fn take_samples<S: RowStore>(
        &self,
        watch: &Watch,
        sums: &mut Sums<S>,
        mut keep: Option<Keep<S>>,
        started: Instant,
        time_limit_s: Option<f64>,
    ) -> Result<bool, ExposeError> {
        let Exposure { scene, camera, shutter, response, settings, .. } = *self;
        let film = &camera.film;
        let (width, height) = (film.columns, film.rows);
        let wanted = self.wanted();
        let sampling = Instant::now();
        let (curves, wavelengths) = match settings.rgb {
            false => (Curves::new(&response.curves), WavelengthSampler::for_bands(&response.curves)),
            true => (Curves::rgb(), WavelengthSampler::rgb()),
        };
        let behind = camera.film.microlenses.map(|m| m.behind(&camera.lens));
        let unit = Unit { scene, camera, shutter, curves: &curves, response, wavelengths: &wavelengths, settings, behind };
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        let at_once = TILES_AT_ONCE * rayon::current_num_threads().max(1);
        let tiles_done = AtomicUsize::new(0);
        let resumed = sums.samples.end;
        let stopped = || watch.cancel.load(Ordering::Relaxed);
        let at_once_if_stopped = keep.is_none();

        while sums.samples.end < wanted.end {
            let done = sums.samples.end;
            if sums.pass_end == done {
                // Without a limit passes are as they are; with one, they grow as long as time is left.
                let end = pass_end(done, width * height).min(wanted.end);
                sums.pass_end = match time_limit_s {
                    None => end,
                    Some(limit) => {
                        let so_far = done - resumed;
                        let spent = started.elapsed().as_secs_f64();
                        let affordable = match so_far {
                            0 => 2,
                            n => ((limit - spent) / (sampling.elapsed().as_secs_f64() / n as f64)) as i64,
                        };
                        if affordable < 1 {
                            break;
                        }
                        (done + affordable.min(i64::from(so_far.max(2))) as u32).min(end)
                    }
                };
            }
            let pass = done..sums.pass_end;
            tiles_done.store(sums.tiles, Ordering::Relaxed);
            let share = |tile: usize| match time_limit_s {
                None => {
                    let samples = (done - wanted.start) as f64 + pass.len() as f64 * tile as f64 / tiles as f64;
                    samples / wanted.len() as f64
                }
                Some(limit) => (started.elapsed().as_secs_f64() / limit).min(1.0),
            };
            while sums.tiles < tiles {
                let batch = sums.tiles..(sums.tiles + at_once).min(tiles);
                let before = batch.clone().map(|index| unit.before(index, sums)).collect::<Result<Vec<_>, _>>()?;
                let results: Vec<Option<Tile>> = before
                    .into_par_iter()
                    .zip(batch.clone())
                    .map(|(before, index)| {
                        if at_once_if_stopped && stopped() {
                            return None;
                        }
                        let tile = unit.tile(index, pass.clone(), before);
                        (watch.progress)(share(tiles_done.fetch_add(1, Ordering::Relaxed) + 1));
                        Some(tile)
                    })
                    .collect();
                for tile in results {
                    sums.add(tile.ok_or(ExposeError::Cancelled)?)?;
                }
                sums.tiles = batch.end;
                if sums.tiles == tiles {
                    sums.samples.end = pass.end;
                    sums.tiles = 0;
                }
                if let Some(keep) = &mut keep
                    && sums.samples.end < wanted.end
                {
                    keep(sums);
                }
                if sums.samples.end == pass.end {
                    break;
                }
            }
            if stopped() && !at_once_if_stopped {
                break;
            }
        }
        Ok(sums.samples.end < wanted.end && stopped())
    }
}

/// What became of an exposure that memory cannot hold.
#[derive(Debug)]
pub struct ExposedPaged {
    /// Its facts.
    pub facts: ExposureFacts,
    /// Whether it was stopped before the last sample that was asked for.
    pub stopped: bool,
    camera: Camera,
    shutter: Shutter,
    /// Whether the truth is wanted.
    truth: bool,
    bands: Vec<Band>,
    sums: Sums<PagedRows>,
}

impl ExposedPaged {
    /// The focal plane row by row: mean and half difference of the sums, with the truth of the rows in the scene that was exposed.
    pub fn rows(self, scene: &Scene) -> ExposedRows<'_> {
        ExposedRows { scene, exposed: self, next: 0 }
    }
}

/// An exposure that memory cannot hold, handed out row by row.
#[derive(Debug)]
pub struct ExposedRows<'a> {
    scene: &'a Scene,
    exposed: ExposedPaged,
    /// Rows that were taken.
    next: usize,
}

impl ExposedRows<'_> {
    /// Log of the largest finite depth, m, which denoising asks for; `None` if nothing is hit.
    pub fn farthest_log_depth(&self) -> Option<f32> {
        let (rows, step) = (self.exposed.camera.film.rows, self.rows_at_once());
        let strips = (0..rows).step_by(step).map(|first| self.truth_of(first..(first + step).min(rows)));
        strips.filter_map(|truth| farthest_log_depth_of(&truth.depth.data)).reduce(f32::max)
    }

    fn truth_of(&self, rows: Range<usize>) -> Truth {
        match self.exposed.truth {
            true => truth(self.scene, &self.exposed.camera, &self.exposed.shutter, rows),
            false => Truth::empty(self.exposed.camera.film.columns, rows.len()),
        }
    }
}

impl FocalPlaneSource for ExposedRows<'_> {
    fn bands(&self) -> &[Band] {
        &self.exposed.bands
    }

    fn facts(&self) -> &ExposureFacts {
        &self.exposed.facts
    }

    fn size(&self) -> [usize; 2] {
        [self.exposed.camera.film.columns, self.exposed.camera.film.rows]
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let ([width, height], bands) = (self.size(), self.exposed.bands.len());
        if rows > height - self.next {
            let reason = "it has fewer rows".to_owned();
            return Err(ImageError::Malformed { format: "focal plane", reason });
        }
        let range = self.next..self.next + rows;
        let (mut mean, mut half_difference) = (Raster::new(width, rows, bands), Raster::new(width, rows, bands));
        let stride = width * bands;
        for (k, row) in range.clone().enumerate() {
            let place = k * stride..(k + 1) * stride;
            let numbers = self.exposed.sums.sums.row(row)?;
            means(&self.exposed.sums.samples, numbers, &mut mean.data[place.clone()], &mut half_difference.data[place]);
        }
        let truth = self.truth_of(range.clone());
        self.next = range.end;
        Ok(FocalPlane { bands: self.exposed.bands.clone(), mean, half_difference, truth, facts: self.exposed.facts.clone() })
    }
}

/// A rectangle of the film and its sums.
struct Tile {
    column: usize,
    row: usize,
    width: usize,
    /// `[row][column][band][replicate]`
    sums: Vec<f64>,
    /// Whether these are the sums of all samples so far, or only of this pass.
    whole: bool,
    /// What landed elsewhere: pixel number → sums `[band][replicate]`.
    strays: BTreeMap<usize, Vec<[f64; 2]>>,
}

impl<S> Sums<S> {
    /// The samples that every pixel has.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }
}

impl<S: RowStore> Sums<S> {
    /// Whether an exposure of a size (pixels a row, rows, bands) and samples can go on from here.
    fn belong_to(&self, [width, height, bands]: [usize; 3], wanted: &Range<u32>) -> bool {
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        self.sums.size() == [width, height, 2 * bands]
            && self.samples.start == wanted.start
            && (self.samples.start..=self.pass_end).contains(&self.samples.end)
            && self.pass_end <= wanted.end
            && self.tiles < tiles
            && (self.tiles == 0 || self.pass_end > self.samples.end)
    }

    fn add(&mut self, tile: Tile) -> std::io::Result<()> {
        let [width, _, channels] = self.sums.size();
        let stride = tile.width * channels;
        for (i, line) in tile.sums.chunks_exact(stride).enumerate() {
            let start = tile.column * channels;
            let to = &mut self.sums.row_mut(tile.row + i)?[start..start + stride];
            match tile.whole {
                true => to.copy_from_slice(line),
                false => to.iter_mut().zip(line).for_each(|(a, b)| *a += b),
            }
        }
        for (pixel, sums) in tile.strays {
            let start = pixel % width * channels;
            let to = &mut self.sums.row_mut(pixel / width)?[start..start + channels];
            to.iter_mut().zip(sums.iter().flatten()).for_each(|(a, b)| *a += b);
        }
        Ok(())
    }
}

impl Sums {
    /// Mean and half difference of the replicates.
    fn finish(self, bands: usize) -> (Raster<f32>, Raster<f32>) {
        let (width, height) = (self.sums.width, self.sums.height);
        let (mut mean, mut half) = (Raster::new(width, height, bands), Raster::new(width, height, bands));
        means(&self.samples, &self.sums.data, &mut mean.data, &mut half.data);
        (mean, half)
    }
}

/// Mean and half difference of the replicates of some pixels after some samples.
fn means(samples: &Range<u32>, sums: &[f64], mean: &mut [f32], half_difference: &mut [f32]) {
    // Even samples are of the first replicate, odd ones of the second.
    let odd = (samples.end / 2 - samples.start / 2) as f64;
    let even = samples.len() as f64 - odd;
    for ((pair, mean), half) in sums.as_chunks::<2>().0.iter().zip(mean).zip(half_difference) {
        // Rounded as sums of single precision are: a plane has no more.
        let (sa, sb) = (f64::from(pair[0] as f32), f64::from(pair[1] as f32));
        *mean = ((sa + sb) / (even + odd)) as f32;
        // A part of one half only says nothing about its own error: call it 100 %, with the sign that makes parts of
        // both halves merge to their difference.
        *half = match (even == 0.0, odd == 0.0) {
            (_, true) => *mean,
            (true, _) => -*mean,
            _ => (0.5 * (sa / even - sb / odd)) as f32,
        };
    }
}

/// Told the sums so far, to keep them.
pub type Keep<'a, S = Raster<f64>> = &'a mut dyn FnMut(&Sums<S>);

/// Most times that a sample of a probe is drawn again.
const REDRAWS: u32 = 8;

/// The same of a sample of radiance: where light passes a tenth of the pupil, one of a thousand is lost.
const RADIANCE_REDRAWS: u32 = 64;

/// The numbers of a sample at an attempt: new ones each time, independent of those before, so that what passes at last is even over all that passes
/// (rejection sampling). Steps of a low-discrepancy sequence would not be: they prefer what is first reached from the blocked part.
fn drawn_again(numbers: [f32; 4], sampler: &Sampler, attempt: u32) -> [f32; 4] {
    if attempt == 0 { numbers } else { sampler.get(Set::Redraw(attempt)) }
}

/// Rays from places of the sensor through a microlens array.
struct FromSensor<'a> {
    behind: &'a Behind,
    rays: [Option<Aimed>; LANES],
    film: &'a Film,
    /// Shift of each lane by the low-pass filter, mm.
    shifts: [glam::DVec2; LANES],
}

impl Aim for FromSensor<'_> {
    fn draw(&self, _: &PupilTable, lane: usize, _: glam::DVec2) -> Option<(glam::DVec2, f64)> {
        self.rays[lane].map(|r| (r.slope, r.density))
    }

    fn density(&self, _: &PupilTable, lane: usize, film: glam::DVec2, slope: glam::DVec2) -> f64 {
        let sensor = self.behind.lands(film, slope);
        match self.film.collects(sensor + self.shifts[lane]) {
            true => self.behind.density(sensor),
            false => 0.0,
        }
    }
}

/// What all tiles share.
struct Unit<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    shutter: &'a Shutter,
    curves: &'a Curves,
    response: &'a Response,
    wavelengths: &'a WavelengthSampler,
    settings: &'a Settings,
    /// The microlens array, if there is one.
    behind: Option<Behind>,
}

impl Unit<'_> {
    /// Column, row, width and height of a tile.
    fn rectangle(&self, index: usize) -> [usize; 4] {
        let film = &self.camera.film;
        let across = film.columns.div_ceil(TILE);
        let (column, row) = (index % across * TILE, index / across * TILE);
        [column, row, TILE.min(film.columns - column), TILE.min(film.rows - row)]
    }

    /// The sums so far that the samples of a tile are added to one by one; none where they are summed apart.
    fn before<S: RowStore>(&self, index: usize, sums: &mut Sums<S>) -> std::io::Result<Vec<f64>> {
        if matches!(self.camera.lens, Lens::Compound(_)) {
            return Ok(Vec::new());
        }
        let [column, row, width, height] = self.rectangle(index);
        let channels = 2 * self.curves_len();
        let mut before = Vec::with_capacity(width * height * channels);
        for y in row..row + height {
            before.extend_from_slice(&sums.sums.row(y)?[column * channels..(column + width) * channels]);
        }
        Ok(before)
    }

    /// The samples of a pass in a tile, on top of what [`Unit::before`] gave.
    fn tile(&self, index: usize, samples: Range<u32>, before: Vec<f64>) -> Tile {
        let rectangle = self.rectangle(index);
        match &self.camera.lens {
            Lens::Compound(lens) => self.compound_tile(lens, rectangle, samples),
            _ => self.plain_tile(rectangle, samples, before),
        }
    }

    fn sampler(&self, x: usize, y: usize, sample: u32) -> Sampler {
        Sampler::new(self.settings.sampler, self.settings.seed, (x as u32, y as u32), sample, self.settings.spp)
    }

    /// Through an ideal lens: every sample counts in its own pixel.
    fn plain_tile(&self, [column, row, width, height]: [usize; 4], samples: Range<u32>, mut sums: Vec<f64>) -> Tile {
        let bands = self.curves_len();
        let mut so_far = sums.chunks_exact_mut(2 * bands);
        let mut pixel = vec![[0.0f64; 2]; bands];
        for y in row..row + height {
            for x in column..column + width {
                let Some(so_far) = so_far.next() else { continue };
                pixel.as_flattened_mut().copy_from_slice(so_far);
                for i in samples.clone() {
                    let sampler = self.sampler(x, y, i);
                    let Some(arrival) = self.sample(x, y, &sampler) else { continue };
                    for (group, bands) in pixel.chunks_mut(GROUP).enumerate() {
                        let value = self.curves.value(group, arrival.nm, arrival.weighted);
                        // One bad number must not poison a pixel.
                        if value.is_finite() {
                            add_to(bands, sampler.replicate(), value * arrival.exposure);
                        }
                    }
                }
                so_far.copy_from_slice(pixel.as_flattened());
            }
        }
        Tile { column, row, width, sums, whole: true, strays: BTreeMap::new() }
    }

    /// Through a real lens, a packet of samples at a time; each wavelength counts in the pixel where it lands
    /// ([`diopter_lens::compound`]).
    fn compound_tile(&self, lens: &CompoundLens, [column, row, width, height]: [usize; 4], samples: Range<u32>) -> Tile {
        let film = &self.camera.film;
        let bands = self.curves_len();
        let (left, top) = (column.saturating_sub(MARGIN), row.saturating_sub(MARGIN));
        let (right, bottom) = ((column + width + MARGIN).min(film.columns), (row + height + MARGIN).min(film.rows));
        let sums = vec![[0.0f64; 2]; (right - left) * (bottom - top) * bands];
        let mut landed = Landed { left, top, right, bottom, columns: film.columns, bands, sums, strays: BTreeMap::new() };
        let radiance_only = self.in_radiance();
        let attempts = self.attempts();
        let (mut packet, mut exits, mut scratch) = (Samples::default(), Exits::default(), Scratch::default());
        let (mut again, mut places) = (Exits::default(), [[0.5f32; 4]; LANES]);
        let mut shifts = [glam::DVec2::ZERO; LANES];
        let mut from_sensor = self.behind.as_ref().map(|behind| FromSensor { behind, rays: [None; LANES], film, shifts });
        let mut drawn: Vec<(usize, usize, Sampler, Wavelengths, f32)> = Vec::with_capacity(LANES);
        let spp = samples.len();
        let total = width * height * spp;
        let mut first = 0;
        while first < total {
            let count = LANES.min(total - first);
            drawn.clear();
            exits.passed = 0;
            for k in 0..count {
                let (pixel, sample) = ((first + k) / spp, (first + k) % spp);
                let (x, y) = (column + pixel % width, row + pixel / width);
                let sampler = self.sampler(x, y, samples.start + sample as u32);
                let [u, v, pu, pv] = sampler.get(Set::Camera);
                let [w, t, spot @ ..] = sampler.get(Set::Time);
                let wavelengths = self.wavelengths.sample(w);
                shifts[k] = film.low_pass_shift(spot);
                places[k] = [u, v, pu, pv];
                packet.nm[k] = wavelengths.nm.to_array();
                drawn.push((x, y, sampler, wavelengths, t));
            }
            // Lanes beyond hold rays of the packet before.
            let own = ((1u64 << count) - 1) as u32;
            for attempt in 0..=attempts {
                if exits.passed & own == own {
                    break;
                }
                for k in 0..count {
                    let (x, y, ref sampler, ..) = drawn[k];
                    let (at, pupil) = self.place(places[k], sampler, attempt);
                    packet.film[k] = self.camera.film_point(x as f64 + at[0], y as f64 + at[1]) - shifts[k];
                    packet.pupil[k] = pupil;
                    if let Some(from) = &mut from_sensor {
                        from.shifts[k] = shifts[k];
                        from.rays[k] = from.behind.draw(packet.film[k], pupil);
                        packet.film[k] = from.rays[k].map_or(packet.film[k], |r| r.at);
                    }
                }
                let out = if attempt == 0 { &mut exits } else { &mut again };
                match &from_sensor {
                    Some(from) => lens.exits_aimed(&packet, from, &mut scratch, out),
                    None => lens.exits(&packet, |k, at| film.collects(at + shifts[k]), &mut scratch, out),
                }
                self.block_other_half(&packet, out);
                if attempt > 0 {
                    exits.take_missing(&again);
                }
            }
            for k in (0..count).filter(|k| exits.passed >> k & 1 == 1) {
                let (x, y, ref sampler, wavelengths, t) = drawn[k];
                let shift = shifts[k];
                // What is not spread is drawn and counted alike at all wavelengths.
                let wavelengths = match exits.spread && !radiance_only {
                    true => wavelengths.with_densities(exits.density[k]),
                    false => wavelengths,
                };
                let pupil = match self.needs_pupil() {
                    true => {
                        let at = |v: [f32; 3]| glam::Vec3::from_array(v).as_dvec3();
                        self.camera.pupil_radius(at(exits.origin[k]), at(exits.direction[k]))
                    }
                    false => 0.0,
                };
                // Colours may land in rows that are open at other times: the moment is drawn from the time of all of them.
                let spread = exits.spread && !radiance_only;
                let lands: [Option<(usize, usize)>; 4] = match spread {
                    false => [Some((x, y)); 4],
                    true => std::array::from_fn(|c| {
                        let [x, y] = match &self.behind {
                            None => exits.lands[k][c],
                            Some(behind) => {
                                let [at, slope] = [exits.lands[k][c], exits.slopes[k][c]];
                                let [at, slope] = [at, slope].map(|v| glam::Vec2::from_array(v).as_dvec2());
                                behind.lands(at, slope).as_vec2().to_array()
                            }
                        };
                        let at = [x + shift.x as f32, y + shift.y as f32];
                        // The hero is where it was drawn; between pixels nothing of the others is collected.
                        let collected = c == 0 || film.collects(glam::Vec2::from_array(at).as_dvec2());
                        self.camera.pixel_of(at).filter(|_| collected)
                    }),
                };
                let windows = lands.map(|p| p.map(|(x, y)| self.window(x, y, pupil)));
                let all = windows.iter().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |a, w| (a.0.min(w.0), a.1.max(w.1)));
                if all.0 >= all.1 {
                    continue;
                }
                let (time, seconds) = self.settings.moments.draw(all, t as f64);
                let ray = self.camera.world_ray_of(exits.origin[k], exits.direction[k], time);
                if !ray.is_finite() {
                    continue;
                }
                let radiance = self.scene.radiance(ray, &wavelengths, sampler, &self.settings.path);
                let weighted = (radiance * wavelengths.weight).to_array();
                // One bad number must not poison a pixel.
                if !weighted.iter().all(|v| v.is_finite()) {
                    continue;
                }
                let half = sampler.replicate();
                let nm = wavelengths.nm.to_array();
                let scale = match radiance_only {
                    // The mean over what passes, where it was asked for.
                    true => self.settings.light_scale * seconds / (all.1 - all.0),
                    false => film.pixel_area_mm2 * M2_PER_MM2 * seconds * self.settings.light_scale * self.half_of_light(),
                } as f32;
                if !spread {
                    // All colours where the sample was asked for.
                    let weight = if radiance_only { 1.0 } else { exits.weight[k][0] };
                    for (group, bands) in landed.pixel(x, y).chunks_mut(GROUP).enumerate() {
                        add_to(bands, half, self.curves.value(group, nm, weighted) * (weight * scale));
                    }
                    continue;
                }
                for c in 0..4 {
                    let weight = exits.weight[k][c];
                    if let (Some((px, py)), Some((open, close))) = (lands[c], windows[c])
                        && weight > 0.0
                        && (open..=close).contains(&time)
                    {
                        for (group, bands) in landed.pixel(px, py).chunks_mut(GROUP).enumerate() {
                            add_to(bands, half, self.curves.at(group, nm[c]) * (weighted[c] * weight * scale));
                        }
                    }
                }
            }
            first += count;
        }
        let sums = landed.sums.into_iter().flatten().collect();
        Tile { column: left, row: top, width: right - left, sums, whole: false, strays: landed.strays }
    }

    /// Whether the film records radiance.
    fn in_radiance(&self) -> bool {
        self.response.bands[0].unit == BandUnit::Radiance
    }

    /// How often a sample that the lens blocks is drawn again.
    fn attempts(&self) -> u32 {
        match (self.in_radiance(), self.settings.redraw && self.behind.is_none()) {
            (true, _) => RADIANCE_REDRAWS,
            (_, true) => REDRAWS,
            _ => 0,
        }
    }

    /// Place in the pixel (0 to 1 across and down) and in the pupil (unit square) of a sample at an attempt. Radiance is the mean over all of the
    /// pixel that sees anything; a probe keeps its film points.
    fn place(&self, numbers: [f32; 4], sampler: &Sampler, attempt: u32) -> ([f64; 2], [f32; 2]) {
        let [u, v, pu, pv] = drawn_again(numbers, sampler, attempt);
        let at = if self.in_radiance() { [u, v] } else { [numbers[0], numbers[1]] };
        (self.camera.film.within_pixel(at), [pu, pv])
    }

    /// Fraction of a sample's light that counts: drawn again until they pass, samples through half a pupil stand for half of the light.
    fn half_of_light(&self) -> f64 {
        if self.settings.half.is_some() && self.attempts() > 0 { 0.5 } else { 1.0 }
    }

    /// Marks rays through the half of the pupil that does not count as blocked.
    fn block_other_half(&self, packet: &Samples, exits: &mut Exits) {
        if let Some(half) = self.settings.half {
            let curvature = self.camera.lens.exit_curvature();
            let place = |k: usize| f64::from(exits.slopes[k][0][0]) + packet.film[k].x * curvature;
            for k in (0..LANES).filter(|k| !half.holds(place(*k))).collect::<Vec<_>>() {
                exits.passed &= !(1 << k);
            }
        }
    }

    /// When a pixel is open to light through a place of the pupil.
    #[inline]
    fn window(&self, column: usize, row: usize, pupil: f64) -> (f64, f64) {
        let film = &self.camera.film;
        self.shutter.window(&Place { pixel: [column, row], size: [film.columns, film.rows], pupil })
    }

    /// Whether the shutter asks where in the pupil light passes.
    #[inline]
    fn needs_pupil(&self) -> bool {
        matches!(self.shutter.mechanism, crate::shutter::Mechanism::Leaf { .. })
    }

    fn curves_len(&self) -> usize {
        self.response.curves.len()
    }

    /// One sample of a pixel; `None` where no light comes through.
    #[inline]
    fn sample(&self, column: usize, row: usize, sampler: &Sampler) -> Option<Arrival> {
        let [x, y, pu, pv] = sampler.get(Set::Camera);
        let [w, t, spot @ ..] = sampler.get(Set::Time);
        let shift = self.camera.film.low_pass_shift(spot);
        let passes = |r: &LensRay| self.settings.half.is_none_or(|h| h.holds(r.origin_mm.x));
        let lens_ray = (0..=self.attempts()).find_map(|attempt| {
            let (at, pupil) = self.place([x, y, pu, pv], sampler, attempt);
            let film = self.camera.film_point(column as f64 + at[0], row as f64 + at[1]) - shift;
            let ray = match &self.behind {
                None => self.camera.lens.ray(film, pupil).ok()?,
                Some(behind) => {
                    let aimed = behind.draw(film, pupil)?;
                    let ray = self.camera.lens.ray_along(aimed.at, aimed.slope).ok()?;
                    LensRay { weight_sr: ray.weight_sr / aimed.density, ..ray }
                }
            };
            passes(&ray).then_some(ray)
        })?;
        let pupil = if self.needs_pupil() { self.camera.pupil_radius(lens_ray.origin_mm, lens_ray.direction) } else { 0.0 };
        let (open, close) = self.window(column, row, pupil);
        if open >= close {
            return None;
        }
        let (time, seconds) = self.settings.moments.draw((open, close), t as f64);
        let ray = self.camera.to_world(&lens_ray, time);
        if !ray.is_finite() {
            return None;
        }
        let wavelengths = self.wavelengths.sample(w);
        let radiance = self.scene.radiance(ray, &wavelengths, sampler, &self.settings.path);
        let exposure = match self.response.bands[0].unit {
            BandUnit::Radiance => seconds / (close - open),
            BandUnit::Electrons => {
                lens_ray.weight_sr * self.camera.film.pixel_area_mm2 * M2_PER_MM2 * seconds * self.half_of_light()
            }
        };
        Some(Arrival {
            nm: wavelengths.nm.to_array(),
            weighted: (radiance * wavelengths.weight).to_array(),
            exposure: (exposure * self.settings.light_scale) as f32,
        })
    }
}

/// Ground truth of some rows along chief rays, in the middle of the time each pixel is open.
fn truth(scene: &Scene, camera: &Camera, shutter: &Shutter, rows: Range<usize>) -> Truth {
    let (width, height) = (camera.film.columns, camera.film.rows);
    let mut truth = Truth::empty(width, rows.len());
    // All around there is no axis: depth is distance.
    let all_around = matches!(&camera.lens, Lens::Pinhole(p) if matches!(p.projection, Projection::Panorama { .. }));
    let behind = camera.film.microlenses.map(|m| m.behind(&camera.lens));
    let first = |column: usize, row: usize| {
        let (open, close) = shutter.window(&Place { pixel: [column, row], size: [width, height], pupil: 0.0 });
        let time = 0.5 * (open + close);
        let film = camera.film_point(column as f64 + 0.5, row as f64 + 0.5);
        let ray = match &behind {
            None => camera.chief_ray(film, time),
            // What a pixel behind a microlens sees through its middle.
            Some(behind) => {
                let aimed = behind.middle(film);
                camera.lens.ray_along(aimed.at, aimed.slope).map(|ray| camera.to_world(&ray, time))
            }
        };
        let ray = ray.ok().filter(diopter_light::Ray::is_finite)?;
        let s = scene.first_surface(&ray)?;
        Some((s.distance * if all_around { 1.0 } else { camera.cosine_to_axis(ray.direction, time) }, s))
    };
    // Each row where it belongs: no second copy of the planes.
    let Truth { depth, normal, albedo, id } = &mut truth;
    let guides = normal.data.par_chunks_mut(3 * width).zip(albedo.data.par_chunks_mut(3 * width));
    let planes = depth.data.par_chunks_mut(width).zip(id.data.par_chunks_mut(width)).zip(guides);
    planes.enumerate().for_each(|(row, ((depth, id), (normal, albedo)))| {
        for column in 0..width {
            let Some((distance, s)) = first(column, rows.start + row) else { continue };
            depth[column] = distance;
            normal[3 * column..3 * column + 3].copy_from_slice(&s.normal.to_array());
            albedo[3 * column..3 * column + 3].copy_from_slice(&s.albedo.to_array());
            id[column] = s.object + 1;
        }
    });
    truth
}

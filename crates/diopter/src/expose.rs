//! The exposure: pixels × samples of light through lens and shutter onto the film.
//!
//! Tiles are shared out over the threads of the current rayon pool. A pixel's numbers depend on nothing but seed, pixel and
//! sample, and are summed in double precision in an order that is always the same, so the result is the same for any number of threads and
//! however often it was interrupted ([`Sums`]).

mod fireflies;
mod integrator;
mod paged;
mod response;
mod sums;
mod tile;

pub use fireflies::{Fireflies, SUMS_WITH_CASCADE};
pub use integrator::Integrator;
pub use paged::{ExposedPaged, ExposedRows};
pub use response::Response;
pub use sums::{Keep, Sums};

use crate::camera::Camera;
use crate::row_store::{PagedRows, RowStore};
use crate::shutter::{Moments, Place, Shutter};
use diopter_image::focal_plane::{BandUnit, STRIP_STEP, Truth, bytes_a_pixel};
use diopter_image::{ExposureFacts, FocalPlane, Raster};
use diopter_lens::{Lens, Projection};
use diopter_light::Ray;
use diopter_light::random::SamplerKind;
use diopter_light::wavelength::WavelengthSampler;
use diopter_scene::light_paths::PhotonMap;
use diopter_scene::{FirstSurface, PathSettings, Scene};
use fireflies::Cascade;
use rayon::prelude::*;
use response::Curves;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;
use sums::Tile;
use tile::Unit;

/// Pixels a side of the squares that threads take.
const TILE: usize = 16;

/// Pixels around a tile that its samples may land in: through a real lens each wavelength has its own film point. What lands
/// farther away is kept pixel by pixel.
const MARGIN: usize = 4;

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
    /// How light transport is computed.
    pub integrator: Integrator,
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
    /// What becomes of outliers when the samples end. Only an exposure in electrons of all `spp` samples at once re-weights them; parts keep them.
    pub fireflies: Fireflies,
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
    /// `spp` Sobol samples, seed 1, the integrator chosen by the scene, no limits.
    pub fn new(spp: u32) -> Self {
        Settings {
            spp,
            samples: 0..spp,
            sampler: SamplerKind::Sobol,
            seed: 1,
            path: PathSettings::default(),
            integrator: Integrator::default(),
            light_scale: 1.0,
            time_limit_s: None,
            truth: true,
            moments: Moments::default(),
            half: None,
            rgb: false,
            redraw: false,
            fireflies: Fireflies::Keep,
        }
    }

    /// Whether all samples are rendered, not a part of them.
    pub fn is_whole(&self) -> bool {
        self.samples.start == 0 && self.samples.end >= self.spp
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
/// A pixel has two sums in double precision a band, its mean and half difference when they are done, and depth, normal, albedo and id. `summed`: bands
/// that are summed, [`SUMS_WITH_CASCADE`] times as many as there are where fireflies are re-weighted.
pub fn bytes_needed(bands: usize, summed: usize) -> (usize, usize) {
    let (sums, plane) = (2 * 8 * summed, bytes_a_pixel(bands));
    let tile = (TILE + 2 * MARGIN).pow(2) * sums;
    (sums + plane, TILES_AT_ONCE * rayon::current_num_threads().max(1) * tile)
}

/// Samples of a pass: a power of two that depends on the number of pixels alone.
fn pass_length(pixels: usize) -> u32 {
    1u32 << (PASS_PATHS / pixels.max(1)).max(1).ilog2().clamp(1, 8)
}

/// Where the pass ends that begins with a sample: passes end at multiples of their length, so that sums are added in the same order however an
/// exposure is interrupted.
fn pass_end(first: u32, length: u32) -> u32 {
    (first / length + 1).saturating_mul(length)
}

impl Exposure<'_> {
    /// Exposes from the beginning, or goes on from where `start` stands.
    ///
    /// `keep` gets the sums again and again, tens to hundreds of milliseconds apart, to save them if it likes. Without it [`Watch::cancel`] gives
    /// [`ExposeError::Cancelled`]; with it the pass under way is finished, and its samples and those before are the result. While the truth is computed,
    /// before the first sample, [`Watch::cancel`] gives [`ExposeError::Cancelled`] in both cases, and so does a `keep` that breaks.
    pub fn run(&self, watch: &Watch, start: Option<Sums>, keep: Option<Keep>) -> Result<Exposed, ExposeError> {
        let mut sums = self.begin(start, |[width, height, numbers]| Ok(Raster::new(width, height, numbers)))?;
        let started = Instant::now();
        let film = &self.camera.film;
        // Before the samples: a time limit then knows how long it takes.
        let truth = match self.settings.truth {
            true => truth(self.scene, self.camera, self.shutter, 0..film.rows, watch.cancel).ok_or(ExposeError::Cancelled)?,
            false => Truth::empty(film.columns, film.rows),
        };
        let stopped = self.take_samples(watch, &mut sums, keep, started, self.settings.time_limit_s)?;
        let mut facts = self.facts_of(&sums);
        let (mean, half_difference, removed) = sums.finish(self.response.curves.len(), self.cascade());
        facts.fireflies_removed = removed;
        let plane = FocalPlane { bands: self.response.bands.clone(), mean, half_difference, truth, facts };
        Ok(Exposed { plane, stopped })
    }

    /// The same for planes that memory cannot hold: about `memory` bytes of the sums are in memory, the others in a temporary file in `folder`. The
    /// truth is computed when the rows are asked for; a time limit leaves time for it. Fireflies are kept: the cascade would take six times the room.
    pub fn run_paged(
        &self,
        watch: &Watch,
        start: Option<Sums<PagedRows>>,
        keep: Option<Keep<PagedRows>>,
        memory: usize,
        folder: &Path,
    ) -> Result<ExposedPaged, ExposeError> {
        if self.settings.fireflies != Fireflies::Keep {
            let settings = Settings { fireflies: Fireflies::Keep, ..self.settings.clone() };
            return Exposure { settings: &settings, ..*self }.run_paged(watch, start, keep, memory, folder);
        }
        let mut sums = self.begin(start, |size| PagedRows::new(size, memory, folder))?;
        let started = Instant::now();
        let film = &self.camera.film;
        let limit = self.settings.time_limit_s.map(|limit| -> Result<f64, ExposeError> {
            if !self.settings.truth {
                return Ok(limit);
            }
            // Some rows in the middle stand for all.
            let trial = film.rows / 2..(film.rows / 2 + STRIP_STEP).min(film.rows);
            let share = film.rows as f64 / trial.len() as f64;
            truth(self.scene, self.camera, self.shutter, trial, watch.cancel).ok_or(ExposeError::Cancelled)?;
            Ok((limit - started.elapsed().as_secs_f64() * share).max(0.0))
        });
        let limit = limit.transpose()?;
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

    /// What wavelengths count for, and how they are drawn.
    fn curves(&self) -> (Curves, WavelengthSampler) {
        match self.settings.rgb {
            false => (Curves::new(&self.response.curves), WavelengthSampler::for_bands(&self.response.curves)),
            true => (Curves::rgb(), WavelengthSampler::rgb()),
        }
    }

    /// What tiles are computed with.
    fn unit<'a>(&'a self, curves: &'a Curves, wavelengths: &'a WavelengthSampler) -> Unit<'a> {
        let Exposure { scene, camera, shutter, response, settings, .. } = *self;
        let behind = camera.film.microlenses.map(|m| m.behind(&camera.lens));
        Unit { scene, camera, shutter, curves, response, wavelengths, settings, behind, cascade: self.cascade() }
    }

    /// The samples that are asked for.
    fn wanted(&self) -> Range<u32> {
        self.settings.samples.start..self.settings.samples.end.min(self.settings.spp)
    }

    /// The cascade by which fireflies are re-weighted; `None` where they are kept.
    fn cascade(&self) -> Option<Cascade> {
        let electrons = self.response.bands.iter().all(|b| b.unit == BandUnit::Electrons);
        match self.settings.fireflies {
            Fireflies::Reweight { white_e } if electrons && self.settings.is_whole() => Some(Cascade::new(white_e)),
            _ => None,
        }
    }

    /// Bands that are summed: those of the film, and of each buffer of the cascade.
    fn summed_bands(&self) -> usize {
        self.response.curves.len() * if self.cascade().is_some() { SUMS_WITH_CASCADE } else { 1 }
    }

    /// The sums to go on from, or new ones.
    fn begin<S: RowStore>(
        &self,
        start: Option<Sums<S>>,
        rows: impl FnOnce([usize; 3]) -> std::io::Result<S>,
    ) -> Result<Sums<S>, ExposeError> {
        let film = &self.camera.film;
        let (width, height, bands) = (film.columns, film.rows, self.summed_bands());
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
        let film = &self.camera.film;
        let (width, height) = (film.columns, film.rows);
        let wanted = self.wanted();
        let sampling = Instant::now();
        let (curves, wavelengths) = self.curves();
        let unit = self.unit(&curves, &wavelengths);
        let caustics = self.caustics().filter(|caustics| self.shows_caustics(&unit, caustics));
        let length = match &caustics {
            None => pass_length(width * height),
            Some(_) => integrator::map_samples(width * height),
        };
        let mut photons: Option<(u32, [PhotonMap; 2])> = None;
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
                let end = pass_end(done, length).min(wanted.end);
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
            // A pass ends with the samples of its maps at the latest.
            let map = done / length;
            if let Some(caustics) = &caustics
                && photons.as_ref().is_none_or(|(number, _)| *number != map)
            {
                // One pair at a time in memory.
                drop(photons.take());
                photons = Some((map, [0, 1].map(|replicate| caustics.map(map, replicate))));
            }
            let of_pass = photons.as_ref().map(|(_, maps)| maps);
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
                        let tile = unit.tile(index, pass.clone(), before, of_pass);
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
                    && keep(sums).is_break()
                {
                    return Err(ExposeError::Cancelled);
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

/// Ground truth of some rows along chief rays, in the middle of the time each pixel is open; `None` once `cancel` is set.
fn truth(scene: &Scene, camera: &Camera, shutter: &Shutter, rows: Range<usize>, cancel: &AtomicBool) -> Option<Truth> {
    truth_of(&|ray| scene.first_surface(ray), camera, shutter, rows, cancel)
}

/// What denoisers are guided by: as the truth, but with albedo and normals of what smooth glass and mirrors show.
pub(crate) fn features(scene: &Scene, camera: &Camera, shutter: &Shutter) -> Truth {
    let go_on = AtomicBool::new(false);
    let rows = camera.film.rows;
    let look = |ray: &Ray| scene.first_rough_surface(ray);
    truth_of(&look, camera, shutter, 0..rows, &go_on).unwrap_or_else(|| Truth::empty(camera.film.columns, rows))
}

type Look<'a> = &'a (dyn Fn(&Ray) -> Option<FirstSurface> + Sync);

fn truth_of(look: Look, camera: &Camera, shutter: &Shutter, rows: Range<usize>, cancel: &AtomicBool) -> Option<Truth> {
    let (width, height) = (camera.film.columns, camera.film.rows);
    let mut truth = Truth::empty(width, rows.len());
    // All around there is no axis: depth is distance.
    let all_around = match &camera.lens {
        Lens::Pinhole(p) => matches!(p.projection, Projection::Panorama { .. }),
        Lens::Calibrated(lens) => !lens.has_axis(),
        _ => false,
    };
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
        let ray = ray.ok().filter(Ray::is_finite)?;
        let s = look(&ray)?;
        Some((s.distance * if all_around { 1.0 } else { camera.cosine_to_axis(ray.direction, time) }, s))
    };
    // Each row where it belongs: no second copy of the planes.
    let Truth { depth, normal, albedo, id } = &mut truth;
    let guides = normal.data.par_chunks_mut(3 * width).zip(albedo.data.par_chunks_mut(3 * width));
    let planes = depth.data.par_chunks_mut(width).zip(id.data.par_chunks_mut(width)).zip(guides);
    let whole = planes.enumerate().try_for_each(|(row, ((depth, id), (normal, albedo)))| {
        if cancel.load(Ordering::Relaxed) {
            return None;
        }
        for column in 0..width {
            let Some((distance, s)) = first(column, rows.start + row) else { continue };
            depth[column] = distance;
            normal[3 * column..3 * column + 3].copy_from_slice(&s.normal.to_array());
            albedo[3 * column..3 * column + 3].copy_from_slice(&s.albedo.to_array());
            id[column] = s.object + 1;
        }
        Some(())
    });
    whole.map(|()| truth)
}

//! The exposure: pixels × samples of light through lens and shutter onto the film.
//!
//! Tiles are shared out over the threads of the current rayon pool. A pixel's numbers depend on nothing but seed, pixel and
//! sample, and are summed in double precision in an order that is always the same, so the result is the same for any number of threads and
//! however often it was interrupted ([`Sums`]).

mod blur;
mod camera_rays;
mod diffraction;
mod dispersion_variate;
pub(crate) mod error;
mod fireflies;
mod frames;
mod integrator;
mod light_tracing;
mod paged;
mod pixel_cone;
mod pixel_groups;
pub(crate) mod response;
mod roulette;
pub(crate) mod settings;
mod starbursts;
mod sums;
mod tile;
mod tile_sums;
mod trial;
mod truth;
mod unit;

pub use diffraction::{Diffraction, diffraction_shows};
pub use error::ExposeError;
pub use fireflies::{Fireflies, SUMS_WITH_CASCADE};
pub use frames::Frames;
pub(crate) use integrator::may_make_photons;
pub use paged::{ExposedPaged, ExposedRows};
pub use response::{Analyzer, Response};
pub use settings::{Half, Integrator, Settings};
pub use sums::{Sums, SumsCallback};
pub(crate) use truth::{features, object_names};

use crate::camera::Camera;
use crate::row_store::{PagedRows, RowStore};
use crate::shutter::Shutter;
use crate::stray::{Seen, StrayLight};
use camera_rays::RADIANCE_REDRAWS;
use diffraction::Optics;
use diopter_image::focal_plane::{BandUnit, STRIP_STEP, Truth, bytes_a_pixel};
use diopter_image::{ExposureFacts, FocalPlane, Raster};
use diopter_lens::Lens;
use diopter_light::wavelength::WavelengthSampler;
use diopter_scene::Scene;
use diopter_scene::light_paths::{LightVertices, PhotonMap};
use fireflies::Cascade;
use pixel_cone::PixelCones;
use rayon::prelude::*;
use response::Curves;
use starbursts::{Starbursts, star_sums};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;
use sums::{Finished, Tile, means, write_direct_truth};
use tile::PassPaths;
use truth::Recorder;
use unit::Unit;

/// Pixels a side of the squares that threads take.
const TILE: usize = 16;

/// Pixels around a tile that its samples may land in: through a real lens each wavelength has its own film point. What lands
/// farther away is kept pixel by pixel.
const MARGIN: usize = 4;

/// Told what goes on during an exposure; may be asked from any thread.
pub struct ProgressReporter<'a> {
    /// Set to stop.
    pub cancel: &'a AtomicBool,
    /// Called with the fraction that is done, 0 to 1.
    pub progress: &'a (dyn Fn(f64) + Sync),
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
    /// Stray light that is part of the mean: with it taken away, the plane is that of a lens without.
    pub stray: Option<Arc<StrayLight>>,
}

/// Some pixels of an exposure.
pub(crate) struct PixelBlock {
    left: usize,
    top: usize,
    width: usize,
    bands: usize,
    /// `[row][column][band]`
    mean: Vec<f32>,
    half_difference: Vec<f32>,
}

impl PixelBlock {
    /// Mean of each band of a pixel of the film. `[column, row]` must lie in the block.
    pub fn mean(&self, pixel: [usize; 2]) -> &[f32] {
        &self.mean[self.bands_of(pixel)]
    }

    /// Half the difference of the two halves of the samples of each band of a pixel, whose mean square is the variance of the mean.
    pub fn half_difference(&self, pixel: [usize; 2]) -> &[f32] {
        &self.half_difference[self.bands_of(pixel)]
    }

    fn bands_of(&self, [column, row]: [usize; 2]) -> Range<usize> {
        let start = ((row - self.top) * self.width + column - self.left) * self.bands;
        start..start + self.bands
    }
}

/// Exposes a film to a scene, which must have been posed ([`Scene::pose`]) for the whole time the shutter takes.
///
/// `facts` is passed on, with samples and seed filled in. The mean of a band in electrons is what one pixel of area
/// [`crate::Film::pixel_area_mm2`] collects; of a band in radiance, the
/// mean over all rays from the pixel's area and the pupil that the lens lets pass, drawn evenly: a lossless view of the scene through this lens, in
/// which neither vignetting nor transmittance shows; 0 where nothing passes. A pixel at the edge of the image circle reads the mean of its lit
/// part; what passes less than a tenth of the pupil reads up to 0.1 % low, and darker places lower still. Fails as [`Exposure::run`].
pub fn expose(
    scene: &Scene,
    camera: &Camera,
    shutter: &Shutter,
    response: &Response,
    settings: &Settings,
    facts: &ExposureFacts,
    watch: &ProgressReporter,
) -> Result<FocalPlane, ExposeError> {
    let exposed = Exposure { scene, camera, shutter, response, settings, facts }.run(watch, None, None)?;
    Ok(exposed.plane)
}

/// Paths of a pass over the film, if that makes a number of samples between 2 and 256: some seconds of two cores.
const PASS_PATHS: usize = 1 << 22;
/// Tiles for each thread that are computed before their sums are added: enough that threads hardly wait for each other.
const TILES_AT_ONCE: usize = 64;
/// The fewest, so that no thread waits long for the last tile.
const LEAST_TILES_AT_ONCE: usize = 8;
/// How often sums can be saved, s.
const KEPT_EVERY_S: f64 = 1.0;

/// Bytes that exposing takes at most beside the scene: for each pixel, and for the tiles that all threads work on.
///
/// A pixel has two sums in double precision a band, its mean and half difference when they are done, and depth, normal, albedo and id. `summed`: bands
/// that are summed ([`summed_bands`]).
pub fn bytes_needed(bands: usize, summed: usize) -> (usize, usize) {
    let (sums, plane) = (2 * 8 * summed, bytes_a_pixel(bands));
    let tile = (TILE + 2 * MARGIN).pow(2) * sums;
    (sums + plane, TILES_AT_ONCE * rayon::current_num_threads().max(1) * tile)
}

/// Bands that the sums of an exposure hold, of so many that the film records: more where fireflies are re-weighted, where lamps make stars, and where direct
/// light is recorded.
pub fn summed_bands(bands: usize, fireflies: bool, starbursts: bool, direct: bool) -> usize {
    let light = bands * if fireflies { SUMS_WITH_CASCADE } else { 1 } + if starbursts { star_sums(bands) } else { 0 };
    light + if direct { bands * if starbursts { 2 } else { 1 } } else { 0 }
}

/// Samples of a pass: a power of two that depends on the number of pixels alone.
fn pass_length(pixels: usize) -> u32 {
    1u32 << (PASS_PATHS / pixels.max(1)).max(1).ilog2().clamp(1, 8)
}

/// Tiles that are taken before whoever keeps the sums is asked whether to save them: what [`KEPT_EVERY_S`] allows at the rate so far, enough for all threads. Which tiles are taken together
/// does not change what they sum to.
fn tiles_at_once(tile_samples_a_second: f64, samples: usize, threads: usize) -> usize {
    let affordable = KEPT_EVERY_S * tile_samples_a_second / samples.max(1) as f64;
    (affordable as usize).clamp(LEAST_TILES_AT_ONCE * threads, TILES_AT_ONCE * threads)
}

/// Where the pass ends that begins with a sample: at 2, 4, 8 ..., so that there is soon a picture to look at, and then at multiples of `length`. That depends on the
/// sample alone: sums are added in the same order however an exposure is interrupted.
fn pass_end(first: u32, length: u32) -> u32 {
    let doubled = (first + 1).checked_next_power_of_two().unwrap_or(u32::MAX).max(2);
    (first / length + 1).saturating_mul(length).min(doubled)
}

impl Exposure<'_> {
    /// Exposes from the beginning, or goes on from where `start` stands.
    ///
    /// `keep` gets the sums again and again, tens to hundreds of milliseconds apart, to save them or look at them ([`Exposure::so_far`]) if it likes. Without it [`ProgressReporter::cancel`] gives
    /// [`ExposeError::Cancelled`]; with it the pass under way is finished, and its samples and those before are the result. While the truth is computed,
    /// before the first sample, [`ProgressReporter::cancel`] gives [`ExposeError::Cancelled`] in both cases, and so does a `keep` that breaks. Fails with [`ExposeError::Nothing`]
    /// without a pixel, a band or a sample, and with [`ExposeError::Foreign`] where `start` has another size, other bands or samples.
    pub fn run(&self, watch: &ProgressReporter, start: Option<Sums>, keep: Option<SumsCallback>) -> Result<Exposed, ExposeError> {
        let mut sums = self.begin(start, |[width, height, numbers]| Ok(Raster::new(width, height, numbers)))?;
        let started = Instant::now();
        let film = &self.camera.film;
        // Before the samples: a time limit then knows how long it takes.
        let mut truth = match self.settings.truth {
            true => self.recorder().rows(0..film.rows, watch.cancel).ok_or(ExposeError::Cancelled)?,
            false => Truth::missing(self.recorder().recorded(), film.columns, film.rows),
        };
        let optics = self.optics();
        let stopped = self.take_samples(watch, &mut sums, keep, started, self.settings.time_limit_s, optics.as_ref())?;
        let (Finished { mean, half_difference, direct, .. }, facts) = self.planes_of(&sums, optics.as_ref());
        if let Some(direct) = direct {
            write_direct_truth(&mut truth, &self.response.bands, &mean, &direct);
        }
        let plane = FocalPlane { bands: self.response.bands.clone(), mean, half_difference, truth, facts };
        Ok(Exposed { plane, stopped, stray: None })
    }

    /// The picture so far of an exposure that is under way, for whoever keeps its sums ([`SumsCallback`]): to the bit what [`Exposure::run`] gives where it ends with the samples that all
    /// pixels have, without its truth. `None` before the first pass, in the midst of one, when pixels have different numbers of samples, and of the sums of another exposure.
    pub fn so_far(&self, sums: &Sums) -> Option<FocalPlane> {
        let film = &self.camera.film;
        let is_ours = sums.belong_to([film.columns, film.rows, self.summed_bands()], &self.wanted());
        if !is_ours || sums.samples.is_empty() || sums.tiles > 0 {
            return None;
        }
        let (Finished { mean, half_difference, .. }, facts) = self.planes_of(sums, self.optics().as_ref());
        let truth = Truth::missing(self.recorder().recorded(), film.columns, film.rows);
        Some(FocalPlane { bands: self.response.bands.clone(), mean, half_difference, truth, facts })
    }

    /// What sums come to, and what is known of them.
    fn planes_of(&self, sums: &Sums, optics: Option<&Optics>) -> (Finished, ExposureFacts) {
        let mut facts = self.facts_of(sums);
        let bands = self.response.curves.len();
        let starbursts = optics.filter(|_| self.separates_starbursts()).map(|optics| Starbursts {
            optics,
            camera: self.camera,
            seed: self.settings.seed,
            bands,
            before: summed_bands(bands, self.cascade().is_some(), false, false),
            direct: self.direct().map(|from| from + bands),
            reweight: self.cascade().is_some(),
        });
        let planes = sums.finish(bands, self.cascade(), starbursts, self.direct());
        facts.fireflies_removed = planes.removed;
        (planes, facts)
    }

    /// The stray light that the settings ask for, to be added to the mean once all else is done with it; `seen` gathers that mean. `None` where there is none.
    pub fn stray_light(&self, seen: impl FnOnce(&mut Seen)) -> Option<Arc<StrayLight>> {
        // Lamps are not polarised: of what they send into the lens a polariser takes the same wherever it stands.
        let passed = self.settings.polarizer.map_or(1.0, |p| p.transmittance);
        let settings = Settings { light_scale: self.settings.light_scale * passed, ..self.settings.clone() };
        let of = |seen: Option<&Seen>| StrayLight::of(self.scene, self.camera, self.shutter, self.response, &settings, seen);
        if !self.settings.stray.scatter {
            return of(None).map(Arc::new);
        }
        let mut gathered = Seen::new(&self.camera.film, self.response.bands.len());
        seen(&mut gathered);
        of(Some(&gathered)).map(Arc::new)
    }

    /// [`Exposure::run`] for planes that memory cannot hold: about `memory` bytes of the sums are in memory, the others in a temporary file in `folder`. The
    /// truth is computed when the rows are asked for; a time limit leaves time for it. Fireflies are kept: the cascade would take six times the room; and
    /// what lamps diffract far out is gathered as all light is, with its noise. Fails as [`Exposure::run`], and with [`ExposeError::Disk`] where the file cannot be
    /// written or read.
    pub fn run_paged(
        &self,
        watch: &ProgressReporter,
        start: Option<Sums<PagedRows>>,
        keep: Option<SumsCallback<PagedRows>>,
        memory: usize,
        folder: &Path,
    ) -> Result<ExposedPaged, ExposeError> {
        if self.settings.fireflies != Fireflies::Keep || self.separates_starbursts() {
            let diffraction = match self.settings.diffraction {
                Diffraction::Off => Diffraction::Off,
                Diffraction::On { .. } => Diffraction::On { white_e: None },
            };
            let settings = Settings { fireflies: Fireflies::Keep, diffraction, ..self.settings.clone() };
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
            let fraction = film.rows as f64 / trial.len() as f64;
            self.recorder().rows(trial, watch.cancel).ok_or(ExposeError::Cancelled)?;
            Ok((limit - started.elapsed().as_secs_f64() * fraction).max(0.0))
        });
        let limit = limit.transpose()?;
        let optics = self.optics();
        let stopped = self.take_samples(watch, &mut sums, keep, started, limit, optics.as_ref())?;
        Ok(ExposedPaged {
            camera: self.camera.clone(),
            shutter: *self.shutter,
            recorded: self.recorder().recorded(),
            settings: self.settings.clone(),
            bands: self.response.bands.clone(),
            facts: self.facts_of(&sums),
            sums,
            stopped,
        })
    }

    /// The pixels of the tile that holds a pixel, alone: as a whole exposure has them, but that outliers are kept, that pixels lend one another no light, and that what lamps diffract far out and what
    /// light is traced from them is gathered along paths as all light is.
    pub(crate) fn tile_around(&self, [column, row]: [usize; 2]) -> PixelBlock {
        let diffraction = match self.settings.diffraction {
            Diffraction::Off => Diffraction::Off,
            Diffraction::On { .. } => Diffraction::On { white_e: None },
        };
        let settings = Settings { truth: false, fireflies: Fireflies::Keep, diffraction, ..self.settings.clone() };
        let exposure = Exposure { settings: &settings, ..*self };
        let optics = exposure.optics();
        let (curves, wavelengths) = exposure.curves();
        let unit = exposure.unit(&curves, &wavelengths, optics.as_ref());
        let (film, bands, wanted) = (&self.camera.film, self.response.curves.len(), self.wanted());
        let (left, top) = (column / TILE * TILE, row / TILE * TILE);
        let (width, height) = (TILE.min(film.columns - left), TILE.min(film.rows - top));
        // Colours of samples of other tiles land here, too.
        let around = if matches!(self.camera.lens, Lens::Compound(_)) { 1 } else { 0 };
        let near = |at: usize, tiles: usize| (at / TILE).saturating_sub(around)..=(at / TILE + around).min(tiles - 1);
        let (across, down) = (film.columns.div_ceil(TILE), film.rows.div_ceil(TILE));
        let indices: Vec<usize> = near(row, down).flat_map(|y| near(column, across).map(move |x| y * across + x)).collect();
        let own = width * height * 2 * bands;
        let tiles: Vec<Tile> =
            indices.into_par_iter().map(|i| unit.tile(i, wanted.clone(), vec![0.0; own], PassPaths::default())).collect();
        let mut sums = vec![0.0; own];
        let mut add = |x: usize, y: usize, values: &[f64]| {
            if (left..left + width).contains(&x) && (top..top + height).contains(&y) {
                let start = ((y - top) * width + x - left) * 2 * bands;
                sums[start..start + 2 * bands].iter_mut().zip(values).for_each(|(a, b)| *a += b);
            }
        };
        for tile in tiles {
            for (i, values) in tile.sums.chunks_exact(2 * bands).enumerate() {
                add(tile.column + i % tile.width, tile.row + i / tile.width, values);
            }
            for (pixel, values) in &tile.outside {
                add(pixel % film.columns, pixel / film.columns, values.as_flattened());
            }
        }
        let mut block = PixelBlock { left, top, width, bands, mean: vec![0.0; own / 2], half_difference: vec![0.0; own / 2] };
        means(&wanted, &sums, &mut block.mean, &mut block.half_difference);
        block
    }

    /// Records the truth.
    fn recorder(&self) -> Recorder<'_> {
        Recorder::new(self.scene, self.camera, self.shutter, self.settings)
    }

    /// What wavelengths count for, and how they are drawn.
    fn curves(&self) -> (Curves, WavelengthSampler) {
        match self.settings.rgb {
            false => (Curves::new(&self.response.curves), WavelengthSampler::for_bands(&self.response.curves)),
            true => (Curves::rgb(), WavelengthSampler::rgb()),
        }
    }

    /// What tiles are computed with.
    fn unit<'a>(&'a self, curves: &'a Curves, wavelengths: &'a WavelengthSampler, optics: Option<&'a Optics>) -> Unit<'a> {
        let Exposure { scene, camera, shutter, response, settings, .. } = *self;
        let behind = camera.film.microlenses.map(|m| m.behind(&camera.lens));
        let starbursts = self.separates_starbursts();
        Unit {
            scene,
            camera,
            shutter,
            curves,
            response,
            wavelengths,
            settings,
            behind,
            cascade: self.cascade(),
            optics,
            starbursts,
            direct: self.direct(),
            immersion: truth::immersion(scene, camera),
            cones: PixelCones::of(scene, camera),
            polarized: self.is_polarized(),
            analyzers: response.analyzer_groups(),
            light_traced: false,
            groups: None,
            roulette: None,
        }
    }

    /// Whether light is followed with its polarisation.
    fn is_polarized(&self) -> bool {
        self.settings.is_polarized() || self.response.tells_polarization()
    }

    /// Whether the film counts electrons.
    fn in_electrons(&self) -> bool {
        self.response.bands.iter().all(|b| b.unit == BandUnit::Electrons)
    }

    /// Diffraction, where it is asked for and there is any.
    fn optics(&self) -> Option<Optics> {
        Optics::of(self.camera, self.settings.diffraction, self.in_electrons())
    }

    /// Whether the sums hold what lamps send far out.
    fn separates_starbursts(&self) -> bool {
        self.in_electrons() && matches!(self.settings.diffraction, Diffraction::On { white_e: Some(_) })
    }

    /// The samples that are asked for.
    fn wanted(&self) -> Range<u32> {
        self.settings.samples.start..self.settings.samples.end.min(self.settings.spp)
    }

    /// The cascade by which fireflies are re-weighted; `None` where they are kept.
    fn cascade(&self) -> Option<Cascade> {
        match self.settings.fireflies {
            Fireflies::Reweight { white_e } if self.in_electrons() && self.settings.is_whole() => Some(Cascade::new(white_e)),
            _ => None,
        }
    }

    /// Bands that are summed: those of the film, of each buffer of the cascade, and of stars.
    fn summed_bands(&self) -> usize {
        let (fireflies, starbursts) = (self.cascade().is_some(), self.separates_starbursts());
        summed_bands(self.response.curves.len(), fireflies, starbursts, self.settings.records_direct())
    }

    /// Where the sums of direct light begin, where it is recorded.
    fn direct(&self) -> Option<usize> {
        let bands = self.response.curves.len();
        let before = summed_bands(bands, self.cascade().is_some(), self.separates_starbursts(), false);
        self.settings.records_direct().then_some(before)
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
        if width == 0 || height == 0 || self.response.curves.is_empty() || wanted.is_empty() {
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
                groups: None,
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
        watch: &ProgressReporter,
        sums: &mut Sums<S>,
        mut keep: Option<SumsCallback<S>>,
        started: Instant,
        time_limit_s: Option<f64>,
        optics: Option<&Optics>,
    ) -> Result<bool, ExposeError> {
        let film = &self.camera.film;
        let (width, height) = (film.columns, film.rows);
        let wanted = self.wanted();
        let sampling = Instant::now();
        let (curves, wavelengths) = self.curves();
        let mut unit = self.unit(&curves, &wavelengths, optics);
        let lamps = self.light_tracing(&unit);
        unit.light_traced = lamps.is_some();
        let caustics = self.caustics().filter(|caustics| self.shows_caustics(&unit, caustics));
        let connections = self.connections(&unit);
        let may_reuse = self.may_reuse();
        unit.groups = may_reuse.then(|| pixel_groups::PixelGroups::new(film, unit.in_radiance()));
        unit.roulette = self.roulette_rates(&unit);
        let help = self.help(&unit, connections.as_ref(), caustics.as_ref());
        let connections = connections.filter(|_| help == trial::Help::Connections);
        unit.groups = unit.groups.filter(|_| help == trial::Help::Reuse);
        unit.roulette = unit.roulette.filter(|_| help == trial::Help::Alone);
        sums.groups = unit.groups;
        let unit = unit;
        let length = match caustics.is_some() || connections.is_some() {
            false => pass_length(width * height),
            true => integrator::map_samples(width * height),
        };
        let mut photons: Option<(u32, [PhotonMap; 2])> = None;
        let mut vertices: Option<(u32, [LightVertices; 2])> = None;
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        let threads = rayon::current_num_threads().max(1);
        let mut tile_samples_a_second = f64::INFINITY;
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
            if let Some(connections) = &connections
                && vertices.as_ref().is_none_or(|(number, _)| *number != map)
            {
                drop(vertices.take());
                vertices = Some((map, [0, 1].map(|replicate| connections.pool(map, replicate))));
            }
            let of_pass = PassPaths {
                photons: photons.as_ref().map(|(_, maps)| maps),
                vertices: vertices.as_ref().map(|(_, pools)| pools),
                lamps: lamps.as_ref(),
            };
            tiles_done.store(sums.tiles, Ordering::Relaxed);
            let fraction = |tile: usize| match time_limit_s {
                None => {
                    let samples = (done - wanted.start) as f64 + pass.len() as f64 * tile as f64 / tiles as f64;
                    samples / wanted.len() as f64
                }
                Some(limit) => (started.elapsed().as_secs_f64() / limit).min(1.0),
            };
            while sums.tiles < tiles {
                let at_once = match &keep {
                    None => TILES_AT_ONCE * threads,
                    Some(_) => tiles_at_once(tile_samples_a_second, pass.len(), threads),
                };
                let batch = sums.tiles..(sums.tiles + at_once).min(tiles);
                let begun = Instant::now();
                let before = batch.clone().map(|index| unit.before(index, sums)).collect::<Result<Vec<_>, _>>()?;
                let results: Vec<Option<Tile>> = before
                    .into_par_iter()
                    .zip(batch.clone())
                    .map(|(before, index)| {
                        if at_once_if_stopped && stopped() {
                            return None;
                        }
                        let tile = unit.tile(index, pass.clone(), before, of_pass);
                        (watch.progress)(fraction(tiles_done.fetch_add(1, Ordering::Relaxed) + 1));
                        Some(tile)
                    })
                    .collect();
                for tile in results {
                    sums.add(tile.ok_or(ExposeError::Cancelled)?)?;
                }
                tile_samples_a_second = (batch.len() * pass.len()) as f64 / begun.elapsed().as_secs_f64().max(1e-6);
                sums.tiles = batch.end;
                if sums.tiles == tiles {
                    if let Some(lamps) = &lamps {
                        let stop = || at_once_if_stopped && stopped();
                        let traced = lamps.pass(&unit, pass.clone(), stop, |splats| sums.add_splats(splats, unit.direct))?;
                        traced.ok_or(ExposeError::Cancelled)?;
                    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_double_until_they_are_long_and_do_not_depend_on_where_an_exposure_begins() {
        let ends = |first: u32| -> Vec<u32> {
            std::iter::successors(Some(first), |first| Some(pass_end(*first, 16))).skip(1).take(6).collect()
        };
        assert_eq!(ends(0), [2, 4, 8, 16, 32, 48]);
        assert_eq!(ends(6), [8, 16, 32, 48, 64, 80]);
        assert_eq!(ends(40), [48, 64, 80, 96, 112, 128]);
        assert_eq!(pass_end(u32::MAX - 3, 256), u32::MAX);
    }
}

//! Stray light in the picture, beside what the exposure gathers: ghosts of the lamps, and veiling glare.
//!
//! Ghosts: every lamp that the front of the lens sees (punctual lights, emissive surfaces, the sun's disc) lights it with one beam or some; what is in the way
//! is tested from the front to the lamp. A grid of rays of each beam follows each pair of surfaces ([`diopter_lens::ghosts`]) at eight wavelengths;
//! its cells become triangles on the film whose light is spread over their area (Hullin et al. 2011, doi 10.1145/2010324.1965003). A beam stands for a
//! cell of a lamp: its ghost is smeared along the two ways that it takes as the source crosses the cell, so that the ghosts of neighbouring cells join.
//!
//! Glare (`veil`): what surfaces and walls scatter of the light of the picture, by the lens's glare spread function; of lamps beyond the frame, traced beam by
//! beam ([`diopter_lens::glare`]).
//!
//! There is no chance in it that depends on samples or threads: random walks have seeds of their own. All of it is linear in the picture, so that parts of the
//! samples merge to the whole.
//!
//! What the sensor's microlenses throw back as a grating are ghosts, too (`orders`).
//!
//! Limits: camera and lamps stand as they do in the middle of the exposure; what is no lamp and lies beyond the frame gives no glare; ghosts have two reflections, and four where that is nearly
//! as bright (those of the picture's other light, which glare holds, any number); lamps without extent, whose image no camera ray meets, have theirs; spectra are taken together over 50 nm (100 nm in
//! glare); behind microlens arrays, and through ideal lenses (thin lens, pinhole, calibrated camera), whose surfaces do not exist, there is none.

mod choice;
mod orders;
mod veil;

pub use choice::Stray;
pub use veil::Seen;

use crate::camera::{Camera, Film};
use crate::expose::{Response, Settings};
use crate::mount::M2_PER_MM2;
use crate::shutter::{Place, Shutter};
use diopter_image::channels::STRAY_LIGHT;
use diopter_image::focal_plane::{Band, BandUnit, FocalPlaneSource};
use diopter_image::truth::Values;
use diopter_image::{ExposureFacts, FocalPlane, ImageError, Raster};
use diopter_lens::ghosts::{BeamGhost, GhostTracer, SENSOR_REFLECTANCE, SourceBeam, pairs, strong_fours};
use diopter_lens::glare::{BINS_NM, GlareTracer, Kind, Unfit};
use diopter_lens::{CompoundLens, Lens, System};
use diopter_light::Wavelengths;
use diopter_light::wavelength::FIRST_NM;
use diopter_scene::Scene;
use diopter_scene::light::{LightRef, Modulation, PunctualKind};
use diopter_scene::radiance::Incident;
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use veil::Veil;

/// Wavelengths at which rays are traced, and the width that each stands for, nm.
const BINS: usize = 8;
const BIN_NM: f32 = 50.0;
/// Step in which spectra of lamps are looked at, nm.
const STEP_NM: f32 = 10.0;
/// Most beams; of more, the strongest are taken.
const MOST_BEAMS: usize = 64;
/// Columns of the raster that ghosts are drawn in, at most: they have hardly finer detail.
const COLUMNS: usize = 640;
/// Rays across the front of the first look, of the estimate, and of strong and weak ghosts.
const LOOK: usize = 24;
const ESTIMATE: usize = 12;
const STRONG: usize = 48;
const WEAK: usize = 20;
/// Ghosts this strong (of the strongest one's irradiance) are strong.
const STRONG_SHARE: f64 = 0.02;
/// Part of the ghost light on the film that may be left out with the weakest ghosts.
const LEFT_OUT: f64 = 0.01;
/// Ghosts of four reflections: those at least this bright beside the brightest of two, at most so many.
const FOUR_SHARE: f64 = 0.005;
const MOST_FOURS: usize = 16;
/// Cells at the rim of a ghost are halved until they are so small (cells of the raster), at most so often.
const RIM_CELLS: f32 = 1.5;
const RIM_DEPTH: f32 = 4.0;
/// Halved so often or more, triangles hold all of the light.
const RIM_SURE: u32 = 3;
/// Triangles smaller than this (raster cells) are splatted, not filled; filled are parts of cells, so many along each side.
const SMALL: f32 = 0.5;
const PARTS: usize = 2;
/// Ghosts drawn before they are added up: the rasters of so many are in memory.
const AT_ONCE: usize = 64;
/// A lamp seen under a larger angle than this is cut into more cells, rad.
const CELL_RAD: f32 = 0.07;
/// Ghosts smeared over so many cells of the raster are drawn on one twice as coarse; most such steps.
const SMEAR: f64 = 6.0;
const MOST_STEPS: usize = 4;
/// Rays over the front for the glare of all lamps beyond the frame, and the fewest for one.
const ASTRAY: f64 = 6144.0;
const ASTRAY_LEAST: usize = 48;
/// Steps in which light that changes with time is summed over the time a pixel is open.
const TIME_STEPS: usize = 256;

/// Light of lamps that change with time alike.
#[derive(Clone, Debug)]
struct Part {
    modulation: Modulation,
    /// What each band counts of the irradiance, e⁻ s⁻¹ m⁻², on a raster over the film.
    light: Raster<f32>,
}

/// Stray light on the film.
#[derive(Clone, Debug)]
pub struct StrayLight {
    parts: Vec<Part>,
    film: Film,
    shutter: Shutter,
    open_s: f64,
    /// Collecting area of a pixel (m²) times the scale of all light.
    scale: f64,
    /// Beams that make it, and of all light that lamps send onto the front the fraction of those that were too weak.
    pub beams: usize,
    /// See [`StrayLight::beams`].
    pub left_out: f64,
    /// Veiling glare of the picture: of which lens, and how much, electrons on a raster over the film.
    glare: Option<(Arc<Veil>, Raster<f32>)>,
}

/// Light of a lamp, or of a part of one, on the front of the lens.
struct Beam {
    source: SourceBeam,
    /// From the edges of its cell of the lamp, half a cell away in two directions.
    edges: [Option<SourceBeam>; 2],
    /// Whether camera rays meet the lamp.
    visible: bool,
    modulation: Modulation,
    /// What each band counts of its irradiance in each bin of wavelengths, e⁻ s⁻¹ m⁻².
    counts: Vec<[f64; BINS]>,
}

impl Beam {
    fn strength(&self) -> f64 {
        self.counts.iter().flatten().map(|v| v.abs()).sum()
    }
}

/// What is drawn: a beam, the surfaces that throw it back one after the other, the part of the front and the rays across it.
struct Job<'a> {
    beam: &'a Beam,
    turns: Vec<usize>,
    corners: [DVec2; 2],
    across: usize,
    /// How far on the film the ghost moves as the source crosses its cell in two directions, mm.
    moves: [DVec2; 2],
}

impl Job<'_> {
    /// How often the raster is halved before the ghost is drawn: it has no detail finer than its moves.
    fn coarser(&self, cell_mm: f64) -> usize {
        let [a, b] = self.moves.map(|m| m.length());
        let steps = (a.min(b) / (SMEAR * cell_mm)).max(1.0).log2();
        (steps as usize).min(MOST_STEPS)
    }
}

/// Some cells of the raster, `[row][column][band]`; those beyond its edges are there to be smeared.
struct Patch {
    left: i64,
    top: i64,
    columns: usize,
    data: Vec<f32>,
}

impl Patch {
    /// Smears it evenly along a way, in cells.
    fn smeared(self, way: Vec2, bands: usize) -> Patch {
        let length = way.abs().max_element();
        if !(length > 0.25) || self.columns == 0 {
            return self;
        }
        let steps = (length.ceil() as usize).clamp(2, 32);
        let margin = (0.5 * length).ceil() as usize + 1;
        let (rows, columns) = (self.data.len() / (self.columns * bands), self.columns + 2 * margin);
        let mut data = vec![0.0; columns * (rows + 2 * margin) * bands];
        for k in 0..steps {
            let shift = way * ((k as f32 + 0.5) / steps as f32 - 0.5) + margin as f32;
            let (first, t) = (shift.floor(), shift - shift.floor());
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let weight = (if dx == 1 { t.x } else { 1.0 - t.x }) * (if dy == 1 { t.y } else { 1.0 - t.y }) / steps as f32;
                for (row, line) in self.data.chunks_exact(self.columns * bands).enumerate() {
                    let start = ((row + first.y as usize + dy) * columns + first.x as usize + dx) * bands;
                    data[start..start + line.len()].iter_mut().zip(line).for_each(|(sum, v)| *sum += weight * v);
                }
            }
        }
        Patch { left: self.left - margin as i64, top: self.top - margin as i64, columns, data }
    }

    /// Adds what lies on a raster to it.
    fn add_to(&self, raster: &mut Raster<f32>) {
        let bands = raster.channels;
        let (width, height) = (raster.width as i64, raster.height as i64);
        let (from, to) = ((-self.left).clamp(0, self.columns as i64), (width - self.left).clamp(0, self.columns as i64));
        if from >= to {
            return;
        }
        for (k, line) in self.data.chunks_exact(self.columns * bands).enumerate() {
            let row = self.top + k as i64;
            if (0..height).contains(&row) {
                let start = (row * width + self.left + from) as usize * bands;
                let line = &line[from as usize * bands..to as usize * bands];
                raster.data[start..start + line.len()].iter_mut().zip(line).for_each(|(sum, v)| *sum += v);
            }
        }
    }
}

impl StrayLight {
    /// Traces it; `seen`: the picture, for glare. `None` where there is none: not asked for, no lamp lights the front of the lens (and no glare is asked for), the
    /// lens is ideal or behind it are microlenses, or the film does not count electrons.
    pub fn of(
        scene: &Scene,
        camera: &Camera,
        shutter: &Shutter,
        response: &Response,
        settings: &Settings,
        seen: Option<&Seen>,
    ) -> Option<StrayLight> {
        let Lens::Compound(lens) = &camera.lens else { return None };
        let electrons = response.bands.iter().all(|b| b.unit == BandUnit::Electrons);
        let stray = settings.stray;
        if !stray.is_added() || !electrons || camera.film.microlenses.is_some() || settings.half.is_some() {
            return None;
        }
        let system = lens.system();
        let film = camera.film;
        // A lens whose glare cannot be traced has been told of ([`glare_unfit`]).
        let veil = if stray.scatter && seen.is_some() { Veil::of(system, &film, response).ok() } else { None };
        let time = 0.5 * shutter.total_s();
        let mut beams = beams(scene, camera, lens, response, time);
        let all: f64 = beams.iter().map(Beam::strength).sum();
        // Stable: beams of the same strength keep their order.
        beams.sort_by(|a, b| b.strength().total_cmp(&a.strength()));
        beams.truncate(MOST_BEAMS);
        if all <= 0.0 && veil.is_none() {
            return None;
        }
        let strongest: f64 = beams.iter().map(Beam::strength).sum();
        let left_out = if all > 0.0 { 1.0 - strongest / all } else { 0.0 };
        let bands = response.bands.len();
        let columns = film.columns.clamp(1, COLUMNS);
        let size = [columns, (columns * film.rows).div_ceil(film.columns.max(1)).max(1)];
        let mut parts = if stray.ghosts { ghosts_of(system, &beams, &film, size, bands) } else { vec![] };
        let scale = film.pixel_area_mm2 * M2_PER_MM2 * settings.light_scale;
        let mut glare = None;
        if let (Some(veil), Some(seen)) = (veil, seen) {
            let open_s = scene.open_s();
            let half = DVec2::new(0.5 * film.width_mm, 0.5 * film.height_mm);
            let on_film = |at: DVec2| (at + DVec2::from_array(film.middle_mm)).abs().cmple(half).all();
            let window = shutter.window(&Place {
                pixel: [film.columns / 2, film.rows / 2],
                size: [film.columns, film.rows],
                pupil: std::f64::consts::FRAC_1_SQRT_2,
            });
            let tracer = GhostTracer::new(system, f64::from(bin_nm(BINS / 2)), 0.0);
            // Lamps of the picture are in what is seen of it; their reflections are the ghosts.
            let images: Vec<Option<BeamGhost>> = beams
                .par_iter()
                .map(|b| {
                    let image =
                        b.source.extent(&tracer, &[], LOOK).and_then(|c| BeamGhost::within(&tracer, &b.source, &[], c, ESTIMATE));
                    image.filter(|i| b.visible && on_film(i.center))
                })
                .collect();
            let lamps: Vec<(DVec2, Vec<f64>)> = beams
                .iter()
                .zip(&images)
                .filter_map(|(beam, image)| {
                    let image = image.filter(|_| stray.ghosts)?;
                    let factor = image.flux_mm2 * seconds(&beam.modulation, open_s, window) * scale;
                    Some((image.center, beam.counts.iter().map(|c| c.iter().sum::<f64>() * factor).collect()))
                })
                .collect();
            let beyond: Vec<&Beam> = beams.iter().zip(&images).filter(|b| b.1.is_none()).map(|b| b.0).collect();
            add_astray(&mut parts, system, &beyond, &film, size, bands);
            let light = veil.light(&seen.raster(), &lamps);
            glare = Some((Arc::new(veil), light));
        }
        Some(StrayLight { parts, film, shutter: *shutter, open_s: scene.open_s(), scale, beams: beams.len(), left_out, glare })
    }

    /// Adds it to the mean of some rows of the film.
    pub fn add_to(&self, mean: &mut Raster<f32>, first_row: usize) {
        self.move_light(mean, first_row);
        self.add_ghosts(mean, first_row, 1.0);
    }

    /// Adds it to some rows of a plane, and tells their truth, where it is recorded, what it changed.
    pub fn change(&self, plane: &mut FocalPlane, first_row: usize) {
        let recorded = plane.truth.float(STRAY_LIGHT.name).is_some();
        let before = recorded.then(|| plane.mean.clone());
        self.add_to(&mut plane.mean, first_row);
        let Some(before) = before else { return };
        let colors = colors_of(&plane.bands);
        let bands = plane.mean.channels;
        for (channel, values) in plane.truth.iter_mut() {
            let (true, Values::Float(to)) = (channel == STRAY_LIGHT, values) else { continue };
            for (i, pixel) in to.data.chunks_exact_mut(colors.len()).enumerate() {
                for (to, band) in pixel.iter_mut().zip(colors) {
                    *to = plane.mean.data[i * bands + band] - before.data[i * bands + band];
                }
            }
        }
    }

    /// Takes it away from a mean that it was added to.
    pub fn take_from(&self, mean: &mut Raster<f32>) {
        self.add_ghosts(mean, 0, -1.0);
        let Some((veil, light)) = &self.glare else { return };
        let (width, height, bands) = (mean.width, self.film.rows, mean.channels);
        mean.data.par_chunks_mut((width * bands).max(1)).enumerate().for_each(|(row, line)| {
            let (mut kept, mut there) = (vec![1.0; bands], vec![0.0; bands]);
            for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
                veil.kept_at((column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64, &mut kept);
                there.fill(0.0);
                add_at(light, &self.film, [column, row], 1.0, &mut there);
                for ((v, kept), there) in pixel.iter_mut().zip(&kept).zip(&there) {
                    *v = (*v - there) / kept.max(1e-3);
                }
            }
        });
    }

    /// Moves light of the picture to where the lens scatters it.
    fn move_light(&self, mean: &mut Raster<f32>, first_row: usize) {
        let Some((veil, light)) = &self.glare else { return };
        let (width, height, bands) = (mean.width, self.film.rows, mean.channels);
        mean.data.par_chunks_mut((width * bands).max(1)).enumerate().for_each(|(k, line)| {
            let row = first_row + k;
            let mut kept = vec![1.0; bands];
            for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
                veil.kept_at((column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64, &mut kept);
                pixel.iter_mut().zip(&kept).for_each(|(v, kept)| *v *= kept);
                add_at(light, &self.film, [column, row], 1.0, pixel);
            }
        });
    }

    /// Light of lamps by ways of its own (`sign` 1), or taken away (−1).
    fn add_ghosts(&self, mean: &mut Raster<f32>, first_row: usize, sign: f32) {
        if self.parts.is_empty() {
            return;
        }
        let (width, bands) = (mean.width, mean.channels);
        mean.data.par_chunks_mut((width * bands).max(1)).enumerate().for_each(|(k, line)| {
            let row = first_row + k;
            let mut last = ((f64::NAN, f64::NAN), vec![0.0; self.parts.len()]);
            for (column, pixel) in line.chunks_exact_mut(bands).enumerate() {
                // Blades near the stop: the mean square of the place in the pupil.
                let size = [self.film.columns, self.film.rows];
                let window = self.shutter.window(&Place { pixel: [column, row], size, pupil: std::f64::consts::FRAC_1_SQRT_2 });
                if window != last.0 {
                    last = (window, self.parts.iter().map(|p| seconds(&p.modulation, self.open_s, window)).collect());
                }
                for (part, seconds) in self.parts.iter().zip(&last.1) {
                    add_at(&part.light, &self.film, [column, row], (seconds * self.scale) as f32 * sign, pixel);
                }
            }
        });
    }

    /// What lamps send by ways of their own, electrons `[row][column][band]`.
    #[cfg(test)]
    fn electrons(&self, bands: usize) -> Raster<f32> {
        let mut alone = Raster::new(self.film.columns, self.film.rows, bands);
        self.add_ghosts(&mut alone, 0, 1.0);
        alone
    }
}

/// Bands that stand for red, green and blue: those of these names, else the first, the middle and the last.
pub(crate) fn colors_of(bands: &[Band]) -> [usize; 3] {
    let last = bands.len().saturating_sub(1);
    let named = |name: &str, otherwise: usize| bands.iter().position(|b| b.name == name).unwrap_or(otherwise);
    [named("R", 0), named("G", last / 2), named("B", last)]
}

/// Why the glare of a lens cannot be traced, if it cannot.
pub fn glare_unfit(lens: &CompoundLens) -> Option<Unfit> {
    GlareTracer::new(lens.system(), BINS_NM[1], DVec2::ONE, 0.0).err()
}

/// The lens at a wavelength (nm) before the film's sensor.
fn tracer<'a>(system: &'a System, film: &Film, nm: f32) -> GhostTracer<'a> {
    GhostTracer::new(system, f64::from(nm), SENSOR_REFLECTANCE).with_microlenses([film.pixel_area_mm2.sqrt(); 2])
}

/// The ghosts of beams, lamps that change alike together.
fn ghosts_of(system: &System, beams: &[Beam], film: &Film, [columns, rows]: [usize; 2], bands: usize) -> Vec<Part> {
    let tracers: Vec<GhostTracer> = (0..BINS).into_par_iter().map(|k| tracer(system, film, bin_nm(k))).collect();
    let middle = &tracers[BINS / 2];
    let fours = strong_fours(middle, FOUR_SHARE, MOST_FOURS).into_iter().map(|four| four.to_vec());
    let ways: Vec<Vec<usize>> = pairs(system).into_iter().map(|p| vec![p.back, p.forth]).chain(fours).collect();
    let jobs: Vec<Job> = beams.iter().flat_map(|beam| jobs(beam, &ways, middle, film)).collect();
    let cell_mm = film.width_mm / columns as f64;
    // By modulation, and by how coarse a raster is.
    let mut drawn: Vec<(usize, Part)> = vec![];
    for chunk in jobs.chunks(AT_ONCE) {
        let patches: Vec<Option<Patch>> = chunk
            .par_iter()
            .map(|job| {
                let coarser = 1 << job.coarser(cell_mm);
                draw(job, &tracers, film, [columns.div_ceil(coarser), rows.div_ceil(coarser)], bands)
            })
            .collect();
        // In the order of the jobs, whatever thread drew them.
        for (job, patch) in chunk.iter().zip(patches) {
            let Some(patch) = patch else { continue };
            let steps = job.coarser(cell_mm);
            let known = drawn.iter().position(|(s, p)| *s == steps && p.modulation == job.beam.modulation);
            let number = known.unwrap_or_else(|| {
                let light = Raster::new(columns.div_ceil(1 << steps), rows.div_ceil(1 << steps), bands);
                drawn.push((steps, Part { modulation: job.beam.modulation, light }));
                drawn.len() - 1
            });
            patch.add_to(&mut drawn[number].1.light);
        }
    }
    let mut parts: Vec<Part> = vec![];
    for (steps, part) in drawn {
        let to = part_of(&mut parts, part.modulation, [columns, rows], bands);
        match steps {
            0 => to.light.data.iter_mut().zip(&part.light.data).for_each(|(sum, v)| *sum += v),
            _ => veil::add_stretched(&part.light, &mut to.light),
        }
    }
    let size = [columns, rows];
    orders::draw_all(system, beams, film, size, bands, |beam, patch| {
        patch.add_to(&mut part_of(&mut parts, beams[beam].modulation, size, bands).light);
    });
    parts
}

/// The part of lamps that change so.
fn part_of(parts: &mut Vec<Part>, modulation: Modulation, [columns, rows]: [usize; 2], bands: usize) -> &mut Part {
    let number = parts.iter().position(|p| p.modulation == modulation).unwrap_or_else(|| {
        parts.push(Part { modulation, light: Raster::new(columns, rows, bands) });
        parts.len() - 1
    });
    &mut parts[number]
}

/// Adds what walls and surfaces scatter of the light of lamps whose image is not in the picture.
fn add_astray(parts: &mut Vec<Part>, system: &System, beams: &[&Beam], film: &Film, size: [usize; 2], bands: usize) {
    let Ok(tracers) = BINS_NM
        .iter()
        .map(|nm| GlareTracer::new(system, *nm, DVec2::splat(film.reach().length()), SENSOR_REFLECTANCE))
        .collect::<Result<Vec<_>, _>>()
    else {
        return;
    };
    let all: f64 = beams.iter().map(|b| b.strength()).sum();
    let light: Vec<Raster<f32>> = beams
        .par_iter()
        .enumerate()
        .map(|(k, beam)| {
            let rays = ((ASTRAY * beam.strength() / all) as usize).max(ASTRAY_LEAST) / tracers.len();
            let mut found = vec![];
            for (bin, tracer) in tracers.iter().enumerate() {
                let of_bin = |counts: &[f64; BINS]| -> f64 {
                    let of_bin = (0..BINS).filter(|i| veil::bin_of(f64::from(bin_nm(*i))) == bin);
                    of_bin.map(|i| counts[i]).sum()
                };
                let counts: Vec<f64> = beam.counts.iter().map(of_bin).collect();
                let arrivals = tracer.astray(&beam.source, (k * tracers.len() + bin) as u64, rays);
                let scattered = arrivals.into_iter().filter(|a| a.0 == Kind::Scatter);
                found.extend(scattered.map(|(_, at, mm2)| (at, counts.iter().map(|c| c * mm2).collect::<Vec<f64>>())));
            }
            veil::of_lamp(film, &found, size, bands)
        })
        .collect();
    for (beam, light) in beams.iter().zip(&light) {
        let part = part_of(parts, beam.modulation, size, bands);
        part.light.data.iter_mut().zip(&light.data).for_each(|(sum, v)| *sum += v);
    }
}

/// Middle of a bin of wavelengths, nm.
fn bin_nm(bin: usize) -> f32 {
    FIRST_NM + BIN_NM * (bin as f32 + 0.5)
}

/// Time during which a lamp shines on a pixel that is open in a window, in seconds of its steady light.
fn seconds(modulation: &Modulation, open_s: f64, (open, close): (f64, f64)) -> f64 {
    if close <= open {
        return 0.0;
    }
    match *modulation {
        Modulation::Steady => close - open,
        Modulation::Pulse { start_s, length_s, energy } => {
            energy * ((close.min(start_s + length_s) - open.max(start_s)).max(0.0) / length_s)
        }
        other => {
            let step = (close - open) / TIME_STEPS as f64;
            let at = |k: usize| f64::from(other.at(open_s, (open + (k as f64 + 0.5) * step) as f32));
            (0..TIME_STEPS).map(at).sum::<f64>() * step
        }
    }
}

/// Beams of all lamps onto the front of the lens.
fn beams(scene: &Scene, camera: &Camera, lens: &CompoundLens, response: &Response, time_s: f64) -> Vec<Beam> {
    let system = lens.system();
    let Some(front) = SourceBeam::new(system, DVec3::Z).map(|b| b.middle()) else { return vec![] };
    let pupil = lens.entrance_pupil();
    let world_from_lens = camera.way.at(time_s);
    let lens_from_world = world_from_lens.inverse();
    let point: Vec3 = world_from_lens.transform_point3(((front - pupil) * 1e-3).as_vec3());
    let lights = scene.lights();
    let area = (0..lights.area.len() as u32).map(LightRef::Area);
    let punctual = (0..lights.punctual.len() as u32).map(LightRef::Punctual);
    let towards = |lamp: LightRef, u: [f32; 2]| {
        let nm = Wavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        scene.incident(lamp, point, u, &nm, time_s as f32, 4)
    };
    // A lamp with extent is cut into cells: large ones into more, where there are few lamps.
    let most = ((MOST_BEAMS as f64 / lights.area.len().max(1) as f64).sqrt() as usize).clamp(1, 8);
    let side_of = |lamp: LightRef| {
        let corners = [[0.02, 0.02], [0.98, 0.02], [0.02, 0.98], [0.98, 0.98]].map(|u| towards(lamp, u).map(|l| l.direction));
        let seen: Vec<Vec3> = corners.into_iter().flatten().collect();
        let angle = seen.iter().flat_map(|a| seen.iter().map(|b| a.angle_between(*b))).fold(0.0, f32::max);
        ((angle / CELL_RAD).ceil() as usize).clamp(most.min(3), most)
    };
    let places: Vec<(LightRef, [f32; 2], f64)> = area
        .flat_map(|lamp| {
            let side = side_of(lamp);
            let cell = move |i: usize| (i as f32 + 0.5) / side as f32;
            (0..side * side).map(move |k| (lamp, [cell(k % side), cell(k / side)], 1.0 / (side * side) as f64))
        })
        // The middle of the sun stands for its disc: ghosts are larger, or the sun is small beside them.
        .chain(punctual.map(|lamp| {
            let disc =
                matches!(lamp, LightRef::Punctual(i) if matches!(lights.punctual[i as usize].kind, PunctualKind::Disc { .. }));
            (lamp, if disc { [0.0; 2] } else { [0.5; 2] }, 1.0)
        }))
        .collect();
    let beam = |(lamp, u, part): &(LightRef, [f32; 2], f64)| {
        let (mut counts, mut first) = (vec![[0.0; BINS]; response.curves.len()], None::<Incident>);
        let steps = (BINS as f32 * BIN_NM / STEP_NM) as usize;
        for k in (0..steps).step_by(4) {
            let nm: [f32; 4] = std::array::from_fn(|c| FIRST_NM + STEP_NM * ((k + c) as f32 + 0.5));
            // Dark at these four, or hidden.
            let Some(light) = scene.incident(*lamp, point, *u, &Wavelengths::fixed(nm), time_s as f32, 4) else { continue };
            for (nm, irradiance) in nm.into_iter().zip(light.irradiance.to_array()) {
                let bin = (((nm - FIRST_NM) / BIN_NM) as usize).min(BINS - 1);
                for (band, curve) in counts.iter_mut().zip(&response.curves) {
                    band[bin] += f64::from(irradiance * curve.at(nm) * STEP_NM) * part;
                }
            }
            first.get_or_insert(light);
        }
        let light = first?;
        let beam_of = |light: &Incident| {
            if !light.distance.is_finite() {
                return SourceBeam::new(system, lens_from_world.transform_vector3(-light.direction).as_dvec3());
            }
            let lamp = lens_from_world.transform_point3(point + light.direction * light.distance);
            SourceBeam::from_point(system, lamp.as_dvec3() * 1e3 + pupil)
        };
        let source = beam_of(&light)?;
        // Of a lamp with extent, half a cell to either side: where it is hidden there, the other way.
        let half = 0.5 * part.sqrt() as f32;
        let edge = |du: f32, dv: f32| {
            let at = |sign: f32| {
                let edge = towards(*lamp, [u[0] + sign * du, u[1] + sign * dv])?;
                beam_of(&edge)
            };
            matches!(lamp, LightRef::Area(_)).then(|| at(0.999).or_else(|| at(-0.999))).flatten()
        };
        let edges = [edge(half, 0.0), edge(0.0, half)];
        let visible = match lamp {
            LightRef::Punctual(i) => matches!(lights.punctual[*i as usize].kind, PunctualKind::Disc { .. }),
            _ => true,
        };
        Some(Beam { source, edges, visible, modulation: light.modulation, counts })
    };
    let found: Vec<Option<Beam>> = places.par_iter().map(beam).collect();
    found.into_iter().flatten().filter(|b| b.strength() > 0.0).collect()
}

/// The ghosts of a beam that matter on the film.
fn jobs<'a>(beam: &'a Beam, ways: &[Vec<usize>], tracer: &GhostTracer, film: &Film) -> Vec<Job<'a>> {
    let film_area = film.width_mm * film.height_mm;
    type OfWay<'w> = (&'w Vec<usize>, [DVec2; 2], BeamGhost);
    let found: Vec<Option<OfWay>> = ways
        .par_iter()
        .map(|turns| {
            let corners = beam.source.extent(tracer, turns, LOOK)?;
            let ghost = BeamGhost::within(tracer, &beam.source, turns, corners, ESTIMATE)?;
            let reach = film.reach();
            let [low, high] = ghost.bounds;
            // A margin: the estimate has few rays.
            let margin = 0.2 * (high - low) + 0.1;
            let meets = (low - margin).cmple(reach).all() && (high + margin).cmpge(-reach).all();
            meets.then_some((turns, corners, ghost))
        })
        .collect();
    let mut found: Vec<_> = found.into_iter().flatten().collect();
    let on_film = |g: &BeamGhost| g.irradiance() * g.area_mm2().min(film_area);
    found.sort_by(|a, b| on_film(&b.2).total_cmp(&on_film(&a.2)));
    let all: f64 = found.iter().map(|f| on_film(&f.2)).sum();
    let strongest = found.iter().map(|f| f.2.irradiance()).fold(0.0, f64::max);
    let mut before = 0.0;
    let mut jobs = vec![];
    for (turns, corners, ghost) in found {
        // A small ghost may be bright and bring little light.
        let strong = ghost.irradiance() > STRONG_SHARE * strongest;
        if strong || before < (1.0 - LEFT_OUT) * all {
            // As the source crosses its cell the ghost moves about twice as far as from the middle to an edge.
            let moves = beam.edges.map(|edge| {
                let moved = edge.and_then(|edge| {
                    let corners = edge.extent(tracer, turns, LOOK)?;
                    BeamGhost::within(tracer, &edge, turns, corners, ESTIMATE)
                });
                moved.map_or(DVec2::ZERO, |moved| 2.0 * (moved.center - ghost.center))
            });
            jobs.push(Job { beam, turns: turns.clone(), corners, across: if strong { STRONG } else { WEAK }, moves });
        }
        before += on_film(&ghost);
    }
    jobs
}

/// Draws a ghost; `None` where none of it is on the film.
fn draw(job: &Job, tracers: &[GhostTracer], film: &Film, [columns, rows]: [usize; 2], bands: usize) -> Option<Patch> {
    let cells = DVec2::new(columns as f64, rows as f64);
    let size = DVec2::new(film.width_mm, film.height_mm);
    let cell_mm2 = (size.x * size.y) / (cells.x * cells.y);
    let place = on_raster(film, [columns, rows]);
    let ways = job.moves.map(|m| (DVec2::new(-m.x, m.y) / size * cells).as_vec2());
    let margin = (0.5 * (ways[0].abs() + ways[1].abs()).max_element()).ceil() + if ways == [Vec2::ZERO; 2] { 0.0 } else { 2.0 };
    let mut patches: Vec<(usize, Region)> = vec![];
    for (bin, tracer) in tracers.iter().enumerate() {
        if job.beam.counts.iter().all(|band| band[bin] == 0.0) {
            continue;
        }
        let node = |at: DVec2| {
            let arrival = tracer.follow(job.beam.source.ray(at), &job.turns).ok()?;
            let light = arrival.fraction * job.beam.source.power_density(at);
            Some((place(arrival.film), light)).filter(|n| n.0.is_finite())
        };
        let mesh = Mesh::of(&node, job.corners, job.across);
        let Some(mut region) = mesh.bounds().and_then(|[a, b]| Region::around(a, b, [columns, rows], margin)) else { continue };
        mesh.lay(1.0 / cell_mm2, &mut region);
        patches.push((bin, region));
    }
    let out = assemble(patches, job.beam, bands)?;
    Some(ways.into_iter().fold(out, |patch, way| patch.smeared(way, bands)))
}

/// Raster coordinates of a film point: the picture stands upside down on the film.
fn on_raster(film: &Film, [columns, rows]: [usize; 2]) -> impl Fn(DVec2) -> Vec2 {
    let cells = DVec2::new(columns as f64, rows as f64);
    let (size, middle) = (DVec2::new(film.width_mm, film.height_mm), DVec2::from_array(film.middle_mm));
    move |at: DVec2| {
        let at = (at + middle) / size;
        (DVec2::new(0.5 - at.x, 0.5 + at.y) * cells).as_vec2()
    }
}

/// Where light of a place on the front lands (cells of the raster), and how much it is for a unit of area there.
type Node = (Vec2, f64);

/// Light of a part of the front as triangles on the film.
struct Mesh {
    triangles: Vec<([Vec2; 3], f64)>,
    /// Places so lonely that they make no triangle.
    dots: Vec<Node>,
}

impl Mesh {
    /// Of a rectangle of the front, by so many cells across; cells at the rim of what is lit are cut in halves until they are small on the film.
    fn of(node: &impl Fn(DVec2) -> Option<Node>, [low, high]: [DVec2; 2], across: usize) -> Mesh {
        let side = across + 1;
        let step = (high - low) / across as f64;
        let at = |k: usize| low + step * DVec2::new((k % side) as f64, (k / side) as f64);
        let nodes: Vec<Option<Node>> = (0..side * side).map(|k| node(at(k))).collect();
        let lit = || nodes.iter().flatten().map(|n| n.0);
        let (least, most) = lit().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let cell = (most - least).max_element() / across as f32;
        let depth = if cell.is_finite() { (cell / RIM_CELLS).max(1.0).log2().ceil().min(RIM_DEPTH) as u32 } else { 0 };
        let mut mesh = Mesh { triangles: vec![], dots: vec![] };
        for k in (0..side * across).filter(|k| k % side != across) {
            let corners = [k, k + 1, k + side, k + side + 1].map(|i| nodes[i]);
            mesh.cell(node, at(k), step, corners, depth);
        }
        let area = step.x * step.y;
        if mesh.triangles.is_empty() {
            mesh.dots = nodes.iter().flatten().map(|n| (n.0, n.1 * area)).collect();
        } else if depth < RIM_SURE {
            // What is lit ends somewhere beyond the last lit corners, on average half a cell: the sum of all places is right.
            let all: f64 = nodes.iter().flatten().map(|n| n.1 * area).sum();
            let filled: f64 = mesh.triangles.iter().map(|t| t.1).sum();
            mesh.triangles.iter_mut().for_each(|t| t.1 *= all / filled);
        }
        mesh
    }

    fn cell(&mut self, node: &impl Fn(DVec2) -> Option<Node>, low: DVec2, size: DVec2, corners: [Option<Node>; 4], depth: u32) {
        let lit = corners.iter().flatten().count();
        if lit == 0 {
            return;
        }
        if lit < 4 && depth > 0 {
            let half = 0.5 * size;
            let at = |x: f64, y: f64| node(low + half * DVec2::new(x, y));
            let [a, b, c, d] = corners;
            let (ab, ac, bd, cd, middle) = (at(1.0, 0.0), at(0.0, 1.0), at(2.0, 1.0), at(1.0, 2.0), at(1.0, 1.0));
            for (x, y, four) in [
                (0.0, 0.0, [a, ab, ac, middle]),
                (1.0, 0.0, [ab, b, middle, bd]),
                (0.0, 1.0, [ac, middle, c, cd]),
                (1.0, 1.0, [middle, bd, cd, d]),
            ] {
                self.cell(node, low + half * DVec2::new(x, y), half, four, depth - 1);
            }
            return;
        }
        let area = size.x * size.y;
        for three in [[0, 1, 2], [3, 2, 1]] {
            if let [Some(a), Some(b), Some(c)] = three.map(|i| corners[i]) {
                self.triangles.push(([a.0, b.0, c.0], (a.1 + b.1 + c.1) / 6.0 * area));
            }
        }
        // Three lit corners whose dark one splits both triangles.
        if let [Some(a), None, Some(c), Some(d)] | [Some(a), Some(c), None, Some(d)] = corners {
            self.triangles.push(([a.0, c.0, d.0], (a.1 + c.1 + d.1) / 6.0 * area));
        }
    }

    /// Lower and upper corner of all of it.
    fn bounds(&self) -> Option<[Vec2; 2]> {
        let places = self.triangles.iter().flat_map(|t| t.0).chain(self.dots.iter().map(|n| n.0));
        let (a, b) = places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        (a.x <= b.x).then_some([a, b])
    }

    /// Onto a region, all of it times `scale`.
    fn lay(&self, scale: f64, region: &mut Region) {
        self.triangles.iter().for_each(|(corners, light)| region.fill(*corners, (light * scale) as f32));
        self.dots.iter().for_each(|(at, light)| region.splat(*at, (light * scale) as f32));
    }
}

/// Lays light on a region: `nodes`, a square of `across` a side, tell where that of a cell of the front lands and how much it is, for each cell of `front` (cells of the raster).
fn lay(nodes: &[Option<(Vec2, f64)>], across: usize, front: f64, region: &mut Region) {
    let mut triangles = vec![];
    let mut filled = 0.0;
    for k in 0..across * (across - 1) {
        if k % across + 1 == across {
            continue;
        }
        let corner = [k, k + 1, k + across, k + across + 1].map(|i| nodes[i]);
        for three in [[0, 1, 2], [3, 2, 1]] {
            if let [Some(a), Some(b), Some(c)] = three.map(|i| corner[i]) {
                let light = (a.1 + b.1 + c.1) / 6.0;
                filled += light;
                triangles.push(([a.0, b.0, c.0], light));
            }
        }
    }
    // Cells at the edge of the pupil are half a cell short: what nodes bring in all is kept.
    let all: f64 = nodes.iter().flatten().map(|n| n.1).sum();
    if filled > 0.0 {
        for (corners, light) in triangles {
            region.fill(corners, (light * all / filled * front) as f32);
        }
    } else {
        nodes.iter().flatten().for_each(|(at, light)| region.splat(*at, (light * front) as f32));
    }
}

/// Regions by bins of wavelengths as one patch of what the bands count of a beam; `None` of nothing.
fn assemble(patches: Vec<(usize, Region)>, beam: &Beam, bands: usize) -> Option<Patch> {
    let left = patches.iter().map(|p| p.1.left).min()?;
    let top = patches.iter().map(|p| p.1.top).min()?;
    let right = patches.iter().map(|p| p.1.left + p.1.columns as i64).max()?;
    let bottom = patches.iter().map(|p| p.1.top + p.1.rows as i64).max()?;
    let (width, height) = ((right - left) as usize, (bottom - top) as usize);
    let mut out = Patch { left, top, columns: width, data: vec![0.0; width * height * bands] };
    for (bin, region) in &patches {
        let counts: Vec<f32> = beam.counts.iter().map(|band| band[*bin] as f32).collect();
        for (k, light) in region.light.iter().enumerate().filter(|(_, light)| **light != 0.0) {
            let (from_left, from_top) = ((region.left - left) as usize, (region.top - top) as usize);
            let (column, row) = (from_left + k % region.columns, from_top + k / region.columns);
            let start = (row * out.columns + column) * bands;
            out.data[start..start + bands].iter_mut().zip(&counts).for_each(|(sum, count)| *sum += light * count);
        }
    }
    Some(out)
}

/// Irradiance on some cells of the raster, over that of the beam at the front.
struct Region {
    left: i64,
    top: i64,
    columns: usize,
    rows: usize,
    light: Vec<f32>,
}

impl Region {
    /// The cells of a raster, and `margin` cells around it, that a rectangle meets, with a cell around for splats; `None` beside them.
    fn around(low: Vec2, high: Vec2, size: [usize; 2], margin: f32) -> Option<Region> {
        let (start, end) = (Vec2::splat(-margin), Vec2::new(size[0] as f32, size[1] as f32) + margin);
        if !(low.cmplt(end + 1.0).all() && high.cmpgt(start - 1.0).all()) {
            return None;
        }
        let first = (low.floor() - 1.0).clamp(start, end - 1.0);
        let last = (high.floor() + 1.0).clamp(start, end - 1.0);
        let [left, top, right, bottom] = [first.x, first.y, last.x, last.y].map(|v| v as i64);
        let (columns, rows) = ((right + 1 - left) as usize, (bottom + 1 - top) as usize);
        Some(Region { left, top, columns, rows, light: vec![0.0; columns * rows] })
    }

    /// Spreads light over a triangle.
    fn fill(&mut self, [a, b, c]: [Vec2; 3], light: f32) {
        let twice = (b - a).perp_dot(c - a);
        let area = 0.5 * twice.abs();
        if area < SMALL {
            for at in [a + b, b + c, c + a] {
                self.splat(0.5 * at, light / 3.0);
            }
            return;
        }
        let sense = twice.signum();
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        // By parts of cells, whose middles lie within or not: triangles that share an edge share none of them.
        let parts = PARTS as f32;
        let range = |low: f32, high: f32, start: i64, count: usize| {
            let part = |v: f32| (v - start as f32 * parts).clamp(0.0, (count * PARTS) as f32) as usize;
            part((low * parts - 0.5).ceil())..part((high * parts - 0.5).floor() + 1.0)
        };
        let even = light / area / (parts * parts);
        for row in range(low.y, high.y, self.top, self.rows) {
            for column in range(low.x, high.x, self.left, self.columns) {
                let p = Vec2::new(self.left as f32 + (column as f32 + 0.5) / parts, self.top as f32 + (row as f32 + 0.5) / parts);
                let side = |a: Vec2, b: Vec2| (b - a).perp_dot(p - a) * sense >= 0.0;
                if side(a, b) && side(b, c) && side(c, a) {
                    self.light[row / PARTS * self.columns + column / PARTS] += even;
                }
            }
        }
    }

    /// Distributes light over the four cells around a place.
    fn splat(&mut self, at: Vec2, light: f32) {
        let corner = at - 0.5;
        let (first, part) = (corner.floor(), corner - corner.floor());
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (first.x as i64 + dx - self.left, first.y as i64 + dy - self.top);
            let fraction = (if dx == 1 { part.x } else { 1.0 - part.x }) * (if dy == 1 { part.y } else { 1.0 - part.y });
            if (0..self.columns as i64).contains(&x) && (0..self.rows as i64).contains(&y) {
                self.light[y as usize * self.columns + x as usize] += light * fraction;
            }
        }
    }
}

/// Adds the value of a raster over the film at the middle of a pixel, bilinear.
fn add_at(raster: &Raster<f32>, film: &Film, [column, row]: [usize; 2], scale: f32, pixel: &mut [f32]) {
    let along = |k: usize, pixels: usize, cells: usize| {
        let at = ((k as f32 + 0.5) * cells as f32 / pixels as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
        let i = (at as usize).min(cells.saturating_sub(2));
        (i, (i + 1).min(cells - 1), at - i as f32)
    };
    let (x0, x1, fx) = along(column, film.columns, raster.width);
    let (y0, y1, fy) = along(row, film.rows, raster.height);
    let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| raster.pixel(x, y));
    for (k, value) in pixel.iter_mut().enumerate() {
        let (top, bottom) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
        *value += scale * (top + (bottom - top) * fy);
    }
}

/// A focal plane that is read row by row, with its stray light.
pub struct WithStray<'a> {
    plane: Box<dyn FocalPlaneSource + 'a>,
    stray: Arc<StrayLight>,
    next: usize,
}

impl<'a> WithStray<'a> {
    /// Adds stray light to a plane without.
    pub fn new(plane: Box<dyn FocalPlaneSource + 'a>, stray: Arc<StrayLight>) -> Self {
        WithStray { plane, stray, next: 0 }
    }
}

impl FocalPlaneSource for WithStray<'_> {
    fn bands(&self) -> &[Band] {
        self.plane.bands()
    }

    fn facts(&self) -> &ExposureFacts {
        self.plane.facts()
    }

    fn recorded(&self) -> &diopter_image::truth::Recorded {
        self.plane.recorded()
    }

    fn size(&self) -> [usize; 2] {
        self.plane.size()
    }

    fn rows_at_once(&self) -> usize {
        self.plane.rows_at_once()
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let Range { start, end } = self.next..self.next + rows;
        let mut plane = self.plane.next_rows(rows)?;
        self.stray.change(&mut plane, start);
        self.next = end;
        Ok(plane)
    }
}

#[cfg(test)]
mod tests;

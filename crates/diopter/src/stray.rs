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

mod beams;
pub(crate) mod choice;
mod ghosts;
mod orders;
mod raster;
mod tracing;
mod veil;

pub use choice::Stray;
pub use veil::Seen;

use crate::camera::{Camera, Film};
use crate::expose::response::Response;
use crate::expose::settings::Settings;
use crate::mount::M2_PER_MM2;
use crate::shutter::{Place, Shutter};
use beams::{Beam, beams};
use diopter_image::channels::STRAY_LIGHT;
use diopter_image::focal_plane::{Band, BandUnit, FocalPlaneSource};
use diopter_image::truth::Values;
use diopter_image::{ExposureFacts, FocalPlane, ImageError, Raster};
use diopter_lens::ghosts::{BeamGhost, GhostTracer, SENSOR_REFLECTANCE, SourceBeam};
use diopter_lens::glare::{BINS_NM, GlareTracer, Kind, Unfit};
use diopter_lens::{CompoundLens, Lens, System};
use diopter_light::wavelength::FIRST_NM;
use diopter_scene::Scene;
use diopter_scene::light::Modulation;
use ghosts::{ESTIMATE, ghosts_of};
use glam::DVec2;
use raster::add_at;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use tracing::LOOK;
use veil::Veil;

/// Wavelengths at which rays are traced, and the width that each stands for, nm.
const BINS: usize = 8;
const BIN_NM: f32 = 50.0;

/// Most beams; of more, the strongest are taken.
const MOST_BEAMS: usize = 64;

/// Columns of the raster that ghosts are drawn in, at most: they have hardly finer detail.
const COLUMNS: usize = 640;

/// Rays over the front for the glare of all lamps beyond the frame, and the fewest for one.
const STRAY_RAYS: f64 = 6144.0;
const LEAST_STRAY_RAYS: usize = 48;

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
            let on_film = |at: DVec2| (at + DVec2::from_array(film.center_mm)).abs().cmple(half).all();
            let window = shutter.window(&Place {
                pixel: [film.columns / 2, film.rows / 2],
                size: [film.columns, film.rows],
                pupil: std::f64::consts::FRAC_1_SQRT_2,
            });
            let tracer = GhostTracer::new(system, f64::from(bin_nm(BINS / 2)), 0.0);
            // Lamps of the picture are in what is seen of it; their reflections are the ghosts.
            let image = |source: &SourceBeam| {
                source.extent(&tracer, &[], LOOK).and_then(|c| BeamGhost::within(&tracer, source, &[], c, ESTIMATE))
            };
            let images: Vec<Option<InPicture>> = beams
                .par_iter()
                .map(|b| {
                    let whole = image(&b.source).filter(|_| b.visible)?;
                    let arm = |edge: &Option<SourceBeam>| {
                        edge.as_ref().and_then(image).map_or(DVec2::ZERO, |i| i.center - whole.center)
                    };
                    let arms = [arm(&b.edges[0]), arm(&b.edges[1])];
                    InPicture::of(whole, arms, on_film)
                })
                .collect();
            let lamps: Vec<(DVec2, Vec<f64>)> = beams
                .iter()
                .zip(&images)
                .filter_map(|(beam, image)| {
                    let image = image.as_ref().filter(|_| stray.ghosts)?;
                    let factor = image.flux_mm2 * seconds(&beam.modulation, open_s, window) * scale;
                    Some((image.center, beam.counts.iter().map(|c| c.iter().sum::<f64>() * factor).collect()))
                })
                .collect();
            let left = |image: &Option<InPicture>| 1.0 - image.as_ref().map_or(0.0, |i| i.fraction);
            let beyond: Vec<(&Beam, f64)> =
                beams.iter().zip(&images).map(|(beam, image)| (beam, left(image))).filter(|b| b.1 > 0.0).collect();
            add_astray(&mut parts, system, &beyond, !stray.ghosts, &film, size, bands);
            let light = veil.light(&seen.raster(), &lamps);
            glare = Some((Arc::new(veil), light));
        }
        Some(StrayLight { parts, film, shutter: *shutter, open_s: scene.open_s(), scale, beams: beams.len(), left_out, glare })
    }

    /// Adds it to the mean of some rows of the film. `first_row`: the row of the film that the mean begins with.
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

    /// Subtracts it from a mean that it was added to.
    pub fn subtract_from(&self, mean: &mut Raster<f32>) {
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

/// The part of a cell of a lamp whose image lies in the picture.
struct InPicture {
    /// Of the whole cell, above 0.
    fraction: f64,
    /// Its middle, mm.
    center: DVec2,
    /// Its light, mm² of the front.
    flux_mm2: f64,
}

impl InPicture {
    /// `arms`: from the middle of the image of the cell to those of its edges; zero of lamps without extent. `None` where all of it lies beyond.
    fn of(whole: BeamGhost, arms: [DVec2; 2], on_film: impl Fn(DVec2) -> bool) -> Option<InPicture> {
        /// Places a side at which a cell is looked at.
        const SIDE: usize = 16;
        let along = |k: usize| (k as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0;
        let places = (0..SIDE * SIDE).map(|k| whole.center + arms[0] * along(k % SIDE) + arms[1] * along(k / SIDE));
        let inside: Vec<DVec2> = places.filter(|at| on_film(*at)).collect();
        let fraction = inside.len() as f64 / (SIDE * SIDE) as f64;
        (fraction > 0.0).then(|| InPicture {
            fraction,
            center: inside.iter().sum::<DVec2>() / inside.len() as f64,
            flux_mm2: whole.flux_mm2 * fraction,
        })
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

/// The part of lamps that change so.
fn part_of(parts: &mut Vec<Part>, modulation: Modulation, [columns, rows]: [usize; 2], bands: usize) -> &mut Part {
    let number = parts.iter().position(|p| p.modulation == modulation).unwrap_or_else(|| {
        parts.push(Part { modulation, light: Raster::new(columns, rows, bands) });
        parts.len() - 1
    });
    &mut parts[number]
}

/// Adds what walls and surfaces scatter of the light of lamps whose image is not in the picture, each with the fraction that is not; with what surfaces reflect, where no ghosts
/// hold that.
fn add_astray(
    parts: &mut Vec<Part>,
    system: &System,
    beams: &[(&Beam, f64)],
    with_reflections: bool,
    film: &Film,
    size: [usize; 2],
    bands: usize,
) {
    let Ok(tracers) = BINS_NM
        .iter()
        .map(|nm| GlareTracer::new(system, *nm, DVec2::splat(film.reach().length()), SENSOR_REFLECTANCE))
        .collect::<Result<Vec<_>, _>>()
    else {
        return;
    };
    let all: f64 = beams.iter().map(|(b, part)| b.strength() * part).sum();
    let light: Vec<Raster<f32>> = beams
        .par_iter()
        .enumerate()
        .map(|(k, (beam, part))| {
            let rays = ((STRAY_RAYS * beam.strength() * part / all) as usize).max(LEAST_STRAY_RAYS) / tracers.len();
            let mut found = vec![];
            for (bin, tracer) in tracers.iter().enumerate() {
                let of_bin = |counts: &[f64; BINS]| -> f64 {
                    let of_bin = (0..BINS).filter(|i| veil::bin_of(f64::from(bin_nm(*i))) == bin);
                    of_bin.map(|i| counts[i]).sum()
                };
                let counts: Vec<f64> = beam.counts.iter().map(|c| of_bin(c) * part).collect();
                let arrivals = tracer.stray_rays(&beam.source, (k * tracers.len() + bin) as u64, rays);
                let scattered = arrivals.into_iter().filter(|a| a.0 == Kind::Scatter || with_reflections && a.0 == Kind::Ghost);
                found.extend(scattered.map(|(_, at, mm2)| (at, counts.iter().map(|c| c * mm2).collect::<Vec<f64>>())));
            }
            veil::of_lamp(film, &found, size, bands)
        })
        .collect();
    for ((beam, _), light) in beams.iter().zip(&light) {
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

//! Small lamps out of focus: paths from surfaces that shine through the lens onto the film, beside the paths from the camera.
//!
//! Of the camera rays from a place in the disk of blur of a small lamp few meet the lamp: the disk is made of single bright samples. Here a place of the
//! entrance pupil is drawn, from there a point of the lamp, and the ray is run through the lens to where each wavelength lands
//! ([`diopter_lens::CompoundLens::entries`]): every sample that comes through counts. Source: light tracing (Veach 1997, ch. 10, the strategy t = 1; through
//! lenses Hanika & Dachsbacher 2014).
//!
//! # Weights
//!
//! Both strategies have the same paths ([`diopter_scene::light::Emitters`]) and are joined by the balance heuristic (Veach 1997, eq. 9.8). Densities count per
//! étendue dA cosθ dω on the side of the scene, mm² sr, for one sample of each pixel:
//!
//! - a camera sample: the mean over the four wavelengths of what each would have drawn as the hero ([`ExitRays::density`]), over the area of a
//!   pixel that collects light;
//! - light: samples of the lamp · p(point | place) [1/sr] / (area of the part of the pupil · cosθ).
//!
//! With w = camera / (camera + light) a camera path counts w of a lamp seen directly, and a light path the rest; whatever the lens or the lamp is, the
//! weights add up to one, and the mean is the same. Where the light's density is 0 (beside the tabled part of the pupil, beyond the film) camera
//! paths count fully. Moments: where nothing moves, a light path takes one from the time of the pixels on which it lands, as a camera sample does; else
//! from all the exposure, and both densities of the moment count, too.
//!
//! # How many
//!
//! Of every surface that shines 32 rays are run to the film without anything in the way ([`Pilot`]). They tell where its light lands, over how many
//! pixels, and what fraction of the camera samples there meets it. Lamps that share a disk share its samples by their light. What at least [`MAX_HIT_FRACTION`] of
//! the camera samples meet gets none: it is large, or sharp. Numbers depend on scene, camera and film alone.
//!
//! # Numbers
//!
//! Light samples are numbered within each sample of the pixels, and are drawn from seed, that number and the sample's. They are traced in chunks whose
//! sums are added in order: the same for any number of threads, in whatever parts the exposure is taken. Even and odd samples have their own, so that the half
//! difference holds their noise.
//!
//! Limits: lamps straight before the lens only (panes and fog between them are no obstacle; what is seen in mirrors or through thick glass stays with
//! camera paths); thin and real lenses; exposures in electrons without microlenses and without diffraction (then paths from the camera find all).

mod entrance;

use self::entrance::Entrance;
use super::response::GROUP;
use super::sums::Splats;
use super::unit::Unit;
use super::{Exposure, Integrator};
use crate::camera::Camera;
use crate::mount::M2_PER_MM2;
use diopter_image::focal_plane::BandUnit;
use diopter_lens::Lens;
use diopter_lens::batch::single::LANES;
use diopter_lens::compound::{EntryRays, ExitRays, Scratch};
use diopter_lens::surface::Profile;
use diopter_lens::system::PlacedSurface;
use diopter_light::Ray;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_scene::light::{Emitters, LightSample};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;

/// Most surfaces that shine with which light is traced: the pilot takes some 10 µs for each.
const MOST_EMITTERS: usize = 1 << 14;
/// Light samples for each pixel of a lamp's disk and each sample of the pixel, unless that is more than [`MOST_A_PIXEL`] on average: they cost a fraction
/// of a camera path, and disks are a small part of most pictures.
const SAMPLES_A_PIXEL: f64 = 16.0;
/// Most light samples for each pixel of the film and each sample of it.
const MOST_A_PIXEL: f64 = 2.0;
/// Fraction of camera samples that meet a lamp, within its disk, from which on it is left to them: their variance is little there, but at the edge.
const MAX_HIT_FRACTION: f64 = 0.6;
/// Light samples of a chunk.
const CHUNK: u32 = 2048;
/// Chunks for each thread that are traced before their sums are added.
const CHUNKS_AT_ONCE: usize = 8;
/// Their numbers are not those of the pixels.
const LIGHT_SEED: u64 = 0x3c6e_f372_fe94_f82b;
/// Place of the sampler's pixels that only light samples have.
const LIGHT_ROW: u32 = u32::MAX;
/// Smallest cosine to the axis of rays that are drawn.
const LEAST_COSINE: f64 = 0.05;

fn of_lane(v: [f32; 3]) -> DVec3 {
    Vec3::from_array(v).as_dvec3()
}

/// A ray from a lamp to the lens.
struct Start {
    light_sample: LightSample,
    /// Where it meets the plane of the entrance pupil: in the world (m), and in the camera's frame (mm).
    point: Vec3,
    place: DVec3,
    /// Unit direction towards the lamp, camera's frame.
    direction: DVec3,
    /// Density of one light sample of this lamp, 1 / (mm² sr).
    density: f64,
}

/// A sample that a camera draws, as it leaves the lens.
pub(super) struct CameraSample {
    /// Point of the ray, mm from the entrance pupil.
    pub origin: DVec3,
    /// Unit direction, camera's frame.
    pub direction: DVec3,
    /// In the world.
    pub ray: Ray,
    /// When, s.
    pub time: f64,
    /// One over the density of that moment, s.
    pub seconds: f64,
    /// Density of the ray, of one sample a mm² of film, 1 / (mm² sr).
    pub density: f64,
}

/// What 32 rays of a lamp tell, on a film without anything in the way.
struct Pilot {
    /// Where they land on average, pixels.
    middle: DVec2,
    /// Pixels over which its light is spread.
    area: f64,
    /// Camera samples that meet it, for one sample of each pixel.
    hits: f64,
    /// Relative light on the film.
    flux: f64,
    /// Fraction of the rays that come through.
    passed: f64,
}

/// Lamps whose disks are the same, nearly.
#[derive(Default)]
struct Disk {
    area: f64,
    hits: f64,
    flux: f64,
}

/// Light samples of an exposure.
pub(super) struct LightTracing<'a> {
    emitters: Emitters<'a>,
    entrance: Entrance,
    /// Light samples of each emitter for a sample of each pixel; they add up to `total`.
    counts: Vec<f64>,
    /// Their sum before each emitter.
    before: Vec<f64>,
    total: u32,
    /// Whether places depend on the moment.
    moves: bool,
}

impl Exposure<'_> {
    /// The light samples that this exposure takes; `None` where paths from the camera do as well.
    pub(super) fn light_tracing<'a>(&self, unit: &Unit<'a>) -> Option<LightTracing<'a>> {
        let electrons = self.response.bands.iter().all(|b| b.unit == BandUnit::Electrons);
        let settings = self.settings;
        let plain = settings.half.is_none() && !settings.redraw && !settings.rgb && unit.behind.is_none();
        // Diffraction displaces camera samples: disks of small lamps are large beside its pattern wherever they are out of focus.
        if settings.integrator == Integrator::Path || unit.polarized || !electrons || !plain || unit.optics.is_some() {
            return None;
        }
        LightTracing::new(unit)
    }
}

impl<'a> LightTracing<'a> {
    fn new(unit: &Unit<'a>) -> Option<LightTracing<'a>> {
        // Light that is traced from lamps knows the lens with nothing moved.
        if !matches!(unit.camera.lens, Lens::Thin(_) | Lens::Compound(_)) || unit.camera.motion.moving().is_some() {
            return None;
        }
        // An ideal surface within a lens maps slopes, and does not keep the étendue in which both densities are told; nor do facets in a plane.
        let breaks = |s: &PlacedSurface| s.ideal_focal_length.is_some() || matches!(s.profile, Profile::Fresnel(_));
        if let Lens::Compound(lens) = &unit.camera.lens
            && lens.system().surfaces.iter().any(breaks)
        {
            return None;
        }
        let emitters = unit.scene.emitters(MOST_EMITTERS)?;
        let entrance = Entrance::of(unit.camera)?;
        let moves = unit.scene.moves() || !unit.camera.motion.is_still();
        let mut tracing = LightTracing { emitters, entrance, counts: Vec::new(), before: Vec::new(), total: 0, moves };
        let numbers = 0..tracing.emitters.len() as u32;
        let pilots: Vec<Option<Pilot>> = numbers.into_par_iter().map(|number| tracing.pilot(unit, number)).collect();
        let mut counts = wanted(&pilots);
        let sum: f64 = counts.iter().sum();
        let film = &unit.camera.film;
        let total = sum.min(MOST_A_PIXEL * (film.columns * film.rows) as f64).ceil();
        if !(sum > 0.0 && total < f64::from(u32::MAX / 4)) {
            return None;
        }
        counts.iter_mut().for_each(|c| *c *= total / sum);
        let mut so_far = 0.0;
        let before = counts.iter().map(|c| {
            so_far += c;
            so_far - c
        });
        tracing.before = before.collect();
        (tracing.counts, tracing.total) = (counts, total as u32);
        Some(tracing)
    }

    /// A ray of a lamp by two even numbers for the place in the pupil and two for the point.
    fn start(&self, camera: &Camera, number: u32, pupil: [f32; 2], u: [f32; 2], time: f64) -> Option<Start> {
        let rectangle = self.entrance.rectangle(camera.place_of(self.emitters.middle(number, time as f32), time))?;
        let [x, y] = pupil.map(f64::from);
        let place = (rectangle.min + (rectangle.max - rectangle.min) * DVec2::new(x, y)).extend(0.0);
        let point = camera.world_point(place, time);
        let light_sample = self.emitters.sample_li(number, point, u, time as f32)?;
        let direction = camera.direction_of(light_sample.wi, time);
        if !(-direction.z > LEAST_COSINE && light_sample.pdf > 0.0) {
            return None;
        }
        let density = f64::from(light_sample.pdf) / (rectangle.area() * -direction.z);
        Some(Start { light_sample, point, place, direction, density })
    }

    /// Density of one light sample of a lamp along a camera sample that meets the lamp at a point, 1 / (mm² sr).
    fn density(&self, camera: &Camera, sample: &CameraSample, number: u32, met: Vec3) -> f64 {
        let CameraSample { origin, direction, time, .. } = *sample;
        let middle = camera.place_of(self.emitters.middle(number, time as f32), time);
        let Some(rectangle) = self.entrance.rectangle(middle) else { return 0.0 };
        let place = origin - direction * (origin.z / direction.z);
        let at = place.truncate();
        let within = at.cmpge(rectangle.min).all() && at.cmple(rectangle.max).all();
        if !(within && -direction.z > LEAST_COSINE) {
            return 0.0;
        }
        let point = camera.world_point(at.extend(0.0), time);
        let pdf = self.emitters.density(number, point, sample.ray.direction, met, time as f32);
        f64::from(pdf) / (rectangle.area() * -direction.z)
    }

    /// What both strategies make of a ray of the densities `camera` (of one sample a mm² of film) and `light` (of one light sample), at a moment that a camera
    /// sample draws with a density of 1 / `seconds`: camera density over the sum of both densities, in which the moment counts, s.
    fn joined(&self, unit: &Unit, number: u32, [camera, light]: [f64; 2], time: f64, seconds: f64) -> f64 {
        let camera = camera / unit.camera.film.collecting_area_mm2();
        let light = light * self.counts[number as usize];
        let light_seconds = match self.moves {
            true => unit.settings.shutter_times.seconds_at((0.0, unit.shutter.total_s()), time),
            false => seconds,
        };
        camera / (camera / seconds + light / light_seconds)
    }

    /// Weight of a camera sample that meets a lamp directly.
    pub fn weight(&self, unit: &Unit, sample: &CameraSample, number: u32, met: Vec3) -> f32 {
        if self.counts[number as usize] == 0.0 {
            return 1.0;
        }
        let light = self.density(unit.camera, sample, number, met);
        let joined = self.joined(unit, number, [sample.density, light], sample.time, sample.seconds);
        let weight = (joined / sample.seconds) as f32;
        if weight.is_finite() { weight } else { 1.0 }
    }

    /// The lamps.
    pub fn emitters(&self) -> &Emitters<'_> {
        &self.emitters
    }

    /// Runs rays to the film: a bit for each that a camera sample could have drawn. `shifts`: by which light is moved on the film before it is collected, mm.
    fn trace_to_film(
        camera: &Camera,
        starts: &[Option<Start>; LANES],
        nm: [[f32; 4]; LANES],
        shifts: &[DVec2; LANES],
        scratch: &mut Scratch,
        exits: &mut ExitRays,
    ) {
        let collects = |lane: usize, at: DVec2| camera.film.collects(at + shifts[lane]);
        match &camera.lens {
            Lens::Compound(lens) => {
                let mut rays = EntryRays { nm, ..EntryRays::default() };
                for (i, start) in starts.iter().enumerate() {
                    if let Some(start) = start {
                        (rays.origin[i], rays.direction[i]) = (start.place, start.direction);
                    }
                }
                lens.trace_to_film(&rays, collects, scratch, exits);
                let started = starts.iter().enumerate().fold(0, |bits, (i, s)| bits | u32::from(s.is_some()) << i);
                exits.passed &= started;
            }
            Lens::Thin(lens) => {
                (exits.passed, exits.spread) = (0, false);
                for (i, start) in starts.iter().enumerate() {
                    let entry = start.as_ref().and_then(|start| Some((start, lens.entry(start.place, start.direction)?)));
                    let Some((start, entry)) = entry.filter(|(_, entry)| collects(i, entry.film)) else { continue };
                    exits.passed |= 1 << i;
                    exits.origin[i] = entry.origin_mm.as_vec3().to_array();
                    exits.direction[i] = start.direction.as_vec3().to_array();
                    exits.film_points[i] = [entry.film.as_vec2().to_array(); 4];
                    (exits.weight[i], exits.density[i]) = ([entry.weight_sr as f32; 4], [entry.density as f32; 4]);
                }
            }
            _ => exits.passed = 0,
        }
    }

    /// Looks at where the light of a lamp lands; `None` where none does.
    fn pilot(&self, unit: &Unit, number: u32) -> Option<Pilot> {
        let camera = unit.camera;
        let span = unit.shutter.total_s();
        let starts: [Option<Start>; LANES] = std::array::from_fn(|i| {
            let sampler = Sampler::new(SamplerKind::Sobol, LIGHT_SEED, (number, LIGHT_ROW), i as u32, LANES as u32);
            let [u, v, pu, pv] = sampler.get(Dimensions::Camera);
            let time = if self.moves { span * f64::from(sampler.get(Dimensions::Time)[1]) } else { 0.0 };
            self.start(camera, number, [pu, pv], [u, v], time)
        });
        if starts.iter().all(Option::is_none) {
            return None;
        }
        let (mut scratch, mut exits) = (Scratch::default(), ExitRays::default());
        let nm = EntryRays::default().nm;
        LightTracing::trace_to_film(camera, &starts, nm, &[DVec2::ZERO; LANES], &mut scratch, &mut exits);
        let (mut places, mut hits, mut flux) = (Vec::new(), 0.0, 0.0);
        for (i, start) in starts.iter().enumerate().filter(|(i, _)| exits.passed >> i & 1 == 1) {
            let (Some(start), Some((x, y))) = (start, camera.pixel_of(exits.film_points[i][0])) else { continue };
            let density = mean(exits.density[i]);
            places.push(DVec2::new(x as f64, y as f64));
            hits += density / (camera.film.collecting_area_mm2() * start.density) / LANES as f64;
            flux += f64::from(exits.weight[i][0]) * density / start.density / LANES as f64;
        }
        let n = places.len() as f64;
        let middle = places.iter().sum::<DVec2>() / n;
        let spread = |f: fn(DVec2) -> f64| places.iter().map(|p| f(*p - middle)).sum::<f64>() / (n - 1.0).max(1.0);
        // An even ellipse of the half axes a, b has the variances a²/4, b²/4. A quarter: what a pixel adds.
        let (xx, yy, xy) = (spread(|d| d.x * d.x) + 0.25, spread(|d| d.y * d.y) + 0.25, spread(|d| d.x * d.y));
        let area = 4.0 * PI * (xx * yy - xy * xy).max(0.0).sqrt();
        let flux = flux * f64::from(self.emitters.luminance(number));
        let pilot = Pilot { middle, area, hits, flux, passed: n / LANES as f64 };
        (n > 0.0 && area.is_finite() && hits.is_finite() && flux.is_finite()).then_some(pilot)
    }

    /// Chunks of light samples for a sample of each pixel.
    fn chunks(&self) -> usize {
        self.total.div_ceil(CHUNK) as usize
    }

    /// A chunk of the light samples of sample `sample` of the pixels.
    fn chunk(&self, unit: &Unit, sample: u32, chunk: u32) -> Splats {
        let Unit { camera, settings, .. } = *unit;
        let seed = settings.seed ^ LIGHT_SEED;
        // Of this sample's numbers one, by which lamps take turns (systematic sampling).
        let turn = Sampler::new(SamplerKind::Independent, seed, (sample, LIGHT_ROW - 1), sample & 1, 2).get(Dimensions::Time)[0];
        let kind = if settings.sampler == SamplerKind::Grid { SamplerKind::Independent } else { settings.sampler };
        let mut splats = Splats::new((sample & 1) as usize, unit.response.curves.len(), unit.direct.is_some());
        let (mut scratch, mut exits) = (Scratch::default(), ExitRays::default());
        let end = ((chunk + 1) * CHUNK).min(self.total);
        for first in (chunk * CHUNK..end).step_by(LANES) {
            let mut drawn: [Option<Drawn>; LANES] = std::array::from_fn(|_| None);
            let mut starts: [Option<Start>; LANES] = std::array::from_fn(|_| None);
            let (mut nm, mut shifts) = (EntryRays::default().nm, [DVec2::ZERO; LANES]);
            for (i, light_sample) in (first..end.min(first + LANES as u32)).enumerate() {
                let at = f64::from(light_sample) + f64::from(turn);
                let number = self.before.partition_point(|b| *b <= at).saturating_sub(1);
                if self.counts[number] == 0.0 {
                    continue;
                }
                let index = 2 * light_sample + (sample & 1);
                let sampler = Sampler::new(kind, seed, (sample, LIGHT_ROW), index, 2 * self.total);
                let [u, v, pu, pv] = sampler.get(Dimensions::Camera);
                let [w, t, spot @ ..] = sampler.get(Dimensions::Time);
                let wavelengths = unit.wavelengths.sample(w);
                // Where nothing moves, the moment is drawn when it is known where the light lands.
                let time = match self.moves {
                    true => settings.shutter_times.draw((0.0, unit.shutter.total_s()), f64::from(t)).0,
                    false => 0.0,
                };
                (nm[i], shifts[i]) = (wavelengths.nm.to_array(), camera.film.low_pass_shift(spot));
                starts[i] = self.start(camera, number as u32, [pu, pv], [u, v], time);
                drawn[i] = Some(Drawn { number: number as u32, wavelengths, t, time });
            }
            LightTracing::trace_to_film(camera, &starts, nm, &shifts, &mut scratch, &mut exits);
            for i in (0..LANES).filter(|i| exits.passed >> i & 1 == 1) {
                if let (Some(drawn), Some(start)) = (&drawn[i], &starts[i]) {
                    self.count(unit, drawn, start, shifts[i], &exits, i, &mut splats);
                }
            }
        }
        splats.sorted()
    }

    /// Counts a light sample that came through in the pixels where its wavelengths land.
    #[allow(clippy::too_many_arguments)]
    fn count(&self, unit: &Unit, drawn: &Drawn, start: &Start, shift: DVec2, exits: &ExitRays, lane: usize, splats: &mut Splats) {
        let Unit { camera, settings, .. } = *unit;
        let film = &camera.film;
        let Drawn { number, ref wavelengths, t, time } = *drawn;
        let pupil = match unit.needs_pupil() {
            true => camera.pupil_radius(of_lane(exits.origin[lane]), of_lane(exits.direction[lane])),
            false => 0.0,
        };
        let lands: [Option<(usize, usize)>; 4] = std::array::from_fn(|c| {
            let [x, y] = exits.film_points[lane][c];
            let at = [x + shift.x as f32, y + shift.y as f32];
            let collected = exits.weight[lane][c] > 0.0 && film.collects(glam::Vec2::from_array(at).as_dvec2());
            camera.pixel_of(at).filter(|_| collected)
        });
        let windows = lands.map(|p| p.map(|(x, y)| unit.window(x, y, pupil)));
        let all = windows.iter().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |a, w| (a.0.min(w.0), a.1.max(w.1)));
        if !(all.0 < all.1) {
            return;
        }
        let (time, seconds) = match self.moves {
            true => (time, settings.shutter_times.seconds_at(all, time)),
            false => settings.shutter_times.draw(all, f64::from(t)),
        };
        if !(all.0..=all.1).contains(&time) {
            return;
        }
        let origin = camera.world_ray_of(exits.origin[lane], exits.direction[lane], time).origin;
        let [radiance, direct] = self.emitters.incident_radiance(
            &start.light_sample,
            start.point,
            origin,
            wavelengths,
            time as f32,
            &settings.path,
            unit.immersion,
        );
        let weighted = (radiance * wavelengths.weight).to_array();
        let joined = self.joined(unit, number, [mean(exits.density[lane]), start.density], time, seconds);
        let scale = (film.pixel_area_mm2 * M2_PER_MM2 * settings.light_scale * joined) as f32;
        if !weighted.iter().all(|v| v.is_finite()) || !scale.is_finite() || weighted == [0.0; 4] {
            return;
        }
        // All of a lamp's light along a ray came through the same panes.
        let is_direct = direct == radiance;
        let nm = wavelengths.nm.to_array();
        let groups = unit.response.curves.len().div_ceil(GROUP);
        if !exits.spread {
            if let Some(pixel) = lands[0] {
                let scale = exits.weight[lane][0] * scale;
                let at = pixel.1 * film.columns + pixel.0;
                splats.add(at, is_direct, (0..groups).map(|g| unit.curves.value(g, nm, weighted) * scale));
            }
            return;
        }
        for c in 0..4 {
            if let (Some((x, y)), Some((open, close))) = (lands[c], windows[c])
                && (open..=close).contains(&time)
            {
                let value = weighted[c] * exits.weight[lane][c] * scale;
                splats.add(y * film.columns + x, is_direct, (0..groups).map(|g| unit.curves.at(g, nm[c]) * value));
            }
        }
    }

    /// The light samples of a pass, handed over in order; `None` once it is to stop. Fails where `add` does.
    pub fn pass<E>(
        &self,
        unit: &Unit,
        samples: Range<u32>,
        stop: impl Fn() -> bool + Sync,
        mut add: impl FnMut(&Splats) -> Result<(), E>,
    ) -> Result<Option<()>, E> {
        let (chunks, at_once) = (self.chunks(), CHUNKS_AT_ONCE * rayon::current_num_threads().max(1));
        let all = chunks * samples.len();
        for first in (0..all).step_by(at_once) {
            let traced: Vec<Option<Splats>> = (first..(first + at_once).min(all))
                .into_par_iter()
                .map(|k| (!stop()).then(|| self.chunk(unit, samples.start + (k / chunks) as u32, (k % chunks) as u32)))
                .collect();
            for splats in traced {
                let Some(splats) = splats else { return Ok(None) };
                add(&splats)?;
            }
        }
        Ok(Some(()))
    }
}

/// The numbers of a light sample.
struct Drawn {
    number: u32,
    wavelengths: diopter_light::SampledWavelengths,
    /// Even number for the moment.
    t: f32,
    /// The moment at which its places are looked up.
    time: f64,
}

fn mean(of: [f32; 4]) -> f64 {
    0.25 * of.iter().map(|v| f64::from(*v)).sum::<f64>()
}

/// Light samples that each lamp should get, by its pilot.
fn wanted(pilots: &[Option<Pilot>]) -> Vec<f64> {
    // Lamps whose middles lie nearer to each other than their disks are wide share a disk.
    let key = |p: &Pilot| {
        let level = (p.area / PI).sqrt().max(1.0).log2().ceil() as i32;
        let at = (p.middle / f64::from(level).exp2()).floor();
        (level, at.x as i32, at.y as i32)
    };
    let mut disks: BTreeMap<(i32, i32, i32), Disk> = BTreeMap::new();
    for p in pilots.iter().flatten() {
        let disk = disks.entry(key(p)).or_default();
        *disk = Disk { area: disk.area.max(p.area), hits: disk.hits + p.hits, flux: disk.flux + p.flux };
    }
    // Large lamps of many parts: their disks lie side by side.
    let busy = |(level, x, y): (i32, i32, i32), disk: &Disk| {
        let around: f64 = (-1..2)
            .flat_map(|j| (-1..2).map(move |i| (level, x + i, y + j)))
            .filter_map(|key| disks.get(&key))
            .map(|d| d.hits)
            .sum();
        (disk.hits / disk.area).max(around / (9.0 * f64::from(level).exp2().powi(2))) >= MAX_HIT_FRACTION
    };
    let count = |p: &Pilot| {
        let key = key(p);
        let disk = disks.get(&key).filter(|disk| disk.flux > 0.0 && !busy(key, disk))?;
        // What does not come through is drawn again in vain.
        Some(SAMPLES_A_PIXEL * disk.area * p.flux / disk.flux / p.passed.max(0.25))
    };
    pilots.iter().map(|p| p.as_ref().and_then(count).unwrap_or(0.0)).collect()
}

#[cfg(test)]
mod tests;

//! Samples of the pixels of a tile: film and pupil to rays, rays to radiance, radiance to bands.

use super::diffraction::{Displaced, Optics};
use super::fireflies::Cascade;
use super::landings::{Landing, Landings, Square};
use super::light_tracing::{CameraSample, LightTracing};
use super::pixel_cone::PixelCones;
use super::response::{Curves, GROUP, Response, add_to};
use super::stars;
use super::sums::{Sums, Tile};
use super::{MARGIN, Settings, TILE, summed_bands};
use crate::camera::{Camera, Film};
use crate::mount::M2_PER_MM2;
use crate::polarizer::Analysis;
use crate::row_store::RowStore;
use crate::shutter::{Place, Shutter};
use diopter_image::focal_plane::BandUnit;
use diopter_lens::batch::single::LANES;
use diopter_lens::compound::{CompoundLens, Exits, PupilSampler, Samples, Scratch};
use diopter_lens::microlens::{Aimed, Behind};
use diopter_lens::pupil::PupilTable;
use diopter_lens::{Lens, LensRay};
use diopter_light::Ray;
use diopter_light::random::{Sampler, Set};
use diopter_light::wavelength::{WavelengthSampler, Wavelengths};
use diopter_scene::Scene;
use diopter_scene::light_paths::{LightPaths, LightVertices, PhotonMap};
use std::collections::BTreeMap;
use std::ops::Range;

/// What a sample of a pixel brings.
struct PathSample {
    /// nm.
    nm: [f32; 4],
    /// Radiance over the density of each wavelength.
    weighted: [f32; 4],
    /// Exposure that it stands for, in the unit of the bands.
    exposure: f32,
    /// What each wavelength counts beside that, where diffraction displaces them together.
    factors: [f32; 4],
    /// How, if so.
    displaced: Option<Displaced>,
    /// Film point where the light would have arrived without diffraction, mm.
    arrived: glam::DVec2,
    /// Fraction of each wavelength that is direct light, where that is recorded.
    direct: Option<[f32; 4]>,
    /// Q / I and U / I of each wavelength, where the film tells them.
    linear: Linear,
}

/// Q / I and U / I of each wavelength behind all filters, where the film tells them.
type Linear = Option<[[f32; 4]; 2]>;

/// Light along a camera ray.
struct CameraLight {
    radiance: glam::Vec4,
    /// Fraction of each wavelength that is direct light, where that is recorded.
    direct: Option<[f32; 4]>,
    linear: Linear,
}

/// The ray of a sample into the scene, and what its light counts for.
pub(super) struct CameraRay {
    pub ray: Ray,
    pub wavelengths: Wavelengths,
    /// Exposure that a radiance stands for, in the unit of the bands.
    exposure: f64,
    lens_ray: LensRay,
    /// When, s, and one over the density of that moment, s.
    time: f64,
    seconds: f64,
    displaced: Option<Displaced>,
    arrived: glam::DVec2,
}

/// Sums of a tile with its margin, and of single pixels farther away that wavelengths reach.
struct TileSums {
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

impl TileSums {
    /// Of a tile of a film; `bands` are summed.
    fn new(film: &Film, [column, row, width, height]: [usize; 4], bands: usize) -> TileSums {
        let (left, top) = (column.saturating_sub(MARGIN), row.saturating_sub(MARGIN));
        let (right, bottom) = ((column + width + MARGIN).min(film.columns), (row + height + MARGIN).min(film.rows));
        let sums = vec![[0.0f64; 2]; (right - left) * (bottom - top) * bands];
        TileSums { left, top, right, bottom, columns: film.columns, bands, sums, strays: BTreeMap::new() }
    }

    fn done(self) -> Tile {
        let sums = self.sums.into_iter().flatten().collect();
        Tile { column: self.left, row: self.top, width: self.right - self.left, sums, whole: false, strays: self.strays }
    }

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

/// Most times that a sample of a probe is drawn again.
const REDRAWS: u32 = 8;

/// The same of a sample of radiance: where light passes a tenth of the pupil, one of a thousand is lost.
pub(super) const RADIANCE_REDRAWS: u32 = 64;

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

impl PupilSampler for FromSensor<'_> {
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

/// The samples of a tile, one after the other.
struct Numbers {
    rectangle: [usize; 4],
    samples: Range<u32>,
}

impl Numbers {
    fn count(&self) -> usize {
        self.rectangle[2] * self.rectangle[3] * self.samples.len()
    }

    /// Column, row and number of a sample.
    #[inline]
    fn of(&self, number: usize) -> (usize, usize, u32) {
        let [column, row, width, _] = self.rectangle;
        let (pixel, sample) = (number / self.samples.len(), number % self.samples.len());
        (column + pixel % width, row + pixel / width, self.samples.start + sample as u32)
    }
}

/// Products of numbers of each wavelength.
#[inline]
fn times(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| a[k] * b[k])
}

/// What all tiles share.
pub(super) struct Unit<'a> {
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    pub shutter: &'a Shutter,
    pub curves: &'a Curves,
    pub response: &'a Response,
    pub wavelengths: &'a WavelengthSampler,
    pub settings: &'a Settings,
    /// The microlens array, if there is one.
    pub behind: Option<Behind>,
    /// Where fireflies are re-weighted.
    pub cascade: Option<Cascade>,
    /// Where light is traced from lamps, too.
    pub lamps: Option<LightTracing<'a>>,
    /// Diffraction, if there is any.
    pub optics: Option<&'a Optics>,
    /// Whether pixels have sums for what lamps send far out.
    pub stars: bool,
    /// Where the sums of direct light begin, where it is recorded.
    pub direct: Option<usize>,
    /// How wide pixels are in the scene, where pictures are filtered.
    pub cones: Option<PixelCones>,
    /// Whether light is followed with its polarisation.
    pub polarized: bool,
    /// What Q and U count in each group of bands, where any tells them.
    pub analyzers: Vec<[glam::Vec4; 2]>,
}

/// Photons and light vertices of a pass, each by replicate of the samples.
#[derive(Clone, Copy, Default)]
pub(super) struct PassPaths<'a> {
    pub photons: Option<&'a [PhotonMap<'a>; 2]>,
    pub vertices: Option<&'a [LightVertices<'a>; 2]>,
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
    pub(super) fn before<S: RowStore>(&self, index: usize, sums: &mut Sums<S>) -> std::io::Result<Vec<f64>> {
        if matches!(self.camera.lens, Lens::Compound(_)) || self.stars {
            return Ok(Vec::new());
        }
        let [column, row, width, height] = self.rectangle(index);
        let channels = 2 * self.summed_bands();
        let mut before = Vec::with_capacity(width * height * channels);
        for y in row..row + height {
            before.extend_from_slice(&sums.sums.row(y)?[column * channels..(column + width) * channels]);
        }
        Ok(before)
    }

    /// The samples of a pass in a tile, on top of what [`Unit::before`] gave.
    pub(super) fn tile(&self, index: usize, samples: Range<u32>, before: Vec<f64>, light_paths: PassPaths) -> Tile {
        let rectangle = self.rectangle(index);
        match &self.camera.lens {
            Lens::Compound(lens) => self.compound_tile(lens, rectangle, samples, light_paths),
            _ if self.stars => self.starred_tile(rectangle, samples, light_paths),
            _ => self.plain_tile(rectangle, samples, before, light_paths),
        }
    }

    fn sampler(&self, x: usize, y: usize, sample: u32) -> Sampler {
        Sampler::new(self.settings.sampler, self.settings.seed, (x as u32, y as u32), sample, self.settings.spp)
    }

    /// Through an ideal lens: every sample counts in its own pixel.
    fn plain_tile(
        &self,
        [column, row, width, height]: [usize; 4],
        samples: Range<u32>,
        mut sums: Vec<f64>,
        light_paths: PassPaths,
    ) -> Tile {
        let bands = self.summed_bands();
        let mut so_far = sums.chunks_exact_mut(2 * bands);
        let mut pixel = vec![[0.0f64; 2]; bands];
        for y in row..row + height {
            for x in column..column + width {
                let Some(so_far) = so_far.next() else { continue };
                pixel.as_flattened_mut().copy_from_slice(so_far);
                for i in samples.clone() {
                    let sampler = self.sampler(x, y, i);
                    let Some(arrival) = self.sample(x, y, &sampler, light_paths) else { continue };
                    let weighted = times(arrival.weighted, arrival.factors);
                    let (nm, linear) = (arrival.nm, arrival.linear);
                    let of = |weighted| move |group: usize| self.value(group, nm, weighted, &linear) * arrival.exposure;
                    let direct = arrival.direct.map(|fraction| of(times(weighted, fraction)));
                    self.add(&mut pixel, sampler.replicate(), 1.0, of(weighted), direct);
                }
                so_far.copy_from_slice(pixel.as_flattened());
            }
        }
        Tile { column, row, width, sums, whole: true, strays: BTreeMap::new() }
    }

    /// Through an ideal lens whose aperture diffracts: what lamps send far out counts elsewhere.
    fn starred_tile(&self, rectangle: [usize; 4], samples: Range<u32>, light_paths: PassPaths) -> Tile {
        let [column, row, width, height] = rectangle;
        let mut tile_sums = TileSums::new(&self.camera.film, rectangle, self.summed_bands());
        for y in row..row + height {
            for x in column..column + width {
                for i in samples.clone() {
                    let sampler = self.sampler(x, y, i);
                    let Some(arrival) = self.sample(x, y, &sampler, light_paths) else { continue };
                    let (half, nm, linear) = (sampler.replicate(), arrival.nm, arrival.linear);
                    let whole = |group: usize| self.value(group, nm, arrival.weighted, &linear) * arrival.exposure;
                    let mut weighted = times(arrival.weighted, arrival.factors);
                    if let Some(displaced) = arrival.displaced.filter(|_| self.is_lamp(whole)) {
                        let sent = times(weighted, displaced.wings());
                        let from = self.camera.pixel_of(arrival.arrived.as_vec2().to_array());
                        for c in 0..4 {
                            let value = |group: usize| self.value_at(group, nm, c, &linear) * (sent[c] * arrival.exposure);
                            let direct = arrival.direct.map_or(0.0, |fraction| fraction[c]);
                            self.note_star(&mut tile_sums, from, half, nm[c], direct, value);
                        }
                        weighted = times(weighted, displaced.gathered());
                    }
                    let of = |weighted| move |group: usize| self.value(group, nm, weighted, &linear) * arrival.exposure;
                    let direct = arrival.direct.map(|fraction| of(times(weighted, fraction)));
                    self.add(tile_sums.pixel(x, y), half, 1.0, of(weighted), direct);
                }
            }
        }
        tile_sums.done()
    }

    /// Through a real lens, a packet of samples at a time; each wavelength counts in the pixel where it lands
    /// ([`diopter_lens::compound`]).
    fn compound_tile(
        &self,
        lens: &CompoundLens,
        [column, row, width, height]: [usize; 4],
        samples: Range<u32>,
        light_paths: PassPaths,
    ) -> Tile {
        let film = &self.camera.film;
        let mut tile_sums = TileSums::new(film, [column, row, width, height], self.summed_bands());
        let radiance_only = self.in_radiance();
        let attempts = self.attempts();
        let (mut packet, mut exits, mut scratch) = (Samples::default(), Exits::default(), Scratch::default());
        let (mut again, mut places) = (Exits::default(), [[0.5f32; 4]; LANES]);
        // How far the low-pass filter, and with it the diffraction of the hero, moves what arrives.
        let (mut filter, mut moved, mut shifts) =
            ([glam::DVec2::ZERO; LANES], [glam::DVec2::ZERO; LANES], [glam::DVec2::ZERO; LANES]);
        let mut displaced: [Option<Displaced>; LANES] = [None; LANES];
        // Of all light, and of direct light where that is recorded; with them where their sums begin.
        // They know nothing of bands that tell polarisation, nor of a lens whose group moves.
        let moving_group = self.camera.way.moving().is_some_and(|moving| moving.lenses().len() > 0);
        let mut landings: Vec<(usize, Landings)> =
            match radiance_only || self.behind.is_some() || !self.analyzers.is_empty() || moving_group {
                true => Vec::new(),
                false => {
                    let new = || Landings::new(&samples, column..column + width, self.settings.sampler, film);
                    [Some(0), self.direct].into_iter().flatten().filter_map(|from| Some((from, new()?))).collect()
                }
            };
        let mut from_sensor = self.behind.as_ref().map(|behind| FromSensor { behind, rays: [None; LANES], film, shifts });
        let mut drawn: Vec<(usize, usize, Sampler, Wavelengths, f32)> = Vec::with_capacity(LANES);
        let spp = samples.len();
        let total = width * height * spp;
        let numbers = Numbers { rectangle: [column, row, width, height], samples: samples.clone() };
        // Where a group moves against shake, the samples of each of its places together: a packet goes through one lens.
        let mut places_of_group = self.by_lens(&numbers).into_iter();
        let mut group: Option<(&CompoundLens, Vec<u32>)> = places_of_group.next();
        let mut first = 0;
        loop {
            let total = group.as_ref().map_or(total, |(_, members)| members.len());
            if first >= total {
                first = 0;
                group = match places_of_group.next() {
                    Some(next) => Some(next),
                    None => break,
                };
                continue;
            }
            let lens = group.as_ref().map_or(lens, |(lens, _)| *lens);
            let count = LANES.min(total - first);
            drawn.clear();
            exits.passed = 0;
            for k in 0..count {
                let number = group.as_ref().map_or(first + k, |(_, members)| members[first + k] as usize);
                let (x, y, sample) = numbers.of(number);
                let sampler = self.sampler(x, y, sample);
                let [u, v, pu, pv] = sampler.get(Set::Camera);
                let [w, t, spot @ ..] = sampler.get(Set::Time);
                let wavelengths = self.wavelengths.sample(self.wavelength_number(w, &sampler));
                filter[k] = film.low_pass_shift(spot) - self.film_shift(x, y, t);
                displaced[k] = self.displaced(x, y, &sampler, &wavelengths);
                moved[k] = displaced[k].map_or(filter[k], |d| filter[k] + d.by);
                shifts[k] = moved[k];
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
                    let point = self.camera.film_point(x as f64 + at[0], y as f64 + at[1]);
                    packet.film[k] = point - moved[k];
                    if let Some(optics) = self.optics {
                        packet.film[k] = optics.lens.straightened(lens, optics.on_film(film, packet.film[k]), pupil);
                        shifts[k] = point - packet.film[k];
                    }
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
                let own_densities = if exits.spread && !radiance_only { exits.density[k] } else { [1.0; 4] };
                let (wavelengths, factors) = match displaced[k] {
                    Some(d) => (wavelengths.with_densities(times(own_densities, d.densities)), d.factors(own_densities)),
                    None if exits.spread && !radiance_only => (wavelengths.with_densities(own_densities), [1.0; 4]),
                    None => (wavelengths, [1.0; 4]),
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
                let union = |a: (f64, f64), w: (f64, f64)| (a.0.min(w.0), a.1.max(w.1));
                let mut all = windows.iter().copied().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), union);
                let squares = match spread && !landings.is_empty() {
                    true => self.squares([x, y], packet.film[k], &exits.lands[k]),
                    false => None,
                };
                if let Some(squares) = &squares
                    && self.shutter.differs_by_pixel()
                {
                    let below = squares.iter().flat_map(Square::parts).map(|([x, y], _)| self.window(x, y, pupil));
                    all = below.fold(all, union);
                }
                if all.0 >= all.1 {
                    continue;
                }
                let (time, seconds) = self.settings.shutter_times.draw(all, t as f64);
                let ray = self.camera.world_ray_of(exits.origin[k], exits.direction[k], time);
                if !ray.is_finite() {
                    continue;
                }
                let camera_sample = self.lamps.is_some().then(|| {
                    let [origin, direction] = [exits.origin[k], exits.direction[k]].map(|v| glam::Vec3::from_array(v).as_dvec3());
                    let density = 0.25 * f64::from(exits.density[k].iter().sum::<f32>());
                    CameraSample { origin, direction, ray, time, seconds, density }
                });
                let CameraLight { radiance, direct, linear } =
                    self.radiance(light_paths, camera_sample, [x, y], ray, &wavelengths, sampler);
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
                // Without the factors of the displacement: what a sample is must not depend on them.
                let weights = match (spread, radiance_only) {
                    (true, _) => exits.weight[k],
                    (false, true) => [1.0; 4],
                    (false, false) => [exits.weight[k][0]; 4],
                };
                let lamp = displaced[k].filter(|_| {
                    let light = times(weighted, weights);
                    self.stars && self.is_lamp(|group| self.value(group, nm, light, &linear) * scale)
                });
                let mut counted = factors;
                if let Some(displaced) = lamp {
                    counted = times(factors, displaced.gathered());
                    let sent = times(times(weighted, weights), times(factors, displaced.wings()));
                    for c in 0..4 {
                        let arrived = match spread {
                            true => glam::Vec2::from_array(exits.lands[k][c]).as_dvec2() + filter[k],
                            false => packet.film[k] + filter[k],
                        };
                        let from = self.camera.pixel_of(arrived.as_vec2().to_array());
                        let value = |group: usize| self.value_at(group, nm, c, &linear) * (sent[c] * scale);
                        let direct = direct.map_or(0.0, |fraction| fraction[c]);
                        self.note_star(&mut tile_sums, from, half, nm[c], direct, value);
                    }
                }
                if !spread {
                    // All colours where the sample was asked for.
                    let weighted = times(weighted, counted);
                    let of = |weighted| move |group: usize| self.value(group, nm, weighted, &linear) * (weights[0] * scale);
                    let direct = direct.map(|fraction| of(times(weighted, fraction)));
                    self.add(tile_sums.pixel(x, y), half, 1.0, of(weighted), direct);
                    continue;
                }
                for (from, landings) in landings.iter_mut().filter(|_| squares.is_some()) {
                    if landings.is_of_other([x, y]) {
                        self.end_pixel(landings, *from, &mut tile_sums);
                    }
                    // The hero lands where it started: nothing is up to chance.
                    for (c, square) in (1..4).zip(squares.into_iter().flatten()) {
                        let gain = wavelengths.weight[c] * exits.weight[k][c] * factors[c] * scale;
                        let of_it = if *from == 0 { 1.0 } else { direct.map_or(0.0, |fraction| fraction[c]) };
                        if let (Some((px, py)), true) = (lands[c], gain > 0.0) {
                            let (radiance, pixel) = (radiance[c] * of_it, [px, py]);
                            let landing = Landing { nm: nm[c], radiance, gain, pixel, square, time, pupil };
                            landings.note([x, y], sampler.number(), landing);
                        }
                    }
                }
                for c in 0..4 {
                    let weight = exits.weight[k][c] * counted[c];
                    if let (Some((px, py)), Some((open, close))) = (lands[c], windows[c])
                        && weight > 0.0
                        && (open..=close).contains(&time)
                    {
                        // A quarter of the sample: all of it would be four times as bright.
                        let of = |weighted: f32| {
                            move |group: usize| self.value_at(group, nm, c, &linear) * (weighted * weight * scale)
                        };
                        let direct = direct.map(|fraction| of(weighted[c] * fraction[c]));
                        self.add(tile_sums.pixel(px, py), half, 4.0, of(weighted[c]), direct);
                    }
                }
            }
            first += count;
        }
        for (from, landings) in &mut landings {
            self.end_pixel(landings, *from, &mut tile_sums);
        }
        tile_sums.done()
    }

    /// How far from its place a pixel collects light at the moment of a sample, where something moves against shake, mm; `t`: what chooses the moment.
    ///
    /// The moment is that of light through the middle of the pupil: of a leaf shutter, which opens from there, it may differ by its ramp.
    #[inline]
    fn film_shift(&self, x: usize, y: usize, t: f32) -> glam::DVec2 {
        match self.camera.way.moving() {
            None => glam::DVec2::ZERO,
            Some(moving) => moving.film_shift(self.moment(x, y, t)),
        }
    }

    /// The moment of a sample through the middle of the pupil, s.
    fn moment(&self, x: usize, y: usize, t: f32) -> f64 {
        self.settings.shutter_times.draw(self.window(x, y, 0.0), f64::from(t)).0
    }

    /// The samples of a tile by the lens that they go through; none where all go through the camera's.
    fn by_lens(&self, numbers: &Numbers) -> Vec<(&CompoundLens, Vec<u32>)> {
        let Some(moving) = self.camera.way.moving().filter(|moving| moving.lenses().len() > 0) else { return Vec::new() };
        let lenses = moving.lenses().filter_map(|lens| match lens {
            Lens::Compound(lens) => Some((&**lens, Vec::new())),
            _ => None,
        });
        let mut all: Vec<(&CompoundLens, Vec<u32>)> = lenses.collect();
        for number in 0..numbers.count() {
            let (x, y, sample) = numbers.of(number);
            let t = self.sampler(x, y, sample).get(Set::Time)[1];
            all[moving.index(self.moment(x, y, t))].1.push(number as u32);
        }
        all
    }

    /// Where the pixel as a whole lands at each wavelength but the hero's; `None` where not all of it lands on the film, where which wavelengths are collected depends on
    /// the place in the pixel.
    fn squares(&self, pixel: [usize; 2], started: glam::DVec2, lands: &[[f32; 2]; 4]) -> Option<[Square; 3]> {
        let film = &self.camera.film;
        let mut squares = [None; 3];
        for (square, land) in squares.iter_mut().zip(&lands[1..]) {
            let moved = glam::Vec2::from_array(*land).as_dvec2() - started;
            let displaced = [-moved.x * film.columns as f64 / film.width_mm, moved.y * film.rows as f64 / film.height_mm];
            *square = Some(Square::new(film, pixel, displaced)?);
        }
        let [Some(a), Some(b), Some(c)] = squares else { return None };
        Some([a, b, c])
    }

    /// Takes what could be foretold of a pixel's samples from where it landed, and gives it to where all of the pixel would have.
    /// `from`: where the sums of this light begin.
    fn end_pixel(&self, landings: &mut Landings, from: usize, sums: &mut TileSums) {
        let bands = self.curves_len();
        let by_pixel = self.shutter.differs_by_pixel();
        let open = |[x, y]: [usize; 2], landing: &Landing| {
            !by_pixel || {
                let (open, close) = self.window(x, y, landing.pupil);
                (open..=close).contains(&landing.time)
            }
        };
        let response = |group: usize, nm: f32| self.curves.at(group, nm);
        landings.end_pixel(bands.div_ceil(GROUP), response, open, |[x, y], half, values, times| {
            let signal = &mut sums.pixel(x, y)[from..from + bands];
            signal.chunks_mut(GROUP).zip(values).for_each(|(bands, value)| add_to(bands, half, *value * times));
        });
    }

    /// What the four wavelengths of a path are worth in a group of bands, with their polarisation where the bands tell it.
    #[inline]
    fn value(&self, group: usize, nm: [f32; 4], weighted: [f32; 4], linear: &Linear) -> glam::Vec4 {
        let value = self.curves.value(group, nm, weighted);
        let Some([q, u]) = linear else { return value };
        let [by_q, by_u] = self.analyzers[group];
        value
            + by_q * self.curves.value(group, nm, times(weighted, *q))
            + by_u * self.curves.value(group, nm, times(weighted, *u))
    }

    /// The same of one of them.
    #[inline]
    fn value_at(&self, group: usize, nm: [f32; 4], c: usize, linear: &Linear) -> glam::Vec4 {
        let value = self.curves.at(group, nm[c]);
        let Some([q, u]) = linear else { return value };
        let [by_q, by_u] = self.analyzers[group];
        value * (glam::Vec4::ONE + by_q * q[c] + by_u * u[c])
    }

    /// Light along a camera ray that is followed with its polarisation: behind the polariser, if there is one.
    fn polarized_light(&self, pixel: [usize; 2], ray: Ray, wavelengths: &Wavelengths, sampler: &Sampler) -> CameraLight {
        let cone = PixelCones::cone(self.cones.as_ref(), pixel, sampler.number(), ray);
        let analysis = Analysis::of(self.camera, self.settings.polarizer.as_ref(), &ray);
        let stokes = self.scene.stokes(cone, analysis.axis, wavelengths, sampler, &self.settings.path).map(|s| analysis.apply(s));
        let radiance = glam::Vec4::from_array(stokes.map(|s| s.x));
        let linear = (!self.analyzers.is_empty())
            .then(|| [1, 2].map(|part: usize| stokes.map(|s| if s.x > 0.0 { s[part] / s.x } else { 0.0 })));
        CameraLight { radiance, direct: None, linear }
    }

    /// Radiance along a camera ray, and the fraction of each wavelength that is direct light, where that is recorded; of lamps seen directly what the camera
    /// sample counts beside light that is traced from them.
    #[inline]
    fn radiance(
        &self,
        light_paths: PassPaths,
        sample: Option<CameraSample>,
        pixel: [usize; 2],
        ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
    ) -> CameraLight {
        if self.polarized {
            return self.polarized_light(pixel, ray, wavelengths, sampler);
        }
        let cone = PixelCones::cone(self.cones.as_ref(), pixel, sampler.number(), ray);
        let replicate = sampler.replicate();
        let light_paths = LightPaths {
            photons: light_paths.photons.map(|maps| &maps[replicate]),
            vertices: light_paths.vertices.map(|pools| &pools[replicate]),
        };
        let path = &self.settings.path;
        let along = |shown| match self.direct {
            None => {
                let radiance = self.scene.radiance_shown(light_paths, shown, cone, wavelengths, sampler, path);
                CameraLight { radiance, direct: None, linear: None }
            }
            Some(_) => {
                let [all, direct] = self.scene.radiance_and_direct(light_paths, shown, cone, wavelengths, sampler, path);
                let fraction = std::array::from_fn(|c| if all[c] > 0.0 { direct[c] / all[c] } else { 0.0 });
                CameraLight { radiance: all, direct: Some(fraction), linear: None }
            }
        };
        match (&self.lamps, sample) {
            (Some(lamps), Some(sample)) => {
                let weight = |number: u32, met: glam::Vec3| lamps.weight(self, &sample, number, met);
                along(Some(lamps.shown(&weight)))
            }
            _ => along(None),
        }
    }

    /// Adds a part of a sample to the sums of a pixel. `value`: what it adds to a group of bands; `direct`: what of it is direct light, where that is recorded;
    /// `parts`: how many such parts make a sample.
    #[inline]
    fn add(
        &self,
        pixel: &mut [[f64; 2]],
        half: usize,
        parts: f32,
        value: impl Fn(usize) -> glam::Vec4,
        direct: Option<impl Fn(usize) -> glam::Vec4>,
    ) {
        let bands = self.curves_len();
        let (signal, buffers) = pixel.split_at_mut(bands);
        let mut brightest = 0.0f32;
        for (group, bands) in signal.chunks_mut(GROUP).enumerate() {
            let value = value(group);
            // One bad number must not poison a pixel.
            if value.is_finite() {
                add_to(bands, half, value);
                brightest = brightest.max(value.max_element());
            }
        }
        if let (Some(from), Some(direct)) = (self.direct, direct) {
            for (group, sums) in buffers[from - bands..from].chunks_mut(GROUP).enumerate() {
                let direct = direct(group);
                if direct.is_finite() {
                    add_to(sums, half, direct);
                }
            }
        }
        if let Some(cascade) = &self.cascade {
            cascade.add(buffers, bands, half, brightest * parts, value);
        }
    }

    /// Whether a sample is so bright that what it sends far out counts as a star. `value`: what it is in a group of bands.
    fn is_lamp(&self, value: impl Fn(usize) -> glam::Vec4) -> bool {
        let Some(white_e) = self.optics.and_then(|o| o.white_e) else { return false };
        let groups = self.curves_len().div_ceil(GROUP);
        (0..groups).any(|group| value(group).max_element() >= white_e)
    }

    /// Notes what a wavelength of a lamp sends far out, a quarter of a sample, in the pixel where it would have arrived. From beyond the film nothing is
    /// sent. `direct`: what fraction of it is direct light.
    #[allow(clippy::too_many_arguments)]
    fn note_star(
        &self,
        sums: &mut TileSums,
        from: Option<(usize, usize)>,
        half: usize,
        nm: f32,
        direct: f32,
        value: impl Fn(usize) -> glam::Vec4,
    ) {
        let Some((x, y)) = from else { return };
        let bands = self.curves_len();
        let before = summed_bands(bands, self.cascade.is_some(), false, false);
        let pixel = sums.pixel(x, y);
        if let Some(from) = self.direct {
            stars::note_direct(&mut pixel[from + bands..from + 2 * bands], half, direct, &value);
        }
        stars::note(&mut pixel[before..], bands, half, nm, 0.25, value);
    }

    /// The number that chooses the wavelengths: with diffraction one that is spread evenly together with those of the displacement, on which, with it, the
    /// weights of the wavelengths depend.
    #[inline]
    fn wavelength_number(&self, number: f32, sampler: &Sampler) -> f32 {
        if self.optics.is_some() { sampler.get(Set::Diffraction(0))[2] } else { number }
    }

    /// How diffraction displaces a sample of a pixel.
    #[inline]
    fn displaced(&self, column: usize, row: usize, sampler: &Sampler, wavelengths: &Wavelengths) -> Option<Displaced> {
        let optics = self.optics?;
        let [u, v, ..] = sampler.get(Set::Diffraction(0));
        let middle = self.camera.film_point(column as f64 + 0.5, row as f64 + 0.5);
        Some(optics.displaced(middle, wavelengths.nm.to_array(), [u, v]))
    }

    /// Bands that are summed: those of the film, of each buffer of the cascade, of stars, and of direct light.
    fn summed_bands(&self) -> usize {
        summed_bands(self.curves_len(), self.cascade.is_some(), self.stars, self.direct.is_some())
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
            let (curvature, middle) = (self.camera.lens.exit_curvature(), self.camera.lens.pupil_middle().x);
            let place = |k: usize| f64::from(exits.slopes[k][0][0]) + packet.film[k].x * curvature - middle;
            for k in (0..LANES).filter(|k| !half.holds(place(*k))).collect::<Vec<_>>() {
                exits.passed &= !(1 << k);
            }
        }
    }

    /// When a pixel is open to light through a place of the pupil.
    #[inline]
    pub(super) fn window(&self, column: usize, row: usize, pupil: f64) -> (f64, f64) {
        let film = &self.camera.film;
        self.shutter.window(&Place { pixel: [column, row], size: [film.columns, film.rows], pupil })
    }

    /// Whether the shutter asks where in the pupil light passes.
    #[inline]
    pub(super) fn needs_pupil(&self) -> bool {
        matches!(self.shutter.mechanism, crate::shutter::Mechanism::Leaf { .. })
    }

    fn curves_len(&self) -> usize {
        self.response.curves.len()
    }

    /// One sample of a pixel; `None` where no light comes through.
    #[inline]
    fn sample(&self, column: usize, row: usize, sampler: &Sampler, light_paths: PassPaths) -> Option<PathSample> {
        let CameraRay { ray, wavelengths, exposure, lens_ray, time, seconds, displaced, arrived } =
            self.camera_ray(column, row, sampler)?;
        let entry = match &self.camera.lens {
            Lens::Thin(lens) if self.lamps.is_some() => lens.entry(lens_ray.origin_mm, lens_ray.direction),
            _ => None,
        };
        let camera_sample = entry.map(|entry| {
            let (origin, direction) = (lens_ray.origin_mm, lens_ray.direction);
            CameraSample { origin, direction, ray, time, seconds, density: entry.density }
        });
        let CameraLight { radiance, direct, linear } =
            self.radiance(light_paths, camera_sample, [column, row], ray, &wavelengths, sampler);
        Some(PathSample {
            nm: wavelengths.nm.to_array(),
            weighted: (radiance * wavelengths.weight).to_array(),
            exposure: (exposure * self.settings.light_scale) as f32,
            factors: displaced.map_or([1.0; 4], |d| d.factors([1.0; 4])),
            displaced,
            arrived,
            direct,
            linear,
        })
    }

    /// The ray of one sample of a pixel through any lens, all wavelengths along that of the lens's reference; `None` where no light comes through.
    #[inline]
    pub(super) fn camera_ray(&self, column: usize, row: usize, sampler: &Sampler) -> Option<CameraRay> {
        let [x, y, pu, pv] = sampler.get(Set::Camera);
        let [w, t, spot @ ..] = sampler.get(Set::Time);
        let filter = self.camera.film.low_pass_shift(spot) - self.film_shift(column, row, t);
        let wavelengths = self.wavelengths.sample(self.wavelength_number(w, sampler));
        let displaced = self.displaced(column, row, sampler, &wavelengths);
        let shift = displaced.map_or(filter, |d| filter + d.by);
        let mut arrived = glam::DVec2::ZERO;
        let passes = |r: &LensRay| self.settings.half.is_none_or(|h| h.holds(r.origin_mm.x));
        let lens_ray = (0..=self.attempts()).find_map(|attempt| {
            let (at, pupil) = self.place([x, y, pu, pv], sampler, attempt);
            let film = self.camera.film_point(column as f64 + at[0], row as f64 + at[1]) - shift;
            let film = self.optics.map_or(film, |optics| optics.on_film(&self.camera.film, film));
            arrived = film + filter;
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
        let (time, seconds) = self.settings.shutter_times.draw((open, close), t as f64);
        let ray = self.camera.to_world(&lens_ray, time);
        if !ray.is_finite() {
            return None;
        }
        let wavelengths = match displaced {
            Some(d) => wavelengths.with_densities(d.densities),
            None => wavelengths,
        };
        let exposure = match self.response.bands[0].unit {
            BandUnit::Radiance => seconds / (close - open),
            BandUnit::Electrons => {
                lens_ray.weight_sr * self.camera.film.pixel_area_mm2 * M2_PER_MM2 * seconds * self.half_of_light()
            }
        };
        Some(CameraRay { ray, wavelengths, exposure, lens_ray, time, seconds, displaced, arrived })
    }
}

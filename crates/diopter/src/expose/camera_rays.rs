//! Samples of the pixels of a tile on their way into the scene: film and pupil to rays.

use super::diffraction::Displaced;
use super::dispersion_variate::PixelFootprint;
use super::light_tracing::CameraSample;
use super::pixel_groups::{PAIR, PAIRS, PixelGroups};
use super::unit::Unit;
use crate::camera::Film;
use crate::mount::M2_PER_MM2;
use diopter_image::focal_plane::BandUnit;
use diopter_lens::batch::single::LANES;
use diopter_lens::compound::{CompoundLens, ExitRays, PupilSampler, Samples, Scratch};
use diopter_lens::microlens::{MicrolensOptics, MicrolensSample};
use diopter_lens::pupil::PupilTable;
use diopter_lens::{Lens, LensRay};
use diopter_light::Ray;
use diopter_light::random::{Dimensions, Sampler};
use diopter_light::wavelength::SampledWavelengths;
use glam::DVec2;
use std::ops::Range;

/// A sample of a pixel, and what its light counts for.
pub(super) struct CameraRay {
    /// Column and row.
    pub pixel: [usize; 2],
    pub sampler: Sampler,
    pub ray: Ray,
    pub wavelengths: SampledWavelengths,
    /// Exposure that a radiance stands for, in the unit of the bands, the weights of the lens left out.
    pub exposure: f32,
    /// Weight of each wavelength by the lens.
    pub weights: [f32; 4],
    /// Factor of each wavelength by the displacement of diffraction, 1 without.
    pub factors: [f32; 4],
    /// How, if so.
    pub displacement: Option<Box<Displacement>>,
    /// Pixels where wavelengths arrive, where that is not the pixel itself.
    pub spread: Option<Box<Spread>>,
    /// What the lens drew, where light is traced from lamps, too.
    pub drawn: Option<Box<CameraSample>>,
}

// Most samples need none of what is boxed, and all are copied.
const _: () = assert!(size_of::<CameraRay>() <= 208);

/// How diffraction displaces a sample.
pub(super) struct Displacement {
    pub displaced: Displaced,
    /// Film points where the light would have arrived without it, mm.
    pub arrived: [DVec2; 4],
}

/// Where the wavelengths of a sample arrive.
pub(super) struct Spread {
    /// Pixels; `None` beside the film, or between pixels.
    pub pixels: [Option<(usize, usize)>; 4],
    /// When these are open, s.
    pub windows: [Option<(f64, f64)>; 4],
    /// Where the pixel as a whole lands, where that is asked for.
    pub footprints: Option<[PixelFootprint; 3]>,
    /// When the sample was taken, s, and where in the pupil.
    pub time: f64,
    pub pupil: f64,
}

/// Most times that a sample of a probe is drawn again.
const REDRAWS: u32 = 8;

/// The same of a sample of radiance: where light passes a tenth of the pupil, one of a thousand is lost.
pub(super) const RADIANCE_REDRAWS: u32 = 64;

/// The numbers of a sample at an attempt: new ones each time, independent of those before, so that what passes at last is even over all that passes
/// (rejection sampling). Steps of a low-discrepancy sequence would not be: they prefer what is first reached from the blocked part.
fn drawn_again(numbers: [f32; 4], sampler: &Sampler, attempt: u32) -> [f32; 4] {
    if attempt == 0 { numbers } else { sampler.get(Dimensions::Redraw(attempt)) }
}

/// Rays from places of the sensor through a microlens array.
struct FromSensor<'a> {
    behind: &'a MicrolensOptics,
    rays: [Option<MicrolensSample>; LANES],
    film: &'a Film,
    /// Shift of each lane by the low-pass filter, mm.
    shifts: [DVec2; LANES],
}

impl PupilSampler for FromSensor<'_> {
    fn draw(&self, _: &PupilTable, lane: usize, _: DVec2) -> Option<(DVec2, f64)> {
        self.rays[lane].map(|r| (r.slope, r.density))
    }

    fn density(&self, _: &PupilTable, lane: usize, film: DVec2, slope: DVec2) -> f64 {
        let sensor = self.behind.on_sensor(film, slope);
        match self.film.collects(sensor + self.shifts[lane]) {
            true => self.behind.density(sensor),
            false => 0.0,
        }
    }
}

/// The samples of a tile, one after the other.
pub(super) struct Numbers {
    /// Column, row, width and height.
    pub rectangle: [usize; 4],
    pub samples: Range<u32>,
    /// Where those of a pair of groups of pixels follow one another, not those of a pixel.
    pub groups: Option<PixelGroups>,
}

impl Numbers {
    /// How many numbers there are; some stand for no sample.
    fn count(&self) -> usize {
        let pixels = if self.groups.is_some() { PAIRS * PAIR } else { self.rectangle[2] * self.rectangle[3] };
        pixels * self.samples.len()
    }

    /// Column, row and number of a sample.
    #[inline]
    fn of(&self, number: usize) -> Option<(usize, usize, u32)> {
        let [column, row, width, height] = self.rectangle;
        if let Some(groups) = &self.groups {
            let (of_pair, member) = (number / PAIR, number % PAIR);
            let (pair, sample) = (of_pair / self.samples.len(), of_pair % self.samples.len());
            let [x, y] = groups.pixel_of_pair([column, row], pair, member);
            return (x < column + width && y < row + height).then(|| (x, y, self.samples.start + sample as u32));
        }
        let (pixel, sample) = (number / self.samples.len(), number % self.samples.len());
        Some((column + pixel % width, row + pixel / width, self.samples.start + sample as u32))
    }
}

/// Products of numbers of each wavelength.
#[inline]
pub(super) fn times(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| a[k] * b[k])
}

/// Samples through an ideal lens that are drawn before their light is.
const PACKET: usize = 32;

impl Unit<'_> {
    fn sampler(&self, x: usize, y: usize, sample: u32) -> Sampler {
        Sampler::new(self.settings.sampler, self.settings.seed, (x as u32, y as u32), sample, self.settings.spp)
    }

    /// What draws the wavelengths of a sample of a pixel, which are the same for all pixels of a group, and with them how diffraction displaces it.
    fn group_sampler(&self, pixel: [usize; 2], sampler: &Sampler) -> Sampler {
        let Some(groups) = &self.groups else { return *sampler };
        let [x, y] = groups.representative(pixel);
        self.sampler(x, y, sampler.number())
    }

    /// All samples of a tile, some at a time and in their order, handed to `each`; `uses_variate`: whether it is asked where pixels land as a whole.
    pub(super) fn camera_rays(&self, numbers: &Numbers, uses_variate: bool, mut each: impl FnMut(&mut Vec<CameraRay>)) {
        if let Lens::Compound(lens) = &self.camera.lens {
            // Where a group moves against shake, the samples of each of its places together: a packet goes through one lens.
            let by_lens = self.by_lens(numbers);
            if by_lens.is_empty() {
                return self.through(lens, numbers, 0..numbers.count(), uses_variate, each);
            }
            for (lens, members) in by_lens {
                self.through(lens, numbers, members.into_iter().map(|n| n as usize), uses_variate, &mut each);
            }
            return;
        }
        let mut rays = Vec::with_capacity(PACKET);
        let mut left = 0..numbers.count();
        while !left.is_empty() {
            rays.clear();
            for (x, y, sample) in left.by_ref().take(PACKET).filter_map(|number| numbers.of(number)) {
                let sampler = self.sampler(x, y, sample);
                if let Some(ray) = self.camera_ray(x, y, &sampler, &self.group_sampler([x, y], &sampler)) {
                    rays.push(ray);
                }
            }
            each(&mut rays);
        }
    }

    /// Samples through a real lens, a packet at a time; each wavelength counts in the pixel where it lands ([`diopter_lens::compound`]).
    fn through(
        &self,
        lens: &CompoundLens,
        numbers: &Numbers,
        members: impl Iterator<Item = usize>,
        uses_variate: bool,
        mut each: impl FnMut(&mut Vec<CameraRay>),
    ) {
        let film = &self.camera.film;
        let attempts = self.attempts();
        let (mut packet, mut exits, mut scratch) = (Samples::default(), ExitRays::default(), Scratch::default());
        let mut again = ExitRays::default();
        let mut shifts = [DVec2::ZERO; LANES];
        let mut from_sensor = self.behind.as_ref().map(|behind| FromSensor { behind, rays: [None; LANES], film, shifts });
        let mut drawn: Vec<Drawn> = Vec::with_capacity(LANES);
        let mut rays = Vec::with_capacity(LANES);
        let mut members = members.peekable();
        while members.peek().is_some() {
            drawn.clear();
            exits.passed = 0;
            for (x, y, sample) in members.by_ref().take(LANES).filter_map(|number| numbers.of(number)) {
                let (k, sampler) = (drawn.len(), self.sampler(x, y, sample));
                let sample = self.draw([x, y], sampler, &self.group_sampler([x, y], &sampler));
                shifts[k] = sample.moved;
                packet.nm[k] = sample.wavelengths.nm.to_array();
                drawn.push(sample);
            }
            let count = drawn.len();
            if count == 0 {
                continue;
            }
            // Lanes beyond hold rays of the packet before.
            let own = ((1u64 << count) - 1) as u32;
            for attempt in 0..=attempts {
                if exits.passed & own == own {
                    break;
                }
                for (k, sample) in drawn.iter().enumerate() {
                    let (at, pupil) = self.place(sample.place, &sample.sampler, attempt);
                    let [x, y] = sample.pixel;
                    let point = self.camera.film_point(x as f64 + at[0], y as f64 + at[1]);
                    packet.film[k] = point - sample.moved;
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
                    Some(from) => lens.trace_to_scene_sampled(&packet, from, &mut scratch, out),
                    None => lens.trace_to_scene(&packet, |k, at| film.collects(at + shifts[k]), &mut scratch, out),
                }
                self.block_other_half(&packet, out);
                if attempt > 0 {
                    exits.fill_missing(&again);
                }
            }
            let passed = (0..count).filter(|k| exits.passed >> k & 1 == 1);
            rays.clear();
            rays.extend(passed.filter_map(|k| self.ray_of_lane(k, &drawn[k], packet.film[k], shifts[k], &exits, uses_variate)));
            each(&mut rays);
        }
    }

    /// What is drawn for a sample of a pixel before it goes through a lens.
    #[inline]
    fn draw(&self, [x, y]: [usize; 2], sampler: Sampler, group_sampler: &Sampler) -> Drawn {
        let [place, [w, t, spot @ ..]] = sampler.get_two([Dimensions::Camera, Dimensions::Time]);
        let filter = self.camera.film.low_pass_shift(spot) - self.film_shift(x, y, t);
        let w = if self.groups.is_some() { group_sampler.get(Dimensions::Time)[0] } else { w };
        let wavelengths = self.wavelengths.sample(self.wavelength_number(w, group_sampler));
        let displaced = self.displaced(x, y, group_sampler, &wavelengths);
        let moved = displaced.map_or(filter, |d| filter + d.by);
        Drawn { pixel: [x, y], sampler, wavelengths, t, place, filter, moved, displaced }
    }

    /// The ray of a lane of a packet that passed the lens; `None` where the shutter is not open to it. `started`: where it starts on the film, mm; `shift`: by which the point of its
    /// pixel lies elsewhere, mm.
    fn ray_of_lane(
        &self,
        k: usize,
        drawn: &Drawn,
        started: DVec2,
        shift: DVec2,
        exits: &ExitRays,
        uses_variate: bool,
    ) -> Option<CameraRay> {
        let &Drawn { pixel: [x, y], sampler, wavelengths, t, filter, displaced, .. } = drawn;
        let (film, radiance_only) = (&self.camera.film, self.in_radiance());
        // What is not spread is drawn and counted alike at all wavelengths.
        let spread = exits.spread && !radiance_only;
        let own_densities = if spread { exits.density[k] } else { [1.0; 4] };
        let (wavelengths, factors) = match displaced {
            Some(d) => (wavelengths.with_densities(times(own_densities, d.densities)), d.factors(own_densities)),
            None if spread => (wavelengths.with_densities(own_densities), [1.0; 4]),
            None => (wavelengths, [1.0; 4]),
        };
        let pupil = match self.needs_pupil() {
            true => {
                let at = |v: [f32; 3]| glam::Vec3::from_array(v).as_dvec3();
                self.camera.pupil_radius(at(exits.origin[k]), at(exits.direction[k]))
            }
            false => 0.0,
        };
        // Wavelengths may arrive in rows that are open at other times: the moment is drawn from the time of all of them.
        let pixels: [Option<(usize, usize)>; 4] = match spread {
            false => [Some((x, y)); 4],
            true => std::array::from_fn(|c| {
                let [x, y] = match &self.behind {
                    None => exits.film_points[k][c],
                    Some(behind) => {
                        let [at, slope] = [exits.film_points[k][c], exits.slopes[k][c]];
                        let [at, slope] = [at, slope].map(|v| glam::Vec2::from_array(v).as_dvec2());
                        behind.on_sensor(at, slope).as_vec2().to_array()
                    }
                };
                let at = [x + shift.x as f32, y + shift.y as f32];
                // The hero is where it was drawn; between pixels nothing of the others is collected.
                let collected = c == 0 || film.collects(glam::Vec2::from_array(at).as_dvec2());
                self.camera.pixel_of(at).filter(|_| collected)
            }),
        };
        let windows = pixels.map(|p| p.map(|(x, y)| self.window(x, y, pupil)));
        let union = |a: (f64, f64), w: (f64, f64)| (a.0.min(w.0), a.1.max(w.1));
        let mut all = windows.iter().copied().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), union);
        let footprints = match spread && uses_variate {
            true => self.footprints([x, y], started, &exits.film_points[k]),
            false => None,
        };
        if let Some(footprints) = &footprints
            && self.shutter.differs_by_pixel()
        {
            let below = footprints.iter().flat_map(PixelFootprint::parts).map(|([x, y], _)| self.window(x, y, pupil));
            all = below.fold(all, union);
        }
        if all.0 >= all.1 {
            return None;
        }
        let (time, seconds) = self.settings.shutter_times.draw(all, t as f64);
        let ray = self.camera.world_ray_of(exits.origin[k], exits.direction[k], time);
        if !ray.is_finite() {
            return None;
        }
        let drawn = self.light_traced.then(|| {
            let [origin, direction] = [exits.origin[k], exits.direction[k]].map(|v| glam::Vec3::from_array(v).as_dvec3());
            let density = 0.25 * f64::from(exits.density[k].iter().sum::<f32>());
            Box::new(CameraSample { origin, direction, ray, time, seconds, density })
        });
        let exposure = match radiance_only {
            // The mean over what passes, where it was asked for.
            true => self.settings.light_scale * seconds / (all.1 - all.0),
            false => film.pixel_area_mm2 * M2_PER_MM2 * seconds * self.settings.light_scale * self.half_of_light(),
        } as f32;
        let weights = match (spread, radiance_only) {
            (true, _) => exits.weight[k],
            (false, true) => [1.0; 4],
            (false, false) => [exits.weight[k][0]; 4],
        };
        let displacement = displaced.map(|displaced| {
            let arrived = match spread {
                true => exits.film_points[k].map(|land| glam::Vec2::from_array(land).as_dvec2() + filter),
                false => [started + filter; 4],
            };
            Box::new(Displacement { displaced, arrived })
        });
        let spread = spread.then(|| Box::new(Spread { pixels, windows, footprints, time, pupil }));
        let pixel = [x, y];
        Some(CameraRay { pixel, sampler, ray, wavelengths, exposure, weights, factors, displacement, spread, drawn })
    }

    /// The ray of one sample of a pixel through any lens, all wavelengths along that of the lens's reference; `None` where no light comes through.
    #[inline]
    pub(super) fn camera_ray(&self, column: usize, row: usize, sampler: &Sampler, group_sampler: &Sampler) -> Option<CameraRay> {
        let Drawn { wavelengths, t, place, filter, moved, displaced, .. } = self.draw([column, row], *sampler, group_sampler);
        let mut arrived = DVec2::ZERO;
        let passes = |r: &LensRay| self.settings.half.is_none_or(|h| h.holds(r.origin_mm.x));
        let lens_ray = (0..=self.attempts()).find_map(|attempt| {
            let (at, pupil) = self.place(place, sampler, attempt);
            let film = self.camera.film_point(column as f64 + at[0], row as f64 + at[1]) - moved;
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
        let (origin, direction) = (lens_ray.origin_mm, lens_ray.direction);
        let entry = match &self.camera.lens {
            Lens::Thin(lens) if self.light_traced => lens.entry(origin, direction),
            _ => None,
        };
        Some(CameraRay {
            pixel: [column, row],
            sampler: *sampler,
            ray,
            wavelengths,
            exposure: (exposure * self.settings.light_scale) as f32,
            weights: [1.0; 4],
            factors: displaced.map_or([1.0; 4], |d| d.factors([1.0; 4])),
            displacement: displaced.map(|displaced| Box::new(Displacement { displaced, arrived: [arrived; 4] })),
            spread: None,
            drawn: entry.map(|entry| Box::new(CameraSample { origin, direction, ray, time, seconds, density: entry.density })),
        })
    }

    /// How far from its place a pixel collects light at the moment of a sample, where something moves against shake, mm; `t`: what chooses the moment.
    ///
    /// The moment is that of light through the middle of the pupil: of a leaf shutter, which opens from there, it may differ by its ramp.
    #[inline]
    fn film_shift(&self, x: usize, y: usize, t: f32) -> DVec2 {
        match self.camera.motion.moving() {
            None => DVec2::ZERO,
            Some(moving) => moving.film_shift(self.moment(x, y, t)),
        }
    }

    /// The moment of a sample through the middle of the pupil, s.
    fn moment(&self, x: usize, y: usize, t: f32) -> f64 {
        self.settings.shutter_times.draw(self.window(x, y, 0.0), f64::from(t)).0
    }

    /// The samples of a tile by the lens that they go through; none where all go through the camera's.
    fn by_lens(&self, numbers: &Numbers) -> Vec<(&CompoundLens, Vec<u32>)> {
        let Some(moving) = self.camera.motion.moving().filter(|moving| moving.lenses().len() > 0) else { return Vec::new() };
        let lenses = moving.lenses().filter_map(|lens| match lens {
            Lens::Compound(lens) => Some((&**lens, Vec::new())),
            _ => None,
        });
        let mut all: Vec<(&CompoundLens, Vec<u32>)> = lenses.collect();
        for number in 0..numbers.count() {
            let Some((x, y, sample)) = numbers.of(number) else { continue };
            let t = self.sampler(x, y, sample).get(Dimensions::Time)[1];
            all[moving.index(self.moment(x, y, t))].1.push(number as u32);
        }
        all
    }

    /// Where the pixel as a whole lands at each wavelength but the hero's; `None` where not all of it lands on the film, where which wavelengths are collected depends on
    /// the place in the pixel.
    fn footprints(&self, pixel: [usize; 2], started: DVec2, lands: &[[f32; 2]; 4]) -> Option<[PixelFootprint; 3]> {
        let film = &self.camera.film;
        let mut footprints = [None; 3];
        for (footprint, land) in footprints.iter_mut().zip(&lands[1..]) {
            let moved = glam::Vec2::from_array(*land).as_dvec2() - started;
            let displaced = [-moved.x * film.columns as f64 / film.width_mm, moved.y * film.rows as f64 / film.height_mm];
            *footprint = Some(PixelFootprint::new(film, pixel, displaced)?);
        }
        let [Some(a), Some(b), Some(c)] = footprints else { return None };
        Some([a, b, c])
    }

    /// The number that chooses the wavelengths: with diffraction one that is spread evenly together with those of the displacement, on which, with it, the
    /// weights of the wavelengths depend.
    #[inline]
    fn wavelength_number(&self, number: f32, sampler: &Sampler) -> f32 {
        if self.optics.is_some() { sampler.get(Dimensions::Diffraction(0))[2] } else { number }
    }

    /// How diffraction displaces a sample of a pixel.
    #[inline]
    fn displaced(&self, column: usize, row: usize, sampler: &Sampler, wavelengths: &SampledWavelengths) -> Option<Displaced> {
        let optics = self.optics?;
        let [u, v, ..] = sampler.get(Dimensions::Diffraction(0));
        let middle = self.camera.film_point(column as f64 + 0.5, row as f64 + 0.5);
        Some(optics.displaced(middle, wavelengths.nm.to_array(), [u, v]))
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
    fn block_other_half(&self, packet: &Samples, exits: &mut ExitRays) {
        if let Some(half) = self.settings.half {
            let (curvature, middle) = (self.camera.lens.exit_curvature(), self.camera.lens.pupil_center_slope().x);
            let place = |k: usize| f64::from(exits.slopes[k][0][0]) + packet.film[k].x * curvature - middle;
            for k in (0..LANES).filter(|k| !half.holds(place(*k))).collect::<Vec<_>>() {
                exits.passed &= !(1 << k);
            }
        }
    }
}

/// What is drawn for a sample before it goes through a lens.
struct Drawn {
    /// Column and row.
    pixel: [usize; 2],
    sampler: Sampler,
    wavelengths: SampledWavelengths,
    /// What chooses the moment.
    t: f32,
    /// Its place in pixel and pupil, at the first attempt.
    place: [f32; 4],
    /// How far the low-pass filter moves what arrives, mm.
    filter: DVec2,
    /// The same with the diffraction of the hero.
    moved: DVec2,
    displaced: Option<Displaced>,
}

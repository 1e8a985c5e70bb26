//! The image of a scene point on the film: where light from it arrives through the whole pupil, over the time for which the pixel is open, in all colours.
//!
//! The scene point is what the chief ray of a place of the picture meets halfway through the time for which that place is open. Lenses answer from the film to
//! the scene; for each sample of pupil, moment and wavelength the film point whose ray passes the scene point is found by iteration with the Jacobian of the
//! chief ray (the chord method), and where that does not converge by Newton's ([`crate::projection::find`]). Each counts by the weight of its ray
//! ([`diopter_lens::LensRay::weight_sr`]) and the time for which its place in the pupil is open. How the solid angle of a pixel changes over the pupil is left
//! out: to first order of the aberrations it does not.

use crate::camera::Camera;
use crate::projection::{self, Target};
use crate::shutter::{Place, Shutter};
use diopter_lens::diffraction::Kernel;
use diopter_lens::{CompoundLens, Diffraction, Lens, LensRay};
use diopter_light::Ray;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::spectrum::Table;
use diopter_scene::shape::Surface;
use diopter_scene::{OtherExposure, Scene};
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

/// Samples of pupil, moment, wavelength and displacement by diffraction: a power of two, for which Sobol points are spread best.
const SAMPLES: u32 = 2048;
/// Any number: the same samples for every variant, so that differences between them have little noise.
const SEED: u64 = 0x5b07;
/// Pixels over which the Jacobian is taken.
const STEP_PX: f64 = 0.5;
/// A place is found when it moves less than this, in pixels.
const CLOSE_PX: f64 = 1e-3;
const MOST_STEPS: usize = 30;
/// Light that lands farther away than this in one step, in pixels, is left to Newton's method.
const FAR_PX: f64 = 1e5;

/// Colours of the light, as a channel of the sensor sees them: a cumulative distribution over wavelength.
#[derive(Clone, Debug)]
pub(super) struct Colors {
    /// nm and fraction of the light up to there.
    cumulative: Vec<[f64; 2]>,
}

/// Wavelengths that are looked at, nm: from, to, step.
const COLORS_NM: [u32; 3] = [380, 780, 5];

impl Colors {
    /// The colours of a light seen through a response. All of one wavelength where nothing is seen.
    pub fn new(response: &Table, light: &Table) -> Colors {
        let [from, to, step] = COLORS_NM;
        let mut sum = 0.0;
        let mut cumulative = vec![[f64::from(from), 0.0]];
        for nm in (from..to).step_by(step as usize) {
            let middle = nm as f32 + 0.5 * step as f32;
            sum += f64::from(response.at(middle)).max(0.0) * f64::from(light.at(middle)).max(0.0);
            cumulative.push([f64::from(nm + step), sum]);
        }
        if !(sum > 0.0 && sum.is_finite()) {
            return Colors::one(diopter_lens::compound::REFERENCE_NM);
        }
        cumulative.iter_mut().for_each(|c| c[1] /= sum);
        Colors { cumulative }
    }

    /// The colours of one wavelength, nm.
    pub fn one(nm: f64) -> Colors {
        Colors { cumulative: vec![[nm, 0.0], [nm, 1.0]] }
    }

    /// The wavelength up to which a fraction of the light lies, nm.
    fn at(&self, fraction: f64) -> f64 {
        let next = self.cumulative.partition_point(|c| c[1] <= fraction).clamp(1, self.cumulative.len() - 1);
        let ([a, below], [b, above]) = (self.cumulative[next - 1], self.cumulative[next]);
        if above > below { a + (b - a) * ((fraction - below) / (above - below)).clamp(0.0, 1.0) } else { a }
    }
}

/// What a place of the picture shows.
pub(crate) struct Subject<'a> {
    /// Pixels from the upper left corner of the picture.
    pub at: DVec2,
    /// Column and row.
    pub pixel: [usize; 2],
    /// The middle of the time for which the pixel is open, s from the beginning of the exposure.
    pub time_s: f64,
    /// The chief ray then, in the world.
    pub ray: Ray,
    /// What it meets; `None` where it leaves the scene.
    pub surface: Option<Surface>,
    motion: OtherExposure<'a>,
}

impl<'a> Subject<'a> {
    /// At a place of the picture, of an exposure that begins at `at_s` (scene time, s); `None` where the lens lets no light pass.
    pub fn seen(scene: &'a Scene, camera: &Camera, shutter: &Shutter, at_s: f64, at: DVec2) -> Option<Subject<'a>> {
        let film = &camera.film;
        let pixel = [(at.x.max(0.0) as usize).min(film.columns - 1), (at.y.max(0.0) as usize).min(film.rows - 1)];
        let (open, close) = shutter.window(&Place { pixel, size: [film.columns, film.rows], pupil: 0.0 });
        let time_s = 0.5 * (open + close);
        let ray = camera.chief_ray(camera.film_point(at.x, at.y), time_s).ok().filter(Ray::is_finite)?;
        let surface = scene.first_visible(&ray);
        Some(Subject { at, pixel, time_s, ray, surface, motion: scene.other_exposure(at_s, shutter.total_s()) })
    }

    /// The scene point at a moment as the camera sees it from where it is at another.
    fn target(&self, camera: &Camera, subject_s: f64, camera_s: f64) -> Option<Target> {
        let place = camera.motion.at(camera_s);
        Some(match &self.surface {
            Some(surface) => Target::point(self.motion.point(surface, self.time_s as f32, subject_s)?, &place),
            None => Target::direction(self.ray.direction, &place),
        })
    }

    /// Where chief rays image the point at moments of the exposure, pixels; `None` where the lens does not show it at one of them.
    pub fn path(&self, camera: &Camera, times_s: impl Iterator<Item = f64>) -> Option<Vec<DVec2>> {
        let chief = |at: DVec2| {
            let ray = camera.lens.chief_ray(camera.film_point(at.x, at.y)).ok()?;
            Some((ray.origin_mm, ray.direction))
        };
        let mut near = self.at;
        times_s
            .map(|time_s| {
                near = projection::find(self.target(camera, time_s, time_s)?, near, chief)?;
                Some(near)
            })
            .collect()
    }

    /// Distance at which a lens is to be focused for the point, mm: along the camera's axis, where it focuses on planes. `None` of what is infinitely far away.
    pub fn focus_mm(&self, camera: &Camera) -> Option<f64> {
        match self.target(camera, self.time_s, self.time_s)? {
            Target::Point(p) if camera.focuses_on_planes() => Some(-p.z),
            Target::Point(p) => Some(p.length()),
            Target::Direction(_) => None,
        }
    }
}

/// What moves during the exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Moving {
    pub subject: bool,
    pub camera: bool,
}

/// A part of the light of the point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    /// Where rays bring it, mm on the film.
    pub at_mm: DVec2,
    /// How far diffraction moves it, mm.
    pub displaced_mm: DVec2,
    pub weight: f64,
}

/// The image of a scene point.
#[derive(Clone, Debug)]
pub(super) struct Spot {
    pub arrivals: Vec<Arrival>,
    /// Mean of weight × time over the pupil, sr s: what a unit of radiance exposes the film by.
    pub exposure: f64,
}

/// A place of the pupil: rays from any film point go through it.
#[derive(Clone, Copy)]
enum PupilPlace<'a> {
    /// Of an ideal lens: what a place in the unit square stands for does not depend on the film point.
    Ideal { lens: &'a Lens, u: [f32; 2] },
    /// Of a real lens: slope at the middle of the film, of rays towards the place in the exit pupil. The unit square would not do: the tables of the pupil turn
    /// with the azimuth of the film point ([`diopter_lens::pupil::PupilTable::region`]), by any angle near the axis.
    Traced { lens: &'a CompoundLens, place: DVec2, curvature: f64, area: f64 },
}

impl<'a> PupilPlace<'a> {
    /// The place that the unit square means at a film point; `None` where no light arrives there.
    fn new(lens: &'a Lens, film: DVec2, u: [f32; 2]) -> Option<PupilPlace<'a>> {
        let Lens::Compound(real) = lens else { return Some(PupilPlace::Ideal { lens, u }) };
        let (pupils, curvature) = (real.pupils(), lens.exit_curvature());
        let (region, turn) = pupils.region(film);
        let area = region.fan.area();
        let place = (area > 0.0).then(|| pupils.slope(film, region.fan.sample(u), turn) + film * curvature)?;
        Some(PupilPlace::Traced { lens: real, place, curvature, area })
    }

    /// The ray from a film point through it; its weight is that of [`Lens::ray`].
    fn ray(&self, film: DVec2, nm: f64) -> Option<LensRay> {
        match *self {
            PupilPlace::Ideal { lens, u } => lens.ray(film, u).ok(),
            PupilPlace::Traced { lens, place, curvature, area } => {
                let ray = lens.ray_along(film, place - film * curvature, nm).ok()?;
                Some(LensRay { weight_sr: ray.weight_sr * area, ..ray })
            }
        }
    }
}

/// Finds film points near that of the chief ray.
struct Finder {
    start: DVec2,
    /// Directions across the chief ray, by which a ray's miss is counted.
    across: DVec3,
    up: DVec3,
    /// Pixels by what is missed.
    inverse: DMat2,
}

impl Finder {
    fn new(camera: &Camera, near: DVec2, target: Target) -> Option<Finder> {
        let chief = |at: DVec2| {
            let ray = camera.lens.chief_ray(camera.film_point(at.x, at.y)).ok()?;
            Some((ray.origin_mm, ray.direction))
        };
        let start = projection::find(target, near, chief)?;
        let (across, up) = target.direction_from(chief(start)?.0).any_orthonormal_pair();
        let miss = |at: DVec2| {
            let (origin, direction) = chief(at)?;
            let off = direction - target.direction_from(origin);
            Some(DVec2::new(off.dot(across), off.dot(up)))
        };
        let here = miss(start)?;
        let slope = |step: DVec2| {
            let forward = miss(start + step).map(|there| (there - here) / STEP_PX);
            forward.or_else(|| miss(start - step).map(|there| (here - there) / STEP_PX))
        };
        let inverse = DMat2::from_cols(slope(DVec2::X * STEP_PX)?, slope(DVec2::Y * STEP_PX)?).inverse();
        inverse.is_finite().then_some(Finder { start, across, up, inverse })
    }

    /// The place (pixels) whose ray passes a target.
    fn find(&self, target: Target, ray: impl Fn(DVec2) -> Option<(DVec3, DVec3)>) -> Option<DVec2> {
        let mut at = self.start;
        for _ in 0..MOST_STEPS {
            let (origin, direction) = ray(at)?;
            let off = direction - target.direction_from(origin);
            let step = self.inverse * DVec2::new(off.dot(self.across), off.dot(self.up));
            at -= step;
            if step.length() < CLOSE_PX {
                return Some(at);
            }
            if !(step.length() < FAR_PX) {
                break;
            }
        }
        projection::find(target, self.start, ray)
    }
}

/// The image of a point through the camera's lens; `None` where the lens does not show it.
pub(super) fn spot(
    subject: &Subject,
    camera: &Camera,
    shutter: &Shutter,
    moving: Moving,
    diffraction: Option<&Diffraction>,
    colors: &Colors,
) -> Option<Spot> {
    let finder = Finder::new(camera, subject.at, subject.target(camera, subject.time_s, subject.time_s)?)?;
    let kernel = diffraction.map(|d| d.at(camera.film_point(finder.start.x, finder.start.y)));
    let sample = |i: u32| arrival(i, &finder, subject, camera, shutter, moving, diffraction.zip(kernel), colors);
    let arrivals: Vec<Arrival> = (0..SAMPLES).into_par_iter().filter_map(sample).collect();
    let exposure = arrivals.iter().map(|a| a.weight).sum::<f64>() / f64::from(SAMPLES);
    (exposure > 0.0).then_some(Spot { arrivals, exposure })
}

/// Where a sample of the light arrives; `None` where it is blocked.
#[allow(clippy::too_many_arguments)]
fn arrival(
    number: u32,
    finder: &Finder,
    subject: &Subject,
    camera: &Camera,
    shutter: &Shutter,
    moving: Moving,
    diffraction: Option<(&Diffraction, Kernel)>,
    colors: &Colors,
) -> Option<Arrival> {
    let (lens, film) = (&camera.lens, &camera.film);
    let sampler = Sampler::new(SamplerKind::Sobol, SEED, (0, 0), number, SAMPLES);
    let [_, _, pu, pv] = sampler.get(Dimensions::Camera);
    let [color, moment, ..] = sampler.get(Dimensions::Time);
    let (u, nm) = ([pu, pv], colors.at(f64::from(color)));
    let start_mm = camera.film_point(finder.start.x, finder.start.y);
    let place = PupilPlace::new(lens, start_mm, u)?;
    let of_place = |at: DVec2| place.ray(camera.film_point(at.x, at.y), nm).map(|r| (r.origin_mm, r.direction));
    // Blades at the pupil let light pass at times of their own.
    let (origin, direction) = of_place(finder.start)?;
    let pupil = camera.pupil_radius(origin, direction);
    let (open, close) = shutter.window(&Place { pixel: subject.pixel, size: [film.columns, film.rows], pupil });
    if open >= close {
        return None;
    }
    let time_s = open + f64::from(moment) * (close - open);
    let when = |moves: bool| if moves { time_s } else { subject.time_s };
    let at = finder.find(subject.target(camera, when(moving.subject), when(moving.camera))?, of_place)?;
    let mut at_mm = camera.film_point(at.x, at.y);
    let weight = place.ray(at_mm, nm)?.weight_sr * (close - open);
    let mut displaced_mm = DVec2::ZERO;
    if let Some((diffraction, kernel)) = diffraction {
        let [a, b, ..] = sampler.get(Dimensions::Diffraction(0));
        displaced_mm = kernel.draw([a, b], nm as f32);
        // The aberration in the plane of focus is in the pattern: rays of the exposure leave it out ([`Diffraction::straightened`]).
        if let Lens::Compound(lens) = lens {
            at_mm += start_mm - diffraction.straightened(lens, start_mm, u);
        }
    }
    (weight > 0.0 && at_mm.is_finite()).then_some(Arrival { at_mm, displaced_mm, weight })
}

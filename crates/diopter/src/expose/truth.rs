//! The truth of each pixel: what the rays of the exposure meet, one function for each channel of the table ([`diopter_image::channels`]).
//!
//! Channels of one ray follow the chief ray of the pixel's middle through the lens as it is, halfway through the time for which this pixel is open: rows of a
//! rolling shutter have moments of their own. Channels weighted by coverage follow rays of the samples through the whole pixel, pupil and time, drawn evenly over
//! what the lens lets pass, as the radiance of a film is ([`super::expose()`]).

use super::blur::Blur;
use super::frames::Frames;
use super::{RADIANCE_REDRAWS, Settings};
use crate::camera::Camera;
use crate::camera_motion::CameraMotion;
use crate::mount::{film_shift_on, lens_on};
use crate::projection::{self, Target};
use crate::shutter::{Place, Shutter};
use diopter_image::channels::{COVERAGE_SAMPLES, Channel, ChannelId};
use diopter_image::cryptomatte;
use diopter_image::focal_plane::Truth;
use diopter_image::truth::{Manifest, Ranks, Recorded, Values};
use diopter_lens::LensRay;
use diopter_lens::microlens::MicrolensOptics;
use diopter_light::Ray;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_scene::classes::UNCLASSIFIED;
use diopter_scene::shape::Surface;
use diopter_scene::{Description, FirstSurface, Immersion, OtherExposure, Scene};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What denoisers are guided by: as the truth, but with albedo and normals of what smooth glass and mirrors show.
pub(crate) fn features(scene: &Scene, camera: &Camera, shutter: &Shutter) -> Truth {
    let settings = Settings::new(1);
    let immersion = immersion(scene, camera);
    let look = |ray: &Ray| scene.first_rough_surface(ray, immersion);
    let recorder = Recorder { look: Some(&look), ..Recorder::new(scene, camera, shutter, &settings) };
    let rows = camera.film.rows;
    recorder.rows(0..rows, &AtomicBool::new(false)).unwrap_or_else(|| Truth::empty(camera.film.columns, rows))
}

/// What the camera stands in.
pub(super) fn immersion(scene: &Scene, camera: &Camera) -> Immersion {
    scene.immersion_at(camera.motion.at(0.0).translation.into())
}

/// What one pixel sees along its ray.
pub(super) struct Seen {
    /// Place in the picture, pixels from its upper left corner.
    at: DVec2,
    /// s from the beginning of the exposure.
    time_s: f64,
    /// In the world.
    ray: Ray,
    /// What it meets.
    first: Option<FirstSurface>,
    /// The point that it meets; only where more is recorded than always.
    surface: Option<Surface>,
}

/// How a channel is filled at a pixel.
#[derive(Clone, Copy)]
enum Fill {
    /// With floating-point numbers of one ray; left alone where there is nothing to record.
    Float(fn(&Recorder, &Seen, &mut [f32])),
    /// With whole numbers of one ray.
    Whole(fn(&Recorder, &Seen, &mut [u32])),
    /// With the mean of a number over the samples.
    Mean(fn(Option<&Surface>) -> f64),
    /// By the sums of the exposure or what comes after it: left at what it reads where there is nothing.
    Later,
    /// With how much of the pixel each identifier covers.
    Ranks(fn(&Recorder, &Surface) -> f32),
}

/// The function of a channel.
fn fill(channel: ChannelId) -> Fill {
    match channel {
        ChannelId::Depth => Fill::Float(depth),
        ChannelId::Normal => Fill::Float(normal),
        ChannelId::Albedo => Fill::Float(albedo),
        ChannelId::Id => Fill::Whole(id),
        ChannelId::Class => Fill::Whole(class),
        ChannelId::Position => Fill::Float(position),
        ChannelId::Distance => Fill::Float(distance),
        ChannelId::Uv => Fill::Float(uv),
        ChannelId::Incidence => Fill::Float(incidence),
        ChannelId::Coc => Fill::Float(circle_of_confusion),
        ChannelId::Pupil => Fill::Float(pupil),
        ChannelId::Motion => Fill::Float(motion),
        ChannelId::Flow => Fill::Float(forward_flow),
        ChannelId::BackwardFlow => Fill::Float(backward_flow),
        ChannelId::Transmitted => Fill::Float(transmitted),
        ChannelId::Coverage => Fill::Mean(|surface| f64::from(u8::from(surface.is_some()))),
        ChannelId::CryptoObject => Fill::Ranks(|recorder, surface| recorder.mattes.objects[surface.object as usize]),
        ChannelId::CryptoMaterial => Fill::Ranks(|recorder, surface| {
            let object = &recorder.scene.description().objects[surface.object as usize];
            recorder.mattes.materials[object.material as usize]
        }),
        ChannelId::CryptoClass => Fill::Ranks(|recorder, surface| recorder.mattes.classes[recorder.class_of(surface.object)]),
        ChannelId::StrayLight | ChannelId::Direct | ChannelId::Indirect => Fill::Later,
    }
}

fn depth(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(first) = &seen.first else { return };
    let from_place = seen.ray.origin - recorder.camera.place(seen.time_s);
    to[0] = match recorder.all_around {
        true => first.distance + from_place.dot(seen.ray.direction),
        false => {
            let along_axis = |v: Vec3| recorder.camera.cosine_to_axis(v, seen.time_s);
            first.distance * along_axis(seen.ray.direction) + along_axis(from_place)
        }
    };
}

fn normal(_: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(first) = &seen.first else { return };
    to.copy_from_slice(&first.normal.to_array());
}

fn albedo(_: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(first) = &seen.first else { return };
    to.copy_from_slice(&first.albedo.to_array());
}

fn id(_: &Recorder, seen: &Seen, to: &mut [u32]) {
    let Some(first) = &seen.first else { return };
    to[0] = first.object + 1;
}

fn class(recorder: &Recorder, seen: &Seen, to: &mut [u32]) {
    let Some(first) = &seen.first else { return };
    to[0] = recorder.class_of(first.object) as u32 + 1;
}

fn position(_: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(surface) = &seen.surface else { return };
    to.copy_from_slice(&surface.point.to_array());
}

fn distance(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(surface) = &seen.surface else { return };
    // The ray begins where it leaves the front glass.
    let from_place = seen.ray.origin - recorder.camera.place(seen.time_s);
    to[0] = surface.t + from_place.dot(seen.ray.direction);
}

fn uv(_: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(surface) = &seen.surface else { return };
    to.copy_from_slice(&surface.uv[0].to_array());
}

fn incidence(_: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(surface) = &seen.surface else { return };
    let (n, d) = (surface.ng, seen.ray.direction);
    // By both functions: near 0 and π/2 either alone loses digits.
    to[0] = n.cross(d).length().atan2(n.dot(d).abs());
}

fn circle_of_confusion(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let distance = seen.surface.as_ref().map_or(f64::INFINITY, |s| f64::from(s.t));
    if let Some(circle) = recorder.blur.as_ref().and_then(|blur| blur.circle_px(seen.at, distance)) {
        to[0] = circle as f32;
    }
}

fn pupil(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    if let Some(blur) = &recorder.blur {
        to[0] = blur.open(seen.at) as f32;
    }
}

fn motion(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let (Some(surface), Some([_, next])) = (&seen.surface, &recorder.frames) else { return };
    // The same moment of the next frame.
    let Some(there) = next.scene.point(surface, seen.time_s as f32, seen.time_s) else { return };
    to.copy_from_slice(&(there - surface.point.as_dvec3()).as_vec3().to_array());
}

fn forward_flow(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some([_, next]) = &recorder.frames else { return };
    if let Some(flow) = recorder.flow(seen, next) {
        to.copy_from_slice(&flow.as_vec2().to_array());
    }
}

fn backward_flow(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some([previous, _]) = &recorder.frames else { return };
    if let Some(flow) = recorder.flow(seen, previous) {
        to.copy_from_slice(&flow.as_vec2().to_array());
    }
}

fn transmitted(recorder: &Recorder, seen: &Seen, to: &mut [f32]) {
    let Some(point) = recorder.scene.first_rough_point(&seen.ray, recorder.immersion) else { return };
    to.copy_from_slice(&point.to_array());
}

/// Identifiers of Cryptomatte by number; empty where nobody asked for them.
#[derive(Default)]
struct Mattes {
    objects: Vec<f32>,
    materials: Vec<f32>,
    /// By number of the class.
    classes: Vec<f32>,
    /// Number of the class of each object.
    class_of: Vec<u32>,
}

/// A name that says something: of what has none, its number.
fn named(name: &str, kind: &str, number: usize) -> String {
    if name.is_empty() { format!("{kind}-{number}") } else { name.to_owned() }
}

/// Another frame.
struct OtherFrame<'a> {
    scene: OtherExposure<'a>,
    motion: &'a CameraMotion,
}

/// Turns between the moment of a row and the place of a point that a rolling shutter takes at most; each brings the place as much nearer as the point moves slower
/// than the rows.
const MOST_TURNS: usize = 40;
/// A place is found when it moves less than this between two turns, in pixels.
const STILL: f64 = 1e-3;

/// What a ray meets first.
type Look<'a> = &'a (dyn Fn(&Ray) -> Option<FirstSurface> + Sync);

/// Records the truth of an exposure.
pub(super) struct Recorder<'a> {
    camera: &'a Camera,
    shutter: &'a Shutter,
    recorded: Recorded,
    scene: &'a Scene,
    /// What is looked at instead of the first surface.
    look: Option<Look<'a>>,
    /// The microlens array, if there is one.
    behind: Option<MicrolensOptics>,
    /// Whether the lens has no axis: depth is then distance.
    all_around: bool,
    /// What the camera stands in.
    immersion: Immersion,
    settings: &'a Settings,
    /// Where it is asked for.
    blur: Option<Blur>,
    /// The frame before and the next, where they are known and asked for.
    frames: Option<[OtherFrame<'a>; 2]>,
    mattes: Mattes,
}

/// A row of a channel.
enum Row<'a> {
    Float(&'a mut [f32]),
    Whole(&'a mut [u32]),
}

impl<'a> Recorder<'a> {
    /// Records what the settings ask for.
    pub fn new(scene: &'a Scene, camera: &'a Camera, shutter: &'a Shutter, settings: &'a Settings) -> Self {
        let channels = &settings.truth_channels;
        let asked = |needs: fn(&Channel) -> bool| settings.truth && channels.iter().any(|c| needs(c));
        let behind = camera.film.microlenses.map(|m| m.behind(&camera.lens));
        let blur = asked(|c| matches!(c.id, ChannelId::Coc | ChannelId::Pupil)).then(|| Blur::new(camera));
        let span_s = shutter.total_s();
        let frame = |frames: &'a Frames, sign: f64, motion: &'a CameraMotion| OtherFrame {
            scene: scene.other_exposure(frames.at_s + sign * frames.step_s, span_s),
            motion,
        };
        let frames = settings.frames.as_deref().filter(|_| asked(|c| c.needs_frames));
        let frames = frames.map(|f| [frame(f, -1.0, &f.previous), frame(f, 1.0, &f.next)]);
        let (recorded, mattes) = recorded(scene, settings);
        let all_around = !camera.has_axis();
        let immersion = immersion(scene, camera);
        Recorder { camera, shutter, recorded, scene, look: None, behind, all_around, immersion, settings, blur, frames, mattes }
    }

    /// Number of an object's class.
    fn class_of(&self, object: u32) -> usize {
        self.mattes.class_of[object as usize] as usize
    }

    /// What is recorded.
    pub fn recorded(&self) -> Recorded {
        self.recorded.clone()
    }

    /// The truth of some rows; `None` once `cancel` is set.
    pub fn rows(&self, rows: Range<usize>, cancel: &AtomicBool) -> Option<Truth> {
        let width = self.camera.film.columns;
        let mut truth = Truth::missing(self.recorded.clone(), width, rows.len());
        let fills: Vec<(usize, Fill)> = self.recorded.channels().iter().map(|c| (c.parts(), fill(c.id))).collect();
        let sampled = fills.iter().any(|(_, fill)| matches!(fill, Fill::Mean(_) | Fill::Ranks(_)));
        // Each row where it belongs: no second copy of the planes.
        let mut planes: Vec<Vec<Row>> = rows.clone().map(|_| Vec::with_capacity(fills.len())).collect();
        for (channel, values) in truth.iter_mut() {
            let stride = (width * channel.parts()).max(1);
            match values {
                Values::Float(raster) => {
                    planes.iter_mut().zip(raster.data.chunks_mut(stride)).for_each(|(row, chunk)| row.push(Row::Float(chunk)));
                }
                Values::Whole(raster) => {
                    planes.iter_mut().zip(raster.data.chunks_mut(stride)).for_each(|(row, chunk)| row.push(Row::Whole(chunk)));
                }
            }
        }
        let whole = planes.into_par_iter().enumerate().try_for_each(|(row, mut planes)| {
            if cancel.load(Ordering::Relaxed) {
                return None;
            }
            let mut counts = Counts::default();
            for column in 0..width {
                if sampled {
                    self.count(column, rows.start + row, &fills, &mut counts);
                    for (k, (plane, (parts, fill))) in planes.iter_mut().zip(&fills).enumerate() {
                        let Row::Float(plane) = plane else { continue };
                        let to = &mut plane[column * parts..(column + 1) * parts];
                        match fill {
                            Fill::Mean(_) => to[0] = counts.means[k] as f32,
                            Fill::Ranks(_) => counts.ranks[k].write(to),
                            Fill::Float(_) | Fill::Whole(_) | Fill::Later => (),
                        }
                    }
                }
                let Some(seen) = self.seen(column, rows.start + row) else { continue };
                for (plane, (parts, fill)) in planes.iter_mut().zip(&fills) {
                    let place = column * parts..(column + 1) * parts;
                    match (plane, fill) {
                        (Row::Float(row), Fill::Float(fill)) => fill(self, &seen, &mut row[place]),
                        (Row::Whole(row), Fill::Whole(fill)) => fill(self, &seen, &mut row[place]),
                        (Row::Float(_), Fill::Mean(_) | Fill::Ranks(_) | Fill::Later) => (),
                        _ => unreachable!("a function of other numbers than its channel has"),
                    }
                }
            }
            Some(())
        });
        whole.map(|()| truth)
    }

    /// The middle of the time for which a pixel is open through the middle of the pupil, s.
    fn middle_s(&self, column: usize, row: usize) -> f64 {
        let film = &self.camera.film;
        let (open, close) = self.shutter.window(&Place { pixel: [column, row], size: [film.columns, film.rows], pupil: 0.0 });
        0.5 * (open + close)
    }

    /// The ray of a place of the picture (pixels from its upper left corner) at a time; `None` where the lens lets nothing pass.
    fn ray_of(&self, at: DVec2, time_s: f64) -> Option<Ray> {
        let film = self.camera.film_point(at.x, at.y);
        let ray = match &self.behind {
            None => self.camera.chief_ray(film, time_s),
            // What a pixel behind a microlens sees through its middle.
            Some(behind) => {
                let aimed = behind.middle(film + film_shift_on(&self.camera.motion, time_s));
                self.camera.lens_at(time_s).ray_along(aimed.at, aimed.slope).map(|ray| self.camera.to_world(&ray, time_s))
            }
        };
        ray.ok().filter(Ray::is_finite)
    }

    /// What a pixel sees along the ray of its middle; `None` where the lens lets nothing pass.
    fn seen(&self, column: usize, row: usize) -> Option<Seen> {
        let time_s = self.middle_s(column, row);
        let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        let ray = self.ray_of(at, time_s)?;
        let first = self.look.map_or_else(|| self.scene.first_surface(&ray), |look| look(&ray));
        let surface = if self.recorded.more().is_empty() { None } else { self.scene.first_visible(&ray) };
        Some(Seen { at, time_s, ray, first, surface })
    }

    /// The middle of the time for which a place of the picture is open, s: as [`Recorder::middle_s`] in the middles of pixels, straight between them. Beside
    /// the picture, that of its edge.
    fn time_at(&self, at: DVec2) -> f64 {
        let cell = |x: f64, n: usize| {
            let x = (x - 0.5).clamp(0.0, n as f64 - 1.0);
            let i = (x as usize).min(n.saturating_sub(2));
            (i, (i + 1).min(n - 1), x - i as f64)
        };
        let film = &self.camera.film;
        let ((left, right, across), (above, below, down)) = (cell(at.x, film.columns), cell(at.y, film.rows));
        let here = self.middle_s(left, above);
        here + across * (self.middle_s(right, above) - here) + down * (self.middle_s(left, below) - here)
    }

    /// Origin (mm) and unit direction of the chief ray of a place of the picture, in the space of the lens, at a time of the exposure of which `way` is the camera's.
    fn lens_ray(&self, at: DVec2, motion: &CameraMotion, time_s: f64) -> Option<(DVec3, DVec3)> {
        let film = self.camera.film_point(at.x, at.y) + film_shift_on(motion, time_s);
        let lens = lens_on(motion, &self.camera.lens, time_s);
        let ray: LensRay = match &self.behind {
            None => lens.chief_ray(film),
            Some(behind) => {
                let aimed = behind.middle(film);
                lens.ray_along(aimed.at, aimed.slope)
            }
        }
        .ok()?;
        Some((ray.origin_mm, ray.direction))
    }

    /// How far (pixels, to the right and down) what a pixel sees lies in another frame from where it is here; what is infinitely far away moves by the
    /// turns of the camera. `None` where the lens does not show it there.
    ///
    /// The moment at which the point is seen follows from its row and the row from the moment: both are found in turns.
    fn flow(&self, seen: &Seen, frame: &OtherFrame) -> Option<DVec2> {
        let mut at = seen.at;
        for _ in 0..MOST_TURNS {
            let time_s = self.time_at(at);
            let place = frame.motion.at(time_s);
            let target = match &seen.surface {
                Some(surface) => Target::point(frame.scene.point(surface, seen.time_s as f32, time_s)?, &place),
                None => Target::direction(seen.ray.direction, &place),
            };
            let next = projection::find(target, at, |at| self.lens_ray(at, frame.motion, time_s))?;
            let moved = (next - at).length();
            at = next;
            if moved < STILL {
                return Some(at - seen.at);
            }
        }
        None
    }

    /// The samples that channels weighted by coverage look at.
    fn samples(&self) -> Range<u32> {
        coverage_samples(self.settings)
    }

    /// Looks along the samples of a pixel.
    fn count(&self, column: usize, row: usize, fills: &[(usize, Fill)], counts: &mut Counts) {
        counts.means.clear();
        counts.means.resize(fills.len(), 0.0);
        counts.ranks.resize_with(fills.len(), Ranks::default);
        counts.ranks.iter_mut().for_each(Ranks::clear);
        let samples = self.samples();
        let part = 1.0 / samples.len().max(1) as f64;
        for sample in samples {
            let surface = self.sample_ray(column, row, sample).and_then(|ray| self.scene.first_visible(&ray));
            for (k, (_, fill)) in fills.iter().enumerate() {
                match fill {
                    Fill::Mean(value) => counts.means[k] += part * value(surface.as_ref()),
                    Fill::Ranks(id) => {
                        if let Some(surface) = &surface {
                            counts.ranks[k].add(id(self, surface), part);
                        }
                    }
                    Fill::Float(_) | Fill::Whole(_) | Fill::Later => (),
                }
            }
        }
    }

    /// The ray of a sample of a pixel, drawn again until the lens lets it pass; `None` where nothing passes.
    fn sample_ray(&self, column: usize, row: usize, sample: u32) -> Option<Ray> {
        let (settings, camera) = (self.settings, self.camera);
        // A range of a lattice or of strata is no even part of the pixel.
        let kind = match settings.sampler {
            SamplerKind::Independent => SamplerKind::Independent,
            _ => SamplerKind::Sobol,
        };
        let sampler = Sampler::new(kind, settings.seed, (column as u32, row as u32), sample, settings.spp);
        let [_, t, spot @ ..] = sampler.get(Dimensions::Time);
        // The moment without the pupil, which decides only where a leaf shutter opens: what moves against shake hardly does so meanwhile.
        let film = &camera.film;
        let size = [film.columns, film.rows];
        let (open, close) = self.shutter.window(&Place { pixel: [column, row], size, pupil: 0.0 });
        let moment = open + f64::from(t) * (close - open).max(0.0);
        let lens = camera.lens_at(moment);
        let shift = camera.film.low_pass_shift(spot) - film_shift_on(&camera.motion, moment);
        let ray = (0..=RADIANCE_REDRAWS).find_map(|attempt| {
            let [u, v, pupil @ ..] = sampler.get(if attempt == 0 { Dimensions::Camera } else { Dimensions::Redraw(attempt) });
            let at = camera.film.within_pixel([u, v]);
            let film = camera.film_point(column as f64 + at[0], row as f64 + at[1]) - shift;
            match &self.behind {
                None => lens.ray(film, pupil).ok(),
                Some(behind) => behind.draw(film, pupil).and_then(|aimed| lens.ray_along(aimed.at, aimed.slope).ok()),
            }
        })?;
        let pupil = camera.pupil_radius(ray.origin_mm, ray.direction);
        let (open, close) = self.shutter.window(&Place { pixel: [column, row], size, pupil });
        let ray = camera.to_world(&ray, open + f64::from(t) * (close - open).max(0.0));
        Some(ray).filter(Ray::is_finite)
    }
}

/// What the samples of a pixel met, by channel.
#[derive(Default)]
struct Counts {
    means: Vec<f64>,
    ranks: Vec<Ranks>,
}

/// The samples that channels weighted by coverage look at: as many at most as [`COVERAGE_SAMPLES`], so that a time limit is known beforehand.
fn coverage_samples(settings: &Settings) -> Range<u32> {
    let most = settings.spp.min(COVERAGE_SAMPLES);
    settings.samples.start.min(most)..settings.samples.end.min(most)
}

/// What is recorded, with its names, and their identifiers.
fn recorded(scene: &Scene, settings: &Settings) -> (Recorded, Mattes) {
    let mut recorded = Recorded::new(&settings.truth_channels);
    let mut mattes = Mattes::default();
    if recorded.more().is_empty() {
        return (recorded, mattes);
    }
    let d = scene.description();
    let objects = object_names(d);
    let materials: Vec<String> = d.materials.iter().enumerate().map(|(i, m)| named(&m.name, "material", i)).collect();
    let mut manifests = Vec::new();
    let mut sampled = false;
    let mut classes = Vec::new();
    if recorded.more().iter().any(|c| matches!(c.id, ChannelId::Class | ChannelId::CryptoClass)) {
        (classes, mattes.class_of) = numbered_classes(d);
    }
    for channel in recorded.more() {
        let (names, to) = match channel.id {
            ChannelId::CryptoObject => (&objects, &mut mattes.objects),
            ChannelId::CryptoMaterial => (&materials, &mut mattes.materials),
            ChannelId::CryptoClass => (&classes, &mut mattes.classes),
            _ => {
                sampled |= matches!(fill(channel.id), Fill::Mean(_));
                continue;
            }
        };
        sampled = true;
        *to = names.iter().map(|name| cryptomatte::identifier(name)).collect();
        let names = names.iter().cloned().collect::<BTreeSet<String>>().into_iter().collect();
        manifests.push(Manifest::new(channel.matte_layer(), names));
    }
    if sampled && settings.truth {
        recorded.samples = coverage_samples(settings).len() as u32;
    }
    manifests.sort_by(|a, b| a.layer.cmp(&b.layer));
    (recorded.objects, recorded.classes, recorded.manifests) = (Arc::new(objects), Arc::new(classes), Arc::new(manifests));
    (recorded, mattes)
}

/// Names of the objects of a scene, by number.
pub(crate) fn object_names(d: &Description) -> Vec<String> {
    d.objects.iter().enumerate().map(|(i, o)| named(&o.name, "object", i)).collect()
}

/// Names of the classes of a scene and the number of that of each object: first those that its table lists, also where nothing is one of them, then others in order of their
/// names; what has none is of the class [`UNCLASSIFIED`].
fn numbered_classes(d: &Description) -> (Vec<String>, Vec<u32>) {
    let listed: Vec<&str> = d.listed_classes.iter().map(|class| &**class).collect();
    let others: BTreeSet<&str> = d.objects.iter().map(|o| o.class.as_deref().unwrap_or(UNCLASSIFIED)).collect();
    let names: Vec<&str> = listed.iter().copied().chain(others.into_iter().filter(|name| !listed.contains(name))).collect();
    let numbers: BTreeMap<&str, u32> = names.iter().copied().zip(0..).collect();
    let of = d.objects.iter().map(|o| numbers[o.class.as_deref().unwrap_or(UNCLASSIFIED)]).collect();
    (names.into_iter().map(str::to_owned).collect(), of)
}

#[cfg(test)]
mod tests;

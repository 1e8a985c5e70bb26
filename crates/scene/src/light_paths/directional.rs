//! Where light paths of the sun, and of other light that comes from infinitely far, begin.
//!
//! Little of the cross-section of a scene lets the sun into a room. Thousands of camera paths are followed before the exposure; where a vertex of one behind its
//! first scattering is lit by such a light, a line is found on which light matters to the picture. Light paths begin on lines drawn from the cells of a grid over the found ones, in
//! proportion to the light that those brought (importance from the camera: Peter & Pietrek 1998, "Importance Driven Construction of Photon Maps"). Where no line was
//! found no light path begins, and camera paths have the light to themselves: the weights of [`super::vertices`] know the density of every line, so there is
//! no bias.

use super::ConnectionSettings;
use super::can_connect::can_connect;
use super::emission::SMALL_DISC;
use crate::light::punctual::{disc_density, disc_sr, within_disc};
use crate::light::{LightPoint, LightSample, Punctual, PunctualKind};
use crate::material::Scattering;
use crate::medium_stack::MediumStack;
use crate::radiance::origin_behind;
use crate::russian_roulette::{MOST_SURVIVAL, survives};
use crate::scene::Scene;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::sampling::{self, Grid2};
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Camera rays from which is learnt where parallel light matters.
pub struct CameraRays<'a> {
    /// By number, with wavelengths, spread over the picture; `None` where no light comes through the lens.
    pub ray: &'a (dyn Fn(u32) -> Option<(Ray, SampledWavelengths)> + Sync),
    /// Most of them that are followed: a part of the paths of the exposure.
    pub most: u32,
}

impl CameraRays<'_> {
    /// None: no light path of parallel light begins.
    pub const NONE: CameraRays<'static> = CameraRays { ray: &|_| None, most: 0 };
}

/// Camera paths that a thread follows at a time, those of a round, and most of all: the first round is enough where windows are large.
const CHUNK: u32 = 256;
const ROUND: u32 = 1 << 13;
const MOST_PATHS: u32 = 1 << 16;
/// Segments after which a path is left.
const MOST_SEGMENTS: u32 = 64;
/// Scattering events before Russian roulette starts.
const ROULETTE_DEPTH: u32 = 3;
/// Fewer lines than this say too little; after so many as are enough none are looked for.
const FEWEST_LINES: usize = 32;
const ENOUGH_LINES: u64 = 512;
/// Most cells of the grid a side, and fewest; lines that a cell with any must hold on average.
const MOST_CELLS: usize = 128;
const FEWEST_CELLS: usize = 4;
const LINES_A_CELL: usize = 4;
/// Fraction of the light that is left out at each end of both axes, so that what is lit far out does not make cells large.
const LEFT_OUT: f32 = 0.005;
/// A line counts for no more than so many times the mean: a single one must not draw all light paths.
const MOST_OF_A_LINE: f32 = 8.0;

/// Lines of a light at infinity on which light paths begin.
pub(super) struct DirectionalEmission {
    light: Light,
    /// A sphere around everything, m.
    around: (Vec3, f32),
    /// A point of the plane across the light, in the middle of what it lights: the lines of all directions of a disc are close to each other there.
    origin: Vec3,
    /// Corner of the grid on the plane, and its size, m.
    low: Vec2,
    size: Vec2,
    grid: Grid2,
    /// Area of the cells in which there are lines, m².
    pub lit_m2: f32,
}

/// A light at infinity.
#[derive(Clone, Copy)]
struct Light {
    number: u32,
    /// Unit direction in which the light of its middle goes.
    axis: Vec3,
    /// Of a disc, rad.
    half_angle: Option<f32>,
    /// lx.
    illuminance: f32,
}

impl Light {
    /// `None` of lights that are near, too wide or dark.
    fn new(number: u32, light: &Punctual) -> Option<Light> {
        let (axis, half_angle) = match light.kind {
            PunctualKind::Directional { direction } => (direction, None),
            PunctualKind::Disc { direction, half_angle } if half_angle <= SMALL_DISC => (direction, Some(half_angle)),
            _ => return None,
        };
        let illuminance = light.illuminance();
        (illuminance > 0.0).then_some(Light { number, axis, half_angle, illuminance })
    }

    /// A direction, evenly over the solid angle.
    fn direction(&self, u: [f32; 2]) -> Vec3 {
        self.half_angle.map_or(self.axis, |half_angle| within_disc(self.axis, half_angle, u))
    }

    /// Where a line through a point crosses the plane across the light through another, m.
    fn place(&self, origin: Vec3, point: Vec3, direction: Vec3) -> Vec2 {
        let to = point - origin;
        let at = to - direction * (to.dot(self.axis) / direction.dot(self.axis));
        let (x, y) = sampling::frame(self.axis);
        Vec2::new(at.dot(x), at.dot(y))
    }
}

/// A vertex of a camera path where a light arrives.
#[derive(Clone, Copy)]
struct LitVertex {
    /// Place in the list of lights.
    light: usize,
    point: Vec3,
    /// In which the light comes, unit.
    direction: Vec3,
    /// What it brings to the camera, relative.
    brought: f32,
}

/// Its place on the plane, and what it brought.
type Line = (Vec2, f32);

impl DirectionalEmission {
    /// Learns lines of the lights at infinity from the camera. One for each light of which enough were found, by its number.
    pub fn learn(
        scene: &Scene,
        around: (Vec3, f32),
        settings: &ConnectionSettings,
        camera: &CameraRays,
    ) -> Vec<(u32, DirectionalEmission)> {
        let lights: Vec<Light> = (0..).zip(&scene.lights().punctual).filter_map(|(i, l)| Light::new(i, l)).collect();
        // A connection makes two scattering events at least.
        if lights.is_empty() || settings.max_depth < 2 {
            return Vec::new();
        }
        // Numbers of their own beside those of pixels, photons and light paths.
        let seed = settings.seed ^ 0xa54f_f53a_5f1d_36f1;
        let most = camera.most.min(MOST_PATHS);
        let mut found: Vec<LitVertex> = Vec::new();
        let mut followed = 0;
        while followed < most {
            let end = (followed + ROUND).min(most);
            let chunks: Vec<Vec<LitVertex>> = (0..(end - followed).div_ceil(CHUNK))
                .into_par_iter()
                .map(|chunk| {
                    let mut found = Vec::new();
                    let start = followed + chunk * CHUNK;
                    for path in start..(start + CHUNK).min(end) {
                        let Some((ray, wavelengths)) = (camera.ray)(path) else { continue };
                        let sampler = Sampler::new(SamplerKind::Independent, seed, (path, 0), 0, 1);
                        follow(scene, &lights, ray, &wavelengths, &sampler, settings.max_depth, &mut found);
                    }
                    found
                })
                .collect();
            found.extend(chunks.into_iter().flatten());
            followed = end;
            let mut counts = vec![0u64; lights.len()];
            found.iter().for_each(|f| counts[f.light] += 1);
            let hopeless = |n: u64| n * u64::from(most) < FEWEST_LINES as u64 * u64::from(followed);
            if counts.iter().all(|n| *n >= ENOUGH_LINES || hopeless(*n)) {
                break;
            }
        }
        let of_light = |k: usize| found.iter().filter(move |f| f.light == k).copied().collect();
        lights
            .iter()
            .enumerate()
            .filter_map(|(k, l)| Some((l.number, DirectionalEmission::new(*l, around, of_light(k))?)))
            .collect()
    }

    fn new(light: Light, around: (Vec3, f32), mut found: Vec<LitVertex>) -> Option<DirectionalEmission> {
        found.retain(|f| f.point.is_finite() && f.brought.is_finite());
        if found.len() < FEWEST_LINES {
            return None;
        }
        let mean = found.iter().map(|f| f.brought).sum::<f32>() / found.len() as f32;
        found.iter_mut().for_each(|f| f.brought = f.brought.min(MOST_OF_A_LINE * mean));
        let all: f32 = found.iter().map(|f| f.brought).sum();
        let origin = found.iter().map(|f| f.point * (f.brought / all)).sum::<Vec3>();
        let mut lines: Vec<Line> = found.iter().map(|f| (light.place(origin, f.point, f.direction), f.brought)).collect();
        let [x, y] = [0, 1].map(|axis| bounds(&mut lines, axis));
        let (least, greatest) = (Vec2::new(x[0], y[0]), Vec2::new(x[1], y[1]));
        lines.retain(|l| l.0.cmpge(least).all() && l.0.cmple(greatest).all());
        // What single precision tells apart far from the middle of the world.
        let finest = Vec2::splat(1e-6 * (around.0.length() + around.1));
        let mut cells = MOST_CELLS;
        loop {
            // A cell more on each side: lines spread into the neighbours of theirs.
            let cell = ((greatest - least) / (cells - 2) as f32).max(finest);
            let low = least - cell;
            let of = |x: f32| (x as usize).clamp(1, cells - 2);
            let (mut weights, mut filled) = (vec![0.0f32; cells * cells], vec![false; cells * cells]);
            for (place, brought) in &lines {
                let at = (place - low) / cell;
                let (column, row) = (of(at.x), of(at.y));
                filled[row * cells + column] = true;
                for (i, fraction) in SPREAD.iter().enumerate() {
                    weights[(row + i / 3 - 1) * cells + column + i % 3 - 1] += fraction * brought;
                }
            }
            let filled = filled.iter().filter(|f| **f).count();
            if cells > FEWEST_CELLS && lines.len() < LINES_A_CELL * filled {
                cells /= 2;
                continue;
            }
            let (lit_m2, size) = (filled as f32 * cell.x * cell.y, cell * cells as f32);
            return Some(DirectionalEmission { light, around, origin, low, size, grid: Grid2::new(&weights, cells), lit_m2 });
        }
    }

    /// The start of a line outside everything, its direction, and its density over the area that faces it, 1/m².
    pub fn sample(&self, place: [f32; 2], direction: [f32; 2]) -> (Vec3, Vec3, f32) {
        let direction = self.light.direction(direction);
        let (at, pdf) = self.grid.sample(place);
        let at = self.low + at * self.size;
        let (x, y) = sampling::frame(self.light.axis);
        let point = self.origin + x * at.x + y * at.y;
        let (middle, radius) = self.around;
        let back = (point - middle).dot(direction).max(-radius) + 1.01 * radius;
        (point - direction * back, direction, self.over_facing(pdf, direction))
    }

    /// Density of the line through a point in a direction over the area that faces it, 1/m².
    pub fn density(&self, point: Vec3, direction: Vec3) -> f32 {
        let at = (self.light.place(self.origin, point, direction) - self.low) / self.size;
        let inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(Vec2::ONE).all();
        if inside { self.over_facing(self.grid.pdf(at), direction) } else { 0.0 }
    }

    fn over_facing(&self, pdf: f32, direction: Vec3) -> f32 {
        pdf / (self.size.x * self.size.y * direction.dot(self.light.axis))
    }

    /// Density of the directions, 1/sr; 1 where there is only one.
    pub fn direction_density(&self) -> f32 {
        self.light.half_angle.map_or(1.0, disc_density)
    }

    /// Whether light comes from one direction alone, so that no ray can meet it.
    pub fn is_delta(&self) -> bool {
        self.light.half_angle.is_none()
    }

    /// Radiance over irradiance on a plane that faces the light; 1 where it has no extent.
    pub fn over_irradiance(&self) -> f32 {
        self.light.half_angle.map_or(1.0, |a| 1.0 / disc_sr(a))
    }
}

/// How a line is spread over its cell and those around it.
const SPREAD: [f32; 9] = [0.0625, 0.0625, 0.0625, 0.0625, 0.5, 0.0625, 0.0625, 0.0625, 0.0625];

/// Between which coordinates most of the light of the lines is.
fn bounds(lines: &mut [Line], axis: usize) -> [f32; 2] {
    lines.sort_by(|a, b| a.0[axis].total_cmp(&b.0[axis]));
    let beyond = LEFT_OUT * lines.iter().map(|l| l.1).sum::<f32>();
    [first_beyond(lines.iter(), beyond, axis), first_beyond(lines.iter().rev(), beyond, axis)]
}

/// The coordinate up to which there is more light than that.
fn first_beyond<'a>(mut lines: impl Iterator<Item = &'a Line>, beyond: f32, axis: usize) -> f32 {
    let mut sum = 0.0;
    let found = lines.find(|l| {
        sum += l.1;
        sum > beyond
    });
    found.map_or(0.0, |l| l.0[axis])
}

/// Follows a camera path, and adds each vertex behind the first scattering where one of the lights, chosen by chance, arrives.
fn follow(
    scene: &Scene,
    lights: &[Light],
    mut ray: Ray,
    wavelengths: &SampledWavelengths,
    sampler: &Sampler,
    max_depth: u32,
    found: &mut Vec<LitVertex>,
) {
    let (mut throughput, mut hero_only) = (SampledSpectrum::ONE, wavelengths.is_rgb());
    let mut medium_stack = MediumStack::default();
    let (mut events, mut is_scattered) = (0, false);
    for _ in 0..MOST_SEGMENTS {
        let Some(surface) = scene.intersect(&ray, f32::INFINITY) else { return };
        // Light paths end at media.
        if events >= max_depth || medium_stack.span(scene, &ray, surface.t).is_some() {
            return;
        }
        let material = scene.material(surface.object);
        let entering = surface.ng.dot(ray.direction) < 0.0;
        if medium_stack.hides(scene, surface.object, entering) || matches!(material.scattering, Scattering::Interface) {
            medium_stack.cross(scene, surface.object, entering);
            ray.origin = origin_behind(&surface, ray.direction);
            continue;
        }
        let around = medium_stack.around(scene, surface.object);
        let Some(bsdf) = material.bsdf(&surface, -ray.direction, wavelengths, hero_only, around) else { return };
        let ng = bsdf.side_normal();
        if is_scattered && !bsdf.is_specular() && can_connect(&surface, material, around) {
            let [a, b, c, _] = sampler.get(Dimensions::Light(events));
            let light = ((c * lights.len() as f32) as usize).min(lights.len() - 1);
            let Light { number, illuminance, .. } = lights[light];
            let direction = lights[light].direction([a, b]);
            let (f, _) = bsdf.eval(-direction);
            let is_through = direction.dot(ng) > 0.0;
            let origin = surface.leave(if is_through { -ng } else { ng }, -direction);
            let mut beyond = medium_stack;
            if is_through {
                beyond.cross(scene, surface.object, entering);
            }
            let sample = LightSample {
                wi: -direction,
                distance: f32::INFINITY,
                pdf: 1.0,
                has_extent: false,
                spot: LightPoint::Punctual(number),
                clearance: 0.0,
            };
            let stream = || sampler.stream(Dimensions::Transmittance(events));
            let (point, time_s, most) = (surface.point, ray.time_s, max_depth - events - 1);
            let arrives =
                scene.transmittance_to_light(throughput * f, point, origin, &sample, beyond, wavelengths, time_s, most, stream);
            let brought = arrives.element_sum() * illuminance;
            if brought > 0.0 {
                found.push(LitVertex { light, point, direction, brought });
            }
        }
        let u = sampler.get(Dimensions::Scatter(events));
        let Some(scatter) = bsdf.sample(u) else { return };
        throughput *= scatter.weight;
        if scatter.disperses && !hero_only {
            throughput *= wavelengths.hero_only();
            hero_only = true;
        }
        is_scattered |= !scatter.specular;
        events += 1;
        if events >= ROULETTE_DEPTH {
            let survival = throughput.max_element().clamp(0.0, MOST_SURVIVAL);
            if !survives(&mut throughput, survival, u[3]) {
                return;
            }
        }
        if scatter.transmitted {
            medium_stack.cross(scene, surface.object, entering);
        }
        let normal = if scatter.transmitted { -ng } else { ng };
        ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s: ray.time_s };
    }
}

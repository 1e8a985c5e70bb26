//! Where light paths of the sun, and of other light that comes from infinitely far, begin.
//!
//! Little of the cross-section of a scene lets the sun into a room. Some thousand camera paths are followed before the exposure; where a vertex of one behind its
//! first scattering is lit by such a light, a line is found on which light matters to the picture. Light paths begin on lines drawn from the cells of a grid over the found ones, in
//! proportion to the light that those brought (importance from the camera: Peter & Pietrek 1998, "Importance Driven Construction of Photon Maps"). Where no line was
//! found no light path begins, and camera paths have the light to themselves: the weights of [`super::vertices`] know the density of every line, so there is
//! no bias.

use super::vertices::can_connect;
use crate::light::punctual::{disc_density, disc_sr, within_disc};
use crate::light::{LightSample, PunctualKind, Spot};
use crate::material::Scattering;
use crate::medium_stack::MediumStack;
use crate::radiance::past;
use crate::scene::Scene;
use diopter_light::random::{Sampler, SamplerKind, Set};
use diopter_light::sampling::{self, Grid2};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Camera rays by number, with wavelengths, spread over the picture; `None` where no light comes through the lens.
pub type CameraRays<'a> = dyn Fn(u32) -> Option<(Ray, Wavelengths)> + Sync + 'a;

/// Camera paths that a thread follows at a time, times of that in a round, and most rounds: the first is enough where windows are large.
const CHUNK: u32 = 256;
const CHUNKS: u32 = 32;
const ROUNDS: u32 = 8;
/// Segments after which a path is left.
const MOST_SEGMENTS: u32 = 64;
/// Scattering events before Russian roulette starts.
const ROULETTE_DEPTH: u32 = 3;
/// Fewer lines than this say too little; after so many as are enough none are looked for.
const FEWEST_LINES: usize = 32;
const ENOUGH_LINES: usize = 512;
/// Most cells of the grid a side, and fewest; lines that a cell with any must hold on average.
const MOST_CELLS: usize = 128;
const FEWEST_CELLS: usize = 4;
const LINES_A_CELL: usize = 4;
/// Fraction of the light that is left out at each end of both axes, so that what is lit far out does not make cells large.
const LEFT_OUT: f32 = 0.005;
/// A line counts for no more than so many times the mean: a single one must not draw all light paths.
const MOST_OF_A_LINE: f32 = 8.0;
/// Half angle (rad) up to which a disc is taken for parallel light: lines of all its directions share one grid. The sun's is 0.0047.
const SMALL_DISC: f32 = 0.17;

/// Lines of a light at infinity on which light paths begin.
pub(super) struct Parallel {
    rays: Rays,
    /// Corner of the grid on the plane, and its size, m.
    low: Vec2,
    size: Vec2,
    grid: Grid2,
    /// Area of the cells in which there are lines, m².
    pub lit_m2: f32,
}

/// The directions of a light, and the plane across them.
#[derive(Clone, Copy)]
struct Rays {
    /// Unit direction in which the light of its middle goes.
    axis: Vec3,
    half_angle: Option<f32>,
    /// A sphere around everything, m.
    middle: Vec3,
    radius: f32,
}

impl Rays {
    /// `None` of lights that are near, or too wide.
    fn of(kind: PunctualKind, (middle, radius): (Vec3, f32)) -> Option<Rays> {
        match kind {
            PunctualKind::Directional { direction } => Some(Rays { axis: direction, half_angle: None, middle, radius }),
            PunctualKind::Disc { direction, half_angle } if half_angle <= SMALL_DISC => {
                Some(Rays { axis: direction, half_angle: Some(half_angle), middle, radius })
            }
            _ => None,
        }
    }

    /// A direction, evenly over the solid angle.
    fn direction(&self, u: [f32; 2]) -> Vec3 {
        self.half_angle.map_or(self.axis, |half_angle| within_disc(self.axis, half_angle, u))
    }

    /// Density of the directions, 1/sr; 1 where there is only one.
    fn direction_density(&self) -> f32 {
        self.half_angle.map_or(1.0, disc_density)
    }

    /// Where a line through a point crosses the plane, m.
    fn place(&self, point: Vec3, direction: Vec3) -> Vec2 {
        let to = point - self.middle;
        let at = to - direction * (to.dot(self.axis) / direction.dot(self.axis));
        let (x, y) = sampling::frame(self.axis);
        Vec2::new(at.dot(x), at.dot(y))
    }
}

/// A line that was found: its place on the plane, and what it brought.
type Line = (Vec2, f32);

impl Parallel {
    /// Learns lines of lights, `kinds` by their numbers in the scene, from the camera. One for each light of which enough were found.
    pub fn learn(scene: &Scene, around: (Vec3, f32), seed: u64, max_depth: u32, camera: &CameraRays) -> Vec<(u32, Parallel)> {
        let lights: Vec<(u32, Rays, f32)> = (0u32..)
            .zip(&scene.lights().punctual)
            .filter_map(|(i, l)| Some((i, Rays::of(l.kind, around)?, l.illuminance())))
            .filter(|l| l.2 > 0.0)
            .collect();
        if lights.is_empty() {
            return Vec::new();
        }
        let mut chunks: Vec<Vec<Vec<Line>>> = Vec::new();
        for round in 0..ROUNDS {
            let from_camera = (round * CHUNKS..(round + 1) * CHUNKS).into_par_iter().map(|chunk| {
                let mut lines = vec![Vec::new(); lights.len()];
                for path in chunk * CHUNK..(chunk + 1) * CHUNK {
                    let Some((ray, wavelengths)) = camera(path) else { continue };
                    let sampler = Sampler::new(SamplerKind::Independent, seed, (path, 2), 0, 1);
                    follow(scene, &lights, ray, &wavelengths, &sampler, max_depth, &mut lines);
                }
                lines
            });
            chunks.par_extend(from_camera);
            let found: Vec<usize> = (0..lights.len()).map(|k| chunks.iter().map(|c| c[k].len()).sum()).collect();
            if found.iter().all(|n| *n < FEWEST_LINES >> (ROUNDS - 1).ilog2() || *n >= ENOUGH_LINES) {
                break;
            }
        }
        let of_light = |k: usize| chunks.iter().flat_map(|c| c[k].iter().copied()).collect::<Vec<Line>>();
        lights.iter().enumerate().filter_map(|(k, l)| Some((l.0, Parallel::new(l.1, of_light(k))?))).collect()
    }

    fn new(rays: Rays, mut lines: Vec<Line>) -> Option<Parallel> {
        lines.retain(|l| l.0.is_finite() && l.1.is_finite() && l.1 > 0.0);
        if lines.len() < FEWEST_LINES {
            return None;
        }
        let most = MOST_OF_A_LINE * lines.iter().map(|l| l.1).sum::<f32>() / lines.len() as f32;
        lines.iter_mut().for_each(|l| l.1 = l.1.min(most));
        let (from, to) = (bounds(&mut lines, 0), bounds(&mut lines, 1));
        let (least, greatest) = (Vec2::new(from[0], to[0]), Vec2::new(from[1], to[1]));
        lines.retain(|l| l.0.cmpge(least).all() && l.0.cmple(greatest).all());
        let mut cells = MOST_CELLS;
        loop {
            // A cell more on each side: lines spread into the neighbours of theirs.
            let cell = (greatest - least).max(Vec2::splat(1e-6 * rays.radius)) / (cells - 2) as f32;
            let low = least - cell;
            let of = |x: f32| (x as usize).clamp(1, cells - 2);
            let (mut weights, mut filled) = (vec![0.0f32; cells * cells], vec![false; cells * cells]);
            for (place, light) in &lines {
                let at = (place - low) / cell;
                let (column, row) = (of(at.x), of(at.y));
                filled[row * cells + column] = true;
                for (i, share) in SPREAD.iter().enumerate() {
                    weights[(row + i / 3 - 1) * cells + column + i % 3 - 1] += share * light;
                }
            }
            let filled = filled.iter().filter(|f| **f).count();
            if cells > FEWEST_CELLS && lines.len() < LINES_A_CELL * filled {
                cells /= 2;
                continue;
            }
            let lit_m2 = filled as f32 * cell.x * cell.y;
            return Some(Parallel { rays, low, size: cell * cells as f32, grid: Grid2::new(&weights, cells), lit_m2 });
        }
    }

    /// The start of a line outside everything, its direction, and its density over the area that faces it, 1/m².
    pub fn sample(&self, place: [f32; 2], direction: [f32; 2]) -> (Vec3, Vec3, f32) {
        let Rays { axis, middle, radius, .. } = self.rays;
        let direction = self.rays.direction(direction);
        let (at, pdf) = self.grid.sample(place);
        let at = self.low + at * self.size;
        let (x, y) = sampling::frame(axis);
        let point = middle + x * at.x + y * at.y;
        // The grid can reach beyond the sphere by a cell.
        let back = 2.0 * radius + at.length();
        (point - direction * back, direction, self.over_facing(pdf, direction))
    }

    /// Density of the line through a point in a direction over the area that faces it, 1/m².
    pub fn density(&self, point: Vec3, direction: Vec3) -> f32 {
        let at = (self.rays.place(point, direction) - self.low) / self.size;
        let inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(Vec2::ONE).all();
        if inside { self.over_facing(self.grid.pdf(at), direction) } else { 0.0 }
    }

    fn over_facing(&self, pdf: f32, direction: Vec3) -> f32 {
        pdf / (self.size.x * self.size.y * direction.dot(self.rays.axis))
    }

    /// Density of the directions, 1/sr; 1 where there is only one.
    pub fn direction_density(&self) -> f32 {
        self.rays.direction_density()
    }

    /// Whether light comes from one direction alone, so that no ray can meet it.
    pub fn is_delta(&self) -> bool {
        self.rays.half_angle.is_none()
    }

    /// Radiance over irradiance on a plane that faces the light; 1 where it has no extent.
    pub fn over_irradiance(&self) -> f32 {
        self.rays.half_angle.map_or(1.0, |a| 1.0 / disc_sr(a))
    }
}

/// How a line is spread over its cell and those around it.
const SPREAD: [f32; 9] = [0.0625, 0.0625, 0.0625, 0.0625, 0.5, 0.0625, 0.0625, 0.0625, 0.0625];

/// Between which coordinates most of the light of the lines is.
fn bounds(lines: &mut [Line], axis: usize) -> [f32; 2] {
    lines.sort_by(|a, b| a.0[axis].total_cmp(&b.0[axis]));
    let all: f32 = lines.iter().map(|l| l.1).sum();
    let beyond = |sum: &mut f32, l: &Line| {
        *sum += l.1;
        Some((*sum > LEFT_OUT * all).then_some(l.0[axis]))
    };
    let first = |mut found: Box<dyn Iterator<Item = Option<f32>> + '_>| found.find_map(|x| x).unwrap_or(0.0);
    [first(Box::new(lines.iter().scan(0.0, beyond))), first(Box::new(lines.iter().rev().scan(0.0, beyond)))]
}

/// Follows a camera path, and adds a line of a light wherever one arrives behind the first scattering.
fn follow(
    scene: &Scene,
    lights: &[(u32, Rays, f32)],
    mut ray: Ray,
    wavelengths: &Wavelengths,
    sampler: &Sampler,
    max_depth: u32,
    lines: &mut [Vec<Line>],
) {
    let (mut throughput, mut hero_only) = (Sampled::ONE, wavelengths.is_rgb());
    let mut medium_stack = MediumStack::new(scene.air());
    let (mut events, mut is_scattered) = (0, false);
    for _ in 0..MOST_SEGMENTS {
        let Some(surface) = scene.intersect(&ray, f32::INFINITY) else { return };
        // Light paths end at media.
        if events >= max_depth || medium_stack.span(&ray, surface.t).is_some() {
            return;
        }
        let material = scene.material(surface.object);
        let entering = surface.ng.dot(ray.direction) < 0.0;
        if medium_stack.hides(material, entering) || matches!(material.scattering, Scattering::Interface) {
            medium_stack.cross(material, entering);
            ray.origin = past(&surface, ray.direction);
            continue;
        }
        let around = medium_stack.around(material);
        let Some(bsdf) = material.bsdf(&surface, -ray.direction, wavelengths, hero_only, around) else { return };
        let ng = bsdf.side_normal();
        if is_scattered && !bsdf.is_specular() && can_connect(&surface, material, around) {
            let [a, b, ..] = sampler.get(Set::Light(events));
            for ((number, rays, illuminance), lines) in lights.iter().zip(&mut *lines) {
                let direction = rays.direction([a, b]);
                let (f, _) = bsdf.eval(-direction);
                let through = direction.dot(ng) > 0.0;
                let origin = surface.leave(if through { -ng } else { ng }, -direction);
                let mut beyond = medium_stack;
                if through {
                    beyond.cross(material, entering);
                }
                let sample = LightSample {
                    wi: -direction,
                    distance: f32::INFINITY,
                    pdf: 1.0,
                    has_extent: false,
                    spot: Spot::Punctual(*number),
                    clearance: 0.0,
                };
                let stream = || sampler.stream(Set::Transmittance(events));
                let (light, point, most) = (throughput * f, surface.point, max_depth - events - 1);
                let light = scene
                    .transmittance_to_light(light, point, origin, &sample, beyond, wavelengths, ray.time_s, most, stream)
                    .element_sum();
                if light > 0.0 {
                    lines.push((rays.place(point, direction), light * illuminance));
                }
            }
        }
        let u = sampler.get(Set::Scatter(events));
        let Some(scatter) = bsdf.sample(u) else { return };
        throughput *= scatter.weight;
        if scatter.disperses && !hero_only {
            throughput *= wavelengths.hero_only();
            hero_only = true;
        }
        is_scattered |= !scatter.specular;
        events += 1;
        if events >= ROULETTE_DEPTH {
            let survival = throughput.max_element().clamp(0.0, 0.95);
            if !(u[3] < survival) {
                return;
            }
            throughput /= survival;
        }
        if scatter.transmitted {
            medium_stack.cross(material, entering);
        }
        let normal = if scatter.transmitted { -ng } else { ng };
        ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s: ray.time_s };
    }
}

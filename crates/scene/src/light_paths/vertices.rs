//! Light vertices: places where paths from lamps meet surfaces, kept so that camera paths can connect to them.
//!
//! Light goes from lamps outwards here. A light path begins at a lamp in proportion to what it sends out, goes on as scattering functions say, and
//! leaves a vertex at each surface that does not only mirror; all of them are one pool (a *light vertex cache*), in which every camera vertex
//! chooses some ([`super::connect`]). Source: Davidovič, Křivánek, Hašan & Slusallek 2014, "Progressive Light Transport Simulation on the GPU: Survey and
//! Improvements", §4 (LVC-BPT).
//!
//! # Weights
//!
//! Vertices of a path are numbered from the lamp, v₀, to the first that the camera sees, vₙ. Strategy `s` makes the first `s` from the lamp: 0 is a chance
//! hit, 1 next-event estimation, 2 and more connections of v₍ₛ₋₁₎ with vₛ (no path is connected with the lens: s ≤ n). Their densities, all per
//! area of the vertices (per solid angle at infinity), are P₀ = Π cᵢ, P₁ = e Π₁ cᵢ, Pₛ = κ l₀ … l₍ₛ₋₁₎ Πₛ cᵢ, with cᵢ and lᵢ those of vᵢ on the way from the camera and from the
//! lamp, `e` that of a light sample from v₁, and κ the vertices that are chosen over those that a light path leaves. The power heuristic (β = 2) needs
//! ratios of neighbouring strategies only, which both sides carry along their paths (Georgiev, Křivánek, Davidovič & Slusallek 2012, "Light Transport
//! Simulation with Vertex Connection and Merging", technical report "Implementing Vertex Connection and Merging").
//!
//! A connection needs two vertices that are no mirrors and a straight line on which nothing is: no medium, no face of one, no thin dielectric (light from infinity
//! comes to v₁ through smooth ones: they are no vertices). Light paths end at the same things, at strands, mixtures and dispersing bodies, and where the *first* surface mirrors or refracts: that light is the
//! photons' or chance's. What cannot be connected so has only the strategies that it had before, on whatever side it lies.
//!
//! # Wavelengths
//!
//! Colours ([`diopter_light::SampledWavelengths::rgb`]) are the same for all paths. Of spectra a light path is computed again at the wavelengths of each camera
//! path that connects to it ([`LightVertices::state_at`]): the same places, with scattering functions, densities and light of
//! those wavelengths, over the densities by which the path was drawn. So there is no bias, and no wavelengths are joined.

mod weights;

pub(super) use self::weights::{Weights, squared};

use self::weights::{State, next_state};
use super::ConnectionSettings;
use super::can_connect::can_connect;
use super::directional::{CameraRays, DirectionalEmission};
use crate::light::{LightRef, Modulation, PunctualKind};
use crate::material::{Material, Principled, Scattering};
use crate::medium_stack::MediumStack;
use crate::radiance::origin_behind;
use crate::scene::Scene;
use crate::shape::{Surface, offset_origin};
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::sampling::{self, Discrete};
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Light paths that are traced to learn how many vertices one leaves.
const PILOT: u32 = 1 << 12;
/// Number of the pool that they make: beyond all others.
const PILOT_POOL: u32 = u32::MAX;
/// And of that of a trial.
const TRIAL_POOL: u32 = u32::MAX - 1;
/// Fewer vertices are no help.
const FEWEST: usize = 64;
/// Light paths that a thread traces at a time.
const CHUNK: u32 = 1024;
/// Least probability of a lamp, relative to the mean.
const LEAST_CHANCE: f32 = 1e-2;
/// Least probability with which a light path goes on: it may be used at other wavelengths than those it was traced at.
const LEAST_SURVIVAL: f32 = 0.1;
/// Least cosine that light is divided by.
pub(super) const LEAST_COSINE: f32 = 1e-4;
/// Vertices of the pool that a camera vertex looks at, of which it connects to one.
pub(super) const CANDIDATES: u32 = 8;

/// A lamp that light paths begin at.
struct Lamp {
    light: LightRef,
    /// Its luminance, luminous intensity or illuminance.
    photometric: f32,
    modulation: Modulation,
    medium_stack: MediumStack,
}

/// The lamps of a scene, ready for light paths: makes pools of vertices.
pub struct Connections<'a> {
    pub(super) scene: &'a Scene,
    settings: ConnectionSettings,
    wavelengths: WavelengthSampler,
    /// Area lights by their numbers, then points and spots, then lights at infinity.
    lamps: Vec<Lamp>,
    choice: Discrete,
    /// Place of each punctual light among the lamps.
    punctual: Vec<Option<u32>>,
    /// By the numbers of the punctual lights: where light paths begin, of those at infinity.
    directional: Vec<Option<DirectionalEmission>>,
    /// κ: candidates of a camera vertex over vertices of a light path.
    kappa: f64,
}

/// Where and how a light path leaves its lamp.
#[derive(Clone, Copy)]
struct LightLeSample {
    lamp: u32,
    point: Vec3,
    /// Of the lamp's surface; 0 of a point and at infinity.
    normal: Vec3,
    place: Vec2,
    direction: Vec3,
    /// Cosine over the density of place and direction and the probability of the lamp (at infinity times radiance over irradiance).
    scale: f32,
    /// l₀: of a lamp at infinity the density of its direction.
    l0: f64,
    /// Density of the direction, 1/sr; of a lamp at infinity that of the line over the area that faces it, 1/m².
    p_line: f32,
    /// Thin dielectrics on the way to the first vertex, of a lamp at infinity.
    thin_dielectrics: u32,
}

/// The way of a light path from infinity to the first surface that is no smooth thin dielectric.
struct EntrySegment {
    ray: Ray,
    medium_stack: MediumStack,
    /// Transmittance of the thin dielectrics.
    passed: SampledSpectrum,
    count: u32,
}

/// A scattering event of a light path.
struct Event<'a> {
    surface: Surface,
    material: &'a Material,
    around: Option<&'a Principled>,
    /// Unit direction towards the vertex before.
    to_prev: Vec3,
    /// Squared distance to it, m².
    d2: f32,
    /// Unit direction in which the path goes on.
    to_next: Vec3,
    /// 1 over the density by which that was drawn and the probability of going on; 1 over the latter alone if specular.
    over_density: f32,
    /// The numbers that it was drawn by.
    u: [f32; 4],
    is_specular: bool,
}

/// What camera vertices look at of a vertex of the pool before they choose one: a cache line, for they look at vertices all over the pool.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Candidate {
    /// Of its state, at the wavelengths of its own path.
    pub weights: Weights,
    pub point: Vec3,
    /// Geometric normal on the side where the light arrives.
    pub ng: Vec3,
    /// Cosine under which the light arrives.
    pub cos_incident: f32,
    /// Mean of the flux.
    pub flux: f32,
    /// Albedo / π where all that it does is to reflect diffusely, else negative.
    pub diffuse: f32,
    /// Scattering events from the lamp, this one included.
    pub events: u32,
}

/// A vertex of the pool: the rest.
pub(super) struct LightVertex {
    pub to_prev: Vec3,
    /// At the wavelengths of its own path.
    state: State,
    path: u32,
    event: u32,
}

/// A pool of light vertices: for samples of one replicate of a pass.
pub struct LightVertices<'a> {
    pub(super) connections: &'a Connections<'a>,
    starts: Vec<(LightLeSample, u32)>,
    events: Vec<Event<'a>>,
    pub(super) candidates: Vec<Candidate>,
    /// In the order of the candidates.
    vertices: Vec<LightVertex>,
    /// Light paths.
    pub(super) paths: u32,
}

/// What some light paths leave.
#[derive(Default)]
struct Traced<'a> {
    starts: Vec<(LightLeSample, u32)>,
    events: Vec<Event<'a>>,
    candidates: Vec<Candidate>,
    vertices: Vec<LightVertex>,
}

impl<'a> Connections<'a> {
    /// Gets light paths ready in a scene, which must be posed for the exposure; `camera` tells where parallel light matters, such as the sun's. `None` where
    /// nothing can be connected: when things move or flashes burn (light vertices belong to no moment), without lamps that light paths begin at, or where light
    /// paths hardly leave a vertex.
    pub fn new(scene: &'a Scene, settings: ConnectionSettings, camera: &CameraRays) -> Option<Connections<'a>> {
        if scene.moves() || scene.has_flashes() {
            return None;
        }
        let (lights, materials) = (scene.lights(), &scene.description().materials);
        let bounds = scene.bounds();
        let around = (bounds.center(), 0.5 * bounds.size().length() * 1.001);
        if !around.0.is_finite() || !around.1.is_finite() {
            return None;
        }
        let (mut lamps, mut chances) = (Vec::new(), Vec::new());
        for (i, light) in lights.area.iter().enumerate() {
            chances.push(light.luminance * light.area() * PI * if light.two_sided { 2.0 } else { 1.0 });
            let (surface, normal) = match light.normal() {
                Some(normal) => (light.center(), normal),
                None => (light.sample_surface([0.0, 0.0]).0, Vec3::Z),
            };
            let modulation = materials[light.material as usize].modulation();
            let medium_stack = MediumStack::at(scene, surface, normal, around);
            lamps.push(Lamp { light: LightRef::Area(i as u32), photometric: light.luminance, modulation, medium_stack });
        }
        let mut punctual = vec![None; lights.punctual.len()];
        for (i, light) in lights.punctual.iter().enumerate() {
            let (position, solid_angle) = match light.kind {
                PunctualKind::Point { position } => (position, 4.0 * PI),
                PunctualKind::Spot { position, cos_outer, .. } => (position, TAU * (1.0 - cos_outer)),
                PunctualKind::Directional { .. } | PunctualKind::Disc { .. } => continue,
            };
            punctual[i] = Some(lamps.len() as u32);
            let photometric = light.illuminance();
            chances.push(photometric * solid_angle * light.pattern.as_ref().map_or(1.0, |p| p.mean()));
            let medium_stack = MediumStack::at(scene, position, Vec3::Y, around);
            lamps.push(Lamp { light: LightRef::Punctual(i as u32), photometric, modulation: light.modulation, medium_stack });
        }
        let mut directional: Vec<Option<DirectionalEmission>> = lights.punctual.iter().map(|_| None).collect();
        for (i, found) in DirectionalEmission::learn(scene, around, &settings, camera) {
            let light = &lights.punctual[i as usize];
            punctual[i as usize] = Some(lamps.len() as u32);
            let photometric = light.illuminance();
            chances.push(photometric * found.lit_m2);
            let medium_stack = MediumStack::default();
            lamps.push(Lamp { light: LightRef::Punctual(i), photometric, modulation: light.modulation, medium_stack });
            directional[i as usize] = Some(found);
        }
        if lamps.is_empty() {
            return None;
        }
        chances.iter_mut().for_each(|c| *c = if c.is_finite() { c.max(0.0) } else { 0.0 });
        let least = LEAST_CHANCE * chances.iter().sum::<f32>() / chances.len() as f32;
        chances.iter_mut().for_each(|c| *c = c.max(least));
        let wavelengths = if settings.rgb { WavelengthSampler::rgb() } else { WavelengthSampler::uniform() };
        let choice = Discrete::new(&chances);
        let mut connections = Connections { scene, settings, wavelengths, lamps, choice, punctual, directional, kappa: 1.0 };
        let found = connections.trace(PILOT_POOL, 0, PILOT).len();
        connections.kappa = f64::from(CANDIDATES) * f64::from(PILOT) / found as f64;
        (found >= FEWEST).then_some(connections)
    }

    /// The light vertices of a pass, for samples of a replicate (0 or 1, [`Sampler::replicate`]).
    pub fn pool(&'a self, number: u32, replicate: u32) -> LightVertices<'a> {
        self.trace(number, replicate, self.settings.paths.max(1))
    }

    /// A pool of some light paths only, to learn how much they bring.
    pub fn trial_pool(&'a self, paths: u32, replicate: u32) -> LightVertices<'a> {
        self.trace(TRIAL_POOL, replicate, paths.max(1))
    }

    fn trace(&self, pool: u32, replicate: u32, count: u32) -> LightVertices<'_> {
        // Numbers of their own beside those of pixels and photons.
        let seed = self.settings.seed ^ 0x3c6e_f372_fe94_f82b;
        let chunks: Vec<Traced> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut traced = Traced::default();
                for path in chunk * CHUNK..((chunk + 1) * CHUNK).min(count) {
                    let sampler = Sampler::new(SamplerKind::Sobol, seed, (pool, 1), 2 * path + (replicate & 1), 2 * count);
                    self.trace_path(&sampler, &mut traced);
                }
                traced
            })
            .collect();
        let mut all = LightVertices {
            connections: self,
            starts: Vec::new(),
            events: Vec::new(),
            candidates: Vec::new(),
            vertices: Vec::new(),
            paths: count,
        };
        for Traced { starts, events, candidates, vertices } in chunks {
            let (path, event) = (all.starts.len() as u32, all.events.len() as u32);
            all.starts.extend(starts.into_iter().map(|(start, first)| (start, first + event)));
            all.events.extend(events);
            all.candidates.extend(candidates);
            all.vertices.extend(vertices.into_iter().map(|v| LightVertex { path: v.path + path, event: v.event + event, ..v }));
        }
        all
    }

    /// The lamp of a light; `None` where no light path begins.
    #[inline]
    fn lamp_of(&self, light: LightRef) -> Option<u32> {
        match light {
            LightRef::Area(i) => Some(i),
            LightRef::Punctual(i) => self.punctual[i as usize],
            LightRef::Environment => None,
        }
    }

    /// κ l₀ of a light (1/m²; without unit of a point) times the density (1/sr) with which a light path leaves it in a direction under a cosine to its
    /// normal; of one at infinity times that of the line through a point, 1/m². 0 where no light path begins.
    pub(crate) fn emission_density(&self, light: LightRef, point: Vec3, direction: Vec3, cos: f32) -> f64 {
        let Some(lamp) = self.lamp_of(light) else { return 0.0 };
        let chance = f64::from(self.choice.probability(lamp as usize));
        let lights = self.scene.lights();
        self.kappa
            * match light {
                LightRef::Punctual(i) if let Some(directional) = &self.directional[i as usize] => {
                    chance * f64::from(directional.direction_density() * directional.density(point, direction))
                }
                LightRef::Area(i) => {
                    let light = &lights.area[i as usize];
                    let side = if light.two_sided { 0.5 } else { 1.0 };
                    chance / f64::from(light.area()) * f64::from(side * cos.abs() * FRAC_1_PI)
                }
                LightRef::Punctual(i) => chance * f64::from(point_density(lights.punctual[i as usize].kind, direction)),
                LightRef::Environment => 0.0,
            }
    }

    fn start(&self, sampler: &Sampler) -> Option<LightLeSample> {
        let lamp = self.choice.sample(sampler.get(Dimensions::Time)[1]).0 as u32;
        let [a, b, c, d] = sampler.get(Dimensions::Camera);
        let chance = self.choice.probability(lamp as usize);
        let lights = self.scene.lights();
        let (no_normal, no_place) = (Vec3::ZERO, Vec2::ZERO);
        // `factor`: the cosine at the lamp; radiance over irradiance at infinity.
        let (point, normal, place, direction, l0, p_line, factor) = match self.lamps[lamp as usize].light {
            LightRef::Area(i) => {
                let light = &lights.area[i as usize];
                let (point, normal, place) = light.sample_surface([a, b]);
                // Of two sides one half of the numbers each.
                let (side, c, fraction) = match light.two_sided {
                    false => (1.0, c, 1.0),
                    true if c < 0.5 => (1.0, 2.0 * c, 0.5),
                    true => (-1.0, 2.0 * c - 1.0, 0.5),
                };
                let local = sampling::cosine_hemisphere([c, d]);
                let (x, y) = sampling::frame(normal);
                let direction = (x * local.x + y * local.y + normal * (side * local.z)).normalize();
                let cos = normal.dot(direction).abs();
                (point, normal, place, direction, chance / light.area(), fraction * cos * FRAC_1_PI, cos)
            }
            LightRef::Punctual(i) if let Some(directional) = &self.directional[i as usize] => {
                let (point, direction, p_line) = directional.sample([c, d], [a, b]);
                let l0 = chance * directional.direction_density();
                (point, no_normal, no_place, direction, l0, p_line, directional.over_irradiance())
            }
            LightRef::Punctual(i) => {
                let kind = lights.punctual[i as usize].kind;
                let (point, direction) = match kind {
                    PunctualKind::Point { position } => (position, sampling::sphere([c, d])),
                    PunctualKind::Spot { position, direction, cos_outer, .. } => {
                        let drop = c * (1.0 - cos_outer);
                        let (sin, phi) = ((drop * (2.0 - drop)).max(0.0).sqrt(), TAU * d);
                        let (x, y) = sampling::frame(direction);
                        let way = x * (sin * phi.cos()) + y * (sin * phi.sin()) + direction * (1.0 - drop);
                        (position, way.normalize())
                    }
                    PunctualKind::Directional { .. } | PunctualKind::Disc { .. } => return None,
                };
                (point, no_normal, no_place, direction, chance, point_density(kind, direction), 1.0)
            }
            LightRef::Environment => return None,
        };
        let scale = factor / (l0 * p_line);
        let start =
            LightLeSample { lamp, point, normal, place, direction, scale, l0: f64::from(l0), p_line, thin_dielectrics: 0 };
        (factor > 1e-6 && p_line > 0.0).then_some(start)
    }

    /// What a light path begins with, without the lamp's modulation: radiance or intensity times [`LightLeSample::scale`].
    fn emitted(&self, start: &LightLeSample, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        let (lights, materials) = (self.scene.lights(), &self.scene.description().materials);
        start.scale
            * match self.lamps[start.lamp as usize].light {
                LightRef::Area(i) => lights.area[i as usize].radiance(start.place, materials, wavelengths),
                LightRef::Punctual(i) => {
                    let light = &lights.punctual[i as usize];
                    light.relative_intensity(None, start.direction, wavelengths) * light.power.sample_light(wavelengths)
                }
                LightRef::Environment => SampledSpectrum::ZERO,
            }
    }

    /// The same for tracing: of spectra with that of the lamp taken as even, so that no line of it decides about other wavelengths.
    fn emitted_for_tracing(&self, start: &LightLeSample, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        if wavelengths.is_rgb() {
            return self.emitted(start, wavelengths);
        }
        let (lights, materials) = (self.scene.lights(), &self.scene.description().materials);
        let lamp = &self.lamps[start.lamp as usize];
        start.scale
            * match lamp.light {
                LightRef::Area(i) => {
                    let light = &lights.area[i as usize];
                    let white = if light.carrier(materials).is_some() { lamp.photometric } else { 1.0 };
                    light.relative_radiance(start.place, materials, wavelengths) * white
                }
                LightRef::Punctual(i) => {
                    let light = &lights.punctual[i as usize];
                    light.relative_intensity(None, start.direction, wavelengths) * lamp.photometric
                }
                LightRef::Environment => SampledSpectrum::ZERO,
            }
    }

    /// Traces the light path that belongs to the numbers of a sampler.
    fn trace_path<'b>(&'b self, sampler: &Sampler, traced: &mut Traced<'b>) {
        let scene = self.scene;
        let wavelengths = self.wavelengths.sample(sampler.get(Dimensions::Time)[0]);
        let Some(mut start) = self.start(sampler) else { return };
        let mut medium_stack = self.lamps[start.lamp as usize].medium_stack;
        let side = start.normal.dot(start.direction).signum();
        let origin =
            if start.normal == Vec3::ZERO { start.point } else { offset_origin(start.point, start.normal * side, f32::INFINITY) };
        let mut ray = Ray { origin, direction: start.direction, time_s: 0.0 };
        let mut passed = SampledSpectrum::ONE;
        if self.is_parallel(start.lamp) {
            // Air that begins farther out than light paths do.
            let back = Ray { direction: -start.direction, ..ray };
            if medium_stack.span(scene, &back, f32::INFINITY).is_some() {
                return;
            }
            let Some(way) = self.through_thin_dielectrics(&start, &wavelengths, self.settings.max_depth) else { return };
            (ray, medium_stack, passed, start.thin_dielectrics) = (way.ray, way.medium_stack, way.passed, way.count);
        }
        let (path, first) = (traced.starts.len() as u32, traced.events.len());
        let mut before = start.point;
        let mut state: Option<State> = None;
        for depth in 0..self.settings.max_depth {
            let Some(surface) = scene.intersect(&ray, f32::INFINITY) else { break };
            let material = scene.material(surface.object);
            let entering = surface.ng.dot(ray.direction) < 0.0;
            let around = medium_stack.around(scene, surface.object);
            let ended =
                medium_stack.span(scene, &ray, surface.t).is_some() || medium_stack.hides(scene, surface.object, entering);
            if ended || !can_connect(&surface, material, around) {
                break;
            }
            let (to_prev, d2) = (-ray.direction, (surface.point - before).length_squared());
            let Some(bsdf) = material.bsdf(&surface, to_prev, &wavelengths, false, around) else { break };
            let u = sampler.get(Dimensions::Scatter(depth));
            let mut event =
                Event { surface, material, around, to_prev, d2, to_next: Vec3::ZERO, over_density: 0.0, u, is_specular: false };
            let here = match state {
                None => Some(self.first_state(&start, &event, passed * self.emitted_for_tracing(&start, &wavelengths))),
                Some(state) => traced.events.last().and_then(|last: &Event| next_state(state, last, &event, &wavelengths)),
            };
            let Some(here) = here.filter(|s| s.flux.is_finite() && s.flux.max_element() > 0.0 && s.weights.over_l2.is_finite())
            else {
                break;
            };
            if traced.events.len() == first {
                traced.starts.push((start, first as u32));
            }
            let event_number = traced.events.len() as u32;
            let ng = bsdf.side_normal();
            if !bsdf.is_specular() {
                let mean =
                    |s: SampledSpectrum| if wavelengths.is_rgb() { (s.x + s.y + s.z) / 3.0 } else { 0.25 * s.element_sum() };
                let diffuse = bsdf.diffuse_albedo().map(|albedo| mean(albedo) * FRAC_1_PI);
                traced.candidates.push(Candidate {
                    weights: here.weights,
                    point: surface.point,
                    ng,
                    cos_incident: ng.dot(to_prev).abs(),
                    flux: mean(here.flux),
                    diffuse: diffuse.unwrap_or(-1.0),
                    events: depth + 1 + start.thin_dielectrics,
                });
                traced.vertices.push(LightVertex { to_prev, state: here, path, event: event_number });
            }
            // Go on, by Russian roulette on what is scattered.
            let scatter = bsdf.sample(u).filter(|s| !s.disperses && (!s.specular || depth > 0));
            let is_straight = |s: &crate::material::Scatter| s.specular && s.transmitted && bsdf.straight_through().is_some();
            let Some(scatter) = scatter.filter(|s| !is_straight(s)) else {
                traced.events.push(event);
                break;
            };
            let survival = scatter.weight.max_element().clamp(LEAST_SURVIVAL, 1.0);
            event.to_next = scatter.wi;
            event.is_specular = scatter.specular;
            event.over_density = 1.0 / if scatter.specular { survival } else { survival * scatter.pdf };
            traced.events.push(event);
            if !(u[3] < survival) {
                break;
            }
            if scatter.transmitted {
                medium_stack.cross(scene, surface.object, entering);
            }
            let normal = if scatter.transmitted { -ng } else { ng };
            before = surface.point;
            ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s: 0.0 };
            state = Some(here);
        }
    }

    fn is_parallel(&self, lamp: u32) -> bool {
        matches!(self.lamps[lamp as usize].light, LightRef::Punctual(i) if self.directional[i as usize].is_some())
    }

    /// The way of a light path from infinity through thin dielectrics that do not scatter, `most` of them; `None` where it ends before a surface.
    fn through_thin_dielectrics(
        &self,
        start: &LightLeSample,
        wavelengths: &SampledWavelengths,
        most: u32,
    ) -> Option<EntrySegment> {
        let scene = self.scene;
        let mut ray = Ray { origin: start.point, direction: start.direction, time_s: 0.0 };
        // Layers on each other are told apart from near only. What lets light through by chance is asked once: the answer depends on where a ray begins.
        if let Some(t) = scene.nearest_that_may_be_met(&ray) {
            ray.origin = ray.at(0.999 * t);
        }
        let mut way = EntrySegment { ray, medium_stack: MediumStack::default(), passed: SampledSpectrum::ONE, count: 0 };
        while way.count < most {
            let surface = scene.intersect(&way.ray, f32::INFINITY)?;
            let material = scene.material(surface.object);
            if way.medium_stack.span(scene, &way.ray, surface.t).is_some() {
                return None;
            }
            let straight = match material.may_transmit_straight() && !matches!(material.scattering, Scattering::Interface) {
                true => {
                    let bsdf = material.bsdf(&surface, -start.direction, wavelengths, false, None)?;
                    bsdf.straight_through().filter(|_| bsdf.is_specular())
                }
                false => None,
            };
            let Some(through) = straight else { break };
            way.passed *= through;
            way.medium_stack.cross(scene, surface.object, surface.ng.dot(start.direction) < 0.0);
            way.ray.origin = origin_behind(&surface, start.direction);
            way.count += 1;
        }
        Some(way)
    }
}

/// Density with which a light path leaves a point or spot in a direction, 1/sr.
fn point_density(kind: PunctualKind, way: Vec3) -> f32 {
    match kind {
        PunctualKind::Point { .. } => 0.25 * FRAC_1_PI,
        PunctualKind::Spot { direction, cos_outer, .. } if direction.dot(way) >= cos_outer - 1e-6 => {
            1.0 / (TAU * (1.0 - cos_outer).max(1e-12))
        }
        _ => 0.0,
    }
}

impl<'a> LightVertices<'a> {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.candidates.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.candidates.is_empty()
    }

    /// Surface, material and outer dielectric of a vertex, and the unit direction towards the vertex before.
    pub(super) fn at(&self, number: usize) -> (&Surface, &'a Material, Option<&'a Principled>, Vec3) {
        let vertex = &self.vertices[number];
        let event = &self.events[vertex.event as usize];
        (&event.surface, event.material, event.around, vertex.to_prev)
    }

    /// What a light path brings to a vertex at the wavelengths of a camera path, at a moment.
    pub(super) fn state_at(&self, number: usize, wavelengths: &SampledWavelengths, time_s: f32) -> Option<State> {
        let (connections, vertex) = (self.connections, &self.vertices[number]);
        let (start, first) = &self.starts[vertex.path as usize];
        let modulation = connections.scene.modulated(&connections.lamps[start.lamp as usize].modulation, time_s);
        let mut state = match wavelengths.is_rgb() {
            true => vertex.state,
            false => {
                let events = &self.events[*first as usize..=vertex.event as usize];
                let mut emitted = connections.emitted(start, wavelengths);
                if start.thin_dielectrics > 0 {
                    emitted *= connections.through_thin_dielectrics(start, wavelengths, start.thin_dielectrics)?.passed;
                }
                let state = connections.first_state(start, &events[0], emitted);
                events.windows(2).try_fold(state, |state, pair| next_state(state, &pair[0], &pair[1], wavelengths))?
            }
        };
        state.flux *= modulation;
        Some(state)
    }
}

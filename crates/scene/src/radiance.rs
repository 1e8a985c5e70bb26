//! The path tracer: one ray in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. In media (`radiance/media.rs`) distances are drawn by extinction and as lamps see the ray, directions by the phase
//! function; media that differ from place to place are tracked (`medium/tracking.rs`). Light that is sampled comes through smooth thin dielectrics (panes, bubbles). Caustics
//! of small lights are left to chance without photons ([`crate::light_paths`]). Limits: a path begins outside all bodies.

mod cone;
mod incident;
mod joint;
mod media;
pub(crate) mod tally;

pub use cone::RayCone;
pub use incident::Incident;

use crate::light::{LightRef, LightSample, Shown};
use crate::light_paths::connect::{CameraState, CameraVertex, Picked};
use crate::light_paths::{LightPaths, LightVertices, PhotonMap, Tail};
use crate::material::{Material, Scattering};
use crate::medium::Medium;
use crate::medium_stack::MediumStack;
use crate::scene::Scene;
use crate::shape::Surface;
use cone::Cone;
use diopter_light::polarization::Stokes;
use diopter_light::random::{Sampler, SamplerKind, Set, Stream, mix};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::Vec3;
use joint::{Start, Vertex};
use media::{After, MediumSegment, ScatteredOn};
pub(crate) use tally::DIRECT_EVENTS;
use tally::{Apart, Polarized, Scattered, Sheets, Tally};

/// How far paths are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSettings {
    /// Most scattering events of a path; 0 shows only what shines by itself.
    pub max_depth: u32,
    /// Scattering events before Russian roulette starts; where vertices are connected with light paths, two at most.
    pub roulette_depth: u32,
}

impl Default for PathSettings {
    /// 64 events (glass needs many, and roulette ends the rest), roulette from the fifth
    /// (on the Cornell box 5 has the least variance × time among 3, 5 and never).
    fn default() -> Self {
        PathSettings { max_depth: 64, roulette_depth: 5 }
    }
}

/// What the first surface along a ray looks like to a computer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstSurface {
    /// Distance, m.
    pub distance: f32,
    /// Shading normal on the seen side.
    pub normal: Vec3,
    /// Linear sRGB.
    pub albedo: Vec3,
    /// Number of the object.
    pub object: u32,
}

impl Scene {
    /// The truth along a ray; `None` where it leaves the scene.
    pub fn first_surface(&self, ray: &Ray) -> Option<FirstSurface> {
        let s = self.first_visible(ray)?;
        let side = if s.ng.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let albedo = self.material(s.object).albedo(&s);
        Some(FirstSurface { distance: s.t, normal: s.ns * side, albedo, object: s.object })
    }

    /// The first surface along a ray that can be seen, faces of media left out; `t` counts from the ray's origin. `None` where it leaves the scene.
    pub fn first_visible(&self, ray: &Ray) -> Option<Surface> {
        let (mut s, mut start, mut gone) = (self.intersect(ray, f32::INFINITY)?, ray.origin, 0.0);
        // Faces of media are not seen.
        for _ in 0..MOST_FACES {
            if !self.is_interface(&s) {
                break;
            }
            gone += s.t;
            start = past(&s, ray.direction);
            s = self.intersect(&Ray { origin: start, ..*ray }, f32::INFINITY)?;
        }
        s.t = if start == ray.origin { s.t } else { gone + s.t };
        Some(s)
    }

    /// Spectral radiance that arrives at the ray's origin from its direction, W·m⁻²·sr⁻¹·nm⁻¹ at the four wavelengths; one
    /// random estimate, whose mean is the true value.
    pub fn radiance(&self, ray: Ray, wavelengths: &Wavelengths, sampler: &Sampler, settings: &PathSettings) -> Sampled {
        self.trace(Sampled::ZERO, LightPaths::default(), RayCone::thin(ray), wavelengths, sampler, settings, None, None)
    }

    /// The same with caustics by photons ([`crate::light_paths`]), which stand for what paths would find by chance there, and connections with light
    /// vertices, which share what paths find with them.
    pub fn radiance_with(
        &self,
        light_paths: LightPaths,
        ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> Sampled {
        self.trace(Sampled::ZERO, light_paths, RayCone::thin(ray), wavelengths, sampler, settings, None, None)
    }

    /// The same, where another strategy brings a part of the light of surfaces that shine and are seen directly ([`Shown`]), and pictures on surfaces are
    /// filtered over what the ray stands for: the mean is the true value where that is smaller than a pixel of the picture.
    pub fn radiance_shown(
        &self,
        light_paths: LightPaths,
        shown: Option<Shown>,
        cone: RayCone,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> Sampled {
        self.trace(Sampled::ZERO, light_paths, cone, wavelengths, sampler, settings, shown, None)
    }

    /// The Stokes vector of the same light at each of the four wavelengths ([`diopter_light::polarization`]), without light paths: `axis` is the x axis of
    /// its frame, perpendicular to the ray. Q, U and V are 0 on the mean where nothing polarises. I is, sample by sample, [`Scene::radiance_shown`] where
    /// no two events of the path polarise; elsewhere it is what polarised light gives, and that is another number.
    pub fn stokes(
        &self,
        cone: RayCone,
        axis: Vec3,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> [Stokes; 4] {
        let start = Polarized::seen_along(axis);
        self.trace(start, LightPaths::default(), cone, wavelengths, sampler, settings, None, None).stokes
    }

    /// The same numbers, and what of them is direct light: emitted towards the camera, or scattered once on its way, by surface or medium. What goes through
    /// a thin dielectric or off a mirror is scattered there. Direct light is, bit by bit (within rounding where volumes shine),
    /// what [`Scene::radiance_shown`] gives with a `max_depth` of 1.
    pub fn radiance_and_direct(
        &self,
        light_paths: LightPaths,
        shown: Option<Shown>,
        cone: RayCone,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> [Sampled; 2] {
        let start = Apart::default();
        let Apart { all, direct } = self.trace(start, light_paths, cone, wavelengths, sampler, settings, shown, None);
        [all, direct]
    }

    /// The same, and what of it came from the photons: by how much they matter in a picture.
    pub fn radiance_and_caustics(
        &self,
        photons: &PhotonMap,
        ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> [Sampled; 2] {
        let mut gathered = Sampled::ZERO;
        let light_paths = LightPaths { photons: Some(photons), vertices: None };
        let cone = RayCone::thin(ray);
        let all = self.trace(Sampled::ZERO, light_paths, cone, wavelengths, sampler, settings, None, Some(&mut gathered));
        [all, gathered]
    }

    /// Follows a path; `shown`: what it counts of what shines and is seen directly; `gathered` gets what of its light came from photons.
    #[allow(clippy::too_many_arguments)]
    fn trace<T: Tally>(
        &self,
        start: T,
        LightPaths { photons, vertices }: LightPaths,
        cone: RayCone,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
        mut shown: Option<Shown>,
        mut gathered: Option<&mut Sampled>,
    ) -> T {
        let mut radiance = start;
        let mut tail = Tail::default();
        let mut throughput = Sampled::ONE;
        // Lanes that carry colours never disperse.
        let mut hero_only = wavelengths.is_rgb();
        let mut medium_stack = MediumStack::new(self.air());
        let mut last: Option<PrevScatter> = None;
        let (mut camera_state, mut picked) = (CameraState::NONE, None);
        // Where `last` is a vertex in a medium: the segment on which it lies.
        let mut scattered_on: Option<ScatteredOn> = None;
        let (mut ray, mut cone) = (cone.ray, Cone::new(&cone));
        let (mut vertex, mut segment_index) = (0, 0);
        // Vertices within bodies, which do not count as scattering events.
        let mut walked = 0;
        // Product of the η² by which refraction scaled radiance; Russian roulette leaves it out (pbrt's `etaScale`).
        let mut eta_scale = 1.0;
        let (time_s, flash) = (ray.time_s, self.flash_burns(ray.time_s));
        let roulette_depth = vertices.map_or(settings.roulette_depth, |_| settings.roulette_depth.min(CONNECTED_ROULETTE_DEPTH));
        loop {
            let surface = self.intersect(&ray, f32::INFINITY);
            let reach = surface.as_ref().map_or(f32::INFINITY, |s| s.t);
            segment_index += 1;
            if let Some((medium, [near, far])) = medium_stack.span(&ray, reach) {
                let span = [near, far];
                // Light that comes over mirrors and through glass and is scattered on this segment.
                // Where the path was scattered before, one in some segments stands for all.
                let one_in = if last.is_some() { SEGMENTS_A_GATHERING } else { 1.0 };
                if let Some(photons) = photons
                    && medium.scatters_homogeneously()
                    && vertex - walked < settings.max_depth
                    && (one_in == 1.0 || sampler.get(Set::Medium(segment_index))[3] * one_in < 1.0)
                {
                    let most_events = settings.max_depth - (vertex - walked) - 1;
                    let light = throughput * photons.gather_along(&ray, span, medium, wavelengths, most_events) * one_in;
                    radiance.add(light, vertex - walked + 2);
                    if let Some(gathered) = &mut gathered {
                        **gathered += light;
                    }
                }
                let segment = MediumSegment {
                    scene: self,
                    medium,
                    span,
                    ray: &ray,
                    medium_stack: &medium_stack,
                    wavelengths,
                    sampler,
                    settings,
                    vertex,
                    depth: vertex - walked,
                    segment_index,
                    flash,
                    start: last.and_then(|l| l.start(medium)),
                };
                match segment.take(&mut throughput, eta_scale, &mut radiance) {
                    After::Through => camera_state.bar(),
                    After::Ended => return radiance,
                    After::Scattered { ray: onward, last: here, on } => {
                        (ray, last, scattered_on) = (onward, here, Some(on));
                        (shown, camera_state) = (None, CameraState::NONE);
                        radiance.depolarize();
                        tail.scatter_in(medium);
                        cone.forget();
                        vertex += 1;
                        if medium.is_subsurface {
                            walked += 1;
                            if walked > LONGEST_WALK {
                                return radiance;
                            }
                        }
                        continue;
                    }
                }
            }
            let Some(mut surface) = surface else {
                if let Some(environment) = &self.lights().environment {
                    let weight = last.map_or(1.0, |l| {
                        let chosen = self.lights().environment_probability(l.point, l.normal, flash);
                        mis(l.density, chosen * environment.pdf(ray.direction))
                    });
                    let light = throughput * environment.radiance(ray.direction, wavelengths) * weight;
                    radiance.add_polarized(light, vertex - walked, || environment.polarization(ray.direction));
                }
                let from = last.map(|l| (l.point, l.normal));
                for (number, disc, density) in self.lights().discs(ray.direction, from, wavelengths, flash) {
                    let left = photons.map_or(Sampled::ONE, |p| p.left_of_punctual(&tail, number));
                    let weight = last.map_or(1.0, |l| {
                        let disc = LightRef::Punctual(number);
                        let connected = vertices.map_or(0.0, |pool| camera_state.beside_hit(pool, disc, ray.direction, 1.0));
                        1.0 / (1.0 + squared_ratio(density, l.density) + connected)
                    });
                    radiance.add(throughput * left * disc * weight, vertex - walked);
                }
                return radiance;
            };
            cone.advance(surface.t);
            cone.meet(self, &mut surface, ray.direction);
            let material = self.material(surface.object);
            let entering = surface.ng.dot(ray.direction) < 0.0;
            let hidden = medium_stack.hides(material, entering);
            if hidden || matches!(material.scattering, Scattering::Interface) {
                if segment_index - walked > MOST_FACES {
                    return radiance;
                }
                medium_stack.cross(material, entering);
                camera_state.bar();
                // A hidden face stands in the way of light samples; then only chance finds the light.
                shown = shown.filter(|_| !hidden);
                last = last.filter(|_| !hidden).map(|l| PrevScatter { gone: l.gone + surface.t, ..l });
                ray.origin = past(&surface, ray.direction);
                continue;
            }
            if material.emission.is_some() {
                let left = photons.map_or(Sampled::ONE, |p| p.left_of_area(&tail, self.light_at(&surface)));
                let counts = shown.as_ref().map_or(1.0, |s| s.counts(&surface));
                let joined = vertices.map(|v| (v, &camera_state));
                let emitted = self.emitted(material, &surface, &ray, wavelengths, last, &scattered_on, flash, joined);
                radiance.add(throughput * left * emitted * counts, vertex - walked);
            }

            if vertex - walked >= settings.max_depth {
                return radiance;
            }
            let wo = -ray.direction;
            let around = medium_stack.around(material);
            let Some(bsdf) = material.bsdf(&surface, wo, wavelengths, hero_only, around) else { return radiance };
            let ng = bsdf.side_normal();

            // Light that comes over mirrors and through glass.
            if let Some(photons) = photons
                && !bsdf.is_specular()
                && !surface.is_strand()
            {
                let most_events = settings.max_depth - (vertex - walked) - 1;
                let light = throughput * photons.gather(&surface, &bsdf, wavelengths, time_s, most_events);
                // Photons were scattered before they landed.
                radiance.add(light, vertex - walked + 2);
                if let Some(gathered) = &mut gathered {
                    **gathered += light;
                }
            }

            // Connect with the paths of lamps.
            let camera_vertex = vertices.map(|pool| {
                let arrival = camera_state.arrive(&surface, ray.direction);
                let (surface, bsdf, medium_stack) = (&surface, &bsdf, &medium_stack);
                (pool, CameraVertex { surface, material, around, bsdf, wo, arrival, medium_stack, wavelengths })
            });
            if let Some((pool, here)) = &camera_vertex
                && !bsdf.is_specular()
                && vertex - walked + 1 < settings.max_depth
                && here.connects()
                && !pool.is_empty()
            {
                let most_events = settings.max_depth - (vertex - walked) - 1;
                let picked = picked.get_or_insert_with(|| Picked::new(pool, sampler.stream(Set::Connection(0))));
                let numbers = sampler.stream(Set::Connection(vertex + 1));
                let light = here.connect(pool, picked, throughput, most_events, time_s, numbers);
                // Here and at the vertex of the light path.
                radiance.add(light, vertex - walked + 2);
            }

            // Sample a light.
            let u = sampler.get(Set::Light(vertex));
            if !bsdf.is_specular()
                && let Some((light, probability)) = self.lights().choose(surface.point, bsdf.light_normal(), u[2], flash)
                && let Some(light_sample) = self.sample_li(light, surface.point, [u[0], u[1]], time_s)
            {
                let (f, pdf) = bsdf.eval(light_sample.wi);
                if f != Sampled::ZERO {
                    let density = probability * light_sample.pdf;
                    let by_chance = if light_sample.has_extent { squared_ratio(pdf, density) } else { 0.0 };
                    let weight = 1.0 / (1.0 + by_chance);
                    let by_connection = camera_vertex
                        .as_ref()
                        .map_or(0.0, |(pool, here)| here.beside_light_sample(pool, light, &light_sample, density));
                    let through = light_sample.wi.dot(ng) < 0.0;
                    let origin = surface.leave(if through { -ng } else { ng }, light_sample.wi);
                    let mut beyond = medium_stack;
                    if through {
                        beyond.cross(material, entering);
                    }
                    let contribution =
                        throughput * f * self.incident_radiance(&light_sample, wavelengths, time_s) * (weight / density);
                    let thin_dielectrics = settings.max_depth - (vertex - walked) - 1;
                    let stream = || sampler.stream(Set::Transmittance(vertex));
                    let mut sheets = T::Sheets::default();
                    let past = self.light_past(
                        &mut sheets,
                        contribution,
                        surface.point,
                        origin,
                        &light_sample,
                        beyond,
                        wavelengths,
                        time_s,
                        thin_dielectrics,
                        stream,
                    );
                    let Past { light: arrives, thin_dielectrics: crossed, .. } = past;
                    let arrives = match by_connection > 0.0 && past.lets_light_paths_through(light_sample.distance) {
                        true => arrives * ((1.0 + by_chance) / (1.0 + by_chance + by_connection)),
                        false => arrives,
                    };
                    let scattered = Scattered { bsdf: &bsdf, wo, wi: light_sample.wi, sheets: &sheets };
                    radiance
                        .add_scattered(arrives, vertex - walked + 1 + crossed, scattered, || self.polarization(&light_sample));
                }
            }

            // Light of lamps that the medium about the surface scatters near them.
            let joint = match medium_stack.span(&ray, surface.t) {
                Some((medium, span)) if medium.scatters_homogeneously() && !bsdf.is_specular() && !bsdf.is_fiber() => {
                    let segment = MediumSegment {
                        scene: self,
                        medium,
                        span,
                        ray: &ray,
                        medium_stack: &medium_stack,
                        wavelengths,
                        sampler,
                        settings,
                        vertex,
                        depth: vertex - walked,
                        segment_index,
                        flash,
                        start: None,
                    };
                    let leave = |direction: Vec3| {
                        let through = direction.dot(ng) < 0.0;
                        let mut beyond = medium_stack;
                        if through {
                            beyond.cross(material, entering);
                        }
                        (surface.leave(if through { -ng } else { ng }, direction), beyond)
                    };
                    let here = Vertex { segment: &segment, point: surface.point, depth: vertex - walked };
                    let add = |light: Sampled, events: u32, wi: Vec3| {
                        let sheets = T::Sheets::default();
                        // The medium depolarises it.
                        radiance.add_scattered(light, events, Scattered { bsdf: &bsdf, wo, wi, sheets: &sheets }, || None);
                    };
                    here.joint(throughput, |direction| bsdf.eval(direction), leave, add).then_some(medium)
                }
                _ => None,
            };

            // Go on in a direction light may have come from.
            let u = sampler.get(Set::Scatter(vertex));
            let Some(scatter) = bsdf.sample(u) else { return radiance };
            throughput *= scatter.weight;
            radiance.scatter(&bsdf, wo, scatter.wi, scatter.specular);
            if scatter.disperses && !hero_only {
                throughput *= wavelengths.hero_only();
                hero_only = true;
            }
            let is_straight = scatter.specular && scatter.transmitted && bsdf.straight_through().is_some();
            last = match scatter.specular {
                false => {
                    cone.scatter(scatter.pdf);
                    // A normal of 0 stands for media, too: there is no segment here.
                    if bsdf.is_fiber() {
                        scattered_on = None;
                    }
                    Some(PrevScatter {
                        point: surface.point,
                        normal: bsdf.light_normal(),
                        density: scatter.pdf,
                        gone: 0.0,
                        joint,
                    })
                }
                // Light samples go through thin dielectrics, too.
                true if is_straight => last.map(|l| PrevScatter { gone: l.gone + surface.t, ..l }),
                true => {
                    cone.forget();
                    None
                }
            };
            shown = shown.filter(|_| is_straight);
            if let Some(photons) = photons {
                match scatter.specular {
                    // Photons do not land on strands.
                    false if surface.is_strand() => tail = Tail::default(),
                    false => tail.scatter(&bsdf, scatter.wi),
                    true if is_straight => {}
                    true => tail.bend(photons.casts(surface.object)),
                }
            }
            if let Some((_, here)) = &camera_vertex {
                camera_state = match is_straight {
                    true if bsdf.is_specular() => camera_state.through_thin_dielectric(),
                    true => CameraState::NONE,
                    false => here.scattered(&scatter),
                };
            }
            if scatter.transmitted {
                medium_stack.cross(material, entering);
            }
            eta_scale *= scatter.eta_scale;
            vertex += 1;
            if !survives(&mut throughput, eta_scale, vertex, u[3], roulette_depth, MOST_SURVIVAL) {
                return radiance;
            }
            let normal = if scatter.transmitted { -ng } else { ng };
            ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s };
        }
    }

    fn is_interface(&self, surface: &Surface) -> bool {
        self.has_straight_transmission() && matches!(self.material(surface.object).scattering, Scattering::Interface)
    }

    /// Radiance a surface sends back along the ray by itself, weighted against having been sampled.
    #[inline]
    #[allow(clippy::too_many_arguments)]
    fn emitted(
        &self,
        material: &Material,
        surface: &Surface,
        ray: &Ray,
        wavelengths: &Wavelengths,
        last: Option<PrevScatter>,
        scattered_on: &Option<ScatteredOn>,
        flash: bool,
        joined: Option<(&LightVertices, &CameraState)>,
    ) -> Sampled {
        let Some(emission) = &material.emission else { return Sampled::ZERO };
        if !emission.two_sided && surface.ng.dot(ray.direction) > 0.0 {
            return Sampled::ZERO;
        }
        let weight = match (last, self.light_at(surface)) {
            (Some(l), Some(light)) => {
                let aimed = self.pdf_li(light, l.point, ray.direction, l.gone + surface.t, ray.time_s);
                let by_light = self.lights().area_probability(l.point, l.normal, light, flash) * aimed;
                match scattered_on {
                    Some(on) if l.normal == Vec3::ZERO => {
                        mis(l.density, by_light.hypot(on.equiangular(self, LightRef::Area(light)) * aimed))
                    }
                    _ => {
                        let cos = surface.ng.dot(ray.direction);
                        let connected =
                            joined.map_or(0.0, |(pool, state)| state.beside_hit(pool, LightRef::Area(light), ray.direction, cos));
                        1.0 / (1.0 + squared_ratio(by_light, l.density) + connected)
                    }
                }
            }
            _ => 1.0,
        };
        emission.at(surface, wavelengths) * (weight * self.modulation(material, ray.time_s))
    }

    /// What is left of light that was sampled from `point`, on its way from there (`origin`: the point, moved off its surface), through faces of
    /// media and up to so many thin dielectrics. `stream` makes the numbers for media that differ from place to place.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn transmittance_to_light<'a>(
        &'a self,
        light: Sampled,
        point: Vec3,
        origin: Vec3,
        light_sample: &LightSample,
        medium_stack: MediumStack<'a>,
        wavelengths: &Wavelengths,
        time_s: f32,
        thin_dielectrics: u32,
        stream: impl Fn() -> Stream,
    ) -> Sampled {
        let stack = medium_stack;
        self.light_past(&mut (), light, point, origin, light_sample, stack, wavelengths, time_s, thin_dielectrics, stream).light
    }

    /// The same, and what was on the way.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn light_past<'a>(
        &'a self,
        sheets: &mut impl Sheets,
        light: Sampled,
        point: Vec3,
        mut origin: Vec3,
        light_sample: &LightSample,
        mut medium_stack: MediumStack<'a>,
        wavelengths: &Wavelengths,
        time_s: f32,
        mut thin_dielectrics: u32,
        stream: impl Fn() -> Stream,
    ) -> Past {
        let nothing = Past { light: Sampled::ZERO, is_barred: false, thin_dielectrics: 0 };
        let mut is_barred = false;
        let most = thin_dielectrics;
        if light == Sampled::ZERO {
            return nothing;
        }
        let end = point + light_sample.wi * light_sample.distance;
        let mut left = light;
        // One stream for all media on the way.
        let mut numbers = None;
        for _ in 0..MOST_FACES {
            // The start was moved off its surface: look at the same place of the lamp from there, and end before the lamp itself.
            let (direction, reach) = match light_sample.distance.is_finite() {
                true => {
                    let to = end - origin;
                    let distance = to.length();
                    if distance <= light_sample.clearance {
                        return Past { light: left, is_barred, thin_dielectrics: most - thin_dielectrics };
                    }
                    (to / distance, distance - light_sample.clearance)
                }
                false => (light_sample.wi, f32::INFINITY),
            };
            let ray = Ray { origin, direction, time_s };
            let face = match self.has_straight_transmission() {
                false if self.occluded(&ray, reach) => return nothing,
                false => None,
                true => self.intersect(&ray, reach),
            };
            if let Some(face) = face.as_ref()
                && !self.is_interface(face)
            {
                let material = self.material(face.object);
                // Thin dielectrics are scattering events as others are.
                if thin_dielectrics == 0 || !material.may_transmit_straight() {
                    return nothing;
                }
                thin_dielectrics -= 1;
                let bsdf = material.bsdf(face, -direction, wavelengths, false, None);
                let Some(bsdf) = bsdf else { return nothing };
                let Some(through) = bsdf.straight_through() else { return nothing };
                left *= through;
                is_barred |= !bsdf.is_specular();
                sheets.cross(&bsdf, direction);
            } else {
                is_barred |= face.is_some();
            }
            if let Some((medium, span)) = medium_stack.span(&ray, face.as_ref().map_or(reach, |f| f.t)) {
                is_barred = true;
                let moment_s = self.moment_s(time_s);
                left *= medium.transmittance(&ray, span, wavelengths, moment_s, || numbers.get_or_insert_with(&stream));
            }
            let Some(face) = face else { return Past { light: left, is_barred, thin_dielectrics: most - thin_dielectrics } };
            medium_stack.cross(self.material(face.object), face.ng.dot(direction) < 0.0);
            origin = past(&face, direction);
        }
        nothing
    }
}

/// What arrives of light that was sampled.
pub(crate) struct Past {
    /// Radiance, or what stands for it.
    pub light: Sampled,
    /// Whether it went through what ends light paths: a medium, a face of one, a thin dielectric that scatters, too.
    is_barred: bool,
    /// Thin dielectrics on the way.
    pub thin_dielectrics: u32,
}

impl Past {
    /// Whether light paths come along this way: through nothing, from infinitely far also through thin dielectrics.
    fn lets_light_paths_through(&self, distance: f32) -> bool {
        !self.is_barred && (self.thin_dielectrics == 0 || distance == f32::INFINITY)
    }
}

/// Segments in media, behind a first scattering event, for each along which photons are gathered: a gathering takes as long as the rest of the segment, and photons
/// are less noisy than the path that comes to them.
const SEGMENTS_A_GATHERING: f32 = 4.0;

/// Most faces of media that a path goes through between two surfaces, and segments after which it is given up at such a face.
pub(crate) const MOST_FACES: u32 = 4096;

/// The last place from which lights could have been sampled.
#[derive(Clone, Copy)]
struct PrevScatter<'a> {
    point: Vec3,
    /// Normal there; 0 in a medium and of fibres.
    normal: Vec3,
    /// Density of the direction that was taken instead, 1/sr.
    density: f32,
    /// Distance from there to the start of the ray, m.
    gone: f32,
    /// The medium in which lights were sought by joint samples from there ([`joint`]).
    joint: Option<&'a Medium>,
}

impl PrevScatter<'_> {
    /// Where a segment in a medium begins, if it begins here and lights were sought.
    fn start(&self, medium: &Medium) -> Option<Start> {
        let sought = self.gone == 0.0 && self.joint.is_some_and(|m| std::ptr::eq(m, medium));
        sought.then_some(Start { point: self.point, density: self.density })
    }
}

/// Numbers for the media on the way of light from a point that no sampler belongs to: by a hash of where the ray runs, as whether a surface with holes is
/// met.
pub(crate) fn stream_along(point: Vec3, direction: Vec3) -> Stream {
    let hash = |v: Vec3| v.to_array().iter().fold(0, |h, x| mix(h ^ x.to_bits()));
    let seed = u64::from(hash(point)) << 32 | u64::from(hash(direction));
    Sampler::new(SamplerKind::Independent, seed, (0, 0), 0, 1).stream(Set::Transmittance(0))
}

/// A start just behind a face that a ray goes through.
pub(crate) fn past(surface: &Surface, direction: Vec3) -> Vec3 {
    surface.leave(if surface.ng.dot(direction) > 0.0 { surface.ng } else { -surface.ng }, direction)
}

/// Scattering events within bodies after which a path is given up: of light in a half space that does not absorb one part in a hundred gets so far.
const LONGEST_WALK: u32 = 8192;

/// Scattering events before Russian roulette starts where each vertex is connected with light paths: what comes later brings less, and costs more (rooms lit by the
/// sun: 0.7 of the time of 5, 1.19 of the squared error).
const CONNECTED_ROULETTE_DEPTH: u32 = 2;

/// Largest probability with which a path goes on where Russian roulette decides, so that every path ends.
const MOST_SURVIVAL: f32 = 0.95;

/// Russian roulette on what a path can still bring; `most`: largest probability of going on.
#[inline]
fn survives(throughput: &mut Sampled, eta_scale: f32, vertex: u32, u: f32, roulette_depth: u32, most: f32) -> bool {
    if vertex < roulette_depth {
        return true;
    }
    let survival = (throughput.max_element() * eta_scale).clamp(0.0, most);
    *throughput /= survival;
    u < survival
}

/// Weight of the strategy with density `a` beside one with density `b` (power heuristic, Veach 1997 eq. 9.13).
#[inline]
fn mis(a: f32, b: f32) -> f32 {
    1.0 / (1.0 + squared_ratio(b, a))
}

/// (b / a)²; 0 where `b` is 0.
#[inline]
fn squared_ratio(b: f32, a: f32) -> f32 {
    if b == 0.0 {
        return 0.0;
    }
    // A quotient first: squares of large densities overflow.
    let r = b / a;
    r * r
}

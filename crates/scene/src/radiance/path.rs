//! A path and its steps: find what its ray meets (`find_hit`); take the segment through a medium, see what shines, choose a light, go on (`shade`); add what the
//! light brings where nothing is on the way (`connect_to_light`, in `next_event.rs`). Each can be done for many paths before the next; taken one
//! after the other, paths are faster (`docs/decisions/paths-as-states.md`).
//!
//! Between two steps all that is known of a path lies in [`Path`], so that any number of paths can be on their way at a time. What is known of the scene in there are numbers of
//! materials; what a path was begun with is borrowed from whoever asked.

use super::cone::Cone;
use super::joint::Vertex;
use super::light_connection::LightConnection;
use super::media::{MediumScatter, MediumVertex};
use super::prev_scatter::{LineToLight, PrevScatter};
use super::tally::Tally;
use super::to_light::{MAX_INTERFACES, origin_behind};
use super::weights::{mis, squared_ratio};
use super::{CameraPath, PathSettings};
use crate::light::LightRef;
use crate::light::environment::LinearlyPolarized;
use crate::light_paths::connect::{CameraSubpath, CameraVertex, CandidateSet};
use crate::light_paths::{CausticSuffix, LightVertices, PhotonMap};
use crate::material::{Bsdf, Material, Principled, Scatter, Scattering};
use crate::medium::Medium;
use crate::medium_stack::{MediumId, MediumStack};
use crate::russian_roulette::{self, MOST_SURVIVAL, RouletteRates};
use crate::scene::Scene;
use crate::shape::Surface;
use diopter_light::random::Dimensions;
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;

/// What is the same for all paths.
#[derive(Clone, Copy)]
pub(super) struct Transport<'a> {
    pub scene: &'a Scene,
    pub settings: &'a PathSettings,
}

/// A path between two steps.
pub(super) struct Path<'a, T: Tally> {
    /// What it was begun with.
    pub camera: &'a CameraPath<'a>,
    /// Its light so far.
    pub tally: T,
    /// Where it goes next.
    pub ray: Ray,
    pub cone: Cone,
    pub throughput: SampledSpectrum,
    /// Whether its wavelengths stay together: RGB never disperses, and after dispersion the hero alone is left.
    pub hero_only: bool,
    /// Whether a flash is burning.
    pub flash: bool,
    /// Whether its ray is the camera's still, but for thin dielectrics and faces of media.
    pub is_straight: bool,
    pub medium_stack: MediumStack,
    /// With a light that was chosen and may be hidden.
    pub connection: Option<LightConnection<T::Vertex>>,
    pub last: Option<PrevScatter>,
    /// Where `last` is a vertex in a medium: the segment on which it lies.
    pub medium_scatter: Option<MediumScatter>,
    pub camera_subpath: CameraSubpath,
    /// Candidates for connections, drawn once a path (Talbot et al. 2005).
    candidate_set: Option<Box<CandidateSet>>,
    pub suffix: CausticSuffix,
    /// Vertices so far.
    pub vertex: u32,
    /// Of them those within bodies, which do not count as scattering events.
    pub subsurface_events: u32,
    pub segment_index: u32,
    pub roulette_depth: u32,
    /// How many paths are worth following on, where some are not.
    roulette: Option<&'a RouletteRates>,
    /// Product of the η² by which refraction scaled radiance; Russian roulette leaves it out (pbrt's `etaScale`).
    pub eta_scale: f32,
    /// Whether what shines at the next surface is not the path's own ([`super::reuse_lamps`]).
    pub leaves_out_emission: bool,
    /// Sum of what shines where its ray comes to, where that is kept apart from the rest of its light.
    pub emission_apart: Option<SampledSpectrum>,
    /// Fraction of what shines behind specular surfaces that it brings itself: the rest was looked at where it could have gone another way ([`super::splitting`]).
    pub emission_fraction: f32,
    /// The line along which lights were sampled through clear bodies or over a mirror, where its ray met the first of these.
    pub bent_after: Option<LineToLight>,
    /// Whether it ends at the first surface that is not specular.
    pub only_emission: bool,
    /// Light that other ways brought and that is not among the path's yet, where it is kept apart.
    apart: Option<T>,
    keeps_apart: bool,
}

impl<T: Tally> Path<'_, T> {
    /// Scattering events so far.
    #[inline]
    pub fn depth(&self) -> u32 {
        self.vertex - self.subsurface_events
    }

    /// The same path once more, without light, to look for what shines behind specular surfaces.
    pub fn fork(&self) -> Self {
        Path {
            tally: self.tally.fork(),
            connection: None,
            candidate_set: None,
            roulette: None,
            leaves_out_emission: false,
            emission_apart: None,
            emission_fraction: 1.0,
            only_emission: true,
            apart: None,
            keeps_apart: false,
            ..*self
        }
    }

    /// A path that goes on from its vertex along a ray, scattered by a surface; what its light is multiplied by, and the bodies it is in.
    pub fn scattered_along(self, ray: Ray, throughput: SampledSpectrum, medium_stack: MediumStack) -> Self {
        let mut path = Path { ray, throughput, medium_stack, is_straight: false, last: None, bent_after: None, ..self };
        path.vertex += 1;
        path.cone.forget();
        path
    }

    /// Adds the light of another way.
    pub fn join(&mut self, way: Path<'_, T>) {
        match &mut self.apart {
            Some(apart) => apart.join(way.tally),
            None if self.keeps_apart => self.apart = Some(way.tally),
            None => self.tally.join(way.tally),
        }
    }

    /// Keeps the light of other ways apart from now on, until [`Path::join_apart`].
    pub fn keep_apart(&mut self) {
        self.keeps_apart = true;
    }

    /// Adds what was kept apart.
    pub fn join_apart(&mut self) {
        self.keeps_apart = false;
        if let Some(apart) = self.apart.take() {
            self.tally.join(apart);
        }
    }

    /// Adds what shines where its ray comes to.
    #[inline]
    fn add_emission(&mut self, light: SampledSpectrum, polarization: impl FnOnce() -> Option<LinearlyPolarized>) {
        let depth = self.depth();
        match &mut self.emission_apart {
            Some(apart) => *apart += light,
            None => self.tally.add_polarized(light, depth, polarization),
        }
    }

    /// Lets Russian roulette judge by what it carries over what it carries now, and only after some vertices.
    pub fn restart_roulette(&mut self, vertices: u32) {
        (self.roulette_depth, self.eta_scale) = (self.vertex + vertices, 1.0 / self.throughput.max_element());
        self.roulette = None;
    }

    /// Rate at which it goes on after a number of events ([`RouletteRates`]).
    #[inline]
    pub fn roulette_rate(&self, events: u32) -> f32 {
        self.roulette.map_or(1.0, |rates| rates.after(events))
    }
}

/// Whether a path brings more.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    GoesOn,
    Ended,
}

/// Where a path is scattered.
pub(super) enum Place<'v, 'a> {
    Surface(SurfaceVertex<'v, 'a>),
    Medium(&'v MediumVertex<'a>),
}

/// A surface that scatters, as a path meets it.
pub(super) struct SurfaceVertex<'v, 'a> {
    pub surface: &'v Surface,
    pub material: &'a Material,
    pub entering: bool,
    /// Unit direction back along the path.
    pub wo: Vec3,
    /// The dielectric around the body.
    pub around: Option<&'a Principled>,
    pub bsdf: &'v Bsdf<'a>,
    /// Normal on the side of `wo`.
    pub ng: Vec3,
}

impl SurfaceVertex<'_, '_> {
    /// What light from a direction is multiplied by, and the density of the direction if it were scattered there: f cos θ where it `is_scattered`; else 1, as it arrives from the side of the normal. `None`
    /// where it brings nothing.
    #[inline(always)]
    pub fn response(&self, wi: Vec3, is_scattered: bool) -> Option<(SampledSpectrum, f32)> {
        let (f, pdf) = self.bsdf.eval(wi);
        match is_scattered {
            true => (f != SampledSpectrum::ZERO).then_some((f, pdf)),
            false => (wi.dot(self.ng) > 0.0).then_some((SampledSpectrum::ONE, pdf)),
        }
    }

    /// Where a ray starts that leaves in a direction, and the bodies that it is in then.
    #[inline]
    pub fn leave(&self, scene: &Scene, mut medium_stack: MediumStack, direction: Vec3) -> (Vec3, MediumStack) {
        let through = direction.dot(self.ng) < 0.0;
        let origin = self.surface.leave(if through { -self.ng } else { self.ng }, direction);
        if through {
            medium_stack.cross(scene, self.surface.object, self.entering);
        }
        (origin, medium_stack)
    }
}

impl<'a> Transport<'a> {
    /// A path that begins at the camera.
    #[inline]
    pub fn begin<T: Tally>(&self, camera: &'a CameraPath<'a>, tally: T) -> Path<'a, T> {
        let roulette_depth = match camera.light_paths.vertices {
            None => self.settings.roulette_depth,
            Some(_) => self.settings.roulette_depth.min(CONNECTED_ROULETTE_DEPTH),
        };
        Path {
            camera,
            tally,
            ray: camera.cone.ray,
            cone: Cone::new(&camera.cone),
            throughput: SampledSpectrum::ONE,
            hero_only: camera.wavelengths.is_rgb(),
            flash: self.scene.flash_burns(camera.cone.ray.time_s),
            is_straight: true,
            medium_stack: camera.immersion.0,
            connection: None,
            last: None,
            medium_scatter: None,
            camera_subpath: CameraSubpath::NONE,
            candidate_set: None,
            suffix: CausticSuffix::default(),
            vertex: 0,
            subsurface_events: 0,
            segment_index: 0,
            roulette_depth,
            roulette: camera.roulette,
            eta_scale: 1.0,
            leaves_out_emission: false,
            emission_apart: None,
            emission_fraction: 1.0,
            bent_after: None,
            only_emission: false,
            apart: None,
            keeps_apart: false,
        }
    }

    /// Follows a path to its end.
    #[inline]
    pub fn follow<T: Tally>(&self, camera: &'a CameraPath<'a>, tally: T) -> T {
        self.follow_on(self.begin(camera, tally))
    }

    /// Follows a path that is on its way to its end.
    #[inline(always)]
    pub fn follow_on<T: Tally>(&self, mut path: Path<'a, T>) -> T {
        self.follow_to_end(&mut path);
        path.tally
    }

    /// The same, for who asks for more than its light.
    #[inline(always)]
    pub fn follow_to_end<T: Tally>(&self, path: &mut Path<'a, T>) {
        loop {
            let mut hit = self.find_hit(path);
            let next = self.shade(path, hit.as_mut());
            self.connect_to_light(path);
            if next == Next::Ended {
                return;
            }
        }
    }

    /// What the ray of a path meets first.
    #[inline]
    pub fn find_hit<T: Tally>(&self, path: &Path<'a, T>) -> Option<Surface> {
        self.scene.intersect(&path.ray, f32::INFINITY)
    }

    /// The segment up to what was met, and the vertex at its end: what shines, what is connected, where the path goes on.
    #[inline]
    fn shade<T: Tally>(&self, path: &mut Path<'a, T>, hit: Option<&mut Surface>) -> Next {
        self.arrive(path, hit, |path, place| self.scatter_at(path, place))
    }

    /// Adds the light that is scattered into the ray at a place, and sends the path on.
    #[inline(always)]
    pub fn scatter_at<T: Tally>(&self, path: &mut Path<'a, T>, place: Place<'_, 'a>) -> Next {
        match place {
            Place::Surface(here) => self.scatter_light(path, &here),
            Place::Medium(here) => self.scatter_in_medium(path, here),
        }
    }

    /// The segment up to what was met, and what shines at its end; `scatter` does the rest where that is a surface that scatters, or where a medium scatters the path before.
    #[inline(always)]
    pub fn arrive<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        hit: Option<&mut Surface>,
        scatter: impl FnOnce(&mut Path<'a, T>, Place<'_, 'a>) -> Next,
    ) -> Next {
        let reach = hit.as_ref().map_or(f32::INFINITY, |s| s.t);
        path.segment_index += 1;
        let in_medium = match path.medium_stack.span(self.scene, &path.ray, reach) {
            None => None,
            Some((medium, span)) => self.cross_medium(path, medium, span),
        };
        // Neither it nor the place is moved, and `scatter` is called at one place: it is large.
        let bsdf;
        let place = if let Some(here) = &in_medium {
            Place::Medium(here)
        } else {
            let Some(surface) = hit else {
                self.leave_scene(path);
                return Next::Ended;
            };
            path.cone.advance(surface.t);
            path.cone.meet(self.scene, surface, path.ray.direction);
            let material = self.scene.material(surface.object);
            let entering = surface.ng.dot(path.ray.direction) < 0.0;
            let hidden = path.medium_stack.hides(self.scene, surface.object, entering);
            if hidden || matches!(material.scattering, Scattering::Interface) {
                // Nothing that light would meet may shine all the same.
                if !hidden && !path.leaves_out_emission {
                    self.see_emission(path, material, surface);
                }
                return self.cross_interface(path, surface, entering, hidden);
            }
            if !path.leaves_out_emission {
                self.see_emission(path, material, surface);
            }
            if path.depth() >= self.settings.max_depth || path.only_emission && !material.may_be_specular() {
                return Next::Ended;
            }
            let wo = -path.ray.direction;
            let around = path.medium_stack.around(self.scene, surface.object);
            bsdf = material.bsdf(surface, wo, &path.camera.wavelengths, path.hero_only, around);
            let Some(bsdf) = &bsdf else { return Next::Ended };
            Place::Surface(SurfaceVertex { surface, material, entering, wo, around, bsdf, ng: bsdf.side_normal() })
        };
        scatter(path, place)
    }

    /// The light of the environment and of lights at infinity, which the ray of a path runs into.
    fn leave_scene<T: Tally>(&self, path: &mut Path<'a, T>) {
        let (lights, wavelengths, direction) = (self.scene.lights(), &path.camera.wavelengths, path.ray.direction);
        let (last, flash) = (path.last, path.flash);
        if let Some(environment) = &lights.environment {
            let weight = match last {
                None => self.weight_beside_light_samples(path),
                Some(l) => {
                    let chosen = lights.environment_probability(l.point, l.normal, flash);
                    mis(l.density, chosen * environment.pdf(direction))
                }
            };
            let light = path.throughput * environment.radiance(direction, wavelengths) * (weight * path.emission_fraction);
            path.add_emission(light, || environment.polarization(direction));
        }
        self.see_discs(path);
    }

    /// The light of lights at infinity that are seen as discs.
    #[inline]
    pub fn see_discs<T: Tally>(&self, path: &mut Path<'a, T>) {
        let (lights, wavelengths, direction) = (self.scene.lights(), &path.camera.wavelengths, path.ray.direction);
        let (last, flash) = (path.last, path.flash);
        let from = last.map(|l| (l.point, l.normal));
        for (number, disc, density) in lights.discs(direction, from, wavelengths, flash) {
            let left = path
                .camera
                .light_paths
                .photons
                .map_or(SampledSpectrum::ONE, |p| p.punctual_emission_fraction(&path.suffix, number));
            let weight = match last {
                None => self.weight_beside_light_samples(path),
                Some(l) => {
                    let disc = LightRef::Punctual(number);
                    let connected = |pool| path.camera_subpath.connection_ratio_to_hit(pool, disc, direction, 1.0);
                    let connected = path.camera.light_paths.vertices.map_or(0.0, connected);
                    1.0 / (1.0 + squared_ratio(density, l.density) + connected)
                }
            };
            path.add_emission(path.throughput * left * disc * (weight * path.emission_fraction), || None);
        }
    }

    /// Goes through the face of a medium, or one that is not there.
    fn cross_interface<T: Tally>(&self, path: &mut Path<'a, T>, surface: &Surface, entering: bool, hidden: bool) -> Next {
        if path.segment_index - path.subsurface_events > MAX_INTERFACES {
            return Next::Ended;
        }
        path.medium_stack.cross(self.scene, surface.object, entering);
        path.camera_subpath.block_light_paths();
        // A hidden interface blocks shadow rays: only a scattered ray finds that light, and counts in full.
        path.is_straight &= !hidden;
        path.last = path.last.filter(|_| !hidden).map(|l| PrevScatter { traveled: l.traveled + surface.t, ..l });
        path.ray.origin = origin_behind(surface, path.ray.direction);
        Next::GoesOn
    }

    /// What a surface sends back along the ray by itself, weighted against having been sampled.
    #[inline]
    fn see_emission<T: Tally>(&self, path: &mut Path<'a, T>, material: &Material, surface: &Surface) {
        let Some(emission) = &material.emission else { return };
        let (scene, ray, light_paths) = (self.scene, &path.ray, &path.camera.light_paths);
        if !emission.two_sided && surface.ng.dot(ray.direction) > 0.0 {
            return;
        }
        let light = scene.light_at(surface);
        let left = light_paths.photons.map_or(SampledSpectrum::ONE, |p| p.area_emission_fraction(&path.suffix, light));
        let counts = path.camera.emitter_mis.as_ref().filter(|_| path.is_straight).map_or(1.0, |s| s.counts(surface));
        let weight = match (path.last, light) {
            (Some(l), Some(light)) => {
                let sampled = scene.pdf_li(light, l.point, ray.direction, l.traveled + surface.t, ray.time_s);
                let by_light = scene.lights().area_probability(l.point, l.normal, light, path.flash) * sampled;
                let light = LightRef::Area(light);
                match &path.medium_scatter {
                    Some(on) if l.normal == Vec3::ZERO => mis(l.density, by_light.hypot(on.equiangular(scene, light) * sampled)),
                    _ => {
                        let cos = surface.ng.dot(ray.direction);
                        let connected = |pool| path.camera_subpath.connection_ratio_to_hit(pool, light, ray.direction, cos);
                        let connected = light_paths.vertices.map_or(0.0, connected);
                        1.0 / (1.0 + squared_ratio(by_light, l.density) + connected)
                    }
                }
            }
            _ => self.weight_beside_light_samples(path),
        };
        let emitted = emission.at(surface, &path.camera.wavelengths)
            * (weight * path.emission_fraction * scene.modulation(material, ray.time_s));
        path.add_emission(path.throughput * left * emitted * counts, || None);
    }

    /// Adds the light that a surface scatters into the ray, and sends the path on.
    #[inline]
    pub fn scatter_light<T: Tally>(&self, path: &mut Path<'a, T>, here: &SurfaceVertex<'_, 'a>) -> Next {
        if let Some(photons) = path.camera.light_paths.photons {
            self.gather(path, here, photons);
        }
        // What is known of light paths is taken before the path goes on.
        let camera_vertex = path.camera.light_paths.vertices.map(|pool| {
            let &SurfaceVertex { surface, material, around, bsdf, wo, .. } = here;
            let vertex_mis = path.camera_subpath.mis_at(surface, path.ray.direction);
            let (medium_stack, wavelengths) = (path.medium_stack, &path.camera.wavelengths);
            (pool, CameraVertex { surface, material, around, bsdf, wo, vertex_mis, medium_stack, wavelengths })
        });
        if let Some((pool, camera_vertex)) = &camera_vertex {
            self.connect(path, camera_vertex, pool);
        }
        let [light_numbers, scatter_numbers] =
            path.camera.sampler.get_two([Dimensions::Light(path.vertex), Dimensions::Scatter(path.vertex)]);
        self.choose_light(path, here, light_numbers, camera_vertex.as_ref(), true);
        self.add_mirrored_light(path, here, true);
        let joint = match path.medium_stack.span(self.scene, &path.ray, here.surface.t) {
            None => None,
            Some((medium, span)) => {
                // In the order in which light was always summed.
                self.connect_to_light(path);
                let add = |tally: &mut T, light: SampledSpectrum, events: u32, wi: Vec3| {
                    let vertex = tally.vertex(here.bsdf, here.wo, wi);
                    // The medium depolarises it.
                    tally.add_scattered(light, events, &vertex, &T::ThinDielectrics::default(), || None);
                };
                self.sample_jointly(path, here, medium, span, |direction| here.bsdf.eval(direction), add)
            }
        };
        self.go_on(path, here, scatter_numbers, camera_vertex.as_ref().map(|(_, vertex)| vertex), joint)
    }

    /// Light that comes over mirrors and through glass.
    pub fn gather<T: Tally>(&self, path: &mut Path<'a, T>, here: &SurfaceVertex<'_, 'a>, photons: &PhotonMap) {
        if here.bsdf.is_specular() || here.surface.is_strand() {
            return;
        }
        let most_events = self.settings.max_depth - path.depth() - 1;
        let light = photons.gather(here.surface, here.bsdf, &path.camera.wavelengths, path.ray.time_s, most_events);
        // Photons were scattered before they landed.
        path.tally.add_photons(path.throughput * light, path.depth() + 2);
    }

    /// Light of the paths of lamps, by connections.
    fn connect<T: Tally>(&self, path: &mut Path<'a, T>, here: &CameraVertex<'_, 'a>, pool: &LightVertices) {
        let depth = path.depth();
        if here.bsdf.is_specular() || depth + 1 >= self.settings.max_depth || !here.connects() || pool.is_empty() {
            return;
        }
        let sampler = &path.camera.sampler;
        let candidate_set = path
            .candidate_set
            .get_or_insert_with(|| Box::new(CandidateSet::new(pool, sampler.stream(Dimensions::Connection(0)))));
        let numbers = sampler.stream(Dimensions::Connection(path.vertex + 1));
        let most_events = self.settings.max_depth - depth - 1;
        let light = here.connect(pool, candidate_set, path.throughput, most_events, path.ray.time_s, numbers);
        // Here and at the vertex of the light path.
        path.tally.add(light, depth + 2);
    }

    /// Light of lamps that the medium before a surface scatters near them ([`super::joint`]): `response`: what is scattered from a direction, and its density; `add`: adds light by number of events and direction. The medium, where it was sought.
    #[inline]
    pub fn sample_jointly<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        medium: &'a Medium,
        span: [f32; 2],
        response: impl Fn(Vec3) -> (SampledSpectrum, f32),
        add: impl FnOnce(&mut T, SampledSpectrum, u32, Vec3),
    ) -> Option<MediumId> {
        if !medium.scatters_homogeneously() || here.bsdf.is_specular() || here.bsdf.is_fiber() {
            return None;
        }
        let (segment, medium_stack) = (self.segment(path, medium, span), path.medium_stack);
        let leave = |direction: Vec3| here.leave(self.scene, medium_stack, direction);
        let vertex = Vertex { segment: &segment, point: here.surface.point, depth: path.depth() };
        let tally = &mut path.tally;
        let add = |light: SampledSpectrum, events: u32, wi: Vec3| add(tally, light, events, wi);
        let sought = vertex.joint(path.throughput, response, leave, add);
        sought.then(|| medium_stack.medium(self.scene))
    }

    /// Goes on in a direction light may have come from.
    #[inline]
    fn go_on<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        u: [f32; 4],
        camera_vertex: Option<&CameraVertex<'_, 'a>>,
        joint: Option<MediumId>,
    ) -> Next {
        let scatter = here.bsdf.sample(u);
        self.look_along_other_lobes(path, here, scatter.as_ref());
        match scatter {
            None => Next::Ended,
            Some(scatter) => self.go_along(path, here, scatter, u[3], camera_vertex, joint),
        }
    }

    /// Goes on as it was drawn, unless Russian roulette by the number `u` ends the path.
    #[inline]
    pub fn go_along<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        scatter: Scatter,
        u: f32,
        camera_vertex: Option<&CameraVertex<'_, 'a>>,
        joint: Option<MediumId>,
    ) -> Next {
        let (surface, bsdf) = (here.surface, here.bsdf);
        path.throughput *= scatter.weight;
        path.tally.scatter(bsdf, here.wo, scatter.wi, scatter.specular);
        if scatter.disperses && !path.hero_only {
            path.throughput *= path.camera.wavelengths.hero_only();
            path.hero_only = true;
        }
        let passes_straight = scatter.specular && scatter.transmitted && bsdf.straight_through().is_some();
        path.last = match scatter.specular {
            false => {
                (path.emission_fraction, path.bent_after) = (1.0, None);
                path.cone.scatter(scatter.pdf);
                // A normal of 0 stands for media, too: there is no segment here.
                if bsdf.is_fiber() {
                    path.medium_scatter = None;
                }
                let (point, normal) = (surface.point, bsdf.light_normal());
                Some(PrevScatter { point, normal, density: scatter.pdf, traveled: 0.0, joint })
            }
            // Light samples go through thin dielectrics, too.
            true if passes_straight => path.last.map(|l| PrevScatter { traveled: l.traveled + surface.t, ..l }),
            true => {
                if let Some(last) = path.last {
                    let through_glass = LineToLight { from: last, ray: path.ray, over_mirror: false };
                    path.bent_after = match self.light_was_sampled_through(path, surface) {
                        true => Some(through_glass),
                        false => self.line_over_mirror(path, surface),
                    };
                }
                path.cone.forget();
                None
            }
        };
        path.is_straight &= passes_straight;
        if let Some(photons) = path.camera.light_paths.photons {
            match scatter.specular {
                // Photons do not land on strands.
                false if surface.is_strand() => path.suffix = CausticSuffix::default(),
                false => path.suffix.scatter(bsdf, scatter.wi),
                true if passes_straight => {}
                true => path.suffix.bend(photons.casts(surface.object)),
            }
        }
        if path.camera.light_paths.vertices.is_some() {
            path.camera_subpath = match camera_vertex {
                _ if passes_straight && bsdf.is_specular() => path.camera_subpath.through_thin_dielectric(),
                Some(camera_vertex) if !passes_straight => camera_vertex.scattered(&scatter),
                _ => CameraSubpath::NONE,
            };
        }
        let Scatter { wi, transmitted, .. } = scatter;
        if transmitted {
            path.medium_stack.cross(self.scene, surface.object, here.entering);
        }
        path.eta_scale *= scatter.eta_scale;
        path.vertex += 1;
        let rate = path.roulette_rate(path.depth());
        if !russian_roulette::goes_on(
            &mut path.throughput,
            path.eta_scale,
            path.vertex,
            u,
            path.roulette_depth,
            MOST_SURVIVAL,
            rate,
        ) {
            return Next::Ended;
        }
        let normal = if transmitted { -here.ng } else { here.ng };
        path.ray = Ray { origin: surface.leave(normal, wi), direction: wi, time_s: path.ray.time_s };
        Next::GoesOn
    }
}

/// Scattering events before Russian roulette starts where each vertex is connected with light paths: what comes later brings less, and costs more (rooms lit by the
/// sun: 0.7 of the time of 5, 1.19 of the squared error).
const CONNECTED_ROULETTE_DEPTH: u32 = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use diopter_light::random::{Sampler, SamplerKind};
    use diopter_light::wavelength::WavelengthSampler;

    impl<'a> Transport<'a> {
        /// Follows many paths to their ends, all of them a step at a time: what all rays meet; what is there; what comes from lights.
        fn follow_together<T: Tally>(&self, cameras: &'a [CameraPath<'a>], tally: impl Fn() -> T) -> Vec<T> {
            let mut paths: Vec<_> = cameras.iter().map(|camera| self.begin(camera, tally())).collect();
            let mut active: Vec<usize> = (0..paths.len()).collect();
            let mut next = vec![Next::GoesOn; paths.len()];
            let mut hits: Vec<Option<Surface>> = vec![None; paths.len()];
            while !active.is_empty() {
                for i in &active {
                    hits[*i] = self.find_hit(&paths[*i]);
                }
                for i in &active {
                    next[*i] = self.shade(&mut paths[*i], hits[*i].as_mut());
                }
                for i in &active {
                    self.connect_to_light(&mut paths[*i]);
                }
                active.retain(|i| next[*i] == Next::GoesOn);
            }
            paths.into_iter().map(|path| path.tally).collect()
        }
    }

    #[test]
    fn paths_on_their_way_together_are_what_each_is_alone() {
        for name in ["cornell", "still-life", "night"] {
            let description = builtin::named(name).unwrap();
            let view = description.cameras.first().map(|camera| camera.world_from_camera);
            let framing = builtin::framing(name);
            let view = view.unwrap_or_else(|| {
                let framing = framing.as_ref().unwrap();
                let back = (framing.look_from - framing.look_at).normalize();
                let right = Vec3::Y.cross(back).normalize();
                glam::Affine3A::from_cols(right.into(), back.cross(right).into(), back.into(), framing.look_from.into())
            });
            let scene = Scene::build(description).unwrap();
            let settings = PathSettings::default();
            let transport = Transport { scene: &scene, settings: &settings };
            let wavelengths = WavelengthSampler::uniform();
            let cameras: Vec<CameraPath> = (0..64)
                .map(|i| {
                    let sampler = Sampler::new(SamplerKind::Sobol, 5, (i % 8, i / 8), 0, 1);
                    let [u, v, ..] = sampler.get(Dimensions::Camera);
                    let direction = view.transform_vector3(0.5 * Vec3::new(u - 0.5, v - 0.5, -2.0)).normalize();
                    let ray = Ray { origin: view.translation.into(), direction, time_s: 0.0 };
                    CameraPath::new(ray, wavelengths.sample(sampler.get(Dimensions::Time)[0]), sampler)
                })
                .collect();
            let alone: Vec<SampledSpectrum> =
                cameras.iter().map(|camera| transport.follow(camera, SampledSpectrum::ZERO)).collect();
            assert!(alone.iter().any(|light| *light != SampledSpectrum::ZERO), "{name}");
            assert_eq!(transport.follow_together(&cameras, || SampledSpectrum::ZERO), alone, "{name}");
        }
    }
}

//! Next-event estimation through clear bodies of glass.
//!
//! The straight line to a light sample ends at a body of glass, beyond which the way is bent. Yet panes, bulbs, bottles and pots are thin: who looks at a lamp through their walls sees it about where it is. Where nothing but such bodies
//! stands on the line, the ray towards the sample is followed as the glass bends it, over specular surfaces alone, and brings what shines where it comes out: a light sample is then a density of directions, one that is large where
//! lamps are. Scattered rays find the same light: both are weighted by multiple importance sampling (power heuristic, Veach 1997, §9.2) by their densities of the direction at the vertex, which all later choices have in common. For
//! the scattered ray the density of the light sample is that of the first lamp along the straight line. Unbiased whatever the shape of the glass; where it bends light far away it helps little.
//!
//! Not for what moves, in media that scatter, nor beside light paths, which find such light themselves. Measured: `docs/decisions/clear-glass.md`.

use super::path::{Path, SurfaceVertex, Transport};
use super::prev_scatter::{LineToLight, PrevScatter};
use super::tally::Tally;
use super::to_light::{MAX_INTERFACES, origin_behind, shadow_segment};
use super::weights::squared_ratio;
use crate::light::{LightPoint, LightSample};
use crate::material::{Coverage, Material};
use crate::medium_stack::MediumStack;
use crate::scene::Visibility;
use crate::shape::Surface;
use diopter_light::random::{Dimensions, Stream};
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;

/// Surfaces behind which Russian roulette may end a way.
const ROULETTE_AFTER: u32 = 5;

/// A light sample by its densities, 1/sr: its own, the choice of the light included, and that of a scattered ray.
#[derive(Clone, Copy)]
pub(super) struct Densities {
    pub by_light: f32,
    pub by_scattering: f32,
}

/// The way along which light is looked for from a vertex.
pub(super) struct LightWay {
    /// From the vertex.
    pub ray: Ray,
    /// What light along it is multiplied by.
    pub throughput: SampledSpectrum,
    /// The bodies that it starts in.
    pub medium_stack: MediumStack,
}

impl<'a> Transport<'a> {
    /// Whether lights are sampled through clear bodies from the vertices of a path.
    #[inline]
    pub fn samples_light_through_glass<T: Tally>(&self, path: &Path<'a, T>) -> bool {
        self.scene.has_clear_bodies() && self.bends_light_samples(path)
    }

    /// Whether light samples of a path may be bent: not in media that scatter, nor beside light paths, which find such light themselves.
    #[inline]
    pub fn bends_light_samples<T: Tally>(&self, path: &Path<'a, T>) -> bool {
        let light_paths = &path.camera.light_paths;
        self.scene.media_only_absorb() && light_paths.photons.is_none() && light_paths.vertices.is_none()
    }

    /// Whether they were from the last vertex of a path along its ray, which meets a surface.
    #[inline]
    pub fn light_was_sampled_through<T: Tally>(&self, path: &Path<'a, T>, surface: &Surface) -> bool {
        self.samples_light_through_glass(path)
            && self.scene.is_clear_body(surface.object)
            && path.last.is_some_and(|last| last.traveled == 0.0)
    }

    /// Adds what comes along a light sample that is bent; `f`: f cos θ of its direction. What is known of the straight line, for its shadow ray.
    #[inline(never)]
    pub fn add_refracted_light<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        light_sample: &LightSample,
        f: SampledSpectrum,
        densities: Densities,
    ) -> Option<Visibility> {
        let (scene, point, wi) = (self.scene, here.surface.point, light_sample.wi);
        if let LightPoint::Area(light, _) = light_sample.spot
            && !stops_rays(scene.material_at(scene.lights().area[light as usize].material))
        {
            return None;
        }
        let (origin, medium_stack) = here.leave(scene, path.medium_stack, wi);
        let (ray, reach) = shadow_segment(point, origin, light_sample, path.ray.time_s)?;
        let visibility = scene.visibility(&ray, reach);
        if visibility != Visibility::Unknown {
            return Some(visibility);
        }
        // Of a surface that is hidden by a stronger body around it nobody takes notice.
        let is_seen = |hit: &Surface| !medium_stack.hides(scene, hit.object, hit.ng.dot(ray.direction) < 0.0);
        let bends = |hit: &Surface| scene.is_clear_body(hit.object) && is_seen(hit);
        let Some(mut hit) = scene.intersect(&ray, reach).filter(bends) else { return Some(visibility) };
        let Densities { by_light, by_scattering } = densities;
        let by_others = squared_ratio(by_scattering, by_light);
        let ratios = match light_sample.distance.is_finite() {
            true => 1.0 + by_others,
            // Of all that shines from infinity in the direction; rounding may have moved that out of the disc or the cell that it was drawn in.
            false => by_others + self.infinite_light_ratio(path, (point, here.bsdf.light_normal()), wi, by_light).max(1.0),
        };
        let way = LightWay { ray, throughput: path.throughput * f / (by_light * ratios), medium_stack };
        self.add_light_along(path, here, way, &mut hit, path.camera.sampler.stream(Dimensions::Refracted(path.vertex)));
        Some(visibility)
    }

    /// Adds what shines at the end of a way that a light sample gave, over specular surfaces alone, of which `hit` is the first.
    pub(super) fn add_light_along<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        LightWay { ray, throughput, medium_stack }: LightWay,
        hit: &mut Surface,
        mut stream: Stream,
    ) {
        let mut way = path.fork().scattered_along(ray, throughput, medium_stack);
        // The scattering function is that of the hero already.
        way.hero_only |= here.bsdf.disperses() && ray.direction.dot(here.ng) < 0.0;
        way.tally.scatter(here.bsdf, here.wo, ray.direction, false);
        way.restart_roulette(ROULETTE_AFTER);
        let next = self.pass_specular(&mut way, Some(hit), &mut stream);
        self.follow_specular(&mut way, next, &mut stream);
        path.join(way);
    }

    /// Weight of what a path meets that shines, where its last vertex is no place from which lights were sampled straight: below 1 where they were sampled through glass.
    #[inline]
    pub fn weight_beside_light_samples<T: Tally>(&self, path: &Path<'a, T>) -> f32 {
        path.bent_after.map_or(1.0, |line| 1.0 / (1.0 + self.straight_light_ratio(path, &line)))
    }

    /// Squared density of light samples along a line over that of the scattered ray, where only glass stands before the light; else 0.
    #[inline(never)]
    fn straight_light_ratio<T: Tally>(
        &self,
        path: &Path<'a, T>,
        &LineToLight { from, mut ray, over_mirror }: &LineToLight,
    ) -> f32 {
        let (scene, PrevScatter { point, normal, density, .. }) = (self.scene, from);
        let direction = ray.direction;
        for _ in 0..MAX_INTERFACES {
            let Some(hit) = scene.intersect(&ray, f32::INFINITY) else {
                if over_mirror {
                    return 0.0;
                }
                return self.infinite_light_ratio(path, (point, normal), direction, density);
            };
            if scene.may_pass(hit.object) {
                ray.origin = origin_behind(&hit, direction);
                continue;
            }
            let material = scene.material(hit.object);
            let faces = material.emission.as_ref().is_some_and(|emission| emission.two_sided || hit.ng.dot(direction) < 0.0);
            let faces = faces && stops_rays(material);
            let Some(light) = scene.light_at(&hit).filter(|_| faces) else { return 0.0 };
            let chosen = scene.lights().area_probability(point, normal, light, path.flash);
            return squared_ratio(chosen * scene.pdf_li(light, point, direction, hit.point.distance(point), ray.time_s), density);
        }
        0.0
    }

    /// Sum of the squared densities of all light samples from infinity in a direction, seen from a point under a normal, over that of another technique.
    fn infinite_light_ratio<T: Tally>(&self, path: &Path<'a, T>, from: (Vec3, Vec3), direction: Vec3, density: f32) -> f32 {
        let lights = self.scene.lights();
        let environment = lights
            .environment
            .as_ref()
            .map_or(0.0, |environment| lights.environment_probability(from.0, from.1, path.flash) * environment.pdf(direction));
        let discs = lights.discs(direction, Some(from), &path.camera.wavelengths, path.flash);
        squared_ratio(environment, density) + discs.map(|(_, _, disc)| squared_ratio(disc, density)).sum::<f32>()
    }
}

/// Whether rays end at a lamp of a material wherever they meet it: others are left to scattered rays.
pub(super) fn stops_rays(lamp: &Material) -> bool {
    matches!(lamp.coverage, Coverage::Full) && !lamp.may_transmit_straight()
}

//! Next-event estimation over flat mirrors.
//!
//! What a mirror sends on from a lamp to a rough surface would be found by scattered rays alone. The lamp is sampled from the image of the vertex in the mirror, and the direction turned back: there the mirror shows that place of
//! the lamp. As through glass ([`super::through_glass`]) a light sample is then a density of directions at the vertex. The ray is followed over specular surfaces and brings what shines where it ends; scattered rays find the same
//! light, and both are weighted by multiple importance sampling (power heuristic, Veach 1997, §9.2). For the scattered ray the density of the light sample is that of the first lamp along the straight line behind the mirror. Unbiased
//! also where shading normals bend what the mirror shows.
//!
//! Of lamps of a finite size alone: the sky through a window is seldom where a mirror shows it. Not where something moves, in media that scatter, nor beside light paths, which find such light themselves. Measured: `docs/decisions/clear-glass.md`.

use super::path::{Path, SurfaceVertex, Transport};
use super::prev_scatter::{LineToLight, PrevScatter};
use super::tally::Tally;
use super::through_glass::{LightWay, stops_rays};
use super::to_light::shadow_segment;
use super::weights::squared_ratio;
use crate::light::LightRef;
use crate::scene::{Mirror, Mirrors, Visibility};
use crate::shape::Surface;
use diopter_light::Ray;
use diopter_light::random::Dimensions;
use glam::Vec3;

/// Relative distance behind a mirror up to which a ray is followed that is to meet it.
const BEYOND: f32 = 1e-3;

impl<'a> Transport<'a> {
    /// The mirrors over which lights are sampled from the vertices of a path.
    #[inline]
    fn mirrors_for<T: Tally>(&self, path: &Path<'a, T>) -> Option<&'a Mirrors> {
        self.scene.mirrors().filter(|_| !self.scene.lights().area.is_empty() && self.bends_light_samples(path))
    }

    /// Adds what a lamp sends over a mirror to a vertex; to be scattered there where `is_scattered`, else as it arrives from the side of the normal. Gives the unit direction from which it comes.
    #[inline]
    pub fn add_mirrored_light<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        is_scattered: bool,
    ) -> Option<Vec3> {
        let mirrors = self.mirrors_for(path)?;
        // Two scattering events at least: here and at the mirror.
        let may_add = !here.bsdf.is_specular() && path.depth() + 1 < self.settings.max_depth;
        if may_add { self.add_light_over(mirrors, path, here, is_scattered) } else { None }
    }

    #[inline(never)]
    fn add_light_over<T: Tally>(
        &self,
        mirrors: &Mirrors,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        is_scattered: bool,
    ) -> Option<Vec3> {
        let (scene, lights, point, time_s) = (self.scene, self.scene.lights(), here.surface.point, path.ray.time_s);
        let u = path.camera.sampler.get(Dimensions::Mirrored(path.vertex));
        let (mirror, mirror_probability) = mirrors.choose(point, u[3])?;
        if here.bsdf.only_reflects() && !mirror.rises_above(point, here.ng) {
            return None;
        }
        let (image, normal) = (mirror.image(point), mirror.turned(here.bsdf.light_normal()));
        let (light, probability) = lights.choose(image, normal, u[2], path.flash)?;
        let LightRef::Area(number) = light else { return None };
        let light_sample = scene.sample_li(light, image, [u[0], u[1]], time_s)?;
        let behind = light_sample.wi;
        let reach = mirror.met(image, behind).filter(|reach| *reach < light_sample.distance)?;
        if !stops_rays(scene.material_at(lights.area[number as usize].material)) {
            return None;
        }
        let wi = mirror.turned(behind);
        let (f, by_scattering) = here.response(wi, is_scattered)?;
        let (origin, medium_stack) = here.leave(scene, path.medium_stack, wi);
        if !medium_stack.is_outside() {
            return None;
        }
        let ray = Ray { origin, direction: wi, time_s };
        let is_chosen = |hit: &Surface| mirrors.at(hit).is_some_and(|met| std::ptr::eq(met, mirror));
        let mut hit = scene.intersect(&ray, reach * (1.0 + BEYOND)).filter(is_chosen)?;
        let (shadow_ray, reach) = shadow_segment(image, behind_mirror(&hit, wi), &light_sample, time_s)?;
        if scene.visibility(&shadow_ray, reach) == Visibility::Occluded {
            return None;
        }
        let by_light = mirror_probability * probability * light_sample.pdf;
        let throughput = path.throughput * f / (by_light * (1.0 + squared_ratio(by_scattering, by_light)));
        let way = LightWay { ray, throughput, medium_stack };
        self.add_light_along(path, here, way, &mut hit, path.camera.sampler.stream(Dimensions::Mirrored(path.vertex)));
        Some(wi)
    }

    /// The mirror that the ray of a path meets, where lights were sampled over it from its last vertex.
    #[inline]
    pub fn mirror_of_light_samples<T: Tally>(&self, path: &Path<'a, T>, surface: &Surface) -> Option<&'a Mirror> {
        let mirrors = self.mirrors_for(path)?;
        let from_vertex = path.last.is_some_and(|last| last.traveled == 0.0) && path.medium_stack.is_outside();
        if from_vertex { mirrors.at(surface) } else { None }
    }

    /// The line to the lights of which the last vertex of a path sees images in the mirror that its ray meets, where they were sampled: from the image of the vertex, behind the mirror.
    #[inline]
    pub fn line_over_mirror<T: Tally>(&self, path: &Path<'a, T>, surface: &Surface) -> Option<LineToLight> {
        let mirror = self.mirror_of_light_samples(path, surface)?;
        let last = path.last?;
        let probability = self.mirrors_for(path)?.probability(last.point, mirror);
        let from = PrevScatter {
            point: mirror.image(last.point),
            normal: mirror.turned(last.normal),
            density: last.density / probability,
            ..last
        };
        let direction = path.ray.direction;
        let ray = Ray { origin: behind_mirror(surface, direction), direction: mirror.turned(direction), ..path.ray };
        Some(LineToLight { from, ray, over_mirror: true })
    }
}

/// Where a ray starts that comes from a mirror which another one met in a direction.
fn behind_mirror(surface: &Surface, direction: Vec3) -> Vec3 {
    surface.beside(if surface.ng.dot(direction) < 0.0 { surface.ng } else { -surface.ng })
}

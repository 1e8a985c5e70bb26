//! What a denoiser is guided by: albedo and normals of the first surface that scatters, seen through smooth glass and in mirrors.
//!
//! Behind a pane or in a mirror the features of the pane itself are even and say nothing about the picture in it. As the documentation of Open Image
//! Denoise advises ("Albedo", "Normals"), the path is followed through smooth surfaces, of two ways the one that more light takes, up to the
//! first that is diffuse or glossy; what it shows is tinted by what lies before it.

use crate::material::Scattering;
use crate::medium_stack::Immersion;
use crate::radiance::FirstSurface;
use crate::scene::Scene;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Smooth surfaces that are followed: two balls of glass behind one another.
const MOST_SMOOTH: u32 = 8;
/// Surfaces that are met in all, faces of media and of hidden bodies included.
const MOST_SURFACES: u32 = 64;

impl Scene {
    /// The first surface along a ray that is neither mirror nor smooth glass; distance and object are those of [`Scene::first_surface`]. Albedo and
    /// normal are 0 where the path leaves the scene behind glass; `None` where the ray meets nothing. `immersion`: what the ray begins in
    /// ([`Scene::immersion_at`]).
    pub fn first_rough_surface(&self, ray: &Ray, immersion: Immersion) -> Option<FirstSurface> {
        self.first_rough(ray, immersion).map(|(surface, _)| surface)
    }

    /// Where the surface of [`Scene::first_rough_surface`] lies in world space, m; `None` where the path leaves the scene.
    pub fn first_rough_point(&self, ray: &Ray, immersion: Immersion) -> Option<Vec3> {
        self.first_rough(ray, immersion)?.1
    }

    /// The surface, and where it lies unless the path leaves the scene.
    fn first_rough(&self, ray: &Ray, Immersion(mut medium_stack): Immersion) -> Option<(FirstSurface, Option<Vec3>)> {
        let first = self.first_surface(ray)?;
        let wavelengths = SampledWavelengths::rgb();
        let mut ray = *ray;
        let (mut tint, mut smooth) = (SampledSpectrum::ONE, 0);
        for _ in 0..MOST_SURFACES {
            let Some(surface) = self.intersect(&ray, f32::INFINITY) else {
                return Some((FirstSurface { normal: Vec3::ZERO, albedo: Vec3::ZERO, ..first }, None));
            };
            let material = self.material(surface.object);
            let entering = surface.ng.dot(ray.direction) < 0.0;
            let beyond = surface.leave(if entering { -surface.ng } else { surface.ng }, ray.direction);
            if medium_stack.hides(self, surface.object, entering) || matches!(material.scattering, Scattering::Interface) {
                medium_stack.cross(self, surface.object, entering);
                ray.origin = beyond;
                continue;
            }
            let side = if entering { 1.0 } else { -1.0 };
            let albedo = tint.truncate().clamp(Vec3::ZERO, Vec3::ONE) * material.albedo(&surface);
            let here = (FirstSurface { normal: surface.ns * side, albedo, ..first }, Some(surface.point));
            let around = medium_stack.around(self, surface.object);
            let Some(bsdf) = material.bsdf(&surface, -ray.direction, &wavelengths, false, around) else { return Some(here) };
            if !bsdf.is_specular() || smooth == MOST_SMOOTH {
                return Some(here);
            }
            // The number 0.5 chooses the likelier of two ways.
            let Some(scatter) = bsdf.sample([0.5; 4]) else { return Some(here) };
            // Radiance scales with the square of the index, what is seen does not.
            tint *= scatter.weight * scatter.eta_scale;
            smooth += 1;
            if scatter.transmitted {
                medium_stack.cross(self, surface.object, entering);
                ray.origin = beyond;
            } else {
                ray.origin = surface.leave(if entering { surface.ng } else { -surface.ng }, scatter.wi);
            }
            ray.direction = scatter.wi;
        }
        Some((first, None))
    }
}

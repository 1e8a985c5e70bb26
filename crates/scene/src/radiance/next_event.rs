//! Next-event estimation: light of one lamp, chosen where a path was scattered. Which light, and what it would bring, is one step; what is on the way of its shadow ray, the next.

use super::light_connection::LightConnection;
use super::path::{Path, SurfaceVertex, Transport};
use super::tally::Tally;
use super::through_glass::Densities;
use super::to_light::ShadowRay;
use super::weights::squared_ratio;
use crate::light_paths::LightVertices;
use crate::light_paths::connect::CameraVertex;
use diopter_light::SampledSpectrum;
use diopter_light::random::Dimensions;
use glam::Vec3;

/// Where the light comes from that was chosen for a vertex.
#[derive(Clone, Copy)]
pub(super) struct LightChoice {
    /// Unit direction.
    pub wi: Vec3,
    /// Whether the light has extent, so that a scattered ray could have met it.
    pub has_extent: bool,
}

impl<'a> Transport<'a> {
    /// Chooses a light for a vertex of a path by numbers from 0 to 1, and a place on it; none where it brings nothing even if nothing is on the way. What comes is scattered into the path
    /// where `is_scattered`; where not, it arrives there as it is, from the side of the normal, whether the surface scatters it or not. Gives where it comes from.
    #[inline(always)]
    pub fn choose_light<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        u: [f32; 4],
        camera_vertex: Option<&(&LightVertices, CameraVertex<'_, 'a>)>,
        is_scattered: bool,
    ) -> Option<LightChoice> {
        let (surface, bsdf, time_s) = (here.surface, here.bsdf, path.ray.time_s);
        if bsdf.is_specular() {
            return None;
        }
        let (light, probability) = self.scene.lights().choose(surface.point, bsdf.light_normal(), u[2], path.flash)?;
        let light_sample = self.scene.sample_li(light, surface.point, [u[0], u[1]], time_s)?;
        let (f, pdf) = here.response(light_sample.wi, is_scattered)?;
        let density = probability * light_sample.pdf;
        let by_chance = if light_sample.has_extent { squared_ratio(pdf, density) } else { 0.0 };
        let weight = 1.0 / (1.0 + by_chance);
        let by_connection =
            camera_vertex.map_or(0.0, |(pool, here)| here.connection_ratio_to_light_sample(pool, light, &light_sample, density));
        let visibility = match light_sample.has_extent && self.samples_light_through_glass(path) {
            true => self.add_refracted_light(path, here, &light_sample, f, Densities { by_light: density, by_scattering: pdf }),
            false => None,
        };
        let incident = self.scene.incident_radiance(&light_sample, &path.camera.wavelengths, time_s);
        let contribution = path.throughput * f * incident * (weight / density);
        let choice = LightChoice { wi: light_sample.wi, has_extent: light_sample.has_extent };
        if contribution == SampledSpectrum::ZERO {
            return Some(choice);
        }
        let (origin, medium_stack) = here.leave(self.scene, path.medium_stack, light_sample.wi);
        let tallied = path.tally.vertex(bsdf, here.wo, light_sample.wi);
        let (point, vertex, depth) = (surface.point, path.vertex, path.depth());
        path.connection = Some(LightConnection {
            light_sample,
            contribution,
            point,
            origin,
            medium_stack,
            by_chance,
            by_connection,
            vertex,
            depth,
            tallied,
            visibility,
        });
        Some(choice)
    }

    /// Adds what the light brings that was chosen for a vertex of a path, less what is on the way.
    #[inline]
    pub fn connect_to_light<T: Tally>(&self, path: &mut Path<'a, T>) {
        let Some(connection) = &path.connection else { return };
        let &LightConnection { ref light_sample, contribution, by_chance, by_connection, depth, .. } = connection;
        let camera = path.camera;
        let stream = || camera.sampler.stream(Dimensions::Transmittance(connection.vertex));
        let mut passed = T::ThinDielectrics::default();
        let shadow_ray = self.scene.shadow_ray(
            &mut passed,
            contribution,
            connection.point,
            connection.origin,
            light_sample,
            connection.medium_stack,
            connection.visibility,
            &camera.wavelengths,
            path.ray.time_s,
            self.settings.max_depth - depth - 1,
            stream,
        );
        let ShadowRay { light: transmitted, thin_dielectrics: crossed, .. } = shadow_ray;
        let transmitted = match by_connection > 0.0 && shadow_ray.lets_light_paths_through(light_sample.distance) {
            true => transmitted * ((1.0 + by_chance) / (1.0 + by_chance + by_connection)),
            false => transmitted,
        };
        let events = depth + 1 + crossed;
        path.tally.add_scattered(transmitted, events, &connection.tallied, &passed, || self.scene.polarization(light_sample));
        path.connection = None;
    }
}

//! What is between a point and a light: surfaces, faces of media, media and thin dielectrics.

use super::tally::ThinDielectrics;
use crate::light::LightSample;
use crate::material::Scattering;
use crate::medium_stack::MediumStack;
use crate::scene::{Scene, Visibility};
use crate::shape::Surface;
use diopter_light::random::{Dimensions, Sampler, SamplerKind, Stream, mix};
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::Vec3;

impl Scene {
    /// Whether a surface is the face of a medium and nothing else.
    pub(super) fn is_interface(&self, surface: &Surface) -> bool {
        self.has_straight_transmission() && matches!(self.material(surface.object).scattering, Scattering::Interface)
    }

    /// What is left of light that was sampled from `point`, on its way from there (`origin`: the point, moved off its surface), through faces of
    /// media and up to so many thin dielectrics. `stream` makes the numbers for media that differ from place to place.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn transmittance_to_light(
        &self,
        light: SampledSpectrum,
        point: Vec3,
        origin: Vec3,
        light_sample: &LightSample,
        medium_stack: MediumStack,
        wavelengths: &SampledWavelengths,
        time_s: f32,
        thin_dielectrics: u32,
        stream: impl Fn() -> Stream,
    ) -> SampledSpectrum {
        let stack = medium_stack;
        self.shadow_ray(&mut (), light, point, origin, light_sample, stack, None, wavelengths, time_s, thin_dielectrics, stream)
            .light
    }

    /// The same, and what was on the way; `known`: what is known already of the line from its start.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn shadow_ray(
        &self,
        passed: &mut impl ThinDielectrics,
        light: SampledSpectrum,
        point: Vec3,
        mut origin: Vec3,
        light_sample: &LightSample,
        mut medium_stack: MediumStack,
        mut known: Option<Visibility>,
        wavelengths: &SampledWavelengths,
        time_s: f32,
        mut thin_dielectrics: u32,
        stream: impl Fn() -> Stream,
    ) -> ShadowRay {
        let nothing = ShadowRay { light: SampledSpectrum::ZERO, is_blocked: false, thin_dielectrics: 0 };
        let mut is_blocked = false;
        let most = thin_dielectrics;
        if light == SampledSpectrum::ZERO {
            return nothing;
        }
        let mut left = light;
        // One stream for all media on the way.
        let mut numbers = None;
        for _ in 0..MAX_INTERFACES {
            let Some((ray, reach)) = shadow_segment(point, origin, light_sample, time_s) else {
                return ShadowRay { light: left, is_blocked, thin_dielectrics: most - thin_dielectrics };
            };
            let direction = ray.direction;
            let known = known.take();
            let face = match self.has_straight_transmission() {
                false if known.map_or_else(|| self.occluded(&ray, reach), |known| known != Visibility::Unoccluded) => {
                    return nothing;
                }
                false => None,
                true => match known.unwrap_or_else(|| self.visibility(&ray, reach)) {
                    Visibility::Occluded => return nothing,
                    Visibility::Unoccluded => None,
                    Visibility::Unknown => self.intersect(&ray, reach),
                },
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
                is_blocked |= !bsdf.is_specular();
                passed.cross(&bsdf, direction);
            } else {
                is_blocked |= face.is_some();
            }
            if let Some((medium, span)) = medium_stack.span(self, &ray, face.as_ref().map_or(reach, |f| f.t)) {
                is_blocked = true;
                let moment_s = self.moment_s(time_s);
                left *= medium.transmittance(&ray, span, wavelengths, moment_s, || numbers.get_or_insert_with(&stream));
            }
            let Some(face) = face else {
                return ShadowRay { light: left, is_blocked, thin_dielectrics: most - thin_dielectrics };
            };
            medium_stack.cross(self, face.object, face.ng.dot(direction) < 0.0);
            origin = origin_behind(&face, direction);
        }
        nothing
    }
}

/// The ray from `origin` towards the place of a light that was sampled from `point`, and how far it goes, m: the start was moved off its surface, and it ends before the lamp
/// itself. `None` where the start lies there already.
#[inline]
pub(super) fn shadow_segment(point: Vec3, origin: Vec3, light_sample: &LightSample, time_s: f32) -> Option<(Ray, f32)> {
    if !light_sample.distance.is_finite() {
        return Some((Ray { origin, direction: light_sample.wi, time_s }, f32::INFINITY));
    }
    let to = point + light_sample.wi * light_sample.distance - origin;
    let distance = to.length();
    let reach = distance - light_sample.clearance;
    (reach > 0.0).then(|| (Ray { origin, direction: to / distance, time_s }, reach))
}

/// What a shadow ray leaves of light that was sampled.
pub(crate) struct ShadowRay {
    /// Radiance, or what stands for it.
    pub light: SampledSpectrum,
    /// Whether it went through what ends light paths: a medium, a face of one, a thin dielectric that scatters, too.
    is_blocked: bool,
    /// Thin dielectrics on the way.
    pub thin_dielectrics: u32,
}

impl ShadowRay {
    /// Whether light paths come along this way: through nothing, from infinitely far also through thin dielectrics.
    pub(super) fn lets_light_paths_through(&self, distance: f32) -> bool {
        !self.is_blocked && (self.thin_dielectrics == 0 || distance == f32::INFINITY)
    }
}

/// Most faces of media that a path goes through between two surfaces, and segments after which it is given up at such a face.
pub(crate) const MAX_INTERFACES: u32 = 4096;

/// Numbers for the media on the way of light from a point that no sampler belongs to: by a hash of where the ray runs, as whether a surface with holes is
/// met.
pub(crate) fn stream_along(point: Vec3, direction: Vec3) -> Stream {
    let hash = |v: Vec3| v.to_array().iter().fold(0, |h, x| mix(h ^ x.to_bits()));
    let seed = u64::from(hash(point)) << 32 | u64::from(hash(direction));
    Sampler::new(SamplerKind::Independent, seed, (0, 0), 0, 1).stream(Dimensions::Transmittance(0))
}

/// A start just behind a face that a ray goes through.
pub(crate) fn origin_behind(surface: &Surface, direction: Vec3) -> Vec3 {
    surface.leave(if surface.ng.dot(direction) > 0.0 { surface.ng } else { -surface.ng }, direction)
}

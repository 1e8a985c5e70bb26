//! Directions about lamps, from where a path is scattered in or before a medium: light that the medium scatters near a lamp, which paths meet by chance.
//!
//! Around a small lamp the light that a medium scatters grows with one over the distance of a ray from the lamp; equi-angular samples draw the place along the
//! ray well, but the ray itself has a direction that knows nothing of the lamp: the squares of its samples have no bound. Here a direction is drawn about the lamp,
//! with a density of 1 / (2π² sin θ) over the angle θ from it, and the place along it equi-angularly: together as 1 / (sin θ r²) asks for. Source: I. Georgiev,
//! J. Křivánek, T. Hachisuka, D. Nowrouzezahrai & W. Jarosz 2013, "Joint Importance Sampling of Low-Order Volumetric Scattering", ACM TOG 32(6), §5.

use super::medium_segment::MediumSegment;
use super::prev_scatter::SegmentStart;
use crate::light::LightRef;
use crate::light::segment::Pivot;
use crate::medium_stack::MediumStack;
use crate::scene::Scene;
use diopter_light::random::Dimensions;
use diopter_light::{Ray, SampledSpectrum, sampling};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Least fraction of the vertices from which a light is sought: where the medium is thin on the way to it, little is scattered there.
const RAREST: f32 = 0.1;

/// Optical depth to a light from which on it is sought always.
const DEEP: f32 = 0.5;

impl SegmentStart {
    /// Density of a direction by joint samples of a light, its choice included, 1/sr; `extinction`: mean of the medium, 1/m.
    pub fn joint(&self, scene: &Scene, light: LightRef, pivot: &Pivot, direction: Vec3, extinction: f32, flash: bool) -> f32 {
        let to = pivot.position - self.point;
        let distance = to.length();
        let sine = (to / distance).cross(direction).length();
        let chosen = scene.lights().finite_probability(self.point, light, flash) * fraction(extinction, distance);
        match chosen / (2.0 * PI * PI * sine) {
            density if density.is_finite() => density,
            _ => 0.0,
        }
    }
}

/// Fraction of the vertices at a distance (m) from a light at which it is sought.
fn fraction(extinction: f32, distance: f32) -> f32 {
    (extinction * distance / DEEP).clamp(RAREST, 1.0)
}

/// Where a path is scattered: on a segment in a medium, or at the surface at its end.
pub(super) struct Vertex<'a> {
    pub segment: &'a MediumSegment<'a>,
    pub point: Vec3,
    /// Scattering events before.
    pub depth: u32,
}

impl Vertex<'_> {
    /// Adds light of a lamp that is scattered here and once before, near the lamp. `scatter`: what is scattered from a direction towards which a ray is sent, and
    /// the density (1/sr) with which the path draws it; `leave`: where that ray starts, and in what; `add`: adds light that was scattered so often and arrives from that
    /// direction. Says whether lights were sought, so that other strategies are
    /// weighted by it.
    pub fn joint(
        &self,
        throughput: SampledSpectrum,
        scatter: impl Fn(Vec3) -> (SampledSpectrum, f32),
        leave: impl Fn(Vec3) -> (Vec3, MediumStack),
        add: impl FnOnce(SampledSpectrum, u32, Vec3),
    ) -> bool {
        let s = self.segment;
        let scene = s.scene;
        if self.depth + 2 > s.settings.max_depth || !scene.lights().has_finite(s.flash) {
            return false;
        }
        let mut stream = s.sampler.stream(Dimensions::Joint(s.vertex));
        let [choice, polar, around, taken, along, x, y] = [(); 7].map(|()| stream.draw());
        let Some((light, _)) = scene.lights().choose(self.point, Vec3::ZERO, choice, s.flash) else { return true };
        let Some(pivot) = scene.pivot(light, s.ray.time_s) else { return true };
        let to = pivot.position - self.point;
        let distance = to.length();
        let extinction = 0.25 * s.medium.at(s.wavelengths).extinction.element_sum();
        if !(distance > 0.0) || taken >= fraction(extinction, distance) {
            return true;
        }
        let axis = to / distance;
        let ((sin, cos), (b, a)) = ((PI * polar).sin_cos(), (TAU * around).sin_cos());
        let (u, v) = sampling::frame(axis);
        let direction = (u * (sin * a) + v * (sin * b) + axis * cos).normalize();
        let (f, density) = scatter(direction);
        if f == SampledSpectrum::ZERO || !(density > 0.0) {
            return true;
        }
        let (origin, medium_stack) = leave(direction);
        let ray = Ray { origin, direction, time_s: s.ray.time_s };
        let reach = scene.intersect(&ray, f32::INFINITY).map_or(f32::INFINITY, |surface| surface.t);
        let Some((medium, span)) = medium_stack.span(scene, &ray, reach) else { return true };
        // The same medium: how often a light is sought depends on it.
        if !std::ptr::eq(medium, s.medium) {
            return true;
        }
        let start = Some(SegmentStart { point: self.point, density });
        let onward = MediumSegment { medium, span, ray, medium_stack, vertex: s.vertex + 1, depth: self.depth + 1, start, ..*s };
        // Over the density of the path's direction: the weights compare with it.
        if let Some(shadow_ray) = onward.sample_light_jointly(light, throughput * f / density, [along, x, y]) {
            add(shadow_ray.light, self.depth + 2 + shadow_ray.thin_dielectrics, direction);
        }
        true
    }
}

//! Paths of a group lend one another what they see of the environment.
//!
//! A light sample of the environment that nothing hides, and a scattered ray that leaves the scene, found a direction in which one receiver of the group sees the sky: through a window, between blinds. The
//! other receivers mostly see it in that direction, too, and would seldom have drawn it. A shadow ray of each tells, and what arrives is weighted by the balance heuristic over all techniques of all receivers that
//! see the sky there (the light sample and the scattered ray of each): unbiased, and no weight is larger than that of the path alone. Light that comes through panes, faces of media and surfaces that let rays through by
//! chance serves its own path alone.
//!
//! Sources: Bekaert, Sbert & Halton 2002, "Accelerating Path Tracing by Re-Using Paths", EGWR; Veach 1997, §9.2 (balance heuristic).

use super::path::{Path, Transport};
use super::receiver::{Receiver, Receivers, Sight};
use super::reuse_extent::{LightLevel, mean, within};
use super::tally::Tally;
use crate::bvh::packet::Bundle;
use crate::light::LightPoint;
use diopter_light::SampledSpectrum;
use glam::Vec3;

/// What a path of the group saw of the environment from its receiver.
pub(super) struct SkySample {
    pub path: usize,
    /// Scattering events before the receiver: others after as many are lent to, so that direct light stays what paths of one event have.
    depth: u32,
    /// Unit direction.
    wi: Vec3,
    radiance: SampledSpectrum,
    /// Of light samples of the environment, 1/sr.
    density: f32,
}

impl SkySample {
    /// About what it brings to a white surface that faces it: radiance over the densities of a light sample and of a scattered ray.
    #[inline]
    pub fn brightness(&self) -> f32 {
        mean(self.radiance) / (1.0 + std::f32::consts::PI * self.density)
    }
}

impl<'a> Transport<'a> {
    /// The light sample of a path at its receiver, where it is of the environment and nothing hides it: it is then no longer the path's own.
    pub fn take_sky_sample<T: Tally>(&self, path: &mut Path<'a, T>, receiver: &Receiver) -> Option<SkySample> {
        let light_sample = &path.connection.as_ref()?.light_sample;
        let wi = light_sample.wi;
        if !matches!(light_sample.spot, LightPoint::Environment(_)) || wi.dot(receiver.ng) <= 0.0 {
            return None;
        }
        let sees_sky = self.sees_sky(receiver, wi);
        // What hides it may let it through: then it is the path's own.
        if sees_sky || !self.scene.lets_some_light_through() {
            path.connection = None;
        }
        if sees_sky { self.sky_sample(path, receiver, wi) } else { None }
    }

    /// What the ray of a path brings that left its receiver and met nothing; `None` where something may hide the sky after all.
    pub fn scattered_to_sky<T: Tally>(&self, path: &Path<'a, T>, receiver: &Receiver) -> Option<SkySample> {
        let wi = path.ray.direction;
        // Its ray is the shadow ray, but where it may have gone through a surface by chance.
        if self.scene.has_blends() && !self.sees_sky(receiver, wi) {
            return None;
        }
        self.sky_sample(path, receiver, wi)
    }

    fn sees_sky(&self, receiver: &Receiver, wi: Vec3) -> bool {
        let (ray, reach) = receiver.ray_towards(wi);
        !self.scene.may_be_occluded(&ray, reach)
    }

    fn sky_sample<T: Tally>(&self, path: &Path<'a, T>, receiver: &Receiver, wi: Vec3) -> Option<SkySample> {
        let environment = self.scene.lights().environment.as_ref()?;
        let (radiance, density) = (environment.radiance(wi, &path.camera.wavelengths), environment.pdf(wi));
        Some(SkySample { path: receiver.path, depth: receiver.depth, wi, radiance, density })
    }

    /// Adds what samples of the environment bring to the receivers that they are lent to.
    pub fn lend_sky<T: Tally>(
        &self,
        receivers: &Receivers<'a>,
        samples: &[SkySample],
        level: LightLevel,
        tallies: &mut [T],
        sight: &mut Sight,
    ) {
        let mut lent: Vec<(&Receiver, SampledSpectrum)> = Vec::with_capacity(receivers.all.len());
        for sample in samples.iter().filter(|sample| sample.radiance != SampledSpectrum::ZERO) {
            lent.clear();
            let part = level.part_for_sky(sample.brightness(), sample.path, tallies.len());
            let faces = |receiver: &Receiver| receiver.depth == sample.depth && sample.wi.dot(receiver.ng) > 0.0;
            let (among, bundle) = (within(&receivers.all, &part), Bundle::Along(sample.wi));
            let mut density = 0.0;
            for &number in sight.of(self.scene, &receivers.all, among, sample.path, bundle, faces) {
                let receiver = &receivers.all[number];
                let (f, pdf) = receivers.eval(receiver, sample.wi);
                if f == SampledSpectrum::ZERO {
                    continue;
                }
                density += receiver.sky_probability * sample.density + pdf;
                lent.push((receiver, receiver.throughput * f));
            }
            for (receiver, onward) in &lent {
                let light = *onward * sample.radiance / density;
                if light.is_finite() {
                    tallies[receiver.path].add(light, receiver.depth + 1);
                }
            }
        }
    }
}

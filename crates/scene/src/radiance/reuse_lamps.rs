//! Paths of a group lend one another what they see of lamps.
//!
//! A light sample on a lamp with extent that nothing hides, and a scattered ray that meets one, found a place that shines at one receiver of the group. The others see it, too, or do not: a shadow ray of each tells, and what
//! arrives is weighted by the balance heuristic over all techniques of all receivers that see the place (the light sample and the scattered ray of each), as light of the sky is ([`super::reuse_sky`]). Lamps that
//! rays go through by chance, and light that comes through panes, faces of media and surfaces of partial opacity, serve their own path alone.
//!
//! Sources: Bekaert, Sbert & Halton 2002, "Accelerating Path Tracing by Re-Using Paths", EGWR; Veach 1997, §9.2 (balance heuristic).

use super::path::{Path, Transport};
use super::receiver::{Receiver, Receivers, Sight, Way};
use super::reuse_extent::{LightLevel, within};
use super::tally::Tally;
use super::weights::squared_ratio;
use crate::bvh::packet::Bundle;
use crate::light::LightPoint;
use crate::material::{Coverage, Material, Scattering};
use crate::shape::{Surface, offset_origin};
use diopter_light::SampledSpectrum;
use glam::Vec3;

/// A place on a lamp that a path of the group saw from its receiver.
pub(super) struct LampSample {
    pub path: usize,
    /// Scattering events before the receiver: others after as many are lent to, so that direct light stays what paths of one event have.
    pub depth: u32,
    flash: bool,
    /// Number of the lamp among the area lights.
    light: u32,
    point: Vec3,
    /// Where shadow rays end.
    end: Vec3,
    /// Unit normal on the side that is seen.
    normal: Vec3,
    radiance: SampledSpectrum,
    /// What it brings to its own path alone.
    pub own: SampledSpectrum,
}

impl LampSample {
    /// A place by point, normal and where shadow rays to it end, which is seen from a receiver; its radiance, and what it brings to the receiver's own path.
    fn new(receiver: &Receiver, light: u32, [point, normal, end]: [Vec3; 3], [radiance, own]: [SampledSpectrum; 2]) -> Self {
        let &Receiver { path, depth, flash, .. } = receiver;
        LampSample { path, depth, flash, light, point, end, normal, radiance, own }
    }
}

impl<'a> Transport<'a> {
    /// The light sample of a path at its receiver, where it is of a lamp with extent and nothing hides it: it is then no longer the path's own.
    pub fn take_lamp_sample<T: Tally>(&self, path: &mut Path<'a, T>, receiver: &Receiver) -> Option<LampSample> {
        let connection = path.connection.as_ref()?;
        let (light_sample, own) = (&connection.light_sample, connection.contribution);
        let LightPoint::Area(light, _) = light_sample.spot else { return None };
        let lamp = &self.scene.lights().area[light as usize];
        if !is_certain(self.scene.material_at(lamp.material)) || light_sample.wi.dot(receiver.ng) <= 0.0 {
            return None;
        }
        let point = receiver.point + light_sample.wi * light_sample.distance;
        let normal = lamp.outer_normal(point);
        let normal = if normal.dot(light_sample.wi) > 0.0 { -normal } else { normal };
        let radiance = self.scene.incident_radiance(light_sample, &path.camera.wavelengths, path.ray.time_s);
        let sample =
            LampSample::new(receiver, light, [point, normal, offset_origin(point, normal, lamp.reach())], [radiance, own]);
        let is_seen = !receiver.may_not_see(self.scene, sample.end);
        // What hides it may let it through: then it is the path's own.
        if is_seen || !self.scene.lets_some_light_through() {
            path.connection = None;
        }
        is_seen.then_some(sample)
    }

    /// The lamp that the ray of a path meets which left its receiver; `None` where it is the path's own.
    pub fn scattered_to_lamp<T: Tally>(&self, path: &Path<'a, T>, receiver: &Receiver, surface: &Surface) -> Option<LampSample> {
        let (scene, direction) = (self.scene, path.ray.direction);
        let light = scene.light_at(surface)?;
        let material = scene.material(surface.object);
        let emission = material.emission.as_ref()?;
        let last = path.last?;
        if !is_certain(material) {
            return None;
        }
        let cos = surface.ng.dot(direction);
        if cos > 0.0 && !emission.two_sided || cos == 0.0 {
            return None;
        }
        let normal = if cos > 0.0 { -surface.ng } else { surface.ng };
        let by_light = self.light_sample_density(receiver, light, direction, surface.t);
        let radiance = emission.at(surface, &path.camera.wavelengths) * scene.modulation(material, path.ray.time_s);
        let own = path.throughput * radiance / (1.0 + squared_ratio(by_light, last.density));
        let sample = LampSample::new(receiver, light, [surface.point, normal, surface.beside(normal)], [radiance, own]);
        // The path itself may have gone through a blended surface.
        let is_seen = !scene.has_blends() || !receiver.may_not_see(self.scene, sample.end);
        is_seen.then_some(sample)
    }

    /// Density of the light samples of a receiver towards a point of an area light, 1/sr.
    #[inline]
    fn light_sample_density(&self, receiver: &Receiver, light: u32, wi: Vec3, distance: f32) -> f32 {
        let chosen = self.scene.lights().area_probability(receiver.point, receiver.ng, light, receiver.flash);
        chosen * self.scene.pdf_li(light, receiver.point, wi, distance, receiver.time_s)
    }

    /// Adds what places on lamps bring to the receivers that they are lent to.
    pub fn lend_lamps<T: Tally>(
        &self,
        receivers: &Receivers<'a>,
        samples: &[LampSample],
        level: LightLevel,
        tallies: &mut [T],
        sight: &mut Sight,
    ) {
        // What of its radiance goes on for a density of 1/m² on the lamp.
        let mut lent: Vec<(&Receiver, SampledSpectrum)> = Vec::with_capacity(receivers.all.len());
        for sample in samples {
            let part = level.part_for_lamp(sample.path, tallies.len());
            if part.len() == 1 {
                tallies[sample.path].add(sample.own, sample.depth + 1);
                continue;
            }
            lent.clear();
            let faces = |receiver: &Receiver| {
                receiver.depth == sample.depth
                    && receiver.flash == sample.flash
                    && receiver.way_to(sample.point, sample.normal).is_some()
            };
            let (among, bundle) = (within(&receivers.all, &part), Bundle::Towards(sample.end));
            let mut density = 0.0;
            for &number in sight.of(self.scene, &receivers.all, among, sample.path, bundle, faces) {
                let receiver = &receivers.all[number];
                let Some(Way { wi, distance, geometry }) = receiver.way_to(sample.point, sample.normal) else { continue };
                let (f, pdf) = receivers.eval(receiver, wi);
                if f == SampledSpectrum::ZERO {
                    continue;
                }
                density += (self.light_sample_density(receiver, sample.light, wi, distance) + pdf) * geometry;
                lent.push((receiver, receiver.throughput * f * geometry));
            }
            let radiance = sample.radiance / density;
            for (receiver, onward) in &lent {
                let light = *onward * radiance;
                if light.is_finite() {
                    tallies[receiver.path].add(light, receiver.depth + 1);
                }
            }
        }
    }
}

/// Whether rays meet a lamp of a material wherever they come to it.
fn is_certain(material: &Material) -> bool {
    matches!(material.coverage, Coverage::Full) && !material.is_mixed() && !matches!(material.scattering, Scattering::Interface)
}

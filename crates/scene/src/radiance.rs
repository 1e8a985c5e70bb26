//! The path tracer: one ray in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. Limits: caustics of small lights through glass are left to chance; bodies do
//! not nest.

use crate::light::Aim;
use crate::material::Material;
use crate::scene::Scene;
use crate::shape::{Surface, offset_origin};
use diopter_light::random::{Sampler, Set};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::Vec3;

/// How far paths are followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSettings {
    /// Most scattering events of a path; 0 shows only what shines by itself.
    pub max_depth: u32,
    /// Scattering events before Russian roulette starts.
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
        let s = self.intersect(ray, f32::INFINITY)?;
        let side = if s.ng.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let albedo = self.material(s.object).albedo(&s);
        Some(FirstSurface { distance: s.t, normal: s.ns * side, albedo, object: s.object })
    }

    /// Spectral radiance that arrives at the ray's origin from its direction, W·m⁻²·sr⁻¹·nm⁻¹ at the four wavelengths; one
    /// random estimate, whose mean is the true value.
    pub fn radiance(&self, mut ray: Ray, wavelengths: &Wavelengths, sampler: &Sampler, settings: &PathSettings) -> Sampled {
        let mut radiance = Sampled::ZERO;
        let mut throughput = Sampled::ONE;
        // Colours do not part.
        let mut hero_only = wavelengths.is_rgb();
        // The body the path is in, and the last place light could have been aimed at from: point, normal, density.
        let mut body: Option<&Material> = None;
        let mut last: Option<(Vec3, Vec3, f32)> = None;
        let mut vertex = 0;
        let (time_s, flash) = (ray.time_s, self.flash_burns(ray.time_s));
        loop {
            let Some(surface) = self.intersect(&ray, f32::INFINITY) else {
                if let Some(environment) = &self.lights().environment {
                    let weight = last.map_or(1.0, |(p, n, pdf)| {
                        mis(pdf, self.lights().environment_probability(p, n, flash) * environment.pdf(ray.direction))
                    });
                    radiance += throughput * environment.radiance(ray.direction, wavelengths) * weight;
                }
                return radiance;
            };
            if let Some(absorption) = body.and_then(Material::absorption) {
                throughput *= absorption.transmittance(surface.t, wavelengths);
            }
            let material = self.material(surface.object);
            radiance += throughput * self.emitted(material, &surface, &ray, wavelengths, last, flash);

            if vertex >= settings.max_depth {
                return radiance;
            }
            let wo = -ray.direction;
            let Some(bsdf) = material.bsdf(&surface, wo, wavelengths, hero_only) else { return radiance };
            let ng = bsdf.side_normal();

            // Aim at a light.
            let u = sampler.get(Set::Light(vertex));
            if let Some((light, probability)) = self.lights().choose(surface.point, ng, u[2], flash)
                && let Some(aim) = self.aim(light, surface.point, [u[0], u[1]], time_s)
            {
                let (f, pdf) = bsdf.eval(aim.wi);
                if f != Sampled::ZERO {
                    let density = probability * aim.pdf;
                    let weight = if aim.has_extent { mis(density, pdf) } else { 1.0 };
                    let side = if aim.wi.dot(ng) > 0.0 { ng } else { -ng };
                    let light = self.arriving(&aim, wavelengths, time_s);
                    // A body on the way takes its share, as it does from scattered rays.
                    let through = match aim.wi.dot(ng) > 0.0 {
                        true => body,
                        false => (surface.ng.dot(aim.wi) < 0.0).then_some(material),
                    };
                    let light = match through.and_then(Material::absorption) {
                        Some(absorption) if aim.distance.is_finite() => {
                            light * absorption.transmittance(aim.distance, wavelengths)
                        }
                        _ => light,
                    };
                    let contribution = throughput * f * light * (weight / density);
                    if contribution != Sampled::ZERO && self.sees(&surface, side, &aim, ray.time_s) {
                        radiance += contribution;
                    }
                }
            }

            // Go on in a direction light may have come from.
            let u = sampler.get(Set::Scatter(vertex));
            let Some(scatter) = bsdf.sample(u) else { return radiance };
            throughput *= scatter.weight;
            if scatter.disperses && !hero_only {
                throughput = Sampled::new(4.0 * throughput.x, 0.0, 0.0, 0.0);
                hero_only = true;
            }
            last = (!scatter.specular).then_some((surface.point, ng, scatter.pdf));
            if scatter.transmitted {
                let entering = surface.ng.dot(scatter.wi) < 0.0;
                body = entering.then_some(material);
            }
            vertex += 1;

            // Russian roulette on what the path can still bring.
            if vertex >= settings.roulette_depth {
                let survival = throughput.max_element().clamp(0.0, 0.95);
                if u[3] >= survival {
                    return radiance;
                }
                throughput /= survival;
            }
            let normal = if scatter.transmitted { -ng } else { ng };
            ray = Ray { origin: offset_origin(surface.point, normal), direction: scatter.wi, time_s: ray.time_s };
        }
    }

    /// Radiance a surface sends back along the ray by itself, weighted against having been aimed at.
    #[inline]
    fn emitted(
        &self,
        material: &Material,
        surface: &Surface,
        ray: &Ray,
        wavelengths: &Wavelengths,
        last: Option<(Vec3, Vec3, f32)>,
        flash: bool,
    ) -> Sampled {
        let Some(emission) = &material.emission else { return Sampled::ZERO };
        if !emission.two_sided && surface.ng.dot(ray.direction) > 0.0 {
            return Sampled::ZERO;
        }
        let weight = match (last, self.light_at(surface)) {
            (Some((p, n, pdf)), Some(light)) => {
                let lights = self.lights();
                let aimed = self.aimed_density(light, p, ray.direction, surface.t, ray.time_s);
                mis(pdf, lights.area_probability(p, n, light, flash) * aimed)
            }
            _ => 1.0,
        };
        emission.sample(&surface.uv, wavelengths) * (weight * self.modulation(material, ray.time_s))
    }

    fn sees(&self, surface: &Surface, side: Vec3, aim: &Aim, time_s: f32) -> bool {
        let origin = offset_origin(surface.point, side);
        if aim.distance.is_infinite() {
            return !self.occluded(&Ray { origin, direction: aim.wi, time_s }, f32::INFINITY);
        }
        // The start was moved: aim anew at the same place, and stop just short of the lamp itself.
        let to = surface.point + aim.wi * aim.distance - origin;
        let distance = to.length();
        distance == 0.0 || !self.occluded(&Ray { origin, direction: to / distance, time_s }, distance * (1.0 - 1e-4))
    }
}

/// Weight of the strategy with density `a` beside one with density `b` (power heuristic, Veach 1997 eq. 9.13).
#[inline]
fn mis(a: f32, b: f32) -> f32 {
    if b == 0.0 {
        return 1.0;
    }
    // A quotient first: squares of large densities overflow.
    let r = b / a;
    1.0 / (1.0 + r * r)
}

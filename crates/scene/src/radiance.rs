//! The path tracer: one ray in, spectral radiance out.
//!
//! Unidirectional, with next-event estimation to every kind of light, multiple importance sampling (Veach 1997, power
//! heuristic) and Russian roulette. Four wavelengths ride together (Wilkie et al. 2014); densities do not depend on the
//! wavelength except where a body disperses, and there the path goes on with its hero alone. Light goes from lights to the
//! camera; paths are followed the other way. In media (`radiance/media.rs`) distances are drawn by extinction and as lamps see the ray, directions by the phase
//! function. Light that is aimed at comes through smooth thin sheets (panes, bubbles). Caustics
//! of small lights are left to chance without photons ([`crate::light_paths`]). Limits: a path begins outside all bodies.

mod media;

use crate::light::{Aim, LightRef};
use crate::light_paths::{PhotonMap, Tail};
use crate::material::{Material, Scattering};
use crate::scene::Scene;
use crate::shape::{Surface, offset_origin};
use crate::within::Within;
use diopter_light::random::{Sampler, Set};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::Vec3;
use media::{After, MediumSegment, ScatteredOn};

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
        let (mut s, mut start, mut gone) = (self.intersect(ray, f32::INFINITY)?, ray.origin, 0.0);
        // Faces of media are not seen.
        for _ in 0..MOST_FACES {
            if !self.is_interface(&s) {
                break;
            }
            gone += s.t;
            start = past(&s, ray.direction);
            s = self.intersect(&Ray { origin: start, ..*ray }, f32::INFINITY)?;
        }
        s.t = if start == ray.origin { s.t } else { gone + s.t };
        let side = if s.ng.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let albedo = self.material(s.object).albedo(&s);
        Some(FirstSurface { distance: s.t, normal: s.ns * side, albedo, object: s.object })
    }

    /// Spectral radiance that arrives at the ray's origin from its direction, W·m⁻²·sr⁻¹·nm⁻¹ at the four wavelengths; one
    /// random estimate, whose mean is the true value.
    pub fn radiance(&self, ray: Ray, wavelengths: &Wavelengths, sampler: &Sampler, settings: &PathSettings) -> Sampled {
        self.trace(None, ray, wavelengths, sampler, settings, None)
    }

    /// The same with caustics by photons ([`crate::light_paths`]), which stand for what paths would find by chance there.
    pub fn radiance_with(
        &self,
        photons: Option<&PhotonMap>,
        ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> Sampled {
        self.trace(photons, ray, wavelengths, sampler, settings, None)
    }

    /// The same, and what of it came from the photons: by how much they matter in a picture.
    pub fn radiance_and_caustics(
        &self,
        photons: &PhotonMap,
        ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
    ) -> [Sampled; 2] {
        let mut gathered = Sampled::ZERO;
        let all = self.trace(Some(photons), ray, wavelengths, sampler, settings, Some(&mut gathered));
        [all, gathered]
    }

    /// Follows a path; `gathered` gets what of its light came from photons.
    fn trace(
        &self,
        photons: Option<&PhotonMap>,
        mut ray: Ray,
        wavelengths: &Wavelengths,
        sampler: &Sampler,
        settings: &PathSettings,
        mut gathered: Option<&mut Sampled>,
    ) -> Sampled {
        let mut radiance = Sampled::ZERO;
        let mut tail = Tail::default();
        let mut throughput = Sampled::ONE;
        // Lanes that carry colours never disperse.
        let mut hero_only = wavelengths.is_rgb();
        let mut within = Within::new(self.air());
        let mut last: Option<Aimed> = None;
        // Where `last` is a vertex in a medium: the segment on which it lies.
        let mut scattered_on: Option<ScatteredOn> = None;
        let (mut vertex, mut leg) = (0, 0);
        // Product of the η² by which refraction scaled radiance; Russian roulette leaves it out (pbrt's `etaScale`).
        let mut squeezed = 1.0;
        let (time_s, flash) = (ray.time_s, self.flash_burns(ray.time_s));
        loop {
            let surface = self.intersect(&ray, f32::INFINITY);
            let reach = surface.as_ref().map_or(f32::INFINITY, |s| s.t);
            leg += 1;
            if let Some((medium, [near, far])) = within.span(&ray, reach) {
                let span = [near, far];
                let segment = MediumSegment {
                    scene: self,
                    medium,
                    span,
                    ray: &ray,
                    within: &within,
                    wavelengths,
                    sampler,
                    settings,
                    vertex,
                    leg,
                    flash,
                };
                match segment.take(&mut throughput, squeezed, &mut radiance) {
                    After::Through => {}
                    After::Ended => return radiance,
                    After::Scattered { ray: onward, last: here, on } => {
                        (ray, last, scattered_on) = (onward, Some(here), Some(on));
                        tail = Tail::default();
                        vertex += 1;
                        continue;
                    }
                }
            }
            let Some(surface) = surface else {
                if let Some(environment) = &self.lights().environment {
                    let weight = last.map_or(1.0, |l| {
                        let chosen = self.lights().environment_probability(l.point, l.normal, flash);
                        mis(l.density, chosen * environment.pdf(ray.direction))
                    });
                    radiance += throughput * environment.radiance(ray.direction, wavelengths) * weight;
                }
                let from = last.map(|l| (l.point, l.normal));
                for (number, disc, density) in self.lights().discs(ray.direction, from, wavelengths, flash) {
                    let left = photons.map_or(Sampled::ONE, |p| p.left_of_punctual(&tail, number));
                    radiance += throughput * left * disc * last.map_or(1.0, |l| mis(l.density, density));
                }
                return radiance;
            };
            let material = self.material(surface.object);
            let entering = surface.ng.dot(ray.direction) < 0.0;
            let hidden = within.hides(material, entering);
            if hidden || matches!(material.scattering, Scattering::Interface) {
                if leg > MOST_FACES {
                    return radiance;
                }
                within.cross(material, entering);
                // A hidden face stands in the way of aims; then only chance finds the light.
                last = last.filter(|_| !hidden).map(|l| Aimed { gone: l.gone + surface.t, ..l });
                ray.origin = past(&surface, ray.direction);
                continue;
            }
            if material.emission.is_some() {
                let left = photons.map_or(Sampled::ONE, |p| p.left_of_area(&tail, self.light_at(&surface)));
                radiance += throughput * left * self.emitted(material, &surface, &ray, wavelengths, last, &scattered_on, flash);
            }

            if vertex >= settings.max_depth {
                return radiance;
            }
            let wo = -ray.direction;
            let around = within.around(material);
            let Some(bsdf) = material.bsdf(&surface, wo, wavelengths, hero_only, around) else { return radiance };
            let ng = bsdf.side_normal();

            // Light that comes over mirrors and through glass.
            if let Some(photons) = photons
                && !bsdf.is_specular()
            {
                let most_events = settings.max_depth - vertex - 1;
                let light = throughput * photons.gather(&surface, &bsdf, wavelengths, time_s, most_events);
                radiance += light;
                if let Some(gathered) = &mut gathered {
                    **gathered += light;
                }
            }

            // Aim at a light.
            let u = sampler.get(Set::Light(vertex));
            if !bsdf.is_specular()
                && let Some((light, probability)) = self.lights().choose(surface.point, ng, u[2], flash)
                && let Some(aim) = self.aim(light, surface.point, [u[0], u[1]], time_s)
            {
                let (f, pdf) = bsdf.eval(aim.wi);
                if f != Sampled::ZERO {
                    let density = probability * aim.pdf;
                    let weight = if aim.has_extent { mis(density, pdf) } else { 1.0 };
                    let through = aim.wi.dot(ng) < 0.0;
                    let origin = offset_origin(surface.point, if through { -ng } else { ng });
                    let mut beyond = within;
                    if through {
                        beyond.cross(material, entering);
                    }
                    let contribution = throughput * f * self.arriving(&aim, wavelengths, time_s) * (weight / density);
                    let sheets = settings.max_depth - vertex - 1;
                    radiance += self.arrives(contribution, surface.point, origin, &aim, beyond, wavelengths, time_s, sheets);
                }
            }

            // Go on in a direction light may have come from.
            let u = sampler.get(Set::Scatter(vertex));
            let Some(scatter) = bsdf.sample(u) else { return radiance };
            throughput *= scatter.weight;
            if scatter.disperses && !hero_only {
                throughput *= wavelengths.hero_only();
                hero_only = true;
            }
            last = match scatter.specular {
                false => Some(Aimed { point: surface.point, normal: ng, density: scatter.pdf, gone: 0.0 }),
                // Aims go through thin sheets, too.
                true if scatter.transmitted && bsdf.straight_through().is_some() => {
                    last.map(|l| Aimed { gone: l.gone + surface.t, ..l })
                }
                true => None,
            };
            if let Some(photons) = photons {
                match scatter.specular {
                    false => tail.scatter(&bsdf, scatter.wi),
                    true if scatter.transmitted && bsdf.straight_through().is_some() => {}
                    true => tail.bend(photons.casts(surface.object)),
                }
            }
            if scatter.transmitted {
                within.cross(material, entering);
            }
            squeezed *= scatter.squeeze;
            vertex += 1;
            if !survives(&mut throughput, squeezed, vertex, u[3], settings) {
                return radiance;
            }
            let normal = if scatter.transmitted { -ng } else { ng };
            ray = Ray { origin: offset_origin(surface.point, normal), direction: scatter.wi, time_s };
        }
    }

    fn is_interface(&self, surface: &Surface) -> bool {
        self.has_clear() && matches!(self.material(surface.object).scattering, Scattering::Interface)
    }

    /// Radiance a surface sends back along the ray by itself, weighted against having been aimed at.
    #[inline]
    #[allow(clippy::too_many_arguments)]
    fn emitted(
        &self,
        material: &Material,
        surface: &Surface,
        ray: &Ray,
        wavelengths: &Wavelengths,
        last: Option<Aimed>,
        scattered_on: &Option<ScatteredOn>,
        flash: bool,
    ) -> Sampled {
        let Some(emission) = &material.emission else { return Sampled::ZERO };
        if !emission.two_sided && surface.ng.dot(ray.direction) > 0.0 {
            return Sampled::ZERO;
        }
        let weight = match (last, self.light_at(surface)) {
            (Some(l), Some(light)) => {
                let aimed = self.aimed_density(light, l.point, ray.direction, l.gone + surface.t, ray.time_s);
                let by_light = self.lights().area_probability(l.point, l.normal, light, flash) * aimed;
                match scattered_on {
                    Some(on) if l.normal == Vec3::ZERO => {
                        mis(l.density, by_light.hypot(on.equiangular(self, LightRef::Area(light)) * aimed))
                    }
                    _ => mis(l.density, by_light),
                }
            }
            _ => 1.0,
        };
        emission.sample(&surface.uv, wavelengths) * (weight * self.modulation(material, ray.time_s))
    }

    /// What is left of light that was aimed at from `point`, on its way from there (`origin`: the point, moved off its surface), through faces of
    /// media and up to so many thin sheets.
    #[allow(clippy::too_many_arguments)]
    fn arrives<'a>(
        &'a self,
        light: Sampled,
        point: Vec3,
        mut origin: Vec3,
        aim: &Aim,
        mut within: Within<'a>,
        wavelengths: &Wavelengths,
        time_s: f32,
        mut sheets: u32,
    ) -> Sampled {
        if light == Sampled::ZERO {
            return light;
        }
        let end = point + aim.wi * aim.distance;
        let mut left = light;
        for _ in 0..MOST_FACES {
            // The start was moved off its surface: look at the same place of the lamp from there, and end before the lamp itself.
            let (direction, reach) = match aim.distance.is_finite() {
                true => {
                    let to = end - origin;
                    let distance = to.length();
                    if distance <= aim.clearance {
                        return left;
                    }
                    (to / distance, distance - aim.clearance)
                }
                false => (aim.wi, f32::INFINITY),
            };
            let ray = Ray { origin, direction, time_s };
            let face = match self.has_clear() {
                false if self.occluded(&ray, reach) => return Sampled::ZERO,
                false => None,
                true => self.intersect(&ray, reach),
            };
            if let Some(face) = face.as_ref().filter(|f| !self.is_interface(f)) {
                let material = self.material(face.object);
                // Sheets are scattering events as others are.
                if sheets == 0 || !material.may_be_clear() {
                    return Sampled::ZERO;
                }
                sheets -= 1;
                let bsdf = material.bsdf(face, -direction, wavelengths, false, None);
                let Some(through) = bsdf.and_then(|b| b.straight_through()) else { return Sampled::ZERO };
                left *= through;
            }
            if let Some((medium, [near, far])) = within.span(&ray, face.as_ref().map_or(reach, |f| f.t)) {
                left *= medium.at(wavelengths).transmittance(far - near);
            }
            let Some(face) = face else { return left };
            within.cross(self.material(face.object), face.ng.dot(direction) < 0.0);
            origin = past(&face, direction);
        }
        Sampled::ZERO
    }
}

/// Most faces of media that a path goes through between two surfaces, and legs after which it is given up at such a face.
pub(crate) const MOST_FACES: u32 = 4096;

/// The last place from which lights could have been aimed at.
#[derive(Clone, Copy)]
struct Aimed {
    point: Vec3,
    /// Normal there; 0 in a medium.
    normal: Vec3,
    /// Density of the direction that was taken instead, 1/sr.
    density: f32,
    /// Distance from there to the start of the ray, m.
    gone: f32,
}

/// A start just behind a face that a ray goes through.
pub(crate) fn past(surface: &Surface, direction: Vec3) -> Vec3 {
    offset_origin(surface.point, if surface.ng.dot(direction) > 0.0 { surface.ng } else { -surface.ng })
}

/// Russian roulette on what a path can still bring.
#[inline]
fn survives(throughput: &mut Sampled, squeezed: f32, vertex: u32, u: f32, settings: &PathSettings) -> bool {
    if vertex < settings.roulette_depth {
        return true;
    }
    let survival = (throughput.max_element() * squeezed).clamp(0.0, 0.95);
    *throughput /= survival;
    u < survival
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

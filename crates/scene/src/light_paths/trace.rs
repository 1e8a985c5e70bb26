//! One photon from its lamp over mirrors and through glass, and what it leaves where it lands and in media on its way.

use super::emission::{EmittedPhoton, PhotonEmission};
use super::photon::{Photon, PhotonSpectrum, VolumePhoton, packed};
use crate::material::Scattering;
use crate::medium::Medium;
use crate::radiance::{MAX_INTERFACES, origin_behind};
use crate::russian_roulette::survives;
use crate::scene::Scene;
use diopter_light::random::{Dimensions, Sampler};
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};

/// Photons of some lamps, where they are after specular scattering by a caster.
#[derive(Default)]
pub(super) struct Traced<'a> {
    /// On surfaces.
    pub landed: Vec<Photon>,
    /// In media that gather photons ([`Medium::scatters_homogeneously`]): one on each segment.
    pub in_media: Vec<VolumePhoton<'a>>,
}

/// Traces the photon that belongs to the numbers of a sampler, and adds it where it lands and on segments in media; `scale` multiplies its power.
pub(super) fn trace<'a>(
    emission: &PhotonEmission<'a>,
    scene: &'a Scene,
    sampler: &Sampler,
    wavelengths: &SampledWavelengths,
    max_depth: u32,
    scale: f32,
    traced: &mut Traced<'a>,
) {
    let Some(EmittedPhoton { mut ray, lamp, relative, mut medium_stack }) = emission.start(sampler, wavelengths) else { return };
    let mut power = relative * scale;
    let (mut hero_only, mut dispersed) = (wavelengths.is_rgb(), false);
    let (mut events, mut is_caustic) = (0, false);
    let mut numbers = None;
    for _ in 0..MAX_INTERFACES {
        let surface = scene.intersect(&ray, f32::INFINITY);
        let reach = surface.as_ref().map_or(f32::INFINITY, |s| s.t);
        if let Some((medium, span)) = medium_stack.span(scene, &ray, reach) {
            if is_caustic && medium.scatters_homogeneously() && events < max_depth {
                let u = sampler.get(Dimensions::Medium(events))[0];
                if let Some((distance, relative)) = on_segment(medium, span, power, wavelengths, u) {
                    let from = packed(-ray.direction);
                    let photon = Photon {
                        point: ray.at(distance),
                        from,
                        normal: from,
                        relative: relative.to_array(),
                        hero_nm: wavelengths.nm.x,
                        time_s: ray.time_s,
                        lamp,
                        events: events.min(u32::from(u16::MAX)) as u16,
                        spectrum: PhotonSpectrum::of(wavelengths, dispersed, relative),
                    };
                    traced.in_media.push(VolumePhoton { photon, medium });
                }
            }
            // What is scattered on the way is no caustic any more.
            power *= medium.transmittance(&ray, span, wavelengths, scene.moment_s(ray.time_s), || {
                numbers.get_or_insert_with(|| sampler.stream(Dimensions::Tracking(0)))
            });
        }
        let Some(surface) = surface else { return };
        let material = scene.material(surface.object);
        let entering = surface.ng.dot(ray.direction) < 0.0;
        if medium_stack.hides(scene, surface.object, entering) || matches!(material.scattering, Scattering::Interface) {
            medium_stack.cross(scene, surface.object, entering);
            ray.origin = origin_behind(&surface, ray.direction);
            continue;
        }
        let around = medium_stack.around(scene, surface.object);
        let Some(bsdf) = material.bsdf(&surface, -ray.direction, wavelengths, hero_only, around) else { return };
        // The event of the camera's path that gathers it is one more.
        if events + 1 > max_depth || !(power.max_element() > 0.0) {
            return;
        }
        let ng = bsdf.side_normal();
        // Strands are narrower than the discs within which photons are gathered.
        if is_caustic && !bsdf.is_specular() && !surface.is_strand() && power.is_finite() {
            traced.landed.push(Photon {
                point: surface.point,
                from: packed(-ray.direction),
                normal: packed(ng),
                relative: power.to_array(),
                hero_nm: wavelengths.nm.x,
                time_s: ray.time_s,
                lamp,
                events: events.min(u32::from(u16::MAX)) as u16,
                spectrum: PhotonSpectrum::of(wavelengths, dispersed, power),
            });
        }
        // Only specular events make caustics.
        let u = sampler.get(Dimensions::Scatter(events));
        let Some(scatter) = bsdf.sample(u).filter(|s| s.specular) else { return };
        let is_straight = scatter.transmitted && bsdf.straight_through().is_some();
        if !is_straight && !emission.casters.casts(surface.object) {
            return;
        }
        is_caustic |= !is_straight;
        let before = power.max_element();
        power *= scatter.weight * bsdf.shading_correction(scatter.wi);
        if scatter.transmitted {
            // Radiance changes by η² where it is bent, power does not (Veach 1997 §5.2).
            power *= scatter.eta_scale;
            medium_stack.cross(scene, surface.object, entering);
        }
        // Roulette keeps the power of photons alike.
        let survival = (power.max_element() / before).min(1.0);
        if !survives(&mut power, survival, u[3]) {
            return;
        }
        if scatter.disperses && !hero_only {
            power *= wavelengths.hero_only();
            (hero_only, dispersed) = (true, true);
        }
        events += 1;
        let normal = if scatter.transmitted { -ng } else { ng };
        ray = Ray { origin: surface.leave(normal, scatter.wi), direction: scatter.wi, time_s: ray.time_s };
    }
}

/// A place (m) on the part of a ray that is in a homogeneous medium, drawn by what is left there of a photon, and its power there over the density of the place,
/// times m. `None` where none is left.
fn on_segment(
    medium: &Medium,
    [near, far]: [f32; 2],
    power: SampledSpectrum,
    wavelengths: &SampledWavelengths,
    u: f32,
) -> Option<(f32, SampledSpectrum)> {
    let sigma = medium.at(wavelengths);
    let total = power.element_sum();
    if !(total > 0.0 && total.is_finite() && near < far) || sigma.scattering == SampledSpectrum::ZERO {
        return None;
    }
    // Exponential up to the end, of the mean extinction.
    let extinction = (power / total).dot(sigma.extinction);
    let depth = extinction * (far - near);
    let (distance, density) = match depth < 1e-3 {
        true => (u * (far - near), 1.0 / (far - near)),
        false => {
            let reaching = 1.0 - (-depth).exp();
            let distance = -(1.0 - u * reaching).ln() / extinction;
            (distance, extinction * (-extinction * distance).exp() / reaching)
        }
    };
    let relative = power * sigma.transmittance(distance) / density;
    (relative.is_finite() && relative.max_element() > 0.0).then_some((near + distance, relative))
}

//! All surfaces that shine by themselves, as starting points of paths that a camera sees them by.
//!
//! A path tracer meets a small lamp out of focus by chance: of the rays from a place in its disk of blur few go through the lens to the lamp. Drawn from the
//! lamp through the lens they all count (light tracing; Veach 1997, ch. 10: the strategy with one vertex of the camera, on its lens). Both are joined by
//! multiple importance sampling: who draws rays through a lens knows both densities ([`EmitterMis`]).
//!
//! These are the same paths for both: straight from a surface that shines to the camera, through faces of media, thin dielectrics and what is left by
//! media. Unlike the lights that are sampled, unlit surfaces (`is_light` of the emission is not set, such as stars) are among them.

use super::{AreaLight, LightPoint, LightSample};
use crate::material::Emission;
use crate::medium_stack::Immersion;
use crate::radiance::{DIRECT_EVENTS, PathSettings, stream_along};
use crate::scene::{AreaLights, Object, Scene, Shape, area_lights};
use crate::shape::Surface;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use std::borrow::Cow;

/// Surfaces of a scene that shine by themselves, by number: one for each sphere, quad, triangle or pair of triangles.
#[derive(Debug)]
pub struct Emitters<'a> {
    scene: &'a Scene,
    found: AreaLights,
}

/// Weight of a camera path that meets an emitter directly; the rest comes by light tracing (multiple importance sampling, Veach 1997, section 9.2).
#[derive(Clone, Copy)]
pub struct EmitterMis<'a> {
    /// The emitters that light tracing samples.
    pub emitters: &'a Emitters<'a>,
    /// Weight of the camera path by its number, number of the emitter and point met, m.
    pub weight: &'a dyn Fn(usize, u32, Vec3) -> f32,
    /// Number of the camera path.
    pub path: usize,
}

impl EmitterMis<'_> {
    /// The weight at a surface that shines.
    #[inline]
    pub(crate) fn counts(&self, surface: &Surface) -> f32 {
        self.emitters.found.at(surface).map_or(1.0, |number| (self.weight)(self.path, number, surface.point))
    }
}

impl Scene {
    /// What shines by itself, but not more than so many surfaces: then what is not sampled (such as unlit pictures of things) is left out. `None`
    /// without any, or if there are more still.
    pub fn emitters(&self, most: usize) -> Option<Emitters<'_>> {
        let d = self.description();
        let surfaces = |counted: &dyn Fn(&Emission) -> bool| {
            let shines = |o: &&Object| d.materials[o.material as usize].emission.as_ref().is_some_and(counted);
            let count = |o: &Object| match o.shape {
                Shape::Mesh { mesh, .. } => d.meshes[mesh as usize].triangles.len(),
                _ => 1,
            };
            d.objects.iter().filter(shines).map(count).sum::<usize>()
        };
        // Two triangles may make one surface.
        let found = if surfaces(&|_| true) <= 2 * most {
            area_lights(d, |_| true)
        } else if surfaces(&|e| e.is_light) <= 2 * most {
            area_lights(d, |e| e.is_light)
        } else {
            return None;
        };
        (1..=most).contains(&found.lights.len()).then_some(Emitters { scene: self, found })
    }
}

impl Emitters<'_> {
    /// How many there are; at least one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.found.lights.len()
    }

    /// Where one is at a time of the exposure.
    #[inline]
    fn placed(&self, number: u32, time_s: f32) -> Cow<'_, AreaLight> {
        self.scene.placed_light(&self.found.lights[number as usize], self.found.motions[number as usize], time_s)
    }

    /// Its middle at a time of the exposure, m.
    #[inline]
    pub fn middle(&self, number: u32, time_s: f32) -> Vec3 {
        self.placed(number, time_s).center()
    }

    /// Its mean luminance, cd/m².
    pub fn luminance(&self, number: u32) -> f32 {
        self.found.lights[number as usize].luminance
    }

    /// Samples it from a point at a time of the exposure; `None` where it shows its dark side.
    #[inline]
    pub fn sample_li(&self, number: u32, p: Vec3, u: [f32; 2], time_s: f32) -> Option<LightSample> {
        self.placed(number, time_s).sample_li(p, u, number)
    }

    /// Density (1/sr) with which [`Emitters::sample_li`] samples from `p` a point of it, which lies in a direction (unit vector).
    #[inline]
    pub fn density(&self, number: u32, p: Vec3, direction: Vec3, point: Vec3, time_s: f32) -> f32 {
        let light = self.placed(number, time_s);
        // One that turns its dark side is not sampled.
        if light.normal().is_some_and(|n| !light.two_sided && n.dot(direction) >= -1e-6) {
            return 0.0;
        }
        light.pdf(p, direction, (point - p).dot(direction))
    }

    /// Spectral radiance that arrives along a light sample from `p` at `origin`, a point on the same line, at a time of the exposure: what it sends out, less what
    /// is in the way, from what `p` stands in; and what of it is direct light ([`RadianceAndDirect`](crate::radiance::record::RadianceAndDirect)), through one thin dielectric at most.
    #[allow(clippy::too_many_arguments)]
    pub fn incident_radiance(
        &self,
        light_sample: &LightSample,
        p: Vec3,
        origin: Vec3,
        wavelengths: &SampledWavelengths,
        time_s: f32,
        settings: &PathSettings,
        Immersion(medium_stack): Immersion,
    ) -> [SampledSpectrum; 2] {
        let LightPoint::Area(number, place) = light_sample.spot else { return [SampledSpectrum::ZERO; 2] };
        let (scene, light) = (self.scene, &self.found.lights[number as usize]);
        let materials = &scene.description().materials;
        let sent = light.radiance(place, materials, wavelengths);
        let sent = sent * scene.modulation(&materials[light.material as usize], time_s);
        let stream = || stream_along(p, light_sample.wi);
        let most = settings.max_depth;
        let shadow_ray =
            scene.shadow_ray(&mut (), sent, p, origin, light_sample, medium_stack, None, wavelengths, time_s, most, stream);
        [shadow_ray.light, if shadow_ray.thin_dielectrics <= DIRECT_EVENTS { shadow_ray.light } else { SampledSpectrum::ZERO }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Description;
    use crate::material::{EmissionColor, Material, Scattering};
    use crate::radiance::CameraPath;
    use crate::shape::{Quad, Sphere};
    use diopter_light::random::{Sampler, SamplerKind};
    use diopter_light::{Ray, Spectrum};

    fn shining(name: &str, radiance: f32, is_light: bool) -> Material {
        let radiance = EmissionColor::Constant(Spectrum::Constant(radiance));
        let emission = Emission { radiance, two_sided: false, is_light, modulation: Default::default() };
        Material { emission: Some(emission), ..Material::new(name, Scattering::Black) }
    }

    /// A small ball, a small unlit square, and a card that hides half of the ball from the origin.
    fn scene() -> Scene {
        let ball = Sphere { center: Vec3::new(0.0, 0.0, -3.0), radius: 0.1 };
        let square = Quad { corner: Vec3::new(1.0, 0.0, -4.0), edges: [Vec3::X * 0.2, Vec3::Y * 0.3] };
        let card = Quad { corner: Vec3::new(-1.0, -1.0, -1.0), edges: [Vec3::X, Vec3::Y * 2.0] };
        Scene::build(Description {
            materials: vec![shining("ball", 3.0, true), shining("square", 5.0, false), Material::new("card", Scattering::Black)],
            objects: vec![
                Object::new("card", Shape::Quad(card), 2),
                Object::new("ball", Shape::Sphere(ball), 0),
                Object::new("square", Shape::Quad(square), 1),
            ],
            ..Default::default()
        })
        .unwrap()
    }

    #[test]
    fn what_is_aimed_at_is_what_rays_meet() {
        let scene = scene();
        assert!(scene.emitters(1).is_none());
        let emitters = scene.emitters(2).unwrap();
        assert_eq!(emitters.len(), 2);
        let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let settings = PathSettings::default();
        let p = Vec3::new(0.001, 0.002, 0.01);
        let mut hidden = [0, 0];
        for i in 0..256u32 {
            let u = [(i % 16) as f32 / 16.0 + 0.03, (i / 16) as f32 / 16.0 + 0.03];
            for number in 0..2 {
                let light_sample = emitters.sample_li(number, p, u, 0.0).unwrap();
                let origin = p + light_sample.wi * 0.02;
                let light =
                    emitters.incident_radiance(&light_sample, p, origin, &wavelengths, 0.0, &settings, Immersion::NONE)[0].x;
                let end = p + light_sample.wi * light_sample.distance;
                let density = emitters.density(number, p, light_sample.wi, end, 0.0);
                assert!((density / light_sample.pdf - 1.0).abs() < 1e-3, "{density} {}", light_sample.pdf);
                // The path tracer asks for the weight of the same emitter, and counts what is left.
                let asked = std::cell::Cell::new(None);
                let weight = |_: usize, number: u32, point: Vec3| {
                    asked.set(Some((number, point)));
                    0.25
                };
                let sampler = Sampler::new(SamplerKind::Independent, 1, (i, number), 0, 1);
                let emitter_mis = EmitterMis { emitters: &emitters, weight: &weight, path: 0 };
                let ray = Ray { origin, direction: light_sample.wi, time_s: 0.0 };
                let path = CameraPath { emitter_mis: Some(emitter_mis), ..CameraPath::new(ray, wavelengths, sampler) };
                let seen = scene.radiance_along(&path, &settings).x;
                hidden[number as usize] += u32::from(light == 0.0);
                assert!((seen - 0.25 * light).abs() < 1e-6, "{number}: {seen} {light}");
                if light > 0.0 {
                    let (found, point) = asked.get().unwrap();
                    assert!(found == number && (point - end).length() < 1e-4, "{found} {point} {end}");
                }
            }
        }
        // Half of the ball is behind the card, nothing of the square.
        assert!((64..192).contains(&hidden[0]) && hidden[1] == 0, "{hidden:?}");
    }

    #[test]
    fn light_loses_on_its_way_what_the_camera_stands_in() {
        // A lamp of 20 cm in a ball of ink of 2 m, seen from its middle through 1 m of it.
        let ink = crate::medium::Medium::fog(10.0, 0.0, 0.0);
        let left = |ink: Option<crate::medium::Medium>| {
            let interior = crate::material::Interior::Body { medium: ink.map(std::sync::Arc::new), priority: None };
            let ball = Material { interior, ..Material::new("ink", Scattering::Interface) };
            let quad = Quad { corner: Vec3::new(-0.1, -0.1, -1.0), edges: [Vec3::X * 0.2, Vec3::Y * 0.2] };
            let objects = vec![
                Object::new("lamp", Shape::Quad(quad), 0),
                Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 2.0 }), 1),
            ];
            let materials = vec![shining("lamp", 1.0, true), ball];
            let scene = Scene::build(Description { objects, materials, ..Default::default() }).unwrap();
            let (emitters, wavelengths) = (scene.emitters(2).unwrap(), SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]));
            let light_sample = emitters.sample_li(0, Vec3::ZERO, [0.5; 2], 0.0).unwrap();
            let (settings, immersion) = (PathSettings::default(), scene.immersion_at(Vec3::ZERO));
            emitters.incident_radiance(&light_sample, Vec3::ZERO, Vec3::ZERO, &wavelengths, 0.0, &settings, immersion)[0].x
        };
        // Fog of a visibility of 10 m: 3.912 / 10 m.
        let (clear, dim) = (left(None), left(Some(ink)));
        assert!(clear > 0.0 && (dim / clear / (-0.3912f32).exp() - 1.0).abs() < 1e-3, "{clear} {dim}");
    }
}

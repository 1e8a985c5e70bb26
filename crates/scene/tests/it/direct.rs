//! Direct light apart from all light: the same numbers as paths of one scattering event have.

use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledSpectrum, Spectrum};
use diopter_scene::light::{Environment, Punctual, PunctualKind};
use diopter_scene::light_paths::{CameraRays, CausticSettings, Caustics, ConnectionSettings, Connections, Lamps, LightPaths};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Interior, Material, Principled, Scattering, Transmission};
use diopter_scene::medium::Medium;
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::{Radiance, RadianceAndDirect};
use diopter_scene::shape::{Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::Vec3;
use std::sync::Arc;

fn quad(name: &str, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> Object {
    Object::new(name, Shape::Quad(Quad { corner: corner.into(), edges: edges.map(Vec3::from) }), material)
}

fn ball(name: &str, center: [f32; 3], radius: f32, material: u32) -> Object {
    Object::new(name, Shape::Sphere(Sphere { center: center.into(), radius }), material)
}

fn pane() -> Material {
    let mut p = Principled::new(Color::rgb(0.8, 0.9, 0.8), 1.5);
    (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.0), Scalar::Constant(1.0), Transmission::Thin);
    Material::new("pane", Scattering::Principled(Box::new(p)))
}

/// A floor and a wall with lamps, sky, a mirror, a pane, a ball of glass and a ball of fog that shines.
fn room() -> Scene {
    let (n, k) = (Spectrum::Constant(0.0), Spectrum::Constant(1000.0));
    let mirror = Conductor { n, k, alpha: Scalar::Constant(0.0), across: None, bounces: FacetBounces::Lost, tint: None };
    let shining = Medium { emission: Some(Spectrum::Constant(0.3)), ..Medium::fog(1.5, 0.8, 0.2) };
    let interior = Interior::Body { medium: Some(Arc::new(shining)), priority: None };
    let fog = Material { interior, ..Material::new("fog", Scattering::Interface) };
    let materials = vec![
        Material::new("wall", Scattering::Diffuse(Color::rgb(0.6, 0.5, 0.4))),
        Material::lamp("lamp", Spectrum::Constant(8.0)),
        Material::new("mirror", Scattering::Conductor(mirror)),
        pane(),
        Material::glass("glass", 1.5, None),
        fog,
    ];
    let objects = vec![
        quad("floor", [-2.0, -1.0, -2.0], [[0.0, 0.0, 4.0], [4.0, 0.0, 0.0]], 0),
        quad("wall", [-2.0, -1.0, -2.0], [[4.0, 0.0, 0.0], [0.0, 3.0, 0.0]], 0),
        quad("lamp", [-0.3, 1.2, -0.8], [[0.0, 0.0, -0.4], [0.6, 0.0, 0.0]], 1),
        quad("bulb", [1.0, -0.8, -1.9], [[0.2, 0.0, 0.0], [0.0, 0.2, 0.0]], 1),
        quad("mirror", [0.9, -0.2, -1.9], [[0.8, 0.0, 0.0], [0.0, 0.8, 0.0]], 2),
        quad("pane", [-1.6, -0.9, -0.5], [[0.9, 0.0, 0.0], [0.0, 1.6, 0.0]], 3),
        ball("glass", [0.3, -0.6, -0.4], 0.35, 4),
        ball("fog", [-0.3, 0.6, -1.0], 0.4, 5),
    ];
    let spot = Punctual::new("spot", Spectrum::Constant(6.0), PunctualKind::Point { position: Vec3::new(-1.2, 0.5, -1.2) });
    let environment = Some(Environment::uniform(Vec3::splat(0.2)));
    Scene::build(Description { materials, objects, punctual: vec![spot], environment, ..Default::default() }).unwrap()
}

#[test]
fn direct_light_is_that_of_one_scattering_event_bit_by_bit() {
    let scene = room();
    let path = PathSettings::default();
    let once = PathSettings { max_depth: 1, ..path };
    let drawn = WavelengthSampler::uniform();
    let caustics = Caustics::new(&scene, CausticSettings { lamps: Lamps::All, photons: 1 << 14, ..Default::default() }).unwrap();
    let photons = caustics.map(0, 0);
    let connections = Connections::new(
        &scene,
        ConnectionSettings { seed: 1, max_depth: path.max_depth, paths: 1 << 10, rgb: false },
        &CameraRays::NONE,
    )
    .unwrap();
    let vertices = connections.pool(0, 0);
    for (name, light_paths) in [
        ("paths", LightPaths::default()),
        ("photons", LightPaths { photons: Some(&photons), vertices: None }),
        ("connections", LightPaths { photons: Some(&photons), vertices: Some(&vertices) }),
    ] {
        // Samples with direct light alone, with none, and with both.
        let mut kinds = [0; 3];
        for i in 0..4000 {
            let sampler = Sampler::new(SamplerKind::Independent, 3, (7, 9), i, 4000);
            let [a, b, w, _] = sampler.get(Dimensions::Camera);
            let wavelengths = drawn.sample(w);
            let direction = Vec3::new(-0.6 + 1.2 * a, -0.5 + 1.0 * b, -1.0).normalize();
            let ray = Ray { origin: Vec3::new(0.0, 0.2, 2.0), direction, time_s: 0.0 };
            let along = CameraPath { light_paths, ..CameraPath::new(ray, wavelengths, sampler) };
            let [all, direct] = scene.trace(&[along], RadianceAndDirect, &path)[0];
            assert_eq!(all, scene.radiance_along(&along, &path), "{name} {i}");
            // Photons are left out: those that gather would be found with one event, too, and have been scattered before.
            let shallow = LightPaths { photons: None, ..light_paths };
            let expected = scene.radiance_along(&CameraPath { light_paths: shallow, ..along }, &once);
            assert!((direct - expected).abs().cmple(1e-6 * expected).all(), "{name} {i}: {direct} {expected}");
            assert!(direct.cmple(all * (1.0 + 1e-6)).all(), "{name} {i}: {direct} {all}");
            kinds[if direct == all { 0 } else { 1 + usize::from(direct.max_element() > 0.0) }] += 1;
        }
        // Many at a time are what each is alone.
        let along = |i: u32| {
            let sampler = Sampler::new(SamplerKind::Independent, 4, (7, 9), i, 64);
            let [a, b, w, _] = sampler.get(Dimensions::Camera);
            let direction = Vec3::new(-0.6 + 1.2 * a, -0.5 + 1.0 * b, -1.0).normalize();
            let ray = Ray { origin: Vec3::new(0.0, 0.2, 2.0), direction, time_s: 0.0 };
            CameraPath { light_paths, ..CameraPath::new(ray, drawn.sample(w), sampler) }
        };
        let paths: Vec<CameraPath> = (0..64).map(along).collect();
        let alone: Vec<[SampledSpectrum; 2]> =
            paths.iter().map(|along| scene.trace(&[*along], RadianceAndDirect, &path)[0]).collect();
        assert_eq!(scene.trace(&paths, RadianceAndDirect, &path), alone, "{name}");
        let all: Vec<SampledSpectrum> = alone.iter().map(|[all, _]| *all).collect();
        assert_eq!(scene.trace(&paths, Radiance, &path), all, "{name}");
        println!("{name}: {kinds:?}");
        assert!(kinds.iter().all(|n| *n > 100), "{name}: {kinds:?}");
    }
}

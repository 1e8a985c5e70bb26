//! Pictures on surfaces seen by rays with a width: means, noise, and where nothing may change.

use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
use diopter_light::{Ray, SampledWavelengths};
use diopter_scene::light::Environment;
use diopter_scene::material::{Bump, BumpUnit, Coverage, Material, Scattering};
use diopter_scene::radiance::{CameraPath, RayCone};
use diopter_scene::shape::Quad;
use diopter_scene::texture::{Codes, Color, Image, Scalar, Texture};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Affine2, Vec2, Vec3};
use std::sync::Arc;

const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];

/// Black and white squares, one pixel each, `tiles` times 64 of them along each side of the ground.
fn checkerboard(tiles: f32, codes: Codes) -> Texture {
    let pixels = (0..64 * 64).map(|i| if (i % 64 + i / 64) % 2 == 0 { [0, 0, 0, 255] } else { [255; 4] }).collect();
    let image_from_uv = Affine2::from_scale(Vec2::splat(tiles));
    Texture { codes, image_from_uv, ..Texture::color(Arc::new(Image::new(64, 64, pixels))) }
}

/// The ground, 200 m square, under an even sky.
fn ground(change: impl FnOnce(&mut Material)) -> Scene {
    let color = Color::Textured { factor: Vec3::ONE, texture: checkerboard(50.0, Codes::Srgb) };
    let mut material = Material::new("ground", Scattering::Diffuse(color));
    change(&mut material);
    let quad = Quad { corner: Vec3::new(-100.0, 0.0, 100.0), edges: [Vec3::X * 200.0, Vec3::NEG_Z * 200.0] };
    Scene::build(Description {
        materials: vec![material],
        objects: vec![Object::new("ground", Shape::Quad(quad), 0)],
        environment: Some(Environment::uniform(Vec3::ONE)),
        ..Default::default()
    })
    .unwrap()
}

/// Mean and variance of the light of a pixel, an angle wide, in a direction; `fraction` of a pixel is what a sample stands for.
fn pixel(scene: &Scene, towards: Vec3, angle: f32, fraction: f32, n: u32) -> [f64; 2] {
    let wavelengths = SampledWavelengths::fixed(NM);
    let white = wavelengths.d65_one_nit();
    let (s, t) = towards.normalize().any_orthonormal_pair();
    let settings = PathSettings { max_depth: 1, roulette_depth: 9 };
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..n {
        let [u, v] = [i, i ^ 0x5bd1_e995].map(|k| to_unit(mix(k)) - 0.5);
        let direction = (towards.normalize() + (s * u + t * v) * angle).normalize();
        let ray = Ray { origin: Vec3::Y * 1.6, direction, time_s: 0.0 };
        let sampler = Sampler::new(SamplerKind::Independent, 5, (3, 4), i, n);
        let cone = RayCone { ray, spread: angle * fraction, fraction };
        let path = CameraPath { cone, ..CameraPath::new(ray, wavelengths, sampler) };
        let light = (scene.radiance_along(&path, &settings) / white).y;
        (sum, squares) = (sum + f64::from(light), squares + f64::from(light).powi(2));
    }
    let mean = sum / f64::from(n);
    [mean, squares / f64::from(n) - mean * mean]
}

#[test]
fn far_checkerboards_keep_their_mean_and_lose_their_noise() {
    let scene = ground(|_| {});
    // Squares are 6.25 cm; pixels of half a degree cover some of them at 15 m and hundreds at the horizon.
    for towards in [Vec3::new(1.0, -1.6 / 15.0, 0.4), Vec3::new(0.3, -1.6 / 40.0, -1.0), Vec3::new(1.0, -0.026, 0.0)] {
        let n = 4096;
        let [plain, noise] = pixel(&scene, towards, 0.009, 0.0, n);
        let [filtered, left] = pixel(&scene, towards, 0.009, 1.0, n);
        // The noise of the plain mean, four standard errors; the sky is even, so that all of it comes from the squares.
        let allowed = 4.0 * (noise / f64::from(n)).sqrt();
        assert!((filtered - plain).abs() < allowed, "{towards}: {filtered}, {plain} ± {allowed}");
        assert!((filtered - 0.5).abs() < 0.02, "{towards}: {filtered}");
        assert!(left < 0.1 * noise, "{towards}: variance {left} of {noise}");
    }
}

#[test]
fn what_is_near_or_must_not_be_filtered_has_the_same_bits() {
    let alpha = Scalar::Textured { factor: 1.0, texture: checkerboard(50.0, Codes::Linear), channel: 0 };
    let heights = Scalar::Textured { factor: 1.0, texture: checkerboard(50.0, Codes::Linear), channel: 0 };
    let far = Vec3::new(1.0, -0.05, 0.3);
    for (what, scene, towards, angle) in [
        // A pixel of 1.6 mm on squares of 62.5 mm.
        ("near", ground(|_| {}), Vec3::NEG_Y, 0.001),
        ("holes", ground(|m| m.coverage = Coverage::Mask { alpha, cutoff: 0.5 }), far, 0.01),
        ("bumps", ground(|m| m.bump = Some(Box::new(Bump { height: heights, unit: BumpUnit::Length(0.01) }))), far, 0.01),
    ] {
        assert_eq!(pixel(&scene, towards, angle, 1.0, 256), pixel(&scene, towards, angle, 0.0, 256), "{what}");
    }
    assert_ne!(pixel(&ground(|_| {}), far, 0.01, 1.0, 256), pixel(&ground(|_| {}), far, 0.01, 0.0, 256));
}

#[test]
fn normals_and_roughness_are_not_averaged() {
    // A picture of normals alone: nothing of this material is filtered.
    let normals = checkerboard(50.0, Codes::Linear);
    let scene = ground(|m| {
        m.scattering = Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5));
        m.normal_map = Some((normals, 1.0));
    });
    assert!(!scene.filters_pictures());
    let far = Vec3::new(1.0, -0.05, 0.3);
    assert_eq!(pixel(&scene, far, 0.01, 1.0, 256), pixel(&scene, far, 0.01, 0.0, 256));
}

#[test]
fn more_samples_blur_less() {
    // A border between a black and a white half: what a sample far on sees of it is as sharp as without filtering.
    let pixels = (0..64 * 64).map(|i| if i % 64 < 32 { [0, 0, 0, 255] } else { [255; 4] }).collect();
    let texture = Texture { codes: Codes::Linear, ..Texture::color(Arc::new(Image::new(64, 64, pixels))) };
    let scene = ground(|m| m.scattering = Scattering::Diffuse(Color::Textured { factor: Vec3::ONE, texture }));
    // 3.1 m a picture's pixel: looked at along the border from above its middle, left of it by some of them.
    let beside = |angle: f32, fraction: f32| {
        let towards = Vec3::new(-6.0, -1.6, -60.0);
        pixel(&scene, towards, angle, fraction, 512)[0]
    };
    let [sharp, blurred, late] = [(0.05, 0.0), (0.4, 1.0), (0.05, 0.1)].map(|(a, f)| beside(a, f));
    assert!(blurred > sharp + 0.02, "{blurred} {sharp}");
    assert!((late - sharp).abs() < 0.02, "{late} {sharp}");
}

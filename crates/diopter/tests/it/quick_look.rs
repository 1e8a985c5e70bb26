//! The quick look against rays through the lens.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Focus, Iris, Lens, ThinLens};
use diopter::light::units::Millimeters;
use diopter::quick_look::{Optics, of_plane, sharp_camera};
use diopter::scene::light::Environment;
use diopter::scene::material::{Material, Scattering};
use diopter::scene::shape::{Quad, Sphere};
use diopter::scene::texture::{Color, Image, Texture};
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::Vec3;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn checks() -> Texture {
    let n = 512;
    let tone = |i: usize| if (i % n / 32 + i / n / 32).is_multiple_of(2) { 230 } else { 90 };
    let pixels = (0..n * n).map(|i| [tone(i), tone(i), tone(i), 255]).collect();
    Texture::color(Arc::new(Image::new(n, n, pixels)))
}

/// A floor that runs away from the camera, a wall behind it; balls on it or not.
fn scene(balls: bool) -> Scene {
    let textured = || Scattering::Diffuse(Color::Textured { factor: Vec3::ONE, texture: checks() });
    let mut d = Description { environment: Some(Environment::uniform(Vec3::splat(100.0))), ..Default::default() };
    d.materials = vec![Material::new("floor", textured()), Material::new("ball", Scattering::Diffuse(Color::rgb(0.7, 0.2, 0.1)))];
    let quad = |name: &str, corner: Vec3, edges: [Vec3; 2]| Object::new(name, Shape::Quad(Quad { corner, edges }), 0);
    d.objects.push(quad("floor", Vec3::new(-4.0, -0.5, -8.0), [Vec3::X * 8.0, Vec3::Z * 8.0]));
    d.objects.push(quad("wall", Vec3::new(-4.0, 3.5, -8.0), [Vec3::X * 8.0, Vec3::NEG_Y * 4.0]));
    if balls {
        for (x, z, r) in [(-0.25, -1.4, 0.16), (0.1, -2.2, 0.2), (0.9, -4.0, 0.4)] {
            d.objects.push(Object::new("ball", Shape::Sphere(Sphere { center: Vec3::new(x, -0.5 + r, z), radius: r }), 1));
        }
    }
    Scene::build(d).unwrap()
}

fn take(scene: &Scene, camera: &Camera, spp: u32) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, &Shutter::global(1.0), &Response::linear_srgb(), &Settings::new(spp), &ExposureFacts::default(), &watch)
        .unwrap()
}

/// Mean absolute and root mean square difference, as fractions of full scale.
fn differences(balls: bool, f_number: f64) -> [f64; 2] {
    let lens = ThinLens::new(Millimeters(50.0), f_number, Iris::Round, Focus::Distance(Millimeters(2200.0))).unwrap();
    let camera = Camera {
        lens: Lens::Thin(lens),
        film: Film::new(36.0, 24.0, 240, 160),
        motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::new(0.0, -0.35, -2.0), Vec3::Y).unwrap()),
    };
    let scene = scene(balls);
    let traced = take(&scene, &camera, 400);
    let quick = of_plane(&take(&scene, &sharp_camera(&camera), 128), &Optics::of(&camera).unwrap());
    let full = traced.mean.data.iter().copied().fold(0.0, f32::max) as f64;
    let n = traced.mean.data.len() as f64;
    let off = |p: fn(f64) -> f64| {
        traced.mean.data.iter().zip(&quick.mean.data).map(|(a, b)| p(f64::from(a - b).abs() / full)).sum::<f64>() / n
    };
    [off(|d| d), off(|d| d * d).sqrt()]
}

#[test]
fn without_occluders_it_is_the_traced_picture() {
    for n in [2.0, 5.6] {
        let [mean, rms] = differences(false, n);
        assert!(mean < 0.01 && rms < 0.02, "f/{n}: {mean} {rms}");
    }
}

#[test]
fn with_occluders_it_is_close() {
    let [mean, rms] = differences(true, 2.0);
    assert!(mean < 0.015 && rms < 0.04, "{mean} {rms}");
}

#[test]
fn the_sharp_camera_is_as_bright() {
    let lens = ThinLens::new(Millimeters(50.0), 4.0, Iris::Round, Focus::Distance(Millimeters(500.0))).unwrap();
    let camera = Camera {
        lens: Lens::Thin(lens),
        film: Film::new(36.0, 24.0, 12, 8),
        motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()),
    };
    let d = Description { environment: Some(Environment::uniform(Vec3::splat(100.0))), ..Default::default() };
    let (scene, sensor) = (Scene::build(d).unwrap(), diopter::sensor::Sensor::named("canon-5d-mark-iv").unwrap());
    let light = |camera: &Camera| {
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
        let facts = ExposureFacts::default();
        let plane = expose(&scene, camera, &Shutter::global(1.0), &Response::sensor(&sensor), &Settings::new(64), &facts, &watch)
            .unwrap();
        plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    let (a, b) = (light(&camera), light(&sharp_camera(&camera)));
    assert!((a / b - 1.0).abs() < 2e-3, "{a} {b}");
}

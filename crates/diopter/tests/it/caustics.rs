//! Exposures with caustics by photons keep the promises of all exposures.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Lens, Pinhole};
use diopter::light::Spectrum;
use diopter::light::units::Millimeters;
use diopter::scene::light::{Punctual, PunctualKind};
use diopter::scene::material::{Material, Scattering};
use diopter::scene::shape::{Quad, Sphere};
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{
    Camera, CameraMotion, Film, Integrator, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter,
};
use glam::Vec3;
use std::sync::atomic::AtomicBool;

const SECOND: Shutter = Shutter { mechanism: diopter::shutter::Mechanism::Global, exposure_s: 1.0 };

fn take(scene: &Scene, camera: &Camera, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, &SECOND, &Response::luminance(), settings, &ExposureFacts::default(), &watch).unwrap()
}

/// A glass ball between a point lamp and a floor, seen from above the floor's edge.
fn ball(columns: usize, rows: usize) -> (Scene, Camera) {
    let floor = Quad { corner: Vec3::new(-2.0, 0.0, -2.0), edges: [Vec3::Z * 4.0, Vec3::X * 4.0] };
    let sphere = Sphere { center: Vec3::new(0.0, 0.6, 0.0), radius: 0.35 };
    let position = Vec3::new(0.0, 2.0, 0.0);
    let description = Description {
        materials: vec![
            Material::new("floor", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5))),
            Material::glass("glass", 1.5, None),
        ],
        objects: vec![Object::new("floor", Shape::Quad(floor), 0), Object::new("ball", Shape::Sphere(sphere), 1)],
        punctual: vec![Punctual::new("lamp", Spectrum::Constant(1.0), PunctualKind::Point { position })],
        ..Default::default()
    };
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(35.0), 8.0).unwrap());
    let place = look_at(Vec3::new(0.0, 1.2, 2.5), Vec3::ZERO, Vec3::Y).unwrap();
    let camera = Camera { lens, film: Film::new(25.0, 25.0, columns, rows), motion: CameraMotion::still(place) };
    (Scene::build(description).unwrap(), camera)
}

#[test]
fn threads_and_parts_do_not_change_an_exposure_with_photons() {
    let (scene, camera) = ball(20, 17);
    // Samples of two pairs of maps: these pixels share one for 256 samples.
    let settings = |samples| Settings { samples, integrator: Integrator::Auto, truth: false, ..Settings::new(512) };
    let with = |threads: usize, samples: std::ops::Range<u32>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| take(&scene, &camera, &settings(samples)))
    };
    let whole = with(1, 252..260);
    assert_eq!(whole, with(3, 252..260));
    // A part that ends within a map's samples, too.
    let merged = FocalPlane::merge(&[with(2, 252..254), with(2, 254..258), with(2, 258..260)]).unwrap();
    for (a, b) in whole.mean.data.iter().zip(&merged.mean.data) {
        // Rounding of planes in single precision.
        assert!((a - b).abs() <= 2e-6 * a.abs().max(1.0), "{a} {b}");
    }
    // The caustic of a point is what paths alone never find.
    let path = take(&scene, &camera, &Settings { integrator: Integrator::Path, ..settings(252..260) });
    let total = |p: &FocalPlane| p.mean.data.iter().sum::<f32>();
    assert!(total(&whole) > 1.02 * total(&path), "{} {}", total(&whole), total(&path));
}

//! Small lamps out of focus: light traced from them is the light that paths from the camera find, with less noise.

use diopter::camera::look_at;
use diopter::expose::{ProgressReporter, Sums};
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Iris, Lens, ThinLens, embedded};
use diopter::light::units::Millimeters;
use diopter::scene::light::{Environment, Modulation};
use diopter::scene::material::{Emission, EmissionColor, Material, Scattering};
use diopter::scene::shape::{Quad, Sphere};
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::sensor::Sensor;
use diopter::shutter::{Direction, Mechanism, Shutter};
use diopter::{Camera, CameraMotion, Film, Integrator, Response, Settings, expose};
use glam::{Affine3A, Vec3};
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What is photographed, and how.
struct Shot {
    scene: Scene,
    camera: Camera,
    shutter: Shutter,
    response: Response,
}

impl Shot {
    fn new(scene: Scene, lens: Lens, film: Film) -> Shot {
        let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
        let motion = CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap());
        Shot { scene, camera: Camera { lens, film, motion }, shutter: Shutter::global(1.0), response }
    }

    fn take(&self, settings: &Settings) -> FocalPlane {
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
        let facts = ExposureFacts::default();
        expose(&self.scene, &self.camera, &self.shutter, &self.response, settings, &facts, &watch).unwrap()
    }

    /// Means of some seeds.
    fn means(&self, integrator: Integrator, spp: u32, seeds: Range<u64>) -> Vec<FocalPlane> {
        let settings = |seed| Settings { integrator, truth: false, seed, ..Settings::new(spp) };
        seeds.map(|seed| self.take(&settings(seed))).collect()
    }
}

fn lamp(radiance: f32, is_light: bool, modulation: Modulation) -> Material {
    // Not grey: colours land elsewhere.
    let spectrum = diopter::light::spectrum::blackbody_with_luminance(2500.0, 70_000.0 * radiance);
    let emission = Emission { radiance: EmissionColor::Constant(spectrum), two_sided: false, is_light, modulation };
    Material { emission: Some(emission), ..Material::new("lamp", Scattering::Black) }
}

fn scene(lamp: Material, shape: Shape, card: Option<Quad>) -> Scene {
    let mut objects = vec![Object::new("lamp", shape, 0)];
    objects.extend(card.map(|quad| Object::new("card", Shape::Quad(quad), 1)));
    Scene::build(Description {
        materials: vec![lamp, Material::new("card", Scattering::Black)],
        objects,
        environment: Some(Environment::uniform(Vec3::splat(20.0))),
        ..Default::default()
    })
    .unwrap()
}

fn ball(center: Vec3, radius: f32) -> Shape {
    Shape::Sphere(Sphere { center, radius })
}

/// A square that faces the camera.
fn square(middle: Vec3, side: f32) -> Shape {
    let edges = [Vec3::X * side, Vec3::Y * side];
    Shape::Quad(Quad { corner: middle - 0.5 * (edges[0] + edges[1]), edges })
}

fn thin(focus_mm: f64, iris: Iris) -> ThinLens {
    ThinLens::new(Millimeters(50.0), 2.0, iris, Focus::Distance(Millimeters(focus_mm))).unwrap()
}

fn gauss(focus: Focus) -> Lens {
    let setting = Setting { focal_length: None, f_number: Some(2.0), focus, iris: None, film_mm: [36.0, 24.0] };
    Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded("double-gauss-50mm").unwrap()), &setting).unwrap()))
}

/// A piece of a full-frame film, 24 × 16 pixels, around the image of a place of the scene; `width_mm` wide.
fn film_around(at: Vec3, image_mm: f64, width_mm: f64) -> Film {
    let [x, y] = [at.x, at.y].map(|v| f64::from(v / -at.z) * image_mm);
    let (width, height) = (width_mm / 36.0, width_mm / 36.0);
    Film::new(36.0, 24.0, 24, 16).piece([0.5 + x / 36.0 - 0.5 * width, 0.5 - y / 24.0 - 0.5 * height, width, height], 24, 16)
}

/// Light in the left and in the right half of a picture, all bands.
fn halves(plane: &FocalPlane) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let bands = plane.bands.len();
    for (i, v) in plane.mean.data.iter().enumerate() {
        sums[usize::from(i / bands % plane.mean.width >= plane.mean.width / 2)] += f64::from(*v);
    }
    sums
}

/// Sum over the pixels of the variance over pictures.
fn variance(planes: &[FocalPlane]) -> f64 {
    let n = planes.len() as f64;
    let of = |i: usize| {
        let values = planes.iter().map(|p| f64::from(p.mean.data[i]));
        let mean = values.clone().sum::<f64>() / n;
        values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)
    };
    (0..planes[0].mean.data.len()).map(of).sum()
}

/// Holds pictures with light from the lamps against those of camera paths alone: the same light, at least so many times less noise.
fn compare(name: &str, shot: &Shot, gain: f64) {
    const SEEDS: u64 = 12;
    let paths = shot.means(Integrator::Path, 96, 1..SEEDS + 1);
    let both = shot.means(Integrator::Auto, 96, 1..SEEDS + 1);
    for side in 0..2 {
        let mean_and_variance = |planes: &[FocalPlane]| {
            let values: Vec<f64> = planes.iter().map(|p| halves(p)[side]).collect();
            let mean = values.iter().sum::<f64>() / SEEDS as f64;
            (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / ((SEEDS - 1) * SEEDS) as f64)
        };
        let ((a, va), (b, vb)) = (mean_and_variance(&paths), mean_and_variance(&both));
        let sigma = (va + vb).sqrt();
        println!("{name} {side}: {a:.6e} {b:.6e}, {:.2} σ, σ {:.2} %", (b - a) / sigma, 100.0 * sigma / a);
        // Beyond 4 of a dozen pictures' standard errors: one in 2000 for their t distribution.
        assert!((a - b).abs() < 4.0 * sigma, "{name}, half {side}: {a} {b} ± {sigma}");
        assert!(sigma < 0.1 * a, "{name}: too noisy to tell");
    }
    let ratio = variance(&paths) / variance(&both);
    println!("{name}: {ratio:.1} times less variance");
    assert!(ratio > gain, "{name}: {ratio}");
}

#[test]
fn through_a_thin_lens_light_from_lamps_is_the_light_that_paths_find() {
    let at = Vec3::new(0.1, 0.06, -2.5);
    let plain = lamp(1.0, true, Modulation::Steady);
    let leaf = Shutter { mechanism: Mechanism::Leaf { ramp_s: 0.01 }, exposure_s: 0.01 };
    let near = Shot {
        shutter: leaf,
        ..Shot::new(scene(plain.clone(), ball(at, 0.03), None), Lens::Thin(thin(500.0, Iris::Round)), film_around(at, 55.0, 9.0))
    };
    compare("ball, leaf shutter", &near, 5.0);
    // Not aimed at by scattered light, through blades; the lens turned; pixels with gaps behind a low-pass filter.
    let blades = Iris::blades(5, 0.3, 0.0).unwrap();
    let tilted = Lens::Thin(thin(900.0, blades).tilted([0.1, -0.12]).unwrap());
    let film = Film { low_pass_mm: 0.2, gap_mm: [0.1, 0.05], ..film_around(at, 52.0, 9.0) };
    let unlit = lamp(1.0, false, Modulation::Sine { frequency_hz: 1.3, depth: 0.8, phase: 0.4 });
    compare("square, tilted lens", &Shot::new(scene(unlit, square(at, 0.03), None), tilted, film), 3.0);
}

#[test]
fn through_a_double_gauss_light_from_lamps_is_the_light_that_paths_find() {
    let plain = || lamp(1.0, true, Modulation::Steady);
    let at = Vec3::new(0.1, 0.06, -2.5);
    let near = Focus::Distance(Millimeters(500.0));
    // A card cuts the beam before the lens.
    let card = Quad { corner: Vec3::new(-0.96, -1.0, -1.0), edges: [Vec3::X, Vec3::Y * 2.0] };
    compare(
        "ball behind a card",
        &Shot::new(scene(plain(), ball(at, 0.03), Some(card)), gauss(near), film_around(at, 55.0, 9.0)),
        5.0,
    );
    // At the edge of the field rims cut the pupil; the lamp is nearer than what is sharp.
    let edge = Vec3::new(0.36, -0.2, -1.2);
    compare(
        "square at the edge",
        &Shot::new(scene(plain(), square(edge, 0.02), None), gauss(Focus::Infinity), film_around(edge, 50.0, 4.5)),
        3.0,
    );
    // Rows one after the other, while the camera moves.
    let mechanism = Mechanism::Rolling { reset_s: 0.02, readout_s: 0.02, direction: Direction::Down };
    let mut rolling = Shot::new(scene(plain(), ball(at, 0.03), None), gauss(near), film_around(at, 55.0, 9.0));
    rolling.shutter = Shutter { mechanism, exposure_s: 0.02 };
    let still = rolling.camera.motion.at(0.0);
    let span = rolling.shutter.total_s();
    rolling.camera.motion =
        CameraMotion::sampled(span, |t| Affine3A::from_translation(Vec3::X * (0.04 * (t / span) as f32)) * still);
    compare("rolling shutter, moving camera", &rolling, 2.0);
}

#[test]
fn threads_parts_and_pauses_do_not_change_an_exposure_with_light_from_lamps() {
    let at = Vec3::new(0.1, 0.06, -2.5);
    let lens = gauss(Focus::Distance(Millimeters(500.0)));
    let shot = Shot::new(scene(lamp(1.0, true, Modulation::Steady), ball(at, 0.03), None), lens, film_around(at, 55.0, 9.0));
    let settings = |samples| Settings { samples, truth: false, ..Settings::new(24) };
    let with = |threads: usize, samples: Range<u32>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| shot.take(&settings(samples)))
    };
    let whole = with(1, 0..24);
    assert_eq!(whole, with(4, 0..24));
    let merged = FocalPlane::merge(&[with(2, 0..6), with(3, 6..13), with(2, 13..24)]).unwrap();
    let brightest = whole.mean.data.iter().copied().fold(0.0, f32::max);
    for (a, b) in whole.mean.data.iter().zip(&merged.mean.data) {
        // Rounding of planes in single precision.
        assert!((a - b).abs() <= 2e-6 * brightest, "{a} {b}");
    }
    // Paused after the first tiles and gone on from a copy of the sums.
    let facts = ExposureFacts::default();
    let wanted = settings(0..24);
    let exposure = diopter::expose::Exposure {
        scene: &shot.scene,
        camera: &shot.camera,
        shutter: &shot.shutter,
        response: &shot.response,
        settings: &wanted,
        facts: &facts,
    };
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let mut kept: Option<Sums> = None;
    let mut keep = |sums: &Sums| {
        kept = Some(sums.clone());
        ControlFlow::Break(())
    };
    let stopped = exposure.run(&watch, None, Some(&mut keep));
    match kept {
        // The film is one batch of tiles: there may be no pause before its last pass.
        None => assert_eq!(stopped.unwrap().plane, whole),
        Some(sums) => assert_eq!(exposure.run(&watch, Some(sums), None).unwrap().plane, whole),
    }
}

#[test]
fn the_claimed_variance_of_a_disk_is_that_of_many_exposures() {
    let at = Vec3::new(0.1, 0.06, -2.5);
    let lens = gauss(Focus::Distance(Millimeters(500.0)));
    let shot = Shot::new(scene(lamp(1.0, true, Modulation::Steady), ball(at, 0.03), None), lens, film_around(at, 55.0, 9.0));
    let planes = shot.means(Integrator::Auto, 16, 1..41);
    let claimed: f64 = planes.iter().flat_map(|p| &p.half_difference.data).map(|h| f64::from(*h).powi(2)).sum();
    let (claimed, seen) = (claimed / planes.len() as f64, variance(&planes));
    println!("claimed {claimed:.4e}, seen {seen:.4e}");
    // 40 exposures of some 100 pixels: either is known within a few per cent.
    assert!((claimed / seen - 1.0).abs() < 0.15, "{claimed} {seen}");
}

#[test]
fn sharp_and_large_lamps_are_left_to_camera_paths() {
    // Bits of pictures without and with the strategy are the same: no light sample is taken.
    let at = Vec3::new(0.0, 0.0, -2.5);
    for (side, focus_mm) in [(0.2, 2500.0), (1.5, 500.0)] {
        let shot = Shot::new(
            scene(lamp(1.0, true, Modulation::Steady), square(at, side), None),
            Lens::Thin(thin(focus_mm, Iris::Round)),
            Film::new(36.0, 24.0, 48, 32),
        );
        let [path, auto] = [Integrator::PathReuse, Integrator::Auto]
            .map(|integrator| shot.take(&Settings { integrator, truth: false, ..Settings::new(4) }).mean.data);
        assert!(path == auto, "{side} m, focus {focus_mm} mm");
    }
}

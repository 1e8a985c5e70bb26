//! Exposures with connections of camera paths and light paths keep the promises of all exposures.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Lens, Pinhole};
use diopter::light::Spectrum;
use diopter::light::units::Millimeters;
use diopter::scene::light::{Punctual, PunctualKind};
use diopter::scene::material::{Coverage, Material, Scattering};
use diopter::scene::shape::Quad;
use diopter::scene::texture::{Color, Scalar};
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{
    Camera, CameraMotion, Film, Integrator, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter,
};
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

const SECOND: Shutter = Shutter { mechanism: diopter::shutter::Mechanism::Global, exposure_s: 1.0 };

pub fn take(scene: &Scene, camera: &Camera, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, &SECOND, &Response::luminance(), settings, &ExposureFacts::default(), &watch).unwrap()
}

pub fn quad(name: &str, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> Object {
    Object::new(name, Shape::Quad(Quad { corner: corner.into(), edges: edges.map(Vec3::from) }), material)
}

/// A box of 2 × 2 × 2 m with a lamp that shines at its ceiling, hidden from below by a plate.
pub fn room(columns: usize, rows: usize) -> (Scene, Camera) {
    let grey = |name: &str| Material::new(name, Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)));
    let objects = vec![
        quad("floor", [-1.0, -1.0, -1.0], [[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]], 0),
        quad("ceiling", [-1.0, 1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("left", [-1.0, -1.0, -1.0], [[0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("right", [1.0, -1.0, -1.0], [[0.0, 0.0, 2.0], [0.0, 2.0, 0.0]], 0),
        quad("back", [-1.0, -1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], 0),
        quad("lamp", [-0.1, 0.6, -0.1], [[0.0, 0.0, 0.2], [0.2, 0.0, 0.0]], 1),
        quad("shade", [-0.3, 0.55, -0.3], [[0.0, 0.0, 0.6], [0.6, 0.0, 0.0]], 0),
    ];
    let materials = vec![grey("wall"), Material::lamp("lamp", Spectrum::Constant(1.0))];
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(35.0), 8.0).unwrap());
    let place = look_at(Vec3::new(0.0, 0.0, 2.8), Vec3::ZERO, Vec3::Y).unwrap();
    let camera = Camera { lens, film: Film::new(36.0, 24.0, columns, rows), motion: CameraMotion::still(place) };
    (Scene::build(Description { materials, objects, ..Default::default() }).unwrap(), camera)
}

/// The same box without its lamp; the sun comes in through a hole in its ceiling and lights a patch that the camera does not see.
fn sunlit_room(columns: usize, rows: usize) -> (Scene, Camera) {
    let (scene, camera) = room(columns, rows);
    let mut description = scene.description().clone();
    description.objects.retain(|o| !["ceiling", "lamp", "shade"].contains(&o.name.as_str()));
    description.objects.extend([
        quad("ceiling", [-1.0, 1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 0),
        quad("ceiling", [-1.0, 1.0, 0.0], [[0.8, 0.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("ceiling", [0.2, 1.0, 0.0], [[0.8, 0.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("ceiling", [-0.2, 1.0, 0.3], [[0.4, 0.0, 0.0], [0.0, 0.0, 1.7]], 0),
        quad("front", [-1.0, -1.0, 2.0], [[0.0, 2.0, 0.0], [2.0, 0.0, 0.0]], 0),
        quad("floor", [-1.0, -1.0, 1.0], [[0.0, 0.0, 1.0], [2.0, 0.0, 0.0]], 0),
    ]);
    let kind = PunctualKind::Disc { direction: Vec3::new(0.2, -1.0, 0.75).normalize(), half_angle: 0.0047 };
    description.punctual.push(Punctual::new("sun", Spectrum::Constant(1.0), kind));
    let place = look_at(Vec3::new(0.0, 0.0, 0.9), Vec3::new(0.0, 0.2, 0.0), Vec3::Y).unwrap();
    (Scene::build(description).unwrap(), Camera { motion: CameraMotion::still(place), ..camera })
}

pub fn settings(integrator: Integrator, spp: u32, seed: u64) -> Settings {
    Settings { integrator, seed, truth: false, ..Settings::new(spp) }
}

#[test]
fn threads_and_parts_do_not_change_a_bidirectional_exposure() {
    for (scene, camera) in [room(15, 10), sunlit_room(15, 10)] {
        let settings = |samples| Settings { samples, ..settings(Integrator::Bidirectional, 512, 1) };
        // Samples of two pairs of pools: these pixels share one for 256 samples.
        threads_and_parts(&scene, &camera, settings, [252, 254, 258, 260]);
    }
}

/// Numbers of threads do not change a bit, parts between these samples merge to the whole, and it is not what paths alone make.
pub fn threads_and_parts(scene: &Scene, camera: &Camera, settings: impl Fn(Range<u32>) -> Settings + Sync, ends: [u32; 4]) {
    let with = |threads: usize, samples: Range<u32>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| take(scene, camera, &settings(samples)))
    };
    let [a, b, c, d] = ends;
    let whole = with(1, a..d);
    assert_eq!(whole, with(2, a..d));
    assert_eq!(whole, with(16, a..d));
    let merged = FocalPlane::merge(&[with(2, a..b), with(1, b..c), with(2, c..d)]).unwrap();
    for (a, b) in whole.mean.data.iter().zip(&merged.mean.data) {
        // Rounding of planes in single precision.
        assert!((a - b).abs() <= 2e-6 * a.abs().max(1.0), "{a} {b}");
    }
    let path = take(scene, camera, &Settings { integrator: Integrator::Path, ..settings(a..d) });
    assert!(whole != path);
}

/// Variance of all pixels, as exposures of several seeds claim it and as it is between them.
pub fn claimed_and_seen(planes: &[FocalPlane]) -> [f64; 2] {
    let seeds = planes.len() as f64;
    let (mut claimed, mut seen) = (0.0, 0.0);
    for pixel in 0..planes[0].mean.data.len() {
        let values: Vec<f64> = planes.iter().map(|p| f64::from(p.mean.data[pixel])).collect();
        let mean = values.iter().sum::<f64>() / seeds;
        seen += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (seeds - 1.0);
        claimed += planes.iter().map(|p| f64::from(p.half_difference.data[pixel]).powi(2)).sum::<f64>() / seeds;
    }
    [claimed, seen]
}

#[test]
fn the_claimed_variance_is_that_between_seeds() {
    let (scene, camera) = room(18, 12);
    const SEEDS: u64 = 30;
    let planes: Vec<FocalPlane> =
        (1..=SEEDS).map(|seed| take(&scene, &camera, &settings(Integrator::Bidirectional, 8, seed))).collect();
    let [claimed, seen] = claimed_and_seen(&planes);
    println!("claimed over seen {}", claimed / seen);
    // 216 pixels of 30 seeds: 5 % of each.
    assert!((claimed / seen - 1.0).abs() < 0.1, "{claimed} {seen}");
}

#[test]
fn a_curtain_lets_its_part_of_the_sun_through() {
    let (scene, camera) = sunlit_room(24, 16);
    let light = |curtain: bool, integrator: Integrator, spp: u32| {
        let mut d = scene.description().clone();
        if curtain {
            let black = Material::new("curtain", Scattering::Diffuse(Color::rgb(0.0, 0.0, 0.0)));
            d.materials.push(Material { coverage: Coverage::Blend(Scalar::Constant(0.6)), ..black });
            d.objects.push(quad(
                "curtain",
                [-5.0, 3.0, -5.0],
                [[10.0, 0.0, 0.0], [0.0, 0.0, 10.0]],
                d.materials.len() as u32 - 1,
            ));
        }
        let plane = take(&Scene::build(d).unwrap(), &camera, &settings(integrator, spp, 7));
        plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    // Light paths that a curtain stopped were asked a second time, which let 0.4 + 0.6 · 0.4 through.
    let through = light(true, Integrator::Bidirectional, 256) / light(false, Integrator::Bidirectional, 256);
    println!("{through}");
    assert!((through / 0.4 - 1.0).abs() < 0.06, "{through}");
    let by_paths = light(true, Integrator::Path, 512) / light(true, Integrator::Bidirectional, 256);
    println!("{by_paths}");
    assert!((by_paths - 1.0).abs() < 0.1, "{by_paths}");
}

#[test]
fn auto_connects_where_walls_pass_on_the_light_of_a_small_lamp_and_not_under_a_large_one() {
    let (shaded, camera) = room(96, 64);
    let with_lamp = |walls: usize, objects: Vec<Object>| {
        let mut description = shaded.description().clone();
        description.objects.truncate(walls);
        description.objects.extend(objects);
        Scene::build(description).unwrap()
    };
    // A spot of light on the ceiling lights the room.
    let over_the_ceiling = with_lamp(
        5,
        vec![
            quad("lamp", [-0.1, 0.9, -0.1], [[0.0, 0.0, 0.2], [0.2, 0.0, 0.0]], 1),
            quad("shade", [-0.1, 0.89, -0.1], [[0.0, 0.0, 0.2], [0.2, 0.0, 0.0]], 0),
        ],
    );
    // A large one hangs high over a floor before a wall.
    let directly = with_lamp(
        1,
        vec![
            quad("lamp", [-0.9, 0.9, -0.9], [[1.8, 0.0, 0.0], [0.0, 0.0, 1.8]], 1),
            quad("back", [-1.0, -1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], 0),
        ],
    );
    let (sun, in_the_sun) = sunlit_room(96, 64);
    for seed in 1..=4 {
        // Where pixels lend one another light it is as good.
        let good = [Integrator::Bidirectional, Integrator::PathReuse];
        let in_sun = |integrator: Integrator| take(&sun, &in_the_sun, &settings(integrator, 64, seed));
        let auto = in_sun(Integrator::Auto);
        assert!(good.iter().any(|integrator| auto == in_sun(*integrator)), "sun, seed {seed}");
        let by = |scene: &Scene, integrator: Integrator| take(scene, &camera, &settings(integrator, 8, seed));
        // Not `assert_eq`: planes are long to print.
        let auto = by(&over_the_ceiling, Integrator::Auto);
        assert!(good.iter().any(|integrator| auto == by(&over_the_ceiling, *integrator)), "seed {seed}");
        assert!(by(&directly, Integrator::Auto) == by(&directly, Integrator::Path), "seed {seed}");
        assert!(by(&directly, Integrator::Path) != by(&directly, Integrator::Bidirectional));
    }
}

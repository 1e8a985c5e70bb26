//! Path guiding: the same mean as without, less noise where light comes in through an opening, nothing where it cannot help.

use diopter_light::random::{Sampler, SamplerKind, Set};
use diopter_light::{Ray, Spectrum, Wavelengths};
use diopter_scene::guide::{Trained, Training};
use diopter_scene::light::Environment;
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Emission, EmissionColor, Material, Principled, Scattering, Transmission};
use diopter_scene::shape::{Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Guide, GuideMode, Object, PathSettings, Precomputed, Scene, Shape};
use glam::Vec3;

const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];
const FILM: [u32; 2] = [16, 16];

/// A pinhole with a field of view of 90°.
#[derive(Clone, Copy)]
struct Eye {
    from: Vec3,
    towards: Vec3,
}

impl Eye {
    fn ray(&self, [x, y]: [u32; 2], sampler: &Sampler) -> Option<(Ray, Wavelengths)> {
        let [u, v, ..] = sampler.get(Set::Camera);
        let forward = self.towards.normalize();
        let right = forward.cross(Vec3::new(0.1, 1.0, 0.05)).normalize();
        let at = |k: f32, n: u32, u: f32| 2.0 * (k + u) / n as f32 - 1.0;
        let (a, b) = (at(x as f32, FILM[0], u), at(y as f32, FILM[1], v));
        let direction = (forward + right * a + right.cross(forward) * b).normalize();
        Some((Ray { origin: self.from, direction, time_s: 0.0 }, Wavelengths::fixed(NM)))
    }
}

fn train(scene: &Scene, eye: Eye, paths: u64, path: PathSettings, mode: GuideMode) -> Trained {
    let training = Training { paths, film: FILM, seed: 7, path, mode };
    training.run(scene, &|at, sampler| eye.ray(at, sampler), &mut |_| true).expect("nothing stops it")
}

/// Mean of green over the film, its standard error from independent samples, and the mean variance of a pixel.
fn expose(scene: &Scene, eye: Eye, guide: Option<&Guide>, n: u32, path: &PathSettings) -> [f64; 3] {
    let (mut mean, mut variance) = (0.0f64, 0.0f64);
    let pixels = FILM[0] * FILM[1];
    for p in 0..pixels {
        let at = [p % FILM[0], p / FILM[0]];
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        for i in 0..n {
            let sampler = Sampler::new(SamplerKind::Independent, 21, (at[0], at[1]), i, n);
            let (ray, wavelengths) = eye.ray(at, &sampler).unwrap();
            let white = wavelengths.d65_one_nit().y;
            let l =
                f64::from(scene.radiance_with(Precomputed { guide, photons: None }, ray, &wavelengths, &sampler, path).y / white);
            sum += l;
            squares += l * l;
        }
        let n = f64::from(n);
        mean += sum / n;
        variance += (squares / n - (sum / n).powi(2)) * n / (n - 1.0);
    }
    let pixels = f64::from(pixels);
    [mean / pixels, (variance / f64::from(n)).sqrt() / pixels, variance / pixels]
}

fn ball(radius: f32) -> Shape {
    Shape::Sphere(Sphere { center: Vec3::ZERO, radius })
}

/// Materials that absorb nothing.
fn white_materials() -> Vec<Material> {
    let s = Scalar::Constant;
    let constant = Spectrum::Constant;
    let metal =
        Conductor { n: constant(0.0), k: constant(1000.0), alpha: s(0.3), across: None, bounces: FacetBounces::Compensated };
    let mut glass = Principled::new(Color::rgb(1.0, 1.0, 1.0), 1.5);
    (glass.kind, glass.transmission, glass.roughness) = (Transmission::Solid, s(1.0), s(0.6));
    vec![
        Material::new("diffuse", Scattering::Diffuse(Color::rgb(1.0, 1.0, 1.0))),
        Material::new("conductor", Scattering::Conductor(metal)),
        Material::new("glass", Scattering::Principled(Box::new(glass))),
    ]
}

#[test]
fn white_furnaces_stay_white_when_guided() {
    // A body that absorbs nothing cannot be seen: in an even sky (1), and in a sphere that shines with 1 and reflects ½ (1 / (1 − ½) = 2).
    let path = PathSettings { max_depth: 500, ..Default::default() };
    for material in white_materials() {
        let name = material.name.clone();
        let open = Scene::build(Description {
            materials: vec![material.clone()],
            objects: vec![Object::new("ball", ball(1.0), 0)],
            environment: Some(Environment::uniform(Vec3::ONE)),
            ..Default::default()
        });
        let emission = Emission {
            radiance: EmissionColor::Constant(Spectrum::light_from_rgb(Vec3::ONE)),
            two_sided: true,
            is_light: true,
            modulation: Default::default(),
        };
        let shell = Material::new("shell", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)));
        let closed = Scene::build(Description {
            materials: vec![material, Material { emission: Some(emission), ..shell }],
            objects: vec![Object::new("ball", ball(1.0), 0), Object::new("shell", ball(4.0), 1)],
            ..Default::default()
        });
        let eye = Eye { from: Vec3::new(0.3, 0.2, 2.5), towards: Vec3::new(-0.1, 0.0, -1.0) };
        for (scene, expected) in [(open.unwrap(), 1.0), (closed.unwrap(), 2.0)] {
            let guide = train(&scene, eye, 1 << 13, path, GuideMode::On).guide.expect("it is on");
            let [mean, error, _] = expose(&scene, eye, Some(&guide), 64, &path);
            // The tables that make materials white are good to 1 %.
            assert!((mean / expected - 1.0).abs() < 4.0 * error / expected + 0.01, "{name}: {mean} ± {error}, not {expected}");
            assert!(error < 0.05 * expected, "{name}: too noisy to tell: {error}");
        }
    }
}

/// A room of 3 m, diffuse, lit by an even sky through a window of 40 cm; nothing aims at an even sky.
fn room() -> (Scene, Eye) {
    let quad = |corner: [f32; 3], a: [f32; 3], b: [f32; 3]| {
        Shape::Quad(Quad { corner: Vec3::from_array(corner), edges: [Vec3::from_array(a), Vec3::from_array(b)] })
    };
    let faces = [
        quad([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 3.0]),
        quad([0.0, 3.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 3.0]),
        quad([0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]),
        quad([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]),
        quad([0.0, 0.0, 3.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]),
        // Around the window at x = 3.
        quad([3.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, 3.0]),
        quad([3.0, 1.9, 0.0], [0.0, 1.1, 0.0], [0.0, 0.0, 3.0]),
        quad([3.0, 1.5, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 1.0]),
        quad([3.0, 1.5, 1.4], [0.0, 0.4, 0.0], [0.0, 0.0, 1.6]),
    ];
    let scene = Scene::build(Description {
        materials: vec![Material::new("wall", Scattering::Diffuse(Color::rgb(0.6, 0.6, 0.6)))],
        objects: faces.into_iter().map(|f| Object::new("wall", f, 0)).collect(),
        environment: Some(Environment::uniform(Vec3::splat(1000.0))),
        ..Default::default()
    });
    (scene.unwrap(), Eye { from: Vec3::new(2.8, 1.2, 2.8), towards: Vec3::new(-1.0, -0.1, -0.7) })
}

#[test]
fn a_room_lit_through_an_opening_has_the_same_mean_and_less_noise() {
    let (scene, eye) = room();
    let path = PathSettings { max_depth: 12, ..Default::default() };
    let trained = train(&scene, eye, 1 << 16, path, GuideMode::On);
    assert!(trained.gain > Some(1.1), "training sees no gain: {:?}", trained.gain);
    let guide = trained.guide.expect("it is on");
    assert!(guide.memory() < 10 << 20, "{} bytes in {} regions", guide.memory(), guide.regions());
    let [with, with_error, guided] = expose(&scene, eye, Some(&guide), 128, &path);
    let [without, error, unguided] = expose(&scene, eye, None, 512, &path);
    // Three deviations, and a little for their being estimates.
    assert!((with - without).abs() < 3.5 * with_error.hypot(error), "{with} ± {with_error}, {without} ± {error}");
    // Chance finds the window (0.6 % of what a wall sees) with one of hundreds of directions, the guide with one of a few.
    assert!(guided < unguided / 2.0, "variances {guided} and {unguided}; the training says a gain of {:?}", trained.gain);
}

#[test]
fn one_and_four_threads_learn_the_same_guide() {
    let (scene, eye) = room();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let trained = pool.install(|| train(&scene, eye, 1 << 14, PathSettings::default(), GuideMode::On));
        (trained.guide.unwrap(), trained.gain)
    };
    let one = with(1);
    assert!(one == with(4), "the guides differ");
    assert!(one.0.regions() > 1, "it has learnt nothing");
}

#[test]
fn in_the_open_training_gives_up_early() {
    let scene = Scene::build(Description {
        materials: vec![Material::new("grey", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
        objects: vec![
            Object::new("ball", ball(1.0), 0),
            Object::new(
                "floor",
                Shape::Quad(Quad { corner: Vec3::new(-9.0, -1.0, 9.0), edges: [Vec3::X * 18.0, Vec3::Z * -18.0] }),
                0,
            ),
        ],
        environment: Some(Environment::uniform(Vec3::ONE)),
        ..Default::default()
    });
    let eye = Eye { from: Vec3::new(0.0, 1.0, 4.0), towards: Vec3::new(0.0, -0.4, -1.0) };
    let trained = train(&scene.unwrap(), eye, 1 << 15, PathSettings::default(), GuideMode::Auto);
    assert!(trained.guide.is_none() && trained.paths <= 1 << 13, "gain {:?} after {} paths", trained.gain, trained.paths);
}

#[test]
fn training_is_for_exposures_that_can_pay_for_it() {
    let path = PathSettings::default();
    assert_eq!(Training::paths(1 << 20, &path, GuideMode::Auto), Some(1 << 17));
    assert_eq!(Training::paths(1 << 16, &path, GuideMode::Auto), None);
    assert_eq!(Training::paths(1 << 40, &path, GuideMode::Off), None);
    assert!(Training::paths(1 << 40, &path, GuideMode::Auto).unwrap() <= 1 << 23);
    assert!(Training::paths(1, &path, GuideMode::On).is_some());
    let flat = PathSettings { max_depth: 1, ..path };
    assert_eq!(Training::paths(1 << 30, &flat, GuideMode::Auto), None);
}

#[test]
fn training_that_is_stopped_gives_nothing() {
    let (scene, eye) = room();
    let training = Training { paths: 1 << 14, film: FILM, seed: 1, path: PathSettings::default(), mode: GuideMode::On };
    let mut calls = 0;
    let trained = training.run(&scene, &|at, sampler| eye.ray(at, sampler), &mut |_| {
        calls += 1;
        calls < 3
    });
    assert!(trained.is_none());
}

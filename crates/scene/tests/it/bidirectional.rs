//! Connections of camera paths with light vertices against the path tracer and closed forms: the same light, with less noise.

use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::wavelength::WavelengthSampler;
use diopter_light::{Ray, SampledWavelengths, Spectrum};
use diopter_scene::bvh::Bounds;
use diopter_scene::light::{Punctual, PunctualKind, SpotEdge};
use diopter_scene::light_paths::{CameraRays, ConnectionSettings, Connections, LightPaths, LightVertices};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Emission, Material, Principled, Scattering, Transmission};
use diopter_scene::medium::{Air, Medium};
use diopter_scene::radiance::CameraPath;
use diopter_scene::shape::{Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::Vec3;

fn diffuse(name: &str, [r, g, b]: [f32; 3]) -> Material {
    Material::new(name, Scattering::Diffuse(Color::rgb(r, g, b)))
}

fn quad(name: &str, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> Object {
    Object::new(name, Shape::Quad(Quad { corner: corner.into(), edges: edges.map(Vec3::from) }), material)
}

fn ball(name: &str, center: [f32; 3], radius: f32, material: u32) -> Object {
    Object::new(name, Shape::Sphere(Sphere { center: center.into(), radius }), material)
}

/// A box of 2 × 2 × 2 m around the origin; walls of material 0, the floor of material 1.
fn walls() -> Vec<Object> {
    vec![
        quad("floor", [-1.0, -1.0, -1.0], [[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]], 1),
        quad("ceiling", [-1.0, 1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("left", [-1.0, -1.0, -1.0], [[0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], 0),
        quad("right", [1.0, -1.0, -1.0], [[0.0, 0.0, 2.0], [0.0, 2.0, 0.0]], 0),
        quad("back", [-1.0, -1.0, -1.0], [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], 0),
        quad("front", [-1.0, -1.0, 1.0], [[0.0, 2.0, 0.0], [2.0, 0.0, 0.0]], 0),
    ]
}

/// The box, with a floor of a material and a square lamp that shines at the ceiling, hidden from below by a plate; `more` goes with materials from number 4 on.
fn room(floor: Material, lamp: Spectrum, more: Vec<(Material, Object)>) -> Scene {
    let mut materials =
        vec![diffuse("wall", [0.6, 0.5, 0.4]), floor, Material::lamp("lamp", lamp), diffuse("shade", [0.3, 0.3, 0.5])];
    let mut objects = walls();
    objects.push(quad("lamp", [-0.1, 0.6, -0.1], [[0.0, 0.0, 0.2], [0.2, 0.0, 0.0]], 2));
    objects.push(quad("shade", [-0.3, 0.55, -0.3], [[0.0, 0.0, 0.6], [0.6, 0.0, 0.0]], 3));
    for (material, mut object) in more {
        object.material = materials.len() as u32;
        materials.push(material);
        objects.push(object);
    }
    Scene::build(Description { materials, objects, ..Default::default() }).unwrap()
}

fn principled(name: &str, change: impl Fn(&mut Principled)) -> Material {
    let mut p = Principled::new(Color::rgb(0.7, 0.5, 0.3), 1.5);
    change(&mut p);
    Material::new(name, Scattering::Principled(Box::new(p)))
}

fn metal(alpha: f32) -> Material {
    let (n, k) = (Spectrum::Constant(1.5), Spectrum::Constant(4.0));
    let bounces = FacetBounces::Lost;
    Material::new(
        "metal",
        Scattering::Conductor(Conductor { n, k, alpha: Scalar::Constant(alpha), across: None, bounces, tint: None }),
    )
}

/// Mean, its standard error and the variance of a sample, over views from a corner of the box; `pools` are of both replicates.
struct Found {
    mean: f64,
    error: f64,
    variance: f64,
}

/// Where the view looks, by two numbers.
fn view([a, b]: [f32; 2]) -> Ray {
    Ray { origin: Vec3::new(0.3, -0.1, 0.9), direction: Vec3::new(-0.9 + 1.6 * a, -0.9 + 1.2 * b, -1.0).normalize(), time_s: 0.0 }
}

/// Rays of the view by number, from which is learnt where the sun matters.
fn camera_ray(number: u32) -> Option<(Ray, SampledWavelengths)> {
    let along = |step: f64| ((0.5 + step * f64::from(number)).fract()) as f32;
    Some((view([along(0.7549), along(0.5698)]), WavelengthSampler::rgb().sample(0.0)))
}

const CAMERA: CameraRays = CameraRays { ray: &camera_ray, most: 1 << 16 };

fn look(scene: &Scene, connections: Option<&Connections>, n: u32, seed: u64, max_depth: u32, rgb: bool) -> Found {
    let drawn = if rgb { WavelengthSampler::rgb() } else { WavelengthSampler::uniform() };
    let path = PathSettings { max_depth, ..Default::default() };
    // Parts with pools of their own: their means tell the error.
    const PARTS: u32 = 16;
    let mut means = Vec::new();
    let (mut sum, mut squares) = (0.0, 0.0);
    for part in 0..PARTS {
        let pool: Option<LightVertices> = connections.map(|c| c.pool(part / 2 + 100 * seed as u32, part % 2));
        let mut of_part = 0.0;
        for i in 0..n / PARTS {
            let sampler = Sampler::new(SamplerKind::Independent, seed, (part, 5), i, n);
            let [a, b, w, _] = sampler.get(diopter_light::random::Dimensions::Camera);
            let wavelengths: SampledWavelengths = drawn.sample(w);
            let ray = view([a, b]);
            let light_paths = LightPaths { photons: None, vertices: pool.as_ref() };
            let l = scene.radiance_along(&CameraPath { light_paths, ..CameraPath::new(ray, wavelengths, sampler) }, &path)
                * wavelengths.weight;
            let l = f64::from(l.element_sum());
            (sum, squares, of_part) = (sum + l, squares + l * l, of_part + l);
        }
        means.push(of_part / f64::from(n / PARTS));
    }
    let count = f64::from(n / PARTS * PARTS);
    let mean = sum / count;
    let spread = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / f64::from(PARTS - 1);
    Found { mean, error: (spread / f64::from(PARTS)).sqrt(), variance: squares / count - mean * mean }
}

fn settings(max_depth: u32, rgb: bool) -> ConnectionSettings {
    ConnectionSettings { seed: 1, max_depth, paths: 1 << 11, rgb }
}

/// Holds the mean of connections against that of paths, within three standard errors of both and a tolerance; returns both.
#[track_caller]
fn hold(name: &str, scene: &Scene, n: [u32; 2], tolerance: f64, max_depth: u32, rgb: bool) -> [Found; 2] {
    let connections = Connections::new(scene, settings(max_depth, rgb), &CAMERA).expect(name);
    let plain = look(scene, None, n[0], 1, max_depth, rgb);
    let joined = look(scene, Some(&connections), n[1], 2, max_depth, rgb);
    let error = plain.error.hypot(joined.error);
    let off = joined.mean - plain.mean;
    println!(
        "{name}: {:.5} ± {:.5} by paths, {:.5} ± {:.5} joined ({:+.2} σ, {:+.2} %), variance {:.4} {:.4}",
        plain.mean,
        plain.error,
        joined.mean,
        joined.error,
        off / error,
        100.0 * off / plain.mean,
        plain.variance,
        joined.variance
    );
    assert!(off.abs() <= 3.0 * error && error <= tolerance * plain.mean, "{name}: {off} {error} {}", plain.mean);
    [plain, joined]
}

#[test]
fn a_lamp_in_a_shade_gives_the_same_light_with_less_noise() {
    let scene = room(diffuse("floor", [0.5, 0.5, 0.5]), Spectrum::Constant(20.0), vec![]);
    for rgb in [true, false] {
        let [plain, joined] = hold("shade", &scene, [200_000, 40_000], 0.02, 12, rgb);
        // 0.12 of it was seen.
        assert!(joined.variance < 0.3 * plain.variance, "{} {}", joined.variance, plain.variance);
    }
}

#[test]
fn glossy_and_specular_surfaces_keep_their_means() {
    let cases = [
        ("rough metal", metal(0.3), vec![]),
        ("narrow metal", metal(0.08), vec![(metal(0.0), ball("mirror", [0.4, -0.6, -0.3], 0.35, 0))]),
        ("plastic", principled("plastic", |p| p.roughness = Scalar::Constant(0.4)), vec![]),
        ("coat", principled("coat", |p| p.clearcoat = Scalar::Constant(1.0)), vec![]),
        ("smooth plastic", principled("polish", |p| p.roughness = Scalar::Constant(0.0)), vec![]),
    ];
    for (name, floor, more) in cases {
        let scene = room(floor, Spectrum::Constant(20.0), more);
        hold(name, &scene, [200_000, 60_000], 0.02, 10, true);
    }
}

#[test]
fn refraction_keeps_its_means() {
    let rough = principled("ground glass", |p| {
        (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.5), Scalar::Constant(1.0), Transmission::Solid);
        p.base_color = Color::rgb(1.0, 1.0, 1.0);
    });
    let paper =
        Material::new("paper", Scattering::DiffuseTransmission(Box::new([Color::rgb(0.4, 0.4, 0.3), Color::rgb(0.4, 0.3, 0.2)])));
    let sheet = || quad("sheet", [-0.9, -0.4, -0.9], [[0.0, 0.3, 1.2], [0.9, 0.0, 0.0]], 0);
    let cases = [
        ("ground glass", vec![(rough, ball("ball", [0.3, -0.5, -0.2], 0.4, 0))]),
        ("clear glass", vec![(Material::glass("glass", 1.5, None), ball("ball", [0.3, -0.5, -0.2], 0.4, 0))]),
        ("paper", vec![(paper, sheet())]),
    ];
    for (name, more) in cases {
        let scene = room(diffuse("floor", [0.5, 0.5, 0.5]), Spectrum::Constant(20.0), more);
        for rgb in [true, false] {
            hold(name, &scene, [200_000, 60_000], 0.02, 12, rgb);
        }
    }
}

#[test]
fn a_box_of_lamps_is_as_bright_as_the_sum_of_its_reflections() {
    // Radiance 1 from all walls, which reflect half: Σ 2⁻ᵏ up to the depth.
    let emission = Some(Emission::one_sided(Spectrum::Constant(1.0)));
    let wall = |name: &str| Material { emission: emission.clone(), ..diffuse(name, [0.5, 0.5, 0.5]) };
    let scene =
        Scene::build(Description { materials: vec![wall("wall"), wall("floor")], objects: walls(), ..Default::default() });
    let scene = scene.unwrap();
    let wavelengths = f64::from(WavelengthSampler::rgb().sample(0.0).weight.element_sum());
    for depth in [0, 1, 2, 3, 6] {
        let connections = Connections::new(&scene, settings(6, true), &CAMERA).unwrap();
        let found = look(&scene, Some(&connections), 16_000, 3, depth, true);
        let unit = look(&scene, None, 160, 3, 0, true).mean;
        let expected = unit * (2.0 - 0.5f64.powi(depth as i32));
        println!("{depth}: {} {expected} ± {} {wavelengths}", found.mean, found.error);
        // Both strategies know the light exactly; what is left is the noise of the weights.
        assert!((found.mean - expected).abs() <= 3.0 * found.error + 1e-4 * expected, "{depth}: {} {expected}", found.mean);
        assert!(found.error < 0.01 * expected);
    }
}

#[test]
fn points_and_spots_keep_their_means() {
    let position = Vec3::new(0.2, 0.5, 0.1);
    let spot = |edge| PunctualKind::Spot { position, direction: Vec3::new(0.6, 0.8, 0.0), cos_inner: 0.9, cos_outer: 0.7, edge };
    for (name, kind) in [("point", PunctualKind::Point { position }), ("spot", spot(SpotEdge::Smooth))] {
        let materials = vec![diffuse("wall", [0.6, 0.5, 0.4]), metal(0.3)];
        let punctual = vec![Punctual::new("lamp", Spectrum::Constant(1.0), kind)];
        let scene = Scene::build(Description { materials, objects: walls(), punctual, ..Default::default() }).unwrap();
        for rgb in [true, false] {
            hold(name, &scene, [200_000, 60_000], 0.02, 8, rgb);
        }
    }
}

/// The box with a hole of 0.4 × 0.3 m in its ceiling or without one, and a light at infinity that comes in there.
fn sunlit(kind: PunctualKind, is_open: bool, more: Vec<(Material, Object)>) -> Scene {
    let mut objects: Vec<Object> = walls().into_iter().filter(|o| o.name != "ceiling").collect();
    let around_hole = [
        ([-1.0, 1.0, -1.0], [[0.8, 0.0, 0.0], [0.0, 0.0, 2.0]]),
        ([0.2, 1.0, -1.0], [[0.8, 0.0, 0.0], [0.0, 0.0, 2.0]]),
        ([-0.2, 1.0, -1.0], [[0.4, 0.0, 0.0], [0.0, 0.0, 0.9]]),
        ([-0.2, 1.0, 0.2], [[0.4, 0.0, 0.0], [0.0, 0.0, 0.8]]),
    ];
    if !is_open {
        objects.extend(around_hole.map(|(corner, edges)| quad("ceiling", corner, edges, 0)));
    }
    let mut materials = vec![diffuse("wall", [0.6, 0.5, 0.4]), diffuse("floor", [0.5, 0.5, 0.5])];
    // The sun lights the outside, too, of which no light comes in but from a plate far off.
    objects.push(quad("plate", [-9.0, 1.5, -9.0], [[0.0, 0.0, 6.0], [6.0, 0.0, 0.0]], 0));
    for (material, mut object) in more {
        object.material = materials.len() as u32;
        materials.push(material);
        objects.push(object);
    }
    let punctual = vec![Punctual::new("sun", Spectrum::Constant(1.0), kind)];
    Scene::build(Description { materials, objects, punctual, ..Default::default() }).unwrap()
}

/// What it lights is a patch of the floor that the view does not see.
#[test]
fn the_sun_through_a_hole_gives_the_same_light_with_less_noise() {
    let direction = Vec3::new(0.35, -1.0, 0.4).normalize();
    let narrow = vec![(metal(0.2), ball("ball", [0.6, -0.7, 0.75], 0.12, 0))];
    let plastic = principled("plastic", |p| p.roughness = Scalar::Constant(0.4));
    let plate = vec![(plastic, quad("tiles", [0.3, -0.99, 0.5], [[0.0, 0.0, 0.45], [0.65, 0.0, 0.0]], 0))];
    let parallel = PunctualKind::Directional { direction };
    let disc = |half_angle| PunctualKind::Disc { direction, half_angle };
    for (name, kind, more) in [
        ("parallel", parallel, vec![]),
        ("sun", disc(0.0047), vec![]),
        // Paths meet it by chance, too.
        ("wide", disc(0.15), vec![]),
        ("rough metal", parallel, narrow),
        ("plastic", disc(0.0047), plate),
    ] {
        let scene = sunlit(kind, false, more);
        for rgb in [true, false] {
            let [plain, joined] = hold(name, &scene, [800_000, 60_000], 0.02, 8, rgb);
            // Between 0.002 and 0.015 of it were seen.
            assert!(joined.variance < 0.05 * plain.variance, "{name}: {} {}", joined.variance, plain.variance);
        }
    }
}

fn pane(name: &str, tint: [f32; 3], y: f32) -> (Material, Object) {
    let glass = principled(name, |p| {
        (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.0), Scalar::Constant(1.0), Transmission::Thin);
        p.base_color = Color::rgb(tint[0], tint[1], tint[2]);
    });
    (glass, quad("pane", [-1.0, y, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 0))
}

/// Light samples and connections find the light about as often here, so that a wrong weight of either shows; chance hits, of which a shiny floor makes the most, weigh
/// little beside them.
#[test]
fn the_sun_in_an_open_box_keeps_its_means() {
    let direction = Vec3::new(0.35, -1.0, 0.4).normalize();
    let disc = PunctualKind::Disc { direction, half_angle: 0.15 };
    let shiny = || (metal(0.15), quad("plate", [-0.9, -0.98, -0.9], [[0.0, 0.0, 1.8], [1.8, 0.0, 0.0]], 0));
    // Coloured glass, two panes.
    let glazed = || vec![pane("green", [0.6, 0.9, 0.7], 1.0), pane("clear", [1.0, 1.0, 1.0], 1.1)];
    for (name, kind, more) in [
        ("parallel", PunctualKind::Directional { direction }, vec![]),
        ("parallel, glazed", PunctualKind::Directional { direction }, glazed()),
        ("disc", disc, vec![]),
        ("disc, shiny floor", disc, vec![shiny()]),
        ("disc, shiny floor, glazed", disc, glazed().into_iter().chain([shiny()]).collect()),
    ] {
        let scene = sunlit(kind, true, more);
        for rgb in [true, false] {
            hold(name, &scene, [400_000, 200_000], 0.006, 8, rgb);
        }
    }
}

#[test]
fn more_panes_and_air_beyond_the_scene_take_no_light_away_twice() {
    let direction = Vec3::new(0.35, -1.0, 0.4).normalize();
    let parallel = PunctualKind::Directional { direction };
    let panes = (0..20).map(|i| pane("clear", [1.0, 1.0, 1.0], 1.0 + 0.01 * i as f32)).collect();
    hold("twenty panes", &sunlit(parallel, true, panes), [400_000, 200_000], 0.01, 40, true);
    // A cloud above everything, through which a quarter of the light comes.
    let mut description = sunlit(parallel, true, vec![]).description().clone();
    let within = Bounds { min: Vec3::new(-500.0, 100.0, -500.0), max: Vec3::new(500.0, 110.0, 500.0) };
    description.air = Some(Air { medium: Medium::fog(30.0, 0.1, 0.0), bounds: Some(within) });
    let scene = Scene::build(description).unwrap();
    // Light samples alone pass it.
    assert!(Connections::new(&scene, settings(8, true), &CAMERA).is_none());
}

#[test]
fn light_paths_of_the_sun_begin_where_the_camera_finds_its_light() {
    let direction = Vec3::new(0.35, -1.0, 0.4).normalize();
    let scene = sunlit(PunctualKind::Directional { direction }, false, vec![]);
    // Without a camera nothing is known of the hole: there is no lamp that light paths begin at.
    assert!(Connections::new(&scene, settings(6, true), &CameraRays::NONE).is_none());
    // A disc of 20° is no sun.
    let wide = sunlit(PunctualKind::Disc { direction, half_angle: 0.35 }, false, vec![]);
    assert!(Connections::new(&wide, settings(6, true), &CAMERA).is_none());
    // Nearly every light path gets in through the hole, 0.12 of 4 m², and leaves vertices.
    let connections = Connections::new(&scene, settings(6, true), &CAMERA).unwrap();
    let paths = 1 << 11;
    let vertices = connections.trial_pool(paths, 0).len();
    assert!(vertices > paths as usize * 3 / 2, "{vertices} of {paths} paths");
}

#[test]
fn what_connections_cannot_pass_keeps_its_means() {
    let pane = principled("pane", |p| {
        (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.0), Scalar::Constant(1.0), Transmission::Thin);
    });
    let syrup = Material::glass("syrup", 1.3, Some(Medium::fog(0.5, 0.5, 0.0)));
    let prism = principled("prism", |p| {
        (p.roughness, p.transmission, p.kind) = (Scalar::Constant(0.3), Scalar::Constant(1.0), Transmission::Solid);
        p.dispersion = Some(Spectrum::Table(diopter_light::spectrum::Table::from_points(&[(380.0, 1.6), (780.0, 1.5)])));
    });
    let two = [diffuse("a", [0.8, 0.2, 0.2]).scattering, metal(0.3).scattering];
    let mixture = Material::new("mixture", Scattering::Mix(Box::new((two, Scalar::Constant(0.5)))));
    let upright = || quad("pane", [-0.9, -0.9, 0.3], [[1.6, 0.0, 0.0], [0.0, 1.7, 0.0]], 0);
    let body = || ball("ball", [0.2, -0.4, -0.3], 0.4, 0);
    for (name, more) in [
        ("pane", vec![(pane, upright())]),
        ("body of a medium", vec![(syrup, body())]),
        ("prism", vec![(prism, body())]),
        ("mixture", vec![(mixture, body())]),
    ] {
        // A large lamp without its shade: what mirrors of it paths meet by chance must not be the noise.
        let mut objects = walls();
        objects.push(quad("lamp", [-0.8, 0.7, -0.8], [[0.0, 0.0, 1.6], [1.6, 0.0, 0.0]], 2));
        let mut materials = vec![diffuse("wall", [0.6, 0.5, 0.4]), diffuse("floor", [0.5, 0.5, 0.5])];
        materials.push(Material::lamp("lamp", Spectrum::Constant(1.0)));
        for (material, mut object) in more {
            object.material = materials.len() as u32;
            materials.push(material);
            objects.push(object);
        }
        let scene = Scene::build(Description { materials, objects, ..Default::default() }).unwrap();
        for rgb in [true, false] {
            hold(name, &scene, [100_000, 60_000], 0.02, 12, rgb);
        }
    }
}

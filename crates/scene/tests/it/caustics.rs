//! Caustics by photons against closed forms, and against the path tracer where that converges, too.

use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::spectrum::Table;
use diopter_light::{Ray, SampledWavelengths, Spectrum};
use diopter_scene::bvh::Bounds;
use diopter_scene::light::{Punctual, PunctualKind};
use diopter_scene::light_paths::{CausticSettings, Caustics, Lamps, LightPaths, PhotonMap};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Material, Principled, Scattering};
use diopter_scene::medium::{Air, Coefficient, Medium};
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::RadianceAndCaustics;
use diopter_scene::shape::{Mesh, Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Affine3A, Vec3};
use std::f32::consts::PI;

const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];

const ONE: Spectrum = Spectrum::Constant(1.0);

fn grey(name: &str) -> Material {
    Material::new(name, Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))
}

fn mirror() -> Material {
    // Reflects everything.
    let (n, k) = (Spectrum::Constant(0.0), Spectrum::Constant(1000.0));
    let bounces = FacetBounces::Lost;
    Material::new(
        "mirror",
        Scattering::Conductor(Conductor { n, k, alpha: Scalar::Constant(0.0), across: None, bounces, tint: None }),
    )
}

fn quad(name: &str, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> Object {
    Object::new(name, Shape::Quad(Quad { corner: corner.into(), edges: edges.map(Vec3::from) }), material)
}

/// The floor y = 0, `half` metres to each side, facing up.
fn floor(half: f32, material: u32) -> Object {
    quad("floor", [-half, 0.0, -half], [[0.0, 0.0, 2.0 * half], [2.0 * half, 0.0, 0.0]], material)
}

fn ball(center: Vec3, radius: f32, material: u32) -> Object {
    Object::new("ball", Shape::Sphere(Sphere { center, radius }), material)
}

fn down() -> PunctualKind {
    PunctualKind::Directional { direction: Vec3::NEG_Y }
}

fn scene(materials: Vec<Material>, objects: Vec<Object>, punctual: Option<PunctualKind>) -> Scene {
    let punctual = punctual.map(|kind| Punctual::new("lamp", ONE, kind)).into_iter().collect();
    Scene::build(Description { materials, objects, punctual, ..Default::default() }).unwrap()
}

fn settings(photons: u32, max_depth: u32) -> CausticSettings {
    CausticSettings { lamps: Lamps::All, photons, max_depth, ..Default::default() }
}

/// Mean and its standard error over `n` rays straight down onto the places `at` of the unit square, of the mean of the four wavelengths.
fn mean(scene: &Scene, maps: &[PhotonMap], at: impl Fn([f32; 2]) -> Vec3, n: u32, max_depth: u32) -> (f64, f64) {
    mean_along(Vec3::NEG_Y, scene, maps, at, n, max_depth)
}

/// The same of rays along a direction from the places.
fn mean_along(
    direction: Vec3,
    scene: &Scene,
    maps: &[PhotonMap],
    at: impl Fn([f32; 2]) -> Vec3,
    n: u32,
    max_depth: u32,
) -> (f64, f64) {
    let wavelengths = SampledWavelengths::fixed(NM);
    let path = PathSettings { max_depth, roulette_depth: max_depth };
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..n {
        let u = [0.754_877_67, 0.569_840_3].map(|step| (0.5 + f64::from(i) * step).fract() as f32);
        let ray = Ray { origin: at(u), direction, time_s: 0.0 };
        let sampler = Sampler::new(SamplerKind::Sobol, 3, (7, 1), i, n);
        let photons = (!maps.is_empty()).then(|| &maps[i as usize % maps.len()]);
        let along = CameraPath { light_paths: LightPaths::of_photons(photons), ..CameraPath::new(ray, wavelengths, sampler) };
        let l = f64::from(scene.radiance_along(&along, &path).element_sum()) / 4.0;
        (sum, squares) = (sum + l, squares + l * l);
    }
    let n = f64::from(n);
    (sum / n, ((squares / n - (sum / n).powi(2)).max(0.0) / n).sqrt())
}

fn maps<'a>(caustics: &'a Caustics, numbers: std::ops::Range<u32>) -> Vec<PhotonMap<'a>> {
    numbers.flat_map(|m| [caustics.map(m, 0), caustics.map(m, 1)]).collect()
}

/// Reflectance of glass of index `n` at a sine of incidence, by Fresnel's equations.
fn fresnel(n: f64, sin: f64) -> f64 {
    let (c, t) = ((1.0 - sin * sin).sqrt(), (1.0 - (sin / n).powi(2)).sqrt());
    let (s, p) = ((c - n * t) / (c + n * t), (n * c - t) / (n * c + t));
    0.5 * (s * s + p * p)
}

#[test]
fn a_beam_through_a_slab_lands_by_fresnel_seen_directly_and_through_it() {
    // The floor ends below the slab: no part of it is lit past the glass.
    let objects = vec![
        floor(0.9, 0),
        quad("top", [-1.0, 1.0, -1.0], [[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]], 1),
        quad("bottom", [-1.0, 0.9, -1.0], [[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 1),
    ];
    let scene = scene(vec![grey("floor"), Material::glass("glass", 1.5, None)], objects, Some(down()));
    let through = (1.0 - fresnel(1.5, 0.0)).powi(2);
    let direct = 0.5 / f64::from(PI) * through;
    let at = |height: f32| move |[x, z]: [f32; 2]| Vec3::new(x - 0.5, height, z - 0.5);
    // Depth counts the two faces and the floor, and the two faces once more from above: longer ways are left out.
    for (height, depth, expected) in [(0.5, 2, 0.0), (0.5, 3, direct), (2.0, 4, 0.0), (2.0, 5, direct * through)] {
        // The maps hold what is within reach of the depth.
        let Some(caustics) = Caustics::new(&scene, settings(1 << 15, depth)) else {
            assert_eq!(expected, 0.0, "no photons at depth {depth}");
            continue;
        };
        let maps = maps(&caustics, 0..6);
        let (found, _) = mean(&scene, &maps, at(height), 8000, depth);
        // 12 maps with some 7000 photons in the square: 0.6 %, and 0.3 % of the choices at the faces seen through.
        assert!((found - expected).abs() <= 0.02 * direct, "{height} {depth}: {found} {expected}");
        // Paths alone never find parallel light through glass.
        assert_eq!(mean(&scene, &[], at(height), 100, depth).0, 0.0);
    }
}

#[test]
fn a_mirror_throws_the_light_of_the_mirrored_lamp() {
    let lamp = Vec3::new(0.0, 1.0, 0.0);
    let objects = vec![floor(3.0, 0), quad("mirror", [1.0, 0.0, -1.0], [[0.0, 0.0, 2.0], [0.0, 2.0, 0.0]], 1)];
    let scene = scene(vec![grey("floor"), mirror()], objects, Some(PunctualKind::Point { position: lamp }));
    let caustics = Caustics::new(&scene, settings(1 << 16, 8)).unwrap();
    let maps = maps(&caustics, 0..6);
    for x in [0.1, 0.5] {
        let at = |[u, v]: [f32; 2]| Vec3::new(x + 0.2 * (u - 0.5), 0.4, 0.2 * (v - 0.5));
        // Of a lamp of 1 W/sr/nm.
        let expected = |lamp: Vec3| {
            let one = |i: usize| {
                let to = lamp - at([i % 20, i / 20].map(|k| (k as f32 + 0.5) / 20.0)) * Vec3::new(1.0, 0.0, 1.0);
                0.5 / f64::from(PI) * f64::from(to.normalize().y / to.length_squared())
            };
            (0..400).map(one).sum::<f64>() / 400.0
        };
        let direct = mean(&scene, &[], at, 4000, 8).0;
        assert!((direct / expected(lamp) - 1.0).abs() < 2e-3, "{x}: {direct}");
        let mirrored = mean(&scene, &maps, at, 4000, 8).0 - direct;
        let truth = expected(Vec3::new(2.0, 1.0, 0.0));
        // Some 2000 photons in all maps together: 2.2 %, and rays that do not lie evenly over them.
        assert!((mirrored / truth - 1.0).abs() < 0.08, "{x}: {mirrored} {truth}");
    }
}

#[test]
fn a_ball_of_glass_passes_on_all_power_by_fresnel() {
    // A point far away in a large dark room: nearly parallel light on the ball.
    let (radius, distance) = (0.5f32, 60.0f32);
    let objects = vec![ball(Vec3::ZERO, 100.0, 0), ball(Vec3::ZERO, radius, 1)];
    let kind = PunctualKind::Point { position: Vec3::Y * distance };
    let scene = scene(vec![grey("room"), Material::glass("glass", 1.5, None)], objects, Some(kind));
    let n = 2000;
    let over_disc = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(((i as f64 + 0.5) / n as f64).sqrt())).sum::<f64>() / n as f64;
    let reflected = over_disc(&|s| fresnel(1.5, s));
    let through = over_disc(&|s| (1.0 - fresnel(1.5, s)).powi(2));
    // The literature has 9.18 % for the mean reflectance of glass of 1.5.
    assert!((reflected - 0.0918).abs() < 2e-4, "{reflected}");
    let sin2 = f64::from(radius / distance).powi(2);
    let incident = 2.0 * std::f64::consts::PI * (1.0 - (1.0 - sin2).sqrt());
    for (depth, expected) in [(2, reflected), (3, reflected + through), (64, 1.0)] {
        let caustics = Caustics::new(&scene, settings(1 << 15, depth)).unwrap();
        let power = caustics.map(0, 0).power(&SampledWavelengths::fixed(NM)).x;
        let found = f64::from(power) / incident;
        // Photons choose between reflection and refraction: 3 σ of 2¹⁵ of them, and the room for rounding around the ball.
        let limit = 3.0 * (reflected * (1.0 - reflected) / f64::from(1 << 15)).sqrt() + 2e-3;
        assert!((found - expected).abs() < limit, "{depth}: {found} {expected}");
    }
}

/// A glass ball over a floor under a lamp that paths find by chance, too.
fn ball_and_lamp(floor_material: Material, disc: bool) -> Scene {
    let lamp = Material::lamp("lamp", ONE);
    let mut objects = vec![floor(4.0, 0), ball(Vec3::new(0.0, 0.6, 0.0), 0.35, 1)];
    let kind = disc.then_some(PunctualKind::Disc { direction: Vec3::new(0.3, -1.0, 0.1).normalize(), half_angle: 0.35 });
    if !disc {
        objects.push(quad("lamp", [-0.8, 2.0, -0.6], [[1.2, 0.0, 0.0], [0.0, 0.0, 1.2]], 2));
    }
    scene(vec![floor_material, Material::glass("glass", 1.5, None), lamp], objects, kind)
}

#[test]
fn paths_and_photons_together_see_what_paths_alone_see() {
    let plastic = |name: &str, roughness: f32| {
        let mut p = Principled::new(Color::rgb(0.5, 0.5, 0.5), 1.5);
        p.roughness = Scalar::Constant(roughness);
        Material::new(name, Scattering::Principled(Box::new(p)))
    };
    // One with a narrow lobe, one whose polish mirrors.
    let cases =
        [(grey("grey"), false), (plastic("glossy", 0.15), false), (plastic("polished", 0.0), false), (grey("grey"), true)];
    for (material, disc) in cases {
        let name = material.name.clone();
        let scene = ball_and_lamp(material, disc);
        let caustics = Caustics::new(&scene, settings(1 << 16, 12)).unwrap();
        let maps = maps(&caustics, 30..33);
        // All of the caustic and its surroundings, so that the blur of photons moves no light in or out.
        let at = |[x, z]: [f32; 2]| Vec3::new(1.6 * (x - 0.5), 0.2, 1.6 * (z - 0.5));
        let (paths, error) = mean(&scene, &[], at, 30_000, 12);
        let (both, other) = mean(&scene, &maps, at, 30_000, 12);
        // About 3 % in all, a quarter of what the caustic brings.
        let limit = 3.0 * (error * error + other * other).sqrt() + 0.01 * paths;
        assert!(limit < 0.05 * paths, "{name} {disc}: {error} {other}");
        assert!((both - paths).abs() < limit, "{name} {disc}: {both} {paths} ± {error}");
    }
}

fn fog(scattering: Coefficient, absorption: Coefficient, asymmetry: f32, bounds: [Vec3; 2]) -> Air {
    let medium = Medium { name: "fog".into(), scattering, absorption, asymmetry, ..Default::default() };
    Air { medium, bounds: Some(Bounds { min: bounds[0], max: bounds[1] }) }
}

#[test]
fn a_mirrored_beam_is_seen_in_fog() {
    // Light straight down onto a mirror of 2 × 2 m, back up through 1 m of fog, across which the camera looks: what one scattering brings.
    let mirror_below = || quad("mirror", [-1.0, 0.0, -1.0], [[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]], 0);
    let corners = [Vec3::new(-2.0, -0.5, -2.0), Vec3::new(2.0, 1.0, 2.0)];
    for (scattering, absorption, asymmetry) in [(0.4, 0.3, 0.0), (0.02, 0.0, 0.0), (1.5, 0.2, 0.5)] {
        let mut scene = scene(vec![mirror()], vec![mirror_below()], Some(down()));
        let [s, a] = [scattering, absorption].map(Coefficient::grey);
        scene.fill_air(Some(fog(s, a, asymmetry, corners)));
        let caustics = Caustics::new(&scene, settings(1 << 18, 2)).unwrap();
        let wavelengths = SampledWavelengths::fixed(NM);
        let path = PathSettings { max_depth: 2, roulette_depth: 2 };
        let (mut sum, mut expected, n) = (0.0, 0.0, 16_384);
        let (scattering, extinction, g) = (f64::from(scattering), f64::from(scattering + absorption), f64::from(asymmetry));
        // 90°.
        let phase = (1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g * g).powf(1.5));
        let way = ((-extinction).exp() - (-3.0 * extinction).exp()) / extinction;
        for map in [caustics.map(20, 0), caustics.map(20, 1)] {
            assert!(map.on_surfaces() == 0 && map.in_media() > 1000);
            for i in 0..n {
                let u = [0.754_877_67, 0.569_840_3].map(|step| (0.5 + f64::from(i) * step).fract() as f32);
                // Along x, within the beam and away from its sides.
                let origin = Vec3::new(-3.0, 0.1 + 0.8 * u[1], 1.6 * (u[0] - 0.5));
                expected += scattering * phase * (-extinction * f64::from(1.0 + origin.y)).exp() * way;
                let ray = Ray { origin, direction: Vec3::X, time_s: 0.0 };
                let sampler = Sampler::new(SamplerKind::Sobol, 3, (7, 1), i, n);
                let light_paths = LightPaths::of_photons(Some(&map));
                let along = CameraPath { light_paths, ..CameraPath::new(ray, wavelengths, sampler) };
                let [_, gathered] = scene.trace(&[along], RadianceAndCaustics, &path)[0];
                sum += f64::from(gathered.element_sum()) / 4.0;
            }
        }
        // Rays see some 150 000 photons, with weights that differ: 0.5 %.
        assert!((sum / expected - 1.0).abs() < 0.015, "{scattering} {absorption} {asymmetry}: {sum} {expected}");
    }
}

#[test]
fn photons_in_media_and_paths_together_see_what_paths_alone_see() {
    let corners = [Vec3::new(-2.0, -0.5, -2.0), Vec3::new(2.0, 2.5, 2.0)];
    let blue = || Coefficient::Scaled(1.0, Spectrum::Table(Table::from_points(&[(400.0, 0.9), (700.0, 0.3)])));
    let cases = [
        ("fog", Coefficient::grey(0.5), Coefficient::NONE, 0.0, false),
        ("haze", Coefficient::grey(0.5), Coefficient::grey(0.2), 0.6, false),
        ("blue", blue(), Coefficient::grey(0.1), 0.0, true),
    ];
    for (name, scattering, absorption, asymmetry, disc) in cases {
        let mut scene = ball_and_lamp(grey("grey"), disc);
        scene.fill_air(Some(fog(scattering, absorption, asymmetry, corners)));
        let caustics = Caustics::new(&scene, settings(1 << 16, 12)).unwrap();
        let maps = maps(&caustics, 30..33);
        assert!(maps[0].in_media() > 1000 && maps[0].on_surfaces() > 1000);
        // Across the cone of light below the ball, and a floor far away behind it.
        let at = |[y, z]: [f32; 2]| Vec3::new(-2.5, 0.02 + 0.5 * y, 0.8 * (z - 0.5));
        let n = 60_000;
        let (paths, error) = mean_along(Vec3::X, &scene, &[], at, n, 12);
        let (both, other) = mean_along(Vec3::X, &scene, &maps, at, n, 12);
        let limit = 3.0 * (error * error + other * other).sqrt() + 0.01 * paths;
        assert!(limit < 0.06 * paths, "{name}: {error} {other} of {paths}");
        assert!((both - paths).abs() < limit, "{name}: {both} {paths} ± {error}");
        // Chance hits of the lamp through the ball made half of the variance.
        assert!(other < 0.85 * error, "{name}: {error} {other}");
    }
}

/// A body with eight corners, those of the box (−x−y−z, +x−y−z, −x+y−z ...).
fn body(corners: [Vec3; 8]) -> Mesh {
    let middle = corners.iter().sum::<Vec3>() / 8.0;
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let mut triangles = Vec::new();
    for [a, b, c, d] in faces {
        let at = |i: usize| corners[i];
        let outward = (at(b) - at(a)).cross(at(c) - at(a)).dot(at(a) - middle) > 0.0;
        let [b, d] = if outward { [b, d] } else { [d, b] };
        triangles.extend([[a, b, c], [a, c, d]].map(|t| t.map(|i| i as u32)));
    }
    Mesh { positions: corners.to_vec(), triangles, ..Default::default() }
}

#[test]
fn a_prism_bends_blue_farther_than_red() {
    // A wedge of 20° that light enters straight from above; it leaves towards the thick side, +x.
    let wedge = 20f32.to_radians();
    let corner = |i: usize| {
        let [x, top, z] = [i & 1, i & 2, i & 4].map(|bit| bit != 0);
        let x = if x { 0.1 } else { -0.1 };
        let y = if top { 2.1 } else { 2.08 - (x + 0.1) * wedge.tan() };
        Vec3::new(x, y, if z { 0.1 } else { -0.1 })
    };
    let index = |nm: f32| 1.6 - 0.1 * (nm - 400.0) / 300.0;
    let table = Table::new(380.0, 10.0, (0..=40).map(|i| index(380.0 + 10.0 * i as f32)).collect());
    let mut glass = Principled::glass(1.55);
    glass.dispersion = Some(Spectrum::Table(table));
    let plain = Material::glass("glass", 1.55, None);
    let glass = Material { scattering: Scattering::Principled(Box::new(glass)), ..plain };
    let description = Description {
        meshes: vec![body(std::array::from_fn(corner)).into()],
        materials: vec![grey("floor"), glass],
        objects: vec![floor(4.0, 0), Object::new("prism", Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 1)],
        punctual: vec![Punctual::new("sun", ONE, down())],
        ..Default::default()
    };
    let scene = Scene::build(description).unwrap();
    let caustics = Caustics::new(&scene, settings(1 << 17, 4)).unwrap();
    let map = caustics.map(50, 0);
    let (wavelengths, path) = (SampledWavelengths::fixed(NM), PathSettings { max_depth: 4, roulette_depth: 9 });
    // The middle of each wavelength's light along x; what does not come through the prism is taken off.
    let (mut sum, mut moment) = ([0.0f64; 4], [0.0f64; 4]);
    let n = 300;
    for i in 0..n {
        for j in 0..8 {
            let (x, z) = (0.15 + 0.6 * (i as f32 + 0.5) / n as f32, 0.1 * (j as f32 - 3.5) / 8.0);
            let ray = Ray { origin: Vec3::new(x, 0.5, z), direction: Vec3::NEG_Y, time_s: 0.0 };
            let sampler = Sampler::new(SamplerKind::Sobol, 1, (0, 0), 0, 1);
            let along = CameraPath::new(ray, wavelengths, sampler);
            let at = |photons| scene.radiance_along(&CameraPath { light_paths: LightPaths::of_photons(photons), ..along }, &path);
            let light = (at(Some(&map)) - at(None)).to_array();
            for k in 0..4 {
                sum[k] += f64::from(light[k]);
                moment[k] += f64::from(light[k] * x);
            }
        }
    }
    for k in 0..4 {
        // Snell's law at the lower face, in the middle of the wedge; the floor is 2.0436 m below it.
        let inside = f64::from(index(NM[k])) * f64::from(wedge).sin();
        let expected = (2.08 - 0.1 * f64::from(wedge).tan()) * (inside.asin() - f64::from(wedge)).tan();
        let found = moment[k] / sum[k];
        // 2 cm lie between neighbours; some hundred photons of each wavelength over 20 cm are good to 0.3 cm.
        assert!((found - expected).abs() < 0.01, "{} nm: {found} {expected}", NM[k]);
    }
}

#[test]
fn photons_are_the_same_for_any_number_of_threads() {
    let scene = ball_and_lamp(grey("floor"), false);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let caustics = Caustics::new(&scene, settings(20_000, 12)).unwrap();
            let maps = [caustics.map(2, 0), caustics.map(2, 1)];
            let counts = [maps[0].on_surfaces(), maps[1].on_surfaces()];
            let light = maps.each_ref().map(|m| {
                let at = |[x, z]: [f32; 2]| Vec3::new(x - 0.5, 0.2, z - 0.5);
                mean(&scene, std::slice::from_ref(m), at, 500, 12).0.to_bits()
            });
            (counts, light)
        })
    };
    let one = with(1);
    assert_eq!(one, with(4));
    assert!(one.0[0] > 1000 && one.1[0] != one.1[1], "{one:?}");
}

#[test]
fn the_two_replicates_of_a_map_know_nothing_of_each_other() {
    // Half differences then claim the variance that the mean of both has over many maps.
    let scene = ball_and_lamp(grey("floor"), false);
    let caustics = Caustics::new(&scene, settings(2048, 12)).unwrap();
    let wavelengths = SampledWavelengths::fixed(NM);
    let path = PathSettings { max_depth: 3, roulette_depth: 9 };
    let sampler = Sampler::new(SamplerKind::Sobol, 1, (0, 0), 0, 1);
    const MAPS: usize = 200;
    let points: Vec<Ray> = (0..64)
        .map(|i| {
            let origin = Vec3::new(0.6 * ((i % 8) as f32 / 7.0 - 0.5), 0.2, 0.6 * ((i / 8) as f32 / 7.0 - 0.5));
            Ray { origin, direction: Vec3::NEG_Y, time_s: 0.0 }
        })
        .collect();
    let (mut sums, mut squares, mut claimed) = (vec![0.0; 64], vec![0.0; 64], vec![0.0; 64]);
    // So late that the radius hardly changes.
    for m in 1000..1000 + MAPS as u32 {
        let pair = [caustics.map(m, 0), caustics.map(m, 1)];
        for (i, ray) in points.iter().enumerate() {
            let light = |map| {
                let light_paths = LightPaths::of_photons(Some(map));
                let along = CameraPath { light_paths, ..CameraPath::new(*ray, wavelengths, sampler) };
                f64::from(scene.radiance_along(&along, &path).x)
            };
            let [a, b] = pair.each_ref().map(light);
            sums[i] += 0.5 * (a + b);
            squares[i] += (0.5 * (a + b)).powi(2);
            claimed[i] += (0.5 * (a - b)).powi(2);
        }
    }
    let n = MAPS as f64;
    let seen: f64 = (0..64).map(|i| (squares[i] - sums[i] * sums[i] / n) / (n - 1.0)).sum();
    let claimed = claimed.iter().sum::<f64>() / n;
    // Each point's ratio scatters by 2/√200 = 14 %; neighbours share photons: by some 4 % together.
    assert!(seen > 0.0 && (claimed / seen - 1.0).abs() < 0.15, "{claimed} {seen}");
}

#[test]
fn lamps_are_left_to_photons_where_that_helps() {
    let small = |side: f32| {
        let lamp = quad("lamp", [0.0, 2.0, 0.0], [[side, 0.0, 0.0], [0.0, 0.0, side]], 2);
        vec![floor(1.0, 0), ball(Vec3::new(0.0, 0.6, 0.0), 0.3, 1), lamp]
    };
    let glass = || Material::glass("glass", 1.5, None);
    let lamp = || Material::lamp("lamp", ONE);
    let has = |materials: Vec<Material>, objects: Vec<Object>, lamps: Lamps| {
        Caustics::new(&scene(materials, objects, None), CausticSettings { lamps, ..settings(1 << 12, 8) }).is_some()
    };
    assert!(has(vec![grey("floor"), glass(), lamp()], small(0.05), Lamps::Small));
    assert!(!has(vec![grey("floor"), glass(), lamp()], small(2.0), Lamps::Small));
    assert!(has(vec![grey("floor"), glass(), lamp()], small(2.0), Lamps::All));
    assert!(!has(vec![grey("floor"), grey("no glass"), lamp()], small(0.05), Lamps::All));
    // Nothing for the light to land on.
    assert!(!has(vec![mirror(), glass(), lamp()], small(0.05), Lamps::All));
}

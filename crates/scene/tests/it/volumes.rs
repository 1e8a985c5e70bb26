//! Light in media that differ from place to place, against media that are the same everywhere and closed forms.

use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::spectrum::Table;
use diopter_light::{Ray, SampledWavelengths, Spectrum};
use diopter_scene::bvh::Bounds;
use diopter_scene::light::{Environment, Punctual, PunctualKind};
use diopter_scene::load;
use diopter_scene::material::{Interior, Material, Scattering};
use diopter_scene::medium::{Cloud, Coefficient, Field, Glow, Grid, Medium, Scalars, Volume, VolumePlace};
use diopter_scene::motion::Parts;
use diopter_scene::shape::{Quad, Sphere};
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::{Affine3A, Quat, Vec3};
use std::sync::Arc;

use crate::common::{DEEP, NM, assert_within, mean, mean_at};

fn assert_near(found: ([f64; 4], [f64; 4]), expected: [f64; 4], what: &str) {
    assert_within(found, expected, 1e-3, what);
}

fn colored() -> Spectrum {
    Spectrum::Table(Table::from_points(&[(400.0, 1.5), (700.0, 0.4)]))
}

/// Numbers over a box of 4 m about the middle.
fn numbers(n: usize, value: impl Fn(Vec3) -> f32) -> (Bounds, Grid<f32>) {
    let bounds = Bounds { min: Vec3::splat(-2.0), max: Vec3::splat(2.0) };
    let at = |i: usize| -2.0 + 4.0 * (i as f32 + 0.5) / n as f32;
    let values = (0..n * n * n).map(|i| value(Vec3::new(at(i % n), at(i / n % n), at(i / n / n)))).collect();
    (bounds, Grid::new([n; 3], values, &bounds).unwrap())
}

fn volume(n: usize, density: impl Fn(Vec3) -> f32, glow: Option<Glow>) -> Volume {
    let (bounds, grid) = numbers(n, density);
    Volume::new(VolumePlace::still(Affine3A::IDENTITY).unwrap(), bounds, Field::Density(Scalars::Grid(grid)), glow)
}

/// A ball of a medium, radius 1, without a surface.
fn ball(medium: Medium) -> Description {
    let interior = Interior::Body { medium: Some(Arc::new(medium)), priority: None };
    Description {
        materials: vec![Material { interior, ..Material::new("face", Scattering::Interface) }],
        objects: vec![Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), 0)],
        ..Default::default()
    }
}

fn smoke() -> Medium {
    Medium {
        absorption: Coefficient::grey(0.3),
        scattering: Coefficient::Scaled(1.0, colored()),
        asymmetry: 0.4,
        ..Medium::default()
    }
}

fn with(medium: Medium, volume: Volume) -> Medium {
    Medium { volume: Some(Box::new(volume)), ..medium }
}

#[test]
fn a_grid_of_ones_is_the_medium_itself() {
    // Bright sky and a lamp beside: all orders of scattering, by both ways of finding lights.
    let lit = |medium: Medium| {
        let lamp = PunctualKind::Point { position: Vec3::new(1.5, 1.0, 0.5) };
        let d = Description {
            punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::splat(6.0)), lamp)],
            environment: Some(Environment::uniform(Vec3::ONE)),
            ..ball(medium)
        };
        Scene::build(d).unwrap()
    };
    let (from, towards) = (Vec3::new(0.3, 0.2, 3.0), Vec3::new(-0.05, 0.0, -1.0));
    let even = mean(&lit(smoke()), from, towards, 60_000, &DEEP);
    let grid = mean(&lit(with(smoke(), volume(16, |_| 1.0, None))), from, towards, 60_000, &DEEP);
    for k in 0..4 {
        let (off, noise) = ((even.0[k] - grid.0[k]).abs(), even.1[k].hypot(grid.1[k]));
        assert!(off < 3.0 * noise && noise < 0.01 * even.0[k], "{} nm: {} {} ± {noise}", NM[k], even.0[k], grid.0[k]);
    }
    // The same with majorants that are far above what is there: half of the box is dense, the ball lies in the other.
    let step = volume(16, |p| if p.x.abs().max(p.y.abs()).max(p.z.abs()) > 1.4 { 6.0 } else { 1.0 }, None);
    let loose = mean(&lit(with(smoke(), step)), from, towards, 60_000, &DEEP);
    for k in 0..4 {
        let (off, noise) = ((even.0[k] - loose.0[k]).abs(), even.1[k].hypot(loose.1[k]));
        assert!(off < 3.0 * noise, "{} nm: {} {} ± {noise}", NM[k], even.0[k], loose.0[k]);
    }
}

#[test]
fn a_lamp_in_fog_over_a_ground_shines_as_in_a_grid_of_ones() {
    // A small lamp within the ball, with and without extent, and a ground that it and the fog light: where directions are drawn about the lamp, and in the grid not.
    let fog = || Medium { scattering: Coefficient::Scaled(1.2, colored()), asymmetry: 0.3, ..smoke() };
    let place = Vec3::new(0.3, 0.1, 0.0);
    for with_extent in [true, false] {
        let lit = |medium: Medium| {
            let mut d = ball(medium);
            let ground = Quad { corner: Vec3::new(-0.5, -0.4, -0.5), edges: [Vec3::Z, Vec3::X] };
            d.materials.push(Material::new("ground", Scattering::Diffuse(Color::rgb(0.7, 0.5, 0.3))));
            d.objects.push(Object::new("ground", Shape::Quad(ground), 1));
            if with_extent {
                d.materials.push(Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::splat(100.0))));
                d.objects.push(Object::new("lamp", Shape::Sphere(Sphere { center: place, radius: 0.08 }), 2));
            } else {
                let lamp = PunctualKind::Point { position: place };
                d.punctual = vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::ONE), lamp)];
            }
            Scene::build(d).unwrap()
        };
        // Twice scattered light at least: what is scattered once is in both, by strategies tested elsewhere.
        let settings = PathSettings { max_depth: 6, roulette_depth: 6 };
        for towards in [Vec3::new(-0.12, -0.1, -1.0), Vec3::new(0.02, -0.19, -1.0)] {
            let from = Vec3::new(0.0, 0.2, 3.0);
            let homogeneous = mean(&lit(fog()), from, towards, 60_000, &settings);
            let grid = mean(&lit(with(fog(), volume(4, |_| 1.0, None))), from, towards, 600_000, &settings);
            for k in 0..4 {
                let (off, noise) = ((homogeneous.0[k] - grid.0[k]).abs(), homogeneous.1[k].hypot(grid.1[k]));
                let what = format!("extent {with_extent} {towards} {} nm: {} {} ± {noise}", NM[k], homogeneous.0[k], grid.0[k]);
                assert!(off < 3.5 * noise && noise < 0.04 * grid.0[k], "{what}");
            }
        }
    }
}

#[test]
fn what_only_scatters_is_invisible_in_even_light_whatever_its_density() {
    let lumps = |p: Vec3| 3.0 * (3.0 * p.x).sin().abs() * (2.0 * p.y + p.z).cos().powi(2);
    let white = |volume| Medium { absorption: Coefficient::NONE, ..with(smoke(), volume) };
    let place = VolumePlace::still(Affine3A::from_translation(Vec3::splat(-1.0)) * Affine3A::from_scale(Vec3::splat(2.0)));
    let unit = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    let cloud = Cloud { density: 1.0, wispiness: 1.0, frequency: 5.0 };
    let cloud = Volume::new(place.unwrap(), unit, Field::Cloud(cloud), None);
    for (what, medium) in [("lumps", white(volume(20, lumps, None))), ("cloud", white(cloud))] {
        let d = Description { environment: Some(Environment::uniform(Vec3::ONE)), ..ball(medium) };
        let found = mean(&Scene::build(d).unwrap(), Vec3::new(0.2, 0.1, 3.0), Vec3::NEG_Z, 20_000, &DEEP);
        assert!(found.1[0] > 1e-4, "{what} scatters nothing: {found:?}");
        assert_near(found, [1.0; 4], what);
    }
}

#[test]
fn light_of_a_lamp_comes_through_what_its_density_leaves() {
    // A white floor far below a lamp, smoke whose density rises linearly with height between them.
    let density = |p: Vec3| 0.2 + 0.3 * (p.y + 2.0);
    let smoke = Medium { scattering: Coefficient::NONE, absorption: Coefficient::Scaled(1.0, colored()), ..smoke() };
    let floor = Quad { corner: Vec3::new(-9.0, -3.0, 9.0), edges: [Vec3::X * 18.0, Vec3::NEG_Z * 18.0] };
    let lamp = PunctualKind::Point { position: Vec3::new(0.0, 3.0, 0.0) };
    let scene = |medium: Option<Medium>| {
        let mut d = ball(medium.unwrap_or_default());
        let white = Scattering::Diffuse(diopter_scene::texture::Color::rgb(0.8, 0.8, 0.8));
        d.materials.push(Material::new("floor", white));
        d.objects.push(Object::new("floor", Shape::Quad(floor), 1));
        d.punctual = vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::splat(9.0)), lamp)];
        Scene::build(d).unwrap()
    };
    // Straight down from the lamp, seen from the side.
    let look = |s: &Scene| mean(s, Vec3::new(4.0, -2.0, 0.0), Vec3::new(-4.0, -1.0, 0.0), 40_000, &DEEP);
    let clear = look(&scene(None)).0;
    let dimmed = look(&scene(Some(with(smoke, volume(16, density, None)))));
    // ∫ density over the 2 m within the ball is 0.2 · 2 + 0.3 · 4 = 1.6.
    assert_near(dimmed, [0, 1, 2, 3].map(|k| clear[k] * (-1.6 * colored().at(NM[k]) as f64).exp()), "linear density");
}

#[test]
fn fire_shines_as_deep_and_as_hot_as_it_is() {
    // Of one temperature: B (1 − e^(−σa ∫ρ)) whatever the density.
    let (bounds, heat) = numbers(8, |_| 15.0);
    let kelvin = (15.0 - 5.0) * 170.0;
    let glow = Glow::BlackBody { temperature: Scalars::Grid(heat), offset: 5.0, factor: 170.0, peak_radiance: 2.0 };
    let (_, density) = numbers(16, |p| 0.4 + 0.3 * p.z);
    let place = VolumePlace::still(Affine3A::IDENTITY).unwrap();
    let fire = Volume::new(place, bounds, Field::Density(Scalars::Grid(density)), Some(glow));
    let medium = Medium { absorption: Coefficient::Scaled(1.0, colored()), ..with(Medium::default(), fire) };
    let found = mean(&Scene::build(ball(medium)).unwrap(), Vec3::Z * 3.0, Vec3::NEG_Z, 40_000, &DEEP);
    let white = SampledWavelengths::fixed(NM).d65_one_nit();
    let peak = diopter_light::spectrum::blackbody(2.897_771_9e6 / kelvin, kelvin);
    let expected = [0, 1, 2, 3].map(|k: usize| {
        let body = 2.0 * diopter_light::spectrum::blackbody(NM[k], kelvin) / peak / white[k];
        body as f64 * (1.0 - (-0.8 * colored().at(NM[k]) as f64).exp())
    });
    assert_near(found, expected, "fire");
}

#[test]
fn volumes_stand_where_their_transform_puts_them_and_move_with_it() {
    // A thin slab of smoke in a wide clear box: seen where it is. The face around it is large and still.
    let slab = |p: Vec3| if p.x.abs() < 0.5 { 1.0 } else { 0.0 };
    let (bounds, _) = numbers(32, slab);
    let key = |x: f32| Parts { translation: Vec3::X * x, rotation: Quat::IDENTITY, scale: Vec3::new(1.0, 2.0, 1.0) };
    let place = VolumePlace::moving([1.0, 2.0], [key(-3.0), key(3.0)]).unwrap();
    let (_, grid) = numbers(32, slab);
    let moving = Volume::new(place, bounds, Field::Density(Scalars::Grid(grid)), None);
    let medium = Medium { absorption: Coefficient::grey(0.5), ..with(Medium::default(), moving) };
    let mut d = Description { environment: Some(Environment::uniform(Vec3::ONE)), ..ball(medium) };
    d.objects[0].shape = Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 20.0 });
    let mut scene = Scene::build(d).unwrap();
    scene.pose(1.0, 1.0);
    // Through the middle of the slab, 3.5 m of full density and two slopes of half a cell: 4 m less 2 · 0.0625 · … along z.
    let seen = |x: f32, time_s: f32| mean_at(&scene, Vec3::new(x, 3.0, 30.0), Vec3::NEG_Z, time_s, 20_000, &DEEP).0[0];
    // ∫ over z: values of 1 in cells of 1/8 m; the outermost half cells fall to one half.
    let depth = 4.0 - 2.0 * 0.0625 * 0.25;
    let dim = (-0.5f64 * depth).exp();
    for (x, time_s, expected) in
        [(-3.0, 0.0, dim), (0.0, 0.5, dim), (3.0, 1.0, dim), (3.0, 0.0, 1.0), (-3.0, 0.5, 1.0), (-1.4, 0.25, dim)]
    {
        let found = seen(x, time_s);
        // Four standard deviations of what gets through or not.
        assert!((found - expected).abs() < 0.01, "{x} at {time_s} s: {found}, expected {expected}");
    }
}

#[test]
fn scenes_in_another_unit_have_volumes_of_the_same_depth() {
    let density = |p: Vec3| 0.5 + 0.2 * p.x;
    let medium = || Medium { absorption: Coefficient::grey(0.6), ..with(Medium::default(), volume(16, density, None)) };
    let d = || Description { environment: Some(Environment::uniform(Vec3::ONE)), ..ball(medium()) };
    let mut small = d();
    small.scale(0.01).unwrap();
    let (from, towards) = (Vec3::new(0.1, 0.2, 3.0), Vec3::new(0.1, 0.0, -1.0));
    let whole = mean(&Scene::build(d()).unwrap(), from, towards, 20_000, &DEEP);
    let found = mean(&Scene::build(small).unwrap(), from * 0.01, towards, 20_000, &DEEP);
    assert!(
        whole.0[0] < 0.9 && (whole.0[0] - found.0[0]).abs() < 4.0 * whole.1[0].hypot(found.1[0]) + 1e-4,
        "{whole:?} {found:?}"
    );
}

#[test]
fn media_of_pbrt_differ_from_place_to_place() {
    let head = "LookAt 0 0 -5  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 40\n";
    let wall = "AttributeBegin AreaLightSource \"diffuse\" \"bool twosided\" true Shape \"bilinearmesh\" \"point3 P\" [-99 -99 10 99 -99 10 -99 99 10 99 99 10] AttributeEnd";
    let around = "MediumInterface \"m\" \"\" Material \"interface\" Shape \"sphere\" \"float radius\" 4";
    let none = |_: &str| Err::<Vec<u8>, String>("no files".into());
    let seen = |before: &str, medium: &str, x: f32| {
        let text = format!("{head}WorldBegin {wall} {before} MakeNamedMedium \"m\" {medium}\n{around}");
        let d = load::pbrt::load(text.as_bytes(), "test.pbrt", &none).unwrap();
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
        let view = d.cameras[0].world_from_camera;
        let scene = Scene::build(d).unwrap();
        let wavelengths = SampledWavelengths::rgb();
        // To the right in the picture.
        let ray = Ray {
            origin: view.transform_point3(Vec3::X * x),
            direction: view.transform_vector3(Vec3::NEG_Z).normalize(),
            time_s: 0.0,
        };
        let n = 4000;
        let mut sum = Vec3::ZERO;
        for i in 0..n {
            let sampler = Sampler::new(SamplerKind::Independent, 5, (3, 4), i, n);
            sum += scene.radiance(ray, &wavelengths, &sampler, &DEEP).truncate();
        }
        sum / n as f32
    };
    // Two halves, of density 0 and 2: right and left of the middle. 8 values along z, so that the box is deep.
    let values: Vec<&str> = (0..8 * 8).flat_map(|_| ["0", "0", "2", "2"]).collect();
    let grid = format!(
        "\"string type\" \"uniformgrid\" \"integer nx\" 4 \"integer ny\" 8 \"integer nz\" 8 \"float density\" [{}] \"point3 p0\" [-2 -2 -2] \"point3 p1\" [2 2 2] \"rgb sigma_s\" [0 0 0] \"float scale\" 0.25",
        values.join(" ")
    );
    // σa 1 · 0.25 · 2 over 4 m, of which the ends hold 2 · 0.25 · 0.25 less: 3.875.
    let (left, right) = (seen("", &grid, 1.25), seen("", &grid, -1.25));
    let (dim, clear) = (left.min(right), left.max(right));
    assert!((clear.y - 1.0).abs() < 0.01 && (dim.y - (-0.5f32 * 3.875).exp()).abs() < 0.01, "{left} {right}");
    // The camera's right is +x in pbrt's left-handed world.
    assert!(left.y < right.y, "{left} {right}");
    // Placed elsewhere by the transform that holds.
    let shifted = seen("Translate 2.5 0 0", &grid, -0.0);
    assert!((shifted.y - 1.0).abs() < 0.01, "{shifted}");
    let colors = "\"string type\" \"rgbgrid\" \"rgb sigma_a\" [0.1 0.2 0.4 0.1 0.2 0.4] \"rgb sigma_s\" [0 0 0 0 0 0] \"integer ny\" 2 \"point3 p0\" [-2 -2 -50] \"point3 p1\" [2 2 50]";
    // The one value along z falls with the distance from the middle: over the ball's 8 m on average 1 − 2/100 of it.
    let found = seen("", colors, 0.0);
    let expected = Vec3::new(0.1, 0.2, 0.4).map(|s| (-s * 8.0 * (1.0 - 0.02)).exp());
    assert!((found - expected).abs().max_element() < 0.02, "{found} {expected}");
    // Everywhere cloud below 0: as a homogeneous one.
    let cloud = "\"string type\" \"cloud\" \"point3 p0\" [-3 -3 -1] \"point3 p1\" [3 0 1] \"rgb sigma_a\" [0.3 0.3 0.3] \"rgb sigma_s\" [0 0 0]";
    let found = seen("Translate 0 1.5 0", cloud, 0.0);
    assert!((found.y - (-0.6f32).exp()).abs() < 0.01, "{found}");
    // Shining: 1 cd/m² of an endless depth, as pbrt's white. Light of the wall comes through the rest.
    let glow = format!("{grid} \"rgb Le\" [3 3 3]");
    let found = seen("", &glow, 1.25);
    let left = (-0.5f32 * 3.875).exp();
    assert!((found.y - (left + 3.0 * (1.0 - left))).abs() < 0.03, "{found}");
}

/// `packed/blosc.nvdb` and `packed/zip.nvdb` were written by OpenVDB's `nanovdb_convert` 32.4.2 (-b, -z) from a grid of 9 × 2 × 3 places of half a metre
/// from (−0.5, 2, 3) on, with ¼ (x + 4) + 2 y + ⅛ z at index (x, y, z), and one of temperatures.
#[test]
fn files_of_nanovdb_convert_are_read() {
    for bytes in [&include_bytes!("../packed/blosc.nvdb")[..], include_bytes!("../packed/zip.nvdb")] {
        let file = load::nanovdb::File::open(bytes).unwrap();
        assert_eq!(file.names().collect::<Vec<_>>(), ["density", "temperature"]);
        let density = file.read("density").unwrap().unwrap();
        assert_eq!(density.negative, 0);
        for (x, y, z) in (-4..7).flat_map(|x| (-1..3).flat_map(move |y| (-1..4).map(move |z| (x, y, z)))) {
            let inside = (-3..6).contains(&x) && (0..2).contains(&y) && (0..3).contains(&z);
            let expected = if inside { 0.25 * (x + 4) as f32 + 2.0 * y as f32 + 0.125 * z as f32 } else { 0.0 };
            let place = Vec3::new(1.0, 2.0, 3.0) + 0.5 * Vec3::new(x as f32, y as f32, z as f32);
            assert_eq!(density.values.at(place), expected, "{x} {y} {z}");
        }
        let hot = file.read("temperature").unwrap().unwrap();
        assert_eq!([hot.values.at(Vec3::ZERO), hot.values.at(Vec3::ONE), hot.values.at(Vec3::splat(2.0))], [1500.0, 1500.0, 0.0]);
    }
}

//! Light that walks below a surface, against closed forms and the same medium taken as any other.

use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
use diopter_light::{Ray, SampledWavelengths, Spectrum, sampling};
use diopter_scene::light::{Environment, Punctual, PunctualKind};
use diopter_scene::load;
use diopter_scene::material::{Interior, Material, Principled, Scattering};
use diopter_scene::medium::{Coefficient, Medium};
use diopter_scene::shape::Sphere;
use diopter_scene::texture::Scalar;
use diopter_scene::{Description, Object, PathSettings, Scene, Shape};
use glam::Vec3;
use std::sync::Arc;

/// Mean of the first wavelength's light along rays, relative to RGB light of 1, and its standard error.
fn mean(scene: &Scene, n: u32, settings: &PathSettings, ray: impl Fn(u32) -> (Vec3, Vec3)) -> [f64; 2] {
    let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
    let white = wavelengths.d65_one_nit();
    let (mut sum, mut squares) = (0.0f64, 0.0f64);
    for i in 0..n {
        let (origin, direction) = ray(i);
        let sampler = Sampler::new(SamplerKind::Independent, 5, (3, 4), i, n);
        let l = scene.radiance(Ray { origin, direction, time_s: 0.0 }, &wavelengths, &sampler, settings);
        let l = f64::from(l.x / white.x);
        (sum, squares) = (sum + l, squares + l * l);
    }
    let n = f64::from(n);
    [sum / n, ((squares / n - (sum / n).powi(2)).max(0.0) / n).sqrt()]
}

/// A ball of radius 1 of an index of refraction and roughness, filled with a medium.
fn ball(medium: Medium, roughness: f32) -> Description {
    let mut glass = Principled::glass(1.4);
    glass.roughness = Scalar::Constant(roughness);
    let interior = Interior::Body { medium: Some(Arc::new(medium)), priority: None };
    Description {
        materials: vec![Material { interior, ..Material::new("body", Scattering::Principled(Box::new(glass))) }],
        objects: vec![Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), 0)],
        ..Default::default()
    }
}

fn milk(scattering: f32, absorption: f32) -> Medium {
    Medium {
        scattering: Coefficient::grey(scattering),
        absorption: Coefficient::grey(absorption),
        is_subsurface: true,
        ..Medium::default()
    }
}

#[test]
fn white_bodies_give_back_all_light_however_few_events_paths_may_have() {
    // 30 mean free paths across: on average 80 scattering events, often thousands.
    let sky = Some(Environment::uniform(Vec3::ONE));
    let scene = Scene::build(Description { environment: sky, ..ball(milk(30.0, 0.0), 0.0) }).unwrap();
    let look = |_| (Vec3::new(0.5, 0.1, 3.0), Vec3::NEG_Z);
    // Events at the surface count, and total reflection from within needs some.
    let [found, error] = mean(&scene, 6000, &PathSettings { max_depth: 40, roulette_depth: 5 }, look);
    assert!(error < 0.02 && (found - 1.0).abs() < 4.0 * error + 2e-3, "{found} ± {error}");
}

#[test]
fn no_light_is_lost_by_not_aiming_from_within() {
    // A rough surface, through which aims at a lamp without extent do go, and a sky.
    let lit = |medium: Medium| {
        let kind = PunctualKind::Point { position: Vec3::new(2.0, 2.0, 2.0) };
        let d = Description {
            punctual: vec![Punctual::new("lamp", Spectrum::light_from_rgb(Vec3::splat(20.0)), kind)],
            environment: Some(Environment::uniform(Vec3::splat(0.3))),
            ..ball(medium, 0.6)
        };
        Scene::build(d).unwrap()
    };
    let deep = PathSettings { max_depth: 4000, roulette_depth: 50 };
    let look = |_| (Vec3::new(0.3, 0.4, 3.0), Vec3::NEG_Z);
    let [walked, a] = mean(&lit(milk(6.0, 0.1)), 40_000, &deep, look);
    let [aimed, b] = mean(&lit(Medium { is_subsurface: false, ..milk(6.0, 0.1) }), 40_000, &deep, look);
    assert!((walked - aimed).abs() < 3.5 * a.hypot(b) && a < 0.02 * walked, "{walked} ± {a}, {aimed} ± {b}");
}

fn pbrt(material: &str) -> Result<Description, String> {
    let text = format!(
        "Camera \"perspective\" WorldBegin LightSource \"infinite\" \"rgb L\" [1 1 1]\nMaterial \"subsurface\" {material} Shape \"sphere\""
    );
    load::pbrt::load(text.as_bytes(), "test.pbrt", &|_| Err("no files".into())).map_err(|e| e.to_string())
}

#[test]
fn bodies_reflect_what_their_file_says() {
    // All directions at one place of the surface, by cosine: what it reflects, and of what enters the fraction that was asked for. The mean free path
    // is a thousandth of the radius.
    let from_within = 1.0 - (1.0 - 0.0664) / (1.33f64 * 1.33);
    assert!((from_within - 0.472).abs() < 0.002, "the average Fresnel reflectance for 1.33 is 6.6 %");
    for reflectance in [0.3, 0.75] {
        let d = pbrt(&format!("\"float mfp\" 0.001 \"float reflectance\" {reflectance}")).unwrap();
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
        let scene = Scene::build(d).unwrap();
        let settings = PathSettings { max_depth: 100, roulette_depth: 5 };
        let [found, error] = mean(&scene, 12_000, &settings, |i| {
            let u = [0, 1].map(|k| to_unit(mix(2 * i + k)));
            let out = sampling::cosine_hemisphere(u);
            (Vec3::Z + out * 0.5, -out)
        });
        let expected = 0.0664 + (1.0 - 0.0664) * reflectance;
        // Half a percent for the table of walks, and what leaves to the side of a round body.
        assert!((found - expected).abs() < 3.0 * error + 0.008, "{reflectance}: {found} ± {error}, expected {expected}");
    }
}

#[test]
fn media_below_surfaces_are_those_of_their_parameters() {
    let medium = |material: &str| match pbrt(material).unwrap().materials[0].interior.clone() {
        Interior::Body { medium: Some(medium), .. } => medium,
        other => panic!("{material}: {other:?}"),
    };
    let at = |c: &Coefficient| c.sample(&SampledWavelengths::rgb()).truncate();
    let skin = medium("\"string name\" \"Skin1\" \"float scale\" 10");
    assert!(skin.is_subsurface && at(&skin.scattering).abs_diff_eq(Vec3::new(7.4, 8.8, 10.1), 1e-2));
    assert!(at(&skin.absorption).abs_diff_eq(Vec3::new(0.32, 1.7, 4.8), 1e-2));
    let own = medium("\"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [30 20 10] \"float g\" 0.5");
    assert!(own.asymmetry == 0.5 && at(&own.absorption).abs_diff_eq(Vec3::new(1.0, 2.0, 3.0), 1e-3));
    // A mean free path is one over the extinction, whatever the albedo.
    let free = medium("\"rgb reflectance\" [0.8 0.5 0.2] \"rgb mfp\" [0.1 0.2 0.4] \"float scale\" 2");
    let extinction = at(&free.absorption) + at(&free.scattering);
    assert!(extinction.abs_diff_eq(Vec3::new(5.0, 2.5, 1.25), 1e-3), "{extinction}");
    let albedo = at(&free.scattering) / extinction;
    assert!(albedo.x > albedo.y && albedo.y > albedo.z && albedo.x > 0.98, "{albedo}");
    for (material, word) in [
        ("\"float scale\" 0", "above 0"),
        ("\"float g\" 1", "below 1"),
        ("\"string name\" \"Skim\"", "Skimmilk"),
        ("\"rgb sigma_a\" [1 1 1]", "sigma_s"),
        ("\"rgb sigma_a\" [1 1 1] \"rgb reflectance\" [1 1 1]", "one pair"),
        ("\"float mfp\" 1", "without reflectance"),
        ("\"float reflectance\" 0.5 \"rgb mfp\" [1 0 1]", "above 0"),
        ("\"rgb reflectance\" [2 1 1]", "0 to 1"),
        ("\"texture reflectance\" \"t\"", "texture"),
    ] {
        let e = pbrt(material).unwrap_err();
        assert!(e.contains(word), "{material}: {e}");
    }
}

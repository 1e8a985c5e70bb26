//! Features for denoisers: albedo and normals through smooth glass and in mirrors.

use diopter_light::{Ray, Spectrum};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Interior, Material, Scattering};
use diopter_scene::shape::Sphere;
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Immersion, Object, Scene, Shape};
use glam::Vec3;

fn ball(name: &str, x: f32, material: u32) -> Object {
    Object::new(name, Shape::Sphere(Sphere { center: Vec3::X * x, radius: 1.0 }), material)
}

/// A ray along x towards a ball of a material at 0, a red wall ball at 10 behind and a green one at -10 before it.
fn seen(first: Material, origin_x: f32) -> (diopter_scene::FirstSurface, diopter_scene::FirstSurface) {
    let matte = |name: &str, r, g, b| Material::new(name, Scattering::Diffuse(Color::rgb(r, g, b)));
    let scene = Scene::build(Description {
        materials: vec![first, matte("red", 0.8, 0.1, 0.1), matte("green", 0.1, 0.6, 0.1)],
        objects: vec![ball("first", 0.0, 0), ball("red", 10.0, 1), ball("green", -10.0, 2)],
        ..Default::default()
    })
    .unwrap();
    let ray = Ray { origin: Vec3::X * origin_x, direction: Vec3::X, time_s: 0.0 };
    (scene.first_surface(&ray).unwrap(), scene.first_rough_surface(&ray, Immersion::NONE).unwrap())
}

#[test]
fn what_is_behind_clear_glass_is_seen_and_the_truth_stays_in_front() {
    let (truth, features) = seen(Material::glass("glass", 1.5, None), -4.0);
    assert_eq!((truth.distance, truth.object), (features.distance, features.object));
    assert!((truth.distance - 3.0).abs() < 1e-4 && truth.object == 0);
    // Red, seen from the front; what the two faces reflect (4 % each) may be missing.
    assert!((features.normal - Vec3::NEG_X).length() < 1e-3, "{}", features.normal);
    assert!((0.7..0.81).contains(&features.albedo.x) && (0.08..0.11).contains(&features.albedo.y), "{}", features.albedo);
}

#[test]
fn mirrors_show_what_they_mirror() {
    let (n, k) = (Spectrum::Constant(0.0), Spectrum::Constant(1000.0));
    let smooth = Conductor { n, k, alpha: Scalar::Constant(0.0), across: None, bounces: FacetBounces::Compensated, tint: None };
    let (_, features) = seen(Material::new("mirror", Scattering::Conductor(smooth)), -4.0);
    // Green, whose front is seen from +x.
    assert!((features.normal - Vec3::X).length() < 1e-3, "{}", features.normal);
    assert!((0.55..0.61).contains(&features.albedo.y), "{}", features.albedo);
}

#[test]
fn rough_surfaces_are_seen_themselves_and_nothing_behind_glass_is_nothing() {
    let (truth, features) = seen(Material::new("white", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5))), -4.0);
    assert_eq!(truth, features);
    let scene = Scene::build(Description {
        materials: vec![Material::glass("glass", 1.5, None)],
        objects: vec![ball("first", 0.0, 0)],
        ..Default::default()
    })
    .unwrap();
    let ray = Ray { origin: Vec3::X * -4.0, direction: Vec3::X, time_s: 0.0 };
    let features = scene.first_rough_surface(&ray, Immersion::NONE).unwrap();
    assert_eq!((features.albedo, features.normal, features.object), (Vec3::ZERO, Vec3::ZERO, 0));
    assert!(scene.first_rough_surface(&Ray { direction: Vec3::Y, ..ray }, Immersion::NONE).is_none());
}

#[test]
fn a_camera_in_water_sees_straight_through_what_has_its_index() {
    let sphere = |radius: f32| Shape::Sphere(Sphere { center: Vec3::ZERO, radius });
    let interior = Interior::Body { medium: None, priority: Some(0) };
    let scene = Scene::build(Description {
        materials: vec![
            Material { interior, ..Material::glass("water", 1.33, None) },
            Material::new("red", Scattering::Diffuse(Color::rgb(0.8, 0.1, 0.1))),
        ],
        objects: vec![Object::new("sea", sphere(30.0), 0), Object::new("bag", sphere(1.0), 0), ball("red", 10.0, 1)],
        ..Default::default()
    })
    .unwrap();
    let ray = Ray { origin: Vec3::new(-4.0, 0.1, 0.0), direction: Vec3::X, time_s: 0.0 };
    let seen = |immersion| scene.first_rough_point(&ray, immersion).unwrap();
    let straight = seen(scene.immersion_at(ray.origin));
    assert!((straight.y - 0.1).abs() < 1e-5, "{straight}");
    assert!((seen(Immersion::NONE).y - 0.1).abs() > 0.1, "taken for water in air it bends");
}

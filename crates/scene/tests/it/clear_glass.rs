//! What is seen in and through clear glass: other ways of a path, and light samples that are bent.

use crate::common::{DEEP, assert_within, mean};
use diopter_light::Spectrum;
use diopter_scene::light::{Punctual, PunctualKind};
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{
    CoatedConductor, Conductor, Coverage, Emission, EmissionColor, Material, Principled, Scattering, Transmission,
};
use diopter_scene::shape::{CurveBasis, CurveKind, Curves, Quad, Sphere};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, Scene, Shape};
use glam::{Affine3A, Vec3, Vec4};
use std::sync::Arc;

/// Materials of all scenes here.
const FLOOR: u32 = 0;
const LAMP: u32 = 1;
const GLASS: u32 = 2;
const VARNISH: u32 = 3;
const DIM: u32 = 4;
const LACQUER: u32 = 5;
const HOLES: u32 = 6;

fn emitter(rgb: f32) -> Material {
    let emission = Emission {
        radiance: EmissionColor::Constant(Spectrum::light_from_rgb(Vec3::splat(rgb))),
        two_sided: true,
        is_light: true,
        modulation: Default::default(),
    };
    Material { emission: Some(emission), ..Material::new("lamp", Scattering::Black) }
}

fn materials(albedo: f32) -> Vec<Material> {
    let grey = |v| Color::rgb(v, v, v);
    let mut glass = Principled::new(grey(1.0), 1.5);
    (glass.transmission, glass.roughness, glass.kind) = (Scalar::Constant(1.0), Scalar::Constant(0.0), Transmission::Solid);
    let mut varnish = Principled::new(grey(0.0), 1.5);
    varnish.roughness = Scalar::Constant(0.0);
    let principled = |name: &str, p| Material::new(name, Scattering::Principled(Box::new(p)));
    let floor = Material::new("floor", Scattering::Diffuse(grey(albedo)));
    // A metal that reflects everything, smooth, under a rough coat: it looks as what is around it.
    let constant = |v| Spectrum::Constant(v);
    let (n, k, alpha, bounces) = (constant(0.0), constant(1000.0), Scalar::Constant(0.0), FacetBounces::Compensated);
    let metal = Conductor { n, k, alpha, across: None, bounces, tint: None };
    let coated = CoatedConductor::new(metal, 1.5, Scalar::Constant(0.5));
    let lacquer = Material::new("lacquer", Scattering::Coated(Box::new(coated)));
    let holes = Material { coverage: Coverage::Blend(Scalar::Constant(0.5)), ..emitter(1.0) };
    vec![floor, emitter(1.0), principled("glass", glass), principled("varnish", varnish), emitter(0.25), lacquer, holes]
}

/// A square `2 half` wide at a height, facing up or down.
fn level(name: &str, height: f32, half: f32, up: bool, material: u32) -> Object {
    let [first, second] = if up { [Vec3::Z, Vec3::X] } else { [Vec3::X, Vec3::Z] };
    let quad = Quad { corner: Vec3::new(-half, height, -half), edges: [first * 2.0 * half, second * 2.0 * half] };
    Object::new(name, Shape::Quad(quad), material)
}

/// A pane between two heights, closed at its edges: through an open edge light would enter without refraction and be dimmer in the glass than the index squared asks.
fn pane(from: f32, to: f32, half: f32) -> [Object; 6] {
    let edge = |a: [f32; 2], b: [f32; 2]| {
        let [along, corner] = [Vec3::new(b[0] - a[0], 0.0, b[1] - a[1]), Vec3::new(a[0], from, a[1])];
        Object::new("edge", Shape::Quad(Quad { corner, edges: [Vec3::Y * (to - from), along] }), GLASS)
    };
    let [a, b, c, d] = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let [below, above] = [level("below", from, half, false, GLASS), level("above", to, half, true, GLASS)];
    [below, above, edge(a, b), edge(b, c), edge(c, d), edge(d, a)]
}

fn ball(center: Vec3, radius: f32, material: u32) -> Object {
    Object::new("ball", Shape::Sphere(Sphere { center, radius }), material)
}

/// Fresnel, unpolarised, from the thinner side of an index of 1.5.
fn fresnel(cos: f64) -> f64 {
    let t = (1.0 - (1.0 - cos * cos) / 2.25).sqrt();
    let (s, p) = ((cos - 1.5 * t) / (cos + 1.5 * t), (1.5 * cos - t) / (1.5 * cos + t));
    0.5 * (s * s + p * p)
}

#[test]
fn a_lamp_mirrored_in_varnish_is_seen_by_every_sample() {
    let objects = vec![level("floor", 0.0, 50.0, true, VARNISH), level("lamp", 1.0, 50.0, false, LAMP)];
    let scene = Scene::build(Description { materials: materials(0.5), objects, ..Default::default() }).unwrap();
    let towards = Vec3::new(1.0, -0.5, 0.0).normalize();
    let (found, error) = mean(&scene, Vec3::new(0.0, 0.5, 0.0), towards, 64, &DEEP);
    let expected = fresnel(f64::from(-towards.y));
    assert!(found.iter().all(|l| (l / expected - 1.0).abs() < 1e-4), "{found:?} {expected}");
    // The varnish is chosen by chance, and what it shows is not.
    assert!(error.iter().all(|e| *e < 1e-4 * expected), "{error:?}");
}

#[test]
fn a_pane_shows_what_is_before_and_behind_it_with_little_noise() {
    // Bright above, dim below, seen from above: (2 r / (1 + r)) of the one, the rest of the other.
    let mut objects = vec![level("bright", 2.0, 200.0, false, LAMP), level("dim", -2.0, 200.0, true, DIM)];
    objects.extend(pane(0.0, 0.01, 200.0));
    let scene = Scene::build(Description { materials: materials(0.5), objects, ..Default::default() }).unwrap();
    for down in [1.0f32, 0.5, 0.25] {
        let towards = Vec3::new(1.0, -down, 0.0).normalize();
        let n = 1024;
        let (found, error) = mean(&scene, Vec3::new(0.0, 0.5, 0.0), towards, n, &DEEP);
        let r = fresnel(f64::from(-towards.y));
        let mirrored = 2.0 * r / (1.0 + r);
        assert_within((found, error), [mirrored + 0.25 * (1.0 - mirrored); 4], 1e-4, "pane");
        // A choice by chance between both ways has a standard deviation of this; what goes to and fro within the pane is left, and that faint ways are followed by chance.
        let by_chance = 0.75 * (mirrored * (1.0 - mirrored)).sqrt();
        let deviation = error[0] * f64::from(n).sqrt();
        assert!(deviation < 0.5 * by_chance, "{down}: {deviation} {by_chance}");
    }
}

#[test]
fn the_sun_comes_through_a_pane() {
    // A pane turns no direction: what the sun brings to the floor is less by what both faces mirror. By chance one path in some ten thousand would meet it.
    let (half_angle, direction) = (0.00465, Vec3::new(0.5, -(0.75f32.sqrt()), 0.0));
    let sun = Punctual::new("sun", Spectrum::light_from_rgb(Vec3::splat(2.0)), PunctualKind::Disc { direction, half_angle });
    let mut objects = vec![level("floor", 0.0, 500.0, true, FLOOR)];
    objects.extend(pane(1.0, 1.1, 500.0));
    let description = Description { materials: materials(0.5), objects, punctual: vec![sun], ..Default::default() };
    let scene = Scene::build(description).unwrap();
    let cos = f64::from(-direction.y);
    let passed = |cos: f64| 1.0 - 2.0 * fresnel(cos) / (1.0 + fresnel(cos));
    // The pane throws a part of what the floor reflects back to it: of diffuse light 2 ∫ ρ(cos) cos dcos.
    let back: f64 = (0..1000).map(|i| (i as f64 + 0.5) / 1000.0).map(|cos| 2e-3 * (1.0 - passed(cos)) * cos).sum();
    let expected = 2.0 * cos * passed(cos) / std::f64::consts::PI * 0.5 / (1.0 - 0.5 * back);
    let (found, error) = mean(&scene, Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.2, -1.0, 0.1), 8192, &DEEP);
    assert_within((found, error), [expected; 4], 2e-3, "sun");
    assert!(error[0] < 0.02 * expected, "{} {expected}", error[0]);
}

#[test]
fn light_through_glass_is_counted_once() {
    // A white floor among walls that shine alike, bodies of clear glass above it: it looks as the walls do, by light samples straight and bent and by scattered rays together. A ball bends far,
    // a pane hardly. A lamp between panes and one with holes are sampled, too, and strands stand in the light.
    let mut materials = materials(1.0);
    materials[LAMP as usize] = emitter(1.0);
    let walls = [level("floor", 0.0, 4.0, true, FLOOR), level("ceiling", 4.0, 4.0, false, LAMP)];
    let side = |corner: Vec3, along: Vec3| {
        let quad = Quad { corner, edges: [along, Vec3::Y * 4.0] };
        Object::new("wall", Shape::Quad(quad), LAMP)
    };
    let sides = [
        side(Vec3::new(-4.0, 0.0, -4.0), Vec3::X * 8.0),
        side(Vec3::new(-4.0, 0.0, 4.0), Vec3::X * 8.0),
        side(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0),
        side(Vec3::new(4.0, 0.0, -4.0), Vec3::Z * 8.0),
    ];
    let between = ball(Vec3::new(0.2, 0.8, 0.3), 0.1, LAMP);
    let holes = level("lamp with holes", 1.5, 1.0, false, HOLES);
    for (what, glass) in [
        ("ball", vec![ball(Vec3::new(0.0, 0.8, 0.3), 0.7, GLASS)]),
        ("pane", pane(0.5, 0.6, 3.9).to_vec()),
        ("balls", vec![ball(Vec3::new(0.0, 0.8, 0.3), 0.7, GLASS), ball(Vec3::new(-1.0, 1.0, 1.0), 0.6, GLASS)]),
        ("lamp between panes", pane(0.5, 0.6, 3.9).into_iter().chain(pane(1.0, 1.1, 3.9)).chain([between]).collect()),
        ("lamp with holes", pane(0.5, 0.6, 3.9).into_iter().chain([holes]).collect()),
    ] {
        let objects = walls.iter().chain(&sides).cloned().chain(glass).collect();
        let scene = Scene::build(Description { materials: materials.clone(), objects, ..Default::default() }).unwrap();
        let (found, error) = mean(&scene, Vec3::new(-0.4, 0.2, -1.0), Vec3::new(0.3, -0.2, 1.0), 1 << 17, &DEEP);
        assert_within((found, error), [1.0; 4], 1e-3, what);
        assert!(error[0] < 0.01, "{what}: {}", error[0]);
    }
    // A white strand below the pane: shadow rays leave it where it ends, not from its middle.
    let points = (0..4).map(|k| Vec4::new(-0.3 + 0.2 * k as f32, 0.2, 0.3, 0.03)).collect();
    let (kind, basis) = (CurveKind::Cylinder, CurveBasis::Bezier);
    let strand = Curves { kind, basis, points, segments: vec![0], normals: Vec::new() };
    let shape = Shape::Curves { curves: 0, world_from_curves: Affine3A::IDENTITY };
    let objects = walls.iter().chain(&sides).cloned().chain(pane(0.5, 0.6, 3.9)).chain([Object::new("strand", shape, FLOOR)]);
    let (objects, curves) = (objects.collect(), vec![Arc::new(strand)]);
    let scene = Scene::build(Description { materials: materials.clone(), objects, curves, ..Default::default() }).unwrap();
    let found = mean(&scene, Vec3::new(0.0, 0.4, -0.5), Vec3::new(0.0, -0.2, 0.8), 1 << 17, &DEEP);
    assert_within(found, [1.0; 4], 1e-3, "strand");
    // Lacquered metal behind the pane and seen through it, lit by the walls.
    let objects =
        walls.iter().chain(&sides).cloned().chain(pane(0.5, 0.6, 3.9)).chain([ball(Vec3::new(0.0, 1.5, 0.0), 0.5, LACQUER)]);
    let scene = Scene::build(Description { materials, objects: objects.collect(), ..Default::default() }).unwrap();
    for towards in [Vec3::new(0.1, 1.3, 0.0), Vec3::new(-0.3, 1.2, 0.2)] {
        let found = mean(&scene, Vec3::new(0.0, 0.2, 0.0), towards, 1 << 13, &DEEP);
        assert_within(found, [1.0; 4], 3e-3, "lacquer");
    }
}

#[test]
fn a_pane_on_a_table_is_the_same_in_millimetres() {
    // A pane of glass a tenth as thick as it stands above the table, a ball of glass beside it, a lamp above; looked at through the pane and past the ball.
    let seen = |scale: f32| {
        let mut description = Description { materials: materials(0.7), ..Default::default() };
        description.objects.push(level("table", 0.0, 1.0, true, FLOOR));
        description.objects.push(level("lamp", 1.5, 0.3, false, LAMP));
        description.objects.push(level("top of the pane", 0.11, 0.4, true, GLASS));
        description.objects.push(level("bottom of the pane", 0.1, 0.4, false, GLASS));
        let ball = Sphere { center: Vec3::new(0.6, 0.2, 0.0), radius: 0.2 };
        description.objects.push(Object::new("ball", Shape::Sphere(ball), GLASS));
        description.scale(scale).unwrap();
        let scene = Scene::build(description).unwrap();
        [Vec3::new(0.1, 0.0, 0.05), Vec3::new(0.62, 0.0, 0.02), Vec3::new(0.3, 0.0, 0.3)].map(|at| {
            let eye = Vec3::new(0.2, 1.0, 0.9);
            mean(&scene, eye * scale, at - eye, 20_000, &DEEP)
        })
    };
    let whole = seen(1.0);
    for scale in [0.01, 0.001] {
        for (k, (small, whole)) in seen(scale).into_iter().zip(whole).enumerate() {
            // The same paths but for rounding.
            assert_within(small, whole.0, 0.01, &format!("place {k} at a scale of {scale}"));
        }
    }
}

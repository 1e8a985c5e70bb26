//! Lamps over flat mirrors: light samples from the images of vertices.

use crate::common::{DEEP, assert_within, mean};
use diopter_light::Spectrum;
use diopter_scene::material::conductor::FacetBounces;
use diopter_scene::material::{Conductor, Emission, EmissionColor, Material, Scattering};
use diopter_scene::radiance::PathSettings;
use diopter_scene::shape::{Mesh, Quad};
use diopter_scene::texture::{Color, Scalar};
use diopter_scene::{Description, Object, Scene, Shape};
use glam::{Affine3A, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

const FLOOR: u32 = 0;
const LAMP: u32 = 1;
const MIRROR: u32 = 2;

/// A floor of an albedo, lamps of radiance 1 on one side or both, and a mirror that reflects everything.
fn materials(albedo: f32, two_sided: bool) -> Vec<Material> {
    let emission = Emission {
        radiance: EmissionColor::Constant(Spectrum::light_from_rgb(Vec3::ONE)),
        two_sided,
        is_light: true,
        modulation: Default::default(),
    };
    let constant = |v| Spectrum::Constant(v);
    let (n, k, alpha, bounces) = (constant(0.0), constant(1000.0), Scalar::Constant(0.0), FacetBounces::Compensated);
    vec![
        Material::new("floor", Scattering::Diffuse(Color::rgb(albedo, albedo, albedo))),
        Material { emission: Some(emission), ..Material::new("lamp", Scattering::Black) },
        Material::new("mirror", Scattering::Conductor(Conductor { n, k, alpha, across: None, bounces, tint: None })),
    ]
}

fn quad(material: u32, corner: [f32; 3], edges: [[f32; 3]; 2]) -> Object {
    let [corner, a, b] = [corner, edges[0], edges[1]].map(Vec3::from_array);
    Object::new("quad", Shape::Quad(Quad { corner, edges: [a, b] }), material)
}

/// A square `2 half` wide at a height, facing up.
fn facing_up(material: u32, height: f32, half: f32) -> Object {
    quad(material, [-half, height, -half], [[0.0, 0.0, 2.0 * half], [2.0 * half, 0.0, 0.0]])
}

#[test]
fn a_small_lamp_over_a_mirror_is_sampled() {
    // The lamp shines up at the mirror alone; the floor sees its image 3 m above.
    let (half, at) = (0.05, [0.6, 0.0, 0.0]);
    let scene = |mirror: Object| {
        let objects = vec![facing_up(FLOOR, 0.0, 50.0), facing_up(LAMP, 1.0, half), mirror];
        Scene::build(Description { materials: materials(0.5, false), objects, ..Default::default() }).unwrap()
    };
    let n = 100;
    let step = 2.0 * f64::from(half) / f64::from(n);
    let irradiance: f64 = (0..n * n)
        .map(|i| [i % n, i / n].map(|k| (f64::from(k) + 0.5) * step - f64::from(half)))
        .map(|[x, z]| {
            let squared = (x - at[0]).powi(2) + z * z + 9.0;
            9.0 / (squared * squared) * step * step
        })
        .sum();
    let two_events = PathSettings { max_depth: 2, ..DEEP };
    let towards = Vec3::new(0.2, -1.0, 0.1);
    let seen_from = Vec3::from_array(at.map(|v| v as f32)) - towards;
    let found = mean(&scene(facing_up(MIRROR, 2.0, 1.0)), seen_from, towards.normalize(), 1024, &two_events);
    assert_within(found, [0.5 * irradiance / PI; 4], 1e-4, "mirror");
    // A scattered ray would meet its image once in 3000 times.
    assert!(found.1[0] < 0.002 * found.0[0], "{found:?}");
    // Two triangles of a mesh, and a mirror that stops short of where the image would be seen.
    let triangles = Mesh {
        positions: [[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]].map(Vec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    };
    let shape = Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY };
    let objects = vec![facing_up(FLOOR, 0.0, 50.0), facing_up(LAMP, 1.0, half), Object::new("mirror", shape, MIRROR)];
    let description =
        Description { materials: materials(0.5, false), objects, meshes: vec![Arc::new(triangles)], ..Default::default() };
    let of_mesh = mean(&Scene::build(description).unwrap(), seen_from, towards.normalize(), 1024, &two_events);
    assert_within(of_mesh, [0.5 * irradiance / PI; 4], 1e-4, "mesh");
    let (none, _) = mean(&scene(facing_up(MIRROR, 2.0, 0.1)), seen_from, towards.normalize(), 1024, &two_events);
    assert_eq!(none, [0.0; 4]);
}

#[test]
fn light_over_mirrors_is_counted_once() {
    // A white floor among walls that shine alike, mirrors on two sides and a third that leans before a wall: it looks as the walls do, by light samples straight and mirrored and by scattered rays together.
    let wall = |corner: [f32; 3], along: [f32; 3], material: u32| quad(material, corner, [along, [0.0, 4.0, 0.0]]);
    let objects = vec![
        facing_up(FLOOR, 0.0, 4.0),
        facing_up(LAMP, 4.0, 4.0),
        wall([-4.0, 0.0, -4.0], [8.0, 0.0, 0.0], LAMP),
        wall([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], MIRROR),
        wall([-4.0, 0.0, -4.0], [0.0, 0.0, 8.0], LAMP),
        wall([4.0, 0.0, -4.0], [0.0, 0.0, 8.0], MIRROR),
        quad(MIRROR, [-2.0, 0.2, -2.0], [[2.0, 0.0, 0.0], [0.0, 1.5, -0.5]]),
        facing_up(LAMP, 0.5, 0.2),
    ];
    let scene = Scene::build(Description { materials: materials(1.0, true), objects, ..Default::default() }).unwrap();
    for (place, towards) in
        [([1.5, 1.0, 1.0], [0.3, -1.0, 0.2]), ([3.0, 0.5, 3.0], [0.2, -1.0, 0.5]), ([-1.0, 0.9, -1.0], [0.0, -1.0, -0.2])]
    {
        let found = mean(&scene, Vec3::from_array(place), Vec3::from_array(towards).normalize(), 16384, &DEEP);
        assert_within(found, [1.0; 4], 2e-3, &format!("{place:?}"));
    }
}

//! What motion costs: scenes while they move, and the same scenes frozen.
//!
//! `cargo bench -p diopter --bench motion [-- FOLDER]`: FOLDER holds the glTF scenes (`gltf_Fox/Fox.glb` ...); without it only the scenes
//! made here. Ratios of medians; blur itself makes rays less coherent, which is part of the price.

mod shared;

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::ExposureFacts;
use diopter::lens::{Lens, Pinhole};
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::material::{Material, Scattering};
use diopter::scene::motion::{
    AnimatedProperty, Animation, AnimationPlayback, Channel, Deformer, Extrapolation, KeyInterpolation, Motion, Node, Target,
};
use diopter::scene::shape::Mesh;
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape, builtin, load};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::{Affine3A, Vec3};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// A bumpy sphere of 2 n² triangles.
fn sphere(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let (theta, phi) = (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::TAU * j as f32 / n as f32);
            let r = 1.0 + 0.05 * (20.0 * theta).sin() * (17.0 * phi).cos();
            mesh.positions.push(Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * r);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            mesh.triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        }
    }
    mesh
}

fn key_frames(property: AnimatedProperty, values: Vec<f32>) -> Animation {
    let channel = Channel { node: 0, property, interpolation: KeyInterpolation::Linear, times_s: vec![0.0, 1.0], values };
    Animation { name: "move".into(), channels: vec![channel] }
}

/// A sphere of half a million triangles: turning, or swelling corner by corner.
fn large(bends: bool) -> Description {
    let mesh = sphere(500);
    let mut d = Description {
        materials: vec![Material::new("grey", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
        nodes: vec![Node::new("a")],
        playing: AnimationPlayback { animations: vec![0], ending: Extrapolation::Clamp, frozen_at_s: None },
        ..Default::default()
    };
    let motion = match bends {
        false => {
            let turn = glam::Quat::from_rotation_y(0.5);
            let values = [glam::Quat::IDENTITY.to_array(), turn.to_array()].concat();
            d.animations = vec![key_frames(AnimatedProperty::Rotation, values)];
            Motion::Carried { node: 0 }
        }
        true => {
            d.animations = vec![key_frames(AnimatedProperty::MorphWeights, vec![0.0, 1.0])];
            let positions = mesh.positions.iter().map(|p| *p * 0.1).collect();
            let targets = vec![Target { positions, ..Default::default() }];
            d.deformers = vec![Deformer { mesh: 0, node: 0, targets, weights: vec![0.0], skin: None }];
            Motion::Deformed { deformer: 0 }
        }
    };
    let shape = Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY };
    d.objects = vec![Object { motion, ..Object::new("sphere", shape, 0) }];
    d.meshes = vec![mesh.into()];
    d
}

fn main() {
    let folder = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    let mut scenes: Vec<(String, Description, f64)> = vec![
        ("propeller".into(), builtin::named("propeller").expect("embedded"), 0.02),
        ("500 k triangles turn by 0.25 rad".into(), large(false), 0.5),
        ("500 k triangles swell by 5 %".into(), large(true), 0.5),
    ];
    for (file, animation, time) in [("gltf_Fox/Fox.glb", 2, 0.1), ("gltf_CesiumMilkTruck/CesiumMilkTruck.glb", 0, 0.2)] {
        let Some(bytes) = folder.as_ref().and_then(|f| std::fs::read(Path::new(f).join(file)).ok()) else { continue };
        let mut d = load::gltf::load(&bytes, file, &|_| Err("none".into())).expect("a scene");
        d.playing.animations = vec![animation];
        scenes.push((file.into(), d, time));
    }
    println!("{:<45} {:>9} {:>9} {:>7} {:>10}", "scene", "moving s", "frozen s", "ratio", "pose ms");
    for (name, mut d, time) in scenes {
        if d.environment.is_none() {
            d.environment = Some(Environment::uniform(Vec3::splat(1000.0)));
        }
        let bounds = d.bounds_at(0.0, |_| true);
        let from = bounds.center() + Vec3::new(0.6, 0.3, 1.0).normalize() * bounds.size().length() * 1.2;
        let lens = Lens::Pinhole(Pinhole::new(Millimeters(35.0), 8.0).expect("a pinhole"));
        let way = CameraMotion::still(look_at(from, bounds.center(), Vec3::Y).expect("a place"));
        let camera = Camera { lens, film: Film::new(36.0, 24.0, 360, 240), motion: way };
        let mut frozen = d.clone();
        frozen.playing.frozen_at_s = Some(0.5 * time);
        let frozen = Scene::build(frozen).expect("a scene");
        let mut moving = Scene::build(d).expect("a scene");
        let begun = Instant::now();
        moving.pose(0.0, time);
        let pose_ms = begun.elapsed().as_secs_f64() * 1e3;
        let take = |scene: &Scene| {
            let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
            let settings = Settings { truth: false, ..Settings::new(16) };
            let (shutter, response) = (Shutter::global(time), Response::luminance());
            expose(scene, &camera, &shutter, &response, &settings, &ExposureFacts::default(), &watch).expect("an exposure");
        };
        let (a, b) = (shared::median(|| take(&moving)), shared::median(|| take(&frozen)));
        println!("{name:<45} {a:>9.3} {b:>9.3} {:>7.2} {pose_ms:>10.1}", a / b);
    }
}

//! A striped ball with a small lamp on top of its axle rolls along a table to the right, at 1 m/s, in the dim light of a room (about EV 5):
//! for long times, flashes and curtains.
//!
//! Metres. Marbles stand on the table from near to far. The ball is 24 cm across; the lamp (20 000 cd/m², 6 mm) rides beside the hub and draws a line of light.

use super::Framing;
use super::builder::{Builder, block, slide, spin};
use super::lathe::turn;
use crate::light::Environment;
use crate::material::{Emission, EmissionColor, Material, Scattering};
use crate::motion::Parts;
use crate::scene::Description;
use crate::shape::Mesh;
use crate::texture::Color;
use diopter_light::spectrum::blackbody_with_luminance;
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

const RADIUS: f32 = 0.12;
/// m/s
const SPEED: f32 = 1.0;
const WAY: f32 = 1.6;

/// From before the table.
pub const FRAMING: Framing = Framing {
    look_from: Vec3::new(0.0, 0.28, 2.4),
    look_at: Vec3::new(0.0, 0.16, 0.0),
    focal_length_mm: 50.0,
    f_number: 4.0,
    focus_m: 2.3,
};

/// A slice of a ball between two longitudes, about +y.
fn slice(k: u32, of: u32) -> Mesh {
    let profile: Vec<Vec2> =
        (0..=24).map(|i| (i as f32 / 24.0 - 0.5) * PI).map(|a| Vec2::new(RADIUS * a.cos().max(0.0), RADIUS * a.sin())).collect();
    let mut mesh = turn(&profile, 8 * of);
    let (from, to) = (TAU * k as f32 / of as f32, TAU * (k + 1) as f32 / of as f32);
    let positions = mesh.positions.clone();
    mesh.triangles.retain(|t| {
        let middle: Vec3 = t.iter().map(|i| positions[*i as usize]).sum();
        let angle = middle.x.atan2(middle.z).rem_euclid(TAU);
        angle > from && angle < to
    });
    mesh
}

/// The ball at the left end of its way.
pub fn description() -> Description {
    let mut b = Builder(Description { name: "rolling-ball".into(), ..Default::default() });
    let colors = [[0.75, 0.06, 0.04], [0.85, 0.83, 0.78]];
    let stripes = colors.map(|[r, g, blue]| b.glossy("ball", Color::rgb(r, g, blue), 0.35, 0.6));
    let table = b.glossy("table", Color::rgb(0.18, 0.11, 0.07), 0.5, 0.2);
    let wall = b.matte("wall", [0.35, 0.38, 0.42]);
    b.quad("table", Vec3::new(-3.0, 0.0, 3.2), [Vec3::X * 6.0, Vec3::NEG_Z * 4.2], table);
    b.quad("wall", Vec3::new(-3.0, -0.5, -0.9), [Vec3::X * 6.0, Vec3::Y * 4.0], wall);
    // Marbles from near to far, for what is sharp.
    for k in 0..9 {
        let hue = k as f32 * 0.7;
        let [r, g, blue] = [0.0, 2.1, 4.2].map(|p| 0.35 + 0.3 * (hue + p).sin());
        let paint = b.glossy("marble", Color::rgb(r, g, blue), 0.1, 1.0);
        let z = 1.3 - 0.25 * k as f32;
        b.sphere("marble", Vec3::new(-0.34 + 0.10 * k as f32, 0.035, z + 0.18), 0.035, paint);
    }
    let way = b.node("way", None, Parts::IDENTITY);
    // The axle points at the camera: the ball's own +y.
    let axle = b.node("axle", Some(way), Parts { rotation: Quat::from_rotation_x(PI / 2.0), ..Parts::IDENTITY });
    let ball = b.node("ball", Some(axle), Parts::IDENTITY);
    for k in 0..8 {
        b.hang("ball", slice(k, 8), stripes[k as usize % 2], ball);
    }
    let emission = Emission {
        radiance: EmissionColor::Constant(blackbody_with_luminance(3000.0, 2e4)),
        two_sided: true,
        is_light: true,
        modulation: Default::default(),
    };
    let lamp = b.material(Material { emission: Some(emission), ..Material::new("lamp", Scattering::Black) });
    b.hang("lamp", block(Vec3::new(0.096, 0.06, -0.003), Vec3::new(0.102, 0.066, 0.003)), lamp, ball);
    // Rolling to the right: clockwise for the camera, as far as the way.
    b.animate("roll", vec![slide(way, Vec3::new(-0.5 * WAY, RADIUS, 0.0), Vec3::new(0.5 * WAY, RADIUS, 0.0), WAY / SPEED)]);
    b.animate("spin", vec![spin(ball, Vec3::NEG_Y, TAU * RADIUS / SPEED)]);
    b.0.environment = Some(Environment::uniform(Vec3::splat(8.0)));
    b.0
}

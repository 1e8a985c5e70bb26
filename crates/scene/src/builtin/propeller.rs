//! A three-bladed propeller that turns 25 times a second (1500 a minute) before a bright sky, sun from the left: about EV 14.
//!
//! Metres; 1.9 m across, as of a light aircraft. Turns clockwise as the camera sees it.

use super::Framing;
use super::builder::{Builder, spin};
use super::lathe::{smooth, turn};
use crate::light::{Environment, Punctual, PunctualKind};
use crate::motion::Parts;
use crate::scene::Description;
use crate::shape::Mesh;
use crate::texture::Color;
use diopter_light::Spectrum;
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Turns a second.
pub const TURNS: f32 = 25.0;
const RADIUS: f32 = 0.95;

/// Straight from before.
pub const FRAMING: Framing =
    Framing { look_from: Vec3::new(0.0, 0.0, 6.0), look_at: Vec3::ZERO, focal_length_mm: 70.0, f_number: 8.0, focus_m: 6.0 };

/// A blade along +y from the hub, between two fractions of its length: twisted, widest at a third, with a rounded tip.
fn blade(from: f32, to: f32) -> Mesh {
    let (along, across) = (24u32, 10u32);
    let mut mesh = Mesh::default();
    for i in 0..=along {
        let s = from + (to - from) * i as f32 / along as f32;
        let r = 0.07 + (RADIUS - 0.07) * s;
        // Chord and twist of a fixed-pitch propeller, roughly.
        let chord = 0.15 * (0.55 + 1.6 * s * (1.0 - s)).min(1.0) * (1.0 - ((s - 0.86) / 0.14).max(0.0).powi(2)).max(0.0).sqrt();
        let twist = (0.32 / (0.2 + r)).atan();
        for side in [1.0f32, -1.0] {
            for j in 0..=across {
                let u = j as f32 / across as f32 * 2.0 - 1.0;
                let thick = side * 0.1 * chord * (1.0 - u * u).max(0.0).sqrt();
                let (x, z) = (0.5 * chord * u, thick);
                mesh.positions.push(Vec3::new(x * twist.cos() + z * twist.sin(), r, -x * twist.sin() + z * twist.cos()));
            }
        }
    }
    let row = 2 * (across + 1);
    for i in 0..along {
        for (k, flip) in [(0, false), (across + 1, true)] {
            for j in 0..across {
                let a = i * row + k + j;
                let (b, c, d) = (a + 1, a + row, a + row + 1);
                match flip {
                    false => mesh.triangles.extend([[a, b, d], [a, d, c]]),
                    true => mesh.triangles.extend([[a, d, b], [a, c, d]]),
                }
            }
        }
    }
    mesh
}

/// The propeller.
pub fn description() -> Description {
    let mut b = Builder(Description { name: "propeller".into(), ..Default::default() });
    let metal = b.glossy("blades", Color::rgb(0.035, 0.035, 0.04), 0.35, 0.3);
    let tip = b.glossy("tips", Color::rgb(0.85, 0.6, 0.05), 0.4, 0.5);
    let red = b.glossy("spinner", Color::rgb(0.6, 0.03, 0.03), 0.25, 1.0);
    let white = b.glossy("cowling", Color::rgb(0.8, 0.8, 0.78), 0.3, 1.0);
    let hub = b.node("hub", None, Parts::IDENTITY);
    for k in 0..3 {
        let rotation = Quat::from_rotation_z(TAU * k as f32 / 3.0);
        let arm = b.node("blade", Some(hub), Parts { rotation, ..Parts::IDENTITY });
        b.hang("blade", blade(0.0, 0.86), metal, arm);
        b.hang("tip", blade(0.86, 1.0), tip, arm);
    }
    // Turned about +y, then laid to face the camera.
    let nose =
        [Vec2::new(0.13, -0.05), Vec2::new(0.125, 0.05), Vec2::new(0.09, 0.15), Vec2::new(0.04, 0.21), Vec2::new(0.0, 0.225)];
    let forward = Quat::from_rotation_x(PI / 2.0);
    let spinner = b.node("spinner", Some(hub), Parts { rotation: forward, ..Parts::IDENTITY });
    b.hang("spinner", turn(&smooth(&nose, 8), 48), red, spinner);
    let cowling =
        [Vec2::new(0.30, -0.9), Vec2::new(0.30, -0.25), Vec2::new(0.24, -0.12), Vec2::new(0.15, -0.09), Vec2::new(0.0, -0.09)];
    let cowling = b.mesh(turn(&smooth(&cowling, 8), 64));
    b.place("cowling", cowling, white, Vec3::ZERO, forward);
    b.animate("turn", vec![spin(hub, Vec3::NEG_Z, 1.0 / TURNS)]);
    b.0.environment = Some(Environment::uniform(Vec3::new(1900.0, 2900.0, 4600.0)));
    let sun = PunctualKind::Directional { direction: Vec3::new(0.6, -0.7, -0.8).normalize() };
    b.0.punctual.push(Punctual::new("sun", Spectrum::light_from_rgb(Vec3::new(75_000.0, 70_000.0, 62_000.0)), sun));
    b.0
}

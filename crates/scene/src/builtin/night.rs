//! A road at night under the stars: a car with its lamps drives past, the sky turns about the pole. For long exposures.
//!
//! Metres, one scene unit of time a second; looking north at 48° of latitude. Stars: as many of each magnitude as the sky has on
//! average (about three times more with each), their illuminance 2.54·10⁻⁶ lx · 10^(−0.4 m) (Allen's Astrophysical Quantities, 4th ed., §15.3)
//! spread over 2.5 mrad, as by a soft lens. The sky itself has 1 mcd/m² (a village). The car passes every 12 s at 10 m/s.

use super::Framing;
use super::builder::{Builder, block, slide, spin};
use crate::light::Environment;
use crate::material::{Emission, EmissionColor, Material, Scattering};
use crate::motion::Parts;
use crate::scene::Description;
use crate::shape::Mesh;
use crate::texture::Color;
use diopter_light::random::{mix, to_unit};
use diopter_light::spectrum::blackbody_with_luminance;
use glam::Vec3;
use std::f32::consts::TAU;

/// s for a turn of the sky. Source: IAU, mean sidereal day.
const SIDEREAL_DAY_S: f32 = 86_164.1;
const LATITUDE_DEG: f32 = 48.0;
/// Radius of the sphere of stars, m, and their size, m.
const SKY: f32 = 2000.0;
const STAR: f32 = 5.0;
/// Magnitudes and how many stars there are down to half a magnitude fainter (whole sky). Source: Allen 2000, table 19.8 (rounded).
const STARS: [(f32, u32); 7] = [(0.0, 12), (1.0, 30), (2.0, 100), (3.0, 320), (4.0, 1000), (5.0, 3000), (5.8, 3500)];

/// Low, a wide lens, open.
pub const FRAMING: Framing = Framing {
    look_from: Vec3::new(0.0, 1.5, 26.0),
    look_at: Vec3::new(0.0, 9.5, 0.0),
    focal_length_mm: 24.0,
    f_number: 2.0,
    focus_m: 26.0,
};

fn glow(b: &mut Builder, name: &str, kelvin: f32, luminance: f32, is_light: bool) -> u32 {
    let radiance = EmissionColor::Constant(blackbody_with_luminance(kelvin, luminance));
    let emission = Emission { radiance, two_sided: false, is_light, modulation: Default::default() };
    b.material(Material { emission: Some(emission), ..Material::new(name, Scattering::Black) })
}

/// Squares on the sphere of stars that face its middle.
fn stars(seed: u32, count: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..count {
        let u = |k: u32| to_unit(mix(mix(seed * 0x9e37 + i) ^ k.wrapping_mul(0x85eb_ca6b)));
        let (z, phi) = (2.0 * u(1) - 1.0, TAU * u(2));
        let r = (1.0 - z * z).sqrt();
        let out = Vec3::new(r * phi.cos(), r * phi.sin(), z);
        let (x, y) = out.any_orthonormal_pair();
        let first = mesh.positions.len() as u32;
        let corner = |a: f32, c: f32| out * SKY + (x * a + y * c) * (0.5 * STAR);
        mesh.positions.extend([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)]);
        // Counter-clockwise for an eye in the middle.
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}

/// The road; the car comes from the left.
pub fn description() -> Description {
    let mut b = Builder(Description { name: "night".into(), ..Default::default() });
    let (grass, road, line) = (b.matte("grass", [0.05, 0.07, 0.03]), b.matte("road", [0.07; 3]), b.matte("line", [0.7; 3]));
    let level = |y: f32, z: f32, depth: f32| (Vec3::new(-300.0, y, z), [Vec3::X * 600.0, Vec3::NEG_Z * depth]);
    let (corner, edges) = level(0.0, 40.0, 440.0);
    b.quad("grass", corner, edges, grass);
    let (corner, edges) = level(0.01, 4.0, 8.0);
    b.quad("road", corner, edges, road);
    for k in -40..40 {
        b.quad("line", Vec3::new(k as f32 * 6.0, 0.015, 0.08), [Vec3::X * 3.0, Vec3::NEG_Z * 0.16], line);
    }
    // A row of trees, dark against the sky.
    let leaves = b.matte("trees", [0.02, 0.03, 0.015]);
    for k in 0..40u32 {
        let (u, v) = (to_unit(mix(k)), to_unit(mix(k + 100)));
        b.sphere("trees", Vec3::new((k as f32 - 20.0) * 5.5 + 3.0 * u, 1.5 + v, -30.0 - 12.0 * v), 2.5 + 2.5 * u, leaves);
    }
    let car = b.node("car", None, Parts::IDENTITY);
    let paint = b.glossy("car", Color::rgb(0.05, 0.06, 0.09), 0.3, 1.0);
    b.hang("car", block(Vec3::new(-2.1, 0.3, -0.85), Vec3::new(2.1, 0.85, 0.85)), paint, car);
    b.hang("cabin", block(Vec3::new(-1.5, 0.85, -0.75), Vec3::new(0.7, 1.42, 0.75)), paint, car);
    // Low beam: about 25 000 cd from 120 cm²; tail lamps 8 cd from 100 cm².
    let head = glow(&mut b, "headlamps", 4000.0, 4e5, true);
    let tail = b.0.materials.len() as u32;
    let red = EmissionColor::Constant(diopter_light::Spectrum::light_from_rgb(Vec3::new(3800.0, 60.0, 30.0)));
    let emission = Emission { radiance: red, two_sided: false, is_light: true, modulation: Default::default() };
    b.material(Material { emission: Some(emission), ..Material::new("tail lamps", Scattering::Black) });
    for z in [-0.62f32, 0.5] {
        b.hang("headlamp", block(Vec3::new(2.1, 0.6, z), Vec3::new(2.11, 0.7, z + 0.12)), head, car);
        b.hang("tail lamp", block(Vec3::new(-2.11, 0.62, z - 0.05), Vec3::new(-2.1, 0.7, z + 0.13)), tail, car);
    }
    // To the north, as high as the latitude.
    let (s, c) = LATITUDE_DEG.to_radians().sin_cos();
    let pole = Vec3::new(0.0, s, -c);
    let sky = b.node("sky", None, Parts::IDENTITY);
    for (k, (magnitude, count)) in STARS.into_iter().enumerate() {
        let solid_angle = (STAR / SKY).powi(2);
        let luminance = 2.54e-6 * 10f32.powf(-0.4 * magnitude) / solid_angle;
        // From blue to orange.
        let kelvin = [9500.0, 7500.0, 11_000.0, 6500.0, 8500.0, 5500.0, 7000.0][k];
        let material = glow(&mut b, "stars", kelvin, luminance, false);
        b.hang("stars", stars(k as u32 + 1, count), material, sky);
    }
    b.animate("drive", vec![slide(car, Vec3::new(-60.0, 0.0, 1.8), Vec3::new(60.0, 0.0, 1.8), 12.0)]);
    // The sky goes from east to west: anti-clockwise about the pole as seen from below.
    b.animate("sky", vec![spin(sky, -pole, SIDEREAL_DAY_S)]);
    b.0.environment = Some(Environment::uniform(Vec3::new(0.8e-3, 1.0e-3, 1.5e-3)));
    b.0
}

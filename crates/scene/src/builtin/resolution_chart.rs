//! A black-and-white chart of what optics and demosaicing find hard: a zone plate, a Siemens star, sweeps of lines, slanted edges, thin lines.
//!
//! Parallel D65 light, 1000 lx; dark 3 %, light 90 %. Fine patterns are drawn with the coverage of the texture's pixels, 3072 across the chart.

use super::Framing;
use super::pattern::paint;
use crate::light::punctual::{Punctual, PunctualKind};
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Shape};
use crate::shape::Quad;
use crate::texture::{Color, Texture};
use diopter_light::Spectrum;
use diopter_light::cie::illuminant;
use diopter_light::color::luminance;
use diopter_light::spectrum::Table;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// lx
const ILLUMINANCE: f64 = 1000.0;
/// Size of the chart, m, and of its texture, px.
const SIZE: Vec2 = Vec2::new(0.30, 0.20);
const PIXELS: [usize; 2] = [3072, 2048];
/// Reflectances.
const DARK: f32 = 0.03;
const LIGHT: f32 = 0.90;

/// The chart fills the picture.
pub const FRAMING: Framing =
    Framing { look_from: Vec3::new(0.0, 0.0, 0.94), look_at: Vec3::ZERO, focal_length_mm: 100.0, f_number: 8.0, focus_m: 0.94 };

/// The chart.
pub fn description() -> Description {
    let image = paint(PIXELS[0], PIXELS[1], |p| Vec3::splat(DARK + (LIGHT - DARK) * tone(p * SIZE / SIZE.y)));
    let color = Color::Textured { factor: Vec3::ONE, texture: Texture::color(image) };
    let direction = Vec3::new(0.0, -1.0, -1.0).normalize();
    let light = illuminant("D65").unwrap_or_else(|| unreachable!("D65 is embedded"));
    let scale = (ILLUMINANCE / luminance(|nm| light.at(nm))) as f32 / -direction.z;
    let power = Table::new(380.0, 1.0, (380..=780).map(|nm| light.at(nm as f32) * scale).collect());
    // A texture's rows run downwards: so does the quad.
    let corner = Vec3::new(-0.5 * SIZE.x, 0.5 * SIZE.y, 0.0);
    Description {
        name: "resolution-chart".into(),
        materials: vec![Material::new("chart", Scattering::Diffuse(color))],
        objects: vec![Object::new("chart", Shape::Quad(Quad { corner, edges: [Vec3::X * SIZE.x, -Vec3::Y * SIZE.y] }), 0)],
        punctual: vec![Punctual::new("lamp", Spectrum::Table(power), PunctualKind::Directional { direction })],
        ..Default::default()
    }
}

/// 0 dark to 1 light at a place: x 0 to 1.5, y 0 to 1.
fn tone(p: Vec2) -> f32 {
    let wave = |phase: f32| 0.5 + 0.5 * (TAU * phase).cos();
    // Drawn edges are a texture's pixel wide.
    let edge = |distance: f32| (0.5 + distance * PIXELS[1] as f32).clamp(0.0, 1.0);
    let inside = |low: Vec2, high: Vec2| p.cmpge(low).all() && p.cmplt(high).all();
    if inside(Vec2::new(0.04, 0.04), Vec2::new(0.60, 0.60)) {
        // A zone plate: at its edge 330 periods in the height of the picture.
        let r2 = (p - Vec2::new(0.32, 0.32)).length_squared();
        return wave(0.5 * r2 * 330.0 / 0.28);
    }
    let star = p - Vec2::new(0.90, 0.32);
    if star.length() < 0.28 {
        let phase = 36.0 * star.y.atan2(star.x) / TAU;
        // Sides of the sectors as sharp as a pixel.
        let to_side = (TAU * phase).cos() / (TAU * 36.0) * TAU * star.length();
        return edge(to_side);
    }
    if inside(Vec2::new(1.22, 0.04), Vec2::new(1.33, 0.60)) {
        // Lines that get finer downwards, 40 to 480 periods in the height of the picture; the sum of frequencies is the phase.
        let t = (p.y - 0.04) / 0.56;
        return wave(0.56 * (40.0 * t + 220.0 * t * t));
    }
    if inside(Vec2::new(1.36, 0.04), Vec2::new(1.47, 0.60)) {
        // Upright lines, ever finer from block to block.
        let block = ((p.y - 0.04) / 0.08).floor();
        return wave((p.x - 1.36) * (60.0 + 70.0 * block));
    }
    for (k, angle) in [5.0f32, 20.0, 45.0, 70.0].into_iter().enumerate() {
        let middle = Vec2::new(0.15 + 0.25 * k as f32, 0.80);
        if (p - middle).abs().max_element() < 0.10 {
            // Slanted edges, dark on the right.
            let (sin, cos) = angle.to_radians().sin_cos();
            return edge(-(p - middle).dot(Vec2::new(cos, sin)));
        }
    }
    if inside(Vec2::new(1.05, 0.66), Vec2::new(1.47, 0.96)) {
        // Thin dark lines fanning out from a point.
        let q = p - Vec2::new(1.05, 0.81);
        let nearest = (-6..=6).map(|k| {
            let (sin, cos) = (k as f32 * 3.2f32).to_radians().sin_cos();
            (q.x * sin - q.y * cos).abs()
        });
        return edge(nearest.fold(f32::MAX, f32::min) - 0.0012);
    }
    0.75
}

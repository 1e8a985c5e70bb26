//! A chart of the 24 ColorChecker patches, by their measured reflectances, in parallel light of a standard illuminant.
//!
//! The light falls at 45° and makes 1000 lx on the chart: every patch gets the same, so that a patch of reflectance ρ(λ) has
//! just the radiance ρ E(λ) / π.

use super::Framing;
use crate::light::punctual::{Punctual, PunctualKind};
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Shape};
use crate::shape::Quad;
use crate::texture::Color;
use diopter_light::Spectrum;
use diopter_light::cie::{colorchecker, illuminant};
use diopter_light::color::luminance;
use diopter_light::spectrum::Table;
use glam::Vec3;

/// lx
const ILLUMINANCE: f64 = 1000.0;
/// Side of a patch and distance between two, m.
const PATCH: f32 = 0.04;
const STEP: f32 = 0.044;

/// The chart fills most of the picture.
pub const FRAMING: Framing =
    Framing { look_from: Vec3::new(0.0, 0.0, 0.95), look_at: Vec3::ZERO, focal_length_mm: 100.0, f_number: 8.0, focus_m: 0.95 };

/// The chart under an illuminant of `cie::illuminant`, named `name`; `None` for an unknown illuminant.
pub fn description(name: &str, light: &str) -> Option<Description> {
    let light = illuminant(light)?;
    let direction = Vec3::new(0.0, -1.0, -1.0).normalize();
    // On the chart, whose normal is +Z.
    let visible = |nm: f32| if (380.0..=780.0).contains(&nm) { light.at(nm) } else { 0.0 };
    let scale = (ILLUMINANCE / luminance(visible)) as f32 / -direction.z;
    let power = Table::new(380.0, 1.0, (380..=780).map(|nm| light.at(nm as f32) * scale).collect());
    let patches = colorchecker();
    let mut materials: Vec<Material> = patches
        .iter()
        .map(|p| Material::new(&p.name, Scattering::Diffuse(Color::spectrum(Spectrum::Table(p.reflectance.clone())))))
        .collect();
    materials.push(Material::new("frame", Scattering::Diffuse(Color::spectrum(Spectrum::Constant(0.03)))));
    let quad = |x: f32, y: f32, z: f32, width: f32, height: f32| {
        Shape::Quad(Quad { corner: Vec3::new(x, y, z), edges: [Vec3::X * width, Vec3::Y * height] })
    };
    let mut objects: Vec<Object> = patches
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let (x, y) = (STEP * ((i % 6) as f32 - 2.5), STEP * (1.5 - (i / 6) as f32));
            Object::new(p.name.clone(), quad(x - PATCH / 2.0, y - PATCH / 2.0, 0.0, PATCH, PATCH), i as u32)
        })
        .collect();
    objects.push(Object::new("frame", quad(-0.145, -0.1, -0.001, 0.29, 0.2), patches.len() as u32));
    Some(Description {
        name: name.into(),
        materials,
        objects,
        punctual: vec![Punctual::new("lamp", Spectrum::Table(power), PunctualKind::Directional { direction })],
        ..Default::default()
    })
}

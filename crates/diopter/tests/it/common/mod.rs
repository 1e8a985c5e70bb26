//! Cards with patterns before an even sky, and lenses to take them with.

pub mod generated;

use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Iris, Lens, ThinLens, embedded};
use diopter::light::units::Millimeters;
use diopter::metering::K;
use diopter::scene::light::Environment;
use diopter::scene::material::{Material, Scattering};
use diopter::scene::shape::Quad;
use diopter::scene::texture::{Color, Image, Texture};
use diopter::scene::{Description, Object, Scene, Shape};
use glam::Vec3;
use std::sync::{Arc, OnceLock};

/// Film that they are taken on, mm.
pub const FILM: [f64; 2] = [36.0, 24.0];
/// Reflectance of a card without detail.
const GREY: f32 = 0.4;

/// What is on a card.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Detail of all sizes.
    Rough,
    /// Squares.
    Checker,
    /// Rectangles of all sizes and greys, like a shelf of books.
    Shelf,
    /// Disks of all sizes and greys, like leaves.
    Leaves,
    /// Vertical lines at equal distances.
    Lines,
    /// Nothing.
    Wall,
}

fn hash(x: u32, y: u32, seed: u32) -> f32 {
    let mut h = x.wrapping_mul(0x85eb_ca6b) ^ y.wrapping_mul(0xc2b2_ae35) ^ seed.wrapping_mul(0x27d4_eb2f);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297a_2d39);
    (h ^ h >> 15) as f32 / u32::MAX as f32
}

/// Linear reflectance as sRGB code.
fn code(v: f32) -> u8 {
    let v = v.clamp(0.0, 1.0);
    let c = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (c * 255.0 + 0.5) as u8
}

const TEXELS: usize = 2048;

fn tone(pattern: Pattern, x: usize, y: usize) -> f32 {
    let (x, y) = (x as u32, y as u32);
    match pattern {
        Pattern::Wall => GREY,
        Pattern::Checker => {
            if (x / 24 + y / 24) % 2 == 0 {
                0.1
            } else {
                0.7
            }
        }
        Pattern::Lines => {
            if x / 12 % 2 == 0 {
                0.1
            } else {
                0.7
            }
        }
        Pattern::Rough => (0..7).map(|k| (hash(x >> k, y >> k, k) - 0.5) * 0.16 * 1.15f32.powi(k as i32)).sum::<f32>() + GREY,
        Pattern::Leaves => {
            // In cells of a disk each, three sizes over each other, the largest below.
            let mut tone = GREY;
            for size in [96u32, 48, 20] {
                let (cx, cy) = (x / size, y / size);
                let centre = [hash(cx, cy, size), hash(cx, cy, size + 1)].map(|h| 0.3 + 0.4 * h);
                let off = (x as f32 / size as f32 - cx as f32 - centre[0]).hypot(y as f32 / size as f32 - cy as f32 - centre[1]);
                if off < 0.3 && hash(cx, cy, size + 2) > 0.3 {
                    tone = 0.06 + 0.7 * hash(cx, cy, size + 3);
                }
            }
            tone
        }
        Pattern::Shelf => {
            let row = y / 90;
            let (mut left, mut k) = (0.0, 0);
            while left <= x as f32 {
                left += 5.0 + 40.0 * hash(k, row, 3).powi(2);
                k += 1;
            }
            0.05 + 0.8 * hash(k, row, 5)
        }
    }
}

/// Each pattern is painted once a process: that takes longer than focusing on it.
fn texture(pattern: Pattern) -> Texture {
    static PAINTED: [OnceLock<Arc<Image>>; 6] = [const { OnceLock::new() }; 6];
    let paint = || {
        let pixel = |i: usize| {
            let grey = code(tone(pattern, i % TEXELS, i / TEXELS));
            [grey, grey, grey, 255]
        };
        Arc::new(Image::new(TEXELS, TEXELS, (0..TEXELS * TEXELS).map(pixel).collect()))
    };
    Texture::color(PAINTED[pattern as usize].get_or_init(paint).clone())
}

/// Cards: pattern, distance (m), piece of the picture that they cover (−1 to 1 across and up; left, right, bottom, top).
pub fn cards(cards: &[(Pattern, f64, [f32; 4])], ev100: f64, focal_mm: f64) -> Scene {
    let luminance = K * ev100.exp2() / 100.0;
    // An even sky of luminance L makes a matte card of reflectance ρ as bright as ρ L.
    let sky = luminance as f32 / GREY;
    let mut d = Description { environment: Some(Environment::uniform(Vec3::splat(sky))), ..Default::default() };
    for (i, (pattern, distance, [left, right, bottom, top])) in cards.iter().enumerate() {
        let half = (0.5 * FILM[0] / focal_mm * distance) as f32;
        let color = Color::Textured { factor: Vec3::ONE, texture: texture(*pattern) };
        d.materials.push(Material::new(&format!("card {i}"), Scattering::Diffuse(color)));
        let corner = Vec3::new(left * half, top * half, -distance as f32);
        let edges = [Vec3::X * (right - left) * half, Vec3::NEG_Y * (top - bottom) * half];
        d.objects.push(Object::new(format!("card {i}"), Shape::Quad(Quad { corner, edges }), i as u32));
    }
    Scene::build(d).unwrap()
}

/// A thin lens of 50 mm or one by name.
pub fn lens(name: &str, f_number: f64, focus: Focus) -> Lens {
    match name {
        "thin" => Lens::Thin(ThinLens::new(Millimeters(50.0), f_number, Iris::Round, focus).unwrap()),
        name => {
            let setting = Setting { focal_length: None, f_number: Some(f_number), focus, iris: None, film_mm: FILM };
            Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()))
        }
    }
}

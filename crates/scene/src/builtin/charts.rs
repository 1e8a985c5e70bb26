//! Charts for laboratories: slanted edges, a grid of dots, a flat field, a step wedge. For `diopter measure`.
//!
//! Each but the last is a board of 4 × 4 m, so that it fills the picture of a wide lens at 1 m, in parallel D65 light of 1000 lx from the front: every place gets the
//! same, and nothing casts a visible shadow.

use super::Framing;
use super::builder::Builder;
use super::pattern::paint;
use crate::light::punctual::{Punctual, PunctualKind};
use crate::material::{Emission, EmissionColor, Material, Scattering};
use crate::scene::Description;
use crate::texture::{Color, Texture};
use diopter_light::Spectrum;
use diopter_light::cie::illuminant;
use diopter_light::color::luminance;
use diopter_light::spectrum::Table;
use glam::{Affine2, Vec2, Vec3};

/// lx
const ILLUMINANCE: f64 = 1000.0;
/// Half of a side of the boards, m.
const HALF: f32 = 2.0;
/// Reflectances of light and dark: a ratio of 4:1, as ISO 12233:2023 asks for e-SFR, which keeps sharpening and clipping out.
const LIGHT: f32 = 0.72;
const DARK: f32 = 0.18;

/// Distance of the slanted squares' middles and their side, m; their turn, degrees (ISO 12233: about 5).
pub const SQUARE_STEP: f32 = 0.1;
/// See [`SQUARE_STEP`].
pub const SQUARE: f32 = 0.06;
/// See [`SQUARE_STEP`].
pub const SLANT_DEG: f32 = 5.0;
/// How far the squares stand before the board, m.
const GAP: f32 = 1e-4;

/// Distance of the dots' middles and their radius, m.
pub const DOT_STEP: f32 = 0.02;
/// See [`DOT_STEP`].
pub const DOT_RADIUS: f32 = 0.005;

/// The boards are seen from 1 m.
pub const FRAMING: Framing =
    Framing { look_from: Vec3::new(0.0, 0.0, 1.0), look_at: Vec3::ZERO, focal_length_mm: 50.0, f_number: 8.0, focus_m: 1.0 };

/// A light board of a colour, and its light.
fn board(name: &str, color: Color) -> Builder {
    let mut b = Builder(Description { name: name.into(), ..Default::default() });
    let material = b.material(Material::new("board", Scattering::Diffuse(color)));
    // A texture's rows run downwards: so does the quad.
    b.quad("board", Vec3::new(-HALF, HALF, 0.0), [Vec3::X * 2.0 * HALF, Vec3::NEG_Y * 2.0 * HALF], material);
    let light = illuminant("D65").unwrap_or_else(|| unreachable!("D65 is embedded"));
    let visible = |nm: f32| if (380.0..=780.0).contains(&nm) { light.at(nm) } else { 0.0 };
    let scale = (ILLUMINANCE / luminance(visible)) as f32;
    let power = Table::new(380.0, 1.0, (380..=780).map(|nm| light.at(nm as f32) * scale).collect());
    let kind = PunctualKind::Directional { direction: Vec3::NEG_Z };
    b.0.punctual.push(Punctual::new("lamp", Spectrum::Table(power), kind));
    b
}

/// An even white board.
pub fn flat_field() -> Description {
    board("flat-field", Color::spectrum(Spectrum::Constant(LIGHT))).0
}

/// Dark squares, turned by 5°, on a light board: edges of geometry, as sharp as they can be seen.
pub fn slanted_edges() -> Description {
    let mut b = board("slanted-edges", Color::spectrum(Spectrum::Constant(LIGHT)));
    let dark = b.material(Material::new("dark", Scattering::Diffuse(Color::spectrum(Spectrum::Constant(DARK)))));
    let (sin, cos) = SLANT_DEG.to_radians().sin_cos();
    let (right, down) = (Vec3::new(cos, -sin, 0.0) * SQUARE, Vec3::new(-sin, -cos, 0.0) * SQUARE);
    let count = (HALF / SQUARE_STEP) as i32 - 1;
    for row in -count..=count {
        for column in -count..=count {
            let middle = Vec3::new(column as f32 * SQUARE_STEP, row as f32 * SQUARE_STEP, GAP);
            b.quad("square", middle - 0.5 * (right + down), [right, down], dark);
        }
    }
    b.0
}

/// Side of the black spot of [`glare_spot`], m.
pub const SPOT: f32 = 0.05;

/// A black square on a light board: what light is in its image, the lens has scattered there.
pub fn glare_spot() -> Description {
    let mut b = board("glare-spot", Color::spectrum(Spectrum::Constant(LIGHT)));
    let black = b.material(Material::new("black", Scattering::Diffuse(Color::spectrum(Spectrum::Constant(0.0)))));
    b.quad("spot", Vec3::new(-0.5 * SPOT, 0.5 * SPOT, GAP), [Vec3::X * SPOT, Vec3::NEG_Y * SPOT], black);
    b.0
}

/// Columns and rows of the fields of [`step_wedge`].
pub const WEDGE_GRID: [usize; 2] = [5, 4];
/// By how much each field is denser than the one before, log₁₀.
pub const WEDGE_DENSITY: f64 = 0.25;
/// Luminance of its clear field, cd/m².
pub const WEDGE_LUMINANCE: f64 = 4000.0;
/// Distance of the fields' middles and their side, m.
pub const WEDGE_STEP: f32 = 0.11;
/// See [`WEDGE_STEP`].
pub const WEDGE_FIELD: f32 = 0.1;

/// Twenty fields of a transparency before an even light box (D65): density 0 in the upper left to 4.75 in the lower right, row by row, in black. As the charts of
/// ISO 14524 and ISO 15739 it is for the tone response and the noise; its contrast of 56 000 : 1 (15.8 stops) is more than a paper print's.
pub fn step_wedge() -> Description {
    let mut b = Builder(Description { name: "step-wedge".into(), ..Default::default() });
    let light = illuminant("D65").unwrap_or_else(|| unreachable!("D65 is embedded"));
    let visible = |nm: f32| if (380.0..=780.0).contains(&nm) { light.at(nm) } else { 0.0 };
    let clear = WEDGE_LUMINANCE / luminance(visible);
    let [columns, rows] = WEDGE_GRID;
    for k in 0..columns * rows {
        let scale = (clear * 10f64.powf(-WEDGE_DENSITY * k as f64)) as f32;
        let radiance = Table::new(380.0, 1.0, (380..=780).map(|nm| light.at(nm as f32) * scale).collect());
        let name = format!("density {:.2}", WEDGE_DENSITY * k as f64);
        // Nothing is lit by it: all else is black.
        let emission = Emission {
            radiance: EmissionColor::Constant(Spectrum::Table(radiance)),
            two_sided: false,
            is_light: false,
            modulation: Default::default(),
        };
        let material = b.material(Material { emission: Some(emission), ..Material::new(&name, Scattering::Black) });
        let middle = [(k % columns) as f32 - 0.5 * (columns - 1) as f32, 0.5 * (rows - 1) as f32 - (k / columns) as f32];
        let [x, y] = middle.map(|m| m * WEDGE_STEP - 0.5 * WEDGE_FIELD);
        b.quad(&name, Vec3::new(x, y, 0.0), [Vec3::X * WEDGE_FIELD, Vec3::Y * WEDGE_FIELD], material);
    }
    b.0
}

/// Dark dots on a light board, in rows and columns.
pub fn dot_grid() -> Description {
    // One dot, repeated: 128 pixels of 0.16 mm, its edge one of them wide.
    const SIDE: usize = 128;
    let image = paint(SIDE, SIDE, |p| {
        let distance = DOT_RADIUS / DOT_STEP - (p - Vec2::splat(0.5)).length();
        Vec3::splat(LIGHT + (DARK - LIGHT) * (0.5 + distance * SIDE as f32).clamp(0.0, 1.0))
    });
    let repeats = 2.0 * HALF / DOT_STEP;
    let texture = Texture { image_from_uv: Affine2::from_scale(Vec2::splat(repeats)), ..Texture::color(image) };
    board("dot-grid", Color::Textured { factor: Vec3::ONE, texture }).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;

    #[test]
    fn squares_are_slanted_and_do_not_touch() {
        let d = slanted_edges();
        let squares = d.objects.iter().filter(|o| o.name == "square").count();
        assert_eq!(squares, 39 * 39);
        let Shape::Quad(quad) = &d.objects[1].shape else { panic!("a quad") };
        let [right, down] = quad.edges;
        assert!((right.y.atan2(right.x).to_degrees() + SLANT_DEG).abs() < 1e-3 && right.dot(down).abs() < 1e-6);
        assert!((right.length() - SQUARE).abs() < 1e-6 && SQUARE * 1.5f32.sqrt() < SQUARE_STEP);
        // Towards the camera, as the board.
        let Shape::Quad(board) = &d.objects[0].shape else { panic!("a quad") };
        assert!(right.cross(down).z * board.edges[0].cross(board.edges[1]).z > 0.0);
    }
}

//! The first photograph: a still life on a table, with depth, glass, metal, china, fruit, and small lights behind that show
//! what the lens does to points.
//!
//! Metres. Luminances are those of real things: a bright window 5000 cd/m², frosted
//! globes of 2.5 to 4 cm with 1300–2200 cd/m².

use super::builder::Builder;
use super::lathe::{ring, smooth, turn};
use super::{Framing, pattern};
use crate::light::Environment;
use crate::material::{Material, Scattering};
use crate::medium::Medium;
use crate::scene::Description;
use crate::texture::{Color, Texture};
use diopter_light::random::{mix, to_unit};
use diopter_light::spectrum::blackbody_with_luminance;
use diopter_light::upsample::Sigmoid;
use glam::{Affine2, Quat, Vec2, Vec3};

/// A 50 mm lens, wide open but for half a stop, focused on the glass.
pub const FRAMING: Framing = Framing {
    look_from: Vec3::new(0.05, 0.23, 0.86),
    look_at: Vec3::new(0.0, 0.075, 0.0),
    focal_length_mm: 50.0,
    f_number: 2.0,
    focus_m: 0.83,
};

fn textured(image: std::sync::Arc<crate::texture::Image>, scale: Vec2) -> Color {
    let texture = Texture { image_from_uv: Affine2::from_scale(scale), ..Texture::color(image) };
    Color::Textured { factor: Vec3::ONE, texture }
}

/// The scene.
pub fn description() -> Description {
    let mut b = Builder(Description { name: "still-life".into(), ..Default::default() });
    table(&mut b);
    things(&mut b);
    lights(&mut b);
    b.0
}

fn table(b: &mut Builder) {
    let wood = b.glossy("walnut", textured(pattern::wood(), Vec2::new(1.6, 1.6)), 0.42, 0.0);
    b.quad("table", Vec3::new(-1.2, 0.0, 0.9), [Vec3::new(2.4, 0.0, 0.0), Vec3::new(0.0, 0.0, -1.9)], wood);
    let wall = b.material(Material::new("wall", Scattering::Diffuse(Color::rgb(0.10, 0.16, 0.20))));
    b.quad("wall", Vec3::new(-4.0, -1.0, -3.6), [Vec3::new(8.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0)], wall);
    let linen = b.glossy("linen", textured(pattern::linen(), Vec2::ONE), 0.9, 0.0);
    // A folded cloth: three layers.
    for (i, (x, z, w, d, turn)) in [(0.13, 0.07, 0.26, 0.20, 0.18f32), (0.135, 0.065, 0.24, 0.185, 0.14)].into_iter().enumerate()
    {
        let y = 0.004 + 0.005 * i as f32;
        let (ex, ez) = (Vec3::new(turn.cos(), 0.0, -turn.sin()), Vec3::new(-turn.sin(), 0.0, -turn.cos()));
        let corner = Vec3::new(x, y, z) - ex * w / 2.0 - ez * d / 2.0;
        b.quad("cloth", corner, [ex * w, ez * d], linen);
        let down = Vec3::NEG_Y * 0.005;
        b.quad("cloth edge", corner, [down, ex * w], linen);
        b.quad("cloth edge", corner + ex * w, [down, ez * d], linen);
    }
}

fn things(b: &mut Builder) {
    let v = Vec2::new;
    // A wine glass: outside up, over the rim, inside down. Walls of 1 to 1.5 mm.
    let mut profile = vec![v(0.0, 0.0), v(0.033, 0.0)];
    profile.extend(smooth(
        &[
            v(0.0335, 0.0012),
            v(0.030, 0.0026),
            v(0.012, 0.0055),
            v(0.0046, 0.013),
            v(0.0040, 0.040),
            v(0.0046, 0.068),
            v(0.013, 0.078),
            v(0.031, 0.098),
            v(0.0375, 0.122),
            v(0.0355, 0.148),
            v(0.031, 0.168),
        ],
        10,
    ));
    profile.extend(smooth(
        &[
            v(0.0303, 0.1685),
            v(0.0296, 0.168),
            v(0.0341, 0.148),
            v(0.0361, 0.122),
            v(0.0297, 0.099),
            v(0.0117, 0.0805),
            v(0.0, 0.0775),
        ],
        10,
    ));
    let glass = b.mesh(turn(&profile, 128));
    let clear = b.material(Material::glass("glass", 1.52, None));
    b.place("wine glass", glass, clear, Vec3::new(-0.036, 0.0004, 0.005), Quat::IDENTITY);

    // A vase of china.
    let profile = smooth(
        &[
            v(0.0, 0.003),
            v(0.024, 0.0),
            v(0.028, 0.004),
            v(0.029, 0.012),
            v(0.045, 0.050),
            v(0.054, 0.092),
            v(0.044, 0.130),
            v(0.022, 0.155),
            v(0.017, 0.175),
            v(0.022, 0.196),
            v(0.0235, 0.199),
            v(0.021, 0.197),
            v(0.0145, 0.175),
            v(0.012, 0.14),
        ],
        12,
    );
    let vase = b.mesh(turn(&profile, 128));
    let china = b.glossy("china", textured(pattern::china(), Vec2::ONE), 0.35, 1.0);
    b.place("vase", vase, china, Vec3::new(-0.150, 0.0004, -0.085), Quat::from_rotation_y(0.6));

    // A copper cup with a rolled rim.
    let profile = smooth(
        &[
            v(0.0, 0.001),
            v(0.026, 0.0),
            v(0.029, 0.003),
            v(0.031, 0.02),
            v(0.037, 0.062),
            v(0.0385, 0.066),
            v(0.037, 0.0675),
            v(0.0355, 0.066),
            v(0.030, 0.022),
            v(0.027, 0.006),
            v(0.0, 0.005),
        ],
        10,
    );
    let cup = b.mesh(turn(&profile, 96));
    let copper = b.metal("copper", 0.02);
    b.place("copper cup", cup, copper, Vec3::new(0.125, 0.0004, -0.10), Quat::IDENTITY);

    // Fruit on the cloth.
    let peel = b.glossy("orange", textured(pattern::peel(), Vec2::ONE), 0.38, 0.0);
    b.sphere("orange", Vec3::new(0.118, 0.0485, 0.045), 0.0385, peel);
    b.sphere("orange", Vec3::new(0.188, 0.0460, 0.080), 0.0365, peel);
    let plum = b.glossy("plum", Color::rgb(0.09, 0.012, 0.05), 0.28, 0.4);
    for (x, z, r) in [(0.122, 0.122, 0.019), (0.088, 0.108, 0.0175)] {
        b.sphere("plum", Vec3::new(x, 0.0095 + r, z), r, plum);
    }

    // A ball of green glass, one of steel, and a gold ring in front.
    let green = Medium::tint(Sigmoid::from_rgb(Vec3::new(0.35, 0.80, 0.55)), 0.05);
    let bottle = b.material(Material::glass("green glass", 1.52, Some(green)));
    b.sphere("glass ball", Vec3::new(-0.075, 0.0285, 0.085), 0.0285, bottle);
    let steel = b.metal("chromium", 0.0);
    b.sphere("steel ball", Vec3::new(-0.135, 0.0165, 0.135), 0.0165, steel);
    let gold = b.metal("gold", 0.008);
    let band = b.mesh(ring(0.0105, 0.0016, 96));
    b.place("gold ring", band, gold, Vec3::new(-0.012, 0.0, 0.155), Quat::IDENTITY);
    b.place("gold ring", band, gold, Vec3::new(0.0035, 0.0025, 0.163), Quat::from_rotation_z(0.21));
}

fn lights(b: &mut Builder) {
    let window = b.material(Material::lamp("window", blackbody_with_luminance(6000.0, 5000.0)));
    // To the left and in front, facing the table.
    b.quad("window", Vec3::new(-1.05, 0.25, -0.15), [Vec3::new(0.0, 0.85, 0.0), Vec3::new(0.5, 0.1, 0.75)], window);
    let rim = b.material(Material::lamp("lamp", blackbody_with_luminance(3200.0, 7000.0)));
    b.quad("lamp", Vec3::new(0.75, 0.45, -0.55), [Vec3::new(0.0, 0.30, 0.0), Vec3::new(-0.20, 0.0, -0.22)], rim);
    // Strings of small lamps, far and farther.
    let warm: Vec<u32> = [(2000.0, 1_500.0), (2500.0, 2_200.0), (3200.0, 1_300.0)]
        .into_iter()
        .map(|(kelvin, nits)| b.material(Material::lamp("small lamp", blackbody_with_luminance(kelvin, nits))))
        .collect();
    let colored: Vec<u32> = [Vec3::new(1.0, 0.10, 0.05), Vec3::new(0.08, 0.30, 1.0), Vec3::new(0.10, 0.8, 0.30)]
        .into_iter()
        .map(|c| b.material(Material::lamp("coloured lamp", diopter_light::Spectrum::light_from_rgb(c * 1_600.0))))
        .collect();
    for i in 0..40u32 {
        let u = |k: u32| to_unit(mix(i * 8 + k + 1000));
        let depth = -1.0 - 2.4 * u(0);
        let spread = 0.45 + 0.36 * (0.86 - depth);
        let x = (2.0 * u(1) - 1.0) * spread;
        let y = 0.10 + (0.10 - depth * 0.17) * u(2) * 1.5;
        let material = if u(3) < 0.78 { warm[(u(4) * 3.0) as usize] } else { colored[(u(4) * 3.0) as usize] };
        b.sphere("small lamp", Vec3::new(x, y, depth), 0.0125 + 0.0085 * u(5), material);
    }
    b.0.environment = Some(Environment::uniform(Vec3::new(48.0, 60.0, 80.0)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;

    #[test]
    fn it_builds_without_a_warning() {
        let scene = Scene::build(description()).unwrap();
        assert!(scene.description().warnings.is_empty(), "{:?}", scene.description().warnings);
        assert!(scene.triangle_count() > 10_000);
        assert!(scene.lights().area.len() > 40);
    }
}

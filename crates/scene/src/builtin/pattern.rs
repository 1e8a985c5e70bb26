//! Images painted by code.

use crate::texture::Image;
use diopter_light::color::srgb_encode;
use diopter_light::random::{mix, to_unit};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Paints `width` × `height` pixels with a function of (0..1 to the right, 0..1 down) giving linear sRGB, clamped to 0..1 and stored as sRGB codes.
pub fn paint(width: usize, height: usize, color: impl Fn(Vec2) -> Vec3 + Sync) -> Arc<Image> {
    let code = |v: f32| (srgb_encode(v.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    let pixels = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let p = Vec2::new(((i % width) as f32 + 0.5) / width as f32, ((i / width) as f32 + 0.5) / height as f32);
            let c = color(p);
            [code(c.x), code(c.y), code(c.z), 255]
        })
        .collect();
    Arc::new(Image::new(width, height, pixels))
}

/// Smooth noise in −1..1 on an integer lattice, repeating after 2^`period_bits` cells.
#[inline]
fn noise(p: Vec2, period_bits: u32, seed: u32) -> f32 {
    let cell = p.floor();
    let t = p - cell;
    let t = t * t * (Vec2::splat(3.0) - t * 2.0);
    let mask = (1 << period_bits) - 1;
    let (x0, y0) = (cell.x as i32 & mask, cell.y as i32 & mask);
    let (x1, y1) = ((x0 + 1) & mask, (y0 + 1) & mask);
    let (top, bottom) = (lattice(x0, y0, x1, t.x, seed), lattice(x0, y1, x1, t.x, seed));
    top + (bottom - top) * t.y
}

#[inline]
fn lattice(x0: i32, y: i32, x1: i32, t: f32, seed: u32) -> f32 {
    let row = mix(y as u32 ^ seed.wrapping_mul(0x9e37_79b9));
    let (a, b) = (to_unit(mix(x0 as u32 ^ row)), to_unit(mix(x1 as u32 ^ row)));
    (a + (b - a) * t) * 2.0 - 1.0
}

/// Octaves of noise, each half as strong and twice as fine.
fn fractal(p: Vec2, period_bits: u32, octaves: u32, seed: u32) -> f32 {
    (0..octaves).map(|o| noise(p * (1 << o) as f32, period_bits + o, seed + o) / (1 << o) as f32).sum()
}

/// Walnut boards along x.
pub fn wood() -> Arc<Image> {
    paint(1024, 1024, |p| {
        let board = (p.y * 5.0).floor();
        let shift = to_unit(mix(board as u32 ^ 77)) * 7.0;
        let q = Vec2::new(p.x * 3.0 + shift, p.y * 40.0);
        let anisotropy = fractal(Vec2::new(q.x, q.y + fractal(q * Vec2::new(1.0, 0.1), 6, 2, 3) * 2.0), 8, 4, 11);
        let pores = fractal(Vec2::new(p.x * 24.0 + shift, p.y * 400.0), 9, 2, 5).max(0.0);
        let tone = 0.55 + 0.28 * anisotropy - 0.25 * pores + 0.25 * (to_unit(mix(board as u32 ^ 3)) - 0.5);
        let joint = ((p.y * 5.0).fract() - 0.5).abs();
        let dark = if joint > 0.492 { 0.35 } else { 1.0 };
        Vec3::new(0.16, 0.075, 0.035).lerp(Vec3::new(0.40, 0.21, 0.10), tone.clamp(0.0, 1.0)) * dark
    })
}

/// White china with cobalt bands and leaves.
pub fn china() -> Arc<Image> {
    paint(1024, 512, |p| {
        let white = Vec3::new(0.82, 0.81, 0.77);
        let cobalt = Vec3::new(0.02, 0.05, 0.30);
        // v runs down the image, from the mouth of the vase to its foot.
        let band = |at: f32, width: f32| (p.y - at).abs() < width;
        let mut blue = band(0.50, 0.006) || band(0.52, 0.002) || band(0.86, 0.008) || band(0.885, 0.002);
        // Leaves on a wavy stem between the bands.
        let around = p.x * 6.0;
        let stem = 0.68 + 0.035 * (around * std::f32::consts::TAU).sin();
        blue |= (p.y - stem).abs() < 0.003;
        for side in [-1.0, 1.0] {
            let x = (around * 4.0 + if side > 0.0 { 0.5 } else { 0.0 }).fract() - 0.5;
            let y = (p.y - stem) * side - 0.045;
            let leaf = Vec2::new(x * 0.075 - y * 0.35, y);
            blue |= (leaf.x / 0.011).powi(2) + (leaf.y / 0.036).powi(2) < 1.0;
        }
        if blue { cobalt * (0.75 + 0.25 * fractal(p * 32.0, 5, 3, 9)) + white * 0.04 } else { white }
    })
}

/// Peel of an orange: colour with small dots.
pub fn peel() -> Arc<Image> {
    paint(512, 256, |p| {
        let dots = noise(p * Vec2::new(128.0, 64.0), 7, 21).max(0.0);
        let patch = fractal(p * 8.0, 3, 3, 4);
        Vec3::new(0.82, 0.28, 0.02) * (1.0 - 0.22 * dots + 0.10 * patch)
    })
}

/// Woven linen in a check of two colours.
pub fn linen() -> Arc<Image> {
    paint(768, 768, |p| {
        let thread = (p.x * 180.0 * std::f32::consts::TAU).sin() * (p.y * 180.0 * std::f32::consts::TAU).sin();
        let wide = |x: f32| ((x * 6.0).fract() < 0.34) as u32 as f32;
        let check = 0.5 * (wide(p.x) + wide(p.y));
        let cloth = Vec3::new(0.72, 0.68, 0.60).lerp(Vec3::new(0.42, 0.05, 0.06), check);
        cloth * (0.92 + 0.08 * thread + 0.05 * fractal(p * 32.0, 5, 2, 8))
    })
}

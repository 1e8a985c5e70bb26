//! Smaller copies of a picture (a mip map), and means over the footprint of a ray: L. Williams 1983, "Pyramidal Parametrics".
//!
//! Every level is the mean of the one before over cells that tile it, so that the mean of all levels is the same, whatever the size of the picture.
//! Where the footprint is longer than wide, several places along it are looked up at the level of its width (as J. McCormack et al. 1999,
//! "Feline"): isotropic filtering blurs the ground before the horizon. A footprint below a pixel of the picture filters nothing.

use super::{Codes, Image, Interpolation, Texel, Texels, Texture, srgb_table};
use diopter_light::color::srgb_decode;
use glam::{Vec2, Vec4};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Largest number of places that are looked up along a footprint. What is longer still is point sampled along its length: more noise, no blur.
const MOST_PROBES: f32 = 8.0;

/// The levels of a picture by the meaning of its codes; each is made once, before rays ask for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Levels([OnceLock<Arc<[Image]>>; 2]);

impl Levels {
    /// All but the picture itself, the largest first; `None` until they are made.
    #[inline]
    fn get(&self, codes: Codes) -> Option<&[Image]> {
        self.0[codes as usize].get().map(|all| &**all)
    }
}

/// What a ray with a width sees of a surface at once: a parallelogram of texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Its two axes, whole lengths.
    pub axes: [Vec2; 2],
    /// The set of texture coordinates they are given in.
    pub uv_set: u32,
    /// One look-up will do, at the level of its area.
    pub is_coarse: bool,
}

impl Footprint {
    /// The same in coordinates that are these times a factor each.
    pub(super) fn scaled(&self, factor: Vec2) -> Footprint {
        Footprint { axes: self.axes.map(|a| a * factor), ..*self }
    }
}

impl Texture {
    /// Makes the levels that [`Texture::filtered`] asks for, with the threads of the current pool.
    pub(crate) fn make_levels(&self) {
        let levels = &self.image.levels.0[self.codes as usize];
        if levels.get().is_none() {
            // Not within the cell: a thread that waits for the pool there may be handed a task that wants the cell, too. Who comes second made the same.
            let _ = levels.set(smaller(&self.image, self.codes).into());
        }
    }

    /// RGBA at texture coordinates, linear: the mean over a footprint if there is one, it is larger than a pixel, and there are levels
    /// (`make_levels`); else [`Texture::at`].
    #[inline]
    pub fn filtered(&self, uv: &[Vec2; 2], footprint: Option<&Footprint>) -> Vec4 {
        match footprint {
            Some(footprint) if footprint.uv_set as usize == self.uv_set => self.mean(uv, footprint),
            _ => self.at(uv),
        }
    }

    #[inline(never)]
    fn mean(&self, uv: &[Vec2; 2], footprint: &Footprint) -> Vec4 {
        let size = Vec2::new(self.image.width as f32, self.image.height as f32);
        // In pixels of the picture, the longer axis first.
        let [mut long, mut short] = footprint.axes.map(|a| self.image_from_uv.matrix2 * a * size);
        if long.length_squared() < short.length_squared() {
            std::mem::swap(&mut long, &mut short);
        }
        let (length, width) = (long.length(), short.length());
        let p = self.image_from_uv.transform_point2(uv[self.uv_set.min(1)]);
        let Some(levels) = self.image.levels.get(self.codes).filter(|_| length > 1.0 && length.is_finite() && p.is_finite())
        else {
            return self.at(uv);
        };
        if footprint.is_coarse {
            let level = 0.5 * (length * width.max(1.0)).log2() + 0.5;
            return self.within(levels, (level as usize).min(levels.len()), p);
        }
        // Places as far from each other as the footprint is wide, but not closer than pixels are.
        let probes = (length / width.max(1.0)).round().clamp(1.0, MOST_PROBES);
        let level = width.max(1.0).log2();
        let along = long / size / probes;
        let mut sum = Vec4::ZERO;
        for k in 0..probes as u32 {
            sum += self.at_level(levels, p + along * (k as f32 + 0.5 - 0.5 * probes), level);
        }
        sum / probes
    }

    /// Between the two levels next to a number, at a place of the unit square.
    fn at_level(&self, levels: &[Image], p: Vec2, level: f32) -> Vec4 {
        let lower = level.floor().min(levels.len() as f32);
        let fraction = level - lower;
        let below = self.within(levels, lower as usize, p);
        if fraction <= 0.0 || lower as usize == levels.len() {
            return below;
        }
        below.lerp(self.within(levels, lower as usize + 1, p), fraction)
    }

    fn within(&self, levels: &[Image], level: usize, p: Vec2) -> Vec4 {
        self.sample(if level == 0 { &self.image } else { &levels[level - 1] }, p)
    }

    /// A picture at a place of the unit square.
    #[inline]
    pub(super) fn sample(&self, image: &Image, p: Vec2) -> Vec4 {
        let p = p * Vec2::new(image.width as f32, image.height as f32);
        if self.interpolation == Interpolation::Nearest {
            let column = Self::inside(self.wrap[0], p.x.floor() as i64, image.width);
            return self.texel(image, column, Self::inside(self.wrap[1], p.y.floor() as i64, image.height));
        }
        let p = p - 0.5;
        let (x, y) = (p.x.floor(), p.y.floor());
        let (fx, fy) = (p.x - x, p.y - y);
        let [left, right] = [0, 1].map(|k| Self::inside(self.wrap[0], (x as i64).saturating_add(k), image.width));
        let [above, below] = [0, 1].map(|k| Self::inside(self.wrap[1], (y as i64).saturating_add(k), image.height));
        let top = self.texel(image, left, above).lerp(self.texel(image, right, above), fx);
        let bottom = self.texel(image, left, below).lerp(self.texel(image, right, below), fx);
        top.lerp(bottom, fy)
    }
}

/// All levels of a picture but the first: each half as wide and high (rounded down), down to one pixel. Linear light, of codes in 16 bits.
fn smaller(image: &Image, codes: Codes) -> Vec<Image> {
    let mut levels: Vec<Image> = Vec::new();
    loop {
        let from = levels.last().unwrap_or(image);
        if from.width <= 1 && from.height <= 1 {
            return levels;
        }
        let next = halved(from, codes);
        levels.push(next.kept());
    }
}

/// Numbers, and by how much each counts, of what a cell of the next level covers in one direction: cell `i` of `n / 2` covers `n / (n / 2)` of `n`.
fn covered(i: usize, n: usize) -> impl Iterator<Item = (usize, f32)> {
    let m = (n / 2).max(1);
    let (start, end) = (i * n, (i + 1) * n);
    // In units of 1 / m of a pixel.
    (start / m..end.div_ceil(m)).map(move |k| {
        let overlap = end.min((k + 1) * m) - start.max(k * m);
        (k, overlap as f32 / n as f32)
    })
}

fn halved(from: &Image, codes: Codes) -> Image {
    let (width, height) = ((from.width / 2).max(1), (from.height / 2).max(1));
    // Of an odd width; the pixels of an even one pair up.
    let across: Option<Vec<Vec<(usize, f32)>>> =
        (from.width % 2 == 1).then(|| (0..width).map(|x| covered(x, from.width).collect()).collect());
    let row_of = |(row, sums): &mut (Vec<Vec4>, Vec<Vec4>), y: usize| {
        sums.clear();
        sums.resize(width, Vec4::ZERO);
        for (source, weight) in covered(y, from.height) {
            linear_row(from, codes, source, row);
            match &across {
                None => {
                    let half = 0.5 * weight;
                    for (sum, pair) in sums.iter_mut().zip(row.chunks_exact(2)) {
                        *sum += pair[0] * half + pair[1] * half;
                    }
                }
                Some(across) => {
                    for (sum, covered) in sums.iter_mut().zip(across) {
                        *sum += covered.iter().map(|(k, w)| row[*k] * (w * weight)).sum::<Vec4>();
                    }
                }
            }
        }
    };
    let wide = |v: Vec4| (v * 65535.0 + 0.5).to_array().map(|x| x as u16);
    match from.holds_numbers() {
        true => Image::linear(width, height, rows(width, height, row_of, |v| v.to_array())),
        false => Image::wide(width, height, rows(width, height, row_of, wide)),
    }
}

/// The pixels of a picture, of rows that are made in linear light: `row_of` leaves one in the second of two lists of numbers that it may keep its own in.
fn rows<T: Copy + Default + Send>(
    width: usize,
    height: usize,
    row_of: impl Fn(&mut (Vec<Vec4>, Vec<Vec4>), usize) + Sync,
    pixel: impl Fn(Vec4) -> T + Sync,
) -> Vec<T> {
    let mut pixels = vec![T::default(); width * height];
    pixels.par_chunks_mut(width).enumerate().for_each_init(Default::default, |kept, (y, to)| {
        row_of(kept, y);
        to.iter_mut().zip(&kept.1).for_each(|(to, v)| *to = pixel(*v));
    });
    pixels
}

/// A row of a picture in linear light.
fn linear_row(image: &Image, codes: Codes, row: usize, out: &mut Vec<Vec4>) {
    out.clear();
    match &image.texels {
        // A tile at a time, not a pixel.
        Texels::Paged(paged) => paged.row(row, image.width, |texel| out.push(linear(texel, codes))),
        Texels::Codes(all) => out.extend(all[row * image.width..][..image.width].iter().map(|c| linear(Texel::Codes(*c), codes))),
        Texels::Codes16(all) => {
            out.extend(all[row * image.width..][..image.width].iter().map(|c| linear(Texel::Codes16(*c), codes)))
        }
        Texels::Wide(all) => out.extend(all[row * image.width..][..image.width].iter().map(|c| linear(Texel::Wide(*c), codes))),
        Texels::Linear(all) => {
            out.extend(all[row * image.width..][..image.width].iter().map(|c| linear(Texel::Linear(*c), codes)))
        }
    }
}

/// A pixel in linear light.
#[inline]
pub(crate) fn linear(texel: Texel, codes: Codes) -> Vec4 {
    let [r, g, b, a] = match texel {
        Texel::Codes(bytes) => bytes,
        Texel::Codes16(words) => return linear16(words, codes),
        Texel::Wide(words) => return Vec4::from_array(words.map(f32::from)) * (1.0 / 65535.0),
        Texel::Linear(numbers) => return Vec4::from_array(numbers),
    };
    match codes {
        Codes::Srgb => {
            let t = srgb_table();
            Vec4::new(t[r as usize], t[g as usize], t[b as usize], a as f32 / 255.0)
        }
        Codes::Linear => Vec4::new(r as f32, g as f32, b as f32, a as f32) / 255.0,
    }
}

/// The same of codes of 16 bits; rare, and apart, since it is long.
#[inline(never)]
fn linear16(words: [u16; 4], codes: Codes) -> Vec4 {
    let [r, g, b, a] = words.map(|word| f32::from(word) * (1.0 / 65535.0));
    match codes {
        Codes::Srgb => Vec4::new(srgb_decode(r), srgb_decode(g), srgb_decode(b), a),
        Codes::Linear => Vec4::new(r, g, b, a),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::Wrap;
    use diopter_light::random::mix;

    fn noise(width: usize, height: usize) -> Image {
        Image::new(width, height, (0..(width * height) as u32).map(|i| mix(i).to_le_bytes()).collect())
    }

    fn mean_of(image: &Image, codes: Codes) -> Vec4 {
        let mut row = Vec::new();
        let mut sum = glam::DVec4::ZERO;
        for y in 0..image.height {
            linear_row(image, codes, y, &mut row);
            sum += row.iter().map(|v| v.as_dvec4()).sum::<glam::DVec4>();
        }
        (sum / (image.width * image.height) as f64).as_vec4()
    }

    #[test]
    fn all_levels_have_the_mean_of_the_picture() {
        for (width, height) in [(64, 64), (37, 5), (1, 19), (3, 2), (100, 63)] {
            for codes in [Codes::Srgb, Codes::Linear] {
                let image = noise(width, height);
                let whole = mean_of(&image, codes);
                let levels = smaller(&image, codes);
                assert_eq!(levels.len(), width.max(height).ilog2() as usize);
                assert!(levels.last().is_some_and(|l| l.width == 1 && l.height == 1));
                for level in &levels {
                    // Rounding to 16 bits, half a code a level at most.
                    let error = (mean_of(level, codes) - whole).abs().max_element();
                    assert!(
                        error < 1e-5 * levels.len() as f32,
                        "{width} × {height} at {} × {}: {error}",
                        level.width,
                        level.height
                    );
                }
            }
        }
    }

    #[test]
    fn a_footprint_below_a_pixel_changes_no_bit() {
        let texture = Texture { wrap: [Wrap::Mirror; 2], ..Texture::color(Arc::new(noise(16, 16))) };
        texture.make_levels();
        for i in 0..200u32 {
            let uv = [Vec2::new(mix(i) as f32, mix(i + 7) as f32) / 1e9; 2];
            let footprint =
                |size: f32| Footprint { axes: [Vec2::new(size, 0.0), Vec2::new(0.0, size)], uv_set: 0, is_coarse: false };
            assert_eq!(texture.filtered(&uv, Some(&footprint(0.99 / 16.0))), texture.at(&uv));
            assert_eq!(texture.filtered(&uv, Some(&Footprint { uv_set: 1, ..footprint(1.0) })), texture.at(&uv));
            assert_ne!(texture.filtered(&uv, Some(&footprint(2.0 / 16.0))), texture.at(&uv));
        }
    }

    #[test]
    fn long_footprints_are_as_sharp_across_as_they_are_thin() {
        // Stripes a pixel wide: along them nothing changes, across them they would be grey.
        let stripes = (0..64 * 64).map(|i| [if i % 2 == 0 { 255 } else { 0 }; 4]).collect();
        let texture = Texture { codes: Codes::Linear, ..Texture::color(Arc::new(Image::new(64, 64, stripes))) };
        texture.make_levels();
        let at = [Vec2::new(10.5, 20.5) / 64.0; 2];
        let axes = |x: f32, y: f32| {
            Some(Footprint { axes: [Vec2::new(x, 0.0) / 64.0, Vec2::new(0.0, y) / 64.0], uv_set: 0, is_coarse: false })
        };
        assert_eq!(texture.filtered(&at, axes(0.5, 8.0).as_ref()).x, 1.0);
        assert!((texture.filtered(&at, axes(8.0, 0.5).as_ref()).x - 0.5).abs() < 1e-4);
        assert!((texture.filtered(&at, axes(32.0, 32.0).as_ref()).x - 0.5).abs() < 1e-4);
        // Where one look-up will do it is at the level of the area: as blurred along as across. Below a pixel nothing changes.
        let coarse = |x: f32, y: f32| axes(x, y).map(|f| Footprint { is_coarse: true, ..f });
        for (x, y) in [(0.5, 8.0), (8.0, 0.5), (32.0, 32.0), (1e6, 1e6)] {
            let found = texture.filtered(&at, coarse(x, y).as_ref()).x;
            assert!((found - 0.5).abs() < 1e-4, "{x} {y}: {found}");
        }
        assert_eq!(texture.filtered(&at, coarse(0.9, 0.9).as_ref()), texture.at(&at));
    }

    #[test]
    fn footprints_average_what_they_cover() {
        // Against the mean over many points of the footprint, of a picture that is smooth at the size of a pixel.
        let wave = |i: usize, n: usize| 0.5 + 0.4 * (i as f32 / n as f32 * std::f32::consts::TAU * 3.0).sin();
        let pixels = (0..128 * 128).map(|i| [wave(i % 128, 128), wave(i / 128, 128), 0.0, 1.0]).collect();
        let texture = Texture { codes: Codes::Linear, ..Texture::color(Arc::new(Image::linear(128, 128, pixels))) };
        texture.make_levels();
        for i in 0..50u32 {
            let at = Vec2::new(mix(i) as f32, mix(!i) as f32) / u32::MAX as f32;
            let axes = [Vec2::new(0.05, 0.01), Vec2::new(-0.01, 0.03)];
            let found = texture.filtered(&[at; 2], Some(&Footprint { axes, uv_set: 0, is_coarse: false }));
            let mut mean = Vec4::ZERO;
            for k in 0..1024 {
                let [s, t] = [k % 32, k / 32].map(|k| (k as f32 + 0.5) / 32.0 - 0.5);
                mean += texture.at(&[at + axes[0] * s + axes[1] * t; 2]) / 1024.0;
            }
            // Levels are squares next to each other, four of them mixed: of waves 43 pixels long, a footprint of 6 × 4 differs by some per cent.
            assert!((found - mean).abs().max_element() < 0.03, "{found} {mean}");
        }
    }

    #[test]
    fn levels_of_pictures_on_the_disk_are_the_same() {
        let there = noise(130, 70);
        let paged = Image {
            texels: Texels::Paged(Arc::new(super::super::Paged::new(&there.texels, 130, 70, None).unwrap())),
            ..noise(130, 70)
        };
        for (a, b) in smaller(&there, Codes::Srgb).iter().zip(&smaller(&paged, Codes::Srgb)) {
            assert!((0..a.width * a.height).all(|i| a.texel(i % a.width, i / a.width) == b.texel(i % a.width, i / a.width)));
        }
        // And a level that is on the disk itself.
        let level = smaller(&there, Codes::Srgb).swap_remove(0);
        let texels = Texels::Paged(Arc::new(super::super::Paged::new(&level.texels, level.width, level.height, None).unwrap()));
        let away = Image { texels, ..level.clone() };
        assert!((0..level.width).all(|x| away.texel(x, 3) == level.texel(x, 3)));
    }
}

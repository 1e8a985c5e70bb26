//! Focus stacking: a focus series becomes one picture that is sharp all over.
//!
//! Pictures are brought to one scale, because a lens that is focused nearer draws larger; then each level of a Laplacian pyramid takes its
//! detail from the picture that has most of it there, and the coarsest level the mean weighted by the detail beneath. Sources: P. J. Burt
//! & R. J. Kolczynski 1993, "Enhanced image capture through fusion" (ICCV 4), with the local energy of a level as salience; the pyramid is
//! that of Burt & Adelson 1983. Works on the codes of developed pictures.

use diopter_image::{Picture, Raster};
use rayon::prelude::*;

/// A stack that cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StackError {
    /// Less than two.
    #[error("a focus stack needs at least two pictures")]
    TooFew,
    /// Of different sizes.
    #[error("pictures of {found} pixels do not fit the first of {expected}: a focus stack needs pictures of one camera and size")]
    Sizes {
        /// The one that does not fit.
        found: String,
        /// The first.
        expected: String,
    },
    /// In different colour spaces or encodings.
    #[error("pictures are developed differently: a focus stack needs one colour space and encoding")]
    Encodings,
}

/// Smallest side of a pyramid's top.
const TOP: usize = 8;
/// Weights of Burt and Adelson's generating kernel.
const KERNEL: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Joins a focus series. `scale` says how large each picture is drawn relative to the first (its film distance over the first's). Fails with fewer than two pictures, with another number of scales
/// than pictures, and where they differ in size, space or encoding.
pub fn stack(pictures: &[Picture], scale: &[f64]) -> Result<Picture, StackError> {
    let [first, rest @ ..] = pictures else { return Err(StackError::TooFew) };
    if rest.is_empty() || scale.len() != pictures.len() {
        return Err(StackError::TooFew);
    }
    let size = |p: &Picture| (p.pixels.width, p.pixels.height);
    let text = |(w, h): (usize, usize)| format!("{w} × {h}");
    if let Some(other) = rest.iter().find(|p| size(p) != size(first)) {
        return Err(StackError::Sizes { found: text(size(other)), expected: text(size(first)) });
    }
    if rest.iter().any(|p| p.space != first.space || p.encoding != first.encoding) {
        return Err(StackError::Encodings);
    }
    // All as large as the one that sees least, so that no border is made up: pictures are only ever enlarged.
    let largest = scale.iter().copied().fold(0.0, f64::max);
    let (width, height) = size(first);
    let mut fused: Option<Vec<Fused>> = None;
    for (picture, s) in pictures.iter().zip(scale) {
        let whole = enlarged(&picture.pixels, largest / s);
        let levels = pyramid(whole);
        let last = levels.len() - 1;
        let mut saliences: Vec<Vec<f32>> = levels[..last].par_iter().map(salience).collect();
        saliences.push(match last {
            0 => vec![1.0; levels[0].width * levels[0].height],
            // The coarsest level has no detail of its own: the one beneath speaks for it.
            _ => beneath(&saliences[last - 1], &levels[last - 1], &levels[last]),
        });
        fused = Some(match fused {
            None => levels.into_iter().zip(saliences).map(|(detail, salience)| Fused { detail, salience }).collect(),
            Some(mut so_far) => {
                for (k, (level, salience)) in levels.into_iter().zip(saliences).enumerate() {
                    so_far[k].take(&level, &salience, k == last);
                }
                so_far
            }
        });
    }
    let levels: Vec<Raster<f32>> = fused.unwrap_or_default().into_iter().map(Fused::settled).collect();
    let mut pixels = collapse(levels);
    pixels.data.iter_mut().for_each(|v| *v = if v.is_finite() { *v } else { 0.0 });
    debug_assert_eq!((pixels.width, pixels.height), (width, height));
    Ok(Picture { pixels, ..first.clone() })
}

/// A level in the making: the detail chosen so far and how salient it is; of the top, weighted means.
struct Fused {
    detail: Raster<f32>,
    salience: Vec<f32>,
}

impl Fused {
    fn take(&mut self, level: &Raster<f32>, salience: &[f32], top: bool) {
        for (i, s) in salience.iter().enumerate() {
            let cell = i * 3..i * 3 + 3;
            if top {
                // A running mean by weight.
                let before = self.salience[i];
                let fraction = s / (before + s);
                for k in cell {
                    self.detail.data[k] += (level.data[k] - self.detail.data[k]) * fraction;
                }
                self.salience[i] = before + s;
            } else if *s > self.salience[i] {
                self.detail.data[cell.clone()].copy_from_slice(&level.data[cell]);
                self.salience[i] = *s;
            }
        }
    }

    fn settled(self) -> Raster<f32> {
        self.detail
    }
}

/// Laplacian pyramid: details from fine to coarse, the rest last.
fn pyramid(picture: Raster<f32>) -> Vec<Raster<f32>> {
    let mut levels = Vec::new();
    let mut at = picture;
    while at.width.min(at.height) >= 2 * TOP {
        let small = halved(&at);
        let back = doubled(&small, at.width, at.height);
        at.data.par_iter_mut().zip(&back.data).for_each(|(a, b)| *a -= b);
        levels.push(at);
        at = small;
    }
    levels.push(at);
    levels
}

fn collapse(mut levels: Vec<Raster<f32>>) -> Raster<f32> {
    let mut at = levels.pop().unwrap_or_else(|| Raster::new(0, 0, 3));
    while let Some(mut detail) = levels.pop() {
        let back = doubled(&at, detail.width, detail.height);
        detail.data.par_iter_mut().zip(&back.data).for_each(|(a, b)| *a += b);
        at = detail;
    }
    at
}

/// Energy of a level about each pixel: squares of all channels, smoothed over 5 × 5.
fn salience(level: &Raster<f32>) -> Vec<f32> {
    let (w, h) = (level.width, level.height);
    let squares: Vec<f32> = level.data.chunks_exact(3).map(|p| p.iter().map(|v| v * v).sum::<f32>() + 1e-12).collect();
    let pass = |from: &[f32], n: usize, stride: usize| -> Vec<f32> {
        (0..from.len())
            .map(|i| {
                let at = (i / stride % n) as i64;
                KERNEL
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| {
                        let to = (at + k as i64 - 2).clamp(0, n as i64 - 1);
                        weight * from[(i as i64 + (to - at) * stride as i64) as usize]
                    })
                    .sum()
            })
            .collect()
    };
    pass(&pass(&squares, w, 1), h, w)
}

/// Salience of a level for the places of the next coarser one.
fn beneath(salience: &[f32], level: &Raster<f32>, top: &Raster<f32>) -> Vec<f32> {
    let at = |x: usize, y: usize| salience[(2 * y).min(level.height - 1) * level.width + (2 * x).min(level.width - 1)];
    (0..top.width * top.height).map(|i| at(i % top.width, i / top.width)).collect()
}

/// Half as many pixels, smoothed before.
fn halved(from: &Raster<f32>) -> Raster<f32> {
    let (w, h) = (from.width.div_ceil(2), from.height.div_ceil(2));
    let mut across = Raster::<f32>::new(w, from.height, 3);
    across.data.par_chunks_mut(w * 3).enumerate().for_each(|(y, row)| {
        for (x, to) in row.chunks_exact_mut(3).enumerate() {
            for (k, weight) in KERNEL.iter().enumerate() {
                let at = (2 * x as i64 + k as i64 - 2).clamp(0, from.width as i64 - 1) as usize;
                let p = from.pixel(at, y);
                (0..3).for_each(|c| to[c] += weight * p[c]);
            }
        }
    });
    let mut out = Raster::<f32>::new(w, h, 3);
    out.data.par_chunks_mut(w * 3).enumerate().for_each(|(y, row)| {
        for (k, weight) in KERNEL.iter().enumerate() {
            let at = (2 * y as i64 + k as i64 - 2).clamp(0, from.height as i64 - 1) as usize;
            row.iter_mut().zip(&across.data[at * w * 3..(at + 1) * w * 3]).for_each(|(a, b)| *a += weight * b);
        }
    });
    out
}

/// Twice as many pixels (a size that halves to the given one), between them by the same kernel.
fn doubled(from: &Raster<f32>, width: usize, height: usize) -> Raster<f32> {
    // Even places see weights 1, 6, 1 (over 8), odd ones 4, 4.
    let taps = |i: usize, n: usize| -> [(usize, f32); 3] {
        let last = n as i64 - 1;
        let at = |k: i64| k.clamp(0, last) as usize;
        let j = (i / 2) as i64;
        match i % 2 {
            0 => [(at(j - 1), 0.125), (at(j), 0.75), (at(j + 1), 0.125)],
            _ => [(at(j), 0.5), (at(j + 1), 0.5), (at(j), 0.0)],
        }
    };
    let mut out = Raster::<f32>::new(width, height, 3);
    out.data.par_chunks_mut(width * 3).enumerate().for_each(|(y, row)| {
        for (from_y, wy) in taps(y, from.height) {
            for (x, to) in row.chunks_exact_mut(3).enumerate() {
                for (from_x, wx) in taps(x, from.width) {
                    let p = from.pixel(from_x, from_y);
                    (0..3).for_each(|c| to[c] += wx * wy * p[c]);
                }
            }
        }
    });
    out
}

/// Enlarged about its middle (Catmull-Rom between pixels; Keys 1981).
fn enlarged(from: &Raster<f32>, by: f64) -> Raster<f32> {
    if (by - 1.0).abs() < 1e-9 {
        return from.clone();
    }
    let taps = |i: usize, n: usize| -> [(usize, f32); 4] {
        let at = (i as f64 + 0.5 - 0.5 * n as f64) / by + 0.5 * n as f64 - 0.5;
        let (base, t) = (at.floor(), (at - at.floor()) as f32);
        let weights = [
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        ];
        std::array::from_fn(|k| ((base as i64 + k as i64 - 1).clamp(0, n as i64 - 1) as usize, weights[k]))
    };
    let across: Vec<[(usize, f32); 4]> = (0..from.width).map(|x| taps(x, from.width)).collect();
    let mut out = Raster::<f32>::new(from.width, from.height, 3);
    out.data.par_chunks_mut(from.width * 3).enumerate().for_each(|(y, row)| {
        for (from_y, wy) in taps(y, from.height) {
            for (to, taps) in row.chunks_exact_mut(3).zip(&across) {
                for (from_x, wx) in taps {
                    let p = from.pixel(*from_x, from_y);
                    (0..3).for_each(|c| to[c] += wx * wy * p[c]);
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::Encoding;
    use diopter_light::color::RgbSpace;

    fn picture(f: impl Fn(f64, f64) -> f64) -> Picture {
        let (width, height) = (96, 64);
        let mut pixels = Raster::new(width, height, 3);
        for i in 0..width * height {
            let v = f((i % width) as f64 + 0.5 - 48.0, (i / width) as f64 + 0.5 - 32.0) as f32;
            pixels.data[i * 3..i * 3 + 3].fill(v);
        }
        Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Linear, facts: None }
    }

    /// Detail that is sharp left or right of the middle, the other half smooth.
    fn half(left: bool, scale: f64) -> Picture {
        picture(move |x, y| {
            let (x, y) = (x / scale, y / scale);
            let detail = 0.3 * (1.3 * x).sin() * (1.1 * y).cos();
            0.5 + if (x < 0.0) == left { detail } else { 0.1 * detail }
        })
    }

    #[test]
    fn the_sharp_parts_of_all_are_kept() {
        for scale in [1.0f64, 1.04] {
            let whole = half(true, scale.max(1.0));
            let other = half(false, scale.max(1.0));
            let out = stack(&[half(true, scale), half(false, 1.0)], &[scale, 1.0]).unwrap();
            let mut worst: f32 = 0.0;
            for y in 8..56 {
                for x in (8..40).chain(56..88) {
                    let expected = if x < 48 { &whole } else { &other };
                    worst = worst.max((out.pixels.pixel(x, y)[0] - expected.pixels.pixel(x, y)[0]).abs());
                }
            }
            assert!(worst < 0.05, "{scale}: {worst}");
        }
    }

    #[test]
    fn a_pyramid_gives_back_what_it_is_made_of() {
        let p = half(true, 1.0).pixels;
        let back = collapse(pyramid(p.clone()));
        assert!(p.data.iter().zip(&back.data).all(|(a, b)| (a - b).abs() < 1e-5));
        let odd = Raster { width: 37, height: 53, channels: 3, data: (0..37 * 53 * 3).map(|i| (i % 17) as f32).collect() };
        assert!(odd.data.iter().zip(&collapse(pyramid(odd.clone())).data).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert_eq!(stack(&[half(true, 1.0)], &[1.0]), Err(StackError::TooFew));
        let small = Picture { pixels: Raster::new(4, 4, 3), ..half(true, 1.0) };
        assert!(matches!(stack(&[half(true, 1.0), small], &[1.0; 2]), Err(StackError::Sizes { .. })));
    }
}

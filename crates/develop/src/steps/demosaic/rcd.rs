//! Bayer by ratio-corrected interpolation: fast, and kind to stars and fine noise.
//!
//! Source: the description of Ratio Corrected Demosaicing, Luis Sanz Rodríguez 2017, release 2.3.

use super::Mosaic;
use crate::region::Region;

/// Red and blue at a green pixel: 3 to a diagonal estimate, 3 more to a green one, 4 more to what that looks at.
pub const REACH: usize = 12;

/// Keeps quotients finite.
const EPS: f32 = 1e-5;

/// Below this the ratio of low-pass values says nothing: noise about black.
const DARK: f32 = 1e-3;

/// Red, green and blue of the pixels of `region`, `[channel][row × column]`, from a mosaic that reaches [`REACH`] further on each side.
pub fn run(mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
    let (w, h) = (mosaic.region.width, mosaic.region.height);
    let c = &mosaic.data;
    let straight = directions(c, w, h, 1, w);
    let diagonal = directions(c, w, h, w - 1, w + 1);
    let low = low_pass(c, w, h);
    let mut planes = [c.clone(), c.clone(), c.clone()];
    // Green at red and blue: neighbours scaled by the ratio of the light here and there.
    for y in 5..h - 5 {
        for x in (5 + usize::from(mosaic.channel(5, y) == 1)..w - 5).step_by(2) {
            let i = y * w + x;
            let estimate = |s: isize| {
                let at = |k: isize| c[(i as isize + k * s) as usize];
                let gradient =
                    EPS + (at(1) - at(-1)).abs() + (at(0) - at(2)).abs() + (at(1) - at(3)).abs() + (at(2) - at(4)).abs();
                let (here, there) = (low[i].max(0.0), low[(i as isize + 2 * s) as usize].max(0.0));
                (gradient, at(1) * (1.0 + (here - there) / (DARK + here + there)))
            };
            let w = w as isize;
            let v = opposed(estimate(-w), estimate(w));
            let h = opposed(estimate(-1), estimate(1));
            planes[1][i] = v + disc(&straight, i, w as usize) * (h - v);
        }
    }
    // Red at blue, blue at red: differences along the diagonals.
    let green = planes[1].clone();
    for y in 8..h - 8 {
        for x in (8 + usize::from(mosaic.channel(8, y) == 1)..w - 8).step_by(2) {
            let i = y * w + x;
            let other = 2 - mosaic.channel(x, y);
            let estimate = |s: isize| {
                let at = |k: isize| (i as isize + k * s) as usize;
                let gradient = EPS + (c[at(1)] - c[at(-1)]).abs() + (c[at(1)] - c[at(3)]).abs() + (green[i] - green[at(2)]).abs();
                (gradient, c[at(1)] - green[at(1)])
            };
            let w = w as isize;
            let p = opposed(estimate(-w - 1), estimate(w + 1));
            let q = opposed(estimate(-w + 1), estimate(w - 1));
            planes[other][i] = green[i] + p + disc(&diagonal, i, w as usize) * (q - p);
        }
    }
    // Both at green: differences up, down, left and right.
    for other in [0, 2] {
        let plane = &planes[other];
        let mut filled = plane.clone();
        for y in 11..h - 11 {
            for x in (11 + usize::from(mosaic.channel(11, y) != 1)..w - 11).step_by(2) {
                let i = y * w + x;
                let estimate = |s: isize| {
                    let at = |k: isize| (i as isize + k * s) as usize;
                    let gradient = EPS
                        + (green[i] - green[at(2)]).abs()
                        + (plane[at(1)] - plane[at(-1)]).abs()
                        + (plane[at(1)] - plane[at(3)]).abs();
                    (gradient, plane[at(1)] - green[at(1)])
                };
                let w = w as isize;
                let v = opposed(estimate(-w), estimate(w));
                let h = opposed(estimate(-1), estimate(1));
                filled[i] = green[i] + v + disc(&straight, i, w as usize) * (h - v);
            }
        }
        planes[other] = filled;
    }
    planes.iter().map(|p| crate::region::cut(p, mosaic.region, region)).collect()
}

/// Two estimates, each counting as much as the other side changes.
fn opposed((ga, a): (f32, f32), (gb, b): (f32, f32)) -> f32 {
    (gb * a + ga * b) / (ga + gb)
}

/// The fraction of a direction here, or around where that is more decided.
fn disc(fraction: &[f32], i: usize, w: usize) -> f32 {
    let around = 0.25 * (fraction[i - w - 1] + fraction[i - w + 1] + fraction[i + w - 1] + fraction[i + w + 1]);
    if (0.5 - fraction[i]).abs() < (0.5 - around).abs() { around } else { fraction[i] }
}

/// How much of the high frequencies lies across the second of two directions, 0 to 1: 1 where the first (`a`) is smooth.
fn directions(c: &[f32], w: usize, h: usize, a: usize, b: usize) -> Vec<f32> {
    let high = |s: usize| {
        let mut to = vec![0.0f32; w * h];
        for i in 4 * w..(h - 4) * w {
            let v = c[i - 3 * s] - c[i - s] - c[i + s] + c[i + 3 * s] - 3.0 * (c[i - 2 * s] + c[i + 2 * s]) + 6.0 * c[i];
            to[i] = v * v;
        }
        to
    };
    let (along_a, along_b) = (high(a), high(b));
    let mut fraction = vec![0.5f32; w * h];
    for i in 5 * w..(h - 5) * w {
        let sum = |p: &[f32], s: usize| 1e-10f32.max(p[i - s] + p[i] + p[i + s]);
        let (sa, sb) = (sum(&along_a, a), sum(&along_b, b));
        fraction[i] = sb / (sa + sb);
    }
    fraction
}

/// 1 2 1 both ways: the light of all colours about a pixel.
fn low_pass(c: &[f32], w: usize, h: usize) -> Vec<f32> {
    let mut low = vec![0.0f32; w * h];
    for i in w + 1..(h - 1) * w - 1 {
        low[i] = 0.25 * c[i]
            + 0.125 * (c[i - 1] + c[i + 1] + c[i - w] + c[i + w])
            + 0.0625 * (c[i - w - 1] + c[i - w + 1] + c[i + w - 1] + c[i + w + 1]);
    }
    low
}

//! Bayer by directional colour differences, mixed by their own gradients: no direction is decided, none has to be undone.
//!
//! Source: Pekkucuksen & Altunbasak 2010, "Gradient based threshold free color filter array interpolation" (ICIP); the decaying weights of
//! a difference along its direction from Kiku, Monno, Tanaka & Okutomi 2014, "Minimized-Laplacian residual interpolation" (SPIE 9023).

use super::Mosaic;
use crate::region::Region;

/// Estimates reach 6 pixels around a red or blue pixel; red and blue are made of those up to 3 away from it, and once more beside it.
pub const REACH: usize = 12;

/// Weights of the difference here and 1 to 4 pixels further in one direction.
const ALONG: [f32; 5] = [0.56, 0.35, 0.08, 0.01, 0.0];

/// Keeps weights finite where nothing changes: the square of a hundred-thousandth of saturation, for 25 gradients.
const LEAST: f32 = 1e-9;

/// Red, green and blue of the pixels of `region`, `[channel][row × column]`, from a mosaic that reaches [`REACH`] further on each side.
pub fn run(mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
    let (w, h) = (mosaic.region.width, mosaic.region.height);
    let c = &mosaic.data;
    let [across, down] = differences(c, w, h, |y| mosaic.channel(0, y) == 1);
    let [steps_across, steps_down] = gradients(&across, &down, w, h);
    let mut green = c.clone();
    // Green minus the own colour, at red and blue pixels.
    let mut difference = vec![0.0f32; w * h];
    // How much of the horizontal direction there is at each pixel.
    let mut level = vec![0.5f32; w * h];
    for y in 6..h.saturating_sub(6) {
        let row = y * w;
        for x in 6..w - 6 {
            let i = row + x;
            let (west, east) = (steps_across[i - 2], steps_across[i + 2]);
            let (north, south) = (steps_down[i - 2 * w], steps_down[i + 2 * w]);
            let weight = |s: f32| 1.0 / (s * s + LEAST);
            let (nw, sw, ww, ew) = (weight(north), weight(south), weight(west), weight(east));
            let mut sums = [0.0f32; 4];
            for (k, a) in ALONG[..4].iter().enumerate() {
                sums[0] += a * down[i - k * w];
                sums[1] += a * down[i + k * w];
                sums[2] += a * across[i - k];
                sums[3] += a * across[i + k];
            }
            let total = nw + sw + ww + ew;
            difference[i] = (nw * sums[0] + sw * sums[1] + ww * sums[2] + ew * sums[3]) / total;
            level[i] = (ww + ew) / total;
        }
    }
    for y in 6..h.saturating_sub(6) {
        for x in (6 + offset(mosaic, y, 6)..w - 6).step_by(2) {
            green[y * w + x] += difference[y * w + x];
        }
    }
    others(mosaic, region, &green, &difference, &level)
}

/// 0 where the pixel (x, y) is red or blue, 1 where its right neighbour is.
fn offset(mosaic: &Mosaic, y: usize, x: usize) -> usize {
    usize::from(mosaic.channel(x, y) == 1)
}

/// Green minus red (or blue) of each pixel, from the line across and from the line down.
fn differences(c: &[f32], w: usize, h: usize, begins_green: impl Fn(usize) -> bool) -> [Vec<f32>; 2] {
    let mut across = vec![0.0f32; w * h];
    let mut down = vec![0.0f32; w * h];
    // The signs of a row that begins with green: green is known there, the other colour beside it.
    let mut signs = vec![-1.0f32; w + 1];
    signs.iter_mut().skip(1).step_by(2).for_each(|s| *s = 1.0);
    for y in 2..h.saturating_sub(2) {
        let signs = if begins_green(y) { &signs[..w] } else { &signs[1..=w] };
        let line = |dy: usize| &c[(y + dy - 2) * w..(y + dy - 1) * w];
        let [n2, n1, own, s1, s2] = std::array::from_fn(line);
        for x in 2..w - 2 {
            across[y * w + x] = signs[x] * (0.5 * (own[x - 1] + own[x + 1]) - 0.25 * (own[x - 2] + own[x + 2]) - 0.5 * own[x]);
            down[y * w + x] = signs[x] * (0.5 * (n1[x] + s1[x]) - 0.25 * (n2[x] + s2[x]) - 0.5 * own[x]);
        }
    }
    [across, down]
}

/// Sums over 5 × 5 pixels of the steps of the differences in their own direction.
fn gradients(across: &[f32], down: &[f32], w: usize, h: usize) -> [Vec<f32>; 2] {
    let mut steps = [vec![0.0f32; w * h], vec![0.0f32; w * h]];
    for y in 1..h.saturating_sub(1) {
        for x in 1..w - 1 {
            let i = y * w + x;
            steps[0][i] = (across[i - 1] - across[i + 1]).abs();
            steps[1][i] = (down[i - w] - down[i + w]).abs();
        }
    }
    steps.map(|s| {
        let mut rows = vec![0.0f32; w * h];
        for y in 2..h.saturating_sub(2) {
            for x in 0..w {
                let i = y * w + x;
                rows[i] = s[i - 2 * w] + s[i - w] + s[i] + s[i + w] + s[i + 2 * w];
            }
        }
        let mut boxes = vec![0.0f32; w * h];
        for i in 2..w * h - 2 {
            boxes[i] = rows[i - 2] + rows[i - 1] + rows[i] + rows[i + 1] + rows[i + 2];
        }
        boxes
    })
}

/// Red and blue from green and the differences.
fn others(mosaic: &Mosaic, region: Region, green: &[f32], difference: &[f32], level: &[f32]) -> Vec<Vec<f32>> {
    let (w, h) = (mosaic.region.width, mosaic.region.height);
    // At red pixels the difference to blue, and the other way round: from the diagonals.
    let mut crossed = vec![0.0f32; w * h];
    for y in 10..h - 10 {
        for x in (10 + offset(mosaic, y, 10)..w - 10).step_by(2) {
            let d = |dx: isize, dy: isize| difference[((y as isize + dy) * w as isize + x as isize + dx) as usize];
            let near = d(-1, -1) + d(1, -1) + d(-1, 1) + d(1, 1);
            let far = d(-3, -1) + d(-3, 1) + d(3, -1) + d(3, 1) + d(-1, -3) + d(1, -3) + d(-1, 3) + d(1, 3);
            crossed[y * w + x] = (10.0 * near - far) / 32.0;
        }
    }
    let mut planes = vec![vec![0.0; region.area()]; 3];
    let (ox, oy) = ((region.left - mosaic.region.left) as usize, (region.top - mosaic.region.top) as usize);
    for row in 0..region.height {
        let y = oy + row;
        for column in 0..region.width {
            let x = ox + column;
            let (i, to) = (y * w + x, row * region.width + column);
            let own = mosaic.channel(x, y);
            planes[1][to] = green[i];
            if own != 1 {
                planes[own][to] = mosaic.data[i];
                planes[2 - own][to] = green[i] - crossed[i];
            } else {
                // Beside green: one colour is known left and right, and made above and below; the other the other way round.
                let fraction = level[i];
                let beside = mosaic.channel(x + 1, y);
                let mean = |plane: &[f32], step: usize| 0.5 * (plane[i - step] + plane[i + step]);
                planes[beside][to] = green[i] - fraction * mean(difference, 1) - (1.0 - fraction) * mean(&crossed, w);
                planes[2 - beside][to] = green[i] - fraction * mean(&crossed, 1) - (1.0 - fraction) * mean(difference, w);
            }
        }
    }
    planes
}

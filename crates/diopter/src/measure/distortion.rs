//! Distortion, from the picture of a grid of dots.
//!
//! Dots are found as islands on the other side of a local threshold, their centroids weighed by how far they stand out. From the dot nearest to the
//! middle they are counted along two directions, each neighbour looked for where the last step leads. What a lens without distortion would show
//! is an affine picture of that grid; with the observed place p (from the middle of the picture, over half of its diagonal) the fit
//!
//!   t + i u + j v = p (1 + c₁ |p|² + c₂ |p|⁴ + c₃ |p|⁶)
//!
//! is linear in all unknowns. Distortion is (observed − ideal height) / ideal height, ISO 17850:2015's local geometric distortion; TV distortion
//! how much nearer a straight line along the upper side of the picture comes to the middle of the picture in its corners than in its centre, over
//! the height of the picture, its shorter side. The film must be parallel to the chart: perspective would count as distortion of its own, and shows as residual.

use super::fit::least_squares;
use super::{MeasureError, Plane};
use serde::Serialize;
use std::collections::HashMap;

/// Least number of dots: 8 unknowns of each axis, and something to spare.
const LEAST_DOTS: usize = 25;
/// How far from where it is expected a dot may be, of the distance between dots.
const LEAST_MATCH: f64 = 0.3;
/// Root mean square of what the fit leaves, of the half diagonal, beyond which the dots are no regular grid.
const MOST_RESIDUAL: f64 = 0.003;

/// A dot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dot {
    /// Column and row in the grid, from the dot nearest to the middle of the picture.
    pub index: [i32; 2],
    /// Centroid, pixels (the middle of the upper left pixel is 0.5, 0.5).
    pub place: [f64; 2],
}

/// What a lens does to straight lines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Distortion {
    /// The dots of the grid.
    pub dots: Vec<Dot>,
    /// c₁, c₂, c₃: ideal height = observed height · (1 + c₁ r² + c₂ r⁴ + c₃ r⁶), r the observed height over half of the diagonal.
    pub coefficients: [f64; 3],
    /// Largest height of a dot, over half of the diagonal: beyond it the polynomial is extrapolated.
    pub largest_height: f64,
    /// Root mean square of what the fit leaves, pixels.
    pub residual_px: f64,
    /// TV distortion, %; negative for barrels.
    pub tv_percent: f64,
}

impl Distortion {
    /// Ideal over observed height at an observed height (over half of the diagonal).
    fn ratio(&self, height: f64) -> f64 {
        let r2 = height * height;
        self.coefficients.iter().rev().fold(0.0, |sum, c| (sum + c) * r2) + 1.0
    }

    /// Distortion at an observed image height (over half of the diagonal), %; negative for barrels.
    pub fn percent(&self, height: f64) -> f64 {
        100.0 * (1.0 / self.ratio(height) - 1.0)
    }
}

/// Measures the picture of a grid of dots, dark on light or light on dark. Fails below 64 pixels a side, with fewer than 25 dots on a grid, and where they deviate from a
/// regular one by 0.3 % of the half diagonal.
pub fn measure(plane: &Plane) -> Result<Distortion, MeasureError> {
    plane.check(plane.whole(), 64)?;
    let expected = || "a grid of dots that fills the picture (\"dot-grid\"), at least 5 × 5 of them, each 4 pixels wide or more";
    let found = islands(plane);
    if found.len() < LEAST_DOTS {
        return Err(MeasureError::unfit("picture", format!("{} dots found", found.len()), expected()));
    }
    let middle = [0.5 * plane.width as f64, 0.5 * plane.height as f64];
    let dots = count(&found, middle).unwrap_or_default();
    if dots.len() < LEAST_DOTS {
        let what = format!("{} of {} dots lie on a grid", dots.len(), found.len());
        return Err(MeasureError::unfit("picture", what, expected()));
    }
    let half = middle[0].hypot(middle[1]);
    let relative: Vec<([f64; 2], [f64; 2])> = {
        let most = dots.iter().flat_map(|d| d.index).map(|i| f64::from(i.abs())).fold(1.0, f64::max);
        dots.iter()
            .map(|d| ([0, 1].map(|k| f64::from(d.index[k]) / most), [0, 1].map(|k| (d.place[k] - middle[k]) / half)))
            .collect()
    };
    // Unknowns: t, u, v of x; of y; then the coefficients, on the side of the grid with the other sign.
    let row = |axis: usize, index: [f64; 2], p: [f64; 2]| {
        let r2 = p[0] * p[0] + p[1] * p[1];
        let mut row = vec![0.0; 9];
        row[3 * axis..3 * axis + 3].copy_from_slice(&[1.0, index[0], index[1]]);
        (0..3).for_each(|k| row[6 + k] = -p[axis] * r2.powi(k as i32 + 1));
        (row, p[axis])
    };
    let rows = || relative.iter().flat_map(|(index, p)| [0, 1].map(|axis| row(axis, *index, *p)));
    let Some(c) = least_squares(rows(), 9) else {
        return Err(MeasureError::unfit("picture", "its dots do not determine a grid", expected()));
    };
    let squares = rows().map(|(row, p)| (row.iter().zip(&c).map(|(a, b)| a * b).sum::<f64>() - p).powi(2)).sum::<f64>();
    let residual = (squares / relative.len() as f64).sqrt();
    if !(residual < MOST_RESIDUAL) {
        let what = format!("dots deviate by {:.1} pixels from a regular grid", residual * half);
        return Err(MeasureError::unfit("picture", what, "a regular grid, parallel to the film"));
    }
    let largest_height = relative.iter().map(|(_, p)| p[0].hypot(p[1])).fold(0.0, f64::max);
    let coefficients = [c[6], c[7], c[8]];
    let mut found = Distortion { dots, coefficients, largest_height, residual_px: residual * half, tv_percent: 0.0 };
    // The straight line that the longer side of the picture touches in its centre, and where it meets the others.
    let [x, y] = [middle[0].max(middle[1]), middle[0].min(middle[1])].map(|v| v / half);
    let ideal = y * found.ratio(y);
    let (mut low, mut high) = (0.0, 2.0 * y);
    for _ in 0..60 {
        let at = 0.5 * (low + high);
        if at * found.ratio(f64::hypot(x, at)) < ideal { low = at } else { high = at }
    }
    found.tv_percent = 100.0 * (low - y) / (2.0 * y);
    Ok(found)
}

/// Centroids of the islands that stand out from their surroundings, pixels.
fn islands(plane: &Plane) -> Vec<[f64; 2]> {
    let (width, height) = (plane.width, plane.height);
    let filled = filled(plane);
    // Middle of the brightest and the darkest in blocks, and of their neighbours: brightness changes slowly over the picture.
    let block = (width.min(height) / 16).max(8);
    let [columns, rows] = [width.div_ceil(block), height.div_ceil(block)];
    let mut ranges = vec![[f64::MAX, f64::MIN]; columns * rows];
    for (i, v) in filled.iter().enumerate() {
        let range = &mut ranges[(i / width / block) * columns + i % width / block];
        *range = [range[0].min(*v), range[1].max(*v)];
    }
    let around = |c: usize, r: usize| {
        let mut range = [f64::MAX, f64::MIN];
        for y in r.saturating_sub(2)..(r + 3).min(rows) {
            for x in c.saturating_sub(2)..(c + 3).min(columns) {
                let other = ranges[y * columns + x];
                range = [range[0].min(other[0]), range[1].max(other[1])];
            }
        }
        range
    };
    let limits: Vec<[f64; 2]> = (0..columns * rows).map(|i| around(i % columns, i / columns)).collect();
    let limit = |i: usize| limits[(i / width / block) * columns + i % width / block];
    let is_light: Vec<bool> = (0..width * height).map(|i| filled[i] > 0.5 * (limit(i)[0] + limit(i)[1])).collect();
    // Dots take less room than what is between them.
    let light_dots = 2 * is_light.iter().filter(|l| **l).count() < is_light.len();
    let mut seen = vec![false; width * height];
    let mut dots = Vec::new();
    for start in 0..width * height {
        if seen[start] || is_light[start] != light_dots {
            continue;
        }
        let (mut open, mut island) = (vec![start], Vec::new());
        seen[start] = true;
        while let Some(i) = open.pop() {
            island.push(i);
            let (x, y) = (i % width, i / width);
            let beside = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then_some(i + 1),
                (y > 0).then(|| i - width),
                (y + 1 < height).then_some(i + width),
            ];
            for j in beside.into_iter().flatten() {
                if !seen[j] && is_light[j] == light_dots {
                    seen[j] = true;
                    open.push(j);
                }
            }
        }
        let bounds = island.iter().fold([usize::MAX, usize::MAX, 0, 0], |b, i| {
            [b[0].min(i % width), b[1].min(i / width), b[2].max(i % width), b[3].max(i / width)]
        });
        let [w, h] = [bounds[2] - bounds[0] + 1, bounds[3] - bounds[1] + 1];
        // Cut off by the picture, too small for a centroid, or no disc.
        let cut = bounds[0] == 0 || bounds[1] == 0 || bounds[2] + 1 == width || bounds[3] + 1 == height;
        let round = w.max(h) <= 2 * w.min(h) && 10 * island.len() >= 5 * w * h;
        if cut || island.len() < 9 || !round || w.max(h) > width.min(height) / 5 {
            continue;
        }
        dots.push(centroid(&filled, [width, height], bounds, light_dots));
    }
    dots
}

/// Centroid of what stands out within the bounds of a dot and some pixels around it. Light that falls off over the picture would pull it: the ground is a plane, and dark dots are what they
/// take from it.
fn centroid(values: &[f64], [width, height]: [usize; 2], b: [usize; 4], light: bool) -> [f64; 2] {
    let margin = 2 + (b[2] - b[0]).max(b[3] - b[1]) / 8;
    let [x0, y0] = [b[0].saturating_sub(margin), b[1].saturating_sub(margin)];
    let [x1, y1] = [(b[2] + margin).min(width - 1), (b[3] + margin).min(height - 1)];
    let at = |x: usize, y: usize| values[y * width + x];
    // What is around it: a plane through the frame of the rectangle, whose terms are independent of one another.
    let [x_middle, y_middle] = [(x0 + x1) as f64 / 2.0, (y0 + y1) as f64 / 2.0];
    let frame = || (x0..=x1).flat_map(|x| [[x, y0], [x, y1]]).chain((y0 + 1..y1).flat_map(|y| [[x0, y], [x1, y]]));
    let terms = frame().map(|[x, y]| (at(x, y), x as f64 - x_middle, y as f64 - y_middle));
    let [n, sum, across, down, x2, y2] =
        terms.fold([0.0; 6], |s, (v, x, y)| [s[0] + 1.0, s[1] + v, s[2] + v * x, s[3] + v * y, s[4] + x * x, s[5] + y * y]);
    let mean = sum / n;
    let ground = |x: usize, y: usize| mean + across / x2 * (x as f64 - x_middle) + down / y2 * (y as f64 - y_middle);
    let (mut sum, mut moment) = (0.0, [0.0; 2]);
    for y in y0..=y1 {
        for x in x0..=x1 {
            let (here, ground) = (at(x, y), ground(x, y));
            let out = match light {
                true => here - ground,
                false if ground > 0.0 => 1.0 - here / ground,
                false => 0.0,
            };
            sum += out;
            moment = [moment[0] + out * (x as f64 + 0.5), moment[1] + out * (y as f64 + 0.5)];
        }
    }
    moment.map(|m| m / sum)
}

/// Values at all pixels: where the channel was not sampled, the mean of the samples beside it.
fn filled(plane: &Plane) -> Vec<f64> {
    let (width, height) = (plane.width, plane.height);
    let value = |i: usize| {
        let v = f64::from(plane.values[i]);
        if !v.is_nan() {
            return v;
        }
        let (x, y) = (i % width, i / width);
        for reach in 1..=8usize {
            let (mut sum, mut count) = (0.0, 0.0);
            for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                for column in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                    let v = plane.at(column, row);
                    // Those nearest count most, and alike on both sides.
                    let distance = column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2);
                    if !v.is_nan() && distance <= reach * reach {
                        (sum, count) = (sum + v, count + 1.0);
                    }
                }
            }
            if count > 0.0 {
                return sum / count;
            }
        }
        0.0
    };
    (0..width * height).map(value).collect()
}

/// Counts dots along two directions from the one nearest to the middle.
fn count(dots: &[[f64; 2]], middle: [f64; 2]) -> Option<Vec<Dot>> {
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let nearest = |to: [f64; 2]| (0..dots.len()).min_by(|a, b| distance(dots[*a], to).total_cmp(&distance(dots[*b], to)));
    let first = nearest(middle)?;
    // The steps to its two nearest neighbours that are not in line.
    let mut others: Vec<[f64; 2]> =
        (0..dots.len()).filter(|k| *k != first).map(|k| [dots[k][0] - dots[first][0], dots[k][1] - dots[first][1]]).collect();
    others.sort_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    let a = *others.first()?;
    let b = *others.iter().find(|b| (a[0] * b[1] - a[1] * b[0]).abs() > 0.7 * a[0].hypot(a[1]) * b[0].hypot(b[1]))?;
    // The one nearer to the rows comes first; right and down are positive.
    let [mut u, mut v] = if a[0].abs() > b[0].abs() { [a, b] } else { [b, a] };
    if u[0] < 0.0 {
        u = u.map(|x| -x);
    }
    if v[1] < 0.0 {
        v = v.map(|x| -x);
    }
    let mut taken: HashMap<[i32; 2], usize> = HashMap::from([([0, 0], first)]);
    let mut used = vec![false; dots.len()];
    used[first] = true;
    // Each with the steps that hold around it.
    let mut open = std::collections::VecDeque::from([(first, [0, 0], [u, v])]);
    while let Some((dot, index, steps)) = open.pop_front() {
        for (axis, sign) in [(0, 1), (0, -1), (1, 1), (1, -1)] {
            let step = steps[axis].map(|s| s * f64::from(sign));
            let mut next = index;
            next[axis] += sign;
            if taken.contains_key(&next) {
                continue;
            }
            let wanted = [dots[dot][0] + step[0], dots[dot][1] + step[1]];
            let Some(found) = nearest(wanted).filter(|f| !used[*f]) else { continue };
            if distance(dots[found], wanted) > LEAST_MATCH * step[0].hypot(step[1]) {
                continue;
            }
            used[found] = true;
            taken.insert(next, found);
            let mut around = steps;
            around[axis] = [0, 1].map(|k| (dots[found][k] - dots[dot][k]) * f64::from(sign));
            open.push_back((found, next, around));
        }
    }
    let mut grid: Vec<Dot> = taken.into_iter().map(|(index, k)| Dot { index, place: dots[k] }).collect();
    grid.sort_by_key(|d| (d.index[1], d.index[0]));
    Some(grid)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dots of a radius of 5 pixels every 34, dark on light, moved by r (1 + k r²), and turned a little.
    fn grid(k: f64, turn: f64) -> Plane {
        let (width, height) = (480, 320);
        let half = 0.5 * 480f64.hypot(320.0);
        let (sin, cos) = turn.to_radians().sin_cos();
        let mut places = Vec::new();
        for j in -8..=8 {
            for i in -10..=10 {
                let [x, y] = [34.0 * f64::from(i) + 3.2, 34.0 * f64::from(j) - 5.1].map(|v| v / half);
                let (x, y) = (x * cos - y * sin, x * sin + y * cos);
                let scale = half * (1.0 + k * (x * x + y * y));
                places.push([x * scale + 240.0, y * scale + 160.0]);
            }
        }
        let mut values = vec![0.8f32; width * height];
        for [x, y] in places {
            for row in ((y - 8.0).max(0.0) as usize)..((y + 8.0).clamp(0.0, 320.0) as usize) {
                for column in ((x - 8.0).max(0.0) as usize)..((x + 8.0).clamp(0.0, 480.0) as usize) {
                    // Edges are a pixel wide.
                    let r = (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y);
                    values[row * width + column] -= (0.6 * (5.5 - r).clamp(0.0, 1.0)) as f32;
                }
            }
        }
        Plane { width, height, values, limits: [0.0, 1.0], clipped: None }
    }

    /// Distortion of r (1 + k r²) at an observed height, by iteration.
    fn exact(k: f64, observed: f64) -> f64 {
        let mut ideal = observed;
        (0..50).for_each(|_| ideal = observed / (1.0 + k * ideal * ideal));
        100.0 * (observed / ideal - 1.0)
    }

    #[test]
    fn the_distortion_of_a_grid_is_found() {
        for (k, turn) in [(0.0, 0.0), (-0.05, 0.0), (0.03, 2.0), (-0.02, -1.0)] {
            let found = measure(&grid(k, turn)).unwrap();
            assert!(found.dots.len() > 80 && found.residual_px < 0.1, "{} {}", found.dots.len(), found.residual_px);
            for height in [0.3, 0.6, 0.85] {
                let (percent, wanted) = (found.percent(height), exact(k, height));
                // Centroids are good to some hundredths of a pixel of the 245 at 0.85.
                assert!((percent - wanted).abs() < 0.05, "k {k} at {height}: {percent} {wanted}");
            }
            assert!(k == 0.0 || (found.tv_percent > 0.0) == (k > 0.0), "{k} {}", found.tv_percent);
        }
    }

    #[test]
    fn tv_distortion_is_how_much_the_upper_side_bends() {
        // A line of ideal height Y from the middle: observed Y (1 + k (X² + Y²)). In the centre it lies at y; at the side, X (1 + k (X² + Y²)) = x.
        let k = -0.05;
        let found = measure(&grid(k, 0.0)).unwrap();
        let half = 0.5 * 480f64.hypot(320.0);
        let (x, y) = (240.0 / half, 160.0 / half);
        let (mut ideal_y, mut ideal_x) = (y, x);
        for _ in 0..60 {
            ideal_y = y / (1.0 + k * ideal_y * ideal_y);
        }
        for _ in 0..60 {
            ideal_x = x / (1.0 + k * (ideal_x * ideal_x + ideal_y * ideal_y));
        }
        let side = ideal_y * (1.0 + k * (ideal_x * ideal_x + ideal_y * ideal_y));
        let wanted = 100.0 * (side - y) / (2.0 * y);
        assert!((found.tv_percent - wanted).abs() < 0.05, "{} {wanted}", found.tv_percent);
    }

    #[test]
    fn light_that_falls_off_moves_no_dot() {
        let mut plane = grid(-0.05, 0.0);
        for (i, v) in plane.values.iter_mut().enumerate() {
            let (x, y) = ((i % 480) as f32 + 0.5 - 240.0, (i / 480) as f32 + 0.5 - 160.0);
            *v *= 1.0 - 0.6 * (x * x + y * y) / (240.0 * 240.0 + 160.0 * 160.0);
        }
        let found = measure(&plane).unwrap();
        for height in [0.3, 0.6, 0.85] {
            assert!((found.percent(height) - exact(-0.05, height)).abs() < 0.05, "{height}: {}", found.percent(height));
        }
    }

    #[test]
    fn raw_mosaics_and_light_dots_serve_too() {
        let mut plane = grid(-0.05, 0.0);
        plane.values.iter_mut().for_each(|v| *v = 1.0 - *v);
        (0..480 * 320).filter(|i| (i % 480 + i / 480) % 2 == 0).for_each(|i| plane.values[i] = f32::NAN);
        let found = measure(&plane).unwrap();
        // Half of the pixels: a tenth of a pixel.
        assert!((found.percent(0.8) - exact(-0.05, 0.8)).abs() < 0.1, "{} {}", found.percent(0.8), exact(-0.05, 0.8));
    }

    #[test]
    fn pictures_without_a_grid_are_refused() {
        let plane = grid(0.0, 0.0);
        let even = Plane { values: vec![0.5; 480 * 320], ..plane.clone() };
        assert!(measure(&even).unwrap_err().to_string().contains("dots"));
        let few = Plane {
            values: plane.values.iter().enumerate().map(|(i, v)| if i % 480 < 420 { 0.8 } else { *v }).collect(),
            ..plane
        };
        assert!(measure(&few).is_err());
    }
}

//! Densities on the unit square that are bilinear between the nodes of a grid, and the maps of uniform numbers to them.
//!
//! A table holds one grid for each of a set of directions; between directions grids are blended linearly, densities and cumulative distributions
//! alike, so that the map stays exact. Rows are drawn first (marginal), then places within a row (conditional). Source: J. Dupuy & W. Jakob 2018,
//! "An Adaptive Parameterization for Efficient Material Acquisition and Rendering" (ACM TOG 37(6)), §4; inversion of linear densities: PBR 4ed §A.5.

use crate::exact::exact_struct;
use glam::Vec2;

/// Grids of a table and their weights, at one direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blend {
    slices: [u32; 4],
    weights: [f32; 4],
    count: usize,
}

impl Blend {
    /// The only grid.
    pub const ONE: Blend = Blend { slices: [0; 4], weights: [1.0, 0.0, 0.0, 0.0], count: 1 };

    /// Grids `[phi][theta]` around two angles; beyond the nodes those at the ends.
    pub fn new(phi_nodes: &[f32], theta_nodes: &[f32], phi: f32, theta: f32) -> Self {
        let ((i, x), (j, y)) = (interval(phi_nodes, phi), interval(theta_nodes, theta));
        let mut blend = Blend { slices: [0; 4], weights: [0.0; 4], count: 0 };
        for (a, wa) in [(i, 1.0 - x), (i + 1, x)] {
            for (b, wb) in [(j, 1.0 - y), (j + 1, y)] {
                if wa * wb > 0.0 {
                    blend.slices[blend.count] = (a * theta_nodes.len() + b) as u32;
                    blend.weights[blend.count] = wa * wb;
                    blend.count += 1;
                }
            }
        }
        blend
    }

    /// Numbers of grids, and their weights.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        self.slices[..self.count].iter().zip(&self.weights).map(|(s, w)| (*s as usize, *w))
    }
}

/// The node at or below `x` and the fraction of the way to the next; ends count beyond them.
pub(super) fn interval(nodes: &[f32], x: f32) -> (usize, f32) {
    if nodes.len() < 2 {
        return (0, 0.0);
    }
    let i = nodes.partition_point(|n| *n <= x).clamp(1, nodes.len() - 1) - 1;
    let t = (x - nodes[i]) / (nodes[i + 1] - nodes[i]);
    // What is not a number becomes the first node.
    (i, if t > 0.0 { t.min(1.0) } else { 0.0 })
}

/// Where a point of the unit square lies: column and row of the cell, and the place within it.
#[inline]
pub(super) fn cell([width, height]: [usize; 2], at: Vec2) -> ([usize; 2], Vec2) {
    let place = |x: f32, n: usize| {
        let x = x.clamp(0.0, 1.0) * (n - 1) as f32;
        let i = (x as u32 as usize).min(n - 2);
        (i, x - i as f32)
    };
    let ((column, x), (row, y)) = (place(at.x, width), place(at.y, height));
    ([column, row], Vec2::new(x, y))
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Functions on the unit square, bilinear between nodes, the first and last of which are on its border.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// Columns and rows, 2 or more each.
    pub size: [usize; 2],
    /// `[slice][row][column]`.
    pub values: Vec<f32>,
}

exact_struct!(Grid { size, values });
exact_struct!(Warp { density, conditional, marginal });

impl Grid {
    /// Whether it holds so many grids of finite numbers.
    pub fn holds(&self, slices: usize) -> bool {
        let [width, height] = self.size;
        let count = width.checked_mul(height).and_then(|n| n.checked_mul(slices));
        width >= 2 && height >= 2 && count == Some(self.values.len()) && self.values.iter().all(|v| v.is_finite())
    }

    /// Density at a point of the unit square, at parameters that are fixed.
    pub fn at(&self, point: Vec2, blend: &Blend) -> f32 {
        let ([column, row], p) = cell(self.size, point);
        let [c0, c1] = self.columns(column, row, p.y, blend);
        lerp(c0, c1, p.x)
    }

    /// Values on both sides of a cell at a height within it.
    #[inline]
    fn columns(&self, column: usize, row: usize, y: f32, blend: &Blend) -> [f32; 2] {
        let [width, height] = self.size;
        let (mut low, mut high) = ([0.0; 2], [0.0; 2]);
        for (slice, weight) in blend.iter() {
            let start = (slice * height + row) * width + column;
            for k in 0..2 {
                low[k] += weight * self.values[start + k];
                high[k] += weight * self.values[start + width + k];
            }
        }
        [0, 1].map(|k: usize| lerp(low[k], high[k], y))
    }
}

/// Densities with their maps.
#[derive(Clone, Debug)]
pub(crate) struct Warp {
    /// Densities; each slice integrates to 1.
    density: Grid,
    /// ∫ of the density along each row of nodes, from its beginning to each node.
    conditional: Vec<f32>,
    /// ∫ of that over the rows, from the first to each.
    marginal: Vec<f32>,
}

impl Warp {
    /// Densities in proportion to values, at least 0; even ones where nothing is above 0.
    pub fn new(mut density: Grid) -> Self {
        let [width, height] = density.size;
        let (dx, dy) = (1.0 / (width - 1) as f64, 1.0 / (height - 1) as f64);
        let mut conditional = vec![0.0; density.values.len()];
        let mut marginal = Vec::with_capacity(density.values.len() / width);
        for (slice, cumulative) in
            density.values.chunks_exact_mut(width * height).zip(conditional.chunks_exact_mut(width * height))
        {
            slice.iter_mut().for_each(|v| *v = v.max(0.0));
            let row_sum = |row: &[f32]| row.windows(2).map(|v| 0.5 * dx * (v[0] as f64 + v[1] as f64)).sum::<f64>();
            let rows: Vec<f64> = slice.chunks_exact(width).map(row_sum).collect();
            let total: f64 = rows.windows(2).map(|r| 0.5 * dy * (r[0] + r[1])).sum();
            match total > 0.0 && total.is_finite() {
                true => slice.iter_mut().for_each(|v| *v = (*v as f64 / total) as f32),
                false => slice.fill(1.0),
            }
            let mut below = 0.0f64;
            let mut last = None;
            for (values, sums) in slice.chunks_exact(width).zip(cumulative.chunks_exact_mut(width)) {
                let mut sum = 0.0f64;
                for i in 1..width {
                    sum += 0.5 * dx * (values[i - 1] as f64 + values[i] as f64);
                    sums[i] = sum as f32;
                }
                below += last.map_or(0.0, |last: f64| 0.5 * dy * (last + sum));
                marginal.push(below as f32);
                last = Some(sum);
            }
        }
        Warp { density, conditional, marginal }
    }

    /// Whether it holds so many densities with their maps.
    pub fn holds(&self, slices: usize) -> bool {
        let rows = self.density.size[1].checked_mul(slices);
        self.density.holds(slices)
            && self.density.values.len() == self.conditional.len()
            && rows == Some(self.marginal.len())
            && self.density.values.iter().chain(&self.conditional).chain(&self.marginal).all(|v| v.is_finite() && *v >= 0.0)
    }

    /// How many numbers it holds.
    pub fn numbers(&self) -> usize {
        self.density.values.len() + self.conditional.len() + self.marginal.len()
    }

    /// Columns and rows of nodes.
    pub fn size(&self) -> [usize; 2] {
        self.density.size
    }

    /// Density at a point.
    pub fn pdf(&self, point: Vec2, blend: &Blend) -> f32 {
        self.density.at(point, blend)
    }

    fn marginal(&self, row: usize, blend: &Blend) -> f32 {
        blend.iter().map(|(slice, weight)| weight * self.marginal[slice * self.density.size[1] + row]).sum()
    }

    /// ∫ along a row of nodes up to a column.
    fn conditional(&self, column: usize, row: usize, blend: &Blend) -> f32 {
        let [width, height] = self.density.size;
        blend.iter().map(|(slice, weight)| weight * self.conditional[(slice * height + row) * width + column]).sum()
    }

    /// The point that a pair of uniform numbers is mapped to, and its density.
    pub fn sample(&self, u: Vec2, blend: &Blend) -> (Vec2, f32) {
        let [width, height] = self.density.size;
        let (dx, dy) = (1.0 / (width - 1) as f32, 1.0 / (height - 1) as f32);
        let row = last_at_most(height - 1, u.y, |row| self.marginal(row, blend));
        let [r0, r1] = [row, row + 1].map(|row| self.conditional(width - 1, row, blend));
        let y = invert_linear(r0, r1, (u.y - self.marginal(row, blend)) / dy);

        let target = u.x * lerp(r0, r1, y);
        let along = |column: usize| lerp(self.conditional(column, row, blend), self.conditional(column, row + 1, blend), y);
        let column = last_at_most(width - 1, target, along);
        let [c0, c1] = self.density.columns(column, row, y, blend);
        let x = invert_linear(c0, c1, (target - along(column)) / dx);
        (Vec2::new((column as f32 + x) * dx, (row as f32 + y) * dy), lerp(c0, c1, x))
    }

    /// The uniform numbers that are mapped to a point, and its density: [`Warp::sample`] backwards.
    pub fn invert(&self, point: Vec2, blend: &Blend) -> (Vec2, f32) {
        let [width, height] = self.density.size;
        let (dx, dy) = (1.0 / (width - 1) as f32, 1.0 / (height - 1) as f32);
        let ([column, row], p) = cell(self.density.size, point);
        let [c0, c1] = self.density.columns(column, row, p.y, blend);
        let [r0, r1] = [row, row + 1].map(|row| self.conditional(width - 1, row, blend));
        let before = lerp(self.conditional(column, row, blend), self.conditional(column, row + 1, blend), p.y);
        let whole = lerp(r0, r1, p.y);
        let x = before + dx * p.x * (c0 + 0.5 * p.x * (c1 - c0));
        let y = self.marginal(row, blend) + dy * p.y * (r0 + 0.5 * p.y * (r1 - r0));
        let x = if whole > 0.0 { x / whole } else { 0.0 };
        (Vec2::new(x, y).clamp(Vec2::ZERO, Vec2::ONE), lerp(c0, c1, p.x))
    }
}

/// The last of `0..count` whose value (rising) is at most `at`; 0 where none is.
fn last_at_most(count: usize, at: f32, value: impl Fn(usize) -> f32) -> usize {
    let (mut low, mut high) = (0, count);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if value(middle) <= at { low = middle } else { high = middle }
    }
    low
}

/// Where in 0..1 the integral of a density that runs linearly from `a` to `b` reaches `area`; the form of the root that loses no digits.
fn invert_linear(a: f32, b: f32, area: f32) -> f32 {
    let area = area.max(0.0);
    let t = 2.0 * area / (a + (a * a + 2.0 * area * (b - a)).max(0.0).sqrt());
    // 0 / 0 where there is nothing.
    if t > 0.0 { t.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    /// Two slices of a grid of 5 × 4, one with much emptiness.
    fn warp() -> (Warp, Vec<Blend>) {
        let values = (0..40u32).map(|i| if i >= 20 && i % 3 == 0 { 0.0 } else { to_unit(mix(i)).powi(3) }).collect();
        let warp = Warp::new(Grid { size: [5, 4], values });
        let blends = [0.2, 0.5, 0.65, 0.8, 2.0].map(|t| Blend::new(&[0.0], &[0.5, 0.8], 0.0, t));
        (warp, blends.to_vec())
    }

    #[test]
    fn points_follow_the_density_and_lead_back() {
        let (warp, blends) = warp();
        for blend in &blends {
            let (n, bins) = (300, 12);
            let (mut counts, mut expected) = (vec![0.0f64; bins * bins], vec![0.0f64; bins * bins]);
            for i in 0..n * n {
                let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
                let (p, pdf) = warp.sample(u, blend);
                assert!((warp.pdf(p, blend) - pdf).abs() <= 2e-3 * (0.1 + pdf), "{p}: {pdf}");
                let (back, again) = warp.invert(p, blend);
                assert!((back - u).abs().max_element() < 2e-4 && (again - pdf).abs() <= 2e-3 * (0.1 + pdf), "{u} → {p} → {back}");
                counts[(p.y * bins as f32) as usize * bins + (p.x * bins as f32) as usize] += 1.0;
                let bin = (u.y * bins as f32) as usize * bins + (u.x * bins as f32) as usize;
                expected[bin] += f64::from(warp.pdf(u, blend));
            }
            assert!((expected.iter().sum::<f64>() / (n * n) as f64 - 1.0).abs() < 1e-3);
            // Even numbers: each bin holds what its density says, within what its border cuts.
            for (count, expected) in counts.iter().zip(&expected) {
                assert!((count - expected).abs() < 30.0 + 0.05 * expected, "{count}, {expected}");
            }
        }
    }

    #[test]
    fn nothing_becomes_an_even_density() {
        let warp = Warp::new(Grid { size: [2, 3], values: vec![0.0; 6] });
        let (p, pdf) = warp.sample(Vec2::new(0.3, 0.7), &Blend::ONE);
        assert!((p - Vec2::new(0.3, 0.7)).length() < 1e-6 && (pdf - 1.0).abs() < 1e-6);
    }
}

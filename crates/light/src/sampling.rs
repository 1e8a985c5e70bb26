//! From uniform numbers to shapes and distributions.
//!
//! Sources are named at each function; "PBR" is Pharr, Jakob & Humphreys, *Physically Based Rendering*, 4th ed.

use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Point of the unit disk by two numbers in [0, 1), uniform over its area (density 1/π), keeping neighbours together. Source: Shirley & Chiu 1997, as PBR A.5.1.
#[inline]
pub fn disk(u: [f32; 2]) -> Vec2 {
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if a == 0.0 && b == 0.0 {
        return Vec2::ZERO;
    }
    if a.abs() > b.abs() {
        let (sin, cos) = sin_cos_of_octant(PI / 4.0 * (b / a));
        Vec2::new(a * cos, a * sin)
    } else {
        let (sin, cos) = sin_cos_of_octant(PI / 4.0 * (a / b));
        Vec2::new(b * sin, b * cos)
    }
}

/// Sine and cosine of an angle between −π/4 and π/4, rad, to 1e-7: a third of the time of the library's, and the same bits everywhere.
/// Source: S. Moshier, Cephes library, `sinf.c` (minimax polynomials).
#[inline]
fn sin_cos_of_octant(x: f32) -> (f32, f32) {
    let z = x * x;
    let sin = x + x * z * (-1.666_665_5e-1 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    (sin, cos)
}

/// Unit direction about +z by two numbers in [0, 1), with density cos θ / π, 1/sr. Source: Malley's method, PBR A.5.3.
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = disk(u);
    d.extend((1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Unit direction of the whole sphere by two numbers in [0, 1); density 1/4π, 1/sr. Source: PBR A.5.2.
pub fn sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * (TAU * u[1]).cos(), r * (TAU * u[1]).sin(), z)
}

/// The unit directions x and y that make a right-handed frame x, y, `n` with a unit vector. Source: Duff et al. 2017, JCGT 6(1).
#[inline]
pub fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// A discrete distribution drawn by inversion of its cumulative sum (keeps strata of `u` together), with a guide table so that few entries are
/// looked at. Source: Chen & Asau 1974, "On generating random variates from an empirical distribution".
#[derive(Clone, Debug)]
pub struct Discrete {
    /// Cumulative probability after each entry.
    cdf: Vec<f32>,
    /// Entry of the lower end of each of equal parts of the probability; one more, the last entry.
    guide: Vec<u32>,
    total: f64,
}

impl Discrete {
    /// Probabilities proportional to `weights` (at least 0); uniform when they sum to nothing. Panics on an empty list.
    pub fn new(weights: &[f32]) -> Self {
        assert!(!weights.is_empty(), "a distribution over nothing");
        let total: f64 = weights.iter().map(|w| *w as f64).sum();
        let mut sum = 0.0;
        let n = weights.len() as f64;
        let mut cdf: Vec<f32> = weights
            .iter()
            .map(|w| {
                sum += if total > 0.0 { *w as f64 / total } else { 1.0 / n };
                sum as f32
            })
            .collect();
        *cdf.last_mut().expect("not empty") = 1.0;
        let last = cdf.len() - 1;
        let parts = cdf.len().div_ceil(ENTRIES_A_PART);
        let mut entry = 0;
        let guide = (0..=parts)
            .map(|part| {
                // A little below where the part begins, so that rounding of `u · parts` cannot begin too high.
                let u = part as f32 / parts as f32 * (1.0 - 2.0 * f32::EPSILON);
                while entry < last && cdf[entry] <= u {
                    entry += 1;
                }
                if part == parts { last as u32 } else { entry as u32 }
            })
            .collect();
        Discrete { cdf, guide, total }
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Probability of an entry. Panics on a number that is no entry's.
    #[inline]
    pub fn probability(&self, i: usize) -> f32 {
        self.cdf[i] - if i == 0 { 0.0 } else { self.cdf[i - 1] }
    }

    /// Entry that belongs to `u` in [0, 1), and `u` stretched to [0, 1) within it.
    #[inline]
    pub fn sample(&self, u: f32) -> (usize, f32) {
        let part = ((u * (self.guide.len() - 1) as f32) as u32 as usize).min(self.guide.len() - 2);
        let [low, high] = [self.guide[part] as usize, self.guide[part + 1] as usize];
        let high = (high + 1).min(self.cdf.len());
        let mut i = low + self.cdf[low..high].partition_point(|c| *c <= u);
        if i == high {
            // The next part begins a little low.
            i = (i + self.cdf[i..].partition_point(|c| *c <= u)).min(self.cdf.len() - 1);
        }
        let start = if i == 0 { 0.0 } else { self.cdf[i - 1] };
        let width = self.cdf[i] - start;
        (i, if width > 0.0 { ((u - start) / width).clamp(0.0, 0.999_999_9) } else { 0.5 })
    }
}

/// Entries of a distribution for each entry of its guide table.
const ENTRIES_A_PART: usize = 4;

/// A piecewise constant density over the unit square. Source: PBR A.5.6.
#[derive(Clone, Debug)]
pub struct Grid2 {
    rows: Vec<Discrete>,
    marginal: Discrete,
    width: usize,
}

impl Grid2 {
    /// Density proportional to `weights` (at least 0, row by row, `width` in each; what is left of the last row is not used). Panics where there is no whole row.
    pub fn new(weights: &[f32], width: usize) -> Self {
        let rows: Vec<Discrete> = weights.chunks_exact(width).map(Discrete::new).collect();
        let marginal = Discrete::new(&rows.iter().map(|r| r.total() as f32).collect::<Vec<_>>());
        Grid2 { rows, marginal, width }
    }

    /// Point (x to the right, y down the rows) of the unit square by two numbers in [0, 1), and its density; the integral over the square is 1.
    pub fn sample(&self, u: [f32; 2]) -> (Vec2, f32) {
        let (row, v) = self.marginal.sample(u[1]);
        let (column, w) = self.rows[row].sample(u[0]);
        let p = Vec2::new((column as f32 + w) / self.width as f32, (row as f32 + v) / self.rows.len() as f32);
        (p, self.density(row, column))
    }

    /// Density at a point of the unit square, the same that [`Grid2::sample`] gives; points beyond count as those of the edge.
    pub fn pdf(&self, p: Vec2) -> f32 {
        let cell = |x: f32, n: usize| ((x * n as f32).max(0.0) as usize).min(n - 1);
        self.density(cell(p.y, self.rows.len()), cell(p.x, self.width))
    }

    fn density(&self, row: usize, column: usize) -> f32 {
        self.marginal.probability(row) * self.rows[row].probability(column) * (self.width * self.rows.len()) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(n: u32) -> impl Iterator<Item = [f32; 2]> {
        (0..n).flat_map(move |i| (0..n).map(move |j| [(i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32]))
    }

    #[test]
    fn guide_tables_find_the_entries_of_bisection() {
        let hash = |i: u32| crate::random::to_unit(crate::random::mix(i));
        for n in [1usize, 2, 3, 7, 64, 1000] {
            // Smooth, spiky and mostly empty.
            for kind in 0..3 {
                let weight = |i: usize| match kind {
                    0 => 0.5 + hash(i as u32),
                    1 => hash(i as u32).powi(20),
                    _ => (i % 17 == 3) as u32 as f32,
                };
                let d = Discrete::new(&(0..n).map(weight).collect::<Vec<_>>());
                let ends = d.cdf.iter().flat_map(|c| [c.next_down(), *c, c.next_up()]).filter(|u| (0.0..1.0).contains(u));
                for u in ends.chain((0..4000).map(|i| hash(i + 77))) {
                    let expected = d.cdf.partition_point(|c| *c <= u).min(n - 1);
                    assert_eq!(d.sample(u).0, expected, "{n} {kind} {u}");
                }
            }
        }
    }

    #[test]
    fn sines_of_an_octant_are_those_of_the_library() {
        for i in -1000..=1000 {
            let x = PI / 4.0 * i as f32 / 1000.0;
            let (sin, cos) = sin_cos_of_octant(x);
            // Two units in the last place of 1.
            assert!((sin - x.sin()).abs() < 1.2e-7 && (cos - x.cos()).abs() < 1.2e-7, "{x}: {sin} {cos}");
        }
    }

    #[test]
    fn shapes_have_their_moments() {
        // ⟨r²⟩ of the unit disk is 1/2.
        let mean = |f: &dyn Fn([f32; 2]) -> f32| points(240).map(f).map(f64::from).sum::<f64>() / 57_600.0;
        assert!((mean(&|u| disk(u).length_squared()) - 0.5).abs() < 1e-3);
        assert!((mean(&|u| cosine_hemisphere(u).z) - 2.0 / 3.0).abs() < 1e-3);
        assert!(mean(&|u| sphere(u).z).abs() < 1e-3);
    }

    #[test]
    fn grid_density_integrates_to_one_and_matches_its_samples() {
        let weights: Vec<f32> = (0..48).map(|i| ((i * 37) % 11) as f32).collect();
        let grid = Grid2::new(&weights, 8);
        let integral: f64 = points(240).map(|u| grid.pdf(Vec2::from(u)) as f64).sum::<f64>() / 240.0 / 240.0;
        assert!((integral - 1.0).abs() < 1e-3, "{integral}");
        let mut counts = vec![0.0f64; 48];
        for u in points(400) {
            let (p, pdf) = grid.sample(u);
            assert!((pdf - grid.pdf(p)).abs() < 1e-3 * pdf.max(1.0), "{pdf} {}", grid.pdf(p));
            counts[(p.y * 6.0) as usize * 8 + (p.x * 8.0) as usize] += 1.0;
        }
        let total: f32 = weights.iter().sum();
        for (count, weight) in counts.iter().zip(&weights) {
            assert!((count / 160_000.0 - (weight / total) as f64).abs() < 2e-3);
        }
    }

    #[test]
    fn frames_are_orthonormal() {
        for u in points(20) {
            let n = sphere(u);
            let (t, b) = frame(n);
            assert!(t.dot(b).abs() < 1e-5 && t.dot(n).abs() < 1e-5 && (t.cross(b) - n).length() < 1e-5);
        }
    }

    #[test]
    fn nothing_to_draw_from_is_drawn_uniformly() {
        let d = Discrete::new(&[0.0, 0.0]);
        assert_eq!((d.sample(0.2).0, d.sample(0.7).0), (0, 1));
    }
}

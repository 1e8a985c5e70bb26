//! What lies beyond the table of a pattern: the light that straight and curved edges send far out.
//!
//! The transform of a polygon is a sum over its edges (J. Komrska 1982, "Simple derivation of formulas for Fraunhofer diffraction at polygonal apertures",
//! J. Opt. Soc. Am. 72(10), 1382): an edge of length ℓ and normal n contributes (w·n) ℓ sinc(ℓ w·t) / (2π |w|²) with t along the edge. Far out edges no longer
//! interfere but near the corners, and the energy of an edge is ℓ / (2π² W) beyond |w·n| = W, along both directions of n, falling as 1/w² to each side
//! of a spike that keeps its width. In all: perimeter / (2π² W · area) of the light; of a disk this is the limit of Airy's 1 − J₀² − J₁².
//! An arc sends its light along all of its normals.

use crate::Iris;
use glam::DVec2;
use std::f64::consts::{PI, TAU};

/// Angle between two edges from which they are a corner; less is taken for a curve that the polygon stands for, rad.
const CORNER: f64 = 0.25;

/// Edges of an aperture, in units of the root of its area.
#[derive(Clone, Debug)]
pub(super) struct Tail {
    edges: Vec<Edge>,
    /// Length of the edges before each one, and of all.
    before: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Edge {
    /// First angle of the outward normal, rad.
    normal: f64,
    /// How far it turns along the edge; 0 of a straight one.
    turn: f64,
    length: f64,
}

impl Tail {
    /// Of an iris; `None` of a picture, whose edges are not known.
    pub(super) fn of(iris: &Iris) -> Option<Tail> {
        let unit = PI.sqrt().recip();
        let edges = match iris {
            Iris::Image(_) => return None,
            Iris::Round => vec![Edge { normal: 0.0, turn: TAU, length: TAU * unit }],
            Iris::Blades(blades) => {
                let corners = blades.outline();
                let n = corners.len();
                let side = |i: usize| corners[(i + 1) % n] - corners[i % n];
                let corner = |i: usize| side((i + n - 1) % n).angle_to(side(i));
                let edge = |i: usize| {
                    // A curve turns half of the way to its neighbours within an edge.
                    let half = |angle: f64| if angle.abs() < CORNER { 0.5 * angle } else { 0.0 };
                    let (to, from) = (half(corner((i + 1) % n)), half(corner(i)));
                    let normal = -side(i).perp();
                    Edge { normal: normal.y.atan2(normal.x) - from, turn: from + to, length: side(i).length() * unit }
                };
                (0..n).map(edge).collect()
            }
        };
        let mut before = vec![0.0];
        for e in &edges {
            before.push(before[before.len() - 1] + e.length);
        }
        Some(Tail { edges, before })
    }

    /// Fraction of all light beyond a frequency (cycles in the root of the area).
    pub(super) fn beyond(&self, frequency: f64) -> f64 {
        let perimeter = self.before[self.edges.len()];
        (perimeter / (2.0 * PI * PI * frequency)).min(1.0)
    }

    /// A frequency beyond `from` by numbers in [0, 1): two for the edge and the distance, two for the place across the spike.
    pub(super) fn draw(&self, from: f64, [u, v]: [f32; 2], [s, t]: [f32; 2]) -> DVec2 {
        // One number chooses the edge, its place along it and the side.
        let at = 2.0 * f64::from(u);
        let side = if at < 1.0 { 1.0 } else { -1.0 };
        let along = at.fract() * self.before[self.edges.len()];
        let i = self.before.partition_point(|b| *b <= along).clamp(1, self.edges.len()) - 1;
        let edge = self.edges[i];
        let within = ((along - self.before[i]) / edge.length).clamp(0.0, 1.0);
        let distance = side * from / (1.0 - f64::from(v)).max(1e-7);
        let normal = DVec2::from_angle(edge.normal + edge.turn * within);
        match edge.turn == 0.0 {
            true => normal * distance + normal.perp() * (sinc_squared([s, t]) / edge.length),
            false => normal * distance,
        }
    }
}

/// A number of the density sinc²(x) = (sin πx / πx)²: rejection under min(1, 1/(πx)²), which accepts π/4. What four trials reject is put in the middle
/// lobe, where most of it belongs: (1 − π/4)⁴ = 0.2 %.
fn sinc_squared([mut s, mut t]: [f32; 2]) -> f64 {
    // New numbers from old ones: the lower digits, which the first trial hardly looked at.
    let next = |u: f32| (u * 613.0 + 0.377).fract();
    for _ in 0..4 {
        let u = 2.0 * f64::from(s) - 1.0;
        // Half of the envelope lies within 1/π, half beyond.
        let x = if u.abs() < 0.5 { 2.0 * u / PI } else { u.signum() / (2.0 * PI * (1.0 - u.abs()).max(1e-6)) };
        let y = PI * x;
        let ratio = if y.abs() < 1e-6 { 1.0 } else { (y.sin() / y).powi(2) / (1.0f64).min((y * y).recip()) };
        if f64::from(t) < ratio {
            return x;
        }
        (s, t) = (next(s), next(t));
    }
    0.5 * (2.0 * f64::from(s) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn numbers(i: u32) -> [[f32; 2]; 2] {
        let at = |k: u32| to_unit(mix(mix(i) ^ k.wrapping_mul(0x9e37_79b9)));
        [[at(1), at(2)], [at(3), at(4)]]
    }

    #[test]
    fn widths_across_a_spike_follow_sinc_squared() {
        // ∫ sinc² from −½ to ½ is 0.7737, from −1 to 1 0.9028 (the integral of the textbooks).
        let n = 40_000;
        let drawn: Vec<f64> = (0..n).map(|i| sinc_squared(numbers(i)[0])).collect();
        for (limit, expected) in [(0.5, 0.7737), (1.0, 0.9028), (2.0, 0.9499)] {
            let found = drawn.iter().filter(|x| x.abs() < limit).count() as f64 / f64::from(n);
            // Three standard deviations are 0.006; rejected trials add 0.002.
            assert!((found - expected).abs() < 0.009, "{limit}: {found} {expected}");
        }
    }

    #[test]
    fn a_disk_sends_out_what_airy_says() {
        // 1 − J₀² − J₁² → 2/(πv), v = 2π a w, a the radius of a disk of area 1.
        let tail = Tail::of(&Iris::Round).unwrap();
        let (w, a) = (30.0, PI.sqrt().recip());
        assert!((tail.beyond(w) / (2.0 / (PI * TAU * a * w)) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn distances_fall_with_the_square_and_lie_along_normals() {
        let tail = Tail::of(&Iris::blades(5, 0.3, 0.0).unwrap()).unwrap();
        let drawn: Vec<DVec2> = (0..20_000).map(|i| tail.draw(20.0, numbers(i)[0], numbers(i)[1])).collect();
        for limit in [40.0, 80.0, 160.0] {
            let beyond = drawn.iter().filter(|w| w.length() > limit).count() as f64 / 20_000.0;
            assert!((beyond - 20.0 / limit).abs() < 0.015, "{limit}: {beyond}");
        }
        // Ten directions, π/5 apart; the first normal half a side from the first corner.
        let first = 0.3 + PI / 5.0;
        let off = |w: &DVec2| {
            let turns = (w.y.atan2(w.x) - first).rem_euclid(PI / 5.0);
            turns.min(PI / 5.0 - turns) * w.length()
        };
        let near = drawn.iter().filter(|w| off(w) < 2.0).count();
        assert!(near > 18_000, "{near}");
    }
}

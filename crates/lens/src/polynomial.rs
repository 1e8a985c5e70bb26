//! Polynomials over the plane of a surface: departures from a conic, and phases.
//!
//! With u = x / `norm_mm`, v = y / `norm_mm`, ρ = u² + v²: Σ Aᵢ ρⁱ + Σ Bⱼₖ uʲ vᵏ + Σ Zₙ, the last over Zernike polynomials in Noll's or the fringe
//! order ([`crate::analysis::zernike`] says which is which). Values and slopes are exact.
//!
//! Zernike sums: R(r) cos mθ = P(ρ) Re (u + iv)ᵐ with P a Jacobi polynomial P⁽⁰ᵐ⁾ in 2ρ − 1 (Born & Wolf §9.2.1; DLMF 18.9.1), one three-term
//! recurrence for each m. Terms stay of the order of 1, where powers of x and y would lose all digits of f32 by degree 20.

use crate::analysis::zernike::Numbering;
use std::collections::BTreeMap;

/// Highest power of x, of y and of both together.
pub const HIGHEST_POWER: usize = 20;
/// Most coefficients of ρ.
const MOST_RADIAL: usize = 24;

/// Coefficients as they are given.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Terms {
    /// Of ρ, ρ², ...
    pub radial: Vec<f64>,
    /// Of uʲ vᵏ by (j, k).
    pub xy: BTreeMap<(usize, usize), f64>,
    /// Of Zernike polynomials in Noll's order, from the first.
    pub noll: Vec<f64>,
    /// Of Zernike polynomials in the fringe order, from the first.
    pub fringe: Vec<f64>,
}

/// Zernike polynomials of one azimuthal frequency: (Σ cₖ Pₖ) cos mθ rᵐ + (Σ sₖ Pₖ) sin mθ rᵐ.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ring {
    pub m: usize,
    /// Weights of cosine and sine, then α, β, γ of Pₖ₊₁ = (α + β ρ) Pₖ − γ Pₖ₋₁, of each k.
    pub terms: Vec<[f64; 5]>,
}

/// A polynomial over the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Polynomial {
    norm_mm: f64,
    terms: Terms,
    /// Bⱼₖ as rows of vᵏ, each over uʲ.
    rows: Vec<Vec<f64>>,
    rings: Vec<Ring>,
}

/// A value and its slopes in x and y.
pub(crate) type Local = (f64, f64, f64);

impl Polynomial {
    /// `norm_mm`: the length of u = 1. Fails on one that is not above 0 and below 10⁶, on numbers that are not finite, and on more terms or higher
    /// powers than are traced (powers: [`HIGHEST_POWER`] together).
    pub fn new(norm_mm: f64, terms: Terms) -> Result<Polynomial, String> {
        if !(norm_mm > 0.0 && norm_mm < 1e6) {
            return Err(format!("normalisation radius {norm_mm}: expected a positive length in mm"));
        }
        let all = terms.radial.iter().chain(terms.xy.values()).chain(&terms.noll).chain(&terms.fringe);
        if let Some(bad) = all.clone().find(|v| !v.is_finite()) {
            return Err(format!("coefficient {bad}: expected a number"));
        }
        if terms.radial.len() > MOST_RADIAL {
            return Err(format!("{} radial coefficients: expected at most {MOST_RADIAL}", terms.radial.len()));
        }
        if let Some((j, k)) = terms.xy.keys().find(|(j, k)| j + k > HIGHEST_POWER) {
            return Err(format!("x{j}y{k}: expected powers up to {HIGHEST_POWER} together"));
        }
        for (given, numbering) in [(&terms.noll, Numbering::Noll), (&terms.fringe, Numbering::Fringe)] {
            if given.len() > numbering.largest() {
                return Err(format!("{} Zernike coefficients: expected at most {}", given.len(), numbering.largest()));
            }
        }
        let mut rows: Vec<Vec<f64>> = vec![];
        for ((j, k), value) in terms.xy.iter().filter(|t| *t.1 != 0.0) {
            rows.resize(rows.len().max(k + 1), vec![]);
            let row = &mut rows[*k];
            row.resize(row.len().max(j + 1), 0.0);
            row[*j] = *value;
        }
        let rings = rings(&terms);
        Ok(Polynomial { norm_mm, terms, rows, rings })
    }

    /// Length of u = 1, mm.
    pub fn norm_mm(&self) -> f64 {
        self.norm_mm
    }

    /// Coefficients as they were given.
    pub fn terms(&self) -> &Terms {
        &self.terms
    }

    pub(crate) fn rows(&self) -> &[Vec<f64>] {
        &self.rows
    }

    pub(crate) fn rings(&self) -> &[Ring] {
        &self.rings
    }

    /// Whether it depends on the distance from the middle alone.
    pub fn is_rotational(&self) -> bool {
        let beside = |row: &Vec<f64>| row.iter().any(|v| *v != 0.0);
        let flat = self.rows.iter().skip(1).all(|row| !beside(row))
            && self.rows.first().is_none_or(|r| r.iter().skip(1).all(|v| *v == 0.0));
        flat && self.rings.iter().all(|r| r.m == 0)
    }

    /// Value, and slopes in x and y (1/mm of it), at a place in mm.
    #[inline]
    pub(crate) fn at(&self, x: f64, y: f64) -> Local {
        let scale = 1.0 / self.norm_mm;
        let (u, v) = (x * scale, y * scale);
        let rho = u * u + v * v;
        // Horner for Σ Aᵢ ρⁱ and its derivative by ρ.
        let (mut sum, mut by_rho) = (0.0, 0.0);
        for a in self.terms.radial.iter().rev() {
            by_rho = by_rho * rho + (sum + a);
            sum = (sum + a) * rho;
        }
        let (mut by_u, mut by_v) = (2.0 * u * by_rho, 2.0 * v * by_rho);
        let (mut rows, mut rows_u, mut rows_v) = (0.0, 0.0, 0.0);
        for row in self.rows.iter().rev() {
            let (mut value, mut slope) = (0.0, 0.0);
            for b in row.iter().rev() {
                slope = slope * u + value;
                value = value * u + b;
            }
            rows_v = rows_v * v + rows;
            rows = rows * v + value;
            rows_u = rows_u * v + slope;
        }
        (sum, by_u, by_v) = (sum + rows, by_u + rows_u, by_v + rows_v);
        // (u + iv)ᵐ and the power before it.
        let (mut power, mut before, mut m) = ([1.0, 0.0], [0.0, 0.0], 0);
        for ring in &self.rings {
            while m < ring.m {
                before = power;
                power = [u * power[0] - v * power[1], u * power[1] + v * power[0]];
                m += 1;
            }
            let ([c, s], [dc, ds]) = ring_sums(ring, rho);
            sum += c * power[0] + s * power[1];
            let along = 2.0 * (dc * power[0] + ds * power[1]);
            let turn = m as f64;
            by_u += along * u + turn * (c * before[0] + s * before[1]);
            by_v += along * v + turn * (s * before[0] - c * before[1]);
        }
        (sum, by_u * scale, by_v * scale)
    }

    /// Second derivatives in x and in y at the middle, 1/mm².
    pub(crate) fn curvatures(&self) -> [f64; 2] {
        let radial = 2.0 * self.terms.radial.first().copied().unwrap_or(0.0);
        let xy = |key| 2.0 * self.terms.xy.get(&key).copied().unwrap_or(0.0);
        let (mut x, mut y) = (radial + xy((2, 0)), radial + xy((0, 2)));
        for ring in &self.rings {
            let ([c, _], [dc, _]) = ring_sums(ring, 0.0);
            match ring.m {
                0 => (x, y) = (x + 2.0 * dc, y + 2.0 * dc),
                2 => (x, y) = (x + 2.0 * c, y - 2.0 * c),
                _ => {}
            }
        }
        let scale = 1.0 / (self.norm_mm * self.norm_mm);
        [x * scale, y * scale]
    }

    /// Coefficient of y⁴ at the middle, 1/mm⁴.
    pub(crate) fn fourth_order(&self) -> f64 {
        let radial = self.terms.radial.get(1).copied().unwrap_or(0.0);
        let xy = self.terms.xy.get(&(0, 4)).copied().unwrap_or(0.0);
        // Along y: ρ = v², and (iv)ᵐ = (−1)^(m/2) vᵐ; of P(ρ) the terms of ρ⁰ to ρ².
        let ring = |ring: &Ring| {
            let series = |most: usize| {
                let (mut p, mut before) = ([1.0, 0.0, 0.0], [0.0; 3]);
                let mut sum = [0.0; 3];
                for [c, _, a, b, g] in &ring.terms {
                    let next = std::array::from_fn(|i| a * p[i] + if i > 0 { b * p[i - 1] } else { 0.0 } - g * before[i]);
                    sum = std::array::from_fn(|i| sum[i] + c * p[i]);
                    (p, before) = (next, p);
                }
                sum[most]
            };
            match ring.m {
                0 => series(2),
                2 => -series(1),
                4 => series(0),
                _ => 0.0,
            }
        };
        (radial + xy + self.rings.iter().map(ring).sum::<f64>()) / self.norm_mm.powi(4)
    }

    /// With every coefficient times a number.
    pub(crate) fn times(&self, factor: f64) -> Polynomial {
        self.changed(|_| factor)
    }

    /// Seen after half a turn about the x axis: y changes its sign.
    pub(crate) fn turned_over(&self) -> Polynomial {
        self.changed(|odd| if odd { -1.0 } else { 1.0 })
    }

    /// With coefficients times a factor, by whether their term is odd in y.
    fn changed(&self, factor: impl Fn(bool) -> f64) -> Polynomial {
        let mut terms = self.terms.clone();
        terms.radial.iter_mut().for_each(|v| *v *= factor(false));
        terms.xy.iter_mut().for_each(|((_, k), v)| *v *= factor(k % 2 == 1));
        for (list, numbering) in [(&mut terms.noll, Numbering::Noll), (&mut terms.fringe, Numbering::Fringe)] {
            for (i, v) in list.iter_mut().enumerate() {
                // Sines are odd in y.
                *v *= factor(numbering.term(i + 1).is_some_and(|t| t.m < 0));
            }
        }
        let rings = rings(&terms);
        let mut rows = self.rows.clone();
        for (k, row) in rows.iter_mut().enumerate() {
            row.iter_mut().for_each(|v| *v *= factor(k % 2 == 1));
        }
        Polynomial { norm_mm: self.norm_mm, terms, rows, rings }
    }
}

/// Σ of a ring's cosine and sine, and their derivatives by ρ.
#[inline]
fn ring_sums(ring: &Ring, rho: f64) -> ([f64; 2], [f64; 2]) {
    let (mut p, mut before, mut dp, mut d_before) = (1.0, 0.0, 0.0, 0.0);
    let (mut sums, mut slopes) = ([0.0; 2], [0.0; 2]);
    for [c, s, a, b, g] in &ring.terms {
        sums = [sums[0] + c * p, sums[1] + s * p];
        slopes = [slopes[0] + c * dp, slopes[1] + s * dp];
        let factor = a + b * rho;
        (p, before, dp, d_before) = (factor * p - g * before, p, b * p + factor * dp - g * d_before, dp);
    }
    (sums, slopes)
}

/// Zernike coefficients sorted by azimuthal frequency.
fn rings(terms: &Terms) -> Vec<Ring> {
    let mut weights: BTreeMap<usize, Vec<[f64; 2]>> = BTreeMap::new();
    for (list, numbering) in [(&terms.noll, Numbering::Noll), (&terms.fringe, Numbering::Fringe)] {
        for (i, value) in list.iter().enumerate().filter(|t| *t.1 != 0.0) {
            let Some(term) = numbering.term(i + 1) else { continue };
            let m = term.m.unsigned_abs() as usize;
            let k = (term.n as usize - m) / 2;
            let ring = weights.entry(m).or_default();
            ring.resize(ring.len().max(k + 1), [0.0; 2]);
            ring[k][usize::from(term.m < 0)] += value * term.norm();
        }
    }
    let ring = |(m, weights): (usize, Vec<[f64; 2]>)| {
        let step = |(k, [c, s]): (usize, &[f64; 2])| {
            let [a, b, g] = jacobi(m, k);
            [*c, *s, a, b, g]
        };
        Ring { m, terms: weights.iter().enumerate().map(step).collect() }
    };
    weights.into_iter().map(ring).collect()
}

/// (α, β, γ) of Pₖ₊₁ = (α + β ρ) Pₖ − γ Pₖ₋₁ for the Jacobi polynomials P⁽⁰ᵐ⁾(2ρ − 1) (DLMF 18.9.1, 18.9.2).
fn jacobi(m: usize, k: usize) -> [f64; 3] {
    let (m, k) = (m as f64, k as f64);
    if k == 0.0 {
        return [-(m + 1.0), m + 2.0, 0.0];
    }
    let two = 2.0 * k + m;
    let common = 2.0 * (k + 1.0) * (k + m + 1.0) * two;
    let by_t = (two + 1.0) * (two + 2.0) * two / common;
    let constant = -(two + 1.0) * m * m / common;
    let before = 2.0 * k * (k + m) * (two + 2.0) / common;
    [constant - by_t, 2.0 * by_t, before]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn places() -> impl Iterator<Item = DVec2> {
        (0..60).map(|i| DVec2::from_angle(i as f64 * 0.7) * (i as f64 / 59.0))
    }

    #[test]
    fn zernike_terms_are_those_of_the_sums_of_powers() {
        for (numbering, most) in [(Numbering::Noll, 231), (Numbering::Fringe, 37)] {
            for number in 1..=most {
                let mut list = vec![0.0; number];
                list[number - 1] = 1.0;
                let terms = match numbering {
                    Numbering::Noll => Terms { noll: list, ..Terms::default() },
                    Numbering::Fringe => Terms { fringe: list, ..Terms::default() },
                };
                let p = Polynomial::new(3.0, terms).unwrap();
                let term = numbering.term(number).unwrap();
                for at in places() {
                    let expected = term.value(at);
                    // The sum of powers itself cancels: its coefficients add up to (1 + √2)ⁿ in magnitude (Legendre polynomials at 3), each rounded.
                    let room = 1e-12 + 4.0 * f64::EPSILON * (2.0 * f64::from(term.n + 1)).sqrt() * 2.4143f64.powi(term.n as i32);
                    let found = p.at(3.0 * at.x, 3.0 * at.y).0;
                    assert!((found - expected).abs() < room, "{numbering:?} {number} {at}: {found} {expected}");
                }
            }
        }
        // By hand: Noll's 7th, √8 (3ρ³ − 2ρ) sin θ; the fringe order's 9th, 6ρ⁴ − 6ρ² + 1.
        let noll = Polynomial::new(1.0, Terms { noll: vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], ..Terms::default() }).unwrap();
        assert!((noll.at(0.0, 0.5).0 - 8f64.sqrt() * (3.0 * 0.125 - 1.0)).abs() < 1e-14);
        let mut list = vec![0.0; 9];
        list[8] = 1.0;
        let fringe = Polynomial::new(1.0, Terms { fringe: list, ..Terms::default() }).unwrap();
        assert!((fringe.at(0.3, 0.4).0 - (6.0 / 16.0 - 6.0 / 4.0 + 1.0)).abs() < 1e-14);
    }

    fn mixed() -> Polynomial {
        let xy = [((0, 1), 0.2), ((2, 0), -0.4), ((1, 1), 0.3), ((0, 2), 0.1), ((3, 2), -0.25), ((0, 5), 0.15)];
        let noll = (0..45).map(|i| 0.02 * ((i * 7 % 11) as f64 - 5.0)).collect();
        let fringe = (0..37).map(|i| 0.01 * ((i * 5 % 13) as f64 - 6.0)).collect();
        Polynomial::new(2.5, Terms { radial: vec![0.5, -0.3, 0.07], xy: xy.into(), noll, fringe }).unwrap()
    }

    #[test]
    fn slopes_and_curvatures_are_those_of_small_differences() {
        let p = mixed();
        for at in places() {
            let (x, y, h) = (2.6 * at.x, 2.6 * at.y, 1e-6);
            let (_, by_x, by_y) = p.at(x, y);
            // Central differences: h²/6 times third derivatives of some 1e4 (Zernike terms of degree 8 at the edge), rounding over h.
            assert!(((p.at(x + h, y).0 - p.at(x - h, y).0) / (2.0 * h) - by_x).abs() < 1e-7, "{at}");
            assert!(((p.at(x, y + h).0 - p.at(x, y - h).0) / (2.0 * h) - by_y).abs() < 1e-7, "{at}");
        }
        let h = 1e-4;
        let [xx, yy] = p.curvatures();
        // Slopes at the middle, odd parts cancel: h² of fourth derivatives.
        assert!(((p.at(h, 0.0).1 - p.at(-h, 0.0).1) / (2.0 * h) - xx).abs() < 1e-5);
        assert!(((p.at(0.0, h).2 - p.at(0.0, -h).2) / (2.0 * h) - yy).abs() < 1e-5);
    }

    #[test]
    fn a_polynomial_turned_over_is_its_mirror_image() {
        let (p, over, twice) = (mixed(), mixed().turned_over(), mixed().times(-2.0));
        for at in places() {
            assert!((over.at(at.x, at.y).0 - p.at(at.x, -at.y).0).abs() < 1e-13);
            assert!((twice.at(at.x, at.y).0 + 2.0 * p.at(at.x, at.y).0).abs() < 1e-13);
        }
        assert!(!p.is_rotational());
        let round = Terms { radial: vec![1.0], noll: vec![0.1, 0.0, 0.0, 0.3], ..Terms::default() };
        assert!(Polynomial::new(1.0, round).unwrap().is_rotational());
    }

    #[test]
    fn figures_that_are_no_polynomial_are_refused() {
        let of = |norm, terms| Polynomial::new(norm, terms).unwrap_err();
        assert!(of(0.0, Terms::default()).contains("normalisation radius"));
        assert!(of(1.0, Terms { xy: [((19, 2), 1.0)].into(), ..Terms::default() }).contains("x19y2"));
        assert!(of(1.0, Terms { fringe: vec![0.0; 38], ..Terms::default() }).contains("38 Zernike"));
        assert!(of(1.0, Terms { radial: vec![f64::NAN], ..Terms::default() }).contains("NaN"));
    }
}

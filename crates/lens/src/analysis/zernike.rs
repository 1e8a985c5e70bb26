//! Zernike polynomials over the unit disk, and least-squares fits of wavefronts in them.
//!
//! Noll's order (J. Opt. Soc. Am. 66, 207, 1976) with his normalisation: every term has the root mean square 1 over the disk, so that a
//! coefficient is the root mean square that it adds; other programs call it "standard". The fringe order (University of Arizona; Wyant &
//! Creath, "Basic Wavefront Aberration Theory", Applied Optics and Optical Engineering XI, 1992) with its normalisation: every term is 1
//! at the edge. Angles count from +x towards +y.

use crate::draw::{Axis, Chart, FIELD_COLORS, Figure, Line, Style};
use glam::DVec2;

/// Order and normalisation of the terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Numbering {
    /// Noll's: root mean square 1.
    Noll,
    /// Fringe: 1 at the edge.
    Fringe,
}

/// A term: R(ρ) cos mθ for m ≥ 0, R(ρ) sin |m|θ for m < 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Its number, from 1.
    pub number: usize,
    /// Radial degree.
    pub n: u32,
    /// Azimuthal frequency with its sign.
    pub m: i32,
    /// Order it belongs to.
    pub numbering: Numbering,
}

/// Coefficients of a wavefront.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Of each term from the first, in the unit of the values.
    pub coefficients: Vec<f64>,
    /// Root mean square of what the terms leave.
    pub residual_rms: f64,
}

impl Fit {
    /// Zernike coefficients (waves) over their number: a colour a wavefront.
    pub fn plot(title: &str, wavefronts: &[(String, &Fit)]) -> Figure {
        let cell = DVec2::new(560.0, 340.0);
        let mut figure = Figure::sheet(title, 1, 1, cell);
        let points = |c: &[f64]| c.iter().enumerate().map(|(k, c)| DVec2::new((k + 1) as f64, *c)).collect::<Vec<_>>();
        let curve = |(i, (name, fit)): (usize, &(String, &Fit))| {
            Line::new(name.clone(), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, points(&fit.coefficients))
        };
        let lines: Vec<Line> = wavefronts.iter().enumerate().map(curve).collect();
        let x = Axis::around("number of the term", lines.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
        let y = Axis::around("coefficient, waves", lines.iter().flat_map(|l| l.points.iter().map(|p| p.y)), true);
        Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        figure
    }
}

impl Numbering {
    /// Largest number: radial degree 20 of Noll's; the fringe set ends with its 37th term.
    pub fn largest(self) -> usize {
        match self {
            Numbering::Noll => 231,
            Numbering::Fringe => 37,
        }
    }

    /// The term of a number from 1; `None` beyond [`Numbering::largest`].
    pub fn term(self, number: usize) -> Option<Term> {
        if !(1..=self.largest()).contains(&number) {
            return None;
        }
        let (n, m) = match self {
            Numbering::Noll => {
                // Row n has n + 1 terms, |m| rising; even numbers are cosines.
                let mut n = 0;
                let mut place = number - 1;
                while place > n {
                    place -= n + 1;
                    n += 1;
                }
                let m = if n % 2 == 0 { 2 * place.div_ceil(2) } else { 2 * (place / 2) + 1 };
                (n, if number.is_multiple_of(2) { m as i32 } else { -(m as i32) })
            }
            // The 37th is the next spherical aberration, out of turn.
            Numbering::Fringe if number == 37 => (12, 0),
            Numbering::Fringe => {
                // Group s = (n + |m|) / 2 has 2 s + 1 terms, |m| falling, each cosine before its sine.
                let s = (number - 1).isqrt();
                let place = number - 1 - s * s;
                let m = s - place / 2;
                (2 * s - m, if place.is_multiple_of(2) { m as i32 } else { -(m as i32) })
            }
        };
        Some(Term { number, n: n as u32, m, numbering: self })
    }
}

impl Term {
    /// Value at a place of the unit disk.
    pub fn value(&self, at: DVec2) -> f64 {
        let angle = at.y.atan2(at.x);
        let m = f64::from(self.m.unsigned_abs());
        let around = if self.m < 0 { (m * angle).sin() } else { (m * angle).cos() };
        self.norm() * self.radial(at.length()) * around
    }

    pub(crate) fn norm(&self) -> f64 {
        let degree = f64::from(self.n) + 1.0;
        match self.numbering {
            Numbering::Fringe => 1.0,
            Numbering::Noll if self.m == 0 => degree.sqrt(),
            Numbering::Noll => (2.0 * degree).sqrt(),
        }
    }

    /// Σ (−1)ᵏ (n−k)! / (k! ((n+m)/2−k)! ((n−m)/2−k)!) ρⁿ⁻²ᵏ (Born & Wolf §9.2.1).
    fn radial(&self, r: f64) -> f64 {
        let m = self.m.unsigned_abs();
        let (p, q) = ((self.n + m) / 2, (self.n - m) / 2);
        let factorial = |k: u32| (2..=k).map(f64::from).product::<f64>();
        (0..=q)
            .map(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let coefficient = factorial(self.n - k) / (factorial(k) * factorial(p - k) * factorial(q - k));
                sign * coefficient * r.powi((self.n - 2 * k) as i32)
            })
            .sum()
    }

    /// What the aberration is called; empty where it has no name of its own.
    pub fn name(&self) -> &'static str {
        match (self.n, self.m) {
            (0, 0) => "piston",
            (1, 1) => "tilt x",
            (1, -1) => "tilt y",
            (2, 0) => "defocus",
            (2, 2) => "astigmatism 0°",
            (2, -2) => "astigmatism 45°",
            (3, 1) => "coma x",
            (3, -1) => "coma y",
            (3, 3) => "trefoil x",
            (3, -3) => "trefoil y",
            (4, 0) => "spherical",
            (4, 2) => "secondary astigmatism 0°",
            (4, -2) => "secondary astigmatism 45°",
            (5, 1) => "secondary coma x",
            (5, -1) => "secondary coma y",
            (6, 0) => "secondary spherical",
            _ => "",
        }
    }
}

/// Fits the first `count` terms to values at places of the unit disk by least squares: Householder's QR decomposition (Golub & Van Loan,
/// "Matrix Computations", §5.3.2), because over a vignetted pupil the terms are far from orthogonal. `None` where there are fewer values
/// than terms, or the places cannot tell the terms apart.
pub fn fit(values: &[(DVec2, f64)], numbering: Numbering, count: usize) -> Option<Fit> {
    /// A column that is this small (relative) once the ones before are taken out of it is one of them.
    const DEPENDENT: f64 = 1e-9;
    let terms: Vec<Term> = (1..=count).map(|number| numbering.term(number)).collect::<Option<_>>()?;
    let rows = values.len();
    if count == 0 || rows < count {
        return None;
    }
    let mut columns: Vec<Vec<f64>> = terms.iter().map(|t| values.iter().map(|(at, _)| t.value(*at)).collect()).collect();
    let mut rest: Vec<f64> = values.iter().map(|v| v.1).collect();
    let mut diagonal = vec![0.0; count];
    let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (k, corner) in diagonal.iter_mut().enumerate() {
        let whole = length(&columns[k]);
        let mut mirror = columns[k].split_off(k);
        let norm = length(&mirror);
        if norm.is_nan() || norm <= DEPENDENT * whole.max(f64::MIN_POSITIVE) {
            return None;
        }
        *corner = if mirror[0] > 0.0 { -norm } else { norm };
        mirror[0] -= *corner;
        let scale = 2.0 / mirror.iter().map(|x| x * x).sum::<f64>();
        for column in columns[k + 1..].iter_mut().chain([&mut rest]) {
            let along = scale * mirror.iter().zip(&column[k..]).map(|(a, b)| a * b).sum::<f64>();
            column[k..].iter_mut().zip(&mirror).for_each(|(c, v)| *c -= along * v);
        }
    }
    let mut coefficients = vec![0.0; count];
    for k in (0..count).rev() {
        let known: f64 = (k + 1..count).map(|j| columns[j][k] * coefficients[j]).sum();
        coefficients[k] = (rest[k] - known) / diagonal[k];
    }
    Some(Fit { coefficients, residual_rms: length(&rest[count..]) / (rows as f64).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn terms_have_their_published_numbers() {
        let of = |numbering: Numbering, number| numbering.term(number).map(|t| (t.n, t.m)).unwrap();
        // Noll 1976, table 1.
        let noll =
            [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2), (4, 4)];
        for (i, expected) in noll.into_iter().enumerate() {
            assert_eq!(of(Numbering::Noll, i + 1), expected, "{}", i + 1);
        }
        assert_eq!(of(Numbering::Noll, 22), (6, 0));
        assert_eq!(of(Numbering::Noll, 37), (8, 0));
        assert_eq!(of(Numbering::Noll, 231).0, 20);
        // Wyant & Creath 1992, table III.
        let fringe = [
            (0, 0),
            (1, 1),
            (1, -1),
            (2, 0),
            (2, 2),
            (2, -2),
            (3, 1),
            (3, -1),
            (4, 0),
            (3, 3),
            (3, -3),
            (4, 2),
            (4, -2),
            (5, 1),
            (5, -1),
            (6, 0),
        ];
        for (i, expected) in fringe.into_iter().enumerate() {
            assert_eq!(of(Numbering::Fringe, i + 1), expected, "{}", i + 1);
        }
        assert_eq!([of(Numbering::Fringe, 25), of(Numbering::Fringe, 36), of(Numbering::Fringe, 37)], [(8, 0), (10, 0), (12, 0)]);
        assert!(Numbering::Fringe.term(38).is_none() && Numbering::Noll.term(0).is_none() && Numbering::Noll.term(232).is_none());
        // Closed forms: Noll's 11th is √5 (6ρ⁴ − 6ρ² + 1), fringe 8 (3ρ³ − 2ρ) sin θ; at the edge fringe terms are ±1.
        let at = DVec2::new(0.3, -0.5);
        let r2 = at.length_squared();
        let spherical = Numbering::Noll.term(11).unwrap().value(at);
        assert!((spherical - 5f64.sqrt() * (6.0 * r2 * r2 - 6.0 * r2 + 1.0)).abs() < 1e-12);
        assert!((Numbering::Fringe.term(8).unwrap().value(at) - (3.0 * r2 - 2.0) * at.y).abs() < 1e-12);
        assert!((1..=37).all(|i| Numbering::Fringe.term(i).is_some_and(|t| (t.radial(1.0) - 1.0).abs() < 1e-9)));
    }

    #[test]
    fn nolls_terms_are_orthonormal_over_the_disk() {
        // Even angles are exact below the 64th harmonic; over u = ρ² Simpson's rule, whose error for degree 8 is below 1e-8.
        const AROUND: usize = 64;
        const STEPS: usize = 400;
        let terms: Vec<Term> = (1..=37).map(|i| Numbering::Noll.term(i).unwrap()).collect();
        let pairs: Vec<(usize, usize)> = (0..37).flat_map(|a| (0..=a).map(move |b| (a, b))).collect();
        let mut sums = vec![0.0; pairs.len()];
        for i in 0..=STEPS {
            let weight = if i == 0 || i == STEPS {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            } / (3.0 * STEPS as f64);
            for k in 0..AROUND {
                let at = DVec2::from_angle(TAU * k as f64 / AROUND as f64) * (i as f64 / STEPS as f64).sqrt();
                let values: Vec<f64> = terms.iter().map(|t| t.value(at)).collect();
                for (sum, (a, b)) in sums.iter_mut().zip(&pairs) {
                    *sum += weight / AROUND as f64 * values[*a] * values[*b];
                }
            }
        }
        for (sum, (a, b)) in sums.iter().zip(&pairs) {
            let expected = if a == b { 1.0 } else { 0.0 };
            assert!((sum - expected).abs() < 1e-6, "{} {}: {sum}", a + 1, b + 1);
        }
    }

    #[test]
    fn a_fit_finds_the_coefficients_it_was_made_of() {
        // Over the full disk and over half of it (vignetted), where terms are far from orthogonal.
        let places: Vec<DVec2> = (0..51 * 51).map(|i| DVec2::new((i % 51) as f64, (i / 51) as f64) / 25.0 - 1.0).collect();
        let given: Vec<f64> = (0..37).map(|i| ((i * i * 7 + 3) % 19) as f64 / 10.0 - 0.9).collect();
        for numbering in [Numbering::Noll, Numbering::Fringe] {
            for lowest in [-1.0, -0.2] {
                let value = |at: DVec2| (0..37).map(|i| given[i] * numbering.term(i + 1).unwrap().value(at)).sum::<f64>();
                let inside = places.iter().filter(|p| p.length() <= 1.0 && p.y >= lowest);
                let samples: Vec<(DVec2, f64)> = inside.map(|p| (*p, value(*p))).collect();
                let found = fit(&samples, numbering, 37).unwrap();
                let worst = found.coefficients.iter().zip(&given).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst < 1e-9 && found.residual_rms < 1e-9, "{numbering:?} {lowest}: {worst} {}", found.residual_rms);
            }
        }
        // What is left out stays: of 1 wave of spherical aberration in rms, fitted up to defocus.
        let samples: Vec<(DVec2, f64)> =
            places.iter().filter(|p| p.length() <= 1.0).map(|p| (*p, Numbering::Noll.term(11).unwrap().value(*p))).collect();
        let left = fit(&samples, Numbering::Noll, 4).unwrap();
        // A grid of 51 is not quite the disk.
        assert!((left.residual_rms - 1.0).abs() < 0.03, "{left:?}");
        // Too few values, and places on a line, are no disk.
        assert_eq!(fit(&samples[..3], Numbering::Noll, 4), None);
        let line: Vec<(DVec2, f64)> = (0..50).map(|i| (DVec2::new(i as f64 / 50.0, 0.0), 1.0)).collect();
        assert_eq!(fit(&line, Numbering::Noll, 3), None);
    }
}

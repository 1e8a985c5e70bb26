//! Q-type aspheres: departures from a conic or a sphere in orthogonal polynomials.
//!
//! With u = r / `norm_mm` and x = u²:
//!
//! - Q^con ("strong"): z = conic(r) + u⁴ Σ aₘ Qₘ^con(x), where Qₘ^con(x) is the Jacobi polynomial Pₘ^(0,4)(2x − 1) (Forbes 2007, Opt. Express
//!   15, 5218, doi 10.1364/OE.15.005218, eqs 3 to 5).
//! - Q^bfs ("mild"): z = c r² / (1 + φ) + u² (1 − u²) / φ Σ aₘ Qₘ^bfs(x), φ = √(1 − c² r²), with Qₘ^bfs such that the mean square slope of the
//!   departure along the normal is Σ aₘ² / `norm_mm`² (the same, eqs 11 to 13; recurrence of Forbes 2010, Opt. Express 18, 19700, doi
//!   10.1364/OE.18.019700, eqs A.7 to A.14). With a conic constant k the departure is along the normal of the conic: 1/φ, one over the cosine of
//!   the normal, becomes √((1 − k c² r²) / (1 − (1 + k) c² r²)). OpticStudio's surface is meant so: only then does a lens that a vendor gives in
//!   this form focus to a point (test `a_sold_asphere_…`).
//!
//! Coefficients aₘ in mm, m from 0. Sums are taken by a three-term recurrence upwards: terms of the order of 1 with no cancellation, where
//! powers of r² would lose a digit a term.

/// Most coefficients of one surface.
pub const MOST_TERMS: usize = 64;

/// Which polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ForbesKind {
    /// Q^con: departure from a conic.
    Conic,
    /// Q^bfs: departure along the normal of the best-fit sphere, or of a conic in its place.
    BestFitSphere,
}

/// z(r) of a Q-type asphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Forbes {
    kind: ForbesKind,
    c: f64,
    k: f64,
    norm_mm: f64,
    terms: Vec<f64>,
    /// Weights of the polynomials of the recurrence.
    weights: Vec<f64>,
    /// Value of the first of them.
    first: f64,
    /// (α, β, γ): Tₘ₊₁ = (αₘ + βₘ x) Tₘ − γₘ Tₘ₋₁.
    recurrence: Vec<[f64; 3]>,
}

impl Forbes {
    /// `c`: curvature, 1/mm; `k`: conic constant; `norm_mm`: radius at which u is 1. Fails on a `norm_mm` that is not above 0 and below 10⁶, on
    /// more than [`MOST_TERMS`] terms, and on numbers that are not finite.
    pub fn new(kind: ForbesKind, c: f64, k: f64, norm_mm: f64, terms: Vec<f64>) -> Result<Forbes, String> {
        if !(norm_mm > 0.0 && norm_mm < 1e6) {
            return Err(format!("normalisation radius {norm_mm}: expected a positive length in mm"));
        }
        if terms.len() > MOST_TERMS {
            return Err(format!("{} coefficients: expected at most {MOST_TERMS}", terms.len()));
        }
        if let Some(bad) = terms.iter().find(|a| !a.is_finite()) {
            return Err(format!("coefficient {bad}: expected a length in mm"));
        }
        if !c.is_finite() || !k.is_finite() {
            return Err(format!("curvature {c}, conic constant {k}: expected numbers"));
        }
        let count = terms.len();
        let (weights, first, recurrence) = match kind {
            ForbesKind::Conic => (terms.clone(), 1.0, (0..count).map(jacobi_0_4).collect()),
            // P₀ = 2, P₁ = 6 − 8x, Pₘ₊₁ = (2 − 4x) Pₘ − Pₘ₋₁.
            ForbesKind::BestFitSphere => {
                let step = |m: usize| if m == 0 { [3.0, -4.0, 0.0] } else { [2.0, -4.0, 1.0] };
                (auxiliary_weights(&terms), 2.0, (0..count).map(step).collect())
            }
        };
        Ok(Forbes { kind, c, k, norm_mm, terms, weights, first, recurrence })
    }

    /// Which polynomials.
    pub fn kind(&self) -> ForbesKind {
        self.kind
    }

    /// Curvature of the conic or sphere, 1/mm.
    pub fn c(&self) -> f64 {
        self.c
    }

    /// Conic constant.
    pub fn k(&self) -> f64 {
        self.k
    }

    /// Radius at which u is 1, mm.
    pub fn norm_mm(&self) -> f64 {
        self.norm_mm
    }

    /// Coefficients aₘ, mm.
    pub fn terms(&self) -> &[f64] {
        &self.terms
    }

    /// The same departure from another curvature.
    pub(crate) fn with_curvature(&self, c: f64) -> Forbes {
        Forbes { c, ..self.clone() }
    }

    /// Seen from behind: z changes its sign.
    pub(crate) fn reversed(&self) -> Forbes {
        let negated = |v: &[f64]| v.iter().map(|v| -v).collect();
        Forbes { c: -self.c, terms: negated(&self.terms), weights: negated(&self.weights), ..self.clone() }
    }

    /// What the packet trace needs: weights, value of the first polynomial, recurrence.
    pub(crate) fn series(&self) -> (&[f64], f64, &[[f64; 3]]) {
        (&self.weights, self.first, &self.recurrence)
    }

    /// Σ aₘ Qₘ(x) and its derivative by x.
    #[inline]
    fn sum(&self, x: f64) -> (f64, f64) {
        let (mut t, mut before) = (self.first, 0.0);
        let (mut dt, mut d_before) = (0.0, 0.0);
        let (mut sum, mut slope) = (0.0, 0.0);
        for (w, [a, b, g]) in self.weights.iter().zip(&self.recurrence) {
            sum += w * t;
            slope += w * dt;
            let factor = a + b * x;
            (t, before, dt, d_before) = (factor * t - g * before, t, b * t + factor * dt - g * d_before, dt);
        }
        (sum, slope)
    }

    /// z (mm) and dz/dr at a height (mm); `None` beyond the conic.
    #[inline]
    pub fn sag(&self, r: f64) -> Option<(f64, f64)> {
        let r2 = r * r;
        let root2 = 1.0 - (1.0 + self.k) * self.c * self.c * r2;
        if root2 <= 0.0 {
            return None;
        }
        let root = root2.sqrt();
        let scale = 1.0 / (self.norm_mm * self.norm_mm);
        let x = r2 * scale;
        let (s, ds) = self.sum(x);
        let (z, over_r) = match self.kind {
            ForbesKind::Conic => (x * x * s, 2.0 * scale * (2.0 * x * s + x * x * ds)),
            ForbesKind::BestFitSphere => {
                let bump = x * (1.0 - x);
                let by_x = (1.0 - 2.0 * x) * s + bump * ds;
                // One over the cosine of the conic's normal, and its slope over r and itself.
                let (k, c2) = (self.k, self.c * self.c);
                let across2 = 1.0 - k * c2 * r2;
                let steep = (across2 / root2).sqrt();
                let steepens = c2 * ((1.0 + k) / root2 - k / across2);
                (bump * s * steep, steep * (2.0 * scale * by_x + bump * s * steepens))
            }
        };
        Some((self.c * r2 / (1.0 + root) + z, r * (self.c / root + over_r)))
    }

    /// Curvature at the vertex, 1/mm.
    pub fn vertex_curvature(&self) -> f64 {
        match self.kind {
            ForbesKind::Conic => self.c,
            ForbesKind::BestFitSphere => self.c + 2.0 * self.sum(0.0).0 / (self.norm_mm * self.norm_mm),
        }
    }

    /// Coefficient of r⁴ (mm⁻³) that departs from a sphere of the vertex curvature: for third-order sums.
    pub fn fourth_order(&self) -> f64 {
        let norm2 = self.norm_mm * self.norm_mm;
        let (s, ds) = self.sum(0.0);
        let own = (1.0 + self.k) * self.c.powi(3) / 8.0;
        let terms = match self.kind {
            ForbesKind::Conic => s / (norm2 * norm2),
            // (x − x²) (1 + c² r²/2) (s + ds x)
            ForbesKind::BestFitSphere => (ds - s) / (norm2 * norm2) + 0.5 * s * self.c * self.c / norm2,
        };
        own + terms - self.vertex_curvature().powi(3) / 8.0
    }
}

/// (α, β, γ) of Pₘ₊₁ = (α + β x) Pₘ − γ Pₘ₋₁ for the Jacobi polynomials Pₘ^(0,4)(2x − 1) (DLMF 18.9.1, 18.9.2).
fn jacobi_0_4(m: usize) -> [f64; 3] {
    if m == 0 {
        return [-5.0, 6.0, 0.0];
    }
    let (n, b) = (m as f64, 4.0);
    let two = 2.0 * n + b;
    let common = 2.0 * (n + 1.0) * (n + b + 1.0) * two;
    // In y = 2x − 1: (two + 1) (two (two + 2) y − b²) / common.
    let by_y = (two + 1.0) * two * (two + 2.0) / common;
    let constant = -(two + 1.0) * b * b / common;
    let before = 2.0 * n * (n + b) * (two + 2.0) / common;
    [constant - by_y, 2.0 * by_y, before]
}

/// Weights of the auxiliary polynomials P of Forbes 2010 that give Σ aₘ Qₘ^bfs (eqs A.13 to A.16).
fn auxiliary_weights(a: &[f64]) -> Vec<f64> {
    let count = a.len();
    // Pₘ = fₘ Qₘ + gₘ₋₁ Qₘ₋₁ + hₘ₋₂ Qₘ₋₂.
    let (mut f, mut g, mut h) = (vec![2.0], vec![], vec![]);
    for m in 1..count {
        let number = m as f64;
        if m >= 2 {
            h.push(-number * (number - 1.0) / (2.0 * f[m - 2]));
        }
        let before: f64 = if m >= 2 { g[m - 2] * h[m - 2] } else { 0.0 };
        g.push(-(1.0 + before) / f[m - 1]);
        let last: f64 = if m >= 2 { h[m - 2] } else { 0.0 };
        f.push((number * (number + 1.0) + 3.0 - g[m - 1] * g[m - 1] - last * last).sqrt());
    }
    let mut w = vec![0.0; count];
    for m in (0..count).rev() {
        let next = if m + 1 < count { g[m] * w[m + 1] } else { 0.0 };
        let after = if m + 2 < count { h[m] * w[m + 2] } else { 0.0 };
        w[m] = (a[m] - next - after) / f[m];
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A departure of one term.
    fn term(kind: ForbesKind, m: usize) -> Forbes {
        let mut terms = vec![0.0; m + 1];
        terms[m] = 1.0;
        Forbes::new(kind, 0.0, 0.0, 1.0, terms).unwrap()
    }

    #[test]
    fn polynomials_are_those_of_the_paper() {
        // Forbes 2007, Table 1 (Q-con): 1; −5 + 6x; 15 − 14x (3 − 2x); −{35 − 12x [14 − x (21 − 10x)]};
        // 70 − 3x {168 − 5x [84 − 11x (8 − 3x)]}; −[126 − x (1260 − 11x {420 − x [720 − 13x (45 − 14x)]})].
        let con: [fn(f64) -> f64; 6] = [
            |_| 1.0,
            |x| -(5.0 - 6.0 * x),
            |x| 15.0 - 14.0 * x * (3.0 - 2.0 * x),
            |x| -(35.0 - 12.0 * x * (14.0 - x * (21.0 - 10.0 * x))),
            |x| 70.0 - 3.0 * x * (168.0 - 5.0 * x * (84.0 - 11.0 * x * (8.0 - 3.0 * x))),
            |x| -(126.0 - x * (1260.0 - 11.0 * x * (420.0 - x * (720.0 - 13.0 * x * (45.0 - 14.0 * x))))),
        ];
        // Table 2 (Q-bfs): 1; (13 − 16x)/√19; √(2/95) [29 − 4x (25 − 19x)]; √(2/2545) {207 − 4x [315 − x (577 − 320x)]}.
        let bfs: [fn(f64) -> f64; 4] = [
            |_| 1.0,
            |x| (13.0 - 16.0 * x) / 19f64.sqrt(),
            |x| (2f64 / 95.0).sqrt() * (29.0 - 4.0 * x * (25.0 - 19.0 * x)),
            |x| (2f64 / 2545.0).sqrt() * (207.0 - 4.0 * x * (315.0 - x * (577.0 - 320.0 * x))),
        ];
        for x in [0.0, 0.13, 0.5, 0.77, 1.0] {
            for (m, expected) in con.iter().enumerate() {
                let found = term(ForbesKind::Conic, m).sum(x).0;
                // Rounding of sums of the size of 1260.
                assert!((found - expected(x)).abs() < 1e-11, "con {m} {x}: {found} {}", expected(x));
            }
            for (m, expected) in bfs.iter().enumerate() {
                let found = term(ForbesKind::BestFitSphere, m).sum(x).0;
                assert!((found - expected(x)).abs() < 1e-11, "bfs {m} {x}: {found} {}", expected(x));
            }
        }
    }

    #[test]
    fn slopes_of_mild_terms_are_orthonormal() {
        // Forbes 2007, eq. 12: of a plane base, the mean of products of slopes over θ, u = sin θ, is 1 for equal terms, else 0.
        let slope = |f: &Forbes, u: f64| f.sag(u).unwrap().1;
        const STEPS: usize = 400;
        for m in 0..8 {
            for n in 0..8 {
                let (a, b) = (term(ForbesKind::BestFitSphere, m), term(ForbesKind::BestFitSphere, n));
                let mean = (0..STEPS)
                    .map(|i| {
                        // Gauss–Chebyshev: equal steps of θ, exact for polynomials of this degree.
                        let u = (std::f64::consts::FRAC_PI_2 * (i as f64 + 0.5) / STEPS as f64).sin();
                        slope(&a, u) * slope(&b, u)
                    })
                    .sum::<f64>()
                    / STEPS as f64;
                let expected = if m == n { 1.0 } else { 0.0 };
                assert!((mean - expected).abs() < 1e-9, "{m} {n}: {mean}");
            }
        }
    }

    #[test]
    fn slopes_and_vertex_figures_are_those_of_the_sag() {
        let terms = vec![0.02, -0.013, 0.004, 0.001];
        for (kind, k) in [(ForbesKind::Conic, -0.6), (ForbesKind::BestFitSphere, 0.0), (ForbesKind::BestFitSphere, -1.4)] {
            let f = Forbes::new(kind, 0.03, k, 9.0, terms.clone()).unwrap();
            for r in [0.5, 3.0, 7.7, 9.5] {
                let h = 1e-5;
                let numeric = (f.sag(r + h).unwrap().0 - f.sag(r - h).unwrap().0) / (2.0 * h);
                // Central differences: h² and rounding over h.
                assert!((f.sag(r).unwrap().1 - numeric).abs() < 1e-9, "{kind:?} {r}");
            }
            // z = c r²/2 + (c³/8 + g) r⁴ + …: the next power is (r/9)⁶ of a few hundredths.
            let (c, g) = (f.vertex_curvature(), f.fourth_order());
            let r = 0.1;
            let series = 0.5 * c * r * r + (c.powi(3) / 8.0 + g) * r.powi(4);
            assert!((f.sag(r).unwrap().0 - series).abs() < 1e-11, "{kind:?} {} {series}", f.sag(r).unwrap().0);
            let over = f.reversed();
            assert_eq!(over.sag(4.0).unwrap().0, -f.sag(4.0).unwrap().0);
        }
        assert!(Forbes::new(ForbesKind::Conic, 0.1, 0.0, 0.0, vec![]).unwrap_err().contains("normalisation radius"));
    }

    #[test]
    fn a_sold_asphere_focuses_to_a_point() {
        // Thorlabs ASL5040-UV, f = 40 mm at 405 nm, fused silica, as the vendor's OpticStudio file gives it: QED_TYPE of kind 0 with a conic.
        let terms = vec![-8.148370167576e-1, -3.2311e-1, 1.0591e-1, -5.058e-2, 9.87e-3, -2.2e-3];
        let f = Forbes::new(ForbesKind::BestFitSphere, 5.756_078_762_782_423e-2, -0.676_091_206_404_079_3, 27.0, terms).unwrap();
        let (n, thickness) = (crate::glass::Glass::parse("material/SILICA").unwrap().index(405.0), 29.85);
        // Where a ray that comes parallel to the axis crosses it behind the plane back, mm.
        let focus = |r: f64| {
            let (z, slope) = f.sag(r).unwrap();
            // Snell at the front: the angles with the normal, then with the axis.
            let normal = slope.atan();
            let down = normal - (normal.sin() / n).asin();
            let height = r - (thickness - z) * down.tan();
            height / (n * down.sin()).asin().tan()
        };
        for r in [0.1, 5.0, 10.0, 15.0, 20.0, 22.5] {
            // The file puts the film 19.6875 mm behind; a departure along the axis, or from the sphere, is tenths of a millimetre off.
            assert!((focus(r) - 19.6875).abs() < 2e-3, "{r}: {}", focus(r));
        }
    }
}

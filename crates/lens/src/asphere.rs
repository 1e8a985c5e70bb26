//! Aspheres: a conic and a polynomial in the height.

/// z(r) of a conic and a polynomial.
#[derive(Clone, Debug, PartialEq)]
pub struct Asphere {
    /// Curvature of the conic, 1/mm.
    pub c: f64,
    /// Conic constant.
    pub k: f64,
    /// Coefficient of rⁱ at index i, mm¹⁻ⁱ; index 0 is not used.
    pub a: Vec<f64>,
}

impl Asphere {
    /// z (mm) and dz/dr at a height (mm); `None` beyond the conic.
    #[inline]
    pub fn sag(&self, r: f64) -> Option<(f64, f64)> {
        let root2 = 1.0 - (1.0 + self.k) * self.c * self.c * r * r;
        if root2 <= 0.0 {
            return None;
        }
        let root = root2.sqrt();
        let (mut z, mut slope) = (0.0, 0.0);
        for a in self.a.iter().skip(1).rev() {
            // Horner for Σ aᵢ rⁱ = r (a₁ + r (a₂ + …)) and its derivative.
            slope = slope * r + z;
            z = z * r + a;
        }
        let slope = slope * r + z;
        let z = z * r;
        Some((self.c * r * r / (1.0 + root) + z, self.c * r / root + slope))
    }

    /// Curvature at the vertex, 1/mm: the conic's and the r² term's.
    pub fn vertex_curvature(&self) -> f64 {
        self.c + 2.0 * self.a.get(2).copied().unwrap_or(0.0)
    }

    /// Coefficient of r⁴ (mm⁻³) that departs from a sphere of the vertex curvature: for third-order sums.
    pub fn fourth_order(&self) -> f64 {
        let c = self.vertex_curvature();
        let conic = (1.0 + self.k) * self.c.powi(3) / 8.0 - c.powi(3) / 8.0;
        conic + self.a.get(4).copied().unwrap_or(0.0)
    }
}

//! Freeform surfaces: a conic with powers of r, and a polynomial over the plane on it (ISO 10110-19; Zemax "Zernike Standard Sag", "Zernike
//! Fringe Sag", "Extended Polynomial"; CODE V XYP, ZFR).

use crate::asphere::Asphere;
use crate::polynomial::{Local, Polynomial};

/// z(x, y) = asphere(r) + polynomial(x, y), mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Freeform {
    /// What it departs from.
    pub base: Asphere,
    /// By how much, mm.
    pub departure: Polynomial,
}

impl Freeform {
    /// z and its slopes in x and y; `None` beyond the conic.
    #[inline]
    pub(crate) fn sag(&self, x: f64, y: f64) -> Option<Local> {
        let r = x.hypot(y);
        let (z, slope) = self.base.sag(r)?;
        let over_r = if r > 0.0 { slope / r } else { 0.0 };
        let (dz, by_x, by_y) = self.departure.at(x, y);
        Some((z + dz, x * over_r + by_x, y * over_r + by_y))
    }

    /// Curvatures at the vertex, in x and in y, 1/mm. A slope of the surface at its vertex counts as none.
    pub fn vertex_curvatures(&self) -> [f64; 2] {
        self.departure.curvatures().map(|c| self.base.vertex_curvature() + c)
    }

    /// Coefficient of r⁴ in the y–z plane that departs from a sphere of the vertex curvature there: for third-order sums.
    pub(crate) fn fourth_order(&self) -> f64 {
        let conic = (1.0 + self.base.k) * self.base.c.powi(3) / 8.0 + self.base.a.get(4).copied().unwrap_or(0.0);
        conic + self.departure.fourth_order() - self.vertex_curvatures()[1].powi(3) / 8.0
    }

    /// Seen from behind: z changes its sign.
    pub(crate) fn reversed(&self) -> Freeform {
        let Asphere { c, k, a } = &self.base;
        let base = Asphere { c: -c, k: *k, a: a.iter().map(|v| -v).collect() };
        Freeform { base, departure: self.departure.times(-1.0) }
    }
}

//! Reflection and transmission of plane waves by a stack of films: Abelès' characteristic matrices.
//!
//! Source: Born & Wolf, *Principles of Optics* (7th ed.) §1.6, with the admittances of Macleod, *Thin-Film Optical Filters* (4th ed.) §2.
//! Fields go as exp(−iωt): a medium of index n + ik absorbs with k > 0. Phases follow Born & Wolf's Fresnel coefficients, in which r of p
//! is (n₂ cos θ₁ − n₁ cos θ₂) / (n₂ cos θ₁ + n₁ cos θ₂) for one boundary.
//!
//! The medium that the light comes from is transparent; films are parallel, homogeneous and thin against the coherence length.

use super::complex::Complex;
use std::f64::consts::TAU;

/// Light closer to grazing than this cosine is taken for light at it: at 90° itself the admittances have no limit.
const GRAZING: f64 = 1e-7;

/// What a stack does to a plane wave; in every pair s (TE) comes first, then p (TM).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Reflected fraction of the power.
    pub reflectance: [f64; 2],
    /// Fraction of the power that enters the last medium.
    pub transmittance: [f64; 2],
    /// Phase of the reflected field at the first boundary, rad.
    pub reflected_phase: [f64; 2],
    /// Phase of the transmitted field at the last boundary, rad.
    pub transmitted_phase: [f64; 2],
}

impl Response {
    /// Fraction of the power that stays in the films, s and p.
    pub fn absorptance(&self) -> [f64; 2] {
        [0, 1].map(|i| 1.0 - self.reflectance[i] - self.transmittance[i])
    }

    /// Reflectance of unpolarised light.
    pub fn unpolarised_reflectance(&self) -> f64 {
        0.5 * (self.reflectance[0] + self.reflectance[1])
    }

    /// Transmittance of unpolarised light.
    pub fn unpolarised_transmittance(&self) -> f64 {
        0.5 * (self.transmittance[0] + self.transmittance[1])
    }
}

/// Response of films (index n + ik and thickness in nm, in the order in which light meets them) between a transparent medium of index
/// `incident` and a substrate, at a cosine of incidence and a vacuum wavelength in nm.
pub fn response(
    incident: f64,
    films: impl DoubleEndedIterator<Item = (Complex, f64)> + Clone,
    substrate: Complex,
    cos: f64,
    nm: f64,
) -> Response {
    let cos = cos.clamp(GRAZING, 1.0);
    let sine2 = Complex::from(incident * incident * (1.0 - cos * cos));
    // N cos θ of a medium by Snell's law; the root that decays along the light.
    let along = |n: Complex| {
        let q = (n * n - sine2).upper_root();
        if q.norm_squared() > 1e-24 { q } else { Complex::from(1e-12) }
    };
    let mut out =
        Response { reflectance: [0.0; 2], transmittance: [0.0; 2], reflected_phase: [0.0; 2], transmitted_phase: [0.0; 2] };
    let last = along(substrate);
    for (polarisation, first) in [incident * cos, incident / cos].into_iter().enumerate() {
        let admittance = |n: Complex, q: Complex| if polarisation == 0 { q } else { n * n / q };
        let end = admittance(substrate, last);
        // Tangential electric and magnetic field at the last boundary, carried to the first. Each matrix is divided by exp(−iδ), which
        // grows without bound in thick absorbing films; `through` collects the factors.
        let (mut b, mut c, mut through) = (Complex::ONE, end, Complex::ONE);
        for (n, thickness) in films.clone().rev() {
            let q = along(n);
            let eta = admittance(n, q);
            let step = (q * (TAU * thickness / nm)).exp_i();
            let twice = step * step;
            let (even, odd) = ((Complex::ONE + twice) * 0.5, (Complex::ONE - twice) * 0.5);
            (b, c) = (even * b + odd * c / eta, odd * eta * b + even * c);
            through = through * step;
        }
        let start = Complex::from(first);
        let sum = start * b + c;
        let r = (start * b - c) / sum;
        let t = through * (first + first) / sum;
        out.reflectance[polarisation] = r.norm_squared();
        out.transmittance[polarisation] = end.re * t.norm_squared() / first;
        let (r, t) = match polarisation {
            0 => (r, t),
            // From tangential to whole fields.
            _ => (-r, t * cos * (substrate / last)),
        };
        out.reflected_phase[polarisation] = r.phase();
        out.transmitted_phase[polarisation] = t.phase();
    }
    out
}

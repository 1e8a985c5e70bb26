//! Aberrations of a lens as it is focused, for the pattern of its aperture instead of for its rays.
//!
//! A ray from film point x through the pupil misses the object point that the middle of the pupil sees there; on the film it misses by δ. Where the lens is
//! nearly perfect, spreading light by δ and by diffraction counts the aberration twice over: the product of the geometric MTF and that of a perfect pupil
//! is up to 0.28 too low at λ/14 rms (docs/decisions/diffraction.md). So rays start at x + δ, and all meet the object point in the plane of focus; the
//! wavefront W, of which δ is the gradient over the direction cosines (Welford, "Aberrations of Optical Systems", §7.2), goes into the pupil function. What is
//! elsewhere in depth is blurred by its rays as before.
//!
//! W is a polynomial over the pupil at points along a radius of the film, fitted to δ of traced rays; that of the d line for all wavelengths (what colours do
//! differently stays with the rays).

use crate::compound::CompoundLens;
use crate::linear::Cholesky;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use glam::{DMat2, DVec2};

/// Highest order of the polynomial.
const ORDER: usize = 8;
/// Its terms xⁱ yʲ, 1 ≤ i + j ≤ [`ORDER`].
const TERMS: usize = (ORDER + 1) * (ORDER + 2) / 2 - 1;
/// Rays across the pupil.
const RAYS: usize = 25;
/// Step on the film by which the scale of the picture is found, mm.
const STEP_MM: f64 = 0.01;

/// The wavefront at a film point on the x axis.
#[derive(Clone, Debug)]
pub(super) struct Wavefront {
    /// Of W, mm.
    terms: [f64; TERMS],
    /// Middle and half width of the square in which x and y go from −1 to 1, as [`super::pupil::PupilGrid`] counts.
    center: DVec2,
    half: f64,
    /// δ from the gradient over x and y.
    film_from_gradient: DMat2,
    /// Largest δ in the pupil, mm, and largest miss of the polynomial.
    pub largest: f64,
    pub miss: f64,
}

/// Calls with the powers of each term: number, i, j.
fn terms() -> impl Iterator<Item = (usize, usize)> {
    (1..=ORDER).flat_map(|order| (0..=order).map(move |j| (order - j, j)))
}

/// Powers 0 to [`ORDER`].
fn powers(x: f64) -> [f64; ORDER + 1] {
    let mut all = [1.0; ORDER + 1];
    for i in 1..=ORDER {
        all[i] = all[i - 1] * x;
    }
    all
}

/// Derivatives of each term along x and y.
fn gradients(at: DVec2) -> [DVec2; TERMS] {
    let (x, y) = (powers(at.x), powers(at.y));
    let mut all = [DVec2::ZERO; TERMS];
    for (slot, (i, j)) in all.iter_mut().zip(terms()) {
        let along = |n: usize, p: &[f64; ORDER + 1]| if n == 0 { 0.0 } else { n as f64 * p[n - 1] };
        *slot = DVec2::new(along(i, &x) * y[j], x[i] * along(j, &y));
    }
    all
}

impl Wavefront {
    /// At the film point (`radius`, 0) mm, over a square of the pupil; `lit` tells which part of it (x and y from −1 to 1) matters. `foreshortened`: direction
    /// cosines of a step of slope there. `None` where rays do not come through.
    pub(super) fn at(
        lens: &CompoundLens,
        radius: f64,
        [center, half]: [DVec2; 2],
        foreshortened: DMat2,
        lit: impl Fn(DVec2) -> bool,
    ) -> Option<Wavefront> {
        let half = half.x;
        let system = lens.system();
        let n = system.reference_indices();
        let curvature = lens.pupils().curvature;
        let trace = |film: DVec2, q: DVec2| {
            let direction = system.film_direction(q - film * curvature);
            let ray = TracedRay { position: film.extend(system.film_z), direction };
            system.trace(ray, &n, TraceDirection::ToObject, Apertures::Ignore).ok()
        };
        let film = DVec2::new(radius, 0.0);
        let chief = trace(film, center)?;
        // Where a ray meets the plane of focus; of a distant one its direction.
        let e1 = chief.direction.any_orthonormal_vector();
        let e2 = chief.direction.cross(e1);
        let plane = lens.focus_distance().map(|d| lens.first_order().entrance_pupil_z - d.0);
        let seen = |ray: TracedRay| {
            let at = match plane {
                None => DVec2::new(ray.direction.dot(e1), ray.direction.dot(e2)),
                Some(z) => (ray.position + ray.direction * ((z - ray.position.z) / ray.direction.z)).truncate(),
            };
            at.is_finite().then_some(at)
        };
        let middle = seen(chief)?;
        let moved =
            |step: DVec2| Some((seen(trace(film + step, center)?)? - seen(trace(film - step, center)?)?) / (2.0 * STEP_MM));
        let scale = DMat2::from_cols(moved(DVec2::X * STEP_MM)?, moved(DVec2::Y * STEP_MM)?);
        let film_from_seen = scale.inverse();
        let gradient_from_film = foreshortened.transpose() * half;
        let film_from_gradient = gradient_from_film.inverse();
        if !film_from_seen.is_finite() || !film_from_gradient.is_finite() {
            return None;
        }
        // Least squares: normal equations of the gradient's components.
        let mut normal = vec![0.0; TERMS * TERMS];
        let mut right = [0.0; TERMS];
        let mut known = vec![];
        for i in 0..RAYS * RAYS {
            let at = DVec2::new((i % RAYS) as f64, (i / RAYS) as f64) * (2.0 / (RAYS - 1) as f64) - 1.0;
            if !lit(at) {
                continue;
            }
            let Some(found) = trace(film, center + at * half).and_then(seen) else { continue };
            let delta = film_from_seen * (middle - found);
            let (wanted, slopes) = (gradient_from_film * delta, gradients(at));
            for (a, slope) in slopes.iter().enumerate() {
                right[a] += slope.dot(wanted);
                for (b, other) in slopes[..=a].iter().enumerate() {
                    normal[a * TERMS + b] += slope.dot(*other);
                }
            }
            known.push((at, delta));
        }
        if known.len() < 2 * TERMS {
            return None;
        }
        // Enough to keep terms that a narrow pupil does not tell apart from running away.
        let trust = 1e-9 * known.len() as f64;
        (0..TERMS).for_each(|a| normal[a * TERMS + a] += trust);
        Cholesky::new(normal, TERMS)?.solve(&mut right);
        let mut wavefront = Wavefront { terms: right, center, half, film_from_gradient, largest: 0.0, miss: 0.0 };
        for (at, delta) in known {
            let found = wavefront.delta_at(at);
            wavefront.largest = wavefront.largest.max(found.length());
            wavefront.miss = wavefront.miss.max(found.distance(delta));
        }
        Some(wavefront)
    }

    fn place(&self, q: DVec2) -> DVec2 {
        (q - self.center) / self.half
    }

    fn delta_at(&self, at: DVec2) -> DVec2 {
        let slope: DVec2 = gradients(at).iter().zip(&self.terms).map(|(g, t)| *g * *t).sum();
        self.film_from_gradient * slope
    }

    /// By how much (mm on the film) a ray at a place of the pupil misses.
    pub(super) fn delta(&self, q: DVec2) -> DVec2 {
        // Beyond the pupil a polynomial knows nothing.
        let at = self.place(q);
        self.delta_at(at / at.length().max(1.0))
    }

    /// Path, mm.
    pub(super) fn path(&self, q: DVec2) -> f64 {
        let at = self.place(q);
        let (x, y) = (powers(at.x), powers(at.y));
        terms().zip(self.terms).map(|((i, j), t)| t * x[i] * y[j]).sum()
    }
}

/// Direction cosines of a step of slope about a slope: l = s/√(1 + s²).
pub(super) fn foreshortening(s: DVec2) -> DMat2 {
    let z = (1.0 + s.length_squared()).sqrt().recip();
    let outer = DMat2::from_cols(s * s.x, s * s.y);
    DMat2::from_diagonal(DVec2::splat(z)) - outer * z.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_and_gradients_belong_together() {
        assert_eq!(terms().count(), TERMS);
        let mut w = Wavefront {
            terms: std::array::from_fn(|k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.5),
            center: DVec2::new(0.1, -0.2),
            half: 0.5,
            film_from_gradient: DMat2::IDENTITY,
            largest: 0.0,
            miss: 0.0,
        };
        w.terms[3] = 0.7;
        let q = DVec2::new(0.2, 0.05);
        let step = 1e-5;
        let slope = |d: DVec2| (w.path(q + d * step) - w.path(q - d * step)) / (2.0 * step) * w.half;
        let found = w.delta(q);
        assert!((found - DVec2::new(slope(DVec2::X), slope(DVec2::Y))).length() < 1e-7, "{found}");
        // A tilted plane foreshortens along its slope by cos³ and across by cos.
        let c = (1.0f64 + 0.25).sqrt().recip();
        let m = foreshortening(DVec2::new(0.5, 0.0));
        assert!((m * DVec2::X - DVec2::X * c.powi(3)).length() < 1e-12 && (m * DVec2::Y - DVec2::Y * c).length() < 1e-12);
    }
}

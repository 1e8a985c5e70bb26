//! Irradiance of a film point by the outline of the light that reaches it: a smooth function of the lens, as derivatives want it.
//!
//! E / L = ∫ cos⁴θ T ds over the slopes s that pass (L radiance, T transmittance of glass and surfaces). The outline is found along directions around the
//! middle of the lit slopes, by bisection; along each direction the integrand stands on Gauss–Legendre nodes in the square of the distance, as in
//! `bundle.rs`. [`Bench::illumination`](crate::analysis::Bench::illumination) counts rays of a grid instead, which moves in steps when a rim moves.

use crate::batch::double::{Batch, Indices, LANES, Packet};
use crate::linear::gauss_legendre;
use crate::ray::TraceDirection;
use crate::system::System;
use glam::DVec2;
use std::f64::consts::TAU;

/// Directions that find the middle of the light, and that sum it.
const ARMS: [usize; 2] = [16, 48];
/// Steps along a direction in which the ends of the light are looked for, and halvings after that.
const STEPS: usize = 24;
const HALVINGS: usize = 26;
/// Nodes along a direction.
const NODES: usize = 4;
/// How far light is looked for, in radii of the paraxial exit pupil; doubled as long as the farthest ray still passes.
const REACH: f64 = 2.5;
const DOUBLINGS: usize = 4;

/// A system made ready for this.
pub(super) struct Light<'a> {
    system: &'a System,
    batch: Batch,
    n: Indices,
    nm: f64,
    /// Radius of the paraxial exit pupil seen from the film, as a slope.
    pupil: f64,
}

/// Where light begins and ends along a direction, in slopes from the middle.
type Ends = Option<[f64; 2]>;

impl<'a> Light<'a> {
    /// The illumination of a system at a wavelength, nm.
    pub fn new(system: &'a System, nm: f64) -> Light<'a> {
        let n = system.indices(nm);
        let first = crate::paraxial::FirstOrder::of(system, &n);
        let pupil = (first.exit_pupil_radius() / (system.film_z - first.exit_pupil_z)).abs();
        let pupil = if pupil.is_finite() { pupil.clamp(1e-4, 2.0) } else { 1.0 };
        Light { system, batch: Batch::new(system), n: Indices::uniform(&n), nm, pupil }
    }

    /// Irradiance over radiance at a film point (mm), sr, losses included; `near`: a slope about which the light is looked for. 0 where none is found.
    pub fn irradiance(&self, film: DVec2, near: DVec2) -> f64 {
        let mut reach = REACH * self.pupil;
        let mut middle = near;
        for _ in 0..DOUBLINGS {
            let arms = self.arms(film, middle, ARMS[0], reach);
            if arms.iter().flatten().any(|[_, outer]| *outer >= reach * (1.0 - 1.0 / STEPS as f64)) {
                reach *= 2.0;
                continue;
            }
            let Some(centroid) = centroid(&arms) else {
                reach *= 2.0;
                continue;
            };
            // Once more from there: seen from a place near the edge the outline is steep.
            middle += centroid;
            return self.sum(film, middle, &self.arms(film, middle, ARMS[1], reach));
        }
        0.0
    }

    /// Which of some slopes pass, and what is left of their light.
    fn trace(&self, film: DVec2, slopes: &[DVec2]) -> Vec<Option<f64>> {
        let mut packet = Packet::default();
        let mut all = Vec::with_capacity(slopes.len());
        for chunk in slopes.chunks(LANES) {
            for lane in 0..LANES {
                let direction = self.system.film_direction(chunk[lane.min(chunk.len() - 1)]);
                packet.set(lane, film.extend(self.system.film_z).to_array(), direction.to_array());
            }
            let mask = self.batch.trace_light(&mut packet, &self.n, &[self.nm; LANES], TraceDirection::ToObject);
            all.extend((0..chunk.len()).map(|lane| (mask >> lane & 1 == 1).then(|| packet.fraction[lane])));
        }
        all
    }

    /// Ends of the light along directions around a slope.
    fn arms(&self, film: DVec2, middle: DVec2, count: usize, reach: f64) -> Vec<Ends> {
        let at = |arm: usize, r: f64| middle + direction(arm, count) * r;
        let step = |k: usize| reach * (k as f64 + 0.5) / STEPS as f64;
        let scan: Vec<DVec2> = (0..count * STEPS).map(|i| at(i / STEPS, step(i % STEPS))).collect();
        let lit: Vec<bool> = self.trace(film, &scan).iter().map(Option::is_some).collect();
        // Each end between a dark and a lit place.
        let mut ends: Vec<Option<[[f64; 2]; 2]>> = (0..count)
            .map(|arm| {
                let lit = &lit[arm * STEPS..(arm + 1) * STEPS];
                let (first, last) = (lit.iter().position(|l| *l)?, lit.iter().rposition(|l| *l)?);
                let inner = if first == 0 { [0.0, 0.0] } else { [step(first - 1), step(first)] };
                let outer = if last + 1 == STEPS { [reach, reach] } else { [step(last + 1), step(last)] };
                Some([inner, outer])
            })
            .collect();
        for _ in 0..HALVINGS {
            let open: Vec<(usize, usize, f64)> = (0..count)
                .flat_map(|arm| [(arm, 0), (arm, 1)])
                .filter_map(|(arm, end)| {
                    let [dark, light] = ends[arm]?[end];
                    (dark != light).then_some((arm, end, 0.5 * (dark + light)))
                })
                .collect();
            let slopes: Vec<DVec2> = open.iter().map(|(arm, _, r)| at(*arm, *r)).collect();
            for ((arm, end, r), passed) in open.into_iter().zip(self.trace(film, &slopes)) {
                if let Some(both) = &mut ends[arm] {
                    both[end][passed.is_some() as usize] = r;
                }
            }
        }
        ends.into_iter().map(|e| e.map(|[inner, outer]| [inner[1], outer[1]])).collect()
    }

    fn sum(&self, film: DVec2, middle: DVec2, arms: &[Ends]) -> f64 {
        let nodes = gauss_legendre(NODES);
        let lit: Vec<(usize, f64, f64)> =
            arms.iter().enumerate().filter_map(|(i, e)| e.map(|[a, b]| (i, a * a, b * b))).collect();
        let slopes: Vec<DVec2> = lit
            .iter()
            .flat_map(|(i, low, high)| {
                let along = direction(*i, arms.len());
                nodes.iter().map(move |[x, _]| middle + along * (low + (high - low) * x).sqrt())
            })
            .collect();
        let fractions = self.trace(film, &slopes);
        let each = lit.iter().flat_map(|(_, low, high)| nodes.iter().map(move |[_, w]| 0.5 * w * (high - low)));
        let total: f64 = slopes
            .iter()
            .zip(fractions)
            .zip(each)
            .map(|((slope, fraction), area)| area * fraction.unwrap_or(0.0) * self.system.film_direction(*slope).z.powi(4))
            .sum();
        total * TAU / arms.len() as f64
    }
}

/// Half a step off the axes: no direction lies in a plane of symmetry.
fn direction(arm: usize, count: usize) -> DVec2 {
    DVec2::from_angle(TAU * (arm as f64 + 0.5) / count as f64)
}

/// Centroid of the area within the ends, from the middle they are counted from.
fn centroid(arms: &[Ends]) -> Option<DVec2> {
    let mut sum = DVec2::ZERO;
    let mut area = 0.0;
    for (i, ends) in arms.iter().enumerate() {
        let Some([inner, outer]) = ends else { continue };
        sum += direction(i, arms.len()) * ((outer.powi(3) - inner.powi(3)) / 3.0);
        area += 0.5 * (outer * outer - inner * inner);
    }
    (area > 0.0).then(|| sum / area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::Bench;
    use crate::compound::{FilmPlace, configure};
    use crate::embedded;
    use crate::glass::D_NM;

    #[test]
    fn the_outline_sums_to_the_light_of_the_grid() {
        for (name, f_number, heights) in [
            ("double-gauss-50mm", None, [0.0, 10.0, 20.0]),
            ("double-gauss-50mm", Some(5.6), [0.0, 10.0, 20.0]),
            ("wide-24mm-f3.5", Some(4.0), [0.0, 10.0, 18.0]),
            ("reflex-500mm-f8", None, [0.0, 10.0, 18.0]),
        ] {
            let set = configure(&embedded(name).unwrap(), None, f_number, None, FilmPlace::AsPublished).unwrap();
            let bench = Bench::at_infinity(&set.system);
            let light = Light::new(&set.system, D_NM);
            for height in heights {
                let ray = bench.chief_beam(bench.field_of_height(height), D_NM).unwrap().image;
                let near = -ray.direction.truncate() / ray.direction.z.abs();
                let found = light.irradiance(DVec2::new(0.0, height), near);
                let expected = bench.illumination(height, D_NM).with_losses;
                // The grid of 160 × 160 rays is off by some tenths of a per cent; corners of a cat's eye by as much here.
                assert!((found / expected - 1.0).abs() < 6e-3, "{name} {f_number:?} {height}: {found} {expected}");
            }
        }
    }
}

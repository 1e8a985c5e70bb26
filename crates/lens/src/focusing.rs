//! Where the film must stand: the plane of the smallest spot on the axis, from real rays.
//!
//! The thick-lens formula gives the paraxial plane; a real lens with spherical aberration is sharpest elsewhere, and elsewhere
//! again when it is stopped down. What is minimised is the root mean square distance of the rays from their mean, over the
//! pupil as it stands and four wavelengths weighted as the eye weighs them.

use crate::at_stop;
use crate::paraxial::FirstOrder;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use glam::{DVec2, DVec3};

/// Wavelengths (nm) and weights: F′, e, d, C with V(λ).
const COLORS: [(f64, f64); 4] = [(479.99, 0.139), (546.07, 0.980), (587.56, 0.769), (656.27, 0.070)];
/// Rays from farther away begin here, mm before the lens.
const NEAR_MM: f64 = 1000.0;
/// Rays across the pupil.
const ACROSS: usize = 21;

/// A bundle from one object point, at the last vertex: places, slopes, weights.
struct Bundle {
    at: Vec<(DVec2, DVec2, f64)>,
    z: f64,
}

/// From an object point, mm from the first vertex (z negative); `None` for one infinitely far along the axis.
fn bundle(system: &System, object: Option<DVec3>) -> Bundle {
    let z = system.last_z();
    let mut at = vec![];
    for (nm, weight) in COLORS {
        let n = system.indices(nm);
        let first = FirstOrder::of(system, &n);
        // Wider than the paraxial pupil: what the iris does not let through drops out.
        let reach = first.entrance_pupil_radius() * system.iris.shape.reach() * 1.15;
        let ray_to = |place: DVec2| {
            let target = place.extend(first.entrance_pupil_z);
            match object {
                None => TracedRay { position: target.with_z(0.0), direction: DVec3::Z },
                Some(object) => {
                    let direction = (target - object).normalize();
                    // Begun far away, rays would lose digits on the first surface: they begin near the lens.
                    let o = object.z;
                    let position = if o < -NEAR_MM { object + direction * ((-NEAR_MM - o) / direction.z) } else { object };
                    TracedRay { position, direction: direction * direction.z.signum() }
                }
            }
        };
        // About the ray through the middle of the stop, which may be decentred.
        let middle = at_stop::chief_of(system, &n, ray_to).unwrap_or(DVec2::ZERO);
        for i in 0..ACROSS * ACROSS {
            let u = (i % ACROSS) as f64 / (ACROSS - 1) as f64 * 2.0 - 1.0;
            let v = (i / ACROSS) as f64 / (ACROSS - 1) as f64 * 2.0 - 1.0;
            let ray = ray_to(middle + DVec2::new(u, v) * reach);
            if let Ok(r) = system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip) {
                let slope = DVec2::new(r.direction.x, r.direction.y) / r.direction.z;
                let place = DVec2::new(r.position.x, r.position.y) + slope * (z - r.position.z);
                at.push((place, slope, weight));
            }
        }
    }
    Bundle { at, z }
}

/// The spot of a point on the axis, as it changes with the place of the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxialSpot {
    /// Where it is smallest, mm from the first vertex.
    pub best_z: f64,
    /// Its root mean square radius there, mm.
    pub best_rms: f64,
    /// What it grows by (root mean square slope of the rays).
    pub slope: f64,
}

impl AxialSpot {
    /// The spot of a point `object_z` mm from the first vertex (negative), `None` at infinity. `None` when no light comes through.
    pub fn of(system: &System, object_z: Option<f64>) -> Option<AxialSpot> {
        AxialSpot::of_point(system, object_z.map(|z| DVec3::Z * z))
    }

    /// The spot of a point that may lie beside the axis, as a turned lens's plane of focus has it: mm from the first vertex; `None` infinitely far along the axis.
    pub fn of_point(system: &System, object: Option<DVec3>) -> Option<AxialSpot> {
        let Bundle { at, z } = bundle(system, object);
        let total: f64 = at.iter().map(|r| r.2).sum();
        if at.len() < 3 {
            return None;
        }
        let mean = |f: &dyn Fn(&(DVec2, DVec2, f64)) -> DVec2| at.iter().map(|r| f(r) * r.2).sum::<DVec2>() / total;
        let (place, slope) = (mean(&|r| r.0), mean(&|r| r.1));
        let moment = |f: &dyn Fn(DVec2, DVec2) -> f64| at.iter().map(|r| f(r.0 - place, r.1 - slope) * r.2).sum::<f64>() / total;
        let (pp, ps, ss) = (moment(&|p, _| p.length_squared()), moment(&|p, s| p.dot(s)), moment(&|_, s| s.length_squared()));
        if ss <= 1e-18 {
            return None;
        }
        Some(AxialSpot { best_z: z - ps / ss, best_rms: (pp - ps * ps / ss).max(0.0).sqrt(), slope: ss.sqrt() })
    }

    /// Root mean square radius on a film there, mm.
    pub fn rms_at(&self, film_z: f64) -> f64 {
        self.best_rms.hypot(self.slope * (film_z - self.best_z))
    }
}

/// Film place (mm from the first vertex) of the smallest spot, and its RMS radius, mm. `object_z`: place of the object on the
/// axis, `None` for infinity. `None` when no light comes through or the rays do not meet.
pub fn best_film_z(system: &System, object_z: Option<f64>) -> Option<(f64, f64)> {
    AxialSpot::of(system, object_z).map(|s| (s.best_z, s.best_rms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::State;
    use crate::{Coating, embedded};

    #[test]
    fn stopped_down_the_best_plane_is_the_paraxial_one() {
        // The double Gauss at f/32: no aberration left; object at infinity and at 2 m, by Newton's x x' = f² from the foci.
        let p = embedded("double-gauss-50mm").unwrap();
        assert_eq!(p.coating, Coating::None);
        let mut system = System::at(&p, State::default());
        let first = FirstOrder::of(&system, &system.indices(550.0));
        system.iris.radius *= 2.0 / 32.0;
        let (z, rms) = best_film_z(&system, None).unwrap();
        assert!((z - system.last_z() - first.bfl).abs() < 0.01 && rms < 0.002, "{z} {rms}");
        let distance = 2000.0;
        let (near, _) = best_film_z(&system, Some(-distance)).unwrap();
        let newton = first.efl * first.efl / (distance + first.ffl);
        assert!((near - z - newton).abs() < 2e-3, "{} {newton}", near - z);
        // Very far is as good as infinity.
        let (far, _) = best_film_z(&system, Some(-1e9)).unwrap();
        assert!((far - z).abs() < 1e-5, "{}", far - z);
        // Wide open the smallest spot lies nearer the lens: undercorrected spherical aberration.
        let open = System::at(&p, State::default());
        let (wide, rms) = best_film_z(&open, None).unwrap();
        assert!((wide - z).abs() > 0.02 && rms > 0.002, "{wide} {z} {rms}");
    }
}

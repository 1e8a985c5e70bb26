//! Optical path differences.
//!
//! Paths are compared on a sphere around the chief ray's film point that passes through the chief ray's crossing of the exit
//! pupil (Hopkins 1950; Welford ch. 7). Rays of a distant object start on a plane across the chief ray, those of a near one in
//! the object point. Positive: the ray's wavefront is ahead of the sphere (its path is shorter), as CODE V prints it.

use super::{Beam, Bench};
use crate::trace::{Apertures, TracedRay, Way};
use glam::{DVec2, DVec3};

/// The sphere that paths are compared on.
pub(super) struct Reference {
    center: DVec3,
    radius: f64,
    path: f64,
}

impl Bench<'_> {
    pub(super) fn reference_path(&self, beam: &Beam, nm: f64) -> Option<Reference> {
        let center = self.on_film(&beam.image, 0.0).extend(self.system.film_z);
        let exit_z = self.first_order(nm).exit_pupil_z;
        // Telecentric: any far sphere.
        let exit_z = if exit_z.is_finite() && (exit_z - center.z).abs() < 1e6 { exit_z } else { center.z - 1e6 };
        let d = beam.image.direction;
        let at = beam.image.position + d * ((exit_z - beam.image.position.z) / d.z);
        // On which side of the film the pupil lies.
        let radius = (center - at).length() * (center - at).dot(d).signum();
        let mut reference = Reference { center, radius, path: 0.0 };
        reference.path = self.path_to(beam, DVec2::ZERO, nm, &reference)?;
        Some(reference)
    }

    /// Optical path of a ray from the object (or the plane across the chief ray) to the sphere, mm.
    fn path_to(&self, beam: &Beam, at: DVec2, nm: f64, reference: &Reference) -> Option<f64> {
        let n = self.system.indices(nm);
        let mut path = 0.0;
        let start = beam.ray(at);
        let TracedRay { position, direction } =
            self.system.trace_with(start, &n, Way::ToFilm, Apertures::Ignore, |e| path += e.path).ok()?;
        // On to where the ray meets the sphere, on the side of the pupil.
        let from = position - reference.center;
        let b = from.dot(direction);
        let root2 = b * b - (from.length_squared() - reference.radius * reference.radius);
        if root2 < 0.0 {
            return None;
        }
        let t = -b - reference.radius.signum() * root2.sqrt();
        Some(path + t * n[n.len() - 1])
    }

    /// Optical path difference, waves, of the ray through a place across the chief ray (mm).
    pub fn opd_of(&self, beam: &Beam, at: DVec2, nm: f64) -> Option<f64> {
        self.opd(beam, at, nm, &self.reference_path(beam, nm)?)
    }

    /// Optical path difference of a ray in waves.
    pub(super) fn opd(&self, beam: &Beam, at: DVec2, nm: f64, reference: &Reference) -> Option<f64> {
        let path = self.path_to(beam, at, nm, reference)?;
        Some((reference.path - path) / (nm * 1e-6))
    }

    /// Root mean square of the wavefront error over the lit pupil, waves, about its mean.
    pub fn wavefront_rms(&self, field_deg: f64, nm: f64, across: usize) -> Option<f64> {
        let beam = self.beam(field_deg, nm)?;
        let reference = self.reference_path(&beam, nm)?;
        let values: Vec<f64> =
            self.grid(&beam, nm, across).iter().filter_map(|(at, _)| self.opd(&beam, *at, nm, &reference)).collect();
        if values.is_empty() {
            return None;
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        Some((values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
    }
}

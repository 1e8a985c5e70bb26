//! Optical path differences.
//!
//! Paths are compared on a sphere around the chief ray's film point that passes through the chief ray's crossing of the exit
//! pupil (Hopkins 1950; Welford ch. 7). Rays of a distant object start on a plane across the chief ray, those of a near one in
//! the object point. Positive: the ray's wavefront is ahead of the sphere (its path is shorter), as CODE V prints it.

use super::zernike::{self, Fit, Numbering};
use super::{Beam, Bench};
use crate::at_stop::place_at_stop;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use glam::{DVec2, DVec3};

/// The sphere that paths are compared on.
pub(super) struct Reference {
    center: DVec3,
    radius: f64,
    path: f64,
}

/// A ray of a wavefront.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WavefrontSample {
    /// Column and row of an even grid across the chief ray, x to the right, y upwards.
    pub cell: [usize; 2],
    /// Place in the pupil: where the ray crosses the stop, over the radius that the edge of the axial beam has there. Beams from beside the
    /// axis may reach beyond 1 where a rim, not the iris, limits the axial one.
    pub pupil: DVec2,
    /// Optical path difference to the reference sphere, waves.
    pub opd: f64,
}

/// The wavefront of a field point.
#[derive(Clone, Debug, PartialEq)]
pub struct Wavefront {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Wavelength, nm.
    pub nm: f64,
    /// Columns and rows of the grid.
    pub across: usize,
    /// Rays that pass.
    pub samples: Vec<WavefrontSample>,
}

impl Wavefront {
    /// Largest less smallest path difference, waves.
    pub fn peak_to_valley(&self) -> f64 {
        let (low, high) = self.samples.iter().fold((f64::MAX, f64::MIN), |(a, b), s| (a.min(s.opd), b.max(s.opd)));
        high - low
    }

    /// Root mean square about the mean, waves.
    pub fn rms(&self) -> f64 {
        let count = self.samples.len() as f64;
        let mean = self.samples.iter().map(|s| s.opd).sum::<f64>() / count;
        (self.samples.iter().map(|s| (s.opd - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Root mean square about the best plane, waves: without tilt, which moves the image and does not blur it. `None` of fewer than
    /// three rays.
    pub fn rms_without_tilt(&self) -> Option<f64> {
        let all: Vec<(DVec2, f64)> = self.samples.iter().map(|s| (s.pupil, s.opd)).collect();
        Some(zernike::fit(&all, Numbering::Noll, 3)?.residual_rms)
    }

    /// The first `count` Zernike coefficients, waves, over the rays within the unit disk of [`WavefrontSample::pupil`]. `None` where
    /// they are too few to tell the terms apart.
    pub fn zernikes(&self, numbering: Numbering, count: usize) -> Option<Fit> {
        let inside = self.samples.iter().filter(|s| s.pupil.length() <= 1.0 + 1e-9);
        zernike::fit(&inside.map(|s| (s.pupil, s.opd)).collect::<Vec<_>>(), numbering, count)
    }

    /// Path differences (waves) by rows from the top, not a number where no light passes.
    pub fn map(&self) -> Vec<f32> {
        let mut map = vec![f32::NAN; self.across * self.across];
        for s in &self.samples {
            map[(self.across - 1 - s.cell[1]) * self.across + s.cell[0]] = s.opd as f32;
        }
        map
    }
}

impl Bench<'_> {
    /// Wavefront of a field angle (degrees) on a grid of `across` rays a side over the lit part of the pupil, against the chief ray of its
    /// own wavelength. `None` where no light comes through.
    pub fn wavefront(&self, field_deg: f64, nm: f64, across: usize) -> Option<Wavefront> {
        let n = self.system.indices(nm);
        // How wide the axial beam is in the stop, and whether the stop is upside down.
        let axial = self.beam(0.0, nm)?;
        let edge = place_at_stop(self.system, &n, axial.ray(DVec2::new(0.0, self.axial_reach(nm)?)))?;
        let radius = edge.length() * edge.y.signum();
        let beam = self.beam(field_deg, nm)?;
        let reference = self.reference_path(&beam, nm)?;
        let [low, high] = beam.extent;
        let cell = (high - low) / across as f64;
        let sample = |at: DVec2| {
            let place = ((at - low) / cell).floor();
            let index = |v: f64| (v.max(0.0) as usize).min(across - 1);
            let pupil = place_at_stop(self.system, &n, beam.ray(at))? / radius;
            let opd = self.opd(&beam, at, nm, &reference)?;
            Some(WavefrontSample { cell: [index(place.x), index(place.y)], pupil, opd })
        };
        let samples: Vec<_> = self.grid(&beam, nm, across).iter().filter_map(|(at, _)| sample(*at)).collect();
        (!samples.is_empty()).then_some(Wavefront { field_deg, nm, across, samples })
    }

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
        Some(self.to_sphere(beam, at, nm, reference)?.0)
    }

    /// Optical path of a ray to the sphere, mm, and where it meets it.
    fn to_sphere(&self, beam: &Beam, at: DVec2, nm: f64, reference: &Reference) -> Option<(f64, DVec3)> {
        let n = self.system.indices(nm);
        let mut path = 0.0;
        let start = beam.ray(at);
        let TracedRay { position, direction } =
            self.system.trace_with(start, &n, TraceDirection::ToFilm, Apertures::Ignore, |e| path += e.path).ok()?;
        // On to where the ray meets the sphere, on the side of the pupil.
        let from = position - reference.center;
        let b = from.dot(direction);
        let root2 = b * b - (from.length_squared() - reference.radius * reference.radius);
        if root2 < 0.0 {
            return None;
        }
        let t = -b - reference.radius.signum() * root2.sqrt();
        Some((path + t * n[self.system.surfaces.len()], position + direction * t))
    }

    /// Optical path difference, waves, of the ray through a place across the chief ray (mm). `None` where it or the chief ray does not come
    /// through.
    pub fn opd_of(&self, beam: &Beam, at: DVec2, nm: f64) -> Option<f64> {
        self.opd(beam, at, nm, &self.reference_path(beam, nm)?)
    }

    /// Optical path difference of a ray in waves.
    pub(super) fn opd(&self, beam: &Beam, at: DVec2, nm: f64, reference: &Reference) -> Option<f64> {
        let path = self.path_to(beam, at, nm, reference)?;
        Some((reference.path - path) / (nm * 1e-6))
    }

    /// Root mean square of the wavefront error over the lit pupil, waves, about its mean. `across`: rays a side of the grid. `None` where
    /// no light comes through.
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

/// Huygens's sum over the reference sphere, for tests: irradiance (in no unit) at film points from `across`² forward rays.
#[cfg(test)]
pub(super) fn oracle(bench: &Bench, field_deg: f64, nm: f64, across: usize) -> impl Fn(DVec2) -> f64 {
    let beam = bench.beam(field_deg, nm).unwrap();
    let reference = bench.reference_path(&beam, nm).unwrap();
    let wavelets: Vec<(DVec3, f64)> = bench
        .grid(&beam, nm, across)
        .iter()
        .map(|(at, _)| {
            let (path, place) = bench.to_sphere(&beam, *at, nm, &reference).unwrap();
            (place, path - reference.path)
        })
        .collect();
    let (radius, z, wave) = (reference.radius, bench.system.film_z, std::f64::consts::TAU / (nm * 1e-6));
    move |film: DVec2| {
        let [re, im] = wavelets.iter().fold([0.0; 2], |[re, im], (place, path)| {
            let (s, c) = (wave * (path + (film.extend(z) - *place).length() - radius)).sin_cos();
            [re + c, im + s]
        });
        re * re + im * im
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::test_lenses::{parabola, spherical_mirror};
    use crate::embedded;
    use crate::glass::D_NM;
    use crate::system::{State, System};

    #[test]
    fn a_defocused_mirror_has_a_wavefront_of_defocus() {
        // dz (1 − cos u) at the edge of the parabola, where tan(u/2) = h / 2f: nearly dz ρ² sin²u / 2, a coefficient of half of it.
        let mut system = parabola(200.0, 25.0);
        let dz = 0.02;
        system.film_z += dz * system.film_run();
        let found = Bench::at_infinity(&system).wavefront(0.0, 550.0, 64).unwrap();
        let sin2 = (2.0 * (12.5f64 / 400.0).atan()).sin().powi(2);
        let edge = dz * sin2 / 2.0 / 550e-6;
        assert!((found.peak_to_valley() / edge - 1.0).abs() < 0.02, "{} {edge}", found.peak_to_valley());
        let fringe = found.zernikes(Numbering::Fringe, 16).unwrap();
        assert!((fringe.coefficients[3].abs() / (0.5 * edge) - 1.0).abs() < 2e-3, "{fringe:?} {edge}");
        let others = fringe.coefficients.iter().enumerate().filter(|(i, _)| *i != 0 && *i != 3);
        assert!(others.map(|(_, c)| c.abs()).fold(0.0, f64::max) < 2e-3, "{fringe:?}");
        // Noll's coefficient is the root mean square: edge / (2 √3).
        let noll = found.zernikes(Numbering::Noll, 11).unwrap();
        assert!((noll.coefficients[3].abs() * 2.0 * 3f64.sqrt() / edge - 1.0).abs() < 2e-3, "{noll:?} {edge}");
        assert!((found.rms_without_tilt().unwrap() / noll.coefficients[3].abs() - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_spherical_mirror_has_its_spherical_aberration() {
        // Of a mirror of radius R with a stop at its centre of curvature: W040 = h⁴ / (4 R³) (Hecht §6.3; a parabola has none, and a sphere
        // lies h⁴ / 8R³ above it, twice passed). Fringe 9 holds W040 / 6.
        let (radius, h) = (400.0, 12.5f64);
        let system = spherical_mirror(radius, 2.0 * h);
        let found = Bench::at_infinity(&system).wavefront(0.0, 550.0, 64).unwrap();
        let w040 = h.powi(4) / (4.0 * radius.powi(3)) / 550e-6;
        let fringe = found.zernikes(Numbering::Fringe, 16).unwrap();
        assert!((fringe.coefficients[8].abs() * 6.0 / w040 - 1.0).abs() < 5e-3, "{fringe:?} {w040}");
    }

    #[test]
    fn vignetted_wavefronts_stay_within_the_unit_disk() {
        let system = System::at(&embedded("double-gauss-50mm").unwrap(), State::default());
        let bench = Bench::at_infinity(&system);
        for field in [0.0, 14.0, -14.0] {
            let w = bench.wavefront(field, D_NM, 48).unwrap();
            assert!(w.samples.iter().all(|s| s.pupil.length() < 1.1), "{field}");
            assert!((w.rms() - bench.wavefront_rms(field, D_NM, 48).unwrap()).abs() < 1e-9);
            let fit = w.zernikes(Numbering::Noll, 37).unwrap();
            assert!(fit.residual_rms < 0.1 * w.rms(), "{field}: {} {}", fit.residual_rms, w.rms());
            let map = w.map();
            assert_eq!(map.iter().filter(|v| v.is_finite()).count(), w.samples.len());
        }
        // Up and down are mirror images: coma along y turns round, spherical stays.
        let of = |field: f64| bench.wavefront(field, D_NM, 48).unwrap().zernikes(Numbering::Fringe, 9).unwrap().coefficients;
        let (up, down) = (of(10.0), of(-10.0));
        // A ray on the very edge may pass on one side only.
        assert!((up[7] + down[7]).abs() < 1e-3 && (up[8] - down[8]).abs() < 1e-3, "{up:?} {down:?}");
        assert!(up[7].abs() > 0.01 && up[6].abs() < 1e-3, "{up:?}");
    }
}

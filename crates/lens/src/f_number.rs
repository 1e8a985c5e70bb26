//! The f-number of lenses, also of bent ones (decentred or tilted groups) and of mirrors off the axis: the beam that a distant point on the axis sends through the stop.
//!
//! In a lens whose surfaces all stand on the axis the beam is round about it and one meridional ray tells its size. Where a group is
//! decentred or tilted the beam is not about the axis: its chief ray is the one that meets the middle of the stop (found in x and y), and
//! its size is that of the disk of equal area, so that a lens moved along x and one moved along y have the same f-number.

use crate::aperture::Aperture;
use crate::at_stop::{chief_of, place_at_stop};
use crate::paraxial::FirstOrder;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::surface::Profile;
use crate::system::System;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Directions in which the edge of a beam that is not round is looked for.
const ANGLES: usize = 64;
/// Steps from the largest rim inwards in which the outermost ray is looked for.
const STEPS: usize = 400;

/// A ray parallel to the axis at a place before the lens.
fn parallel(at: DVec2) -> TracedRay {
    TracedRay { position: at.extend(0.0), direction: DVec3::Z }
}

/// Effective focal length over that of the section across it (x–z): what an anamorphic front makes of a round stop.
fn section_ratio(system: &System, n: &[f64], efl: f64) -> f64 {
    let round = |s: &crate::system::PlacedSurface| {
        s.profile.is_rotational() && s.diffractive.as_ref().is_none_or(|d| d.phase().is_rotational())
    };
    if system.surfaces.iter().all(round) {
        return 1.0;
    }
    let mut section = system.clone();
    for s in &mut section.surfaces {
        if let Some(d) = &mut s.diffractive {
            *d = d.across();
        }
        if !s.profile.is_rotational() {
            s.profile = Profile::Sphere(s.profile.curvature_x());
        }
    }
    let ratio = (efl / FirstOrder::of(&section, n).efl).abs();
    if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
}

/// Radius (mm, before the lens) of the widest axial beam that passes every rim, the iris fully open; for a beam that is not round that of
/// the disk of equal area. `None` where nothing passes.
pub(crate) fn widest_radius(system: &System, n: &[f64], efl: f64) -> Option<f64> {
    let most = system.surfaces.iter().map(|s| s.semi_diameter).filter(|s| *s < 1e8).fold(0.0, f64::max);
    // Arms of a spider are no edge: in their directions nothing would pass.
    let mut open = std::borrow::Cow::Borrowed(system);
    if system.surfaces.iter().any(|s| s.apertures.iter().any(Aperture::blocks)) {
        open.to_mut().surfaces.iter_mut().for_each(|s| s.apertures.retain(|a| !a.blocks()));
    }
    let system = &*open;
    let passes = |at: DVec2| system.trace(parallel(at), n, TraceDirection::ToFilm, Apertures::IgnoreIris).is_ok();
    // From outside inwards: an obstruction in the middle is not the edge.
    let edge = |center: DVec2, direction: DVec2| {
        let mut low = (1..=STEPS).rev().map(|i| most * i as f64 / STEPS as f64).find(|h| passes(center + direction * *h))?;
        let mut high = low + most / STEPS as f64;
        for _ in 0..40 {
            let mid = 0.5 * (low + high);
            if passes(center + direction * mid) { low = mid } else { high = mid }
        }
        Some(low)
    };
    if system.is_centered() && system.surfaces.iter().all(|s| s.apertures.is_empty()) {
        return edge(DVec2::ZERO, DVec2::Y);
    }
    let center = chief_of(system, n, parallel).unwrap_or(DVec2::ZERO);
    let directions = (0..ANGLES).map(|i| DVec2::from_angle(TAU * i as f64 / ANGLES as f64));
    let mean_square = directions.map(|d| edge(center, d).unwrap_or(0.0).powi(2)).sum::<f64>() / ANGLES as f64;
    (mean_square > 0.0).then(|| (mean_square * section_ratio(system, n, efl)).sqrt())
}

/// Number of the surface whose rim stops the meridional ray of an axial beam of a radius (mm, before the lens), the iris fully open.
pub(crate) fn clipping_surface(system: &System, n: &[f64], radius: f64) -> Option<usize> {
    let center = chief_of(system, n, parallel).unwrap_or(DVec2::ZERO);
    let ray = parallel(center + DVec2::Y * radius);
    system.trace(ray, n, TraceDirection::ToFilm, Apertures::IgnoreIris).err().map(|blocked| blocked.surface)
}

/// Radius at the stop (mm) of the axial beam of a radius before the lens, from real rays that no rim stops; where that is not round that of
/// the disk of equal area. `None` where the rays do not reach the stop.
pub(crate) fn stop_radius(system: &System, n: &[f64], efl: f64, radius: f64) -> Option<f64> {
    if system.is_centered() {
        return place_at_stop(system, n, parallel(DVec2::Y * radius)).map(|p| p.y.abs());
    }
    let center = chief_of(system, n, parallel)?;
    let radius = radius / section_ratio(system, n, efl).sqrt();
    let place = |i: usize| {
        let direction = DVec2::from_angle(TAU * i as f64 / ANGLES as f64);
        place_at_stop(system, n, parallel(center + direction * radius))
    };
    let ring: Vec<DVec2> = (0..ANGLES).map(place).collect::<Option<_>>()?;
    let twice_area: f64 = (0..ANGLES).map(|i| ring[i].perp_dot(ring[(i + 1) % ANGLES])).sum();
    // A polygon in a circle of radius r has the area ½ n r² sin(2π/n).
    Some((twice_area.abs() / (ANGLES as f64 * (TAU / ANGLES as f64).sin())).sqrt())
}

#[cfg(test)]
mod tests {
    use crate::analysis::Bench;
    use crate::compound::{FilmPlace, configure};
    use crate::glass::D_NM;
    use crate::prescription::Misalignment;
    use crate::{Focus, Prescription, embedded};

    fn moved(first: usize, last: usize, decenter: [f64; 3]) -> Prescription {
        let mut p = embedded("double-gauss-50mm").unwrap();
        p.misalignments.push(Misalignment { first, last, decenter, tilt: [0.0; 3] });
        p
    }

    /// f-number fully open, radius of the stop, and light in the middle of the film or `height` mm above it.
    fn light(p: &Prescription, f_number: f64, height: f64) -> [f64; 3] {
        let set = configure(p, None, Some(f_number), None, FilmPlace::Focused(Focus::Infinity)).unwrap();
        let light = Bench::at_infinity(&set.system).illumination(height, D_NM).geometric;
        [set.widest, set.system.iris.radius, light]
    }

    #[test]
    fn a_group_decentred_with_the_stop_is_as_bright_along_y_as_along_x() {
        let plain = embedded("double-gauss-50mm").unwrap();
        let (stop, last) = (plain.stop(), plain.surfaces.len() - 1);
        for f_number in [4.0, 8.0] {
            // The whole lens moved by 2 mm is the lens, seen by a film moved by 2 mm.
            let [widest, radius, expected] = light(&plain, f_number, 2.0);
            for decenter in [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, -2.0, 0.0]] {
                let found = light(&moved(0, last, decenter), f_number, 0.0);
                assert!((found[0] / widest - 1.0).abs() < 1e-6, "f/{f_number} {decenter:?}: {found:?} {widest}");
                assert!((found[1] / radius - 1.0).abs() < 1e-6, "f/{f_number} {decenter:?}: {found:?} {radius}");
                assert!((found[2] / expected - 1.0).abs() < 5e-3, "f/{f_number} {decenter:?}: {found:?} {expected}");
            }
            // A group about the stop alone: its light is not that of the lens, but the same along x and along y.
            let of = |decenter| light(&moved(stop - 1, stop + 1, decenter), f_number, 0.0);
            let (x, y) = (of([2.0, 0.0, 0.0]), of([0.0, 2.0, 0.0]));
            for (a, b) in x.iter().zip(&y) {
                assert!((a / b - 1.0).abs() < 5e-3, "f/{f_number}: {x:?} {y:?}");
            }
            // The working f-number, √(π / 4E), stays within a tenth of what was asked.
            let working = (std::f64::consts::PI / (4.0 * y[2])).sqrt();
            assert!((working / f_number - 1.0).abs() < 0.1, "{working} {f_number}");
        }
    }
}

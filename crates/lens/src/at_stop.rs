//! Where rays meet the stop, and which of a family meets its middle.

use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use glam::{DMat2, DVec2, DVec3};

/// Where a ray meets the stop, in the stop's own frame; rims are ignored. `None` where it does not get so far.
pub(crate) fn place_at_stop(system: &System, n: &[f64], ray: TracedRay) -> Option<DVec2> {
    let mut place = None;
    // A ray that fails behind the stop has told what was asked.
    let _ = system.trace_part(ray, n, TraceDirection::ToFilm, Apertures::Ignore, 0..system.stop + 1, |e| {
        if e.surface == system.stop {
            place = Some(system.surfaces[e.surface].to_local(e.point, DVec3::Z).0.truncate());
        }
    });
    place.filter(|p| p.is_finite())
}

/// Which ray of a family meets the middle of the stop: Newton's method in two dimensions from the axis. `ray` gives the ray of a place
/// (mm). The axis itself for a centred lens; `None` where no ray of the family meets the middle.
pub(crate) fn chief_of(system: &System, n: &[f64], ray: impl Fn(DVec2) -> TracedRay) -> Option<DVec2> {
    if system.is_centered() {
        return Some(DVec2::ZERO);
    }
    chief_from(system, n, DVec2::ZERO, ray)
}

/// The same, begun at a place of the family.
pub(crate) fn chief_from(system: &System, n: &[f64], start: DVec2, ray: impl Fn(DVec2) -> TracedRay) -> Option<DVec2> {
    // Before semi-diameters are inferred a stop may be as wide as can be.
    let scale = if system.iris.radius < 1e6 { system.iris.radius } else { 1.0 };
    let miss = |at: DVec2| place_at_stop(system, n, ray(at));
    let mut at = start;
    for _ in 0..40 {
        let here = miss(at)?;
        if here.length() < 1e-10 * scale {
            return Some(at);
        }
        let step = 1e-4 * scale;
        let slope = |direction: DVec2| Some((miss(at + direction * step)? - miss(at - direction * step)?) / (2.0 * step));
        let jacobian = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?);
        if jacobian.determinant().abs() < 1e-12 {
            return None;
        }
        at -= jacobian.inverse() * here;
    }
    miss(at).filter(|here| here.length() < 1e-6 * scale).map(|_| at)
}

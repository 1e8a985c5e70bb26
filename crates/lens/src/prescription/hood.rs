//! A hood: a black tube before the lens.

use super::{Gap, Prescription, Surface};
use crate::glass::Glass;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::surface::Profile;
use crate::system::System;
use crate::trace::at_plane;
use glam::{DVec2, DVec3};
use serde::Deserialize;

/// A tube from the rim of the front glass to a round mouth before it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hood {
    /// From the rim of the front glass to the mouth, mm.
    pub length: f64,
    /// Diameter of the mouth, mm; without, as narrow as it may be without taking light from the picture, but not narrower than the front glass.
    pub diameter: Option<f64>,
}

impl Hood {
    /// Fails unless its length is above 0 to 2000 mm and its diameter, if given, above 0 to 4000 mm; the error says what is wrong.
    pub fn check(&self) -> Result<(), String> {
        if !(self.length > 0.0 && self.length <= 2000.0) {
            return Err(format!("hood: length {}: expected above 0 to 2000, in mm", self.length));
        }
        match self.diameter {
            Some(d) if !(d > 0.0 && d <= 4000.0) => Err(format!("hood: diameter {d}: expected above 0 to 4000, in mm")),
            _ => Ok(()),
        }
    }

    /// Radius of the mouth on a lens as it is set, for a film of half width and half height `film`, mm.
    pub fn mouth_radius(&self, system: &System, film: DVec2) -> f64 {
        let front = system.surfaces.first().map_or(0.0, |s| s.semi_diameter);
        match self.diameter {
            Some(d) => 0.5 * d,
            None => clear_radius(system, film, front_rim_z(system) - self.length).max(front),
        }
    }
}

/// Where the rim of the front glass lies, mm from the first vertex.
fn front_rim_z(system: &System) -> f64 {
    system.surfaces.first().and_then(|s| s.profile.sag(0.0, s.semi_diameter * (1.0 - 1e-9))).unwrap_or(0.0)
}

/// Farthest from the axis that light of the film passes a plane before the lens, mm, with the iris fully open.
fn clear_radius(system: &System, film: DVec2, z: f64) -> f64 {
    const ACROSS: usize = 40;
    let n = system.indices(550.0);
    let Some(rear) = system.surfaces.last() else { return 0.0 };
    let origin = DVec3::new(film.x, film.y, system.film_z);
    let through = (0..ACROSS * ACROSS).filter_map(|i| {
        let p = DVec2::new((i % ACROSS) as f64 + 0.5, (i / ACROSS) as f64 + 0.5) * (2.0 / ACROSS as f64) - 1.0;
        let p = p * rear.semi_diameter;
        let ray = TracedRay { position: origin, direction: (DVec3::new(p.x, p.y, rear.z) - origin).normalize() };
        let out = system.trace(ray, &n, TraceDirection::ToObject, Apertures::IgnoreIris).ok()?;
        Some(at_plane(&out, z).truncate().length())
    });
    // What lies between the rays of the grid.
    1.03 * through.fold(0.0, f64::max)
}

impl Prescription {
    /// The lens with a hood on: one more surface, the mouth, comes first. `at`: the lens without, as it is set; `film`: half width and half height, mm.
    pub fn with_hood(&self, hood: &Hood, at: &System, film: DVec2) -> Prescription {
        // The mouth lies before the vertex, however far the glass stands out.
        let gap = (hood.length - front_rim_z(at)).max(0.01);
        let mouth =
            Surface { semi_diameter: Some(hood.mouth_radius(at, film)), ..Surface::new(Profile::Plane, 0.0, Glass::air()) };
        let mut hooded = self.clone();
        hooded.surfaces.insert(0, Surface { gap: Gap::fixed(gap), ..mouth });
        hooded.misalignments.iter_mut().for_each(|m| (m.first, m.last) = (m.first + 1, m.last + 1));
        hooded.stabiliser = hooded.stabiliser.map(|group| group.map(|surface| surface + 1));
        hooded.hood = None;
        hooded
    }
}

//! Mirrors with closed forms, for tests.

use crate::glass::Glass;
use crate::prescription::{Prescription, Surface};
use crate::surface::Profile;
use crate::system::{State, System};

/// A parabolic mirror of a focal length and diameter of its stop (mm): a perfect image on the axis.
pub(super) fn parabola(f: f64, diameter: f64) -> System {
    mirror(2.0 * f, -1.0, diameter)
}

/// A spherical mirror of a radius, its stop (a diameter, mm) in the centre of curvature, its film in the paraxial focus.
pub(super) fn spherical_mirror(radius: f64, diameter: f64) -> System {
    mirror(radius, 0.0, diameter)
}

fn mirror(radius: f64, k: f64, diameter: f64) -> System {
    let mut stop = Surface::new(Profile::Plane, radius, Glass::air());
    (stop.stop, stop.semi_diameter) = (true, Some(0.5 * diameter));
    let mut mirror = Surface::new(Profile::Conic { c: -1.0 / radius, k }, -0.5 * radius, Glass::air());
    (mirror.mirror, mirror.semi_diameter) = (true, Some(diameter));
    System::at(&Prescription::new("mirror", vec![stop, mirror]).checked("test").unwrap(), State::default())
}

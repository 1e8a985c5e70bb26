//! A surface where its file puts it, and frames as numbers of a prescription.

use crate::diffractive::Diffractive;
use crate::freeform::Freeform;
use crate::prescription::Surface;
use crate::surface::{Asphere, Profile};
use glam::{DAffine3, DMat3, DVec3};

/// Lengths (mm) and direction cosines below this are rounding.
pub(super) const ROUNDING: f64 = 1e-9;

/// A surface where the file puts it; its own gap, decentre and tilt are not used.
pub(super) struct Placed {
    pub surface: Surface,
    /// From the surface's frame (vertex at the origin, +z along the local axis) into that of the first surface.
    pub frame: DAffine3,
    /// Whether its size is a rim that stops light, not only drawn: it stays even where it bends nothing.
    pub rim: bool,
}

impl Placed {
    /// The same surface in a frame that is turned over: half a turn about its x axis.
    pub fn turn_over(&mut self) {
        self.frame *= half_turn();
        let s = &mut self.surface;
        s.profile = turned_over(&reversed(&s.profile));
        s.diffractive = s.diffractive.as_ref().map(Diffractive::turned_over);
        s.apertures.iter_mut().for_each(|a| *a = a.turned_over());
    }
}

/// Half a turn about x.
pub(super) fn half_turn() -> DAffine3 {
    DAffine3::from_scale(DVec3::new(1.0, -1.0, -1.0))
}

/// Turns about x, y and z, degrees, of R = Rx Ry Rz; without the last where the surface does not know it.
pub(crate) fn tilts(m: &DMat3, rotational: bool) -> [f64; 3] {
    let z = m.z_axis;
    if z.x.abs() > 1.0 - 1e-12 {
        // The turns about x and z are one: all of it counts about z.
        let about_z = if rotational { 0.0 } else { m.x_axis.y.atan2(m.y_axis.y) };
        return [0.0, z.x.clamp(-1.0, 1.0).asin(), about_z].map(|a| rounded(a.to_degrees()));
    }
    let about_z = if rotational { 0.0 } else { (-m.y_axis.x).atan2(m.x_axis.x) };
    [(-z.y).atan2(z.z), z.x.clamp(-1.0, 1.0).asin(), about_z].map(|a| rounded(a.to_degrees()))
}

pub(super) fn rounded(v: f64) -> f64 {
    if v.abs() < ROUNDING { 0.0 } else { v }
}

/// The same surface seen from behind: z changes its sign.
pub(super) fn reversed(profile: &Profile) -> Profile {
    let asphere = |a: &Asphere| Asphere { c: -a.c, k: a.k, a: a.a.iter().map(|v| -v).collect() };
    match profile {
        Profile::Plane => Profile::Plane,
        Profile::Sphere(c) => Profile::Sphere(-c),
        Profile::Conic { c, k } => Profile::Conic { c: -c, k: *k },
        Profile::Asphere(a) => Profile::Asphere(asphere(a)),
        Profile::Forbes(f) => Profile::Forbes(f.reversed()),
        Profile::Freeform(f) => Profile::Freeform(Box::new(f.reversed())),
        Profile::Fresnel(a) => Profile::Fresnel(asphere(a)),
        Profile::Toroid { y, c_x } => Profile::Toroid { y: asphere(y), c_x: -c_x },
        Profile::Biconic { c_x, k_x, c_y, k_y } => Profile::Biconic { c_x: -c_x, k_x: *k_x, c_y: -c_y, k_y: *k_y },
    }
}

/// A shape whose y changes its sign: all but freeforms are even in y.
fn turned_over(profile: &Profile) -> Profile {
    match profile {
        Profile::Freeform(f) => {
            Profile::Freeform(Box::new(Freeform { base: f.base.clone(), departure: f.departure.turned_over() }))
        }
        even => even.clone(),
    }
}

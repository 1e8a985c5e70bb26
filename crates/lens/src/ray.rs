//! Rays, which way light is followed along them, and whether apertures stop it.

use glam::DVec3;

/// A ray, mm: among the surfaces and at the film in lens space; before the lens in the space of the object, which is the same but for lenses whose object has an axis of its own
/// ([`crate::prescription::ObjectAxis`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TracedRay {
    /// A point on it.
    pub position: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Which way light is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceDirection {
    /// From the object to the film.
    ToFilm,
    /// From the film to the object.
    ToObject,
}

/// Whether apertures count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apertures {
    /// Rims and iris stop light.
    Clip,
    /// Rays pass beyond rims and iris: for analysis and for finding pupils.
    Ignore,
    /// Rims stop light, the iris is fully open (its own rim counts).
    IgnoreIris,
}

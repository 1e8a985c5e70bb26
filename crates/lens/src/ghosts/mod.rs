//! Ghosts: light that is reflected between surfaces of a lens, or between the sensor and a surface, before it reaches the film.
//!
//! Two reflections make a ghost: at `back` light turns towards the object, at `forth`, nearer to the object, it turns again. Every pair of
//! surfaces between different media is one, and every surface with the sensor; four reflections make weaker ones, of which those count that are strong ([`strong_fours`]). [`ParaxialGhost`]
//! tells focus and size by matrices, [`GhostTracer`] follows real rays along any list of reflections, [`BeamGhost`] sums up what a distant source makes of one ghost.
//!
//! Surfaces reflect unpolarised light (the mean of s and p, as everywhere in this crate); the sensor reflects like a mirror, and where it has microlenses like a grating, too ([`Grating`]);
//! light scattered at surfaces, edges and barrel is [`crate::glare`]'s. Light beyond a clear aperture is lost.
//! Sources: Smith, *Modern Optical Engineering* (4th ed.) §11.9 (ghosts by tracing pairs); Hullin et al. 2011, doi
//! 10.1145/2010324.1965003.

mod beam;
mod fours;
mod grating;
mod paraxial;
mod tracer;

pub use beam::{AtSensor, BeamGhost, SourceBeam};
pub use fours::{Four, strong_fours};
pub use grating::{Grating, MICROLENS_FRACTION};
pub use paraxial::ParaxialGhost;
pub(crate) use tracer::SurfaceLight;
pub use tracer::{FilmHit, GhostTracer};

use crate::coating::SurfaceCoating;
use crate::system::System;

/// Reflectance of a sensor where its body tells none: about that of one bare surface of its cover glass, anti-reflection coatings,
/// filters and the silicon beneath taken together. A figure of order, not of a product.
pub const SENSOR_REFLECTANCE: f64 = 0.04;

/// Two surfaces between which light goes back and forth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pair {
    /// Where light turns towards the object: number of the surface, 0 the first; that of all surfaces: the sensor.
    pub back: usize,
    /// Where it turns towards the film again; less than `back`.
    pub forth: usize,
}

impl Pair {
    /// As reports print it, surfaces counted from 1.
    pub fn describe(self, surfaces: usize) -> String {
        let back = if self.back == surfaces { "sensor".into() } else { (self.back + 1).to_string() };
        format!("{back}-{}", self.forth + 1)
    }
}

/// Whether a surface can throw light back that is meant to go through.
pub fn reflects(system: &System, surface: usize) -> bool {
    let s = &system.surfaces[surface];
    let same = system.glasses[surface] == system.glasses[surface + 1];
    !s.mirror && s.coating != SurfaceCoating::Perfect && (!same || matches!(s.coating, SurfaceCoating::Layers(_)))
}

/// Every pair of surfaces of a lens, those with the sensor last.
pub fn pairs(system: &System) -> Vec<Pair> {
    let count = system.surfaces.len();
    let all: Vec<usize> = (0..count).filter(|i| reflects(system, *i)).collect();
    let between = all.iter().flat_map(|back| all.iter().filter(move |f| *f < back).map(|f| Pair { back: *back, forth: *f }));
    between.chain(all.iter().map(|f| Pair { back: count, forth: *f })).collect()
}

#[cfg(test)]
mod tests;

//! The fast trace: packets of rays, structure of arrays, the same steps as [`crate::trace`] for all lanes at once.
//!
//! [`single`] traces 32 rays in f32 (pictures), [`double`] 16 rays in f64 (analysis): two vectors of 16 (8) side by side, because
//! square roots and divisions of one hide the waiting of the other. Spheres and planes on the axis that refract, which most surfaces are, have a kernel of
//! their own (`Refracting`). Products and sums are not fused, so that machines with and without such instructions give the same bits. A lane that is lost goes on with whatever numbers it has and
//! is cleared in the mask that comes back. Indices come from a Chebyshev fit of each glass in 1/λ², so that every lane may have
//! its own wavelength.

mod coated;
mod index_fit;
mod kernel;
mod light;
mod pair;
mod prepared;
mod refracting;
mod shapes;

use crate::aperture::Aperture;
use crate::coating::LightTable;
use crate::coating::film::{FILM_NM, MGF2};
use crate::diffractive::Diffractive;
use crate::forbes::{Forbes, ForbesKind};
use crate::glass::{Glass, GlassKind, VISIBLE_NM};
use crate::iris::Iris;
use crate::polynomial::Polynomial;
use crate::ray::{TraceDirection, TracedRay};
use crate::surface::{Asphere, Profile};
use crate::system::System;
use coated::{Coated, coatings};
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use index_fit::{TERMS, fit};
use kernel::kernel;
use light::light;
use pair::{Double, DoubleMask, Single, SingleMask};
use prepared::prepared;
use refracting::{Rays, Refracting, refract_double, refract_single};
use shapes::shapes;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Newton steps of an aspheric intersection after the conic's; the last ones change nothing a float holds.
const NEWTON_STEPS: usize = 7;

pub(crate) fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}

macro_rules! batch {
    ($module:ident, $float:ident, $lanes:literal, $vector:ident, $mask:ident, $refract:ident, $doc:literal) => {
        #[doc = $doc]
        pub mod $module {
            use super::*;

            prepared!($float, $lanes);
            shapes!($float, $vector, $mask);
            light!($float, $vector);
            kernel!($float, $vector, $mask, $refract);
        }
    };
}

batch!(single, f32, 32, Single, SingleMask, refract_single, "32 rays at once in f32.");
batch!(double, f64, 16, Double, DoubleMask, refract_double, "16 rays at once in f64.");

/// Traces a packet of rays and each of them by the plain trace, which must agree: places and paths to `tolerance` mm, directions to a hundredth of it. Answers
/// with the rays that come through, by their number, where they end, and their optical path.
#[cfg(test)]
pub(crate) fn agreement(
    system: &crate::System,
    n: &[f64],
    ray: impl Fn(usize) -> crate::ray::TracedRay,
    tolerance: f64,
) -> Vec<(usize, crate::ray::TracedRay, f64)> {
    use double::{Batch, Indices, LANES, Packet};
    let mut packet = Packet::default();
    for i in 0..LANES {
        packet.set(i, ray(i).position.to_array(), ray(i).direction.to_array());
    }
    let mask = Batch::new(system).trace(&mut packet, &Indices::uniform(n), crate::ray::TraceDirection::ToFilm);
    let mut through = Vec::new();
    for i in 0..LANES {
        let mut path = 0.0;
        let (way, apertures) = (crate::ray::TraceDirection::ToFilm, crate::ray::Apertures::Clip);
        let plain = system.trace_with(ray(i), n, way, apertures, |e| path += e.path);
        assert_eq!(plain.is_ok(), mask >> i & 1 == 1, "{i}");
        let Ok(plain) = plain else { continue };
        assert!((glam::DVec3::new(packet.x[i], packet.y[i], packet.z[i]) - plain.position).length() < tolerance, "{i}");
        let direction = glam::DVec3::new(packet.dx[i], packet.dy[i], packet.dz[i]);
        assert!((direction - plain.direction).length() < 0.01 * tolerance, "{i}");
        assert!((packet.path[i] - path).abs() < tolerance, "{i}: {} {path}", packet.path[i]);
        through.push((i, plain, path));
    }
    through
}

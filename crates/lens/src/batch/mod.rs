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
use diopter_light::instruction_set;
use fearless_simd::{Simd, dispatch};
use glam::DVec3;
use index_fit::{TERMS, fit};
use kernel::kernel;
use light::light;
use pair::{Double, DoubleMask, Single, SingleMask};
use prepared::prepared;
use refracting::{Rays, Refracting, refract_double, refract_single};
use shapes::shapes;
use std::ops::Range;
use std::sync::Arc;

/// Newton steps of an aspheric intersection after the conic's; the last ones change nothing a float holds.
const NEWTON_STEPS: usize = 7;

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

#[cfg(test)]
mod tests {
    use super::single::{Batch, Indices, LANES, Packet};
    use super::*;
    use crate::compound::{CompoundLens, Setting};
    use crate::prescription::{Prescription, Surface};
    use crate::ray::Apertures;
    use crate::system::State;
    use crate::{BlockedBy, Focus};

    #[test]
    fn light_without_an_index_is_stopped_and_the_rest_passes() {
        // ZnSe has a resonance at 391 nm: no index from 380 nm to about 398 nm.
        let surface = |c: f64, gap: f64, glass: Glass| Surface {
            semi_diameter: Some(10.0),
            ..Surface::new(Profile::Sphere(c), gap, glass)
        };
        let first = Surface { stop: true, ..surface(0.01, 3.0, Glass::parse("ZnSe").unwrap()) };
        let p = Prescription::new("znse", vec![first, surface(-0.002, 50.5, Glass::air())]).checked("znse").unwrap();
        let system = System::at(&p, State::default());
        assert_eq!(system.dark_glass(), None);
        let batch = Batch::new(&system);
        let nm: single::Lanes = std::array::from_fn(|i| 380.0 + 6.0 * i as f32);
        let mut n = Indices::default();
        batch.indices(&nm, &mut n);
        let ray = TracedRay { position: DVec3::new(0.0, 3.0, -5.0), direction: DVec3::Z };
        let mut packet = Packet::default();
        (0..LANES).for_each(|i| packet.set(i, ray.position.as_vec3().to_array(), [0.0, 0.0, 1.0]));
        let mask = batch.trace_light(&mut packet, &n, &nm, TraceDirection::ToFilm);
        for (i, nm) in nm.into_iter().enumerate() {
            let plain = system.trace(ray, &system.indices(f64::from(nm)), TraceDirection::ToFilm, Apertures::Clip);
            assert_eq!(plain.is_ok(), mask >> i & 1 == 1, "{nm} nm");
            assert_eq!(plain.is_ok(), nm > 399.0, "{nm} nm");
            match plain {
                Ok(end) => assert!((end.position.y - f64::from(packet.y[i])).abs() < 1e-5, "{nm} nm"),
                Err(blocked) => assert_eq!(blocked.why, BlockedBy::Opaque),
            }
        }
        // The camera finds its pupil.
        let setting = Setting { focal_length: None, f_number: None, focus: Focus::Infinity, iris: None, film_mm: [12.0, 8.0] };
        let lens = CompoundLens::new(Arc::new(p), &setting).unwrap();
        assert!(lens.t_number() > lens.f_number() && lens.t_number() < 2.0 * lens.f_number(), "T {}", lens.t_number());
        assert_eq!(lens.image_circle_radius(glam::DVec2::X, 7.0), 7.0);
        // Germanium is opaque to all that is seen.
        let first = Surface { stop: true, ..surface(0.01, 3.0, Glass::parse("GERMANIUM").unwrap()) };
        let p = Prescription::new("ge", vec![first, surface(0.005, 50.5, Glass::air())]).checked("ge").unwrap();
        let dark = System::at(&p, State::default()).dark_glass().map(|g| g.written());
        assert_eq!(dark.as_deref(), Some("material/GERMANIUM"));
    }
}

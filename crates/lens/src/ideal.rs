//! The ideal thin lens as a surface of a prescription ("paraxial surface" of Zemax): a plane in air that changes slopes by
//! −φ × place, φ = 1 / focal length, for rays of any height and angle.
//!
//! Slopes are those of Gaussian optics, u' = u − y φ (Welford, "Aberrations of Optical Systems", ch. 3), taken for real rays: planes are
//! imaged into planes, points into points (a collineation). Path: that of a lens that images parallel light from the object's side without
//! aberration, equal from the wave to its focus (Fermat). For light that is not parallel there rays stay exact, but path differences are
//! not those of a perfect image; no length that depends on one ray alone could be that for every object distance.

use glam::{DVec2, DVec3};

/// What an ideal lens makes of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdealRay {
    /// Unit direction after it.
    pub direction: DVec3,
    /// Optical path that it adds, mm.
    pub path: f64,
}

/// A ray of a unit direction that meets the lens at a place; `sense` +1 where light runs along +z, −1 along −z; `towards_film`: whether the
/// ray is followed from the object. `None` for rays that do not run with the light.
#[inline]
pub fn bend(focal_length_mm: f64, place: DVec2, direction: DVec3, sense: f64, towards_film: bool) -> Option<IdealRay> {
    if !(direction.z * sense > 0.0) {
        return None;
    }
    let before = direction.truncate() / direction.z;
    let after = before - place * (sense / focal_length_mm);
    let bent = after.extend(1.0).normalize() * sense;
    // The ray on the object's side, as light runs there.
    let (object_side, run) = if towards_film { (direction, sense) } else { (-bent, -sense) };
    let slope = object_side.truncate() / object_side.z;
    // Where parallel light of this direction meets, along the way of the light.
    let focus = (slope * run).extend(1.0) * focal_length_mm;
    let from_place = (focus - place.extend(0.0)).length();
    let path = focal_length_mm.signum() * (focus.length() - from_place) - object_side.truncate().dot(place);
    Some(IdealRay { direction: bent, path })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::Bench;
    use crate::batch::agreement;
    use crate::prescription::read_toml;
    use crate::ray::{Apertures, TraceDirection, TracedRay};
    use crate::trace::at_plane;
    use crate::{State, System};

    fn lens(extra: &str) -> crate::Prescription {
        let text = format!(
            "name = \"x\"\nsurfaces = [\n{{ stop = true, ideal_focal_length = 50, gap = 50, semi_diameter = 10 }},\n{extra}]\n"
        );
        read_toml(&text, "x.toml").unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn parallel_light_meets_in_a_point_with_equal_paths() {
        let p = lens("");
        let system = System::at(&p, State::default());
        let bench = Bench::at_infinity(&system);
        let first = bench.first_order(550.0);
        assert!((first.efl - 50.0).abs() < 1e-12 && (first.bfl - 50.0).abs() < 1e-12, "{first:?}");
        for field in [0.0, 12.0, 25.0] {
            let spot = bench.spot(field, 550.0, 550.0, 20, 0.0).unwrap();
            // f tan θ, no larger than rounding.
            assert!(spot.rms < 1e-11 && (spot.centroid.y.abs() - 50.0 * field.to_radians().tan()).abs() < 1e-11, "{field}");
            let fan = bench.fan(field, 550.0, 550.0, 8).unwrap();
            // In waves: paths of 50 mm keep 1e-14 of their length.
            assert!(fan.tangential.iter().chain(&fan.sagittal).all(|p| p.opd.abs() < 1e-7), "{field}");
        }
        let back = read_toml(&p.to_toml(), "x.toml").unwrap();
        assert_eq!(back.surfaces[0].ideal_focal_length, Some(50.0));
    }

    #[test]
    fn ways_are_reversible_and_packets_agree() {
        // Behind a real lens, a mirror, and a second ideal lens that diverges.
        let p = lens(
            "{ radius = 80, gap = 5, glass = \"1.6\", semi_diameter = 12 },\n{ radius = -90, gap = 20, semi_diameter = 12 },\n\
             { radius = -400, mirror = true, gap = -30, semi_diameter = 40 },\n{ ideal_focal_length = -120, gap = -25, semi_diameter = 40 },\n",
        );
        let system = System::at(&p, State::default());
        let n = system.indices(550.0);
        let ray = |i: usize| TracedRay {
            position: DVec3::new(i as f64 - 7.0, 0.4 * i as f64 - 3.0, -4.0),
            direction: DVec3::new(0.01 * i as f64 - 0.06, 0.03, 1.0).normalize(),
        };
        let through = agreement(&system, &n, ray, 1e-10);
        for &(i, plain, path) in &through {
            // Back along the same way.
            let turned = TracedRay { position: plain.position + plain.direction * 3.0, direction: -plain.direction };
            let mut back_path = 0.0;
            let out = system.trace_with(turned, &n, TraceDirection::ToObject, Apertures::Clip, |e| back_path += e.path).unwrap();
            let there = at_plane(&out, ray(i).position.z);
            assert!((there - ray(i).position).length() < 1e-9 && (out.direction + ray(i).direction).length() < 1e-11, "{i}");
            // To the first surface: all but the first way in air, and 3 mm more.
            let first = (out.position - ray(i).position).length();
            assert!((back_path - 3.0 - (path - first)).abs() < 1e-9, "{i}: {back_path} {path}");
        }
        assert!(through.len() > 8, "{}", through.len());
    }

    #[test]
    fn ideal_lenses_stand_alone_in_air() {
        let wrong = |surface: &str| {
            let text = format!("name = \"x\"\nf_number = 4\nsurfaces = [\n{{ {surface}, stop = true }},\n{{ gap = 9 }},\n]\n");
            read_toml(&text, "x.toml").unwrap_err().to_string()
        };
        assert!(wrong("ideal_focal_length = 0, gap = 50").contains("ideal_focal_length 0"));
        assert!(wrong("ideal_focal_length = 50, radius = 20, gap = 50").contains("expected a plane"));
        assert!(wrong("ideal_focal_length = 50, gap = 50, glass = \"1.5\"").contains("in air"));
    }
}

//! Surfaces whose coordinate systems turn and shift on the way (Zemax coordinate breaks, CODE V decenters), laid out along one axis.
//!
//! A prescription has one z axis from object to film; each surface may stand decentred and tilted on it. Frames of a file are
//! followed from surface to surface, then written that way; gaps become differences along z. Three cases:
//!
//! - Plane mirrors that fold the axis are unfolded: what follows is reflected in the mirror, which changes no distance and no angle
//!   (the "tunnel diagram" of Smith, "Modern Optical Engineering", chapter on prisms and mirrors). The mirror itself becomes a
//!   window of no effect. Paths are exact; the mirror's loss is not counted and one flip of the picture is missing.
//! - A film that is shifted or tilted against the axis of the object (Scheimpflug, off-axis mirrors): all surfaces are moved
//!   together before the film, as one decentred element.
//! - Curved mirrors whose light comes in at an angle to the film's normal: about their base ray ([`super::off_axis`]).
//! - An axis that something else folds by more than [`STEEPEST_FILM_DEG`]: an error.

use super::off_axis;
use super::placed::{Placed, ROUNDING, half_turn, reversed, rounded, tilts};
use crate::glass::Glass;
use crate::prescription::{Gap, Misalignment, Prescription};
use crate::surface::Profile;
use glam::{DAffine3, DMat3, DVec3};

/// Largest angle between film and object axis that is carried, degrees.
const STEEPEST_FILM_DEG: f64 = 60.0;
/// Direction cosine across the axis of the object from which a film's normal counts as another axis than it.
const ASKEW: f64 = 1e-6;

/// A coordinate system seen from the one before: moved by `decenter`, then turned about its new x, y and z axes (degrees, right-handed).
pub(super) fn moved_then_turned(decenter: DVec3, tilt_deg: [f64; 3]) -> DAffine3 {
    let [a, b, c] = tilt_deg.map(f64::to_radians);
    let turn = DMat3::from_rotation_x(a) * DMat3::from_rotation_y(b) * DMat3::from_rotation_z(c);
    DAffine3 { matrix3: turn, translation: decenter }
}

/// The other order: turned about z, y and x, then moved along the new axes.
pub(super) fn turned_then_moved(decenter: DVec3, tilt_deg: [f64; 3]) -> DAffine3 {
    let [a, b, c] = tilt_deg.map(f64::to_radians);
    let turn = DMat3::from_rotation_z(c) * DMat3::from_rotation_y(b) * DMat3::from_rotation_x(a);
    DAffine3 { matrix3: turn, translation: turn * decenter }
}

/// Along the local axis.
pub(super) fn ahead(gap: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(0.0, 0.0, gap))
}

/// Writes surfaces, film, object distance and notes into `p`. Fails with the line of the file and what is wrong there.
pub(super) fn lay_out(rows: Vec<Placed>, film: DAffine3, p: &mut Prescription) -> Result<(), (usize, String)> {
    let (mut rows, mut film) = (rows, film);
    let folds = unfold(&mut rows, &mut film);
    drop_windows(&mut rows);
    if rows.is_empty() {
        return Err((0, "no surfaces between object and film".into()));
    }
    let curved_mirror = rows.iter().any(|r| r.surface.mirror && r.surface.profile != Profile::Plane);
    let askew = film.matrix3.z_axis.truncate().length() > ASKEW || off_axis::middle_of_fields(p) != 0.0;
    if curved_mirror && askew {
        match off_axis::lay_out(rows, film, p) {
            Ok(()) => {
                note_folds(folds, p);
                return Ok(());
            }
            Err(back) => rows = back,
        }
    }
    let first = &rows[0];
    let line = first.surface.line;
    // The film looks towards the object, whichever way its frame was turned.
    film = facing(film);
    let steep = film.matrix3.z_axis.z.clamp(-1.0, 1.0).acos().to_degrees();
    if steep > STEEPEST_FILM_DEG {
        return Err((
            line,
            format!(
                "the axis is folded by {steep:.1} degrees between object and film by something else than plane mirrors: \
                 expected at most {STEEPEST_FILM_DEG}"
            ),
        ));
    }
    // The axis is the film's where any surface stands straight on it, else the object's.
    let straight = |axis: &DAffine3| {
        let back = axis.inverse();
        rows.iter().filter(|r| is_straight(&(back * r.frame))).count()
    };
    let on_film = straight(&film);
    let by_film = on_film > 0 && on_film >= straight(&DAffine3::IDENTITY);
    if let Some(d) = &mut p.usage.object_distance {
        *d += first.frame.translation.z;
    }
    let back = if by_film { film.inverse() } else { DAffine3::IDENTITY };
    for row in &mut rows {
        row.frame = back * row.frame;
        if row.frame.matrix3.z_axis.z < 0.0 {
            row.turn_over();
        }
    }
    let film = back * film;
    let start = rows[0].frame.translation.z;
    let ends: Vec<f64> = rows.iter().skip(1).map(|r| r.frame.translation.z).chain([film.translation.z]).collect();
    let mut tilted = 0;
    for (row, end) in rows.into_iter().zip(ends) {
        let at = row.frame.translation;
        let mut surface = row.surface;
        surface.gap = Gap::fixed(rounded(end - at.z));
        surface.decenter = [rounded(at.x), rounded(at.y)];
        surface.tilt = tilts(&row.frame.matrix3, surface.looks_round());
        tilted += usize::from(surface.decenter != [0.0; 2] || surface.tilt != [0.0; 3]);
        p.surfaces.push(surface);
    }
    if !is_straight(&film) {
        // Seen from the film: turned back about the first vertex, and moved so that the film's middle lies on the axis.
        let place = film.translation - DVec3::new(0.0, 0.0, start);
        let turn = film.matrix3.transpose();
        let shift = DVec3::new(0.0, 0.0, place.z) - turn * place;
        p.misalignments.push(Misalignment {
            first: 0,
            last: p.surfaces.len() - 1,
            decenter: [rounded(shift.x), rounded(shift.y), rounded(shift.z)],
            tilt: tilts(&turn, false),
        });
        p.notes.push(format!(
            "the film stands {steep:.2} degrees aslant and {:.3} mm beside the object's axis: the lens is moved before it instead, and fields count from the film's axis",
            place.truncate().length()
        ));
    }
    if tilted > 0 {
        p.notes.push(format!("{tilted} surface(s) stand decentred or tilted on the axis, as the file's coordinate systems say"));
    }
    note_folds(folds, p);
    Ok(())
}

fn note_folds(folds: usize, p: &mut Prescription) {
    if folds > 0 {
        let flip = if folds % 2 == 1 { ", and the picture is not mirrored as one of them would" } else { "" };
        p.notes
            .push(format!("{folds} plane mirror(s) that fold the axis are unfolded: their loss of light is not counted{flip}"));
    }
}

/// Reflects in every plane mirror what follows it, if one of them stands aslant; returns how many.
fn unfold(rows: &mut [Placed], film: &mut DAffine3) -> usize {
    let flat_mirror = |r: &Placed| r.surface.mirror && r.surface.profile == Profile::Plane;
    if !rows.iter().any(|r| flat_mirror(r) && r.frame.matrix3.z_axis.truncate().length() > ROUNDING) {
        return 0;
    }
    // A reflection makes frames left-handed; turning their z axes round makes them right-handed again, and surfaces that are even in
    // x and y change their sign.
    let z_reversed = DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
    let mut folds = 0;
    for i in 0..rows.len() {
        if !flat_mirror(&rows[i]) {
            continue;
        }
        let (normal, vertex) = (rows[i].frame.matrix3.z_axis, rows[i].frame.translation);
        let twice = DMat3::from_cols(normal * (2.0 * normal.x), normal * (2.0 * normal.y), normal * (2.0 * normal.z));
        let mirror = DAffine3 { matrix3: DMat3::IDENTITY - twice, translation: normal * (2.0 * normal.dot(vertex)) };
        rows[i].surface.mirror = false;
        folds += 1;
        for row in &mut rows[i + 1..] {
            row.frame = mirror * row.frame * z_reversed;
            row.surface.profile = reversed(&row.surface.profile);
        }
        *film = mirror * *film * z_reversed;
    }
    folds
}

/// Leaves out planes within one medium that neither stop light nor are the stop: folds, and helpers of the file.
fn drop_windows(rows: &mut Vec<Placed>) {
    let mut medium = Glass::air();
    rows.retain(|r| {
        let s = &r.surface;
        let bends = s.profile != Profile::Plane
            || s.glass != medium
            || s.mirror
            || s.ideal_focal_length.is_some()
            || s.diffractive.is_some()
            || s.gradient.is_some();
        medium = s.glass.clone();
        bends || s.stop || r.rim || s.is_obscured_or_limited()
    });
}

/// The same frame with its z axis towards +z.
fn facing(frame: DAffine3) -> DAffine3 {
    if frame.matrix3.z_axis.z >= 0.0 {
        return frame;
    }
    frame * half_turn()
}

fn is_straight(frame: &DAffine3) -> bool {
    let axis = frame.matrix3.z_axis;
    axis.z > 0.0 && axis.truncate().length() < ROUNDING && frame.translation.truncate().length() < 1e3 * ROUNDING
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prescription::Surface;

    fn sphere(c: f64, glass: &str) -> Surface {
        Surface::new(Profile::Sphere(c), 0.0, Glass::parse(glass).unwrap())
    }

    /// A singlet of 50 mm, a mirror at 45 degrees 20 mm behind it, a second singlet 20 mm after that, the film 10 mm behind.
    fn folded(tilt_deg: f64) -> (Vec<Placed>, DAffine3) {
        let turn = moved_then_turned(DVec3::ZERO, [tilt_deg, 0.0, 0.0]);
        let mut mirror = Surface::new(Profile::Plane, 0.0, Glass::air());
        mirror.mirror = true;
        let mut here = DAffine3::IDENTITY;
        let mut rows = vec![];
        let mut place = |surface: Surface, before: DAffine3, after: DAffine3| {
            let frame = here * before;
            here = frame * after;
            rows.push(Placed { surface, frame, rim: false });
            here
        };
        let none = DAffine3::IDENTITY;
        place(sphere(0.02, "1.5"), none, ahead(5.0));
        place(sphere(-0.02, "air"), none, ahead(20.0));
        place(mirror, turn, turn * ahead(-20.0));
        // After a mirror gaps are negative, and a centre that lies behind along the light has a negative radius.
        place(sphere(-0.03, "1.6"), none, ahead(-4.0));
        let film = place(sphere(0.01, "air"), none, ahead(-10.0));
        (rows, film)
    }

    #[test]
    fn a_fold_mirror_gives_the_straight_lens() {
        for tilt in [45.0, -45.0, 30.0] {
            let (rows, film) = folded(tilt);
            let mut p = Prescription::new("folded", vec![]);
            lay_out(rows, film, &mut p).unwrap();
            let curvatures: Vec<f64> = p.surfaces.iter().map(|s| s.profile.curvature()).collect();
            assert_eq!(curvatures, [0.02, -0.02, 0.03, -0.01], "{tilt}");
            for (s, gap) in p.surfaces.iter().zip([5.0, 40.0, 4.0, 10.0]) {
                assert!((s.gap.at(0.0, 0.0) - gap).abs() < 1e-9, "{tilt}: {s:?}");
                assert_eq!((s.decenter, s.tilt), ([0.0; 2], [0.0; 3]), "{tilt}");
            }
            assert!(p.misalignments.is_empty() && p.notes.iter().any(|n| n.contains("1 plane mirror")), "{:?}", p.notes);
        }
    }

    #[test]
    fn a_tilted_element_keeps_its_place_and_the_film_too() {
        // One surface decentred by 2 mm and tilted by 10 degrees between two straight ones.
        let there = moved_then_turned(DVec3::new(0.0, 2.0, 0.0), [10.0, 0.0, 0.0]);
        let rows = vec![
            Placed { surface: sphere(0.02, "1.5"), frame: DAffine3::IDENTITY, rim: false },
            Placed { surface: sphere(-0.02, "1.6"), frame: ahead(5.0) * there, rim: false },
            Placed { surface: sphere(-0.01, "air"), frame: ahead(8.0), rim: false },
        ];
        let mut p = Prescription::new("tilted", vec![]);
        lay_out(rows, ahead(50.0), &mut p).unwrap();
        assert_eq!(p.surfaces[0].tilt, [0.0; 3]);
        assert!((p.surfaces[1].decenter[1] - 2.0).abs() < 1e-12 && (p.surfaces[1].tilt[0] - 10.0).abs() < 1e-9);
        let gaps: Vec<f64> = p.surfaces.iter().map(|s| s.gap.at(0.0, 0.0)).collect();
        assert!(gaps.iter().zip([5.0, 3.0, 42.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{gaps:?}");
        assert!(p.misalignments.is_empty());
    }

    #[test]
    fn a_tilted_film_moves_the_lens_before_it() {
        let film = ahead(60.0) * moved_then_turned(DVec3::new(0.0, 3.0, 0.0), [8.0, 0.0, 0.0]);
        let rows = || {
            vec![
                Placed { surface: sphere(0.02, "1.5"), frame: DAffine3::IDENTITY, rim: false },
                Placed { surface: sphere(-0.02, "air"), frame: ahead(5.0), rim: false },
            ]
        };
        let mut p = Prescription::new("scheimpflug", vec![]);
        lay_out(rows(), film, &mut p).unwrap();
        // The lens stands straight in itself, and as far from the film as before.
        assert!(p.surfaces.iter().all(|s| s.decenter == [0.0; 2] && s.tilt == [0.0; 3]));
        let system = crate::system::System::at(&p, crate::system::State::default());
        let vertex = system.surfaces[0].to_lens(DVec3::ZERO, DVec3::Z);
        let expected = film.inverse();
        let there = expected.transform_point3(DVec3::ZERO) + DVec3::new(0.0, 0.0, system.film_z);
        assert!((vertex.0 - there).length() < 1e-9, "{} {there}", vertex.0);
        assert!((vertex.1 - expected.transform_vector3(DVec3::Z)).length() < 1e-12);
        // By 90 degrees it is refused.
        let film = ahead(60.0) * moved_then_turned(DVec3::ZERO, [90.0, 0.0, 0.0]);
        let e = lay_out(rows(), film, &mut Prescription::new("x", vec![])).unwrap_err();
        assert!(e.1.contains("folded by 90.0 degrees"), "{}", e.1);
    }

    #[test]
    fn tilts_and_frames_are_one_another() {
        for tilt in [[10.0, -20.0, 30.0], [-5.0, 0.0, 170.0], [0.0, 80.0, -45.0], [0.0, 90.0, 25.0], [0.0, -90.0, -70.0]] {
            let found = tilts(&moved_then_turned(DVec3::ZERO, tilt).matrix3, false);
            assert!(found.iter().zip(tilt).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {tilt:?}");
        }
        // The two orders undo one another with the signs reversed.
        let (d, t) = (DVec3::new(1.0, -2.0, 0.5), [10.0, 20.0, 30.0]);
        let both = moved_then_turned(d, t) * turned_then_moved(-d, t.map(|v| -v));
        assert!((both.transform_point3(DVec3::ONE) - DVec3::ONE).length() < 1e-12);
    }
}

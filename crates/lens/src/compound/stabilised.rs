//! A group of a lens moved across the axis, film, focus and iris as they are: what an optical image stabiliser does during an exposure.
//!
//! The group stands decentred like an element that is out of place ([`Misalignment`]), so that rays, pupils, vignetting and aberrations are those of the lens with its group there. The camera
//! stays where it stood: rays count from the middle of the entrance pupil of the lens with its group on the axis.

use super::{CompoundLens, geometry};
use crate::batch::single::Batch;
use crate::prescription::Misalignment;
use crate::pupil::{PupilDetail, PupilTable};
use crate::system::System;
use crate::{Blocked, Focus, LensError, LensRay};
use diopter_light::units::Millimeters;
use glam::{DMat2, DVec2};
use std::sync::Arc;

/// How far something is moved each way to see what it does, mm: far above what rounding and the middles of pupils add, far below the curvature of the effect.
const PROBE_MM: f64 = 0.1;
/// Plane in which directions are compared where the focus is at infinity, mm.
const FAR_MM: f64 = 1e6;

impl CompoundLens {
    /// The lens with the surfaces `first` to `last` (from 0, as the prescription counts) moved across the axis, mm to the right and up in the lens's frame. Fails where there are no such surfaces, and
    /// where light no longer finds its way.
    pub fn with_group_at(&self, [first, last]: [usize; 2], decenter: DVec2) -> Result<CompoundLens, LensError> {
        self.check_group([first, last])?;
        let mut prescription = (*self.prescription).clone();
        let decenter = decenter.extend(0.0).to_array();
        prescription.misalignments.push(Misalignment { first, last, decenter, tilt: [0.0; 3] });
        let mut system = System::at(&prescription, self.state);
        system.film_z = self.system.film_z;
        system.iris = self.system.iris.clone();
        self.tilt.apply(&mut system, self.turned.pivot_z);
        let batch = Batch::new(&system);
        let half = 0.5 * DVec2::from_array(self.setting.film_mm);
        let middle = self.turned.pupil_center_slope(system.film_z, system.film_run());
        let Some(geometry) = geometry(&system, &batch, &self.first, middle, half) else {
            let (found, expected) = (format!("{first} to {last}"), "a film behind the last surface".into());
            return Err(LensError::Setting { what: "moved group", found, expected });
        };
        let pupils = PupilTable::new(&geometry, PupilDetail::Draft);
        Ok(CompoundLens { prescription: Arc::new(prescription), system, batch, pupils, ..self.clone() })
    }

    /// Fails unless there are such surfaces (from 0).
    fn check_group(&self, [first, last]: [usize; 2]) -> Result<(), LensError> {
        let count = self.prescription.surfaces.len();
        match first <= last && last < count {
            true => Ok(()),
            false => Err(LensError::Setting {
                what: "moved group",
                found: format!("surfaces {} to {}", first.wrapping_add(1), last.wrapping_add(1)),
                expected: format!("the first and the last of 1 to {count}"),
            }),
        }
    }

    /// What a group does to the picture in the middle of the film: how far the image of what is in focus moves on the film (mm) for each mm of the group, and how far the direction that the
    /// middle sees moves (tangents) for each mm of the group; columns: the group to the right, and up. Fails as [`CompoundLens::with_group_at`].
    pub fn group_effect(&self, group: [usize; 2]) -> Result<[DMat2; 2], LensError> {
        let distance = match self.setting.focus {
            Focus::Distance(distance) => Some(distance),
            _ => self.focus_distance(),
        };
        let by_group = tangents_by(distance, |d| Ok(self.with_group_at(group, d)?.chief_ray(DVec2::ZERO)))?;
        let by_film = tangents_by(distance, |d| Ok(self.chief_ray(d)))?;
        // The image moves to the film point that now sees what the middle saw.
        Ok([-(by_film.inverse() * by_group), by_group])
    }
}

/// How far the direction from the camera's place to a point of the plane in focus (`None`: at infinity) moves, as tangents, for each mm that something moves to the right and up (columns); `chief`: the chief ray
/// with it moved. Fails as that does, and where no light comes through.
pub fn tangents_by(
    focus: Option<Millimeters>,
    chief: impl Fn(DVec2) -> Result<Result<LensRay, Blocked>, LensError>,
) -> Result<DMat2, LensError> {
    let distance = focus.map_or(FAR_MM, |d| d.0);
    let seen = |moved: DVec2| -> Result<DVec2, LensError> {
        let ray = chief(moved)?.map_err(|_| LensError::Setting {
            what: "stabiliser",
            found: "no light in the middle of the film".into(),
            expected: "a lens with a picture in the middle of the film, also with its group moved".into(),
        })?;
        let at = ray.origin_mm + ray.direction * ((-distance - ray.origin_mm.z) / ray.direction.z);
        Ok(at.truncate() / distance)
    };
    let column =
        |axis: DVec2| -> Result<DVec2, LensError> { Ok((seen(axis * PROBE_MM)? - seen(axis * -PROBE_MM)?) / (2.0 * PROBE_MM)) };
    Ok(DMat2::from_cols(column(DVec2::X)?, column(DVec2::Y)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compound::Setting;
    use crate::embedded;

    fn lens(name: &str, focal_length: Option<f64>) -> CompoundLens {
        let setting = Setting { focal_length, f_number: Some(8.0), focus: Focus::Infinity, iris: None, film_mm: [22.0, 15.0] };
        CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()
    }

    #[test]
    fn the_whole_lens_moves_the_picture_with_it_and_a_flat_plate_does_not() {
        let lens = lens("double-gauss-50mm", None);
        let all = [0, lens.prescription().surfaces.len() - 1];
        let [image, direction] = lens.group_effect(all).unwrap();
        // What is far away keeps its place before the lens.
        assert!((image - DMat2::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 2e-3), "{image}");
        let focal = lens.focal_length().0;
        assert!((direction.x_axis.x * focal - 1.0).abs() < 2e-3, "{direction}");
        let moved = lens.with_group_at(all, DVec2::new(0.5, 0.0)).unwrap();
        let (a, b) = (lens.chief_ray(DVec2::new(-0.5, 2.0)).unwrap(), moved.chief_ray(DVec2::new(0.0, 2.0)).unwrap());
        assert!((a.direction - b.direction).length() < 1e-4, "{} {}", a.direction, b.direction);
    }

    #[test]
    fn a_group_shifts_the_picture_by_its_magnifications() {
        // A thin group of magnification m before others that magnify by M together moves the image by (1 − m) M: found by first-order rays through the parts.
        let lens = lens("kit-zoom-18-55mm", Some(53.0));
        let group = lens.prescription().stabiliser.expect("the lens has one");
        let [image, _] = lens.group_effect(group).unwrap();
        let (system, n) = (&lens.system, &lens.reference);
        // An axial ray of slope u before the group, u' after it and u'' at the film: m = u / u', M = u' / u''.
        let trace = crate::paraxial::Trace::axial(system, n);
        let [before, after, film] = [group[0], group[1] + 1, system.surfaces.len()].map(|k| trace.angles[k]);
        let expected = (1.0 - before / after) * (after / film);
        let found = image.x_axis.x;
        assert!((found - expected).abs() < 0.01 * expected.abs(), "{found} {expected}");
        assert!(image.x_axis.y.abs() < 1e-3 && (image.y_axis.y - found).abs() < 2e-3);
    }

    #[test]
    fn surfaces_that_are_not_there_are_refused() {
        let lens = lens("tessar-50mm-f2.8", None);
        for group in [[3, 2], [0, 99]] {
            assert!(lens.with_group_at(group, DVec2::X).unwrap_err().to_string().contains("of 1 to"));
        }
    }
}

//! A traced lens turned against the film: a lens board that is tilted or swung.
//!
//! The lens turns about its rear principal point, which in air is its rear nodal point, and the film stays. A distant scene then keeps its place on the film (the
//! principle of swing-lens panoramic cameras) and only the plane of focus turns: it goes through the line in which the film plane meets the rear principal
//! plane, moved by the hiatus between the principal planes (Scheimpflug 1904), and through the hinge line, in which the front focal plane meets the plane through
//! the front nodal point parallel to the film (Merklinger, "Focusing the View Camera", 1992). Tilt-shift lenses turn about a point near their mount instead: that is
//! the same turn and a shift of the film beside it, which `shift` gives.
//!
//! All surfaces stand in frames of their own, as decentred ones do, so that rays, pupils, light and aberrations are those of the turned lens; nothing here is
//! an approximation but where the camera is said to stand (the paraxial entrance pupil) and the closed form of the plane of focus.

use crate::LensError;
use crate::paraxial::FirstOrder;
use crate::system::System;
use crate::thin;
use glam::{DAffine3, DQuat, DVec2, DVec3};

/// How a lens is turned against its film.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tilt(pub [f64; 2]);

impl Tilt {
    /// Fails beyond what [`thin::MOST_TILT`] allows.
    pub fn new(angles: [f64; 2]) -> Result<Tilt, LensError> {
        thin::check_tilt(angles)?;
        Ok(Tilt(angles))
    }

    /// Whether the lens is not turned.
    pub fn is_none(self) -> bool {
        self.0 == [0.0; 2]
    }

    /// Lens axes as they stand before the film.
    pub fn turn(self) -> DQuat {
        thin::turn(self.0)
    }

    /// Cosine between the lens's axis and the camera's.
    pub fn foreshortening(self) -> f64 {
        self.0[0].cos() * self.0[1].cos()
    }

    /// Turns all surfaces of a system about a place on the axis (mm from the first vertex).
    pub fn apply(self, system: &mut System, pivot_z: f64) {
        if self.is_none() {
            return;
        }
        let pivot = DVec3::Z * pivot_z;
        let moved = DAffine3::from_translation(pivot) * DAffine3::from_quat(self.turn()) * DAffine3::from_translation(-pivot);
        for s in &mut system.surfaces {
            let before = s.frame.as_ref().map_or(DAffine3::from_translation(DVec3::Z * s.z), |f| f.0);
            let frame = moved * before;
            s.frame = Some(Box::new((frame, frame.inverse())));
        }
    }
}

/// Gauss's description of a turned lens: what is known of it on its own axis, and where that stands before the film.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turned {
    /// Of the lens on its own axis.
    straight: FirstOrder,
    tilt: Tilt,
    /// Where it turns, mm from the first vertex.
    pub pivot_z: f64,
}

impl Turned {
    /// `straight`: first-order data, which surfaces' frames do not change. Fails on lenses without the points that a turn is about.
    pub fn new(system: &System, straight: FirstOrder, openings_alone: bool, tilt: Tilt) -> Result<Turned, LensError> {
        // Openings alone bend nothing: a pinhole plate turns about its hole.
        let pivot_z = if openings_alone { system.surfaces[system.stop].z } else { straight.rear_principal_z };
        let known = pivot_z.is_finite() && straight.entrance_pupil_z.is_finite() && system.object_axis.is_none();
        match tilt.is_none() || known {
            true => Ok(Turned { straight, tilt, pivot_z }),
            false => Err(LensError::Setting {
                what: "tilt",
                found: format!("{:.3}, {:.3} degrees", tilt.0[0].to_degrees(), tilt.0[1].to_degrees()),
                expected: "none: this lens is telecentric towards the scene, or has no axis with principal points to turn about"
                    .into(),
            }),
        }
    }

    /// A place on the lens's own axis (mm from the first vertex) as it stands before the film.
    pub fn on_axis(&self, z: f64) -> DVec3 {
        if self.tilt.is_none() {
            return DVec3::Z * z;
        }
        DVec3::Z * self.pivot_z + self.tilt.turn() * (DVec3::Z * (z - self.pivot_z))
    }

    /// Middle of the entrance pupil: where the camera stands.
    pub fn entrance_pupil(&self) -> DVec3 {
        self.on_axis(self.straight.entrance_pupil_z)
    }

    /// First-order data with the places of the pupils along the camera's axis.
    pub fn first_order(&self) -> FirstOrder {
        if self.tilt.is_none() {
            return self.straight;
        }
        let exit_pupil_z = match self.straight.exit_pupil_z {
            z if z.is_finite() => self.on_axis(z).z,
            z => z,
        };
        FirstOrder { entrance_pupil_z: self.entrance_pupil().z, exit_pupil_z, ..self.straight }
    }

    /// Slope towards the middle of the exit pupil from the middle of a film at a place on the camera's axis; `run` as [`System::film_run`].
    pub fn pupil_center_slope(&self, film_z: f64, run: f64) -> DVec2 {
        let towards = match self.straight.exit_pupil_z {
            z if z.is_finite() => self.on_axis(z) - DVec3::Z * film_z,
            // Telecentric: along the lens's axis.
            _ => self.tilt.turn() * DVec3::Z,
        };
        let slope = towards.truncate() / (-run * towards.z);
        if self.tilt.is_none() || !slope.is_finite() { DVec2::ZERO } else { slope }
    }

    /// Extension of the film (mm, along the camera's axis) for what lies at a distance from the entrance pupil along that axis, mm. `far`: at infinity focus.
    ///
    /// The object lies x = F − E + s c before the front focal point along the lens's axis, with c the cosine of the tilt, F the front focal point, E the entrance
    /// pupil; by the nodal points its image lies f (s + (N − E) c) / x behind the rear principal point along the camera's axis, that of a distant one f / c.
    /// Their difference is the extension; without tilt it is Newton's f² / x.
    pub fn extension_at(&self, distance: f64) -> f64 {
        let (f, c, gap) = self.figures();
        f * (f * c * c - gap * (1.0 - c * c)) / (c * (gap + distance * c))
    }

    /// The other way round: distance from the entrance pupil (mm) that an extension (mm) is focused to.
    pub fn distance_of(&self, extension: f64) -> f64 {
        let (f, c, gap) = self.figures();
        (f * (f * c * c - gap * (1.0 - c * c)) / (c * extension) - gap) / c
    }

    /// Focal length, cosine of the tilt, and the way from the entrance pupil to the front focal point, mm.
    fn figures(&self) -> (f64, f64, f64) {
        (self.straight.efl, self.tilt.foreshortening(), self.straight.ffl - self.straight.entrance_pupil_z)
    }

    /// Where in the scene the image of a film point comes from, by Gauss's formulas, mm from the entrance pupil; `None` at infinity. Behind the lens
    /// (z > 0) where its rays do not meet before it.
    pub fn conjugate(&self, film: DVec3) -> Option<DVec3> {
        let axis = self.tilt.turn() * DVec3::Z;
        let from_principal = film - self.on_axis(self.pivot_z);
        let f = self.straight.efl;
        let behind = from_principal.dot(axis) - f;
        let nodal = self.on_axis(self.straight.front_principal_z);
        (behind.abs() > 1e-9 * f).then(|| nodal - from_principal * (f / behind) - self.entrance_pupil())
    }

    /// The plane that the film is the image of: a point of it and its unit normal, mm from the entrance pupil. `None` at infinity.
    pub fn plane_of_focus(&self, film_z: f64) -> Option<[DVec3; 2]> {
        let reach = 0.1 * self.straight.efl;
        let [a, b, c] = [DVec2::ZERO, DVec2::X * reach, DVec2::Y * reach].map(|at| self.conjugate(at.extend(film_z)));
        let (a, b, c) = (a?, b?, c?);
        Some([a, (b - a).cross(c - a).try_normalize()?])
    }
}

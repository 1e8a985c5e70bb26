//! Lenses: a film point and a place in the pupil become a ray towards the scene, or are blocked.
//!
//! Millimetres, f64. +z is the way light travels from the object to the film; z = 0 is the first vertex of a prescription, the
//! plane of a thin lens. What counts light is [`LensRay::weight_sr`]: the irradiance of a film point is the mean over pupil
//! samples of radiance × weight.
//!
//! From a file to a picture: [`import`] or [`prescription`] → checked [`Prescription`] → [`System`] (a focus and zoom position,
//! ready to trace) → [`CompoundLens`] (aperture and focus set, pupils known). [`trace`] is the plain trace and the reference;
//! [`batch`] the fast one; [`diffraction`] what the aperture does to the light on the film; [`coating`]: thin films on its surfaces; [`ghosts`]: light
//! they throw back; [`glare`]: light they scatter.
//!
//! Begin with [`Prescription`], [`CompoundLens`] and, for the optical bench, [`analysis::Bench`]. Not here: scenes, films and their pixels, polarisation.

pub mod analysis;
pub mod aperture;
mod asphere;
mod at_stop;
pub mod batch;
mod bundle;
pub mod calibrated;
pub mod camera_model;
pub mod coating;
pub mod compound;
pub mod conjugates;
mod derivatives;
pub mod diffraction;
pub mod diffractive;
pub mod draw;
pub mod dual;
pub mod export;
mod f_number;
mod fan;
pub mod focusing;
pub mod forbes;
pub mod freeform;
pub mod ghosts;
pub mod glare;
pub mod glass;
pub mod gradient;
pub mod ideal;
pub mod import;
mod iris;
mod lenses;
mod linear;
pub mod microlens;
pub mod optimise;
pub mod paraxial;
pub mod polynomial;
pub mod prescription;
pub mod pupil;
pub mod ray;
pub mod surface;
pub mod system;
mod thin;
pub mod tolerance;
mod toml_place;
pub mod trace;

pub use calibrated::CalibratedLens;
pub use coating::Coating;
pub use compound::CompoundLens;
pub use diffraction::Diffraction;
pub use fan::Fan;
pub use iris::Iris;
pub use lenses::{embedded, embedded_names};
pub use prescription::{Prescription, PrescriptionError};
pub use system::{State, System};
pub use thin::{Pinhole, Projection, ThinEntry, ThinLens};

use diopter_light::units::{Millimeters, shown};
use glam::{DVec2, DVec3};

/// Where the lens is focused, measured from the lens plane (of a real lens: from its entrance pupil).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focus {
    /// Parallel rays meet on the film.
    Infinity,
    /// The plane at this distance is sharp.
    Distance(Millimeters),
    /// The film stands so far behind its place for infinity: what a focusing drive moves. A little below 0 is beyond infinity. A lens
    /// that focuses by moving groups takes it for the film displacement of a lens of the same focal length that moves as a whole.
    Extension(Millimeters),
}

impl Focus {
    /// At a distance in mm; from a million kilometres on infinity.
    pub fn at_mm(distance: f64) -> Focus {
        if distance >= 1e12 { Focus::Infinity } else { Focus::Distance(Millimeters(distance)) }
    }
}

/// A ray that leaves the lens on the object side, in lens space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensRay {
    /// A point on it, mm.
    pub origin_mm: DVec3,
    /// Unit direction towards the scene (z < 0).
    pub direction: DVec3,
    /// Pupil area × cos θ cos θ' / d², sr: what its radiance contributes to the irradiance of the film point.
    pub weight_sr: f64,
}

/// Light that is lost on its way: counted, never an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocked {
    /// Number of the surface, from the object side, 0 the first.
    pub surface: usize,
    /// What happened there.
    pub why: BlockedBy,
}

/// What keeps a ray from passing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BlockedBy {
    /// It went outside the clear aperture or the stop.
    Clipped,
    /// It did not meet the surface.
    Missed,
    /// Total internal reflection, or an order that a diffractive surface does not send out.
    TotalReflection,
    /// The glass before or behind the surface has no index at this wavelength: it absorbs the light.
    Opaque,
}

impl std::fmt::Display for BlockedBy {
    /// What happened to the ray, in words: "it missed the surface".
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            BlockedBy::Clipped => "it went outside the clear aperture or the stop",
            BlockedBy::Missed => "it missed the surface",
            BlockedBy::TotalReflection => "the surface let no light of it through (total reflection)",
            BlockedBy::Opaque => "a glass beside the surface has no index at this wavelength",
        })
    }
}

/// A lens.
#[derive(Clone, Debug, PartialEq)]
pub enum Lens {
    /// Everything sharp; the f-number only measures light.
    Pinhole(Pinhole),
    /// Gauss's ideal lens with a pupil in its plane.
    Thin(ThinLens),
    /// A prescription, surface by surface.
    Compound(Box<CompoundLens>),
    /// An ideal camera that sees as a calibration says.
    Calibrated(Box<CalibratedLens>),
}

impl Lens {
    /// Focal length, mm.
    pub fn focal_length(&self) -> Millimeters {
        match self {
            Lens::Pinhole(lens) => lens.film_distance,
            Lens::Thin(lens) => lens.focal_length,
            Lens::Compound(lens) => lens.focal_length(),
            Lens::Calibrated(lens) => lens.focal_length(),
        }
    }

    /// f-number: focal length over diameter of the entrance pupil.
    pub fn f_number(&self) -> f64 {
        match self {
            Lens::Pinhole(lens) => lens.f_number,
            Lens::Thin(lens) => lens.f_number,
            Lens::Compound(lens) => lens.f_number(),
            Lens::Calibrated(lens) => lens.f_number(),
        }
    }

    /// f-number of the lens fully open; an ideal lens, which has no glass that would say so, is taken for a fast prime (f/1.4).
    pub fn widest_f_number(&self) -> f64 {
        match self {
            Lens::Compound(lens) => lens.widest_f_number(),
            other => other.f_number().min(1.4),
        }
    }

    /// f-number of a lossless lens as bright on the axis.
    pub fn t_number(&self) -> f64 {
        match self {
            Lens::Compound(lens) => lens.t_number(),
            other => other.f_number(),
        }
    }

    /// Distance of the sharp plane, mm; `None` for infinity (or beyond) and for a pinhole, which has no such plane.
    pub fn focus_distance(&self) -> Option<Millimeters> {
        match self {
            Lens::Pinhole(_) => None,
            Lens::Thin(lens) => lens.focus_distance(),
            Lens::Compound(lens) => lens.focus_distance(),
            Lens::Calibrated(lens) => lens.focus_distance(),
        }
    }

    /// Whether nothing is out of focus, or all is alike: a hole, openings alone, or a calibrated camera without a pupil.
    pub fn is_sharp_everywhere(&self) -> bool {
        match self {
            Lens::Pinhole(_) => true,
            Lens::Calibrated(lens) => lens.pupil().is_none(),
            Lens::Compound(lens) => lens.prescription().is_openings_alone(),
            Lens::Thin(_) => false,
        }
    }

    /// How far the film stands behind its place for infinity, mm: the other way to say where a lens is focused.
    pub fn extension(&self) -> Millimeters {
        match self {
            Lens::Pinhole(_) => Millimeters(0.0),
            Lens::Thin(lens) => Millimeters(lens.film_distance().0 - lens.film_at_infinity()),
            Lens::Compound(lens) => lens.extension(),
            Lens::Calibrated(lens) => lens.extension(),
        }
    }

    /// The same lens focused elsewhere. Fails on what it cannot focus to; a pinhole stays as it is.
    pub fn refocused(&self, focus: Focus) -> Result<Lens, LensError> {
        Ok(match self {
            Lens::Pinhole(lens) => Lens::Pinhole(*lens),
            Lens::Thin(lens) => {
                let changed = ThinLens::new(lens.focal_length, lens.f_number, lens.iris.clone(), focus)?;
                Lens::Thin(changed.tilted(lens.tilt)?)
            }
            Lens::Compound(lens) => Lens::Compound(Box::new(lens.refocused(focus)?)),
            Lens::Calibrated(lens) => Lens::Calibrated(Box::new(lens.refocused(focus)?)),
        })
    }

    /// [`Lens::refocused`] by the film's place (mm behind that for infinity), quickly: for probes ([`CompoundLens::with_extension`]). Fails as that.
    pub fn with_extension(&self, extension: f64) -> Result<Lens, LensError> {
        match self {
            Lens::Compound(lens) => Ok(Lens::Compound(Box::new(lens.with_extension(extension)?))),
            other => other.refocused(Focus::Extension(Millimeters(extension))),
        }
    }

    /// The same lens at another f-number. Fails on a number that is not positive, and where the lens opens no wider.
    pub fn stopped(&self, f_number: f64) -> Result<Lens, LensError> {
        Ok(match self {
            Lens::Pinhole(lens) => {
                Lens::Pinhole(Pinhole { projection: lens.projection, ..Pinhole::new(lens.film_distance, f_number)? })
            }
            Lens::Thin(lens) => {
                let changed = ThinLens::new(lens.focal_length, f_number, lens.iris.clone(), lens.focus)?;
                Lens::Thin(changed.tilted(lens.tilt)?)
            }
            Lens::Compound(lens) => Lens::Compound(Box::new(lens.stopped(f_number)?)),
            Lens::Calibrated(lens) => Lens::Calibrated(Box::new(lens.stopped(f_number)?)),
        })
    }

    /// 1 / distance from the film to the exit pupil, 1/mm: with it the slope of a ray at the film tells its place in the pupil
    /// ([`pupil`]).
    pub fn exit_curvature(&self) -> f64 {
        match self {
            Lens::Pinhole(lens) => 1.0 / lens.film_distance.0,
            Lens::Thin(lens) => 1.0 / lens.film_distance().0,
            Lens::Compound(lens) => lens.pupils().curvature,
            Lens::Calibrated(lens) => 1.0 / lens.focal_length().0,
        }
    }

    /// Slope towards the middle of the exit pupil from the middle of the film: 0 but for a tilted lens.
    pub fn pupil_center_slope(&self) -> DVec2 {
        match self {
            Lens::Compound(lens) => lens.pupil_center_slope(),
            _ => DVec2::ZERO,
        }
    }

    /// Whether the lens is turned against the film.
    pub fn is_tilted(&self) -> bool {
        match self {
            Lens::Thin(lens) => lens.is_tilted(),
            Lens::Compound(lens) => lens.is_tilted(),
            _ => false,
        }
    }

    /// Unit vector along the lens's own axis, towards the film: +z but for a tilted lens.
    pub fn axis(&self) -> DVec3 {
        match self {
            Lens::Thin(lens) => lens.turned(DVec3::Z),
            Lens::Compound(lens) => lens.axis(),
            _ => DVec3::Z,
        }
    }

    /// The same lens turned against the film, forward (its axis downward in the scene) and to the right, rad: [`ThinLens::tilted`],
    /// [`CompoundLens::tilted`]. Fails on lenses that have no plane of focus to turn.
    pub fn tilted(&self, tilt: [f64; 2]) -> Result<Lens, LensError> {
        match self {
            Lens::Thin(lens) => Ok(Lens::Thin(lens.clone().tilted(tilt)?)),
            Lens::Compound(lens) => Ok(Lens::Compound(Box::new(lens.tilted(tilt)?))),
            Lens::Pinhole(_) | Lens::Calibrated(_) if tilt == [0.0; 2] => Ok(self.clone()),
            Lens::Pinhole(_) | Lens::Calibrated(_) => Err(LensError::Setting {
                what: "tilt",
                found: format!("{},{} degrees", tilt[0].to_degrees(), tilt[1].to_degrees()),
                expected: "a thin or a traced lens: what is sharp everywhere, or sees as a calibration says, has no plane of focus to turn".into(),
            }),
        }
    }

    /// Farthest place of the exit pupil from the axis, as the slope of a ray from the middle of the film; a pinhole's is that of the hole
    /// its light is counted for.
    pub fn pupil_reach(&self) -> f64 {
        match self {
            Lens::Pinhole(lens) => 0.5 / lens.f_number,
            Lens::Thin(lens) => lens.radius() * lens.iris.reach() / lens.film_distance().0,
            Lens::Compound(lens) => lens.pupils().reach(),
            Lens::Calibrated(lens) => lens.pupil_reach(),
        }
    }

    /// Radius over distance of the round exit pupil that the f-number stands for, seen from the middle of the film.
    pub fn pupil_slope(&self) -> f64 {
        match self {
            Lens::Pinhole(lens) => 0.5 / lens.f_number,
            Lens::Thin(lens) => lens.radius() / lens.film_distance().0,
            Lens::Compound(lens) => lens.pupil_slope(),
            Lens::Calibrated(lens) => 0.5 / lens.f_number(),
        }
    }

    /// How far the pupil that a film point (mm, lens axes) sees reaches from the place of its middle on the axis, in some directions (unit vectors, lens axes), in radii of
    /// the round pupil ([`Lens::pupil_slope`]): the support function of its hull. 1 everywhere but where blades are straight or rims cut the pupil; `None` where no light arrives.
    pub fn pupil_extents(&self, film_mm: DVec2, directions: &[DVec2]) -> Option<Vec<f64>> {
        let support = |corners: &[DVec2], scale: f64| {
            let farthest = |d: &DVec2| corners.iter().map(|c| c.dot(*d)).fold(f64::NEG_INFINITY, f64::max) * scale;
            directions.iter().map(farthest).collect()
        };
        match self {
            Lens::Compound(lens) => {
                let corners: Vec<DVec2> = lens.pupils().outline(film_mm).collect();
                (!corners.is_empty()).then(|| support(&corners, 1.0 / lens.pupil_slope()))
            }
            Lens::Thin(lens) => match &lens.iris {
                Iris::Round => Some(vec![1.0; directions.len()]),
                Iris::Blades(blades) => Some(support(blades.outline(), 1.0)),
                // The square around the disk.
                Iris::Image(_) => Some(directions.iter().map(|d| d.abs().element_sum()).collect()),
            },
            _ => Some(vec![1.0; directions.len()]),
        }
    }

    /// The ray from a film point in a direction, given as its slope towards the lens. Its weight counts for a unit of slope:
    /// [`Lens::ray`]'s is the integral over all slopes that pass. A pinhole lets no such ray through, nor does a calibrated camera, which
    /// has no light between film and pupil. `film_mm` in mm; `Err` where the light is blocked.
    pub fn ray_along(&self, film_mm: DVec2, slope: DVec2) -> Result<LensRay, Blocked> {
        match self {
            Lens::Pinhole(_) | Lens::Calibrated(_) => Err(Blocked { surface: 0, why: BlockedBy::Clipped }),
            Lens::Thin(lens) => lens.ray_along(film_mm, slope),
            Lens::Compound(lens) => lens.ray_along(film_mm, slope, compound::REFERENCE_NM),
        }
    }

    /// The ray from a film point (mm, lens axes: the picture on the film is upside down) through the place of the pupil
    /// that belongs to `u` in the unit square. `Err` where the light is blocked, or a calibrated camera sees nothing; never of a pinhole or thin lens.
    pub fn ray(&self, film_mm: DVec2, u: [f32; 2]) -> Result<LensRay, Blocked> {
        match self {
            Lens::Pinhole(lens) => Ok(lens.ray(film_mm)),
            Lens::Thin(lens) => Ok(lens.ray(film_mm, lens.iris.sample(u))),
            Lens::Compound(lens) => lens.ray(film_mm, u, compound::REFERENCE_NM),
            Lens::Calibrated(lens) => lens.ray_of(film_mm, u),
        }
    }

    /// The ray through the middle of the pupil. `film_mm` as for [`Lens::ray`]; `Err` where no light passes, or a calibrated camera sees nothing.
    pub fn chief_ray(&self, film_mm: DVec2) -> Result<LensRay, Blocked> {
        match self {
            Lens::Pinhole(lens) => Ok(lens.ray(film_mm)),
            Lens::Thin(lens) => Ok(lens.ray(film_mm, glam::Vec2::ZERO)),
            Lens::Compound(lens) => lens.chief_ray(film_mm),
            Lens::Calibrated(lens) => lens.chief_ray(film_mm),
        }
    }
}

/// What a lens cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LensError {
    /// A number outside its range.
    #[error("{what} {found}: expected {expected}")]
    Range {
        /// Name of the quantity.
        what: &'static str,
        /// The value, as text.
        found: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// Something this lens cannot be set to.
    #[error("{what} {found}: expected {expected}")]
    Setting {
        /// What is set.
        what: &'static str,
        /// As asked.
        found: String,
        /// What this lens allows.
        expected: String,
    },
    /// A prescription that is wrong.
    #[error(transparent)]
    Prescription(#[from] PrescriptionError),
}

/// Fails with [`LensError::Range`] unless `ok`.
pub(crate) fn require(ok: bool, what: &'static str, found: f64, unit: &str, expected: &'static str) -> Result<(), LensError> {
    if ok { Ok(()) } else { Err(LensError::Range { what, found: format!("{}{unit}", shown(found)), expected }) }
}

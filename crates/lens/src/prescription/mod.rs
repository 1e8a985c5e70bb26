//! A lens as published: surfaces from object to film, parsed and checked.
//!
//! One TOML form ([`read_toml`], [`Prescription::to_toml`]); what other programs write comes through [`crate::import`].
//! Lengths in mm, angles in degrees (as people write them); surfaces are numbered from 1 in everything a user sees.

mod apertures;
mod check;
mod coatings;
mod hood;
mod infer;
mod numbers;
mod phases;
mod scale;
mod sheet;

pub use coatings::coating_named;
pub use hood::Hood;
pub(crate) use phases::grating;
pub use sheet::read_toml;
pub(crate) use sheet::{asphere_of, biconic, profile};

pub use crate::coating::Coating;

use crate::aperture::Aperture;
use crate::diffractive::Diffractive;
use crate::glare::Finish;
use crate::glass::Glass;
use crate::gradient::Gradient;
use crate::iris::Iris;
use crate::surface::Profile;

/// Most surfaces of a lens. Real ones have fewer than 60.
pub const MOST_SURFACES: usize = 400;

/// Largest length that makes sense in a lens, mm.
const LARGEST: f64 = 1e6;

/// Wavelengths that a lens is looked at in, nm.
pub const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 100.0..=20_000.0;

/// What black walls reflect by default: the order of black anodised aluminium in the visible (measured by Marshall et al., "Characterization of
/// the reflectivity of various black materials", SPIE 2014).
pub const WALL_REFLECTANCE: f64 = 0.05;

/// A lens as published.
#[derive(Clone, Debug, PartialEq)]
pub struct Prescription {
    /// What people call it.
    pub name: String,
    /// Patent number, if there is one.
    pub patent: Option<String>,
    /// Where the figures are from.
    pub source: String,
    /// Focal length as stated, mm (of a zoom: of its positions, [`Prescription::zoom`]).
    pub focal_length: Option<f64>,
    /// f-number as stated.
    pub f_number: Option<f64>,
    /// Diameter of the picture it was made for, mm.
    pub image_circle: Option<f64>,
    /// Stated focal lengths of the zoom positions that gaps are given for, ascending or descending; empty for a prime.
    pub zoom: Vec<f64>,
    /// Distance from object to film at the near focus position that gaps are given for, mm; `None` where there is none.
    pub close_focus: Option<f64>,
    /// Shape of the aperture.
    pub iris: Iris,
    /// What is on the glass, where a surface has nothing of its own.
    pub coating: Coating,
    /// How surfaces scatter, where one has nothing of its own.
    pub finish: Finish,
    /// What barrel, edges of glass and blades throw back of the light that meets them, 0 to 1.
    pub wall_reflectance: f64,
    /// The hood that belongs to it; analyses leave it off, photographs with stray light have it on.
    pub hood: Option<Hood>,
    /// Year of the lens, where the prescription tells one ([`Prescription::known_year`] also looks at the patent).
    pub year: Option<u16>,
    /// From the object to the film.
    pub surfaces: Vec<Surface>,
    /// Elements out of place.
    pub misalignments: Vec<Misalignment>,
    /// Where the axis before the lens stands, of a lens that is not built on one axis.
    pub object_axis: Option<ObjectAxis>,
    /// First and last surface (0 the first of the lens) of the group that moves across the axis against shake, where there is one.
    pub stabiliser: Option<[usize; 2]>,
    /// How the file says it is used: what analyses take when nothing else is asked.
    pub usage: Usage,
    /// What was inferred or skipped, for reports.
    pub notes: Vec<String>,
}

/// One surface and what follows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Line of the file, 0 where there is none.
    pub line: usize,
    /// Its shape.
    pub profile: Profile,
    /// To the next surface (of the last one: to the film) along the axis.
    pub gap: Gap,
    /// What fills the gap.
    pub glass: Glass,
    /// How its index departs from that of the glass from place to place.
    pub gradient: Option<Gradient>,
    /// Half the clear diameter, mm; `None` until inferred.
    pub semi_diameter: Option<f64>,
    /// Half the diameter of a hole that blocks light (an obstruction), mm; 0 for none.
    pub obstruction: f64,
    /// Openings and obscurations that are not disks about the vertex; light must pass all of them.
    pub apertures: Vec<Aperture>,
    /// The aperture stop.
    pub stop: bool,
    /// Reflects.
    pub mirror: bool,
    /// Of an ideal thin lens in this plane ([`crate::ideal`]), mm.
    pub ideal_focal_length: Option<f64>,
    /// Phase on it: a grating, a diffractive lens.
    pub diffractive: Option<Diffractive>,
    /// What is on this surface, if not what is on all.
    pub coating: Option<Coating>,
    /// How this surface scatters, if not as all.
    pub finish: Option<Finish>,
    /// Shift of this surface alone in x and y, mm.
    pub decenter: [f64; 2],
    /// Turn of this surface alone about x, y and z through its vertex, degrees.
    pub tilt: [f64; 3],
}

/// A distance that may depend on focus and zoom.
#[derive(Clone, Debug, PartialEq)]
pub struct Gap {
    /// mm, `[focus][zoom]`: one row, or two (infinity, close); one column, or one for each zoom position.
    pub values: Vec<Vec<f64>>,
}

impl Gap {
    /// A length (mm) that is the same at all focus and zoom positions.
    pub fn fixed(mm: f64) -> Self {
        Gap { values: vec![vec![mm]] }
    }

    /// Whether it changes with focus.
    pub fn focuses(&self) -> bool {
        self.values.len() > 1
    }

    /// The gap, mm, at a zoom position (0 the first column, fractions between them on a monotone cubic) and a focus (0 infinity, 1 the close position, straight between).
    pub fn at(&self, zoom: f64, focus: f64) -> f64 {
        let row = |r: &Vec<f64>| interpolate(r, zoom);
        match &self.values[..] {
            [far, near, ..] => {
                let (far, near) = (row(far), row(near));
                far + (near - far) * focus
            }
            [only] => row(only),
            [] => 0.0,
        }
    }
}

/// Monotone cubic through equally spaced values (Fritsch & Butland 1984): cams move without overshoot between the positions a
/// patent prints.
fn interpolate(v: &[f64], at: f64) -> f64 {
    if v.len() < 2 {
        return v.first().copied().unwrap_or(0.0);
    }
    let last = v.len() - 2;
    let i = (at.floor().max(0.0) as usize).min(last);
    let t = at - i as f64;
    let d = |k: usize| v[k + 1] - v[k];
    let slope = |k: usize| {
        if k == 0 {
            return d(0);
        }
        if k > last {
            return d(last);
        }
        let (a, b) = (d(k - 1), d(k));
        if a * b <= 0.0 { 0.0 } else { 2.0 * a * b / (a + b) }
    };
    let (m0, m1) = (slope(i), slope(i + 1));
    let (t2, t3) = (t * t, t * t * t);
    v[i] * (2.0 * t3 - 3.0 * t2 + 1.0) + m0 * (t3 - 2.0 * t2 + t) + v[i + 1] * (3.0 * t2 - 2.0 * t3) + m1 * (t3 - t2)
}

/// Surfaces moved together, about the vertex of the first; of a lens with an [`ObjectAxis`], whose surfaces each have a place of their own, about the middle of what is used of the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Misalignment {
    /// First surface, 0 the first of the lens.
    pub first: usize,
    /// Last surface, included.
    pub last: usize,
    /// Shift in x, y and z, mm.
    pub decenter: [f64; 3],
    /// Turn about x, y and z, degrees.
    pub tilt: [f64; 3],
}

/// The axis before the lens, seen from its film: the base ray (also optical axis ray), which comes from the middle of the field through the middle of the stop and on to
/// the middle of the film. Fields, pupils, focal length and distances of objects count from it. Mirrors off the axis (Schiefspiegler, off-axis paraboloids, three-mirror
/// anastigmats) have no other axis: light may come in at any angle to the film's normal, along which surfaces are counted.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectAxis {
    /// Its origin, from which places before the lens count, mm from the origin of the surfaces.
    pub decenter: [f64; 3],
    /// Its turn about x, y and z, degrees; light comes along its z.
    pub tilt: [f64; 3],
}

/// How much light is let in.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ApertureKind {
    /// Diameter of the entrance pupil, mm.
    EntrancePupil(f64),
    /// Image-space f-number.
    FNumber(f64),
    /// Numerical aperture on the object's side.
    ObjectNa(f64),
}

/// How a file says its lens is used.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Usage {
    /// Stop opening.
    pub aperture: Option<ApertureKind>,
    /// Wavelengths, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Which of them is the reference.
    pub reference: usize,
    /// Field angles in y, degrees (object at infinity).
    pub field_angles_deg: Vec<f64>,
    /// Vignetting factors of the fields: upper and lower, as CODE V's VUY and VLY.
    pub vignetting: Vec<[f64; 2]>,
    /// Distance from the object to the first surface, mm; infinite without.
    pub object_distance: Option<f64>,
    /// Gap between the paraxial image and the film that the file adds, mm (CODE V's image surface thickness).
    pub defocus: f64,
}

/// What is wrong with a prescription.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}{}: {what}", self.surface.map_or(String::new(), |s| format!(": surface {s}")))]
pub struct PrescriptionError {
    /// File, and line where known: "tessar.toml:14".
    pub place: String,
    /// Number of the surface from 1, where one is to blame.
    pub surface: Option<usize>,
    /// Found, expected, hint.
    pub what: String,
}

impl PrescriptionError {
    /// `line` 0: not known.
    pub fn at(file: &str, line: usize, what: impl Into<String>) -> Self {
        let place = if line > 0 { format!("{file}:{line}") } else { file.to_owned() };
        PrescriptionError { place, surface: None, what: what.into() }
    }

    /// About one surface, numbered from 1.
    pub fn surface(mut self, number: usize) -> Self {
        self.surface = Some(number);
        self
    }
}

impl Prescription {
    /// A lens of these surfaces and nothing else known.
    pub fn new(name: impl Into<String>, surfaces: Vec<Surface>) -> Self {
        Prescription {
            name: name.into(),
            patent: None,
            source: String::new(),
            focal_length: None,
            f_number: None,
            image_circle: None,
            zoom: vec![],
            close_focus: None,
            iris: Iris::Round,
            coating: Coating::None,
            finish: Finish::default(),
            wall_reflectance: WALL_REFLECTANCE,
            hood: None,
            year: None,
            surfaces,
            misalignments: vec![],
            object_axis: None,
            stabiliser: None,
            usage: Usage::default(),
            notes: vec![],
        }
    }

    /// Year of the lens: as given, or the first in brackets of the patent: "US 3,874,771 (1975)".
    pub fn known_year(&self) -> Option<u16> {
        let of_patent = || {
            let after = self.patent.as_deref()?.split('(').skip(1);
            after.filter_map(|t| t.split(')').next()?.trim().parse().ok()).find(|year| (1800..2200).contains(year))
        };
        self.year.or_else(of_patent)
    }

    /// Number of the stop.
    pub fn stop(&self) -> usize {
        self.surfaces.iter().position(|s| s.stop).unwrap_or(0)
    }

    /// Whether gaps are given for near focus.
    pub fn has_focus_data(&self) -> bool {
        self.surfaces.iter().any(|s| s.gap.focuses())
    }

    /// Largest zoom position: number of positions less one.
    pub fn last_zoom(&self) -> f64 {
        self.zoom.len().saturating_sub(1) as f64
    }
}

impl Surface {
    /// A surface of this shape before a gap of this glass, with nothing else about it.
    pub fn new(profile: Profile, gap: f64, glass: Glass) -> Self {
        Surface {
            line: 0,
            profile,
            gap: Gap::fixed(gap),
            glass,
            gradient: None,
            semi_diameter: None,
            obstruction: 0.0,
            apertures: vec![],
            stop: false,
            mirror: false,
            ideal_focal_length: None,
            diffractive: None,
            coating: None,
            finish: None,
            decenter: [0.0; 2],
            tilt: [0.0; 3],
        }
    }

    /// Whether it looks the same after a turn about its axis.
    pub(crate) fn looks_round(&self) -> bool {
        let phase = self.diffractive.as_ref().is_none_or(|d| d.phase().is_rotational());
        self.profile.is_rotational() && self.apertures.is_empty() && phase
    }

    /// Whether anything but the rim stops light at it.
    pub(crate) fn is_obscured_or_limited(&self) -> bool {
        self.obstruction > 0.0 || !self.apertures.is_empty()
    }
}

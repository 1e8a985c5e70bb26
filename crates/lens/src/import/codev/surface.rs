//! Surfaces of a sequence file as its commands describe them: where they stand, their special shapes, their apertures.

use super::super::layout::moved_then_turned;
use crate::aperture::{Aperture, Outline};
use crate::diffractive::Diffractive;
use crate::freeform::Freeform;
use crate::polynomial::{Polynomial, Terms};
use crate::surface::Profile;
use glam::{DAffine3, DVec3};

/// What a decenter does to the surfaces after it.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Decenter {
    /// They follow.
    Stays,
    /// They do not (DAR).
    Returns,
    /// The surface itself stays, what follows is turned back (REV).
    Reverses,
    /// For mirrors: the tilt acts once more after the surface (BEN).
    Bends,
}

/// Decentre and tilts of a surface as the file gives them, and what they do.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) decenter: DVec3,
    /// ADE, BDE, CDE, degrees.
    pub(super) tilt: [f64; 3],
    pub(super) kind: Decenter,
    pub(super) given: bool,
}

impl Place {
    pub(super) const NONE: Place = Place { decenter: DVec3::ZERO, tilt: [0.0; 3], kind: Decenter::Stays, given: false };

    /// Turns about x and y follow the left hand, about z the right.
    pub(super) fn turn(&self, decenter: DVec3) -> DAffine3 {
        let [a, b, c] = self.tilt;
        moved_then_turned(decenter, [-a, -b, c])
    }

    /// Where the surface stands and where its gap starts, seen from the coordinate system before it.
    pub(super) fn around(&self, scale: f64) -> (DAffine3, DAffine3) {
        let whole = self.turn(self.decenter * scale);
        match self.kind {
            Decenter::Stays => (whole, whole),
            Decenter::Returns => (whole, DAffine3::IDENTITY),
            Decenter::Reverses => (DAffine3::IDENTITY, whole.inverse()),
            Decenter::Bends => (whole, whole * self.turn(DVec3::ZERO)),
        }
    }
}

/// Shape that a surface is said to have.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Rotational,
    /// CYL, YTO: a curvature in x of its own.
    Toroid,
    /// AAS: a curvature and a conic constant in x of their own.
    Anamorphic,
}

/// A diffractive surface, or a special shape, as far as it has been read.
#[derive(Default)]
pub(super) struct Special {
    /// DIF DOE.
    pub(super) is_diffractive: bool,
    pub(super) order: Option<f64>,
    pub(super) wavelength_nm: Option<f64>,
    /// Path of r², r⁴, ..., in lens units.
    pub(super) path: Vec<f64>,
    /// XYP or ZFR.
    pub(super) shape: Option<&'static str>,
    pub(super) norm: Option<f64>,
    /// Cₙ at n − 1.
    pub(super) coefficients: Vec<f64>,
}

impl Special {
    /// The phase; lengths of the file times `scale` are mm.
    pub(super) fn diffractive(&self, scale: f64) -> Result<Option<Diffractive>, String> {
        if !self.is_diffractive {
            return Ok(None);
        }
        let order = self.order.unwrap_or(1.0);
        if order.fract() != 0.0 || order.abs() > f64::from(crate::diffractive::HIGHEST_ORDER) {
            return Err(format!("HOR {order}: expected a whole number"));
        }
        let nm = self.wavelength_nm.filter(|nm| *nm > 0.0).ok_or("DIF DOE without HWL: expected its wavelength in nm")?;
        // Radians of r²ⁱ over 1 mm.
        let radians = |(i, c): (usize, &f64)| std::f64::consts::TAU * c * scale.powi(1 - 2 * (i as i32 + 1)) / (nm * 1e-6);
        let radial = self.path.iter().enumerate().map(radians).collect();
        Diffractive::new(order as i32, Polynomial::new(1.0, Terms { radial, ..Terms::default() })?, None).map(Some)
    }

    /// The shape on a conic of a curvature (1/mm) and a conic constant; `None` where it is no special one.
    pub(super) fn freeform(&self, c: f64, k: f64, scale: f64) -> Result<Option<Profile>, String> {
        let Some(shape) = self.shape else { return Ok(None) };
        let number = |n: usize| self.coefficients.get(n - 1).copied().filter(|v| *v != 0.0);
        let k = number(1).unwrap_or(k);
        let (norm, first) = match shape {
            "XYP" => (self.norm, 1),
            _ => (self.norm.or(number(3)), 3),
        };
        let mut values: Vec<f64> = self.coefficients.iter().skip(first).map(|v| v * scale).collect();
        let most = if shape == "XYP" { 65 } else { 37 };
        if values.iter().skip(most).any(|v| *v != 0.0) {
            return Err(format!("SPS {shape}: a coefficient beyond the {most} terms: expected none"));
        }
        values.truncate(most);
        let norm = match (norm.filter(|n| *n > 0.0), shape) {
            (Some(norm), _) => norm,
            (None, "XYP") => 1.0,
            (None, _) => return Err("SPS ZFR without a radius: expected SCO NRADIUS".into()),
        };
        let terms = match shape {
            "XYP" => Terms { xy: super::super::zemax::xy_terms(&values), ..Terms::default() },
            _ => Terms { fringe: values, ..Terms::default() },
        };
        let base = crate::prescription::asphere_of(&crate::prescription::profile(c, k, vec![], None)).ok_or("no such base")?;
        Ok(Some(Profile::Freeform(Box::new(Freeform { base, departure: Polynomial::new(norm * scale, terms)? }))))
    }
}

/// An aperture that is not round, or not about the vertex.
#[derive(Clone, Copy, Default)]
pub(super) struct Opening {
    /// Whether it is a rectangle (else an ellipse), and the half widths in x and y given so far.
    pub(super) shape: Option<(bool, [f64; 2])>,
    pub(super) center: [f64; 2],
}

impl Opening {
    /// The aperture that it and the radius of a CIR make; `None` where that is a disk about the vertex.
    pub(super) fn aperture(&self, radius: Option<f64>, blocks: bool) -> Result<Option<Aperture>, String> {
        let outline = match (self.shape, radius) {
            (Some((true, half)), _) if half.iter().all(|h| *h > 0.0) => Outline::Rectangle(half),
            (Some((false, half)), _) if half.iter().all(|h| *h > 0.0) => Outline::Ellipse(half),
            (_, Some(radius)) if self.center != [0.0; 2] => Outline::Ring([0.0, radius]),
            (Some(_), _) if blocks => return Err("an obscuration with one half width: expected both, in x and in y".into()),
            _ => return Ok(None),
        };
        Aperture::new(outline, blocks, self.center, 0.0).map(Some)
    }
}

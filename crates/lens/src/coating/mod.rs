//! Coatings: thin films on the surfaces of a lens, what they reflect, let through and absorb.
//!
//! A [`Coating`] is what a prescription says; on a surface between two given media it becomes a [`SurfaceCoating`]; a [`Stack`] of
//! [`Layer`]s answers by [`response`] (transfer matrices, s and p apart). Traces take the mean of s and p at every surface: polarisation is
//! not carried from one surface to the next. Packets look up tables of the same values ([`LightTable`]).

mod complex;
pub(crate) mod film;
mod material;
mod recipe;
mod table;
mod transfer;

pub use complex::Complex;
pub use material::{Material, film_names};
pub use recipe::{Recipe, by_year};
pub use table::LightTable;
pub(crate) use table::on_aluminium;
pub use transfer::{Response, response};

use crate::glass::{Glass, GlassKind};
use crate::ray::TraceDirection;
use film::{FILM_NM, MGF2};
use std::sync::Arc;

/// Most layers of a stack.
pub const MOST_LAYERS: usize = 400;
/// Wavelength that recipes are designed for without another, nm.
pub const DESIGN_NM: f64 = 550.0;

/// What is on surfaces. Lens-wide, and recipes in any case, it is on surfaces between glass and air; a stack that a surface has of its own
/// is also between two glasses and on mirrors.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Coating {
    /// Nothing: Fresnel's full reflection, as lenses were before about 1940.
    #[default]
    None,
    /// A quarter wave of MgF₂ (n = 1.38) at 550 nm: the single coating of about 1940 to 1970.
    MagnesiumFluoride,
    /// A broadband coating that nobody knows the layers of: a flat 0.4 % at every surface, wavelength and angle.
    Multilayer,
    /// No reflection at all: to see the glass alone.
    Perfect,
    /// Layers by a rule, fitted to the glass of each surface.
    Recipe(Recipe, f64),
    /// Layers as given: from the air to the glass; between two glasses from the object's side; on a mirror from the light's side, on
    /// aluminium.
    Stack(Arc<Stack>),
}

/// A film.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// What it is made of.
    pub material: Material,
    /// Thickness, nm.
    pub thickness_nm: f64,
}

/// Films one upon the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stack {
    /// From one side to the other.
    pub layers: Vec<Layer>,
}

impl Stack {
    /// The same seen from the other side.
    pub fn reversed(&self) -> Stack {
        Stack { layers: self.layers.iter().rev().cloned().collect() }
    }

    /// What it does to light that comes from a transparent medium of index `incident` and goes towards `substrate`. [`TraceDirection::ToFilm`]: the light
    /// meets the first layer first; [`TraceDirection::ToObject`]: the last. `cos`: of incidence; `nm`: wavelength in vacuum.
    pub fn response(&self, way: TraceDirection, incident: f64, substrate: Complex, cos: f64, nm: f64) -> Response {
        let films = self.layers.iter().map(|l| (l.material.index(nm), l.thickness_nm));
        match way {
            TraceDirection::ToFilm => response(incident, films, substrate, cos, nm),
            TraceDirection::ToObject => response(incident, films.rev(), substrate, cos, nm),
        }
    }

    /// Whether no layer absorbs at a wavelength.
    pub fn is_transparent(&self, nm: f64) -> bool {
        self.layers.iter().all(|l| l.material.index(nm).im == 0.0)
    }
}

/// What is on one surface of a lens.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SurfaceCoating {
    /// Nothing (of a mirror: bare aluminium).
    Bare,
    /// Reflects nothing.
    Perfect,
    /// Reflects this fraction at every wavelength and angle.
    Flat(f64),
    /// A quarter wave of MgF₂ at 550 nm, in closed form.
    QuarterWave,
    /// Films, from the object's side to the film's; of a mirror from the light's side, on aluminium.
    Layers(Arc<Stack>),
}

impl SurfaceCoating {
    /// What it does to light of a medium of index `n[0]` that comes to a medium of index `n[1]` (of a mirror: aluminium), s and p apart. `cos`: of
    /// incidence; `nm`: wavelength in vacuum.
    pub fn response(&self, mirror: bool, way: TraceDirection, n: [f64; 2], cos: f64, nm: f64) -> Response {
        let substrate = if mirror { material::aluminium(nm) } else { n[1].into() };
        let flat = |r: f64| {
            // Beyond the critical angle everything comes back, whatever is on the glass.
            let total = n[0] / n[1] * (1.0 - cos * cos).sqrt() > 1.0 + 1e-12;
            let reflectance = [if total { 1.0 } else { r }; 2];
            let transmittance = reflectance.map(|r| 1.0 - r);
            Response { reflectance, transmittance, reflected_phase: [0.0; 2], transmitted_phase: [0.0; 2] }
        };
        match self {
            SurfaceCoating::Layers(stack) => stack.response(way, n[0], substrate, cos, nm),
            SurfaceCoating::Perfect if !mirror => flat(0.0),
            SurfaceCoating::Flat(r) if !mirror => flat(*r),
            SurfaceCoating::QuarterWave if !mirror => {
                let film = (Complex::from(MGF2), 0.25 * FILM_NM / MGF2);
                response(n[0], std::iter::once(film), substrate, cos, nm)
            }
            _ => response(n[0], std::iter::empty(), substrate, cos, nm),
        }
    }

    /// Layers from the object's side, as reports print them; empty without.
    pub fn describe(&self) -> String {
        match self {
            SurfaceCoating::Bare => String::new(),
            SurfaceCoating::Perfect => "reflects nothing".into(),
            SurfaceCoating::Flat(r) => format!("{:.2} % at every wavelength and angle", 100.0 * r),
            SurfaceCoating::QuarterWave => "MgF2 99.6 nm".into(),
            SurfaceCoating::Layers(stack) => {
                let layer = |l: &Layer| format!("{} {:.1} nm", l.material.describe(), l.thickness_nm);
                stack.layers.iter().map(layer).collect::<Vec<_>>().join(" | ")
            }
        }
    }
}

/// What a modern broadband coating reflects: vendors state an average below 0.4 % over 425–675 nm (Edmund Optics, "VIS 0°").
pub(crate) const MULTILAYER_REFLECTANCE: f64 = 0.004;

impl Coating {
    /// On a surface between two media, `before` on the object's side. `own`: the surface has it by itself, not by the lens.
    pub fn on(&self, before: &Glass, after: &Glass, mirror: bool, own: bool) -> SurfaceCoating {
        let is_air = [before, after].map(|g| g.kind == GlassKind::Air);
        if let Coating::Stack(stack) = self {
            return match (own, is_air) {
                _ if mirror && own => SurfaceCoating::Layers(stack.clone()),
                _ if mirror => SurfaceCoating::Bare,
                // From the air to the glass, where the air is behind.
                (_, [false, true]) => SurfaceCoating::Layers(Arc::new(stack.reversed())),
                (_, [true, false]) | (true, [false, false]) => SurfaceCoating::Layers(stack.clone()),
                _ => SurfaceCoating::Bare,
            };
        }
        if mirror || is_air[0] == is_air[1] {
            // Cement does not need a coating.
            return SurfaceCoating::Bare;
        }
        match self {
            Coating::None | Coating::Stack(_) => SurfaceCoating::Bare,
            Coating::MagnesiumFluoride => SurfaceCoating::QuarterWave,
            Coating::Multilayer => SurfaceCoating::Flat(MULTILAYER_REFLECTANCE),
            Coating::Perfect => SurfaceCoating::Perfect,
            Coating::Recipe(recipe, design_nm) => {
                let glass = if is_air[0] { after } else { before };
                let stack = recipe.stack(glass, *design_nm);
                SurfaceCoating::Layers(Arc::new(if is_air[0] { stack } else { stack.reversed() }))
            }
        }
    }

    /// As reports print it.
    pub fn describe(&self) -> String {
        match self {
            Coating::None => "none".into(),
            Coating::MagnesiumFluoride => "a quarter wave of MgF2".into(),
            Coating::Multilayer => "multilayer, 0.4 % a surface".into(),
            Coating::Perfect => "perfect".into(),
            Coating::Recipe(recipe, design_nm) => format!("{} for {design_nm} nm", recipe.describe()),
            Coating::Stack(stack) => match stack.layers.len() {
                1 => "1 layer as given".into(),
                count => format!("{count} layers as given"),
            },
        }
    }
}

#[cfg(test)]
mod tests;

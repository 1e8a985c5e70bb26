//! glTF's material model: metal or dielectric, the dielectric over a diffuse base or transparent, a clear coat above all.
//!
//! Lobes: specular reflection (GGX; metal with Schlick's Fresnel, dielectric with the exact one), diffuse base, transmission
//! (thin: straight through, blurred by roughness; solid: refraction), clear coat. What a layer reflects, the layers below
//! do not get; what single scattering loses between facets is given back ([`super::energy`]). A white material therefore
//! neither gains nor loses light (under sheen it loses some, by the rule of KHR_materials_sheen). Source: Khronos glTF 2.0 §3.9
//! and appendix B; KHR_materials_ior, _transmission, _volume, _clearcoat, _specular, _sheen ([`super::sheen`]), _iridescence
//! ([`super::film`]), _anisotropy ([`super::anisotropy`]). We depart from appendix B in the exact Fresnel term and in the energy
//! compensation.

mod lobes;
mod polarization;

pub(super) use self::lobes::PrincipledLobes;

use self::lobes::{OverFilm, Tint, View};
use super::anisotropy::Anisotropy;
use super::coat::CoatNormal;
use super::energy::{Interface, prepare_mirrors};
use super::film::{Film, index_of};
use super::inputs::{Inputs, inputs_struct};
use super::microfacet::{Ggx, SMOOTH};
use super::sheen::{self, Sheen};
use crate::exact::{Exact, Sink, Source, exact_enum, field, field_or};
use crate::shape::Surface;
use crate::texture::{Color, Scalar};
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::Vec3;
use serde_json::Value;
use std::sync::Arc;

/// What is behind a transmitting surface.
#[derive(Clone, Debug)]
pub enum Transmission {
    /// The surface is a thin dielectric: light goes straight on.
    Thin,
    /// The surface bounds a body: light is bent.
    Solid,
}

exact_enum!(Transmission { Thin, Solid });

impl Inputs for Transmission {}

/// The key of a parameter in files: its name, or the one that it had first.
macro_rules! key {
    ($field:ident) => {
        stringify!($field)
    };
    ($field:ident $key:literal) => {
        $key
    };
}

/// Declares [`Principled`], a line a parameter: name (`as` its key in files where that is another), type, and what it is by [`Principled::new`]. From these lines come the structure, `new`, the form in which
/// files keep it (their names and order are the file's) and its inputs.
macro_rules! principled {
    ($( $(#[$doc:meta])* $field:ident $(as $key:literal)?: $type:ty = $default:expr, )+) => {
        /// Parameters of the model.
        #[derive(Clone, Debug)]
        pub struct Principled {
            /// Albedo of the base, reflectance of the metal, tint of transmission.
            pub base_color: Color,
            /// Index of refraction of the dielectric relative to what is around; below 1 of a body that is thinner, such as air in ice.
            pub ior: f32,
            $( $(#[$doc])* pub $field: $type, )+
            pub(crate) interface: Arc<Interface>,
            pub(crate) coat: Arc<Interface>,
            /// Interfaces against the bodies around it, by the bits of their index; see [`Principled::prepare`].
            pub(crate) against: Vec<(u32, Arc<Interface>)>,
        }

        impl Principled {
            /// A dielectric of an index with a diffuse base of a colour, fully rough; change what differs. An index below 1 is for bodies that transmit: they
            /// reflect totally from outside. It is at least 0.1, and 1 itself is taken for 1.0001.
            pub fn new(base_color: Color, ior: f32) -> Self {
                let ior = if ior < 1.0 { ior.clamp(0.1, 0.9999) } else { ior.max(1.0001) };
                Principled {
                    base_color,
                    ior,
                    $( $field: $default, )+
                    // Tables are of the denser side against the thinner, whichever the body is.
                    interface: Interface::of(ior.max(1.0 / ior)),
                    coat: Interface::of(COAT_IOR),
                    against: Vec::new(),
                }
            }
        }

        impl Exact for Principled {
            fn write(&self, sink: &mut Sink) -> Value {
                let mut object = serde_json::Map::new();
                object.insert("base_color".to_owned(), self.base_color.write(sink));
                object.insert("ior".to_owned(), self.ior.write(sink));
                $( object.insert(key!($field $($key)?).to_owned(), self.$field.write(sink)); )+
                Value::Object(object)
            }

            fn read(value: &Value, source: &Source) -> Result<Self, String> {
                let ior: f32 = field(value, "ior", source)?;
                if !(ior > 0.0 && ior.is_finite()) {
                    return Err(format!("an index of {ior}"));
                }
                // Its tables come from these two.
                let plain = Principled::new(field(value, "base_color", source)?, ior);
                // What older files do not know is as by `new`.
                Ok(Principled { $( $field: field_or(value, key!($field $($key)?), source, plain.$field)?, )+ ..plain })
            }
        }

        inputs_struct!(Principled { base_color, $( $field, )+ } without { ior, interface, coat, against });
    };
}

principled! {
    /// 0 dielectric, 1 metal.
    metallic: Scalar = Scalar::Constant(0.0),
    /// √α of the GGX distribution.
    roughness: Scalar = Scalar::Constant(1.0),
    /// How that differs from one direction to another; not of the coat.
    anisotropy: Option<Box<Anisotropy>> = None,
    /// Index over wavelength, where transmitted light is to be dispersed; reflectances use `ior`.
    dispersion: Option<Spectrum> = None,
    /// Fraction of the base that transmits.
    transmission: Scalar = Scalar::Constant(0.0),
    /// What is behind.
    kind: Transmission = Transmission::Thin,
    /// Thin dielectric with reflections between its two faces (a window pane; PBR 4ed, section 9.5); smooth ones only.
    thin_dielectric as "pane": bool = false,
    /// Light goes to and fro between the diffuse base and the interface above: bright bases become more saturated.
    layered: bool = false,
    /// Strength of the clear coat (index 1.5).
    clearcoat: Scalar = Scalar::Constant(0.0),
    /// √α of the coat.
    clearcoat_roughness: Scalar = Scalar::Constant(0.0),
    /// Strength of the dielectric's reflection; not of bodies that transmit.
    specular: Scalar = Scalar::Constant(1.0),
    /// Tint of what it reflects at normal incidence.
    specular_color: Color = Color::rgb(1.0, 1.0, 1.0),
    /// Whether the two differ from 1.
    tinted: bool = false,
    /// Where the coat has its normals from, if not from what is below.
    coat_normal: Option<Box<CoatNormal>> = None,
    /// A thin film between the coat and what is below.
    film: Option<Box<Film>> = None,
    /// Cloth under the coat.
    sheen: Option<Box<Sheen>> = None,
}

const COAT_IOR: f32 = 1.5;

impl Principled {
    /// Computes every table that rays will ask for; `around`: indices of the bodies that it may lie in or touch. Without it the first
    /// rays compute them.
    pub(super) fn prepare(&mut self, around: &[f32]) {
        let anisotropic = self.anisotropy.is_some();
        let smooth = matches!(self.roughness, Scalar::Constant(r) if r * r < SMOOTH) && !anisotropic;
        let body = matches!(self.kind, Transmission::Solid) && self.may_transmit();
        prepare_mirrors(anisotropic);
        if self.sheen.is_some() {
            sheen::albedo();
        }
        if body {
            self.against = around.iter().map(|outer| (outer.to_bits(), Interface::of(between(self.ior, *outer)))).collect();
        }
        for interface in std::iter::once(&self.interface).chain(self.against.iter().map(|(_, i)| i)) {
            interface.prepare(anisotropic, body && !smooth);
        }
    }

    /// The interface against a body of an index.
    fn against(&self, outer: f32) -> Against<'_> {
        let prepared = self.against.iter().find(|(bits, _)| *bits == outer.to_bits());
        prepared.map_or_else(|| Against::Looked(Interface::of(between(self.ior, outer))), |(_, i)| Against::Prepared(i))
    }

    /// Clear, smooth glass of an index: a solid body. The index is limited as [`Principled::new`] says.
    pub fn glass(ior: f32) -> Self {
        Principled {
            roughness: Scalar::Constant(0.0),
            transmission: Scalar::Constant(1.0),
            kind: Transmission::Solid,
            ..Principled::new(Color::rgb(1.0, 1.0, 1.0), ior)
        }
    }

    /// With the reflection of its dielectric scaled by a color (linear sRGB, 0 to 1): the largest component at all angles, what the others lack of it at normal incidence.
    pub(crate) fn with_specular(self, scale: Vec3) -> Self {
        let largest = scale.max_element();
        if scale == Vec3::ONE {
            return self;
        }
        let tint = if largest > 0.0 { scale / largest } else { Vec3::ONE };
        let specular_color = Color::rgb(tint.x, tint.y, tint.z);
        Principled { specular: Scalar::Constant(largest), specular_color, tinted: true, ..self }
    }

    /// Whether it is the smooth surface of a body that light goes through.
    pub(super) fn is_clear_body(&self) -> bool {
        let smooth = matches!(self.roughness, Scalar::Constant(r) if r * r < SMOOTH);
        !matches!(self.kind, Transmission::Thin) && smooth && self.may_transmit()
    }

    /// Whether it is a metal that is smooth everywhere, and bare.
    pub(super) fn is_smooth_metal(&self) -> bool {
        let is = |scalar: &Scalar, holds: fn(f32) -> bool| matches!(scalar, Scalar::Constant(x) if holds(*x));
        is(&self.metallic, |m| m >= 1.0)
            && is(&self.roughness, |r| r * r < SMOOTH)
            && is(&self.clearcoat, |c| c <= 0.0)
            && !self.may_transmit()
            && self.anisotropy.is_none()
            && self.sheen.is_none()
    }

    /// Whether light may go through somewhere.
    fn may_transmit(&self) -> bool {
        !matches!(self.transmission, Scalar::Constant(t) if t <= 0.0)
    }

    /// Whether it may be smooth somewhere.
    pub(super) fn may_be_smooth(&self) -> bool {
        !matches!(self.roughness, Scalar::Constant(r) if r * r >= SMOOTH)
    }

    /// Whether it may be a smooth thin dielectric that lets light through.
    pub(super) fn may_transmit_straight(&self) -> bool {
        matches!(self.kind, Transmission::Thin) && self.may_be_smooth() && self.may_transmit()
    }

    /// A base whose light is thrown back at the interface from within, again and again: ρ (1 − F) / (n² (1 − ρ F')), F being what the interface
    /// reflects of light from everywhere outside and F' = 1 − (1 − F) / n² from within. Source: the plastic of W. Jakob's Mitsuba and of
    /// pbrt's layered materials in closed form; F' by reciprocity (Walter et al. 2007).
    fn seen_through(&self, base: SampledSpectrum, roughness: f32) -> SampledSpectrum {
        let through = 1.0 - self.interface.average_reflected(if roughness * roughness < SMOOTH { 0.0 } else { roughness });
        let n2 = self.ior * self.ior;
        let within = 1.0 - through / n2;
        base * through / (n2 * (SampledSpectrum::ONE - base * within))
    }

    /// `around`: what is on the outer side, if it is no vacuum.
    pub(super) fn at(
        &self,
        surface: &Surface,
        wo: Vec3,
        wavelengths: &SampledWavelengths,
        hero_only: bool,
        around: Option<&Principled>,
    ) -> PrincipledLobes<'_> {
        let solid = matches!(self.kind, Transmission::Solid);
        let mut transmission = self.transmission.at(surface).clamp(0.0, 1.0);
        let inside = solid && transmission > 0.0 && surface.ng.dot(wo) < 0.0;
        let mut metallic = self.metallic.at(surface).clamp(0.0, 1.0);
        if inside {
            (transmission, metallic) = (1.0, 0.0);
        }
        let around = around.filter(|_| solid && transmission > 0.0);
        let relative = |n: f32, outer: f32| if inside { outer / n } else { n / outer };
        let outer_ior = around.map_or(1.0, |a| a.ior);
        let bends = |p: &Principled| p.dispersion.as_ref().map_or(p.ior, |n| n.at(wavelengths.nm.x));
        let dispersed = self.dispersion.is_some() || around.is_some_and(|a| a.dispersion.is_some());
        let (bend, dispersive) = match solid && transmission > 0.0 && dispersed {
            true => (relative(bends(self), around.map_or(1.0, bends)), !hero_only),
            false => (relative(self.ior, outer_ior), false),
        };
        // Tables are of the denser side against the thinner.
        let n = self.ior / outer_ior;
        let between = around.map(|a| self.against(a.ior));
        let inside_denser = inside == (n >= 1.0);
        let roughness = self.roughness.at(surface).clamp(0.0, 1.0);
        let facets = match &self.anisotropy {
            None => Ggx::even(roughness * roughness),
            Some(anisotropy) => anisotropy.facets(roughness, surface),
        };
        let roughness = if self.anisotropy.is_some() { facets.roughness() } else { roughness };
        let base = self.base_color.sample(surface, wavelengths);
        let tint = (self.tinted && !solid).then(|| {
            let f0 = ((self.ior - 1.0) / (self.ior + 1.0)).powi(2);
            let (w, color) = (self.specular.at(surface).clamp(0.0, 1.0), self.specular_color.sample(surface, wavelengths));
            Tint { weight: w, f0, normal: (color * f0).min(SampledSpectrum::ONE) * w }
        });
        let film = self.film.as_ref().and_then(|film| film.at(surface, wavelengths)).map(|layer| {
            let below = tint.as_ref().map_or(SampledSpectrum::splat(n), |t| index_of(t.normal));
            OverFilm {
                layer,
                below,
                metal: index_of(base),
                outer_sin: if inside { n } else { 1.0 },
                average: layer.average(below, &self.interface, self.ior, facets),
            }
        });
        PrincipledLobes {
            base,
            under: if self.layered { self.seen_through(base, roughness) } else { base },
            thin_dielectric: self.thin_dielectric,
            metallic,
            roughness,
            facets,
            transmission,
            solid,
            inside_denser,
            bend,
            eta: relative(self.ior, outer_ior),
            dispersive,
            dispersed: if dispersive { wavelengths.hero_only() } else { SampledSpectrum::ONE },
            coat: if inside { 0.0 } else { self.clearcoat.at(surface).clamp(0.0, 1.0) },
            coat_roughness: self.clearcoat_roughness.at(surface).clamp(0.04, 1.0),
            coat_normal: self.coat_normal.as_deref(),
            coat_turn: None,
            tint,
            film,
            sheen: if inside { None } else { self.sheen.as_ref().and_then(|s| s.at(surface, wavelengths)) },
            interface: &self.interface,
            between,
            coat_interface: &self.coat,
            seen: View::default(),
        }
    }
}

/// Tables of the interface between two bodies: those of the material, or looked up where nothing was prepared.
#[derive(Clone)]
enum Against<'a> {
    Prepared(&'a Interface),
    Looked(Arc<Interface>),
}

/// Index of the table of two media: of the denser one against the thinner.
fn between(ior: f32, outer: f32) -> f32 {
    let n = ior / outer;
    n.max(1.0 / n).max(1.0001)
}

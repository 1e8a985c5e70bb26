//! glTF's material model: metal or dielectric, the dielectric over a diffuse base or transparent, a clear coat above all.
//!
//! Lobes: specular reflection (GGX; metal with Schlick's Fresnel, dielectric with the exact one), diffuse base, transmission
//! (thin: straight through, blurred by roughness; solid: refraction), clear coat. What a layer reflects, the layers below
//! do not get; what single scattering loses between facets is given back ([`super::energy`]). A white material therefore
//! neither gains nor loses light (under sheen it loses some, by the rule of KHR_materials_sheen). Source: Khronos glTF 2.0 §3.9
//! and appendix B; KHR_materials_ior, _transmission, _volume, _clearcoat, _specular, _sheen ([`super::sheen`]), _iridescence
//! ([`super::film`]), _anisotropy ([`super::anisotropy`]). We depart from appendix B in the exact Fresnel term and in the energy
//! compensation.

mod polarization;

use super::anisotropy::Anisotropy;
use super::energy::{Interface, Side, mirror_albedo_at, prepare_mirrors};
use super::film::{Film, FilmLayer, index_of};
use super::local_scatter::{Breadth, LocalScatter};
use super::microfacet::{Ggx, SMOOTH, cosine_of, fresnel_dielectric, fresnel_schlick, reflect, refract};
use super::sheen::{self, Sheen, SheenLobe};
use crate::shape::Surface;
use crate::texture::{Color, Scalar};
use diopter_light::{Sampled, Spectrum, Wavelengths, sampling};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};
use std::sync::Arc;

/// What is behind a transmitting surface.
#[derive(Clone, Debug)]
pub enum Transmission {
    /// The surface is a thin sheet: light goes straight on.
    Thin,
    /// The surface bounds a body: light is bent.
    Solid,
}

/// Parameters of the model.
#[derive(Clone, Debug)]
pub struct Principled {
    /// Albedo of the base, reflectance of the metal, tint of transmission.
    pub base_color: Color,
    /// 0 dielectric, 1 metal.
    pub metallic: Scalar,
    /// √α of the GGX distribution.
    pub roughness: Scalar,
    /// How that differs from one direction to another; not of the coat.
    pub anisotropy: Option<Box<Anisotropy>>,
    /// Index of refraction of the dielectric relative to what is around; below 1 of a body that is thinner, such as air in ice.
    pub ior: f32,
    /// Index over wavelength, where transmitted light is to be dispersed; reflectances use `ior`.
    pub dispersion: Option<Spectrum>,
    /// Fraction of the base that transmits.
    pub transmission: Scalar,
    /// What is behind.
    pub kind: Transmission,
    /// The sheet has two faces between which light goes to and fro (a pane of glass); of smooth thin sheets only.
    pub pane: bool,
    /// Light goes to and fro between the diffuse base and the interface above: bright bases become more saturated.
    pub layered: bool,
    /// Strength of the clear coat (index 1.5).
    pub clearcoat: Scalar,
    /// √α of the coat.
    pub clearcoat_roughness: Scalar,
    /// Strength of the dielectric's reflection; not of bodies that transmit.
    pub specular: Scalar,
    /// Tint of what it reflects at normal incidence.
    pub specular_color: Color,
    /// Whether the two differ from 1.
    pub tinted: bool,
    /// A thin film between the coat and what is below.
    pub film: Option<Box<Film>>,
    /// Cloth under the coat.
    pub sheen: Option<Box<Sheen>>,
    pub(crate) interface: Arc<Interface>,
    pub(crate) coat: Arc<Interface>,
    /// Interfaces against the bodies around it, by the bits of their index; see [`Principled::prepare`].
    pub(crate) against: Vec<(u32, Arc<Interface>)>,
}

const COAT_IOR: f32 = 1.5;

impl Principled {
    /// A dielectric of an index with a diffuse base of a colour, fully rough; change what differs. An index below 1 is for bodies that transmit: they
    /// reflect totally from outside. It is at least 0.1, and 1 itself is taken for 1.0001.
    pub fn new(base_color: Color, ior: f32) -> Self {
        let ior = if ior < 1.0 { ior.clamp(0.1, 0.9999) } else { ior.max(1.0001) };
        Principled {
            base_color,
            metallic: Scalar::Constant(0.0),
            roughness: Scalar::Constant(1.0),
            anisotropy: None,
            ior,
            dispersion: None,
            transmission: Scalar::Constant(0.0),
            kind: Transmission::Thin,
            pane: false,
            layered: false,
            clearcoat: Scalar::Constant(0.0),
            clearcoat_roughness: Scalar::Constant(0.0),
            specular: Scalar::Constant(1.0),
            specular_color: Color::rgb(1.0, 1.0, 1.0),
            tinted: false,
            film: None,
            sheen: None,
            // Tables are of the denser side against the thinner, whichever the body is.
            interface: Interface::of(ior.max(1.0 / ior)),
            coat: Interface::of(COAT_IOR),
            against: Vec::new(),
        }
    }

    /// Computes every table that rays will ask for; `around`: indices of the bodies that it may lie in or touch. Without it the first
    /// rays compute them.
    pub(super) fn prepare(&mut self, around: &[f32]) {
        let anisotropic = self.anisotropy.is_some();
        let smooth = matches!(self.roughness, Scalar::Constant(r) if r * r < SMOOTH) && !anisotropic;
        let body = matches!(self.kind, Transmission::Solid) && !matches!(self.transmission, Scalar::Constant(t) if t <= 0.0);
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

    /// Clear, smooth glass of an index: a solid body.
    pub fn glass(ior: f32) -> Self {
        Principled {
            roughness: Scalar::Constant(0.0),
            transmission: Scalar::Constant(1.0),
            kind: Transmission::Solid,
            ..Principled::new(Color::rgb(1.0, 1.0, 1.0), ior)
        }
    }

    /// Whether it may be a smooth thin sheet that lets light through.
    pub(super) fn may_transmit_straight(&self) -> bool {
        let smooth = match &self.roughness {
            Scalar::Constant(r) => r * r < SMOOTH,
            _ => true,
        };
        matches!(self.kind, Transmission::Thin) && smooth && !matches!(self.transmission, Scalar::Constant(t) if t <= 0.0)
    }

    /// A base whose light is thrown back at the interface from within, again and again: ρ (1 − F) / (n² (1 − ρ F')), F being what the interface
    /// reflects of light from everywhere outside and F' = 1 − (1 − F) / n² from within. Source: the plastic of W. Jakob's Mitsuba and of
    /// pbrt's layered materials in closed form; F' by reciprocity (Walter et al. 2007).
    fn seen_through(&self, base: Sampled, roughness: f32) -> Sampled {
        let through = 1.0 - self.interface.average_reflected(if roughness * roughness < SMOOTH { 0.0 } else { roughness });
        let n2 = self.ior * self.ior;
        let within = 1.0 - through / n2;
        base * through / (n2 * (Sampled::ONE - base * within))
    }

    /// `around`: what is on the outer side, if it is no vacuum.
    pub(super) fn at(
        &self,
        surface: &Surface,
        wo: Vec3,
        wavelengths: &Wavelengths,
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
            Tint { weight: w, f0, normal: (color * f0).min(Sampled::ONE) * w }
        });
        let film = self.film.as_ref().and_then(|film| film.at(surface, wavelengths)).map(|layer| {
            let below = tint.as_ref().map_or(Sampled::splat(n), |t| index_of(t.normal));
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
            pane: self.pane,
            metallic,
            roughness,
            facets,
            transmission,
            solid,
            inside_denser,
            bend,
            eta: relative(self.ior, outer_ior),
            dispersive,
            dispersed: if dispersive { wavelengths.hero_only() } else { Sampled::ONE },
            coat: if inside { 0.0 } else { self.clearcoat.at(surface).clamp(0.0, 1.0) },
            coat_roughness: self.clearcoat_roughness.at(surface).clamp(0.04, 1.0),
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
enum Against<'a> {
    Prepared(&'a Interface),
    Looked(Arc<Interface>),
}

/// Index of the table of two media: of the denser one against the thinner.
fn between(ior: f32, outer: f32) -> f32 {
    let n = ior / outer;
    n.max(1.0 / n).max(1.0001)
}

/// The model at a point.
pub(super) struct PrincipledLobes<'a> {
    base: Sampled,
    /// The diffuse base as it counts below the interface.
    under: Sampled,
    pane: bool,
    metallic: f32,
    roughness: f32,
    facets: Ggx,
    transmission: f32,
    solid: bool,
    /// Whether light is seen from the denser side.
    inside_denser: bool,
    /// Relative index by which the hero wavelength is bent.
    bend: f32,
    /// Relative index for reflectances.
    eta: f32,
    dispersive: bool,
    /// Factor on refracted light: all wavelengths, or the hero alone.
    dispersed: Sampled,
    coat: f32,
    coat_roughness: f32,
    interface: &'a Interface,
    tint: Option<Tint>,
    film: Option<OverFilm>,
    sheen: Option<SheenLobe>,
    /// The interface against what is around, if that is no vacuum.
    between: Option<Against<'a>>,
    coat_interface: &'a Interface,
    seen: View,
}

/// A dielectric's reflection made weaker or coloured (KHR_materials_specular): at normal incidence it is `normal`, at grazing `weight`.
struct Tint {
    weight: f32,
    /// Of the dielectric itself.
    f0: f32,
    normal: Sampled,
}

impl Tint {
    fn of(&self, reflected: f32) -> Sampled {
        // Below 0 where rough facets lose light: a weight alone then stays a factor.
        let rise = (reflected - self.f0) / (1.0 - self.f0);
        (self.normal + (Sampled::splat(self.weight) - self.normal) * rise).max(Sampled::ZERO)
    }
}

/// A film and the bases under it.
struct OverFilm {
    layer: FilmLayer,
    /// Index of the dielectric.
    below: Sampled,
    /// Of a real one that reflects as much as the metal.
    metal: Sampled,
    /// Sine outside over sine on the side of view.
    outer_sin: f32,
    /// What the dielectric reflects of light from everywhere.
    average: Sampled,
}

impl OverFilm {
    fn reflectance(&self, cos: f32, base: Sampled) -> Sampled {
        let outer = 1.0 - (1.0 - cos * cos) * self.outer_sin * self.outer_sin;
        if outer <= 0.0 { Sampled::ONE } else { self.layer.reflectance(outer.sqrt(), base) }
    }
}

/// What depends on the direction of view only.
#[derive(Clone, Copy, Default)]
struct View {
    /// Fraction the dielectric layer reflects, or keeps from what is below.
    reflected: Sampled,
    /// Factor that gives back what single scattering loses: metal, solid glass.
    metal_gain: Sampled,
    glass_gain: f32,
    /// What the coat lets through, and reflects.
    below_coat: f32,
    /// Probabilities of the lobes: specular, diffuse, transmission, coat, sheen.
    choice: [f32; 5],
}

impl PrincipledLobes<'_> {
    /// Fraction of light that the dielectric reflects at a cosine, with its tint and film: by one face, or by both of a pane. Source: pbrt, §9.5.1:
    /// R + T² R / (1 − R²).
    fn dielectric(&self, cos: f32) -> Sampled {
        let r = fresnel_dielectric(cos, self.eta);
        let bare = if self.pane { 2.0 * r / (1.0 + r) } else { r };
        let bare = self.tint.as_ref().map_or(Sampled::splat(bare), |t| t.of(bare));
        let Some(film) = &self.film else { return bare };
        let r = film.reflectance(cos, film.below);
        let covered = if self.pane { r * 2.0 / (Sampled::ONE + r) } else { r };
        bare.lerp(covered, film.layer.fraction)
    }

    /// Reflectance of the metal at a cosine.
    fn metal(&self, cos: f32) -> Sampled {
        let bare = fresnel_schlick(cos, self.base);
        match &self.film {
            Some(film) => bare.lerp(film.reflectance(cos, film.metal), film.layer.fraction),
            None => bare,
        }
    }

    /// What layers below go without in a direction: the largest of a tint's colours, of films each wavelength's own.
    fn directional_albedo(&self, w: Vec3) -> Sampled {
        let cos = w.z;
        let reflected = match self.smooth() {
            true => fresnel_dielectric(cos, self.eta),
            false => self.interface().reflected(self.facets, w),
        };
        let bare = self.tint.as_ref().map_or(reflected, |t| t.of(reflected).max_element());
        let Some(film) = &self.film else { return Sampled::splat(bare) };
        let mirror_albedo_at = self.mirror_albedo_at(w);
        let cos = if self.smooth() { cos } else { cosine_of(reflected / mirror_albedo_at, self.eta) };
        Sampled::splat(bare).lerp(film.reflectance(cos, film.below) * mirror_albedo_at, film.layer.fraction)
    }

    /// The same of light from everywhere.
    fn average_albedo(&self, roughness: f32) -> Sampled {
        let reflected = self.interface().average_reflected(roughness);
        let bare = self.tint.as_ref().map_or(reflected, |t| t.of(reflected).max_element());
        let Some(film) = &self.film else { return Sampled::splat(bare) };
        Sampled::splat(bare).lerp(film.average, film.layer.fraction)
    }

    /// Fraction that a perfect mirror of these facets reflects at once.
    fn mirror_albedo_at(&self, w: Vec3) -> f32 {
        mirror_albedo_at(self.facets, w)
    }

    fn interface(&self) -> &Interface {
        match &self.between {
            None => self.interface,
            Some(Against::Prepared(interface)) => interface,
            Some(Against::Looked(interface)) => interface,
        }
    }

    /// What transmitted radiance is divided by.
    pub(super) fn eta_scale(&self) -> f32 {
        if self.solid { self.bend * self.bend } else { 1.0 }
    }

    fn smooth(&self) -> bool {
        self.facets.is_smooth()
    }

    fn view(&self, wo: Vec3) -> View {
        let mirror = self.mirror_albedo_at(wo);
        // A pane keeps what both of its faces reflect.
        let reflected = if self.pane { self.dielectric(wo.z) } else { self.directional_albedo(wo) };
        let glass = if self.smooth() || self.transmission == 0.0 || !self.solid {
            1.0
        } else {
            let side = if self.inside_denser { Side::Inside } else { Side::Outside };
            self.interface().directional_albedo(side, self.facets, wo)
        };
        let coat_reflected =
            if self.coat > 0.0 { self.coat * self.coat_interface.reflected(self.coat_facets(), wo) } else { 0.0 };
        let below_coat = 1.0 - coat_reflected;

        let base = self.base.element_sum() * 0.25;
        let dielectric = 1.0 - self.metallic;
        let mean = |s: Sampled| s.element_sum() * 0.25;
        let (fresnel, reflected_mean) = (mean(self.dielectric(wo.z)), mean(reflected));
        let (first, second) = if self.solid {
            (reflected_mean * (1.0 - self.transmission) + fresnel * self.transmission, 1.0 - fresnel)
        } else {
            (reflected_mean, 1.0 - reflected_mean)
        };
        let directional_albedo = self.sheen.map_or(0.0, |f| f.directional_albedo(wo.z).min(1.0));
        let below = below_coat * (1.0 - directional_albedo);
        let metal = if self.film.is_some() { mean(self.metal(wo.z)) } else { base };
        let mut weights = [
            below * (self.metallic * metal.max(0.04) + dielectric * first),
            below * dielectric * (1.0 - self.transmission) * (1.0 - reflected_mean) * base,
            below * dielectric * self.transmission * second * base,
            coat_reflected,
            below_coat * directional_albedo,
        ];
        // Beside a diffuse base, whose direct light is aimed at anyway, reflections are looked at more often than by their fraction: they show lamps.
        for reflection in [0, 3] {
            weights[reflection] = (weights[reflection] * (weights[reflection] + weights[1])).sqrt();
        }
        if self.by_facet() {
            weights[0] += weights[2];
            weights[2] = 0.0;
        }
        let total: f32 = weights.iter().sum();
        let choice = if total > 0.0 { weights.map(|w| w / total) } else { [1.0, 0.0, 0.0, 0.0, 0.0] };
        View {
            reflected,
            metal_gain: Sampled::ONE + self.base * ((1.0 - mirror) / mirror),
            glass_gain: 1.0 / glass.max(1e-3),
            below_coat,
            choice,
        }
    }

    /// Whether each facet decides between reflection and refraction: a mean plane would reflect all where single facets
    /// still transmit. The specular lobe then stands for both.
    fn by_facet(&self) -> bool {
        self.solid && self.transmission > 0.0 && !self.smooth()
    }

    /// Fraction of what a facet met at a cosine sends on that it should be seen to reflect.
    fn reflected_share(&self, view: &View, cos: f32) -> f32 {
        if !self.by_facet() {
            return 1.0;
        }
        let mean = |s: Sampled| s.element_sum() * 0.25;
        let reflects = mean(self.facet_reflectance(view, cos));
        let amount = view.below_coat * (1.0 - self.metallic) * self.transmission * view.glass_gain;
        let transmits = amount * mean((Sampled::ONE - self.dielectric(cos)) * self.base);
        if transmits > 0.0 { reflects / (reflects + transmits) } else { 1.0 }
    }

    fn coat_facets(&self) -> Ggx {
        Ggx::even(self.coat_roughness * self.coat_roughness)
    }

    /// What the sheen lets through on the way in and out.
    fn past_sheen(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.sheen.map_or(1.0, |f| f.through(wo, wi))
    }

    /// Reflectance of a facet, everything but the distribution of facets.
    fn facet_reflectance(&self, view: &View, cos: f32) -> Sampled {
        let solid = if self.solid { self.transmission } else { 0.0 };
        let dielectric = self.dielectric(cos) * (1.0 - solid + solid * view.glass_gain);
        (self.metal(cos) * view.metal_gain * self.metallic + dielectric * (1.0 - self.metallic)) * view.below_coat
    }

    /// Gets ready to be seen from a direction; everything below is asked for that one.
    pub(super) fn look_from(&mut self, wo: Vec3) {
        self.seen = self.view(wo);
    }

    /// What a smooth thin sheet lets straight through.
    pub(super) fn straight_through(&self, wo: Vec3) -> Option<Sampled> {
        if self.solid || !self.smooth() || self.transmission <= 0.0 {
            return None;
        }
        let amount = self.seen.below_coat * (1.0 - self.metallic) * self.transmission * self.past_sheen(wo, -wo);
        Some(self.base * (Sampled::ONE - self.dielectric(wo.z)) * amount)
    }

    /// Whether all it does is to mirror and to let through.
    pub(super) fn is_specular(&self) -> bool {
        let [_, diffuse, _, coat, sheen] = self.seen.choice;
        self.smooth() && diffuse == 0.0 && coat == 0.0 && sheen == 0.0
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Sampled, f32) {
        self.eval_lobes(wo, wi, 0.0)
    }

    /// Which lobes it has, without those that are specular.
    pub(super) fn breadth(&self, least_alpha: f32) -> Breadth {
        let [_, diffuse, _, coat, sheen] = self.seen.choice;
        let coat_facets = self.coat_facets();
        let mut breadth = Breadth { broad: diffuse > 0.0 || sheen > 0.0, narrow: false };
        for (present, facets) in [(!self.smooth(), self.facets), (coat > 0.0, coat_facets)] {
            breadth.broad |= present && facets.is_wide(least_alpha);
            breadth.narrow |= present && !facets.is_wide(least_alpha);
        }
        breadth
    }

    /// [`PrincipledLobes::eval`] without the lobes that are narrower than a GGX width.
    #[inline]
    pub(super) fn eval_lobes(&self, wo: Vec3, wi: Vec3, least_alpha: f32) -> (Sampled, f32) {
        let wide = !self.smooth() && self.facets.is_wide(least_alpha);
        let view = &self.seen;
        let [p_specular, p_diffuse, p_transmission, p_coat, p_sheen] = view.choice;
        let (mut f, mut pdf) = (Sampled::ZERO, 0.0);
        if wi.z > 0.0 {
            let h = (wo + wi).normalize();
            let cos = wo.dot(h);
            if wide {
                let d = self.facets.d(h) / (4.0 * wo.z);
                f += self.facet_reflectance(view, cos) * (d * self.facets.g2(wo, wi));
                pdf += p_specular * self.reflected_share(view, cos) * d * self.facets.g1(wo);
            }
            if p_diffuse > 0.0 {
                f += self.diffuse(wi);
                pdf += p_diffuse * wi.z * FRAC_1_PI;
            }
            if let Some(sheen) = &self.sheen {
                f = f * sheen.through(wo, wi) + sheen.eval(wo, wi) * view.below_coat;
                pdf += p_sheen / TAU;
            }
            let facets = self.coat_facets();
            if p_coat > 0.0 && facets.is_wide(least_alpha) {
                let d = facets.d(h) / (4.0 * wo.z);
                f += Sampled::splat(self.coat * fresnel_dielectric(cos, COAT_IOR) * d * facets.g2(wo, wi));
                pdf += p_coat * d * facets.g1(wo);
            }
        } else if (p_transmission > 0.0 || self.by_facet()) && wide && wi.z < 0.0 {
            let amount = view.below_coat * (1.0 - self.metallic) * self.transmission * self.past_sheen(wo, wi);
            if self.solid {
                let (value, density, cos) = self.eval_refraction(wo, wi);
                f += self.base * self.dispersed * (Sampled::ONE - self.dielectric(cos)) * (amount * view.glass_gain * value);
                pdf += p_specular * (1.0 - self.reflected_share(view, cos)) * density;
            } else {
                // A blurred view straight through: the mirror lobe folded to the other side.
                let wi = Vec3::new(wi.x, wi.y, -wi.z);
                let h = (wo + wi).normalize();
                let d = self.facets.d(h) / (4.0 * wo.z);
                let gain = (Sampled::ONE - view.reflected) / self.mirror_albedo_at(wo);
                f += self.base * gain * (amount * d * self.facets.g2(wo, wi));
                pdf += p_transmission * d * self.facets.g1(wo);
            }
        }
        (f, pdf)
    }

    /// f cos θ of the diffuse base, with what the interface above it keeps on both ways.
    #[inline]
    fn diffuse(&self, wi: Vec3) -> Sampled {
        let r = if self.smooth() { 0.0 } else { self.roughness };
        let into = Sampled::ONE - self.directional_albedo(wi);
        let fraction =
            (Sampled::ONE - self.seen.reflected) * into / (Sampled::ONE - self.average_albedo(r)).max(Sampled::splat(1e-3));
        let amount = self.seen.below_coat * (1.0 - self.metallic) * (1.0 - self.transmission);
        self.under * fraction * (amount * wi.z * FRAC_1_PI)
    }

    /// D G … of rough refraction times cos θi (without 1 − F), its density, and wo·h. Source: Walter et al. 2007 eq. 21; PBR 9.7.
    fn eval_refraction(&self, wo: Vec3, wi: Vec3) -> (f32, f32, f32) {
        let Some(h) = (wi * self.bend + wo).try_normalize() else { return (0.0, 0.0, 1.0) };
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_i, cos_o) = (wi.dot(h), wo.dot(h));
        if cos_i * wi.z < 0.0 || cos_o * wo.z < 0.0 {
            return (0.0, 0.0, 1.0);
        }
        let denominator = (cos_i + cos_o / self.bend).powi(2);
        let jacobian = cos_i.abs() / denominator;
        let pdf = self.facets.visible_pdf(wo, h) * jacobian;
        let g = self.facets.g2(wo, Vec3::new(wi.x, wi.y, -wi.z));
        let f = self.facets.d(h) * g * (cos_i * cos_o / (wo.z * denominator)).abs();
        // Radiance scales by η² as its cone narrows on the denser side: (n_i / n_t)² along the path from the camera.
        (f / (self.bend * self.bend), pdf, cos_o)
    }

    pub(super) fn sample(&self, wo: Vec3, u: [f32; 4]) -> Option<LocalScatter> {
        let view = &self.seen;
        let [p_specular, p_diffuse, p_transmission, p_coat, _] = view.choice;
        let amount = view.below_coat * (1.0 - self.metallic) * self.transmission;
        let direction = [u[0], u[1]];
        let mut disperses = false;
        let wi = if u[2] < p_specular {
            if self.smooth() {
                let wi = Vec3::new(-wo.x, -wo.y, wo.z);
                let weight = self.facet_reflectance(view, wo.z) * (self.past_sheen(wo, wi) / p_specular);
                return Some(LocalScatter { wi, weight, pdf: p_specular, specular: true, disperses });
            }
            let h = self.facets.sample_visible(wo, direction);
            if u[2] < p_specular * self.reflected_share(view, wo.dot(h)) {
                above(reflect(wo, h))?
            } else {
                disperses = self.dispersive;
                below(refract(wo, h, self.bend)?)?
            }
        } else if u[2] < p_specular + p_diffuse {
            sampling::cosine_hemisphere(direction)
        } else if u[2] < p_specular + p_diffuse + p_transmission {
            if self.smooth() {
                disperses = self.dispersive && self.solid;
                let (wi, scale) = match self.solid {
                    true => (refract(wo, Vec3::Z, self.bend)?, 1.0 / (self.bend * self.bend)),
                    false => (-wo, 1.0),
                };
                let fraction = (Sampled::ONE - self.dielectric(wo.z)) * (amount * self.past_sheen(wo, wi) / p_transmission);
                return Some(LocalScatter {
                    wi,
                    weight: self.base * fraction * scale,
                    pdf: p_transmission,
                    specular: true,
                    disperses,
                });
            }
            let wi = above(reflect(wo, self.facets.sample_visible(wo, direction)))?;
            Vec3::new(wi.x, wi.y, -wi.z)
        } else if u[2] < p_specular + p_diffuse + p_transmission + p_coat || self.sheen.is_none() {
            above(reflect(wo, self.coat_facets().sample_visible(wo, direction)))?
        } else {
            // Evenly over the hemisphere: sheen is strongest at grazing angles.
            let (z, phi) = (direction[0], TAU * direction[1]);
            let r = (1.0 - z * z).sqrt();
            above(Vec3::new(r * phi.cos(), r * phi.sin(), z))?
        };
        let (f, pdf) = self.eval(wo, wi);
        if !(pdf > 0.0) {
            return None;
        }
        // `eval` gives the dispersed lobe to the hero alone already; the path must not do so again.
        let weight = if disperses { Sampled::splat(f.x / self.dispersed.x) } else { f } / pdf;
        Some(LocalScatter { wi, weight, pdf, specular: false, disperses })
    }
}

/// A facet can send light to the wrong side of the surface; single scattering loses it there (and the tables know).
fn above(wi: Vec3) -> Option<Vec3> {
    (wi.z > 0.0).then_some(wi)
}

fn below(wi: Vec3) -> Option<Vec3> {
    (wi.z < 0.0).then_some(wi)
}

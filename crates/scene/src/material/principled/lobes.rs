//! The lobes of the principled material at a point: evaluation, sampling, and what each layer keeps from those below.

use super::{Against, COAT_IOR};
use crate::material::coat::CoatNormal;
use crate::material::energy::{Interface, Side, mirror_albedo_at};
use crate::material::film::FilmLayer;
use crate::material::local_scatter::{Breadth, LocalScatter};
use crate::material::microfacet::{Ggx, cosine_of, fresnel_dielectric, fresnel_schlick, reflect, refract};
use crate::material::sheen::SheenLobe;
use diopter_light::{SampledSpectrum, sampling};
use glam::{Quat, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// The model at a point.
#[derive(Clone)]
pub(in crate::material) struct PrincipledLobes<'a> {
    pub(super) base: SampledSpectrum,
    /// The diffuse base as it counts below the interface.
    pub(super) under: SampledSpectrum,
    pub(super) thin_dielectric: bool,
    pub(super) metallic: f32,
    pub(super) roughness: f32,
    pub(super) facets: Ggx,
    pub(super) transmission: f32,
    pub(super) solid: bool,
    /// Whether light is seen from the denser side.
    pub(super) inside_denser: bool,
    /// Relative index by which the hero wavelength is bent.
    pub(super) bend: f32,
    /// Relative index for reflectances.
    pub(super) eta: f32,
    pub(super) dispersive: bool,
    /// Factor on refracted light: all wavelengths, or the hero alone.
    pub(super) dispersed: SampledSpectrum,
    pub(super) coat: f32,
    pub(super) coat_roughness: f32,
    pub(super) coat_normal: Option<&'a CoatNormal>,
    /// Takes directions to axes whose z is the normal of the coat, where that is another.
    pub(super) coat_turn: Option<Quat>,
    pub(super) interface: &'a Interface,
    pub(super) tint: Option<Tint>,
    pub(super) film: Option<OverFilm>,
    pub(super) sheen: Option<SheenLobe>,
    /// The interface against what is around, if that is no vacuum.
    pub(super) between: Option<Against<'a>>,
    pub(super) coat_interface: &'a Interface,
    pub(super) seen: View,
}

/// A dielectric's reflection made weaker or coloured (KHR_materials_specular): at normal incidence it is `normal`, at grazing `weight`.
#[derive(Clone)]
pub(super) struct Tint {
    pub weight: f32,
    /// Of the dielectric itself.
    pub f0: f32,
    pub normal: SampledSpectrum,
}

impl Tint {
    /// What is reflected where the interface alone would reflect a fraction.
    pub fn of(&self, reflected: f32) -> SampledSpectrum {
        // Less than at normal incidence where rough facets lose light, and before the Brewster angle of high indices: as much less in all colours.
        if reflected < self.f0 {
            return self.normal * (reflected / self.f0);
        }
        let rise = (reflected - self.f0) / (1.0 - self.f0);
        self.normal + (SampledSpectrum::splat(self.weight) - self.normal) * rise
    }
}

/// A film and the bases under it.
#[derive(Clone)]
pub(super) struct OverFilm {
    pub layer: FilmLayer,
    /// Index of the dielectric.
    pub below: SampledSpectrum,
    /// Of a real one that reflects as much as the metal.
    pub metal: SampledSpectrum,
    /// Sine outside over sine on the side of view.
    pub outer_sin: f32,
    /// What the dielectric reflects of light from everywhere.
    pub average: SampledSpectrum,
}

impl OverFilm {
    fn reflectance(&self, cos: f32, base: SampledSpectrum) -> SampledSpectrum {
        let outer = 1.0 - (1.0 - cos * cos) * self.outer_sin * self.outer_sin;
        if outer <= 0.0 { SampledSpectrum::ONE } else { self.layer.reflectance(outer.sqrt(), base) }
    }
}

/// What depends on the direction of view only.
#[derive(Clone, Copy, Default)]
pub(super) struct View {
    /// Fraction the dielectric layer reflects, or keeps from what is below.
    pub reflected: SampledSpectrum,
    /// Factor that gives back what single scattering loses: metal, solid glass.
    pub metal_gain: SampledSpectrum,
    pub glass_gain: f32,
    /// What the coat lets through, and reflects.
    pub below_coat: f32,
    /// Probabilities of the lobes: specular, diffuse, transmission, coat, sheen.
    pub choice: [f32; 5],
}

impl<'a> PrincipledLobes<'a> {
    /// Fraction of light that the dielectric reflects at a cosine, with its tint and film: by one face, or by both of a thin dielectric. Source: pbrt, §9.5.1:
    /// R + T² R / (1 − R²).
    pub(super) fn dielectric(&self, cos: f32) -> SampledSpectrum {
        let r = fresnel_dielectric(cos, self.eta);
        let bare = if self.thin_dielectric { 2.0 * r / (1.0 + r) } else { r };
        let bare = self.tint.as_ref().map_or(SampledSpectrum::splat(bare), |t| t.of(bare));
        let Some(film) = &self.film else { return bare };
        let r = film.reflectance(cos, film.below);
        let covered = if self.thin_dielectric { r * 2.0 / (SampledSpectrum::ONE + r) } else { r };
        bare.lerp(covered, film.layer.fraction)
    }

    /// Reflectance of the metal at a cosine.
    pub(super) fn metal(&self, cos: f32) -> SampledSpectrum {
        let bare = fresnel_schlick(cos, self.base);
        match &self.film {
            Some(film) => bare.lerp(film.reflectance(cos, film.metal), film.layer.fraction),
            None => bare,
        }
    }

    /// What layers below go without in a direction: the largest of a tint's colours, of films each wavelength's own.
    fn directional_albedo(&self, w: Vec3) -> SampledSpectrum {
        let cos = w.z;
        let reflected = match self.smooth() {
            true => fresnel_dielectric(cos, self.eta),
            false => self.interface().reflected(self.facets, w),
        };
        let bare = self.tint.as_ref().map_or(reflected, |t| t.of(reflected).max_element());
        let Some(film) = &self.film else { return SampledSpectrum::splat(bare) };
        let mirror_albedo_at = self.mirror_albedo_at(w);
        let cos = if self.smooth() { cos } else { cosine_of(reflected / mirror_albedo_at, self.eta) };
        SampledSpectrum::splat(bare).lerp(film.reflectance(cos, film.below) * mirror_albedo_at, film.layer.fraction)
    }

    /// The same of light from everywhere.
    fn average_albedo(&self, roughness: f32) -> SampledSpectrum {
        let reflected = self.interface().average_reflected(roughness);
        let bare = self.tint.as_ref().map_or(reflected, |t| t.of(reflected).max_element());
        let Some(film) = &self.film else { return SampledSpectrum::splat(bare) };
        SampledSpectrum::splat(bare).lerp(film.average, film.layer.fraction)
    }

    /// Fraction that a perfect mirror of these facets reflects at once.
    fn mirror_albedo_at(&self, w: Vec3) -> f32 {
        mirror_albedo_at(self.facets, w)
    }

    pub(super) fn interface(&self) -> &Interface {
        match &self.between {
            None => self.interface,
            Some(Against::Prepared(interface)) => interface,
            Some(Against::Looked(interface)) => interface,
        }
    }

    /// What transmitted radiance is divided by.
    pub(in crate::material) fn eta_scale(&self) -> f32 {
        if self.solid { self.bend * self.bend } else { 1.0 }
    }

    pub(super) fn smooth(&self) -> bool {
        self.facets.is_smooth()
    }

    fn view(&self, wo: Vec3) -> View {
        let mirror = self.mirror_albedo_at(wo);
        // A thin dielectric keeps what both of its faces reflect.
        let reflected = if self.thin_dielectric { self.dielectric(wo.z) } else { self.directional_albedo(wo) };
        let glass = if self.smooth() || self.transmission == 0.0 || !self.solid {
            1.0
        } else {
            let side = if self.inside_denser { Side::Inside } else { Side::Outside };
            self.interface().directional_albedo(side, self.facets, wo)
        };
        // A coat that lies edge-on is not seen.
        let over = self.over_coat(wo);
        let coat_reflected = match self.coat > 0.0 && over.z > 0.0 {
            true => self.coat * self.coat_interface.reflected(self.coat_facets(), over),
            false => 0.0,
        };
        let below_coat = 1.0 - coat_reflected;

        let base = self.base.element_sum() * 0.25;
        let dielectric = 1.0 - self.metallic;
        let mean = |s: SampledSpectrum| s.element_sum() * 0.25;
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
        // Beside a diffuse base, whose direct light is sampled anyway, reflections are looked at more often than by their fraction: they show lamps.
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
            metal_gain: SampledSpectrum::ONE + self.base * ((1.0 - mirror) / mirror),
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
    fn reflection_probability(&self, view: &View, cos: f32) -> f32 {
        if !self.by_facet() {
            return 1.0;
        }
        let mean = |s: SampledSpectrum| s.element_sum() * 0.25;
        let reflects = mean(self.facet_reflectance(view, cos));
        let amount = view.below_coat * (1.0 - self.metallic) * self.transmission * view.glass_gain;
        let transmits = amount * mean((SampledSpectrum::ONE - self.dielectric(cos)) * self.base);
        if transmits > 0.0 { reflects / (reflects + transmits) } else { 1.0 }
    }

    pub(super) fn coat_facets(&self) -> Ggx {
        Ggx::even(self.coat_roughness * self.coat_roughness)
    }

    /// What the sheen lets through on the way in and out.
    fn sheen_transmittance(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.sheen.map_or(1.0, |f| f.through(wo, wi))
    }

    /// Reflectance of a facet, everything but the distribution of facets.
    pub(super) fn facet_reflectance(&self, view: &View, cos: f32) -> SampledSpectrum {
        let solid = if self.solid { self.transmission } else { 0.0 };
        let dielectric = self.dielectric(cos) * (1.0 - solid + solid * view.glass_gain);
        (self.metal(cos) * view.metal_gain * self.metallic + dielectric * (1.0 - self.metallic)) * view.below_coat
    }

    /// Where the coat has its normals from, if there is one and these are its own.
    pub(in crate::material) fn coat_normal(&self) -> Option<&'a CoatNormal> {
        self.coat_normal.filter(|_| self.coat > 0.0)
    }

    /// A direction in the axes of the coat.
    fn over_coat(&self, w: Vec3) -> Vec3 {
        self.coat_turn.map_or(w, |turn| turn * w)
    }

    /// Gets ready to be seen from a direction, over a coat of a normal if that is another; everything below is asked for that one.
    pub(in crate::material) fn look_from(&mut self, wo: Vec3, coat_normal: Option<Vec3>) {
        self.coat_turn = coat_normal.map(|normal| Quat::from_rotation_arc(normal, Vec3::Z));
        self.seen = self.view(wo);
    }

    /// What a smooth thin dielectric lets straight through.
    pub(in crate::material) fn straight_through(&self, wo: Vec3) -> Option<SampledSpectrum> {
        if self.solid || !self.smooth() || self.transmission <= 0.0 {
            return None;
        }
        let amount = self.seen.below_coat * (1.0 - self.metallic) * self.transmission * self.sheen_transmittance(wo, -wo);
        Some(self.base * (SampledSpectrum::ONE - self.dielectric(wo.z)) * amount)
    }

    /// Whether all it does is to mirror and to let through.
    pub(in crate::material) fn is_specular(&self) -> bool {
        let [_, diffuse, _, coat, sheen] = self.seen.choice;
        self.smooth() && diffuse == 0.0 && coat == 0.0 && sheen == 0.0
    }

    pub(in crate::material) fn eval(&self, wo: Vec3, wi: Vec3) -> (SampledSpectrum, f32) {
        self.eval_lobes(wo, wi, 0.0)
    }

    /// Whether any light goes through.
    pub(in crate::material) fn transmits(&self) -> bool {
        self.seen.choice[2] > 0.0 || self.by_facet()
    }

    /// Which lobes it has, without those that are specular.
    pub(in crate::material) fn breadth(&self, least_alpha: f32) -> Breadth {
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
    pub(in crate::material) fn eval_lobes(&self, wo: Vec3, wi: Vec3, least_alpha: f32) -> (SampledSpectrum, f32) {
        let wide = !self.smooth() && self.facets.is_wide(least_alpha);
        let view = &self.seen;
        let [p_specular, p_diffuse, p_transmission, p_coat, p_sheen] = view.choice;
        let (mut f, mut pdf) = (SampledSpectrum::ZERO, 0.0);
        if wi.z > 0.0 {
            let h = (wo + wi).normalize();
            let cos = wo.dot(h);
            if wide {
                let d = self.facets.d(h) / (4.0 * wo.z);
                f += self.facet_reflectance(view, cos) * (d * self.facets.g2(wo, wi));
                pdf += p_specular * self.reflection_probability(view, cos) * d * self.facets.g1(wo);
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
            let (wo, wi, h) = (self.over_coat(wo), self.over_coat(wi), self.over_coat(h));
            if p_coat > 0.0 && facets.is_wide(least_alpha) && wo.z > 0.0 && wi.z > 0.0 {
                let d = facets.d(h) / (4.0 * wo.z);
                f += SampledSpectrum::splat(self.coat * fresnel_dielectric(cos, COAT_IOR) * d * facets.g2(wo, wi));
                pdf += p_coat * d * facets.g1(wo);
            }
        } else if (p_transmission > 0.0 || self.by_facet()) && wide && wi.z < 0.0 {
            let amount = view.below_coat * (1.0 - self.metallic) * self.transmission * self.sheen_transmittance(wo, wi);
            if self.solid {
                let (value, density, cos) = self.eval_refraction(wo, wi);
                f += self.base
                    * self.dispersed
                    * (SampledSpectrum::ONE - self.dielectric(cos))
                    * (amount * view.glass_gain * value);
                pdf += p_specular * (1.0 - self.reflection_probability(view, cos)) * density;
            } else {
                // A blurred view straight through: the mirror lobe folded to the other side.
                let wi = Vec3::new(wi.x, wi.y, -wi.z);
                let h = (wo + wi).normalize();
                let d = self.facets.d(h) / (4.0 * wo.z);
                let gain = (SampledSpectrum::ONE - view.reflected) / self.mirror_albedo_at(wo);
                f += self.base * gain * (amount * d * self.facets.g2(wo, wi));
                pdf += p_transmission * d * self.facets.g1(wo);
            }
        }
        (f, pdf)
    }

    /// f cos θ of the diffuse base, with what the interface above it keeps on both ways.
    #[inline]
    pub(super) fn diffuse(&self, wi: Vec3) -> SampledSpectrum {
        let r = if self.smooth() { 0.0 } else { self.roughness };
        let into = SampledSpectrum::ONE - self.directional_albedo(wi);
        let fraction = (SampledSpectrum::ONE - self.seen.reflected) * into
            / (SampledSpectrum::ONE - self.average_albedo(r)).max(SampledSpectrum::splat(1e-3));
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

    /// Whether wavelengths go through different ways.
    pub(in crate::material) fn disperses(&self) -> bool {
        self.dispersive && self.solid
    }

    /// The lobes of a smooth surface that are specular: what it mirrors and what it lets through, each with the probability of its choice.
    pub(in crate::material) fn specular(&self, wo: Vec3) -> [Option<LocalScatter>; 2] {
        let [p_specular, _, p_transmission, ..] = self.seen.choice;
        let of = |probability: f32| self.smooth() && probability > 0.0;
        [of(p_specular).then(|| self.mirror(wo)), if of(p_transmission) { self.clear(wo) } else { None }]
    }

    /// What a smooth surface mirrors.
    #[inline]
    fn mirror(&self, wo: Vec3) -> LocalScatter {
        let (view, wi) = (&self.seen, Vec3::new(-wo.x, -wo.y, wo.z));
        let probability = view.choice[0];
        let weight = self.facet_reflectance(view, wo.z) * (self.sheen_transmittance(wo, wi) / probability);
        LocalScatter { wi, weight, pdf: probability, specular: true, disperses: false }
    }

    /// What a smooth surface lets through; `None` where all is reflected.
    #[inline]
    fn clear(&self, wo: Vec3) -> Option<LocalScatter> {
        let view = &self.seen;
        let probability = view.choice[2];
        let (wi, scale) = match self.solid {
            true => (refract(wo, Vec3::Z, self.bend)?, 1.0 / (self.bend * self.bend)),
            false => (-wo, 1.0),
        };
        let amount = view.below_coat * (1.0 - self.metallic) * self.transmission;
        let fraction = (SampledSpectrum::ONE - self.dielectric(wo.z)) * (amount * self.sheen_transmittance(wo, wi) / probability);
        let disperses = self.disperses();
        Some(LocalScatter { wi, weight: self.base * fraction * scale, pdf: probability, specular: true, disperses })
    }

    pub(in crate::material) fn sample(&self, wo: Vec3, u: [f32; 4]) -> Option<LocalScatter> {
        let view = &self.seen;
        let [p_specular, p_diffuse, p_transmission, p_coat, _] = view.choice;
        let direction = [u[0], u[1]];
        let mut disperses = false;
        let wi = if u[2] < p_specular {
            if self.smooth() {
                return Some(self.mirror(wo));
            }
            let h = self.facets.sample_visible(wo, direction);
            if u[2] < p_specular * self.reflection_probability(view, wo.dot(h)) {
                above(reflect(wo, h))?
            } else {
                disperses = self.dispersive;
                below(refract(wo, h, self.bend)?)?
            }
        } else if u[2] < p_specular + p_diffuse {
            sampling::cosine_hemisphere(direction)
        } else if u[2] < p_specular + p_diffuse + p_transmission {
            if self.smooth() {
                return self.clear(wo);
            }
            let wi = above(reflect(wo, self.facets.sample_visible(wo, direction)))?;
            Vec3::new(wi.x, wi.y, -wi.z)
        } else if u[2] < p_specular + p_diffuse + p_transmission + p_coat || self.sheen.is_none() {
            let over = self.over_coat(wo);
            let wi = above(reflect(over, self.coat_facets().sample_visible(over, direction)))?;
            above(self.coat_turn.map_or(wi, |turn| turn.inverse() * wi))?
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
        let weight = if disperses { SampledSpectrum::splat(f.x / self.dispersed.x) } else { f } / pdf;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tint_stays_where_less_is_reflected_than_at_normal_incidence() {
        let normal = SampledSpectrum::new(0.3, 0.6, 0.15, 0.6);
        let tint = Tint { weight: 1.0, f0: 0.6, normal };
        // As it is before the Brewster angle of an index of 8: all colours alike.
        assert!((tint.of(0.45) - normal * 0.75).abs().max_element() < 1e-6);
        assert!((tint.of(0.6) - normal).abs().max_element() < 1e-6);
        assert!((tint.of(1.0) - SampledSpectrum::ONE).abs().max_element() < 1e-6);
        // A weight alone is a factor everywhere.
        let weight = Tint { weight: 0.5, f0: 0.04, normal: SampledSpectrum::splat(0.02) };
        assert!(
            [0.0, 0.03, 0.04, 0.3, 1.0]
                .iter()
                .all(|r| (weight.of(*r) - SampledSpectrum::splat(0.5 * r)).abs().max_element() < 1e-6)
        );
    }
}

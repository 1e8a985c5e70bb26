//! A clear coat over metal: light is bent into the coat, meets the metal, and is bent out again.
//!
//! Directions within the coat are those through a smooth surface, roughness blurs only what the coat itself reflects. What the coat holds back
//! and the metal scatters again is added in the shape of what comes out at once: exact where both are smooth, and whatever the roughness a
//! coat over a perfect metal whose facets lose nothing ([`super::conductor::FacetBounces`]) loses nothing. Source of the change of variables: A. Weidlich, A. Wilkie 2007, "Arbitrarily Layered Micro-Facet
//! Surfaces".

use super::conductor::{Conductor, ConductorLobe};
use super::energy::{Escape, Interface, prepare_mirrors};
use super::inputs::inputs_struct;
use super::local_scatter::LocalScatter;
use super::microfacet::{Ggx, fresnel_dielectric, reflect, refract};
use super::polarization::{Event, dielectric, s_axis};
use crate::exact::{Exact, Sink, Source, field};
use crate::shape::Surface;
use crate::texture::Scalar;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;
use serde_json::Value;
use std::sync::Arc;

/// Metal under a clear dielectric.
#[derive(Clone, Debug)]
pub struct CoatedConductor {
    /// The metal; its constants are against vacuum.
    pub metal: Conductor,
    /// √α of the coat's GGX distribution.
    pub roughness: Scalar,
    /// That across the tangent, where it is another.
    pub across: Option<Scalar>,
    ior: f32,
    interface: Arc<Interface>,
    escape: Arc<Escape>,
}

inputs_struct!(CoatedConductor { metal, roughness, across } without { ior, interface, escape });

impl CoatedConductor {
    /// A coat of an index (taken as at least 1.0001) over a metal; `roughness`: √α of the coat's facets, 0 to 1.
    pub fn new(metal: Conductor, ior: f32, roughness: Scalar) -> Self {
        let ior = ior.max(1.0001);
        CoatedConductor { metal, roughness, across: None, ior, interface: Interface::of(ior), escape: Escape::of(ior) }
    }

    /// Computes every table that rays will ask for.
    pub(super) fn prepare(&self) {
        self.metal.prepare();
        prepare_mirrors(self.across.is_some());
        self.interface.prepare(self.across.is_some(), false);
    }

    pub(super) fn at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> CoatedLobes<'_> {
        let metal = self.metal.at(surface, wavelengths).within(self.ior);
        let along = self.roughness.at(surface).clamp(0.0, 1.0);
        let across = self.across.as_ref().map_or(along, |r| r.at(surface).clamp(0.0, 1.0));
        let facets = Ggx::new(along * along, across * across);
        CoatedLobes { metal, ior: self.ior, facets, interface: &self.interface, escape: &self.escape }
    }

    /// Reflectance at normal incidence in red, green and blue.
    pub fn normal_reflectance(&self) -> Vec3 {
        let (f, r) = (fresnel_dielectric(1.0, self.ior), self.metal.normal_reflectance());
        Vec3::splat(f) + r * ((1.0 - f) * (1.0 - f)) / (Vec3::ONE - r * f)
    }
}

/// The model at a point.
#[derive(Clone)]
pub(super) struct CoatedLobes<'a> {
    metal: ConductorLobe,
    ior: f32,
    facets: Ggx,
    interface: &'a Interface,
    escape: &'a Escape,
}

impl CoatedLobes<'_> {
    /// Fraction that the coat reflects of light from a direction.
    fn reflected(&self, w: Vec3) -> f32 {
        match self.facets.is_smooth() {
            true => fresnel_dielectric(w.z, self.ior),
            false => self.interface.reflected(self.facets, w),
        }
    }

    /// Probability of looking at the coat.
    fn choice(&self, wo: Vec3) -> f32 {
        self.reflected(wo).clamp(0.1, 0.9)
    }

    /// The direction within the coat, on the side of the normal.
    fn bent(&self, w: Vec3) -> Option<Vec3> {
        refract(w, Vec3::Z, self.ior).map(|t| -t)
    }

    /// What is left of light on its way in and out, with what goes to and fro; `inner_o` is the direction of view within the coat.
    fn through(&self, wo: Vec3, wi: Vec3, inner_o: Vec3) -> SampledSpectrum {
        self.again(wo, inner_o) * ((1.0 - self.reflected(wo)) * (1.0 - fresnel_dielectric(wi.z, self.ior)))
    }

    /// All that comes out over what comes out at once.
    fn again(&self, wo: Vec3, inner_o: Vec3) -> SampledSpectrum {
        let r = self.metal.normal(inner_o.z);
        let facets = self.metal.facets();
        let [escapes, mean] = match facets.is_smooth() {
            true => [1.0 - fresnel_dielectric(wo.z, self.ior); 2],
            false => self.escape.at(wo.z, facets.roughness_aside(wo)),
        };
        let held = (1.0 - escapes) * mean / escapes.max(1e-3);
        SampledSpectrum::ONE + r * held / (SampledSpectrum::ONE - r * (1.0 - mean)).max(SampledSpectrum::splat(1e-3))
    }

    /// The event as a Mueller matrix, in the local frame: of the lobes that are specular, or of the others. Of light that was held back by the coat over a
    /// rough metal nothing of the polarisation is kept; where both are smooth all of it is followed.
    pub(super) fn polarization(&self, wo: Vec3, wi: Vec3, specular: bool) -> Event {
        let h = (wo + wi).try_normalize().unwrap_or(Vec3::Z);
        let s = s_axis(h, wo);
        let with = |facets: Ggx| facets.is_smooth() == specular;
        let faces = dielectric(wo.z, self.ior);
        let (Some(inner_o), Some(inner_i)) = (self.bent(wo), self.bent(wi)) else { return Event::DEPOLARIZES };
        if self.is_specular() {
            // R + T² m / (1 − m R) of each component.
            let metal = self.metal.in_plane(inner_o, Vec3::Z).0.scaled(self.metal.normal(inner_o.z));
            let below = faces[1].times(metal).times(faces[1]).again_and_again(metal.times(faces[0]));
            let all = self.metal.normal(inner_o.z) * self.through(wo, wi, inner_o) + SampledSpectrum::splat(self.reflected(wo));
            return Event::mixed(s, &faces[0].plus(below).scaled(SampledSpectrum::ONE / all), SampledSpectrum::ZERO);
        }
        let (mut sum, mut all) = (Event::NOTHING, SampledSpectrum::ZERO);
        if with(self.facets) {
            let (reflection, weight) = match specular {
                true => (faces[0], 1.0),
                false => (dielectric(wo.dot(h), self.ior)[0], self.facets.d(h) * self.facets.g2(wo, wi) / (4.0 * wo.z)),
            };
            let reflection = reflection.scaled(SampledSpectrum::splat(weight));
            all += reflection.mean();
            sum = Event::mixed(s, &reflection, SampledSpectrum::ZERO);
        }
        if with(self.metal.facets()) {
            let (value, jacobian) = match specular {
                true => (self.metal.normal(inner_o.z), 1.0),
                false => (self.metal.eval(inner_o, inner_i).0, wi.z / (self.ior * self.ior * inner_i.z)),
            };
            let weight = value * jacobian * self.through(wo, wi, inner_o);
            // Out of the coat, off a facet, into the coat: three planes of incidence.
            let inner_h = (inner_o + inner_i).try_normalize().unwrap_or(Vec3::Z);
            let (plane, rest) = self.metal.in_plane(inner_o, inner_h);
            let once = SampledSpectrum::ONE / self.again(wo, inner_o);
            let metal = Event::mixed(s_axis(inner_h, inner_o), &plane.scaled(once), rest * once);
            let face = |w: Vec3| Event::in_plane(s_axis(Vec3::Z, w), &self.interface.through(self.facets, w));
            let whole = face(wo).then(&metal, inner_o).then(&face(wi), -inner_i);
            all += weight;
            // What was held back was reflected within, where more of s is, and came out after all, where more of p does: taken for unpolarised.
            let held = Event::DEPOLARIZES.scaled(weight * (SampledSpectrum::ONE - once));
            sum = sum.plus(&whole.scaled(weight), s, wo, wi).plus(&held, s, wo, wi);
        }
        sum.over(all)
    }

    /// Whether all it does is to mirror.
    pub(super) fn is_specular(&self) -> bool {
        self.facets.is_smooth() && self.metal.facets().is_smooth()
    }

    /// Whether its lobes that are not specular are all as wide as `least_alpha`: judged as one.
    pub(super) fn is_wide(&self, least_alpha: f32) -> bool {
        [self.facets, self.metal.facets()].iter().all(|f| f.is_smooth() || f.is_wide(least_alpha))
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (SampledSpectrum, f32) {
        if wi.z <= 0.0 {
            return (SampledSpectrum::ZERO, 0.0);
        }
        let choice = self.choice(wo);
        let (mut f, mut pdf) = (SampledSpectrum::ZERO, 0.0);
        if !self.facets.is_smooth() {
            let h = (wo + wi).normalize();
            let d = self.facets.d(h) / (4.0 * wo.z);
            f += SampledSpectrum::splat(fresnel_dielectric(wo.dot(h), self.ior) * d * self.facets.g2(wo, wi));
            pdf += choice * d * self.facets.g1(wo);
        }
        if let (Some(inner_o), Some(inner_i)) = (self.bent(wo), self.bent(wi)) {
            let (value, density) = self.metal.eval(inner_o, inner_i);
            // Solid angles are smaller within: dω' / dω.
            let jacobian = wi.z / (self.ior * self.ior * inner_i.z);
            f += value * jacobian * self.through(wo, wi, inner_o);
            pdf += (1.0 - choice) * density * jacobian;
        }
        (f, pdf)
    }

    pub(super) fn sample(&self, wo: Vec3, u: [f32; 4]) -> Option<LocalScatter> {
        let choice = self.choice(wo);
        let wi = if u[2] < choice {
            if self.facets.is_smooth() {
                let weight = SampledSpectrum::splat(self.reflected(wo) / choice);
                return Some(LocalScatter {
                    wi: Vec3::new(-wo.x, -wo.y, wo.z),
                    weight,
                    pdf: choice,
                    specular: true,
                    disperses: false,
                });
            }
            reflect(wo, self.facets.sample_visible(wo, [u[0], u[1]]))
        } else {
            let inner_o = self.bent(wo)?;
            let s = self.metal.sample(inner_o, u)?;
            // Out of the coat, unless it is held back by total reflection.
            let wi = refract(s.wi, Vec3::Z, 1.0 / self.ior).map(|t| -t)?;
            if s.specular {
                let weight = s.weight * self.through(wo, wi, inner_o) / (1.0 - choice);
                return Some(LocalScatter { wi, weight, pdf: 1.0 - choice, specular: true, disperses: false });
            }
            wi
        };
        if wi.z <= 0.0 {
            return None;
        }
        let (f, pdf) = self.eval(wo, wi);
        (pdf > 0.0).then(|| LocalScatter { wi, weight: f / pdf, pdf, specular: false, disperses: false })
    }
}

impl Exact for CoatedConductor {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [
            ("metal", self.metal.write(sink)),
            ("ior", self.ior.write(sink)),
            ("roughness", self.roughness.write(sink)),
            ("across", self.across.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let ior: f32 = field(value, "ior", source)?;
        if !(ior > 1.0 && ior.is_finite()) {
            return Err(format!("a coat of index {ior}"));
        }
        let plain = CoatedConductor::new(field(value, "metal", source)?, ior, field(value, "roughness", source)?);
        Ok(CoatedConductor { across: field(value, "across", source)?, ..plain })
    }
}

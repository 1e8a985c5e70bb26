//! Where the paths of a group went on to from their receivers, and the light that they found there.

use super::reuse_extent::mean;
use crate::material::{Bsdf, Material, Orientation};
use crate::medium::phase;
use crate::shape::Surface;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Least GGX width of broad microfacets: what narrower ones reflect towards another receiver is not what the path was sampled for.
pub(super) const BROAD_ALPHA: f32 = 0.2;

/// Greatest asymmetry of media whose scattering events are donors: what more pointed phase functions send to another receiver is not what the path was sampled for. By Henyey and Greenstein's, 0.35 sends 9 times as much
/// forward as back.
pub(super) const BROAD_ASYMMETRY: f32 = 0.35;

/// Least cosine to the shading normal under which a scattering function of a diffuse surface is the same from all sides (`LocalFrame::new` tilts the normal below).
const UNTILTED: f32 = 0.01;

/// Albedo that surfaces are taken to have where it is decided to how many paths they lend.
const TYPICAL_ALBEDO: f32 = 0.4;

/// A place that a path of the group found behind its receiver.
pub(super) struct Donor<'a> {
    pub path: usize,
    pub point: Vec3,
    /// Where shadow rays end.
    pub end: Vec3,
    /// Geometric normal on the side of the receiver; 0 in a medium.
    pub ng: Vec3,
    pub scatterer: Scatterer<'a>,
    pub wavelengths: &'a SampledWavelengths,
    /// Light that was found there: of a lamp, where the path went on, of a lamp in a mirror, and scattered near a lamp.
    pub found: [Found; 4],
    /// What it sends to all sides alike besides.
    pub even: SampledSpectrum,
    /// What of it goes to its own receiver, and to the others, too: radiance.
    pub radiance: SampledSpectrum,
    /// Where it does more than to reflect diffusely: unit direction in which its path went on, and the radiance that arrives from surfaces there, not of what they emit. Depends on the direction
    /// towards the receiver by the scattering function alone, and is lent by the joint density of the donor and of that direction.
    pub further: Option<(Vec3, SampledSpectrum)>,
}

/// What scatters light at a donor.
pub(super) enum Scatterer<'a> {
    Surface {
        surface: Surface,
        material: &'a Material,
        /// Shading normal.
        ns: Vec3,
        hero_only: bool,
        /// Whether all it does is to reflect diffusely, and so towards its own receiver.
        is_diffuse: bool,
        /// Its scattering function, which is turned to each receiver, where that takes more than a diffuse albedo.
        bsdf: Option<Box<(Bsdf<'a>, Orientation)>>,
    },
    Medium {
        asymmetry: f32,
    },
}

/// Light that was found at a donor.
#[derive(Clone, Copy, Default)]
pub(super) struct Found {
    /// Unit direction from which it comes.
    pub wi: Vec3,
    /// Radiance over the density of the direction.
    pub light: SampledSpectrum,
    /// Whether narrow lobes are lent, too. Not where it could have been found in two ways, of which narrow lobes decide how much each counts; and what was drawn for one direction is noise in another.
    pub through_narrow: bool,
}

impl Found {
    /// f cos θ of what is lent.
    #[inline]
    pub fn response(&self, bsdf: &Bsdf) -> SampledSpectrum {
        match self.light == SampledSpectrum::ZERO {
            true => SampledSpectrum::ZERO,
            false if self.through_narrow => bsdf.eval(self.wi).0,
            false => bsdf.eval_broad(self.wi, BROAD_ALPHA),
        }
    }
}

/// What a donor sends towards a receiver.
#[derive(Clone, Copy)]
pub(super) struct Sent {
    /// Radiance that is lent by the density of the donor.
    pub radiance: SampledSpectrum,
    /// Radiance that is lent by the joint density, and the density of the further direction.
    pub further: (SampledSpectrum, f32),
}

impl<'a> Donor<'a> {
    /// Whether how much it sends depends on which side it is seen from.
    #[inline]
    pub fn is_glossy(&self) -> bool {
        match &self.scatterer {
            Scatterer::Surface { bsdf, .. } => bsdf.is_some(),
            Scatterer::Medium { asymmetry } => *asymmetry != 0.0,
        }
    }

    /// Mean radiance towards all sides, where that is the same.
    #[inline]
    pub fn brightness(&self) -> f32 {
        mean(self.radiance)
    }

    /// About the mean radiance that it sends on from its further direction, divided by the density of that.
    #[inline]
    pub fn further_brightness(&self) -> f32 {
        self.further.map_or(0.0, |(_, light)| TYPICAL_ALBEDO * mean(light))
    }

    /// Whether any light was found.
    pub fn is_lit(&self) -> bool {
        let is_lit = |light: SampledSpectrum| light != SampledSpectrum::ZERO;
        is_lit(self.even) || self.further.is_some_and(|(_, l)| is_lit(l)) || self.found.iter().any(|f| is_lit(f.light))
    }

    /// What it sends along `wo`; `is_own`: to the receiver of its own path.
    #[inline]
    pub fn sent(&mut self, wo: Vec3, is_own: bool) -> Sent {
        let is_alike = match &self.scatterer {
            Scatterer::Surface { ns, is_diffuse, .. } => *is_diffuse && is_untilted(*ns, wo),
            Scatterer::Medium { asymmetry } => *asymmetry == 0.0,
        };
        match self.further.is_none() && (is_own || is_alike) {
            true => Sent { radiance: self.radiance, further: (SampledSpectrum::ZERO, 0.0) },
            false => self.sent_towards(wo),
        }
    }

    #[inline(never)]
    fn sent_towards(&mut self, wo: Vec3) -> Sent {
        let (found, further, wavelengths) = (&self.found, self.further, self.wavelengths);
        let mut sent = match &mut self.scatterer {
            Scatterer::Surface { surface, material, hero_only, bsdf, .. } => match bsdf {
                Some(turned) => {
                    let (bsdf, orientation) = &mut **turned;
                    material.turn(bsdf, surface, *orientation, wo, wavelengths);
                    Sent::by(found, further, bsdf)
                }
                None => match material.bsdf(surface, wo, wavelengths, *hero_only, None) {
                    Some(bsdf) => Sent::by(found, further, &bsdf),
                    None => Sent { radiance: SampledSpectrum::ZERO, further: (SampledSpectrum::ZERO, 0.0) },
                },
            },
            Scatterer::Medium { asymmetry } => {
                let scattered = |found: &Found| found.light * phase(-wo.dot(found.wi), *asymmetry);
                Sent { radiance: found.iter().map(scattered).sum(), further: (SampledSpectrum::ZERO, 0.0) }
            }
        };
        sent.radiance += self.even;
        sent
    }
}

impl Sent {
    /// What a scattering function sends on of the light that was found there.
    fn by(found: &[Found; 4], further: Option<(Vec3, SampledSpectrum)>, bsdf: &Bsdf) -> Self {
        let further = further.map_or((SampledSpectrum::ZERO, 0.0), |(wi, light)| {
            let (f, density) = bsdf.eval(wi);
            (f * light, density)
        });
        Sent { radiance: found.iter().map(|found| found.response(bsdf) * found.light).sum(), further }
    }
}

/// Whether the scattering function of a diffuse surface of a shading normal is, seen along `wo`, what it is from other sides.
#[inline]
pub(super) fn is_untilted(ns: Vec3, wo: Vec3) -> bool {
    ns.dot(wo) >= UNTILTED
}

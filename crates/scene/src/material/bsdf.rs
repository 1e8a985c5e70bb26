//! The scattering function at one point: evaluated, drawn from, with its density.

use super::coated::CoatedLobes;
use super::conductor::ConductorLobe;
use super::diffuse;
use super::hair::HairLobes;
use super::local_scatter::{Breadth, LocalScatter};
use super::measured::MeasuredLobe;
use super::polarization::Event;
use super::principled::PrincipledLobes;
use crate::shape::Surface;
use diopter_light::{SampledSpectrum, sampling};
use glam::Vec3;

/// A direction light can have come from.
#[derive(Clone, Copy, Debug)]
pub struct Scatter {
    /// Unit direction away from the surface, towards where the light comes from.
    pub wi: Vec3,
    /// f cos θ / density, at the four wavelengths.
    pub weight: SampledSpectrum,
    /// Density in solid angle, 1/sr; meaningless for a mirror direction.
    pub pdf: f32,
    /// Whether only this very direction counts (mirror, clear glass).
    pub specular: bool,
    /// Whether the direction is on the other side of the surface.
    pub transmitted: bool,
    /// Whether only the hero wavelength takes this direction.
    pub disperses: bool,
    /// What radiance was divided by where light was bent, (n beyond / n before)²: it comes back where the path leaves the body.
    pub eta_scale: f32,
}

// The largest is also the most common: on the stack it costs less than a box would.
#[allow(clippy::large_enum_variant)]
#[derive(Clone)]
pub(super) enum Lobes<'a> {
    Diffuse { albedo: SampledSpectrum },
    Conductor(ConductorLobe),
    Coated(CoatedLobes<'a>),
    Principled(PrincipledLobes<'a>),
    DiffuseTransmission { reflectance: SampledSpectrum, transmittance: SampledSpectrum },
    Hair(HairLobes),
    Measured(MeasuredLobe<'a>),
}

/// What frames at a point have in common, whatever it is seen from.
#[derive(Clone, Copy)]
pub(crate) struct Orientation {
    /// Outer shading normal, unit.
    pub(super) ns: Vec3,
    /// The direction that is to be the local x, as far as it lies in the surface; any without.
    pub(super) along: Option<Vec3>,
}

/// The scattering function at a point seen from `wo`.
#[derive(Clone)]
pub struct Bsdf<'a> {
    // Written where it is returned: lobes are large, and moving them was 2 % of a sample's time.
    pub(super) lobes: Lobes<'a>,
    pub(super) frame: LocalFrame,
}

/// The axes in which lobes are computed.
#[derive(Clone, Copy)]
pub(super) struct LocalFrame {
    /// Local x, y, z in world space; z is the shading normal on the side of `wo`.
    axes: [Vec3; 3],
    /// Geometric normal on the side of `wo`.
    ng: Vec3,
    /// The direction it is seen from, in these axes.
    pub wo: Vec3,
}

impl LocalFrame {
    #[inline]
    pub fn new(surface: &Surface, Orientation { ns, along }: Orientation, wo: Vec3) -> Self {
        let side = if surface.ng.dot(wo) < 0.0 { -1.0 } else { 1.0 };
        let mut z = ns * side;
        // An interpolated normal can turn away from the viewer: tilt it back just enough to be seen.
        const LEAST_COSINE: f32 = 0.01;
        let cos = z.dot(wo);
        if cos < LEAST_COSINE {
            z = (z + wo * (LEAST_COSINE - cos)).normalize();
        }
        let along = along.and_then(|a| (a - z * z.dot(a)).try_normalize());
        let (x, y) = along.map_or_else(|| sampling::frame(z), |x| (x, z.cross(x)));
        LocalFrame { axes: [x, y, z], ng: surface.ng * side, wo: Vec3::new(x.dot(wo), y.dot(wo), z.dot(wo)) }
    }

    /// The axes of a fibre: x along it, z as near to the shading normal on the side of `wo` as that allows.
    pub fn along_fiber(surface: &Surface, ns: Vec3, wo: Vec3) -> Self {
        let side = if surface.ng.dot(wo) < 0.0 { -1.0 } else { 1.0 };
        let x = surface.tangent.try_normalize().unwrap_or_else(|| sampling::frame(ns).0);
        let z = ns * side;
        let z = (z - x * x.dot(z)).try_normalize().unwrap_or_else(|| sampling::frame(x).0);
        let y = z.cross(x);
        LocalFrame { axes: [x, y, z], ng: surface.ng * side, wo: Vec3::new(x.dot(wo), y.dot(wo), z.dot(wo)) }
    }
}

impl LocalFrame {
    /// Gets lobes ready to be seen in these axes.
    #[inline]
    pub fn look_at(&self, lobes: &mut PrincipledLobes, surface: &Surface) {
        let coat = lobes.coat_normal().map(|normal| {
            let n = normal.at(surface);
            self.local(if self.ng.dot(surface.ng) < 0.0 { -n } else { n })
        });
        lobes.look_from(self.wo, coat);
    }

    #[inline]
    fn local(&self, w: Vec3) -> Vec3 {
        Vec3::from_array(self.axes.map(|axis| axis.dot(w)))
    }

    /// Density of a direction by the cosine of the hemisphere, 1/sr; 0 where the true surface and the shaded one put it on different sides.
    #[inline]
    pub fn cosine_density(&self, wi: Vec3) -> f32 {
        let z = self.axes[2].dot(wi);
        if (self.ng.dot(wi) > 0.0) == (z > 0.0) { z.max(0.0) * std::f32::consts::FRAC_1_PI } else { 0.0 }
    }
}

impl Bsdf<'_> {
    /// The geometric normal on the side light is seen from.
    pub fn side_normal(&self) -> Vec3 {
        self.frame.ng
    }

    /// The shading normal on the side light is seen from.
    pub(crate) fn shading_normal(&self) -> Vec3 {
        self.frame.axes[2]
    }

    /// The normal that the choice among lights goes by: 0 of fibres, which pass light on to all sides.
    pub fn light_normal(&self) -> Vec3 {
        if self.is_fiber() { Vec3::ZERO } else { self.frame.ng }
    }

    /// Whether it is that of a fibre as a whole: light comes in and goes out at any side of it.
    pub fn is_fiber(&self) -> bool {
        matches!(self.lobes, Lobes::Hair(_))
    }

    /// Albedo where all it does is to reflect diffusely.
    #[inline]
    pub(crate) fn diffuse_albedo(&self) -> Option<SampledSpectrum> {
        match &self.lobes {
            Lobes::Diffuse { albedo } => Some(*albedo),
            _ => None,
        }
    }

    /// Whether light samples could not come this way: mirrors and clear glass.
    pub fn is_specular(&self) -> bool {
        match &self.lobes {
            Lobes::Diffuse { .. } | Lobes::DiffuseTransmission { .. } | Lobes::Hair(_) | Lobes::Measured(_) => false,
            Lobes::Conductor(lobe) => lobe.facets().is_smooth(),
            Lobes::Coated(lobes) => lobes.is_specular(),
            Lobes::Principled(lobes) => lobes.is_specular(),
        }
    }

    /// Fraction of light that goes through without being bent or blurred, at the four wavelengths: of smooth thin dielectrics; `None` of all else.
    pub fn straight_through(&self) -> Option<SampledSpectrum> {
        match &self.lobes {
            Lobes::Principled(lobes) => lobes.straight_through(self.frame.wo),
            _ => None,
        }
    }

    /// What radiance is divided by on the way through.
    fn eta_scale(&self, transmitted: bool) -> f32 {
        match &self.lobes {
            Lobes::Principled(lobes) if transmitted => lobes.eta_scale(),
            _ => 1.0,
        }
    }

    fn local(&self, w: Vec3) -> Vec3 {
        self.frame.local(w)
    }

    /// f cos θ (1/sr) at the four wavelengths for the unit direction `wi` away from the surface, and the density (1/sr) [`Bsdf::sample`] has for it; 0 for mirrors.
    #[inline]
    pub fn eval(&self, wi: Vec3) -> (SampledSpectrum, f32) {
        let local = self.local(wi);
        // A direction that the true surface and the shaded one put on different sides carries no light; fibres have no sides.
        if !self.is_fiber() && (self.frame.ng.dot(wi) > 0.0) != (local.z > 0.0) {
            return (SampledSpectrum::ZERO, 0.0);
        }
        match &self.lobes {
            Lobes::Diffuse { albedo } => diffuse::eval(*albedo, local),
            Lobes::Conductor(lobe) => lobe.eval(self.frame.wo, local),
            Lobes::Coated(lobes) => lobes.eval(self.frame.wo, local),
            Lobes::Principled(lobes) => lobes.eval(self.frame.wo, local),
            Lobes::DiffuseTransmission { reflectance, transmittance } => diffuse::eval_both(*reflectance, *transmittance, local),
            Lobes::Hair(lobes) => lobes.eval(local),
            Lobes::Measured(lobe) => lobe.eval(local),
        }
    }

    /// Which lobes it has beside specular ones; microfacet lobes narrower than a GGX width count as narrow.
    pub(crate) fn breadth(&self, least_alpha: f32) -> Breadth {
        let one = |broad: bool, smooth: bool| Breadth { broad: broad && !smooth, narrow: !broad && !smooth };
        match &self.lobes {
            Lobes::Diffuse { .. } | Lobes::DiffuseTransmission { .. } | Lobes::Hair(_) => Breadth { broad: true, narrow: false },
            Lobes::Conductor(lobe) => one(lobe.facets().is_wide(least_alpha), lobe.facets().is_smooth()),
            Lobes::Measured(lobe) => one(lobe.is_wide(least_alpha), false),
            Lobes::Coated(lobes) => one(lobes.is_wide(least_alpha), lobes.is_specular()),
            Lobes::Principled(lobes) => lobes.breadth(least_alpha),
        }
    }

    /// Whether nothing goes through.
    pub(crate) fn only_reflects(&self) -> bool {
        match &self.lobes {
            Lobes::Diffuse { .. } | Lobes::Conductor(_) | Lobes::Coated(_) | Lobes::Measured(_) => true,
            Lobes::Principled(lobes) => !lobes.transmits(),
            Lobes::DiffuseTransmission { .. } | Lobes::Hair(_) => false,
        }
    }

    /// f cos θ of the broad lobes alone ([`Bsdf::breadth`]).
    pub(crate) fn eval_broad(&self, wi: Vec3, least_alpha: f32) -> SampledSpectrum {
        match &self.lobes {
            Lobes::Principled(lobes) => {
                let local = self.local(wi);
                match (self.frame.ng.dot(wi) > 0.0) == (local.z > 0.0) {
                    true => lobes.eval_lobes(self.frame.wo, local, least_alpha).0,
                    false => SampledSpectrum::ZERO,
                }
            }
            _ if self.breadth(least_alpha).broad => self.eval(wi).0,
            _ => SampledSpectrum::ZERO,
        }
    }

    /// What the power of a path from a lamp is multiplied by where it came from the direction of view and goes on along `wi`, beside the factor
    /// that radiance the other way gets: |ns·wo| |ng·wi| / (|ng·wo| |ns·wi|), 1 where shading and geometric normals agree.
    /// Source: Veach 1997, eq. 5.19.
    pub(crate) fn shading_correction(&self, wi: Vec3) -> f32 {
        const LEAST: f32 = 1e-4;
        let LocalFrame { axes: [x, y, z], ng, wo: local } = self.frame;
        let wo = x * local.x + y * local.y + z * local.z;
        let (shading, geometric) = (local.z.abs() / z.dot(wi).abs().max(LEAST), ng.dot(wi).abs() / ng.dot(wo).abs().max(LEAST));
        shading * geometric
    }

    /// The event in which light from `wi` is scattered towards the viewer as a Mueller matrix at each wavelength, over [`Bsdf::eval`] or, of specular
    /// lobes, over the weight of what was drawn.
    pub fn polarization(&self, wi: Vec3, specular: bool) -> Event {
        let (wo, local) = (self.frame.wo, self.local(wi));
        let event = match &self.lobes {
            Lobes::Diffuse { .. } | Lobes::DiffuseTransmission { .. } | Lobes::Hair(_) | Lobes::Measured(_) => {
                return Event::DEPOLARIZES;
            }
            Lobes::Conductor(lobe) => lobe.polarization(wo, local),
            Lobes::Coated(lobes) => lobes.polarization(wo, local, specular),
            Lobes::Principled(lobes) => lobes.polarization(wo, local, specular),
        };
        event.placed(self.frame.axes)
    }

    /// Draws a direction by numbers in [0, 1); `u` = direction (2), choice of lobe, unused. `None` when light is absorbed.
    #[inline]
    pub fn sample(&self, u: [f32; 4]) -> Option<Scatter> {
        let s = match &self.lobes {
            Lobes::Diffuse { albedo } => Some(diffuse::sample(*albedo, u)),
            Lobes::Conductor(lobe) => lobe.sample(self.frame.wo, u),
            Lobes::Coated(lobes) => lobes.sample(self.frame.wo, u),
            Lobes::Principled(lobes) => lobes.sample(self.frame.wo, u),
            Lobes::DiffuseTransmission { reflectance, transmittance } => diffuse::sample_both(*reflectance, *transmittance, u),
            Lobes::Hair(lobes) => lobes.sample(u),
            Lobes::Measured(lobe) => lobe.sample(u),
        }?;
        self.placed(s)
    }

    /// Whether light that goes through is bent by wavelength, so that the hero alone is left.
    pub(crate) fn disperses(&self) -> bool {
        matches!(&self.lobes, Lobes::Principled(lobes) if lobes.disperses())
    }

    /// Specular lobes among which, and others, [`Bsdf::sample`] chooses, each with the probability of its choice as its density: of smooth dielectrics, alone or over a base.
    pub(crate) fn specular_lobes(&self) -> [Option<Scatter>; 2] {
        match &self.lobes {
            Lobes::Principled(lobes) => lobes.specular(self.frame.wo).map(|lobe| self.placed(lobe?)),
            _ => [None; 2],
        }
    }

    /// In world space; `None` where it would be on the other side of the true surface, or brings nothing.
    #[inline]
    fn placed(&self, s: LocalScatter) -> Option<Scatter> {
        let [x, y, z] = self.frame.axes;
        let wi = x * s.wi.x + y * s.wi.y + z * s.wi.z;
        let transmitted = if self.is_fiber() { self.frame.ng.dot(wi) < 0.0 } else { s.wi.z < 0.0 };
        if (self.frame.ng.dot(wi) < 0.0) != transmitted || !(s.weight.max_element() > 0.0) {
            return None;
        }
        let eta_scale = self.eta_scale(transmitted);
        Some(Scatter { wi, weight: s.weight, pdf: s.pdf, specular: s.specular, transmitted, disperses: s.disperses, eta_scale })
    }
}

//! What the model does to the polarisation of light.
//!
//! Facets reflect and refract by Fresnel's amplitudes. Light that comes out of the diffuse base was unpolarised there and is polarised by its way through the interface,
//! in the plane of the macroscopic normal, as are its parts that went in (Baek et al. 2018, "Simultaneous Acquisition of Polarimetric SVBRDF and
//! Normals", ACM TOG 37(6)). What energy compensation gives back and what the sheen scatters is unpolarised. The model knows a metal by its colour alone: as for
//! its polarisation, it is of n = 1 and of the k that gives that reflectance at normal incidence (aluminium: n 1.0, k 6.6 at 550 nm), while its reflectance
//! stays Schlick's. The coat polarises what goes through it both ways.

use super::{COAT_IOR, PrincipledLobes};
use crate::material::energy::PolarizedAs;
use crate::material::microfacet::fresnel_schlick;
use crate::material::polarization::{Complex, Event, InPlane, conductor, dielectric, s_axis, thin_dielectric_faces};
use diopter_light::SampledSpectrum;
use glam::Vec3;

/// Reflectance at normal incidence of a metal above which k counts as that of this one: k = 200.
const BRIGHTEST: f32 = 0.9999;

/// Light that goes through unchanged.
const ALL: InPlane = InPlane { s: SampledSpectrum::ONE, p: SampledSpectrum::ONE, z: Complex::ONE };

impl PrincipledLobes<'_> {
    /// What the dielectric reflects and transmits of each component at a cosine, with its tint and film: the mean of the first is
    /// [`PrincipledLobes::dielectric`] but for thin dielectrics, of which it is the mean of what both faces do to each component.
    fn dielectric_in_plane(&self, cos: f32) -> [InPlane; 2] {
        let faces = |one: [InPlane; 2]| if self.thin_dielectric { thin_dielectric_faces(one) } else { one };
        let bare = faces(dielectric(cos, self.eta));
        let bare = match &self.tint {
            None => bare,
            Some(tint) => {
                let r = bare[0].mean();
                let factor = tint.of(r.x) / r.max(SampledSpectrum::splat(1e-12));
                let r = bare[0].scaled(factor);
                let [s, p] = [r.s, r.p].map(|r| (SampledSpectrum::ONE - r).max(SampledSpectrum::ZERO));
                let z = SampledSpectrum::from_array((s * p).to_array().map(f32::sqrt));
                [r, InPlane { s, p, z: Complex::real(z) }]
            }
        };
        let Some(film) = &self.film else { return bare };
        let outer = 1.0 - (1.0 - cos * cos) * film.outer_sin * film.outer_sin;
        if outer <= 0.0 {
            return bare;
        }
        let covered = faces(film.layer.in_plane(outer.sqrt(), film.below));
        let fraction = SampledSpectrum::splat(film.layer.fraction);
        [0, 1].map(|i: usize| bare[i].scaled(SampledSpectrum::ONE - fraction).plus(covered[i].scaled(fraction)))
    }

    /// What the metal reflects of each component; its mean is [`PrincipledLobes::metal`].
    fn metal_in_plane(&self, cos: f32) -> InPlane {
        let f0 = self.base.clamp(SampledSpectrum::ZERO, SampledSpectrum::splat(BRIGHTEST));
        // R = k² / (4 + k²) of n = 1.
        let k = SampledSpectrum::from_array((f0 / (SampledSpectrum::ONE - f0)).to_array().map(|x| 2.0 * x.sqrt()));
        let bare = conductor(cos, SampledSpectrum::ONE, k).normalized();
        let schlick = fresnel_schlick(cos, self.base);
        match &self.film {
            None => bare.scaled(schlick),
            Some(film) => {
                let fraction = SampledSpectrum::splat(film.layer.fraction);
                let covered = film.layer.in_plane(cos, film.metal)[0];
                bare.scaled(schlick * (SampledSpectrum::ONE - fraction)).plus(covered.scaled(fraction))
            }
        }
    }

    /// What facets reflect of each component, and what bounces between them: with no change of polarisation, [`PrincipledLobes::facet_reflectance`].
    fn facets_in_plane(&self, cos: f32) -> (InPlane, SampledSpectrum) {
        let view = &self.seen;
        let solid = if self.solid { self.transmission } else { 0.0 };
        let (metal, glass) = (self.metallic * view.below_coat, (1.0 - self.metallic) * view.below_coat);
        let plane = self
            .metal_in_plane(cos)
            .scaled(SampledSpectrum::splat(metal))
            .plus(self.dielectric_in_plane(cos)[0].scaled(SampledSpectrum::splat(glass)));
        let rest = self.metal(cos) * (view.metal_gain - SampledSpectrum::ONE) * metal
            + self.dielectric(cos) * (solid * (view.glass_gain - 1.0).max(0.0) * glass);
        (plane, rest)
    }

    /// The way of light through the coat, where there is one.
    fn through_coat(&self, w: Vec3) -> Event {
        let coat = SampledSpectrum::splat(self.coat);
        let through = self.coat_interface.through(self.coat_facets(), w);
        Event::in_plane(s_axis(Vec3::Z, w), &ALL.scaled(SampledSpectrum::ONE - coat).plus(through.scaled(coat)))
    }

    /// The way of light through the interface: from or to the diffuse base, or through a sheet.
    fn through_interface(&self, w: Vec3) -> Event {
        let PolarizedAs { cos, fraction } = self.interface().polarized_as(self.facets, w);
        let through = self.dielectric_in_plane(cos)[1].normalized().fraction_of_difference(fraction);
        Event::in_plane(s_axis(Vec3::Z, w), &through)
    }

    /// The event as a Mueller matrix, in the local frame: of the lobes that are specular, or of the others.
    pub(in crate::material) fn polarization(&self, wo: Vec3, wi: Vec3, specular: bool) -> Event {
        let below = match (wi.z > 0.0, specular) {
            (true, true) => {
                let (plane, rest) = self.facets_in_plane(wo.z);
                Event::mixed(s_axis(Vec3::Z, wo), &plane, rest).over(self.facet_reflectance(&self.seen, wo.z))
            }
            (true, false) => return self.reflection(wo, wi),
            (false, _) => self.transmission(wo, wi, specular),
        };
        match self.coat > 0.0 {
            false => below,
            true if wi.z > 0.0 => self.through_coat(wo).then(&below, wo).then(&self.through_coat(wi), -wi),
            true => self.through_coat(wo).then(&below, wo),
        }
    }

    /// All lobes above the surface that are not specular.
    fn reflection(&self, wo: Vec3, wi: Vec3) -> Event {
        let view = &self.seen;
        let h = (wo + wi).try_normalize().unwrap_or(Vec3::Z);
        let (s, cos) = (s_axis(h, wo), wo.dot(h));
        let mut under_sheen = Event::NOTHING;
        if !self.smooth() {
            let d = SampledSpectrum::splat(self.facets.d(h) / (4.0 * wo.z) * self.facets.g2(wo, wi));
            let (plane, rest) = self.facets_in_plane(cos);
            under_sheen = Event::mixed(s, &plane.scaled(d), rest * d);
        }
        if view.choice[1] > 0.0 {
            let ways = self.through_interface(wo).then(&Event::DEPOLARIZES, wo).then(&self.through_interface(wi), -wi);
            under_sheen = under_sheen.plus(&ways.scaled(self.diffuse(wi)), s, wo, wi);
        }
        let mut below = under_sheen;
        if let Some(sheen) = &self.sheen {
            let sent = Event::mixed(s, &InPlane::NOTHING, sheen.eval(wo, wi) * view.below_coat);
            below = under_sheen.scaled(SampledSpectrum::splat(sheen.through(wo, wi))).plus(&sent, s, wo, wi);
        }
        below = Event { outgoing: s, incoming: s, ..below };
        let all = self.eval(wo, wi).0;
        if self.coat <= 0.0 {
            return below.over(all);
        }
        let below = self.through_coat(wo).then(&below, wo).then(&self.through_coat(wi), -wi);
        let facets = self.coat_facets();
        let d = self.coat * facets.d(h) / (4.0 * wo.z) * facets.g2(wo, wi);
        let coat = Event::in_plane(s, &dielectric(cos, COAT_IOR)[0].scaled(SampledSpectrum::splat(d)));
        coat.plus(&below, s, wo, wi).over(all)
    }

    /// Light that goes through.
    fn transmission(&self, wo: Vec3, wi: Vec3, specular: bool) -> Event {
        let macroscopic = |reflected: SampledSpectrum| {
            let through = self.dielectric_in_plane(wo.z)[1];
            Event::in_plane(s_axis(Vec3::Z, wo), &through).over(SampledSpectrum::ONE - reflected)
        };
        if specular {
            return macroscopic(self.dielectric(wo.z));
        }
        if !self.solid {
            // The lobe is that of the mirror, folded: what comes out is as polarised as what comes from a base.
            return Event { incoming: s_axis(Vec3::Z, wi), ..self.through_interface(wo) };
        }
        let Some(h) = (wi * self.bend + wo).try_normalize() else { return Event::DEPOLARIZES };
        let h = if h.z < 0.0 { -h } else { h };
        let cos = wo.dot(h);
        let once = SampledSpectrum::splat(1.0 / self.seen.glass_gain.max(1.0));
        let through = self.dielectric_in_plane(cos)[1];
        let all = SampledSpectrum::ONE - self.dielectric(cos);
        Event::mixed(s_axis(h, wo), &through.scaled(once), all * (SampledSpectrum::ONE - once)).over(all)
    }
}

//! What surfaces are made of: descriptions ([`Material`]) that become scattering functions ([`Bsdf`]) at a point.
//!
//! One file a family: [`diffuse`], [`conductor`] (measured n and k), [`coated`] (metal under a clear coat), [`principled`] (glTF's metallic-roughness with
//! transmission, volume and clear coat; also clear glass), [`hair`] (fibres), [`measured`] (tables of measurements). Shared physics: [`microfacet`], [`energy`], [`film`], [`sheen`], [`anisotropy`], [`polarization`].

pub mod anisotropy;
pub mod bsdf;
pub mod bump;
pub mod coat;
pub mod coated;
pub mod conductor;
pub mod diffuse;
pub mod energy;
pub mod film;
pub mod hair;
pub(crate) mod inputs;
pub(crate) mod local_scatter;
pub mod measured;
pub mod microfacet;
pub(crate) mod pictures;
pub mod polarization;
pub mod principled;
pub mod sheen;

pub use anisotropy::Anisotropy;
pub(crate) use bsdf::Orientation;
pub use bsdf::{Bsdf, Scatter};
pub use bump::{Bump, BumpUnit};
pub use coat::CoatNormal;
pub use coated::CoatedConductor;
pub use conductor::Conductor;
pub use film::Film;
pub use hair::{Hair, Pigment};
pub use measured::Measured;
pub use principled::{Principled, Transmission};
pub use sheen::Sheen;

use crate::light::modulation::Modulation;
use crate::medium::Medium;
use crate::shape::Surface;
use crate::texture::{Color, Lookup, Scalar, Texture};
use bsdf::{Lobes, LocalFrame};
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum};
use glam::{Vec2, Vec3, Vec4};
use inputs::{inputs_enum, inputs_struct};
use std::sync::Arc;

/// A surface's appearance.
#[derive(Clone, Debug)]
pub struct Material {
    /// For messages.
    pub name: String,
    /// How it scatters.
    pub scattering: Scattering,
    /// Light it sends out by itself.
    pub emission: Option<Emission>,
    /// Bumps: an image of tangent-space normals and its strength.
    pub normal_map: Option<(Texture, f32)>,
    /// Bumps by their height; they count instead of a normal map.
    pub bump: Option<Box<Bump>>,
    /// Holes.
    pub coverage: Coverage,
    /// What begins where light goes in.
    pub interior: Interior,
}

inputs_struct!(Material { scattering, emission, normal_map, bump, coverage } without { name, interior });

/// What is behind a surface that light goes through.
#[derive(Clone, Debug, Default)]
pub enum Interior {
    /// What is before it: a thin dielectric, or nothing that light would notice.
    #[default]
    Same,
    /// A body that takes the place of what is around it.
    Body {
        /// What fills it, if that absorbs or scatters.
        medium: Option<Arc<Medium>>,
        /// Where bodies that have one overlap, the one with the highest counts.
        priority: Option<i32>,
    },
    /// Media inside and outside, as a file says; `None` is a vacuum.
    Sides([Option<Arc<Medium>>; 2]),
}

impl Interior {
    /// The media that it knows of.
    pub(crate) fn media(&self) -> impl Iterator<Item = &Medium> {
        let media: &[Option<Arc<Medium>>] = match self {
            Interior::Same => &[],
            Interior::Body { medium, .. } => std::slice::from_ref(medium),
            Interior::Sides(sides) => sides,
        };
        media.iter().flatten().map(Arc::as_ref)
    }
}

/// The families of scattering.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Scattering {
    /// Absorbs everything.
    Black,
    /// Nothing that light would meet: the face of a medium.
    Interface,
    /// Lambertian reflection, both sides.
    Diffuse(Color),
    /// A metal by its optical constants.
    Conductor(Conductor),
    /// A metal under a clear coat.
    Coated(Box<CoatedConductor>),
    /// glTF's material model.
    Principled(Box<Principled>),
    /// Lambertian reflection and transmission: paper, leaves.
    DiffuseTransmission(Box<[Color; 2]>),
    /// A fibre of hair or fur.
    Hair(Box<Hair>),
    /// A table of what was measured.
    Measured(Arc<Measured>),
    /// Either of two, the second with a probability that may differ from place to place.
    Mix(Box<([Scattering; 2], Scalar)>),
}

inputs_enum!(Scattering {
    Black,
    Interface,
    Diffuse(color),
    Conductor(conductor),
    Coated(coated),
    Principled(principled),
    DiffuseTransmission(colors),
    Hair(hair),
    Measured(measured),
    Mix(mix),
});

/// Deepest that mixtures are taken apart.
pub const DEEPEST_MIX: u32 = 16;

impl Scattering {
    /// Whether it differs with the direction of the texture coordinates.
    pub(crate) fn is_anisotropic(&self) -> bool {
        match self {
            Scattering::Conductor(conductor) => conductor.across.is_some(),
            Scattering::Coated(coated) => coated.across.is_some(),
            Scattering::Principled(principled) => principled.anisotropy.is_some(),
            Scattering::Mix(mix) => mix.0.iter().any(Scattering::is_anisotropic),
            _ => false,
        }
    }

    /// Parts of a mixture, those of its mixtures counted one by one, and how deep they lie.
    pub fn parts(&self) -> (usize, u32) {
        match self {
            Scattering::Mix(mix) => {
                let [a, b] = [0, 1].map(|i: usize| mix.0[i].parts());
                (a.0 + b.0, a.1.max(b.1) + 1)
            }
            _ => (1, 0),
        }
    }

    /// Computes every table that rays will ask for; `around`: indices of the bodies that it may lie in or touch.
    fn prepare(&mut self, around: &[f32]) {
        match self {
            Scattering::Black
            | Scattering::Interface
            | Scattering::Diffuse(_)
            | Scattering::DiffuseTransmission(_)
            | Scattering::Hair(_)
            | Scattering::Measured(_) => {}
            Scattering::Conductor(conductor) => conductor.prepare(),
            Scattering::Coated(coated) => coated.prepare(),
            Scattering::Principled(principled) => principled.prepare(around),
            Scattering::Mix(mix) => mix.0.iter_mut().for_each(|part| part.prepare(around)),
        }
    }

    /// The part of a mixture that a ray meets at a point: a different one for each point and direction, the same whenever asked again.
    fn chosen(&self, surface: &Surface, wo: Vec3) -> &Scattering {
        let mut at = self;
        for level in 0..DEEPEST_MIX {
            let Scattering::Mix(mix) = at else { break };
            let (parts, amount) = &**mix;
            let bits = [surface.point, wo].map(|v| v.to_array().map(f32::to_bits));
            let hash = bits.iter().flatten().fold(level, |h, b| diopter_light::random::mix(h ^ b));
            at = &parts[usize::from(diopter_light::random::to_unit(hash) < amount.at(surface))];
        }
        at
    }

    /// The direction in which facets are wider or narrower than across it, if they are; `ns` is the outer shading normal.
    fn anisotropy(&self, surface: &Surface, ns: Vec3) -> Option<Vec3> {
        match self {
            Scattering::Principled(p) => p.anisotropy.as_ref()?.direction(surface, ns),
            Scattering::Conductor(c) if c.across.is_some() => anisotropy::tangent(surface, ns),
            Scattering::Coated(c) if c.across.is_some() || c.metal.across.is_some() => anisotropy::tangent(surface, ns),
            Scattering::Measured(m) if !m.is_isotropic() => anisotropy::tangent(surface, ns),
            _ => None,
        }
    }

    fn albedo(&self, surface: &Surface) -> Vec3 {
        match self {
            Scattering::Black | Scattering::Interface => Vec3::ZERO,
            Scattering::Diffuse(color) => color.linear_srgb(surface),
            Scattering::Conductor(conductor) => conductor.normal_reflectance(),
            Scattering::Coated(coated) => coated.normal_reflectance(),
            Scattering::Principled(principled) => principled.base_color.linear_srgb(surface),
            Scattering::DiffuseTransmission(colors) => colors[0].linear_srgb(surface) + colors[1].linear_srgb(surface),
            Scattering::Hair(hair) => hair.albedo(surface),
            Scattering::Measured(measured) => measured.normal_reflectance().clamp(Vec3::ZERO, Vec3::ONE),
            Scattering::Mix(mix) => {
                let ([a, b], amount) = &**mix;
                a.albedo(surface).lerp(b.albedo(surface), amount.at(surface).clamp(0.0, 1.0))
            }
        }
    }
}

/// Computes the tables of all materials of a scene before the first ray: rays are traced by the workers of a pool, and one that computed a
/// table there would wait for the pool.
pub(crate) fn prepare(materials: &mut [Material]) {
    let nested = |m: &Material| matches!(m.interior, Interior::Body { priority: Some(_), .. });
    let mut indices: Vec<f32> = Vec::new();
    for material in materials.iter().filter(|m| nested(m)) {
        if let Scattering::Principled(p) = &material.scattering
            && !indices.contains(&p.ior)
        {
            indices.push(p.ior);
        }
    }
    for material in materials {
        let around: &[f32] = if nested(material) { &indices } else { &[] };
        material.scattering.prepare(around);
    }
}

/// Light sent out by a surface, the same in all directions.
#[derive(Clone, Debug)]
pub struct Emission {
    /// How much and of which colour.
    pub radiance: EmissionColor,
    /// Whether the back shines too.
    pub two_sided: bool,
    /// Whether lamps of this kind are worth aiming at: an unlit surface only shows its colour.
    pub is_light: bool,
    /// How it changes with time.
    pub modulation: Modulation,
}

inputs_struct!(Emission { radiance } without { two_sided, is_light, modulation });

/// Spectral radiance of an emitter.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum EmissionColor {
    /// W·m⁻²·sr⁻¹·nm⁻¹.
    Constant(Spectrum),
    /// Linear sRGB in cd/m²: an image times a factor.
    Textured {
        /// Multiplies the image, cd/m².
        factor: Vec3,
        /// The image.
        texture: Texture,
    },
    /// The colour of the surface itself ([`Surface::color`]): Gaussian splats. Lamps of this kind are met by chance, never sampled.
    Captured {
        /// Luminance of display white, cd/m².
        factor: f32,
    },
}

inputs_enum!(EmissionColor { Constant(spectrum), Textured { factor, texture }, Captured { factor } });

impl Emission {
    /// A lamp of a spectrum (W·m⁻²·sr⁻¹·nm⁻¹), front side only.
    pub fn one_sided(radiance: Spectrum) -> Self {
        Emission { radiance: EmissionColor::Constant(radiance), two_sided: false, is_light: true, modulation: Modulation::Steady }
    }

    /// Radiance at a point, W·m⁻²·sr⁻¹·nm⁻¹. The colours of a mesh's vertices multiply what is only to be looked at, not that of lamps (glTF, KHR_materials_unlit).
    #[inline]
    pub fn at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        if !self.is_light && surface.color != Vec4::ONE && !matches!(self.radiance, EmissionColor::Captured { .. }) {
            let rgb = surface.color.truncate().clamp(Vec3::ZERO, Vec3::ONE);
            let tint = match wavelengths.is_rgb() {
                true => SampledWavelengths::lanes(rgb),
                false => Sigmoid::from_rgb(rgb).sample(wavelengths),
            };
            return self.plain_at(surface, wavelengths) * tint;
        }
        self.plain_at(surface, wavelengths)
    }

    #[inline]
    fn plain_at(&self, surface: &Surface, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match &self.radiance {
            EmissionColor::Captured { factor } => {
                Spectrum::light_from_rgb(surface.color.truncate() * *factor).sample(wavelengths)
            }
            EmissionColor::Textured { factor, texture } => {
                let rgb = texture.filtered(&surface.uv, surface.footprint()).truncate();
                Spectrum::light_from_rgb(*factor * rgb).sample(wavelengths)
            }
            EmissionColor::Constant(_) => self.sample(&surface.uv, wavelengths),
        }
    }

    /// Radiance at texture coordinates, W·m⁻²·sr⁻¹·nm⁻¹; where the surface has a colour of its own, of white ([`Emission::at`] knows it).
    #[inline]
    pub fn sample(&self, uv: &[Vec2; 2], wavelengths: &SampledWavelengths) -> SampledSpectrum {
        match &self.radiance {
            EmissionColor::Constant(spectrum) => spectrum.sample_light(wavelengths),
            EmissionColor::Textured { factor, texture } => {
                Spectrum::light_from_rgb(*factor * texture.at(uv).truncate()).sample(wavelengths)
            }
            EmissionColor::Captured { factor } => Spectrum::light_from_rgb(Vec3::splat(*factor)).sample(wavelengths),
        }
    }

    /// Luminance at texture coordinates, cd/m².
    pub fn luminance(&self, uv: &[Vec2; 2]) -> f32 {
        match &self.radiance {
            EmissionColor::Constant(spectrum) => diopter_light::color::luminance(|nm| spectrum.at(nm)) as f32,
            EmissionColor::Textured { factor, texture } => {
                (*factor * texture.at(uv).truncate()).dot(diopter_light::color::SRGB_LUMINANCE)
            }
            EmissionColor::Captured { factor } => *factor,
        }
    }
}

/// Where a surface is there at all: by its texture coordinates, not by its place in space.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Coverage {
    /// Everywhere.
    Full,
    /// Where the number reaches the cut-off.
    Mask {
        /// Coverage.
        alpha: Scalar,
        /// Least coverage that counts.
        cutoff: f32,
    },
    /// With this probability.
    Blend(Scalar),
}

inputs_enum!(Coverage { Full, Mask { alpha, cutoff }, Blend(alpha) });

impl Coverage {
    /// Fraction of rays, 0 to 1, that meet the surface at these texture coordinates: the mean of [`Coverage::accepts`]; `vertex_alpha` (0 to 1) multiplies.
    pub fn fraction(&self, uv: &[Vec2; 2], vertex_alpha: f32) -> f32 {
        match self {
            Coverage::Full => 1.0,
            Coverage::Mask { alpha, cutoff } => (alpha.lookup(&Lookup::uv(uv)) * vertex_alpha >= *cutoff) as u32 as f32,
            Coverage::Blend(alpha) => (alpha.lookup(&Lookup::uv(uv)) * vertex_alpha).clamp(0.0, 1.0),
        }
    }

    /// Whether a ray that drew the number `u` in [0, 1) meets the surface at these texture coordinates; `vertex_alpha` (0 to 1) multiplies.
    pub fn accepts(&self, uv: &[Vec2; 2], vertex_alpha: f32, u: f32) -> bool {
        match self {
            Coverage::Full => true,
            Coverage::Mask { alpha, cutoff } => alpha.lookup(&Lookup::uv(uv)) * vertex_alpha >= *cutoff,
            Coverage::Blend(alpha) => u < alpha.lookup(&Lookup::uv(uv)) * vertex_alpha,
        }
    }
}

impl Material {
    /// A plain material without emission, bumps or holes.
    pub fn new(name: &str, scattering: Scattering) -> Self {
        let (coverage, interior) = (Coverage::Full, Interior::Same);
        Material { name: name.into(), scattering, emission: None, normal_map: None, bump: None, coverage, interior }
    }

    /// A body of clear, smooth glass of an index, filled with what absorbs or scatters.
    pub fn glass(name: &str, ior: f32, medium: Option<Medium>) -> Self {
        let interior = Interior::Body { medium: medium.map(Arc::new), priority: None };
        Material { interior, ..Material::new(name, Scattering::Principled(Box::new(Principled::glass(ior)))) }
    }

    /// What a captured place is made of: it shows the light that it was captured in, absorbs what falls on it, and is white at a luminance (cd/m²).
    pub fn captured(name: &str, white: f32) -> Self {
        let emission = Emission {
            radiance: EmissionColor::Captured { factor: white },
            two_sided: true,
            is_light: false,
            modulation: Modulation::Steady,
        };
        Material { emission: Some(emission), ..Material::new(name, Scattering::Black) }
    }

    /// A black lamp of a radiance (W·m⁻²·sr⁻¹·nm⁻¹), front side only.
    pub fn lamp(name: &str, radiance: Spectrum) -> Self {
        Material { emission: Some(Emission::one_sided(radiance)), ..Material::new(name, Scattering::Black) }
    }

    /// Shading normal at a point, with bumps or the normal map applied; on the same side as `surface.ns`.
    pub(crate) fn shading_normal(&self, surface: &Surface) -> Vec3 {
        if let Some(bump) = &self.bump {
            // Strands are thinner than anything on them.
            return if surface.is_strand() { surface.ns } else { bump.normal(surface) };
        }
        self.normal_map.as_ref().map_or(surface.ns, |(texture, scale)| coat::pictured(surface, texture, *scale))
    }

    /// The scattering function at a point seen from direction `wo` (unit, away from the surface). `None` where the surface
    /// only absorbs. `hero_only`: the path has lost its secondary wavelengths to dispersion. `around`: the body on the outer side.
    pub fn bsdf(
        &self,
        surface: &Surface,
        wo: Vec3,
        wavelengths: &SampledWavelengths,
        hero_only: bool,
        around: Option<&Principled>,
    ) -> Option<Bsdf<'_>> {
        let scattering = self.scattering.chosen(surface, wo);
        if matches!(scattering, Scattering::Black | Scattering::Interface | Scattering::Mix(_)) {
            return None;
        }
        let ns = self.shading_normal(surface);
        if let Scattering::Hair(hair) = scattering {
            let frame = LocalFrame::along_fiber(surface, ns, wo);
            // v grows along n × t times the handedness, negative as glTF counts; seen from behind it runs the other way.
            let side = if surface.ng.dot(wo) < 0.0 { surface.handedness } else { -surface.handedness };
            let h = (2.0 * surface.uv[0].y - 1.0) * side;
            return Some(Bsdf { lobes: Lobes::Hair(hair.at(surface, h, frame.wo, wavelengths)), frame });
        }
        let frame = LocalFrame::new(surface, Orientation { ns, along: scattering.anisotropy(surface, ns) }, wo);
        Some(match scattering {
            Scattering::Black | Scattering::Interface | Scattering::Mix(_) | Scattering::Hair(_) => return None,
            Scattering::Diffuse(color) => Bsdf { lobes: Lobes::Diffuse { albedo: color.sample(surface, wavelengths) }, frame },
            Scattering::DiffuseTransmission(colors) => {
                let [reflectance, transmittance] = [0, 1].map(|i: usize| colors[i].sample(surface, wavelengths));
                Bsdf { lobes: Lobes::DiffuseTransmission { reflectance, transmittance }, frame }
            }
            Scattering::Conductor(conductor) => Bsdf { lobes: Lobes::Conductor(conductor.at(surface, wavelengths)), frame },
            Scattering::Coated(coated) => Bsdf { lobes: Lobes::Coated(coated.at(surface, wavelengths)), frame },
            Scattering::Measured(measured) => Bsdf { lobes: Lobes::Measured(measured.at(frame.wo, wavelengths)), frame },
            Scattering::Principled(principled) => {
                let mut lobes = principled.at(surface, wo, wavelengths, hero_only, around);
                frame.look_at(&mut lobes, surface);
                Bsdf { lobes: Lobes::Principled(lobes), frame }
            }
        })
    }

    /// How the frames of its scattering functions lie at a point; not of mixtures and of fibres.
    pub(crate) fn orientation(&self, surface: &Surface) -> Orientation {
        let ns = self.shading_normal(surface);
        Orientation { ns, along: self.scattering.anisotropy(surface, ns) }
    }

    /// Turns a scattering function that this material has at a point to another direction `wo` on the side from which it was seen: bit by bit that of [`Material::bsdf`], without looking
    /// up again what does not depend on the direction. Not for mixtures and fibres.
    pub(crate) fn turn<'a>(
        &'a self,
        bsdf: &mut Bsdf<'a>,
        surface: &Surface,
        orientation: Orientation,
        wo: Vec3,
        wavelengths: &SampledWavelengths,
    ) {
        bsdf.frame = LocalFrame::new(surface, orientation, wo);
        match (&mut bsdf.lobes, &self.scattering) {
            (Lobes::Principled(lobes), _) => bsdf.frame.look_at(lobes, surface),
            (Lobes::Measured(lobe), Scattering::Measured(measured)) => *lobe = measured.at(bsdf.frame.wo, wavelengths),
            _ => {}
        }
    }

    /// Density (1/sr) with which the scattering function seen from `wo` draws the direction `wi`; 0 for mirrors and where the surface only absorbs.
    /// Not of dispersing bodies, whose densities depend on the wavelengths that a path still has.
    #[inline]
    pub(crate) fn pdf(
        &self,
        surface: &Surface,
        wo: Vec3,
        wi: Vec3,
        wavelengths: &SampledWavelengths,
        around: Option<&Principled>,
    ) -> f32 {
        match &self.scattering {
            Scattering::Diffuse(_) => LocalFrame::new(surface, self.orientation(surface), wo).cosine_density(wi),
            _ => self.bsdf(surface, wo, wavelengths, false, around).map_or(0.0, |b| b.eval(wi).1),
        }
    }

    /// Whether light may go through it as if it were not there, or only dimmer: faces of media, smooth thin dielectrics.
    pub fn may_transmit_straight(&self) -> bool {
        fn of(scattering: &Scattering) -> bool {
            match scattering {
                Scattering::Interface => true,
                Scattering::Principled(p) => p.may_transmit_straight(),
                Scattering::Mix(mix) => mix.0.iter().any(of),
                _ => false,
            }
        }
        of(&self.scattering)
    }

    /// Whether a medium behind it sends out light by itself.
    pub fn holds_light(&self) -> bool {
        self.interior.media().any(Medium::shines)
    }

    /// Whether parts of it may be mirrors or clear, beside what else it does.
    pub(crate) fn may_be_specular(&self) -> bool {
        match &self.scattering {
            Scattering::Principled(p) => p.may_be_smooth(),
            Scattering::Diffuse(_) | Scattering::Black => false,
            _ => true,
        }
    }

    /// Whether it is the surface of a body of clear glass: smooth everywhere, and light is bent on its way through.
    pub(crate) fn is_clear_body(&self) -> bool {
        matches!(&self.scattering, Scattering::Principled(p) if p.is_clear_body())
            && matches!(self.coverage, Coverage::Full)
            && self.emission.is_none()
    }

    /// Whether it is a metal that is smooth everywhere: a mirror and nothing else.
    pub(crate) fn is_mirror(&self) -> bool {
        let is_smooth = match &self.scattering {
            Scattering::Conductor(conductor) => conductor.is_smooth(),
            Scattering::Principled(p) => p.is_smooth_metal(),
            _ => false,
        };
        is_smooth
            && self.normal_map.is_none()
            && self.bump.is_none()
            && matches!(self.coverage, Coverage::Full)
            && self.emission.is_none()
    }

    /// Whether it is one of several materials at each point, by chance.
    pub(crate) fn is_mixed(&self) -> bool {
        matches!(self.scattering, Scattering::Mix(_))
    }

    /// Whether it may bend wavelengths differently.
    pub(crate) fn may_disperse(&self) -> bool {
        fn of(scattering: &Scattering) -> bool {
            match scattering {
                Scattering::Principled(p) => p.dispersion.is_some(),
                Scattering::Mix(mix) => mix.0.iter().any(of),
                _ => false,
            }
        }
        of(&self.scattering)
    }

    /// Fraction of white light reflected or passed on, linear sRGB: for the albedo plane. Of captured places, which reflect none, what they show.
    pub fn albedo(&self, surface: &Surface) -> Vec3 {
        if let Some(Emission { radiance: EmissionColor::Captured { .. }, .. }) = self.emission {
            return surface.color.truncate().clamp(Vec3::ZERO, Vec3::ONE);
        }
        self.scattering.albedo(surface)
    }

    /// How its light changes with time; steady where it has none.
    #[inline]
    pub fn modulation(&self) -> Modulation {
        self.emission.as_ref().map_or(Modulation::Steady, |e| e.modulation)
    }
}

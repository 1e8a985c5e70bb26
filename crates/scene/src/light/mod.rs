//! Things that send out light, and how a point decides which of them to sample.
//!
//! [`area`] (emissive triangles, parallelograms, spheres), [`punctual`] (glTF's point, spot and directional lights),
//! [`photometry`] (measured intensities by direction, IES), [`emitters`] (all that shines by itself, as a camera sees it), [`environment`] (a lat-long map
//! around everything), [`tree`] (many lights, chosen by what they can contribute), [`segment`] (lights seen from a
//! ray in a medium).

pub mod area;
pub mod emitters;
pub mod environment;
mod lanes;
pub mod modulation;
pub mod photometry;
pub mod punctual;
pub mod segment;
pub mod tree;

pub use area::AreaLight;
pub use emitters::{EmitterMis, Emitters};
pub use environment::{Environment, RayleighSky};
pub use modulation::Modulation;
pub use punctual::{Punctual, PunctualKind, SpotEdge};

use diopter_light::SampledSpectrum;
use glam::Vec3;
use segment::{Pivot, Segment};
use tree::{LightBounds, Tree};

/// A direction towards a light, seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction towards the light.
    pub wi: Vec3,
    /// Distance to it, m; infinite for lights at infinity.
    pub distance: f32,
    /// Density of the direction in solid angle (the choice of light not included); 1 for a light without extent.
    pub pdf: f32,
    /// Whether the light has extent, so that a scattered ray could have met it.
    pub has_extent: bool,
    /// Where on the light, for its radiance.
    pub spot: LightPoint,
    /// Distance before the light at which a shadow ray ends, m: more than rounding moves the light's surface along the ray.
    pub clearance: f32,
}

/// Relative rounding of the place where a ray meets a flat surface: some units of 2⁻²³.
const ROUNDING: f32 = 1e-6;

/// [`LightSample::clearance`] of a flat surface at `end` seen from `p`, so far away, under a cosine.
#[inline]
fn clearance(p: Vec3, end: Vec3, distance: f32, cos: f32) -> f32 {
    ROUNDING * (p.abs().max(end.abs()).max_element() + distance) / cos.abs().max(1e-2)
}

/// A place on a light.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum LightPoint {
    /// Area light number, and barycentric weights of its second and third corner (or (α, β) of a quad).
    Area(u32, glam::Vec2),
    /// Punctual light number.
    Punctual(u32),
    /// A place on the environment's map.
    Environment(glam::Vec2),
}

/// A finite or infinite light by kind and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LightRef {
    /// Of the area lights.
    Area(u32),
    /// Of the punctual lights.
    Punctual(u32),
    /// The environment.
    Environment,
}

/// All lights of a scene.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    /// Emissive surfaces.
    pub area: Vec<AreaLight>,
    /// Lights without extent.
    pub punctual: Vec<Punctual>,
    /// Surroundings.
    pub environment: Option<Environment>,
    tree: Tree,
    /// Leaf of the tree of each area light; `NOWHERE` for flashes.
    area_leaf: Vec<u32>,
    /// The same of each punctual light; `NOWHERE` for flashes and lights at infinity.
    punctual_leaf: Vec<u32>,
    tree_lights: Vec<LightRef>,
    /// Directional lights and the environment, with an estimate of the irradiance each gives.
    infinite: Vec<(LightRef, f32)>,
    infinite_total: f32,
    /// Numbers of the punctual lights that are seen as discs.
    discs: Vec<u32>,
    /// Lamps that burn for a moment only: chosen among while they do.
    flashes: Vec<LightRef>,
}

const NOWHERE: u32 = u32::MAX;

/// What the scene knows of a light beyond the light itself.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Placed {
    /// Where it may be during the exposure, if it moves.
    pub bounds: Option<LightBounds>,
    /// Whether it is a flash.
    pub flash: bool,
}

/// Fraction of the light samples that go to flashes while one burns.
const FLASH_FRACTION: f32 = 0.5;

impl Lights {
    /// Prepares the choice among lights.
    pub(crate) fn new(
        area: Vec<AreaLight>,
        punctual: Vec<Punctual>,
        environment: Option<Environment>,
        placed_area: &[Placed],
        placed_punctual: &[Placed],
    ) -> Self {
        let mut bounds: Vec<LightBounds> = Vec::new();
        let mut tree_lights = Vec::new();
        let mut infinite = Vec::new();
        let mut flashes = Vec::new();
        let (mut area_place, mut punctual_place) = (vec![NOWHERE; area.len()], vec![NOWHERE; punctual.len()]);
        for (i, (light, placed)) in area.iter().zip(placed_area).enumerate() {
            let light_ref = LightRef::Area(i as u32);
            if placed.flash {
                flashes.push(light_ref);
                continue;
            }
            area_place[i] = bounds.len() as u32;
            bounds.push(placed.bounds.unwrap_or_else(|| light.bounds()));
            tree_lights.push(light_ref);
        }
        for (i, (light, placed)) in punctual.iter().zip(placed_punctual).enumerate() {
            if placed.flash {
                flashes.push(LightRef::Punctual(i as u32));
                continue;
            }
            match placed.bounds.or_else(|| light.bounds()) {
                Some(b) => {
                    punctual_place[i] = bounds.len() as u32;
                    bounds.push(b);
                    tree_lights.push(LightRef::Punctual(i as u32));
                }
                None => infinite.push((LightRef::Punctual(i as u32), light.illuminance() * std::f32::consts::PI)),
            }
        }
        if let Some(environment) = &environment {
            // A point that sees half of it gets π L; in the units of the tree (power / distance²) that is π² L.
            let importance = environment.sampled_luminance() * std::f32::consts::PI * std::f32::consts::PI;
            if importance > 0.0 {
                infinite.push((LightRef::Environment, importance));
            }
        }
        let infinite_total = infinite.iter().map(|i| i.1).sum();
        let discs =
            (0..punctual.len() as u32).filter(|i| matches!(punctual[*i as usize].kind, PunctualKind::Disc { .. })).collect();
        let (tree, leaves) = Tree::new(&bounds);
        let leaves_of =
            |places: Vec<u32>| places.into_iter().map(|p| leaves.get(p as usize).copied().unwrap_or(NOWHERE)).collect();
        let (area_leaf, punctual_leaf) = (leaves_of(area_place), leaves_of(punctual_place));
        Lights {
            area,
            punctual,
            environment,
            tree,
            area_leaf,
            punctual_leaf,
            tree_lights,
            infinite,
            infinite_total,
            discs,
            flashes,
        }
    }

    /// Whether there is no light to sample.
    pub fn is_empty(&self) -> bool {
        self.tree_lights.is_empty() && self.infinite.is_empty() && self.flashes.is_empty()
    }

    /// Whether there are lights that [`Lights::choose_along`] may give.
    #[inline]
    pub(crate) fn has_finite(&self, flash_burns: bool) -> bool {
        !self.tree_lights.is_empty() || (flash_burns && !self.flashes.is_empty())
    }

    /// Fraction of the light samples that go to flashes.
    #[inline]
    fn flash_probability(&self, flash_burns: bool) -> f32 {
        match (flash_burns && !self.flashes.is_empty(), self.tree_lights.is_empty() && self.infinite.is_empty()) {
            (false, _) => 0.0,
            (true, true) => 1.0,
            (true, false) => FLASH_FRACTION,
        }
    }

    /// Probability of choosing among the finite lights at a point.
    fn finite_group_probability(&self, p: Vec3, n: Vec3) -> f32 {
        if self.tree_lights.is_empty() {
            return 0.0;
        }
        if self.infinite.is_empty() {
            return 1.0;
        }
        let finite = self.tree.importance(p, n);
        // Estimates can be far off (occlusion, colour): neither side goes below a tenth where it can contribute.
        if finite == 0.0 { 0.0 } else { (finite / (finite + self.infinite_total)).clamp(0.1, 0.9) }
    }

    /// Chooses a light for the point `p` (m) with unit normal `n` (0 where there is none, as in media) by the number `u` in [0, 1): the light and its probability.
    /// `flash_burns`: whether one does at the moment. `None` where no light can contribute.
    #[inline]
    pub fn choose(&self, p: Vec3, n: Vec3, mut u: f32, flash_burns: bool) -> Option<(LightRef, f32)> {
        let flash = self.flash_probability(flash_burns);
        if u < flash {
            let each = flash / self.flashes.len() as f32;
            return Some((self.flashes[((u / each) as usize).min(self.flashes.len() - 1)], each));
        }
        u = (u - flash) / (1.0 - flash);
        let (light, probability) = self.choose_steady(p, n, u)?;
        Some((light, probability * (1.0 - flash)))
    }

    fn choose_steady(&self, p: Vec3, n: Vec3, u: f32) -> Option<(LightRef, f32)> {
        let fraction = self.finite_group_probability(p, n);
        if u < fraction {
            let (leaf, probability) = self.tree.choose(p, n, u / fraction)?;
            return Some((self.tree_lights[leaf], probability * fraction));
        }
        if self.infinite_total <= 0.0 {
            return None;
        }
        let mut u = (u - fraction) / (1.0 - fraction) * self.infinite_total;
        let last = self.infinite.len() - 1;
        for (i, (light, importance)) in self.infinite.iter().enumerate() {
            if u < *importance || i == last {
                return Some((*light, (1.0 - fraction) * importance / self.infinite_total));
            }
            u -= importance;
        }
        None
    }

    /// Probability with which [`Lights::choose`] finds an area light, by its number, from a point (m). Panics on a number that is no area light's.
    #[inline]
    pub fn area_probability(&self, p: Vec3, n: Vec3, light: u32, flash_burns: bool) -> f32 {
        let flash = self.flash_probability(flash_burns);
        match self.area_leaf[light as usize] {
            NOWHERE => flash / self.flashes.len() as f32,
            leaf => (1.0 - flash) * self.finite_group_probability(p, n) * self.tree.probability(p, n, leaf),
        }
    }

    /// Probability with which [`Lights::choose`] finds a light that [`Lights::choose_along`] gave from a point in a medium.
    #[inline]
    pub(crate) fn finite_probability(&self, p: Vec3, light: LightRef, flash_burns: bool) -> f32 {
        let leaf = self.leaf(light);
        let flash = self.flash_probability(flash_burns);
        match leaf {
            NOWHERE => flash / self.flashes.len().max(1) as f32,
            leaf => (1.0 - flash) * self.finite_group_probability(p, Vec3::ZERO) * self.tree.probability(p, Vec3::ZERO, leaf),
        }
    }

    /// Probability with which [`Lights::choose`] finds a light at a finite distance from a surface, where no flash burns.
    #[inline]
    pub(crate) fn finite_light_probability(&self, p: Vec3, n: Vec3, light: LightRef) -> f32 {
        match self.leaf(light) {
            NOWHERE => 0.0,
            leaf => self.finite_group_probability(p, n) * self.tree.probability(p, n, leaf),
        }
    }

    /// Leaf of a light that is not at infinity; `NOWHERE` for flashes.
    #[inline]
    fn leaf(&self, light: LightRef) -> u32 {
        match light {
            LightRef::Area(i) => self.area_leaf[i as usize],
            LightRef::Punctual(i) => self.punctual_leaf[i as usize],
            LightRef::Environment => NOWHERE,
        }
    }

    /// Fraction of the choices along a segment that go to flashes.
    #[inline]
    fn flash_probability_along(&self, flash_burns: bool) -> f32 {
        match flash_burns && !self.flashes.is_empty() {
            false => 0.0,
            true if self.tree_lights.is_empty() => 1.0,
            true => FLASH_FRACTION,
        }
    }

    /// Chooses one of the lights that are not at infinity for a segment of a ray in a medium by the number `u`: the light and its probability. (A
    /// flash may be at infinity nevertheless: it has no [`Pivot`].)
    #[inline]
    pub(crate) fn choose_along(&self, segment: &Segment, u: f32, flash_burns: bool) -> Option<(LightRef, f32)> {
        let flash = self.flash_probability_along(flash_burns);
        if u < flash {
            let each = flash / self.flashes.len() as f32;
            return Some((self.flashes[((u / each) as usize).min(self.flashes.len() - 1)], each));
        }
        let (leaf, probability) = match self.tree_lights.len() {
            0 => return None,
            _ => self.tree.choose_along(segment, (u - flash) / (1.0 - flash))?,
        };
        Some((self.tree_lights[leaf], probability * (1.0 - flash)))
    }

    /// Probability with which [`Lights::choose_along`] finds a light that is not at infinity.
    #[inline]
    pub(crate) fn probability_along(&self, segment: &Segment, light: LightRef, flash_burns: bool) -> f32 {
        let flash = self.flash_probability_along(flash_burns);
        match self.leaf(light) {
            NOWHERE => flash / self.flashes.len().max(1) as f32,
            leaf => (1.0 - flash) * self.tree.probability_along(segment, leaf),
        }
    }

    /// What equi-angular sampling needs to know of a light that stands still; `None` at infinity.
    #[inline]
    pub(crate) fn pivot(&self, light: LightRef) -> Option<Pivot> {
        match light {
            LightRef::Area(i) => Some(self.area[i as usize].pivot()),
            LightRef::Punctual(i) => self.punctual[i as usize].kind.pivot(),
            LightRef::Environment => None,
        }
    }

    /// Probability with which [`Lights::choose`] finds the environment from a point (m).
    #[inline]
    pub fn environment_probability(&self, p: Vec3, n: Vec3, flash_burns: bool) -> f32 {
        match self.infinite.last() {
            Some((LightRef::Environment, importance)) => self.infinite_probability(p, n, *importance, flash_burns),
            _ => 0.0,
        }
    }

    /// Probability with which [`Lights::choose`] finds a light at infinity from a point.
    pub(crate) fn infinite_light_probability(&self, p: Vec3, n: Vec3, light: LightRef, flash_burns: bool) -> f32 {
        let own = self.infinite.iter().find(|l| l.0 == light);
        own.map_or(0.0, |(_, importance)| self.infinite_probability(p, n, *importance, flash_burns))
    }

    fn infinite_probability(&self, p: Vec3, n: Vec3, importance: f32, flash_burns: bool) -> f32 {
        if self.infinite_total <= 0.0 {
            return 0.0;
        }
        (1.0 - self.flash_probability(flash_burns)) * (1.0 - self.finite_group_probability(p, n)) * importance
            / self.infinite_total
    }

    /// Numbers and radiance of the discs at infinity in a direction; each with the density with which it would have been sampled, the choice of light
    /// included, seen from `from`.
    pub(crate) fn discs(
        &self,
        direction: Vec3,
        from: Option<(Vec3, Vec3)>,
        wavelengths: &diopter_light::SampledWavelengths,
        flash_burns: bool,
    ) -> impl Iterator<Item = (u32, SampledSpectrum, f32)> {
        self.discs.iter().filter_map(move |i| {
            let (radiance, density) = self.punctual[*i as usize].disc(direction, wavelengths)?;
            let chosen = from.map_or(0.0, |(p, n)| self.infinite_light_probability(p, n, LightRef::Punctual(*i), flash_burns));
            Some((*i, radiance, chosen * density))
        })
    }

    /// Samples a chosen light from a point (m) by two numbers in [0, 1). `None` when it cannot be seen from there even without obstacles.
    #[inline]
    pub fn sample_li(&self, light: LightRef, p: Vec3, u: [f32; 2]) -> Option<LightSample> {
        match light {
            LightRef::Area(i) => self.area[i as usize].sample_li(p, u, i),
            LightRef::Punctual(i) => self.punctual[i as usize].sample_li(p, u, i),
            LightRef::Environment => self.environment.as_ref()?.sample_li(u),
        }
    }

    /// Spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹ (for lights without extent, irradiance on a plane facing them, W·m⁻²·nm⁻¹), that arrives along a light sample; obstacles are
    /// not asked for.
    #[inline]
    pub fn incident_radiance(
        &self,
        light_sample: &LightSample,
        materials: &[crate::material::Material],
        wavelengths: &diopter_light::SampledWavelengths,
    ) -> SampledSpectrum {
        match light_sample.spot {
            LightPoint::Area(i, place) => self.area[i as usize].radiance(place, materials, wavelengths),
            LightPoint::Punctual(i) => self.punctual[i as usize].incident_radiance(light_sample, wavelengths),
            LightPoint::Environment(place) => self
                .environment
                .as_ref()
                .map_or(SampledSpectrum::ZERO, |e| diopter_light::Spectrum::light_from_rgb(e.rgb_at(place)).sample(wavelengths)),
        }
    }
}

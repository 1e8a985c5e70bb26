//! Things that send out light, and how a point decides which of them to aim at.
//!
//! [`area`] (emissive triangles, parallelograms, spheres), [`punctual`] (glTF's point, spot and directional lights),
//! [`environment`] (a lat-long map around everything), [`tree`] (many lights, chosen by what they can contribute).

pub mod area;
pub mod environment;
pub mod punctual;
pub mod tree;

pub use area::AreaLight;
pub use environment::Environment;
pub use punctual::{Punctual, PunctualKind};

use diopter_light::Sampled;
use glam::Vec3;
use tree::{LightBounds, Tree};

/// A direction towards a light, seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    /// Unit direction towards the light.
    pub wi: Vec3,
    /// Distance to it, m; infinite for lights at infinity.
    pub distance: f32,
    /// Density of the direction in solid angle (the choice of light not included); 1 for a light without extent.
    pub pdf: f32,
    /// Whether the light has extent, so that a scattered ray could have met it.
    pub has_extent: bool,
    /// Where on the light, for its radiance.
    pub spot: Spot,
}

/// A place on a light.
#[derive(Clone, Copy, Debug)]
pub enum Spot {
    /// Area light number, and barycentric weights of its second and third corner (or (α, β) of a quad).
    Area(u32, glam::Vec2),
    /// Punctual light number.
    Punctual(u32),
    /// A place on the environment's map.
    Environment(glam::Vec2),
}

/// A finite or infinite light by kind and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Leaf of the tree of each area light and each punctual light.
    area_leaf: Vec<u32>,
    tree_lights: Vec<LightRef>,
    /// Directional lights and the environment, with an estimate of the irradiance each gives.
    infinite: Vec<(LightRef, f32)>,
    infinite_total: f32,
}

impl Lights {
    /// Prepares the choice among lights.
    pub fn new(area: Vec<AreaLight>, punctual: Vec<Punctual>, environment: Option<Environment>) -> Self {
        let mut bounds: Vec<LightBounds> = Vec::new();
        let mut tree_lights = Vec::new();
        let mut infinite = Vec::new();
        for (i, light) in area.iter().enumerate() {
            bounds.push(light.bounds());
            tree_lights.push(LightRef::Area(i as u32));
        }
        for (i, light) in punctual.iter().enumerate() {
            match light.bounds() {
                Some(b) => {
                    bounds.push(b);
                    tree_lights.push(LightRef::Punctual(i as u32));
                }
                None => infinite.push((LightRef::Punctual(i as u32), light.illuminance() * std::f32::consts::PI)),
            }
        }
        if let Some(environment) = &environment {
            // A point that sees half of it gets π L; in the units of the tree (power / distance²) that is π² L.
            let importance = environment.aimed_luminance() * std::f32::consts::PI * std::f32::consts::PI;
            if importance > 0.0 {
                infinite.push((LightRef::Environment, importance));
            }
        }
        let infinite_total = infinite.iter().map(|i| i.1).sum();
        let (tree, leaves) = Tree::new(&bounds);
        let area_leaf = leaves[..area.len()].to_vec();
        Lights { area, punctual, environment, tree, area_leaf, tree_lights, infinite, infinite_total }
    }

    /// Whether there is no light to aim at.
    pub fn is_empty(&self) -> bool {
        self.tree_lights.is_empty() && self.infinite.is_empty()
    }

    /// Probability of choosing among the finite lights at a point.
    fn finite_share(&self, p: Vec3, n: Vec3) -> f32 {
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

    /// Chooses a light for the point `p` with normal `n` by the number `u`: the light and its probability.
    #[inline]
    pub fn choose(&self, p: Vec3, n: Vec3, u: f32) -> Option<(LightRef, f32)> {
        let share = self.finite_share(p, n);
        if u < share {
            let (leaf, probability) = self.tree.choose(p, n, u / share)?;
            return Some((self.tree_lights[leaf], probability * share));
        }
        if self.infinite_total <= 0.0 {
            return None;
        }
        let mut u = (u - share) / (1.0 - share) * self.infinite_total;
        let last = self.infinite.len() - 1;
        for (i, (light, importance)) in self.infinite.iter().enumerate() {
            if u < *importance || i == last {
                return Some((*light, (1.0 - share) * importance / self.infinite_total));
            }
            u -= importance;
        }
        None
    }

    /// Probability with which [`Lights::choose`] finds an area light from a point.
    #[inline]
    pub fn area_probability(&self, p: Vec3, n: Vec3, light: u32) -> f32 {
        self.finite_share(p, n) * self.tree.probability(p, n, self.area_leaf[light as usize])
    }

    /// Probability with which [`Lights::choose`] finds the environment from a point.
    #[inline]
    pub fn environment_probability(&self, p: Vec3, n: Vec3) -> f32 {
        match self.infinite.last() {
            Some((LightRef::Environment, importance)) => (1.0 - self.finite_share(p, n)) * importance / self.infinite_total,
            _ => 0.0,
        }
    }

    /// Aims at a chosen light from a point. `None` when it cannot be seen from there even without obstacles.
    #[inline]
    pub fn aim(&self, light: LightRef, p: Vec3, u: [f32; 2]) -> Option<Aim> {
        match light {
            LightRef::Area(i) => self.area[i as usize].aim(p, u, i),
            LightRef::Punctual(i) => self.punctual[i as usize].aim(p, i),
            LightRef::Environment => self.environment.as_ref()?.aim(u),
        }
    }

    /// Spectral radiance (or, for lights without extent, irradiance on a plane facing them) that arrives along an aim.
    #[inline]
    pub fn arriving(
        &self,
        aim: &Aim,
        materials: &[crate::material::Material],
        wavelengths: &diopter_light::Wavelengths,
    ) -> Sampled {
        match aim.spot {
            Spot::Area(i, place) => self.area[i as usize].radiance(place, materials, wavelengths),
            Spot::Punctual(i) => self.punctual[i as usize].arriving(aim, wavelengths),
            Spot::Environment(place) => self
                .environment
                .as_ref()
                .map_or(Sampled::ZERO, |e| diopter_light::Spectrum::light_from_rgb(e.rgb_at(place)).sample(wavelengths)),
        }
    }
}

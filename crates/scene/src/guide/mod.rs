//! Path guiding: directions at surfaces are drawn where light was found to come from, not only where the surface scatters to.
//!
//! A [`Guide`] holds a density of directions for each region of the scene ([`spatial`], [`quadtree`]). At a surface that is not narrow like a mirror the next
//! direction is drawn from a mixture of it and of the scattering function, with the fraction of the latter learnt for each region (T. Müller, M. Gross,
//! J. Novák 2017, "Practical Path Guiding for Efficient Light-Transport Simulation"; learnt fractions: J. Vorba et al. 2019, "Path Guiding in
//! Production", here the best of a few candidates by the second moment that each would have had). The density of the mixture stands in all weights
//! of multiple importance sampling, so a guide of any quality gives the same mean; only the variance differs.
//!
//! [`Training`] learns a guide from paths of its own, which depend on seed, scene, camera and film alone, so that every part of an exposure learns
//! the same one. Limits: scattering in media and surfaces that disperse keep their own sampling; one density for all moments of an exposure.

mod quadtree;
mod record;
mod spatial;
mod training;

pub use training::{CameraPath, Trained, Training};

pub(crate) use record::{PathRecord, Vertex};

use crate::material::{Bsdf, Scatter};
use glam::Vec3;
use quadtree::{BELOW_ONE, Quadtree};
use spatial::{SpatialTree, place};

/// Whether paths are guided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GuideMode {
    /// Never.
    Off,
    /// If training shows that it pays.
    #[default]
    Auto,
    /// Always, after training.
    On,
}

impl GuideMode {
    /// Names as people write them.
    pub const NAMES: [(&'static str, GuideMode); 3] = [("auto", GuideMode::Auto), ("on", GuideMode::On), ("off", GuideMode::Off)];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// The mode of a name.
    pub fn named(name: &str) -> Option<GuideMode> {
        Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1)
    }
}

/// Most that [`Drawn::roulette_factor`] may be: products of more would overflow.
const MOST_ROULETTE_FACTOR: f32 = 1e6;

/// Least probability of broad lobes at which a surface is guided: narrower ones find their light themselves.
const LEAST_BROAD: f32 = 0.05;

/// Where light comes from, at every place of a scene: made by [`Training::run`], used by [`crate::Scene::radiance_with`].
#[derive(Clone, Debug, PartialEq)]
pub struct Guide {
    tree: SpatialTree,
    regions: Vec<Region>,
}

/// What is known of a region.
#[derive(Clone, Debug, PartialEq)]
struct Region {
    directions: Quadtree,
    /// Fraction of directions that the scattering function draws; 1 leaves all to it.
    bsdf_fraction: f32,
}

impl Guide {
    /// A guide that knows nothing and changes nothing.
    fn new() -> Self {
        Guide { tree: SpatialTree::new(), regions: vec![Region { directions: Quadtree::uniform(), bsdf_fraction: 1.0 }] }
    }

    /// Number of regions that have a density of their own.
    pub fn regions(&self) -> usize {
        self.regions.len()
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> usize {
        let region = |r: &Region| size_of::<Region>() + r.directions.memory();
        self.tree.memory() + self.regions.iter().map(region).sum::<usize>()
    }

    /// Whether directions at a surface may be guided: not where all lobes are narrow, nor where wavelengths part.
    #[inline]
    pub(crate) fn may_guide(bsdf: &Bsdf) -> bool {
        bsdf.broad_fraction() >= LEAST_BROAD && !bsdf.may_disperse()
    }

    /// How directions are drawn at a surface; `None` where its scattering function does so alone.
    #[inline]
    pub(crate) fn mixture(&self, point: Vec3, normal: Vec3, bsdf: &Bsdf) -> Option<Mixture<'_>> {
        if !Guide::may_guide(bsdf) {
            return None;
        }
        let region = &self.regions[self.tree.find(&place(point, normal))];
        // The guide stands for the broad lobes alone.
        let bsdf_fraction = 1.0 - (1.0 - region.bsdf_fraction) * bsdf.broad_fraction();
        (bsdf_fraction < 1.0).then_some(Mixture { directions: &region.directions, bsdf_fraction })
    }
}

/// The scattering function and the guide at a surface: one of them draws (one-sample model, balance heuristic; Veach 1997, §9.2.4).
#[derive(Clone, Copy)]
pub(crate) struct Mixture<'a> {
    directions: &'a Quadtree,
    /// Probability of the scattering function.
    bsdf_fraction: f32,
}

/// A direction that was drawn.
#[derive(Clone, Copy)]
pub(crate) struct Drawn {
    /// With the density of the mixture, 1/sr.
    pub scatter: Scatter,
    /// Density that the scattering function alone has for it, 1/sr.
    pub bsdf_pdf: f32,
    /// What brings the throughput back to that of the scattering function alone, for Russian roulette: small weights of guided directions stand
    /// for much light, and must not end paths. (The remedy of J. Vorba, J. Křivánek 2016, "Adjoint-Driven Russian Roulette and Splitting", needs an
    /// estimate of the light; this keeps the lengths of paths that are not guided.)
    pub roulette_factor: f32,
}

impl Drawn {
    /// Drawn by the scattering function alone.
    #[inline]
    pub fn unguided(scatter: Scatter) -> Self {
        Drawn { scatter, bsdf_pdf: scatter.pdf, roulette_factor: 1.0 }
    }
}

impl Mixture<'_> {
    /// Density of a direction, 1/sr, to which the scattering function gives `bsdf_pdf`. Mirror directions are not counted.
    #[inline]
    pub fn pdf(&self, wi: Vec3, bsdf_pdf: f32) -> f32 {
        self.mixed(bsdf_pdf, self.directions.pdf(wi))
    }

    #[inline]
    fn mixed(&self, bsdf_pdf: f32, guide_pdf: f32) -> f32 {
        self.bsdf_fraction * bsdf_pdf + (1.0 - self.bsdf_fraction) * guide_pdf
    }

    /// Draws a direction; `u` as for [`Bsdf::sample`], the third number also chooses who draws. `None` when light is absorbed.
    #[inline]
    pub fn sample(&self, bsdf: &Bsdf, u: [f32; 4]) -> Option<Drawn> {
        let fraction = self.bsdf_fraction;
        if u[2] < fraction {
            let s = bsdf.sample([u[0], u[1], (u[2] / fraction).min(BELOW_ONE), u[3]])?;
            if s.specular {
                // Only the scattering function finds it.
                let scatter = Scatter { weight: s.weight / fraction, pdf: s.pdf * fraction, ..s };
                return Some(Drawn { scatter, bsdf_pdf: s.pdf, roulette_factor: fraction });
            }
            let pdf = self.pdf(s.wi, s.pdf);
            let scatter = Scatter { weight: s.weight * (s.pdf / pdf), pdf, ..s };
            return Some(Drawn { scatter, bsdf_pdf: s.pdf, roulette_factor: (pdf / s.pdf).min(MOST_ROULETTE_FACTOR) });
        }
        let (wi, guide_pdf) = self.directions.sample([u[0], u[1]]);
        let s = bsdf.scatter_into(wi)?;
        let pdf = self.mixed(s.pdf, guide_pdf);
        let scatter = Scatter { weight: s.weight / pdf, pdf, ..s };
        let roulette_factor = if s.pdf > 0.0 { (pdf / s.pdf).min(MOST_ROULETTE_FACTOR) } else { 1.0 };
        Some(Drawn { scatter, bsdf_pdf: s.pdf, roulette_factor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::conductor::{Conductor, FacetBounces};
    use crate::material::{Material, Principled, Scattering, Transmission};
    use crate::shape::{Sphere, Surface};
    use crate::texture::{Color, Scalar};
    use crate::{Description, Object, Scene, Shape};
    use diopter_light::random::{mix, to_unit};
    use diopter_light::{Ray, Spectrum, Wavelengths, sampling};

    fn uniform(i: u32, k: u32) -> f32 {
        to_unit(mix(i.wrapping_mul(11).wrapping_add(k) ^ 0x2c1b_3c6d))
    }

    fn materials() -> Vec<Material> {
        let principled = |change: &dyn Fn(&mut Principled)| {
            let mut p = Principled::new(Color::rgb(0.8, 0.8, 0.8), 1.5);
            change(&mut p);
            Scattering::Principled(Box::new(p))
        };
        let s = Scalar::Constant;
        let metal = Conductor {
            n: Spectrum::Constant(0.2),
            k: Spectrum::Constant(3.0),
            alpha: s(0.3),
            across: None,
            bounces: FacetBounces::Compensated,
        };
        vec![
            Material::new("diffuse", Scattering::Diffuse(Color::rgb(0.7, 0.7, 0.7))),
            Material::new("metal", Scattering::Conductor(metal)),
            Material::new(
                "rough glass",
                principled(&|p| {
                    (p.kind, p.transmission, p.roughness) = (Transmission::Solid, s(1.0), s(0.5));
                }),
            ),
            Material::new("varnish", principled(&|p| p.roughness = s(0.0))),
        ]
    }

    /// Where a ray from +z meets a unit sphere, off its middle.
    fn hit(material: Material) -> (Scene, Surface, Vec3) {
        let scene = Scene::build(Description {
            materials: vec![material],
            objects: vec![Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), 0)],
            ..Default::default()
        })
        .unwrap();
        let ray = Ray { origin: Vec3::new(0.5, 0.2, 3.0), direction: Vec3::NEG_Z, time_s: 0.0 };
        let surface = scene.intersect(&ray, f32::INFINITY).unwrap();
        (scene, surface, -ray.direction)
    }

    /// A guide that has learnt a bright spot and dim light all around.
    fn spotted() -> Guide {
        let light = |p: [f32; 2]| if (p[0] - 0.8).hypot(p[1] - 0.4) < 0.1 { 20.0 } else { 0.5 };
        let directions = quadtree::tests::learnt(light, 5, 3000);
        Guide { regions: vec![Region { directions, bsdf_fraction: 0.5 }], ..Guide::new() }
    }

    #[test]
    fn mixtures_estimate_the_same_albedo_as_the_scattering_function() {
        let guide = spotted();
        let wavelengths = Wavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        for material in materials() {
            let name = material.name.clone();
            let (scene, surface, wo) = hit(material);
            let bsdf = scene.material(surface.object).bsdf(&surface, wo, &wavelengths, false, None).unwrap();
            let mixture = guide.mixture(surface.point, bsdf.side_normal(), &bsdf).expect("it is guided");
            let n = 200_000;
            // Mean and mean square of the weights, drawn by the mixture and alone.
            let (mut mixed, mut alone) = ([0.0f64; 2], [0.0f64; 2]);
            for i in 0..n {
                let u = [1, 2, 3, 4].map(|k| uniform(i, k));
                let weight = |s: Option<Scatter>| s.map_or(0.0, |s| f64::from(s.weight.y));
                let (a, b) = (weight(mixture.sample(&bsdf, u).map(|d| d.scatter)), weight(bsdf.sample(u)));
                for (sum, w) in [(&mut mixed, a), (&mut alone, b)] {
                    sum[0] += w / f64::from(n);
                    sum[1] += w * w / f64::from(n);
                }
            }
            let variance = |s: [f64; 2]| (s[1] - s[0] * s[0]).max(0.0) / f64::from(n);
            let deviation = (variance(mixed) + variance(alone)).sqrt();
            // 4.5 σ, and rounding.
            assert!((mixed[0] - alone[0]).abs() < 4.5 * deviation + 1e-4, "{name}: {mixed:?} {alone:?} ± {deviation}");
        }
    }

    #[test]
    fn the_density_of_a_mixture_integrates_to_what_it_draws() {
        // Over the sphere the density is the fraction of draws that are no mirror directions, those without light included.
        let guide = spotted();
        let wavelengths = Wavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        for material in materials() {
            let name = material.name.clone();
            let (scene, surface, wo) = hit(material);
            let bsdf = scene.material(surface.object).bsdf(&surface, wo, &wavelengths, false, None).unwrap();
            let mixture = guide.mixture(surface.point, bsdf.side_normal(), &bsdf).unwrap();
            let side = 1024u32;
            let (mut integral, mut bsdf_alone) = (0.0f64, 0.0f64);
            for i in 0..side * side {
                let at = |k: u32| (k as f32 + 0.5) / side as f32;
                let d = sampling::sphere([at(i % side), at(i / side)]);
                let pdf = bsdf.eval(d).1;
                integral += f64::from(mixture.pdf(d, pdf));
                bsdf_alone += f64::from(pdf);
            }
            let cell = 4.0 * std::f64::consts::PI / f64::from(side * side);
            let (integral, bsdf_alone) = (integral * cell, bsdf_alone * cell);
            let expected = f64::from(mixture.bsdf_fraction) * bsdf_alone + 1.0 - f64::from(mixture.bsdf_fraction);
            // The grid has the cells of the guide; lobes of the surface are seen by its 1e6 points.
            assert!((integral - expected).abs() < 5e-3 && integral <= 1.01, "{name}: {integral} {expected}");
        }
    }

    #[test]
    fn what_is_narrow_or_disperses_is_not_guided() {
        let guide = spotted();
        let wavelengths = Wavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let mut glass = Principled::new(Color::rgb(1.0, 1.0, 1.0), 1.5);
        (glass.kind, glass.transmission) = (Transmission::Solid, Scalar::Constant(1.0));
        (glass.roughness, glass.dispersion) = (Scalar::Constant(0.6), Some(Spectrum::Constant(1.5)));
        let mut mirror = Conductor::metal("silver", 0.01).unwrap();
        mirror.bounces = FacetBounces::Lost;
        for scattering in [Scattering::Principled(Box::new(glass)), Scattering::Conductor(mirror)] {
            let (scene, surface, wo) = hit(Material::new("it", scattering));
            let bsdf = scene.material(surface.object).bsdf(&surface, wo, &wavelengths, false, None).unwrap();
            assert!(guide.mixture(surface.point, bsdf.side_normal(), &bsdf).is_none());
        }
    }
}

//! From how much light a deep body gives back to the albedo of its single scattering events: what artists and files say of skin, wax and marble.
//!
//! Light that enters an endless half space of a medium under a smooth dielectric surface is followed without absorption, and the number of scattering
//! events until it leaves is counted. With p(n) the distribution of that number, a medium of albedo α gives back A(α) = Σ p(n) αⁿ, for all α by one
//! simulation (as scattering orders: H. C. van de Hulst 1980, "Multiple Light Scattering", §5.2). A(α) rises, and is inverted by bisection.
//!
//! A is the fraction of light that has entered, diffuse from outside; what the surface reflects is not part of it (as pbrt-v4's effective
//! albedo). The closed form of M. Chiang, P. Kutz, B. Burley 2016, "Practical and Controllable Subsurface Scattering for Production Path
//! Tracing", holds for a surface that does not refract; refraction takes up to a third off A.

use super::scattered;
use crate::material::microfacet::fresnel_dielectric;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use glam::Vec3;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Walks that are followed. The standard error of A is below 0.5 / √n = 0.3 %.
const WALKS: u32 = 1 << 15;
/// Scattering events up to which they are. Beyond, p(n) falls as n^(−3/2), as first returns of any random walk do.
const LONGEST: usize = 768;

/// The distribution of the number of scattering events that light takes in a half space.
#[derive(Debug)]
pub struct Orders {
    /// Fraction of light that leaves after so many events.
    fractions: Vec<f64>,
    /// Fraction that takes more.
    longer: f64,
}

impl Orders {
    /// That of a medium of an asymmetry (mean cosine of scattering, above −1, below 1) under a surface of an index of refraction, of at least 1. Computed once for each
    /// pair.
    pub fn of(asymmetry: f32, eta: f32) -> Arc<Orders> {
        type Known = Mutex<HashMap<[u32; 2], Arc<Orders>>>;
        static KNOWN: OnceLock<Known> = OnceLock::new();
        let mut known = KNOWN.get_or_init(Known::default).lock().unwrap_or_else(PoisonError::into_inner);
        known.entry([asymmetry, eta].map(f32::to_bits)).or_insert_with(|| Arc::new(Orders::new(asymmetry, eta))).clone()
    }

    fn new(asymmetry: f32, eta: f32) -> Self {
        let mut counts = vec![0u32; LONGEST + 1];
        let mut entered = 0;
        for i in 0..WALKS {
            let mut stream = Sampler::new(SamplerKind::Independent, 0x5eed, (0, 0), i, WALKS).stream(Dimensions::Tracking(0));
            // In: diffuse light, stratified in the square of the cosine.
            let cos = ((i as f32 + stream.draw()) / WALKS as f32).sqrt();
            if stream.draw() < fresnel_dielectric(cos, eta) {
                continue;
            }
            entered += 1;
            // Depth in mean free paths, and direction; z points down.
            let down = (1.0 - (1.0 - cos * cos) / (eta * eta)).max(0.0).sqrt();
            let mut direction = Vec3::new((1.0 - down * down).max(0.0).sqrt(), 0.0, down);
            let (mut depth, mut events) = (0.0f32, 0);
            while events <= LONGEST {
                depth -= (1.0 - stream.draw()).ln() * direction.z;
                if depth < 0.0 {
                    // Out, or reflected at the surface: free paths have no memory.
                    if stream.draw() >= fresnel_dielectric(-direction.z, 1.0 / eta) {
                        break;
                    }
                    (depth, direction.z) = (0.0, -direction.z);
                    continue;
                }
                events += 1;
                direction = scattered(direction, asymmetry, [stream.draw(), stream.draw()]).0;
            }
            if events <= LONGEST {
                counts[events] += 1;
            }
        }
        let scale = 1.0 / f64::from(entered.max(1));
        let fractions: Vec<f64> = counts.into_iter().map(|c| f64::from(c) * scale).collect();
        let longer = 1.0 - fractions.iter().sum::<f64>();
        Orders { fractions, longer }
    }

    /// The fraction of light, 0 to 1, that comes back out of a medium of an albedo, 0 to 1.
    pub fn reflectance(&self, albedo: f64) -> f64 {
        let short = self.fractions.iter().rev().fold(0.0, |sum, p| sum * albedo + p);
        // ∫ ½ u^(−3/2) αᴺᵘ du from 1 to ∞, with u = v⁻².
        let x = -albedo.max(1e-300).ln() * (LONGEST as f64 + 1.0);
        let steps = 64;
        let tail: f64 = (0..steps).map(|i| (-x / ((i as f64 + 0.5) / steps as f64).powi(2)).exp()).sum::<f64>() / steps as f64;
        short + self.longer * tail
    }

    /// The albedo, 0 to 1, of a medium that gives back a fraction of the light, 0 to 1; found by bisection.
    pub fn albedo(&self, reflectance: f64) -> f64 {
        // In the root of what is absorbed, by which A changes evenly near 1.
        let (mut low, mut high) = (0.0f64, 1.0f64);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            match self.reflectance(1.0 - middle * middle) > reflectance {
                true => low = middle,
                false => high = middle,
            }
        }
        1.0 - (0.5 * (low + high)).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_spaces_without_refraction_are_van_de_hulsts() {
        // Spherical albedo by similarity, within 0.4 % of exact tables: van de Hulst 1980, §14.3; here ± 1 % for the noise of the walks.
        for g in [0.0f32, 0.7] {
            let orders = Orders::of(g, 1.0);
            for albedo in [0.7f64, 0.9, 0.99, 0.999] {
                let s = ((1.0 - albedo) / (1.0 - albedo * f64::from(g))).sqrt();
                let expected = (1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s);
                let found = orders.reflectance(albedo);
                assert!((found - expected).abs() < 0.008, "g {g}, {albedo}: {found} {expected}");
            }
        }
    }

    #[test]
    fn refraction_keeps_light_in() {
        // Simulated apart, by 60 000 walks with absorption: ± 0.002.
        for (eta, g, albedo, expected) in [
            (1.33f32, 0.0f32, 0.7f64, 0.1281),
            (1.33, 0.0, 0.99, 0.6584),
            (1.33, 0.7, 0.9, 0.1248),
            (1.5, 0.0, 0.9, 0.2371),
            (1.5, 0.0, 0.999, 0.8373),
        ] {
            let found = Orders::of(g, eta).reflectance(albedo);
            assert!((found - expected).abs() < 0.008, "{eta} {g} {albedo}: {found} {expected}");
        }
    }

    #[test]
    fn albedos_give_back_what_was_asked_for() {
        let orders = Orders::of(0.0, 1.33);
        assert!((orders.reflectance(1.0) - 1.0).abs() < 1e-12);
        for reflectance in [0.01, 0.2, 0.5, 0.8, 0.97] {
            let albedo = orders.albedo(reflectance);
            assert!((orders.reflectance(albedo) - reflectance).abs() < 1e-4, "{reflectance}: {albedo}");
        }
        assert!(orders.albedo(1.0) > 1.0 - 1e-9 && orders.albedo(0.0) < 1e-6);
    }
}

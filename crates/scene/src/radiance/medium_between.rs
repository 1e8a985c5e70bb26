//! What a homogeneous medium does to light between a donor and the receivers of a group, and how likely their paths would have come through it.

use super::donor::{Donor, Scatterer};
use super::receiver::Receiver;
use crate::medium::Sigma;
use crate::medium_stack::MediumId;
use crate::scene::Scene;
use diopter_light::{Ray, SampledSpectrum};
use glam::Vec3;

/// A homogeneous medium between receivers and a donor.
pub(super) struct MediumBetween<'a> {
    scene: &'a Scene,
    id: MediumId,
    sigma: Sigma,
    /// Whether the medium is what scatters at the donor.
    ends_in_it: bool,
}

impl<'a> MediumBetween<'a> {
    /// `None` where there is none.
    pub fn new(scene: &'a Scene, id: MediumId, donor: &Donor<'_>) -> Option<Self> {
        let (medium, ends_in_it) = (scene.medium(id)?, matches!(donor.scatterer, Scatterer::Medium { .. }));
        Some(MediumBetween { scene, id, sigma: medium.at(donor.wavelengths), ends_in_it })
    }

    /// What of the donor's light comes to a receiver, for a donor in the medium over a metre; and the probability that a path comes as far from there that carries so much, or its density, 1/m.
    #[inline]
    pub fn left(&self, receiver: &Receiver, wi: Vec3, distance: f32, carried: SampledSpectrum) -> (SampledSpectrum, f32) {
        let sigma = &self.sigma;
        let inside = match self.id {
            MediumId::Air => {
                let ray = Ray { origin: receiver.origin, direction: wi, time_s: receiver.time_s };
                self.scene.air().and_then(|air| air.span(&ray, distance)).map_or(0.0, |[near, far]| far - near)
            }
            _ => distance,
        };
        flight(sigma, inside, carried, self.ends_in_it)
    }
}

/// What is left of light after a way through a medium, for a place in it over a metre; and the probability that a path comes as far that carries so much, or its density, 1/m: of [`Sigma::sample_distance`].
fn flight(sigma: &Sigma, distance: f32, carried: SampledSpectrum, ends_in_it: bool) -> (SampledSpectrum, f32) {
    let left = sigma.transmittance(distance);
    let is_drawn = sigma.scattering != SampledSpectrum::ZERO && carried.element_sum() > 0.0;
    match (ends_in_it, is_drawn) {
        (true, true) => (left * sigma.scattering, sigma.density(distance, carried)),
        (true, false) => (SampledSpectrum::ZERO, 0.0),
        (false, true) => (left, (carried / carried.element_sum()).dot(left)),
        (false, false) => (left, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::DistanceSample;

    #[test]
    fn flights_have_the_density_with_which_they_are_drawn() {
        let scattering = SampledSpectrum::new(0.5, 1.0, 2.0, 0.2);
        let sigma = Sigma { absorption: SampledSpectrum::splat(0.3), scattering, extinction: scattering + 0.3 };
        let carried = SampledSpectrum::new(0.1, 0.4, 0.0, 0.5);
        // The weight of a flight times its density is what is left.
        for (u, v) in [(0.1, 0.3), (0.4, 0.9), (0.5, 0.05), (0.999, 0.6)] {
            let (distance, weight, ends_in_it) = match sigma.sample_distance(2.0, [u, v], carried) {
                DistanceSample::Through(weight) => (2.0, weight, false),
                DistanceSample::Scattered(distance, weight) => (distance, weight, true),
            };
            let (left, density) = flight(&sigma, distance, carried, ends_in_it);
            assert!((weight * density - left).abs().max_element() < 1e-5, "{distance}: {left} {density}");
        }
        // What carries nothing any more comes through and is not scattered, and spoils no sum.
        assert_eq!(flight(&sigma, 1.0, SampledSpectrum::ZERO, true), (SampledSpectrum::ZERO, 0.0));
        assert_eq!(flight(&sigma, 1.0, SampledSpectrum::ZERO, false).1, 1.0);
        let clear = Sigma { scattering: SampledSpectrum::ZERO, extinction: SampledSpectrum::splat(0.3), ..sigma };
        assert_eq!(flight(&clear, 1.0, carried, false).1, 1.0);
    }
}

//! A light that was chosen for a vertex of a path and may be hidden from it.

use crate::light::LightSample;
use crate::medium_stack::MediumStack;
use crate::scene::Visibility;
use diopter_light::SampledSpectrum;
use glam::Vec3;

/// A light that was chosen for a vertex of a path. `V`: what a [`Tally`](super::tally::Tally) keeps of the vertex.
pub(super) struct LightConnection<V> {
    pub light_sample: LightSample,
    /// What comes into the path where nothing is on the way: radiance, with the weights of multiple importance sampling against chance alone.
    pub contribution: SampledSpectrum,
    /// Where the vertex is, where the shadow ray starts, and the bodies that it starts in.
    pub point: Vec3,
    pub origin: Vec3,
    pub medium_stack: MediumStack,
    /// Squared ratios of the densities of what else finds this light, to that of the choice: the scattered ray, and light paths.
    pub by_chance: f32,
    pub by_connection: f32,
    /// Of the path at the vertex.
    pub vertex: u32,
    pub depth: u32,
    pub tallied: V,
    /// What is known of the straight line, if it was looked at.
    pub visibility: Option<Visibility>,
}

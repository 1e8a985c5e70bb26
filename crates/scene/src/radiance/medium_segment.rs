//! A segment of a path in a medium.

use super::PathSettings;
use super::prev_scatter::SegmentStart;
use crate::medium::Medium;
use crate::medium_stack::MediumStack;
use crate::scene::Scene;
use diopter_light::random::Sampler;
use diopter_light::{Ray, SampledWavelengths};

/// A segment of a path in a medium, ready to be taken.
pub(super) struct MediumSegment<'a> {
    pub scene: &'a Scene,
    pub medium: &'a Medium,
    /// The part of the ray in the medium, m.
    pub span: [f32; 2],
    pub ray: Ray,
    pub medium_stack: MediumStack,
    pub wavelengths: &'a SampledWavelengths,
    pub sampler: &'a Sampler,
    pub settings: &'a PathSettings,
    /// Vertices so far.
    pub vertex: u32,
    /// Scattering events so far, those within bodies ([`Medium::is_subsurface`]) not counted.
    pub depth: u32,
    /// Number of the segment of the path.
    pub segment_index: u32,
    /// Whether a flash is burning.
    pub flash: bool,
    /// Where it begins, if lights were sought about directions from there.
    pub start: Option<SegmentStart>,
}

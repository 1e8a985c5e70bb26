//! What families of scattering functions give.

use diopter_light::SampledSpectrum;
use glam::Vec3;

/// Which lobes a scattering function has beside specular ones, by a width that tells broad ones from narrow ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Breadth {
    pub broad: bool,
    pub narrow: bool,
}

/// What families give in the local frame (z on the side of `wo`).
pub(super) struct LocalScatter {
    pub wi: Vec3,
    pub weight: SampledSpectrum,
    pub pdf: f32,
    pub specular: bool,
    pub disperses: bool,
}

//! No curve: the light of the scene as it is, up to the brightest that the display can show.

use super::{Asked, Rendering};
use glam::Vec3;

/// Light as it is, up to the peak of the display. Colours outside Rec.709 stay: another space may hold them.
pub struct Clipped(f32);

impl Rendering for Clipped {
    const KNOWS_PEAK: bool = true;

    fn new(asked: &Asked) -> Self {
        Clipped(asked.peak)
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        scene.min(Vec3::splat(self.0))
    }
}

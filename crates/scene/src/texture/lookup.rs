//! Where a texture is asked for.

use super::levels::Footprint;
use glam::{Vec2, Vec3};

/// Where a texture is looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lookup {
    /// Two sets of texture coordinates.
    pub uv: [Vec2; 2],
    /// Place in the world, m.
    pub point: Vec3,
    /// Geometric unit normal there.
    pub normal: Vec3,
    /// What is seen of the surface at once, if that is more than the point.
    pub footprint: Option<Footprint>,
}

impl Lookup {
    /// The same of the point alone.
    pub(super) fn point_alone(&self) -> Lookup {
        Lookup { footprint: None, ..*self }
    }

    /// By texture coordinates alone: of what [`Graph::is_in_space`](crate::texture::Graph::is_in_space) the value says nothing.
    pub fn uv(uv: &[Vec2; 2]) -> Self {
        Lookup { uv: *uv, point: Vec3::ZERO, normal: Vec3::ZERO, footprint: None }
    }
}

//! The normal of a clear coat, where it is not that of what lies below it: varnish is smooth over wood, and has ripples of its own over flakes.

use super::inputs::inputs_enum;
use crate::exact::exact_enum;
use crate::shape::Surface;
use crate::texture::Texture;
use glam::Vec3;

/// Where a clear coat has its normals from. Source: KHR_materials_clearcoat.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum CoatNormal {
    /// The surface itself, without the picture of normals or the bumps of what is below.
    Surface,
    /// A picture of its own, and the factor on its slopes.
    Picture {
        /// Red and green: slopes; blue: along the normal.
        texture: Texture,
        /// Multiplies the slopes.
        scale: f32,
    },
}

exact_enum!(CoatNormal { Surface, Picture { texture, scale } });
inputs_enum!(CoatNormal { Surface, Picture { texture, scale } });

impl CoatNormal {
    /// The outer normal at a point, of length 1.
    pub(super) fn at(&self, surface: &Surface) -> Vec3 {
        match self {
            CoatNormal::Surface => surface.ns,
            CoatNormal::Picture { texture, scale } => pictured(surface, texture, *scale),
        }
    }
}

/// The outer normal that a picture of normals gives a point; that of the surface where it has no tangent.
pub(super) fn pictured(surface: &Surface, texture: &Texture, scale: f32) -> Vec3 {
    let tangent = surface.tangent - surface.ns * surface.tangent.dot(surface.ns);
    if tangent.length_squared() == 0.0 {
        return surface.ns;
    }
    let tangent = tangent.normalize();
    let bitangent = surface.ns.cross(tangent) * surface.handedness;
    let n = texture.at(&surface.uv).truncate() * 2.0 - 1.0;
    let n = tangent * (n.x * scale) + bitangent * (n.y * scale) + surface.ns * n.z;
    n.try_normalize().unwrap_or(surface.ns)
}

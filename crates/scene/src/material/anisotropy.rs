//! Surfaces whose facets are wider one way than the other: brushed metal, hair-fine grooves.

use super::inputs::inputs_enum;
use super::microfacet::Ggx;
use crate::exact::exact_enum;
use crate::shape::Surface;
use crate::texture::{Scalar, Texture};
use glam::{Vec2, Vec3};

/// How roughness differs along and across a direction of the surface.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Anisotropy {
    /// Roughness (√α) across the tangent; the material's own is that along it.
    Across(Scalar),
    /// glTF's anisotropy: highlights are stretched along a direction. Source: KHR_materials_anisotropy.
    Brushed {
        /// 0 even, 1 as rough as can be along the direction.
        strength: f32,
        /// The direction, rad from the tangent towards the bitangent.
        rotation: f32,
        /// Red and green: another direction to turn by the rotation; blue: factor on the strength.
        texture: Option<Texture>,
    },
}

exact_enum!(Anisotropy { Across(roughness), Brushed { strength, rotation, texture } });
inputs_enum!(Anisotropy { Across(roughness), Brushed { strength, rotation, texture } });

/// The surface's tangent, made unit and perpendicular to the normal `ns`; `None` where it has none.
pub(super) fn tangent(surface: &Surface, ns: Vec3) -> Option<Vec3> {
    (surface.tangent - ns * ns.dot(surface.tangent)).try_normalize()
}

impl Anisotropy {
    /// Widths along and across the direction, of a roughness along the tangent.
    pub(super) fn facets(&self, roughness: f32, surface: &Surface) -> Ggx {
        let alpha = roughness * roughness;
        match self {
            Anisotropy::Across(across) => Ggx::new(alpha, across.at(surface).clamp(0.0, 1.0).powi(2)),
            Anisotropy::Brushed { strength, texture, .. } => {
                let strength = (strength * texture.as_ref().map_or(1.0, |t| t.at(&surface.uv).z)).clamp(0.0, 1.0);
                Ggx::new(alpha + (1.0 - alpha) * strength * strength, alpha)
            }
        }
    }

    /// The direction in the world; `ns` is the outer shading normal.
    pub(super) fn direction(&self, surface: &Surface, ns: Vec3) -> Option<Vec3> {
        let tangent = tangent(surface, ns)?;
        let Anisotropy::Brushed { rotation, texture, .. } = self else { return Some(tangent) };
        let bitangent = ns.cross(tangent) * surface.handedness;
        let own = texture.as_ref().and_then(|t| (t.at(&surface.uv).truncate().truncate() * 2.0 - 1.0).try_normalize());
        let turned = Vec2::from_angle(*rotation).rotate(own.unwrap_or(Vec2::X));
        Some(tangent * turned.x + bitangent * turned.y)
    }
}

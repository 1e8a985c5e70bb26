//! Which surfaces paths from lamps and from the camera are connected at.

use crate::material::{Material, Principled, Scattering};
use crate::shape::Surface;

/// Whether light paths may be scattered by a surface, and connected with.
#[inline]
pub(crate) fn can_connect(surface: &Surface, material: &Material, around: Option<&Principled>) -> bool {
    let of_kind = match &material.scattering {
        Scattering::Diffuse(_)
        | Scattering::Conductor(_)
        | Scattering::Coated(_)
        | Scattering::DiffuseTransmission(_)
        | Scattering::Measured(_) => true,
        Scattering::Principled(p) => p.dispersion.is_none() && around.is_none_or(|a| a.dispersion.is_none()),
        Scattering::Black | Scattering::Interface | Scattering::Hair(_) | Scattering::Mix(_) => false,
    };
    of_kind && !surface.is_strand()
}

//! Which inputs of materials are pictures, and how those are filtered.

use super::inputs::{Input, Inputs};
use super::{Coverage, EmissionColor, Material};
use crate::texture::{Color, Texture};

/// How the pictures of a material are filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Filtering {
    /// The set of texture coordinates that footprints are computed in.
    pub uv_set: usize,
    /// Pixels of the finest picture per unit of texture coordinates.
    pub texels: f32,
}

impl Material {
    /// How its pictures of colours are filtered, and makes the levels they are filtered by; `None` where none is.
    ///
    /// What light is multiplied by is filtered, since the mean of light is then that of the picture. Numbers, normals and heights are not: a mean
    /// roughness or normal reflects otherwise than what it is the mean of. Nor are pictures on surfaces with holes, where what is not there must
    /// not count, and with bumps.
    pub(crate) fn filter_pictures(&self) -> Option<Filtering> {
        if self.bump.is_some() || !matches!(self.coverage, Coverage::Full) {
            return None;
        }
        let mut filtering: Option<Filtering> = None;
        let mut add = |texture: &Texture, factor: f32| {
            texture.make_levels();
            let own = Filtering { uv_set: texture.uv_set, texels: factor / texture.texel_size() };
            // Pictures on another set than the first are looked up at points.
            let known = filtering.get_or_insert(own);
            known.texels = known.texels.max(own.texels);
        };
        self.each_input(&mut |input| match input {
            Input::Color(Color::Textured { texture, .. }) => add(texture, 1.0),
            Input::Color(Color::Graph(graph)) => graph.each_texture(&mut add),
            _ => {}
        });
        if let Some(EmissionColor::Textured { texture, .. }) = self.emission.as_ref().map(|e| &e.radiance) {
            add(texture, 1.0);
        }
        filtering
    }

    /// Whether something of it differs from place to place, or with the direction of the texture coordinates.
    pub(crate) fn needs_coordinates(&self) -> bool {
        let mut any = false;
        self.each_input(&mut |input| any |= input.is_picture());
        any || self.scattering.is_anisotropic()
    }
}

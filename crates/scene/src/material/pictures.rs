//! The inputs of materials, one after the other: which of them are pictures.

use super::{Anisotropy, CoatedConductor, Conductor, Coverage, EmissionColor, Hair, Material, Pigment, Principled, Scattering};
use crate::texture::{Color, Graph, Scalar, Texture};

/// An input of a material.
pub(crate) enum Input<'a> {
    /// A colour that light is multiplied by.
    Color(&'a Color),
    /// A picture made of others that stands for such a colour.
    Colors(&'a Graph),
    /// A number that the shape of a lobe, an amount or the presence of a surface depends on.
    Scalar(&'a Scalar),
    /// Normals, directions, or light that is sent out.
    Other,
}

impl Input<'_> {
    /// Whether it differs from place to place.
    fn is_picture(&self) -> bool {
        match self {
            Input::Color(Color::Textured { .. } | Color::Graph(_)) | Input::Other => true,
            Input::Scalar(scalar) => !matches!(scalar, Scalar::Constant(_)),
            Input::Colors(graph) => graph.constant().is_none(),
            Input::Color(_) => false,
        }
    }
}

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

    /// Whether something of it differs from place to place.
    pub(crate) fn has_pictures(&self) -> bool {
        let mut any = false;
        self.each_input(&mut |input| any |= input.is_picture());
        any
    }

    /// Tells all its inputs.
    pub(crate) fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        of(&self.scattering, tell);
        if let Some(EmissionColor::Textured { .. }) = self.emission.as_ref().map(|e| &e.radiance) {
            tell(Input::Other);
        }
        if self.normal_map.is_some() {
            tell(Input::Other);
        }
        if let Some(bump) = &self.bump {
            tell(Input::Scalar(&bump.height));
        }
        match &self.coverage {
            Coverage::Full => {}
            Coverage::Mask { alpha, .. } | Coverage::Blend(alpha) => tell(Input::Scalar(alpha)),
        }
    }
}

fn of(scattering: &Scattering, tell: &mut dyn FnMut(Input)) {
    match scattering {
        Scattering::Black | Scattering::Interface => {}
        // One that is not the same all round lies along the texture coordinates.
        Scattering::Measured(measured) if !measured.is_isotropic() => tell(Input::Other),
        Scattering::Measured(_) => {}
        Scattering::Diffuse(color) => tell(Input::Color(color)),
        Scattering::Conductor(conductor) => of_conductor(conductor, tell),
        Scattering::Coated(coated) => {
            let CoatedConductor { metal, roughness, across, .. } = &**coated;
            of_conductor(metal, tell);
            tell(Input::Scalar(roughness));
            across.iter().for_each(|a| tell(Input::Scalar(a)));
        }
        Scattering::Principled(p) => of_principled(p, tell),
        Scattering::DiffuseTransmission(colors) => colors.iter().for_each(|c| tell(Input::Color(c))),
        Scattering::Hair(hair) => {
            let Hair { pigment, beta_m, beta_n, alpha, .. } = &**hair;
            [beta_m, beta_n, alpha].into_iter().for_each(|s| tell(Input::Scalar(s)));
            match pigment {
                Pigment::Absorption(_) => {}
                Pigment::AbsorptionMap(graph) => tell(Input::Colors(graph)),
                Pigment::Reflectance(color) => tell(Input::Color(color)),
                Pigment::Melanin { eumelanin, pheomelanin, .. } => {
                    [eumelanin, pheomelanin].into_iter().for_each(|s| tell(Input::Scalar(s)));
                }
            }
        }
        Scattering::Mix(mix) => {
            mix.0.iter().for_each(|part| of(part, tell));
            tell(Input::Scalar(&mix.1));
        }
    }
}

fn of_conductor(conductor: &Conductor, tell: &mut dyn FnMut(Input)) {
    tell(Input::Scalar(&conductor.alpha));
    conductor.across.iter().for_each(|a| tell(Input::Scalar(a)));
}

fn of_principled(p: &Principled, tell: &mut dyn FnMut(Input)) {
    [&p.base_color, &p.specular_color].into_iter().for_each(|c| tell(Input::Color(c)));
    let numbers = [&p.metallic, &p.roughness, &p.transmission, &p.clearcoat, &p.clearcoat_roughness, &p.specular];
    numbers.into_iter().for_each(|s| tell(Input::Scalar(s)));
    match p.anisotropy.as_deref() {
        Some(Anisotropy::Across(across)) => tell(Input::Scalar(across)),
        Some(Anisotropy::Brushed { texture: Some(_), .. }) => tell(Input::Other),
        _ => {}
    }
    if let Some(film) = &p.film {
        [&film.fraction, &film.thickness].into_iter().for_each(|s| tell(Input::Scalar(s)));
    }
    if let Some(sheen) = &p.sheen {
        tell(Input::Color(&sheen.color));
        tell(Input::Scalar(&sheen.roughness));
    }
}

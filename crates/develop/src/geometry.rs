//! Where a development puts what the camera saw: for calibrations, which are to describe the picture that is looked at.

use crate::recipe::Recipe;
use crate::steps::demosaic::Demosaicer;
use crate::steps::{lens, resize};
use diopter_image::{Cfa, LensProfile};

/// What a development does to the places of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Columns and rows of the developed picture.
    pub size: [usize; 2],
    /// Its pixels over those of the taken one, across and down, from the upper left corner of both.
    pub scale: [f64; 2],
    /// Where distortion is corrected: the focal length of the straight picture about its middle, over half the diagonal of the taken one, before it is scaled.
    pub straight: Option<f64>,
}

impl Geometry {
    /// Of a picture of so many columns and rows by a recipe. `profile`: what its lens does.
    pub fn of(cfa: &Cfa, size: [usize; 2], recipe: &Recipe, profile: Option<&LensProfile>) -> Geometry {
        let cell = Demosaicer::new(recipe.demosaic.method, cfa).cell(cfa);
        let pixels = [cell[0] / cfa.samples_per_pixel().max(1), cell[1]].map(|n| n.max(1));
        let demosaiced: [usize; 2] = std::array::from_fn(|k| (size[k] / pixels[k]).max(1));
        let developed = resize::target(demosaiced, &recipe.resize);
        Geometry {
            size: developed,
            scale: std::array::from_fn(|k| developed[k] as f64 / (demosaiced[k] * pixels[k]) as f64),
            straight: lens::straight_focal_length(profile, &recipe.lens),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Developer;
    use diopter_image::PictureSource;

    #[test]
    fn sizes_are_those_of_the_development() {
        for (pattern, settings) in [
            ("RG/GB", &[][..]),
            ("RG/GB", &[("resize.width", "17")]),
            ("RG/GB", &[("demosaic.method", "half"), ("resize.long_edge", "20")]),
            ("mono", &[("demosaic.method", "half")]),
        ] {
            let recipe = settings.iter().fold(Recipe::default(), |r, (name, value)| r.with(name, value).unwrap());
            let raw = crate::tests::raw(61, 40, pattern, |_, _| 500.0);
            let geometry = Geometry::of(&raw.header.cfa, [61, 40], &recipe, None);
            assert_eq!(geometry.size, Developer::new(&raw, &recipe, None).unwrap().size(), "{pattern} {settings:?}");
            let [across, down] = geometry.scale;
            // Half of 61 columns are 30: the last one is left out.
            let taken = if recipe.demosaic.method == crate::Demosaic::Half { 60.0 } else { 61.0 };
            assert!(
                (across - geometry.size[0] as f64 / taken).abs() < 1e-12 && (down - geometry.size[1] as f64 / 40.0).abs() < 1e-12
            );
        }
    }
}

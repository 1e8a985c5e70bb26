//! The settings of a light field: what is sharp, how large the pupil is, from where it is seen.

use crate::setting::section;

section! {
    /// What is made of the raw picture of a plenoptic camera; without any of these it is developed as it is, with the images behind all
    /// microlenses.
    LightField "light_field" {
        focus: String = String::new(), "", Text,
            "of a plenoptic camera's file, what is sharp: as-taken, a distance (1.2 m), inf, or all; unset, the images behind the microlenses are shown as they are";
        aperture: Option<f64> = None, "f-number", Number(0.1, 1000.0),
            "a smaller part of the pupil: more depth of field; unset, all of it. The picture stays as bright";
        view: Option<[f64; 2]> = None, "radii of the pupil", Numbers(2, -1.0, 1.0),
            "a view through one place of the pupil, to the right and down as seen from behind the camera, 1 its edge; instead of an aperture";
    }
}

impl LightField {
    /// Whether anything is to be made of it.
    pub fn wanted(&self) -> bool {
        *self != LightField::default()
    }
}

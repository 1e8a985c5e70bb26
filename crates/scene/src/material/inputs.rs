//! The inputs of materials: numbers and colours that may differ from place to place, normals, and light that is sent out.
//!
//! A type lists its fields beside its declaration, by [`inputs_struct`] or [`inputs_enum`]; one that it leaves out does not compile. What looks at all inputs
//! (`pictures.rs`) or changes them all (`scale.rs`) therefore knows none by name.

use crate::texture::{Color, Graph, Scalar, Texture};
use diopter_light::Spectrum;
use glam::Vec3;
use std::sync::Arc;

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
    pub(super) fn is_picture(&self) -> bool {
        match self {
            Input::Color(Color::Textured { .. } | Color::Graph(_)) | Input::Other => true,
            Input::Scalar(scalar) => !matches!(scalar, Scalar::Constant(_)),
            Input::Colors(graph) => graph.constant().is_none(),
            Input::Color(_) => false,
        }
    }
}

/// An input of a material, to be changed; those of [`Input::Other`] always lie along texture coordinates and are not told.
pub(crate) enum InputMut<'a> {
    Color(&'a mut Color),
    Colors(&'a mut Arc<Graph>),
    Scalar(&'a mut Scalar),
}

/// What may have inputs. By itself it has none.
pub(crate) trait Inputs {
    /// Tells all inputs, in the order of the fields.
    fn each_input(&self, _tell: &mut dyn FnMut(Input)) {}
    /// The same, to change them.
    fn each_input_mut(&mut self, _change: &mut dyn FnMut(InputMut)) {}
}

/// Inputs of a structure: `Type { fields that may have some } without { fields that have none }`.
macro_rules! inputs_struct {
    ($type:ty { $($field:ident),+ $(,)? } $( without { $($other:ident),+ $(,)? } )?) => {
        impl crate::material::inputs::Inputs for $type {
            fn each_input(&self, tell: &mut dyn FnMut(crate::material::inputs::Input)) {
                let Self { $($field,)+ $( $($other: _,)+ )? } = self;
                $( crate::material::inputs::Inputs::each_input($field, tell); )+
            }

            fn each_input_mut(&mut self, change: &mut dyn FnMut(crate::material::inputs::InputMut)) {
                let Self { $($field,)+ $( $($other: _,)+ )? } = self;
                $( crate::material::inputs::Inputs::each_input_mut($field, change); )+
            }
        }
    };
}

/// Inputs of an enumeration: `Variant`, `Variant(a, b)` or `Variant { field }`.
macro_rules! inputs_enum {
    ($type:ty { $( $variant:ident $( ( $($part:ident),+ ) )? $( { $($field:ident),+ } )? ),+ $(,)? }) => {
        impl crate::material::inputs::Inputs for $type {
            fn each_input(&self, tell: &mut dyn FnMut(crate::material::inputs::Input)) {
                match self {
                    $( Self::$variant $( ( $($part),+ ) )? $( { $($field),+ } )? => {
                        $( $( crate::material::inputs::Inputs::each_input($part, tell); )+ )?
                        $( $( crate::material::inputs::Inputs::each_input($field, tell); )+ )?
                    } )+
                }
            }

            fn each_input_mut(&mut self, change: &mut dyn FnMut(crate::material::inputs::InputMut)) {
                match self {
                    $( Self::$variant $( ( $($part),+ ) )? $( { $($field),+ } )? => {
                        $( $( crate::material::inputs::Inputs::each_input_mut($part, change); )+ )?
                        $( $( crate::material::inputs::Inputs::each_input_mut($field, change); )+ )?
                    } )+
                }
            }
        }
    };
}

pub(crate) use {inputs_enum, inputs_struct};

impl Inputs for Color {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        tell(Input::Color(self));
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        change(InputMut::Color(self));
    }
}

impl Inputs for Arc<Graph> {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        tell(Input::Colors(self));
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        change(InputMut::Colors(self));
    }
}

impl Inputs for Scalar {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        tell(Input::Scalar(self));
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        change(InputMut::Scalar(self));
    }
}

/// One that is no colour's and no number's.
impl Inputs for Texture {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        tell(Input::Other);
    }
}

impl Inputs for bool {}
impl Inputs for f32 {}
impl Inputs for Vec3 {}
impl Inputs for Spectrum {}

impl<T: Inputs> Inputs for Option<T> {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        self.iter().for_each(|of| of.each_input(tell));
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        self.iter_mut().for_each(|of| of.each_input_mut(change));
    }
}

impl<T: Inputs> Inputs for Box<T> {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        (**self).each_input(tell);
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        (**self).each_input_mut(change);
    }
}

impl<T: Inputs, const N: usize> Inputs for [T; N] {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        self.iter().for_each(|of| of.each_input(tell));
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        self.iter_mut().for_each(|of| of.each_input_mut(change));
    }
}

impl<A: Inputs, B: Inputs> Inputs for (A, B) {
    fn each_input(&self, tell: &mut dyn FnMut(Input)) {
        self.0.each_input(tell);
        self.1.each_input(tell);
    }

    fn each_input_mut(&mut self, change: &mut dyn FnMut(InputMut)) {
        self.0.each_input_mut(change);
        self.1.each_input_mut(change);
    }
}

//! Veiling glare: light that surfaces scatter, that barrel, edges and blades throw back, and that bounces between sensor and glass.
//!
//! [`Finish`] is what a surface is like (roughness, dust); [`GlareTracer`] follows light through the lens wherever it goes, the walls between the
//! glasses included; [`GlareSpread`] is what becomes of a point of the image (the glare spread function by field); [`veiling_glare`] the index of
//! ISO 9358's integral method.
//!
//! Directions of light: as everywhere, to the film along +z; [`veiling_glare`] goes back from the film, which the same paths allow (light takes them
//! both ways). Limits: lenses that look the same from all sides of their axis, without mirrors, gradients and ideal surfaces
//! ([`GlareTracer::new`] says so); walls are grey and perfectly rough, and join the rims of neighbouring surfaces; no polarisation; bubbles and
//! fluorescence of glass, and the grating of microlenses, are left out.
//! Sources: Harvey & Shack, in Stover, *Optical Scattering* (3rd ed.) ch. 4; Fest, *Stray Light Analysis and Control* (SPIE 2013).

mod finish;
mod index;
mod random;
mod spread;
mod tracer;

pub use finish::{Finish, Lobe};
pub use index::{VeilingGlare, veiling_glare};
pub use spread::{BINS_NM, FieldGlare, GlareSpread, Scattered};
pub use tracer::{Balance, GlareTracer, Kind, Unfit};

#[cfg(test)]
mod tests;

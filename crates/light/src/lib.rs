//! The ground of diopter: what light is made of here, and nothing about cameras or scenes.
//!
//! Units: wavelengths in nm, lengths of rays in metres, spectral radiance in W·m⁻²·sr⁻¹·nm⁻¹, time in seconds.
//! A path carries four wavelengths ([`SampledWavelengths`]); every spectral quantity on it is a [`SampledSpectrum`] of four values.
//! Out of scope: fluorescence, colour appearance models.
//!
//! To be read in this order: [`table`], [`cie`], [`wavelength`], [`upsample`], [`color`], [`spectrum`]; each knows only those before it. Beside them stand [`units`], [`ray`], [`names`], [`sampling`], [`lattice`] and [`instruction_set`], which know of no colour, [`random`] (the numbers of a sample) and [`polarization`]
//! (Stokes vectors and Mueller matrices). Begin with [`SampledWavelengths`] and [`Spectrum`].

pub mod cie;
pub mod color;
pub mod instruction_set;
pub mod lattice;
pub mod names;
pub mod polarization;
pub mod random;
pub mod ray;
pub mod sampling;
pub mod spectrum;
pub mod table;
pub mod units;
pub mod upsample;
#[expect(dead_code, reason = "the table is made in the build script; here only its constants and tests are used")]
mod upsample_fit;
pub mod wavelength;

pub use ray::Ray;
pub use spectrum::Spectrum;
pub use wavelength::{SampledSpectrum, SampledWavelengths, WavelengthSampler};

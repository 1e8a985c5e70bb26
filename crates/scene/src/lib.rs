//! Scenes: surfaces, materials and lights, and how much light arrives along a ray.
//!
//! A [`Description`] (from a file, [`load`], or made by code, [`builtin`]) becomes a [`Scene`], which is only read from then
//! on. Begin with [`Scene::trace`]: camera rays in, radiance out. World space is right-handed, metres, +Y up; light is absolute:
//! W·m⁻²·sr⁻¹·nm⁻¹.
//!
//! Not here: lenses, films and pixels (what a scene file says of its camera is handed on as it is); files on disk, which the caller of [`load`] opens.

mod animated;
pub mod builtin;
pub mod bvh;
pub mod classes;
pub mod daylight;
mod exact;
mod features;
pub mod light;
pub mod light_paths;
pub mod load;
pub mod material;
mod material_extensions;
pub mod medium;
mod medium_stack;
pub mod motion;
pub mod noise;
mod other_exposure;
pub mod radiance;
mod russian_roulette;
pub mod save;
mod scale;
pub mod scene;
pub mod shape;
pub mod studio;
pub mod subdivision;
pub mod texture;

pub use medium_stack::Immersion;
pub use other_exposure::OtherExposure;
pub use radiance::{FirstSurface, PathSettings};
pub use russian_roulette::RouletteRates;
pub use scene::{Description, Object, Scene, Shape};

/// Why a scene cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A number that refers to nothing.
    #[error("object \"{of}\": {what} {found} is not there; the scene has {count}")]
    Number {
        /// Kind of thing.
        what: &'static str,
        /// Who refers to it.
        of: String,
        /// The number found.
        found: usize,
        /// How many there are.
        count: usize,
    },
    /// More than the hierarchy can number.
    #[error("a mesh of {0} triangles brings the scene above 1 073 741 823: split it, or use instances")]
    TooLarge(usize),
    /// Nothing to photograph.
    #[error("the scene is empty: {0}")]
    Empty(String),
    /// A file that is not what its format says.
    #[error("{place}: {found}; {expected}")]
    File {
        /// File, and where in it.
        place: String,
        /// What is wrong.
        found: String,
        /// What was expected, or a hint.
        expected: String,
    },
}

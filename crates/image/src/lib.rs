//! The hand-overs between the stages of diopter, and their files.
//!
//! [`FocalPlane`] (mean electrons per pixel and band, with error and truth) → [`RawImage`] (digital numbers behind a
//! colour filter array) → [`Picture`] (RGB in a named space). All rasters are stored row by row from the top left of the
//! picture as a viewer sees it: `[row][column][channel]`. Readers and writers work on streams, never on paths.
//!
//! Not here: what is computed of a picture (`diopter-sensor` reads out, `diopter-develop` develops), formats of textures (`diopter-scene`). Begin with [`FocalPlane`] and
//! [`exr`]; truth channels are the table in [`channels`].

pub mod cfa;
pub mod channels;
pub mod cryptomatte;
pub mod dng;
pub mod encoding;
pub mod exif;
pub mod exr;
pub mod focal_plane;
pub mod gain_map;
pub mod icc;
pub mod jpeg;
pub mod metadata;
pub mod picture;
pub mod png;
pub mod raster;
pub mod raw;
mod streams;
mod tags;
pub mod tiff_file;
pub mod truth;

pub use encoding::Encoding;
pub use focal_plane::FocalPlane;
pub use metadata::{ExposureFacts, LensProfile, LightFieldFacts, MergedFacts, PupilShapes, RowTimes, ShutterFacts};
pub use picture::{Picture, PictureSource};
pub use raster::Raster;
pub use raw::{Cfa, RawHeader, RawImage};
pub use truth::Truth;

/// What can go wrong between pixels and bytes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The bytes are not what the format says.
    #[error("not a readable {format} file: {reason}")]
    Malformed {
        /// Name of the file format.
        format: &'static str,
        /// What the decoder found.
        reason: String,
    },
    /// The file is fine but lacks what is asked of it.
    #[error("{what} is missing in the file; {hint}")]
    Missing {
        /// The channel or attribute.
        what: String,
        /// What the user can do.
        hint: String,
    },
    /// Parts that do not belong together.
    #[error("these exposures cannot be merged: {0}")]
    Mismatch(String),
    /// The picture is too small or large for the format.
    #[error("{format} cannot hold {width} × {height} pixels; it holds 1 to {limit} a side")]
    Size {
        /// Name of the file format.
        format: &'static str,
        /// Pixels a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Most pixels a side.
        limit: usize,
    },
    /// Writing failed.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

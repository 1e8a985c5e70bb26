//! The camera that measures itself: the figures of a laboratory, from pictures alone.
//!
//! One file a measurement. Each takes a [`Plane`] (linear values of one channel at the places where it was sampled, raw mosaics included) or
//! raw images, and knows nothing of how the picture was made: pictures of other cameras are measured just so.

pub mod color;
pub mod corners;
pub mod developed;
pub mod distortion;
mod fit;
pub mod glare;
pub mod motion;
pub mod mtf;
pub mod noise;
pub mod oecf;
pub mod plane;
pub mod predict;
pub mod rolling;
pub mod vignetting;

pub use mtf::EdgeMtf;
pub use plane::{Channel, Measured, Plane, Region};

/// Why a picture cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// A file that cannot be read.
    #[error("{path}: {reason}")]
    Read {
        /// The file.
        path: String,
        /// What its reader says.
        reason: String,
    },
    /// The picture does not show what is to be measured.
    #[error("{place}: {found}; expected {expected}")]
    Unfit {
        /// Which part of the picture, or which setting.
        place: String,
        /// What is there.
        found: String,
        /// What is needed, and what helps.
        expected: String,
    },
}

impl MeasureError {
    /// The picture does not show what is to be measured.
    fn unfit(place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        MeasureError::Unfit { place: place.into(), found: found.into(), expected: expected.into() }
    }
}

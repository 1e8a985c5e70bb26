//! Sensors: from mean electrons to digital numbers, by the data sheet of a body.
//!
//! A [`Sensor`] is a data sheet (embedded, or a TOML file of the same form); [`Sensor::band_responses`] is what the exposure
//! integrates with; [`read_out()`] adds what a sensor adds; [`emva`] measures it back. Symbols and order follow EMVA 1288.
//! Units: e⁻, DN, µm, mm, s, °C.
//!
//! Not here: what light arrives (the focal plane brings mean electrons), files of raw images (`diopter-image`), colours (`diopter-develop`). Begin with [`Sensor::named`] and
//! [`read_out()`].

pub use diopter_light::names::nearest;

pub mod calibration;
mod data;
pub mod emva;
pub mod events;
pub mod format;
pub mod noise;
mod pattern;
pub mod read_out;
mod sensor;
mod sheet;

pub use read_out::{AskedReading, ColorSampling, ReadOut, Reading, Window, read_out};
pub use sensor::{BodyLens, DarkCurrent, HotPixels, IsoStep, Plenoptic, SecondReading, Sensor, TwoStage, saturation_capacity};

/// What can be wrong with a sensor or what is asked of it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// A name nobody knows.
    #[error("unknown {what} \"{found}\"{hint}")]
    Unknown {
        /// Kind of thing.
        what: &'static str,
        /// The name.
        found: String,
        /// "; did you mean ...?" or a list.
        hint: String,
    },
    /// A data sheet that does not parse.
    #[error("{place}: {reason}")]
    Parse {
        /// File.
        place: String,
        /// What the parser says, with line and hint.
        reason: String,
    },
    /// A number outside its range.
    #[error("{what} {found}: expected {expected}")]
    Range {
        /// Name of the quantity.
        what: String,
        /// The value.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// Whoever was handed a measurement's pictures failed.
    #[error("{0}")]
    Kept(String),
    /// An exposure this sensor cannot read out.
    #[error("the focal plane has bands {found}; {expected}")]
    Bands {
        /// Names of its bands.
        found: String,
        /// What is needed.
        expected: String,
    },
}

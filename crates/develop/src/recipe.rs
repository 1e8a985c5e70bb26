//! The settings of a development.

use serde::{Deserialize, Serialize};

/// What is done to a raw image. Every field has a default; the defaults make a picture fit to be looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recipe {
    /// How missing colours are filled in.
    pub demosaic: Demosaic,
    /// Brightening in stops (EV), −10 to 10; default 0.
    pub exposure_ev: f32,
    /// Tone curve.
    pub tone: Tone,
}

impl Default for Recipe {
    fn default() -> Self {
        Recipe { demosaic: Demosaic::MalvarHeCutler, exposure_ev: 0.0, tone: Tone::Aces }
    }
}

/// How missing colours are filled in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Demosaic {
    /// The mean of the nearest neighbours of a colour.
    Bilinear,
    /// 5 × 5 linear filters with correction by the gradient of the known colour.
    MalvarHeCutler,
}

/// Tone curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tone {
    /// Clipped at white.
    Linear,
    /// Reinhard et al. 2002, extended, on luminance.
    Reinhard,
    /// A fit of the ACES 1.x reference rendering for sRGB displays.
    Aces,
}

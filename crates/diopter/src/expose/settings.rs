//! How an exposure is computed.

use super::diffraction::Diffraction;
use super::fireflies::Fireflies;
use super::frames::Frames;
use crate::polarizer::Polarizer;
use crate::shutter::ShutterTimes;
use crate::stray::choice::Stray;
use diopter_image::channels::{Channel, DIRECT, INDIRECT};
use diopter_light::random::SamplerKind;
use diopter_scene::PathSettings;
use std::ops::Range;
use std::sync::Arc;

/// How an exposure is computed.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Samples a pixel when all are rendered.
    pub spp: u32,
    /// Which of them to render; beyond `spp` nothing is.
    pub samples: Range<u32>,
    /// How they are spread.
    pub sampler: SamplerKind,
    /// Seed.
    pub seed: u64,
    /// How far paths go.
    pub path: PathSettings,
    /// How light transport is computed.
    pub integrator: Integrator,
    /// Only means over many pixels are wanted: light is not reused, which makes them no less noisy, and `auto` does not ask whether connections pay.
    pub means_only: bool,
    /// Factor on all light of the scene.
    pub light_scale: f64,
    /// Stop after about so much time, s, the truth included; the samples that are done then (two at least) make the picture.
    pub time_limit_s: Option<f64>,
    /// Record depth, normals, albedo and ids.
    pub truth: bool,
    /// Truth channels that are recorded with them.
    pub truth_channels: Vec<&'static Channel>,
    /// The frames that motion and flow are measured to; without, these channels stay empty.
    pub frames: Option<Arc<Frames>>,
    /// When samples are taken.
    pub shutter_times: ShutterTimes,
    /// Only light through one half of the pupil counts, as in one half of a split pixel.
    pub half: Option<Half>,
    /// Paths carry red, green and blue instead of wavelengths, as those of RGB renderers: to compare with them. Only for
    /// [`Response::linear_srgb`](super::Response::linear_srgb).
    pub rgb: bool,
    /// Samples that the lens blocks (or that go through the other half) are drawn again: vignetting is not shown, nor is its noise. For
    /// probes that look for detail.
    pub redraw: bool,
    /// What becomes of outliers when the samples end. Only an exposure in electrons of all `spp` samples at once re-weights them; parts keep them.
    pub fireflies: Fireflies,
    /// Whether the aperture diffracts light.
    pub diffraction: Diffraction,
    /// Stray light that a shot adds to the mean ([`Exposure::stray_light`](super::Exposure::stray_light)); [`expose()`](super::expose()) itself adds none.
    pub stray: Stray,
    /// Light is followed with its polarisation, along paths from the camera alone whatever the integrator is; a polariser and sensors that tell polarisation ask for
    /// it, too.
    pub polarized: bool,
    /// A polarising filter before the lens.
    pub polarizer: Option<Polarizer>,
}

impl Settings {
    /// `spp` Sobol samples, seed 1, the integrator chosen by the scene, no limits.
    pub fn new(spp: u32) -> Self {
        Settings {
            spp,
            samples: 0..spp,
            sampler: SamplerKind::Sobol,
            seed: 1,
            path: PathSettings::default(),
            integrator: Integrator::default(),
            means_only: false,
            light_scale: 1.0,
            time_limit_s: None,
            truth: true,
            truth_channels: Vec::new(),
            frames: None,
            shutter_times: ShutterTimes::default(),
            half: None,
            rgb: false,
            redraw: false,
            fireflies: Fireflies::Keep,
            diffraction: Diffraction::Off,
            stray: Stray::NONE,
            polarized: false,
            polarizer: None,
        }
    }

    /// Whether direct light is summed apart.
    pub fn records_direct(&self) -> bool {
        self.truth && self.truth_channels.iter().any(|c| *c == DIRECT || *c == INDIRECT)
    }

    /// Whether light is followed with its polarisation, whatever the film is.
    pub fn is_polarized(&self) -> bool {
        self.polarized || self.polarizer.is_some()
    }

    /// Whether all samples are rendered, not a part of them.
    pub fn is_whole(&self) -> bool {
        self.samples.start == 0 && self.samples.end >= self.spp
    }
}

/// How light transport is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Integrator {
    /// Paths from the camera only.
    Path,
    /// The same; light that the paths of one pixel found is reused by others, so that indirect light is far less noisy and errors of pixels that are some apart are alike. Alone where that is
    /// not to be had: where something moves or flickers, in fog, with Gaussian splats and surfaces with soft holes, and where light is polarised.
    PathReuse,
    /// And photons for the caustics of all lamps that are not the environment, and light traced from small lamps out of focus.
    Caustics,
    /// And connections of camera paths with light paths from the lamps (bidirectional path tracing); photons where `auto` would make them.
    Bidirectional,
    /// Photons for the caustics of small lamps where smooth bodies of glass or metal throw them, light traced from small lamps out of focus, connections where
    /// they take away far more noise than they cost; paths from the camera elsewhere, whose light is reused by other pixels where that takes noise away.
    #[default]
    Auto,
}

impl Integrator {
    /// Their names.
    pub const NAMES: [(&'static str, Integrator); 5] = [
        ("path", Integrator::Path),
        ("path-reuse", Integrator::PathReuse),
        ("caustics", Integrator::Caustics),
        ("bidirectional", Integrator::Bidirectional),
        ("auto", Integrator::Auto),
    ];

    /// The setting of a name; `None` of an unknown one.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }
}

/// A half of the pupil, as seen from behind the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Left of the middle.
    Left,
    /// Right of it.
    Right,
}

impl Half {
    /// Whether a place of the pupil (right is positive) lies in it.
    #[inline]
    pub(super) fn holds(self, x: f64) -> bool {
        (x >= 0.0) == (self == Half::Right)
    }
}

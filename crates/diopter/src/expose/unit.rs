//! What all tiles of an exposure share.

use super::diffraction::Optics;
use super::fireflies::Cascade;
use super::pixel_cone::PixelCones;
use super::pixel_groups::PixelGroups;
use super::response::{Curves, Response};
use super::settings::Settings;
use super::{TILE, summed_bands};
use crate::camera::Camera;
use crate::shutter::{Place, Shutter};
use diopter_image::focal_plane::BandUnit;
use diopter_lens::microlens::MicrolensOptics;
use diopter_light::wavelength::WavelengthSampler;
use diopter_scene::{Immersion, RouletteRates, Scene};

/// What all tiles share.
pub(super) struct Unit<'a> {
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    pub shutter: &'a Shutter,
    pub curves: &'a Curves,
    pub response: &'a Response,
    pub wavelengths: &'a WavelengthSampler,
    pub settings: &'a Settings,
    /// The microlens array, if there is one.
    pub behind: Option<MicrolensOptics>,
    /// Where fireflies are re-weighted.
    pub cascade: Option<Cascade>,
    /// Whether light is traced from lamps, too.
    pub light_traced: bool,
    /// Groups of pixels, where these lend one another light.
    pub groups: Option<PixelGroups>,
    /// How many paths are worth following on, where some are not; they go alone.
    pub roulette: Option<RouletteRates>,
    /// Diffraction, if there is any.
    pub optics: Option<&'a Optics>,
    /// Whether pixels have sums for what lamps send far out.
    pub starbursts: bool,
    /// Where the sums of direct light begin, where it is recorded.
    pub direct: Option<usize>,
    /// What the camera stands in.
    pub immersion: Immersion,
    /// How wide pixels are in the scene, where pictures are filtered.
    pub cones: Option<PixelCones>,
    /// Whether light is followed with its polarisation.
    pub polarized: bool,
    /// What Q and U count in each group of bands, where any tells them.
    pub analyzers: Vec<[glam::Vec4; 2]>,
}

impl Unit<'_> {
    /// Column, row, width and height of a tile.
    pub(super) fn rectangle(&self, index: usize) -> [usize; 4] {
        let film = &self.camera.film;
        let across = film.columns.div_ceil(TILE);
        let (column, row) = (index % across * TILE, index / across * TILE);
        [column, row, TILE.min(film.columns - column), TILE.min(film.rows - row)]
    }

    /// When a pixel is open to light through a place of the pupil.
    #[inline]
    pub(super) fn window(&self, column: usize, row: usize, pupil: f64) -> (f64, f64) {
        let film = &self.camera.film;
        self.shutter.window(&Place { pixel: [column, row], size: [film.columns, film.rows], pupil })
    }

    /// Whether the shutter asks where in the pupil light passes.
    #[inline]
    pub(super) fn needs_pupil(&self) -> bool {
        matches!(self.shutter.mechanism, crate::shutter::Mechanism::Leaf { .. })
    }

    /// Bands that are summed: those of the film, of each buffer of the cascade, of starbursts, and of direct light.
    pub(super) fn summed_bands(&self) -> usize {
        summed_bands(self.curves_len(), self.cascade.is_some(), self.starbursts, self.direct.is_some())
    }

    /// Whether the film records radiance.
    pub(super) fn in_radiance(&self) -> bool {
        self.response.bands[0].unit == BandUnit::Radiance
    }

    pub(super) fn curves_len(&self) -> usize {
        self.response.curves.len()
    }
}

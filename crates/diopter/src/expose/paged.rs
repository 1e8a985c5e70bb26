//! Exposures that memory cannot hold, handed out row by row.

use super::Settings;
use super::sums::{Sums, means, write_direct_truth};
use super::truth::Recorder;
use crate::camera::Camera;
use crate::row_store::{PagedRows, RowStore};
use crate::shutter::Shutter;
use crate::stray::Seen;
use diopter_develop::denoise::farthest_log_depth_of;
use diopter_image::focal_plane::{Band, FocalPlaneSource, Truth, ends_early};
use diopter_image::truth::Recorded;
use diopter_image::{ExposureFacts, FocalPlane, ImageError, Raster};
use diopter_scene::Scene;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

/// What became of an exposure that memory cannot hold.
#[derive(Debug)]
pub struct ExposedPaged {
    /// Its facts.
    pub facts: ExposureFacts,
    /// Whether it was stopped before the last sample that was asked for.
    pub stopped: bool,
    pub(super) camera: Camera,
    pub(super) shutter: Shutter,
    pub(super) settings: Settings,
    pub(super) recorded: Recorded,
    pub(super) bands: Vec<Band>,
    pub(super) sums: Sums<PagedRows>,
}

impl ExposedPaged {
    /// Gathers the mean for stray light, row by row; what cannot be read is left dark, and fails when the rows are asked for.
    pub fn gather(&mut self, seen: &mut Seen) {
        let (width, bands) = (self.camera.film.columns, self.bands.len());
        let (mut mean, mut half_difference) = (Raster::new(width, 1, bands), Raster::new(width, 1, bands));
        for row in 0..self.camera.film.rows {
            let Ok(numbers) = self.sums.sums.row(row) else { return };
            of_row(&self.sums.samples, numbers, width, 0..bands, [&mut mean.data, &mut half_difference.data]);
            seen.add_rows(&mean, row);
        }
    }

    /// The focal plane row by row: mean and half difference of the sums, with the truth of the rows in the scene that was exposed.
    pub fn rows(self, scene: &Scene) -> ExposedRows<'_> {
        ExposedRows { scene, exposed: self, next: 0 }
    }
}

/// An exposure that memory cannot hold, handed out row by row.
#[derive(Debug)]
pub struct ExposedRows<'a> {
    scene: &'a Scene,
    exposed: ExposedPaged,
    /// Rows that were taken.
    next: usize,
}

impl ExposedRows<'_> {
    /// Log of the largest finite depth, m, which denoising asks for; `None` if nothing is hit.
    pub fn farthest_log_depth(&self) -> Option<f32> {
        let (rows, step) = (self.exposed.camera.film.rows, self.rows_at_once());
        let strips = (0..rows).step_by(step).map(|first| self.truth_of(first..(first + step).min(rows)));
        strips.filter_map(|truth| farthest_log_depth_of(&truth.depth().data)).reduce(f32::max)
    }

    fn truth_of(&self, rows: Range<usize>) -> Truth {
        let ExposedPaged { camera, shutter, settings, recorded, .. } = &self.exposed;
        let missing = Truth::missing(recorded.clone(), camera.film.columns, rows.len());
        if !settings.truth {
            return missing;
        }
        // What was exposed is written whole, also when it was stopped.
        Recorder::new(self.scene, camera, shutter, settings).rows(rows, &AtomicBool::new(false)).unwrap_or(missing)
    }
}

/// Mean and half difference of some of the sums of a row.
fn of_row(samples: &Range<u32>, numbers: &[f64], width: usize, bands: Range<usize>, [mean, half]: [&mut [f32]; 2]) {
    let n = bands.len();
    let pixels = numbers.chunks_exact(numbers.len() / width);
    for ((sums, mean), half) in pixels.zip(mean.chunks_exact_mut(n)).zip(half.chunks_exact_mut(n)) {
        means(samples, &sums[2 * bands.start..2 * bands.end], mean, half);
    }
}

impl FocalPlaneSource for ExposedRows<'_> {
    fn bands(&self) -> &[Band] {
        &self.exposed.bands
    }

    fn facts(&self) -> &ExposureFacts {
        &self.exposed.facts
    }

    fn recorded(&self) -> &Recorded {
        &self.exposed.recorded
    }

    fn size(&self) -> [usize; 2] {
        [self.exposed.camera.film.columns, self.exposed.camera.film.rows]
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let ([width, height], bands) = (self.size(), self.exposed.bands.len());
        if rows > height - self.next {
            return Err(ends_early());
        }
        let range = self.next..self.next + rows;
        let (mut mean, mut half_difference) = (Raster::new(width, rows, bands), Raster::new(width, rows, bands));
        let stride = width * bands;
        let mut direct = self.exposed.settings.records_direct().then(|| (Raster::new(width, rows, bands), vec![0.0; stride]));
        for (k, row) in range.clone().enumerate() {
            let place = k * stride..(k + 1) * stride;
            let numbers = self.exposed.sums.sums.row(row)?;
            let samples = &self.exposed.sums.samples;
            of_row(samples, numbers, width, 0..bands, [&mut mean.data[place.clone()], &mut half_difference.data[place.clone()]]);
            if let Some((direct, unused)) = &mut direct {
                // Without fireflies and starbursts they follow the bands.
                of_row(samples, numbers, width, bands..2 * bands, [&mut direct.data[place], &mut unused[..]]);
            }
        }
        let mut truth = self.truth_of(range.clone());
        if let Some((direct, _)) = &direct {
            write_direct_truth(&mut truth, &self.exposed.bands, &mean, direct);
        }
        self.next = range.end;
        Ok(FocalPlane { bands: self.exposed.bands.clone(), mean, half_difference, truth, facts: self.exposed.facts.clone() })
    }
}

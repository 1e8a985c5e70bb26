//! What ghosts and orders of diffraction share: the lens before the film's sensor, how they are looked at and put together.

use super::beams::Beam;
use super::raster::{Patch, Region};
use crate::camera::Film;
use diopter_lens::System;
use diopter_lens::ghosts::{GhostTracer, SENSOR_REFLECTANCE};

/// Rays across the front of the first look.
pub(super) const LOOK: usize = 24;

/// Ghosts drawn before they are added up: the rasters of so many are in memory.
pub(super) const AT_ONCE: usize = 64;

/// The lens at a wavelength (nm) before the film's sensor.
pub(super) fn tracer<'a>(system: &'a System, film: &Film, nm: f32) -> GhostTracer<'a> {
    GhostTracer::new(system, f64::from(nm), SENSOR_REFLECTANCE).with_microlenses([film.pixel_area_mm2.sqrt(); 2])
}

/// Regions by bins of wavelengths as one patch of what the bands count of a beam; `None` of nothing.
pub(super) fn assemble(patches: Vec<(usize, Region)>, beam: &Beam, bands: usize) -> Option<Patch> {
    let left = patches.iter().map(|p| p.1.left).min()?;
    let top = patches.iter().map(|p| p.1.top).min()?;
    let right = patches.iter().map(|p| p.1.left + p.1.columns as i64).max()?;
    let bottom = patches.iter().map(|p| p.1.top + p.1.rows as i64).max()?;
    let (width, height) = ((right - left) as usize, (bottom - top) as usize);
    let mut out = Patch { left, top, columns: width, data: vec![0.0; width * height * bands] };
    for (bin, region) in &patches {
        let counts: Vec<f32> = beam.counts.iter().map(|band| band[*bin] as f32).collect();
        for (k, light) in region.light.iter().enumerate().filter(|(_, light)| **light != 0.0) {
            let (from_left, from_top) = ((region.left - left) as usize, (region.top - top) as usize);
            let (column, row) = (from_left + k % region.columns, from_top + k / region.columns);
            let start = (row * out.columns + column) * bands;
            out.data[start..start + bands].iter_mut().zip(&counts).for_each(|(sum, count)| *sum += light * count);
        }
    }
    Some(out)
}

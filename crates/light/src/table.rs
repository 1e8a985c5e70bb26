//! Numbers at equal steps of wavelength.

use glam::Vec3;
use std::sync::{Arc, OnceLock};

/// A spectrum sampled at equal steps of wavelength, linear between samples and constant beyond the ends.
#[derive(Clone, Debug)]
pub struct Table {
    first_nm: f32,
    per_nm: f32,
    values: Arc<[f32]>,
    /// [`Table::srgb_of_light`], once somebody asked: integrals take microseconds, and paths that carry colours ask at every lamp.
    pub(crate) srgb_of_light: Arc<OnceLock<Vec3>>,
}

impl PartialEq for Table {
    fn eq(&self, other: &Self) -> bool {
        self.first_nm == other.first_nm && self.per_nm == other.per_nm && self.values == other.values
    }
}

impl Table {
    /// A table with `values[i]` at `first_nm + i * step_nm`. Without values it is 0 everywhere; where the step is not above 0, the first value holds everywhere.
    pub fn new(first_nm: f32, step_nm: f32, values: Vec<f32>) -> Self {
        Table::from_parts(first_nm, if step_nm > 0.0 { 1.0 / step_nm } else { 0.0 }, values)
    }

    /// A table by its values per nanometre, as [`Table::first_nm`], [`Table::per_nm`] and [`Table::values`] give them of another: equal to it bit by bit.
    /// What is missing or not above 0 is taken as by [`Table::new`].
    pub fn from_parts(first_nm: f32, per_nm: f32, values: Vec<f32>) -> Self {
        let values = if values.is_empty() { vec![0.0] } else { values };
        Table { first_nm, per_nm: per_nm.max(0.0), values: values.into(), srgb_of_light: Arc::default() }
    }

    /// Wavelength of the first value, nm.
    pub fn first_nm(&self) -> f32 {
        self.first_nm
    }

    /// Values a nanometre.
    pub fn per_nm(&self) -> f32 {
        self.per_nm
    }

    /// The values, from the shortest wavelength up, evenly spaced.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// A table at 5 nm, 380–780 nm, through unevenly spaced `(nm, value)` points in rising order, linear between them and constant beyond; 0 without points.
    pub fn from_points(points: &[(f32, f32)]) -> Self {
        let at = |nm: f32| match points.iter().position(|p| p.0 >= nm) {
            Some(0) => points[0].1,
            None => points.last().map_or(0.0, |p| p.1),
            Some(i) => {
                let ((x0, y0), (x1, y1)) = (points[i - 1], points[i]);
                y0 + (y1 - y0) * (nm - x0) / (x1 - x0)
            }
        };
        Table::new(380.0, 5.0, (0..=80).map(|i| at(380.0 + 5.0 * i as f32)).collect())
    }

    /// Value at a wavelength in nm: linear between values, constant beyond the ends.
    #[inline]
    pub fn at(&self, nm: f32) -> f32 {
        let x = ((nm - self.first_nm) * self.per_nm).max(0.0);
        // By 32 bits: conversions to 64 take twice the instructions, and this is asked at every surface.
        let i = x as u32 as usize;
        if i + 1 >= self.values.len() {
            return self.values[self.values.len() - 1];
        }
        let t = x - i as f32;
        self.values[i] + (self.values[i + 1] - self.values[i]) * t
    }

    /// The same spectrum times a factor.
    pub fn scaled(&self, factor: f32) -> Self {
        Table { values: self.values.iter().map(|v| v * factor).collect(), srgb_of_light: Arc::default(), ..self.clone() }
    }

    /// The largest value.
    pub fn max(&self) -> f32 {
        self.values.iter().copied().fold(f32::NEG_INFINITY, f32::max)
    }
}

//! What is the same in every picture of one sensor: how its pixels differ. Drawn from its serial number.

use crate::Sensor;
use crate::noise::{key_of, mix, normal_quantile, unit};

/// The fixed pattern of a sensor.
#[derive(Clone, Debug)]
pub struct Pattern {
    key: u64,
    prnu: f64,
    dsnu_e: f64,
    dsnu_row_e: f64,
    hot_fraction: f64,
    hot_factor: f64,
    /// Offset of each column, e⁻.
    columns: Vec<f64>,
}

/// How the charge that gathers in a pixel differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPattern {
    /// Factor on what light gives.
    pub response: f64,
    /// Factor on the dark current.
    pub leak: f64,
}

impl Pattern {
    /// The pattern of a serial number, for pictures of a width.
    pub fn new(sensor: &Sensor, serial: &str, width: usize) -> Self {
        let key = key_of(serial);
        let column = |i: usize| sensor.dsnu_column_e * normal_quantile(unit(mix(key ^ 0xc01, i as u64)));
        Pattern {
            key,
            prnu: sensor.prnu,
            dsnu_e: sensor.dsnu_e,
            dsnu_row_e: sensor.dsnu_row_e,
            hot_fraction: sensor.hot_pixels.fraction,
            hot_factor: sensor.hot_pixels.factor,
            columns: if sensor.dsnu_column_e > 0.0 { (0..width).map(column).collect() } else { vec![0.0; width] },
        }
    }

    /// Offset of a row, e⁻.
    pub fn row_e(&self, row: usize) -> f64 {
        match self.dsnu_row_e > 0.0 {
            true => self.dsnu_row_e * normal_quantile(unit(mix(self.key ^ 0x50, row as u64))),
            false => 0.0,
        }
    }

    fn place(column: usize, row: usize) -> u64 {
        (row as u64) << 32 | column as u64
    }

    /// How the charge of a pixel differs.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> PixelPattern {
        let place = Self::place(column, row);
        let mut pixel = PixelPattern { response: 1.0, leak: 1.0 };
        if self.prnu > 0.0 {
            // A pixel that sees less than nothing is dead.
            pixel.response = (1.0 + self.prnu * normal_quantile(unit(mix(self.key, place)))).max(0.0);
        }
        if self.hot_fraction > 0.0 {
            let u = unit(mix(self.key ^ 0x407, place));
            if u < self.hot_fraction {
                // What is left of the number, within its fraction, is even again.
                pixel.leak = 1.0 - self.hot_factor * (u / self.hot_fraction).ln();
            }
        }
        pixel
    }

    /// What is added to every reading of a pixel, its row's offset apart, e⁻.
    #[inline]
    pub fn offset_e(&self, column: usize, row: usize) -> f64 {
        match self.dsnu_e > 0.0 {
            true => self.columns[column] + self.dsnu_e * normal_quantile(unit(mix(self.key ^ 0xd5, Self::place(column, row)))),
            false => self.columns[column],
        }
    }
}

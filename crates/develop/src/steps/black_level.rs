//! Digital numbers to the share of saturation: (DN − black) / (white − black). Negative noise stays.

use diopter_image::{Raster, RawImage};

/// The mosaic with 0 = no light, 1 = saturation.
pub fn subtract(raw: &RawImage) -> Raster<f32> {
    let scale = 1.0 / (raw.header.white_level - raw.header.black_level);
    let data = raw.mosaic.data.iter().map(|dn| ((*dn as f64 - raw.header.black_level) * scale) as f32).collect();
    Raster { width: raw.mosaic.width, height: raw.mosaic.height, channels: 1, data }
}

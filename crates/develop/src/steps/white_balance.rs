//! Makes the neutral of the shot grey: each channel is divided by the neutral's. The channel that responds most keeps its
//! scale, so every channel reaches 1.0 when saturated.

use diopter_image::{Cfa, Raster};

/// Balances a mosaic.
pub fn balance(mut mosaic: Raster<f32>, cfa: &Cfa, neutral: [f64; 3]) -> Raster<f32> {
    let gain = neutral.map(|n| (1.0 / n.max(1e-3)) as f32);
    for row in 0..mosaic.height {
        for column in 0..mosaic.width {
            mosaic.pixel_mut(column, row)[0] *= gain[cfa.channel_at(column, row)];
        }
    }
    mosaic
}

/// Clips all channels at 1.0, where the first saturates: blown highlights turn white, not pink.
pub fn clip_highlights(rgb: &mut Raster<f32>) {
    rgb.data.iter_mut().for_each(|v| *v = v.min(1.0));
}

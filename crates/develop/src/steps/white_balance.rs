//! Makes the neutral of the shot grey: each channel is divided by the neutral's. The channel that responds most keeps its
//! scale, so every channel reaches 1.0 when saturated.

use diopter_image::{Raster, RawHeader};

/// Balances a mosaic.
pub fn balance(mut mosaic: Raster<f32>, header: &RawHeader) -> Raster<f32> {
    let gain: Vec<f32> = header.as_shot_neutral.iter().map(|n| (1.0 / n.max(1e-3)) as f32).collect();
    let width = mosaic.width;
    for (row, line) in mosaic.data.chunks_mut(width).enumerate() {
        line.iter_mut().enumerate().for_each(|(column, v)| *v *= gain[header.cfa.channel_at(column, row)]);
    }
    mosaic
}

/// Clips all channels at 1.0, where the first saturates: blown highlights turn white, not pink.
pub fn clip_highlights(channels: &mut Raster<f32>) {
    channels.data.iter_mut().for_each(|v| *v = v.min(1.0));
}

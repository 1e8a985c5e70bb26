//! Scene and environment files.

pub mod gltf;

use crate::SceneError;
use diopter_image::Raster;
use std::io::Cursor;

/// Reads a Radiance `.hdr` picture as linear RGB.
pub fn read_hdr(bytes: &[u8]) -> Result<Raster<f32>, SceneError> {
    let malformed = |e: image::ImageError| SceneError::File {
        place: "environment map".into(),
        found: e.to_string(),
        expected: "expected a Radiance .hdr picture".into(),
    };
    let decoder = image::codecs::hdr::HdrDecoder::new(Cursor::new(bytes)).map_err(malformed)?;
    let picture = image::DynamicImage::from_decoder(decoder).map_err(malformed)?.into_rgb32f();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Raster { width, height, channels: 3, data: picture.into_raw() })
}

//! Scene and environment files.

pub mod gltf;
pub mod mesh;
pub mod pbrt;
pub mod ply;

use crate::SceneError;
use crate::texture::{Image, Texels};
use diopter_image::Raster;
use std::io::{Cursor, Read};

/// Gives the bytes behind a name that a scene file refers to (relative to it), or says why not.
pub type Fetch<'a> = &'a (dyn Fn(&str) -> Result<Vec<u8>, String> + Sync);

/// Most pixels a side of a texture.
const LARGEST_IMAGE: u32 = 32_768;
/// Most bytes that a compressed file may become.
const LARGEST_FILE: u64 = 16 << 30;

/// Bytes as they are, or what a gzip file holds.
fn unzipped(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut out = Vec::new();
    let mut limited = flate2::read::MultiGzDecoder::new(&bytes[..]).take(LARGEST_FILE);
    limited.read_to_end(&mut out).map_err(|e| format!("gzip: {e}"))?;
    Ok(out)
}

/// Reads a PNG or JPEG as 8-bit codes.
fn read_picture(bytes: &[u8]) -> Result<Image, String> {
    let mut reader = image::ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LARGEST_IMAGE), Some(LARGEST_IMAGE));
    // A file cannot hold more than its bytes can become: deflate packs at most 1032 to 1.
    let most = (bytes.len() as u64).saturating_mul(1100).max(512 << 20);
    limits.max_alloc = Some(most.min(u64::from(LARGEST_IMAGE) * u64::from(LARGEST_IMAGE) * 8));
    reader.limits(limits);
    let decoded = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    if width == 0 || height == 0 {
        return Err(format!("it has {width} × {height} pixels"));
    }
    let pixels = decoded.into_raw().chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    Ok(Image::new(width, height, pixels))
}

/// Reads a picture of codes for a texture.
fn read_codes(bytes: &[u8]) -> Result<Image, String> {
    read_picture(bytes).map(Image::kept)
}

/// Reads a picture for a texture: EXR and Radiance as linear numbers, others as 8-bit codes.
fn read_texture(bytes: &[u8]) -> Result<Image, String> {
    if !is_light(bytes) {
        return read_codes(bytes);
    }
    let picture = read_light_picture(bytes)?;
    let texels = picture.data.as_chunks::<3>().0.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
    Ok(Image::linear(picture.width, picture.height, texels).kept())
}

/// Whether a picture is one of EXR's or Radiance's.
fn is_light(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) || bytes.starts_with(b"#?")
}

/// Reads a picture of light as linear RGB: EXR or Radiance as it is, others by the sRGB function.
fn read_light_picture(bytes: &[u8]) -> Result<Raster<f32>, String> {
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return diopter_image::exr::read_rgb(Cursor::new(bytes)).map_err(|e| e.to_string());
    }
    if bytes.starts_with(b"#?") {
        return read_hdr(bytes).map_err(|e| e.to_string());
    }
    let Image { width, height, texels: Texels::Codes(pixels), .. } = read_picture(bytes)? else {
        return Err("it is no picture of 8-bit codes".into());
    };
    let linear = |c: &u8| diopter_light::color::srgb_decode(f32::from(*c) / 255.0);
    let data = pixels.iter().flat_map(|p| [linear(&p[0]), linear(&p[1]), linear(&p[2])]).collect();
    Ok(Raster { width, height, channels: 3, data })
}

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

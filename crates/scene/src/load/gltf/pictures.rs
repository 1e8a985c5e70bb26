//! Files that a glTF names, its pictures, and where they lie on surfaces.

use super::check::label;
use super::packed;
use super::{Loader, error};
use crate::SceneError;
use crate::load::{Fetch, read_texture, stand_in};
use crate::scene::MissingTexture;
use crate::texture::{Codes, Image, Interpolation, Texture, Wrap};
use glam::{Affine2, Mat2, Vec2};
use serde_json::Value;
use std::sync::Arc;

impl Loader<'_> {
    pub(super) fn texture(&self, texture: &gltf::Texture, codes: Codes, uv_set: u32, image_from_uv: Affine2) -> Option<Texture> {
        let image = match (self.images.get(texture.source().index())?, codes) {
            (Some(image), _) => image.clone(),
            (None, Codes::Srgb) => stand_in(),
            // A map of numbers that is missing is left out: the factors alone count.
            (None, Codes::Linear) => return None,
        };
        let sampler = texture.sampler();
        let wrap = |w: gltf::texture::WrappingMode| match w {
            gltf::texture::WrappingMode::ClampToEdge => Wrap::Clamp,
            gltf::texture::WrappingMode::MirroredRepeat => Wrap::Mirror,
            gltf::texture::WrappingMode::Repeat => Wrap::Repeat,
        };
        let interpolation = match sampler.mag_filter() {
            Some(gltf::texture::MagFilter::Nearest) => Interpolation::Nearest,
            _ => Interpolation::Bilinear,
        };
        let wrap = [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())];
        Some(Texture { image, codes, wrap, interpolation, uv_set: uv_set as usize, image_from_uv })
    }

    pub(super) fn info(&self, info: Option<gltf::texture::Info>, codes: Codes) -> Option<Texture> {
        let info = info?;
        let transform = info.texture_transform();
        let set = transform.as_ref().and_then(|t| t.tex_coord()).unwrap_or_else(|| info.tex_coord());
        let matrix = transform.map_or(Affine2::IDENTITY, |t| uv_transform(t.offset().into(), t.rotation(), t.scale().into()));
        self.texture(&info.texture(), codes, set, matrix)
    }

    /// A texture reference in plain JSON, for extensions the reader does not know.
    pub(super) fn json_texture(&self, value: &Value, codes: Codes) -> Option<Texture> {
        let texture = self.document.textures().nth(value.get("index")?.as_u64()? as usize)?;
        let set = value.get("texCoord").and_then(Value::as_u64).unwrap_or(0) as u32;
        let (set, matrix) = json_transform(value.get("extensions"), set);
        self.texture(&texture, codes, set, matrix)
    }
}

pub(super) fn fetch_uri(uri: &str, name: &str, place: &str, fetch: Fetch) -> Result<Vec<u8>, SceneError> {
    uri_bytes(uri, fetch).map_err(|e| {
        let found = e.path.map_or_else(|| e.reason.clone(), |path| format!("\"{path}\": {}", e.reason));
        error(name, place, found, e.expected)
    })
}

/// Why the bytes of a URI cannot be had.
pub(super) struct NoBytes {
    /// The file, unless it is a data URI.
    path: Option<String>,
    reason: String,
    expected: &'static str,
}

pub(super) fn uri_bytes(uri: &str, fetch: Fetch) -> Result<Vec<u8>, NoBytes> {
    use base64::Engine;
    if let Some(rest) = uri.strip_prefix("data:") {
        let data = rest.split_once(";base64,").map(|(_, d)| d);
        let decoded = data.and_then(|d| base64::engine::general_purpose::STANDARD.decode(d).ok());
        let reason = "its data URI cannot be decoded".to_owned();
        return decoded.ok_or(NoBytes { path: None, reason, expected: "expected data:<type>;base64,<data>" });
    }
    let path = percent_decode(uri);
    let leaves = path.split(['/', '\\']).any(|part| part == "..") || path.starts_with(['/', '\\']) || path.contains(':');
    if leaves {
        let reason = "it leads out of the scene's folder".to_owned();
        return Err(NoBytes { path: Some(path), reason, expected: "expected a path below the file, without \"..\"" });
    }
    fetch(&path).map_err(|reason| NoBytes { path: Some(path), reason, expected: "expected a readable file beside the scene" })
}

pub(super) fn percent_decode(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = (bytes[i] == b'%').then(|| uri.get(i + 1..i + 3)).flatten().and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(hex.unwrap_or(bytes[i]));
        i += if hex.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// Reads a picture. One that cannot be had or read is missing, which is no error yet.
pub(super) fn read_image(
    image: &gltf::Image,
    buffers: &[Vec<u8>],
    name: &str,
    fetch: Fetch,
) -> Result<Result<Arc<Image>, MissingTexture>, SceneError> {
    let place = format!("image {}{}", image.index(), label(image.name()));
    let missing = |name: Option<String>, reason: String| MissingTexture { name: name.unwrap_or_else(|| place.clone()), reason };
    let (bytes, file) = match image.source() {
        gltf::image::Source::View { view, .. } => {
            let data = buffers.get(view.buffer().index()).and_then(|b| b.get(view.offset()..view.offset() + view.length()));
            let data =
                data.ok_or_else(|| error(name, &place, "its buffer view is out of range", "expected bytes within the buffer"))?;
            (data.to_vec(), None)
        }
        gltf::image::Source::Uri { uri, .. } => match uri_bytes(uri, fetch) {
            Ok(bytes) => (bytes, (!uri.starts_with("data:")).then(|| percent_decode(uri))),
            Err(e) => return Ok(Err(missing(e.path, e.reason))),
        },
    };
    let read = if packed::is_ktx2(&bytes) { packed::read_ktx2(&bytes) } else { read_texture(&bytes) };
    Ok(read.map(Arc::new).map_err(|reason| missing(file, reason)))
}

/// Source: KHR_texture_transform: translation × rotation × scale, rotation counter-clockwise in UV space.
pub(super) fn uv_transform(offset: Vec2, rotation: f32, scale: Vec2) -> Affine2 {
    let (s, c) = rotation.sin_cos();
    let rotate = Mat2::from_cols(Vec2::new(c, -s), Vec2::new(s, c));
    Affine2::from_mat2_translation(rotate * Mat2::from_diagonal(scale), offset)
}

pub(super) fn json_transform(extensions: Option<&Value>, set: u32) -> (u32, Affine2) {
    let Some(t) = extensions.and_then(|e| e.get("KHR_texture_transform")) else { return (set, Affine2::IDENTITY) };
    let pair = |key: &str, default: f32| {
        let at = |i: usize| t.get(key).and_then(|v| v.get(i)).and_then(Value::as_f64).map_or(default, |v| v as f32);
        Vec2::new(at(0), at(1))
    };
    let rotation = t.get("rotation").and_then(Value::as_f64).unwrap_or(0.0) as f32;
    let set = t.get("texCoord").and_then(Value::as_u64).map_or(set, |s| s as u32);
    (set, uv_transform(pair("offset", 0.0), rotation, pair("scale", 1.0)))
}

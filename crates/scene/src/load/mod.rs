//! Scene and environment files.

pub mod gltf;
pub mod mesh;
pub mod pbrt;
mod picture;
pub mod ply;

pub use picture::read_light;

use crate::SceneError;
use crate::scene::{Description, Object, Shape};
use picture::{read_light_picture, read_texture};
use std::io::Read;

/// Gives the bytes behind a name that a scene file refers to (relative to it), or says why not.
pub type Fetch<'a> = &'a (dyn Fn(&str) -> Result<Vec<u8>, String> + Sync);

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

/// Fails where a file describes no surface at all: a picture of it would be empty. `expected` says what its format calls one.
fn with_surface(description: Description, name: &str, expected: &str) -> Result<Description, SceneError> {
    let is_surface = |o: &Object| match o.shape {
        Shape::Mesh { mesh, .. } => description.meshes.get(mesh as usize).is_some_and(|m| !m.triangles.is_empty()),
        Shape::Sphere(_) | Shape::Quad(_) => true,
    };
    if description.objects.iter().any(is_surface) {
        return Ok(description);
    }
    let found = match description.objects.len() {
        0 => "no surface".to_owned(),
        n => format!("no surface: its {n} objects have no triangles"),
    };
    Err(SceneError::File { place: name.to_owned(), found, expected: format!("expected {expected}") })
}

//! Scene and environment files.

mod blosc;
mod displaced;
mod foreign;
pub mod gltf;
mod measured;
pub mod mesh;
pub mod mitsuba;
pub mod nanovdb;
#[cfg(test)]
mod normal_map_tests;
pub mod obj;
pub mod pbrt;
mod picture;
pub mod ply;
mod polygon;
pub mod sheet;
pub mod splats;
mod udim;
pub mod usd;

pub use crate::scene::description::DisplacedSurface;
pub use displaced::PixelView;
pub use foreign::foreign;
pub use measured::read_measured;
pub use picture::{read_codes, read_light, read_profile};

use crate::SceneError;
use crate::material::{Measured, Scattering};
use crate::scene::{Description, MissingTexture};
use crate::texture::{Color, Image};
use glam::Vec3;
use picture::{read_light_picture, read_texture};
use std::borrow::Cow;
use std::io::Read;
use std::sync::Arc;

/// Linear sRGB that is shown where a texture is missing: a magenta that nobody takes for the real colour.
pub const STAND_IN: Vec3 = Vec3::new(1.0, 0.0, 1.0);

/// What is said of a file that is none of a format, by how it begins.
fn beginning(bytes: &[u8]) -> String {
    const SHOWN: usize = 16;
    if bytes.is_empty() {
        return "the file is empty".to_owned();
    }
    format!("it begins with \"{}\"", bytes[..bytes.len().min(SHOWN)].trim_ascii_end().escape_ascii())
}

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

/// A text with a stand-in for all that is no UTF-8: comments and names of meshes in other encodings; their numbers are ASCII.
fn lossy(bytes: &[u8]) -> Cow<'_, [u8]> {
    match String::from_utf8_lossy(bytes) {
        Cow::Borrowed(_) => Cow::Borrowed(bytes),
        Cow::Owned(text) => Cow::Owned(text.into_bytes()),
    }
}

/// [`STAND_IN`] as a picture.
fn stand_in() -> Arc<Image> {
    Arc::new(Image::new(1, 1, vec![[255, 0, 255, 255]]))
}

/// What the bytes of a measured material make, or a plain surface of [`STAND_IN`] where they are missing or damaged, which is noted.
fn measured_or_stand_in(all: &mut Vec<MissingTexture>, name: &str, bytes: Result<Vec<u8>, String>) -> Scattering {
    let read: Result<Measured, String> = bytes.and_then(|bytes| read_measured(&bytes));
    match read {
        Ok(measured) => Scattering::Measured(Arc::new(measured)),
        Err(reason) => {
            note_missing(all, name, format!("measured material: {reason}"));
            Scattering::Diffuse(Color::rgb(STAND_IN.x, STAND_IN.y, STAND_IN.z))
        }
    }
}

/// Columns and rows of a picture of an aspect, width over height; `None` where no picture has such a shape.
fn size_of_aspect(aspect: f64) -> Option<[usize; 2]> {
    /// Pixels of the longer side.
    const LONGER: f64 = 960.0;
    let [columns, rows] = if aspect > 1.0 { [LONGER, LONGER / aspect] } else { [LONGER * aspect, LONGER] };
    (aspect.is_finite() && aspect > 0.02 && aspect < 50.0).then(|| [columns, rows].map(|side| side.round() as usize))
}

/// Notes a picture that cannot be read, once.
fn note_missing(all: &mut Vec<MissingTexture>, name: &str, reason: String) {
    if all.iter().all(|m| m.name != name) {
        all.push(MissingTexture { name: name.to_owned(), reason });
    }
}

/// What every reader of scenes ends with: missing textures become one warning, and a file that describes no surface at all is an error, as a picture
/// of it would be empty. `expected` says what its format calls a surface.
fn finished(mut description: Description, name: &str, expected: &str) -> Result<Description, SceneError> {
    let missing = &description.missing_textures;
    if !missing.is_empty() {
        let list: Vec<String> = missing.iter().map(|m| format!("{} ({})", m.name, m.reason)).collect();
        let count = if list.len() == 1 { "1 texture".to_owned() } else { format!("{} textures", list.len()) };
        let text = format!(
            "{name}: {count} could not be read: {}; magenta stands in for colours, maps of numbers are left out",
            list.join(", ")
        );
        description.warnings.push(text);
    }
    if description.has_surface() {
        return Ok(description);
    }
    let found = match description.objects.len() {
        0 => "no surface".to_owned(),
        n => format!("no surface: its {n} objects have no triangles"),
    };
    Err(SceneError::File { place: name.to_owned(), found, expected: format!("expected {expected}") })
}

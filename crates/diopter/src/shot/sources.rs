//! Files and names that a shot refers to: scenes, lenses, bodies, environments.

use super::{ShotError, value};
use diopter_lens::{LensError, Prescription, import};
use diopter_scene::light::Environment;
use diopter_scene::{Description, builtin, load};
use diopter_sensor::{Sensor, nearest};
use glam::Mat3;
use std::path::Path;

/// Reads a scene by the name of an embedded one or from a file.
pub fn read_scene(name: &str) -> Result<Description, ShotError> {
    if let Some(description) = builtin::named(name) {
        return Ok(description);
    }
    let path = Path::new(name);
    let known: Vec<&str> = builtin::NAMES.iter().map(|n| n.0).collect();
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    if !path.exists() && ending.is_none() {
        let hint = match nearest(name, known.iter().copied()) {
            Some(near) => format!("a scene (did you mean \"{near}\"?)"),
            None => format!("an embedded scene ({}) or a file: {SCENE_FILES}", known.join(", ")),
        };
        return Err(value("scene", format!("\"{name}\""), hint));
    }
    // Beneath .gz the name goes on.
    let ending = match ending.as_deref() {
        Some("gz") => path.file_stem().map(Path::new).and_then(Path::extension).map(|e| e.to_string_lossy().to_lowercase()),
        _ => ending,
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let fetch = move |uri: &str| {
        let found = folder.join(uri);
        std::fs::read(&found).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".into(),
            _ => e.to_string(),
        })
    };
    let bytes = || read_file(path);
    Ok(match ending.as_deref() {
        Some("gltf" | "glb") => load::gltf::load(&bytes()?, name, &fetch)?,
        Some("pbrt") => load::pbrt::load(&bytes()?, name, &fetch)?,
        Some("ply") => load::mesh::ply(bytes()?, name)?,
        Some("obj") => load::mesh::obj(&bytes()?, name, &fetch)?,
        Some("stl") => load::mesh::stl(&bytes()?, name)?,
        _ => return Err(value("scene", format!("\"{name}\""), format!("a file: {SCENE_FILES} (or a .toml shot file)"))),
    })
}

/// Endings of scene files.
const SCENE_FILES: &str = ".gltf, .glb, .pbrt, .obj, .ply or .stl";

/// Whether a lens is given as a file and not by name.
pub(super) fn is_lens_file(name: &str) -> bool {
    import::Format::of(name).is_some() && diopter_lens::embedded(name).is_none()
}

/// Lenses without surfaces.
const IDEAL: [&str; 3] = ["thin", "pinhole", "panorama"];

/// Reads a lens by the name of an embedded one or from a file.
pub fn read_lens(name: &str) -> Result<Prescription, ShotError> {
    if IDEAL.contains(&name) {
        let expected =
            "a lens with surfaces, from `lens list` or a file: an ideal one has none (`lens draw thin` draws the thin lens)";
        return Err(value("lens", format!("\"{name}\""), expected));
    }
    if let Some(lens) = diopter_lens::embedded(name) {
        return Ok(lens);
    }
    let path = Path::new(name);
    match import::Format::of(name) {
        Some(format) => Ok(import::read(&read_file(path)?, format, name).map_err(LensError::from)?),
        _ => {
            let expected = match nearest(name, diopter_lens::embedded_names().chain(IDEAL)) {
                Some(near) => format!("a lens (did you mean \"{near}\"?)"),
                None if path.exists() => format!("a lens file: {}", import::Format::ENDINGS),
                None => format!("thin, pinhole, panorama, a name of `lens list`, or a file: {}", import::Format::ENDINGS),
            };
            Err(value("lens", format!("\"{name}\""), expected))
        }
    }
}

/// Reads a body by name or from a TOML file.
pub fn read_body(name: &str) -> Result<Sensor, ShotError> {
    if !name.ends_with(".toml") {
        return Ok(Sensor::named(name)?);
    }
    let text = String::from_utf8(read_file(Path::new(name))?)
        .map_err(|_| ShotError::Read { path: name.into(), reason: "it is not text".into() })?;
    Ok(Sensor::parse(&text, name)?)
}

/// Reads a `.hdr`, `.exr` or `.pfm` as an environment.
pub fn read_environment(path: &Path, rotation_deg: f32, scale: f32) -> Result<Environment, ShotError> {
    let bytes = read_file(path)?;
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let told = |reason: String| ShotError::Read { path: path.display().to_string(), reason };
    let map = match ending.as_deref() {
        Some("hdr" | "exr" | "pfm") => load::read_light(&bytes).map_err(told)?,
        _ => return Err(value("environment", path.display(), "a .hdr, .exr or .pfm file")),
    };
    if map.width == 0 || map.height == 0 {
        return Err(told("it has no pixels".into()));
    }
    Ok(Environment::new(map, Mat3::from_rotation_y(rotation_deg.to_radians()), scale))
}

pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, ShotError> {
    std::fs::read(path).map_err(|e| {
        let reason = match e.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".into(),
            _ => e.to_string(),
        };
        ShotError::Read { path: path.display().to_string(), reason }
    })
}

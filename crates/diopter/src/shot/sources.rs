//! Files and names that a shot refers to: scenes, lenses, bodies, environments.

use super::{ShotError, value};
use crate::files;
use diopter_lens::camera_model::ModelKind;
use diopter_lens::tolerance::{ToleranceSheet, Toleranced};
use diopter_lens::{LensError, Prescription, import};
use diopter_scene::light::Environment;
use diopter_scene::{Description, SceneError, builtin, load};
use diopter_sensor::{Sensor, nearest};
use glam::Mat3;
use std::ops::RangeInclusive;
use std::path::Path;

/// Reads a scene by the name of an embedded one or from a file. `strict`: a texture that cannot be read is an error instead of a warning. Fails on a name that is not
/// known, and on a file that cannot be read or is no scene.
pub fn read_scene(name: &str, strict: bool) -> Result<Description, ShotError> {
    if let Some(description) = builtin::named(name) {
        return Ok(description);
    }
    let path = Path::new(name);
    let known: Vec<&str> = builtin::NAMES.iter().map(|n| n.0).collect();
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    if name == files::STANDARD_INPUT {
        let expected =
            "the name of a file, whose ending tells its format, for scenes; a shot file (TOML) can come from standard input";
        return Err(value("scene", "\"-\" (standard input)", expected));
    }
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
        files::read(&found).map_err(|e| e.to_string())
    };
    let refuse = |(what, way): (&str, &str)| {
        ShotError::Scene(SceneError::File {
            place: name.to_owned(),
            found: format!("it is {what}, which is not read"),
            expected: format!("expected a file: {SCENE_FILES}; {way}"),
        })
    };
    let bytes = || {
        let bytes = read_file(path)?;
        // An ending that is read may stand on a file that is not.
        load::foreign("", &bytes).map_or(Ok(bytes), |known| Err(refuse(known)))
    };
    let description = match ending.as_deref() {
        Some("gltf" | "glb") => load::gltf::load(&bytes()?, name, &fetch)?,
        Some("pbrt") => load::pbrt::load(&bytes()?, name, &fetch)?,
        Some("ply") => load::mesh::ply(bytes()?, name)?,
        Some("spz") => load::splats::spz(bytes()?, name)?,
        Some("obj") => load::obj::obj(&bytes()?, name, &fetch)?,
        Some("stl") => load::mesh::stl(&bytes()?, name)?,
        Some("scene") => load::sheet::load(&bytes()?, name)?,
        Some("xml") => load::mitsuba::load(&bytes()?, name, &fetch)?,
        Some("usd" | "usda" | "usdc" | "usdz") => load::usd::load(bytes()?, name, &fetch)?,
        other => {
            let known = other.and_then(|ending| load::foreign(ending, &[])).map(refuse);
            let expected = || format!("a file: {SCENE_FILES} (or a .toml shot file)");
            return Err(known.unwrap_or_else(|| value("scene", format!("\"{name}\""), expected())));
        }
    };
    if strict && !description.missing_textures.is_empty() {
        let list: Vec<String> = description.missing_textures.iter().map(|m| format!("{} ({})", m.name, m.reason)).collect();
        return Err(ShotError::Scene(SceneError::File {
            place: name.to_owned(),
            found: format!("textures that could not be read: {}", list.join(", ")),
            expected: "expected all of them (without strict, magenta stands in)".into(),
        }));
    }
    Ok(description)
}

/// Sides of a model of metres that nobody doubts, m.
const PLAUSIBLE_M: RangeInclusive<f32> = 1e-3..=100.0;
/// Factors that turn a file's unit into metres.
const SCALE: RangeInclusive<f64> = 1e-9..=1e9;

/// Fails unless a unit of length is plausible.
fn check_scale(scale: Option<f64>) -> Result<(), ShotError> {
    match scale.filter(|factor| !SCALE.contains(factor)) {
        Some(factor) => Err(implausible_scale(factor)),
        None => Ok(()),
    }
}

fn implausible_scale(factor: f64) -> ShotError {
    value("scale", factor, "metres in a unit of the file, from 1e-9 to 1e9: 0.001 for millimetres")
}

/// Multiplies all lengths of a scene by its unit of length, m. Fails unless that is plausible.
pub(super) fn rescale(description: &mut Description, factor: f64) -> Result<(), ShotError> {
    check_scale(Some(factor))?;
    description.scale(factor as f32).map_err(|_| implausible_scale(factor))
}

/// Reads a scene whose unit of length is `scale` metres; a metre without it, and `warn` is told when that makes a model implausibly large
/// or small.
pub(super) fn read_scaled(
    name: &str,
    scale: Option<f64>,
    strict: bool,
    warn: &mut dyn FnMut(&str),
) -> Result<Description, ShotError> {
    check_scale(scale)?;
    if scale.is_some() && builtin::is_embedded(name) {
        return Err(value("scale", format!("of \"{name}\""), "a scene file: embedded scenes are in metres"));
    }
    let mut description = read_scene(name, strict)?;
    match scale {
        Some(factor) => rescale(&mut description, factor)?,
        None => odd_size(name, &description).iter().for_each(|hint| warn(hint)),
    }
    Ok(description)
}

/// Whether a scene file is of a kind that holds models, often without light, ground or camera.
pub(super) fn is_model(name: &str) -> bool {
    let ending = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(ending.as_deref(), Some("obj" | "stl" | "ply" | "spz" | "gltf" | "glb" | "scene")) || is_usd(ending.as_deref())
}

/// Whether a file is a scene's, by its ending.
pub fn is_scene_file(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(ending.as_deref(), Some("pbrt" | "xml")) || is_model(&path.to_string_lossy())
}

fn is_usd(ending: Option<&str>) -> bool {
    matches!(ending, Some("usd" | "usda" | "usdc" | "usdz"))
}

/// What is to be said of a model that is implausibly large or small, if it is one: which unit was assumed, and what others would make of it.
/// Of scenes of pbrt nothing is said: they bring their own camera, and no unit; nor of USD, which says what its unit is.
pub fn odd_size(name: &str, description: &Description) -> Option<String> {
    let ending = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    if !is_model(name) || is_usd(ending.as_deref()) {
        return None;
    }
    let bounds = description.bounds_at(0.0, |_| true);
    if bounds.is_empty() {
        return None;
    }
    let side = bounds.size().max_element();
    if PLAUSIBLE_M.contains(&side) || !(side.is_finite() && side > 0.0) {
        return None;
    }
    let would = |unit: &str, factor: f32| format!("--scale {factor} for {unit} ({})", length(side * factor));
    let hint = match side > 1.0 {
        true => format!("{} or {}", would("centimetres", 0.01), would("millimetres", 0.001)),
        false => would("kilometres", 1000.0),
    };
    Some(format!(
        "{name} is {} across when its unit is taken for the metre, as it is: if that is wrong, give {hint}",
        length(side)
    ))
}

/// A length with three digits: "15.5 m", "2 mm".
fn length(m: f32) -> String {
    let (value, unit) = match m {
        m if m >= 1000.0 => (m / 1000.0, "km"),
        m if m >= 1.0 => (m, "m"),
        m if m >= 0.01 => (m * 100.0, "cm"),
        m if m >= 0.001 => (m * 1000.0, "mm"),
        m => (m * 1e6, "µm"),
    };
    let decimals = (2 - value.max(1e-3).log10().floor() as i32).clamp(0, 3) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text} {unit}")
}

/// Endings of scene files.
const SCENE_FILES: &str =
    ".gltf, .glb, .usd (.usda, .usdc, .usdz), .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl or .scene (by hand)";

/// Whether a light is given as a file and not by name: a picture of surroundings.
pub(super) fn is_light_file(name: &str) -> bool {
    let ending = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(ending.as_deref(), Some("hdr" | "exr" | "pfm"))
}

/// Whether a lens is given as a file and not by name.
pub(super) fn is_lens_file(name: &str) -> bool {
    build_of(name).is_some() || import::Format::of(name).is_some() && diopter_lens::embedded(name).is_none()
}

/// Sheet and number where a lens is a build of a tolerance sheet: "sheet.toml#17".
fn build_of(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once('#').filter(|(sheet, _)| sheet.ends_with(".toml"))
}

/// What a lens is called by that a sheet (`file`) names: a path counts from the folder of the sheet, an embedded name is as it is.
pub fn lens_beside(named: &str, file: &Path) -> String {
    match file.parent().filter(|_| is_lens_file(named)) {
        Some(folder) => folder.join(named).to_string_lossy().into_owned(),
        None => named.to_owned(),
    }
}

/// A build of a tolerance sheet.
fn read_build(sheet: &str, number: &str) -> Result<Prescription, ShotError> {
    let name = || format!("\"{sheet}#{number}\"");
    let expected = "the number of a build after #, such as sheet.toml#17";
    let build: u64 = number.parse().map_err(|_| value("lens", name(), expected))?;
    let path = Path::new(sheet);
    let text = String::from_utf8(read_file(path)?)
        .map_err(|_| ShotError::Read { path: sheet.into(), reason: "it is not text".into() })?;
    let tolerances = ToleranceSheet::parse(&text, sheet).map_err(LensError::from)?;
    let Some(named) = tolerances.lens.as_deref().filter(|n| build_of(n).is_none()) else {
        return Err(value("lens", name(), "a tolerance sheet that names its design: lens = \"...\" (a build is none)"));
    };
    let design = read_lens(&lens_beside(named, path))?;
    Ok(Toleranced::new(&design, &tolerances)?.build(build)?)
}

/// Lenses without surfaces.
pub(super) const IDEAL: [&str; 7] =
    ["thin", "pinhole", "panorama", "fisheye-equidistant", "fisheye-equisolid", "fisheye-stereographic", "fisheye-orthographic"];

/// The projection of an ideal fisheye by the name of the lens.
pub(super) fn ideal_fisheye(name: &str) -> Option<ModelKind> {
    let kind = ModelKind::named(name.strip_prefix("fisheye-")?)?;
    let ideal = [ModelKind::Equidistant, ModelKind::Equisolid, ModelKind::Stereographic, ModelKind::Orthographic];
    ideal.contains(&kind).then_some(kind)
}

/// Reads a lens by the name of an embedded one or from a file; "sheet.toml#17" is a build of a tolerance sheet. Fails on a name that is not known, on an ideal lens,
/// which has no surfaces, and on a file that cannot be read or is no lens.
pub fn read_lens(name: &str) -> Result<Prescription, ShotError> {
    if IDEAL.contains(&name) {
        let expected =
            "a lens with surfaces, from `lens list` or a file: an ideal one has none (`lens draw thin` draws the thin lens)";
        return Err(value("lens", format!("\"{name}\""), expected));
    }
    if let Some(lens) = diopter_lens::embedded(name) {
        return Ok(lens);
    }
    if let Some((sheet, number)) = build_of(name) {
        return read_build(sheet, number);
    }
    let path = Path::new(name);
    match import::Format::of(name) {
        Some(format) => Ok(import::read(&read_file(path)?, format, name).map_err(LensError::from)?),
        _ => {
            let of_file = format!("a lens file, whose ending tells its format: {}", import::Format::ENDINGS);
            let ending = path.extension().map(|e| e.to_string_lossy());
            let (what, expected) = match (nearest(name, diopter_lens::embedded_names().chain(IDEAL)), ending) {
                _ if path.is_dir() => (", which is a folder".to_owned(), of_file),
                (_, Some(ending)) if path.exists() => (format!(", which ends in .{ending}"), of_file),
                (_, None) if path.exists() => (", which is a file without an ending".to_owned(), of_file),
                (Some(near), _) => (String::new(), format!("a lens (did you mean \"{near}\"?)")),
                (None, ending) => {
                    let what = if ending.is_some() { ", which is not there" } else { "" };
                    let expected = format!(
                        "thin, pinhole, panorama, fisheye-equidistant (-equisolid, -stereographic, -orthographic), a name of `lens list`, or a file: {}",
                        import::Format::ENDINGS
                    );
                    (what.to_owned(), expected)
                }
            };
            Err(value("lens", format!("\"{name}\"{what}"), expected))
        }
    }
}

/// Reads a body by name or from a TOML file. Fails on a name that is not known, and on a file that cannot be read or has a wrong entry.
pub fn read_body(name: &str) -> Result<Sensor, ShotError> {
    if !name.ends_with(".toml") {
        return Ok(Sensor::named(name)?);
    }
    let text = String::from_utf8(read_file(Path::new(name))?)
        .map_err(|_| ShotError::Read { path: name.into(), reason: "it is not text".into() })?;
    Ok(Sensor::parse(&text, name)?)
}

/// Reads a `.hdr`, `.exr` or `.pfm` as an environment. Its numbers times `scale` are cd/m²; it is turned by `rotation_deg` about the vertical, counter-clockwise from
/// above. Fails on other endings and on files that cannot be read.
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

/// All bytes of a file of which none is empty: a scene, a lens, a body, a picture.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, ShotError> {
    let told = |reason: String| ShotError::Read { path: path.display().to_string(), reason };
    match files::read(path) {
        Ok(bytes) if bytes.is_empty() => Err(told("the file is empty".to_owned())),
        read => read.map_err(|e| told(e.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_other_programs_are_refused_with_the_way() {
        let folder = tempfile::tempdir().unwrap();
        for (name, content, words) in [
            ("a.blend", &b"BLENDER-v300"[..], ["Blender project", ".usdc"]),
            ("b.glb", b"Kaydara FBX Binary  ", ["FBX", ".glb or .usdc"]),
            ("c.step", b"ISO-10303-21;", ["STEP", ".stl"]),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            let error = read_scene(&path.display().to_string(), false).err().unwrap().to_string();
            assert!(error.contains(name) && words.iter().all(|w| error.contains(w)), "{error}");
        }
    }

    #[test]
    fn what_is_no_lens_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        for name in ["a.txt", "a"] {
            std::fs::write(path(name), "not a lens").unwrap();
        }
        std::fs::write(path("empty.zmx"), "").unwrap();
        for (name, words) in [
            (path("a.txt"), "a.txt\", which ends in .txt: expected a lens file"),
            (path("a"), "a\", which is a file without an ending: expected a lens file"),
            (path(""), "\", which is a folder: expected a lens file"),
            (path("b.txt"), "b.txt\", which is not there: expected thin"),
            (path("b.zmx"), "b.zmx: there is no such file"),
            (path("c/b.zmx"), "b.zmx: there is no folder"),
            (path("empty.zmx"), "empty.zmx: the file is empty"),
        ] {
            let error = read_lens(&name).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_build_of_a_tolerance_sheet_is_a_lens() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, lens: &str| {
            let path = folder.path().join(name);
            let text = format!("lens = \"{lens}\"\nfields_deg = [0]\n[[tolerance]]\nradius = \"0.1%\"\n");
            std::fs::write(&path, text).unwrap();
            path.display().to_string()
        };
        let sheet = write("sheet.toml", "double-gauss-50mm");
        let read = |number: &str| read_lens(&format!("{sheet}#{number}"));
        let (third, again, fourth) = (read("3").unwrap(), read("3").unwrap(), read("4").unwrap());
        assert_eq!(third, again);
        assert_ne!(third.surfaces, fourth.surfaces);
        assert!(is_lens_file(&format!("{sheet}#3")) && third.name.contains("build 3"));
        let error = read("x").unwrap_err().to_string();
        assert!(error.contains("#x") && error.contains("expected the number of a build"), "{error}");
        // A sheet for one of its own builds would go round in circles.
        let round = write("round.toml", "round.toml#1");
        let error = read_lens(&format!("{round}#1")).unwrap_err().to_string();
        assert!(error.contains("a build is none"), "{error}");
    }
}

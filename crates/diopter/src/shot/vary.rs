//! Settings of a shot by their names, to try several values of one.
//!
//! A name is that of a flag of `diopter shoot` without its dashes (`iso`, `focal-length`), of a setting of the development (`tone.curve`), or of a key
//! of the shot file (`camera.shake`).

use super::{ShotError, ShotFile, value};
use diopter_develop::{Recipe, SETTINGS};
use diopter_light::names::nearest;

/// Names of flags, and the keys of the shot file that they stand for.
pub const VARIABLES: &[(&str, &str)] = &[
    ("scene", "scene.file"),
    ("scale", "scene.scale"),
    ("strict", "scene.strict"),
    ("variant", "scene.variant"),
    ("displacement-edge-px", "scene.displacement_edge_px"),
    ("classes", "scene.classes"),
    ("light", "scene.light"),
    ("environment", "scene.environment"),
    ("environment-rotation", "scene.environment_rotation_deg"),
    ("daylight", "scene.daylight.time"),
    ("place", "scene.daylight.place"),
    ("sun", "scene.daylight.sun"),
    ("turbidity", "scene.daylight.turbidity"),
    ("fog", "scene.fog.visibility"),
    ("ground", "scene.ground"),
    ("ambient-ev", "scene.ambient_ev"),
    ("at", "scene.at"),
    ("animation", "scene.animation"),
    ("animation-end", "scene.animation_end"),
    ("frozen", "scene.frozen"),
    ("body", "camera.body"),
    ("serial", "camera.serial"),
    ("format", "camera.format"),
    ("lens", "camera.lens"),
    ("focal-length", "camera.focal_length"),
    ("camera", "camera.calibration"),
    ("fov", "camera.fov_deg"),
    ("orthographic", "camera.orthographic"),
    ("shift", "camera.shift_mm"),
    ("tilt", "camera.tilt_deg"),
    ("zoom-position", "camera.zoom_position"),
    ("blades", "camera.blades"),
    ("blade-curvature", "camera.blade_curvature"),
    ("blade-rotation", "camera.blade_rotation_deg"),
    ("aperture-image", "camera.aperture_image"),
    ("hood", "camera.hood"),
    ("plenoptic", "camera.plenoptic.pitch"),
    ("microlens-focal-length", "camera.plenoptic.focal_length"),
    ("microlens-gap", "camera.plenoptic.gap"),
    ("microlens-arrangement", "camera.plenoptic.arrangement"),
    ("look-from", "camera.look_from"),
    ("look-at", "camera.look_at"),
    ("up", "camera.up"),
    ("viewpoint", "camera.viewpoint"),
    ("shake", "camera.shake"),
    ("stabiliser", "camera.stabiliser.moves"),
    ("shutter-type", "shutter.kind"),
    ("shutter-direction", "shutter.direction"),
    ("travel", "shutter.travel"),
    ("line-time", "shutter.line_time"),
    ("readout", "shutter.readout"),
    ("reset", "shutter.reset"),
    ("ramp", "shutter.ramp"),
    ("aperture", "exposure.aperture"),
    ("shutter", "exposure.shutter"),
    ("shutter-angle", "sequence.shutter_angle_deg"),
    ("fps", "sequence.fps"),
    ("iso", "exposure.iso"),
    ("iso-min", "exposure.iso_min"),
    ("iso-max", "exposure.iso_max"),
    ("slowest", "exposure.slowest"),
    ("true-stops", "exposure.true_stops"),
    ("lens-cap", "exposure.lens_cap"),
    ("mode", "exposure.mode"),
    ("metering", "exposure.metering"),
    ("metering-at", "exposure.metering_at"),
    ("compensation", "exposure.compensation"),
    ("nd", "exposure.nd"),
    ("polarizer", "exposure.polarizer"),
    ("dial", "exposure.dial"),
    ("white", "exposure.white"),
    ("temperature", "exposure.temperature_c"),
    ("flash", "flash.guide_number"),
    ("flash-power", "flash.power"),
    ("flash-pulse", "flash.pulse"),
    ("flash-sync", "flash.sync"),
    ("focus", "focus.distance"),
    ("focus-zones", "focus.zones"),
    ("focus-motor", "focus.motor"),
    ("focus-sweep", "focus.sweep"),
    ("require-focus", "focus.require"),
    ("focus-priority", "focus.priority"),
    ("focus-method", "focus.method"),
    ("focus-measure", "focus.measure"),
    ("size", "render.size"),
    ("spp", "render.spp"),
    ("samples", "render.samples"),
    ("time-limit", "render.time_limit"),
    ("seed", "render.seed"),
    ("sampler", "render.sampler"),
    ("max-depth", "render.max_depth"),
    ("integrator", "render.integrator"),
    ("polarized", "render.polarized"),
    ("stray", "render.stray"),
    ("quick", "render.quick"),
    ("denoise", "render.denoise"),
    ("oidn", "render.oidn"),
    ("truth-channels", "render.truth_channels"),
    ("fireflies", "render.fireflies"),
    ("diffraction", "render.diffraction"),
];

/// Flags of the development, and the settings of the recipe that they stand for.
const DEVELOPING: [(&str, &str); 5] = [
    ("exposure-ev", "exposure.ev"),
    ("tone", "tone.curve"),
    ("demosaic", "demosaic.method"),
    ("lut", "lut.file"),
    ("gamma", "output.encoding"),
];

/// Sections of the shot file whose keys can be given.
const SECTIONS: [&str; 7] = ["scene", "camera", "shutter", "exposure", "flash", "focus", "render"];

impl ShotFile {
    /// The same shot with one setting changed. Fails with the names there are, or with what the value should be.
    pub fn with(&self, name: &str, text: &str) -> Result<ShotFile, ShotError> {
        let (name, text) = (name.trim(), text.trim());
        let mut shot = self.clone();
        if name == "preset" {
            shot.develop = Recipe::preset(text)?;
            return Ok(shot);
        }
        if name == "flicker" {
            let expected = |e: String| e.split_once(" is not ").map_or(e.clone(), |p| p.1.to_owned());
            shot.scene.flicker = vec![text.parse().map_err(|e| value("flicker", format!("\"{text}\""), expected(e)))?];
            return Ok(shot);
        }
        let flag = DEVELOPING.iter().find(|d| d.0 == name).map(|d| d.1);
        let setting = flag.unwrap_or(name.strip_prefix("develop.").unwrap_or(name));
        if SETTINGS.iter().any(|s| s.name == setting) {
            // "2.2" is short for "gamma-2.2", as the flag has it.
            let gamma = name == "gamma" && text.starts_with(|c: char| c.is_ascii_digit());
            shot.develop = shot.develop.with(setting, &if gamma { format!("gamma-{text}") } else { text.to_owned() })?;
            return Ok(shot);
        }
        let (what, path) = match VARIABLES.iter().find(|v| v.0 == name || v.1 == name) {
            Some((flag, path)) => (*flag, *path),
            None if name.split_once('.').is_some_and(|(section, _)| SECTIONS.contains(&section)) => ("vary", name),
            None => return Err(unknown(name)),
        };
        let all = toml::Table::try_from(self).map_err(|e| value(what, format!("\"{text}\""), e.to_string()))?;
        let mut failure = String::new();
        for candidate in candidates(text) {
            let mut all = all.clone();
            if !insert(&mut all, path, candidate) {
                return Err(unknown(name));
            }
            match all.try_into::<ShotFile>() {
                Ok(shot) => return Ok(shot),
                Err(e) => failure = e.message().to_owned(),
            }
        }
        if failure.starts_with("unknown field") {
            return Err(unknown(name));
        }
        let expected = failure.split_once(" is not ").or_else(|| failure.split_once("expected ")).map_or(&failure[..], |p| p.1);
        Err(value(what, format!("\"{text}\""), expected.trim().to_owned()))
    }
}

fn unknown(name: &str) -> ShotError {
    let flags = || VARIABLES.iter().map(|v| v.0).chain(DEVELOPING.iter().map(|d| d.0)).chain(["flicker", "preset"]);
    let known = flags().chain(VARIABLES.iter().map(|v| v.1)).chain(SETTINGS.iter().map(|s| s.name));
    let hint = nearest(name, known).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
    let all: Vec<&str> = flags().collect();
    let expected = format!("{}, a setting of `develop --settings`, or a key of the shot file{hint}", all.join(", "));
    value("vary", format!("\"{name}\""), expected)
}

/// What a text may stand for, in the order in which it is tried: a TOML value, a list without its brackets, text.
fn candidates(text: &str) -> impl Iterator<Item = toml::Value> {
    let read = |text: String| text.parse::<toml::Table>().ok().and_then(|mut t| t.remove("v"));
    // What follows a line break would be another key.
    let plain = !text.contains(['\n', '\r']);
    let bare = plain.then(|| read(format!("v = {text}"))).flatten();
    let list = (plain && text.contains(',')).then(|| read(format!("v = [{text}]"))).flatten();
    [bare, list, Some(toml::Value::String(text.to_owned()))].into_iter().flatten()
}

/// Sets the value at a path; settings that it takes the place of are removed. Whether there can be such a path.
fn insert(all: &mut toml::Table, path: &str, to: toml::Value) -> bool {
    let Some((folder, key)) = path.rsplit_once('.') else { return false };
    let mut table = all;
    for part in folder.split('.') {
        let next = table.entry(part).or_insert_with(|| toml::Value::Table(toml::Table::new()));
        match next.as_table_mut() {
            Some(next) => table = next,
            None => return false,
        }
    }
    let replaced: &[&str] = match path {
        "camera.focal_length" => &["zoom_position", "fov_deg"],
        "camera.zoom_position" => &["focal_length", "fov_deg"],
        "camera.fov_deg" => &["focal_length", "zoom_position"],
        "scene.daylight.sun" => &["time", "place"],
        "scene.daylight.time" | "scene.daylight.place" => &["sun"],
        "camera.lens" => &["calibration"],
        "camera.calibration" => &["lens"],
        "shutter.line_time" => &["readout"],
        "shutter.readout" => &["line_time"],
        // Times of another kind of shutter do not go with this one.
        "shutter.kind" if table.get("kind") != Some(&to) => &["travel", "line_time", "readout", "reset", "direction", "ramp"],
        _ => &[],
    };
    replaced.iter().for_each(|k| drop(table.remove(*k)));
    table.insert(key.to_owned(), to);
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::{FNumber, IsoChoice, LengthMm, Seconds, Size};

    #[test]
    fn every_name_stands_for_a_key_of_the_shot_file() {
        // (`[shot.sequence]` has only those that make no other number of pictures.)
        for (flag, path) in VARIABLES {
            // A value of no kind: numbers, lists and text are all refused, or it is text. An unknown key would be told.
            if let Err(e) = ShotFile::default().with(flag, "1") {
                let told = e.to_string();
                assert!(!told.contains("a key of the shot file"), "{flag} ({path}): {told}");
            }
        }
        for (flag, setting) in DEVELOPING {
            assert!(SETTINGS.iter().any(|s| s.name == setting), "{flag}");
        }
    }

    #[test]
    fn values_are_read_as_flags_read_them() {
        let with = |name: &str, text: &str| ShotFile::default().with(name, text).unwrap_or_else(|e| panic!("{name}={text}: {e}"));
        assert_eq!(with("aperture", "f/2.8").exposure.aperture, Some(FNumber(2.8)));
        assert_eq!(with("aperture", "2.8").exposure.aperture, Some(FNumber(2.8)));
        assert_eq!(with("shutter", "1/60").exposure.shutter, Some(Seconds(1.0 / 60.0)));
        assert_eq!(with("iso", "400").exposure.iso.and_then(IsoChoice::fixed), Some(400.0));
        assert_eq!(with("focal-length", "85 mm").camera.focal_length, Some(LengthMm(85.0)));
        assert_eq!(with("size", "48x32").render.size, Some(Size { width: 48, height: 32 }));
        assert_eq!(with("look-from", "0,1.5,-2").camera.look_from, Some([0.0, 1.5, -2.0]));
        assert_eq!(with("sun", "30,120").scene.daylight.unwrap().sun, Some([30.0, 120.0]));
        assert_eq!(with("shift", "0,5").camera.shift_mm, Some([0.0, 5.0]));
        assert_eq!(with("tilt", "4,0").camera.tilt_deg, Some([4.0, 0.0]));
        assert_eq!(with("shutter-angle", "90").sequence.shutter_angle_deg, Some(90.0));
        assert!(with("daylight", "2026-06-21T12:00+02:00").scene.daylight.unwrap().time.is_some());
        assert_eq!(with("flicker", "mains 50 Hz 0.8").scene.flicker[0].depth, Some(0.8));
        assert_eq!(with("viewpoint", "0").camera.viewpoint.as_deref(), Some("0"));
        assert_eq!(with("frozen", "true").scene.frozen, Some(true));
        assert_eq!(with("flash", "40").flash.unwrap().guide_number, 40.0);
        assert_eq!(with("camera.shake", "0.6").camera.shake, Some(0.6));
        assert_eq!(with("tone", "reinhard").develop, with("develop.tone.curve", "reinhard").develop);
        assert_eq!(with("gamma", "1.8").develop.value("output.encoding"), "gamma-1.8");
        assert_eq!(with("preset", "film").develop, Recipe::preset("film").unwrap());
    }

    #[test]
    fn what_takes_the_place_of_another_removes_it() {
        let shot = ShotFile::default().with("zoom-position", "2").unwrap().with("focal-length", "35mm").unwrap();
        assert_eq!((shot.camera.zoom_position, shot.camera.focal_length), (None, Some(LengthMm(35.0))));
        let shot = ShotFile::default().with("shutter-type", "rolling").unwrap().with("readout", "20ms").unwrap();
        assert_eq!(shot.with("shutter-type", "rolling").unwrap().shutter.readout, Some(Seconds(0.02)));
        assert_eq!(shot.with("shutter-type", "global").unwrap().shutter.readout, None);
    }

    #[test]
    fn wrong_names_and_values_are_told() {
        let told = |name: &str, text: &str| ShotFile::default().with(name, text).unwrap_err().to_string();
        let unknown = told("aperturre", "2");
        assert!(unknown.contains("did you mean \"aperture\"") && unknown.contains("focal-length"), "{unknown}");
        assert!(told("camera.colour", "2").contains("a key of the shot file"));
        let wrong = told("iso", "fast");
        assert!(wrong.starts_with("iso \"fast\"") && wrong.contains("ISO 400"), "{wrong}");
        assert!(told("spp", "many").contains("u32"), "{}", told("spp", "many"));
        assert!(told("tone", "steep").contains("reinhard"));
    }
}

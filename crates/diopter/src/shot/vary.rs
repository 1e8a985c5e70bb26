//! Settings of a shot by their names, to try several values of one.
//!
//! A name is that of a flag of `diopter shoot` without its dashes (`iso`, `focal-length`), of a setting of the development (`tone.curve`), or of a key
//! of the shot file (`camera.shake`).

use super::sections::{CameraSection, SceneSection};
use super::setting::Section;
use super::{ShotError, ShotFile, value};
use clap::{Args, Command, FromArgMatches};
use diopter_develop::{Recipe, SETTINGS};
use diopter_light::names::nearest;

/// Flags of the development, and the settings of the recipe that they stand for.
const DEVELOPING: [(&str, &str); 5] = [
    ("exposure-ev", "exposure.ev"),
    ("tone", "tone.curve"),
    ("demosaic", "demosaic.method"),
    ("lut", "lut.file"),
    ("gamma", "output.encoding"),
];

/// Names of settings that are no flags of [`ShotFile`], and the keys of the shot file that they stand for.
const OTHERS: [(&str, &str); 5] = [
    ("scene", "scene.file"),
    ("serial", "camera.serial"),
    ("temperature", "exposure.temperature_c"),
    // Of a film, what does not change how many pictures there are.
    ("fps", "sequence.fps"),
    ("shutter-angle", "sequence.shutter_angle_deg"),
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
        let flag = DEVELOPING.iter().find(|d| d.0 == name).map(|d| d.1);
        let setting = flag.unwrap_or(name.strip_prefix("develop.").unwrap_or(name));
        if SETTINGS.iter().any(|s| s.name == setting) {
            // "2.2" is short for "gamma-2.2", as the flag has it.
            let gamma = name == "gamma" && text.starts_with(|c: char| c.is_ascii_digit());
            shot.develop = shot.develop.with(setting, &if gamma { format!("gamma-{text}") } else { text.to_owned() })?;
            return Ok(shot);
        }
        match said(name, text)? {
            // A switch that is off.
            nothing if nothing == ShotFile::default() => shot.without(&said(name, "true")?),
            said => {
                shot.take_over(said);
                Ok(shot)
            }
        }
    }

    /// The same shot without what another says.
    fn without(&self, said: &ShotFile) -> Result<ShotFile, ShotError> {
        fn remove(from: &mut toml::Table, what: &toml::Table) {
            for (key, value) in what {
                match (from.get_mut(key), value) {
                    (Some(toml::Value::Table(from)), toml::Value::Table(what)) => remove(from, what),
                    _ => drop(from.remove(key)),
                }
            }
        }
        let table = |shot: &ShotFile| toml::Table::try_from(shot).map_err(|e| value("vary", "false", e.to_string()));
        let (mut all, mut what) = (table(self)?, table(said)?);
        what.retain(|section, _| SECTIONS.contains(&section));
        remove(&mut all, &what);
        all.try_into().map_err(|e: toml::de::Error| value("vary", "false", e.message()))
    }
}

/// Whether a setting, by its name and value, is of the scene or lights it.
pub fn is_of_scene(name: &str, text: &str) -> bool {
    said(name, text).is_ok_and(|said| said.scene != SceneSection::default() || said.flash.is_some())
}

/// A shot file that says one setting and nothing else: as the file writes it, or as the flag does.
fn said(name: &str, text: &str) -> Result<ShotFile, ShotError> {
    let other = OTHERS.iter().find(|other| other.0 == name || other.1 == name);
    let of_section = name.split_once('.').is_some_and(|(section, _)| SECTIONS.contains(&section));
    let (what, key) = match (other, key_of_flag(name)) {
        (Some((name, key)), _) => ((*name).to_owned(), (*key).to_owned()),
        (None, Some(key)) => (name.to_owned(), key),
        (None, None) if of_section => ("vary".to_owned(), name.to_owned()),
        (None, None) => return Err(unknown(name)),
    };
    let mut failure = String::new();
    for candidate in candidates(text) {
        let nested = key.rsplit('.').fold(candidate, |value, part| toml::Table::from_iter([(part.to_owned(), value)]).into());
        match nested.try_into::<ShotFile>() {
            Ok(said) => return Ok(said),
            Err(e) => failure = e.message().to_owned(),
        }
    }
    if failure.starts_with("unknown field") {
        return Err(unknown(name));
    }
    // An angle with its unit, a fraction, zones.
    let typed = flags().try_get_matches_from([format!("--{name}={text}")]);
    if let Ok(said) = typed.and_then(|matches| ShotFile::from_arg_matches(&matches)) {
        return Ok(said);
    }
    let expected = failure.split_once(" is not ").or_else(|| failure.split_once("expected ")).map_or(&failure[..], |p| p.1);
    Err(value(what, format!("\"{text}\""), expected.trim()))
}

fn flags() -> Command {
    ShotFile::augment_args(Command::new("shot").no_binary_name(true).disable_help_flag(true))
}

/// The key of the shot file that a flag stands for: clap names flags by their field, and knows those of a section without sections in it as a group.
fn key_of_flag(name: &str) -> Option<String> {
    let command = flags();
    let id = command.get_arguments().find(|flag| flag.get_long() == Some(name))?.get_id();
    // Where two sections have flags of one field, its name is the whole key.
    if id.as_str().contains('.') {
        return Some(id.to_string());
    }
    let of_group = |group: &str| command.get_groups().any(|g| g.get_id() == group && g.get_args().any(|arg| arg == id));
    let section = match GROUPS.iter().find(|(group, _)| of_group(group)) {
        Some((_, section)) => section,
        None if SceneSection::KEYS.contains(&id.as_str()) => "scene",
        None if CameraSection::KEYS.contains(&id.as_str()) => "camera",
        None => return None,
    };
    Some(format!("{section}.{id}"))
}

/// Groups of flags, and the sections that they are.
const GROUPS: [(&str, &str); 9] = [
    ("DaylightSection", "scene.daylight"),
    ("FogSection", "scene.fog"),
    ("PlenopticSection", "camera.plenoptic"),
    ("StabiliserSection", "camera.stabiliser"),
    ("ShutterSection", "shutter"),
    ("ExposureSection", "exposure"),
    ("FlashSection", "flash"),
    ("FocusSection", "focus"),
    ("RenderSection", "render"),
];

fn unknown(name: &str) -> ShotError {
    let command = flags();
    let names = || command.get_arguments().filter_map(|flag| flag.get_long());
    let flags = || names().chain(OTHERS.iter().map(|v| v.0)).chain(DEVELOPING.iter().map(|d| d.0)).chain(["preset"]);
    let known = flags().chain(OTHERS.iter().map(|v| v.1)).chain(SETTINGS.iter().map(|s| s.name));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::{FNumber, IsoChoice, LengthMm, Seconds, Size};

    #[test]
    fn every_name_stands_for_a_key_of_the_shot_file() {
        for (name, key) in OTHERS {
            // A value of no kind: numbers, lists and text are all refused, or it is text. An unknown key would be told.
            if let Err(e) = ShotFile::default().with(name, "1") {
                let told = e.to_string();
                assert!(!told.contains("a key of the shot file"), "{name} ({key}): {told}");
            }
        }
        for flag in flags().get_arguments().filter_map(|flag| flag.get_long()) {
            let key = key_of_flag(flag).unwrap_or_else(|| panic!("{flag}"));
            // A list of lists is the value of no setting but autofocus zones.
            if let Err(e) = ShotFile::default().with(flag, "[[1]]") {
                let told = e.to_string();
                assert!(!told.contains("a key of the shot file"), "{flag} ({key}): {told}");
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
        assert!(with("frozen", "true").scene.frozen);
        assert!(!with("frozen", "true").with("frozen", "false").unwrap().scene.frozen);
        assert_eq!(with("flash", "40").flash.unwrap().guide_number, Some(40.0));
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

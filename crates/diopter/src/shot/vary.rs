//! Settings of a shot by their names, to try several values of one.
//!
//! A name is that of a flag of `diopter shoot` without its dashes (`iso`, `focal-length`), of a setting of the development (`tone.curve`), or of a key
//! of the shot file (`camera.shake`).

use super::sections::{CameraSection, SceneSection};
use super::setting::Section;
use super::{ShotError, ShotFile, value};
use clap::{Args, Command, FromArgMatches, Id};
use diopter_develop::{Recipe, SETTINGS};
use diopter_light::names::{in_words, nearest};
use std::borrow::Cow;
use std::error::Error;
use std::sync::OnceLock;

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
        let setting = Named::new(name)?;
        let said = setting.said(text)?;
        // A switch that is off and an empty list say nothing by themselves; a table replaces all of a section.
        if said == ShotFile::default() || text.starts_with('{') {
            shot = shot.without(&setting)?;
        }
        shot.override_with(said);
        Ok(shot)
    }

    /// The same shot without what it says of a setting.
    fn without(&self, setting: &Named) -> Result<ShotFile, ShotError> {
        let failed = |reason: &str| value(setting.what.clone(), "is said", reason);
        let mut all = toml::Table::try_from(self).map_err(|e| failed(&e.to_string()))?;
        let (folder, key) = setting.key.rsplit_once('.').unwrap_or(("", &setting.key));
        let table = folder.split('.').try_fold(&mut all, |table, part| table.get_mut(part)?.as_table_mut());
        match table.and_then(|table| table.remove(key)) {
            Some(_) => all.try_into().map_err(|e: toml::de::Error| failed(e.message())),
            None => Ok(self.clone()),
        }
    }
}

/// Whether a setting is of the scene or lights it.
pub(crate) fn is_of_scene(name: &str) -> bool {
    Named::new(name).is_ok_and(|setting| ["scene.", "flash."].iter().any(|section| setting.key.starts_with(section)))
}

/// A setting by its name.
struct Named {
    /// How errors call it.
    what: Cow<'static, str>,
    key: Cow<'static, str>,
    /// Its flag, if it has one of [`ShotFile`].
    flag: Option<&'static str>,
}

impl Named {
    fn new(name: &str) -> Result<Named, ShotError> {
        if let Some((flag, key)) = flags().iter().find(|(flag, key)| flag == name || key == name) {
            return Ok(Named { what: flag.as_str().into(), key: key.as_str().into(), flag: Some(flag) });
        }
        if let Some((what, key)) = OTHERS.iter().find(|other| other.0 == name || other.1 == name) {
            return Ok(Named { what: (*what).into(), key: (*key).into(), flag: None });
        }
        match name.split_once('.').is_some_and(|(section, _)| SECTIONS.contains(&section)) {
            true => Ok(Named { what: "vary".into(), key: name.to_owned().into(), flag: None }),
            false => Err(unknown(name)),
        }
    }

    /// A shot file that says it and nothing else: as the file writes it, or as the flag does.
    fn said(&self, text: &str) -> Result<ShotFile, ShotError> {
        let mut failure = String::new();
        for candidate in candidates(text) {
            let nested = |value, part: &str| toml::Table::from_iter([(part.to_owned(), value)]).into();
            match self.key.rsplit('.').fold(candidate, nested).try_into::<ShotFile>() {
                Ok(said) => return Ok(said),
                Err(e) => failure = in_words(e.message()),
            }
        }
        if failure.starts_with("unknown field") {
            return Err(unknown(&self.key));
        }
        // An angle with its unit, a fraction, zones.
        if let Some(flag) = self.flag {
            match command().try_get_matches_from([format!("--{flag}={text}")]) {
                Ok(matches) => return ShotFile::from_arg_matches(&matches).map_err(|e| self.wrong(text, &e.to_string())),
                Err(e) => {
                    let reason = e.source().map_or_else(String::new, ToString::to_string);
                    if reason.contains(" is not ") {
                        failure = reason;
                    }
                }
            }
        }
        Err(self.wrong(
            text,
            failure.split_once(" is not ").or_else(|| failure.split_once("expected ")).map_or(&failure[..], |p| p.1),
        ))
    }

    fn wrong(&self, text: &str, expected: &str) -> ShotError {
        value(self.what.clone(), format!("\"{text}\""), expected.trim())
    }
}

/// The flags of a photograph.
fn command() -> Command {
    ShotFile::augment_args(Command::new("shot").no_binary_name(true).disable_help_flag(true))
}

/// All flags of a photograph, and the keys of the shot file that they stand for.
fn flags() -> &'static [(String, String)] {
    static FLAGS: OnceLock<Vec<(String, String)>> = OnceLock::new();
    FLAGS.get_or_init(|| {
        let command = command();
        let flags =
            command.get_arguments().filter_map(|flag| Some((flag.get_long()?.to_owned(), key_of(&command, flag.get_id())?)));
        flags.collect()
    })
}

/// The key that a flag stands for: clap names flags by their field, and knows those of a section without sections in it as a group.
fn key_of(command: &Command, id: &Id) -> Option<String> {
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
    let names = || flags().iter().map(|f| f.0.as_str()).chain(OTHERS.iter().map(|v| v.0));
    let names = || names().chain(DEVELOPING.iter().map(|d| d.0)).chain(["preset"]);
    let keys = flags().iter().map(|f| f.1.as_str()).chain(OTHERS.iter().map(|v| v.1));
    let known = names().chain(keys).chain(SETTINGS.iter().map(|s| s.name));
    let hint = nearest(name, known).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
    let all: Vec<&str> = names().collect();
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
        assert_eq!(flags().len(), command().get_arguments().filter_map(|flag| flag.get_long()).count());
        for (flag, key) in flags() {
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
        assert_eq!(with("fov", "40deg").camera.fov_deg, Some(40.0));
        assert_eq!(with("camera.fov_deg", "40deg").camera.fov_deg, Some(40.0));
        assert_eq!(with("flash-power", "1/4").flash.unwrap().power, Some(0.25));
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
    fn each_rule_of_what_takes_the_place_of_what_holds_both_ways() {
        let pairs = [
            ("lens", "thin", "camera", "a.yaml"),
            ("sun", "30,120", "place", "48,16"),
            ("sun", "30,120", "daylight", "2026-06-21T12:00+02:00"),
            ("line-time", "10us", "readout", "20ms"),
            ("fov", "60", "focal-length", "35mm"),
            ("fov", "60", "zoom-position", "2"),
        ];
        let with =
            |shot: &ShotFile, name: &str, text: &str| shot.with(name, text).unwrap_or_else(|e| panic!("{name}={text}: {e}"));
        for (a, of_a, b, of_b) in pairs {
            let none = ShotFile::default();
            assert_eq!(with(&with(&none, a, of_a), b, of_b), with(&none, b, of_b), "{b} over {a}");
            assert_eq!(with(&with(&none, b, of_b), a, of_a), with(&none, a, of_a), "{a} over {b}");
        }
        // What does not exclude each other stays.
        let day = with(&with(&ShotFile::default(), "turbidity", "3"), "sun", "30,120");
        assert_eq!(day.scene.daylight.as_ref().and_then(|d| d.turbidity), Some(3.0));
        // Switches and lists can be taken back.
        let shot = with(&ShotFile::default(), "flicker", "mains 50 Hz");
        assert_eq!(with(&shot, "scene.flicker", "[]").scene.flicker, []);
        let fog = with(&with(&shot, "fog", "40m"), "scene.fog", "{ albedo = 0.5 }").scene.fog.unwrap();
        assert_eq!((fog.visibility, fog.albedo), (None, Some(0.5)));
        assert!(!with(&with(&shot, "quick", "true"), "quick", "false").render.quick);
    }

    #[test]
    fn wrong_names_and_values_are_told() {
        let told = |name: &str, text: &str| ShotFile::default().with(name, text).unwrap_err().to_string();
        let unknown = told("aperturre", "2");
        assert!(unknown.contains("did you mean \"aperture\"") && unknown.contains("focal-length"), "{unknown}");
        assert!(told("camera.colour", "2").contains("a key of the shot file"));
        let wrong = told("iso", "fast");
        assert!(wrong.starts_with("iso \"fast\"") && wrong.contains("ISO 400"), "{wrong}");
        assert!(told("spp", "many").contains("1 to 16777216"), "{}", told("spp", "many"));
        assert!(told("tone", "steep").contains("reinhard"));
        // As flags say it, by their names and by their keys.
        assert!(told("flicker", "slow").contains("mains 50 Hz"), "{}", told("flicker", "slow"));
        assert!(told("exposure.iso", "fast").starts_with("iso \"fast\""));
        assert!(told("camera.fov_deg", "wide").contains("90deg"), "{}", told("camera.fov_deg", "wide"));
        assert!(told("camera.shaek", "1").contains("did you mean \"camera.shake\""));
    }
}

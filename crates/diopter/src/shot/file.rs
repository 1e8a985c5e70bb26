//! The shot file: a photograph as a user asks for it, in TOML.

use super::ShotError;
use super::sections::{
    CameraSection, ExposureSection, FlashSection, FocusSection, RenderSection, SceneSection, SequenceSection, ShutterSection,
};
use super::setting::Setting;
use super::sources::{is_lens_file, is_light_file};
use crate::files;
use crate::quantity::{FNumber, Iso, IsoChoice, Seconds};
use crate::stops;
use diopter_develop::Recipe;
use diopter_light::names::in_words;
use diopter_scene::builtin;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What a shot file says; everything may be left out. As [`clap::Args`]: the flags of a photograph.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct ShotFile {
    /// What is photographed.
    #[command(flatten)]
    pub scene: SceneSection,
    /// With what, from where.
    #[command(flatten)]
    pub camera: CameraSection,
    /// When which part of the film is open.
    #[command(flatten)]
    pub shutter: ShutterSection,
    /// How much light.
    #[command(flatten)]
    pub exposure: ExposureSection,
    /// Light of the camera's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[command(flatten)]
    pub flash: Option<FlashSection>,
    /// What is sharp.
    #[command(flatten)]
    pub focus: FocusSection,
    /// How it is computed.
    #[command(flatten)]
    pub render: RenderSection,
    /// How the raw image becomes a picture.
    #[arg(skip)]
    pub develop: Recipe,
    /// More than one picture.
    #[arg(skip)]
    pub sequence: SequenceSection,
    /// Where it goes.
    #[arg(skip)]
    pub output: OutputSection,
}

/// What is wrong with a text that is no shot file: files of other kinds are told by keys that shot files have not.
fn wrong_kind(text: &str, path: &str, parser: &str) -> String {
    let keys: toml::Table = toml::from_str(text).unwrap_or_default();
    let other = match (keys.contains_key("surfaces"), keys.contains_key("full_well_e") || keys.contains_key("pixels")) {
        (true, _) => Some(("lens", "--lens")),
        (_, true) => Some(("camera body", "--body")),
        _ => None,
    };
    match other {
        Some((kind, flag)) => {
            format!("this is the file of a {kind}; expected a shot file or a scene, and {flag} {path} beside it")
        }
        None if path == files::STANDARD_INPUT && toml::from_str::<toml::Table>(text).is_err() => {
            let expected = "expected one on standard input; a scene is given by the name of its file";
            format!("this is no shot file (TOML); {expected}: {}", parser.trim_end())
        }
        None => parser.trim_end().to_owned(),
    }
}

/// `[output]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputSection {
    /// Files to write; the ending says what.
    pub files: Vec<PathBuf>,
}

impl ShotFile {
    /// Takes what another says, such as flags, where it says something; settings that this takes the place of are removed. How pictures are developed and where they go
    /// stays.
    pub fn override_with(&mut self, said: ShotFile) {
        let ShotFile { scene, camera, shutter, exposure, flash, focus, render, sequence, .. } = said;
        if camera.lens.is_some() || camera.calibration.is_some() {
            (self.camera.lens, self.camera.calibration) = (None, None);
        }
        if camera.focal_length.is_some() || camera.zoom_position.is_some() || camera.fov_deg.is_some() {
            (self.camera.focal_length, self.camera.zoom_position, self.camera.fov_deg) = (None, None, None);
        }
        if let (Some(day), Some(said)) = (&mut self.scene.daylight, &scene.daylight) {
            if said.sun.is_some() {
                (day.time, day.place) = (None, None);
            }
            if said.time.is_some() || said.place.is_some() {
                day.sun = None;
            }
        }
        if shutter.kind.is_some() && shutter.kind != self.shutter.kind {
            // Times of another kind of shutter do not go with this one.
            self.shutter = ShutterSection::default();
        }
        if shutter.line_time.is_some() || shutter.readout.is_some() {
            (self.shutter.line_time, self.shutter.readout) = (None, None);
        }
        self.scene.override_with(scene);
        self.camera.override_with(camera);
        self.shutter.override_with(shutter);
        self.exposure.override_with(exposure);
        self.flash.override_with(flash);
        self.focus.override_with(focus);
        self.render.override_with(render);
        self.sequence.override_with(sequence);
    }

    /// Reads a shot file; paths in it are relative to it. Fails where the file cannot be read, on what is no TOML, and on keys that are not known or of another kind.
    pub fn read(path: &Path) -> Result<ShotFile, ShotError> {
        let place = path.display().to_string();
        let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        if text.trim().is_empty() {
            // What was cut short, or never arrived: not a shot with all its defaults.
            return Err(ShotError::Read { path: place, reason: "the file is empty".into() });
        }
        let mut shot: ShotFile = toml::from_str(&text)
            .map_err(|e| ShotError::Syntax { reason: wrong_kind(&text, &place, &in_words(&e.to_string())), path: place })?;
        shot.place_paths(path.parent().unwrap_or(Path::new("")));
        Ok(shot)
    }

    /// Makes the paths of a shot that was written in a folder independent of it.
    pub fn place_paths(&mut self, folder: &Path) {
        self.change_paths(|p| if p.is_absolute() { p.to_owned() } else { folder.join(p) });
    }

    /// Changes all that names a file. A new key that does so stands here, and nowhere else.
    fn change_paths(&mut self, change: impl Fn(&Path) -> PathBuf) {
        let (scene, camera) = (&mut self.scene, &mut self.camera);
        // Texts that may be names of something embedded.
        let texts = [
            scene.file.as_mut().filter(|f| !builtin::is_embedded(f)),
            scene.light.as_mut().filter(|l| is_light_file(l)),
            camera.body.as_mut().filter(|b| b.ends_with(".toml")),
            camera.lens.as_mut().filter(|l| is_lens_file(l)),
            Some(&mut self.develop.lut.file).filter(|f| !f.is_empty()),
        ];
        for text in texts.into_iter().flatten() {
            *text = change(Path::new(text.as_str())).display().to_string();
        }
        let paths = [
            &mut scene.environment,
            &mut scene.classes,
            &mut camera.aperture_image,
            &mut camera.calibration,
            &mut self.render.oidn,
        ];
        for path in paths.into_iter().flatten() {
            *path = change(path);
        }
    }

    /// Puts what engraved numbers stand for in their place, if that was asked for.
    pub(super) fn apply_true_stops(&mut self) {
        let e = &mut self.exposure;
        if !e.true_stops {
            return;
        }
        let dial = e.dial.as_deref().and_then(|d| stops::Step::NAMES.iter().find(|n| n.0 == d)).map(|n| n.1);
        e.aperture = e.aperture.map(|a| FNumber(stops::true_aperture(a.0, dial)));
        for time in [&mut e.shutter, &mut e.slowest] {
            *time = time.map(|s| Seconds(stops::true_time(s.0, dial)));
        }
        for iso in [&mut e.iso_min, &mut e.iso_max] {
            *iso = iso.map(|i| Iso(stops::true_speed(i.0, dial)));
        }
        e.iso = e.iso.map(|i| match i {
            IsoChoice::Fixed(iso) => IsoChoice::Fixed(Iso(stops::true_speed(iso.0, dial))),
            auto => auto,
        });
    }

    /// Makes the paths independent of where the shot file lies.
    pub fn make_paths_absolute(&mut self) {
        self.change_paths(|p| std::path::absolute(p).unwrap_or_else(|_| p.to_owned()));
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a shot file is plain data")
    }
}

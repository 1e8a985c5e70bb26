//! Rigs: several cameras on one frame, taken together, with the calibration of the whole and the truth of an inertial sensor.
//!
//! A [`Rig`] is a checked rig file. Its cameras share one scene, which is read and built once and lit once: surroundings that stand for a camera stand for the first one. The rig moves along
//! a smooth curve ([`path`]); each camera is a fixed place on it and is exposed by its own shutter, its trigger offset after the time of the frame. What comes out: files of each camera and
//! frame as data sets have them, [`calibration`] for other programs, and [`imu`] samples.
//!
//! Axes of the rig, of cameras and of the IMU before it is turned: x right, y up, z backward (what cameras look away from), m. Poses are computed in double precision; the renderer gets them
//! in single precision, 1e-7 of the distance from the scene's origin.

pub mod calibration;
mod file;
pub mod imu;
pub mod path;

pub use file::{CameraSection, FramesSection, ImuSection, KeySection, PathSection, RigFile, WriteSection};

use crate::calibration::PrincipalRay;
use crate::dataset::item::{self, File, Making, truth_channels};
use crate::expose::{ExposeError, ProgressReporter};
use crate::files;
use crate::moving_part;
use crate::npy;
use crate::quantity::{Distance, Seconds};
use crate::shake::Shake;
use crate::shot::{DEFAULT_SEED, Inputs, SceneCache, Shot, ShotError, ShotFile};
use calibration::{CameraOfRig, Picture, RigCalibration};
use diopter_light::names::{in_words, nearest};
use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};
use imu::{AxisNoise, Imu, STANDARD_GRAVITY};
use path::{Ends, Mounted, RigPath};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most frames of each camera, and most cameras.
const MOST_FRAMES: u32 = 1_000_000;
const MOST_CAMERAS: usize = 1000;
const FPS: f64 = 24.0;
/// Most samples of an IMU: half a gigabyte of text.
const MOST_SAMPLES: f64 = 2e6;

/// A camera of a rig.
#[derive(Clone, Debug)]
pub struct RigCamera {
    /// Its name, and that of its folder.
    pub name: String,
    /// Its shot: the common one with its own settings on top, placed at the first frame.
    pub shot: ShotFile,
    /// How it goes along with the rig.
    pub mounted: Arc<Mounted>,
    /// How long after the time of a frame its exposure begins, s.
    pub trigger_s: f64,
}

/// A checked rig file.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The cameras.
    pub cameras: Vec<RigCamera>,
    /// The path.
    pub path: Arc<RigPath>,
    /// Times of the frames, s.
    pub times_s: Vec<f64>,
    /// The inertial sensor.
    pub imu: Option<Imu>,
    imu_span: Option<[f64; 2]>,
    files: Vec<File>,
    formats: Vec<calibration::RigFormat>,
    common_metering: bool,
}

/// What was made.
#[derive(Clone, Debug)]
pub struct TakenRig {
    /// Files, relative to the folder.
    pub files: Vec<PathBuf>,
    /// Rms of the fits of the cameras' own models, px; `None` where the camera is a model itself.
    pub fit_rms_px: Vec<Option<f64>>,
}

/// Puts a file into the folder: its name relative to it, and its bytes.
pub type Save<'a> = dyn FnMut(&Path, &[u8]) -> Result<(), ShotError> + 'a;

impl Rig {
    /// Reads a rig file; paths in it are relative to it. Fails where the file cannot be read, and as [`Rig::new`].
    pub fn read(path: &Path) -> Result<Rig, ShotError> {
        let place = path.display().to_string();
        let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        Rig::new(&text, &place, path.parent().unwrap_or(Path::new("")))
    }

    /// Checks a rig. `place`: what it is called in errors; `folder`: what its paths are relative to. Fails on entries that are not known or out of range, without a
    /// camera, and on exposures outside a path that does not rest at its ends.
    pub fn new(text: &str, place: &str, folder: &Path) -> Result<Rig, ShotError> {
        let file: RigFile =
            toml::from_str(text).map_err(|e| ShotError::Syntax { path: place.to_owned(), reason: in_words(&e.to_string()) })?;
        let checks = Checks { place };
        let path = checks.path(&file.rig)?;
        let path = Arc::new(checks.shaken(&file.rig, path)?);
        let times_s = checks.times(&file.frames)?;
        let mut cameras: Vec<RigCamera> = Vec::new();
        for section in &file.camera {
            checks.camera(section, &file, &path, times_s[0], folder, &mut cameras)?;
        }
        if cameras.is_empty() {
            return Err(checks.entry("[[camera]]", "no camera".into(), "one or more, each with a name"));
        }
        if cameras.len() > MOST_CAMERAS {
            return Err(checks.entry("[[camera]]", cameras.len().to_string(), "at most 1000 cameras"));
        }
        let imu = file.imu.as_ref().map(|s| checks.imu(s)).transpose()?;
        let imu_span = file.imu.as_ref().and_then(|s| s.span).map(|s| s.map(|t| t.0));
        let known = File::names();
        let mut kinds = Vec::new();
        for name in file.write.files.as_deref().unwrap_or(&["jpg".into()]) {
            let kind = File::named(name).ok_or_else(|| {
                let hint = nearest(name, known.iter().map(String::as_str));
                let hint = hint.map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
                checks.entry("[write] files", format!("\"{name}\""), &format!("one of {}{hint}", known.join(", ")))
            })?;
            if kinds.contains(&kind) {
                return Err(checks.entry("[write] files", format!("\"{name}\" twice"), "each once"));
            }
            kinds.push(kind);
        }
        let formats = match &file.write.calibration {
            None => calibration::RigFormat::NAMES.iter().map(|n| n.1).collect(),
            Some(names) => names
                .iter()
                .map(|name| {
                    let all = calibration::RigFormat::NAMES;
                    all.iter().find(|n| n.0 == name).map(|n| n.1).ok_or_else(|| {
                        let expected = format!("one of {}", all.map(|n| n.0).join(", "));
                        checks.entry("[write] calibration", format!("\"{name}\""), &expected)
                    })
                })
                .collect::<Result<Vec<_>, _>>()?,
        };
        for camera in &mut cameras {
            camera.shot.render.truth_channels = truth_channels(camera.shot.render.truth_channels.as_deref(), &kinds);
        }
        let common_metering = file.frames.common_metering;
        let rig = Rig { cameras, path, times_s, imu, imu_span, files: kinds, formats, common_metering };
        rig.check_span(&checks)?;
        Ok(rig)
    }

    /// A path with free ends is known between them only.
    fn check_span(&self, checks: &Checks) -> Result<(), ShotError> {
        let [first, last] = self.path.span_s();
        let begins = |offset: f64| [self.times_s[0] + offset, self.times_s[self.times_s.len() - 1] + offset];
        for camera in &self.cameras {
            let [from, to] = begins(camera.trigger_s);
            if from < 0.0 {
                let expected = "an exposure that begins at 0 s or later: a later first frame, or a smaller trigger_offset";
                return Err(checks.entry(&format!("camera \"{}\"", camera.name), format!("an exposure at {from} s"), expected));
            }
            if !self.path.is_endless() && (from < first || to > last) {
                let found = format!("frames from {from} to {to} s on a path from {first} to {last} s");
                let expected = "frames within the path, or ends = \"rest\": with free ends there is no way outside";
                return Err(checks.entry(&format!("camera \"{}\"", camera.name), found, expected));
            }
        }
        Ok(())
    }

    /// Name of a frame: its number with as many digits as the last one has, six at least.
    fn key(&self, frame: usize) -> String {
        let digits = (self.times_s.len() - 1).to_string().len().max(6);
        format!("{frame:0digits$}")
    }

    /// The shots of the cameras: one scene, metered at the first frame, each ready for [`Rig::turn`]. Fails as [`Shot::prepare`], [`Shot::focus`] and [`Shot::meter`],
    /// naming the camera.
    pub fn shots(&self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<Vec<Shot>, ShotError> {
        let mut scenes = SceneCache::of_rig();
        let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
        let mut shots: Vec<Shot> = Vec::new();
        for camera in &self.cameras {
            let shot = self.shot(camera, shots.first(), &mut scenes, &quiet, warn);
            shots.push(shot.map_err(|e| e.of_shot(format!("camera {}", camera.name)))?);
        }
        Ok(shots)
    }

    /// The shot of a camera; `first`: that of the first one.
    fn shot(
        &self,
        camera: &RigCamera,
        first: Option<&Shot>,
        scenes: &mut SceneCache,
        watch: &ProgressReporter,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Shot, ShotError> {
        let inputs = Inputs { mounted: Some(camera.mounted.clone()), ..Default::default() };
        let mut told = |text: &str| warn(&format!("camera {}: {text}", camera.name));
        let mut shot = Shot::prepare_cached(&camera.shot, inputs, scenes, &mut told)?;
        shot.check_memory(item::memory_use(&self.files), None)?;
        item::warn_of_geometry(&shot, &self.files, &mut told);
        if let Some(first) = first {
            // A scene without a scale has one light for all.
            shot.copy_light_scale_from(first);
        }
        shot.focus(watch, &mut told)?;
        match first.and_then(|first| first.facts().metered_ev100).filter(|_| self.common_metering) {
            Some(ev) => shot.apply_meter_reading(Some(ev), &mut told)?,
            None => shot.meter(watch, &mut told)?,
        }
        let to_the_next_s = self.times_s.windows(2).map(|two| two[1] - two[0]).fold(f64::INFINITY, f64::min);
        let [first_s, last_s] = self.path.span_s();
        let total_s = shot.shutter().total_s();
        let ends_s = self.times_s[self.times_s.len() - 1] + camera.trigger_s + total_s;
        if !self.path.is_endless() && ends_s > last_s * (1.0 + 1e-9) {
            return Err(ShotError::Entry {
                place: "[rig]".into(),
                found: format!(
                    "a last frame that is exposed until {ends_s} s ({total_s} s long) on a path from {first_s} to {last_s} s"
                ),
                expected: "exposures within the path, or ends = \"rest\": with free ends there is no way outside".into(),
            });
        }
        let open_s = shot.shutter().exposure_s;
        if open_s > to_the_next_s * (1.0 + 1e-9) {
            told(&format!("each frame is open for {open_s:.4} s, and the next begins after {to_the_next_s:.4} s: they overlap"));
        }
        Ok(shot)
    }

    /// Makes the shot of a camera ready for a frame, exposed and focused as at the first: one calibration is that of all. Fails as [`Shot::advance_focused_to`], and on a camera or frame that the rig does not have.
    pub fn turn(&self, shot: &mut Shot, camera: usize, frame: usize, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let missing = |what: &str, number: usize, count: usize| ShotError::Entry {
            place: "[rig]".into(),
            found: format!("{what} {number}, counted from 0"),
            expected: format!("a number below {count}"),
        };
        let time_s = self.times_s.get(frame).ok_or_else(|| missing("frame", frame, self.times_s.len()))?;
        let mounted = self.cameras.get(camera).ok_or_else(|| missing("camera", camera, self.cameras.len()))?;
        shot.advance_focused_to(time_s + mounted.trigger_s, frame as u64, warn)
    }

    /// What is known of the cameras, for other programs. `shots`: as [`Rig::shots`] gives them. Fails where no model can be fitted to a lens.
    pub fn calibration<'a>(&'a self, shots: &'a [Shot]) -> Result<RigCalibration<'a>, ShotError> {
        let cameras = self.cameras.iter().zip(shots).map(|(camera, shot)| -> Result<_, ShotError> {
            let calibration = item::calibration(shot, &self.files, "")?;
            // Of the exposure that was metered; all others are like it.
            let middle = shot.calibration_frame("").middle().map_or(0.0, |p| p.time_s);
            let pictures = self.times_s.iter().enumerate().map(|(k, time_s)| {
                let moment_s = time_s + camera.trigger_s + middle;
                let picture = item::picture_name(&self.files, &self.key(k));
                Picture {
                    file: format!("{}/{picture}", camera.name),
                    stamp_s: *time_s,
                    moment_s,
                    world_from_camera: camera.mounted.place(moment_s),
                }
            });
            Ok(CameraOfRig {
                name: &camera.name,
                camera: &shot.camera,
                calibration,
                geometry: item::is_developed(&self.files).then(|| shot.geometry()),
                rig_from_camera: camera.mounted.rig_from_camera,
                trigger_s: camera.trigger_s,
                middle_s: middle,
                pictures: pictures.collect(),
            })
        });
        let cameras = cameras.collect::<Result<Vec<_>, _>>()?;
        Ok(RigCalibration { cameras, path: &self.path, imu: self.imu.as_ref(), which: PrincipalRay::CHIEF })
    }

    /// Takes all pictures and gives all files to `save`: the IMU's, then frame by frame, and in the end those that list the frames. `warn` gets what was found odd. What was given when it fails stays given.
    /// Fails as [`Rig::shots`] and `save`, on a span of the IMU outside the path or of too many samples, and with [`ExposeError::Cancelled`].
    pub fn take(&self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str), save: &mut Save) -> Result<TakenRig, ShotError> {
        let mut shots = self.shots(watch, warn)?;
        if item::is_developed(&self.files) {
            for (camera, shot) in self.cameras.iter().zip(&shots) {
                shot.check_development().map_err(|e| ShotError::Entry {
                    place: format!("camera \"{}\"", camera.name),
                    found: e.to_string(),
                    expected: "a development without it, or another lens".into(),
                })?;
            }
        }
        let mut files = Vec::new();
        let mut give = |name: &str, bytes: &[u8], files: &mut Vec<PathBuf>| -> Result<(), ShotError> {
            let path = PathBuf::from(name);
            save(&path, bytes)?;
            files.push(path);
            Ok(())
        };
        // Without a format nothing is fitted: panoramas have no model.
        let (texts, fit_rms_px) = if self.formats.is_empty() {
            (Default::default(), vec![None; shots.len()])
        } else {
            let known = self.calibration(&shots)?;
            let rms: Vec<Option<f64>> = known.cameras.iter().map(|c| c.calibration.fit.as_ref().map(|f| f.rms_px)).collect();
            (known.files(&self.formats)?, rms)
        };
        let last = self.times_s[self.times_s.len() - 1];
        let ends = self.cameras.iter().zip(&shots).map(|(c, shot)| last + c.trigger_s + shot.shutter().total_s());
        let end_s = ends.fold(last, f64::max);
        if let Some(imu) = &self.imu {
            let [begins, stops] = self.path.span_s();
            let known = |t: f64| self.path.is_endless() || (begins..=stops).contains(&t);
            let whole = [self.times_s[0], if known(end_s) { end_s } else { stops }];
            let [from, to] = self.imu_span.unwrap_or(whole);
            if !known(from) || !known(to) {
                let found = format!("{from} to {to} s on a path from {begins} to {stops} s");
                let expected = "a span within the path, or ends = \"rest\"".into();
                return Err(ShotError::Entry { place: "[imu] span".into(), found, expected });
            }
            if (to - from) * imu.rate_hz > MOST_SAMPLES {
                let found = format!("{:.0} samples", (to - from) * imu.rate_hz);
                return Err(ShotError::Entry { place: "[imu]".into(), found, expected: "at most two million".into() });
            }
            let samples = imu.samples(&self.path, from, to);
            give("imu0/data.csv", imu::euroc_imu(&samples, false).as_bytes(), &mut files)?;
            give("imu0/truth.csv", imu::euroc_imu(&samples, true).as_bytes(), &mut files)?;
            give("imu0/imu.yaml", imu.kalibr().as_bytes(), &mut files)?;
            give("state_groundtruth_estimate0/data.csv", imu::euroc_truth(&samples).as_bytes(), &mut files)?;
            give("imu0/imu.npy", &npy::array(&imu::table(&samples), [imu::COLUMNS, samples.len(), 1]), &mut files)?;
        }
        let total = (self.times_s.len() * self.cameras.len()) as f64;
        let mut moving = vec![String::new(); self.cameras.len()];
        for frame in 0..self.times_s.len() {
            for (k, shot) in shots.iter_mut().enumerate() {
                let camera = &self.cameras[k];
                let done = (frame * self.cameras.len() + k) as f64;
                let watch = ProgressReporter { cancel: watch.cancel, progress: &|x| (watch.progress)((done + x) / total) };
                // Its warnings are those of the first frame.
                self.turn(shot, k, frame, &mut |text| {
                    if frame == 0 {
                        warn(&format!("camera {}: {text}", camera.name));
                    }
                })?;
                let states = shot.moving_states();
                if !states.is_empty() {
                    let text = moving_part::csv(&states, self.times_s[frame] + camera.trigger_s);
                    let from = if frame == 0 { 0 } else { text.find('\n').map_or(0, |end| end + 1) };
                    moving[k].push_str(&text[from..]);
                }
                let exposed = shot.expose_from(None, &watch, None)?;
                if exposed.stopped {
                    return Err(ExposeError::Cancelled.into());
                }
                let plane = exposed.plane;
                let raw = if self.files.iter().any(|f| f.is_read_out()) { Some(shot.read_out(&plane)?) } else { None };
                let key = format!("{}/{}", camera.name, self.key(frame));
                let failed = |e: diopter_image::ImageError| ShotError::Read { path: key.clone(), reason: e.to_string() };
                let calibration_json = match self.files.contains(&File::Calibration) {
                    true => item::calibration_json(shot, &self.files, &self.key(frame))?,
                    false => String::new(),
                };
                for kind in &self.files {
                    let bytes = Making { shot, plane: &plane, raw: raw.as_ref(), calibration_json: &calibration_json }
                        .bytes(*kind, &failed)?;
                    give(&format!("{key}.{}", kind.name()), &bytes, &mut files)?;
                }
            }
        }
        for (camera, text) in self.cameras.iter().zip(&moving).filter(|(_, text)| !text.is_empty()) {
            give(&format!("{}/stabiliser.csv", camera.name), text.as_bytes(), &mut files)?;
        }
        // What lists pictures is there when they are.
        for (name, text) in texts {
            give(&name, text.as_bytes(), &mut files)?;
        }
        Ok(TakenRig { files, fit_rms_px })
    }
}

/// Says what is wrong where.
struct Checks<'a> {
    place: &'a str,
}

impl Checks<'_> {
    fn entry(&self, at: &str, found: String, expected: &str) -> ShotError {
        ShotError::Entry { place: format!("{}: {at}", self.place), found, expected: expected.to_owned() }
    }

    fn finite(&self, at: &str, what: &str, values: &[f64]) -> Result<(), ShotError> {
        match values.iter().all(|v| v.abs() <= 1e9) {
            true => Ok(()),
            false => Err(self.entry(at, format!("{what} = {values:?}"), "finite numbers, up to 1e9")),
        }
    }

    fn path(&self, s: &PathSection) -> Result<RigPath, ShotError> {
        let ends = match s.ends.as_deref() {
            None | Some("rest") => Ends::Rest,
            Some("free") => Ends::Free,
            Some(other) => return Err(self.entry("[rig] ends", format!("\"{other}\""), "rest or free")),
        };
        let aim = |at: &str, from: [f64; 3], to: Option<[f64; 3]>, up: Option<[f64; 3]>| {
            let to = to.or(s.look_at).ok_or_else(|| {
                self.entry(at, "no look_at".into(), "what the rig is aimed at: look_at = [x, y, z], here or in [rig]")
            })?;
            let up = up.or(s.up).unwrap_or([0.0, 1.0, 0.0]);
            self.finite(at, "look_from, look_at, up", &[from, to, up].concat())?;
            looking(from.into(), to.into(), up.into()).ok_or_else(|| {
                let found = format!("look_from {from:?}, look_at {to:?}, up {up:?}");
                self.entry(at, found, "a rig that is aimed at another place than its own, and not along up")
            })
        };
        if s.path.is_empty() {
            let from = s.look_from.ok_or_else(|| {
                self.entry(
                    "[rig]",
                    "neither look_from nor path".into(),
                    "where the rig stands: look_from and look_at, or [[rig.path]]",
                )
            })?;
            let keys = [(0.0, aim("[rig]", from, None, None)?)];
            return Ok(RigPath::new(&keys, ends).expect("one key"));
        }
        if s.look_from.is_some() {
            return Err(self.entry("[rig]", "look_from and path".into(), "one of them"));
        }
        let mut keys = Vec::new();
        for (k, key) in s.path.iter().enumerate() {
            let at = format!("[[rig.path]] {}", k + 1);
            if !(0.0..=4e7).contains(&key.time.0) {
                return Err(self.entry(&at, format!("time {}", key.time), "0 s to a year"));
            }
            keys.push((key.time.0, aim(&at, key.look_from, key.look_at, key.up)?));
        }
        if let Some(k) = keys.windows(2).position(|w| w[0].0 >= w[1].0) {
            let found = format!("time {} after {}", Seconds(keys[k + 1].0), Seconds(keys[k].0));
            return Err(self.entry(&format!("[[rig.path]] {}", k + 2), found, "times that rise"));
        }
        Ok(RigPath::new(&keys, ends).expect("times that rise"))
    }

    fn shaken(&self, s: &PathSection, path: RigPath) -> Result<RigPath, ShotError> {
        match s.shake {
            None => Ok(path),
            Some(rms) if (0.0..=1000.0).contains(&rms) => Ok(path.shaken(Shake::new(rms, s.shake_seed.unwrap_or(1)))),
            Some(rms) => Err(self.entry("[rig] shake", rms.to_string(), "0 to 1000 deg/s; a steady hand is 0.6")),
        }
    }

    fn times(&self, s: &FramesSection) -> Result<Vec<f64>, ShotError> {
        let (count, fps) = (s.count.unwrap_or(1), s.fps.unwrap_or(FPS));
        if !(1..=MOST_FRAMES).contains(&count) {
            return Err(self.entry("[frames] count", count.to_string(), "1 to 1000000"));
        }
        if !(fps > 0.0 && fps <= 1e7) {
            return Err(self.entry("[frames] fps", fps.to_string(), "above 0 frames a second"));
        }
        let first = s.first.map_or(0.0, |t| t.0);
        if !(0.0..=4e7).contains(&first) {
            return Err(self.entry("[frames] first", Seconds(first).to_string(), "0 s to a year"));
        }
        Ok((0..count).map(|k| first + f64::from(k) / fps).collect())
    }

    fn mount(&self, at: &str, position: [f64; 3], turn_deg: [f64; 3]) -> Result<DAffine3, ShotError> {
        self.finite(at, "position, turn_deg", &[position, turn_deg].concat())?;
        let [left, up, roll] = turn_deg.map(f64::to_radians);
        let turn = DQuat::from_euler(EulerRot::YXZ, left, up, roll);
        Ok(DAffine3::from_rotation_translation(turn, position.into()))
    }

    fn camera(
        &self,
        s: &CameraSection,
        file: &RigFile,
        path: &Arc<RigPath>,
        first_s: f64,
        folder: &Path,
        to: &mut Vec<RigCamera>,
    ) -> Result<(), ShotError> {
        let at = format!("camera \"{}\"", s.name);
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        const TAKEN: [&str; 3] = ["calibration", "imu0", "state_groundtruth_estimate0"];
        if TAKEN.contains(&s.name.as_str()) {
            let expected = "another name: the rig's own files lie in a folder of that name";
            return Err(self.entry(&at, format!("the name \"{}\"", s.name), expected));
        }
        if s.name.is_empty() || s.name.len() > 80 || !s.name.chars().all(plain) {
            return Err(self.entry(
                &at,
                format!("the name \"{}\"", s.name),
                "letters, digits, - and _, such as left (a folder of that name is made)",
            ));
        }
        let place = self.mount(&at, s.position, s.turn_deg)?;
        let trigger_s = s.trigger_offset.map_or(0.0, |t| t.0);
        if !(trigger_s.abs() <= 4e7) {
            return Err(self.entry(&at, format!("trigger_offset {}", Seconds(trigger_s)), "a time, such as \"2 ms\""));
        }
        let shot = self.shot(s, file, folder)?;
        let beside = |x: f64| place * DAffine3::from_translation(DVec3::X * x);
        let members = match s.baseline {
            None => vec![(s.name.clone(), place)],
            Some(Distance(b)) if b > 0.0 && b <= 1e6 => {
                vec![(format!("{}-left", s.name), beside(-0.5 * b)), (format!("{}-right", s.name), beside(0.5 * b))]
            }
            Some(b) => return Err(self.entry(&at, format!("baseline {b}"), "a distance above 0, such as \"12 cm\"")),
        };
        let before = to.len();
        let aim = file.rig.path.first().and_then(|k| k.look_at).or(file.rig.look_at).map(DVec3::from);
        for (name, rig_from_camera) in members {
            if to.iter().any(|c| c.name.eq_ignore_ascii_case(&name)) {
                return Err(self.entry(&at, format!("\"{name}\" twice"), "each camera with a name of its own"));
            }
            let mounted = Arc::new(Mounted { path: path.clone(), rig_from_camera });
            let mut shot = shot.clone();
            tell_apart(&mut shot, &s.shot, to.len(), to.len() - before);
            let stands = mounted.place(first_s);
            shot.scene.at = Some(Seconds(first_s));
            // Flow and motion are from one frame to the next.
            shot.sequence.fps = Some(file.frames.fps.unwrap_or(FPS));
            // What is sharp by default: as far as the rig's aim is from the camera, along its axis.
            shot.camera.look_from = Some(stands.translation.as_vec3().to_array());
            let far = aim.map_or(1.0, |aim| (aim - stands.translation).length()).max(1e-3);
            shot.camera.look_at = Some((stands.translation - stands.matrix3.z_axis * far).as_vec3().to_array());
            shot.camera.up = Some(stands.matrix3.y_axis.as_vec3().to_array());
            to.push(RigCamera { name, shot, mounted, trigger_s });
        }
        Ok(())
    }

    /// The shot of a camera: the common one with its own settings on top.
    fn shot(&self, s: &CameraSection, file: &RigFile, folder: &Path) -> Result<ShotFile, ShotError> {
        let at = format!("camera \"{}\"", s.name);
        for (table, whose) in [(&file.shot, "[shot]".to_owned()), (&s.shot, at.clone())] {
            for (key, why) in REFUSED {
                if find(table, key) {
                    return Err(self.entry(&whose, (*key).to_owned(), why));
                }
            }
        }
        if s.shot.contains_key("scene") {
            return Err(self.entry(&at, "scene".into(), "the scene in [shot.scene]: all cameras of a rig see the same"));
        }
        let mut merged = file.shot.clone();
        merge(&mut merged, &s.shot);
        let mut shot: ShotFile = merged.try_into().map_err(|e: toml::de::Error| ShotError::Syntax {
            path: format!("{}: {at}", self.place),
            reason: e.to_string().trim_end().to_owned(),
        })?;
        if shot.scene.fog.as_ref().is_some_and(|f| f.within.is_none()) {
            let expected =
                "within = [[x, y, z], [x, y, z]] beside it: without, fog ends where a camera sees no farther, elsewhere for each";
            return Err(self.entry("[shot.scene.fog]", "no within".into(), expected));
        }
        shot.place_paths(folder);
        Ok(shot)
    }

    fn imu(&self, s: &ImuSection) -> Result<Imu, ShotError> {
        let noise = [
            s.gyro_noise_density,
            s.gyro_random_walk,
            s.gyro_turn_on_bias,
            s.accel_noise_density,
            s.accel_random_walk,
            s.accel_turn_on_bias,
        ];
        if !(s.rate.0 > 0.0 && s.rate.0 <= 1e6) {
            return Err(self.entry("[imu] rate", s.rate.to_string(), "above 0 to 1 MHz, such as \"200 Hz\""));
        }
        if !noise.iter().all(|v| (0.0..=1e6).contains(v)) {
            return Err(self.entry("[imu]", format!("noise of {noise:?}"), "densities, random walks and biases of 0 or more"));
        }
        if let Some([from, to]) = s.span
            && !(from.0 <= to.0 && from.0.abs() <= 4e7 && to.0 <= 4e7)
        {
            return Err(self.entry("[imu] span", format!("{from} to {to}"), "two moments, the first one before the last"));
        }
        let gravity = s.gravity.unwrap_or([0.0, -STANDARD_GRAVITY, 0.0]);
        self.finite("[imu]", "gravity", &gravity)?;
        let axis = |density, random_walk, turn_on| AxisNoise { density, random_walk, turn_on };
        Ok(Imu {
            rate_hz: s.rate.0,
            rig_from_imu: self.mount("[imu]", s.position, s.turn_deg)?,
            gravity: gravity.into(),
            gyro: axis(s.gyro_noise_density, s.gyro_random_walk, s.gyro_turn_on_bias),
            accel: axis(s.accel_noise_density, s.accel_random_walk, s.accel_turn_on_bias),
            seed: s.seed.unwrap_or(1),
        })
    }
}

/// Settings of a shot that a rig says itself, or that one scene for all cannot have.
const REFUSED: &[(&str, &str)] = &[
    ("camera.look_from", "the place in [rig], and that of each camera on it as position and turn_deg"),
    ("camera.look_at", "the aim in [rig]"),
    ("camera.up", "up in [rig], and turn_deg of the camera"),
    ("camera.viewpoint", "the place in [rig]"),
    ("camera.path", "[[rig.path]]"),
    ("camera.shake", "a shake of the whole rig, to which its cameras are fixed: [rig] shake"),
    ("scene.at", "first in [frames]"),
    ("scene.frozen", "nothing: time runs for a rig"),
    ("sequence", "count and fps in [frames]"),
    ("camera.dual_pixel", "whole pixels: `shoot --dual-pixel` takes pairs of pictures"),
    ("output", "files in [write]"),
    ("flash", "lamps of the scene: flashes of several cameras in one scene are not made"),
    ("render.time_limit", "spp: pictures of a rig are to be alike"),
    ("render.samples", "spp: all samples are taken"),
];

/// Gives a camera noise and a specimen of its own: two cameras of a rig are two, each with other samples, other noise and another pattern of its pixels.
/// `own`: what is said of this camera or pair alone, which stays as it is but for the second one of a pair; `number`: of the camera in the rig, and `member`
/// of its pair, from 0.
fn tell_apart(shot: &mut ShotFile, own: &toml::Table, number: usize, member: usize) {
    let rank = |key: &str| if find(own, key) { member } else { number };
    let by = rank("render.seed") as u64;
    shot.render.seed = Some(shot.render.seed.unwrap_or(DEFAULT_SEED).wrapping_add(by));
    let by = rank("camera.serial");
    if by > 0 {
        shot.camera.serial = Some(match &shot.camera.serial {
            None => format!("{:06}", by + 1),
            Some(serial) => format!("{serial}-{}", by + 1),
        });
    }
}

fn find(table: &toml::Table, dotted: &str) -> bool {
    match dotted.split_once('.') {
        None => table.contains_key(dotted),
        Some((first, rest)) => table.get(first).and_then(toml::Value::as_table).is_some_and(|t| find(t, rest)),
    }
}

/// Puts the entries of one table over another's, table by table.
fn merge(to: &mut toml::Table, from: &toml::Table) {
    for (key, value) in from {
        match (to.get_mut(key), value) {
            (Some(toml::Value::Table(to)), toml::Value::Table(from)) => merge(to, from),
            _ => {
                to.insert(key.clone(), value.clone());
            }
        }
    }
}

/// World from something at a place that looks at another; `None` where that says no direction.
fn looking(from: DVec3, at: DVec3, up: DVec3) -> Option<DAffine3> {
    let z = (from - at).try_normalize()?;
    let across = up.normalize_or_zero().cross(z);
    let x = (across.length() > 1e-6).then(|| across.normalize())?;
    Some(DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation: from })
}

//! The clock of a shot: which moment, what moves, how the shutter runs, when the flash fires.

use super::file::ShotFile;
use super::sections::{FlickerSection, SceneSection};
use super::{ShotError, value};
use crate::camera::{Camera, look_at};
use crate::camera_motion::{CameraMotion, Stop, on_path};
use crate::flash::{Flash, SHOE_M, Sync};
use crate::moving_part::MovingPart;
use crate::quantity::Seconds;
use crate::rig::path::Mounted;
use crate::shake::Shake;
use crate::shutter::{Direction, Mechanism, RAMP_S, READOUT_S, Shutter, TRAVEL_S};
use crate::stabiliser::Stabiliser;
use crate::stops::time_name;
use diopter_lens::LensError;
use diopter_scene::light::Modulation;
use diopter_scene::motion::{AnimationPlayback, Extrapolation};
use diopter_scene::scene::Viewpoint;
use diopter_scene::{Description, Scene};
use diopter_sensor::{Sensor, nearest};
use glam::{Affine3A, DVec2, DVec3, Vec3};
use std::sync::Arc;

/// Pulse of a flash at full power: Nikon's SB-700, 1/1042 s (its manual).
const PULSE_S: f64 = 1.0 / 1042.0;
/// Most that a time may be, s: over a year.
pub(super) const LONGEST_S: f64 = 4e7;

/// When everything happens.
#[derive(Clone, Debug)]
pub(super) struct Timing {
    /// The exposure begins, s of scene time.
    pub at_s: f64,
    /// The first exposure of a sequence began.
    begun_s: f64,
    /// Nothing moves, the camera neither.
    frozen: bool,
    pub mechanism: Mechanism,
    pub flash: Option<Flash>,
    /// Node that carries the camera.
    pub carrier: Option<u32>,
    path: Vec<Stop>,
    /// How a rig carries the camera, instead of a path.
    pub mounted: Option<Arc<Mounted>>,
    shake: Option<Shake>,
    /// The last key of what runs, s, if nothing moves after it.
    end_s: Option<f64>,
}

fn time(what: &'static str, given: Option<Seconds>, default: f64) -> Result<f64, ShotError> {
    let t = given.map_or(default, |s| s.0);
    match (0.0..=LONGEST_S).contains(&t) {
        true => Ok(t),
        false => Err(value(what, Seconds(t), "a time from 0 s to a year (4e7 s)")),
    }
}

impl Timing {
    /// Checks the times of a shot; `view`: the scene's camera. Fails on times out of range, on names that are not known, and on settings of several kinds of shutter.
    pub fn new(file: &ShotFile, sensor: &Sensor, view: Option<&Viewpoint>) -> Result<Self, ShotError> {
        let at_s = time("at", file.scene.at, 0.0)?;
        let s = &file.shutter;
        let direction = match s.direction.as_deref() {
            None => Direction::default(),
            Some(name) => Direction::NAMES
                .iter()
                .find(|n| n.0 == name)
                .map(|n| n.1)
                .ok_or_else(|| value("shutter direction", format!("\"{name}\""), "down, up, right or left"))?,
        };
        // What only one kind has says which kind is meant.
        let implied = match () {
            () if [s.line_time.is_some() || s.readout.is_some() || s.reset.is_some(), s.travel.is_some(), s.ramp.is_some()]
                .iter()
                .filter(|g| **g)
                .count()
                > 1 =>
            {
                let found = "times of several kinds";
                return Err(value(
                    "shutter",
                    found,
                    "line_time, readout and reset (rolling), travel (focal-plane) or ramp (leaf)",
                ));
            }
            () if s.line_time.is_some() || s.readout.is_some() || s.reset.is_some() => "rolling",
            () if s.travel.is_some() => "focal-plane",
            () if s.ramp.is_some() => "leaf",
            () => "global",
        };
        let kind = s.kind.as_deref().unwrap_or(implied);
        if implied != "global" && kind != implied {
            let expected =
                format!("kind {implied}, or no times of a {implied} shutter beside it (line_time, readout, reset; travel; ramp)");
            return Err(value("shutter kind", format!("\"{kind}\""), expected));
        }
        if s.direction.is_some() && matches!(kind, "global" | "leaf") {
            return Err(value(
                "shutter direction",
                direction.name(),
                format!("a shutter that runs beside it (rolling or focal-plane), not {kind}"),
            ));
        }
        let mechanism = match kind {
            "global" => Mechanism::Global,
            "leaf" => Mechanism::Leaf { ramp_s: time("ramp", s.ramp, RAMP_S)? },
            "focal-plane" => Mechanism::FocalPlane { travel_s: time("travel", s.travel, TRAVEL_S)?, direction },
            "rolling" => {
                if s.line_time.is_some() && s.readout.is_some() {
                    return Err(value("readout", s.readout.unwrap_or(Seconds(0.0)), "either line_time or readout, not both"));
                }
                let size = super::scene_setup::film(file, sensor, view)?;
                let lines = if direction.is_vertical() { size.rows } else { size.columns } as f64;
                let readout_s = match s.line_time {
                    Some(_) => time("line_time", s.line_time, 0.0)? * lines,
                    None => time("readout", s.readout, READOUT_S)?,
                };
                let reset_s = match s.reset.as_deref() {
                    None | Some("rolling") => readout_s,
                    Some("global") => 0.0,
                    Some(other) => return Err(value("reset", format!("\"{other}\""), "rolling or global")),
                };
                Mechanism::Rolling { reset_s, readout_s, direction }
            }
            other => {
                let kinds = ["global", "leaf", "focal-plane", "rolling"];
                let expected = match nearest(other, kinds) {
                    Some(near) => format!("one of {} (did you mean \"{near}\"?)", kinds.join(", ")),
                    None => format!("one of {}", kinds.join(", ")),
                };
                return Err(value("shutter kind", format!("\"{other}\""), expected));
            }
        };
        let shake = match file.camera.shake {
            None => None,
            Some(rms) if (0.0..=1000.0).contains(&rms) => Some(Shake::new(rms, file.render.seed.unwrap_or(1))),
            Some(rms) => return Err(value("shake", rms, "0 to 1000 deg/s; a steady hand is 0.6")),
        };
        let frozen = file.scene.frozen;
        let (flash, path) = (flash(file)?, Vec::new());
        Ok(Timing { at_s, begun_s: at_s, frozen, mechanism, flash, carrier: None, path, mounted: None, shake, end_s: None })
    }

    /// Lays the camera's path; stops that are aimed at nothing look at `center`. Fails on times out of range and on stops that look nowhere.
    pub fn build_path(&mut self, file: &ShotFile, center: Vec3) -> Result<(), ShotError> {
        for stop in &file.camera.path {
            let aim = stop.look_at.or(file.camera.look_at).map_or(center, Vec3::from_array);
            let up = stop.up.or(file.camera.up).map_or(Vec3::Y, Vec3::from_array);
            let time_s = time("camera path time", Some(stop.time), 0.0)?;
            self.path.push(Stop { time_s, place: look_at(Vec3::from_array(stop.look_from), aim, up)? });
        }
        self.path.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(())
    }

    /// Chooses the animations that run. Fails on an animation that the scene does not have.
    pub fn play(&mut self, d: &mut Description, s: &SceneSection) -> Result<(), ShotError> {
        let names: Vec<String> = d.animations.iter().enumerate().map(|(i, a)| format!("{i} \"{}\"", a.name)).collect();
        let animations = match s.animation.as_deref() {
            None => d.playing.animations.clone(),
            Some("all") => (0..d.animations.len()).collect(),
            Some("none") => Vec::new(),
            Some(wanted) => {
                let found = d.animations.iter().position(|a| a.name == wanted);
                let found = found.or_else(|| wanted.parse().ok().filter(|i| *i < d.animations.len()));
                vec![found.ok_or_else(|| {
                    let expected = match names.is_empty() {
                        true => "none: the scene has no animations".to_owned(),
                        false => format!("all, none, or one of {}", names.join(", ")),
                    };
                    value("animation", format!("\"{wanted}\""), expected)
                })?]
            }
        };
        let ending = match s.animation_end.as_deref() {
            None => d.playing.ending,
            Some("clamp") => Extrapolation::Clamp,
            Some("loop") => Extrapolation::Loop,
            Some(other) => return Err(value("animation_end", format!("\"{other}\""), "clamp or loop")),
        };
        let last = animations.iter().map(|i| d.animations[*i].span_s()[1]).fold(f64::NEG_INFINITY, f64::max);
        self.end_s = (ending == Extrapolation::Clamp && last.is_finite()).then_some(last);
        let frozen_at_s = self.frozen.then_some(self.at_s);
        if frozen_at_s.is_some() {
            self.end_s = None;
        }
        d.playing = AnimationPlayback { animations, ending, frozen_at_s };
        Ok(())
    }

    /// The same for an exposure that begins at another moment.
    pub fn moved_to(&self, at_s: f64) -> Timing {
        Timing { at_s, ..self.clone() }
    }

    /// Takes over when the animations end that another clock of the same scene plays.
    pub fn keep_playing(&mut self, other: &Timing) {
        self.end_s = other.end_s;
    }

    /// Where the camera is during an exposure of a length, s; `placed`: where it stands (world from camera) if nothing moves it.
    pub fn camera_motion(&self, scene: &Scene, placed: Affine3A, total_s: f64) -> CameraMotion {
        let timeline = scene.description().timeline();
        let steady = |t: f64| -> Affine3A {
            if let Some(mounted) = &self.mounted {
                return mounted.at(self.at_s + t);
            }
            match (self.path.is_empty(), self.carrier) {
                (false, _) => on_path(&self.path, self.at_s + t),
                (true, Some(node)) => timeline.world(node, self.at_s + t),
                (true, None) => placed,
            }
        };
        if self.frozen {
            return CameraMotion::still(steady(0.0));
        }
        match &self.shake {
            // A shake turns about where the sequence began, not about where its sines are all 0.
            Some(shake) => {
                let first = shake.turn(self.begun_s).inverse();
                CameraMotion::sampled(total_s, |t| steady(t) * first * shake.turn(self.at_s + t))
            }
            None if self.path.is_empty() && self.carrier.is_none() && self.mounted.is_none() => CameraMotion::still(placed),
            None => CameraMotion::sampled(total_s, steady),
        }
    }

    /// Whether nothing moves or flickers, however long the exposure is.
    pub fn stands_still(&self, scene: &Scene) -> bool {
        let camera_moves = !self.path.is_empty() || self.mounted.is_some() || self.shake.is_some();
        !scene.flickers() && (self.frozen || !camera_moves && scene.description().animations.is_empty())
    }

    /// Whether the camera shakes.
    pub fn shakes(&self) -> bool {
        self.shake.is_some() || self.mounted.as_ref().is_some_and(|mounted| mounted.path.shake().is_some())
    }

    /// What moves in a camera against its shake during an exposure of a length, s. Fails on a group that the lens does not have.
    pub fn moving_part(&self, stabiliser: &Stabiliser, camera: &Camera, total_s: f64) -> Result<MovingPart, LensError> {
        let answered = |t: f64| -> DVec2 {
            match (&self.mounted, &self.shake) {
                // A shake of a rig turns about the axes of the rig.
                (Some(mounted), _) => {
                    let angles = mounted.path.shake().map_or(DVec3::ZERO, |shake| stabiliser.answered(shake, self.at_s + t));
                    (mounted.rig_from_camera.matrix3.transpose() * angles).truncate()
                }
                // As the shake itself, from where it was when the sequence began.
                (None, Some(shake)) if !self.frozen => {
                    let at = |t: f64| stabiliser.answered(shake, t);
                    (at(self.at_s + t) - at(self.begun_s)).truncate()
                }
                _ => DVec2::ZERO,
            }
        };
        stabiliser.during(camera, total_s, answered)
    }

    /// Says when a flash that burns between two moments, s, does not reach all of the picture (`all`).
    pub fn warn_of_sync(&self, shutter: &Shutter, (from, to): (f64, f64), all: bool, warn: &mut dyn FnMut(&str)) {
        if all {
            return;
        }
        let n = 1000;
        let seen = (0..n)
            .filter(|i| {
                let size = [n, n];
                let place = crate::shutter::Place { pixel: [*i, *i], size, pupil: 0.0 };
                let (open, close) = shutter.window(&place);
                open < to && close > from
            })
            .count();
        let (from, to) = ((from * 1e5).round() / 100.0, (to * 1e5).round() / 100.0);
        let time = time_name(shutter.exposure_s);
        warn(&match seen == n {
            // It burns longer than the shutter is open.
            true => format!(
                "the flash ({from} to {to} ms) is not over before parts of the picture close at {time}: these see less of it; \
                 take a longer time, or a shorter --flash-pulse"
            ),
            false => format!(
                "the flash ({from} to {to} ms) does not find the whole picture open at {time}: about {:.0} % of it sees all or some of it; \
                 take a longer time, or --flash-sync high-speed",
                100.0 * seen as f64 / n as f64
            ),
        });
    }

    /// Says when things turn too often for what is kept of their ways.
    pub fn warn_of_coarse(scene: &Scene, warn: &mut dyn FnMut(&str)) {
        if scene.motion_is_coarse() {
            warn(
                "what moves does so too often in this exposure to be followed: its way is drawn in straight pieces that are too long",
            );
        }
    }

    /// Says when the shutter is open longer than the animation runs.
    pub fn warn_of_end(&self, scene: &Scene, total_s: f64, warn: &mut dyn FnMut(&str)) {
        if let Some(end) = self.end_s.filter(|e| scene.moves() && self.at_s + total_s > e + 1e-9) {
            warn(&format!(
                "the exposure ({} to {} s) lasts beyond the end of the animation at {end} s: all stands still from there \
                 (--animation-end loop begins it anew)",
                self.at_s,
                self.at_s + total_s
            ));
        }
    }
}

fn flash(file: &ShotFile) -> Result<Option<Flash>, ShotError> {
    let Some(f) = &file.flash else { return Ok(None) };
    let Some(guide_number) = f.guide_number else {
        return Err(value("flash", "is not fired", "a guide number (--flash GN) beside its power, pulse, sync or offset"));
    };
    if !(guide_number > 0.0 && guide_number <= 10_000.0) {
        return Err(value("flash guide_number", guide_number, "above 0 to 10000: f-number × metres at ISO 100"));
    }
    let power = f.power.unwrap_or(1.0);
    if !(power > 0.0 && power <= 1.0) {
        return Err(value("flash power", power, "a fraction of full power, above 0 to 1"));
    }
    let pulse_s = time("flash pulse", f.pulse, PULSE_S)?;
    if pulse_s < 1e-7 {
        return Err(value("flash pulse", Seconds(pulse_s), "0.1 µs or more"));
    }
    let sync = match f.sync.as_deref() {
        None => Sync::First,
        Some(name) => {
            Sync::named(name).ok_or_else(|| value("flash sync", format!("\"{name}\""), "first, second or high-speed"))?
        }
    };
    let offset_m = Vec3::from_array(f.offset.unwrap_or(SHOE_M));
    if !(offset_m.is_finite() && offset_m.length() < 1e4) {
        return Err(value("flash offset", offset_m, "metres from the lens"));
    }
    Ok(Some(Flash { guide_number, power, pulse_s, sync, offset_m }))
}

/// Makes lamps flicker.
pub(super) fn add_flicker(d: &mut Description, flicker: &[FlickerSection]) -> Result<(), ShotError> {
    for f in flicker {
        let phase = f.phase_deg.unwrap_or(0.0);
        let frequency = f.frequency.map(|h| h.0);
        let hertz = |default: f64| match frequency.unwrap_or(default) {
            v if v > 0.0 && v <= 1e7 && phase.is_finite() => Ok(v),
            v => Err(value("flicker frequency", format!("{v} Hz"), "above 0 to 10 MHz")),
        };
        let modulation = match f.kind.as_str() {
            "mains" => {
                let depth = f.depth.unwrap_or(0.5);
                if !(0.0..=1.0).contains(&depth) {
                    return Err(value("flicker depth", depth, "0 to 1"));
                }
                Modulation::Sine { frequency_hz: 2.0 * hertz(50.0)?, depth, phase: phase.to_radians() }
            }
            "pwm" => {
                let duty = f.duty.unwrap_or(0.5);
                if !(duty > 0.0 && duty <= 1.0) {
                    return Err(value("flicker duty", duty, "above 0 to 1"));
                }
                Modulation::Pwm { frequency_hz: hertz(240.0)?, duty, phase: phase / 360.0 }
            }
            "" => return Err(value("flicker kind", "is missing", "kind = \"mains\" or \"pwm\"")),
            other => return Err(value("flicker kind", format!("\"{other}\""), "mains or pwm")),
        };
        let meant = |name: &str| f.lamp.as_deref().is_none_or(|l| l == name);
        let by_object: Vec<u32> = d.objects.iter().filter(|o| f.lamp.is_some() && meant(&o.name)).map(|o| o.material).collect();
        let mut found = 0;
        for (i, material) in d.materials.iter_mut().enumerate() {
            if let Some(emission) = &mut material.emission
                && (meant(&material.name) || by_object.contains(&(i as u32)))
            {
                emission.modulation = modulation;
                found += 1;
            }
        }
        for light in d.punctual.iter_mut().filter(|l| meant(&l.name)) {
            light.modulation = modulation;
            found += 1;
        }
        if found == 0 {
            let lamps: Vec<&str> = d
                .materials
                .iter()
                .filter(|m| m.emission.is_some())
                .map(|m| m.name.as_str())
                .chain(d.punctual.iter().map(|l| l.name.as_str()))
                .collect();
            let expected = match lamps.is_empty() {
                true => "a scene with lamps: an environment does not flicker".to_owned(),
                false => format!("one of {}", lamps.join(", ")),
            };
            return Err(value("flicker lamp", format!("\"{}\"", f.lamp.as_deref().unwrap_or("")), expected));
        }
    }
    Ok(())
}

//! Exposure control: metering, the settings that come of it, and the moment.

use super::sequence::Vary;
use super::timing::{LONGEST_S, Timing};
use super::{DEFAULT_SEED, Shot, ShotError, lens_facts, long_time, value, wants_profile, white_point};
use crate::camera_motion::CameraMotion;
use crate::expose::ProgressReporter;
use crate::flash::{Flash, Sync};
use crate::metering::{Meter, Pattern};
use crate::program::{Chosen, Limits, Mode};
use crate::shutter::{Mechanism, Shutter, ShutterTimes};
use crate::{metering, program, stops};
use diopter_image::{ExposureFacts, FocalPlane};
use diopter_scene::light::Modulation;
use std::sync::Arc;
use std::time::Instant;

/// Smallest aperture that the camera chooses by itself, as most lenses for 35 mm have it.
const SMALLEST_STOP: f64 = 22.0;
/// Times that a dial has, s.
const DIAL_TIMES_S: [f64; 2] = [1.0 / 8192.0, 32.0];
/// Rounds in which an aperture and the effective time of a leaf shutter behind it come to agree.
const EFFECTIVE_ROUNDS: usize = 30;
/// A time that the camera chooses is said to be long from here on, s: the longest that cameras for 35 mm time by themselves.
const LONG_S: f64 = 30.0;

impl Shot {
    /// Takes over the scale of the light from another shot of the same scene, so that both see the same light whatever their frames are.
    pub fn copy_light_scale_from(&mut self, other: &Shot) {
        if other.light_settled || self.ambient_ev.is_none() {
            self.settings.light_scale = other.settings.light_scale;
            self.light_settled = true;
        }
    }

    /// Meters the scene and settles what was left open: light scale, exposure time, aperture, ISO. Then everything stands ready for
    /// the exposure. `warn` gets what the light or the shutter does not allow. Fails where it is cancelled, and where the lens cannot be set.
    pub fn meter(&mut self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.lens_cap {
            return self.apply_meter_reading(None, warn);
        }
        self.find_light_scale(watch)?;
        let white = white_point(&self.reading.white)?;
        let metered = self.light_meter().read(&self.scene, &self.camera, &self.settings, &white, watch)?;
        self.apply_meter_reading(metered, warn)
    }

    fn light_meter(&self) -> Meter<'_> {
        Meter {
            sensor: &self.sensor,
            reading: &self.reading,
            pattern: self.exposing.pattern,
            at: self.exposing.at,
            filter: (-self.exposing.nd_stops).exp2(),
        }
    }

    /// Whether the meter can be read off the exposure itself ([`Shot::meter_by`]): radiance of what stands still is the same whatever time it is exposed for, and here the camera chooses no aperture.
    /// All samples must be taken at once, and pixels and paths be at least as many as the meter's: parts of an exposure are exposed alike.
    pub fn can_meter_by_exposure(&self) -> bool {
        let film = &self.camera.film;
        self.radiance
            && self.spectral.is_none()
            && self.exposing.mode == Mode::AperturePriority
            && self.exposing.pattern != Pattern::Spot
            && self.settings.is_whole()
            && self.settings.time_limit_s.is_none()
            && metering::is_enough(&self.camera, self.settings.spp)
            && !self.lens_cap
            && !self.file.render.quick
            && film.microlenses.is_none()
            && !self.sensor.cfa.tells_polarization()
            && self.settings.polarizer.is_none()
            && self.timing.flash.is_none()
            && self.timing.stands_still(&self.scene)
            && self.stabiliser.is_none()
    }

    /// Makes the shot ready to be exposed before it is metered: [`Shot::can_meter_by_exposure`] must hold. Until [`Shot::meter_by`] the time is a second. Fails as [`Shot::meter`].
    pub fn prepare_to_meter_by_exposure(
        &mut self,
        watch: &ProgressReporter,
        warn: &mut dyn FnMut(&str),
    ) -> Result<(), ShotError> {
        self.find_light_scale(watch)?;
        self.shutter = Some(1.0);
        self.prepare_exposure(warn)
    }

    /// Meters by the exposure of a shot that [`Shot::prepare_to_meter_by_exposure`] made ready, settles what was left open, and writes it into the plane's facts. Fails as [`Shot::meter`].
    pub fn meter_by(
        &mut self,
        plane: &mut FocalPlane,
        watch: &ProgressReporter,
        warn: &mut dyn FnMut(&str),
    ) -> Result<(), ShotError> {
        let white = white_point(&self.reading.white)?;
        let metered = self.light_meter().read_radiance(plane, &self.scene, &self.camera, &self.settings, &white, watch)?;
        self.apply_meter_reading(metered, warn)?;
        let ExposureFacts { exposure_s, iso_set, metering, metered_ev100, shutter, .. } = self.plane_facts();
        plane.facts = ExposureFacts { exposure_s, iso_set, metering, metered_ev100, shutter, ..plane.facts.clone() };
        Ok(())
    }

    /// Whether the camera chooses an aperture, a time or an ISO speed by its meter.
    pub fn chooses_exposure(&self) -> bool {
        self.exposing.mode != Mode::Manual || self.exposing.auto_iso.is_some()
    }

    /// The same as [`Shot::meter`], but where everything is set by hand the meter is not read: nothing depends on it but its fact, which is left out. Fails as it does.
    pub fn meter_if_needed(&mut self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.chooses_exposure() {
            return self.meter(watch, warn);
        }
        self.find_light_scale(watch)?;
        self.apply_meter_reading(None, warn)?;
        self.facts.metering = String::new();
        Ok(())
    }

    /// Chooses what the camera is to choose by a meter reading (EV at ISO 100; `None`: darkness), and makes everything ready for the exposure:
    /// [`Shot::meter`] by a reading at hand. With the cap on the lens the reading is not looked at. Fails where the lens cannot be set.
    pub fn apply_meter_reading(&mut self, metered: Option<f64>, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.lens_cap {
            self.shutter.get_or_insert(1.0);
            return self.prepare_exposure(warn);
        }
        self.facts.metering = self.exposing.pattern.name().into();
        self.facts.metered_ev100 = metered;
        let e = self.exposing.clone();
        let chosen_by_camera = self.chooses_exposure();
        // Behind microlenses the light is gathered on a part of the pixels: they must not be blown, and are brightened when developed.
        self.baseline_ev = e.baseline_ev.unwrap_or(if chosen_by_camera { self.gathered_ev() } else { 0.0 });
        // Without any light any exposure will do.
        let ev100 = metered.unwrap_or(0.0) - e.compensation_ev + self.baseline_ev;
        if chosen_by_camera {
            let (mut limits, set) = (self.limits(), self.set());
            let mut chosen = program::choose(e.mode, ev100, set, &limits);
            if limits.step.is_some() && matches!(e.mode, Mode::AperturePriority | Mode::Program) {
                // The dial clicks marked times.
                let pupil = self.pupil_at(chosen.aperture);
                let marked_s = self.shutter().marked_for(chosen.time_s, pupil);
                limits.beyond_mark_s = self.shutter_of(marked_s).effective_s(pupil) - marked_s;
                chosen = program::choose(e.mode, ev100, set, &limits);
            }
            // The time that is set by hand is the marked one; what it lets through follows from the aperture that is chosen for it.
            if matches!(e.mode, Mode::Manual | Mode::ShutterPriority) {
                for _ in 0..EFFECTIVE_ROUNDS {
                    let time_s = self.shutter().effective_s(self.pupil_at(chosen.aperture));
                    chosen = Chosen { time_s: set.time_s, ..program::choose(e.mode, ev100, Chosen { time_s, ..set }, &limits) };
                }
            }
            if (chosen.aperture / set.aperture - 1.0).abs() > 1e-9 {
                self.set_t_number(chosen.aperture)?;
            }
            // The effective time of a leaf shutter is longer than its marked time for a small pupil.
            let pupil = self.pupil();
            let marked = match e.mode {
                Mode::AperturePriority | Mode::Program => self.shutter().marked_for(chosen.time_s, pupil),
                _ => chosen.time_s,
            };
            self.shutter = Some(marked);
            self.reading.iso = chosen.iso;
            let effective_s = self.shutter().effective_s(pupil);
            let off = ev100 - metering::ev100_of_setting(chosen.aperture, effective_s, chosen.iso);
            // A dial rounds by half its step.
            let rounding = limits.step.map_or(0.0, |step| 0.5 / f64::from(step.per_ev()));
            if metered.is_some() && off.abs() > (rounding + 0.05).max(0.34) {
                warn(&format!(
                    "the light is {:.1} EV too {} for what the camera may choose in mode {}: the picture will be {}",
                    off.abs(),
                    if off > 0.0 { "bright" } else { "dark" },
                    e.mode.name(),
                    if off > 0.0 { "light" } else { "dark" }
                ));
            }
            let chosen_time = matches!(e.mode, Mode::AperturePriority | Mode::Program);
            if let Some(ev) = metered.filter(|_| chosen_time && marked > 1.1 * LONG_S) {
                let scene = &self.file.scene;
                // A picture around the scene is light enough, if its numbers are no cd/m².
                let relative = scene.environment.is_some() && scene.environment_scale.is_none() && scene.ambient_ev.is_none();
                let hint = match relative {
                    true => {
                        "the numbers of --environment count as cd/m²: if they are relative, give the file as --light, or say how bright it is by --ambient-ev 12"
                    }
                    false => {
                        "give the scene light (--light studio, --sun 30,120, --light FILE.hdr or --flash 40), open the lens, or take --iso auto"
                    }
                };
                warn(&format!(
                    "there is little light (EV {ev:.1}): mode {} takes {}, longer than cameras choose by themselves ({LONG_S} s); {hint}",
                    e.mode.name(),
                    long_time(marked)
                ));
            }
        }
        self.prepare_exposure(warn)?;
        self.keep_to_time_limit(warn);
        Ok(())
    }

    /// What is set by hand, apertures as T-stops.
    pub(super) fn set(&self) -> Chosen {
        Chosen { aperture: self.facts.t_number, time_s: self.shutter.unwrap_or(1.0 / 125.0), iso: self.reading.iso }
    }

    pub(super) fn limits(&self) -> Limits {
        let e = &self.exposing;
        let loss = self.facts.t_number / self.facts.f_number;
        let (widest, smallest) = (self.camera.lens.widest_f_number(), SMALLEST_STOP);
        let handheld_s = e.slowest_s.unwrap_or(1.0 / self.facts.focal_length_35mm_mm.max(1.0));
        let times_s: [f64; 2] = if e.dials { DIAL_TIMES_S } else { [1e-7, 1e6] };
        let sync_s = self.sync_s();
        // Of light: where all rows are reset at once it comes in while they are read, too.
        let beyond_s = self.shutter_of(0.0).rows_beyond_s();
        Limits {
            aperture: [widest * loss, smallest.max(widest) * loss],
            time_s: times_s.map(|t| t.max(sync_s) + beyond_s),
            iso: e.auto_iso.unwrap_or([self.reading.iso; 2]),
            handheld_s,
            step: e.step,
            beyond_mark_s: beyond_s,
            t_per_f: loss,
        }
    }

    /// The shortest time that cameras with curtains choose beside a flash, s: all of the picture is open while it burns (X-sync); on a dial the next longer mark. 0
    /// without a flash, and where it burns all the time.
    fn sync_s(&self) -> f64 {
        let (Mechanism::FocalPlane { travel_s, .. }, Some(flash)) = (self.timing.mechanism, &self.timing.flash) else {
            return 0.0;
        };
        if flash.sync == Sync::HighSpeed {
            return 0.0;
        }
        let least = travel_s + flash.pulse_s;
        let marks = self.exposing.step.map_or(Vec::new(), stops::times);
        let longer = marks.iter().map(|mark| mark.value).filter(|t| *t >= least * (1.0 - 1e-9));
        longer.reduce(f64::min).unwrap_or(least)
    }

    /// Sets the lens to another T-stop.
    pub(super) fn set_t_number(&mut self, t_number: f64) -> Result<(), ShotError> {
        // By rounding a lens fully open could be asked for more than that.
        let widest = self.limits().aperture[0];
        self.camera.lens = self.camera.lens.stopped(self.f_number_of(t_number.max(widest)))?;
        self.update_lens_facts();
        Ok(())
    }

    /// Writes into the facts what follows from how the lens is set.
    pub(super) fn update_lens_facts(&mut self) {
        let new = lens_facts(&self.camera, &self.sensor, wants_profile(&self.file, self.draft));
        let f = &mut self.facts;
        (f.f_number, f.t_number, f.lens_profile) = (new.f_number, new.t_number, new.lens_profile);
        (f.focus_distance_m, f.extension_mm, f.light_field) = (new.focus_distance_m, new.extension_mm, new.light_field);
    }

    /// How much brighter the images of the pupil behind microlenses are than the film would be, EV; 0 without.
    pub(super) fn gathered_ev(&self) -> f64 {
        let fraction = self.camera.film.microlenses.map(|m| m.concentration(&self.camera.lens));
        fraction.map_or(0.0, |s| s.log2().max(0.0))
    }

    /// Radius of the pupil, 1 when the lens is fully open.
    pub(super) fn pupil(&self) -> f64 {
        self.pupil_at(self.facts.t_number)
    }

    fn pupil_at(&self, t_number: f64) -> f64 {
        (self.camera.lens.widest_f_number() / self.f_number_of(t_number)).min(1.0)
    }

    /// The shutter as it is set.
    pub fn shutter(&self) -> Shutter {
        self.shutter_of(self.shutter.unwrap_or(1.0))
    }

    /// The shutter set to a time, s.
    fn shutter_of(&self, exposure_s: f64) -> Shutter {
        Shutter { mechanism: self.timing.mechanism, exposure_s }
    }

    /// Where the camera is, and what moves in it, during an exposure of a length, s.
    pub(super) fn camera_motion(&self, timing: &Timing, total_s: f64) -> Result<CameraMotion, ShotError> {
        let carried = timing.camera_motion(&self.scene, self.placed, total_s);
        match &self.stabiliser {
            None => Ok(carried),
            Some(stabiliser) => Ok(carried.with_moving(Arc::new(timing.moving_part(stabiliser, &self.camera, total_s)?))),
        }
    }

    /// Poses the scene and the camera for the exposure, and sets the flash.
    pub(super) fn prepare_exposure(&mut self, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let shutter = self.shutter();
        let total = shutter.total_s();
        let at = self.timing.at_s;
        self.camera.motion = self.camera_motion(&self.timing, total)?;
        if let Some(moving) = self.camera.motion.moving().filter(|moving| moving.stopped()) {
            warn(&format!(
                "the stabiliser comes to its stop, {:.3} mm from the axis: the rest of the shake is in the picture",
                moving.farthest_mm()
            ));
        }
        self.settings.shutter_times = ShutterTimes::default();
        if let Some(flash) = &self.timing.flash
            && let Some((node, material)) = Flash::place_in(self.scene.description())
        {
            let (moment, all) = flash.moment(&shutter);
            self.timing.warn_of_sync(&shutter, moment, all, warn);
            self.settings.shutter_times.flash = Some(moment);
            // The flash is what it is, however the light of the scene is scaled.
            let energy = 1.0 / self.settings.light_scale;
            let pulse = Modulation::Pulse { start_s: moment.0, length_s: moment.1 - moment.0, energy };
            self.scene.modulate(material, pulse);
            self.scene.place_node(node, self.camera.motion.at(moment.0));
        }
        self.scene.pose(at, total);
        self.timing.warn_of_end(&self.scene, total, warn);
        Timing::warn_of_coarse(&self.scene, warn);
        self.facts.at_s = at;
        self.facts.flash = self.timing.flash.is_some() && !self.lens_cap;
        self.facts.shutter = Some(shutter.facts([self.camera.film.columns, self.camera.film.rows], self.pupil()));
        Ok(())
    }

    /// Makes the shot ready for another moment (s) of the scene, with everything set as it is: a frame of a sequence, with noise of its
    /// own. `frame`: its number, which changes the seed. Fails where the thing that the lens is focused on is not before the camera.
    pub fn advance_to(&mut self, at_s: f64, frame: u64, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        self.advance_focused_to(at_s, frame, warn)?;
        self.follow(warn)
    }

    /// The same with the focus as it is, also where the lens is focused on a thing.
    pub fn advance_focused_to(&mut self, at_s: f64, frame: u64, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if frame > 0 {
            self.begun = Instant::now();
        }
        self.timing.at_s = at_s;
        let seed = self.file.render.seed.unwrap_or(DEFAULT_SEED);
        self.settings.seed = seed.wrapping_add(frame);
        self.reading.seed = seed.wrapping_add(frame);
        self.prepare_exposure(warn)
    }

    /// What an exposure series varies by default: the aperture where the time is set by hand and kept, else the time.
    pub fn varies(&self) -> Vary {
        if self.exposing.mode == Mode::ShutterPriority { Vary::Aperture } else { Vary::Time }
    }

    /// Exposes for picture `k` of a bracket of `count`, in steps of so many EV about the setting that stands when the first one is asked for; pictures must be asked for in order, from 0.
    /// `warn` is told when the lens does not go so far. Fails where the lens cannot be set, and on a bracket with a picture of over a year.
    pub fn bracket(
        &mut self,
        k: usize,
        count: u32,
        step_ev: f64,
        vary: Vary,
        warn: &mut dyn FnMut(&str),
    ) -> Result<(), ShotError> {
        let most = 0.5 * f64::from(count.saturating_sub(1)) * step_ev;
        if k == 0 {
            self.bracket_from = Some((self.facts.t_number, self.shutter));
            let longest = self.shutter().exposure_s * most.exp2();
            if vary == Vary::Time && self.facts.flash {
                warn(
                    "a flash gives as much light at any exposure time: what it lights is alike in all pictures; in mode S the aperture varies",
                );
            }
            if vary == Vary::Time && !(longest <= LONGEST_S) {
                let expected = "fewer pictures or smaller steps: none of over a year";
                return Err(value("bracket", format!("a picture of {longest:.3e} s"), expected));
            }
        }
        let Some((t_number, shutter)) = self.bracket_from else { return Ok(()) };
        let ev = k as f64 * step_ev - most;
        let reached = match vary {
            Vary::Aperture => {
                // By the light that a leaf shutter lets through behind each aperture.
                let open_s = |stop: f64| self.shutter().effective_s(self.pupil_at(stop));
                let mut wanted = t_number;
                for _ in 0..EFFECTIVE_ROUNDS {
                    wanted = t_number * (-0.5 * (ev - (open_s(wanted) / open_s(t_number)).log2())).exp2();
                }
                let before_s = open_s(t_number);
                let [widest, smallest] = self.limits().aperture;
                if !(widest * 0.999..=smallest * 1.001).contains(&wanted) {
                    let f_number = self.f_number_of(wanted);
                    warn(&format!("the lens does not go to f/{f_number:.1}: this picture is exposed like another"));
                }
                self.set_t_number(wanted.clamp(widest, smallest))?;
                2.0 * (t_number / self.facts.t_number).log2() + (self.shutter().effective_s(self.pupil()) / before_s).log2()
            }
            Vary::Time => {
                let (marked_s, pupil) = (shutter.unwrap_or(1.0), self.pupil());
                let from_s = self.shutter_of(marked_s).effective_s(pupil);
                self.shutter = Some(self.shutter_of(marked_s).marked_for(from_s * ev.exp2(), pupil));
                let reached = (self.shutter().effective_s(pupil) / from_s).log2();
                if (reached - ev).abs() > 0.05 {
                    warn(&format!(
                        "the shutter does not go so far: light comes in for {:.4} s at least, this picture is {reached:+.1} EV from the middle one, not {ev:+.1}",
                        self.shutter().effective_s(pupil)
                    ));
                }
                reached
            }
        };
        // What rounding leaves of a third of a stop is none.
        self.facts.bracket_ev = Some((reached * 1e6).round() / 1e6);
        Ok(())
    }

    /// f-number of a T-stop of this lens.
    pub(super) fn f_number_of(&self, t_number: f64) -> f64 {
        t_number * self.facts.f_number / self.facts.t_number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shot::ShotFile;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn beside_a_flash_curtains_are_open_together() {
        let time = |more: &str| {
            let text = format!(
                "scene = {{ file = \"flat-field\", ambient_ev = 14 }}\ncamera.lens = \"thin\"\nrender = {{ size = \"24x16\", spp = 1 }}\n\
                 shutter.kind = \"focal-plane\"\n{more}"
            );
            let file: ShotFile = toml::from_str(&text).unwrap();
            let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
            let cancel = AtomicBool::new(false);
            let mut warnings = Vec::new();
            let watch = ProgressReporter { cancel: &cancel, progress: &|_| () };
            shot.meter(&watch, &mut |text| warnings.push(text.to_owned())).unwrap();
            (shot.shutter().exposure_s, warnings.join("; "))
        };
        let mode = "exposure = { mode = \"A\", aperture = \"f/1.4\" }\n";
        let (alone, _) = time(mode);
        let (synced, told) = time(&format!("{mode}flash.guide_number = 40\n"));
        assert!(alone < 1e-3 && synced > 2e-3 && synced < 1e-2, "{alone} {synced}");
        assert!(told.contains("too bright") && !told.contains("does not find the whole picture open"), "{told}");
        let (high_speed, _) = time(&format!("{mode}flash = {{ guide_number = 40, sync = \"high-speed\" }}\n"));
        // The noise of the meter's reading.
        assert!((high_speed / alone - 1.0).abs() < 1e-2, "{high_speed} {alone}");
        // On a dial the next longer mark; by the program the aperture closes.
        let (dialled, _) = time("exposure = { mode = \"P\", dial = \"third\" }\nflash.guide_number = 40\n");
        assert!(
            stops::times(crate::stops::Step::Third).iter().any(|m| (m.value / dialled - 1.0).abs() < 1e-6) && dialled >= synced
        );
    }
}

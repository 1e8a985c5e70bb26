//! A prepared shot turned into another one: the scene stays built where nothing that was changed touches it, so that a camera in use (its dials, its
//! place) is answered in milliseconds instead of the time that reading a scene takes.

use super::asked::{self, ShotRequest};
use super::file::ShotFile;
use super::focusing::Focusing;
use super::sections::{CameraSection, ExposureSection};
use super::timing::Timing;
use super::{DEFAULT_SCENE, Inputs, Shot, ShotError, lens_facts, scene_setup, wants_profile};
use crate::camera::{Camera, look_at};
use crate::camera_motion::CameraMotion;
use crate::flash::Flash;
use crate::quantity::{FNumber, FocusTo};
use crate::recipe_file;
use diopter_image::ExposureFacts;
use diopter_lens::Lens;
use diopter_scene::builtin;
use glam::Vec3;
use std::time::Instant;

impl Shot {
    /// What was asked for.
    pub fn file(&self) -> &ShotFile {
        &self.file
    }

    /// Becomes the shot of another file, as [`Shot::prepare`] would make it: [`Shot::focus`] and [`Shot::meter`] (or [`Shot::apply_meter_reading`]) come next. The
    /// scene is not read again where neither its section nor the flash is changed, nor a place of the camera that its lamps were put for. An error
    /// leaves the shot as it was.
    ///
    /// Inputs in memory ([`Shot::prepare_with`]) are not kept by a shot: what `file` names is read.
    pub fn change_to(&mut self, file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        match self.keeps_scene(file) {
            true => self.change_camera(file, warn),
            false => {
                *self = Shot::prepare_with(file, Inputs { draft: self.draft, ..Default::default() }, warn)?;
                Ok(())
            }
        }
    }

    /// Whether the built scene serves another file.
    pub fn keeps_scene(&self, file: &ShotFile) -> bool {
        let (a, b) = (&self.file.scene, &file.scene);
        let mut section = a.clone();
        section.ambient_ev = b.ambient_ev;
        if !b.frozen {
            section.at = b.at;
        }
        // Lamps, ground and fog were put, and displaced surfaces split, for a camera in its place. A flash goes with it.
        let put = self.lights_follow_camera || b.ground.is_some() || b.fog.is_some() || b.displacement_edge_px.is_some();
        let stays = self.file.camera == file.camera && self.keeps_lens(file);
        section == *b && self.file.flash == file.flash && (!put || stays)
    }

    /// Whether the camera keeps its lens, and the file says all of what may change of how that is set. Its place may be another one.
    fn keeps_lens(&self, file: &ShotFile) -> bool {
        let (a, b) = (&self.file, file);
        let at = |f: &ShotFile| f.scene.at.map_or(0.0, |s| s.0);
        // A mode in which the camera chooses the aperture leaves the lens at another one than the file says.
        let same_mode = self.exposing.mode.name() == b.exposure.mode.as_deref().unwrap_or_else(|| implied_mode(&b.exposure));
        let same_aperture = a.exposure.aperture == b.exposure.aperture && same_mode;
        let focus_is_said = matches!(
            b.focus.distance,
            Some(FocusTo::Distance(_) | FocusTo::Extension(_) | FocusTo::Auto | FocusTo::At(_) | FocusTo::Hyperfocal)
        );
        let mut mount = a.camera.clone();
        if moved(&a.camera, &b.camera).is_some() {
            let place = b.camera.clone();
            (mount.look_from, mount.look_at, mount.up) = (place.look_from, place.look_at, place.up);
        }
        mount == b.camera
            && a.render.size == b.render.size
            && a.render.quick == b.render.quick
            && at(a) == at(b)
            && (same_aperture || b.exposure.aperture.is_some())
            && (a.focus == b.focus && b.focus.distance.is_none() || focus_is_said)
    }

    /// The lens as it stands, set as another file says, for which [`Shot::keeps_lens`] holds; and whether anything is other than it was.
    fn lens_for(&self, file: &ShotFile, focusing: &Focusing) -> Result<(Lens, bool), ShotError> {
        let mut lens = self.camera.lens.clone();
        let mut changed = false;
        if let Some(FNumber(n)) = file.exposure.aperture.filter(|a| (a.0 - lens.f_number()).abs() > 1e-9 * a.0) {
            lens = lens.stopped(n)?;
            changed = true;
        }
        if self.file.focus != file.focus && !lens.is_sharp_everywhere() {
            // The distance of the subject counts for nothing where the focus is said.
            lens = lens.refocused(focusing.first(1.0))?;
            changed = true;
        } else if file.focus.distance.is_none()
            && let Some([before, now]) = moved(&self.file.camera, &file.camera)
            && (now - before).abs() > SAME_DISTANCE * before
        {
            lens = lens.refocused(focusing.first(f64::from(now)))?;
            changed = true;
        }
        Ok((lens, changed))
    }

    /// Everything of [`Shot::prepare_with`] but the scene; what moves stands again as it did if that fails.
    fn change_camera(&mut self, file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let changed = self.try_change_camera(file, warn);
        if changed.is_err() {
            let total = self.shutter().total_s();
            self.scene.pose(self.timing.at_s, total);
        }
        changed
    }

    fn try_change_camera(&mut self, file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let inputs = Inputs { draft: self.draft, ..Default::default() };
        let mut file = file.clone();
        file.apply_true_stops();
        let keeps_lens = self.keeps_lens(&file);
        let mut asked = ShotRequest::new(&file, &inputs, warn)?;
        let lut = match self.file.develop.lut.file == file.develop.lut.file {
            true => self.lut.clone(),
            false => recipe_file::lut(&file.develop)?,
        };

        let name = file.scene.file.clone().unwrap_or_else(|| DEFAULT_SCENE.into());
        self.scene.pose(file.scene.at.map_or(0.0, |s| s.0), 0.0);
        let description = self.scene.description();
        let view = scene_setup::view(&file, description)?;
        if let Some(hints) = view.map(|v| &v.film).filter(|_| file.camera.look_from.is_none())
            && scene_setup::apply_film_hints(&mut file, hints, warn)
        {
            asked.set_body(&file, &inputs)?;
        }
        let mut film = scene_setup::film(&file, &asked.sensor, view)?;
        let calibrated = scene_setup::calibrated(&mut file, &asked.sensor, view, &mut film)?;
        scene_setup::resolve_angle_of_view(&mut file, &film)?;
        let mut timing = Timing::new(&file, &asked.sensor, view)?;
        timing.keep_playing(&self.timing);
        let focusing = Focusing::new(&file, film.width_mm.hypot(film.height_mm), warn)?;
        let bounds = scene_setup::subject_bounds(&self.scene, timing.at_s);
        timing.build_path(&file, if bounds.is_empty() { Vec3::ZERO } else { bounds.center() })?;
        let (camera, carrier, changed) = match keeps_lens {
            true => {
                let (lens, changed) = self.lens_for(&file, &focusing)?;
                film.microlenses = self.camera.film.microlenses;
                let place = match (file.camera.look_from, file.camera.look_at) {
                    (Some(from), Some(at)) if self.file.camera != file.camera => {
                        look_at(from.into(), at.into(), file.camera.up.map_or(Vec3::Y, Vec3::from_array))?
                    }
                    _ => self.placed,
                };
                (Camera { lens, film, motion: CameraMotion::still(place) }, self.timing.carrier, changed)
            }
            false => {
                let framing = builtin::framing(&name);
                let mut placement =
                    scene_setup::placement(&file, &inputs, description, timing.at_s, &asked.sensor, &film, framing)?;
                placement.calibrated = calibrated;
                let camera = scene_setup::camera(
                    &file,
                    &inputs,
                    &self.scene,
                    timing.at_s,
                    &asked.sensor,
                    film,
                    &focusing,
                    &placement,
                    warn,
                )?;
                (camera, placement.carrier, true)
            }
        };
        timing.carrier = carrier;
        asked::check_camera(&file, &camera, warn)?;
        let stabiliser = scene_setup::stabiliser(&file, &camera, &timing)?;
        // Light that was settled by the mean of the frame is settled anew in another frame; a scene with a scale keeps it.
        let same_frame = !changed && self.file.scene == file.scene && self.file.camera == file.camera;
        let light_settled = self.light_settled && same_frame;
        if light_settled {
            asked.settings.light_scale = self.settings.light_scale;
        }

        // A draft has no profile until the development asks for one.
        let with_profile = wants_profile(&file, self.draft);
        let missing = self.draft && with_profile && !wants_profile(&self.file, self.draft);
        let of_lens = match changed || missing {
            true => lens_facts(&camera, &asked.sensor, with_profile),
            false => self.facts.clone(),
        };
        let nothing_metered = ExposureFacts { metered_ev100: None, metering: String::new(), shutter: None, ..of_lens };
        self.facts = asked.facts(self.facts.scene.clone(), nothing_metered);
        self.placed = camera.motion.at(0.0);
        self.camera = camera;
        self.shutter = file.exposure.shutter.map(|s| s.0);
        self.reading = asked.reading(&file);
        let ShotRequest { settings, sensor, exposing, denoise, filter, .. } = asked;
        self.color_sampling = file.camera.color_sampling.unwrap_or_default();
        self.lens_cap = file.exposure.lens_cap;
        (self.denoise, self.filter) = (denoise, filter);
        self.fireflies = file.render.fireflies.unwrap_or_default();
        self.diffraction = super::asked::diffraction(&file.render);
        (self.recipe, self.lut) = (file.develop.clone(), lut);
        self.ambient_ev = file.scene.ambient_ev;
        (self.begun, self.baseline_ev, self.denoising_s) = (Instant::now(), 0.0, None);
        (self.sensor, self.settings, self.exposing, self.focusing) = (sensor, settings, exposing, focusing);
        (self.timing, self.light_settled) = (timing, light_settled);
        self.stabiliser = stabiliser;
        self.file = file;
        self.attach_flash();
        Ok(())
    }

    /// The flash stands on the camera and is dark: meters and autofocus look before it fires, and it hides what it hides from them, too.
    pub(super) fn attach_flash(&mut self) {
        if let Some(flash) = &self.timing.flash
            && let Some((node, material)) = Flash::place_in(self.scene.description())
        {
            self.scene.modulate(material, flash.unfired());
            self.scene.place_node(node, self.placed);
            self.scene.pose(self.timing.at_s, 0.0);
        }
    }
}

/// Distances that differ by less than this fraction are the same to a lens: rounding of a camera that turns about what it is aimed at, and far less than
/// any depth of field.
const SAME_DISTANCE: f32 = 1e-5;

/// Distances (m) of what a camera is aimed at before and after it was moved, where nothing but its place is another and both places are written down.
fn moved(before: &CameraSection, after: &CameraSection) -> Option<[f32; 2]> {
    let distance = |c: &CameraSection| Some((Vec3::from(c.look_at?) - Vec3::from(c.look_from?)).length());
    let both = [distance(before)?, distance(after)?];
    (before != after && after.path.is_empty()).then_some(both)
}

/// The mode that is meant when none is named.
fn implied_mode(e: &ExposureSection) -> &'static str {
    if e.shutter.is_some() { "M" } else { "A" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::denoising::Denoise;
    use crate::expose::ProgressReporter;
    use crate::quantity::{Distance, Seconds, Size};
    use crate::shot::DiffractionChoice;
    use std::sync::atomic::AtomicBool;

    fn small(change: impl FnOnce(&mut ShotFile)) -> ShotFile {
        let mut file = ShotFile::default();
        file.scene.file = Some("color-chart".into());
        file.render.size = Some(Size { width: 24, height: 16 });
        (file.render.spp, file.render.denoise) = (Some(2), Some(Denoise::Off));
        change(&mut file);
        file
    }

    /// The exposure of a shot, with all that its camera chose.
    fn taken(shot: &mut Shot) -> (ExposureFacts, Vec<f32>) {
        let go_on = AtomicBool::new(false);
        let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        shot.focus(&watch, &mut |_| ()).unwrap();
        shot.meter(&watch, &mut |_| ()).unwrap();
        (shot.facts(), shot.expose(&watch).unwrap().mean.data)
    }

    #[test]
    fn a_changed_shot_takes_the_picture_of_a_new_one() {
        let changes: [fn(&mut ShotFile); 8] = [
            |f| f.exposure.aperture = Some(FNumber(2.8)),
            |f| f.exposure.iso = Some(crate::quantity::IsoChoice::Fixed(crate::quantity::Iso(400.0))),
            |f| f.focus.distance = Some(FocusTo::Distance(Distance(1.0))),
            |f| f.camera.look_from = Some([0.3, 1.0, 2.0]),
            |f| (f.exposure.mode, f.exposure.shutter) = (Some("S".into()), Some(Seconds(0.01))),
            |f| f.camera.lens = Some("tessar-50mm-f2.8".into()),
            |f| f.scene.ambient_ev = Some(8.0),
            |f| (f.exposure.aperture, f.render.diffraction) = (Some(FNumber(22.0)), Some(DiffractionChoice::On)),
        ];
        // One shot goes through all of them, and back to the first.
        let first = small(|_| ());
        let mut shot = Shot::prepare(&first, &mut |_| ()).unwrap();
        for change in changes {
            let changed = small(change);
            for file in [&changed, &first] {
                assert!(shot.keeps_scene(file));
                shot.change_to(file, &mut |_| ()).unwrap();
                let mut fresh = Shot::prepare(file, &mut |_| ()).unwrap();
                let ((facts, mean), (expected, expected_mean)) = (taken(&mut shot), taken(&mut fresh));
                assert_eq!(facts, expected);
                assert!(mean == expected_mean, "{facts:?}");
            }
        }
    }

    #[test]
    fn a_camera_that_is_moved_takes_its_lens_along() {
        for lens in [None, Some("tessar-50mm-f2.8")] {
            let at = |from: [f32; 3], focus: Option<f64>| {
                small(|f| {
                    (f.camera.look_from, f.camera.look_at) = (Some(from), Some([0.0, 0.1, 0.0]));
                    f.camera.lens = lens.map(Into::into);
                    f.exposure.aperture = Some(FNumber(4.0));
                    f.focus.distance = focus.map(|d| FocusTo::Distance(Distance(d)));
                })
            };
            let mut shot = Shot::prepare(&at([0.0, 0.5, 1.5], None), &mut |_| ()).unwrap();
            for file in [at([0.4, 0.5, 1.4], None), at([0.4, 0.6, 2.0], Some(1.2)), at([0.1, 0.6, 1.0], Some(1.2))] {
                assert!(shot.keeps_lens(&file));
                shot.change_to(&file, &mut |_| ()).unwrap();
                let ((facts, mean), (expected, expected_mean)) =
                    (taken(&mut shot), taken(&mut Shot::prepare(&file, &mut |_| ()).unwrap()));
                assert_eq!(facts, expected);
                assert!(mean == expected_mean);
            }
        }
    }

    #[test]
    fn a_flash_goes_with_the_camera_and_is_never_metered() {
        let flash = |change: fn(&mut ShotFile)| {
            small(|f| {
                // In the dark, so that a meter that saw the flash would tell.
                f.scene.light = Some("none".into());
                f.scene.ambient_ev = Some(2.0);
                f.flash = Some(toml::from_str("guide_number = 40").unwrap());
                (f.camera.look_from, f.camera.look_at) = (Some([0.0, 0.5, 1.5]), Some([0.0, 0.1, 0.0]));
                (f.exposure.aperture, f.focus.distance) = (Some(FNumber(4.0)), Some(FocusTo::Distance(Distance(1.4))));
                change(f);
            })
        };
        let mut shot = Shot::prepare(&flash(|_| ()), &mut |_| ()).unwrap();
        let changes: [fn(&mut ShotFile); 5] = [
            |_| (),
            |f| f.exposure.aperture = Some(FNumber(8.0)),
            |f| (f.exposure.mode, f.exposure.shutter) = (Some("S".into()), Some(Seconds(0.05))),
            |f| f.camera.look_from = Some([0.4, 0.5, 1.4]),
            |f| f.exposure.compensation = Some(crate::quantity::Ev(-1.0)),
        ];
        for change in changes {
            let file = flash(change);
            assert!(shot.keeps_scene(&file));
            shot.change_to(&file, &mut |_| ()).unwrap();
            let (facts, mean) = taken(&mut shot);
            let (expected, expected_mean) = taken(&mut Shot::prepare(&file, &mut |_| ()).unwrap());
            assert_eq!(facts, expected);
            let worst = mean.iter().zip(&expected_mean).map(|(a, b)| (a - b).abs() / b.max(1.0)).fold(0.0f32, f32::max);
            // Rounding: a hierarchy that was moved is not the one that is built there.
            assert!(worst < 1e-5 && facts.flash, "{worst}");
        }
        assert!(!shot.keeps_scene(&flash(|f| f.flash.as_mut().unwrap().power = Some(0.5))));
        assert!(!shot.keeps_scene(&flash(|f| f.flash = None)));
    }

    #[test]
    fn what_is_wrong_leaves_the_shot_as_it_was() {
        let file = small(|_| ());
        let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
        for wrong in [
            small(|f| f.exposure.aperture = Some(FNumber(-1.0))),
            small(|f| f.camera.lens = Some("planr".into())),
            small(|f| f.scene.file = Some("nowhere.glb".into())),
        ] {
            assert!(shot.change_to(&wrong, &mut |_| ()).is_err());
            assert_eq!(shot.file(), &file);
        }
        let before = taken(&mut Shot::prepare(&file, &mut |_| ()).unwrap());
        assert!(taken(&mut shot) == before);
    }

    #[test]
    fn lamps_that_stand_for_the_camera_are_put_again_when_it_moves() {
        let studio = |f: &mut ShotFile| f.scene.light = Some("studio".into());
        let shot = Shot::prepare(&small(studio), &mut |_| ()).unwrap();
        let moved = small(|f| (f.scene.light, f.camera.look_from) = (Some("studio".into()), Some([0.3, 1.0, 2.0])));
        assert!(!shot.keeps_scene(&moved));
        let stopped = small(|f| (f.scene.light, f.exposure.aperture) = (Some("studio".into()), Some(FNumber(11.0))));
        assert!(shot.keeps_scene(&stopped));
        let brighter =
            small(|f| (f.scene.light, f.exposure.compensation) = (Some("studio".into()), Some(crate::quantity::Ev(1.0))));
        assert!(shot.keeps_scene(&brighter));
        let other = small(|f| f.scene.file = Some("cornell".into()));
        assert!(!shot.keeps_scene(&other));
    }
}

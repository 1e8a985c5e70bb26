//! The camera that all pages share: its shot, what was asked of it, and what it answers.

use crate::darkroom::Darkroom;
use crate::folders::Folders;
use crate::frame::Frame;
use crate::lock::lock;
use crate::pose::{Motion, Pose};
use crate::problem::Problem;
use crate::protocol::{patched, shot_as_json};
use crate::series::Series;
use crate::timer::{Tick, Timer};
use diopter::image::{FocalPlane, RawImage};
use diopter::lens::Lens;
use diopter::quantity::FocusTo;
use diopter::shot::ShotFile;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Instant;
use tokio::sync::watch;

/// Half a side of the patch that a click takes for grey, a fraction of the picture.
const GREY_PATCH: f64 = 0.01;

/// The camera, and the ways in and out of it.
pub struct Session {
    camera: Mutex<CameraState>,
    /// Wakes the engine.
    changed: Condvar,
    /// Stops what the engine renders for an older shot.
    pub cancel: AtomicBool,
    /// Everything ends.
    pub stop: AtomicBool,
    /// State as JSON, for all pages.
    pub state: watch::Sender<Arc<str>>,
    /// The latest frame.
    pub frames: watch::Sender<Option<Arc<Frame>>>,
    /// The latest frame that a page has shown.
    pub shown_frame: AtomicU64,
    /// What the latest frame was made of.
    pub live: Mutex<Option<Arc<Live>>>,
    /// Pictures that are taken.
    pub darkroom: Darkroom,
    /// Files that may be named.
    pub folders: Folders,
    /// The shot of the command line.
    first: ShotFile,
}

/// What is known of the camera.
struct CameraState {
    /// The shot as asked for.
    shot: ShotFile,
    /// Counts the changes of the shot.
    version: u64,
    /// When the latest of them came.
    changed_at: Instant,
    /// The latest shot that could be taken.
    good: ShotFile,
    /// What the engine found of a shot.
    found: Found,
    /// What takes longer than a frame.
    busy: Option<&'static str>,
    problem: Option<(u64, Problem)>,
    /// Numbers the problems, so that pages tell a new one from an old one.
    problems: u64,
    /// The self-timer while it runs.
    timer: Option<Timer>,
}

/// What preparing a shot has found out.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Facts, limits and ranges for the dials, as pages read them.
    pub facts: Value,
    /// Where the camera stands; `None` before the first shot is prepared.
    pub pose: Option<Pose>,
    /// Tangent of half the angle of view across.
    pub tan_half_width: f32,
    /// The shot with everything written down that was left open, by which a moved camera keeps its lens.
    pub settled: ShotFile,
    /// What autofocus did last.
    pub focus: Option<Value>,
    /// What was found odd.
    pub warnings: Vec<String>,
}

/// A shot for the engine.
pub struct Asked {
    /// What.
    pub shot: ShotFile,
    /// Which change it is.
    pub version: u64,
    /// When it came.
    pub since: Instant,
}

/// What the latest frame was made of, for who asks about its pixels.
pub struct Live {
    /// The exposure as it was read out.
    pub plane: Arc<FocalPlane>,
    /// Its read-out.
    pub raw: RawImage,
    /// Through this.
    pub lens: Lens,
    /// Format of the film, mm.
    pub film_mm: [f64; 2],
    /// The recipe of the shot.
    pub recipe: diopter::develop::Recipe,
    /// EV at ISO 100 of the setting.
    pub setting_ev100: f64,
}

impl Session {
    /// A camera set to a shot.
    pub fn new(first: ShotFile, folders: Folders, darkroom: Darkroom) -> Session {
        let camera = CameraState {
            shot: first.clone(),
            version: 1,
            changed_at: Instant::now(),
            good: first.clone(),
            found: Found::default(),
            busy: None,
            problem: None,
            problems: 0,
            timer: None,
        };
        let session = Session {
            camera: Mutex::new(camera),
            changed: Condvar::new(),
            cancel: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            state: watch::Sender::new(Arc::from("")),
            frames: watch::Sender::new(None),
            shown_frame: AtomicU64::new(0),
            live: Mutex::new(None),
            darkroom,
            folders,
            first,
        };
        session.publish();
        session
    }

    /// Ends everything that runs.
    pub fn end(&self) {
        // Under the lock: whoever is about to wait sees it, or is woken; and nobody takes the cancel back.
        let held = lock(&self.camera);
        self.stop.store(true, Ordering::Relaxed);
        self.cancel.store(true, Ordering::Relaxed);
        self.changed.notify_all();
        drop(held);
        self.darkroom.end();
    }

    /// Waits for a shot other than the version that is known; `None` when everything ends.
    pub fn next(&self, known: u64) -> Option<Asked> {
        let mut camera = lock(&self.camera);
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            if camera.version != known {
                self.cancel.store(false, Ordering::Relaxed);
                return Some(Asked { shot: camera.shot.clone(), version: camera.version, since: camera.changed_at });
            }
            camera = self.changed.wait(camera).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn change(&self, change: impl FnOnce(&CameraState) -> Result<ShotFile, Problem>) -> Result<(), Problem> {
        let mut camera = lock(&self.camera);
        let shot = change(&camera)?;
        self.folders.check(&shot, &self.first)?;
        if shot != camera.shot {
            camera.shot = shot;
            (camera.version, camera.changed_at) = (camera.version + 1, Instant::now());
            camera.problem = None;
            self.cancel.store(true, Ordering::Relaxed);
            self.changed.notify_all();
        }
        drop(camera);
        self.publish();
        Ok(())
    }

    /// Changes the shot by a merge patch. Fails with the key that is wrong, and on files that no folder of the viewfinder holds.
    pub fn set(&self, patch: &Value) -> Result<(), Problem> {
        self.change(|camera| patched(&camera.shot, patch))
    }

    /// Goes back to the shot of the command line.
    pub fn reset(&self) -> Result<(), Problem> {
        self.change(|_| Ok(self.first.clone()))
    }

    /// Asks autofocus to look at a place, 0 to 1 across and down.
    pub fn focus(&self, at: [f64; 2]) -> Result<(), Problem> {
        self.change(|camera| {
            let mut shot = camera.shot.clone();
            // Zones and a place exclude each other; how it searches stays.
            shot.focus.zones = None;
            shot.focus.distance = Some(FocusTo::At(at));
            Ok(shot)
        })
    }

    /// Takes a place, 0 to 1 across and down, for grey.
    pub fn white(&self, [x, y]: [f64; 2]) -> Result<(), Problem> {
        self.change(|camera| {
            let mut shot = camera.shot.clone();
            let corner = |v: f64| (v - GREY_PATCH).clamp(0.0, 1.0 - 2.0 * GREY_PATCH);
            shot.develop.white.patch = Some([corner(x), corner(y), 2.0 * GREY_PATCH, 2.0 * GREY_PATCH]);
            Ok(shot)
        })
    }

    /// Moves the camera; `by`: to the right and down, in the units of [`Command::Move`](crate::protocol::Command::Move). Fails where the camera follows a path, and before the first shot is ready.
    pub fn move_camera(&self, how: Motion, by: [f64; 2]) -> Result<(), Problem> {
        self.change(|camera| {
            let mut shot = camera.shot.clone();
            if !shot.camera.path.is_empty() {
                return Err(Problem::new("move", "a camera on a path", "a camera without a path, which stands where it is put"));
            }
            let found = &camera.found;
            let Some(mut pose) = found.pose else {
                return Err(Problem::new("move", "a camera that is not ready", "a moment of patience"));
            };
            match (shot.camera.look_from, shot.camera.look_at) {
                // Moves may come faster than shots are prepared: from where the last one led to.
                (Some(eye), Some(target)) => {
                    let up = shot.camera.up.map_or(pose.up, Into::into);
                    pose = Pose { eye: eye.into(), target: target.into(), up };
                }
                _ => {
                    // What the scene's own camera said of lens and focus stays as it is.
                    shot.camera = found.settled.camera.clone();
                    shot.exposure.aperture = shot.exposure.aperture.or(found.settled.exposure.aperture);
                    shot.render.size = shot.render.size.or(found.settled.render.size);
                    if shot.focus.distance.is_none() {
                        shot.focus.distance.clone_from(&found.settled.focus.distance);
                    }
                }
            }
            let moved = pose.moved(how, by, found.tan_half_width);
            shot.camera.look_from = Some(moved.eye.to_array());
            shot.camera.look_at = Some(moved.target.to_array());
            shot.camera.up = Some(moved.up.to_array());
            Ok(shot)
        })
    }

    /// Queues the shot as it is, or a series of it; answers with the number of the first picture. Fails where there is no room for the pictures.
    pub fn shoot(&self, series: Option<Series>) -> Result<u64, Problem> {
        let shot = lock(&self.camera).shot.clone();
        let id = self.darkroom.queue(shot, series)?;
        self.publish();
        Ok(id)
    }

    /// Starts the self-timer: the shot is taken as it is then. Fails while one runs, and where there is no room for the pictures.
    pub fn shoot_after(&self, seconds: f64, series: Option<Series>, now: Instant) -> Result<(), Problem> {
        self.darkroom.check_room(series.as_ref().map_or(1, Series::count))?;
        let mut camera = lock(&self.camera);
        if camera.timer.is_some() {
            return Err(Problem::new("self-timer", "that runs", "one that is over, or cancelled"));
        }
        camera.timer = Some(Timer::new(seconds, series, now));
        drop(camera);
        self.publish();
        Ok(())
    }

    /// Stops the self-timer.
    pub fn cancel_timer(&self) {
        lock(&self.camera).timer = None;
        self.publish();
    }

    /// What the moment asks for: the next second of the self-timer is told, or its picture taken.
    pub fn tick(&self, now: Instant) {
        let mut camera = lock(&self.camera);
        match camera.timer.as_mut().map_or(Tick::Same, |t| t.tick(now)) {
            Tick::Same => {}
            Tick::Second => {
                drop(camera);
                self.publish();
            }
            Tick::Due => {
                let series = camera.timer.take().and_then(|t| t.series);
                drop(camera);
                if let Err(problem) = self.shoot(series) {
                    self.tell(problem);
                }
            }
        }
    }

    /// Tells all pages what cannot be; the shot stays.
    fn tell(&self, problem: Problem) {
        let mut camera = lock(&self.camera);
        camera.problems += 1;
        camera.problem = Some((camera.problems, problem));
        drop(camera);
        self.publish();
    }

    /// The engine has prepared a shot.
    pub fn prepared(&self, found: Found) {
        let mut camera = lock(&self.camera);
        (camera.found, camera.busy) = (found, None);
        drop(camera);
        self.publish();
    }

    /// The engine does something that takes longer than a frame.
    pub fn busy(&self, what: Option<&'static str>) {
        lock(&self.camera).busy = what;
        self.publish();
    }

    /// A frame of a shot has been made: it is one that can be taken.
    pub fn shown(&self, asked: &Asked) {
        let mut camera = lock(&self.camera);
        if camera.version == asked.version {
            camera.good = asked.shot.clone();
        }
    }

    /// Autofocus has set the lens: from here on the distance is written, and the lens stays.
    pub fn focused(&self, asked: &mut Asked, settled: &ShotFile) {
        let mut camera = lock(&self.camera);
        if camera.version == asked.version {
            camera.shot.focus.distance.clone_from(&settled.focus.distance);
            camera.shot.focus.require = false;
            let f = &mut camera.shot.focus;
            (f.method, f.priority, f.measure, f.motor, f.zones, f.sweep) = (None, None, None, None, None, None);
            asked.shot = camera.shot.clone();
        }
    }

    /// A shot cannot be taken: back to the latest that could, and all pages are told.
    pub fn refused(&self, asked: &Asked, problem: Problem) {
        let mut camera = lock(&self.camera);
        if camera.version == asked.version && camera.shot != camera.good {
            camera.shot = camera.good.clone();
            (camera.version, camera.changed_at) = (camera.version + 1, Instant::now());
        }
        camera.problems += 1;
        camera.busy = None;
        camera.problem = Some((camera.problems, problem));
        drop(camera);
        self.publish();
    }

    /// Tells all pages the state.
    pub fn publish(&self) {
        let camera = lock(&self.camera);
        let f = &camera.found;
        let pose = f.pose.map(|p| json!({ "eye": p.eye.to_array(), "target": p.target.to_array(), "up": p.up.to_array() }));
        let problem = camera.problem.as_ref().map(|(number, problem)| json!({ "number": number, "problem": problem }));
        let timer = camera.timer.as_ref().map(Timer::told);
        let (queue, film) = self.darkroom.told();
        let state = json!({
            "kind": "state", "version": camera.version, "shot": shot_as_json(&camera.shot), "facts": f.facts, "pose": pose, "focus": f.focus,
            "warnings": f.warnings, "busy": camera.busy, "problem": problem, "queue": queue, "film": film,
            "timer": timer,
        });
        // Under the lock, so that an older state never comes behind a newer one.
        self.state.send_replace(Arc::from(state.to_string()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn session() -> Session {
        Session::new(ShotFile::default(), Folders::default(), Darkroom::new(|| "2026:01:01 00:00:00".into()).unwrap())
    }

    #[test]
    fn changes_are_counted_and_wrong_ones_change_nothing() {
        let session = session();
        let first = session.next(0).unwrap();
        assert_eq!(first.version, 1);
        session.set(&json!({ "exposure": { "iso": 800 } })).unwrap();
        assert!(session.cancel.load(Ordering::Relaxed));
        let second = session.next(1).unwrap();
        assert!(second.version == 2 && !session.cancel.load(Ordering::Relaxed));
        assert!(session.set(&json!({ "exposure": { "iso": "much" } })).is_err());
        // The same again is no change.
        session.set(&json!({ "exposure": { "iso": 800 } })).unwrap();
        assert_eq!(lock(&session.camera).version, 2);
        // What turns out wrong when it is prepared goes back to what was right.
        session.shown(&second);
        session.set(&json!({ "camera": { "lens": "planr" } })).unwrap();
        let third = session.next(2).unwrap();
        session.refused(&third, Problem::new("lens", "\"planr\"", "a lens"));
        let fourth = session.next(3).unwrap();
        assert!(fourth.shot == second.shot && fourth.version == 4);
        assert!(session.state.borrow().contains("planr"));
        session.end();
        assert!(session.next(4).is_none());
    }

    #[test]
    fn moves_add_up_however_fast_they_come() {
        let session = session();
        assert!(session.move_camera(Motion::Orbit, [0.1, 0.0]).is_err());
        let pose = Pose { eye: Vec3::new(0.0, 1.0, 4.0), target: Vec3::ZERO, up: Vec3::Y };
        session.prepared(Found { pose: Some(pose), tan_half_width: 0.36, ..Default::default() });
        for _ in 0..5 {
            session.move_camera(Motion::Orbit, [0.1, 0.0]).unwrap();
        }
        let eye = Vec3::from(session.next(1).unwrap().shot.camera.look_from.unwrap());
        let once = pose.moved(Motion::Orbit, [0.5, 0.0], 0.36).eye;
        assert!((eye - once).length() < 1e-4, "{eye} {once}");
        session.set(&json!({ "camera": { "path": [{ "time": 0, "look_from": [0, 0, 1] }] } })).unwrap();
        assert!(session.move_camera(Motion::Orbit, [0.1, 0.0]).is_err());
    }

    #[test]
    fn the_self_timer_takes_what_is_set_when_it_is_over() {
        let session = session();
        let told = || serde_json::from_str::<Value>(&session.state.borrow().clone()).unwrap();
        let begin = Instant::now();
        let at = |ms: u64| begin + std::time::Duration::from_millis(ms);
        session.shoot_after(2.0, None, begin).unwrap();
        assert_eq!(told()["timer"]["left_s"], 2);
        // One at a time.
        assert!(session.shoot_after(2.0, None, begin).is_err());
        session.tick(at(1100));
        assert!(told()["timer"]["left_s"] == 1 && told()["queue"]["jobs"] == json!([]));
        session.set(&json!({ "exposure": { "iso": 1600 } })).unwrap();
        session.tick(at(2001));
        assert!(told()["timer"].is_null() && told()["queue"]["jobs"][0]["what"] == "waiting", "{}", told());
        // Cancelled, it takes nothing.
        session.shoot_after(10.0, Some(Series::Bracket { count: 3, step_ev: 1.0 }), begin).unwrap();
        session.cancel_timer();
        session.tick(at(20_000));
        assert!(told()["timer"].is_null() && told()["queue"]["jobs"].as_array().unwrap().len() == 1);
        // What has no room is refused at once; what has none any more when it is over is told to all.
        let all = Some(Series::Bracket { count: 36, step_ev: 1.0 });
        assert!(session.shoot_after(2.0, all, begin).is_err());
        session.darkroom.cancel(1);
        session.shoot_after(2.0, all, begin).unwrap();
        session.shoot(None).unwrap();
        session.tick(at(3000));
        assert_eq!(told()["problem"]["problem"]["place"], "shoot", "{}", told());
    }
}

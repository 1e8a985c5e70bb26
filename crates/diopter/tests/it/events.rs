//! Event sensors before scenes.

use diopter::ExposeError;
use diopter::events::{EventFilm, TakenEvents, take};
use diopter::expose::ProgressReporter;
use diopter::quantity::{FNumber, Seconds, Size};
use diopter::sensor::events::EventSensor;
use diopter::shot::{ShotError, ShotFile};
use std::sync::atomic::AtomicBool;

fn shot(scene: &str) -> ShotFile {
    let mut file = ShotFile::default();
    file.scene.file = Some(scene.into());
    file.exposure.aperture = Some(FNumber(2.8));
    file.render.size = Some(Size { width: 32, height: 24 });
    file.render.spp = Some(4);
    file
}

fn film(duration_s: f64, step_s: f64) -> EventFilm {
    let sensor = EventSensor::named("ideal-events").unwrap();
    EventFilm { sensor, duration_s, step_s, most_change: None, seed: 1, keep_light: true }
}

fn taken(file: &ShotFile, film: &EventFilm) -> TakenEvents {
    let go_on = AtomicBool::new(false);
    take(file, film, &ProgressReporter { cancel: &go_on, progress: &|_| () }, &mut |_| ()).unwrap()
}

#[test]
fn a_scene_that_stands_still_makes_no_events() {
    // Also with the noise of four samples a pixel: all moments have the same.
    let t = taken(&shot("cornell"), &film(5e-3, 1e-3));
    assert!(t.events.is_empty() && t.moments == 6 && t.mean_current_e_s > 0.0);
}

#[test]
fn events_follow_the_light_of_what_moves() {
    let f = EventFilm { most_change: Some(0.5), ..film(0.1, 0.05) };
    let t = taken(&shot("rolling-ball"), &f);
    let light = t.light.as_ref().unwrap();
    assert!(t.events.len() > 20 && t.moments > 3 && light.times_s.len() == t.moments, "{} in {}", t.events.len(), t.moments);
    assert!(light.times_s.is_sorted() && light.times_s.last() == Some(&0.1));
    let pixels = 32 * 24;
    let mut sums = vec![0i32; pixels];
    for e in &t.events {
        sums[usize::from(e.y) * 32 + usize::from(e.x)] += if e.on { 1 } else { -1 };
        assert!((0..=100_000).contains(&e.stamp_us(t.begun_s)));
    }
    let level = |c: f32| (f64::from(c) + 1.0).ln();
    let last = &light.current_e_s[light.current_e_s.len() - pixels..];
    for k in 0..pixels {
        // What events have not told yet is less than a threshold.
        let left = level(last[k]) - level(light.current_e_s[k]) - 0.2 * f64::from(sums[k]);
        assert!(left.abs() < 0.2 + 1e-9, "pixel {k}: {left}");
    }
    // Finer steps than asked for where the light changed, and the same again.
    assert_eq!(taken(&shot("rolling-ball"), &f).events, t.events);
}

#[test]
fn what_an_event_sensor_has_not_is_refused() {
    let go_on = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
    let refused = |change: fn(&mut ShotFile), film: EventFilm| {
        let mut file = shot("cornell");
        change(&mut file);
        take(&file, &film, &watch, &mut |_| ()).map(|_| ()).unwrap_err()
    };
    for e in [
        refused(|f| f.exposure.shutter = Some(Seconds(0.01)), film(0.01, 1e-3)),
        refused(|f| f.camera.body = Some("imx249".into()), film(0.01, 1e-3)),
        refused(|f| f.sequence.frames = Some(3), film(0.01, 1e-3)),
        refused(|_| (), film(0.0, 1e-3)),
        refused(|_| (), film(0.01, 1e-9)),
    ] {
        assert!(matches!(&e, ShotError::Value { .. }) && e.to_string().contains("expected"), "{e}");
    }
    go_on.store(true, std::sync::atomic::Ordering::Relaxed);
    let e = take(&shot("cornell"), &film(0.01, 1e-3), &watch, &mut |_| ()).map(|_| ()).unwrap_err();
    assert!(matches!(e, ShotError::Expose(ExposeError::Cancelled)), "{e}");
}

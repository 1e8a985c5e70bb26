use super::*;
use crate::darkroom::Darkroom;
use crate::folders::Folders;
use std::time::Duration;

#[test]
fn sizes_keep_their_shape_and_their_bounds() {
    assert_eq!(finder_size([960, 640]), [960, 640]);
    assert_eq!(finder_size([6720, 4480]), [960, 640]);
    assert_eq!(finder_size([1, 1]), [1, 1]);
    assert_eq!(part_size([960, 640], 4), [240, 160]);
    assert_eq!(part_size([30, 20], 8), [24, 20]);
    let [w, h] = finder_size([65_535, 100]);
    assert!(w * h <= MOST_PIXELS + w && h >= 1);
}

/// Header of the latest frame.
fn header(session: &Session) -> Option<Value> {
    let frame = session.frames.borrow().clone()?;
    let length = u32::from_le_bytes(frame.bytes[4..8].try_into().ok()?) as usize;
    serde_json::from_slice(&frame.bytes[8..8 + length]).ok()
}

/// Waits for a frame with a property.
fn wait(session: &Session, what: &str, is: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(180) {
        if let Some(header) = header(session).filter(|h| is(h)) {
            return header;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let last = header(session).map(|mut h| h.as_object_mut().and_then(|h| h.remove("histogram")).map(|_| h.clone()));
    panic!("no frame: {what}; the last is {last:?}; {}", *session.state.borrow())
}

/// A camera before the colour chart, and an engine that ends with the test.
fn with_engine(test: impl FnOnce(&Session)) {
    let mut shot = ShotFile::default();
    shot.scene.file = Some("color-chart".into());
    shot.render.size = Some(diopter::quantity::Size { width: 96, height: 64 });
    shot.render.spp = Some(4);
    let session = Session::new(shot, Folders::default(), Darkroom::new(|| "2026:01:01 00:00:00".into()).unwrap());
    std::thread::scope(|scope| {
        scope.spawn(|| run(&session, None));
        let done = catch_unwind(AssertUnwindSafe(|| test(&session)));
        session.end();
        if let Err(e) = done {
            std::panic::resume_unwind(e);
        }
    });
}

fn done(session: &Session, version: u64) -> Value {
    wait(session, "the last of a version", |h| h["version"] == version && h["done"] == true)
}

#[test]
fn a_small_frame_comes_first_and_the_whole_picture_in_the_end() {
    with_engine(|session| {
        let last = done(session, 1);
        assert_eq!((last["samples"].as_u64(), last["size"].clone()), (Some(4), json!([96, 64])));
        // The plane is, but for the order of sums, that of all samples at once.
        let live = lock(&session.live).clone().unwrap();
        let mut shot = Shot::prepare(&for_finder(&session_shot(session)), &mut |_| ()).unwrap();
        let go_on = AtomicBool::new(false);
        let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        shot.focus(&watch, &mut |_| ()).unwrap();
        shot.meter(&watch, &mut |_| ()).unwrap();
        let whole = shot.expose(&watch).unwrap();
        let denoised = Filter::BuiltIn.denoise(&frame::without_outliers(&whole), None).unwrap();
        assert_eq!(live.plane.facts.samples, 4);
        let expected = if live.plane.facts.denoiser.contains("built-in") { &denoised } else { &whole };
        if live.plane.facts.denoiser.contains("built-in") || live.plane.facts.denoiser.is_empty() {
            let worst =
                live.plane.mean.data.iter().zip(&expected.mean.data).map(|(a, b)| (a - b).abs() / b.max(1.0)).fold(0.0, f32::max);
            // Single precision, through a filter that compares neighbours.
            assert!(worst < 1e-2, "{worst}");
        }
    });
}

fn session_shot(session: &Session) -> ShotFile {
    let state: Value = serde_json::from_str(&session.state.borrow().clone()).unwrap();
    serde_json::from_value(state["shot"].clone()).unwrap()
}

#[test]
fn what_a_dial_does_not_touch_is_not_exposed_again() {
    with_engine(|session| {
        done(session, 1);
        // Development, ISO and time go on from all samples that are there. The first frame may be a smaller one, where developing takes long.
        for (k, patch) in [
            json!({ "develop": { "exposure": { "ev": 1.0 } } }),
            json!({ "exposure": { "iso": 400 } }),
            json!({ "exposure": { "mode": "M", "shutter": "1/60 s" } }),
            json!({ "exposure": { "compensation": 1 } }),
        ]
        .iter()
        .enumerate()
        {
            let version = 2 + k as u64;
            session.set(patch).unwrap();
            let first = wait(session, "the first of a version", |h| h["version"] == version);
            assert_eq!(first["samples"], 4, "{patch}");
            done(session, version);
        }
        // An aperture is a new exposure, from the first sample on.
        let before = lock(&session.live).clone().unwrap().plane.facts.f_number;
        session.set(&json!({ "exposure": { "aperture": "f/2" } })).unwrap();
        done(session, 6);
        let after = lock(&session.live).clone().unwrap().plane.facts.f_number;
        assert!(before != after && after == 2.0);
    });
}

#[test]
fn a_scaled_plane_is_that_of_the_other_time() {
    with_engine(|session| {
        session.set(&json!({ "exposure": { "mode": "M", "shutter": "1/100 s" }, "render": { "denoise": "off" } })).unwrap();
        done(session, 2);
        let electrons = |session: &Session| lock(&session.live).clone().unwrap().plane.mean.data.clone();
        let short = electrons(session);
        session.set(&json!({ "exposure": { "shutter": "1/50 s" } })).unwrap();
        done(session, 3);
        let long = electrons(session);
        let worst = short.iter().zip(&long).map(|(a, b)| (2.0 * a - b).abs() / b.max(1.0)).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{worst}");
    });
}

#[test]
fn what_cannot_be_taken_goes_back() {
    with_engine(|session| {
        done(session, 1);
        session.set(&json!({ "camera": { "lens": "tessar-50mm-f2.7" } })).unwrap();
        wait(session, "the shot before", |h| h["version"] == 3);
        let state: Value = serde_json::from_str(&session.state.borrow().clone()).unwrap();
        let problem = &state["problem"]["problem"];
        assert_eq!(problem["place"], "lens", "{state}");
        assert!(problem["hint"].as_str().is_some_and(|h| h.contains("tessar-50mm-f2.8")), "{problem}");
        assert!(state["shot"]["camera"]["lens"].is_null());
    });
}

#[test]
fn a_click_focuses_and_the_lens_stays_there() {
    with_engine(|session| {
        done(session, 1);
        session.focus([0.5, 0.5]).unwrap();
        done(session, 2);
        let shot = session_shot(session);
        assert!(matches!(shot.focus.distance, Some(FocusTo::Extension(_))), "{:?}", shot.focus);
        let state: Value = serde_json::from_str(&session.state.borrow().clone()).unwrap();
        assert!(state["focus"]["confidence"].is_number(), "{state}");
    });
}

#[test]
fn a_flash_adds_its_light_and_is_not_metered() {
    with_engine(|session| {
        let by_hand = json!({ "mode": "M", "shutter": "1/60 s", "aperture": "f/5.6", "iso": 100 });
        session.set(&json!({ "exposure": by_hand, "render": { "denoise": "off", "spp": 16 } })).unwrap();
        let light = |version: u64| {
            done(session, version);
            let live = lock(&session.live).clone().unwrap();
            live.plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>()
        };
        let facts = || serde_json::from_str::<Value>(&session.state.borrow().clone()).unwrap()["facts"].clone();
        let without = light(2);
        let metered = facts()["exposure"]["metered_ev100"].as_f64().unwrap();
        session.set(&json!({ "flash": { "guide_number": 40 } })).unwrap();
        let full = light(3) - without;
        assert!(full > 0.05 * without && facts()["exposure"]["flash"] == true, "{full} {without}");
        // Once more with the flash of the frame before in the scene: the meter looks before it fires.
        session.set(&json!({ "exposure": { "metering": "centre-weighted" } })).unwrap();
        light(4);
        session.set(&json!({ "exposure": { "metering": "average" } })).unwrap();
        light(5);
        let again = facts()["exposure"]["metered_ev100"].as_f64().unwrap();
        assert!((again - metered).abs() < 0.1, "{again} {metered}");
        // A quarter of the power is a quarter of its light.
        session.set(&json!({ "flash": { "power": 0.25 } })).unwrap();
        let quarter = light(6) - without;
        assert!((quarter / full - 0.25).abs() < 0.05, "{quarter} {full}");
        session.set(&json!({ "flash": null })).unwrap();
        let off = light(7);
        assert!((off / without - 1.0).abs() < 0.01 && facts()["exposure"]["flash"] == false, "{off} {without}");
    });
}

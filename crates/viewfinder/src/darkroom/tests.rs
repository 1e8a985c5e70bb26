use super::*;
use diopter::denoising::Denoise;
use diopter::quantity::Size;
use std::time::Duration;

fn small() -> ShotFile {
    let mut shot = ShotFile::default();
    shot.scene.file = Some("color-chart".into());
    shot.render.size = Some(Size { width: 48, height: 32 });
    (shot.render.spp, shot.render.denoise) = (Some(2), Some(Denoise::Off));
    shot
}

fn until(what: &str, is: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is() {
        assert!(begun.elapsed() < Duration::from_secs(180), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A darkroom at work, which ends with the test, whatever comes of it.
fn with_darkroom(test: impl FnOnce(&Darkroom)) {
    struct Ends<'a>(&'a Darkroom);
    impl Drop for Ends<'_> {
        fn drop(&mut self) {
            self.0.end();
        }
    }
    let darkroom = Darkroom::new(|| "2026:01:01 00:00:00".into()).unwrap();
    std::thread::scope(|scope| {
        scope.spawn(|| darkroom.run(&|| ()));
        let ends = Ends(&darkroom);
        test(ends.0);
    });
}

#[test]
fn a_picture_and_the_shot_file_that_repeats_it() {
    with_darkroom(|darkroom| {
        let id = darkroom.queue(small(), None).unwrap();
        until("the picture", || darkroom.file(id, "dng").is_some());
        let read = |ending: &str| std::fs::read(darkroom.file(id, ending).unwrap()).unwrap();
        let raw = diopter::image::dng::read(std::io::Cursor::new(read("dng"))).unwrap();
        assert_eq!(raw.header.facts.date.as_deref(), Some("2026:01:01 00:00:00"));
        // Taken again from its shot file it is the same, number by number.
        let again = ShotFile::read(&darkroom.file(id, "toml").unwrap()).unwrap();
        let mut shot = Shot::prepare(&again, &mut |_| ()).unwrap();
        let go_on = AtomicBool::new(false);
        let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        shot.focus(&watch, &mut |_| ()).unwrap();
        shot.meter(&watch, &mut |_| ()).unwrap();
        let plane = shot.expose(&watch).unwrap();
        assert!(shot.read_out(&plane).unwrap().mosaic == raw.mosaic);
        assert!(read("jpg").starts_with(&[0xff, 0xd8]) && read("thumbnail.jpg").starts_with(&[0xff, 0xd8]));
        assert!(read("exr").starts_with(&[0x76, 0x2f, 0x31, 0x01]));
        for wrong in ["../1/photo-0001.dng", "txt", ""] {
            assert!(darkroom.file(id, wrong).is_none());
        }
        darkroom.discard(id);
        assert!(darkroom.file(id, "dng").is_none() && std::fs::read_dir(darkroom.folder.path()).unwrap().next().is_none());
    });
}

#[test]
fn pictures_are_cancelled_and_failures_are_told() {
    with_darkroom(|darkroom| {
        let mut long = small();
        long.render.spp = Some(1 << 20);
        let id = darkroom.queue(long, None).unwrap();
        let waiting = darkroom.queue(small(), None).unwrap();
        until("exposing", || darkroom.told().0["jobs"][0]["what"] == "exposing");
        darkroom.cancel(waiting);
        darkroom.cancel(id);
        until("the end", || darkroom.told().0["jobs"].as_array().unwrap().is_empty());
        assert!(darkroom.told().1.as_array().unwrap().is_empty());
        let mut wrong = small();
        wrong.camera.lens = Some("planr".into());
        darkroom.queue(wrong, None).unwrap();
        until("the failure", || darkroom.told().0["failed"]["problem"]["place"] == "lens");
    });
}

#[test]
fn the_queue_is_bounded() {
    let darkroom = Darkroom::new(String::new).unwrap();
    for _ in 0..MOST_WAITING {
        darkroom.queue(small(), None).unwrap();
    }
    assert!(darkroom.queue(small(), None).is_err());
    // A series fits whole or not at all.
    darkroom.cancel(1);
    darkroom.cancel(2);
    let bracket = |count| Some(Series::Bracket { count, step_ev: 1.0 });
    assert!(darkroom.queue(small(), bracket(3)).is_err());
    let waiting = || darkroom.told().0["jobs"].as_array().unwrap().len();
    assert_eq!(waiting(), MOST_WAITING - 2);
    let id = darkroom.queue(small(), bracket(2)).unwrap();
    assert!(waiting() == MOST_WAITING && darkroom.check_room(1).is_err());
    let job = darkroom.told().0["jobs"][MOST_WAITING - 1].clone();
    let expected = json!({ "id": id, "number": 2, "of": 2, "differs": null });
    assert_eq!((job["id"].as_u64(), &job["series"]), (Some(id + 1), &expected));
    // The others wait on.
    darkroom.cancel_series(id);
    assert_eq!(waiting(), MOST_WAITING - 2);
}

/// Takes a series to its end; the film strip as pages see it.
fn film_of(darkroom: &Darkroom, shot: ShotFile, series: Series) -> Vec<Value> {
    darkroom.queue(shot, Some(series)).unwrap();
    until("the series", || darkroom.told().0["jobs"].as_array().unwrap().is_empty());
    assert!(darkroom.told().0["failed"].is_null(), "{}", darkroom.told().0);
    darkroom.told().1.as_array().unwrap().clone()
}

/// The light of a picture: its raw numbers above black.
fn light(darkroom: &Darkroom, id: u64) -> f64 {
    let bytes = std::fs::read(darkroom.file(id, "dng").unwrap()).unwrap();
    let raw = diopter::image::dng::read(std::io::Cursor::new(bytes)).unwrap();
    raw.mosaic.data.iter().map(|dn| f64::from(*dn) - raw.header.black_level).sum()
}

/// Whether a shot file, taken by itself, gives the raw numbers of a picture.
fn is_repeated(darkroom: &Darkroom, id: u64) -> bool {
    let bytes = std::fs::read(darkroom.file(id, "dng").unwrap()).unwrap();
    let raw = diopter::image::dng::read(std::io::Cursor::new(bytes)).unwrap();
    let file = ShotFile::read(&darkroom.file(id, "toml").unwrap()).unwrap();
    let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
    let go_on = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    let plane = shot.expose(&watch).unwrap();
    shot.read_out(&plane).unwrap().mosaic == raw.mosaic
}

#[test]
fn a_bracket_is_pictures_of_half_once_and_twice_the_light() {
    with_darkroom(|darkroom| {
        let mut shot = small();
        // What is white stays below the full well.
        shot.exposure.compensation = Some(diopter::quantity::Ev(-1.0));
        shot.render.spp = Some(16);
        let film = film_of(darkroom, shot, Series::Bracket { count: 3, step_ev: 1.0 });
        assert_eq!(film.len(), 3);
        for (k, ev) in [-1.0, 0.0, 1.0].iter().enumerate() {
            let series = &film[k]["series"];
            assert_eq!((series["number"].as_u64(), series["of"].as_u64()), (Some(k as u64 + 1), Some(3)));
            assert!((series["differs"]["ev"].as_f64().unwrap() - ev).abs() < 1e-9, "{series}");
            assert_eq!(film[k]["command"], format!("diopter shoot photo-000{}.toml", k + 1));
        }
        let time = |k: usize| film[k]["facts"]["exposure_s"].as_f64().unwrap();
        assert!((time(1) / time(0) - 2.0).abs() < 1e-9 && (time(2) / time(1) - 2.0).abs() < 1e-9, "{film:?}");
        // 1536 pixels of some thousand electrons, each of 16 paths: the sum is known to a per cent.
        let [dark, middle, bright] = [1, 2, 3].map(|id| light(darkroom, id));
        assert!((middle / dark - 2.0).abs() < 0.1 && (bright / middle - 2.0).abs() < 0.1, "{dark} {middle} {bright}");
        assert!((1..=3).all(|id| is_repeated(darkroom, id)));
    });
}

#[test]
fn a_focus_stack_goes_from_near_to_far() {
    with_darkroom(|darkroom| {
        let film = film_of(darkroom, small(), Series::Focus { count: 3, near_m: 0.5, far_m: None });
        let focused: Vec<Option<f64>> = film.iter().map(|p| p["facts"]["focus_distance_m"].as_f64()).collect();
        assert!((focused[0].unwrap() - 0.5).abs() < 1e-6 && (focused[1].unwrap() - 1.0).abs() < 1e-6, "{focused:?}");
        assert_eq!(focused[2], None);
        assert_eq!(film[2]["series"]["differs"], json!({ "focus_m": null }));
        let exposures: Vec<&Value> = film.iter().map(|p| &p["facts"]["exposure_s"]).collect();
        assert!(exposures.iter().all(|e| *e == exposures[0]), "{exposures:?}");
        assert!(is_repeated(darkroom, 2));
    });
}

#[test]
fn a_series_is_cancelled_whole_or_picture_by_picture() {
    with_darkroom(|darkroom| {
        let mut long = small();
        long.render.spp = Some(1 << 20);
        let bracket = Some(Series::Bracket { count: 5, step_ev: 0.5 });
        let first = darkroom.queue(long.clone(), bracket).unwrap();
        let other = darkroom.queue(long, bracket).unwrap();
        until("exposing", || darkroom.told().0["jobs"][0]["what"] == "exposing");
        // By then the series is settled.
        let ev = darkroom.told().0["jobs"][1]["series"]["differs"]["ev"].as_f64().unwrap();
        assert!((ev + 0.5).abs() < 1e-9, "{ev}");
        // One of them: the series goes on with the next.
        darkroom.cancel(first);
        let exposes = |id: u64| {
            let jobs = darkroom.told().0["jobs"].clone();
            jobs[0]["what"] == "exposing" && jobs[0]["id"].as_u64() == Some(id)
        };
        until("the second", || exposes(first + 1));
        darkroom.cancel_series(first);
        until("the other series", || exposes(other));
        assert_eq!(darkroom.told().0["jobs"].as_array().unwrap().len(), 5);
        darkroom.cancel_series(other);
        until("the end", || darkroom.told().0["jobs"].as_array().unwrap().is_empty());
        assert!(darkroom.told().1.as_array().unwrap().is_empty() && darkroom.told().0["failed"].is_null());
        // What the lens cannot do fails once, for all.
        darkroom.queue(small(), Some(Series::Focus { count: 4, near_m: 0.001, far_m: None })).unwrap();
        until("the failure", || darkroom.told().0["failed"].is_object());
        until("the end", || darkroom.told().0["jobs"].as_array().unwrap().is_empty());
        assert!(darkroom.told().1.as_array().unwrap().is_empty());
    });
}

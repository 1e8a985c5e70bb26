//! The program as a user meets it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("diopter-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_diopter")).args(args).current_dir(&self.0).output().unwrap()
    }

    fn ok(&self, args: &[&str]) -> Output {
        let output = self.run(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        output
    }

    /// Runs what must fail: its exit code and message. Nothing may be left in the folder that was not there.
    fn fails(&self, args: &[&str]) -> (i32, String) {
        let before = self.files();
        let output = self.run(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!message.contains("panicked"), "{args:?}: {message}");
        assert_eq!(before, self.files(), "{args:?} left files behind");
        (output.status.code().unwrap(), message)
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = std::fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const SMALL: &[&str] = &["--size", "48x32", "--spp", "2"];

fn with<'a>(first: &[&'a str], rest: &[&'a str]) -> Vec<&'a str> {
    [first, SMALL, rest].concat()
}

#[test]
fn shoot_without_a_scene_writes_photo_jpg() {
    let f = Folder::new("shoot");
    let output = f.ok(&with(&["shoot", "--json"], &[]));
    assert!(std::fs::read(f.path("photo.jpg")).unwrap().starts_with(&[0xff, 0xd8]));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["size"], serde_json::json!([48, 32]));
    assert_eq!(json["facts"]["scene"], "still-life");
    assert!(String::from_utf8_lossy(&output.stderr).contains("f/2"));
    assert_eq!(f.files().len(), 1);
}

#[test]
fn the_steps_taken_apart_give_the_same_picture() {
    let f = Folder::new("steps");
    f.ok(&with(&["shoot", "cornell", "--shutter", "1/30", "--seed", "7"], &["-o", "whole.png", "-o", "linear.exr"]));
    f.ok(&with(&["expose", "cornell", "--shutter", "1/30", "--seed", "7"], &["-o", "plane.exr"]));
    f.ok(&["read-out", "plane.exr", "--seed", "7", "-o", "raw.exr"]);
    f.ok(&["develop", "raw.exr", "-o", "parts.png"]);
    assert_eq!(std::fs::read(f.path("whole.png")).unwrap(), std::fs::read(f.path("parts.png")).unwrap());
    // Another noise seed is another picture.
    f.ok(&["read-out", "plane.exr", "--seed", "8", "-o", "raw.exr"]);
    f.ok(&["develop", "raw.exr", "-o", "other.png", "--tone", "reinhard"]);
    assert_ne!(std::fs::read(f.path("whole.png")).unwrap(), std::fs::read(f.path("other.png")).unwrap());
}

#[test]
fn parts_of_an_exposure_are_merged() {
    let f = Folder::new("merge");
    let expose = |samples: &str, out: &str| {
        f.ok(&["expose", "cornell", "--size", "32x32", "--spp", "8", "--shutter", "1/30", "--samples", samples, "-o", out]);
    };
    expose("0..4", "a.exr");
    expose("4..8", "b.exr");
    f.ok(&["merge", "b.exr", "a.exr", "-o", "whole.exr"]);
    f.ok(&["read-out", "whole.exr", "-o", "raw.exr"]);
    let (code, message) = f.fails(&["merge", "a.exr", "a.exr", "-o", "twice.exr"]);
    assert_eq!(code, 2);
    assert!(message.contains("samples 0..4"), "{message}");
}

#[test]
fn a_saved_shot_repeats_the_photograph() {
    let f = Folder::new("saved");
    f.ok(&with(&["shoot", "cornell", "--iso", "ISO 200"], &["-o", "a.png", "--save-shot", "shot.toml"]));
    f.ok(&["shoot", "shot.toml", "-o", "b.png"]);
    assert_eq!(std::fs::read(f.path("a.png")).unwrap(), std::fs::read(f.path("b.png")).unwrap());
}

#[test]
fn time_limits_and_threads_are_kept() {
    let f = Folder::new("limit");
    let started = std::time::Instant::now();
    f.ok(&["shoot", "cornell", "--size", "64x64", "--time-limit", "1s", "--threads", "2", "-o", "a.png"]);
    // Metering, tables and start-up come on top; a limit that is ignored would take minutes.
    assert!(started.elapsed().as_secs() < 20);
}

#[test]
fn wrong_requests_exit_with_2_and_a_hint() {
    let f = Folder::new("wrong");
    std::fs::write(f.path("bad.toml"), "[exposure]\napperture = \"f/2\"\n").unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["shoot", "--aperture", "f/0"], "above 0"),
        (&["shoot", "--iso", "-100"], "ISO"),
        (&["shoot", "--spp", "0"], "1 to"),
        (&["shoot", "--shutter", "0"], "above 0"),
        (&["shoot", "--size", "0x10"], "1 to 65535"),
        (&["shoot", "--size", "100000x100000"], "1 to 65535"),
        (&["shoot", "--size", "big"], "1920x1280"),
        (&["shoot", "stil-life"], "did you mean \"still-life\"?"),
        (&["shoot", "--body", "nikon-d580"], "did you mean \"nikon-d850\"?"),
        (&["shoot", "--format", "full fram"], "did you mean \"full frame\"?"),
        (&["shoot", "--lens", "sonar-50mm-f2"], "did you mean \"sonnar-50mm-f2\"?"),
        (&["shoot", "--lens", "double-gauss-50mm", "--aperture", "f/1.2"], "this lens opens no wider"),
        (&["shoot", "--lens", "double-gauss-50mm", "--focus", "1mm"], "no image"),
        (&["shoot", "--white", "D66"], "D65"),
        (&["shoot", "--tone", "filmy"], "aces, reinhard or linear"),
        (&["shoot", "--sampler", "halton"], "sobol, jittered"),
        (&["shoot", "--samples", "9..3"], "A < B"),
        (&["shoot", "--focus", "0.01m"], "more than the focal length"),
        (&["shoot", "--blades", "2"], "3 to 64"),
        (&["shoot", "--look-from", "1,2,3", "--look-at", "1,2,3"], "same point"),
        (&["shoot", "--look-from", "0,1,0", "--look-at", "0,0,0"], "such as [0, 0, 1]"),
        (&["shoot", "-o", "photo.gif"], ".jpg, .png or .exr"),
        (&["expose", "-o", "plane.png"], ".exr"),
        (&["shoot", "--time-limit", "0s"], "above 0"),
        (&["body", "info", "leica-m3"], "known are"),
        (&["shoot", "--threads", "0"], "threads"),
        (&["frobnicate"], "unrecognized subcommand"),
    ];
    for (args, expected) in cases {
        let (code, message) = f.fails(args);
        assert!(message.contains(expected), "{args:?}: {message}");
        assert_eq!(code, 2, "{args:?}: {message}");
    }
    let (_, message) = f.fails(&["shoot", "bad.toml"]);
    assert!(message.contains("bad.toml") && message.contains("line 2") && message.contains("aperture"), "{message}");
}

#[test]
fn failures_exit_with_1_and_leave_nothing() {
    let f = Folder::new("failures");
    std::fs::write(f.path("short.glb"), b"glTF\x02\0\0\0\xff\xff\0\0").unwrap();
    std::fs::write(f.path("text.gltf"), b"not json").unwrap();
    std::fs::write(f.path("text.exr"), b"not exr").unwrap();
    std::fs::write(f.path("text.hdr"), b"not hdr").unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["shoot", "missing.glb"], "no such file"),
        (&["shoot", "short.glb"], "cut short"),
        (&["shoot", "text.gltf"], "text.gltf"),
        (&["shoot", "missing.toml"], "missing.toml"),
        (&["shoot", "--environment", "text.hdr"], "text.hdr"),
        (&["shoot", "-o", "no/such/folder/photo.jpg"], "cannot be written"),
        (&["read-out", "text.exr", "-o", "raw.exr"], "text.exr"),
        (&["read-out", "missing.exr", "-o", "raw.exr"], "missing.exr"),
        (&["develop", "text.exr", "-o", "a.png"], "text.exr"),
    ];
    for (args, expected) in cases {
        let (code, message) = f.fails(args);
        assert!(message.contains(expected), "{args:?}: {message}");
        assert_eq!(code, 1, "{args:?}: {message}");
    }
}

#[test]
fn lists_and_sheets_are_printed() {
    let f = Folder::new("lists");
    let text = |args: &[&str]| String::from_utf8(f.ok(args).stdout).unwrap();
    assert!(text(&["scene", "list"]).contains("cornell"));
    assert!(text(&["scene", "info", "cornell"]).contains("30 triangles"));
    assert!(text(&["body", "list"]).contains("Nikon D850"));
    let sheet: serde_json::Value = serde_json::from_str(&text(&["body", "info", "canon-5d-mark-ii", "--json"])).unwrap();
    assert_eq!(sheet["pixels"], serde_json::json!([5616, 3744]));
    assert!(text(&["completions", "bash"]).contains("diopter"));
    assert!(text(&["man"]).contains(".TH"));
}

#[test]
fn real_scenes_are_photographed() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/scenes");
    if !shared.exists() {
        println!("skipped: no scenes at {}", shared.display());
        return;
    }
    let f = Folder::new("real");
    let hdr = shared.join("hdri_venice/venice.hdr").display().to_string();
    for name in [
        "gltf_FlightHelmet/FlightHelmet.gltf",
        "gltf_CesiumMilkTruck/CesiumMilkTruck.glb",
        "gltf_Fox/Fox.glb",
        "gltf_Box/Box.gltf",
        "gltf_bevy_CornellBox/CornellBox.glb",
        "gltf_bevy_TonemappingTest/TonemappingTest.gltf",
    ] {
        let scene = shared.join(name).display().to_string();
        f.ok(&with(&["shoot", &scene, "--environment", &hdr, "--ambient-ev", "12"], &["-o", "a.png"]));
        f.ok(&["scene", "info", &scene]);
    }
}

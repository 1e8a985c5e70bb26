//! The program as a user meets it.

use crate::common::Folder;
use diopter::image::channels::CHANNELS;
use diopter::image::cryptomatte::murmur3;
use diopter::image::exr::{read_focal_plane, read_maps, read_plane};
use std::path::Path;
use std::process::Command;

#[path = "../../../diopter/tests/it/common/generated.rs"]
mod generated;

/// What a PNG shows, packed: its data without the facts (a saved shot is mode M, whoever chose before).
fn pixels(path: &Path) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let (mut at, mut data) = (8, Vec::new());
    while at + 8 <= bytes.len() {
        let length = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        if &bytes[at + 4..at + 8] == b"IDAT" {
            data.extend(&bytes[at + 8..at + 8 + length]);
        }
        at += 12 + length;
    }
    assert!(!data.is_empty());
    data
}

fn read_plane_of(f: &Folder, name: &str) -> Vec<f32> {
    read_focal_plane(std::io::Cursor::new(f.read(name))).unwrap().mean.data
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
    let whole = ["shoot", "cornell", "--shutter", "1/30", "--seed", "7", "--denoise", "off"];
    f.ok(&with(&whole, &["-o", "whole.png", "-o", "linear.exr"]));
    f.ok(&with(&["expose", "cornell", "--shutter", "1/30", "--seed", "7"], &["-o", "plane.exr"]));
    f.ok(&["read-out", "plane.exr", "--seed", "7", "-o", "raw.dng"]);
    f.ok(&["develop", "raw.dng", "-o", "parts.png"]);
    assert_eq!(std::fs::read(f.path("whole.png")).unwrap(), std::fs::read(f.path("parts.png")).unwrap());
    // A small picture alone is read in full color.
    f.ok(&with(&whole, &["-o", "colors.png", "--save-shot", "alone.toml"]));
    f.ok(&["shoot", "alone.toml", "-o", "again.png"]);
    assert_eq!(f.read("colors.png"), f.read("again.png"));
    // What is saved beside a raw file is compared with later pictures: they keep its mosaic.
    f.ok(&with(&whole, &["-o", "beside.png", "-o", "beside.dng", "--save-shot", "beside.toml"]));
    f.ok(&["shoot", "beside.toml", "-o", "later.png"]);
    assert_eq!(f.read("whole.png"), f.read("later.png"));
    f.ok(&["read-out", "plane.exr", "--seed", "7", "--color-sampling", "full", "-o", "linear.dng"]);
    f.ok(&["develop", "linear.dng", "-o", "colors-by-parts.png"]);
    assert_eq!(f.read("colors.png"), f.read("colors-by-parts.png"));
    assert_ne!(f.read("colors.png"), f.read("whole.png"));
    f.ok(&with(&whole, &["--color-sampling", "mosaic", "-o", "mosaic.png"]));
    assert_eq!(f.read("mosaic.png"), f.read("whole.png"));
    let (code, told) = f.fails(&with(&whole, &["--color-sampling", "full", "--truth", "t.exr", "-o", "a.dng"]));
    assert!(code == 2 && told.contains("--color-sampling full") && told.contains("expected mosaic"), "{code} {told}");
    // Another noise seed is another picture.
    f.ok(&["read-out", "plane.exr", "--seed", "8", "-o", "raw.dng"]);
    f.ok(&["develop", "raw.dng", "-o", "other.png", "--tone", "reinhard"]);
    assert_ne!(std::fs::read(f.path("whole.png")).unwrap(), std::fs::read(f.path("other.png")).unwrap());
}

#[test]
fn pictures_to_look_at_are_denoised_and_raw_files_are_not() {
    let f = Folder::new("denoise");
    let shoot = |which: &[&str], files: &[&str]| -> serde_json::Value {
        let output = f.ok(&with(&["shoot", "cornell", "--shutter", "1/30", "--json"], &[which, files].concat()));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let both = shoot(&[], &["-o", "auto.png", "-o", "auto.dng"]);
    let off = shoot(&["--denoise", "off"], &["-o", "off.png", "-o", "off.dng"]);
    let on = shoot(&["--denoise", "builtin"], &["-o", "on.png", "-o", "on.dng"]);
    let one = shoot(&["--color-sampling", "mosaic"], &["-o", "one.png"]);
    // Facts of a shot are those of its raw file, if there is one.
    assert_eq!((both["facts"]["denoised"].as_bool(), off["facts"]["denoised"].as_bool()), (Some(false), Some(false)));
    assert_eq!((on["facts"]["denoised"].as_bool(), one["facts"]["denoised"].as_bool()), (Some(true), Some(true)));
    assert_eq!(on["facts"]["denoiser"], "built-in regression");
    assert!(one["facts"]["denoiser"].as_str().is_some_and(|d| !d.is_empty()));
    assert!(f.read("auto.dng") == f.read("off.dng") && f.read("on.dng") != f.read("off.dng"));
    assert!(
        pixels(&f.path("auto.png")) != pixels(&f.path("off.png")) && pixels(&f.path("auto.png")) == pixels(&f.path("one.png"))
    );
    // An exposure is what was computed.
    let exposed = f.ok(&with(&["expose", "cornell", "--json"], &["-o", "plane.exr"]));
    let exposed: serde_json::Value = serde_json::from_slice(&exposed.stdout).unwrap();
    assert_eq!(exposed["facts"]["denoised"], false);
    f.ok(&["denoise", "plane.exr", "--by", "builtin", "-o", "calm.exr"]);
    for args in [&["--denoise", "oidn"][..], &["--denoise", "on"], &[]] {
        let (code, message) = f.fails(&with(&[&["shoot", "--oidn", "gone.so", "-o", "x.jpg"][..], args].concat(), &[]));
        assert!(code == 1 && message.contains("gone.so") && message.contains("builtin"), "{args:?}: {code} {message}");
    }
    let (code, message) = f.fails(&["shoot", "--denoise", "maybe", "-o", "x.jpg"]);
    assert!(code == 2 && message.contains("builtin"), "{code} {message}");
}

#[test]
fn classes_of_a_table_and_names_beside_the_truth_are_written() {
    let f = Folder::new("classes");
    std::fs::write(f.path("classes.csv"), "# bars\n* bar, bar\nnothing*, x\n").unwrap();
    let shot = ["shoot", "moving-bars", "--size", "24x16", "--shutter", "1/60", "--spp", "4", "--classes", "classes.csv"];
    let with = |more: &[&'static str]| [&shot[..], more].concat();
    f.ok(&with(&["--truth-channels", "class,crypto-class", "--truth", "t.exr", "--truth-sidecar", "-o", "a.dng"]));
    let file = || std::fs::File::open(f.path("t.exr")).unwrap();
    let maps = read_maps(file(), &["class"]).unwrap();
    let classes: Vec<String> = serde_json::from_str(maps.attribute("diopter.classes").unwrap()).unwrap();
    // Those of the table first, also what nothing is.
    assert_eq!(classes, ["bar", "x", "unclassified"]);
    let class = read_plane(file(), "class").unwrap();
    assert!(class.contains(&1.0) && class.contains(&3.0));
    // The sidecar holds what the header holds, under the name that the header gives.
    let key = |what: &str| format!("cryptomatte/{}/{what}", &format!("{:08x}", murmur3("CryptoClass"))[..7]);
    assert_eq!(maps.attribute(&key("manif_file")), Some("t.CryptoClass.json"));
    let beside = std::fs::read_to_string(f.path("t.CryptoClass.json")).unwrap();
    assert_eq!(maps.attribute(&key("manifest")), Some(&*beside));
    std::fs::write(f.path("wrong.csv"), "bar*\n").unwrap();
    let (code, message) = f.fails(&["shoot", "moving-bars", "--classes", "wrong.csv", "-o", "x.jpg"]);
    assert!(code == 2 && message.contains("wrong.csv") && message.contains("line 1"), "{code} {message}");
}

#[test]
fn truth_channels_are_written_where_they_are_asked_for() {
    let f = Folder::new("truth-channels");
    let shot = ["expose", "moving-bars", "--size", "24x16", "--shutter", "1/60", "--spp", "4"];
    let with = |more: &[&'static str]| [&shot[..], more].concat();
    f.ok(&with(&["-o", "plain.exr"]));
    f.ok(&with(&["--truth-channels", "all", "-o", "all.exr"]));
    let plane = |name: &str| read_focal_plane(std::fs::File::open(f.path(name)).unwrap()).unwrap();
    let (plain, all) = (plane("plain.exr"), plane("all.exr"));
    assert_eq!((&plain.mean, plain.truth.depth(), plain.truth.id()), (&all.mean, all.truth.depth(), all.truth.id()));
    assert!(plain.truth.recorded().more().is_empty() && plain.truth.float("flow").is_none());
    let recorded = all.truth.recorded();
    assert_eq!((recorded.channels().len(), recorded.samples), (CHANNELS.len(), 4));
    assert!(!recorded.objects.is_empty() && recorded.manifests.len() == 3 && *recorded.classes == ["unclassified"]);
    // The bars move to the right, the wall stands.
    let flow = all.truth.float("flow").unwrap();
    let moving = |x: &f32| x.is_finite() && x.abs() > 0.1;
    let across = flow.channel(0);
    assert!(across.iter().any(moving) && across.iter().any(|x| x.abs() < 1e-3), "{across:?}");
    // Parts merge to the same coverage.
    for (samples, name) in [("0..1", "a.exr"), ("1..4", "b.exr")] {
        f.ok(&with(&["--samples", samples, "--truth-channels", "coverage,crypto-object", "-o", name]));
    }
    f.ok(&["merge", "a.exr", "b.exr", "-o", "merged.exr"]);
    let merged = plane("merged.exr");
    for (a, b) in merged.truth.float("coverage").unwrap().data.iter().zip(&all.truth.float("coverage").unwrap().data) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    assert_eq!(merged.truth.recorded().samples, 4);
    let (code, message) = f.fails(&with(&["--truth-channels", "deepness", "-o", "x.exr"]));
    assert!(code == 2 && message.contains("\"deepness\"") && message.contains("backward-flow"), "{code} {message}");
    let (code, message) = f.fails(&with(&["--truth-channels", "coc", "--quick", "-o", "x.exr"]));
    assert!(code == 2 && message.contains("quick"), "{code} {message}");
}

#[test]
fn one_exposure_gives_many_raw_files_and_the_truth() {
    let f = Folder::new("raw");
    f.ok(&["expose", "color-chart", "--size", "90x60", "--spp", "2", "--shutter", "1/30", "-o", "plane.exr"]);
    f.ok(&["read-out", "plane.exr", "--shots", "3", "--truth", "truth.exr", "--iso", "800", "-o", "raw.dng"]);
    let read = |name: &str| std::fs::read(f.path(name)).unwrap();
    assert_ne!(read("raw-001.dng"), read("raw-002.dng"));
    assert!(f.path("raw-003.dng").exists() && !f.path("raw.dng").exists() && !f.path("raw-004.dng").exists());
    // The second of many is the first of the next seed.
    f.ok(&["read-out", "plane.exr", "--seed", "2", "--iso", "800", "-o", "again.dng"]);
    assert_eq!(read("again.dng"), read("raw-002.dng"));
    assert!(read("truth.exr").starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    let json = |args: &[&str]| serde_json::from_slice::<serde_json::Value>(&f.ok(args).stdout).unwrap();
    let told = json(&["read-out", "plane.exr", "--iso", "800", "--dng", "lossless", "-o", "small.dng", "--json"]);
    assert_eq!((told["cfa"].as_str(), told["black_level"].as_f64()), (Some("RG/GB"), Some(2048.0)));
    assert!(read("small.dng").len() < read("raw-001.dng").len());
    // Other bodies, serial numbers and temperatures are other files; a cap leaves the sensor alone.
    f.ok(&["read-out", "plane.exr", "--seed", "2", "--iso", "800", "--serial", "B", "-o", "other.dng"]);
    assert_ne!(read("other.dng"), read("again.dng"));
    // What is wrong is said, and where.
    for (args, said) in [(["--body", "imx249"], "Y"), (["--iso", "1e9"], "100 to 6400"), (["--temperature", "-300"], "-273")] {
        let (code, message) = f.fails(&[&["read-out", "plane.exr", "-o", "no.dng"], &args[..]].concat());
        assert!(code == 2 && message.contains("plane.exr") && message.contains(said), "{args:?}: {message}");
    }
    let (code, message) = f.fails(&["read-out", "plane.exr", "--shots", "99999999999", "-o", "no.dng"]);
    assert!(code == 2 && message.contains("1 to 1000000"), "{message}");
    std::fs::write(f.path("cut.exr"), &read("plane.exr")[..read("plane.exr").len() - 3000]).unwrap();
    let (code, message) = f.fails(&["read-out", "cut.exr", "-o", "no.dng"]);
    assert!(code == 1 && message.contains("cut.exr") && !message.contains("no.dng"), "{message}");
    f.ok(&[
        "shoot",
        "--lens-cap",
        "--shutter",
        "30s",
        "--temperature",
        "35",
        "--size",
        "40x30",
        "--body",
        "canon-t2i",
        "-o",
        "dark.dng",
    ]);
    f.ok(&["develop", "dark.dng", "-o", "dark.png"]);
}

#[test]
fn bodies_are_measured() {
    let f = Folder::new("bench");
    let args = ["body", "emva", "imx249", "--size", "64x64", "--stack", "8", "--export", "stack", "-o", "ptc.svg", "--json"];
    let report: serde_json::Value = serde_json::from_slice(&f.ok(&args).stdout).unwrap();
    let ratio = |key: &str| report["measured"][key].as_f64().unwrap() / report["sheet"][key].as_f64().unwrap();
    assert!((ratio("gain_dn_per_e") - 1.0).abs() < 0.05 && (ratio("quantum_efficiency") - 1.0).abs() < 0.05);
    assert!(std::fs::read_to_string(f.path("ptc.svg")).unwrap().contains("Photon transfer"));
    let description = std::fs::read_to_string(f.path("stack").join("description.txt")).unwrap();
    let pictures = description.lines().filter(|l| l.starts_with("i ")).count();
    assert_eq!(std::fs::read_dir(f.path("stack")).unwrap().count(), pictures + 1);
    let (code, message) = f.fails(&["body", "emva", "imx249", "--export", "stack"]);
    assert!(code == 2 && message.contains("new or empty"), "{message}");
    let speeds: serde_json::Value =
        serde_json::from_slice(&f.ok(&["body", "iso", "canon-t2i", "--iso", "100", "--json"]).stdout).unwrap();
    assert!((speeds["speeds"][0]["saturation"].as_f64().unwrap() - 100.0).abs() < 4.0);
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
    f.ok(&["read-out", "whole.exr", "-o", "raw.dng"]);
    let (code, message) = f.fails(&["merge", "a.exr", "a.exr", "-o", "twice.exr"]);
    assert_eq!(code, 2);
    assert!(message.contains("samples 0..4"), "{message}");
    // Of any number of bands.
    for (samples, out) in [("0..1", "s0.exr"), ("1..2", "s1.exr")] {
        f.ok(&[
            "expose",
            "cornell",
            "--size",
            "16x16",
            "--spp",
            "2",
            "--samples",
            samples,
            "--bands",
            "395..705/10nm",
            "-o",
            out,
        ]);
    }
    let merged = f.ok(&["merge", "s0.exr", "s1.exr", "-o", "spectral.exr", "--json"]);
    assert!(String::from_utf8_lossy(&merged.stderr).contains("2 samples"));
    // A sensor reads any number of bands.
    f.ok(&["read-out", "spectral.exr", "-o", "spectral.dng"]);
    assert!(f.path("spectral.dng").exists());
    // Metered parts, too, whatever their ranges; so does what a time limit left over.
    let metered = |extra: &[&str]| {
        f.ok(&[&["expose", "cornell", "--size", "32x32"], extra].concat());
    };
    metered(&["--spp", "16", "--samples", "0..2", "-o", "a.exr"]);
    metered(&["--spp", "16", "--samples", "2..16", "-o", "b.exr"]);
    f.ok(&["merge", "a.exr", "b.exr", "-o", "whole.exr"]);
    metered(&["--time-limit", "0.1s", "-o", "first.exr"]);
    metered(&["--spp", "65536", "--samples", "65532..65536", "-o", "rest.exr"]);
    f.ok(&["merge", "first.exr", "rest.exr", "-o", "whole.exr"]);
}

#[test]
fn series_and_films_are_numbered_and_merged() {
    let f = Folder::new("series");
    let small = ["--size", "48x32", "--spp", "2"];
    let series = ["shoot", "cornell", "--bracket", "3", "--step", "2ev", "-o", "s.dng", "--merge", "hdr.exr", "--json"];
    let output = f.ok(&[&series[..], &small[..]].concat());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let times: Vec<f64> = json["frames"].as_array().unwrap().iter().map(|p| p["exposure_s"].as_f64().unwrap()).collect();
    assert!((times[1] / times[0] - 4.0).abs() < 1e-9 && (times[2] / times[1] - 4.0).abs() < 1e-9, "{times:?}");
    f.ok(&["merge", "s-001.dng", "s-002.dng", "s-003.dng", "-o", "again.dng"]);
    f.ok(&["develop", "again.dng", "-o", "again.png"]);
    let (code, message) = f.fails(&["merge", "s-001.dng", "./s-001.dng", "-o", "x.exr"]);
    assert!(code == 2 && message.contains("named twice"), "{code} {message}");
    let (code, message) = f.fails(&["merge", "s-001.dng", "hdr.exr", "-o", "x.exr"]);
    assert!(code == 2 && message.contains("not both"), "{message}");
    // A series that is only wanted joined leaves no single pictures.
    f.ok(&[&["shoot", "cornell", "--bracket", "2", "--merge", "only.png"][..], &small[..]].concat());
    assert!(!f.path("photo-001.jpg").exists() && f.path("only.png").exists());
    let film = ["shoot", "propeller", "--frames", "3", "--fps", "50", "--shutter-angle", "90", "--json", "-o", "film.png"];
    let output = f.ok(&[&film[..], &small[..]].concat());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["frames"][2]["at_s"].as_f64(), Some(0.04));
    assert_eq!(json["facts"]["exposure_s"].as_f64(), Some(0.005));
    assert_ne!(std::fs::read(f.path("film-001.png")).unwrap(), std::fs::read(f.path("film-003.png")).unwrap());
}

#[test]
fn a_shot_with_everything_that_moves_is_repeated() {
    let f = Folder::new("everything");
    let moving = [
        "shoot",
        "rolling-ball",
        "--mode",
        "P",
        "--dial",
        "third",
        "--iso",
        "400",
        "--metering",
        "matrix",
        "--shake",
        "0.6",
        "--flash",
        "10",
        "--shutter-type",
        "focal-plane",
        "--flicker",
        "mains 50 Hz",
        "--at",
        "0.4s",
        "--nd",
        "ND2",
    ];
    f.ok(&with(&moving, &["-o", "a.png", "--save-shot", "shot.toml"]));
    f.ok(&["shoot", "shot.toml", "-o", "b.png"]);
    assert!(pixels(&f.path("a.png")) == pixels(&f.path("b.png")), "the pictures differ");
}

#[test]
fn a_saved_shot_repeats_the_photograph() {
    let f = Folder::new("saved");
    f.ok(&with(&["shoot", "cornell", "--iso", "ISO 200"], &["-o", "a.png", "--save-shot", "shot.toml"]));
    f.ok(&["shoot", "shot.toml", "-o", "b.png"]);
    assert!(pixels(&f.path("a.png")) == pixels(&f.path("b.png")), "the pictures differ");
    // What nobody asked for is written, too.
    f.ok(&with(&["shoot"], &["-o", "c.png", "--save-shot", "all.toml"]));
    let saved = std::fs::read_to_string(f.path("all.toml")).unwrap();
    for (key, value) in [
        ("file", "\"still-life\""),
        ("body", "\"canon-5d-mark-iv\""),
        ("serial", ""),
        ("lens", "\"thin\""),
        ("focal_length", "\"50 mm\""),
        ("look_from", "["),
        ("aperture", "\"f/2\""),
        ("distance", "\"0.83 m\""),
        ("kind", "\"global\""),
        ("white", "\"D65\""),
        ("seed", "1"),
        ("sampler", "\"sobol\""),
        ("max_depth", ""),
        ("integrator", "\"auto\""),
    ] {
        assert!(saved.lines().any(|l| l.starts_with(&format!("{key} = {value}"))), "{key}: {saved}");
    }
    f.ok(&["shoot", "all.toml", "-o", "d.png"]);
    assert!(pixels(&f.path("c.png")) == pixels(&f.path("d.png")), "the pictures differ");
}

#[test]
fn fireflies_are_re_weighted_in_pictures_and_kept_in_exposures() {
    let f = Folder::new("fireflies");
    let removed = |args: &[&str]| {
        let small = ["--size", "24x16", "--spp", "8", "--shutter", "1/30", "--json"];
        let told = f.ok(&[args, &small[..]].concat());
        let json: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
        json["facts"]["fireflies_removed"].as_f64()
    };
    let fraction = removed(&["shoot", "-o", "a.png"]).unwrap();
    assert!((0.0..0.5).contains(&fraction), "{fraction}");
    assert_eq!(removed(&["shoot", "-o", "b.png", "-o", "b.dng"]), None);
    assert_eq!(removed(&["shoot", "-o", "c.png", "--fireflies", "keep"]), None);
    assert_eq!(removed(&["shoot", "-o", "d.png", "--samples", "0..4"]), None);
    assert_eq!(removed(&["shoot", "-o", "e.dng", "--fireflies", "reweight"]), Some(fraction));
    assert_eq!(removed(&["expose", "still-life", "-o", "f.exr"]), None);
    assert_eq!(removed(&["expose", "still-life", "-o", "g.exr", "--fireflies", "reweight"]), Some(fraction));
    let (code, message) = f.fails(&["shoot", "--fireflies", "clamp", "-o", "h.png"]);
    assert!(code == 2 && message.contains("neither keep nor reweight"), "{message}");
}

#[test]
fn time_limits_and_threads_are_kept() {
    let f = Folder::new("limit");
    let started = std::time::Instant::now();
    f.ok(&["shoot", "cornell", "--size", "64x64", "--time-limit", "1s", "--threads", "2", "-o", "a.png"]);
    // Metering, tables and start-up come on top; a limit that is ignored would take minutes.
    assert!(started.elapsed().as_secs() < 60);
    // One sample of these pixels takes 0.1 s, denoising them 3 s or more on two cores: it is counted before the samples.
    let output =
        f.ok(&["shoot", "cornell", "--size", "320x200", "--time-limit", "2s", "--denoise", "on", "-o", "b.png", "--json"]);
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["facts"]["samples"].as_u64().unwrap() >= 2);
    assert!(told["total_s"].as_f64().unwrap() < 40.0, "{told}");
}

#[test]
fn wrong_requests_exit_with_2_and_a_hint() {
    let f = Folder::new("wrong");
    std::fs::write(f.path("bad.toml"), "[exposure]\napperture = \"f/2\"\n").unwrap();
    std::fs::write(f.path("l.toml"), "name = \"a lens\"\n").unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["read-out", "plane.exr", "-o", "raw.exr"], "ends in .dng"),
        (&["shoot", "--truth", "k.exr", "--keep-plane", "./k.exr", "-o", "k.png"], "written twice"),
        (&["shoot", "-o", "a.dng", "-o", "a.dng"], "written twice"),
        (&["read-out", "p.exr", "--truth", "p.exr", "-o", "q.dng"], "it is read here"),
        (&["merge", "p.exr", "q.exr", "-o", "p.exr"], "it is read here"),
        (&["develop", "a.dng", "-o", "b.dng"], ".jpg, .png, .tif or .exr"),
        (&["shoot", "--temperature", "-300"], "-273"),
        (&["shoot", "--dng", "14"], "packed"),
        (&["body", "emva", "canon-t2i", "--channel", "Y"], "R, G, B"),
        (&["body", "emva", "imx249", "--wavelength", "2000"], "380 to 780"),
        (&["body", "emva", "imx249", "--size", "2x2"], "16 to 4096"),
        (&["body", "iso", "canon-t2i", "--iso", "50"], "100 to 6400"),
        (&["shoot", "--aperture", "f/0"], "above 0"),
        (&["shoot", "--aperture", "f/1e-20"], "from f/0.1 to f/100000"),
        (&["calc", "exposure", "f/1e-20", "1/60"], "from f/0.1 to f/100000"),
        (&["shoot", "--iso", "-100"], "ISO"),
        (&["shoot", "--spp", "0"], "1 to"),
        (&["shoot", "--integrator", "metropolis"], "path, path-reuse, caustics, bidirectional or auto"),
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
        (&["lens", "info", "tesar-50mm-f2.8"], "did you mean \"tessar-50mm-f2.8\"?"),
        (&["lens", "info", "tessar-50mm-f2.8", "--aperture", "f/1"], "this lens opens no wider"),
        (&["lens", "info", "kit-zoom-18-55mm", "--focal-length", "80mm"], "18.7 to 53.3 mm"),
        (&["lens", "info", "kit-zoom-18-55mm", "--zoom-position", "9"], "expected one of the printed positions 1 (18."),
        (&["lens", "info", "tessar-50mm-f2.8", "--zoom-position", "1"], "is not a zoom"),
        (&["shoot", "--zoom-position", "1"], "a zoom lens with printed positions"),
        (&["lens", "info", "nokton-50mm-f1", "--focus", "0.55m"], "or more: the lens focuses no nearer"),
        (&["lens", "draw", "tessar-50mm-f2.8"], "-o FILE.svg or FILE.png"),
        (&["lens", "spot", "tessar-50mm-f2.8", "-o", "spot.pdf"], ".svg or .png"),
        (&["lens", "spot", "tessar-50mm-f2.8", "--rays", "1"], "2 to 1000"),
        (&["lens", "mtf", "tessar-50mm-f2.8", "--wavelength", "12"], "100 to 20000"),
        (&["lens", "mtf", "tessar-50mm-f2.8", "--field", "a"], "list of numbers"),
        (&["lens", "convert", "tessar-50mm-f2.8", "-o", "a.dat"], ".toml"),
        (&["lens", "report", "tessar-50mm-f2.8", "-o", "a.txt"], "-o FILE.html"),
        (&["lens", "report", "tessar-50mm-f2.8"], "-o FILE.html"),
        (&["lens", "convert", "l.toml", "-o", "./l.toml"], "it is read here"),
        (&["shoot", "--white", "D66"], "D65"),
        (&["shoot", "--tone", "filmy"], "aces-fit"),
        (&["shoot", "--sampler", "halton"], "sobol, jittered"),
        (&["shoot", "--samples", "9..3"], "A < B"),
        (&["shoot", "--focus", "0.01m"], "more than the focal length"),
        (&["shoot", "--blades", "2"], "3 to 64"),
        (&["shoot", "--lens", "thin", "--blade-rotation", "20"], "blades beside it"),
        (&["shoot", "--dng", "packed", "-o", "a.jpg"], "--dng packed: expected a .dng to write"),
        (&["shoot", "--tone", "agx", "-o", "a.exr", "-o", "a.dng"], "--tone agx: expected a .jpg, .png or .tif to write"),
        (&["shoot", "--preset", "film", "-o", "a.dng"], "--preset film: expected a developed picture to write"),
        (&["shoot", "--truth-channels", "position", "-o", "a.dng"], "expected --truth or --keep-plane beside it"),
        (&["develop", "a.dng", "--bits", "16", "-o", "a.jpg"], "--bits 16: expected a .png to write"),
        (&["develop", "a.dng", "--quality", "50", "-o", "a.png"], "--quality 50: expected a .jpg to write"),
        (&["develop", "a.dng", "--gain-map", "-o", "a.png"], "--gain-map: expected a .jpg to write"),
        (&["stack", "a.dng", "b.dng", "--gamma", "2.2", "-o", "a.exr"], "expected a .jpg, .png or .tif to write"),
        (&["shoot", "--look-from", "1,2,3", "--look-at", "1,2,3"], "same point"),
        (&["shoot", "--look-from", "0,1,0", "--look-at", "0,0,0"], "such as [0, 0, 1]"),
        (&["shoot", "-o", "photo.gif"], ".jpg, .png, .tif, .exr or .dng"),
        (&["expose", "-o", "plane.png"], ".exr"),
        (&["shoot", "--time-limit", "0s"], "above 0"),
        (&["body", "info", "leica-m3"], "known are"),
        (&["shoot", "--threads", "0"], "threads"),
        (&["frobnicate"], "unrecognized subcommand"),
        (&["shoot", "--mode", "X"], "M, A (Av), S (Tv) or P"),
        (&["shoot", "--mode", "S"], "--shutter 1/125"),
        (&["shoot", "--metering", "spotty"], "centre-weighted"),
        (&["shoot", "--metering-at", "2,0"], "0 to 1"),
        (&["shoot", "--nd", "ND0"], "ND8"),
        (&["shoot", "--dial", "quarter"], "full, half or third"),
        (&["shoot", "--iso-max", "800"], "--iso auto"),
        (&["shoot", "--shutter", "-1"], "above 0"),
        (&["shoot", "--shutter-type", "roling"], "did you mean \"rolling\"?"),
        (&["shoot", "--line-time", "-1us"], "from 0 s"),
        (&["shoot", "--line-time", "1us", "--readout", "1ms"], "not both"),
        (&["shoot", "--ramp", "1ms", "--travel", "3ms"], "times of several kinds"),
        (&["shoot", "--shutter-direction", "up"], "rolling or focal-plane"),
        (&["shoot", "--at", "-1s"], "from 0 s"),
        (&["shoot", "--animation", "Run"], "no animations"),
        (&["shoot", "propeller", "--animation-end", "stop"], "clamp or loop"),
        (&["shoot", "--shake", "-1"], "steady hand"),
        (&["shoot", "propeller", "--flicker", "strobe 50 Hz"], "mains 50 Hz"),
        (&["shoot", "--flash", "0"], "above 0"),
        (&["shoot", "--flash-sync", "second"], "--flash GN"),
        (&["shoot", "--flash", "20", "--flash-power", "2"], "fraction of full power"),
        (&["shoot", "--bracket", "0"], "1 to 99"),
        (&["shoot", "--step", "1ev"], "bracket beside it"),
        (&["shoot", "--merge", "a.exr"], "--bracket or --staggered beside it"),
        (&["shoot", "--staggered", "4"], "2 or 3 exposures"),
        (&["shoot", "--staggered-ratio", "8"], "--staggered <N>"),
        (&["shoot", "--dual-pixel", "--frames", "2", "--fps", "24"], "one of them"),
        (&["shoot", "--dual-pixel", "--lens", "pinhole"], "halves of a pupil"),
        (&["shoot", "--frames", "0"], "1 to"),
        (&["shoot", "--frames", "2", "--shutter-angle", "400"], "above 0 to 360"),
        (&["shoot", "--frames", "2", "--fps", "0"], "frames a second"),
        (&["shoot", "--shutter-angle", "half"], "\"half\" is not an angle such as 90deg"),
        (&["shoot", "--blades", "5", "--aperture-image", "star.png"], "blades 5: expected no aperture_image beside it"),
        (&["shoot", "--look-from", "0,1e30,0"], "1e30 m away: expected up to 1e18 m"),
        (&["read-out", "p.exr", "-o", "q.dng", "--shots", "0"], "\"0\" is not a whole number of 1 or more, such as 1"),
        (&["calc", "daylight", "--sun", "30,180", "--hours"], "expected the moment from which on they are shown: --time"),
        (&["calc", "equivalent", "f/0", "1/60"], "above 0"),
        (&["calc", "stops", "sixth"], "full, half or third"),
        (&["calc", "program", "-o", "p.pdf"], ".svg or .png"),
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
fn pictures_that_memory_cannot_hold_are_refused_with_the_size_that_would_fit() {
    let f = Folder::new("memory");
    let limits = ["--max-memory", "3GB", "--threads", "2", "--spp", "1"];
    let huge = ["shoot", "cornell", "--lens", "pinhole", "-o", "a.jpg", "--size", "20000x20000"];
    let (code, message) = f.fails(&[&huge[..], &limits[..]].concat());
    let fits: usize = message.rsplit("at most ").next().unwrap().split('x').next().unwrap().parse().unwrap();
    assert!(code == 2 && (2000..6000).contains(&fits), "{message}");
    // A focal plane is written by strips; where these have no room either, it is refused as well.
    let little = ["expose", "cornell", "--lens", "pinhole", "-o", "a.exr", "--size", "20000x20000", "--max-memory", "100MB"];
    let (code, message) = f.fails(&little);
    assert!(code == 2 && message.contains("expected at most "), "{message}");
}

#[test]
fn merging_and_denoising_name_the_file_that_is_damaged() {
    let f = Folder::new("damaged");
    let expose = |samples: &str, name: &str| {
        f.ok(&["expose", "cornell", "--lens", "pinhole", "--size", "40x70", "--spp", "4", "--samples", samples, "-o", name]);
    };
    expose("0..2", "a.exr");
    expose("2..4", "b.exr");
    f.ok(&["merge", "a.exr", "b.exr", "-o", "whole.exr"]);
    f.ok(&["denoise", "whole.exr", "-o", "calm.exr"]);
    let bytes = std::fs::read(f.path("b.exr")).unwrap();
    std::fs::write(f.path("b.exr"), &bytes[..bytes.len() - 100]).unwrap();
    for args in [&["merge", "a.exr", "b.exr", "-o", "c.exr"][..], &["denoise", "b.exr", "-o", "c.exr"]] {
        let (code, message) = f.fails(args);
        assert!(code == 1 && message.contains("b.exr"), "{args:?}: {code} {message}");
    }
}

#[test]
fn failures_exit_with_1_and_leave_nothing() {
    let f = Folder::new("failures");
    std::fs::write(f.path("short.glb"), b"glTF\x02\0\0\0\xff\xff\0\0").unwrap();
    std::fs::write(f.path("text.gltf"), b"not json").unwrap();
    std::fs::write(f.path("empty.toml"), b"\n").unwrap();
    std::fs::write(f.path("text.exr"), b"not exr").unwrap();
    std::fs::write(f.path("text.hdr"), b"not hdr").unwrap();
    std::fs::write(f.path("t.mtl"), "newmtl a\nmap_Kd gone.png\n").unwrap();
    std::fs::write(f.path("t.obj"), "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n").unwrap();
    let points =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    std::fs::write(f.path("points.ply"), points).unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["shoot", "missing.glb"], "no such file"),
        (&["shoot", "short.glb"], "cut short"),
        (&["shoot", "text.gltf"], "text.gltf"),
        (&["shoot", "points.ply"], "points.ply: no surface"),
        (&["shoot", "t.obj", "--strict"], "gone.png (there is no such file)"),
        (&["scene", "info", "t.obj", "--strict"], "gone.png"),
        (&["scene", "convert", "t.obj", "--strict", "-o", "t.glb"], "gone.png"),
        (&["shoot", "missing.toml"], "missing.toml"),
        (&["shoot", "empty.toml"], "empty.toml: the file is empty"),
        (&["shoot", "--environment", "text.hdr"], "text.hdr"),
        (&["shoot", "-o", "no/such/folder/photo.jpg"], "cannot be written: there is no folder no"),
        (&["lens", "info", "missing.zmx"], "missing.zmx: there is no such file"),
        (&["read-out", "text.exr", "-o", "raw.dng"], "text.exr"),
        (&["read-out", "missing.exr", "-o", "raw.dng"], "missing.exr: there is no such file"),
        (&["merge", "away/a.exr", "b.exr", "-o", "c.exr"], "away/a.exr: there is no folder away"),
        (&["develop", "missing.dng", "-o", "a.png"], "missing.dng: there is no such file"),
        (&["develop", "--recipe", "missing.toml", "missing.dng", "-o", "a.png"], "missing.toml: there is no such file"),
        (&["develop", "text.exr", "-o", "a.png"], "text.exr: not a readable DNG file: it is a text; expected a raw file"),
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
    let info = text(&["scene", "info", "still-life"]);
    // What --focus on takes, and the view from which the scene is photographed.
    assert!(info.contains("wine glass") && info.contains("--look-from 0.05,0.23,0.86 --look-at 0,0.075,0"), "{info}");
    let info: serde_json::Value = serde_json::from_str(&text(&["scene", "info", "still-life", "--json"])).unwrap();
    assert!(info["object_names"].as_array().unwrap().contains(&"vase".into()), "{info}");
    assert!(text(&["calc", "exposure", "f/8", "1/500"]).contains("right for 4000 cd/m²"));
    assert!(text(&["body", "list"]).contains("Nikon D850"));
    let sheet: serde_json::Value = serde_json::from_str(&text(&["body", "info", "canon-5d-mark-ii", "--json"])).unwrap();
    assert_eq!(sheet["pixels"], serde_json::json!([5616, 3744]));
    assert!(text(&["body", "info", "canon-5d-mark-ii"]).contains("PRNU 0.35 %"));
    // Heights that percentages are of; the title's focal length is at the wavelength that is asked for.
    let blue = text(&["lens", "distortion", "triplet-50mm-f4", "--wavelength", "435.8"]);
    let told: serde_json::Value =
        serde_json::from_str(&text(&["lens", "info", "triplet-50mm-f4", "--wavelength", "435.8", "--json"])).unwrap();
    let title =
        format!("{:.4} mm f/{:.2} ", told["effective_focal_length_mm"].as_f64().unwrap(), told["f_number"].as_f64().unwrap());
    assert!(blue.contains("ideal mm") && blue.contains(&title), "{title}{blue}");
    assert!(text(&["completions", "bash"]).contains("diopter"));
    assert!(text(&["man"]).contains(".TH"));
    assert!(text(&["man", "lens", "draw"]).contains("lens draw"));
    f.ok(&["man", "-o", "pages"]);
    assert!(std::fs::read_to_string(f.path("pages/diopter-shoot.1")).unwrap().contains(".SH EXPOSURE"));
}

#[test]
fn errors_are_told_to_machines_and_the_last_flag_wins() {
    let f = Folder::new("errors");
    std::fs::write(f.path("shot.toml"), "[exposure]\naperature = \"f/4\"\n").unwrap();
    let told = |args: &[&str]| -> serde_json::Value {
        let output = f.run(args);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{args:?}: {e}"));
        assert_eq!(json["error"]["exit_code"].as_i64(), output.status.code().map(i64::from), "{args:?}: {json}");
        assert!(!output.stderr.is_empty(), "{args:?}: people are told, too");
        json["error"].clone()
    };
    let e = told(&["shoot", "shot.toml", "--json"]);
    assert_eq!((e["exit_code"].as_i64(), e["place"].as_str()), (Some(2), Some("shot.toml:2")), "{e}");
    assert_eq!(
        (e["found"].as_str(), e["hint"].as_str()),
        (Some("unknown field `aperature`"), Some("did you mean `aperture`?")),
        "{e}"
    );
    assert!(e["message"].as_str().unwrap().contains("aperature") && e["message"].as_str().unwrap().contains("line 2"), "{e}");
    let e = told(&["measure", "mtf", "none.png", "--json"]);
    assert_eq!((e["place"].as_str(), e["found"].as_str()), (Some("none.png"), Some("there is no such file")), "{e}");
    let e = told(&["shoot", "--json", "--lens", "panorame"]);
    assert_eq!((e["place"].as_str(), e["found"].as_str()), (Some("lens"), Some("\"panorame\"")), "{e}");
    assert!(e["expected"].as_str().unwrap().contains("panorama"), "{e}");
    let e = told(&["--json", "shoot", "--spp", "many"]);
    assert_eq!((e["exit_code"].as_i64(), e["found"].as_str()), (Some(2), Some("many")), "{e}");
    let e = told(&["develop", "none.dng", "-o", "a.png", "--json"]);
    assert_eq!(e["exit_code"].as_i64(), Some(1), "{e}");
    // A flag given twice.
    let shot = f.ok(&["shoot", "--json", "--size", "900x600", "--size", "24x16", "--spp", "64", "--spp", "1", "-o", "a.png"]);
    let shot: serde_json::Value = serde_json::from_slice(&shot.stdout).unwrap();
    assert_eq!(shot["size"], serde_json::json!([24, 16]));
}

#[test]
fn lenses_are_shown_plotted_and_converted() {
    let f = Folder::new("lenses");
    let json = |args: &[&str]| -> serde_json::Value {
        serde_json::from_slice(&f.ok(args).stdout).unwrap_or_else(|e| panic!("{args:?}: {e}"))
    };
    assert!(json(&["lens", "list", "--json"]).as_array().unwrap().len() >= 30);
    f.ok(&["lens", "draw", "thin", "--focal-length", "35mm", "--focus", "1m", "-o", "thin.svg"]);
    assert!(std::fs::read_to_string(f.path("thin.svg")).unwrap().contains("thin lens"));
    let (code, message) = f.fails(&["lens", "info", "thin"]);
    assert!(code == 2 && message.contains("lens draw thin"), "{message}");
    let info = json(&["lens", "info", "tessar-50mm-f2.8", "--json"]);
    assert!((info["effective_focal_length_mm"].as_f64().unwrap() - 49.9966).abs() < 1e-4, "{info}");
    let zoom = json(&["lens", "info", "kit-zoom-18-55mm", "--zoom-position", "2", "--json"]);
    assert_eq!(zoom["zoom_position"].as_f64(), Some(2.0), "{zoom}");
    // Third-order sums are those of the field asked, not of 80°.
    let wide = json(&["lens", "info", "fisheye-10mm", "--field", "0,85", "--json"]);
    assert_eq!(wide["third_order"]["field_deg"].as_f64(), Some(85.0), "{wide}");
    // Small stops and obstructions have light too, and less of it with glass than without.
    for (name, aperture) in [("phone-5.6mm-f3.5", "f/3.5"), ("hologon-15mm-f8", "f/16"), ("reflex-500mm-f8", "f/6.7")] {
        let info = json(&["lens", "info", name, "--aperture", aperture, "--json"]);
        let (working, t) = (info["working_f_number"].as_f64().unwrap(), info["t_number"].as_f64().unwrap());
        assert!(working > 3.0 && working < 20.0 && t > working && t < 1.4 * working, "{name}: {working} {t}");
    }
    for (verb, keys) in [
        ("spot", vec!["rms_mm"]),
        ("fan", vec!["tangential", "sagittal"]),
        ("mtf", vec!["frequency_per_mm", "kind"]),
        ("distortion", vec!["distortion_percent", "equidistant_percent"]),
    ] {
        let value = json(&["lens", verb, "triplet-50mm-f4", "--json", "-o", "plot.svg", "-o", "plot.png"]);
        // Of distortion the first is the axis, which has none.
        let last = value.as_array().and_then(|all| all.last()).unwrap_or(&value);
        assert!(keys.iter().all(|k| !last[k].is_null()), "{verb}: {value}");
        assert!(verb != "distortion" || value[0]["distortion_percent"].is_null(), "{value}");
        let svg = std::fs::read_to_string(f.path("plot.svg")).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{verb}");
        assert!(std::fs::read(f.path("plot.png")).unwrap().starts_with(b"\x89PNG"), "{verb}");
    }
    // The image of a point stopped far down is nearly perfect, its wavefront flat; both are written as EXR.
    let stopped = ["triplet-50mm-f4", "--aperture", "f/16", "--focus", "inf", "--field", "0,5", "--wavelength", "588", "--json"];
    let psf = json(&[&["lens", "psf"][..], &stopped, &["-o", "psf.exr", "-o", "psf.svg"]].concat());
    let strehl = psf[0]["strehl"].as_f64().unwrap();
    let energy = psf[0]["encircled_energy"].as_array().unwrap();
    assert!((0.5..=1.0).contains(&strehl) && energy.last().unwrap().as_f64().unwrap() > 0.9, "{strehl}");
    let waves = json(&[&["lens", "wavefront"][..], &stopped, &["--zernikes", "fringe", "-o", "map.exr"]].concat());
    let rms = waves[0]["rms_without_tilt_waves"].as_f64().unwrap();
    // Mahajan's approximation holds for small aberrations.
    assert!(((-(std::f64::consts::TAU * rms).powi(2)).exp() - strehl).abs() < 0.05, "{rms} {strehl}");
    assert_eq!(waves[1]["zernikes_waves"].as_array().unwrap().len(), 37);
    assert!(["psf.exr", "map.exr"].iter().all(|n| std::fs::read(f.path(n)).unwrap().starts_with(&[0x76, 0x2f, 0x31, 0x01])));
    assert!(f.fails(&["lens", "psf", "triplet-50mm-f4", "-o", "a.jpg"]).1.contains(".exr"));
    assert_eq!(
        json(&["lens", "spot", "triplet-50mm-f4", "--defocus", "-0.1,0,0.1", "--field", "0", "--wavelength", "588", "--json"])
            .as_array()
            .unwrap()
            .len(),
        3
    );
    assert!(
        json(&["lens", "vignetting", "triplet-50mm-f4", "--json"])["illumination"][0]["geometric_sr"].as_f64().unwrap() > 0.0
    );
    assert!(json(&["lens", "color", "triplet-50mm-f4", "--json"])["axial_mm"].as_array().unwrap().len() > 20);
    let end = json(&["lens", "trace", "triplet-50mm-f4", "--field", "10", "--json"]);
    assert_eq!(end["surfaces"].as_array().unwrap().len(), 6);
    f.ok(&["lens", "draw", "triplet-50mm-f4", "-o", "lens.svg"]);
    f.ok(&["lens", "convert", "triplet-50mm-f4", "-o", "mine.toml"]);
    let again = json(&["lens", "info", "mine.toml", "--json"]);
    assert_eq!(
        again["effective_focal_length_mm"],
        json(&["lens", "info", "triplet-50mm-f4", "--json"])["effective_focal_length_mm"]
    );
    // And a photograph through the converted file, with a picture for an aperture.
    let star = concat!(env!("CARGO_MANIFEST_DIR"), "/../../gallery/still-life.jpg");
    f.ok(&with(
        &["shoot", "cornell", "--lens", "mine.toml", "--aperture-image", star],
        &["-o", "a.png", "--save-shot", "shot.toml"],
    ));
    f.ok(&["shoot", "shot.toml", "-o", "b.png"]);
    assert!(pixels(&f.path("a.png")) == pixels(&f.path("b.png")), "the pictures differ");
}

/// A lat-long picture of a bright sky over dark ground with a sun, as Radiance writes it: 32 × 16, mantissas and a common exponent.
fn radiance_hdr() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n".to_vec();
    for row in 0..16 {
        for column in 0..32 {
            bytes.extend(match (row, column) {
                (4, 10) => [255, 240, 200, 142],
                (0..8, _) => [140, 160, 200, 130],
                _ => [160, 140, 130, 126],
            });
        }
    }
    bytes
}

fn photographed_and_described(f: &Folder, scene: &str, hdr: &str) {
    f.ok(&with(&["shoot", scene, "--environment", hdr, "--ambient-ev", "12"], &["-o", "a.png"]));
    f.ok(&["scene", "info", scene]);
}

#[test]
fn files_with_surroundings_are_photographed() {
    let f = Folder::new("files");
    std::fs::write(f.path("sky.hdr"), radiance_hdr()).unwrap();
    std::fs::write(f.path("cart.glb"), generated::cart()).unwrap();
    std::fs::write(f.path("tail.glb"), generated::tail()).unwrap();
    // Pictures, many materials, lamps and a camera of a file; with a buffer beside it, and in one piece.
    f.ok(&["scene", "convert", "still-life", "-o", "still-life.glb"]);
    f.ok(&["scene", "convert", "cornell", "-o", "cornell.gltf"]);
    f.ok(&["scene", "convert", "color-chart", "-o", "chart.gltf"]);
    for scene in ["cart.glb", "tail.glb", "still-life.glb", "cornell.gltf", "chart.gltf"] {
        photographed_and_described(&f, scene, "sky.hdr");
    }
}

#[test]
#[ignore = "needs the reference scenes: set DIOPTER_REFERENCE_DATA"]
fn files_of_others_are_photographed() {
    let data = std::env::var("DIOPTER_REFERENCE_DATA").expect("DIOPTER_REFERENCE_DATA names the folder that holds scenes/");
    let scenes = Path::new(&data).join("scenes").canonicalize().unwrap_or_else(|e| panic!("{data}/scenes: {e}"));
    let f = Folder::new("real");
    let hdr = scenes.join("hdri_venice/venice.hdr").display().to_string();
    for name in [
        "gltf_FlightHelmet/FlightHelmet.gltf",
        "gltf_CesiumMilkTruck/CesiumMilkTruck.glb",
        "gltf_Fox/Fox.glb",
        "gltf_Box/Box.gltf",
        "gltf_bevy_CornellBox/CornellBox.glb",
        "gltf_bevy_TonemappingTest/TonemappingTest.gltf",
    ] {
        photographed_and_described(&f, &scenes.join(name).display().to_string(), &hdr);
    }
}

#[test]
fn raw_files_become_pictures_in_many_ways() {
    let f = Folder::new("develop");
    f.ok(&["shoot", "color-chart", "--size", "96x64", "--spp", "2", "--shutter", "1/30", "-o", "a.dng"]);
    std::fs::copy(f.path("a.dng"), f.path("b.dng")).unwrap();
    let read = |name: &str| std::fs::read(f.path(name)).unwrap();
    // Every kind of file, and several at once.
    f.ok(&["develop", "a.dng", "-o", "p.jpg", "-o", "p.png", "-o", "p.tif", "-o", "p.exr"]);
    assert!(read("p.jpg").starts_with(&[0xff, 0xd8]) && read("p.tif").starts_with(b"II"));
    std::fs::create_dir(f.path("out")).unwrap();
    f.ok(&["develop", "a.dng", "b.dng", "-o", "out/{}.png"]);
    assert_eq!(read("out/a.png"), read("out/b.png"));
    assert_eq!(read("out/a.png"), read("p.png"));
    // A recipe says what flags say.
    f.ok(&["develop", "a.dng", "--set", "tone.curve=agx", "--exposure-ev", "0.5", "--save-recipe", "r.toml", "-o", "agx.png"]);
    f.ok(&["develop", "a.dng", "--recipe", "r.toml", "-o", "again.png"]);
    assert_eq!(read("agx.png"), read("again.png"));
    assert_ne!(read("agx.png"), read("p.png"));
    // A baked look stands for the steps.
    f.ok(&["lut", "bake", "--tone", "agx", "--exposure-ev", "0.5", "--size", "17", "-o", "look.cube"]);
    f.ok(&["develop", "a.dng", "--lut", "look.cube", "--set", "lut.input=log", "-o", "looked.png"]);
    assert_ne!(read("looked.png"), read("p.png"));
    let told: serde_json::Value = serde_json::from_slice(&f.ok(&["lut", "info", "look.cube", "--json"]).stdout).unwrap();
    assert_eq!(told["size_3d"].as_u64(), Some(17));
    // The way of a raw image, step by step.
    f.ok(&["develop", "a.dng", "--preset", "camera", "--steps", "steps"]);
    let names: Vec<String> =
        std::fs::read_dir(f.path("steps")).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    for name in ["01-black-level.png", "07-demosaic.png", "08-noise-reduction.png", "18-encode.png", "sheet.png"] {
        assert!(names.iter().any(|n| n == name), "{name} of {names:?}");
    }
    // Spaces, depths and brighter displays.
    f.ok(&["develop", "a.dng", "--set", "output.space=rec2020", "--set", "output.encoding=pq", "--bits", "16", "-o", "hdr.png"]);
    assert!(read("hdr.png").windows(8).any(|w| w == b"cICP\x09\x10\x00\x01"));
    f.ok(&["develop", "a.dng", "--gain-map", "-o", "gain.jpg"]);
    assert!(read("gain.jpg").windows(4).any(|w| w == b"MPF\0"));
    let listed = f.ok(&["develop", "--settings"]);
    assert!(String::from_utf8_lossy(&listed.stdout).contains("demosaic.method"));
    let tone: serde_json::Value =
        serde_json::from_slice(&f.ok(&["calc", "tone", "aces-1.3", "0.18", "1", "--json"]).stdout).unwrap();
    assert!((tone["colours"][0]["code"][1].as_f64().unwrap() - 0.35595).abs() < 1e-3);
}

#[test]
fn developments_that_cannot_be_say_why() {
    let f = Folder::new("undeveloped");
    f.ok(&["shoot", "cornell", "--size", "24x16", "--spp", "2", "--shutter", "1/30", "-o", "a.dng"]);
    std::fs::write(f.path("cut.dng"), &std::fs::read(f.path("a.dng")).unwrap()[..3000]).unwrap();
    std::fs::write(f.path("short.cube"), "LUT_3D_SIZE 2\n0 0 0\n").unwrap();
    std::fs::write(f.path("nan.cube"), "LUT_1D_SIZE 2\n0 0 0\nnan 1 1\n").unwrap();
    std::fs::write(f.path("r.toml"), "[tone]\ncurve = \"agx2\"\n").unwrap();
    let cases: &[(&[&str], i32, &str)] = &[
        (&["develop", "a.dng"], 2, "expected -o FILE"),
        (&["develop", "a.dng", "cut.dng", "-o", "x.jpg"], 2, "expected {} in it"),
        (&["develop", "cut.dng", "-o", "x.jpg"], 1, "cut.dng"),
        (&["develop", "missing.dng", "-o", "x.jpg"], 1, "missing.dng"),
        (&["develop", "a.dng", "--lut", "short.cube", "-o", "x.jpg"], 1, "the end after 1 points; expected 8"),
        (&["develop", "a.dng", "--lut", "nan.cube", "-o", "x.jpg"], 1, "line 3"),
        (&["develop", "a.dng", "--recipe", "r.toml", "-o", "x.jpg"], 1, "line 2"),
        (&["develop", "a.dng", "--set", "tone.curv=agx", "-o", "x.jpg"], 2, "did you mean \"tone.curve\""),
        (&["develop", "a.dng", "--set", "tone.curve", "-o", "x.jpg"], 2, "tone.curve=reinhard"),
        (&["develop", "a.dng", "--set", "white.balance=mars", "-o", "x.jpg"], 2, "5200 K"),
        (&["develop", "a.dng", "--preset", "nice", "-o", "x.jpg"], 2, "camera"),
        (&["develop", "a.dng", "--bits", "12", "-o", "x.png"], 2, "8 or 16"),
        (&["develop", "a.dng", "--quality", "0", "-o", "x.jpg"], 2, "a whole number from 1 to 100"),
        (&["develop", "a.dng", "--bits", "16", "-o", "x.jpg"], 2, "bits 16: expected a .png"),
        (&["develop", "a.dng", "-o", "x.jpg", "-o", "x.jpg"], 2, "twice"),
        (&["lut", "bake", "-o", "x.png"], 2, ".cube"),
        (&["lut", "info", "short.cube"], 1, "expected 8"),
        (&["calc", "tone", "agx", "0.1,x"], 2, "0.5,0.1,0.02"),
        (&["denoise", "a.dng", "-o", "x.exr"], 1, "a.dng"),
    ];
    for (args, code, part) in cases {
        let (got, message) = f.fails(args);
        assert!(got == *code && message.contains(part), "{args:?}: {got} {message}");
    }
    // One file of many that cannot be developed leaves the others.
    let output = f.run(&["develop", "a.dng", "cut.dng", "-o", "{}.png"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(f.path("a.png").exists() && !f.path("cut.png").exists());
}

#[test]
fn what_cannot_be_focused_on_is_refused() {
    let f = Folder::new("focus-wrong");
    let zone = "0.9,0,0.2,0.2";
    for (args, word) in [
        (&["--focus", "2.5x"][..], "hyperfocal"),
        (&["--focus", "on orang"], "did you mean \"orange\""),
        (&["--focus", "at", "2,0"], "0 to 1"),
        (&["--focus", "-1m"], "above 0"),
        (&["--focus", "auto", "--focus-zones", zone], "inside the picture"),
        (&["--focus", "auto", "--focus-zones", "0.1,0.1,0,0.2"], "above 0"),
        (&["--focus", "auto", "--focus-priority", "nearset"], "closest"),
        (&["--focus-zones", "nine"], "auto"),
        (&["--focus-step", "2"], "focus_bracket"),
        (&["--stack", "x.jpg"], "--focus-bracket"),
        (&["--focus-bracket", "0"], "1 to 99"),
    ] {
        let (code, message) = f.fails(&with(&["shoot", "-o", "p.png"], args));
        assert!(code == 2 && message.contains(word), "{args:?}: {code} {message}");
    }
    // The dark is no wrong request: the picture fails, or is taken all the same.
    let dark = ["--ambient-ev", "-25", "--focus", "auto", "--focus-method", "phase"];
    let (code, message) = f.fails(&with(&["shoot", "cornell", "-o", "p.png", "--require-focus"], &dark));
    assert!(code == 1 && message.contains("autofocus failed"), "{code} {message}");
    let taken = f.ok(&with(&["shoot", "cornell", "-o", "p.png", "--json"], &dark));
    let json: serde_json::Value = serde_json::from_slice(&taken.stdout).unwrap();
    assert!(json["focus"]["confidence"].as_f64().unwrap() < 0.5 && json["focus"]["chosen"].is_null());
}

#[test]
fn a_saved_shot_keeps_what_autofocus_found() {
    let f = Folder::new("focus-saved");
    f.ok(&with(&["shoot", "resolution-chart", "--focus", "auto", "--save-shot", "s.toml"], &["-o", "a.png"]));
    let saved = std::fs::read_to_string(f.path("s.toml")).unwrap();
    assert!(saved.contains("extension "), "{saved}");
    f.ok(&["shoot", "s.toml", "-o", "b.png"]);
    assert_eq!(pixels(&f.path("a.png")), pixels(&f.path("b.png")));
    // The chart is 0.94 m away.
    let json: serde_json::Value = serde_json::from_slice(
        &f.ok(&with(&["shoot", "resolution-chart", "--focus", "auto", "--json"], &["-o", "a.png"])).stdout,
    )
    .unwrap();
    let found = json["facts"]["focus_distance_m"].as_f64().unwrap();
    assert!((found - 0.94).abs() < 0.01, "{found}");
}

#[test]
fn focus_series_are_numbered_and_stacked() {
    let f = Folder::new("focus-series");
    // The stack of the raw files is that of the shot where neither is denoised.
    f.ok(&with(
        &["shoot", "--focus", "0.8m", "--focus-bracket", "3", "--denoise", "off", "--stack", "all.png"],
        &["-o", "s.dng"],
    ));
    let names: Vec<String> = f.files().iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
    let raws: Vec<&str> = names.iter().map(|n| n.as_str()).filter(|n| n.ends_with(".dng")).collect();
    f.ok(&[&["stack"], &raws[..], &["-o", "again.png"]].concat());
    assert_eq!(pixels(&f.path("all.png")), pixels(&f.path("again.png")));
    let (code, message) = f.fails(&["stack", raws[0], "-o", "one.png"]);
    assert!(code == 2 && message.contains("two pictures"), "{code} {message}");
    let (code, message) = f.fails(&["stack", raws[0], raws[0], "-o", "one.png"]);
    assert!(code == 2 && message.contains("named twice"), "{code} {message}");
}

#[test]
fn light_fields_are_taken_and_developed() {
    let f = Folder::new("light-field");
    let taken =
        ["shoot", "--plenoptic", "1.5mm", "--aperture", "f/2", "--size", "240x160", "--spp", "1", "--microlens-arrangement"];
    f.ok(&[&taken[..], &["hexagonal", "--save-shot", "s.toml", "-o", "a.dng"]].concat());
    f.ok(&["shoot", "s.toml", "-o", "b.dng"]);
    f.ok(&[
        "develop",
        "a.dng",
        "--refocus",
        "0.7m",
        "-o",
        "a.png",
        "--views",
        "views",
        "--depth",
        "depth.exr",
        "--steps",
        "steps",
    ]);
    f.ok(&["develop", "b.dng", "--refocus", "0.7m", "-o", "b.png"]);
    let (a, b) = (pixels(&f.path("a.png")), pixels(&f.path("b.png")));
    assert_eq!(a, b);
    assert!(f.path("views").read_dir().unwrap().count() >= 4 && f.path("depth.exr").exists());
    f.ok(&["develop", "a.dng", "--refocus", "all", "--set", "noise.luminance=0.5", "--set", "resize.width=10", "-o", "c.png"]);
    for (args, word) in [
        (&["develop", "a.dng", "--refocus", "near"][..], "as-taken"),
        (&["develop", "a.dng", "--refocus", "1mm"], "at least"),
        (&["develop", "a.dng", "--set", "light_field.aperture=1"], "f/2"),
        (&["develop", "a.dng", "--depth", "d.jpg"], "metres"),
        (&["shoot", "--plenoptic", "0.1mm", "--size", "240x160"], "--size"),
        (&["shoot", "--plenoptic", "20mm", "--size", "240x160"], "four lenses"),
        (&["shoot", "--plenoptic", "1.5mm", "--size", "240x160", "--lens", "pinhole"], "aperture"),
        (&["shoot", "--plenoptic", "1.5mm", "--size", "240x160", "--quick"], "quick look"),
        (&["shoot", "--microlens-gap", "1mm"], "pitch"),
        (&["shoot", "--plenoptic", "1.5mm", "--size", "240x160", "--microlens-arrangement", "round"], "hexagonal"),
    ] {
        let (code, message) = f.fails(&[args, &["-o", "x.png"]].concat());
        assert!(code == 2 && message.contains(word), "{args:?}: {code} {message}");
    }
    f.ok(&with(&["shoot"], &["-o", "plain.dng"]));
    let (code, message) = f.fails(&["develop", "plain.dng", "--refocus", "1m", "-o", "x.png"]);
    assert!(code == 2 && message.contains("no light field"), "{code} {message}");
}

#[test]
fn quick_looks_are_made_of_planes_and_of_pictures_with_depth() {
    let f = Folder::new("quick-look");
    f.ok(&with(&["expose", "--lens", "pinhole"], &["-o", "sharp.exr"]));
    f.ok(&["quick-look", "sharp.exr", "--aperture", "f/2", "--focus", "0.8m", "-o", "soft.exr"]);
    f.ok(&["read-out", "soft.exr", "-o", "soft.dng"]);
    let facts = |file: &str| {
        let plane = read_focal_plane(std::io::BufReader::new(std::fs::File::open(f.path(file)).unwrap())).unwrap();
        (plane.facts, plane.mean.data)
    };
    let (soft, blurred) = facts("soft.exr");
    assert_eq!((soft.f_number, soft.focus_distance_m), (2.0, Some(0.8)));
    // The film of the plane's own body, as `--format` would say it: circles are larger in a picture of a smaller film.
    f.ok(&with(&["expose", "--lens", "pinhole", "--body", "canon-700d"], &["-o", "small.exr"]));
    let quick = |more: &[&str], out: &str| {
        f.ok(&[&["quick-look", "small.exr", "--aperture", "f/2", "--focus", "0.8m", "-o", out], more].concat())
    };
    quick(&[], "own.exr");
    quick(&["--format", "22.3x14.9"], "said.exr");
    quick(&["--format", "full frame"], "other.exr");
    let [own, said, other] = ["own.exr", "said.exr", "other.exr"].map(|file| facts(file).1);
    let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
    assert!(apart(&own, &said) < 0.1 * apart(&own, &other), "{} {}", apart(&own, &said), apart(&own, &other));
    assert_eq!(blurred.len(), own.len());
    let (code, message) = f.fails(&["quick-look", "sharp.exr", "--focus", "1mm", "-o", "no.exr"]);
    assert!(code == 2 && message.contains("focal length"), "{code} {message}");
    f.ok(&with(&["shoot", "--quick"], &["-o", "quick.png"]));
}

#[test]
fn calculators_answer_with_published_numbers() {
    let f = Folder::new("calc-focus");
    let number = |args: &[&str], place: &str| -> f64 {
        let json: serde_json::Value = serde_json::from_slice(&f.ok(args).stdout).unwrap();
        json.pointer(place).and_then(serde_json::Value::as_f64).unwrap_or_else(|| panic!("{args:?} {place}: {json}"))
    };
    let dof = ["--json", "calc", "dof", "--focal-length", "85mm", "--aperture", "f/1.8", "--focus", "3m", "--circle", "0.03mm"];
    assert!((number(&dof, "/rows/0/near_m") - 2.9360).abs() < 1e-4 && (number(&dof, "/rows/0/far_m") - 3.0668).abs() < 1e-4);
    assert!(
        (number(&["--json", "calc", "hyperfocal", "50mm", "f/2", "--circle", "0.03mm"], "/rows/0/hyperfocal_m") - 41.7167).abs()
            < 1e-4
    );
    assert!((number(&["--json", "calc", "fov", "50mm"], "/horizontal_deg") - 39.60).abs() < 0.006);
    let other =
        ["--json", "calc", "equivalent-format", "25mm", "f/1.4", "--from", "4/3", "--to", "full frame", "--focus", "1000m"];
    assert!((number(&other, "/focal_length_mm") - 49.98).abs() < 0.01 && (number(&other, "/f_number") - 2.799).abs() < 0.01);
    // Near the lens: images 150 and 75.01 mm behind it have the same angles, and the same depth of field.
    let near = ["--json", "calc", "equivalent-format", "100mm", "f/2.8", "--to", "4/3", "--focus", "0.3m"];
    let depth = |side: &str| number(&near, &format!("/{side}/far_m")) - number(&near, &format!("/{side}/near_m"));
    assert!((number(&near, "/focal_length_mm") - 60.01).abs() < 0.02 && (depth("from") / depth("to") - 1.0).abs() < 1e-3);
    // A real lens beside it: stopped down it is the thin lens.
    let real = ["--json", "calc", "dof", "--lens", "double-gauss-50mm", "--aperture", "f/8", "--focus", "3m"];
    assert!((number(&real, "/rows/0/traced_near_m") / number(&real, "/rows/0/near_m") - 1.0).abs() < 0.01);
    let (code, message) = f.fails(&["lens", "mtf", "double-gauss-50mm", "--over", "field", "--field", "0"]);
    assert!(code == 2 && message.contains("above 0"), "{code} {message}");
    let (code, message) = f.fails(&["lens", "mtf", "double-gauss-50mm", "--frequency", "0"]);
    assert!(code == 2 && message.contains("above 0, and at most 10000"), "{code} {message}");
    let fields: serde_json::Value =
        serde_json::from_slice(&f.ok(&["--json", "lens", "vignetting", "double-gauss-50mm", "--field", "3,7"]).stdout).unwrap();
    let told: Vec<f64> = fields["beam_area"].as_array().unwrap().iter().map(|b| b["field_deg"].as_f64().unwrap()).collect();
    assert_eq!((told, fields["illumination"].as_array().unwrap().len()), (vec![3.0, 7.0], 2));
    // Without an aperture it is fully open, which is said: not the f/2.8 of no lens at all.
    let open = ["--json", "calc", "dof", "--lens", "double-gauss-50mm", "--focus", "3m"];
    let widest = number(&["--json", "lens", "info", "double-gauss-50mm"], "/widest_f_number");
    // `lens info` tells it at another wavelength.
    assert!((number(&open, "/f_number") / widest - 1.0).abs() < 0.01, "{widest}");
    let text = String::from_utf8(f.ok(&open[1..]).stdout).unwrap();
    assert!(text.contains("(fully open)"), "{text}");
    assert_eq!(number(&["--json", "calc", "dof", "--focus", "3m"], "/f_number"), 2.8);
    let (code, message) = f.fails(&["calc", "dof", "--focal-length", "50mm", "--focus", "2cm"]);
    assert!(code == 2 && message.contains("focal length"), "{code} {message}");
}

#[cfg(target_os = "linux")]
#[test]
fn stopped_and_killed_exposures_go_on() {
    let f = Folder::new("checkpoint");
    let args =
        ["expose", "cornell", "--json", "--size", "32x32", "--spp", "2048", "--shutter", "1/30", "--checkpoint", "10ms", "-o"];
    let start = |out: &str| {
        let child = Command::new(env!("CARGO_BIN_EXE_diopter"))
            .args(args)
            .arg(out)
            .current_dir(&f.0)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let checkpoint = f.path(&format!("{out}.checkpoint"));
        let begun = std::time::Instant::now();
        while !checkpoint.exists() && begun.elapsed().as_secs() < 100 {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert!(checkpoint.exists(), "no checkpoint");
        child
    };
    f.ok(&[&args[..], &["whole.exr", "--no-resume"]].concat());
    let whole = std::fs::read(f.path("whole.exr")).unwrap();
    // Killed: nothing but the checkpoint and a part is left.
    let mut child = start("killed.exr");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!f.path("killed.exr").exists());
    let output = f.ok(&[&args[..], &["killed.exr", "--resume"]].concat());
    assert!(String::from_utf8_lossy(&output.stderr).contains("going on from killed.exr.checkpoint"));
    assert!(std::fs::read(f.path("killed.exr")).unwrap() == whole);
    // Stopped by SIGTERM: what was done is written.
    let child = start("stopped.exr");
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && message.contains("of 2048 samples a pixel"), "{message}");
    assert!(f.path("stopped.exr").exists());
    // One document for machines, which says so.
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["stopped"] == true && told["error"].is_null(), "{told}");
    // Another exposure does not take it.
    let (code, message) = f.fails(&["expose", "cornell", "--size", "32x32", "--spp", "8", "--resume", "-o", "stopped.exr"]);
    assert!(code == 2 && message.contains("another exposure"), "{message}");
    f.ok(&[&args[..], &["stopped.exr"]].concat());
    assert!(std::fs::read(f.path("stopped.exr")).unwrap() == whole);
    let (code, message) = f.fails(&[&args[..], &["stopped.exr", "--resume"]].concat());
    assert!(code == 2 && message.contains("expected the checkpoint"), "{message}");
    // Neither checkpoints nor parts of the dead are left.
    assert_eq!(f.files(), [f.path("killed.exr"), f.path("stopped.exr"), f.path("whole.exr")]);
}

#[test]
fn a_stopped_series_goes_on_with_the_pictures_that_are_not_there() {
    let f = Folder::new("stopped-series");
    let args = with(&["shoot", "cornell", "--shutter", "1/30", "--bracket", "3", "-o", "b.dng", "--merge", "m.dng"], &[]);
    let mosaic = |name: &str| {
        let file = std::fs::File::open(f.path(name)).unwrap();
        diopter::image::dng::read(std::io::BufReader::new(file)).unwrap().mosaic.data
    };
    f.ok(&args);
    let first = f.read("b-001.dng");
    let whole = mosaic("m.dng");
    // Stopped after the first picture.
    let remove = |names: &[&str]| names.iter().for_each(|name| std::fs::remove_file(f.path(name)).unwrap());
    remove(&["b-002.dng", "b-003.dng", "m.dng"]);
    let output = f.ok(&[&args[..], &["--resume", "--json", "-o", "c.json"]].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["files"].as_array().unwrap().len(), &json["frames"][0]["samples"]), (5, &serde_json::json!(2)));
    let calibration = String::from_utf8(f.read("c.json")).unwrap();
    assert!(["b-001", "b-002", "b-003"].iter().all(|name| calibration.contains(name)), "{calibration}");
    assert!(told.contains("b-001.dng: there from before") && !told.contains("b-002.dng: there"), "{told}");
    assert!(f.read("b-001.dng") == first && mosaic("m.dng") == whole);
    // Not with those of another picture.
    let (code, message) = f.fails(&[&args[..], &["--resume", "--look-from", "0,1,3"]].concat());
    assert!(code == 2 && message.contains("b-001.dng is another picture"), "{message}");
    // Where nothing was begun, there is nothing to go on from.
    remove(&["b-001.dng", "b-002.dng", "b-003.dng", "m.dng"]);
    let (code, message) = f.fails(&[&args[..], &["--resume"]].concat());
    assert!(code == 2 && message.contains("expected the checkpoint b-001.dng.checkpoint"), "{message}");
}

#[test]
fn parts_of_other_pictures_and_samples_that_are_there_are_not_merged() {
    let f = Folder::new("parts");
    let part = |samples: &str, name: &str, more: &[&str]| {
        let args = ["expose", "cornell", "--size", "24x16", "--spp", "16", "--shutter", "1/30", "--samples", samples, "-o", name];
        f.ok(&[&args[..], more].concat());
    };
    part("0..5", "a.exr", &[]);
    part("12..16", "c.exr", &[]);
    let told = f.ok(&["merge", "c.exr", "a.exr", "-o", "gap.exr"]);
    assert!(String::from_utf8_lossy(&told.stderr).contains("9 samples a pixel (0..5, 12..16)"));
    let (code, message) = f.fails(&["merge", "gap.exr", "c.exr", "-o", "twice.exr"]);
    assert!(code == 2 && message.contains("samples 12..16 are in two of them"), "{message}");
    part("5..12", "b.exr", &[]);
    f.ok(&["merge", "gap.exr", "b.exr", "-o", "whole.exr"]);
    part("0..16", "once.exr", &[]);
    let [merged, once] = ["whole.exr", "once.exr"].map(|name| read_plane_of(&f, name));
    assert!(merged.iter().zip(&once).all(|(a, b)| (a - b).abs() <= 1e-5 * b.abs().max(1e-3)));
    for (more, told) in [
        (&["--look-from", "0,1,3"][..], "settings of scene, camera or paths"),
        (&["--max-depth", "2"], "settings of scene, camera or paths"),
    ] {
        part("5..12", "other.exr", more);
        let (code, message) = f.fails(&["merge", "a.exr", "other.exr", "-o", "x.exr"]);
        assert!(code == 2 && message.contains(told), "{message}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_standard_error_that_cannot_be_written_changes_nothing() {
    let f = Folder::new("full");
    let run = |args: &[&str]| {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_diopter"));
        command.args(args).current_dir(&f.0).stderr(full).stdout(std::process::Stdio::null());
        command.status().unwrap().code()
    };
    // What is said about a success, and about failures of both kinds.
    assert_eq!(run(&["lens", "convert", "triplet-50mm-f4", "-o", "mine.toml"]), Some(0));
    assert!(f.path("mine.toml").exists());
    assert_eq!(run(&["lens", "info", "missing.zmx"]), Some(1));
    assert_eq!(run(&["develop", "a.dng", "-o", "b.dng"]), Some(2));
}

#[test]
fn a_pipe_on_standard_input_is_a_file() {
    use std::io::Write;
    use std::process::Stdio;
    let f = Folder::new("pipe");
    f.ok(&["shoot", "cornell", "--size", "24x16", "--spp", "2", "--shutter", "1/30", "-o", "a.dng", "--keep-plane", "a.exr"]);
    f.ok(&["develop", "a.dng", "-o", "a.png"]);
    f.ok(&["read-out", "a.exr", "-o", "b.dng"]);
    let piped = |args: &[&str], file: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_diopter"));
        command.args(args).current_dir(&f.0).env("SOURCE_DATE_EPOCH", "1790000000").stderr(Stdio::piped());
        let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(&std::fs::read(f.path(file)).unwrap()).unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    piped(&["develop", "-", "-o", "piped.png"], "a.dng");
    assert_eq!(pixels(&f.path("piped.png")), pixels(&f.path("a.png")));
    // A plane that is opened several times.
    piped(&["read-out", "-", "-o", "piped.dng", "--truth", "truth.exr"], "a.exr");
    assert!(f.path("piped.dng").exists() && f.path("truth.exr").exists());
    // A lens is told by its ending, which a stream has not.
    let (code, message) = f.fails(&["lens", "info", "-"]);
    assert!(code == 2 && message.contains("expected"), "{code} {message}");
}

#[test]
fn light_from_elsewhere_is_read_out() {
    let f = Folder::new("light");
    let light = ["expose", "cornell", "--radiance", "--size", "24x16", "--spp", "4", "--shutter", "1/60", "--aperture", "f/4"];
    f.ok(&[&light[..], &["-o", "light.exr"]].concat());
    // Ours knows its lens, time and body.
    let told = |args: &[&str]| -> serde_json::Value { serde_json::from_slice(&f.ok(args).stdout).unwrap() };
    let own = told(&["read-out", "light.exr", "-o", "a.dng", "--iso", "400", "--truth", "a.exr", "--json"]);
    assert_eq!((own["facts"]["exposure_s"].as_f64(), own["files"].as_array().unwrap().len()), (Some(1.0 / 60.0), 2), "{own}");
    let longer = told(&["read-out", "light.exr", "-o", "b.dng", "--exposure", "1/30s", "--shots", "2", "--json"]);
    assert_eq!(longer["files"].as_array().unwrap().len(), 2);
    // A picture of another program: what it is must be said.
    f.ok(&["shoot", "cornell", "--size", "24x16", "--spp", "1", "-o", "other.exr"]);
    for (args, word) in [
        (&["--body", "nikon-d850", "--t-stop", "f/4"][..], "--exposure"),
        (&["--body", "nikon-d850", "--exposure", "1/100s"], "--irradiance"),
        (&["--irradiance", "--exposure", "1/100s"], "--body"),
    ] {
        let (code, message) = f.fails(&[&["read-out", "other.exr", "-o", "c.dng"], args].concat());
        assert!(code == 2 && message.contains(word), "{args:?}: {message}");
    }
    f.ok(&["read-out", "other.exr", "-o", "c.dng", "--body", "nikon-d850", "--exposure", "10 ms", "--t-stop", "2.8"]);
    f.ok(&["develop", "c.dng", "-o", "c.png"]);
}

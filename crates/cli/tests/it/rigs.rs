//! Rigs and event sensors as a user asks for them.

use crate::common::Folder;
use serde_json::Value;

const RIG: &str = "[rig]\nlook_from = [0.6, 0.5, 1.2]\nlook_at = [0, 0.1, 0]\n[frames]\ncount = 2\n[shot]\nscene.file = \"cornell\"\n\
    exposure.shutter = \"1/30\"\nrender = { size = \"24x16\", spp = 1 }\n[[camera]]\nname = \"eye\"\nbaseline = \"6 cm\"\n";

#[test]
fn a_rig_writes_its_folder_once() {
    let f = Folder::new("rig");
    std::fs::write(f.path("rig.toml"), RIG).unwrap();
    let told: Value = serde_json::from_slice(&f.ok(&["rig", "rig.toml", "-o", "out", "--json"]).stdout).unwrap();
    assert_eq!((told["cameras"].as_array().unwrap().len(), told["frames"].as_array().unwrap().len()), (2, 2), "{told}");
    for name in [
        "eye-left/000000.jpg",
        "eye-right/000001.jpg",
        "transforms.json",
        "calibration/camchain.yaml",
        "calibration/colmap/rigs.txt",
    ] {
        assert!(!f.read(&format!("out/{name}")).is_empty());
    }
    let (code, message) = f.fails(&["rig", "rig.toml", "-o", "out"]);
    assert!(code == 2 && message.contains("expected a new or empty folder"), "{message}");
    // What cannot be taken leaves no folder.
    std::fs::write(f.path("wrong.toml"), RIG.replace("cornell", "cornel")).unwrap();
    f.fails(&["rig", "wrong.toml", "-o", "other"]);
    std::fs::write(f.path("wrong.toml"), RIG.replace("baseline", "base")).unwrap();
    let (code, message) = f.fails(&["rig", "wrong.toml", "-o", "other"]);
    assert!(code == 2 && message.contains("wrong.toml") && message.contains("baseline"), "{message}");
}

#[test]
fn events_are_written_as_arrays_text_and_words() {
    let f = Folder::new("events");
    let flags = [
        "events",
        "rolling-ball",
        "--sensor",
        "ideal-events",
        "--aperture",
        "f/2.8",
        "--size",
        "32x24",
        "--spp",
        "1",
        "--duration",
        "20ms",
        "--step",
        "5ms",
    ];
    let told =
        f.ok(&[&flags[..], &["-o", "e.npy", "-o", "e.csv", "-o", "e.raw", "--keep-light", "light.npy", "--json"]].concat());
    let told: Value = serde_json::from_slice(&told.stdout).unwrap();
    let count = told["on"].as_u64().unwrap() + told["off"].as_u64().unwrap();
    let text = String::from_utf8(f.read("e.csv")).unwrap();
    assert_eq!((text.lines().count() as u64, told["times_s"].as_array().unwrap().len()), (count + 1, 5), "{told}");
    assert!((f.read("e.npy").len() as u64 - 14 * count).is_multiple_of(64));
    assert!(f.read("e.raw").starts_with(b"% evt 2.0\n") && f.read("light.npy").len() == 128 + 5 * 32 * 24 * 4);
    for (wrong, told) in [
        (&["-o", "e.txt"][..], ".npy, .csv or .raw"),
        (&["-o", "e2.npy", "--sensor", "davis34"], "did you mean \"davis346\""),
        (&["-o", "e2.npy", "--shutter", "1/100"], "no exposure time"),
        (&["-o", "e2.raw", "--size", "4000x2000"], "2048"),
    ] {
        let (code, message) = f.fails(&[&flags[..], wrong].concat());
        assert!(code == 2 && message.contains(told), "{message}");
    }
}

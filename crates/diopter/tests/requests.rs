//! What a shot file asks for, and what the camera says to it.

use diopter::expose::Watch;
use diopter::shot::{Shot, ShotFile};
use std::sync::atomic::AtomicBool;

/// A shot with what was said on the way.
fn told(toml: &str) -> (Shot, Vec<String>) {
    let file: ShotFile = toml::from_str(toml).unwrap_or_else(|e| panic!("{toml}: {e}"));
    let mut said = Vec::new();
    let shot = Shot::prepare(&file, &mut |w| said.push(w.to_owned())).unwrap_or_else(|e| panic!("{toml}: {e}"));
    (shot, said)
}

fn metered(toml: &str) -> (Shot, Vec<String>) {
    let (mut shot, mut said) = told(toml);
    let watch = Watch { cancel: &AtomicBool::new(false), progress: &|_| {} };
    shot.meter(&watch, &mut |w| said.push(w.to_owned())).unwrap();
    (shot, said)
}

#[test]
fn a_time_of_hours_is_said_to_be_long() {
    let long = |said: &[String]| said.iter().find(|s| s.contains("little light")).cloned();
    let small = "[render]\nsize = \"24x16\"\nspp = 1\n[exposure]\naperture = \"f/4\"\n";
    let (shot, said) = metered(&format!("{small}[scene]\nambient_ev = -8.0\n"));
    // 16 · 2^8 s.
    assert!((shot.shutter.unwrap() / 4096.0 - 1.0).abs() < 0.05, "{:?}", shot.shutter);
    let warning = long(&said).expect("it is said");
    assert!(warning.contains("mode A") && warning.contains(" min)") && warning.contains("--iso auto"), "{warning}");
    // In daylight, or when the photographer sets the time, there is nothing to say.
    assert_eq!(long(&metered(&format!("{small}[scene]\nambient_ev = 12.0\n")).1), None);
    assert_eq!(long(&metered(&format!("{small}shutter = \"4096s\"\n[scene]\nambient_ev = -8.0\n")).1), None);
}

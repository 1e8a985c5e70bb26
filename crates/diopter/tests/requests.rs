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
    assert!((3000.0..6000.0).contains(&shot.shutter.unwrap()), "{:?}", shot.shutter);
    let warning = long(&said).expect("it is said");
    assert!(warning.contains("mode A") && warning.contains(" min)") && warning.contains("--iso auto"), "{warning}");
    // In daylight, or when the photographer sets the time, there is nothing to say.
    assert_eq!(long(&metered(&format!("{small}[scene]\nambient_ev = 12.0\n")).1), None);
    assert_eq!(long(&metered(&format!("{small}shutter = \"4096s\"\n[scene]\nambient_ev = -8.0\n")).1), None);
}

/// A square of a side, in an OBJ file of its own.
struct Model(std::path::PathBuf);

impl Model {
    fn new(name: &str, side: f32) -> Model {
        let path = std::env::temp_dir().join(format!("diopter-requests-{name}-{}.obj", std::process::id()));
        let text = format!("v 0 0 0\nv {side} 0 0\nv {side} {side} 0\nv 0 {side} 0\nf 1 2 3 4\n");
        std::fs::write(&path, text).unwrap();
        Model(path)
    }

    fn shot(&self, more: &str) -> String {
        format!("[render]\nsize = \"24x16\"\n[scene]\nfile = \"{}\"\n{more}", self.0.display())
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).ok();
    }
}

#[test]
fn a_model_in_centimetres_is_asked_about_and_scaled() {
    let unit = |said: &[String]| said.iter().find(|s| s.contains("--scale")).cloned();
    let fox = Model::new("fox", 155.0);
    let (large, said) = told(&fox.shot(""));
    let warning = unit(&said).expect("155 m is odd");
    assert!(warning.contains("155 m") && warning.contains("--scale 0.01 for centimetres (1.55 m)"), "{warning}");
    // Everything follows: size, the place of the camera, what it is focused at.
    let (small, said) = told(&fox.shot("scale = 0.01\n"));
    assert_eq!(unit(&said), None);
    let size = |shot: &Shot| shot.scene.bounds().size().x;
    assert!((size(&small) - 1.55).abs() < 1e-3, "{}", size(&small));
    let focus = |shot: &Shot| shot.camera.lens.focus_distance().unwrap().0;
    assert!((focus(&large) / focus(&small) - 100.0).abs() < 0.5, "{} {}", focus(&large), focus(&small));
    let tiny = Model::new("tiny", 4e-4);
    assert!(unit(&told(&tiny.shot("")).1).expect("0.4 mm is odd").contains("400 µm"));
    let chair = Model::new("chair", 0.8);
    assert_eq!(unit(&told(&chair.shot("")).1), None);
}

#[test]
fn a_scale_that_makes_no_sense_is_refused() {
    let refused = |toml: &str| match Shot::prepare(&toml::from_str(toml).unwrap(), &mut |_| {}) {
        Ok(_) => panic!("{toml} was taken"),
        Err(e) => e.to_string(),
    };
    for scale in ["0.0", "-1.0", "nan", "1e30"] {
        assert!(refused(&format!("[scene]\nfile = \"a.obj\"\nscale = {scale}\n")).contains("millimetres"), "{scale}");
    }
    assert!(refused("[scene]\nfile = \"cornell\"\nscale = 0.1\n").contains("embedded"));
    assert!(refused("[scene]\nscale = 0.1\n").contains("embedded"));
}

#[test]
fn small_sensors_are_not_given_the_lens_of_a_full_frame() {
    let focal = |toml: &str| {
        let (shot, said) = told(&format!("[render]\nsize = \"24x18\"\n{toml}"));
        let lens = &shot.camera.lens;
        (lens.focal_length().0, lens.f_number(), said.into_iter().find(|s| s.contains("equivalent")))
    };
    // A phone has its own, and says so when it gets another.
    let (own, f_number, said) = focal("[camera]\nbody = \"pixel-4a\"");
    assert_eq!((own, f_number, said), (4.435, 1.7, None));
    let (given, _, said) = focal("[camera]\nbody = \"pixel-4a\"\nfocal_length = \"50mm\"");
    let said = said.expect("307 mm equivalent is worth a word");
    assert!(given == 50.0 && said.contains("307 mm") && said.contains("4.435"), "{said}");
    // Of a bare sensor the angle of view stays, where lenses for 35 mm do not fit.
    let (scaled, ..) = focal("[camera]\nbody = \"imx249\"");
    assert!((scaled - 50.0 * 13.4 / 43.27).abs() < 0.7, "{scaled}");
    for body in ["canon-40d", "canon-5d", "gsense6510bsi"] {
        assert_eq!(focal(&format!("[camera]\nbody = \"{body}\"")).0, 50.0, "{body}");
    }
}

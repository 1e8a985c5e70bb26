//! A shot from values in memory is the shot that names them.

use diopter::expose::Watch;
use diopter::image::FocalPlane;
use diopter::lens::embedded;
use diopter::scene::builtin;
use diopter::sensor::Sensor;
use diopter::shot::{Inputs, Shot, ShotFile};
use std::sync::atomic::AtomicBool;

const ASKED: &str = "[exposure]\nshutter = \"1/60\"\n[focus]\ndistance = \"1.2 m\"\n[render]\nsize = \"24x16\"\nspp = 2";

fn taken(toml: &str, inputs: Inputs) -> FocalPlane {
    let file: ShotFile = toml::from_str(toml).unwrap();
    let mut shot = Shot::prepare_with(&file, inputs, &mut |_| ()).unwrap();
    let watch = Watch { cancel: &AtomicBool::new(false), progress: &|_| () };
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    shot.expose(&watch).unwrap()
}

#[test]
fn values_in_memory_take_the_picture_of_their_names() {
    let named = format!(
        "[scene]\nfile = \"cornell\"\n[camera]\nbody = \"nikon-d850\"\nlens = \"double-gauss-50mm\"\nlook_from = [0.278, 0.273, -0.8]\nlook_at = [0.278, 0.273, 0.28]\n{ASKED}"
    );
    let bare = format!("[camera]\nlook_from = [0.278, 0.273, -0.8]\nlook_at = [0.278, 0.273, 0.28]\n{ASKED}");
    let inputs = Inputs {
        scene: builtin::named("cornell"),
        lens: embedded("double-gauss-50mm"),
        sensor: Some(Sensor::named("nikon-d850").unwrap()),
    };
    let (a, b) = (taken(&named, Inputs::default()), taken(&bare, inputs));
    assert_eq!(a.mean.data, b.mean.data);
    assert!(a.mean.data.iter().any(|v| *v > 0.0));
    assert_eq!((a.facts.lens, a.facts.body, a.facts.scene), (b.facts.lens, b.facts.body, b.facts.scene));
}

#[test]
fn a_lens_in_memory_is_real_whatever_it_is_called() {
    let mut lens = embedded("double-gauss-50mm").unwrap();
    lens.name = "pinhole".into();
    let file: ShotFile = toml::from_str(ASKED).unwrap();
    let shot = Shot::prepare_with(&file, Inputs { lens: Some(lens), ..Inputs::default() }, &mut |_| ()).unwrap();
    assert!(matches!(shot.camera.lens, diopter::lens::Lens::Compound(_)));
}

#[test]
fn what_settles_a_shot_names_the_scene_in_memory() {
    let mut scene = builtin::named("cornell").unwrap();
    scene.name = "mine".into();
    let file: ShotFile = toml::from_str(ASKED).unwrap();
    let shot = Shot::prepare_with(&file, Inputs { scene: Some(scene), ..Inputs::default() }, &mut |_| ()).unwrap();
    let mut settled = file.clone();
    shot.settle(&mut settled);
    assert_eq!(settled.scene.file.as_deref(), Some("mine"));
}

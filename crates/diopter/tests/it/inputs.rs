//! A shot from values in memory is the shot that names them.

use diopter::expose::{ProgressReporter, Sums};
use diopter::image::FocalPlane;
use diopter::lens::embedded;
use diopter::scene::builtin;
use diopter::sensor::Sensor;
use diopter::shot::{Inputs, SceneCache, Shot, ShotFile};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const ASKED: &str = "[exposure]\nshutter = \"1/60\"\n[focus]\ndistance = \"1.2 m\"\n[render]\nsize = \"24x16\"\nspp = 2";

fn taken(toml: &str, inputs: Inputs) -> FocalPlane {
    let file: ShotFile = toml::from_str(toml).unwrap();
    let mut shot = Shot::prepare_with(&file, inputs, &mut |_| ()).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
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
        scene: builtin::named("cornell").map(Arc::new),
        lens: embedded("double-gauss-50mm"),
        sensor: Some(Sensor::named("nikon-d850").unwrap()),
        ..Inputs::default()
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
    let shot = Shot::prepare_with(&file, Inputs { scene: Some(Arc::new(scene)), ..Inputs::default() }, &mut |_| ()).unwrap();
    let mut settled = file.clone();
    shot.write_resolved(&mut settled);
    assert_eq!(settled.scene.file.as_deref(), Some("mine"));
}

/// A shot of a scene that stands in the cache, and what it warned of.
fn taken_cached(toml: &str, cache: &mut SceneCache) -> (FocalPlane, Vec<String>) {
    let file: ShotFile = toml::from_str(toml).unwrap();
    let mut warnings = Vec::new();
    let mut shot = Shot::prepare_cached(&file, Inputs::default(), cache, &mut |w| warnings.push(w.to_owned())).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    (shot.expose(&watch).unwrap(), warnings)
}

#[test]
fn a_scene_from_the_cache_takes_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tent.obj");
    let tent = |height: f32| {
        std::fs::write(&file, format!("v -1 0 0\nv 1 0 0\nv 0 {height} 0\nv 0 0 1\nf 1 2 3\nf 1 4 3\nf 2 3 4\nf 1 1 2\n"))
            .unwrap();
    };
    tent(1.0);
    let shot = |scene: &str, camera: &str| format!("[scene]\nfile = {:?}\n{scene}\n[camera]\n{camera}\n{ASKED}", file.display());
    // The studio follows the camera; the rest keeps what was built.
    let asked = [
        shot("", "lens = \"thin\""),
        shot("", "lens = \"thin\"\nfocal_length = \"85 mm\""),
        shot("", "look_from = [2, 1, 3]\nlook_at = [0, 0.5, 0]"),
        shot("light = \"overcast\"", ""),
        shot("ground = 0.5", ""),
        shot("[scene.fog]\nvisibility = \"20 m\"", ""),
        shot("", "lens = \"thin\""),
        shot("", "lens = \"thin\"") + "\n[flash]\nguide_number = 20",
    ];
    let mut cache = SceneCache::new();
    for toml in &asked {
        let (fresh, warned) = taken_cached(toml, &mut SceneCache::new());
        let (kept, again) = taken_cached(toml, &mut cache);
        assert!(fresh.mean.data == kept.mean.data, "differs: {toml}");
        assert_eq!(warned, again, "{toml}");
    }
    // Another file under the same name is read.
    let before = taken_cached(&asked[0], &mut cache).0;
    tent(2.25);
    let (after, fresh) = (taken_cached(&asked[0], &mut cache).0, taken_cached(&asked[0], &mut SceneCache::new()).0);
    assert!(after.mean.data == fresh.mean.data && after.mean.data != before.mean.data);
}

#[test]
fn whoever_watches_sees_the_picture_so_far() {
    let ready = |spp: u32| {
        let toml = format!("[scene]\nfile = \"cornell\"\n{}", ASKED.replace("spp = 2", &format!("spp = {spp}")));
        let mut shot = Shot::prepare(&toml::from_str(&toml).unwrap(), &mut |_| ()).unwrap();
        shot.meter(&ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () }, &mut |_| ()).unwrap();
        shot
    };
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let shot = ready(12);
    let mut seen = Vec::new();
    let mut look = |sums: &Sums| {
        seen.extend(shot.so_far(sums));
        ControlFlow::Continue(())
    };
    let watched = shot.expose_from(None, &watch, Some(&mut look)).unwrap().plane;
    // Looking changes nothing.
    assert!(watched == shot.expose(&watch).unwrap());
    assert_eq!(seen.iter().map(|plane| plane.facts.samples).collect::<Vec<_>>(), [2, 4, 8]);
    // What was seen after some samples is what an exposure of the first of them gives.
    for plane in seen {
        let mut first = ready(12);
        first.settings.samples = 0..plane.facts.samples;
        let first = first.expose(&watch).unwrap();
        assert!(plane.mean == first.mean && plane.half_difference == first.half_difference, "{}", plane.facts.samples);
    }
}

//! Meters against the truth: a grey card in twenty scenes over twenty EV.

use diopter::camera::look_at;
use diopter::expose::Watch;
use diopter::image::ExposureFacts;
use diopter::lens::{Lens, Pinhole};
use diopter::light::cie;
use diopter::light::units::Millimeters;
use diopter::metering::{Meter, Pattern, ev100_of_luminance, mean_luminance};
use diopter::scene::light::Environment;
use diopter::scene::material::{Material, Scattering};
use diopter::scene::shape::Mesh;
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape, builtin, load};
use diopter::sensor::{Reading, Sensor};
use diopter::shot::read_environment;
use diopter::{Camera, CameraWay, Film, Response, Settings, Shutter, expose};
use glam::{Affine3A, Vec3};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Share of the picture's height that the card takes: a little more than the spot.
const CARD: f32 = 0.3;
const FOCAL_MM: f64 = 50.0;

fn shared() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/scenes")
}

/// Scenes: embedded, environments with nothing but the card, files. Name, description, camera.
fn scenes() -> Vec<(String, Description, Affine3A)> {
    let mut all = Vec::new();
    let lights = ["color-chart", "color-chart-a", "color-chart-d50", "color-chart-fl2", "color-chart-led-b3", "color-chart-d75"];
    let names = ["still-life", "resolution-chart", "moving-bars", "propeller", "rolling-ball"];
    for name in names.into_iter().chain(lights) {
        let d = builtin::named(name).unwrap();
        let place = match (builtin::framing(name), d.cameras.first()) {
            (Some(f), _) => look_at(f.look_from, f.look_at, Vec3::Y).unwrap(),
            (None, Some(view)) => view.world_from_camera,
            _ => unreachable!("{name} has a view"),
        };
        all.push((name.to_owned(), d, place));
    }
    for name in ["studio", "forest", "venice"] {
        let file = shared().join(format!("hdri_{name}/{name}.hdr"));
        if let Ok(environment) = read_environment(&file, 30.0, 1000.0) {
            let d = Description { environment: Some(environment), ..Default::default() };
            all.push((name.to_owned(), d, Affine3A::from_translation(Vec3::Y)));
        }
    }
    let files = [
        "gltf_Box/Box.glb",
        "gltf_CesiumMilkTruck/CesiumMilkTruck.glb",
        "gltf_FlightHelmet/FlightHelmet.gltf",
        "gltf_Fox/Fox.glb",
        "gltf_bevy_CornellBox/CornellBox.glb",
        "gltf_bevy_TonemappingTest/TonemappingTest.gltf",
    ];
    for file in files {
        let path = shared().join(file);
        let folder = path.parent().unwrap().to_owned();
        let fetch = move |uri: &str| std::fs::read(folder.join(uri)).map_err(|e| e.to_string());
        let Ok(bytes) = std::fs::read(&path) else { continue };
        let mut d = load::gltf::load(&bytes, file, &fetch).unwrap();
        if d.punctual.is_empty() && !d.materials.iter().any(|m| m.emission.is_some()) {
            d.environment = Some(Environment::uniform(Vec3::splat(500.0)));
        }
        let bounds = d.bounds_at(0.0, |_| true);
        let from = bounds.center() + Vec3::new(0.5, 0.3, 1.0).normalize() * bounds.size().length() * 1.2;
        let place = look_at(from, bounds.center(), Vec3::Y).unwrap();
        all.push((file.to_owned(), d, place));
    }
    if all.len() < 20 {
        println!("only {} of 20 scenes: the others are not at hand", all.len());
    }
    all
}

/// Hangs a grey card (18 %) before the camera, in the middle of the picture.
fn with_card(mut d: Description, name: &str, place: &Affine3A) -> Description {
    let bounds = d.bounds_at(0.0, |_| true);
    let distance = match name.to_lowercase().contains("cornell") {
        // In the room, whose open side lets no light out to a card before it.
        true => 0.85 * (bounds.center() - Vec3::from(place.translation)).length(),
        false => 0.5 * bounds.size().length().clamp(0.02, 1.0),
    };
    let half = 0.5 * CARD * 24.0 / FOCAL_MM as f32 * distance;
    let corner = |x: f32, y: f32| place.transform_point3(Vec3::new(x * half, y * half, -distance));
    d.meshes.push(Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    });
    d.materials.push(Material::new("card", Scattering::Diffuse(Color::rgb(0.18, 0.18, 0.18))));
    let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
    d.objects.push(Object::new("card", shape, d.materials.len() as u32 - 1));
    d
}

#[test]
fn a_grey_card_lands_on_its_target_in_twenty_scenes_over_twenty_ev() {
    let stop = AtomicBool::new(false);
    let watch = Watch { cancel: &stop, progress: &|_| () };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let white = cie::illuminant("D65").unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(FOCAL_MM), 8.0).unwrap());
    let all = scenes();
    let count = all.len();
    let mut worst: (f64, String) = (0.0, String::new());
    for (k, (name, d, place)) in all.into_iter().enumerate() {
        let scene = Scene::build(with_card(d, &name, &place)).unwrap();
        let film = Film { pixel_area_mm2: 5.36e-3f64.powi(2), ..Film::new(36.0, 24.0, 96, 64) };
        let camera = Camera { way: CameraWay::still(place), lens: lens.clone(), film };
        // From the night to snow in the sun.
        let wanted = -3.0 + 20.0 * k as f64 / (count - 1).max(1) as f64;
        let mut settings = Settings { truth: false, ..Settings::new(64) };
        let found = ev100_of_luminance(mean_luminance(&scene, &camera, &settings, &watch).unwrap());
        settings.light_scale = (wanted - found).exp2();
        // The truth: luminance of the card's middle.
        let plane =
            expose(&scene, &camera, &Shutter::global(1.0), &Response::luminance(), &settings, &ExposureFacts::default(), &watch)
                .unwrap();
        let middle: Vec<f64> =
            (28..36).flat_map(|y| (44..52).map(move |x| y * 96 + x)).map(|i| f64::from(plane.mean.data[i])).collect();
        let truth = ev100_of_luminance(middle.iter().sum::<f64>() / middle.len() as f64);
        // Probes are small beside a real picture: ask for as many samples as one has.
        let probing = Settings { spp: 1024, samples: 0..1024, ..settings.clone() };
        let reading = Reading::new(100.0, 1);
        let meter = |pattern| Meter { sensor: &sensor, reading: &reading, pattern, at: [0.5; 2], filter: 1.0 };
        let read = |pattern| meter(pattern).read(&scene, &camera, &probing, &white, &watch).unwrap();
        let spot = read(Pattern::Spot).unwrap();
        println!("{name:<50} EV {wanted:5.1}: card {truth:6.2}, spot {:+.3}", spot - truth);
        if (spot - truth).abs() > worst.0 {
            worst = ((spot - truth).abs(), name.clone());
        }
        // All others find light that lies between the darkest and the brightest of the scene.
        for pattern in [Pattern::Average, Pattern::CentreWeighted, Pattern::Matrix, Pattern::Highlight] {
            assert!(read(pattern).is_some_and(|ev| (ev - wanted).abs() < 8.0), "{name} {}", pattern.name());
        }
    }
    assert!(worst.0 < 1.0 / 6.0, "{} is {} EV off", worst.1, worst.0);
}

#[test]
fn every_pattern_agrees_on_an_even_card_over_twenty_ev() {
    let stop = AtomicBool::new(false);
    let watch = Watch { cancel: &stop, progress: &|_| () };
    let d = Description { environment: Some(Environment::uniform(Vec3::splat(1.0))), ..Default::default() };
    let scene = Scene::build(d).unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(500.0), 8.0).unwrap());
    let place = Affine3A::IDENTITY;
    for body in ["canon-5d-mark-iv", "nikon-d850", "sony-a7s-ii"] {
        let sensor = Sensor::named(body).unwrap();
        let [w, h] = sensor.pitch_mm();
        let film = Film { pixel_area_mm2: w * h, ..Film::new(36.0, 24.0, 960, 640) };
        let camera = Camera { way: CameraWay::still(place), lens: lens.clone(), film };
        for k in 0..=10 {
            let ev = -3.0 + 2.0 * f64::from(k);
            // Luminance of that EV.
            let settings = Settings { light_scale: 0.125 * ev.exp2(), truth: false, ..Settings::new(64) };
            let reading = Reading::new(100.0, u64::from(k as u32));
            for pattern in Pattern::NAMES.map(|n| n.1) {
                let meter = Meter { sensor: &sensor, reading: &reading, pattern, at: [0.5; 2], filter: 0.5 };
                let white = cie::illuminant("D65").unwrap();
                let found = meter.read(&scene, &camera, &settings, &white, &watch).unwrap().unwrap();
                // The filter takes a stop. Highlights of an even field are to be brighter than middle grey: by 3 stops or so.
                let off = found - (ev - 1.0);
                match pattern {
                    Pattern::Highlight => assert!((-3.6..-1.8).contains(&off), "{body} {ev}: {off}"),
                    _ => assert!(off.abs() < 0.06, "{body} {} at EV {ev}: {off}", pattern.name()),
                }
            }
        }
    }
    // In darkness there is nothing to read.
    let settings = Settings { light_scale: 0.0, truth: false, ..Settings::new(16) };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let camera = Camera { way: CameraWay::still(place), lens, film: Film::new(36.0, 24.0, 96, 64) };
    let reading = Reading::new(100.0, 1);
    let meter = Meter { sensor: &sensor, reading: &reading, pattern: Pattern::Average, at: [0.5; 2], filter: 1.0 };
    let found = meter.read(&scene, &camera, &settings, &cie::illuminant("D65").unwrap(), &watch).unwrap();
    assert!(found.is_none_or(|ev| ev < -14.0), "{found:?}");
}

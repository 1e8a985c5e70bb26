//! Meters against the truth: a grey card in twenty scenes over twenty EV.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::{ExposureFacts, Raster};
use diopter::lens::{Lens, Pinhole};
use diopter::light::units::Millimeters;
use diopter::light::{Spectrum, cie};
use diopter::metering::{Meter, Pattern, ev100_of_luminance, mean_luminance};
use diopter::scene::light::{Environment, Punctual, PunctualKind};
use diopter::scene::material::{Conductor, Material, Scattering};
use diopter::scene::shape::{Mesh, Quad, Sphere};
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape, builtin, load};
use diopter::sensor::{Reading, Sensor};
use diopter::shot::{Sequence, Shot, read_environment};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::{Affine3A, Mat3, Vec3};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::common::generated;

/// Fraction of the picture's height that the card takes: a little more than the spot.
const CARD: f32 = 0.3;
const FOCAL_MM: f64 = 50.0;

/// A scene, by name, and where the camera stands.
type View = (String, Description, Affine3A);

/// Surroundings, lat-long: a clear sky with a sun over dark ground, a dark studio with two soft boxes, sky through leaves.
fn surroundings() -> Vec<View> {
    let map = |radiance: &dyn Fn(usize, usize) -> f32| {
        let mut map = Raster::new(64, 32, 3);
        for row in 0..32 {
            for column in 0..64 {
                map.pixel_mut(column, row).fill(radiance(column, row));
            }
        }
        Environment::new(map, Mat3::IDENTITY, 1000.0)
    };
    // Column 0 is behind the camera, which looks along −z: what lights the card is at both ends of a row.
    let sunny = map(&|column, row| match (column, row) {
        (4, 8) => 2000.0,
        (_, 0..16) => 2.0 + 4.0 * row as f32 / 16.0,
        _ => 0.5,
    });
    let studio = map(&|column, row| match (column, row) {
        (2..7, 6..14) => 20.0,
        (54..60, 8..18) => 8.0,
        _ => 0.02,
    });
    let leaves = map(&|column, row| match (column * 7 + row * 13) % 11 {
        0 | 5 if row < 18 => 6.0,
        _ => 0.1,
    });
    [("sunny", sunny), ("studio", studio), ("leaves", leaves)]
        .map(|(name, environment)| {
            let d = Description { environment: Some(environment), ..Default::default() };
            (name.to_owned(), d, Affine3A::from_translation(Vec3::Y))
        })
        .into()
}

fn quad(corner: [f32; 3], a: Vec3, b: Vec3) -> Shape {
    Shape::Quad(Quad { corner: Vec3::from_array(corner), edges: [a, b] })
}

/// Things on the ground under one lamp, under the sun, in a closed room, and of metal and glass.
fn built() -> Vec<View> {
    let grey = |name: &str, v: f32| Material::new(name, Scattering::Diffuse(Color::rgb(v, v, v)));
    let ball = |x: f32, material: u32| {
        Object::new("ball", Shape::Sphere(Sphere { center: Vec3::new(x, 0.4, 0.0), radius: 0.4 }), material)
    };
    let ground = || Object::new("ground", quad([-4.0, 0.0, 4.0], Vec3::X * 8.0, Vec3::NEG_Z * 8.0), 0);
    let balls = || Description {
        materials: vec![grey("ground", 0.5), grey("light", 0.8), grey("dark", 0.05)],
        objects: vec![ground(), ball(-0.5, 1), ball(0.5, 2)],
        ..Default::default()
    };
    let power = |v: f32| Spectrum::light_from_rgb(Vec3::splat(v));
    let mut lamp = balls();
    let kind = PunctualKind::Point { position: Vec3::new(1.0, 3.0, 5.0) };
    lamp.punctual.push(Punctual::new("lamp", power(500.0), kind));
    let mut sun = balls();
    let direction = Vec3::new(-0.5, -0.7, -0.6).normalize();
    sun.punctual.push(Punctual::new("sun", power(80_000.0), PunctualKind::Directional { direction }));
    sun.environment = Some(Environment::uniform(Vec3::new(2000.0, 3000.0, 5000.0)));
    let mut shiny = balls();
    shiny.materials[1] = Material::new("gold", Scattering::Conductor(Conductor::metal("gold", 0.0).unwrap()));
    shiny.materials[2] = Material::glass("glass", 1.5, None);
    shiny.environment = Some(Environment::uniform(Vec3::splat(500.0)));
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 3.0, Vec3::Z * 6.0);
    let walls = [
        quad([-2.0, 0.0, -3.0], z, x),
        quad([-2.0, 3.0, -3.0], x, z),
        quad([-2.0, 0.0, -3.0], x, y),
        quad([-2.0, 0.0, 3.0], y, x),
        quad([-2.0, 0.0, -3.0], y, z),
        quad([2.0, 0.0, -3.0], z, y),
    ];
    let mut room = balls();
    room.materials.push(Material::lamp("lamp", power(1000.0)));
    room.objects.remove(0);
    room.objects.extend(walls.map(|w| Object::new("wall", w, 0)));
    // Its front looks down.
    room.objects.push(Object::new("lamp", quad([-0.3, 2.99, 2.3], Vec3::X * 0.6, Vec3::Z * 0.6), 3));
    let from = look_at(Vec3::new(0.0, 1.2, 2.5), Vec3::new(0.0, 0.6, 0.0), Vec3::Y).unwrap();
    [("lamp", lamp), ("sun", sun), ("gold and glass", shiny), ("room", room)].map(|(name, d)| (name.to_owned(), d, from)).into()
}

/// A glTF file; where it has no light, an even sky.
fn file(name: &str, bytes: &[u8], fetch: load::Fetch) -> View {
    let mut d = load::gltf::load(bytes, name, fetch).unwrap();
    if d.punctual.is_empty() && !d.materials.iter().any(|m| m.emission.is_some()) {
        d.environment = Some(Environment::uniform(Vec3::splat(500.0)));
    }
    let bounds = d.bounds_at(0.0, |_| true);
    let from = bounds.center() + Vec3::new(0.5, 0.3, 1.0).normalize() * bounds.size().length() * 1.2;
    let place = look_at(from, bounds.center(), Vec3::Y).unwrap();
    (name.to_owned(), d, place)
}

/// Embedded scenes, surroundings with nothing but the card, things in rooms and outside, glTF files.
fn scenes() -> Vec<View> {
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
    all.extend(surroundings());
    all.extend(built());
    let none = |_: &str| -> Result<Vec<u8>, String> { Err("no files here".into()) };
    all.extend([("cart.glb", generated::cart()), ("tail.glb", generated::tail())].map(|(n, bytes)| file(n, &bytes, &none)));
    all
}

/// Environments and glTF files of others.
fn reference_scenes() -> Vec<View> {
    let data = std::env::var("DIOPTER_REFERENCE_DATA").expect("DIOPTER_REFERENCE_DATA names the folder that holds scenes/");
    let folder = Path::new(&data).join("scenes");
    let mut all = Vec::new();
    for name in ["studio", "forest", "venice"] {
        let environment = read_environment(&folder.join(format!("hdri_{name}/{name}.hdr")), 30.0, 1000.0).unwrap();
        let d = Description { environment: Some(environment), ..Default::default() };
        all.push((name.to_owned(), d, Affine3A::from_translation(Vec3::Y)));
    }
    for name in [
        "gltf_Box/Box.glb",
        "gltf_CesiumMilkTruck/CesiumMilkTruck.glb",
        "gltf_FlightHelmet/FlightHelmet.gltf",
        "gltf_Fox/Fox.glb",
        "gltf_bevy_CornellBox/CornellBox.glb",
        "gltf_bevy_TonemappingTest/TonemappingTest.gltf",
    ] {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let fetch = |uri: &str| std::fs::read(path.with_file_name(uri)).map_err(|e| e.to_string());
        all.push(file(name, &bytes, &fetch));
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
    d.meshes.push(Arc::new(Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    }));
    d.materials.push(Material::new("card", Scattering::Diffuse(Color::rgb(0.18, 0.18, 0.18))));
    let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
    d.objects.push(Object::new("card", shape, d.materials.len() as u32 - 1));
    d
}

/// What may be left between a spot reading and the card, EV: the weights of the channels are one compromise for ten lights (from candles to
/// D75 and fluorescent tubes), a few per cent off under each; readings agree to 0.02. Noise is averaged away, see below. The worst is the three-band tube FL2, 0.071.
const SPOT_EV: f64 = 0.08;

#[test]
fn a_grey_card_lands_on_its_target_in_twenty_scenes_over_twenty_ev() {
    let all = scenes();
    assert_eq!(all.len(), 20);
    cards_land_on_their_target(all);
}

#[test]
#[ignore = "needs the reference scenes: set DIOPTER_REFERENCE_DATA"]
fn a_grey_card_lands_on_its_target_in_scenes_of_others() {
    cards_land_on_their_target(reference_scenes());
}

fn cards_land_on_their_target(all: Vec<View>) {
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let white = cie::illuminant("D65").unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(FOCAL_MM), 8.0).unwrap());
    let count = all.len();
    let mut worst: (f64, String) = (0.0, String::new());
    for (k, (name, d, place)) in all.into_iter().enumerate() {
        let scene = Scene::build(with_card(d, &name, &place)).unwrap();
        let film = Film { pixel_area_mm2: 5.36e-3f64.powi(2), ..Film::new(36.0, 24.0, 96, 64) };
        let camera = Camera { motion: CameraMotion::still(place), lens: lens.clone(), film };
        // From the night to snow in the sun.
        let wanted = -3.0 + 20.0 * k as f64 / (count - 1).max(1) as f64;
        let mut settings = Settings { truth: false, ..Settings::new(64) };
        let found = ev100_of_luminance(mean_luminance(&scene, &camera, &settings, &watch).unwrap());
        settings.light_scale = (wanted - found).exp2();
        // The truth: luminance of the card's middle, 8 × 8 pixels of the 96 × 64. A sample deviates by about its mean: 262 144 of them
        // leave 0.2 %.
        let truth = Camera { film: Film::new(3.0, 3.0, 8, 8), ..camera.clone() };
        let fine = Settings { spp: 4096, samples: 0..4096, ..settings.clone() };
        let plane =
            expose(&scene, &truth, &Shutter::global(1.0), &Response::luminance(), &fine, &ExposureFacts::default(), &watch)
                .unwrap();
        let truth = ev100_of_luminance(plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.mean.data.len() as f64);
        let read = |pattern, seed: u64| {
            let reading = Reading::new(100.0, seed);
            let meter = Meter { sensor: &sensor, reading: &reading, pattern, at: [0.5; 2], filter: 1.0 };
            meter.read(&scene, &camera, &Settings { seed, ..settings.clone() }, &white, &watch).unwrap()
        };
        // A spot sees some 51 000 samples, 0.006 EV of noise, or as many as leave 0.015.
        let spot = read(Pattern::Spot, 1).unwrap();
        println!("{name:<50} EV {wanted:5.1}: card {truth:6.2}, spot {:+.3}", spot - truth);
        if (spot - truth).abs() > worst.0 {
            worst = ((spot - truth).abs(), name.clone());
        }
        // All others find light that lies between the darkest and the brightest of the scene.
        for pattern in [Pattern::Average, Pattern::CentreWeighted, Pattern::Matrix, Pattern::Highlight] {
            assert!(read(pattern, 1).is_some_and(|ev| (ev - wanted).abs() < 8.0), "{name} {}", pattern.name());
        }
    }
    assert!(worst.0 < SPOT_EV, "{} is {} EV off", worst.1, worst.0);
}

#[test]
fn the_spot_has_samples_of_its_own_up_to_the_corners() {
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let (_, room, place) = built().into_iter().find(|(name, ..)| name == "room").unwrap();
    let scene = Scene::build(room).unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(20.0), 8.0).unwrap());
    let film = Film { pixel_area_mm2: 5.36e-3f64.powi(2), ..Film::new(36.0, 24.0, 96, 64) };
    let camera = Camera { lens, film, motion: CameraMotion::still(place) };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let white = cie::illuminant("D65").unwrap();
    let read = |at: [f64; 2], seed: u64| {
        let meter = Meter { sensor: &sensor, reading: &Reading::new(100.0, seed), pattern: Pattern::Spot, at, filter: 1.0 };
        meter.read(&scene, &camera, &Settings { seed, ..Settings::new(64) }, &white, &watch).unwrap().unwrap()
    };
    for at in [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.99, 1.0]] {
        let readings: Vec<f64> = (1..=6).map(|seed| read(at, seed)).collect();
        let (low, high) = readings.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(*r), h.max(*r)));
        // Deviations of 0.015 EV at most; six of them lie within 2.5 of these, 4 in one of a hundred. Of the pixels of the whole picture they would be 0.04 and more.
        assert!(high - low < 0.06, "{at:?}: {readings:?}");
    }
}

#[test]
fn every_pattern_agrees_on_an_even_card_over_twenty_ev() {
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let d = Description { environment: Some(Environment::uniform(Vec3::splat(1.0))), ..Default::default() };
    let scene = Scene::build(d).unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(500.0), 8.0).unwrap());
    let place = Affine3A::IDENTITY;
    for body in ["canon-5d-mark-iv", "nikon-d850", "sony-a7s-ii"] {
        let sensor = Sensor::named(body).unwrap();
        let [w, h] = sensor.pitch_mm();
        let film = Film { pixel_area_mm2: w * h, ..Film::new(36.0, 24.0, 960, 640) };
        let camera = Camera { motion: CameraMotion::still(place), lens: lens.clone(), film };
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
    let camera = Camera { motion: CameraMotion::still(place), lens, film: Film::new(36.0, 24.0, 96, 64) };
    let reading = Reading::new(100.0, 1);
    let meter = Meter { sensor: &sensor, reading: &reading, pattern: Pattern::Average, at: [0.5; 2], filter: 1.0 };
    let found = meter.read(&scene, &camera, &settings, &cie::illuminant("D65").unwrap(), &watch).unwrap();
    assert!(found.is_none_or(|ev| ev < -14.0), "{found:?}");
}

/// A shot of the flat field that is metered, and the EV of the scene that it was found to have.
fn metered(toml: &str) -> (Shot, f64) {
    let file = toml::from_str(toml).unwrap();
    let mut shot = Shot::prepare(&file, &mut |_| ()).unwrap();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    let ev = shot.facts().metered_ev100.unwrap();
    (shot, ev)
}

#[test]
fn dark_current_is_no_light() {
    // A warm sensor reads a night of EV −4, for which it counts for minutes, as a cold one.
    for metering in ["average", "spot", "matrix"] {
        let at = |celsius: f64| {
            metered(&format!(
                "[scene]\nfile = \"flat-field\"\nambient_ev = -4\n[camera]\nbody = \"imx490\"\nlens = \"thin\"\nfocal_length = \"6mm\"\n\
                 [exposure]\naperture = \"f/2\"\ntemperature_c = {celsius}\nmetering = \"{metering}\"\n[render]\nsize = \"48x32\"\nspp = 1\n"
            ))
            .1
        };
        let cold = at(-60.0);
        for celsius in [25.0, 50.0, 75.0] {
            assert!((at(celsius) - cold).abs() < 0.1, "{metering}, {celsius} °C: EV {} for {cold}", at(celsius));
        }
    }
}

#[test]
fn shutters_that_are_open_longer_than_they_are_set_to_expose_right() {
    let exposed = |more: &str, shutter: &str| {
        let toml = format!(
            "[shutter]\n{shutter}\n[scene]\nfile = \"flat-field\"\nambient_ev = 12\n[camera]\nlens = \"thin\"\nfocal_length = \"50mm\"\n[exposure]\n{more}\n\
             [render]\nsize = \"24x16\"\nspp = 16\n"
        );
        let (shot, _) = metered(&toml);
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
        let plane = shot.expose(&watch).unwrap();
        let mean = plane.mean.data.iter().skip(1).step_by(3).map(|v| f64::from(*v)).sum::<f64>() / (24.0 * 16.0);
        // Of the same speed: electrons for ISO 100.
        mean * shot.reading.iso / 100.0
    };
    let usual = exposed("aperture = \"f/4\"", "kind = \"global\"");
    for (more, shutter) in [
        ("aperture = \"f/4\"", "kind = \"leaf\""),
        ("mode = \"S\"\nshutter = \"1/500\"", "kind = \"leaf\""),
        ("mode = \"S\"\nshutter = \"1/30\"", "kind = \"leaf\""),
        ("aperture = \"f/5.6\"\nshutter = \"1/500\"\niso = \"auto\"", "kind = \"leaf\""),
        ("aperture = \"f/16\"", "kind = \"rolling\"\nreadout = \"10ms\"\nreset = \"global\""),
    ] {
        let found = exposed(more, shutter);
        assert!((found / usual).log2().abs() < 0.05, "{more} {shutter}: {found} e- for {usual}");
    }
}

/// A shot of the flat field at an EV.
fn even(ev: f64, exposure: &str, shutter: &str) -> Shot {
    metered(&format!(
        "[shutter]\n{shutter}\n[scene]\nfile = \"flat-field\"\nambient_ev = {ev}\n[camera]\nlens = \"thin\"\nfocal_length = \"50mm\"\n[exposure]\n{exposure}\n\
         [render]\nsize = \"24x16\"\nspp = 1\n"
    ))
    .0
}

/// EV by which a shot is exposed more than its scene asks for.
fn over(shot: &Shot) -> f64 {
    let facts = shot.facts();
    let open_s = facts.shutter.as_ref().unwrap().effective_s;
    let of_setting = (facts.t_number.powi(2) / open_s * 100.0 / shot.reading.iso).log2();
    facts.metered_ev100.unwrap() - of_setting
}

#[test]
fn the_camera_chooses_what_a_shutter_can_do() {
    let global = "kind = \"rolling\"\nreadout = \"20ms\"\nreset = \"global\"";
    // Rows are open for 10 ms in the middle at least: the aperture closes, and speeds stay low.
    for (ev, exposure) in [(13.0, "mode = \"P\""), (8.0, "aperture = \"f/4\"\niso = \"auto\"\nslowest = \"1/200\"")] {
        let shot = even(ev, exposure, global);
        assert!(over(&shot).abs() < 0.1, "{exposure}: {} EV, {:?}", over(&shot), shot.facts());
    }
    // Dials click what is marked, whatever light that lets through.
    for (ev, kind) in [(8.0, global), (13.0, "kind = \"leaf\""), (9.0, "kind = \"leaf\"")] {
        let shot = even(ev, "mode = \"A\"\naperture = \"f/11\"\ndial = \"third\"", kind);
        let thirds = 3.0 * shot.shutter().exposure_s.log2();
        assert!((thirds - thirds.round()).abs() < 1e-6, "{kind}: 1/{} s", 1.0 / shot.shutter().exposure_s);
        assert!(over(&shot).abs() < 0.2, "{kind}: {} EV", over(&shot));
    }
}

#[test]
fn brackets_step_in_light() {
    for (ev, exposure, shutter) in [
        (10.0, "aperture = \"f/11\"", "kind = \"rolling\"\nreadout = \"20ms\"\nreset = \"global\""),
        (13.0, "aperture = \"f/11\"", "kind = \"leaf\""),
        (13.0, "mode = \"S\"\nshutter = \"1/500\"", "kind = \"leaf\""),
        (13.0, "aperture = \"f/11\"", "kind = \"focal-plane\""),
    ] {
        let mut shot = even(ev, exposure, shutter);
        let series = Sequence::Bracket { count: 3, step_ev: 1.0, vary: None };
        let light = |shot: &Shot| {
            let facts = shot.facts();
            (facts.shutter.as_ref().unwrap().effective_s / facts.t_number.powi(2)).log2()
        };
        let middle = light(&shot);
        for (k, step) in [-1.0, 0.0, 1.0].into_iter().enumerate() {
            series.turn(&mut shot, k, &mut |_| ()).unwrap();
            let found = light(&shot) - middle;
            assert!((found - step).abs() < 0.02, "{exposure}, {shutter}: {found} for {step}");
            assert!((shot.facts().bracket_ev.unwrap() - found).abs() < 0.02, "{:?}", shot.facts().bracket_ev);
        }
    }
}

#[test]
fn a_sensor_that_saturates_early_is_metered_all_the_same() {
    // Speeds that the full well cannot give: the picture is white, but the light is what it is.
    let folder = std::env::temp_dir().join(format!("diopter-metering-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let of = |iso: f64| {
        let path = folder.join(format!("iso{iso}.toml"));
        std::fs::write(
            &path,
            format!(
                "name = \"early {iso}\"\nformat_mm = [36, 24]\npixels = [6000, 4000]\ncfa = \"mono\"\nresponse = {{ first_nm = 380, step_nm = 200, Y = [1, 1, 1] }}\n\
                 peak_quantum_efficiency = 0.5\nfull_well_e = 10000\nadc_bits = 12\nblack_level_dn = 64\nwhite_level_dn = 4095\niso = [[{iso}, 2.5, 3.0]]\n[sources]\n"
            ),
        )
        .unwrap();
        metered(&format!(
            "[scene]\nfile = \"flat-field\"\nambient_ev = 11\n[camera]\nbody = \"{}\"\nlens = \"thin\"\nfocal_length = \"50mm\"\n[exposure]\naperture = \"f/4\"\n\
             [render]\nsize = \"48x32\"\nspp = 1\n",
            path.display()
        ))
        .1
    };
    let right = of(2000.0);
    for iso in [200.0, 25.0] {
        assert!((of(iso) - right).abs() < 0.05, "ISO {iso}: EV {} for {right}", of(iso));
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_reading_does_not_depend_on_the_samples_of_the_picture() {
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let d = builtin::named("cornell").unwrap();
    let motion = CameraMotion::still(d.cameras[0].world_from_camera);
    let scene = Scene::build(d).unwrap();
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let white = cie::illuminant("D65").unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(35.0), 8.0).unwrap());
    let reading = Reading::new(100.0, 1);
    let meter = Meter { sensor: &sensor, reading: &reading, pattern: Pattern::Matrix, at: [0.5; 2], filter: 1.0 };
    let read = |size: usize, spp: u32, samples: std::ops::Range<u32>| {
        let film = Film { pixel_area_mm2: 5.36e-3f64.powi(2), ..Film::new(25.0, 25.0, size, size) };
        let camera = Camera { motion: motion.clone(), lens: lens.clone(), film };
        let settings = Settings { samples, ..Settings::new(spp) };
        let luminance = mean_luminance(&scene, &camera, &settings, &watch).unwrap();
        (meter.read(&scene, &camera, &settings, &white, &watch).unwrap().unwrap(), luminance)
    };
    let whole = read(600, 128, 0..128);
    for (size, spp, samples) in
        [(600, 128, 0..16), (600, 128, 16..128), (600, 1, 0..1), (600, 1 << 16, 0..1 << 16), (32, 2, 0..2)]
    {
        assert_eq!(read(size, spp, samples.clone()), whole, "{size} pixels, samples {samples:?} of {spp}");
    }
}

#[test]
fn an_exposure_of_radiance_tells_what_the_meter_reads() {
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    // Wide without a lens, where cos⁴ darkens the corners; a lens that vignettes, behind a filter; a colour cast, and speeds chosen by the camera.
    for (what, sections) in [
        ("pinhole", "[camera]\nlens = \"pinhole\"\nfocal_length = \"14mm\"\n"),
        (
            "lens",
            "[scene]\nambient_ev = 9.0\n[camera]\nlens = \"double-gauss-50mm\"\n[exposure]\naperture = \"f/2\"\nnd = \"ND8\"\n",
        ),
        ("speeds", "[exposure]\niso = \"auto\"\nmetering = \"matrix\"\nmode = \"A\"\n"),
    ] {
        let text = format!("{sections}[render]\nspp = 16\nseed = 3\nsize = \"144x96\"\n");
        let mut shot = Shot::prepare(&toml::from_str(&text).unwrap(), &mut |_| ()).unwrap();
        assert!(!shot.can_meter_by_exposure(), "{what}: electrons depend on the time");
        shot.radiance = true;
        shot.meter(&watch, &mut |_| ()).unwrap();
        let metered = shot.facts();
        assert!(shot.can_meter_by_exposure(), "{what}");
        shot.prepare_to_meter_by_exposure(&watch, &mut |_| ()).unwrap();
        let mut plane = shot.expose(&watch).unwrap();
        shot.meter_by(&mut plane, &watch, &mut |_| ()).unwrap();
        // Two readings of some 1e5 paths each; spectra of three numbers instead of their own. (Noise that is clipped darkens a reading: that of the exposure, whose
        // cells have more paths, is the brighter one, by 0.05 EV in the middle of this scene.)
        let (found, expected) = (plane.facts.metered_ev100.unwrap(), metered.metered_ev100.unwrap());
        assert!((found - expected).abs() < 0.04, "{what}: EV {found}, the meter reads {expected}");
        let time = |facts: &ExposureFacts| facts.exposure_s * facts.iso_set.max(1.0) / facts.t_number.powi(2);
        let expected = time(&ExposureFacts { iso_set: metered.iso, ..metered.clone() });
        assert!((time(&plane.facts) / expected).log2().abs() < 0.05, "{what}: {:?}", plane.facts);
        assert_eq!(plane.facts.exposure_s, shot.shutter.unwrap());
        // A part of the samples is exposed as the whole is.
        shot.settings.samples = 0..8;
        assert!(!shot.can_meter_by_exposure());
    }
}

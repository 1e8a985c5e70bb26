//! What time does to pictures: blur, lean, flashes, against closed forms and against averages of instants.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::flash::{C, Flash, Sync};
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Focus, Iris, Lens, Pinhole, ThinLens};
use diopter::light::units::Millimeters;
use diopter::scene::builtin::{self, moving_bars};
use diopter::scene::light::{Environment, Modulation};
use diopter::scene::material::{Material, Scattering};
use diopter::scene::motion::{AnimationPlayback, Extrapolation};
use diopter::scene::shape::Quad;
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape, load};
use diopter::sensor::Sensor;
use diopter::shutter::{Direction, Mechanism, Shutter, ShutterTimes};
use diopter::stops::{true_aperture, true_time};
use diopter::{Camera, CameraMotion, Film, Response, Settings, expose};
use glam::{Affine3A, Vec3};
use std::sync::atomic::AtomicBool;

use crate::common::generated;

fn take(scene: &Scene, camera: &Camera, shutter: &Shutter, response: &Response, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, shutter, response, settings, &ExposureFacts::default(), &watch).unwrap()
}

fn pinhole(film: Film, from: Vec3, at: Vec3, focal_mm: f64) -> Camera {
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(focal_mm), 8.0).unwrap());
    Camera { lens, film, motion: CameraMotion::still(look_at(from, at, Vec3::Y).unwrap()) }
}

/// A picture of the moving bars, row by row, 1 where a bar is and 0 where the wall is.
fn bars(film: Film, at_s: f64, shutter: &Shutter, spp: u32) -> Vec<Vec<f64>> {
    let mut scene = Scene::build(builtin::named("moving-bars").unwrap()).unwrap();
    scene.pose(at_s, shutter.total_s());
    let framing = builtin::framing("moving-bars").unwrap();
    // Aimed well above the level bar.
    let shift = Vec3::Y * 1.0;
    let camera = pinhole(film, framing.look_from + shift, framing.look_at + shift, 50.0);
    let plane = take(&scene, &camera, shutter, &Response::luminance(), &Settings::new(spp));
    let values: Vec<f64> = plane.mean.data.iter().map(|v| f64::from(*v)).collect();
    // The medians of wall and bar: extremes are the noise's.
    let mut sorted = values.clone();
    sorted.sort_by(f64::total_cmp);
    let between = 0.5 * (sorted[0] + sorted[sorted.len() - 1]);
    let split = sorted.partition_point(|v| *v < between);
    let (low, high) = (sorted[split / 2], sorted[(split + sorted.len()) / 2]);
    values.chunks(film.columns).map(|row| row.iter().map(|v| (v - low) / (high - low)).collect()).collect()
}

/// Pixels a metre in the plane of the bars' faces.
fn pixels_per_metre(film: &Film) -> f64 {
    0.050 / f64::from(moving_bars::DISTANCE) / (film.width_mm * 1e-3) * film.columns as f64
}

#[test]
fn blur_is_speed_times_magnification_times_time() {
    let film = Film::new(4.0, 0.2, 800, 10);
    let mut widths = Vec::new();
    for time in [0.004, 0.008, 0.016] {
        // Looked at while the right edge crosses the middle.
        let rows = bars(film, 0.5 - 0.5 * time, &Shutter::global(time), 64);
        // A straight ramp of width w has ∫ p (1 − p) = w / 6; there are two of them, the left one out of the picture.
        let width = 6.0 * rows.iter().flatten().map(|p| p * (1.0 - p)).sum::<f64>() / rows.len() as f64;
        let expected = f64::from(moving_bars::SPEED) * time * pixels_per_metre(&film);
        let edges = rows[5].iter().filter(|p| (0.3..0.7).contains(*p)).count() as f64 / (0.4 * expected);
        let width = width / edges.round();
        assert!((width / expected - 1.0).abs() < 0.01, "{time} s: {width} px, expected {expected}");
        widths.push(width);
    }
    assert!((widths[1] / widths[0] - 2.0).abs() < 0.02 && (widths[2] / widths[1] - 2.0).abs() < 0.02, "{widths:?}");
}

/// Where an edge is in each line of a picture, pixels, from the mean of the line.
fn lean(rows: &[Vec<f64>]) -> f64 {
    // The bar is at the left of its edge: the sum is where the edge is.
    let places: Vec<f64> = rows.iter().map(|r| r.iter().sum()).collect();
    let n = places.len() as f64;
    let (mx, my) = ((n - 1.0) / 2.0, places.iter().sum::<f64>() / n);
    let (mut a, mut b) = (0.0, 0.0);
    for (i, p) in places.iter().enumerate() {
        a += (i as f64 - mx) * (p - my);
        b += (i as f64 - mx).powi(2);
    }
    a / b * n
}

#[test]
fn a_moving_bar_leans_by_rows_times_line_time_times_speed() {
    // FLI Kepler: 10.26 µs a row, 2048 rows: 21.01 ms.
    let readout_s: f64 = 2048.0 * 10.26e-6;
    assert!((readout_s - 21.01e-3).abs() < 1e-5);
    // The left edge lies 10 cm to the left of the right one, out of the picture.
    let film = Film::new(2.2, 24.0, 188, 2048);
    let expected = f64::from(moving_bars::SPEED) * readout_s * pixels_per_metre(&film);
    assert!(expected > 40.0);
    for (direction, sign) in [(Direction::Down, 1.0), (Direction::Up, -1.0)] {
        let rolling = Shutter { mechanism: Mechanism::Rolling { reset_s: readout_s, readout_s, direction }, exposure_s: 1e-4 };
        let found = lean(&bars(film, 0.49, &rolling, 16));
        assert!((found - sign * expected).abs() < 1.0, "{direction:?}: {found} px, expected {expected}");
    }
    let upright = lean(&bars(film, 0.5, &Shutter::global(1e-4), 16));
    assert!(upright.abs() < 0.2, "{upright}");
}

/// The mean of a picture and of its blocks, against the mean of as many instants; both with their own noise.
fn against_instants(name: &str, description: Description, camera: &Camera, at_s: f64, time: f64) {
    let mut scene = Scene::build(description).unwrap();
    let (instants, each) = (64, 16);
    let response = Response::luminance();
    scene.pose(at_s, time);
    let blurred =
        take(&scene, camera, &Shutter::global(time), &response, &Settings { truth: false, ..Settings::new(instants * each) });
    let mut sum = vec![0.0f64; blurred.mean.data.len()];
    let mut variance = vec![0.0f64; sum.len()];
    for k in 0..instants {
        scene.pose(at_s + time * (f64::from(k) + 0.5) / f64::from(instants), 0.0);
        let settings = Settings { seed: 1000 + u64::from(k), truth: false, ..Settings::new(each) };
        let plane = take(&scene, camera, &Shutter::global(time), &response, &settings);
        for (i, (m, h)) in plane.mean.data.iter().zip(&plane.half_difference.data).enumerate() {
            sum[i] += f64::from(*m) / f64::from(instants);
            variance[i] += (f64::from(*h) / f64::from(instants)).powi(2);
        }
    }
    let mean = |v: &mut dyn Iterator<Item = f64>| {
        let (n, s) = v.fold((0, 0.0), |a, x| (a.0 + 1, a.1 + x));
        s / f64::from(n)
    };
    let whole = [mean(&mut blurred.mean.data.iter().map(|v| f64::from(*v))), mean(&mut sum.iter().copied())];
    assert!((whole[0] / whole[1] - 1.0).abs() < 0.005, "{name}: {whole:?}");
    // Blocks of 8 × 8 pixels: instants are 1/64 apart, which shows at edges by as much as the way between two of them; the mean square of
    // z over all blocks must stay near 1 all the same.
    let (width, height) = (blurred.mean.width, blurred.mean.height);
    let mut z2 = Vec::new();
    for by in (0..height / 8).map(|b| b * 8) {
        for bx in (0..width / 8).map(|b| b * 8) {
            let pixels = || (by..by + 8).flat_map(move |y| (bx..bx + 8).map(move |x| y * width + x));
            let difference: f64 = pixels().map(|i| f64::from(blurred.mean.data[i]) - sum[i]).sum();
            let noise: f64 = pixels().map(|i| variance[i] + f64::from(blurred.half_difference.data[i]).powi(2)).sum();
            // What the instants leave out: a 64th of the range, a few pixels a block.
            let steps = (whole[1] * 8.0 / 64.0).powi(2);
            z2.push(difference * difference / (noise + steps));
        }
    }
    let worst = z2.iter().copied().fold(0.0, f64::max);
    let mean = z2.iter().sum::<f64>() / z2.len() as f64;
    assert!(mean < 1.3 && worst < 30.0, "{name}: z² {mean} on average, {worst} at worst");
}

fn loop_all(mut d: Description, animation: usize) -> Description {
    d.playing = AnimationPlayback { animations: vec![animation], ending: Extrapolation::Loop, frozen_at_s: None };
    d
}

#[test]
fn a_blurred_propeller_is_the_mean_of_its_instants() {
    let framing = builtin::framing("propeller").unwrap();
    let camera = pinhole(Film::new(24.0, 16.0, 96, 64), framing.look_from, framing.look_at, 50.0);
    against_instants("propeller", builtin::named("propeller").unwrap(), &camera, 0.013, 0.021);
}

/// A file against its instants: its bytes, which of its animations runs, when the shutter opens and for how long.
fn file_against_instants(name: &str, bytes: &[u8], animation: usize, at_s: f64, time: f64) {
    let mut d = loop_all(load::gltf::load(bytes, name, &|_| Err("none".into())).unwrap(), animation);
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    d.environment = Some(Environment::uniform(Vec3::splat(1000.0)));
    let bounds = d.bounds_at(at_s, |_| true);
    let size = bounds.size().length();
    let from = bounds.center() + Vec3::new(0.8, 0.3, 1.0).normalize() * size * 1.3;
    let camera = pinhole(Film::new(24.0, 16.0, 96, 64), from, bounds.center(), 26.0);
    against_instants(name, d, &camera, at_s, time);
}

#[test]
fn blurred_files_are_the_mean_of_their_instants() {
    // Nodes that turn; a skin and a morph target that bend.
    file_against_instants("cart.glb", &generated::cart(), 0, 0.2, 0.4);
    file_against_instants("tail.glb", &generated::tail(), 0, 0.1, 0.2);
}

#[test]
#[ignore = "needs the reference scenes: set DIOPTER_REFERENCE_DATA"]
fn blurred_files_of_others_are_the_mean_of_their_instants() {
    let data = std::env::var("DIOPTER_REFERENCE_DATA").expect("DIOPTER_REFERENCE_DATA names the folder that holds scenes/");
    // A run of the fox's legs (its second is the walk), and the wheels of the truck.
    for (file, animation, at_s, time) in
        [("gltf_Fox/Fox.glb", 2, 0.1, 0.2), ("gltf_CesiumMilkTruck/CesiumMilkTruck.glb", 0, 0.2, 0.4)]
    {
        let path = std::path::Path::new(&data).join("scenes").join(file);
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        file_against_instants(file, &bytes, animation, at_s, time);
    }
}

/// A white wall 2 m before the camera.
fn wall(light: Option<f32>) -> Description {
    let corner = Vec3::new(-5.0, -5.0, -2.0);
    let mut d = Description {
        materials: vec![Material::new("wall", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
        objects: vec![Object::new("wall", Shape::Quad(Quad { corner, edges: [Vec3::X * 10.0, Vec3::Y * 10.0] }), 0)],
        ..Default::default()
    };
    d.environment = light.map(|l| Environment::uniform(Vec3::splat(l)));
    d
}

fn middle(plane: &FocalPlane) -> f64 {
    plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.mean.data.len() as f64
}

#[test]
fn a_flash_exposes_as_its_guide_number_says() {
    let (guide_number, distance) = (20.0, 2.0);
    let mut d = wall(None);
    let flash = Flash { guide_number, power: 1.0, pulse_s: 1e-4, sync: Sync::First, offset_m: Vec3::ZERO };
    flash.add_to_scene(&mut d);
    let (node, material) = Flash::place_in(&d).unwrap();
    let mut scene = Scene::build(d).unwrap();
    // A long exposure: the flash is a ten thousandth of it.
    let shutter = Shutter::global(1.0);
    let ((from, to), all) = flash.moment(&shutter);
    assert!(all);
    scene.modulate(material, Modulation::Pulse { start_s: from, length_s: to - from, energy: 1.0 });
    scene.place_node(node, Affine3A::IDENTITY);
    scene.pose(0.0, 1.0);
    let camera = pinhole(Film::new(0.5, 0.5, 8, 8), Vec3::ZERO, Vec3::NEG_Z, 50.0);
    let shutter_times = ShutterTimes { flash: Some((from, to)) };
    let plane = take(&scene, &camera, &shutter, &Response::luminance(), &Settings { shutter_times, ..Settings::new(256) });
    // Mean luminance over a second: ρ E t / π, E t = C (GN / d)² / 100.
    let expected = 0.5 * C / 100.0 * (guide_number / distance).powi(2) / std::f64::consts::PI;
    assert!((middle(&plane) / expected - 1.0).abs() < 0.01, "{} {expected}", middle(&plane));
}

#[test]
fn too_fast_a_sync_leaves_a_band() {
    let mut d = wall(None);
    let flash = Flash { guide_number: 20.0, power: 1.0, pulse_s: 1e-5, sync: Sync::First, offset_m: Vec3::ZERO };
    flash.add_to_scene(&mut d);
    let (node, material) = Flash::place_in(&d).unwrap();
    let mut scene = Scene::build(d).unwrap();
    let shutter = Shutter { mechanism: Mechanism::FocalPlane { travel_s: 4e-3, direction: Direction::Down }, exposure_s: 1e-3 };
    let ((from, to), all) = flash.moment(&shutter);
    assert!(!all);
    scene.modulate(material, Modulation::Pulse { start_s: from, length_s: to - from, energy: 1.0 });
    scene.place_node(node, Affine3A::IDENTITY);
    scene.pose(0.0, shutter.total_s());
    let camera = pinhole(Film::new(0.5, 0.5, 4, 64), Vec3::ZERO, Vec3::NEG_Z, 50.0);
    let shutter_times = ShutterTimes { flash: Some((from, to)) };
    let plane = take(&scene, &camera, &shutter, &Response::luminance(), &Settings { shutter_times, ..Settings::new(64) });
    let dark = plane.mean.data.chunks(4).filter(|row| row.iter().all(|v| *v == 0.0)).count();
    // The first three quarters have closed when the last part opens.
    assert!((dark as f64 - 48.0).abs() <= 1.0, "{dark} rows of 64");
}

#[test]
fn flicker_makes_bands_of_its_frequency() {
    let mut d = wall(None);
    let direction = Vec3::NEG_Z;
    let kind = diopter::scene::light::PunctualKind::Directional { direction };
    let mut lamp = diopter::scene::light::Punctual::new("lamp", diopter::light::Spectrum::light_from_rgb(Vec3::ONE), kind);
    lamp.modulation = Modulation::Sine { frequency_hz: 100.0, depth: 0.8, phase: 0.0 };
    d.punctual.push(lamp);
    let mut scene = Scene::build(d).unwrap();
    let (readout_s, exposure_s, rows) = (40e-3, 1e-4, 200);
    let mechanism = Mechanism::Rolling { reset_s: readout_s, readout_s, direction: Direction::Down };
    let shutter = Shutter { mechanism, exposure_s };
    scene.pose(0.0, shutter.total_s());
    let camera = pinhole(Film::new(0.2, 0.5, 2, rows), Vec3::ZERO, Vec3::NEG_Z, 50.0);
    let plane = take(&scene, &camera, &shutter, &Response::luminance(), &Settings::new(64));
    let values: Vec<f64> = plane.mean.data.chunks(2).map(|r| f64::from(r[0] + r[1])).collect();
    let mean = values.iter().sum::<f64>() / rows as f64;
    for (row, v) in values.iter().enumerate() {
        let t = row as f64 / rows as f64 * readout_s + 0.5 * exposure_s;
        let expected = 1.0 + 0.8 * (std::f64::consts::TAU * 100.0 * t).sin();
        assert!((v / mean - expected).abs() < 0.02, "row {row}: {} {expected}", v / mean);
    }
    // A whole number of periods shows none.
    let still = Shutter { mechanism, exposure_s: 0.02 };
    scene.pose(0.0, still.total_s());
    let plane = take(&scene, &camera, &still, &Response::luminance(), &Settings::new(256));
    let (low, high) = plane.mean.data.iter().fold((f32::MAX, f32::MIN), |a, v| (a.0.min(*v), a.1.max(*v)));
    assert!(high / low < 1.02, "{low} {high}");
}

#[test]
fn pairs_of_the_lecture_table_expose_alike() {
    let scene = Scene::build(wall(Some(100.0))).unwrap();
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let pairs = [
        (1.4, 1.0 / 500.0),
        (2.0, 1.0 / 250.0),
        (2.8, 1.0 / 125.0),
        (4.0, 1.0 / 60.0),
        (5.6, 1.0 / 30.0),
        (8.0, 1.0 / 15.0),
        (11.0, 1.0 / 8.0),
        (16.0, 1.0 / 4.0),
        (22.0, 1.0 / 2.0),
        (32.0, 1.0),
    ];
    let signals: Vec<f64> = pairs
        .iter()
        .map(|(n, t)| {
            let focus = Focus::Distance(Millimeters(2000.0));
            let lens = Lens::Thin(ThinLens::new(Millimeters(50.0), true_aperture(*n, None), Iris::Round, focus).unwrap());
            let camera = Camera { motion: CameraMotion::still(Affine3A::IDENTITY), lens, film: Film::new(36.0, 24.0, 24, 16) };
            middle(&take(&scene, &camera, &Shutter::global(true_time(*t, None)), &Response::sensor(&sensor), &Settings::new(64)))
        })
        .collect();
    for (signal, pair) in signals.iter().zip(pairs) {
        assert!((signal / signals[0] - 1.0).abs() < 0.005, "{pair:?}: {signal} {}", signals[0]);
    }
}

#[test]
fn a_leaf_shutter_lets_in_its_marked_time_and_more_when_stopped_down() {
    let scene = Scene::build(wall(Some(100.0))).unwrap();
    let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
    let at = |shutter: &Shutter| {
        let lens = diopter::lens::compound::CompoundLens::new(
            std::sync::Arc::new(
                diopter::lens::embedded("double-gauss-50mm")
                    .unwrap_or_else(|| diopter::lens::embedded(diopter::lens::embedded_names().next().unwrap()).unwrap()),
            ),
            &diopter::lens::compound::Setting {
                focal_length: None,
                f_number: None,
                focus: Focus::Distance(Millimeters(2000.0)),
                iris: None,
                film_mm: [4.0, 4.0],
            },
        )
        .unwrap();
        let camera = Camera {
            motion: CameraMotion::still(Affine3A::IDENTITY),
            lens: Lens::Compound(Box::new(lens)),
            film: Film::new(4.0, 4.0, 8, 8),
        };
        middle(&take(&scene, &camera, shutter, &response, &Settings::new(512)))
    };
    let leaf = Shutter { mechanism: Mechanism::Leaf { ramp_s: 1e-3 }, exposure_s: 2e-3 };
    let ratio = at(&leaf) / at(&Shutter::global(2e-3));
    // Blades are taken to lie in the entrance pupil; a real lens's pupil is nearly that.
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

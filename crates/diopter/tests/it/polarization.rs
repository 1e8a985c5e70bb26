//! Polarisers before the lens and sensors that tell polarisation, in whole exposures, against closed forms.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Lens, Pinhole};
use diopter::light::cie;
use diopter::light::units::Millimeters;
use diopter::metering::{Meter, Pattern};
use diopter::scene::daylight::{Daylight, sun};
use diopter::scene::light::Environment;
use diopter::scene::material::{Material, Principled, Scattering};
use diopter::scene::shape::Quad;
use diopter::scene::texture::{Color, Scalar};
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::sensor::{Reading, Sensor};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::Vec3;
use std::sync::atomic::AtomicBool;

const WATER: f32 = 1.333;

/// Black water below an even sky.
fn water() -> Scene {
    let mut principled = Principled::new(Color::rgb(0.0, 0.0, 0.0), WATER);
    principled.roughness = Scalar::Constant(0.0);
    let quad = Quad { corner: Vec3::new(-500.0, 0.0, 500.0), edges: [Vec3::X * 1000.0, Vec3::NEG_Z * 1000.0] };
    let mut scene = Scene::build(Description {
        materials: vec![Material::new("water", Scattering::Principled(Box::new(principled)))],
        objects: vec![Object::new("water", Shape::Quad(quad), 0)],
        environment: Some(Environment::uniform(Vec3::splat(1000.0))),
        ..Default::default()
    })
    .unwrap();
    scene.pose(0.0, 1.0);
    scene
}

fn sky() -> (Scene, Daylight) {
    let day = Daylight::new(sun::Place { elevation: 0.35, azimuth: 0.0, distance_au: 1.0 });
    let mut d = Description::default();
    day.add_to_scene(&mut d);
    let mut scene = Scene::build(d).unwrap();
    scene.pose(0.0, 1.0);
    (scene, day)
}

/// A narrow view.
fn camera(from: Vec3, towards: Vec3, columns: usize) -> Camera {
    let rows = 1;
    let film = Film::new(0.4 * columns as f64, 0.4, columns, rows);
    Camera {
        lens: Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()),
        film,
        motion: CameraMotion::still(look_at(from, from + towards, Vec3::Y).unwrap()),
    }
}

fn exposed(scene: &Scene, camera: &Camera, response: &Response, settings: &Settings) -> FocalPlane {
    let cancel = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &cancel, progress: &|_| () };
    expose(scene, camera, &Shutter::global(0.01), response, settings, &ExposureFacts::default(), &watch).unwrap()
}

fn settings(polarizer: Option<&str>) -> Settings {
    Settings { polarizer: polarizer.map(|p| p.parse().unwrap()), truth: false, ..Settings::new(64) }
}

/// Mean of the first band.
fn level(scene: &Scene, camera: &Camera, polarizer: Option<&str>) -> f64 {
    let plane = exposed(scene, camera, &Response::luminance(), &settings(polarizer));
    plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.mean.data.len() as f64
}

#[test]
fn a_polariser_takes_the_glare_of_water_at_53_degrees() {
    let scene = water();
    let angle = f64::from(WATER).atan() as f32;
    let view = camera(Vec3::Y * 2.0, Vec3::new(0.0, -angle.cos(), -angle.sin()), 1);
    let bare = level(&scene, &view, None);
    let [level_axis, upright] = ["linear:0deg", "linear:90deg"].map(|p| level(&scene, &view, Some(p)));
    // Half a degree of view about Brewster's angle.
    assert!(upright < 1e-3 * bare, "{upright} of {bare}");
    assert!((level_axis / bare - 1.0).abs() < 1e-3, "{level_axis} of {bare}");
    // Malus' law between the two; both kinds alike; and what an extinction ratio leaves.
    for degrees in [20.0f64, 45.0, 70.0, -30.0] {
        for kind in ["linear", "circular"] {
            let seen = level(&scene, &view, Some(&format!("{kind}:{degrees}deg")));
            assert!((seen / bare - degrees.to_radians().cos().powi(2)).abs() < 2e-3, "{kind} {degrees}: {}", seen / bare);
        }
    }
    let leaky = level(&scene, &view, Some("linear:90deg,0.4,100"));
    assert!((leaky / bare - 2.0 * 0.4 / 101.0).abs() < 1e-3, "{}", leaky / bare);
    // Without a filter, and one event, the picture is the same with and without polarisation.
    let polarized = exposed(&scene, &view, &Response::luminance(), &Settings { polarized: true, ..settings(None) });
    assert!((f64::from(polarized.mean.data[0]) / bare - 1.0).abs() < 1e-4);
}

#[test]
fn a_polariser_takes_four_fifths_of_the_sky_at_right_angles_to_the_sun() {
    let (scene, day) = sky();
    let sun = day.direction();
    // In the vertical plane of the sun, 90° from it: the field is level.
    let up = (Vec3::Y - sun * sun.y).normalize();
    let view = camera(Vec3::ZERO, up, 1);
    let [along, across] = ["linear:0deg", "linear:90deg"].map(|p| level(&scene, &view, Some(p)));
    let polarised = (along - across) / (along + across);
    assert!((polarised - 0.8).abs() < 1e-3, "{polarised}");
    assert!(((along + across) / level(&scene, &view, None) - 1.0).abs() < 1e-3);
    // Towards the side, at the height of the antisun's horizon, the field stands across the way to the sun.
    let side = Vec3::Y.cross(sun).normalize() * 0.999 + Vec3::Y * 0.04;
    let view = camera(Vec3::ZERO, side.normalize(), 1);
    let best = (0..36).max_by(|a, b| {
        let at = |k: &i32| level(&scene, &view, Some(&format!("linear:{}deg", 5 * k)));
        at(a).total_cmp(&at(b))
    });
    // Looking west with the sun in the north at 20°: it stands to the right, the field leans from upright by that height.
    let expected = if side.x < 0.0 { 90 + 20 } else { 90 - 20 };
    let found = 5 * best.unwrap();
    assert!((found - expected).abs() <= 5, "{found} {expected}");
}

#[test]
fn four_pixels_tell_degree_and_angle() {
    let sensor = Sensor::named("imx250mzr").unwrap();
    let response = Response::sensor(&sensor);
    let names: Vec<&str> = response.bands.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["P0", "P45", "P90", "P135"]);
    let (scene, day) = sky();
    let sun = day.direction();
    let up = (Vec3::Y - sun * sun.y).normalize();
    let stokes = |polarizer: Option<&str>, towards: Vec3| {
        let plane = exposed(&scene, &camera(Vec3::ZERO, towards, 2), &response, &settings(polarizer));
        let p: Vec<f64> = plane.mean.data[..4].iter().map(|v| f64::from(*v)).collect();
        let c = (sensor.extinction_ratio - 1.0) / (sensor.extinction_ratio + 1.0);
        let (s0, s1, s2) = (0.5 * p.iter().sum::<f64>(), (p[0] - p[2]) / c, (p[1] - p[3]) / c);
        (s0, s1.hypot(s2) / s0, (0.5 * s2.atan2(s1)).to_degrees())
    };
    let (bare, degree, angle) = stokes(None, up);
    assert!((degree - 0.8).abs() < 1e-3 && angle.abs() < 1.0, "{degree} {angle}");
    // Behind a linear filter all is polarised along it, behind a circular one nothing linearly.
    let (behind, degree, angle) = stokes(Some("linear:30deg"), up);
    assert!((degree - 1.0).abs() < 1e-3 && (angle - 30.0).abs() < 0.5, "{degree} {angle}");
    let expected = bare * 0.5 * (1.0 + 0.8 * 60f64.to_radians().cos());
    assert!((behind / expected - 1.0).abs() < 2e-3, "{behind} {expected}");
    let (_, degree, _) = stokes(Some("circular:30deg"), up);
    assert!(degree < 1e-3, "{degree}");
}

#[test]
fn meters_look_through_the_polariser() {
    let scene = {
        let mut scene =
            Scene::build(Description { environment: Some(Environment::uniform(Vec3::splat(1000.0))), ..Default::default() })
                .unwrap();
        scene.pose(0.0, 1.0);
        scene
    };
    let sensor = Sensor::named("ideal").unwrap();
    let mut camera = camera(Vec3::ZERO, Vec3::NEG_Z, 3);
    camera.film.pixel_area_mm2 = sensor.pitch_mm().iter().product();
    let reading = Reading::new(100.0, 1);
    let meter = Meter { sensor: &sensor, reading: &reading, pattern: Pattern::Average, at: [0.5; 2], filter: 1.0 };
    let white = cie::illuminant("D65").unwrap();
    let cancel = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &cancel, progress: &|_| () };
    let read = |p: Option<&str>| meter.read(&scene, &camera, &settings(p), &white, &watch).unwrap().unwrap();
    let stops = read(None) - read(Some("linear:0deg"));
    assert!((stops - 1.0).abs() < 0.03, "{stops}");
}

#[test]
fn threads_and_parts_change_no_bit() {
    let sensor = Sensor::named("imx250mzr").unwrap();
    let response = Response::sensor(&sensor);
    let scene = water();
    let view = camera(Vec3::Y * 2.0, Vec3::new(0.1, -0.5, -0.8), 40);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| exposed(&scene, &view, &response, &settings(Some("circular:20deg"))))
    };
    assert_eq!(run(1).mean.data, run(3).mean.data);
}

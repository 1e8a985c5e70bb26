//! Photographs through real lenses: light counted right in every colour, the promises of the exposure kept.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Iris, Lens, embedded};
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::{Description, Scene, builtin};
use diopter::sensor::Sensor;
use diopter::{Camera, CameraWay, Film, Response, Settings, Shutter, camera::look_at, expose, expose::Watch};
use glam::{DVec2, Vec3};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn take(scene: &Scene, camera: &Camera, settings: &Settings) -> FocalPlane {
    let watch = Watch { cancel: &AtomicBool::new(false), progress: &|_| () };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let shutter = Shutter::global(1.0);
    expose(scene, camera, &shutter, &Response::sensor(&sensor), settings, &ExposureFacts::default(), &watch).unwrap()
}

fn lens(name: &str, f_number: Option<f64>, focus: Focus, iris: Option<Iris>, film: &Film) -> Lens {
    let film_mm = [film.width_mm, film.height_mm];
    let setting = Setting { focal_length: None, f_number, focus, iris, film_mm };
    Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()))
}

fn even(radiance: f32) -> Scene {
    Scene::build(Description { environment: Some(Environment::uniform(Vec3::splat(radiance))), ..Default::default() }).unwrap()
}

fn before(lens: Lens, film: Film) -> Camera {
    Camera { lens, film, way: CameraWay::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()) }
}

/// Irradiance over radiance at a film point and wavelength, by a grid over the last rim and the plain trace.
fn brute_force(lens: &CompoundLens, film: DVec2, nm: f64) -> f64 {
    use diopter::lens::trace::{TracedRay, Way};
    let system = lens.system();
    let n = system.indices(nm);
    let last = system.surfaces.last().unwrap();
    let sag = last.profile.sag(0.0, last.semi_diameter * 0.999_999).unwrap();
    let distance = system.film_z - last.z - sag.max(0.0);
    let (half, side) = (1.35 * last.semi_diameter, 320);
    let cell = (2.0 * half / side as f64).powi(2);
    (0..side * side)
        .map(|i| {
            let p = DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5) * (2.0 * half / side as f64) - half;
            let ray = TracedRay { position: film.extend(system.film_z), direction: (p - film).extend(-distance).normalize() };
            let share = system.transmittance(ray, &n, nm, Way::ToObject).unwrap_or(0.0);
            share * cell * ray.direction.z.powi(4) / (distance * distance)
        })
        .sum()
}

#[test]
fn an_even_field_has_the_light_of_brute_force_in_every_colour_and_place() {
    // Lenses with dispersion, vignetting, blades, another shape in x than in y; pixels in all quarters and at the edge, where
    // colours land in each other's pixels.
    let (columns, rows) = (9, 6);
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let d65 = diopter::light::cie::d65_one_nit();
    let blades = Iris::blades(6, 0.3, 0.2).unwrap();
    for (name, f_number, iris, size) in [
        ("planar-50mm-f1.4", None, None, [36.0, 24.0]),
        ("biotar-50mm-f1.4", Some(2.8), Some(blades), [36.0, 24.0]),
        ("anamorphic-31mm", None, None, [22.0, 16.0]),
        ("kit-zoom-18-55mm", None, None, [22.3, 14.9]),
    ] {
        let film = Film { pixel_area_mm2: 1e-4, ..Film::new(size[0], size[1], columns, rows) };
        let lens = lens(name, f_number, Focus::Infinity, iris, &film);
        let Lens::Compound(compound) = &lens else { unreachable!() };
        let compound = compound.clone();
        let camera = before(lens, film);
        let plane = take(&even(100.0), &camera, &Settings { truth: false, ..Settings::new(4096) });
        for (column, row) in [(4, 3), (0, 0), (7, 1)] {
            // The mean over a pixel: nine points of it (Simpson), at wavelengths that carry each band.
            let at = |u: f64, v: f64| {
                DVec2::new(
                    (0.5 - (column as f64 + u) / columns as f64) * size[0],
                    ((row as f64 + v) / rows as f64 - 0.5) * size[1],
                )
            };
            let mean = |nm: f64| {
                let weights = [(0.0, 1.0), (0.5, 4.0), (1.0, 1.0)];
                weights
                    .iter()
                    .flat_map(|(u, a)| weights.iter().map(move |(v, b)| (u, v, a * b)))
                    .map(|(u, v, w)| w * brute_force(&compound, at(*u, *v), nm))
                    .sum::<f64>()
                    / 36.0
            };
            let lines = [420.0, 500.0, 580.0, 680.0];
            let each = lines.map(mean);
            let shares = |nm: f64| {
                let i = lines.windows(2).position(|w| nm < w[1]).unwrap_or(2);
                let t = ((nm - lines[i]) / (lines[i + 1] - lines[i])).clamp(-0.5, 1.5);
                each[i] + (each[i + 1] - each[i]) * t
            };
            for (band, response) in sensor.band_responses().iter().enumerate() {
                let expected: f64 = (380..780)
                    .map(|nm| nm as f32 + 0.5)
                    .map(|nm| (response.at(nm) * d65.at(nm)) as f64 * shares(nm as f64) * 100.0 * 1e-10)
                    .sum();
                let got = plane.mean.pixel(column, row)[band] as f64;
                println!("{name} {column},{row} band {band}: {got:.5e} {expected:.5e} {:+.2} %", (got / expected - 1.0) * 100.0);
                // Four wavelengths stand for all, a grid for the pupil's edge: half a per cent in the middle, one at the rim.
                assert!((got / expected - 1.0).abs() < 0.012, "{name} {column},{row} band {band}: {got} {expected}");
            }
        }
    }
}

#[test]
fn half_the_radius_is_a_quarter_of_the_light() {
    let film = Film { pixel_area_mm2: 1e-4, ..Film::new(0.4, 0.4, 2, 2) };
    let at = |n: f64| {
        let camera = before(lens("double-gauss-50mm", Some(n), Focus::Infinity, None, &film), film);
        take(&even(100.0), &camera, &Settings { truth: false, ..Settings::new(1024) }).mean.pixel(0, 0)[1] as f64
    };
    let (open, half) = (at(2.8), at(5.6));
    // Of sin² instead of tan² 0.6 % is left at f/2.8.
    assert!((4.0 * half / open - 1.0).abs() < 0.01, "{}", 4.0 * half / open);
}

#[test]
fn threads_and_parts_do_not_matter_where_colours_part() {
    let description = builtin::named("cornell").unwrap();
    let place = description.cameras[0].world_from_camera;
    let scene = Scene::build(description).unwrap();
    let film = Film::new(36.0, 24.0, 48, 32);
    // A simple lens: blue and red land pixels apart.
    let lens = lens("landscape-10mm", None, Focus::Distance(Millimeters(1000.0)), None, &film);
    let camera = Camera { lens, film, way: CameraWay::still(place) };
    let with = |threads: usize, samples: std::ops::Range<u32>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| take(&scene, &camera, &Settings { samples, ..Settings::new(8) }))
    };
    let whole = with(1, 0..8);
    assert_eq!(whole, with(2, 0..8));
    assert_eq!(whole, with(7, 0..8));
    let merged = FocalPlane::merge(&[with(2, 0..4), with(2, 4..8)]).unwrap();
    for (a, b) in whole.mean.data.iter().zip(&merged.mean.data) {
        assert!((a - b).abs() <= 1e-5 * a.abs().max(1e-3 * whole.mean.data[0].abs().max(1e-12)), "{a} {b}");
    }
}

#[test]
fn the_distance_asked_for_is_the_sharp_one() {
    // Rays of an axial film point meet on the axis at the distance from the entrance pupil that focus names.
    let film = Film::new(36.0, 24.0, 3, 2);
    for (name, metres, within) in
        [("double-gauss-50mm", 2.0, 0.02), ("kit-zoom-18-55mm", 0.6, 0.03), ("macro-100mm-f2.8", 0.5, 0.01)]
    {
        let lens = lens(name, Some(8.0), Focus::Distance(Millimeters(metres * 1000.0)), None, &film);
        let Lens::Compound(lens) = &lens else { unreachable!() };
        let (mut sum, mut weight) = (0.0, 0.0);
        for i in 0..64 {
            let Ok(ray) = lens.ray(DVec2::ZERO, [(i as f32 + 0.5) / 64.0, 0.9], 560.0) else { continue };
            // Where it comes nearest to the axis.
            let (p, d) = (ray.origin_mm.truncate(), ray.direction.truncate());
            let t = -p.dot(d) / d.length_squared();
            sum += -(ray.origin_mm.z + t * ray.direction.z);
            weight += 1.0;
        }
        let found = sum / weight / 1000.0;
        println!("{name}: asked {metres} m, found {found:.4} m");
        assert!((found / metres - 1.0).abs() < within, "{name}: {found}");
    }
}

#[test]
fn dispersion_costs_no_colour_noise() {
    // The same lens with its glasses and with one index for all colours: the error of the ratio of two bands must be the same.
    // Ending the other wavelengths of a path at the lens would make its variance four times as large.
    use diopter::lens::glass::{D_NM, Glass, GlassKind};
    let description = builtin::named("cornell").unwrap();
    let place = description.cameras[0].world_from_camera;
    let scene = Scene::build(description).unwrap();
    let film = Film::new(24.0, 24.0, 40, 40);
    let real = embedded("planar-50mm-f1.4").unwrap();
    let mut flat = real.clone();
    for s in flat.surfaces.iter_mut().filter(|s| s.glass.kind != GlassKind::Air) {
        s.glass = Glass::constant(s.glass.index(D_NM)).unwrap();
    }
    let noise = |p: diopter::lens::Prescription| {
        let focus = Focus::Distance(Millimeters(1000.0));
        let setting = Setting { focal_length: None, f_number: Some(2.8), focus, iris: None, film_mm: [24.0, 24.0] };
        let lens = Lens::Compound(Box::new(CompoundLens::new(Arc::new(p), &setting).unwrap()));
        let camera = Camera { lens, film, way: CameraWay::still(place) };
        let plane = take(&scene, &camera, &Settings { truth: false, ..Settings::new(64) });
        let (mut sum, mut count) = (0.0, 0.0);
        for (mean, half) in plane.mean.data.chunks_exact(3).zip(plane.half_difference.data.chunks_exact(3)) {
            if mean.iter().all(|m| *m > 0.0) {
                let relative = |b: usize| (half[b] / mean[b]) as f64;
                sum += (relative(0) - relative(1)).powi(2) + (relative(2) - relative(1)).powi(2);
                count += 1.0;
            }
        }
        sum / count
    };
    let (with, without) = (noise(real), noise(flat));
    println!("variance of band ratios: {with:.3e} with dispersion, {without:.3e} without");
    assert!(with < 1.3 * without, "{with} {without}");
}

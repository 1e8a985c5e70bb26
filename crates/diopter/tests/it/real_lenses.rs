//! Photographs through real lenses: light counted right in every colour, the promises of the exposure kept.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Iris, Lens, embedded};
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::{Description, Scene, builtin};
use diopter::sensor::Sensor;
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter};
use glam::{DVec2, Vec3};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn take(scene: &Scene, camera: &Camera, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
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
    Camera { lens, film, motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()) }
}

/// Irradiance over radiance at a film point and wavelength, by a grid over the last rim and the plain trace.
fn brute_force(lens: &CompoundLens, film: DVec2, nm: f64) -> f64 {
    use diopter::lens::ray::{TraceDirection, TracedRay};
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
            let fraction = system.transmittance(ray, &n, nm, TraceDirection::ToObject).unwrap_or(0.0);
            fraction * cell * ray.direction.z.powi(4) / (distance * distance)
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
            let fractions = |nm: f64| {
                let i = lines.windows(2).position(|w| nm < w[1]).unwrap_or(2);
                let t = ((nm - lines[i]) / (lines[i + 1] - lines[i])).clamp(-0.5, 1.5);
                each[i] + (each[i + 1] - each[i]) * t
            };
            for (band, response) in sensor.band_responses().iter().enumerate() {
                let expected: f64 = (380..780)
                    .map(|nm| nm as f32 + 0.5)
                    .map(|nm| (response.at(nm) * d65.at(nm)) as f64 * fractions(nm as f64) * 100.0 * 1e-10)
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
    let camera = Camera { lens, film, motion: CameraMotion::still(place) };
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
fn interrupted_exposures_go_on_where_colours_land_in_other_tiles() {
    use diopter::expose::Exposure;
    let film = Film::new(36.0, 24.0, 144, 128);
    let camera = before(lens("landscape-10mm", None, Focus::Distance(Millimeters(1000.0)), None, &film), film);
    let (scene, shutter, facts) = (even(100.0), Shutter::global(1.0), ExposureFacts::default());
    let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
    let settings = Settings { samples: 127..130, truth: false, ..Settings::new(256) };
    let exposure =
        Exposure { scene: &scene, camera: &camera, shutter: &shutter, response: &response, settings: &settings, facts: &facts };
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let with = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut kept = Vec::new();
    let whole = with(1)
        .install(|| {
            exposure.run(
                &watch,
                None,
                Some(&mut |sums| {
                    kept.push(sums.clone());
                    ControlFlow::Continue(())
                }),
            )
        })
        .unwrap()
        .plane;
    assert!(kept.len() >= 3 && whole.mean.data.iter().any(|v| *v > 0.0));
    for sums in kept {
        assert!(with(2).install(|| exposure.run(&watch, Some(sums), None)).unwrap().plane == whole);
    }
}

#[test]
fn exposures_on_the_disk_make_the_files_of_exposures_in_memory() {
    use diopter::checkpoint;
    use diopter::expose::Exposure;
    use diopter::image::{exr, focal_plane::FocalPlaneSource};
    use diopter::lens::ThinLens;
    use diopter::row_store::PagedRows;
    use std::io::Cursor;

    let description = builtin::named("cornell").unwrap();
    let place = description.cameras[0].world_from_camera;
    let scene = Scene::build(description).unwrap();
    // Eight strips of rows, of which four are in memory; blue and red of a simple lens land outside the margins of tiles.
    let film = || Film::new(36.0, 24.0, 144, 128);
    let focus = Focus::Distance(Millimeters(1000.0));
    let lenses = [
        Lens::Thin(ThinLens::new(Millimeters(35.0), 2.0, Iris::Round, focus).unwrap()),
        lens("planar-50mm-f1.4", None, focus, None, &film()),
        lens("landscape-10mm", None, focus, None, &film()),
    ];
    let (shutter, facts, folder) = (Shutter::global(1.0), ExposureFacts::default(), std::env::temp_dir());
    let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
    // Two passes.
    let settings = Settings { samples: 127..130, ..Settings::new(256) };
    let stop = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for lens in lenses {
        let camera = Camera { lens, film: film(), motion: CameraMotion::still(place) };
        let exposure = Exposure {
            scene: &scene,
            camera: &camera,
            shutter: &shutter,
            response: &response,
            settings: &settings,
            facts: &facts,
        };
        let whole = exposure.run(&watch, None, None).unwrap().plane;
        assert!(whole.mean.data.iter().any(|v| *v > 0.0) && whole.truth.depth().data.iter().any(|d| d.is_finite()));
        let mut checkpoints = Vec::new();
        let paged = one_thread.install(|| {
            let mut keep = |sums: &diopter::expose::Sums<PagedRows>| {
                let mut bytes = Vec::new();
                checkpoint::write(sums, 1, &mut bytes).unwrap();
                checkpoints.push(bytes);
                ControlFlow::Continue(())
            };
            exposure.run_paged(&watch, None, Some(&mut keep), 0, &folder).unwrap()
        });
        assert!(!paged.stopped);
        let (mut plain, mut strips) = (Cursor::new(Vec::new()), Cursor::new(Vec::new()));
        exr::write_focal_plane(&whole, &mut plain).unwrap();
        exr::write_strips(&mut paged.rows(&scene), &mut strips).unwrap();
        assert!(plain.into_inner() == strips.into_inner());

        // Within the first pass and behind it.
        assert!(checkpoints.len() >= 3, "{}", checkpoints.len());
        for bytes in &checkpoints[..2] {
            let size = [144, 128, response.bands.len()];
            let rows = |size: [usize; 3]| PagedRows::new(size, 0, &folder);
            let start = checkpoint::read_into(&mut bytes.as_slice(), 1, size, rows).unwrap();
            let again = exposure.run_paged(&watch, Some(start), None, 0, &folder).unwrap();
            assert!(again.rows(&scene).next_rows(128).unwrap() == whole);
            // A checkpoint of what was larger than memory goes on in memory, too.
            let start = checkpoint::read(&mut bytes.as_slice(), 1, size).unwrap();
            assert!(exposure.run(&watch, Some(start), None).unwrap().plane == whole);
        }
    }
}

#[test]
fn more_than_four_bands_land_where_four_do() {
    let film = Film::new(36.0, 24.0, 24, 16);
    // Blue and red land pixels apart, some far from their tile.
    let camera = before(lens("landscape-10mm", None, Focus::Distance(Millimeters(1000.0)), None, &film), film);
    let scene = even(100.0);
    let with = |copies: usize| {
        let one = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
        let response = Response {
            bands: (0..copies).flat_map(|_| one.bands.clone()).collect(),
            curves: (0..copies).flat_map(|_| one.curves.clone()).collect(),
            analyzers: Vec::new(),
        };
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
        let (shutter, settings) = (Shutter::global(1.0), Settings { truth: false, ..Settings::new(8) });
        expose(&scene, &camera, &shutter, &response, &settings, &ExposureFacts::default(), &watch).unwrap()
    };
    let (once, twice) = (with(1), with(2));
    for (a, b) in once.mean.data.chunks(3).zip(twice.mean.data.chunks(6)) {
        assert_eq!(b[..3], b[3..]);
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-3 * a.abs().max(1.0)), "{a:?} {b:?}");
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
        let camera = Camera { lens, film, motion: CameraMotion::still(place) };
        // Each pixel by its own paths: where others lend it light, both are less noisy, and more so without dispersion.
        let settings = Settings { truth: false, integrator: diopter::Integrator::Path, ..Settings::new(64) };
        let plane = take(&scene, &camera, &settings);
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

/// Glass F11 over wavelength: n_d 1.6206, V_d 36.4; Cauchy's two terms through F and C (Schott catalogue of 1967).
fn f11() -> diopter::light::Spectrum {
    let (b, a) = {
        let (nd, vd) = (1.6206, 36.37);
        let [f, d, c] = [486.1f32, 587.6, 656.3].map(|nm| (nm * 1e-3).powi(-2));
        let b = (nd - 1.0) / vd / (f - c);
        (b, nd - b * d)
    };
    let at = |i: usize| a + b * ((380.0 + i as f32) * 1e-3).powi(-2);
    diopter::light::Spectrum::Table(diopter::light::spectrum::Table::new(380.0, 1.0, (0..=400).map(at).collect()))
}

/// An even field of 1 with a ball of glass that fills the view.
fn ball_in_a_furnace(roughness: f32) -> Scene {
    use diopter::scene::material::{Interior, Material, Principled, Scattering};
    use diopter::scene::shape::Sphere;
    use diopter::scene::texture::Scalar;
    let mut glass = Principled::glass(1.6206);
    glass.dispersion = Some(f11());
    glass.roughness = Scalar::Constant(roughness);
    let material = Material {
        interior: Interior::Body { medium: None, priority: None },
        ..Material::new("F11", Scattering::Principled(Box::new(glass)))
    };
    let ball = Sphere { center: Vec3::new(0.0, 0.0, -3.0), radius: 2.5 };
    Scene::build(Description {
        environment: Some(Environment::uniform(Vec3::splat(1.0))),
        materials: vec![material],
        objects: vec![diopter::scene::Object::new("ball", diopter::scene::Shape::Sphere(ball), 0)],
        ..Default::default()
    })
    .unwrap()
}

#[test]
fn a_furnace_hides_bodies_with_dispersion_behind_every_kind_of_lens() {
    // Lossless glass in an even field is not seen. Where the ball disperses, the path goes on with its hero alone; behind a lens that
    // disperses too, each of the four wavelengths would have drawn the ray with a density of its own.
    let film = Film { pixel_area_mm2: 1e-4, ..Film::new(24.0, 16.0, 3, 2) };
    let thin = diopter::lens::ThinLens::new(Millimeters(50.0), 1.4, Iris::Round, Focus::Infinity).unwrap();
    let real = |name: &str| lens(name, None, Focus::Infinity, None, &film);
    let smooth = ball_in_a_furnace(0.0);
    for (name, lens, scene, spp) in [
        ("thin", Lens::Thin(thin), &smooth, 1 << 16),
        ("planar", real("planar-50mm-f1.4"), &smooth, 1 << 16),
        ("mirror", real("reflex-500mm-f8"), &smooth, 1 << 17),
        ("anamorphic", real("anamorphic-31mm"), &smooth, 1 << 16),
        ("planar, rough ball", real("planar-50mm-f1.4"), &ball_in_a_furnace(0.3), 1 << 16),
    ] {
        let camera = before(lens, film);
        let settings = Settings { truth: false, ..Settings::new(spp) };
        let (seen, even) = (take(scene, &camera, &settings), take(&even(1.0), &camera, &settings));
        for band in 0..3 {
            let sum = |plane: &FocalPlane| plane.mean.data.iter().skip(band).step_by(3).map(|v| f64::from(*v)).sum::<f64>();
            let variance = |plane: &FocalPlane| {
                plane.half_difference.data.iter().skip(band).step_by(3).map(|v| f64::from(*v).powi(2)).sum::<f64>()
            };
            let ratio = sum(&seen) / sum(&even) - 1.0;
            let deviation = (variance(&seen) + variance(&even)).sqrt() / sum(&even);
            assert!(deviation < 1.5e-3, "{name}, band {band}: {deviation} says nothing");
            // Rough glass: tables of 32 nodes.
            let exact = if name.contains("rough") { 0.01 } else { 0.001 };
            assert!(ratio.abs() < exact + 3.0 * deviation, "{name}, band {band}: {ratio} ± {deviation}");
        }
    }
}

#[test]
fn an_even_field_has_its_radiance_behind_every_lens() {
    let scene = even(1000.0);
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    for (name, f_number, size) in [
        ("planar-50mm-f1.4", None, [36.0, 24.0]),
        ("planar-50mm-f1.4", Some(8.0), [36.0, 24.0]),
        // A film larger than the image circle.
        ("kit-zoom-18-55mm", None, [48.0, 36.0]),
        ("compact-6mm-f1.9", None, [24.0, 16.0]),
        ("fisheye-10mm", None, [36.0, 24.0]),
        ("anamorphic-31mm", None, [22.0, 16.0]),
        ("reflex-500mm-f8", None, [36.0, 24.0]),
    ] {
        let film = Film::new(size[0], size[1], 24, 16);
        let camera = before(lens(name, f_number, Focus::Infinity, None, &film), film);
        let settings = Settings { truth: false, ..Settings::new(256) };
        let facts = ExposureFacts::default();
        let plane = expose(&scene, &camera, &Shutter::global(0.01), &Response::luminance(), &settings, &facts, &watch).unwrap();
        let mut lit = 0;
        for (i, luminance) in plane.mean.data.iter().enumerate() {
            let (column, row) = (i % 24, i / 24);
            // Where the circle ends within a pixel, little passes: never more light than there is.
            assert!(*luminance < 1003.0, "{name} at {column}, {row}: {luminance} cd/m²");
            lit += u32::from((*luminance - 1000.0).abs() < 3.0);
        }
        let middle = plane.mean.pixel(11, 7)[0];
        assert!((middle - 1000.0).abs() < 3.0 || name.starts_with("reflex"), "{name}: {middle} cd/m² in the middle");
        let other = plane.mean.data.iter().filter(|v| **v > 0.0 && (**v - 1000.0).abs() >= 3.0).count();
        // The rim of a circle of so many cells, 2 √(π lit).
        assert!(lit > 20 && other as f64 <= 4.0 * f64::from(lit).sqrt(), "{name}: {lit} lit, {other} partly");
        let mean = diopter::metering::mean_luminance(&scene, &camera, &settings, &watch).unwrap();
        assert!((mean / 1000.0 - 1.0).abs() < 0.01, "{name}: {mean} cd/m² on the mean");
    }
}

#[test]
fn half_a_pupil_gathers_half_the_electrons() {
    use diopter::expose::Half;
    let film = Film { pixel_area_mm2: 1e-4, ..Film::new(2.0, 2.0, 4, 4) };
    let thin = diopter::lens::ThinLens::new(Millimeters(50.0), 2.0, Iris::Round, Focus::Infinity).unwrap();
    for lens in [Lens::Thin(thin), lens("planar-50mm-f1.4", Some(2.8), Focus::Infinity, None, &film)] {
        let camera = before(lens, film);
        let light = |half: Option<Half>, redraw: bool| {
            let settings = Settings { truth: false, half, redraw, ..Settings::new(1024) };
            take(&even(100.0), &camera, &settings).mean.data.iter().map(|v| f64::from(*v)).sum::<f64>()
        };
        for redraw in [false, true] {
            let whole = light(None, redraw);
            for half in [Half::Left, Half::Right] {
                let fraction = light(Some(half), redraw) / whole;
                // Near the axis a round pupil is cut in two equal parts; stratified points cut it to some thousandths.
                assert!((fraction - 0.5).abs() < 0.005, "{half:?}, redraw {redraw}: {fraction}");
            }
        }
    }
}

/// An even sky, black to the right of where tan = 0.205.
fn edge() -> Scene {
    use diopter::scene::material::{Material, Scattering};
    let quad = diopter::scene::shape::Quad {
        corner: Vec3::new(20.5, -50.0, -100.0),
        edges: [Vec3::new(80.0, 0.0, 0.0), Vec3::new(0.0, 100.0, 0.0)],
    };
    Scene::build(Description {
        environment: Some(Environment::uniform(Vec3::splat(100.0))),
        materials: vec![Material::new("black", Scattering::Black)],
        objects: vec![diopter::scene::Object::new("edge", diopter::scene::Shape::Quad(quad), 0)],
        ..Default::default()
    })
    .unwrap()
}

#[test]
fn gaps_between_pixels_collect_no_wavelength() {
    // Pixels whose middle half collects, beside a film of pixels of a quarter of the pitch, of which the middle two are added.
    let (columns, width) = (12, 0.12);
    let fine = Film { pixel_area_mm2: 1e-6, ..Film::new(width, 0.02, 4 * columns, 1) };
    let fine = fine.piece([0.0, 0.0, 1.0, 1.0], 4 * columns, 1);
    let shifted = |film: Film| Film { center_mm: [2.0, 0.0], ..film };
    let (fine, pitch) = (shifted(fine), width / columns as f64);
    let coarse = Film { gap_mm: [0.5 * pitch, 0.0], ..shifted(Film::new(width, 0.02, columns, 1)) };
    let [fine, coarse] = [fine, coarse].map(|f| Film { pixel_area_mm2: 1e-6, ..f });
    // A simple lens, 2 mm off its axis, and a black edge.
    let lens = |film: &Film| {
        let film = Film { width_mm: 5.0, height_mm: 5.0, ..*film };
        lens("landscape-10mm", None, Focus::Infinity, None, &film)
    };
    let scene = edge();
    let take = |film: Film, spp| take(&scene, &before(lens(&film), film), &Settings { truth: false, ..Settings::new(spp) });
    let (a, b) = (take(coarse, 1 << 14), take(fine, 1 << 14));
    let mut seen = 0;
    for column in 0..columns {
        for band in 0..3 {
            let value = |p: &FocalPlane, c: usize| f64::from(p.mean.pixel(c, 0)[band]);
            let error = |p: &FocalPlane, c: usize| f64::from(p.half_difference.pixel(c, 0)[band]).powi(2);
            let expected = 0.5 * (value(&b, 4 * column + 1) + value(&b, 4 * column + 2));
            let sigma = (error(&a, column) + 0.25 * (error(&b, 4 * column + 1) + error(&b, 4 * column + 2))).sqrt();
            let (got, most) = (value(&a, column), value(&b, 0).max(value(&b, 4 * columns - 1)));
            assert!((got - expected).abs() < 0.004 * most + 4.0 * sigma, "{column}, band {band}: {got} {expected} ± {sigma}");
            seen += usize::from(expected > 0.1 * most && expected < 0.9 * most);
        }
    }
    assert!(seen > 2, "the edge is not in the picture: {seen}");
}

#[test]
fn radiance_counts_all_of_the_pupil_alike() {
    // A scene whose radiance differs over the pupil: a step edge far out of focus behind a lens with an obstruction, and in the vignetted corner of a
    // fast one. The truth: the mean over the rays that pass, of an even grid over the pixel and the pupil.
    let facts = ExposureFacts::default();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    for (name, middle, edge_x) in [("reflex-500mm-f8", [0.0, 0.0], 0.0085), ("planar-50mm-f1.4", [17.0, 11.0], 0.346)] {
        // One pixel; the scene's half plane is 1 m away where the lens is focused at infinity.
        let film = Film { center_mm: middle, ..Film::new(0.05, 0.05, 1, 1) };
        let whole = Film::new(36.0, 24.0, 1, 1);
        let lens = lens(name, None, Focus::Infinity, None, &whole);
        let corner = Vec3::new(edge_x, -5.0, -1.0);
        let half_plane = diopter::scene::shape::Quad { corner, edges: [Vec3::X * 10.0, Vec3::Y * 10.0] };
        let scene = Scene::build(Description {
            environment: Some(Environment::uniform(Vec3::splat(1000.0))),
            materials: vec![diopter::scene::material::Material::new("black", diopter::scene::material::Scattering::Black)],
            objects: vec![diopter::scene::Object::new("edge", diopter::scene::Shape::Quad(half_plane), 0)],
            ..Default::default()
        })
        .unwrap();
        let n = 48;
        let at = |i: usize| ((i % n) as f64 + 0.5) / n as f64;
        let (mut lit, mut passed) = (0.0, 0.0);
        for i in 0..n * n {
            for j in 0..4 {
                let place = [0.25 + 0.5 * (j % 2) as f64, 0.25 + 0.5 * (j / 2) as f64];
                let point = DVec2::new((0.5 - place[0]) * 0.05, (place[1] - 0.5) * 0.05) - DVec2::from_array(middle);
                let Ok(ray) = lens.ray(point, [at(i) as f32, at(i / n) as f32]) else { continue };
                let t = (-1000.0 - ray.origin_mm.z) / ray.direction.z;
                passed += 1.0;
                lit += f64::from(ray.origin_mm.x + ray.direction.x * t < 1000.0 * f64::from(edge_x));
            }
        }
        let expected = 1000.0 * lit / passed;
        let camera = before(lens, film);
        let settings = Settings { truth: false, ..Settings::new(1 << 16) };
        let plane = expose(&scene, &camera, &Shutter::global(1.0), &Response::luminance(), &settings, &facts, &watch).unwrap();
        let found = f64::from(plane.mean.data[0]);
        println!("{name}: {found} {expected}");
        assert!((200.0..800.0).contains(&expected), "{name}: the edge does not cut the pupil: {expected}");
        assert!((found / expected - 1.0).abs() < 0.02, "{name}: {found} {expected}");
    }
}

#[test]
fn an_even_field_is_not_re_weighted_however_bright_it_is() {
    // Each of the four wavelengths of a path lands where its colour does: all are in doubt by their brightness, and support one another.
    use diopter::expose::Fireflies;
    let film = Film::new(36.0, 24.0, 24, 16);
    let camera = before(lens("double-gauss-50mm", Some(2.0), Focus::Infinity, None, &film), film);
    let scene = even(1.0);
    let settings = Settings { truth: false, ..Settings::new(16) };
    let kept = take(&scene, &camera, &settings);
    let fireflies = Fireflies::Reweight { white_e: 1e-9 };
    let same = take(&scene, &camera, &Settings { fireflies, ..settings });
    assert_eq!((same.mean, same.half_difference, same.facts.fireflies_removed), (kept.mean, kept.half_difference, Some(0.0)));
}

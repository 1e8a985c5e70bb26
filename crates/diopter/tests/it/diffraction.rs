//! Diffraction in exposures: closed forms, the light of lamps, and what exposures promise.

use diopter::camera::look_at;
use diopter::expose::{Diffraction, Exposure, ProgressReporter};
use diopter::image::focal_plane::{Band, BandUnit};
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Focus, Iris, Lens, Pinhole, ThinLens};
use diopter::light::Spectrum;
use diopter::light::spectrum::Table;
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::material::Material;
use diopter::scene::shape::Quad;
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

const ON: Diffraction = Diffraction::On { white_e: None };

/// Electrons of narrow bands, 10 nm wide.
fn narrow(nm: &[f32]) -> Response {
    let curve =
        |middle: f32| Table::new(380.0, 1.0, (0..=401).map(|i| f32::from((380.0 + i as f32 - middle).abs() <= 5.0)).collect());
    Response {
        bands: nm.iter().map(|nm| Band { name: format!("{nm}"), unit: BandUnit::Electrons }).collect(),
        curves: nm.iter().map(|nm| curve(*nm)).collect(),
        analyzers: Vec::new(),
    }
}

fn camera(n: f64, iris: Iris, film: Film) -> Camera {
    let lens = Lens::Thin(ThinLens::new(Millimeters(50.0), n, iris, Focus::Infinity).unwrap());
    Camera { lens, film, motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()) }
}

/// A lamp far away whose image is a square of so many mm in the middle of the picture.
fn lamp(side_mm: f32, luminance: f32, sky: f32) -> Scene {
    let distance = 1000.0;
    let side = side_mm / 50.0 * distance;
    let quad = Quad { corner: Vec3::new(-0.5 * side, -0.5 * side, -distance), edges: [Vec3::X * side, Vec3::Y * side] };
    Scene::build(Description {
        materials: vec![Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::splat(luminance)))],
        objects: vec![Object::new("lamp", Shape::Quad(quad), 0)],
        environment: (sky > 0.0).then(|| Environment::uniform(Vec3::splat(sky))),
        ..Default::default()
    })
    .unwrap()
}

fn take(scene: &Scene, camera: &Camera, response: &Response, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, &Shutter::global(1.0), response, settings, &ExposureFacts::default(), &watch).unwrap()
}

fn light(plane: &FocalPlane, band: usize) -> f64 {
    plane.mean.data.iter().skip(band).step_by(plane.bands.len()).map(|v| f64::from(*v)).sum()
}

fn brightest(plane: &FocalPlane) -> f64 {
    f64::from(plane.mean.data.iter().copied().fold(0.0, f32::max))
}

fn settings(spp: u32, diffraction: Diffraction) -> Settings {
    Settings { truth: false, diffraction, ..Settings::new(spp) }
}

#[test]
fn an_edge_has_the_spread_of_the_airy_pattern_in_the_photograph() {
    // ESF(x) = ½ + (1/π) ∫ MTF(ν) sin(2πνx)/ν dν up to the cut-off 1/(λN), over pixels of half a λN at 550 nm. 64 rows of 256 samples a column: 0.004 at the
    // edge; 0.2 % of the light of the pattern on either side lies beyond its table.
    use diopter::lens::analysis::airy_mtf;
    for n in [8.0, 16.0, 22.0] {
        let (side, bands) = (64usize, [450.0f32, 550.0, 650.0]);
        let pixel = 0.5 * 550e-6 * n;
        let size = pixel * side as f64;
        let camera = camera(n, Iris::Round, Film::new(size, size, side, side));
        // Bright to one side of the middle of the picture.
        let (distance, half) = (1000.0f32, 100.0f32);
        let quad = Quad { corner: Vec3::new(-half, -half, -distance), edges: [Vec3::X * half, Vec3::Y * (2.0 * half)] };
        let scene = Scene::build(Description {
            materials: vec![Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::splat(1e3)))],
            objects: vec![Object::new("lamp", Shape::Quad(quad), 0)],
            ..Default::default()
        })
        .unwrap();
        let plane = take(&scene, &camera, &narrow(&bands), &settings(256, ON));
        let bright = take(&scene, &camera, &narrow(&bands), &settings(256, Diffraction::Off));
        for (band, nm) in bands.iter().enumerate() {
            let column = |plane: &FocalPlane, x: usize| -> f64 {
                (0..side).map(|y| f64::from(plane.mean.data[(y * side + x) * bands.len() + band])).sum()
            };
            let full = column(&bright, 4);
            assert!(full > 0.0 && column(&bright, side - 5) == 0.0);
            let cutoff = 1e6 / (f64::from(*nm) * n);
            let expected = |x: f64| {
                let steps = 2000u32;
                let term = |k: usize| {
                    let f = cutoff * (k as f64 + 0.5) / f64::from(steps);
                    let aperture = (PI * f * pixel).sin() / (PI * f * pixel);
                    airy_mtf(f, f64::from(*nm), n) * aperture * (2.0 * PI * f * x).sin() / f
                };
                0.5 - (0..steps as usize).map(term).sum::<f64>() * cutoff / f64::from(steps) / PI
            };
            for x in 12..side - 12 {
                let place = (x as f64 + 0.5 - 0.5 * side as f64) * pixel;
                let (found, exact) = (column(&plane, x) / full, expected(place));
                assert!((found - exact).abs() < 0.012, "f/{n} {nm} nm, column {x}: {found} {exact}");
            }
        }
    }
}

#[test]
fn an_even_field_stays_even_and_as_bright_as_it_was() {
    let scene = Scene::build(Description { environment: Some(Environment::uniform(Vec3::ONE)), ..Default::default() }).unwrap();
    let camera = camera(16.0, Iris::blades(7, 0.2, 0.0).unwrap(), Film::new(0.2, 0.2, 40, 40));
    let response = narrow(&[450.0, 550.0, 650.0]);
    let [on, off] = [ON, Diffraction::Off].map(|d| take(&scene, &camera, &response, &settings(64, d)));
    for band in 0..3 {
        let ratio = light(&on, band) / light(&off, band);
        // 1600 pixels of 64 samples that scatter by half of their value: 0.16 %, less by their even spread.
        assert!((ratio - 1.0).abs() < 0.005, "{band}: {ratio}");
    }
}

#[test]
fn a_lamps_light_is_moved_and_not_made() {
    // Far brighter than white, twelve pixels wide: its wings are spread apart.
    let side = 120usize;
    let film = Film::new(1.2, 1.2, side, side);
    let response = narrow(&[550.0, 650.0]);
    let scene = lamp(0.12, 1e6, 0.0);
    for iris in [Iris::Round, Iris::blades(6, 0.1, 0.0).unwrap()] {
        let camera = camera(16.0, iris, film);
        let off = take(&scene, &camera, &response, &settings(64, Diffraction::Off));
        let white_e = brightest(&off) / 1000.0;
        let starred = take(&scene, &camera, &response, &settings(64, Diffraction::On { white_e: Some(white_e) }));
        for band in 0..2 {
            let ratio = light(&starred, band) / light(&off, band);
            // Beyond the film, 0.6 mm = 68 λN away, goes 2 / (π² · 68) = 0.3 % of a disk's light, and somewhat more of a hexagon's. Which samples at the lamp's edge
            // hit it is noise: half of the 64 of 48 pixels, 0.3 %.
            assert!((0.985..1.01).contains(&ratio), "{band}: {ratio}");
        }
        // Wings without the noise of rare samples: 16 to 28 pixels from the middle a pixel finds the lamp in 3 of 100 times 64 samples, and gets 60 points.
        let noise = |plane: &FocalPlane| {
            let off_middle = |v: usize| v as f64 + 0.5 - 0.5 * side as f64;
            let ring: Vec<[f64; 2]> = (0..side * side)
                .filter(|i| (16.0..28.0).contains(&off_middle(i % side).hypot(off_middle(i / side))))
                .map(|i| [f64::from(plane.mean.data[2 * i]), f64::from(plane.half_difference.data[2 * i])])
                .collect();
            let mean = ring.iter().map(|v| v[0]).sum::<f64>() / ring.len() as f64;
            (ring.iter().map(|v| v[1] * v[1]).sum::<f64>() / ring.len() as f64).sqrt() / mean
        };
        let plain = take(&scene, &camera, &response, &settings(64, ON));
        assert!(noise(&starred) < 0.25 * noise(&plain), "{} {}", noise(&starred), noise(&plain));
    }
}

#[test]
fn stars_have_the_same_bits_for_any_threads_and_parts_merge_to_the_whole() {
    let camera = camera(16.0, Iris::blades(5, 0.1, 0.0).unwrap(), Film::new(0.6, 0.6, 60, 60));
    let (scene, response) = (lamp(0.03, 1e6, 1.0), narrow(&[450.0, 550.0, 650.0]));
    let off = take(&scene, &camera, &response, &settings(16, Diffraction::Off));
    let white_e = brightest(&off) / 100.0;
    let on = settings(16, Diffraction::On { white_e: Some(white_e) });
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| take(&scene, &camera, &response, &on))
    };
    let whole = with(1);
    assert_eq!(whole, with(3));
    let part = |samples| take(&scene, &camera, &response, &Settings { samples, ..on.clone() });
    let merged = FocalPlane::merge(&[part(0..8), part(8..16)]).unwrap();
    // In all light to rounding and what leaves the film; pixel by pixel to the noise of the stars' points.
    for band in 0..3 {
        assert!((light(&merged, band) / light(&whole, band) - 1.0).abs() < 2e-3, "{band}");
    }
}

#[test]
fn an_exposure_goes_on_after_a_pause_with_the_same_bits() {
    let camera = camera(16.0, Iris::Round, Film::new(1.2, 1.0, 160, 128));
    let (scene, response) = (lamp(0.03, 1e6, 1.0), narrow(&[550.0]));
    let off = take(&scene, &camera, &response, &settings(8, Diffraction::Off));
    let on = settings(8, Diffraction::On { white_e: Some(brightest(&off) / 100.0) });
    let facts = ExposureFacts::default();
    let shutter = Shutter::global(1.0);
    let exposure =
        Exposure { scene: &scene, camera: &camera, shutter: &shutter, response: &response, settings: &on, facts: &facts };
    let go = AtomicBool::new(false);
    let watch = ProgressReporter { cancel: &go, progress: &|_| () };
    let mut sums = Vec::new();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let whole = pool.install(|| {
        let mut keep = |s: &diopter::expose::Sums| {
            sums.push(s.clone());
            std::ops::ControlFlow::Continue(())
        };
        exposure.run(&watch, None, Some(&mut keep)).unwrap().plane
    });
    let start = sums.first().expect("more tiles than one thread takes at once").clone();
    assert_eq!(exposure.run(&watch, Some(start), None).unwrap().plane, whole);
}

#[test]
fn a_pinhole_stays_sharp() {
    let film = Film::new(1.2, 1.2, 40, 40);
    let hole = Camera { lens: Lens::Pinhole(Pinhole::new(Millimeters(50.0), 16.0).unwrap()), ..camera(16.0, Iris::Round, film) };
    let (scene, response) = (lamp(0.3, 1e3, 1.0), narrow(&[550.0]));
    let [on, off] = [ON, Diffraction::Off].map(|d| take(&scene, &hole, &response, &settings(4, d)));
    assert_eq!((on.mean, on.half_difference), (off.mean, off.half_difference));
}

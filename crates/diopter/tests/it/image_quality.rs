//! Photographs against the optical bench: the slanted edge and the geometric MTF, a chart of points and the distortion.
//!
//! Both go through the same prescription, but by other ways: pupil samples drawn from the film, packets of rays, a scene and pixels here;
//! single rays from the object there. Objects are 10 km away: 50 mm are out of focus by 0.25 µm.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::focal_plane::{Band, BandUnit};
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::analysis::Bench;
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Lens, embedded};
use diopter::light::Spectrum;
use diopter::light::spectrum::Table;
use diopter::scene::material::Material;
use diopter::scene::shape::{Quad, Sphere};
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::Vec3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Of the light of all photographs here, ± 5 nm.
const NM: f64 = 550.0;
/// To all objects, m.
const DISTANCE: f32 = 1e4;

fn lens(name: &str, f_number: Option<f64>, film_mm: [f64; 2]) -> CompoundLens {
    let setting = Setting { focal_length: None, f_number, focus: Focus::Infinity, iris: None, film_mm };
    CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()
}

/// A photograph of what shines before the dark, in a narrow band of light.
fn photograph(shape: Shape, lens: &CompoundLens, film: Film, spp: u32) -> FocalPlane {
    let d = Description {
        materials: vec![Material::lamp("lamp", Spectrum::Constant(1.0))],
        objects: vec![Object::new("lamp", shape, 0)],
        ..Default::default()
    };
    let place = look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap();
    let camera = Camera { lens: Lens::Compound(Box::new(lens.clone())), film, motion: CameraMotion::still(place) };
    let band: Vec<f32> = (544..=556).map(|nm| if (545..=555).contains(&nm) { 1.0 } else { 0.0 }).collect();
    let response = Response {
        bands: vec![Band { name: "G".into(), unit: BandUnit::Electrons }],
        curves: vec![Table::new(544.0, 1.0, band)],
        analyzers: Vec::new(),
    };
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let settings = Settings { truth: false, ..Settings::new(spp) };
    let scene = Scene::build(d).unwrap();
    expose(&scene, &camera, &Shutter::global(1.0), &response, &settings, &ExposureFacts::default(), &watch).unwrap()
}

/// sin(πx) / (πx)
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// Contrast of an edge that moves one pixel to the left in every eight rows, at frequencies in cycles/mm; without what pixels take.
///
/// As ISO 12233, but with a slant that is known: a pixel in column c and row r lies (8c + r) eighths of a pixel across the edge (times the
/// cosine of its slant), so that the edge spread function is sampled at equal steps and nothing is binned.
fn slanted_edge_mtf(plane: &FocalPlane, pitch_mm: f64, frequencies: &[f64]) -> Vec<f64> {
    let (columns, rows) = (plane.mean.width, plane.mean.height);
    let last = 8 * (columns - 1) + rows;
    let (mut sums, mut counts) = (vec![0.0f64; last], vec![0.0f64; last]);
    for row in 0..rows {
        for column in 0..columns {
            sums[8 * column + row] += f64::from(plane.mean.pixel(column, row)[0]);
            counts[8 * column + row] += 1.0;
        }
    }
    // Where every eighth of the rows takes part.
    let spread: Vec<f64> = (rows - 1..=8 * (columns - 1)).map(|k| sums[k] / counts[k]).collect();
    let line: Vec<f64> = spread.windows(2).map(|w| w[0] - w[1]).collect();
    let total: f64 = line.iter().sum();
    let cos = 1.0 / f64::hypot(1.0, 0.125);
    let step_mm = 0.125 * pitch_mm * cos;
    frequencies
        .iter()
        .map(|f| {
            let (re, im) = line.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, v)| {
                let phase = TAU * f * step_mm * k as f64;
                (re + v * phase.cos(), im + v * phase.sin())
            });
            // Differences stand for the derivative; a pixel is a square that is seen slanted.
            let pixel = sinc(f * pitch_mm * cos) * sinc(f * pitch_mm * 0.125 * cos);
            f64::hypot(re, im) / total / (sinc(f * step_mm) * pixel)
        })
        .collect()
}

#[test]
fn the_slanted_edge_of_a_photograph_has_the_mtf_of_the_bench() {
    let (side, pitch_mm, frequencies) = (64, 5e-3, [5.0, 10.0, 20.0, 40.0]);
    let size = side as f64 * pitch_mm;
    let film = Film::new(size, size, side, side);
    // Light where x < y / 8: towards us, 400 m each way, where the picture is 64 m wide.
    let edge = Vec3::new(50.0, 400.0, 0.0);
    let corner = Vec3::new(-400.0, 0.0, -DISTANCE) - 0.5 * edge;
    let half_plane = Shape::Quad(Quad { corner, edges: [Vec3::X * 400.0, edge] });
    for (name, f_number) in [("double-gauss-50mm", None), ("tessar-50mm-f2.8", None), ("planar-50mm-f1.4", Some(2.0))] {
        let lens = lens(name, f_number, [36.0, 24.0]);
        let plane = photograph(half_plane, &lens, film, 1024);
        let found = slanted_edge_mtf(&plane, pitch_mm, &frequencies);
        let bench = Bench::at_infinity(lens.system());
        let expected = bench.geometric_mtf(0.0, &[(NM, 1.0)], &frequencies, 0.0).unwrap();
        for ((f, found), expected) in frequencies.iter().zip(found).zip(expected.sagittal) {
            println!("{name} {f} cycles/mm: {found:.4} {expected:.4}");
            // Noise: 8 pixels of 1024 samples at each of 441 places leave 0.002 at 40 cycles/mm; 96² rays of the bench as much.
            assert!((found - expected).abs() < 0.01, "{name} {f} cycles/mm: {found} {expected}");
        }
    }
}

#[test]
fn points_of_a_chart_lie_where_the_bench_puts_their_chief_rays() {
    let (side, size) = (60, 0.6);
    let mut most = 0.0f64;
    for (name, film_mm, heights) in [
        ("kit-zoom-18-55mm", [22.3, 14.9], [3.0, 6.0, 9.0]),
        ("double-gauss-50mm", [36.0, 24.0], [5.0, 10.0, 15.0]),
        ("wide-24mm-f3.5", [36.0, 24.0], [5.0, 10.0, 15.0]),
    ] {
        // Stopped down, the middle of the light is the chief ray: coma falls with the square of the aperture.
        let lens = lens(name, Some(45.0), film_mm);
        let bench = Bench::at_infinity(lens.system());
        let efl = bench.first_order(NM).efl;
        for height in heights {
            let field = bench.field_of_height(height);
            let point = bench.field_point(field, NM).unwrap();
            let expected = point.height.abs();
            // A disc of 0.1 mm in the picture, and the piece of the film around the place that it should have.
            let center = Vec3::new(field.to_radians().tan() as f32, 0.0, -1.0) * DISTANCE;
            let disc = Shape::Sphere(Sphere { center, radius: DISTANCE * 0.05 / efl as f32 });
            let film = Film { center_mm: [expected, 0.0], ..Film::new(size, size, side, side) };
            let plane = photograph(disc, &lens, film, 128);
            let (mut light, mut moment) = (0.0, [0.0; 2]);
            for (i, v) in plane.mean.data.iter().enumerate() {
                let place = [i % side, i / side].map(|k| ((k as f64 + 0.5) / side as f64 - 0.5) * size);
                light += f64::from(*v);
                (0..2).for_each(|axis| moment[axis] += f64::from(*v) * place[axis]);
            }
            assert!(light > 0.0, "{name}: nothing within {size} mm of {expected} mm");
            let [x, y] = moment.map(|m| m / light);
            let distortion = point.distortion_percent();
            println!(
                "{name} {field:.2}°: {expected:.4} mm, off by {:.2} and {:.2} µm; distortion {distortion:+.3} %",
                1e3 * x,
                1e3 * y
            );
            // The middle of some 10 000 samples of the disc is sure to 0.3 µm.
            assert!(x.abs() < 5e-4 * expected && y.abs() < 5e-4 * expected, "{name} {expected} mm: {x} {y}");
            most = most.max(distortion.abs());
        }
    }
    // Without distortion this would show nothing: the zoom at its short end has per cents.
    assert!(most > 1.0, "{most}");
}

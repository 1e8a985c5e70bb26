//! Colours that land in other pixels: how many do is known, so that it makes no noise, and nothing else changes.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Lens, embedded};
use diopter::light::random::SamplerKind;
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::{Description, Scene, builtin};
use diopter::sensor::Sensor;
use diopter::shutter::{Direction, Mechanism};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter};
use glam::Vec3;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn take(scene: &Scene, camera: &Camera, shutter: &Shutter, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    expose(scene, camera, shutter, &Response::sensor(&sensor), settings, &ExposureFacts::default(), &watch).unwrap()
}

/// The Tessar of glasses with dispersion before something 1 m away.
fn camera(film: Film, look_from: Vec3) -> Camera {
    let focus = Focus::Distance(Millimeters(1000.0));
    let setting =
        Setting { focal_length: None, f_number: Some(4.0), focus, iris: None, film_mm: [film.width_mm, film.height_mm] };
    let lens = CompoundLens::new(Arc::new(embedded("tessar-50mm-f2.8").unwrap()), &setting).unwrap();
    let motion = CameraMotion::still(look_at(look_from, look_from - Vec3::Z, Vec3::Y).unwrap());
    Camera { lens: Lens::Compound(Box::new(lens)), film, motion }
}

fn even() -> Scene {
    Scene::build(Description { environment: Some(Environment::uniform(Vec3::splat(100.0))), ..Default::default() }).unwrap()
}

/// Samples of which one tells where the others start, which is why landings are left to chance; or not.
fn settings(sampler: SamplerKind, spp: u32) -> Settings {
    Settings { truth: false, sampler, ..Settings::new(spp) }
}

/// Mean over the pixels of a region, `[left, top, width, height]`, of a band, and its deviation from pixel to pixel.
fn spread(plane: &FocalPlane, [left, top, width, height]: [usize; 4], band: usize) -> (f64, f64) {
    let values: Vec<f64> =
        (0..width * height).map(|i| f64::from(plane.mean.pixel(left + i % width, top + i / width)[band])).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

#[test]
fn an_even_field_has_little_noise_however_small_the_pixels() {
    // Blue and red land about as far apart as these pixels are wide.
    let side = 40;
    let scene = even();
    for (pitch_mm, most) in [(0.004, 0.75), (0.012, 0.65), (0.040, 0.5)] {
        let camera = camera(Film::new(side as f64 * pitch_mm, side as f64 * pitch_mm, side, side), Vec3::ZERO);
        let noise = |sampler| {
            let plane = take(&scene, &camera, &Shutter::global(1.0), &settings(sampler, 64));
            [0, 1, 2].map(|band| {
                let (mean, deviation) = spread(&plane, [2, 2, side - 4, side - 4], band);
                deviation / mean * 8.0
            })
        };
        let (known, left_to_chance) = (noise(SamplerKind::Sobol), noise(SamplerKind::Jittered));
        println!("{pitch_mm} mm: {known:.3?} / √n, left to chance {left_to_chance:.3?}");
        // Seen with the same samples where landings are left to chance: 0.55 to 0.63 at 4 µm, 0.43 to 0.49 at 12, 0.29 to 0.34 at 40.
        for band in 0..3 {
            assert!(known[band] < most * left_to_chance[band], "{pitch_mm} {band}: {known:?} {left_to_chance:?}");
        }
    }
}

#[test]
fn edges_borders_and_rows_that_open_one_after_the_other_keep_their_light() {
    // Dark and bright squares, small pixels, few samples: what is predicted is wrong nearly everywhere. Means of columns and rows, borders of the film included,
    // against samples whose landings are left to chance. The curtain needs 40 times its exposure for the height of the film.
    let (columns, rows) = (64, 48);
    let film = Film::new(0.64, 0.48, columns, rows);
    let chart = Scene::build(builtin::named("resolution-chart").unwrap()).unwrap();
    let rolling = Mechanism::Rolling { reset_s: 4.8e-3, readout_s: 4.8e-3, direction: Direction::Down };
    for (scene, name) in [(&chart, "chart"), (&even(), "even field")] {
        for shutter in [Shutter::global(0.01), Shutter { mechanism: rolling, exposure_s: 1.2e-4 }] {
            let camera = camera(film, Vec3::new(0.0, 0.0, 1.0));
            let light = |sampler| {
                // Passes of two samples each, as pictures of many pixels have: as many pictures of other seeds.
                let planes: Vec<FocalPlane> =
                    (0..24).map(|seed| take(scene, &camera, &shutter, &Settings { seed, ..settings(sampler, 8) })).collect();
                let line = |of: &dyn Fn(&FocalPlane) -> f64| {
                    let values: Vec<f64> = planes.iter().map(of).collect();
                    let n = values.len() as f64;
                    let mean = values.iter().sum::<f64>() / n;
                    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0) / n)
                };
                let column = |x: usize| line(&|p| (0..rows).map(|y| f64::from(p.mean.pixel(x, y)[1])).sum());
                let row = |y: usize| line(&|p| (0..columns).map(|x| f64::from(p.mean.pixel(x, y)[1])).sum());
                (0..columns).map(column).chain((0..rows).map(row)).collect::<Vec<_>>()
            };
            let (known, left_to_chance) = (light(SamplerKind::Sobol), light(SamplerKind::Jittered));
            let deviations: Vec<f64> = known.iter().zip(&left_to_chance).map(|(a, b)| (a.0 - b.0) / (a.1 + b.1).sqrt()).collect();
            let squares = deviations.iter().map(|d| d * d).sum::<f64>() / deviations.len() as f64;
            let worst = deviations.iter().fold(0.0f64, |a, d| a.max(d.abs()));
            println!("{name}: mean square deviation {squares:.2} of 112 lines, largest {worst:.1}");
            assert!(squares < 1.5 && worst < 4.5, "{name}: {squares} {worst}");
        }
    }
}

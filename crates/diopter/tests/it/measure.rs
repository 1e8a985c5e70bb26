//! Photographs of the laboratory's charts, measured, against what the chain of lens and sensor predicts.

use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Lens, embedded};
use diopter::measure::developed::{self, Development};
use diopter::measure::motion::Motion;
use diopter::measure::predict::Chain;
use diopter::measure::{Channel, Measured, distortion, mtf, vignetting};
use diopter::quantity::{FNumber, Seconds, Size};
use diopter::scene::Scene;
use diopter::scene::builtin::{self, charts};
use diopter::sensor::Sensor;
use diopter::shot::{Shot, ShotFile};
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, expose};
use glam::{DVec2, Vec3};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// From the entrance pupil to the chart, mm.
const DISTANCE_MM: f64 = 1000.0;

fn lens(name: &str, f_number: Option<f64>, film_mm: [f64; 2]) -> CompoundLens {
    let setting = Setting { focal_length: None, f_number, focus: Focus::at_mm(DISTANCE_MM), iris: None, film_mm };
    CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()
}

/// A photograph of a chart in the bands of a sensor, before it is read out.
fn photograph(chart: &str, lens: &CompoundLens, film: Film, sensor: &Sensor, spp: u32) -> Measured {
    expose_chart(chart, lens, film, sensor, Settings { truth: false, ..Settings::new(spp) })
}

fn expose_chart(chart: &str, lens: &CompoundLens, film: Film, sensor: &Sensor, settings: Settings) -> Measured {
    let f = charts::FRAMING;
    let place = look_at(f.look_from, f.look_at, Vec3::Y).unwrap();
    expose_on_the_way(chart, lens, film, sensor, settings, CameraMotion::still(place))
}

/// The same by a camera that moves in the 10 ms that the shutter is open.
fn expose_on_the_way(
    chart: &str,
    lens: &CompoundLens,
    film: Film,
    sensor: &Sensor,
    settings: Settings,
    motion: CameraMotion,
) -> Measured {
    let scene = Scene::build(builtin::named(chart).unwrap()).unwrap();
    let camera = Camera { lens: Lens::Compound(Box::new(lens.clone())), film, motion };
    let response = Response { bands: sensor.bands(), curves: sensor.band_responses(), analyzers: Vec::new() };
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let plane: FocalPlane =
        expose(&scene, &camera, &Shutter::global(0.01), &response, &settings, &ExposureFacts::default(), &watch).unwrap();
    let bands = plane.bands.iter().map(|b| b.name.clone()).collect();
    let limits = [f32::NEG_INFINITY, f32::INFINITY];
    Measured::Light { pixels: plane.mean, bands, limits, clipped: None, facts: Some(Box::new(plane.facts)) }
}

#[test]
fn edges_of_a_photograph_have_the_response_of_the_chain() {
    // The square in the middle of the chart, 3.2 mm wide in the picture, with pixels of 25 µm: 20 cycles/mm at half a cycle a pixel.
    let (side, size) = (200, 5.0);
    // A focal plane has no crosstalk: that comes with the read-out. Low-pass filter and gaps between pixels as if they belonged to these pixels.
    let mut sensor = Sensor::named("canon-t2i").unwrap();
    (sensor.crosstalk, sensor.low_pass_px, sensor.fill_factor) = (0.0, 2.0, 1.0);
    let own = sensor.pitch_mm()[0];
    let film = Film { low_pass_mm: 2.0 * own, ..Film::new(size, size, side, side) };
    for (name, f_number) in [("double-gauss-50mm", None), ("tessar-50mm-f2.8", Some(4.0))] {
        let lens = lens(name, f_number, [36.0, 24.0]);
        let picture = photograph("slanted-edges", &lens, film, &sensor, 256);
        let plane = picture.plane(Channel::Green).unwrap();
        let edges = mtf::find(&plane, &mtf::Options::default()).unwrap();
        assert!(edges.iter().any(|e| e.horizontal) && edges.iter().any(|e| !e.horizontal), "{name}: {} edges", edges.len());
        let chain = Chain {
            lens: &lens,
            sensor: &sensor,
            channel: 1,
            light: "D65",
            film_mm: [size; 2],
            size: [side; 2],
            diffraction: false,
            motion: Motion::Straight([0.0; 2]),
        };
        let mut sums = [0.0; 51];
        for edge in &edges {
            let p = chain.predict(edge).unwrap();
            println!(
                "{name} {} {:.2}°: {:.4} {:.4} at 0.25, {:.4} {:.4} at 0.5; {:?}",
                edge.region,
                edge.angle_deg,
                edge.at(0.25),
                p.windowed[25],
                edge.at_nyquist,
                p.windowed[50],
                p.largest_difference
            );
            assert!((edge.angle_deg.abs() - 5.0).abs() < 0.3, "{}", edge.angle_deg);
            // One edge of some dozen rows at 256 samples: seen up to 0.031 near Nyquist.
            assert!(p.largest_difference[0].abs() < 0.05, "{name} {}: {:?}", edge.region, p.largest_difference);
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum += (edge.at(p.frequencies[k]) - p.windowed[k]) / edges.len() as f64;
            }
        }
        // On average over the edges. 0.02 is what a laboratory asks for. Wide open, light falls by 2 % within the window: the response reads 1.02 at low frequencies.
        for (k, sum) in sums.iter().enumerate() {
            assert!(sum.abs() < 0.02, "{name}: {sum} at {} cycles a pixel", 0.01 * k as f64);
        }
    }
}

#[test]
fn a_camera_that_moves_blurs_edges_as_the_chain_says() {
    use glam::Affine3A;
    let (side, size) = (200, 5.0);
    let mut sensor = Sensor::named("canon-t2i").unwrap();
    (sensor.crosstalk, sensor.low_pass_px, sensor.fill_factor) = (0.0, 0.0, 1.0);
    let film = Film::new(size, size, side, side);
    let lens = lens("double-gauss-50mm", Some(4.0), [36.0, 24.0]);
    let f = charts::FRAMING;
    let place = look_at(f.look_from, f.look_at, Vec3::Y).unwrap();
    // The camera travels 1.2 mm past a chart at 1 m; its image by the magnification of it: f / (distance - f).
    let way_mm = 1.2;
    let travel = way_mm * 50.0 / (DISTANCE_MM - 50.0) * side as f64 / size;
    assert!((2.0..3.0).contains(&travel), "{travel}");
    let moved = |t: f64| place * Affine3A::from_translation(Vec3::X * (1e-3 * way_mm * t / 0.01) as f32);
    let chain = Chain {
        lens: &lens,
        sensor: &sensor,
        channel: 1,
        light: "D65",
        film_mm: [size; 2],
        size: [side; 2],
        diffraction: false,
        motion: Motion::Straight([travel, 0.0]),
    };
    let settings = Settings { truth: false, ..Settings::new(256) };
    let picture = expose_on_the_way("slanted-edges", &lens, film, &sensor, settings, CameraMotion::sampled(0.01, moved));
    let found = mtf::find(&picture.plane(Channel::Green).unwrap(), &mtf::Options::default()).unwrap();
    let (mut across, mut along) = (0, 0);
    for edge in &found {
        let p = chain.predict(edge).unwrap();
        println!("{} {travel:.3} {:?} {:.4} {:.4}", edge.region, p.largest_difference, edge.at(0.15), p.windowed[15]);
        // As single edges of a camera that stands still; measured at most 0.018.
        assert!(p.largest_difference[0].abs() < 0.03, "{}: {:?}", edge.region, p.largest_difference);
        // What is lost at 0.15 cycles a pixel is lost to motion, across it alone.
        let still = Chain { motion: Motion::Straight([0.0; 2]), ..chain }.predict(edge).unwrap();
        match edge.horizontal {
            true => along += usize::from((edge.at(0.15) - still.windowed[15]).abs() < 0.03),
            false => across += usize::from(edge.at(0.15) < still.windowed[15] - 0.08),
        }
    }
    assert!(across > 0 && along > 0 && across + along == found.len(), "{across} {along} of {}", found.len());
}

#[test]
fn stopped_down_edges_have_the_benchs_response_with_diffraction() {
    // The edges of the square in the middle of the chart, 1.6 mm from the middle of the picture, in pixels of 4 µm at f/16: Airy radius 11 µm, half contrast
    // at 46 cycles/mm = 0.18 cycles a pixel.
    use diopter::expose::{Diffraction, diffraction_shows};
    let mut sensor = Sensor::named("canon-t2i").unwrap();
    (sensor.crosstalk, sensor.low_pass_px, sensor.fill_factor) = (0.0, 0.0, 1.0);
    let (side, size) = (160usize, 0.64);
    let lens = lens("double-gauss-50mm", Some(16.0), [36.0, 24.0]);
    let film = Film { center_mm: [1.6, 0.0], ..Film::new(size, size, side, side) };
    assert!(diffraction_shows(&Lens::Compound(Box::new(lens.clone())), &film));
    let settings = Settings { truth: false, diffraction: Diffraction::On { white_e: None }, ..Settings::new(256) };
    let picture = expose_chart("slanted-edges", &lens, film, &sensor, settings);
    let plane = picture.plane(Channel::Green).unwrap();
    let edges = mtf::find(&plane, &mtf::Options::default()).unwrap();
    assert!(!edges.is_empty());
    let chain = Chain {
        lens: &lens,
        sensor: &sensor,
        channel: 1,
        light: "D65",
        film_mm: [size; 2],
        size: [side; 2],
        diffraction: true,
        motion: Motion::Straight([0.0; 2]),
    };
    for edge in &edges {
        let p = chain.predict(edge).unwrap();
        println!(
            "{}: {:.4} {:.4} at 0.1, {:.4} {:.4} at 0.25; {:?}",
            edge.region,
            edge.at(0.1),
            p.product[10],
            edge.at(0.25),
            p.product[25],
            p.largest_difference
        );
        // To half of the cut-off; one edge of 160 rows at 256 samples, and 0.01 for the light beyond the region, whose contrast counts as 1.
        for k in 0..=25 {
            let off = edge.at(p.frequencies[k]) - p.product[k];
            assert!(off.abs() < 0.04, "{}: {off} at {}", edge.region, p.frequencies[k]);
        }
    }
}

#[test]
fn the_dots_of_a_photograph_have_the_distortion_of_the_bench() {
    // Stopped down so that coma moves nothing: a zoom at its short end, on the film that it is made for; and a lens whose entrance pupil moves by a millimetre towards the
    // corners, which counts for a chart as near as this.
    for (name, film_mm) in [("kit-zoom-18-55mm", [22.3, 14.9]), ("double-gauss-50mm", [36.0, 24.0])] {
        let lens = lens(name, Some(16.0), film_mm);
        let sensor = Sensor::named("canon-t2i").unwrap();
        let film = Film::new(film_mm[0], film_mm[1], 720, 480);
        let picture = photograph("dot-grid", &lens, film, &sensor, 16);
        let found = distortion::measure(&picture.plane(Channel::Green).unwrap()).unwrap();
        let system = lens.system();
        let n = system.indices(550.0);
        let pupil = diopter::lens::paraxial::FirstOrder::of(system, &n).entrance_pupil_z;
        let bench = diopter::lens::analysis::Bench { system, object_distance: Some(DISTANCE_MM - pupil) };
        let half = 0.5 * f64::hypot(film_mm[0], film_mm[1]);
        for height in [0.4, 0.6, 0.8] {
            let expected = bench.field_point(bench.field_of_height(height * half), 550.0).unwrap().distortion_percent();
            let measured = found.percent(height);
            println!("{name} {height}: {measured:+.3} % {expected:+.3} %");
            // A tenth of a pixel of the 340 at 0.8 is 0.03 %; colours of the band lie up to some micrometres apart.
            assert!((measured - expected).abs() < 0.1, "{name} {height}: {measured} {expected}");
        }
        assert!(found.dots.len() > 300 && found.percent(0.8).abs() > 0.5, "{name} {} {}", found.dots.len(), found.percent(0.8));
    }
}

#[test]
fn a_flat_field_falls_off_as_the_bench_says() {
    let film_mm = [36.0, 24.0];
    let lens = lens("double-gauss-50mm", None, film_mm);
    let sensor = Sensor::named("canon-t2i").unwrap();
    let picture = photograph("flat-field", &lens, Film::new(film_mm[0], film_mm[1], 180, 120), &sensor, 64);
    let found = vignetting::measure(&picture.plane(Channel::Green).unwrap()).unwrap();
    // Fully open this lens loses light towards the corners, and alike in all four.
    assert!(found.at(1.0) < 0.8 && found.at(0.5) > found.at(1.0), "{} {}", found.at(0.5), found.at(1.0));
    let [low, high] = found.corners.iter().fold([f64::MAX, 0.0], |[a, b]: [f64; 2], v| [a.min(*v), b.max(*v)]);
    // Squares of 6 × 6 pixels of 64 samples.
    assert!(high - low < 0.03 * high, "{:?}", found.corners);
}

/// A shot of a chart, focused and metered.
fn shot(change: impl Fn(&mut ShotFile)) -> Shot {
    let mut file = ShotFile::default();
    file.scene.file = Some("slanted-edges".into());
    file.camera.body = Some("canon-t2i".into());
    file.camera.lens = Some("double-gauss-50mm".into());
    file.exposure.aperture = Some(FNumber(4.0));
    file.render.size = Some(Size { width: 300, height: 200 });
    file.render.spp = Some(64);
    change(&mut file);
    let mut quiet = |_: &str| ();
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let mut shot = Shot::prepare(&file, &mut quiet).unwrap();
    shot.focus(&watch, &mut quiet).unwrap();
    shot.meter(&watch, &mut quiet).unwrap();
    shot
}

#[test]
fn developed_edges_have_the_response_of_chain_and_development() {
    // Sharpened, so that something beside demosaicing and the tone curve is predicted.
    let shot = shot(|file| file.develop.sharpen.amount = 0.8);
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let raw = shot.read_out(&shot.expose(&watch).unwrap()).unwrap();
    let picture = developed::measured(&shot.develop(&raw).unwrap());
    let options = mtf::Options { reach: Some(10.0), ..mtf::Options::default() };
    let edges = mtf::find(&picture.plane(Channel::Luminance).unwrap(), &options).unwrap();
    let Lens::Compound(lens) = &shot.camera.lens else { panic!("a real lens") };
    let film = &shot.camera.film;
    let chain = Chain {
        lens,
        sensor: &shot.sensor,
        channel: 0,
        light: "D65",
        film_mm: [film.width_mm, film.height_mm],
        size: [300, 200],
        diffraction: shot.diffracts(),
        motion: Motion::Of(&shot),
    };
    let development = Development { raw: &raw, recipe: &shot.recipe, lut: None, size: [300, 200] };
    let mut sums = [[0.0; 2]; 51];
    let n = edges.len() as f64;
    for edge in &edges {
        let p = development.predict(&chain, edge, Channel::Luminance, &options).unwrap();
        assert!(p.steps.iter().map(|s| s.name).eq(["demosaicing", "tone and colour", "sharpening"]), "{:?}", p.steps);
        for (k, sum) in sums.iter_mut().enumerate() {
            sum[0] += (edge.mtf[k] - p.product[k]) / n;
            // Without the development.
            sum[1] += (edge.mtf[k] - p.raw[k]) / n;
        }
    }
    let worst = |which: usize| sums.iter().map(|s| s[which].abs()).fold(0.0, f64::max);
    println!("{} edges: {:.4} with the development, {:.4} without", edges.len(), worst(0), worst(1));
    assert!(edges.len() > 3 && worst(0) < 0.02 && worst(1) > 0.05, "{} {}", worst(0), worst(1));
}

#[test]
fn the_motion_of_a_shot_is_that_of_its_camera_and_its_subjects() {
    let f = charts::FRAMING;
    let way_mm = 1.2f32;
    // Past the chart in the 10 ms that the shutter is open.
    let moving = shot(|file| {
        let stop = |time: f64, mm: f32| {
            let at = |v: Vec3| (v + Vec3::X * 1e-3 * mm).to_array();
            format!("[[camera.path]]\ntime = {time}\nlook_from = {:?}\nlook_at = {:?}\n", at(f.look_from), at(f.look_at))
        };
        let path: ShotFile = toml::from_str(&(stop(0.0, 0.0) + &stop(0.01, way_mm))).unwrap();
        file.camera.path = path.camera.path;
        file.exposure.shutter = Some(Seconds(0.01));
    });
    let film = &moving.camera.film;
    // Magnification at the chart: f / (distance - f), distances from the front principal point: within 2 %.
    let travel = f64::from(way_mm) * 50.0 / (DISTANCE_MM - 50.0) * film.columns as f64 / film.width_mm;
    let motion = Motion::Of(&moving).at([150.0, 100.0], [1.0, 0.0]).unwrap();
    assert!((motion.length_px(DVec2::X) / travel - 1.0).abs() < 0.04, "{} {travel}", motion.length_px(DVec2::X));
    assert!(motion.length_px(DVec2::Y) < 0.01 * travel);
    // Constant speed: a box as long as the way.
    let box_of = Motion::Straight([motion.length_px(DVec2::X), 0.0]).at([0.0; 2], [1.0, 0.0]).unwrap();
    for frequency in [0.1, 0.5, 1.0] {
        let [a, b] = [&motion, &box_of].map(|w| w.response(DVec2::X * frequency)[0]);
        assert!((a - b).abs() < 0.02, "{frequency}: {a} {b}");
    }
    // Nothing moves: nothing is lost.
    let still = shot(|_| ());
    assert_eq!(Motion::Of(&still).at([150.0, 100.0], [1.0, 0.0]).unwrap().response(DVec2::X), [1.0, 0.0]);
}

//! The exposure against closed forms, and the promises it makes: same numbers for any threads, parts that merge, honest
//! errors.

use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::{Focus, Iris, Lens, Pinhole, ThinLens};
use diopter::light::random::SamplerKind;
use diopter::light::units::Millimeters;
use diopter::scene::light::Environment;
use diopter::scene::{Scene, builtin};
use diopter::sensor::Sensor;
use diopter::{Camera, CameraMotion, Film, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter};
use glam::Vec3;
use std::sync::atomic::AtomicBool;

const SECOND: Shutter = Shutter { mechanism: diopter::shutter::Mechanism::Global, exposure_s: 1.0 };

fn take(scene: &Scene, camera: &Camera, response: &Response, settings: &Settings) -> FocalPlane {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    expose(scene, camera, &SECOND, response, settings, &ExposureFacts::default(), &watch).unwrap()
}

fn cornell(columns: usize, rows: usize) -> (Scene, Camera) {
    let description = builtin::named("cornell").unwrap();
    let place = description.cameras[0].world_from_camera;
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(35.0), 8.0).unwrap());
    (
        Scene::build(description).unwrap(),
        Camera { lens, film: Film::new(25.0, 25.0, columns, rows), motion: CameraMotion::still(place) },
    )
}

#[test]
fn one_two_and_eight_threads_give_the_same_bits() {
    let (scene, camera) = cornell(40, 33);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| take(&scene, &camera, &Response::linear_srgb(), &Settings::new(6)))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(8));
    assert!(one.mean.data.iter().any(|v| *v > 1.0));
}

#[test]
fn a_film_without_bands_is_an_error() {
    let (scene, camera) = cornell(4, 4);
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let response = Response { bands: vec![], curves: vec![], ..Response::luminance() };
    let taken = expose(&scene, &camera, &SECOND, &response, &Settings::new(2), &ExposureFacts::default(), &watch);
    assert!(matches!(taken, Err(diopter::expose::ExposeError::Nothing)));
}

#[test]
fn halves_merge_to_the_whole() {
    let (scene, camera) = cornell(24, 24);
    for sampler in [SamplerKind::Sobol, SamplerKind::Jittered, SamplerKind::Independent, SamplerKind::Grid] {
        let settings = |samples| Settings { samples, sampler, ..Settings::new(16) };
        let shoot = |samples| take(&scene, &camera, &Response::linear_srgb(), &settings(samples));
        let whole = shoot(0..16);
        let merged = FocalPlane::merge(&[shoot(10..16), shoot(0..10)]).unwrap();
        // Single precision in the files: the mean agrees to its rounding.
        for (a, b) in whole.mean.data.iter().zip(&merged.mean.data) {
            assert!((a - b).abs() <= 2e-6 * a.abs().max(1.0), "{sampler:?}: {a} {b}");
        }
        let scale = whole.mean.data.iter().copied().fold(0.0, f32::max);
        for (a, b) in whole.half_difference.data.iter().zip(&merged.half_difference.data) {
            assert!((a - b).abs() <= 1e-5 * scale, "{sampler:?}: {a} {b}");
        }
        assert_eq!(whole.truth, merged.truth);
        assert_eq!((merged.facts.first_sample, merged.facts.samples), (0, 16));
    }
}

#[test]
fn the_claimed_variance_is_the_one_seen_over_many_seeds() {
    // Each pixel's mean claim over its seen variance, averaged over the picture so that the few pixels at the lamp's edge do
    // not decide alone. With n seeds a ratio scatters by 2 / √n whatever the distribution (its fourth moments cancel: both halves enter both
    // sides), and is (n − 1) / (n − 3) on average, since its denominator is an estimate. 400 seeds: 0.1; the mean over 256 pixels, whose bands
    // share their paths: at most 0.6 %, tested at 3 σ.
    const SEEDS: u64 = 400;
    let n_seeds = SEEDS as f64;
    let (scene, camera) = cornell(16, 16);
    for sampler in [SamplerKind::Sobol, SamplerKind::Independent, SamplerKind::Jittered] {
        let shots: Vec<FocalPlane> = (0..SEEDS)
            .map(|seed| {
                take(&scene, &camera, &Response::linear_srgb(), &Settings { seed, sampler, truth: false, ..Settings::new(8) })
            })
            .collect();
        let n = shots[0].mean.data.len();
        let (mut ratios, mut count) = (0.0f64, 0.0f64);
        for i in 0..n {
            let values: Vec<f64> = shots.iter().map(|s| s.mean.data[i] as f64).collect();
            let mean = values.iter().sum::<f64>() / n_seeds;
            let seen = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n_seeds - 1.0);
            let claimed = shots.iter().map(|s| (s.half_difference.data[i] as f64).powi(2)).sum::<f64>() / n_seeds;
            if seen > 0.0 {
                ratios += claimed / seen;
                count += 1.0;
            }
        }
        let ratio = ratios / count * (n_seeds - 3.0) / (n_seeds - 1.0);
        assert!(count > 0.9 * n as f64 && (ratio - 1.0).abs() < 0.02, "{sampler:?}: {ratio}");
    }
}

#[test]
fn samplers_agree_on_the_mean() {
    let (scene, camera) = cornell(16, 16);
    let mean = |sampler| {
        let p = take(&scene, &camera, &Response::luminance(), &Settings { sampler, truth: false, ..Settings::new(400) });
        p.mean.data.iter().map(|v| *v as f64).sum::<f64>() / 256.0
    };
    let sobol = mean(SamplerKind::Sobol);
    for kind in [SamplerKind::Independent, SamplerKind::Jittered, SamplerKind::Grid] {
        // 102 400 samples of relative deviation near 2 (lamp in view): 0.6 %; tested at 3 σ.
        assert!((mean(kind) / sobol - 1.0).abs() < 0.02, "{kind:?}: {} {sobol}", mean(kind));
    }
}

#[test]
fn electrons_of_an_even_field_are_the_product_of_the_parts() {
    // E = π L / (4 N² (1 + m)²) on the axis of a thin lens at infinity (m = 0), times pixel area, time and response.
    let description =
        diopter::scene::Description { environment: Some(Environment::uniform(Vec3::splat(100.0))), ..Default::default() };
    let scene = Scene::build(description).unwrap();
    let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
    let n = 8.0;
    let lens = Lens::Thin(ThinLens::new(Millimeters(200.0), n, Iris::Round, Focus::Infinity).unwrap());
    let [pitch, _] = sensor.pitch_mm();
    let film = Film { pixel_area_mm2: pitch * pitch, ..Film::new(0.1, 0.1, 2, 2) };
    let camera = Camera { lens, film, motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()) };
    let plane = take(&scene, &camera, &Response::sensor(&sensor), &Settings::new(4096));
    let d65 = diopter::light::cie::d65_one_nit();
    for (band, response) in sensor.band_responses().iter().enumerate() {
        let radiance: f64 =
            (3800..7800).map(|i| i as f32 / 10.0 + 0.05).map(|nm| (response.at(nm) * d65.at(nm)) as f64 * 0.1).sum::<f64>()
                * 100.0;
        let expected = radiance * std::f64::consts::PI / (4.0 * n * n) * pitch * pitch * 1e-6;
        let got = plane.mean.pixel(0, 0)[band] as f64;
        // Only wavelengths are drawn: two nets of 2048 strata of the cumulative response, whose error falls with n^1.5 (below 1e-4). Our
        // ideal lens keeps the sine condition, so that f/8 is not a small-angle approximation.
        assert!((got / expected - 1.0).abs() < 1e-3, "band {band}: {got} {expected}");
    }
    // Halving the area of the aperture halves the electrons.
    let smaller = Lens::Thin(
        ThinLens::new(Millimeters(200.0), n * 2f64.sqrt(), Iris::blades(6, 0.2, 0.0).unwrap(), Focus::Infinity).unwrap(),
    );
    let half = take(&scene, &Camera { lens: smaller, ..camera }, &Response::sensor(&sensor), &Settings::new(4096));
    let ratio = half.mean.pixel(0, 0)[1] / plane.mean.pixel(0, 0)[1];
    // The same samples and an iris of the same area by its definition.
    assert!((ratio - 0.5).abs() < 5e-4, "{ratio}");
}

#[test]
fn an_even_grey_field_has_its_luminance_and_colour() {
    let description = diopter::scene::Description {
        environment: Some(Environment::uniform(Vec3::new(20.0, 50.0, 80.0))),
        ..Default::default()
    };
    let scene = Scene::build(description).unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap());
    let camera = Camera {
        lens,
        film: Film::new(36.0, 24.0, 3, 2),
        motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()),
    };
    let response = Response::linear_srgb();
    let plane = take(&scene, &camera, &response, &Settings::new(4096));
    let spectrum = diopter::light::Spectrum::light_from_rgb(Vec3::new(20.0, 50.0, 80.0));
    for (band, rgb) in [20.0, 50.0, 80.0].into_iter().enumerate() {
        let got = f64::from(plane.mean.pixel(1, 1)[band]);
        let integral: f64 = (0..4000)
            .map(|i| 380.05 + 0.1 * i as f32)
            .map(|nm| f64::from(spectrum.at(nm) * response.curves[band].at(nm)) * 0.1)
            .sum();
        // What is drawn is the integral of the spectrum; the spectrum has its colour to within the fit (ΔE below ½: 1 %).
        assert!((got / integral - 1.0).abs() < 1e-3, "band {band}: {got} {integral}");
        assert!((integral / rgb - 1.0).abs() < 0.01, "band {band}: {integral} {rgb}");
    }
}

#[test]
fn blur_of_a_point_is_as_wide_as_the_thin_lens_says() {
    use diopter::light::Spectrum;
    use diopter::scene::material::Material;
    use diopter::scene::shape::Sphere;
    use diopter::scene::{Description, Object, Shape};
    // A small lamp at 4 m, focus at 2 m, 50 mm f/2: C = A |s' − s'_f| / s' with A = 25 mm.
    let d = Description {
        materials: vec![Material::lamp("lamp", Spectrum::light_from_rgb(Vec3::splat(1e6)))],
        objects: vec![Object::new("lamp", Shape::Sphere(Sphere { center: Vec3::NEG_Z * 4.0, radius: 1e-3 }), 0)],
        ..Default::default()
    };
    let scene = Scene::build(d).unwrap();
    let (f, a) = (50.0, 25.0);
    let image = |s: f64| f * s / (s - f);
    let circle = a * (image(2000.0) - image(4000.0)).abs() / image(4000.0);
    let camera = Camera {
        lens: Lens::Thin(ThinLens::new(Millimeters(f), 2.0, Iris::Round, Focus::Distance(Millimeters(2000.0))).unwrap()),
        film: Film::new(1.0, 1.0, 200, 200),
        motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()),
    };
    let plane = take(&scene, &camera, &Response::luminance(), &Settings { truth: false, ..Settings::new(64) });
    // Light of an even disk has ⟨r²⟩ = R²/2; the lamp's own image (radius 0.0127 mm) adds its square.
    let (mut moment, mut light) = (0.0f64, 0.0f64);
    for row in 0..200 {
        for column in 0..200 {
            let v = plane.mean.pixel(column, row)[0] as f64;
            let (x, y) = ((column as f64 - 99.5) / 200.0, (row as f64 - 99.5) / 200.0);
            moment += v * (x * x + y * y);
            light += v;
        }
    }
    let diameter_mm = 2.0 * (2.0 * moment / light).sqrt();
    let expected = (circle * circle + 0.0254f64.powi(2)).sqrt();
    assert!((diameter_mm / expected - 1.0).abs() < 0.02, "{diameter_mm} {expected}");
}

#[test]
fn any_number_of_bands_is_exposed_and_written() {
    let (scene, camera) = cornell(20, 18);
    let settings = Settings::new(4);
    let three = take(&scene, &camera, &Response::linear_srgb(), &settings);
    // The same bands twice, so that wavelengths are drawn as before: green and blue of the second half lie in another group of four.
    let mut twice = Response::linear_srgb();
    twice.curves.extend(Response::linear_srgb().curves);
    twice
        .bands
        .extend(["R2", "G2", "B2"].map(|n| diopter::image::focal_plane::Band { name: n.into(), ..three.bands[0].clone() }));
    let six = take(&scene, &camera, &twice, &settings);
    for (a, b) in three.mean.data.chunks(3).zip(six.mean.data.chunks(6)) {
        assert_eq!(b[..3], b[3..]);
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * a.abs().max(1.0)), "{a:?} {b:?}");
    }
    let bands = "395..705/10nm".parse().unwrap();
    let plane = take(&scene, &camera, &Response::spectral(&bands), &settings);
    assert_eq!(
        (plane.bands.len(), plane.bands[0].name.as_str(), plane.bands[30].name.as_str()),
        (31, "S0.400,0nm", "S0.700,0nm")
    );
    let mut file = std::io::Cursor::new(Vec::new());
    diopter::image::exr::write_focal_plane(&plane, &mut file).unwrap();
    file.set_position(0);
    assert_eq!(diopter::image::exr::read_focal_plane(file).unwrap(), plane);
    let part = |samples| take(&scene, &camera, &Response::spectral(&bands), &Settings { samples, ..settings.clone() });
    let merged = FocalPlane::merge(&[part(0..2), part(2..4)]).unwrap();
    for (a, b) in plane.mean.data.iter().zip(&merged.mean.data) {
        assert!((a - b).abs() <= 1e-5 * a.abs().max(1e-3), "{a} {b}");
    }
}

#[test]
fn spectral_bands_hold_the_mean_radiance_between_their_limits() {
    let description =
        diopter::scene::Description { environment: Some(Environment::uniform(Vec3::splat(100.0))), ..Default::default() };
    let scene = Scene::build(description).unwrap();
    let lens = Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap());
    let motion = CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap());
    let camera = Camera { lens, film: Film::new(36.0, 24.0, 6, 4), motion };
    let bands: diopter::quantity::SpectralBands = "380..780/20nm".parse().unwrap();
    let plane = take(&scene, &camera, &Response::spectral(&bands), &Settings { truth: false, ..Settings::new(1024) });
    let d65 = diopter::light::cie::d65_one_nit();
    for (b, [from, to]) in bands.limits().enumerate() {
        let steps = (to - from) * 10;
        let at = |i: u32| 100.0 * f64::from(d65.at(from as f32 + (i as f32 + 0.5) / 10.0));
        let expected = (0..steps).map(at).sum::<f64>() / f64::from(steps);
        let got = plane.mean.channel(b).iter().map(|v| f64::from(*v)).sum::<f64>() / 24.0;
        // Edges are 2 nm wide ramps, and 24 × 1024 paths of four wavelengths: 0.3 % in a band of a twentieth of the light.
        assert!((got / expected - 1.0).abs() < 0.01, "{from}..{to}: {got} {expected}");
    }
}

#[test]
fn an_interrupted_exposure_goes_on_bit_for_bit() {
    use diopter::expose::{ExposeError, Exposure};
    use std::ops::ControlFlow;
    // More tiles than one thread computes at once, and samples of two passes.
    let (scene, camera) = cornell(144, 128);
    let settings = Settings { samples: 254..258, truth: false, ..Settings::new(512) };
    let (response, facts) = (Response::linear_srgb(), ExposureFacts::default());
    let exposure =
        Exposure { scene: &scene, camera: &camera, shutter: &SECOND, response: &response, settings: &settings, facts: &facts };
    let whole = take(&scene, &camera, &response, &settings);
    let (go, stop) = (AtomicBool::new(false), AtomicBool::new(false));
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut kept = Vec::new();
    pool(1).install(|| {
        let watch = ProgressReporter { cancel: &go, progress: &|_| () };
        let exposed = exposure
            .run(
                &watch,
                None,
                Some(&mut |sums| {
                    kept.push(sums.clone());
                    ControlFlow::Continue(())
                }),
            )
            .unwrap();
        assert!(!exposed.stopped && exposed.plane == whole);
    });
    assert!(kept.len() >= 3, "{}", kept.len());
    // The picture so far is what the samples of whole passes make.
    let so_far: Vec<FocalPlane> = kept.iter().filter_map(|sums| exposure.so_far(sums)).collect();
    assert_eq!(so_far, [take(&scene, &camera, &response, &Settings { samples: 254..256, ..settings.clone() })]);
    assert!(kept.iter().any(|sums| sums.samples() == (254..254)) && kept.iter().any(|sums| sums.samples() == (254..256)));
    for sums in &kept {
        let watch = ProgressReporter { cancel: &go, progress: &|_| () };
        let exposed = pool(3).install(|| exposure.run(&watch, Some(sums.clone()), None)).unwrap();
        assert!(!exposed.stopped && exposed.plane == whole, "from {:?}", sums.samples());
    }
    // Stopped in the first pass: that is finished, and is all there is.
    pool(1).install(|| {
        let watch = ProgressReporter { cancel: &stop, progress: &|_| () };
        let mut on_stop = |_: &diopter::expose::Sums| {
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
            ControlFlow::Continue(())
        };
        let exposed = exposure.run(&watch, None, Some(&mut on_stop)).unwrap();
        let part = take(&scene, &camera, &response, &Settings { samples: 254..256, ..settings.clone() });
        assert!(exposed.stopped && exposed.plane == part);
        assert_eq!(exposure.run(&watch, None, None).unwrap_err(), ExposeError::Cancelled);
        // The truth comes before the first sample: there is nothing to finish.
        let with_truth = Settings { truth: true, ..settings.clone() };
        let mut count = 0;
        let stopped = Exposure { settings: &with_truth, ..exposure }.run(
            &watch,
            None,
            Some(&mut |_| {
                count += 1;
                ControlFlow::Continue(())
            }),
        );
        assert_eq!((stopped.unwrap_err(), count), (ExposeError::Cancelled, 0));
    });
    // Who has kept the sums may end it within a pass: with the first tiles of the first one, and no sample of all pixels.
    let watch = ProgressReporter { cancel: &go, progress: &|_| () };
    let mut first = None;
    let mut keep_and_end = |sums: &diopter::expose::Sums| {
        first = Some((sums.samples().len(), sums.mean_samples()));
        ControlFlow::Break(())
    };
    let ended = pool(1).install(|| exposure.run(&watch, None, Some(&mut keep_and_end)));
    assert_eq!(ended.unwrap_err(), ExposeError::Cancelled);
    // 64 of the 9 × 8 tiles have both samples of the pass.
    assert_eq!(first, Some((0, 2.0 * 64.0 / 72.0)));
    let other = Settings { samples: 0..4, ..settings.clone() };
    let watch = ProgressReporter { cancel: &go, progress: &|_| () };
    let foreign = Exposure { settings: &other, ..exposure }.run(&watch, Some(kept[0].clone()), None);
    assert_eq!(foreign.unwrap_err(), ExposeError::Foreign);
}

#[test]
fn re_weighted_exposures_have_the_same_bits_for_any_threads_and_after_a_pause() {
    use diopter::expose::{Exposure, Fireflies};
    let (scene, camera) = cornell(144, 128);
    let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
    let mut settings = Settings { truth: false, ..Settings::new(8) };
    let kept = take(&scene, &camera, &response, &settings);
    // A white far below the brightest samples, so that there is something to take away.
    let brightest = kept.mean.data.iter().copied().fold(0.0, f32::max);
    settings.fireflies = Fireflies::Reweight { white_e: f64::from(brightest) * 0.02 };
    let facts = ExposureFacts::default();
    let exposure =
        Exposure { scene: &scene, camera: &camera, shutter: &SECOND, response: &response, settings: &settings, facts: &facts };
    let go = AtomicBool::new(false);
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut sums = Vec::new();
    let whole = pool(1).install(|| {
        let watch = ProgressReporter { cancel: &go, progress: &|_| () };
        let mut keep = |s: &diopter::expose::Sums| {
            sums.push(s.clone());
            std::ops::ControlFlow::Continue(())
        };
        exposure.run(&watch, None, Some(&mut keep)).unwrap().plane
    });
    assert_eq!(pool(3).install(|| take(&scene, &camera, &response, &settings)), whole);
    let watch = ProgressReporter { cancel: &go, progress: &|_| () };
    let start = sums.first().expect("more tiles than one thread takes at once").clone();
    assert_eq!(exposure.run(&watch, Some(start), None).unwrap().plane, whole);
    // What is reported is what is missing; single precision of the planes: 1e-6.
    let light = |plane: &FocalPlane| plane.mean.data.iter().map(|v| f64::from(*v)).sum::<f64>();
    let removed = whole.facts.fireflies_removed.unwrap();
    assert!(removed > 0.0 && (removed - (1.0 - light(&whole) / light(&kept))).abs() < 1e-5, "{removed}");
    assert_eq!(kept.facts.fireflies_removed, None);
    // Parts keep what they find, and merge to the whole.
    let part = |samples| take(&scene, &camera, &response, &Settings { samples, ..settings.clone() });
    let merged = FocalPlane::merge(&[part(0..4), part(4..8)]).unwrap();
    assert_eq!(merged.facts.fireflies_removed, None);
    assert!((light(&merged) / light(&kept) - 1.0).abs() < 1e-6);
}

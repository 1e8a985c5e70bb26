//! Direct and indirect light as truth: the light of the picture, told apart.

use diopter::camera::look_at;
use diopter::expose::{Diffraction, Exposure, Fireflies, ProgressReporter};
use diopter::image::channels::{Channel, DIRECT, INDIRECT};
use diopter::image::focal_plane::FocalPlaneSource;
use diopter::image::{ExposureFacts, FocalPlane};
use diopter::lens::compound::Setting;
use diopter::lens::{CompoundLens, Focus, Iris, Lens, ThinLens, embedded};
use diopter::light::units::Millimeters;
use diopter::scene::{PathSettings, Scene, builtin};
use diopter::sensor::Sensor;
use diopter::{Camera, CameraMotion, Film, Integrator, Response, Settings, Shutter, expose};
use glam::Vec3;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const APART: [&Channel; 2] = [DIRECT, INDIRECT];

struct Shot {
    scene: Scene,
    camera: Camera,
    response: Response,
}

impl Shot {
    /// An embedded scene through a thin lens, or a traced one.
    fn of(name: &str, traced: bool) -> Shot {
        let scene = Scene::build(builtin::named(name).unwrap()).unwrap();
        // The box has a camera of its own: (278, 273, −800) mm.
        let (from, at, focus_m) = match builtin::framing(name) {
            Some(framing) => (framing.look_from, framing.look_at, framing.focus_m),
            None => (Vec3::new(0.278, 0.273, -0.8), Vec3::new(0.278, 0.273, 0.0), 1.0),
        };
        let focus = Focus::Distance(Millimeters(1000.0 * focus_m));
        let lens = match traced {
            false => Lens::Thin(ThinLens::new(Millimeters(50.0), 1.4, Iris::Round, focus).unwrap()),
            true => {
                let setting = Setting { focal_length: None, f_number: Some(2.0), focus, iris: None, film_mm: [36.0, 24.0] };
                Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded("double-gauss-50mm").unwrap()), &setting).unwrap()))
            }
        };
        let motion = CameraMotion::still(look_at(from, at, Vec3::Y).unwrap());
        let response = Response::sensor(&Sensor::named("canon-5d-mark-iv").unwrap());
        Shot { scene, camera: Camera { lens, film: Film::new(36.0, 24.0, 48, 32), motion }, response }
    }

    fn take(&self, settings: &Settings) -> FocalPlane {
        let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
        let shutter = Shutter::global(0.01);
        expose(&self.scene, &self.camera, &shutter, &self.response, settings, &ExposureFacts::default(), &watch).unwrap()
    }
}

fn asking(spp: u32) -> Settings {
    Settings { truth_channels: APART.to_vec(), ..Settings::new(spp) }
}

fn apart(plane: &FocalPlane) -> [&[f32]; 2] {
    APART.map(|c| plane.truth.float(c.name).unwrap().data.as_slice())
}

/// Holds the sum of both against the mean, to so much of it; returns the fraction of all light that is indirect.
#[track_caller]
fn adds_up(plane: &FocalPlane, rounding: f32) -> f64 {
    let [direct, indirect] = apart(plane);
    for (i, mean) in plane.mean.data.iter().enumerate() {
        let sum = direct[i] + indirect[i];
        assert!(direct[i] >= 0.0 && indirect[i] >= 0.0, "{i}: {} {}", direct[i], indirect[i]);
        assert!((sum - mean).abs() <= rounding * mean, "{i}: {} + {} for {mean}", direct[i], indirect[i]);
    }
    let sum = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
    sum(indirect) / sum(&plane.mean.data)
}

#[test]
fn both_add_up_to_the_picture_and_direct_light_is_that_of_depth_one() {
    let depth_one = |settings: &Settings| {
        let path = PathSettings { max_depth: 1, ..settings.path };
        Settings { path, ..settings.clone() }
    };
    for (name, traced) in [("still-life", false), ("still-life", true), ("cornell", true)] {
        let shot = Shot::of(name, traced);
        for integrator in [Integrator::Path, Integrator::Auto, Integrator::Bidirectional] {
            let settings = Settings { integrator, ..asking(4) };
            let plane = shot.take(&settings);
            let plain = shot.take(&Settings { truth_channels: vec![], ..settings.clone() });
            assert_eq!((&plane.mean, &plane.half_difference), (&plain.mean, &plain.half_difference), "{name} {integrator:?}");
            let indirect = adds_up(&plane, 1e-6);
            assert!((0.02..0.98).contains(&indirect), "{name} {integrator:?}: {indirect}");
            // The same samples, cut short: what is left is the direct light.
            let shallow = shot.take(&depth_one(&Settings { truth_channels: vec![], ..settings }));
            for (i, (direct, expected)) in apart(&plane)[0].iter().zip(&shallow.mean.data).enumerate() {
                assert!((direct - expected).abs() <= 1e-5 * expected, "{name} {integrator:?} {i}: {direct} {expected}");
            }
        }
    }
}

#[test]
fn what_re_weighting_takes_and_what_lamps_diffract_is_told_apart_too() {
    let shot = Shot::of("still-life", true);
    let plain = shot.take(&asking(16));
    let brightest = f64::from(plain.mean.data.iter().copied().fold(0.0, f32::max));
    let reweighted = shot.take(&Settings { fireflies: Fireflies::Reweight { white_e: 0.01 * brightest }, ..asking(16) });
    assert!(reweighted.facts.fireflies_removed.unwrap() > 0.002);
    adds_up(&reweighted, 1e-6);
    // Stars are spread after the samples: part of both, by what their lamps are.
    let diffraction = Diffraction::On { white_e: Some(0.01 * brightest) };
    let starred = shot.take(&Settings { diffraction, ..asking(16) });
    let without = shot.take(&Settings { diffraction: Diffraction::On { white_e: None }, ..asking(16) });
    let [a, b] = [&starred, &without].map(|plane| adds_up(plane, 1e-5));
    assert!(starred.mean != without.mean && (a - b).abs() < 0.02, "{a} {b}");
}

#[test]
fn parts_threads_and_paged_exposures_have_the_same_direct_light() {
    let shot = Shot::of("still-life", true);
    let whole = shot.take(&asking(8));
    let of_threads = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| shot.take(&asking(8)));
    assert_eq!(of_threads(1), of_threads(3));
    let part = |samples: Range<u32>| shot.take(&Settings { samples, ..asking(8) });
    // Three samples and five: parts count by their numbers.
    let merged = FocalPlane::merge(&[part(0..3), part(3..8)]).unwrap();
    adds_up(&merged, 1e-5);
    for (a, b) in apart(&whole)[0].iter().zip(apart(&merged)[0]) {
        assert!((a - b).abs() <= 1e-5 * a, "{a} {b}");
    }
    // Sums on the disk.
    let (settings, facts, shutter) = (asking(8), ExposureFacts::default(), Shutter::global(0.01));
    let Shot { scene, camera, response, .. } = &shot;
    let exposure = Exposure { scene, camera, shutter: &shutter, response, settings: &settings, facts: &facts };
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let mut rows = exposure.run_paged(&watch, None, None, 1 << 14, &std::env::temp_dir()).unwrap().rows(scene);
    let paged = rows.next_rows(32).unwrap();
    assert_eq!((&paged.mean, apart(&paged)), (&whole.mean, apart(&whole)));
}

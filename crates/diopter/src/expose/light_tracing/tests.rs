use super::*;
use crate::camera::Film;
use crate::camera_motion::CameraMotion;
use diopter_lens::compound::Setting;
use diopter_lens::{CompoundLens, Focus, Iris, ThinLens, embedded};
use diopter_light::units::Millimeters;
use glam::Affine3A;
use std::sync::Arc;

fn pilot(middle: [f64; 2], area: f64, hits: f64, flux: f64, passed: f64) -> Option<Pilot> {
    Some(Pilot { middle: DVec2::from_array(middle), area, hits, flux, passed })
}

#[test]
fn a_disk_gets_samples_by_its_area_however_many_lamps_share_it() {
    // One lamp alone, of which three quarters of the rays come through; one that does not show.
    let alone = wanted(&[pilot([100.0, 50.0], 300.0, 20.0, 1.0, 0.75), None]);
    assert_eq!(alone, [SAMPLES_A_PIXEL * 400.0, 0.0]);
    // A hundred parts of one lamp, a third of them twice as bright: as many in all, by their light.
    let parts: Vec<_> = (0..99).map(|i| pilot([100.0, 50.0], 300.0, 0.2, if i % 3 == 0 { 2.0 } else { 1.0 }, 1.0)).collect();
    let counts = wanted(&parts);
    assert!((counts.iter().sum::<f64>() - SAMPLES_A_PIXEL * 300.0).abs() < 1e-6 && (counts[0] / counts[1] - 2.0).abs() < 1e-9);
    // Elsewhere, or of another size, it is another disk.
    let apart = wanted(&[pilot([100.0, 50.0], 300.0, 20.0, 1.0, 1.0), pilot([200.0, 50.0], 300.0, 20.0, 9.0, 1.0)]);
    assert_eq!(apart, [SAMPLES_A_PIXEL * 300.0; 2]);
}

#[test]
fn what_camera_samples_meet_anyway_gets_no_light_samples() {
    assert_eq!(wanted(&[pilot([100.0, 50.0], 300.0, 0.7 * 300.0, 1.0, 1.0)]), [0.0]);
    assert!(wanted(&[pilot([100.0, 50.0], 300.0, 0.4 * 300.0, 1.0, 1.0)])[0] > 0.0);
    // A panel of many small parts, each alone a small lamp out of focus.
    let panel: Vec<_> =
        (0..40 * 40).map(|i| pilot([10.0 * f64::from(i % 40), 10.0 * f64::from(i / 40)], 300.0, 100.0, 1.0, 1.0)).collect();
    let counts = wanted(&panel);
    // Its border may be taken for lamps.
    assert!(counts.iter().filter(|c| **c == 0.0).count() > 1200, "{counts:?}");
}

#[test]
fn the_entrance_table_holds_nearly_all_rays_and_little_else() {
    let film_mm = [36.0, 24.0];
    let real = |name: &str, focus| {
        let setting = Setting { focal_length: None, f_number: None, focus, iris: None, film_mm };
        Lens::Compound(Box::new(CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()))
    };
    let far = ThinLens::new(Millimeters(50.0), 2.0, Iris::Round, Focus::Infinity).unwrap();
    let lenses = [
        ("thin", Lens::Thin(far), 1.6),
        ("double-gauss-50mm", real("double-gauss-50mm", Focus::Distance(Millimeters(700.0))), 2.2),
        ("distagon-28mm-f2", real("distagon-28mm-f2", Focus::Infinity), 4.0),
    ];
    for (name, lens, most) in lenses {
        let camera = Camera { lens, film: Film::new(36.0, 24.0, 36, 24), motion: CameraMotion::still(Affine3A::IDENTITY) };
        let table = Entrance::of(&camera).unwrap();
        let (mut all, mut within, mut areas, mut weights) = (0, 0, 0.0, 0.0);
        for k in 0..4000 {
            let [x, y, u, v] = [0.445, 0.811, 0.373, 0.629].map(|step: f64| (k as f64 * (step + 0.000_37)).fract());
            let film = camera.film_point(36.0 * x, 24.0 * y);
            let Ok(ray) = camera.lens.ray(film, [u as f32, v as f32]) else { continue };
            if -ray.direction.z <= LEAST_COSINE {
                continue;
            }
            all += 1;
            let at = (ray.origin_mm - ray.direction * (ray.origin_mm.z / ray.direction.z)).truncate();
            let Some(r) = table.rectangle(ray.direction) else { continue };
            within += usize::from(at.cmpge(r.min).all() && at.cmple(r.max).all());
            // What of the rectangle passes: its light over that of all of it.
            areas += r.area();
            weights += PI * (0.5 * camera.lens.focal_length().0 / camera.lens.f_number()).powi(2);
        }
        println!("{name}: {within} of {all}, {:.2} of the pupil's area", areas / weights);
        assert!(all > 2000 && within * 1000 >= all * 990, "{name}: {within} of {all}");
        assert!(areas / weights < most, "{name}: {}", areas / weights);
    }
}

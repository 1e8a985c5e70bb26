use crate::analysis::Bench;
use crate::compound::{FilmPlace, configure};
use crate::glass::D_NM;
use crate::prescription::{ApertureKind, Surface, read_toml};
use crate::surface::Profile;
use crate::{Focus, Prescription, embedded};

#[test]
fn inferred_rims_end_where_surfaces_cross() {
    // Two spheres of 50 mm, 1 mm apart: 2 (50 − √(50² − h²)) = 1 at h = 7.0534 mm; f/2 would need 12.5 mm.
    let text = |rim: &str| {
        format!(
            "name = \"x\"\nf_number = 2\nsurfaces = [\n{{ stop = true, gap = 1, semi_diameter = 14 }},\n\
             {{ radius = 50, gap = 1, glass = \"1.5\"{rim} }},\n{{ radius = -50, gap = 49{rim} }},\n]\n"
        )
    };
    let p = read_toml(&text(""), "x.toml").unwrap();
    let height = (50.0f64.powi(2) - 49.5f64.powi(2)).sqrt();
    for s in &p.surfaces[1..] {
        assert!((s.semi_diameter.unwrap() - height).abs() < 1e-6, "{:?} {height}", s.semi_diameter);
    }
    let note = p.notes.iter().find(|n| n.contains("surfaces 2 and 3 cross at a height of 7.0534 mm"));
    assert!(note.is_some_and(|n| n.contains("of surface 2 and 3 ends there")), "{:?}", p.notes);
    // Rims that a file gives are wrong, not estimates.
    let wrong = read_toml(&text(", semi_diameter = 12"), "x.toml").unwrap_err().to_string();
    assert!(wrong.contains("it crosses surface 3"), "{wrong}");
}

/// The double Gauss with an aperture of its file and without semi-diameters of some surfaces.
fn double_gauss(aperture: ApertureKind, missing: &[usize]) -> Prescription {
    let mut p = embedded("double-gauss-50mm").unwrap();
    p.f_number = None;
    p.usage.aperture = Some(aperture);
    missing.iter().for_each(|i| p.surfaces[*i].semi_diameter = None);
    p.checked("test").unwrap()
}

#[test]
fn impossible_apertures_and_distances_are_told_in_words() {
    let refused = |aperture: ApertureKind, object: Option<f64>| {
        let mut p = embedded("double-gauss-50mm").unwrap();
        (p.usage.aperture, p.usage.object_distance) = (Some(aperture), object);
        p.checked("x.zmx").unwrap_err().to_string()
    };
    for (aperture, says) in [
        (ApertureKind::EntrancePupil(-10.0), "x.zmx: entrance pupil diameter -10 mm: expected a positive number"),
        (ApertureKind::FNumber(0.0), "x.zmx: f-number 0: expected a positive number"),
        (ApertureKind::ObjectNa(1.5), "x.zmx: numerical aperture of the object's side 1.5: expected a positive number below 1"),
    ] {
        assert_eq!(refused(aperture, None), says);
    }
    let object = refused(ApertureKind::FNumber(4.0), Some(0.0));
    assert!(object.starts_with("x.zmx: object distance 0 mm: expected a positive length"), "{object}");
}

#[test]
fn an_entrance_pupil_that_rims_clip_is_noted() {
    let clipped = double_gauss(ApertureKind::EntrancePupil(30.0), &[]);
    let note = clipped.notes.iter().find(|n| n.contains("entrance pupil of 30.0000 mm"));
    assert!(note.is_some_and(|n| n.contains("is clipped to 2") && n.contains("by the rim of surface")), "{:?}", clipped.notes);
    assert!(double_gauss(ApertureKind::EntrancePupil(20.0), &[]).notes.is_empty());
}

#[test]
fn an_inferred_stop_lets_the_files_entrance_pupil_through() {
    // By real rays: the paraxial height at the stop is 0.65 % more than the real one at f/2.5.
    let stop = embedded("double-gauss-50mm").unwrap().stop();
    let p = double_gauss(ApertureKind::EntrancePupil(20.0), &[stop]);
    let set = configure(&p, None, None, None, FilmPlace::Focused(Focus::Infinity)).unwrap();
    assert!((set.efl / set.widest / 20.0 - 1.0).abs() < 1e-5, "{} {}", set.efl, set.widest);
}

#[test]
fn fully_open_the_iris_is_the_prescriptions_own_stop() {
    // A rim of 8 mm before a stop of 9 mm limits the axial beam.
    let glass = crate::glass::Glass::air();
    let mut front = Surface::new(Profile::Plane, 30.0, glass.clone());
    front.semi_diameter = Some(8.0);
    let mut stop = Surface::new(Profile::Plane, 1.0, glass.clone());
    (stop.stop, stop.semi_diameter) = (true, Some(9.0));
    let mut mirror = Surface::new(Profile::Conic { c: -1.0 / 200.0, k: -1.0 }, -100.0, glass);
    (mirror.mirror, mirror.semi_diameter) = (true, Some(30.0));
    let p = Prescription::new("rim", vec![front, stop, mirror]).checked("test").unwrap();
    let open = configure(&p, None, None, None, FilmPlace::Focused(Focus::Infinity)).unwrap();
    assert!((open.f_number - 100.0 / 16.0).abs() < 1e-6 && open.system.iris.radius == 9.0, "{open:?}");
    assert!((open.beam_radius - 8.0).abs() < 1e-6, "{}", open.beam_radius);
    // Beside the axis the rim shadows one side of the stop; the other is as wide as the stop: two disks of 8 and 9 mm whose middles are
    // 30 tan θ apart at the stop.
    let bench = Bench::at_infinity(&open.system);
    let theta = 5.0f64.to_radians();
    let d = 30.0 * theta.tan();
    let (r, s) = (8.0f64, 9.0f64);
    let half = |a: f64, b: f64| a * a * ((d * d + a * a - b * b) / (2.0 * d * a)).acos();
    let kite = 0.5 * ((-d + r + s) * (d + r - s) * (d - r + s) * (d + r + s)).sqrt();
    let lens_area = half(r, s) + half(s, r) - kite;
    let expected = lens_area * theta.cos() / (std::f64::consts::PI * r * r);
    let found = bench.vignetting(5.0, D_NM).unwrap();
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    // Stopped down, the iris is the axial beam's.
    let stopped = configure(&p, None, Some(10.0), None, FilmPlace::Focused(Focus::Infinity)).unwrap();
    assert!((stopped.system.iris.radius - 5.0).abs() < 1e-6, "{}", stopped.system.iris.radius);
}

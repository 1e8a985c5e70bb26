//! Lenses whose figures others have published or checked.

use diopter_lens::analysis::Bench;
use diopter_lens::glass::{C_NM, D_NM, F_NM};
use diopter_lens::import::{self, Format};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::ray::{Apertures, TraceDirection};
use diopter_lens::trace::at_plane;
use diopter_lens::{State, System, embedded};

#[test]
fn the_singlet_that_two_people_checked_in_optic_studio() {
    // Prescription and figures: optiland issue 710 (SingletStopSurf2).
    let text = "name = \"singlet\"\nsurfaces = [\n\
        { radius = 63.73364157, gap = 10, glass = \"LAC9 (HOYA)\", semi_diameter = 15 },\n\
        { radius = 653.29392320, stop = true, gap = 92.73834630, semi_diameter = 15 },\n]\n\
        [usage]\nentrance_pupil_diameter = 25\n";
    let p = import::read(text.as_bytes(), Format::Toml, "singlet.toml").unwrap();
    let mut system = System::at(&p, State::default());
    let near = |found: f64, listed: f64, within: f64| assert!((found - listed).abs() < within, "{found} {listed}");
    // Which colour is their primary one is not said: the one with their focal length.
    let at = |nm: f64| FirstOrder::of(&system, &system.indices(nm));
    let primary = [F_NM, D_NM, C_NM]
        .into_iter()
        .min_by(|a, b| (at(*a).efl - 101.501826).abs().total_cmp(&(at(*b).efl - 101.501826).abs()))
        .unwrap();
    let mut f = at(primary);
    f.stop_radius = 12.5 / f.entrance_pupil_magnification;
    near(f.efl, 101.501826, 1e-4);
    near(f.entrance_pupil_z, 6.318809, 1e-5);
    near(2.0 * f.exit_pupil_radius(), 23.397108, 1e-4);
    near(f.f_number(), 4.060073, 1e-5);
    near(f.bfl - 92.73834630, 2.255622, 1e-4);
    // Their beam is as wide as the entrance pupil; the stop lies behind.
    system.iris.radius = f.stop_radius;
    let bench = Bench::at_infinity(&system);
    let beam = bench.beam(0.0, primary).unwrap();
    for (nm, rms, largest) in [(F_NM, 0.032252, 0.046552), (D_NM, 0.137509, 0.156289), (C_NM, 0.188229, 0.214543)] {
        // Six rings of six, twelve ... rays and the middle, as OpticStudio samples a pupil.
        let n = system.indices(nm);
        let (mut sum, mut count, mut most) = (0.0, 1.0, 0.0f64);
        for ring in 1..=6 {
            let at = glam::DVec2::new(12.5 * (1.0 - 1e-9) * ring as f64 / 6.0, 0.0);
            let out = system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Ignore).unwrap();
            let height = at_plane(&out, system.film_z).x.abs();
            sum += 6.0 * ring as f64 * height * height;
            count += 6.0 * ring as f64;
            most = most.max(height);
        }
        let found = f64::sqrt(sum / count);
        println!("{nm}: RMS {found} listed {rms}, largest {most} listed {largest}");
        near(found, rms, 6e-7);
        near(most, largest, 6e-7);
        // Evenly over the pupil the spot is a little larger.
        let spot = bench.spot(0.0, nm, primary, 101, 0.0).unwrap();
        assert!((spot.rms / rms - 1.0).abs() < 0.08, "{nm}: {} {rms}", spot.rms);
    }
}

#[test]
fn the_triplet_of_the_ray_optics_documentation() {
    let system = System::at(&embedded("triplet-50mm-f4").unwrap(), State::default());
    let f = FirstOrder::of(&system, &system.indices(D_NM));
    for (found, listed, digits) in [
        (f.efl, 50.0, 0.05),
        (f.ffl, -37.1, 0.05),
        (f.bfl, 41.24, 0.005),
        (f.entrance_pupil_z, 11.68, 0.005),
        (f.exit_pupil_z - system.last_z(), -10.01, 0.005),
        (f.rear_principal_z - f.front_principal_z, -2.047, 0.0005),
    ] {
        assert!((found - listed).abs() < digits, "{found} {listed}");
    }
}

#[test]
fn light_from_behind_the_lens_is_seen_by_a_fisheye() {
    // A front dome and a strong negative back bend light from 100° off the axis into the stop.
    let text = "name = \"dome\"\nf_number = 8\nsurfaces = [\n\
        { radius = 40, gap = 4, glass = \"1.8/40\", semi_diameter = 39.9 },\n\
        { radius = 14, gap = 16, semi_diameter = 13.95 },\n\
        { radius = -90, gap = 3, glass = \"1.75/45\", semi_diameter = 12 },\n\
        { radius = 12, gap = 14, semi_diameter = 9 },\n\
        { radius = 20, gap = 6, glass = \"1.7/30\", semi_diameter = 8 },\n\
        { radius = -30, gap = 2, semi_diameter = 8 },\n\
        { stop = true, gap = 1, semi_diameter = 2 },\n\
        { radius = 40, gap = 5, glass = \"1.6/60\", semi_diameter = 7 },\n\
        { radius = -14, gap = 25, semi_diameter = 7 },\n]\n";
    let p = import::read(text.as_bytes(), Format::Toml, "dome.toml").unwrap();
    let system = System::at(&p, State::default());
    let bench = Bench::at_infinity(&system);
    let mut before = -1.0;
    for field in [0.0, 40.0, 80.0, 95.0, 100.0] {
        let point = bench.field_point(field, D_NM).unwrap_or_else(|| panic!("no chief ray at {field}"));
        println!("{field}: {:.3} mm", point.height);
        assert!(point.height > before, "{field}: {point:?}");
        before = point.height;
        let spot = bench.spot(field, D_NM, D_NM, 21, 0.0).unwrap_or_else(|| panic!("no light at {field}"));
        assert!(spot.points.len() > 20, "{field}");
    }
    // And the other way: a film point out there looks backwards.
    let setting = diopter_lens::compound::Setting {
        focal_length: None,
        f_number: None,
        focus: diopter_lens::Focus::Infinity,
        iris: None,
        film_mm: [2.2 * before, 2.2 * before],
    };
    let lens = diopter_lens::CompoundLens::new(std::sync::Arc::new(p), &setting).unwrap();
    let backwards = (0..100)
        .filter_map(|i| lens.chief_ray(glam::DVec2::new(before * 0.01 * i as f64, 0.0)).ok())
        .filter(|ray| ray.direction.z > 0.0)
        .count();
    assert!(backwards >= 3, "{backwards}");
}

//! Lenses with something decentred, tilted or turned: what the bench says of them does not depend on which way it went, nor on how the same glass is written down.

use diopter_lens::analysis::{Bench, ThirdOrder};
use diopter_lens::embedded;
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::prescription::{Misalignment, Prescription, read_toml};
use diopter_lens::ray::{Apertures, TraceDirection};
use diopter_lens::system::{State, System};
use glam::DVec2;

const NM: f64 = 587.5618;

fn triplet(decenter: [f64; 3], tilt: [f64; 3]) -> System {
    let mut p = embedded("triplet-50mm-f4").unwrap();
    p.misalignments.push(Misalignment { first: 0, last: 1, decenter, tilt });
    System::at(&p, State::default())
}

#[test]
fn an_error_across_the_axis_does_the_same_whichever_way_it_goes() {
    // Light comes in along the axis in both cases: not from where the element sends the chief ray back to.
    let (up, aside) = (triplet([0.0, 0.3, 0.0], [0.0; 3]), triplet([0.3, 0.0, 0.0], [0.0; 3]));
    let spot = |system| Bench::at_infinity(system).spot(0.0, NM, NM, 64, 0.0).unwrap();
    let (up, aside) = (spot(&up), spot(&aside));
    assert!(up.centroid.y.abs() > 0.3 && up.centroid.x.abs() < 1e-6, "{:?}", up.centroid);
    assert!(
        (DVec2::new(up.centroid.y, up.centroid.x) - aside.centroid).length() < 1e-3,
        "{:?} {:?}",
        up.centroid,
        aside.centroid
    );
    assert!((up.rms / aside.rms - 1.0).abs() < 0.01, "{} {}", up.rms, aside.rms);
    let (up, aside) = (triplet([0.0; 3], [0.3, 0.0, 0.0]), triplet([0.0; 3], [0.0, 0.3, 0.0]));
    let rms = |system| Bench::at_infinity(system).wavefront_rms(0.0, NM, 64).unwrap();
    assert!((rms(&up) / rms(&aside) - 1.0).abs() < 0.01, "{} {}", rms(&up), rms(&aside));
}

#[test]
fn light_comes_through_a_misaligned_lens_at_all_small_angles() {
    for system in [triplet([0.05, -0.04, 0.0], [0.1, -0.1, 0.0]), triplet([0.0; 3], [-1.0, 0.0, 0.0])] {
        let bench = Bench::at_infinity(&system);
        let n = system.indices(NM);
        for k in -40..=40 {
            let field = 0.02 * f64::from(k);
            let beam = bench.beam(field, NM).unwrap_or_else(|| panic!("{field}"));
            // It comes in at the field's angle, in the y–z plane, and meets the middle of the stop.
            let d = beam.chief.direction;
            assert!(d.x.abs() < 1e-9 && (d.y.atan2(d.z).to_degrees() - field).abs() < 1e-9, "{field}: {d}");
            let mut at_stop = None;
            let _ = system.trace_with(beam.chief, &n, TraceDirection::ToFilm, Apertures::Ignore, |e| {
                if e.surface == system.stop {
                    at_stop = Some(e.point);
                }
            });
            assert!(at_stop.is_some_and(|p| p.truncate().length() < 1e-8), "{field}: {at_stop:?}");
        }
    }
}

#[test]
fn a_toroid_turned_by_a_right_angle_is_the_other_toroid() {
    let lens = |first: &str| -> Prescription {
        let text = format!(
            "name = \"toroid\"\nsurfaces = [\n{{ {first}, gap = 5, glass = \"N-BK7\", semi_diameter = 8, stop = true }},\n\
             {{ radius = -50, gap = 40, semi_diameter = 8 }},\n]\n"
        );
        read_toml(&text, "toroid.toml").unwrap()
    };
    let of = |p: &Prescription| {
        let system = System::at(p, State::default());
        FirstOrder::of(&system, &system.indices(NM))
    };
    let turned = of(&lens("radius = 50, radius_x = 25, tilt_deg = [0, 0, 90]"));
    let plain = of(&lens("radius = 25, radius_x = 50"));
    assert!((turned.efl / plain.efl - 1.0).abs() < 1e-12, "{} {}", turned.efl, plain.efl);
    // By Euler's theorem the section at 45° has the mean of both curvatures.
    let between = of(&lens("radius = 50, radius_x = 25, tilt_deg = [0, 0, 45]"));
    let sphere = of(&lens(&format!("radius = {}", 2.0 / (1.0 / 50.0 + 1.0 / 25.0))));
    assert!((between.efl / sphere.efl - 1.0).abs() < 1e-9, "{} {}", between.efl, sphere.efl);
}

#[test]
fn third_order_and_axial_color_are_those_of_the_object_distance() {
    let system = System::at(&embedded("triplet-50mm-f4").unwrap(), State::default());
    let n = system.indices(NM);
    for object_distance in [None, Some(500.0), Some(150.0)] {
        let bench = Bench { system: &system, object_distance };
        // Real rays at two small heights in the pupil: without the fifth order, which goes with the fifth power.
        let last_z = system.surfaces.iter().map(|s| s.z).fold(0.0, f64::max);
        let aberration = |height: f64| {
            let beam = bench.beam(0.0, NM).unwrap();
            let trace = |h: f64| {
                let ray = system.trace(beam.ray(DVec2::new(0.0, h)), &n, TraceDirection::ToFilm, Apertures::Ignore).unwrap();
                (ray.position, ray.direction)
            };
            let (p, d) = trace(1e-4);
            let focus = p.z - p.y * d.z / d.y;
            let (p, d) = trace(height);
            (p.y + (focus - p.z) * d.y / d.z, focus)
        };
        let (a, b) = (0.4, 0.8);
        let third = |h: f64| ThirdOrder::of(&system, &n, &vec![0.0; n.len()], object_distance, h, 0.1);
        let extrapolated = (aberration(a).0 / a.powi(3) * b * b - aberration(b).0 / b.powi(3) * a * a) / (b * b - a * a);
        let sums = third(1.0);
        let expected = sums.transverse(&sums.sum())[0];
        assert!((extrapolated / expected - 1.0).abs() < 0.01, "{object_distance:?}: {extrapolated} {expected}");
        // Axial colour: where real rays near the axis cross it.
        let focus = |nm: f64| {
            let n = system.indices(nm);
            let beam = bench.beam(0.0, nm).unwrap();
            let ray = system.trace(beam.ray(DVec2::new(0.0, 1e-3)), &n, TraceDirection::ToFilm, Apertures::Ignore).unwrap();
            ray.position.z - ray.position.y * ray.direction.z / ray.direction.y - last_z
        };
        let color = bench.color(&[400.0, NM], NM, &[0.0]);
        let expected = focus(400.0) - focus(NM);
        assert!((color.axial[0] / expected - 1.0).abs() < 1e-3, "{object_distance:?}: {} {expected}", color.axial[0]);
    }
}

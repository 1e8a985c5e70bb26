//! Mirrors off the axis, set up about their base ray: against closed forms, against the same mirrors on their axis, and from file to photograph.

use crate::packets::{ray_of, traced_alike};
use diopter_lens::analysis::Bench;
use diopter_lens::batch::double::{Batch, Indices, LANES, Packet};
use diopter_lens::compound::{CompoundLens, EntryRays, ExitRays, Samples, Scratch, Setting};
use diopter_lens::export::{ExportFormat, write};
use diopter_lens::import::{Format, read};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::prescription::{Gap, Misalignment, ObjectAxis, Prescription};
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::system::{State, System};
use diopter_lens::trace::at_plane;
use diopter_lens::{Focus, embedded};
use diopter_light::units::Millimeters;
use glam::{DVec2, DVec3};
use std::sync::Arc;

const NM: f64 = 587.6;

fn code_v(text: &str) -> Prescription {
    read(text.as_bytes(), Format::CodeV, "test.seq").unwrap()
}

fn system(p: &Prescription) -> System {
    System::at(p, State::default())
}

fn first_order(p: &Prescription) -> FirstOrder {
    let s = system(p);
    FirstOrder::of(&s, &s.indices(NM))
}

/// A paraboloid of which a part off the axis is used, so that light turns by 90 degrees: a focal length of twice the parent's.
const PARABOLOID: &str = "RDM; EPD 25; WL 587.6; YAN 0 1; SO 0 1e13; S 0 150; STO; CIR 12.5; \
    S -200 -100 REFL; CON; K -1; YDE -200; CIR 13; ADY 200; S 0 0; ADE 90; SI 0 0";

/// A spherical mirror of radius 400, tilted by an angle: light turns by twice that, and the film stands square to it.
fn tilted_sphere(degrees: f64) -> String {
    format!("RDM; EPD 10; WL 587.6; YAN 0 0.5; SO 0 1e13; S -400 -200 REFL; STO; ADE {degrees}; BEN; SI 0 0")
}

fn lens(p: Prescription, focus: Focus) -> CompoundLens {
    let setting = Setting { focal_length: None, f_number: None, focus, iris: None, film_mm: [12.0, 8.0] };
    CompoundLens::new(Arc::new(p), &setting).unwrap()
}

#[test]
fn an_off_axis_paraboloid_has_its_focal_length_and_focus() {
    let p = code_v(PARABOLOID);
    assert!(p.object_axis.is_some() && p.notes.iter().any(|n| n.contains("turns by 90.000 degrees")), "{:?}", p.notes);
    let f = first_order(&p);
    // f (1 + tan²(θ/2)) of a parent of 100 mm, turned by θ = 90°.
    assert!((f.efl - 200.0).abs() < 1e-4 && (f.bfl + 200.0).abs() < 1e-4, "{f:?}");
    assert!((2.0 * f.entrance_pupil_radius() - 25.0).abs() < 1e-6, "{f:?}");
    // A paraboloid brings light along its axis to one point: the middle of the film.
    let s = system(&p);
    let n = s.indices(NM);
    for i in 0..60 {
        let at = DVec2::from_angle(i as f64) * (0.2 * i as f64);
        let out = s
            .trace(TracedRay { position: at.extend(-20.0), direction: DVec3::Z }, &n, TraceDirection::ToFilm, Apertures::Clip)
            .unwrap();
        let land = at_plane(&out, s.film_z);
        assert!(land.truncate().length() < 1e-9, "{at} {land}");
    }
}

#[test]
fn where_a_surface_counts_from_changes_nothing() {
    // The mirror of the same place, its z written 10 mm further on and taken back by its element.
    let p = code_v(PARABOLOID);
    let mut q = p.clone();
    q.surfaces[0].gap = Gap::fixed(p.surfaces[0].gap.at(0.0, 0.0) + 10.0);
    q.surfaces[1].gap = Gap::fixed(p.surfaces[1].gap.at(0.0, 0.0) - 10.0);
    q.misalignments[1].decenter[2] -= 10.0;
    let (a, b) = (first_order(&p), first_order(&q));
    for (x, y) in
        [(a.efl, b.efl), (a.exit_pupil_z, b.exit_pupil_z), (a.rear_principal_z, b.rear_principal_z), (a.bfl, b.bfl + 10.0)]
    {
        assert!((x - y).abs() < 1e-6, "{a:?} {b:?}");
    }
    assert!((a.exit_pupil_z - b.exit_pupil_z).abs() < 1e-6 && (a.exit_pupil_radius() / b.exit_pupil_radius() - 1.0).abs() < 1e-6);
    // Scaled it is as sharp.
    let s = system(&p.scaled(2.0).unwrap());
    let out = s
        .trace(
            TracedRay { position: DVec3::new(3.0, -8.0, -20.0), direction: DVec3::Z },
            &s.indices(NM),
            TraceDirection::ToFilm,
            Apertures::Clip,
        )
        .unwrap();
    assert!(at_plane(&out, s.film_z).truncate().length() < 1e-9, "{out:?}");
}

#[test]
fn the_base_ray_lands_in_the_middle_of_a_film_that_is_moved_and_askew() {
    for image in ["SI 0 0; ADE 4", "SI 0 2.5; YDE 1; ADE 4"] {
        let p = code_v(&tilted_sphere(20.0).replace("SI 0 0", image));
        let s = system(&p);
        let out = s
            .trace(
                TracedRay { position: DVec3::ZERO, direction: DVec3::Z },
                &s.indices(NM),
                TraceDirection::ToFilm,
                Apertures::Clip,
            )
            .unwrap();
        let land = at_plane(&out, s.film_z);
        let askew = (-out.direction.z).acos().to_degrees();
        assert!(land.truncate().length() < 1e-9 && (askew - 4.0).abs() < 1e-6, "{image}: {land} {askew}");
    }
}

#[test]
fn an_axis_that_is_no_base_ray_is_an_error() {
    let toml = code_v(PARABOLOID).to_toml();
    let wrong = toml.replace("[object_axis]\ndecenter = [", "[object_axis]\ndecenter = [40, ");
    assert!(wrong != toml);
    let cut = |t: &str| {
        // One number too many after the one put in: the last is left out.
        let at = t.find("[object_axis]").unwrap();
        let (head, tail) = t.split_at(at);
        let end = tail.find(']').and_then(|i| tail[i + 1..].find(']').map(|j| i + 1 + j)).unwrap();
        let comma = tail[..end].rfind(',').unwrap();
        format!("{head}{}{}", &tail[..comma], &tail[end..])
    };
    let e = read(cut(&wrong).as_bytes(), Format::Toml, "wrong.toml").unwrap_err().to_string();
    assert!(e.contains("object_axis") && e.contains("base ray"), "{e}");
    let hooded = format!("{toml}\n[hood]\nlength = 20\n");
    let e = read(hooded.as_bytes(), Format::Toml, "hood.toml").unwrap_err().to_string();
    assert!(e.contains("hood"), "{e}");
}

#[test]
fn a_tilted_spherical_mirror_is_astigmatic_as_coddington_says() {
    // Powers 2 / (R cos i) and 2 cos i / R across and along; the mean of both counts.
    for degrees in [0.5, 5.0, 20.0, 32.0] {
        let f = first_order(&code_v(&tilted_sphere(degrees)));
        let cos = f64::to_radians(degrees).cos();
        let mean = 0.5 * (2.0 / (400.0 * cos) + 2.0 * cos / 400.0);
        assert!((f.efl * mean - 1.0).abs() < 1e-6, "{degrees}: {f:?}");
        assert!((f.bfl.abs() * mean - 1.0).abs() < 1e-6, "{degrees}: {f:?}");
    }
}

#[test]
fn about_an_axis_that_is_the_lens_s_own_first_order_is_the_same() {
    for name in ["double-gauss-50mm", "fisheye-10mm", "kit-zoom-18-55mm"] {
        let plain = embedded(name).unwrap();
        let mut same = plain.clone();
        same.object_axis = Some(ObjectAxis { decenter: [0.0; 3], tilt: [0.0; 3] });
        let (a, b) = (first_order(&plain), first_order(&same));
        let figures = |f: &FirstOrder| {
            [
                f.efl,
                f.bfl,
                f.ffl,
                f.front_principal_z,
                f.rear_principal_z,
                f.entrance_pupil_z,
                f.exit_pupil_z,
                f.entrance_pupil_radius(),
                f.exit_pupil_radius(),
            ]
        };
        for (x, y) in figures(&a).iter().zip(figures(&b)) {
            assert!((x - y).abs() < 1e-4 * (1.0 + x.abs()), "{name}: {a:?} {b:?}");
        }
    }
}

/// A Cassegrain whose axis of the object is turned and moved with all that stands before the film is the Cassegrain.
#[test]
fn mirrors_turned_together_before_the_film_are_the_same_mirrors() {
    let text = "RDM; EPD 40; WL 587.6; YAN 0 0.3; SO 0 1e13; S 0 150; STO; CIR 20; S -400 -130 REFL; CON; K -1; CIR 25; S -200 200 REFL; CON; K -3; CIR 12; SI 0 0";
    let straight = code_v(text);
    let (p, f) = (&straight, first_order(&straight));
    let s = system(p);
    let mut moved = straight.clone();
    let last = moved.surfaces.len() - 1;
    moved.misalignments.push(Misalignment { first: 0, last, decenter: [3.0, -8.0, 5.0], tilt: [25.0, -10.0, 0.0] });
    moved.object_axis = Some(ObjectAxis { decenter: [3.0, -8.0, 5.0], tilt: [25.0, -10.0, 0.0] });
    let g = first_order(&moved);
    assert!((f.efl / g.efl - 1.0).abs() < 1e-6 && (f.entrance_pupil_z - g.entrance_pupil_z).abs() < 1e-4, "{f:?} {g:?}");
    // A ray of the object's space leaves the moved mirrors as it leaves the others, moved with them.
    let t = system(&moved);
    let (n, frame) = (s.indices(NM), t.object_axis.as_ref().unwrap().0);
    for i in 0..20 {
        let at = DVec2::from_angle(i as f64) * (10.0 + 0.4 * i as f64);
        let ray = TracedRay { position: at.extend(-10.0), direction: DVec3::new(0.003, -0.002, 1.0).normalize() };
        let (a, b) = (
            s.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip),
            t.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip),
        );
        let (Ok(a), Ok(b)) = (a, b) else { panic!("{i}: {at}") };
        assert!((frame.transform_point3(a.position) - b.position).length() < 1e-9, "{i}");
        assert!((frame.transform_vector3(a.direction) - b.direction).length() < 1e-12, "{i}");
        let back = t
            .trace(
                TracedRay { position: b.position + b.direction, direction: -b.direction },
                &n,
                TraceDirection::ToObject,
                Apertures::Clip,
            )
            .unwrap();
        assert!((back.direction + ray.direction).length() < 1e-12, "{i}");
        assert!((back.position - ray.position).cross(ray.direction).length() < 1e-9, "{i}");
    }
}

#[test]
fn packets_take_the_axis_of_the_object_as_the_plain_trace_does() {
    let s = system(&code_v(PARABOLOID));
    let n = s.indices(NM);
    let ray = |i: usize| TracedRay {
        position: (DVec2::from_angle(i as f64) * (0.4 * i as f64)).extend(-30.0),
        direction: DVec3::new(0.002 * i as f64, -0.01, 1.0).normalize(),
    };
    let through = traced_alike(&s, &n, ray);
    assert!(through.len() > LANES / 2, "{}", through.len());
    // And back.
    let mut packet = Packet::default();
    for (i, at_film) in &through {
        packet.set(*i, at_film.position.to_array(), (-at_film.direction).to_array());
    }
    let mask = Batch::new(&s).trace(&mut packet, &Indices::uniform(&n), TraceDirection::ToObject);
    for (i, _) in through.into_iter().filter(|(i, _)| mask >> i & 1 == 1) {
        let back = ray_of(&packet, i);
        assert!((back.direction + ray(i).direction).length() < 1e-11, "{i}");
        assert!((back.position - ray(i).position).cross(back.direction).length() < 1e-9, "{i}");
    }
}

#[test]
fn a_field_beside_the_axis_of_its_mirrors_is_the_middle_of_the_picture() {
    // A paraboloid used 4 degrees off its axis, its stop at its focus: the fields of 3 to 5 degrees become -1 to 1.
    let text = "RDM; EPD 10; WL 587.6; YAN 3 4 5; SO 0 1e13; S 0 100; STO; S -200 -100 REFL; CON; K -1; SI 0 0; YDE -6.99";
    let p = code_v(text);
    assert_eq!(p.usage.field_angles_deg, [-1.0, 0.0, 1.0]);
    let s = system(&p);
    let bench = Bench::at_infinity(&s);
    // Light of the middle field lands in the middle, and what comes from above below.
    let heights = [-1.0, 0.0, 1.0].map(|field| {
        let beam = bench.beam(field, NM).unwrap();
        at_plane(&beam.image, s.film_z).y
    });
    let scale = first_order(&p).efl * 1f64.to_radians();
    assert!(heights[1].abs() < 1e-9, "{heights:?}");
    for (k, side) in [(0, -1.0), (2, 1.0)] {
        assert!((heights[k] / (side * scale) - 1.0).abs() < 0.05, "{heights:?} {scale}");
    }
}

#[test]
fn lenses_with_an_axis_of_the_object_come_back_from_files() {
    for p in [code_v(PARABOLOID), code_v(&tilted_sphere(20.0))] {
        for format in [Format::Toml, Format::Zemax, Format::CodeV] {
            let written = match format {
                Format::Zemax => write(&p, State::default(), ExportFormat::Zemax).unwrap().text,
                Format::CodeV => write(&p, State::default(), ExportFormat::CodeV).unwrap().text,
                _ => p.to_toml(),
            };
            let back = read(written.as_bytes(), format, "back").unwrap();
            let (a, b) = (system(&p), system(&back));
            let (na, nb) = (a.indices(NM), b.indices(NM));
            assert!((first_order(&p).efl / first_order(&back).efl - 1.0).abs() < 1e-6, "{format:?}");
            for i in 0..20 {
                let at = DVec2::from_angle(i as f64) * (0.2 * i as f64);
                let ray = TracedRay { position: at.extend(-10.0), direction: DVec3::new(0.004, 0.003, 1.0).normalize() };
                let land = |s: &System, n: &[f64]| {
                    let out = s.trace(ray, n, TraceDirection::ToFilm, Apertures::Ignore).unwrap();
                    at_plane(&out, s.film_z).truncate()
                };
                assert!((land(&a, &na) - land(&b, &nb)).length() < 1e-6, "{format:?} {i}: {} {}", land(&a, &na), land(&b, &nb));
            }
        }
    }
}

#[test]
fn photographs_look_along_the_base_ray() {
    for text in [PARABOLOID.to_owned(), tilted_sphere(20.0)] {
        let lens = lens(code_v(&text), Focus::Infinity);
        // The middle of the film looks straight ahead; what is above on the film is below in the scene, by the focal length.
        let middle = lens.chief_ray(DVec2::ZERO).unwrap();
        assert!((middle.direction + DVec3::Z).length() < 3e-3, "{text}: {middle:?}");
        let efl = lens.focal_length().0;
        for film in [DVec2::new(4.0, 0.0), DVec2::new(0.0, 3.0), DVec2::new(-4.0, -3.0)] {
            let ray = lens.chief_ray(film).unwrap();
            let slope = ray.direction.truncate() / -ray.direction.z;
            // Both sections differ by the square of the cosine of the tilt, 0.88.
            assert!((slope * efl + film).length() < 0.1 * film.length(), "{text}: {film} {slope} {efl}");
        }
        // Rays of the camera come back to where they started, with their densities and weights.
        let (mut scratch, mut exits, mut back) = (Scratch::default(), ExitRays::default(), ExitRays::default());
        let mut samples = Samples::default();
        let lanes = samples.film.len();
        let part = |k: usize, step: f64| (k as f64 * step).fract();
        for i in 0..lanes {
            samples.film[i] = DVec2::new(12.0 * (part(i, 0.7549) - 0.5), 8.0 * (part(i, 0.5698) - 0.5));
            samples.pupil[i] = [part(i, 0.8192) as f32, part(i, 0.6710) as f32];
        }
        let collects = |_: usize, at: DVec2| at.x.abs() <= 6.0 && at.y.abs() <= 4.0;
        lens.trace_to_scene(&samples, collects, &mut scratch, &mut exits);
        let mut rays = EntryRays { nm: samples.nm, ..EntryRays::default() };
        for i in 0..lanes {
            let [o, d] = [exits.origin[i], exits.direction[i]].map(|v| glam::Vec3::from_array(v).as_dvec3());
            (rays.origin[i], rays.direction[i]) = (o + d * 50.0, d.normalize());
        }
        lens.trace_to_film(&rays, collects, &mut scratch, &mut back);
        let both = exits.passed & back.passed;
        assert!(both.count_ones() as usize > lanes / 2, "{text}: {:b} {:b}", exits.passed, back.passed);
        for i in (0..lanes).filter(|i| both >> i & 1 == 1) {
            let apart = glam::Vec2::from_array(back.film_points[i][0]).as_dvec2() - samples.film[i];
            assert!(apart.length() < 2e-3 && (back.weight[i][0] / exits.weight[i][0] - 1.0).abs() < 0.02, "{text} {i}: {apart}");
        }
    }
}

#[test]
fn what_needs_an_axis_is_refused() {
    let lens = lens(code_v(&tilted_sphere(10.0)), Focus::Distance(Millimeters(5000.0)));
    assert!(lens.tilted([0.1, 0.0]).unwrap_err().to_string().contains("no axis"));
    let closer = lens.refocused(Focus::Distance(Millimeters(2000.0))).unwrap();
    // 1/s' = 1/f − 1/s with the mean power: the film goes back by f²/(s − f).
    let moved = (closer.system().film_z - lens.system().film_z).abs();
    let f = lens.focal_length().0;
    let expected = f * f / (2000.0 - f) - f * f / (5000.0 - f);
    assert!((moved / expected - 1.0).abs() < 0.02, "{moved} {expected}");
}

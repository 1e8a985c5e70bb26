//! Autofocus against the traced best focus.

use crate::common::{FILM, Pattern, cards, lens};
use diopter::camera::look_at;
use diopter::expose::ProgressReporter;
use diopter::focus::{Autofocus, Failure, Measure, Method, Motor, Priority, Report, View, autofocus, zones_named};
use diopter::lens::{Focus, Lens};
use diopter::scene::Scene;
use diopter::sensor::{Reading, Sensor};
use diopter::{Camera, CameraMotion, Film, Settings};
use glam::Vec3;
use std::sync::atomic::AtomicBool;

/// Film displacement of the smallest traced spot of a point on the axis, mm.
fn traced(lens: &Lens, distance_m: f64) -> f64 {
    match lens {
        Lens::Compound(l) => {
            let far = l.refocused(Focus::Infinity).unwrap().system().film_z;
            l.refocused(Focus::at_mm(1000.0 * distance_m)).unwrap().system().film_z - far
        }
        _ => lens.refocused(Focus::at_mm(1000.0 * distance_m)).unwrap().extension().0,
    }
}

fn focus(scene: &Scene, lens: &Lens, af: &Autofocus) -> Report {
    let camera = Camera {
        lens: lens.clone(),
        film: Film::new(FILM[0], FILM[1], 960, 640),
        motion: CameraMotion::still(look_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y).unwrap()),
    };
    let (sensor, cancel) = (Sensor::named("canon-5d-mark-iv").unwrap(), AtomicBool::new(false));
    let watch = ProgressReporter { cancel: &cancel, progress: &|_| () };
    let settings = Settings::new(64);
    let reading = Reading::new(100.0, 1);
    let view =
        View { scene, camera: &camera, sensor: &sensor, reading: &reading, settings: &settings, filter: 1.0, watch: &watch };
    autofocus(&view, af).unwrap()
}

fn settings(method: Method) -> Autofocus {
    Autofocus { method, ..Autofocus::new(FILM[0].hypot(FILM[1])) }
}

const DISTANCES: [f64; 10] = [0.5, 0.7, 1.0, 1.5, 2.2, 3.5, 6.0, 12.0, 40.0, 1e5];

/// Lenses and the apertures they are tried at.
const LENSES: [(&str, [f64; 3]); 4] = [
    ("thin", [2.0, 4.0, 8.0]),
    ("double-gauss-50mm", [2.0, 4.0, 8.0]),
    ("wide-22mm", [4.0, 5.6, 8.0]),
    ("telephoto-250mm", [5.6, 5.6, 8.0]),
];

/// Thirty placements: ten distances, three of the lenses at each, a texture in turn. Name, lens, distance, scene.
fn placements(ev100: f64, patterns: [Pattern; 3]) -> Vec<(String, Lens, f64, Scene)> {
    let mut all = Vec::new();
    for (k, distance) in DISTANCES.into_iter().enumerate() {
        for j in 0..3 {
            // A telephoto lens does not focus as near as the others.
            let (name, stops) = LENSES[if distance < 1.5 { j } else { (j + k) % 4 }];
            let (n, pattern) = (stops[(k + j) % 3], patterns[(k + 2 * j) % 3]);
            let lens = lens(name, n, Focus::Infinity);
            let scene = cards(&[(pattern, distance, [-1.2, 1.2, -1.2, 1.2])], ev100, lens.focal_length().0);
            all.push((format!("{name} f/{n} {distance} m {pattern:?}"), lens, distance, scene));
        }
    }
    all
}

/// How far from the traced best focus, in depths of focus 2 N c.
fn off(report: &Report, lens: &Lens, af: &Autofocus, distance: f64) -> f64 {
    (report.extension_mm - traced(lens, distance)) / (2.0 * lens.f_number() * af.circle_mm)
}

#[test]
fn contrast_lands_within_a_quarter_of_the_depth_of_focus() {
    let af = settings(Method::Contrast);
    let mut beyond = Vec::new();
    for (what, lens, distance, scene) in placements(8.0, [Pattern::Rough, Pattern::Leaves, Pattern::Checker]) {
        let report = focus(&scene, &lens, &af);
        let off = off(&report, &lens, &af, distance);
        assert!(report.failure().is_none() && off.abs() < 0.4, "{what}: {off:.3} depths, {:?}", report.failure());
        if off.abs() >= 0.25 {
            beyond.push(format!("{what}: {off:.3} depths"));
        }
    }
    // A wide lens before a checker is focused by a few pixels: six seeds scatter by 0.12 depths there, so one of thirty may lie beyond.
    assert!(beyond.len() <= 1, "{beyond:#?}");
}

#[test]
fn phase_lands_there_in_two_moves() {
    let af = settings(Method::Phase);
    for ev100 in [5.0, 10.0] {
        let (mut quick, mut all, mut squares) = (0, 0, Vec::new());
        for (what, lens, distance, scene) in placements(ev100, [Pattern::Rough, Pattern::Leaves, Pattern::Shelf]) {
            let report = focus(&scene, &lens, &af);
            let off = off(&report, &lens, &af, distance);
            all += 1;
            // What is not flagged is right. With its spherical aberration the double Gauss at f/2 shows halves of the pupil alike 0.2 depths before the smallest spot.
            assert!(report.failure().is_some() || off.abs() < 0.27, "{what}: {off:.3} depths");
            squares.extend(report.failure().is_none().then_some(off * off));
            quick += usize::from(report.failure().is_none() && report.zones[0].moves <= 2);
        }
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        println!("EV {ev100}: {quick} of {all} in two moves, {rms:.3} depths off");
        assert!(rms < 0.11, "EV {ev100}: {rms:.3} depths");
        assert!(quick * 10 >= all * 9, "EV {ev100}: {quick} of {all}");
    }
}

#[test]
fn where_phase_fails_contrast_takes_over() {
    let lens = lens("thin", 2.8, Focus::Infinity);
    let scene = cards(&[(Pattern::Lines, 2.0, [-1.2, 1.2, -1.2, 1.2])], 10.0, 50.0);
    let phase = focus(&scene, &lens, &settings(Method::Phase));
    assert!(phase.failure().is_some(), "{phase:?}");
    let af = settings(Method::Hybrid);
    let hybrid = focus(&scene, &lens, &af);
    assert!(hybrid.failure().is_none() && hybrid.zones[0].method == "contrast", "{:?}", hybrid.failure());
    assert!(off(&hybrid, &lens, &af, 2.0).abs() < 0.25);
}

#[test]
fn what_cannot_be_focused_is_said_so() {
    let lens = lens("thin", 2.8, Focus::Infinity);
    let card = |pattern, distance| (pattern, distance, [-1.2, 1.2, -1.2, 1.2]);
    let cases = [
        ("a wall", cards(&[card(Pattern::Wall, 2.0)], 10.0, 50.0), vec![Failure::NoContrast]),
        ("darkness", cards(&[card(Pattern::Rough, 2.0)], -60.0, 50.0), vec![Failure::TooDark, Failure::NoContrast]),
        (
            "a dim card",
            cards(&[card(Pattern::Rough, 2.0)], -14.0, 50.0),
            vec![Failure::TooDark, Failure::NoContrast, Failure::Uncertain],
        ),
        (
            "too near",
            cards(&[card(Pattern::Rough, 0.07)], 10.0, 50.0),
            vec![Failure::TooNear, Failure::NoContrast, Failure::Uncertain],
        ),
    ];
    for (what, scene, allowed) in &cases {
        for method in [Method::Contrast, Method::Phase, Method::Hybrid] {
            let report = focus(scene, &lens, &settings(method));
            let why = report.failure();
            assert!(
                why.is_some() && report.confidence < 0.5,
                "{what} {method:?}: {:?} at {}",
                report.confidence,
                report.extension_mm
            );
            if method == Method::Contrast {
                assert!(why.is_some_and(|w| allowed.contains(&w)), "{what}: {why:?}");
            }
        }
    }
}

#[test]
fn every_measure_and_the_exhaustive_search_find_the_same_place() {
    let lens = lens("thin", 4.0, Focus::Infinity);
    let scene = cards(&[(Pattern::Rough, 3.0, [-1.2, 1.2, -1.2, 1.2])], 10.0, 50.0);
    for measure in [Measure::Sml, Measure::Tenengrad, Measure::Variance] {
        let af = Autofocus { measure, ..settings(Method::Contrast) };
        let report = focus(&scene, &lens, &af);
        assert!(report.failure().is_none() && off(&report, &lens, &af, 3.0).abs() < 0.25, "{measure:?} {:?}", report.failure());
    }
    let af = settings(Method::Exhaustive);
    let slow = focus(&scene, &lens, &af);
    assert!(slow.failure().is_none() && off(&slow, &lens, &af, 3.0).abs() < 0.25, "{}", slow.extension_mm);
    let fast = focus(&scene, &lens, &settings(Method::Contrast));
    assert!(fast.rays * 20 <= slow.rays, "{} of {}", fast.rays, slow.rays);
    // One maximum: the curve rises to it and falls after, but for noise a tenth of it high.
    let curve: Vec<f64> = slow.zones[0].curve.iter().map(|p| p.value).collect();
    let top = (0..curve.len()).max_by(|a, b| curve[*a].total_cmp(&curve[*b])).unwrap();
    let slack = 0.1 * curve[top];
    assert!(curve[..=top].windows(2).all(|w| w[1] > w[0] - slack) && curve[top..].windows(2).all(|w| w[1] < w[0] + slack));
    assert!(slow.zones[0].curve[top].extension_mm > 0.0);
}

#[test]
fn nine_zones_at_three_depths_obey_their_priorities() {
    // A tall card in the left third at 1 m, one in the right third at 8 m, a wall of books at 3 m behind the gap.
    let lens = lens("thin", 4.0, Focus::Infinity);
    let scene = cards(
        &[
            (Pattern::Rough, 1.0, [-1.2, -0.25, -1.2, 1.2]),
            (Pattern::Leaves, 3.0, [-0.4, 0.25, -1.2, 1.2]),
            (Pattern::Rough, 8.0, [0.1, 1.2, -1.2, 1.2]),
        ],
        10.0,
        50.0,
    );
    let zones = zones_named("nine").unwrap();
    for (priority, distance) in
        [(Priority::Closest, 1.0), (Priority::Farthest, 8.0), (Priority::Median, 3.0), (Priority::Centre, 3.0)]
    {
        let af = Autofocus { zones: zones.clone(), priority, ..settings(Method::Hybrid) };
        let report = focus(&scene, &lens, &af);
        assert!(off(&report, &lens, &af, distance).abs() < 0.25, "{priority:?}: {:?} m", report.distance_m);
    }
}

#[test]
fn a_motor_with_play_and_steps_gets_there_too() {
    let lens = lens("thin", 2.8, Focus::Infinity);
    let scene = cards(&[(Pattern::Rough, 1.5, [-1.2, 1.2, -1.2, 1.2])], 10.0, 50.0);
    for method in [Method::Contrast, Method::Hybrid] {
        let motor = Motor { step_mm: 0.01, backlash_mm: 0.04, speed_mm_s: 20.0 };
        let af = Autofocus { motor, ..settings(method) };
        let report = focus(&scene, &lens, &af);
        assert!(report.failure().is_none() && off(&report, &lens, &af, 1.5).abs() < 0.25, "{method:?} {:?}", report.failure());
        assert!(report.travelled_mm > 1.0 && report.seconds > report.travelled_mm / 20.0);
    }
}

//! Diffractive surfaces against the grating equation, closed forms of diffractive lenses, and the scalar theory of kinoforms.

use diopter_lens::analysis::Bench;
use diopter_lens::batch::{double, single};
use diopter_lens::glass::{C_NM, D_NM, F_NM};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::prescription::read_toml;
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::trace::at_plane;
use diopter_lens::{Prescription, State, System};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

fn lens(surfaces: &str) -> Prescription {
    read_toml(&format!("name = \"x\"\nsurfaces = [\n{surfaces}]\n"), "x.toml").unwrap_or_else(|e| panic!("{e}"))
}

fn efl(p: &Prescription, nm: f64) -> f64 {
    let system = System::at(p, State::default());
    FirstOrder::of(&system, &system.indices(nm)).efl
}

/// A ray through a place of the first vertex's plane.
fn ray(x: f64, y: f64, dx: f64, dy: f64) -> TracedRay {
    TracedRay { position: DVec3::new(x, y, -5.0), direction: DVec3::new(dx, dy, 1.0).normalize() }
}

#[test]
fn rays_obey_the_grating_equation_on_planes_mirrors_and_curves() {
    let nm = 632.8;
    for (order, lines, glass) in [(1, 300.0, "1.5"), (-1, 600.0, "1.7"), (2, 150.0, "1.33")] {
        let p = lens(&format!(
            "{{ stop = true, gap = 10, glass = \"{glass}\", semi_diameter = 30, diffractive = {{ order = {order}, lines_per_mm = {lines} }} }},\n\
             {{ gap = 20, semi_diameter = 90 }},\n"
        ));
        let system = System::at(&p, State::default());
        let n = system.indices(nm);
        for (dx, dy) in [(0.0, 0.0), (0.0, 0.3), (-0.1, -0.2)] {
            let start = ray(0.5, 0.5, dx, dy);
            let mut after = DVec3::ZERO;
            system.trace_part(start, &n, TraceDirection::ToFilm, Apertures::Ignore, 0..1, |e| after = e.direction).unwrap();
            // n' sin θ' = n sin θ + m λ / d along y; nothing along x.
            let shift = f64::from(order) * nm * 1e-6 * lines;
            assert!((n[1] * after.y - start.direction.y - shift).abs() < 1e-12, "{order} {dx} {dy}: {after}");
            assert!((n[1] * after.x - start.direction.x).abs() < 1e-12 && (after.length() - 1.0).abs() < 1e-12);
        }
    }
    // A mirror under Littrow's condition, 2 sin θ = m λ / d, throws light back where it came from.
    let lines = 500.0;
    let sine = 0.5 * nm * 1e-6 * lines;
    let p = lens(&format!(
        "{{ stop = true, mirror = true, gap = -10, semi_diameter = 30, diffractive = {{ order = 1, lines_per_mm = {lines} }} }},\n"
    ));
    let system = System::at(&p, State::default());
    let start = TracedRay { position: DVec3::new(0.0, 0.0, -5.0), direction: DVec3::new(0.0, -sine, (1.0 - sine * sine).sqrt()) };
    let out = system.trace(start, &system.indices(nm), TraceDirection::ToFilm, Apertures::Ignore).unwrap();
    assert!((out.direction + start.direction).length() < 1e-12, "{}", out.direction);
    // On a sphere lines stand as seen along the axis: what changes along the surface is the projected line vector.
    let p = lens(
        "{ radius = 40, stop = true, gap = 10, glass = \"1.6\", semi_diameter = 15, diffractive = { order = -2, lines_per_mm = 80 } },\n\
         { gap = 20, semi_diameter = 90 },\n",
    );
    let system = System::at(&p, State::default());
    let n = system.indices(nm);
    let start = ray(6.0, -7.0, 0.05, 0.1);
    let (mut after, mut point) = (DVec3::ZERO, DVec3::ZERO);
    system
        .trace_part(start, &n, TraceDirection::ToFilm, Apertures::Ignore, 0..1, |e| (after, point) = (e.direction, e.point))
        .unwrap();
    let normal = (DVec3::new(0.0, 0.0, 40.0) - point).normalize();
    let change = after * n[1] - start.direction * n[0] - DVec3::Y * (-2.0 * nm * 1e-6 * 80.0);
    assert!(change.cross(normal).length() < 1e-12, "{change}");
    // An order that does not exist blocks.
    let p = lens("{ stop = true, gap = 10, semi_diameter = 30, diffractive = { order = 1, lines_per_mm = 2000 } },\n");
    let system = System::at(&p, State::default());
    assert!(system.trace(ray(0.0, 0.0, 0.0, 0.0), &system.indices(nm), TraceDirection::ToFilm, Apertures::Ignore).is_err());
}

#[test]
fn a_diffractive_lens_has_the_focal_length_of_its_phase() {
    // Path m λ A r² / 2π = −r² / 2f: f = −π / (m λ A).
    let (nm0, f0) = (550.0, 80.0);
    let a = -PI / (nm0 * 1e-6 * f0);
    for (order, norm) in [(1, 1.0), (-3, 5.0)] {
        let p = lens(&format!(
            "{{ stop = true, gap = 60, semi_diameter = 4, diffractive = {{ order = {order}, phase = {{ radius = {norm:?}, radial = [{:e}] }} }} }},\n",
            a * norm * norm / f64::from(order)
        ));
        for nm in [450.0, 550.0, 650.0] {
            // The focal length goes with 1/λ.
            assert!((efl(&p, nm) / (f0 * nm0 / nm) - 1.0).abs() < 1e-12, "{order} {nm}");
        }
    }
    // The phase of a perfect lens, −2π/λ (√(r² + f²) − f), as powers up to r¹²: parallel light meets in a point, and paths are the same.
    let f = f0;
    let series = [0.5, -1.0 / 8.0, 1.0 / 16.0, -5.0 / 128.0, 7.0 / 256.0, -21.0 / 1024.0];
    let norm = 8.0f64;
    let radial: Vec<String> = series
        .iter()
        .enumerate()
        .map(|(i, c)| format!("{:e}", -TAU / (nm0 * 1e-6) * c * norm.powi(2 * (i as i32 + 1)) / f.powi(2 * i as i32 + 1)))
        .collect();
    let p = lens(&format!(
        "{{ stop = true, gap = {f0}, semi_diameter = 8, diffractive = {{ phase = {{ radius = {norm:?}, radial = [{}] }} }} }},\n",
        radial.join(", ")
    ));
    let system = System::at(&p, State::default());
    let bench = Bench::at_infinity(&system);
    let spot = bench.spot(0.0, nm0, nm0, 20, 0.0).unwrap();
    // The next term, 33/2048 r¹⁴/f¹³, moves the rim's ray by 80 · 14 · 33/2048 (0.1)¹³ = 2e-12 mm.
    assert!(spot.rms < 1e-10, "{}", spot.rms);
    let fan = bench.fan(0.0, nm0, nm0, 8).unwrap();
    // In waves: 1e-12 mm over 550 nm, and the rounding of 80 mm.
    assert!(fan.tangential.iter().all(|p| p.opd.abs() < 1e-6), "{:?}", fan.tangential.last());
}

#[test]
fn a_hybrid_singlet_is_an_achromat_by_the_abbe_number_of_diffraction() {
    // V of diffraction between F and C: λd / (λF − λC) = −3.45 (Stone & George 1988, Appl. Opt. 27, 2960).
    let v_diffractive = D_NM / (F_NM - C_NM);
    // Theirs is of wavelengths to four digits.
    assert!((v_diffractive + 3.452).abs() < 2e-3);
    let glass = diopter_lens::glass::Glass::parse("N-BK7").unwrap();
    let (nd, v) = (glass.index(D_NM), glass.abbe());
    let f = 100.0;
    // Powers of an achromat of two parts: φ₁ = φ V₁ / (V₁ − V₂).
    let refractive = v / (v - v_diffractive) / f;
    let radius = (nd - 1.0) / refractive;
    let phase = -PI / (D_NM * 1e-6) * (1.0 / f - refractive);
    // Thin: a micrometre of glass.
    let hybrid = |phase: f64| {
        lens(&format!(
            "{{ radius = {radius:e}, gap = 0.001, glass = \"N-BK7\", semi_diameter = 0.2 }},\n\
             {{ stop = true, gap = 100, semi_diameter = 0.2, diffractive = {{ phase = {{ radius = 1, radial = [{phase:e}] }} }} }},\n"
        ))
    };
    let achromat = hybrid(phase);
    let [d, shift] = [efl(&achromat, D_NM), efl(&achromat, F_NM) - efl(&achromat, C_NM)];
    // A micrometre of thickness moves the focal length by 1e-5 of itself.
    assert!((d / f - 1.0).abs() < 2e-5, "{d}");
    assert!(shift.abs() < 1e-4 * f / v, "{shift}");
    // The same glass alone has f / V, 1.56 mm.
    let alone = hybrid(0.0);
    let shift = efl(&alone, C_NM) - efl(&alone, F_NM);
    assert!((shift / (efl(&alone, D_NM) / v) - 1.0).abs() < 0.01, "{shift}");
}

#[test]
fn light_of_a_kinoform_goes_where_scalar_theory_says() {
    let with = |levels: &str| {
        lens(&format!(
            "{{ stop = true, gap = 1, glass = \"N-BK7\", semi_diameter = 5, diffractive = {{ order = 1, phase = {{ radius = 1, radial = [-10] }}, blaze_nm = 550{levels} }} }},\n\
             {{ gap = 60, semi_diameter = 6 }},\n"
        ))
    };
    let smooth = System::at(&with(""), State::default());
    let n = |nm: f64| smooth.glasses[1].index(nm);
    let sinc2 = |x: f64| if x == 0.0 { 1.0 } else { ((PI * x).sin() / (PI * x)).powi(2) };
    for nm in [400.0, 486.1, 550.0, 656.3] {
        let waves = 550.0 / nm * (n(nm) - 1.0) / (n(550.0) - 1.0);
        let mut sum = 0.0;
        for order in -40..=40 {
            let found = smooth.diffraction_efficiency(0, order, nm);
            assert!((found - sinc2(waves - f64::from(order))).abs() < 1e-12, "{order} {nm}");
            sum += found;
        }
        // All orders together: Σ sinc² = 1; beyond ±40 lie 2 / (40 π²) at most.
        assert!(sum > 0.994 && sum < 1.0 + 1e-12, "{nm}: {sum}");
    }
    assert!((smooth.diffraction_efficiency(0, 1, 550.0) - 1.0).abs() < 1e-12);
    // Steps: 40.5, 81.1, 95.0 and 98.7 % for 2, 4, 8 and 16 (Swanson 1989, Table 1).
    for (levels, expected) in [(2, 0.405), (4, 0.811), (8, 0.950), (16, 0.987)] {
        let steps = System::at(&with(&format!(", levels = {levels}")), State::default());
        assert!((steps.diffraction_efficiency(0, 1, 550.0) - expected).abs() < 6e-4, "{levels}");
        // A staircase sends what is left into orders 1 ± N, 1 ± 2N, ...; the sum over all is 1 again.
        let sum: f64 = (-400..=400).map(|order| steps.diffraction_efficiency(0, order, 480.0)).sum();
        assert!((sum - 1.0).abs() < 5e-3, "{levels}: {sum}");
    }
    // Both traces lose the same light.
    let (nm, way) = (430.0, TraceDirection::ToFilm);
    let indices = smooth.indices(nm);
    let batch = double::Batch::new(&smooth);
    let mut packet = double::Packet::default();
    for i in 0..double::LANES {
        let r = ray(0.2 * i as f64 - 1.5, 0.7, 0.01, 0.02);
        packet.set(i, r.position.to_array(), r.direction.to_array());
    }
    let mask = batch.trace_light(&mut packet, &double::Indices::uniform(&indices), &[nm; double::LANES], way);
    assert_eq!(mask, (1 << double::LANES) - 1);
    for i in 0..double::LANES {
        let plain = smooth.transmittance(ray(0.2 * i as f64 - 1.5, 0.7, 0.01, 0.02), &indices, nm, way).unwrap();
        assert!((packet.fraction[i] - plain).abs() < 1e-10, "{i}: {} {plain}", packet.fraction[i]);
        // Two bare surfaces leave 0.958² of it, and a millimetre of glass next to all.
        let order = smooth.diffraction_efficiency(0, 1, nm);
        assert!(plain < order && plain > 0.85 * order);
    }
}

#[test]
fn packets_of_both_precisions_follow_phases_freeforms_and_facets_as_the_plain_trace() {
    let p = lens(
        "{ radius = 60, conic = -0.5, asphere = { 4 = 1e-6 }, gap = 5, glass = \"1.6\", semi_diameter = 12, departure = { radius = 12, radial = [0.05], xy = { x2 = 0.1, x1y1 = -0.05, y3 = 0.04 }, noll = [0, 0.01, 0, 0.02, 0.01, -0.03, 0.02, 0.01, 0.01, 0.005, 0.01], fringe = [0, 0, 0.01, 0, 0.02, 0, 0.01, 0, -0.01] } },\n\
         { stop = true, radius = -90, gap = 8, semi_diameter = 11, diffractive = { order = 2, phase = { radius = 10, radial = [-300, 40], xy = { x1 = 80, y2 = 30 }, noll = [0, 0, 0, 0, 20, 10] } } },\n\
         { radius = 70, conic = -1, fresnel = true, gap = 4, glass = \"1.5\", semi_diameter = 12, tilt_deg = [2, -1, 15] },\n\
         { gap = 30, semi_diameter = 14 },\n\
         { mirror = true, radius = -300, gap = -40, semi_diameter = 40, diffractive = { order = -1, phase = { radius = 20, radial = [100], fringe = [0, 30, -20] } } },\n",
    );
    let system = System::at(&p, State::default());
    assert!(!system.is_rotational());
    let start = |i: usize| {
        ray(1.2 * (i % 8) as f64 - 4.0, 0.9 * (i / 4) as f64 - 3.0, 0.01 * (i % 5) as f64, -0.02 + 0.01 * (i % 3) as f64)
    };
    for nm in [450.0, 640.0] {
        let n = system.indices(nm);
        let (wide, narrow) = (double::Batch::new(&system), single::Batch::new(&system));
        let (mut a, mut b) = (double::Packet::default(), single::Packet::default());
        for i in 0..double::LANES {
            let r = start(i);
            a.set(i, r.position.to_array(), r.direction.to_array());
        }
        for i in 0..single::LANES {
            let r = start(i);
            b.set(i, r.position.to_array().map(|v| v as f32), r.direction.to_array().map(|v| v as f32));
        }
        // Wavelength by lane, too.
        let (mut na, mut nb) = (double::Indices::default(), single::Indices::default());
        wide.indices(&[nm; double::LANES], &mut na);
        narrow.indices(&[nm as f32; single::LANES], &mut nb);
        let (ma, mb) = (wide.trace(&mut a, &na, TraceDirection::ToFilm), narrow.trace(&mut b, &nb, TraceDirection::ToFilm));
        let mut through = 0;
        for i in 0..single::LANES {
            let mut path = 0.0;
            let plain = system.trace_with(start(i), &n, TraceDirection::ToFilm, Apertures::Clip, |e| path += e.path);
            assert_eq!(plain.is_ok(), mb >> i & 1 == 1, "{nm} {i}");
            let Ok(plain) = plain else { continue };
            through += 1;
            // Floats: seven digits of some tens of millimetres, and of slopes of powers.
            let found = DVec3::new(b.x[i] as f64, b.y[i] as f64, b.z[i] as f64);
            let direction = DVec3::new(b.dx[i] as f64, b.dy[i] as f64, b.dz[i] as f64);
            assert!((found - plain.position).length() < 1e-4 && (direction - plain.direction).length() < 1e-5, "{nm} {i}");
            if i < double::LANES {
                assert!(ma >> i & 1 == 1);
                let found = DVec3::new(a.x[i], a.y[i], a.z[i]);
                assert!((found - plain.position).length() < 1e-9, "{nm} {i}: {found} {}", plain.position);
                assert!((a.path[i] - path).abs() < 1e-9, "{nm} {i}: {} {path}", a.path[i]);
            }
            // And back along the same way.
            let turned = TracedRay { position: plain.position + plain.direction, direction: -plain.direction };
            let back = system.trace(turned, &n, TraceDirection::ToObject, Apertures::Ignore).unwrap();
            assert!((back.direction + start(i).direction).length() < 1e-9, "{nm} {i}");
            assert!((at_plane(&back, -5.0) - start(i).position).length() < 1e-7, "{nm} {i}");
        }
        assert!(through > 20, "{through}");
    }
}

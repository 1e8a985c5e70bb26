//! Real lenses in front of the film: light counted right, nothing left out, little drawn in vain.

use diopter_lens::analysis::Bench;
use diopter_lens::batch::{double, single};
use diopter_lens::compound::{ExitRays, Samples, Scratch, Setting};
use diopter_lens::prescription::read_toml;
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::{CompoundLens, Focus, Iris, State, System, embedded, embedded_names};
use glam::{DVec2, DVec3};
use std::sync::Arc;

const CLASSIC: [(&str, [f64; 2]); 4] = [
    ("wide-22mm", [36.0, 24.0]),
    ("double-gauss-50mm", [36.0, 24.0]),
    ("telephoto-250mm", [36.0, 24.0]),
    // Its picture is a disk on this film, dark around.
    ("fisheye-10mm", [36.0, 24.0]),
];

fn set(name: &str, f_number: Option<f64>, film_mm: [f64; 2], iris: Option<Iris>) -> CompoundLens {
    let setting = Setting { focal_length: None, f_number, focus: Focus::Infinity, iris, film_mm };
    CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Mean weight of a film point over `side`² stratified samples of the packet path, all four wavelengths at `nm`.
fn irradiance(lens: &CompoundLens, film: DVec2, nm: f32, side: usize) -> (f64, f64) {
    let (mut samples, mut out, mut scratch) = (Samples::default(), ExitRays::default(), Scratch::default());
    samples.nm = [[nm; 4]; single::LANES];
    let (mut sum, mut passed) = (0.0, 0);
    for chunk in 0..side * side / single::LANES {
        for i in 0..single::LANES {
            let k = chunk * single::LANES + i;
            samples.film[i] = film;
            samples.pupil[i] = [(k % side) as f32 + 0.5, (k / side) as f32 + 0.5].map(|v| v / side as f32);
        }
        lens.trace_to_scene(&samples, |_, film| film.abs().max_element() <= 100.0, &mut scratch, &mut out);
        passed += out.passed.count_ones();
        sum += out.weight.iter().map(|w| w[0] as f64).sum::<f64>();
    }
    (sum / (side * side) as f64, passed as f64 / (side * side) as f64)
}

/// The same by brute force: a grid over everything the last rim can let through, plain trace, no pupil table.
fn brute_force(lens: &CompoundLens, film: DVec2, nm: f64, side: usize) -> f64 {
    let system = lens.system();
    let n = system.indices(nm);
    let last = system.surfaces.last().unwrap();
    let z = last.z + last.profile.sag(0.0, last.semi_diameter * 0.999_999).unwrap().max(0.0);
    let distance = system.film_z - z;
    // Rays through a rim behind the vertex may cross the vertex plane outside of it.
    let half = last.semi_diameter * 1.3;
    let cell = (2.0 * half / side as f64).powi(2);
    let mut sum = 0.0;
    for i in 0..side * side {
        let p = DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5) * (2.0 * half / side as f64) - half;
        let d = (p - film).extend(-distance);
        let ray = TracedRay { position: film.extend(system.film_z), direction: d.normalize() };
        if let Ok(fraction) = system.transmittance(ray, &n, nm, TraceDirection::ToObject) {
            // dω cosθ = dA cos⁴θ / distance²
            sum += fraction * cell * ray.direction.z.powi(4) / (distance * distance);
        }
    }
    sum
}

/// The film is close to a large last surface, of which a small pupil fills little: from f/8 on, the search for it had gone past it over a third of the film.
#[test]
fn a_small_pupil_is_found_from_everywhere_on_a_film_close_to_the_lens() {
    for f_number in [8.0, 11.0, 16.0] {
        let lens = set("phone-5.6mm-f3.5", Some(f_number), [5.76, 3.84], None);
        let at = |k: i32| irradiance(&lens, DVec2::from_angle(0.5) * (f64::from(k) * 0.05), 587.6, 32);
        let light: Vec<(f64, f64)> = (0..68).map(at).collect();
        for (k, pair) in light.windows(2).enumerate() {
            let ([(before, _), (here, passed)], r) = ([pair[0], pair[1]], 0.05 * (k + 1) as f64);
            // A step of 0.05 mm is a hundredth of the focal length: cos⁴ and the rims take away a few parts in a hundred there.
            assert!(
                (here / before - 1.0).abs() < 0.1 && passed > 0.6,
                "f/{f_number}, {r:.2} mm: {before:.2e}, {here:.2e}, {passed}"
            );
        }
        // The bench looks for its pupils in its own way.
        let bench = Bench::at_infinity(lens.system());
        for height in [0.0, 1.0, 2.2, 2.4, 2.6, 2.8, 3.3] {
            let expected = bench.illumination(height, 587.6).with_losses;
            let (found, _) = irradiance(&lens, DVec2::new(0.0, height), 587.6, 64);
            assert!((found / expected - 1.0).abs() < 0.02, "f/{f_number}, {height} mm: {found:.3e}, {expected:.3e}");
        }
    }
}

#[test]
fn film_irradiance_is_that_of_brute_force() {
    for (name, film) in [CLASSIC[2], CLASSIC[1], CLASSIC[3]] {
        for f_number in [None, Some(8.0)] {
            let lens = set(name, f_number, film, None);
            let half = 0.5 * film[0].hypot(film[1]);
            let mut on_axis = 0.0;
            for i in 0..20 {
                let height = half * 0.98 * i as f64 / 19.0;
                // Not along an axis of the grid.
                let at = DVec2::from_angle(0.3) * height;
                let (table, passed) = irradiance(&lens, at, 550.0, 128);
                let brute = brute_force(&lens, at, 550.0, if f_number.is_some() { 1100 } else { 500 });
                if i == 0 {
                    on_axis = brute;
                }
                println!(
                    "{name} f/{:.2} {height:6.2} mm: {table:.6e} {brute:.6e} {:+.3} % passed {passed:.3}",
                    lens.f_number(),
                    (table / brute - 1.0) * 100.0
                );
                // Half a per cent of the place, where at least a thousandth of the axis is left.
                assert!((table - brute).abs() < 5e-3 * brute.max(1e-3 * on_axis), "{name} {f_number:?} {height}");
            }
        }
    }
}

#[test]
fn nearly_all_pupil_samples_reach_the_scene() {
    for (name, film) in CLASSIC {
        let widest = set(name, None, film, None).f_number();
        for f_number in [widest, 4.0, 8.0, 16.0, 22.0] {
            if f_number < widest {
                continue;
            }
            for iris in [None, Some(Iris::blades(7, 0.2, 0.0).unwrap())] {
                let bladed = iris.is_some();
                let started = std::time::Instant::now();
                let lens = set(name, Some(f_number), film, iris);
                let ready = started.elapsed().as_secs_f64();
                let half = 0.5 * film[0].hypot(film[1]);
                let (mut worst, mut sum, mut count) = (1.0f64, 0.0, 0.0);
                for i in 0..16 {
                    let at = DVec2::from_angle(0.35 * i as f64) * (half * (i as f64 + 0.5) / 16.0);
                    let (weight, passed) = irradiance(&lens, at, 550.0, 32);
                    if weight > 0.0 {
                        (worst, sum, count) = (worst.min(passed), sum + passed, count + 1.0);
                    }
                }
                println!(
                    "{name} f/{f_number:.2} bladed {bladed}: mean {:.4} worst {worst:.4}, ready in {:.0} ms",
                    sum / count,
                    ready * 1e3
                );
                // Blades turn under the vignetting rims, which costs a little more.
                assert!(sum / count > if bladed { 0.92 } else { 0.97 }, "{name} f/{f_number} {bladed}: {}", sum / count);
            }
        }
    }
}

/// Rays towards each lens from its film, and the same again from where they leave.
#[test]
fn packets_agree_with_the_plain_trace_and_rays_run_back() {
    for name in embedded_names() {
        let p = embedded(name).unwrap();
        let system = System::at(&p, State { zoom: 0.0, focus: 0.0 });
        let batch = single::Batch::new(&system);
        let fine = double::Batch::new(&system);
        let n = system.indices(520.0);
        let (mut n32, mut n64) = (single::Indices::default(), double::Indices::default());
        batch.indices(&[520.0; single::LANES], &mut n32);
        fine.indices(&[520.0; double::LANES], &mut n64);
        // In the visible by a fit, beyond it by the glasses themselves; some lanes here, some there.
        let mut beyond = n64.clone();
        fine.indices(&std::array::from_fn(|i| [330.0, 520.0, 1550.0, 2400.0][i % 4]), &mut beyond);
        for (lane, nm) in [330.0, 520.0, 1550.0, 2400.0].into_iter().enumerate() {
            for (a, b) in system.indices(nm).iter().zip(&beyond.n) {
                assert!((a - b[lane]).abs() < 1e-6, "{name}: index {a} {} at {nm} nm", b[lane]);
            }
        }
        let rim = system.surfaces.last().unwrap();
        let (mut compared, mut differ, mut far, mut far64, mut back) = (0, 0, 0.0f64, 0.0f64, 0.0f64);
        for block in 0..64 {
            let ray = |i: usize| {
                let k = block * single::LANES + i;
                let f = |p: usize| (k * p % 1021) as f64 / 510.5 - 1.0;
                // From wide beams down to thin ones around the axis: some lenses have small stops.
                let scale = rim.semi_diameter * [1.0, 0.5, 0.25, 0.1][k % 4];
                let film = DVec3::new(f(17) * scale * 0.5, f(59) * scale * 0.5, system.film_z);
                let target = DVec3::new(f(131) * scale, f(263) * scale, rim.z);
                TracedRay { position: film, direction: (target - film).normalize() }
            };
            let mut packet = single::Packet::default();
            let mut halves = [double::Packet::default(), double::Packet::default()];
            for i in 0..single::LANES {
                let r = ray(i);
                packet.set(i, r.position.as_vec3().to_array(), r.direction.as_vec3().to_array());
                halves[i / double::LANES].set(i % double::LANES, r.position.to_array(), r.direction.to_array());
            }
            let mask = batch.trace(&mut packet, &n32, TraceDirection::ToObject);
            let masks = [
                fine.trace(&mut halves[0], &n64, TraceDirection::ToObject),
                fine.trace(&mut halves[1], &n64, TraceDirection::ToObject),
            ];
            for i in 0..single::LANES {
                let plain = system.trace(ray(i), &n, TraceDirection::ToObject, Apertures::Clip);
                let fine_passed = masks[i / double::LANES] >> (i % double::LANES) & 1 == 1;
                if (mask >> i & 1 == 1) != plain.is_ok() || fine_passed != plain.is_ok() {
                    differ += 1;
                    continue;
                }
                let Ok(out) = plain else { continue };
                compared += 1;
                let d32 = DVec3::new(packet.dx[i] as f64, packet.dy[i] as f64, packet.dz[i] as f64);
                far = far.max((d32 - out.direction).length());
                let (h, l) = (&halves[i / double::LANES], i % double::LANES);
                let d64 = DVec3::new(h.dx[l], h.dy[l], h.dz[l]);
                let p64 = DVec3::new(h.x[l], h.y[l], h.z[l]);
                far64 = far64.max((d64 - out.direction).length() + (p64 - out.position).length());
                // And back to the film.
                let start = TracedRay { position: out.position, direction: -out.direction };
                let again = system.trace(start, &n, TraceDirection::ToFilm, Apertures::Ignore).unwrap();
                let landed = diopter_lens::trace::at_plane(&again, system.film_z);
                back = back.max((landed - ray(i).position).length());
            }
        }
        println!("{name:<24} {compared} compared, {differ} differ at rims, f32 {far:.1e}, f64 {far64:.1e}, back {back:.1e} mm");
        assert!(compared > 30, "{name}: only {compared} rays passed");
        // Rays within rounding of a rim may fall on either side.
        assert!(differ <= 3, "{name}: {differ} of 2048 rays pass in one trace only");
        // What index fit and single precision leave after up to 43 surfaces.
        assert!(far < 1e-5 && far64 < 1e-5, "{name}: {far} {far64}");
        assert!(back < 1e-9 * system.film_z.abs().max(1.0), "{name}: {back}");
    }
}

/// Prime-focus telescope and Schmidt camera: one mirror, so that light runs towards the object at the film.
const ONE_MIRROR: [(&str, &str); 2] = [
    (
        "paraboloid",
        "name = \"Newton\"\nsurfaces = [\n\
         { radius = -400, conic = -1, mirror = true, stop = true, gap = -200, semi_diameter = 25 },\n]\n",
    ),
    (
        "Schmidt",
        // The plate's r⁴ term is 1 / (4 (n − 1) R³) (B. Schmidt 1931; Schroeder, Astronomical Optics, §7.3).
        "name = \"Schmidt camera\"\nsurfaces = [\n\
         { stop = true, gap = 4, glass = \"N-BK7\", semi_diameter = 25 },\n\
         { asphere = { 4 = 7.56e-9 }, gap = 396, semi_diameter = 26 },\n\
         { radius = -400, mirror = true, gap = -200, semi_diameter = 60 },\n]\n",
    ),
];

#[test]
fn behind_an_odd_number_of_mirrors_the_film_looks_the_other_way() {
    for (name, text) in ONE_MIRROR {
        let p = Arc::new(read_toml(text, name).unwrap());
        let set = |focus| {
            let setting = Setting { focal_length: None, f_number: None, focus, iris: None, film_mm: [24.0, 16.0] };
            CompoundLens::new(p.clone(), &setting).unwrap_or_else(|e| panic!("{name}: {e}"))
        };
        let lens = set(Focus::Infinity);
        let system = lens.system();
        assert!(system.film_run() == -1.0 && system.film_z < system.last_z(), "{name}: film at {}", system.film_z);
        assert!((lens.focal_length().0 - 200.0).abs() < 1.5 && (lens.f_number() - 4.0).abs() < 0.05, "{name}: {lens:?}");
        // The bench and the camera count the same light, and that of a beam of half angle u: π sin² u, tan(u/2) = h / 2f at the
        // paraboloid.
        let bench = Bench::at_infinity(system);
        for height in [0.0, 5.0, 10.0] {
            let expected = bench.illumination(height, 550.0);
            let (found, passed) = irradiance(&lens, DVec2::new(0.0, height), 550.0, 128);
            assert!((found / expected.with_losses - 1.0).abs() < 5e-3, "{name} at {height} mm: {found} {expected:?}");
            assert!(passed > 0.95, "{name} at {height} mm: {passed}");
            if height == 0.0 {
                let closed = std::f64::consts::PI * (2.0 * (25.0f64 / 400.0).atan()).sin().powi(2);
                assert!((expected.geometric / closed - 1.0).abs() < 0.02, "{name}: {expected:?} {closed}");
            }
        }
        // A place above the axis sees what is below it, as behind a lens; colours land where they left.
        let chief = lens.chief_ray(DVec2::new(0.0, 5.0)).unwrap();
        let slope = chief.direction.y / -chief.direction.z;
        assert!(chief.direction.z < 0.0 && (slope * 200.0 / -5.0 - 1.0).abs() < 0.02, "{name}: {chief:?}");
        let (mut samples, mut out, mut scratch) = (Samples::default(), ExitRays::default(), Scratch::default());
        samples.film = [DVec2::new(0.0, 5.0); single::LANES];
        samples.nm = [[550.0, 450.0, 600.0, 650.0]; single::LANES];
        lens.trace_to_scene(&samples, |_, film| film.abs().max_element() <= 100.0, &mut scratch, &mut out);
        assert_eq!(out.passed, u32::MAX, "{name}");
        for k in 0..4 {
            let (at, slope) = (out.film_points[0][k], out.slopes[0][k]);
            assert!((at[1] - 5.0).abs() < 0.05 && (slope[1] - out.slopes[0][0][1]).abs() < 1e-3, "{name}: {at:?} {slope:?}");
        }
        // Nearer things are sharp farther from the mirror, by Newton's f² / x.
        let near = set(Focus::at_mm(8000.0));
        let moved = (near.system().film_z - system.film_z) * system.film_run();
        assert!((moved / near.extension().0 - 1.0).abs() < 0.05 && moved > 0.0, "{name}: {moved} {:?}", near.extension());
        let quick = lens.with_extension(moved).unwrap();
        assert!((quick.system().film_z - near.system().film_z).abs() < 1e-9, "{name}");
        // The bench's figures are of the same handedness.
        let point = bench.field_point(1.0, 550.0).unwrap();
        assert!((point.height / point.ideal_height - 1.0).abs() < 0.01 && point.height > 3.0, "{name}: {point:?}");
    }
}

#[test]
fn the_t_stop_is_what_glass_and_surfaces_leave() {
    // Eleven surfaces: ten between glass and air or glass and glass, at nearly normal incidence near the axis.
    let lens = set("double-gauss-50mm", Some(16.0), [36.0, 24.0], None);
    let system = lens.system();
    let n = system.indices(550.0);
    let product: f64 = n.windows(2).map(|p| 1.0 - ((p[0] - p[1]) / (p[0] + p[1])).powi(2)).product();
    let fraction = (lens.f_number() / lens.t_number()).powi(2);
    assert!((fraction / product - 1.0).abs() < 2e-3, "{fraction} {product}");
}

#[test]
fn openings_alone_are_a_pinhole_with_its_thickness() {
    // A hole of 0.3 mm through a plate of 0.1 mm, 50 mm before the film.
    let text = "name = \"hole\"\nsource = \"test\"\nsurfaces = [\n  { semi_diameter = 0.15, gap = 0.1 },\n  { stop = true, semi_diameter = 0.15, gap = 50.0 },\n]\n";
    let p = Arc::new(read_toml(text, "hole.toml").unwrap());
    let setting = |f_number| Setting {
        focal_length: None,
        f_number,
        focus: Focus::Distance(diopter_light::units::Millimeters(2000.0)),
        iris: None,
        film_mm: [36.0, 24.0],
    };
    let lens = CompoundLens::new(p.clone(), &setting(None)).unwrap();
    // A plane of the prescription is 50 mm away, and stays there: nothing focuses.
    assert!(
        (lens.focal_length().0 - 50.0).abs() < 1e-12 && (lens.f_number() / (50.0 / 0.3) - 1.0).abs() < 1e-6,
        "{}",
        lens.f_number()
    );
    assert_eq!(lens.with_extension(3.0).unwrap().system().film_z, lens.system().film_z);
    assert_eq!((lens.extension().0, diopter_lens::Lens::Compound(Box::new(lens.clone())).is_sharp_everywhere()), (0.0, true));
    let side = 96;
    for x in [0.0, 8.0, 20.0] {
        let film = DVec2::new(x, 0.0);
        // Light: the overlap of the two rims as the film point sees them, × cos⁴ / v². By brute force on the plane of the stop.
        let (scale, shift) = (50.0 / 50.1, x * 0.1 / 50.1);
        let cells = 400;
        let inside = (0..cells * cells).filter(|i| {
            let q = (DVec2::new((i % cells) as f64 + 0.5, (i / cells) as f64 + 0.5) / cells as f64 - 0.5) * 0.3;
            q.length() <= 0.15 && (q - DVec2::new(shift, 0.0)).length() <= 0.15 * scale
        });
        let area = inside.count() as f64 * (0.3 / cells as f64).powi(2);
        let cos = 50.0 / 50f64.hypot(x);
        let expected = area * cos.powi(4) / 2500.0;
        let (found, _) = irradiance(&lens, film, 550.0, side);
        // 9216 samples within pupil bounds of a table.
        assert!((found / expected - 1.0).abs() < 0.01, "{x}: {found} {expected}");
        // Rays go straight on.
        for u in [[0.5f32, 0.5], [0.1, 0.7]] {
            if let Ok(ray) = lens.ray(film, u, 550.0) {
                let system = lens.system();
                let from_film = ray.origin_mm + DVec3::Z * lens.first_order().entrance_pupil_z - film.extend(system.film_z);
                assert!(from_film.normalize().cross(ray.direction).length() < 1e-9, "{x} {u:?}");
            }
        }
    }
    // Closed further it is a smaller hole; wider it does not open.
    let closed = CompoundLens::new(p.clone(), &setting(Some(400.0))).unwrap();
    let ratio = irradiance(&closed, DVec2::ZERO, 550.0, side).0 / irradiance(&lens, DVec2::ZERO, 550.0, side).0;
    assert!((ratio * (400.0f64 / (50.0 / 0.3)).powi(2) - 1.0).abs() < 0.01, "{ratio}");
    assert!(CompoundLens::new(p, &setting(Some(100.0))).is_err());
}

#[test]
fn chief_rays_change_over_the_film_without_steps() {
    // Along lines over the film the direction of a place is that between its neighbours, but for the bend of the way over two steps.
    let lines = [[0.0, 0.0], [0.0, 0.3], [0.4, -0.2]].map(DVec2::from_array);
    let blades = Some(Iris::blades(7, 0.1, 0.3).unwrap());
    for (name, f_number, film, iris) in [
        ("distagon-28mm-f2", None, [36.0, 24.0], None),
        ("phone-5.6mm-f3.5", None, [5.76, 3.84], None),
        ("double-gauss-50mm", Some(4.0), [36.0, 24.0], blades),
        ("anamorphic-31mm", None, [22.0, 12.0], None),
    ] {
        let lens = set(name, f_number, film, iris);
        let half = 0.48 * DVec2::from_array(film);
        let mut worst = 0.0f64;
        for line in lines {
            let step = DVec2::new(0.96, 0.71) * 0.6 / 1000.0;
            let at = |k: i32| lens.chief_ray((line + step * f64::from(k)) * half);
            let directions: Vec<Option<DVec3>> = (0..1000).map(|k| at(k).ok().map(|r| r.direction)).collect();
            for w in directions.windows(3) {
                if let [Some(a), Some(b), Some(c)] = w {
                    worst = worst.max((*b - (*a + *c) * 0.5).length());
                }
            }
        }
        println!("{name}: {worst:.2e}");
        assert!(worst < 1e-6, "{name}: {worst:e}");
    }
}

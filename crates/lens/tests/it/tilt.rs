//! Lenses turned against their film, by rays: the plane of focus, the light, the view.

use diopter_lens::batch::single;
use diopter_lens::compound::{ExitRays, REFERENCE_NM, Samples, Scratch, Setting};
use diopter_lens::prescription::read_toml;
use diopter_lens::ray::{TraceDirection, TracedRay};
use diopter_lens::{CompoundLens, Focus, Iris, Lens, LensRay, ThinLens, embedded};
use diopter_light::units::Millimeters;
use glam::{DVec2, DVec3};
use std::sync::Arc;

fn set(name: &str, f_number: f64, focus: Focus) -> CompoundLens {
    let setting = Setting { focal_length: None, f_number: Some(f_number), focus, iris: None, film_mm: [36.0, 24.0] };
    CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap()
}

fn at(mm: f64) -> Focus {
    Focus::Distance(Millimeters(mm))
}

/// Rays of a film point all over the pupil that passes.
fn bundle(lens: &CompoundLens, film: DVec2) -> Vec<LensRay> {
    const SIDE: usize = 16;
    let u = |i: usize| [(i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5].map(|v| v / SIDE as f32);
    (0..SIDE * SIDE).filter_map(|i| lens.ray(film, u(i), REFERENCE_NM).ok()).collect()
}

/// Where a ray meets a plane.
fn meets(ray: &LensRay, [point, normal]: [DVec3; 2]) -> DVec3 {
    ray.origin_mm + ray.direction * ((point - ray.origin_mm).dot(normal) / ray.direction.dot(normal))
}

/// Root mean square angle (rad) by which rays that pass a plane miss their middle there, as seen from the entrance pupil; times the focal length it is
/// about the blur on the film.
fn blur(rays: &[LensRay], plane: [DVec3; 2]) -> f64 {
    let seen: Vec<DVec3> = rays.iter().map(|r| meets(r, plane).normalize()).collect();
    let middle = seen.iter().sum::<DVec3>() / seen.len() as f64;
    (seen.iter().map(|s| (*s - middle).length_squared()).sum::<f64>() / seen.len() as f64).sqrt()
}

/// The point where the rays of a film point are closest to each other: least squares over their distances.
fn sharpest(rays: &[LensRay]) -> DVec3 {
    let (mut m, mut b) = (glam::DMat3::ZERO, DVec3::ZERO);
    for r in rays {
        let across = glam::DMat3::IDENTITY
            - glam::DMat3::from_cols(r.direction * r.direction.x, r.direction * r.direction.y, r.direction * r.direction.z);
        m += across;
        b += across * r.origin_mm;
    }
    m.inverse() * b
}

#[test]
fn an_ideal_surface_turned_is_the_tilted_thin_lens() {
    let text = "name = \"ideal\"\nsurfaces = [\n{ ideal_focal_length = 90, gap = 90, semi_diameter = 11.25, stop = true },\n]\n";
    let prescription = Arc::new(read_toml(text, "ideal.toml").unwrap());
    for (tilt, focus) in [
        ([0.14, 0.0], at(3000.0)),
        ([0.1, -0.15], at(1200.0)),
        ([-0.3, 0.0], Focus::Infinity),
        ([0.0, 0.2], Focus::Extension(Millimeters(2.5))),
    ] {
        let setting = Setting { focal_length: None, f_number: Some(8.0), focus, iris: None, film_mm: [36.0, 24.0] };
        let traced = CompoundLens::new(prescription.clone(), &setting).unwrap().tilted(tilt).unwrap();
        let thin = ThinLens::new(Millimeters(90.0), 8.0, Iris::Round, focus).unwrap().tilted(tilt).unwrap();
        // Found from rays by squares of single precision's 1e-7: a few µm in 90 mm.
        let off = traced.system().film_z - thin.film_distance().0;
        assert!(off.abs() < 5e-3, "{tilt:?} {focus:?}: film {off} mm off");
        assert!((traced.extension().0 - Lens::Thin(thin.clone()).extension().0).abs() < 1e-6);
        let distances = [traced.focus_distance(), thin.focus_distance()].map(|d| d.map_or(f64::INFINITY, |d| d.0));
        assert!(distances[0] == distances[1] || (distances[0] / distances[1] - 1.0).abs() < 1e-9, "{distances:?}");
        let thin = Lens::Thin(thin);
        for film in [DVec2::ZERO, DVec2::new(12.0, -7.0), DVec2::new(-17.0, 11.0)] {
            let light = |ray: &dyn Fn([f32; 2]) -> f64| {
                let n = 128;
                (0..n * n).map(|i| ray([(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|v| v / n as f32))).sum::<f64>()
                    / (n * n) as f64
            };
            let a = light(&|u| traced.ray(film, u, REFERENCE_NM).map_or(0.0, |r| r.weight_sr));
            // The thin lens keeps the sine condition; a flat opening of radius r at a distance v has less light, by 1 / (1 + r²/v²).
            let b = light(&|u| thin.ray(film, u).unwrap().weight_sr) / (1.0 + (5.625 / traced.system().film_z).powi(2));
            // Askew that factor changes by some tenths of itself, 0.1 %; 128² samples tell a disk's area to about 0.1 %.
            assert!((a / b - 1.0).abs() < 3e-3, "{tilt:?} {film}: {a} {b}");
            let [x, y] = [traced.chief_ray(film).unwrap(), thin.chief_ray(film).unwrap()];
            // The middle of what passes is not quite the middle of the opening as it is seen; both look at the same point in focus.
            if let Some([point, normal]) = traced.plane_of_focus() {
                let plane = [point, normal];
                let (p, q) = (meets(&x, plane), meets(&y, plane));
                assert!((p - q).length() < 2e-3 * q.length(), "{tilt:?} {film}: {p} {q}");
                let rays = bundle(&traced, film);
                assert!(blur(&rays, plane) * 90.0 < 1e-3, "{tilt:?} {film}: {}", blur(&rays, plane) * 90.0);
            }
        }
    }
}

#[test]
fn the_plane_of_focus_goes_through_scheimpflugs_and_the_hinge_line() {
    // Lenses whose field is flat enough that points in focus lie in a plane, over the middle of the film.
    for (name, tilt) in
        [("double-gauss-50mm", [0.14, 0.0]), ("double-gauss-50mm", [0.0, -0.1]), ("telephoto-250mm", [0.04, 0.03])]
    {
        let straight = set(name, 8.0, at(4000.0));
        let lens = straight.tilted(tilt).unwrap();
        let first = straight.first_order();
        let axis = lens.axis();
        let (f, run) = (first.efl, DVec3::Z * first.rear_principal_z);
        // Points of the lens's own axis, from the entrance pupil.
        let place = |z: f64| run + axis * (z - first.rear_principal_z) - lens.entrance_pupil();
        let (rear, front) = (place(first.rear_principal_z), place(first.front_principal_z));
        let film_z = lens.system().film_z - lens.entrance_pupil().z;
        // What is sharp, by rays: at least four film points.
        let film = [DVec2::ZERO, DVec2::new(5.0, 1.0), DVec2::new(-2.0, 5.0), DVec2::new(-4.0, -4.0), DVec2::new(3.0, -5.0)];
        let sharp = film.map(|at| sharpest(&bundle(&lens, at)));
        // It meets the camera's axis at the focus distance.
        assert!((sharp[0].z / -4000.0 - 1.0).abs() < 0.01, "{name}: {}", sharp[0]);
        let [point, normal] = lens.plane_of_focus().unwrap();
        for p in sharp {
            // Spherical aberration moves all of it from where Gauss's formulas have it; how it stands is theirs. Curvature of field and coma, as depths on the
            // film, stay within the depth of focus N c = 8 × 0.03 mm.
            let along = (p - sharp[0]).dot(normal) / normal.z;
            let on_film = along / (p.z / f).powi(2);
            assert!(on_film.abs() < 0.24, "{name} {tilt:?}: {on_film} mm at {p}");
        }
        // Lines in which planes meet. Scheimpflug: the film with the rear principal plane; seen in the scene it is moved by the hiatus along the axis.
        let along = axis.cross(DVec3::Z).normalize();
        let across = along.cross(DVec3::Z);
        let on_film = DVec3::Z * film_z;
        let scheimpflug = on_film + across * ((rear - on_film).dot(axis) / across.dot(axis)) + (front - rear);
        // Hinge: the front focal plane with the plane through the front nodal point that is parallel to the film (Merklinger 1992).
        let hinge = front + across * ((place(first.ffl) - front).dot(axis) / across.dot(axis));
        for (what, line) in [("Scheimpflug", scheimpflug), ("hinge", hinge)] {
            for p in [line, line + along * 80.0] {
                let off = (p - point).dot(normal).abs();
                assert!(off < 1e-6 * 4000.0, "{name} {tilt:?}: {what} line {off} mm off the plane");
            }
        }
        // And by rays alone: the plane through what is sharp, least squares, comes as near to it as the curvature of field over 5 mm of film lets it, which turns
        // the plane by some per cent: within 10 % of the hinge distance f / sin τ.
        let mean = sharp.iter().sum::<DVec3>() / 5.0;
        // depth = a + b · (x, y): two unknown slopes.
        let (mut xx, mut xz) = (glam::DMat2::ZERO, DVec2::ZERO);
        for p in sharp {
            let d = p - mean;
            let t = d.truncate();
            xx += glam::DMat2::from_cols(t * t.x, t * t.y);
            xz += t * d.z;
        }
        let slope = xx.inverse() * xz;
        // In the plane of the hinge line (z = that of the front nodal point), along the direction across it.
        let toward = across.truncate();
        let reach = (front.z - mean.z - slope.dot(hinge.truncate() - mean.truncate())) / slope.dot(toward);
        let hinge_mm = f / axis.angle_between(DVec3::Z).sin();
        assert!(reach.abs() < 0.1 * hinge_mm, "{name} {tilt:?}: {reach} mm of {hinge_mm}");
    }
}

#[test]
fn points_of_the_plane_of_focus_are_as_sharp_as_the_lens_is_and_others_are_not() {
    let (f_number, focal) = (4.0, 50.0);
    let straight = set("double-gauss-50mm", f_number, at(3000.0));
    let lens = straight.tilted([0.14, 0.0]).unwrap();
    let plane = lens.plane_of_focus().unwrap();
    let flat = [DVec3::NEG_Z * 3000.0, DVec3::Z];
    // Its own blur: the worst over the field it now uses, which reaches 8° farther: 19 mm from its axis.
    let own = (0..14).map(|i| blur(&bundle(&straight, DVec2::new(0.0, 1.5 * i as f64)), flat)).fold(0.0, f64::max) * focal;
    for y in [-11.0, -6.0, 0.0, 6.0, 11.0] {
        let film = DVec2::new(2.0, y);
        let rays = bundle(&lens, film);
        let sharp = blur(&rays, plane) * focal;
        assert!(sharp < 1.2 * own, "{film}: {sharp} mm against {own}");
        // On the plane across the axis, where the lens was sharp before: blurred by what the tilt moves the film off, z = y tan τ, over N: rms of a disk of
        // this diameter is its radius over √2.
        let blurred = blur(&rays, flat) * focal;
        let expected = (y * 0.14f64.tan() / f_number).abs() / (2.0 * 2f64.sqrt());
        if y != 0.0 {
            assert!(
                (blurred / expected - 1.0).abs() < 0.25 && blurred > 4.0 * sharp,
                "{film}: {blurred} mm, expected {expected}, sharp {sharp}"
            );
        }
    }
}

#[test]
fn the_view_of_what_is_far_stays() {
    for (name, tilt) in [("double-gauss-50mm", [0.14, 0.0]), ("telephoto-250mm", [-0.1, 0.1]), ("wide-22mm", [0.0, 0.14])] {
        let straight = set(name, 8.0, Focus::Infinity);
        let lens = straight.tilted(tilt).unwrap();
        let ray = lens.chief_ray(DVec2::ZERO).unwrap();
        // Distortion at 8° moves the picture by up to a hundredth of its height there.
        let off = ray.direction.truncate().length() * lens.focal_length().0;
        assert!(off < 0.015 * lens.focal_length().0 * 0.14, "{name}: {off} mm");
    }
}

/// Mean weight of a film point over `side`² samples of the packet path.
fn irradiance(lens: &CompoundLens, film: DVec2, side: usize) -> f64 {
    let (mut samples, mut out, mut scratch) = (Samples::default(), ExitRays::default(), Scratch::default());
    let mut sum = 0.0;
    for chunk in 0..side * side / single::LANES {
        for i in 0..single::LANES {
            let k = chunk * single::LANES + i;
            samples.film[i] = film;
            samples.pupil[i] = [(k % side) as f32 + 0.5, (k / side) as f32 + 0.5].map(|v| v / side as f32);
        }
        lens.trace_to_scene(&samples, |_, film| film.abs().max_element() <= 100.0, &mut scratch, &mut out);
        sum += out.weight.iter().map(|w| w[0] as f64).sum::<f64>();
    }
    sum / (side * side) as f64
}

/// The same without tables of pupils: a grid over all directions that can meet the last rim, as it stands.
fn brute_force(lens: &CompoundLens, film: DVec2, side: usize) -> f64 {
    let system = lens.system();
    let n = system.indices(550.0);
    let last = system.surfaces.last().unwrap();
    let sag = last.profile.sag(0.0, last.semi_diameter * 0.999_999).unwrap();
    let slopes: Vec<DVec2> = (0..64)
        .flat_map(|i| {
            let rim = (DVec2::from_angle(std::f64::consts::TAU * i as f64 / 64.0) * last.semi_diameter).extend(sag);
            [rim, rim.with_z(0.0)]
        })
        .map(|local| {
            let p = last.to_lens(local, DVec3::Z).0;
            (p.truncate() - film) / (system.film_z - p.z)
        })
        .collect();
    let (low, high) = slopes.iter().fold((DVec2::MAX, DVec2::MIN), |(l, h), s| (l.min(*s), h.max(*s)));
    let (middle, half) = (0.5 * (low + high), 0.51 * (high - low));
    let cell = 4.0 * half.x * half.y / (side * side) as f64;
    let ray = |i: usize| {
        let at = (DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5) * (2.0 / side as f64) - 1.0) * half + middle;
        TracedRay { position: film.extend(system.film_z), direction: system.film_direction(at) }
    };
    (0..side * side)
        .filter_map(|i| {
            let ray = ray(i);
            system
                .transmittance(ray, &n, 550.0, TraceDirection::ToObject)
                .ok()
                .map(|fraction| fraction * cell * ray.direction.z.powi(4))
        })
        .sum()
}

#[test]
fn film_irradiance_of_a_tilted_lens_is_that_of_brute_force() {
    /// Rays a side of the grid.
    const SIDE: usize = 400;
    let film_mm = [36.0, 24.0];
    // Fully open, where rims cut the pupil, and closed; the last two with the end of the image circle in the picture.
    for (name, f_number, tilt, scale) in [
        ("double-gauss-50mm", None, [0.14, 0.0], 1.0),
        ("double-gauss-50mm", Some(8.0), [0.1, -0.2], 1.0),
        ("wide-22mm", None, [0.0, 0.1], 1.4),
        ("double-gauss-50mm", Some(4.0), [0.25, 0.0], 1.8),
    ] {
        let setting =
            Setting { focal_length: None, f_number, focus: at(2000.0), iris: None, film_mm: film_mm.map(|v| v * scale) };
        let lens = CompoundLens::new(Arc::new(embedded(name).unwrap()), &setting).unwrap().tilted(tilt).unwrap();
        let middle = brute_force(&lens, DVec2::ZERO, SIDE);
        let (mut dark, mut table_sum, mut brute_sum) = (0, 0.0, 0.0);
        for i in 0..16 {
            // Spread all over the film (Roberts' sequence).
            let part = [0.754_877_666_246_693, 0.569_840_290_998_053].map(|a| (0.5 + a * i as f64).fract() - 0.5);
            let film = DVec2::new(part[0] * film_mm[0], part[1] * film_mm[1]) * scale;
            let (table, brute) = (irradiance(&lens, film, 128), brute_force(&lens, film, SIDE));
            println!("{name} {f_number:?} {film}: {table:.5e} {brute:.5e} {:+.3} %", (table / brute - 1.0) * 100.0);
            dark += usize::from(brute < 1e-3 * middle);
            (table_sum, brute_sum) = (table_sum + table, brute_sum + brute);
            // 0.3 % of the place and, where little is left, 0.1 % of the middle: a grid of 400 a side tells an area within about 1/400 of its rim.
            assert!(
                (table - brute).abs() < 3e-3 * brute + 1e-3 * middle,
                "{name} {f_number:?} {tilt:?} at {film}: {table} {brute}"
            );
        }
        assert!((table_sum / brute_sum - 1.0).abs() < 1.5e-3, "{name}: {table_sum} {brute_sum}");
        assert!(scale < 1.5 || dark > 0, "{name}: the image circle ends beyond the film");
    }
}

#[test]
fn a_tilted_lens_stays_tilted_when_it_is_set_otherwise() {
    let lens = set("double-gauss-50mm", 4.0, at(3000.0)).tilted([0.1, 0.05]).unwrap();
    for other in [lens.refocused(Focus::Infinity).unwrap(), lens.stopped(8.0).unwrap(), lens.with_extension(1.0).unwrap()] {
        assert_eq!(other.tilt(), [0.1, 0.05]);
    }
    assert_eq!(lens.f_number(), 4.0);
    // Set to its own extension it stands where it stood, but for the change of its aberrations; and back.
    let back = lens.refocused(Focus::Extension(lens.extension())).unwrap();
    assert!((back.system().film_z - lens.system().film_z).abs() < 0.02, "{}", back.system().film_z - lens.system().film_z);
    assert!((back.focus_distance().unwrap().0 / 3000.0 - 1.0).abs() < 1e-9);
    // A quick move of the film sees the light of a careful one.
    let far = lens.refocused(Focus::Infinity).unwrap();
    let (quick, slow) = (far.with_extension(1.2).unwrap(), far.refocused(Focus::Extension(Millimeters(1.2))).unwrap());
    assert!((quick.system().film_z - slow.system().film_z).abs() < 1e-9);
    for film in [DVec2::ZERO, DVec2::new(9.0, -6.0), DVec2::new(-14.0, 9.0)] {
        let (a, b) = (irradiance(&quick, film, 96), irradiance(&slow, film, 96));
        assert!((a / b - 1.0).abs() < 4e-3, "{film}: {a} {b}");
    }
    assert!(lens.tilted([1.2, 0.0]).unwrap_err().to_string().contains("60°"));
    // Askew enough, a near plane has no image before the lens touches the film.
    assert!(set("double-gauss-50mm", 4.0, at(3000.0)).tilted([f64::NAN, 0.0]).is_err());
}

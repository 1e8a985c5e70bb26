use super::*;
use crate::analysis::{Bench, airy_mtf};
use crate::compound::Setting;
use crate::{Focus, ThinLens, embedded};
use diopter_light::units::Millimeters;
use std::f64::consts::TAU;
use std::sync::Arc;

fn thin(n: f64, iris: Iris) -> Lens {
    Lens::Thin(ThinLens::new(Millimeters(50.0), n, iris, Focus::Infinity).unwrap())
}

fn of(lens: &Lens) -> Diffraction {
    Diffraction::new(lens, DVec2::new(18.0, 12.0), 0.02).unwrap()
}

/// Even numbers: Roberts' R₂ sequence.
fn even(i: u32) -> [f32; 2] {
    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|a| ((0.5 + a * f64::from(i)).fract() as f32).min(0.999_999_9))
}

const DRAWS: u32 = 1 << 14;

fn draws(kernel: &Kernel, nm: f32) -> impl Iterator<Item = DVec2> {
    (0..DRAWS).map(move |i| kernel.draw(even(i), nm))
}

fn contrast(kernel: &Kernel, nm: f32, frequency: DVec2) -> f64 {
    draws(kernel, nm).map(|d| (TAU * frequency.dot(d)).cos()).sum::<f64>() / f64::from(DRAWS)
}

#[test]
fn displacements_of_a_disk_have_airys_mtf_and_encircled_energy() {
    for n in [8.0, 16.0, 22.0] {
        let all = of(&thin(n, Iris::Round));
        let kernel = all.at(DVec2::ZERO);
        for nm in [450.0f32, 550.0, 650.0] {
            let cutoff = 1e6 / (f64::from(nm) * n);
            for x in [0.05, 0.2, 0.4, 0.6, 0.8, 0.95] {
                let found = contrast(&kernel, nm, DVec2::from_angle(0.3) * (x * cutoff));
                let exact = airy_mtf(x * cutoff, f64::from(nm), n);
                assert!((found - exact).abs() < 0.01, "f/{n} {nm} nm, {x} of the cut-off: {found} {exact}");
            }
            // 1 − J₀² − J₁² at v = πr/(λN): 0.8378 in the first dark ring, 0.9099 in the second, 0.9378 in the third (Born & Wolf 8.5).
            for (v, exact) in [(1.0, 0.2212), (3.8317, 0.8378), (7.0156, 0.9099), (10.1735, 0.9378)] {
                let radius = v * f64::from(nm) * 1e-6 * n / PI;
                let within = draws(&kernel, nm).filter(|d| d.length() < radius).count() as f64 / f64::from(DRAWS);
                assert!((within - exact).abs() < 0.01, "f/{n} {nm} nm {v}: {within} {exact}");
            }
        }
    }
}

#[test]
fn densities_are_those_of_what_is_drawn() {
    let all = of(&thin(11.0, Iris::blades(6, 0.2, 0.0).unwrap()));
    let kernel = all.at(DVec2::new(9.0, -7.0));
    let nm = 550.0f32;
    // In squares of a quarter of λN about the middle: the mean density of each against what falls into it.
    let (side, n) = (0.25 * 550e-6 * 11.0, 16);
    let mut counts = vec![0.0f64; n * n];
    for d in draws(&kernel, nm) {
        let at = (d / side + 0.5 * n as f64).floor();
        if at.min_element() >= 0.0 && at.max_element() < n as f64 {
            counts[at.y as usize * n + at.x as usize] += 1.0;
        }
    }
    for (i, count) in counts.iter().enumerate() {
        let corner = DVec2::new((i % n) as f64, (i / n) as f64) - 0.5 * n as f64;
        let at = |k: usize| (corner + (DVec2::new((k % 16) as f64, (k / 16) as f64) + 0.5) / 16.0) * side;
        let mean = (0..256).map(|k| f64::from(kernel.density(at(k), nm))).sum::<f64>() / 256.0;
        let expected = mean * side * side * f64::from(DRAWS);
        // Even points scatter less than random ones, whose deviation is the root of the number.
        assert!((count - expected).abs() < 4.0 * expected.sqrt() + 2.0, "{i}: {count} {expected}");
    }
    // All of the table: 1 (a coarse sum outside, so to 2 %).
    let step = 0.5 * side;
    let total: f64 = (0..800 * 800)
        .map(|k| f64::from(kernel.density((DVec2::new((k % 800) as f64, (k / 800) as f64) - 399.5) * step, nm)))
        .sum::<f64>()
        * step
        * step;
    assert!((total - 1.0).abs() < 0.02, "{total}");
}

#[test]
fn blades_make_twice_as_many_spikes_if_odd() {
    for (blades, spikes) in [(5u32, 10usize), (6, 6), (7, 14), (8, 8), (9, 18)] {
        let rotation = 0.1f32;
        let all = of(&thin(16.0, Iris::blades(blades, rotation, 0.0).unwrap()));
        let kernel = all.at(DVec2::ZERO);
        // Mean density along directions, from 12 to 40 λN.
        let unit = 550e-6 * 16.0;
        let along = |angle: f64| {
            let at = |k: u32| DVec2::from_angle(angle) * (unit * (12.0 + 0.1 * f64::from(k)));
            (0..280).map(|k| f64::from(kernel.density(at(k), 550.0))).sum::<f64>() / 280.0
        };
        let steps = 720;
        let values: Vec<f64> = (0..steps).map(|i| along(TAU * f64::from(i) / f64::from(steps))).collect();
        let mean = values.iter().sum::<f64>() / f64::from(steps);
        let bright: Vec<usize> = (0..values.len())
            .filter(|i| {
                let near = (1..=6).all(|k| {
                    values[*i] >= values[(i + k) % values.len()] && values[*i] > values[(i + values.len() - k) % values.len()]
                });
                near && values[*i] > 2.0 * mean
            })
            .collect();
        assert_eq!(bright.len(), spikes, "{blades} blades: {bright:?}");
        // Across the sides, half a side from a corner.
        for i in bright {
            let period = TAU / spikes as f64;
            let off = (TAU * i as f64 / f64::from(steps) - f64::from(rotation) - PI / f64::from(blades)).rem_euclid(period);
            // Steps of 0.5°, cells of 1/2 at 12 and more: 1.5°.
            assert!(off.min(period - off) < 0.027, "{blades} blades: spike {i}, {off}");
        }
    }
}

#[test]
fn spikes_fall_with_the_square_of_the_distance_across_the_end_of_the_table() {
    // Energy in rings is that of Σ ℓ / (2π² w) for straight sides, drawn from the table within 40 and from the edges beyond.
    let all = Diffraction::new(&thin(16.0, Iris::blades(6, 0.1, 0.0).unwrap()), DVec2::new(18.0, 12.0), 0.05).unwrap();
    let kernel = all.at(DVec2::ZERO);
    let side = kernel.table_from_film.x_axis.length();
    let n = 1u32 << 16;
    let more = |i: u32| {
        let [a, b] = even(i.wrapping_mul(7919));
        [(a * 37.0).fract(), (b * 41.0).fract()]
    };
    let radii: Vec<f64> = (0..n).filter_map(|i| kernel.wing(even(i), more(i))).map(|d| d.length() * side).collect();
    assert_eq!(radii.len(), n as usize);
    // Distance along a normal of a hexagon differs from the radius by the width of the spike only.
    let beyond = |w: f64| radii.iter().filter(|r| **r > w).count() as f64;
    let start = 16.0;
    for w in [24.0, 32.0, 60.0, 96.0, 192.0] {
        let (found, expected) = (beyond(w) / beyond(start), start / w);
        assert!((found / expected - 1.0).abs() < 0.05, "{w}: {found} {expected}");
    }
    // What is beyond the core in truth: the closed form for all edges.
    let [_, within] = kernel.within_core(550.0);
    let w = 0.05 / 550e-6 * side;
    let tail = Tail::of(&Iris::blades(6, 0.1, 0.0).unwrap()).unwrap().beyond(w / all.patterns[0].side);
    assert!(((1.0 - within) / tail - 1.0).abs() < 0.1, "{within} {tail}");
}

#[test]
fn colours_are_displaced_in_proportion_to_their_wavelength() {
    let all = of(&thin(16.0, Iris::blades(7, 0.0, 0.0).unwrap()));
    let kernel = all.at(DVec2::new(3.0, 4.0));
    for i in 0..100 {
        let [blue, red] = [400.0f32, 700.0].map(|nm| kernel.draw(even(i), nm));
        assert!((red / 700.0 - blue / 400.0).length() < 1e-12, "{blue} {red}");
        // The same place in u: densities fall with λ².
        let ratio = kernel.density(blue, 400.0) / kernel.density(red, 700.0);
        assert!((f64::from(ratio) / (700.0f64 / 400.0).powi(2) - 1.0).abs() < 1e-3, "{ratio}");
    }
}

#[test]
fn oblique_light_sees_a_narrower_pupil() {
    // cos θ across the field's direction and cos³ θ along it: with them the frequencies of the cut-off shrink (Hopkins & Yzuel 1970).
    let all = of(&thin(16.0, Iris::Round));
    let angle = (18.0f64 / 50.0).atan();
    let kernel = all.at(DVec2::new(18.0, 0.0));
    let f = 0.4e6 / (550.0 * 16.0);
    for (direction, factor) in [(DVec2::Y, angle.cos()), (DVec2::X, angle.cos().powi(3))] {
        let (found, exact) = (contrast(&kernel, 550.0, direction * f), airy_mtf(f / factor, 550.0, 16.0));
        assert!((found - exact).abs() < 0.01, "{direction}: {found} {exact}");
    }
}

fn gauss(n: f64, iris: Option<Iris>) -> Box<CompoundLens> {
    let setting = Setting { focal_length: None, f_number: Some(n), focus: Focus::Infinity, iris, film_mm: [36.0, 24.0] };
    Box::new(CompoundLens::new(Arc::new(embedded("double-gauss-50mm").unwrap()), &setting).unwrap())
}

fn magnitude(kernel: &Kernel, nm: f32, frequency: DVec2) -> f64 {
    let sum = draws(kernel, nm).map(|d| DVec2::from_angle(TAU * frequency.dot(d))).sum::<DVec2>();
    sum.length() / f64::from(DRAWS)
}

#[test]
fn a_traced_lens_has_the_benchs_diffraction_mtf() {
    for (n, fields) in [(16.0, [0.0, 12.0]), (8.0, [0.0, 6.0])] {
        let lens = gauss(n, None);
        let efl = lens.focal_length().0;
        let bench = Bench::at_infinity(lens.system());
        let frequencies = [0.1, 0.25, 0.4, 0.6].map(|x| x * 1e6 / (587.6 * n));
        let all = of(&Lens::Compound(lens.clone()));
        // Aberrations are left to the pattern, not to the rays.
        let PupilMap::Traced(map) = &all.pupils else { panic!("a traced lens") };
        assert!(map.wavefronts[..4].iter().all(Option::is_some), "f/{n}");
        for field in fields {
            let exact = bench.diffraction_mtf(field, &[(587.6, 1.0)], &frequencies, 0.0).unwrap();
            let kernel = all.at(DVec2::new(0.0, efl * field.to_radians().tan()));
            for (i, f) in frequencies.iter().enumerate() {
                let [t, s] = [DVec2::Y, DVec2::X].map(|d| magnitude(&kernel, 587.6, d * *f));
                // 0.002 from the draws; the phase is that of 610 nm; the ring is up to 2 mm away.
                assert!((t - exact.tangential[i]).abs() < 0.02, "f/{n} {field}° {f}: tangential {t} {}", exact.tangential[i]);
                assert!((s - exact.sagittal[i]).abs() < 0.02, "f/{n} {field}° {f}: sagittal {s} {}", exact.sagittal[i]);
            }
        }
    }
}

#[test]
fn straightened_rays_meet_the_object() {
    let lens = gauss(5.6, None);
    let all = of(&Lens::Compound(lens.clone()));
    for film in [DVec2::new(0.01, 0.0), DVec2::new(0.0, 4.1), DVec2::new(-3.0, 2.0)] {
        let scatter = |straight: bool| {
            let direction = |i: u32| {
                let u = even(i);
                let at = if straight { all.straightened(&lens, film, u) } else { film };
                lens.ray(at, u, crate::compound::REFERENCE_NM).ok().map(|r| r.direction)
            };
            let found: Vec<DVec3> = (0..200).filter_map(direction).collect();
            let mean = found.iter().sum::<DVec3>() / found.len() as f64;
            found.iter().map(|d| d.distance(mean)).fold(0.0, f64::max)
        };
        let (bent, straight) = (scatter(false), scatter(true));
        // What is left of the aberration: that of the rings between, and f32 of the pupil's numbers.
        assert!(straight < 0.15 * bent, "{film}: {straight} {bent}");
    }
    // Lenses in a plane have no aberration.
    assert_eq!(of(&thin(5.6, Iris::Round)).straightened(&lens, DVec2::X, [0.2, 0.9]), DVec2::X);
}

#[test]
fn rims_that_cut_the_pupil_widen_the_pattern() {
    let open = of(&Lens::Compound(gauss(2.0, None)));
    let f = 0.3e6 / (550.0 * 2.0);
    let along = |film: DVec2| magnitude(&open.at(film), 550.0, film.normalize() * f);
    let across = |film: DVec2| magnitude(&open.at(film), 550.0, film.normalize().perp() * f);
    let far = DVec2::new(17.0, 9.0);
    assert!(along(far) < across(far) - 0.03, "{} {}", along(far), across(far));
    // In all directions from the axis alike.
    let turned = DVec2::from_angle(1.3).rotate(far);
    assert!((along(far) - along(turned)).abs() < 0.01, "{} {}", along(far), along(turned));
}

#[test]
fn blades_stand_still_while_the_field_point_goes_round() {
    let all = of(&Lens::Compound(gauss(16.0, Some(Iris::blades(5, 0.2, 0.0).unwrap()))));
    // Density across a side, half a side from the first corner, and through the corner, from 12 λN on.
    let along = |film: DVec2, angle: f64| {
        let kernel = all.at(film);
        (0..150)
            .map(|k| f64::from(kernel.density(DVec2::from_angle(angle) * (550e-6 * 16.0 * (12.0 + 0.1 * f64::from(k))), 550.0)))
            .sum::<f64>()
    };
    for film in [DVec2::ZERO, DVec2::new(8.0, 3.0), DVec2::new(-4.0, 9.0)] {
        let (side, corner) = (along(film, 0.2 + PI / 5.0), along(film, 0.2 + PI / 10.0));
        assert!(side > 5.0 * corner, "{film}: {side} {corner}");
    }
}

#[test]
fn core_and_wings_are_all_of_the_light() {
    for iris in [Iris::Round, Iris::blades(7, 0.0, 0.0).unwrap(), Iris::blades(8, 0.3, 0.7).unwrap()] {
        let all = of(&thin(16.0, iris));
        let kernel = all.at(DVec2::new(2.0, 0.0));
        for nm in [420.0f32, 550.0, 680.0] {
            let [table, truth] = kernel.within_core(nm);
            let found = draws(&kernel, nm).filter(|d| d.length() <= all.core_mm()).count() as f64 / f64::from(DRAWS);
            assert!((found - table).abs() < 2e-3, "{nm}: {found} {table}");
            // The table folds what lies beyond it into itself.
            assert!(truth < table && table - truth < 0.01, "{nm}: {table} {truth}");
        }
    }
    assert!(Diffraction::new(&Lens::Pinhole(crate::Pinhole::new(Millimeters(50.0), 8.0).unwrap()), DVec2::ONE, 0.02).is_none());
}

#[test]
fn an_aperture_picture_diffracts() {
    // A slit: wide across the slit's narrow side, sinc² along it (a clear rectangle of widths a and b: triangles as MTF).
    let (n, narrow) = (64usize, 8usize);
    let values = (0..n * n).map(|i| f32::from((i % n).abs_diff(n / 2) < narrow)).collect();
    let all = of(&thin(16.0, Iris::image(n, n, values).unwrap()));
    let kernel = all.at(DVec2::ZERO);
    // The square around the disk of f/16 is 1/16 wide in direction cosines; the slit 15 of 64 of it.
    let cutoff = 1e6 / (550.0 * 16.0);
    for (x, exact) in [(0.05, 1.0 - 0.05 * 64.0 / 15.0), (0.15, 1.0 - 0.15 * 64.0 / 15.0), (0.23, 0.0186)] {
        let found = contrast(&kernel, 550.0, DVec2::X * (x * cutoff));
        assert!((found - exact).abs() < 0.012, "{x}: {found} {exact}");
    }
    let found = contrast(&kernel, 550.0, DVec2::Y * (0.5 * cutoff));
    assert!((found - 0.5).abs() < 0.01, "{found}");
}

//! Glare against closed forms and against an analogue random walk of its own.

use super::random::{Random, disk, even};
use super::*;
use crate::compound::{FilmPlace, configure};
use crate::ghosts::SourceBeam;
use crate::lenses::embedded;
use crate::prescription::coating_named;
use crate::ray::TraceDirection;
use crate::system::System;
use glam::{DVec2, DVec3};

fn lens(name: &str, coating: Option<&str>, f: f64) -> System {
    let mut p = embedded(name).unwrap();
    if let Some(coating) = coating {
        p.coating = coating_named(coating, None).unwrap();
    }
    configure(&p, None, Some(f), None, FilmPlace::AsPublished).unwrap().system
}

#[test]
fn lobes_are_drawn_as_their_formula_says() {
    for lobe in [Lobe { l: 0.01, s: -1.5 }, Lobe { l: 0.02, s: -3.0 }, Lobe { l: 0.3, s: -2.0 }] {
        // The integral of the formula by rings, against the closed form and its inverse.
        let most = 1.5;
        let ring = |k: usize| {
            let r = most * (k as f64 + 0.5) / 300_000.0;
            r * (1.0 + (r / lobe.l).powi(2)).powf(0.5 * lobe.s)
        };
        let all: f64 = (0..300_000).map(ring).sum();
        for r in [0.003, 0.02, 0.2, 0.9] {
            let part: f64 = (0..(300_000.0 * r / most) as usize).map(ring).sum::<f64>() / all;
            assert!((lobe.fraction(r, most) - part).abs() < 1e-4, "{lobe:?} {r}: {} {part}", lobe.fraction(r, most));
            assert!((lobe.radius(lobe.fraction(r, most), most) - r).abs() < 1e-9);
        }
    }
}

#[test]
fn dust_and_roughness_are_those_of_the_tables() {
    // Percent of the area by the formula, computed by hand: 10^(−3.541), 10^(−1.563), 10^(−0.500).
    for (level, percent) in [(100.0, 2.9e-4), (300.0, 0.0274), (500.0, 0.316)] {
        let found = 100.0 * Finish { roughness_nm: 1.0, cleanliness: level }.dust_fraction();
        assert!((found / percent - 1.0).abs() < 0.05, "{level}: {found} {percent}");
    }
    // FRED's help: 5 nm on a mirror (a step of 2) at 500 nm scatter 0.015791.
    let rough = Finish { roughness_nm: 5.0, cleanliness: 0.0 }.rough_fraction(2.0, 500.0);
    assert!((rough - 0.015_791).abs() < 1e-6, "{rough}");
}

#[test]
fn light_that_enters_a_coated_lens_is_recorded_reflected_or_absorbed() {
    for (name, coating, degrees) in
        [("double-gauss-50mm", Some("broadband"), 12.0), ("kit-zoom-18-55mm", Some("V"), 25.0), ("planar-50mm-f1.4", None, 60.0)]
    {
        let system = lens(name, coating, 4.0);
        let tracer = GlareTracer::new(&system, 550.0, DVec2::new(18.0, 12.0), 0.3).unwrap();
        let beam = SourceBeam::at_field(&system, degrees).unwrap();
        // Chance says which way light goes, and only after one turn, where turning again is made likelier, how much a walk stands for: what that leaves is
        // of order R² / √rays.
        let b = tracer.balance(&beam, 2000);
        assert!((b.sum() - 1.0).abs() < 2e-4, "{name}: {b:?}");
        assert!(b.lost < 1e-3 && b.film > 0.0 && b.front > 0.0 && b.walls > 0.0, "{name}: {b:?}");
    }
}

/// A walk that chooses at every surface by chance alone, finds what it meets among all surfaces and walls, and computes films anew: how light came to the
/// film and where. Nothing of it is shared with the tracer but the shapes of surfaces, films and lobes.
fn analogue(
    system: &System,
    n: &[f64],
    nm: f64,
    half: f64,
    sensor: f64,
    ray: crate::ray::TracedRay,
    random: &mut Random,
) -> Option<(Kind, DVec2)> {
    let count = system.surfaces.len();
    let rim = |i: usize| {
        let s = &system.surfaces[i];
        (s.z + s.profile.sag(0.0, s.semi_diameter * (1.0 - 1e-9)).unwrap_or(0.0), s.semi_diameter)
    };
    let (mut o, mut d) = (ray.position, ray.direction);
    let (mut gap, mut turned, mut stray) = (0usize, false, false);
    for _ in 0..300 {
        // Walls by small steps and halving: no formula of cones.
        let mut best = f64::INFINITY;
        let mut what = None;
        for i in 0..count {
            let (lo, ld) = system.surfaces[i].to_local(o, d);
            for sense in [1.0, -1.0] {
                if let Some(m) = system.surfaces[i].profile.intersect(lo, ld, sense)
                    && m.t > 1e-7
                    && m.t < best
                    && (i == gap || i + 1 == gap)
                    && m.point.truncate().length() <= system.surfaces[i].semi_diameter
                {
                    best = m.t;
                    what = Some((i, m));
                }
            }
        }
        let film_t = (system.film_z - o.z) / d.z;
        let on_film = gap == count && film_t > 1e-7 && film_t < best;
        if on_film {
            best = film_t;
        }
        let wall = (gap > 0).then(|| {
            let (za, ra) = rim(gap - 1);
            let (zb, rb) = if gap < count { rim(gap) } else { (system.film_z, ra.max(1.1 * half * 2f64.sqrt())) };
            let outside = |t: f64| {
                let p = o + d * t;
                let r = ra + (rb - ra) * (p.z - za) / (zb - za);
                p.z > za && p.z < zb && p.truncate().length() > r
            };
            // No farther than where it leaves the tube.
            let leaves = (if d.z > 0.0 { zb - o.z } else { za - o.z }) / d.z;
            let end = best.min(leaves.clamp(1e-3, 300.0));
            let steps = 80;
            let first = (1..=steps).map(|k| end * k as f64 / steps as f64).find(|t| outside(*t))?;
            let (mut a, mut b) = (first - end / steps as f64, first);
            for _ in 0..50 {
                let t = 0.5 * (a + b);
                if outside(t) { b = t } else { a = t }
            }
            let at = o + d * a;
            let side = at.truncate().normalize();
            Some((at, DVec3::new(-side.x, -side.y, (rb - ra) / (zb - za)).normalize()))
        });
        let mut off = wall.flatten();
        if off.is_none() && on_film {
            let at = o + d * film_t;
            if at.x.abs().max(at.y.abs()) <= half {
                if random.draw() >= sensor {
                    let kind = if stray {
                        Kind::Scatter
                    } else if turned {
                        Kind::Ghost
                    } else {
                        Kind::Image
                    };
                    return Some((kind, at.truncate()));
                }
                (o, d.z, turned) = (at, -d.z, true);
                continue;
            }
            off = Some((at, DVec3::NEG_Z));
        }
        if off.is_none()
            && let Some((i, m)) = &what
            && *i == system.stop
            && system.iris.transmittance(m.point.x, m.point.y) == 0.0
        {
            off = Some((o + d * m.t, DVec3::Z * -d.z.signum()));
        }
        if let Some((at, normal)) = off {
            if random.draw() >= system.wall_reflectance {
                return None;
            }
            let (a, b) = normal.any_orthonormal_pair();
            let p = disk([random.draw(), random.draw()]);
            d = a * p.x + b * p.y + normal * (1.0 - p.length_squared()).sqrt();
            (o, stray) = (at + normal * 1e-6, true);
            continue;
        }
        let (i, m) = what?;
        let surface = &system.surfaces[i];
        let (way, after) = if gap == i { (TraceDirection::ToFilm, i + 1) } else { (TraceDirection::ToObject, i) };
        o = surface.to_lens(m.point, d).0;
        if system.glasses[gap] == system.glasses[after] {
            gap = after;
            continue;
        }
        let normal = m.normal.normalize() * m.normal.dot(d).signum();
        let cos0 = d.dot(normal);
        let cos2 = 1.0 - (n[gap] / n[after]).powi(2) * (1.0 - cos0 * cos0);
        let light = surface.coating.response(false, way, [n[gap], n[after]], cos0, nm);
        let (r, t) = if cos2 <= 0.0 { (1.0, 0.0) } else { (light.unpolarised_reflectance(), light.unpolarised_transmittance()) };
        let u = random.draw();
        if u > r + t {
            return None;
        }
        let air = |g: usize| (n[g] - 1.0).abs() < 1e-9;
        let dust = if air(gap) != air(after) { 2.0 * surface.finish.dust_fraction() } else { 0.0 };
        let (straight, index, step) = if u < r {
            (d - normal * (2.0 * cos0), n[gap], 2.0 * n[gap] * cos0)
        } else {
            let mu = n[gap] / n[after];
            (d * mu + normal * (cos2.sqrt() - mu * cos0), n[after], (n[after] * cos2.sqrt() - n[gap] * cos0).abs())
        };
        let rough = surface.finish.rough_fraction(step, nm);
        if u < r {
            turned = true
        } else {
            gap = after
        }
        d = straight;
        if random.draw() < rough + dust {
            let lobe = if random.draw() * (rough + dust) < rough { Lobe::polish(nm) } else { Lobe::dust(random.draw(), nm) };
            let (a, b) = normal.any_orthonormal_pair();
            let to = lobe.scatter(DVec2::new(straight.dot(a), straight.dot(b)), index, random);
            d = a * to.x + b * to.y + normal * (1.0 - to.length_squared()).sqrt() * straight.dot(normal).signum();
            stray = true;
        }
    }
    None
}

#[test]
fn the_glare_spread_function_is_that_of_an_analogue_walk() {
    // A bare, rough and dusty triplet, so that the plain walk finds glare often enough; walls that throw back a fifth.
    let mut p = embedded("triplet-50mm-f4").unwrap();
    p.finish = Finish { roughness_nm: 12.0, cleanliness: 600.0 };
    p.wall_reflectance = 0.2;
    let system = configure(&p, None, Some(5.6), None, FilmPlace::AsPublished).unwrap().system;
    let reach = 15.0;
    let spread = GlareSpread::of(&system, reach, 0.04, 3, 4000).unwrap();
    let n = system.indices(550.0);
    for field in &spread.fields[..2] {
        let beam = SourceBeam::at_field(&system, field.angle_deg).unwrap();
        let edges = [0.0, 1.0, 2.5, 5.0, 9.0, 20.0];
        let image = DVec2::new(0.0, field.height_mm);
        let ring = |at: DVec2| edges.windows(2).position(|e| (e[0]..e[1]).contains(&at.distance(image)));
        let (mut plain, mut ghosts, mut images) = ([0.0; 5], 0.0, 0.0);
        let rays = 150_000;
        for i in 0..rays {
            let place = disk(even(i)) * beam.radius();
            let mut random = Random::new(77, i as u64);
            // Up in y: the image lies below the axis.
            match analogue(&system, &n, 550.0, reach, 0.04, beam.ray(place), &mut random) {
                Some((Kind::Image, _)) => images += 1.0,
                Some((Kind::Ghost, _)) => ghosts += 1.0,
                Some((Kind::Scatter, at)) => ring(DVec2::new(at.x, -at.y)).into_iter().for_each(|k| plain[k] += 1.0),
                None => (),
            }
        }
        let mut found = ([0.0; 5], 0.0);
        for a in field.arrivals.iter().filter(|a| a.bin == 1) {
            match a.kind {
                Kind::Ghost => found.1 += a.fraction,
                _ => ring(a.at).into_iter().for_each(|k| found.0[k] += a.fraction),
            }
        }
        // The plain walk counts the sensor's absorbed light alone and its images lack what was scattered.
        let whole = images / (1.0 - 0.04) / field.kept[1];
        let check = |what: &str, found: f64, count: f64| {
            let known = count / (1.0 - 0.04) / whole;
            // Four standard errors of the counts, and 5 % for those of the other walk.
            let error = 4.0 * count.max(4.0).sqrt() / (1.0 - 0.04) / whole + 0.05 * known;
            assert!((found - known).abs() < error, "{what} at {:.1}°: {found} {known} ± {error}", field.angle_deg);
        };
        assert!(plain.iter().all(|c| *c > 100.0) && ghosts > 100.0, "{plain:?} {ghosts} {images}");
        for k in 0..5 {
            check(&format!("ring {k}"), found.0[k], plain[k]);
        }
        check("ghosts", found.1, ghosts);
        // What is kept of the image is what no surface scattered.
        assert!(field.kept[1] < 0.99 && field.kept[1] > 0.8, "{:?}", field.kept);
    }
}

#[test]
fn the_index_of_a_plate_of_glass_is_the_sum_of_its_reflections() {
    // A stop, then a bare plate of n = 1.5 with perfect surfaces: of light that comes through, the part that turned within it. A film that reflects nothing,
    // black walls. Over small angles, R = 4 %: direct T², all of it T² / (1 − R²).
    let text = "name = \"plate\"\nsurfaces = [ { stop = true, gap = 1, semi_diameter = 6 }, { gap = 5, glass = \"1.5\", semi_diameter = 8 }, \
        { gap = 30, semi_diameter = 8 } ]\n[stray]\nroughness_nm = 0\ncleanliness = 0\nwall_reflectance = 0\n";
    let p = crate::prescription::read_toml(text, "plate.toml").unwrap();
    let system = System::at(&p, crate::system::State::default());
    let tracer = GlareTracer::new(&system, 550.0, DVec2::splat(0.5), 0.0).unwrap();
    // A spot of no size: the plate's ghosts run along the image.
    let glare = veiling_glare(&tracer, DVec2::ZERO, 0.0, 60_000, |_| true).unwrap();
    // Ghosts cross the plate three times: the stop lets less of them through.
    let known = 0.04f64.powi(2) * ((31.0 + 5.0 / 1.5) / (31.0 + 15.0 / 1.5f64)).powi(2);
    // 0.04 at normal incidence, a little more at the stop's edge; counts of some thousand walks.
    assert!((glare.ghosts / known - 1.0).abs() < 0.1, "{} {known}", glare.ghosts);
    assert_eq!(glare.scatter, 0.0);
}

#[test]
fn a_hood_keeps_light_from_beside_off_and_takes_none_of_the_picture() {
    let p = embedded("double-gauss-50mm").unwrap();
    let film = DVec2::new(18.0, 12.0);
    let bare = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap().system;
    let hood = crate::prescription::Hood { length: 40.0, diameter: None };
    let hooded = configure(&p.with_hood(&hood, &bare, film), None, None, None, FilmPlace::AsPublished).unwrap().system;
    let light = |system: &System, degrees: f64| {
        let tracer = GlareTracer::new(system, 550.0, film, 0.04).unwrap();
        let (sin, cos) = degrees.to_radians().sin_cos();
        // Towards a corner.
        let beam = SourceBeam::new(system, DVec3::new(-0.832 * sin, -0.555 * sin, cos)).unwrap();
        let mut image = 0.0;
        let area = std::f64::consts::PI * beam.radius().powi(2) / 8000.0;
        let mut astray = 0.0;
        for i in 0..8000 {
            let place = disk(even(i)) * beam.radius();
            let power = beam.power_density(place) * area;
            let record = |kind: Kind, _: DVec2, weight: f64, _: f64| match kind {
                Kind::Image => image += power * weight,
                _ => astray += power * weight,
            };
            tracer.follow_from_object(beam.ray(place), &mut Random::new(5, i as u64), &mut Balance::default(), record);
        }
        [image, astray]
    };
    // The corner of the film is 23.4° off the axis: all of its light.
    let [a, b] = [&bare, &hooded].map(|s| light(s, 22.0)[0]);
    assert!((b / a - 1.0).abs() < 0.04, "{a} {b}");
    // From 62° off the tube is lit, not the glass.
    let [a, b] = [&bare, &hooded].map(|s| light(s, 62.0)[1]);
    assert!(b < 0.25 * a, "{a} {b}");
}

#[test]
fn lenses_without_an_axis_or_with_mirrors_are_refused() {
    let mut p = embedded("double-gauss-50mm").unwrap();
    p.surfaces[0].tilt = [1.0, 0.0, 0.0];
    let system = System::at(&p, crate::system::State::default());
    assert_eq!(GlareTracer::new(&system, 550.0, DVec2::ONE, 0.0).err(), Some(Unfit::NotRound));
    let mut p = embedded("double-gauss-50mm").unwrap();
    p.surfaces[0].mirror = true;
    let system = System::at(&p, crate::system::State::default());
    assert_eq!(GlareTracer::new(&system, 550.0, DVec2::ONE, 0.0).err(), Some(Unfit::Mirrors));
}

use super::beam::{COARSE, Sums};
use super::*;
use crate::compound::{FilmPlace, configure};
use crate::embedded;
use crate::prescription::read_toml;
use crate::ray::{TraceDirection, TracedRay};
use crate::system::State;
use glam::{DVec2, DVec3};

const NM: f64 = 546.0;

/// A step of xorshift64*, 0 to 1.
fn random(state: &mut u64) -> f64 {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
}

/// Light that does not know an order of surfaces: from where it is, it meets the nearest of the two that bound the gap, before or behind; it
/// is thrown back where `turns` says. No tables: reflectance from the films. Where it lands on the film, and its fraction.
fn plain(system: &System, n: &[f64], sensor: f64, ray: TracedRay, turns: &[usize]) -> Option<(DVec2, f64)> {
    let count = system.surfaces.len();
    let (mut o, mut d, mut fraction, mut gap) = (ray.position, ray.direction, 1.0, 0usize);
    let mut turns = turns.iter().copied().peekable();
    for _ in 0..200 {
        let mut nearest: Option<(f64, usize, crate::surface::SurfaceHit, DVec3)> = None;
        for i in [gap.checked_sub(1), (gap < count).then_some(gap)].into_iter().flatten() {
            let (lo, ld) = system.surfaces[i].to_local(o, d);
            for sense in [1.0, -1.0] {
                let met = system.surfaces[i].profile.intersect(lo, ld, sense).filter(|m| m.t > 1e-9);
                if let Some(m) = met.filter(|m| nearest.as_ref().is_none_or(|b| m.t < b.0))
                    && system.surfaces[i].lets_through(m.point.x, m.point.y)
                {
                    nearest = Some((m.t, i, m, ld));
                }
            }
        }
        let film = (gap == count).then(|| (system.film_z - o.z) / d.z).filter(|t| *t > 1e-9);
        if let Some(t) = film.filter(|t| nearest.as_ref().is_none_or(|b| *t < b.0)) {
            o += d * t;
            if turns.next_if_eq(&count).is_none() {
                return turns.peek().is_none().then_some((o.truncate(), fraction));
            }
            fraction *= sensor;
            d.z = -d.z;
            continue;
        }
        let (_, i, m, ld) = nearest?;
        let surface = &system.surfaces[i];
        let passes = if i == system.stop { system.iris.transmittance(m.point.x, m.point.y) } else { 1.0 };
        if !surface.lets_through(m.point.x, m.point.y) || passes == 0.0 {
            return None;
        }
        let (way, after) = if gap == i { (TraceDirection::ToFilm, i + 1) } else { (TraceDirection::ToObject, i) };
        let facing = ld.dot(m.normal);
        let normal = if facing < 0.0 { -m.normal } else { m.normal };
        let cos = facing.abs();
        let light = surface.coating.response(false, way, [n[gap], n[after]], cos, NM);
        let direction = if turns.next_if_eq(&i).is_some() {
            fraction *= light.unpolarised_reflectance();
            ld - normal * (2.0 * cos)
        } else {
            let mu = n[gap] / n[after];
            let cos2 = 1.0 - mu * mu * (1.0 - cos * cos);
            if cos2 < 0.0 {
                return None;
            }
            fraction *= light.unpolarised_transmittance();
            gap = after;
            ld * mu + normal * (cos2.sqrt() - mu * cos)
        };
        (o, d) = surface.to_lens(m.point, direction);
    }
    None
}

/// Position, size and flux of ghosts against random rays of the plain trace.
fn compare(system: &System, degrees: f64, chosen: &[Pair], rays: usize) -> usize {
    let ways: Vec<Vec<usize>> = chosen.iter().map(|p| vec![p.back, p.forth]).collect();
    compare_ways(system, degrees, &ways, rays)
}

/// The same by the surfaces at which light is thrown back.
fn compare_ways(system: &System, degrees: f64, ways: &[Vec<usize>], rays: usize) -> usize {
    let n = system.indices(NM);
    let tracer = GhostTracer::new(system, NM, 0.04);
    let beam = SourceBeam::at_field(system, degrees).unwrap();
    let mut state = 88_172_645_463_325_252;
    let mut compared = 0;
    for turns in ways {
        let name = format!("{turns:?}");
        let found = BeamGhost::of(&tracer, &beam, turns, 64);
        // Random rays over the part of the front that the grid says is all of it, and over the rest.
        let whole = [DVec2::splat(-beam.radius()), DVec2::splat(beam.radius())];
        let part = beam.extent(&tracer, turns, COARSE).unwrap_or(whole);
        let (mut sums, mut outside, mut hits, mut squares) = (Sums::default(), 0.0, 0, 0.0);
        for k in 0..rays {
            let corners = if k % 4 == 3 { whole } else { part };
            let place = corners[0] + (corners[1] - corners[0]) * DVec2::new(random(&mut state), random(&mut state));
            let Some((at, fraction)) = plain(system, &n, 0.04, beam.ray(place), turns) else { continue };
            let inside = place.cmpge(part[0]).all() && place.cmple(part[1]).all();
            match (k % 4 == 3, inside) {
                (false, _) => {
                    hits += 1;
                    squares += fraction * fraction;
                    sums.add(at, fraction);
                }
                (true, false) => outside += fraction,
                (true, true) => {}
            }
        }
        let drawn = (rays / 4 * 3) as f64;
        let size = part[1] - part[0];
        let (area, everywhere) =
            (size.x * size.y * beam.power_density(DVec2::ZERO) / drawn, 4.0 * beam.radius().powi(2) / (rays / 4) as f64);
        let Some(known) = sums.ghost(area) else {
            assert!(found.is_none_or(|g| g.flux_mm2 < 1e-9), "{name}: {found:?}, no plain light");
            continue;
        };
        let Some(found) = found else {
            // Narrower than the cells of the first look.
            let cells = (beam.radius() / 20.0).powi(2) * known.flux_mm2 / area / hits as f64;
            assert!(known.flux_mm2 < 3.0 * cells, "{name}: plain light {known:?}, none found");
            continue;
        };
        // A few rays of slivers beside the part that was found.
        let beside = (outside - 3.0 * known.flux_mm2 / area / hits as f64) * everywhere * beam.power_density(DVec2::ZERO);
        assert!(beside < 0.05 * known.flux_mm2, "{name}: {outside} outside of {hits}");
        // Too few rays, or light that films cancel all but wholly.
        if hits < 200 || known.flux_mm2 < 1e-7 {
            continue;
        }
        compared += 1;
        let hits = hits as f64;
        // Standard errors of the random rays: of the sum, of the mean, and of the root of a mean square; and what the rim of a grid of
        // 64 × 64 cells may be off.
        let filled = hits / drawn;
        let mean_square = squares / hits / (known.flux_mm2 / area / hits).powi(2);
        let flux_error = ((mean_square - filled) / hits).max(0.0).sqrt() * 4.0 + 0.02;
        assert!((found.flux_mm2 / known.flux_mm2 - 1.0).abs() < flux_error, "{name}: {} {}", found.flux_mm2, known.flux_mm2);
        let rms = known.rms_radius_mm();
        let position_error = rms * (4.0 * (mean_square / hits).sqrt() + 0.02) + 1e-6;
        assert!((found.center - known.center).length() < position_error, "{name}: {} {}", found.center, known.center);
        let size_error = 4.0 * (2.0 * mean_square / hits).sqrt() + 0.02;
        assert!((found.rms_radius_mm() / rms - 1.0).abs() < size_error, "{name}: {} {rms}", found.rms_radius_mm());
        let irradiance_error = flux_error + 2.0 * size_error;
        assert!((found.irradiance() / known.irradiance() - 1.0).abs() < irradiance_error, "{name}");
    }
    compared
}

#[test]
fn every_ghost_of_a_double_gauss_is_where_random_rays_put_it() {
    let p = embedded("double-gauss-50mm").unwrap();
    let system = configure(&p, None, Some(2.8), None, FilmPlace::AsPublished).unwrap().system;
    let all = pairs(&system);
    // Ten surfaces of glass, cemented ones too, and the sensor.
    assert_eq!(all.len(), 45 + 10);
    let compared = compare(&system, 8.0, &all, 2400);
    assert!(compared > 30, "{compared}");
}

#[test]
fn ghosts_of_a_coated_zoom_are_where_random_rays_put_them() {
    let mut p = embedded("kit-zoom-18-55mm").unwrap();
    p.coating = crate::prescription::coating_named("broadband", None).unwrap();
    let system = configure(&p, None, Some(5.6), None, FilmPlace::AsPublished).unwrap().system;
    let some: Vec<Pair> = pairs(&system).into_iter().step_by(9).collect();
    let compared = compare(&system, 15.0, &some, 1600);
    // Most pairs of a coated zoom at its wide end bring next to no light to the film; each that does is compared.
    assert!(compared > 1, "{compared} of {}", some.len());
}

#[test]
#[ignore = "minutes: every pair of a coated zoom at three fields and both ends"]
fn every_ghost_of_a_coated_zoom_is_where_random_rays_put_it() {
    for (coating, focal) in [("broadband", 18.0), ("broadband", 55.0), ("none", 18.0)] {
        let mut p = embedded("kit-zoom-18-55mm").unwrap();
        p.coating = crate::prescription::coating_named(coating, None).unwrap();
        let system = configure(&p, Some(focal), Some(5.6), None, FilmPlace::AsPublished).unwrap().system;
        let all = pairs(&system);
        let compared: Vec<usize> = [2.0, 8.0, 15.0].map(|degrees| compare(&system, degrees, &all, 12_000)).to_vec();
        println!("{coating} at {focal} mm: {compared:?} of {} pairs", all.len());
        assert!(compared.iter().sum::<usize>() > 10, "{compared:?}");
    }
}

#[test]
fn matrices_tell_where_thin_real_beams_go() {
    let p = embedded("double-gauss-50mm").unwrap();
    let system = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap().system;
    let tracer = GhostTracer::new(&system, NM, 0.04);
    let fours = strong_fours(&tracer, 1e-8, 100);
    assert!(fours.len() > 30, "{}", fours.len());
    let ways = pairs(&system).into_iter().map(|p| vec![p.back, p.forth]).chain(fours.into_iter().map(|f| f.to_vec()));
    for turns in ways {
        let ghost = ParaxialGhost::of(&tracer, &turns).unwrap();
        let name = format!("{turns:?}");
        // Thin enough that rays stay paraxial wherever the way blows them up.
        let h = 1e-3 / (1.0 + ghost.spread.abs());
        let ray = |y: f64, slope: f64| TracedRay {
            position: DVec3::new(0.0, y - 2.0 * slope, -2.0),
            direction: DVec3::new(0.0, slope, 1.0).normalize(),
        };
        let parallel = tracer.follow(ray(h, 0.0), &turns).unwrap();
        assert!((parallel.film.y / h / ghost.spread - 1.0).abs() < 1e-3, "{name}: {} {}", parallel.film.y / h, ghost.spread);
        let focus = -parallel.film.y / (parallel.direction.y / parallel.direction.z);
        assert!((focus / ghost.focus_mm - 1.0).abs() < 1e-3, "{name}: {focus} {}", ghost.focus_mm);
        let slope = 1e-4 / (1.0 + ghost.shift_mm.abs());
        let middle = tracer.follow(ray(0.0, slope), &turns).unwrap();
        // In units of a millimetre where it is next to nothing.
        let shift = middle.film.y / slope;
        assert!((shift - ghost.shift_mm).abs() < 1e-3 * (1.0 + ghost.shift_mm.abs()), "{name}: {shift} {}", ghost.shift_mm);
        assert!((parallel.fraction / ghost.fraction - 1.0).abs() < 1e-3, "{name}");
        // A ray just within the paraxial pupil is at the rim of the surface that limits it.
        assert!(ghost.pupil_radius_mm > 0.0 && ghost.pupil_radius_mm <= system.surfaces[0].semi_diameter, "{name}");
    }
}

#[test]
fn direct_light_is_what_the_trace_of_the_lens_says() {
    let p = embedded("planar-50mm-f1.4").unwrap();
    let system = System::at(&p, State::default());
    let tracer = GhostTracer::new(&system, NM, 0.04);
    let n = system.indices(NM);
    for (y, slope) in [(0.0, 0.0), (4.0, -0.1), (-7.0, 0.2)] {
        let ray =
            TracedRay { position: DVec3::new(1.0, y - 20.0 * slope, -20.0), direction: DVec3::new(0.03, slope, 1.0).normalize() };
        let found = tracer.follow(ray, &[]).unwrap();
        let known = system.transmittance(ray, &n, NM, TraceDirection::ToFilm).unwrap();
        let end = system.trace(ray, &n, TraceDirection::ToFilm, crate::ray::Apertures::Clip).unwrap();
        assert!((found.fraction / known - 1.0).abs() < 1e-4, "{} {known}", found.fraction);
        assert!((crate::trace::at_plane(&end, system.film_z).truncate() - found.film).length() < 1e-12);
    }
}

/// Lists of turns of a plate and a sensor (surfaces 0, 1, 2) with at most so many turns, that end on the film.
fn ways(most: usize) -> Vec<Vec<usize>> {
    let mut all = vec![vec![]];
    let mut last: Vec<Vec<usize>> = vec![vec![]];
    for _ in 0..most / 2 {
        let mut longer = vec![];
        for way in &last {
            for back in 0..3usize {
                // Light comes from where it turned last; it can turn at what lies ahead.
                if way.last().is_some_and(|forth| back <= *forth) {
                    continue;
                }
                longer.extend((0..back).map(|forth| way.iter().copied().chain([back, forth]).collect::<Vec<_>>()));
            }
        }
        all.extend(longer.iter().cloned());
        last = longer;
    }
    all
}

#[test]
fn all_light_that_enters_is_reflected_absorbed_or_recorded() {
    // A plate of absorbing glass with a metal film on its front, before a sensor that reflects 30 %: all ways with up to 12 turns.
    let text = "name = \"plate\"\nsurfaces = [\n\
        { gap = 5, glass = \"1.9\", absorption = 0.01, semi_diameter = 50, stop = true, coating = [{ material = \"Cr\", thickness_nm = 3 }] },\n\
        { gap = 10, semi_diameter = 50 } ]\n";
    let system = System::at(&read_toml(text, "plate.toml").unwrap(), State::default());
    let sensor = 0.3;
    let tracer = GhostTracer::new(&system, NM, sensor);
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let ray = TracedRay { position: DVec3::new(0.0, 0.0, -1.0), direction: DVec3::new(0.0, sin, cos) };
    let recorded: f64 = ways(12).iter().map(|way| tracer.follow(ray, way).map_or(0.0, |a| a.fraction * (1.0 - sensor))).sum();
    // The same summed up as geometric series.
    let cos1 = (1.0 - (sin / 1.9).powi(2)).sqrt();
    let glass = (-0.01 * 5.0 / cos1).exp();
    let front = system.surfaces[0].coating.response(false, TraceDirection::ToFilm, [1.0, 1.9], cos, NM);
    let inner = system.surfaces[0].coating.response(false, TraceDirection::ToObject, [1.9, 1.0], cos1, NM);
    let rear = system.surfaces[1].coating.response(false, TraceDirection::ToFilm, [1.9, 1.0], cos1, NM);
    let (r1, r1_inside, t1) =
        (front.unpolarised_reflectance(), inner.unpolarised_reflectance(), front.unpolarised_transmittance());
    let (r2, t2) = (rear.unpolarised_reflectance(), rear.unpolarised_transmittance());
    let within = 1.0 / (1.0 - r1_inside * r2 * glass * glass);
    let through = t1 * t2 * glass * within;
    let (back_front, back_rear) = (r1 + t1 * t1 * r2 * glass * glass * within, r2 + t2 * t2 * r1_inside * glass * glass * within);
    let arriving = through / (1.0 - back_rear * sensor);
    assert!((recorded - arriving * (1.0 - sensor)).abs() < 1e-4, "{recorded} {}", arriving * (1.0 - sensor));
    // What goes back out of the front, and what stays: of light of power `there` on the inner side of the front the film takes a part; of
    // what crosses the glass, the glass.
    let reflected = back_front + through * arriving * sensor;
    let into_film = 1.0 - r1 - t1;
    // Power that leaves the front's inner side towards the rear, and comes back to it.
    let from_behind = arriving * sensor * t2;
    let ahead = (t1 + r1_inside * glass * from_behind) * within;
    let coming = (ahead * glass * r2 + from_behind) * glass;
    let absorbed = into_film
        + coming * (1.0 - r1_inside - inner.unpolarised_transmittance())
        + (ahead + ahead * glass * r2 + from_behind) * (1.0 - glass);
    let sum = recorded + reflected + absorbed;
    assert!((sum - 1.0).abs() < 1e-3, "{recorded} + {reflected} + {absorbed} = {sum}");
}

#[test]
fn a_far_point_is_a_parallel_beam_and_a_near_one_spreads_its_light() {
    let p = embedded("double-gauss-50mm").unwrap();
    let system = System::at(&p, State::default());
    let parallel = SourceBeam::at_field(&system, 12.0).unwrap();
    let direction = parallel.ray(DVec2::ZERO).direction;
    let far = SourceBeam::from_point(&system, parallel.middle() - direction * 1e9).unwrap();
    for place in [DVec2::ZERO, DVec2::new(5.0, -3.0)] {
        assert!((far.ray(place).position - parallel.ray(place).position).length() < 1e-5);
        assert!((far.power_density(place) - parallel.power_density(place)).abs() < 1e-7);
    }
    // On the axis at 20 mm the light at 15 mm from the middle has gone 25 mm and falls in at a cosine of 0.8.
    let near = SourceBeam::from_point(&system, parallel.middle() - DVec3::Z * 20.0).unwrap();
    assert!((near.power_density(DVec2::new(15.0, 0.0)) - (20.0f64 / 25.0).powi(2) * 0.8).abs() < 1e-12);
    assert!(SourceBeam::from_point(&system, parallel.middle() + DVec3::Z).is_none());
}

#[test]
fn a_lens_without_reflections_has_no_ghosts() {
    let text = "name = \"l\"\ncoating = \"perfect\"\nsurfaces = [\n{ radius = 50, gap = 3, glass = \"1.62\", semi_diameter = 9, stop = true },\n\
        { radius = -60, gap = 40, semi_diameter = 9 } ]\n";
    let system = System::at(&read_toml(text, "l.toml").unwrap(), State::default());
    assert!(pairs(&system).is_empty());
    assert!(SourceBeam::at_field(&system, 95.0).is_none());
}

#[test]
fn ghosts_of_four_reflections_are_where_random_rays_put_them() {
    let p = embedded("double-gauss-50mm").unwrap();
    let system = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap().system;
    let tracer = GhostTracer::new(&system, NM, 0.04);
    let strong: Vec<Vec<usize>> = strong_fours(&tracer, 1e-8, 12).into_iter().map(|four| four.to_vec()).collect();
    assert!(strong.len() == 12 && strong.iter().any(|four| four.contains(&system.surfaces.len())), "{strong:?}");
    assert!(compare_ways(&system, 5.0, &strong, 12_000) >= 6, "{strong:?}");
}

/// Orders of the sensor's grating leave as the grating equation says, with the light that is theirs; the order 0 is the mirror's, less what the others take.
#[test]
fn orders_of_microlenses_leave_as_the_grating_equation_says() {
    let p = embedded("double-gauss-50mm").unwrap();
    let system = configure(&p, None, None, None, FilmPlace::AsPublished).unwrap().system;
    let plain = GhostTracer::new(&system, NM, 0.04);
    let pitch = 4e-3;
    let tracer = GhostTracer::new(&system, NM, 0.04).with_microlenses([pitch, 2.0 * pitch]);
    let ray = TracedRay { position: DVec3::new(1.0, 2.0, -10.0), direction: DVec3::new(0.0, 0.03, 1.0).normalize() };
    let arrival = tracer.follow(ray, &[]).unwrap();
    let last = system.surfaces.len() - 1;
    let mirrored = plain.follow(ray, &[last + 1, last]).unwrap();
    let of = |order: [i32; 2]| tracer.follow_back(&arrival, order, &[last]);
    let zero = of([0, 0]).unwrap();
    assert!((zero.film - mirrored.film).length() < 1e-9);
    let grating = tracer.grating().unwrap();
    let share = 1.0 - MICROLENS_FRACTION + MICROLENS_FRACTION * grating.efficiency([0, 0]);
    assert!((zero.fraction / mirrored.fraction - share).abs() < 1e-9 && share < 0.6, "{share}");
    // Where an order meets the plane of the last vertex, by its direction; seen by its way back to the film if that plane were a mirror: twice as far.
    let distance = system.film_z - system.last_z();
    for order in [[1, 0], [0, 1], [-1, 2]] {
        let turn = [NM * 1e-6 / pitch, NM * 1e-6 / (2.0 * pitch)];
        let (x, y) = (arrival.direction.x + f64::from(order[0]) * turn[0], arrival.direction.y + f64::from(order[1]) * turn[1]);
        let slope = DVec2::new(x, y) / (1.0 - x * x - y * y).sqrt();
        // The last surface is not plane: by its own law of reflection.
        let start = DVec3::new(arrival.film.x, arrival.film.y, system.film_z);
        let direction = DVec3::new(slope.x, slope.y, -1.0).normalize();
        let surface = &system.surfaces[last];
        let (o, d) = surface.to_local(start, direction);
        let met = surface.profile.intersect(o, d, -1.0).unwrap();
        let normal = met.normal.normalize();
        let back = d - normal * (2.0 * d.dot(normal));
        let end = met.point + back * ((distance - met.point.z) / back.z);
        let found = of(order).unwrap();
        assert!((found.film - end.truncate()).length() < 1e-9, "{order:?}: {found:?} {end}");
        let light = MICROLENS_FRACTION * grating.efficiency(order) / share;
        // Reflectance of the bare glass hardly changes at these angles.
        assert!(
            (found.fraction / zero.fraction / light - 1.0).abs() < 0.02,
            "{order:?}: {} {light}",
            found.fraction / zero.fraction
        );
    }
    // An order that would leave along the sensor does not.
    assert!(of([8, 0]).is_err());
}

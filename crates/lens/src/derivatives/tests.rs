use super::*;
use crate::ray::{Apertures, TracedRay};
use crate::surface::Asphere;
use crate::system::State;
use crate::{embedded, prescription::read_toml};

fn changed(system: &System, n: &[f64], parameter: Parameter, by: f64) -> (System, Vec<f64>) {
    let (mut system, mut n) = (system.clone(), n.to_vec());
    match parameter {
        Parameter::Curvature(s) => {
            let p = &mut system.surfaces[s].profile;
            *p = crate::tolerance::bent_to(p, p.base_curvature() + by);
        }
        Parameter::Conic(s) | Parameter::Coefficient(s, _) => {
            let (c, k, a) = system.surfaces[s].profile.conic_and_powers().unwrap();
            let (mut k, mut a) = (k, a.to_vec());
            match parameter {
                Parameter::Coefficient(_, power) => {
                    a.resize(a.len().max(power + 1), 0.0);
                    a[power] += by;
                }
                _ => k += by,
            }
            system.surfaces[s].profile = Profile::Asphere(Asphere { c, k, a });
        }
        Parameter::Gap(s) => {
            for later in &mut system.surfaces[s + 1..] {
                later.z += by;
                if let Some(f) = &mut later.frame {
                    f.0.translation.z += by;
                    **f = (f.0, f.0.inverse());
                }
            }
            system.film_z += by;
        }
        Parameter::Index(s) => n[s + 1] += by,
    }
    (system, n)
}

/// A quantity by the plain trace.
fn plain(system: &System, n: &[f64], ray: TracedRay, quantity: Quantity, surfaces: usize) -> f64 {
    let (mut path, mut met) = (0.0, [0.0; 2]);
    let visit = |e: crate::trace::Event| {
        path += e.path;
        met = system.surfaces[e.surface].to_local(e.point, e.direction).0.truncate().to_array();
    };
    let end = system.trace_part(ray, n, TraceDirection::ToFilm, Apertures::Ignore, 0..surfaces, visit).unwrap();
    let t = (system.film_z - end.position.z) / end.direction.z;
    match quantity {
        Quantity::Place(axis) => (end.position + end.direction * t)[axis],
        Quantity::Cosine(axis) => end.direction[axis],
        Quantity::Path => path + n[surfaces] * t,
        Quantity::Intersection(axis) => met[axis],
    }
}

#[test]
fn derivatives_are_those_of_the_plain_trace() {
    // Tilted, decentred, aspheric with odd powers, toroidal, biconic and Q-type shapes, and a mirror.
    let odd = read_toml(
        "name = \"odd\"\nsurfaces = [\n\
         { radius = 40, conic = -0.7, asphere = { 3 = 3e-5, 4 = -2e-6, 5 = 1e-8 }, gap = 4, glass = \"1.6\", semi_diameter = 9, tilt_deg = [2, -3, 10] },\n\
         { radius = -90, gap = 3, semi_diameter = 9, decenter = [0.3, -0.2] },\n\
         { gap = 2, semi_diameter = 8, stop = true },\n\
         { radius = 70, radius_x = 120, gap = 3, glass = \"1.7\", semi_diameter = 9 },\n\
         { gap = 5, semi_diameter = 9 },\n\
         { radius = -50, radius_x = -80, conic = -0.5, conic_x = 0.3, gap = 3, glass = \"1.5\", semi_diameter = 9 },\n\
         { radius = -60, q_con = { radius = 9, terms = [0.02, -0.01] }, gap = 60, semi_diameter = 9 } ]",
        "odd.toml",
    );
    let mut lenses = vec![("odd".to_owned(), odd.unwrap())];
    for name in ["double-gauss-50mm", "phone-5.6mm-f3.5", "reflex-500mm-f8", "anamorphic-31mm", "compact-6mm-f1.9"] {
        lenses.push((name.to_owned(), embedded(name).unwrap()));
    }
    let quantities =
        [Quantity::Place(0), Quantity::Place(1), Quantity::Cosine(0), Quantity::Cosine(1), Quantity::Cosine(2), Quantity::Path];
    for (name, lens) in &lenses {
        let tangent = if ["reflex-500mm-f8", "anamorphic-31mm"].contains(&name.as_str()) { 0.01 } else { 0.1 };
        let mut system = System::at(lens, State::default());
        for s in &mut system.surfaces {
            (s.semi_diameter, s.obstruction) = (1e9, 0.0);
            s.apertures.clear();
        }
        system.iris.radius = 1e9;
        system.iris.shape = crate::iris::Iris::Round;
        let n = system.indices(550.0);
        let count = system.surfaces.len();
        let mut parameters = vec![];
        for s in 0..count {
            parameters.extend([Parameter::Curvature(s), Parameter::Gap(s)]);
            if !system.surfaces[s].mirror && s + 1 < count {
                parameters.push(Parameter::Index(s));
            }
            if let Some((c, ..)) = system.surfaces[s].profile.conic_and_powers() {
                parameters.extend([Parameter::Coefficient(s, 4), Parameter::Coefficient(s, 3)]);
                parameters.extend((c != 0.0).then_some(Parameter::Conic(s)));
            }
        }
        // The housing of the anamorphic lens is much wider than its beam.
        let part = if name == "anamorphic-31mm" { 0.1 } else { 0.25 };
        let reach = part * lens.surfaces[0].semi_diameter.unwrap();
        let ray = |i: usize| {
            let at = |k: usize| (i * k % 17) as f64 / 8.0 - 1.0;
            let direction = DVec3::new(0.2 * tangent * at(5), tangent * (1.0 + 0.2 * at(7)), 1.0).normalize();
            let ahead = DVec3::new(reach * at(3) + 0.55 * reach, 0.5 * reach * at(11) - 0.3 * reach, 0.0);
            TracedRay { position: ahead - direction * 5.0, direction }
        };
        let mut packet = Packet::default();
        (0..LANES).for_each(|i| packet.set(i, ray(i).position.to_array(), ray(i).direction.to_array()));
        let (batch, lanes) = (Batch::new(&system), Indices::uniform(&n));
        let lens = Differentiated::new(&system, &parameters).unwrap();
        for (surfaces, quantities) in
            [(count, &quantities[..]), (system.stop + 1, &[Quantity::Intersection(0), Quantity::Intersection(1)])]
        {
            let traced = lens.trace(&batch, &packet, &n, &lanes, surfaces).unwrap_or_else(|| panic!("{name}: rays are lost"));
            for quantity in quantities {
                let gradient = lens.gradient(&traced, *quantity);
                for (number, parameter) in parameters.iter().enumerate() {
                    let step = match parameter {
                        Parameter::Curvature(_) => 1e-5 / reach,
                        Parameter::Coefficient(_, power) => 1e-5 * reach.powi(1 - *power as i32),
                        Parameter::Conic(_) => 1e-3,
                        Parameter::Gap(_) | Parameter::Index(_) => 1e-4,
                    };
                    let difference = |i: usize, h: f64| {
                        let [(more, m), (less, l)] = [h, -h].map(|h| changed(&system, &n, *parameter, h));
                        (plain(&more, &m, ray(i), *quantity, surfaces) - plain(&less, &l, ray(i), *quantity, surfaces))
                            / (2.0 * h)
                    };
                    // Richardson's step from two central differences.
                    let exact: Vec<f64> =
                        (0..LANES).map(|i| (4.0 * difference(i, step) - difference(i, 2.0 * step)) / 3.0).collect();
                    let largest = exact.iter().fold(1e-6f64 / step.max(1e-6), |a, v| a.max(v.abs()));
                    for i in 0..LANES {
                        let apart = (gradient.by[number][i] - exact[i]).abs();
                        assert!(
                            apart < 1e-6 * largest,
                            "{name} {quantity:?} by {parameter:?}, ray {i}: {} {}",
                            gradient.by[number][i],
                            exact[i]
                        );
                    }
                }
                for (k, by) in gradient.by_start.iter().enumerate() {
                    for (i, by) in by.iter().enumerate() {
                        let moved = |h: f64| {
                            let mut r = ray(i);
                            if k < 3 {
                                r.position[k] += h
                            } else {
                                r.direction[k - 3] += h
                            }
                            r
                        };
                        // A direction that is no unit vector is none of a ray: only changes across it are asked for.
                        if k < 3 {
                            let [more, less] = [1e-4, -1e-4].map(|h| plain(&system, &n, moved(h), *quantity, surfaces));
                            assert!(
                                (by - (more - less) / 2e-4).abs() < 1e-6 * (1.0 + by.abs()),
                                "{name} {quantity:?} by start {k}"
                            );
                        }
                    }
                }
                let across = |i: usize| ray(i).direction.any_orthonormal_vector();
                for i in 0..LANES {
                    let turned = |h: f64| {
                        let mut r = ray(i);
                        r.direction = (r.direction + across(i) * h).normalize();
                        plain(&system, &n, r, *quantity, surfaces)
                    };
                    let expected = (turned(1e-5) - turned(-1e-5)) / 2e-5;
                    let found: f64 = (0..3).map(|k| gradient.by_start[3 + k][i] * across(i)[k]).sum();
                    assert!(
                        (found - expected).abs() < 1e-6 * (1.0 + expected.abs()),
                        "{name} {quantity:?} by direction: {found} {expected}"
                    );
                }
            }
        }
    }
}

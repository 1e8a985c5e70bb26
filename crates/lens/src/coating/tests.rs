use super::*;
use crate::batch::single::{Batch, Indices, LANES, Packet};
use crate::prescription::read_toml;
use crate::ray::TracedRay;
use crate::system::{State, System};
use glam::DVec3;

/// Ten stacks, at four angles each, s and p: `validation/coatings.py`.
const TMM: &str = include_str!("data/tmm.csv");

#[test]
fn stacks_reflect_and_transmit_as_another_program_says() {
    let mut names = std::collections::BTreeSet::new();
    let number = |t: &str| t.parse::<f64>().unwrap();
    for row in TMM.lines().filter(|l| !l.starts_with('#')) {
        let cells: Vec<&str> = row.split(',').collect();
        let [name, nm, first, films, last, degrees, polarisation, r, t, phase_r, phase_t] = cells[..] else {
            panic!("{row}");
        };
        names.insert(name);
        let films: Vec<(Complex, f64)> = films
            .split_whitespace()
            .map(|film| {
                let v: Vec<f64> = film.split(':').map(number).collect();
                (Complex::new(v[0], v[1]), v[2])
            })
            .collect();
        let (n, k) = last.split_once(':').unwrap();
        let substrate = Complex::new(number(n), number(k));
        let cos = number(degrees).to_radians().cos();
        let found = response(number(first), films.iter().copied(), substrate, cos, number(nm));
        let i = usize::from(polarisation == "p");
        let place = format!("{name} {degrees}° {polarisation}");
        // The same formulas in another order: only rounding is left.
        for (found, known) in [(found.reflectance[i], number(r)), (found.transmittance[i], number(t))] {
            assert!((found - known).abs() < 1e-10, "{place}: {found} {known}");
        }
        // tmm stops the decay within a film at exp(−35): what comes through the thick one has no phase to compare.
        let apart = |a: f64, b: f64| ((a - b).sin().powi(2) + ((a - b).cos() - 1.0).powi(2)).sqrt();
        for (found, known, power) in
            [(found.reflected_phase[i], number(phase_r), number(r)), (found.transmitted_phase[i], number(phase_t), number(t))]
        {
            assert!(power < 1e-12 || apart(found, known) < 1e-7, "{place}: phase {found} {known}");
        }
        let whole = found.reflectance[i] + found.transmittance[i] + found.absorptance()[i];
        assert!((whole - 1.0).abs() < 1e-12 && found.absorptance()[i] > -1e-12, "{place}");
    }
    assert_eq!(names.len(), 10);
}

#[test]
fn films_that_absorb_let_light_through_alike_both_ways_but_reflect_otherwise() {
    let stack = Stack {
        layers: vec![
            Layer { material: Material::parse("Cr").unwrap(), thickness_nm: 12.0 },
            Layer { material: Material::parse("SiO2").unwrap(), thickness_nm: 80.0 },
        ],
    };
    let (n0, n1, cos0): (f64, f64, f64) = (1.0, 1.7, 0.6);
    let cos1 = (1.0 - (n0 / n1).powi(2) * (1.0 - cos0 * cos0)).sqrt();
    let there = stack.response(TraceDirection::ToFilm, n0, n1.into(), cos0, 530.0);
    let back = stack.response(TraceDirection::ToObject, n1, n0.into(), cos1, 530.0);
    for i in 0..2 {
        assert!((there.transmittance[i] - back.transmittance[i]).abs() < 1e-12, "{there:?} {back:?}");
    }
    assert!((there.reflectance[0] - back.reflectance[0]).abs() > 0.01);
}

#[test]
fn recipes_do_what_they_are_named_for() {
    let mean = |stack: &Stack, ns: f64| {
        let at = |nm: f64| stack.response(TraceDirection::ToFilm, 1.0, ns.into(), 1.0, nm).reflectance[0];
        (0..=27).map(|i| at(425.0 + 10.0 * i as f64)).sum::<f64>() / 28.0
    };
    for ns in [1.5, 1.6, 1.72, 1.85] {
        let glass = Glass::constant(ns).unwrap();
        let at = |recipe: Recipe, design: f64, nm: f64| {
            recipe.stack(&glass, design).response(TraceDirection::ToFilm, 1.0, ns.into(), 1.0, nm).reflectance[0]
        };
        // Nothing at the design wavelength: V coats exactly; three layers where the inner material can be had (1.63 to 2.15).
        assert!(at(Recipe::TwoLayerV, 633.0, 633.0) < 1e-9, "{ns}");
        assert!(at(Recipe::TwoLayerV, 633.0, 450.0) > 0.01, "{ns}");
        assert!(at(Recipe::ThreeLayer, 520.0, 520.0) < 1e-6, "{ns}");
        // A quarter wave: ((n1² − ns) / (n1² + ns))².
        let n1 = Material::parse("MgF2").unwrap().index(520.0).re;
        let known = ((n1 * n1 - ns) / (n1 * n1 + ns)).powi(2);
        assert!((at(Recipe::SingleLayer, 520.0, 520.0) - known).abs() < 1e-12, "{ns}");
        // The broader the more layers: bare, one, three, six. Vendors' "below 0.4 %" lies between the last two.
        let bare = ((ns - 1.0) / (ns + 1.0)).powi(2);
        let all = [Recipe::SingleLayer, Recipe::ThreeLayer, Recipe::Modern].map(|r| mean(&r.stack(&glass, DESIGN_NM), ns));
        assert!(bare > 2.0 * all[0] && all[2] < 0.0025, "{ns}: {bare} {all:?}");
        assert!(all[1] < 0.008 && all[2] < all[1] && (all[1] < all[0] || ns > 1.8), "{ns}: {all:?}");
    }
    // On glass of n1² and more there is no V: a quarter wave does it.
    let dense = Glass::constant(1.95).unwrap();
    assert_eq!(Recipe::TwoLayerV.stack(&dense, 550.0), Recipe::SingleLayer.stack(&dense, 550.0));
    // Between the rows of the modern recipe as good as on them.
    let between = Recipe::Modern.stack(&Glass::constant(1.676).unwrap(), DESIGN_NM);
    assert!(mean(&between, 1.676) < 0.0018, "{}", mean(&between, 1.676));
    assert_eq!([1935, 1950, 1985, 2015].map(|y| by_year(y).describe().len() > 4), [false, true, true, true]);
}

#[test]
fn the_closed_form_of_a_quarter_wave_is_the_matrix_of_one_film() {
    let film = [(Complex::from(MGF2), 0.25 * FILM_NM / MGF2)];
    let lens = "name = \"l\"\ncoating = \"MgF2\"\nsurfaces = [\n{ radius = 50, gap = 3, glass = \"1.62\", semi_diameter = 9, stop = true },\n\
        { radius = -60, gap = 40, semi_diameter = 9 } ]\n";
    let system = System::at(&read_toml(lens, "l.toml").unwrap(), State::default());
    for (nm, cos0) in [(430.0, 1.0), (550.0, 0.7), (700.0, 0.3f64)] {
        let cos1 = (1.0 - (1.0 - cos0 * cos0) / (1.62f64 * 1.62)).sqrt();
        let known = response(1.0, film.into_iter(), 1.62.into(), cos0, nm).unpolarised_transmittance();
        let found = system.surface_transmittance(0, TraceDirection::ToFilm, [1.0, 1.62], [cos0, cos1], nm);
        assert!((found - known).abs() < 1e-12, "{nm} {cos0}: {found} {known}");
    }
}

/// A cemented doublet and a mirror coating, every kind of stack on it.
const COATED: &str = "name = \"c\"\ncoating = \"broadband\"\nsurfaces = [\n\
    { radius = 30, gap = 4, glass = \"N-BK7\", semi_diameter = 9, stop = true },\n\
    { radius = -25, gap = 2, glass = \"N-SF11\", semi_diameter = 9, coating = [{ material = \"Ag\", thickness_nm = 12 }] },\n\
    { radius = -80, gap = 5, semi_diameter = 9 },\n\
    { radius = 60, gap = 3, glass = \"N-LAK9\", semi_diameter = 9, coating = { recipe = \"V\", design_nm = 600 } },\n\
    { radius = -300, gap = 30, semi_diameter = 9, coating = \"modern\" },\n\
    { mirror = true, gap = -20, semi_diameter = 30, coating = { design_nm = 600, layers = [{ n = 1.46, quarter_waves = 1 }, { n = 2.3, k = 0.001, quarter_waves = 1 }] } },\n]\n";

#[test]
fn packets_look_up_what_the_plain_trace_computes() {
    let system = System::at(&read_toml(COATED, "c.toml").unwrap(), State::default());
    let batch = Batch::new(&system);
    let mut compared = 0;
    for way in [TraceDirection::ToFilm, TraceDirection::ToObject] {
        let mut packet = Packet::default();
        let mut rays = vec![];
        let mut nm = [0.0; LANES];
        for i in 0..LANES {
            let f = |k: usize| ((i * k % 31) as f64 / 15.0 - 1.0) * 6.0;
            let (from, towards) = match way {
                TraceDirection::ToFilm => (DVec3::new(f(7), f(11), -30.0), DVec3::new(0.02 * f(5), 0.02 * f(3), 1.0)),
                // From beyond the mirror's focus: the film lies on the side the mirror throws light to.
                TraceDirection::ToObject => (DVec3::new(f(7), f(11), system.film_z), DVec3::new(0.02 * f(5), 0.02 * f(3), 1.0)),
            };
            let d = towards.normalize();
            packet.set(i, from.as_vec3().to_array(), d.as_vec3().to_array());
            rays.push(TracedRay { position: from, direction: d });
            nm[i] = 385.0 + 12.3 * i as f32;
        }
        let mut n = Indices::default();
        batch.indices(&nm, &mut n);
        let mask = batch.trace_light(&mut packet, &n, &nm, way);
        for i in 0..LANES {
            let nm = nm[i] as f64;
            let plain = system.transmittance(rays[i], &system.indices(nm), nm, way);
            if let (true, Ok(plain)) = (mask >> i & 1 == 1, plain) {
                compared += 1;
                // Six surfaces, each within the table's 3e-4.
                assert!((packet.fraction[i] as f64 / plain - 1.0).abs() < 1.5e-3, "{way:?} {nm}: {} {plain}", packet.fraction[i]);
            }
        }
    }
    assert!(compared > 30, "{compared}");
}

#[test]
fn prescriptions_with_coatings_read_back_the_same_and_say_what_is_wrong() {
    let lens = read_toml(COATED, "c.toml").unwrap();
    let again = read_toml(&lens.to_toml(), "again.toml").unwrap();
    assert_eq!(again.coating, lens.coating);
    for (a, b) in again.surfaces.iter().zip(&lens.surfaces) {
        assert_eq!(a.coating, b.coating);
    }
    let Some(Coating::Stack(mirror)) = &lens.surfaces[5].coating else { panic!("{:?}", lens.surfaces[5].coating) };
    assert!((mirror.layers[0].thickness_nm - 600.0 / 4.0 / 1.46).abs() < 1e-9);
    // A named stack, and the year.
    let with = |head: &str, surface: &str| {
        let text = format!(
            "name = \"l\"\n{head}\nsurfaces = [\n{{ radius = 50, gap = 3, glass = \"1.62\", semi_diameter = 9, stop = true{surface} }},\n\
             {{ radius = -60, gap = 40, semi_diameter = 9 }} ]\n[coatings.front]\nlayers = [{{ material = \"MgF2\", quarter_waves = 1 }}]\n"
        );
        read_toml(&text, "l.toml")
    };
    let named = with("coating = \"front\"", "").unwrap();
    assert!(matches!(&named.coating, Coating::Stack(s) if (s.layers[0].thickness_nm - 550.0 / 4.0 / 1.3785).abs() < 0.01));
    assert_eq!(with("coating = \"year\"\nyear = 1985", "").unwrap().coating, by_year(1985));
    assert_eq!(with("coating = \"year\"\npatent = \"US 3,874,771 (1975), EXAMPLE 5\"", "").unwrap().coating, by_year(1975));
    assert_eq!(with("", "").unwrap().coating, Coating::None);
    let wrong = |head: &str, surface: &str| with(head, surface).unwrap_err().to_string();
    let told = wrong("coating = \"brodband\"", "");
    assert!(told.contains("did you mean \"broadband\"?") && told.contains("front"), "{told}");
    assert!(wrong("coating = \"year\"", "").contains("year = 1975"));
    let told = wrong("", ", coating = [{ material = \"MgF3\", thickness_nm = 10 }]");
    assert!(told.contains("surface 1") && told.contains("MgF2"), "{told}");
    assert!(wrong("", ", coating = [{ material = \"MgF2\" }]").contains("quarter_waves"));
    assert!(wrong("", ", coating = [{ n = 1.5, thickness_nm = -4 }]").contains("-4"));
    assert!(wrong("", ", coating = [{ material = \"Ag\", quarter_waves = 1 }]").contains("thickness_nm"));
}

#[test]
fn light_takes_the_colour_of_its_coatings() {
    // A V coat for green lets less blue and red through than green; two absorbing films less than none.
    let lens = |coating: &str| {
        let text = format!(
            "name = \"l\"\ncoating = {coating}\nsurfaces = [\n{{ radius = 50, gap = 3, glass = \"1.62\", semi_diameter = 9, stop = true }},\n\
             {{ radius = -60, gap = 40, semi_diameter = 9 }} ]\n"
        );
        let system = System::at(&read_toml(&text, "l.toml").unwrap(), State::default());
        [430.0, 550.0, 700.0].map(|nm| {
            let ray = TracedRay { position: DVec3::new(0.0, 1.0, -10.0), direction: DVec3::Z };
            system.transmittance(ray, &system.indices(nm), nm, TraceDirection::ToFilm).unwrap()
        })
    };
    let v = lens("\"V\"");
    assert!(v[1] > 0.999 && v[0] < 0.96 && v[2] < 0.985, "{v:?}");
    let metal = lens("[{ material = \"Cr\", thickness_nm = 2 }]");
    assert!(metal[1] < 0.9, "{metal:?}");
}

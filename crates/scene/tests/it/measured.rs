//! Measured materials: tables of closed forms give back the closed forms.

use crate::common::level;
use crate::common::tables;

use crate::common::{DEEP, assert_within, mean};
use diopter_light::random::{mix, to_unit};
use diopter_light::{SampledSpectrum, SampledWavelengths};
use diopter_scene::light::Environment;
use diopter_scene::load::{STAND_IN, mitsuba, pbrt, read_measured};
use diopter_scene::material::{Bsdf, Material, Measured, Scattering};
use diopter_scene::shape::Sphere;
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, Scene, Shape};
use glam::{DVec3, Vec3};
use level::level;
use std::f64::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};
use tables::{Closed, Facets, Fineness, V, adaptive, direction, merl, metal, paper, white};

const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];
const ROUGH: Closed = Closed { facets: Facets(0.35, 0.35), brdf: metal };
const BRUSHED: Closed = Closed { facets: Facets(0.25, 0.5), brdf: metal };
const PAPER: Closed = Closed { facets: Facets(1.0, 1.0), brdf: paper };
const WHITE: Closed = Closed { facets: Facets(1.0, 1.0), brdf: white };

fn material(bytes: &[u8]) -> Material {
    Material::new("table", Scattering::Measured(Arc::new(read_measured(bytes).unwrap())))
}

fn measured(material: &Material) -> &Measured {
    let Scattering::Measured(measured) = &material.scattering else { panic!("a table") };
    measured
}

fn single(w: V) -> Vec3 {
    DVec3::from_array(w).as_vec3()
}

fn seen(material: &Material, wo: V) -> Bsdf<'_> {
    material.bsdf(&level(), single(wo), &SampledWavelengths::fixed(NM), false, None).unwrap()
}

/// φ from −π in so many steps of a turn's `part`.
fn phis(steps: usize, part: f64) -> Vec<f64> {
    (0..=steps).map(|i| -PI + TAU * part * i as f64 / steps as f64).collect()
}

fn rough() -> &'static Material {
    static MADE: OnceLock<Material> = OnceLock::new();
    MADE.get_or_init(|| material(&adaptive(&ROUGH, &Fineness::isotropic(), None)))
}

fn brushed() -> &'static Material {
    static MADE: OnceLock<Material> = OnceLock::new();
    // Mirrored in x and in y: a quarter is enough.
    MADE.get_or_init(|| material(&adaptive(&BRUSHED, &Fineness { phi: phis(8, 0.25), theta: 12, ..Fineness::isotropic() }, None)))
}

/// MERL's own resolution, of red paper under a gloss.
fn glossy(wo: V, wi: V) -> f64 {
    0.5 / PI + 0.3 * metal(Facets(0.1, 0.1), wo, wi, 550.0)
}

const RED: [f64; 3] = [0.9, 0.4, 0.1];

fn coated() -> &'static Material {
    static MADE: OnceLock<Material> = OnceLock::new();
    MADE.get_or_init(|| material(&merl([90, 90, 180], RED, glossy)))
}

/// Pairs of directions above the surface, none of them near its horizon.
fn pairs(count: u32) -> impl Iterator<Item = (V, V)> {
    let number = |i: u32| f64::from(to_unit(mix(i)));
    (0..count).map(move |i| {
        let [a, b] = [0, 1].map(|k| direction((0.15 + 0.85 * number(4 * i + 2 * k)).acos(), TAU * number(4 * i + 2 * k + 1)));
        (a, b)
    })
}

/// Means over directions: of f cos θ and of the density by the whole hemisphere, of weights and of what is kept by draws.
fn balance(bsdf: &Bsdf, side: usize) -> (SampledSpectrum, f64, SampledSpectrum, f64) {
    let n = (side * side) as f64;
    let (mut albedo, mut pdf, mut drawn, mut kept) = ([0.0f64; 4], 0.0, [0.0f64; 4], 0.0);
    for i in 0..side * side {
        let place = |i: usize| (i as f64 + 0.5) / side as f64;
        let (u, v) = (place(i % side), place(i / side));
        // Even over the hemisphere.
        let (value, density) = bsdf.eval(single(direction(u.acos(), TAU * v)));
        (0..4).for_each(|k| albedo[k] += TAU * f64::from(value[k]) / n);
        pdf += TAU * f64::from(density) / n;
        let choice = to_unit(mix(i as u32));
        if let Some(s) = bsdf.sample([u as f32, v as f32, choice, 0.0]) {
            (0..4).for_each(|k| drawn[k] += f64::from(s.weight[k]) / n);
            kept += 1.0 / n;
        }
    }
    (SampledSpectrum::from_array(albedo.map(|v| v as f32)), pdf, SampledSpectrum::from_array(drawn.map(|v| v as f32)), kept)
}

/// Median and last decile of numbers.
fn quantiles(mut numbers: Vec<f64>) -> [f64; 2] {
    numbers.sort_by(f64::total_cmp);
    [2, 10].map(|part| numbers[numbers.len() - 1 - numbers.len() / part])
}

/// How far f cos θ is from a closed form over pairs of directions, relative to the closed form and a hundredth of its largest value.
fn errors(material: &Material, closed: &Closed) -> [f64; 2] {
    let expected = |wo: V, wi: V| NM.map(|nm| (closed.brdf)(closed.facets, wo, wi, f64::from(nm)) * wi[2]);
    let most = pairs(1000).flat_map(|(wo, wi)| expected(wo, wi)).fold(0.0, f64::max);
    let off = |(wo, wi): (V, V)| {
        let found = seen(material, wo).eval(single(wi)).0;
        let of = |(k, e): (usize, f64)| (f64::from(found[k]) - e).abs() / (e + 0.01 * most);
        expected(wo, wi).into_iter().enumerate().map(of).fold(0.0, f64::max)
    };
    quantiles(pairs(1000).map(off).collect())
}

#[test]
fn tables_give_back_the_closed_forms_they_were_made_of() {
    // Within what tables of this size resolve: least of all towards the horizon.
    let fine = Fineness { samples: 48, ..Fineness::isotropic() };
    let round = Fineness { phi: phis(24, 1.0), theta: 10, samples: 24, ..Fineness::isotropic() };
    let half = Fineness { phi: phis(12, 0.5), theta: 10, samples: 24, ..Fineness::isotropic() };
    for (name, table, closed, allowed) in [
        ("rough", rough(), &ROUGH, [0.004, 0.03]),
        ("brushed", brushed(), &BRUSHED, [0.01, 0.05]),
        ("paper", &material(&adaptive(&PAPER, &fine, None)), &PAPER, [0.003, 0.02]),
        // φ all the way round, and over half of it.
        ("round", &material(&adaptive(&BRUSHED, &round, None)), &BRUSHED, [0.012, 0.08]),
        ("half", &material(&adaptive(&BRUSHED, &half, None)), &BRUSHED, [0.012, 0.08]),
    ] {
        let [median, decile] = errors(table, closed);
        assert!(median < allowed[0] && decile < allowed[1], "{name}: {median} {decile}");
        assert_eq!(measured(table).is_isotropic(), matches!(name, "rough" | "paper"), "{name}");
    }
}

#[test]
fn merl_tables_have_their_published_scale_and_are_reciprocal() {
    let red = SampledWavelengths::rgb();
    for (wo, wi) in pairs(500) {
        let of = |a: V, b: V| {
            let bsdf = coated().bsdf(&level(), single(a), &red, false, None).unwrap();
            bsdf.eval(single(b)).0 / single(b).z
        };
        let found = of(wo, wi);
        for c in 0..3 {
            let expected = glossy(wo, wi) * RED[c];
            assert!((f64::from(found[c]) / expected - 1.0).abs() < 0.04, "{wo:?} {wi:?}: {found}, {expected}");
        }
        assert!((found - of(wi, wo)).abs().max_element() <= 1e-3 * found.max_element(), "{found}");
    }
    // Spectra of a table of a Lambertian surface are those of that surface.
    let table = material(&merl([20, 16, 24], RED, |_, _| 1.0 / PI));
    let [r, g, b] = RED.map(|v| v as f32);
    let paint = Material::new("paint", Scattering::Diffuse(Color::rgb(r, g, b)));
    for (wo, wi) in pairs(50) {
        let [a, b] = [&table, &paint].map(|m| seen(m, wo).eval(single(wi)).0);
        assert!((a - b).abs().max_element() < 1e-4, "{a}, {b}");
    }
}

#[test]
fn directions_are_drawn_by_the_density_that_is_told() {
    let all = [("rough", rough()), ("brushed", brushed()), ("coated", coated())];
    for (name, material) in all {
        for (theta, phi) in [(0.0, 0.0), (0.4, 1.0), (0.9, -2.0), (1.3, 2.6)] {
            let bsdf = seen(material, direction(theta, phi));
            let (albedo, pdf, drawn, kept) = balance(&bsdf, 400);
            assert!((pdf - kept).abs() < 0.01, "{name} at {theta}: {pdf} of {kept}");
            for k in 0..4 {
                assert!((drawn[k] / albedo[k] - 1.0).abs() < 0.01, "{name} at {theta}: {drawn} of {albedo}");
            }
            // As good as importance sampling has to be: no weight is far above the albedo where light is bright.
            for i in 0..400u32 {
                let u = [0, 1, 2].map(|k| to_unit(mix(3 * i + k)));
                let Some(s) = bsdf.sample([u[0], u[1], u[2], 0.0]) else { continue };
                let (value, density) = bsdf.eval(s.wi);
                assert!((density / s.pdf - 1.0).abs() < 0.02, "{name} at {theta}: {density}, {}", s.pdf);
                let off = (value / s.pdf - s.weight).abs().max_element();
                assert!(off < 0.02 * (0.01 + s.weight.max_element()), "{name} at {theta}: {value} / {}, {}", s.pdf, s.weight);
                assert!(s.weight.max_element() < 6.0 && !s.transmitted, "{name} at {theta}: {}", s.weight);
            }
        }
    }
}

#[test]
fn drawn_directions_pass_a_chi_square_test() {
    for (name, material) in [("rough", rough()), ("brushed", brushed()), ("coated", coated())] {
        let bsdf = seen(material, direction(0.7, 0.5));
        let (rows, columns, draws, sub) = (8, 16, 40_000u32, 24i32);
        let mut counts = vec![0.0f64; rows * columns];
        for i in 0..draws {
            let u = [0, 1, 2].map(|k| to_unit(mix(mix(i) ^ (k * 7919))));
            if let Some(s) = bsdf.sample([u[0], u[1], u[2], 0.0]) {
                let turns = (s.wi.y.atan2(s.wi.x) / std::f32::consts::TAU).rem_euclid(1.0);
                let bin = ((s.wi.z * rows as f32) as usize).min(rows - 1) * columns + (turns * columns as f32) as usize % columns;
                counts[bin] += 1.0;
            }
        }
        let (mut chi2, mut bins) = (0.0f64, 0.0f64);
        for (bin, count) in counts.iter().enumerate() {
            let mut p = 0.0;
            for k in 0..sub * sub {
                let z = ((bin / columns) as f64 + (f64::from(k / sub) + 0.5) / f64::from(sub)) / rows as f64;
                let phi = ((bin % columns) as f64 + (f64::from(k % sub) + 0.5) / f64::from(sub)) / columns as f64 * TAU;
                p += f64::from(bsdf.eval(single(direction(z.acos(), phi))).1);
            }
            let expected = p / f64::from(sub * sub) * TAU / (rows * columns) as f64 * f64::from(draws);
            if expected > 5.0 {
                (chi2, bins) = (chi2 + (count - expected).powi(2) / expected, bins + 1.0);
            }
        }
        assert!(chi2 < bins + 4.0 * (2.0 * bins).sqrt() + 8.0, "{name}: χ² {chi2} of {bins} bins");
    }
}

#[test]
fn tables_of_reciprocal_surfaces_are_reciprocal() {
    for (name, material, allowed) in [("rough", rough(), [0.01, 0.06]), ("brushed", brushed(), [0.02, 0.1])] {
        let f = |wo: V, wi: V| f64::from(seen(material, wo).eval(single(wi)).0.x) / wi[2];
        let most = pairs(1000).map(|(a, b)| f(a, b)).fold(0.0, f64::max);
        let [median, decile] = quantiles(pairs(1000).map(|(a, b)| (f(a, b) - f(b, a)).abs() / (f(a, b) + 0.01 * most)).collect());
        assert!(median < allowed[0] && decile < allowed[1], "{name}: {median} {decile}");
    }
}

#[test]
fn a_white_table_gives_back_all_light_and_no_more() {
    let table = material(&adaptive(&WHITE, &Fineness { samples: 48, ..Fineness::isotropic() }, None));
    for theta in [0.0, 0.5, 1.0, 1.4] {
        let (albedo, ..) = balance(&seen(&table, direction(theta, 0.3)), 300);
        assert!((albedo - 1.0).abs().max_element() < 0.01, "{theta}: {albedo}");
    }
    let white = merl([90, 90, 180], [1.0; 3], |_, _| 1.0 / PI);
    for (name, table, allowed) in [("adaptive", table, 0.012), ("half difference", material(&white), 0.003)] {
        let description = Description {
            materials: vec![table],
            objects: vec![Object::new("ball", Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0 }), 0)],
            environment: Some(Environment::uniform(Vec3::ONE)),
            ..Default::default()
        };
        let scene = Scene::build(description).unwrap();
        for x in [0.0, 0.6, 0.9] {
            let found = mean(&scene, Vec3::new(x, 0.0, 4.0), Vec3::NEG_Z, 4096, &DEEP);
            assert_within(found, [1.0; 4], allowed, name);
        }
    }
    // What a metal loses between facets is lost: never more than 1.
    for theta in [0.0, 0.7, 1.3] {
        for material in [rough(), brushed(), coated()] {
            let (albedo, ..) = balance(&seen(material, direction(theta, 0.3)), 200);
            assert!(albedo.max_element() < 1.0, "{theta}: {albedo}");
        }
    }
}

#[test]
fn colours_are_integrals_under_d65() {
    // A reflectance that rises with the wavelength, as a table of a Lambertian surface and as a colour.
    let ramp = |nm: f64| 0.1 + 0.8 * (nm - 360.0) / 450.0;
    fn rising(_: Facets, _: V, _: V, nm: f64) -> f64 {
        (0.1 + 0.8 * (nm - 360.0) / 450.0) / PI
    }
    let table = material(&adaptive(&Closed { facets: Facets(1.0, 1.0), brdf: rising }, &Fineness::isotropic(), None));
    let points: Vec<f32> = (0..=90).map(|i| ramp(360.0 + 5.0 * i as f64) as f32).collect();
    let spectrum = diopter_light::Spectrum::Table(diopter_light::spectrum::Table::new(360.0, 5.0, points));
    let paint = Material::new("paint", Scattering::Diffuse(Color::spectrum(spectrum)));
    let rgb = paint.albedo(&level());
    assert!((measured(&table).normal_reflectance() / rgb - 1.0).abs().max_element() < 0.01, "{rgb}");
    for (wo, wi) in pairs(50) {
        let [a, b] = [&table, &paint].map(|m| {
            let bsdf = m.bsdf(&level(), single(wo), &SampledWavelengths::rgb(), false, None).unwrap();
            bsdf.eval(single(wi)).0
        });
        assert!((a / a.y * b.y / b - 1.0).abs().max_element() < 2e-3, "{a}, {b}");
    }
    // The RGB variant of a file: spectra are made of its colours.
    let table = material(&adaptive(&WHITE, &Fineness::isotropic(), Some(RED)));
    let [r, g, b] = RED.map(|v| v as f32);
    let paint = Material::new("paint", Scattering::Diffuse(Color::rgb(r, g, b)));
    let off = |(wo, wi): (V, V)| {
        let [a, b] = [&table, &paint].map(|m| seen(m, wo).eval(single(wi)).0);
        f64::from((a / b - 1.0).abs().max_element())
    };
    let [median, decile] = quantiles(pairs(200).map(off).collect());
    assert!(median < 0.01 && decile < 0.05, "{median} {decile}");
}

#[test]
fn widths_are_those_of_the_facets() {
    // Half of what facets within 45° mirror: the others send light below the horizon.
    let within = 1.0 / (1.0 + 0.35f32 * 0.35);
    let expected = 0.35 * (0.5 * within / (1.0 - 0.5 * within)).sqrt();
    assert!((measured(rough()).alpha() / expected - 1.0).abs() < 0.05, "{}, {expected}", measured(rough()).alpha());
    let fine = Closed { facets: Facets(0.02, 0.02), brdf: metal };
    let table = material(&adaptive(&fine, &Fineness { theta: 4, ..Fineness::isotropic() }, None));
    assert!((measured(&table).alpha() - 0.02).abs() < 0.004, "{}", measured(&table).alpha());
}

fn small() -> Fineness {
    Fineness { theta: 3, normals: 4, samples: 3, nm: vec![400.0, 700.0], ..Fineness::isotropic() }
}

#[test]
fn damaged_files_are_errors_that_say_what_is_wrong() {
    let good = adaptive(&ROUGH, &small(), None);
    read_measured(&good).unwrap();
    for cut in 0..good.len() {
        assert!(read_measured(&good[..cut]).is_err(), "{cut}");
    }
    // Every byte of the head, and some of the data, set to values that announce much or nothing.
    for at in (0..600).chain((600..good.len()).step_by(11)) {
        for value in [0, 1, 0x7f, 0xff] {
            let mut bytes = good.clone();
            bytes[at] = value;
            if let Ok(table) = read_measured(&bytes) {
                let table = Material::new("t", Scattering::Measured(Arc::new(table)));
                let bsdf = seen(&table, direction(0.5, 0.2));
                let (value, pdf) = bsdf.eval(single(direction(0.3, 1.0)));
                assert!(value.is_finite() && pdf.is_finite() && value.min_element() >= 0.0 && pdf >= 0.0, "{at}: {value} {pdf}");
                let _ = bsdf.sample([0.3, 0.6, 0.5, 0.0]);
            }
        }
    }
    let find = |name: &str| good.windows(name.len()).position(|w| w == name.as_bytes()).unwrap() + name.len();
    let changed = |at: usize, new: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        read_measured(&bytes).unwrap_err()
    };
    let many = u64::MAX.to_le_bytes();
    for (error, word) in [
        (changed(12, &[2]), "version 2.0"),
        (changed(14, &[200]), "list of its fields"),
        (changed(find("vndf") + 2, &[0]), "type 0"),
        (changed(find("vndf") + 3, &many), "bytes from byte 18446744073709551615"),
        (changed(find("vndf") + 11, &many), "18446744073709551615 × 3"),
        (changed(find("vndf") + 11, &(1u64 << 62).to_le_bytes()), "cut short or damaged"),
        (changed(find("ndf") - 3, b"xyz"), "no field \"ndf\""),
        (changed(find("jacobian") + 11, &0u64.to_le_bytes()), "\"jacobian\""),
    ] {
        assert!(error.contains(word), "{word}: {error}");
    }
    let start = u64::from_le_bytes(good[find("theta_i") + 3..][..8].try_into().unwrap()) as usize;
    assert!(changed(start, &f32::NAN.to_le_bytes()).contains("finite"), "not a number");
    assert!(changed(start, &9f32.to_le_bytes()).contains("does not rise"));

    let good = merl([6, 4, 8], RED, |_, _| 0.2);
    read_measured(&good).unwrap();
    for cut in [0, 5, 12, 100, good.len() - 1] {
        assert!(read_measured(&good[..cut]).is_err(), "{cut}");
    }
    for (counts, word) in
        [([0, 4, 8], "neither"), ([-6, 4, 8], "neither"), ([4096; 3], "MERL table of 4096"), ([7, 4, 8], "cut short")]
    {
        let mut bytes = good.clone();
        bytes[..12].copy_from_slice(&counts.map(i32::to_le_bytes).concat());
        let error = read_measured(&bytes).unwrap_err();
        assert!(error.contains(word), "{counts:?}: {error}");
    }
    let mut bytes = good.clone();
    bytes[12..20].copy_from_slice(&f64::INFINITY.to_le_bytes());
    assert!(read_measured(&bytes).unwrap_err().contains("finite"));
    assert!(read_measured(b"what is this file, if it is one?").unwrap_err().contains("neither"));
}

#[test]
fn scenes_of_pbrt_and_mitsuba_name_measured_files() {
    let table = adaptive(&ROUGH, &small(), None);
    let fetch = |name: &str| match name {
        "m.bsdf" => Ok(table.clone()),
        "cut.bsdf" => Ok(table[..200].to_vec()),
        _ => Err("there is no such file".to_owned()),
    };
    let of_pbrt = |file: &str| {
        let text =
            format!("Camera \"perspective\"\nWorldBegin Material \"measured\" \"string filename\" \"{file}\" Shape \"sphere\"");
        pbrt::load(text.as_bytes(), "s.pbrt", &fetch).unwrap()
    };
    let of_mitsuba = |file: &str| {
        let text = format!(
            "<scene version='3.0.0'><shape type='sphere'><bsdf type='measured'><string name='filename' value='{file}'/></bsdf></shape></scene>"
        );
        mitsuba::load(text.as_bytes(), "s.xml", &fetch).unwrap()
    };
    for d in [of_pbrt("m.bsdf"), of_mitsuba("m.bsdf")] {
        assert!(d.warnings.is_empty() && d.missing_textures.is_empty(), "{:?}", d.warnings);
        let material = &d.materials[d.objects[0].material as usize];
        assert!(matches!(material.scattering, Scattering::Measured(_)));
        Scene::build(d).unwrap();
    }
    for (file, reason) in [("gone.bsdf", "no such file"), ("cut.bsdf", "cut short")] {
        for d in [of_pbrt(file), of_mitsuba(file)] {
            assert_eq!(d.missing_textures.len(), 1);
            let missing = &d.missing_textures[0];
            assert!(
                missing.name == file && missing.reason.contains("measured material") && missing.reason.contains(reason),
                "{missing:?}"
            );
            assert!(d.warnings.len() == 1 && d.warnings[0].contains(file), "{:?}", d.warnings);
            let material = &d.materials[d.objects[0].material as usize];
            assert!(matches!(&material.scattering, Scattering::Diffuse(Color::Constant { rgb, .. }) if *rgb == STAND_IN));
        }
    }
    let nameless = pbrt::load(b"Camera \"perspective\"\nWorldBegin Material \"measured\" Shape \"sphere\"", "s.pbrt", &fetch);
    assert!(nameless.unwrap_err().to_string().contains("without filename"));
}

/// Writes tables and what this library says of them, for `validation/measured_peers.py`.
#[test]
#[ignore = "writes files for a script: MEASURED_PEERS names the folder"]
fn write_for_peers() {
    let folder = std::path::PathBuf::from(std::env::var_os("MEASURED_PEERS").expect("MEASURED_PEERS names a folder"));
    let quarter = Fineness { phi: phis(8, 0.25), theta: 12, ..Fineness::isotropic() };
    let round = Fineness { phi: phis(16, 1.0), theta: 8, ..Fineness::isotropic() };
    for (name, closed, fineness) in [
        ("rough", &ROUGH, Fineness::isotropic()),
        ("quarter", &BRUSHED, quarter),
        ("round", &BRUSHED, round),
        ("paper", &PAPER, Fineness::isotropic()),
    ] {
        let file = adaptive(closed, &fineness, None);
        let table = material(&file);
        std::fs::write(folder.join(format!("{name}.bsdf")), &file).unwrap();
        let mut text = String::from("wo_x,wo_y,wo_z,wi_x,wi_y,wi_z,f0,f1,f2,f3,pdf,u0,u1,s_x,s_y,s_z,w0,w1,w2,w3,s_pdf\n");
        for (i, (wo, wi)) in pairs(400).enumerate() {
            let bsdf = seen(&table, wo);
            let (f, pdf) = bsdf.eval(single(wi));
            let u = [0, 1].map(|k| to_unit(mix(2 * i as u32 + k + 99_991)));
            let (s, w, s_pdf) =
                bsdf.sample([u[0], u[1], 0.5, 0.0]).map_or((Vec3::ZERO, SampledSpectrum::ZERO, 0.0), |s| (s.wi, s.weight, s.pdf));
            let [wo, wi] = [wo, wi].map(single);
            let numbers =
                [&wo.to_array()[..], &wi.to_array(), &f.to_array(), &[pdf], &u, &s.to_array(), &w.to_array(), &[s_pdf]].concat();
            text += &(numbers.iter().map(|v| format!("{v:e}")).collect::<Vec<_>>().join(",") + "\n");
        }
        std::fs::write(folder.join(format!("{name}.csv")), text).unwrap();
    }
}

#[test]
fn tables_are_written_with_the_scene_and_read_back_to_the_last_bit() {
    let closed = Closed { facets: Facets(0.4, 0.4), brdf: metal };
    let small = Fineness { theta: 6, ..Fineness::isotropic() };
    let tables = [
        adaptive(&closed, &small, Some(RED)),
        adaptive(&closed, &small, None),
        adaptive(&BRUSHED, &Fineness { phi: phis(4, 0.25), theta: 6, ..Fineness::isotropic() }, None),
        merl([10, 8, 12], RED, glossy),
    ];
    let balls: Vec<Material> = tables.iter().map(|bytes| material(bytes)).collect();
    let twin = Material { name: "twin".into(), ..balls[0].clone() };
    let materials: Vec<Material> = balls.into_iter().chain([twin]).collect();
    let ball = |i: usize| {
        let sphere = Sphere { center: Vec3::X * i as f32, radius: 0.4 };
        Object::new(format!("ball {i}"), Shape::Sphere(sphere), i as u32)
    };
    let before = Description { objects: (0..materials.len()).map(ball).collect(), materials, ..Description::default() };
    let written = diopter_scene::save::gltf(&before);
    // Told of other programs alone.
    assert!(written.warnings.len() == 1 && written.warnings[0].contains("metals of their colour"), "{:?}", written.warnings);
    let none = |_: &str| Err("no files".to_owned());
    let after = diopter_scene::load::gltf::load(&written.container(), "x.glb", &none).unwrap();
    assert!(after.warnings.is_empty(), "{:?}", after.warnings);
    for (a, b) in before.materials.iter().zip(&after.materials) {
        assert_eq!(format!("{a:?}"), format!("{b:?}"));
    }
    // A table that two materials share is in the file once.
    let bytes: usize = tables.iter().map(Vec::len).sum();
    assert!(written.binary.len() < 4 * bytes, "{} {bytes}", written.binary.len());
}

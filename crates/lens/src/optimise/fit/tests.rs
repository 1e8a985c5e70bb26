//! Truth in, truth out: lenses changed by known numbers, measured on the bench, fitted from the unchanged ones.

use super::*;
use crate::analysis::Bench;
use crate::embedded;
use crate::glass::D_NM;
use crate::prescription::Misalignment;
use crate::tolerance::{key, uniform};

fn fit_of(lens: &str, text: &str) -> LensFit {
    LensFit::new(&embedded(lens).unwrap(), &FitSheet::parse(text, "m.toml").unwrap()).unwrap()
}

/// Tables of a lens scaled by 1.03 at f/3.5, all of it shifted along y, as the bench measures it in its usual plane: of fields on both sides.
fn bench_tables(lens: &str, decenter_mm: f64, fields: &[f64], heights: &[f64], contrast: bool) -> String {
    let mut p = embedded(lens).unwrap().scaled(1.03).unwrap();
    if decenter_mm != 0.0 {
        let last = p.surfaces.len() - 1;
        p.misalignments.push(Misalignment { first: 0, last, decenter: [0.0, decenter_mm, 0.0], tilt: [0.0; 3] });
    }
    // Where the unchanged lens is focused, scaled: the film that the fit starts from.
    let start = configure(&embedded(lens).unwrap(), None, None, None, FilmPlace::Focused(Focus::Infinity)).unwrap();
    let mut set = configure(&p, None, Some(3.5), None, FilmPlace::AsPublished).unwrap();
    set.system.film_z = 1.03 * start.system.film_z;
    let bench = Bench::at_infinity(&set.system);
    let mut text = "wavelengths_nm = [587.56]\n[distortion]\norigin = \"film middle\"\nsigma_mm = 0.001\nrows = [\n".to_owned();
    for field in fields {
        let height = bench.field_point(*field, D_NM).unwrap().height;
        text += &format!("{{ field_deg = {field}, height_mm = {height} }},\n");
    }
    text += "]\n[vignetting]\nsigma = 0.005\nrows = [\n";
    let middle = bench.illumination(0.0, D_NM).with_losses;
    for height in heights {
        let relative = bench.illumination(*height, D_NM).with_losses / middle;
        text += &format!("{{ height_mm = {height}, relative = {relative} }},\n");
    }
    text += "]\n";
    if contrast {
        let field = bench.field_of_height(heights[0]);
        let mtf = bench.diffraction_mtf(field, &[(D_NM, 1.0)], &[30.0], 0.0).unwrap();
        let [s, t] = [mtf.sagittal[0], mtf.tangential[0]];
        let row = format!("{{ height_mm = {}, frequency = 30, sagittal = {s}, tangential = {t} }}", heights[0]);
        text += &format!("[mtf]\nsigma = 0.005\nrows = [ {row} ]\n");
    }
    text
}

fn value(r: &FitReport, name: &str) -> f64 {
    r.numbers.iter().find(|n| n.name.starts_with(name)).unwrap_or_else(|| panic!("{name}")).value
}

const SCALE: &str = "[[variable]]\nwhat = \"scale\"\n";
const APERTURE: &str = "[[variable]]\nwhat = \"aperture\"\n";
const DECENTER: &str = "[[variable]]\nwhat = \"decenter y\"\n";

#[test]
fn a_scaled_stopped_and_decentred_lens_is_found_by_tables_of_the_bench() {
    let tables = bench_tables("double-gauss-50mm", 0.25, &[-18.0, -9.0, 6.0, 14.0, 20.0], &[9.0, 14.0, 18.0], true);
    let fit = fit_of("double-gauss-50mm", &format!("{tables}{SCALE}{APERTURE}{DECENTER}"));
    let r = fit.run(60).unwrap();
    assert!((value(&r, "scale") - 1.03).abs() < 1e-3, "{r:?}");
    assert!((value(&r, "aperture") / 3.5 - 1.0).abs() < 0.01, "{r:?}");
    assert!((value(&r, "decenter") - 0.25).abs() < 0.01, "{r:?}");
    // The fitted lens is one like any other: its TOML gives it back.
    let back = crate::prescription::read_toml(&r.lens.to_toml(), "fitted.toml").unwrap();
    let efl = |p: &Prescription| configure(p, None, None, None, FilmPlace::AsPublished).unwrap().efl;
    assert!((efl(&back) / efl(&r.lens) - 1.0).abs() < 1e-12);
    assert!((efl(&back) / efl(&embedded("double-gauss-50mm").unwrap()) - value(&r, "scale")).abs() < 1e-9);
}

#[test]
fn a_wide_lens_is_found_from_distortion_and_vignetting() {
    let tables = bench_tables("wide-24mm-f3.5", 0.0, &[15.0, 30.0, 38.0], &[8.0, 14.0, 18.0], false);
    // f/3.5 is what the patent's f/3.6 is called, fully open: nothing but rims.
    let r = fit_of("wide-24mm-f3.5", &format!("{tables}{SCALE}")).run(40).unwrap();
    assert!((value(&r, "scale") - 1.03).abs() < 1e-3 && r.open, "{r:?}");
    // Rims and the cosine's fourth power, against the bench's own sum over the pupil: half a standard uncertainty is 0.0025 of the light in the middle. The scale alone would not tell.
    for row in &r.rows {
        assert!(row.residual.abs() < 0.5, "{row:?}");
    }
}

/// Measurements by the fit's own predictions of true numbers, each with normal noise of its σ.
fn with_noise(fit: &mut LensFit, truth: &[f64], seed: u64) {
    let exact = fit.predicted(truth);
    for (i, (row, value)) in fit.rows.iter_mut().zip(exact).enumerate() {
        let k = key(&[seed, i as u64]);
        let r = (-2.0 * (1.0 - uniform(k, 0)).ln()).sqrt();
        row.measured.value = value.unwrap() + row.measured.sigma * r * (std::f64::consts::TAU * uniform(k, 1)).cos();
    }
}

/// Rows whose values do not matter yet.
fn blank_rows() -> String {
    let mut text = "wavelengths_nm = [587.56]\naperture = 3\n[distortion]\norigin = \"film middle\"\nrows = [\n".to_owned();
    for field in [-18, -12, -6, 6, 12, 18] {
        text += &format!("{{ field_deg = {field}, height_mm = {}, sigma = 0.02 }},\n", 0.9 * f64::from(field));
    }
    text += "]\n[vignetting]\nrows = [\n";
    (0..7).for_each(|i| text += &format!("{{ height_mm = {}, relative = 0.5, sigma = 0.01 }},\n", 6.0 + 2.0 * f64::from(i)));
    text + "]\n"
}

#[test]
fn noise_moves_the_numbers_by_their_standard_errors() {
    let truth = [1.03, 3.5, 0.2];
    let (mut sum, mut degrees) = (0.0, 0);
    let mut errors = Vec::new();
    for seed in 1..=8 {
        let mut fit = fit_of("double-gauss-50mm", &format!("{}{SCALE}{APERTURE}{DECENTER}", blank_rows()));
        with_noise(&mut fit, &truth, seed);
        let r = fit.run(40).unwrap();
        for (n, truth) in r.numbers.iter().zip(truth) {
            let error = (n.value - truth) / n.standard_error.unwrap();
            // 6 of 100 000 chances for each of 24 numbers, and the seeds are fixed.
            assert!(error.abs() < 4.0, "seed {seed}: {n:?} {truth}");
            errors.push(error);
        }
        (sum, degrees) = (sum + r.chi_squared[1], degrees + r.degrees_of_freedom);
        assert!(!r.warnings.iter().any(|w| w.contains("chi-squared")), "{:?}", r.warnings);
    }
    // Within four standard deviations of a mean of squares and of χ²; with 16 seeds 1.41 and 1.05.
    let count = errors.len() as f64;
    let mean_square = errors.iter().map(|e| e * e).sum::<f64>() / count;
    assert!((mean_square - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{errors:?}");
    let reduced = sum / f64::from(u32::try_from(degrees).unwrap());
    assert!(degrees == 80 && (reduced - 1.0).abs() < 4.0 * (2.0f64 / 80.0).sqrt(), "{reduced} {degrees}");
}

#[test]
fn another_design_does_not_fit_and_says_so() {
    let tables = bench_tables("double-gauss-50mm", 0.0, &[5.0, 10.0, 15.0, 20.0], &[9.0, 14.0, 18.0], false);
    let r = fit_of("triplet-50mm-f4", &format!("{tables}{SCALE}{APERTURE}")).run(40).unwrap();
    assert!(r.reduced().unwrap() > 20.0, "{r:?}");
    assert!(r.warnings.iter().any(|w| w.contains("is not the one that was measured")), "{:?}", r.warnings);
}

#[test]
fn numbers_that_do_the_same_are_warned_about() {
    // All of the lens, and all of it but for the words.
    let two = "[[variable]]\nwhat = \"decenter y\"\nsurfaces = [1, 10]\n";
    let mut fit = fit_of("double-gauss-50mm", &format!("{}{DECENTER}{two}", blank_rows()));
    fit.rows.retain(|r| r.measured.table == Table::Height);
    fit.groups = groups(&fit.rows);
    with_noise(&mut fit, &[0.1, 0.0], 5);
    let r = fit.run(30).unwrap();
    assert!(r.warnings.iter().any(|w| w.contains("cannot tell them apart")), "{r:?}");
    // Distortion in per cent, by angle, is the same in every size, and knows nothing of the f-number.
    let text = "[distortion]\nrows = [{ field_deg = 10, percent = -0.5 }, { field_deg = 15, percent = -1 }]\n";
    let r = fit_of("double-gauss-50mm", &format!("{text}{SCALE}")).run(10).unwrap();
    assert!(r.warnings.iter().any(|w| w.contains("no row depends on scale")) && value(&r, "scale") == 1.0, "{r:?}");
}

#[test]
fn per_cents_are_held_against_a_stated_focal_length() {
    // Against 50 mm a lens of 1.03 times the start's focal length seems to have 100 (1.03 f / 50 − 1) % more distortion.
    let start = embedded("double-gauss-50mm").unwrap();
    let set = configure(&start, None, None, None, FilmPlace::Focused(Focus::Infinity)).unwrap();
    let bench = Bench::at_infinity(&set.system);
    let row = |field: f64| {
        let p = bench.field_point(field, D_NM).unwrap();
        let percent = (1.03 * p.height / (50.0 * field.to_radians().tan()) - 1.0) * 100.0;
        format!("{{ field_deg = {field}, percent = {percent}, sigma = 0.01 }}")
    };
    let rows: Vec<String> = [8.0, 14.0, 19.0].map(row).to_vec();
    let head = "wavelengths_nm = [587.56]\n[distortion]\nfocal_length_mm = 50\n";
    let r = fit_of("double-gauss-50mm", &format!("{head}rows = [{}]\n{SCALE}", rows.join(", "))).run(20).unwrap();
    // The film stands a little beside the paraxial focus, which the ideal height takes along.
    assert!((value(&r, "scale") - 1.03).abs() < 1e-3, "{r:?}");
}

#[test]
fn the_direction_on_the_film_is_that_of_the_decentre() {
    // A shift along x moves images along x by as much, and those along y by nothing.
    let text = "wavelengths_nm = [587.56]\n[distortion]\norigin = \"film middle\"\nrows = [\n\
        { field_deg = 10, height_mm = 9, azimuth_deg = 0 }, { field_deg = 10, height_mm = 9 }, { field_deg = 10, height_mm = 9, azimuth_deg = 225 } ]\n\
        [[variable]]\nwhat = \"decenter x\"\n";
    let fit = fit_of("double-gauss-50mm", text);
    let [at, moved] = [fit.predicted(&[0.0]), fit.predicted(&[0.4])];
    let by: Vec<f64> = at.iter().zip(&moved).map(|(a, b)| b.unwrap() - a.unwrap()).collect();
    for (by, expected) in by.iter().zip([0.4, 0.0, -0.4 * 0.5f64.sqrt()]) {
        assert!((by - expected).abs() < 1e-6, "{by} {expected}");
    }
}

#[test]
fn wrong_files_are_told_what_is_wrong() {
    let lens = embedded("double-gauss-50mm").unwrap();
    let error = |text: &str| match FitSheet::parse(text, "m.toml") {
        Err(e) => e.to_string(),
        Ok(sheet) => LensFit::new(&lens, &sheet).err().map(|e| e.to_string()).unwrap_or_default(),
    };
    let row = "[distortion]\nrows = [{ field_deg = 10, height_mm = 9 }]\n";
    let light = "[vignetting]\nrows = [{ height_mm = 10, relative = 0.8 }, { height_mm = 90, relative = 0.1 }]\n";
    for (text, parts) in [
        (row.to_owned(), vec!["m.toml", "0 variables", "[[variable]]"]),
        (SCALE.to_owned(), vec!["0 measurements", "[distortion]"]),
        (format!("{SCALE}[distortion]\nrows = []"), vec!["[distortion] rows = []", "at least one"]),
        (format!("{row}[[variable]]\nwhat = \"skale\""), vec!["m.toml:3", "skale", "did you mean \"scale\"?"]),
        (format!("{SCALE}[distortion]\nrows = [{{ field_deg = nan, height_mm = 9 }}]"), vec!["m.toml:4", "field_deg NaN"]),
        (format!("{SCALE}[distortion]\nrows = [{{ field_deg = 10, percent = nan }}]"), vec!["m.toml:4", "percent NaN"]),
        (format!("{SCALE}[distortion]\nrows = [{{ field_deg = 10, height_mm = 9, sigma = 0 }}]"), vec!["sigma 0", "above 0"]),
        (format!("{SCALE}[distortion]\nrows = [{{ field_deg = 0, percent = 0 }}]"), vec!["m.toml:4", "beside it"]),
        (format!("{SCALE}[distortion]\nrows = [{{ field = 10 }}]"), vec!["m.toml:4", "unknown field", "field_deg"]),
        (format!("{SCALE}{light}"), vec!["m.toml:4", "does not see 1 of 2 rows", "illumination at 90 mm (line 4)", "scale"]),
        (format!("{SCALE}{SCALE}{row}"), vec!["m.toml:3", "scale", "free already"]),
        (format!("{SCALE}start = 3\n{row}"), vec!["starts at 3", "0.5 to 2"]),
        (format!("{APERTURE}min = 1\n{row}"), vec!["aperture from f/1", "opens no wider"]),
        (format!("[[variable]]\nwhat = \"decenter x\"\nsurfaces = [5, 2]\n{row}"), vec!["surfaces 5 to 2", "first and the last"]),
        (format!("[[variable]]\nwhat = \"gap\"\n{row}"), vec!["gap", "expected surfaces"]),
        (format!("{SCALE}{DECENTER}{row}"), vec!["1 measurements for 2 free numbers"]),
        (format!("focus_m = nan\n{SCALE}{row}"), vec!["focus", "expected"]),
        (format!("aperture = 0\n{SCALE}{row}"), vec!["aperture", "f/0", "positive number"]),
    ] {
        let message = error(&text);
        assert!(parts.iter().all(|p| message.contains(p)), "{text}\n{message}");
    }
}

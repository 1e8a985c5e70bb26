//! `lens tolerance`, `lens build`, `lens optimise` and `lens fit` as a user meets them.

use crate::common::Folder;
use serde_json::Value;

const SHEET: &str = "lens = \"triplet-50mm-f4\"\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n\
    [compensator]\nrefocus = 0.5\ndecenter = [{ element = [5, 6], by = 0.1, axis = \"y\" }]\n[[tolerance]]\nradius = \"0.1%\"\nthickness = 0.03\nindex = \"NP050\"\nabbe = \"AN5\"\n\
    [[tolerance]]\ndecenter = 0.02\n[[limit]]\nquantity = \"mtf\"\nat_least = 0.2\n";

#[test]
fn tolerances_are_the_same_for_any_number_of_threads_and_written_as_asked() {
    let f = Folder::new("tolerance");
    std::fs::write(f.path("s.toml"), SHEET).unwrap();
    let run = |threads: &str, files: &[&str]| -> Value {
        let args = [&["lens", "tolerance", "s.toml", "-n", "12", "--json", "--threads", threads], files].concat();
        serde_json::from_slice(&f.ok(&args).stdout).unwrap()
    };
    let one = run("1", &["-o", "a.html", "-o", "a.csv", "-o", "a.json", "-o", "a.svg"]);
    assert_eq!(one, run("3", &[]));
    let text = |name: &str| String::from_utf8(f.read(name)).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&text("a.json")).unwrap(), one);
    assert_eq!(text("a.csv").lines().count(), 13);
    assert!(text("a.html").contains("<svg") && text("a.html").contains("Yield") && text("a.svg").contains("design"));
    assert_eq!(one["builds"].as_array().unwrap().len(), 12);
    // The element moves in every build, and its way is told with its unit.
    let moved = one["quantities"].as_array().unwrap().iter().position(|q| q["quantity"] == "compensator").unwrap();
    let told = &one["quantities"][moved];
    assert!(told["name"] == "compensator, decentre of element 5-6 in y" && told["unit"] == "mm", "{told}");
    assert!(
        one["builds"].as_array().unwrap().iter().all(|b| (1e-9..=0.1).contains(&b[moved].as_f64().unwrap().abs())),
        "{one:#}"
    );
    let (code, message) = f.fails(&["lens", "tolerance", "s.toml", "-o", "a.txt"]);
    assert!(code == 2 && message.contains("a.txt") && message.contains(".html"), "{message}");
    std::fs::write(f.path("bad.toml"), SHEET.replace("0.1%", "0.1 miles")).unwrap();
    let (_, message) = f.fails(&["lens", "tolerance", "bad.toml"]);
    assert!(message.contains("bad.toml:7") && message.contains("0.1 miles") && message.contains("expected"), "{message}");
}

#[test]
fn fields_that_the_lens_does_not_image_are_warned_of() {
    let f = Folder::new("no-image");
    let singlet = "name = \"singlet\"\nsurfaces = [\n{ radius = 103.36, gap = 4, glass = \"1.5168\", semi_diameter = 5, stop = true },\n\
        { radius = -103.36, gap = 98.7, semi_diameter = 5.5 },\n]\n";
    std::fs::write(f.path("singlet.toml"), singlet).unwrap();
    let sheet =
        "lens = \"singlet.toml\"\nfields_deg = [0, 60]\nwavelengths_nm = [587.56]\n[[tolerance]]\nsurfaces = 1\nradius = 0.01\n";
    std::fs::write(f.path("s.toml"), sheet).unwrap();
    let output = f.ok(&["lens", "tolerance", "s.toml", "-n", "2", "--json", "-o", "a.html"]);
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let warnings = json["warnings"].as_array().unwrap();
    let told = warnings[0].as_str().unwrap();
    assert!(
        warnings.len() == 1 && told.starts_with("field 60°: spots of 2") && told.contains("30 cycles/mm is numerical noise"),
        "{told}"
    );
    assert!(String::from_utf8_lossy(&output.stderr).contains(&format!("warning: {told}")));
    assert!(String::from_utf8(f.read("a.html")).unwrap().contains("are no image"));
}

#[test]
fn a_build_is_a_lens_that_other_verbs_take() {
    let f = Folder::new("build");
    std::fs::write(f.path("s.toml"), SHEET).unwrap();
    f.ok(&["lens", "build", "s.toml", "--number", "17", "-o", "built.toml"]);
    let efl = |lens: &str| -> f64 {
        let info: Value = serde_json::from_slice(&f.ok(&["lens", "info", lens, "--json"]).stdout).unwrap();
        info["effective_focal_length_mm"].as_f64().unwrap()
    };
    let (file, name) = (efl("built.toml"), efl("s.toml#17"));
    // What is written is what is named, to the digits of the file.
    assert!((file - name).abs() < 1e-9 && (file - efl("triplet-50mm-f4")).abs() > 1e-4, "{file} {name}");
    let (code, message) = f.fails(&["lens", "info", "s.toml#last"]);
    assert!(code == 2 && message.contains("expected the number of a build"), "{message}");
}

#[test]
fn an_optimised_lens_is_better_and_read_back() {
    let f = Folder::new("optimise");
    let merit = "lens = \"triplet-50mm-f4\"\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n[[variable]]\nsurfaces = [1, 6]\n\
        what = \"curvature\"\n[[variable]]\nsurfaces = 6\nwhat = \"gap\"\n[[operand]]\nkind = \"spot\"\n\
        [[operand]]\nkind = \"efl\"\ntarget = 50\nweight = 1000\n";
    std::fs::write(f.path("m.toml"), merit).unwrap();
    let args = ["lens", "optimise", "m.toml", "--iterations", "20", "-o", "better.toml", "--json"];
    let report: Value = serde_json::from_slice(&f.ok(&args).stdout).unwrap();
    assert!(report["merits"][1].as_f64().unwrap() < report["merits"][0].as_f64().unwrap(), "{report}");
    let written = String::from_utf8(f.read("better.toml")).unwrap();
    assert!(written.contains("optimised from") && written.contains("J. Sasian"), "{written}");
    f.ok(&["lens", "info", "better.toml"]);
    let (code, message) = f.fails(&["lens", "optimise", "m.toml", "-o", "m.toml"]);
    assert!(code == 2 && message.contains("it is read here"), "{message}");
}

#[test]
fn a_report_is_one_page_with_every_part_and_files_of_other_programs_give_the_same_lens() {
    let f = Folder::new("report");
    f.ok(&["lens", "report", "triplet-50mm-f4", "-o", "r.html"]);
    let page = String::from_utf8(f.read("r.html")).unwrap();
    let parts = [
        "Layout",
        "First order",
        "Prescription",
        "Third order",
        "Contrast",
        "Spots",
        "Ray fans",
        "Distortion",
        "Relative",
        "Colour",
        "Glasses",
    ];
    for part in parts {
        assert!(page.contains(&format!("<h2>{part}")), "{part}");
    }
    // Nothing comes from elsewhere.
    assert!(page.matches("<svg").count() >= 10 && !page.contains("src=") && !page.contains("NaN"), "{}", page.len());
    let efl = |lens: &str| -> f64 {
        let info: Value =
            serde_json::from_slice(&f.ok(&["lens", "info", lens, "--wavelength", "587.56", "--json"]).stdout).unwrap();
        info["effective_focal_length_mm"].as_f64().unwrap()
    };
    for file in ["t.zmx", "t.seq"] {
        f.ok(&["lens", "convert", "triplet-50mm-f4", "-o", file]);
        assert!((efl(file) / efl("triplet-50mm-f4") - 1.0).abs() < 1e-9, "{file}");
    }
}

/// A file of measurements of a lens, by the program's own bench: heights of images and relative illumination at f/3.5.
fn measured(f: &Folder, lens: &str) -> String {
    let bench = |verb: &str, fields: &str| -> Value {
        let args =
            ["lens", verb, lens, "--aperture", "3.5", "--focus", "inf", "--wavelength", "587.56", "--field", fields, "--json"];
        serde_json::from_slice(&f.ok(&args).stdout).unwrap()
    };
    let mut text = "lens = \"double-gauss-50mm\"\naperture = 3.2\nwavelengths_nm = [587.56]\n[distortion]\nrows = [\n".to_owned();
    for p in bench("distortion", "5,10,15,20").as_array().unwrap() {
        text += &format!("{{ field_deg = {}, height_mm = {}, sigma = 0.002 }},\n", p["field_deg"], p["height_mm"]);
    }
    text += "]\n[vignetting]\nsigma = 0.005\nrows = [\n";
    let light = bench("vignetting", "0,8,14,18");
    let light = light["illumination"].as_array().unwrap();
    for p in &light[1..] {
        let relative = p["with_losses_sr"].as_f64().unwrap() / light[0]["with_losses_sr"].as_f64().unwrap();
        text += &format!("{{ height_mm = {}, relative = {relative} }},\n", p["height_mm"]);
    }
    text + "]\n[[variable]]\nwhat = \"scale\"\n[[variable]]\nwhat = \"aperture\"\n"
}

#[test]
fn a_prescription_is_fitted_to_a_measured_lens_and_photographs() {
    let f = Folder::new("fit");
    let truth = diopter::lens::embedded("double-gauss-50mm").unwrap().scaled(1.03).unwrap();
    std::fs::write(f.path("truth.toml"), truth.to_toml()).unwrap();
    std::fs::write(f.path("m.toml"), measured(&f, "truth.toml")).unwrap();
    let r: Value = serde_json::from_slice(&f.ok(&["lens", "fit", "m.toml", "-o", "fitted.toml", "--json"]).stdout).unwrap();
    let value = |i: usize| r["numbers"][i]["value"].as_f64().unwrap();
    assert!((value(0) - 1.03).abs() < 1e-3 && (value(1) / 3.5 - 1.0).abs() < 0.01, "{r:#}");
    assert!(r["numbers"][0]["standard_error"].as_f64().unwrap() < 1e-3 && r["rows"].as_array().unwrap().len() == 7, "{r:#}");
    let efl = |lens: &str| -> f64 {
        let info: Value = serde_json::from_slice(&f.ok(&["lens", "info", lens, "--json"]).stdout).unwrap();
        info["effective_focal_length_mm"].as_f64().unwrap()
    };
    assert!((efl("fitted.toml") / efl("truth.toml") - 1.0).abs() < 1e-3);
    // What is no part of the lens is printed as flags that the camera takes.
    let text = String::from_utf8(f.ok(&["lens", "fit", "m.toml"]).stdout).unwrap();
    let flags = text.split_once("--lens fitted.toml ").unwrap().1.lines().next().unwrap();
    assert_eq!(flags, r["flags"].as_str().unwrap());
    let (aperture, focus) = flags.split_once(" --focus ").unwrap();
    assert!(aperture.starts_with("--aperture f/3.") && focus.contains("extension"), "{flags}");
    let camera = [aperture.trim_start_matches("--aperture "), focus.trim_matches('"')];
    let picture = ["--size", "24x16", "--spp", "1", "-o", "a.png"];
    let args =
        [&["shoot", "cornell", "--lens", "fitted.toml", "--aperture", camera[0], "--focus", camera[1]][..], &picture].concat();
    f.ok(&args);
}

#[test]
fn a_prescription_is_fitted_to_a_calibration() {
    let f = Folder::new("fit-calibration");
    let truth = diopter::lens::embedded("double-gauss-50mm").unwrap().scaled(1.03).unwrap();
    std::fs::write(f.path("truth.toml"), truth.to_toml()).unwrap();
    let film = ["--film", "36x24", "--size", "3600x2400", "--aperture", "3.5"];
    f.ok(&[&["lens", "calibrate", "truth.toml", "-o", "c.json", "-o", "c.yaml"][..], &film].concat());
    for (file, film_mm) in [("c.json", ""), ("c.yaml", "film_mm = [36, 24]\n")] {
        let text = format!("[calibration]\nfile = \"{file}\"\n{film_mm}[[variable]]\nwhat = \"scale\"\n");
        std::fs::write(f.path("m.toml"), format!("lens = \"double-gauss-50mm\"\naperture = 3.5\n{text}")).unwrap();
        let r: Value = serde_json::from_slice(&f.ok(&["lens", "fit", "m.toml", "--json"]).stdout).unwrap();
        assert!((r["numbers"][0]["value"].as_f64().unwrap() - 1.03).abs() < 1e-3, "{r:#}");
        // Half a pixel is more than the model leaves of the lens.
        assert!(r["reduced_chi_squared"].as_f64().unwrap() < 1.0, "{r:#}");
    }
    // Tables of pixels: an ST map that distorts, and a ray for each pixel.
    let small = [
        "--film",
        "36x24",
        "--size",
        "240x160",
        "--aperture",
        "3.5",
        "-o",
        "distort.exr",
        "-o",
        "undistort.exr",
        "-o",
        "rays.exr",
    ];
    f.ok(&[&["lens", "calibrate", "truth.toml"][..], &small].concat());
    let fit = |file: &str| {
        let text = format!("[calibration]\nfile = \"{file}\"\nfilm_mm = [36, 24]\n[[variable]]\nwhat = \"scale\"\n");
        std::fs::write(f.path("m.toml"), format!("lens = \"double-gauss-50mm\"\naperture = 3.5\n{text}")).unwrap();
        ["lens", "fit", "m.toml", "--json"]
    };
    for file in ["distort.exr", "rays.exr"] {
        let r: Value = serde_json::from_slice(&f.ok(&fit(file)).stdout).unwrap();
        // Single precision, and places between pixels: hundredths of a pixel of 100.
        assert!((r["numbers"][0]["value"].as_f64().unwrap() - 1.03).abs() < 2e-4, "{file}: {r:#}");
        assert!(
            r["degrees_of_freedom"].as_u64().unwrap() > 40 && r["reduced_chi_squared"].as_f64().unwrap() < 0.01,
            "{file}: {r:#}"
        );
    }
    fit("undistort.exr");
    let (code, message) = f.fails(&["lens", "fit", "m.toml"]);
    assert!(code == 2 && message.contains("undistort.exr") && message.contains("expected the one that distorts"), "{message}");
    fit("c.yaml");
    let (code, message) = f.fails(&["lens", "fit", "m.toml", "-o", "c.yaml"]);
    assert!(code == 2 && message.contains("c.yaml") && message.contains("it is read here"), "{message}");
    std::fs::write(
        f.path("m.toml"),
        "lens = \"double-gauss-50mm\"\n[calibration]\nfile = \"c.yaml\"\n[[variable]]\nwhat = \"scale\"\n",
    )
    .unwrap();
    let (code, message) = f.fails(&["lens", "fit", "m.toml"]);
    assert!(code == 2 && message.contains("c.yaml") && message.contains("film_mm"), "{message}");
}

#[test]
fn files_of_measurements_that_are_wrong_are_told_so() {
    let f = Folder::new("fit-wrong");
    let rows = "[distortion]\nrows = [{ field_deg = 10, height_mm = 9 }]\n[[variable]]\nwhat = \"scale\"\n";
    std::fs::write(f.path("m.toml"), format!("lens = \"double-gauss-50mm\"\n{rows}")).unwrap();
    std::fs::write(f.path("key.toml"), format!("lense = \"double-gauss-50mm\"\n{rows}")).unwrap();
    std::fs::write(f.path("far.toml"), format!("lens = \"double-gauss-50mm\"\n{}", rows.replace("10", "80"))).unwrap();
    for (args, parts) in [
        (&["m.toml", "-o", "m.toml"][..], &["m.toml", "it is read here"][..]),
        (&["m.toml", "-o", "a.txt"], &["a.txt", ".toml"]),
        (&["m.toml", "--iterations", "0"], &["iterations 0", "expected 1 to"]),
        (&["m.toml", "--lens", "double-gaus-50mm"], &["did you mean \"double-gauss-50mm\"?"]),
        (&["key.toml", "-o", "a.toml"], &["key.toml:1", "lense"]),
        (&["far.toml", "-o", "a.toml"], &["far.toml:3", "does not see 1 of 1 rows", "image height at 80°"]),
    ] {
        let (code, message) = f.fails(&[&["lens", "fit"], args].concat());
        assert!(code == 2 && parts.iter().all(|p| message.contains(p)), "{args:?} {code} {message}");
    }
}

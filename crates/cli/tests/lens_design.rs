//! `lens tolerance`, `lens build` and `lens optimise` as a user meets them.

use common::Folder;
use serde_json::Value;

mod common;

const SHEET: &str = "lens = \"triplet-50mm-f4\"\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n\
    [compensator]\nrefocus = 0.5\n[[tolerance]]\nradius = \"0.1%\"\nthickness = 0.03\nindex = \"NP050\"\nabbe = \"AN5\"\n\
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
    let (code, message) = f.fails(&["lens", "tolerance", "s.toml", "-o", "a.txt"]);
    assert!(code == 2 && message.contains("a.txt") && message.contains(".html"), "{message}");
    std::fs::write(f.path("bad.toml"), SHEET.replace("0.1%", "0.1 miles")).unwrap();
    let (_, message) = f.fails(&["lens", "tolerance", "bad.toml"]);
    assert!(message.contains("bad.toml:6") && message.contains("0.1 miles") && message.contains("expected"), "{message}");
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

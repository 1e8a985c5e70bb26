//! Coatings, ghosts and stray light on the command line.

use crate::common::Folder;
use serde_json::Value;

#[test]
fn coatings_are_told_drawn_and_tried_on() {
    let f = Folder::new("coating");
    let args = ["lens", "coating", "double-gauss-50mm", "--coating", "modern", "--surface", "1", "--angle", "0,45", "--json"];
    let outputs = ["-o", "r.svg", "-o", "r.png", "-o", "r.csv", "-o", "r.json"];
    let told: Value = serde_json::from_slice(&f.ok(&[&args[..], &outputs].concat()).stdout).unwrap();
    assert_eq!(f.files().len(), 4);
    let curves = told["curves"].as_array().unwrap();
    assert_eq!((curves.len(), curves[0]["surface"].as_u64(), curves[1]["angle_deg"].as_f64()), (2, Some(1), Some(45.0)));
    let green = curves[0]["reflectance_s"][34].as_f64().unwrap();
    assert!(told["wavelength_nm"][34] == 550.0 && green > 0.0 && green < 0.005, "{green}");
    let table = String::from_utf8(f.read("r.csv")).unwrap();
    assert!(table.starts_with("nm,surface 1 0 deg s,surface 1 0 deg p,surface 1 45 deg s") && table.lines().count() == 82);
    // The lens itself is bare.
    let bare = String::from_utf8(f.ok(&["lens", "coating", "double-gauss-50mm"]).stdout).unwrap();
    assert!(bare.contains("coating  none") && bare.contains("425-675 nm"), "{bare}");
    for (args, says) in [
        (&["lens", "coating", "double-gauss-50mm", "--coating", "brodband"][..], "did you mean \"broadband\"?"),
        (&["lens", "coating", "double-gauss-50mm", "--surface", "12"], "1 to 11"),
        (&["lens", "coating", "double-gauss-50mm", "--angle", "90"], "less than 90"),
        (&["lens", "coating", "double-gauss-50mm", "-o", "x.dat"], ".csv"),
        (&["lens", "ghosts", "double-gauss-50mm", "--source", "95deg"], "below 90"),
        (&["lens", "ghosts", "double-gauss-50mm", "--sensor-reflectance", "2"], "0 to 1"),
        (&["lens", "ghosts", "double-gauss-50mm", "--pixel-pitch", "1mm"], "0.5 to 20 um"),
        (&["lens", "ghosts", "double-gauss-50mm", "--fours", "10000"], "0 to 1000"),
    ] {
        let (code, message) = f.fails(args);
        assert!(code == 2 && message.contains(says), "{args:?}: {code} {message}");
    }
}

#[test]
fn ghosts_are_listed_by_their_irradiance() {
    let f = Folder::new("ghosts");
    let args =
        ["lens", "ghosts", "double-gauss-50mm", "--source", "8deg", "--rays", "24", "-o", "g.svg", "-o", "g.json", "--json"];
    let told: Value = serde_json::from_slice(&f.ok(&args).stdout).unwrap();
    assert_eq!(told["pairs"], 55);
    let ghosts = told["ghosts"].as_array().unwrap();
    let irradiance: Vec<f64> = ghosts.iter().map(|g| g["irradiance"].as_f64().unwrap()).collect();
    assert!(irradiance.len() > 30 && irradiance.is_sorted_by(|a, b| a >= b), "{irradiance:?}");
    // Those with the sensor have no surface to turn at.
    assert!(ghosts.iter().any(|g| g["back"].is_null()) && ghosts.iter().all(|g| g["forth"].as_u64() < Some(12)));
    assert!(String::from_utf8(f.read("g.svg")).unwrap().contains("on the film"));
    // Four reflections, and orders of the sensor's grating, when asked for.
    let more = [&args[..5], &["--rays", "12", "--fours", "5", "--pixel-pitch", "5um", "--json"]].concat();
    let told: Value = serde_json::from_slice(&f.ok(&more).stdout).unwrap();
    let ghosts = told["ghosts"].as_array().unwrap();
    assert!(ghosts.iter().any(|g| g["turns"].as_array().unwrap().len() == 4));
    let order = |g: &&Value| g["order"].as_array().is_some_and(|o| o.iter().any(|v| v != 0));
    assert!(ghosts.iter().filter(order).count() > 3 && ghosts.iter().filter(order).all(|g| g["back"].is_null()));
    // Coated they are weaker by orders of magnitude.
    let coated = [&args[..5], &["--rays", "24", "--coating", "modern", "--sensor-reflectance", "0", "--json"]].concat();
    let told: Value = serde_json::from_slice(&f.ok(&coated).stdout).unwrap();
    let strongest = told["ghosts"][0]["irradiance"].as_f64().unwrap();
    assert!(strongest < 0.1 * irradiance[0], "{strongest} {}", irradiance[0]);
}

#[test]
fn photographs_have_the_ghosts_that_are_asked_for() {
    let f = Folder::new("stray");
    let shot = |lens: &str, stray: &str, threads: &str, file: &str| {
        let args = ["expose", "cornell", "--lens", lens, "--size", "36x24", "--spp", "2", "--shutter", "1/30"];
        let output = f.ok(&[&args[..], &["--stray", stray, "--threads", threads, "-o", file]].concat());
        (f.read(file), String::from_utf8(output.stderr).unwrap())
    };
    let (none, _) = shot("double-gauss-50mm", "none", "2", "none.exr");
    let (ghosts, told) = shot("double-gauss-50mm", "ghosts", "2", "ghosts.exr");
    assert!(none != ghosts && !told.contains("no stray light"), "{told}");
    assert_eq!(shot("double-gauss-50mm", "ghosts", "1", "again.exr").0, ghosts);
    let (_, told) = shot("thin", "ghosts", "2", "thin.exr");
    assert!(told.contains("there is no stray light in this picture: an ideal lens has no surfaces"), "{told}");
    let (code, message) = f.fails(&["expose", "cornell", "--stray", "veil", "-o", "x.exr"]);
    assert!(code != 0 && message.contains("all, none, or some of ghosts, diffraction, scatter"), "{message}");
}

#[test]
fn one_switch_says_which_stray_light_is_in_a_picture_and_truth_holds_it() {
    let f = Folder::new("stray-all");
    let args = [
        "expose",
        "glare-spot",
        "--lens",
        "double-gauss-50mm",
        "--size",
        "48x32",
        "--spp",
        "16",
        "--shutter",
        "1/30",
        "--denoise",
        "off",
    ];
    let shot = |more: &[&str], file: &str| {
        let output = f.ok(&[&args[..], more, &["-o", file]].concat());
        (f.read(file), String::from_utf8(output.stderr).unwrap())
    };
    let (none, _) = shot(&["--stray", "none"], "none.exr");
    let (all, told) = shot(&["--stray", "all", "--truth-channels", "stray-light"], "all.exr");
    assert!(none != all && !told.contains("no stray light") && !told.contains("no scatter"), "{told}");
    assert!(all.windows(7).any(|w| w == b"stray.R"));
    // The plain index of the spot is what the lens scatters into it.
    let index = |file: &str| {
        let told: Value = serde_json::from_slice(
            &f.ok(&["measure", "glare", file, "--channel", "green", "--region", "23,15,2,2", "--json"]).stdout,
        )
        .unwrap();
        told["picture"]["index"].as_f64().unwrap()
    };
    assert!(index("none.exr") < 1e-6 && index("all.exr") > 1e-4, "{} {}", index("none.exr"), index("all.exr"));
    let told: Value =
        serde_json::from_slice(&f.ok(&["measure", "glare", "--lens", "double-gauss-50mm", "--rays", "500", "--json"]).stdout)
            .unwrap();
    assert!((1e-3..0.2).contains(&told["lens"]["index"].as_f64().unwrap()), "{told}");
    let (code, message) = f.fails(&["expose", "glare-spot", "--hood", "30mm", "-o", "x.exr"]);
    assert!(code != 0 && message.contains("a real lens"), "{message}");
    let (_, told) = shot(&["--stray", "scatter", "--hood", "30mm"], "hood.exr");
    assert!(!told.contains("no scatter"), "{told}");
}

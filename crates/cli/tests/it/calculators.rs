//! Calculators of lenses, stops and formats, held against closed forms.

use crate::common::Folder;
use serde_json::Value;

fn json(f: &Folder, args: &[&str]) -> Value {
    serde_json::from_slice(&f.ok(&[args, &["--json"]].concat()).stdout).unwrap()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key}: {value}"))
}

#[test]
fn thin_lenses_follow_the_lens_formula() {
    let f = Folder::new("thin-lens");
    let pairs: [&[&str]; 6] = [
        &["--focal-length", "50mm", "--object", "0.3m"],
        &["--focal-length", "50mm", "--image", "60mm"],
        &["--focal-length", "50mm", "--magnification", "-0.2"],
        &["--object", "30cm", "--image", "60mm"],
        &["--object", "300mm", "--magnification", "-0.2"],
        &["--image", "60mm", "--magnification", "-0.2"],
    ];
    for pair in pairs {
        let v = json(&f, &[&["calc", "thin-lens"], pair].concat());
        let all = ["focal_length_mm", "object_mm", "image_mm", "magnification"].map(|key| number(&v, key));
        for (got, expected) in all.into_iter().zip([50.0, 300.0, 60.0, -0.2]) {
            assert!((got - expected).abs() < 1e-9, "{pair:?}: {v}");
        }
        assert_eq!((&v["real_image"], &v["circle_mm"]), (&Value::Bool(true), &Value::Null));
    }
    // 50 mm f/2 focused at 3 m, film at 150/2.95 mm: what is infinitely far is a circle of A |film - f| / f.
    let blur = ["calc", "thin-lens", "--focal-length", "50mm", "--object", "3m", "--aperture", "f/2"];
    let v = json(&f, &blur);
    assert!((number(&v, "circle_mm") - 25.0 * (150.0 / 2.95 - 50.0) / 50.0).abs() < 1e-9, "{v}");
    let v = json(&f, &[&blur[..], &["--distance", "3m"]].concat());
    assert!(number(&v, "circle_mm") < 1e-12, "{v}");
    // Within the focal length the image is virtual, upright and larger: a magnifier.
    let v = json(&f, &["calc", "thin-lens", "--focal-length", "50mm", "--object", "30mm"]);
    assert!((number(&v, "image_mm") + 75.0).abs() < 1e-9 && (number(&v, "magnification") - 2.5).abs() < 1e-12, "{v}");
    let far = json(&f, &["calc", "thin-lens", "--focal-length", "85mm", "--object", "inf"]);
    assert_eq!((number(&far, "image_mm"), &far["object_mm"]), (85.0, &Value::Null));
    let rows = json(&f, &["calc", "thin-lens", "--focal-length", "50mm"]);
    for row in rows["rows"].as_array().unwrap() {
        if let (Some(o), Some(i)) = (row["object_mm"].as_f64(), row["image_mm"].as_f64()) {
            assert!((1.0 / o + 1.0 / i - 0.02).abs() < 1e-12, "{row}");
        }
    }
}

#[test]
fn stops_are_focal_length_over_diameter() {
    let f = Folder::new("stop");
    for pair in [
        ["--aperture", "f/2.8", "--focal-length", "70mm"],
        ["--aperture", "f/2.8", "--diameter", "25mm"],
        ["--focal-length", "70mm", "--diameter", "25mm"],
    ] {
        let v = json(&f, &[&["calc", "stop"], &pair[..]].concat());
        assert!((number(&v, "focal_length_mm") - 70.0).abs() < 1e-9, "{v}");
        let stop = &v["stop"];
        assert!((number(stop, "f_number") - 2.8).abs() < 1e-12 && (number(stop, "diameter_mm") - 25.0).abs() < 1e-9, "{v}");
        assert!((number(stop, "area_mm2") - std::f64::consts::PI * 156.25).abs() < 1e-9, "{v}");
        assert_eq!(number(stop, "nominal"), 2.8);
    }
    // Each full stop has half the area of the one before.
    let series = json(&f, &["calc", "stop", "--focal-length", "50mm"]);
    let areas: Vec<f64> = series["full_stops"].as_array().unwrap().iter().map(|s| number(s, "area_mm2")).collect();
    assert!(areas.len() > 8 && areas.windows(2).all(|w| (w[0] / w[1] - 2.0).abs() < 1e-9), "{areas:?}");
}

#[test]
fn formats_have_their_areas_and_crop_factors() {
    let f = Folder::new("formats");
    let all = json(&f, &["calc", "formats"]);
    let row = |name: &str| {
        let found = all.as_array().unwrap().iter().find(|r| r["name"] == name);
        found.unwrap_or_else(|| panic!("{name}: {all}")).clone()
    };
    for (name, width, height, crop) in [
        ("full frame", 36.0, 24.0, 1.0),
        ("aps-h", 27.9, 18.6, 1.290),
        ("aps-c", 23.6, 15.7, 1.526),
        ("aps-c canon", 22.3, 14.9, 1.613),
        ("4/3", 17.3, 13.0, 1.999),
        ("1\"", 13.2, 8.8, 2.727),
        ("2/3\"", 8.8, 6.6, 3.933),
        ("1/1.8\"", 7.18, 5.32, 4.842),
        ("1/2.3\"", 6.17, 4.55, 5.644),
        ("medium format", 43.8, 32.9, 0.790),
        ("645", 53.4, 40.0, 0.648),
    ] {
        let r = row(name);
        assert_eq!((number(&r, "width_mm"), number(&r, "height_mm")), (width, height), "{name}");
        assert!((number(&r, "area_mm2") - width * height).abs() < 1e-9 && (number(&r, "crop_factor") - crop).abs() < 6e-4, "{r}");
    }
    let diagonals: Vec<f64> = all.as_array().unwrap().iter().map(|r| number(r, "diagonal_mm")).collect();
    assert!(diagonals.is_sorted_by(|a, b| a >= b), "{diagonals:?}");
    let some = json(&f, &["calc", "formats", "full frame", "30x20"]);
    assert_eq!(number(&some[1], "area_mm2"), 600.0);
}

#[test]
fn drawings_of_calculators_are_written() {
    let f = Folder::new("calc-draw");
    f.ok(&["calc", "thin-lens", "--focal-length", "50mm", "--object", "0.12m", "-o", "gauss.svg", "-o", "gauss.png"]);
    let svg = String::from_utf8(f.read("gauss.svg")).unwrap();
    assert!(["object", "image", "parallel ray", "F'"].iter().all(|t| svg.contains(t)), "{svg}");
    assert!(f.read("gauss.png").starts_with(b"\x89PNG"));
    f.ok(&["calc", "thin-lens", "--focal-length", "50mm", "-o", "curve.svg"]);
    assert!(String::from_utf8(f.read("curve.svg")).unwrap().contains("image distance z_i, mm"));
    f.ok(&["calc", "stop", "--focal-length", "50mm", "-o", "stops.svg"]);
    assert!(String::from_utf8(f.read("stops.svg")).unwrap().contains("f/22"));
}

#[test]
fn what_is_asked_wrongly_is_said() {
    let f = Folder::new("calc-wrong");
    let cases: [(&[&str], &str); 10] = [
        (&["calc", "thin-lens"], "two of --focal-length"),
        (&["calc", "thin-lens", "--focal-length", "50mm", "--object", "1m", "--image", "52mm"], "two of"),
        (&["calc", "thin-lens", "--focal-length", "0mm", "--object", "1m"], "other than 0"),
        (&["calc", "thin-lens", "--object", "1m", "--image", "-1m"], "no thin lens"),
        (&["calc", "thin-lens", "--focal-length", "50mm", "--object", "3cm", "--aperture", "f/2"], "above 0"),
        (&["calc", "thin-lens", "--focal-length", "50mm", "--object", "inf", "-o", "a.png"], "finite"),
        (&["calc", "stop"], "two of --aperture"),
        (&["calc", "stop", "--aperture", "f/2", "--focal-length", "-5mm"], "above 0"),
        (&["calc", "stop", "--focal-length", "50mm", "-o", "a.pdf"], ".svg or .png"),
        (&["calc", "formats", "half frame"], "full frame"),
    ];
    for (args, said) in cases {
        let (code, message) = f.fails(args);
        assert!(code == 2 && message.contains(said), "{args:?}: {code} {message}");
    }
    let told = f.run(&["calc", "stop", "--json"]);
    let error: Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!(error["error"]["found"], "none given", "{error}");
}

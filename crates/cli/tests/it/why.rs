//! `why` as a user types it.

use crate::common::Folder;
use serde_json::Value;

#[test]
fn a_raw_file_is_explained_with_its_shot_file_beside_it() {
    let f = Folder::new("why");
    let shoot = ["shoot", "flat-field", "--lens", "double-gauss-50mm", "--aperture", "f/2.8", "--size", "48x32", "--spp", "4"];
    f.ok(&[&shoot[..], &["-o", "a.dng", "--save-shot", "a.toml"]].concat());
    let told: Value =
        serde_json::from_slice(&f.ok(&["why", "a.dng", "--at", "0.4,0.4", "-o", "a.html", "--json"]).stdout).unwrap();
    assert_eq!(told["pixel"], serde_json::json!([19, 12]), "{told}");
    let (product, value) = (&told["brightness"]["factors"], told["brightness"]["value"].as_f64().unwrap());
    let last = product.as_array().unwrap().last().unwrap()["product"].as_f64().unwrap();
    assert!((last / value - 1.0).abs() < 1e-9, "{told}");
    // What the file counts is what is expected, within its noise and pattern.
    let (counted, noise) = (told["raw"]["electrons"].as_f64().unwrap(), told["noise"]["total_e"].as_f64().unwrap());
    assert!((counted - told["brightness"]["electrons"].as_f64().unwrap()).abs() < 6.0 * noise, "{told}");
    let page = String::from_utf8(f.read("a.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && !page.contains("src=\"http") && page.contains("What softens it"));
    let text = String::from_utf8(f.ok(&["why", "a.toml"]).stdout).unwrap();
    assert!(text.contains("pixel aperture") && text.contains("read noise") && text.contains("down (f/"), "{text}");

    f.ok(&["shoot", "flat-field", "--size", "48x32", "--spp", "1", "-o", "b.dng"]);
    let (code, message) = f.fails(&["why", "b.dng"]);
    assert!(code == 2 && message.contains("b.toml") && message.contains("--save-shot"), "{code} {message}");
    let (code, message) = f.fails(&["why", "b.dng", "--shot", "a.toml"]);
    assert!(code == 2 && message.contains("another picture"), "{code} {message}");
    // The same numbers, through another lens or of another body.
    let same = [
        "shoot",
        "flat-field",
        "--size",
        "48x32",
        "--spp",
        "1",
        "--mode",
        "M",
        "--shutter",
        "1/60",
        "--iso",
        "200",
        "--aperture",
        "f/4",
    ];
    f.ok(&[&same[..], &["--lens", "double-gauss-50mm", "-o", "d.dng", "--save-shot", "d.toml"]].concat());
    f.ok(&["why", "d.dng"]);
    for (lens, body, what) in
        [("planar-50mm-f1.4", "canon-5d-mark-iv", "through lens"), ("double-gauss-50mm", "canon-5d-mark-ii", "of camera")]
    {
        f.ok(&[&same[..], &["--lens", lens, "--body", body, "-o", "c.dng"]].concat());
        let (code, message) = f.fails(&["why", "c.dng", "--shot", "d.toml"]);
        assert!(code == 2 && message.contains(what) && message.contains("another picture"), "{code} {message}");
    }
    for args in [&["why", "a.toml", "--at", "1.5,0"][..], &["why", "a.jpg"], &["why", "a.toml", "-o", "a.txt"]] {
        let (code, message) = f.fails(args);
        assert!(code == 2 && message.contains("expected"), "{args:?}: {code} {message}");
    }
}

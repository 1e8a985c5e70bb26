//! Calibrations on the command line: a lens for other programs, and back as a camera.

use crate::common::Folder;
use serde_json::Value;

#[test]
fn a_lens_is_calibrated_and_photographed_with() {
    let f = Folder::new("calibrate");
    let files = [
        "a.json",
        "camera.yaml",
        "cameras.txt",
        "camchain.yaml",
        "transforms.json",
        "lens.xml",
        "distort.exr",
        "undistort.exr",
        "rays.exr",
    ];
    let outputs: Vec<&str> = files.iter().flat_map(|n| ["-o", n]).collect();
    let args =
        ["lens", "calibrate", "double-gauss-50mm", "--size", "48x32", "--model", "opencv4,opencv5,opencv-fisheye", "--json"];
    let told: Value = serde_json::from_slice(&f.ok(&[&args[..], &outputs].concat()).stdout).unwrap();
    assert_eq!((f.files().len(), told["models"].as_array().unwrap().len()), (files.len(), 3));
    let fit = &told["models"][0]["fit"];
    // A fraction of a pixel of 0.75 mm.
    assert!(fit["rms_px"].as_f64().unwrap() < 0.05 && fit["map"]["columns"] == 33, "{fit}");
    // Each is a camera again; the size is the calibration's.
    for file in ["a.json", "cameras.txt", "camchain.yaml", "transforms.json", "distort.exr", "rays.exr"] {
        let shot = ["shoot", "cornell", "--camera", file, "--spp", "1", "--shutter", "1/30", "--json", "-o", "x.png"];
        let told: Value = serde_json::from_slice(&f.ok(&shot).stdout).unwrap();
        assert_eq!(told["size"], serde_json::json!([48, 32]), "{file}");
    }
    for (args, says) in [
        (&["lens", "calibrate", "double-gauss-50mm", "-o", "x.dat"][..], "--format"),
        (&["lens", "calibrate", "double-gauss-50mm", "--model", "cubic"], "opencv5"),
        (&["lens", "calibrate", "double-gauss-50mm", "-o", "x.yaml", "--format", "lensfun"], "ends in .xml"),
        (&["lens", "calibrate", "double-gauss-50mm", "-o", "images.txt"], "shoot"),
        (&["lens", "calibrate", "double-gauss-50mm", "--size", "48x32", "--model", "f-theta", "-o", "x.yaml"], "opencv5"),
        (&["shoot", "cornell", "--camera", "undistort.exr"], "undistorts"),
        (&["shoot", "cornell", "--camera", "lens.xml"], "lens.xml"),
    ] {
        let (code, message) = f.fails(args);
        assert!(code == 2 && message.contains(says), "{args:?}: {code} {message}");
    }
    // What one format cannot say is said before any file is written.
    let two = [
        "lens",
        "calibrate",
        "double-gauss-50mm",
        "--size",
        "48x32",
        "--model",
        "f-theta",
        "-o",
        "first.json",
        "-o",
        "camchain.yaml",
    ];
    let (code, message) = f.fails(&two);
    assert!(code == 2 && !f.path("first.json").exists(), "{message}");
}

#[test]
fn pictures_have_their_calibration_beside_them() {
    let f = Folder::new("poses");
    let common = ["shoot", "cornell", "--lens", "pinhole", "--size", "48x32", "--spp", "1", "--shutter", "1/30"];
    let outputs = ["-o", "a.png", "-o", "calibration.json", "-o", "images.txt", "-o", "transforms.json"];
    f.ok(&[&common[..], &["--frames", "2", "--fps", "10"], &outputs].concat());
    let calibration: Value = serde_json::from_slice(&f.read("calibration.json")).unwrap();
    let frames = calibration["frames"].as_array().unwrap();
    assert_eq!((frames.len(), frames[1]["file"].as_str()), (2, Some("a-002.png")));
    assert_eq!(frames[0]["poses"].as_array().unwrap().len(), 3);
    assert!(f.path("a-001.png").exists() && !f.path("calibration-001.json").exists());
    let transforms: Value = serde_json::from_slice(&f.read("transforms.json")).unwrap();
    assert_eq!(transforms["frames"][1]["transform_matrix"][3], serde_json::json!([0.0, 0.0, 0.0, 1.0]));
    // Without a picture nothing is exposed.
    f.ok(&[&common[..], &["-o", "cameras.txt"]].concat());
    assert!(f.path("cameras.txt").exists() && !f.path("photo.jpg").exists());
}

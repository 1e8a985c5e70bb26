//! Stages know no other stage: the drawing in ARCHITECTURE.md, held against `cargo metadata`.

use serde_json::Value;
use std::process::Command;

/// Who may depend on whom, among our own crates.
const ARROWS: &[(&str, &[&str])] = &[
    ("diopter-light", &[]),
    ("diopter-image", &["diopter-light"]),
    ("diopter-lens", &["diopter-light"]),
    // The environment map is a raster, and reads EXR.
    ("diopter-scene", &["diopter-light", "diopter-image"]),
    ("diopter-sensor", &["diopter-light", "diopter-image"]),
    ("diopter-develop", &["diopter-light", "diopter-image"]),
    // The binding of a C library: it knows none of us, and only the camera opens it.
    ("diopter-oidn", &[]),
    (
        "diopter",
        &["diopter-light", "diopter-image", "diopter-lens", "diopter-scene", "diopter-sensor", "diopter-develop", "diopter-oidn"],
    ),
    // A front end of its own, which the command line starts as a verb: one function, `diopter_viewfinder::serve(options)`.
    ("diopter-viewfinder", &["diopter"]),
    ("diopter-cli", &["diopter", "diopter-viewfinder"]),
    // The wheel holds the program, too. One shared library has both: a second executable beside it would double the wheel and its build. The arrow is
    // one function, `diopter_cli::run(arguments)`; nothing else of the command line is known.
    ("diopter-py", &["diopter", "diopter-cli"]),
];

#[test]
fn arrows_are_those_of_the_drawing() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    assert_eq!(packages.len(), ARROWS.len(), "a crate was added or removed: draw it");
    for package in packages {
        let name = package["name"].as_str().expect("a name");
        let (_, allowed) = ARROWS.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("{name} is not in the drawing"));
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let on = dependency["name"].as_str().expect("a name");
            if on.starts_with("diopter") {
                assert!(allowed.contains(&on), "{name} must not know {on}");
            }
        }
    }
}

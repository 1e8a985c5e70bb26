//! Data sets as a user makes them.

use crate::common::Folder;
use serde_json::Value;

const SPEC: &str = "name = \"four\"\nseed = 5\n[shot.scene]\nfile = \"cornell\"\n[shot.exposure]\nshutter = \"1/30\"\n\
    [shot.render]\nsize = \"24x16\"\nspp = 1\n[[vary]]\nname = \"iso\"\ngrid = [100, 1600]\n[[vary]]\nname = \"aperture\"\ngrid = [\"f/2\", \"f/8\"]\n\
    [[vary]]\nname = \"nd\"\nvalues = [\"ND8\"]\nwhen = { aperture = \"f/2\" }\n[write]\nfiles = [\"raw.npy\"]\nshard_items = 3\n";

const MADE: [&str; 7] =
    ["SHA256SUMS", "card.json", "card.md", "data-000000.tar", "data-000001.tar", "metadata.jsonl", "metadata.parquet"];

fn json(f: &Folder, args: &[&str]) -> Value {
    serde_json::from_slice(&f.ok(&[args, &["--json"]].concat()).stdout).unwrap()
}

#[test]
fn workers_and_threads_make_the_same_bytes() {
    let f = Folder::new("dataset-make");
    std::fs::write(f.path("spec.toml"), SPEC).unwrap();
    let info = json(&f, &["dataset", "info", "spec.toml"]);
    assert_eq!((info["items"].as_u64(), info["listed"][2]["parameters"]["nd"].as_str()), (Some(4), None), "{info}");
    assert_eq!(info["tried"], 4);
    assert_eq!(info["listed"][1]["parameters"], serde_json::json!({ "aperture": "f/2", "iso": 1600, "nd": "ND8" }));
    let told = json(&f, &["dataset", "make", "spec.toml", "-o", "a"]);
    assert_eq!((told["made"].as_u64(), told["files"].as_array().unwrap().len()), (Some(4), MADE.len()), "{told}");
    f.ok(&["dataset", "item", "spec.toml", "--items", "2..4", "-o", "b", "--threads", "1"]);
    f.ok(&["dataset", "item", "spec.toml", "--item", "1", "-o", "b"]);
    assert_eq!(json(&f, &["dataset", "make", "spec.toml", "-o", "b", "--threads", "1"])["made"], 1);
    let mut names: Vec<String> =
        std::fs::read_dir(f.path("b")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, MADE);
    for name in MADE {
        assert!(f.read(&format!("a/{name}")) == f.read(&format!("b/{name}")), "{name}");
    }
}

#[test]
fn jobs_of_render_farms_name_the_specification_beside_them() {
    let f = Folder::new("dataset-job");
    std::fs::write(f.path("spec.toml"), SPEC).unwrap();
    std::fs::create_dir(f.path("farm")).unwrap();
    f.ok(&["dataset", "job", "spec.toml", "-o", "job.yaml", "--items-per-task", "3", "--timeout", "5 min", "--memory", "1GiB"]);
    let text = String::from_utf8(f.read("job.yaml")).unwrap();
    for line in ["default: \"spec.toml\"", "default: \"spec\"", "range: \"0-3:3\"", "timeout: 300", "min: 1024"] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    // Above the template: the job is told where it is.
    let output = f.ok(&["dataset", "job", "spec.toml", "-o", "farm/job.yaml"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("-p Specification="));
    assert!(!String::from_utf8(f.read("farm/job.yaml")).unwrap().contains("spec.toml"));
}

#[test]
fn what_makes_no_data_set_is_said() {
    let f = Folder::new("dataset-wrong");
    std::fs::write(f.path("spec.toml"), SPEC).unwrap();
    std::fs::write(f.path("wrong.toml"), SPEC.replace("\"iso\"", "\"isso\"")).unwrap();
    // What fails only when a shot is prepared is said before any is taken, and no folder is begun that would keep the mistake.
    std::fs::write(f.path("dark.toml"), SPEC.replace("[100, 1600]", "[100, 3]")).unwrap();
    let cases: [(&[&str], &str); 7] = [
        (&["info", "dark.toml"], "dark.toml: item 000001 (iso 3, aperture f/2, nd ND8): ISO 3: expected 100 to 6400"),
        (&["make", "dark.toml", "-o", "dark"], "dark.toml: item 000001"),
        (&["make", "wrong.toml", "-o", "x"], "wrong.toml: [[vary]] 1 (isso): vary \"isso\"; expected"),
        (&["item", "spec.toml", "-o", "x"], "--item"),
        (&["item", "spec.toml", "--item", "4", "-o", "x"], "0 to 3"),
        (&["item", "spec.toml", "--items", "3..1", "-o", "x"], "0..200"),
        (&["make", "spec.toml", "-o", "."], "an empty folder"),
    ];
    for (args, said) in cases {
        let (code, message) = f.fails(&[&["dataset"], args].concat());
        assert!(code == 2 && message.contains(said), "{args:?}: {code} {message}");
    }
    assert!(!f.path("dark").exists());
}

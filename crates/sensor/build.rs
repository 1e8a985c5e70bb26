//! Lists the embedded bodies: a data sheet in `src/bodies` is one.

fn main() {
    println!("cargo::rerun-if-changed=src/bodies");
    let folder = std::fs::canonicalize("src/bodies").expect("src/bodies");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .expect("src/bodies")
        .filter_map(|f| Some(f.ok()?.file_name().to_str()?.strip_suffix(".toml")?.to_owned()))
        .collect();
    // What is not a body of anybody's comes last.
    names.sort_by_key(|n| (n == "ideal", n.clone()));
    let entry = |n: &String| format!("    ({n:?}, include_str!({:?})),\n", folder.join(format!("{n}.toml")));
    let list = format!("&[\n{}]\n", names.iter().map(entry).collect::<String>());
    let out = std::path::PathBuf::from(std::env::var_os("OUT_DIR").expect("set by cargo"));
    std::fs::write(out.join("bodies.rs"), list).expect("writable");
}

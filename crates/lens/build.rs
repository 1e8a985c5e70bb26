//! Packs the glass tables (readable text in the repository, a third of its size in the binary) and lists the embedded lenses.

fn main() {
    println!("cargo::rerun-if-changed=src/glass/data");
    let out = std::path::PathBuf::from(std::env::var_os("OUT_DIR").expect("set by cargo"));
    for name in ["glasses", "materials", "discontinued", "absorption"] {
        let path = format!("src/glass/data/{name}.csv");
        let text = std::fs::read(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
        std::fs::write(out.join(format!("{name}.deflate")), miniz_oxide::deflate::compress_to_vec_zlib(&text, 10))
            .expect("writable");
    }

    println!("cargo::rerun-if-changed=src/lenses");
    let folder = std::fs::canonicalize("src/lenses").expect("src/lenses");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .expect("src/lenses")
        .filter_map(|f| Some(f.ok()?.file_name().to_str()?.strip_suffix(".toml")?.to_owned()))
        .collect();
    names.sort();
    let entry = |n: &String| format!("    ({n:?}, include_str!({:?})),\n", folder.join(format!("{n}.toml")));
    let list = format!("&[\n{}]\n", names.iter().map(entry).collect::<String>());
    std::fs::write(out.join("lenses.rs"), list).expect("writable");
}

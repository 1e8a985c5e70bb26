//! Packs the glass tables: readable text in the repository, a third of its size in the binary.

fn main() {
    println!("cargo::rerun-if-changed=src/glass/data");
    let out = std::path::PathBuf::from(std::env::var_os("OUT_DIR").expect("set by cargo"));
    for name in ["glasses", "materials", "absorption"] {
        let path = format!("src/glass/data/{name}.csv");
        let text = std::fs::read(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
        std::fs::write(out.join(format!("{name}.deflate")), miniz_oxide::deflate::compress_to_vec_zlib(&text, 10)).expect("writable");
    }
}

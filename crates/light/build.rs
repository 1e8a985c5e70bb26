//! Fits the RGB → spectrum table once, at build time (about a second), with the solver of `src/upsample_fit.rs`.
//!
//! The table is derived data: fitting it here keeps a megabyte out of the repository and off the start-up time.

#[path = "src/cie/tables.rs"]
#[allow(dead_code)]
mod tables;
#[path = "src/upsample_fit.rs"]
#[allow(dead_code)]
mod upsample_fit;

fn main() {
    println!("cargo::rerun-if-changed=src/upsample_fit.rs");
    println!("cargo::rerun-if-changed=src/cie");
    let (_, observer) = tables::read_csv(tables::CIE_1931_CSV);
    let (names, rows) = tables::read_csv(tables::ILLUMINANTS_CSV);
    let column = names.iter().position(|n| n == "D65").expect("D65 is in the table") + 1;
    let d65: Vec<(f64, f64)> = rows.iter().map(|r| (r[0], r[column])).collect();
    let table = upsample_fit::Fit::new(&observer, &d65).table();
    let bytes: Vec<u8> = table.iter().flat_map(|c| c.to_le_bytes()).collect();
    let path = std::path::Path::new(&std::env::var("OUT_DIR").expect("cargo sets OUT_DIR")).join("upsample.bin");
    std::fs::write(path, bytes).expect("the build directory is writable");
}

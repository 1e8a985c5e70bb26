//! Published tables, as the CSV files beside this one; read at first use.
//!
//! Source: CIE 1931 2° observer (CIE 018:2019 data, 1 nm, 360–830 nm), CIE illuminants (CIE 015:2018, 5 nm, 380–780 nm)
//! and the BabelColor average of 30 ColorChecker charts (10 nm, 380–730 nm), exported with colour-science 0.4.7 (BSD-3).
//! A checksum test holds each file to what was checked; a statistic would miss a swapped digit.

/// CIE 1931 2° colour-matching functions: `nm,x,y,z`, 360–830 nm in 1 nm.
pub const CIE_1931_CSV: &str = include_str!("cie1931_2deg_1nm.csv");
/// Relative spectral powers of the CIE illuminants: `nm,<names>`, 380–780 nm in 5 nm.
pub const ILLUMINANTS_CSV: &str = include_str!("illuminants_5nm.csv");
/// Spectral reflectance of the 24 ColorChecker patches, 380–730 nm in 10 nm.
pub const COLORCHECKER_CSV: &str = include_str!("colorchecker24_babelcolor_avg_10nm.csv");

/// Reads a CSV of numbers with a header line: the column names after the first, and the rows, `[row][column]` with the first column.
///
/// Panics on a malformed table: the tables are our own, and a test reads each.
pub fn read_csv(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut lines = text.lines();
    let header = lines.next().expect("a header line");
    // Patch names hold commas only inside brackets-free text: split plainly.
    let names = header.split(',').skip(1).map(str::to_owned).collect();
    let rows = lines
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| line.split(',').map(|cell| cell.trim().parse().expect("a number")).collect())
        .collect();
    (names, rows)
}
